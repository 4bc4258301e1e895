!> Reach a wanted error as cheaply as possible: `&accuracy target`.
!>
!> Two short pilot runs on a coarse cloud, of second and of fourth order, show what errors these
!> make there and what they cost. Errors go with the power of the spacing that a scheme's order
!> tells (or two runs of it show). What sixth and eighth order would make is foreseen from the
!> ratio of the pilots' errors: as the errors of orders 2 and 4 are like C (Δ/L)² and C (Δ/L)⁴, L
!> being the length over which the field varies, those of orders 6 and 8 are like C (Δ/L)⁶ and C
!> (Δ/L)⁸. (A pilot run of theirs would tell less: on a coarse cloud their stencils span the body.)
!> Costs go with the number of particles, of neighbours and of evaluations. The cheapest
!> combination foreseen is run with its error carried along; where the estimate is above the
!> target, what was learned goes into another choice.
module calor_accuracy_target
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t, raise, status_bad_input, status_bad_numbers
  use calor_exponential, only: exponential_terms, part_left
  use calor_integrators, only: make_integrator
  use calor_kinds, only: wp
  use calor_laplacian_schemes, only: usual_support
  use calor_scene, only: scene_t
  use calor_simulation, only: simulation_t, observer_t
  use calor_stepper, only: stepper_t
  use calor_sums, only: root_mean_square
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: target_search_t, search_watcher_t, attempt_t

  !> A scheme that the search may choose. The last three are rough figures for clouds that are
  !> even; they serve to compare methods that have not been tried.
  type :: method_t
    character(len=16) :: laplacian
    integer :: order
    !> Support radius in spacings; 0: the usual one
    real(wp) :: support
    !> The power of the spacing with which its error in the solution goes
    real(wp) :: power
    !> Work of a row, in units of that of the first method: it grows with the number of monomials
    real(wp) :: work
    !> Neighbours of a particle, and spectral radius times the spacing squared over the diffusivity
    real(wp) :: neighbours, stiffness
  end type method_t

  type(method_t), parameter :: methods(*) = [ &
      method_t('positive', 1, 1.5_wp, 2.0_wp, 1.0_wp, 6.0_wp, 10.0_wp), &
      method_t('consistent', 3, 0.0_wp, 4.0_wp, 4.0_wp, 25.0_wp, 12.0_wp), &
      method_t('consistent', 6, 0.0_wp, 6.0_wp, 24.0_wp, 55.0_wp, 30.0_wp), &
      method_t('consistent', 8, 0.0_wp, 8.0_wp, 60.0_wp, 95.0_wp, 60.0_wp)]
  !> The first ones make pilot runs, coarse as they are; what the others would do is foreseen
  integer, parameter :: pilots = 2

  !> A run of the search
  type :: attempt_t
    !> Position in the table of methods, and what that says
    integer :: method = 0
    character(len=:), allocatable :: scheme
    !> Spacing, m, and number of particles
    real(wp) :: spacing = 0.0_wp
    integer :: particles = 0
    !> Estimated relative L2 error at the end
    real(wp) :: estimate = huge(1.0_wp)
    !> Wall time before and of the steps, s, and evaluations of the Laplacian
    real(wp) :: setup_seconds = 0.0_wp, step_seconds = 0.0_wp
    !> The part of the former that depends on the scheme, s
    real(wp) :: scheme_seconds = 0.0_wp
    integer :: evaluations = 0, steps = 0
    !> Spectral radius, 1/s
    real(wp) :: spectral_radius = 0.0_wp
    !> Error allowed in each step, as a part of the range of temperatures; and the sum of what the
    !> steps made of it, as a part of the temperature at the end
    real(wp) :: tolerance = 0.0_wp, time_error = 0.0_wp
    !> Whether it steps by the exponential propagator
    logical :: exponential = .false.
    !> Whether it is a short run of which only figures are kept
    logical :: pilot = .true.
  end type attempt_t

  type :: target_search_t
    !> The relative L2 error to reach
    real(wp) :: target = 0.0_wp
    !> All runs so far
    type(attempt_t), allocatable :: attempts(:)
    !> The run that reached the target
    type(simulation_t) :: simulation
  contains
    !> Find a run that reaches the target, and make it
    procedure :: reach
    procedure, private :: try
    procedure, private :: has_cloud_of
    procedure, private :: reached
    procedure, private :: foresee
    procedure, private :: refine
    procedure, private :: introduce
    procedure, private :: set_tolerance
    procedure, private :: give_up
  end type target_search_t

  !> Is told of each run of a search; a program extends it to show progress
  type, abstract :: search_watcher_t
  contains
    procedure(attempted_interface), deferred :: attempted
  end type search_watcher_t

  abstract interface
    subroutine attempted_interface(this, attempt)
      import :: search_watcher_t, attempt_t
      implicit none (type, external)
      class(search_watcher_t), intent(inout) :: this
      type(attempt_t), intent(in) :: attempt
    end subroutine attempted_interface
  end interface

  !> Pilot runs have particles so many times farther apart than the scene says, and no run has them
  !> nearer than so many times
  real(wp), parameter :: coarsening = 4.0_wp, finest = 16.0_wp
  !> On fewer particles schemes hardly differ, so that their difference says nothing
  integer, parameter :: fewest_particles = 60
  !> Aim at this part of the target, and at that one where a method has not been tried
  real(wp), parameter :: aim = 0.6_wp, careful_aim = 0.3_wp
  !> Estimates of higher orders, whose own reference is of a higher order still, fall short by up to
  !> a third on clouds of some hundred particles: they must be below this part of the target
  real(wp), parameter :: trusted_part = 0.8_wp
  !> From one order to the next, in steps of two, errors on coarse clouds seldom fall further
  real(wp), parameter :: least_ratio = 0.05_wp
  !> The body must hold so many stencils of a method that has not been tried
  real(wp), parameter :: fewest_stencils = 4.0_wp
  !> So much of it may be the estimates of all steps together, which decay meanwhile
  real(wp), parameter :: share_of_time = 0.5_wp
  !> Spacings are not refined by more at a time than pilot runs can tell
  real(wp), parameter :: most_refinement = 6.0_wp
  !> So many full runs may miss the target
  integer, parameter :: most_runs = 6

