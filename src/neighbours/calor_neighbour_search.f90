!> How neighbour lists are built.
!>
!> All rows whose target particles share a cell share the work of looking around: the particles in
!> reach of the cell are gathered once, sorted once by number, and each row is then one sweep over
!> contiguous coordinates that leaves its neighbours already in ascending order. Neighbours are
!> counted first, and then written to where they belong: on vector units a distance costs less than
!> to keep all that was found until the lengths of all rows are known. Rows of a cell may belong
!> anywhere in the list, so they are written a batch at a time: a write to memory not in the cache
!> is waited for by what is read after it.
submodule(calor_neighbour_list) calor_neighbour_search
  use calor_cell_list, only: cell_list_t, build_cell_list, counting_sort
  use calor_constants, only: worth_threads
  use calor_huge_pages, only: prefer_huge_pages
  use omp_lib, only: omp_get_max_threads
  implicit none (type, external)

  !> No radius is larger than 2 edges of a cell, so that at most 7 rows of cells are looked through,
  !> each of them in at most 2 ranges of buckets
  integer, parameter :: most_ranges = 14

  !> Rows of similar radius, in the order of the cells that their target particles lie in; where
  !> these are all particles, the cells say all
  type :: sorted_rows_t
    type(cell_list_t) :: cells
    logical :: everyone = .false.
    !> Where each bucket begins in `row`, and the rows
    integer(ip), allocatable :: first(:), row(:)
    !> Their targets, and where these are, m
    integer(ip), allocatable :: particle(:)
    real(wp), allocatable :: x(:), y(:)
  end type sorted_rows_t

  !> The particles in reach of one cell, in ascending order, and room to sort them
  type :: candidates_t
    !> How many there are
    integer :: number = 0
    !> Ranges of buckets that they were taken from
    integer :: ranges = 0
    integer(ip) :: from(most_ranges), to(most_ranges)
    !> Particle numbers
    integer(ip), allocatable :: particle(:)
    !> Coordinates, m; the last block of lanes is filled up
    real(wp), allocatable :: x(:), y(:)
    !> The same as they come from the cells
    integer(ip), allocatable :: raw_particle(:)
    real(wp), allocatable :: raw_x(:), raw_y(:)
    !> Particle number times 2³² plus place among the unsorted
    integer(i8), allocatable :: key(:), spare(:)
    !> Where ascending runs of keys begin, and one past the end
    integer, allocatable :: run(:)
    !> A bit for each that is near enough
    integer(i8), allocatable :: mark(:)
  end type candidates_t

  !> Fewest rows that make a chunk worth its administration
  integer, parameter :: least_rows = 1024
  !> Chunks for each thread: enough to share the work out evenly
  integer, parameter :: chunks_per_thread = 8
  !> Up to so many candidates, comparing each with each is faster than merging
  integer, parameter :: most_to_rank = 128
  !> Particles that are ranked at a time
  integer, parameter :: lanes = 16
  !> Neighbours that are written down at a time: as many as fit into the first cache
  integer, parameter :: batch = 4096
  !> Distances that are compared at a time
  integer, parameter :: distance_lanes = 8
  !> Bits of a number, each for one candidate, and these numbered
  integer, parameter :: bits = 64
  integer :: number_of_bit
  integer(i8), parameter :: bit(bits) = [(ishft(1_i8, number_of_bit - 1), number_of_bit=1, bits)]

