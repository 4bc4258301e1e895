!> How neighbour lists are built.
!>
!> All rows whose target particles share a cell share the work of looking around: the particles in
!> reach of the cell are gathered once, sorted once by number, and each row is then one sweep over
!> contiguous coordinates that leaves its neighbours already in ascending order. Every distance is
!> computed once only: what a sweep finds is kept, and copied into the list when the lengths of
!> all rows are known.
submodule(calor_neighbour_list) calor_neighbour_search
  use calor_cell_list, only: cell_list_t, build_cell_list, counting_sort
  use calor_huge_pages, only: prefer_huge_pages
  use omp_lib, only: omp_get_max_threads
  implicit none (type, external)

  !> No radius is larger than 2 edges of a cell, so that at most 7 rows of cells are looked through,
  !> each of them in at most 2 ranges of buckets
  integer, parameter :: most_ranges = 14

  !> Rows that one thread searches in one go, and what it found
  type :: chunk_t
    !> The rows, cell after cell
    integer(ip), allocatable :: row(:)
    !> Their neighbours, row after row
    integer(ip), allocatable :: found(:)
  end type chunk_t

  !> The particles in reach of one cell, in ascending order, and room to sort them
  type :: candidates_t
    !> How many there are
    integer :: number = 0
    !> Ranges of buckets that they were taken from
    integer :: ranges = 0
    integer(ip) :: from(most_ranges), to(most_ranges)
    !> Particle numbers
    integer(ip), allocatable :: particle(:)
    !> Coordinates, m
    real(wp), allocatable :: x(:), y(:)
    !> The same as they come from the cells
    integer(ip), allocatable :: raw_particle(:)
    real(wp), allocatable :: raw_x(:), raw_y(:)
    !> Particle number times 2³² plus place among the unsorted
    integer(i8), allocatable :: key(:), spare(:)
    !> Where ascending runs of keys begin, and one past the end
    integer, allocatable :: run(:)
  end type candidates_t

  !> Fewest rows that make a chunk worth its administration
  integer, parameter :: least_rows = 1024
  !> Chunks for each thread: enough to share the work out evenly
  integer, parameter :: chunks_per_thread = 8
  !> Up to so many candidates, comparing each with each is faster than merging
  integer, parameter :: most_to_rank = 128
  !> Particles that are ranked at a time
  integer, parameter :: lanes = 16

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
    type(chunk_t), allocatable :: chunks(:)
    integer(ip), allocatable :: octave_row(:), octave_first(:)
    integer(i8) :: place, length
    integer :: chunk, chunk_rows, chunks_done, octave, row, rows

    rows = size(x)
    if (present(targets)) rows = size(targets)
    allocate (list%target(rows), list%first(rows + 1))
    do row = 1, rows
      list%target(row) = row
      list%first(row) = 0
    end do
    if (present(targets)) list%target = targets

    call sort_by_octave(radius, rows, octave_first, octave_row)
    chunk_rows = max(least_rows, rows/(chunks_per_thread*omp_get_max_threads()))
    allocate (chunks(rows/chunk_rows + size(octave_first)))
    chunks_done = 0
    do octave = 1, size(octave_first) - 1
      associate (from => octave_first(octave), to => octave_first(octave + 1) - 1)
        if (to < from) cycle
        call search_octave(x, y, radius, list%target, octave_row(from:to), chunk_rows, &
                           .not. present(targets) .and. to - from + 1 == rows, &
                           list%first, chunks, chunks_done)
      end associate
    end do

    place = 1
    do row = 1, rows
      length = list%first(row)
      list%first(row) = place
      place = place + length
    end do
    list%first(rows + 1) = place
    allocate (list%index(place - 1))
    call prefer_huge_pages(list%index)
    !$omp parallel do if (chunks_done > 1) default(none) shared(chunks, chunks_done, list) &
    !$omp schedule(dynamic)
    do chunk = 1, chunks_done
      call put_in_place(chunks(chunk), list%first, list%index)
    end do
    !$omp end parallel do
  end subroutine search_all

  !> Part the rows by the binary exponent of their radius.
  !>
  !> Each octave of radii is searched with cells of its own size, so that a row with a small
  !> radius need not look through large cells, nor one with a large radius through many small ones.
  pure subroutine sort_by_octave(radius, rows, first, row)
    real(wp), intent(in) :: radius(:)
    integer, intent(in) :: rows
    !> Where each octave begins in `row`, and one past the end
    integer(ip), allocatable, intent(out) :: first(:)
    !> Rows by octave, without those whose radius is not positive
    integer(ip), allocatable, intent(out) :: row(:)
    integer(ip), allocatable :: octave(:), all_first(:), all_row(:)
    integer :: lowest, highest, k

    if (size(radius) == 1) then
      if (radius(1) > 0) then
        first = [1, rows + 1]
        row = [(k, k=1, rows)]
      else
        first = [1]
        allocate (row(0))
      end if
      return
    end if
    lowest = huge(lowest)
    highest = -huge(highest)
    do k = 1, rows
      if (.not. radius(k) > 0) cycle
      lowest = min(lowest, exponent(radius(k)))
      highest = max(highest, exponent(radius(k)))
    end do
    if (lowest > highest) then
      first = [1]
      allocate (row(0))
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

  !> Search for the neighbours of some rows of similar radius.
  subroutine search_octave(x, y, radius, target, rows, chunk_rows, everyone, length, &
                           chunks, chunks_done)
    real(wp), intent(in) :: x(:), y(:), radius(:)
    !> The particle of each row of the list
    integer(ip), intent(in) :: target(:)
    !> The rows to be searched
    integer(ip), intent(in) :: rows(:)
    !> Rows per chunk
    integer, intent(in) :: chunk_rows
    !> Whether these are all particles in their own order
    logical, intent(in) :: everyone
    !> Number of neighbours of each row of the list
    integer(i8), intent(inout) :: length(:)
    !> What was found
    type(chunk_t), intent(inout) :: chunks(:)
    !> Number of chunks in use
    integer, intent(inout) :: chunks_done
    type(cell_list_t) :: cells
    integer(ip), allocatable :: key(:), first(:), order(:)
    integer :: k

    call build_cell_list(x, y, cell_size(radius, rows), cells)
    if (everyone) then
      call search_chunks(cells, x, y, radius, target, cells%first, cells%particle, chunk_rows, &
                         length, chunks, chunks_done)
    else
      allocate (key(size(rows)))
      do k = 1, size(rows)
        key(k) = cells%bucket(cells%column(x(target(rows(k)))), cells%row(y(target(rows(k)))))
      end do
      call counting_sort(key, cells%buckets, first, order)
      order = rows(order)
      call search_chunks(cells, x, y, radius, target, first, order, chunk_rows, length, &
                         chunks, chunks_done)
    end if
  end subroutine search_octave

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

  !> Search for the neighbours of rows that are sorted by the buckets of their targets.
  subroutine search_chunks(cells, x, y, radius, target, first, row, chunk_rows, length, &
                           chunks, chunks_done)
    type(cell_list_t), intent(in) :: cells
    real(wp), intent(in) :: x(:), y(:), radius(:)
    !> The particle of each row of the list
    integer(ip), intent(in) :: target(:)
    !> Where each bucket begins in `row`, and the rows
    integer(ip), intent(in) :: first(:), row(:)
    !> Rows per chunk
    integer, intent(in) :: chunk_rows
    !> Number of neighbours of each row of the list
    integer(i8), intent(inout) :: length(:)
    type(chunk_t), intent(inout) :: chunks(:)
    integer, intent(inout) :: chunks_done
    integer :: chunk, chunks_new, from, to

    chunks_new = (size(row) + chunk_rows - 1)/chunk_rows
    !$omp parallel do if (chunks_new > 1) default(none) private(from, to) schedule(dynamic) &
    !$omp shared(chunks_new, chunks_done, chunk_rows, chunks, cells, x, y, radius, target) &
    !$omp shared(first, row, length)
    do chunk = 1, chunks_new
      from = (chunk - 1)*chunk_rows + 1
      to = min(chunk*chunk_rows, size(row))
      call search_chunk(cells, x, y, radius, target, first, row, from, to, length, &
                        chunks(chunks_done + chunk))
    end do
    !$omp end parallel do
    chunks_done = chunks_done + chunks_new
  end subroutine search_chunks

  !> Search for the neighbours of the rows of one chunk.
  subroutine search_chunk(cells, x, y, radius, target, first, row, from, to, length, chunk)
    type(cell_list_t), intent(in) :: cells
    real(wp), intent(in) :: x(:), y(:), radius(:)
    integer(ip), intent(in) :: target(:)
    integer(ip), intent(in) :: first(:), row(:)
    !> First and last of the rows of this chunk
    integer, intent(in) :: from, to
    integer(i8), intent(inout) :: length(:)
    type(chunk_t), intent(inout) :: chunk
    type(candidates_t) :: candidates
    real(wp) :: r, reach
    integer(i8) :: column, found, found_before, row_of_cells
    integer :: k, last, particle, slot

    chunk%row = row(from:to)
    ! Room for a usual number of neighbours. What is not used costs nothing.
    allocate (chunk%found(32_i8*size(chunk%row)))
    call prefer_huge_pages(chunk%found)
    found = 0
    last = from - 1
    do while (last < to)
      k = last + 1
      particle = target(row(k))
      column = cells%column(x(particle))
      row_of_cells = cells%row(y(particle))
      last = min(first(cells%bucket(column, row_of_cells) + 1) - 1, to)
      if (cells%shared) last = last_in_cell(k, last)
      reach = radius_of(k)
      if (size(radius) > 1) then
        do particle = k + 1, last
          reach = max(reach, radius_of(particle))
        end do
      end if
      call gather_candidates(cells, column, row_of_cells, reach, candidates)

      do k = k, last
        slot = place_in(candidates%particle(:candidates%number), target(row(k)))
        call make_room(chunk%found, found, candidates%number)
        found_before = found
        r = radius_of(k)
        call append_within(candidates%number, candidates%particle, candidates%x, candidates%y, &
                           slot, r*r, chunk%found, found)
        length(row(k)) = found - found_before
      end do
    end do

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
        if (cells%column(x(target(row(last + 1)))) /= column) exit
        if (cells%row(y(target(row(last + 1)))) /= row_of_cells) exit
      end do
    end function last_in_cell

  end subroutine search_chunk

  !> Append the particles nearer to candidate `slot` than a radius, without itself.
  pure subroutine append_within(number, particle, x, y, slot, radius_squared, found, last)
    integer, intent(in) :: number
    integer(ip), intent(in) :: particle(number)
    real(wp), intent(in) :: x(number), y(number)
    integer, intent(in) :: slot
    real(wp), intent(in) :: radius_squared
    !> With room for all candidates after `last`
    integer(ip), intent(inout), contiguous :: found(:)
    !> Number of particles in `found`
    integer(i8), intent(inout) :: last
    real(wp) :: x_slot, y_slot
    integer :: from(2), k, part, to(2)

    x_slot = x(slot)
    y_slot = y(slot)
    from = [1, slot + 1]
    to = [slot - 1, number]
    ! One loop body for both parts: rounded differently, lists might lose their symmetry
    do part = 1, 2
      do k = from(part), to(part)
        ! Each is written, and kept by counting on: a branch would often be guessed wrongly
        found(last + 1) = particle(k)
        last = last + merge(1, 0, (x(k) - x_slot)**2 + (y(k) - y_slot)**2 < radius_squared)
      end do
    end do
  end subroutine append_within

  !> Gather, in ascending order, all particles that may be within reach of those in a cell.
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
    if (candidates%number <= most_to_rank) then
      call sort_by_ranking(candidates%number, candidates%raw_particle, candidates%raw_x, &
                           candidates%raw_y, candidates%particle, candidates%x, candidates%y)
    else
      call sort_by_merging(candidates)
    end if
  end subroutine gather_candidates

  !> Append the particles of a range of buckets, unsorted.
  pure subroutine take_buckets(cells, from, to, candidates)
    type(cell_list_t), intent(in) :: cells
    !> First and last bucket
    integer(ip), intent(in) :: from, to
    type(candidates_t), intent(inout) :: candidates
    integer :: number, place

    number = candidates%number
    call reserve(candidates, number + cells%first(to + 1) - cells%first(from))
    do place = cells%first(from), cells%first(to + 1) - 1
      number = number + 1
      candidates%raw_particle(number) = cells%particle(place)
      candidates%raw_x(number) = cells%x(place)
      candidates%raw_y(number) = cells%y(place)
    end do
    candidates%number = number
  end subroutine take_buckets

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

  !> Where a number stands in an ascending sequence that contains it.
  pure function place_in(sequence, number) result(place)
    integer(ip), intent(in), contiguous :: sequence(:)
    integer(ip), intent(in) :: number
    integer :: place
    integer :: k

    ! No bisection, as each of its steps would be guessed wrongly half the time
    place = 1
    !$omp simd reduction(+: place)
    do k = 1, size(sequence)
      place = place + merge(1, 0, sequence(k) < number)
    end do
  end function place_in

  !> Make sure that so many more elements fit behind those in use.
  pure subroutine make_room(found, used, more)
    integer(ip), allocatable, intent(inout) :: found(:)
    integer(i8), intent(in) :: used
    integer, intent(in) :: more
    integer(ip), allocatable :: larger(:)

    ! One more than can be found, as the sweep writes before it counts
    if (used + more + 1 <= size(found, kind=i8)) return
    allocate (larger(2*size(found, kind=i8) + more + 1))
    larger(:used) = found(:used)
    call move_alloc(larger, found)
  end subroutine make_room

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
    size_new = max(2*most_to_rank, most + most/2)
    allocate (larger%particle(size_new), larger%x(size_new), larger%y(size_new))
    allocate (larger%raw_particle(size_new), larger%raw_x(size_new), larger%raw_y(size_new))
    allocate (larger%key(size_new), larger%spare(size_new), larger%run(size_new + 1))
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
  end subroutine reserve

  !> Copy what a chunk found to where it belongs in the list.
  pure subroutine put_in_place(chunk, first, index)
    type(chunk_t), intent(inout) :: chunk
    integer(i8), intent(in) :: first(:)
    integer(ip), intent(inout) :: index(:)
    integer(i8) :: entry, length, start, taken
    integer :: k

    taken = 0
    do k = 1, size(chunk%row)
      length = first(chunk%row(k) + 1) - first(chunk%row(k))
      start = first(chunk%row(k)) - 1
      do entry = 1, length
        index(start + entry) = chunk%found(taken + entry)
      end do
      taken = taken + length
    end do
    deallocate (chunk%found, chunk%row)
  end subroutine put_in_place

end submodule calor_neighbour_search
