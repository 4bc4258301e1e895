!> What calor says of itself: the overview, and more about each command.
module help
  use calor, only: choice_t, text_t, text_list, append, version, contract_help, contract_groups, &
                   arrangement_choices, gradient_choices, integrator_choices, kernel_choices, &
                   laplacian_choices, shape_choices, starting_scenes
  use commands, only: command_table, option_table, find_command
  implicit none (type, external)
  private

  public :: overview, command_help, command_words, exit_statuses

  !> What else there is to say of a command
  character(len=96), parameter :: plot_words(*) = [character(len=96) :: &
      'Draws FILE as PNG and SVG beside it (plate.vtkhdf as plate.png and plate.svg): a', &
      'field as a map with colour bar and lines of equal value, the heat budget over', &
      'time where the file has one, all derivatives of calor operators; and the tables', &
      '(CSV) of calor cost and calor convergence. gnuplot does the drawing.']
  character(len=96), parameter :: convergence_words(*) = [character(len=96) :: &
      'Refines lattices and irregular clouds in three ways and writes convergence.csv,', &
      'convergence.svg and convergence.png into the current folder. Takes some seconds.', &
      'SCENE, a namelist file, may say what is refined: &domain (its spacing is the', &
      'coarsest, a 16th of it the finest), &kernel, and in &operators field and schemes.']
  character(len=96), parameter :: cost_words(*) = [character(len=96) :: &
      'Runs SCENE with several schemes, spacings and supports, and reports error, wall', &
      'time by phase and memory of each: a table, a file (CSV) and pictures (SVG, PNG).', &
      'Time steps are as long as they may be without spoiling the error. Without a group', &
      '&cost all schemes are compared at 4, 2, 1 and 1/2 times the scene''s spacing.', &
      'Ctrl-C ends it early and keeps what was measured.']
  character(len=96), parameter :: new_words(*) = [character(len=96) :: &
      'Writes a commented scene of a KIND, which runs in seconds, into NAME.nml', &
      '(without NAME into KIND.nml). An existing file is left alone.']
  character(len=96), parameter :: schemes_words(*) = [character(len=96) :: &
      'Lists gradients, Laplacians, kernels and time integrators; with NAME says what', &
      'that one is for, what it costs, its formula and where that is from.']
  character(len=96), parameter :: effects_words(*) = [character(len=96) :: &
      'Lists what a scene may call for beside conduction; with NAME says how it is', &
      'called for, what it costs, its formula and where that is from.']
  character(len=96), parameter :: completion_words(*) = [character(len=96) :: &
      'In bash, eval "$(calor completion)" completes commands, options, scenes and names', &
      'from there on; in ~/.bashrc, in every shell. make install sets it up for all.']
  character(len=96), parameter :: manual_words(*) = [character(len=96) :: &
      'make install puts it where man finds it; without that: calor manual | man -l -']

  character(len=96), parameter :: exit_statuses(*) = [character(len=96) :: &
      'Exit status: 0 done, 2 the input is wrong, 3 the numbers went wrong,', &
      '4 a file could not be read or written.']

