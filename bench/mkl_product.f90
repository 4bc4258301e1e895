!> MKL's optimised product of a sparse matrix and a vector, from its library as found at run time.
module mkl_product
  use, intrinsic :: iso_c_binding, only: c_char, c_double, c_funptr, c_int, c_null_char, c_ptr, &
                                         c_associated, c_f_procpointer, c_null_ptr
  use calor_kinds, only: wp, ip, i8
  use calor_sparse_operator, only: sparse_operator_t
  implicit none (type, external)
  private

  public :: mkl_matrix_t

  !> What kind of matrix: MKL's struct matrix_descr
  type, bind(c) :: description_t
    integer(c_int) :: kind = 20, mode = 0, diagonal = 0
  end type description_t

  !> A matrix in MKL's hands, with the arrays that it was made from
  type :: mkl_matrix_t
    logical :: ready = .false.
    type(c_ptr), private :: handle = c_null_ptr
    procedure(multiply_interface), pointer, nopass, private :: product => null()
    integer(c_int), allocatable, private :: first(:), index(:)
    real(c_double), allocatable, private :: weight(:)
  contains
    !> Load the library and optimise a matrix
    procedure :: prepare
    !> y ← A x
    procedure :: multiply
  end type mkl_matrix_t

  integer(c_int), parameter :: base_one = 1, no_transpose = 10, lazy_and_global = 257

  abstract interface
    function create_interface(handle, base, rows, columns, start, finish, index, weight) &
      bind(c) result(status)
      import :: c_int, c_ptr, c_double
      implicit none (type, external)
      type(c_ptr), intent(out) :: handle
      integer(c_int), value :: base, rows, columns
      integer(c_int), intent(in) :: start(*), finish(*), index(*)
      real(c_double), intent(in) :: weight(*)
      integer(c_int) :: status
    end function create_interface

    function hint_interface(handle, operation, description, calls) bind(c) result(status)
      import :: c_int, c_ptr, description_t
      implicit none (type, external)
      type(c_ptr), value :: handle
      integer(c_int), value :: operation, calls
      type(description_t), value :: description
      integer(c_int) :: status
    end function hint_interface

    function optimise_interface(handle) bind(c) result(status)
      import :: c_int, c_ptr
      implicit none (type, external)
      type(c_ptr), value :: handle
      integer(c_int) :: status
    end function optimise_interface

    function multiply_interface(operation, alpha, handle, description, x, beta, y) &
      bind(c) result(status)
      import :: c_int, c_ptr, c_double, description_t
      implicit none (type, external)
      integer(c_int), value :: operation
      real(c_double), value :: alpha, beta
      type(c_ptr), value :: handle
      type(description_t), value :: description
      real(c_double), intent(in) :: x(*)
      real(c_double), intent(inout) :: y(*)
      integer(c_int) :: status
    end function multiply_interface
  end interface

  interface
    function dlopen(path, mode) bind(c, name='dlopen') result(library)
      import :: c_char, c_int, c_ptr
      implicit none (type, external)
      character(kind=c_char), intent(in) :: path(*)
      integer(c_int), value :: mode
      type(c_ptr) :: library
    end function dlopen

    function dlsym(library, name) bind(c, name='dlsym') result(symbol)
      import :: c_char, c_funptr, c_ptr
      implicit none (type, external)
      type(c_ptr), value :: library
      character(kind=c_char), intent(in) :: name(*)
      type(c_funptr) :: symbol
    end function dlsym
  end interface

contains

  !> `ready` tells whether it worked.
  subroutine prepare(this, path, operator, columns)
    class(mkl_matrix_t), intent(out) :: this
    !> The library libmkl_rt
    character(len=*), intent(in) :: path
    !> The rows; their diagonals become entries
    type(sparse_operator_t), intent(in) :: operator
    !> Number of particles
    integer, intent(in) :: columns
    procedure(create_interface), pointer :: create
    procedure(hint_interface), pointer :: hint
    procedure(optimise_interface), pointer :: optimise
    type(c_ptr) :: library
    integer :: entry, row, k

    library = dlopen(path//c_null_char, lazy_and_global)
    if (.not. c_associated(library)) return
    call c_f_procpointer(dlsym(library, 'mkl_sparse_d_create_csr'//c_null_char), create)
    call c_f_procpointer(dlsym(library, 'mkl_sparse_set_mv_hint'//c_null_char), hint)
    call c_f_procpointer(dlsym(library, 'mkl_sparse_optimize'//c_null_char), optimise)
    call c_f_procpointer(dlsym(library, 'mkl_sparse_d_mv'//c_null_char), this%product)
    entry = size(operator%index) + operator%rows()
    allocate (this%first(operator%rows() + 1), this%index(entry), this%weight(entry))
    entry = 0
    do row = 1, operator%rows()
      this%first(row) = entry + 1
      call put(operator%target(row), operator%diagonal(row))
      do k = int(operator%first(row)), int(operator%first(row + 1)) - 1
        call put(operator%index(k), operator%weight(k))
      end do
    end do
    this%first(operator%rows() + 1) = entry + 1
    if (create(this%handle, base_one, operator%rows(), columns, this%first, this%first(2:), &
               this%index, this%weight) /= 0) return
    if (hint(this%handle, no_transpose, description_t(), 1000) /= 0) return
    this%ready = optimise(this%handle) == 0

  contains

    subroutine put(index, weight)
      integer(ip), intent(in) :: index
      real(wp), intent(in) :: weight

      entry = entry + 1
      this%index(entry) = index
      this%weight(entry) = weight
    end subroutine put

  end subroutine prepare

  subroutine multiply(this, x, y)
    class(mkl_matrix_t), intent(in) :: this
    real(wp), intent(in), contiguous :: x(:)
    !> An entry for each row
    real(wp), intent(inout), contiguous :: y(:)
    integer(c_int) :: status

    status = this%product(no_transpose, 1.0_wp, this%handle, description_t(), x, 0.0_wp, y)
  end subroutine multiply

end module mkl_product
