!> What the program says, through C's standard output: Fortran's does not tell when a disk is full.
module terminal
  use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char, c_null_ptr, c_ptr, &
                                         c_size_t
  implicit none (type, external)
  private

  public :: say, everything_said, is_terminal, show_in_place

  !> The system's number of standard error
  integer(c_int), parameter :: standard_error = 2_c_int

  interface
    !> Write a text and an end of line
    function c_puts(text) bind(c, name='puts') result(status)
      import :: c_char, c_int
      implicit none (type, external)
      ! allow(assumed-size)
      character(kind=c_char), intent(in) :: text(*)
      integer(c_int) :: status
    end function c_puts

    !> Whether an open file is a terminal
    function c_isatty(descriptor) bind(c, name='isatty') result(answer)
      import :: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: descriptor
      integer(c_int) :: answer
    end function c_isatty

    !> Write bytes as they are
    function c_write(descriptor, text, bytes) bind(c, name='write') result(written)
      import :: c_char, c_int, c_size_t
      implicit none (type, external)
      integer(c_int), intent(in), value :: descriptor
      ! allow(assumed-size)
      character(kind=c_char), intent(in) :: text(*)
      integer(c_size_t), intent(in), value :: bytes
      integer(c_size_t) :: written
    end function c_write

    !> Bring what was written on its way; a null pointer means all files
    function c_fflush(file) bind(c, name='fflush') result(status)
      import :: c_int, c_ptr
      implicit none (type, external)
      type(c_ptr), intent(in), value :: file
      integer(c_int) :: status
    end function c_fflush
  end interface

contains

  !> Say a line.
  subroutine say(line)
    !> The line
    character(len=*), intent(in) :: line
    integer(c_int) :: status

    ! What fails here is kept by C and comes to light below.
    status = c_puts(line//c_null_char)
  end subroutine say

  !> Whether a person may be watching: standard error is a terminal.
  function is_terminal() result(answer)
    logical :: answer

    answer = c_isatty(standard_error) == 1
  end function is_terminal

  !> Show a line on standard error in the place of the one shown before; '' clears it.
  subroutine show_in_place(line)
    !> The line, shorter than the terminal is wide
    character(len=*), intent(in) :: line
    !> Back to the beginning, and clear the line
    character(len=*), parameter :: renew = achar(13)//achar(27)//'[K'
    integer(c_size_t) :: written

    ! Nothing depends on whether it could be shown.
    written = c_write(standard_error, renew//line, len(renew//line, kind=c_size_t))
  end subroutine show_in_place

  !> Whether all that was said so far could be written.
  function everything_said() result(answer)
    logical :: answer

    answer = c_fflush(c_null_ptr) == 0
  end function everything_said

end module terminal
