!> How the program was called: command, arguments, options.
module command_call
  use calor, only: error_t, raise, status_bad_input, suggestion, text_t, to_text, append
  use commands, only: command_t, option_t, command_table, option_table, find_command, &
                      command_names, option_names
  implicit none (type, external)
  private

  public :: call_t, read_call

  !> A call
  type :: call_t
    !> The command; '' where there is none
    character(len=:), allocatable :: command
    !> Its arguments in their order
    type(text_t), allocatable :: argument(:)
    !> Names of the options that were given, and their values
    type(text_t), allocatable :: option(:), value(:)
    !> Whether help is asked for
    logical :: wants_help = .false.
  contains
    !> An argument, '' where it was left out
    procedure :: word
    !> Whether an option was given
    procedure :: has
    !> The value of an option, '' where it was not given
    procedure :: option_value
  end type call_t

contains

  !> Read the command line.
  subroutine read_call(this, error)
    !> The call
    type(call_t), intent(out) :: this
    !> No such command or option, or too few or too many arguments
    type(error_t), allocatable, intent(out) :: error
    integer :: k, number

    allocate (this%argument(0), this%option(0), this%value(0))
    this%command = argument(1)
    select case (this%command)
    case ('', '-h', '--help', 'help')
      this%command = ''
      this%wants_help = .true.
      if (argument(1) /= 'help' .or. argument(2) == '') return
      this%command = argument(2)
      if (find_command(this%command) == 0) call raise_unknown(this%command, error)
      return
    case ('-V', '--version', 'version')
      this%command = 'version'
      return
    case default
      continue
    end select
    number = find_command(this%command)
    if (number == 0) then
      call raise_unknown(this%command, error)
      return
    end if
    do k = 2, command_argument_count()
      this%wants_help = this%wants_help .or. argument(k) == '--help' .or. argument(k) == '-h'
    end do
    if (this%wants_help) return
    call read_words(this, error)
    if (.not. allocated(error)) call check_count(this, command_table(number), error)
  end subroutine read_call

  !> Options, which begin with '-', from arguments. '--' ends the options.
  subroutine read_words(this, error)
    type(call_t), intent(inout) :: this
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: word, name
    type(option_t) :: option
    integer :: k, sign
    logical :: options_end

    options_end = .false.
    k = 1
    do while (k < command_argument_count())
      k = k + 1
      word = argument(k)
      if (word == '--' .and. .not. options_end) then
        options_end = .true.
        cycle
      end if
      if (index(word, '-') /= 1 .or. options_end) then
        call append(this%argument, word)
        cycle
      end if
      sign = index(word//'=', '=')
      name = word(:sign - 1)
      call find_option(this%command, name, option)
      if (option%name == '') then
        call raise(error, status_bad_input, 'calor '//this%command//' has no option '''//name// &
                   '''.'//suggestion(name, option_names(this%command))//' See calor '// &
                   this%command//' --help.')
        return
      end if
      call append(this%option, name)
      if (option%value == '') then
        if (sign <= len(word)) then
          call raise(error, status_bad_input, 'The option '//name//' takes no value, but got '''// &
                     word(sign + 1:)//'''.')
          return
        end if
        call append(this%value, '')
      else if (sign <= len(word)) then
        call append(this%value, word(sign + 1:))
      else if (k < command_argument_count()) then
        k = k + 1
        call append(this%value, argument(k))
      else
        call raise(error, status_bad_input, 'The option '//name//' needs a value: '//name//' '// &
                   trim(option%value)//', '//trim(option%summary)//'.')
        return
      end if
    end do
  end subroutine read_words

  pure subroutine find_option(command, name, option)
    character(len=*), intent(in) :: command, name
    !> Its name is '' where there is none
    type(option_t), intent(out) :: option
    integer :: k

    option = option_t(command, '')
    do k = 1, size(option_table)
      if (option_table(k)%command == command .and. option_table(k)%name == name) then
        option = option_table(k)
      end if
    end do
  end subroutine find_option

  subroutine check_count(this, command, error)
    type(call_t), intent(in) :: this
    type(command_t), intent(in) :: command
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: taken

    associate (given => size(this%argument))
      if (given >= command%fewest .and. given <= command%most) return
      taken = 'takes no argument'
      if (command%most == 1) taken = 'takes one argument, '//trim(command%arguments)
      if (command%most == 2) taken = 'takes at most two arguments, '//trim(command%arguments)
      if (given == 0) then
        taken = 'needs '//trim(command%arguments)
      else
        taken = taken//', but '//to_text(given)//trim(merge(' was ', ' were', given == 1))//' given'
      end if
      call raise(error, status_bad_input, 'calor '//this%command//' '//taken//'. See calor '// &
                 this%command//' --help.')
    end associate
  end subroutine check_count

  subroutine raise_unknown(command, error)
    character(len=*), intent(in) :: command
    type(error_t), allocatable, intent(out) :: error
    type(text_t) :: options(2)

    if (index(command, '-') == 1) then
      options(1)%value = '--help'
      options(2)%value = '--version'
      call raise(error, status_bad_input, 'There is no option '''//command//'''.'// &
                 suggestion(command, options)//' See calor --help.')
    else
      call raise(error, status_bad_input, 'There is no command '''//command//'''.'// &
                 suggestion(command, command_names())//' See calor --help.')
    end if
  end subroutine raise_unknown

  function word(this, number) result(text)
    class(call_t), intent(in) :: this
    !> Which argument
    integer, intent(in) :: number
    character(len=:), allocatable :: text

    text = ''
    if (number <= size(this%argument)) text = this%argument(number)%value
  end function word

  function has(this, name) result(answer)
    class(call_t), intent(in) :: this
    !> The option
    character(len=*), intent(in) :: name
    logical :: answer
    integer :: k

    answer = .false.
    do k = 1, size(this%option)
      answer = answer .or. this%option(k)%value == name
    end do
  end function has

  function option_value(this, name) result(text)
    class(call_t), intent(in) :: this
    !> The option
    character(len=*), intent(in) :: name
    character(len=:), allocatable :: text
    integer :: k

    text = ''
    do k = 1, size(this%option)
      if (this%option(k)%value == name) text = this%value(k)%value
    end do
  end function option_value

  !> Command-line argument number `position`, or '' if there is none.
  function argument(position) result(text)
    integer, intent(in) :: position
    character(len=:), allocatable :: text
    integer :: length

    call get_command_argument(position, length=length)
    allocate (character(len=length) :: text)
    if (length > 0) call get_command_argument(position, text)
  end function argument

end module command_call
