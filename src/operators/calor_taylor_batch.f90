!> The weights of calor_taylor_weights for several particles at once, one in each lane of a vector.
!>
!> Moment matrices are factorised without pivoting, in the lanes of a batch side by side. A monomial
!> that depends on those before it at the neighbours, as x⁵ does on x and x³ on a lattice, is left
!> out; the residual tells whether the row reproduces it all the same. Where it does not, rows are
!> left to LAPACK's pivoted factorisation.
module calor_taylor_batch
  use calor_constants, only: pi
  use calor_kinds, only: wp
  use calor_row_batch, only: row_batch_t, lanes
  use calor_taylor_weights, only: monomials, monomial_position, highest_degree, most, nearest
  implicit none (type, external)
  private

  public :: batch_taylor_weights

  !> Matrices are scaled to a diagonal of ones. A monomial with a smaller pivot depends on those
  !> before it, as far as rounding can tell.
  real(wp), parameter :: smallest_pivot = 1.0e-12_wp
  !> Weights ω Pᵀ c that meet all moments are those of least norm, however c was found. Rows that
  !> miss one by more, in units of the support radius, are not vouched for; such as miss one by so
  !> much that rounding cannot be the reason have too few neighbours.
  real(wp), parameter :: largest_residual = 1.0e-11_wp, unmet_residual = 1.0e-5_wp
  !> Number of moments of degrees 0 … 2 highest_degree, and of entries of half a matrix
  integer, parameter :: most_moments = (2*highest_degree + 1)*(highest_degree + 1)
  integer, parameter :: most_entries = most*(most + 1)/2

