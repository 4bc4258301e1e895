!> A line on the terminal for every state that a run reaches.
module run_progress
  use calor, only: observer_t, simulation_t, to_text
  use terminal, only: say, everything_said
  implicit none (type, external)
  private

  public :: run_progress_t

  type, extends(observer_t) :: run_progress_t
    logical :: quiet = .false., verbose = .false.
  contains
    procedure :: begin
    procedure :: finish
    procedure :: reached
  end type run_progress_t

contains

  subroutine begin(this, quiet, verbose)
    class(run_progress_t), intent(inout) :: this
    logical, intent(in) :: quiet, verbose

    this%quiet = quiet
    this%verbose = verbose
  end subroutine begin

  subroutine finish(this)
    class(run_progress_t), intent(inout) :: this

    if (.not. this%quiet) call say('')
  end subroutine finish

  subroutine reached(this, simulation)
    class(run_progress_t), intent(inout) :: this
    type(simulation_t), intent(in) :: simulation
    logical :: said

    if (this%quiet) return
    call say('t = '//to_text(simulation%time, digits=6)//' s   temperature '// &
             to_text(minval(simulation%temperature), digits=6)//' to '// &
             to_text(maxval(simulation%temperature), digits=6)//'   step '// &
             to_text(simulation%stepper%steps))
    ! Whoever watches sees it now; a failure is kept for the end.
    said = everything_said()
  end subroutine reached

end module run_progress
