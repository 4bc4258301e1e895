!> The steady temperature on several ranks by Newton's method, each step solved by PETSc.
module calor_shared_steady_state
  use calor_error, only: error_t, raise, status_bad_input, status_bad_numbers
  use calor_kinds, only: wp, i8
  use calor_shared_conduction, only: shared_conduction_t
  use calor_shared_solver, only: set_up_solver
  use calor_text, only: to_text
  use petscksp, only: tksp, tmat, tvec, petsc_null_scalar
  ! PETSc's procedures have no interfaces of their own.
  ! allow(C003)
  implicit none (type)
  private

  public :: find_shared_steady_state

  !> As with one process
  integer, parameter :: most_steps = 50, most_halvings = 12
  !> What a solution may leave of the right side, and iterations for that
  real(wp), parameter :: residual_part = 1.0e-13_wp
  integer, parameter :: most_iterations = 2000

contains

  subroutine find_shared_steady_state(conduction, place, tolerance, temperature, steps, error)
    !> The heat equation, its rows in the matrix
    type(shared_conduction_t), intent(inout) :: conduction
    !> Where the scene asks for it
    character(len=*), intent(in) :: place
    !> The change of any temperature at which the iteration ends, K
    real(wp), intent(in) :: tolerance
    !> A first guess; the steady temperature
    real(wp), intent(inout) :: temperature(:)
    !> Newton steps made
    integer, intent(out) :: steps
    !> There is no steady temperature, or it was not found; on all ranks the same
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: rate(:), change(:), guess(:)
    real(wp) :: before, part, largest
    integer :: halvings
    logical :: is_nonlinear, solved

    is_nonlinear = allocated(conduction%slope)
    if (allocated(conduction%content)) then
      is_nonlinear = is_nonlinear .or. conduction%content%conducts()
    end if
    call conduction%linearise(0.0_wp, temperature)
    call require_hold(conduction, place, error)
    if (allocated(error)) return
    allocate (rate(size(temperature)), change(size(temperature)))
    call conduction%rate(0.0_wp, temperature, rate)
    do steps = 1, most_steps
      call conduction%linearise(0.0_wp, temperature)
      call solve(conduction, rate, change, solved)
      if (.not. solved) then
        call raise(error, status_bad_numbers, &
                   place//': the equations of the steady temperature '// &
                   'could not be solved by the chosen solver: try -ksp_type gmres -pc_type '// &
                   'asm.')
        return
      end if
      before = conduction%root_mean_square(rate)
      part = 1
      do halvings = 0, most_halvings
        guess = temperature + part*change
        call conduction%rate(0.0_wp, guess, rate)
        if (conduction%root_mean_square(rate) <= before .or. .not. is_nonlinear) exit
        part = 0.5_wp*part
      end do
      temperature = guess
      largest = conduction%ranks%most(maxval(abs(change)))
      if (.not. largest <= huge(largest)) exit
      if (largest <= tolerance) return
    end do
    call raise(error, status_bad_numbers, place//': the steady temperature was not found in '// &
               to_text(most_steps)//' Newton steps; the last one changed it by '// &
               to_text(largest, digits=3)//' K. Start from a better &initial temperature, or '// &
               'let the scene run in time.')
  end subroutine find_shared_steady_state

  !> Solve J change = -rate, where held temperatures do not change.
  subroutine solve(conduction, rate, change, solved)
    type(shared_conduction_t), intent(inout) :: conduction
    real(wp), intent(in) :: rate(:)
    real(wp), intent(out) :: change(:)
    logical, intent(out) :: solved
    type(tmat) :: jacobian
    type(tksp) :: solver
    type(tvec) :: right, solution
    real(wp), allocatable :: negative(:), found(:)
    integer :: failed, reason, own

    associate (first => conduction%own_first, last => conduction%own_last)
      own = last - first + 1
      call conduction%make_jacobian(-1.0_wp, jacobian)
      negative = rate(first:last)
      allocate (found(own), source=0.0_wp)
      call veccreatempiwitharray(conduction%ranks%comm%mpi_val, 1, own, int(conduction%particles), &
                                 negative, right, failed)
      call veccreatempiwitharray(conduction%ranks%comm%mpi_val, 1, own, int(conduction%particles), &
                                 found, solution, failed)
      call kspcreate(conduction%ranks%comm%mpi_val, solver, failed)
      call kspsetoperators(solver, jacobian, jacobian, failed)
      call set_up_solver(solver, residual_part, most_iterations)
      call kspsolve(solver, right, solution, failed)
      call kspgetconvergedreason(solver, reason, failed)
      ! Rounding may keep the residual from falling as far as it is asked to.
      solved = reason > 0
      if (.not. solved) solved = nearly()
      change = 0
      change(first:last) = found
      call vecdestroy(right, failed)
      call vecdestroy(solution, failed)
      call kspdestroy(solver, failed)
      call matdestroy(jacobian, failed)
    end associate

  contains

    !> Whether the residual is at the level of rounding
    logical function nearly()
      type(tvec) :: residual
      real(wp) :: left, all_of_it

      call vecduplicate(right, residual, failed)
      call matmult(jacobian, solution, residual, failed)
      call vecaxpy(residual, -1.0_wp, right, failed)
      call vecnorm(residual, 1, left, failed)
      call vecnorm(right, 1, all_of_it, failed)
      nearly = left <= 1.0e-9_wp*all_of_it
      call vecdestroy(residual, failed)
    end function nearly

  end subroutine solve

  !> Something must tie the temperature down.
  subroutine require_hold(conduction, place, error)
    type(shared_conduction_t), intent(in) :: conduction
    character(len=*), intent(in) :: place
    type(error_t), allocatable, intent(out) :: error
    logical :: held
    integer :: k

    held = .false.
    do k = 1, size(conduction%prescribed)
      held = held .or. size(conduction%prescribed(k)%particle) > 0
    end do
    if (allocated(conduction%slope)) held = held .or. any(abs(conduction%slope) > 0)
    if (conduction%ranks%any_of(held)) return
    call raise(error, status_bad_input, place//': nothing ties the steady temperature down: '// &
               'hold it, or let it exchange heat by convection or radiation, on a part of the '// &
               'boundary at least.')
  end subroutine require_hold

end module calor_shared_steady_state
