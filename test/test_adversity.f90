!> Runs of the program under adverse conditions: signals, folders that vanish or may not be written
!> into, limits on files, disks and memory. Whatever comes, the program ends with one sentence and
!> its exit status, and a resumed run gives what one without a break gives.
module test_adversity
  use, intrinsic :: iso_fortran_env, only: error_unit
  use calor_checkpoint_file, only: read_checkpoint_file
  use calor_error, only: error_t
  use calor_kinds, only: wp
  use calor_saved_state, only: saved_state_t
  use calor_text, only: to_text
  use test_command_line, only: zero_wall_times
  use test_process, only: contents_of, line_count, number_after, outcome_t, program_path, &
                          run_command, write_text
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_adversity

  character(len=*), parameter :: folder = 'build/test/adversity/'
  character(len=1), parameter :: lf = new_line('a')

  character(len=*), parameter :: &
      plate = '&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.05 /'//lf// &
      '&initial temperature_expression = ''sin(pi*x)*sin(pi*y)'' /'//lf//'&boundary value = 0 /'// &
      lf, &
      short = '&time end = 0.02 method = ''forward_euler'' /'//lf, &
      fine = '&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.02 /'//lf// &
      '&initial temperature_expression = ''sin(pi*x)*sin(pi*y)'' /'//lf//'&boundary value = 0 /'// &
      lf//'&time end = 0.02 method = ''rkl2'' /'//lf// &
      '&output file = ''out/o.vtkhdf'' every = 0.0005 /'//lf// &
      '&checkpoint file = ''out/c.h5'' every = 0.002 /'//lf, &
      endless = '&time end = 1e6 method = ''forward_euler'' /'//lf, &
      each_step = '&checkpoint file = ''out/c.h5'' every_seconds = 1e-9 /'//lf, &
      states = '&output file = ''out/o.vtkhdf'' every = 0.001 /'//lf

  !> Lines of the shell: how long to wait for what is to come, in steps of 0.01 s
  character(len=*), parameter :: patience = 'for k in $(seq 6000); do '

