!> Runs that choose scheme, order, spacing and steps for a wanted error.
module test_accuracy_target
  use calor_accuracy_target, only: target_search_t
  use calor_error, only: error_t, status_bad_input, status_bad_numbers
  use calor_kinds, only: wp
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene
  use calor_text, only: to_text
  use test_field_reader, only: reals_in_file
  use testdrive, only: new_unittest, unittest_type, test_error => error_type, check
  implicit none (type, external)
  private

  public :: collect_accuracy_target

  !> The true error may exceed the target by so much
  real(wp), parameter :: slack = 1.25_wp

contains

  subroutine collect_accuracy_target(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('targets from 1e-2 to 1e-7', test_targets), &
                new_unittest('changing walls', test_changing_walls), &
                new_unittest('a steady temperature', test_steady), &
                new_unittest('a file is written once, whole', test_file), &
                new_unittest('a fixed cloud: what cannot be reached is said', test_fixed_cloud), &
                new_unittest('too few particles for coarse pilots', test_small_body), &
                new_unittest('out of reach', test_out_of_reach) &
                ]
  end subroutine collect_accuracy_target

  pure function plate(target, arrangement, more) result(text)
    real(wp), intent(in) :: target
    character(len=*), intent(in) :: arrangement, more
    character(len=:), allocatable :: text

    text = '&scene exact_expression = "sin(pi*x)*sin(pi*y)*exp(-2*pi^2*t)" / '// &
           '&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.025 arrangement = "'// &
           arrangement//'" / &time end = 0.05 / '// &
           '&initial temperature_expression = "sin(pi*x)*sin(pi*y)" / '// &
           '&boundary on = "all" kind = "temperature" value = 0 / &accuracy target = '// &
           to_text(target)//' / '//more
  end function plate

  subroutine search_for(text, search, error)
    character(len=*), intent(in) :: text
    type(target_search_t), intent(out) :: search
    type(test_error), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(error_t), allocatable :: failure

    call interpret_scene(text, scene, failure)
    if (.not. allocated(failure)) call search%reach(scene, failure)
    if (allocated(failure)) call check(error, .false., failure%message)
  end subroutine search_for

  subroutine test_targets(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=8), parameter :: arrangements(*) = [character(len=8) :: 'lattice', 'jittered']
    type(target_search_t) :: search
    real(wp) :: target
    integer :: k, exponent

    do k = 1, size(arrangements)
      do exponent = 2, 7
        target = 10.0_wp**(-exponent)
        call search_for(plate(target, trim(arrangements(k)), ''), search, error)
        if (allocated(error)) return
        call check(error, search%simulation%estimated_error() <= target)
        if (allocated(error)) return
        call check(error, search%simulation%relative_l2_error() <= slack*target, &
                   trim(arrangements(k))//', target '//to_text(target)//': true error '// &
                   to_text(search%simulation%relative_l2_error(), digits=3))
        if (allocated(error)) return
        ! Whatever was chosen has been searched for unstable modes.
        call check(error, search%simulation%rightmost%method /= '')
        if (allocated(error)) return
      end do
      ! High accuracy is not bought by second order.
      call check(error, search%simulation%scene%laplacian, 'consistent')
      if (allocated(error)) return
    end do
  end subroutine test_targets

  subroutine test_changing_walls(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=*), parameter :: field = 'exp(-5*t)*cos(x + 1)*sin(2*y)'
    type(target_search_t) :: search

    call search_for('&scene exact_expression = "'//field//'" / &domain x_range = 0, 1 '// &
                    'y_range = 0, 1 arrangement = "jittered" spacing = 0.05 / '// &
                    '&initial temperature_expression = "cos(x + 1)*sin(2*y)" / '// &
                    '&boundary value_expression = "'//field//'" / &time end = 0.1 / '// &
                    '&accuracy target = 1e-5 /', search, error)
    if (allocated(error)) return
    call check(error, search%simulation%relative_l2_error() <= slack*1.0e-5_wp)
  end subroutine test_changing_walls

  subroutine test_steady(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=*), parameter :: field = 'exp(2*x)*sin(2*y)'
    type(target_search_t) :: search
    integer :: exponent

    do exponent = 3, 7, 2
      call search_for('&scene exact_expression = "'//field//'" / &domain x_range = 0, 1 '// &
                      'y_range = 0, 1 arrangement = "jittered" spacing = 0.05 / '// &
                      '&boundary value_expression = "'//field//'" / &boundary on = "top" '// &
                      'kind = "convection" coefficient = 2 ambient_expression = "'//field// &
                      ' + exp(2*x)*cos(2*y)" / &time steady = T / &accuracy target = 1e-'// &
                      to_text(exponent)//' /', search, error)
      if (allocated(error)) return
      call check(error, search%simulation%relative_l2_error() <= slack*10.0_wp**(-exponent), &
                 'target 1e-'//to_text(exponent)//': true error '// &
                 to_text(search%simulation%relative_l2_error(), digits=3))
      if (allocated(error)) return
    end do
  end subroutine test_steady

  subroutine test_file(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=*), parameter :: file = 'build/test/target.vtkhdf'
    type(target_search_t) :: search

    call search_for(plate(1.0e-3_wp, 'jittered', '&output file = "'//file//'" every = 0.025 /'), &
                    search, error)
    if (allocated(error)) return
    call check(error, size(reals_in_file(file, '/VTKHDF/PointData/temperature')), &
               3*search%simulation%cloud%particles())
    if (allocated(error)) return
    call check(error, size(reals_in_file(file, '/VTKHDF/PointData/error_estimate')), &
               3*search%simulation%cloud%particles())
  end subroutine test_file

  subroutine test_fixed_cloud(error)
    type(test_error), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(target_search_t) :: search
    type(error_t), allocatable :: failure

    call interpret_scene('&domain shape = "cloud" file = "data/hard/holed.csv" '// &
                         'spacing = 0.05 / '// &
                         '&initial temperature_expression = "sin(7*x)*sin(9*y)" / '// &
                         '&boundary value = 0 / &time end = 0.01 / '// &
                         '&accuracy target = 1e-12 /', scene, failure)
    if (.not. allocated(failure)) call search%reach(scene, failure)
    call check(error, allocated(failure))
    if (allocated(error)) return
    call check(error, failure%status, status_bad_numbers, failure%message)
    if (allocated(error)) return
    call check(error, index(failure%message, 'not reached: the best estimate is') > 0, &
               failure%message)
  end subroutine test_fixed_cloud

  !> Four times the spacing would leave no particle inside.
  subroutine test_small_body(error)
    type(test_error), allocatable, intent(out) :: error
    type(target_search_t) :: search

    call search_for('&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.3 / &time end = 0.02 / '// &
                    '&initial temperature_expression = "sin(pi*x)*sin(pi*y)" / '// &
                    '&boundary value = 0 / &accuracy target = 1e-2 /', search, error)
    if (allocated(error)) return
    call check(error, search%simulation%estimated_error() <= 1.0e-2_wp)
  end subroutine test_small_body

  !> A jump at the walls leaves errors that refining hardly removes.
  subroutine test_out_of_reach(error)
    type(test_error), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(target_search_t) :: search
    type(error_t), allocatable :: failure

    call interpret_scene('&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.4 / '// &
                         '&time end = 0.001 / &initial temperature = 1 / &boundary value = 0 / '// &
                         '&accuracy target = 1e-14 /', scene, failure)
    if (.not. allocated(failure)) call search%reach(scene, failure)
    call check(error, allocated(failure))
    if (allocated(error)) return
    call check(error, index(failure%message, 'not reached') > 0, failure%message)
  end subroutine test_out_of_reach

end module test_accuracy_target
