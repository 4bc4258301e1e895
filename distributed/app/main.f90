!> calor-mpi: the command line. No numerics.
program main
  use, intrinsic :: iso_fortran_env, only: error_unit
  use calor_error, only: error_t
  use calor_kinds, only: wp
  use calor_ranks, only: ranks_t
  use calor_scene, only: scene_t
  use calor_scene_reader, only: read_scene
  use calor_shared_simulation, only: shared_simulation_t
  use mpi_f08, only: mpi_comm_world
  use petscsys, only: petscinitialize, petscfinalize
  implicit none (type)

  type(ranks_t) :: ranks
  type(scene_t) :: scene
  type(shared_simulation_t) :: simulation
  type(error_t), allocatable :: error
  character(len=1000) :: path
  real(wp) :: e
  integer :: failed

  call petscinitialize(failed)
  call ranks%enter(mpi_comm_world)
  call get_command_argument(2, path)
  call read_scene(trim(path), scene, error)
  if (.not. allocated(error)) call simulation%prepare(ranks, scene, error)
  if (.not. allocated(error)) call simulation%certify(error)
  if (.not. allocated(error)) call simulation%advance_to(scene%time%end, error)
  if (.not. allocated(error)) then
    e = simulation%relative_l2_error()
    if (ranks%speaks()) print *, e, simulation%stepper%steps, simulation%stepper%spectral_radius, &
        simulation%rightmost%growth_rate, simulation%method
  else if (ranks%speaks()) then
    write (error_unit, '(a)') error%message
  end if
  call simulation%finish()
  call petscfinalize(failed)
end program main
