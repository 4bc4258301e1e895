!> Normals and lengths of walls that move with their particles.
!>
!> Walls are material lines. A wall particle's neighbours along its wall, found once, give a
!> tangent: that of the circle through three particles, (r_a - r)/|r_a - r|² - (r_b - r)/|r_b - r|²,
!> exact for straight and for circular walls. The normal of a contact turns as that tangent does,
!> and its length grows as the distances to the neighbours do. At a corner each wall has a tangent
!> of its own, from the two nearest particles on that side.
module calor_moving_walls
  use calor_body, only: body_t
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: wp, ip
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_text, only: to_text
  use calor_wall_contacts, only: wall_contacts_t
  implicit none (type, external)
  private

  public :: moving_walls_t

  !> Neighbours along a wall are nearer than so many spacings
  real(wp), parameter :: farthest_neighbour = 3.0_wp

  !> The walls of a body as they were at first
  type :: moving_walls_t
    !> The wall particles, and for each particle its place among them, 0 inside
    integer(ip), allocatable :: particle(:)
    integer, allocatable :: place(:)
    !> For each wall particle the next one with the body on the left, and the one before, as places
    !> among the wall particles
    integer, allocatable :: next(:), before(:)
    !> Whether a wall particle lies on two walls, so that it is a corner
    logical, allocatable :: corner(:)
    !> Distance from each wall particle to the next one at first, m
    real(wp), allocatable, private :: gap(:)
    !> The two particles that give a contact its tangent, the second one 0 where there is none
    integer, allocatable, private :: first(:), second(:)
    !> Whether the contact's length is that to the first one only
    logical, allocatable, private :: one_sided(:)
    !> Tangent, normal and length of contacts at first, and the distances that go with the lengths
    real(wp), allocatable, private :: tangent(:, :), normal(:, :), length(:), distance(:)
  contains
    !> Find who is beside whom
    procedure :: prepare
    !> Find normals and lengths anew
    procedure :: measure
    !> Outward normals of the wall particles, those of both walls together at corners
    procedure :: find_normals
    !> Where wall particles would stand for the parts of their wall that they had at first
    procedure :: slide
    !> The polygon that has the wall particles for corners
    procedure :: outline
    procedure, private :: join
    procedure, private :: orient
  end type moving_walls_t

