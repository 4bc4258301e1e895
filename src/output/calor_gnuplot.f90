!> Pictures, drawn by the program gnuplot.
!>
!> A script is a text in gnuplot's own language; numbers go into it as data blocks
!> ('$name << end' … 'end'), so that nothing but the script is needed.
module calor_gnuplot
  use calor_error, only: error_t, raise, status_bad_input, status_bad_file
  use calor_file_system, only: look_at_path, make_scratch_folder, path_file, remove_file, &
                               remove_folder, rename_file
  use calor_kinds, only: wp
  use calor_text, only: to_text
  use calor_whole_file, only: partial_path, write_whole_file
  implicit none (type, external)
  private

  public :: draw_picture, draw_animation, run_gnuplot, in_script

contains

  !> Draw a picture. A file of that name is replaced only once the new one is complete.
  subroutine draw_picture(path, width, height, script, error)
    !> The file; its ending says which kind it is: .svg or .png
    character(len=*), intent(in) :: path
    !> Size in pixels
    integer, intent(in) :: width, height
    !> What to draw, without terminal and output
    character(len=*), intent(in) :: script
    !> The ending is another one, there is no gnuplot, the script is wrong, or the file cannot be
    !> written
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: terminal

    select case (path(index(path, '.', back=.true.):))
    case ('.svg')
      terminal = 'svg font "DejaVu Sans,16" linewidth 1.5 background "#ffffff"'
    case ('.png')
      terminal = 'pngcairo font "DejaVu Sans,16" linewidth 1.5'
    case default
      call raise(error, status_bad_input, 'The picture '//path//' should end in .svg or .png.')
      return
    end select
    call draw(path, terminal, width, height, script, error)
  end subroutine draw_picture

  !> Draw a moving picture (GIF), a frame for each plot of the script, without end. A file of that
  !> name is replaced only once the new one is complete.
  subroutine draw_animation(path, width, height, seconds, script, error)
    !> The file
    character(len=*), intent(in) :: path
    !> Size in pixels
    integer, intent(in) :: width, height
    !> How long a frame stays, s
    real(wp), intent(in) :: seconds
    !> What to draw, without terminal and output
    character(len=*), intent(in) :: script
    !> There is no gnuplot, the script is wrong, or the file cannot be written
    type(error_t), allocatable, intent(out) :: error

    call draw(path, 'gif animate loop 0 delay '//to_text(nint(100*seconds))// &
              ' font "DejaVu Sans,12"', width, height, script, error)
  end subroutine draw_animation

  subroutine draw(path, terminal, width, height, script, error)
    character(len=*), intent(in) :: path, terminal
    integer, intent(in) :: width, height
    character(len=*), intent(in) :: script
    type(error_t), allocatable, intent(out) :: error
    character(len=*), parameter :: end = new_line('a')
    character(len=:), allocatable :: reason
    integer :: kind_of_path

    call run_gnuplot('set encoding utf8'//end//'set terminal '//terminal//' size '// &
                     to_text(width)//','//to_text(height)//end//'set output '''// &
                     doubled(partial_path(path))//''''//end//script//end//'unset output'//end, &
                     error)
    reason = ''
    if (.not. allocated(error)) then
      ! gnuplot does not always tell when it could not write.
      call look_at_path(partial_path(path), kind_of_path, reason)
      if (kind_of_path == path_file) call rename_file(partial_path(path), path, reason)
      if (kind_of_path /= path_file .or. reason /= '') then
        call raise(error, status_bad_file, 'The picture '//path//' cannot be written: '// &
                   reason//'.')
      end if
    end if
    if (allocated(error)) call remove_file(partial_path(path), reason)
  end subroutine draw

  !> Run a script; what it writes and where is its own affair.
  subroutine run_gnuplot(script, error)
    !> The script, lines ended by new_line
    character(len=*), intent(in) :: script
    !> There is no gnuplot, or the script is wrong, or there is no room for temporary files; all of
    !> them status_bad_file
    type(error_t), allocatable, intent(out) :: error
    integer, parameter :: not_found = 127
    character(len=:), allocatable :: folder, reason, said
    integer :: status, command_status

    call make_scratch_folder(folder, reason)
    if (reason /= '') then
      call raise(error, status_bad_file, 'There is no place for temporary files: '//folder// &
                 ': '//reason//'. The variable TMPDIR may name another folder.')
      return
    end if
    call write_whole_file(folder//'/script', script, error)
    if (.not. allocated(error)) then
      ! Where `cmdstat` is asked for, a program that is not there does not end this one.
      call execute_command_line('gnuplot '//quoted(folder//'/script')//' </dev/null >'// &
                                quoted(folder//'/said')//' 2>&1', exitstat=status, &
                                cmdstat=command_status)
      if (status == not_found) then
        call raise(error, status_bad_file, 'There is no gnuplot to draw with. On Debian: '// &
                   'apt install gnuplot-nox')
      else if (status /= 0 .or. command_status /= 0) then
        call read_text(folder//'/said', said)
        call raise(error, status_bad_file, 'gnuplot failed: '//said)
      end if
      call remove_file(folder//'/said', reason)
      call remove_file(folder//'/script', reason)
    end if
    call remove_folder(folder, reason)
  end subroutine run_gnuplot

  !> What gnuplot printed, in one line.
  subroutine read_text(path, text)
    character(len=*), intent(in) :: path
    character(len=:), allocatable, intent(out) :: text
    character(len=400) :: line
    integer :: unit, status

    text = ''
    open (newunit=unit, file=path, status='old', action='read', iostat=status)
    if (status /= 0) return
    do
      read (unit, '(a)', iostat=status) line
      if (status /= 0) exit
      if (line /= '') text = text//' '//trim(adjustl(line))
    end do
    close (unit)
    text = adjustl(text)
  end subroutine read_text

  !> A word as the shell takes it literally
  pure function quoted(word) result(text)
    character(len=*), intent(in) :: word
    character(len=:), allocatable :: text
    integer :: k

    text = ''''
    do k = 1, len(word)
      if (word(k:k) == '''') then
        text = text//'''\'''''
      else
        text = text//word(k:k)
      end if
    end do
    text = text//''''
  end function quoted

  !> A text as it stands between double quotes in a script; a line feed parts lines.
  pure function in_script(text) result(escaped)
    !> The text
    character(len=*), intent(in) :: text
    character(len=:), allocatable :: escaped
    integer :: k

    escaped = ''
    do k = 1, len(text)
      select case (text(k:k))
      case (achar(10))
        escaped = escaped//'\n'
      case ('"', '\')
        escaped = escaped//'\'//text(k:k)
      case ('`')
        ! gnuplot would have the shell run what stands between two of them: the code says the same.
        escaped = escaped//'\140'
      case default
        escaped = escaped//text(k:k)
      end select
    end do
  end function in_script

  !> A word as it stands between quotes in a script: each quote in it twice
  pure function doubled(word) result(text)
    character(len=*), intent(in) :: word
    character(len=:), allocatable :: text
    integer :: k

    text = ''
    do k = 1, len(word)
      text = text//word(k:k)
      if (word(k:k) == '''') text = text//''''
    end do
  end function doubled

end module calor_gnuplot
