!> Particles on the boundary of a body.
module calor_wall_particles
  use calor_body, only: body_t, edge_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: wp, ip
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: wall_particles_t, place_wall_particles

  !> Particles on the boundary, with what they stand for
  type :: wall_particles_t
    !> Coordinates, m
    real(wp), allocatable :: x(:), y(:)
    !> The boundaries that a particle lies on, as `cloud_t%side` has them
    integer(ip), allocatable :: side(:)
    !> Outward unit normal
    real(wp), allocatable :: normal_x(:), normal_y(:)
    !> The length of boundary that a particle stands for, m
    real(wp), allocatable :: length(:)
    !> How many there are; arrays may be longer while they are filled
    integer :: number = 0
  contains
    procedure, private :: put
    !> Keep some of them
    procedure :: keep
  end type wall_particles_t

  !> An edge shorter than so many spacings is too short for a particle at each end
  real(wp), parameter :: shortest_edge = 0.7_wp
  !> A vertex where the boundary turns by no more than this (its cosine: 30 degrees) and which has a
  !> short edge is no corner but a point of a curve
  real(wp), parameter :: cosine_of_curve = sqrt(0.75_wp)
  !> Walls that come nearer to each other than so many spacings leave no room between them
  real(wp), parameter :: nearest_walls = 0.25_wp

