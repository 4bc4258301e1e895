!> The manual page, from the same tables and words as the help: a text for man (troff).
module manual
  use calor, only: text_t, append, contract_help, contract_groups, describe_schemes, &
                   describe_effects, describe_starting_scenes, error_t, version
  use commands, only: command_table, option_table
  use help, only: command_words, exit_statuses
  implicit none (type, external)
  private

  public :: manual_page

contains

  !> The page.
  function manual_page() result(lines)
    type(text_t), allocatable :: lines(:)
    type(text_t), allocatable :: words(:)
    type(error_t), allocatable :: error
    integer :: k

    call append(lines, '.TH CALOR 1 "" "calor '//version//'" "User Commands"')
    call append(lines, '.SH NAME')
    call append(lines, 'calor \- heat conduction on particles, with known accuracy')
    call append(lines, '.SH SYNOPSIS')
    do k = 1, size(command_table)
      if (k > 1) call append(lines, '.br')
      call append(lines, '.B calor '//trim(command_table(k)%name))
      if (command_table(k)%arguments /= '') call append(lines, plain(command_table(k)%arguments))
    end do
    call append(lines, '.SH COMMANDS')
    do k = 1, size(command_table)
      call append(lines, '.SS "'//trim('calor '//trim(command_table(k)%name)//' '// &
                                       command_table(k)%arguments)//'"')
      call append(lines, plain(command_table(k)%summary)//'.')
      call add_options(trim(command_table(k)%name))
      select case (command_table(k)%name)
      case ('run', 'check', 'operators')
        call append(lines, '.P')
        call append(lines, 'SCENE is a namelist file; its groups and keys are listed below.')
      case default
        call append(lines, '.P')
        call add(command_words(trim(command_table(k)%name)))
        if (command_table(k)%name == 'new') call add_table(describe_starting_scenes())
      end select
    end do
    call append(lines, '.SH SCENES')
    words = contract_groups()
    do k = 1, size(words)
      call append(lines, '.P')
      call add_verbatim(contract_help(words(k)%value))
    end do
    call append(lines, '.SH SCHEMES')
    call describe_schemes('', words, error)
    call add_table(words)
    call append(lines, '.SH EFFECTS')
    call describe_effects('', words, error)
    call add_table(words)
    call append(lines, '.SH EXIT STATUS')
    do k = 1, size(exit_statuses)
      call append(lines, plain(exit_statuses(k)))
    end do

  contains

    subroutine add(text)
      type(text_t), intent(in) :: text(:)
      integer :: j

      do j = 1, size(text)
        call append(lines, plain(text(j)%value))
      end do
    end subroutine add

    subroutine add_options(command)
      character(len=*), intent(in) :: command
      integer :: j

      do j = 1, size(option_table)
        if (option_table(j)%command /= command) cycle
        call append(lines, '.TP')
        call append(lines, '.B '//plain(trim(option_table(j)%name)//' '//option_table(j)%value))
        call append(lines, plain(option_table(j)%summary))
      end do
    end subroutine add_options

    !> Lines as they stand
    subroutine add_table(text)
      type(text_t), intent(in) :: text(:)

      call append(lines, '.nf')
      call add(text)
      call append(lines, '.fi')
    end subroutine add_table

    !> The same of a text that contains ends of lines
    subroutine add_verbatim(text)
      character(len=*), intent(in) :: text
      integer :: start, finish

      call append(lines, '.nf')
      start = 1
      do while (start <= len(text))
        finish = index(text(start:)//new_line('a'), new_line('a'))
        call append(lines, plain(text(start:start + finish - 2)))
        start = start + finish
      end do
      call append(lines, '.fi')
    end subroutine add_verbatim

  end function manual_page

  !> A line of text, so that troff takes no letter of it for a command
  pure function plain(text) result(line)
    character(len=*), intent(in) :: text
    character(len=:), allocatable :: line
    integer :: k

    line = ''
    do k = 1, len_trim(text)
      select case (text(k:k))
      case ('\')
        line = line//'\e'
      case ('-')
        line = line//'\-'
      case ('''', '.')
        if (k == 1) line = '\&'
        line = line//text(k:k)
      case default
        line = line//text(k:k)
      end select
    end do
  end function plain

end module manual
