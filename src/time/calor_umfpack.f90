!> Sparse direct solution of linear systems: what is in use of UMFPACK.
!>
!> Source: T.A. Davis, Algorithm 832: UMFPACK V4.3, ACM Trans. Math. Softw. 30 (2004) 196–199.
module calor_umfpack
  use, intrinsic :: iso_c_binding, only: c_double, c_ptr, c_null_ptr, c_associated, c_intptr_t, &
                                         c_long, c_loc
  use calor_kinds, only: wp
  use calor_sparse_matrix, only: sparse_matrix_t
  implicit none (type, external)
  private

  public :: factorisation_t

  !> UMFPACK_A and UMFPACK_At: solve with the matrix, or its transpose
  integer(c_long), parameter :: plain = 0, transposed = 1
  !> Entries of UMFPACK's Control and Info in use, from 1, and values of some (umfpack.h)
  integer, parameter :: controls = 20, infos = 90
  integer, parameter :: strategy = 6, refinements = 8
  integer, parameter :: size_of_unit = 4, peak_memory = 22, symmetric_entries = 37, &
                        symmetric_flops = 38
  real(c_double), parameter :: symmetric = 3

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
      ! allow(assumed-size)
      real(c_double), intent(in) :: control(*)
      ! allow(assumed-size)
      real(c_double), intent(out) :: info(*)
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
      ! allow(assumed-size)
      real(c_double), intent(in) :: control(*)
      ! allow(assumed-size)
      real(c_double), intent(out) :: info(*)
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
      type(c_ptr), value :: numeric
      ! allow(assumed-size)
      real(c_double), intent(in) :: control(*)
      ! allow(assumed-size)
      real(c_double), intent(out) :: info(*)
      integer(c_long) :: status
    end function umfpack_solve

    subroutine umfpack_defaults(control) bind(c, name='umfpack_dl_defaults')
      import :: c_double
      implicit none (type, external)
      ! allow(assumed-size)
      real(c_double), intent(out) :: control(*)
    end subroutine umfpack_defaults

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

  !> What UMFPACK keeps. It belongs to the object at the address in `owner`: a copy, also one that a
  !> compiler made byte by byte, owns nothing, uses nothing and releases nothing.
  type :: handles_t
    type(c_ptr) :: symbolic = c_null_ptr, numeric = c_null_ptr
    integer(c_intptr_t) :: owner = 0
  contains
    final :: finish
  end type handles_t

  !> A matrix in factors. Of a copy the factors have to be made anew.
  type :: factorisation_t
    !> What the analysis predicts: memory at the highest, bytes; entries of both factors and
    !> floating-point operations to find them, where pivots stay on the diagonal
    real(wp) :: bytes = 0.0_wp, entries = 0.0_wp, operations = 0.0_wp
    !> The matrix by columns, numbered from 0
    integer(c_long), allocatable, private :: first(:), index(:)
    real(c_double), allocatable, private :: value(:)
    real(c_double), private :: control(controls) = 0
    type(handles_t), private :: handles
  contains
    !> Factorise a matrix
    procedure :: factorise
    !> Find out where the factors of a matrix will have entries
    procedure :: analyse
    !> Factorise what was analysed, with values of its own
    procedure :: refactorise
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
    real(wp), intent(in), contiguous :: value(:)
    !> Whether that has worked: the matrix is not singular and there was memory enough
    logical, intent(out) :: done
    type(sparse_matrix_t) :: matrix

    call matrix%assemble(first, index, value)
    call this%analyse(matrix, .false., done)
    if (done) call this%refactorise(matrix%value, done)
  end subroutine factorise

  subroutine analyse(this, matrix, dominant, done)
    class(factorisation_t), intent(inout) :: this
    !> The matrix
    type(sparse_matrix_t), intent(in) :: matrix
    !> Whether its diagonal dominates: pivots are taken from there and solutions are not refined,
    !> which saves memory and time
    logical, intent(in) :: dominant
    !> Whether that has worked
    logical, intent(out) :: done
    real(c_double) :: info(infos)
    integer(c_long) :: n

    call this%release()
    n = matrix%rows()
    this%first = matrix%first - 1
    this%index = matrix%index - 1
    this%value = matrix%value
    call umfpack_defaults(this%control)
    if (dominant) then
      this%control(strategy) = symmetric
      this%control(refinements) = 0
    end if
    done = umfpack_symbolic(n, n, this%first, this%index, this%value, this%handles%symbolic, &
                            this%control, info) == 0
    if (.not. done) return
    call take(this%handles)
    this%bytes = info(peak_memory)*info(size_of_unit)
    this%entries = info(symmetric_entries)
    this%operations = info(symmetric_flops)
  end subroutine analyse

  subroutine refactorise(this, value, done)
    class(factorisation_t), intent(inout) :: this
    !> Values of the matrix analysed, in its order
    real(wp), intent(in), contiguous :: value(:)
    !> Whether that has worked: the matrix is not singular and there was memory enough
    logical, intent(out) :: done
    real(c_double) :: info(infos)

    done = owned(this%handles)
    if (.not. done) return
    if (c_associated(this%handles%numeric)) call umfpack_free_numeric(this%handles%numeric)
    this%value = value
    done = umfpack_numeric(this%first, this%index, this%value, this%handles%symbolic, &
                           this%handles%numeric, this%control, info) == 0
    if (.not. done) call this%release()
  end subroutine refactorise

  subroutine solve(this, right_side, solution, transpose, done)
    class(factorisation_t), intent(in) :: this
    real(wp), intent(in), contiguous :: right_side(:)
    real(wp), intent(out), contiguous :: solution(:)
    !> Whether to solve with the transpose of the matrix
    logical, intent(in) :: transpose
    !> Whether that has worked
    logical, intent(out) :: done
    real(c_double) :: info(infos)
    integer(c_long) :: system

    done = owned(this%handles)
    if (.not. done) return
    ! UMFPACK takes columns, and what it is given are the rows: the two systems change places.
    system = merge(plain, transposed, transpose)
    done = umfpack_solve(system, this%first, this%index, this%value, solution, right_side, &
                         this%handles%numeric, this%control, info) == 0
  end subroutine solve

  subroutine release(this)
    class(factorisation_t), intent(inout) :: this

    call finish(this%handles)
  end subroutine release

  !> What was just made belongs to these handles.
  subroutine take(handles)
    type(handles_t), intent(inout), target :: handles

    handles%numeric = c_null_ptr
    handles%owner = transfer(c_loc(handles%symbolic), 0_c_intptr_t)
  end subroutine take

  function owned(handles)
    type(handles_t), intent(in), target :: handles
    logical :: owned

    owned = handles%owner /= 0 .and. &
            handles%owner == transfer(c_loc(handles%symbolic), 0_c_intptr_t)
  end function owned

  subroutine finish(handles)
    type(handles_t), intent(inout) :: handles

    if (owned(handles)) then
      if (c_associated(handles%numeric)) call umfpack_free_numeric(handles%numeric)
      if (c_associated(handles%symbolic)) call umfpack_free_symbolic(handles%symbolic)
    end if
    handles%symbolic = c_null_ptr
    handles%numeric = c_null_ptr
    handles%owner = 0
  end subroutine finish

end module calor_umfpack
