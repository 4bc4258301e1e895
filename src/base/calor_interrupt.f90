!> Interrupts by the user (SIGINT, as by Ctrl-C) and by the system (SIGTERM): the wish to end is
!> noted, and whoever works looks at it between two steps and ends in good order.
!>
!> The note is the library's one variable that no caller hands around: the system calls a signal's
!> handler with nothing but the signal's number, so that there is no other place to leave word. It
!> is a single number that is set at once. As long as no program calls `watch_for_interrupt`,
!> signals do what they always did, and `interrupted` is false.
module calor_interrupt
  use, intrinsic :: iso_c_binding, only: c_int, c_funptr, c_funloc, c_null_funptr
  implicit none (type, external)
  private

  public :: watch_for_interrupt, stop_watching, interrupted, interrupt_status

  !> The signal that asked to end; 0: none has
  integer(c_int), volatile :: caught = 0

  !> Numbers of the signals, the same on all systems
  integer(c_int), parameter :: signals(*) = [2_c_int, 15_c_int]

  interface
    !> Have a procedure called when a signal arrives
    function c_signal(number, handler) result(old) bind(c, name='signal')
      import :: c_int, c_funptr
      implicit none (type, external)
      integer(c_int), intent(in), value :: number
      type(c_funptr), intent(in), value :: handler
      type(c_funptr) :: old
    end function c_signal
  end interface

contains

  !> From now on note an interrupt instead of being ended by it; earlier ones are forgotten.
  !>
  !> A second one ends the program at once. It concerns the whole process, so a main program calls
  !> this, and no library procedure does.
  subroutine watch_for_interrupt()
    type(c_funptr) :: old
    integer :: k

    caught = 0
    do k = 1, size(signals)
      old = c_signal(signals(k), c_funloc(note_signal))
    end do
  end subroutine watch_for_interrupt

  !> Let signals end the program again; what was noted is forgotten.
  subroutine stop_watching()
    type(c_funptr) :: old
    integer :: k

    do k = 1, size(signals)
      old = c_signal(signals(k), c_null_funptr)
    end do
    caught = 0
  end subroutine stop_watching

  !> Whether an interrupt has been noted.
  function interrupted() result(answer)
    logical :: answer

    answer = caught /= 0
  end function interrupted

  !> The exit status by which a program tells that it was interrupted: 130 after Ctrl-C.
  function interrupt_status() result(status)
    integer :: status

    status = 128 + caught
  end function interrupt_status

  !> The handler. Nothing but the note and `signal` itself is allowed in such a place.
  subroutine note_signal(number) bind(c)
    integer(c_int), intent(in), value :: number
    type(c_funptr) :: old
    integer :: k

    caught = number
    ! A null pointer is SIG_DFL: the next one, of either kind, ends the program.
    do k = 1, size(signals)
      old = c_signal(signals(k), c_null_funptr)
    end do
  end subroutine note_signal

end module calor_interrupt
