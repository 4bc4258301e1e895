!> Small dense linear systems that may be singular.
module calor_small_system
  use calor_kinds, only: wp
  use calor_lapack, only: dgesv, dgelss
  implicit none (type, external)
  private

  public :: solve_small_system, largest_condition

  !> Systems with a larger condition number count as singular. Beyond it fewer than four digits
  !> of a solution would be right, and a lattice's exact rank losses lie at 1e16.
  real(wp), parameter :: largest_condition = 1.0e12_wp

contains

  !> Solve A X = B where A is well conditioned; otherwise take the minimum-norm least-squares
  !> solution, in which directions that A does not determine get nothing.
  subroutine solve_small_system(a, b, x, condition)
    !> Square matrix, at most 4 × 4, of entries of order one
    real(wp), intent(in) :: a(:, :)
    !> Right-hand sides, one a column, at most 4
    real(wp), intent(in) :: b(:, :)
    !> Solutions, shaped as b
    real(wp), intent(out) :: x(:, :)
    !> Condition number of A in the 1-norm; where A counts as singular, the ratio of its largest to
    !> its smallest singular value, and huge(1.0) where that is zero
    real(wp), intent(out) :: condition
    integer, parameter :: most = 4
    real(wp) :: matrix(most, most), solution(most, 2*most)
    integer :: pivot(most), info, n, columns, k

    n = size(a, 1)
    columns = size(b, 2)
    matrix(1:n, 1:n) = a
    ! The unit matrix rides along as further right-hand sides: the inverse tells the condition.
    solution(1:n, 1:columns + n) = 0
    solution(1:n, 1:columns) = b
    do k = 1, n
      solution(k, columns + k) = 1
    end do
    call dgesv(n, columns + n, matrix, most, pivot, solution, most, info)
    condition = huge(1.0_wp)
    if (info == 0) condition = norm_1(a)*norm_1(solution(1:n, columns + 1:columns + n))
    if (condition <= largest_condition) then
      x = solution(1:n, 1:columns)
    else
      call minimum_norm_solution(a, b, x, condition)
    end if
  end subroutine solve_small_system

  subroutine minimum_norm_solution(a, b, x, condition)
    real(wp), intent(in) :: a(:, :), b(:, :)
    real(wp), intent(out) :: x(:, :), condition
    integer, parameter :: most = 4
    real(wp) :: matrix(most, most), solution(most, most), singular(most), work(20*most)
    integer :: rank, info, n, columns

    n = size(a, 1)
    columns = size(b, 2)
    matrix(1:n, 1:n) = a
    solution(1:n, 1:columns) = b
    call dgelss(n, n, columns, matrix, most, solution, most, singular, 1/largest_condition, rank, &
                work, size(work), info)
    x = 0
    condition = huge(1.0_wp)
    if (info /= 0) return
    x = solution(1:n, 1:columns)
    if (singular(n) > singular(1)/huge(1.0_wp)) condition = singular(1)/singular(n)
  end subroutine minimum_norm_solution

  pure function norm_1(a) result(norm)
    real(wp), intent(in) :: a(:, :)
    real(wp) :: norm

    norm = maxval(sum(abs(a), dim=1))
  end function norm_1

end module calor_small_system
