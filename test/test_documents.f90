!> Tests of the documents: what they quote is what the programs say.
module test_documents
  use testdrive, only: new_unittest, unittest_type, error_type, check
  implicit none (type, external)
  private

  public :: collect_documents

contains

  subroutine collect_documents(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [new_unittest('the documents quote what the programs say', test_quotations)]
  end subroutine collect_documents

  subroutine test_quotations(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: status, command_status

    call execute_command_line('tools/documents.sh --check', exitstat=status, cmdstat=command_status)
    call check(error, command_status, 0)
    if (allocated(error)) return
    call check(error, status, 0, 'make documents brings them up to date')
  end subroutine test_quotations

end module test_documents
