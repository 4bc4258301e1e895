!> Runs the test suites: all of them, one (`-- SUITE`), or one test of one suite (`-- SUITE TEST`).
!>
!> One test after another: test-drive would run them side by side under OpenMP, but HDF5 is not
!> thread-safe, tests measure, and a parallel loop inside a test should get its threads.
program main
  use, intrinsic :: iso_fortran_env, only: error_unit
  use calor_hdf5, only: skip_hdf5_cleanup
  use testdrive, only: run_testsuite, new_testsuite, testsuite_type, select_suite, run_selected
  use test_adversity, only: collect_adversity
  use test_accuracy_target, only: collect_accuracy_target
  use test_consistent, only: collect_consistent
  use test_convergence_study, only: collect_convergence_study
  use test_effects, only: collect_effects
  use test_melting, only: collect_melting
  use test_motion, only: collect_motion
  use test_documents, only: collect_documents
  use test_error_estimate, only: collect_error_estimate
  use test_expression, only: collect_expression
  use test_scene_contract, only: collect_scene_contract
  use test_scene_file, only: collect_scene_file
  use test_checkpoint, only: collect_checkpoint
  use test_cloud_file, only: collect_cloud_file
  use test_field_file, only: collect_field_file
  use test_gnuplot, only: collect_gnuplot
  use test_hard_cases, only: collect_hard_cases
  use test_cost_study, only: collect_cost_study
  use test_heat, only: collect_heat
  use test_operators, only: collect_operators
  use test_clouds, only: collect_clouds
  use test_command_line, only: collect_command_line
  use test_examples, only: collect_examples
  use test_implicit, only: collect_implicit
  use test_kernels, only: collect_kernels
  use test_interface_continuation, only: collect_interface_continuation
  use test_heat_content, only: collect_heat_content
  use test_materials, only: collect_materials
  use test_neighbour_list, only: collect_neighbour_list
  use test_plot, only: collect_plot
  use test_guidance, only: collect_guidance
  use test_random, only: collect_random
  use test_row_layouts, only: collect_row_layouts
  use test_shapes, only: collect_shapes
  use test_stable_rows, only: collect_stable_rows
  use test_text, only: collect_text
  use test_time, only: collect_time
  implicit none (type, external)

  type(testsuite_type), allocatable :: suites(:)
  character(len=:), allocatable :: suite_name, test_name
  integer :: failures, k

  suites = [ &
           new_testsuite('text', collect_text), &
           new_testsuite('expression', collect_expression), &
           new_testsuite('scene file', collect_scene_file), &
           new_testsuite('scene contract', collect_scene_contract), &
           new_testsuite('field file', collect_field_file), &
           new_testsuite('gnuplot', collect_gnuplot), &
           new_testsuite('checkpoint', collect_checkpoint), &
           new_testsuite('adversity', collect_adversity), &
           new_testsuite('cloud file', collect_cloud_file), &
           new_testsuite('operators', collect_operators), &
           new_testsuite('row layouts', collect_row_layouts), &
           new_testsuite('time', collect_time), &
           new_testsuite('implicit', collect_implicit), &
           new_testsuite('stable rows', collect_stable_rows), &
           new_testsuite('consistent', collect_consistent), &
           new_testsuite('heat', collect_heat), &
           new_testsuite('error estimate', collect_error_estimate), &
           new_testsuite('accuracy target', collect_accuracy_target), &
           new_testsuite('effects', collect_effects), &
           new_testsuite('melting', collect_melting), &
           new_testsuite('materials', collect_materials), &
           new_testsuite('heat_content', collect_heat_content), &
           new_testsuite('interface continuation', collect_interface_continuation), &
           new_testsuite('motion', collect_motion), &
           new_testsuite('hard cases', collect_hard_cases), &
           new_testsuite('convergence study', collect_convergence_study), &
           new_testsuite('cost study', collect_cost_study), &
           new_testsuite('kernels', collect_kernels), &
           new_testsuite('neighbour list', collect_neighbour_list), &
           new_testsuite('random', collect_random), &
           new_testsuite('clouds', collect_clouds), &
           new_testsuite('shapes', collect_shapes), &
           new_testsuite('documents', collect_documents), &
           new_testsuite('examples', collect_examples), &
           new_testsuite('plot', collect_plot), &
           new_testsuite('guidance', collect_guidance), &
           new_testsuite('command line', collect_command_line) &
           ]

  ! The tests read damaged files, and put theirs into a folder of the build.
  call skip_hdf5_cleanup()
  call execute_command_line('mkdir -p build/test')
  failures = 0
  suite_name = argument(1)
  test_name = argument(2)
  if (suite_name == '') then
    do k = 1, size(suites)
      write (error_unit, '(a)') '# '//suites(k)%name
      call run_testsuite(suites(k)%collect, error_unit, failures, parallel=.false.)
    end do
  else
    k = select_suite(suites, suite_name)
    if (k < 1 .or. k > size(suites)) then
      write (error_unit, '(a)') 'No suite is called '//suite_name//'. There are:'
      do k = 1, size(suites)
        write (error_unit, '(a)') '  '//suites(k)%name
      end do
      error stop 1
    end if
    if (test_name == '') then
      call run_testsuite(suites(k)%collect, error_unit, failures, parallel=.false.)
    else
      call run_selected(suites(k)%collect, test_name, error_unit, failures)
    end if
  end if

  if (failures /= 0) then
    write (error_unit, '(i0,a)') failures, ' test(s) failed'
    error stop 1
  end if

contains

  !> Command-line argument number `position`, or '' if there is none.
  function argument(position) result(text)
    integer, intent(in) :: position
    character(len=:), allocatable :: text
    integer :: length

    call get_command_argument(position, length=length)
    allocate (character(len=length) :: text)
    if (length > 0) call get_command_argument(position, text)
  end function argument

end program main
