!> Tests of clouds: arrangements, checks and volumes.
module test_clouds
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan, ieee_positive_inf
  use calor_arrangements, only: arrangement_choices
  use calor_cloud, only: cloud_t
  use calor_cloud_check, only: check_cloud
  use calor_error, only: error_t, status_bad_input
  use calor_kernel, only: kernel_t
  use calor_kernels, only: make_kernel
  use calor_kinds, only: wp, ip
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_rectangle_cloud, only: make_rectangle
  use calor_space_filling_curve, only: hilbert_order
  use calor_text, only: to_text
  use calor_volume, only: volumes_from_kernel
  use omp_lib, only: omp_get_max_threads, omp_set_num_threads
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_clouds

  real(wp), parameter :: unit_range(2) = [0.0_wp, 1.0_wp]

contains

  subroutine collect_clouds(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('lattice', test_lattice), &
                new_unittest('lattice is that of the reference tables', test_reference), &
                new_unittest('lattice with a spacing that does not fit', test_fitted), &
                new_unittest('walls and corners', test_walls), &
                new_unittest('jitter displaces inner particles only', test_jitter), &
                new_unittest('jitter depends on the seed, not on threads', test_seed), &
                new_unittest('hexagonal: distances and walls', test_hexagonal), &
                new_unittest('hexagonal: six neighbours inside', test_six_neighbours), &
                new_unittest('bad requests are refused', test_refused), &
                new_unittest('unknown arrangements', test_arrangement_names), &
                new_unittest('check of a cloud', test_check), &
                new_unittest('reordering keeps the way back', test_reorder), &
                new_unittest('volumes from the kernel', test_volumes) &
                ]
  end subroutine collect_clouds

  subroutine test_lattice(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    integer :: k

    call make(error, cloud, [-1.0_wp, 1.0_wp], [2.0_wp, 3.0_wp], 0.25_wp, 'lattice')
    if (allocated(error)) return
    call check(error, cloud%particles(), 9*5)
    if (allocated(error)) return
    ! Columns from the left, each from the bottom
    call check(error, all(abs(cloud%x(:5) + 1) <= 0) .and. abs(cloud%x(6) + 0.75_wp) <= 0)
    if (allocated(error)) return
    call check(error, all(abs(cloud%y(:5) - [2.0_wp, 2.25_wp, 2.5_wp, 2.75_wp, 3.0_wp]) <= 0))
    if (allocated(error)) return
    call check(error, all(abs(cloud%volume - 0.0625_wp) <= 0))
    if (allocated(error)) return
    call check(error, cloud%spacing, 0.25_wp)
    if (allocated(error)) return
    call check(error, all(cloud%user_index == [(int(k, ip), k=1, 45)]))
  end subroutine test_lattice

  !> The first two columns of the tables are coordinates, the third volumes, the fourth walls.
  subroutine test_reference(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    real(wp) :: x, y, volume
    integer :: k, status, unit, wall

    call make(error, cloud, unit_range, unit_range, 1/12.0_wp, 'lattice')
    if (allocated(error)) return
    open (newunit=unit, file='data/reference/operators_cubic_spline_lattice.csv', &
          action='read', status='old', iostat=status)
    call check(error, status, 0, 'the reference table cannot be opened')
    if (allocated(error)) return
    read (unit, *)
    read (unit, *)
    do k = 1, cloud%particles()
      read (unit, *) x, y, volume, wall
      call check(error, max(abs(cloud%x(k) - x), abs(cloud%y(k) - y)) <= 0, 'other coordinates')
      if (allocated(error)) exit
      call check(error, cloud%volume(k), volume, thr=1.0e-16_wp)
      if (allocated(error)) exit
      call check(error, merge(1, 0, cloud%side(k) /= 0), wall)
      if (allocated(error)) exit
    end do
    close (unit)
  end subroutine test_reference

  subroutine test_fitted(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud

    ! 1/0.3 is nearest to 3 intervals, 0.4/0.3 to 1
    call make(error, cloud, [0.2_wp, 1.2_wp], [0.1_wp, 0.5_wp], 0.3_wp, 'lattice')
    if (allocated(error)) return
    call check(error, cloud%particles(), 4*2)
    if (allocated(error)) return
    call check(error, all(cloud%side /= 0))
    if (allocated(error)) return
    ! The far walls are hit exactly
    call check(error, abs(maxval(cloud%x) - 1.2_wp) <= 0 .and. abs(maxval(cloud%y) - 0.5_wp) <= 0)
    if (allocated(error)) return
    call check(error, cloud%volume(1), 0.4_wp/3, thr=1.0e-15_wp)
    if (allocated(error)) return
    ! A spacing that an edge falls short of by rounding only
    call make(error, cloud, [0.2_wp, 0.3_wp], unit_range, 0.1_wp, 'lattice')
    if (allocated(error)) return
    call check(error, cloud%particles(), 2*11)
  end subroutine test_fitted

  subroutine test_walls(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    integer :: k

    do k = 1, size(arrangement_choices)
      call make(error, cloud, [-2.0_wp, 1.0_wp], [5.0_wp, 6.0_wp], 0.1_wp, &
                trim(arrangement_choices(k)%name))
      if (allocated(error)) return
      call check(error, size(cloud%boundary), 4)
      if (allocated(error)) return
      call check(error, cloud%boundary(1)%value//cloud%boundary(2)%value// &
                 cloud%boundary(3)%value//cloud%boundary(4)%value, 'leftrightbottomtop')
      if (allocated(error)) return
      call check(error, all(btest(cloud%side, 0) .eqv. .not. cloud%x > -2), 'left')
      if (allocated(error)) return
      call check(error, all(btest(cloud%side, 1) .eqv. .not. cloud%x < 1), 'right')
      if (allocated(error)) return
      call check(error, all(btest(cloud%side, 2) .eqv. .not. cloud%y > 5), 'bottom')
      if (allocated(error)) return
      call check(error, all(btest(cloud%side, 3) .eqv. .not. cloud%y < 6), 'top')
      if (allocated(error)) return
      call check(error, count(popcnt(cloud%side) == 2), 4)
      if (allocated(error)) return
      call check(error, all(cloud%x >= -2) .and. all(cloud%x <= 1), 'outside of the x range')
      if (allocated(error)) return
      call check(error, all(cloud%y >= 5) .and. all(cloud%y <= 6), 'outside of the y range')
      if (allocated(error)) return
    end do
  end subroutine test_walls

  subroutine test_jitter(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud, lattice
    real(wp), allocatable :: dx(:), dy(:)
    logical, allocatable :: inside(:)

    call make(error, lattice, unit_range, [0.0_wp, 2.0_wp], 0.02_wp, 'lattice')
    if (allocated(error)) return
    call make(error, cloud, unit_range, [0.0_wp, 2.0_wp], 0.02_wp, 'jittered', jitter=0.45_wp)
    if (allocated(error)) return
    dx = (cloud%x - lattice%x)/0.02_wp
    dy = (cloud%y - lattice%y)/0.02_wp
    inside = cloud%side == 0
    call check(error, all(inside .eqv. lattice%side == 0))
    if (allocated(error)) return
    call check(error, all(inside .or. abs(dx) + abs(dy) <= 0), 'wall particles moved')
    if (allocated(error)) return
    call check(error, maxval(abs(dx)) <= 0.4500001_wp .and. maxval(abs(dx)) > 0.44_wp)
    if (allocated(error)) return
    call check(error, maxval(abs(dy)) <= 0.4500001_wp .and. maxval(abs(dy)) > 0.44_wp)
    if (allocated(error)) return
    associate (number => count(inside))
      ! Means, variances and the covariance of 4851 displacements
      call check(error, abs(sum(dx)) + abs(sum(dy)) < 0.03_wp*number, 'not centred')
      if (allocated(error)) return
      call check(error, sum(dx**2)/number, 0.45_wp**2/3, thr=0.004_wp)
      if (allocated(error)) return
      call check(error, sum(dy**2)/number, 0.45_wp**2/3, thr=0.004_wp)
      if (allocated(error)) return
      call check(error, abs(sum(dx*dy))/number < 0.004_wp, 'both directions correlate')
      if (allocated(error)) return
    end associate
    call check(error, all(abs(cloud%volume - lattice%volume) <= 0))
    if (allocated(error)) return
    call make(error, cloud, unit_range, [0.0_wp, 2.0_wp], 0.02_wp, 'jittered', jitter=0.0_wp)
    if (allocated(error)) return
    call check(error, all(abs(cloud%x - lattice%x) + abs(cloud%y - lattice%y) <= 0))
  end subroutine test_jitter

  subroutine test_seed(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: first, other, again
    integer :: threads

    threads = omp_get_max_threads()
    call omp_set_num_threads(1)
    call make(error, first, unit_range, unit_range, 0.05_wp, 'jittered', 0.3_wp, 11)
    call omp_set_num_threads(2)
    if (.not. allocated(error)) then
      call make(error, again, unit_range, unit_range, 0.05_wp, 'jittered', 0.3_wp, 11)
    end if
    call omp_set_num_threads(threads)
    if (allocated(error)) return
    call check(error, all(abs(first%x - again%x) + abs(first%y - again%y) <= 0))
    if (allocated(error)) return
    call make(error, other, unit_range, unit_range, 0.05_wp, 'jittered', 0.3_wp, 12)
    if (allocated(error)) return
    call check(error, count(first%side == 0 .and. abs(first%x - other%x) <= 0), 0)
  end subroutine test_seed

  subroutine test_hexagonal(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: spacings(5) = [0.1_wp, 0.07_wp, 0.013_wp, 0.4_wp, 0.95_wp]
    real(wp), allocatable :: x(:), y(:)
    real(wp) :: area
    type(cloud_t) :: cloud
    integer :: k

    do k = 1, size(spacings)
      call make(error, cloud, unit_range, [0.0_wp, 1.3_wp], spacings(k), 'hexagonal')
      if (allocated(error)) return
      call check(error, nearest_distance(cloud) > 0.37_wp*spacings(k), &
                 'too near for spacing '//to_text(spacings(k)))
      if (allocated(error)) return
      x = pack(cloud%x, cloud%side == 0)
      y = pack(cloud%y, cloud%side == 0)
      call check(error, minval([x, 1 - x, y, 1.3_wp - y]) > 0.37_wp*spacings(k), 'near a wall')
      if (allocated(error)) return
    end do
    ! Volumes add up to the area and half a layer of cells beyond it
    call make(error, cloud, unit_range, [0.0_wp, 1.3_wp], 0.01_wp, 'hexagonal')
    if (allocated(error)) return
    area = sum(cloud%volume)
    call check(error, area > 1.3_wp .and. area < 1.01_wp*1.3_wp + 0.01_wp*2.5_wp, to_text(area))
    if (allocated(error)) return
    call check(error, cloud%volume(1), sqrt(0.75_wp)*1.0e-4_wp, thr=2.0e-6_wp)
  end subroutine test_hexagonal

  subroutine test_six_neighbours(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(neighbour_list_t) :: list
    integer :: k, number

    ! Eight columns fit without being stretched
    call make(error, cloud, [0.0_wp, 4*sqrt(3.0_wp)], [0.0_wp, 7.0_wp], 1.0_wp, 'hexagonal')
    if (allocated(error)) return
    call check(error, cloud%particles(), 5*8 + 4*9)
    if (allocated(error)) return
    call build_neighbour_list(cloud%x, cloud%y, 1.001_wp, list)
    do k = 1, cloud%particles()
      ! Away from the half steps at bottom and top
      if (cloud%side(k) /= 0 .or. cloud%y(k) < 1.1_wp .or. cloud%y(k) > 5.9_wp) cycle
      number = int(list%first(k + 1) - list%first(k))
      call check(error, number, 6, 'particle '//to_text(k))
      if (allocated(error)) return
    end do
  end subroutine test_six_neighbours

  subroutine test_refused(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: infinity, nan

    nan = ieee_value(1.0_wp, ieee_quiet_nan)
    infinity = ieee_value(1.0_wp, ieee_positive_inf)
    call refuse(error, [1.0_wp, 0.0_wp], 0.1_wp, 0.1_wp, 'x_range')
    if (allocated(error)) return
    call refuse(error, [1.0_wp, 1.0_wp], 0.1_wp, 0.1_wp, 'x_range')
    if (allocated(error)) return
    call refuse(error, [0.0_wp, nan], 0.1_wp, 0.1_wp, 'x_range')
    if (allocated(error)) return
    call refuse(error, [0.0_wp, infinity], 0.1_wp, 0.1_wp, 'x_range')
    if (allocated(error)) return
    call refuse(error, unit_range, 0.0_wp, 0.1_wp, 'spacing = 0 ')
    if (allocated(error)) return
    call refuse(error, unit_range, -0.1_wp, 0.1_wp, 'spacing = -0.1')
    if (allocated(error)) return
    call refuse(error, unit_range, nan, 0.1_wp, 'spacing')
    if (allocated(error)) return
    call refuse(error, unit_range, 1.1_wp, 0.1_wp, 'larger than the rectangle, which is 1 by 1')
    if (allocated(error)) return
    call refuse(error, [0.0_wp, 0.01_wp], 0.1_wp, 0.1_wp, 'which is 0.01 by 1')
    if (allocated(error)) return
    call refuse(error, unit_range, 2.0e-5_wp, 0.1_wp, 'particles that can be numbered')
    if (allocated(error)) return
    call refuse(error, unit_range, 1.0e-300_wp, 0.1_wp, 'particles that can be numbered')
    if (allocated(error)) return
    call refuse(error, unit_range, 0.1_wp, -0.1_wp, 'jitter = -0.1')
    if (allocated(error)) return
    call refuse(error, unit_range, 0.1_wp, 0.5_wp, 'jitter = 0.5')
    if (allocated(error)) return
    call refuse(error, unit_range, 0.1_wp, nan, 'jitter')
  end subroutine test_refused

  !> Check that a request is refused with a message that contains some words.
  subroutine refuse(error, x_range, spacing, jitter, words)
    type(error_type), allocatable, intent(out) :: error
    real(wp), intent(in) :: x_range(2), spacing, jitter
    character(len=*), intent(in) :: words
    type(cloud_t) :: cloud
    type(error_t), allocatable :: failure

    call make_rectangle(x_range, unit_range, spacing, 'jittered', jitter, 1, cloud, failure)
    call expect(error, failure, words)
  end subroutine refuse

  subroutine test_arrangement_names(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(error_t), allocatable :: failure

    call make_rectangle(unit_range, unit_range, 0.1_wp, 'hexagon', 0.0_wp, 1, cloud, failure)
    call expect(error, failure, 'Did you mean ''hexagonal''?')
  end subroutine test_arrangement_names

  subroutine test_check(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(error_t), allocatable :: failure
    integer(ip), allocatable :: order(:)
    integer :: k

    do k = 1, size(arrangement_choices)
      call make(error, cloud, unit_range, unit_range, 0.05_wp, trim(arrangement_choices(k)%name), &
                0.45_wp)
      if (allocated(error)) return
      call check_cloud(cloud, failure)
      call check(error, .not. allocated(failure), 'a good cloud is refused')
      if (allocated(error)) return
    end do

    ! Numbers are those of the user
    cloud%x(100) = cloud%x(50)
    cloud%y(100) = cloud%y(50)
    call hilbert_order(cloud%x, cloud%y, order)
    call cloud%reorder(order)
    call check_cloud(cloud, failure)
    call expect(error, failure, 'Particles 50 and 100 are at the same place, x = 0.')
    if (allocated(error)) return

    call make(error, cloud, unit_range, unit_range, 0.05_wp, 'lattice')
    if (allocated(error)) return
    cloud%x(2) = cloud%x(1)
    cloud%y(2) = cloud%y(1) + 1.0e-11_wp
    call check_cloud(cloud, failure)
    call expect(error, failure, 'Particles 1 and 2 are')
    if (allocated(error)) return
    cloud%y(2) = 1.0e-4_wp
    call check_cloud(cloud, failure)
    call check(error, .not. allocated(failure), 'near particles are refused')
    if (allocated(error)) return
    cloud%volume(7) = 0
    call check_cloud(cloud, failure)
    call expect(error, failure, 'Particle 7 at x = 0, y = 0.3')
    if (allocated(error)) return
    cloud%volume(7) = ieee_value(1.0_wp, ieee_quiet_nan)
    call check_cloud(cloud, failure)
    call expect(error, failure, 'Particle 7 at x')
    if (allocated(error)) return
    cloud%y(5) = ieee_value(1.0_wp, ieee_positive_inf)
    call check_cloud(cloud, failure)
    call expect(error, failure, 'Particle 5 has a coordinate')
    if (allocated(error)) return
    call cloud%reorder([integer(ip) ::])
    call check_cloud(cloud, failure)
    call expect(error, failure, 'no particles')
  end subroutine test_check

  subroutine test_reorder(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud, original
    integer(ip), allocatable :: order(:)

    call make(error, original, unit_range, unit_range, 0.1_wp, 'jittered', 0.3_wp)
    if (allocated(error)) return
    cloud = original
    call hilbert_order(cloud%x, cloud%y, order)
    call cloud%reorder(order)
    call hilbert_order(cloud%y, cloud%x, order)
    call cloud%reorder(order)
    call check(error, all(abs(cloud%x - original%x(cloud%user_index)) <= 0))
    if (allocated(error)) return
    call check(error, all(cloud%side == original%side(cloud%user_index)))
  end subroutine test_reorder

  subroutine test_volumes(error)
    type(error_type), allocatable, intent(out) :: error
    class(kernel_t), allocatable :: kernel
    type(error_t), allocatable :: failure
    type(cloud_t) :: cloud
    logical, allocatable :: inside(:)

    call make_kernel('wendland_c4', kernel, failure)
    call make(error, cloud, unit_range, unit_range, 0.05_wp, 'lattice')
    if (allocated(error)) return
    call volumes_from_kernel(cloud, kernel, 0.2_wp)
    inside = abs(cloud%x - 0.5_wp) < 0.3_wp .and. abs(cloud%y - 0.5_wp) < 0.3_wp
    call check(error, maxval(abs(cloud%volume - 0.0025_wp), inside) < 2.0e-6_wp, 'inside')
    if (allocated(error)) return
    ! Sums over half and quarter of a lattice, computed apart
    call check(error, cloud%volume(11)/0.0025_wp, 1.4034815244526369_wp, thr=1.0e-12_wp)
    if (allocated(error)) return
    call check(error, cloud%volume(1)/0.0025_wp, 1.9717168155915068_wp, thr=1.0e-12_wp)
    if (allocated(error)) return
    ! A particle without neighbours has its kernel's own volume
    call make(error, cloud, unit_range, unit_range, 0.5_wp, 'lattice')
    if (allocated(error)) return
    call volumes_from_kernel(cloud, kernel, 0.3_wp)
    call check(error, all(abs(cloud%volume*kernel%value(0.0_wp, 0.3_wp) - 1) < 1.0e-14_wp))
  end subroutine test_volumes

  subroutine make(error, cloud, x_range, y_range, spacing, arrangement, jitter, seed)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t), intent(out) :: cloud
    real(wp), intent(in) :: x_range(2), y_range(2), spacing
    character(len=*), intent(in) :: arrangement
    real(wp), intent(in), optional :: jitter
    integer, intent(in), optional :: seed
    type(error_t), allocatable :: failure
    real(wp) :: jitter_used
    integer :: seed_used

    jitter_used = 0.2_wp
    if (present(jitter)) jitter_used = jitter
    seed_used = 1
    if (present(seed)) seed_used = seed
    call make_rectangle(x_range, y_range, spacing, arrangement, jitter_used, seed_used, cloud, &
                        failure)
    if (allocated(failure)) call test_failed(error, failure%message)
  end subroutine make

  !> Check that something failed for what the user gave, with a message that contains some words.
  subroutine expect(error, failure, words)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable, intent(in) :: failure
    character(len=*), intent(in) :: words

    call check(error, allocated(failure), 'not refused: '//words)
    if (allocated(error)) return
    call check(error, failure%status, status_bad_input)
    if (allocated(error)) return
    call check(error, index(failure%message, words) > 0, &
               'expected "'//words//'" in: '//failure%message)
  end subroutine expect

  !> The smallest distance of two particles.
  function nearest_distance(cloud) result(distance)
    type(cloud_t), intent(in) :: cloud
    real(wp) :: distance
    type(neighbour_list_t) :: list
    integer :: i, k

    call build_neighbour_list(cloud%x, cloud%y, 2*cloud%spacing, list)
    distance = huge(distance)
    do i = 1, list%rows()
      do k = int(list%first(i)), int(list%first(i + 1)) - 1
        associate (j => list%index(k))
          distance = min(distance, hypot(cloud%x(i) - cloud%x(j), cloud%y(i) - cloud%y(j)))
        end associate
      end do
    end do
  end function nearest_distance

end module test_clouds
