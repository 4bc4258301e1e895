!> Particles that move are kept evenly spread, and their field goes on at the new places.
!>
!> Inside, particles repel each other a little, as in the arrangement 'relaxed' (calor_relaxation).
!> On walls they slide along the wall, back to the parts of its length between two corners that they
!> had at first; corners stay. So shifted, a particle is no longer the matter that it was: its
!> temperature becomes that of the new place,
!>
!>     T(r + δ) ≈ T_i + Σ a_ij (T_j - T_i),   Σ a_ij P(r_ji) = P(δ) for all monomials P of degree 1
!> … d,
!>
!> about the particle i that was nearest to the new place, with the weights of least norm
!> (calor_taylor_weights): exact for polynomials of degree d, and no smoothing where δ = 0, as a
!> least-squares fit would make.
module calor_shifting
  use calor_cloud, only: cloud_t
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, ip
  use calor_moving_walls, only: moving_walls_t
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_relaxation, only: repulsion, push
  use calor_skin_list, only: skin_list_t, find_neighbours
  use calor_stencil, only: stencil_t
  use calor_taylor_weights, only: taylor_weights, monomials, monomial_position
  implicit none (type, external)
  private

  public :: find_even_places, carry_field

  !> Particles repel each other up to this distance, in spacings, and those so near are listed
  real(wp), parameter :: reach = 1.5_wp, listed = 2.0_wp
  !> Displacement per unit of force, and the longest of a sweep, in spacings
  real(wp), parameter :: mobility = 0.03_wp, longest_way = 0.05_wp
  !> No particle is shifted nearer to a wall, in spacings
  real(wp), parameter :: nearest_wall = 0.4_wp
  !> Sweeps at a time
  integer, parameter :: sweeps = 3
  !> What is shifted less, in spacings, stays
  real(wp), parameter :: least_way = 1.0e-9_wp
  !> What weights may miss of a moment, in units of the support radius, and what they may add up to
  real(wp), parameter :: largest_residual = 1.0e-10_wp, largest_sum = 2.0_wp
  !> The support of a particle whose weights miss grows by this, so many times
  real(wp), parameter :: growth = 1.2_wp
  integer, parameter :: most_times = 8

