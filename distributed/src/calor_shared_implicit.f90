!> Implicit steps on several ranks by PETSc's TS.
!>
!> The method is BDF of second order with error control, each step solved by BiCGStab with algebraic
!> multigrid, unless PETSc's options say otherwise (-ts_type, -ts_bdf_order, -ksp_type, -pc_type,
!> …).
module calor_shared_implicit
  use calor_error, only: error_t, raise, status_bad_numbers
  use calor_kinds, only: wp
  use calor_shared_conduction, only: shared_conduction_t
  use calor_text, only: to_text
  use petscts, only: tts, tsnes, tksp, tpc, tmat, tvec, petsc_null_function, petsc_null_vec, &
                     vecgetarrayf90, vecgetarrayreadf90, vecrestorearrayf90, &
                     vecrestorearrayreadf90, same_nonzero_pattern, ts_exactfinaltime_matchstep
  ! PETSc's procedures have no interfaces of their own.
  ! allow(C003)
  implicit none (type)
  private

  public :: implicit_stepper_t

  !> What a linear solution may leave of its right side
  real(wp), parameter :: residual_part = 1.0e-12_wp

  !> What PETSc hands back to the residual and its derivative
  type :: context_t
    type(shared_conduction_t), pointer :: conduction => null()
  end type context_t

  type :: implicit_stepper_t
    type(tts), private :: stepper
    type(tvec), private :: state
    type(tmat), private :: jacobian
    type(context_t), private :: context
    logical, private :: made = .false.
    !> Steps taken, and steps taken back
    integer :: steps = 0, rejected = 0
  contains
    !> Step from one time to another
    procedure :: advance_to
    !> Give back what PETSc keeps
    procedure :: finish
    procedure, private :: make
  end type implicit_stepper_t

