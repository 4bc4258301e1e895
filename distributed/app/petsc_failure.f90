!> What PETSc cannot do ends the run, with the reason. Without that its procedures return, and the
!> run would go on with numbers that are not there.
module petsc_failure
  use, intrinsic :: iso_c_binding, only: c_char, c_funloc, c_funptr, c_int, c_null_char, &
                                         c_null_ptr, c_ptr
  use, intrinsic :: iso_fortran_env, only: error_unit
  use calor_error, only: status_bad_numbers
  use mpi_f08, only: mpi_abort, mpi_comm_rank, mpi_comm_world
  implicit none (type, external)
  private

  public :: end_run_on_failure

  interface
    integer(c_int) function petscpusherrorhandler(handler, context) &
        bind(c, name='PetscPushErrorHandler')
      import :: c_funptr, c_int, c_ptr
      implicit none (type, external)
      type(c_funptr), intent(in), value :: handler
      type(c_ptr), intent(in), value :: context
    end function petscpusherrorhandler

    integer(c_int) function c_sleep(seconds) bind(c, name='sleep')
      import :: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: seconds
    end function c_sleep
  end interface

contains

  !> After PETSc's initialisation.
  subroutine end_run_on_failure()
    integer(c_int) :: failed

    failed = petscpusherrorhandler(c_funloc(end_run), c_null_ptr)
    if (failed /= 0) error stop 'PETSc takes no error handler.'
  end subroutine end_run_on_failure

  !> Called by PETSc on the rank where something fails; the others are ended with it.
  integer(c_int) function end_run(comm, line, procedure_name, file, code, stage, message, context) &
      bind(c)
    type(c_ptr), value :: comm, context
    integer(c_int), value :: line, code, stage
    ! C's texts end with a null.
    ! allow(C071)
    character(kind=c_char), intent(in) :: procedure_name(*), file(*), message(*)
    integer(c_int) :: seconds
    integer :: rank

    associate (unused => comm, also => context, and => line, too => stage, besides => file(1:1))
    end associate
    ! Where all fail, one says it and ends all: the others give it time.
    call mpi_comm_rank(mpi_comm_world, rank)
    seconds = merge(5_c_int, 0_c_int, rank > 0)
    ! A signal wakes it.
    do while (seconds > 0)
      seconds = c_sleep(seconds)
    end do
    write (error_unit, '(a)') 'calor-mpi: PETSc could not go on in '//text_of(procedure_name)// &
      ': '//text_of(message)
    end_run = code
    call mpi_abort(mpi_comm_world, status_bad_numbers)
  end function end_run

  pure function text_of(letters) result(text)
    ! allow(C071)
    character(kind=c_char), intent(in) :: letters(*)
    character(len=:), allocatable :: text
    integer :: k

    text = ''
    k = 1
    do while (letters(k) /= c_null_char)
      text = text//letters(k)
      k = k + 1
    end do
  end function text_of

end module petsc_failure
