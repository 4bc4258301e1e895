!> Polygons, with holes if so wished.
module calor_polygon_body
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_body, only: body_t, edge_t
  use calor_constants, only: pi
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: wp, ip
  use calor_text, only: text_t, to_text
  implicit none (type, external)
  private

  public :: make_polygon_body

  !> A corner that is sharper has no room for particles on both of its edges
  real(wp), parameter :: sharpest_corner = 15*pi/180
  !> What is larger than this could overflow when it is squared
  real(wp), parameter :: largest = 1.0e100_wp
  !> As many boundaries as a particle can tell apart
  integer, parameter :: most_boundaries = 31

contains

  !> A polygon.
  !>
  !> Its boundaries are the edges 'edge 1', 'edge 2', ... in the order of the vertices, edge k
  !> beginning at vertex k, counted on through the holes; and the loops, 'outer', 'hole 1', ...
  !> A polygon with more edges than can be told apart, as one that traces a curve, has only the
  !> loops.
  !>
  !> Fails where the loops do not bound a region: edges without length, edges that meet elsewhere
  !> than at their common vertex, vertices in clockwise order, holes outside or in one another; and
  !> for corners sharper than 15 degrees.
  subroutine make_polygon_body(vertices, hole_vertices, body, error, in_hole)
    !> Corners x₁, y₁, x₂, y₂, ..., counter-clockwise, m
    real(wp), intent(in) :: vertices(:)
    !> Corners of the holes in either direction; each hole ends with its first vertex repeated,
    !> which the last one may leave out
    real(wp), intent(in) :: hole_vertices(:)
    !> The polygon
    type(body_t), intent(out) :: body
    !> What is wrong, in terms of edges and holes
    type(error_t), allocatable, intent(out) :: error
    !> Whether the holes are to blame
    logical, intent(out), optional :: in_hole
    integer :: from, last, next
    logical :: hole

    hole = .false.
    allocate (body%edge(0))
    body%first = [1]
    body%shape = 'polygon'
    call check_numbers(vertices, error)
    if (.not. allocated(error)) then
      last = size(vertices)
      ! Who closes the loop means the same
      if (same(vertices(last - 1:last), vertices(1:2))) last = last - 2
      call add_loop(body, vertices(:last), error)
    end if
    if (.not. allocated(error)) call check_edges(body, error)
    if (.not. allocated(error)) call check_direction(body, error)

    from = 1
    do while (.not. allocated(error) .and. from <= size(hole_vertices))
      hole = .true.
      call check_numbers(hole_vertices, error)
      if (allocated(error)) exit
      call find_loop(hole_vertices, from, last, next)
      call add_loop(body, hole_vertices(from:last), error)
      from = next
    end do
    if (hole .and. .not. allocated(error)) call check_edges(body, error)
    if (hole .and. .not. allocated(error)) call check_holes(body, error)
    if (present(in_hole)) in_hole = hole
    if (allocated(error)) return
    call name_boundaries(body, error)
  end subroutine make_polygon_body

  pure function same(one, other)
    real(wp), intent(in) :: one(2), other(2)
    logical :: same

    same = .not. any(abs(one - other) > 0)
  end function same

  pure subroutine check_numbers(vertices, error)
    real(wp), intent(in) :: vertices(:)
    type(error_t), allocatable, intent(out) :: error

    if (mod(size(vertices), 2) /= 0) then
      call raise(error, status_bad_input, 'expected an x and a y for each vertex, found '// &
                 to_text(size(vertices))//' numbers.')
    else if (size(vertices) < 6) then
      call raise(error, status_bad_input, 'expected at least 3 vertices, found '// &
                 to_text(size(vertices)/2)//'.')
    else if (.not. all(ieee_is_finite(vertices))) then
      call raise(error, status_bad_input, 'vertices must be ordinary numbers.')
    else if (any(abs(vertices) > largest)) then
      call raise(error, status_bad_input, 'coordinates must not exceed 1e100.')
    end if
  end subroutine check_numbers

  !> Where a hole's loop ends, and where the next one begins.
  pure subroutine find_loop(vertices, from, last, next)
    real(wp), intent(in) :: vertices(:)
    integer, intent(in) :: from
    integer, intent(out) :: last, next
    integer :: k

    last = size(vertices)
    next = last + 1
    do k = from + 2, size(vertices) - 1, 2
      if (.not. same(vertices(k:k + 1), vertices(from:from + 1))) cycle
      last = k - 1
      next = k + 2
      return
    end do
  end subroutine find_loop

  !> Append the edges of a loop.
  pure subroutine add_loop(body, vertices, error)
    type(body_t), intent(inout) :: body
    real(wp), intent(in) :: vertices(:)
    type(error_t), allocatable, intent(out) :: error
    type(edge_t), allocatable :: loop(:)
    integer :: corners, k, next

    corners = size(vertices)/2
    if (corners < 3) then
      call raise(error, status_bad_input, 'a hole has at least 3 vertices, hole '// &
                 to_text(size(body%first) - 1)//' has '//to_text(corners)// &
                 '. A hole ends with its first vertex repeated.')
      return
    end if
    allocate (loop(corners))
    do k = 1, corners
      next = mod(k, corners) + 1
      loop(k)%start = vertices(2*k - 1:2*k)
      loop(k)%finish = vertices(2*next - 1:2*next)
      if (.not. same(loop(k)%start, loop(k)%finish)) cycle
      call raise(error, status_bad_input, 'edge '//to_text(size(body%edge) + k)// &
                 ' has no length: both its ends are '//point_text(loop(k)%start)// &
                 '. Remove one of the two vertices.')
      return
    end do
    ! Around a hole the body is on the other side
    if (size(body%edge) > 0 .and. enclosed(loop) > 0) loop%sense = -1
    body%edge = [body%edge, loop]
    body%first = [body%first, size(body%edge) + 1]
  end subroutine add_loop

  !> Twice the area that a loop encloses, negative if it runs clockwise, m².
  pure function enclosed(loop)
    type(edge_t), intent(in) :: loop(:)
    real(wp) :: enclosed
    integer :: k

    enclosed = 0
    do k = 1, size(loop)
      enclosed = enclosed + turn(loop(1)%start, loop(k)%start, loop(k)%finish)
    end do
  end function enclosed

  !> Twice the area of a triangle, positive if its corners run counter-clockwise.
  pure function turn(a, b, c)
    real(wp), intent(in) :: a(2), b(2), c(2)
    real(wp) :: turn

    turn = (b(1) - a(1))*(c(2) - a(2)) - (b(2) - a(2))*(c(1) - a(1))
  end function turn

  pure function point_text(point) result(text)
    real(wp), intent(in) :: point(2)
    character(len=:), allocatable :: text

    text = '('//to_text(point(1), digits=6)//', '//to_text(point(2), digits=6)//')'
  end function point_text

  pure subroutine check_direction(body, error)
    type(body_t), intent(in) :: body
    type(error_t), allocatable, intent(out) :: error

    if (enclosed(body%edge) > 0) return
    call raise(error, status_bad_input, 'the vertices run clockwise: list them in the opposite '// &
               'order, so that the body is on the left.')
  end subroutine check_direction

  !> Edges may meet at common vertices only, and not fold back there.
  subroutine check_edges(body, error)
    type(body_t), intent(in) :: body
    type(error_t), allocatable, intent(out) :: error
    integer :: k, loop, other, next

    do loop = 1, size(body%first) - 1
      do k = body%first(loop), body%first(loop + 1) - 1
        next = k + 1
        if (next == body%first(loop + 1)) next = body%first(loop)
        if (corner_angle(body%edge(k), body%edge(next)) < sharpest_corner) then
          call raise(error, status_bad_input, 'the corner at '// &
                     point_text(body%edge(next)%start)//' is sharper than 15 degrees: blunt it '// &
                     'by one more vertex.')
          return
        end if
        do other = k + 1, size(body%edge)
          if (other == next .or. (k == body%first(loop) .and. &
                                  other == body%first(loop + 1) - 1)) cycle
          if (.not. meet(body%edge(k), body%edge(other))) cycle
          call raise(error, status_bad_input, 'edge '//to_text(k)//' from '// &
                     point_text(body%edge(k)%start)//' to '//point_text(body%edge(k)%finish)// &
                     ' and edge '//to_text(other)//' from '// &
                     point_text(body%edge(other)%start)//' to '// &
                     point_text(body%edge(other)%finish)//' cross or touch: edges may meet '// &
                     'only where one follows the other.')
          return
        end do
      end do
    end do
  end subroutine check_edges

  !> The angle between an edge and the one that follows it: π if they go straight on.
  pure function corner_angle(edge, next) result(angle)
    type(edge_t), intent(in) :: edge, next
    real(wp) :: angle
    real(wp) :: back(2), forth(2)

    back = (edge%start - edge%finish)/edge%length()
    forth = (next%finish - next%start)/next%length()
    angle = abs(atan2(back(1)*forth(2) - back(2)*forth(1), dot_product(back, forth)))
  end function corner_angle

  !> Whether two edges have a point in common.
  pure function meet(one, other)
    type(edge_t), intent(in) :: one, other
    logical :: meet
    real(wp) :: of_other(2), of_one(2)

    meet = .false.
    if (any(max(one%start, one%finish) < min(other%start, other%finish))) return
    if (any(max(other%start, other%finish) < min(one%start, one%finish))) return
    ! On which sides of each edge's line the ends of the other lie
    of_one = [turn(one%start, one%finish, other%start), turn(one%start, one%finish, other%finish)]
    of_other = [turn(other%start, other%finish, one%start), &
                turn(other%start, other%finish, one%finish)]
    meet = .not. (all(of_one > 0) .or. all(of_one < 0) .or. all(of_other > 0) .or. &
                  all(of_other < 0))
  end function meet

  !> Every hole must lie in the outer loop and outside the other holes.
  pure subroutine check_holes(body, error)
    type(body_t), intent(in) :: body
    type(error_t), allocatable, intent(out) :: error
    type(body_t) :: loop
    integer :: hole, other

    do other = 1, size(body%first) - 1
      loop%edge = body%edge(body%first(other):body%first(other + 1) - 1)
      do hole = 2, size(body%first) - 1
        if (hole == other) cycle
        ! No edges cross, so one vertex tells for all
        if (loop%contains_point(body%edge(body%first(hole))%start) .eqv. other == 1) cycle
        if (other == 1) then
          call raise(error, status_bad_input, 'hole '//to_text(hole - 1)//' at '// &
                     point_text(body%edge(body%first(hole))%start)//' lies outside the polygon.')
        else
          call raise(error, status_bad_input, 'hole '//to_text(hole - 1)//' at '// &
                     point_text(body%edge(body%first(hole))%start)//' lies in hole '// &
                     to_text(other - 1)//': remove one of the two.')
        end if
        return
      end do
    end do
  end subroutine check_holes

  pure subroutine name_boundaries(body, error)
    type(body_t), intent(inout) :: body
    type(error_t), allocatable, intent(out) :: error
    integer :: edges, k, loop, loops

    edges = size(body%edge)
    loops = size(body%first) - 1
    if (loops > most_boundaries) then
      call raise(error, status_bad_input, 'there are '//to_text(loops - 1)// &
                 ' holes, but at most '//to_text(most_boundaries - 1)//' can be told apart.')
      return
    end if
    if (edges + loops > most_boundaries) edges = 0
    allocate (body%boundary(edges + loops))
    do k = 1, edges
      body%boundary(k)%value = 'edge '//to_text(k)
      body%edge(k)%side = ibset(0_ip, k - 1)
    end do
    do loop = 1, loops
      associate (name => body%boundary(edges + loop))
        name%value = 'outer'
        if (loop > 1) name%value = 'hole '//to_text(loop - 1)
      end associate
      do k = body%first(loop), body%first(loop + 1) - 1
        body%edge(k)%side = ibset(body%edge(k)%side, edges + loop - 1)
      end do
    end do
  end subroutine name_boundaries

end module calor_polygon_body
