!> What every scheme for the Laplacian offers.
module calor_laplacian_scheme
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, i8
  use calor_neighbour_list, only: neighbour_list_t
  use calor_row_batch, only: row_batch_t, lanes
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
    !> Whether it can also find the weights of several stencils at once
    procedure :: solves_batches
    !> The weights of several stencils, those of them that it vouches for
    procedure :: batch_weights
    procedure :: assemble => assemble_rows
  end type row_laplacian_t

  !> So few rows are assembled sooner by one thread than others could be woken
  integer, parameter :: worth_assembling = 256

  abstract interface
    subroutine assemble_interface(this, kernel, x, y, volume, radius, list, laplacian, report, &
                                  attempt)
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
      !> Rows whose residual tells that their neighbours do not suffice will not be used: whatever
      !> was found of them will do
      logical, intent(in), optional :: attempt
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

  pure function solves_batches(this) result(answer)
    class(row_laplacian_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .false.
  end function solves_batches

  subroutine batch_weights(this, batch)
    class(row_laplacian_t), intent(in) :: this
    !> Some stencils; their weights, and what is known of them, are set
    type(row_batch_t), intent(inout) :: batch

    associate (unused => this)
    end associate
    batch%solved = .false.
  end subroutine batch_weights

  subroutine assemble_rows(this, kernel, x, y, volume, radius, list, laplacian, report, attempt)
    class(row_laplacian_t), intent(in) :: this
    class(kernel_t), intent(in) :: kernel
    real(wp), intent(in) :: x(:), y(:), volume(:), radius(:)
    type(neighbour_list_t), intent(in) :: list
    type(sparse_operator_t), intent(out) :: laplacian
    type(row_report_t), intent(out), optional :: report
    logical, intent(in), optional :: attempt
    type(row_report_t) :: found
    type(row_batch_t) :: batch
    type(stencil_t) :: stencil
    logical :: batches, takes_unmet
    integer :: first_row, last_row, most, row

    call laplacian%shape_as(list)
    call found%reserve(list%rows())
    batches = this%solves_batches()
    takes_unmet = .false.
    if (present(attempt)) takes_unmet = attempt
    most = list%longest_row()
    !$omp parallel if (list%rows() > worth_assembling) default(shared) &
    !$omp private(first_row, last_row, row) firstprivate(batch, stencil)
    call stencil%reserve(most)
    if (batches) call batch%reserve(most)
    !$omp do schedule(dynamic, 16)
    do first_row = 1, list%rows(), lanes
      last_row = min(first_row + lanes - 1, list%rows())
      if (batches) then
        call batch%gather(kernel, x, y, volume, radius, list, first_row, last_row)
        call this%batch_weights(batch)
      end if
      do row = first_row, last_row
        if (batch%solved(row - first_row + 1) .or. &
            (takes_unmet .and. batch%unmet(row - first_row + 1))) then
          call take_from_batch(batch, row - first_row + 1, row, radius, laplacian, found)
        else
          call assemble_row(this, kernel, x, y, volume, radius, row, stencil, laplacian, found)
        end if
      end do
    end do
    !$omp end do
    !$omp end parallel
    if (present(report)) call found%move_to(report)
  end subroutine assemble_rows

  !> One row by itself.
  subroutine assemble_row(scheme, kernel, x, y, volume, radius, row, stencil, laplacian, report)
    class(row_laplacian_t), intent(in) :: scheme
    class(kernel_t), intent(in) :: kernel
    real(wp), intent(in) :: x(:), y(:), volume(:), radius(:)
    integer, intent(in) :: row
    !> Workspace
    type(stencil_t), intent(inout) :: stencil
    !> With targets and neighbours in place
    type(sparse_operator_t), intent(inout) :: laplacian
    type(row_report_t), intent(inout) :: report
    real(wp) :: scale
    integer(i8) :: from, to

    from = laplacian%first(row)
    to = laplacian%first(row + 1) - 1
    scale = 1/radius(laplacian%target(row))
    call stencil%gather(kernel, x, y, volume, laplacian%target(row), laplacian%index(from:to), &
                        radius(laplacian%target(row)))
    call scheme%weights(stencil, laplacian%weight(from:to), laplacian%diagonal(row))
    laplacian%weight(from:to) = (laplacian%weight(from:to)*scale)*scale
    laplacian%diagonal(row) = (laplacian%diagonal(row)*scale)*scale
    call report%note(row, stencil)
  end subroutine assemble_row

  !> One row from the lane of a batch.
  pure subroutine take_from_batch(batch, lane, row, radius, laplacian, report)
    type(row_batch_t), intent(in) :: batch
    integer, intent(in) :: lane, row
    real(wp), intent(in) :: radius(:)
    type(sparse_operator_t), intent(inout) :: laplacian
    type(row_report_t), intent(inout) :: report
    real(wp) :: scale
    integer(i8) :: before
    integer :: k

    before = laplacian%first(row) - 1
    scale = 1/radius(laplacian%target(row))
    do k = 1, batch%length(lane)
      laplacian%weight(before + k) = (batch%weight(lane + lanes*(k - 1))*scale)*scale
    end do
    laplacian%diagonal(row) = (batch%diagonal(lane)*scale)*scale
    report%condition_gradient(row) = batch%condition_gradient(lane)
    report%condition_laplacian(row) = batch%condition_laplacian(lane)
    report%residual(row) = batch%residual(lane)
  end subroutine take_from_batch

end module calor_laplacian_scheme
