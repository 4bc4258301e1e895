!> RKL2: the stabilised explicit Runge–Kutta–Legendre method of second order for diffusion.
!>
!> With s stages it is stable for |λ| Δt ≤ (s² + s - 2)/2, so its reach grows with the square of the
!> work: it takes as many stages as a step needs.
!>
!> Source: C.D. Meyer, D.S. Balsara, T.D. Aslam, J. Comput. Phys. 257 (2014) 594–626, equations
!> (15)–(19).
module calor_rkl2
  use calor_evolution, only: evolution_t
  use calor_integrator, only: integrator_t
  use calor_kinds, only: wp
  use calor_sums, only: root_mean_square
  implicit none (type, external)
  private

  public :: rkl2_t, rkl2_stages

  type, extends(integrator_t) :: rkl2_t
    private
    !> F at the start and at the end of the step
    real(wp), allocatable :: rate_start(:), rate_end(:)
    !> F of a stage, and the two stages before
    real(wp), allocatable :: rate_stage(:), stage(:, :)
    !> Whether rate_start belongs to the state that the next step starts from
    logical :: started = .false.
  contains
    procedure :: longest_stable_step
    procedure :: estimates_error
    procedure :: advance
    procedure :: accept
  end type rkl2_t

  !> Beyond some hundred stages rounding errors inside a step grow
  integer, parameter :: most_stages = 301

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

    step = 0.5_wp*(most_stages**2 + most_stages - 2)/spectral_radius
  end function longest_stable_step

  pure function estimates_error(this) result(answer)
    class(rkl2_t), intent(in) :: this
    logical :: answer

    answer = .true.
  end function estimates_error

  subroutine advance(this, evolution, time, step, spectral_radius, u, u_next, local_error)
    class(rkl2_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: time, step
    real(wp), intent(in) :: spectral_radius
    real(wp), intent(in) :: u(:)
    real(wp), intent(out) :: u_next(:)
    real(wp), intent(out) :: local_error
    real(wp) :: w1, mu, nu, mu_rate, gamma_rate, b(3), c, place
    integer :: stages, j, k, older, newer

    if (.not. allocated(this%stage)) then
      allocate (this%rate_start(size(u)), this%rate_end(size(u)), this%rate_stage(size(u)))
      allocate (this%stage(size(u), 2))
    end if
    if (.not. this%started) then
      call evolution%rate(time, u, this%rate_start)
      this%evaluations = this%evaluations + 1
      this%started = .true.
    end if

    stages = rkl2_stages(step, spectral_radius)
    w1 = 4.0_wp/(real(stages, wp)**2 + stages - 2)
    older = 1
    newer = 2
    place = w1/3
    !$omp parallel do schedule(static) default(shared) private(k)
    do k = 1, size(u)
      this%stage(k, older) = u(k)
      this%stage(k, newer) = u(k) + place*step*this%rate_start(k)
    end do
    !$omp end parallel do
    call evolution%impose(time + place*step, this%stage(:, newer))

    do j = 2, stages
      call evolution%rate(time + place*step, this%stage(:, newer), this%rate_stage)
      b = [weight_b(j), weight_b(j - 1), weight_b(j - 2)]
      mu = (2*j - 1)*b(1)/(j*b(2))
      nu = -(j - 1)*b(1)/(j*b(3))
      mu_rate = mu*w1*step
      gamma_rate = -(1 - b(2))*mu_rate
      !$omp parallel do schedule(static) default(shared) private(k)
      do k = 1, size(u)
        ! The stage before the last is no longer needed once it has entered here.
        this%stage(k, older) = mu*this%stage(k, newer) + nu*this%stage(k, older) + &
                               (1 - mu - nu)*u(k) + mu_rate*this%rate_stage(k) + &
                               gamma_rate*this%rate_start(k)
      end do
      !$omp end parallel do
      place = (real(j, wp)**2 + j - 2)*w1/4
      call evolution%impose(time + place*step, this%stage(:, older))
      newer = older
      older = 3 - newer
    end do
    u_next = this%stage(:, newer)
    call evolution%rate(time + step, u_next, this%rate_end)
    this%evaluations = this%evaluations + stages

    ! The step's error is (c - 1/6) u''' Δt³, c being the third coefficient of the method's
    ! stability polynomial. The trapezoidal rule misses u''' Δt³/12 the other way: its defect shows
    ! the sum.
    this%rate_stage = u - u_next + 0.5_wp*step*(this%rate_start + this%rate_end)
    call evolution%clear_prescribed(this%rate_stage)
    c = third_coefficient(stages)
    local_error = (1.0_wp/6 - c)/(1.0_wp/4 - c)*root_mean_square(this%rate_stage)
  end subroutine advance

  subroutine accept(this)
    class(rkl2_t), intent(inout) :: this
    real(wp), allocatable :: spare(:)

    call move_alloc(this%rate_start, spare)
    call move_alloc(this%rate_end, this%rate_start)
    call move_alloc(spare, this%rate_end)
  end subroutine accept

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

end module calor_rkl2
