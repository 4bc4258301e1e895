!> The forward Euler method: first order, one evaluation a step, stable for |λ| Δt ≤ 2.
module calor_forward_euler
  use calor_constants, only: worth_threads
  use calor_evolution, only: evolution_t
  use calor_integrator, only: integrator_t
  use calor_kinds, only: wp
  use calor_saved_state, only: saved_state_t
  implicit none (type, external)
  private

  public :: forward_euler_t

  type, extends(integrator_t) :: forward_euler_t
    private
    !> F at the start of the step being computed, of the last one and of the one before
    real(wp), allocatable :: rate(:), last(:), before(:)
  contains
    procedure :: longest_stable_step
    procedure :: longest_monotone_step
    procedure :: estimates_error
    procedure :: order
    procedure :: advance
    procedure :: accept
    procedure :: add_step_error
    procedure :: restart
    procedure :: save => save_euler
    procedure :: restore => restore_euler
  end type forward_euler_t

contains

  pure function longest_stable_step(this, spectral_radius) result(step)
    class(forward_euler_t), intent(in) :: this
    real(wp), intent(in) :: spectral_radius
    real(wp) :: step

    step = 2/spectral_radius
  end function longest_stable_step

  pure function longest_monotone_step(this, fastest_decay) result(step)
    class(forward_euler_t), intent(in) :: this
    real(wp), intent(in) :: fastest_decay
    real(wp) :: step

    ! u_i + Δt Σ a_ij u_j is a mean of temperatures as long as 1 + Δt a_ii is no negative weight.
    associate (unused => this)
    end associate
    step = 1/fastest_decay
  end function longest_monotone_step

  pure function estimates_error(this) result(answer)
    class(forward_euler_t), intent(in) :: this
    logical :: answer

    answer = .false.
  end function estimates_error

  pure function order(this)
    class(forward_euler_t), intent(in) :: this
    integer :: order

    associate (unused => this)
    end associate
    order = 1
  end function order

  subroutine advance(this, evolution, time, step, spectral_radius, u, u_next, local_error)
    class(forward_euler_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: time, step
    real(wp), intent(in) :: spectral_radius
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(out), contiguous :: u_next(:)
    real(wp), intent(out) :: local_error
    integer :: k

    if (.not. allocated(this%rate)) allocate (this%rate(size(u)))
    call evolution%rate(time, u, this%rate)
    this%evaluations = this%evaluations + 1
    !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(u)
      u_next(k) = u(k) + step*this%rate(k)
    end do
    !$omp end parallel do
    call evolution%impose(time + step, u_next)
    local_error = 0
  end subroutine advance

  subroutine accept(this)
    class(forward_euler_t), intent(inout) :: this
    real(wp), allocatable :: spare(:)

    call move_alloc(this%before, spare)
    call move_alloc(this%last, this%before)
    call move_alloc(this%rate, this%last)
    call move_alloc(spare, this%rate)
  end subroutine accept

  !> Δt²/2 u'', from the change of F since the step before; the first step tells nothing.
  subroutine add_step_error(this, step, total)
    class(forward_euler_t), intent(in) :: this
    real(wp), intent(in) :: step
    real(wp), intent(inout), contiguous :: total(:)
    integer :: k

    if (.not. allocated(this%before)) return
    !$omp parallel do if (size(total) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(total)
      total(k) = total(k) + 0.5_wp*step*(this%last(k) - this%before(k))
    end do
    !$omp end parallel do
  end subroutine add_step_error

  subroutine restart(this)
    class(forward_euler_t), intent(inout) :: this

    if (allocated(this%before)) deallocate (this%before)
    if (allocated(this%last)) deallocate (this%last)
  end subroutine restart

  subroutine save_euler(this, state)
    class(forward_euler_t), intent(in) :: this
    type(saved_state_t), intent(inout) :: state

    call state%put('evaluations', this%evaluations)
    if (allocated(this%last)) call state%put('last', this%last)
    if (allocated(this%before)) call state%put('before', this%before)
  end subroutine save_euler

  subroutine restore_euler(this, state)
    class(forward_euler_t), intent(inout) :: this
    type(saved_state_t), intent(inout) :: state

    call state%get('evaluations', this%evaluations)
    call this%restart()
    if (state%has('last')) call state%get('last', this%last)
    if (state%has('before')) call state%get('before', this%before)
  end subroutine restore_euler

end module calor_forward_euler
