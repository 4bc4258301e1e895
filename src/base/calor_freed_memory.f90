!> What the program has freed, given back to the system.
!>
!> The C library keeps what is freed at hand for later; where a run frees most of what its set-up
!> took, that is more than all it still holds.
module calor_freed_memory
  use, intrinsic :: iso_c_binding, only: c_int, c_size_t
  implicit none (type, external)
  private

  public :: give_back_freed_memory

  interface
    !> The GNU C library's; the answer is whether it gave back anything
    function malloc_trim(kept) result(status) bind(c, name='malloc_trim')
      import :: c_int, c_size_t
      implicit none (type, external)
      integer(c_size_t), value :: kept
      integer(c_int) :: status
    end function malloc_trim
  end interface

contains

  !> Give back every page that holds nothing any more. Takes milliseconds for a gigabyte.
  subroutine give_back_freed_memory()
    integer(c_int) :: status

    ! Whatever it answers, the program goes on
    status = malloc_trim(0_c_size_t)
  end subroutine give_back_freed_memory

end module calor_freed_memory
