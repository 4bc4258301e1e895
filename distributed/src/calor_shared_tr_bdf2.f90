!> TR-BDF2 on several ranks: the library's method, its steps made by PETSc's TS.
!>
!> TS has the stages of TR-BDF2 as ARKIMEX '2d', but an error estimate of first order. So the
!> tableau is registered anew with the embedded formula of third order that the library's method
!> has, and the library's stepper chooses lengths of steps: both programs take the same ones, and
!> what is laid aside is the state alone. Equations are solved by SNES and KSP.
module calor_shared_tr_bdf2
  use, intrinsic :: iso_c_binding, only: c_char, c_double, c_int, c_null_char, c_null_ptr, c_ptr
  use calor_conduction, only: conduction_t
  use calor_error, only: error_t
  use calor_evolution, only: evolution_t
  use calor_integrator, only: integrator_t
  use calor_integrators, only: make_integrator
  use calor_kinds, only: wp
  use calor_shared_conduction, only: shared_conduction_t
  use calor_shared_solver, only: set_up_solver
  use calor_text, only: to_text
  use calor_tr_bdf2, only: tr_bdf2_t
  use petscts, only: tts, ttsadapt, tsnes, tksp, tmat, tvec, petsc_null_vec, vecgetarrayf90, &
                     vecgetarrayreadf90, vecrestorearrayf90, vecrestorearrayreadf90, &
                     same_nonzero_pattern, ts_exactfinaltime_stepover
  ! PETSc's procedures have no interfaces of their own.
  ! allow(C003)
  implicit none (type)
  private

  public :: shared_tr_bdf2_t, make_shared_integrator

  !> What a linear solution may leave of its right side: so little that steps, whose lengths follow
  !> from the estimated error, are the same on any number of ranks
  real(wp), parameter :: residual_part = 1.0e-12_wp
  integer, parameter :: most_iterations = 1000
  !> Newton's method ends when what is left of it is this part of the tolerance
  real(wp), parameter :: newton_part = 1.0e-3_wp
  !> Without error control, of the state
  real(wp), parameter :: least_part = 1.0e-11_wp
  !> Steps count as equally long if they differ by no more than rounding
  real(wp), parameter :: rounding = 1.0e-11_wp

  real(wp), parameter :: root = sqrt(2.0_wp), own = 1 - root/2, w = root/4
  !> Stages, row after row, and the weights of third order (see calor_tr_bdf2)
  real(c_double), parameter :: stages(9) = [0.0_wp, 0.0_wp, 0.0_wp, own, own, 0.0_wp, w, w, own]
  real(c_double), parameter :: third_order(3) = [(1 - w)/3, (3*w + 1)/3, own/3]

  !> What PETSc hands back to the residual and its derivative
  type :: context_t
    type(shared_conduction_t), pointer :: conduction => null()
    !> 1/(d Δt) of the matrix; negative: there is none yet
    real(wp) :: shift = -1.0_wp
    !> How often a residual was computed
    integer :: evaluations = 0
  end type context_t

  type, extends(tr_bdf2_t) :: shared_tr_bdf2_t
    type(context_t), private :: context
    type(tts), private :: stepper
    type(tsnes), private :: newton
    type(tksp), private :: solver
    !> The state, the solution of third order, and the estimated error
    type(tvec), private :: state, other, filtered
    type(tmat), private :: jacobian
    logical, private :: made = .false.
  contains
    procedure :: advance
    !> Give back what PETSc keeps
    procedure :: finish
    procedure, private :: make
  end type shared_tr_bdf2_t

  interface
    integer(c_int) function tsarkimexregister(name, order, stages, at, bt, ct, a, b, c, bembedt, &
                                              bembed, pinterp, binterpt, binterp) &
        bind(c, name='TSARKIMEXRegister')
      import :: c_char, c_double, c_int, c_ptr
      implicit none (type, external)
      ! C's arrays
      ! allow(C071)
      character(kind=c_char), intent(in) :: name(*)
      integer(c_int), intent(in), value :: order, stages, pinterp
      ! allow(C071)
      real(c_double), intent(in) :: at(*), a(*), bembedt(*), binterpt(*)
      type(c_ptr), intent(in), value :: bt, ct, b, c, bembed, binterp
    end function tsarkimexregister
  end interface

