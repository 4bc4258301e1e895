!> Constants that many modules share.
module calor_constants
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: pi, worth_threads, least_size, greatest_size

  real(wp), parameter :: pi = acos(-1.0_wp)
  !> The sizes that a number of a scene or a cloud may have, unless it is 0, and whatever its unit.
  !> No length, time or property of a body is near them; beyond them the squares and quotients that
  !> a simulation takes would leave the range of the numbers (1e±308).
  real(wp), parameter :: least_size = 1.0e-40_wp, greatest_size = 1.0e30_wp
  !> A loop over fewer particles is not worth starting threads for: on a busy machine they wait for
  !> each other longer than the loop takes
  integer, parameter :: worth_threads = 2000
end module calor_constants
