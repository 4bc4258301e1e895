!> Runs the test suites of calor-mpi: all of them, one (`-- SUITE`), or one test of one
!> (`-- SUITE TEST`).
program main
  use, intrinsic :: iso_fortran_env, only: error_unit
  use test_agreement, only: collect_agreement
  use test_contract, only: collect_contract
  use test_refusals, only: collect_refusals
  use test_resuming, only: collect_resuming
  use test_sharing, only: collect_sharing
  use testdrive, only: new_testsuite, run_selected, run_testsuite, select_suite, testsuite_type
  implicit none (type, external)

  type(testsuite_type), allocatable :: suites(:)
  character(len=200) :: suite, test
  integer :: failures, k

  suites = [new_testsuite('agreement', collect_agreement), &
            new_testsuite('contract', collect_contract), &
            new_testsuite('refusals', collect_refusals), &
            new_testsuite('resuming', collect_resuming), &
            new_testsuite('sharing', collect_sharing)]
  call get_command_argument(1, suite)
  call get_command_argument(2, test)
  failures = 0
  do k = 1, size(suites)
    if (suite /= '' .and. suites(k)%name /= suite) cycle
    write (error_unit, '(2a)') '# ', suites(k)%name
    if (test == '') then
      call run_testsuite(suites(k)%collect, error_unit, failures, parallel=.false.)
    else
      call run_selected(suites(k)%collect, trim(test), error_unit, failures)
    end if
  end do
  if (failures > 0) error stop 1
end program main
