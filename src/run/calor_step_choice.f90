!> The integrator of a scene and the lengths of its steps, on one process or on several.
module calor_step_choice
  use calor_conduction, only: conduction_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_integrator, only: integrator_t
  use calor_integrators, only: make_integrator
  use calor_kinds, only: wp
  use calor_method_choice, only: method_choice_t, problem_t, foresee_costs
  use calor_scene, only: scene_t
  use calor_spectral_radius, only: estimate_spectral_radius
  use calor_stepper, only: stepper_t
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: step_choice_t, find_step_limits, make_usual_integrator, states_after_start
  public :: safe_part, default_tolerance

  !> Part of the stability limit that the program chooses as step
  real(wp), parameter :: safe_part = 0.9_wp
  !> Error that a step may make where the scene does not say
  real(wp), parameter :: default_tolerance = 1.0e-6_wp
  !> Beyond so many steps of forward Euler a time cannot be stepped to
  real(wp), parameter :: most_euler_steps = 1.0e15_wp
  !> What is less than that part of a rate is left over by rounding
  real(wp), parameter :: rounding = 1.0e-9_wp

  !> What is known of the rows, and what follows from it
  type :: step_choice_t
    !> Rows, and entries beside the diagonal, of all processes, and operators of expressions in a
    !> rate
    real(wp) :: rows = 0.0_wp, entries = 0.0_wp, operations = 0.0_wp
    !> As `conduction%fastest_decay()` had it, the growth rate of the rightmost mode, and
    !> the slowest decay of any that decays, 1/s; 0: not known
    real(wp) :: fastest_decay = 0.0_wp, growth_rate = 0.0_wp, slowest_decay = 0.0_wp
    !> The method, and why; that is not allocated where the scene names it
    character(len=:), allocatable :: method
    type(method_choice_t), allocatable :: choice
    !> The longest stable step, and the longest after which no temperature leaves the range of those
    !> before, s; 0: no such promise
    real(wp) :: stability_limit = 0.0_wp, monotone_limit = 0.0_wp
  contains
    !> Choose, and prepare the stepper
    procedure :: choose
    procedure, private :: choose_method
  end type step_choice_t

  abstract interface
    !> Makes the integrator of a name.
    subroutine maker_interface(name, conduction, integrator, error)
      import :: conduction_t, integrator_t, error_t
      implicit none (type, external)
      !> One of the names in `integrator_choices`
      character(len=*), intent(in) :: name
      !> What it is to integrate; it stays where it is
      class(conduction_t), intent(in), target :: conduction
      class(integrator_t), allocatable, intent(out) :: integrator
      !> There is none of that name
      type(error_t), allocatable, intent(out) :: error
    end subroutine maker_interface
  end interface

