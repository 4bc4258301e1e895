!> Particles sorted into the square cells of a grid.
!>
!> The plane is divided into cells, and every cell belongs to a bucket; the particles are stored
!> bucket after bucket by a counting sort. As long as the grid has about as many cells as there are
!> particles, each cell is a bucket of its own. A grid that would have many more (a huge or nearly
!> empty extent) shares a bounded number of buckets: cells of one grid row stay side by side, and
!> each row begins at a pseudo-random bucket. Time and memory are therefore O(N) for every cloud;
!> what is found in a bucket may lie in another cell and has to be checked by its distance.
module calor_cell_list
  use calor_constants, only: worth_threads
  use calor_huge_pages, only: prefer_huge_pages
  use calor_kinds, only: wp, ip, i8
  implicit none (type, external)
  private

  public :: cell_list_t, build_cell_list, counting_sort

  !> Particles in the order of the buckets of a grid of cells
  type :: cell_list_t
    !> Lowest coordinates of all particles, m
    real(wp) :: x_low = 0.0_wp, y_low = 0.0_wp
    !> Cells per length, 1/m
    real(wp) :: per_length = 0.0_wp
    !> Number of cells in x and in y
    integer(i8) :: columns = 1, rows = 1
    !> Number of buckets
    integer(ip) :: buckets = 1
    !> Whether cells share buckets
    logical :: shared = .false.
    !> Where each bucket begins in `particle`; one element more than buckets
    integer(ip), allocatable :: first(:)
    !> Particle numbers, bucket after bucket, ascending in each
    integer(ip), allocatable :: particle(:)
    !> Coordinates in the order of `particle`, m
    real(wp), allocatable :: x(:), y(:)
  contains
    !> Column of the cell in which an x lies, counted from 0; those outside count as the outermost
    procedure :: column
    !> Row of the cell in which a y lies, counted from 0; those outside count as the outermost
    procedure :: row
    !> Bucket of a cell
    procedure :: bucket
    !> The buckets of neighbouring cells of one row, as one or two ranges
    procedure :: bucket_ranges
  end type cell_list_t

  !> Longest row of cells. Positions stay exact to a small fraction of a cell up to here.
  integer(i8), parameter :: most_columns = 2_i8**40

