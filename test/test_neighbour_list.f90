!> Tests of neighbour lists, coincident particles and the space-filling curve.
module test_neighbour_list
  use, intrinsic :: iso_fortran_env, only: int64
  use calor_cell_list, only: cell_list_t, build_cell_list
  use calor_coincident, only: find_coincident
  use calor_kinds, only: wp, ip, i8
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_space_filling_curve, only: hilbert_order
  use calor_text, only: to_text
  use omp_lib, only: omp_get_max_threads, omp_set_num_threads
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_neighbour_list

contains

  subroutine collect_neighbour_list(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('random cloud against brute force', test_random), &
                new_unittest('clustered cloud against brute force', test_clustered), &
                new_unittest('lattice: borders of cells and distance exactly h', test_lattice), &
                new_unittest('no particle and one particle', test_none_and_one), &
                new_unittest('all in one cell', test_one_cell), &
                new_unittest('all at the same place', test_same_place), &
                new_unittest('coincident pairs among others', test_coincident_pairs), &
                new_unittest('thin domains', test_thin), &
                new_unittest('tiny, huge and far-off domains', test_scales), &
                new_unittest('an outlier far away', test_outlier), &
                new_unittest('a sparse diagonal', test_diagonal), &
                new_unittest('one radius for each particle', test_radii), &
                new_unittest('radii over many octaves', test_octaves), &
                new_unittest('radii of zero and less', test_no_radius), &
                new_unittest('rows for some particles only', test_targets), &
                new_unittest('symmetric for one radius', test_symmetric), &
                new_unittest('same for 1 and 2 threads', test_threads), &
                new_unittest('more rows than a chunk', test_chunks), &
                new_unittest('work and memory grow linearly', test_growth), &
                new_unittest('coincident particles are found', test_find_coincident), &
                new_unittest('nearly coincident particles are found', test_find_near), &
                new_unittest('Hilbert order is a permutation and local', test_hilbert), &
                new_unittest('Hilbert order of 4×4 squares', test_hilbert_known), &
                new_unittest('Hilbert order keeps equal places in order', test_hilbert_stable) &
                ]
  end subroutine collect_neighbour_list

  subroutine test_random(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: x(700), y(700)
    integer :: k

    call random_points(1, x, y)
    do k = 1, 8
      call compare(error, x, y, 0.5_wp**k)
      if (allocated(error)) return
    end do
    call compare(error, x, y, 3.0_wp)
    if (allocated(error)) return
    call compare(error, x, y, 1.0e-9_wp)
  end subroutine test_random

  subroutine test_clustered(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: x(900), y(900)
    integer :: k

    ! Nine clusters, each a tenth as wide as the one before
    call random_points(2, x, y)
    do k = 1, 9
      x(100*k - 99:100*k) = 0.1_wp**k*x(100*k - 99:100*k) + mod(k, 3)
      y(100*k - 99:100*k) = 0.1_wp**k*y(100*k - 99:100*k) + k/3
    end do
    do k = 0, 9
      call compare(error, x, y, 0.3_wp*0.1_wp**k)
      if (allocated(error)) return
    end do
  end subroutine test_clustered

  subroutine test_lattice(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: spacing = 0.0625_wp
    type(neighbour_list_t) :: list
    real(wp) :: x(17*17), y(17*17)
    integer :: i, j

    ! Sixteenths are exact, and so are all distances along the axes
    do i = 0, 16
      do j = 0, 16
        x(17*i + j + 1) = i*spacing
        y(17*i + j + 1) = j*spacing - 4
      end do
    end do
    do i = 1, 6
      call compare(error, x, y, i*spacing)
      if (allocated(error)) return
      call compare(error, x, y, nearest(i*spacing, 1.0_wp))
      if (allocated(error)) return
    end do
    ! Exactly at the radius is outside; the next larger number lets four neighbours in
    call build_neighbour_list(x, y, spacing, list)
    call check(error, size(list%index), 0)
    if (allocated(error)) return
    call build_neighbour_list(x, y, nearest(spacing, 1.0_wp), list)
    call check(error, size(list%index), 2*2*16*17)
    if (allocated(error)) return
    ! 3-4-5: a distance of exactly five spacings off the axes
    call build_neighbour_list(x, y, 5*spacing, list, targets=[17*8_ip + 9])
    call check(error, size(list%index), 68)
    if (allocated(error)) return
    call build_neighbour_list(x, y, nearest(5*spacing, 1.0_wp), list, targets=[17*8_ip + 9])
    call check(error, size(list%index), 80)
  end subroutine test_lattice

  subroutine test_none_and_one(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: none(0)
    integer(ip) :: nobody(0)
    type(neighbour_list_t) :: list

    call build_neighbour_list(none, none, 1.0_wp, list)
    call check(error, list%rows() == 0 .and. size(list%index) == 0 .and. size(list%first) == 1)
    if (allocated(error)) return
    call build_neighbour_list(none, none, none, list)
    call check(error, list%rows() == 0 .and. size(list%index) == 0)
    if (allocated(error)) return
    call build_neighbour_list([0.3_wp], [-7.0_wp], 1.0_wp, list)
    call check(error, list%rows() == 1 .and. size(list%index) == 0)
    if (allocated(error)) return
    call check(error, list%longest_row(), 0)
    if (allocated(error)) return
    call build_neighbour_list([0.3_wp, 0.4_wp], [0.0_wp, 0.0_wp], 1.0_wp, list, targets=nobody)
    call check(error, list%rows() == 0 .and. size(list%index) == 0)
  end subroutine test_none_and_one

  subroutine test_one_cell(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: x(300), y(300)

    call random_points(3, x, y)
    call compare(error, x, y, 100.0_wp)
    if (allocated(error)) return
    call compare(error, x, y, 1.0e200_wp)
  end subroutine test_one_cell

  subroutine test_same_place(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: x(50), y(50)

    x = 0.1_wp
    y = -0.7_wp
    call compare(error, x, y, 0.3_wp)
    if (allocated(error)) return
    call compare(error, x, y, 1.0e-100_wp)
  end subroutine test_same_place

  subroutine test_coincident_pairs(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: x(400), y(400)

    call random_points(4, x, y)
    x(201:) = x(:200)
    y(201:) = y(:200)
    call compare(error, x, y, 0.1_wp)
    if (allocated(error)) return
    call compare(error, x, y, 1.0e-12_wp)
  end subroutine test_coincident_pairs

  subroutine test_thin(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: x(500), y(500)
    integer :: k

    call random_points(5, x, y)
    do k = 1, 4
      call compare(error, x, 1.0e-6_wp*y, 0.1_wp**k)
      if (allocated(error)) return
      call compare(error, 1.0e-6_wp*x, y, 0.1_wp**k)
      if (allocated(error)) return
    end do
    call compare(error, x, 0*y, 0.01_wp)
    if (allocated(error)) return
    call compare(error, 1.0e-6_wp*x, y, 1.0e-7_wp)
  end subroutine test_thin

  subroutine test_scales(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: x(400), y(400)

    call random_points(6, x, y)
    call compare(error, 1.0e-9_wp*x, 1.0e-9_wp*y, 1.0e-10_wp)
    if (allocated(error)) return
    call compare(error, 1.0e9_wp*x, 1.0e9_wp*y, 1.0e8_wp)
    if (allocated(error)) return
    call compare(error, x + 1.0e6_wp, y - 1.0e6_wp, 0.1_wp)
    if (allocated(error)) return
    ! Only some hundred different coordinates are left here
    call compare(error, x + 1.0e14_wp, y + 1.0e14_wp, 0.1_wp)
    if (allocated(error)) return
    call compare(error, x, y + 1.0e13_wp, 0.25_wp)
  end subroutine test_scales

  subroutine test_outlier(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: x(600), y(600)

    call random_points(7, x, y)
    x(17) = 1.0e9_wp
    y(17) = -3.0e8_wp
    call compare(error, x, y, 0.1_wp)
    if (allocated(error)) return
    x(18) = -1.0e30_wp
    call compare(error, x, y, 0.1_wp)
  end subroutine test_outlier

  subroutine test_diagonal(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: x(800), y(800)

    ! Far more cells than particles: cells share buckets
    call random_points(8, x, y)
    call compare(error, 1.0e4_wp*x, 1.0e4_wp*x + y, 30.0_wp)
    if (allocated(error)) return
    call compare(error, x, y, 0.004_wp)
    if (allocated(error)) return
    call compare(error, 1.0e12_wp*x, 1.0e12_wp*y, 1.0e12_wp)
  end subroutine test_diagonal

  subroutine test_radii(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: x(600), y(600), radius(600), unused(600)

    call random_points(9, x, y)
    call random_points(10, radius, unused)
    call compare_radii(error, x, y, 0.05_wp + 0.1_wp*radius)
    if (allocated(error)) return
    ! Just about a power of two
    call compare_radii(error, x, y, 0.0625_wp*(0.9_wp + 0.2_wp*radius))
    if (allocated(error)) return
    radius = 0.0625_wp
    radius(::50) = 0.4_wp
    call compare_radii(error, x, y, radius)
  end subroutine test_radii

  subroutine test_octaves(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: x(600), y(600), radius(600), unused(600)

    call random_points(11, x, y)
    call random_points(12, radius, unused)
    call compare_radii(error, x, y, 10**(4*radius - 4))
    if (allocated(error)) return
    call compare_radii(error, x**6, y**6, 2*x**6 + 0.01_wp)
    if (allocated(error)) return
    radius(1) = 1.0e-300_wp
    radius(2) = 1.0e300_wp
    call compare_radii(error, x, y, radius)
  end subroutine test_octaves

  subroutine test_no_radius(error)
    type(error_type), allocatable, intent(out) :: error
    type(neighbour_list_t) :: list
    real(wp) :: x(100), y(100), radius(100)

    call random_points(13, x, y)
    call build_neighbour_list(x, y, 0.0_wp, list)
    call check(error, list%rows() == 100 .and. size(list%index) == 0 .and. all(list%first == 1))
    if (allocated(error)) return
    call build_neighbour_list(x, y, -1.0_wp, list)
    call check(error, size(list%index), 0)
    if (allocated(error)) return
    radius = -1
    call build_neighbour_list(x, y, radius, list)
    call check(error, size(list%index), 0)
    if (allocated(error)) return
    radius(::3) = 0.2_wp
    radius(2::3) = 0
    call build_neighbour_list(x, y, radius, list)
    call check(error, all(list%first(3::3) == list%first(2:99:3)))
    if (allocated(error)) return
    call check(error, list%longest_row() > 1)
  end subroutine test_no_radius

  subroutine test_targets(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: x(500), y(500), radius(500)
    integer(ip), allocatable :: targets(:)
    type(neighbour_list_t) :: all_rows, list
    integer :: row

    call random_points(14, x, y)
    radius = 0.05_wp + 0.1_wp*x
    ! Any order, and one of them twice
    targets = [integer(ip) :: 400, 3, 77, 500, 1, 3]
    call build_neighbour_list(x, y, 0.1_wp, all_rows)
    call build_neighbour_list(x, y, 0.1_wp, list, targets)
    call check(error, all(list%target == targets))
    if (allocated(error)) return
    do row = 1, size(targets)
      call same_row(error, list, row, all_rows, int(targets(row)))
      if (allocated(error)) return
    end do
    call build_neighbour_list(x, y, radius, all_rows)
    call build_neighbour_list(x, y, radius(targets), list, targets)
    do row = 1, size(targets)
      call same_row(error, list, row, all_rows, int(targets(row)))
      if (allocated(error)) return
    end do
    ! As many targets as particles, but in another order
    targets = [(int(501 - row, ip), row=1, 500)]
    call build_neighbour_list(x, y, radius(targets), list, targets)
    do row = 1, size(targets)
      call same_row(error, list, row, all_rows, int(targets(row)))
      if (allocated(error)) return
    end do
  end subroutine test_targets

  subroutine test_symmetric(error)
    type(error_type), allocatable, intent(out) :: error
    type(neighbour_list_t) :: list
    real(wp) :: x(5000), y(5000)
    integer :: i, k

    call random_points(15, x, y)
    call build_neighbour_list(x, y, 0.04_wp, list)
    do i = 1, list%rows()
      do k = int(list%first(i)), int(list%first(i + 1)) - 1
        associate (j => list%index(k))
          if (.not. any(list%index(list%first(j):list%first(j + 1) - 1) == i)) then
            call test_failed(error, 'Particle '//to_text(i)//' has a neighbour but not the reverse')
            return
          end if
        end associate
      end do
    end do
  end subroutine test_symmetric

  subroutine test_threads(error)
    type(error_type), allocatable, intent(out) :: error
    type(neighbour_list_t) :: one, two
    real(wp), allocatable :: x(:), y(:)
    integer(ip), allocatable :: order_one(:), order_two(:)
    integer :: threads

    allocate (x(30000), y(30000))
    call random_points(16, x, y)
    threads = omp_get_max_threads()
    call omp_set_num_threads(1)
    call build_neighbour_list(x, y, 0.012_wp + 0.01_wp*x, one)
    call hilbert_order(x, y, order_one)
    call omp_set_num_threads(2)
    call build_neighbour_list(x, y, 0.012_wp + 0.01_wp*x, two)
    call hilbert_order(x, y, order_two)
    call omp_set_num_threads(threads)
    call check(error, all(one%first == two%first), 'rows begin elsewhere with 2 threads')
    if (allocated(error)) return
    call check(error, all(one%index == two%index), 'neighbours differ with 2 threads')
    if (allocated(error)) return
    call check(error, all(order_one == order_two), 'order differs with 2 threads')
  end subroutine test_threads

  subroutine test_chunks(error)
    type(error_type), allocatable, intent(out) :: error
    type(neighbour_list_t) :: list, some
    real(wp), allocatable :: x(:), y(:)
    integer(ip), allocatable :: targets(:)
    integer :: k

    ! All in one cell, whose rows go to several chunks; compared for a few
    allocate (x(9000), y(9000))
    call random_points(17, x, y)
    targets = [(int(k, ip), k=1, 9000)]
    call build_neighbour_list(1.0e-3_wp*x, 1.0e-3_wp*y, [(1.0e-4_wp, k=1, 8999), 10.0_wp], list)
    call check(error, int(list%first(9001) - list%first(9000)), 8999)
    if (allocated(error)) return
    targets = targets(::1000)
    call build_neighbour_list(1.0e-3_wp*x, 1.0e-3_wp*y, 1.0e-4_wp, some, targets)
    do k = 1, size(targets)
      call same_row(error, some, k, list, int(targets(k)))
      if (allocated(error)) return
    end do
  end subroutine test_chunks

  subroutine test_growth(error)
    type(error_type), allocatable, intent(out) :: error
    type(cell_list_t) :: cells
    real(wp), allocatable :: x(:), y(:)
    integer(i8) :: pairs
    integer :: bucket, k, kind, particles

    ! Buckets and, for a radius that gives each particle a few neighbours, pairs of particles in
    ! one bucket are bounded by a fixed multiple of N for every kind of cloud
    do kind = 1, 5
      do k = 8, 14, 2
        particles = 2**k
        allocate (x(particles), y(particles))
        call random_points(18, x, y)
        select case (kind)
        case (1)
          ! A square
          call build_cell_list(x, y, 1.5_wp/sqrt(real(particles, wp)), cells)
        case (2)
          ! A thin strip
          call build_cell_list(x, 1.0e-7_wp*y, 1.5_wp/particles, cells)
        case (3)
          ! A diagonal line
          call build_cell_list(x, x, 1.5_wp/particles, cells)
        case (4)
          ! A square with an outlier far away
          x(1) = 1.0e8_wp
          call build_cell_list(x, y, 1.5_wp/sqrt(real(particles, wp)), cells)
        case default
          ! Two small clusters far apart
          x(::2) = x(::2) + 1.0e6_wp
          y(::2) = y(::2) + 1.0e6_wp
          call build_cell_list(x, y, 1.5_wp/sqrt(real(particles, wp)), cells)
        end select
        call check(error, cells%buckets <= 2*particles + 64, 'too many buckets')
        if (allocated(error)) return
        pairs = 0
        do bucket = 1, cells%buckets
          pairs = pairs + int(cells%first(bucket + 1) - cells%first(bucket), int64)**2
        end do
        call check(error, pairs <= 8_i8*particles, 'too many particles in one bucket: kind '// &
                   to_text(kind)//', particles '//to_text(particles)//', pairs '//to_text(pairs))
        if (allocated(error)) return
        deallocate (x, y)
      end do
    end do
  end subroutine test_growth

  subroutine test_find_coincident(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), allocatable :: x(:), y(:)
    integer(ip) :: first, second

    allocate (x(2000), y(2000))
    call random_points(19, x, y)
    call find_coincident(x, y, first, second)
    call check(error, first == 0 .and. second == 0, 'found a pair where there is none')
    if (allocated(error)) return
    x(1500) = x(40)
    y(1500) = y(40)
    x(1400) = x(40)
    y(1400) = y(40)
    x(300) = x(41)
    y(300) = y(41)
    x(60) = x(39)
    call find_coincident(x, y, first, second)
    call check(error, first == 40 .and. second == 1400, 'not the first pair')
    if (allocated(error)) return
    x(1) = 1.0e12_wp
    call find_coincident(x, y, first, second)
    call check(error, first == 40 .and. second == 1400, 'not the first pair beside an outlier')
    if (allocated(error)) return
    x = 7
    y = 7
    call find_coincident(x, y, first, second)
    call check(error, first == 1 .and. second == 2, 'all at one place')
    if (allocated(error)) return
    call find_coincident(x(:1), y(:1), first, second)
    call check(error, first == 0 .and. second == 0, 'one particle alone')
    if (allocated(error)) return
    call find_coincident(x(:0), y(:0), first, second)
    call check(error, first == 0 .and. second == 0, 'no particle')
  end subroutine test_find_coincident

  subroutine test_find_near(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), allocatable :: x(:), y(:)
    integer(ip) :: first, second

    allocate (x(400), y(400))
    call random_points(20, x, y)
    call lattice_points(20, x, y)
    x(200) = x(7) + 0.25_wp
    y(200) = y(7)
    call find_coincident(x, y, first, second, tolerance=0.125_wp)
    call check(error, first == 0 .and. second == 0, 'found a pair beyond the tolerance')
    if (allocated(error)) return
    call find_coincident(x, y, first, second, tolerance=0.25_wp)
    call check(error, first == 7 .and. second == 200, 'at exactly the tolerance')
  end subroutine test_find_near

  subroutine test_hilbert(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), allocatable :: x(:), y(:)
    integer(ip), allocatable :: order(:)
    logical, allocatable :: met(:)
    real(wp) :: mean_step
    integer :: k

    allocate (x(10000), y(10000), met(10000))
    call random_points(21, x, y)
    call hilbert_order(x, y, order)
    met = .false.
    met(order) = .true.
    call check(error, size(order) == 10000 .and. all(met), 'not a permutation')
    if (allocated(error)) return
    mean_step = sum(hypot(x(order(2:)) - x(order(:9999)), y(order(2:)) - y(order(:9999))))/9999
    ! The mean distance of two particles of the cloud is 0.01
    call check(error, mean_step < 0.012_wp, 'mean step '//to_text(mean_step))
    if (allocated(error)) return

    ! On a lattice of 2^k squares the curve never leaves a square but for one beside it
    deallocate (x, y)
    allocate (x(1024), y(1024))
    call lattice_points(32, x, y)
    call hilbert_order(x, y, order)
    do k = 2, 1024
      call check(error, hypot(x(order(k)) - x(order(k - 1)), y(order(k)) - y(order(k - 1))), &
                 1.0_wp, thr=1.0e-12_wp)
      if (allocated(error)) return
    end do

    call hilbert_order(x(:1), y(:1), order)
    call check(error, size(order) == 1 .and. all(order == 1))
    if (allocated(error)) return
    call hilbert_order(x(:0), y(:0), order)
    call check(error, size(order), 0)
  end subroutine test_hilbert

  subroutine test_hilbert_known(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: x(16), y(16)
    integer(ip), allocatable :: order(:)

    ! Squares are numbered upwards, then to the right
    call lattice_points(4, x, y)
    call hilbert_order(x, y, order)
    call check(error, all(order == [integer(ip) :: &
                                    1, 5, 6, 2, 3, 4, 8, 7, 11, 12, 16, 15, 14, 10, 9, 13]))
  end subroutine test_hilbert_known

  subroutine test_hilbert_stable(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: x(60), y(60)
    integer(ip), allocatable :: order(:)
    integer :: k

    x(::2) = 0
    x(2::2) = 1
    y = 0
    call hilbert_order(x, y, order)
    call check(error, all(order == [(int(2*k - 1, ip), k=1, 30), (int(2*k, ip), k=1, 30)]))
    if (allocated(error)) return
    x = 3
    call hilbert_order(x, y, order)
    call check(error, all(order == [(int(k, ip), k=1, 60)]))
  end subroutine test_hilbert_stable

  !> Compare with the test of each pair, for one radius.
  subroutine compare(error, x, y, radius)
    type(error_type), allocatable, intent(out) :: error
    real(wp), intent(in) :: x(:), y(:), radius
    type(neighbour_list_t) :: list
    real(wp) :: radii(size(x))

    radii = radius
    call build_neighbour_list(x, y, radius, list)
    call compare_list(error, x, y, radii, list)
  end subroutine compare

  !> Compare with the test of each pair, for one radius per particle.
  subroutine compare_radii(error, x, y, radius)
    type(error_type), allocatable, intent(out) :: error
    real(wp), intent(in) :: x(:), y(:), radius(:)
    type(neighbour_list_t) :: list

    call build_neighbour_list(x, y, radius, list)
    call compare_list(error, x, y, radius, list)
  end subroutine compare_radii

  subroutine compare_list(error, x, y, radius, list)
    type(error_type), allocatable, intent(out) :: error
    real(wp), intent(in) :: x(:), y(:), radius(:)
    type(neighbour_list_t), intent(in) :: list
    integer(ip) :: expected(size(x))
    real(wp) :: reach
    integer :: found, i, j

    call check(error, list%rows(), size(x))
    if (allocated(error)) return
    call check(error, int(list%first(1)), 1)
    if (allocated(error)) return
    do i = 1, size(x)
      reach = min(radius(i), 1.0e150_wp)
      found = 0
      do j = 1, size(x)
        if (j == i) cycle
        if (.not. (x(i) - x(j))**2 + (y(i) - y(j))**2 < reach**2) cycle
        found = found + 1
        expected(found) = int(j, ip)
      end do
      associate (row => list%index(list%first(i):list%first(i + 1) - 1))
        call check(error, size(row), found, &
                   'particle '//to_text(i)//', radius '//to_text(radius(i)))
        if (allocated(error)) return
        call check(error, all(row == expected(:found)), 'other neighbours of '//to_text(i))
        if (allocated(error)) return
      end associate
    end do
    call check(error, size(list%index) == list%first(size(x) + 1) - 1, 'wrong size')
  end subroutine compare_list

  subroutine same_row(error, a, row_a, b, row_b)
    type(error_type), allocatable, intent(out) :: error
    type(neighbour_list_t), intent(in) :: a, b
    integer, intent(in) :: row_a, row_b

    associate (first => a%index(a%first(row_a):a%first(row_a + 1) - 1), &
               second => b%index(b%first(row_b):b%first(row_b + 1) - 1))
      call check(error, size(first), size(second))
      if (allocated(error)) return
      call check(error, all(first == second), 'rows '//to_text(row_a)//' and '//to_text(row_b))
    end associate
  end subroutine same_row

  !> Points of the unit square, the same on every machine.
  pure subroutine random_points(seed, x, y)
    integer, intent(in) :: seed
    real(wp), intent(out) :: x(:), y(:)
    integer(i8) :: state
    integer :: k

    state = 7919_i8*seed
    do k = 1, size(x)
      call advance(state)
      x(k) = real(state, wp)/2147483647
      call advance(state)
      y(k) = real(state, wp)/2147483647
    end do

  contains

    pure subroutine advance(state)
      integer(i8), intent(inout) :: state

      state = mod(48271_i8*state, 2147483647_i8)
    end subroutine advance

  end subroutine random_points

  !> Points of a square lattice of spacing 1, column by column.
  pure subroutine lattice_points(side, x, y)
    integer, intent(in) :: side
    real(wp), intent(out) :: x(:), y(:)
    integer :: i, j

    do i = 1, side
      do j = 1, side
        x(side*(i - 1) + j) = i
        y(side*(i - 1) + j) = j
      end do
    end do
  end subroutine lattice_points

end module test_neighbour_list
