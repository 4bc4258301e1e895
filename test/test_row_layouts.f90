!> Tests of rows made and kept for speed: batches, collections of attempts, streamed rows.
module test_row_layouts
  use calor_conduction, only: conduction_t
  use calor_error, only: error_t
  use calor_evolution, only: recur_with_rate_in_parts, recur_with_jacobian_in_parts
  use calor_kernel, only: kernel_t
  use calor_kernels, only: make_kernel
  use calor_kinds, only: wp, sp, ip, i8
  use calor_cloud, only: cloud_t
  use calor_laplacian_consistent, only: consistent_t, natural_support
  use calor_laplacian_fatehi_manzari, only: fatehi_manzari_t
  use calor_laplacian_scheme, only: row_laplacian_t
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_random, only: random_uniform
  use calor_rectangle_cloud, only: make_rectangle
  use calor_row_batch, only: row_batch_t
  use calor_row_collection, only: row_collection_t
  use calor_row_report, only: row_report_t
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene
  use calor_simulation, only: simulation_t
  use calor_sparse_operator, only: sparse_operator_t
  use calor_stencil, only: stencil_t
  use calor_streamed_rows, only: streamed_rows_t
  use calor_text, only: to_text
  use testdrive, only: new_unittest, unittest_type, test_error => error_type, check
  implicit none (type, external)
  private

  public :: collect_row_layouts

