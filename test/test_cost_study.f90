!> Tests of `calor cost`: the comparison of accuracy and wall time.
!>
!> Wall times are looked at for their presence only: no test fails because a machine is slow.
module test_cost_study
  use, intrinsic :: iso_c_binding, only: c_int
  use calor_cost_entry, only: cost_entry_t, cost_phases, phase_total
  use calor_cost_file, only: cost_csv, cost_front
  use calor_cost_method, only: cost_method_t, cost_methods
  use calor_cost_picture, only: cost_picture
  use calor_cost_study, only: cost_study_t, cost_observer_t
  use calor_cost_table, only: describe_costs
  use calor_cost_verdict, only: cost_verdict, default_target
  use calor_error, only: error_t, status_bad_input, status_bad_numbers
  use calor_interrupt, only: watch_for_interrupt, stop_watching, interrupted
  use calor_kinds, only: wp, i8
  use calor_local_polynomial, only: interpolate_field
  use calor_pareto_front, only: on_pareto_front
  use calor_random, only: random_uniform
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene
  use calor_simulation, only: simulation_t
  use calor_text, only: text_t, to_text
  use calor_time_choice, only: time_choice_t, choose_time_steps, pilot_scene, relative_difference
  use test_process, only: outcome_t, run_command, environment_or, contents_of, write_text, &
                          number_after, line_count
  use test_support, only: discretisation_t, unit_square
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_cost_study

  character(len=*), parameter :: folder = 'build/test/cost/'

  !> The plate without its exact solution, and that
  character(len=*), parameter :: plate = &
      '&domain shape = ''rectangle'' x_range = 0, 1 y_range = 0, 1 spacing = 0.1 '// &
      'arrangement = ''jittered'' jitter = 0.2 / &time end = 0.05 / '// &
      '&initial temperature_expression = ''sin(pi*x)*sin(pi*y)'' / '// &
      '&boundary on = ''all'' kind = ''temperature'' value = 0.0 / ', &
      exact = '&scene exact_expression = ''sin(pi*x)*sin(pi*y)*exp(-2*pi^2*t)'' / '

  !> Interrupts a study once it has made some progress
  type, extends(cost_observer_t) :: impatient_t
    !> Calls before the interrupt
    integer :: calls = 0
  contains
    procedure :: progressed
  end type impatient_t

  interface
    !> Send a signal to this program
    function c_raise(signal) result(status) bind(c, name='raise')
      import :: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: signal
      integer(c_int) :: status
    end function c_raise
  end interface

