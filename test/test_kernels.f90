!> Tests of the smoothing kernels, each test over the whole table.
module test_kernels
  use calor_choice, only: choice_names
  use calor_constants, only: pi
  use calor_error, only: error_t, status_bad_input
  use calor_kernel, only: kernel_t
  use calor_kernels, only: kernel_choices, make_kernel
  use calor_kinds, only: wp
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_kernels

  !> All knots of all kernels in units of 1/6 of the support radius
  integer, parameter :: pieces = 6

contains

  subroutine collect_kernels(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('every kernel of the table can be made', test_table), &
                new_unittest('integral over the plane is one', test_normalisation), &
                new_unittest('first derivative against differences', test_first_derivative), &
                new_unittest('second derivative against differences', test_second_derivative), &
                new_unittest('positive inside, zero outside', test_support), &
                new_unittest('continuous at the knots', test_knots), &
                new_unittest('slope over distance is finite at the centre', test_centre), &
                new_unittest('Wendland values at half the support', test_known_values), &
                new_unittest('dimensional value and derivatives', test_dimensional), &
                new_unittest('an unknown name is refused with advice', test_unknown) &
                ]
  end subroutine collect_kernels

  subroutine test_table(error)
    type(error_type), allocatable, intent(out) :: error
    class(kernel_t), allocatable :: kernel
    type(error_t), allocatable :: failure
    integer :: k

    do k = 1, size(kernel_choices)
      call make_kernel(trim(kernel_choices(k)%name), kernel, failure)
      if (allocated(failure)) then
        call test_failed(error, failure%message)
        return
      end if
      call check(error, len_trim(kernel_choices(k)%summary) > 0, 'a kernel has no summary')
      if (allocated(error)) return
    end do
    call check(error, size(kernel_choices), 5)
  end subroutine test_table

  subroutine test_normalisation(error)
    type(error_type), allocatable, intent(out) :: error
    class(kernel_t), allocatable :: kernel
    ! Gauss–Legendre, six points: exact for polynomials of degree 11 on each piece
    real(wp), parameter :: abscissa(6) = [ &
                           -0.932469514203152027_wp, -0.661209386466264514_wp, &
                           -0.238619186083196909_wp, 0.238619186083196909_wp, &
                           0.661209386466264514_wp, 0.932469514203152027_wp]
    real(wp), parameter :: weight(6) = [ &
                           0.171324492379170345_wp, 0.360761573048138608_wp, &
                           0.467913934572691047_wp, 0.467913934572691047_wp, &
                           0.360761573048138608_wp, 0.171324492379170345_wp]
    real(wp) :: q(6), f(6), df(6), ddf(6), integral
    integer :: k, piece

    do k = 1, size(kernel_choices)
      call make_named(k, kernel)
      integral = 0
      do piece = 1, pieces
        q = (piece - 0.5_wp + 0.5_wp*abscissa)/pieces
        call kernel%profile(q, f, df, ddf)
        integral = integral + pi/pieces*sum(weight*f*q)
      end do
      call check(error, integral, 1.0_wp, thr=1.0e-13_wp, more=kernel_choices(k)%name)
      if (allocated(error)) return
    end do
  end subroutine test_normalisation

  subroutine test_first_derivative(error)
    type(error_type), allocatable, intent(out) :: error

    call compare_with_differences(error, second=.false.)
  end subroutine test_first_derivative

  subroutine test_second_derivative(error)
    type(error_type), allocatable, intent(out) :: error

    call compare_with_differences(error, second=.true.)
  end subroutine test_second_derivative

  !> Fourth-order differences at places clear of the knots.
  subroutine compare_with_differences(error, second)
    type(error_type), allocatable, intent(out) :: error
    !> Whether f'' is compared with differences of f', or f' with those of f
    logical, intent(in) :: second
    class(kernel_t), allocatable :: kernel
    real(wp), parameter :: step = 1.0e-3_wp
    real(wp) :: q(5), f(5), df(5), ddf(5), difference, exact
    integer :: j, k

    do k = 1, size(kernel_choices)
      call make_named(k, kernel)
      do j = 0, 59
        q = (j + 0.5_wp)/60 + step*[-2, -1, 0, 1, 2]
        call kernel%profile(q, f, df, ddf)
        if (second) then
          difference = slope(df)
          exact = ddf(3)
        else
          difference = slope(f)
          exact = df(3)
        end if
        call check(error, difference, exact, thr=1.0e-7_wp, more=kernel_choices(k)%name)
        if (allocated(error)) return
      end do
    end do

  contains

    pure function slope(values)
      real(wp), intent(in) :: values(5)
      real(wp) :: slope

      slope = (values(1) - 8*values(2) + 8*values(4) - values(5))/(12*step)
    end function slope

  end subroutine compare_with_differences

  subroutine test_support(error)
    type(error_type), allocatable, intent(out) :: error
    class(kernel_t), allocatable :: kernel
    real(wp) :: q(100), f(100), df(100), ddf(100)
    integer :: j, k

    do k = 1, size(kernel_choices)
      call make_named(k, kernel)
      q = [((j - 1)/100.0_wp, j=1, 100)]
      call kernel%profile(q, f, df, ddf)
      call check(error, all(f > 0), trim(kernel_choices(k)%name)//' is not positive inside')
      if (allocated(error)) return
      call check(error, all(df(2:) < 0), trim(kernel_choices(k)%name)//' does not decrease')
      if (allocated(error)) return
      q = [(1 + (j - 1)*0.37_wp, j=1, 100)]
      call kernel%profile(q, f, df, ddf)
      call check(error, all(abs(f) + abs(df) + abs(ddf) <= 0), &
                 trim(kernel_choices(k)%name)//' is not zero at and beyond its support')
      if (allocated(error)) return
    end do
  end subroutine test_support

  subroutine test_knots(error)
    type(error_type), allocatable, intent(out) :: error
    class(kernel_t), allocatable :: kernel
    real(wp), parameter :: knots(4) = [1/3.0_wp, 0.5_wp, 2/3.0_wp, 1.0_wp]
    real(wp), parameter :: step = 1.0e-9_wp
    real(wp) :: f(2), df(2), ddf(2), jump
    integer :: j, k

    do k = 1, size(kernel_choices)
      call make_named(k, kernel)
      do j = 1, size(knots)
        call kernel%profile(knots(j) + [-step, step], f, df, ddf)
        jump = max(abs(f(1) - f(2)), abs(df(1) - df(2)), abs(ddf(1) - ddf(2)))
        call check(error, jump < 1.0e-5_wp, &
                   trim(kernel_choices(k)%name)//' jumps at a knot')
        if (allocated(error)) return
      end do
    end do
  end subroutine test_knots

  subroutine test_centre(error)
    type(error_type), allocatable, intent(out) :: error
    class(kernel_t), allocatable :: kernel
    real(wp), parameter :: q(4) = [1.0e-3_wp, 1.0e-8_wp, 1.0e-14_wp, 1.0e-100_wp]
    real(wp) :: f(4), df(4), ddf(4), f0(1), df0(1), ddf0(1)
    integer :: k

    do k = 1, size(kernel_choices)
      call make_named(k, kernel)
      call kernel%profile(q, f, df, ddf)
      call kernel%profile([0.0_wp], f0, df0, ddf0)
      call check(error, abs(df0(1)) <= 0, trim(kernel_choices(k)%name)//' has a cusp')
      if (allocated(error)) return
      ! f'/q goes to f''(0)
      call check(error, all(abs(df/q - ddf0(1)) <= abs(ddf0(1))*(6*q + 1.0e-14_wp)), &
                 trim(kernel_choices(k)%name)//': f''/q does not go to f''''(0)')
      if (allocated(error)) return
    end do
  end subroutine test_centre

  subroutine test_known_values(error)
    type(error_type), allocatable, intent(out) :: error
    class(kernel_t), allocatable :: kernel
    type(error_t), allocatable :: failure

    ! (1/2)⁶ (35/12 + 3 + 1) = 83/768
    call make_kernel('wendland_c4', kernel, failure)
    call check(error, kernel%value(0.5_wp, 1.0_wp), 9/pi*83/768.0_wp, thr=1.0e-15_wp)
    if (allocated(error)) return
    ! (1/2)⁸ (4 + 25/4 + 4 + 1) = 61/1024
    call make_kernel('wendland_c6', kernel, failure)
    call check(error, kernel%value(0.5_wp, 1.0_wp), 78/(7*pi)*61/1024.0_wp, thr=1.0e-15_wp)
    if (allocated(error)) return
    call make_kernel('cubic_spline', kernel, failure)
    call check(error, kernel%value(0.0_wp, 2.0_wp), 10/(7*pi), thr=1.0e-15_wp)
    if (allocated(error)) return
    call make_kernel('quintic_spline', kernel, failure)
    call check(error, kernel%value(0.0_wp, 3.0_wp), 7*66/(478*pi), thr=1.0e-15_wp)
  end subroutine test_known_values

  subroutine test_dimensional(error)
    type(error_type), allocatable, intent(out) :: error
    class(kernel_t), allocatable :: kernel
    real(wp), parameter :: h = 0.3_wp, r = 0.13_wp, step = 1.0e-5_wp
    integer :: k

    do k = 1, size(kernel_choices)
      call make_named(k, kernel)
      call check(error, kernel%derivative(r, h), &
                 (kernel%value(r + step, h) - kernel%value(r - step, h))/(2*step), thr=1.0e-5_wp)
      if (allocated(error)) return
      call check(error, kernel%second_derivative(r, h), &
                 (kernel%derivative(r + step, h) - kernel%derivative(r - step, h))/(2*step), &
                 thr=1.0e-4_wp)
      if (allocated(error)) return
    end do
  end subroutine test_dimensional

  subroutine test_unknown(error)
    type(error_type), allocatable, intent(out) :: error
    class(kernel_t), allocatable :: kernel
    type(error_t), allocatable :: failure

    call make_kernel('wendland_c3', kernel, failure)
    call check(error, allocated(failure), 'an unknown kernel was made')
    if (allocated(error)) return
    call check(error, failure%status, status_bad_input)
    if (allocated(error)) return
    call check(error, index(failure%message, 'Did you mean ''wendland_c') > 0, failure%message)
    if (allocated(error)) return
    call check(error, size(choice_names(kernel_choices)), size(kernel_choices))
  end subroutine test_unknown

  subroutine make_named(k, kernel)
    integer, intent(in) :: k
    class(kernel_t), allocatable, intent(out) :: kernel
    type(error_t), allocatable :: failure

    call make_kernel(trim(kernel_choices(k)%name), kernel, failure)
  end subroutine make_named

end module test_kernels
