!> The gradient of order p on any cloud: norm-minimal weights that reproduce all polynomials up to
!> degree p.
!>
!> Source: see calor_taylor_weights.
module calor_gradient_consistent
  use calor_gradient_scheme, only: gradient_scheme_t
  use calor_kinds, only: wp
  use calor_stencil, only: stencil_t
  use calor_taylor_weights, only: taylor_weights, monomials, monomial_position, default_order
  implicit none (type, external)
  private

  public :: consistent_gradient_t

  type, extends(gradient_scheme_t) :: consistent_gradient_t
    !> The order p, 1 … highest_order
    integer :: order = default_order
  contains
    procedure :: weights
    procedure :: exact_degree
  end type consistent_gradient_t

contains

  pure function exact_degree(this) result(degree)
    class(consistent_gradient_t), intent(in) :: this
    integer :: degree

    degree = this%order
  end function exact_degree

  subroutine weights(this, stencil, weight_x, weight_y, diagonal)
    class(consistent_gradient_t), intent(in) :: this
    type(stencil_t), intent(inout) :: stencil
    real(wp), intent(out) :: weight_x(:), weight_y(:)
    real(wp), intent(out) :: diagonal(2)
    real(wp) :: wanted(monomials(this%order), 2), found(stencil%n, 2)

    wanted = 0
    wanted(monomial_position(1, 0), 1) = 1
    wanted(monomial_position(0, 1), 2) = 1
    call taylor_weights(stencil, this%order, wanted, found, stencil%condition_gradient)
    weight_x = found(:, 1)
    weight_y = found(:, 2)
    diagonal = [-sum(weight_x), -sum(weight_y)]
  end subroutine weights

end module calor_gradient_consistent
