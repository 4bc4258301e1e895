!> The method TR-BDF2, implicit, of second order and L-stable: any step is stable, and what
!> decays faster than the step is gone after it.
!>
!> A step goes to t + γ Δt by the trapezoidal rule and from there to its end by the second backward
!> differentiation formula; with γ = 2 - √2 both stages have one matrix, 1 - d Δt J, d = γ/2:
!>
!>     z   = u + d Δt (F(u) + F(z))
!>     u_1 = u + Δt (w F(u) + w F(z) + d F(u_1)),   w = √2/4
!>
!> It carries a formula of third order on the same stages. Their difference, of which a solution
!> with the same matrix takes what is large only because it is stiff, is the estimated error.
!>
!> Sources: R.E. Bank, W.M. Coughran, W. Fichtner, E.H. Grosse, D.J. Rose, R.K. Smith, IEEE Trans.
!> Electron Devices 32 (1985) 1992–2007; M.E. Hosea, L.F. Shampine, Analysis and implementation of
!> TR-BDF2, Appl. Numer. Math. 20 (1996) 21–37.
module calor_tr_bdf2
  use calor_constants, only: worth_threads
  use calor_evolution, only: evolution_t
  use calor_implicit_system, only: implicit_system_t
  use calor_integrator, only: integrator_t
  use calor_kinds, only: wp
  use calor_saved_state, only: saved_state_t
  use calor_sums, only: root_mean_square
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: tr_bdf2_t

  real(wp), parameter :: root = sqrt(2.0_wp)
  !> γ, d and w
  real(wp), parameter :: middle = 2 - root, own = middle/2, w = root/4
  !> Weights of the third order less those of the second
  real(wp), parameter :: difference(3) = [(1 - 4*w)/3, 1.0_wp/3, -2*own/3]
  !> Newton's method ends when what is left of it is this part of the tolerance
  real(wp), parameter :: newton_part = 0.02_wp
  !> Where a correction is not this part of the one before, the Jacobian is found anew; where late
  !> ones still are as large as those before, or after the last, the step is given up
  real(wp), parameter :: slow = 0.2_wp, hopeless = 0.9_wp
  integer, parameter :: most_grown = 6, most_corrections = 15
  !> Without error control, stages are solved to this part of the state
  real(wp), parameter :: least_part = 1.0e-11_wp
  !> A step grows only if by so much: a new step takes new factors
  real(wp), parameter :: least_growth = 2.0_wp, most_growth = 10.0_wp

  type, extends(integrator_t) :: tr_bdf2_t
    !> Its linear systems
    type(implicit_system_t) :: system
    !> F at the start, at the stage and at the end of the step
    real(wp), allocatable, private :: rate_start(:), rate_stage(:), rate_end(:)
    !> The stage, what a stage starts from, and the estimated error
    real(wp), allocatable, private :: stage(:), base(:), estimate(:)
    !> Room for corrections
    real(wp), allocatable, private :: residual(:), correction(:)
    !> Whether rate_start belongs to the state that the next step starts from
    logical, private :: started = .false.
    !> Where the Jacobian was found: the time, s, and the state, where it depends on that
    real(wp), private :: jacobian_time = 0.0_wp
    real(wp), allocatable, private :: jacobian_state(:)
    !> Jacobian and factors for this d Δt are to be found again, for a state taken up; negative: no
    real(wp), private :: restored_shift = -1.0_wp
  contains
    procedure :: longest_stable_step
    procedure :: estimates_error
    procedure :: order
    procedure :: next_step
    procedure :: advance
    procedure :: accept
    procedure :: add_step_error
    procedure :: restart
    procedure :: save => save_tr_bdf2
    procedure :: restore => restore_tr_bdf2
    procedure, private :: find_jacobian
    procedure, private :: solve_stage
  end type tr_bdf2_t

