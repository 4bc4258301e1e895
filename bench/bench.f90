!> Measures what set-up and steps take, one measurement for each line read from standard input, so
!> that a script can take measurements of other programs in between: `bench/bench.py`.
!>
!> `bench INTERVALS` makes a jittered unit square of so many intervals a side. Then:
!>
!>     write FILE               coordinates of all particles as raw numbers: x …, y …
!>     random N NEIGHBOURS      lists of so many random points: seconds, mean number of neighbours
!>     plain N NEIGHBOURS       the same by a plain cell list, each row in the order of the cells
!>     ordered N NEIGHBOURS, plain_ordered N NEIGHBOURS   the same two, the points in Hilbert's order
!>     lists SUPPORT            lists of all particles: seconds, mean number of neighbours
!>     weights SCHEME ORDER SUPPORT   one assembly: seconds, mean number of neighbours
!>     rows SCHEME ORDER SUPPORT      stable rows, lists and repairs included: the same; they are
!>                              what the following work with
!>     matrix FILE              these rows as raw numbers
!>     mkl LIBRARY              hand them to MKL; 1 if it is there
!>     single | double          have steps take weights in that precision from now on
!>     triad | rate | stage | forced | csr | product    seconds of one of each; bytes that it moves
!>     five_point N             the plate to t = 0.05 on a lattice of N intervals a side, by forward
!>                              Euler steps in a plain loop: seconds, relative L2 error
!>     memory                   bytes of the process in memory now and at most
program bench
  use calor_cloud, only: cloud_t
  use calor_conduction, only: conduction_t
  use calor_error, only: error_t
  use calor_huge_pages, only: prefer_huge_pages
  use calor_kernel, only: kernel_t
  use calor_kernels, only: make_kernel
  use calor_kinds, only: wp, ip, i8
  use calor_laplacian_scheme, only: laplacian_scheme_t
  use calor_laplacian_schemes, only: make_laplacian_scheme
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_random, only: random_uniform
  use calor_rectangle_cloud, only: make_rectangle
  use calor_row_report, only: row_report_t
  use calor_space_filling_curve, only: hilbert_order
  use calor_sparse_operator, only: sparse_operator_t
  use calor_stable_rows, only: assemble_stable_rows, row_repairs_t
  use mkl_product, only: mkl_matrix_t
  use omp_lib, only: omp_get_wtime
  use plain_list, only: build_plain_list
  implicit none (type, external)

  real(wp), parameter :: pi = acos(-1.0_wp)
  !> So many times is a short measurement repeated within one
  integer, parameter :: repeats = 5
  !> Bytes for each particle that set-up takes at most, about
  integer, parameter :: bytes_of_set_up = 700

  type(cloud_t) :: cloud
  type(conduction_t) :: conduction
  type(mkl_matrix_t) :: mkl
  class(kernel_t), allocatable :: kernel
  type(error_t), allocatable :: error
  integer(ip), allocatable :: inside(:)
  real(wp), allocatable :: newer(:), older(:), start(:), rate(:), work(:), space(:), a(:), b(:), c(:)
  character(len=1024) :: line
  character(len=64) :: command
  integer :: intervals, status

  call get_command_argument(1, line)
  read (line, *) intervals
  call make_cloud()
  if (allocated(error)) error stop 'bench: no such cloud'
  call make_kernel('wendland_c2', kernel, error)
  write (*, '(i0)') cloud%particles()
  flush (unit=6)
  do
    read (*, '(a)', iostat=status) line
    if (status /= 0) exit
    read (line, *) command
    select case (command)
    case ('write')
      call write_cloud(argument(line))
    case ('random', 'plain', 'ordered', 'plain_ordered')
      call time_random()
    case ('lists')
      call time_lists()
    case ('weights')
      call time_weights()
    case ('rows')
      call time_rows()
    case ('matrix')
      call write_matrix(argument(line))
    case ('mkl')
      call mkl%prepare(argument(line), conduction%laplacian, cloud%particles())
      write (*, '(i0)') merge(1, 0, mkl%ready)
    case ('five_point')
      call time_five_point()
    case ('single', 'double')
      conduction%single_weights = command == 'single'
      call conduction%stream_rows()
      write (*, '(a)') '1'
    case ('memory')
      call tell_memory()
    case default
      call time_sweep(trim(command))
    end select
    flush (unit=6)
  end do

