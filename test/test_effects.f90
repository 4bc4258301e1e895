!> Tests of effects: orders of boundary conditions, stability, sources, steady states, heat budgets,
!> and that what a scene does not call for costs nothing.
module test_effects
  use calor_effect, only: effect_slot_t
  use calor_effects, only: known_effects, effect_usage
  use calor_error, only: error_t
  use calor_kinds, only: wp, i8
  use calor_rightmost_eigenvalue, only: jacobian_spectrum
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene
  use calor_simulation, only: simulation_t
  use calor_text, only: to_text, text_t
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_effects

  !> u = 300 + 100 sin(x + 0.3) cos(y + 0.2) exp(-t), with the source 100 sin cos exp(-t) that it
  !> takes where κ = ρ = c = 1, and the flux through the right wall
  character(len=*), parameter :: exact = '300+100*sin(x+0.3)*cos(y+0.2)*exp(-t)', &
      flux_right = '100*cos(x+0.3)*cos(y+0.2)*exp(-t)', &
      flux_top = '(-100)*sin(x+0.3)*sin(y+0.2)*exp(-t)'
  !> The cloud and the scheme are still to be said
  character(len=*), parameter :: manufactured = '&scene exact_expression = '''//exact//''' / '// &
      '&initial temperature_expression = ''300+100*sin(x+0.3)*cos(y+0.2)'' / '// &
      '&source power_expression = ''100*sin(x+0.3)*cos(y+0.2)*exp(-t)'' / '// &
      '&boundary value_expression = '''//exact//''' / '

