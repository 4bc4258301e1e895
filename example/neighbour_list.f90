!> The neighbours of a million points, from nothing but their coordinates.
program neighbour_list
  use calor, only: neighbour_list_t, build_neighbour_list, hilbert_order, wp, ip, i8
  implicit none (type, external)
  integer, parameter :: n = 1000000, i = n/2
  real(wp), parameter :: radius = 0.002_wp, pi = acos(-1.0_wp)
  type(neighbour_list_t) :: neighbours
  real(wp), allocatable :: x(:), y(:)
  integer(ip), allocatable :: order(:)
  integer(i8) :: start, finish, ticks_per_second
  integer :: nearest

  allocate (x(n), y(n))
  call random_init(repeatable=.true., image_distinct=.false.)
  call random_number(x)
  call random_number(y)
  ! Near in the plane, near in memory: what comes after is the quicker for it
  call hilbert_order(x, y, order)
  x = x(order)
  y = y(order)

  call system_clock(start, ticks_per_second)
  call build_neighbour_list(x, y, radius, neighbours)
  call system_clock(finish)
  print '(i0,a,f6.2,a)', n, ' points in ', real(finish - start, wp)/ticks_per_second, ' s'
  print '(f6.3,a,f6.3,a)', real(size(neighbours%index), wp)/n, ' neighbours on average, ', &
    n*pi*radius**2, ' expected'

  ! The neighbours of point i are index(first(i)) to index(first(i + 1) - 1)
  associate (mine => neighbours%index(neighbours%first(i):neighbours%first(i + 1) - 1))
    nearest = mine(minloc((x(mine) - x(i))**2 + (y(mine) - y(i))**2, dim=1))
    print '(a,i0,a,i0,a,es8.2)', 'Point ', i, ' has ', size(mine), ' neighbours, the nearest at ', &
      hypot(x(nearest) - x(i), y(nearest) - y(i))
  end associate
end program neighbour_list