contains

  module procedure build_with_one_radius
    call search_all(x, y, [radius], list, targets)
  end procedure build_with_one_radius

  module procedure build_with_radii
    call search_all(x, y, radius, list, targets)
  end procedure build_with_radii

  !> Build a list with as many radii as rows, or with one.
  subroutine search_all(x, y, radius, list, targets)
    real(wp), intent(in) :: x(:), y(:), radius(:)
    type(neighbour_list_t), intent(out) :: list
    integer(ip), intent(in), optional :: targets(:)
    type(sorted_rows_t) :: sorted
    integer(ip), allocatable :: octave_row(:), octave_first(:)
    integer(i8) :: place, length
    integer :: octave, pass, row, rows
    logical :: everyone, sorted_before

    rows = size(x)
    if (present(targets)) rows = size(targets)
    allocate (list%target(rows), list%first(rows + 1))
    call prefer_huge_pages(list%target)
    call prefer_huge_pages(list%first)
    !$omp parallel do if (rows > worth_threads) default(none) schedule(static) private(row) &
    !$omp shared(rows, list, targets)
    do row = 1, rows
      list%target(row) = row
      if (present(targets)) list%target(row) = targets(row)
      list%first(row) = 0
    end do
    !$omp end parallel do

    call sort_by_octave(radius, rows, octave_first, octave_row)
    sorted_before = .false.
    do pass = 1, 2
      do octave = 1, size(octave_first) - 1
        associate (from => octave_first(octave), to => octave_first(octave + 1) - 1)
          if (to < from) cycle
          everyone = .not. present(targets) .and. to - from + 1 == rows
          if (.not. sorted_before) call sort_rows(x, y, radius, list%target, octave_row(from:to), &
                                                  everyone, sorted)
          ! Where all rows are sorted at once, the second pass finds them sorted
          sorted_before = to - from + 1 == octave_first(size(octave_first)) - 1
        end associate
        if (pass == 1) then
          call search_sorted(sorted, radius, list%first)
        else
          call search_sorted(sorted, radius, list%first, list%index)
        end if
      end do
      if (pass == 2) exit
      place = 1
      do row = 1, rows
        length = list%first(row)
        list%first(row) = place
        place = place + length
      end do
      list%first(rows + 1) = place
      allocate (list%index(place - 1))
      call prefer_huge_pages(list%index)
    end do
  end subroutine search_all

  !> Part the rows by the binary exponent of their radius.
  !>
  !> Each octave of radii is searched with cells of its own size, so that a row with a small
  !> radius need not look through large cells, nor one with a large radius through many small ones.
  subroutine sort_by_octave(radius, rows, first, row)
    real(wp), intent(in) :: radius(:)
    integer, intent(in) :: rows
    !> Where each octave begins in `row`, and one past the end
    integer(ip), allocatable, intent(out) :: first(:)
    !> Rows by octave, without those whose radius is not positive
    integer(ip), allocatable, intent(out) :: row(:)
    integer(ip), allocatable :: octave(:), all_first(:), all_row(:)
    real(wp) :: smallest, largest
    integer :: lowest, highest, k, positive

    smallest = huge(smallest)
    largest = 0
    positive = 0
    !$omp parallel do simd if (size(radius) > worth_threads) schedule(static) default(none) &
    !$omp shared(radius) reduction(min: smallest) reduction(max: largest) reduction(+: positive)
    do k = 1, size(radius)
      smallest = min(smallest, merge(radius(k), huge(smallest), radius(k) > 0))
      largest = max(largest, merge(radius(k), 0.0_wp, radius(k) > 0))
      positive = positive + merge(1, 0, radius(k) > 0)
    end do
    !$omp end parallel do simd
    if (positive == 0) then
      first = [1]
      allocate (row(0))
      return
    end if
    lowest = exponent(smallest)
    highest = exponent(largest)
    if (lowest == highest .and. positive == size(radius)) then
      allocate (row(rows))
      !$omp parallel do if (rows > worth_threads) schedule(static) default(none) shared(row, rows)
      do k = 1, rows
        row(k) = k
      end do
      !$omp end parallel do
      first = [1, rows + 1]
      return
    end if
    allocate (octave(rows))
    do k = 1, rows
      octave(k) = 1
      if (radius(k) > 0) octave(k) = 2 + exponent(radius(k)) - lowest
    end do
    call counting_sort(octave, 2 + highest - lowest, all_first, all_row)
    allocate (first(size(all_first) - 1), row(size(all_row) + 1 - all_first(2)))
    first(:) = all_first(2:) - (all_first(2) - 1)
    row(:) = all_row(all_first(2):)
  end subroutine sort_by_octave

  !> Sort rows of similar radius by the cells of their targets.
  subroutine sort_rows(x, y, radius, target, rows, everyone, sorted)
    real(wp), intent(in) :: x(:), y(:), radius(:)
    !> The particle of each row of the list
    integer(ip), intent(in) :: target(:)
    !> The rows to be searched
    integer(ip), intent(in) :: rows(:)
    !> Whether these are all particles in their own order
    logical, intent(in) :: everyone
    type(sorted_rows_t), intent(out) :: sorted
    integer(ip), allocatable :: key(:)
    integer :: k

    call build_cell_list(x, y, cell_size(radius, rows), sorted%cells)
    sorted%everyone = everyone
    if (everyone) return
    allocate (key(size(rows)), sorted%particle(size(rows)))
    allocate (sorted%x(size(rows)), sorted%y(size(rows)))
    !$omp parallel do if (size(rows) > worth_threads) default(shared) schedule(static) private(k)
    do k = 1, size(rows)
      associate (particle => target(rows(k)), cells => sorted%cells)
        key(k) = cells%bucket(cells%column(x(particle)), cells%row(y(particle)))
      end associate
    end do
    !$omp end parallel do
    call counting_sort(key, sorted%cells%buckets, sorted%first, sorted%row)
    !$omp parallel do if (size(rows) > worth_threads) default(shared) schedule(static) private(k)
    do k = 1, size(rows)
      sorted%row(k) = rows(sorted%row(k))
      sorted%particle(k) = target(sorted%row(k))
      sorted%x(k) = x(sorted%particle(k))
      sorted%y(k) = y(sorted%particle(k))
    end do
    !$omp end parallel do
  end subroutine sort_rows

  !> A good edge of cells for some radii of one octave.
  pure function cell_size(radius, rows) result(edge)
    real(wp), intent(in) :: radius(:)
    integer(ip), intent(in) :: rows(:)
    real(wp) :: edge
    real(wp) :: largest, total
    integer :: k

    if (size(radius) == 1) then
      edge = radius(1)
    else
      largest = 0
      total = 0
      do k = 1, size(rows)
        largest = max(largest, radius(rows(k)))
        total = total + radius(rows(k))/size(rows)
      end do
      ! Where radii vary a little, most should still fit into one cell; a few much larger ones
      ! should not make the cells of all others larger
      edge = min(largest, 1.15_wp*total)
    end if
    ! The margin is for what rounding may add to a radius
    edge = 1.002_wp*edge
  end function cell_size

  !> Count the neighbours of rows, or write them down.
  subroutine search_sorted(sorted, radius, first, index)
    type(sorted_rows_t), intent(in) :: sorted
    real(wp), intent(in) :: radius(:)
    !> Number of neighbours of each row, or where they begin in `index`
    integer(i8), intent(inout), contiguous :: first(:)
    !> Neighbours, row after row
    integer(ip), intent(inout), optional :: index(:)

    ! What describes an absent array is left unset, and must not be handed on.
    associate (cells => sorted%cells)
      if (sorted%everyone .and. present(index)) then
        call search_chunks(cells, cells%first, cells%particle, cells%particle, cells%x, cells%y, &
                           radius, first, index)
      else if (sorted%everyone) then
        call search_chunks(cells, cells%first, cells%particle, cells%particle, cells%x, cells%y, &
                           radius, first)
      else if (present(index)) then
        call search_chunks(cells, sorted%first, sorted%row, sorted%particle, sorted%x, sorted%y, &
                           radius, first, index)
      else
        call search_chunks(cells, sorted%first, sorted%row, sorted%particle, sorted%x, sorted%y, &
                           radius, first)
      end if
    end associate
  end subroutine search_sorted

  subroutine search_chunks(cells, bucket_first, row, particle, x, y, radius, first, index)
    type(cell_list_t), intent(in) :: cells
    !> Where the rows of each bucket begin, the rows, their targets and where these are, m
    integer(ip), intent(in), contiguous :: bucket_first(:), row(:), particle(:)
    real(wp), intent(in), contiguous :: x(:), y(:)
    real(wp), intent(in) :: radius(:)
    integer(i8), intent(inout), contiguous :: first(:)
    integer(ip), intent(inout), optional :: index(:)
    integer :: chunk, chunk_rows, chunks, from, to

    chunk_rows = max(least_rows, size(row)/(chunks_per_thread*omp_get_max_threads()))
    chunks = (size(row) + chunk_rows - 1)/chunk_rows
    !$omp parallel do if (chunks > 1) default(none) private(from, to) schedule(dynamic) &
    !$omp shared(chunks, chunk_rows, cells, bucket_first, row, particle, x, y, radius, first, index)
    do chunk = 1, chunks
      from = (chunk - 1)*chunk_rows + 1
      to = min(chunk*chunk_rows, size(row))
      if (present(index)) then
        call search_chunk(cells, bucket_first, row, particle, x, y, radius, from, to, first, index)
      else
        call search_chunk(cells, bucket_first, row, particle, x, y, radius, from, to, first)
      end if
    end do
    !$omp end parallel do
  end subroutine search_chunks

  !> Count the neighbours of the rows of one chunk, or write them down.
  subroutine search_chunk(cells, bucket_first, row, particle, x, y, radius, from, to, first, index)
    type(cell_list_t), intent(in) :: cells
    integer(ip), intent(in), contiguous :: bucket_first(:), row(:), particle(:)
    real(wp), intent(in), contiguous :: x(:), y(:)
    real(wp), intent(in) :: radius(:)
    !> First and last of the rows of this chunk
    integer, intent(in) :: from, to
    integer(i8), intent(inout), contiguous :: first(:)
    integer(ip), intent(inout), optional :: index(:)
    type(candidates_t) :: candidates
    integer(ip), allocatable :: found(:)
    real(wp) :: r, reach
    integer(i8) :: column, row_of_cells
    integer, allocatable :: counted(:)
    integer :: k, last, other, used, written

    allocate (found(batch))
    if (.not. present(index)) allocate (counted(from:to))
    used = 0
    written = from - 1
    last = from - 1
    do while (last < to)
      k = last + 1
      column = cells%column(x(k))
      row_of_cells = cells%row(y(k))
      last = min(bucket_first(cells%bucket(column, row_of_cells) + 1) - 1, to)
      if (cells%shared) last = last_in_cell(k, last)
      reach = radius_of(k)
      if (size(radius) > 1) then
        do other = k + 1, last
          reach = max(reach, radius_of(other))
        end do
      end if
      call gather_candidates(cells, column, row_of_cells, reach, candidates)

      if (present(index)) then
        call sort_candidates(candidates)
        do k = k, last
          if (used + candidates%number > size(found)) then
            call write_rows(row(written + 1:k - 1), found, first, index)
            written = k - 1
            used = 0
            if (candidates%number > size(found)) then
              deallocate (found)
              allocate (found(2*candidates%number))
            end if
          end if
          r = radius_of(k)
          call mark_within(candidates%number, candidates%x, candidates%y, x(k), &
                           y(k), r*r, candidates%mark)
          call append_marked(candidates, particle(k), found, used)
        end do
      else
        do k = k, last
          r = radius_of(k)
          call mark_within(candidates%number, candidates%raw_x, candidates%raw_y, x(k), &
                           y(k), r*r, candidates%mark)
          ! Without itself, which is nearer than any radius that is not lost when squared
          counted(k) = max(0, number_marked(candidates) - 1)
        end do
      end if
    end do
    if (present(index)) then
      call write_rows(row(written + 1:to), found, first, index)
    else
      do k = from, to
        first(row(k)) = counted(k)
      end do
    end if

  contains

    !> Search radius of the k-th row.
    pure function radius_of(k) result(r)
      integer, intent(in) :: k
      real(wp) :: r

      ! Larger ones would overflow when squared, and reach everything anyhow
      r = min(radius(min(row(k), size(radius))), 1.0e150_wp)
    end function radius_of

    !> Where the rows end, at the latest at `limit`, whose targets lie in the same cell as the k-th.
    pure function last_in_cell(k, limit) result(last)
      integer, intent(in) :: k, limit
      integer :: last

      do last = k, limit - 1
        if (cells%column(x(last + 1)) /= column) exit
        if (cells%row(y(last + 1)) /= row_of_cells) exit
      end do
    end function last_in_cell

  end subroutine search_chunk

  !> Mark the particles nearer to a place than a radius.
  !>
  !> One loop body, without remainders, for all pairs and both passes: rounded differently, lists
  !> might lose their symmetry, or rows have other lengths than were counted.
  pure subroutine mark_within(number, x, y, x_own, y_own, radius_squared, mark)
    integer, intent(in) :: number
    !> Coordinates, m, the last block of lanes filled up
    real(wp), intent(in), contiguous :: x(:), y(:)
    real(wp), intent(in) :: x_own, y_own, radius_squared
    !> `bits` of each number in turn, the lowest first
    integer(i8), intent(inout), contiguous :: mark(:)
    integer(i8) :: word
    integer :: before, k, last, place

    do k = 1, (number - 1)/bits + 1
      before = bits*(k - 1)
      last = distance_lanes*((min(number - before, bits) - 1)/distance_lanes + 1)
      word = 0
      !$omp simd reduction(ior: word)
      do place = 1, last
        word = ior(word, merge(bit(place), 0_i8, (x(before + place) - x_own)**2 + &
                               (y(before + place) - y_own)**2 < radius_squared))
      end do
      ! Without what was filled up
      mark(k) = iand(word, maskr(min(number - before, bits), i8))
    end do
  end subroutine mark_within

  pure function number_marked(candidates) result(number)
    type(candidates_t), intent(in) :: candidates
    integer :: number
    integer :: k

    number = 0
    do k = 1, (candidates%number - 1)/bits + 1
      number = number + popcnt(candidates%mark(k))
    end do
  end function number_marked

  !> Append the marked particles but one.
  pure subroutine append_marked(candidates, own, found, used)
    type(candidates_t), intent(in) :: candidates
    !> The particle that is not its own neighbour
    integer(ip), intent(in) :: own
    !> With room for all candidates
    integer(ip), intent(inout), contiguous :: found(:)
    !> Number of particles in `found`
    integer, intent(inout) :: used
    integer(i8) :: left
    integer :: before, k

    do k = 1, (candidates%number - 1)/bits + 1
      before = bits*(k - 1)
      ! The highest bit aside, as it is the sign, the lowest one goes by a subtraction: no
      ! processor has to wait for its number
      left = ibclr(candidates%mark(k), bits - 1)
      do while (left /= 0)
        ! The next one overwrites what is not counted: no branch that would be guessed wrongly
        found(used + 1) = candidates%particle(before + trailz(left) + 1)
        used = used + merge(1, 0, found(used + 1) /= own)
        left = iand(left, left - 1)
      end do
      if (candidates%mark(k) < 0) then
        found(used + 1) = candidates%particle(before + bits)
        used = used + merge(1, 0, found(used + 1) /= own)
      end if
    end do
  end subroutine append_marked

  !> Write rows to where they belong in the list.
  pure subroutine write_rows(row, found, first, index)
    !> Which rows
    integer(ip), intent(in), contiguous :: row(:)
    !> Their neighbours, row after row
    integer(ip), intent(in), contiguous :: found(:)
    !> Where rows begin in the list, and the list
    integer(i8), intent(in), contiguous :: first(:)
    integer(ip), intent(inout) :: index(:)
    integer(i8) :: begin
    integer :: entry, k, length, taken

    taken = 0
    do k = 1, size(row)
      begin = first(row(k))
      length = int(first(row(k) + 1) - begin)
      do entry = 1, length
        index(begin + entry - 1) = found(taken + entry)
      end do
      taken = taken + length
    end do
  end subroutine write_rows

  !> Gather all particles that may be within reach of those in a cell.
  pure subroutine gather_candidates(cells, column, row, reach, candidates)
    type(cell_list_t), intent(in) :: cells
    !> The cell
    integer(i8), intent(in) :: column, row
    !> Largest search radius of the particles in the cell, m
    real(wp), intent(in) :: reach
    type(candidates_t), intent(inout) :: candidates
    integer(i8) :: from_column, row_of_cells, steps, to_column
    integer(ip) :: from(2), to(2)
    integer :: range, ranges

    ! Columns and rows of two particles within reach differ by no more. The summand covers what
    ! rounding moves a particle on a grid of 2⁴⁰ columns.
    steps = 1 + int(min(reach*cells%per_length + 2.0_wp**(-11), 2.0_wp**41), i8)
    from_column = max(column - steps, 0_i8)
    to_column = min(column + steps, cells%columns - 1)
    candidates%number = 0
    candidates%ranges = 0
    do row_of_cells = max(row - steps, 0_i8), min(row + steps, cells%rows - 1)
      call cells%bucket_ranges(from_column, to_column, row_of_cells, from, to, ranges)
      do range = 1, ranges
        if (cells%shared) then
          call take_new_buckets(cells, from(range), to(range), candidates)
        else
          call take_buckets(cells, from(range), to(range), candidates)
        end if
      end do
    end do
    call fill_up(candidates%number, candidates%raw_x)
    call fill_up(candidates%number, candidates%raw_y)
  end subroutine gather_candidates

  !> Put candidates into ascending order.
  pure subroutine sort_candidates(candidates)
    type(candidates_t), intent(inout) :: candidates

    if (candidates%number <= most_to_rank) then
      call sort_by_ranking(candidates%number, candidates%raw_particle, candidates%raw_x, &
                           candidates%raw_y, candidates%particle, candidates%x, candidates%y)
    else
      call sort_by_merging(candidates)
    end if
    call fill_up(candidates%number, candidates%x)
    call fill_up(candidates%number, candidates%y)
  end subroutine sort_candidates

  !> Fill up the last block of coordinates with one that is among them.
  pure subroutine fill_up(number, coordinate)
    integer, intent(in) :: number
    real(wp), intent(inout) :: coordinate(:)
    integer :: k

    do k = number + 1, distance_lanes*((number - 1)/distance_lanes + 1)
      coordinate(k) = coordinate(1)
    end do
  end subroutine fill_up

  !> Append the particles of a range of buckets, unsorted.
  pure subroutine take_buckets(cells, from, to, candidates)
    type(cell_list_t), intent(in) :: cells
    !> First and last bucket
    integer(ip), intent(in) :: from, to
    type(candidates_t), intent(inout) :: candidates
    integer :: first, number, taken

    first = cells%first(from)
    number = cells%first(to + 1) - first
    call reserve(candidates, candidates%number + number + lanes)
    ! Whole blocks where there are any: what is too much is overwritten by what comes next
    taken = lanes*((number + lanes - 1)/lanes)
    if (first + taken - 1 > size(cells%x)) taken = number
    associate (kept => candidates%number)
      call copy(taken, cells%particle(first:), cells%x(first:), cells%y(first:), &
                candidates%raw_particle(kept + 1:), candidates%raw_x(kept + 1:), &
                candidates%raw_y(kept + 1:))
      kept = kept + number
    end associate
  end subroutine take_buckets

  !> Copy whole blocks of particles, or any other number.
  pure subroutine copy(number, particle, x, y, particle_copy, x_copy, y_copy)
    integer, intent(in) :: number
    integer(ip), intent(in) :: particle(number)
    real(wp), intent(in) :: x(number), y(number)
    integer(ip), intent(inout) :: particle_copy(number)
    real(wp), intent(inout) :: x_copy(number), y_copy(number)
    integer :: block, k, lane

    do block = 0, number - lanes, lanes
      do lane = 1, lanes
        particle_copy(block + lane) = particle(block + lane)
        x_copy(block + lane) = x(block + lane)
        y_copy(block + lane) = y(block + lane)
      end do
    end do
    do k = lanes*(number/lanes) + 1, number
      particle_copy(k) = particle(k)
      x_copy(k) = x(k)
      y_copy(k) = y(k)
    end do
  end subroutine copy

  !> Append the particles of those buckets of a range that were not in an earlier range.
  pure subroutine take_new_buckets(cells, from, to, candidates)
    type(cell_list_t), intent(in) :: cells
    !> First and last bucket
    integer(ip), intent(in) :: from, to
    type(candidates_t), intent(inout) :: candidates
    integer(ip) :: bucket

    associate (ranges => candidates%ranges)
      do bucket = from, to
        if (any(bucket >= candidates%from(:ranges) .and. bucket <= candidates%to(:ranges))) cycle
        call take_buckets(cells, bucket, bucket, candidates)
      end do
      ranges = ranges + 1
      candidates%from(ranges) = from
      candidates%to(ranges) = to
    end associate
  end subroutine take_new_buckets

  !> Sort a few different particles by counting for each how many have smaller numbers.
  pure subroutine sort_by_ranking(number, raw_particle, raw_x, raw_y, particle, x, y)
    integer, intent(in) :: number
    !> With room for whole blocks
    integer(ip), intent(inout) :: raw_particle(lanes, (number - 1)/lanes + 1)
    real(wp), intent(in) :: raw_x(number), raw_y(number)
    integer(ip), intent(inout) :: particle(number)
    real(wp), intent(inout) :: x(number), y(number)
    integer :: rank(lanes)
    integer :: block, lane, last, other

    ! A block of particles is ranked at a time, each in its own lane of the vector units
    do block = 1, size(raw_particle, 2)
      call rank_block(number, raw_particle, raw_particle(:, block), rank)
      last = min(lanes, number - lanes*(block - 1))
      do lane = 1, last
        other = lane + lanes*(block - 1)
        particle(rank(lane)) = raw_particle(lane, block)
        x(rank(lane)) = raw_x(other)
        y(rank(lane)) = raw_y(other)
      end do
    end do
  end subroutine sort_by_ranking

  !> One more than how many of all numbers are smaller than each in a block.
  pure subroutine rank_block(number, all_numbers, block, rank)
    integer, intent(in) :: number
    integer(ip), intent(in) :: all_numbers(number), block(lanes)
    integer, intent(out) :: rank(lanes)
    integer :: lane, other
    integer :: count(lanes)

    count = 1
    do other = 1, number
      !$omp simd
      do lane = 1, lanes
        count(lane) = count(lane) + merge(1, 0, all_numbers(other) < block(lane))
      end do
    end do
    rank = count
  end subroutine rank_block

  !> Sort any number of particles by merging ascending runs.
  pure subroutine sort_by_merging(candidates)
    type(candidates_t), intent(inout) :: candidates
    integer :: k, place, runs

    runs = 1
    candidates%run(1) = 1
    do k = 1, candidates%number
      candidates%key(k) = ior(ishft(int(candidates%raw_particle(k), i8), 32), int(k, i8))
      if (k == 1) cycle
      if (candidates%key(k) > candidates%key(k - 1)) cycle
      runs = runs + 1
      candidates%run(runs) = k
    end do
    candidates%run(runs + 1) = candidates%number + 1
    call merge_runs(candidates%key, candidates%spare, candidates%run, runs)
    do k = 1, candidates%number
      place = int(iand(candidates%key(k), 4294967295_i8))
      candidates%particle(k) = int(ishft(candidates%key(k), -32), ip)
      candidates%x(k) = candidates%raw_x(place)
      candidates%y(k) = candidates%raw_y(place)
    end do
  end subroutine sort_by_merging

  !> Merge neighbouring ascending runs until there is one.
  pure subroutine merge_runs(key, spare, run, runs)
    integer(i8), allocatable, intent(inout) :: key(:), spare(:)
    !> Where each run begins, and one past the end of the last
    integer, intent(inout) :: run(:)
    integer, intent(inout) :: runs
    integer(i8), allocatable :: swap(:)
    integer :: k, merged

    do while (runs > 1)
      merged = 0
      do k = 1, runs, 2
        merged = merged + 1
        if (k < runs) then
          call merge_two(key(run(k):run(k + 1) - 1), key(run(k + 1):run(k + 2) - 1), &
                         spare(run(k):run(k + 2) - 1))
          run(merged) = run(k)
        else
          spare(run(k):run(k + 1) - 1) = key(run(k):run(k + 1) - 1)
          run(merged) = run(k)
        end if
      end do
      run(merged + 1) = run(runs + 1)
      runs = merged
      call move_alloc(key, swap)
      call move_alloc(spare, key)
      call move_alloc(swap, spare)
    end do
  end subroutine merge_runs

  !> Merge two ascending sequences, neither of them empty.
  pure subroutine merge_two(a, b, merged)
    integer(i8), intent(in), contiguous :: a(:), b(:)
    integer(i8), intent(out), contiguous :: merged(:)
    integer :: i, j, k

    if (a(size(a)) < b(1)) then
      merged(:size(a)) = a
      merged(size(a) + 1:) = b
      return
    end if
    if (b(size(b)) < a(1)) then
      merged(:size(b)) = b
      merged(size(b) + 1:) = a
      return
    end if
    i = 1
    j = 1
    do k = 1, size(merged)
      if (i > size(a)) then
        merged(k:) = b(j:)
        return
      else if (j > size(b)) then
        merged(k:) = a(i:)
        return
      end if
      if (a(i) <= b(j)) then
        merged(k) = a(i)
        i = i + 1
      else
        merged(k) = b(j)
        j = j + 1
      end if
    end do
  end subroutine merge_two

  !> Make sure that so many candidates fit, and keep those that are there unsorted.
  pure subroutine reserve(candidates, most)
    type(candidates_t), intent(inout) :: candidates
    !> How many there will be
    integer, intent(in) :: most
    type(candidates_t) :: larger
    integer :: size_new

    if (allocated(candidates%x)) then
      if (most <= size(candidates%x)) return
    end if
    size_new = bits*((max(2*most_to_rank, most + most/2) - 1)/bits + 1)
    allocate (larger%particle(size_new), larger%x(size_new), larger%y(size_new))
    allocate (larger%raw_particle(size_new), larger%raw_x(size_new), larger%raw_y(size_new))
    allocate (larger%key(size_new), larger%spare(size_new), larger%run(size_new + 1))
    allocate (larger%mark(size_new/bits))
    if (candidates%number > 0) then
      associate (kept => candidates%number)
        larger%raw_particle(:kept) = candidates%raw_particle(:kept)
        larger%raw_x(:kept) = candidates%raw_x(:kept)
        larger%raw_y(:kept) = candidates%raw_y(:kept)
      end associate
    end if
    call move_alloc(larger%particle, candidates%particle)
    call move_alloc(larger%x, candidates%x)
    call move_alloc(larger%y, candidates%y)
    call move_alloc(larger%raw_particle, candidates%raw_particle)
    call move_alloc(larger%raw_x, candidates%raw_x)
    call move_alloc(larger%raw_y, candidates%raw_y)
    call move_alloc(larger%key, candidates%key)
    call move_alloc(larger%spare, candidates%spare)
    call move_alloc(larger%run, candidates%run)
    call move_alloc(larger%mark, candidates%mark)
  end subroutine reserve

end submodule calor_neighbour_search
