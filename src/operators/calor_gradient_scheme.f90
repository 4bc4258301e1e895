!> What every scheme for the first derivative offers, and its assembly into sparse operators.
module calor_gradient_scheme
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, i8
  use calor_neighbour_list, only: neighbour_list_t
  use calor_row_report, only: row_report_t
  use calor_sparse_operator, only: sparse_operator_t
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: gradient_scheme_t

  !> A scheme for ∇u. A scheme of one's own extends this type with `weights`.
  type, abstract :: gradient_scheme_t
  contains
    !> The weights of one particle's stencil
    procedure(gradient_weights), deferred :: weights
    !> The rows of weights for the targets of a neighbour list
    procedure :: assemble
    !> The degree up to which polynomials are differentiated exactly on any sufficient support
    procedure :: exact_degree
  end type gradient_scheme_t

  abstract interface
    !> ⟨∂u/∂x⟩_i = diagonal(1) u_i + Σ weight_x(j) u_j, likewise for y, in units of 1/h.
    subroutine gradient_weights(this, stencil, weight_x, weight_y, diagonal)
      import :: gradient_scheme_t, stencil_t, wp
      implicit none (type, external)
      class(gradient_scheme_t), intent(in) :: this
      !> The particle's neighbours; a scheme notes the condition of its tensors in it
      type(stencil_t), intent(inout) :: stencil
      !> Weights of the `stencil%n` neighbours
      real(wp), intent(out) :: weight_x(:), weight_y(:)
      !> Weights of the particle itself, for x and y
      real(wp), intent(out) :: diagonal(2)
    end subroutine gradient_weights
  end interface

contains

  pure function exact_degree(this) result(degree)
    class(gradient_scheme_t), intent(in) :: this
    integer :: degree

    associate (unused => this)
    end associate
    degree = 0
  end function exact_degree

  subroutine assemble(this, kernel, x, y, volume, radius, list, gradient_x, gradient_y, report)
    class(gradient_scheme_t), intent(in) :: this
    !> The smoothing kernel
    class(kernel_t), intent(in) :: kernel
    !> Coordinates, m, volumes, m², and support radii, m, of all particles
    real(wp), intent(in) :: x(:), y(:), volume(:), radius(:)
    !> The particles to assemble rows for, and their neighbours within their support radius
    type(neighbour_list_t), intent(in) :: list
    !> ∂/∂x and ∂/∂y at the targets
    type(sparse_operator_t), intent(out) :: gradient_x, gradient_y
    !> The condition of the tensors that were solved for
    type(row_report_t), intent(out), optional :: report
    type(row_report_t) :: found
    type(stencil_t) :: stencil
    real(wp) :: diagonal(2)
    integer(i8) :: from, to
    integer :: row

    call gradient_x%shape_as(list)
    call gradient_y%shape_as(list)
    call found%reserve(list%rows())
    !$omp parallel if (list%rows() > 256) default(shared) private(row, from, to, diagonal) &
    !$omp firstprivate(stencil)
    call stencil%reserve(list%longest_row())
    !$omp do schedule(static)
    do row = 1, list%rows()
      from = list%first(row)
      to = list%first(row + 1) - 1
      call stencil%gather(kernel, x, y, volume, list%target(row), list%index(from:to), &
                          radius(list%target(row)))
      call this%weights(stencil, gradient_x%weight(from:to), gradient_y%weight(from:to), diagonal)
      gradient_x%weight(from:to) = gradient_x%weight(from:to)/radius(list%target(row))
      gradient_y%weight(from:to) = gradient_y%weight(from:to)/radius(list%target(row))
      gradient_x%diagonal(row) = diagonal(1)/radius(list%target(row))
      gradient_y%diagonal(row) = diagonal(2)/radius(list%target(row))
      call found%note(row, stencil)
    end do
    !$omp end do
    !$omp end parallel
    if (present(report)) report = found
  end subroutine assemble

end module calor_gradient_scheme
