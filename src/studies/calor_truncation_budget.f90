!> The truncation error of rows of weights, term by term of its Taylor expansion.
!>
!> With d = r_j - r_i a row gives Σ a_ij u_j = Σ_k Σ_(m+n=k) M_mn ∂^k u/∂x^m∂y^n, where
!> M_mn = Σ a_ij dx^m dy^n/(m! n!) are its moments. What is wanted is a combination of the same
!> derivatives; the term of degree k is what the row has too much of those of degree k.
!>
!> Source: R. Fatehi, M.T. Manzari, Comput. Math. Appl. 61 (2011) 482–498.
module calor_truncation_budget
  use calor_kinds, only: wp, i8
  use calor_sparse_operator, only: sparse_operator_t
  use calor_study_field, only: derivative_count, derivative_index
  implicit none (type, external)
  private

  public :: truncation_terms, row_magnitudes, wanted_moments

contains

  !> The moments of a row that is exact: 1 for the derivative that it stands for, 0 for all others.
  pure function wanted_moments(family, component, degree) result(moments)
    !> 1: a component of the gradient; 2: the Laplacian
    integer, intent(in) :: family
    !> 1 for ∂/∂x, 2 for ∂/∂y
    integer, intent(in) :: component
    !> The highest degree of the moments
    integer, intent(in) :: degree
    real(wp) :: moments(0:derivative_count(degree) - 1)

    moments = 0
    if (family == 2) then
      moments(derivative_index(2, 0)) = 1
      moments(derivative_index(0, 2)) = 1
    else
      moments(derivative_index(2 - component, component - 1)) = 1
    end if
  end function wanted_moments

  !> The terms of every row.
  subroutine truncation_terms(rows, x, y, derivatives, wanted, degree, terms)
    !> The rows
    type(sparse_operator_t), intent(in) :: rows
    !> Coordinates of all particles, m
    real(wp), intent(in) :: x(:), y(:)
    !> Derivatives of the field at the target of each row, by `derivative_index` from 0 on
    real(wp), intent(in) :: derivatives(0:, :)
    !> The moments that the rows should have, from `wanted_moments`
    real(wp), intent(in) :: wanted(0:)
    !> The highest degree
    integer, intent(in) :: degree
    !> The terms, of the size (0:degree, rows)
    real(wp), intent(out) :: terms(0:, :)
    real(wp) :: moments(0:derivative_count(degree) - 1)
    integer :: row, k

    !$omp parallel do schedule(static) default(shared) private(row, k, moments)
    do row = 1, rows%rows()
      call row_moments(rows, row, x, y, degree, moments)
      moments = moments - wanted
      do k = 0, degree
        associate (from => derivative_index(k, 0), to => derivative_index(0, k))
          terms(k, row) = dot_product(moments(from:to), derivatives(from:to, row))
        end associate
      end do
    end do
    !$omp end parallel do
  end subroutine truncation_terms

  pure subroutine row_moments(rows, row, x, y, degree, moments)
    type(sparse_operator_t), intent(in) :: rows
    integer, intent(in) :: row
    real(wp), intent(in) :: x(:), y(:)
    integer, intent(in) :: degree
    real(wp), intent(out) :: moments(0:)
    real(wp) :: power(0:ubound(moments, 1)), inverse(degree), dx, dy
    integer(i8) :: k
    integer :: i, j, m, n, here, before

    i = rows%target(row)
    moments = 0
    power(0) = 1
    inverse = [(1/real(m, wp), m=1, degree)]
    do k = rows%first(row), rows%first(row + 1) - 1
      j = rows%index(k)
      dx = x(j) - x(i)
      dy = y(j) - y(i)
      ! dx^m dy^n/(m! n!), each from one of a degree less
      do m = 1, degree
        before = derivative_index(m - 1, 0)
        here = derivative_index(m, 0)
        power(here) = power(before)*dx*inverse(m)
        do n = 1, m
          power(here + n) = power(before + n - 1)*dy*inverse(n)
        end do
      end do
      moments = moments + rows%weight(k)*power
    end do
    moments(0) = moments(0) + rows%diagonal(row)
  end subroutine row_moments

  !> Σ |a_ij u_j| of every row: rounding errors are some 10⁻¹⁶ of it.
  pure function row_magnitudes(rows, u) result(magnitudes)
    !> The rows
    type(sparse_operator_t), intent(in) :: rows
    !> The field at all particles
    real(wp), intent(in) :: u(:)
    real(wp) :: magnitudes(size(rows%target))
    integer :: row

    do row = 1, size(magnitudes)
      associate (from => rows%first(row), to => rows%first(row + 1) - 1)
        magnitudes(row) = abs(rows%diagonal(row)*u(rows%target(row))) + &
                          sum(abs(rows%weight(from:to)*u(rows%index(from:to))))
      end associate
    end do
  end function row_magnitudes

end module calor_truncation_budget