contains

  !> What there is, in a screen.
  function overview() result(lines)
    type(text_t), allocatable :: lines(:)
    integer :: k

    call append(lines, 'calor '//version//': heat conduction on particles, with known accuracy')
    call append(lines, '')
    call append(lines, 'Usage:')
    do k = 1, size(command_table)
      call append(lines, '  calor '//command_table(k)%name//command_table(k)%arguments//' '// &
                  trim(command_table(k)%summary))
    end do
    call append(lines, '  calor COMMAND --help       more about a command')
    call append(lines, '  calor --version')
    call append(lines, '')
    call append(lines, 'A scene is a Fortran namelist file; ''calor new plate'' writes one to '// &
                'start from.')
    do k = 1, size(exit_statuses)
      call append(lines, trim(exit_statuses(k)))
    end do
  end function overview

  !> All about a command.
  function command_help(name) result(lines)
    !> The command
    character(len=*), intent(in) :: name
    type(text_t), allocatable :: lines(:)
    integer :: k
    logical :: any_option

    k = find_command(name)
    call append(lines, trim('calor '//name//' '//command_table(k)%arguments)//': '// &
                trim(command_table(k)%summary))
    any_option = .false.
    do k = 1, size(option_table)
      if (option_table(k)%command /= name) cycle
      if (.not. any_option) call append(lines, '')
      any_option = .true.
      call append(lines, '  '//option_table(k)%name//option_table(k)%value// &
                  trim(option_table(k)%summary))
    end do
    call append(lines, '')
    call add(lines, command_words(name))
    select case (name)
    case ('run', 'check')
      call add_groups(lines, contract_groups())
      call add_choices(lines, '&domain shape', shape_choices)
      call add_choices(lines, '&domain arrangement', arrangement_choices)
      call add_choices(lines, '&kernel name', kernel_choices)
      call add_choices(lines, '&scheme laplacian', laplacian_choices)
      call add_choices(lines, '&time method', integrator_choices)
    case ('operators')
      call add_groups(lines, text_list([character(len=9) :: 'operators', 'domain', 'kernel']))
      call add_choices(lines, '&kernel name', kernel_choices)
      call add_choices(lines, '&operators gradients', gradient_choices)
      call add_choices(lines, '&operators laplacians', laplacian_choices)
    case ('convergence')
      call add_groups(lines, text_list([character(len=9) :: 'domain', 'kernel', 'operators']))
      call add_choices(lines, '&kernel name', kernel_choices)
    case ('cost')
      call append(lines, 'Beside what run needs:')
      call add_groups(lines, text_list([character(len=6) :: 'cost', 'domain', 'kernel', 'time']))
      call add_choices(lines, '&cost laplacians', laplacian_choices)
    case ('new')
      call append(lines, 'Kinds:')
      do k = 1, size(starting_scenes)
        call append(lines, '  '//starting_scenes(k)%name(1:16)//trim(starting_scenes(k)%summary))
      end do
    case default
      continue
    end select
  end function command_help

  !> What a command does, in sentences.
  function command_words(name) result(lines)
    !> The command
    character(len=*), intent(in) :: name
    type(text_t), allocatable :: lines(:)

    select case (name)
    case ('run', 'check')
      lines = text_list(['SCENE is a namelist file of these groups and keys:'])
    case ('operators')
      lines = text_list(['SCENE is a namelist file with these groups and keys:'])
    case ('plot')
      lines = text_list(plot_words)
    case ('convergence')
      lines = text_list(convergence_words)
    case ('cost')
      lines = text_list(cost_words)
    case ('new')
      lines = text_list(new_words)
    case ('schemes')
      lines = text_list(schemes_words)
    case ('effects')
      lines = text_list(effects_words)
    case ('completion')
      lines = text_list(completion_words)
    case default
      lines = text_list(manual_words)
    end select
  end function command_words

  subroutine add(lines, more)
    type(text_t), allocatable, intent(inout) :: lines(:)
    type(text_t), intent(in) :: more(:)
    integer :: k

    do k = 1, size(more)
      call append(lines, more(k)%value)
    end do
  end subroutine add

  subroutine add_groups(lines, groups)
    type(text_t), allocatable, intent(inout) :: lines(:)
    type(text_t), intent(in) :: groups(:)
    integer :: k

    do k = 1, size(groups)
      call append(lines, '')
      call append(lines, contract_help(groups(k)%value))
    end do
  end subroutine add_groups

  !> What may be given for a key
  subroutine add_choices(lines, key, choices)
    type(text_t), allocatable, intent(inout) :: lines(:)
    character(len=*), intent(in) :: key
    type(choice_t), intent(in) :: choices(:)
    integer :: k

    call append(lines, '')
    call append(lines, key//':')
    do k = 1, size(choices)
      call append(lines, '  '//choices(k)%name(1:26)//trim(choices(k)%summary))
    end do
  end subroutine add_choices

end module help
