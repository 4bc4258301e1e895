!> The classical Runge–Kutta method: fourth order, four evaluations a step, stable for real
!> λ Δt ≥ -2.785.
module calor_runge_kutta_4
  use calor_constants, only: worth_threads
  use calor_evolution, only: evolution_t
  use calor_integrator, only: integrator_t
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: runge_kutta_4_t

  type, extends(integrator_t) :: runge_kutta_4_t
    private
    real(wp), allocatable :: stage(:), slope(:)
  contains
    procedure :: longest_stable_step
    procedure :: longest_monotone_step
    procedure :: estimates_error
    procedure :: order
    procedure :: advance
  end type runge_kutta_4_t

  !> Where |1 + z + z²/2 + z³/6 + z⁴/24| = 1 on the negative real axis
  real(wp), parameter :: real_stability_limit = 2.785293563405282_wp

contains

  pure function longest_stable_step(this, spectral_radius) result(step)
    class(runge_kutta_4_t), intent(in) :: this
    real(wp), intent(in) :: spectral_radius
    real(wp) :: step

    step = real_stability_limit/spectral_radius
  end function longest_stable_step

  pure function longest_monotone_step(this, fastest_decay) result(step)
    class(runge_kutta_4_t), intent(in) :: this
    real(wp), intent(in) :: fastest_decay
    real(wp) :: step

    ! 1 + z + z²/2 + z³/6 + z⁴/24 = 3/8 + (1 + z)/3 + (1 + z)²/4 + (1 + z)⁴/24: a mean of forward
    ! Euler steps of the full length.
    associate (unused => this)
    end associate
    step = 1/fastest_decay
  end function longest_monotone_step

  pure function estimates_error(this) result(answer)
    class(runge_kutta_4_t), intent(in) :: this
    logical :: answer

    answer = .false.
  end function estimates_error

  pure function order(this)
    class(runge_kutta_4_t), intent(in) :: this
    integer :: order

    associate (unused => this)
    end associate
    order = 4
  end function order

  subroutine advance(this, evolution, time, step, spectral_radius, u, u_next, local_error)
    class(runge_kutta_4_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: time, step
    real(wp), intent(in) :: spectral_radius
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(out), contiguous :: u_next(:)
    real(wp), intent(out) :: local_error
    real(wp), parameter :: node(4) = [0.0_wp, 0.5_wp, 0.5_wp, 1.0_wp]
    real(wp), parameter :: share(4) = [1.0_wp, 2.0_wp, 2.0_wp, 1.0_wp]/6.0_wp
    real(wp) :: next
    integer :: k, j

    if (.not. allocated(this%stage)) allocate (this%stage(size(u)), this%slope(size(u)))
    u_next = u
    this%stage = u
    do j = 1, 4
      call evolution%rate(time + node(j)*step, this%stage, this%slope)
      ! Where the next stage lies; after the fourth there is none and its result is not used
      next = node(min(j + 1, 4))*step
      !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
      do k = 1, size(u)
        u_next(k) = u_next(k) + share(j)*step*this%slope(k)
        this%stage(k) = u(k) + next*this%slope(k)
      end do
      !$omp end parallel do
      call evolution%impose(time + next, this%stage)
    end do
    call evolution%impose(time + step, u_next)
    this%evaluations = this%evaluations + 4
    local_error = 0
  end subroutine advance

end module calor_runge_kutta_4
