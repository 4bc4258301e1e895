!> The Wendland C4 kernel: f = 9/π (1-q)⁶ (35/3 q² + 6q + 1).
!>
!> Source: H. Wendland, Piecewise polynomial, positive definite and compactly supported radial
!> functions of minimal degree, Adv. Comput. Math. 4 (1995) 389–396.
module calor_kernel_wendland_c4
  use calor_constants, only: pi
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: wendland_c4_t

  !> Wendland's function of smoothness C4
  type, extends(kernel_t) :: wendland_c4_t
  contains
    procedure :: profile
  end type wendland_c4_t

  real(wp), parameter :: sigma = 9/pi

contains

  pure subroutine profile(this, q, f, df, ddf)
    class(wendland_c4_t), intent(in) :: this
    real(wp), intent(in) :: q(:)
    real(wp), intent(out) :: f(:), df(:), ddf(:)
    real(wp) :: p
    integer :: k

    do k = 1, size(q)
      p = max(0.0_wp, 1 - q(k))
      f(k) = sigma*p**6*((35*q(k)/3 + 6)*q(k) + 1)
      df(k) = -56*sigma/3*q(k)*p**5*(5*q(k) + 1)
      ddf(k) = 56*sigma/3*p**4*((35*q(k) - 4)*q(k) - 1)
    end do
  end subroutine profile

end module calor_kernel_wendland_c4
