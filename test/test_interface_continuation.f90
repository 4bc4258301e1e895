!> Tests of how polynomials go on beyond an interface.
module test_interface_continuation
  use calor_interface_continuation, only: conduction_at_t, coefficients, coefficient_position, &
      continuation, shifted_monomials
  use calor_kinds, only: wp
  use calor_text, only: to_text
  use testdrive, only: new_unittest, unittest_type, error_type, check
  implicit none (type, external)
  private

  public :: collect_interface_continuation

contains

  subroutine collect_interface_continuation(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('one material', test_one_material), &
                new_unittest('waves through a straight interface', test_waves), &
                new_unittest('past a cylinder: order', test_cylinder), &
                new_unittest('monomials about another point', test_shifted)]
  end subroutine collect_interface_continuation

  !> Where there is no difference, nothing changes, however the interface bends.
  subroutine test_one_material(error)
    type(error_type), allocatable, intent(out) :: error
    type(conduction_at_t), parameter :: side = conduction_at_t(n=2.0_wp, m=0.5_wp, p=1.0_wp)
    real(wp) :: matrix(coefficients(5), coefficients(5))
    integer :: k

    call continuation(5, side, side, 1.0_wp, [0.01_wp, 0.1_wp, 0.4_wp, -0.2_wp, 0.3_wp], matrix)
    do k = 1, size(matrix, 1)
      matrix(k, k) = matrix(k, k) - 1
    end do
    call check(error, maxval(abs(matrix)) < 1.0e-11_wp, to_text(maxval(abs(matrix))))
  end subroutine test_one_material

  !> exp(i k t + λ s) with L u = μ u on one side goes on as two such waves on the other, whose
  !> Taylor coefficients are known: tensors and capacities differ, to degree 8.
  subroutine test_waves(error)
    type(error_type), allocatable, intent(out) :: error
    type(conduction_at_t), parameter :: sides(4) = [ &
        conduction_at_t(n=1.0_wp, m=0.0_wp, p=1.0_wp), &
        conduction_at_t(n=1000.0_wp, m=0.0_wp, p=1000.0_wp), &
        conduction_at_t(n=2.0_wp, m=0.7_wp, p=0.5_wp), &
        conduction_at_t(n=0.3_wp, m=-0.4_wp, p=1.5_wp)]
    real(wp), parameter :: k = 0.7_wp, mu = -1.3_wp
    integer, parameter :: degrees(3) = [2, 5, 8]
    complex(wp) :: here(coefficients(8)), there(coefficients(8)), found(coefficients(8))
    complex(wp) :: own(2), beyond(2), amplitude, flux
    real(wp), allocatable :: matrix(:, :)
    real(wp) :: ratio
    integer :: a, b, j, m

    do a = 1, size(sides)
      do b = 1, size(sides)
        ratio = merge(1.0_wp, 0.4_wp*b + 1.0_wp/a, a == b)
        own = exponents(sides(a), 1.0_wp)
        beyond = exponents(sides(b), ratio)
        call expand(own(1), here)
        flux = sides(a)%n*own(1) + (sides(a)%m - sides(b)%m)*cmplx(0, k, wp)
        amplitude = (flux/sides(b)%n - beyond(2))/(beyond(1) - beyond(2))
        call expand(beyond(1), there)
        call expand(beyond(2), found)
        there = amplitude*there + (1 - amplitude)*found
        do j = 1, size(degrees)
          m = coefficients(degrees(j))
          allocate (matrix(m, m))
          call continuation(degrees(j), sides(a), sides(b), ratio, [0.0_wp], matrix)
          found(:m) = matmul(matrix, here(:m))
          ! To rounding: from a good conductor to a bad one large terms cancel.
          call check(error, all(abs(found(:m) - there(:m)) <= 1.0e-13_wp* &
                                (matmul(abs(matrix), abs(here(:m))) + maxval(abs(there(:m))))), &
                     to_text(a)//' '//to_text(b)//' degree '//to_text(degrees(j))//': '// &
                     to_text(maxval(abs(found(:m) - there(:m)))))
          if (allocated(error)) return
          deallocate (matrix)
        end do
      end do
    end do

  contains

    !> λ of N λ² + 2 i M k λ - P k² = μ ρc
    pure function exponents(side, capacity) result(lambda)
      type(conduction_at_t), intent(in) :: side
      real(wp), intent(in) :: capacity
      complex(wp) :: lambda(2)
      complex(wp) :: middle, root

      middle = -cmplx(0, side%m*k/side%n, wp)
      root = sqrt(middle**2 + (side%p*k**2 + mu*capacity)/side%n)
      lambda = [middle + root, middle - root]
    end function exponents

    !> Taylor coefficients of exp(i k t + λ s)
    pure subroutine expand(lambda, series)
      complex(wp), intent(in) :: lambda
      complex(wp), intent(out) :: series(:)
      integer :: a, b

      do a = 0, 8
        do b = 0, 8 - a
          series(coefficient_position(a, b)) = lambda**a*cmplx(0, k, wp)**b/ &
                                               (gamma(a + 1.0_wp)*gamma(b + 1.0_wp))
        end do
      end do
    end subroutine expand

  end subroutine test_waves

  !> A uniform gradient within a cylinder goes on as x + B x/r² outside: what the polynomial misses
  !> at a distance h grows like its degree plus one. So it is for the way back.
  subroutine test_cylinder(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: inner = 10.0_wp, outer = 1.0_wp, angle = 0.4_wp
    real(wp), parameter :: normal(2) = [cos(angle), sin(angle)]
    real(wp), parameter :: b = (outer - inner)/(outer + inner), a = 2*outer/(outer + inner)
    ! s = -t²/2 - t⁴/8 - t⁶/16, s outwards, the radius 1
    real(wp), parameter :: circle(0:6) = [0.0_wp, 0.0_wp, -0.5_wp, 0.0_wp, -0.125_wp, 0.0_wp, &
                                          -0.0625_wp]
    type(conduction_at_t), parameter :: inside = conduction_at_t(n=inner, p=inner), &
        outside = conduction_at_t(n=outer, p=outer)
    real(wp), allocatable :: matrix(:, :), within(:)
    real(wp) :: missed(2), order
    integer :: degree, k

    do degree = 2, 6
      allocate (matrix(coefficients(degree), coefficients(degree)), within(coefficients(degree)))
      call continuation(degree, inside, outside, 2.0_wp, circle, matrix)
      within = 0
      within(:3) = a*[normal(1), normal(1), -normal(2)]
      within = matmul(matrix, within)
      missed = [(miss(0.1_wp/2**k), k=0, 1)]
      order = log(missed(1)/missed(2))/log(2.0_wp)
      call check(error, order > degree + 0.7_wp .and. missed(2) < 1.0e-3_wp, 'degree '// &
                 to_text(degree)//': order '//to_text(order, digits=3)//', '//to_text(missed(2)))
      if (allocated(error)) return
      ! Normals point to the other side: s and t change their signs.
      call continuation(degree, outside, inside, 0.5_wp, -circle, matrix)
      within = matmul(matrix, turned(within))
      within = turned(within)
      within(:3) = within(:3) - a*[normal(1), normal(1), -normal(2)]
      call check(error, maxval(abs(within)) < 1.0e-11_wp, 'the way back')
      if (allocated(error)) return
      deallocate (matrix, within)
    end do

  contains

    !> The largest error at four points outside, h from a point of the circle
    pure function miss(h) result(largest)
      real(wp), intent(in) :: h
      real(wp) :: largest
      real(wp) :: s, t, x, y, value
      integer :: k, i, j

      largest = 0
      do k = 1, 4
        s = h*sin(0.3_wp + 0.6_wp*k)
        t = h*cos(0.3_wp + 0.6_wp*k)
        x = (1 + s)*normal(1) - t*normal(2)
        y = (1 + s)*normal(2) + t*normal(1)
        value = 0
        do i = 0, degree
          do j = 0, degree - i
            value = value + within(coefficient_position(i, j))*s**i*t**j
          end do
        end do
        largest = max(largest, abs(value - x*(1 + b/(x**2 + y**2))))
      end do
    end function miss

    pure function turned(u) result(v)
      real(wp), intent(in) :: u(:)
      real(wp) :: v(size(u))
      integer :: i, j

      do i = 0, degree
        do j = 0, degree - i
          v(coefficient_position(i, j)) = (-1)**(i + j)*u(coefficient_position(i, j))
        end do
      end do
    end function turned

  end subroutine test_cylinder

  !> x³y² about another point and along other axes
  subroutine test_shifted(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: origin(2) = [0.3_wp, -0.2_wp], normal(2) = [0.6_wp, 0.8_wp]
    real(wp), parameter :: s = 0.7_wp, t = -0.4_wp
    real(wp) :: matrix(coefficients(5), coefficients(5)), value
    integer :: a, b

    call shifted_monomials(5, origin, normal, matrix)
    value = 0
    do a = 0, 5
      do b = 0, 5 - a
        value = value + matrix(coefficient_position(a, b), coefficient_position(3, 2))*s**a*t**b
      end do
    end do
    associate (x => origin(1) + s*normal(1) - t*normal(2), &
               y => origin(2) + s*normal(2) + t*normal(1))
      call check(error, value, x**3*y**2, thr=1.0e-14_wp)
    end associate
  end subroutine test_shifted

end module test_interface_continuation
