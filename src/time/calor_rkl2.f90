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
!> On u_t = A u + b, b being constant, the last stage is Y_s = (1 - b_s) u + b_s Z_s, where
!> Z_j - u* = P_j(1 + w₁ Δt A) (u - u*), P_j being Legendre's polynomials and u* what is steady. The
!> recurrence of these is that of Z_j, in differences
!>
!>     Z_j = Z_{j-1} + (j-1)/j (Z_{j-1} - Z_{j-2}) + (2j-1)/j w₁ Δt F(Z_{j-1})
!>
!> with Z_0 = u, and needs neither u nor its rate: two vectors less to read. Only the last stage
!> belongs to a time of the step, so that this is for F that knows no time.
!>
!> Source: C.D. Meyer, D.S. Balsara, T.D. Aslam, J. Comput. Phys. 257 (2014) 594–626, equations
!> (15)–(19).
module calor_rkl2
  use calor_constants, only: worth_threads
  use calor_evolution, only: evolution_t
  use calor_huge_pages, only: prefer_huge_pages
  use calor_integrator, only: integrator_t
  use calor_kinds, only: wp
  use calor_saved_state, only: saved_state_t
  implicit none (type, external)
  private

  public :: rkl2_t, rkl2_stages

  type, extends(integrator_t) :: rkl2_t
    private
    !> F at the start of the step; afterwards what shows its error
    real(wp), allocatable :: rate_start(:)
    !> F at the end of the step; until then every other stage. Once the step is accepted, the two
    !> change places
    real(wp), allocatable :: rate_end(:)
    !> Workspace of evolutions that need any
    real(wp), allocatable :: work(:)
    !> The error of the step just computed is this times what shows it
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

  subroutine shorten_step(this, evolution, spectral_radius, step, work)
    class(rkl2_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: spectral_radius
    real(wp), intent(inout) :: step
    real(wp), intent(inout), contiguous :: work(:)
    integer :: needed, trial

    needed = rkl2_stages(step, spectral_radius)
    do while (needed > this%proven_stages .and. .not. this%exhausted)
      trial = min(most_stages, ceiling(trial_growth*this%proven_stages))
      if (mod(trial, 2) == 0) trial = trial + 1
      if (trial > most_stages .or. trial == this%proven_stages) exit
      if (is_stable(this, evolution, trial, reach(trial)/spectral_radius, work)) then
        this%proven_stages = trial
      else
        this%exhausted = .true.
      end if
      this%evaluations = this%evaluations + trial_steps*trial
    end do
    if (needed > this%proven_stages) then
      step = min(step, reach(this%proven_stages)/spectral_radius*(1 - 1.0e-9_wp))
    end if
  end subroutine shorten_step

  !> Whether steps of the linear problem shorten a vector of random numbers.
  function is_stable(this, evolution, stages, step, v)
    class(rkl2_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    integer, intent(in) :: stages
    real(wp), intent(in) :: step
    !> Workspace
    real(wp), intent(inout), contiguous :: v(:)
    logical :: is_stable
    real(wp) :: before, part
    integer :: k, j, i

    call make_room(this, size(v))
    ! Its place is taken: a rate more is little beside a trial
    this%started = .false.
    call evolution%scatter(5, v)
    is_stable = .true.
    before = evolution%root_mean_square(v)
    part = weight_b(stages)
    associate (even => this%rate_start, odd => this%rate_end)
      do k = 1, trial_steps
        if (.not. before > 0) return
        !$omp parallel do if (size(v) > worth_threads) schedule(static) default(shared) private(i)
        do i = 1, size(v)
          v(i) = v(i)/before
          even(i) = v(i)
          odd(i) = v(i)
        end do
        !$omp end parallel do
        call evolution%recur_with_jacobian(term_factors(1, stages, step), even, odd, this%work)
        do j = 2, stages, 2
          call evolution%recur_with_jacobian(term_factors(j, stages, step), odd, even, this%work)
          call evolution%recur_with_jacobian(term_factors(j + 1, stages, step), even, odd, &
                                             this%work)
        end do
        !$omp parallel do if (size(v) > worth_threads) schedule(static) default(shared) private(i)
        do i = 1, size(v)
          v(i) = v(i) + part*(odd(i) - v(i))
        end do
        !$omp end parallel do
        before = evolution%root_mean_square(v)
        ! More than that would amplify rounding errors, whatever becomes of it later.
        if (before > 1.0e4_wp) exit
      end do
    end associate
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

  !> The factors of term j of the recurrence: of the difference of the two before, and of the rate.
  pure function term_factors(j, stages, step) result(c)
    integer, intent(in) :: j, stages
    real(wp), intent(in) :: step
    real(wp) :: c(3)

    c(1) = 1
    c(2) = (j - 1.0_wp)/j
    ! w₁ is three times the place of the first stage.
    c(3) = (2*j - 1.0_wp)/j*3*first_place(stages)*step
  end function term_factors

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
    real(wp) :: third
    integer :: stages, k

    call make_room(this, size(u))
    if (.not. this%started) then
      call evolution%rate(time, u, this%rate_start)
      this%evaluations = this%evaluations + 1
    end if
    stages = rkl2_stages(step, spectral_radius)
    if (evolution%is_linear() .and. .not. evolution%depends_on_time()) then
      call take_terms(this, evolution, time, step, stages, u, u_next)
    else
      call take_stages(this, evolution, time, step, stages, u, u_next)
    end if
    call evolution%rate(time + step, u_next, this%rate_end)
    this%evaluations = this%evaluations + stages

    ! The step's error is (c - 1/6) u''' Δt³, c being the third coefficient of the method's
    ! stability polynomial. The trapezoidal rule misses u''' Δt³/12 the other way: its defect shows
    ! the sum. It takes the place of a rate that is needed again only if the step is taken back.
    this%started = .false.
    !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(u)
      this%rate_start(k) = u(k) - u_next(k) + 0.5_wp*step*(this%rate_start(k) + this%rate_end(k))
    end do
    !$omp end parallel do
    call evolution%clear_prescribed(this%rate_start)
    third = third_coefficient(stages)
    this%error_factor = (1.0_wp/6 - third)/(1.0_wp/4 - third)
    local_error = this%error_factor*evolution%root_mean_square(this%rate_start)
  end subroutine advance

  !> From u to the last stage, an odd one, by stages as they are written for any F
  subroutine take_stages(this, evolution, time, step, stages, u, u_next)
    class(rkl2_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: time, step
    integer, intent(in) :: stages
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(inout), contiguous :: u_next(:)
    real(wp) :: place
    integer :: j, k

    place = first_place(stages)
    !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(u)
      this%rate_end(k) = u(k)
      u_next(k) = u(k) + place*step*this%rate_start(k)
    end do
    !$omp end parallel do
    call evolution%impose(time + place*step, u_next)
    do j = 2, stages, 2
      call take_stage(j, u_next, this%rate_end)
      call take_stage(j + 1, this%rate_end, u_next)
    end do

  contains

    !> From the last stage and the one before, whose place it takes, to stage j
    subroutine take_stage(j, newer, older)
      integer, intent(in) :: j
      real(wp), intent(in), contiguous :: newer(:)
      real(wp), intent(inout), contiguous :: older(:)

      call evolution%combine_with_rate(time + place*step, factors(j, stages, step), newer, u, &
                                       this%rate_start, older, this%work)
      place = (real(j, wp)**2 + j - 2)/(real(stages, wp)**2 + stages - 2)
      call evolution%impose(time + place*step, older)
    end subroutine take_stage

  end subroutine take_stages

  !> The same for F that is linear and knows no time, by terms of Legendre's recurrence. Prescribed
  !> entries have no rate, so that none of them changes.
  subroutine take_terms(this, evolution, time, step, stages, u, u_next)
    class(rkl2_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: time, step
    integer, intent(in) :: stages
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(inout), contiguous :: u_next(:)
    real(wp) :: c(3), part
    integer :: j, k

    c = term_factors(1, stages, step)
    !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(u)
      this%rate_end(k) = u(k)
      u_next(k) = u(k) + c(3)*this%rate_start(k)
    end do
    !$omp end parallel do
    do j = 2, stages, 2
      call evolution%recur_with_rate(time, term_factors(j, stages, step), u_next, this%rate_end, &
                                     this%work)
      call evolution%recur_with_rate(time, term_factors(j + 1, stages, step), this%rate_end, &
                                     u_next, this%work)
    end do
    part = weight_b(stages)
    !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(u)
      u_next(k) = u(k) + part*(u_next(k) - u(k))
    end do
    !$omp end parallel do
  end subroutine take_terms

  !> Arrays for so many unknowns, where there are none yet
  subroutine make_room(this, unknowns)
    class(rkl2_t), intent(inout) :: this
    integer, intent(in) :: unknowns

    if (.not. allocated(this%rate_start)) then
      allocate (this%rate_start(unknowns))
      call prefer_huge_pages(this%rate_start)
    end if
    if (.not. allocated(this%rate_end)) then
      allocate (this%rate_end(unknowns))
      call prefer_huge_pages(this%rate_end)
    end if
  end subroutine make_room

  subroutine accept(this)
    class(rkl2_t), intent(inout) :: this
    real(wp), allocatable :: spare(:)

    call move_alloc(this%rate_start, spare)
    call move_alloc(this%rate_end, this%rate_start)
    call move_alloc(spare, this%rate_end)
    this%started = .true.
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
      total(k) = total(k) + this%error_factor*this%rate_end(k)
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
  end subroutine restore_rkl2

end module calor_rkl2
