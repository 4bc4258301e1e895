!> Brookshaw's Laplacian, Σ 2 w_j (u_i - u_j)/r_ij e_ij·∇W_ij, the usual one in SPH. Exact for
!> constants; its weights are never negative.
!>
!> Source: L. Brookshaw, A method of calculating radiative heat diffusion in particle simulations,
!> Proc. Astron. Soc. Aust. 6 (1985) 207–210.
module calor_laplacian_brookshaw
  use calor_kinds, only: wp
  use calor_laplacian_scheme, only: row_laplacian_t
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: brookshaw_t

  type, extends(row_laplacian_t) :: brookshaw_t
  contains
    procedure :: weights
  end type brookshaw_t

contains

  subroutine weights(this, stencil, weight, diagonal)
    class(brookshaw_t), intent(in) :: this
    type(stencil_t), intent(inout) :: stencil
    real(wp), intent(out) :: weight(:)
    real(wp), intent(out) :: diagonal
    integer :: n

    n = stencil%n
    weight = -2*stencil%force(1:n)/stencil%q(1:n)
    diagonal = -sum(weight)
  end subroutine weights

end module calor_laplacian_brookshaw
