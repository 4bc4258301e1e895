!> The sparse operator that every derivative scheme becomes.
module calor_sparse_operator
  use calor_constants, only: worth_threads
  use calor_huge_pages, only: prefer_huge_pages
  use calor_kinds, only: wp, ip, i8
  use calor_neighbour_list, only: neighbour_list_t
  implicit none (type, external)
  private

  public :: sparse_operator_t

  !> Rows of weights: (A u)_row = diagonal(row) u_i + Σ_k weight(k) u_index(k), with i = target(row)
  !> and k from first(row) to first(row + 1) - 1.
  type :: sparse_operator_t
    !> The particle whose derivative a row gives
    integer(ip), allocatable :: target(:)
    !> Where each row begins in `index` and `weight`; one element more than rows
    integer(i8), allocatable :: first(:)
    !> Neighbouring particles, row after row
    integer(ip), allocatable :: index(:)
    !> Their weights, in 1/m for a first and 1/m² for a second derivative
    real(wp), allocatable :: weight(:)
    !> The weight of the row's own particle
    real(wp), allocatable :: diagonal(:)
  contains
    !> Number of rows
    procedure :: rows
    !> Memory that the operator takes, bytes
    procedure :: bytes
    !> Take the rows and neighbours of a neighbour list, all weights 0
    procedure :: shape_as
    !> Add the rows of another operator after its own
    procedure :: append
    !> Hand all rows over, keeping none
    procedure :: move_to
    !> The derivative of a field at the targets
    procedure :: apply
    !> The same times a factor, laid down at the places of the target particles
    procedure :: apply_at_targets
    !> An upper bound of the real parts of the spectrum: 0 where no weight is negative
    procedure :: gershgorin_right_end
    !> An upper bound of |λ| over the spectrum
    procedure :: gershgorin_bound
  end type sparse_operator_t

contains

  pure function rows(this) result(number)
    class(sparse_operator_t), intent(in) :: this
    integer :: number

    number = size(this%target)
  end function rows

  pure function bytes(this) result(number)
    class(sparse_operator_t), intent(in) :: this
    integer(i8) :: number

    number = (size(this%target, kind=i8)*storage_size(this%target) + &
              size(this%first, kind=i8)*storage_size(this%first) + &
              size(this%index, kind=i8)*storage_size(this%index) + &
              size(this%weight, kind=i8)*storage_size(this%weight) + &
              size(this%diagonal, kind=i8)*storage_size(this%diagonal))/8
  end function bytes

  subroutine shape_as(this, list)
    class(sparse_operator_t), intent(out) :: this
    !> Whose rows and neighbours to take
    type(neighbour_list_t), intent(in) :: list

    integer(i8) :: k
    integer :: row

    associate (rows => list%rows())
      allocate (this%target(rows), this%first(rows + 1), this%diagonal(rows))
    end associate
    allocate (this%index(size(list%index, kind=i8)), this%weight(size(list%index, kind=i8)))
    call prefer_huge_pages(this%index)
    call prefer_huge_pages(this%weight)
    this%first(size(this%first)) = list%first(size(this%first))
    ! Every thread is the first to touch what it will work on
    !$omp parallel do if (list%rows() > worth_threads) schedule(static) default(shared) &
    !$omp private(row, k)
    do row = 1, size(this%target)
      this%target(row) = list%target(row)
      this%first(row) = list%first(row)
      this%diagonal(row) = 0
      do k = list%first(row), list%first(row + 1) - 1
        this%index(k) = list%index(k)
        this%weight(k) = 0
      end do
    end do
    !$omp end parallel do
  end subroutine shape_as

  subroutine move_to(this, other)
    class(sparse_operator_t), intent(inout) :: this
    !> Where they go
    type(sparse_operator_t), intent(out) :: other

    call move_alloc(this%target, other%target)
    call move_alloc(this%first, other%first)
    call move_alloc(this%index, other%index)
    call move_alloc(this%weight, other%weight)
    call move_alloc(this%diagonal, other%diagonal)
  end subroutine move_to

  subroutine append(this, other)
    class(sparse_operator_t), intent(inout) :: this
    !> The rows to add, at other particles
    type(sparse_operator_t), intent(in) :: other

    this%target = [this%target, other%target]
    this%first = [this%first, other%first(2:) + (this%first(size(this%first)) - 1)]
    this%index = [this%index, other%index]
    this%weight = [this%weight, other%weight]
    this%diagonal = [this%diagonal, other%diagonal]
  end subroutine append

  subroutine apply(this, u, derivative)
    class(sparse_operator_t), intent(in) :: this
    !> The field at all particles
    real(wp), intent(in) :: u(:)
    !> Its derivative at the target of each row
    real(wp), intent(out) :: derivative(:)
    real(wp) :: total
    integer(i8) :: k
    integer :: row

    !$omp parallel do if (size(this%target) > worth_threads) schedule(static) default(shared) &
    !$omp private(row, k, total)
    do row = 1, size(this%target)
      total = this%diagonal(row)*u(this%target(row))
      do k = this%first(row), this%first(row + 1) - 1
        total = total + this%weight(k)*u(this%index(k))
      end do
      derivative(row) = total
    end do
    !$omp end parallel do
  end subroutine apply

  subroutine apply_at_targets(this, factor, u, derivative)
    class(sparse_operator_t), intent(in) :: this
    !> What every derivative is multiplied by
    real(wp), intent(in) :: factor
    !> The field at all particles
    real(wp), intent(in) :: u(:)
    !> Field over all particles, changed at the targets only
    real(wp), intent(inout) :: derivative(:)
    real(wp) :: total
    integer(i8) :: k
    integer :: row

    !$omp parallel do if (size(this%target) > worth_threads) schedule(static) default(shared) &
    !$omp private(row, k, total)
    do row = 1, size(this%target)
      total = this%diagonal(row)*u(this%target(row))
      do k = this%first(row), this%first(row + 1) - 1
        total = total + this%weight(k)*u(this%index(k))
      end do
      derivative(this%target(row)) = factor*total
    end do
    !$omp end parallel do
  end subroutine apply_at_targets

  pure function gershgorin_right_end(this) result(bound)
    class(sparse_operator_t), intent(in) :: this
    real(wp) :: bound
    real(wp) :: total
    integer :: row

    bound = -huge(1.0_wp)
    do row = 1, this%rows()
      total = sum(abs(this%weight(this%first(row):this%first(row + 1) - 1)))
      ! The diagonal is a sum of the same numbers, taken in another order.
      if (total + this%diagonal(row) <= 1.0e-12_wp*total) total = -this%diagonal(row)
      bound = max(bound, total + this%diagonal(row))
    end do
  end function gershgorin_right_end

  pure function gershgorin_bound(this) result(bound)
    class(sparse_operator_t), intent(in) :: this
    real(wp) :: bound
    integer :: row

    bound = 0
    do row = 1, this%rows()
      bound = max(bound, abs(this%diagonal(row)) + &
                  sum(abs(this%weight(this%first(row):this%first(row + 1) - 1))))
    end do
  end function gershgorin_bound

end module calor_sparse_operator
