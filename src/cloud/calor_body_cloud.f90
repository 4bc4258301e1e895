!> Bodies of any shape filled with particles.
module calor_body_cloud
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_arrangements, only: arrangement_choices
  use calor_body, only: body_t
  use calor_cell_area, only: find_cell_areas
  use calor_choice, only: choice_names
  use calor_cloud, only: cloud_t, allocate_cloud
  use calor_error, only: error_t, raise, status_bad_input
  use calor_inner_nodes, only: grid_t, nodes_inside
  use calor_kinds, only: wp, ip
  use calor_relaxation, only: relax_particles
  use calor_slice, only: slice_t
  use calor_text, only: suggestion, to_text
  use calor_wall_particles, only: wall_particles_t, place_wall_particles
  implicit none (type, external)
  private

  public :: fill_body, check_spacing, check_jitter

  !> Inner particles are no nearer to a wall, in spacings: half of it, for so far reaches what a
  !> wall particle stands for
  real(wp), parameter :: clearance = 0.5_wp

contains

  !> Fill a body with particles: evenly on its walls, and inside by an arrangement.
  !>
  !> Lattice and hexagonal nodes fit the body's extent and are kept where they are at least half a
  !> spacing away from the walls; 'jittered' displaces those of the lattice, and not towards a wall
  !> beyond that. 'relaxed' starts from one particle at a random place of each cell of a lattice and
  !> lets them repel each other, so that they fit the walls.
  !> Wall particles come first. Fails with status_bad_input where spacing, arrangement or jitter
  !> make no sense, or give more particles than can be numbered or held in memory.
  subroutine fill_body(body, spacing, arrangement, jitter, seed, cloud, error, slice)
    !> The body
    type(body_t), intent(in) :: body
    !> Wanted distance of neighbours, m
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
    !> Only a slice of them, without areas: some on the walls, and those of some columns, numbered
    !> from 1 after all of the walls. 'relaxed' particles come only together
    type(slice_t), intent(in), optional :: slice
    type(grid_t) :: grid
    type(wall_particles_t) :: walls
    real(wp), allocatable :: x(:), y(:)
    integer :: first, k, last, on_walls

    call check_spacing(body, spacing, error)
    if (allocated(error)) return
    grid = cover(body, spacing, arrangement)
    grid%seed = seed
    select case (arrangement)
    case ('lattice', 'hexagonal')
      continue
    case ('jittered')
      call check_jitter(jitter, error)
      grid%jitter = jitter
    case ('relaxed')
      grid%jitter = 0.5_wp
      grid%free = .true.
    case default
      call raise(error, status_bad_input, 'No arrangement is called '''//arrangement//'''.'// &
                 suggestion(arrangement, choice_names(arrangement_choices)))
    end select
    if (allocated(error)) return
    call place_wall_particles(body, spacing, walls, error)
    if (allocated(error)) return
    on_walls = walls%number
    first = 0
    if (present(slice)) then
      call slice%share(on_walls, first, last)
      call walls%keep(first + 1, last + 1)
    end if
    call nodes_inside(grid, body, clearance*spacing, x, y, slice)
    x = [walls%x, x]
    y = [walls%y, y]
    if (arrangement == 'relaxed') call relax_particles(body, spacing, walls%number, x, y)

    call allocate_cloud(cloud, size(x), error)
    if (allocated(error)) return
    if (present(slice)) then
      cloud%user_index(:walls%number) = [(k, k=first + 1, first + walls%number)]
      cloud%user_index(walls%number + 1:) = [(k, k=on_walls + 1, on_walls + size(x) - &
                                              walls%number)]
    else
      call find_cell_areas(body, spacing, x, y, cloud%area)
    end if
    call move_alloc(x, cloud%x)
    call move_alloc(y, cloud%y)
    cloud%volume = grid%width*grid%height
    allocate (cloud%normal_x(cloud%particles()), source=0.0_wp)
    allocate (cloud%normal_y, cloud%wall_length, source=cloud%normal_x)
    associate (n => walls%number)
      cloud%side(:n) = walls%side
      cloud%normal_x(:n) = walls%normal_x
      cloud%normal_y(:n) = walls%normal_y
      cloud%wall_length(:n) = walls%length
    end associate
    cloud%boundary = body%boundary
    cloud%spacing = spacing
  end subroutine fill_body

  !> A grid over the extent of a body. For 'relaxed' its cells have exactly the area that a particle
  !> fills, otherwise they fit the extent.
  pure function cover(body, spacing, arrangement) result(grid)
    type(body_t), intent(in) :: body
    real(wp), intent(in) :: spacing
    character(len=*), intent(in) :: arrangement
    type(grid_t) :: grid
    real(wp) :: height, width, x_range(2), y_range(2)

    call body%find_extent(x_range, y_range)
    width = x_range(2) - x_range(1)
    height = y_range(2) - y_range(1)
    grid%x = x_range(1)
    grid%y = y_range(1)
    grid%rows = max(1, nint(height/spacing))
    select case (arrangement)
    case ('hexagonal')
      grid%columns = 2*max(1, nint(width/(sqrt(3.0_wp)*spacing)))
      grid%shift = 0.5_wp
    case ('relaxed')
      grid%columns = ceiling(width/spacing)
      grid%rows = ceiling(height/spacing)
      grid%width = spacing
      grid%height = spacing
      return
    case default
      grid%columns = max(1, nint(width/spacing))
    end select
    grid%width = width/grid%columns
    grid%height = height/grid%rows
  end function cover

  !> Check that a spacing fits into a body's extent and does not give too many particles.
  pure subroutine check_spacing(body, spacing, error)
    !> The body
    type(body_t), intent(in) :: body
    !> Wanted distance of neighbours, m
    real(wp), intent(in) :: spacing
    !> What is wrong with the spacing
    type(error_t), allocatable, intent(out) :: error
    !> What an extent may fall short of one spacing by rounding
    real(wp), parameter :: tolerance = 1.0e-9_wp
    !> The densest arrangement has 2/√3 as many particles as a lattice, and walls √2
    real(wp), parameter :: densest = 1.16_wp, densest_on_walls = 1.5_wp
    real(wp) :: height, width, x_range(2), y_range(2)

    if (.not. ieee_is_finite(spacing)) then
      call raise(error, status_bad_input, 'spacing must be an ordinary number.')
    else if (spacing <= 0) then
      call raise(error, status_bad_input, 'spacing = '//to_text(spacing)// &
                 ' is not positive; it is the distance between neighbouring particles.')
    end if
    if (allocated(error)) return
    call body%find_extent(x_range, y_range)
    width = x_range(2) - x_range(1)
    height = y_range(2) - y_range(1)
    if (spacing > (1 + tolerance)*min(width, height)) then
      call raise(error, status_bad_input, 'spacing = '//to_text(spacing)//' is larger than the '// &
                 body%shape//', which is '//to_text(width, digits=6)//' by '// &
                 to_text(height, digits=6)//'.')
    else if (densest*body%particles_about(spacing) > huge(1_ip) .or. &
             densest_on_walls*body%perimeter() > huge(1_ip)*spacing) then
      call raise(error, status_bad_input, 'spacing = '//to_text(spacing)// &
                 ' gives more than the '//to_text(huge(1_ip))//' particles that can be numbered.')
    end if
  end subroutine check_spacing

  !> Check that displaced neighbours cannot meet.
  pure subroutine check_jitter(jitter, error)
    !> Largest displacement in units of the spacing
    real(wp), intent(in) :: jitter
    !> It is not below 0.5, or negative
    type(error_t), allocatable, intent(out) :: error

    if (.not. ieee_is_finite(jitter)) then
      call raise(error, status_bad_input, 'jitter must be an ordinary number.')
    else if (jitter < 0 .or. jitter >= 0.5_wp) then
      call raise(error, status_bad_input, 'jitter = '//to_text(jitter)//' must be at least 0 '// &
                 'and less than 0.5: two neighbours that are both displaced by half a spacing '// &
                 'could meet.')
    end if
  end subroutine check_jitter

end module calor_body_cloud
