!> Particles on the nodes of a lattice of equilateral triangles, walls included.
module calor_arrangement_hexagonal
  use calor_arrangement_lattice, only: lattice_intervals, node, side_of_node
  use calor_cloud, only: cloud_t, allocate_cloud
  use calor_error, only: error_t
  use calor_kinds, only: wp
  use calor_slice, only: slice_t, share_of
  implicit none (type, external)
  private

  public :: arrange_hexagonal

contains

  !> Fill a rectangle with columns of particles, every second one shifted by half a spacing.
  !>
  !> Columns are √3/2 of a spacing apart, stretched a little so that an even number of intervals
  !> fits: the left and the right wall are both unshifted columns. A shifted column has besides one
  !> particle on the bottom and one on the top, half a spacing from the next. So neighbours along
  !> the left and right walls are a spacing apart and those along bottom and top √3/2 of it, and no
  !> inner particle is nearer to a wall than about half a spacing.
  !> Particles go column by column from the left, each from the bottom. Every particle, also one on
  !> a wall, has the volume of a whole cell.
  subroutine arrange_hexagonal(x_range, y_range, spacing, cloud, error, slice)
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
    real(wp) :: height, y
    integer :: begin, column, columns, end, last, own_begin, own_end, particle, row, rows, shift

    columns = 2*lattice_intervals(x_range, sqrt(3.0_wp)*spacing)
    rows = lattice_intervals(y_range, spacing)
    height = (y_range(2) - y_range(1))/rows
    call share_of(columns + 1, own_begin, own_end, begin, end, slice)
    call allocate_cloud(cloud, before(end + 1) - before(begin), error)
    if (allocated(error)) return
    cloud%user_index = cloud%user_index + before(begin)
    cloud%own_first = before(own_begin) - before(begin) + 1
    cloud%own_last = before(own_end + 1) - before(begin)
    particle = 0
    do column = begin, end
      shift = mod(column, 2)
      last = rows + shift
      do row = 0, last
        y = node(y_range, row, last)
        if (row > 0 .and. row < last) y = y_range(1) + (row - 0.5_wp*shift)*height
        particle = particle + 1
        cloud%x(particle) = node(x_range, column, columns)
        cloud%y(particle) = y
        cloud%side(particle) = side_of_node(column, columns, row, last)
      end do
    end do
    cloud%volume = (x_range(2) - x_range(1))/columns*height

  contains

    !> How many particles are in columns before one
    pure integer function before(column)
      integer, intent(in) :: column

      before = column*(rows + 1) + column/2
    end function before

  end subroutine arrange_hexagonal

end module calor_arrangement_hexagonal
