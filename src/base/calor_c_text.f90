!> Text on its way to C and back.
module calor_c_text
  use, intrinsic :: iso_c_binding, only: c_ptr, c_char, c_size_t, c_null_char, c_associated, &
                                         c_f_pointer
  implicit none (type, external)
  private

  public :: to_c, from_c

  interface
    pure function strlen(text) result(length) bind(c, name='strlen')
      import :: c_ptr, c_size_t
      implicit none (type, external)
      type(c_ptr), intent(in), value :: text
      integer(c_size_t) :: length
    end function strlen
  end interface

contains

  !> The text without its trailing blanks, ended by a null as C wants it.
  pure function to_c(text) result(copy)
    !> Any text
    character(len=*), intent(in) :: text
    character(len=:, kind=c_char), allocatable :: copy

    copy = trim(text)//c_null_char
  end function to_c

  !> A copy of the null-ended text at an address; '' if there is none.
  function from_c(address) result(text)
    !> Where the text begins
    type(c_ptr), intent(in) :: address
    character(len=:), allocatable :: text
    character(len=1, kind=c_char), pointer :: letters(:)
    integer :: k, length

    text = ''
    if (.not. c_associated(address)) return
    length = int(strlen(address))
    call c_f_pointer(address, letters, [length])
    text = repeat(' ', length)
    do k = 1, length
      text(k:k) = letters(k)
    end do
  end function from_c

end module calor_c_text