contains

  !> Steps end exactly at the time.
  subroutine advance_to(this, conduction, time, end_time, tolerance, first_step, u, error)
    class(implicit_stepper_t), intent(inout), target :: this
    !> The heat equation, its rows in the matrix; it must not move between calls
    type(shared_conduction_t), intent(inout), target :: conduction
    !> Time before and after, and the one to reach, s
    real(wp), intent(inout) :: time
    real(wp), intent(in) :: end_time
    !> Error that a step may make, root mean square, K; and the first step to try, s
    real(wp), intent(in) :: tolerance, first_step
    !> Temperatures of the particles here
    real(wp), intent(inout), contiguous :: u(:)
    !> The numbers went wrong; on all ranks the same
    type(error_t), allocatable, intent(out) :: error
    real(wp), pointer :: values(:)
    integer :: failed, reason

    if (.not. this%made) call this%make(conduction, time, tolerance, first_step)
    associate (first => conduction%own_first, last => conduction%own_last)
      call vecgetarrayf90(this%state, values, failed)
      values = u(first:last)
      call vecrestorearrayf90(this%state, values, failed)
      call tssetmaxtime(this%stepper, end_time, failed)
      call tssolve(this%stepper, this%state, failed)
      call tsgetconvergedreason(this%stepper, reason, failed)
      call tsgetstepnumber(this%stepper, this%steps, failed)
      call tsgetsteprejections(this%stepper, this%rejected, failed)
      call vecgetarrayf90(this%state, values, failed)
      u(first:last) = values
      call vecrestorearrayf90(this%state, values, failed)
    end associate
    if (reason < 0) then
      call tsgettime(this%stepper, time, failed)
      call raise(error, status_bad_numbers, 'At t = '//to_text(time, &
                                                               digits=6)//' s the implicit '// &
                 'steps came to an end: no solution, or no step that is short enough. Try '// &
                 'another solver, as by -ksp_type gmres -pc_type asm, or method = ''rkl2''.')
      return
    end if
    time = end_time
    call conduction%inspect(time, u, error)
  end subroutine advance_to

  subroutine make(this, conduction, time, tolerance, first_step)
    class(implicit_stepper_t), intent(inout), target :: this
    type(shared_conduction_t), intent(inout), target :: conduction
    real(wp), intent(in) :: time, tolerance, first_step
    type(tsnes) :: newton
    type(tksp) :: solver
    type(tpc) :: preconditioner
    integer :: failed

    this%context%conduction => conduction
    call conduction%make_jacobian(-1.0_wp, this%jacobian, 1/first_step)
    associate (comm => conduction%ranks%comm%mpi_val, &
               own => conduction%own_last - conduction%own_first + 1)
      call veccreatempi(comm, own, int(conduction%particles), this%state, failed)
      call tscreate(comm, this%stepper, failed)
    end associate
    call tssettype(this%stepper, 'bdf', failed)
    call tssetifunction(this%stepper, petsc_null_vec, residual, this%context, failed)
    call tssetijacobian(this%stepper, this%jacobian, this%jacobian, derivative, this%context, &
                        failed)
    call tssettime(this%stepper, time, failed)
    call tssettimestep(this%stepper, first_step, failed)
    call tssetmaxsteps(this%stepper, huge(1), failed)
    call tssetexactfinaltime(this%stepper, ts_exactfinaltime_matchstep, failed)
    call tssettolerances(this%stepper, tolerance, petsc_null_vec, 0.0_wp, petsc_null_vec, failed)
    call tsgetsnes(this%stepper, newton, failed)
    if (conduction%is_linear()) call snessettype(newton, 'ksponly', failed)
    call snesgetksp(newton, solver, failed)
    call kspsettype(solver, 'bcgs', failed)
    call kspgetpc(solver, preconditioner, failed)
    call pcsettype(preconditioner, 'gamg', failed)
    call kspsettolerances(solver, residual_part, 1.0e-300_wp, 1.0e10_wp, 1000, failed)
    call tssetfromoptions(this%stepper, failed)
    this%made = .true.
  end subroutine make

  subroutine finish(this)
    class(implicit_stepper_t), intent(inout) :: this
    integer :: failed

    if (.not. this%made) return
    call tsdestroy(this%stepper, failed)
    call vecdestroy(this%state, failed)
    call matdestroy(this%jacobian, failed)
    this%made = .false.
  end subroutine finish

  !> u_t - F(t, u); at prescribed entries u less what is prescribed.
  subroutine residual(stepper, time, u, change, result, context, failed)
    type(tts), intent(inout) :: stepper
    real(wp), intent(in) :: time
    type(tvec), intent(inout) :: u, change, result
    type(context_t), intent(inout) :: context
    integer, intent(out) :: failed
    real(wp), pointer :: values(:), changes(:), results(:)
    real(wp), allocatable :: state(:), rate(:), given(:), free(:)

    associate (unused => stepper, conduction => context%conduction, &
               first => context%conduction%own_first, last => context%conduction%own_last)
      allocate (state(conduction%unknowns()), source=0.0_wp)
      allocate (rate(size(state)))
      allocate (free(size(state)), source=1.0_wp)
      call vecgetarrayreadf90(u, values, failed)
      state(first:last) = values
      call vecrestorearrayreadf90(u, values, failed)
      given = state
      call conduction%impose(time, given)
      call conduction%clear_prescribed(free)
      call conduction%rate(time, given, rate)
      call vecgetarrayreadf90(change, changes, failed)
      call vecgetarrayf90(result, results, failed)
      results = merge(changes - rate(first:last), state(first:last) - given(first:last), &
                      free(first:last) > 0.5_wp)
      call vecrestorearrayf90(result, results, failed)
      call vecrestorearrayreadf90(change, changes, failed)
    end associate
    failed = 0
  end subroutine residual

  !> shift - ∂F/∂u; 1 at prescribed entries.
  subroutine derivative(stepper, time, u, change, shift, matrix, preconditioner, context, failed)
    type(tts), intent(inout) :: stepper
    real(wp), intent(in) :: time, shift
    type(tvec), intent(inout) :: u, change
    type(tmat), intent(inout) :: matrix, preconditioner
    type(context_t), intent(inout) :: context
    integer, intent(out) :: failed
    type(tmat) :: jacobian
    real(wp), pointer :: values(:)
    real(wp), allocatable :: state(:)

    associate (unused => stepper, also => change, and => matrix, conduction => context%conduction, &
               first => context%conduction%own_first, last => context%conduction%own_last)
      allocate (state(conduction%unknowns()), source=0.0_wp)
      call vecgetarrayreadf90(u, values, failed)
      state(first:last) = values
      call vecrestorearrayreadf90(u, values, failed)
      call conduction%linearise(time, state)
      call conduction%make_jacobian(-1.0_wp, jacobian, shift)
      call matcopy(jacobian, preconditioner, same_nonzero_pattern, failed)
      call matdestroy(jacobian, failed)
    end associate
    failed = 0
  end subroutine derivative

end module calor_shared_implicit
