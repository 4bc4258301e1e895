!> The error of a computed solution, carried along beside it.
!>
!> Let u_t = F(u) be what is integrated, and F_p a discretisation of the same problem of higher
!> order, stable as well. The true solution U then obeys U_t = F_p(U) but for what F_p itself
!> misses, and the error e = U - u
!>
!>     e_t = F_p'(u) e + τ,   τ = F_p(u) - F(u),
!>
!> to first order in e. (F' instead of F_p' would do where e is smooth; but schemes of low degree
!> make errors that vary from particle to particle, and F and F_p differ on these by as much as they
!> have to decay.) Each step of the integrator adds its own estimated error. So e holds the errors
!> of space and of time, each where it has been carried and damped to, and u + e is a better
!> solution than u.
!>
!> e varies as slowly as the solution does, not as its steps are short: it is advanced over
!> intervals of many steps, within which τ is taken as linear in time.
!>
!> Where F and F_p are linear and do not change with time, U itself is found: w = U - u_0 obeys
!> w_t = F_p' w + F_p(u_0), w(0) = e(0), u_0 being the solution at the start of an interval, and e
!> is u_0 + w - u at its end. The exponential propagator carries w over intervals of any length.
module calor_error_transport
  use calor_constants, only: worth_threads
  use calor_error, only: error_t
  use calor_evolution, only: evolution_t
  use calor_exponential, only: exponential_t
  use calor_integrator, only: integrator_t
  use calor_kinds, only: wp
  use calor_rkl2, only: rkl2_t
  use calor_saved_state, only: saved_state_t
  use calor_step_watcher, only: step_watcher_t
  use calor_stepper, only: stepper_t
  use calor_stopwatch, only: stopwatch_t
  use calor_sums, only: root_mean_square
  implicit none (type, external)
  private

  public :: error_transport_t

  !> Over an interval τ may change by this part of itself: a straight line then misses about 1 %
  real(wp), parameter :: largest_change = 0.3_wp
  !> Integrating e may add errors of this part of it in each step
  real(wp), parameter :: relative_tolerance = 3.0e-3_wp

  !> e_t = F_p'(u) e + start + (t - t_0) slope
  type, extends(evolution_t) :: linear_evolution_t
    !> Supplies F_p'
    class(evolution_t), pointer :: base => null()
    real(wp) :: time = 0.0_wp
    real(wp), allocatable :: start(:), slope(:)
  contains
    procedure :: unknowns
    procedure :: rate
    procedure :: jacobian_product
    procedure :: impose
    procedure :: clear_prescribed
    procedure :: inspect
    procedure :: is_linear
    procedure :: depends_on_time
  end type linear_evolution_t

  type, extends(step_watcher_t) :: error_transport_t
    !> The same problem, discretised with a higher order
    class(evolution_t), allocatable :: reference
    !> e at `time`: the true solution less the computed one
    real(wp), allocatable :: error(:)
    !> The time that e belongs to, s; catch_up makes it that of the solution
    real(wp) :: time = 0.0_wp
    !> Evaluations of F_p and F_p' so far
    integer :: evaluations = 0
    !> What all this took
    type(stopwatch_t) :: stopwatch
    !> τ at `time`, and the sum of the errors of the steps since
    real(wp), allocatable, private :: defect(:), step_errors(:)
    !> Whether e is the difference to the true solution, and the solution at `time` then
    logical, private :: by_difference = .false.
    real(wp), allocatable, private :: solution(:)
    !> A further part of τ: its mean over a step of the motion, its slope, and the middle, s
    real(wp), allocatable, private :: further_mean(:), further_slope(:)
    real(wp), private :: further_middle = 0.0_wp
    !> How far e is advanced at a time, s; 0: as far as the first step
    real(wp), private :: interval = 0.0_wp
    !> The first step must not be longer, s
    real(wp), private :: first = 0.0_wp
    type(stepper_t), private :: stepper
    type(linear_evolution_t), private :: transport
  contains
    !> Make ready at the beginning of an integration
    procedure :: begin
    procedure :: stepped
    procedure :: longest_step
    !> Bring e up to the time of the solution
    procedure :: catch_up
    !> Lay aside what the error's further way depends on, and take it up again
    procedure :: save => save_transport
    procedure :: restore => restore_transport
    !> Note that both discretisations have become other ones
    procedure :: renew
    !> Take a further source of error into account
    procedure :: add_source
    procedure, private :: choose_way
    procedure, private :: carry_error
    procedure, private :: carry_difference
    procedure, private :: measure_defect
    procedure, private :: foresee_change
  end type error_transport_t

