!> Tests of conductivity and heat capacity that depend on the temperature.
module test_heat_content
  use calor_error, only: error_t
  use calor_heat_budget, only: budget_entry_t
  use calor_heat_law, only: heat_law_t
  use calor_kinds, only: wp
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene
  use calor_simulation, only: simulation_t
  use calor_text, only: to_text
  use test_field_reader, only: reals_in_file
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_heat_content

  character(len=*), parameter :: schemes(2) = [character(len=40) :: &
      '&scheme laplacian = ''fatehi_manzari'' / ', '&scheme laplacian = ''consistent'' / ']
  real(wp), parameter :: jitters(2) = [0.0_wp, 0.2_wp]

contains

  subroutine collect_heat_content(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('tables against integrals', test_tables), &
                new_unittest('tables grow and end', test_growth), &
                new_unittest('a slab by Kirchhoff: exact', test_slab), &
                new_unittest('steady: order two and four', test_steady_order), &
                new_unittest('in time: order two and four', test_order_in_time), &
                new_unittest('walls that exchange heat', test_walls), &
                new_unittest('heat is accounted for', test_budget), &
                new_unittest('the budget in the file', test_file), &
                new_unittest('steps hold for the warmest', test_warming), &
                new_unittest('the Jacobian is the derivative', test_jacobian), &
                new_unittest('two materials', test_two_materials), &
                new_unittest('two laws, steady: exact', test_two_laws), &
                new_unittest('two laws: order one', test_two_laws_order), &
                new_unittest('two laws: heat passes', test_two_laws_budget), &
                new_unittest('the same law twice is one law', test_same_law), &
                new_unittest('no product: order two and four', test_no_product), &
                new_unittest('no product that is one', test_product_twice), &
                new_unittest('no product: heat', test_no_product_budget), &
                new_unittest('melting in a graded capacity', test_graded_melting), &
                new_unittest('a capacity that is graded by 0', test_even_melting), &
                new_unittest('each region melts by its own heat', test_regions_melt), &
                new_unittest('a region that melts: the front', test_region_front), &
                new_unittest('the error is estimated', test_estimate), &
                new_unittest('what cannot be', test_refusals) &
                ]
  end subroutine collect_heat_content

  subroutine prepare_scene(text, simulation, error)
    character(len=*), intent(in) :: text
    type(simulation_t), intent(out) :: simulation
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(error_t), allocatable :: failure

    call interpret_scene(text, scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    if (allocated(failure)) call test_failed(error, failure%message//new_line('a')//text)
  end subroutine prepare_scene

  subroutine run_scene(text, simulation, error)
    character(len=*), intent(in) :: text
    type(simulation_t), intent(out) :: simulation
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure

    call prepare_scene(text, simulation, error)
    if (allocated(error)) return
    call simulation%run(failure)
    if (allocated(failure)) call test_failed(error, failure%message//new_line('a')//text)
  end subroutine run_scene

  pure function rectangle(n, height, jitter) result(text)
    integer, intent(in) :: n
    real(wp), intent(in) :: height, jitter
    character(len=:), allocatable :: text

    text = '&domain x_range = 0, 1 y_range = 0, '//to_text(height)//' spacing = '// &
           to_text(1.0_wp/n)//' arrangement = ''jittered'' jitter = '//to_text(jitter)//' / '
  end function rectangle

  !> f = exp(T/4), g = (1 + T)²: s = ((1 + T)³ - 8)/12 + 1, θ = (exp((T - 1)/4) - 1) 4 + 1 about T₀
  !> = 1
  subroutine test_tables(error)
    type(error_type), allocatable, intent(out) :: error
    type(heat_law_t) :: law
    real(wp) :: warm, s, theta, found(2), slope(2), across
    integer :: k

    call make_law(law)
    do k = 0, 1000
      warm = 3.0_wp*k/1000
      s = ((1 + warm)**3 - 8)/12 + 1
      theta = 4*(exp((warm - 1)/4) - 1) + 1
      call law%evaluate(s, found(1), found(2))
      call check(error, all(abs(found - [warm, theta]) < 1.0e-11_wp), 'T = '//to_text(warm)// &
                 ': '//to_text(found(1) - warm)//' '//to_text(found(2) - theta))
      if (allocated(error)) return
      call check(error, law%content(warm), s, thr=1.0e-11_wp)
      if (allocated(error)) return
      call check(error, law%potential(warm), theta, thr=1.0e-11_wp)
      if (allocated(error)) return
      ! To and fro without loss
      call law%evaluate(law%content(warm), found(1), found(2))
      call check(error, found(1), warm, thr=1.0e-14_wp)
      if (allocated(error)) return
      call law%slopes(s, slope(1), slope(2))
      across = 4/(1 + warm)**2
      call check(error, slope(1), across, thr=1.0e-6_wp*across)
      if (allocated(error)) return
      call check(error, slope(2), across*exp((warm - 1)/4), thr=1.0e-6_wp*across)
      if (allocated(error)) return
      call check(error, law%conductivity_factor(warm), exp((warm - 1)/4), thr=1.0e-6_wp)
      if (allocated(error)) return
    end do
    ! Largest at T = 0: 4, and 4 exp(-1/4)
    call law%largest_slopes(0.0_wp, 3.0_wp, slope(1), slope(2))
    call check(error, all(abs(slope - [4.0_wp, 4*exp(-0.25_wp)]) < 0.01_wp))
  end subroutine test_tables

  subroutine make_law(law)
    type(heat_law_t), intent(out) :: law

    law%stores = .true.
    law%conducts = .true.
    law%reference = 1
    law%conductivity%value = '3*exp(T/4)'
    law%density%value = '2*(1+T)'
    law%heat_capacity%value = '5*(1+T)'
    call law%prepare(0.0_wp, 3.0_wp)
  end subroutine make_law

  !> Beyond what was expected the tables go on, down to where the capacity is 0: there they end.
  subroutine test_growth(error)
    type(error_type), allocatable, intent(out) :: error
    type(heat_law_t) :: law
    real(wp) :: s, found(2), before(2)

    call make_law(law)
    call law%evaluate(1.7_wp, before(1), before(2))
    s = ((1 + 6.0_wp)**3 - 8)/12 + 1
    call law%reach(1.0_wp, s)
    call law%evaluate(s, found(1), found(2))
    call check(error, all(abs(found - [6.0_wp, 4*(exp(1.25_wp) - 1) + 1]) < 1.0e-10_wp), &
               to_text(found(1))//' '//to_text(found(2)))
    if (allocated(error)) return
    call law%evaluate(1.7_wp, found(1), found(2))
    call check(error, all(abs(found - before) <= 4*epsilon(s)))
    if (allocated(error)) return
    call law%reach(-1.0e3_wp, 1.0_wp)
    call law%evaluate(-1.0e3_wp, found(1), found(2))
    call check(error, found(1) < 0 .and. found(2) < 0)
    if (allocated(error)) return
    call check(error, law%content(found(1)), -1.0e3_wp, thr=1.0e-6_wp)
  end subroutine test_growth

  !> κ = 1 + T: (1 + T)² is linear, and so is θ: exact but for the tables.
  subroutine test_slab(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    integer :: j, i

    do j = 1, 2
      do i = 1, 2
        call run_scene(rectangle(10, 0.5_wp, jitters(j))//schemes(i)//'&scene exact_expression '// &
                       '= ''sqrt(1+15*x)-1'' / &material conductivity_expression = ''1+T'' '// &
                       'density_expression = ''2+T'' / &boundary kind = ''insulated'' / '// &
                       '&boundary on = ''left'' value = 0 / &boundary on = ''right'' value = '// &
                       '3 / &time steady = .true. tolerance = 1e-12 /', simulation, error)
        if (allocated(error)) return
        call check(error, simulation%relative_l2_error() < 1.0e-11_wp, &
                   to_text(simulation%relative_l2_error()))
        if (allocated(error)) return
        call check(error, simulation%newton_steps < 9, to_text(simulation%newton_steps))
        if (allocated(error)) return
        ! The flux is that of the potential: 7.5 over half a metre
        associate (entry => simulation%entries(1))
          call check(error, abs(entry%imbalance) < 1.0e-9_wp .and. &
                     abs(maxval(entry%power) - 3.75_wp) < 0.5_wp, to_text(maxval(entry%power)))
        end associate
        if (allocated(error)) return
      end do
    end do
  end subroutine test_slab

  !> The order of convergence on a lattice and on an irregular cloud
  subroutine check_orders(text, lowest, error)
    character(len=*), intent(in) :: text
    real(wp), intent(in) :: lowest
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: coarse, fine
    real(wp) :: order
    integer :: j

    do j = 1, 2
      call run_scene(text//rectangle(16, 1.0_wp, jitters(j)), coarse, error)
      if (allocated(error)) return
      call run_scene(text//rectangle(32, 1.0_wp, jitters(j)), fine, error)
      if (allocated(error)) return
      order = log(coarse%relative_l2_error()/fine%relative_l2_error())/log(2.0_wp)
      call check(error, order >= lowest, 'jitter '//to_text(jitters(j))//': order '// &
                 to_text(order, digits=3)//', errors '// &
                 to_text(coarse%relative_l2_error(), digits=3)//', '// &
                 to_text(fine%relative_l2_error(), digits=3)//new_line('a')//text)
      if (allocated(error)) return
    end do
  end subroutine check_orders

  !> (1 + T)² = 4 + 2 exp(x) cos(y), which is harmonic; through the top q = κ ∂T/∂y = -exp(x) sin(y)
  subroutine test_steady_order(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: text = '&scene exact_expression = '// &
        '''sqrt(4+2*exp(x)*cos(y))-1'' / &material conductivity_expression = ''1+T'' / '// &
        '&initial temperature = 1.5 / &boundary value_expression = '// &
        '''sqrt(4+2*exp(x)*cos(y))-1'' / &boundary on = ''top'' kind = ''flux'' '// &
        'flux_expression = ''-exp(x)*sin(y)'' / '// &
        '&time steady = .true. tolerance = 1e-12 / '

    call check_orders(text//schemes(1), 1.7_wp, error)
    if (allocated(error)) return
    call check_orders(text//schemes(2), 3.5_wp, error)
  end subroutine test_steady_order

  !> T = 2 + sin(x + 0.3) cos(y + 0.2) exp(-t), κ = (1 + x y) (1 + T²/4), ρc = (2 + x) (1 + T/3)
  subroutine test_order_in_time(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: u = '(2+sin(x+0.3)*cos(y+0.2)*exp(-t))', &
        ux = '(cos(x+0.3)*cos(y+0.2)*exp(-t))', uy = '(-sin(x+0.3)*sin(y+0.2)*exp(-t))', &
        ut = '(2-'//u//')', f = '(1+'//u//'^2/4)'
    character(len=*), parameter :: text = '&scene exact_expression = '''//u//''' / &initial '// &
        'temperature_expression = ''2+sin(x+0.3)*cos(y+0.2)'' / &boundary value_expression = '''// &
        u//''' / &material conductivity_expression = ''(1+x*y)*(1+T^2/4)'' density_expression '// &
        '= ''2+x'' heat_capacity_expression = ''1+T/3'' / &source power_expression = ''(2+x)*'// &
        '(1+'//u//'/3)*'//ut//'-(1+x*y)*('//f//'*2*'//ut//'+'//u//'/2*('//ux//'^2+'//uy//'^2))-'// &
        f//'*(y*'//ux//'+x*'//uy//')'' / &boundary on = ''right'' kind = ''flux'' '// &
        'flux_expression = ''(1+x*y)*'//f//'*'//ux//''' / '

    call check_orders(text//schemes(1)//'&time end = 0.05 tolerance = 1e-8 / ', 1.7_wp, error)
    if (allocated(error)) return
    call check_orders(text//schemes(2)//'&time end = 0.05 tolerance = 1e-11 / ', 3.5_wp, error)
  end subroutine test_order_in_time

  !> A slab, κ = T/300 W/(m K), 600 K on the left, that convects or radiates on the right at 300 K:
  !> T² is linear.
  subroutine test_walls(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: sigma = 5.670374419e-8_wp
    type(simulation_t) :: simulation
    character(len=*), parameter :: square = '(360000-270000*x)'
    integer :: j

    ! T² falls from 600² to 300²: the flux is 270000/600 = 450 W/m²
    do j = 1, 2
      call run_scene(rectangle(8, 0.5_wp, jitters(j))//'&scene exact_expression = ''sqrt('// &
                     square//')'' / &material conductivity_expression = ''T/300'' / &initial '// &
                     'temperature = 400 / &boundary kind = ''insulated'' / &boundary on = '// &
                     '''left'' value = 600 / &boundary on = ''right'' kind = ''convection'' '// &
                     'coefficient = 45 ambient = 290 / &time steady = .true. tolerance = 1e-12 /', &
                     simulation, error)
      if (allocated(error)) return
      call check(error, simulation%relative_l2_error() < 1.0e-10_wp, &
                 to_text(simulation%relative_l2_error()))
      if (allocated(error)) return
      call run_scene(rectangle(8, 0.5_wp, jitters(j))//'&scene exact_expression = ''sqrt('// &
                     '(360000-(360000-'//to_text(warm_side()**2)//')*x))'' / &material '// &
                     'conductivity_expression = ''T/300'' / &initial temperature = 400 / '// &
                     '&boundary kind = ''insulated'' / &boundary on = ''left'' value = 600 / '// &
                     '&boundary on = ''right'' kind = ''radiation'' emissivity = 0.9 ambient = '// &
                     '300 / &time steady = .true. tolerance = 1e-13 /', simulation, error)
      if (allocated(error)) return
      call check(error, simulation%relative_l2_error() < 1.0e-10_wp, &
                 to_text(simulation%relative_l2_error()))
      if (allocated(error)) return
    end do

  contains

    !> The temperature at which conduction, (600² - T²)/600, is what is radiated
    pure function warm_side() result(t)
      real(wp) :: t
      integer :: k

      t = 400
      do k = 1, 50
        t = t - ((360000 - t**2)/600 - 0.9_wp*sigma*(t**4 - 300.0_wp**4))/ &
            (-t/300 - 3.6_wp*sigma*t**3)
      end do
    end function warm_side

  end subroutine test_walls

  !> What the body stores, with the weights for which conduction in it neither makes nor loses heat
  subroutine find_entry(simulation, entry)
    type(simulation_t), intent(inout) :: simulation
    type(budget_entry_t), intent(out) :: entry

    if (.not. simulation%budget%conservative) then
      call simulation%budget%close_exactly(simulation%conduction)
    end if
    call simulation%budget%evaluate(simulation%conduction, simulation%time, simulation%content, &
                                    entry)
  end subroutine find_entry

  !> All insulated: a source of 12 W/m³ in a half raises ∫ρc dT by what it brings, by any method.
  subroutine test_budget(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: methods(3) = [character(len=24) :: &
        'method=''forward_euler''', 'method=''runge_kutta_4''', 'method=''rkl2''']
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    type(budget_entry_t) :: before, after
    integer :: k

    do k = 1, size(methods)
      call prepare_scene(rectangle(12, 1.0_wp, 0.2_wp)//'&boundary kind = ''insulated'' / '// &
                         '&source power = 12 where_expression = ''x < 0.5'' / &material '// &
                         'conductivity_expression = ''(1+x)*exp(T/9)'' '// &
                         'heat_capacity_expression = ''1+T^2'' latent_heat = 0.3 solidus = 0.4 '// &
                         'liquidus = 0.6 / &time end = 0.3 '//methods(k)//' / ', simulation, error)
      if (allocated(error)) return
      call find_entry(simulation, before)
      call check(error, abs(before%imbalance) < 1.0e-11_wp, to_text(before%imbalance))
      if (allocated(error)) return
      call simulation%run(failure)
      call check(error, .not. allocated(failure))
      if (allocated(error)) return
      call find_entry(simulation, after)
      call check(error, after%stored - before%stored, 0.3_wp*before%power(5), &
                 thr=1.0e-11_wp*before%power(5), more=to_text(after%stored - before%stored))
      if (allocated(error)) return
      call check(error, maxval(simulation%temperature) > 0.7_wp, &
                 to_text(maxval(simulation%temperature)))
      if (allocated(error)) return
    end do
  end subroutine test_budget

  !> The budget of each state written stands in the file.
  subroutine test_file(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: path = 'build/test/heat_content.vtkhdf'
    type(simulation_t) :: simulation
    integer :: k

    call run_scene(rectangle(10, 1.0_wp, 0.2_wp)//'&material heat_capacity_expression = '// &
                   '''1+T'' / &boundary kind = ''insulated'' / &boundary on = ''left'' '// &
                   'value = 2 / &source power = 3 / &time end = 0.1 / &output every = 0.05 '// &
                   'file = '''//path//''' /', simulation, error)
    if (allocated(error)) return
    associate (entries => simulation%entries)
      call check(error, size(entries), 3)
      if (allocated(error)) return
      call check_series('budget_time', entries%time, error)
      if (allocated(error)) return
      call check_series('budget_stored', entries%stored, error)
      if (allocated(error)) return
      call check_series('budget_stored_rate', entries%stored_rate, error)
      if (allocated(error)) return
      call check_series('budget_imbalance', entries%imbalance, error)
      if (allocated(error)) return
      do k = 1, size(simulation%budget%account)
        call check_series('budget_'//simulation%budget%account(k)%value, &
                          [entries(1)%power(k), entries(2)%power(k), entries(3)%power(k)], error)
        if (allocated(error)) return
      end do
    end associate

  contains

    subroutine check_series(name, expected, error)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: expected(:)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: written(:)

      written = reals_in_file(path, 'calor/'//name)
      call check(error, size(written), size(expected), name)
      if (allocated(error)) return
      call check(error, all(abs(written - expected) <= 0), name)
    end subroutine check_series

  end subroutine test_file

  !> A cold body between hot walls, or heated by what grows: conduction, radiation or a reaction
  !> become much faster than they are at the start, and no step is too long.
  subroutine test_warming(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: methods(3) = [character(len=24) :: &
        'method=''forward_euler''', 'method=''runge_kutta_4''', 'method=''rkl2''']
    type(simulation_t) :: simulation
    integer :: k

    do k = 1, size(methods)
      call run_scene(rectangle(10, 1.0_wp, 0.2_wp)//'&material conductivity_expression = '// &
                     '''0.01+T^2'' / &boundary value_expression = ''min(20*t, 1)'' / &time end '// &
                     '= 0.5 '//methods(k)//' / ', simulation, error)
      if (allocated(error)) return
      call check(error, minval(simulation%temperature) > 0.2_wp .and. &
                 maxval(simulation%temperature) < 1.001_wp, to_text(minval(simulation%temperature)))
      if (allocated(error)) return
      ! A thin sheet in a furnace: the slope at its end is some 1000 times that at the start.
      call run_scene('&domain x_range = 0, 0.01 y_range = 0, 0.01 spacing = 0.001 / &material '// &
                     'conductivity = 1e-4 density = 10 / &initial temperature = 100 / '// &
                     '&boundary kind = ''radiation'' emissivity = 1 ambient = 3000 / &time end '// &
                     '= 0.02 '//methods(k)//' / ', simulation, error)
      if (allocated(error)) return
      call check(error, maxval(simulation%temperature) < 3000.1_wp .and. &
                 maxval(simulation%temperature) > 2000, to_text(maxval(simulation%temperature)))
      if (allocated(error)) return
    end do
  end subroutine test_warming

  subroutine test_jacobian(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    real(wp), allocatable :: v(:), product(:), plus(:), minus(:), bound(:)
    real(wp), parameter :: step = 1.0e-6_wp

    call prepare_scene(rectangle(8, 1.0_wp, 0.2_wp)//'&material conductivity_expression = '// &
                       '''1+T^2'' density_expression = ''2+T'' latent_heat = 0.5 solidus = 0.3 '// &
                       'liquidus = 0.7 / &initial temperature_expression = ''x*y'' / &boundary '// &
                       'kind = ''convection'' coefficient_expression = ''1+T'' ambient = 1 / '// &
                       '&boundary on = ''left'' value = 0 / &source power_expression = '// &
                       '''sin(3*T)'' / &time end = 1 / ', simulation, error)
    if (allocated(error)) return
    associate (conduction => simulation%conduction, u => simulation%content)
      v = sin(7*simulation%cloud%x + 5*simulation%cloud%y)
      call conduction%clear_prescribed(v)
      allocate (product, plus, minus, bound, mold=v)
      call conduction%jacobian_product(v, bound)
      call conduction%rate(0.0_wp, u + step*v, plus)
      call conduction%rate(0.0_wp, u - step*v, minus)
      call conduction%linearise(0.0_wp, u)
      call conduction%jacobian_product(v, product)
      plus = (plus - minus)/(2*step)
      ! Where a kink of T(v) lies within the difference, there is no derivative.
      call check(error, count(abs(plus - product) > 1.0e-4_wp*maxval(abs(product))) <= 8, &
                 to_text(maxval(abs(plus - product))))
      if (allocated(error)) return
      call check(error, norm2(bound) > 1.1_wp*norm2(product), 'not on the safe side')
    end associate
    if (allocated(error)) return
    call check_jacobian('&material conductivity_expression = ''1+T'' heat_capacity_expression '// &
                        '= ''1+T'' / &material conductivity_expression = ''20*exp(-T)'' '// &
                        'where_expression = ''x-y/3 > 0.3'' / ', error)
    if (allocated(error)) return
    call check_jacobian('&material conductivity_expression = ''1+x*T^2'' '// &
                        'heat_capacity_expression = ''1+T'' / ', error)
  end subroutine test_jacobian

  !> Products and rows of the Jacobian against differences of rates, in time and steady
  subroutine check_jacobian(material, error)
    character(len=*), intent(in) :: material
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    real(wp), allocatable :: u(:), v(:), product(:), plus(:), minus(:), value(:)
    integer, allocatable :: first(:), index(:)
    real(wp), parameter :: step = 1.0e-6_wp
    logical :: known
    integer :: k, n

    call prepare_scene(rectangle(8, 1.0_wp, &
                                 0.2_wp)//material//'&initial temperature_expression = '// &
                       '''x*y'' / &boundary kind = ''convection'' coefficient = 2 ambient = 1 '// &
                       '/ &boundary on = ''left'' value = 0 / &time end = 1 / ', simulation, error)
    if (allocated(error)) return
    associate (conduction => simulation%conduction)
      v = sin(7*simulation%cloud%x + 5*simulation%cloud%y)
      call conduction%clear_prescribed(v)
      allocate (product, plus, minus, mold=v)
      do n = 1, 2
        conduction%content%steady = n == 2
        u = simulation%content
        if (n == 2) u = simulation%temperature
        call conduction%rate(0.0_wp, u + step*v, plus)
        call conduction%rate(0.0_wp, u - step*v, minus)
        plus = (plus - minus)/(2*step)
        call conduction%linearise(0.0_wp, u)
        call conduction%jacobian_product(v, product)
        ! What the change of f_B/f_A contributes to a small term is left out.
        call check(error, maxval(abs(plus - product)) < 2.0e-3_wp*maxval(abs(product)), &
                   to_text(maxval(abs(plus - product))/maxval(abs(product)), digits=3)//material)
        if (allocated(error)) return
        call conduction%jacobian_rows(first, index, value, known)
        do k = 1, size(v)
          plus(k) = sum(value(first(k):first(k + 1) - 1)*v(index(first(k):first(k + 1) - 1)))
        end do
        call check(error, maxval(abs(plus - product)) < 1.0e-11_wp*maxval(abs(product)), &
                   'rows: '//to_text(maxval(abs(plus - product))/maxval(abs(product)), digits=3))
        if (allocated(error)) return
      end do
    end associate
  end subroutine check_jacobian

  !> κ = 1 + T and 10 (1 + T): in terms of (1 + T)² the slabs of test_materials
  subroutine test_two_materials(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    integer :: j

    do j = 1, 2
      call run_scene(rectangle(20, 0.5_wp, jitters(j))//'&scene exact_expression = '// &
                     '''sqrt(1+15*(x < 0.5 ? 20*x/11 : 1-2*(1-x)/11))-1'' / &material '// &
                     'conductivity_expression = ''1+T'' / &material conductivity_expression = '// &
                     '''10*(1+T)'' density = 3 where_expression = ''x > 0.5'' / &boundary kind '// &
                     '= ''insulated'' / &boundary on = ''left'' value = 0 / &boundary on = '// &
                     '''right'' value = 3 / &time steady = .true. tolerance = 1e-12 /', &
                     simulation, error)
      if (allocated(error)) return
      call check(error, simulation%relative_l2_error() < 1.0e-10_wp, &
                 to_text(simulation%relative_l2_error()))
      if (allocated(error)) return
    end do
  end subroutine test_two_materials

  !> Two slabs, κ = 1 + T and a (1 + T/5): both potentials are linear, so exact but for the tables.
  subroutine test_two_laws(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    real(wp), parameter :: ratios(2) = [1.0_wp, 1000.0_wp]
    real(wp) :: flux
    integer :: j, i, k

    do j = 1, 2
      do i = 1, 2
        do k = 1, 2
          flux = flux_of(ratios(k))
          call run_scene(rectangle(12, 0.5_wp, jitters(j))//schemes(i)//'&scene '// &
                         'exact_expression = ''x < 0.5 ? sqrt(1+'//to_text(2*flux)//'*x)-1 : '// &
                         '5*(sqrt(2.56-0.4*'//to_text(flux/ratios(k))//'*(1-x))-1)'' / '// &
                         '&material conductivity_expression = ''1+T'' / &material '// &
                         'conductivity_expression = '''//to_text(ratios(k))//'*(1+T/5)'' '// &
                         'density = 3 where_expression = ''x > 0.5'' / &boundary kind = '// &
                         '''insulated'' / &boundary on = ''left'' value = 0 / &boundary on = '// &
                         '''right'' value = 3 / &time steady = .true. tolerance = 1e-12 / ', &
                         simulation, error)
          if (allocated(error)) return
          call check(error, simulation%relative_l2_error() < 1.0e-11_wp, &
                     to_text(simulation%relative_l2_error()))
          if (allocated(error)) return
          call check(error, simulation%newton_steps < 9, to_text(simulation%newton_steps))
          if (allocated(error)) return
          call check(error, abs(simulation%entries(1)%imbalance) < 1.0e-9_wp, &
                     to_text(simulation%entries(1)%imbalance))
          if (allocated(error)) return
        end do
      end do
    end do

  contains

    !> Half a metre of each lets the same flux pass: by bisection
    pure function flux_of(ratio) result(flux)
      real(wp), intent(in) :: ratio
      real(wp) :: flux
      real(wp) :: low, high, contact
      integer :: n

      low = 0
      high = 3
      do n = 1, 100
        contact = 0.5_wp*(low + high)
        flux = 2*(contact + contact**2/2)
        if (flux < 2*ratio*(3 - contact + (9 - contact**2)/10)) then
          low = contact
        else
          high = contact
        end if
      end do
    end function flux_of

  end subroutine test_two_laws

  !> T = 1 + y along the interface x = 0.5 and the flux -2 across it: in each slab P = ∫κ dT is its
  !> value there plus 2 (x - 0.5), and div(κ∇T) = ∂κ/∂T.
  subroutine test_two_laws_order(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: exact = '''x < 0.5 ? sqrt(1+2*(1+y+(1+y)^2/2+2*x-1))-1 : '// &
        '5*(sqrt(1+0.4*(1+y+(1+y)^2/10+2*x-1))-1)'''
    character(len=*), parameter :: text = '&scene exact_expression = '//exact//' / &boundary '// &
        'value_expression = '//exact//' / &material conductivity_expression = ''1+T'' / '// &
        '&material conductivity_expression = ''1+T/5'' density = 3 where_expression = ''x >= '// &
        '0.5'' / &source power_expression = ''x < 0.5 ? -1 : -0.2'' / &time steady = .true. '// &
        'tolerance = 1e-12 / '
    integer, parameter :: n(2) = [20, 80], clouds = 3
    type(simulation_t) :: simulation
    real(wp) :: square(2), order
    integer :: j, i, k, seed

    do j = 1, 2
      do i = 1, 2
        square = 0
        do k = 1, 2
          do seed = 1, merge(1, clouds, j == 1)
            call run_scene(text//schemes(i)//'&domain x_range = 0, 1 y_range = 0, 1 spacing = '// &
                           to_text(1.0_wp/n(k))//' arrangement = ''jittered'' jitter = '// &
                           to_text(jitters(j))//' seed = '//to_text(seed)//' / ', simulation, error)
            if (allocated(error)) return
            square(k) = square(k) + simulation%relative_l2_error()**2/merge(1, clouds, j == 1)
            call check(error, abs(simulation%entries(1)%imbalance) < 0.05_wp/n(k), &
                       'imbalance '//to_text(simulation%entries(1)%imbalance, digits=3))
            if (allocated(error)) return
          end do
        end do
        order = 0.5_wp*log(square(1)/square(2))/log(4.0_wp)
        call check(error, order >= 0.95_wp, 'order '//to_text(order, digits=3)//', error '// &
                   to_text(sqrt(square(2)), digits=3))
        if (allocated(error)) return
      end do
    end do
  end subroutine test_two_laws_order

  !> Heat goes from one insulated half to another, 1:1000, through an oblique interface: what is
  !> lost is a small part of it, and less on a finer cloud.
  subroutine test_two_laws_budget(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    type(budget_entry_t) :: before, after
    real(wp) :: lost(2)
    integer :: j, k

    do j = 1, 2
      do k = 1, 2
        call prepare_scene(rectangle(10*2**k, 0.5_wp, jitters(j))//'&material '// &
                           'conductivity_expression = ''1+T'' heat_capacity_expression = '// &
                           '''1+T'' / &material conductivity_expression = ''1000*exp(-T/3)'' '// &
                           'density = 3 where_expression = ''x > 0.41'' / &boundary kind = '// &
                           '''insulated'' / &initial temperature_expression = ''x > 0.41 ? '// &
                           '1 : 0'' / &time end = 0.05 method = ''rkl2'' tolerance = 1e-5 / ', &
                           simulation, error)
        if (allocated(error)) return
        call find_entry(simulation, before)
        call simulation%run(failure)
        call check(error, .not. allocated(failure))
        if (allocated(error)) return
        call find_entry(simulation, after)
        lost(k) = abs(after%stored - before%stored)/(before%stored)
        call check(error, minval(simulation%temperature) > 0.1_wp .and. &
                   maxval(simulation%temperature) < 1.001_wp)
        if (allocated(error)) return
      end do
      call check(error, all(lost < 3.0e-5_wp) .and. lost(2) < lost(1), &
                 to_text(lost(1), digits=3)//' '//to_text(lost(2), digits=3))
      if (allocated(error)) return
    end do
  end subroutine test_two_laws_budget

  !> Materials with the same factor have no jump of potentials.
  subroutine test_same_law(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation

    call prepare_scene(rectangle(8, 1.0_wp, 0.2_wp)//'&material conductivity_expression = '// &
                       '''1+T'' / &material conductivity_expression = ''30+30*T'' '// &
                       'where_expression = ''x > 0.5'' / &boundary value = 1 / &time end = 1 /', &
                       simulation, error)
    if (allocated(error)) return
    call check(error, .not. (allocated(simulation%conduction%jumps) .or. &
                             allocated(simulation%conduction%held_jumps)))
    if (allocated(error)) return
    call prepare_scene(rectangle(8, 1.0_wp, 0.2_wp)//'&material conductivity_expression = '// &
                       '''1+T'' / &material conductivity_expression = ''30+31*T'' '// &
                       'where_expression = ''x > 0.5'' / &boundary value = 1 / &time end = 1 /', &
                       simulation, error)
    if (allocated(error)) return
    call check(error, allocated(simulation%conduction%jumps) .and. &
               allocated(simulation%conduction%held_jumps))
  end subroutine test_same_law

  !> T = 2 + sin(x + 0.3) cos(y + 0.2) exp(-t), κ = 1 + x T²/4, ρc = (2 + x) exp(T/5); steady as
  !> well
  subroutine test_no_product(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: u = '(2+sin(x+0.3)*cos(y+0.2)*exp(-t))', &
        ux = '(cos(x+0.3)*cos(y+0.2)*exp(-t))', uy = '(-sin(x+0.3)*sin(y+0.2)*exp(-t))', &
        ut = '(2-'//u//')', flow = '((1+x*'//u//'^2/4)*2*'//ut//'+'//u//'^2/4*'//ux//'+x*'//u// &
        '/2*('//ux//'^2+'//uy//'^2))'
    character(len=*), parameter :: text = '&scene exact_expression = '''//u//''' / &initial '// &
        'temperature_expression = ''2+sin(x+0.3)*cos(y+0.2)'' / &boundary value_expression = '''// &
        u//''' / &material conductivity_expression = ''1+x*T^2/4'' density_expression = '// &
        '''2+x'' heat_capacity_expression = ''exp(T/5)'' / &boundary on = ''right'' kind = '// &
        '''flux'' flux_expression = ''(1+x*'//u//'^2/4)*'//ux//''' / '
    character(len=*), parameter :: steady = '&source power_expression = ''-'//flow//''' / '// &
        '&time steady = .true. tolerance = 1e-12 / '
    character(len=*), parameter :: in_time = '&source power_expression = ''(2+x)*exp('//u// &
        '/5)*'//ut//'-'//flow//''' / &time end = 0.03 tolerance = 1e-9 / '

    call check_orders(text//schemes(1)//steady, 1.7_wp, error)
    if (allocated(error)) return
    call check_orders(text//schemes(2)//steady, 3.5_wp, error)
    if (allocated(error)) return
    call check_orders(text//schemes(1)//in_time, 1.7_wp, error)
    if (allocated(error)) return
    call check_orders(text//schemes(2)//in_time, 3.5_wp, error)
  end subroutine test_no_product

  !> (1 + x) (1 + T) is a product to rounding only if written as one; both ways lead to solutions
  !> that differ by less than their errors.
  subroutine test_product_twice(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: product, other
    character(len=*), &
        parameter :: rest = '&boundary value_expression = ''x+y'' / &time steady = '// &
        '.true. tolerance = 1e-12 / '

    call run_scene(rectangle(20, 1.0_wp, 0.2_wp)//rest//'&material conductivity_expression = '// &
                   '''(1+x)*(1+T)'' / ', product, error)
    if (allocated(error)) return
    call run_scene(rectangle(20, 1.0_wp, 0.2_wp)//rest//'&material conductivity_expression = '// &
                   '''(1+x)*(1+T)+1e-8*x*T'' / ', other, error)
    if (allocated(error)) return
    call check(error, allocated(other%conduction%local) .and. .not. &
               allocated(product%conduction%local))
    if (allocated(error)) return
    call check(error, maxval(abs(product%temperature - other%temperature)) < 2.0e-3_wp .and. &
               maxval(abs(product%temperature - product%cloud%x - product%cloud%y)) > 0.01_wp, &
               to_text(maxval(abs(product%temperature - other%temperature))))
  end subroutine test_product_twice

  !> Heat is conserved to the order of the scheme.
  subroutine test_no_product_budget(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    real(wp) :: missing(2)
    integer :: j, k

    do j = 1, 2
      do k = 1, 2
        call run_scene(rectangle(10*2**k, 0.5_wp, jitters(j))//'&material '// &
                       'conductivity_expression = ''1+x*T'' / &boundary kind = '// &
                       '''insulated'' / &boundary on = ''left'' value = 1 / &boundary on = '// &
                       '''right'' value = 3 / &time steady = .true. tolerance = 1e-13 / ', &
                       simulation, error)
        if (allocated(error)) return
        missing(k) = abs(simulation%entries(1)%imbalance)
      end do
      call check(error, missing(2) < 1.0e-5_wp .and. missing(2) < missing(1), &
                 to_text(missing(1), digits=3)//' '//to_text(missing(2), digits=3))
      if (allocated(error)) return
    end do
  end subroutine test_no_product_budget

  !> Latent heat ρL J/m³ whatever the heat capacity is where: what is put in is stored to rounding,
  !> and in the end ∫ρ(c ΔT + L) has been.
  subroutine test_graded_melting(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    type(budget_entry_t) :: before, after
    real(wp), allocatable :: fraction(:), heat(:)

    call prepare_scene(rectangle(12, 1.0_wp, 0.2_wp)//'&boundary kind = ''insulated'' / '// &
                       '&source power = 12 where_expression = ''x < 0.5'' / &material '// &
                       'conductivity = 2 density_expression = ''1+y'' heat_capacity_expression '// &
                       '= ''1+x*y+x'' latent_heat = 1.5 solidus = 0.4 liquidus = 0.6 / &time '// &
                       'end = 0.3 tolerance = 1e-5 / ', simulation, error)
    if (allocated(error)) return
    call find_entry(simulation, before)
    call check(error, abs(before%imbalance) < 1.0e-11_wp, to_text(before%imbalance))
    if (allocated(error)) return
    call simulation%run(failure)
    call check(error, .not. allocated(failure))
    if (allocated(error)) return
    call find_entry(simulation, after)
    call check(error, after%stored - before%stored, 0.3_wp*before%power(5), &
               thr=1.0e-11_wp*before%power(5), more=to_text(after%stored - before%stored))
    if (allocated(error)) return
    fraction = simulation%liquid_fraction()
    call check(error, any(fraction > 0.99_wp) .and. any(fraction < 0.01_wp) .and. &
               count(fraction > 0.05_wp .and. fraction < 0.95_wp) > 5)
    if (allocated(error)) return
    ! By temperatures and fractions: the state is nothing else
    associate (x => simulation%cloud%x, y => simulation%cloud%y)
      heat = (1 + y)*((1 + x*y + x)*simulation%temperature + 1.5_wp*fraction)
      call check(error, all(abs((1 + y)*(1 + x*y + x)*simulation%content - heat) < 1.0e-12_wp*heat))
      if (allocated(error)) return
      call check(error, all(abs(fraction - min(1.0_wp, max(0.0_wp, &
                                                           (simulation%temperature - 0.4_wp)/ &
                                                           0.2_wp))) < 1.0e-12_wp))
    end associate
  end subroutine test_graded_melting

  !> An expression that is a constant is that constant.
  subroutine test_even_melting(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: number, expression
    character(len=*), parameter :: rest = '&boundary kind = ''insulated'' / &boundary on = '// &
        '''left'' value = 2 / &time end = 0.05 tolerance = 1e-4 / '

    call run_scene(rectangle(12, 0.5_wp, &
                             0.2_wp)//rest//'&material heat_capacity = 2 latent_heat '// &
                   '= 1.5 solidus = 0.5 liquidus = 0.5 density_expression = ''1+0*x'' / ', number, &
                   error)
    if (allocated(error)) return
    call run_scene(rectangle(12, 0.5_wp, 0.2_wp)//rest//'&material heat_capacity_expression = '// &
                   '''2+0*x'' latent_heat = 1.5 solidus = 0.5 liquidus = 0.5 / ', expression, error)
    if (allocated(error)) return
    call check(error, allocated(expression%conduction%content%rise) .and. .not. &
               allocated(number%conduction%content%rise))
    if (allocated(error)) return
    call check(error, maxval(abs(number%content - expression%content)) < 1.0e-12_wp, &
               to_text(maxval(abs(number%content - expression%content))))
  end subroutine test_even_melting

  !> Three parts, two of which melt, heated all over: whatever melts, heat is accounted for, and in
  !> the end each part has taken its own latent heat.
  subroutine test_regions_melt(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    type(budget_entry_t) :: before, after
    real(wp), allocatable :: fraction(:)

    call prepare_scene(rectangle(15, 0.6_wp, &
                                 0.2_wp)//'&boundary kind = ''insulated'' / &source '// &
                       'power = 4 / &initial temperature = -0.5 / &material conductivity = 9 / '// &
                       '&material conductivity = 5 density = 2 heat_capacity = 0.5 latent_heat '// &
                       '= 1 solidus = 0 liquidus = 0.2 where_expression = ''x > 0.35'' / '// &
                       '&material conductivity_expression = ''2'' heat_capacity_expression = '// &
                       '''1+T^2'' latent_heat = 3 solidus = 0.6 liquidus = 0.6 '// &
                       'where_expression = ''x > 0.7'' / &time end = 0.7 tolerance = 1e-5 / ', &
                           simulation, error)
    if (allocated(error)) return
    call find_entry(simulation, before)
    call check(error, abs(before%imbalance) < 1.0e-10_wp, to_text(before%imbalance))
    if (allocated(error)) return
    call simulation%run(failure)
    call check(error, .not. allocated(failure))
    if (allocated(error)) return
    call find_entry(simulation, after)
    call check(error, after%stored - before%stored, 0.7_wp*before%power(5), &
               thr=1.0e-10_wp*before%power(5))
    if (allocated(error)) return
    fraction = simulation%liquid_fraction()
    associate (x => simulation%cloud%x)
      call check(error, all(fraction <= 0 .or. x > 0.35_wp) .and. &
                 all(fraction > 0.99_wp .or. x < 0.35_wp .or. x > 0.7_wp) .and. &
                 any(fraction > 0.05_wp .and. fraction < 0.95_wp .and. x > 0.7_wp))
    end associate
  end subroutine test_regions_melt

  !> The one-phase Stefan problem in the half x > 0.5, at the temperature 1 of a conductor that is
  !> next to perfect: λ = 0.620063 for a Stefan number of 1.
  subroutine test_region_front(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    real(wp) :: front, exact
    integer :: j

    do j = 1, 2
      call run_scene('&domain x_range = 0.3, 1 y_range = 0, 0.2 spacing = 0.02 arrangement = '// &
                     '''jittered'' jitter = '//to_text(jitters(j))//' / &material conductivity '// &
                     '= 1000 / &material latent_heat = 1 solidus = 0 liquidus = 0 '// &
                     'where_expression = ''x > 0.5'' / &initial temperature_expression = ''x > '// &
                     '0.5 ? 0 : 1'' / &boundary kind = ''insulated'' / &boundary on = ''left'' '// &
                     'value = 1 / &time end = 0.06 tolerance = 1e-4 / ', simulation, error)
      if (allocated(error)) return
      exact = 2*0.6200626333_wp*sqrt(0.06_wp)
      front = sum(simulation%cloud%area*simulation%liquid_fraction())/0.2_wp
      call check(error, front, exact, thr=0.02_wp)
      if (allocated(error)) return
    end do
  end subroutine test_region_front

  !> The estimate of the error is about the error.
  subroutine test_estimate(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    real(wp) :: ratio

    ! κ = ρc = 1 + T: T + T²/2 obeys the heat equation with constants.
    call run_scene(rectangle(16, 1.0_wp, 0.2_wp)//'&scene exact_expression = '// &
                   '''sqrt(1+8*sin(pi*x)*sin(pi*y)*exp(-2*pi^2*t))-1'' / &initial '// &
                   'temperature_expression = ''sqrt(1+8*sin(pi*x)*sin(pi*y))-1'' / &boundary '// &
                   'value = 0 / &material conductivity_expression = '// &
                   '''1+T'' heat_capacity_expression = ''1+T'' / &accuracy estimate = .true. / '// &
                   '&time end = 0.05 / ', simulation, error)
    if (allocated(error)) return
    ratio = simulation%estimated_error()/simulation%relative_l2_error()
    call check(error, ratio > 0.8_wp .and. ratio < 1.25_wp, to_text(ratio, digits=3))
    if (allocated(error)) return
    call run_scene(rectangle(16, 1.0_wp, 0.2_wp)//'&scene exact_expression = '// &
                   '''sqrt(4+2*exp(x)*cos(y))-1'' / &boundary value_expression = '// &
                   '''sqrt(4+2*exp(x)*cos(y))-1'' / &material conductivity_expression = '// &
                   '''1+T'' heat_capacity_expression = ''1+T^2'' / &accuracy estimate '// &
                   '= .true. / &time steady = .true. tolerance = 1e-12 / ', simulation, error)
    if (allocated(error)) return
    ratio = simulation%estimated_error()/simulation%relative_l2_error()
    call check(error, ratio > 0.8_wp .and. ratio < 1.25_wp, 'steady '//to_text(ratio, digits=3))
  end subroutine test_estimate

  subroutine test_refusals(error)
    type(error_type), allocatable, intent(out) :: error

    call refuse('&material conductivity_expression = ''3-T'' / ', &
                'conductivity_expression = ''3-T'': it must be greater than 0', error)
    if (allocated(error)) return
    call refuse('&material conductivity_expression = ''0.9-x*T/4'' / ', &
                'conductivity_expression = ''0.9-x*T/4'': it must be greater than 0', error)
    if (allocated(error)) return
    call refuse('&material conductivity_expression = ''1+x*T'' / &material conductivity = 2 '// &
                'where_expression = ''x > 0.4'' / ', 'where materials touch', error)
    if (allocated(error)) return
    call refuse('&material heat_capacity_expression = ''1+x*T'' / ', &
                'heat_capacity_expression = ''1+x*T'': how it depends on T', error)
    if (allocated(error)) return
    call refuse('&material conductivity_expression = ''1+T'' / &material conductivity_xx = 2 '// &
                'conductivity_yy = 3 where_expression = ''x > 0.4'' / ', &
                'by the same factor', error)
    if (allocated(error)) return
    call refuse('&material conductivity_xx_expression = ''1+T'' conductivity_yy = 1 / ', &
                'how it depends on T', error)
  end subroutine test_refusals

  subroutine refuse(text, message, error)
    character(len=*), intent(in) :: text, message
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure

    call interpret_scene(rectangle(8, 1.0_wp, 0.0_wp)//'&boundary value = 1 / &boundary on = '// &
                         '''left'' value = 4 / &time end = 1 / '//text, scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    call check(error, allocated(failure), 'not refused: '//text)
    if (allocated(error)) return
    call check(error, index(failure%message, message) > 0, failure%message)
  end subroutine refuse

end module test_heat_content
