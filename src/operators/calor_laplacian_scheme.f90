!> What every scheme for the Laplacian offers.
module calor_laplacian_scheme
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, i8
  use calor_neighbour_list, only: neighbour_list_t
  use calor_row_report, only: row_report_t
  use calor_sparse_operator, only: sparse_operator_t
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: laplacian_scheme_t, row_laplacian_t, row_rule_t

  !> When a row of a scheme is good enough, and how its support grows until it is
  type :: row_rule_t
    !> The largest Σ|a_ij|/|a_ii|
    real(wp) :: largest_ratio = 1.2_wp
    !> The largest |a_ii| in units of the mean distance of the neighbours: a row beyond it hangs on
    !> neighbours that are nearly in line, or much too near, and costs short time steps
    real(wp) :: largest_stiffness = 100.0_wp
    !> By how much a support grows at a time
    real(wp) :: growth = 1.15_wp
    !> Growth ends at this many neighbours: beyond it a row is no longer local
    integer :: most_neighbours = 250
  end type row_rule_t

  !> A scheme for ∇²u
  type, abstract :: laplacian_scheme_t
  contains
    !> The rows of weights for the targets of a neighbour list
    procedure(assemble_interface), deferred :: assemble
    !> The degree up to which polynomials are differentiated exactly on any sufficient support
    procedure :: exact_degree
    !> What is asked of its rows
    procedure :: rule
  end type laplacian_scheme_t

  !> A scheme whose row reaches no farther than the particle's own neighbours. A scheme of one's own
  !> extends this type with `weights`.
  type, abstract, extends(laplacian_scheme_t) :: row_laplacian_t
  contains
    !> The weights of one particle's stencil
    procedure(laplacian_weights), deferred :: weights
    procedure :: assemble => assemble_rows
  end type row_laplacian_t

  abstract interface
    subroutine assemble_interface(this, kernel, x, y, volume, radius, list, laplacian, report)
      import :: laplacian_scheme_t, kernel_t, wp, neighbour_list_t, sparse_operator_t, row_report_t
      implicit none (type, external)
      class(laplacian_scheme_t), intent(in) :: this
      !> The smoothing kernel
      class(kernel_t), intent(in) :: kernel
      !> Coordinates, m, volumes, m², and support radii, m, of all particles
      real(wp), intent(in) :: x(:), y(:), volume(:), radius(:)
      !> The particles to assemble rows for, and their neighbours within their support radius
      type(neighbour_list_t), intent(in) :: list
      !> ∇² at the targets
      type(sparse_operator_t), intent(out) :: laplacian
      !> The condition of the tensors that were solved for
      type(row_report_t), intent(out), optional :: report
    end subroutine assemble_interface

    !> ⟨∇²u⟩_i = diagonal u_i + Σ weight(j) u_j, in units of 1/h².
    subroutine laplacian_weights(this, stencil, weight, diagonal)
      import :: row_laplacian_t, stencil_t, wp
      implicit none (type, external)
      class(row_laplacian_t), intent(in) :: this
      !> The particle's neighbours; a scheme notes the condition of its tensors in it
      type(stencil_t), intent(inout) :: stencil
      !> Weights of the `stencil%n` neighbours
      real(wp), intent(out) :: weight(:)
      !> Weight of the particle itself
      real(wp), intent(out) :: diagonal
    end subroutine laplacian_weights
  end interface

contains

  pure function exact_degree(this) result(degree)
    class(laplacian_scheme_t), intent(in) :: this
    integer :: degree

    associate (unused => this)
    end associate
    degree = 0
  end function exact_degree

  pure function rule(this)
    class(laplacian_scheme_t), intent(in) :: this
    type(row_rule_t) :: rule

    associate (unused => this)
    end associate
    rule = row_rule_t()
  end function rule

  subroutine assemble_rows(this, kernel, x, y, volume, radius, list, laplacian, report)
    class(row_laplacian_t), intent(in) :: this
    class(kernel_t), intent(in) :: kernel
    real(wp), intent(in) :: x(:), y(:), volume(:), radius(:)
    type(neighbour_list_t), intent(in) :: list
    type(sparse_operator_t), intent(out) :: laplacian
    type(row_report_t), intent(out), optional :: report
    type(row_report_t) :: found
    type(stencil_t) :: stencil
    real(wp) :: scale
    integer(i8) :: from, to
    integer :: row

    call laplacian%shape_as(list)
    call found%reserve(list%rows())
    !$omp parallel default(shared) private(row, from, to, scale) firstprivate(stencil)
    call stencil%reserve(list%longest_row())
    !$omp do schedule(static)
    do row = 1, list%rows()
      from = list%first(row)
      to = list%first(row + 1) - 1
      scale = 1/radius(list%target(row))
      call stencil%gather(kernel, x, y, volume, list%target(row), list%index(from:to), &
                          radius(list%target(row)))
      call this%weights(stencil, laplacian%weight(from:to), laplacian%diagonal(row))
      laplacian%weight(from:to) = (laplacian%weight(from:to)*scale)*scale
      laplacian%diagonal(row) = (laplacian%diagonal(row)*scale)*scale
      call found%note(row, stencil)
    end do
    !$omp end do
    !$omp end parallel
    if (present(report)) report = found
  end subroutine assemble_rows

end module calor_laplacian_scheme
