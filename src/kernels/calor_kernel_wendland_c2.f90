!> The Wendland C2 kernel: f = 7/π (1-q)⁴ (4q+1).
!>
!> Source: H. Wendland, Piecewise polynomial, positive definite and compactly supported radial
!> functions of minimal degree, Adv. Comput. Math. 4 (1995) 389–396.
module calor_kernel_wendland_c2
  use calor_constants, only: pi
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: wendland_c2_t

  type, extends(kernel_t) :: wendland_c2_t
  contains
    procedure :: profile
  end type wendland_c2_t

  real(wp), parameter :: sigma = 7/pi

contains

  pure subroutine profile(this, q, f, df, ddf)
    class(wendland_c2_t), intent(in) :: this
    real(wp), intent(in) :: q(:)
    real(wp), intent(out) :: f(:), df(:), ddf(:)
    real(wp) :: p
    integer :: k

    do k = 1, size(q)
      p = max(0.0_wp, 1 - q(k))
      f(k) = sigma*p**4*(4*q(k) + 1)
      df(k) = -20*sigma*q(k)*p**3
      ddf(k) = 20*sigma*p**2*(4*q(k) - 1)
    end do
  end subroutine profile

end module calor_kernel_wendland_c2