contains

  !> Place particles evenly on every edge and circle, about a spacing apart, and at every corner.
  !>
  !> Distances are between 0.7 and √2 spacings, and nearly one spacing on all but short edges.
  !> Where a polygon traces a curve by vertices that are nearer to each other than the spacing,
  !> particles are placed evenly along the curve instead. A corner particle stands for half the
  !> distances to both of its neighbours; its normal is the mean of both edges' normals.
  !> Lengths sum to the length of the boundary, that of arcs for a circle.
  subroutine place_wall_particles(body, spacing, walls, error)
    !> The body
    type(body_t), intent(in) :: body
    !> Wanted distance of neighbours, m
    real(wp), intent(in) :: spacing
    !> The particles, in the order of the edges
    type(wall_particles_t), intent(out) :: walls
    !> The spacing is too large for an edge, or for what lies between two walls
    type(error_t), allocatable, intent(out) :: error
    integer :: loop, most

    most = ceiling(1.5_wp*body%perimeter()/spacing) + size(body%edge)
    allocate (walls%x(most), walls%y(most), walls%side(most), walls%normal_x(most), &
              walls%normal_y(most), walls%length(most))
    do loop = 1, size(body%first) - 1
      associate (edges => body%edge(body%first(loop):body%first(loop + 1) - 1))
        if (edges(1)%is_circle()) then
          call place_on_circle(body%shape, edges(1), spacing, walls, error)
        else
          call place_on_polygon(body%shape, edges, body%first(loop) - 1, spacing, walls, error)
        end if
      end associate
      if (allocated(error)) return
    end do
    call walls%keep(1, walls%number)
    call check_distances(body%shape, walls, spacing, error)
  end subroutine place_wall_particles

  subroutine put(this, place, side, normal, length)
    class(wall_particles_t), intent(inout) :: this
    real(wp), intent(in) :: place(2)
    integer(ip), intent(in) :: side
    !> Normal of any length
    real(wp), intent(in) :: normal(2)
    real(wp), intent(in) :: length

    this%number = this%number + 1
    associate (k => this%number, norm => hypot(normal(1), normal(2)))
      this%x(k) = place(1)
      this%y(k) = place(2)
      this%side(k) = side
      this%normal_x(k) = normal(1)/norm
      this%normal_y(k) = normal(2)/norm
      this%length(k) = length
    end associate
  end subroutine put

  subroutine keep(this, first, last)
    class(wall_particles_t), intent(inout) :: this
    !> The first and the last to keep
    integer, intent(in) :: first, last

    this%x = this%x(first:last)
    this%y = this%y(first:last)
    this%side = this%side(first:last)
    this%normal_x = this%normal_x(first:last)
    this%normal_y = this%normal_y(first:last)
    this%length = this%length(first:last)
    this%number = max(0, last - first + 1)
  end subroutine keep

  !> Into how many parts a length is divided so that they come nearest to the spacing.
  pure function intervals(length, spacing) result(number)
    real(wp), intent(in) :: length, spacing
    integer :: number
    real(wp) :: parts

    parts = length/spacing
    number = max(1, floor(parts))
    ! The next number is nearer if the spacing is missed by a smaller factor
    if (parts*parts > real(number, wp)*(number + 1)) number = number + 1
  end function intervals

  subroutine place_on_circle(shape, edge, spacing, walls, error)
    character(len=*), intent(in) :: shape
    type(edge_t), intent(in) :: edge
    real(wp), intent(in) :: spacing
    type(wall_particles_t), intent(inout) :: walls
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: place(2), step
    integer :: k, number

    if (shortest_edge*spacing > edge%radius) then
      call raise(error, status_bad_input, 'spacing = '//to_text(spacing)//' is too large for '// &
                 'the '//shape//', whose boundary has a radius of '// &
                 to_text(edge%radius, digits=6)//' m: take at most '// &
                 to_text(edge%radius/shortest_edge, digits=2)//'.')
      return
    end if
    number = intervals(edge%length(), spacing)
    step = edge%length()/number
    do k = 0, number - 1
      place = edge%at(k*step)
      call walls%put(place, edge%side, edge%outward(place), step)
    end do
  end subroutine place_on_circle

  !> One loop of a polygon.
  subroutine place_on_polygon(shape, edges, before, spacing, walls, error)
    character(len=*), intent(in) :: shape
    type(edge_t), intent(in) :: edges(:)
    !> How many edges of the polygon come before these
    integer, intent(in) :: before
    real(wp), intent(in) :: spacing
    type(wall_particles_t), intent(inout) :: walls
    type(error_t), allocatable, intent(out) :: error
    !> The edges that begin at a corner; a stretch goes from there to before the next one
    integer, allocatable :: begin(:)
    integer, allocatable :: stretch(:)
    real(wp) :: length
    integer :: k, previous

    begin = pack([(k, k=1, size(edges))], find_corners(edges, spacing))
    ! The step of the stretch before a corner is that of the last one for the first
    previous = size(begin)
    do k = 1, size(begin)
      stretch = stretch_of(begin, k, size(edges))
      length = total_length(edges(stretch))
      if (length < shortest_edge*spacing) then
        call raise(error, status_bad_input, 'spacing = '//to_text(spacing)//' is too large '// &
                   'for the '//shape//', whose edge '//to_text(before + begin(k))//' is '// &
                   to_text(length, digits=4)//' m long: take at most '// &
                   to_text(length/shortest_edge, digits=2)//'.')
        return
      end if
      call place_on_stretch(edges(stretch_of(begin, previous, size(edges))), edges(stretch), &
                            spacing, walls)
      previous = k
    end do
  end subroutine place_on_polygon

  !> The edges from a corner to before the next one.
  pure function stretch_of(begin, corner, edges) result(stretch)
    !> Edges that begin at a corner
    integer, intent(in) :: begin(:)
    !> Which of the corners
    integer, intent(in) :: corner
    !> How many edges the loop has
    integer, intent(in) :: edges
    integer, allocatable :: stretch(:)
    integer :: k, last

    last = begin(mod(corner, size(begin)) + 1) - 1
    if (last < begin(corner)) last = last + edges
    stretch = [(mod(k - 1, edges) + 1, k=begin(corner), last)]
  end function stretch_of

  pure function total_length(edges) result(length)
    type(edge_t), intent(in) :: edges(:)
    real(wp) :: length
    integer :: k

    length = 0
    do k = 1, size(edges)
      length = length + edges(k)%length()
    end do
  end function total_length

  !> Which edges begin at a corner.
  pure function find_corners(edges, spacing) result(corner)
    type(edge_t), intent(in) :: edges(:)
    real(wp), intent(in) :: spacing
    logical :: corner(size(edges))
    integer :: k, previous

    do k = 1, size(edges)
      previous = modulo(k - 2, size(edges)) + 1
      associate (one => edges(previous), other => edges(k))
        corner(k) = min(one%length(), other%length()) >= shortest_edge*spacing
        if (.not. corner(k)) then
          corner(k) = dot_product(one%outward(one%start), other%outward(other%start)) < &
                      cosine_of_curve
        end if
      end associate
    end do
    if (.not. any(corner)) corner(1) = .true.
  end function find_corners

  !> Particles from the corner where a stretch of edges begins to before the one where it ends.
  subroutine place_on_stretch(before, edges, spacing, walls)
    !> The stretch that ends where this one begins
    type(edge_t), intent(in) :: before(:)
    !> The stretch
    type(edge_t), intent(in) :: edges(:)
    real(wp), intent(in) :: spacing
    type(wall_particles_t), intent(inout) :: walls
    real(wp) :: passed, step
    integer :: e, k, number

    number = intervals(total_length(edges), spacing)
    step = total_length(edges)/number
    associate (last => before(size(before)), first => edges(1))
      passed = total_length(before)
      call walls%put(first%start, ior(last%side, first%side), &
                     last%outward(last%start) + first%outward(first%start), &
                     0.5_wp*(passed/intervals(passed, spacing) + step))
    end associate
    e = 1
    passed = 0
    do k = 1, number - 1
      do while (k*step > passed + edges(e)%length() .and. e < size(edges))
        passed = passed + edges(e)%length()
        e = e + 1
      end do
      call walls%put(edges(e)%at(k*step - passed), edges(e)%side, &
                     edges(e)%outward(edges(e)%start), step)
    end do
  end subroutine place_on_stretch

  !> No two wall particles may be much nearer to each other than the spacing.
  subroutine check_distances(shape, walls, spacing, error)
    character(len=*), intent(in) :: shape
    type(wall_particles_t), intent(in) :: walls
    real(wp), intent(in) :: spacing
    type(error_t), allocatable, intent(out) :: error
    type(neighbour_list_t) :: list
    integer :: k

    call build_neighbour_list(walls%x, walls%y, nearest_walls*spacing, list)
    do k = 1, walls%number
      if (list%first(k + 1) == list%first(k)) cycle
      associate (other => list%index(list%first(k)))
        call raise(error, status_bad_input, 'spacing = '//to_text(spacing)//' is too large '// &
                   'for the '//shape//': at ('//to_text(walls%x(k), digits=6)//', '// &
                   to_text(walls%y(k), digits=6)//') two walls are only '// &
                   to_text(hypot(walls%x(k) - walls%x(other), walls%y(k) - walls%y(other)), &
                           digits=3)//' m apart. Lower it.')
      end associate
      return
    end do
  end subroutine check_distances

end module calor_wall_particles
