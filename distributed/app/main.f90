!> calor-mpi: the command line. No numerics.
program main
  use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
  use calor_error, only: error_t, raise, status_bad_input
  use calor_file_system, only: ignore_file_size_signal
  use calor_interrupt, only: watch_for_interrupt
  use calor_ranks, only: ranks_t
  use calor_scene, only: scene_t
  use calor_scene_reader, only: read_scene
  use calor_shared_description, only: describe_shared_plan, describe_shared_result
  use calor_shared_run, only: run_shared
  use calor_shared_simulation, only: shared_simulation_t
  use calor_text, only: text_t
  use calor_version, only: version
  use mpi_f08, only: mpi_comm_world
  use petsc_failure, only: end_run_on_failure
  use petscsys, only: petscinitialize, petscfinalize
  use shared_progress, only: shared_progress_t
  ! PETSc's procedures have no interfaces of their own.
  ! allow(C003)
  implicit none (type)

  interface
    subroutine c_exit(status) bind(c, name='exit')
      use, intrinsic :: iso_c_binding, only: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: status
    end subroutine c_exit
  end interface

  type(ranks_t) :: ranks
  type(error_t), allocatable :: error
  integer :: failed, status

  call ignore_file_size_signal()
  call petscinitialize(failed)
  call end_run_on_failure()
  call ranks%enter(mpi_comm_world)
  call dispatch(error)
  status = 0
  if (allocated(error)) then
    status = error%status
    flush (output_unit)
    if (ranks%speaks()) write (error_unit, '(a)') 'calor-mpi: '//error%message
  end if
  call petscfinalize(failed)
  if (status /= 0) call c_exit(status)

contains

  subroutine dispatch(error)
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: command

    command = argument(1)
    select case (command)
    case ('run', 'check')
      call run(command == 'check', error)
    case ('version', '--version')
      call say('calor-mpi '//version)
    case ('', 'help', '--help', '-h')
      call say('Run a scene of calor on several ranks: mpirun -n RANKS calor-mpi run SCENE')
      call say('')
      call say('  run SCENE     run it; --quiet says nothing, --resume goes on from the last')
      call say('                checkpoint, --checkpoint FILE from that one')
      call say('  check SCENE   say what a run would do')
      call say('  version       say which version this is')
      call say('')
      call say('Options of PETSc follow the scene, as in -ksp_monitor; docs/scaling.md tells more.')
    case default
      call raise(error, status_bad_input, 'There is no command '''//command//'''. There are: '// &
                 'run, check, version, help.')
    end select
  end subroutine dispatch

  subroutine run(only_check, error)
    logical, intent(in) :: only_check
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(shared_simulation_t), target :: simulation
    type(shared_progress_t), target :: progress
    type(text_t), allocatable :: lines(:)
    character(len=:), allocatable :: path, checkpoint
    logical :: quiet, resumed
    integer :: k

    quiet = .false.
    resumed = .false.
    path = ''
    checkpoint = ''
    k = 2
    do while (k <= command_argument_count())
      select case (argument(k))
      case ('--quiet')
        quiet = .true.
      case ('--resume')
        resumed = .true.
      case ('--checkpoint')
        k = k + 1
        if (k <= command_argument_count()) checkpoint = argument(k)
      case default
        ! What follows the scene may be PETSc's.
        if (path == '') path = argument(k)
      end select
      k = k + 1
    end do
    if (path == '') then
      call raise(error, status_bad_input, 'Which scene? Give its file: calor-mpi run SCENE.')
      return
    end if
    call read_scene(path, scene, error)
    call ranks%agree(error)
    if (allocated(error)) return
    if (resumed) then
      call simulation%resume(ranks, scene, checkpoint, error)
    else
      call simulation%prepare(ranks, scene, error)
    end if
    if (.not. allocated(error)) then
      call describe_shared_plan(simulation, lines)
      if (.not. quiet) call say_all(lines)
      if (only_check) then
        call simulation%certify(error)
      else
        call watch_for_interrupt()
        call progress%begin(scene%time%end, quiet .or. .not. ranks%speaks())
        call run_shared(simulation, error, progress)
        if (.not. allocated(error)) then
          call describe_shared_result(simulation, lines)
          if (.not. quiet) call say('')
          if (.not. quiet) call say_all(lines)
        end if
      end if
    end if
    call simulation%finish()
  end subroutine run

  function argument(number) result(text)
    integer, intent(in) :: number
    character(len=:), allocatable :: text
    integer :: length

    call get_command_argument(number, length=length)
    allocate (character(len=length) :: text)
    if (length > 0) call get_command_argument(number, text)
  end function argument

  subroutine say_all(lines)
    type(text_t), intent(in) :: lines(:)
    integer :: k

    do k = 1, size(lines)
      call say(lines(k)%value)
    end do
    flush (output_unit)
  end subroutine say_all

  !> One rank speaks for all.
  subroutine say(line)
    character(len=*), intent(in) :: line

    if (ranks%speaks()) write (output_unit, '(a)') line
  end subroutine say

end program main
