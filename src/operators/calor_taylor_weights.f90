!> Weights that reproduce derivatives of all polynomials up to a degree.
!>
!> Of all weights a_ij of a particle's neighbours with Σ a_ij P(r_ji) = (D P)(0) for every monomial
!> P of degree 1 … d, D being the derivative in question, those of least norm Σ a_ij²/ω_ij, where ω
!> is the kernel over the squared distance. With the matrix M = Σ ω P Pᵀ they are a = ω Pᵀ M⁻¹ (D
!> P): renormalization carried on to higher degrees. The weight of the particle itself is -Σ a_ij.
!>
!> On a wall, derivatives along given directions at the particle itself may be further data: each
!> adds a column (n·∇P)(0) with a weight b and a norm weight of its own, as if it were a neighbour.
!>
!> Source: R. Fatehi, M.T. Manzari, Comput. Math. Appl. 61 (2011) 482–498, for the idea; J.R.C.
!> King, S.J. Lind, A.M.A. Nasar, J. Comput. Phys. 415 (2020) 109549, for the class.
module calor_taylor_weights
  use calor_constants, only: pi
  use calor_kinds, only: wp
  use calor_lapack, only: dpstrf, dpotrs
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: taylor_weights, monomials, monomial_position, highest_order, default_order
  public :: highest_degree, most, nearest

  !> The highest order of a scheme
  integer, parameter :: highest_order = 10
  !> Its order where none is asked for
  integer, parameter :: default_order = 4
  !> The highest degree of a polynomial: a Laplacian of order p needs p + 1
  integer, parameter :: highest_degree = highest_order + 1
  !> Number of monomials of degree 1 … highest_degree
  integer, parameter :: most = highest_degree*(highest_degree + 3)/2
  !> Neighbours nearer than this part of the mean distance between neighbours count as if they were
  !> that far away: otherwise a pair that nearly touches would carry the row alone
  real(wp), parameter :: nearest = 0.5_wp
  !> A matrix scaled to a diagonal of ones counts as singular when a pivot of its Cholesky
  !> factorisation is below this
  real(wp), parameter :: smallest_pivot = 1.0e-12_wp
  !> The norm weight of a known derivative, as a multiple of those of all neighbours together
  real(wp), parameter :: cheap = 1.0e3_wp

