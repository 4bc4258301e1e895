!> Reading a file of text as a whole.
module calor_text_file
  use, intrinsic :: iso_fortran_env, only: iostat_end
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: i8
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: read_text_file

  !> The largest file that is read, in bytes
  integer(i8), parameter :: largest_file = 1000000000_i8

contains

  !> Read a whole file. What does not exist or cannot be read counts as wrong input, since it is the
  !> user who named it.
  subroutine read_text_file(path, text, error)
    !> The file
    character(len=*), intent(in) :: path
    !> Its bytes
    character(len=:), allocatable, intent(out) :: text
    !> There is no such file, it is a folder, it cannot be read, or it is too large
    type(error_t), allocatable, intent(out) :: error
    character(len=200) :: explanation
    integer(i8) :: length
    integer :: unit, status
    logical :: exists

    if (path == '') then
      call raise(error, status_bad_input, 'a file is needed, but its name is empty.')
      return
    end if
    inquire (file=trim(path)//'/.', exist=exists)
    if (exists) then
      call raise(error, status_bad_input, path//' is a folder; name the file in it.')
      return
    end if
    inquire (file=path, exist=exists)
    if (.not. exists) then
      call raise(error, status_bad_input, 'there is no file '//path//'.'//other_file(path))
      return
    end if

    explanation = ''
    open (newunit=unit, file=path, access='stream', form='unformatted', action='read', &
          status='old', iostat=status, iomsg=explanation)
    if (status /= 0) then
      call raise(error, status_bad_input, path//' cannot be read: '//trim(explanation)//'.')
      return
    end if
    inquire (unit=unit, size=length)
    if (length > largest_file) then
      close (unit)
      call raise(error, status_bad_input, path//' is too large: it has '// &
                 to_text(length)//' bytes.')
      return
    end if
    if (length > 0) then
      allocate (character(len=length) :: text)
      read (unit, iostat=status, iomsg=explanation) text
    else
      call read_stream(unit, text, status, explanation)
    end if
    close (unit)
    if (status /= 0) then
      call raise(error, status_bad_input, path//' cannot be read: '//trim(explanation)//'.')
    end if
  end subroutine read_text_file

  !> Read from what has no size, such as a pipe.
  subroutine read_stream(unit, text, status, explanation)
    integer, intent(in) :: unit
    character(len=:), allocatable, intent(out) :: text
    integer, intent(out) :: status
    character(len=200), intent(inout) :: explanation
    integer, parameter :: largest = 10000000
    character(len=:), allocatable :: buffer
    character(len=1) :: byte
    integer :: length

    allocate (character(len=1000) :: buffer)
    length = 0
    do
      read (unit, iostat=status, iomsg=explanation) byte
      if (status /= 0) exit
      if (length == largest) then
        status = 1
        explanation = 'there is no end to it'
        exit
      end if
      if (length == len(buffer)) buffer = buffer//repeat(' ', length)
      length = length + 1
      buffer(length:length) = byte
    end do
    if (status == iostat_end) status = 0
    text = buffer(:length)
  end subroutine read_stream

  !> ` Did you mean '...'?` for a file that exists and has nearly this name.
  function other_file(path) result(sentence)
    character(len=*), intent(in) :: path
    character(len=:), allocatable :: sentence
    logical :: exists

    sentence = ''
    inquire (file=trim(path)//'.nml', exist=exists)
    if (exists) then
      sentence = ' Did you mean '''//trim(path)//'.nml''?'
      return
    end if
    inquire (file='data/'//trim(path), exist=exists)
    if (exists) then
      sentence = ' Did you mean ''data/'//trim(path)//'''?'
      return
    end if
    inquire (file='data/'//trim(path)//'.nml', exist=exists)
    if (exists) sentence = ' Did you mean ''data/'//trim(path)//'.nml''?'
  end function other_file

end module calor_text_file
