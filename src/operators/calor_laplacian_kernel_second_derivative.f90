!> The kernel's own second derivative, Σ w_j (u_j - u_i) ∇²W_ij with ∇²W = W'' + W'/r in two
!> dimensions. Exact for constants.
module calor_laplacian_kernel_second_derivative
  use calor_kinds, only: wp
  use calor_laplacian_scheme, only: row_laplacian_t
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: kernel_second_derivative_t

  type, extends(row_laplacian_t) :: kernel_second_derivative_t
  contains
    procedure :: weights
  end type kernel_second_derivative_t

contains

  subroutine weights(this, stencil, weight, diagonal)
    class(kernel_second_derivative_t), intent(in) :: this
    type(stencil_t), intent(inout) :: stencil
    real(wp), intent(out) :: weight(:)
    real(wp), intent(out) :: diagonal
    integer :: n

    n = stencil%n
    weight = stencil%volume(1:n)*(stencil%ddf(1:n) + stencil%df(1:n)/stencil%q(1:n))
    diagonal = -sum(weight)
  end subroutine weights

end module calor_laplacian_kernel_second_derivative
