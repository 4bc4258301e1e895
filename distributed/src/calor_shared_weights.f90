!> Weights of particles with which a heat budget closes exactly, on several ranks.
!>
!> They are the left null vector of the operator L of the body insulated all around, scaled to its
!> area: wᵀ L = 0 (see calor_heat_budget). With D the diagonal matrix of the particles' areas, z =
!> D⁻¹ w solves (D L)ᵀ z = 0, and is about 1 everywhere. The columns of that matrix add up to 0, so
!> that any one equation follows from the others: in place of the first there stands z = 1.
module calor_shared_weights
  use calor_kinds, only: wp
  use calor_shared_conduction, only: shared_conduction_t
  use calor_shared_solver, only: set_up_solver
  use petscksp, only: tksp, tmat, tvec, norm_infinity, petsc_null_vec, &
                      different_nonzero_pattern, insert_values, mat_copy_values, &
                      mat_final_assembly, mat_initial_matrix
  ! PETSc's procedures have no interfaces of their own.
  ! allow(C003)
  implicit none (type)
  private

  public :: find_closing_weights

  !> What a solution may leave of the right side, as little as rounding allows; solutions for what
  !> the ones before have left
  real(wp), parameter :: residual_part = 1.0e-10_wp
  integer, parameter :: most_iterations = 1000, corrections = 1

contains

  !> All ranks take part.
  subroutine find_closing_weights(conduction, weight, found)
    !> The heat equation, its rows in the matrix
    type(shared_conduction_t), intent(inout) :: conduction
    !> One for each particle here, m²; 0 for those of other ranks
    real(wp), allocatable, intent(out) :: weight(:)
    !> Whether there are such weights
    logical, intent(out) :: found
    type(tmat) :: rows, columns
    type(tksp) :: solver
    type(tvec) :: solution, change, residual
    real(wp), allocatable :: own(:)
    real(wp) :: scale
    integer :: failed, k, reason

    associate (first => conduction%own_first, last => conduction%own_last, &
               area => conduction%medium%area)
      call insulated_rows(conduction, rows)
      call mattranspose(rows, mat_initial_matrix, columns, failed)
      call matdestroy(rows, failed)
      allocate (own(last - first + 1), source=1.0_wp)
      call veccreatempiwitharray(conduction%ranks%comm%mpi_val, 1, size(own), &
                                 int(conduction%particles), own, solution, failed)
      call vecduplicate(solution, change, failed)
      call vecduplicate(solution, residual, failed)
      ! A row of the size of the others
      call matnorm(columns, norm_infinity, scale, failed)
      call matzerorows(columns, merge(1, 0, conduction%ranks%speaks()), [0], scale, &
                       petsc_null_vec, petsc_null_vec, failed)
      call kspcreate(conduction%ranks%comm%mpi_val, solver, failed)
      call kspsetoperators(solver, columns, columns, failed)
      call set_up_solver(solver, residual_part, most_iterations)
      found = .true.
      do k = 0, corrections
        ! What is left of (D L)ᵀ z = 0; the first equation holds from the start.
        call matmult(columns, solution, residual, failed)
        if (conduction%ranks%speaks()) call vecsetvalues(residual, 1, [0], [0.0_wp], &
                                                         insert_values, failed)
        call vecassemblybegin(residual, failed)
        call vecassemblyend(residual, failed)
        call kspsolve(solver, residual, change, failed)
        call kspgetconvergedreason(solver, reason, failed)
        ! At the level of rounding there is nothing left to find.
        if (reason < 0) found = k > 0
        if (reason < 0) exit
        call vecaxpy(solution, -1.0_wp, change, failed)
      end do
      call kspdestroy(solver, failed)
      call matdestroy(columns, failed)
      call vecdestroy(change, failed)
      call vecdestroy(residual, failed)
      call vecdestroy(solution, failed)
      allocate (weight(size(area)), source=0.0_wp)
      weight(first:last) = own*area(first:last)
      weight = weight*conduction%ranks%total(sum(area(first:last)))/ &
               conduction%ranks%total(sum(weight))
    end associate
  end subroutine find_closing_weights

  !> D L: rows of all particles, held ones too, each times the area of its particle.
  subroutine insulated_rows(conduction, rows)
    type(shared_conduction_t), intent(inout) :: conduction
    !> To be destroyed by the caller
    type(tmat), intent(out) :: rows
    type(tmat) :: held
    type(tvec) :: factor
    real(wp), allocatable :: own(:)
    integer :: failed

    associate (first => conduction%own_first, last => conduction%own_last, &
               medium => conduction%medium)
      call matduplicate(conduction%matrix, mat_copy_values, rows, failed)
      allocate (own(last - first + 1), source=1/conduction%diffusivity)
      if (allocated(medium%local_capacity)) own = medium%local_capacity(first:last)
      call veccreatempiwitharray(conduction%ranks%comm%mpi_val, 1, size(own), &
                                 int(conduction%particles), own, factor, failed)
      call matdiagonalscale(rows, factor, petsc_null_vec, failed)
      call conduction%make_matrix(conduction%held_rows, 1.0_wp, held)
      call mataxpy(rows, 1.0_wp, held, different_nonzero_pattern, failed)
      call matdestroy(held, failed)
      own = medium%area(first:last)
      call vecdestroy(factor, failed)
      call veccreatempiwitharray(conduction%ranks%comm%mpi_val, 1, size(own), &
                                 int(conduction%particles), own, factor, failed)
      call matdiagonalscale(rows, factor, petsc_null_vec, failed)
      call vecdestroy(factor, failed)
    end associate
  end subroutine insulated_rows

end module calor_shared_weights
