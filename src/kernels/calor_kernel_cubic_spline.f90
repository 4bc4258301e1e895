!> The cubic spline M4, its support radius being two knot distances:
!> f = 80/(7π) [(1-q)³ - 4 (1/2-q)³], each bracket counted only where it is positive.
!>
!> Source: J.J. Monaghan and J.C. Lattanzio, A refined particle method for astrophysical problems,
!> Astron. Astrophys. 149 (1985) 135–143; the splines are those of I.J. Schoenberg (1946).
module calor_kernel_cubic_spline
  use calor_constants, only: pi
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: cubic_spline_t

  !> Schoenberg's spline M4, twice continuously differentiable
  type, extends(kernel_t) :: cubic_spline_t
  contains
    procedure :: profile
  end type cubic_spline_t

  real(wp), parameter :: sigma = 80/(7*pi)

contains

  pure subroutine profile(this, q, f, df, ddf)
    class(cubic_spline_t), intent(in) :: this
    real(wp), intent(in) :: q(:)
    real(wp), intent(out) :: f(:), df(:), ddf(:)
    real(wp) :: p
    integer :: k

    do k = 1, size(q)
      if (q(k) < 0.5_wp) then
        ! The brackets multiplied out: f' must lose no digits to cancellation as q goes to 0,
        ! where f'/q is wanted
        f(k) = sigma*(0.5_wp + 3*q(k)**2*(q(k) - 1))
        df(k) = sigma*q(k)*(9*q(k) - 6)
        ddf(k) = sigma*(18*q(k) - 6)
      else
        p = max(0.0_wp, 1 - q(k))
        f(k) = sigma*p**3
        df(k) = -3*sigma*p**2
        ddf(k) = 6*sigma*p
      end if
    end do
  end subroutine profile

end module calor_kernel_cubic_spline
