!> Tests of the time integrators, the step control and the spectral radius.
module test_time
  use calor_error, only: error_t
  use calor_evolution, only: evolution_t
  use calor_integrator, only: integrator_t
  use calor_integrators, only: make_integrator
  use calor_kinds, only: wp
  use calor_rkl2, only: rkl2_stages
  use calor_spectral_radius, only: estimate_spectral_radius
  use calor_stepper, only: stepper_t
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_time

  !> u_k' = λ_k (u_k - g(t)) + g'(t) with g = sin t: every component tends to g at its own rate.
  !> With `held`, component 1 is prescribed as g(t). Without forcing the problem is linear and knows
  !> no time, if it is `told`, and tends to `level`.
  type, extends(evolution_t) :: decay_t
    real(wp), allocatable :: lambda(:)
    real(wp) :: forcing = 1.0_wp, level = 0.0_wp
    logical :: held = .false., told = .true.
  contains
    procedure :: is_linear
    procedure :: depends_on_time
    procedure :: unknowns
    procedure :: rate
    procedure :: jacobian_product
    procedure :: impose
    procedure :: clear_prescribed
    procedure :: inspect
  end type decay_t

contains

  subroutine collect_time(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('forward Euler is of first order', test_euler_order), &
                new_unittest('Runge-Kutta is of fourth order', test_runge_kutta_order), &
                new_unittest('RKL2 is of second order', test_rkl2_order), &
                new_unittest('RKL2 on linear problems takes terms of a recurrence', &
                             test_rkl2_terms), &
                new_unittest('RKL2 is of second order for any number of stages', &
                             test_rkl2_stages), &
                new_unittest('stability limits are sharp', test_limits), &
                new_unittest('RKL2 error estimate is the error', test_error_estimate), &
                new_unittest('error control keeps the tolerance', test_error_control), &
                new_unittest('a prescribed value is met at every stage', test_prescribed), &
                new_unittest('spectral radius', test_spectral_radius), &
                new_unittest('blow-up ends the integration', test_blow_up) &
                ]
  end subroutine collect_time

  subroutine test_euler_order(error)
    type(error_type), allocatable, intent(out) :: error

    call check_order('forward_euler', 1.0_wp, error)
  end subroutine test_euler_order

  subroutine test_runge_kutta_order(error)
    type(error_type), allocatable, intent(out) :: error

    call check_order('runge_kutta_4', 4.0_wp, error)
  end subroutine test_runge_kutta_order

  subroutine test_rkl2_order(error)
    type(error_type), allocatable, intent(out) :: error

    call check_order('rkl2', 2.0_wp, error)
  end subroutine test_rkl2_order

  !> Observed order between 40 and 80 steps over a time of 1
  subroutine check_order(method, order, error)
    character(len=*), intent(in) :: method
    real(wp), intent(in) :: order
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: coarse, fine

    coarse = error_with_steps(method, 40, [-1.0_wp, -3.0_wp, -0.2_wp], 3.0_wp)
    fine = error_with_steps(method, 80, [-1.0_wp, -3.0_wp, -0.2_wp], 3.0_wp)
    call check(error, log(coarse/fine)/log(2.0_wp), order, thr=0.1_wp)
  end subroutine check_order

  !> Error at t = 1 against the exact solution u_k = g + exp(λ_k t)
  function error_with_steps(method, steps, lambda, radius) result(deviation)
    character(len=*), intent(in) :: method
    integer, intent(in) :: steps
    real(wp), intent(in) :: lambda(:), radius
    real(wp) :: deviation
    type(decay_t) :: decay
    real(wp) :: u(size(lambda))

    decay%lambda = lambda
    u = 1
    call integrate(method, decay, steps, 1.0_wp, radius, u)
    deviation = maxval(abs(u - (exp(lambda) + sin(1.0_wp))))
  end function error_with_steps

  !> Equal steps from 0 to `end_time`
  subroutine integrate(method, decay, steps, end_time, radius, u)
    character(len=*), intent(in) :: method
    type(decay_t), intent(inout) :: decay
    integer, intent(in) :: steps
    real(wp), intent(in) :: end_time, radius
    real(wp), intent(inout), contiguous :: u(:)
    class(integrator_t), allocatable :: integrator
    type(error_t), allocatable :: failure
    real(wp) :: next(size(u)), estimate, step
    integer :: k

    call make_integrator(method, integrator, failure)
    step = end_time/steps
    do k = 1, steps
      call integrator%advance(decay, (k - 1)*step, step, radius, u, next, estimate)
      call integrator%accept()
      u = next
    end do
  end subroutine integrate

  !> The number of stages follows from the spectral radius; the order must not depend on it.
  subroutine test_rkl2_stages(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: radius, coarse, fine
    integer :: k

    do k = 1, 4
      radius = 10.0_wp**k
      call check(error, mod(rkl2_stages(0.1_wp, radius), 2), 1)
      if (allocated(error)) return
      ! Scaled so that both runs take the same number of stages
      coarse = error_with_steps('rkl2', 40, [-1.0_wp, -3.0_wp], 40*radius)
      fine = error_with_steps('rkl2', 80, [-1.0_wp, -3.0_wp], 80*radius)
      call check(error, log(coarse/fine)/log(2.0_wp), 2.0_wp, thr=0.1_wp)
      if (allocated(error)) return
    end do
  end subroutine test_rkl2_stages

  !> One eigenvalue at the end of the spectrum: bounded just inside the limit, growing just outside.
  subroutine test_limits(error)
    type(error_type), allocatable, intent(out) :: error
    class(integrator_t), allocatable :: integrator
    type(error_t), allocatable :: failure
    type(decay_t) :: decay
    real(wp) :: limit, u(1)
    integer :: k
    character(len=13), parameter :: methods(2) = &
                                    [character(len=13) :: 'forward_euler', 'runge_kutta_4']

    decay%lambda = [-7.0_wp]
    decay%forcing = 0
    do k = 1, size(methods)
      call make_integrator(trim(methods(k)), integrator, failure)
      limit = integrator%longest_stable_step(7.0_wp)
      u = 1
      call integrate(trim(methods(k)), decay, 2000, 2000*0.99_wp*limit, 7.0_wp, u)
      call check(error, abs(u(1)) < 1.0_wp, trim(methods(k))//' grows inside its limit')
      if (allocated(error)) return
      u = 1
      call integrate(trim(methods(k)), decay, 2000, 2000*1.01_wp*limit, 7.0_wp, u)
      call check(error, abs(u(1)) > 1.0e3_wp, trim(methods(k))//' is stable beyond its limit')
      if (allocated(error)) return
    end do
    ! RKL2 chooses its stages for the radius it is told; the step is at the very end of their reach.
    do k = 3, 101, 14
      limit = 0.5_wp*(k**2 + k - 2)/7
      call check(error, rkl2_stages(0.9999_wp*limit, 7.0_wp), k)
      if (allocated(error)) return
      u = 1
      call integrate('rkl2', decay, 200, 200*0.9999_wp*limit, 7.0_wp, u)
      call check(error, abs(u(1)) < 1.0_wp, 'rkl2 grows inside its limit')
      if (allocated(error)) return
    end do
    ! At the end of its reach an odd number of stages damps by a - b, so three of them bear 15 %
    ! more; a true radius 25 % above what it is told lies outside.
    u = 1
    decay%lambda = [-7.0_wp*1.25_wp]
    call integrate('rkl2', decay, 40, 40*0.9999_wp*(0.5_wp*(9 + 3 - 2)/7), 7.0_wp, u)
    call check(error, abs(u(1)) > 1.0e3_wp, 'rkl2 is stable beyond its limit')
  end subroutine test_limits

  subroutine test_error_estimate(error)
    type(error_type), allocatable, intent(out) :: error
    class(integrator_t), allocatable :: integrator
    type(error_t), allocatable :: failure
    type(decay_t) :: decay
    real(wp) :: u(1), next(1), estimate, radius, step
    integer :: k

    decay%lambda = [-1.0_wp]
    decay%forcing = 0
    step = 0.01_wp
    do k = 1, 3
      radius = 10.0_wp**(2*k)
      call make_integrator('rkl2', integrator, failure)
      u = 1
      call integrator%advance(decay, 0.0_wp, step, radius, u, next, estimate)
      call check(error, estimate/abs(next(1) - exp(-step)), 1.0_wp, thr=0.05_wp)
      if (allocated(error)) return
    end do
  end subroutine test_error_estimate

  subroutine test_error_control(error)
    type(error_type), allocatable, intent(out) :: error
    type(stepper_t) :: stepper
    type(decay_t) :: decay
    type(error_t), allocatable :: failure
    real(wp) :: u(3), time
    integer :: k, earlier_steps

    earlier_steps = 0
    do k = 4, 8, 2
      decay%lambda = [-1.0_wp, -30.0_wp, -1000.0_wp]
      u = 1
      time = 0
      stepper = stepper_t()
      call make_integrator('rkl2', stepper%integrator, failure)
      stepper%spectral_radius = 1000
      stepper%longest_step = 1
      stepper%tolerance = 10.0_wp**(-k)
      call stepper%advance_to(decay, time, 0.3_wp, u, failure)
      call check(error,.not. allocated(failure))
      if (allocated(error)) return
      call stepper%advance_to(decay, time, 1.0_wp, u, failure)
      call check(error, time, 1.0_wp)
      if (allocated(error)) return
      call check(error, maxval(abs(u - (exp(decay%lambda) + sin(1.0_wp)))) < &
                 stepper%steps*stepper%tolerance)
      if (allocated(error)) return
      ! A hundredth of the tolerance takes 100^(1/3) = 4.6 times the steps.
      if (earlier_steps > 0) then
        call check(error, stepper%steps > 2*earlier_steps .and. stepper%steps < 8*earlier_steps)
        if (allocated(error)) return
      end if
      earlier_steps = stepper%steps
    end do
  end subroutine test_error_control

  !> One step from stages and one from terms of Legendre's recurrence, 3 to 301 of them, are the
  !> stability polynomial's value; what is steady stays so to the last bit.
  subroutine test_rkl2_terms(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: stages(5) = [3, 5, 21, 101, 301]
    class(integrator_t), allocatable :: integrator
    type(error_t), allocatable :: failure
    type(decay_t) :: decay
    real(wp) :: u(5), next(5), estimate, earlier, limit, rounding
    integer :: k, pass

    decay%lambda = [0.0_wp, -1.0e-3_wp, -0.1_wp, -0.7_wp, -1.0_wp]
    decay%forcing = 0
    decay%level = 0.3_wp
    u = [1/3.0_wp, 1.0_wp, -1.0_wp, 0.5_wp, 2.0_wp]
    do k = 1, size(stages)
      limit = 0.5_wp*(real(stages(k), wp)**2 + stages(k) - 2)*0.9999_wp
      do pass = 1, 2
        decay%told = pass == 2
        call make_integrator('rkl2', integrator, failure)
        call integrator%advance(decay, 0.0_wp, limit, 1.0_wp, u, next, estimate)
        ! Rounding 1 + w₁ z counts P_s'(1) = s (s + 1)/2 times; numbers are up to 2
        rounding = 4*real(stages(k), wp)**2*epsilon(1.0_wp)
        call check(error, maxval(abs(next - decay%level - (u - decay%level)* &
                                     amplification(stages(k), limit*decay%lambda))) < rounding)
        if (allocated(error)) return
        if (pass == 1) earlier = estimate
      end do
      call check(error, next(1), u(1))
      if (allocated(error)) return
      ! The defect has a rate times half the step, which is up to s²/4.
      call check(error, abs(estimate - earlier) < rounding*limit)
      if (allocated(error)) return
    end do
  end subroutine test_rkl2_terms

  !> What RKL2 makes of a mode in a step: 1 - b + b P_s(1 + w₁ z), with Legendre's polynomial
  elemental function amplification(stages, z) result(factor)
    integer, intent(in) :: stages
    !> Eigenvalue times step
    real(wp), intent(in) :: z
    real(wp) :: factor
    real(wp) :: b, before, earlier, place, s
    integer :: j

    s = stages
    b = (s**2 + s - 2)/(2*s*(s + 1))
    place = 1 + 4*z/(s**2 + s - 2)
    before = 1
    factor = place
    do j = 2, stages
      earlier = before
      before = factor
      factor = ((2*j - 1)*place*before - (j - 1)*earlier)/j
    end do
    factor = 1 - b + b*factor
  end function amplification

  subroutine test_prescribed(error)
    type(error_type), allocatable, intent(out) :: error
    type(decay_t) :: decay
    real(wp) :: u(2)
    character(len=13), parameter :: methods(3) = &
                                    [character(len=13) :: 'forward_euler', 'runge_kutta_4', 'rkl2']
    integer :: k

    decay%lambda = [-1.0_wp, -3.0_wp]
    decay%held = .true.
    do k = 1, size(methods)
      u = [0.0_wp, 1.0_wp]
      call integrate(trim(methods(k)), decay, 100, 1.0_wp, 3.0_wp, u)
      call check(error, u(1), sin(1.0_wp), thr=1.0e-14_wp)
      if (allocated(error)) return
      call check(error, u(2), exp(-3.0_wp) + sin(1.0_wp), thr=1.0e-2_wp)
      if (allocated(error)) return
    end do
  end subroutine test_prescribed

  subroutine test_spectral_radius(error)
    type(error_type), allocatable, intent(out) :: error
    type(decay_t) :: decay
    real(wp) :: radius
    integer :: k

    ! A crowded spectrum, as a Laplacian has it
    decay%lambda = [(-real(k, wp), k=1, 500)]
    radius = estimate_spectral_radius(decay, huge(1.0_wp))
    call check(error, radius >= 500 .and. radius <= 1.06_wp*500)
    if (allocated(error)) return
    call check(error, estimate_spectral_radius(decay, 510.0_wp) <= 510)
  end subroutine test_spectral_radius

  subroutine test_blow_up(error)
    type(error_type), allocatable, intent(out) :: error
    type(stepper_t) :: stepper
    type(decay_t) :: decay
    type(error_t), allocatable :: failure
    real(wp) :: u(1), time

    decay%lambda = [5.0_wp]
    decay%forcing = 0
    u = 1
    time = 0
    call make_integrator('runge_kutta_4', stepper%integrator, failure)
    stepper%spectral_radius = 5
    stepper%longest_step = 0.02_wp
    call stepper%advance_to(decay, time, 10.0_wp, u, failure)
    call check(error, allocated(failure))
    if (allocated(error)) return
    ! The state is the last good one: `inspect` below lets nothing beyond 100 pass.
    call check(error, u(1) > 50 .and. u(1) <= 100)
    if (allocated(error)) return
    call check(error, u(1), exp(5*time), thr=1.0e-5_wp, rel=.true.)
  end subroutine test_blow_up

  pure function unknowns(this) result(number)
    class(decay_t), intent(in) :: this
    integer :: number

    number = size(this%lambda)
  end function unknowns

  pure function is_linear(this) result(answer)
    class(decay_t), intent(in) :: this
    logical :: answer

    answer = this%told
  end function is_linear

  pure function depends_on_time(this) result(answer)
    class(decay_t), intent(in) :: this
    logical :: answer

    answer = abs(this%forcing) > 0
  end function depends_on_time

  subroutine rate(this, time, u, du)
    class(decay_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(out), contiguous :: du(:)

    du = this%lambda*(u - this%level - this%forcing*sin(time)) + this%forcing*cos(time)
    call this%clear_prescribed(du)
  end subroutine rate

  subroutine jacobian_product(this, v, product)
    class(decay_t), intent(inout) :: this
    real(wp), intent(in), contiguous :: v(:)
    real(wp), intent(out), contiguous :: product(:)

    product = this%lambda*v
    call this%clear_prescribed(product)
  end subroutine jacobian_product

  subroutine impose(this, time, u)
    class(decay_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(inout), contiguous :: u(:)

    if (this%held) u(1) = this%forcing*sin(time)
  end subroutine impose

  subroutine clear_prescribed(this, v)
    class(decay_t), intent(in) :: this
    real(wp), intent(inout), contiguous :: v(:)

    if (this%held) v(1) = 0
  end subroutine clear_prescribed

  subroutine inspect(this, time, u, error)
    class(decay_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    type(error_t), allocatable, intent(out) :: error

    associate (unused_state => this, unused_time => time)
    end associate
    if (maxval(abs(u)) > 100) then
      allocate (error)
      error%message = 'too large'
    end if
  end subroutine inspect

end module test_time
