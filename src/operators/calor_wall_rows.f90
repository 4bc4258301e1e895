!> Rows for ∇² at particles on a wall, which take the normal derivative there as a further datum.
!>
!> ⟨∇²u⟩_i = Σ a_ij (u_j - u_i) + Σ b_ik ∂u/∂n_k, exact for all polynomials up to a degree; at a
!> corner k runs over both walls. With κ ∂u/∂n = q, the heat flux into the body, a boundary that
!> gives, or computes, a flux becomes a power b q, W/m³, at the particle.
!>
!> Such a row is solved for like any other (see calor_taylor_weights), its norm left free of b:
!> with all neighbours on one side of the wall, Σ a_ij r_ji·n + b = 0 (n the outward normal) says
!> that b is positive if the weights a are,
!> and that it balances first moments along n which nothing else
!> could balance with positive weights. On a lattice with the four nearest neighbours the row is
!> that of finite differences with a mirrored particle: 2/Δ² for the inner neighbour, b = 2/Δ. A
!> row whose weights are too negative, or whose b is not positive, takes more neighbours; where that
!> does not help, it becomes a stencil of non-negative weights exact for quadratic fields.
module calor_wall_rows
  use calor_constants, only: pi
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, ip, i8
  use calor_laplacian_scheme, only: row_rule_t
  use calor_linear_programme, only: minimise
  use calor_neighbour_list, only: neighbour_list_t
  use calor_row_quality, only: row_quality_t
  use calor_row_report, only: row_report_t
  use calor_skin_list, only: skin_list_t, find_neighbours
  use calor_sparse_operator, only: sparse_operator_t
  use calor_stable_rows, only: as_written, support_grown, positive_stencil, no_stencil
  use calor_stencil, only: stencil_t
  use calor_taylor_weights, only: taylor_weights, monomials, monomial_position
  implicit none (type, external)
  private

  public :: assemble_wall_rows, wall_rows_t

  !> Rows at wall particles
  type :: wall_rows_t
    !> The weights a
    type(sparse_operator_t) :: laplacian
    !> The weights b, 1/m, in the order of the normals
    real(wp), allocatable :: slope_weight(:)
    !> What became of each row, as in calor_stable_rows
    integer, allocatable :: repair(:)
    !> Quality of the rows, the part of b included
    type(row_quality_t) :: quality
    !> Condition of the systems solved
    type(row_report_t) :: report
    !> The largest radius, m, within which neighbours were looked for
    real(wp) :: widest = 0.0_wp
  end type wall_rows_t

  !> What a row may miss of its moments, in units of the support radius
  real(wp), parameter :: largest_residual = 1.0e-9_wp
  !> Growth ends after this many times
  integer, parameter :: most_times = 40
  !> No wall particle has more normals
  integer, parameter :: most_normals = 8

  !> So few rows are assembled sooner by one thread than others could be woken
  integer, parameter :: worth_sharing = 64

