!> Large arrays on large pages of memory.
!>
!> Linux hands memory out in pages of 4 KiB, each on first use, unless it is asked for huge pages
!> (2 MiB). For arrays of many megabytes that are filled once, handing out small pages takes as long
!> as filling them.
module calor_huge_pages
  use, intrinsic :: iso_c_binding, only: c_int, c_intptr_t, c_loc, c_ptr, c_size_t
  use calor_kinds, only: wp, sp, ip, i2, i8
  implicit none (type, external)
  private

  public :: prefer_huge_pages

  !> Ask for huge pages beneath an array that was just allocated and not yet used.
  !>
  !> A wish only: small arrays are left alone, and systems that know no huge pages ignore it.
  interface prefer_huge_pages
    module procedure prefer_for_particles
    module procedure prefer_for_differences
    module procedure prefer_for_counters
    module procedure prefer_for_reals
    module procedure prefer_for_short_reals
  end interface prefer_huge_pages

  !> Bytes from which it is worth while
  integer(c_size_t), parameter :: worth_while = 4*2_c_size_t**20
  !> Pages begin at multiples of this on every common machine
  integer(c_intptr_t), parameter :: page = 65536
  !> Linux's MADV_HUGEPAGE
  integer(c_int), parameter :: huge_page_advice = 14

  interface
    function madvise(address, length, advice) bind(c, name='madvise') result(status)
      import :: c_int, c_intptr_t, c_size_t
      implicit none (type, external)
      integer(c_intptr_t), value :: address
      integer(c_size_t), value :: length
      integer(c_int), value :: advice
      integer(c_int) :: status
    end function madvise
  end interface

contains

  subroutine prefer_for_particles(array)
    !> Any array
    integer(ip), intent(in), contiguous, target :: array(:)

    call advise(c_loc(array), size(array, kind=c_size_t)*storage_size(array)/8)
  end subroutine prefer_for_particles

  subroutine prefer_for_differences(array)
    !> Any array
    integer(i2), intent(in), contiguous, target :: array(:)

    call advise(c_loc(array), size(array, kind=c_size_t)*storage_size(array)/8)
  end subroutine prefer_for_differences

  subroutine prefer_for_counters(array)
    !> Any array
    integer(i8), intent(in), contiguous, target :: array(:)

    call advise(c_loc(array), size(array, kind=c_size_t)*storage_size(array)/8)
  end subroutine prefer_for_counters

  subroutine prefer_for_reals(array)
    !> Any array
    real(wp), intent(in), contiguous, target :: array(:)

    call advise(c_loc(array), size(array, kind=c_size_t)*storage_size(array)/8)
  end subroutine prefer_for_reals

  subroutine prefer_for_short_reals(array)
    !> Any array
    real(sp), intent(in), contiguous, target :: array(:)

    call advise(c_loc(array), size(array, kind=c_size_t)*storage_size(array)/8)
  end subroutine prefer_for_short_reals

  !> Ask for huge pages beneath the whole pages of a piece of memory.
  subroutine advise(begin, bytes)
    type(c_ptr), intent(in) :: begin
    integer(c_size_t), intent(in) :: bytes
    integer(c_intptr_t) :: address, first_page
    integer(c_int) :: status

    if (bytes < worth_while) return
    address = transfer(begin, address)
    first_page = (address + page - 1)/page*page
    ! Whatever it answers, the memory can be used
    status = madvise(first_page, bytes - (first_page - address), huge_page_advice)
  end subroutine advise

end module calor_huge_pages
