!> How PETSc solves the linear systems of ranks: BiCGStab with hypre's algebraic multigrid, unless
!> PETSc's options say otherwise (-ksp_type, -pc_type, …).
!>
!> Matrices are not symmetric, and held particles have rows of 1. With hypre's multigrid iterations
!> stay few; PETSc's own, GAMG, smooths its coarse functions with spectra that it takes for those of
!> symmetric matrices, and failed on a plate of 2601 particles (-pc_gamg_agg_nsmooths 0 helps it).
module calor_shared_solver
  use calor_kinds, only: wp
  use petscksp, only: tksp, tpc
  ! PETSc's procedures have no interfaces of their own.
  ! allow(C003)
  implicit none (type)
  private

  public :: set_up_solver

contains

  subroutine set_up_solver(solver, residual_part, most_iterations)
    type(tksp), intent(inout) :: solver
    !> What a solution may leave of the right side, and iterations for that
    real(wp), intent(in) :: residual_part
    integer, intent(in) :: most_iterations
    type(tpc) :: preconditioner
    integer :: failed

    call kspsettype(solver, 'bcgs', failed)
    call kspgetpc(solver, preconditioner, failed)
    call pcsettype(preconditioner, 'hypre', failed)
    call kspsettolerances(solver, residual_part, 1.0e-300_wp, 1.0e10_wp, most_iterations, failed)
    call kspsetfromoptions(solver, failed)
  end subroutine set_up_solver

end module calor_shared_solver
