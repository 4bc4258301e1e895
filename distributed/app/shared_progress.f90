!> How far a run is: a line a minute.
module shared_progress
  use, intrinsic :: iso_fortran_env, only: int64, output_unit
  use calor_kinds, only: wp
  use calor_progress_line, only: progress_line
  use calor_step_listener, only: step_listener_t
  implicit none (type, external)
  private

  public :: shared_progress_t

  real(wp), parameter :: seconds_between = 60.0_wp

  type, extends(step_listener_t) :: shared_progress_t
    private
    logical :: quiet = .false.
    real(wp) :: end_time = 0.0_wp
    integer(int64) :: start = 0, shown = 0
  contains
    !> The run begins
    procedure :: begin
    procedure :: at_step
  end type shared_progress_t

contains

  subroutine begin(this, end_time, quiet)
    class(shared_progress_t), intent(inout) :: this
    !> Simulated time at the end, s
    real(wp), intent(in) :: end_time
    !> Whether nothing is shown
    logical, intent(in) :: quiet

    this%end_time = end_time
    this%quiet = quiet
    call system_clock(this%start)
    this%shown = this%start
  end subroutine begin

  subroutine at_step(this, time, steps, accumulated_error, rest)
    class(shared_progress_t), intent(inout) :: this
    real(wp), intent(in) :: time
    integer, intent(in) :: steps
    real(wp), intent(in) :: accumulated_error
    logical, intent(inout) :: rest
    integer(int64) :: now, rate

    associate (unused => rest)
    end associate
    if (this%quiet) return
    call system_clock(now, rate)
    if (real(now - this%shown, wp)/rate < seconds_between) return
    this%shown = now
    write (output_unit, '(a)') progress_line(time, this%end_time, steps, &
                                             real(now - this%start, wp)/rate, accumulated_error, &
                                             -1.0_wp, 0)
    flush (output_unit)
  end subroutine at_step

end module shared_progress
