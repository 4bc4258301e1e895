!> The commands of the program and their options: one table for the check of what is called, for
!> help, completion and the manual.
module commands
  use calor, only: text_t
  implicit none (type, external)
  private

  public :: command_t, option_t, command_table, option_table, find_command, command_names, &
            option_names

  !> What an argument stands for
  integer, parameter, public :: nothing = 0, scene_file = 1, output_file = 2, starting_scene = 3, &
      scheme_name = 4, effect_name = 5

  !> Something that a user may ask for
  type :: command_t
    character(len=12) :: name
    !> What it does, in a line
    character(len=80) :: summary
    !> Its arguments as help shows them
    character(len=14) :: arguments = ''
    !> How many it takes
    integer :: fewest = 0, most = 0
    !> What the first stands for
    integer :: content = nothing
  end type command_t

  !> An option of a command
  type :: option_t
    !> The command
    character(len=12) :: command
    character(len=12) :: name
    !> What its value is called; '' where it takes none
    character(len=8) :: value = ''
    character(len=72) :: summary = ''
  end type option_t

  type(command_t), parameter :: command_table(*) = [ &
      command_t('run', 'simulate a scene and write its fields', 'SCENE', 1, 1, scene_file), &
      command_t('check', 'say what a scene would simulate, and check it, without running it', &
                'SCENE', 1, 1, scene_file), &
      command_t('plot', 'draw what a command has written', 'FILE', 1, 1, output_file), &
      command_t('operators', 'evaluate derivative schemes on a scene''s cloud', 'SCENE', 1, 1, &
                scene_file), &
      command_t('convergence', 'measure how derivative schemes converge, against theory', &
                '[SCENE]', 0, 1, scene_file), &
      command_t('cost', 'compare schemes by accuracy and wall time', 'SCENE', 1, 1, scene_file), &
      command_t('new', 'list scenes to start from, or write one', '[KIND [NAME]]', 0, 2, &
                starting_scene), &
      command_t('schemes', 'what schemes, kernels and methods there are', '[NAME]', 0, 1, &
                scheme_name), &
      command_t('effects', 'what a scene may call for beside conduction', '[NAME]', 0, 1, &
                effect_name), &
      command_t('completion', 'print what makes bash complete calor''s words'), &
      command_t('manual', 'print the manual page') &
      ]

  type(option_t), parameter :: option_table(*) = [ &
      option_t('run', '--quiet', '', 'say nothing but errors'), &
      option_t('run', '--verbose', '', 'say more: a line for every state that is written'), &
      option_t('run', '--resume', '', 'go on from the last checkpoint'), &
      option_t('run', '--checkpoint', 'FILE', &
               'the checkpoint to resume from; without it that of the scene'), &
      option_t('plot', '--field', 'NAME', 'the field to draw; without it the temperature'), &
      option_t('plot', '--time', 'T', 'the time to draw, s; without it the last'), &
      option_t('plot', '--animate', '', 'draw all times, into a GIF'), &
      option_t('plot', '--output', 'NAME', 'the picture''s name; without it that of FILE') &
      ]

contains

  !> The number of a command in the table, 0 if there is none of that name.
  pure function find_command(name) result(number)
    !> The name
    character(len=*), intent(in) :: name
    integer :: number

    do number = size(command_table), 1, -1
      if (command_table(number)%name == name) return
    end do
  end function find_command

  !> The names of all commands.
  pure function command_names() result(names)
    type(text_t) :: names(size(command_table))
    integer :: k

    do k = 1, size(command_table)
      names(k)%value = trim(command_table(k)%name)
    end do
  end function command_names

  !> The names of a command's options.
  pure function option_names(command) result(names)
    !> The command
    character(len=*), intent(in) :: command
    type(text_t), allocatable :: names(:)
    integer :: k, count

    allocate (names(1 + size(pack(option_table%name, option_table%command == command))))
    names(1)%value = '--help'
    count = 1
    do k = 1, size(option_table)
      if (option_table(k)%command /= command) cycle
      count = count + 1
      names(count)%value = trim(option_table(k)%name)
    end do
  end function option_names

end module commands
