!> What a step of the motion misses, as its rows are those of its middle.
!>
!> Within the step of length H about the time m, du/dt = A(t)u is replaced by A(m)u: to second order
!>
!>     (A(t) - A(m)) u(t) = (t - m) A'u + (t - m)² (½A''u + A'u')
!>
!> is missed, a part odd in t - m and one even with the mean H²/24 (A''u + 2A'u'). A' comes from
!> the difference of the rows of two places on the way, applied to the same field, and A''u + A'u'
!> is how A'u changes from step to step. The rows are those of the reference that errors are
!> estimated with: how the true ∇² changes along the paths is asked for, not how the scheme's own
!> error does.
module calor_rows_in_motion
  use calor_conduction, only: conduction_t
  use calor_kinds, only: wp
  use calor_saved_state, only: saved_state_t
  implicit none (type, external)
  private

  public :: rows_in_motion_t

  type :: rows_in_motion_t
    !> What is missed: its mean over the step and its slope, per second
    real(wp), allocatable :: mean(:), slope(:)
    !> With the rows before: A u and A u', and their time, s
    real(wp), allocatable, private :: rate(:), change(:), flow(:)
    real(wp), private :: time = 0.0_wp
  contains
    !> Apply the rows before they are renewed
    procedure :: note_before
    !> ... and after
    procedure :: note_after
    !> Lay aside what is known of the step before, and take it up again
    procedure :: save => save_change
    procedure :: restore => restore_change
  end type rows_in_motion_t

contains

  subroutine note_before(this, conduction, time, u, rows_time)
    class(rows_in_motion_t), intent(inout) :: this
    !> The heat equation with the rows of the time `rows_time`, s
    type(conduction_t), intent(inout) :: conduction
    !> Time, s, and state
    real(wp), intent(in) :: time, u(:), rows_time

    if (.not. allocated(this%rate)) allocate (this%rate(size(u)), this%change(size(u)))
    call conduction%rate(time, u, this%rate)
    this%flow = this%rate
    call conduction%add_held_rates(time, this%flow)
    call conduction%jacobian_product(this%flow, this%change)
    this%time = rows_time
  end subroutine note_before

  subroutine note_after(this, conduction, time, u, rows_time, step)
    class(rows_in_motion_t), intent(inout) :: this
    !> The heat equation with the rows of the time `rows_time`, s
    type(conduction_t), intent(inout) :: conduction
    !> Time, s, the same state, and the length of the step that begins, s
    real(wp), intent(in) :: time, u(:), rows_time, step
    real(wp), allocatable :: slope(:), change(:)

    allocate (slope(size(u)), change(size(u)))
    call conduction%rate(time, u, slope)
    call conduction%jacobian_product(this%flow, change)
    slope = (slope - this%rate)/(rows_time - this%time)
    change = (change - this%change)/(rows_time - this%time)
    call conduction%clear_prescribed(slope)
    call conduction%clear_prescribed(change)
    ! (A'u)' = A''u + A'u' is not known in the first step.
    if (.not. allocated(this%slope)) this%slope = slope
    this%mean = step/24*(slope - this%slope) + step**2/24*change
    this%slope = slope
  end subroutine note_after

  subroutine save_change(this, state)
    class(rows_in_motion_t), intent(in) :: this
    type(saved_state_t), intent(inout) :: state

    if (allocated(this%slope)) call state%put('rows_slope', this%slope)
  end subroutine save_change

  subroutine restore_change(this, state)
    class(rows_in_motion_t), intent(inout) :: this
    type(saved_state_t), intent(inout) :: state

    if (state%has('rows_slope')) call state%get('rows_slope', this%slope)
  end subroutine restore_change

end module calor_rows_in_motion
