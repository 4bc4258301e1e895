!> Particles on the nodes of a rectangular lattice, walls included.
module calor_arrangement_lattice
  use calor_cloud, only: cloud_t, allocate_cloud
  use calor_error, only: error_t
  use calor_kinds, only: wp, ip
  use calor_slice, only: slice_t, share_of
  implicit none (type, external)
  private

  public :: arrange_lattice, lattice_intervals, node, side_of_node

contains

  !> Fill a rectangle with a lattice, column by column from the left, each from the bottom.
  !>
  !> The number of intervals along each edge is the nearest to edge/spacing. Every particle, also
  !> one on a wall, has the volume of a whole cell.
  subroutine arrange_lattice(x_range, y_range, spacing, cloud, error, slice)
    !> Left and right, bottom and top edge, m
    real(wp), intent(in) :: x_range(2), y_range(2)
    !> Wanted distance of neighbours, m
    real(wp), intent(in) :: spacing
    !> The particles; its boundaries are left to the caller
    type(cloud_t), intent(out) :: cloud
    !> There is not enough memory
    type(error_t), allocatable, intent(out) :: error
    !> Only a slice of it, by columns: its own particles, and on either side one column of others
    type(slice_t), intent(in), optional :: slice
    integer :: column, columns, first, last, own_first, own_last, particle, row, rows

    columns = lattice_intervals(x_range, spacing)
    rows = lattice_intervals(y_range, spacing)
    call share_of(columns + 1, own_first, own_last, first, last, slice)
    call allocate_cloud(cloud, (last - first + 1)*(rows + 1), error)
    if (allocated(error)) return
    cloud%user_index = cloud%user_index + first*(rows + 1)
    cloud%own_first = (own_first - first)*(rows + 1) + 1
    cloud%own_last = (own_last - first + 1)*(rows + 1)
    particle = 0
    do column = first, last
      do row = 0, rows
        particle = particle + 1
        cloud%x(particle) = node(x_range, column, columns)
        cloud%y(particle) = node(y_range, row, rows)
        cloud%side(particle) = side_of_node(column, columns, row, rows)
      end do
    end do
    cloud%volume = (x_range(2) - x_range(1))/columns*((y_range(2) - y_range(1))/rows)
  end subroutine arrange_lattice

  !> How many intervals of about one spacing an edge is divided into.
  pure function lattice_intervals(range, spacing) result(intervals)
    !> Both ends of the edge, m
    real(wp), intent(in) :: range(2)
    !> Wanted length of an interval, m
    real(wp), intent(in) :: spacing
    integer :: intervals

    intervals = max(1, nint((range(2) - range(1))/spacing))
  end function lattice_intervals

  !> The place of a node along an edge; the last one is exactly at the end.
  pure function node(range, number, intervals) result(place)
    !> Both ends of the edge, m
    real(wp), intent(in) :: range(2)
    !> Which node, counted from 0
    integer, intent(in) :: number
    !> How many intervals the edge has
    integer, intent(in) :: intervals
    real(wp) :: place

    place = range(1) + number*((range(2) - range(1))/intervals)
    if (number == intervals) place = range(2)
  end function node

  !> Which walls a node lies on, as the bits 0 left, 1 right, 2 bottom, 3 top.
  pure function side_of_node(column, columns, row, rows) result(side)
    !> Column, counted from 0, and the last column
    integer, intent(in) :: column, columns
    !> Row, counted from 0, and the last row
    integer, intent(in) :: row, rows
    integer(ip) :: side

    side = 0
    if (column == 0) side = ibset(side, 0)
    if (column == columns) side = ibset(side, 1)
    if (row == 0) side = ibset(side, 2)
    if (row == rows) side = ibset(side, 3)
  end function side_of_node

end module calor_arrangement_lattice
