!> The standard SPH gradient, Σ w_j u_j ∇W_ij (paper: F1). On an irregular cloud exact for nothing.
module calor_gradient_standard
  use calor_gradient_scheme, only: gradient_scheme_t
  use calor_kinds, only: wp
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: standard_gradient_t

  type, extends(gradient_scheme_t) :: standard_gradient_t
  contains
    procedure :: weights
  end type standard_gradient_t

contains

  subroutine weights(this, stencil, weight_x, weight_y, diagonal)
    class(standard_gradient_t), intent(in) :: this
    type(stencil_t), intent(inout) :: stencil
    real(wp), intent(out) :: weight_x(:), weight_y(:)
    real(wp), intent(out) :: diagonal(2)
    integer :: n

    n = stencil%n
    weight_x = stencil%force(1:n)*stencil%ex(1:n)
    weight_y = stencil%force(1:n)*stencil%ey(1:n)
    diagonal = 0
  end subroutine weights

end module calor_gradient_standard
