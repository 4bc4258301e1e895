!> The error that a run carries along: how near it comes to the true one.
module test_error_estimate
  use calor_error, only: error_t
  use calor_initial_fluxes, only: smooth_kink, kink_value
  use calor_kinds, only: wp
  use calor_laplacian_schemes, only: usual_support
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene, read_scene
  use calor_simulation, only: simulation_t
  use calor_text, only: to_text
  use test_field_reader, only: reals_in_file
  use testdrive, only: new_unittest, unittest_type, test_error => error_type, check
  implicit none (type, external)
  private

  public :: collect_error_estimate

  !> Bounds of estimated over true error
  real(wp), parameter :: lowest = 0.8_wp, highest = 1.25_wp

contains

  subroutine collect_error_estimate(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('every scheme, lattice and irregular', test_schemes), &
                new_unittest('errors of time steps', test_time), &
                new_unittest('changing walls, a lower mode', test_other_field), &
                new_unittest('scenes with other shapes and walls', test_scenes), &
                new_unittest('interfaces between materials', test_interfaces), &
                new_unittest('heat fluxes that jump at the start are found', test_flux_jumps), &
                new_unittest('a kink made smooth is the same later on', test_smooth_kink), &
                new_unittest('heat fluxes that jump at the start', test_kinks), &
                new_unittest('initial temperatures that jump', test_jumps), &
                new_unittest('steady temperatures', test_steady), &
                new_unittest('particles in rigid motion', test_rigid_motion), &
                new_unittest('particles that move past each other', test_shear), &
                new_unittest('steps of the motion', test_motion_steps), &
                new_unittest('a melting front', test_melting), &
                new_unittest('a melting body at rest', test_melting_steady), &
                new_unittest('what an estimate of a mean cannot do', test_refused), &
                new_unittest('a field that the scheme gets right', test_exact), &
                new_unittest('what is written', test_written), &
                new_unittest('without it nothing is carried along', test_absent) &
                ]
  end subroutine collect_error_estimate

  !> Run a scene on the unit square; `error` is set where that fails.
  subroutine run_scene(text, simulation, error)
    character(len=*), intent(in) :: text
    type(simulation_t), intent(out) :: simulation
    type(test_error), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(error_t), allocatable :: failure

    call interpret_scene(text, scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    if (.not. allocated(failure)) call simulation%run(failure)
    if (allocated(failure)) call check(error, .false., failure%message)
  end subroutine run_scene

  pure function plate(scheme, n, jitter, time) result(text)
    character(len=*), intent(in) :: scheme, time
    integer, intent(in) :: n
    real(wp), intent(in) :: jitter
    character(len=:), allocatable :: text

    text = '&scene exact_expression = "sin(pi*x)*sin(pi*y)*exp(-2*pi^2*t)" / '// &
           '&domain x_range = 0, 1 y_range = 0, 1 arrangement = "jittered" '// &
           'spacing = '//to_text(1.0_wp/n)//' jitter = '//to_text(jitter)//' / '// &
           '&scheme '//scheme//' / &time end = 0.05 '//time//' / '// &
           '&initial temperature_expression = "sin(pi*x)*sin(pi*y)" / '// &
           '&boundary on = "all" kind = "temperature" value = 0 / &accuracy estimate = T / '
  end function plate

  !> The estimate is within its bounds of the truth, and the corrected field better than the field.
  subroutine judge(simulation, gain, what, error)
    type(simulation_t), intent(in) :: simulation
    !> How many times better the corrected field must be
    real(wp), intent(in) :: gain
    character(len=*), intent(in) :: what
    type(test_error), allocatable, intent(out) :: error
    type(simulation_t) :: corrected
    real(wp) :: true_error, effectivity

    true_error = simulation%relative_l2_error()
    effectivity = simulation%estimated_error()/true_error
    call check(error, effectivity >= lowest .and. effectivity <= highest, &
               what//': estimated '//to_text(simulation%estimated_error(), digits=3)//', true '// &
               to_text(true_error, digits=3))
    if (allocated(error)) return
    corrected = simulation
    corrected%temperature = simulation%temperature + simulation%estimate%error
    call check(error, corrected%relative_l2_error() < true_error/gain, what//': corrected '// &
               to_text(corrected%relative_l2_error(), digits=3)//' of '// &
               to_text(true_error, digits=3))
  end subroutine judge

  subroutine test_schemes(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=40), parameter :: schemes(*) = [character(len=40) :: &
        'laplacian = "fatehi_manzari"', 'laplacian = "positive"', 'laplacian = "brookshaw"', &
        'laplacian = "consistent" order = 1', 'laplacian = "consistent" order = 2', &
        'laplacian = "consistent" order = 3', 'laplacian = "consistent" order = 4', &
        'laplacian = "consistent" order = 6']
    real(wp), parameter :: jitters(*) = [0.0_wp, 0.3_wp]
    !> What the correction gains: little where the reference is just the next order
    real(wp), parameter :: gains(*) = [5.0_wp, 5.0_wp, 5.0_wp, 5.0_wp, 5.0_wp, 1.5_wp, 1.5_wp, &
                                       1.5_wp]
    type(simulation_t) :: simulation
    integer :: k, j

    do k = 1, size(schemes)
      do j = 1, size(jitters)
        ! Steps so short that the error is that of space
        call run_scene(plate(trim(schemes(k)), 20, jitters(j), 'tolerance = 1e-9'), simulation, &
                       error)
        if (allocated(error)) return
        call judge(simulation, gains(k), trim(schemes(k))//', jitter '//to_text(jitters(j)), error)
        if (allocated(error)) return
      end do
    end do
  end subroutine test_schemes

  !> Spaces of high order, so that what remains is the error of the steps.
  subroutine test_time(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=32), parameter :: methods(*) = [character(len=32) :: &
        'tolerance = 1e-5', 'tolerance = 1e-6', 'method = "rkl2" step = 5e-4', &
        'method = "forward_euler"']
    type(simulation_t) :: simulation
    integer :: k

    do k = 1, size(methods)
      call run_scene(plate('laplacian = "consistent" order = 6', 24, 0.2_wp, trim(methods(k))), &
                     simulation, error)
      if (allocated(error)) return
      call judge(simulation, 3.0_wp, trim(methods(k)), error)
      if (allocated(error)) return
    end do
  end subroutine test_time

  !> A field with gradients at walls whose temperature changes
  subroutine test_other_field(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=*), parameter :: field = 'exp(-5*t)*cos(x + 1)*sin(2*y)'
    type(simulation_t) :: simulation

    call run_scene('&scene exact_expression = "'//field//'" / &domain x_range = 0, 1 '// &
                   'y_range = 0, 1 arrangement = "jittered" spacing = 0.05 jitter = 0.2 / '// &
                   '&initial temperature_expression = "cos(x + 1)*sin(2*y)" / '// &
                   '&boundary value_expression = "'//field//'" / &time end = 0.1 / '// &
                   '&accuracy estimate = T /', simulation, error)
    if (allocated(error)) return
    call judge(simulation, 3.0_wp, 'changing walls', error)
  end subroutine test_other_field

  !> Scenes that ship with the program, as they stand
  subroutine test_scenes(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=*), parameter :: paths(*) = [character(len=40) :: 'data/disc.nml', &
        'data/annulus.nml', 'data/verification/convective_slab_1.nml', &
        'data/verification/half_space.nml', 'data/verification/anisotropic_10.nml', &
        'data/verification/two_slabs_10.nml', 'data/verification/two_slabs_1000.nml']
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    real(wp) :: effectivity
    integer :: k

    do k = 1, size(paths)
      call read_scene(trim(paths(k)), scene, failure)
      if (.not. allocated(failure)) then
        scene%accuracy%estimate = .true.
        scene%output%file = ''
        call simulation%prepare(scene, failure)
      end if
      if (.not. allocated(failure)) call simulation%run(failure)
      if (allocated(failure)) then
        call check(error, .false., failure%message)
        return
      end if
      effectivity = simulation%estimated_error()/simulation%relative_l2_error()
      call check(error, effectivity >= lowest .and. effectivity <= highest, &
                 trim(paths(k))//': estimated over true '//to_text(effectivity, digits=3))
      if (allocated(error)) return
    end do
  end subroutine test_scenes

  !> Rows across interfaces are of degree 2 with the paper's scheme, of the scheme's order with
  !> others: the reference sees what they miss.
  subroutine test_interfaces(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=*), parameter :: paths(2) = [character(len=40) :: &
        'data/verification/two_slabs_10.nml', 'data/verification/two_slabs_1000.nml']
    character(len=9), parameter :: arrangements(*) = [character(len=9) :: 'lattice', 'jittered', &
                                                      'relaxed']
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    integer :: k, j, order

    do k = 1, size(paths)
      do j = 1, size(arrangements)
        do order = 2, 4, 2
          call read_scene(trim(paths(k)), scene, failure)
          if (.not. allocated(failure)) then
            scene%accuracy%estimate = .true.
            scene%output%file = ''
            scene%domain%arrangement = trim(arrangements(j))
            scene%domain%jitter = 0.2_wp
            if (order > 2) then
              scene%laplacian = 'consistent'
              scene%order = order
              scene%support = usual_support('consistent', order)
              scene%time%tolerance = 1.0e-9_wp
            end if
            call simulation%prepare(scene, failure)
          end if
          if (.not. allocated(failure)) call simulation%run(failure)
          if (allocated(failure)) then
            call check(error, .false., failure%message)
            return
          end if
          call judge(simulation, 2.0_wp, trim(paths(k))//', '//trim(arrangements(j))//', order '// &
                     to_text(order), error)
          if (allocated(error)) return
        end do
      end do
    end do
  end subroutine test_interfaces

  !> From a straight line the flux jumps by 9 parts in 10; it does not in the exact solution of two
  !> half-spaces, whose temperatures are of one time already, nor where conductivities are equal.
  subroutine test_flux_jumps(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=*), parameter :: paths(*) = [character(len=48) :: &
        'data/verification/two_slabs_transient_10.nml', 'data/verification/two_slabs_10.nml', &
        'data/verification/two_slabs_1000.nml', 'data/plate.nml']
    real(wp), parameter :: jumps(*) = [0.9_wp, 0.0_wp, 0.0_wp, 0.0_wp]
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    integer :: k

    do k = 1, size(paths)
      call read_scene(trim(paths(k)), scene, failure)
      if (.not. allocated(failure)) then
        scene%accuracy%estimate = .true.
        scene%output%file = ''
        call simulation%prepare(scene, failure)
      end if
      call check(error, .not. allocated(failure))
      if (allocated(error)) return
      call check(error, simulation%flux_jump, jumps(k), thr=5.0e-4_wp, more=trim(paths(k)))
      if (allocated(error)) return
    end do
  end subroutine test_flux_jumps

  !> The conditions of calor_initial_fluxes, derivatives by differences and integrals by sums.
  subroutine test_smooth_kink(error)
    type(test_error), allocatable, intent(out) :: error
    real(wp), parameter :: conductivities(*) = [10.0_wp, 0.1_wp, 1000.0_wp]
    real(wp), parameter :: capacities(*) = [1.0_wp, 3.0_wp, 0.2_wp]
    integer, parameter :: nodes = 20000
    real(wp) :: coefficient(4, 2), integral, size_of_it, here, beyond, k, c, r
    integer :: j, m, i

    do j = 1, size(conductivities)
      k = conductivities(j)
      c = capacities(j)
      call smooth_kink(k, c, coefficient)
      here = kink_value(coefficient(:, 1), 0.0_wp)
      beyond = kink_value(coefficient(:, 2), 0.0_wp)
      call check(error, abs(here - beyond) <= 1.0e-10_wp*abs(here), 'jumps')
      if (allocated(error)) return
      call check(error, k*slope(coefficient(:, 2), 1) + slope(coefficient(:, 1), 1), -1.0_wp, &
                 thr=1.0e-5_wp, more='the kink stays')
      if (allocated(error)) return
      call check(error, slope(coefficient(:, 1), 2), k/c*slope(coefficient(:, 2), 2), &
                 thr=1.0e-5_wp*max(1.0_wp, k/c)*maxval(abs(coefficient)), more='the rate jumps')
      if (allocated(error)) return
      do m = 0, 3
        integral = 0
        size_of_it = 0
        do i = 1, nodes
          r = (i - 0.5_wp)/nodes
          here = (-r)**m*kink_value(coefficient(:, 1), r)/nodes
          beyond = c*r**m*k**(-mod(m, 2))*(c/k)**(m/2)*kink_value(coefficient(:, 2), r)/nodes
          integral = integral + here + beyond
          size_of_it = size_of_it + abs(here) + abs(beyond)
        end do
        call check(error, abs(integral) <= 1.0e-6_wp*size_of_it, 'moment '//to_text(m))
        if (allocated(error)) return
      end do
    end do

  contains

    !> The first or second derivative at the interface, outwards
    pure function slope(one, times)
      real(wp), intent(in) :: one(:)
      integer, intent(in) :: times
      real(wp) :: slope
      real(wp), parameter :: h = 1.0e-3_wp

      if (times == 1) then
        slope = (-11*kink_value(one, 0.0_wp) + 18*kink_value(one, h) - 9*kink_value(one, 2*h) + &
                 2*kink_value(one, 3*h))/(6*h)
      else
        slope = (35*kink_value(one, 0.0_wp) - 104*kink_value(one, h) + 114*kink_value(one, 2*h) - &
                 56*kink_value(one, 3*h) + 11*kink_value(one, 4*h))/(12*h**2)
      end if
    end function slope

  end subroutine test_smooth_kink

  !> Two slabs that start from one straight line, against a fine solution in one dimension.
  subroutine test_kinks(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=*), parameter :: names(*) = [character(len=22) :: 'two_slabs_transient_10', &
                                               'two_slabs_transient_10', 'two_slabs_transient_1000']
    character(len=*), parameter :: laplacians(*) = [character(len=14) :: 'fatehi_manzari', &
                                                    'positive', 'fatehi_manzari']
    character(len=9), parameter :: arrangements(*) = [character(len=9) :: 'lattice', 'jittered', &
                                                      'relaxed']
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    real(wp), allocatable :: truth(:)
    real(wp) :: effectivity
    integer :: k, j

    do k = 1, size(names)
      do j = 1, size(arrangements)
        call read_scene('data/verification/'//trim(names(k))//'.nml', scene, failure)
        if (.not. allocated(failure)) then
          scene%accuracy%estimate = .true.
          scene%output%file = ''
          scene%laplacian = trim(laplacians(k))
          scene%domain%arrangement = trim(arrangements(j))
          scene%domain%jitter = 0.2_wp
          call simulation%prepare(scene, failure)
        end if
        if (.not. allocated(failure)) call simulation%run(failure)
        call check(error, .not. allocated(failure))
        if (allocated(error)) return
        call read_profile('data/verification/'//trim(names(k))//'.csv', simulation%cloud%x, truth)
        associate (area => simulation%cloud%area)
          effectivity = simulation%estimated_error()*sqrt(sum(area*(simulation%temperature + &
                                              simulation%error_estimate())**2))/ &
                        sqrt(sum(area*(simulation%temperature - truth)**2))
        end associate
        call check(error, effectivity >= lowest .and. effectivity <= highest, &
                   trim(names(k))//', '//trim(laplacians(k))//', '//trim(arrangements(j))//': '// &
                   to_text(effectivity, digits=3))
        if (allocated(error)) return
      end do
    end do
  end subroutine test_kinks

  !> A profile at given places, by straight lines between its points: these are so near to each
  !> other that it misses a hundredth of the errors asked for.
  subroutine read_profile(path, x, value)
    character(len=*), intent(in) :: path
    real(wp), intent(in) :: x(:)
    real(wp), allocatable, intent(out) :: value(:)
    real(wp) :: point(2, 5000), part
    integer :: unit, n, i, k, status

    open (newunit=unit, file=path, action='read', status='old')
    read (unit, *)
    n = 0
    do
      read (unit, *, iostat=status) point(:, n + 1)
      if (status /= 0) exit
      n = n + 1
    end do
    close (unit)
    allocate (value(size(x)))
    do i = 1, size(x)
      k = max(1, min(n - 1, count(point(1, :n) <= x(i))))
      part = (x(i) - point(1, k))/(point(1, k + 1) - point(1, k))
      value(i) = (1 - part)*point(2, k) + part*point(2, k + 1)
    end do
  end subroutine read_profile

  !> Where between two particles a field jumps the particles do not tell: an error of first order.
  !> A front along a column of particles, with the insulated slab's Fourier series, and one at an
  !> angle.
  subroutine test_jumps(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=9), parameter :: arrangements(*) = [character(len=9) :: 'lattice', 'jittered', &
                                                      'relaxed']
    character(len=*), parameter :: front = '0.5-0.5*erf((0.6*x+0.8*y-0.51)/(2*sqrt(t+1e-20)))'
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    integer :: k

    do k = 1, size(arrangements)
      call read_scene('data/verification/slab_step.nml', scene, failure)
      if (.not. allocated(failure)) then
        scene%domain%arrangement = trim(arrangements(k))
        scene%accuracy%estimate = .true.
        call simulation%prepare(scene, failure)
      end if
      if (.not. allocated(failure)) call simulation%run(failure)
      if (allocated(failure)) then
        call check(error, .false., failure%message)
        return
      end if
      call judge(simulation, 2.0_wp, 'a step, '//trim(arrangements(k)), error)
      if (allocated(error)) return
      call run_scene('&scene exact_expression = "'//front//'" / &domain x_range = 0, 1 '// &
                     'y_range = 0, 0.5 spacing = 0.025 arrangement = "'// &
                     trim(arrangements(k))//'" / &initial temperature_expression = '// &
                     '"0.6*x + 0.8*y < 0.51 ? 1 : 0" / &boundary value_expression = "'//front// &
                     '" / &time end = 0.005 / &accuracy estimate = T /', simulation, error)
      if (allocated(error)) return
      call judge(simulation, 2.0_wp, 'a front, '//trim(arrangements(k)), error)
      if (allocated(error)) return
    end do
  end subroutine test_jumps

  !> A harmonic field, held on two walls and with convection on the others; and with radiation, for
  !> which Newton's method takes several steps.
  subroutine test_steady(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=*), parameter :: field = '300 + 20*exp(2*x)*sin(2*y)'
    character(len=*), parameter :: schemes(*) = [character(len=40) :: &
        'laplacian = "fatehi_manzari"', 'laplacian = "consistent" order = 4']
    real(wp), parameter :: jitters(*) = [0.0_wp, 0.3_wp]
    type(simulation_t) :: simulation
    integer :: k, j

    do k = 1, size(schemes)
      do j = 1, size(jitters)
        call run_scene('&scene exact_expression = "'//field//'" / &domain x_range = 0, 1 '// &
                       'y_range = 0, 1 arrangement = "jittered" spacing = 0.05 jitter = '// &
                       to_text(jitters(j))//' / &scheme '//trim(schemes(k))//' / '// &
                       '&boundary value_expression = "'//field//'" / &boundary on = "top" '// &
                       'kind = "convection" coefficient = 2 ambient_expression = "'//field// &
                       ' + 20*exp(2*x)*cos(2*y)" / &boundary on = "right" kind = "radiation" '// &
                       'emissivity = 0.9 ambient_expression = "(('//field//')^4 + '// &
                       '40*exp(2*x)*sin(2*y)/(0.9*5.670374419e-8))^0.25" / '// &
                       '&time steady = T / &accuracy estimate = T /', simulation, error)
        if (allocated(error)) return
        call judge(simulation, 1.5_wp, 'steady, '//trim(schemes(k))//', jitter '// &
                   to_text(jitters(j)), error)
        if (allocated(error)) return
      end do
    end do
  end subroutine test_steady

  !> A warm spot is carried round, by rows that go with it.
  subroutine test_rigid_motion(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=*), parameter :: spot = &
      '0.04/(0.04+0.004*t)*exp(-((x-0.4*cos(t))^2+(y-0.4*sin(t))^2)/(0.08+0.008*t))'
    character(len=30), parameter :: arrangements(*) = [character(len=30) :: &
        '"lattice"', '"jittered" jitter = 0.2', '"jittered" jitter = 0.3']
    character(len=*), &
        parameter :: schemes(*) = [character(len=30) :: 'laplacian="fatehi_manzari"', &
                                                 'laplacian="consistent" order=4']
    type(simulation_t) :: simulation
    integer :: j, k

    do k = 1, size(arrangements)
      do j = 1, size(schemes)
        call run_scene('&scene exact_expression = "'//spot//'" / '// &
                       '&domain shape = "disc" radius = 1 spacing = 0.07 arrangement = '// &
                       trim(arrangements(k))//' / &material conductivity = 0.002 / '// &
                       '&initial temperature_expression = "exp(-((x-0.4)^2+y^2)/0.08)" / '// &
                       '&boundary value_expression = "'//spot//'" / '// &
                       '&motion velocity_x_expression = "-y" velocity_y_expression = "x" / '// &
                       '&time end = 1.5 / &scheme '//trim(schemes(j))//' / '// &
                       '&accuracy estimate = T /', simulation, error)
        if (allocated(error)) return
        call judge(simulation, 3.0_wp, trim(schemes(j))//', '//trim(arrangements(k)), error)
        if (allocated(error)) return
      end do
    end do
  end subroutine test_rigid_motion

  !> A disc, insulated, that turns faster within than outside: a field that depends on the radius
  !> alone decays as at rest. With shifting, the field is carried to new places as well.
  subroutine test_shear(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=*), &
        parameter :: schemes(*) = [character(len=30) :: 'laplacian="fatehi_manzari"', &
                                                 'laplacian="consistent" order=4']
    character(len=*), parameter :: shifting(*) = ['F', 'T']
    type(simulation_t) :: simulation
    integer :: j, k

    do k = 1, size(shifting)
      do j = 1, size(schemes)
        call run_scene('&scene exact_expression = "j0(3.8317059702075123*sqrt(x*x+y*y))'// &
                       '*exp(-14.681970642123893*t)" / '// &
                       '&domain shape = "disc" radius = 1 spacing = 0.1 '// &
                       'arrangement = "jittered" jitter = 0.2 / '// &
                       '&initial temperature_expression = '// &
                       '"j0(3.8317059702075123*sqrt(x*x+y*y))" / '// &
                       '&boundary kind = "insulated" / '// &
                       '&motion velocity_x_expression = "-6*y*exp(-2*(x^2+y^2))" '// &
                       'velocity_y_expression = "6*x*exp(-2*(x^2+y^2))" shifting = '// &
                       shifting(k)//' / &time end = 0.05 / &scheme '//trim(schemes(j))//' / '// &
                       '&accuracy estimate = T /', simulation, error)
        if (allocated(error)) return
        call judge(simulation, 1.5_wp, trim(schemes(j))//', shifting '//shifting(k), error)
        if (allocated(error)) return
      end do
    end do
  end subroutine test_shear

  !> Where steps of the motion are long their error, that of rows which stay what they are in the
  !> middle, is a large part of all; the truth is a run with steps so short that none of it is left,
  !> less the error of space that is estimated for it.
  subroutine test_motion_steps(error)
    type(test_error), allocatable, intent(out) :: error
    type(simulation_t) :: coarse, fine
    real(wp), allocatable :: truth(:)
    real(wp) :: true_error, estimated, of_space

    call run_scene(swirl('0.005'), coarse, error)
    if (.not. allocated(error)) call run_scene(swirl('0.001'), fine, error)
    if (allocated(error)) return
    truth = fine%temperature + fine%error_estimate() - coarse%temperature
    true_error = norm2(truth)
    estimated = norm2(coarse%error_estimate())
    of_space = norm2(fine%error_estimate())
    call check(error, true_error > 1.2_wp*of_space, 'steps make no error to speak of')
    if (allocated(error)) return
    call check(error, estimated/true_error >= lowest .and. estimated/true_error <= highest, &
               'estimated '//to_text(estimated, digits=3)//', true '//to_text(true_error, digits=3))
    if (allocated(error)) return
    ! Not the size alone
    call check(error, norm2(coarse%error_estimate() - truth) < 0.35_wp*true_error)

  contains

    function swirl(step) result(text)
      character(len=*), intent(in) :: step
      character(len=:), allocatable :: text

      text = '&domain shape = "disc" radius = 1 spacing = 0.06 / '// &
             '&initial temperature_expression = "exp(-12*((x-0.2)^2+y^2))" / '// &
             '&boundary kind = "temperature" value = 0 / '// &
             '&motion velocity_x_expression = "-6*y*exp(-2*(x^2+y^2))" '// &
             'velocity_y_expression = "6*x*exp(-2*(x^2+y^2))" step = '//step//' / '// &
             '&time end = 0.02 tolerance = 1e-8 / &scheme laplacian = "consistent" order = 6 / '// &
             '&accuracy estimate = T /'
    end function swirl

  end subroutine test_motion_steps

  !> The one-phase Stefan problem. While the front passes a particle, errors come and go; what is
  !> estimated is the root of their mean square, here over the last passage of two spacings.
  subroutine test_melting(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=40), parameter :: arrangements(*) = [character(len=40) :: &
        '"lattice"', '"jittered" jitter = 0.2', '"jittered" jitter = 0.2 seed = 2', '"relaxed"']
    !> Stefan numbers, and λ of √π λ exp(λ²) erf(λ) = St
    character(len=12), parameter :: numbers(3) = [character(len=12) :: '0.1', '1', '5'], &
        lambdas(3) = [character(len=12) :: '0.2200162727', '0.6200626333', '1.0596870143']
    integer, parameter :: times = 32
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    real(wp) :: effectivity, square, lambda, front
    integer :: k, j, i

    do j = 1, size(numbers)
      lambda = real_of(lambdas(j))
      do k = 1, size(arrangements)
        call interpret_scene(stefan(trim(arrangements(k)), trim(numbers(j)), trim(lambdas(j))), &
                             scene, failure)
        if (.not. allocated(failure)) call simulation%prepare(scene, failure)
        square = 0
        do i = 0, times
          if (allocated(failure)) exit
          front = 0.56_wp + 0.04_wp*i/times
          call simulation%advance_to((front/(2*lambda))**2, failure)
          square = square + simulation%relative_l2_error()**2/(times + 1)
        end do
        if (allocated(failure)) then
          call check(error, .false., failure%message)
          return
        end if
        effectivity = simulation%estimated_error()/sqrt(square)
        call check(error, effectivity >= lowest .and. effectivity <= highest, trim(numbers(j))// &
                   trim(arrangements(k))//': estimated over true '//to_text(effectivity, digits=3))
        if (allocated(error)) return
      end do
    end do

  contains

    function stefan(arrangement, number, lambda) result(text)
      character(len=*), intent(in) :: arrangement, number, lambda
      character(len=:), allocatable :: text

      text = '&scene exact_expression = "(x<2*'//lambda//'*sqrt(t)) ? '// &
             '1-erf(x/(2*sqrt(t+1e-300)))/erf('//lambda//') : 0" / '// &
             '&domain x_range = 0, 1 y_range = 0, 0.2 spacing = 0.02 '// &
             'arrangement = '//arrangement//' / &material latent_heat = '// &
             to_text(1/real_of(number))//' solidus = 0 liquidus = 0 / '// &
             '&initial temperature = 0 / '// &
             '&boundary on = "all" kind = "insulated" / '// &
             '&boundary on = "left" kind = "temperature" value = 1 / '// &
             '&time end = '//to_text((0.3_wp/real_of(lambda))**2)//' / &accuracy estimate = T / '
    end function stefan

    pure function real_of(text) result(number)
      character(len=*), intent(in) :: text
      real(wp) :: number

      read (text, *) number
    end function real_of

  end subroutine test_melting

  !> In a steady state latent heat plays no part: the error is that of conduction.
  subroutine test_melting_steady(error)
    type(test_error), allocatable, intent(out) :: error
    type(simulation_t) :: simulation

    call run_scene('&scene exact_expression = "exp(x)*sin(y)" / '// &
                   '&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.05 '// &
                   'arrangement = "jittered" jitter = 0.2 / '// &
                   '&material latent_heat = 1 solidus = 0.5 liquidus = 0.6 / '// &
                   '&initial temperature = 0 / '// &
                   '&boundary on = "all" value_expression = "exp(x)*sin(y)" / '// &
                   '&time steady = T / &accuracy estimate = T / ', simulation, error)
    if (allocated(error)) return
    call judge(simulation, 3.0_wp, 'steady', error)
  end subroutine test_melting_steady

  subroutine test_refused(error)
    type(test_error), allocatable, intent(out) :: error

    call refuse('&accuracy target = 1e-3 /', 'too little to choose by')
    if (allocated(error)) return
    call refuse('&accuracy estimate = T / &output file = "a.vtkhdf" fields = "temperature", '// &
                '"temperature_corrected" /', 'not at any one time')

  contains

    subroutine refuse(groups, reason)
      character(len=*), intent(in) :: groups, reason
      type(scene_t) :: scene
      type(error_t), allocatable :: failure

      call interpret_scene('&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.1 / '// &
                           '&material latent_heat = 1 solidus = 0 liquidus = 0 / '// &
                           '&initial temperature = 0 / &boundary kind = "insulated" / '// &
                           '&time end = 1 / '//groups, scene, failure)
      call check(error, allocated(failure), groups//' was taken')
      if (allocated(error)) return
      call check(error, index(failure%message, reason) > 0, failure%message)
    end subroutine refuse

  end subroutine test_refused

  !> A quadratic field at rest: no error, and none is estimated.
  subroutine test_exact(error)
    type(test_error), allocatable, intent(out) :: error
    type(simulation_t) :: simulation

    call run_scene('&domain x_range = 0, 1 y_range = 0, 1 arrangement = "jittered" '// &
                   'spacing = 0.1 / &initial temperature_expression = "x^2 - y^2" / '// &
                   '&boundary value_expression = "x^2 - y^2" / &time end = 0.1 / '// &
                   '&accuracy estimate = T /', simulation, error)
    if (allocated(error)) return
    call check(error, simulation%estimated_error(), 0.0_wp, thr=1.0e-10_wp)
  end subroutine test_exact

  subroutine test_written(error)
    type(test_error), allocatable, intent(out) :: error
    character(len=*), parameter :: file = 'build/test/estimate.vtkhdf'
    type(simulation_t) :: simulation
    real(wp), allocatable :: estimate(:), field(:), corrected(:)

    call run_scene(plate('', 10, 0.2_wp, '')//'&output file = "'//file//'" '// &
                   'fields = "temperature", "temperature_corrected" /', simulation, error)
    if (allocated(error)) return
    estimate = reals_in_file(file, '/VTKHDF/PointData/error_estimate')
    field = reals_in_file(file, '/VTKHDF/PointData/temperature')
    corrected = reals_in_file(file, '/VTKHDF/PointData/temperature_corrected')
    call check(error, maxval(abs(estimate)) > 1.0e-3_wp)
    if (allocated(error)) return
    call check(error, maxval(abs(field + estimate - corrected)), 0.0_wp, thr=1.0e-12_wp)
    if (allocated(error)) return
    call check(error, maxval(abs(estimate(size(estimate)/2 + 1:))), &
               simulation%estimated_maximum_error(), thr=1.0e-15_wp)
  end subroutine test_written

  subroutine test_absent(error)
    type(test_error), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    character(len=:), allocatable :: text
    integer :: k

    text = plate('', 10, 0.2_wp, '')
    k = index(text, 'estimate = T')
    call run_scene(text(:k - 1)//'estimate = F / ', simulation, error)
    if (allocated(error)) return
    call check(error,.not. allocated(simulation%estimate))
  end subroutine test_absent

end module test_error_estimate
