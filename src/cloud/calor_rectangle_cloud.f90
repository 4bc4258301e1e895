!> Rectangles filled with particles.
module calor_rectangle_cloud
  use calor_arrangement_hexagonal, only: arrange_hexagonal
  use calor_arrangement_jittered, only: arrange_jittered
  use calor_arrangement_lattice, only: arrange_lattice
  use calor_body, only: body_t
  use calor_body_cloud, only: fill_body, check_jitter, check_spacing
  use calor_cell_area, only: find_cell_areas
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t
  use calor_kinds, only: wp, ip
  use calor_rectangle_body, only: make_rectangle_body
  use calor_slice, only: slice_t
  implicit none (type, external)
  private

  public :: make_rectangle

contains

  !> Fill a rectangle with particles, the outermost of which lie on its walls.
  !>
  !> The boundaries are 'left', 'right', 'bottom' and 'top'; a corner belongs to two of them.
  !> Columns and rows of particles fit the rectangle and end on its walls; only 'relaxed' particles
  !> are placed as in any other body.
  !> Fails with status_bad_input where the ranges, the spacing, the arrangement or the jitter make
  !> no sense, or give more particles than can be numbered or held in memory.
  subroutine make_rectangle(x_range, y_range, spacing, arrangement, jitter, seed, cloud, error, &
                            slice)
    !> Left and right, bottom and top edge, m
    real(wp), intent(in) :: x_range(2), y_range(2)
    !> Wanted distance of neighbours, m; fitted to the edges
    real(wp), intent(in) :: spacing
    !> One of the names in `arrangement_choices`
    character(len=*), intent(in) :: arrangement
    !> Largest displacement in units of the spacing, below 0.5; for 'jittered' only
    real(wp), intent(in) :: jitter
    !> Which of all such clouds; for 'jittered' and 'relaxed'
    integer, intent(in) :: seed
    !> The particles
    type(cloud_t), intent(out) :: cloud
    !> What is wrong with the request
    type(error_t), allocatable, intent(out) :: error
    !> Only a slice of them, without areas
    type(slice_t), intent(in), optional :: slice
    type(body_t) :: body
    integer(ip) :: k

    call make_rectangle_body(x_range, y_range, body, error)
    if (.not. allocated(error)) call check_spacing(body, spacing, error)
    if (allocated(error)) return

    select case (arrangement)
    case ('lattice')
      call arrange_lattice(x_range, y_range, spacing, cloud, error, slice)
    case ('hexagonal')
      call arrange_hexagonal(x_range, y_range, spacing, cloud, error, slice)
    case ('jittered')
      call check_jitter(jitter, error)
      if (.not. allocated(error)) then
        call arrange_jittered(x_range, y_range, spacing, jitter, seed, cloud, error, slice)
      end if
    case default
      call fill_body(body, spacing, arrangement, jitter, seed, cloud, error, slice)
      return
    end select
    if (allocated(error)) return
    cloud%boundary = body%boundary
    cloud%spacing = spacing
    call measure_walls(body, cloud)
    if (present(slice)) then
      ! The columns beside it have served.
      call cloud%reorder([(k, k=cloud%own_first, cloud%own_last)])
      cloud%own_first = 1
      cloud%own_last = cloud%particles()
      return
    end if
    call find_cell_areas(body, spacing, cloud%x, cloud%y, cloud%area)
  end subroutine make_rectangle

  !> Normals and lengths of the walls.
  subroutine measure_walls(body, cloud)
    type(body_t), intent(in) :: body
    !> With the particles of every wall in the order of their coordinates
    type(cloud_t), intent(inout) :: cloud
    integer, allocatable :: wall(:)
    real(wp), allocatable :: gap(:)
    real(wp) :: normal(2)
    integer :: edge, k

    allocate (cloud%normal_x(cloud%particles()), source=0.0_wp)
    allocate (cloud%normal_y, cloud%wall_length, source=cloud%normal_x)
    do edge = 1, size(body%edge)
      normal = body%edge(edge)%outward(body%edge(edge)%start)
      wall = pack([(k, k=1, cloud%particles())], iand(cloud%side, body%edge(edge)%side) /= 0)
      cloud%normal_x(wall) = cloud%normal_x(wall) + normal(1)
      cloud%normal_y(wall) = cloud%normal_y(wall) + normal(2)
      associate (before => wall(:size(wall) - 1), after => wall(2:))
        gap = cloud%x(after) - cloud%x(before) + cloud%y(after) - cloud%y(before)
        cloud%wall_length(before) = cloud%wall_length(before) + 0.5_wp*gap
        cloud%wall_length(after) = cloud%wall_length(after) + 0.5_wp*gap
      end associate
    end do
    ! In the corners there are two normals
    where (popcnt(cloud%side) == 2)
      cloud%normal_x = sqrt(0.5_wp)*cloud%normal_x
      cloud%normal_y = sqrt(0.5_wp)*cloud%normal_y
    end where
  end subroutine measure_walls

end module calor_rectangle_cloud