contains

  subroutine reach(this, scene, error, watcher, observer)
    class(target_search_t), intent(out) :: this
    !> A scene with an accuracy target; its spacing says what detail matters: pilot runs are four
    !> times coarser, and the finest one sixteen times finer
    type(scene_t), intent(in) :: scene
    !> The target was not reached, and which limit was; or the scene cannot be run
    type(error_t), allocatable, intent(out) :: error
    !> Who is told of each run
    class(search_watcher_t), intent(inout), optional :: watcher
    !> Who is told of the states of full runs
    class(observer_t), intent(inout), optional :: observer
    type(attempt_t) :: next
    type(error_t), allocatable :: failure, first_failure
    real(wp) :: coarse, foreseen, trial
    integer :: method, full_run

    this%target = scene%accuracy%target
    allocate (this%attempts(0))
    coarse = coarsening*scene%domain%spacing
    if (scene%domain%shape == 'cloud') coarse = scene%domain%spacing
    do method = 1, pilots
      next = attempt_t(method=method, spacing=coarse, tolerance=first_tolerance(this%target))
      call this%try(scene, next, failure)
      do while ((allocated(failure) .or. next%particles < fewest_particles) .and. &
                scene%domain%shape /= 'cloud' .and. size(this%attempts) == 0 .and. &
                coarse > 2*scene%domain%spacing/finest)
        coarse = 0.5_wp*coarse
        next%spacing = coarse
        call this%try(scene, next, failure)
      end do
      if (allocated(failure)) then
        if (.not. allocated(first_failure)) call move_alloc(failure, first_failure)
        cycle
      end if
      this%attempts = [this%attempts, next]
      if (present(watcher)) call watcher%attempted(next)
      if (this%reached(next) .or. method == pilots) exit
      call this%foresee(scene, next, foreseen)
      associate (last => this%attempts(size(this%attempts)))
        ! What is tried has to be run as well before it pays.
        trial = last%setup_seconds + last%step_seconds + &
                last%scheme_seconds*(methods(method + 1)%work/methods(method)%work - 1)
        if (foreseen < 2*trial) exit
      end associate
    end do
    if (size(this%attempts) == 0) then
      call move_alloc(first_failure, error)
      return
    end if
    if (this%reached(next) .and. scene%output%file == '') then
      ! The last pilot run is the answer, once it has been searched for unstable modes.
      call this%simulation%search_growth(failure)
      if (.not. allocated(failure)) return
    end if
    do full_run = 1, most_runs
      call this%foresee(scene, next, foreseen)
      if (next%method == 0) then
        call this%give_up('No run has particles nearer than a sixteenth of &domain spacing: '// &
                          'lower that, or raise &accuracy target.', error)
        return
      end if
      next%pilot = .false.
      call this%try(scene, next, failure, observer)
      if (allocated(failure)) then
        if (failure%status /= status_bad_numbers) then
          call this%give_up(failure%message, error)
          error%status = failure%status
          return
        end if
        ! A scheme that does not bear this cloud is out.
        this%attempts = pack(this%attempts, this%attempts%method /= next%method)
        if (size(this%attempts) > 0) cycle
        call move_alloc(failure, error)
        return
      end if
      this%attempts = [this%attempts, next]
      if (present(watcher)) call watcher%attempted(next)
      if (this%reached(next)) return
      if (scene%domain%shape == 'cloud' .and. next%method == size(methods)) exit
    end do
    call this%give_up('After '//to_text(full_run - 1)//' runs it is not worth going on: raise '// &
                      '&accuracy target.', error)
  end subroutine reach

  !> Whether the error of a run is small enough.
  pure function reached(this, attempt) result(answer)
    class(target_search_t), intent(in) :: this
    type(attempt_t), intent(in) :: attempt
    logical :: answer

    if (attempt%method == 1) then
      answer = attempt%estimate <= this%target
    else
      answer = attempt%estimate <= trusted_part*this%target
    end if
  end function reached

  !> Say what was reached, and what stood in the way.
  subroutine give_up(this, obstacle, error)
    class(target_search_t), intent(in) :: this
    character(len=*), intent(in) :: obstacle
    type(error_t), allocatable, intent(out) :: error

    associate (best => this%attempts(minloc(this%attempts%estimate, dim=1)))
      call raise(error, status_bad_numbers, 'The target of '//to_text(this%target, digits=3)// &
                 ' for the relative error was not reached: the best estimate is '// &
                 to_text(best%estimate, digits=3)//', by '//best%scheme//' with particles '// &
                 to_text(best%spacing, digits=3)//' m apart.'//new_line('a')//obstacle)
    end associate
  end subroutine give_up

  !> Make one run.
  subroutine try(this, scene, attempt, error, observer)
    class(target_search_t), intent(inout) :: this
    type(scene_t), intent(in) :: scene
    type(attempt_t), intent(inout) :: attempt
    type(error_t), allocatable, intent(out) :: error
    class(observer_t), intent(inout), optional :: observer
    type(scene_t) :: variant
    type(cloud_t) :: cloud
    type(method_t) :: method
    real(wp) :: norm
    integer :: k

    variant = scene
    method = methods(attempt%method)
    variant%laplacian = trim(method%laplacian)
    variant%order = method%order
    variant%support = method%support
    if (.not. method%support > 0) variant%support = usual_support(variant%laplacian, method%order)
    attempt%scheme = trim(method%laplacian)
    if (method%laplacian == 'consistent') then
      attempt%scheme = attempt%scheme//' of order '//to_text(method%order)
    end if
    variant%domain%spacing = attempt%spacing
    variant%accuracy%estimate = .true.
    variant%time%without_trial = .true.
    if (.not. scene%time%step > 0) variant%time%tolerance = attempt%tolerance
    if (attempt%pilot) variant%output%file = ''
    if (this%has_cloud_of(variant)) then
      cloud = this%simulation%cloud
      call this%simulation%prepare(variant, error, uncertified=attempt%pilot, cloud=cloud)
    else
      call this%simulation%prepare(variant, error, uncertified=attempt%pilot)
    end if
    if (allocated(error)) return
    associate (simulation => this%simulation)
      attempt%particles = simulation%cloud%particles()
      attempt%spectral_radius = simulation%stepper%spectral_radius
      attempt%exponential = simulation%method == 'exponential'
      if (scene%time%method == 'auto' .and. simulation%method == 'rkl2' .and. &
          .not. (scene%time%step > 0 .or. scene%time%steady)) then
        call take_cheaper_steps(simulation, attempt%tolerance)
      end if
      call simulation%run(error, observer)
      if (allocated(error)) return
      attempt%estimate = simulation%estimated_error()
      attempt%steps = simulation%stepper%steps
      if (.not. scene%time%steady) then
        attempt%evaluations = simulation%stepper%integrator%evaluations
      end if
      norm = root_mean_square(simulation%temperature + simulation%error_estimate())
      attempt%time_error = simulation%stepper%accumulated_error/max(norm, tiny(1.0_wp))
      attempt%step_seconds = 0
      attempt%scheme_seconds = 0
      attempt%setup_seconds = simulation%stopwatch%total()
      do k = 1, size(simulation%stopwatch%phases)
        associate (phase => simulation%stopwatch%phases(k))
          if (phase%name == 'steps' .or. phase%name == 'steady state') then
            attempt%step_seconds = phase%seconds
          end if
          if (phase%name == 'assembly' .or. phase%name == 'error estimate') then
            attempt%scheme_seconds = attempt%scheme_seconds + phase%seconds
          end if
          if (phase%name == 'output') attempt%setup_seconds = attempt%setup_seconds - phase%seconds
        end associate
      end do
      attempt%setup_seconds = attempt%setup_seconds - attempt%step_seconds
    end associate
  end subroutine try

  !> Whether the last run was on the same cloud. Volumes of a cloud from a file may depend on the
  !> support radius; and what moves is elsewhere in the end.
  pure function has_cloud_of(this, scene) result(answer)
    class(target_search_t), intent(in) :: this
    type(scene_t), intent(in) :: scene
    logical :: answer

    answer = allocated(this%simulation%cloud%x) .and. scene%domain%shape /= 'cloud' .and. &
             .not. scene%motion%in_force
    if (answer) then
      answer = abs(scene%domain%spacing - this%simulation%scene%domain%spacing) <= &
               epsilon(1.0_wp)*scene%domain%spacing
    end if
  end function has_cloud_of

  !> Runge–Kutta 4, where its steps, bounded by stability, cost less than those of RKL2, bounded by
  !> the tolerance. Its own error is then far below that of any scheme in space.
  subroutine take_cheaper_steps(simulation, tolerance)
    type(simulation_t), intent(inout) :: simulation
    real(wp), intent(in) :: tolerance
    type(stepper_t) :: other
    type(error_t), allocatable :: impossible
    real(wp) :: step

    associate (stepper => simulation%stepper, end_time => simulation%scene%time%end)
      call make_integrator('runge_kutta_4', other%integrator, impossible)
      step = 0.9_wp*other%integrator%longest_stable_step(stepper%spectral_radius)
      if (4*end_time/step > rkl2_evaluations(stepper%spectral_radius*end_time, &
                                             likely_steps(tolerance))) return
      call move_alloc(other%integrator, stepper%integrator)
      stepper%tolerance = 0
      stepper%longest_step = step
      simulation%scene%time%method = 'runge_kutta_4'
    end associate
  end subroutine take_cheaper_steps

  !> Errors of steps that should add up to a part of the target: `likely_steps` of them, on a field
  !> that has decayed to a fifth.
  pure function first_tolerance(target) result(tolerance)
    real(wp), intent(in) :: target
    real(wp) :: tolerance

    tolerance = (0.2_wp*target)**1.5_wp
  end function first_tolerance

  !> Steps of second order that a smooth field needs from its start to its decay
  pure function likely_steps(tolerance) result(steps)
    real(wp), intent(in) :: tolerance
    real(wp) :: steps

    steps = max(8.0_wp, 1.5_wp*(0.055_wp/tolerance)**(1.0_wp/3))
  end function likely_steps

  !> Evaluations of so many steps of RKL2
  pure function rkl2_evaluations(decay, steps) result(evaluations)
    !> Spectral radius times the time to be simulated
    real(wp), intent(in) :: decay, steps
    real(wp) :: evaluations

    evaluations = steps*max(3.0_wp, sqrt(2*decay/steps))
  end function rkl2_evaluations

  !> The cheapest run that should reach the target, from the finest run of each method.
  subroutine foresee(this, scene, next, seconds)
    class(target_search_t), intent(in) :: this
    type(scene_t), intent(in) :: scene
    !> That run; its method is 0 if there is none
    type(attempt_t), intent(out) :: next
    !> The time that it should take, s
    real(wp), intent(out) :: seconds
    type(attempt_t) :: candidate
    real(wp) :: cost
    integer :: method, last

    seconds = huge(1.0_wp)
    do method = 1, size(methods)
      last = findloc(this%attempts%method, method, dim=1, back=.true.)
      if (last > 0) then
        call this%refine(scene, last, candidate, cost)
      else
        call this%introduce(scene, method, candidate, cost)
      end if
      if (cost < seconds) then
        seconds = cost
        next = candidate
      end if
    end do
  end subroutine foresee

  !> A method's finest run made finer.
  subroutine refine(this, scene, last, candidate, seconds)
    class(target_search_t), intent(in) :: this
    type(scene_t), intent(in) :: scene
    !> That run, a number among `attempts`
    integer, intent(in) :: last
    type(attempt_t), intent(out) :: candidate
    !> The time that it should take, s; huge(1.0) where it cannot be
    real(wp), intent(out) :: seconds
    real(wp) :: refinement, power
    integer :: before

    seconds = huge(1.0_wp)
    associate (known => this%attempts(last))
      power = methods(known%method)%power
      before = findloc(this%attempts(:last - 1)%method, known%method, dim=1, back=.true.)
      if (before > 0) then
        if (this%attempts(before)%spacing > 1.1_wp*known%spacing) then
          power = log(this%attempts(before)%estimate/known%estimate)/ &
                  log(this%attempts(before)%spacing/known%spacing)
          power = min(methods(known%method)%power + 1, max(1.0_wp, power))
        end if
      end if
      refinement = 1
      if (.not. this%reached(known)) then
        refinement = (known%estimate/(aim*this%target))**(1/power)
      end if
      if (scene%domain%shape == 'cloud') then
        if (refinement > 1 .and. any(this%attempts%estimate < known%estimate)) return
        refinement = 1
      end if
      candidate = known
      candidate%spacing = known%spacing/min(refinement, most_refinement)
      if (refinement > 1 .and. scene%domain%shape /= 'cloud') then
        ! What is as fine as can be, and not good enough, is out.
        if (known%spacing < 1.01_wp*scene%domain%spacing/finest) return
        candidate%spacing = max(candidate%spacing, scene%domain%spacing/finest)
      end if
      call this%set_tolerance(known, candidate)
      seconds = refinement**2*(known%setup_seconds + known%step_seconds* &
                               likely_evaluations(scene, candidate, &
                                                  known%spectral_radius*refinement**2)/ &
                               max(1, known%evaluations))
    end associate
  end subroutine refine

  !> A method that has not been tried, from what the pilot runs showed.
  subroutine introduce(this, scene, method, candidate, seconds)
    class(target_search_t), intent(in) :: this
    type(scene_t), intent(in) :: scene
    !> Its position in the table
    integer, intent(in) :: method
    type(attempt_t), intent(out) :: candidate
    !> The time that it should take, s; huge(1.0) where nothing can be foreseen
    real(wp), intent(out) :: seconds
    type(method_t) :: own, its
    real(wp) :: estimate, ratio, refinement, rest
    integer :: low, high

    seconds = huge(1.0_wp)
    low = findloc(this%attempts%method, 1, dim=1)
    high = findloc(this%attempts%method, pilots, dim=1)
    if (low == 0 .or. high == 0 .or. method <= pilots) return
    own = methods(method)
    its = methods(pilots)
    associate (second => this%attempts(low), fourth => this%attempts(high))
      ratio = max(fourth%estimate/max(second%estimate, tiny(1.0_wp)), least_ratio)
      estimate = fourth%estimate*ratio**((own%power - its%power)/2)
      refinement = (estimate/(careful_aim*this%target))**(1/own%power)
      refinement = max(refinement, sqrt(fewest_stencils*own%neighbours/fourth%particles))
      if (scene%domain%shape == 'cloud') refinement = 1
      candidate = fourth
      candidate%method = method
      candidate%spacing = max(fourth%spacing/min(refinement, most_refinement), &
                              scene%domain%spacing/finest)
      if (scene%domain%shape == 'cloud') candidate%spacing = fourth%spacing
      call this%set_tolerance(fourth, candidate)
      rest = fourth%setup_seconds - fourth%scheme_seconds
      seconds = refinement**2*(rest + fourth%scheme_seconds*own%work/its%work + &
                               fourth%step_seconds*own%neighbours/its%neighbours* &
                               likely_evaluations(scene, candidate, fourth%spectral_radius* &
                                                  own%stiffness/its%stiffness*refinement**2)/ &
                               max(1, fourth%evaluations))
    end associate
  end subroutine introduce

  !> The error that each step of a run may make, so that all make no more than their share.
  subroutine set_tolerance(this, known, candidate)
    class(target_search_t), intent(in) :: this
    !> A run that was made
    type(attempt_t), intent(in) :: known
    !> One that is like it
    type(attempt_t), intent(inout) :: candidate

    if (.not. known%time_error > 0) return
    candidate%tolerance = known%tolerance*min(1.0_wp, share_of_time*this%target/ &
                                              known%time_error)**1.5_wp
  end subroutine set_tolerance

  !> Evaluations that a run needs, by the exponential propagator or by the cheaper of two others.
  function likely_evaluations(scene, candidate, spectral_radius) result(evaluations)
    type(scene_t), intent(in) :: scene
    type(attempt_t), intent(in) :: candidate
    !> 1/s
    real(wp), intent(in) :: spectral_radius
    real(wp) :: evaluations
    real(wp) :: decay

    decay = spectral_radius*scene%time%end
    if (candidate%exponential) then
      evaluations = exponential_terms(decay, part_left*candidate%tolerance, 0.0_wp)
      return
    end if
    evaluations = min(4*decay/2.5_wp, rkl2_evaluations(decay, likely_steps(candidate%tolerance)))
  end function likely_evaluations

end module calor_accuracy_target
