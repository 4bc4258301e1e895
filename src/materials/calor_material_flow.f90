!> What div(K ∇u) is in a body of several materials, or of one that conducts heat differently in
!> different directions.
!>
!> Rows beside an interface are exact for polynomials that go on beyond it as
!> calor_interface_continuation says: the immersed interface method, here for rows of least norm on
!> any cloud.
module calor_material_flow
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_expression, only: expression_t
  use calor_flow_rows, only: flow_model_t
  use calor_interface_continuation, only: conduction_at_t, coefficients, coefficient_position, &
      continuation, shifted_monomials
  use calor_kinds, only: wp, ip
  use calor_lapack, only: dgelss
  use calor_materials, only: materials_t
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_potential_jumps, only: contact_t
  use calor_taylor_weights, only: monomials, monomial_position
  implicit none (type, external)
  private

  public :: material_flow_t, crossing_t

  !> Pairs of particles this many spacings apart at most are asked for an interface between them
  real(wp), parameter :: reach = 2.1_wp
  !> Its normal at a particle comes from points this many spacings beyond the nearest one at most
  real(wp), parameter :: patch = 2.5_wp
  !> An interface so many spacings away matters for no row
  real(wp), parameter :: farthest = 12.0_wp
  !> Where it meets a wall so many spacings from a particle, both its parts belong to the particle
  real(wp), parameter :: junction = 0.1_wp
  !> Bisections that find it between two particles
  integer, parameter :: bisections = 52
  !> An interface that bends with less than this many spacings of radius has a corner: 1/2.5
  real(wp), parameter :: sharpest = 0.4_wp
  !> A particle nearer to it than so many spacings lies on it
  real(wp), parameter :: touching = 1.0e-6_wp
  !> The degree of polynomials that tell how it bends
  integer, parameter :: curve_degree = 4
  !> Singular values of their fit below this part of the largest count as 0
  real(wp), parameter :: smallest_singular = 1.0e-4_wp
  !> Steps of Newton's method to the nearest point of a parabola
  integer, parameter :: newton_steps = 8

  !> An interface as one particle sees it
  type :: crossing_t
    !> The material beyond
    integer :: beyond = 0
    !> Foot of the perpendicular, relative to the particle, m, and normal towards the other side
    real(wp) :: foot(2) = 0.0_wp, normal(2) = 0.0_wp
    !> How the interface bends: s = Σ curve(k) tᵏ along it, in powers of m
    real(wp) :: curve(0:curve_degree) = 0.0_wp
    !> What conducts at the foot on either side
    type(conduction_at_t) :: here, there
    !> (ρc)_B/(ρc)_A
    real(wp) :: capacity_ratio = 1.0_wp
  end type crossing_t

  type, extends(flow_model_t) :: material_flow_t
    !> The material of each particle
    integer, allocatable :: material(:)
    !> Points on interfaces, m, and the materials on both sides
    real(wp), allocatable, private :: x(:), y(:)
    integer, allocatable, private :: side(:, :)
    !> The spacing, m
    real(wp), private :: width = 0.0_wp
    !> Where a particle stands in the arrays below; 0: not at all
    integer, allocatable, private :: position(:)
    !> κxx, κyy, κxy, and div K, W/(m K) and W/(m² K)
    real(wp), allocatable, private :: conductivity(:, :), divergence(:, :)
    !> Interfaces of each, and where those of each begin, one more at the end
    type(crossing_t), allocatable, private :: crossing(:)
    integer, allocatable, private :: first(:)
  contains
    !> Find the interfaces of a cloud
    procedure :: find_interfaces
    !> Make ready for rows at some particles
    procedure :: focus
    procedure :: describe
    !> Whether two materials have an interface
    procedure :: touch
    !> The interface with one of them as a particle sees it
    procedure :: contact_at
    !> By how much the heat flux of a field jumps across interfaces
    procedure :: flux_jump
    !> All interfaces near the particles for which it has been made ready
    procedure :: crossings
    procedure, private :: find_points
    procedure, private :: see_interface
    procedure, private :: fill_sides
  end type material_flow_t