contains

  subroutine collect_effects(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('flux: order two and four', test_flux_order), &
                new_unittest('convection: order two and four', test_convection_order), &
                new_unittest('radiation: order two and four', test_radiation_order), &
                new_unittest('insulated: order two and four', test_insulated_order), &
                new_unittest('insulated bodies: one eigenvalue 0, none beyond', test_spectra), &
                new_unittest('a part of a wall', test_part), &
                new_unittest('held corners stay held', test_corners), &
                new_unittest('sources: moving, in a region, of the temperature', test_sources), &
                new_unittest('steady radiation', test_steady_radiation), &
                new_unittest('steady reaction', test_steady_reaction), &
                new_unittest('no steady state without a hold', test_no_hold), &
                new_unittest('the heat budget closes, in time nearly', test_budget), &
                new_unittest('a source heats by what it says', test_source_budget), &
                new_unittest('effects that are absent cost nothing', test_absent), &
                new_unittest('radiation needs kelvin', test_kelvin) &
                ]
  end subroutine collect_effects

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

  pure function square(n, jitter) result(text)
    integer, intent(in) :: n
    real(wp), intent(in) :: jitter
    character(len=:), allocatable :: text

    text = '&domain x_range = 0, 1 y_range = 0, 1 spacing = '//to_text(1.0_wp/n)// &
           ' arrangement = ''jittered'' jitter = '//to_text(jitter)//' / '
  end function square

  !> Run a scene on two spacings with two schemes, on a lattice and an irregular cloud, and look at
  !> the order of convergence.
  subroutine check_orders(text, error)
    !> The scene but for cloud, scheme and time
    character(len=*), intent(in) :: text
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: scheme(2) = [character(len=40) :: &
        '&scheme laplacian = ''fatehi_manzari'' / ', '&scheme laplacian = ''consistent'' / ']
    ! The error in time shall not count beside that in space.
    character(len=*), parameter :: time(2) = [character(len=40) :: &
        '&time end = 0.05 tolerance = 1e-8 /', '&time end = 0.05 tolerance = 1e-11 /']
    real(wp), parameter :: lowest(2) = [1.7_wp, 3.5_wp], jitter(2) = [0.0_wp, 0.2_wp]
    type(simulation_t) :: coarse, fine
    real(wp) :: order
    integer :: k, j

    do k = 1, 2
      do j = 1, 2
        call run_scene(text//scheme(k)//square(16, jitter(j))//time(k), coarse, error)
        if (allocated(error)) return
        call run_scene(text//scheme(k)//square(32, jitter(j))//time(k), fine, error)
        if (allocated(error)) return
        order = log(coarse%relative_l2_error()/fine%relative_l2_error())/log(2.0_wp)
        call check(error, order >= lowest(k), scheme(k)//'jitter '//to_text(jitter(j))// &
                   ': order '//to_text(order, digits=3)//', errors '// &
                   to_text(coarse%relative_l2_error(), digits=3)//', '// &
                   to_text(fine%relative_l2_error(), digits=3))
        if (allocated(error)) return
      end do
    end do
  end subroutine check_orders

  !> Two walls with a corner between them
  subroutine test_flux_order(error)
    type(error_type), allocatable, intent(out) :: error

    call check_orders(manufactured// &
                      '&boundary on = ''right'' kind = ''flux'' flux_expression = '''// &
                      flux_right//''' / '// &
                      '&boundary on = ''top'' kind = ''flux'' flux_expression = '''// &
                      flux_top//''' / ', error)
  end subroutine test_flux_order

  subroutine test_convection_order(error)
    type(error_type), allocatable, intent(out) :: error

    call check_orders(manufactured//'&boundary on = ''right'' kind = ''convection'' '// &
                      'coefficient_expression = ''2+y'' ambient_expression = '''//exact//'+'// &
                      flux_right//'/(2+y)'' / &boundary on = ''top'' kind = ''convection'' '// &
                      'coefficient = 3 ambient_expression = '''//exact//'+'//flux_top// &
                      '/3'' / ', error)
  end subroutine test_convection_order

  subroutine test_radiation_order(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: ambient = &
        ' kind = ''radiation'' emissivity = 0.5 ambient_expression = ''(('//exact//')^4+('

    call check_orders(manufactured// &
                      '&boundary on = ''right'''//ambient//flux_right// &
                      ')/(0.5*5.670374419e-8))^0.25'' / '// &
                      '&boundary on = ''top'''//ambient//flux_top// &
                      ')/(0.5*5.670374419e-8))^0.25'' / ', error)
  end subroutine test_radiation_order

  subroutine test_insulated_order(error)
    type(error_type), allocatable, intent(out) :: error

    call check_orders('&scene exact_expression = ''cos(pi*x)*cos(pi*y)*exp(-2*pi^2*t)'' / '// &
                      '&initial temperature_expression = ''cos(pi*x)*cos(pi*y)'' / '// &
                      '&boundary kind = ''insulated'' / ', error)
  end subroutine test_insulated_order

  subroutine test_spectra(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: disc = '&domain shape = ''disc'' radius = 1 spacing = 0.12 '// &
        'arrangement = ''relaxed'' / ', rest = '&boundary kind = ''insulated'' / &time end = 1 / '
    character(len=*), parameter :: order_4 = '&scheme laplacian = ''consistent'' / '

    call check_spectrum(rest//square(16, 0.0_wp), error)
    if (allocated(error)) return
    call check_spectrum(rest//square(16, 0.3_wp), error)
    if (allocated(error)) return
    call check_spectrum(rest//disc, error)
    if (allocated(error)) return
    call check_spectrum(rest//order_4//square(16, 0.3_wp), error)
    if (allocated(error)) return
    call check_spectrum(rest//order_4//disc, error)
  end subroutine test_spectra

  !> A uniform temperature stays, and every other mode fades.
  subroutine check_spectrum(text, error)
    character(len=*), intent(in) :: text
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    real(wp), allocatable :: real_parts(:), imaginary_parts(:)
    real(wp) :: radius

    call interpret_scene(text, scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    if (allocated(failure)) then
      call test_failed(error, failure%message)
      return
    end if
    call jacobian_spectrum(simulation%conduction, real_parts, imaginary_parts)
    radius = maxval(hypot(real_parts, imaginary_parts))
    call check(error, maxval(real_parts) <= 1.0e-11_wp*radius, 'largest real part '// &
               to_text(maxval(real_parts), digits=3)//' of '//text)
    if (allocated(error)) return
    call check(error, count(hypot(real_parts, imaginary_parts) < 1.0e-9_wp*radius), 1, text)
  end subroutine check_spectrum

  !> A wall that is half held, half heated: through the heated half comes half its length of flux.
  subroutine test_part(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation

    call run_scene(square(20, 0.2_wp)//'&boundary value = 0 / '// &
                   '&boundary on = ''left'' kind = ''insulated'' / '// &
                   '&boundary on = ''left'' kind = ''flux'' flux = 8 where_expression = '// &
                   '''y > 0.26 && y < 0.74'' / &time end = 0.1 /', simulation, error)
    if (allocated(error)) return
    associate (entry => simulation%entries(size(simulation%entries)))
      ! Nine spacings of 0.05
      call check(error, entry%power(1), 8*0.45_wp, thr=1.0e-9_wp)
    end associate
  end subroutine test_part

  subroutine test_corners(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    integer :: k

    call run_scene(square(10, 0.0_wp)//'&boundary value = 3 / '// &
                   '&boundary on = ''left'' kind = ''flux'' flux = 100 / &time end = 0.1 /', &
                   simulation, error)
    if (allocated(error)) return
    do k = 1, simulation%cloud%particles()
      associate (x => simulation%cloud%x(k), y => simulation%cloud%y(k))
        if (x > 1.0e-9_wp .or. (y > 1.0e-9_wp .and. y < 1 - 1.0e-9_wp)) cycle
        call check(error, simulation%temperature(k), 3.0_wp, thr=1.0e-12_wp)
        if (allocated(error)) return
      end associate
    end do
    call check(error, maxval(simulation%temperature) > 10.0_wp)
  end subroutine test_corners

  !> Exact for quadratic fields, so that nothing but the sources is tested: u = x² + t² + y has
  !> u_t - ∇²u = 2 t - 2.
  subroutine test_sources(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation

    call run_scene(square(10, 0.3_wp)//'&scene exact_expression = ''x^2+t^2+y'' / '// &
                   '&initial temperature_expression = ''x^2+y'' / '// &
                   '&boundary value_expression = ''x^2+t^2+y'' / '// &
                   '&source power_expression = ''2*t+(x-t)^2'' / '// &
                   '&source power = -2 where_expression = ''x < 0.5'' / '// &
                   '&source power = -2 where_expression = ''x >= 0.5'' / '// &
                   '&source power_expression = ''(x^2+t^2+y)-T-(x-t)^2'' / '// &
                   '&time end = 0.5 tolerance = 1e-10 /', simulation, error)
    if (allocated(error)) return
    call check(error, simulation%relative_l2_error() < 1.0e-7_wp, &
               to_text(simulation%relative_l2_error()))
  end subroutine test_sources

  !> κ (T₁ - T₂)/L = ε σ T₂⁴, a linear profile: T₂ = 1000 K, ε σ T₂⁴ = 0.5 · 56703.74… W/m².
  subroutine test_steady_radiation(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation

    call run_scene(square(10, 0.2_wp)//'&scene exact_expression = '// &
                   '''1000+28351.872095*(1-x)/50'' / &material conductivity = 50 / '// &
                   '&boundary kind = ''insulated'' / &boundary on = ''left'' value = '// &
                   '1567.0374419 / &boundary on = ''right'' kind = ''radiation'' '// &
                   'emissivity = 0.5 ambient = 0 / &initial temperature = 300 / '// &
                   '&time steady = .true. tolerance = 1e-10 /', simulation, error)
    if (allocated(error)) return
    call check(error, simulation%relative_l2_error() < 1.0e-9_wp, &
               to_text(simulation%relative_l2_error()))
    if (allocated(error)) return
    call check(error, simulation%newton_steps > 2 .and. simulation%newton_steps < 15)
    if (allocated(error)) return
    associate (entry => simulation%entries(1))
      call check(error, abs(entry%imbalance) < 1.0e-9_wp, to_text(entry%imbalance))
      if (allocated(error)) return
      call check(error, entry%power(1), 28351.872095_wp, thr=1.0e-5_wp*28351.872095_wp)
    end associate
  end subroutine test_steady_radiation

  !> ∇²u = u³ - (x² + y)³ + … with a known quadratic solution, by Newton's method
  subroutine test_steady_reaction(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation

    call run_scene(square(12, 0.2_wp)//'&scene exact_expression = ''x^2+y'' / '// &
                   '&boundary value_expression = ''x^2+y'' / '// &
                   '&source power_expression = ''(x^2+y)^3-T^3-2'' / '// &
                   '&time steady = .true. tolerance = 1e-9 /', simulation, error)
    if (allocated(error)) return
    call check(error, simulation%relative_l2_error() < 1.0e-9_wp, &
               to_text(simulation%relative_l2_error()))
  end subroutine test_steady_reaction

  subroutine test_no_hold(error)
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure

    call interpret_scene(square(10, 0.0_wp)//'&boundary kind = ''flux'' flux = 1 / '// &
                         '&time steady = .true. /', scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    if (.not. allocated(failure)) call simulation%run(failure)
    call check(error, allocated(failure), 'not refused')
    if (allocated(error)) return
    call check(error, index(failure%message, 'nothing ties the steady temperature down') > 0, &
               failure%message)
  end subroutine test_no_hold

  subroutine test_budget(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: coarse, fine
    character(len=*), parameter :: rest = manufactured// &
        '&boundary on = ''right'' kind = ''convection'' coefficient = 2 ambient_expression = '''// &
        exact//'+'//flux_right//'/2'' / '

    call run_scene(square(10, 0.2_wp)//rest//'&time end = 0.3 /', coarse, error)
    if (allocated(error)) return
    call run_scene(square(40, 0.2_wp)//rest//'&time end = 0.3 /', fine, error)
    if (allocated(error)) return
    associate (imbalance => coarse%entries(2)%imbalance, finer => fine%entries(2)%imbalance)
      call check(error, abs(imbalance) < 1.0e-4_wp .and. abs(finer) < 2.0e-5_wp, &
                 to_text(imbalance)//', '//to_text(finer))
    end associate
    if (allocated(error)) return
    call run_scene(square(10, 0.3_wp)//rest//'&time steady = .true. /', coarse, error)
    if (allocated(error)) return
    call check(error, abs(coarse%entries(1)%imbalance) < 1.0e-10_wp, &
               to_text(coarse%entries(1)%imbalance))
  end subroutine test_budget

  !> All insulated, 7 W/m³ in the whole square: 7 W per metre depth, and 0.7 J after 0.1 s.
  subroutine test_source_budget(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation

    call run_scene(square(10, 0.2_wp)//'&boundary kind = ''insulated'' / &source power = 7 / '// &
                   '&material density = 3 / &time end = 0.1 /', simulation, error)
    if (allocated(error)) return
    associate (entry => simulation%entries(2))
      call check(error, entry%stored, 0.7_wp, thr=1.0e-9_wp)
      if (allocated(error)) return
      call check(error, entry%power(5), 7.0_wp, thr=1.0e-12_wp)
      if (allocated(error)) return
      call check(error, simulation%budget%account(5)%value, 'source')
      if (allocated(error)) return
      call check(error, abs(entry%imbalance) < 1.0e-9_wp)
    end associate
  end subroutine test_source_budget

  !> For every effect of the table: in a plain scene no call and no byte; in a scene with every
  !> effect some of both.
  subroutine test_absent(error)
    type(error_type), allocatable, intent(out) :: error
    type(effect_slot_t), allocatable :: table(:)
    type(simulation_t) :: plain, full
    integer(i8) :: calls, bytes
    integer :: k

    call known_effects(table)
    call run_scene(square(10, 0.0_wp)//'&boundary value = 1 / &time end = 0.01 /', plain, error)
    if (allocated(error)) return
    call run_scene(square(10, 0.0_wp)//'&source power = 1 / &initial temperature = 300 / '// &
                   '&boundary on = ''left'' kind = ''flux'' flux = 1 / '// &
                   '&boundary on = ''right'' kind = ''insulated'' / '// &
                   '&boundary on = ''top'' kind = ''convection'' coefficient = 1 ambient = 1 / '// &
                   '&boundary on = ''bottom'' kind = ''radiation'' emissivity = 1 '// &
                   'ambient = 1 / &time end = 0.01 / '// &
                   '&material latent_heat = 1 solidus = 299 liquidus = 301 /', full, error)
    if (allocated(error)) return
    call check(error, size(table) >= 6)
    if (allocated(error)) return
    do k = 1, size(table)
      call effect_usage(plain%conduction%effects, trim(table(k)%effect%name), calls, bytes)
      call check(error, calls == 0 .and. bytes == 0, trim(table(k)%effect%name)// &
                 ' in a plain scene')
      if (allocated(error)) return
      call effect_usage(full%conduction%effects, trim(table(k)%effect%name), calls, bytes)
      call check(error, calls > 0 .and. bytes > 0, trim(table(k)%effect%name)//' is not in force')
      if (allocated(error)) return
    end do
    call check(error, .not. (allocated(plain%conduction%effects) .or. &
                             allocated(plain%conduction%power) .or. &
                             allocated(plain%conduction%slope) .or. &
                             allocated(plain%conduction%temperature) .or. &
                             allocated(plain%conduction%potential) .or. &
                             allocated(plain%conduction%temperature_slope) .or. &
                             allocated(plain%conduction%potential_slope) .or. &
                             allocated(plain%conduction%content) .or. &
                             allocated(plain%conduction%jumps) .or. &
                             allocated(plain%conduction%held_jumps) .or. &
                             allocated(plain%conduction%local) .or. &
                             allocated(plain%conduction%medium%local_capacity) .or. &
                             allocated(plain%content)), 'arrays in a plain scene')
    if (allocated(error)) return
    call check(error, size(plain%effects_in_force()), 2)
    if (allocated(error)) return
    call check(error, size(full%effects_in_force()), 7)
    if (allocated(error)) return
    call run_scene(square(10, 0.0_wp)//'&boundary value = 1 / &time end = 0.01 / '// &
                   '&material conductivity_expression = ''1+T'' / &material '// &
                   'conductivity_xx_expression = ''(1+x)*(1+T)'' conductivity_yy_expression = '// &
                   '''2*(1+x)*(1+T)'' density_expression = ''1+y'' where_expression = '// &
                   '''x > 0.9'' heat_capacity_expression = ''1+T'' / ', &
                   full, error)
    if (allocated(error)) return
    call check_names(full%effects_in_force(), error)
  end subroutine test_absent

  !> What materials call for is told with the place that calls for it.
  subroutine check_names(texts, error)
    type(text_t), intent(in) :: texts(:)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: wanted(6) = [character(len=60) :: 'conductivity of the '// &
        'temperature (scene, line 1: &material conductivi', 'material in a region (scene, line', &
        'anisotropic conductivity (scene', 'conductivity of the place (scene, line 1', &
        'heat capacity of the place (scene', 'heat capacity of the temperature (scene']
    integer :: k, j

    do k = 1, size(wanted)
      call check(error, any([(index(texts(j)%value, trim(wanted(k))) == 1, j=1, size(texts))]), &
                 trim(wanted(k)))
      if (allocated(error)) return
    end do
    call check(error, size(texts), 9)
  end subroutine check_names

  subroutine test_kelvin(error)
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure

    call interpret_scene(square(10, 0.0_wp)//'&boundary kind = ''radiation'' emissivity = 1 '// &
                         'ambient = 1 / &initial temperature = -20 / &time end = 1 /', scene, &
                         failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    call check(error, allocated(failure), 'not refused')
    if (allocated(error)) return
    call check(error, index(failure%message, 'kelvin') > 0, failure%message)
  end subroutine test_kelvin

end module test_effects
