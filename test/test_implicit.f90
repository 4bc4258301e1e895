!> Tests of what long steps are made of: sparse solvers, TR-BDF2 and the exponential propagator.
module test_implicit
  use calor_bicgstab, only: solve_by_bicgstab
  use calor_error, only: error_t
  use calor_evolution, only: evolution_t
  use calor_exponential, only: exponential_terms, part_left
  use calor_implicit_system, only: implicit_system_t
  use calor_incomplete_factors, only: incomplete_factors_t
  use calor_integrator, only: integrator_t
  use calor_integrators, only: make_integrator
  use calor_kinds, only: wp, i8
  use calor_method_choice, only: problem_t, method_cost_t, pilot_t, exponential_cost, &
                                 tr_bdf2_cost, rkl2_cost, run_pilot, steps_ahead
  use calor_random, only: random_uniform
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene
  use calor_simulation, only: simulation_t
  use calor_stepper_study, only: stepper_scene, stepper_scene_name, stepper_scenes
  use calor_sparse_matrix, only: sparse_matrix_t
  use calor_stepper, only: stepper_t
  use calor_text, only: to_text
  use calor_umfpack, only: factorisation_t
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_implicit

  !> u' = A u + cubic u³ + b(t), A being tridiagonal: -(2 + off) on its diagonal, times `rate`;
  !> with `held`, the first entry is sin t. b is such that u = c + sin t everywhere is a solution.
  type, extends(evolution_t) :: chain_t
    integer :: n = 1
    real(wp) :: stiffness = 1.0_wp, cubic = 0.0_wp, skew = 0.0_wp, forcing = 1.0_wp
    logical :: held = .false.
    real(wp), allocatable :: slope(:)
  contains
    procedure :: unknowns
    procedure :: rate
    procedure :: jacobian_product
    procedure :: impose
    procedure :: clear_prescribed
    procedure :: inspect
    procedure :: linearise
    procedure :: jacobian_rows
    procedure :: is_linear
    procedure :: depends_on_time
  end type chain_t

  character(len=*), parameter :: lf = new_line('a')