contains

  !> As good as infinite
  pure function longest_stable_step(this, spectral_radius) result(step)
    class(tr_bdf2_t), intent(in) :: this
    real(wp), intent(in) :: spectral_radius
    real(wp) :: step

    associate (unused => this, also => spectral_radius)
    end associate
    step = sqrt(huge(step))
  end function longest_stable_step

  pure function estimates_error(this) result(answer)
    class(tr_bdf2_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .true.
  end function estimates_error

  pure function order(this)
    class(tr_bdf2_t), intent(in) :: this
    integer :: order

    associate (unused => this)
    end associate
    order = 2
  end function order

  pure function next_step(this, step, local_error) result(proposed)
    class(tr_bdf2_t), intent(in) :: this
    real(wp), intent(in) :: step
    real(wp), intent(in) :: local_error
    real(wp) :: proposed
    real(wp) :: factor

    factor = 0.9_wp*(this%tolerance/max(local_error, 1.0e-4_wp*this%tolerance))**(1.0_wp/3)
    if (factor >= 1 .and. factor < least_growth) factor = 1
    ! A step that was good enough is so once more, as near as that is to the limit.
    if (factor < 1 .and. local_error <= 0.8_wp*this%tolerance) factor = 1
    proposed = step*min(most_growth, max(0.1_wp, factor))
  end function next_step

  subroutine advance(this, evolution, time, step, spectral_radius, u, u_next, local_error)
    class(tr_bdf2_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: time, step
    real(wp), intent(in) :: spectral_radius
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(out), contiguous :: u_next(:)
    real(wp), intent(out) :: local_error
    real(wp) :: accuracy
    integer :: k, n
    logical :: done

    associate (unused => spectral_radius)
    end associate
    n = size(u)
    if (.not. allocated(this%stage)) then
      if (.not. allocated(this%rate_start)) allocate (this%rate_start(n))
      allocate (this%rate_stage(n), this%rate_end(n), this%stage(n), &
                this%base(n), this%estimate(n), this%residual(n), this%correction(n))
    end if
    if (allocated(this%failure)) deallocate (this%failure)
    u_next = u
    local_error = huge(local_error)
    if (.not. this%started) then
      call evolution%rate(time, u, this%rate_start)
      this%evaluations = this%evaluations + 1
      this%started = .true.
    end if
    if (.not. this%system%is_loaded()) then
      if (this%restored_shift >= 0 .and. allocated(this%jacobian_state)) then
        call this%find_jacobian(evolution, this%jacobian_time, (this%jacobian_state))
      else
        call this%find_jacobian(evolution, time, u)
      end if
      if (allocated(this%failure)) return
    end if
    done = .true.
    if (this%restored_shift >= 0) call this%system%set_shift(this%restored_shift, done)
    this%restored_shift = -1
    if (done) call this%system%set_shift(own*step, done)
    if (.not. done) then
      this%failure = 'the matrix of a step of '//to_text(step, digits=3)//' s is singular'
      return
    end if
    accuracy = this%tolerance
    if (.not. accuracy > 0) accuracy = least_part/newton_part*root_mean_square(u)

    !$omp parallel do if (n > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, n
      this%base(k) = u(k) + own*step*this%rate_start(k)
      this%stage(k) = u(k)
    end do
    !$omp end parallel do
    call this%solve_stage(evolution, time + middle*step, step, accuracy, this%stage, &
                          this%rate_stage)
    if (allocated(this%failure)) return
    !$omp parallel do if (n > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, n
      this%base(k) = u(k) + w*step*(this%rate_start(k) + this%rate_stage(k))
      u_next(k) = u(k) + (this%stage(k) - u(k))/middle
    end do
    !$omp end parallel do
    call this%solve_stage(evolution, time + step, step, accuracy, u_next, this%rate_end)
    if (allocated(this%failure)) return

    !$omp parallel do if (n > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, n
      this%residual(k) = step*(difference(1)*this%rate_start(k) + &
                               difference(2)*this%rate_stage(k) + difference(3)*this%rate_end(k))
    end do
    !$omp end parallel do
    call evolution%clear_prescribed(this%residual)
    call this%system%solve(this%residual, 0.01_wp*accuracy, this%estimate, done)
    if (.not. done) this%estimate = this%residual
    local_error = root_mean_square(this%estimate)
  end subroutine advance

  !> Find u with u - d Δt F(t, u) = base where nothing is prescribed, by Newton's method with one
  !> Jacobian for as long as that serves.
  subroutine solve_stage(this, evolution, time, step, accuracy, u, rate)
    class(tr_bdf2_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    !> Of the stage, s
    real(wp), intent(in) :: time
    !> The whole step, s
    real(wp), intent(in) :: step
    !> Error that the step may make
    real(wp), intent(in) :: accuracy
    !> A first guess; the stage
    real(wp), intent(inout), contiguous :: u(:)
    !> F there, as the stage's equation has it
    real(wp), intent(out), contiguous :: rate(:)
    real(wp) :: correction, before, ratio
    integer :: iteration, k
    logical :: done

    before = 0
    call evolution%impose(time, u)
    do iteration = 1, most_corrections
      call evolution%rate(time, u, rate)
      this%evaluations = this%evaluations + 1
      !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
      do k = 1, size(u)
        this%residual(k) = this%base(k) - u(k) + own*step*rate(k)
      end do
      !$omp end parallel do
      call evolution%clear_prescribed(this%residual)
      call this%system%solve(this%residual, 0.1_wp*newton_part*accuracy, this%correction, done)
      if (.not. done) then
        ! A copy of an integrator has no factors; else the iteration did not converge.
        call this%system%set_shift(own*step, done)
        if (done) call this%system%solve(this%residual, 0.1_wp*newton_part*accuracy, &
                                         this%correction, done)
      end if
      if (.not. done) then
        this%failure = 'the linear equations of a step of '//to_text(step, digits=3)// &
                       ' s could not be solved'
        return
      end if
      !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
      do k = 1, size(u)
        u(k) = u(k) + this%correction(k)
      end do
      !$omp end parallel do
      if (evolution%is_linear()) exit
      correction = root_mean_square(this%correction)
      if (.not. correction <= huge(correction)) exit
      ratio = 0.5_wp
      if (iteration > 1) ratio = correction/max(before, tiny(before))
      if (correction*min(1.0_wp, ratio/max(0.1_wp, 1 - ratio)) <= newton_part*accuracy) exit
      if (iteration == most_corrections .or. (ratio > hopeless .and. iteration > most_grown)) then
        this%failure = 'Newton''s method does not converge in a step of '// &
                       to_text(step, digits=3)//' s'
        return
      end if
      before = correction
      if (ratio > slow .and. iteration > 1) then
        call this%find_jacobian(evolution, time, u)
        call this%system%set_shift(own*step, done)
      end if
    end do
    !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(u)
      rate(k) = (u(k) - this%base(k))/(own*step)
    end do
    !$omp end parallel do
    call evolution%clear_prescribed(rate)
  end subroutine solve_stage

  subroutine find_jacobian(this, evolution, time, u)
    class(tr_bdf2_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    integer, allocatable :: first(:), index(:)
    real(wp), allocatable :: value(:)
    logical :: known

    call evolution%linearise(time, u)
    call evolution%jacobian_rows(first, index, value, known)
    if (.not. known) then
      this%failure = 'an effect in force does not tell how its rate depends on the temperature'
      return
    end if
    call this%system%load(first, index, value)
    this%jacobian_time = time
    if (.not. evolution%is_linear()) this%jacobian_state = u
  end subroutine find_jacobian

  subroutine accept(this)
    class(tr_bdf2_t), intent(inout) :: this
    real(wp), allocatable :: spare(:)

    call move_alloc(this%rate_start, spare)
    call move_alloc(this%rate_end, this%rate_start)
    call move_alloc(spare, this%rate_end)
  end subroutine accept

  subroutine add_step_error(this, step, total)
    class(tr_bdf2_t), intent(in) :: this
    real(wp), intent(in) :: step
    real(wp), intent(inout), contiguous :: total(:)
    integer :: k

    associate (unused => step)
    end associate
    !$omp parallel do if (size(total) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(total)
      total(k) = total(k) + this%estimate(k)
    end do
    !$omp end parallel do
  end subroutine add_step_error

  subroutine restart(this)
    class(tr_bdf2_t), intent(inout) :: this

    this%started = .false.
  end subroutine restart

  subroutine save_tr_bdf2(this, state)
    class(tr_bdf2_t), intent(in) :: this
    type(saved_state_t), intent(inout) :: state

    call state%put('evaluations', this%evaluations)
    call state%put('iterative', this%system%iterative)
    call state%put('started', this%started)
    if (this%started) call state%put('rate_start', this%rate_start)
    if (.not. this%system%is_loaded()) return
    call state%put('jacobian_time', this%jacobian_time)
    call state%put('shift', this%system%present_shift())
    if (allocated(this%jacobian_state)) call state%put('jacobian_state', this%jacobian_state)
  end subroutine save_tr_bdf2

  subroutine restore_tr_bdf2(this, state)
    class(tr_bdf2_t), intent(inout) :: this
    type(saved_state_t), intent(inout) :: state

    call state%get('evaluations', this%evaluations)
    call state%get('iterative', this%system%iterative)
    call state%get('started', this%started)
    if (this%started) call state%get('rate_start', this%rate_start)
    if (.not. state%has('shift')) return
    call state%get('jacobian_time', this%jacobian_time)
    call state%get('shift', this%restored_shift)
    if (state%has('jacobian_state')) call state%get('jacobian_state', this%jacobian_state)
  end subroutine restore_tr_bdf2

end module calor_tr_bdf2