contains

  subroutine collect_row_layouts(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('batches give the rows found one by one', test_batches), &
                new_unittest('rows of a lattice, where monomials depend on each other', &
                             test_lattice), &
                new_unittest('an attempt saves rows that no neighbours could make exact', &
                             test_attempt), &
                new_unittest('a collection keeps the last attempt at each row', test_collection), &
                new_unittest('streamed rows are the operator', test_streamed), &
                new_unittest('streamed rows leave constants steady to the last bit', &
                             test_constants), &
                new_unittest('streamed rows have neighbours at any distance', test_far), &
                new_unittest('rows with a diagonal of their own are not streamed', test_refused), &
                new_unittest('a stage in one sweep is the stage in parts', test_stage), &
                new_unittest('weights in single precision round each weight once', test_short), &
                new_unittest('single precision in scenes of any size', test_short_scene), &
                new_unittest('steps need the streamed rows alone', test_lean) &
                ]
  end subroutine collect_row_layouts

  !> A cloud of 15 × 15 intervals and rows of a scheme on it.
  subroutine assemble(scheme, jitter, support, cloud, laplacian, list)
    class(row_laplacian_t), intent(in) :: scheme
    real(wp), intent(in) :: jitter, support
    type(cloud_t), intent(out) :: cloud
    type(sparse_operator_t), intent(out) :: laplacian
    type(neighbour_list_t), intent(out) :: list
    class(kernel_t), allocatable :: kernel
    type(error_t), allocatable :: failure
    real(wp), allocatable :: radius(:)
    integer(ip), allocatable :: inside(:)
    integer :: k

    call make_rectangle([0.0_wp, 1.0_wp], [0.0_wp, 1.0_wp], 1/15.0_wp, 'jittered', jitter, 3, &
                        cloud, failure)
    call make_kernel('wendland_c2', kernel, failure)
    inside = pack([(int(k, ip), k=1, cloud%particles())], cloud%side == 0)
    allocate (radius(cloud%particles()), source=support/15)
    call build_neighbour_list(cloud%x, cloud%y, radius(inside), list, inside)
    call scheme%assemble(kernel, cloud%x, cloud%y, cloud%volume, radius, list, laplacian)
  end subroutine assemble

  !> The largest difference to rows found one by one, relative to each row's largest weight.
  function difference(scheme, support, cloud, laplacian, list, exact) result(largest)
    class(row_laplacian_t), intent(in) :: scheme
    real(wp), intent(in) :: support
    type(cloud_t), intent(in) :: cloud
    type(sparse_operator_t), intent(in) :: laplacian
    type(neighbour_list_t), intent(in) :: list
    !> Whether to compare rows of singular systems too
    logical, intent(in) :: exact
    real(wp) :: largest
    class(kernel_t), allocatable :: kernel
    type(error_t), allocatable :: failure
    type(stencil_t) :: stencil
    real(wp), allocatable :: weight(:)
    real(wp) :: diagonal, h
    integer :: row

    h = support/15
    call make_kernel('wendland_c2', kernel, failure)
    call stencil%reserve(list%longest_row())
    largest = 0
    do row = 1, list%rows()
      associate (from => list%first(row), to => list%first(row + 1) - 1)
        allocate (weight(to - from + 1))
        call stencil%gather(kernel, cloud%x, cloud%y, cloud%volume, list%target(row), &
                            list%index(from:to), h)
        call scheme%weights(stencil, weight, diagonal)
        ! In rows that are worse determined, rounding errors of moments show more.
        if (stencil%condition_laplacian <= 1.0e9_wp .or. exact) then
          largest = max(largest, maxval(abs(weight/h**2 - laplacian%weight(from:to)))/ &
                        maxval(abs(weight/h**2)), &
                        abs(diagonal/h**2 - laplacian%diagonal(row))/abs(diagonal/h**2))
        end if
        deallocate (weight)
      end associate
    end do
  end function difference

  !> Moments are met to rounding either way, and weights of least norm follow from moments with the
  !> condition √κ(M), at most 3·10⁴ in the rows compared: some 10 ε √κ = 7·10⁻¹¹.
  subroutine test_batches(error)
    type(test_error), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(sparse_operator_t) :: laplacian
    type(neighbour_list_t) :: list
    type(consistent_t) :: consistent
    type(fatehi_manzari_t) :: paper
    integer :: order

    call assemble(paper, 0.3_wp, 2.1_wp, cloud, laplacian, list)
    call check(error, difference(paper, 2.1_wp, cloud, laplacian, list, .false.) < 1.0e-12_wp)
    do order = 2, 8, 2
      if (allocated(error)) return
      consistent%order = order
      associate (support => 1.3_wp*natural_support(order))
        call assemble(consistent, 0.3_wp, support, cloud, laplacian, list)
        call check(error, difference(consistent, support, cloud, laplacian, list, &
                                     .false.) < 1.0e-10_wp)
      end associate
    end do
  end subroutine test_batches

  !> There monomials depend on each other: batches leave them out, and the rows are those of LAPACK.
  subroutine test_lattice(error)
    type(test_error), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(sparse_operator_t) :: laplacian
    type(neighbour_list_t) :: list
    type(row_batch_t) :: batch
    type(fatehi_manzari_t) :: paper
    type(consistent_t) :: consistent
    class(kernel_t), allocatable :: kernel
    type(error_t), allocatable :: failure
    integer :: order, k, middle

    ! Four neighbours leave B̂xy undetermined. Rounding of the scaling only: 1/h² and h² differ
    call assemble(paper, 0.0_wp, 1.2_wp, cloud, laplacian, list)
    call check(error, difference(paper, 1.2_wp, cloud, laplacian, list, .true.) < 1.0e-14_wp)
    call make_kernel('wendland_c2', kernel, failure)
    do order = 2, 8, 2
      if (allocated(error)) return
      consistent%order = order
      associate (support => natural_support(order))
        call assemble(consistent, 0.0_wp, support, cloud, laplacian, list)
        call check(error, difference(consistent, support, cloud, laplacian, list, .true.) < &
                   1.0e-10_wp, 'order '//to_text(order))
        if (allocated(error)) return
        call batch%reserve(list%longest_row())
        middle = minloc((cloud%x(list%target) - 0.5_wp)**2 + (cloud%y(list%target) - 0.5_wp)**2, &
                        dim=1)
        call batch%gather(kernel, cloud%x, cloud%y, cloud%volume, &
                          [(support/15, k=1, size(cloud%x))], list, middle, middle)
        call consistent%batch_weights(batch)
        call check(error, batch%solved(1) .and. .not. batch%unmet(1))
        if (allocated(error)) return
        call check(error, batch%condition_laplacian(1) > 1.0e300_wp, 'monomials are independent')
        deallocate (batch%q, batch%ex, batch%ey, batch%volume, batch%weight, batch%f, batch%df, &
                    batch%ddf)
      end associate
    end do
  end subroutine test_lattice

  !> Rows of too few neighbours are told by their residual either way; all others are the same.
  subroutine test_attempt(error)
    type(test_error), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(sparse_operator_t) :: laplacian, attempt
    type(neighbour_list_t) :: list
    type(row_report_t) :: report, attempted
    type(consistent_t) :: consistent
    class(kernel_t), allocatable :: kernel
    type(error_t), allocatable :: failure
    real(wp), parameter :: jitters(*) = [0.0_wp, 0.3_wp]
    integer :: k, j, row

    call make_kernel('wendland_c2', kernel, failure)
    do j = 1, size(jitters)
      associate (support => natural_support(consistent%order))
        call assemble(consistent, jitters(j), support, cloud, laplacian, list)
        associate (radius => [(support/15, k=1, size(cloud%x))])
          call consistent%assemble(kernel, cloud%x, cloud%y, cloud%volume, radius, list, &
                                   laplacian, report)
          call consistent%assemble(kernel, cloud%x, cloud%y, cloud%volume, radius, list, attempt, &
                                   attempted, attempt=.true.)
        end associate
      end associate
      call check(error, any(report%residual > 1.0e-5_wp), 'all rows are exact')
      if (allocated(error)) return
      do row = 1, list%rows()
        if (report%residual(row) > 1.0e-5_wp) then
          call check(error, attempted%residual(row) > 1.0e-5_wp)
        else
          associate (from => list%first(row), to => list%first(row + 1) - 1)
            call check(error, maxval(abs(attempt%weight(from:to) - laplacian%weight(from:to))), &
                       0.0_wp)
          end associate
        end if
        if (allocated(error)) return
      end do
    end do
  end subroutine test_attempt

  subroutine test_collection(error)
    type(test_error), allocatable, intent(out) :: error
    type(row_collection_t) :: collection
    type(sparse_operator_t) :: attempt, merged
    type(row_report_t) :: report

    call collection%start(3)
    call make_attempt([1_ip, 2_ip, 3_ip], 1.0_wp)
    call collection%take([1_ip, 2_ip, 3_ip], attempt, report)
    call make_attempt([3_ip, 1_ip], 2.0_wp)
    call collection%take([3_ip, 1_ip], attempt, report)
    call make_attempt([3_ip], 3.0_wp)
    call collection%take([3_ip], attempt, report)
    call collection%merge_into(merged, report)
    call check(error, all(merged%target == [1, 2, 3]))
    if (allocated(error)) return
    ! Row k of an attempt has k entries.
    call check(error, all(merged%first == [1_i8, 3_i8, 5_i8, 6_i8]))
    if (allocated(error)) return
    call check(error, maxval(abs(merged%weight - [2, 2, 1, 1, 3])), 0.0_wp)
    if (allocated(error)) return
    call check(error, maxval(abs(merged%diagonal - [2, 1, 3])), 0.0_wp)
    if (allocated(error)) return
    call check(error, maxval(abs(report%residual - [2, 1, 3])), 0.0_wp)

  contains

    subroutine make_attempt(target, number)
      integer(ip), intent(in) :: target(:)
      real(wp), intent(in) :: number
      integer :: k, n

      n = size(target)
      call report%reserve(n)
      report%residual(:) = number
      attempt%target = target
      allocate (attempt%first(n + 1), attempt%diagonal(n))
      attempt%first(1) = 1
      do k = 1, n
        attempt%first(k + 1) = attempt%first(k) + k
      end do
      allocate (attempt%index(attempt%first(n + 1) - 1), source=1_ip)
      allocate (attempt%weight(attempt%first(n + 1) - 1), source=number)
      attempt%diagonal(:) = number
    end subroutine make_attempt

  end subroutine test_collection

  !> An operator on 101 particles with rows of 0 to 12 entries, some without a row and one with 60.
  subroutine make_operator(operator)
    type(sparse_operator_t), intent(out) :: operator
    integer, parameter :: particles = 101
    integer :: k, length, row

    operator%target = [(int(1 + mod(37*k, particles), ip), k=1, 90)]
    allocate (operator%first(91), operator%diagonal(90))
    operator%first(1) = 1
    do row = 1, 90
      length = mod(7*row, 13)
      if (row == 50) length = 60
      operator%first(row + 1) = operator%first(row) + length
    end do
    allocate (operator%index(operator%first(91) - 1), operator%weight(operator%first(91) - 1))
    do k = 1, size(operator%index)
      operator%index(k) = 1 + int(particles*random_uniform(1, int(k, i8)), ip)
      operator%weight(k) = random_uniform(2, int(k, i8)) - 0.3_wp
    end do
    do row = 1, 90
      associate (from => operator%first(row), to => operator%first(row + 1) - 1)
        operator%diagonal(row) = -sum(operator%weight(from:to))
      end associate
    end do
  end subroutine make_operator

  subroutine test_streamed(error)
    type(test_error), allocatable, intent(out) :: error
    type(sparse_operator_t) :: operator
    type(streamed_rows_t) :: rows
    real(wp) :: u(101), found(101), expected(101)
    integer :: k

    call make_operator(operator)
    call rows%lay_out(operator, 101)
    call check(error, rows%stands_for(operator))
    if (allocated(error)) return
    do k = 1, 101
      u(k) = random_uniform(3, int(k, i8))
    end do
    expected = 0
    call operator%apply_at_targets(2.0_wp, u, expected)
    call rows%apply(2.0_wp, u, found)
    ! Sums of up to 60 numbers below one, each rounded
    call check(error, maxval(abs(found - expected)) < 60*epsilon(1.0_wp)*30)
    if (allocated(error)) return
    call check(error, maxval(abs(pack(found, [(all(operator%target /= k), k=1, 101)]))), 0.0_wp)
  end subroutine test_streamed

  subroutine test_constants(error)
    type(test_error), allocatable, intent(out) :: error
    type(sparse_operator_t) :: operator
    type(streamed_rows_t) :: rows
    real(wp) :: u(101), found(101)

    call make_operator(operator)
    call rows%lay_out(operator, 101)
    u = 1/3.0_wp
    call rows%apply(1.0_wp, u, found)
    call check(error, maxval(abs(found)), 0.0_wp)
  end subroutine test_constants

  !> Numbers differ by what two bytes hold, by one more, by as much as there is, and the last slice
  !> is not full.
  subroutine test_far(error)
    type(test_error), allocatable, intent(out) :: error
    integer, parameter :: particles = 140003, neighbours = 8
    integer, parameter :: distance(neighbours) = [1, 2, 32000, 32767, 32768, 32769, 65536, 70001]
    type(sparse_operator_t) :: operator
    type(streamed_rows_t) :: rows
    real(wp), allocatable :: u(:), found(:), expected(:)
    integer :: k, row

    operator%target = [(int(k, ip), k=1, particles)]
    operator%first = [(int(neighbours, i8)*k + 1, k=0, particles)]
    allocate (operator%index(neighbours*particles), operator%weight(neighbours*particles))
    allocate (operator%diagonal(particles), u(particles), found(particles), expected(particles))
    do row = 1, particles
      u(row) = random_uniform(3, int(row, i8))
      associate (last => neighbours*row, first => neighbours*(row - 1) + 1)
        operator%index(first:last) = 1 + modulo(row - 1 + distance*(-1)**row, particles)
        operator%weight(first:last) = [(random_uniform(2, int(k, i8)), k=first, last)]
        operator%diagonal(row) = -sum(operator%weight(first:last))
      end associate
    end do
    call rows%lay_out(operator, particles)
    call check(error, rows%stands_for(operator))
    if (allocated(error)) return
    expected = 0
    call operator%apply_at_targets(1.0_wp, u, expected)
    call rows%apply(1.0_wp, u, found)
    ! Sums of 8 numbers below one and of a diagonal of up to 8, each rounded
    call check(error, maxval(abs(found - expected)) < 20*epsilon(1.0_wp)*8)
    if (allocated(error)) return
    u = 1/3.0_wp
    call rows%apply(1.0_wp, u, found)
    call check(error, maxval(abs(found)), 0.0_wp)
  end subroutine test_far

  subroutine test_refused(error)
    type(test_error), allocatable, intent(out) :: error
    type(sparse_operator_t) :: operator
    type(streamed_rows_t) :: rows

    call make_operator(operator)
    operator%diagonal(7) = operator%diagonal(7) + 1.0e-6_wp
    call rows%lay_out(operator, 101)
    call check(error,.not. rows%stands_for(operator))
    if (allocated(error)) return
    call make_operator(operator)
    operator%target(3) = operator%target(4)
    call rows%lay_out(operator, 101)
    call check(error,.not. rows%stands_for(operator))
  end subroutine test_refused

  subroutine test_stage(error)
    type(test_error), allocatable, intent(out) :: error
    type(conduction_t) :: conduction
    real(wp) :: newer(101), start(101), rate(101), fused(101), parts(101)
    real(wp), allocatable :: work(:)
    real(wp), parameter :: c(5) = [0.7_wp, -0.4_wp, 0.2_wp, -0.01_wp, 0.03_wp]
    ! Sums of up to 60 numbers of order one, and the combination
    real(wp), parameter :: rounding = 1.0e-12_wp
    integer :: k

    call make_operator(conduction%laplacian)
    conduction%diffusivity = 0.5_wp
    conduction%medium%x = [(real(k, wp), k=1, 101)]
    allocate (conduction%prescribed(0))
    do k = 1, 101
      newer(k) = random_uniform(3, int(k, i8))
      start(k) = random_uniform(4, int(k, i8))
      rate(k) = random_uniform(5, int(k, i8))
      fused(k) = random_uniform(6, int(k, i8))
    end do
    parts = fused
    ! Before rows are streamed the general way is taken.
    call conduction%combine_with_rate(0.0_wp, c, newer, start, rate, parts, work)
    call conduction%stream_rows()
    call conduction%combine_with_rate(0.0_wp, c, newer, start, rate, fused, work)
    call check(error, maxval(abs(fused - parts)) < rounding)
    if (allocated(error)) return
    ! All was done in the sweep, but for what was not streamed.
    deallocate (work)
    parts = fused
    call conduction%recur_with_rate(0.0_wp, c(1:3), newer, fused, work)
    call check(error, .not. allocated(work))
    if (allocated(error)) return
    call recur_with_rate_in_parts(conduction, 0.0_wp, c(1:3), newer, parts, work)
    call check(error, maxval(abs(fused - parts)) < rounding)
    if (allocated(error)) return
    parts = fused
    call conduction%recur_with_jacobian(c(1:3), newer, fused, work)
    call recur_with_jacobian_in_parts(conduction, c(1:3), newer, parts, work)
    call check(error, maxval(abs(fused - parts)) < rounding)
    if (allocated(error)) return
    ! What is steady stays so to the last bit.
    newer = 1/3.0_wp
    fused = newer
    call conduction%recur_with_rate(0.0_wp, [1.0_wp, c(2:3)], newer, fused, work)
    call check(error, maxval(abs(fused - newer)), 0.0_wp)
  end subroutine test_stage

  !> What rounding a weight to 24 bits makes of sums, and no more; in units of any size.
  subroutine test_short(error)
    type(test_error), allocatable, intent(out) :: error
    type(sparse_operator_t) :: operator
    type(streamed_rows_t) :: double, single
    real(wp) :: u(101), expected(101), found(101), other(101), bound(101)
    integer :: k, row

    call make_operator(operator)
    do k = 1, 101
      u(k) = random_uniform(3, int(k, i8))
    end do
    bound = 0
    do row = 1, operator%rows()
      associate (from => operator%first(row), to => operator%first(row + 1) - 1, &
                 i => operator%target(row))
        bound(i) = epsilon(1.0_sp)/2* &
                   sum(abs(operator%weight(from:to)*(u(operator%index(from:to)) - u(i))))
      end associate
    end do
    call double%lay_out(operator, 101)
    call single%lay_out(operator, 101, single=.true.)
    call check(error, single%stands_for(operator) .and. single%bytes() < double%bytes())
    if (allocated(error)) return
    call double%apply(1.0_wp, u, expected)
    call single%apply(1.0_wp, u, found)
    call check(error, all(abs(found - expected) <= bound*1.000001_wp))
    if (allocated(error)) return
    call check(error, any(abs(found - expected) > 0.1_wp*bound))
    if (allocated(error)) return
    ! Powers of 2 change nothing.
    do k = -1, 1, 2
      operator%weight = operator%weight*2.0_wp**(300*k)
      operator%diagonal = operator%diagonal*2.0_wp**(300*k)
      call single%lay_out(operator, 101, single=.true.)
      call single%apply(2.0_wp**(-300*k), u, other)
      call check(error, all(abs(other - found) <= 0.0_wp))
      if (allocated(error)) return
      operator%weight = operator%weight*2.0_wp**(-300*k)
      operator%diagonal = operator%diagonal*2.0_wp**(-300*k)
    end do
    u = 1/3.0_wp
    call single%apply(1.0_wp, u, found)
    call check(error, maxval(abs(found)), 0.0_wp)
  end subroutine test_short

  !> A scene's temperatures with weights of 24 bits differ by about as much: the errors of a row are
  !> those of its second derivative, and random.
  subroutine test_short_scene(error)
    type(test_error), allocatable, intent(out) :: error
    type(simulation_t) :: double, single
    real(wp) :: deviation

    call run_scene('&scheme laplacian = "consistent" order = 4 / ', double, error)
    if (allocated(error)) return
    call run_scene('&scheme laplacian = "consistent" order = 4 single_weights = T / ', single, &
                   error)
    if (allocated(error)) return
    deviation = maxval(abs(single%temperature - double%temperature))
    call check(error, deviation > 0 .and. deviation < epsilon(1.0_sp))
  end subroutine test_short_scene

  !> A run that frees the assembled rows gives the same to the last bit; implicit steps keep them.
  subroutine test_lean(error)
    type(test_error), allocatable, intent(out) :: error
    type(simulation_t) :: usual, lean

    call run_scene('', usual, error)
    if (allocated(error)) return
    call run_scene('', lean, error, lean=.true.)
    if (allocated(error)) return
    call check(error, all(abs(usual%temperature - lean%temperature) <= 0.0_wp))
    if (allocated(error)) return
    associate (kept => usual%conduction%laplacian, freed => lean%conduction%laplacian)
      call check(error, allocated(kept%target) .and. allocated(kept%weight) .and. &
                 .not. (allocated(freed%target) .or. allocated(freed%weight)))
    end associate
    if (allocated(error)) return
    call check(error, .not. (allocated(lean%cloud%x) .or. allocated(lean%radius)) .and. &
               all(abs(lean%conduction%medium%x - usual%cloud%x) <= 0.0_wp))
    if (allocated(error)) return
    call run_scene('', lean, error, lean=.true., method='tr_bdf2')
    if (allocated(error)) return
    call check(error, allocated(lean%conduction%laplacian%weight))
  end subroutine test_lean

  !> The plate, 12 intervals to an edge
  subroutine run_scene(more, simulation, error, lean, method)
    character(len=*), intent(in) :: more
    type(simulation_t), intent(out) :: simulation
    type(test_error), allocatable, intent(out) :: error
    logical, intent(in), optional :: lean
    character(len=*), intent(in), optional :: method
    type(scene_t) :: scene
    type(error_t), allocatable :: failure
    character(len=:), allocatable :: name

    name = 'rkl2'
    if (present(method)) name = method
    call interpret_scene('&domain x_range = 0, 1 y_range = 0, 1 arrangement = "jittered" '// &
                         'spacing = 0.0833333333333 jitter = 0.2 / &time end = 0.05 method = "'// &
                         name//'" / &initial temperature_expression = "sin(pi*x)*sin(pi*y)" / '// &
                         '&boundary value = 0 / '//more, scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    if (.not. allocated(failure)) call simulation%run(failure, lean=lean)
    if (allocated(failure)) call check(error, .false., failure%message)
  end subroutine run_scene

end module test_row_layouts
