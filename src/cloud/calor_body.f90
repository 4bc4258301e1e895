!> Bodies: regions of the plane bounded by closed loops of straight edges and circles.
module calor_body
  use calor_constants, only: pi
  use calor_kinds, only: wp, ip
  use calor_text, only: text_t
  implicit none (type, external)
  private

  public :: body_t, edge_t

  !> A straight part of a body's boundary, or a whole circle
  type :: edge_t
    !> Both ends of a straight edge, m
    real(wp) :: start(2) = 0.0_wp, finish(2) = 0.0_wp
    !> Centre and radius of a circle, m; the radius of a straight edge is 0
    real(wp) :: centre(2) = 0.0_wp, radius = 0.0_wp
    !> 1 where the body is on the left of who walks from start to finish, or counter-clockwise
    !> around the circle; -1 where it is on the right
    real(wp) :: sense = 1.0_wp
    !> The boundaries that the edge belongs to, as `cloud_t%side` has them
    integer(ip) :: side = 0
  contains
    !> Whether this is a circle
    procedure :: is_circle
    !> Length, m
    procedure :: length => edge_length
    !> The place nearest to a point
    procedure :: nearest_place
    !> The place a distance behind the start, along the edge
    procedure :: at
    !> The unit normal that points out of the body, at a place of the edge
    procedure :: outward
  end type edge_t

  !> A region bounded by closed loops, the first of which is the outer one
  type :: body_t
    !> All edges, loop after loop
    type(edge_t), allocatable :: edge(:)
    !> Where each loop begins in `edge`; one element more than loops
    integer, allocatable :: first(:)
    !> Names of the boundaries: bit k-1 of `edge%side` means `boundary(k)`
    type(text_t), allocatable :: boundary(:)
    !> What it is called in messages, such as 'disc'
    character(len=:), allocatable :: shape
  contains
    !> Area, m²
    procedure :: area
    !> Length of all edges, m
    procedure :: perimeter
    !> Whether a point is inside
    procedure :: contains_point
    !> Distance to the boundary and the way there
    procedure :: find_wall
    !> The smallest rectangle around the body
    procedure :: find_extent
    !> About how many particles fill the body
    procedure :: particles_about
  end type body_t

