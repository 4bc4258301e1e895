!> The renormalization tensors B_i and B̂_i.
!>
!> Source: R. Fatehi, M.T. Manzari, Comput. Math. Appl. 61 (2011) 482–498: B_i makes the first
!> derivative exact for linear fields, B̂_i the second derivative exact for quadratic ones.
module calor_renormalization
  use calor_kinds, only: wp
  use calor_small_system, only: solve_small_system
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: gradient_tensor, laplacian_tensor, derivative_tensors

contains

  !> B_i = -[Σ w_j r_ij ∇W_ij]⁻¹; where that is singular, the minimum-norm tensor.
  subroutine gradient_tensor(stencil, b)
    !> The particle's stencil; its `condition_gradient` is set
    type(stencil_t), intent(inout) :: stencil
    !> B_i, without unit
    real(wp), intent(out) :: b(2, 2)
    real(wp) :: moment(2, 2), minus_unit(2, 2)
    real(wp) :: weight
    integer :: k

    moment = 0
    do k = 1, stencil%n
      weight = stencil%force(k)*stencil%q(k)
      moment(1, 1) = moment(1, 1) + weight*stencil%ex(k)*stencil%ex(k)
      moment(1, 2) = moment(1, 2) + weight*stencil%ex(k)*stencil%ey(k)
      moment(2, 2) = moment(2, 2) + weight*stencil%ey(k)*stencil%ey(k)
    end do
    moment(2, 1) = moment(1, 2)
    minus_unit = reshape([-1.0_wp, 0.0_wp, 0.0_wp, -1.0_wp], [2, 2])
    call solve_small_system(moment, minus_unit, b, stencil%condition_gradient)
  end subroutine gradient_tensor

  !> B̂_i, the symmetric solution of
  !> B̂ : [Σ w_j r_ij e e e ∇W + (Σ w_j e e ∇W)·B·(Σ w_j r r ∇W)] = -I,
  !> where the colon pairs B̂ with the indices (e, ∇W); where that system is singular, as on a
  !> lattice with four neighbours, the minimum-norm solution.
  subroutine laplacian_tensor(stencil, b, b_hat)
    !> The particle's stencil; its `condition_laplacian` is set
    type(stencil_t), intent(inout) :: stencil
    !> B_i from `gradient_tensor`
    real(wp), intent(in) :: b(2, 2)
    !> B̂xx, B̂xy, B̂yy, without unit
    real(wp), intent(out) :: b_hat(3)
    real(wp) :: system(3, 3), solution(3, 1), minus_unit(3, 1)

    call find_system(stencil, b, system)
    minus_unit(:, 1) = [-1.0_wp, 0.0_wp, -1.0_wp]
    call solve_small_system(system, minus_unit, solution, stencil%condition_laplacian)
    b_hat = solution(:, 1)
  end subroutine laplacian_tensor

  !> B̂_i of ∂²/∂x², of ∂²/∂x∂y + ∂²/∂y∂x and of ∂²/∂y²: the solutions with minus the tensors xx,
  !> xy + yx and yy on the right-hand side in the place of -I. That of K:∇∇ with any K is κxx times
  !> the first one, κxy times the second and κyy times the third.
  subroutine derivative_tensors(stencil, b, b_hat)
    !> The particle's stencil; its `condition_laplacian` is set
    type(stencil_t), intent(inout) :: stencil
    !> B_i from `gradient_tensor`
    real(wp), intent(in) :: b(2, 2)
    !> B̂xx, B̂xy, B̂yy of each, one a column, without unit
    real(wp), intent(out) :: b_hat(3, 3)
    real(wp) :: system(3, 3), minus_unit(3, 3)
    integer :: k

    call find_system(stencil, b, system)
    minus_unit = 0
    do k = 1, 3
      minus_unit(k, k) = -1
    end do
    call solve_small_system(system, minus_unit, b_hat, stencil%condition_laplacian)
  end subroutine derivative_tensors

  !> The system for B̂xx, B̂xy, B̂yy: its rows are the pairs xx, xy and yy of the right-hand side.
  subroutine find_system(stencil, b, system)
    type(stencil_t), intent(in) :: stencil
    real(wp), intent(in) :: b(2, 2)
    real(wp), intent(out) :: system(3, 3)
    ! Index pairs xx, xy, yy of a symmetric tensor are the components 1, 2, 3.
    real(wp) :: second(2, 3), correction(2, 3)
    real(wp) :: ee(3), row, ex, ey, force, q
    integer :: k, pair

    ! Σ w_j r r ∇W: its last index, that of ∇W, comes first here.
    second = 0
    do k = 1, stencil%n
      ex = stencil%ex(k)
      ey = stencil%ey(k)
      ee = [ex*ex, ex*ey, ey*ey]
      force = stencil%force(k)*stencil%q(k)**2
      second(1, :) = second(1, :) + force*ex*ee
      second(2, :) = second(2, :) + force*ey*ee
    end do
    correction = matmul(b, second)

    system = 0
    do k = 1, stencil%n
      ex = stencil%ex(k)
      ey = stencil%ey(k)
      q = stencil%q(k)
      ee = [ex*ex, ex*ey, ey*ey]
      force = stencil%force(k)
      do pair = 1, 3
        row = force*(q*ee(pair) + ex*correction(1, pair) + ey*correction(2, pair))
        ! B̂ : e e = B̂xx ex² + 2 B̂xy ex ey + B̂yy ey²
        system(pair, 1) = system(pair, 1) + row*ee(1)
        system(pair, 2) = system(pair, 2) + row*2*ee(2)
        system(pair, 3) = system(pair, 3) + row*ee(3)
      end do
    end do
  end subroutine find_system

end module calor_renormalization
