!> The method RKL2, stabilised, explicit, Runge–Kutta–Legendre, of second order, for diffusion.
!>
!> With s stages it is stable for |λ| Δt ≤ (s² + s - 2)/2, so its reach grows with the square of the
!> work: it takes as many stages as a step needs.
!>
!> The more stages, the less may eigenvalues lie off the real axis: with 301 stages an imaginary
!> part of 0.2 % of the spectral radius is amplified a million times in one step, and irregular
!> clouds have up to 8 %. So before a step takes more stages than any before it, a few such steps of
!> the linear problem are tried out on a vector of random numbers.
!>
!> Source: C.D. Meyer, D.S. Balsara, T.D. Aslam, J. Comput. Phys. 257 (2014) 594–626, equations
!> (15)–(19).
module calor_rkl2
  use calor_constants, only: worth_threads
  use calor_evolution, only: evolution_t
  use calor_freed_memory, only: give_back_freed_memory
  use calor_huge_pages, only: prefer_huge_pages
  use calor_integrator, only: integrator_t
  use calor_kinds, only: wp
  use calor_saved_state, only: saved_state_t
  implicit none (type, external)
  private

  public :: rkl2_t, rkl2_stages

  type, extends(integrator_t) :: rkl2_t
    private
    !> F at the start of the step, and at its end; until then the latter holds every other stage
    real(wp), allocatable :: rate_start(:), rate_end(:)
    !> F of a stage; afterwards what shows the error of the step
    real(wp), allocatable :: rate_stage(:)
    !> The error of the step just computed is this times rate_stage
    real(wp) :: error_factor = 0.0_wp
    !> Whether rate_start belongs to the state that the next step starts from
    logical :: started = .false.
    !> So many stages are stable for this spectrum
    integer :: proven_stages = 3
    !> Whether more were found to be unstable
    logical :: exhausted = .false.
  contains
    procedure :: longest_stable_step
    procedure :: shorten_step
    procedure :: estimates_error
    procedure :: order
    procedure :: advance
    procedure :: accept
    procedure :: add_step_error
    procedure :: restart
    procedure :: save => save_rkl2
    procedure :: restore => restore_rkl2
  end type rkl2_t

  !> Beyond some hundred stages rounding errors inside a step grow
  integer, parameter :: most_stages = 301
  !> Each trial is of so many times more stages than the one before
  real(wp), parameter :: trial_growth = 1.5_wp
  !> Steps of a trial: enough for an unstable mode to stand out from a random vector
  integer, parameter :: trial_steps = 8

