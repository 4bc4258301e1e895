!> What the program says, through C's standard output: Fortran's does not tell when a disk is full.
module terminal
  use, intrinsic :: iso_c_binding, only: c_char, c_int, c_long, c_null_char, c_null_ptr, &
                                         c_ptr, c_short
  implicit none (type, external)
  private

  public :: say, say_in_place, everything_said, is_terminal, line_width

  !> Letters of a line that is shown in place, at most
  integer, parameter :: widest_line = 79

  !> What a terminal says of its size, in letters and in pixels: struct winsize of Linux
  type, bind(c) :: terminal_size_t
    integer(c_short) :: rows = 0, columns = 0, width = 0, height = 0
  end type terminal_size_t

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

    !> Ask a device; C knows no types of what follows the second argument
    function c_ioctl(descriptor, request, size) bind(c, name='ioctl') result(status)
      import :: c_int, c_long, terminal_size_t
      implicit none (type, external)
      integer(c_int), intent(in), value :: descriptor
      integer(c_long), intent(in), value :: request
      type(terminal_size_t), intent(inout) :: size
      integer(c_int) :: status
    end function c_ioctl

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
    integer :: k, width

    if (.not. is_terminal()) return
    width = line_width()
    letters = achar(13)//repeat(' ', width)//achar(13)//line(:min(len(line), width))
    do k = 1, len(letters)
      status = c_putchar(iachar(letters(k:k), c_int))
    end do
    status = c_fflush(c_null_ptr)
  end subroutine say_in_place

  !> Letters that a line in place may have: a longer one would go on in the next line and could not
  !> be taken back.
  function line_width() result(letters)
    integer :: letters
    integer(c_int), parameter :: standard_output = 1
    !> TIOCGWINSZ of Linux
    integer(c_long), parameter :: size_please = int(z'5413', c_long)
    type(terminal_size_t) :: size

    letters = widest_line
    if (c_ioctl(standard_output, size_please, size) /= 0) return
    if (size%columns > 1) letters = min(letters, int(size%columns) - 1)
  end function line_width

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
