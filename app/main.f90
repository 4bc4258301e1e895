!> The command line of calor: finds out what is asked, has the library do it, prints what comes
!> back, and sets the exit status: 0 done, 2 wrong input, 3 the numbers went wrong, 4 a file could
!> not be read or written.
program main
  use, intrinsic :: iso_fortran_env, only: error_unit
  use calor, only: error_t, raise, status_done, status_bad_input, status_bad_file, text_t, &
                   text_list, to_text, suggestion, choice_t, choice_names, version, scene_t, &
                       read_scene, simulation_t, &
                   operator_study_t, describe_plan, describe_result, describe_derivatives, &
                   write_new_scene, contract_help, contract_groups, kernel_choices, &
                   laplacian_choices, gradient_choices, integrator_choices, arrangement_choices, &
                   shape_choices, skip_hdf5_cleanup, ignore_file_size_signal
  use run_progress, only: run_progress_t
  use terminal, only: say, everything_said
  implicit none (type, external)

  !> What a user may ask for
  type(choice_t), parameter :: commands(*) = [ &
      choice_t('run', 'simulate a scene and write its fields'), &
      choice_t('check', 'say what a scene would simulate, and check it, without running it'), &
      choice_t('operators', 'evaluate derivative schemes on a scene''s cloud'), &
      choice_t('new', 'write a commented scene to start from') &
      ]

  interface
    !> Ends the program with a status and without a further word
    subroutine c_exit(status) bind(c, name='exit')
      use, intrinsic :: iso_c_binding, only: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: status
    end subroutine c_exit
  end interface

  type(error_t), allocatable :: error
  integer :: status
  logical :: said

  ! A full disk shall end in a message of ours, neither in HDF5's own nor in a signal.
  call skip_hdf5_cleanup()
  call ignore_file_size_signal()
  call dispatch(error)
  status = status_done
  said = .true.
  if (allocated(error)) then
    said = everything_said()
    write (error_unit, '(a)') 'calor: '//error%message
    status = error%status
  end if
  if (.not. everything_said()) said = .false.
  if (.not. said .and. status == status_done) then
    write (error_unit, '(a)') 'calor: standard output could not be written to: is the disk full?'
    status = status_bad_file
  end if
  call c_exit(int(status))