contains

  !> Make the integrator of a name.
  subroutine make_shared_integrator(name, conduction, integrator, error)
    !> As in `make_integrator`
    character(len=*), intent(in) :: name
    !> The heat equation, its rows in the matrix; it must stay where it is
    class(conduction_t), intent(in), target :: conduction
    class(integrator_t), allocatable, intent(out) :: integrator
    !> There is none of that name
    type(error_t), allocatable, intent(out) :: error
    type(shared_tr_bdf2_t), allocatable :: implicit

    if (name /= 'tr_bdf2') then
      call make_integrator(name, integrator, error)
      return
    end if
    allocate (implicit)
    select type (conduction)
    type is (shared_conduction_t)
      implicit%context%conduction => conduction
    end select
    call move_alloc(implicit, integrator)
  end subroutine make_shared_integrator

  subroutine advance(this, evolution, time, step, spectral_radius, u, u_next, local_error)
    class(shared_tr_bdf2_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: time, step
    real(wp), intent(in) :: spectral_radius
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(out), contiguous :: u_next(:)
    real(wp), intent(out) :: local_error
    real(wp), pointer :: values(:)
    real(wp), allocatable :: difference(:)
    real(wp) :: accuracy
    integer :: failed, reason
    logical :: done

    associate (unused => spectral_radius)
    end associate
    if (.not. this%made) call this%make()
    if (allocated(this%failure)) deallocate (this%failure)
    u_next = u
    local_error = huge(local_error)
    accuracy = newton_part*this%tolerance
    if (.not. accuracy > 0) accuracy = least_part*evolution%root_mean_square(u)
    ! The residual of a stage is 1/(d Δt) times what is left.
    accuracy = accuracy/(own*step)*sqrt(real(evolution%all_unknowns(), wp))
    call snessettolerances(this%newton, accuracy, residual_part, 0.0_wp, 50, 10000, failed)
    associate (first => this%context%conduction%own_first, &
               last => this%context%conduction%own_last)
      call vecgetarrayf90(this%state, values, failed)
      values = u(first:last)
      call vecrestorearrayf90(this%state, values, failed)
      call tssettime(this%stepper, time, failed)
      call tssettimestep(this%stepper, step, failed)
      call tsstep(this%stepper, failed)
      this%evaluations = this%context%evaluations
      call tsgetconvergedreason(this%stepper, reason, failed)
      if (reason < 0) then
        this%failure = 'the equations of a step of '//to_text(step, digits=3)// &
                       ' s could not be solved by the chosen solver (others are taken by '// &
                       '-ksp_type gmres -pc_type asm)'
        return
      end if
      ! The difference to third order, of which what is large only because it is stiff is taken
      ! away by a solution with the same matrix
      call tsevaluatestep(this%stepper, 1, this%other, done, failed)
      call vecgetarrayreadf90(this%state, values, failed)
      u_next(first:last) = values
      call vecrestorearrayreadf90(this%state, values, failed)
      allocate (difference(size(u)), source=0.0_wp)
      call vecgetarrayf90(this%other, values, failed)
      difference(first:last) = values - u_next(first:last)
      call evolution%clear_prescribed(difference)
      values = difference(first:last)/(own*step)
      call vecrestorearrayf90(this%other, values, failed)
      call kspsolve(this%solver, this%other, this%filtered, failed)
      call kspgetconvergedreason(this%solver, reason, failed)
      if (reason > 0) then
        call vecgetarrayreadf90(this%filtered, values, failed)
        difference(first:last) = values
        call vecrestorearrayreadf90(this%filtered, values, failed)
      end if
    end associate
    local_error = evolution%root_mean_square(difference)
  end subroutine advance

  !> Each step is one of TS's, of the length that it is told.
  subroutine make(this)
    class(shared_tr_bdf2_t), intent(inout) :: this
    type(ttsadapt) :: choice
    integer :: failed

    failed = tsarkimexregister('tr_bdf2'//c_null_char, 2_c_int, 3_c_int, stages, c_null_ptr, &
                               c_null_ptr, stages, c_null_ptr, c_null_ptr, third_order, &
                               c_null_ptr, 1_c_int, stages(7:9), c_null_ptr)
    associate (conduction => this%context%conduction)
      call conduction%make_jacobian(-1.0_wp, this%jacobian, 1.0_wp)
      associate (comm => conduction%ranks%comm%mpi_val, &
                 held => conduction%own_last - conduction%own_first + 1)
        call veccreatempi(comm, held, int(conduction%particles), this%state, failed)
        call vecduplicate(this%state, this%other, failed)
        call vecduplicate(this%state, this%filtered, failed)
        call tscreate(comm, this%stepper, failed)
      end associate
      call tssettype(this%stepper, 'arkimex', failed)
      call tsarkimexsettype(this%stepper, 'tr_bdf2', failed)
      call tsarkimexsetfullyimplicit(this%stepper, .true., failed)
      call tssetifunction(this%stepper, petsc_null_vec, residual, this%context, failed)
      call tssetijacobian(this%stepper, this%jacobian, this%jacobian, derivative, this%context, &
                          failed)
      call tssetsolution(this%stepper, this%state, failed)
      call tssetmaxtime(this%stepper, 0.5_wp*huge(1.0_wp), failed)
      call tssetexactfinaltime(this%stepper, ts_exactfinaltime_stepover, failed)
      call tsgetadapt(this%stepper, choice, failed)
      call tsadaptsettype(choice, 'none', failed)
      ! A step that cannot be made is tried again by the library's stepper, shorter.
      call tssetmaxsnesfailures(this%stepper, 1, failed)
      call tsseterrorifstepfails(this%stepper, .false., failed)
      call tsgetsnes(this%stepper, this%newton, failed)
      if (conduction%is_linear()) call snessettype(this%newton, 'ksponly', failed)
    end associate
    call snesgetksp(this%newton, this%solver, failed)
    call set_up_solver(this%solver, residual_part, most_iterations)
    call snessetfromoptions(this%newton, failed)
    this%made = .true.
  end subroutine make

  subroutine finish(this)
    class(shared_tr_bdf2_t), intent(inout) :: this
    integer :: failed

    if (.not. this%made) return
    call tsdestroy(this%stepper, failed)
    call vecdestroy(this%state, failed)
    call vecdestroy(this%other, failed)
    call vecdestroy(this%filtered, failed)
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
      context%evaluations = context%evaluations + 1
      call vecgetarrayreadf90(change, changes, failed)
      call vecgetarrayf90(result, results, failed)
      results = merge(changes - rate(first:last), state(first:last) - given(first:last), &
                      free(first:last) > 0.5_wp)
      call vecrestorearrayf90(result, results, failed)
      call vecrestorearrayreadf90(change, changes, failed)
    end associate
    failed = 0
  end subroutine residual

  !> shift - ∂F/∂u; 1 at prescribed entries. A matrix that would be the same stays as it is, and
  !> with it the preconditioner.
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

    failed = 0
    associate (unused => stepper, also => change, and => matrix, conduction => context%conduction, &
               first => context%conduction%own_first, last => context%conduction%own_last)
      if (conduction%is_linear() .and. abs(shift - context%shift) <= rounding*shift) return
      context%shift = shift
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

end module calor_shared_tr_bdf2