contains

  !> Assemble rows at particles on walls.
  subroutine assemble_wall_rows(degree, rule, kernel, x, y, volume, radius, particles, first, &
                                normal, rows, skin_list)
    !> Exact for polynomials up to this degree, at least 2
    integer, intent(in) :: degree
    !> What is asked of a row
    type(row_rule_t), intent(in) :: rule
    !> The smoothing kernel
    class(kernel_t), intent(in) :: kernel
    !> Coordinates, m, and volumes, m², of all particles
    real(wp), intent(in) :: x(:), y(:), volume(:)
    !> Support radii of all particles, m; those of the wall particles may grow
    real(wp), intent(inout) :: radius(:)
    !> The wall particles, and where the normals of each begin in `normal`, one more at the end
    integer(ip), intent(in) :: particles(:)
    integer, intent(in) :: first(:)
    !> Outward unit normals, one a column
    real(wp), intent(in) :: normal(:, :)
    !> The rows
    type(wall_rows_t), intent(out) :: rows
    !> Where neighbours are looked up first
    type(skin_list_t), intent(in), optional :: skin_list
    integer, allocatable :: pending(:)
    real(wp), allocatable :: first_radius(:)

    allocate (rows%repair(size(particles)), source=as_written)
    first_radius = radius(particles)
    call grow(norm_minimal=.true.)
    if (any(rows%repair == no_stencil)) call grow(norm_minimal=.false.)
    call assemble_final()

  contains

    !> Grow supports until rows are good. What is not good at last is marked `no_stencil`.
    subroutine grow(norm_minimal)
      logical, intent(in) :: norm_minimal
      type(neighbour_list_t) :: list
      type(sparse_operator_t) :: trial
      type(stencil_t) :: stencil
      logical, allocatable :: good(:), large(:)
      real(wp) :: b(most_normals), ratio, stiffness, residual
      integer :: k, time

      if (norm_minimal) then
        pending = [(k, k=1, size(particles))]
      else
        pending = pack([(k, k=1, size(particles))], rows%repair == no_stencil)
        radius(particles(pending)) = first_radius(pending)
      end if
      do time = 0, most_times
        if (size(pending) == 0) return
        rows%widest = max(rows%widest, maxval(radius(particles(pending))))
        call find_neighbours(x, y, radius(particles(pending)), list, particles(pending), skin_list)
        call trial%shape_as(list)
        allocate (good(size(pending)), large(size(pending)))
        !$omp parallel if (size(pending) > worth_sharing) default(shared) &
        !$omp private(k, b, ratio, stiffness, residual) &
        !$omp firstprivate(stencil)
        call stencil%reserve(list%longest_row())
        !$omp do schedule(dynamic, 8)
        do k = 1, size(pending)
          call one_row(norm_minimal, pending(k), list, k, stencil, trial, b)
          call judge(trial, k, radius(particles(pending(k))), stencil%residual, &
                     b(1:first(pending(k) + 1) - first(pending(k))), ratio, stiffness, residual)
          good(k) = ratio <= rule%largest_ratio .and. stiffness <= rule%largest_stiffness .and. &
                    residual <= largest_residual
          large(k) = list%first(k + 1) - list%first(k) >= min(rule%most_neighbours, size(x) - 1)
        end do
        !$omp end do
        !$omp end parallel
        do k = 1, size(pending)
          if (good(k)) then
            rows%repair(pending(k)) = as_written
            if (time > 0) rows%repair(pending(k)) = support_grown
            if (.not. norm_minimal) rows%repair(pending(k)) = positive_stencil
          else
            rows%repair(pending(k)) = no_stencil
          end if
        end do
        pending = pack(pending, .not. (good .or. large))
        deallocate (good, large)
        radius(particles(pending)) = rule%growth*radius(particles(pending))
      end do
    end subroutine grow

    !> All rows on their final supports
    subroutine assemble_final()
      type(neighbour_list_t) :: list
      type(stencil_t) :: stencil
      real(wp) :: b(most_normals), ratio, stiffness, residual
      integer :: k, normals

      where (rows%repair == no_stencil) radius(particles) = first_radius
      call find_neighbours(x, y, radius(particles), list, particles, skin_list)
      call rows%laplacian%shape_as(list)
      call rows%report%reserve(size(particles))
      associate (quality => rows%quality, n => size(particles))
        allocate (quality%ratio(n), quality%residual(n), quality%stiffness(n), &
                  quality%neighbours(n))
      end associate
      allocate (rows%slope_weight(size(normal, 2)), source=0.0_wp)
      !$omp parallel if (size(particles) > worth_sharing) default(shared) &
      !$omp private(k, b, ratio, stiffness, residual, normals) &
      !$omp firstprivate(stencil)
      call stencil%reserve(list%longest_row())
      !$omp do schedule(dynamic, 8)
      do k = 1, size(particles)
        normals = first(k + 1) - first(k)
        associate (from => list%first(k), to => list%first(k + 1) - 1)
          call one_row(rows%repair(k) /= positive_stencil, k, list, k, stencil, rows%laplacian, b)
          if (rows%repair(k) == no_stencil) then
            rows%laplacian%weight(from:to) = 0
            rows%laplacian%diagonal(k) = 0
            b = 0
          end if
          call judge(rows%laplacian, k, radius(particles(k)), stencil%residual, b(1:normals), &
                     ratio, stiffness, residual)
          rows%quality%neighbours(k) = count(abs(rows%laplacian%weight(from:to)) > 0)
        end associate
        rows%quality%ratio(k) = ratio
        rows%quality%stiffness(k) = stiffness
        rows%quality%residual(k) = stencil%residual
        rows%slope_weight(first(k):first(k + 1) - 1) = b(1:normals)/radius(particles(k))
        call rows%report%note(k, stencil)
        ! The one tensor of the row; schemes report theirs for particles inside.
        rows%report%condition_laplacian(k) = 0
      end do
      !$omp end do
      !$omp end parallel
    end subroutine assemble_final

    !> The weights of particle number `which` into row `row` of an operator, and b in units of the
    !> support radius.
    subroutine one_row(norm_minimal, which, list, row, stencil, operator, b)
      logical, intent(in) :: norm_minimal
      integer, intent(in) :: which
      type(neighbour_list_t), intent(in) :: list
      integer, intent(in) :: row
      type(stencil_t), intent(inout) :: stencil
      type(sparse_operator_t), intent(inout) :: operator
      real(wp), intent(out) :: b(:)
      real(wp) :: scale

      associate (from => list%first(row), to => list%first(row + 1) - 1, &
                 outward => normal(:, first(which):first(which + 1) - 1), &
                 h => radius(particles(which)))
        call stencil%gather(kernel, x, y, volume, particles(which), list%index(from:to), h)
        if (norm_minimal) then
          call norm_minimal_row(stencil, degree, outward, operator%weight(from:to), b)
        else
          call positive_row(stencil, outward, operator%weight(from:to), b)
        end if
        scale = 1/h
        operator%weight(from:to) = (operator%weight(from:to)*scale)*scale
        operator%diagonal(row) = -sum(operator%weight(from:to))
      end associate
    end subroutine one_row

  end subroutine assemble_wall_rows

  !> The weights of least norm.
  subroutine norm_minimal_row(stencil, degree, outward, weight, b)
    type(stencil_t), intent(inout) :: stencil
    integer, intent(in) :: degree
    real(wp), intent(in) :: outward(:, :)
    real(wp), intent(out) :: weight(:), b(:)
    real(wp) :: wanted(monomials(degree), 1), found(stencil%n, 1), slope(size(outward, 2), 1)

    wanted = 0
    wanted(monomial_position(2, 0), 1) = 2
    wanted(monomial_position(0, 2), 1) = 2
    call taylor_weights(stencil, degree, wanted, found, stencil%condition_laplacian, outward, &
                        slope)
    weight = found(:, 1)
    b(1:size(outward, 2)) = slope(:, 1)
  end subroutine norm_minimal_row

  !> Non-negative weights, exact for quadratic fields, by a linear programme that likes neighbours
  !> near (see calor_laplacian_positive).
  subroutine positive_row(stencil, outward, weight, b)
    type(stencil_t), intent(inout) :: stencil
    real(wp), intent(in) :: outward(:, :)
    real(wp), intent(out) :: weight(:), b(:)
    integer, parameter :: m = 5
    real(wp) :: cost(stencil%n + size(outward, 2)), moments(m, stencil%n + size(outward, 2))
    real(wp) :: solution(stencil%n + size(outward, 2))
    real(wp) :: tableau(0:m, 0:stencil%n + size(outward, 2) + m), shortest
    integer :: basis(m), k, n
    logical :: feasible

    shortest = 0.5_wp*sqrt(pi/(stencil%n + 1))
    n = stencil%n
    do k = 1, n
      associate (q => stencil%q(k), ex => stencil%ex(k), ey => stencil%ey(k))
        moments(:, k) = [ex, ey, q*ex*ex, q*ex*ey, q*ey*ey]
        cost(k) = max(q, shortest)**4/q
      end associate
    end do
    cost(n + 1:) = 0
    moments(:, n + 1:) = 0
    ! e_ij points from the neighbour to the particle
    moments(1:2, n + 1:) = -outward
    call minimise(cost, moments, [0.0_wp, 0.0_wp, 2.0_wp, 0.0_wp, 2.0_wp], solution, tableau, &
                  basis, feasible)
    stencil%residual = merge(0.0_wp, huge(1.0_wp), feasible)
    do k = 1, n
      weight(k) = solution(k)/stencil%q(k)
    end do
    b(1:size(outward, 2)) = solution(n + 1:)
  end subroutine positive_row

  !> How good a row is; it has no quality where a b is not positive, for then heat that flows in
  !> would cool the particle.
  pure subroutine judge(operator, row, h, missed, b, ratio, stiffness, residual)
    type(sparse_operator_t), intent(in) :: operator
    integer, intent(in) :: row
    !> Support radius, m
    real(wp), intent(in) :: h
    !> What was missed of the moments
    real(wp), intent(in) :: missed
    real(wp), intent(in) :: b(:)
    real(wp), intent(out) :: ratio, stiffness, residual
    real(wp) :: total

    associate (from => operator%first(row), to => operator%first(row + 1) - 1, &
               diagonal => operator%diagonal(row))
      total = sum(abs(operator%weight(from:to)))
      ratio = huge(1.0_wp)
      if (diagonal < 0 .and. all(b > 0) .and. total < -1.0e3_wp*diagonal) ratio = -total/diagonal
      ! Half a disc of the support radius is shared by the particle and its neighbours.
      stiffness = abs(diagonal)*h**2*0.5_wp*pi/real(max(1, int(1 + to - from)), wp)
      residual = missed
    end associate
  end subroutine judge

end module calor_wall_rows
