!> Mathematical constants.
module calor_constants
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: pi

  real(wp), parameter :: pi = acos(-1.0_wp)
end module calor_constants
