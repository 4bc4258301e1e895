!> Random numbers that depend on a seed and a counter only.
!>
!> There is no state: the number of a particle is the same in whatever order, on however many
!> threads and with whatever compiler it is drawn.
!>
!> Source: J.K. Salmon, M.A. Moraes, R.O. Dror, D.E. Shaw, Parallel random numbers: as easy as
!> 1, 2, 3, SC '11 (2011), doi 10.1145/2063384.2063405; generator Philox2x32-10.
module calor_random
  use calor_kinds, only: wp, i8
  implicit none (type, external)
  private

  public :: random_uniform, random_words

  !> All numbers here are below 2³² and kept in 64 bits, and are multiplied in halves, because an
  !> overflow of Fortran's integers is undefined
  integer(i8), parameter :: low_32 = 4294967295_i8, low_16 = 65535_i8
  !> Philox's multiplier, hexadecimal D256D193
  integer(i8), parameter :: multiplier = 3528905107_i8
  !> What the key grows by in each round, hexadecimal 9E3779B9
  integer(i8), parameter :: key_step = 2654435769_i8
  integer, parameter :: rounds = 10

contains

  !> A number evenly distributed over [0, 1), with 53 random bits.
  elemental function random_uniform(seed, counter) result(number)
    !> Numbers of different seeds have nothing to do with each other
    integer, intent(in) :: seed
    !> Which number of the sequence, any value
    integer(i8), intent(in) :: counter
    real(wp) :: number
    integer(i8) :: first, second

    call random_words(seed, counter, first, second)
    number = real(ior(ishft(first, 21), ishft(second, -11)), wp)*2.0_wp**(-53)
  end function random_uniform

  !> Two random whole numbers between 0 and 2³² - 1.
  elemental subroutine random_words(seed, counter, first, second)
    !> The generator's key
    integer, intent(in) :: seed
    !> The generator's counter
    integer(i8), intent(in) :: counter
    !> The two numbers
    integer(i8), intent(out) :: first, second
    integer(i8) :: key, high, low
    integer :: round

    key = iand(int(seed, i8), low_32)
    first = iand(counter, low_32)
    second = ishft(counter, -32)
    do round = 1, rounds
      call multiply(first, multiplier, high, low)
      first = ieor(ieor(high, key), second)
      second = low
      key = iand(key + key_step, low_32)
    end do
  end subroutine random_words

  !> The product of two numbers below 2³², as two such numbers.
  elemental subroutine multiply(a, b, high, low)
    !> The factors
    integer(i8), intent(in) :: a, b
    !> The product is 2³² high + low
    integer(i8), intent(out) :: high, low
    integer(i8) :: lower_half, upper_half

    lower_half = a*iand(b, low_16)
    upper_half = a*ishft(b, -16) + ishft(lower_half, -16)
    high = ishft(upper_half, -16)
    low = ior(ishft(iand(upper_half, low_16), 16), iand(lower_half, low_16))
  end subroutine multiply

end module calor_random
