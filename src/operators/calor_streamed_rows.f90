!> Rows of an operator laid out for speed: what a step of the heat equation streams through.
!>
!> Eight rows side by side make a slice: entry k of all of them stands together, so that one
!> vector instruction works on eight rows, and one loop of fixed length takes the place of eight
!> short ones of lengths that no processor can guess. Within windows of 32 particles rows are
!> sorted by length, so that little is filled up; what still sticks out, as of a few long rows
!> beside a wall, is appended to the slice. Particles that are near each other have numbers that are
!> near each other, along Hilbert's curve nearly all: two bytes tell where a neighbour is from its
!> slice, and those too far away for that are appended as well. The sum of a row is Σ a_ij (u_j -
!> u_i): the diagonal is not stored, and constants are steady to the last bit. Every particle has a
!> row; those without weights have an empty one. (Sliced ELLPACK: M. Kreutzer, G. Hager, G. Wellein,
!> H. Fehske, A.R. Bishop, SIAM J. Sci. Comput. 36 (2014) C401–C423.)
!>
!> The sums are those of `sparse_operator_t` up to rounding, taken in one order whatever the number
!> of threads. On large clouds a sweep takes as long as its bytes take from memory. Most of these
!> are weights: they may be kept as single precision numbers. Products and sums have double
!> precision all the same, and constants stay steady.
module calor_streamed_rows
  use calor_constants, only: worth_threads
  use calor_huge_pages, only: prefer_huge_pages
  use calor_kinds, only: wp, sp, ip, i1, i2, i8
  use calor_sparse_operator, only: sparse_operator_t
  use omp_lib, only: omp_get_max_threads
  implicit none (type, external)
  private

  public :: streamed_rows_t

  !> Rows of a slice, and particles among which rows are sorted by length
  integer, parameter :: lanes = 8, window = 32
  !> What the sum of a row is added to: nothing, two terms of a recurrence, or two stages and a
  !> step's start
  integer, parameter :: sum_alone = 0, with_terms = 1, with_start = 2
  !> So many consecutive particles a slice may have neighbours among, by two bytes each
  integer, parameter :: reach = 2**bit_size(0_i2)
  !> An entry that sticks out costs as much as so many in a slice
  integer, parameter :: cost_of_overflow = 3
  !> A row whose weights do not sum to zero, in units of their magnitudes, has a diagonal of its own
  real(wp), parameter :: largest_sum = 1.0e-12_wp

  type :: streamed_rows_t
    private
    !> Number of particles and of slices
    integer :: particles = 0, slices = 0
    !> The operator that this was made from had so many rows and entries
    integer :: source_rows = -1
    integer(i8) :: source_entries = -1
    !> Where in the window of its slice the particle of each lane is, from 0; where there is none,
    !> in the last slice, the last one's place
    integer(i1), allocatable :: place(:)
    !> Entries, in units of `lanes`, that lie before a slice; one element more than slices
    integer(i8), allocatable :: before(:)
    !> Neighbours, counted from -reach/2 at the first one in the reach of a slice
    integer(i2), allocatable :: index(:)
    !> Weights, in one precision or the other, in units of `scale`
    real(wp), allocatable :: weight(:)
    real(sp), allocatable :: short_weight(:)
    !> A power of 2 that keeps weights in the range of single precision; else 1
    real(wp) :: scale = 1.0_wp
    !> What sticks out of the slices or lies out of their reach: how much lies before each slice,
    !> and lane, neighbour and weight
    integer(i8), allocatable :: over_before(:)
    integer(ip), allocatable :: over_lane(:), over_index(:)
    real(wp), allocatable :: over_weight(:)
  contains
    !> Lay out the rows of an operator
    procedure :: lay_out
    !> Whether this was made from an operator of this shape
    procedure :: stands_for
    !> A multiple of the derivative of a field at all particles
    procedure :: apply
    !> The same, added to multiples of other fields
    procedure :: combine
    !> The same as the next term of a recurrence of three
    procedure :: recur
    !> Memory in use, bytes
    procedure :: bytes
  end type streamed_rows_t

