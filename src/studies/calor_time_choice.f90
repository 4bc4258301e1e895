!> The longest time steps whose error a comparison of schemes in space can bear.
!>
!> A scheme in space is compared fairly if time steps neither spoil its result nor cost more than
!> they must. So pilot runs halve the steps (an eighth of the tolerance halves them, as the error of
!> a step goes with its third power) until the error that the steps make is small enough and
!> shorter ones are not cheaper; where need be, steps between two pilot runs are found and verified
!> against the finest run. The error of that one follows from its difference from the run before, of
!> which an integrator of order p leaves 1/(2^p - 1).
module calor_time_choice
  use calor_error, only: error_t
  use calor_integrators, only: make_integrator
  use calor_kinds, only: wp
  use calor_scene, only: scene_t
  use calor_simulation, only: simulation_t
  use calor_stepper, only: stepper_t
  use calor_sums, only: root_mean_square
  implicit none (type, external)
  private

  public :: time_choice_t, choose_time_steps, pilot_scene, relative_difference

  !> Steps found for one scene
  type :: time_choice_t
    !> One of the names in `integrator_choices`
    character(len=:), allocatable :: method
    !> Tolerance, as &time tolerance, or fixed step, s; 0: none
    real(wp) :: tolerance = 0.0_wp, step = 0.0_wp
    !> The error that the steps make: relative L2, at the end
    real(wp) :: error = 0.0_wp
    !> The temperature at the end, of the finest pilot run
    real(wp), allocatable :: temperature(:)
    !> Evaluations of the Laplacian
    integer :: evaluations = 0
  contains
    !> Put method, tolerance and step into a scene
    procedure :: apply
  end type time_choice_t

  !> The tolerance that pilot runs begin with
  real(wp), parameter :: first_tolerance = 1.0e-2_wp
  !> Steps are not made shorter than this part of the first ones; rounding errors are all that is
  !> left then
  real(wp), parameter :: least_part = 0.5_wp**13
  !> Runs whose numbers of steps differ by this factor at least tell each other's errors
  real(wp), parameter :: least_ratio = 1.5_wp
  !> The error of the finest run is an estimate: so much of what is allowed is made use of
  real(wp), parameter :: margin = 0.9_wp
  !> The exponential propagator's tolerance is this part of the error that other steps make: more
  !> accuracy costs it little
  real(wp), parameter :: exponential_part = 0.1_wp
  !> Relative errors below this are rounding errors
  real(wp), parameter :: least_error = 1.0e-12_wp

