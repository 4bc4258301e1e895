!> Tests of moving particles: orders in space and time, what must stay exactly as it is, lists with
!> a skin, walls, shifting, sources, and what is refused.
module test_motion
  use calor_cloud, only: cloud_t
  use calor_constants, only: pi
  use calor_conduction, only: conduction_t
  use calor_error, only: error_t, status_bad_input, status_bad_numbers
  use calor_kernel, only: kernel_t
  use calor_kernels, only: make_kernel
  use calor_kinds, only: wp, ip
  use calor_laplacian_scheme, only: laplacian_scheme_t
  use calor_laplacian_schemes, only: make_laplacian_scheme
  use calor_moving_walls, only: moving_walls_t
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_row_report, only: row_report_t
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene
  use calor_shifting, only: find_even_places, carry_field
  use calor_simulation, only: simulation_t
  use calor_skin_list, only: skin_list_t, find_neighbours
  use calor_sparse_operator, only: sparse_operator_t
  use calor_stable_rows, only: assemble_stable_rows, row_repairs_t, support_grown
  use calor_text, only: to_text
  use test_field_reader, only: reals_in_file
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_motion

  !> A rotation about the origin, and a vortex in the unit square with its walls for streamlines
  character(len=*), parameter :: rotation = &
      '&motion velocity_x_expression = ''-y'' velocity_y_expression = ''x'' / '
  character(len=*), parameter :: vortex = 'velocity_x_expression = ''sin(pi*x)*cos(pi*y)'' '// &
      'velocity_y_expression = ''-cos(pi*x)*sin(pi*y)'' '
  !> A field that is constant along the streamlines of the vortex, so that it only decays
  character(len=*), parameter :: decaying = '&scene exact_expression = '// &
      '''sin(pi*x)*sin(pi*y)*exp(-0.02*pi^2*t)'' / &initial temperature_expression = '// &
      '''sin(pi*x)*sin(pi*y)'' / &material conductivity = 0.01 / &boundary value = 0 / '

