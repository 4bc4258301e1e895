!> Rows of an operator laid out for speed: what a step of the heat equation streams through.
!>
!> Eight rows side by side make a slice: entry k of all of them stands together, so that one
!> vector instruction works on eight rows, and one loop of fixed length takes the place of eight
!> short ones of lengths that no processor can guess. Within windows of 32 particles rows are
!> sorted by length, so that little is filled up; what still sticks out, as of a few long rows
!> beside a wall, is appended to the slice. The sum of a row is Σ a_ij (u_j - u_i): the diagonal is
!> not stored, and constants are steady to the last bit. Every particle has a row; those without
!> weights have an empty one. (Sliced ELLPACK: M. Kreutzer, G. Hager, G. Wellein, H. Fehske,
!> A.R. Bishop, SIAM J. Sci. Comput. 36 (2014) C401–C423.)
!>
!> The sums are those of `sparse_operator_t`, taken in the same order whatever the number of
!> threads. On large clouds a sweep takes as long as its bytes take from memory, most of which are
!> weights: they may be kept as single precision numbers. Products and sums have double precision
!> all the same, and constants stay steady.
module calor_streamed_rows
  use calor_constants, only: worth_threads
  use calor_huge_pages, only: prefer_huge_pages
  use calor_kinds, only: wp, sp, ip, i8
  use calor_sparse_operator, only: sparse_operator_t
  implicit none (type, external)
  private

  public :: streamed_rows_t

  !> Rows of a slice, and particles among which rows are sorted by length
  integer, parameter :: lanes = 8, window = 32
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
    !> The particle in each lane of each slice; 0: none, in the last slice only
    integer(ip), allocatable :: particle(:)
    !> Entries, in units of `lanes`, that lie before a slice; one element more than slices
    integer(i8), allocatable :: before(:)
    integer(ip), allocatable :: index(:)
    !> Weights, in one precision or the other, in units of `scale`
    real(wp), allocatable :: weight(:)
    real(sp), allocatable :: short_weight(:)
    !> A power of 2 that keeps weights in the range of single precision; else 1
    real(wp) :: scale = 1.0_wp
    !> What sticks out of the slices: how much lies before each slice, and lane, index and weight
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
    integer, allocatable :: length(:)
    integer :: row, slice

    allocate (row_of(particles), source=0_ip)
    allocate (length(particles), source=0)
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
    end do
    !$omp end parallel do
    if (.not. balanced) return
    this%particles = particles
    this%slices = (particles + lanes - 1)/lanes
    this%source_rows = operator%rows()
    this%source_entries = size(operator%index, kind=i8)
    call sort_by_length(this, length)
    call measure_slices(this, length)
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
    integer(ip) :: particle
    integer :: begin, k, place

    allocate (this%particle(lanes*this%slices), source=0_ip)
    do begin = 1, this%particles, window
      do k = begin, min(begin + window - 1, this%particles)
        particle = k
        place = k
        do while (place > begin)
          if (length(this%particle(place - 1)) >= length(particle)) exit
          this%particle(place) = this%particle(place - 1)
          place = place - 1
        end do
        this%particle(place) = particle
      end do
    end do
  end subroutine sort_by_length

  !> How wide each slice is, and what sticks out of it.
  pure subroutine measure_slices(this, length)
    type(streamed_rows_t), intent(inout) :: this
    integer, intent(in) :: length(:)
    integer :: lengths(lanes), candidate, cost, least, lane, slice, width

    allocate (this%before(this%slices + 1), this%over_before(this%slices + 1))
    this%before(1) = 0
    this%over_before(1) = 0
    do slice = 1, this%slices
      lengths = 0
      do lane = 1, lanes
        associate (particle => this%particle(lane + lanes*(slice - 1)))
          if (particle > 0) lengths(lane) = length(particle)
        end associate
      end do
      least = huge(least)
      width = 0
      do candidate = 1, lanes
        cost = lanes*lengths(candidate) + &
               cost_of_overflow*sum(max(0, lengths - lengths(candidate)))
        if (cost >= least) cycle
        least = cost
        width = lengths(candidate)
      end do
      this%before(slice + 1) = this%before(slice) + width
      this%over_before(slice + 1) = this%over_before(slice) + sum(max(0, lengths - width))
    end do
  end subroutine measure_slices

  !> Indices and weights of a slice; what is filled up has the row's own particle and no weight.
  pure subroutine fill_slice(this, operator, row_of, length, slice)
    type(streamed_rows_t), intent(inout) :: this
    type(sparse_operator_t), intent(in) :: operator
    integer(ip), intent(in) :: row_of(:)
    integer, intent(in) :: length(:)
    integer, intent(in) :: slice
    integer(i8) :: from, place, over
    real(wp) :: weight
    integer(ip) :: particle
    integer :: k, lane, width, row_length

    width = int(this%before(slice + 1) - this%before(slice))
    over = this%over_before(slice)
    do lane = 1, lanes
      particle = this%particle(lane + lanes*(slice - 1))
      row_length = 0
      from = 1
      if (particle > 0) then
        row_length = length(particle)
        if (row_length > 0) from = operator%first(row_of(particle))
      end if
      do k = 1, width
        place = lane + lanes*(this%before(slice) + k - 1)
        if (k <= row_length) then
          this%index(place) = operator%index(from + k - 1)
          weight = operator%weight(from + k - 1)/this%scale
        else
          this%index(place) = max(1_ip, particle)
          weight = 0
        end if
        if (allocated(this%weight)) then
          this%weight(place) = weight
        else
          this%short_weight(place) = real(weight, sp)
        end if
      end do
      do k = width + 1, row_length
        over = over + 1
        this%over_lane(over) = lane
        this%over_index(over) = operator%index(from + k - 1)
        this%over_weight(over) = operator%weight(from + k - 1)/this%scale
      end do
    end do
  end subroutine fill_slice

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
    real(wp) :: total(lanes), own(lanes), scaled
    integer :: slice, lane, last

    scaled = factor*this%scale
    !$omp parallel do if (this%particles > worth_threads) schedule(static) default(shared) &
    !$omp private(slice, lane, last, total, own)
    do slice = 1, this%slices
      last = min(lanes, this%particles - lanes*(slice - 1))
      call sum_slice(this, slice, last, u, own, total)
      do lane = 1, last
        derivative(this%particle(lane + lanes*(slice - 1))) = scaled*total(lane)
      end do
    end do
    !$omp end parallel do
  end subroutine apply

  !> older ← c₁ newer + c₂ older + c₅ A newer, and where they are given + c₃ start + c₄ rate_start
  subroutine combine(this, c, newer, older, start, rate_start)
    class(streamed_rows_t), intent(in) :: this
    !> The five factors
    real(wp), intent(in) :: c(5)
    !> Fields at all particles
    real(wp), intent(in), contiguous :: newer(:)
    real(wp), intent(inout), contiguous :: older(:)
    real(wp), intent(in), contiguous, optional :: start(:), rate_start(:)
    real(wp) :: total(lanes), own(lanes), scaled
    integer :: i, slice, lane, last
    logical :: with_start

    scaled = c(5)*this%scale

    with_start = present(start) .and. present(rate_start)
    !$omp parallel do if (this%particles > worth_threads) schedule(static) default(shared) &
    !$omp private(slice, lane, last, total, own, i)
    do slice = 1, this%slices
      last = min(lanes, this%particles - lanes*(slice - 1))
      call sum_slice(this, slice, last, newer, own, total)
      if (with_start) then
        do lane = 1, last
          i = this%particle(lane + lanes*(slice - 1))
          older(i) = c(1)*own(lane) + c(2)*older(i) + c(3)*start(i) + c(4)*rate_start(i) + &
                     scaled*total(lane)
        end do
      else
        do lane = 1, last
          i = this%particle(lane + lanes*(slice - 1))
          older(i) = c(1)*own(lane) + c(2)*older(i) + scaled*total(lane)
        end do
      end if
    end do
    !$omp end parallel do
  end subroutine combine

  !> Σ a_ij (u_j - u_i) of the rows of a slice, in units of the weights' scale, and their u_i.
  pure subroutine sum_slice(this, slice, last, u, own, total)
    type(streamed_rows_t), intent(in) :: this
    !> The slice, and its last lane in use
    integer, intent(in) :: slice, last
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(out) :: own(lanes), total(lanes)
    integer(i8) :: k, entry
    integer :: lane

    own = 0
    do lane = 1, last
      own(lane) = u(this%particle(lane + lanes*(slice - 1)))
    end do
    total = 0
    if (allocated(this%weight)) then
      do k = lanes*this%before(slice), lanes*this%before(slice + 1) - lanes, lanes
        !$omp simd
        do lane = 1, lanes
          total(lane) = total(lane) + this%weight(k + lane)*(u(this%index(k + lane)) - own(lane))
        end do
      end do
    else
      do k = lanes*this%before(slice), lanes*this%before(slice + 1) - lanes, lanes
        !$omp simd
        do lane = 1, lanes
          total(lane) = total(lane) + real(this%short_weight(k + lane), wp)* &
                        (u(this%index(k + lane)) - own(lane))
        end do
      end do
    end if
    do entry = this%over_before(slice) + 1, this%over_before(slice + 1)
      associate (l => this%over_lane(entry))
        total(l) = total(l) + this%over_weight(entry)*(u(this%over_index(entry)) - own(l))
      end associate
    end do
  end subroutine sum_slice

  pure function bytes(this) result(number)
    class(streamed_rows_t), intent(in) :: this
    integer(i8) :: number

    number = 0
    if (.not. allocated(this%index)) return
    number = (size(this%particle, kind=i8)*storage_size(this%particle) + &
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