contains

  !> The least odd number of stages, at least 3, for a stable step; an odd number damps the
  !> shortest waves best.
  pure function rkl2_stages(step, spectral_radius) result(stages)
    !> Step, s
    real(wp), intent(in) :: step
    !> Spectral radius, 1/s
    real(wp), intent(in) :: spectral_radius
    integer :: stages

    ! s² + s - 2 ≥ 2 ρ Δt
    stages = ceiling((sqrt(9 + 8*min(step*spectral_radius, 1.0e9_wp)) - 1)/2)
    stages = max(3, stages)
    if (mod(stages, 2) == 0) stages = stages + 1
  end function rkl2_stages

  pure function longest_stable_step(this, spectral_radius) result(step)
    class(rkl2_t), intent(in) :: this
    real(wp), intent(in) :: spectral_radius
    real(wp) :: step

    step = reach(most_stages)/spectral_radius
  end function longest_stable_step

  !> The longest stable step on the real axis, times the spectral radius
  pure function reach(stages)
    integer, intent(in) :: stages
    real(wp) :: reach

    reach = 0.5_wp*(real(stages, wp)**2 + stages - 2)
  end function reach

  subroutine shorten_step(this, evolution, spectral_radius, step)
    class(rkl2_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: spectral_radius
    real(wp), intent(inout) :: step
    integer :: needed, trial
    logical :: tried

    needed = rkl2_stages(step, spectral_radius)
    tried = .false.
    do while (needed > this%proven_stages .and. .not. this%exhausted)
      trial = min(most_stages, ceiling(trial_growth*this%proven_stages))
      if (mod(trial, 2) == 0) trial = trial + 1
      if (trial > most_stages .or. trial == this%proven_stages) exit
      tried = .true.
      if (is_stable(this, evolution, trial, reach(trial)/spectral_radius)) then
        this%proven_stages = trial
      else
        this%exhausted = .true.
      end if
      this%evaluations = this%evaluations + trial_steps*trial
    end do
    ! Trials are rare, and take vectors of their own that no step needs
    if (tried) call give_back_freed_memory()
    if (needed > this%proven_stages) then
      step = min(step, reach(this%proven_stages)/spectral_radius*(1 - 1.0e-9_wp))
    end if
  end subroutine shorten_step

  !> Whether steps of the linear problem shorten a vector of random numbers.
  function is_stable(this, evolution, stages, step)
    class(rkl2_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    integer, intent(in) :: stages
    real(wp), intent(in) :: step
    logical :: is_stable
    real(wp), allocatable :: v(:), even_stage(:)
    real(wp) :: before
    integer :: k, j, n, i

    n = evolution%unknowns()
    call make_room(this, n)
    allocate (v(n), even_stage(n))
    ! Its place is taken: a rate more is little beside a trial
    this%started = .false.
    call evolution%scatter(5, v)
    is_stable = .true.
    before = evolution%root_mean_square(v)
    do k = 1, trial_steps
      if (.not. before > 0) return
      call evolution%jacobian_product(v, this%rate_start)
      !$omp parallel do if (n > worth_threads) schedule(static) default(shared) private(i)
      do i = 1, n
        v(i) = v(i)/before
        this%rate_start(i) = this%rate_start(i)/before
        even_stage(i) = v(i)
        this%rate_end(i) = v(i) + first_place(stages)*step*this%rate_start(i)
      end do
      !$omp end parallel do
      do j = 2, stages, 2
        call evolution%combine_with_jacobian(factors(j, stages, step), this%rate_end, even_stage, &
                                             this%rate_stage, v, this%rate_start)
        call evolution%combine_with_jacobian(factors(j + 1, stages, step), even_stage, &
                                             this%rate_end, this%rate_stage, v, this%rate_start)
      end do
      v = this%rate_end
      before = evolution%root_mean_square(v)
      ! More than that would amplify rounding errors, whatever becomes of it later.
      if (before > 1.0e4_wp) exit
    end do
    is_stable = before <= 1
  end function is_stable

  !> Where the first stage lies in a step, as a part of it
  pure function first_place(stages) result(place)
    integer, intent(in) :: stages
    real(wp) :: place

    place = 4/(3*(real(stages, wp)**2 + stages - 2))
  end function first_place

  !> What stage j consists of: the factors of the last stage and of the one before, of stage 0 and
  !> its rate, and of the last stage's rate. It takes the place of the one before, which is no
  !> longer needed once it has entered.
  pure function factors(j, stages, step) result(c)
    integer, intent(in) :: j, stages
    real(wp), intent(in) :: step
    real(wp) :: c(5)
    real(wp) :: mu_tilde

    c(1) = (2*j - 1)*weight_b(j)/(j*weight_b(j - 1))
    c(2) = -(j - 1)*weight_b(j)/(j*weight_b(j - 2))
    c(3) = 1 - c(1) - c(2)
    mu_tilde = 3*first_place(stages)*c(1)
    c(4) = -(1 - weight_b(j - 1))*mu_tilde*step
    c(5) = mu_tilde*step
  end function factors

  pure function estimates_error(this) result(answer)
    class(rkl2_t), intent(in) :: this
    logical :: answer

    answer = .true.
  end function estimates_error

  pure function order(this)
    class(rkl2_t), intent(in) :: this
    integer :: order

    associate (unused => this)
    end associate
    order = 2
  end function order

  subroutine advance(this, evolution, time, step, spectral_radius, u, u_next, local_error)
    class(rkl2_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: time, step
    real(wp), intent(in) :: spectral_radius
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(out), contiguous :: u_next(:)
    real(wp), intent(out) :: local_error
    real(wp) :: w1, third, place
    integer :: stages, j, k

    call make_room(this, size(u))
    if (.not. this%started) then
      call evolution%rate(time, u, this%rate_start)
      this%evaluations = this%evaluations + 1
      this%started = .true.
    end if

    stages = rkl2_stages(step, spectral_radius)
    w1 = 4.0_wp/(real(stages, wp)**2 + stages - 2)
    place = first_place(stages)
    !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(u)
      this%rate_end(k) = u(k)
      u_next(k) = u(k) + place*step*this%rate_start(k)
    end do
    !$omp end parallel do
    call evolution%impose(time + place*step, u_next)

    ! Stages are odd in number: the last one lands where it belongs.
    do j = 2, stages, 2
      call take_stage(j, u_next, this%rate_end)
      call take_stage(j + 1, this%rate_end, u_next)
    end do
    call evolution%rate(time + step, u_next, this%rate_end)
    this%evaluations = this%evaluations + stages

    ! The step's error is (c - 1/6) u''' Δt³, c being the third coefficient of the method's
    ! stability polynomial. The trapezoidal rule misses u''' Δt³/12 the other way: its defect shows
    ! the sum.
    !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(u)
      this%rate_stage(k) = u(k) - u_next(k) + 0.5_wp*step*(this%rate_start(k) + this%rate_end(k))
    end do
    !$omp end parallel do
    call evolution%clear_prescribed(this%rate_stage)
    third = third_coefficient(stages)
    this%error_factor = (1.0_wp/6 - third)/(1.0_wp/4 - third)
    local_error = this%error_factor*evolution%root_mean_square(this%rate_stage)

  contains

    !> From the last stage and the one before, whose place it takes, to stage j
    subroutine take_stage(j, newer, older)
      integer, intent(in) :: j
      real(wp), intent(in), contiguous :: newer(:)
      real(wp), intent(inout), contiguous :: older(:)

      call evolution%combine_with_rate(time + place*step, factors(j, stages, step), newer, u, &
                                       this%rate_start, older, this%rate_stage)
      place = (real(j, wp)**2 + j - 2)*w1/4
      call evolution%impose(time + place*step, older)
    end subroutine take_stage

  end subroutine advance

  !> Arrays for so many unknowns, where there are none yet
  subroutine make_room(this, unknowns)
    class(rkl2_t), intent(inout) :: this
    integer, intent(in) :: unknowns

    if (allocated(this%rate_stage)) return
    if (.not. allocated(this%rate_start)) allocate (this%rate_start(unknowns))
    allocate (this%rate_end(unknowns), this%rate_stage(unknowns))
    call prefer_huge_pages(this%rate_start)
    call prefer_huge_pages(this%rate_end)
    call prefer_huge_pages(this%rate_stage)
  end subroutine make_room

  subroutine accept(this)
    class(rkl2_t), intent(inout) :: this
    real(wp), allocatable :: spare(:)

    call move_alloc(this%rate_start, spare)
    call move_alloc(this%rate_end, this%rate_start)
    call move_alloc(spare, this%rate_end)
  end subroutine accept

  subroutine add_step_error(this, step, total)
    class(rkl2_t), intent(in) :: this
    real(wp), intent(in) :: step
    real(wp), intent(inout), contiguous :: total(:)
    integer :: k

    associate (unused => step)
    end associate
    !$omp parallel do if (size(total) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(total)
      total(k) = total(k) + this%error_factor*this%rate_stage(k)
    end do
    !$omp end parallel do
  end subroutine add_step_error

  subroutine restart(this)
    class(rkl2_t), intent(inout) :: this

    this%started = .false.
  end subroutine restart

  pure function weight_b(j) result(b)
    integer, intent(in) :: j
    real(wp) :: b

    b = 1.0_wp/3
    if (j > 2) b = (real(j, wp)**2 + j - 2)/(2*real(j, wp)*(j + 1))
  end function weight_b

  !> Coefficient of z³ in the stability polynomial, b_s w₁³ P_s'''(1)/6: towards 1/9, not
  !> 1/6.
  pure function third_coefficient(stages) result(c)
    integer, intent(in) :: stages
    real(wp) :: c
    real(wp) :: n

    n = real(stages, wp)*(stages + 1)
    c = (n - 6)/(9*(n - 2))
  end function third_coefficient

  subroutine save_rkl2(this, state)
    class(rkl2_t), intent(in) :: this
    type(saved_state_t), intent(inout) :: state

    call state%put('evaluations', this%evaluations)
    call state%put('started', this%started)
    call state%put('proven_stages', this%proven_stages)
    call state%put('exhausted', this%exhausted)
    if (this%started) call state%put('rate_start', this%rate_start)
  end subroutine save_rkl2

  subroutine restore_rkl2(this, state)
    class(rkl2_t), intent(inout) :: this
    type(saved_state_t), intent(inout) :: state

    call state%get('evaluations', this%evaluations)
    call state%get('started', this%started)
    call state%get('proven_stages', this%proven_stages)
    call state%get('exhausted', this%exhausted)
    if (.not. this%started) return
    call state%get('rate_start', this%rate_start)
    call make_room(this, size(this%rate_start))
  end subroutine restore_rkl2

end module calor_rkl2
