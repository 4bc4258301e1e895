!> One step of a time integrator.
module calor_integrator
  use calor_evolution, only: evolution_t
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: integrator_t

  !> A one-step method for u_t = F(t, u)
  type, abstract :: integrator_t
    !> Evaluations of F so far
    integer :: evaluations = 0
  contains
    !> The longest step that is stable for eigenvalues on the negative real axis, s
    procedure(limit_interface), deferred :: longest_stable_step
    !> Whether `advance` estimates its error
    procedure(knows_interface), deferred :: estimates_error
    !> Compute the state one step later
    procedure(advance_interface), deferred :: advance
    !> The step just computed becomes the state that the next one starts from
    procedure :: accept
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
      real(wp), intent(in) :: u(:)
      !> State at `time + step`
      real(wp), intent(out) :: u_next(:)
      !> Root mean square of the step's estimated error; 0 if the method estimates none
      real(wp), intent(out) :: local_error
    end subroutine advance_interface
  end interface

contains

  subroutine accept(this)
    class(integrator_t), intent(inout) :: this

    ! Most methods carry nothing from step to step.
    associate (unused => this)
    end associate
  end subroutine accept

end module calor_integrator
