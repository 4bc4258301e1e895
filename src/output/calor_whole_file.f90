!> Text files that are there whole or not at all.
module calor_whole_file
  use calor_error, only: error_t, raise, status_bad_file
  use calor_file_system, only: rename_file, remove_file
  implicit none (type, external)
  private

  public :: write_whole_file, partial_path

contains

  !> Write a text into a file. A file of that name is replaced only once the new one is complete.
  subroutine write_whole_file(path, text, error)
    !> The file
    character(len=*), intent(in) :: path
    !> All of it, lines ended by new_line
    character(len=*), intent(in) :: text
    !> It cannot be written
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: reason
    character(len=200) :: message
    integer :: unit, status, closing, bytes

    message = ''
    open (newunit=unit, file=partial_path(path), access='stream', form='unformatted', &
          status='replace', action='write', iostat=status, iomsg=message)
    if (status == 0) then
      write (unit, iostat=status, iomsg=message) text
      close (unit, iostat=closing)
      ! What the system could not take is not always told.
      inquire (file=partial_path(path), size=bytes)
      if (status == 0 .and. (closing /= 0 .or. bytes /= len(text))) then
        status = 1
        message = 'the disk is full'
      end if
    end if
    ! The compiler's text begins with the name of the unfinished file.
    reason = trim(message(index(message, ': ', back=.true.) + 1:))
    reason = trim(adjustl(reason))
    if (status == 0) call rename_file(partial_path(path), path, reason)
    if (status == 0 .and. reason == '') return
    call raise(error, status_bad_file, 'The file '//path//' cannot be written: '//reason//'.')
    call remove_file(partial_path(path), reason)
  end subroutine write_whole_file

  !> Where a file is made before it takes its name.
  pure function partial_path(path) result(partial)
    !> The file
    character(len=*), intent(in) :: path
    character(len=:), allocatable :: partial

    partial = path//'.partial'
  end function partial_path

end module calor_whole_file
