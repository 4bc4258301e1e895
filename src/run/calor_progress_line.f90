!> How far a run is, in a line.
module calor_progress_line
  use calor_kinds, only: wp
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: progress_line, bar, duration_text

contains

  !> '[######......] 50 %  t = 0.5 s  120 steps/s  2 s left  error 1.2e-3'
  pure function progress_line(time, end_time, steps, seconds, accumulated_error, &
                              estimated_error, width) result(line)
    !> Simulated time and its end, s
    real(wp), intent(in) :: time, end_time
    !> Steps so far, and the wall time that they took, s
    integer, intent(in) :: steps
    real(wp), intent(in) :: seconds
    !> Sum of the estimated errors of the steps, K; 0 without error control
    real(wp), intent(in) :: accumulated_error
    !> The run's estimate of its relative error, which says more; negative where there is none
    real(wp), intent(in) :: estimated_error
    !> Letters that a bar may fill together with the rest; 0 for no bar
    integer, intent(in) :: width
    character(len=:), allocatable :: line
    integer, parameter :: longest_bar = 20, shortest_bar = 4
    real(wp) :: part
    integer :: room

    part = 1
    if (end_time > 0) part = max(0.0_wp, min(1.0_wp, time/end_time))
    line = to_text(int(100*part))//' %  t = '//to_text(time, digits=3)//' s'
    if (width == 0) line = line//'  step '//to_text(steps)
    if (seconds > 0) line = line//'  '//to_text(steps/seconds, digits=2)//' steps/s'
    if (part > 0 .and. part < 1 .and. seconds > 0) then
      line = line//'  '//duration_text(seconds*(1 - part)/part)//' left'
    end if
    if (estimated_error >= 0) then
      line = line//'  error '//to_text(estimated_error, digits=2)
    else if (accumulated_error > 0) then
      line = line//'  step errors '//to_text(accumulated_error, digits=1)//' K'
    end if
    room = min(longest_bar, width - len(line) - len('[] '))
    if (room >= shortest_bar) line = '['//bar(part, room, '.')//'] '//line
  end function progress_line

  !> A part of a whole as a row of #.
  pure function bar(part, width, rest)
    !> From 0 to 1
    real(wp), intent(in) :: part
    !> Letters of the whole
    integer, intent(in) :: width
    !> What the rest is shown as
    character(len=1), intent(in) :: rest
    character(len=:), allocatable :: bar
    integer :: filled

    filled = nint(width*part)
    bar = repeat('#', filled)//repeat(rest, width - filled)
  end function bar

  !> '45 s', '3 min 20 s' or '2 h 5 min'
  pure function duration_text(seconds) result(text)
    !> s
    real(wp), intent(in) :: seconds
    character(len=:), allocatable :: text
    integer :: whole

    whole = int(min(seconds, 1.0e9_wp))
    if (seconds < 90) then
      text = to_text(nint(seconds))//' s'
    else if (whole < 7200) then
      text = to_text(whole/60)//' min '//to_text(mod(whole, 60))//' s'
    else
      text = to_text(whole/3600)//' h '//to_text(mod(whole, 3600)/60)//' min'
    end if
  end function duration_text

end module calor_progress_line