contains

  !> What follows the first word of a line
  function argument(line) result(text)
    character(len=*), intent(in) :: line
    character(len=:), allocatable :: text

    text = trim(adjustl(line(index(line, ' ') + 1:)))
  end function argument

  !> The cloud of data/plate.nml, as fine as asked for.
  subroutine make_cloud()
    integer(ip), allocatable :: order(:)
    integer :: k

    call make_rectangle([0.0_wp, 1.0_wp], [0.0_wp, 1.0_wp], 1.0_wp/intervals, 'jittered', 0.2_wp, &
                        1, cloud, error)
    if (allocated(error)) return
    call hilbert_order(cloud%x, cloud%y, order)
    call cloud%reorder(order)
    inside = pack([(int(k, ip), k=1, cloud%particles())], cloud%side == 0)
    allocate (newer(cloud%particles()), older(cloud%particles()), start(cloud%particles()), &
              rate(cloud%particles()), work(cloud%particles()))
    call prefer_huge_pages(newer)
    call prefer_huge_pages(older)
    call prefer_huge_pages(start)
    call prefer_huge_pages(rate)
    !$omp parallel do schedule(static)
    do k = 1, cloud%particles()
      newer(k) = sin(3*cloud%x(k))
      older(k) = newer(k)
      start(k) = newer(k)
      rate(k) = newer(k)
      work(k) = 0
    end do
    !$omp end parallel do
  end subroutine make_cloud

  !> Take and give back as much memory as will be measured with: where this is a virtual machine, its
  !> host takes back what was free for some seconds, and hands it out again more slowly than it is
  !> filled.
  subroutine touch_memory(particles)
    integer, intent(in) :: particles
    real(wp), allocatable :: memory(:)
    integer(i8) :: k

    allocate (memory(int(particles, i8)*bytes_of_set_up/8))
    call prefer_huge_pages(memory)
    !$omp parallel do schedule(static)
    do k = 1, size(memory, kind=i8), 512
      memory(k) = k
    end do
    !$omp end parallel do
    ! Used, so that nothing is left out
    if (memory(1) < 0) error stop 'bench: no memory'
  end subroutine touch_memory

  subroutine write_cloud(path)
    character(len=*), intent(in) :: path
    integer :: unit

    open (newunit=unit, file=path, access='stream', form='unformatted', status='replace')
    write (unit) cloud%x, cloud%y
    close (unit)
    write (*, '(a)') 'written'
  end subroutine write_cloud

  !> Rows, entries, where rows begin, indices, weights, diagonal and targets
  subroutine write_matrix(path)
    character(len=*), intent(in) :: path
    integer :: unit

    open (newunit=unit, file=path, access='stream', form='unformatted', status='replace')
    associate (rows => conduction%laplacian)
      write (unit) int(rows%rows(), i8), size(rows%index, kind=i8), rows%first, rows%index, &
        rows%weight, rows%diagonal, rows%target
    end associate
    close (unit)
    write (*, '(a)') 'written'
  end subroutine write_matrix

  subroutine time_random()
    real(wp), allocatable :: x(:), y(:)
    integer(ip), allocatable :: order(:)
    type(neighbour_list_t) :: list
    real(wp) :: neighbours, began
    integer :: n, k

    read (line, *) command, n, neighbours
    allocate (x(n), y(n))
    do k = 1, n
      x(k) = random_uniform(7, 2_i8*k)
      y(k) = random_uniform(7, 2_i8*k + 1)
    end do
    if (index(command, 'ordered') > 0) then
      allocate (order(n))
      call hilbert_order(x, y, order)
      x = x(order)
      y = y(order)
    end if
    call touch_memory(n)
    began = omp_get_wtime()
    if (index(command, 'plain') == 1) then
      call build_plain_list(x, y, sqrt(neighbours/(pi*n)), list)
    else
      call build_neighbour_list(x, y, sqrt(neighbours/(pi*n)), list)
    end if
    call tell(omp_get_wtime() - began, real(size(list%index, kind=i8), wp)/n)
  end subroutine time_random

  subroutine time_lists()
    type(neighbour_list_t) :: list
    real(wp) :: support, began

    read (line, *) command, support
    call touch_memory(cloud%particles())
    began = omp_get_wtime()
    call build_neighbour_list(cloud%x, cloud%y, support/intervals, list)
    call tell(omp_get_wtime() - began, real(size(list%index, kind=i8), wp)/cloud%particles())
  end subroutine time_lists

  subroutine read_scheme(scheme, radius)
    class(laplacian_scheme_t), allocatable, intent(out) :: scheme
    real(wp), allocatable, intent(out) :: radius(:)
    character(len=64) :: name
    real(wp) :: support
    integer :: order

    read (line, *) command, name, order, support
    call make_laplacian_scheme(trim(name), scheme, error, order)
    if (allocated(error)) error stop 'bench: no such scheme'
    allocate (radius(cloud%particles()), source=support/intervals)
  end subroutine read_scheme

  subroutine time_weights()
    class(laplacian_scheme_t), allocatable :: scheme
    type(neighbour_list_t) :: list
    type(sparse_operator_t) :: laplacian
    type(row_report_t) :: report
    real(wp), allocatable :: radius(:)
    real(wp) :: began

    call read_scheme(scheme, radius)
    call build_neighbour_list(cloud%x, cloud%y, radius(inside), list, inside)
    call touch_memory(cloud%particles())
    began = omp_get_wtime()
    call scheme%assemble(kernel, cloud%x, cloud%y, cloud%volume, radius, list, laplacian, report)
    call tell(omp_get_wtime() - began, real(size(list%index, kind=i8), wp)/size(inside))
  end subroutine time_weights

  subroutine time_rows()
    class(laplacian_scheme_t), allocatable :: scheme
    type(row_report_t) :: report
    type(row_repairs_t) :: repairs
    real(wp), allocatable :: radius(:)
    real(wp) :: began, ended

    call read_scheme(scheme, radius)
    call touch_memory(cloud%particles())
    began = omp_get_wtime()
    call assemble_stable_rows(scheme, kernel, cloud%x, cloud%y, cloud%volume, radius, inside, &
                              conduction%laplacian, report, repairs)
    ended = omp_get_wtime()
    conduction%medium%x = cloud%x
    if (.not. allocated(conduction%prescribed)) allocate (conduction%prescribed(0))
    call conduction%stream_rows()
    call tell(ended - began, real(size(conduction%laplacian%index, kind=i8), wp)/size(inside))
  end subroutine time_rows

  !> Forward Euler with the longest stable step, as the shortest program does it.
  subroutine time_five_point()
    real(wp), parameter :: end_time = 0.05_wp
    real(wp), allocatable :: u(:, :), next(:, :)
    real(wp) :: began, ended, ratio, exact, missed, total
    integer :: n, i, j, step, steps

    read (line, *) command, n
    began = omp_get_wtime()
    allocate (u(0:n, 0:n), next(0:n, 0:n))
    !$omp parallel do schedule(static) private(i)
    do j = 0, n
      do i = 0, n
        u(i, j) = sin(pi*i/n)*sin(pi*j/n)
        if (i == 0 .or. j == 0 .or. i == n .or. j == n) u(i, j) = 0
        next(i, j) = u(i, j)
      end do
    end do
    !$omp end parallel do
    steps = 2*ceiling(2*end_time*n**2)
    ratio = end_time/steps*n**2
    do step = 1, steps/2
      call five_point_step(u, next, n, ratio)
      call five_point_step(next, u, n, ratio)
    end do
    ended = omp_get_wtime()
    missed = 0
    total = 0
    do j = 1, n - 1
      do i = 1, n - 1
        exact = sin(pi*i/n)*sin(pi*j/n)*exp(-2*pi**2*end_time)
        missed = missed + (u(i, j) - exact)**2
        total = total + exact**2
      end do
    end do
    call tell(ended - began, sqrt(missed/total))
  end subroutine time_five_point

  subroutine five_point_step(u, next, n, ratio)
    integer, intent(in) :: n
    real(wp), intent(in) :: u(0:n, 0:n), ratio
    real(wp), intent(inout) :: next(0:n, 0:n)
    integer :: i, j

    !$omp parallel do schedule(static) private(i)
    do j = 1, n - 1
      do i = 1, n - 1
        next(i, j) = u(i, j) + ratio*(u(i - 1, j) + u(i + 1, j) + u(i, j - 1) + u(i, j + 1) - &
                                      4*u(i, j))
      end do
    end do
    !$omp end parallel do
  end subroutine five_point_step

  !> Of several sweeps the median one
  subroutine time_sweep(name)
    character(len=*), intent(in) :: name
    real(wp) :: seconds(repeats), began, bytes, entries
    integer :: repeat, n

    n = cloud%particles()
    entries = real(size(conduction%laplacian%index, kind=i8), wp)
    ! An index and a weight for each neighbour, and vectors: of a stage three sweeps and the
    ! particle's place, of a rate as many, and two more of a stage where the problem changes with time
    bytes = 12*entries
    if (conduction%single_weights) bytes = 8*entries
    bytes = bytes + merge(44.0_wp, 28.0_wp, name == 'forced')*n
    if (name == 'triad') call reserve(nint(bytes/24))
    do repeat = 1, repeats
      began = omp_get_wtime()
      select case (name)
      case ('triad')
        call triad(a, b, c)
      case ('rate')
        call conduction%rate(0.0_wp, newer, work)
      case ('stage')
        call conduction%recur_with_rate(0.0_wp, [1.0_wp, 0.3_wp, 1.0e-9_wp], newer, older, space)
      case ('forced')
        call conduction%combine_with_rate(0.0_wp, [0.5_wp, 0.3_wp, 0.2_wp, 1.0e-9_wp, 1.0e-9_wp], &
                                          newer, start, rate, older, space)
      case ('csr')
        call conduction%laplacian%apply_at_targets(1.0_wp, newer, work)
      case ('product')
        call mkl%multiply(newer, work)
      case default
        error stop 'bench: no such measurement'
      end select
      seconds(repeat) = omp_get_wtime() - began
    end do
    call tell(median(seconds), bytes)
  end subroutine time_sweep

  subroutine reserve(length)
    integer, intent(in) :: length
    integer :: k

    if (allocated(a)) then
      if (size(a) == length) return
      deallocate (a, b, c)
    end if
    allocate (a(length), b(length), c(length))
    call prefer_huge_pages(a)
    call prefer_huge_pages(b)
    call prefer_huge_pages(c)
    !$omp parallel do schedule(static)
    do k = 1, length
      a(k) = 0
      b(k) = 1
      c(k) = 2
    end do
    !$omp end parallel do
  end subroutine reserve

  subroutine triad(a, b, c)
    real(wp), intent(inout), contiguous :: a(:)
    real(wp), intent(in), contiguous :: b(:), c(:)
    integer :: k

    !$omp parallel do schedule(static)
    do k = 1, size(a)
      a(k) = b(k) + 0.5_wp*c(k)
    end do
    !$omp end parallel do
  end subroutine triad

  pure function median(values) result(middle)
    real(wp), intent(in) :: values(:)
    real(wp) :: middle
    integer :: k

    middle = 0
    do k = 1, size(values)
      if (count(values < values(k)) <= size(values)/2 .and. &
          count(values <= values(k)) > size(values)/2) middle = values(k)
    end do
  end function median

  subroutine tell(seconds, figure)
    real(wp), intent(in) :: seconds, figure

    write (*, '(es23.15, 1x, es23.15)') seconds, figure
  end subroutine tell

  subroutine tell_memory()
    character(len=128) :: text
    real(wp) :: now, most
    integer :: unit, status

    now = 0
    most = 0
    open (newunit=unit, file='/proc/self/status', action='read')
    do
      read (unit, '(a)', iostat=status) text
      if (status /= 0) exit
      if (index(text, 'VmRSS:') == 1) read (text(7:), *) now
      if (index(text, 'VmHWM:') == 1) read (text(7:), *) most
    end do
    close (unit)
    call tell(1024*now, 1024*most)
  end subroutine tell_memory

end program bench
