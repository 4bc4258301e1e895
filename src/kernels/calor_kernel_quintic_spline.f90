!> The quintic spline M6, its support radius being three knot distances: with s = 3q,
!> f = 63/(478π) [(3-s)⁵ - 6 (2-s)⁵ + 15 (1-s)⁵], each bracket counted only where it is positive.
!>
!> Source: J.J. Monaghan and J.C. Lattanzio, A refined particle method for astrophysical problems,
!> Astron. Astrophys. 149 (1985) 135–143; the splines are those of I.J. Schoenberg (1946).
module calor_kernel_quintic_spline
  use calor_constants, only: pi
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: quintic_spline_t

  !> Schoenberg's spline M6, four times continuously differentiable
  type, extends(kernel_t) :: quintic_spline_t
  contains
    procedure :: profile
  end type quintic_spline_t

  real(wp), parameter :: sigma = 63/(478*pi)

contains

  pure subroutine profile(this, q, f, df, ddf)
    class(quintic_spline_t), intent(in) :: this
    real(wp), intent(in) :: q(:)
    real(wp), intent(out) :: f(:), df(:), ddf(:)
    real(wp) :: s, outer, middle
    integer :: k

    do k = 1, size(q)
      s = 3*q(k)
      if (s < 1) then
        ! The brackets multiplied out: f' must lose no digits to cancellation as q goes to 0,
        ! where f'/q is wanted
        f(k) = sigma*(66 + s**2*(s**2*(30 - 10*s) - 60))
        df(k) = 3*sigma*s*(s**2*(120 - 50*s) - 120)
        ddf(k) = 9*sigma*(s**2*(360 - 200*s) - 120)
      else
        outer = max(0.0_wp, 3*(1 - q(k)))
        middle = max(0.0_wp, 2 - s)
        f(k) = sigma*(outer**5 - 6*middle**5)
        df(k) = -15*sigma*(outer**4 - 6*middle**4)
        ddf(k) = 180*sigma*(outer**3 - 6*middle**3)
      end if
    end do
  end subroutine profile

end module calor_kernel_quintic_spline
