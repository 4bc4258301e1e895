!> From one time to another: which steps are taken.
module calor_stepper
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_constants, only: worth_threads
  use calor_error, only: error_t, raise, status_bad_numbers
  use calor_evolution, only: evolution_t
  use calor_integrator, only: integrator_t
  use calor_interrupt, only: interrupted, interrupt_status
  use calor_kinds, only: wp
  use calor_saved_state, only: saved_state_t
  use calor_step_listener, only: step_listener_t
  use calor_step_watcher, only: step_watcher_t
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: stepper_t

  !> An integrator and the length of its steps
  type :: stepper_t
    !> The method
    class(integrator_t), allocatable :: integrator
    !> Spectral radius of the Jacobian, 1/s
    real(wp) :: spectral_radius = 0.0_wp
    !> The longest step to take, s: the user's own, or a safe part of the stability limit
    real(wp) :: longest_step = 0.0_wp
    !> The error that a step may make, root mean square; 0: all steps are as long as `longest_step`
    real(wp) :: tolerance = 0.0_wp
    !> Steps taken, and steps taken back because their error was too large
    integer :: steps = 0, rejected = 0
    !> The sum of the estimated errors of all steps
    real(wp) :: accumulated_error = 0.0_wp
    !> Whether the last step ended in numbers
    logical, private :: finite = .true.
    !> The step that the error control would take next, s; 0 before the first
    real(wp), private :: proposed = 0.0_wp, first = 0.0_wp
    real(wp), allocatable, private :: u_next(:)
    !> Steps of equal length: their number in the interval under way and how many are done, its ends
    !> and what they have come to, s
    integer, private :: parts = 0, parts_done = 0
    real(wp), private :: parts_start = 0.0_wp, parts_end = 0.0_wp, parts_time = 0.0_wp
    !> Whether the listener asks for a pause
    logical, private :: rest = .false.
    !> Whether an interrupt ends the integration after a step
    logical :: interruptible = .true.
    !> Who hears of each step
    class(step_listener_t), pointer :: listener => null()
  contains
    !> Integrate from one time to another
    procedure :: advance_to
    !> Find the length of the first step under error control; `advance_to` does it where need be
    procedure :: propose_first
    !> That length, s; 0 before it was found
    procedure :: first_proposal
    !> The length of the step that would come next, s
    procedure :: next_proposal
    !> Lay aside what the next steps depend on, and take it up again; the method is the same then
    procedure :: save => save_stepper
    procedure :: restore => restore_stepper
    procedure, private :: advance_equally
    procedure, private :: try_step
  end type stepper_t