contains

  subroutine collect_implicit(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('a sparse matrix from entries in any order', test_matrix), &
                new_unittest('incomplete factors of a full pattern are the factors', &
                             test_incomplete), &
                new_unittest('BiCGSTAB finds what UMFPACK finds', test_bicgstab), &
                new_unittest('BiCGSTAB says that it did not converge', test_no_convergence), &
                new_unittest('factors are made anew only for a new step', test_reuse), &
                new_unittest('a copy of factors solves, too', test_copy), &
                new_unittest('TR-BDF2 is of second order', test_order), &
                new_unittest('TR-BDF2 is exact for quadratic polynomials in time', &
                             test_quadratic), &
                new_unittest('TR-BDF2 is L-stable', test_stiff), &
                new_unittest('the error estimate of TR-BDF2 is the error', test_estimate), &
                new_unittest('TR-BDF2 keeps the tolerance', test_control), &
                new_unittest('Newton''s method inside a step', test_newton), &
                new_unittest('prescribed values are met at every stage', test_prescribed), &
                new_unittest('the exponential is exact for any step', test_exponential), &
                new_unittest('the exponential, asked for too much', test_rounding), &
                new_unittest('the exponential off the real axis', test_off_axis), &
                new_unittest('the exponential refuses what it cannot do', test_refusal), &
                new_unittest('the number of terms is foreseen', test_terms), &
                new_unittest('a thousand times the explicit limit', test_long_step), &
                new_unittest('all methods agree in a scene', test_agreement), &
                new_unittest('iteration and factors in a scene', test_iterative_scene), &
                new_unittest('a scene without memory for factors', test_little_memory), &
                new_unittest('no heat is lost by implicit steps', test_conservation), &
                new_unittest('the cheapest method is taken', test_choice), &
                new_unittest('steps of a problem that changes are foreseen as equal', &
                             test_changing), &
                new_unittest('steps are limited by the tolerance or by stability', &
                             test_limited_steps), &
                new_unittest('steps and products are foreseen within a factor of 1.5', &
                             test_foresight), &
                new_unittest('what a method does not take is refused', test_refused_scenes) &
                ]
  end subroutine collect_implicit

  subroutine test_matrix(error)
    type(error_type), allocatable, intent(out) :: error
    type(sparse_matrix_t) :: matrix, shifted
    real(wp) :: product(3)

    ! [1 2+3 0; 0 0 4; 5 0 0]
    call matrix%assemble([1, 4, 5, 6], [2, 1, 2, 3, 1], [2.0_wp, 1.0_wp, 3.0_wp, 4.0_wp, 5.0_wp])
    call check(error, all(matrix%index == [1, 2, 2, 3, 1, 3]))
    if (allocated(error)) return
    call check(error, all(matrix%diagonal == [1, 3, 6]))
    if (allocated(error)) return
    call matrix%multiply([1.0_wp, 10.0_wp, 100.0_wp], product)
    call check(error, all(abs(product - [51.0_wp, 400.0_wp, 5.0_wp]) < 1.0e-12_wp))
    if (allocated(error)) return
    call shifted%become_shifted(matrix, 2.0_wp)
    call shifted%multiply([1.0_wp, 10.0_wp, 100.0_wp], product)
    call check(error, all(abs(product - [1 - 102.0_wp, 10 - 800.0_wp, 100 - 10.0_wp]) < 1.0e-12_wp))
  end subroutine test_matrix

  !> Without fill that could be dropped ILU(0) is the LU factorisation.
  subroutine test_incomplete(error)
    type(error_type), allocatable, intent(out) :: error
    type(sparse_matrix_t) :: matrix
    type(incomplete_factors_t) :: factors
    integer, parameter :: n = 12
    integer :: first(n + 1), k
    real(wp) :: value(n*n), x(n), b(n), solution(n)
    logical :: done

    first = [(1 + n*(k - 1), k=1, n + 1)]
    value = [(random_uniform(1, int(k, i8)) - 0.5_wp, k=1, n*n)]
    do k = 1, n
      value(n*(k - 1) + k) = 2*n
    end do
    call matrix%assemble(first, [(mod(k - 1, n) + 1, k=1, n*n)], value)
    call factors%factorise(matrix, done)
    call check(error, done)
    if (allocated(error)) return
    x = [(real(k, wp), k=1, n)]
    call matrix%multiply(x, b)
    call factors%solve(b, solution)
    call check(error, maxval(abs(solution - x)) < 1.0e-12_wp)
    if (allocated(error)) return
    call matrix%assemble([1, 2, 3], [2, 1], [1.0_wp, 1.0_wp])
    call factors%factorise(matrix, done)
    call check(error,.not. done, 'a pivot of 0')
  end subroutine test_incomplete

  !> On an irregular cloud, orders 2 to 8, for steps up to a thousand times the explicit limit.
  subroutine test_bicgstab(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(implicit_system_t) :: direct, iterative
    integer, allocatable :: first(:), index(:)
    real(wp), allocatable :: value(:), b(:), x(:), y(:)
    real(wp) :: shift
    integer :: order, k, length
    logical :: known, done

    do order = 2, 8, 2
      call prepare_scene('laplacian = ''consistent'' order = '//to_text(order), &
                         'end = 1 method = ''forward_euler''', simulation, error)
      if (allocated(error)) return
      call simulation%conduction%jacobian_rows(first, index, value, known)
      call check(error, known)
      if (allocated(error)) return
      b = [(random_uniform(2, int(k, i8)), k=1, simulation%conduction%unknowns())]
      allocate (x(size(b)), y(size(b)))
      iterative%iterative = .true.
      call direct%load(first, index, value)
      call iterative%load(first, index, value)
      do length = 0, 3
        shift = 2*10.0_wp**length/simulation%stepper%spectral_radius
        call direct%set_shift(shift, done)
        call direct%solve(b, 0.0_wp, x, done)
        call check(error, done)
        if (allocated(error)) return
        call iterative%set_shift(shift, done)
        call iterative%solve(b, 1.0e-11_wp, y, done)
        call check(error, done, 'converged')
        if (allocated(error)) return
        ! The residual, times the norm of an inverse that is at most about 1
        call check(error, maxval(abs(x - y)) < 1.0e-8_wp)
        if (allocated(error)) return
      end do
      call direct%set_steady(done)
      call direct%solve(b, 0.0_wp, x, done)
      call iterative%set_steady(done)
      call iterative%solve(b, 1.0e-9_wp, y, done)
      call check(error, done .and. maxval(abs(x - y)) < 1.0e-7_wp, 'steady, order '//to_text(order))
      if (allocated(error)) return
      deallocate (x, y)
    end do
  end subroutine test_bicgstab

  subroutine test_no_convergence(error)
    type(error_type), allocatable, intent(out) :: error
    type(chain_t) :: chain
    type(sparse_matrix_t) :: matrix
    type(incomplete_factors_t) :: factors
    integer, allocatable :: first(:), index(:)
    real(wp), allocatable :: value(:)
    real(wp) :: x(50), b(50)
    integer :: iterations
    logical :: known, done

    chain%n = 50
    chain%skew = 0.9_wp
    call chain%jacobian_rows(first, index, value, known)
    call matrix%assemble(first, index, value)
    ! A preconditioner of another matrix is none.
    call factors%factorise(unit_matrix(50), done)
    b = 1
    x = 0
    call solve_by_bicgstab(matrix, factors, b, 1.0e-12_wp, 3, x, iterations, done)
    call check(error,.not. done .and. iterations == 3)
    if (allocated(error)) return
    call solve_by_bicgstab(matrix, factors, b, 1.0e-10_wp, 2000, x, iterations, done)
    call check(error, done)
    if (allocated(error)) return
    ! A singular matrix and a right side out of its range
    matrix%value = 0
    call solve_by_bicgstab(matrix, factors, b, 1.0e-12_wp, 50, x, iterations, done)
    call check(error,.not. done)
  end subroutine test_no_convergence

  function unit_matrix(n) result(matrix)
    integer, intent(in) :: n
    type(sparse_matrix_t) :: matrix
    integer :: k

    call matrix%assemble([(k, k=1, n + 1)], [(k, k=1, n)], [(1.0_wp, k=1, n)])
  end function unit_matrix

  subroutine test_reuse(error)
    type(error_type), allocatable, intent(out) :: error
    type(implicit_system_t) :: system
    logical :: done

    call load_chain(system)
    call system%set_shift(0.1_wp, done)
    call system%set_shift(0.1_wp*(1 + 1.0e-14_wp), done)
    call check(error, system%factorisations, 1)
    if (allocated(error)) return
    call system%set_shift(0.2_wp, done)
    call check(error, system%factorisations, 2)
  end subroutine test_reuse

  subroutine load_chain(system)
    type(implicit_system_t), intent(inout) :: system
    type(chain_t) :: chain
    integer, allocatable :: first(:), index(:)
    real(wp), allocatable :: value(:)
    logical :: known

    chain%n = 30
    call chain%jacobian_rows(first, index, value, known)
    call system%load(first, index, value)
  end subroutine load_chain

  subroutine test_copy(error)
    type(error_type), allocatable, intent(out) :: error
    type(implicit_system_t), allocatable :: system, copy
    real(wp) :: b(30), x(30), y(30)
    logical :: done

    allocate (system)
    call load_chain(system)
    call system%set_shift(0.1_wp, done)
    b = 1
    call system%solve(b, 0.0_wp, x, done)
    copy = system
    deallocate (system)
    call copy%solve(b, 0.0_wp, y, done)
    if (.not. done) then
      call copy%set_shift(0.1_wp, done)
      call copy%solve(b, 0.0_wp, y, done)
    end if
    call check(error, done .and. maxval(abs(x - y)) < 1.0e-14_wp)
  end subroutine test_copy

  !> Observed order, for a linear and for a nonlinear problem
  subroutine test_order(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: deviation(3)
    type(chain_t) :: chain
    integer :: k, kind

    chain%n = 5
    do kind = 0, 1
      chain%cubic = -real(kind, wp)
      do k = 1, 3
        deviation(k) = maxval(abs(after(chain, 'tr_bdf2', 10*2**k, 1.0_wp) - &
                                  after(chain, 'tr_bdf2', 1280, 1.0_wp)))
      end do
      call check(error, log(deviation(2)/deviation(3))/log(2.0_wp), 2.0_wp, thr=0.1_wp)
      if (allocated(error)) return
    end do
  end subroutine test_order

  !> The state after equal steps, from 1 everywhere and a bump
  function after(chain, method, steps, end_time) result(u)
    type(chain_t), intent(inout) :: chain
    character(len=*), intent(in) :: method
    integer, intent(in) :: steps
    real(wp), intent(in) :: end_time
    real(wp) :: u(chain%n)
    class(integrator_t), allocatable :: integrator
    type(error_t), allocatable :: failure
    real(wp) :: next(chain%n), estimate
    integer :: k

    call make_integrator(method, integrator, failure)
    u = 1
    u(chain%n) = 1.5_wp
    call chain%impose(0.0_wp, u)
    do k = 1, steps
      call integrator%advance(chain, (k - 1)*end_time/steps, end_time/steps, 4*chain%stiffness, u, &
                              next, estimate)
      call integrator%accept()
      u = next
    end do
  end function after

  !> Stages of second order and quadrature of second order: u' = b(t), b linear, is met exactly.
  subroutine test_quadratic(error)
    type(error_type), allocatable, intent(out) :: error
    type(chain_t) :: chain
    real(wp) :: u(1), next(1), estimate
    class(integrator_t), allocatable :: integrator
    type(error_t), allocatable :: failure

    chain%n = 1
    chain%stiffness = 0
    chain%forcing = -1
    call make_integrator('tr_bdf2', integrator, failure)
    u = 3
    ! With a negative forcing b is 1 + 2 t.
    call integrator%advance(chain, 0.5_wp, 2.0_wp, 1.0_wp, u, next, estimate)
    call check(error, next(1), 3 + (2.5_wp + 2.5_wp**2) - (0.5_wp + 0.5_wp**2), thr=1.0e-13_wp)
    if (allocated(error)) return
    call check(error, estimate, 0.0_wp, thr=1.0e-13_wp)
  end subroutine test_quadratic

  !> R(∞) = 0: in one huge step, whatever is stiff is gone. R(z) → c/z with
  !> c = -(w (1/d) ... ), found by the stability function itself.
  subroutine test_stiff(error)
    type(error_type), allocatable, intent(out) :: error
    type(chain_t) :: chain
    real(wp) :: u(1), next(1), estimate, z, gamma, expected
    class(integrator_t), allocatable :: integrator
    type(error_t), allocatable :: failure
    integer :: k

    chain%n = 1
    chain%forcing = 0
    gamma = 2 - sqrt(2.0_wp)
    do k = 0, 12, 4
      z = -10.0_wp**k
      chain%stiffness = -z/2
      call make_integrator('tr_bdf2', integrator, failure)
      u = 1
      call integrator%advance(chain, 0.0_wp, 1.0_wp, -z, u, next, estimate)
      ! R(z) = (2(1-γ)... ) of Bank et al.: [(1 + (1-γ)²) z + 2 (2-γ)]/[z² (1-γ) γ + z (γ²-2) + 2
      ! (2-γ)]
      expected = ((1 + (1 - gamma)**2)*z + 2*(2 - gamma))/ &
                 (z**2*(1 - gamma)*gamma + z*(gamma**2 - 2) + 2*(2 - gamma))
      call check(error, next(1), expected, thr=1.0e-12_wp)
      if (allocated(error)) return
      call check(error, abs(next(1)) <= 1 .and. estimate <= 2, 'bounded')
      if (allocated(error)) return
    end do
    call check(error, abs(next(1)) < 1.0e-11_wp)
  end subroutine test_stiff

  subroutine test_estimate(error)
    type(error_type), allocatable, intent(out) :: error
    type(chain_t) :: chain
    real(wp) :: u(1), next(1), estimate, total(1)
    class(integrator_t), allocatable :: integrator
    type(error_t), allocatable :: failure

    chain%n = 1
    chain%stiffness = 0.5_wp
    chain%forcing = 0
    call make_integrator('tr_bdf2', integrator, failure)
    u = 1
    call integrator%advance(chain, 0.0_wp, 0.02_wp, 1.0_wp, u, next, estimate)
    ! Wrong by one power of the step: 2 %, times the ratio of two constants
    call check(error, estimate/abs(next(1) - exp(-0.02_wp)), 1.0_wp, thr=0.05_wp)
    if (allocated(error)) return
    total = 0
    call integrator%accept()
    call integrator%add_step_error(0.02_wp, total)
    call check(error, total(1)/(exp(-0.02_wp) - next(1)), 1.0_wp, thr=0.05_wp)
  end subroutine test_estimate

  subroutine test_control(error)
    type(error_type), allocatable, intent(out) :: error
    type(chain_t) :: chain
    type(stepper_t) :: stepper
    type(error_t), allocatable :: failure
    real(wp) :: u(20), time, truth(20)
    integer :: k, earlier

    chain%n = 20
    chain%stiffness = 1000
    earlier = 0
    truth = after(chain, 'tr_bdf2', 20000, 1.0_wp)
    do k = 4, 8, 2
      stepper = stepper_t()
      call make_integrator('tr_bdf2', stepper%integrator, failure)
      stepper%spectral_radius = 4000
      stepper%longest_step = stepper%integrator%longest_stable_step(4000.0_wp)
      stepper%tolerance = 10.0_wp**(-k)
      time = 0
      u = 1
      u(20) = 1.5_wp
      call stepper%advance_to(chain, time, 0.3_wp, u, failure)
      call check(error,.not. allocated(failure))
      if (allocated(error)) return
      call stepper%advance_to(chain, time, 1.0_wp, u, failure)
      call check(error, time, 1.0_wp)
      if (allocated(error)) return
      call check(error, maxval(abs(u - truth)) < stepper%steps*stepper%tolerance)
      if (allocated(error)) return
      ! A hundredth of the tolerance takes up to 100^(1/3) = 4.6 times the steps.
      if (earlier > 0) call check(error, stepper%steps > 2*earlier .and. stepper%steps < 8*earlier)
      if (allocated(error)) return
      earlier = stepper%steps
    end do
  end subroutine test_control

  !> u' = -u³: u = 1/√(1 + 2t), by long steps that one Jacobian does not serve for.
  subroutine test_newton(error)
    type(error_type), allocatable, intent(out) :: error
    type(chain_t) :: chain
    real(wp) :: u(1), next(1), estimate, z, f, g
    class(integrator_t), allocatable :: integrator
    type(error_t), allocatable :: failure
    real(wp), parameter :: d = 1 - sqrt(0.5_wp), w = sqrt(0.125_wp), step = 10.0_wp

    chain%n = 1
    chain%stiffness = 0
    chain%forcing = 0
    chain%cubic = -1
    call make_integrator('tr_bdf2', integrator, failure)
    u = 1
    call integrator%advance(chain, 0.0_wp, step, 1.0_wp, u, next, estimate)
    call check(error,.not. allocated(integrator%failure))
    if (allocated(error)) return
    ! The stages' equations, each solved by bisection
    f = 1 - d*step
    z = root_of(d*step, f)
    g = 1 - w*step*(1 + z**3)
    call check(error, next(1), root_of(d*step, g), thr=1.0e-9_wp)
  end subroutine test_newton

  !> u + a u³ = f
  pure function root_of(a, f) result(u)
    real(wp), intent(in) :: a, f
    real(wp) :: u
    real(wp) :: low, high
    integer :: k

    low = -abs(f) - 1
    high = abs(f) + 1
    do k = 1, 80
      u = 0.5_wp*(low + high)
      if (u + a*u**3 > f) then
        high = u
      else
        low = u
      end if
    end do
  end function root_of

  subroutine test_prescribed(error)
    type(error_type), allocatable, intent(out) :: error
    type(chain_t) :: chain
    real(wp) :: u(6), fine(6), coarse(6)

    chain%n = 6
    chain%held = .true.
    chain%stiffness = 10
    coarse = after(chain, 'tr_bdf2', 20, 1.0_wp)
    u = after(chain, 'tr_bdf2', 40, 1.0_wp)
    fine = after(chain, 'tr_bdf2', 2000, 1.0_wp)
    call check(error, u(1), sin(1.0_wp), thr=1.0e-14_wp)
    if (allocated(error)) return
    ! Imposed at each stage's own time, they leave the order alone.
    call check(error, log(maxval(abs(coarse - fine))/maxval(abs(u - fine)))/log(2.0_wp), 2.0_wp, &
               thr=0.2_wp)
  end subroutine test_prescribed

  !> One step against many, and against the implicit method.
  subroutine test_exponential(error)
    type(error_type), allocatable, intent(out) :: error
    type(chain_t) :: chain
    real(wp) :: one(20), ten(20), other(20)
    real(wp), parameter :: stiffness(3) = [0.01_wp, 10.0_wp, 1.0e4_wp]
    integer :: k

    chain%n = 20
    chain%forcing = 0
    do k = 1, size(stiffness)
      chain%stiffness = stiffness(k)
      one = after(chain, 'exponential', 1, 1.0_wp)
      ten = after(chain, 'exponential', 10, 1.0_wp)
      call check(error, maxval(abs(one - ten)) < 1.0e-11_wp, to_text(maxval(abs(one - ten))))
      if (allocated(error)) return
    end do
    chain%stiffness = 1
    one = after(chain, 'exponential', 1, 1.0_wp)
    other = after(chain, 'runge_kutta_4', 1000, 1.0_wp)
    call check(error, maxval(abs(one - other)) < 1.0e-12_wp, to_text(maxval(abs(one - other))))
  end subroutine test_exponential

  !> Shorter steps would not bring the digits that numbers do not have.
  subroutine test_rounding(error)
    type(error_type), allocatable, intent(out) :: error
    type(chain_t) :: chain
    type(stepper_t) :: stepper
    type(error_t), allocatable :: failure
    real(wp) :: u(20), time

    chain%n = 20
    chain%stiffness = 10
    chain%forcing = 0
    call make_integrator('exponential', stepper%integrator, failure)
    stepper%spectral_radius = 4*chain%stiffness
    stepper%longest_step = stepper%integrator%longest_stable_step(stepper%spectral_radius)
    stepper%tolerance = 1.0e-30_wp
    time = 0
    u = 1
    u(20) = 1.5_wp
    call stepper%advance_to(chain, time, 1.0_wp, u, failure, at_most=10)
    call check(error, .not. allocated(failure))
    if (allocated(error)) return
    call check(error, stepper%steps, 1)
    if (allocated(error)) return
    call check(error, maxval(abs(u - after(chain, 'exponential', 10, 1.0_wp))) < 1.0e-12_wp)
  end subroutine test_rounding

  !> With an unsymmetric chain the polynomials of an interval grow: a higher ellipse is found, and
  !> the result keeps the tolerance.
  subroutine test_off_axis(error)
    type(error_type), allocatable, intent(out) :: error
    type(chain_t) :: chain
    type(stepper_t) :: stepper
    type(error_t), allocatable :: failure
    real(wp) :: u(40), time, truth(40)

    chain%n = 40
    chain%skew = 3
    chain%stiffness = 300
    chain%forcing = 0
    truth = after(chain, 'runge_kutta_4', 20000, 1.0_wp)
    call make_integrator('exponential', stepper%integrator, failure)
    stepper%spectral_radius = 4*chain%stiffness
    stepper%longest_step = stepper%integrator%longest_stable_step(stepper%spectral_radius)
    stepper%tolerance = 1.0e-8_wp
    time = 0
    u = 1
    u(40) = 1.5_wp
    call stepper%advance_to(chain, time, 1.0_wp, u, failure)
    call check(error,.not. allocated(failure))
    if (allocated(error)) return
    ! A step of its own length, on an interval, would lose all digits: polynomials grow as exp(k).
    call check(error, stepper%integrator%evaluations < 2000, &
               to_text(stepper%integrator%evaluations)//' evaluations')
    if (allocated(error)) return
    call check(error, maxval(abs(u - truth)) < stepper%steps*stepper%tolerance, &
               to_text(maxval(abs(u - truth))))
  end subroutine test_off_axis

  subroutine test_refusal(error)
    type(error_type), allocatable, intent(out) :: error
    type(chain_t) :: chain
    type(stepper_t) :: stepper
    type(error_t), allocatable :: failure
    real(wp) :: u(3), time

    chain%n = 3
    call make_integrator('exponential', stepper%integrator, failure)
    stepper%spectral_radius = 4
    stepper%longest_step = 0.1_wp
    time = 0
    u = 1
    call stepper%advance_to(chain, time, 1.0_wp, u, failure)
    call check(error, allocated(failure))
    if (allocated(error)) return
    call check(error, index(failure%message, 'changes with time') > 0, failure%message)
  end subroutine test_refusal

  !> Terms taken against terms foreseen, for problems soft and stiff
  subroutine test_terms(error)
    type(error_type), allocatable, intent(out) :: error
    type(chain_t) :: chain
    class(integrator_t), allocatable :: integrator
    type(error_t), allocatable :: failure
    real(wp), allocatable :: u(:), next(:)
    real(wp) :: estimate, foreseen
    integer :: k, digits

    chain%n = 200
    chain%forcing = 0
    allocate (u(200), next(200))
    u = [(random_uniform(3, int(k, i8)), k=1, 200)]
    do k = 0, 4
      do digits = 3, 9, 3
        chain%stiffness = 10.0_wp**k
        call make_integrator('exponential', integrator, failure)
        integrator%tolerance = 10.0_wp**(-digits)
        call integrator%advance(chain, 0.0_wp, 1.0_wp, 4*chain%stiffness, u, next, estimate)
        foreseen = exponential_terms(4*chain%stiffness, part_left*integrator%tolerance/ &
                                     chain%stiffness, 0.0_wp)
        call check(error, integrator%evaluations/foreseen < 1.5_wp .and. &
                   integrator%evaluations/foreseen > 1/1.5_wp, &
                   to_text(integrator%evaluations)//' terms, not '//to_text(foreseen))
        if (allocated(error)) return
        call check(error, estimate <= integrator%tolerance)
        if (allocated(error)) return
      end do
    end do
  end subroutine test_terms

  !> A step of 1000 times what forward Euler could take, on an irregular cloud: what comes out lies
  !> in the range of what went in, and slow modes decay as they should.
  subroutine test_long_step(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    real(wp) :: limit

    call prepare_scene('laplacian = ''fatehi_manzari''', 'end = 1 method = ''forward_euler''', &
                       simulation, error)
    if (allocated(error)) return
    limit = simulation%stability_limit
    call prepare_scene('laplacian = ''fatehi_manzari''', 'end = '//to_text(5000*limit)// &
                       ' method = ''tr_bdf2'' step = '//to_text(1000*limit), simulation, error)
    if (allocated(error)) return
    call simulation%run(failure)
    call check(error,.not. allocated(failure))
    if (allocated(error)) return
    call check(error, simulation%stepper%steps, 5)
    if (allocated(error)) return
    call check(error, maxval(abs(simulation%temperature)) < 1.0e-2_wp)
  end subroutine test_long_step

  !> TR-BDF2, the exponential and RKL2 in scenes with each kind of wall and effect.
  subroutine test_agreement(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    real(wp), allocatable :: expected(:)
    real(wp), parameter :: tolerance = 1.0e-7_wp
    character(len=160), parameter :: extra(5) = [character(len=160) :: &
        '', &
        '&boundary on = ''left'' kind = ''temperature'' value_expression = ''sin(20*t)'' /', &
        '&source power_expression = ''10*(1 - T)'' /', &
        '&boundary on = ''right'' kind = ''convection'' coefficient = 5 ambient = 1 /', &
        '&boundary on = ''right'' kind = ''radiation'' emissivity = 0.9 ambient = 600 /']
    character(len=11), parameter :: methods(3) = [character(len=11) :: &
                                                  'rkl2', 'tr_bdf2', 'exponential']
    integer :: k, m

    do k = 1, size(extra)
      do m = 1, size(methods)
        if (m == 3 .and. (k == 2 .or. k == 3 .or. k == 5)) cycle
        call prepare_scene('laplacian = ''fatehi_manzari''', 'end = 0.05 tolerance = 1e-7 '// &
                           'method = '''//trim(methods(m))//'''', simulation, error, trim(extra(k)))
        if (allocated(error)) return
        call simulation%run(failure)
        if (allocated(failure)) call test_failed(error, failure%message)
        if (allocated(error)) return
        if (m == 1) then
          expected = simulation%temperature
        else
          ! Each has made errors of up to the tolerance in each of its steps.
          call check(error, maxval(abs(simulation%temperature - expected)) < &
                     200*tolerance*simulation%conduction%temperature_scale(), &
                     trim(methods(m))//' in scene '//to_text(k)//': '// &
                     to_text(maxval(abs(simulation%temperature - expected))))
          if (allocated(error)) return
        end if
      end do
    end do
  end subroutine test_agreement

  !> From figures alone: the series where it is short, factors where it is long or cannot be had.
  subroutine test_choice(error)
    type(error_type), allocatable, intent(out) :: error
    type(problem_t) :: problem
    type(method_cost_t) :: series, factors, stages

    problem%rows = 1600
    problem%entries = 20000
    problem%spectral_radius = 1.0e4_wp
    problem%tolerance = 1.0e-6_wp
    problem%linear = .true.
    problem%duration = 0.05_wp
    series = exponential_cost(problem, 0.0_wp)
    factors = tr_bdf2_cost(problem, 40.0_wp)
    stages = rkl2_cost(problem, 40.0_wp)
    call check(error, series%seconds < stages%seconds .and. stages%seconds < factors%seconds)
    if (allocated(error)) return
    ! √(2 λ T steps) products
    call check(error, stages%products, sqrt(2*500*40.0_wp), thr=0.3_wp, rel=.true.)
    if (allocated(error)) return
    ! Far beyond the slowest decay steps are long, and factors pay.
    problem%duration = 1.0e4_wp
    series = exponential_cost(problem, 0.0_wp)
    factors = tr_bdf2_cost(problem, 60.0_wp)
    stages = rkl2_cost(problem, 60.0_wp)
    call check(error, factors%seconds < series%seconds .and. factors%seconds < stages%seconds)
    if (allocated(error)) return
    ! Outputs are ends of series.
    problem%duration = 0.05_wp
    problem%parts = 10
    series = exponential_cost(problem, 0.0_wp)
    call check(error, series%steps, 10.0_wp)
    if (allocated(error)) return
    call check(error, series%products > 2*sqrt(10.0_wp), 'products of all parts')
  end subroutine test_choice

  !> Products for a smooth start; steps where a wall is heated at once, within a factor of 2 only,
  !> as the age of that follows from twelve of them.
  subroutine test_foresight(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    real(wp) :: foreseen, taken
    character(len=90), parameter :: times(4) = [character(len=90) :: 'end = 0.01', 'end = 0.1', &
                                                'end = 0.1 tolerance = 1e-9', 'end = 2']
    integer :: k

    do k = 1, size(times)
      call prepare_scene('laplacian = ''fatehi_manzari''', trim(times(k)), simulation, error)
      if (allocated(error)) return
      call check(error, simulation%method, 'exponential')
      if (allocated(error)) return
      foreseen = simulation%choice%costs(1)%products
      call simulation%run(failure)
      taken = simulation%stepper%integrator%evaluations
      call check(error, foreseen < 1.5_wp*taken .and. taken < 1.5_wp*foreseen, trim(times(k))// &
                 ': '//to_text(foreseen, &
                               digits=4)//' products foreseen, '//to_text(taken)//' taken')
      if (allocated(error)) return
    end do
    call check_steps('&boundary on = ''right'' kind = ''radiation'' emissivity = 0.9 ambient = '// &
                     '600 /', 'end = 0.5', 1.5_wp)
    if (allocated(error)) return
    ! Off the real axis, and from a jump; what counts is that no series is summed twice.
    call check_scene(2)
    if (allocated(error)) return
    call check_scene(6)
    if (allocated(error)) return
    ! Three series, of which the first leaves next to nothing
    call check_scene(7)
    if (allocated(error)) return
    ! Radiation, also in fourth order, what swings, and two materials
    do k = 9, stepper_scenes
      call check_scene(k)
      if (allocated(error)) return
    end do

  contains

    !> Products of the chosen method in a scene of the study
    subroutine check_scene(number)
      integer, intent(in) :: number
      type(simulation_t) :: other
      type(scene_t) :: scene

      call interpret_scene(stepper_scene(number, 'auto'), scene, failure)
      if (.not. allocated(failure)) call other%prepare(scene, failure)
      if (.not. allocated(failure)) call other%run(failure)
      if (allocated(failure)) call test_failed(error, failure%message)
      if (allocated(error)) return
      foreseen = other%choice%costs(1)%products
      taken = other%stepper%integrator%evaluations
      call check(error, foreseen < 1.5_wp*taken .and. taken < 1.5_wp*foreseen, &
                 stepper_scene_name(number)//': '//to_text(foreseen, digits=4)// &
                 ' products foreseen, '//to_text(taken)//' taken')
    end subroutine check_scene

    !> Steps of TR-BDF2 against those of the model, from the first ones of RKL2
    subroutine check_steps(extra, time, factor)
      character(len=*), intent(in) :: extra, time
      real(wp), intent(in) :: factor
      type(simulation_t) :: other
      type(problem_t) :: problem
      type(pilot_t) :: pilot

      call prepare_scene('laplacian = ''fatehi_manzari''', time//' method = ''rkl2''', other, &
                         error, &
                         extra)
      if (allocated(error)) return
      problem%spectral_radius = other%stepper%spectral_radius
      problem%duration = other%scene%time%end
      call run_pilot(problem, other%conduction, other%stepper, other%temperature, pilot)
      foreseen = steps_ahead(problem, pilot)
      call other%run(failure)
      taken = other%stepper%steps
      call check(error, foreseen < factor*taken .and. taken < factor*foreseen, extra//': '// &
                 to_text(foreseen, digits=4)//' steps foreseen, '//to_text(taken)//' taken')
    end subroutine check_steps

  end subroutine test_foresight

  subroutine test_refused_scenes(error)
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    character(len=*), parameter :: body = &
      '&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.1 / &initial temperature = 1 / '

    call interpret_scene(body//'&boundary on = ''all'' value_expression = ''t'' / '// &
                         '&time end = 1 method = ''exponential'' /', scene, failure)
    call simulation%prepare(scene, failure)
    call check(error, allocated(failure))
    if (allocated(error)) return
    call check(error, index(failure%message, 'do not change with time') > 0, failure%message)
    if (allocated(error)) return
    call interpret_scene(body//'&material conductivity = 1 density = 1 heat_capacity = 1 '// &
                         'latent_heat = 1 solidus = 0.4 liquidus = 0.6 / '// &
                         '&boundary on = ''all'' value = 0 / '// &
                         '&time end = 1 method = ''tr_bdf2'' /', scene, failure)
    call check(error,.not. allocated(failure))
    if (allocated(error)) return
    call simulation%prepare(scene, failure)
    call check(error, allocated(failure))
    if (allocated(error)) return
    call check(error, index(failure%message, 'latent heat') > 0, failure%message)
  end subroutine test_refused_scenes

  !> Implicit steps without factors
  subroutine test_iterative_scene(error)
    type(error_type), allocatable, intent(out) :: error
    type(chain_t) :: chain
    real(wp) :: direct(60), next(60), u(60), estimate
    type(error_t), allocatable :: failure
    class(integrator_t), allocatable :: integrator

    chain%n = 60
    chain%stiffness = 100
    direct = after(chain, 'tr_bdf2', 1, 0.1_wp)
    call make_integrator('tr_bdf2', integrator, failure)
    call force_iteration(integrator)
    u = 1
    u(60) = 1.5_wp
    call integrator%advance(chain, 0.0_wp, 0.1_wp, 400.0_wp, u, next, estimate)
    call check(error, maxval(abs(next - direct)) < 1.0e-10_wp)
  end subroutine test_iterative_scene

  !> A whole run, where factors may take a thousand bytes: BiCGSTAB takes over, and gives the same.
  subroutine test_little_memory(error)
    use calor_tr_bdf2, only: tr_bdf2_t
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation, direct
    type(error_t), allocatable :: failure
    character(len=*), parameter :: time = 'end = 0.05 tolerance = 1e-7 method = ''tr_bdf2'''
    character(len=*), parameter :: scheme = 'laplacian = ''consistent'' order = 4'

    call prepare_scene(scheme, time, direct, error)
    if (allocated(error)) return
    call direct%run(failure)
    call prepare_scene(scheme, time, simulation, error)
    if (allocated(error)) return
    call make_integrator('tr_bdf2', simulation%stepper%integrator, failure)
    select type (integrator => simulation%stepper%integrator)
    type is (tr_bdf2_t)
      integrator%tolerance = direct%stepper%integrator%tolerance
      integrator%system%most_bytes = 1000
    end select
    call simulation%run(failure)
    call check(error, .not. allocated(failure))
    if (allocated(error)) return
    select type (integrator => simulation%stepper%integrator)
    type is (tr_bdf2_t)
      call check(error, integrator%system%iterative .and. integrator%system%iterations > 0)
    end select
    if (allocated(error)) return
    ! Iterations end at 0.002 of the tolerance of a step.
    call check(error, maxval(abs(simulation%temperature - direct%temperature)) < &
               1.0e-7_wp*direct%stepper%steps)
  end subroutine test_little_memory

  !> All insulated: what a source brings is what the body gains, however long the steps.
  subroutine test_conservation(error)
    use calor_heat_budget, only: budget_entry_t
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    type(scene_t) :: scene
    type(budget_entry_t) :: before, after
    real(wp), parameter :: duration = 0.3_wp
    character(len=*), parameter :: methods(2) = [character(len=11) :: 'tr_bdf2', 'exponential']
    integer :: k

    do k = 1, size(methods)
      call interpret_scene( &
        '&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.0833333333333 arrangement = '// &
        '''jittered'' jitter = 0.2 / &boundary kind = ''insulated'' / '// &
        '&initial temperature = 1 / '// &
        '&source power = 12 where_expression = ''x < 0.5'' / '// &
        '&time end = 0.3 tolerance = 1e-10 method = '''//trim(methods(k))//''' /', scene, failure)
      if (.not. allocated(failure)) call simulation%prepare(scene, failure)
      if (allocated(failure)) call test_failed(error, failure%message)
      if (allocated(error)) return
      call simulation%budget%close_exactly(simulation%conduction)
      call check(error, simulation%budget%conservative)
      if (allocated(error)) return
      call simulation%budget%evaluate(simulation%conduction, 0.0_wp, simulation%temperature, before)
      call simulation%run(failure)
      call check(error, .not. allocated(failure))
      if (allocated(error)) return
      call simulation%budget%evaluate(simulation%conduction, duration, simulation%temperature, &
                                      after)
      ! The series of the exponential ends at a part of the tolerance; and rounding of some thousand
      ! operations in each step
      call check(error, after%stored - before%stored, sum(before%power)*duration, &
                 thr=1.0e-9_wp, rel=.true., more=trim(methods(k)))
      if (allocated(error)) return
    end do
  end subroutine test_conservation

  !> Steps as long as the tolerance allows until they are as long as is stable: their number is the
  !> integral of 1/Δt.
  subroutine test_limited_steps(error)
    type(error_type), allocatable, intent(out) :: error
    type(problem_t) :: problem
    type(pilot_t) :: pilot
    real(wp), parameter :: longest = 0.02_wp
    real(wp) :: expected, time
    integer :: k
    integer, parameter :: intervals = 100000

    pilot%steps = 12
    pilot%time = 0.01_wp
    pilot%step = 0.001_wp
    pilot%age = 0.01_wp
    problem%duration = 2.01_wp
    expected = pilot%steps
    do k = 1, intervals
      time = pilot%time + (k - 0.5_wp)*2/intervals
      expected = expected + 2.0_wp/intervals/ &
                 min(longest, pilot%step*((time + pilot%age)/0.02_wp)**(11.0_wp/12))
    end do
    call check(error, steps_ahead(problem, pilot, longest), expected, thr=1.0e-4_wp, rel=.true.)
    if (allocated(error)) return
    ! A limit that is not reached is none …
    call check(error, steps_ahead(problem, pilot, 10.0_wp), steps_ahead(problem, pilot), &
               thr=1.0e-12_wp)
    if (allocated(error)) return
    ! … and one that the first step reaches alone counts.
    call check(error, steps_ahead(problem, pilot, 0.0005_wp), 12 + 2/0.0005_wp, &
               thr=1.0e-9_wp, rel=.true.)
  end subroutine test_limited_steps

  !> Where walls change with time, steps do not grow.
  subroutine test_changing(error)
    type(error_type), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    type(problem_t) :: problem
    type(pilot_t) :: pilot
    real(wp) :: foreseen, taken

    pilot%steps = 12
    pilot%time = 0.1_wp
    pilot%step = 0.01_wp
    pilot%age = 0.0_wp
    problem%duration = 1.1_wp
    problem%changing = .true.
    call check(error, steps_ahead(problem, pilot), 112.0_wp, thr=1.0e-9_wp)
    if (allocated(error)) return
    call prepare_scene('laplacian = ''fatehi_manzari''', 'end = 2 method = ''rkl2''', simulation, &
                       error, '&boundary on = ''left'' kind = ''temperature'' '// &
                       'value_expression = ''sin(20*t)'' /')
    if (allocated(error)) return
    problem%spectral_radius = simulation%stepper%spectral_radius
    problem%duration = 2
    problem%changing = .true.
    call run_pilot(problem, simulation%conduction, simulation%stepper, simulation%temperature, &
                   pilot)
    foreseen = steps_ahead(problem, pilot)
    call simulation%run(failure)
    taken = simulation%stepper%steps
    call check(error, foreseen < 1.5_wp*taken .and. taken < 1.5_wp*foreseen, &
               to_text(foreseen, digits=4)//' steps foreseen, '//to_text(taken)//' taken')
  end subroutine test_changing

  subroutine force_iteration(integrator)
    use calor_tr_bdf2, only: tr_bdf2_t
    class(integrator_t), intent(inout) :: integrator

    select type (integrator)
    type is (tr_bdf2_t)
      integrator%system%iterative = .true.
    end select
  end subroutine force_iteration

  !> The unit square, 12 particles to an edge, irregular, walls at 0 and a bump in the middle
  subroutine prepare_scene(scheme, time, simulation, error, extra)
    character(len=*), intent(in) :: scheme, time
    type(simulation_t), intent(out) :: simulation
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in), optional :: extra
    type(scene_t) :: scene
    type(error_t), allocatable :: failure
    character(len=:), allocatable :: walls, more

    more = ''
    if (present(extra)) more = extra
    walls = '&boundary on = ''all'' kind = ''temperature'' value = 0 /'
    if (index(more, '&boundary') > 0) then
      walls = '&boundary on = ''bottom'' kind = ''temperature'' value = 0 /'//lf// &
              '&boundary on = ''top'' kind = ''temperature'' value = 0 /'//lf
      if (index(more, 'left') > 0) then
        walls = walls//'&boundary on = ''right'' kind = ''temperature'' value = 0 /'
      else
        walls = walls//'&boundary on = ''left'' kind = ''temperature'' value = 0 /'
      end if
    end if
    call interpret_scene( &
      '&scene title = ''square'' /'//lf// &
      '&domain shape = ''rectangle'' x_range = 0, 1 y_range = 0, 1 spacing = 0.0833333333333 '// &
      'arrangement = ''jittered'' jitter = 0.2 seed = 3 /'//lf// &
      '&scheme '//scheme//' /'//lf// &
      '&material conductivity = 1 density = 1 heat_capacity = 1 /'//lf// &
      '&initial temperature_expression = ''sin(pi*x)*sin(pi*y)'' /'//lf//walls//lf//more//lf// &
      '&time '//time//' /'//lf, scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    if (allocated(failure)) call test_failed(error, failure%message)
  end subroutine prepare_scene

  pure function unknowns(this) result(number)
    class(chain_t), intent(in) :: this
    integer :: number

    number = this%n
  end function unknowns

  subroutine rate(this, time, u, du)
    class(chain_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(out), contiguous :: du(:)
    real(wp), allocatable :: slope(:)

    call move_alloc(this%slope, slope)
    call this%jacobian_product(u, du)
    call move_alloc(slope, this%slope)
    du = du + this%cubic*u**3
    if (this%forcing > 0) then
      du = du + this%forcing*sin(time)
    else if (this%forcing < 0) then
      du = du + 1 + 2*time
    end if
    call this%clear_prescribed(du)
  end subroutine rate

  subroutine jacobian_product(this, v, product)
    class(chain_t), intent(inout) :: this
    real(wp), intent(in), contiguous :: v(:)
    real(wp), intent(out), contiguous :: product(:)

    product = -2*this%stiffness*v
    product(2:) = product(2:) + (1 + this%skew)*this%stiffness/(1 + abs(this%skew))*v(:this%n - 1)
    product(:this%n - 1) = product(:this%n - 1) + &
                           (1 - this%skew)*this%stiffness/(1 + abs(this%skew))*v(2:)
    if (allocated(this%slope)) product = product + this%slope*v
    call this%clear_prescribed(product)
  end subroutine jacobian_product

  subroutine impose(this, time, u)
    class(chain_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(inout), contiguous :: u(:)

    if (this%held) u(1) = sin(time)
  end subroutine impose

  subroutine clear_prescribed(this, v)
    class(chain_t), intent(in) :: this
    real(wp), intent(inout), contiguous :: v(:)

    if (this%held) v(1) = 0
  end subroutine clear_prescribed

  subroutine inspect(this, time, u, error)
    class(chain_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    type(error_t), allocatable, intent(out) :: error

    associate (unused => this, also => time, and => u)
    end associate
  end subroutine inspect

  subroutine linearise(this, time, u)
    class(chain_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)

    associate (unused => time)
    end associate
    this%slope = 3*this%cubic*u**2
  end subroutine linearise

  subroutine jacobian_rows(this, first, index, value, known)
    class(chain_t), intent(in) :: this
    integer, allocatable, intent(out) :: first(:)
    integer, allocatable, intent(out) :: index(:)
    real(wp), allocatable, intent(out) :: value(:)
    logical, intent(out) :: known
    type(chain_t) :: copy
    real(wp) :: unit(this%n), row(this%n, this%n)
    integer :: k, j

    known = .true.
    copy = this
    do k = 1, this%n
      unit = 0
      unit(k) = 1
      call copy%jacobian_product(unit, row(:, k))
    end do
    allocate (first(this%n + 1), index(0), value(0))
    do k = 1, this%n
      first(k) = size(index) + 1
      if (this%held .and. k == 1) cycle
      index = [index, pack([(j, j=1, this%n)], abs(row(k, :)) > 0)]
      value = [value, pack(row(k, :), abs(row(k, :)) > 0)]
    end do
    first(this%n + 1) = size(index) + 1
  end subroutine jacobian_rows

  pure function is_linear(this) result(answer)
    class(chain_t), intent(in) :: this
    logical :: answer

    answer = .not. abs(this%cubic) > 0
  end function is_linear

  pure function depends_on_time(this) result(answer)
    class(chain_t), intent(in) :: this
    logical :: answer

    answer = abs(this%forcing) > 0 .or. this%held
  end function depends_on_time

end module test_implicit
