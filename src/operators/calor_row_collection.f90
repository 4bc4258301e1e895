!> Rows that were assembled a few at a time, put together into one operator.
!>
!> Where supports grow row by row, most rows are good at the first attempt and others after a few:
!> each is kept as soon as it is good, so that none is assembled twice.
module calor_row_collection
  use calor_constants, only: worth_threads
  use calor_huge_pages, only: prefer_huge_pages
  use calor_kinds, only: wp, ip, i8
  use calor_row_report, only: row_report_t
  use calor_sparse_operator, only: sparse_operator_t
  implicit none (type, external)
  private

  public :: row_collection_t

  !> The rows of one attempt
  type :: attempt_t
    type(sparse_operator_t) :: operator
    type(row_report_t) :: report
  end type attempt_t

  type :: row_collection_t
    private
    type(attempt_t), allocatable :: attempts(:)
    integer :: number = 0
    !> For each row in which attempt it was last, and where there
    integer, allocatable :: attempt_of(:), place_in(:)
  contains
    !> Begin with a number of rows
    procedure :: start
    !> Take what an attempt assembled
    procedure :: take
    !> Put all together
    procedure :: merge_into
  end type row_collection_t

contains

  subroutine start(this, rows)
    class(row_collection_t), intent(out) :: this
    !> Number of rows
    integer, intent(in) :: rows

    allocate (this%attempts(4), this%attempt_of(rows), this%place_in(rows))
    this%attempt_of = 0
    this%place_in = 0
  end subroutine start

  !> A row that was in an earlier attempt is from now on that of this one.
  subroutine take(this, rows, operator, report)
    class(row_collection_t), intent(inout) :: this
    !> Which rows they are
    integer(ip), intent(in) :: rows(:)
    !> What was assembled, a row for each; its arrays are moved
    type(sparse_operator_t), intent(inout) :: operator
    !> What is known of them; moved
    type(row_report_t), intent(inout) :: report
    type(attempt_t), allocatable :: longer(:)
    integer :: k

    if (this%number == size(this%attempts)) then
      allocate (longer(2*this%number))
      do k = 1, this%number
        call this%attempts(k)%operator%move_to(longer(k)%operator)
        call this%attempts(k)%report%move_to(longer(k)%report)
      end do
      call move_alloc(longer, this%attempts)
    end if
    this%number = this%number + 1
    call operator%move_to(this%attempts(this%number)%operator)
    call report%move_to(this%attempts(this%number)%report)
    do k = 1, size(rows)
      this%attempt_of(rows(k)) = this%number
      this%place_in(rows(k)) = k
    end do
  end subroutine take

  !> One operator of all rows, each from the last attempt that had it. Every row must have been in
  !> one. Nothing is left of the collection.
  subroutine merge_into(this, operator, report)
    class(row_collection_t), intent(inout) :: this
    !> All rows
    type(sparse_operator_t), intent(out) :: operator
    !> What is known of them
    type(row_report_t), intent(out) :: report
    integer(i8) :: from, length, place
    integer :: row, rows

    if (this%number == 1) then
      call this%attempts(1)%operator%move_to(operator)
      call this%attempts(1)%report%move_to(report)
      return
    end if
    rows = size(this%attempt_of)
    allocate (operator%target(rows), operator%first(rows + 1), operator%diagonal(rows))
    call report%reserve(rows)
    place = 1
    do row = 1, rows
      operator%first(row) = place
      associate (source => this%attempts(this%attempt_of(row))%operator, k => this%place_in(row))
        place = place + source%first(k + 1) - source%first(k)
      end associate
    end do
    operator%first(rows + 1) = place
    allocate (operator%index(place - 1), operator%weight(place - 1))
    call prefer_huge_pages(operator%index)
    call prefer_huge_pages(operator%weight)
    !$omp parallel do if (rows > worth_threads) schedule(static) default(shared) &
    !$omp private(row, from, length)
    do row = 1, rows
      associate (source => this%attempts(this%attempt_of(row)), k => this%place_in(row), &
                 to => operator%first(row))
        from = source%operator%first(k)
        length = source%operator%first(k + 1) - from
        operator%index(to:to + length - 1) = source%operator%index(from:from + length - 1)
        operator%weight(to:to + length - 1) = source%operator%weight(from:from + length - 1)
        operator%target(row) = source%operator%target(k)
        operator%diagonal(row) = source%operator%diagonal(k)
        report%condition_gradient(row) = source%report%condition_gradient(k)
        report%condition_laplacian(row) = source%report%condition_laplacian(k)
        report%residual(row) = source%report%residual(k)
      end associate
    end do
    !$omp end parallel do
    deallocate (this%attempts)
  end subroutine merge_into

end module calor_row_collection
