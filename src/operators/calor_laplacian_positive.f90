!> Stencils of non-negative weights, exact for quadratic fields.
!>
!> Of all weights a_ij ≥ 0 with Σ a_ij r_ij = 0 and Σ a_ij r_ij r_ij = 2 I those that minimise
!> Σ a_ij |r_ij|⁴: a vertex of a linear programme, so at most five neighbours take part. Such rows
!> cannot be unstable, and under the step limit no temperature leaves the range of those before it.
!>
!> Source: B. Seibold, Minimal positive stencils in meshfree finite difference methods for the
!> Poisson equation, Comput. Methods Appl. Mech. Eng. 198 (2008) 592–601.
module calor_laplacian_positive
  use calor_constants, only: pi
  use calor_kinds, only: wp
  use calor_laplacian_scheme, only: row_laplacian_t
  use calor_linear_programme, only: minimise
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: positive_t

  type, extends(row_laplacian_t) :: positive_t
    !> Whether rows may miss quadratic fields where no row is exact for them: they are then exact
    !> for linear fields and as near to exact for quadratic ones as non-negative weights can be
    logical :: relaxed = .false.
  contains
    procedure :: weights
    procedure :: exact_degree
  end type positive_t

  !> Neighbours nearer than this part of the mean distance between particles count as if they were
  !> that far away: a programme that rewarded tiny distances would cost tiny time steps.
  real(wp), parameter :: nearest = 0.5_wp
  !> Cost of missing a second moment by one, far above that of any stencil
  real(wp), parameter :: penalty = 1.0e4_wp

contains

  pure function exact_degree(this) result(degree)
    class(positive_t), intent(in) :: this
    integer :: degree

    associate (unused => this)
    end associate
    degree = 2
  end function exact_degree

  !> Where the neighbours admit no such stencil, all weights are zero.
  subroutine weights(this, stencil, weight, diagonal)
    class(positive_t), intent(in) :: this
    type(stencil_t), intent(inout) :: stencil
    real(wp), intent(out) :: weight(:)
    real(wp), intent(out) :: diagonal
    ! First and second moments; one more and one less for each of the second ones
    integer, parameter :: m = 5, slacks = 6
    real(wp) :: cost(stencil%n + slacks), moments(m, stencil%n + slacks)
    real(wp) :: solution(stencil%n + slacks), tableau(0:m, 0:stencil%n + slacks + m), shortest
    integer :: basis(m), k, n
    logical :: feasible

    shortest = nearest*sqrt(pi/(stencil%n + 1))
    do k = 1, stencil%n
      associate (q => stencil%q(k), ex => stencil%ex(k), ey => stencil%ey(k))
        ! With the unknowns a_ij q_ij the columns are of order one, however near a neighbour is.
        moments(:, k) = [ex, ey, q*ex*ex, q*ex*ey, q*ey*ey]
        cost(k) = max(q, shortest)**4/q
      end associate
    end do
    n = stencil%n
    if (this%relaxed) then
      moments(:, n + 1:n + slacks) = 0
      cost(n + 1:n + slacks) = penalty
      do k = 1, 3
        moments(2 + k, n + 2*k - 1) = 1
        moments(2 + k, n + 2*k) = -1
      end do
      n = n + slacks
    end if
    call minimise(cost(1:n), moments(:, 1:n), [0.0_wp, 0.0_wp, 2.0_wp, 0.0_wp, 2.0_wp], &
                  solution(1:n), tableau, basis, feasible)
    do k = 1, stencil%n
      weight(k) = solution(k)/stencil%q(k)
    end do
    diagonal = -sum(weight(1:stencil%n))
  end subroutine weights

end module calor_laplacian_positive
