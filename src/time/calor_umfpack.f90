!> Sparse direct solution of linear systems: what is in use of UMFPACK.
!>
!> Source: T.A. Davis, Algorithm 832: UMFPACK V4.3, ACM Trans. Math. Softw. 30 (2004) 196–199.
module calor_umfpack
  use, intrinsic :: iso_c_binding, only: c_double, c_ptr, c_null_ptr, c_associated, &
                                         c_long
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: factorisation_t

  !> UMFPACK_A and UMFPACK_At: solve with the matrix, or its transpose
  integer(c_long), parameter :: plain = 0, transposed = 1

  ! C's arrays can only be of assumed size
  interface
    function umfpack_symbolic(rows, columns, first, index, value, symbolic, control, info) &
        bind(c, name='umfpack_dl_symbolic') result(status)
      import :: c_long, c_double, c_ptr
      implicit none (type, external)
      integer(c_long), value :: rows, columns
      ! allow(assumed-size)
      integer(c_long), intent(in) :: first(*), index(*)
      ! allow(assumed-size)
      real(c_double), intent(in) :: value(*)
      type(c_ptr), intent(out) :: symbolic
      type(c_ptr), value :: control, info
      integer(c_long) :: status
    end function umfpack_symbolic

    function umfpack_numeric(first, index, value, symbolic, numeric, control, info) &
        bind(c, name='umfpack_dl_numeric') result(status)
      import :: c_long, c_double, c_ptr
      implicit none (type, external)
      ! allow(assumed-size)
      integer(c_long), intent(in) :: first(*), index(*)
      ! allow(assumed-size)
      real(c_double), intent(in) :: value(*)
      type(c_ptr), value :: symbolic
      type(c_ptr), intent(out) :: numeric
      type(c_ptr), value :: control, info
      integer(c_long) :: status
    end function umfpack_numeric

    function umfpack_solve(system, first, index, value, x, b, numeric, control, info) &
        bind(c, name='umfpack_dl_solve') result(status)
      import :: c_long, c_double, c_ptr
      implicit none (type, external)
      integer(c_long), value :: system
      ! allow(assumed-size)
      integer(c_long), intent(in) :: first(*), index(*)
      ! allow(assumed-size)
      real(c_double), intent(in) :: value(*), b(*)
      ! allow(assumed-size)
      real(c_double), intent(out) :: x(*)
      type(c_ptr), value :: numeric, control, info
      integer(c_long) :: status
    end function umfpack_solve

    subroutine umfpack_free_symbolic(symbolic) bind(c, name='umfpack_dl_free_symbolic')
      import :: c_ptr
      implicit none (type, external)
      type(c_ptr), intent(inout) :: symbolic
    end subroutine umfpack_free_symbolic

    subroutine umfpack_free_numeric(numeric) bind(c, name='umfpack_dl_free_numeric')
      import :: c_ptr
      implicit none (type, external)
      type(c_ptr), intent(inout) :: numeric
    end subroutine umfpack_free_numeric
  end interface

  !> A matrix in factors. It must not be copied.
  type :: factorisation_t
    private
    !> The matrix by columns, numbered from 0
    integer(c_long), allocatable :: first(:), index(:)
    real(c_double), allocatable :: value(:)
    type(c_ptr) :: numeric = c_null_ptr
  contains
    !> Factorise a matrix
    procedure :: factorise
    !> Solve with it, or with its transpose
    procedure :: solve
    !> Give the factors' memory back
    procedure :: release
  end type factorisation_t

contains

  !> Factorise a matrix given by rows, whose entries of a row may stand in any order and more than
  !> once: these are added.
  subroutine factorise(this, first, index, value, done)
    class(factorisation_t), intent(inout) :: this
    !> Where each row begins in `index` and `value`; one element more than rows
    integer, intent(in) :: first(:)
    !> Columns, from 1, and entries
    integer, intent(in) :: index(:)
    real(wp), intent(in) :: value(:)
    !> Whether that has worked: the matrix is not singular and there was memory enough
    logical, intent(out) :: done
    type(c_ptr) :: symbolic
    integer(c_long) :: status, n

    call this%release()
    n = size(first) - 1
    call sort_columns(first, index, value, this%first, this%index, this%value)
    done = .false.
    status = umfpack_symbolic(n, n, this%first, this%index, this%value, symbolic, c_null_ptr, &
                              c_null_ptr)
    if (status /= 0) return
    status = umfpack_numeric(this%first, this%index, this%value, symbolic, this%numeric, &
                             c_null_ptr, c_null_ptr)
    call umfpack_free_symbolic(symbolic)
    done = status == 0
    if (.not. done) call this%release()
  end subroutine factorise

  subroutine solve(this, right_side, solution, transpose, done)
    class(factorisation_t), intent(in) :: this
    real(wp), intent(in), contiguous :: right_side(:)
    real(wp), intent(out), contiguous :: solution(:)
    !> Whether to solve with the transpose of the matrix
    logical, intent(in) :: transpose
    !> Whether that has worked
    logical, intent(out) :: done
    integer(c_long) :: system

    ! UMFPACK takes columns, and what it is given are the rows: the two systems change places.
    system = merge(plain, transposed, transpose)
    done = umfpack_solve(system, this%first, this%index, this%value, solution, right_side, &
                         this%numeric, c_null_ptr, c_null_ptr) == 0
  end subroutine solve

  subroutine release(this)
    class(factorisation_t), intent(inout) :: this

    if (c_associated(this%numeric)) call umfpack_free_numeric(this%numeric)
    this%numeric = c_null_ptr
  end subroutine release

  !> The rows of the matrix, each with its columns in ascending order and once.
  subroutine sort_columns(first, index, value, sorted_first, sorted_index, sorted_value)
    integer, intent(in) :: first(:), index(:)
    real(wp), intent(in) :: value(:)
    integer(c_long), allocatable, intent(out) :: sorted_first(:), sorted_index(:)
    real(c_double), allocatable, intent(out) :: sorted_value(:)
    real(wp) :: entry
    integer :: row, k, place, column, used

    allocate (sorted_first(size(first)), sorted_index(size(index)), sorted_value(size(value)))
    used = 0
    sorted_first(1) = 0
    do row = 1, size(first) - 1
      do k = first(row), first(row + 1) - 1
        column = index(k) - 1
        entry = value(k)
        place = used
        do while (place > sorted_first(row))
          if (sorted_index(place) <= column) exit
          place = place - 1
        end do
        if (place > sorted_first(row)) then
          if (sorted_index(place) == column) then
            sorted_value(place) = sorted_value(place) + entry
            cycle
          end if
        end if
        sorted_index(place + 2:used + 1) = sorted_index(place + 1:used)
        sorted_value(place + 2:used + 1) = sorted_value(place + 1:used)
        sorted_index(place + 1) = column
        sorted_value(place + 1) = entry
        used = used + 1
      end do
      sorted_first(row + 1) = used
    end do
  end subroutine sort_columns

end module calor_umfpack
