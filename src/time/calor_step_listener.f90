!> Whoever wants to hear of each step of a run, to show progress or to lay the state aside: it
!> changes nothing, but may ask the integration for a rest.
module calor_step_listener
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: step_listener_t

  type, abstract :: step_listener_t
  contains
    !> A step has been taken
    procedure :: at_step
  end type step_listener_t

contains

  !> Does nothing unless it is overridden.
  subroutine at_step(this, time, steps, accumulated_error, rest)
    class(step_listener_t), intent(inout) :: this
    !> The new time, s
    real(wp), intent(in) :: time
    !> Steps so far
    integer, intent(in) :: steps
    !> Sum of the estimated errors of the steps; 0 without error control
    real(wp), intent(in) :: accumulated_error
    !> Set to have the integration return to its caller after this step; it can be continued
    logical, intent(inout) :: rest

    associate (unused => [real(wp) :: time, real(steps, wp), accumulated_error], too => this, &
               also => rest)
    end associate
  end subroutine at_step

end module calor_step_listener
