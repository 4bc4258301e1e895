!> The method BiCGSTAB, a preconditioned iteration for unsymmetric linear systems.
!>
!> Source: H.A. van der Vorst, Bi-CGSTAB: a fast and smoothly converging variant of Bi-CG for the
!> solution of nonsymmetric linear systems, SIAM J. Sci. Stat. Comput. 13 (1992) 631–644.
module calor_bicgstab
  use calor_constants, only: worth_threads
  use calor_incomplete_factors, only: incomplete_factors_t
  use calor_kinds, only: wp
  use calor_sparse_matrix, only: sparse_matrix_t
  use calor_sums, only: dot
  implicit none (type, external)
  private

  public :: solve_by_bicgstab

  !> Where the residual has become orthogonal to the shadow residual, as far as rounding lets it,
  !> the iteration begins anew from where it is
  real(wp), parameter :: orthogonal = 1.0e-14_wp

contains

  !> Solve A x = b, starting from x, until ‖b - A x‖ ≤ tolerance.
  subroutine solve_by_bicgstab(matrix, preconditioner, b, tolerance, most_iterations, x, &
                               iterations, converged)
    !> A
    type(sparse_matrix_t), intent(in) :: matrix
    !> Its incomplete factors
    type(incomplete_factors_t), intent(in) :: preconditioner
    real(wp), intent(in), contiguous :: b(:)
    !> In the Euclidean norm
    real(wp), intent(in) :: tolerance
    integer, intent(in) :: most_iterations
    !> A first guess; the solution
    real(wp), intent(inout), contiguous :: x(:)
    !> Iterations made: two products and two preconditionings each
    integer, intent(out) :: iterations
    logical, intent(out) :: converged
    real(wp), allocatable :: r(:), shadow(:), p(:), v(:), t(:), ahead(:)
    real(wp) :: rho, rho_before, alpha, omega, beta, size_of_r, along
    integer :: n, k
    logical :: fresh

    n = size(b)
    allocate (r(n), shadow(n), p(n), v(n), t(n), ahead(n))
    iterations = 0
    fresh = .true.
    call matrix%multiply(x, r)
    r = b - r
    size_of_r = sqrt(dot(r, r))
    converged = size_of_r <= tolerance
    rho_before = 0
    alpha = 0
    omega = 0
    do while (.not. converged .and. iterations < most_iterations)
      if (.not. size_of_r <= huge(size_of_r)) return
      iterations = iterations + 1
      if (fresh) shadow = r
      rho = dot(shadow, r)
      if (fresh) then
        p = r
      else
        if (abs(rho) <= orthogonal*size_of_r*sqrt(dot(shadow, shadow))) then
          fresh = .true.
          cycle
        end if
        beta = rho/rho_before*alpha/omega
        !$omp parallel do if (n > worth_threads) schedule(static) default(shared) private(k)
        do k = 1, n
          p(k) = r(k) + beta*(p(k) - omega*v(k))
        end do
        !$omp end parallel do
      end if
      fresh = .false.
      call preconditioner%solve(p, ahead)
      call matrix%multiply(ahead, v)
      along = dot(shadow, v)
      if (abs(along) <= tiny(along)) then
        if (iterations > 1) fresh = .true.
        if (fresh) cycle
        return
      end if
      alpha = rho/along
      !$omp parallel do if (n > worth_threads) schedule(static) default(shared) private(k)
      do k = 1, n
        x(k) = x(k) + alpha*ahead(k)
        r(k) = r(k) - alpha*v(k)
      end do
      !$omp end parallel do
      call preconditioner%solve(r, ahead)
      call matrix%multiply(ahead, t)
      along = dot(t, t)
      omega = 0
      if (along > 0) omega = dot(t, r)/along
      !$omp parallel do if (n > worth_threads) schedule(static) default(shared) private(k)
      do k = 1, n
        x(k) = x(k) + omega*ahead(k)
        r(k) = r(k) - omega*t(k)
      end do
      !$omp end parallel do
      rho_before = rho
      size_of_r = sqrt(dot(r, r))
      if (size_of_r <= tolerance) then
        ! What was carried along drifts from the residual itself by rounding.
        call matrix%multiply(x, r)
        r = b - r
        size_of_r = sqrt(dot(r, r))
        converged = size_of_r <= 2*tolerance
        fresh = .true.
      else if (.not. abs(omega) > 0) then
        fresh = .true.
      end if
    end do
  end subroutine solve_by_bicgstab

end module calor_bicgstab
