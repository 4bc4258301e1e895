!> The renormalized gradient, Σ w_j (u_j - u_i) B_i·∇W_ij (paper: F4). Exact for linear fields.
module calor_gradient_renormalized
  use calor_gradient_scheme, only: gradient_scheme_t
  use calor_kinds, only: wp
  use calor_renormalization, only: gradient_tensor
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: renormalized_gradient_t

  type, extends(gradient_scheme_t) :: renormalized_gradient_t
  contains
    procedure :: weights
    procedure :: exact_degree
  end type renormalized_gradient_t

contains

  pure function exact_degree(this) result(degree)
    class(renormalized_gradient_t), intent(in) :: this
    integer :: degree

    associate (unused => this)
    end associate
    degree = 1
  end function exact_degree

  subroutine weights(this, stencil, weight_x, weight_y, diagonal)
    class(renormalized_gradient_t), intent(in) :: this
    type(stencil_t), intent(inout) :: stencil
    real(wp), intent(out) :: weight_x(:), weight_y(:)
    real(wp), intent(out) :: diagonal(2)
    real(wp) :: b(2, 2)
    integer :: n

    n = stencil%n
    call gradient_tensor(stencil, b)
    weight_x = stencil%force(1:n)*(b(1, 1)*stencil%ex(1:n) + b(1, 2)*stencil%ey(1:n))
    weight_y = stencil%force(1:n)*(b(2, 1)*stencil%ex(1:n) + b(2, 2)*stencil%ey(1:n))
    diagonal = [-sum(weight_x), -sum(weight_y)]
  end subroutine weights

end module calor_gradient_renormalized
