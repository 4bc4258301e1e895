!> Rows that keep the heat equation stable on any cloud.
!>
!> Where a row of a scheme is poor by the scheme's own rule, that particle's support grows by some
!> 10 to 15 % at a time until it is good. Where that does not help, the row becomes a stencil of
!> non-negative weights exact for quadratic fields (Seibold 2008). Where the cloud admits none, as
!> next to a wall that is much nearer than its particles are to each other, the row becomes the
!> stencil of non-negative weights that is exact for linear fields and nearest to exact for
!> quadratic ones: stable, but reported. Such a row on neighbours that are far too near, as those of
!> a particle that nearly touches a wall, is slowed down to what a row may cost.
module calor_stable_rows
  use calor_constants, only: worth_threads
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, ip, i8
  use calor_laplacian_positive, only: positive_t
  use calor_laplacian_scheme, only: laplacian_scheme_t, row_rule_t
  use calor_neighbour_list, only: neighbour_list_t
  use calor_row_quality, only: row_quality_t, measure_rows
  use calor_row_collection, only: row_collection_t
  use calor_row_report, only: row_report_t
  use calor_skin_list, only: skin_list_t, find_neighbours
  use calor_sparse_operator, only: sparse_operator_t
  implicit none (type, external)
  private

  public :: assemble_stable_rows, row_repairs_t
  public :: as_written, support_grown, positive_stencil, inexact_stencil, no_stencil

  !> What became of a row
  integer, parameter :: as_written = 0, support_grown = 1, positive_stencil = 2, &
                        inexact_stencil = 3, no_stencil = 4

  !> A row that misses a quadratic by more is poor; so is one that misses a moment that it was
  !> solved for by more
  real(wp), parameter :: largest_residual = 1.0e-7_wp, largest_moment_residual = 1.0e-10_wp
  !> |a_ii|, in units of the mean distance of the neighbours, may be so large where there is no
  !> other exact row: short steps are better than none
  real(wp), parameter :: most_stiffness = 1000.0_wp
  !> Growth ends after this many times, a factor of 45 at least
  integer, parameter :: most_times = 40
  !> A stencil that cannot be exact is sought among at least so many neighbours
  integer, parameter :: enough_neighbours = 24

  !> Which rows were repaired, and how
  type :: row_repairs_t
    !> One of `as_written`, `support_grown`, `positive_stencil`, `inexact_stencil`, or `no_stencil`
    !> (the row is zero) for each row
    integer, allocatable :: repair(:)
    !> Quality of the final rows
    type(row_quality_t) :: quality
    !> The largest radius, m, within which neighbours were looked for
    real(wp) :: widest = 0.0_wp
  end type row_repairs_t

