!> A system of ordinary differential equations u_t = F(t, u), some of whose unknowns are prescribed.
!>
!> It is all that an integrator knows of what it integrates.
module calor_evolution
  use calor_error, only: error_t
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: evolution_t

  type, abstract :: evolution_t
  contains
    !> Number of entries of u, prescribed ones included
    procedure(unknowns_interface), deferred :: unknowns
    !> F(t, u); 0 for prescribed entries
    procedure(rate_interface), deferred :: rate
    !> (∂F/∂u) v; v is 0 at prescribed entries
    procedure(jacobian_interface), deferred :: jacobian_product
    !> Take ∂F/∂u at a state for it from now on; without this it is on the safe side
    procedure :: linearise
    !> Put the prescribed values of a time into u
    procedure(impose_interface), deferred :: impose
    !> Put 0 into the prescribed entries of a vector
    procedure(clear_interface), deferred :: clear_prescribed
    !> Judge a new state; an error ends the integration
    procedure(inspect_interface), deferred :: inspect
  end type evolution_t

  abstract interface
    pure function unknowns_interface(this) result(number)
      import :: evolution_t
      implicit none (type, external)
      class(evolution_t), intent(in) :: this
      integer :: number
    end function unknowns_interface

    subroutine rate_interface(this, time, u, du)
      import :: evolution_t, wp
      implicit none (type, external)
      class(evolution_t), intent(inout) :: this
      !> Time, s
      real(wp), intent(in) :: time
      !> State
      real(wp), intent(in) :: u(:)
      !> Its rate of change, 1/s
      real(wp), intent(out) :: du(:)
    end subroutine rate_interface

    subroutine jacobian_interface(this, v, product)
      import :: evolution_t, wp
      implicit none (type, external)
      class(evolution_t), intent(inout) :: this
      !> A change of the state
      real(wp), intent(in) :: v(:)
      !> The change of the rate that it causes
      real(wp), intent(out) :: product(:)
    end subroutine jacobian_interface

    subroutine impose_interface(this, time, u)
      import :: evolution_t, wp
      implicit none (type, external)
      class(evolution_t), intent(inout) :: this
      !> Time, s
      real(wp), intent(in) :: time
      !> State
      real(wp), intent(inout) :: u(:)
    end subroutine impose_interface

    subroutine clear_interface(this, v)
      import :: evolution_t, wp
      implicit none (type, external)
      class(evolution_t), intent(in) :: this
      !> Any vector of the size of u
      real(wp), intent(inout) :: v(:)
    end subroutine clear_interface

    subroutine inspect_interface(this, time, u, error)
      import :: evolution_t, wp, error_t
      implicit none (type, external)
      class(evolution_t), intent(inout) :: this
      !> Time, s
      real(wp), intent(in) :: time
      !> State
      real(wp), intent(in) :: u(:)
      !> What is wrong with it
      type(error_t), allocatable, intent(out) :: error
    end subroutine inspect_interface
  end interface

contains

  !> Nothing to do where ∂F/∂u is the same at all states.
  subroutine linearise(this, time, u)
    class(evolution_t), intent(inout) :: this
    !> Time, s
    real(wp), intent(in) :: time
    !> State
    real(wp), intent(in) :: u(:)

    associate (unused => this, also => time, and => u)
    end associate
  end subroutine linearise

end module calor_evolution
