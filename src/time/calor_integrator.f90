!> One step of a time integrator.
module calor_integrator
  use calor_evolution, only: evolution_t
  use calor_kinds, only: wp
  use calor_saved_state, only: saved_state_t
  implicit none (type, external)
  private

  public :: integrator_t

  !> A one-step method for u_t = F(t, u)
  type, abstract :: integrator_t
    !> Evaluations of F so far
    integer :: evaluations = 0
    !> The error that a step may make, root mean square; 0: as small as rounding lets it be. What is
    !> solved by iteration inside a step is solved to a part of that.
    real(wp) :: tolerance = 0.0_wp
    !> Why the last step could not be computed; not allocated: it could
    character(len=:), allocatable :: failure
  contains
    !> The longest step that is stable for eigenvalues on the negative real axis, s
    procedure(limit_interface), deferred :: longest_stable_step
    !> The longest step after which, where no weight is negative and held temperatures are
    !> constant, no temperature lies outside the range of those before, s; 0: no such promise
    procedure :: longest_monotone_step
    !> Shorten a step that is stable on the real axis, but not for the evolution's own spectrum
    procedure :: shorten_step
    !> Whether `advance` estimates its error
    procedure(knows_interface), deferred :: estimates_error
    !> The power of the step with which the error at a given time falls
    procedure(order_interface), deferred :: order
    !> The step to take after one with that error
    procedure :: next_step
    !> Whether the first step's length is found by a trial
    procedure :: wants_trial
    !> Compute the state one step later
    procedure(advance_interface), deferred :: advance
    !> The step just computed becomes the state that the next one starts from
    procedure :: accept
    !> Add the estimated error of the step just accepted, true less computed state, to a vector
    procedure :: add_step_error
    !> Forget what was carried over from the last step: F is another one now
    procedure :: restart
    !> Lay aside what is carried over, and take it up again
    procedure :: save => save_integrator
    procedure :: restore => restore_integrator
  end type integrator_t

  abstract interface
    pure function limit_interface(this, spectral_radius) result(step)
      import :: integrator_t, wp
      implicit none (type, external)
      class(integrator_t), intent(in) :: this
      !> Spectral radius of the Jacobian, 1/s
      real(wp), intent(in) :: spectral_radius
      real(wp) :: step
    end function limit_interface

    pure function knows_interface(this) result(answer)
      import :: integrator_t
      implicit none (type, external)
      class(integrator_t), intent(in) :: this
      logical :: answer
    end function knows_interface

    pure function order_interface(this) result(order)
      import :: integrator_t
      implicit none (type, external)
      class(integrator_t), intent(in) :: this
      integer :: order
    end function order_interface

    subroutine advance_interface(this, evolution, time, step, spectral_radius, u, u_next, &
                                 local_error)
      import :: integrator_t, evolution_t, wp
      implicit none (type, external)
      class(integrator_t), intent(inout) :: this
      !> What is integrated
      class(evolution_t), intent(inout) :: evolution
      !> Time and step, s
      real(wp), intent(in) :: time, step
      !> Spectral radius of the Jacobian, 1/s
      real(wp), intent(in) :: spectral_radius
      !> State at `time`
      real(wp), intent(in), contiguous :: u(:)
      !> State at `time + step`
      real(wp), intent(out), contiguous :: u_next(:)
      !> Root mean square of the step's estimated error; 0 if the method estimates none
      real(wp), intent(out) :: local_error
    end subroutine advance_interface
  end interface

contains

  pure function longest_monotone_step(this, fastest_decay) result(step)
    class(integrator_t), intent(in) :: this
    !> The largest -a_ii of the Jacobian, 1/s
    real(wp), intent(in) :: fastest_decay
    real(wp) :: step

    ! No method of second or higher order makes the promise for steps of any length (C. Bolley,
    ! M. Crouzeix, RAIRO Anal. Numér. 12 (1978) 237–245).
    associate (unused => this, also => fastest_decay)
    end associate
    step = 0
  end function longest_monotone_step

  subroutine shorten_step(this, evolution, spectral_radius, step, work)
    class(integrator_t), intent(inout) :: this
    !> What is integrated
    class(evolution_t), intent(inout) :: evolution
    !> Spectral radius of the Jacobian, 1/s
    real(wp), intent(in) :: spectral_radius
    !> Step, s
    real(wp), intent(inout) :: step
    !> Workspace of the size of u
    real(wp), intent(inout), contiguous :: work(:)

    ! Most methods are stable wherever their limit lets them be.
    associate (unused => this, also => evolution, and => spectral_radius, too => step, or => work)
    end associate
  end subroutine shorten_step

  pure function next_step(this, step, local_error) result(proposed)
    class(integrator_t), intent(in) :: this
    !> The step just computed, s
    real(wp), intent(in) :: step
    !> Its error
    real(wp), intent(in) :: local_error
    real(wp) :: proposed
    real(wp) :: factor

    ! The error of a step goes with one power of its length more than the error at a given time.
    ! It grows by 3 at most, so that what is smaller still need not be told apart.
    factor = 0.9_wp*(this%tolerance/max(local_error, 1.0e-3_wp*this%tolerance))** &
             (1.0_wp/(this%order() + 1))
    proposed = step*min(3.0_wp, max(0.1_wp, factor))
  end function next_step

  pure function wants_trial(this) result(answer)
    class(integrator_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .true.
  end function wants_trial

  subroutine accept(this)
    class(integrator_t), intent(inout) :: this

    ! Most methods carry nothing from step to step.
    associate (unused => this)
    end associate
  end subroutine accept

  subroutine add_step_error(this, step, total)
    class(integrator_t), intent(in) :: this
    !> The length of the step, s
    real(wp), intent(in) :: step
    !> What the error is added to
    real(wp), intent(inout), contiguous :: total(:)

    ! A method that estimates no error adds nothing.
    associate (unused => this, also => step, and => total)
    end associate
  end subroutine add_step_error

  subroutine restart(this)
    class(integrator_t), intent(inout) :: this

    associate (unused => this)
    end associate
  end subroutine restart

  !> A method that carries something over saves it besides.
  subroutine save_integrator(this, state)
    class(integrator_t), intent(in) :: this
    type(saved_state_t), intent(inout) :: state

    call state%put('evaluations', this%evaluations)
  end subroutine save_integrator

  subroutine restore_integrator(this, state)
    class(integrator_t), intent(inout) :: this
    type(saved_state_t), intent(inout) :: state

    call state%get('evaluations', this%evaluations)
  end subroutine restore_integrator

end module calor_integrator
