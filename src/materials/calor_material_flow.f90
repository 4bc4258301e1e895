!> What div(K ∇u) is in a body of several materials, or of one that conducts heat differently in
!> different directions.
!>
!> A function u at a particle of material A, about the foot r₀ of its perpendicular on the interface
!> with material B: u = u₀ + g s + τ t + a s²/2 + b s t + c t²/2, where s is measured along the
!> normal n from A to B and t along the interface. Beyond a straight interface it goes on as
!> u₀ + g' s + τ t + a' s²/2 + b' s t + c t²/2, for the temperature is continuous all along it. The
!> flux is so too,
!>
!>     κ_B g' = κ_A g,    κ_B b' + κ_B,t g' = κ_A b + κ_A,t g,
!>
!> and so is ∂u/∂t, so that div(κ ∇u)/(ρc) is the same on both sides:
!>
!>     κ_B (a' + c) + κ_B,s g' + κ_B,t τ = (ρc)_B/(ρc)_A [κ_A (a + c) + κ_A,s g + κ_A,t τ].
!>
!> These five numbers are linear in those of A: the immersed interface method, R.J. LeVeque, Z. Li,
!> SIAM J. Numer. Anal. 31 (1994) 1019–1044, here for rows of least norm on any cloud.
module calor_material_flow
  use calor_flow_rows, only: flow_model_t
  use calor_kinds, only: wp, ip
  use calor_materials, only: materials_t
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_taylor_weights, only: monomials, monomial_position
  implicit none (type, external)
  private

  public :: material_flow_t

  !> Pairs of particles this many spacings apart at most are asked for an interface between them
  real(wp), parameter :: reach = 2.1_wp
  !> Its normal at a particle comes from points this many spacings beyond the nearest one at most
  real(wp), parameter :: patch = 2.5_wp
  !> An interface so many spacings away matters for no row
  real(wp), parameter :: farthest = 12.0_wp
  !> Bisections that find it between two particles
  integer, parameter :: bisections = 52

  !> An interface as one particle sees it
  type :: crossing_t
    !> The material beyond
    integer :: beyond = 0
    !> Foot of the perpendicular, relative to the particle, m, and normal towards the other side
    real(wp) :: foot(2) = 0.0_wp, normal(2) = 0.0_wp
    !> κ, ∂κ/∂s and ∂κ/∂t at the foot on either side
    real(wp) :: here(3) = 0.0_wp, there(3) = 0.0_wp
    !> (ρc)_B/(ρc)_A
    real(wp) :: capacity_ratio = 1.0_wp
  end type crossing_t

  type, extends(flow_model_t) :: material_flow_t
    !> The material of each particle
    integer, allocatable :: material(:)
    !> Points on interfaces, m, and the materials on both sides
    real(wp), allocatable, private :: x(:), y(:)
    integer, allocatable, private :: side(:, :)
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
    procedure, private :: see_interface
    procedure, private :: fill_sides
  end type material_flow_t

contains

  subroutine find_interfaces(this, materials, x, y, spacing)
    class(material_flow_t), intent(inout) :: this
    !> The materials; `this%material` is set
    type(materials_t), intent(in) :: materials
    !> Coordinates of the particles, and their spacing, m
    real(wp), intent(in) :: x(:), y(:)
    real(wp), intent(in) :: spacing
    type(neighbour_list_t) :: list
    integer(ip), allocatable :: one(:), other(:)
    integer, allocatable :: found(:), own(:)
    real(wp), allocatable :: near(:), far(:), middle(:)
    integer :: k, i, used, pass

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
  end subroutine find_interfaces

  pure function touch(this, one, other) result(answer)
    class(material_flow_t), intent(in) :: this
    !> Positions of the materials
    integer, intent(in) :: one, other
    logical :: answer

    answer = any((this%side(:, 1) == one .and. this%side(:, 2) == other) .or. &
                 (this%side(:, 1) == other .and. this%side(:, 2) == one))
  end function touch

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

  !> The interface with another material nearest to a particle: a straight line through the points
  !> found on it, by least squares of their distances from it.
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
    real(wp) :: centre(2), sxx, sxy, syy, angle, mean(2)

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
    seen%foot = dot_product(centre, seen%normal)*seen%normal
  end subroutine see_interface

  !> Properties on both sides of the interfaces of particles, as far as one material is concerned
  subroutine fill_sides(this, materials, which, x, y, spacing, particles)
    class(material_flow_t), intent(inout) :: this
    type(materials_t), intent(in) :: materials
    integer, intent(in) :: which
    real(wp), intent(in) :: x(:), y(:), spacing
    integer(ip), intent(in) :: particles(:)
    real(wp), allocatable :: px(:), py(:), value(:, :), along_x(:, :), along_y(:, :), capacity(:)
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
      associate (crossing => this%crossing(j), &
                 slope => [along_x(1, j), along_y(1, j)])
        associate (all => [value(1, j), dot_product(slope, crossing%normal), &
                           -slope(1)*crossing%normal(2) + slope(2)*crossing%normal(1)])
          if (crossing%beyond == which) then
            crossing%there = all
            crossing%capacity_ratio = crossing%capacity_ratio*capacity(j)
          else if (this%material(owner(j)) == which) then
            crossing%here = all
            crossing%capacity_ratio = crossing%capacity_ratio/capacity(j)
          end if
        end associate
      end associate
    end do
  end subroutine fill_sides

  subroutine describe(this, particle, neighbours, dx, dy, radius, degree, wanted, basis, known, &
                      outward, slope, pace)
    class(material_flow_t), intent(in) :: this
    integer(ip), intent(in) :: particle
    integer(ip), intent(in) :: neighbours(:)
    real(wp), intent(in) :: dx(:), dy(:), radius
    integer, intent(in) :: degree
    real(wp), intent(out) :: wanted(:)
    real(wp), intent(out) :: basis(:, :)
    logical, intent(out) :: known(:)
    real(wp), intent(in) :: outward(:, :)
    real(wp), intent(out) :: slope(:, :)
    real(wp), intent(out) :: pace
    real(wp) :: beyond(5, 6), s, t
    integer :: k, a, b, j

    associate (here => this%position(particle))
      associate (kappa => this%conductivity(:, here))
        pace = 1
        wanted = 0
        wanted(1:2) = this%divergence(:, here)*radius
        wanted(3:5) = [2*kappa(1), 2*kappa(3), 2*kappa(2)]
        slope = 0
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
      do j = this%first(here), this%first(here + 1) - 1
        call continue_beyond(this%crossing(j), radius, beyond)
        associate (crossing => this%crossing(j))
          pace = max(pace, crossing%there(1)/(crossing%here(1)*crossing%capacity_ratio))
        end associate
        do k = 1, size(neighbours)
          if (this%material(neighbours(k)) /= this%crossing(j)%beyond) cycle
          associate (crossing => this%crossing(j), x => dx(k) - this%crossing(j)%foot(1)/radius, &
                     y => dy(k) - this%crossing(j)%foot(2)/radius)
            s = x*crossing%normal(1) + y*crossing%normal(2)
            t = -x*crossing%normal(2) + y*crossing%normal(1)
            basis(:, k) = 0
            basis(1:5, k) = matmul(beyond, [1.0_wp, s, t, s**2/2, s*t, t**2/2])
            known(k) = .true.
          end associate
        end do
      end do
      do k = 1, size(neighbours)
        if (.not. known(k)) basis(:, k) = 0
      end do
    end associate
  end subroutine describe

  !> u₀, g', τ, a', b', c of x, y, x², xy, y², offsets from the particle in units of a radius: a row
  !> for each.
  pure subroutine continue_beyond(crossing, radius, beyond)
    type(crossing_t), intent(in) :: crossing
    real(wp), intent(in) :: radius
    real(wp), intent(out) :: beyond(5, 6)
    real(wp) :: x, y, u, gradient(2), hessian(2, 2), tangent(2), here(3), there(3)
    real(wp) :: g, tau, a, b, c, g_beyond
    integer :: k

    x = crossing%foot(1)/radius
    y = crossing%foot(2)/radius
    tangent = [-crossing%normal(2), crossing%normal(1)]
    here = crossing%here*[1.0_wp, radius, radius]
    there = crossing%there*[1.0_wp, radius, radius]
    do k = 1, 5
      hessian = 0
      select case (k)
      case (1)
        u = x
        gradient = [1.0_wp, 0.0_wp]
      case (2)
        u = y
        gradient = [0.0_wp, 1.0_wp]
      case (3)
        u = x**2
        gradient = [2*x, 0.0_wp]
        hessian(1, 1) = 2
      case (4)
        u = x*y
        gradient = [y, x]
        hessian(1, 2) = 1
        hessian(2, 1) = 1
      case default
        u = y**2
        gradient = [0.0_wp, 2*y]
        hessian(2, 2) = 2
      end select
      g = dot_product(gradient, crossing%normal)
      tau = dot_product(gradient, tangent)
      a = dot_product(crossing%normal, matmul(hessian, crossing%normal))
      b = dot_product(crossing%normal, matmul(hessian, tangent))
      c = dot_product(tangent, matmul(hessian, tangent))
      g_beyond = here(1)/there(1)*g
      beyond(k, 1:3) = [u, g_beyond, tau]
      beyond(k, 4) = (crossing%capacity_ratio*(here(1)*(a + c) + here(2)*g + here(3)*tau) - &
                      there(2)*g_beyond - there(3)*tau)/there(1) - c
      beyond(k, 5) = (here(3)*g + here(1)*b - there(3)*g_beyond)/there(1)
      beyond(k, 6) = c
    end do
  end subroutine continue_beyond

end module calor_material_flow
