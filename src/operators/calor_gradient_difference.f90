!> The difference gradient, Σ w_j (u_j - u_i) ∇W_ij. Exact for constants.
module calor_gradient_difference
  use calor_gradient_scheme, only: gradient_scheme_t
  use calor_kinds, only: wp
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: difference_gradient_t

  type, extends(gradient_scheme_t) :: difference_gradient_t
  contains
    procedure :: weights
  end type difference_gradient_t

contains

  subroutine weights(this, stencil, weight_x, weight_y, diagonal)
    class(difference_gradient_t), intent(in) :: this
    type(stencil_t), intent(inout) :: stencil
    real(wp), intent(out) :: weight_x(:), weight_y(:)
    real(wp), intent(out) :: diagonal(2)
    integer :: n

    n = stencil%n
    weight_x = stencil%force(1:n)*stencil%ex(1:n)
    weight_y = stencil%force(1:n)*stencil%ey(1:n)
    diagonal = [-sum(weight_x), -sum(weight_y)]
  end subroutine weights

end module calor_gradient_difference
