!> The Wendland C6 kernel: f = 78/(7π) (1-q)⁸ (32q³ + 25q² + 8q + 1).
!>
!> Source: H. Wendland, Piecewise polynomial, positive definite and compactly supported radial
!> functions of minimal degree, Adv. Comput. Math. 4 (1995) 389–396.
module calor_kernel_wendland_c6
  use calor_constants, only: pi
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: wendland_c6_t

  !> Wendland's function of smoothness C6
  type, extends(kernel_t) :: wendland_c6_t
  contains
    procedure :: profile
  end type wendland_c6_t

  real(wp), parameter :: sigma = 78/(7*pi)

contains

  pure subroutine profile(this, q, f, df, ddf)
    class(wendland_c6_t), intent(in) :: this
    real(wp), intent(in) :: q(:)
    real(wp), intent(out) :: f(:), df(:), ddf(:)
    real(wp) :: p
    integer :: k

    do k = 1, size(q)
      p = max(0.0_wp, 1 - q(k))
      f(k) = sigma*p**8*(((32*q(k) + 25)*q(k) + 8)*q(k) + 1)
      df(k) = -22*sigma*q(k)*p**7*((16*q(k) + 7)*q(k) + 1)
      ddf(k) = 22*sigma*p**6*(((160*q(k) + 15)*q(k) - 6)*q(k) - 1)
    end do
  end subroutine profile

end module calor_kernel_wendland_c6