contains

  !> Sort particles into cells.
  !>
  !> Coordinates have to be finite. The result does not depend on the number of threads.
  subroutine build_cell_list(x, y, cell_size, cells)
    !> Coordinates, m
    real(wp), intent(in) :: x(:), y(:)
    !> Wanted edge of a cell, m; larger cells are made where the extent is more than 2⁴⁰ of it
    real(wp), intent(in) :: cell_size
    !> The particles in the order of their cells
    type(cell_list_t), intent(out) :: cells
    integer(ip), allocatable :: bucket_of(:)
    real(wp) :: x_high, y_high, size_used
    integer :: i, particles

    particles = size(x)
    x_high = 0
    y_high = 0
    if (particles > 0) then
      call find_extent(x, cells%x_low, x_high)
      call find_extent(y, cells%y_low, y_high)
    end if
    size_used = max(cell_size, max(x_high - cells%x_low, y_high - cells%y_low)/most_columns, &
                    1.0e-290_wp)
    cells%per_length = 1/size_used
    cells%columns = 1 + int((x_high - cells%x_low)*cells%per_length, i8)
    cells%rows = 1 + int((y_high - cells%y_low)*cells%per_length, i8)

    ! The comparison with real numbers, as the product may exceed any integer
    cells%shared = real(cells%columns, wp)*real(cells%rows, wp) > 2*real(particles, wp) + 64
    if (cells%shared) then
      cells%buckets = 64
      do while (cells%buckets < particles .and. cells%buckets < 2**30)
        cells%buckets = 2*cells%buckets
      end do
    else
      cells%buckets = int(cells%columns*cells%rows, ip)
    end if

    allocate (bucket_of(particles))
    call prefer_huge_pages(bucket_of)
    !$omp parallel do if (particles > worth_threads) default(none) schedule(static) &
    !$omp shared(particles, x, y, cells, bucket_of)
    do i = 1, particles
      bucket_of(i) = cells%bucket(cells%column(x(i)), cells%row(y(i)))
    end do
    !$omp end parallel do

    call counting_sort(bucket_of, cells%buckets, cells%first, cells%particle)

    allocate (cells%x(particles), cells%y(particles))
    call prefer_huge_pages(cells%x)
    call prefer_huge_pages(cells%y)
    !$omp parallel do if (particles > worth_threads) default(none) schedule(static) &
    !$omp shared(particles, x, y, cells)
    do i = 1, particles
      cells%x(i) = x(cells%particle(i))
      cells%y(i) = y(cells%particle(i))
    end do
    !$omp end parallel do
  end subroutine build_cell_list

  !> Sort by small whole numbers in O(items + keys), keeping the order of equal ones.
  subroutine counting_sort(key, keys, first, order)
    !> For each item a key between 1 and `keys`
    integer(ip), intent(in) :: key(:)
    !> Largest key
    integer(ip), intent(in) :: keys
    !> Where the items of each key begin in `order`; one element more than keys
    integer(ip), allocatable, intent(out) :: first(:)
    !> Item numbers, sorted by key
    integer(ip), allocatable, intent(out) :: order(:)
    integer(ip) :: before, item, items, k

    items = size(key, kind=ip)
    allocate (first(keys + 1), order(items))
    call prefer_huge_pages(order)
    first = 0
    do item = 1, items
      first(key(item)) = first(key(item)) + 1
    end do
    ! Where each key ends, and from there back to where it begins
    before = 1
    do k = 1, keys
      before = before + first(k)
      first(k) = before
    end do
    first(keys + 1) = before
    do item = items, 1, -1
      k = key(item)
      first(k) = first(k) - 1
      order(first(k)) = item
    end do
  end subroutine counting_sort

  elemental function column(this, x) result(number)
    class(cell_list_t), intent(in) :: this
    !> Coordinate, m
    real(wp), intent(in) :: x
    integer(i8) :: number

    ! Rounding keeps the order of coordinates, so that of two places the one further right never
    ! gets the smaller column. Searches rely on that and on nothing else.
    number = int(min(max((x - this%x_low)*this%per_length, 0.0_wp), &
                     real(this%columns - 1, wp)), i8)
  end function column

  elemental function row(this, y) result(number)
    class(cell_list_t), intent(in) :: this
    !> Coordinate, m
    real(wp), intent(in) :: y
    integer(i8) :: number

    number = int(min(max((y - this%y_low)*this%per_length, 0.0_wp), &
                     real(this%rows - 1, wp)), i8)
  end function row

  elemental function bucket(this, column, row) result(number)
    class(cell_list_t), intent(in) :: this
    !> The cell, counted from 0
    integer(i8), intent(in) :: column, row
    integer(ip) :: number

    if (this%shared) then
      number = 1 + int(iand(scramble(row) + column, int(this%buckets - 1, i8)), ip)
    else
      number = 1 + int(row*this%columns + column, ip)
    end if
  end function bucket

  pure subroutine bucket_ranges(this, from_column, to_column, row, from, to, ranges)
    class(cell_list_t), intent(in) :: this
    !> First and last cell, counted from 0
    integer(i8), intent(in) :: from_column, to_column
    !> Their row, counted from 0
    integer(i8), intent(in) :: row
    !> First and last bucket of each range
    integer(ip), intent(out) :: from(2), to(2)
    !> Number of ranges, 1 or 2
    integer, intent(out) :: ranges

    ranges = 1
    from = 1
    to = this%buckets
    if (to_column - from_column + 1 >= this%buckets) return
    from(1) = this%bucket(from_column, row)
    to(1) = this%bucket(to_column, row)
    if (to(1) < from(1)) then
      ! Shared buckets go round in a ring
      ranges = 2
      to(2) = to(1)
      to(1) = this%buckets
    end if
  end subroutine bucket_ranges

  !> A pseudo-random number below 2³² that depends on a row only.
  elemental function scramble(row) result(number)
    integer(i8), intent(in) :: row
    integer(i8) :: number
    ! Odd and below 2³¹, so that no product of theirs with 32 bits overflows
    integer(i8), parameter :: first_factor = 1540483477_i8, second_factor = 2024237689_i8
    integer(i8), parameter :: low_bits = 4294967295_i8

    number = iand(ieor(row, ishft(row, -29)) + 1, low_bits)
    number = iand(number*first_factor, low_bits)
    number = ieor(number, ishft(number, -15))
    number = iand(number*second_factor, low_bits)
    number = ieor(number, ishft(number, -13))
  end function scramble

  !> Smallest and largest of some coordinates.
  subroutine find_extent(coordinate, low, high)
    real(wp), intent(in) :: coordinate(:)
    real(wp), intent(out) :: low, high
    real(wp) :: lowest, highest
    integer :: i

    lowest = coordinate(1)
    highest = coordinate(1)
    !$omp parallel do if (size(coordinate) > worth_threads) default(none) shared(coordinate) &
    !$omp reduction(min: lowest) reduction(max: highest) schedule(static)
    do i = 1, size(coordinate)
      lowest = min(lowest, coordinate(i))
      highest = max(highest, coordinate(i))
    end do
    !$omp end parallel do
    low = lowest
    high = highest
  end subroutine find_extent

end module calor_cell_list
