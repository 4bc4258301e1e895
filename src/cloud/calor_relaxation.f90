!> Particles that repel each other until they are evenly spread.
module calor_relaxation
  use calor_constants, only: worth_threads
  use calor_body, only: body_t
  use calor_kinds, only: wp, ip
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  implicit none (type, external)
  private

  public :: relax_particles, repulsion, push

  !> Particles repel each other up to this distance in spacings. At rest neighbours are some 1.07
  !> spacings apart, those behind them 1.8: each feels only those directly beside it.
  real(wp), parameter :: reach = 1.5_wp
  !> Neighbours are listed up to here, so that a list serves several sweeps
  real(wp), parameter :: listed = 1.9_wp
  !> Displacement per unit of force, in spacings: half of what would make neighbours swing
  real(wp), parameter :: mobility = 0.03_wp
  !> No particle moves further in a sweep, in spacings
  real(wp), parameter :: longest_way = 0.15_wp
  !> Nor comes nearer to a wall, in spacings
  real(wp), parameter :: nearest_wall = 0.4_wp
  !> At rest is what moves less than this in a sweep, in spacings
  real(wp), parameter :: at_rest = 2.0e-3_wp
  !> The end at the latest
  integer, parameter :: most_sweeps = 150

contains

  !> Move inner particles until the particles of a body are evenly spread.
  !>
  !> Every sweep moves each particle along the sum of its neighbours' repulsions, all at once, so
  !> that the result does not depend on the number of threads. A particle near a wall is also
  !> repelled by its mirror image; no particle leaves the body.
  subroutine relax_particles(body, spacing, fixed, x, y, sweeps)
    !> The body
    type(body_t), intent(in) :: body
    !> Distance of neighbours on a lattice of as many particles, m
    real(wp), intent(in) :: spacing
    !> The first particles, so many, lie on the walls and stay there
    integer, intent(in) :: fixed
    !> Coordinates of all particles, m
    real(wp), intent(inout) :: x(:), y(:)
    !> How many sweeps it took
    integer, intent(out), optional :: sweeps
    type(neighbour_list_t) :: list
    !> What each particle may move before it could be too near to a wall, m; a lower bound
    real(wp), allocatable :: clearance(:)
    real(wp), allocatable :: way_x(:), way_y(:)
    integer(ip), allocatable :: free(:)
    real(wp) :: longest, since_listed
    integer :: k, sweep

    free = [(int(k, ip), k=fixed + 1, size(x))]
    allocate (clearance(size(free)), source=0.0_wp)
    allocate (way_x(size(free)), way_y(size(free)))
    since_listed = listed*spacing
    do sweep = 1, most_sweeps
      ! Two particles may each have come nearer by all that they have moved
      if (2*since_listed > (listed - reach)*spacing) then
        call build_neighbour_list(x, y, listed*spacing, list, free)
        since_listed = 0
      end if
      call find_ways(body, spacing, list, x, y, clearance, way_x, way_y)
      longest = 0
      !$omp parallel do if (size(free) > worth_threads) schedule(static) default(shared) &
      !$omp private(k) reduction(max: longest)
      do k = 1, size(free)
        x(free(k)) = x(free(k)) + way_x(k)
        y(free(k)) = y(free(k)) + way_y(k)
        longest = max(longest, hypot(way_x(k), way_y(k)))
      end do
      !$omp end parallel do
      since_listed = since_listed + longest
      if (longest < at_rest*spacing) exit
    end do
    if (present(sweeps)) sweeps = min(sweep, most_sweeps)
  end subroutine relax_particles

  !> Where each free particle goes in one sweep.
  subroutine find_ways(body, spacing, list, x, y, clearance, way_x, way_y)
    type(body_t), intent(in) :: body
    real(wp), intent(in) :: spacing
    type(neighbour_list_t), intent(in) :: list
    real(wp), intent(in) :: x(:), y(:)
    real(wp), intent(inout) :: clearance(:)
    real(wp), intent(out) :: way_x(:), way_y(:)
    real(wp) :: distance, inward(2), way(2), norm
    integer :: k

    !$omp parallel do if (list%rows() > worth_threads) schedule(static) default(shared) &
    !$omp private(k, distance, inward, way, norm)
    do k = 1, list%rows()
      associate (i => list%target(k))
        way = repulsion(list%index(list%first(k):list%first(k + 1) - 1), i, x, y, reach*spacing)
        ! The distance to a wall changes by no more than the way: far inside nobody need ask for it
        if (clearance(k) < (nearest_wall + longest_way)*spacing .or. &
            clearance(k) < 0.5_wp*reach*spacing) then
          call body%find_wall([x(i), y(i)], distance, inward)
          clearance(k) = distance
          way = way + push(2*distance/(reach*spacing))*inward
        end if
        way = mobility*spacing*way
        norm = hypot(way(1), way(2))
        if (norm > longest_way*spacing) then
          way = way*(longest_way*spacing/norm)
          norm = longest_way*spacing
        end if
        if (clearance(k) - norm < nearest_wall*spacing) then
          call body%find_wall([x(i), y(i)] + way, distance, inward)
          if (distance < nearest_wall*spacing) then
            ! Along the wall, or back from it
            way = way + (nearest_wall*spacing - distance)*inward
            call body%find_wall([x(i), y(i)] + way, distance, inward)
            if (distance < nearest_wall*spacing) way = 0
          end if
          norm = hypot(way(1), way(2))
        end if
        clearance(k) = clearance(k) - norm
        way_x(k) = way(1)
        way_y(k) = way(2)
      end associate
    end do
    !$omp end parallel do
  end subroutine find_ways

  !> The sum of the neighbours' pushes.
  pure function repulsion(neighbours, i, x, y, range) result(force)
    integer(ip), intent(in) :: neighbours(:)
    integer(ip), intent(in) :: i
    real(wp), intent(in) :: x(:), y(:)
    !> m
    real(wp), intent(in) :: range
    real(wp) :: force(2)
    real(wp) :: dx, dy, distance
    integer :: k

    force = 0
    do k = 1, size(neighbours)
      dx = x(i) - x(neighbours(k))
      dy = y(i) - y(neighbours(k))
      distance = sqrt(dx*dx + dy*dy)
      ! At the same place there is no direction; the next one parts them
      if (distance >= range .or. .not. distance > 0) cycle
      force = force + [dx, dy]*(push(distance/range)/distance)
    end do
  end function repulsion

  !> How strongly two particles repel each other. The steep rise makes triangles of neighbours; a
  !> force that grew linearly would make squares.
  pure function push(distance) result(force)
    !> In units of the reach
    real(wp), intent(in) :: distance
    real(wp) :: force
    !> Nearer than this nothing changes, so that no force is infinite
    real(wp), parameter :: core = 0.1_wp

    force = max(0.0_wp, 1 - distance)/max(core, distance)**3
  end function push

end module calor_relaxation