contains

  !> A particle on an interface may count to either side. It counts to that which conducts better,
  !> whatever `this%material` says, for there heat spreads along the interface: others exchange more
  !> heat with it than a row of the worse conductor would with them.
  subroutine find_interfaces(this, materials, x, y, spacing)
    class(material_flow_t), intent(inout) :: this
    !> The materials; `this%material` is set
    type(materials_t), intent(in) :: materials
    !> Coordinates of the particles, and their spacing, m
    real(wp), intent(in) :: x(:), y(:)
    real(wp), intent(in) :: spacing
    integer, allocatable :: beyond(:)
    integer :: k

    call this%find_points(materials, x, y, spacing, beyond)
    do k = 1, size(x)
      if (beyond(k) == 0) cycle
      if (conducts(beyond(k), k) > conducts(this%material(k), k)) this%material(k) = beyond(k)
    end do
    if (any(beyond > 0)) call this%find_points(materials, x, y, spacing, beyond)

  contains

    !> The trace of a material's conductivity at a particle
    function conducts(material, particle) result(trace)
      integer, intent(in) :: material, particle
      real(wp) :: trace
      real(wp) :: value(3, 1)

      call materials%conductivity_at(material, [x(particle)], [y(particle)], value)
      trace = value(1, 1) + value(2, 1)
    end function conducts

  end subroutine find_interfaces

  subroutine find_points(this, materials, x, y, spacing, beyond)
    class(material_flow_t), intent(inout) :: this
    type(materials_t), intent(in) :: materials
    real(wp), intent(in) :: x(:), y(:), spacing
    !> The material that a particle touches; 0: none, it is within its own
    integer, allocatable, intent(out) :: beyond(:)
    type(neighbour_list_t) :: list
    integer(ip), allocatable :: one(:), other(:)
    integer, allocatable :: found(:), own(:)
    real(wp), allocatable :: near(:), far(:), middle(:)
    integer :: k, i, used, pass

    this%width = spacing
    call build_neighbour_list(x, y, [(reach*spacing, k=1, size(x))], list)
    do pass = 1, 2
      used = 0
      do i = 1, list%rows()
        do k = int(list%first(i)), int(list%first(i + 1)) - 1
          associate (a => list%target(i), b => list%index(k))
            if (a > b .or. this%material(a) == this%material(b)) cycle
            used = used + 1
            if (pass == 1) cycle
            one(used) = a
            other(used) = b
          end associate
        end do
      end do
      if (pass == 1) allocate (one(used), other(used))
    end do
    allocate (near(used), far(used), middle(used), found(used))
    near = 0
    far = 1
    own = this%material(one)
    do k = 1, bisections
      middle = 0.5_wp*(near + far)
      call materials%which(x(one) + middle*(x(other) - x(one)), &
                           y(one) + middle*(y(other) - y(one)), found)
      where (found == own)
        near = middle
      else where
        far = middle
      end where
    end do
    this%x = x(one) + near*(x(other) - x(one))
    this%y = y(one) + near*(y(other) - y(one))
    this%side = reshape([own, this%material(other)], [used, 2])
    allocate (beyond(size(x)), source=0)
    do k = 1, used
      associate (distance => hypot(x(other(k)) - x(one(k)), y(other(k)) - y(one(k))))
        if (near(k)*distance < touching*spacing) beyond(one(k)) = this%material(other(k))
        if ((1 - far(k))*distance < touching*spacing) beyond(other(k)) = own(k)
      end associate
    end do
  end subroutine find_points

  pure function touch(this, one, other) result(answer)
    class(material_flow_t), intent(in) :: this
    !> Positions of the materials
    integer, intent(in) :: one, other
    logical :: answer

    answer = any((this%side(:, 1) == one .and. this%side(:, 2) == other) .or. &
                 (this%side(:, 1) == other .and. this%side(:, 2) == one))
  end function touch

  subroutine contact_at(this, materials, x, y, spacing, particle, other, contact)
    class(material_flow_t), intent(in) :: this
    !> The materials, isotropic both
    type(materials_t), intent(in) :: materials
    !> Coordinates of all particles, and their spacing, m
    real(wp), intent(in) :: x(:), y(:)
    real(wp), intent(in) :: spacing
    !> The particle, and the material beyond
    integer(ip), intent(in) :: particle
    integer, intent(in) :: other
    !> The interface
    type(contact_t), intent(out) :: contact
    type(crossing_t) :: seen
    real(wp) :: value(3, 1)
    logical :: there
    integer :: k

    call this%see_interface(other, x, y, spacing, particle, seen, there)
    contact%own = this%material(particle)
    contact%other = other
    contact%normal = seen%normal
    contact%depth = dot_product(seen%foot, seen%normal)
    do k = 1, 2
      associate (which => merge(contact%own, other, k == 1))
        call materials%conductivity_at(which, [x(particle) + seen%foot(1)], &
                                       [y(particle) + seen%foot(2)], value)
      end associate
      contact%conductivity(k) = value(1, 1)
    end do
  end subroutine contact_at

  !> The largest jump of a field's heat flux through interfaces, as a part of the largest such flux;
  !> 0 where there are none.
  function flux_jump(this, materials, field, x, y, spacing) result(part)
    class(material_flow_t), intent(in) :: this
    !> The materials
    type(materials_t), intent(in) :: materials
    !> The temperature, K
    type(expression_t), intent(in) :: field
    !> Coordinates of all particles, and their spacing, m
    real(wp), intent(in) :: x(:), y(:), spacing
    real(wp) :: part
    !> So many places are looked at, by slopes of a parabola through three points on either side, of
    !> which the first lies so far off
    integer, parameter :: most_places = 64
    real(wp), parameter :: offset = 0.02_wp
    real(wp), parameter :: slope_weight(3) = 0.5_wp*[-5.0_wp, 8.0_wp, -3.0_wp]
    type(crossing_t) :: seen
    type(expression_t) :: own_field
    real(wp) :: flux(2), conductivity(3, 1), foot(2), value(3), jump, largest, step
    integer(ip) :: particle
    integer :: k, side
    logical :: there

    part = 0
    if (.not. allocated(this%x)) return
    own_field = field
    jump = 0
    largest = 0
    step = offset*spacing
    do k = 1, size(this%x), max(1, size(this%x)/most_places)
      particle = int(minloc((x - this%x(k))**2 + (y - this%y(k))**2, dim=1, &
                            mask=this%material == this%side(k, 1)), ip)
      call this%see_interface(this%side(k, 2), x, y, spacing, particle, seen, there)
      if (.not. there) cycle
      foot = [x(particle), y(particle)] + seen%foot
      associate (n => seen%normal)
        do side = 1, 2
          ! Into the first material with -n, into the second one with n
          call own_field%evaluate(foot(1) + (2*side - 3)*n(1)*step*[1, 2, 3], &
                                  foot(2) + (2*side - 3)*n(2)*step*[1, 2, 3], 0.0_wp, values=value)
          call materials%conductivity_at(this%side(k, side), foot(1:1), foot(2:2), conductivity)
          flux(side) = (2*side - 3)*dot_product(slope_weight, value)/step* &
                       (conductivity(1, 1)*n(1)**2 + conductivity(2, 1)*n(2)**2 + &
                        2*conductivity(3, 1)*n(1)*n(2))
        end do
      end associate
      if (.not. all(ieee_is_finite(flux))) cycle
      jump = max(jump, abs(flux(2) - flux(1)))
      largest = max(largest, maxval(abs(flux)))
    end do
    if (largest > 0) part = jump/largest
  end function flux_jump

  subroutine focus(this, materials, x, y, spacing, particles)
    class(material_flow_t), intent(inout) :: this
    !> The materials
    type(materials_t), intent(in) :: materials
    !> Coordinates of all particles, and their spacing, m
    real(wp), intent(in) :: x(:), y(:)
    real(wp), intent(in) :: spacing
    !> The particles
    integer(ip), intent(in) :: particles(:)
    type(crossing_t), allocatable :: seen(:)
    type(crossing_t) :: one
    real(wp), allocatable :: value(:, :), along_x(:, :), along_y(:, :)
    integer, allocatable :: member(:)
    integer :: k, other, count_of, i, j
    logical :: there

    allocate (seen(size(particles)*(size(materials%list) - 1)))
    this%first = [(0, k=0, size(particles))]
    this%position = [(0, k=1, size(x))]
    count_of = 0
    do k = 1, size(particles)
      this%position(particles(k)) = k
      this%first(k) = count_of + 1
      do other = 1, size(materials%list)
        if (other == this%material(particles(k))) cycle
        call this%see_interface(other, x, y, spacing, particles(k), one, there)
        if (.not. there) cycle
        count_of = count_of + 1
        seen(count_of) = one
      end do
    end do
    this%first(size(particles) + 1) = count_of + 1
    this%crossing = seen(:count_of)

    this%conductivity = reshape([(0.0_wp, k=1, 3*size(particles))], [3, size(particles)])
    this%divergence = reshape([(0.0_wp, k=1, 2*size(particles))], [2, size(particles)])
    do i = 1, size(materials%list)
      member = pack([(j, j=1, size(particles))], this%material(particles) == i)
      allocate (value(3, size(member)), along_x(3, size(member)), along_y(3, size(member)))
      associate (px => x(particles(member)), py => y(particles(member)))
        call materials%conductivity_at(i, px, py, value)
        call materials%conductivity_gradient(i, px, py, 1.0e-3_wp*spacing, along_x, along_y)
      end associate
      this%conductivity(:, member) = value
      this%divergence(1, member) = along_x(1, :) + along_y(3, :)
      this%divergence(2, member) = along_x(3, :) + along_y(2, :)
      deallocate (value, along_x, along_y)
      call this%fill_sides(materials, i, x, y, spacing, particles)
    end do
  end subroutine focus

  pure subroutine crossings(this, crossing, owner)
    class(material_flow_t), intent(in) :: this
    !> The interfaces
    type(crossing_t), allocatable, intent(out) :: crossing(:)
    !> Which of the particles given to `focus` sees each
    integer, allocatable, intent(out) :: owner(:)
    integer :: k

    crossing = this%crossing
    allocate (owner(size(crossing)))
    do k = 1, size(this%first) - 1
      owner(this%first(k):this%first(k + 1) - 1) = k
    end do
  end subroutine crossings

  !> The interface with another material nearest to a particle: a parabola through the points found
  !> on it, by least squares of their distances from it.
  subroutine see_interface(this, other, x, y, spacing, particle, seen, there)
    class(material_flow_t), intent(in) :: this
    integer, intent(in) :: other
    real(wp), intent(in) :: x(:), y(:), spacing
    integer(ip), intent(in) :: particle
    type(crossing_t), intent(out) :: seen
    !> Whether there is one within reach
    logical, intent(out) :: there
    real(wp), allocatable :: dx(:), dy(:), weight(:)
    logical, allocatable :: chosen(:)
    real(wp) :: centre(2), sxx, sxy, syy, angle, mean(2), curve(3), along, depth, slope
    integer :: k

    associate (own => this%material(particle))
      chosen = (this%side(:, 1) == own .and. this%side(:, 2) == other) .or. &
               (this%side(:, 1) == other .and. this%side(:, 2) == own)
    end associate
    dx = pack(this%x, chosen) - x(particle)
    dy = pack(this%y, chosen) - y(particle)
    there = size(dx) > 0
    if (.not. there) return
    associate (nearest => minval(hypot(dx, dy)))
      there = nearest <= farthest*spacing
      weight = max(0.0_wp, 1 - (hypot(dx, dy)/(nearest + patch*spacing))**2)**2
    end associate
    if (.not. there) return
    weight = weight/sum(weight)
    centre = [sum(weight*dx), sum(weight*dy)]
    sxx = sum(weight*(dx - centre(1))**2)
    sxy = sum(weight*(dx - centre(1))*(dy - centre(2)))
    syy = sum(weight*(dy - centre(2))**2)
    angle = 0.5_wp*atan2(2*sxy, sxx - syy)
    seen%beyond = other
    seen%normal = [-sin(angle), cos(angle)]
    ! Particles of the other material say which side is theirs.
    associate (near => this%material == other .and. &
               hypot(x - x(particle), y - y(particle)) <= norm2(centre) + patch*spacing)
      mean = [sum(x, near), sum(y, near)]/max(1, count(near)) - [x(particle), y(particle)] - centre
    end associate
    if (dot_product(mean, seen%normal) < 0) seen%normal = -seen%normal
    associate (n => seen%normal, t => [-seen%normal(2), seen%normal(1)])
      call fit_parabola(t(1)*dx + t(2)*dy, n(1)*dx + n(2)*dy, weight, spacing, curve)
      ! The point of s = c₁ + c₂ t + c₃ t²/2 nearest to the particle
      along = 0
      do k = 1, newton_steps
        depth = curve(1) + along*(curve(2) + along*curve(3)/2)
        slope = curve(2) + along*curve(3)
        along = along - (along + depth*slope)/(1 + slope**2 + max(0.0_wp, depth*curve(3)))
      end do
      depth = curve(1) + along*(curve(2) + along*curve(3)/2)
      slope = curve(2) + along*curve(3)
      seen%foot = along*t + depth*n
      seen%normal = (n - slope*t)/hypot(1.0_wp, slope)
    end associate
    ! The particle is on its own side of it.
    depth = dot_product(seen%foot, seen%normal)
    if (depth < 0) seen%foot = seen%foot - depth*seen%normal
    if (abs(curve(3)) > 0) then
      associate (n => seen%normal, x => dx - seen%foot(1), y => dy - seen%foot(2))
        call fit_curve(n(1)*y - n(2)*x, n(1)*x + n(2)*y, weight, patch*spacing, seen%curve)
      end associate
    end if
  end subroutine see_interface

  !> s = c₁ + c₂ t + c₃ t²/2 by least squares; c₃ = 0 where points do not tell it, or where it would
  !> bend within few spacings: such a place is a corner.
  pure subroutine fit_parabola(t, s, weight, spacing, curve)
    !> Points, m, their weights, which sum to 1, and the spacing, m
    real(wp), intent(in) :: t(:), s(:), weight(:), spacing
    !> 1 and m and 1/m
    real(wp), intent(out) :: curve(3)
    real(wp) :: mean_t, mean_s, variance, bend(size(t)), rest(size(t))

    mean_t = sum(weight*t)
    mean_s = sum(weight*s)
    variance = sum(weight*(t - mean_t)**2)
    curve = [mean_s, 0.0_wp, 0.0_wp]
    if (.not. variance > (1.0e-3_wp*spacing)**2) return
    curve(2) = sum(weight*(t - mean_t)*(s - mean_s))/variance
    ! The part of t²/2 that no straight line has
    bend = 0.5_wp*((t - mean_t)**2 - variance - &
                   sum(weight*(t - mean_t)**3)/variance*(t - mean_t))
    rest = s - mean_s - curve(2)*(t - mean_t)
    if (sum(weight*bend**2) > (1.0e-2_wp*spacing**2)**2) then
      curve(3) = sum(weight*bend*rest)/sum(weight*bend**2)
      if (abs(curve(3))*spacing > sharpest) curve(3) = 0
    end if
    curve(2) = curve(2) - curve(3)*(mean_t + sum(weight*(t - mean_t)**3)/(2*variance))
    curve(1) = mean_s - mean_t*curve(2) - curve(3)*(mean_t**2 + variance)/2
  end subroutine fit_parabola

  !> s = Σ c_k tᵏ by least squares; of several that fit alike the one that bends least
  subroutine fit_curve(t, s, weight, length, curve)
    !> Points, m, their weights, and a length like their distances, m
    real(wp), intent(in) :: t(:), s(:), weight(:), length
    !> The coefficients c
    real(wp), intent(out) :: curve(0:)
    real(wp) :: matrix(size(t), size(curve)), right(max(size(t), size(curve)), 1), &
        singular(min(size(t), size(curve))), work(8*(size(t) + size(curve)) + 64)
    integer :: rank, info, k

    do k = 0, ubound(curve, 1)
      matrix(:, k + 1) = sqrt(weight)*(t/length)**k
    end do
    right = 0
    right(:size(t), 1) = sqrt(weight)*s
    call dgelss(size(t), size(curve), 1, matrix, size(t), right, size(right, 1), singular, &
                smallest_singular, rank, work, size(work), info)
    curve = 0
    if (info /= 0) return
    do k = 0, ubound(curve, 1)
      curve(k) = right(k + 1, 1)/length**k
    end do
  end subroutine fit_curve

  !> Properties on both sides of the interfaces of particles, as far as one material is concerned
  subroutine fill_sides(this, materials, which, x, y, spacing, particles)
    class(material_flow_t), intent(inout) :: this
    type(materials_t), intent(in) :: materials
    integer, intent(in) :: which
    real(wp), intent(in) :: x(:), y(:), spacing
    integer(ip), intent(in) :: particles(:)
    real(wp), allocatable :: px(:), py(:), value(:, :), along_x(:, :), along_y(:, :), capacity(:)
    type(conduction_at_t) :: side
    integer, allocatable :: owner(:)
    integer :: k, j

    if (size(this%crossing) == 0) return
    allocate (owner(size(this%crossing)))
    do k = 1, size(particles)
      owner(this%first(k):this%first(k + 1) - 1) = particles(k)
    end do
    px = x(owner) + this%crossing%foot(1)
    py = y(owner) + this%crossing%foot(2)
    allocate (value(3, size(px)), along_x(3, size(px)), along_y(3, size(px)), capacity(size(px)))
    call materials%conductivity_at(which, px, py, value)
    call materials%conductivity_gradient(which, px, py, 1.0e-3_wp*spacing, along_x, along_y)
    call materials%capacity_at(which, px, py, capacity)
    do j = 1, size(px)
      associate (crossing => this%crossing(j))
        side = about(crossing%normal, value(:, j), along_x(:, j), along_y(:, j))
        if (crossing%beyond == which) then
          crossing%there = side
          crossing%capacity_ratio = crossing%capacity_ratio*capacity(j)
        else if (this%material(owner(j)) == which) then
          crossing%here = side
          crossing%capacity_ratio = crossing%capacity_ratio/capacity(j)
        end if
      end associate
    end do
  end subroutine fill_sides

  !> What a tensor κxx, κyy, κxy and its derivatives mean at an interface with some normal
  pure function about(normal, kappa, along_x, along_y) result(side)
    real(wp), intent(in) :: normal(2)
    real(wp), intent(in) :: kappa(3), along_x(3), along_y(3)
    type(conduction_at_t) :: side
    real(wp) :: tangent(2), along(3), divergence(2)

    tangent = [-normal(2), normal(1)]
    along = tangent(1)*along_x + tangent(2)*along_y
    divergence = [along_x(1) + along_y(3), along_x(3) + along_y(2)]
    side%n = between(normal, kappa, normal)
    side%m = between(normal, kappa, tangent)
    side%p = between(tangent, kappa, tangent)
    side%n_along = between(normal, along, normal)
    side%m_along = between(normal, along, tangent)
    side%d_across = dot_product(divergence, normal)
    side%d_along = dot_product(divergence, tangent)
  end function about

  !> a·K b
  pure function between(a, kappa, b) result(product)
    real(wp), intent(in) :: a(2), kappa(3), b(2)
    real(wp) :: product

    product = a(1)*(kappa(1)*b(1) + kappa(3)*b(2)) + a(2)*(kappa(3)*b(1) + kappa(2)*b(2))
  end function between

  subroutine describe(this, particle, neighbours, dx, dy, radius, degree, wanted, basis, known, &
                      outward, slope, slope_beyond, pace, ease, passing)
    class(material_flow_t), intent(in) :: this
    integer(ip), intent(in) :: particle
    integer(ip), intent(in) :: neighbours(:)
    real(wp), intent(in) :: dx(:), dy(:), radius
    integer, intent(in) :: degree
    real(wp), intent(out) :: wanted(:)
    real(wp), intent(out) :: basis(:, :)
    logical, intent(out) :: known(:)
    real(wp), intent(in) :: outward(:, :)
    real(wp), intent(out) :: slope(:, :), slope_beyond(:, :)
    real(wp), intent(out) :: pace
    real(wp), intent(out) :: ease(:), passing(:)
    real(wp) :: beyond(coefficients(degree), coefficients(degree)), s, t
    integer :: k, a, b, j

    associate (here => this%position(particle))
      associate (kappa => this%conductivity(:, here))
        pace = 1
        wanted = 0
        wanted(1:2) = this%divergence(:, here)*radius
        wanted(3:5) = [2*kappa(1), 2*kappa(3), 2*kappa(2)]
        slope = 0
        slope_beyond = 0
        do k = 1, size(outward, 2)
          slope(1:2, k) = [kappa(1)*outward(1, k) + kappa(3)*outward(2, k), &
                           kappa(3)*outward(1, k) + kappa(2)*outward(2, k)]
        end do
      end associate
      known = this%material(neighbours) == this%material(particle)
      do k = 1, size(neighbours)
        if (.not. known(k)) cycle
        do a = 0, degree
          do b = 0, degree - a
            if (a + b > 0) basis(monomial_position(a, b), k) = dx(k)**a*dy(k)**b
          end do
        end do
      end do
      ease = 1
      passing = 1
      do j = this%first(here), this%first(here + 1) - 1
        call find_ease(this%crossing(j), this%width/radius, dx, dy, radius, ease)
        call find_passing(this%crossing(j), this%material(neighbours), dx, dy, radius, passing)
        associate (crossing => this%crossing(j))
          pace = max(pace, (crossing%there%n + crossing%there%p)/ &
                     ((crossing%here%n + crossing%here%p)*crossing%capacity_ratio))
        end associate
        call continue_beyond(this%crossing(j), degree, radius, beyond)
        do k = 1, size(outward, 2)
          call find_slope_beyond(this%crossing(j), junction*this%width/radius, degree, radius, &
                                 beyond, outward(:, k), slope_beyond(:, k))
        end do
        do k = 1, size(neighbours)
          if (this%material(neighbours(k)) /= this%crossing(j)%beyond) cycle
          associate (crossing => this%crossing(j), x => dx(k) - this%crossing(j)%foot(1)/radius, &
                     y => dy(k) - this%crossing(j)%foot(2)/radius)
            s = x*crossing%normal(1) + y*crossing%normal(2)
            t = -x*crossing%normal(2) + y*crossing%normal(1)
            basis(:, k) = matmul([([(s**(a - b)*t**b, b=0, a)], a=0, degree)], beyond(:, 2:))
            known(k) = .true.
          end associate
        end do
      end do
      do k = 1, size(neighbours)
        if (.not. known(k)) basis(:, k) = 0
      end do
    end associate
  end subroutine describe

  !> n·K∇u on the wall beyond an interface, where that meets the wall near the particle; else the
  !> column is left as it is.
  pure subroutine find_slope_beyond(crossing, near, degree, radius, beyond, outward, column)
    type(crossing_t), intent(in) :: crossing
    !> How near that is, in units of the support radius
    real(wp), intent(in) :: near
    !> The degree of the functions, and the support radius, m
    integer, intent(in) :: degree
    real(wp), intent(in) :: radius
    !> What the functions are beyond the interface, from `continue_beyond`
    real(wp), intent(in) :: beyond(:, :)
    !> The wall's normal
    real(wp), intent(in) :: outward(2)
    !> What it is for each function
    real(wp), intent(inout) :: column(:)
    real(wp) :: tangent(2), depth, towards, t, gradient(2, size(column)), flux(2)
    integer :: b

    associate (n => crossing%normal, there => crossing%there)
      tangent = [-n(2), n(1)]
      depth = dot_product(crossing%foot, n)/radius
      ! Along the wall, (-outward₂, outward₁)
      towards = outward(1)*n(2) - outward(2)*n(1)
      if (.not. depth < near*abs(towards) .or. crossing%here%n > there%n) return
      t = depth/towards*(outward(1)*tangent(2) - outward(2)*tangent(1))
      gradient = 0
      do b = 0, degree - 1
        gradient(1, :) = gradient(1, :) + t**b*beyond(coefficient_position(1, b), 2:)
        gradient(2, :) = gradient(2, :) + (b + 1)*t**b*beyond(coefficient_position(0, b + 1), 2:)
      end do
      flux = matmul(reshape([there%n, there%m, there%m, there%p], [2, 2]), &
                    [dot_product(outward, n), dot_product(outward, tangent)])
      column = matmul(flux, gradient)
    end associate
  end subroutine find_slope_beyond

  !> A particle nearer to an interface than half a spacing conducts partly as the other material
  !> does, as in finite volumes; between two particles the harmonic mean counts.
  pure subroutine find_ease(crossing, width, dx, dy, radius, ease)
    type(crossing_t), intent(in) :: crossing
    !> The spacing in units of the support radius
    real(wp), intent(in) :: width
    !> Offsets in the same unit, and that, m
    real(wp), intent(in) :: dx(:), dy(:), radius
    real(wp), intent(inout) :: ease(:)
    real(wp) :: own, other, across
    integer :: k

    across = dot_product(crossing%foot, crossing%normal)/radius
    own = mixed(-across)
    do k = 1, size(ease)
      other = mixed(dx(k)*crossing%normal(1) + dy(k)*crossing%normal(2) - across)
      ease(k) = max(ease(k), 2*own*other/((own + other)*crossing%here%n))
    end do

  contains

    !> The conductivity of a particle at some distance beyond the interface
    pure function mixed(s) result(n)
      real(wp), intent(in) :: s
      real(wp) :: n

      n = crossing%here%n + (crossing%there%n - crossing%here%n)* &
          min(1.0_wp, max(0.0_wp, 0.5_wp + s/width))
    end function mixed

  end subroutine find_ease

  !> What passes between a particle and a neighbour beyond an interface goes one part of the way
  !> through either material, one after the other.
  pure subroutine find_passing(crossing, material, dx, dy, radius, passing)
    type(crossing_t), intent(in) :: crossing
    integer, intent(in) :: material(:)
    real(wp), intent(in) :: dx(:), dy(:), radius
    real(wp), intent(inout) :: passing(:)
    real(wp) :: depth, height
    integer :: k

    depth = max(0.0_wp, dot_product(crossing%foot, crossing%normal)/radius)
    do k = 1, size(passing)
      if (material(k) /= crossing%beyond) cycle
      height = max(0.0_wp, dx(k)*crossing%normal(1) + dy(k)*crossing%normal(2) - depth)
      if (.not. depth + height > 0) cycle
      passing(k) = (depth + height)/(depth + height*crossing%here%n/crossing%there%n)
    end do
  end subroutine find_passing

  !> The coefficients beyond an interface, of s and t about the foot, of each monomial of offsets
  !> from the particle, constants first, one a column; all in units of a radius.
  subroutine continue_beyond(crossing, degree, radius, beyond)
    type(crossing_t), intent(in) :: crossing
    integer, intent(in) :: degree
    real(wp), intent(in) :: radius
    real(wp), intent(out) :: beyond(:, :)
    real(wp) :: matrix(size(beyond, 1), size(beyond, 1))
    integer :: k

    call shifted_monomials(degree, crossing%foot/radius, crossing%normal, beyond)
    call continuation(degree, in_units_of(crossing%here), in_units_of(crossing%there), &
                      crossing%capacity_ratio, &
                      crossing%curve*[(radius**(k - 1), k=0, curve_degree)], matrix)
    beyond = matmul(matrix, beyond)

  contains

    pure function in_units_of(side) result(scaled)
      type(conduction_at_t), intent(in) :: side
      type(conduction_at_t) :: scaled

      scaled = conduction_at_t(side%n, side%m, side%p, radius*side%n_along, radius*side%m_along, &
                               radius*side%d_across, radius*side%d_along)
    end function in_units_of

  end subroutine continue_beyond

end module calor_material_flow
