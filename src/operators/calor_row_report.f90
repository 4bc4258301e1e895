!> What assembling found out about each row.
module calor_row_report
  use calor_kinds, only: wp
  use calor_small_system, only: largest_condition
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: row_report_t

  !> One entry a row
  type :: row_report_t
    !> Condition numbers of the systems for B_i and B̂_i; 0 where a scheme does not use the tensor
    real(wp), allocatable :: condition_gradient(:), condition_laplacian(:)
    !> How far a row has missed a moment that the scheme solves for, in units of the support radius
    real(wp), allocatable :: residual(:)
  contains
    !> Provide room for a number of rows
    procedure :: reserve
    !> Keep what a scheme noted in the stencil of a row
    procedure :: note
    !> Add the entries of other rows after its own
    procedure :: append
    !> Hand all entries over, keeping none
    procedure :: move_to
    !> Number of rows whose tensors were singular, so that the minimum-norm solution was taken
    procedure :: singular_rows
  end type row_report_t

contains

  subroutine reserve(this, rows)
    class(row_report_t), intent(out) :: this
    !> Number of rows
    integer, intent(in) :: rows

    allocate (this%condition_gradient(rows), source=0.0_wp)
    allocate (this%condition_laplacian(rows), source=0.0_wp)
    allocate (this%residual(rows), source=0.0_wp)
  end subroutine reserve

  pure subroutine note(this, row, stencil)
    class(row_report_t), intent(inout) :: this
    !> The row
    integer, intent(in) :: row
    !> Its stencil, after a scheme has found the row's weights
    type(stencil_t), intent(in) :: stencil

    this%condition_gradient(row) = stencil%condition_gradient
    this%condition_laplacian(row) = stencil%condition_laplacian
    this%residual(row) = stencil%residual
  end subroutine note

  subroutine append(this, other)
    class(row_report_t), intent(inout) :: this
    !> The other rows
    type(row_report_t), intent(in) :: other

    this%condition_gradient = [this%condition_gradient, other%condition_gradient]
    this%condition_laplacian = [this%condition_laplacian, other%condition_laplacian]
    this%residual = [this%residual, other%residual]
  end subroutine append

  subroutine move_to(this, other)
    class(row_report_t), intent(inout) :: this
    !> Where they go
    type(row_report_t), intent(out) :: other

    call move_alloc(this%condition_gradient, other%condition_gradient)
    call move_alloc(this%condition_laplacian, other%condition_laplacian)
    call move_alloc(this%residual, other%residual)
  end subroutine move_to

  pure function singular_rows(this) result(number)
    class(row_report_t), intent(in) :: this
    integer :: number

    number = count(this%condition_gradient > largest_condition .or. &
                   this%condition_laplacian > largest_condition)
  end function singular_rows

end module calor_row_report
