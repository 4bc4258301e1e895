!> What the program says, through C's standard output: Fortran's does not tell when a disk is full.
module terminal
  use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char, c_null_ptr, c_ptr
  implicit none (type, external)
  private

  public :: say, say_in_place, everything_said, is_terminal, line_width

  !> Letters of a line that is shown in place
  integer, parameter :: line_width = 79

  interface
    !> Write a text and an end of line
    function c_puts(text) bind(c, name='puts') result(status)
      import :: c_char, c_int
      implicit none (type, external)
      ! allow(assumed-size)
      character(kind=c_char), intent(in) :: text(*)
      integer(c_int) :: status
    end function c_puts

    !> Write a character
    function c_putchar(letter) bind(c, name='putchar') result(status)
      import :: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: letter
      integer(c_int) :: status
    end function c_putchar

    !> Whether an open file is a terminal
    function c_isatty(descriptor) bind(c, name='isatty') result(answer)
      import :: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: descriptor
      integer(c_int) :: answer
    end function c_isatty

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

  !> Show a short line in the place of the one that was last shown so; nothing where nobody
  !> watches, which is where standard output is no terminal.
  subroutine say_in_place(line)
    !> The line, without an end; '' leaves an empty one
    character(len=*), intent(in) :: line
    character(len=:), allocatable :: letters
    integer(c_int) :: status
    integer :: k

    if (.not. is_terminal()) return
    letters = achar(13)//repeat(' ', line_width)//achar(13)//line(:min(len(line), line_width))
    do k = 1, len(letters)
      status = c_putchar(iachar(letters(k:k), c_int))
    end do
    status = c_fflush(c_null_ptr)
  end subroutine say_in_place

  !> Whether somebody watches: standard output is a terminal.
  function is_terminal() result(answer)
    logical :: answer
    integer(c_int), parameter :: standard_output = 1

    answer = c_isatty(standard_output) /= 0
  end function is_terminal

  !> Whether all that was said so far could be written.
  function everything_said() result(answer)
    logical :: answer

    answer = c_fflush(c_null_ptr) == 0
  end function everything_said

end module terminal
