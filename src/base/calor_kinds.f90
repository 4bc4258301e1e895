!> The number kinds that the whole library uses.
module calor_kinds
  use, intrinsic :: iso_fortran_env, only: real32, real64, int8, int16, int32, int64
  implicit none (type, external)
  private

  public :: wp, sp, ip, i1, i2, i8

  !> Working precision of every physical quantity
  integer, parameter :: wp = real64
  !> Numbers of which many are read and few digits matter
  integer, parameter :: sp = real32
  !> Particle numbers and positions in neighbour lists
  integer, parameter :: ip = int32
  !> Places among few
  integer, parameter :: i1 = int8
  !> Differences of particle numbers, of which many are read
  integer, parameter :: i2 = int16
  !> Counters and byte sizes that may exceed two thousand million
  integer, parameter :: i8 = int64
end module calor_kinds
