!> The renormalized gradient applied twice. Exact for linear fields; a row reaches the neighbours of
!> the neighbours.
module calor_laplacian_double_gradient
  use calor_gradient_renormalized, only: renormalized_gradient_t
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, ip, i8
  use calor_laplacian_scheme, only: laplacian_scheme_t
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_row_report, only: row_report_t
  use calor_sparse_operator, only: sparse_operator_t
  implicit none (type, external)
  private

  public :: double_gradient_t

  type, extends(laplacian_scheme_t) :: double_gradient_t
  contains
    procedure :: assemble
    procedure :: exact_degree
  end type double_gradient_t

contains

  pure function exact_degree(this) result(degree)
    class(double_gradient_t), intent(in) :: this
    integer :: degree

    associate (unused => this)
    end associate
    degree = 1
  end function exact_degree

  subroutine assemble(this, kernel, x, y, volume, radius, list, laplacian, report, attempt)
    class(double_gradient_t), intent(in) :: this
    class(kernel_t), intent(in) :: kernel
    real(wp), intent(in) :: x(:), y(:), volume(:), radius(:)
    type(neighbour_list_t), intent(in) :: list
    type(sparse_operator_t), intent(out) :: laplacian
    type(row_report_t), intent(out), optional :: report
    logical, intent(in), optional :: attempt
    type(renormalized_gradient_t) :: gradient
    type(neighbour_list_t) :: inner_list
    type(sparse_operator_t) :: outer_x, outer_y, inner_x, inner_y
    integer(ip), allocatable :: row_of(:), reached(:)
    integer :: k

    ! Every row is as it is written.
    if (present(attempt)) continue
    call gradient%assemble(kernel, x, y, volume, radius, list, outer_x, outer_y, report)
    ! The inner gradient is wanted at the targets and at all their neighbours.
    allocate (row_of(size(x)), source=0_ip)
    row_of(list%target) = 1
    row_of(list%index) = 1
    reached = pack([(int(k, ip), k=1, size(x))], row_of == 1)
    row_of(reached) = [(int(k, ip), k=1, size(reached))]
    call build_neighbour_list(x, y, radius(reached), inner_list, reached)
    call gradient%assemble(kernel, x, y, volume, radius, inner_list, inner_x, inner_y)
    call add_products(outer_x, outer_y, inner_x, inner_y, row_of, laplacian)
  end subroutine assemble

  !> Rows of outer_x·inner_x + outer_y·inner_y, in two passes: count, then fill.
  subroutine add_products(outer_x, outer_y, inner_x, inner_y, row_of, product)
    type(sparse_operator_t), intent(in) :: outer_x, outer_y, inner_x, inner_y
    !> The row of the inner operators that belongs to a particle
    integer(ip), intent(in) :: row_of(:)
    type(sparse_operator_t), intent(out) :: product
    real(wp), allocatable :: total(:)
    integer(ip), allocatable :: found(:)
    logical, allocatable :: seen(:)
    integer(i8) :: from
    integer :: row, n, pass

    product%target = outer_x%target
    allocate (product%diagonal(outer_x%rows()))
    allocate (product%first(outer_x%rows() + 1), source=0_i8)
    do pass = 1, 2
      if (pass == 2) then
        product%first(1) = 1
        do row = 1, outer_x%rows()
          product%first(row + 1) = product%first(row) + product%first(row + 1)
        end do
        allocate (product%index(product%first(outer_x%rows() + 1) - 1))
        allocate (product%weight(product%first(outer_x%rows() + 1) - 1))
      end if
      !$omp parallel default(shared) private(row, n, from, total, found, seen)
      allocate (total(size(row_of)), source=0.0_wp)
      allocate (found(size(row_of)))
      allocate (seen(size(row_of)), source=.false.)
      !$omp do schedule(static)
      do row = 1, outer_x%rows()
        call gather_product(row, outer_x, outer_y, inner_x, inner_y, row_of, total, found, seen, n)
        if (pass == 1) then
          product%first(row + 1) = n
        else
          from = product%first(row)
          product%index(from:from + n - 1) = found(1:n)
          product%weight(from:from + n - 1) = total(found(1:n))
          product%diagonal(row) = total(product%target(row))
        end if
        total(found(1:n)) = 0
        total(outer_x%target(row)) = 0
        seen(found(1:n)) = .false.
      end do
      !$omp end do
      deallocate (total, found, seen)
      !$omp end parallel
    end do
  end subroutine add_products

  !> One row of the product, summed up in `total` over all particles; `found` lists where.
  subroutine gather_product(row, outer_x, outer_y, inner_x, inner_y, row_of, total, found, seen, n)
    integer, intent(in) :: row
    type(sparse_operator_t), intent(in) :: outer_x, outer_y, inner_x, inner_y
    integer(ip), intent(in) :: row_of(:)
    real(wp), intent(inout) :: total(:)
    integer(ip), intent(inout) :: found(:)
    logical, intent(inout) :: seen(:)
    integer, intent(out) :: n
    integer(ip) :: particle
    integer(i8) :: k

    n = 0
    particle = outer_x%target(row)
    call add_inner_row(particle, outer_x%diagonal(row), outer_y%diagonal(row))
    do k = outer_x%first(row), outer_x%first(row + 1) - 1
      call add_inner_row(outer_x%index(k), outer_x%weight(k), outer_y%weight(k))
    end do

  contains

    subroutine add_inner_row(middle, factor_x, factor_y)
      integer(ip), intent(in) :: middle
      real(wp), intent(in) :: factor_x, factor_y
      integer(ip) :: inner
      integer(i8) :: m

      inner = row_of(middle)
      call add(middle, factor_x*inner_x%diagonal(inner) + factor_y*inner_y%diagonal(inner))
      do m = inner_x%first(inner), inner_x%first(inner + 1) - 1
        call add(inner_x%index(m), factor_x*inner_x%weight(m) + factor_y*inner_y%weight(m))
      end do
    end subroutine add_inner_row

    subroutine add(end_point, term)
      integer(ip), intent(in) :: end_point
      real(wp), intent(in) :: term

      total(end_point) = total(end_point) + term
      if (seen(end_point) .or. end_point == particle) return
      seen(end_point) = .true.
      n = n + 1
      found(n) = end_point
    end subroutine add

  end subroutine gather_product

end module calor_laplacian_double_gradient
