!> Rows for div(K ∇u) where K is a tensor or where neighbours lie beyond an interface.
!>
!> ⟨div K∇u⟩_i = Σ a_ij (u_j - u_i) + Σ b_ik q_k with q = n·K∇u on walls, the weights of least norm
!> Σ a_ij²/ω_ij that are exact for a basis of functions. A flow model says what the basis is: on a
!> neighbour beyond an interface a polynomial is continued as temperature and flux demand. Rows are
!> judged and their supports grow as those of calor_wall_rows do. Where that does not help they are
!> made of a lower degree, at last as stencils of non-negative weights exact for the functions of
!> degree 2.
module calor_flow_rows
  use calor_constants, only: pi
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, ip
  use calor_lapack, only: dgelss
  use calor_laplacian_scheme, only: row_rule_t
  use calor_linear_programme, only: minimise
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_row_quality, only: row_quality_t
  use calor_row_report, only: row_report_t
  use calor_sparse_operator, only: sparse_operator_t
  use calor_stable_rows, only: as_written, support_grown, positive_stencil, no_stencil
  use calor_stencil, only: stencil_t
  use calor_taylor_weights, only: monomials
  implicit none (type, external)
  private

  public :: flow_model_t, flow_rows_t, assemble_flow_rows

  !> What div(K ∇u) is at a particle
  type, abstract :: flow_model_t
  contains
    !> The basis of a particle's row
    procedure(describe_interface), deferred :: describe
  end type flow_model_t

  !> Rows at some particles, in W/(m³ K)
  type :: flow_rows_t
    !> The weights a
    type(sparse_operator_t) :: operator
    !> The weights b, 1/m, in the order of the normals
    real(wp), allocatable :: slope_weight(:)
    !> What became of each row, as in calor_stable_rows
    integer, allocatable :: repair(:)
    !> Quality of the rows, the part of b included
    type(row_quality_t) :: quality
    !> Condition of the systems solved: not reported, all entries 0
    type(row_report_t) :: report
    !> The largest radius, m, within which neighbours were looked for
    real(wp) :: widest = 0.0_wp
  end type flow_rows_t

  abstract interface
    !> Functions P of degree 1 … `degree`, in the order of calor_taylor_weights, 0 at the particle,
    !> with offsets in units of the support radius
    subroutine describe_interface(this, particle, neighbours, dx, dy, radius, degree, wanted, &
                                  basis, known, outward, slope, slope_beyond, pace, &
                                  ease, passing)
      import :: flow_model_t, wp, ip
      implicit none (type, external)
      class(flow_model_t), intent(in) :: this
      !> The particle and its neighbours
      integer(ip), intent(in) :: particle
      integer(ip), intent(in) :: neighbours(:)
      !> Their offsets from the particle in units of the support radius, and that, m
      real(wp), intent(in) :: dx(:), dy(:), radius
      !> The degree
      integer, intent(in) :: degree
      !> div(K ∇P) at the particle times the square of the support radius
      real(wp), intent(out) :: wanted(:)
      !> P at the neighbours, one a column
      real(wp), intent(out) :: basis(:, :)
      !> Whether P is known at a neighbour
      logical, intent(out) :: known(:)
      !> Outward normals of walls at the particle, one a column
      real(wp), intent(in) :: outward(:, :)
      !> n·K∇P at the particle times the support radius, a column for each normal
      real(wp), intent(out) :: slope(:, :)
      !> The same of the material beyond an interface that meets the wall at the particle; 0 where
      !> there is none
      real(wp), intent(out) :: slope_beyond(:, :)
      !> How many times faster than at the particle heat spreads beyond an interface; 1 at least.
      !> Next to a much faster material a row is as stiff as one of that
      real(wp), intent(out) :: pace
      !> How much better than its own material what lies between the particle and a neighbour
      !> conducts; 1 at least
      real(wp), intent(out) :: ease(:)
      !> How much better or worse than its own material the way to a neighbour conducts where it
      !> goes through two materials, one after the other; else 1
      real(wp), intent(out) :: passing(:)
    end subroutine describe_interface
  end interface

  !> What a row may miss of a moment, as a part of what the moment is made up of
  real(wp), parameter :: largest_residual = 1.0e-10_wp
  !> Singular values below this part of the largest count as 0
  real(wp), parameter :: smallest_singular = 1.0e-9_wp
  !> Growth ends after this many times
  integer, parameter :: most_times = 30
  !> Rows of a degree above 2 have at most so many neighbours for each function
  integer, parameter :: widest_row = 5
  !> No particle has more normals
  integer, parameter :: most_normals = 8
  !> As in calor_taylor_weights
  real(wp), parameter :: nearest = 0.5_wp, cheap = 1.0e3_wp

  !> So few rows are assembled sooner by one thread than others could be woken
  integer, parameter :: worth_sharing = 64

