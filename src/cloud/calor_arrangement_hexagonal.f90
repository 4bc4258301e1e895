!> Particles on the nodes of a lattice of equilateral triangles, walls included.
module calor_arrangement_hexagonal
  use calor_arrangement_lattice, only: lattice_intervals, node, side_of_node
  use calor_cloud, only: cloud_t, allocate_cloud
  use calor_error, only: error_t
  use calor_kinds, only: wp
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
  subroutine arrange_hexagonal(x_range, y_range, spacing, cloud, error)
    !> Left and right, bottom and top edge, m
    real(wp), intent(in) :: x_range(2), y_range(2)
    !> Wanted distance of neighbours, m
    real(wp), intent(in) :: spacing
    !> The particles; its boundaries are left to the caller
    type(cloud_t), intent(out) :: cloud
    !> There is not enough memory
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: height, y
    integer :: column, columns, last, particle, row, rows, shift

    columns = 2*lattice_intervals(x_range, sqrt(3.0_wp)*spacing)
    rows = lattice_intervals(y_range, spacing)
    height = (y_range(2) - y_range(1))/rows
    call allocate_cloud(cloud, (columns + 1)*(rows + 1) + columns/2, error)
    if (allocated(error)) return
    particle = 0
    do column = 0, columns
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
  end subroutine arrange_hexagonal

end module calor_arrangement_hexagonal
