!> How polynomials go on beyond an interface between two materials.
!>
!> Temperature, flux and ∂u/∂t = L u, L = div(K ∇)/(ρc), are the same on both sides of an interface
!> at all times. So are the temperatures and fluxes of L u, of L²u and so on. For polynomials of
!> degree m about a point of the interface s = η(t), s across it and t along it, that is
!>
!>     Lᵏu                                       up to tᵐ⁻²ᵏ,
!>     n·K∇Lᵏu, n = (1, -dη/dt),                 up to tᵐ⁻²ᵏ⁻¹,   k = 0 … m/2,
!>
!> as many conditions as a polynomial has coefficients: with C the matrix of what they are on either
!> side, the polynomial c goes on as C_B⁻¹C_A c. To degree 2 it is the immersed interface method,
!> R.J. LeVeque, Z. Li, SIAM J. Numer. Anal. 31 (1994) 1019–1044.
module calor_interface_continuation
  use calor_kinds, only: wp
  use calor_lapack, only: dgesv
  implicit none (type, external)
  private

  public :: conduction_at_t, coefficients, coefficient_position, continuation, shifted_monomials

  !> What conducts heat on one side of a point of an interface: N = n·K n, M = n·K t, P = t·K t,
  !> their derivatives along it, and div K across and along it. Beyond degree 2 all of these
  !> derivatives must be 0.
  type :: conduction_at_t
    real(wp) :: n = 0.0_wp, m = 0.0_wp, p = 0.0_wp
    real(wp) :: n_along = 0.0_wp, m_along = 0.0_wp
    real(wp) :: d_across = 0.0_wp, d_along = 0.0_wp
  end type conduction_at_t

