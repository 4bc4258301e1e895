!> How far a comparison of costs is: a bar with the remaining time where a terminal shows it.
module cost_progress
  use calor, only: bar, cost_observer_t, cost_study_t, duration_text, to_text, wp
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
    integer :: done, all

    associate (unused => this)
    end associate
    call study%measurements(done, all)
    if (entry == 0 .and. done > 0) then
      call say_in_place('')
      return
    end if
    line = '['//bar(real(done, wp)/max(1, all), bar_width, '.')//'] '//to_text(done)//'/'// &
           to_text(all)
    if (entry > 0) then
      associate (next => study%entries(entry))
        line = line//'  '//next%method%laplacian//' '//to_text(next%spacing, digits=3)//' m'
      end associate
    else
      line = line//'  solution to compare with'
    end if
    if (study%remaining() >= 0) line = line//', about '//duration_text(study%remaining())//' left'
    call say_in_place(line)
  end subroutine progressed

end module cost_progress
