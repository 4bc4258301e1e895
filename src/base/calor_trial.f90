!> Trying out in a process of its own what may crash: reading a file that may be damaged.
!>
!>     call start_trial(inside, survived)
!>     if (survived) then
!>       ... what may crash ...
!>       if (inside) call end_trial()
!>     end if
!>
!> HDF5 bears most damaged files, but not all: some have it copy -1 bytes or follow a pointer that
!> is none, and no error handler is asked before. So a child process, a copy of the calling one,
!> does the work first, and only if it comes to its end is it done in earnest. Whatever the child
!> says is dropped. Where the system lets nobody have a child, the work is done untried.
module calor_trial
  use, intrinsic :: iso_c_binding, only: c_int, c_ptr, c_loc
  use calor_c_text, only: to_c
  implicit none (type, external)
  private

  public :: start_trial, end_trial

  interface
    function c_fork() result(child) bind(c, name='fork')
      import :: c_int
      implicit none (type, external)
      integer(c_int) :: child
    end function c_fork

    function c_waitpid(child, status, options) result(ended) bind(c, name='waitpid')
      import :: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: child, options
      integer(c_int), intent(inout) :: status
      integer(c_int) :: ended
    end function c_waitpid

    function c_open(path, flags) result(descriptor) bind(c, name='open')
      import :: c_int, c_ptr
      implicit none (type, external)
      type(c_ptr), intent(in), value :: path
      integer(c_int), intent(in), value :: flags
      integer(c_int) :: descriptor
    end function c_open

    function c_dup2(from, to) result(descriptor) bind(c, name='dup2')
      import :: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: from, to
      integer(c_int) :: descriptor
    end function c_dup2

    function c_kill(process, signal) result(status) bind(c, name='kill')
      import :: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: process, signal
      integer(c_int) :: status
    end function c_kill

    !> End at once, without writing what is still in buffers that the parent has, too
    subroutine c_exit_at_once(status) bind(c, name='_exit')
      import :: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: status
    end subroutine c_exit_at_once
  end interface

contains

  !> Have a child try what follows, and wait for it.
  subroutine start_trial(inside, survived)
    !> Whether this is the child, which has to end by `end_trial`
    logical, intent(out) :: inside
    !> Whether to go on: this is the child, or the child came to its end
    logical, intent(out) :: survived
    integer(c_int) :: child, status

    child = c_fork()
    inside = child == 0
    survived = .true.
    if (inside) then
      call fall_silent()
    else if (child > 0) then
      status = 0
      ! A signal that is only noted interrupts the waiting.
      do while (c_waitpid(child, status, 0_c_int) < 0)
        if (c_kill(child, 0_c_int) < 0) return
      end do
      survived = status == 0
    end if
  end subroutine start_trial

  !> The child has come to its end; does not return.
  subroutine end_trial()
    call c_exit_at_once(0_c_int)
  end subroutine end_trial

  subroutine fall_silent()
    character(len=:), allocatable, target :: nowhere
    integer(c_int), parameter :: for_writing = 1
    integer(c_int) :: descriptor, ignored

    nowhere = to_c('/dev/null')
    descriptor = c_open(c_loc(nowhere), for_writing)
    if (descriptor < 0) return
    ignored = c_dup2(descriptor, 1_c_int)
    ignored = c_dup2(descriptor, 2_c_int)
  end subroutine fall_silent

end module calor_trial