contains

  subroutine collect_cost_study(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('Pareto front', test_front), &
                new_unittest('the sentence', test_verdict), &
                new_unittest('the target that nobody gave', test_target), &
                new_unittest('methods and their names', test_methods), &
                new_unittest('median times', test_median), &
                new_unittest('polynomials are carried exactly', test_polynomial), &
                new_unittest('smooth fields are carried accurately', test_smooth), &
                new_unittest('time steps are neither too long nor too short', test_time_choice), &
                new_unittest('a small study', test_study), &
                new_unittest('failures are listed', test_failures), &
                new_unittest('a study of nothing', test_nothing), &
                new_unittest('the time that all may take', test_budget), &
                new_unittest('an interrupt keeps what was measured', test_interrupt), &
                new_unittest('an interrupt leaves an older table', test_older_table), &
                new_unittest('a computed solution to compare with', test_reference), &
                new_unittest('wrong values', test_wrong_values), &
                new_unittest('the command', test_command), &
                new_unittest('the command, interrupted', test_interrupted_command) &
                ]
  end subroutine collect_cost_study

  ! ---------------------------------------------------------------------------------------------
  ! Made-up results
  ! ---------------------------------------------------------------------------------------------

  subroutine test_front(error)
    type(error_type), allocatable, intent(out) :: error
    logical, allocatable :: front(:)

    front = on_pareto_front([1.0_wp, 2.0_wp, 3.0_wp, 2.0_wp, 4.0_wp], &
                            [9.0_wp, 5.0_wp, 5.0_wp, 6.0_wp, 1.0_wp])
    call check(error, all(front .eqv. [.true., .true., .false., .false., .true.]), 'front')
    if (allocated(error)) return
    ! Equal points do not beat each other.
    call check(error, all(on_pareto_front([1.0_wp, 1.0_wp], [2.0_wp, 2.0_wp])), 'twins')
    if (allocated(error)) return
    call check(error, all(cost_front(made_up()) .eqv. [.true., .true., .false., .true., &
                                                       .false., .false.]), 'entries')
  end subroutine test_front

  !> Six entries: two of brookshaw, three of fatehi_manzari, one that failed.
  function made_up() result(entries)
    type(cost_entry_t), allocatable :: entries(:)

    allocate (entries(6))
    call make_up(entries(1), 'brookshaw', 0.1_wp, 0.001_wp, 2.0e-2_wp)
    call make_up(entries(2), 'fatehi_manzari', 0.1_wp, 0.002_wp, 5.0e-3_wp)
    call make_up(entries(3), 'brookshaw', 0.05_wp, 0.003_wp, 1.5e-2_wp)
    call make_up(entries(4), 'fatehi_manzari', 0.05_wp, 0.01_wp, 8.0e-4_wp)
    call make_up(entries(5), 'fatehi_manzari', 0.025_wp, 0.05_wp, 9.0e-4_wp)
    entries(6)%method = cost_method_t('double_gradient', support=2.1_wp)
    entries(6)%spacing = 0.1_wp
    entries(6)%failure = 'unstable, "very"'
  end function made_up

  subroutine make_up(entry, laplacian, spacing, seconds, deviation)
    type(cost_entry_t), intent(out) :: entry
    character(len=*), intent(in) :: laplacian
    real(wp), intent(in) :: spacing, seconds, deviation

    entry%method%laplacian = laplacian
    entry%method%support = 2.1_wp
    entry%spacing = spacing
    entry%failure = ''
    entry%error = deviation
    entry%time%method = 'auto'
    allocate (entry%seconds(size(cost_phases), 1), source=seconds)
  end subroutine make_up

  subroutine test_verdict(error)
    type(error_type), allocatable, intent(out) :: error
    type(cost_entry_t), allocatable :: entries(:)

    entries = made_up()
    call check(error, cost_verdict(entries, 1.0e-3_wp), &
               'For an error of 0.001 the cheapest measured is fatehi_manzari with particles '// &
               '0.05 m apart: 0.01 s, error 0.0008; brookshaw does not reach it at any spacing '// &
               'tried.')
    if (allocated(error)) return
    call check(error, cost_verdict(entries, 1.0e-1_wp), &
               'For an error of 0.1 the cheapest measured is brookshaw with particles '// &
               '0.1 m apart: 0.001 s, error 0.02.')
    if (allocated(error)) return
    call check(error, cost_verdict(entries, 1.0e-5_wp), &
               'Nothing that was measured reaches an error of 1e-5.')
    if (allocated(error)) return
    ! Supports are told where they tell methods apart.
    entries(5)%method%support = 1.5_wp
    entries(4)%error = 2.0e-3_wp
    call check(error, cost_verdict(entries, 1.0e-3_wp), &
               'For an error of 0.001 the cheapest measured is fatehi_manzari (h = 1.5 Δ) with '// &
               'particles 0.025 m apart: 0.05 s, error 0.0009; at no spacing tried is it '// &
               'reached by brookshaw or fatehi_manzari (h = 2.1 Δ).')
  end subroutine test_verdict

  subroutine test_target(error)
    type(error_type), allocatable, intent(out) :: error
    type(cost_entry_t), allocatable :: entries(:)

    entries = made_up()
    ! The best of both are 1.5e-2 and 8e-4.
    call check(error, default_target(entries), 0.1_wp, thr=1.0e-12_wp)
    if (allocated(error)) return
    call check(error, default_target(entries([2, 4, 5])), 1.0e-3_wp, thr=1.0e-12_wp)
  end subroutine test_target

  subroutine test_methods(error)
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(cost_method_t), allocatable :: methods(:)
    type(error_t), allocatable :: failure

    call interpret_scene(plate//'&kernel support = 1.7 / &cost laplacians = ''brookshaw'', '// &
                         '''positive'' supports = 1.5, 2.1 /', scene, failure)
    if (allocated(failure)) call test_failed(error, failure%message)
    if (allocated(error)) return
    methods = cost_methods(scene)
    call check(error, size(methods), 4)
    if (allocated(error)) return
    call check(error, methods(2)%name(), 'brookshaw (h = 2.1 Δ)')
    if (allocated(error)) return
    call check(error, methods(3)%title(), 'non-negative weights: positive (h = 1.5 Δ)')
    if (allocated(error)) return
    ! Orders come with the support that suits them.
    call interpret_scene(plate//'&cost laplacians = ''consistent'', ''brookshaw'' '// &
                         'supports = 1.5, 2.1 orders = 4, 6 /', scene, failure)
    methods = cost_methods(scene)
    call check(error, size(methods), 4)
    if (allocated(error)) return
    call check(error, methods(2)%name(), 'consistent of order 6 (h = 3.7 Δ)')
    if (allocated(error)) return
    call methods(2)%apply(scene)
    call check(error, scene%order, 6)
    if (allocated(error)) return
    ! Without a group, all schemes with the scene's own support
    call interpret_scene(plate//'&kernel support = 1.7 /', scene, failure)
    methods = cost_methods(scene)
    call check(error, size(methods) >= 6, 'all schemes')
    if (allocated(error)) return
    call check(error, methods(1)%support, 1.7_wp)
  end subroutine test_methods

  subroutine test_median(error)
    type(error_type), allocatable, intent(out) :: error
    type(cost_entry_t) :: entry

    call make_up(entry, 'brookshaw', 0.1_wp, 0.0_wp, 0.1_wp)
    deallocate (entry%seconds)
    allocate (entry%seconds(size(cost_phases), 4), source=0.0_wp)
    entry%seconds(phase_total, :) = [4.0_wp, 1.0_wp, 100.0_wp, 2.0_wp]
    call check(error, entry%median_seconds(phase_total), 3.0_wp)
    if (allocated(error)) return
    entry%seconds = entry%seconds(:, 1:3)
    call check(error, entry%median_seconds(phase_total), 4.0_wp)
  end subroutine test_median

  ! ---------------------------------------------------------------------------------------------
  ! Fields at other places
  ! ---------------------------------------------------------------------------------------------

  !> Fifty places of the unit square, corners among them
  subroutine make_places(x, y)
    real(wp), allocatable, intent(out) :: x(:), y(:)
    integer, parameter :: n = 50
    integer :: k

    x = [(random_uniform(3, int(2*k, i8)), k=1, n)]
    y = [(random_uniform(3, int(2*k + 1, i8)), k=1, n)]
    x(1:4) = [0.0_wp, 1.0_wp, 0.003_wp, 1.0_wp]
    y(1:4) = [0.0_wp, 0.001_wp, 0.998_wp, 1.0_wp]
  end subroutine make_places

  subroutine test_polynomial(error)
    type(error_type), allocatable, intent(out) :: error
    type(discretisation_t) :: cloud
    real(wp), allocatable :: x(:), y(:), values(:)

    cloud = unit_square(20, 'jittered', 0.3_wp, 1, 'wendland_c2', 2.1_wp)
    call make_places(x, y)
    allocate (values(size(x)))
    call interpolate_field(cloud%x, cloud%y, polynomial(cloud%x, cloud%y), 0.05_wp, 6, x, y, values)
    call check(error, maxval(abs(values - polynomial(x, y))) < 1.0e-10_wp, &
               to_text(maxval(abs(values - polynomial(x, y)))))
    if (allocated(error)) return
    ! A particle's own place gets its value, whatever the field is.
    call interpolate_field(cloud%x, cloud%y, random_field(size(cloud%x)), 0.05_wp, 6, &
                           cloud%x(7:9), cloud%y(7:9), values(1:3))
    associate (field => random_field(size(cloud%x)))
      call check(error, maxval(abs(values(1:3) - field(7:9))) <= 0, 'not the particle''s own')
    end associate
  end subroutine test_polynomial

  elemental function polynomial(x, y) result(value)
    real(wp), intent(in) :: x, y
    real(wp) :: value

    value = 1 + x - 2*y + 3*x*y**2 - x**4*y**2 + 0.5_wp*y**6 + x**5
  end function polynomial

  function random_field(n) result(field)
    integer, intent(in) :: n
    real(wp) :: field(n)
    integer :: k

    field = [(random_uniform(4, int(k, i8)), k=1, n)]
  end function random_field

  !> Errors of the transfer of sin 3x cos 2y fall with the seventh power of the spacing.
  subroutine test_smooth(error)
    type(error_type), allocatable, intent(out) :: error
    type(discretisation_t) :: cloud
    real(wp), allocatable :: x(:), y(:), values(:)
    real(wp) :: deviation(2)
    integer :: k

    call make_places(x, y)
    allocate (values(size(x)))
    do k = 1, 2
      cloud = unit_square(20*k, 'jittered', 0.2_wp, 1, 'wendland_c2', 2.1_wp)
      call interpolate_field(cloud%x, cloud%y, sin(3*cloud%x)*cos(2*cloud%y), 0.05_wp/k, 6, x, y, &
                             values)
      deviation(k) = maxval(abs(values - sin(3*x)*cos(2*y)))
    end do
    call check(error, deviation(1) < 1.0e-6_wp, to_text(deviation(1)))
    if (allocated(error)) return
    call check(error, deviation(2) < deviation(1)/40, to_text(deviation(2)))
  end subroutine test_smooth

  ! ---------------------------------------------------------------------------------------------
  ! Real studies
  ! ---------------------------------------------------------------------------------------------

  !> The error that the chosen steps make, measured against short steps of a method of fourth order,
  !> is what it is said to be; larger steps would make too large a one, or save nothing.
  subroutine test_time_choice(error)
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene, own
    type(simulation_t) :: simulation, accurate
    type(time_choice_t) :: choice
    type(error_t), allocatable :: failure
    real(wp), allocatable :: truth(:)
    real(wp) :: in_time, in_space
    character(len=15), parameter :: schemes(*) = [character(len=15) :: 'brookshaw', &
                                                  'fatehi_manzari', 'positive', 'consistent', &
                                                  'consistent']
    integer, parameter :: orders(*) = [4, 4, 4, 4, 6]
    integer :: k

    do k = 1, size(schemes)
      call interpret_scene(exact//plate//'&scheme laplacian = '''//trim(schemes(k))//''' '// &
                           'order = '//to_text(orders(k))//' /', scene, failure)
      scene%domain%spacing = 0.03125_wp
      call simulation%prepare(pilot_scene(scene), failure)
      truth = sin_solution(simulation)
      call choose_time_steps(simulation, 0.1_wp, choice, failure, truth)
      if (allocated(failure)) call test_failed(error, failure%message)
      if (allocated(error)) return
      own = scene
      call choice%apply(own)
      call run(own, simulation, error)
      if (allocated(error)) return
      own = scene
      own%time%method = 'runge_kutta_4'
      own%time%step = 1/simulation%stepper%spectral_radius
      call run(own, accurate, error)
      if (allocated(error)) return
      in_time = relative_difference(simulation%temperature, accurate%temperature, &
                                    simulation%cloud%volume)
      in_space = relative_difference(accurate%temperature, truth, simulation%cloud%volume)
      call check(error, in_time < 0.1_wp*in_space, schemes(k)//' too long: '// &
                 to_text(in_time/in_space))
      if (allocated(error)) return
      call check(error, in_time <= 1.1_wp*choice%error, schemes(k)//' claims less: '// &
                 to_text(choice%error/in_time))
      if (allocated(error)) return
      if (choice%tolerance > 0 .and. choice%tolerance < 9.0e-3_wp .and. &
          choice%method /= 'exponential') then
        ! Not needlessly short; a longer series of the exponential costs next to nothing
        own = scene
        own%time%tolerance = 8*choice%tolerance
        call run(own, simulation, error)
        if (allocated(error)) return
        in_time = relative_difference(simulation%temperature, accurate%temperature, &
                                      simulation%cloud%volume)
        call check(error, in_time > 0.1_wp*in_space .or. &
                   simulation%stepper%integrator%evaluations >= choice%evaluations, &
                   schemes(k)//' too short: '//to_text(in_time/in_space))
        if (allocated(error)) return
      end if
    end do
  end subroutine test_time_choice

  function sin_solution(simulation) result(truth)
    type(simulation_t), intent(in) :: simulation
    real(wp), allocatable :: truth(:)

    allocate (truth(simulation%cloud%particles()))
    call simulation%exact%evaluate(simulation%cloud%x, simulation%cloud%y, &
                                   simulation%scene%time%end, values=truth)
  end function sin_solution

  subroutine run(scene, simulation, error)
    type(scene_t), intent(in) :: scene
    type(simulation_t), intent(out) :: simulation
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure

    call simulation%prepare(scene, failure)
    if (.not. allocated(failure)) call simulation%advance_to(scene%time%end, failure)
    if (allocated(failure)) call test_failed(error, failure%message)
  end subroutine run

  !> Read a scene and prepare its study in an empty folder.
  subroutine prepare_study(text, study, error)
    character(len=*), intent(in) :: text
    type(cost_study_t), intent(out) :: study
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(error_t), allocatable :: failure

    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder)
    call interpret_scene(text, scene, failure)
    if (.not. allocated(failure)) call study%prepare(scene, failure)
    if (allocated(failure)) call test_failed(error, failure%message)
  end subroutine prepare_study

  subroutine test_study(error)
    type(error_type), allocatable, intent(out) :: error
    type(cost_study_t) :: study
    type(error_t), allocatable :: failure
    type(simulation_t) :: simulation
    type(scene_t) :: scene
    character(len=:), allocatable :: csv
    integer :: k

    call prepare_study(exact//plate//'&cost spacings = 0.05, 0.1 laplacians = ''brookshaw'', '// &
                       '''fatehi_manzari'' repetitions = 2 file = '''//folder//'c.csv'' /', &
                       study, error)
    if (allocated(error)) return
    call study%measure(failure)
    if (allocated(failure)) call test_failed(error, failure%message)
    if (allocated(error)) return
    call check(error, size(study%entries), 4)
    if (allocated(error)) return
    do k = 1, size(study%entries)
      associate (entry => study%entries(k))
        scene = study%scene
        scene%laplacian = entry%method%laplacian
        scene%domain%spacing = entry%spacing
        scene%time%tolerance = 1.0e-9_wp
        call run(scene, simulation, error)
        if (allocated(error)) return
        call check(error, entry%error, simulation%relative_l2_error(), &
                   thr=0.105_wp*simulation%relative_l2_error())
        if (allocated(error)) return
        call check(error, entry%time%error <= 0.1_wp*entry%error/0.9_wp, &
                   'time error '//to_text(entry%time%error))
        if (allocated(error)) return
        call check(error, size(entry%seconds, 2), 2)
        if (allocated(error)) return
        call check(error, all(entry%seconds >= 0) .and. all(entry%seconds(phase_total, :) > 0), &
                   'times')
        if (allocated(error)) return
        ! No phase is left out of the total.
        call check(error, all(sum(entry%seconds(:phase_total - 1, :), dim=1) <= &
                              1.0001_wp*entry%seconds(phase_total, :)), 'total')
        if (allocated(error)) return
        call check(error, entry%particles, merge(121, 441, entry%spacing > 0.07_wp))
        if (allocated(error)) return
        call check(error, entry%evaluations >= entry%steps .and. entry%memory > 1.0e4_wp .and. &
                   entry%neighbours > 8, 'figures')
        if (allocated(error)) return
      end associate
    end do
    csv = contents_of(folder//'c.csv')
    call check(error, line_count(csv), 5, csv)
    if (allocated(error)) return
    call check_columns(error, csv)
    if (allocated(error)) return
    call check(error, index(contents_of(folder//'c.svg'), '</svg>') > 0, 'SVG')
    if (allocated(error)) return
    call check(error, index(contents_of(folder//'c.png'), 'PNG') == 2, 'PNG')
    if (allocated(error)) return
    call check_width(error, describe_costs(study))
  end subroutine test_study

  !> All lines of a CSV have as many fields.
  subroutine check_columns(error, csv)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: csv
    integer :: k, fields, expected
    logical :: quoted

    fields = 1
    expected = 0
    quoted = .false.
    do k = 1, len(csv)
      if (csv(k:k) == '"') quoted = .not. quoted
      if (csv(k:k) == ',' .and. .not. quoted) fields = fields + 1
      if (csv(k:k) /= new_line('a')) cycle
      if (expected == 0) expected = fields
      call check(error, fields, expected, csv)
      if (allocated(error)) return
      fields = 1
    end do
    call check(error, expected > 20, 'columns')
  end subroutine check_columns

  !> A table fits a terminal of 100 columns. (Each Δ has two bytes.)
  subroutine check_width(error, lines)
    type(error_type), allocatable, intent(out) :: error
    type(text_t), intent(in) :: lines(:)
    integer :: k

    do k = 1, size(lines)
      call check(error, len(lines(k)%value) <= 100, lines(k)%value)
      if (allocated(error)) return
    end do
  end subroutine check_width

  !> Schemes that cannot be run, and clouds that cannot be made, are listed with the reason.
  subroutine test_failures(error)
    type(error_type), allocatable, intent(out) :: error
    type(cost_study_t) :: study
    type(error_t), allocatable :: failure
    type(text_t), allocatable :: lines(:)
    character(len=:), allocatable :: csv
    integer :: k, unstable, wide

    call prepare_study(exact//plate//'&cost spacings = 0.05, 7 laplacians = '// &
                       '''double_gradient'', ''positive'' repetitions = 1 file = '''//folder// &
                       'c.csv'' /', study, error)
    if (allocated(error)) return
    call study%measure(failure)
    if (allocated(failure)) call test_failed(error, failure%message)
    if (allocated(error)) return
    csv = contents_of(folder//'c.csv')
    call check(error, line_count(csv), 5, csv)
    if (allocated(error)) return
    call check_columns(error, csv)
    if (allocated(error)) return
    lines = describe_costs(study)
    call check_width(error, lines)
    if (allocated(error)) return
    unstable = 0
    wide = 0
    do k = 1, size(lines)
      if (index(lines(k)%value, 'double_gradient is unstable') > 0) unstable = unstable + 1
      if (index(lines(k)%value, 'larger than the rectangle') > 0) wide = wide + 1
    end do
    call check(error, unstable, 1)
    if (allocated(error)) return
    call check(error, wide, 2)
    if (allocated(error)) return
    csv = cost_csv(made_up(), 2)
    call check_columns(error, csv)
    if (allocated(error)) return
    call check(error, index(csv, '"unstable, ""very"""') > 0, csv)
    if (allocated(error)) return
    call check(error, index(cost_picture(made_up(), 'a "b"', 2, 1.0_wp), 'double_gradient'), 0)
    if (allocated(error)) return
    call check(error, index(cost_picture(made_up(), 'a "b"', 2, 1.0_wp), 'title "a \"b\""') > 0)
  end subroutine test_failures

  !> Where nothing can be measured, what is wrong with the scene is said.
  subroutine test_nothing(error)
    type(error_type), allocatable, intent(out) :: error
    type(cost_study_t) :: study
    type(error_t), allocatable :: failure

    call prepare_study(exact//plate//'&cost spacings = 0.05, 0.1 laplacians = '// &
                       '''double_gradient'' file = '''//folder//'c.csv'' /', study, error)
    if (allocated(error)) return
    call study%measure(failure)
    call check(error, allocated(failure), 'nothing was measured')
    if (allocated(error)) return
    call check(error, failure%status, status_bad_numbers)
    if (allocated(error)) return
    call check(error, index(failure%message, 'unstable') > 0, failure%message)
  end subroutine test_nothing

  subroutine test_budget(error)
    type(error_type), allocatable, intent(out) :: error
    type(cost_study_t) :: study
    type(error_t), allocatable :: failure

    call prepare_study(exact//plate//'&cost spacings = 0.02, 0.1 laplacians = ''positive'' '// &
                       'repetitions = 1000 seconds = 1e-3 file = '''//folder//'c.csv'' /', &
                       study, error)
    if (allocated(error)) return
    call study%measure(failure)
    if (allocated(failure)) call test_failed(error, failure%message)
    if (allocated(error)) return
    ! The first is begun as long as nobody knows how long it takes.
    call check(error, study%entries(1)%measured() .and. .not. study%entries(2)%measured(), 'begun')
    if (allocated(error)) return
    call check(error, index(study%entries(2)%failure, '0.001 s of &cost seconds') > 0, &
               study%entries(2)%failure)
  end subroutine test_budget

  subroutine progressed(this, study, entry)
    class(impatient_t), intent(inout) :: this
    type(cost_study_t), intent(in) :: study
    integer, intent(in) :: entry
    integer(c_int), parameter :: interrupt = 2_c_int
    integer(c_int) :: status

    associate (unused => study, also => entry)
    end associate
    if (this%calls == 0) status = c_raise(interrupt)
    this%calls = this%calls - 1
  end subroutine progressed

  !> A study of four entries that is interrupted in the third.
  subroutine interrupt_study(before, study, failure, error)
    !> What is done in the folder first
    character(len=*), intent(in) :: before
    type(cost_study_t), intent(out) :: study
    type(error_t), allocatable, intent(out) :: failure
    type(error_type), allocatable, intent(out) :: error
    type(impatient_t) :: observer

    call prepare_study(exact//plate//'&cost spacings = 0.1, 0.05 laplacians = ''brookshaw'', '// &
                       '''positive'' file = '''//folder//'c.csv'' /', study, error)
    if (allocated(error)) return
    call execute_command_line('cd '//folder//' && '//before)
    ! The solution to compare with, and two entries
    observer%calls = 3
    call watch_for_interrupt()
    call study%measure(failure, observer)
    call stop_watching()
    call check(error, allocated(failure), 'not interrupted')
    if (allocated(error)) return
    call check(error, failure%status, 130)
    if (allocated(error)) return
    call check(error, .not. interrupted(), 'still interrupted')
  end subroutine interrupt_study

  subroutine test_interrupt(error)
    type(error_type), allocatable, intent(out) :: error
    type(cost_study_t) :: study
    type(error_t), allocatable :: failure
    character(len=:), allocatable :: csv

    call interrupt_study('true', study, failure, error)
    if (allocated(error)) return
    call check(error, study%entries(2)%measured() .and. .not. study%entries(3)%measured(), 'kept')
    if (allocated(error)) return
    csv = contents_of(folder//'c.csv')
    call check(error, line_count(csv), 5, csv)
    if (allocated(error)) return
    call check_columns(error, csv)
    if (allocated(error)) return
    call check(error, index(contents_of(folder//'c.svg'), '</svg>') > 0, 'SVG')
    if (allocated(error)) return
    call check(error, contents_of(folder//'c.unfinished.csv'), '')
    if (allocated(error)) return
    call check_width(error, describe_costs(study))
  end subroutine test_interrupt

  subroutine test_older_table(error)
    type(error_type), allocatable, intent(out) :: error
    type(cost_study_t) :: study
    type(error_t), allocatable :: failure

    call interrupt_study('echo old >c.csv; echo old >c.svg', study, failure, error)
    if (allocated(error)) return
    call check(error, contents_of(folder//'c.csv'), 'old'//new_line('a'))
    if (allocated(error)) return
    call check(error, contents_of(folder//'c.svg'), 'old'//new_line('a'))
    if (allocated(error)) return
    call check(error, line_count(contents_of(folder//'c.unfinished.csv')), 5)
    if (allocated(error)) return
    call check(error, study%written(1)%value, folder//'c.unfinished.csv')
  end subroutine test_older_table

  !> Without the exact solution, errors are nearly the same.
  subroutine test_reference(error)
    type(error_type), allocatable, intent(out) :: error
    type(cost_study_t) :: known, computed
    type(error_t), allocatable :: failure
    character(len=*), parameter :: cost = '&cost spacings = 0.1, 0.05 laplacians = '// &
        '''brookshaw'', ''fatehi_manzari'' repetitions = 1 file = '''//folder//'c.csv'' /'
    integer :: k

    call prepare_study(exact//plate//cost, known, error)
    if (allocated(error)) return
    call known%measure(failure)
    if (.not. allocated(failure)) then
      call prepare_study(plate//cost, computed, error)
      if (allocated(error)) return
      call computed%measure(failure)
    end if
    if (allocated(failure)) call test_failed(error, failure%message)
    if (allocated(error)) return
    call check(error, computed%reference%uncertainty > 0 .and. &
               abs(known%reference%uncertainty) <= 0, 'uncertainty')
    if (allocated(error)) return
    do k = 1, size(known%entries)
      call check(error, computed%entries(k)%error, known%entries(k)%error, rel=.true., &
                 thr=0.02_wp, message=known%entries(k)%method%name())
      if (allocated(error)) return
    end do
  end subroutine test_reference

  ! ---------------------------------------------------------------------------------------------
  ! The command
  ! ---------------------------------------------------------------------------------------------

  subroutine refuse(error, groups, words)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: groups, words
    type(scene_t) :: scene
    type(cost_study_t) :: study
    type(error_t), allocatable :: failure

    call interpret_scene(exact//plate//new_line('a')//groups, scene, failure)
    if (.not. allocated(failure)) call study%prepare(scene, failure)
    call check(error, allocated(failure), 'accepted: '//groups)
    if (allocated(error)) return
    call check(error, failure%status, status_bad_input, failure%message)
    if (allocated(error)) return
    call check(error, index(failure%message, words) > 0, failure%message)
  end subroutine refuse

  subroutine test_wrong_values(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=:), allocatable :: many
    integer :: k

    call refuse(error, '&cost spacings = 0.1, -0.05 /', &
                'scene, line 2: &cost spacings = 0.1, -0.05: expected')
    if (allocated(error)) return
    call refuse(error, '&cost spacings = 0.1, 0.05, 0.1 /', '0.1 is there twice; remove one.')
    if (allocated(error)) return
    call refuse(error, '&cost spacings = /', 'scene, line 2: &cost spacings')
    if (allocated(error)) return
    call refuse(error, '&cost laplacians = ''brokshaw'' /', 'Did you mean ''brookshaw''?')
    if (allocated(error)) return
    call refuse(error, '&cost supports = 200 /', 'line 2: &cost supports = 200')
    if (allocated(error)) return
    call refuse(error, '&cost repetitions = 0 /', 'line 2: &cost repetitions = 0: expected at '// &
                'least 1')
    if (allocated(error)) return
    call refuse(error, '&cost seconds = 0 /', 'line 2: &cost seconds = 0')
    if (allocated(error)) return
    call refuse(error, '&cost target = -1e-4 /', 'line 2: &cost target = ')
    if (allocated(error)) return
    call refuse(error, '&cost file = ''c.txt'' /', 'the name must end in .csv')
    if (allocated(error)) return
    call refuse(error, '&cost orders = 2, 3.5 /', 'line 2: &cost orders = 2, 3.5: orders are '// &
                'whole')
    if (allocated(error)) return
    call refuse(error, '&cost orders = 12 /', 'line 2: &cost orders = 12: expected at most 8')
    if (allocated(error)) return
    call refuse(error, '&cost spacing = 0.1 /', 'Did you mean ''spacings''?')
    if (allocated(error)) return
    many = '0.1'
    do k = 1, 50
      many = many//', '//to_text(0.1_wp + 0.001_wp*k)
    end do
    call refuse(error, '&cost spacings = '//many//' /', 'shorten the lists of &cost.')
  end subroutine test_wrong_values

  function program_path() result(path)
    character(len=:), allocatable :: path
    type(outcome_t) :: here

    path = environment_or('CALOR_PROGRAM', 'bin/calor')
    if (path(1:1) == '/') return
    call run_command('pwd', folder//'../here', here)
    path = here%output(:len(here%output) - 1)//'/'//path
  end function program_path

  subroutine test_command(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    character(len=:), allocatable :: line
    integer :: stop

    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder)
    call write_text(folder//'scene.nml', exact//plate//'&cost laplacians = ''positive'' '// &
                    'spacings = 0.1, 0.05 repetitions = 1 target = 0.01 /')
    call run_command('cd '//folder//' && "'//program_path()//'" cost scene.nml', &
                     folder//'../called', outcome)
    call check(error, outcome%status, 0, outcome%errors)
    if (allocated(error)) return
    call check(error, index(outcome%output, 'For an error of 0.01 the cheapest measured is '// &
                            'positive with particles 0.05 m') > 0, outcome%output)
    if (allocated(error)) return
    call check(error, index(outcome%output, 'Written: scene_cost.csv') > 0, outcome%output)
    if (allocated(error)) return
    ! No bar where no terminal is
    call check(error, outcome%errors, '')
    if (allocated(error)) return
    do while (len(outcome%output) > 0)
      stop = index(outcome%output, new_line('a'))
      line = outcome%output(:stop - 1)
      outcome%output = outcome%output(stop + 1:)
      call check(error, len(line) <= 100, line)
      if (allocated(error)) return
    end do
    call run_command('"'//program_path()//'" cost --help', folder//'../called', outcome)
    call check(error, outcome%status, 0)
    if (allocated(error)) return
    call check(error, index(outcome%output, 'spacings') > 0 .and. &
               index(outcome%output, 'Ctrl-C') > 0, outcome%output)
  end subroutine test_command

  !> The interrupt comes as soon as an entry is in the table, and ends a study that would take
  !> hours.
  subroutine test_interrupted_command(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder)
    call write_text(folder//'scene.nml', exact//plate//'&cost laplacians = ''positive'' '// &
                    'spacings = 0.1, 0.05 repetitions = 1000 seconds = 1e6 /')
    call write_text(folder//'interrupt', '"$1" cost scene.nml & program=$!'//new_line('a')// &
                    'until grep -qs "positive.*rkl2\|positive.*expo\|positive.*runge" '// &
                    'scene_cost.unfinished.csv; do sleep 0.1; '// &
                    'kill -0 $program || break; done'//new_line('a')// &
                    'kill -TERM $program; wait $program'//new_line('a'))
    call run_command('cd '//folder//' && sh interrupt "'//program_path()//'"', &
                     folder//'../called', outcome)
    call check(error, outcome%status, 143, outcome%errors)
    if (allocated(error)) return
    call check(error, index(outcome%errors, 'Interrupted after') > 0, outcome%errors)
    if (allocated(error)) return
    call check(error, index(outcome%output, 'positive with particles') > 0, outcome%output)
    if (allocated(error)) return
    call check(error, line_count(contents_of(folder//'scene_cost.csv')), 3)
    if (allocated(error)) return
    call check(error, number_after(outcome%output, 'For an error of') < 1, outcome%output)
  end subroutine test_interrupted_command

end module test_cost_study
