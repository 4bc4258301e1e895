!> A square sparse matrix by rows, each with its columns in ascending order and the diagonal among
!> them: what direct and iterative solvers want.
module calor_sparse_matrix
  use calor_constants, only: worth_threads
  use calor_kinds, only: wp, i8
  implicit none (type, external)
  private

  public :: sparse_matrix_t

  type :: sparse_matrix_t
    !> Where each row begins in `index` and `value`; one element more than rows
    integer(i8), allocatable :: first(:)
    !> Columns, from 1, and entries
    integer, allocatable :: index(:)
    real(wp), allocatable :: value(:)
    !> Where the entry of the diagonal stands in each row
    integer(i8), allocatable :: diagonal(:)
  contains
    !> Number of rows
    procedure :: rows
    !> Take entries in any order
    procedure :: assemble
    !> The matrix times a vector
    procedure :: multiply
    !> Whether another matrix has entries at the same places
    procedure :: has_pattern_of
    !> Become 1 - s A, A being another matrix
    procedure :: become_shifted
  end type sparse_matrix_t

contains

  pure function rows(this) result(number)
    class(sparse_matrix_t), intent(in) :: this
    integer :: number

    number = 0
    if (allocated(this%first)) number = size(this%first) - 1
  end function rows

  !> Take a matrix given by rows, whose entries of a row may stand in any order and more than once:
  !> these are added. An entry of the diagonal that is missing becomes 0.
  subroutine assemble(this, first, index, value)
    class(sparse_matrix_t), intent(inout) :: this
    !> Where each row begins in `index` and `value`; one element more than rows
    integer, intent(in) :: first(:)
    !> Columns, from 1, and entries
    integer, intent(in) :: index(:)
    real(wp), intent(in), contiguous :: value(:)
    integer(i8) :: used, begin
    integer :: row, k, n

    n = size(first) - 1
    if (allocated(this%first)) deallocate (this%first, this%index, this%value, this%diagonal)
    allocate (this%first(n + 1), this%diagonal(n))
    allocate (this%index(size(index) + n), this%value(size(index) + n))
    used = 0
    this%first(1) = 1
    do row = 1, n
      begin = used
      call enter(row, 0.0_wp)
      do k = first(row), first(row + 1) - 1
        call enter(index(k), value(k))
      end do
      this%first(row + 1) = used + 1
      do k = int(begin) + 1, int(used)
        if (this%index(k) == row) this%diagonal(row) = k
      end do
    end do
    this%index = this%index(:used)
    this%value = this%value(:used)

  contains

    !> Put an entry where it belongs in the row that began after `begin`.
    subroutine enter(column, entry)
      integer, intent(in) :: column
      real(wp), intent(in) :: entry
      integer(i8) :: place, j

      place = used
      do while (place > begin)
        if (this%index(place) <= column) exit
        place = place - 1
      end do
      if (place > begin) then
        if (this%index(place) == column) then
          this%value(place) = this%value(place) + entry
          return
        end if
      end if
      do j = used, place + 1, -1
        this%index(j + 1) = this%index(j)
        this%value(j + 1) = this%value(j)
      end do
      this%index(place + 1) = column
      this%value(place + 1) = entry
      used = used + 1
    end subroutine enter

  end subroutine assemble

  subroutine multiply(this, v, product)
    class(sparse_matrix_t), intent(in) :: this
    real(wp), intent(in), contiguous :: v(:)
    real(wp), intent(out), contiguous :: product(:)
    real(wp) :: total
    integer(i8) :: k
    integer :: row

    !$omp parallel do if (size(v) > worth_threads) schedule(static) default(shared) &
    !$omp private(row, k, total)
    do row = 1, size(v)
      total = 0
      do k = this%first(row), this%first(row + 1) - 1
        total = total + this%value(k)*v(this%index(k))
      end do
      product(row) = total
    end do
    !$omp end parallel do
  end subroutine multiply

  pure function has_pattern_of(this, other) result(same)
    class(sparse_matrix_t), intent(in) :: this
    type(sparse_matrix_t), intent(in) :: other
    logical :: same

    same = this%rows() == other%rows()
    if (same) same = size(this%index) == size(other%index)
    if (same) same = all(this%first == other%first)
    if (same) same = all(this%index == other%index)
  end function has_pattern_of

  pure subroutine become_shifted(this, other, factor)
    class(sparse_matrix_t), intent(inout) :: this
    !> A
    type(sparse_matrix_t), intent(in) :: other
    !> s
    real(wp), intent(in) :: factor
    integer(i8) :: k
    integer :: row

    if (.not. allocated(this%first)) then
      this%first = other%first
      this%index = other%index
      this%diagonal = other%diagonal
      allocate (this%value(size(other%value)))
    end if
    do k = 1, size(other%value, kind=i8)
      this%value(k) = -factor*other%value(k)
    end do
    do row = 1, size(this%diagonal)
      this%value(this%diagonal(row)) = this%value(this%diagonal(row)) + 1
    end do
  end subroutine become_shifted

end module calor_sparse_matrix
