!> Checksums of data: CRC-64, which tells every change of up to 64 bits in a row, and any other with
!> a chance of 1 in 2⁶⁴ of being missed.
!>
!> The polynomial is that of ECMA-182, as the archiver xz uses it: the checksum of '123456789' is
!> 995DC9BBDF1939FA. Eight bytes are taken at a time (M.E. Kounavis, F.L. Berry, IEEE Trans. Comput.
!> 57 (2008) 1550–1560).
module calor_checksum
  use, intrinsic :: iso_fortran_env, only: int8
  use calor_kinds, only: i8
  implicit none (type, external)
  private

  public :: checksum_t, checksum_text

  integer, parameter :: slices = 8

  !> A checksum in the making
  type :: checksum_t
    private
    integer(i8) :: state = not(0_i8)
    integer(i8) :: table(0:255, slices) = 0
    logical :: ready = .false.
  contains
    !> Take bytes into account
    procedure :: add
    !> The checksum of all bytes so far
    procedure :: value => checksum_value
    !> The same as 16 hexadecimal digits
    procedure :: text => text_of
  end type checksum_t

contains

  pure subroutine add(this, bytes)
    class(checksum_t), intent(inout) :: this
    !> The bytes
    integer(int8), intent(in), contiguous :: bytes(:)
    integer(i8) :: word, state
    integer(i8) :: k, whole
    integer :: j

    if (.not. this%ready) call fill_table(this)
    state = this%state
    whole = slices*(size(bytes, kind=i8)/slices)
    do k = 1, whole, slices
      word = 0
      do j = slices - 1, 0, -1
        word = ior(ishft(word, 8), iand(int(bytes(k + j), i8), 255_i8))
      end do
      word = ieor(word, state)
      state = 0
      do j = 1, slices
        state = ieor(state, this%table(ibits(word, 8*(j - 1), 8), slices + 1 - j))
      end do
    end do
    do k = whole + 1, size(bytes, kind=i8)
      state = ieor(this%table(iand(ieor(state, int(bytes(k), i8)), 255_i8), 1), ishft(state, -8))
    end do
    this%state = state
  end subroutine add

  pure function checksum_value(this) result(value)
    class(checksum_t), intent(in) :: this
    integer(i8) :: value

    value = not(this%state)
  end function checksum_value

  !> What each byte does to the checksum when up to seven more follow
  pure subroutine fill_table(this)
    class(checksum_t), intent(inout) :: this
    integer(i8) :: polynomial, entry
    integer :: k, j

    polynomial = ior(ishft(int(z'C96C5795', i8), 32), int(z'D7870F42', i8))
    do k = 0, 255
      entry = k
      do j = 1, 8
        if (btest(entry, 0)) then
          entry = ieor(ishft(entry, -1), polynomial)
        else
          entry = ishft(entry, -1)
        end if
      end do
      this%table(k, 1) = entry
    end do
    do j = 2, slices
      do k = 0, 255
        entry = this%table(k, j - 1)
        this%table(k, j) = ieor(ishft(entry, -8), this%table(iand(entry, 255_i8), 1))
      end do
    end do
    this%ready = .true.
  end subroutine fill_table

  !> The checksum of some bytes as 16 hexadecimal digits.
  pure function checksum_text(bytes) result(text)
    !> The bytes
    integer(int8), intent(in), contiguous :: bytes(:)
    character(len=16) :: text
    type(checksum_t) :: checksum

    call checksum%add(bytes)
    text = checksum%text()
  end function checksum_text

  pure function text_of(this) result(text)
    class(checksum_t), intent(in) :: this
    character(len=16) :: text

    write (text, '(z16.16)') this%value()
  end function text_of

end module calor_checksum
