!> A fine one-dimensional solution for two slabs in contact: reference of the scenes
!> data/verification/two_slabs_transient_*.nml.
!>
!> `two_slabs RATIO` prints x and T at t = 0.05 s: conductivities 1 for x < 0.5 and RATIO beyond,
!> T = 1 - x at the start, 1 and 0 at the ends. Finite volumes about 4000 intervals' ends, one of
!> which is the interface, of second order; in time the L-stable diagonally implicit Runge–Kutta
!> method of second order, 4000 steps (R. Alexander, SIAM J. Numer. Anal. 14 (1977) 1006–1021).
program two_slabs
  implicit none (type, external)
  integer, parameter :: wp = kind(1.0d0), n = 4000, steps = 4000, written = 400
  real(wp), parameter :: gamma = 1 - sqrt(0.5_wp), step = 0.05_wp/steps
  real(wp) :: conductance(n), u(0:n), first(n - 1), second(n - 1), ratio
  character(len=32) :: word
  integer :: k

  interface
    !> Solve a tridiagonal system (LAPACK)
    subroutine dgtsv(n, nrhs, dl, d, du, b, ldb, info)
      import :: wp
      implicit none (type, external)
      integer, intent(in) :: n, nrhs, ldb
      real(wp), intent(inout) :: dl(n - 1), d(n), du(n - 1), b(ldb, nrhs)
      integer, intent(out) :: info
    end subroutine dgtsv
  end interface

  call get_command_argument(1, word)
  read (word, *) ratio
  conductance(:n/2) = real(n, wp)**2
  conductance(n/2 + 1:) = ratio*real(n, wp)**2
  u = [(1 - real(k, wp)/n, k=0, n)]
  do k = 1, steps
    call find_rate(u(1:n - 1), first)
    call find_rate(u(1:n - 1) + (1 - gamma)*step*first, second)
    u(1:n - 1) = u(1:n - 1) + step*((1 - gamma)*first + gamma*second)
  end do
  print '(a)', 'x,temperature'
  do k = 0, n, n/written
    print '(f6.4,a,f12.9)', real(k, wp)/n, ',', u(k)
  end do

contains

  !> The rate r = A (v + γ Δt r) + b
  subroutine find_rate(v, rate)
    real(wp), intent(in) :: v(:)
    real(wp), intent(out) :: rate(:)
    real(wp) :: all(0:n), lower(n - 2), diagonal(n - 1), upper(n - 2), right(n - 1, 1)
    integer :: info

    all = [1.0_wp, v, 0.0_wp]
    right(:, 1) = conductance(2:)*(all(2:) - v) - conductance(:n - 1)*(v - all(:n - 2))
    diagonal = 1 + gamma*step*(conductance(2:) + conductance(:n - 1))
    lower = -gamma*step*conductance(2:n - 1)
    upper = lower
    call dgtsv(n - 1, 1, lower, diagonal, upper, right, n - 1, info)
    rate = right(:, 1)
    if (info /= 0) error stop 'The equations of a step are singular.'
  end subroutine find_rate

end program two_slabs
