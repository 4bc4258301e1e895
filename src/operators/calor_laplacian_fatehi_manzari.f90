!> The paper's new scheme,
!> Σ 2 w_j (B̂_i : e_ij ∇W_ij) [(u_i - u_j)/r_ij - e_ij·⟨∇u⟩_i] with the renormalized gradient
!> ⟨∇u⟩_i. Exact for quadratic fields.
!>
!> Source: R. Fatehi, M.T. Manzari, Comput. Math. Appl. 61 (2011) 482–498.
module calor_laplacian_fatehi_manzari
  use calor_kinds, only: wp
  use calor_laplacian_scheme, only: row_laplacian_t
  use calor_renormalization, only: gradient_tensor, laplacian_tensor
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: fatehi_manzari_t

  type, extends(row_laplacian_t) :: fatehi_manzari_t
  contains
    procedure :: weights
    procedure :: exact_degree
  end type fatehi_manzari_t

contains

  pure function exact_degree(this) result(degree)
    class(fatehi_manzari_t), intent(in) :: this
    integer :: degree

    associate (unused => this)
    end associate
    degree = 2
  end function exact_degree

  subroutine weights(this, stencil, weight, diagonal)
    class(fatehi_manzari_t), intent(in) :: this
    type(stencil_t), intent(inout) :: stencil
    real(wp), intent(out) :: weight(:)
    real(wp), intent(out) :: diagonal
    real(wp) :: b(2, 2), b_hat(3), slope(2), pull
    integer :: k

    call gradient_tensor(stencil, b)
    call laplacian_tensor(stencil, b, b_hat)
    slope = 0
    do k = 1, stencil%n
      associate (ex => stencil%ex(k), ey => stencil%ey(k))
        pull = 2*stencil%force(k)*(b_hat(1)*ex*ex + 2*b_hat(2)*ex*ey + b_hat(3)*ey*ey)
        weight(k) = -pull/stencil%q(k)
        slope = slope + pull*[ex, ey]
      end associate
    end do
    ! -Σ pull e·⟨∇u⟩ with ⟨∇u⟩ = Σ F_j (u_j - u_i) B·e_j
    slope = matmul(slope, b)
    do k = 1, stencil%n
      weight(k) = weight(k) - stencil%force(k)*(slope(1)*stencil%ex(k) + slope(2)*stencil%ey(k))
    end do
    diagonal = -sum(weight(1:stencil%n))
  end subroutine weights

end module calor_laplacian_fatehi_manzari
