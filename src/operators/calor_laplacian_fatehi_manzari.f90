!> The paper's new scheme,
!> Σ 2 w_j (B̂_i : e_ij ∇W_ij) [(u_i - u_j)/r_ij - e_ij·⟨∇u⟩_i] with the renormalized gradient
!> ⟨∇u⟩_i. Exact for quadratic fields.
!>
!> Source: R. Fatehi, M.T. Manzari, Comput. Math. Appl. 61 (2011) 482–498.
module calor_laplacian_fatehi_manzari
  use calor_kinds, only: wp
  use calor_laplacian_scheme, only: row_laplacian_t
  use calor_row_batch, only: row_batch_t, lanes
  use calor_renormalization, only: gradient_tensor, laplacian_tensor
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: fatehi_manzari_t

  type, extends(row_laplacian_t) :: fatehi_manzari_t
  contains
    procedure :: weights
    procedure :: exact_degree
    procedure :: solves_batches
    procedure :: batch_weights
  end type fatehi_manzari_t

  !> Systems of a batch are solved by explicit inverses, which keep twelve digits up to this
  !> condition; worse ones are left to LAPACK
  real(wp), parameter :: direct_condition = 1.0e4_wp

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

  pure function solves_batches(this) result(answer)
    class(fatehi_manzari_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .true.
  end function solves_batches

  subroutine batch_weights(this, batch)
    class(fatehi_manzari_t), intent(in) :: this
    type(row_batch_t), intent(inout) :: batch

    associate (unused => this)
    end associate
    call find_weights(batch%n, batch%q, batch%ex, batch%ey, batch%volume, batch%df, batch%weight, &
                      batch%diagonal, batch%condition_gradient, batch%condition_laplacian)
    ! Comparisons with what is no number are false
    batch%solved = batch%condition_gradient <= direct_condition .and. &
                   batch%condition_laplacian <= direct_condition .and. batch%length > 0
  end subroutine batch_weights

  !> The same sums and tensors as for one row, lane by lane. The 16 sums that the systems for B and
  !> B̂ consist of are taken in one sweep; B is applied afterwards.
  pure subroutine find_weights(n, q, ex, ey, volume, df, weight, diagonal, condition_gradient, &
                               condition_laplacian)
    integer, intent(in) :: n
    real(wp), intent(in), dimension(lanes, n) :: q, ex, ey, volume, df
    real(wp), intent(out) :: weight(lanes, n)
    real(wp), intent(out), dimension(lanes) :: diagonal, condition_gradient, condition_laplacian
    ! Σ F q e e, Σ F e e e, Σ F q² e e e and Σ F q e e e e by the number of factors ey
    real(wp) :: two(lanes, 0:2), three(lanes, 0:3), far_three(lanes, 0:3), four(lanes, 0:4)
    real(wp), dimension(lanes) :: b11, b12, b22, b_hat_xx, b_hat_xy, b_hat_yy, slope_x, slope_y
    real(wp) :: force, fq, xx, xy, yy, pull, sx, sy
    integer :: k, l

    two = 0
    three = 0
    far_three = 0
    four = 0
    do k = 1, n
      !$omp simd private(force, fq, xx, xy, yy)
      do l = 1, lanes
        force = volume(l, k)*df(l, k)
        fq = force*q(l, k)
        xx = ex(l, k)*ex(l, k)
        xy = ex(l, k)*ey(l, k)
        yy = ey(l, k)*ey(l, k)
        two(l, 0) = two(l, 0) + fq*xx
        two(l, 1) = two(l, 1) + fq*xy
        two(l, 2) = two(l, 2) + fq*yy
        four(l, 0) = four(l, 0) + fq*xx*xx
        four(l, 1) = four(l, 1) + fq*xx*xy
        four(l, 2) = four(l, 2) + fq*xx*yy
        four(l, 3) = four(l, 3) + fq*xy*yy
        four(l, 4) = four(l, 4) + fq*yy*yy
        three(l, 0) = three(l, 0) + force*xx*ex(l, k)
        three(l, 1) = three(l, 1) + force*xx*ey(l, k)
        three(l, 2) = three(l, 2) + force*yy*ex(l, k)
        three(l, 3) = three(l, 3) + force*yy*ey(l, k)
        fq = fq*q(l, k)
        far_three(l, 0) = far_three(l, 0) + fq*xx*ex(l, k)
        far_three(l, 1) = far_three(l, 1) + fq*xx*ey(l, k)
        far_three(l, 2) = far_three(l, 2) + fq*yy*ex(l, k)
        far_three(l, 3) = far_three(l, 3) + fq*yy*ey(l, k)
      end do
    end do
    call invert_gradient(two, b11, b12, b22, condition_gradient)
    call solve_laplacian(b11, b12, b22, three, far_three, four, b_hat_xx, b_hat_xy, b_hat_yy, &
                         condition_laplacian)
    slope_x = 0
    slope_y = 0
    do k = 1, n
      !$omp simd private(pull)
      do l = 1, lanes
        pull = 2*volume(l, k)*df(l, k)*(b_hat_xx(l)*ex(l, k)*ex(l, k) + &
                                        2*b_hat_xy(l)*ex(l, k)*ey(l, k) + &
                                        b_hat_yy(l)*ey(l, k)*ey(l, k))
        weight(l, k) = -pull/q(l, k)
        slope_x(l) = slope_x(l) + pull*ex(l, k)
        slope_y(l) = slope_y(l) + pull*ey(l, k)
      end do
    end do
    diagonal = 0
    do l = 1, lanes
      sx = slope_x(l)*b11(l) + slope_y(l)*b12(l)
      sy = slope_x(l)*b12(l) + slope_y(l)*b22(l)
      slope_x(l) = sx
      slope_y(l) = sy
    end do
    do k = 1, n
      !$omp simd
      do l = 1, lanes
        weight(l, k) = weight(l, k) - volume(l, k)*df(l, k)*(slope_x(l)*ex(l, k) + &
                                                             slope_y(l)*ey(l, k))
        diagonal(l) = diagonal(l) - weight(l, k)
      end do
    end do
  end subroutine find_weights

  !> B = -M⁻¹ of the symmetric M, and the condition of M in the 1-norm; huge(1.0) where there is
  !> no inverse.
  pure subroutine invert_gradient(m, b11, b12, b22, condition)
    !> M's components xx, xy and yy
    real(wp), intent(in) :: m(lanes, 0:2)
    real(wp), intent(out), dimension(lanes) :: b11, b12, b22, condition
    real(wp) :: determinant, norm
    integer :: l

    do l = 1, lanes
      determinant = m(l, 0)*m(l, 2) - m(l, 1)*m(l, 1)
      norm = max(abs(m(l, 0)), abs(m(l, 2))) + abs(m(l, 1))
      b11(l) = 0
      b12(l) = 0
      b22(l) = 0
      condition(l) = huge(1.0_wp)
      if (abs(determinant) > norm*norm/direct_condition**2) then
        b11(l) = -m(l, 2)/determinant
        b12(l) = m(l, 1)/determinant
        b22(l) = -m(l, 0)/determinant
        condition(l) = norm*(max(abs(b11(l)), abs(b22(l))) + abs(b12(l)))
      end if
    end do
  end subroutine invert_gradient

  !> B̂ : [Σ w_j r_ij e e e ∇W + (Σ w_j e e ∇W)·B·(Σ w_j r r ∇W)] = -I by Cramer's rule.
  pure subroutine solve_laplacian(b11, b12, b22, three, far_three, four, xx, xy, yy, condition)
    !> B
    real(wp), intent(in), dimension(lanes) :: b11, b12, b22
    !> The sums
    real(wp), intent(in) :: three(lanes, 0:3), far_three(lanes, 0:3), four(lanes, 0:4)
    !> B̂, and the condition of its system
    real(wp), intent(out), dimension(lanes) :: xx, xy, yy, condition
    real(wp) :: a(3, 3), inverse(3, 3), determinant, norm, pull_x, pull_y
    integer :: l, pair

    do l = 1, lanes
      do pair = 1, 3
        pull_x = b11(l)*far_three(l, pair - 1) + b12(l)*far_three(l, pair)
        pull_y = b12(l)*far_three(l, pair - 1) + b22(l)*far_three(l, pair)
        ! B̂ : e e = B̂xx ex² + 2 B̂xy ex ey + B̂yy ey²
        a(pair, 1) = four(l, pair - 1) + pull_x*three(l, 0) + pull_y*three(l, 1)
        a(pair, 2) = 2*(four(l, pair) + pull_x*three(l, 1) + pull_y*three(l, 2))
        a(pair, 3) = four(l, pair + 1) + pull_x*three(l, 2) + pull_y*three(l, 3)
      end do
      inverse(1, :) = cofactors(a(:, 2), a(:, 3))
      inverse(2, :) = cofactors(a(:, 3), a(:, 1))
      inverse(3, :) = cofactors(a(:, 1), a(:, 2))
      determinant = inverse(1, 1)*a(1, 1) + inverse(1, 2)*a(2, 1) + inverse(1, 3)*a(3, 1)
      norm = norm_1(a)
      xx(l) = 0
      xy(l) = 0
      yy(l) = 0
      condition(l) = huge(1.0_wp)
      if (.not. abs(determinant) > norm**3/direct_condition**3) cycle
      condition(l) = norm*norm_1(inverse)/abs(determinant)
      xx(l) = -(inverse(1, 1) + inverse(1, 3))/determinant
      xy(l) = -(inverse(2, 1) + inverse(2, 3))/determinant
      yy(l) = -(inverse(3, 1) + inverse(3, 3))/determinant
    end do
  end subroutine solve_laplacian

  !> The cross product of two columns
  pure function cofactors(a, b) result(c)
    real(wp), intent(in) :: a(3), b(3)
    real(wp) :: c(3)

    c = [a(2)*b(3) - a(3)*b(2), a(3)*b(1) - a(1)*b(3), a(1)*b(2) - a(2)*b(1)]
  end function cofactors

  pure function norm_1(a) result(norm)
    real(wp), intent(in) :: a(3, 3)
    real(wp) :: norm
    integer :: column

    norm = 0
    do column = 1, 3
      norm = max(norm, abs(a(1, column)) + abs(a(2, column)) + abs(a(3, column)))
    end do
  end function norm_1

end module calor_laplacian_fatehi_manzari