contains

  subroutine collect_adversity(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('Ctrl-C', test_interrupt), &
                new_unittest('the system''s wish to end', test_termination), &
                new_unittest('a second signal', test_second_signal), &
                new_unittest('two threads', test_two_threads), &
                new_unittest('folders that are none', test_no_folder), &
                new_unittest('a folder that may not be written into', test_read_only), &
                new_unittest('a folder that vanishes', test_vanished), &
                new_unittest('output that grows too large', test_large_output), &
                new_unittest('checkpoints that are too large', test_large_checkpoint), &
                new_unittest('a full disk', test_full_disk), &
                new_unittest('little memory', test_memory) &
                ]
  end subroutine collect_adversity

  ! ---------------------------------------------------------------------------------------------
  ! Signals
  ! ---------------------------------------------------------------------------------------------

  subroutine test_interrupt(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_resumable(error, 'INT', 130)
  end subroutine test_interrupt

  subroutine test_termination(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_resumable(error, 'TERM', 143)
  end subroutine test_termination

  !> A run that a signal ends in the middle, with a checkpoint only then, ends as one without a
  !> break, bit for bit.
  subroutine expect_resumable(error, signal, status)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: signal
    integer, intent(in) :: status
    type(outcome_t) :: outcome
    ! Each of 200 steps waits for the disk: the signal comes with the first ones.
    character(len=*), parameter :: scene = plate//'&time end = 0.1 method = ''forward_euler'' '// &
        'step = 0.0005 /'//lf//'&output file = ''out/o.vtkhdf'' every = 0.02 /'//lf// &
        '&checkpoint file = ''out/c.h5'' every_seconds = 1e-9 /'//lf

    call start_over(scene)
    call calor('', 'run --quiet s.nml', outcome)
    call expect_status(error, outcome, 0, '')
    if (allocated(error)) return
    call shell('mv out/o.vtkhdf whole.vtkhdf; rm out/*', outcome)
    call shell(background('run --quiet s.nml', 'out/c.h5')//'kill -'//signal//' $p; wait $p', &
               outcome)
    call expect_status(error, outcome, status, 'Interrupted at t =|out/c.h5|'// &
                       'calor run --resume s.nml')
    if (allocated(error)) return
    call calor('', 'run --resume s.nml', outcome)
    call expect_status(error, outcome, 0, '')
    if (allocated(error)) return
    call check(error, index(outcome%output, 'Resumed at t =') > 0, outcome%output)
    if (allocated(error)) return
    call expect_equal_files(error)
  end subroutine expect_resumable

  !> A run that hangs where its checkpoint is to go, after a first signal, ends by a second one of
  !> either kind at once. What lets it hang is a pipe that nobody reads.
  subroutine test_second_signal(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    character(len=4), parameter :: second(2) = ['TERM', 'INT ']
    integer :: k

    do k = 1, 2
      call start_over(plate//endless//'&checkpoint file = ''out/c.h5'' every = 1e9 /'//lf// &
                      '&output file = ''out/o.vtkhdf'' /'//lf)
      call shell('mkfifo out/c.h5.partial; '// &
                 background('run --quiet s.nml', 'out/o.vtkhdf.partial')// &
                 'kill -TERM $p; '// &
                 patience//'grep -q '') S'' /proc/$p/stat && break; sleep 0.01; done; '// &
                 'kill -'//trim(second(k))//' $p; wait $p', outcome)
      call check(error, outcome%status, merge(143, 130, k == 1), outcome%errors)
      if (allocated(error)) return
      call check(error, index(outcome%errors, 'Interrupted') == 0, outcome%errors)
      if (allocated(error)) return
    end do
  end subroutine test_second_signal

  !> With more threads sums are added in another order: the run that goes on in the middle differs
  !> by rounding, 1e-12 of the range of temperatures, which is 1.
  subroutine test_two_threads(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    character(len=*), parameter :: scene = '&domain x_range = 0, 1 y_range = 0, 1 '// &
        'spacing = 0.02 arrangement = ''jittered'' /'//lf// &
        '&initial temperature_expression = ''sin(pi*x)*sin(pi*y)'' /'//lf// &
        '&boundary value_expression = ''0.1*sin(40*t)'' /'//lf// &
        '&time end = 0.02 method = ''rkl2'' /'//lf//'&output file = ''out/o.vtkhdf'' '// &
        'every = 0.01 /'//lf//'&checkpoint file = ''out/c.h5'' every = 0.004 keep = 4 /'//lf

    call start_over(scene)
    call calor('export OMP_NUM_THREADS=2; ', 'run --quiet s.nml', outcome)
    call expect_status(error, outcome, 0, '')
    if (allocated(error)) return
    call shell('cp out/o.vtkhdf whole.vtkhdf', outcome)
    call calor('export OMP_NUM_THREADS=2; ', 'run --resume --checkpoint out/c.3.h5 s.nml', outcome)
    call expect_status(error, outcome, 0, '')
    if (allocated(error)) return
    call check(error, number_after(outcome%output, 'Resumed at t =') < 0.0121_wp, outcome%output)
    if (allocated(error)) return
    call shell('h5diff -d 1e-12 whole.vtkhdf out/o.vtkhdf /VTKHDF/PointData/temperature', outcome)
    call check(error, outcome%status, 0, outcome%output//outcome%errors)
  end subroutine test_two_threads

  ! ---------------------------------------------------------------------------------------------
  ! Folders
  ! ---------------------------------------------------------------------------------------------

  !> Below a file, and where the system lets nobody write, root neither.
  subroutine test_no_folder(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    character(len=8), parameter :: place(2) = [character(len=8) :: 's.nml/', '/proc/']
    integer :: k

    do k = 1, 2
      call start_over(plate//short//'&output file = '''//trim(place(k))//'o.vtkhdf'' /'//lf)
      call calor('', 'run --quiet s.nml', outcome)
      call expect_status(error, outcome, 4, trim(place(k)))
      if (allocated(error)) return
      call start_over(plate//short//'&checkpoint file = '''//trim(place(k))//'c.h5'' /'//lf)
      call calor('', 'run --quiet s.nml', outcome)
      call expect_status(error, outcome, 4, trim(place(k)))
      if (allocated(error)) return
    end do
  end subroutine test_no_folder

  !> Root may write wherever it likes, but for what is marked as immutable.
  subroutine test_read_only(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    character(len=:), allocatable :: lock, unlock

    call start_over(plate//endless//states//each_step)
    lock = 'chmod a-w out'
    unlock = 'chmod u+w out'
    call shell('test $(id -u) = 0', outcome)
    if (outcome%status == 0) then
      lock = 'chattr +i out'
      unlock = 'chattr -i out'
      call shell(lock//' && '//unlock, outcome)
      if (outcome%status /= 0) then
        call skip('root writes into every folder, and this file system knows no chattr +i')
        return
      end if
    end if
    ! Before the run
    call shell(lock//'; '//program_path()//' run --quiet s.nml; s=$?; '//unlock//'; exit $s', &
               outcome)
    call expect_status(error, outcome, 4, 'out')
    if (allocated(error)) return
    ! Amid
    call shell(background('run --quiet s.nml', 'out/c.h5')//lock//'; wait $p; s=$?; '//unlock// &
               '; exit $s', outcome)
    call expect_status(error, outcome, 4, 'out/')
    if (allocated(error)) return
    call expect_whole(error, 'out/')
  end subroutine test_read_only

  !> What was written before is where the folder has gone.
  subroutine test_vanished(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call start_over(plate//endless//each_step)
    call shell(background('run --quiet s.nml', 'out/c.h5')//'mv out gone; wait $p', outcome)
    call expect_status(error, outcome, 4, '''out/c.h5'' could not be written')
    if (allocated(error)) return
    call expect_whole(error, 'gone/')
    if (allocated(error)) return
    call start_over(plate//endless//states)
    call shell(background('run --quiet s.nml', 'out/o.vtkhdf')//'mv out gone; wait $p', outcome)
    call expect_status(error, outcome, 4, 'out/o.vtkhdf')
    if (allocated(error)) return
    call shell('h5dump -H gone/o.vtkhdf', outcome)
    call check(error, outcome%status, 0, outcome%errors)
  end subroutine test_vanished

  ! ---------------------------------------------------------------------------------------------
  ! Room
  ! ---------------------------------------------------------------------------------------------

  !> The output may grow to three quarters of what it needs: the run ends, its file and its last
  !> checkpoint are whole, and with more room it comes to the same end as a run that had it all the
  !> time.
  subroutine test_large_output(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call start_over(fine)
    call calor('', 'run --quiet s.nml', outcome)
    call expect_status(error, outcome, 0, '')
    if (allocated(error)) return
    call shell('mv out/o.vtkhdf whole.vtkhdf; rm out/*', outcome)
    ! In blocks of 512 bytes, as the standard has it
    call calor('ulimit -f '//to_text(3*len(contents_of(folder//'whole.vtkhdf'))/(4*512))//'; ', &
               'run --quiet s.nml', outcome)
    call expect_status(error, outcome, 4, 'out/o.vtkhdf')
    if (allocated(error)) return
    call expect_whole(error, 'out/')
    if (allocated(error)) return
    call expect_same_end(error)
  end subroutine test_large_output

  !> A run that goes on where files may not grow as large any more keeps the checkpoint that it came
  !> from.
  subroutine test_large_checkpoint(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    character(len=*), parameter :: before = plate//'&checkpoint file = ''out/c.h5'' /'//lf
    character(len=:), allocatable :: checkpoint

    call start_over(before//'&time end = 0.01 /'//lf)
    call calor('', 'run --quiet s.nml', outcome)
    call expect_status(error, outcome, 0, '')
    if (allocated(error)) return
    checkpoint = contents_of(folder//'out/c.h5')
    call write_text(folder//'s.nml', before//'&time end = 0.02 /'//lf)
    call calor('ulimit -f '//to_text(len(checkpoint)/1024)//'; ', 'run --quiet --resume s.nml', &
               outcome)
    call expect_status(error, outcome, 4, '''out/c.h5'' could not be written')
    if (allocated(error)) return
    call check(error, &
               contents_of(folder//'out/c.h5') == checkpoint, 'the checkpoint is another one')
    if (allocated(error)) return
    call calor('', 'run --quiet --resume s.nml', outcome)
    call expect_status(error, outcome, 0, '')
  end subroutine test_large_checkpoint

  !> A disk of its own, of three quarters of the room that the files take, in a name space that goes
  !> with the shell. It is made larger for the run that goes on.
  subroutine test_full_disk(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    character(len=:), allocatable :: room

    call shell('unshare -m mount -t tmpfs -o size=1m none /mnt', outcome)
    if (outcome%status /= 0) then
      call skip('no file system may be mounted here')
      return
    end if
    call start_over(fine)
    call calor('', 'run --quiet s.nml', outcome)
    call expect_status(error, outcome, 0, '')
    if (allocated(error)) return
    ! The file is there twice as long as the run lasts.
    room = to_text(3*len(contents_of(folder//'out/o.vtkhdf'))/(2*1024))
    call shell('mv out/o.vtkhdf whole.vtkhdf; rm out/*', outcome)
    call write_text(folder//'in_space', &
                    'mount -t tmpfs -o size='//room//'k none out'//lf// &
                    program_path()//' run --quiet s.nml'//lf//'status=$?'//lf// &
                    'mkdir kept && cp out/* kept/'//lf//'exit $status'//lf)
    call shell('unshare -m sh in_space', outcome)
    call expect_status(error, outcome, 4, 'out/')
    if (allocated(error)) return
    call expect_whole(error, 'kept/')
    if (allocated(error)) return
    call shell('rmdir out && mv kept out', outcome)
    call expect_same_end(error)
  end subroutine test_full_disk

  !> Whatever the limit, every command does its work or says what it would take.
  subroutine test_memory(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    character(len=*), parameter :: domain = '&domain x_range = 0, 1 y_range = 0, 1 spacing = ', &
        initial = ' /'//lf//'&initial temperature_expression = ''sin(pi*x)*sin(pi*y)'' /'//lf, &
        scene = initial//'&boundary value = 0 /'//lf//'&scene exact_expression = '// &
        '''exp(-2*pi^2*t)*sin(pi*x)*sin(pi*y)'' /'//lf
    character(len=*), parameter :: euler = '&time end = 1e-7 method = ''forward_euler'' /'//lf, &
        implicit = '&time end = 1e-7 method = ''tr_bdf2'' /'//lf, &
        study = '&cost laplacians = ''fatehi_manzari'' repetitions = 1 spacings = '
    integer :: least

    call start_over(domain//'0.1'//scene//euler)
    least = -1
    call limited(1000000, 'version')
    if (outcome%status == 0) least = least_memory()
    if (least < 0) then
      call skip('limits on memory stop the program itself, as in a build with sanitizers')
      return
    end if
    ! Far too many particles
    call write_text(folder//'large.nml', domain//'1e-4'//scene//euler)
    call write_text(folder//'operators.nml', domain//'1e-4'//initial// &
                    '&operators field_expression = ''x^2'' /'//lf)
    call write_text(folder//'cost.nml', domain//'1e-4'//scene//euler//study//'1e-4 /'//lf)
    call expect_refusal('run large.nml')
    if (.not. allocated(error)) call expect_refusal('check large.nml')
    if (.not. allocated(error)) call expect_refusal('operators operators.nml')
    if (.not. allocated(error)) call expect_refusal('cost cost.nml')
    if (allocated(error)) return
    ! About as many as there is room for
    call write_text(folder//'large.nml', domain//'0.02'//scene//euler)
    call write_text(folder//'implicit.nml', domain//'0.02'//scene//implicit)
    call write_text(folder//'estimate.nml', domain//'0.02'//scene//euler// &
                    '&accuracy estimate = .true. /'//lf)
    call write_text(folder//'operators.nml', domain//'0.02'//initial// &
                    '&operators field_expression = ''x^2'' /'//lf)
    call write_text(folder//'cost.nml', domain//'0.02'//scene//euler//study//'0.02 /'//lf)
    call expect_order('run --quiet large.nml')
    if (.not. allocated(error)) call expect_order('check large.nml')
    if (.not. allocated(error)) call expect_order('run --quiet implicit.nml')
    if (.not. allocated(error)) call expect_order('run --quiet estimate.nml')
    if (.not. allocated(error)) call expect_order('operators operators.nml')
    if (.not. allocated(error)) call expect_order('cost cost.nml')

  contains

    !> The limit with which the program can start, in kB; -1: there is none up to 200 MB
    function least_memory() result(least)
      integer :: least

      do least = 20000, 200000, 2000
        call limited(least, 'version')
        if (outcome%status == 0) return
      end do
      least = -1
    end function least_memory

    subroutine limited(kilobytes, command)
      integer, intent(in) :: kilobytes
      character(len=*), intent(in) :: command

      call calor('export OMP_NUM_THREADS=1; ulimit -v '//to_text(kilobytes)//'; ', command, outcome)
    end subroutine limited

    subroutine expect_refusal(command)
      character(len=*), intent(in) :: command

      call limited(least + 200000, command)
      call expect_status(error, outcome, 2, 'of memory, but there are only|spacing')
      if (.not. allocated(error)) call check(error, line_count(outcome%errors), 1, outcome%errors)
    end subroutine expect_refusal

    !> With ever more memory, until there is enough
    subroutine expect_order(command)
      character(len=*), intent(in) :: command
      integer :: more

      do more = 0, 64000, 2000
        call limited(least + more, command)
        if (outcome%status == 0) exit
        call expect_status(error, outcome, 2, 'of memory, but there are only')
        if (allocated(error)) then
          error%message = command//' with '//to_text(more)//' kB: '//error%message
          return
        end if
      end do
      call check(error, outcome%status, 0, command//' never runs')
    end subroutine expect_order

  end subroutine test_memory

  ! ---------------------------------------------------------------------------------------------
  ! Tools
  ! ---------------------------------------------------------------------------------------------

  subroutine start_over(scene)
    character(len=*), intent(in) :: scene

    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder//'out')
    call write_text(folder//'s.nml', scene)
  end subroutine start_over

  !> Run lines of the shell in the folder.
  subroutine shell(lines, outcome)
    character(len=*), intent(in) :: lines
    type(outcome_t), intent(out) :: outcome

    call run_command('cd '//folder//' && '//lines, folder//'../t', outcome)
  end subroutine shell

  !> Run the program, after further lines of the shell.
  subroutine calor(before, arguments, outcome)
    character(len=*), intent(in) :: before, arguments
    type(outcome_t), intent(out) :: outcome

    call shell(before//program_path()//' '//arguments, outcome)
  end subroutine calor

  !> Lines that run the program beside, as process $p, and wait until there is a file
  function background(arguments, file) result(lines)
    character(len=*), intent(in) :: arguments, file
    character(len=:), allocatable :: lines

    lines = 'export OMP_NUM_THREADS=1; '//program_path()//' '//arguments//' & p=$!; '// &
            patience//'test -e '//file//' && break; sleep 0.01; done; '
  end function background

  subroutine expect_status(error, outcome, status, words)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t), intent(in) :: outcome
    integer, intent(in) :: status
    !> What the message must have, parted by '|'
    character(len=*), intent(in) :: words
    integer :: from, to

    call check(error, outcome%status, status, outcome%output//outcome%errors)
    if (allocated(error)) return
    call check(error, line_count(outcome%errors) <= 5, outcome%errors)
    from = 1
    do while (from <= len(words) .and. .not. allocated(error))
      to = from + index(words(from:)//'|', '|') - 2
      call check(error, index(outcome%errors, words(from:to)) > 0, &
                 '"'//words(from:to)//'" is not in: '//outcome%errors)
      from = to + 2
    end do
  end subroutine expect_status

  !> The last checkpoint has every bit as it was written; an output file beside it can be read.
  subroutine expect_whole(error, place)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: place
    type(error_t), allocatable :: failure
    type(saved_state_t) :: state
    type(outcome_t) :: outcome
    logical :: there

    call read_checkpoint_file(folder//place//'c.h5', state, failure)
    if (allocated(failure)) call test_failed(error, failure%message)
    inquire (file=folder//place//'o.vtkhdf', exist=there)
    if (allocated(error) .or. .not. there) return
    call shell('h5dump '//place//'o.vtkhdf', outcome)
    call check(error, outcome%status, 0, outcome%errors)
  end subroutine expect_whole

  !> The run that goes on comes to the end of the one without a break.
  subroutine expect_same_end(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call calor('', 'run --quiet --resume s.nml', outcome)
    call expect_status(error, outcome, 0, '')
    if (.not. allocated(error)) call expect_equal_files(error)
  end subroutine expect_same_end

  subroutine expect_equal_files(error)
    type(error_type), allocatable, intent(out) :: error

    call zero_wall_times(folder//'whole.vtkhdf')
    call zero_wall_times(folder//'out/o.vtkhdf')
    call check(error, contents_of(folder//'whole.vtkhdf') == contents_of(folder//'out/o.vtkhdf'), &
               'the resumed run left another file')
  end subroutine expect_equal_files

  subroutine skip(reason)
    character(len=*), intent(in) :: reason

    write (error_unit, '(a)') '       left out: '//reason
  end subroutine skip

end module test_adversity
