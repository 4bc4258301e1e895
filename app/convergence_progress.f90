!> How far a study of convergence has come, in a line on the terminal.
module convergence_progress
  use calor, only: convergence_watcher_t, to_text, wp
  use terminal, only: say_in_place
  implicit none (type, external)
  private

  public :: convergence_progress_t

  type, extends(convergence_watcher_t) :: convergence_progress_t
  contains
    procedure :: advanced
  end type convergence_progress_t

contains

  subroutine advanced(this, part)
    class(convergence_progress_t), intent(inout) :: this
    real(wp), intent(in) :: part

    associate (unused => this)
    end associate
    call say_in_place('Measuring: '//to_text(nint(100*part))//' %')
  end subroutine advanced

end module convergence_progress
