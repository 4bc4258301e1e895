!> Neighbour lists in first/index form.
module calor_neighbour_list
  use calor_kinds, only: ip, i8
  implicit none (type, external)
  private

  public :: neighbour_list_t

  !> For each row, the particles within its target particle's search radius.
  !>
  !> The neighbours of particle `target(row)` are `index(first(row):first(row + 1) - 1)`: all other
  !> particles strictly nearer than the search radius, in ascending order.
  type :: neighbour_list_t
    !> The particle whose neighbours a row lists
    integer(ip), allocatable :: target(:)
    !> Where each row begins in `index`; one element more than rows
    integer(i8), allocatable :: first(:)
    !> Neighbouring particles, row after row
    integer(ip), allocatable :: index(:)
  contains
    !> Number of rows
    procedure :: rows
    !> The largest number of neighbours that a row has
    procedure :: longest_row
  end type neighbour_list_t

contains

  pure function rows(this) result(number)
    class(neighbour_list_t), intent(in) :: this
    integer :: number

    number = size(this%target)
  end function rows

  pure function longest_row(this) result(number)
    class(neighbour_list_t), intent(in) :: this
    integer :: number
    integer :: row

    number = 0
    do row = 1, this%rows()
      number = max(number, int(this%first(row + 1) - this%first(row)))
    end do
  end function longest_row

end module calor_neighbour_list
