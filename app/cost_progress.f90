!> How far a comparison of costs is: a bar with the remaining time where a terminal shows it.
module cost_progress
  use calor, only: cost_observer_t, cost_study_t, to_text, wp
  use terminal, only: say_in_place
  implicit none (type, external)
  private

  public :: cost_progress_t

  type, extends(cost_observer_t) :: cost_progress_t
  contains
    procedure :: progressed
  end type cost_progress_t

  integer, parameter :: bar_width = 24

contains

  subroutine progressed(this, study, entry)
    class(cost_progress_t), intent(inout) :: this
    type(cost_study_t), intent(in) :: study
    integer, intent(in) :: entry
    character(len=:), allocatable :: line
    integer :: done, all, filled

    associate (unused => this)
    end associate
    call study%measurements(done, all)
    if (entry == 0 .and. done > 0) then
      call say_in_place('')
      return
    end if
    filled = (bar_width*done)/max(1, all)
    line = '['//repeat('#', filled)//repeat('.', bar_width - filled)//'] '//to_text(done)//'/'// &
           to_text(all)
    if (entry > 0) then
      associate (next => study%entries(entry))
        line = line//'  '//next%method%laplacian//' '//to_text(next%spacing, digits=3)//' m'
      end associate
    else
      line = line//'  solution to compare with'
    end if
    if (study%remaining() >= 0) line = line//', about '//duration(study%remaining())//' left'
    call say_in_place(line(:min(len(line), 79)))
  end subroutine progressed

  !> '45 s' or '3 min 20 s'
  pure function duration(seconds) result(text)
    real(wp), intent(in) :: seconds
    character(len=:), allocatable :: text

    if (seconds < 90) then
      text = to_text(nint(seconds))//' s'
    else
      text = to_text(int(seconds)/60)//' min '//to_text(mod(int(seconds), 60))//' s'
    end if
  end function duration

end module cost_progress
