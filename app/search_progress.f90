!> A line on the terminal for every run of the search for a target.
module search_progress
  use calor, only: search_watcher_t, attempt_t, to_text
  use terminal, only: say, everything_said
  implicit none (type, external)
  private

  public :: search_progress_t

  type, extends(search_watcher_t) :: search_progress_t
  contains
    procedure :: attempted
  end type search_progress_t

contains

  subroutine attempted(this, attempt)
    class(search_progress_t), intent(inout) :: this
    type(attempt_t), intent(in) :: attempt
    character(len=:), allocatable :: kind
    logical :: said

    associate (unused => this)
    end associate
    kind = 'run   '
    if (attempt%pilot) kind = 'pilot '
    call say('  '//kind//attempt%scheme//', '//to_text(attempt%particles)//' particles, '// &
             to_text(attempt%spacing, digits=3)//' m apart: estimated error '// &
             to_text(attempt%estimate, digits=3)//' in '// &
             to_text(attempt%setup_seconds + attempt%step_seconds, digits=2)//' s')
    ! Whoever watches sees it now; a failure is kept for the end.
    said = everything_said()
  end subroutine attempted

end module search_progress