contains

  !> Assemble rows.
  subroutine assemble_flow_rows(model, degree, rule, kernel, x, y, volume, radius, particles, &
                                first, normal, flux_is_given, rows)
    !> What the rows are exact for
    class(flow_model_t), intent(in) :: model
    !> … up to this degree, at least 2; where that gives no good row, to a lower one
    integer, intent(in) :: degree
    !> What is asked of a row
    type(row_rule_t), intent(in) :: rule
    !> The smoothing kernel
    class(kernel_t), intent(in) :: kernel
    !> Coordinates, m, and volumes, m², of all particles
    real(wp), intent(in) :: x(:), y(:), volume(:)
    !> Support radii of all particles, m; those of the particles may grow
    real(wp), intent(inout) :: radius(:)
    !> The particles, and where the normals of each begin in `normal`, one more at the end
    integer(ip), intent(in) :: particles(:)
    integer, intent(in) :: first(:)
    !> Outward unit normals, one a column; none of a particle within the body
    real(wp), intent(in) :: normal(:, :)
    !> Whether the flux through the walls is given, and so the same on both sides of an interface
    logical, intent(in) :: flux_is_given
    !> The rows
    type(flow_rows_t), intent(out) :: rows
    integer, allocatable :: pending(:)
    real(wp), allocatable :: first_radius(:)
    type(row_rule_t), parameter :: usual = row_rule_t()
    integer :: exact(size(particles)), k, trial_degree

    allocate (rows%repair(size(particles)), source=as_written)
    first_radius = radius(particles)
    pending = [(k, k=1, size(particles))]
    do trial_degree = degree, 2, -1
      exact(pending) = trial_degree
      call grow(.true., rule%largest_stiffness)
      ! Short steps at a few particles rather than another stencil
      if (rule%largest_stiffness < usual%largest_stiffness) then
        call grow(.true., usual%largest_stiffness)
      end if
    end do
    call grow(.false., usual%largest_stiffness)
    where (rows%repair == no_stencil) radius(particles) = first_radius
    call assemble_final()

  contains

    !> Grow supports until rows are good. What is not good at last stays pending, marked
    !> `no_stencil`.
    subroutine grow(norm_minimal, largest_stiffness)
      logical, intent(in) :: norm_minimal
      real(wp), intent(in) :: largest_stiffness
      type(neighbour_list_t) :: list
      type(sparse_operator_t) :: trial
      type(stencil_t) :: stencil
      logical, allocatable :: good(:), large(:)
      integer, allocatable :: failed(:)
      real(wp) :: b(most_normals), ratio, stiffness
      integer :: k, time

      radius(particles(pending)) = first_radius(pending)
      allocate (failed(0))
      do time = 0, most_times
        if (size(pending) == 0) exit
        rows%widest = max(rows%widest, maxval(radius(particles(pending))))
        call build_neighbour_list(x, y, radius(particles(pending)), list, particles(pending))
        call trial%shape_as(list)
        allocate (good(size(pending)), large(size(pending)))
        !$omp parallel if (size(pending) > worth_sharing) default(shared) &
        !$omp private(k, b, ratio, stiffness) firstprivate(stencil)
        call stencil%reserve(list%longest_row())
        !$omp do schedule(dynamic, 8)
        do k = 1, size(pending)
          call one_row(norm_minimal, pending(k), list, k, stencil, trial, b, ratio, stiffness)
          good(k) = ratio <= rule%largest_ratio .and. stiffness <= largest_stiffness .and. &
                    stencil%residual <= largest_residual
          large(k) = list%first(k + 1) - list%first(k) >= &
                     min(most_neighbours(exact(pending(k))), size(x) - 1)
        end do
        !$omp end do
        !$omp end parallel
        do k = 1, size(pending)
          rows%repair(pending(k)) = no_stencil
          if (.not. good(k)) cycle
          rows%repair(pending(k)) = merge(as_written, support_grown, time == 0)
          if (.not. norm_minimal) rows%repair(pending(k)) = positive_stencil
        end do
        failed = [failed, pack(pending, large .and. .not. good)]
        pending = pack(pending, .not. (good .or. large))
        deallocate (good, large)
        radius(particles(pending)) = rule%growth*radius(particles(pending))
      end do
      pending = [failed, pending]
    end subroutine grow

    !> A row of a lower degree is better than one that reaches far.
    pure function most_neighbours(of_degree) result(number)
      integer, intent(in) :: of_degree
      integer :: number

      number = rule%most_neighbours
      if (of_degree > 2) number = min(number, widest_row*monomials(of_degree))
    end function most_neighbours

    !> All rows on their final supports
    subroutine assemble_final()
      type(neighbour_list_t) :: list
      type(stencil_t) :: stencil
      real(wp) :: b(most_normals), ratio, stiffness
      integer :: k

      call build_neighbour_list(x, y, radius(particles), list, particles)
      call rows%operator%shape_as(list)
      call rows%report%reserve(size(particles))
      associate (quality => rows%quality, n => size(particles))
        allocate (quality%ratio(n), quality%residual(n), quality%stiffness(n), &
                  quality%neighbours(n))
      end associate
      allocate (rows%slope_weight(size(normal, 2)), source=0.0_wp)
      !$omp parallel if (size(particles) > worth_sharing) default(shared) &
      !$omp private(k, b, ratio, stiffness) firstprivate(stencil)
      call stencil%reserve(list%longest_row())
      !$omp do schedule(dynamic, 8)
      do k = 1, size(particles)
        call one_row(rows%repair(k) /= positive_stencil, k, list, k, stencil, rows%operator, b, &
                     ratio, stiffness)
        associate (from => list%first(k), to => list%first(k + 1) - 1)
          if (rows%repair(k) == no_stencil) then
            rows%operator%weight(from:to) = 0
            rows%operator%diagonal(k) = 0
            b = 0
          end if
          rows%quality%neighbours(k) = count(abs(rows%operator%weight(from:to)) > 0)
        end associate
        rows%quality%ratio(k) = ratio
        rows%quality%stiffness(k) = stiffness
        rows%quality%residual(k) = stencil%residual
        rows%slope_weight(first(k):first(k + 1) - 1) = b(1:first(k + 1) - first(k))
        stencil%condition_gradient = 0
        stencil%condition_laplacian = 0
        call rows%report%note(k, stencil)
      end do
      !$omp end do
      !$omp end parallel
    end subroutine assemble_final

    !> The weights of particle number `which` into row `row` of an operator, b in 1/m, and how good
    !> they are; there is no quality where a b is not positive.
    subroutine one_row(norm_minimal, which, list, row, stencil, operator, b, ratio, stiffness)
      logical, intent(in) :: norm_minimal
      integer, intent(in) :: which
      type(neighbour_list_t), intent(in) :: list
      integer, intent(in) :: row
      type(stencil_t), intent(inout) :: stencil
      type(sparse_operator_t), intent(inout) :: operator
      real(wp), intent(out) :: b(:), ratio, stiffness
      real(wp), allocatable :: basis(:, :), wanted(:), dx(:), dy(:), found(:), ease(:), passing(:)
      logical, allocatable :: known(:)
      real(wp) :: total, pace
      integer :: n, normals, m

      normals = first(which + 1) - first(which)
      m = monomials(exact(which))
      associate (from => list%first(row), to => list%first(row + 1) - 1, &
                 h => radius(particles(which)))
        call stencil%gather(kernel, x, y, volume, particles(which), list%index(from:to), h)
        n = stencil%n
        dx = -stencil%q(1:n)*stencil%ex(1:n)
        dy = -stencil%q(1:n)*stencil%ey(1:n)
        allocate (basis(m, n + 2*normals), wanted(m), known(n), found(n + 2*normals))
        allocate (ease(n), passing(n))
        call model%describe(particles(which), list%index(from:to), dx, dy, h, &
                            exact(which), wanted, basis(:, 1:n), known, &
                            normal(:, first(which):first(which + 1) - 1), &
                            basis(:, n + 1:n + normals), basis(:, n + normals + 1:), pace, ease, &
                            passing)
        if (.not. flux_is_given) basis(:, n + normals + 1:) = 0
        if (norm_minimal) then
          call norm_minimal_row(stencil, known, ease, passing, wanted, basis, found)
        else
          call positive_row(stencil, known, wanted, basis, found)
        end if
        operator%weight(from:to) = (found(1:n)/h)/h
        operator%diagonal(row) = -sum(operator%weight(from:to))
        ! The flux into the body is given, whatever it consists of there.
        b(1:normals) = (found(n + 1:n + normals) + found(n + normals + 1:))/h
        total = sum(abs(operator%weight(from:to)))
        ratio = huge(1.0_wp)
        if (operator%diagonal(row) < 0 .and. all(b(1:normals) > 0) .and. &
            total < -1.0e3_wp*operator%diagonal(row)) ratio = -total/operator%diagonal(row)
        ! Half a disc of the support radius is shared by a particle on a wall and its neighbours.
        stiffness = abs(operator%diagonal(row))*h**2* &
                    merge(0.5_wp, 1.0_wp, normals > 0)*pi/(1 + n)/ &
                    (0.25_wp*(wanted(3) + wanted(5))*pace)
      end associate
    end subroutine one_row

  end subroutine assemble_flow_rows

  !> Weights of least norm, or nearest to what passes between two particles, c: with
  !> a_j = c_j + √ω_j z_j the shortest z.
  subroutine norm_minimal_row(stencil, known, ease, passing, wanted, basis, found)
    type(stencil_t), intent(inout) :: stencil
    logical, intent(in) :: known(:)
    real(wp), intent(in) :: ease(:), passing(:), wanted(:), basis(:, :)
    !> The weights of the neighbours, then those of the walls' fluxes
    real(wp), intent(out) :: found(:)
    real(wp), allocatable :: root(:), matrix(:, :), right(:, :), singular(:), work(:)
    real(wp) :: shortest, flux_root, aim(size(found))
    integer :: n, m, k, rank, info

    n = stencil%n
    m = size(wanted)
    shortest = nearest*sqrt(pi/(n + 1))
    allocate (root(size(found)), singular(min(m, size(found))), right(max(m, size(found)), 1))
    allocate (work(8*(m + size(found)) + 64), matrix(m, size(found)))
    ! Beyond an interface, what counts is how far away the neighbour seems to be. Where heat passes
    ! more easily weights are cheap: they are then much like those of the neighbour's own row, and
    ! little heat is lost between the two.
    do k = 1, n
      root(k) = 0
      if (.not. known(k)) cycle
      root(k) = sqrt(ease(k)*stencil%f(k))/ &
                max(stencil%q(k), hypot(basis(1, k), basis(2, k)), shortest)
    end do
    flux_root = sqrt(cheap)*norm2(root(1:n)*stencil%q(1:n))
    do k = n + 1, size(found)
      root(k) = 0
      if (all(abs(basis(1:2, k)) <= 0)) cycle
      ! In units of the conductivity
      root(k) = flux_root/norm2(basis(1:2, k))
    end do
    ! Next to a better conductor weights are those nearest to what passes between two particles by
    ! the distance and the conductivities on the way, which is the same in both directions. Beyond
    ! it rows have enough to do with what their own material passes on.
    aim = 0
    if (all(passing > 1 - 1.0e-9_wp) .and. any(passing > 1 + 1.0e-9_wp)) then
      aim(1:n) = -0.5_wp*(wanted(3) + wanted(5))*passing*stencil%force(1:n)/stencil%q(1:n)
      where (.not. known) aim(1:n) = 0
    end if
    right = 0
    do k = 1, m
      matrix(k, :) = basis(k, :)*root
      associate (scale => max(norm2(matrix(k, :)), tiny(1.0_wp)))
        right(k, 1) = (wanted(k) - dot_product(basis(k, :), aim))/scale
        matrix(k, :) = matrix(k, :)/scale
      end associate
    end do
    call dgelss(m, size(found), 1, matrix, m, right, size(right), singular, smallest_singular, &
                rank, work, size(work), info)
    found = aim + root*right(1:size(found), 1)
    if (info /= 0) found = 0
    call find_residual(stencil, wanted, basis, found)
  end subroutine norm_minimal_row

  !> Non-negative weights exact to degree 2, by a linear programme that likes neighbours near (see
  !> calor_laplacian_positive).
  subroutine positive_row(stencil, known, wanted, basis, found)
    type(stencil_t), intent(inout) :: stencil
    logical, intent(in) :: known(:)
    real(wp), intent(in) :: wanted(:), basis(:, :)
    real(wp), intent(out) :: found(:)
    integer, parameter :: m = 5
    real(wp) :: cost(size(found)), moments(m, size(found)), size_of(size(found)), shortest
    real(wp) :: tableau(0:m, 0:size(found) + m), bounds(m), scale
    integer :: basis_now(m), k
    logical :: feasible

    shortest = 0.5_wp*sqrt(pi/(stencil%n + 1))
    scale = maxval(abs(wanted))
    bounds = wanted/scale
    do k = 1, size(found)
      size_of(k) = max(maxval(abs(basis(:, k))), tiny(1.0_wp))
      moments(:, k) = basis(:, k)/size_of(k)
      cost(k) = merge(1.0_wp, 0.0_wp, all(abs(basis(:, k)) <= 0))
      if (k > stencil%n) cycle
      cost(k) = max(stencil%q(k), shortest)**4/size_of(k)
      if (known(k)) cycle
      moments(:, k) = 0
      cost(k) = 1
    end do
    do k = 1, m
      if (bounds(k) >= 0) cycle
      bounds(k) = -bounds(k)
      moments(k, :) = -moments(k, :)
    end do
    call minimise(cost, moments, bounds, found, tableau, basis_now, feasible)
    found = scale*found/size_of
    call find_residual(stencil, wanted, basis, found)
    if (.not. feasible) stencil%residual = huge(1.0_wp)
  end subroutine positive_row

  pure subroutine find_residual(stencil, wanted, basis, found)
    type(stencil_t), intent(inout) :: stencil
    real(wp), intent(in) :: wanted(:), basis(:, :), found(:)
    integer :: k

    stencil%residual = 0
    do k = 1, size(wanted)
      stencil%residual = max(stencil%residual, abs(dot_product(basis(k, :), found) - wanted(k))/ &
                             (dot_product(abs(basis(k, :)), abs(found)) + abs(wanted(k)) + &
                              tiny(1.0_wp)))
    end do
  end subroutine find_residual

end module calor_flow_rows
