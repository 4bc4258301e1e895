!> The area of a body that each of its particles stands for.
module calor_cell_area
  use calor_body, only: body_t, edge_t
  use calor_constants, only: pi, worth_threads
  use calor_kinds, only: wp, ip
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  implicit none (type, external)
  private

  public :: find_cell_areas

  !> Every place of a body is nearer than that to a particle, in spacings, so that cells need not go
  !> further; an odd number, so that their border never falls onto a wall
  real(wp), parameter :: half_width = 1.4637_wp
  !> What is nearer to another particle, where that is more than twice as far, is too far away
  real(wp), parameter :: listed = 2*half_width
  !> Most cells need no particles farther away than that, in spacings …
  real(wp), parameter :: listed_first = 2.1_wp
  !> … and few others than such that are nearer than that
  real(wp), parameter :: near = 1.5_wp

  !> A convex polygon with its corners counter-clockwise
  type :: cell_t
    real(wp), allocatable :: x(:), y(:)
    integer :: corners = 0
  end type cell_t

contains

  !> The area of what is nearer to a particle than to any other and lies in the body: its Voronoi
  !> cell, cut off at the walls.
  !>
  !> The areas sum to that of the body. Particles on a straight wall of a lattice get half a cell,
  !> those in a corner a quarter. Sums of values times areas are integrals, exact for constants and
  !> of second order in the spacing.
  subroutine find_cell_areas(body, spacing, x, y, area)
    !> The body
    type(body_t), intent(in) :: body
    !> Distance of neighbours, m; no place of the body is further than 1.46 of it from a particle
    real(wp), intent(in) :: spacing
    !> Coordinates of the particles, m
    real(wp), intent(in) :: x(:), y(:)
    !> m²
    real(wp), allocatable, intent(out) :: area(:)
    integer(ip), allocatable :: rest(:)
    logical, allocatable :: complete(:)
    integer :: i

    allocate (area(size(x)), complete(size(x)))
    rest = [(int(i, ip), i=1, size(x))]
    call measure_cells(body, spacing, x, y, rest, listed_first*spacing, area, complete)
    rest = pack(rest, .not. complete)
    if (size(rest) == 0) return
    call measure_cells(body, spacing, x, y, rest, listed*spacing, area, complete)
  end subroutine find_cell_areas

  !> The areas of some cells, among neighbours up to a distance.
  subroutine measure_cells(body, spacing, x, y, particles, reach, area, complete)
    type(body_t), intent(in) :: body
    real(wp), intent(in) :: spacing
    real(wp), intent(in) :: x(:), y(:)
    !> Whose cells
    integer(ip), intent(in) :: particles(:)
    !> The distance, m
    real(wp), intent(in) :: reach
    !> Set where complete
    real(wp), intent(inout) :: area(:)
    !> Whether no particle beyond that distance could cut off anything
    logical, intent(inout) :: complete(:)
    type(neighbour_list_t) :: list
    type(cell_t) :: cell, scratch
    real(wp) :: distance, extent, inward(2)
    integer :: i, k, most

    call build_neighbour_list(x, y, reach, list, particles)
    most = list%longest_row() + 4
    !$omp parallel if (size(particles) > worth_threads) default(shared) &
    !$omp private(cell, scratch, distance, extent, inward, i, k)
    allocate (cell%x(most), cell%y(most), scratch%x(most), scratch%y(most))
    !$omp do schedule(dynamic, 256)
    do k = 1, list%rows()
      i = list%target(k)
      call start_cell(half_width*spacing, cell)
      extent = sqrt(2.0_wp)*half_width*spacing
      call cut_by_all(list%index(list%first(k):list%first(k + 1) - 1), i, x, y, &
                      (near*spacing)**2, cell, scratch, extent)
      complete(i) = 2*extent <= reach .or. reach >= listed*spacing
      if (.not. complete(i)) cycle
      call body%find_wall([x(i), y(i)], distance, inward)
      if (distance > extent) then
        area(i) = polygon_area(cell)
      else
        area(i) = common_area(body, [x(i), y(i)], extent, cell)
      end if
    end do
    !$omp end do
    deallocate (cell%x, cell%y, scratch%x, scratch%y)
    !$omp end parallel
  end subroutine measure_cells

  !> Cut off what is nearer to neighbours: first to near ones, after which few others can reach the
  !> cell.
  pure subroutine cut_by_all(neighbours, i, x, y, near_squared, cell, scratch, extent)
    integer(ip), intent(in) :: neighbours(:)
    integer, intent(in) :: i
    real(wp), intent(in) :: x(:), y(:)
    !> Squared distance of near ones, m²
    real(wp), intent(in) :: near_squared
    type(cell_t), intent(inout) :: cell, scratch
    real(wp), intent(inout) :: extent
    real(wp) :: other(2), distance_squared
    integer :: k, time

    do time = 1, 2
      do k = 1, size(neighbours)
        other(1) = x(neighbours(k)) - x(i)
        other(2) = y(neighbours(k)) - y(i)
        distance_squared = other(1)*other(1) + other(2)*other(2)
        if ((distance_squared < near_squared) .neqv. time == 1) cycle
        if (distance_squared >= 4*extent*extent) cycle
        call cut(other, cell, scratch, extent)
      end do
    end do
  end subroutine cut_by_all

  !> A square about the particle, which is the origin of a cell.
  pure subroutine start_cell(half, cell)
    real(wp), intent(in) :: half
    type(cell_t), intent(inout) :: cell

    cell%corners = 4
    cell%x(:4) = [-half, half, half, -half]
    cell%y(:4) = [-half, -half, half, half]
  end subroutine start_cell

  !> Cut off what is nearer to another particle.
  pure subroutine cut(other, cell, scratch, extent)
    !> Where the other one is, relative to this one, m
    real(wp), intent(in) :: other(2)
    type(cell_t), intent(inout) :: cell
    !> As large as the cell
    type(cell_t), intent(inout) :: scratch
    !> Distance of the corner furthest away, m
    real(wp), intent(inout) :: extent
    real(wp) :: beyond, beyond_next, bound, part
    integer :: k, n, next

    bound = 0.5_wp*(other(1)**2 + other(2)**2)
    n = 0
    beyond = cell%x(1)*other(1) + cell%y(1)*other(2) - bound
    do k = 1, cell%corners
      next = k + 1
      if (next > cell%corners) next = 1
      beyond_next = cell%x(next)*other(1) + cell%y(next)*other(2) - bound
      if (beyond <= 0) then
        n = n + 1
        scratch%x(n) = cell%x(k)
        scratch%y(n) = cell%y(k)
      end if
      if ((beyond <= 0) .neqv. (beyond_next <= 0)) then
        part = beyond/(beyond - beyond_next)
        n = n + 1
        scratch%x(n) = cell%x(k) + part*(cell%x(next) - cell%x(k))
        scratch%y(n) = cell%y(k) + part*(cell%y(next) - cell%y(k))
      end if
      beyond = beyond_next
    end do
    cell%corners = n
    cell%x(:n) = scratch%x(:n)
    cell%y(:n) = scratch%y(:n)
    extent = sqrt(maxval(cell%x(:n)**2 + cell%y(:n)**2))
  end subroutine cut

  pure function polygon_area(cell) result(area)
    type(cell_t), intent(in) :: cell
    real(wp) :: area
    integer :: k, next

    area = 0
    do k = 1, cell%corners
      next = mod(k, cell%corners) + 1
      area = area + 0.5_wp*(cell%x(k)*cell%y(next) - cell%y(k)*cell%x(next))
    end do
  end function polygon_area

  !> The area that a cell and the body have in common: ½ ∮ (x dy - y dx) along those parts of the
  !> cell's border that lie in the body and those parts of the body's boundary that lie in the cell.
  pure function common_area(body, origin, extent, cell) result(area)
    type(body_t), intent(in) :: body
    !> The particle, m
    real(wp), intent(in) :: origin(2)
    !> Distance of the cell's corner furthest away, m
    real(wp), intent(in) :: extent
    type(cell_t), intent(in) :: cell
    real(wp) :: area
    real(wp) :: a(2), b(2), from(2), to(2)
    !> Edges that the cell may reach, and where they cross a side of it
    type(edge_t), allocatable :: near(:)
    real(wp), allocatable :: crossing(:)
    logical :: reached(size(body%edge))
    integer :: e, k, n, next, part

    do e = 1, size(body%edge)
      reached(e) = sum((body%edge(e)%nearest_place(origin) - origin)**2) <= extent**2
    end do
    near = pack(body%edge, reached)
    allocate (crossing(2*size(near) + 2))
    area = 0
    do k = 1, cell%corners
      next = mod(k, cell%corners) + 1
      a = [cell%x(k), cell%y(k)]
      b = [cell%x(next), cell%y(next)]
      crossing(1) = 0
      n = 1
      do e = 1, size(near)
        call add_crossings(near(e), origin, a, b, crossing, n)
      end do
      n = n + 1
      crossing(n) = 1
      call sort(crossing(:n))
      do part = 1, n - 1
        from = a + crossing(part)*(b - a)
        to = a + crossing(part + 1)*(b - a)
        if (.not. body%contains_point(origin + 0.5_wp*(from + to))) cycle
        area = area + 0.5_wp*(from(1)*to(2) - from(2)*to(1))
      end do
    end do
    do e = 1, size(near)
      if (near(e)%is_circle()) then
        area = area + under_circle(near(e), origin, cell)
      else
        area = area + under_edge(near(e), origin, cell)
      end if
    end do
  end function common_area

  !> Where a line from a to b crosses an edge, as parts of its length.
  pure subroutine add_crossings(edge, origin, a, b, crossing, n)
    type(edge_t), intent(in) :: edge
    real(wp), intent(in) :: origin(2), a(2), b(2)
    real(wp), intent(inout) :: crossing(:)
    !> How many there are
    integer, intent(inout) :: n
    real(wp) :: along(2), from(2), half, middle, normal(2), part(2), side(2)
    integer :: k

    along = b - a
    if (edge%is_circle()) then
      call circle_crossings(edge%radius, a - (edge%centre - origin), along, middle, half)
      if (half <= 0) return
      part = middle + [-half, half]
      do k = 1, 2
        if (part(k) <= 0 .or. part(k) >= 1) cycle
        n = n + 1
        crossing(n) = part(k)
      end do
    else
      from = edge%start - origin
      normal = [edge%start(2) - edge%finish(2), edge%finish(1) - edge%start(1)]
      side = [dot_product(a - from, normal), dot_product(b - from, normal)]
      if ((side(1) > 0) .eqv. (side(2) > 0)) return
      part(1) = side(1)/(side(1) - side(2))
      ! Whether the crossing lies between the ends of the edge
      side(1) = dot_product(a + part(1)*along - from, edge%finish - edge%start)
      if (side(1) < 0 .or. side(1) > dot_product(normal, normal)) return
      n = n + 1
      crossing(n) = part(1)
    end if
  end subroutine add_crossings

  !> A line a + s along crosses a circle about the origin at s = middle ± half; half is 0 if it does
  !> not.
  pure subroutine circle_crossings(radius, a, along, middle, half)
    real(wp), intent(in) :: radius, a(2), along(2)
    real(wp), intent(out) :: middle, half
    real(wp) :: length, nearest

    half = 0
    length = dot_product(along, along)
    middle = 0
    if (.not. length > 0) return
    middle = -dot_product(a, along)/length
    nearest = sum((a + middle*along)**2)
    if (nearest < radius**2) half = sqrt((radius**2 - nearest)/length)
  end subroutine circle_crossings

  pure subroutine sort(values)
    real(wp), intent(inout) :: values(:)
    real(wp) :: value
    integer :: j, k

    do k = 2, size(values)
      value = values(k)
      do j = k - 1, 1, -1
        if (values(j) <= value) exit
        values(j + 1) = values(j)
      end do
      values(j + 1) = value
    end do
  end subroutine sort

  !> ½ ∫ (x dy - y dx) along the part of a straight edge that lies in a cell.
  pure function under_edge(edge, origin, cell) result(area)
    type(edge_t), intent(in) :: edge
    real(wp), intent(in) :: origin(2)
    type(cell_t), intent(in) :: cell
    real(wp) :: area
    real(wp) :: along(2), begin, end, from(2), grows, outside, side(2)
    integer :: k, next

    from = edge%start - origin
    along = edge%finish - edge%start
    begin = 0
    end = 1
    do k = 1, cell%corners
      next = mod(k, cell%corners) + 1
      side = [cell%y(next) - cell%y(k), cell%x(k) - cell%x(next)]
      ! Beyond this side of the cell where outside + s grows > 0
      outside = dot_product(from - [cell%x(k), cell%y(k)], side)
      grows = dot_product(along, side)
      if (grows > 0) then
        end = min(end, -outside/grows)
      else if (grows < 0) then
        begin = max(begin, -outside/grows)
      else if (outside > 0) then
        end = begin
      end if
    end do
    area = 0
    if (end > begin) then
      area = 0.5_wp*edge%sense*(end - begin)*(from(1)*along(2) - from(2)*along(1))
    end if
  end function under_edge

  !> ½ ∫ (x dy - y dx) along the parts of a circle that lie in a cell.
  pure function under_circle(edge, origin, cell) result(area)
    type(edge_t), intent(in) :: edge
    real(wp), intent(in) :: origin(2)
    type(cell_t), intent(in) :: cell
    real(wp) :: area
    !> Angles where the circle crosses the sides of the cell
    real(wp) :: crossing(2*cell%corners + 2)
    real(wp) :: a(2), along(2), angles(2), centre(2), half, middle, place(2)
    integer :: k, m, n, next

    centre = edge%centre - origin
    n = 1
    crossing(1) = -pi
    do k = 1, cell%corners
      next = mod(k, cell%corners) + 1
      a = [cell%x(k), cell%y(k)]
      along = [cell%x(next), cell%y(next)] - a
      call circle_crossings(edge%radius, a - centre, along, middle, half)
      if (half <= 0) cycle
      do m = -1, 1, 2
        if (middle + m*half <= 0 .or. middle + m*half >= 1) cycle
        place = a + (middle + m*half)*along - centre
        n = n + 1
        crossing(n) = atan2(place(2), place(1))
      end do
    end do
    n = n + 1
    crossing(n) = pi
    call sort(crossing(:n))
    area = 0
    do k = 1, n - 1
      angles = crossing(k:k + 1)
      middle = 0.5_wp*sum(angles)
      if (.not. in_cell(cell, centre + edge%radius*[cos(middle), sin(middle)])) cycle
      area = area + 0.5_wp*edge%sense*edge%radius*( &
             edge%radius*(angles(2) - angles(1)) + &
             centre(1)*(sin(angles(2)) - sin(angles(1))) - &
             centre(2)*(cos(angles(2)) - cos(angles(1))))
    end do
  end function under_circle

  pure function in_cell(cell, place) result(inside)
    type(cell_t), intent(in) :: cell
    real(wp), intent(in) :: place(2)
    logical :: inside
    integer :: k, next

    inside = .true.
    do k = 1, cell%corners
      next = mod(k, cell%corners) + 1
      if ((cell%x(next) - cell%x(k))*(place(2) - cell%y(k)) < &
          (cell%y(next) - cell%y(k))*(place(1) - cell%x(k))) inside = .false.
    end do
  end function in_cell

end module calor_cell_area