contains

  !> Where particles would be spread evenly, or more so than they are.
  subroutine find_even_places(cloud, walls, x, y, origin)
    !> The cloud
    type(cloud_t), intent(in) :: cloud
    !> Its walls
    type(moving_walls_t), intent(in) :: walls
    !> The new places, m
    real(wp), allocatable, intent(out) :: x(:), y(:)
    !> The particle that was nearest to each of them, or nearly so
    integer(ip), allocatable, intent(out) :: origin(:)
    integer :: k

    x = cloud%x
    y = cloud%y
    origin = [(int(k, ip), k=1, cloud%particles())]
    call walls%slide(cloud%x, cloud%y, x, y, origin)
    call spread_inside(cloud, walls, x, y)
  end subroutine find_even_places

  !> Some sweeps of repulsion; wall particles stay.
  subroutine spread_inside(cloud, walls, x, y)
    type(cloud_t), intent(in) :: cloud
    type(moving_walls_t), intent(in) :: walls
    real(wp), intent(inout) :: x(:), y(:)
    type(neighbour_list_t) :: list
    real(wp), allocatable :: way(:, :), normal(:, :)
    integer(ip), allocatable :: free(:)
    integer :: k, sweep

    free = pack([(int(k, ip), k=1, size(x))], cloud%side == 0)
    call build_neighbour_list(x, y, listed*cloud%spacing, list, free)
    call walls%find_normals(x, y, normal)
    allocate (way(2, size(free)))
    do sweep = 1, sweeps
      !$omp parallel do schedule(static) default(shared) private(k)
      do k = 1, size(free)
        way(:, k) = way_of(list%index(list%first(k):list%first(k + 1) - 1), free(k))
      end do
      !$omp end parallel do
      x(free) = x(free) + way(1, :)
      y(free) = y(free) + way(2, :)
    end do

  contains

    !> Away from the neighbours and from the mirror image in the nearest wall; not too near to that.
    pure function way_of(neighbours, i) result(step)
      integer(ip), intent(in) :: neighbours(:)
      integer(ip), intent(in) :: i
      real(wp) :: step(2)
      real(wp) :: height, least, inward(2), offset(2), norm
      integer :: n

      step = repulsion(neighbours, i, x, y, reach*cloud%spacing)
      least = huge(least)
      inward = 0
      do n = 1, size(neighbours)
        associate (wall => walls%place(neighbours(n)))
          if (wall == 0) cycle
          offset = [x(i) - x(neighbours(n)), y(i) - y(neighbours(n))]
          height = -dot_product(offset, normal(:, wall))
          ! Only what lies before the wall particle, not beside it
          if (sum(offset**2) - height**2 > (0.75_wp*cloud%spacing)**2) cycle
          if (height >= least) cycle
          least = height
          inward = -normal(:, wall)
        end associate
      end do
      if (least < 0.5_wp*reach*cloud%spacing) then
        step = step + push(2*max(least, 0.0_wp)/(reach*cloud%spacing))*inward
      end if
      step = mobility*cloud%spacing*step
      norm = hypot(step(1), step(2))
      if (norm > longest_way*cloud%spacing) step = step*(longest_way*cloud%spacing/norm)
      if (least < huge(least)) then
        height = least + dot_product(step, inward)
        if (height < nearest_wall*cloud%spacing) then
          step = step + min(nearest_wall*cloud%spacing - height, longest_way*cloud%spacing)*inward
        end if
      end if
    end function way_of

  end subroutine spread_inside

  !> The field at the new places. A particle whose place cannot be reached exactly stays.
  subroutine carry_field(cloud, kernel, degree, support, near, origin, x, y, field)
    !> The cloud with the old places
    type(cloud_t), intent(in) :: cloud
    class(kernel_t), intent(in) :: kernel
    !> Degree of the polynomials
    integer, intent(in) :: degree
    !> Support radius to begin with, m
    real(wp), intent(in) :: support
    !> Where neighbours are looked up first
    type(skin_list_t), intent(in) :: near
    !> From `find_even_places`
    integer(ip), intent(in) :: origin(:)
    !> The new places, m; where the field cannot be carried there, the old ones
    real(wp), intent(inout) :: x(:), y(:)
    !> The field at the old places, and at the new ones
    real(wp), intent(inout) :: field(:)
    type(neighbour_list_t) :: list
    type(stencil_t) :: stencil
    real(wp), allocatable :: radius(:), carried(:)
    integer(ip), allocatable :: pending(:)
    logical, allocatable :: done(:)
    integer :: k, time

    pending = pack([(int(k, ip), k=1, size(x))], &
                   hypot(x - cloud%x, y - cloud%y) > least_way*cloud%spacing)
    allocate (radius(size(x)), source=support)
    carried = field
    do time = 0, most_times
      if (size(pending) == 0) exit
      call find_neighbours(cloud%x, cloud%y, radius(pending), list, origin(pending), near)
      allocate (done(size(pending)))
      !$omp parallel default(shared) private(k) firstprivate(stencil)
      call stencil%reserve(list%longest_row())
      !$omp do schedule(static)
      do k = 1, size(pending)
        call carry_one(pending(k), list%index(list%first(k):list%first(k + 1) - 1), stencil, &
                       done(k))
      end do
      !$omp end do
      !$omp end parallel
      pending = pack(pending, .not. done)
      deallocate (done)
      radius(pending) = growth*radius(pending)
    end do
    x(pending) = cloud%x(pending)
    y(pending) = cloud%y(pending)
    field = carried

  contains

    subroutine carry_one(i, neighbours, stencil, done)
      integer(ip), intent(in) :: i
      integer(ip), intent(in) :: neighbours(:)
      type(stencil_t), intent(inout) :: stencil
      !> Whether the weights are exact
      logical, intent(out) :: done
      real(wp) :: wanted(monomials(degree), 1), weight(size(neighbours), 1), condition, way(2)
      integer :: a, b

      associate (from => origin(i))
        way = [x(i) - cloud%x(from), y(i) - cloud%y(from)]/radius(i)
        do a = 0, degree
          do b = 0, degree - a
            if (a + b > 0) wanted(monomial_position(a, b), 1) = way(1)**a*way(2)**b
          end do
        end do
        call stencil%gather(kernel, cloud%x, cloud%y, cloud%volume, from, neighbours, radius(i))
        call taylor_weights(stencil, degree, wanted, weight, condition)
        done = stencil%residual <= largest_residual .and. sum(abs(weight)) <= largest_sum
        if (.not. done) return
        carried(i) = field(from) + sum(weight(:, 1)*(field(neighbours) - field(from)))
      end associate
    end subroutine carry_one

  end subroutine carry_field

end module calor_shifting
