!> What one of several processes makes of a cloud: a row of items, as the columns of a lattice, is
!> shared out evenly.
module calor_slice
  implicit none (type, external)
  private

  public :: slice_t, share_of

  !> Part number `part`, counted from 0, of `parts`
  type :: slice_t
    integer :: part = 0, parts = 1
  contains
    !> The first and last of its items
    procedure :: share
  end type slice_t

contains

  !> Items are counted from 0; where there are fewer than parts, some get none: last < first.
  pure subroutine share(this, items, first, last)
    class(slice_t), intent(in) :: this
    !> How many items there are
    integer, intent(in) :: items
    integer, intent(out) :: first, last

    first = items/this%parts*this%part + min(this%part, mod(items, this%parts))
    last = first + items/this%parts - 1
    if (this%part < mod(items, this%parts)) last = last + 1
  end subroutine share

  !> The same where a slice may be absent: then all items, and of a slice one more at either end if
  !> there is one.
  pure subroutine share_of(items, own_first, own_last, first, last, slice)
    !> How many items there are
    integer, intent(in) :: items
    !> The items of the slice
    integer, intent(out) :: own_first, own_last
    !> These and their neighbours
    integer, intent(out) :: first, last
    type(slice_t), intent(in), optional :: slice

    own_first = 0
    own_last = items - 1
    if (present(slice)) call slice%share(items, own_first, own_last)
    first = own_first
    last = own_last
    if (last < first) return
    first = max(0, own_first - 1)
    last = min(items - 1, own_last + 1)
  end subroutine share_of

end module calor_slice