contains

  !> Note the walls as they are. Walls without normals have none later.
  subroutine prepare(this, cloud, contacts, error)
    class(moving_walls_t), intent(out) :: this
    !> The cloud
    type(cloud_t), intent(in) :: cloud
    !> Where it touches the world
    type(wall_contacts_t), intent(in) :: contacts
    !> The particles of the walls make no closed lines
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    this%particle = pack([(int(k, ip), k=1, cloud%particles())], cloud%side /= 0)
    allocate (this%place(cloud%particles()), source=0)
    this%place(this%particle) = [(k, k=1, size(this%particle))]
    allocate (this%corner(size(this%particle)), source=.false.)
    do k = 2, size(contacts%particle)
      if (contacts%particle(k) == contacts%particle(k - 1)) then
        this%corner(this%place(contacts%particle(k))) = .true.
      end if
    end do
    if (.not. allocated(contacts%normal)) return
    call this%join(cloud, error)
    if (allocated(error)) return
    call this%orient(cloud, contacts)
  end subroutine prepare

  !> Who is next along the wall: the nearest one ahead that faces about the same way.
  subroutine join(this, cloud, error)
    class(moving_walls_t), intent(inout) :: this
    type(cloud_t), intent(in) :: cloud
    type(error_t), allocatable, intent(out) :: error
    type(neighbour_list_t) :: list
    integer :: k

    allocate (this%next(size(this%particle)), this%before(size(this%particle)))
    call build_neighbour_list(cloud%x(this%particle), cloud%y(this%particle), &
                              farthest_neighbour*cloud%spacing, list)
    do k = 1, size(this%particle)
      this%next(k) = nearest_ahead(k, 1.0_wp)
      this%before(k) = nearest_ahead(k, -1.0_wp)
    end do
    do k = 1, size(this%particle)
      if (this%next(k) > 0 .and. this%before(k) > 0) then
        if (this%before(this%next(k)) == k .and. this%next(this%before(k)) == k) cycle
      end if
      call raise(error, status_bad_input, 'The wall cannot be followed at particle '// &
                 to_text(cloud%user_index(this%particle(k)))//' at ('// &
                 to_text(cloud%x(this%particle(k)), digits=6)//', '// &
                 to_text(cloud%y(this%particle(k)), digits=6)//'): to move, the particles of a '// &
                 'wall must make a closed line, each about a spacing from the next.')
      return
    end do
    this%gap = hypot(cloud%x(this%particle(this%next)) - cloud%x(this%particle), &
                     cloud%y(this%particle(this%next)) - cloud%y(this%particle))

  contains

    !> The nearest particle along the wall with the body on the left (sense 1) or on the right (-1).
    pure function nearest_ahead(k, sense) result(found)
      integer, intent(in) :: k
      real(wp), intent(in) :: sense
      integer :: found
      real(wp) :: along, distance, least, dx, dy
      integer :: j, n

      found = 0
      least = huge(least)
      associate (i => this%particle(k))
        do n = int(list%first(k)), int(list%first(k + 1)) - 1
          j = this%particle(list%index(n))
          dx = cloud%x(j) - cloud%x(i)
          dy = cloud%y(j) - cloud%y(i)
          distance = hypot(dx, dy)
          along = sense*(cloud%normal_x(i)*dy - cloud%normal_y(i)*dx)
          if (along < 0.2_wp*distance .or. distance >= least) cycle
          if (cloud%normal_x(i)*cloud%normal_x(j) + cloud%normal_y(i)*cloud%normal_y(j) < &
              -0.3_wp) cycle
          least = distance
          found = list%index(n)
        end do
      end associate
    end function nearest_ahead

  end subroutine join

  !> The particles that give each contact its tangent, and what that is at first.
  subroutine orient(this, cloud, contacts)
    class(moving_walls_t), intent(inout) :: this
    type(cloud_t), intent(in) :: cloud
    type(wall_contacts_t), intent(in) :: contacts
    integer :: k, own, ahead, behind
    logical :: forward

    allocate (this%first(size(contacts%particle)), this%second(size(contacts%particle)))
    allocate (this%one_sided(size(contacts%particle)))
    allocate (this%tangent(2, size(contacts%particle)), this%distance(size(contacts%particle)))
    do k = 1, size(contacts%particle)
      own = this%place(contacts%particle(k))
      ahead = this%next(own)
      behind = this%before(own)
      this%one_sided(k) = this%corner(own)
      if (this%corner(own)) then
        forward = btest(cloud%side(this%particle(ahead)), contacts%side(k))
        if (forward) then
          this%first(k) = this%particle(ahead)
          this%second(k) = beyond(ahead, this%next(ahead))
        else
          this%first(k) = this%particle(behind)
          this%second(k) = beyond(behind, this%before(behind))
        end if
      else
        this%first(k) = this%particle(ahead)
        this%second(k) = this%particle(behind)
      end if
    end do
    do k = 1, size(contacts%particle)
      call look_along(this, cloud%x, cloud%y, contacts%particle(k), k, this%tangent(:, k), &
                      this%distance(k))
    end do
    this%normal = contacts%normal
    this%length = contacts%length

  contains

    !> The second one on the same wall, if the first one is no corner.
    pure function beyond(first, second) result(particle)
      integer, intent(in) :: first, second
      integer :: particle

      particle = 0
      if (.not. this%corner(first)) particle = this%particle(second)
    end function beyond

  end subroutine orient

  !> A contact's tangent, of any length, and the distances to its neighbours.
  pure subroutine look_along(this, x, y, i, contact, tangent, distance)
    class(moving_walls_t), intent(in) :: this
    real(wp), intent(in) :: x(:), y(:)
    integer(ip), intent(in) :: i
    integer, intent(in) :: contact
    real(wp), intent(out) :: tangent(2), distance
    real(wp) :: way(2), squared

    associate (a => this%first(contact), b => this%second(contact))
      way = [x(a) - x(i), y(a) - y(i)]
      squared = dot_product(way, way)
      tangent = way/squared
      distance = sqrt(squared)
      if (b == 0) return
      way = [x(b) - x(i), y(b) - y(i)]
      squared = dot_product(way, way)
      tangent = tangent - way/squared
      if (.not. this%one_sided(contact)) distance = distance + sqrt(squared)
    end associate
  end subroutine look_along

  subroutine measure(this, x, y, contacts)
    class(moving_walls_t), intent(in) :: this
    !> Places of all particles now, m
    real(wp), intent(in) :: x(:), y(:)
    !> Get their normals and lengths
    type(wall_contacts_t), intent(inout) :: contacts
    real(wp) :: tangent(2), distance, turn(2)
    integer :: k

    if (.not. allocated(this%normal)) return
    do k = 1, size(contacts%particle)
      call look_along(this, x, y, contacts%particle(k), k, tangent, distance)
      ! Cosine and sine of the angle between the tangents, times their lengths
      associate (old => this%tangent(:, k), normal => this%normal(:, k))
        turn = [old(1)*tangent(1) + old(2)*tangent(2), old(1)*tangent(2) - old(2)*tangent(1)]
        turn = turn/hypot(turn(1), turn(2))
        contacts%normal(:, k) = [turn(1)*normal(1) - turn(2)*normal(2), &
                                 turn(2)*normal(1) + turn(1)*normal(2)]
      end associate
      contacts%length(k) = this%length(k)*distance/this%distance(k)
    end do
  end subroutine measure

  !> Across the line from the particle before to the next one. Where the order of the particles is
  !> not known there are none.
  subroutine find_normals(this, x, y, normal)
    class(moving_walls_t), intent(in) :: this
    !> Places of all particles, m
    real(wp), intent(in) :: x(:), y(:)
    !> One a column, in the order of the wall particles
    real(wp), allocatable, intent(out) :: normal(:, :)
    integer :: k

    allocate (normal(2, size(this%particle)), source=0.0_wp)
    if (.not. allocated(this%next)) return
    do k = 1, size(this%particle)
      associate (a => this%particle(this%before(k)), b => this%particle(this%next(k)))
        normal(:, k) = [y(b) - y(a), x(a) - x(b)]
        normal(:, k) = normal(:, k)/hypot(normal(1, k), normal(2, k))
      end associate
    end do
  end subroutine find_normals

  !> Slide particles along the wall. Between two corners, or all around where there is none, each
  !> keeps the part of the length that it had at first; all around, the mean of all ways is 0. The
  !> wall between particles is taken as a cubic in the length along its chords.
  subroutine slide(this, x, y, new_x, new_y, origin)
    class(moving_walls_t), intent(in) :: this
    !> Places of all particles, m
    real(wp), intent(in) :: x(:), y(:)
    !> Those of wall particles become the new ones, m
    real(wp), intent(inout) :: new_x(:), new_y(:)
    !> The particle nearest to the new place; set for wall particles
    integer(ip), intent(inout) :: origin(:)
    logical, allocatable :: seen(:)
    integer, allocatable :: line(:)
    integer :: k, at

    if (.not. allocated(this%next)) return
    allocate (seen(size(this%particle)), source=.false.)
    do k = 1, size(this%particle)
      if (.not. this%corner(k)) cycle
      line = [k]
      at = this%next(k)
      do while (.not. this%corner(at))
        line = [line, at]
        at = this%next(at)
      end do
      seen(line) = .true.
      line = [line, at]
      call slide_line(this, line, .false., x, y, new_x, new_y, origin)
    end do
    do k = 1, size(this%particle)
      if (seen(k)) cycle
      line = [k]
      at = this%next(k)
      do while (at /= k)
        line = [line, at]
        at = this%next(at)
      end do
      seen(line) = .true.
      line = [line, k]
      call slide_line(this, line, .true., x, y, new_x, new_y, origin)
    end do
  end subroutine slide

  !> Slide the particles of one line.
  subroutine slide_line(this, line, closed, x, y, new_x, new_y, origin)
    class(moving_walls_t), intent(in) :: this
    !> Wall particles in their order; the last one is the first one if the line is closed
    integer, intent(in) :: line(:)
    logical, intent(in) :: closed
    real(wp), intent(in) :: x(:), y(:)
    real(wp), intent(inout) :: new_x(:), new_y(:)
    integer(ip), intent(inout) :: origin(:)
    real(wp), allocatable :: s(:), first_s(:), target(:), node_x(:), node_y(:)
    real(wp) :: weight(4), total
    integer :: k, n, j, from, m, a

    n = size(line) - 1
    allocate (s(0:n), first_s(0:n), target(0:n), node_x(0:n), node_y(0:n))
    node_x = x(this%particle(line))
    node_y = y(this%particle(line))
    s(0) = 0
    first_s(0) = 0
    do k = 1, n
      s(k) = s(k - 1) + hypot(node_x(k) - node_x(k - 1), node_y(k) - node_y(k - 1))
      first_s(k) = first_s(k - 1) + this%gap(line(k))
    end do
    total = s(n)
    target = first_s*(total/first_s(n))
    if (closed) target = target + sum(s(0:n - 1) - target(0:n - 1))/n
    do k = merge(0, 1, closed), n - 1
      ! The node at or before the target; beyond the ends only where the line is closed
      j = k
      do while (along(j) > target(k) .and. (closed .or. j > 0))
        j = j - 1
      end do
      do while (along(j + 1) <= target(k) .and. (closed .or. j < n - 1))
        j = j + 1
      end do
      from = j - 1
      if (.not. closed) from = max(0, min(from, n - 3))
      m = 4
      if (.not. closed) m = min(4, n + 1)
      call lagrange(m)
      associate (particle => this%particle(line(k + 1)))
        new_x(particle) = 0
        new_y(particle) = 0
        do a = 1, m
          new_x(particle) = new_x(particle) + weight(a)*node_x(folded(from + a - 1))
          new_y(particle) = new_y(particle) + weight(a)*node_y(folded(from + a - 1))
        end do
        if (target(k) - along(j) > along(j + 1) - target(k)) j = j + 1
        origin(particle) = this%particle(line(folded(j) + 1))
      end associate
    end do

  contains

    !> The place of a node among 0 … n - 1 of a closed line
    pure function folded(node) result(place)
      integer, intent(in) :: node
      integer :: place

      place = node
      if (closed) place = modulo(node, n)
    end function folded

    !> Length along the line up to a node
    pure function along(node) result(length)
      integer, intent(in) :: node
      real(wp) :: length

      length = s(folded(node))
      if (closed) length = length + total*((node - folded(node))/n)
    end function along

    !> Weights of the nodes from `from` on at the target
    subroutine lagrange(nodes)
      integer, intent(in) :: nodes
      integer :: a, b

      weight = 0
      do a = 1, nodes
        weight(a) = 1
        do b = 1, nodes
          if (a == b) cycle
          weight(a) = weight(a)*(target(k) - along(from + b - 1))/ &
                      (along(from + a - 1) - along(from + b - 1))
        end do
      end do
    end subroutine lagrange

  end subroutine slide_line

  subroutine outline(this, x, y, body)
    class(moving_walls_t), intent(in) :: this
    !> Places of all particles, m
    real(wp), intent(in) :: x(:), y(:)
    !> The body; without edges where the order of the wall particles is not known
    type(body_t), intent(out) :: body
    logical, allocatable :: seen(:)
    integer :: k, at, edges

    body%shape = 'body'
    allocate (body%edge(0), body%first(0))
    if (.not. allocated(this%next)) return
    deallocate (body%edge)
    allocate (body%edge(size(this%particle)))
    allocate (seen(size(this%particle)), source=.false.)
    edges = 0
    do k = 1, size(this%particle)
      if (seen(k)) cycle
      body%first = [body%first, edges + 1]
      at = k
      do while (.not. seen(at))
        seen(at) = .true.
        edges = edges + 1
        associate (a => this%particle(at), b => this%particle(this%next(at)))
          body%edge(edges)%start = [x(a), y(a)]
          body%edge(edges)%finish = [x(b), y(b)]
        end associate
        at = this%next(at)
      end do
    end do
    body%first = [body%first, edges + 1]
  end subroutine outline

end module calor_moving_walls