contains

  !> That of one process.
  subroutine make_usual_integrator(name, conduction, integrator, error)
    character(len=*), intent(in) :: name
    class(conduction_t), intent(in), target :: conduction
    class(integrator_t), allocatable, intent(out) :: integrator
    type(error_t), allocatable, intent(out) :: error

    associate (unused => conduction)
    end associate
    call make_integrator(name, integrator, error)
  end subroutine make_usual_integrator

  !> How many states are written after the first
  pure function states_after_start(scene) result(states)
    type(scene_t), intent(in) :: scene
    integer :: states

    states = 1
    if (scene%time%steady) states = 0
    if (scene%output%every > 0) then
      states = max(1, ceiling(scene%time%end/scene%output%every*(1 - 1.0e-12_wp)))
    end if
  end function states_after_start

  !> Find the spectral radius, which limits steps.
  subroutine find_step_limits(scene, bound, conduction, spectral_radius, error)
    type(scene_t), intent(in) :: scene
    !> A bound of the spectral radius, 1/s
    real(wp), intent(in) :: bound
    class(conduction_t), intent(inout) :: conduction
    !> 1/s
    real(wp), intent(out) :: spectral_radius
    !> The end is out of reach
    type(error_t), allocatable, intent(out) :: error

    associate (time => scene%time)
      spectral_radius = 0
      if (bound > most_euler_steps/time%end) then
        call raise(error, status_bad_input, time%place//': end = '//to_text(time%end)// &
                   ' s cannot be stepped to: heat crosses a particle spacing in about '// &
                   to_text(1/bound, digits=2)//' s. Lower end, or look at &material.')
        return
      end if
      spectral_radius = estimate_spectral_radius(conduction, bound)
      spectral_radius = max(spectral_radius, 1.0e-6_wp/time%end)
    end associate
  end subroutine find_step_limits

  !> Take the cheapest method.
  subroutine choose_method(this, scene, conduction, temperature, state, make, tolerance, stepper, &
                           error)
    class(step_choice_t), intent(inout) :: this
    type(scene_t), intent(in) :: scene
    class(conduction_t), intent(inout), target :: conduction
    real(wp), intent(in), contiguous :: temperature(:), state(:)
    procedure(maker_interface) :: make
    !> Error that a step may make, K
    real(wp), intent(in) :: tolerance
    type(stepper_t), intent(inout) :: stepper
    type(error_t), allocatable, intent(out) :: error
    type(problem_t) :: problem
    type(stepper_t) :: trial
    real(wp), allocatable :: rate(:)

    trial = stepper
    trial%tolerance = tolerance
    trial%longest_step = trial%integrator%longest_stable_step(trial%spectral_radius)
    problem%rows = this%rows
    problem%entries = this%entries
    problem%operations = this%operations
    problem%spectral_radius = trial%spectral_radius
    problem%duration = scene%time%end
    problem%parts = states_after_start(scene)
    problem%tolerance = tolerance
    ! Where a mode grows, one long step would end beyond the last good state.
    problem%linear = conduction%is_linear() .and. .not. conduction%depends_on_time() .and. &
                     .not. this%growth_rate > rounding*trial%spectral_radius
    problem%implicit = .not. allocated(conduction%content)
    problem%reacting = .not. conduction%is_linear()
    problem%changing = conduction%depends_on_time()
    if (problem%linear) then
      ! Only a decay that was found is known.
      problem%slowest = max(0.0_wp, -this%growth_rate)
      allocate (rate(size(temperature)))
      call conduction%rate(0.0_wp, temperature, rate)
      problem%scale = max(tiny(1.0_wp)**0.25_wp, problem%duration* &
                          conduction%root_mean_square(rate))
      call find_decay()
    else
      call trial%propose_first(conduction, 0.0_wp, state)
    end if
    allocate (this%choice)
    if (problem%linear .or. problem%implicit) then
      call foresee_costs(problem, conduction, trial, state, this%choice)
    else
      this%choice%method = 'rkl2'
      allocate (this%choice%costs(0))
    end if
    this%method = this%choice%method
    call make(this%method, conduction, stepper%integrator, error)

  contains

    !> How the rate decays: where a uniform temperature stays, as no wall is held, only where
    !> nothing heats for ever; where effects go with the temperature, the modes of conduction do not
    !> tell.
    subroutine find_decay()
      real(wp), allocatable :: product(:)

      if (allocated(conduction%slope) .or. .not. this%slowest_decay > 0) return
      if (.not. this%growth_rate <= -this%slowest_decay) then
        ! F(u) = A u + b
        allocate (product(size(temperature)))
        call conduction%jacobian_product(temperature, product)
        call conduction%clear_prescribed(rate)
        if (.not. conduction%root_mean_square(rate - product) <= &
            rounding*conduction%root_mean_square(rate)) return
      end if
      problem%slowest = this%slowest_decay
      problem%range = conduction%temperature_scale()
    end subroutine find_decay
  end subroutine choose_method

  !> Choose the integrator and its steps.
  subroutine choose(this, scene, conduction, temperature, state, make, stepper, error)
    class(step_choice_t), intent(inout) :: this
    type(scene_t), intent(in) :: scene
    !> The heat equation
    class(conduction_t), intent(inout), target :: conduction
    !> Temperatures at the start, and the unknowns
    real(wp), intent(in), contiguous :: temperature(:), state(:)
    !> What makes an integrator
    procedure(maker_interface) :: make
    !> Its spectral radius is known
    type(stepper_t), intent(inout) :: stepper
    !> The scene's method or step cannot be used
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: work(:)
    real(wp) :: scale, step, tolerance

    associate (time => scene%time)
      this%method = time%method
      if (this%method == 'auto') then
        this%method = 'rkl2'
        if (time%without_trial .and. conduction%is_linear() .and. &
            .not. conduction%depends_on_time() .and. .not. scene%motion%in_force .and. &
            .not. time%step > 0) this%method = 'exponential'
      end if
      call make(this%method, conduction, stepper%integrator, error)
      if (allocated(error)) return
      scale = conduction%temperature_scale()
      tolerance = default_tolerance*scale
      if (time%tolerance > 0) tolerance = time%tolerance*scale
      ! Rows that change with the motion would have to be factorised anew each time.
      if (time%method == 'auto' .and. .not. (time%step > 0 .or. time%only_rkl2 .or. &
                                             time%without_trial .or. scene%motion%in_force)) then
        call this%choose_method(scene, conduction, temperature, state, make, tolerance, stepper, &
                                error)
        if (allocated(error)) return
      end if
      if (this%method == 'exponential' .and. (conduction%depends_on_time() .or. &
                                              .not. conduction%is_linear())) then
        call raise(error, status_bad_input, time%place//': method = ''exponential'' integrates '// &
                   'linear problems that do not change with time, and in this scene a wall or '// &
                   'effect depends on the time, or on the temperature not linearly: take '// &
                   '''auto'', ''rkl2'' or ''tr_bdf2''.')
        return
      end if
      if (scene%motion%in_force .and. &
          (this%method == 'tr_bdf2' .or. this%method == 'exponential')) then
        call raise(error, status_bad_input, time%place//': method = '''//this%method//''' does '// &
                   'not take particles that move, whose rows change at every step: take '// &
                   '''auto'' or ''rkl2''.')
        return
      end if
      if (this%method == 'tr_bdf2' .and. allocated(conduction%content)) then
        call raise(error, status_bad_input, time%place//': method = ''tr_bdf2'' does not take '// &
                   'latent heat or materials that depend on the temperature: take ''auto'' or '// &
                   '''rkl2''.')
        return
      end if
      this%stability_limit = stepper%integrator%longest_stable_step(stepper%spectral_radius)
      if (this%fastest_decay > 0) then
        this%monotone_limit = &
          stepper%integrator%longest_monotone_step(this%fastest_decay)
      end if
      if (time%step > 0) then
        step = time%step
        allocate (work(conduction%unknowns()))
        call stepper%integrator%shorten_step(conduction, stepper%spectral_radius, step, work)
        deallocate (work)
        if (step < time%step) this%stability_limit = min(this%stability_limit, step)
        if (time%step > this%stability_limit) then
          call raise(error, status_bad_input, time%place//': step = '//to_text(time%step)// &
                     ' s is beyond the stability limit of '//time%method//' on this cloud, '// &
                     to_text(this%stability_limit, digits=4)//' s: take a smaller step, or '// &
                     'leave step out and let the program choose.')
          return
        end if
        stepper%longest_step = time%step
      else if (stepper%integrator%estimates_error()) then
        stepper%longest_step = this%stability_limit
        stepper%tolerance = tolerance
        call stepper%propose_first(conduction, 0.0_wp, state)
      else
        if (time%tolerance > 0) then
          call raise(error, status_bad_input, time%place//': tolerance: '//trim(time%method)// &
                     ' does not estimate its error. Leave tolerance out, or take method = '// &
                     '''auto'', ''rkl2'', ''tr_bdf2'' or ''exponential''.')
          return
        end if
        stepper%longest_step = safe_part*this%stability_limit
        if (this%monotone_limit > 0) then
          stepper%longest_step = min(stepper%longest_step, this%monotone_limit)
        end if
      end if
      if (stepper%longest_step < time%end/huge(1)) then
        call raise(error, status_bad_input, time%place//': steps of at most '// &
                   to_text(stepper%longest_step, digits=3)//' s to end = '//to_text(time%end)// &
                   ' s would be more than can be counted: lower end.')
      end if
    end associate
  end subroutine choose

end module calor_step_choice
