!> How far a run is: a bar where a terminal shows it, a line a minute where a file keeps it.
module run_progress
  use, intrinsic :: iso_fortran_env, only: int64
  use calor, only: observer_t, progress_line, simulation_t, to_text, wp
  use terminal, only: everything_said, is_terminal, line_width, say, say_in_place
  implicit none (type, external)
  private

  public :: run_progress_t

  !> Seconds between two lines: in place on a terminal, one after the other elsewhere
  real(wp), parameter :: in_place_seconds = 0.1_wp, log_seconds = 60.0_wp

  type, extends(observer_t) :: run_progress_t
    private
    logical :: quiet = .false., verbose = .false., in_place = .false.
    real(wp) :: end_time = 0.0_wp
    !> The last estimate of the relative error; negative where there is none
    real(wp) :: estimated_error = -1.0_wp
    !> When the run began, and when something was shown last
    integer(int64) :: start = 0, shown = 0
  contains
    !> The run begins
    procedure :: begin
    !> The run is over: leave a clean line
    procedure :: finish
    procedure :: reached
    procedure :: at_step
  end type run_progress_t

contains

  subroutine begin(this, end_time, quiet, verbose)
    class(run_progress_t), intent(inout) :: this
    !> Simulated time at the end, s
    real(wp), intent(in) :: end_time
    !> Whether nothing is shown, or a line for every state
    logical, intent(in) :: quiet, verbose

    this%end_time = end_time
    this%quiet = quiet
    this%verbose = verbose
    this%in_place = is_terminal() .and. .not. quiet
    call system_clock(this%start)
    this%shown = this%start
  end subroutine begin

  subroutine finish(this)
    class(run_progress_t), intent(inout) :: this

    if (this%in_place) call say_in_place('')
    if (this%verbose) call say('')
  end subroutine finish

  subroutine at_step(this, time, steps, accumulated_error, rest)
    class(run_progress_t), intent(inout) :: this
    real(wp), intent(in) :: time
    integer, intent(in) :: steps
    real(wp), intent(in) :: accumulated_error
    logical, intent(inout) :: rest
    integer(int64) :: now, rate
    logical :: said

    associate (unused => rest)
    end associate
    if (this%quiet) return
    call system_clock(now, rate)
    if (real(now - this%shown, wp)/rate < merge(in_place_seconds, log_seconds, &
                                                this%in_place)) return
    this%shown = now
    associate (seconds => real(now - this%start, wp)/rate)
      if (this%in_place) then
        call say_in_place(progress_line(time, this%end_time, steps, seconds, accumulated_error, &
                                        this%estimated_error, line_width()))
      else
        call say(progress_line(time, this%end_time, steps, seconds, accumulated_error, &
                               this%estimated_error, 0))
        said = everything_said()
      end if
    end associate
  end subroutine at_step

  subroutine reached(this, simulation)
    class(run_progress_t), intent(inout) :: this
    type(simulation_t), intent(in) :: simulation
    logical :: said

    if (allocated(simulation%estimate)) this%estimated_error = simulation%estimated_error()
    if (.not. this%verbose) return
    if (this%in_place) call say_in_place('')
    call say('t = '//to_text(simulation%time, digits=6)//' s   temperature '// &
             to_text(minval(simulation%temperature), digits=6)//' to '// &
             to_text(maxval(simulation%temperature), digits=6)//'   step '// &
             to_text(simulation%stepper%steps))
    ! Whoever watches sees it now; a failure is kept for the end.
    said = everything_said()
  end subroutine reached

end module run_progress
