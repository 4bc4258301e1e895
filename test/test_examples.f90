!> Runs the programs of example/ and looks at the numbers that they print.
module test_examples
  use calor_kinds, only: wp
  use test_process, only: outcome_t, run_command, environment_or, number_after, contents_of
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_examples

  character(len=*), parameter :: folder = 'build/test/examples'

  !> Every example; each has a test below
  character(len=*), parameter :: examples(*) = [character(len=20) :: 'heat_in_ten_lines', &
      'laplacian_of_a_field', 'neighbour_list', 'own_kernel', 'own_scheme', 'error_table', &
      'operator_table', 'field_as_text', 'scene_reference', 'hard_cases', 'convergence_table', &
      'own_effect', 'verification_table', 'two_slabs']

contains

  subroutine collect_examples(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('no example is forgotten', test_all_known), &
                new_unittest('heat_in_ten_lines', test_heat_in_ten_lines), &
                new_unittest('laplacian_of_a_field', test_laplacian_of_a_field), &
                new_unittest('neighbour_list', test_neighbour_list), &
                new_unittest('own_kernel', test_own_kernel), &
                new_unittest('own_scheme', test_own_scheme), &
                new_unittest('error_table', test_error_table), &
                new_unittest('operator_table', test_operator_table), &
                new_unittest('field_as_text', test_field_as_text), &
                new_unittest('hard_cases', test_hard_cases), &
                new_unittest('convergence_table', test_convergence_table), &
                new_unittest('own_effect', test_own_effect), &
                new_unittest('verification_table', test_verification_table), &
                new_unittest('two_slabs', test_two_slabs), &
                new_unittest('scene_reference', test_scene_reference) &
                ]
  end subroutine collect_examples

  subroutine test_all_known(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    character(len=:), allocatable :: rest, name
    integer :: stop

    call execute_command_line('mkdir -p '//folder)
    call run_command('ls example/*.f90', folder//'/list', outcome)
    call check(error, outcome%status, 0)
    if (allocated(error)) return
    rest = outcome%output
    do
      stop = index(rest, new_line('a'))
      if (stop == 0) exit
      name = rest(len('example/') + 1:stop - len('.f90') - 1)
      rest = rest(stop + 1:)
      call check(error, any(examples == name), 'example/'//name//'.f90 has no test')
      if (allocated(error)) return
    end do
  end subroutine test_all_known

  !> Run an example, which must print no error.
  subroutine run_example(name, outcome, error, arguments)
    character(len=*), intent(in) :: name
    type(outcome_t), intent(out) :: outcome
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in), optional :: arguments
    character(len=:), allocatable :: given

    call execute_command_line('mkdir -p '//folder)
    given = ''
    if (present(arguments)) given = ' '//arguments
    call run_command('"'//environment_or('CALOR_EXAMPLES', 'build/examples')//'"/'//name//given, &
                     folder//'/'//name, outcome)
    call check(error, outcome%status, 0, name//': '//outcome%errors)
    if (allocated(error)) return
    call check(error, outcome%errors, '')
  end subroutine run_example

  !> Fail unless the number behind a phrase lies between two others.
  subroutine check_number(error, outcome, phrase, lowest, highest)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t), intent(in) :: outcome
    character(len=*), intent(in) :: phrase
    real(wp), intent(in) :: lowest, highest
    real(wp) :: number

    number = number_after(outcome%output, phrase)
    if (number >= lowest .and. number <= highest) return
    call test_failed(error, 'Wrong number after "'//phrase//'" in:'//new_line('a')//outcome%output)
  end subroutine check_number

  subroutine test_convergence_table(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call run_example('convergence_table', outcome, error, folder//'/convergence.svg 3')
    if (allocated(error)) return
    call check_number(error, outcome, 'only fatehi_manzari (', 0.9_wp, 1.1_wp)
    if (allocated(error)) return
    call check(error, contents_of(folder//'/convergence.svg') /= '', 'there is no picture')
  end subroutine test_convergence_table

  subroutine test_heat_in_ten_lines(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call run_example('heat_in_ten_lines', outcome, error)
    if (allocated(error)) return
    call check_number(error, outcome, 'particle is at', 0.370_wp, 0.375_wp)
    if (allocated(error)) return
    call check_number(error, outcome, 'relative L2 error', 1.0e-5_wp, 2.0e-3_wp)
  end subroutine test_heat_in_ten_lines

  subroutine test_laplacian_of_a_field(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    character(len=*), parameter :: phrase = '  relative L2 error'

    call run_example('laplacian_of_a_field', outcome, error)
    if (allocated(error)) return
    call check_number(error, outcome, 'fatehi_manzari           '//phrase, 1.0e-4_wp, 1.0e-2_wp)
    if (allocated(error)) return
    call check_number(error, outcome, 'brookshaw                '//phrase, 1.0_wp, 100.0_wp)
  end subroutine test_laplacian_of_a_field

  subroutine test_neighbour_list(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    real(wp) :: found, expected

    call run_example('neighbour_list', outcome, error)
    if (allocated(error)) return
    expected = number_after(outcome%output, 'neighbours on average,')
    found = number_after(outcome%output, ' s'//new_line('a'))
    call check(error, found, expected, thr=0.01_wp, rel=.true.)
    if (allocated(error)) return
    call check_number(error, outcome, 'the nearest at', 0.0_wp, 0.002_wp)
  end subroutine test_neighbour_list

  subroutine test_own_kernel(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call run_example('own_kernel', outcome, error)
    if (allocated(error)) return
    call check_number(error, outcome, 'quadratic field:', 0.0_wp, 1.0e-8_wp)
  end subroutine test_own_kernel

  subroutine test_own_scheme(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call run_example('own_scheme', outcome, error)
    if (allocated(error)) return
    call check_number(error, outcome, 'on a lattice:', 2.5e-4_wp, 2.5e-3_wp)
    if (allocated(error)) return
    call check_number(error, outcome, 'off it:', 0.5_wp, 100.0_wp)
  end subroutine test_own_scheme

  !> The last row of the table, that of the most irregular cloud
  subroutine test_error_table(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call run_example('error_table', outcome, error)
    if (allocated(error)) return
    call check_number(error, outcome, '| 0.3 | 2.1 |', 1.0e-1_wp, 2.5e-1_wp)
    if (allocated(error)) return
    call check_number(error, outcome, '| 0.0 | 2.1 | 2.4E-2 / 2.1E-2 / 2.0E-2 |', 3.9e-3_wp, &
                      4.1e-3_wp)
  end subroutine test_error_table

  subroutine test_operator_table(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call run_example('operator_table', outcome, error)
    if (allocated(error)) return
    call check_number(error, outcome, '| 0.0 | 1.2 | 9.9E-1 / 8.9E-1 / 8.4E-1 |', 9.0e-3_wp, &
                      1.1e-2_wp)
    if (allocated(error)) return
    call check_number(error, outcome, '| 0.3 | 2.1 |', 1.7_wp, 3.7_wp)
  end subroutine test_operator_table

  subroutine test_field_as_text(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call run_example('field_as_text', outcome, error, 'data/plate.nml')
    if (allocated(error)) return
    ! The first particle is the corner, which is held at zero.
    call check_number(error, outcome, '# t =', 0.05_wp, 0.05_wp)
    if (allocated(error)) return
    call check_number(error, outcome, '0.000000000E+00  0.000000000E+00', 0.0_wp, 0.0_wp)
  end subroutine test_field_as_text

  subroutine test_hard_cases(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call run_example('hard_cases', outcome, error)
    if (allocated(error)) return
    call check_number(error, outcome, 'repaired rows 0: largest Re λ Δ²', 1.0_wp, 1.0e5_wp)
    if (allocated(error)) return
    call check_number(error, outcome, 'repaired rows 275: largest Re λ Δ²', -0.0345_wp, -0.034_wp)
    if (allocated(error)) return
    call run_example('hard_cases', outcome, error, arguments='cloud 21 8 1')
    if (allocated(error)) return
    call check(error, index(outcome%output, '# random, made by: hard_cases cloud 21 8 1'), 1)
  end subroutine test_hard_cases

  subroutine test_own_effect(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call run_example('own_effect', outcome, error)
    if (allocated(error)) return
    call check_number(error, outcome, 'temperature / exp(-2) = ', 0.999_wp, 1.001_wp)
  end subroutine test_own_effect

  !> Its status tells whether every scene is within its tolerance.
  subroutine test_verification_table(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call run_example('verification_table', outcome, error)
    if (allocated(error)) return
    call check(error, index(outcome%output, '| nafems_t4 |') > 0, outcome%output)
  end subroutine test_verification_table

  !> What it prints is the table that the scene is compared with.
  subroutine test_two_slabs(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call run_example('two_slabs', outcome, error, '10 | cmp - '// &
                     'data/verification/two_slabs_transient_10.csv')
  end subroutine test_two_slabs

  subroutine test_scene_reference(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call run_example('scene_reference', outcome, error, 'scheme')
    if (allocated(error)) return
    call check(error, index(outcome%output, 'support_growth') > 0 .and. &
               index(outcome%output, 'fatehi_manzari') > 0, outcome%output)
  end subroutine test_scene_reference

end module test_examples