contains

  !> Weights of least norm that reproduce one derivative of all polynomials up to a degree.
  !>
  !> Sets weights, diagonal, residual, condition and whether they are solved, or cannot be.
  subroutine batch_taylor_weights(batch, degree, wanted)
    !> The stencils
    type(row_batch_t), intent(inout) :: batch
    !> The degree, 1 … highest_degree
    integer, intent(in) :: degree
    !> (D P)(0) of each monomial P in units of the support radius
    real(wp), intent(in) :: wanted(:)
    real(wp) :: matrix(lanes, most_entries), scaling(lanes, most), moment(lanes, most)
    real(wp) :: coefficient(lanes, most), omega(lanes*batch%n), shortest(lanes)
    integer :: m, time, k

    m = monomials(degree)
    shortest = 0.0_wp
    do k = 1, lanes
      shortest(k) = nearest*sqrt(pi/(batch%length(k) + 1))
    end do
    call weighting(batch%n, batch%q, batch%f, shortest, omega)
    call moment_matrix(batch%n, batch%q, batch%ex, batch%ey, omega, degree, m, matrix, scaling)
    call factorise(m, matrix, batch%condition_laplacian)
    batch%weight(1:lanes*batch%n) = 0
    moment(:, 1:m) = 0
    ! The second time refines: what rounding left of the moments is mended.
    do time = 1, 2
      do k = 1, m
        coefficient(:, k) = (wanted(k) - moment(:, k))*scaling(:, k)
      end do
      call solve(m, matrix, coefficient)
      coefficient(:, 1:m) = coefficient(:, 1:m)*scaling(:, 1:m)
      call add_polynomials(batch%n, batch%q, batch%ex, batch%ey, omega, degree, m, coefficient, &
                           batch%weight, moment)
    end do
    do k = 1, m
      batch%residual = max(batch%residual, abs(moment(:, k) - wanted(k)))
    end do
    batch%solved = batch%residual <= largest_residual
    batch%unmet = batch%residual > unmet_residual
    call sum_up(batch%n, batch%weight, batch%diagonal)
  end subroutine batch_taylor_weights

  !> ω = W/|r|², of neighbours that are not much too near
  pure subroutine weighting(n, q, f, shortest, omega)
    integer, intent(in) :: n
    real(wp), intent(in) :: q(lanes, n), f(lanes, n), shortest(lanes)
    real(wp), intent(out) :: omega(lanes, n)
    integer :: k, l

    do k = 1, n
      do l = 1, lanes
        omega(l, k) = f(l, k)/max(q(l, k), shortest(l))**2
      end do
    end do
  end subroutine weighting

  !> The lower half of M = Σ ω P Pᵀ, row after row, scaled to a diagonal of ones. Its entries are
  !> moments of ω of degrees 2 … 2d, of which there are far fewer than entries.
  pure subroutine moment_matrix(n, q, ex, ey, omega, degree, m, matrix, scaling)
    integer, intent(in) :: n, degree, m
    real(wp), intent(in), dimension(lanes, n) :: q, ex, ey, omega
    real(wp), intent(out) :: matrix(lanes, m*(m + 1)/2), scaling(lanes, m)
    real(wp) :: moment(lanes, most_moments), power(lanes, 0:2*highest_degree)
    real(wp) :: x(lanes), y(lanes)
    integer :: exponent_x(most), exponent_y(most), start(0:2*highest_degree)
    integer :: a, b, column, entry, k, row

    ! The moment of xᵃ yᵇ stands at start(b) + a.
    start(0) = 1
    do b = 1, 2*degree
      start(b) = start(b - 1) + 2*degree - b + 2
    end do
    do b = 0, degree
      do a = max(0, 1 - b), degree - b
        exponent_x(monomial_position(a, b)) = a
        exponent_y(monomial_position(a, b)) = b
      end do
    end do
    moment(:, 1:start(2*degree)) = 0
    do k = 1, n
      ! r_ji = -r_ij
      x = -q(:, k)*ex(:, k)
      y = -q(:, k)*ey(:, k)
      power(:, 0) = omega(:, k)
      do a = 1, 2*degree
        power(:, a) = power(:, a - 1)*x
      end do
      do b = 0, 2*degree
        do a = 0, 2*degree - b
          moment(:, start(b) + a) = moment(:, start(b) + a) + power(:, a)
          power(:, a) = power(:, a)*y
        end do
      end do
    end do
    do row = 1, m
      scaling(:, row) = 1/sqrt(max(moment(:, start(2*exponent_y(row)) + 2*exponent_x(row)), &
                                   tiny(1.0_wp)))
    end do
    entry = 0
    do row = 1, m
      do column = 1, row
        entry = entry + 1
        matrix(:, entry) = moment(:, start(exponent_y(row) + exponent_y(column)) + &
                                  exponent_x(row) + exponent_x(column))* &
                           scaling(:, row)*scaling(:, column)
      end do
    end do
  end subroutine moment_matrix

  !> M = L Lᵀ in place; the diagonal of L is kept as its inverse, 0 where a monomial is left out.
  pure subroutine factorise(m, matrix, condition)
    integer, intent(in) :: m
    real(wp), intent(inout) :: matrix(lanes, m*(m + 1)/2)
    !> An estimate of the condition of M; huge(1.0) where it is singular
    real(wp), intent(out) :: condition(lanes)
    real(wp) :: total(lanes), least(lanes), largest(lanes)
    logical :: singular(lanes)
    integer :: column, column_start, k, row, row_start, l

    least = huge(1.0_wp)
    largest = 0
    singular = .false.
    do row = 1, m
      row_start = row*(row - 1)/2
      do column = 1, row - 1
        column_start = column*(column - 1)/2
        total = matrix(:, row_start + column)
        do k = 1, column - 1
          !$omp simd
          do l = 1, lanes
            total(l) = total(l) - matrix(l, row_start + k)*matrix(l, column_start + k)
          end do
        end do
        matrix(:, row_start + column) = total*matrix(:, column_start + column)
      end do
      total = matrix(:, row_start + row)
      do k = 1, row - 1
        total = total - matrix(:, row_start + k)**2
      end do
      do l = 1, lanes
        if (total(l) > smallest_pivot) then
          least(l) = min(least(l), total(l))
          largest(l) = max(largest(l), total(l))
          matrix(l, row_start + row) = 1/sqrt(total(l))
        else
          singular(l) = .true.
          matrix(l, row_start + row) = 0
        end if
      end do
    end do
    condition = huge(1.0_wp)
    where (.not. singular) condition = largest/least
  end subroutine factorise

  !> x ← M⁻¹ x
  pure subroutine solve(m, matrix, x)
    integer, intent(in) :: m
    real(wp), intent(in) :: matrix(lanes, m*(m + 1)/2)
    real(wp), intent(inout) :: x(lanes, m)
    integer :: k, row, row_start

    do row = 1, m
      row_start = row*(row - 1)/2
      do k = 1, row - 1
        x(:, row) = x(:, row) - matrix(:, row_start + k)*x(:, k)
      end do
      x(:, row) = x(:, row)*matrix(:, row_start + row)
    end do
    do row = m, 1, -1
      row_start = row*(row - 1)/2
      x(:, row) = x(:, row)*matrix(:, row_start + row)
      do k = 1, row - 1
        x(:, k) = x(:, k) - matrix(:, row_start + k)*x(:, row)
      end do
    end do
  end subroutine solve

  !> a_j ← a_j + ω_j Σ c P(r_ji), and the moments Σ a_j P(r_ji) of the result
  pure subroutine add_polynomials(n, q, ex, ey, omega, degree, m, coefficient, weight, moment)
    integer, intent(in) :: n, degree, m
    real(wp), intent(in), dimension(lanes, n) :: q, ex, ey, omega
    real(wp), intent(in) :: coefficient(lanes, m)
    real(wp), intent(inout) :: weight(lanes, n)
    real(wp), intent(out) :: moment(lanes, m)
    real(wp) :: value(lanes, most), total(lanes), x(lanes), y(lanes)
    integer :: d, here, before, k, p

    moment = 0
    do k = 1, n
      x = -q(:, k)*ex(:, k)
      y = -q(:, k)*ey(:, k)
      ! x, y, x², xy, y² …: each degree is the one before times x, and one more times y.
      value(:, 1) = x
      value(:, 2) = y
      before = 0
      do d = 2, degree
        here = before + d
        do p = 1, d
          value(:, here + p) = value(:, before + p)*x
        end do
        value(:, here + d + 1) = value(:, before + d)*y
        before = here
      end do
      total = 0
      do p = 1, m
        total = total + coefficient(:, p)*value(:, p)
      end do
      total = weight(:, k) + omega(:, k)*total
      weight(:, k) = total
      do p = 1, m
        moment(:, p) = moment(:, p) + total*value(:, p)
      end do
    end do
  end subroutine add_polynomials

  pure subroutine sum_up(n, weight, diagonal)
    integer, intent(in) :: n
    real(wp), intent(in) :: weight(lanes, n)
    real(wp), intent(out) :: diagonal(lanes)
    integer :: k

    diagonal = 0
    do k = 1, n
      diagonal = diagonal - weight(:, k)
    end do
  end subroutine sum_up

end module calor_taylor_batch