contains

  !> Lay out rows. Not done, so that the result stands for nothing, where rows have a diagonal that
  !> is not minus the sum of the others, or particles have several rows.
  subroutine lay_out(this, operator, particles, single)
    class(streamed_rows_t), intent(out) :: this
    !> The rows
    type(sparse_operator_t), intent(in) :: operator
    !> Number of particles
    integer, intent(in) :: particles
    !> Whether to keep weights in single precision; without it not
    logical, intent(in), optional :: single
    integer(ip), allocatable :: row_of(:)
    logical :: short, balanced
    integer, allocatable :: length(:), near(:)
    integer :: row, slice

    allocate (row_of(particles), source=0_ip)
    allocate (length(particles), near(particles), source=0)
    do row = 1, operator%rows()
      associate (particle => operator%target(row))
        if (row_of(particle) > 0) return
        row_of(particle) = row
        length(particle) = int(operator%first(row + 1) - operator%first(row))
      end associate
    end do
    balanced = .true.
    !$omp parallel do if (particles > worth_threads) schedule(static) default(shared) private(row) &
    !$omp reduction(.and.: balanced)
    do row = 1, operator%rows()
      balanced = balanced .and. is_balanced(operator, row)
      associate (particle => operator%target(row), first => operator%first)
        near(particle) = count(is_near(operator%index(first(row):first(row + 1) - 1), &
                                       reach_of(particle, particles)))
      end associate
    end do
    !$omp end parallel do
    if (.not. balanced) return
    this%particles = particles
    this%slices = (particles + lanes - 1)/lanes
    this%source_rows = operator%rows()
    this%source_entries = size(operator%index, kind=i8)
    call sort_by_length(this, near)
    call measure_slices(this, length, near)
    associate (entries => lanes*this%before(this%slices + 1), &
               more => this%over_before(this%slices + 1))
      short = .false.
      if (present(single)) short = single
      allocate (this%index(entries))
      if (short) then
        allocate (this%short_weight(entries))
        call prefer_huge_pages(this%short_weight)
        this%scale = scale_of(operator%weight)
      else
        allocate (this%weight(entries))
        call prefer_huge_pages(this%weight)
      end if
      allocate (this%over_lane(more), this%over_index(more), this%over_weight(more))
    end associate
    call prefer_huge_pages(this%index)
    ! Every thread is the first to touch what it will stream through
    !$omp parallel do if (particles > worth_threads) schedule(static) default(shared) private(slice)
    do slice = 1, this%slices
      call fill_slice(this, operator, row_of, length, slice)
    end do
    !$omp end parallel do
  end subroutine lay_out

  !> Whether the diagonal of a row is minus the sum of its other weights
  pure function is_balanced(operator, row) result(answer)
    type(sparse_operator_t), intent(in) :: operator
    integer, intent(in) :: row
    logical :: answer

    associate (weight => operator%weight(operator%first(row):operator%first(row + 1) - 1))
      answer = abs(operator%diagonal(row) + sum(weight)) <= largest_sum*sum(abs(weight))
    end associate
  end function is_balanced

  !> The power of 2 next to the largest magnitude of some numbers, 1 where all are 0
  pure function scale_of(weight) result(scale)
    real(wp), intent(in) :: weight(:)
    real(wp) :: scale
    real(wp) :: largest
    integer(i8) :: k

    largest = 0
    do k = 1, size(weight, kind=i8)
      largest = max(largest, abs(weight(k)))
    end do
    scale = 1
    if (largest > 0) scale = 2.0_wp**(exponent(largest) - 1)
  end function scale_of

  !> Which particle goes where: window after window, the longest rows first, equal ones in their
  !> order.
  pure subroutine sort_by_length(this, length)
    type(streamed_rows_t), intent(inout) :: this
    integer, intent(in) :: length(:)
    integer :: before, k, last, lane
    integer(i1) :: place

    allocate (this%place(lanes*this%slices))
    do before = 0, this%particles - 1, window
      last = min(window, this%particles - before)
      do k = 1, last
        place = int(k - 1, i1)
        lane = k
        do while (lane > 1)
          if (length(before + this%place(before + lane - 1) + 1) >= length(before + k)) exit
          this%place(before + lane) = this%place(before + lane - 1)
          lane = lane - 1
        end do
        this%place(before + lane) = place
      end do
      this%place(before + last + 1:min(before + window, lanes*this%slices)) = int(last - 1, i1)
    end do
  end subroutine sort_by_length

  !> The particles of a slice
  pure function members(this, slice) result(particle)
    type(streamed_rows_t), intent(in) :: this
    integer, intent(in) :: slice
    integer(ip) :: particle(lanes)
    integer :: before

    before = lanes*(slice - 1)
    particle = this%place(before + 1:before + lanes) + (before - mod(before, window) + 1)
  end function members

  !> The first of the particles that two bytes can tell apart for some particle, and for all others
  !> in its window.
  pure function reach_of(particle, particles) result(first)
    integer, intent(in) :: particle
    !> How many there are
    integer, intent(in) :: particles
    integer :: first

    first = max(1, min(window*((particle - 1)/window) - reach/2, particles - reach + 1))
  end function reach_of

  !> Whether a particle is in a reach.
  elemental function is_near(particle, first) result(answer)
    integer(ip), intent(in) :: particle
    !> Where the reach begins
    integer, intent(in) :: first
    logical :: answer

    answer = particle >= first .and. particle - first < reach
  end function is_near

  !> How wide each slice is, and what sticks out of it or lies out of its reach.
  pure subroutine measure_slices(this, length, near)
    type(streamed_rows_t), intent(inout) :: this
    !> Lengths of rows, and without what lies out of reach
    integer, intent(in) :: length(:), near(:)
    integer :: all_near(lanes), candidate, cost, entries, lane, least, slice, width
    integer(ip) :: particle(lanes)

    allocate (this%before(this%slices + 1), this%over_before(this%slices + 1))
    this%before(1) = 0
    this%over_before(1) = 0
    do slice = 1, this%slices
      all_near = 0
      entries = 0
      particle = members(this, slice)
      do lane = 1, min(lanes, this%particles - lanes*(slice - 1))
        all_near(lane) = near(particle(lane))
        entries = entries + length(particle(lane))
      end do
      least = huge(least)
      width = 0
      do candidate = 1, lanes
        cost = lanes*all_near(candidate) + &
               cost_of_overflow*sum(max(0, all_near - all_near(candidate)))
        if (cost >= least) cycle
        least = cost
        width = all_near(candidate)
      end do
      this%before(slice + 1) = this%before(slice) + width
      this%over_before(slice + 1) = this%over_before(slice) + entries - sum(min(width, all_near))
    end do
  end subroutine measure_slices

  !> Indices and weights of a slice; what is filled up has the row's own particle and no weight.
  pure subroutine fill_slice(this, operator, row_of, length, slice)
    type(streamed_rows_t), intent(inout) :: this
    type(sparse_operator_t), intent(in) :: operator
    integer(ip), intent(in) :: row_of(:)
    integer, intent(in) :: length(:)
    integer, intent(in) :: slice
    integer(i8) :: before, from, over
    integer(ip) :: particle(lanes)
    integer :: entries, first, k, lane, used, width

    width = int(this%before(slice + 1) - this%before(slice))
    before = lanes*this%before(slice)
    over = this%over_before(slice)
    first = reach_of(lanes*(slice - 1) + 1, this%particles)
    particle = members(this, slice)
    do lane = 1, lanes
      entries = 0
      if (lane + lanes*(slice - 1) <= this%particles) entries = length(particle(lane))
      from = 0
      if (entries > 0) from = operator%first(row_of(particle(lane))) - 1
      used = 0
      do k = 1, entries
        associate (neighbour => operator%index(from + k), &
                   weight => operator%weight(from + k)/this%scale)
          if (used < width .and. is_near(neighbour, first)) then
            used = used + 1
            call put_entry(this, before + lanes*(used - 1) + lane, neighbour - first, weight)
          else
            over = over + 1
            this%over_lane(over) = lane
            this%over_index(over) = neighbour
            this%over_weight(over) = weight
          end if
        end associate
      end do
      do k = used + 1, width
        call put_entry(this, before + lanes*(k - 1) + lane, particle(lane) - first, 0.0_wp)
      end do
    end do

  end subroutine fill_slice

  pure subroutine put_entry(this, place, index, weight)
    type(streamed_rows_t), intent(inout) :: this
    !> Where in the arrays
    integer(i8), intent(in) :: place
    !> How far the neighbour lies behind the beginning of the reach
    integer, intent(in) :: index
    real(wp), intent(in) :: weight

    this%index(place) = int(index - reach/2, i2)
    if (allocated(this%weight)) then
      this%weight(place) = weight
    else
      this%short_weight(place) = real(weight, sp)
    end if
  end subroutine put_entry

  pure function stands_for(this, operator) result(answer)
    class(streamed_rows_t), intent(in) :: this
    !> An operator; its weights are not compared
    type(sparse_operator_t), intent(in) :: operator
    logical :: answer

    answer = this%source_rows == size(operator%target)
    if (answer) answer = this%source_entries == size(operator%index, kind=i8)
  end function stands_for

  !> derivative ← factor A u; 0 at particles without a row
  subroutine apply(this, factor, u, derivative)
    class(streamed_rows_t), intent(in) :: this
    real(wp), intent(in) :: factor
    !> The field at all particles
    real(wp), intent(in), contiguous :: u(:)
    !> Field over all particles
    real(wp), intent(inout), contiguous :: derivative(:)
    real(wp) :: c(5)

    c = 0
    c(5) = factor
    call sweep(this, sum_alone, c, u, derivative, u, u)
  end subroutine apply

  !> older ← c₁ newer + c₂ older + c₃ start + c₄ rate_start + c₅ A newer
  subroutine combine(this, c, newer, older, start, rate_start)
    class(streamed_rows_t), intent(in) :: this
    !> The five factors
    real(wp), intent(in) :: c(5)
    !> Fields at all particles
    real(wp), intent(in), contiguous :: newer(:), start(:), rate_start(:)
    real(wp), intent(inout), contiguous :: older(:)

    call sweep(this, with_start, c, newer, older, start, rate_start)
  end subroutine combine

  !> older ← c₁ newer + c₂ (newer - older) + c₃ A newer
  subroutine recur(this, c, newer, older)
    class(streamed_rows_t), intent(in) :: this
    !> The three factors
    real(wp), intent(in) :: c(3)
    !> Fields at all particles
    real(wp), intent(in), contiguous :: newer(:)
    real(wp), intent(inout), contiguous :: older(:)

    call sweep(this, with_terms, [c(1:2), 0.0_wp, 0.0_wp, c(3)], newer, older, newer, newer)
  end subroutine recur

  !> All slices, a part of them on each thread.
  subroutine sweep(this, terms, c, newer, older, start, rate_start)
    type(streamed_rows_t), intent(in) :: this
    !> What the sums are added to
    integer, intent(in) :: terms
    !> The factors of `combine`, or of `recur`, the last one being the fifth
    real(wp), intent(in) :: c(5)
    real(wp), intent(in), contiguous :: newer(:), start(:), rate_start(:)
    real(wp), intent(inout), contiguous :: older(:)
    integer :: part, parts

    parts = omp_get_max_threads()
    !$omp parallel do if (this%particles > worth_threads) schedule(static) default(shared)
    do part = 1, parts
      call sweep_part(this, 1 + int((part - 1)*int(this%slices, i8)/parts), &
                      int(part*int(this%slices, i8)/parts), terms, [c(:4), c(5)*this%scale], &
                      this%particles, newer, older, start, rate_start)
    end do
    !$omp end parallel do
  end subroutine sweep

  !> Some slices. Arrays of given shape, here and below, have no strides to reckon with.
  pure subroutine sweep_part(this, from, to, terms, c, particles, newer, older, start, rate_start)
    type(streamed_rows_t), intent(in) :: this
    !> First and last of them
    integer, intent(in) :: from, to
    integer, intent(in) :: terms
    !> The five factors, the last one in units of the weights' scale
    real(wp), intent(in) :: c(5)
    integer, intent(in) :: particles
    real(wp), intent(in) :: newer(particles), start(particles), rate_start(particles)
    real(wp), intent(inout) :: older(particles)
    real(wp) :: own(lanes), total(lanes)
    integer(i8) :: before, entry
    integer(ip) :: particle(lanes)
    integer :: i, in_reach, lane, near, own_before, rows, slice, width

    do slice = from, to
      own_before = lanes*(slice - 1)
      particle = members(this, slice)
      do lane = 1, lanes
        own(lane) = newer(particle(lane))
      end do
      before = lanes*this%before(slice)
      width = int(this%before(slice + 1) - this%before(slice))
      near = reach_of(own_before + 1, particles)
      in_reach = min(reach, particles - near + 1)
      if (allocated(this%weight)) then
        call sum_near(width, this%index(before + 1:), this%weight(before + 1:), in_reach, &
                      newer(near), own, total)
      else
        call sum_near_short(width, this%index(before + 1:), this%short_weight(before + 1:), &
                            in_reach, newer(near), own, total)
      end if
      do entry = this%over_before(slice) + 1, this%over_before(slice + 1)
        associate (l => this%over_lane(entry))
          total(l) = total(l) + this%over_weight(entry)*(newer(this%over_index(entry)) - own(l))
        end associate
      end do
      rows = min(lanes, particles - own_before)
      select case (terms)
      case (with_start)
        do lane = 1, rows
          i = particle(lane)
          older(i) = c(1)*own(lane) + c(2)*older(i) + c(3)*start(i) + c(4)*rate_start(i) + &
                     c(5)*total(lane)
        end do
      case (with_terms)
        do lane = 1, rows
          i = particle(lane)
          older(i) = c(1)*own(lane) + c(2)*(own(lane) - older(i)) + c(5)*total(lane)
        end do
      case default
        do lane = 1, rows
          older(particle(lane)) = c(5)*total(lane)
        end do
      end select
    end do
  end subroutine sweep_part

  !> What entries within reach add to the rows of a slice.
  pure subroutine sum_near(width, index, weight, in_reach, near, own, total)
    integer, intent(in) :: width
    integer(i2), intent(in) :: index(lanes, width)
    real(wp), intent(in) :: weight(lanes, width)
    !> How many particles are in reach, and the field at these
    integer, intent(in) :: in_reach
    real(wp), intent(in) :: near(-reach/2:in_reach - reach/2 - 1)
    real(wp), intent(in) :: own(lanes)
    real(wp), intent(out) :: total(lanes)
    real(wp) :: sums(lanes), subtracted(lanes)
    integer :: k, lane

    ! Arrays of its own are kept in the registers of the vector units
    sums = 0
    subtracted = own
    do k = 1, width
      do lane = 1, lanes
        sums(lane) = sums(lane) + weight(lane, k)*(near(index(lane, k)) - subtracted(lane))
      end do
    end do
    total = sums
  end subroutine sum_near

  !> The same with weights in single precision.
  pure subroutine sum_near_short(width, index, weight, in_reach, near, own, total)
    integer, intent(in) :: width
    integer(i2), intent(in) :: index(lanes, width)
    real(sp), intent(in) :: weight(lanes, width)
    !> How many particles are in reach, and the field at these
    integer, intent(in) :: in_reach
    real(wp), intent(in) :: near(-reach/2:in_reach - reach/2 - 1)
    real(wp), intent(in) :: own(lanes)
    real(wp), intent(out) :: total(lanes)
    real(wp) :: sums(lanes), subtracted(lanes)
    integer :: k, lane

    ! Arrays of its own are kept in the registers of the vector units
    sums = 0
    subtracted = own
    do k = 1, width
      do lane = 1, lanes
        sums(lane) = sums(lane) + &
                     real(weight(lane, k), wp)*(near(index(lane, k)) - subtracted(lane))
      end do
    end do
    total = sums
  end subroutine sum_near_short

  pure function bytes(this) result(number)
    class(streamed_rows_t), intent(in) :: this
    integer(i8) :: number

    number = 0
    if (.not. allocated(this%index)) return
    number = (size(this%place, kind=i8)*storage_size(this%place) + &
              2*size(this%before, kind=i8)*storage_size(this%before) + &
              size(this%index, kind=i8)*storage_size(this%index) + &
              size(this%over_lane, kind=i8)*storage_size(this%over_lane) + &
              size(this%over_index, kind=i8)*storage_size(this%over_index) + &
              size(this%over_weight, kind=i8)*storage_size(this%over_weight))/8
    if (allocated(this%weight)) then
      number = number + size(this%weight, kind=i8)*storage_size(this%weight)/8
    else
      number = number + size(this%short_weight, kind=i8)*storage_size(this%short_weight)/8
    end if
  end function bytes

end module calor_streamed_rows
