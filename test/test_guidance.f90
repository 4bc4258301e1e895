!> What helps a user along: starting scenes, lists of schemes and effects, completion, manual,
!> progress.
module test_guidance
  use, intrinsic :: iso_fortran_env, only: error_unit
  use calor_catalogue, only: scheme_names, effect_names
  use calor_kinds, only: wp
  use calor_progress_line, only: progress_line, duration_text
  use calor_scene_contract, only: contract_groups
  use calor_starting_scenes, only: starting_scenes
  use calor_text, only: text_t
  use test_process, only: outcome_t, run_command, environment_or, contents_of
  use testdrive, only: new_unittest, unittest_type, error_type, check
  implicit none (type, external)
  private

  public :: collect_guidance

  character(len=*), parameter :: folder = 'build/test/guidance/', end = new_line('a')

contains

  subroutine collect_guidance(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('starting scenes run', test_starting_scenes), &
                new_unittest('schemes', test_schemes), &
                new_unittest('effects', test_effects), &
                new_unittest('completion', test_completion), &
                new_unittest('manual', test_manual), &
                new_unittest('a line of progress', test_progress_line), &
                new_unittest('quiet and verbose runs', test_quiet), &
                new_unittest('a bar on a terminal', test_terminal) &
                ]
  end subroutine collect_guidance

  subroutine test_starting_scenes(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    character(len=:), allocatable :: kind
    integer :: k

    call start_over()
    call calor('new', outcome)
    call check(error, outcome%status, 0)
    if (allocated(error)) return
    do k = 1, size(starting_scenes)
      kind = trim(starting_scenes(k)%name)
      call check(error, index(outcome%output, '  '//kind//' ') > 0, kind//' is not listed')
      if (allocated(error)) return
    end do
    do k = 1, size(starting_scenes)
      kind = trim(starting_scenes(k)%name)
      call calor('new '//kind//' && "$CALOR" run '//kind//'.nml', outcome)
      call check(error, outcome%status, 0, kind//': '//outcome%errors)
      if (allocated(error)) return
      call check(error, index(outcome%output, 'calor plot '//kind//'.vtkhdf') > 0, outcome%output)
      if (allocated(error)) return
      call check(error, index(contents_of(folder//kind//'.vtkhdf'), 'VTKHDF') > 0)
      if (allocated(error)) return
      call check(error, index(contents_of(folder//kind//'.nml'), '! ') > 0, kind//' says nothing')
      if (allocated(error)) return
    end do
    ! A cloud is two files; neither is written over.
    call calor('new cloud other', outcome)
    call check(error, index(outcome%output, 'other.csv is ready too') > 0, outcome%output)
    if (allocated(error)) return
    call calor('check other.nml', outcome)
    call check(error, outcome%status, 0, outcome%errors)
    if (allocated(error)) return
    call execute_command_line('rm '//folder//'other.nml')
    call calor('new cloud other', outcome)
    call check(error, outcome%status, 2)
    if (allocated(error)) return
    call check(error, index(outcome%errors, 'other.csv is there already') > 0, outcome%errors)
  end subroutine test_starting_scenes

  subroutine test_schemes(error)
    type(error_type), allocatable, intent(out) :: error

    call check_catalogue(error, 'schemes', scheme_names())
  end subroutine test_schemes

  subroutine test_effects(error)
    type(error_type), allocatable, intent(out) :: error

    call check_catalogue(error, 'effects', effect_names())
  end subroutine test_effects

  !> All are listed, and of each something is said of formula, cost and source.
  subroutine check_catalogue(error, command, names)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: command
    type(text_t), intent(in) :: names(:)
    character(len=11), parameter :: rows(*) = [character(len=11) :: 'formula', 'cost', 'source']
    type(outcome_t) :: outcome
    integer :: k, j, at

    call start_over()
    call check(error, size(names) > 5)
    if (allocated(error)) return
    call calor(command, outcome)
    do k = 1, size(names)
      call check(error, index(outcome%output, '  '//names(k)%value//' ') > 0, &
                 names(k)%value//' is not listed')
      if (allocated(error)) return
    end do
    do k = 1, size(names)
      call calor(command//' '//names(k)%value, outcome)
      call check(error, outcome%status, 0, outcome%errors)
      if (allocated(error)) return
      do j = 1, size(rows)
        at = index(outcome%output, '  '//rows(j))
        call check(error, at > 0, names(k)%value)
        if (allocated(error)) return
        at = at + 14
        call check(error, outcome%output(at:at) /= end, names(k)%value//' has no '//rows(j))
        if (allocated(error)) return
      end do
    end do
    call calor(command//' '//names(1)%value//'x', outcome)
    call check(error, outcome%status, 2)
    if (allocated(error)) return
    call check(error, index(outcome%errors, 'Did you mean '''//names(1)%value) > 0, outcome%errors)
  end subroutine check_catalogue

  subroutine test_completion(error)
    type(error_type), allocatable, intent(out) :: error

    call start_over()
    call execute_command_line('cd '//folder//' && mkdir sub && touch a.nml b.vtkhdf c.txt')
    call complete('pl', 'plot')
    call complete('plot --f', '--field')
    call complete('plot --field tem', '')
    call complete('new fi', 'fin')
    call complete('schemes fatehi', 'fatehi_manzari')
    call complete('effects mel', 'melting')
    call complete('run ''''', 'sub a.nml')
    call complete('plot ''''', 'sub b.vtkhdf')
    call complete('help ch', 'check')

  contains

    !> Words are completed to others, parted by blanks.
    subroutine complete(words, completed)
      character(len=*), intent(in) :: words, completed
      type(outcome_t) :: outcome

      if (allocated(error)) return
      call run_command('cd '//folder//' && bash -c ''eval "$("'//program_path()// &
                       '" completion)"; eval "COMP_WORDS=(calor $0)"; '// &
                       'COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _calor; echo ${COMPREPLY[@]}'' "'// &
                       words//'"', folder//'../guided', outcome)
      call check(error, outcome%output, completed//end, words//': '//outcome%errors)
    end subroutine complete

  end subroutine test_completion

  subroutine test_manual(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    type(text_t), allocatable :: groups(:)
    integer :: k

    call start_over()
    call calor('manual >calor.1', outcome)
    call check(error, outcome%status, 0)
    if (allocated(error)) return
    groups = contract_groups()
    do k = 1, size(groups)
      call check(error, index(contents_of(folder//'calor.1'), end//'&'//groups(k)%value) > 0, &
                 groups(k)%value//' is not in the manual')
      if (allocated(error)) return
    end do
    call run_command('groff --version', folder//'../guided', outcome)
    if (outcome%status /= 0) then
      write (error_unit, '(a)') '    left out: there is no groff to set the manual with'
      return
    end if
    call run_command('cd '//folder//' && groff -K utf8 -man -Tutf8 -ww calor.1 >page', &
                     folder//'../guided', outcome)
    call check(error, outcome%errors, '')
    if (allocated(error)) return
    call check(error, index(contents_of(folder//'page'), 'could not be read or written') > 0)
  end subroutine test_manual

  subroutine test_progress_line(error)
    type(error_type), allocatable, intent(out) :: error

    call check(error, progress_line(0.5_wp, 2.0_wp, 120, 10.0_wp, 1.0e-6_wp, -1.0_wp, 69), &
               '[##......] 25 %  t = 0.5 s  12 steps/s  30 s left  step errors 1e-6 K')
    if (allocated(error)) return
    call check(error, progress_line(0.5_wp, 2.0_wp, 120, 10.0_wp, 1.0e-6_wp, 1.5e-3_wp, 99), &
               '[#####...............] 25 %  t = 0.5 s  12 steps/s  30 s left  error 0.0015')
    if (allocated(error)) return
    ! Where there is no room for a bar, the figures remain.
    call check(error, progress_line(0.5_wp, 2.0_wp, 120, 10.0_wp, 1.0e-6_wp, -1.0_wp, 64), &
               '25 %  t = 0.5 s  12 steps/s  30 s left  step errors 1e-6 K')
    if (allocated(error)) return
    call check(error, progress_line(2.0_wp, 2.0_wp, 120, 10.0_wp, 0.0_wp, -1.0_wp, 0), &
               '100 %  t = 2 s  step 120  12 steps/s')
    if (allocated(error)) return
    call check(error, progress_line(0.0_wp, 2.0_wp, 0, 0.0_wp, 0.0_wp, -1.0_wp, 0), &
               '0 %  t = 0 s  step 0')
    if (allocated(error)) return
    call check(error, duration_text(200.0_wp), '3 min 20 s')
    if (allocated(error)) return
    call check(error, duration_text(7500.0_wp), '2 h 5 min')
  end subroutine test_progress_line

  subroutine test_quiet(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call start_over()
    call calor('new slab', outcome)
    call calor('run --quiet slab.nml', outcome)
    call check(error, outcome%status, 0, outcome%errors)
    if (allocated(error)) return
    call check(error, outcome%output//outcome%errors, '')
    if (allocated(error)) return
    call calor('run slab.nml', outcome)
    call check(error, index(outcome%output, 't = 1800 s ') == 0 .and. &
               index(outcome%output, 'Wall time') > 0 .and. &
               index(outcome%output, '##') > 0, outcome%output)
    if (allocated(error)) return
    call calor('run slab.nml --verbose', outcome)
    call check(error, index(outcome%output, 't = 1800 s ') > 0, outcome%output)
    if (allocated(error)) return
    call execute_command_line('sed -i "s/conductivity = 0.8/conductivity = -1/" '// &
                              folder//'slab.nml')
    call calor('run --quiet slab.nml', outcome)
    call check(error, outcome%status == 2 .and. index(outcome%errors, 'conductivity') > 0)
  end subroutine test_quiet

  !> Through a terminal that `script` makes up; a run of a second shows its bar some times.
  subroutine test_terminal(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call start_over()
    call run_command('script -qec true /dev/null', folder//'../guided', outcome)
    if (outcome%status /= 0) then
      write (error_unit, '(a)') '    left out: there is no script to make up a terminal with'
      return
    end if
    call calor('new plate && sed -i "s/spacing = 0.025 /spacing = 0.01/;'// &
               's/1.0e-6/1.0e-8/;s/end = 0.05/end = 0.5/" plate.nml', outcome)
    call run_command('cd '//folder//' && script -qec "'//program_path()// &
                     ' run plate.nml" /dev/null', folder//'../guided', outcome)
    call check(error, outcome%status, 0, outcome%output)
    if (allocated(error)) return
    call check(error, index(outcome%output, achar(13)//'[') > 0 .and. &
               index(outcome%output, ' steps/s') > 0 .and. index(outcome%output, ' left') > 0, &
               'no bar: '//outcome%output)
  end subroutine test_terminal

  ! ---------------------------------------------------------------------------------------------
  ! Tools
  ! ---------------------------------------------------------------------------------------------

  subroutine start_over()
    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder)
  end subroutine start_over

  !> Run the program; in what follows its arguments it is $CALOR.
  subroutine calor(arguments, outcome)
    character(len=*), intent(in) :: arguments
    type(outcome_t), intent(out) :: outcome

    call run_command('cd '//folder//' && CALOR="'//program_path()//'" && "$CALOR" '//arguments, &
                     folder//'../guided', outcome)
  end subroutine calor

  function program_path() result(path)
    character(len=:), allocatable :: path

    path = environment_or('CALOR_PROGRAM', 'bin/calor')
    if (path(1:1) /= '/') path = '../../../'//path
  end function program_path

end module test_guidance