contains

  !> Number of coefficients of a polynomial of s and t
  pure function coefficients(degree) result(number)
    integer, intent(in) :: degree
    integer :: number

    number = (degree + 1)*(degree + 2)/2
  end function coefficients

  !> Where the coefficient of sᵃ tᵇ stands: 1, s, t, s², st, t², s³ …
  pure function coefficient_position(a, b) result(position)
    integer, intent(in) :: a, b
    integer :: position

    position = (a + b)*(a + b + 1)/2 + b + 1
  end function coefficient_position

  !> The matrix that takes the coefficients of a polynomial on one side to those of how it goes on
  !> beyond the interface.
  subroutine continuation(degree, here, there, capacity_ratio, curve, matrix)
    !> The degree, at least 1
    integer, intent(in) :: degree
    !> What conducts on either side, in the unit of length of s and t
    type(conduction_at_t), intent(in) :: here, there
    !> ρc beyond over ρc here
    real(wp), intent(in) :: capacity_ratio
    !> η(t) = Σ curve(k) tᵏ, k = 0 … size - 1
    real(wp), intent(in) :: curve(0:)
    !> coefficients(degree) square; no numbers where the conditions are singular
    real(wp), intent(out) :: matrix(:, :)
    real(wp) :: beyond(size(matrix, 1), size(matrix, 1)), scale
    integer :: pivot(size(matrix, 1)), info, k

    call conditions(degree, here, 1.0_wp, curve, matrix)
    call conditions(degree, there, capacity_ratio, curve, beyond)
    do k = 1, size(matrix, 1)
      scale = maxval(abs(beyond(k, :)))
      beyond(k, :) = beyond(k, :)/scale
      matrix(k, :) = matrix(k, :)/scale
    end do
    call dgesv(size(pivot), size(pivot), beyond, size(pivot), pivot, matrix, size(pivot), info)
    if (info /= 0) matrix = 0
  end subroutine continuation

  !> What the conditions are for each sᵃ tᵇ, one a column.
  pure subroutine conditions(degree, side, capacity, curve, matrix)
    integer, intent(in) :: degree
    type(conduction_at_t), intent(in) :: side
    !> ρc in any unit
    real(wp), intent(in) :: capacity
    real(wp), intent(in) :: curve(0:)
    real(wp), intent(out) :: matrix(:, :)
    real(wp) :: u(size(matrix, 1)), eta(0:degree, 0:degree)
    integer :: column, row, k, j, last

    ! The powers of η
    eta = 0
    eta(0, 0) = 1
    last = min(degree, ubound(curve, 1))
    do k = 1, degree
      do j = 0, last
        eta(j:degree, k) = eta(j:degree, k) + curve(j)*eta(0:degree - j, k - 1)
      end do
    end do
    do column = 1, size(matrix, 2)
      u = 0
      u(column) = 1
      row = 0
      do k = 0, degree, 2
        matrix(row + 1:row + degree - k + 1, column) = trace(u, degree - k)
        row = row + degree - k + 1
        if (degree == k) exit
        matrix(row + 1:row + degree - k, column) = flux(u, degree - k - 1)
        row = row + degree - k
        u = rate(u)
      end do
    end do

  contains

    !> u on the interface up to a power of t
    pure function trace(u, power) result(values)
      real(wp), intent(in) :: u(:)
      integer, intent(in) :: power
      real(wp) :: values(0:power)
      integer :: a, b

      values = 0
      do a = 0, degree
        do b = 0, min(power, degree - a)
          values(b:) = values(b:) + u(coefficient_position(a, b))*eta(0:power - b, a)
        end do
      end do
    end function trace

    !> n·K∇u on the interface up to a power of t, times √(1 + (dη/dt)²)
    pure function flux(u, power) result(values)
      real(wp), intent(in) :: u(:)
      integer, intent(in) :: power
      real(wp) :: values(0:power)
      real(wp) :: along(0:power), through(0:power), turned(0:power)
      integer :: j

      through = trace(derivative(u, 1), power)
      along = trace(derivative(u, 2), power)
      values = side%n*through + side%m*along
      values(1:) = values(1:) + side%n_along*through(:power - 1) + side%m_along*along(:power - 1)
      turned = side%m*through + side%p*along
      do j = 1, min(power + 1, ubound(curve, 1))
        values(j - 1:) = values(j - 1:) - j*curve(j)*turned(0:power - j + 1)
      end do
    end function flux

    !> L u
    pure function rate(u) result(du)
      real(wp), intent(in) :: u(:)
      real(wp) :: du(size(u))

      associate (across => derivative(u, 1), along => derivative(u, 2))
        du = (side%n*derivative(across, 1) + 2*side%m*derivative(across, 2) + &
              side%p*derivative(along, 2) + side%d_across*across + side%d_along*along)/capacity
      end associate
    end function rate

    !> ∂u/∂s or ∂u/∂t
    pure function derivative(u, which) result(slope)
      real(wp), intent(in) :: u(:)
      integer, intent(in) :: which
      real(wp) :: slope(size(u))
      integer :: a, b

      slope = 0
      do a = 0, degree - 1
        do b = 0, degree - 1 - a
          if (which == 1) then
            slope(coefficient_position(a, b)) = (a + 1)*u(coefficient_position(a + 1, b))
          else
            slope(coefficient_position(a, b)) = (b + 1)*u(coefficient_position(a, b + 1))
          end if
        end do
      end do
    end function derivative

  end subroutine conditions

  !> The coefficients of each monomial xᵃ yᵇ of degree 0 and more, one a column in the order of
  !> `coefficient_position`, as a polynomial of s and t, where x = x₀ + s n₁ - t n₂ and
  !> y = y₀ + s n₂ + t n₁.
  pure subroutine shifted_monomials(degree, origin, normal, matrix)
    integer, intent(in) :: degree
    !> x₀ and y₀, and n
    real(wp), intent(in) :: origin(2), normal(2)
    !> coefficients(degree) square
    real(wp), intent(out) :: matrix(:, :)
    integer :: a, b

    matrix = 0
    matrix(1, 1) = 1
    do a = 0, degree
      do b = 0, degree - a
        if (a > 0) then
          matrix(:, coefficient_position(a, b)) = &
              times(matrix(:, coefficient_position(a - 1, b)), [origin(1), normal(1), -normal(2)])
        else if (b > 0) then
          matrix(:, coefficient_position(a, b)) = &
              times(matrix(:, coefficient_position(a, b - 1)), [origin(2), normal(2), normal(1)])
        end if
      end do
    end do

  contains

    !> A polynomial times l₁ + l₂ s + l₃ t
    pure function times(u, linear) result(product)
      real(wp), intent(in) :: u(:), linear(3)
      real(wp) :: product(size(u))
      integer :: a, b

      product = linear(1)*u
      do a = 0, degree - 1
        do b = 0, degree - 1 - a
          associate (one => u(coefficient_position(a, b)))
            product(coefficient_position(a + 1, b)) = product(coefficient_position(a + 1, b)) + &
                                                      linear(2)*one
            product(coefficient_position(a, b + 1)) = product(coefficient_position(a, b + 1)) + &
                                                      linear(3)*one
          end associate
        end do
      end do
    end function times

  end subroutine shifted_monomials

end module calor_interface_continuation