contains

  !> Assemble rows of a scheme and repair the poor ones.
  subroutine assemble_stable_rows(scheme, kernel, x, y, volume, radius, targets, laplacian, &
                                  report, repairs, skin_list)
    !> The scheme
    class(laplacian_scheme_t), intent(in) :: scheme
    !> The smoothing kernel
    class(kernel_t), intent(in) :: kernel
    !> Coordinates, m, and volumes, m², of all particles
    real(wp), intent(in) :: x(:), y(:), volume(:)
    !> Support radii of all particles, m; those of the targets may grow
    real(wp), intent(inout) :: radius(:)
    !> The particles to assemble rows for
    integer(ip), intent(in) :: targets(:)
    !> ∇² at the targets
    type(sparse_operator_t), intent(out) :: laplacian
    !> The condition of the tensors that were solved for
    type(row_report_t), intent(out) :: report
    !> What was repaired
    type(row_repairs_t), intent(out) :: repairs
    !> Where neighbours are looked up first
    type(skin_list_t), intent(in), optional :: skin_list
    type(neighbour_list_t) :: list
    type(row_quality_t) :: quality
    type(row_collection_t) :: collection
    type(positive_t) :: positive
    type(row_rule_t), parameter :: usual = row_rule_t()
    type(row_rule_t) :: rule, replaced
    real(wp), allocatable :: first_radius(:)
    logical, allocatable :: poor(:)
    integer(ip), allocatable :: failed(:), replaced_rows(:)
    integer :: k

    allocate (repairs%repair(size(targets)), source=as_written)
    if (size(targets) > 0) repairs%widest = maxval(radius(targets))
    call find_neighbours(x, y, radius(targets), list, targets, skin_list)
    call scheme%assemble(kernel, x, y, volume, radius, list, laplacian, report, &
                         attempt=scheme%exact_degree() >= 2)
    if (scheme%exact_degree() < 2) then
      call surround(x, y, radius, list, repairs%repair, skin_list)
      if (size(targets) > 0) repairs%widest = maxval(radius(targets))
      if (any(repairs%repair == support_grown)) then
        call find_neighbours(x, y, radius(targets), list, targets, skin_list)
        call scheme%assemble(kernel, x, y, volume, radius, list, laplacian, report)
      end if
      call measure_rows(laplacian, x, y, radius, scheme%exact_degree(), repairs%quality)
      return
    end if
    call measure_rows(laplacian, x, y, radius, 2, quality)
    rule = scheme%rule()
    replaced = positive%rule()
    poor = is_poor(quality%ratio, quality%residual, quality%stiffness, rule%largest_ratio, &
                   largest_residual, rule%largest_stiffness) .or. &
           report%residual > largest_moment_residual
    if (.not. any(poor)) then
      repairs%quality = quality
      return
    end if
    first_radius = radius(targets)
    failed = pack([(int(k, ip), k=1, size(targets))], poor)
    call collection%start(size(targets))
    call collection%take([(int(k, ip), k=1, size(targets))], laplacian, report)
    repairs%repair(failed) = support_grown
    call grow(scheme, kernel, x, y, volume, radius, targets, 0, largest_residual, failed, &
              collection, repairs%widest, skin_list=skin_list)
    if (rule%largest_stiffness < usual%largest_stiffness) then
      ! Short steps at a few particles rather than a row of another scheme
      radius(targets(failed)) = first_radius(failed)/rule%growth
      call grow(scheme, kernel, x, y, volume, radius, targets, 0, largest_residual, failed, &
                collection, repairs%widest, allowed_stiffness=usual%largest_stiffness, &
                skin_list=skin_list)
    end if
    replaced_rows = failed
    repairs%repair(failed) = positive_stencil
    radius(targets(failed)) = first_radius(failed)/replaced%growth
    call grow(positive, kernel, x, y, volume, radius, targets, 0, largest_residual, failed, &
              collection, repairs%widest, skin_list=skin_list)
    radius(targets(failed)) = first_radius(failed)/replaced%growth
    call grow(positive, kernel, x, y, volume, radius, targets, 0, largest_residual, failed, &
              collection, repairs%widest, allowed_stiffness=most_stiffness, skin_list=skin_list)
    repairs%repair(failed) = inexact_stencil
    radius(targets(failed)) = first_radius(failed)/replaced%growth
    call grow(positive_t(relaxed=.true.), kernel, x, y, volume, radius, targets, &
              enough_neighbours, huge(1.0_wp), failed, collection, repairs%widest, &
              skin_list=skin_list)
    radius(targets(failed)) = first_radius(failed)/replaced%growth
    call grow(positive_t(relaxed=.true.), kernel, x, y, volume, radius, targets, &
              enough_neighbours, huge(1.0_wp), failed, collection, repairs%widest, &
              allowed_stiffness=huge(1.0_wp), skin_list=skin_list)
    repairs%repair(failed) = no_stencil
    radius(targets(failed)) = first_radius(failed)
    call assemble_again(scheme, kernel, x, y, volume, radius, targets, failed, collection, &
                        skin_list)
    call collection%merge_into(laplacian, report)
    call report_as_written(scheme, kernel, x, y, volume, radius, targets, replaced_rows, report, &
                           skin_list)
    do k = 1, size(targets)
      if (repairs%repair(k) == no_stencil) call scale_row(laplacian, k, 0.0_wp)
    end do
    call measure_rows(laplacian, x, y, radius, 2, repairs%quality)
    if (all(repairs%repair /= inexact_stencil)) return
    do k = 1, size(targets)
      if (repairs%repair(k) /= inexact_stencil) cycle
      if (repairs%quality%stiffness(k) <= most_stiffness) cycle
      call scale_row(laplacian, k, most_stiffness/repairs%quality%stiffness(k))
    end do
    call measure_rows(laplacian, x, y, radius, 2, repairs%quality)
  end subroutine assemble_stable_rows

  pure subroutine scale_row(laplacian, row, factor)
    type(sparse_operator_t), intent(inout) :: laplacian
    integer, intent(in) :: row
    real(wp), intent(in) :: factor

    associate (from => laplacian%first(row), to => laplacian%first(row + 1) - 1)
      laplacian%weight(from:to) = factor*laplacian%weight(from:to)
      laplacian%diagonal(row) = factor*laplacian%diagonal(row)
    end associate
  end subroutine scale_row

  !> Grow the supports of particles until their neighbours surround them.
  subroutine surround(x, y, radius, first_list, repair, skin_list)
    real(wp), intent(in) :: x(:), y(:)
    real(wp), intent(inout) :: radius(:)
    !> Neighbours before any growth
    type(neighbour_list_t), intent(in) :: first_list
    !> Becomes `support_grown` where that was so
    integer, intent(inout) :: repair(:)
    type(skin_list_t), intent(in), optional :: skin_list
    type(row_rule_t), parameter :: usual = row_rule_t()
    type(neighbour_list_t) :: list
    integer(ip), allocatable :: rows(:), candidates(:)
    logical, allocatable :: alone(:)
    integer :: k, time

    rows = [(int(k, ip), k=1, first_list%rows())]
    list = first_list
    do time = 0, most_times
      allocate (alone(list%rows()))
      !$omp parallel do if (list%rows() > worth_threads) schedule(static) default(shared) private(k)
      do k = 1, list%rows()
        associate (neighbour => list%index(list%first(k):list%first(k + 1) - 1), &
                   i => list%target(k))
          ! A radius that reaches every particle can do no more.
          alone(k) = size(neighbour) < size(x) - 1 .and. &
                     .not. surrounded(x(neighbour) - x(i), y(neighbour) - y(i))
        end associate
      end do
      !$omp end parallel do
      rows = pack(rows, alone)
      deallocate (alone)
      if (size(rows) == 0 .or. time == most_times) return
      repair(rows) = support_grown
      candidates = first_list%target(rows)
      radius(candidates) = usual%growth*radius(candidates)
      call find_neighbours(x, y, radius(candidates), list, candidates, skin_list)
    end do
  end subroutine surround

  !> Whether no straight line through the origin has all points on one side of it.
  pure function surrounded(dx, dy) result(answer)
    real(wp), intent(in) :: dx(:), dy(:)
    logical :: answer
    logical :: quadrant(4)
    integer :: k

    ! The usual case, and the cheap one
    quadrant = [any(dx > 0 .and. dy >= 0), any(dx <= 0 .and. dy > 0), any(dx < 0 .and. dy <= 0), &
                any(dx >= 0 .and. dy < 0)]
    answer = all(quadrant)
    if (answer .or. size(dx) < 3) return
    ! Along each neighbour's direction there must be others on the left and on the right, or it is
    ! an outermost one; two opposite ones alone do not surround.
    do k = 1, size(dx)
      if (.not. any(dx(k)*dy - dy(k)*dx > 0)) return
      if (.not. any(dx(k)*dy - dy(k)*dx < 0)) return
    end do
    answer = .true.
  end function surrounded

  elemental function is_poor(ratio, residual, stiffness, allowed_ratio, allowed_residual, &
                             allowed_stiffness) result(poor)
    real(wp), intent(in) :: ratio, residual, stiffness
    real(wp), intent(in) :: allowed_ratio, allowed_residual, allowed_stiffness
    logical :: poor

    poor = .not. (ratio <= allowed_ratio .and. residual <= allowed_residual .and. &
                  stiffness <= allowed_stiffness)
  end function is_poor

  !> Grow the supports of some rows until they are good.
  subroutine grow(scheme, kernel, x, y, volume, radius, targets, fewest, allowed_residual, rows, &
                  collection, widest, allowed_stiffness, skin_list)
    class(laplacian_scheme_t), intent(in) :: scheme
    class(kernel_t), intent(in) :: kernel
    real(wp), intent(in) :: x(:), y(:), volume(:)
    real(wp), intent(inout) :: radius(:)
    integer(ip), intent(in) :: targets(:)
    !> A row needs so many neighbours …
    integer, intent(in) :: fewest
    !> … and may miss quadratic fields by so much
    real(wp), intent(in) :: allowed_residual
    !> The poor rows, as positions in `targets`; in the end those that could not be made good
    integer(ip), allocatable, intent(inout) :: rows(:)
    !> Takes every row found
    type(row_collection_t), intent(inout) :: collection
    !> Becomes the largest radius tried, m
    real(wp), intent(inout) :: widest
    !> … and be so stiff, if that is not the usual bound
    real(wp), intent(in), optional :: allowed_stiffness
    type(skin_list_t), intent(in), optional :: skin_list
    type(neighbour_list_t) :: list
    type(sparse_operator_t) :: laplacian
    real(wp) :: stiffness
    type(row_quality_t) :: quality
    type(row_report_t) :: report
    type(row_rule_t) :: rule
    integer(ip), allocatable :: failed(:), candidates(:)
    integer, allocatable :: neighbours(:)
    logical, allocatable :: poor(:)
    integer :: time

    rule = scheme%rule()
    stiffness = rule%largest_stiffness
    if (present(allowed_stiffness)) stiffness = allowed_stiffness
    allocate (failed(0))
    do time = 1, most_times
      if (size(rows) == 0) exit
      radius(targets(rows)) = rule%growth*radius(targets(rows))
      candidates = targets(rows)
      widest = max(widest, maxval(radius(candidates)))
      call find_neighbours(x, y, radius(candidates), list, candidates, skin_list)
      call scheme%assemble(kernel, x, y, volume, radius, list, laplacian, report, attempt=.true.)
      call measure_rows(laplacian, x, y, radius, 2, quality)
      neighbours = int(list%first(2:) - list%first(:list%rows()))
      poor = is_poor(quality%ratio, quality%residual, quality%stiffness, rule%largest_ratio, &
                     allowed_residual, stiffness) .or. &
             report%residual > largest_moment_residual .or. &
             neighbours < min(fewest, size(x) - 1)
      call collection%take(rows, laplacian, report)
      rows = pack(rows, poor)
      neighbours = pack(neighbours, poor)
      failed = [failed, pack(rows, neighbours >= min(rule%most_neighbours, size(x) - 1))]
      rows = pack(rows, neighbours < min(rule%most_neighbours, size(x) - 1))
    end do
    rows = [failed, rows]
  end subroutine grow

  !> Rows of a scheme with the supports that they have now.
  subroutine assemble_again(scheme, kernel, x, y, volume, radius, targets, rows, collection, &
                            skin_list)
    class(laplacian_scheme_t), intent(in) :: scheme
    class(kernel_t), intent(in) :: kernel
    real(wp), intent(in) :: x(:), y(:), volume(:), radius(:)
    integer(ip), intent(in) :: targets(:)
    !> The rows, as positions in `targets`
    integer(ip), intent(in) :: rows(:)
    !> Takes them
    type(row_collection_t), intent(inout) :: collection
    type(skin_list_t), intent(in), optional :: skin_list
    type(neighbour_list_t) :: list
    type(sparse_operator_t) :: laplacian
    type(row_report_t) :: report

    if (size(rows) == 0) return
    call find_neighbours(x, y, radius(targets(rows)), list, targets(rows), skin_list)
    call scheme%assemble(kernel, x, y, volume, radius, list, laplacian, report)
    call collection%take(rows, laplacian, report)
  end subroutine assemble_again

  !> Of rows that became other stencils, what the scheme itself had to say about them.
  subroutine report_as_written(scheme, kernel, x, y, volume, radius, targets, rows, report, &
                               skin_list)
    class(laplacian_scheme_t), intent(in) :: scheme
    class(kernel_t), intent(in) :: kernel
    real(wp), intent(in) :: x(:), y(:), volume(:), radius(:)
    integer(ip), intent(in) :: targets(:)
    !> The rows, as positions in `targets`
    integer(ip), intent(in) :: rows(:)
    !> Their entries are set
    type(row_report_t), intent(inout) :: report
    type(skin_list_t), intent(in), optional :: skin_list
    type(neighbour_list_t) :: list
    type(sparse_operator_t) :: laplacian
    type(row_report_t) :: found

    if (size(rows) == 0) return
    call find_neighbours(x, y, radius(targets(rows)), list, targets(rows), skin_list)
    call scheme%assemble(kernel, x, y, volume, radius, list, laplacian, found)
    report%condition_gradient(rows) = found%condition_gradient
    report%condition_laplacian(rows) = found%condition_laplacian
    report%residual(rows) = found%residual
  end subroutine report_as_written

end module calor_stable_rows
