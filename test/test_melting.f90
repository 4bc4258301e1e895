!> Tests of melting and freezing: heat that is accounted for to rounding, fronts where they belong,
!> bounds, walls, steady states, and scenes that cannot be.
module test_melting
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_value, ieee_quiet_nan
  use calor_error, only: error_t
  use calor_heat_budget, only: budget_entry_t
  use calor_heat_law, only: heat_law_t
  use calor_kinds, only: wp, i8
  use calor_prescribed, only: prescribed_t
  use calor_random, only: random_uniform
  use calor_rightmost_eigenvalue, only: jacobian_spectrum
  use calor_rosenthal, only: bessel_k0
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene
  use calor_simulation, only: simulation_t
  use calor_text, only: to_text
  use test_field_reader, only: reals_in_file
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_melting

contains

  subroutine collect_melting(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('temperature, heat content, liquid fraction', test_mapping), &
                new_unittest('Stefan fronts', test_fronts), &
                new_unittest('Stefan front by every method', test_methods), &
                new_unittest('a source melts by what it says', test_source), &
                new_unittest('freezing conserves heat', test_freezing), &
                new_unittest('a mushy body is one of larger capacity', test_mushy), &
                new_unittest('no latent heat: conduction', test_no_latent_heat), &
                new_unittest('maximum principle', test_maximum), &
                new_unittest('walls give heat at the melting point', test_walls), &
                new_unittest('steady states do not melt', test_steady), &
                new_unittest('stable wherever it melts', test_spectra), &
                new_unittest('liquid fraction in the file', test_file), &
                new_unittest('scenes that cannot melt', test_refused), &
                new_unittest('Bessel function K0', test_bessel) &
                ]
  end subroutine collect_melting

  subroutine prepare_scene(text, simulation, error)
    character(len=*), intent(in) :: text
    type(simulation_t), intent(out) :: simulation
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(error_t), allocatable :: failure

    call interpret_scene(text, scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    if (allocated(failure)) call test_failed(error, failure%message)
  end subroutine prepare_scene

  subroutine run_scene(text, simulation, error)
    character(len=*), intent(in) :: text
    type(simulation_t), intent(out) :: simulation
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure

    call prepare_scene(text, simulation, error)
    if (allocated(error)) return
    call simulation%run(failure)
    if (allocated(failure)) call test_failed(error, failure%message)
  end subroutine run_scene

  pure function body(width, height, n, jitter) result(text)
    real(wp), intent(in) :: width, height
    !> Spacings in a unit of length
    integer, intent(in) :: n
    real(wp), intent(in) :: jitter
    character(len=:), allocatable :: text

    text = '&domain x_range = 0, '//to_text(width)//' y_range = 0, '//to_text(height)// &
           ' spacing = '//to_text(1.0_wp/n)//' arrangement = ''jittered'' jitter = '// &
           to_text(jitter)//' / '
  end function body

  subroutine test_mapping(error)
    type(error_type), allocatable, intent(out) :: error
    type(heat_law_t) :: alloy, pure_one
    real(wp), parameter :: warm(5) = [-3.0_wp, 1.0_wp, 2.0_wp, 3.0_wp, 7.0_wp]
    real(wp) :: state(5), found(5), fraction(5), potential(5)

    alloy = heat_law_t(melts=.true., solidus=1.0_wp, liquidus=3.0_wp, rise=4.0_wp)
    call alloy%prepare(0.0_wp, 1.0_wp)
    state = alloy%content(warm)
    call check(error, all(abs(state - [-3.0_wp, 1.0_wp, 4.0_wp, 7.0_wp, 11.0_wp]) < 1.0e-14_wp))
    if (allocated(error)) return
    call alloy%evaluate(state, found, potential)
    call check(error, all(abs(found - warm) < 1.0e-14_wp))
    if (allocated(error)) return
    fraction = alloy%liquid_fraction(state)
    call check(error, all(abs(fraction - [0.0_wp, 0.0_wp, 0.5_wp, 1.0_wp, 1.0_wp]) < 1.0e-14_wp))
    if (allocated(error)) return
    call check(error, all(abs(potential - found) <= 0))
    if (allocated(error)) return

    pure_one = heat_law_t(melts=.true., solidus=2.0_wp, liquidus=2.0_wp, rise=4.0_wp)
    call pure_one%prepare(0.0_wp, 1.0_wp)
    state = pure_one%content(warm)
    call check(error, all(abs(state - [-3.0_wp, 1.0_wp, 2.0_wp, 7.0_wp, 11.0_wp]) < 1.0e-14_wp))
    if (allocated(error)) return
    state = [2.0_wp, 3.0_wp, 5.0_wp, 6.0_wp, 6.5_wp]
    call pure_one%evaluate(state, found, potential)
    call check(error, all(abs(found - [2.0_wp, 2.0_wp, 2.0_wp, 2.0_wp, 2.5_wp]) < 1.0e-14_wp))
    if (allocated(error)) return
    fraction = pure_one%liquid_fraction(state)
    call check(error, all(abs(fraction - [0.0_wp, 0.25_wp, 0.75_wp, 1.0_wp, 1.0_wp]) < 1.0e-14_wp))
    if (allocated(error)) return
    state(1) = ieee_value(state(1), ieee_quiet_nan)
    call pure_one%evaluate(state, found, potential)
    call check(error, ieee_is_nan(found(1)), 'a state that is no number')
  end subroutine test_mapping

  !> λ of the one-phase Stefan problem, √π λ exp(λ²) erf(λ) = Stefan number, by Newton's method
  pure function stefan_lambda(number) result(lambda)
    real(wp), intent(in) :: number
    real(wp) :: lambda
    real(wp), parameter :: root_pi = sqrt(acos(-1.0_wp))
    integer :: k

    lambda = 1
    do k = 1, 50
      associate (grown => root_pi*exp(lambda**2)*erf(lambda))
        lambda = lambda - (lambda*grown - number)/(grown*(1 + 2*lambda**2) + 2*lambda)
      end associate
    end do
  end function stefan_lambda

  pure function stefan_scene(number, jitter, time) result(text)
    real(wp), intent(in) :: number, jitter
    !> What &time says beside the end
    character(len=*), intent(in) :: time
    character(len=:), allocatable :: text

    text = body(1.0_wp, 0.25_wp, 40, jitter)//'&material latent_heat = '//to_text(1/number)// &
           ' solidus = 0 liquidus = 0 / &boundary kind = ''insulated'' / '// &
           '&boundary on = ''left'' value = 1 / &time '//time//' end = '// &
           to_text((0.35_wp/stefan_lambda(number))**2)//' / '
  end function stefan_scene

  !> The front is where it should be by all that is liquid, and on either side of it, a spacing
  !> away, more or less than a half of each particle is.
  subroutine check_front(simulation, number, error)
    type(simulation_t), intent(inout) :: simulation
    real(wp), intent(in) :: number
    type(error_type), allocatable, intent(out) :: error
    real(wp), allocatable :: fraction(:)
    real(wp) :: exact, found
    character(len=:), allocatable :: what

    exact = 2*stefan_lambda(number)*sqrt(simulation%time)
    fraction = simulation%liquid_fraction()
    associate (cloud => simulation%cloud)
      found = sum(cloud%area*fraction)/0.25_wp
      what = 'Stefan number '//to_text(number)//': front at '//to_text(found, digits=5)// &
             ', not '//to_text(exact, digits=5)
      call check(error, abs(found - exact) < cloud%spacing, what)
      if (allocated(error)) return
      call check(error, all(fraction > 0.5_wp .or. cloud%x > exact - cloud%spacing) .and. &
                 all(fraction < 0.5_wp .or. cloud%x < exact + cloud%spacing), what// &
                 ' particle by particle')
      if (allocated(error)) return
      call check(error, all(fraction >= 0 .and. fraction <= 1))
    end associate
  end subroutine check_front

  subroutine test_fronts(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: numbers(3) = [0.1_wp, 1.0_wp, 5.0_wp], jitter(2) = [0.0_wp, 0.2_wp]
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    integer :: k, j, time

    do k = 1, size(numbers)
      do j = 1, size(jitter)
        call prepare_scene(stefan_scene(numbers(k), jitter(j), 'tolerance = 1e-4'), simulation, &
                           error)
        if (allocated(error)) return
        do time = 1, 5
          call simulation%advance_to(simulation%scene%time%end*(time/5.0_wp)**2, failure)
          if (allocated(failure)) then
            call test_failed(error, failure%message)
            return
          end if
          call check_front(simulation, numbers(k), error)
          if (allocated(error)) return
        end do
        ! Some five for each particle that the front passes
        call check(error, simulation%stepper%steps < 2000, &
                   to_text(simulation%stepper%steps)//' steps')
        if (allocated(error)) return
      end do
    end do
  end subroutine test_fronts

  subroutine test_methods(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: methods(3) = [character(len=24) :: &
        'method=''forward_euler''', 'method=''runge_kutta_4''', 'method=''rkl2''']
    type(simulation_t) :: simulation
    real(wp) :: first
    integer :: k

    do k = 1, size(methods)
      call run_scene(stefan_scene(1.0_wp, 0.2_wp, methods(k)), simulation, error)
      if (allocated(error)) return
      call check_front(simulation, 1.0_wp, error)
      if (allocated(error)) return
      ! One operator: methods differ by errors in time only.
      if (k == 1) first = sum(simulation%cloud%area*simulation%content)
      call check(error, sum(simulation%cloud%area*simulation%content), first, thr=2.0e-4_wp*first)
      if (allocated(error)) return
    end do
  end subroutine test_methods

  !> What the body stores, with the weights for which conduction in it neither makes nor loses heat.
  subroutine find_stored(simulation, stored)
    type(simulation_t), intent(inout) :: simulation
    real(wp), intent(out) :: stored
    type(budget_entry_t) :: entry

    if (.not. simulation%budget%conservative) then
      call simulation%budget%close_exactly(simulation%conduction)
    end if
    call simulation%budget%evaluate(simulation%conduction, simulation%time, simulation%content, &
                                    entry)
    stored = entry%stored
  end subroutine find_stored

  !> All insulated, 12 W/m³ in a half of a square: 6 W per metre depth, whatever melts.
  subroutine test_source(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: methods(3) = [character(len=24) :: &
        'method=''forward_euler''', 'method=''runge_kutta_4''', 'method=''rkl2'''], &
        materials(2) = [character(len=48) :: 'latent_heat = 2 solidus = 0.1 liquidus = 0.1', &
                        'latent_heat = 2 solidus = 0 liquidus = 0.3']
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    real(wp), allocatable :: fraction(:)
    real(wp) :: before, after, expected
    type(budget_entry_t) :: entry
    integer :: k, j

    do k = 1, size(methods)
      do j = 1, size(materials)
        call prepare_scene(body(1.0_wp, 1.0_wp, 16, 0.2_wp)//'&boundary kind = ''insulated'' / '// &
                           '&source power = 12 where_expression = ''x < 0.5'' / &material '// &
                           'density = 3 heat_capacity = 0.5 '//trim(materials(j))//' / '// &
                           '&initial temperature = -0.1 / &time end = 0.5 '//methods(k)//' / ', &
                           simulation, error)
        if (allocated(error)) return
        call find_stored(simulation, before)
        call check(error, before, -0.15_wp, thr=1.0e-13_wp)
        if (allocated(error)) return
        call simulation%budget%evaluate(simulation%conduction, 0.0_wp, simulation%content, entry)
        expected = 0.5_wp*entry%power(5)
        call check(error, entry%power(5), 6.0_wp, thr=0.5_wp)
        if (allocated(error)) return
        call check(error, abs(entry%imbalance) < 1.0e-12_wp, 'imbalance '//to_text(entry%imbalance))
        if (allocated(error)) return
        call simulation%run(failure)
        if (allocated(failure)) then
          call test_failed(error, failure%message)
          return
        end if
        call find_stored(simulation, after)
        call check(error, after - before, expected, thr=1.0e-12_wp*expected, &
                   more=to_text(after - before - expected))
        if (allocated(error)) return
        fraction = simulation%liquid_fraction()
        call check(error, maxval(fraction) > 0.5_wp .and. minval(fraction) < 0.1_wp, &
                   'nothing or all is liquid')
        if (allocated(error)) return
      end do
    end do
  end subroutine test_source

  !> A cold solid beside a warm liquid: what they have between them melts a half, at 0.
  subroutine test_freezing(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: jitter(2) = [0.0_wp, 0.3_wp]
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    real(wp) :: before, after
    integer :: k

    do k = 1, size(jitter)
      call prepare_scene(body(1.0_wp, 1.0_wp, 16, jitter(k))//'&boundary kind = ''insulated'' '// &
                         '/ &material latent_heat = 4 solidus = 0 liquidus = 0 / &initial '// &
                         'temperature_expression = ''x < 0.5 ? -3 : 1'' / &time end = 4 '// &
                         'tolerance = 1e-5 / ', simulation, error)
      if (allocated(error)) return
      call find_stored(simulation, before)
      call check(error, before, 1.0_wp, thr=0.3_wp)
      if (allocated(error)) return
      call simulation%run(failure)
      if (allocated(failure)) then
        call test_failed(error, failure%message)
        return
      end if
      call find_stored(simulation, after)
      call check(error, after, before, thr=1.0e-11_wp*abs(before), more=to_text(after - before))
      if (allocated(error)) return
      ! Nothing but the melting point is left, and what is stored is in the liquid.
      call check(error, maxval(abs(simulation%temperature)) < 1.0e-3_wp, &
                 to_text(maxval(abs(simulation%temperature))))
      if (allocated(error)) return
      call check(error, 4*sum(simulation%cloud%area*simulation%liquid_fraction()), before, &
                 thr=0.02_wp)
      if (allocated(error)) return
    end do
  end subroutine test_freezing

  !> All between solidus and liquidus: L/(c ΔT) = 3 makes the capacity four times as large.
  subroutine test_mushy(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: coarse, fine
    character(len=*), parameter :: rest = '&scene exact_expression = '// &
        '''2+sin(pi*x)*sin(pi*y)*exp(-pi^2*t/2)'' / &initial temperature_expression = '// &
        '''2+sin(pi*x)*sin(pi*y)'' / &boundary value = 2 / &material latent_heat = 15 '// &
        'heat_capacity = 1 solidus = -1 liquidus = 4 / &time end = 0.2 / '
    real(wp) :: order

    call run_scene(rest//body(1.0_wp, 1.0_wp, 16, 0.2_wp), coarse, error)
    if (allocated(error)) return
    call run_scene(rest//body(1.0_wp, 1.0_wp, 32, 0.2_wp), fine, error)
    if (allocated(error)) return
    order = log(coarse%relative_l2_error()/fine%relative_l2_error())/log(2.0_wp)
    call check(error, order > 1.7_wp .and. fine%relative_l2_error() < 1.0e-3_wp, 'order '// &
               to_text(order, digits=3)//', error '//to_text(fine%relative_l2_error(), digits=3))
  end subroutine test_mushy

  subroutine test_no_latent_heat(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: plain, melting
    character(len=:), allocatable :: rest

    rest = body(1.0_wp, 1.0_wp, 16, 0.2_wp)//'&initial temperature_expression = ''x*y'' / '// &
        '&boundary value_expression = ''cos(5*t)'' / &boundary on = ''left'' kind = '// &
        '''convection'' coefficient = 3 ambient = 1 / &time end = 0.1 method = ''runge_kutta_4'' / '
    call run_scene(rest, plain, error)
    if (allocated(error)) return
    call run_scene(rest//'&material latent_heat = 0 solidus = 0.5 liquidus = 0.5 /', melting, error)
    if (allocated(error)) return
    call check(error, maxval(abs(plain%temperature - melting%temperature)) < 1.0e-13_wp)
    if (allocated(error)) return
    call run_scene(rest//'&material latent_heat = 0.1 solidus = 0.5 liquidus = 0.5 /', melting, &
                   error)
    if (allocated(error)) return
    call check(error, maxval(abs(plain%temperature - melting%temperature)) > 1.0e-3_wp)
    if (allocated(error)) return
    ! The wall at the end, and its place in the states
    associate (right => maxloc(melting%cloud%x + melting%cloud%y, dim=1))
      call check(error, melting%temperature(right), cos(0.5_wp), thr=1.0e-14_wp)
      if (allocated(error)) return
      call check(error, melting%content(right), cos(0.5_wp) + 0.1_wp, thr=1.0e-14_wp)
    end associate
  end subroutine test_no_latent_heat

  !> Where no weight is negative, no temperature leaves the range of those given, not even by
  !> rounding's tenth.
  subroutine test_maximum(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: materials(2) = [character(len=48) :: &
        'latent_heat = 0.5 solidus = 0.3 liquidus = 0.3', &
        'latent_heat = 3 solidus = 0.2 liquidus = 0.4']
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    real(wp), allocatable :: fraction(:)
    integer :: k, part

    do k = 1, size(materials)
      call prepare_scene(body(1.0_wp, 1.0_wp, 20, 0.3_wp)//'&scheme laplacian = ''positive'' / '// &
                         '&initial temperature_expression = ''sin(9*x)*sin(7*y) > 0.5 ? 1 : '// &
                         '0'' / &boundary value = 0 / &boundary on = ''left'' value = 1 / '// &
                         '&material '//materials(k)// &
                         ' / &time end = 0.1 method = ''forward_euler'' / ', &
                         simulation, error)
      if (allocated(error)) return
      call check(error, simulation%monotone_limit > 0 .and. &
                 simulation%stepper%longest_step <= simulation%monotone_limit, 'no promise')
      if (allocated(error)) return
      do part = 1, 10
        call simulation%advance_to(0.01_wp*part, failure)
        if (allocated(failure)) then
          call test_failed(error, failure%message)
          return
        end if
        call check(error, minval(simulation%temperature) >= -1.0e-13_wp .and. &
                   maxval(simulation%temperature) <= 1 + 1.0e-13_wp, 'temperatures '// &
                   to_text(minval(simulation%temperature))//' to '// &
                   to_text(maxval(simulation%temperature)))
        if (allocated(error)) return
        fraction = simulation%liquid_fraction()
        call check(error, all(fraction >= 0 .and. fraction <= 1) .and. any(fraction > 0) .and. &
                   any(fraction < 1))
        if (allocated(error)) return
      end do
    end do
  end subroutine test_maximum

  !> A small body that conducts well stays at the melting point while walls and a source heat it:
  !> what they bring depends on the temperature, not on the heat content.
  subroutine test_walls(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    real(wp), parameter :: sigma = 5.670374419e-8_wp
    real(wp) :: expected

    call run_scene(body(1.0_wp, 1.0_wp, 10, 0.2_wp)//'&material latent_heat = 3000 solidus = '// &
                   '300 liquidus = 300 conductivity = 1e5 / &initial temperature = 300 / '// &
                   '&boundary on = ''left'' kind = ''flux'' flux = 500 / '// &
                   '&boundary on = ''right'' kind = ''convection'' coefficient = 10 ambient = '// &
                   '350 / &boundary on = ''top'' kind = ''radiation'' emissivity = 0.5 '// &
                   'ambient = 400 / &boundary on = ''bottom'' kind = ''insulated'' / &source '// &
                   'power_expression = ''350-T'' / &time end = 1 tolerance = 1e-5 / ', &
                   simulation, error)
    if (allocated(error)) return
    expected = 500 + 10*50 + 0.5_wp*sigma*(400.0_wp**4 - 300.0_wp**4) + 50
    associate (entry => simulation%entries(size(simulation%entries)))
      call check(error, entry%stored - simulation%entries(1)%stored, expected, thr=0.01_wp*expected)
      if (allocated(error)) return
      call check(error, abs(entry%imbalance) < 1.0e-2_wp, to_text(entry%imbalance))
      if (allocated(error)) return
      call check(error, 3000*sum(simulation%cloud%area*simulation%liquid_fraction()), expected, &
                 thr=0.01_wp*expected)
    end associate
  end subroutine test_walls

  !> The steady temperature is that without latent heat, and what is beyond the melting point is
  !> liquid.
  subroutine test_steady(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation

    call run_scene(body(1.0_wp, 1.0_wp, 10, 0.2_wp)//'&scene exact_expression = ''1-x'' / '// &
                   '&material latent_heat = 7 solidus = 0.52 liquidus = 0.52 / &boundary kind '// &
                   '= ''insulated'' / &boundary on = ''left'' value = 1 / &boundary on = '// &
                   '''right'' kind = ''convection'' coefficient = 1e9 ambient = 1e-9 / '// &
                   '&time steady = .true. /', simulation, error)
    if (allocated(error)) return
    call check(error, simulation%relative_l2_error() < 1.0e-8_wp, &
               to_text(simulation%relative_l2_error()))
    if (allocated(error)) return
    associate (entry => simulation%entries(1), fraction => simulation%liquid_fraction())
      call check(error, all((fraction > 0.5_wp) .eqv. simulation%temperature > 0.52_wp))
      if (allocated(error)) return
      call check(error, entry%stored, 0.5_wp + 7*0.5_wp, thr=0.4_wp)
      if (allocated(error)) return
      call check(error, abs(entry%imbalance) < 1.0e-8_wp, to_text(entry%imbalance))
    end associate
  end subroutine test_steady

  !> What is at the melting point takes no part in conduction: at random places or in a half, the
  !> rows of the others alone have no eigenvalue to the right of zero, and none beyond the spectral
  !> radius by which steps are chosen.
  subroutine test_spectra(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(prescribed_t), allocatable :: melting(:)
    real(wp), allocatable :: real_parts(:), imaginary_parts(:), chance(:)
    integer :: seed, k, n

    call prepare_scene(body(1.0_wp, 1.0_wp, 14, 0.3_wp)//'&boundary kind = ''insulated'' / '// &
                       '&material latent_heat = 1 solidus = 0 liquidus = 0 / &time end = 1 /', &
                       simulation, error)
    if (allocated(error)) return
    n = simulation%cloud%particles()
    do seed = 1, 8
      chance = random_uniform(seed, [(int(k, i8), k=1, n)])
      if (seed > 6) chance = merge(1, 0, simulation%cloud%x < 0.1_wp*(seed - 2))
      allocate (melting(1))
      melting(1)%particle = pack([(k, k=1, n)], chance > 0.1_wp*(seed + 1))
      call move_alloc(melting, simulation%conduction%prescribed)
      call jacobian_spectrum(simulation%conduction, real_parts, imaginary_parts)
      call check(error, size(real_parts) > 5 .and. size(real_parts) < n - 5)
      if (allocated(error)) return
      call check(error, maxval(real_parts) < 0 .and. maxval(hypot(real_parts, imaginary_parts)) <= &
                 simulation%stepper%spectral_radius, to_text(maxval(real_parts), digits=3))
      if (allocated(error)) return
    end do
  end subroutine test_spectra

  subroutine test_file(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    real(wp), allocatable :: written(:), expected(:)
    integer :: n

    call run_scene(body(1.0_wp, 0.25_wp, 20, 0.2_wp)//'&material latent_heat = 1 solidus = 0 '// &
                   'liquidus = 0 / &boundary kind = ''insulated'' / &boundary on = ''left'' '// &
                   'value = 1 / &time end = 0.05 / &output file = '// &
                   '''build/test/melting.vtkhdf'' /', &
                   simulation, error)
    if (allocated(error)) return
    call check(error, size(simulation%scene%output%fields), 2)
    if (allocated(error)) return
    n = simulation%cloud%particles()
    allocate (expected(n))
    expected(simulation%cloud%user_index) = simulation%liquid_fraction()
    written = reals_in_file('build/test/melting.vtkhdf', 'VTKHDF/PointData/liquid_fraction')
    call check(error, size(written), 2*n)
    if (allocated(error)) return
    call check(error, maxval(abs(written(n + 1:) - expected)) < 1.0e-15_wp .and. &
               count(written(:n) > 0) == count(abs(simulation%cloud%x) < 1.0e-9_wp) .and. &
               count(expected > 0) > count(written(:n) > 0))
  end subroutine test_file

  subroutine test_refused(error)
    type(error_type), allocatable, intent(out) :: error

    call refused('&material latent_heat = 1 solidus = 3 liquidus = 2 /', &
                 'solidus = 3: melting begins at the solidus, 3, and is complete at the '// &
                 'liquidus, 2', &
                 error)
    if (allocated(error)) return
    call refused('&material latent_heat = -1 solidus = 3 liquidus = 3 /', 'latent_heat', error)
    if (allocated(error)) return
    call refused('&material latent_heat = 1 liquidus = 3 /', 'solidus', error)
    if (allocated(error)) return
    call refused('&material latent_heat = 1 solidus = 3 /', 'liquidus', error)
    if (allocated(error)) return
    call refused('&material solidus = 3 /', 'it takes latent_heat to melt', error)
    if (allocated(error)) return
    call refused('&material liquidus = 3 /', 'it takes latent_heat to melt', error)
    if (allocated(error)) return
    call refused('&output file = ''build/test/no.vtkhdf'' fields = ''liquid_fraction'' /', &
                 'needs something that melts', error)
  end subroutine test_refused

  !> The message names the line and says what is wrong.
  subroutine refused(group, message, error)
    character(len=*), intent(in) :: group, message
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(error_t), allocatable :: failure

    call interpret_scene(body(1.0_wp, 1.0_wp, 5, 0.0_wp)// &
                         '&boundary value = 0 / &time end = 1 /'// &
                         new_line('a')//group, scene, failure)
    call check(error, allocated(failure), 'not refused: '//group)
    if (allocated(error)) return
    call check(error, index(failure%message, message) > 0 .and. &
               index(failure%message, 'line 2') > 0, failure%message)
  end subroutine refused

  !> M. Abramowitz, I.A. Stegun, Handbook of Mathematical Functions, table 9.8
  subroutine test_bessel(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: at(3) = [0.1_wp, 1.0_wp, 10.0_wp], exact(3) = [2.4270690247020166_wp, &
        0.42102443824070834_wp, 1.7780062316167652e-5_wp]

    call check(error, all(abs(bessel_k0(at)/exact - 1) < 1.0e-12_wp))
  end subroutine test_bessel

end module test_melting
