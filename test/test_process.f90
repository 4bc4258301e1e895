!> Runs programs for tests: exit status, what they printed, and the files that they need.
module test_process
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: outcome_t, run_command, environment_or, contents_of, write_text, number_after, &
            line_count, program_path

  !> What a command did
  type :: outcome_t
    !> Exit status; beyond 128 for a program that a signal ended
    integer :: status = -1
    !> What it printed
    character(len=:), allocatable :: output, errors
  end type outcome_t

contains

  !> Run a command of the shell. Its standard output and error go through files named `trace`.out
  !> and `trace`.err, which stay for whoever wants to look at them.
  subroutine run_command(command, trace, outcome)
    character(len=*), intent(in) :: command, trace
    type(outcome_t), intent(out) :: outcome
    integer :: obstacle

    ! That a program could not start is told by its exit status.
    call execute_command_line('('//command//') >'//trace//'.out 2>'//trace//'.err </dev/null', &
                              exitstat=outcome%status, cmdstat=obstacle)
    if (obstacle /= 0 .and. outcome%status < 126) outcome%status = -1
    outcome%output = contents_of(trace//'.out')
    outcome%errors = contents_of(trace//'.err')
  end subroutine run_command

  !> The value of an environment variable, or something else where there is none.
  function environment_or(name, otherwise) result(value)
    character(len=*), intent(in) :: name, otherwise
    character(len=:), allocatable :: value
    integer :: length, status

    call get_environment_variable(name, length=length, status=status)
    if (status /= 0 .or. length == 0) then
      value = otherwise
      return
    end if
    allocate (character(len=length) :: value)
    call get_environment_variable(name, value)
  end function environment_or

  !> All of a file; '' if it cannot be read.
  function contents_of(path) result(text)
    character(len=*), intent(in) :: path
    character(len=:), allocatable :: text
    integer :: unit, status, bytes

    text = ''
    open (newunit=unit, file=path, access='stream', form='unformatted', status='old', &
          action='read', iostat=status)
    if (status /= 0) return
    inquire (unit=unit, size=bytes)
    if (bytes > 0) then
      deallocate (text)
      allocate (character(len=bytes) :: text)
      read (unit, iostat=status) text
      if (status /= 0) text = ''
    end if
    close (unit)
  end function contents_of

  !> Write a text to a file as it is.
  subroutine write_text(path, text)
    character(len=*), intent(in) :: path, text
    integer :: unit

    open (newunit=unit, file=path, access='stream', form='unformatted', status='replace', &
          action='write')
    write (unit) text
    close (unit)
  end subroutine write_text

  !> The first number behind a phrase in a text, or a huge one if there is none.
  function number_after(text, phrase) result(number)
    character(len=*), intent(in) :: text, phrase
    real(wp) :: number
    integer :: start, length, status

    number = huge(number)
    start = index(text, phrase)
    if (start == 0) return
    start = start + len(phrase)
    length = verify(text(start:), ' ') - 1
    if (length < 0) return
    start = start + length
    length = verify(text(start:)//'|', '0123456789.+-eE') - 1
    read (text(start:start + length - 1), *, iostat=status) number
    if (status /= 0) number = huge(number)
  end function number_after

  !> The number of lines of a text.
  pure function line_count(text) result(number)
    character(len=*), intent(in) :: text
    integer :: number
    integer :: k

    number = 0
    do k = 1, len(text)
      if (text(k:k) == new_line('a')) number = number + 1
    end do
  end function line_count

  !> The program under test, in quotes, so that it is found from any folder
  function program_path() result(path)
    character(len=:), allocatable :: path
    type(outcome_t) :: here

    path = environment_or('CALOR_PROGRAM', 'bin/calor')
    if (path(1:1) /= '/') then
      call run_command('pwd', 'build/test/here', here)
      path = here%output(:len(here%output) - 1)//'/'//path
    end if
    path = '"'//path//'"'
  end function program_path

end module test_process