contains

  subroutine begin(this, evolution, reference, time, u, spectral_radius, tolerance)
    class(error_transport_t), intent(out) :: this
    !> What will be integrated
    class(evolution_t), intent(inout) :: evolution
    !> The same with a higher order
    class(evolution_t), intent(in) :: reference
    !> Time, s, and state; its error is 0
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    !> Spectral radius of F_p', 1/s, on the safe side
    real(wp), intent(in) :: spectral_radius
    !> Both are linear and do not change with time: find the true solution by the exponential
    !> propagator, steps of which may make so much of an error. 0: what rounding leaves
    real(wp), intent(in), optional :: tolerance

    call this%stopwatch%start('error estimate')
    allocate (this%reference, source=reference)
    allocate (this%error(size(u)), source=0.0_wp)
    this%time = time
    this%stepper%spectral_radius = spectral_radius
    if (present(tolerance)) this%stepper%tolerance = tolerance
    call this%choose_way(present(tolerance), u)
    if (this%by_difference) then
      call this%stopwatch%stop()
      return
    end if
    call this%measure_defect(evolution, time, u, this%defect)
    call this%foresee_change(evolution, time, u, spectral_radius)
    call this%stopwatch%stop()
  end subroutine begin

  !> Make ready to carry e in one way or the other.
  subroutine choose_way(this, by_difference, u)
    class(error_transport_t), intent(inout) :: this
    logical, intent(in) :: by_difference
    !> The solution
    real(wp), intent(in) :: u(:)

    this%by_difference = by_difference
    this%transport%start = 0*u
    if (by_difference) then
      this%solution = u
      allocate (exponential_t :: this%stepper%integrator)
    else
      this%step_errors = this%transport%start
      this%defect = this%transport%start
      this%transport%slope = this%transport%start
      allocate (rkl2_t :: this%stepper%integrator)
    end if
    ! A step of the solution is not over before its error has been brought up to it.
    this%stepper%interruptible = .false.
    this%stepper%longest_step = &
      this%stepper%integrator%longest_stable_step(this%stepper%spectral_radius)
  end subroutine choose_way

  !> How long τ will take to change: it follows u, and u follows its rate.
  subroutine foresee_change(this, evolution, time, u, spectral_radius)
    class(error_transport_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: time, spectral_radius
    real(wp), intent(in), contiguous :: u(:)
    real(wp), allocatable :: later(:), change(:)
    real(wp) :: part

    allocate (later(size(u)), change(size(u)))
    call evolution%rate(time, u, later)
    later = u + later/spectral_radius
    call this%measure_defect(evolution, time, later, change)
    part = spectral_radius*root_mean_square(change - this%defect)
    this%first = huge(this%first)
    if (part > 0) this%first = largest_change*root_mean_square(this%defect)/part
    if (.not. this%first > 0) this%first = huge(this%first)
  end subroutine foresee_change

  !> As long as τ may be taken as linear in time.
  pure function longest_step(this) result(step)
    class(error_transport_t), intent(in) :: this
    real(wp) :: step

    step = huge(step)
    if (this%by_difference) return
    step = this%interval
    if (.not. step > 0) step = this%first
  end function longest_step

  subroutine stepped(this, evolution, integrator, time, step, u, error)
    class(error_transport_t), intent(inout), target :: this
    class(evolution_t), intent(inout), target :: evolution
    class(integrator_t), intent(inout) :: integrator
    real(wp), intent(in) :: time, step
    real(wp), intent(in), contiguous :: u(:)
    type(error_t), allocatable, intent(out) :: error

    if (this%by_difference) return
    call this%stopwatch%start('error estimate')
    call integrator%add_step_error(step, this%step_errors)
    call this%stopwatch%stop()
    if (time - this%time < this%interval) return
    call this%catch_up(evolution, time, u, error)
  end subroutine stepped

  subroutine catch_up(this, evolution, time, u, error)
    class(error_transport_t), intent(inout), target :: this
    !> What is integrated
    class(evolution_t), intent(inout), target :: evolution
    !> Time, s, and state of the solution
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    !> The numbers went wrong
    type(error_t), allocatable, intent(out) :: error

    if (.not. time > this%time) return
    call this%stopwatch%start('error estimate')
    this%transport%base => this%reference
    this%transport%time = this%time
    call this%stepper%integrator%restart()
    if (this%by_difference) then
      call this%carry_difference(time, u, error)
    else
      call this%carry_error(evolution, time, u, error)
    end if
    this%transport%base => null()
    this%evaluations = this%evaluations + this%stepper%integrator%evaluations
    this%stepper%integrator%evaluations = 0
    call this%stopwatch%stop()
  end subroutine catch_up

  !> Find the true solution at a time, and so the error.
  subroutine carry_difference(this, time, u, error)
    class(error_transport_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    call this%reference%rate(this%time, this%solution, this%transport%start)
    call this%reference%clear_prescribed(this%transport%start)
    this%evaluations = this%evaluations + 1
    call this%stepper%advance_to(this%transport, this%time, time, this%error, error)
    !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(u)
      this%error(k) = this%error(k) + this%solution(k) - u(k)
      this%solution(k) = u(k)
    end do
    !$omp end parallel do
    call this%reference%clear_prescribed(this%error)
  end subroutine carry_difference

  !> Carry the error to a time, driven by τ as it changes meanwhile.
  subroutine carry_error(this, evolution, time, u, error)
    class(error_transport_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: change(:)
    real(wp) :: interval, size_of_defect, part
    integer :: k

    interval = time - this%time
    allocate (change(size(u)))
    call this%measure_defect(evolution, time, u, change)
    !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(u)
      change(k) = change(k) - this%defect(k)
      this%transport%start(k) = this%defect(k) + this%step_errors(k)/interval
      this%transport%slope(k) = change(k)/interval
      this%step_errors(k) = 0
      this%defect(k) = this%defect(k) + change(k)
    end do
    !$omp end parallel do
    if (allocated(this%further_mean)) then
      this%transport%start = this%transport%start + this%further_mean + &
                             (this%time - this%further_middle)*this%further_slope
      this%transport%slope = this%transport%slope + this%further_slope
    end if
    size_of_defect = root_mean_square(this%defect)
    call this%reference%linearise(time, u)
    this%stepper%tolerance = relative_tolerance*max(root_mean_square(this%error), &
                                                    size_of_defect*interval, tiny(1.0_wp))
    call this%stepper%advance_to(this%transport, this%time, time, this%error, error)
    this%evaluations = this%evaluations + 2
    ! A defect that changes fast is looked at more often.
    part = root_mean_square(change)
    if (part > 0.2_wp*largest_change*size_of_defect) then
      this%interval = interval*min(3.0_wp, max(0.1_wp, largest_change*size_of_defect/part))
    else
      this%interval = 3*interval
    end if
  end subroutine carry_error

  subroutine save_transport(this, state)
    class(error_transport_t), intent(in) :: this
    type(saved_state_t), intent(inout) :: state

    call state%enter('estimate')
    call state%put('time', this%time)
    call state%put('error', this%error)
    if (this%by_difference) then
      call state%put('tolerance', this%stepper%tolerance)
      call state%put('solution', this%solution)
    else
      call state%put('defect', this%defect)
      call state%put('step_errors', this%step_errors)
    end if
    call state%put('interval', this%interval)
    call state%put('first', this%first)
    call state%put('evaluations', this%evaluations)
    if (allocated(this%further_mean)) then
      call state%put('further_mean', this%further_mean)
      call state%put('further_slope', this%further_slope)
      call state%put('further_middle', this%further_middle)
    end if
    call this%stepper%save(state)
    call state%leave()
  end subroutine save_transport

  subroutine restore_transport(this, state)
    class(error_transport_t), intent(inout) :: this
    type(saved_state_t), intent(inout) :: state

    call state%enter('estimate')
    call state%get('time', this%time)
    call state%get('error', this%error)
    ! A run that goes on to another end may have another method now than the one that it began with.
    if (state%has('solution') .neqv. this%by_difference) then
      deallocate (this%stepper%integrator)
      if (allocated(this%transport%slope)) deallocate (this%transport%slope)
      call this%choose_way(.not. this%by_difference, this%error)
    end if
    if (this%by_difference) then
      call state%get('tolerance', this%stepper%tolerance)
      call state%get('solution', this%solution)
    else
      call state%get('defect', this%defect)
      call state%get('step_errors', this%step_errors)
    end if
    call state%get('interval', this%interval)
    call state%get('first', this%first)
    call state%get('evaluations', this%evaluations)
    if (state%has('further_mean')) then
      call state%get('further_mean', this%further_mean)
      call state%get('further_slope', this%further_slope)
      call state%get('further_middle', this%further_middle)
    end if
    call this%stepper%restore(state)
    call state%leave()
  end subroutine restore_transport

  !> To be called between intervals, when F or F_p is no longer what it was.
  subroutine renew(this, evolution, time, u, spectral_radius)
    class(error_transport_t), intent(inout) :: this
    !> What is integrated
    class(evolution_t), intent(inout) :: evolution
    !> Time, s, and state of the solution; e must belong to that time
    real(wp), intent(in) :: time, u(:)
    !> Spectral radius of F_p', 1/s, on the safe side
    real(wp), intent(in) :: spectral_radius

    this%stepper%spectral_radius = spectral_radius
    this%stepper%longest_step = this%stepper%integrator%longest_stable_step(spectral_radius)
    call this%measure_defect(evolution, time, u, this%defect)
  end subroutine renew

  !> To be called between intervals: what F misses beside τ, until it is called again.
  subroutine add_source(this, mean, slope, middle)
    class(error_transport_t), intent(inout) :: this
    !> Its mean and its slope in time
    real(wp), intent(in) :: mean(:), slope(:)
    !> The time when it is equal to its mean, s
    real(wp), intent(in) :: middle

    this%further_mean = mean
    this%further_slope = slope
    this%further_middle = middle
  end subroutine add_source

  !> τ = F_p(u) - F(u)
  subroutine measure_defect(this, evolution, time, u, defect)
    class(error_transport_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(out), contiguous :: defect(:)
    real(wp), allocatable :: rate(:)
    integer :: k

    allocate (rate(size(u)))
    call this%reference%rate(time, u, defect)
    call evolution%rate(time, u, rate)
    !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(u)
      defect(k) = defect(k) - rate(k)
    end do
    !$omp end parallel do
    call evolution%clear_prescribed(defect)
  end subroutine measure_defect

  pure function unknowns(this) result(number)
    class(linear_evolution_t), intent(in) :: this
    integer :: number

    number = size(this%start)
  end function unknowns

  subroutine rate(this, time, u, du)
    class(linear_evolution_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(out), contiguous :: du(:)
    integer :: k

    call this%base%jacobian_product(u, du)
    !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(u)
      du(k) = du(k) + this%start(k)
    end do
    !$omp end parallel do
    if (allocated(this%slope)) then
      !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
      do k = 1, size(u)
        du(k) = du(k) + (time - this%time)*this%slope(k)
      end do
      !$omp end parallel do
    end if
    call this%base%clear_prescribed(du)
  end subroutine rate

  subroutine jacobian_product(this, v, product)
    class(linear_evolution_t), intent(inout) :: this
    real(wp), intent(in), contiguous :: v(:)
    real(wp), intent(out), contiguous :: product(:)

    call this%base%jacobian_product(v, product)
  end subroutine jacobian_product

  !> Held temperatures have no error.
  subroutine impose(this, time, u)
    class(linear_evolution_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(inout), contiguous :: u(:)

    associate (unused => time)
    end associate
    call this%base%clear_prescribed(u)
  end subroutine impose

  subroutine clear_prescribed(this, v)
    class(linear_evolution_t), intent(in) :: this
    real(wp), intent(inout), contiguous :: v(:)

    call this%base%clear_prescribed(v)
  end subroutine clear_prescribed

  pure function is_linear(this) result(answer)
    class(linear_evolution_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .true.
  end function is_linear

  pure function depends_on_time(this) result(answer)
    class(linear_evolution_t), intent(in) :: this
    logical :: answer

    answer = allocated(this%slope)
  end function depends_on_time

  !> The solution itself is judged elsewhere; its error may be anything.
  subroutine inspect(this, time, u, error)
    class(linear_evolution_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    type(error_t), allocatable, intent(out) :: error

    associate (unused => this, also => time, and => u)
    end associate
  end subroutine inspect

end module calor_error_transport
