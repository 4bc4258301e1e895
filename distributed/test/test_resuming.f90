!> A run that ends before its end goes on, on any number of ranks, to the same field.
module test_resuming
  use calor_kinds, only: wp
  use calor_text, only: to_text
  use test_runs, only: compare_files, run_and_signal, run_ranks, run_serial, said, write_scene
  use testdrive, only: check, error_type, new_unittest, test_failed, unittest_type
  implicit none (type, external)
  private

  public :: collect_resuming

  integer, parameter :: wide = 100

contains

  subroutine collect_resuming(tests)
    type(unittest_type), allocatable, intent(out) :: tests(:)

    tests = [new_unittest('a rank is killed', test_killed), &
             new_unittest('the run is told to end', test_told), &
             new_unittest('mpirun is told to end', test_mpirun), &
             new_unittest('implicit steps, killed and told to end', test_implicit), &
             new_unittest('melting, to a later end', test_later_end), &
             new_unittest('an older checkpoint', test_older), &
             new_unittest('checkpoints that do not fit', test_unfit)]
  end subroutine collect_resuming

  !> A plate heated through one wall, for a second or more; without checkpoints for '' of these.
  subroutine write_plate(name, checkpoint, steps)
    character(len=*), intent(in) :: name, checkpoint
    !> The method and its tolerance
    character(len=*), intent(in), optional :: steps
    character(len=:), allocatable :: method

    method = 'method=''rkl2'' tolerance=1e-8'
    if (present(steps)) method = steps
    call write_scene(name, [character(len=wide) :: &
                            '&domain shape=''rectangle'' x_range=0,1 y_range=0,1 spacing=0.02', &
                            '  arrangement=''jittered'' jitter=0.2 /', &
                            '&initial temperature_expression=''sin(pi*x)*sin(pi*y)'' /', &
                            '&boundary on=''all'' kind=''temperature'' value=0 /', &
                            '&boundary on=''left'' kind=''convection'' coefficient=2.0', &
                            '  ambient_expression=''sin(40*t)'' /', &
                            '&time end=1 '//method//' /', &
                            '&output file='''//name//'.vtkhdf'' every=0.25 /', checkpoint])
  end subroutine write_plate

  !> The field that a run by two ranks without a break leaves in whole.vtkhdf
  subroutine run_whole(error, steps)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in), optional :: steps
    integer :: status

    call write_plate('whole', '', steps)
    call run_ranks('whole', 2, status)
    call check(error, status, 0, 'the run without a break')
  end subroutine run_whole

  subroutine resume(name, ranks, error)
    character(len=*), intent(in) :: name
    integer, intent(in) :: ranks
    type(error_type), allocatable, intent(out) :: error
    integer :: status

    call run_ranks(name, ranks, status, options='--resume')
    if (status /= 0) then
      call test_failed(error, name//' resumed by '//to_text(ranks)//' ranks: status '// &
                       to_text(status))
    else
      call compare_files('whole.vtkhdf', name//'.vtkhdf', 'temperature', 1.0e-10_wp, error)
    end if
  end subroutine resume

  subroutine test_killed(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: status, ranks

    call run_whole(error)
    if (allocated(error)) return
    do ranks = 2, 4, 2
      call write_plate('killed', '&checkpoint file=''killed.h5'' every_seconds=0.02 /')
      call run_and_signal('killed', ranks, 'KILL', 'killed.h5', status)
      call check(error, status, 137, 'the status after the kill')
      if (allocated(error)) return
      call check(error, said('killed', 'on signal 9'), 1)
      if (allocated(error)) return
      call resume('killed', 5 - ranks, error)
      if (allocated(error)) return
    end do
  end subroutine test_killed

  !> The scene need not ask for checkpoints.
  subroutine test_told(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: status

    call run_whole(error)
    if (allocated(error)) return
    call write_plate('told', '')
    call run_and_signal('told', 3, 'TERM', 'told.vtkhdf', status)
    call check(error, status, 143)
    if (allocated(error)) return
    call check(error, said('told', 'calor-mpi run --resume told.nml'), 1)
    if (allocated(error)) return
    call resume('told', 1, error)
    if (allocated(error)) return
    call run_and_signal('told', 2, 'INT', 'told.vtkhdf', status)
    call check(error, status, 130)
    if (allocated(error)) return
    call resume('told', 3, error)
  end subroutine test_told

  !> Open MPI waits as long as it is told to, hands the signal on, and waits as long again before it
  !> kills; its own status is its affair. The run would take minutes.
  subroutine test_mpirun(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: status
    logical :: there

    call write_plate('ended', '')
    call execute_command_line('rm -f ended.checkpoint.h5*; sed -i s/end=1/end=100/ ended.nml')
    call run_and_signal('ended', 2, 'TERM', 'ended.vtkhdf', status, patience=2)
    call check(error, status /= 0, 'mpirun ended as if nothing had been')
    if (allocated(error)) return
    call check(error, said('ended', 'calor-mpi run --resume ended.nml'), 1)
    if (allocated(error)) return
    inquire (file='ended.checkpoint.h5', exist=there)
    call check(error, there, 'there is no checkpoint')
  end subroutine test_mpirun

  !> What is laid aside is the state and the length of the next step; PETSc keeps nothing else.
  subroutine test_implicit(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: steps = 'method=''tr_bdf2'' tolerance=1e-6'
    integer :: status

    call run_whole(error, steps)
    if (allocated(error)) return
    call write_plate('implicit', '&checkpoint file=''implicit.h5'' every_seconds=0.02 /', steps)
    call run_and_signal('implicit', 3, 'KILL', 'implicit.h5', status)
    call check(error, status, 137, 'the status after the kill')
    if (allocated(error)) return
    call resume('implicit', 2, error)
    if (allocated(error)) return
    call write_plate('implicit', '', steps)
    call run_and_signal('implicit', 2, 'TERM', 'implicit.vtkhdf', status)
    call check(error, status, 143)
    if (allocated(error)) return
    call check(error, said('implicit', 'calor-mpi run --resume implicit.nml'), 1)
    if (allocated(error)) return
    call resume('implicit', 3, error)
  end subroutine test_implicit

  subroutine test_later_end(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: status

    call write('later', '0.1', '&checkpoint every=0.05 /')
    call run_ranks('later', 3, status)
    call check(error, status, 0)
    if (allocated(error)) return
    call write('later', '0.2', '&checkpoint every=0.05 /')
    call run_ranks('later', 2, status, options='--resume')
    call check(error, status, 0)
    if (allocated(error)) return
    call write('whole', '0.2', '')
    call run_ranks('whole', 1, status)
    call check(error, status, 0)
    if (allocated(error)) return
    call compare_files('whole.vtkhdf', 'later.vtkhdf', 'temperature', 1.0e-10_wp, error)
    if (allocated(error)) return
    call compare_files('whole.vtkhdf', 'later.vtkhdf', 'liquid_fraction', 1.0e-10_wp, error)

  contains

    subroutine write(name, end, checkpoint)
      character(len=*), intent(in) :: name, end, checkpoint

      call write_scene(name, [character(len=wide) :: &
                              '&domain shape=''rectangle'' x_range=0,1 y_range=0,0.5', &
                              '  spacing=0.05 /', &
                              '&material latent_heat=5 solidus=0.4 liquidus=0.6', &
                              '  conductivity_expression=''1+T/4'' /', &
                              '&initial temperature=0 /', &
                              '&boundary on=''all'' kind=''insulated'' /', &
                              '&boundary on=''left'' kind=''temperature'' value=1 /', &
                              '&time end='//end//' method=''rkl2'' tolerance=1e-5 /', &
                              '&output file='''//name//'.vtkhdf'' every=0.1', &
                              '  fields=''temperature'',''liquid_fraction'' /', checkpoint])
    end subroutine write

  end subroutine test_later_end

  !> Of two that are kept, the one before the last
  subroutine test_older(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: status

    call run_whole(error)
    if (allocated(error)) return
    call write_plate('older', '&checkpoint file=''older.h5'' every=0.15 keep=2 /')
    call run_ranks('older', 3, status)
    call check(error, status, 0)
    if (allocated(error)) return
    call execute_command_line('printf x >>older.h5')
    call run_ranks('older', 2, status, options='--resume')
    call check(error, status, 4, 'the damaged one')
    if (allocated(error)) return
    call run_ranks('older', 2, status, options='--resume --checkpoint older.1.h5')
    call check(error, status, 0)
    if (allocated(error)) return
    call compare_files('whole.vtkhdf', 'older.vtkhdf', 'temperature', 1.0e-10_wp, error)
  end subroutine test_older

  subroutine test_unfit(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: checkpoint = '&checkpoint file=''unfit.h5'' every=0.5 /'
    integer :: status

    call write_plate('unfit', checkpoint)
    call run_ranks('unfit', 2, status)
    call check(error, status, 0)
    if (allocated(error)) return
    ! Another scene
    call execute_command_line('sed -i s/coefficient=2.0/coefficient=3.0/ unfit.nml')
    call expect(2, '&boundary number 2 coefficient: 2.0, now 3.0')
    if (allocated(error)) return
    ! A bit that was turned
    call write_plate('unfit', checkpoint)
    call execute_command_line('printf x | dd of=$(ls unfit.h5.particles.*) bs=1 seek=4321 '// &
                              'conv=notrunc 2>/dev/null')
    call expect(4, 'which belongs to the checkpoint, is damaged')
    if (allocated(error)) return
    ! Those of the other program
    call run_serial('unfit', status, options='--resume')
    call check(error, status, 4)
    if (allocated(error)) return
    call check(error, said('unfit', 'was written by calor-mpi'), 1)
    if (allocated(error)) return
    call run_serial('unfit', status)
    call check(error, status, 0)
    if (allocated(error)) return
    call expect(4, 'was written by calor, which keeps other things')
    if (allocated(error)) return
    call execute_command_line('rm unfit.h5')
    call expect(4, 'There is no checkpoint ''unfit.h5''')

  contains

    subroutine expect(expected, words)
      integer, intent(in) :: expected
      character(len=*), intent(in) :: words

      call run_ranks('unfit', 3, status, options='--resume')
      call check(error, status, expected, words)
      if (allocated(error)) return
      call check(error, said('unfit', words), 1, words)
    end subroutine expect

  end subroutine test_unfit

end module test_resuming