contains

  subroutine dispatch(error)
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: command

    command = argument(1)
    select case (command)
    case ('', '-h', '--help', 'help')
      call show_help(error)
    case ('-V', '--version', 'version')
      call say('calor '//version)
    case ('run', 'check', 'operators', 'new')
      if (any_help()) then
        call show_command_help(command)
      else
        call check_arguments(command, error)
        if (allocated(error)) return
        select case (command)
        case ('run')
          call run(argument(2), error)
        case ('check')
          call check(argument(2), error)
        case ('operators')
          call operators(argument(2), error)
        case default
          call new(argument(2), error)
        end select
      end if
    case default
      if (index(command, '-') == 1) then
        call raise(error, status_bad_input, 'There is no option '''//command//'''.'// &
                   suggestion(command, text_list(['--help   ', '--version']))//' See calor --help.')
      else
        call raise(error, status_bad_input, 'There is no command '''//command//'''.'// &
                   suggestion(command, choice_names(commands))//' See calor --help.')
      end if
    end select
  end subroutine dispatch

  subroutine run(path, error)
    character(len=*), intent(in) :: path
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(run_progress_t) :: progress

    call read_scene(path, scene, error)
    if (allocated(error)) return
    call simulation%prepare(scene, error)
    if (allocated(error)) return
    call say_lines(describe_plan(simulation))
    call say('')
    call simulation%run(error, progress)
    if (allocated(error)) return
    call say('')
    call say_lines(describe_result(simulation))
  end subroutine run

  subroutine check(path, error)
    character(len=*), intent(in) :: path
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(simulation_t) :: simulation

    call read_scene(path, scene, error)
    if (allocated(error)) return
    call simulation%prepare(scene, error)
    if (allocated(error)) return
    call simulation%predict_steps()
    call say_lines(describe_plan(simulation))
    call simulation%certify(error)
  end subroutine check

  subroutine operators(path, error)
    character(len=*), intent(in) :: path
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(operator_study_t) :: study

    call read_scene(path, scene, error)
    if (allocated(error)) return
    call study%evaluate(scene, error)
    if (allocated(error)) return
    call study%write(error)
    if (allocated(error)) return
    call say_lines(describe_derivatives(study))
  end subroutine operators

  subroutine new(name, error)
    character(len=*), intent(in) :: name
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: path

    call write_new_scene(name, path, error)
    if (allocated(error)) return
    call say(path//' is ready. Run it by: calor run '//path)
  end subroutine new

  subroutine show_help(error)
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    if (argument(2) /= '' .and. argument(1) == 'help') then
      do k = 1, size(commands)
        if (commands(k)%name == argument(2)) then
          call show_command_help(argument(2))
          return
        end if
      end do
      call raise(error, status_bad_input, 'There is no command '''//argument(2)//'''.'// &
                 suggestion(argument(2), choice_names(commands)))
      return
    end if
    call say('calor '//version//': heat conduction on particles, with known accuracy')
    call say('')
    call say('Usage:')
    do k = 1, size(commands)
      call say('  calor '//commands(k)%name(1:10)//place_holder(trim(commands(k)%name))//'   '// &
               trim(commands(k)%summary))
    end do
    call say('  calor COMMAND --help    more about a command')
    call say('  calor --version')
    call say('')
    call say('A scene is a Fortran namelist file; ''calor new plate'' writes one to start from.')
    call say('Exit status: 0 done, 2 the input is wrong, 3 the numbers went wrong,')
    call say('4 a file could not be read or written.')
  end subroutine show_help

  subroutine show_command_help(command)
    character(len=*), intent(in) :: command
    integer :: k

    do k = 1, size(commands)
      if (commands(k)%name == command) then
        call say('calor '//command//' '//trim(place_holder(command))//': '// &
                 trim(commands(k)%summary))
      end if
    end do
    call say('')
    select case (command)
    case ('run', 'check')
      call say('SCENE is a namelist file of these groups and keys:')
      call show_groups(contract_groups())
      call show_choices('&domain shape', shape_choices)
      call show_choices('&domain arrangement', arrangement_choices)
      call show_choices('&kernel name', kernel_choices)
      call show_choices('&scheme laplacian', laplacian_choices)
      call show_choices('&time method', integrator_choices)
    case ('operators')
      call say('SCENE is a namelist file with these groups and keys:')
      call show_groups(text_list([character(len=9) :: 'operators', 'domain', 'kernel']))
      call show_choices('&kernel name', kernel_choices)
      call show_choices('&operators gradients', gradient_choices)
      call show_choices('&operators laplacians', laplacian_choices)
    case default
      call say('Writes NAME.nml, a small plate with every key explained. An existing file is left')
      call say('alone.')
    end select
  end subroutine show_command_help

  subroutine show_groups(groups)
    type(text_t), intent(in) :: groups(:)
    integer :: k

    do k = 1, size(groups)
      call say('')
      call say(contract_help(groups(k)%value))
    end do
  end subroutine show_groups

  !> What may be given for a key.
  subroutine show_choices(key, choices)
    character(len=*), intent(in) :: key
    type(choice_t), intent(in) :: choices(:)
    integer :: k

    call say('')
    call say(key//':')
    do k = 1, size(choices)
      call say('  '//choices(k)%name(1:26)//trim(choices(k)%summary))
    end do
  end subroutine show_choices

  pure function place_holder(command) result(word)
    character(len=*), intent(in) :: command
    character(len=:), allocatable :: word

    word = 'SCENE'
    if (command == 'new') word = 'NAME '
  end function place_holder

  !> Exactly one argument, and no unknown option.
  subroutine check_arguments(command, error)
    character(len=*), intent(in) :: command
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    do k = 2, command_argument_count()
      if (index(argument(k), '-') == 1) then
        call raise(error, status_bad_input, 'calor '//command//' has no option '''//argument(k)// &
                   '''. See calor '//command//' --help.')
        return
      end if
    end do
    if (command_argument_count() /= 2) then
      call raise(error, status_bad_input, 'calor '//command//' takes one argument, '// &
                 trim(place_holder(command))//', but '//to_text(command_argument_count() - 1)// &
                 ' were given. See calor '//command//' --help.')
    end if
  end subroutine check_arguments

  function any_help() result(answer)
    logical :: answer
    integer :: k

    answer = .false.
    do k = 2, command_argument_count()
      answer = answer .or. argument(k) == '--help' .or. argument(k) == '-h'
    end do
  end function any_help

  !> Command-line argument number `position`, or '' if there is none.
  function argument(position) result(text)
    integer, intent(in) :: position
    character(len=:), allocatable :: text
    integer :: length

    call get_command_argument(position, length=length)
    allocate (character(len=length) :: text)
    if (length > 0) call get_command_argument(position, text)
  end function argument

  subroutine say_lines(lines)
    type(text_t), intent(in) :: lines(:)
    integer :: k

    do k = 1, size(lines)
      call say(lines(k)%value)
    end do
  end subroutine say_lines

end program main
