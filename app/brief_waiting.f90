!> Threads that do not wait for each other at others' expense.
!>
!> A thread that has done its part of a loop spins, by default for milliseconds, until the others
!> have done theirs. Where other programs use the machine as well, it so keeps from its core the
!> very thread it waits for, and loops of microseconds take milliseconds. The OpenMP library reads
!> how long to spin before the program begins, so the program begins once more, with that set.
module brief_waiting
  use, intrinsic :: iso_c_binding, only: c_char, c_int, c_loc, c_null_char, c_null_ptr, c_ptr, &
                                         c_size_t
  use omp_lib, only: omp_get_max_threads
  implicit none (type, external)
  private

  public :: wait_briefly

  !> What tells the OpenMP library how long to spin
  character(len=*), parameter :: variable = 'GOMP_SPINCOUNT', policy = 'OMP_WAIT_POLICY'
  !> Some ten microseconds: longer than between two loops of a step
  character(len=*), parameter :: turns = '1000'
  integer, parameter :: longest_path = 4096

  interface
    ! allow(assumed-size)
    function setenv(name, value, overwrite) bind(c, name='setenv') result(status)
      import :: c_char, c_int
      implicit none (type, external)
      character(kind=c_char), intent(in) :: name(*), value(*)
      integer(c_int), value :: overwrite
      integer(c_int) :: status
    end function setenv

    ! allow(assumed-size, assumed-size-character-intent)
    function readlink(path, buffer, length) bind(c, name='readlink') result(used)
      import :: c_char, c_size_t
      implicit none (type, external)
      character(kind=c_char), intent(in) :: path(*)
      character(kind=c_char), intent(out) :: buffer(*)
      integer(c_size_t), value :: length
      integer(c_size_t) :: used
    end function readlink

    ! allow(assumed-size)
    function execv(path, arguments) bind(c, name='execv') result(status)
      import :: c_char, c_int, c_ptr
      implicit none (type, external)
      character(kind=c_char), intent(in) :: path(*)
      type(c_ptr), intent(in) :: arguments(*)
      integer(c_int) :: status
    end function execv
  end interface

contains

  !> Begin once more with threads that spin briefly, unless there is one only or the user has said
  !> how they shall wait. Where that cannot be had the program goes on as it is.
  subroutine wait_briefly()
    character(len=longest_path) :: program_path
    character(len=:, kind=c_char), allocatable, target :: text
    type(c_ptr), allocatable :: arguments(:)
    integer, allocatable :: first(:)
    integer :: argument, arguments_given, length
    integer(c_size_t) :: used
    integer(c_int) :: status

    if (omp_get_max_threads() < 2) return
    if (is_set(variable) .or. is_set(policy)) return
    used = readlink('/proc/self/exe'//c_null_char, program_path, &
                    int(longest_path - 1, c_size_t))
    if (used < 1) return
    arguments_given = command_argument_count()
    allocate (first(0:arguments_given), arguments(0:arguments_given + 1))
    length = 0
    do argument = 0, arguments_given
      first(argument) = length + 1
      length = length + length_of(argument) + 1
    end do
    allocate (character(len=length, kind=c_char) :: text)
    text = repeat(c_null_char, length)
    do argument = 0, arguments_given
      associate (from => first(argument), to => first(argument) + length_of(argument) - 1)
        if (to >= from) call get_command_argument(argument, text(from:to))
        arguments(argument) = c_loc(text(from:from))
      end associate
    end do
    arguments(arguments_given + 1) = c_null_ptr
    if (setenv(variable//c_null_char, turns//c_null_char, 0_c_int) /= 0) return
    ! Comes back only if it fails
    status = execv(program_path(:used)//c_null_char, arguments)
  end subroutine wait_briefly

  function is_set(name) result(answer)
    character(len=*), intent(in) :: name
    logical :: answer
    integer :: status

    call get_environment_variable(name, status=status)
    answer = status /= 1
  end function is_set

  function length_of(argument) result(length)
    integer, intent(in) :: argument
    integer :: length

    call get_command_argument(argument, length=length)
  end function length_of

end module brief_waiting
