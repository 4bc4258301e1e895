!> What makes bash complete calor's words, from the tables of commands, options and names.
module completion
  use calor, only: text_t, append, choice_names, effect_names, join, scheme_names, starting_scenes
  use commands, only: command_table, option_table, command_names, option_names, scene_file, &
                      output_file, starting_scene, scheme_name, effect_name
  implicit none (type, external)
  private

  public :: completion_script

contains

  !> The script, for bash to read.
  function completion_script() result(lines)
    type(text_t), allocatable :: lines(:)
    integer :: k

    call append(lines, '# Completion for bash, printed by: calor completion')
    call append(lines, '_calor() {')
    call append(lines, '  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]}')
    call append(lines, '  local command=${COMP_WORDS[1]} words=''''')
    call append(lines, '  COMPREPLY=()')
    call append(lines, '  if ((COMP_CWORD == 1)) || '// &
                '{ ((COMP_CWORD == 2)) && [[ $command == help ]]; }; then')
    call append(lines, '    words='''//join(command_names(), ' ')//' help --help --version''')
    call append(lines, '  elif [[ $word == -* ]]; then')
    call append(lines, '    case $command in')
    do k = 1, size(command_table)
      call append(lines, '      '//trim(command_table(k)%name)//') words='''// &
                  join(option_names(trim(command_table(k)%name)), ' ')//''' ;;')
    end do
    call append(lines, '    esac')
    call append(lines, '  else')
    call append(lines, '    case $command$before in')
    do k = 1, size(option_table)
      ! What an option's value may be is the user's affair.
      if (option_table(k)%value /= '') then
        call append(lines, '      '//trim(option_table(k)%command)//trim(option_table(k)%name)// &
                    ') return ;;')
      end if
    end do
    call append(lines, '    esac')
    call append(lines, '    case $command in')
    do k = 1, size(command_table)
      call add_arguments(trim(command_table(k)%name), command_table(k)%content)
    end do
    call append(lines, '    esac')
    call append(lines, '  fi')
    call append(lines, '  [[ -z $words ]] || COMPREPLY=($(compgen -W "$words" -- "$word"))')
    call append(lines, '}')
    call append(lines, '# Folders, and files with one of some endings')
    call append(lines, '_calor_files() {')
    call append(lines, '  local IFS=$''\n'' word=$1 ending')
    call append(lines, '  shift')
    call append(lines, '  COMPREPLY=($(compgen -d -- "$word"))')
    call append(lines, '  for ending; do')
    call append(lines, '    COMPREPLY+=($(compgen -f -X "!*.$ending" -- "$word"))')
    call append(lines, '  done')
    call append(lines, '  compopt -o filenames 2>/dev/null')
    call append(lines, '}')
    call append(lines, 'complete -F _calor calor')

  contains

    !> The case of a command's first argument
    subroutine add_arguments(command, content)
      character(len=*), intent(in) :: command
      integer, intent(in) :: content

      select case (content)
      case (scene_file)
        call append(lines, '      '//command//') _calor_files "$word" nml ;;')
      case (output_file)
        call append(lines, '      '//command//') _calor_files "$word" vtkhdf csv ;;')
      case (starting_scene)
        call append(lines, '      '//command//') ((COMP_CWORD > 2)) || words='''// &
                    join(choice_names(starting_scenes), ' ')//''' ;;')
      case (scheme_name)
        call append(lines, '      '//command//') words='''//join(scheme_names(), ' ')//''' ;;')
      case (effect_name)
        call append(lines, '      '//command//') words='''//join(effect_names(), ' ')//''' ;;')
      case default
        continue
      end select
    end subroutine add_arguments

  end function completion_script

end module completion
