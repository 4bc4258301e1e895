!> Tests of the heat driver: the paper's problem, exact solutions, refusals, repeatability.
module test_heat
  use calor_error, only: error_t, status_bad_input, status_bad_numbers
  use calor_kinds, only: wp
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene
  use calor_simulation, only: simulation_t
  use calor_text, only: to_text
  use omp_lib, only: omp_set_num_threads, omp_get_max_threads
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_heat

  character(len=*), parameter :: plate = '&scene exact_expression = '// &
      '''sin(pi*x)*sin(pi*y)*exp(-2*pi^2*t)'' / '// &
      '&initial temperature_expression = ''sin(pi*x)*sin(pi*y)'' / '// &
      '&boundary on = ''all'' kind = ''temperature'' value = 0.0 /'

contains

  subroutine collect_heat(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('plate: error table on lattices', test_table_lattice), &
                new_unittest('plate: error table on irregular clouds', test_table_jittered), &
                new_unittest('plate: second order, four neighbours too', test_order), &
                new_unittest('plate: ten times more accurate than brookshaw', test_headline), &
                new_unittest('quadratic solution with moving walls is exact', test_quadratic), &
                new_unittest('corners take the boundary given last', test_corner), &
                new_unittest('material and size scale as they must', test_units), &
                new_unittest('a constant temperature stays', test_constant), &
                new_unittest('a step beyond the limit is refused with the limit', &
                             test_refused_step), &
                new_unittest('an unstable operator ends the run', test_unstable), &
                new_unittest('scenes that cannot be run', test_refusals), &
                new_unittest('what walls are held at later counts', test_later_walls), &
                new_unittest('one and two threads agree', test_threads) &
                ]
  end subroutine collect_heat

  !> Run the plate to t = 0.05.
  subroutine run_plate(n, jitter, support, scheme, simulation, error)
    integer, intent(in) :: n
    real(wp), intent(in) :: jitter, support
    character(len=*), intent(in) :: scheme
    type(simulation_t), intent(out) :: simulation
    type(error_type), allocatable, intent(out) :: error

    call run_scene(plate//'&domain shape = ''rectangle'' x_range = 0, 1 y_range = 0, 1 '// &
                   'spacing = '// &
                   to_text(1.0_wp/n)//' arrangement = ''jittered'' jitter = '//to_text(jitter)// &
                   ' / &kernel support = '//to_text(support)// &
                   ' / &scheme laplacian = '''//scheme// &
                   ''' support_growth = .false. / &time end = 0.05 tolerance = 1e-8 /', &
                   simulation, error)
  end subroutine run_plate

  subroutine run_scene(text, simulation, error)
    character(len=*), intent(in) :: text
    type(simulation_t), intent(out) :: simulation
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(error_t), allocatable :: failure

    call interpret_scene(text, scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    if (.not. allocated(failure)) call simulation%run(failure)
    if (allocated(failure)) call test_failed(error, failure%message)
  end subroutine run_scene

  !> Compare the plate's errors with the published ones, n = 20, 40, 80.
  subroutine compare(jitter, support, scheme, expected, lowest, highest, error)
    real(wp), intent(in) :: jitter, support
    character(len=*), intent(in) :: scheme
    real(wp), intent(in) :: expected(3)
    !> Ratio of what is found to what is expected
    real(wp), intent(in) :: lowest, highest
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    real(wp) :: ratio
    integer :: level

    do level = 1, 3
      call run_plate(10*2**level, jitter, support, scheme, simulation, error)
      if (allocated(error)) return
      ratio = simulation%relative_l2_error()/expected(level)
      call check(error, ratio > lowest .and. ratio < highest, &
                 scheme//', jitter '//to_text(jitter)// &
                 ', support '//to_text(support)//', level '//to_text(level)// &
                 ': found over expected '//to_text(ratio, digits=4))
      if (allocated(error)) return
    end do
  end subroutine compare

  subroutine test_table_lattice(error)
    type(error_type), allocatable, intent(out) :: error

    call compare(0.0_wp, 1.5_wp, 'brookshaw', [4.0e-1_wp, 4.0e-1_wp, 4.0e-1_wp], 0.9_wp, 1.1_wp, &
                 error)
    if (allocated(error)) return
    call compare(0.0_wp, 2.1_wp, 'brookshaw', [2.4e-2_wp, 2.1e-2_wp, 2.0e-2_wp], 0.9_wp, 1.1_wp, &
                 error)
    if (allocated(error)) return
    call compare(0.0_wp, 1.5_wp, 'fatehi_manzari', [2.1e-3_wp, 5.2e-4_wp, 1.3e-4_wp], 0.9_wp, &
                 1.1_wp, error)
    if (allocated(error)) return
    call compare(0.0_wp, 2.1_wp, 'fatehi_manzari', [4.0e-3_wp, 1.0e-3_wp, 2.5e-4_wp], 0.9_wp, &
                 1.1_wp, error)
  end subroutine test_table_lattice

  subroutine test_table_jittered(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: jitter(3) = [0.1_wp, 0.2_wp, 0.3_wp]
    real(wp), parameter :: brookshaw(3, 3) = reshape( &
                           [4.3e-2_wp, 4.1e-2_wp, 3.9e-2_wp, 9.1e-2_wp, 9.6e-2_wp, 9.0e-2_wp, &
                            1.6e-1_wp, 1.7e-1_wp, 1.6e-1_wp], [3, 3])
    real(wp), parameter :: fatehi_manzari(3, 3) = reshape( &
                           [4.0e-3_wp, 1.0e-3_wp, 2.5e-4_wp, 4.1e-3_wp, 1.0e-3_wp, 2.6e-4_wp, &
                            4.3e-3_wp, 1.1e-3_wp, 2.8e-4_wp], [3, 3])
    integer :: k

    do k = 1, 3
      call compare(jitter(k), 2.1_wp, 'brookshaw', brookshaw(:, k), 1/1.5_wp, 1.5_wp, error)
      if (allocated(error)) return
      call compare(jitter(k), 2.1_wp, 'fatehi_manzari', fatehi_manzari(:, k), 1/1.5_wp, 1.5_wp, &
                   error)
      if (allocated(error)) return
    end do
  end subroutine test_table_jittered

  subroutine test_order(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: coarse, fine
    real(wp), parameter :: jitter(4) = [0.0_wp, 0.0_wp, 0.1_wp, 0.3_wp]
    real(wp), parameter :: support(4) = [1.2_wp, 2.1_wp, 2.1_wp, 2.1_wp]
    integer :: k

    do k = 1, 4
      call run_plate(20, jitter(k), support(k), 'fatehi_manzari', coarse, error)
      if (allocated(error)) return
      call run_plate(80, jitter(k), support(k), 'fatehi_manzari', fine, error)
      if (allocated(error)) return
      call check(error, log(coarse%relative_l2_error()/fine%relative_l2_error())/log(4.0_wp), &
                 2.0_wp, thr=0.1_wp, &
                 message='jitter '//to_text(jitter(k))//', support '//to_text(support(k)))
      if (allocated(error)) return
    end do
  end subroutine test_order

  subroutine test_headline(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: usual, new
    integer :: k

    do k = 0, 3
      call run_plate(40, 0.1_wp*k, 2.1_wp, 'brookshaw', usual, error)
      if (allocated(error)) return
      call run_plate(40, 0.1_wp*k, 2.1_wp, 'fatehi_manzari', new, error)
      if (allocated(error)) return
      call check(error, new%relative_l2_error() < usual%relative_l2_error()/10)
      if (allocated(error)) return
    end do
  end subroutine test_headline

  !> u = x² + y² + 4t solves u_t = ∇²u; the scheme is exact for it in space and every method
  !> in time.
  subroutine test_quadratic(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: scene = &
        '&scene exact_expression = ''x^2 + y^2 + 4*t'' / &initial temperature_expression = '// &
        '''x^2 + y^2'' / &boundary on = ''all'' kind = ''temperature'' value_expression = '// &
        '''x^2 + y^2 + 4*t'' / &domain shape = ''rectangle'' x_range = -1, 1 y_range = 0.5, 1.5'// &
        ' spacing = 0.1 arrangement = ''jittered'' jitter = 0.2 / &kernel support = 2.6 / '// &
        '&scheme support_growth = .false. / &time end = 0.1 method = '
    character(len=13), parameter :: methods(3) = &
                                    [character(len=13) :: 'forward_euler', 'runge_kutta_4', 'rkl2']
    type(simulation_t) :: simulation
    integer :: k

    do k = 1, 3
      call run_scene(scene//''''//trim(methods(k))//''' /', simulation, error)
      if (allocated(error)) return
      call check(error, simulation%time, 0.1_wp)
      if (allocated(error)) return
      call check(error, simulation%relative_l2_error() < 1.0e-11_wp, trim(methods(k)))
      if (allocated(error)) return
    end do
    call run_scene(scene//'''rkl2'' step = 0.01 /', simulation, error)
    if (allocated(error)) return
    call check(error, simulation%stepper%steps, 10)
    if (allocated(error)) return
    call check(error, simulation%relative_l2_error() < 1.0e-11_wp, 'fixed step')
  end subroutine test_quadratic

  subroutine test_corner(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    character(len=*), parameter :: scene = '&domain shape = ''rectangle'' x_range = 0, 1 '// &
        'y_range = 0, 1 spacing = 0.25 / &time end = 0.01 / &scheme support_growth = .false. / '// &
        '&boundary on = ''all'' kind = ''temperature'' value = 1 / '// &
        '&boundary on = ''left'' kind = ''temperature'' value = 2 / '// &
        '&boundary on = ''top'' kind = ''temperature'' value = 3 /'
    integer :: k
    real(wp) :: expected

    call run_scene(scene, simulation, error)
    if (allocated(error)) return
    do k = 1, simulation%cloud%particles()
      associate (x => simulation%cloud%x(k), y => simulation%cloud%y(k))
        if (simulation%cloud%side(k) == 0) cycle
        expected = 1
        if (x < 0.1_wp) expected = 2
        if (y > 0.9_wp) expected = 3
        call check(error, simulation%temperature(k), expected)
        if (allocated(error)) return
      end associate
    end do
  end subroutine test_corner

  !> The plate a thousand times larger, of a material that is slower by as much as its size asks
  !> for.
  subroutine test_units(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: small, large

    call run_plate(10, 0.0_wp, 2.1_wp, 'fatehi_manzari', small, error)
    if (allocated(error)) return
    ! L = 1000 m, κ/(ρc) = 400/(8000 · 500) = 1e-4 m²/s: time goes with L²/(κ/ρc) = 1e10 s.
    call run_scene('&domain shape = ''rectangle'' x_range = 0, 1000 y_range = 0, 1000 '// &
                   'spacing = 100 / &initial temperature_expression = '// &
                   '''sin(pi*x/1000)*sin(pi*y/1000)'' / &boundary on = ''all'' '// &
                   'kind = ''temperature'' value = 0 / &material conductivity = 400 '// &
                   'density = 8000 heat_capacity = 500 / &scheme support_growth = .false. / '// &
                   '&time end = 5.0e8 tolerance = 1e-8 /', large, error)
    if (allocated(error)) return
    call check(error, maxval(abs(large%temperature - small%temperature)) < 1.0e-9_wp)
    if (allocated(error)) return
    call check(error, large%stability_limit/small%stability_limit, 1.0e10_wp, thr=1.0e-6_wp, &
               rel=.true.)
  end subroutine test_units

  subroutine test_constant(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation

    call run_scene('&domain shape = ''rectangle'' x_range = 0, 2 y_range = 0, 1 spacing = 0.1 '// &
                   'arrangement = ''hexagonal'' / &initial temperature = 293.15 / '// &
                   '&boundary on = ''all'' kind = ''temperature'' value = 293.15 / '// &
                   '&scheme support_growth = .false. / &time end = 1 /', simulation, error)
    if (allocated(error)) return
    call check(error, maxval(abs(simulation%temperature - 293.15_wp)) < 1.0e-9_wp)
  end subroutine test_constant

  subroutine test_refused_step(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(scene_t) :: scene
    type(error_t), allocatable :: failure
    character(len=*), parameter :: start = plate//'&domain shape = ''rectangle'' x_range = 0, 1'// &
        ' y_range = 0, 1 spacing = 0.05 / &kernel support = 1.2 / '// &
        '&scheme support_growth = .false. / &time end = 0.01 method = ''forward_euler'' step = '
    real(wp) :: limit

    ! The five-point Laplacian's spectrum ends at 8/Δ² cos²(πΔ/2).
    limit = 2*0.05_wp**2/8
    call interpret_scene(start//to_text(1.2_wp*limit)//' /', scene, failure)
    call check(error,.not. allocated(failure))
    if (allocated(error)) return
    call simulation%prepare(scene, failure)
    call check(error, allocated(failure), 'the step was not refused')
    if (allocated(error)) return
    call check(error, failure%status, status_bad_input)
    if (allocated(error)) return
    call check(error, simulation%stability_limit, limit, thr=0.06_wp, rel=.true.)
    if (allocated(error)) return
    call check(error, index(failure%message, to_text(simulation%stability_limit, digits=4)) > 0, &
               'the limit is not in the message')
    if (allocated(error)) return
    call run_scene(start//to_text(0.9_wp*limit)//' /', simulation, error)
  end subroutine test_refused_step

  !> The paper's scheme as written has eigenvalues with a positive real part on this cloud.
  subroutine test_unstable(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(scene_t) :: scene
    type(error_t), allocatable :: failure

    call interpret_scene(plate//'&domain shape = ''rectangle'' x_range = 0, 1 y_range = 0, 1 '// &
                         'spacing = 0.04 arrangement = ''jittered'' jitter = 0.45 / '// &
                         '&kernel support = 1.5 / &scheme support_growth = .false. / '// &
                         '&time end = 0.05 /', scene, failure)
    call check(error,.not. allocated(failure))
    if (allocated(error)) return
    call simulation%prepare(scene, failure)
    if (.not. allocated(failure)) call simulation%run(failure)
    call check(error, allocated(failure), 'the run was not ended')
    if (allocated(error)) return
    call check(error, failure%status, status_bad_numbers)
    if (allocated(error)) return
    ! The state is the last good one.
    call check(error, all(abs(simulation%temperature) < 20.0_wp))
  end subroutine test_unstable

  subroutine test_refusals(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: square = '&domain shape = ''rectangle'' x_range = 0, 1 '// &
        'y_range = 0, 1 spacing = 0.25 / &scheme support_growth = .false. / '
    character(len=*), parameter :: held = &
        '&boundary on = ''all'' kind = ''temperature'' value = 0 / '

    call expect_refusal(square//'&time end = 1 /', &
                        '''left'', ''right'', ''bottom'', ''top''', error)
    if (allocated(error)) return
    call expect_refusal(square//'&time end = 1 / &boundary on = ''left'' kind = ''temperature'''// &
                        ' value = 0 /', '''right'', ''bottom'', ''top''', error)
    if (allocated(error)) return
    call expect_refusal(square//held//'&time end = 1 / &boundary on = ''lef'' '// &
                        'kind = ''temperature'' value = 0 /', 'no boundary called ''lef''', error)
    if (allocated(error)) return
    call expect_refusal(square//held//'&time end = 1 / &kernel support = 0.9 /', &
                        'no neighbour within the support radius', error)
    if (allocated(error)) return
    call expect_refusal(square//held, 'no group &time', error)
    if (allocated(error)) return
    call expect_refusal(square//held//'&time end = 1 method = ''forward_euler'' tol'// &
                        'erance = 1e-3 /', &
                        'does not estimate its error', error)
    if (allocated(error)) return
    call expect_refusal(square//held//'&time end = 1 step = 0.001 tolerance = 1e-3 /', &
                        'no error control', error)
    if (allocated(error)) return
    call expect_refusal(square//held//'&time end = -1 /', 'line 1: &time end', error)
    if (allocated(error)) return
    call expect_refusal(square//held//'&time end = 1 / &material conductivity = -2 /', &
                        '&material conductivity', error)
    if (allocated(error)) return
    call expect_refusal(square//held//'&time end = 1 / &initial temperature_expression = '// &
                        '''1/(x-0.5)'' /', 'gives no number at (0.5', error)
    if (allocated(error)) return
    call expect_refusal(square//held//'&time end = 1 / &source /', '&source lacks ''power''', error)
    if (allocated(error)) return
    call expect_refusal('&domain shape = ''rectangle'' x_range = 0, 1 y_range = 0, 1 '// &
                        'spacing = 1 / '//held//'&time end = 1 / '// &
                        '&scheme support_growth = .false. /', 'lower &domain spacing', error)
  end subroutine test_refusals

  !> Reading or preparing the scene fails as wrong input, in words that hold a given text.
  subroutine expect_refusal(text, words, error)
    character(len=*), intent(in) :: text, words
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure

    call interpret_scene(text, scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    call check(error, allocated(failure), 'not refused: '//words)
    if (allocated(error)) return
    call check(error, failure%status, status_bad_input)
    if (allocated(error)) return
    call check(error, index(failure%message, words) > 0, &
               'expected "'//words//'" in: '//failure%message)
  end subroutine expect_refusal

  !> A pulse that has not come yet makes no range of temperatures at the start, of which tolerances
  !> are parts.
  subroutine test_later_walls(error)
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure

    call interpret_scene('&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.1 / '// &
                         '&initial temperature = 0 / &time end = 2 / '// &
                         '&boundary value_expression = "exp(-((t - 1)/0.05)^2)" /', scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    call check(error, .not. allocated(failure))
    if (allocated(error)) return
    call check(error, simulation%conduction%temperature_scale(), 1.0_wp, thr=1.0e-12_wp)
    if (allocated(error)) return
    call simulation%run(failure)
    call check(error, .not. allocated(failure))
    if (allocated(error)) return
    call check(error, simulation%stepper%steps < 2000, to_text(simulation%stepper%steps)//' steps')
  end subroutine test_later_walls

  subroutine test_threads(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: one, two
    integer :: threads

    threads = omp_get_max_threads()
    call omp_set_num_threads(1)
    call run_plate(40, 0.2_wp, 2.1_wp, 'fatehi_manzari', one, error)
    call omp_set_num_threads(2)
    if (.not. allocated(error)) call run_plate(40, 0.2_wp, 2.1_wp, 'fatehi_manzari', two, error)
    call omp_set_num_threads(threads)
    if (allocated(error)) return
    call check(error, maxval(abs(one%temperature - two%temperature)) < &
               1.0e-12_wp*maxval(abs(one%temperature)))
  end subroutine test_threads

end module test_heat
