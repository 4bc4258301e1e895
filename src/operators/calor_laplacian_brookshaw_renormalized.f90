!> Brookshaw's Laplacian with the renormalized kernel gradient B_i·∇W_ij. Exact for constants.
module calor_laplacian_brookshaw_renormalized
  use calor_kinds, only: wp
  use calor_laplacian_scheme, only: row_laplacian_t
  use calor_renormalization, only: gradient_tensor
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: brookshaw_renormalized_t

  type, extends(row_laplacian_t) :: brookshaw_renormalized_t
  contains
    procedure :: weights
  end type brookshaw_renormalized_t

contains

  subroutine weights(this, stencil, weight, diagonal)
    class(brookshaw_renormalized_t), intent(in) :: this
    type(stencil_t), intent(inout) :: stencil
    real(wp), intent(out) :: weight(:)
    real(wp), intent(out) :: diagonal
    real(wp) :: b(2, 2)
    integer :: n

    n = stencil%n
    call gradient_tensor(stencil, b)
    weight = -2*stencil%force(1:n)/stencil%q(1:n)* &
             (b(1, 1)*stencil%ex(1:n)**2 + (b(1, 2) + b(2, 1))*stencil%ex(1:n)*stencil%ey(1:n) + &
              b(2, 2)*stencil%ey(1:n)**2)
    diagonal = -sum(weight)
  end subroutine weights

end module calor_laplacian_brookshaw_renormalized
