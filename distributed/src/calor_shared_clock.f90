!> When ranks rest together: a checkpoint is due on one of them, or one was told to end.
module calor_shared_clock
  use calor_checkpoint, only: checkpoint_clock_t
  use calor_interrupt, only: interrupted, interrupt_status
  use calor_kinds, only: wp
  use calor_ranks, only: ranks_t
  use calor_step_listener, only: step_listener_t
  implicit none (type, external)
  private

  public :: shared_clock_t

  !> Between a stepper and whoever else listens to it
  type, extends(step_listener_t) :: shared_clock_t
    type(ranks_t) :: ranks
    type(checkpoint_clock_t) :: clock
    !> Who else hears of each step
    class(step_listener_t), pointer :: next => null()
    !> The status to end with, as a signal to any of the ranks asks for; 0: none has come
    integer :: status = 0
  contains
    procedure :: at_step
    !> Whether a checkpoint is due on any rank
    procedure :: is_due
  end type shared_clock_t

contains

  subroutine at_step(this, time, steps, accumulated_error, rest)
    class(shared_clock_t), intent(inout) :: this
    real(wp), intent(in) :: time
    integer, intent(in) :: steps
    real(wp), intent(in) :: accumulated_error
    logical, intent(inout) :: rest

    if (associated(this%next)) call this%next%at_step(time, steps, accumulated_error, rest)
    rest = this%is_due(time) .or. this%status > 0
  end subroutine at_step

  !> Ranks' clocks differ, and signals come when they like: one exchange for both.
  function is_due(this, time) result(answer)
    class(shared_clock_t), intent(inout) :: this
    !> Simulated time, s
    real(wp), intent(in) :: time
    logical :: answer
    integer :: wish

    wish = 0
    if (this%clock%is_due(time)) wish = 1
    if (interrupted()) wish = interrupt_status()
    wish = nint(this%ranks%most(real(wish, wp)))
    answer = wish > 0
    if (wish > 1) this%status = wish
  end function is_due

end module calor_shared_clock
