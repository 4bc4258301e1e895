!> The steady temperature around a line source that moves through a wide body, as in welding.
!>
!> In a frame that moves with the source at speed U along x,
!> T = q/(2πκ) exp(-U ξ/(2α)) K₀(U r/(2α)): long and warm behind it, steep before it.
!>
!> Source: D. Rosenthal, Trans. ASME 68 (1946) 849–866.
module calor_rosenthal
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: rosenthal_temperature, bessel_k0

contains

  !> The temperature less that far away, K; infinite at the source.
  elemental function rosenthal_temperature(ahead, aside, power, speed, conductivity, diffusivity) &
      result(temperature)
    !> Where, from the source: in the direction in which it moves, and across, m
    real(wp), intent(in) :: ahead, aside
    !> Power of the source, W per metre depth, and its speed, m/s
    real(wp), intent(in) :: power, speed
    !> W/(m K), and conductivity over density and heat capacity, m²/s
    real(wp), intent(in) :: conductivity, diffusivity
    real(wp) :: temperature
    real(wp), parameter :: two_pi = 2*acos(-1.0_wp)

    associate (decay => speed/(2*diffusivity))
      temperature = power/(two_pi*conductivity)*exp(-decay*ahead)* &
                    bessel_k0(decay*hypot(ahead, aside))
    end associate
  end function rosenthal_temperature

  !> The modified Bessel function of the second kind, K₀(z) = ∫₀^∞ exp(-z cosh s) ds for z > 0. The
  !> integrand falls twofold exponentially, so that the trapezoidal rule is exact but for rounding.
  elemental function bessel_k0(z) result(value)
    !> A positive number
    real(wp), intent(in) :: z
    real(wp) :: value
    real(wp), parameter :: step = 0.05_wp
    real(wp) :: exponent
    integer :: k

    value = 0.5_wp*exp(-z)
    do k = 1, huge(k) - 1
      exponent = z*cosh(k*step)
      if (exponent > z + 40) exit
      value = value + exp(-exponent)
    end do
    value = step*value
  end function bessel_k0

end module calor_rosenthal