contains

  !> Number of monomials xᵃ yᵇ with 1 ≤ a + b ≤ degree: d(d + 3)/2
  pure function monomials(degree) result(number)
    integer, intent(in) :: degree
    integer :: number

    number = degree*(degree + 3)/2
  end function monomials

  !> Where xᵃ yᵇ stands in their order: x, y, x², xy, y², x³ …
  pure function monomial_position(a, b) result(position)
    integer, intent(in) :: a, b
    integer :: position

    position = monomials(a + b - 1) + b + 1
  end function monomial_position

  !> Find the weights.
  !>
  !> Where monomials depend on each other at the neighbours, as x⁵ on x and x³ on a lattice, M is
  !> singular. The independent ones, found by pivoting, then give the weights of least norm; the
  !> residual tells whether they reproduce the others too.
  subroutine taylor_weights(stencil, degree, wanted, weight, condition, direction, slope_weight)
    !> The particle's stencil; its `residual` becomes the largest error of a moment in units of the
    !> support radius
    type(stencil_t), intent(inout) :: stencil
    !> Reproduce polynomials up to this degree, 1 … highest_degree
    integer, intent(in) :: degree
    !> (D P)(0) of each monomial P in units of the support radius, one column for each derivative D
    real(wp), intent(in) :: wanted(:, :)
    !> Weights of the neighbours in units of the support radius, one column for each derivative
    real(wp), intent(out) :: weight(:, :)
    !> An estimate of the condition number of M; huge(1.0) where M is singular
    real(wp), intent(out) :: condition
    !> Unit vectors along which first derivatives at the particle are known, one a column
    real(wp), intent(in), optional :: direction(:, :)
    !> The weights of these derivatives, a row for each, a column for each derivative wanted
    real(wp), intent(out), optional :: slope_weight(:, :)
    real(wp), allocatable :: n(:, :), b(:, :)
    real(wp) :: omega(stencil%n), omega_b, matrix(most, most), scaling(most), work(2*most)
    real(wp) :: moment(most), coefficient(most)
    integer :: m, column, time, info, rank, pivot(most)

    m = monomials(degree)
    call weighting(stencil, omega)
    allocate (n(2, 0), b(0, size(wanted, 2)))
    if (present(direction)) then
      n = direction
      deallocate (b)
      allocate (b(size(n, 2), size(wanted, 2)))
    end if
    ! So cheap that first moments along a normal are left to its derivative: neighbours on one side
    ! only could not balance them with positive weights.
    omega_b = cheap*sum(omega*stencil%q(1:stencil%n)**2)
    call moment_matrix(stencil, omega, degree, n, omega_b, matrix, scaling)
    call dpstrf('L', m, matrix, most, pivot, rank, smallest_pivot, work, info)
    condition = huge(1.0_wp)
    if (rank == m) condition = (matrix(1, 1)/matrix(m, m))**2

    stencil%residual = 0
    do column = 1, size(wanted, 2)
      weight(:, column) = 0
      b(:, column) = 0
      ! The second time refines: what rounding left of the moments is mended.
      do time = 1, 2
        call moments(stencil, weight(:, column), degree, n, b(:, column), moment)
        coefficient(1:m) = (wanted(1:m, column) - moment(1:m))*scaling(1:m)
        work(1:rank) = coefficient(pivot(1:rank))
        call dpotrs('L', rank, 1, matrix, most, work, most, info)
        coefficient(1:m) = 0
        coefficient(pivot(1:rank)) = work(1:rank)
        coefficient(1:m) = coefficient(1:m)*scaling(1:m)
        call add_polynomial(stencil, omega, degree, coefficient, weight(:, column))
        b(:, column) = b(:, column) + omega_b*matmul(coefficient(1:2), n)
      end do
      call moments(stencil, weight(:, column), degree, n, b(:, column), moment)
      stencil%residual = max(stencil%residual, maxval(abs(moment(1:m) - wanted(1:m, column))))
    end do
    if (present(slope_weight)) slope_weight = b
  end subroutine taylor_weights

  !> ω = W/|r|², of neighbours that are not much too near
  pure subroutine weighting(stencil, omega)
    type(stencil_t), intent(in) :: stencil
    real(wp), intent(out) :: omega(:)
    real(wp) :: shortest

    shortest = nearest*sqrt(pi/(stencil%n + 1))
    omega = stencil%f(1:stencil%n)/max(stencil%q(1:stencil%n), shortest)**2
  end subroutine weighting

  !> M = Σ ω P Pᵀ, scaled to a diagonal of ones. Its entries are moments of ω of degrees 2 … 2d, of
  !> which there are far fewer than entries.
  pure subroutine moment_matrix(stencil, omega, degree, direction, omega_b, matrix, scaling)
    type(stencil_t), intent(in) :: stencil
    real(wp), intent(in) :: omega(:)
    integer, intent(in) :: degree
    !> Directions of known derivatives, and their norm weight
    real(wp), intent(in) :: direction(:, :), omega_b
    real(wp), intent(out) :: matrix(:, :), scaling(:)
    real(wp) :: moment(0:2*highest_degree, 0:2*highest_degree), power(0:2*highest_degree), x, y
    integer :: k, a, b, c, d, row, column

    moment(0:2*degree, 0:2*degree) = 0
    do k = 1, stencil%n
      ! r_ji = -r_ij
      x = -stencil%q(k)*stencil%ex(k)
      y = -stencil%q(k)*stencil%ey(k)
      power(0) = omega(k)
      do a = 1, 2*degree
        power(a) = power(a - 1)*x
      end do
      do b = 0, 2*degree
        do a = 0, 2*degree - b
          moment(a, b) = moment(a, b) + power(a)
        end do
        power(0:2*degree - b) = power(0:2*degree - b)*y
      end do
    end do
    ! x and y are the only monomials with a derivative at the particle.
    do k = 1, size(direction, 2)
      moment(2, 0) = moment(2, 0) + omega_b*direction(1, k)**2
      moment(1, 1) = moment(1, 1) + omega_b*direction(1, k)*direction(2, k)
      moment(0, 2) = moment(0, 2) + omega_b*direction(2, k)**2
    end do
    do b = 0, degree
      do a = max(0, 1 - b), degree - b
        scaling(monomial_position(a, b)) = 1/sqrt(max(moment(2*a, 2*b), tiny(1.0_wp)))
      end do
    end do
    do d = 0, degree
      do c = max(0, 1 - d), degree - d
        column = monomial_position(c, d)
        do b = 0, degree
          do a = max(0, 1 - b), degree - b
            row = monomial_position(a, b)
            if (row < column) cycle
            matrix(row, column) = moment(a + c, b + d)*scaling(row)*scaling(column)
          end do
        end do
      end do
    end do
  end subroutine moment_matrix

  !> Σ a_j P(r_ji) + Σ b_k (n_k·∇P)(0) of each monomial P
  pure subroutine moments(stencil, weight, degree, direction, slope_weight, moment)
    type(stencil_t), intent(in) :: stencil
    real(wp), intent(in) :: weight(:)
    integer, intent(in) :: degree
    real(wp), intent(in) :: direction(:, :), slope_weight(:)
    real(wp), intent(out) :: moment(:)
    real(wp) :: value(most)
    integer :: k, m

    m = monomials(degree)
    moment(1:m) = 0
    moment(1:2) = matmul(direction, slope_weight)
    do k = 1, stencil%n
      call evaluate_monomials(-stencil%q(k)*stencil%ex(k), -stencil%q(k)*stencil%ey(k), degree, &
                              value)
      moment(1:m) = moment(1:m) + weight(k)*value(1:m)
    end do
  end subroutine moments

  !> a_j ← a_j + ω_j Σ c P(r_ji)
  pure subroutine add_polynomial(stencil, omega, degree, coefficient, weight)
    type(stencil_t), intent(in) :: stencil
    real(wp), intent(in) :: omega(:)
    integer, intent(in) :: degree
    real(wp), intent(in) :: coefficient(:)
    real(wp), intent(inout) :: weight(:)
    real(wp) :: value(most)
    integer :: k, m

    m = monomials(degree)
    do k = 1, stencil%n
      call evaluate_monomials(-stencil%q(k)*stencil%ex(k), -stencil%q(k)*stencil%ey(k), degree, &
                              value)
      weight(k) = weight(k) + omega(k)*dot_product(coefficient(1:m), value(1:m))
    end do
  end subroutine add_polynomial

  !> x, y, x², xy, y², x³ …: each degree is the one before times x, and one more times y.
  pure subroutine evaluate_monomials(x, y, degree, value)
    real(wp), intent(in) :: x, y
    integer, intent(in) :: degree
    real(wp), intent(out) :: value(:)
    integer :: d, before, here, k

    value(1) = x
    value(2) = y
    before = 0
    do d = 2, degree
      here = before + d
      ! As a loop: of sections the compiler would make copies
      do k = 1, d
        value(here + k) = value(before + k)*x
      end do
      value(here + d + 1) = value(before + d)*y
      before = here
    end do
  end subroutine evaluate_monomials

end module calor_taylor_weights