contains

  pure function is_circle(this) result(answer)
    class(edge_t), intent(in) :: this
    logical :: answer

    answer = this%radius > 0
  end function is_circle

  pure function edge_length(this) result(length)
    class(edge_t), intent(in) :: this
    real(wp) :: length

    length = hypot(this%finish(1) - this%start(1), this%finish(2) - this%start(2))
    if (this%is_circle()) length = 2*pi*this%radius
  end function edge_length

  pure function nearest_place(this, point) result(place)
    class(edge_t), intent(in) :: this
    !> m
    real(wp), intent(in) :: point(2)
    real(wp) :: place(2)
    real(wp) :: along(2), distance, part

    if (this%is_circle()) then
      place = point - this%centre
      distance = hypot(place(1), place(2))
      if (distance > 0) then
        place = this%centre + place*(this%radius/distance)
      else
        place = this%centre + [this%radius, 0.0_wp]
      end if
    else
      along = this%finish - this%start
      part = dot_product(point - this%start, along)/dot_product(along, along)
      place = this%start + min(max(part, 0.0_wp), 1.0_wp)*along
    end if
  end function nearest_place

  !> A circle starts at its rightmost place and runs counter-clockwise.
  pure function at(this, distance) result(place)
    class(edge_t), intent(in) :: this
    !> From the start, m
    real(wp), intent(in) :: distance
    real(wp) :: place(2)

    if (this%is_circle()) then
      associate (angle => distance/this%radius)
        place = this%centre + this%radius*[cos(angle), sin(angle)]
      end associate
    else
      place = this%start + (distance/this%length())*(this%finish - this%start)
    end if
  end function at

  pure function outward(this, place) result(normal)
    class(edge_t), intent(in) :: this
    !> m
    real(wp), intent(in) :: place(2)
    real(wp) :: normal(2)

    if (this%is_circle()) then
      normal = place - this%centre
    else
      normal = [this%finish(2) - this%start(2), this%start(1) - this%finish(1)]
    end if
    normal = normal*(this%sense/hypot(normal(1), normal(2)))
  end function outward

  !> By Green's theorem, ½ ∮ (x dy - y dx).
  pure function area(this)
    class(body_t), intent(in) :: this
    real(wp) :: area
    real(wp) :: origin(2)
    integer :: k

    ! Relative to a place nearby, or a body far from the origin would lose digits
    origin = this%edge(1)%start
    area = 0
    do k = 1, size(this%edge)
      associate (edge => this%edge(k))
        if (edge%is_circle()) then
          area = area + edge%sense*pi*edge%radius**2
        else
          area = area + 0.5_wp*edge%sense*cross(edge%start - origin, edge%finish - origin)
        end if
      end associate
    end do
  end function area

  pure function cross(a, b)
    real(wp), intent(in) :: a(2), b(2)
    real(wp) :: cross

    cross = a(1)*b(2) - a(2)*b(1)
  end function cross

  pure function perimeter(this) result(length)
    class(body_t), intent(in) :: this
    real(wp) :: length
    integer :: k

    length = 0
    do k = 1, size(this%edge)
      length = length + this%edge(k)%length()
    end do
  end function perimeter

  !> A ray to the right crosses the boundary an odd number of times.
  pure function contains_point(this, point) result(inside)
    class(body_t), intent(in) :: this
    !> m
    real(wp), intent(in) :: point(2)
    logical :: inside
    integer :: k

    inside = .false.
    do k = 1, size(this%edge)
      associate (edge => this%edge(k), a => this%edge(k)%start, b => this%edge(k)%finish)
        if (edge%is_circle()) then
          if (sum((point - edge%centre)**2) < edge%radius**2) inside = .not. inside
        else if ((a(2) > point(2)) .neqv. (b(2) > point(2))) then
          if (point(1) < a(1) + (point(2) - a(2))*((b(1) - a(1))/(b(2) - a(2)))) then
            inside = .not. inside
          end if
        end if
      end associate
    end do
  end function contains_point

  !> The distance is positive inside and negative outside; `inward` is the unit vector along which
  !> it grows. Takes time in proportion to the number of edges.
  pure subroutine find_wall(this, point, distance, inward)
    class(body_t), intent(in) :: this
    !> m
    real(wp), intent(in) :: point(2)
    !> m
    real(wp), intent(out) :: distance
    real(wp), intent(out) :: inward(2)
    real(wp) :: away(2), place(2), least, squared
    integer :: k, nearest_edge

    nearest_edge = 1
    least = huge(least)
    inward = 0
    do k = 1, size(this%edge)
      place = this%edge(k)%nearest_place(point)
      away = point - place
      squared = dot_product(away, away)
      if (squared >= least) cycle
      least = squared
      inward = away
      nearest_edge = k
    end do
    distance = sqrt(least)
    if (distance > 0) then
      inward = inward/distance
      if (.not. this%contains_point(point)) then
        distance = -distance
        inward = -inward
      end if
    else
      inward = -this%edge(nearest_edge)%outward(point)
    end if
  end subroutine find_wall

  pure subroutine find_extent(this, x_range, y_range)
    class(body_t), intent(in) :: this
    !> Left and right, bottom and top, m
    real(wp), intent(out) :: x_range(2), y_range(2)
    integer :: k

    x_range = [huge(1.0_wp), -huge(1.0_wp)]
    y_range = x_range
    do k = 1, size(this%edge)
      associate (edge => this%edge(k))
        if (edge%is_circle()) then
          x_range = joined(x_range, edge%centre(1) + [-1, 1]*edge%radius)
          y_range = joined(y_range, edge%centre(2) + [-1, 1]*edge%radius)
        else
          x_range = joined(x_range, [edge%start(1), edge%start(1)])
          y_range = joined(y_range, [edge%start(2), edge%start(2)])
        end if
      end associate
    end do
  end subroutine find_extent

  pure function joined(one, other) result(range)
    real(wp), intent(in) :: one(2), other(2)
    real(wp) :: range(2)

    range = [min(one(1), other(1)), max(one(2), other(2))]
  end function joined

  !> A particle for each square of the spacing, and half of one more for each spacing of the walls:
  !> exact for a lattice in a rectangle. A real number, as it may be one that no integer can hold.
  pure function particles_about(this, spacing) result(number)
    class(body_t), intent(in) :: this
    !> Distance of neighbours, m
    real(wp), intent(in) :: spacing
    real(wp) :: number
    !> No machine has memory for so many, and products of what is more could overflow
    real(wp), parameter :: most = 1.0e18_wp
    real(wp) :: lengths

    number = most
    if (spacing*most < this%perimeter()) return
    lengths = this%perimeter()/spacing
    number = (sqrt(this%area())/spacing)**2 + 0.5_wp*lengths + 1
  end function particles_about

end module calor_body
