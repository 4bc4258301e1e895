!> Errors as values.
!>
!> A procedure that can fail on what a user gave it has a last argument
!> `type(error_t), allocatable, intent(out) :: error`; it is allocated only if the procedure failed.
!> Nothing in the library prints or stops: the program decides what becomes of an error.
module calor_error
  implicit none (type, external)
  private

  public :: error_t, raise
  public :: status_done, status_bad_input, status_bad_numbers, status_bad_file

  !> Exit statuses of the program, and the kinds of error that lead to them
  integer, parameter :: status_done = 0
  !> The input is wrong
  integer, parameter :: status_bad_input = 2
  !> The numbers went wrong
  integer, parameter :: status_bad_numbers = 3
  !> A file could not be read or written
  integer, parameter :: status_bad_file = 4

  !> What went wrong, in words for the user
  type :: error_t
    !> One of the `status_...` constants
    integer :: status = status_bad_input
    !> What is wrong, where, and what to do about it; lines are parted by new_line
    character(len=:), allocatable :: message
  end type error_t

contains

  !> Make an error.
  pure subroutine raise(error, status, message)
    !> The error to be made
    type(error_t), allocatable, intent(out) :: error
    !> One of the `status_...` constants
    integer, intent(in) :: status
    !> What is wrong, where, and what to do about it
    character(len=*), intent(in) :: message

    allocate (error)
    error%status = status
    error%message = message
  end subroutine raise

end module calor_error