contains

  subroutine apply(this, scene)
    class(time_choice_t), intent(in) :: this
    type(scene_t), intent(inout) :: scene

    scene%time%method = this%method
    scene%time%tolerance = this%tolerance
    scene%time%step = this%step
  end subroutine apply

  !> The scene as pilot runs want it prepared.
  function pilot_scene(scene) result(pilot)
    !> The scene; its tolerance and step do not matter
    type(scene_t), intent(in) :: scene
    type(scene_t) :: pilot

    pilot = scene
    pilot%time%only_rkl2 = .true.
    pilot%time%step = 0
    pilot%time%tolerance = 0
    if (is_adaptive(scene%time%method)) pilot%time%tolerance = first_tolerance
  end function pilot_scene

  !> ‖u - v‖/‖v‖ in the L2 norm, particles counting by their volumes; ‖u‖ where v vanishes.
  pure function relative_difference(u, v, volume) result(difference)
    !> Two fields, and the volumes of the particles
    real(wp), intent(in) :: u(:), v(:), volume(:)
    real(wp) :: difference
    real(wp) :: norm

    difference = sqrt(sum(volume*(u - v)**2))
    norm = sqrt(sum(volume*v**2))
    if (norm > 0) difference = difference/norm
  end function relative_difference

  !> Find the steps. With the method 'auto' these are steps of RKL2, of Runge–Kutta 4 where that is
  !> cheaper, or of the exponential propagator where that is possible and cheaper still.
  subroutine choose_time_steps(simulation, allowed, choice, error, truth, known_to)
    !> A simulation just prepared from a `pilot_scene`; it stays at its start
    type(simulation_t), intent(inout) :: simulation
    !> The error that steps may make, relative L2 at the end; with `truth`, as a part of the error
    !> in space
    real(wp), intent(in) :: allowed
    !> The steps
    type(time_choice_t), intent(out) :: choice
    !> The numbers went wrong
    type(error_t), allocatable, intent(out) :: error
    !> The true temperatures at the end, particle by particle
    real(wp), intent(in), optional :: truth(:)
    !> The relative error of those; an error in space is not taken for smaller
    real(wp), intent(in), optional :: known_to
    type(time_choice_t) :: other
    type(error_t), allocatable :: failure
    integer :: limit

    limit = huge(limit)
    if (simulation%scene%time%method == 'auto') limit = runge_kutta_evaluations(simulation)
    call refine(simulation, simulation%scene%time%method, allowed, limit, choice, error, truth, &
                known_to)
    if (allocated(error)) return
    if (choice%evaluations > limit) then
      call refine(simulation, 'runge_kutta_4', allowed, huge(limit), other, failure, truth, &
                  known_to)
      if (allocated(failure)) then
        ! Off the real axis it is not always stable. What was given up for its sake is taken up.
        call refine(simulation, simulation%scene%time%method, allowed, huge(limit), choice, error, &
                    truth, known_to)
        if (allocated(error)) return
      else
        choice = other
      end if
    end if
    if (simulation%scene%time%method /= 'auto') return
    if (choice%method == 'auto') choice%method = 'rkl2'
    call consider_exponential(simulation, choice)
  end subroutine choose_time_steps

  !> Take the exponential propagator where it takes fewer evaluations for an error that is no larger
  !> than that of the steps chosen.
  subroutine consider_exponential(simulation, choice)
    type(simulation_t), intent(inout) :: simulation
    type(time_choice_t), intent(inout) :: choice
    type(stepper_t) :: stepper
    type(error_t), allocatable :: failure
    real(wp), allocatable :: u(:)
    real(wp) :: tolerance, time, deviation

    if (simulation%conduction%depends_on_time() .or. .not. simulation%conduction%is_linear()) return
    tolerance = exponential_part*choice%error*root_mean_square(choice%temperature)/ &
                simulation%conduction%temperature_scale()
    if (.not. tolerance > 0) return
    call make_integrator('exponential', stepper%integrator, failure)
    if (allocated(failure)) return
    stepper%spectral_radius = simulation%stepper%spectral_radius
    stepper%longest_step = stepper%integrator%longest_stable_step(stepper%spectral_radius)
    stepper%tolerance = tolerance*simulation%conduction%temperature_scale()
    time = simulation%time
    u = simulation%temperature
    call stepper%propose_first(simulation%conduction, time, u)
    call stepper%advance_to(simulation%conduction, time, simulation%scene%time%end, u, failure)
    if (allocated(failure)) return
    if (stepper%integrator%evaluations >= choice%evaluations) return
    deviation = relative_difference(u, choice%temperature, simulation%cloud%volume)
    if (deviation > choice%error) return
    choice%method = 'exponential'
    choice%tolerance = tolerance
    choice%step = 0
    choice%error = exponential_part*choice%error + deviation
    choice%evaluations = stepper%integrator%evaluations
  end subroutine consider_exponential

  !> Halve the steps of one method until their error is allowed and shorter ones cost more: very
  !> long steps take many stages, and trials of them. Give up where a run that is not good enough
  !> takes more than `limit` evaluations.
  subroutine refine(simulation, method, allowed, limit, choice, error, truth, known_to)
    type(simulation_t), intent(inout) :: simulation
    character(len=*), intent(in) :: method
    real(wp), intent(in) :: allowed
    integer, intent(in) :: limit
    type(time_choice_t), intent(out) :: choice
    type(error_t), allocatable, intent(out) :: error
    real(wp), intent(in), optional :: truth(:)
    real(wp), intent(in), optional :: known_to
    type(stepper_t) :: coarse, fine
    real(wp), allocatable :: u_coarse(:), u_fine(:)
    real(wp) :: part, shorter, in_space, bound, error_coarse, error_fine
    integer :: order
    logical :: found

    part = 1
    found = .false.
    call run_pilot(simulation, method, part, coarse, u_coarse, error)
    if (allocated(error)) return
    order = coarse%integrator%order()
    associate (volume => simulation%cloud%volume)
      do
        ! Where stability bounds the steps, a smaller tolerance may change nothing at first.
        shorter = part
        do
          shorter = shorter/2
          call run_pilot(simulation, method, shorter, fine, u_fine, error)
          if (allocated(error)) return
          if (fine%steps >= least_ratio*coarse%steps .or. shorter < least_part) exit
        end do
        bound = margin*allowed
        if (present(truth)) then
          in_space = relative_difference(u_fine, truth, volume)
          if (present(known_to)) in_space = max(in_space, known_to)
          bound = bound*in_space
        end if
        bound = max(bound, least_error)
        ! Without shorter steps there is nothing to tell errors by.
        error_fine = huge(1.0_wp)
        if (fine%steps > coarse%steps) then
          error_fine = relative_difference(u_coarse, u_fine, volume)/ &
                       ((real(fine%steps, wp)/coarse%steps)**order - 1)
        end if
        error_coarse = relative_difference(u_coarse, u_fine, volume) + error_fine
        if (error_fine <= bound/2) then
          if (error_coarse <= bound) then
            call note(choice, method, part, coarse, error_coarse)
          else if (.not. found) then
            call tune(simulation, method, part, shorter, u_fine, bound, error_fine, order, &
                      choice, error)
            if (allocated(error)) return
          end if
          found = .true.
          if (fine%integrator%evaluations >= choice%evaluations) exit
        else if (coarse%integrator%evaluations > limit .and. &
                 fine%integrator%evaluations >= coarse%integrator%evaluations) then
          exit
        end if
        part = shorter
        u_coarse = u_fine
        coarse = fine
        if (part < least_part) exit
      end do
    end associate
    ! The best there is, where nothing is good enough
    if (.not. found) call note(choice, method, part, coarse, error_coarse)
    call move_alloc(u_fine, choice%temperature)
  end subroutine refine

  !> Find steps between longer and shorter ones, by the power of the steps with which errors go.
  subroutine tune(simulation, method, longer, shorter, u_fine, bound, error_fine, order, &
                  choice, error)
    type(simulation_t), intent(inout) :: simulation
    character(len=*), intent(in) :: method
    !> Both, as parts of the first ones
    real(wp), intent(in) :: longer, shorter
    !> What the shorter ones lead to, and the error of that
    real(wp), intent(in) :: u_fine(:), error_fine
    !> The error that is allowed
    real(wp), intent(in) :: bound
    integer, intent(in) :: order
    type(time_choice_t), intent(inout) :: choice
    type(error_t), allocatable, intent(out) :: error
    type(stepper_t) :: stepper
    real(wp), allocatable :: u(:)
    real(wp) :: tried, deviation
    integer :: trial

    tried = min(longer, shorter*(0.8_wp*bound/error_fine)**(1.0_wp/order))
    do trial = 1, 4
      call run_pilot(simulation, method, tried, stepper, u, error)
      if (allocated(error)) return
      deviation = relative_difference(u, u_fine, simulation%cloud%volume) + error_fine
      if (deviation <= bound) exit
      tried = max(shorter, 0.8_wp*tried)
    end do
    call note(choice, method, tried, stepper, deviation)
  end subroutine tune

  !> Choose what a pilot run was made with.
  subroutine note(choice, method, part, stepper, deviation)
    type(time_choice_t), intent(inout) :: choice
    character(len=*), intent(in) :: method
    real(wp), intent(in) :: part
    type(stepper_t), intent(in) :: stepper
    real(wp), intent(in) :: deviation

    choice%method = method
    choice%tolerance = 0
    choice%step = 0
    if (stepper%tolerance > 0) then
      choice%tolerance = first_tolerance*part**3
    else
      choice%step = stepper%longest_step
    end if
    choice%error = deviation
    choice%evaluations = stepper%integrator%evaluations
  end subroutine note

  !> Run to the end with steps that are a part of the first ones; the simulation stays at its start.
  subroutine run_pilot(simulation, method, part, stepper, u, error)
    type(simulation_t), intent(inout) :: simulation
    character(len=*), intent(in) :: method
    real(wp), intent(in) :: part
    type(stepper_t), intent(out) :: stepper
    real(wp), allocatable, intent(out) :: u(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: time

    time = simulation%time
    u = simulation%temperature
    stepper = simulation%stepper
    if (method /= simulation%scene%time%method) then
      call make_integrator(method, stepper%integrator, error)
      if (allocated(error)) return
      stepper%longest_step = runge_kutta_step(simulation)
      stepper%tolerance = 0
    end if
    if (stepper%tolerance > 0) then
      stepper%tolerance = stepper%tolerance*part**3
      call stepper%propose_first(simulation%conduction, time, u)
    else
      stepper%longest_step = stepper%longest_step*part
    end if
    call stepper%advance_to(simulation%conduction, time, simulation%scene%time%end, u, error)
  end subroutine run_pilot

  !> The step that a run with Runge–Kutta 4 takes where the scene gives none.
  function runge_kutta_step(simulation) result(step)
    type(simulation_t), intent(in) :: simulation
    real(wp) :: step
    type(stepper_t) :: stepper
    type(error_t), allocatable :: impossible

    call make_integrator('runge_kutta_4', stepper%integrator, impossible)
    step = 0.9_wp*stepper%integrator%longest_stable_step(simulation%stepper%spectral_radius)
    if (simulation%conduction%fastest_decay() > 0) then
      step = min(step, &
                 stepper%integrator%longest_monotone_step(simulation%conduction%fastest_decay()))
    end if
  end function runge_kutta_step

  !> How many evaluations a run with such steps takes.
  function runge_kutta_evaluations(simulation) result(evaluations)
    type(simulation_t), intent(in) :: simulation
    integer :: evaluations
    real(wp) :: steps

    steps = (simulation%scene%time%end - simulation%time)/runge_kutta_step(simulation)
    evaluations = huge(evaluations)
    if (steps < real(huge(evaluations)/8, wp)) evaluations = 4*ceiling(steps)
  end function runge_kutta_evaluations

  function is_adaptive(method) result(answer)
    character(len=*), intent(in) :: method
    logical :: answer
    type(stepper_t) :: stepper
    type(error_t), allocatable :: unknown

    call make_integrator(method, stepper%integrator, unknown)
    answer = .false.
    if (.not. allocated(unknown)) answer = stepper%integrator%estimates_error()
  end function is_adaptive

end module calor_time_choice