contains

  !> Integrate; the last step ends exactly at `end_time`. Where the listener asks for a pause,
  !> `time` is less than that: a further call with the same end goes on as if there had been none.
  subroutine advance_to(this, evolution, time, end_time, u, error, at_most, watcher)
    class(stepper_t), intent(inout) :: this
    !> What is integrated
    class(evolution_t), intent(inout), target :: evolution
    !> Time, s: that of the state u before and after
    real(wp), intent(inout) :: time
    !> Time to reach, s, not before `time`
    real(wp), intent(in) :: end_time
    !> The state; where there is an error, the last good one
    real(wp), intent(inout), contiguous :: u(:)
    !> The numbers went wrong
    type(error_t), allocatable, intent(out) :: error
    !> Under error control: stop after so many steps, wherever that is
    integer, intent(in), optional :: at_most
    !> Who is told of each step
    class(step_watcher_t), intent(inout), optional :: watcher
    real(wp) :: step
    integer :: last

    this%integrator%tolerance = this%tolerance
    this%rest = .false.
    if (.not. allocated(this%u_next)) allocate (this%u_next(size(u)))
    if (.not. this%tolerance > 0) then
      call this%advance_equally(evolution, time, end_time, u, error, watcher)
      return
    end if
    if (.not. this%proposed > 0) call this%propose_first(evolution, time, u)
    last = huge(last)
    if (present(at_most)) last = this%steps + at_most
    do while (time < end_time .and. this%steps < last)
      step = min(this%proposed, this%longest_step)
      if (present(watcher)) step = min(step, watcher%longest_step())
      call this%integrator%shorten_step(evolution, this%spectral_radius, step, this%u_next)
      ! Beyond time 0 any step that is too short is lost in the time; at 0 it has to be said.
      if (.not. time + step > time .or. step < epsilon(step)**2*(end_time - time)) then
        if (allocated(this%integrator%failure)) then
          call raise(error, status_bad_numbers, 'At t = '//to_text(time, digits=6)// &
                     ' s no step is short enough: '//this%integrator%failure// &
                     '. Take &time method = ''rkl2''.')
        else if (this%finite) then
          call raise(error, status_bad_numbers, 'The time step fell to '// &
                     to_text(step, digits=3)//' s at t = '//to_text(time, digits=6)// &
                     ' s without meeting the tolerance: raise &time tolerance.')
        else
          call raise(error, status_bad_numbers, 'Beyond t = '//to_text(time, digits=6)// &
                     ' s the temperatures are no numbers any more, however short the step. '// &
                     'Does an expression of the scene have a value at later times?')
        end if
        return
      end if
      ! Steps of equal length to the end, rather than a tiny last one
      step = (end_time - time)/max(1.0_wp, aint((end_time - time)/step + 0.9999_wp))
      call this%try_step(evolution, time, step, u, error, watcher)
      if (abs(end_time - time) <= 4*spacing(end_time)) time = end_time
      if (allocated(error) .or. this%rest) return
    end do
  end subroutine advance_to

  !> Integrate by steps of equal length.
  subroutine advance_equally(this, evolution, time, end_time, u, error, watcher)
    class(stepper_t), intent(inout) :: this
    class(evolution_t), intent(inout), target :: evolution
    real(wp), intent(inout) :: time
    real(wp), intent(in) :: end_time
    real(wp), intent(inout), contiguous :: u(:)
    type(error_t), allocatable, intent(out) :: error
    class(step_watcher_t), intent(inout), optional :: watcher
    real(wp) :: step

    ! An interval that was left for a pause goes on.
    if (this%parts_done >= this%parts .or. abs(end_time - this%parts_end) > 0 .or. &
        abs(time - this%parts_time) > 0) then
      this%parts_start = time
      this%parts_end = end_time
      this%parts = max(1, ceiling((end_time - time)/this%longest_step*(1 - 1.0e-12_wp)))
      this%parts_done = 0
    end if
    do while (this%parts_done < this%parts)
      ! Each time is computed from the start, so that rounding does not add up.
      step = (this%parts_start + (end_time - this%parts_start)*(this%parts_done + 1)/this%parts) - &
             time
      this%parts_time = time
      call this%try_step(evolution, time, step, u, error, watcher)
      if (time > this%parts_time) this%parts_done = this%parts_done + 1
      if (this%parts_done == this%parts) time = end_time
      this%parts_time = time
      if (allocated(error) .or. this%rest) return
    end do
  end subroutine advance_equally

  !> One step; with error control it may be taken back, so that nothing but the next step's length
  !> has changed.
  subroutine try_step(this, evolution, time, step, u, error, watcher)
    class(stepper_t), intent(inout) :: this
    class(evolution_t), intent(inout), target :: evolution
    real(wp), intent(inout) :: time
    real(wp), intent(in) :: step
    real(wp), intent(inout), contiguous :: u(:)
    type(error_t), allocatable, intent(out) :: error
    class(step_watcher_t), intent(inout), optional :: watcher
    real(wp) :: local_error
    integer :: k

    call this%integrator%advance(evolution, time, step, this%spectral_radius, u, this%u_next, &
                                 local_error)
    if (this%tolerance > 0) then
      this%finite = ieee_is_finite(local_error)
      if (.not. this%finite) local_error = huge(local_error)
      this%proposed = this%integrator%next_step(step, local_error)
      if (local_error > this%tolerance) then
        this%rejected = this%rejected + 1
        return
      end if
    else if (allocated(this%integrator%failure)) then
      call raise(error, status_bad_numbers, 'At t = '//to_text(time, digits=6)//' s: '// &
                 this%integrator%failure//'. Take a shorter &time step.')
      return
    end if
    call evolution%inspect(time + step, this%u_next, error)
    if (allocated(error)) return
    call this%integrator%accept()
    !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(u)
      u(k) = this%u_next(k)
    end do
    !$omp end parallel do
    time = time + step
    this%steps = this%steps + 1
    this%accumulated_error = this%accumulated_error + local_error
    if (associated(this%listener)) then
      call this%listener%at_step(time, this%steps, this%accumulated_error, this%rest)
    end if
    if (present(watcher)) then
      call watcher%stepped(evolution, this%integrator, time, step, u, error)
    end if
    if (.not. allocated(error) .and. this%interruptible .and. interrupted()) then
      call raise(error, interrupt_status(), 'Interrupted at t = '//to_text(time, digits=6)//' s.')
    end if
  end subroutine try_step

  !> A small trial step shows the error of a step; the first is half of what the tolerance allows.
  subroutine propose_first(this, evolution, time, u)
    class(stepper_t), intent(inout) :: this
    class(evolution_t), intent(inout), target :: evolution
    !> Time, s
    real(wp), intent(in) :: time
    !> State at that time
    real(wp), intent(in), contiguous :: u(:)
    real(wp) :: local_error

    if (.not. allocated(this%u_next)) allocate (this%u_next(size(u)))
    this%integrator%tolerance = this%tolerance
    this%proposed = this%longest_step
    this%first = this%proposed
    if (.not. this%integrator%wants_trial()) return
    this%proposed = min(this%longest_step, 2/this%spectral_radius)
    call this%integrator%advance(evolution, time, this%proposed, this%spectral_radius, u, &
                                 this%u_next, local_error)
    if (local_error > 0 .and. local_error <= huge(local_error)) then
      this%proposed = this%proposed*min(100.0_wp, 0.5_wp*(this%tolerance/local_error)**(1.0_wp/3))
    end if
    this%first = this%proposed
  end subroutine propose_first

  pure function first_proposal(this) result(step)
    class(stepper_t), intent(in) :: this
    real(wp) :: step

    step = this%first
  end function first_proposal

  pure function next_proposal(this) result(step)
    class(stepper_t), intent(in) :: this
    real(wp) :: step

    step = min(this%proposed, this%longest_step)
  end function next_proposal

  subroutine save_stepper(this, state)
    class(stepper_t), intent(in) :: this
    type(saved_state_t), intent(inout) :: state

    call state%enter('stepper')
    call state%put('spectral_radius', this%spectral_radius)
    call state%put('longest_step', this%longest_step)
    call state%put('tolerance', this%tolerance)
    call state%put('steps', this%steps)
    call state%put('rejected', this%rejected)
    call state%put('accumulated_error', this%accumulated_error)
    call state%put('finite', this%finite)
    call state%put('proposed', this%proposed)
    call state%put('first', this%first)
    call state%put('parts', [this%parts, this%parts_done])
    call state%put('parts_time', [this%parts_start, this%parts_end, this%parts_time])
    call this%integrator%save(state)
    call state%leave()
  end subroutine save_stepper

  subroutine restore_stepper(this, state)
    class(stepper_t), intent(inout) :: this
    type(saved_state_t), intent(inout) :: state
    integer, allocatable :: parts(:)
    real(wp), allocatable :: times(:)

    call state%enter('stepper')
    call state%get('spectral_radius', this%spectral_radius)
    call state%get('longest_step', this%longest_step)
    call state%get('tolerance', this%tolerance)
    call state%get('steps', this%steps)
    call state%get('rejected', this%rejected)
    call state%get('accumulated_error', this%accumulated_error)
    call state%get('finite', this%finite)
    call state%get('proposed', this%proposed)
    call state%get('first', this%first)
    call state%get('parts', parts)
    call state%get('parts_time', times)
    if (allocated(parts) .and. allocated(times)) then
      this%parts = parts(1)
      this%parts_done = parts(2)
      this%parts_start = times(1)
      this%parts_end = times(2)
      this%parts_time = times(3)
    end if
    this%integrator%tolerance = this%tolerance
    call this%integrator%restore(state)
    call state%leave()
  end subroutine restore_stepper

end module calor_stepper
