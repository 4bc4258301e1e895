!> What the program says, through C's standard output: Fortran's does not tell when a disk is full.
module terminal
  use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char, c_null_ptr, c_ptr
  implicit none (type, external)
  private

  public :: say, everything_said

  interface
    !> Write a text and an end of line
    function c_puts(text) bind(c, name='puts') result(status)
      import :: c_char, c_int
      implicit none (type, external)
      ! allow(assumed-size)
      character(kind=c_char), intent(in) :: text(*)
      integer(c_int) :: status
    end function c_puts

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

  !> Whether all that was said so far could be written.
  function everything_said() result(answer)
    logical :: answer

    answer = c_fflush(c_null_ptr) == 0
  end function everything_said

end module terminal