contains

  subroutine collect_motion(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('a Gaussian in rotation: order two and four', test_rotation_order), &
                new_unittest('a vortex: order two', test_vortex_order), &
                new_unittest('order two in the step of the motion', test_time_order), &
                new_unittest('a uniform field stays uniform', test_uniform), &
                new_unittest('a linear field rotates without loss', test_linear), &
                new_unittest('a body that rotates conducts as one at rest', test_rigid), &
                new_unittest('lists with a skin miss nobody', test_skin_list), &
                new_unittest('lists with a skin give the same rows', test_same_rows), &
                new_unittest('lists are built when needed only', test_builds), &
                new_unittest('heat is conserved to second order', test_conservation), &
                new_unittest('walls turn and stretch', test_walls), &
                new_unittest('sources and fluxes where the particles are', test_sources), &
                new_unittest('shifted fields are exact for polynomials', test_carried_field), &
                new_unittest('shifting keeps a vortex even', test_shifting), &
                new_unittest('a cloud torn by a vortex ends the run', test_torn), &
                new_unittest('all schemes move', test_schemes), &
                new_unittest('what cannot move is refused', test_refused), &
                new_unittest('motion that is absent costs nothing', test_absent), &
                new_unittest('places in the file', test_output) &
                ]
  end subroutine collect_motion

  subroutine run_scene(text, simulation, error)
    character(len=*), intent(in) :: text
    type(simulation_t), intent(out) :: simulation
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure

    call try_scene(text, simulation, failure)
    if (allocated(failure)) call test_failed(error, failure%message)
  end subroutine run_scene

  subroutine try_scene(text, simulation, failure)
    character(len=*), intent(in) :: text
    type(simulation_t), intent(out) :: simulation
    type(error_t), allocatable, intent(out) :: failure
    type(scene_t) :: scene

    call interpret_scene(text, scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    if (.not. allocated(failure)) call simulation%run(failure)
  end subroutine try_scene

  pure function square(n, jitter) result(text)
    integer, intent(in) :: n
    real(wp), intent(in) :: jitter
    character(len=:), allocatable :: text

    text = '&domain x_range = 0, 1 y_range = 0, 1 spacing = '//to_text(1.0_wp/n)// &
           ' arrangement = ''jittered'' jitter = '//to_text(jitter)//' / '
  end function square

  subroutine check_order(coarse, fine, lowest, what, error)
    type(simulation_t), intent(in) :: coarse, fine
    real(wp), intent(in) :: lowest
    character(len=*), intent(in) :: what
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: order

    order = log(coarse%relative_l2_error()/fine%relative_l2_error())/ &
            log(coarse%cloud%spacing/fine%cloud%spacing)
    call check(error, order >= lowest, what//': order '//to_text(order, digits=3)//', errors '// &
               to_text(coarse%relative_l2_error(), digits=3)//', '// &
               to_text(fine%relative_l2_error(), digits=3))
  end subroutine check_order

  !> Carried round by a quarter turn, and spread
  subroutine test_rotation_order(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: exact = '0.09/(0.09+0.02*t)*exp(-((x-0.3*cos(t))^2'// &
        '+(y-0.3*sin(t))^2)/(2*(0.09+0.02*t)))'
    character(len=*), parameter :: scene = '&scene exact_expression = '''//exact//''' / '// &
        '&material conductivity = 0.01 / &initial temperature_expression = '// &
        '''exp(-((x-0.3)^2+y^2)/0.18)'' / &boundary value_expression = '''//exact//''' / '// &
        rotation
    character(len=*), parameter :: scheme(2) = [character(len=40) :: &
        '&scheme laplacian = ''fatehi_manzari'' / ', '&scheme laplacian = ''consistent'' / ']
    character(len=*), parameter :: arrangement(2) = [character(len=9) :: 'lattice', 'relaxed']
    real(wp), parameter :: lowest(2) = [1.7_wp, 3.3_wp]
    type(simulation_t) :: coarse, fine
    integer :: k, j

    do k = 1, 2
      do j = 1, 2
        call run_scene(scene//scheme(k)//domain(0.1_wp)//'&time end = 1.5708 tolerance = 1e-9 /', &
                       coarse, error)
        if (allocated(error)) return
        call run_scene(scene//scheme(k)//domain(0.05_wp)// &
                       '&time end = 1.5708 tolerance = 1e-9 /', fine, error)
        if (allocated(error)) return
        call check_order(coarse, fine, lowest(k), trim(scheme(k))//arrangement(j), error)
        if (allocated(error)) return
        ! Distances do not change: rows and lists are those of the beginning.
        call check(error, fine%motion%assemblies == 0 .and. fine%motion%near%builds == 1)
        if (allocated(error)) return
      end do
    end do

  contains

    function domain(spacing) result(text)
      real(wp), intent(in) :: spacing
      character(len=:), allocatable :: text

      text = '&domain shape = ''disc'' radius = 0.8 spacing = '//to_text(spacing)// &
             ' arrangement = '''//trim(arrangement(j))//''' / '
    end function domain

  end subroutine test_rotation_order

  subroutine test_vortex_order(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: jitter(2) = [0.0_wp, 0.2_wp]
    type(simulation_t) :: coarse, fine
    integer :: k

    do k = 1, 2
      call run_scene(decaying//square(12, jitter(k))//'&motion '//vortex//'/ &time end = 0.2 /', &
                     coarse, error)
      if (allocated(error)) return
      call run_scene(decaying//square(24, jitter(k))//'&motion '//vortex//'/ &time end = 0.2 /', &
                     fine, error)
      if (allocated(error)) return
      call check_order(coarse, fine, 1.7_wp, 'jitter '//to_text(jitter(k)), error)
      if (allocated(error)) return
    end do
  end subroutine test_vortex_order

  !> The same cloud with steps of 1, 1/2 and 1/4: the differences fall with the square of the step.
  subroutine test_time_order(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: scene = '&material conductivity = 0.1 / &initial '// &
        'temperature_expression = ''cos(pi*x)'' / &boundary on = ''left'' value_expression = '// &
        '''1+y*t'' / &boundary on = ''right'' kind = ''convection'' coefficient = 1 '// &
        'ambient_expression = ''y'' / &boundary on = ''bottom'' kind = ''insulated'' / '// &
        '&boundary on = ''top'' kind = ''insulated'' / &source power_expression = ''x*y*(1+t)'' / '
    type(simulation_t) :: simulation
    real(wp), allocatable :: found(:, :)
    real(wp) :: ratio
    integer :: k

    do k = 0, 2
      call run_scene(scene//square(10, 0.1_wp)//'&motion '//vortex//'step = '// &
                     to_text(0.015_wp/2**k)//' / &time end = 0.15 tolerance = 1e-12 /', &
                     simulation, error)
      if (allocated(error)) return
      call check(error, simulation%motion%steps, 10*2**k)
      if (allocated(error)) return
      if (k == 0) allocate (found(simulation%cloud%particles(), 0:2))
      found(:, k) = simulation%temperature
    end do
    ratio = norm2(found(:, 1) - found(:, 0))/norm2(found(:, 2) - found(:, 1))
    call check(error, ratio > 3.6_wp .and. ratio < 4.4_wp, 'ratio '//to_text(ratio, digits=4))
    if (allocated(error)) return
    ! The longest step that the program takes is accurate enough beside the error in space.
    call check(error, norm2(found(:, 1) - found(:, 0)) < 5.0e-4_wp*norm2(found(:, 0)), &
               to_text(norm2(found(:, 1) - found(:, 0))/norm2(found(:, 0)), digits=3))
  end subroutine test_time_order

  subroutine test_uniform(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    character(len=*), parameter :: shifting(2) = [character(len=20) :: '', 'shifting = .true.']
    integer :: k

    do k = 1, 2
      call run_scene('&initial temperature = 300 / &boundary kind = ''insulated'' / '// &
                     '&boundary on = ''left'' value = 300 / '// &
                     square(12, 0.2_wp)//'&motion '//vortex//trim(shifting(k))// &
                     ' / &time end = 0.3 /', simulation, error)
      if (allocated(error)) return
      call check(error, maxval(abs(simulation%temperature - 300)) <= 1.0e-12_wp*300, &
                 to_text(maxval(abs(simulation%temperature - 300)), digits=3))
      if (allocated(error)) return
    end do
  end subroutine test_uniform

  !> Each particle keeps its temperature, but for what its place is wrong by: a millionth of a
  !> spacing in each step of the motion.
  subroutine test_linear(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    real(wp), allocatable :: first(:)
    type(scene_t) :: scene
    type(error_t), allocatable :: failure

    call interpret_scene('&domain x_range = -1, 1 y_range = -0.5, 0.5 spacing = 0.1 '// &
                         'arrangement = ''jittered'' / &initial temperature_expression = '// &
                         '''2*x-y'' / &boundary value_expression = '// &
                         '''2*(x*cos(t)+y*sin(t))-(y*cos(t)-x*sin(t))'' / '//rotation// &
                         '&time end = 2 /', scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    if (allocated(failure)) then
      call test_failed(error, failure%message)
      return
    end if
    first = simulation%temperature
    call simulation%run(failure)
    call check(error,.not. allocated(failure))
    if (allocated(error)) return
    call check(error, maxval(abs(simulation%temperature - first)) < &
               3*1.0e-6_wp*0.1_wp*simulation%motion%steps, &
               to_text(maxval(abs(simulation%temperature - first)), digits=3))
  end subroutine test_linear

  !> Two materials, and melting: what is carried along conducts as it did.
  subroutine test_rigid(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), &
        parameter :: common = '&domain shape = ''disc'' radius = 1 spacing = 0.125 '// &
        '/ &boundary kind = ''convection'' coefficient = 2 ambient = 1 / '// &
        '&time end = 0.2 method = ''rkl2'' / '// &
        '&initial temperature_expression = ''x+y*y'' / '
    character(len=*), parameter :: matter(3) = [character(len=100) :: &
        '&material / &material conductivity = 10 where_expression = ''x > 0.3'' / ', &
        '&material conductivity_xx = 5 conductivity_yy = 1 conductivity_xy = 1 / ', &
        '&material latent_heat = 1 solidus = 0.4 liquidus = 0.6 / ']
    type(simulation_t) :: still, moving
    integer :: k

    do k = 1, size(matter)
      call run_scene(common//trim(matter(k)), still, error)
      if (allocated(error)) return
      call run_scene(common//trim(matter(k))//'&motion velocity_x_expression = ''1-y/4'' '// &
                     'velocity_y_expression = ''x/4+t'' / ', moving, error)
      if (allocated(error)) return
      ! In one step of the motion the same steps are taken.
      call check(error, moving%motion%steps, 1)
      if (allocated(error)) return
      call check(error, maxval(abs(moving%cloud%x - still%cloud%x)) > 0.1_wp)
      if (allocated(error)) return
      call check(error, maxval(abs(moving%temperature - still%temperature)) < 1.0e-9_wp, &
                 to_text(maxval(abs(moving%temperature - still%temperature)), digits=3))
      if (allocated(error)) return
    end do
  end subroutine test_rigid

  !> Carry places by the vortex, exactly enough for a test
  subroutine carry(x, y, time)
    real(wp), intent(inout) :: x(:), y(:)
    real(wp), intent(in) :: time
    real(wp), allocatable :: u(:), v(:)
    integer :: k

    do k = 1, 20
      u = sin(pi*x)*cos(pi*y)
      v = -cos(pi*x)*sin(pi*y)
      x = x + time/20*u
      y = y + time/20*v
    end do
  end subroutine carry

  !> After each of many steps the list with the skin has the neighbours that a search finds.
  subroutine test_skin_list(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(skin_list_t) :: near
    type(neighbour_list_t) :: list, fresh
    real(wp), allocatable :: radius(:), wide(:), x(:), y(:)
    integer(ip), allocatable :: targets(:)
    integer :: step, k

    call prepare_scene('&boundary value = 0 / &time end = 1 / '//square(20, 0.3_wp), simulation, &
                       error)
    if (allocated(error)) return
    x = simulation%cloud%x
    y = simulation%cloud%y
    allocate (radius(size(x)), source=0.105_wp)
    targets = [(int(k, ip), k=1, size(x), 2)]
    ! Some want more than the list has
    wide = radius(targets)
    wide(::10) = 0.2_wp
    do step = 1, 40
      call carry(x, y, 0.015_wp)
      if (near%is_outdated(x, y)) call near%build(x, y, radius, 0.025_wp)
      call find_neighbours(x, y, wide, list, targets, near)
      call build_neighbour_list(x, y, wide, fresh, targets)
      call check(error, size(list%index) == size(fresh%index) .and. &
                 all(list%first == fresh%first) .and. all(list%target == fresh%target), &
                 'step '//to_text(step))
      if (allocated(error)) return
      call check(error, all(list%index == fresh%index), 'step '//to_text(step))
      if (allocated(error)) return
    end do
    call check(error, near%builds > 5 .and. near%builds < 20, to_text(near%builds)//' lists')
  end subroutine test_skin_list

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

  !> Row by row the same numbers, for rows whose supports have grown too
  subroutine test_same_rows(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), &
        parameter :: schemes(*) = [character(len=15) :: 'fatehi_manzari', 'positive', &
                                                 'consistent', 'double_gradient']
    type(simulation_t) :: simulation
    type(skin_list_t) :: near
    class(laplacian_scheme_t), allocatable :: scheme
    class(kernel_t), allocatable :: kernel
    type(sparse_operator_t) :: with, without
    type(row_report_t) :: report
    type(row_repairs_t) :: repairs
    type(error_t), allocatable :: failure
    real(wp), allocatable :: radius(:), other(:), x(:), y(:)
    integer(ip), allocatable :: free(:)
    integer :: k

    call prepare_scene('&boundary value = 0 / &time end = 1 / '//square(14, 0.45_wp), simulation, &
                       error)
    if (allocated(error)) return
    associate (cloud => simulation%cloud)
      x = cloud%x
      y = cloud%y
      free = pack([(int(k, ip), k=1, size(x))], cloud%side == 0)
      allocate (radius(size(x)), other(size(x)))
      call make_kernel('wendland_c2', kernel, failure)
      do k = 1, size(schemes)
        x = cloud%x
        y = cloud%y
        radius = 1.5_wp/14
        if (schemes(k) == 'consistent') radius = 2.4_wp/14
        other = radius
        call make_laplacian_scheme(trim(schemes(k)), scheme, failure, 3)
        call near%build(x, y, radius, 0.5_wp/14)
        call carry(x, y, 0.02_wp)
        call check(error,.not. near%is_outdated(x, y))
        if (allocated(error)) return
        call assemble_stable_rows(scheme, kernel, x, y, cloud%volume, radius, free, with, report, &
                                  repairs, near)
        call assemble_stable_rows(scheme, kernel, x, y, cloud%volume, other, free, without, &
                                  report, repairs)
        call check(error, size(with%weight), size(without%weight))
        if (allocated(error)) return
        call check(error, all(with%index == without%index) .and. &
                   .not. any(abs(with%weight - without%weight) > 0) .and. &
                   .not. any(abs(radius - other) > 0), trim(schemes(k)))
        if (allocated(error)) return
        if (schemes(k) == 'double_gradient') cycle
        call check(error, any(repairs%repair >= support_grown), trim(schemes(k))//': no row grew')
        if (allocated(error)) return
      end do
    end associate
  end subroutine test_same_rows

  !> Not for a rigid motion; where neighbours come nearer, when a list could miss one.
  subroutine test_builds(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(skin_list_t) :: near
    real(wp), allocatable :: x(:), y(:), radius(:)
    real(wp), parameter :: skin = 0.05_wp, reach = 0.2_wp

    call prepare_scene('&boundary value = 0 / &time end = 1 / '//square(10, 0.1_wp), simulation, &
                       error)
    if (allocated(error)) return
    associate (from_x => simulation%cloud%x, from_y => simulation%cloud%y)
      allocate (radius(size(from_x)), source=reach)
      call check(error, near%is_outdated(from_x, from_y), 'there is no list yet')
      if (allocated(error)) return
      call near%build(from_x, from_y, radius, skin)
      call check(error,.not. near%is_outdated(5 + cos(2.0_wp)*from_x - sin(2.0_wp)*from_y, &
                                               sin(2.0_wp)*from_x + cos(2.0_wp)*from_y), 'rigid')
      if (allocated(error)) return
      ! One particle moves, by a little less and a little more than half the skin; but for what the
      ! others' mean motion makes of it
      x = from_x
      y = from_y
      x(50) = x(50) + 0.45_wp*skin
      call check(error,.not. near%is_outdated(x, y), 'less than half')
      if (allocated(error)) return
      x(50) = from_x(50) + 0.6_wp*skin
      call check(error, near%is_outdated(x, y), 'more than half')
      if (allocated(error)) return
      ! All move by more than the skin, relative to each other by less than it takes
      call check(error,.not. near%is_outdated(1.1_wp*from_x, from_y/1.1_wp), 'strained')
      if (allocated(error)) return
      call check(error, near%is_outdated(1.3_wp*from_x, from_y/1.3_wp), 'strained more')
    end associate
    if (allocated(error)) return
    ! In a run: a strain of 0.05 a step uses up the skin of half a spacing, 0.19 of the reach, in
    ! four steps.
    call run_scene(decaying//square(12, 0.0_wp)//'&motion '//vortex//'/ &time end = 0.3 /', &
                   simulation, error)
    if (allocated(error)) return
    associate (motion => simulation%motion)
      call check(error, motion%steps, 19)
      if (allocated(error)) return
      call check(error, motion%near%builds >= 4 .and. motion%near%builds <= 8, &
                 to_text(motion%near%builds)//' lists')
    end associate
  end subroutine test_builds

  !> Heat of an insulated body: what is lost falls with the square of the spacing. (The vortex alone
  !> would lose nothing on a lattice, by symmetry.)
  subroutine test_conservation(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: lost(2)
    integer :: k
    type(simulation_t) :: simulation

    do k = 1, 2
      call run_scene('&initial temperature_expression = ''2+cos(pi*x)+cos(2*pi*y)'' / '// &
                     '&material conductivity = 0.1 / &boundary kind = ''insulated'' / '// &
                     '&motion velocity_x_expression = ''sin(pi*x)*cos(pi*y)*(1+x/2)'' '// &
                     'velocity_y_expression = '// &
                     '''-(cos(pi*x)*(1+x/2)+0.5/pi*sin(pi*x))*sin(pi*y)'' / '// &
                     '&time end = 0.2 tolerance = 1e-9 / '//square(20*k, 0.0_wp), simulation, &
                     error)
      if (allocated(error)) return
      lost(k) = abs(simulation%entries(2)%stored/simulation%entries(1)%stored - 1)
    end do
    call check(error, lost(1) < 2.0e-4_wp .and. lost(2) < 0.35_wp*lost(1), 'lost '// &
               to_text(lost(1), digits=3)//', '//to_text(lost(2), digits=3))
  end subroutine test_conservation

  subroutine test_walls(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(moving_walls_t) :: walls
    type(error_t), allocatable :: failure
    character(len=*), parameter :: domains(2) = [character(len=80) :: &
        'shape = ''annulus'' radius = 1 inner_radius = 0.4 spacing = 0.1', &
        'shape = ''polygon'' vertices = 0,0, 2,0, 1,1, 0,1 spacing = 0.1']
    real(wp) :: angle, exact(2)
    real(wp), allocatable :: first(:, :), length(:)
    integer :: k, j

    angle = 0.7_wp
    do k = 1, 2
      call prepare_scene('&boundary kind = ''insulated'' / &time end = 1 / &domain '// &
                         trim(domains(k))//' / ', simulation, error)
      if (allocated(error)) return
      associate (cloud => simulation%cloud, contacts => simulation%conduction%medium%contacts)
        call walls%prepare(cloud, contacts, failure)
        if (allocated(failure)) then
          call test_failed(error, failure%message)
          return
        end if
        first = contacts%normal
        length = contacts%length
        call walls%measure(3 + cos(angle)*cloud%x - sin(angle)*cloud%y, &
                           sin(angle)*cloud%x + cos(angle)*cloud%y, contacts)
        do j = 1, size(contacts%particle)
          exact = [cos(angle)*first(1, j) - sin(angle)*first(2, j), &
                   sin(angle)*first(1, j) + cos(angle)*first(2, j)]
          call check(error, maxval(abs(contacts%normal(:, j) - exact)) < 1.0e-12_wp, 'rotated')
          if (allocated(error)) return
        end do
        call check(error, maxval(abs(contacts%length - length)) < 1.0e-12_wp, 'length')
        if (allocated(error)) return
        call walls%measure(cloud%x, cloud%y, simulation%conduction%medium%contacts)
      end associate
    end do
    ! The polygon sheared: the lower edge keeps its normal, the left one leans, all in all right
    associate (cloud => simulation%cloud, contacts => simulation%conduction%medium%contacts)
      call walls%measure(cloud%x + 0.5_wp*cloud%y, cloud%y, contacts)
      do j = 1, size(contacts%particle)
        select case (trim(cloud%boundary(contacts%side(j) + 1)%value))
        case ('edge 1')
          exact = [0.0_wp, -1.0_wp]
        case ('edge 2')
          exact = [1.0_wp, 0.5_wp]/sqrt(1.25_wp)
        case ('edge 3')
          exact = [0.0_wp, 1.0_wp]
        case default
          exact = [-1.0_wp, 0.5_wp]/sqrt(1.25_wp)
        end select
        call check(error, maxval(abs(contacts%normal(:, j) - exact)) < 1.0e-12_wp, &
                   'wall '//cloud%boundary(contacts%side(j) + 1)%value)
        if (allocated(error)) return
      end do
      call check(error, sum(contacts%length), 3 + 2*sqrt(1.25_wp), thr=1.0e-12_wp)
    end associate
  end subroutine test_walls

  !> T = sin(x) exp(-t) in a body that moves to the right: what that takes is a source that stands
  !> still, and a flux through the right wall.
  subroutine test_sources(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: exact = 'sin(x)*exp(-t)'
    character(len=*), parameter :: scene = '&scene exact_expression = '''//exact//''' / '// &
        '&initial temperature_expression = ''sin(x)'' / &boundary value_expression = '''//exact// &
        ''' / &boundary on = ''right'' kind = ''flux'' flux_expression = ''cos(x)*exp(-t)'' / '// &
        '&boundary on = ''top'' kind = ''insulated'' / &source power_expression = '// &
        '''2*cos(x)*exp(-t)'' where_expression = ''x > -1'' / &motion velocity_x = 2 / '// &
        '&time end = 0.3 tolerance = 1e-8 / '
    type(simulation_t) :: coarse, fine

    call run_scene(scene//square(10, 0.1_wp), coarse, error)
    if (allocated(error)) return
    call run_scene(scene//square(20, 0.1_wp), fine, error)
    if (allocated(error)) return
    call check_order(coarse, fine, 1.7_wp, 'in translation', error)
    if (allocated(error)) return
    call check(error, fine%relative_l2_error() < 2.0e-4_wp, &
               to_text(fine%relative_l2_error(), digits=3))
  end subroutine test_sources

  !> Every polynomial of the degree of the scheme goes to the new places as it is.
  subroutine test_carried_field(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(moving_walls_t) :: walls
    type(skin_list_t) :: near
    class(kernel_t), allocatable :: kernel
    type(error_t), allocatable :: failure
    real(wp), allocatable :: x(:), y(:), field(:), radius(:), from_x(:), from_y(:)
    integer(ip), allocatable :: origin(:)
    integer :: degree, a, b

    call prepare_scene('&boundary kind = ''insulated'' / &time end = 1 / '//square(14, 0.3_wp), &
                       simulation, error)
    if (allocated(error)) return
    call make_kernel('wendland_c2', kernel, failure)
    associate (cloud => simulation%cloud)
      call walls%prepare(cloud, simulation%conduction%medium%contacts, failure)
      call carry(cloud%x, cloud%y, 0.1_wp)
      from_x = cloud%x
      from_y = cloud%y
      allocate (radius(cloud%particles()), source=0.15_wp)
      call near%build(cloud%x, cloud%y, radius, 0.05_wp)
      do degree = 2, 5
        do a = 0, degree
          b = degree - a
          call find_even_places(cloud, walls, x, y, origin)
          call check(error, maxval(hypot(x - from_x, y - from_y)) > 0.02_wp, 'nothing was shifted')
          if (allocated(error)) return
          field = (from_x - 0.3_wp)**a*(from_y + 0.1_wp)**b + 2*from_x - 5
          call carry_field(cloud, kernel, degree, 0.15_wp + 0.03_wp*degree, near, origin, x, y, &
                           field)
          call check(error, maxval(hypot(x - from_x, y - from_y)) > 0.02_wp, 'none was carried')
          if (allocated(error)) return
          field = field - ((x - 0.3_wp)**a*(y + 0.1_wp)**b + 2*x - 5)
          call check(error, maxval(abs(field)) < 1.0e-10_wp, 'degree '//to_text(degree)//': '// &
                     to_text(maxval(abs(field)), digits=3))
          if (allocated(error)) return
        end do
      end do
      ! Walls stay where they are, straight
      call check(error, .not. any(btest(cloud%side, 0) .and. abs(x) > 1.0e-14_wp))
    end associate
  end subroutine test_carried_field

  !> The vortex turns several times: particles stay apart, the decay is right, and the areas that
  !> they stand for sum to that of the square.
  subroutine test_shifting(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: coarse, fine
    type(neighbour_list_t) :: list

    call run_scene(decaying//square(12, 0.0_wp)//'&motion '//vortex//'shifting = .true. / '// &
                   '&time end = 3 /', coarse, error)
    if (allocated(error)) return
    call run_scene(decaying//square(24, 0.0_wp)//'&motion '//vortex//'shifting = .true. / '// &
                   '&time end = 3 /', fine, error)
    if (allocated(error)) return
    call check_order(coarse, fine, 1.6_wp, 'shifted', error)
    if (allocated(error)) return
    call check(error, fine%relative_l2_error() < 3.0e-3_wp)
    if (allocated(error)) return
    associate (cloud => fine%cloud)
      call build_neighbour_list(cloud%x, cloud%y, 0.6_wp*cloud%spacing, list)
      call check(error, size(list%index), 0, 'some particles are too near to each other')
      if (allocated(error)) return
      call check(error, sum(cloud%area), 1.0_wp, thr=1.0e-12_wp)
      if (allocated(error)) return
      call check(error, minval(cloud%x) > -1.0e-9_wp .and. maxval(cloud%x) < 1 + 1.0e-9_wp .and. &
                 minval(cloud%y) > -1.0e-9_wp .and. maxval(cloud%y) < 1 + 1.0e-9_wp)
      if (allocated(error)) return
      call check(error, maxval(fine%repairs%quality%ratio) <= 1.2_wp)
    end associate
  end subroutine test_shifting

  !> Without shifting the same vortex ends in one sentence.
  subroutine test_torn(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: file = 'build/test/torn.vtkhdf'
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    real(wp), allocatable :: times(:), points(:)

    call try_scene(decaying//square(12, 0.0_wp)//'&motion '//vortex//'/ &time end = 3 / '// &
                   '&output file = '''//file//''' every = 0.25 / ', simulation, failure)
    call check(error, allocated(failure))
    if (allocated(error)) return
    call check(error, failure%status, status_bad_numbers)
    if (allocated(error)) return
    call check(error, index(failure%message, 'the motion has spoilt the cloud') > 0 .and. &
               index(failure%message, 'shifting = .true.') > 0 .and. &
               index(failure%message, 'The last good state') > 0, failure%message)
    if (allocated(error)) return
    times = reals_in_file(file, '/VTKHDF/Steps/Values')
    call check(error, times(size(times)), simulation%time)
    if (allocated(error)) return
    points = reals_in_file(file, '/VTKHDF/Points')
    call check(error, size(points), 3*size(times)*simulation%cloud%particles())
  end subroutine test_torn

  subroutine test_schemes(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: schemes(*) = [character(len=50) :: &
        'laplacian = ''fatehi_manzari''', 'laplacian = ''positive''', &
        'laplacian = ''consistent'' order = 2', 'laplacian = ''consistent'' order = 4']
    real(wp), parameter :: largest(*) = [2.0e-3_wp, 4.0e-3_wp, 1.0e-3_wp, 1.0e-4_wp]
    type(simulation_t) :: simulation
    integer :: k

    do k = 1, size(schemes)
      call run_scene(decaying//square(16, 0.2_wp)//'&scheme '//trim(schemes(k))//' / &motion '// &
                     vortex//'/ &time end = 0.2 /', simulation, error)
      if (allocated(error)) return
      call check(error, simulation%relative_l2_error() < largest(k), trim(schemes(k))//': '// &
                 to_text(simulation%relative_l2_error(), digits=3))
      if (allocated(error)) return
      call run_scene(decaying//square(16, 0.2_wp)//'&scheme '//trim(schemes(k))//' / &motion '// &
                     vortex//'shifting = .true. / &time end = 0.2 /', simulation, error)
      if (allocated(error)) return
      call check(error, simulation%relative_l2_error() < largest(k), 'shifted '// &
                 trim(schemes(k))//': '//to_text(simulation%relative_l2_error(), digits=3))
      if (allocated(error)) return
    end do
  end subroutine test_schemes

  subroutine test_refused(error)
    type(error_type), allocatable, intent(out) :: error

    call refuse('&motion / &time end = 1 /', status_bad_input, 'the velocity is missing')
    if (allocated(error)) return
    call refuse('&motion velocity_x_expression = ''T'' / &time end = 1 /', status_bad_input, &
                'may depend on x, y and t only')
    if (allocated(error)) return
    call refuse('&motion velocity_x = 1 / &time steady = .true. /', status_bad_input, &
                'no steady temperature')
    if (allocated(error)) return
    call refuse('&motion velocity_x_expression = ''x'' / &time end = 1 /', status_bad_input, &
                'has the divergence 1')
    if (allocated(error)) return
    call refuse('&motion velocity_x_expression = ''t*x'' / &time end = 1 /', status_bad_numbers, &
                'has the divergence')
    if (allocated(error)) return
    call refuse('&motion velocity_x_expression = ''sqrt(0.5-y)'' / &time end = 1 /', &
                status_bad_input, 'gives no number')
    if (allocated(error)) return
    call refuse('&motion velocity_x_expression = ''sqrt(0.5-t)'' / &time end = 1 /', &
                status_bad_numbers, 'no number')
    if (allocated(error)) return
    call refuse('&motion velocity_x_expression = ''x < 0.52 ? 1 : -1'' / &time end = 1 /', &
                status_bad_numbers, 'as much from one particle to the next')
    if (allocated(error)) return
    call refuse('&motion velocity_x_expression = ''y'' / &time end = 1 / &material / &material '// &
                'conductivity = 2 where_expression = ''x > 0.5'' /', status_bad_numbers, &
                'as a rigid body only')
    if (allocated(error)) return
    call refuse('&motion velocity_x = 1 shifting = .true. / &time end = 1 / &material '// &
                'conductivity_expression = ''1+x'' /', status_bad_input, &
                'leaves its material behind')
    if (allocated(error)) return
    call refuse('&motion velocity_x = 1 skin = -1 / &time end = 1 /', status_bad_input, 'skin')

  contains

    subroutine refuse(text, status, words)
      character(len=*), intent(in) :: text, words
      integer, intent(in) :: status
      type(simulation_t) :: simulation
      type(error_t), allocatable :: failure

      call try_scene('&boundary value = 0 / '//square(10, 0.0_wp)//text, simulation, failure)
      call check(error, allocated(failure), 'not refused: '//text)
      if (allocated(error)) return
      call check(error, index(failure%message, words) > 0, failure%message)
      if (allocated(error)) return
      call check(error, failure%status, status, failure%message)
    end subroutine refuse

  end subroutine test_refused

  subroutine test_absent(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: plain, moving

    call run_scene('&boundary value_expression = ''x'' / &time end = 0.01 / '// &
                   square(10, 0.0_wp), plain, error)
    if (allocated(error)) return
    call check(error, .not. allocated(plain%motion) .and. &
               .not. allocated(plain%conduction%prescribed(1)%expression) .and. &
               .not. plain%conduction%medium%in_motion, 'something is there without motion')
    if (allocated(error)) return
    call check(error, .not. any(plain%stopwatch%phases%name == 'motion'))
    if (allocated(error)) return
    call check(error, size(plain%effects_in_force()), 2)
    if (allocated(error)) return
    call run_scene('&boundary value = 1 / &time end = 0.01 / '//square(10, 0.0_wp)// &
                   '&motion velocity_x = 1 shifting = .true. / ', moving, error)
    if (allocated(error)) return
    call check(error, size(moving%effects_in_force()), 4)
    if (allocated(error)) return
    call check(error, moving%motion%bytes() > 0 .and. moving%motion%steps > 0)
    if (allocated(error)) return
    call check(error, moving%motion%assemblies, 0, 'rows were made anew for a translation')
  end subroutine test_absent

  !> The places of each state, in the user's order, and where each state's begin
  subroutine test_output(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: file = 'build/test/motion.vtkhdf'
    type(simulation_t) :: simulation
    real(wp), allocatable :: points(:), offsets(:), times(:), quality(:)
    real(wp) :: angle
    integer :: n, k, step

    call run_scene('&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.25 / &boundary value = 0 '// &
                   '/ &time end = 0.6 / '//rotation//'&output file = '''//file//''' '// &
                   'every = 0.2 fields = ''temperature'', ''row_quality'' / ', simulation, error)
    if (allocated(error)) return
    n = simulation%cloud%particles()
    points = reals_in_file(file, '/VTKHDF/Points')
    offsets = reals_in_file(file, '/VTKHDF/Steps/PointOffsets')
    times = reals_in_file(file, '/VTKHDF/Steps/Values')
    quality = reals_in_file(file, '/VTKHDF/PointData/row_quality')
    call check(error, size(times), 4)
    if (allocated(error)) return
    call check(error, size(points), 4*3*n)
    if (allocated(error)) return
    call check(error, size(quality), 4*n)
    if (allocated(error)) return
    do step = 1, 4
      call check(error, nint(offsets(step)), (step - 1)*n)
      if (allocated(error)) return
      angle = 0.2_wp*(step - 1)
      do k = 1, n
        associate (first => points(3*k - 2:3*k), now => points(3*((step - 1)*n + k) - 2: &
                                                               3*((step - 1)*n + k)))
          call check(error, hypot(now(1) - cos(angle)*first(1) + sin(angle)*first(2), &
                                  now(2) - sin(angle)*first(1) - cos(angle)*first(2)) < 1.0e-6_wp)
          if (allocated(error)) return
        end associate
      end do
    end do
    call check(error, size(reals_in_file(file, '/VTKHDF/NumberOfPoints')), 1)
  end subroutine test_output

end module test_motion
