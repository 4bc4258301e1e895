!> Tests of the documents: what they quote is what the programs say.
module test_documents
  use, intrinsic :: iso_fortran_env, only: error_unit
  use testdrive, only: new_unittest, unittest_type, error_type, check
  implicit none (type, external)
  private

  public :: collect_documents

contains

  subroutine collect_documents(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [new_unittest('the documents quote what the programs say', test_quotations), &
                 new_unittest('what the documents have the reader do works', test_sessions)]
  end subroutine collect_documents

  subroutine test_quotations(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: status, command_status

    call execute_command_line('tools/documents.sh --check', exitstat=status, cmdstat=command_status)
    call check(error, command_status, 0)
    if (allocated(error)) return
    call check(error, status, 0, 'make documents brings them up to date')
  end subroutine test_quotations

  !> Needs gnuplot, as the reader does.
  subroutine test_sessions(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: status, command_status

    call execute_command_line('gnuplot --version >build/test/gnuplot_there 2>&1', exitstat=status, &
                              cmdstat=command_status)
    if (status /= 0 .or. command_status /= 0) then
      write (error_unit, '(a)') '    left out: there is no gnuplot'
      return
    end if
    call execute_command_line('tools/sessions.py --check', exitstat=status, cmdstat=command_status)
    call check(error, command_status, 0)
    if (allocated(error)) return
    call check(error, status, 0, 'make documents brings them up to date')
  end subroutine test_sessions

end module test_documents
