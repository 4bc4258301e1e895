!> Mathematical constants.
module calor_constants
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: pi, worth_threads

  real(wp), parameter :: pi = acos(-1.0_wp)
  !> A loop over fewer particles is not worth starting threads for: on a busy machine they wait for
  !> each other longer than the loop takes
  integer, parameter :: worth_threads = 2000
end module calor_constants
