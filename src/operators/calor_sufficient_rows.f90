!> Rows of derivatives on any cloud, to evaluate them: where a particle's neighbours do not
!> determine its row, as next to a wall, its support grows until they do.
!>
!> Such rows are exact and do not amplify errors of the field much, at walls too. Whether the heat
!> equation would be stable with them is not asked: see calor_stable_rows.
module calor_sufficient_rows
  use calor_constants, only: pi
  use calor_gradient_scheme, only: gradient_scheme_t
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, ip
  use calor_laplacian_scheme, only: laplacian_scheme_t
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_row_collection, only: row_collection_t
  use calor_row_report, only: row_report_t
  use calor_sparse_operator, only: sparse_operator_t
  implicit none (type, external)
  private

  public :: assemble_sufficient_gradient, assemble_sufficient_laplacian

  !> A row that misses a moment by more, in units of the support radius, is poor
  real(wp), parameter :: largest_residual = 1.0e-10_wp
  !> So is one whose Σ|a_ij|, in units of the mean distance between neighbours, is larger: it would
  !> amplify what errors a field has. Central differences of second order have 1 and 8, one-sided
  !> ones 4 and 20.
  real(wp), parameter :: largest_gradient = 6.0_wp, largest_laplacian = 60.0_wp
  !> By how much a support grows at a time, and how often at most
  real(wp), parameter :: growth = 1.1_wp
  integer, parameter :: most_times = 40

contains

  !> Assemble rows of a gradient scheme with supports as large as they need.
  subroutine assemble_sufficient_gradient(scheme, kernel, x, y, volume, radius, targets, &
                                          gradient_x, gradient_y, report)
    !> The scheme
    class(gradient_scheme_t), intent(in) :: scheme
    !> The smoothing kernel
    class(kernel_t), intent(in) :: kernel
    !> Coordinates, m, and volumes, m², of all particles
    real(wp), intent(in) :: x(:), y(:), volume(:)
    !> Support radii of all particles, m; those of the targets may grow
    real(wp), intent(inout) :: radius(:)
    !> The particles to assemble rows for
    integer(ip), intent(in) :: targets(:)
    !> ∂/∂x and ∂/∂y at the targets
    type(sparse_operator_t), intent(out) :: gradient_x, gradient_y
    !> The condition of the systems that were solved; `residual` tells of rows that no growth could
    !> help, as on a cloud with fewer particles than a row needs
    type(row_report_t), intent(out) :: report
    type(neighbour_list_t) :: list
    integer(ip), allocatable :: rows(:), candidates(:)
    integer :: time

    rows = all_of(targets)
    do time = 0, most_times
      candidates = targets(rows)
      call build_neighbour_list(x, y, radius(candidates), list, candidates)
      call scheme%assemble(kernel, x, y, volume, radius, list, gradient_x, gradient_y, report)
      rows = pack(rows, can_grow(list, size(x)) .and. &
                  (poor(gradient_x, radius, 1, largest_gradient, report) .or. &
                   poor(gradient_y, radius, 1, largest_gradient, report)))
      if (size(rows) == 0) exit
      radius(targets(rows)) = growth*radius(targets(rows))
    end do
    if (time == 0) return
    call build_neighbour_list(x, y, radius(targets), list, targets)
    call scheme%assemble(kernel, x, y, volume, radius, list, gradient_x, gradient_y, report)
  end subroutine assemble_sufficient_gradient

  !> Assemble rows of a Laplacian scheme with supports as large as they need.
  subroutine assemble_sufficient_laplacian(scheme, kernel, x, y, volume, radius, targets, &
                                           laplacian, report)
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
    !> As above
    type(row_report_t), intent(out) :: report
    type(neighbour_list_t) :: list
    type(row_collection_t) :: collection
    integer(ip), allocatable :: rows(:), candidates(:)
    logical, allocatable :: unfinished(:)
    integer :: time

    rows = all_of(targets)
    call collection%start(size(targets))
    do time = 0, most_times
      candidates = targets(rows)
      call build_neighbour_list(x, y, radius(candidates), list, candidates)
      call scheme%assemble(kernel, x, y, volume, radius, list, laplacian, report)
      unfinished = can_grow(list, size(x)) .and. &
                   poor(laplacian, radius, 2, largest_laplacian, report)
      call collection%take(rows, laplacian, report)
      rows = pack(rows, unfinished)
      if (size(rows) == 0 .or. time == most_times) exit
      radius(targets(rows)) = growth*radius(targets(rows))
    end do
    call collection%merge_into(laplacian, report)
  end subroutine assemble_sufficient_laplacian

  pure function all_of(targets) result(rows)
    integer(ip), intent(in) :: targets(:)
    integer(ip) :: rows(size(targets))
    integer :: k

    rows = [(int(k, ip), k=1, size(targets))]
  end function all_of

  !> Whether a larger support could find further neighbours
  pure function can_grow(list, particles)
    type(neighbour_list_t), intent(in) :: list
    integer, intent(in) :: particles
    logical :: can_grow(list%rows())

    can_grow = list%first(2:) - list%first(:list%rows()) < particles - 1
  end function can_grow

  pure function poor(derivative, radius, power, largest, report)
    type(sparse_operator_t), intent(in) :: derivative
    !> Support radii of all particles, m
    real(wp), intent(in) :: radius(:)
    !> 1 for a first derivative, 2 for a second one
    integer, intent(in) :: power
    real(wp), intent(in) :: largest
    type(row_report_t), intent(in) :: report
    logical :: poor(derivative%rows())
    real(wp) :: distance
    integer :: row

    do row = 1, derivative%rows()
      associate (from => derivative%first(row), to => derivative%first(row + 1) - 1)
        distance = radius(derivative%target(row))*sqrt(pi/(to - from + 2))
        poor(row) = .not. (report%residual(row) <= largest_residual .and. &
                           sum(abs(derivative%weight(from:to)))*distance**power <= largest)
      end associate
    end do
  end function poor

end module calor_sufficient_rows
