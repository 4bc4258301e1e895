!> What the file system says of a path, and the few things that Fortran cannot do to a file.
!>
!> A reason is the system's own short text, such as 'Permission denied'; '' means that all is well.
module calor_file_system
  use, intrinsic :: iso_c_binding, only: c_ptr, c_int, c_int64_t, c_intptr_t, c_null_ptr, &
                                         c_loc, c_associated
  use calor_c_text, only: to_c, from_c
  use calor_kinds, only: i8
  implicit none (type, external)
  private

  public :: look_at_path, path_missing, path_file, path_folder, path_other, path_unreachable
  public :: parent_folder, resolved_path, read_obstacle, write_obstacle
  public :: rename_file, remove_file, link_file, synchronise, try_writing, reserve_space, cut_file
  public :: make_scratch_folder, remove_folder
  public :: ignore_file_size_signal

  !> Nothing is there
  integer, parameter :: path_missing = 0
  !> A regular file
  integer, parameter :: path_file = 1
  !> A folder
  integer, parameter :: path_folder = 2
  !> A device, pipe or socket
  integer, parameter :: path_other = 3
  !> The system does not let us look
  integer, parameter :: path_unreachable = 4

  interface
    function c_access(path, mode) result(status) bind(c, name='access')
      import :: c_ptr, c_int
      implicit none (type, external)
      type(c_ptr), intent(in), value :: path
      integer(c_int), intent(in), value :: mode
      integer(c_int) :: status
    end function c_access

    function c_rename(old, new) result(status) bind(c, name='rename')
      import :: c_ptr, c_int
      implicit none (type, external)
      type(c_ptr), intent(in), value :: old, new
      integer(c_int) :: status
    end function c_rename

    function c_link(old, new) result(status) bind(c, name='link')
      import :: c_ptr, c_int
      implicit none (type, external)
      type(c_ptr), intent(in), value :: old, new
      integer(c_int) :: status
    end function c_link

    function c_fsync(descriptor) result(status) bind(c, name='fsync')
      import :: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: descriptor
      integer(c_int) :: status
    end function c_fsync

    function c_unlink(path) result(status) bind(c, name='unlink')
      import :: c_ptr, c_int
      implicit none (type, external)
      type(c_ptr), intent(in), value :: path
      integer(c_int) :: status
    end function c_unlink

    function c_mkdtemp(template) result(path) bind(c, name='mkdtemp')
      import :: c_ptr
      implicit none (type, external)
      type(c_ptr), intent(in), value :: template
      type(c_ptr) :: path
    end function c_mkdtemp

    function c_rmdir(path) result(status) bind(c, name='rmdir')
      import :: c_ptr, c_int
      implicit none (type, external)
      type(c_ptr), intent(in), value :: path
      integer(c_int) :: status
    end function c_rmdir

    function c_creat(path, mode) result(descriptor) bind(c, name='creat')
      import :: c_ptr, c_int
      implicit none (type, external)
      type(c_ptr), intent(in), value :: path
      integer(c_int), intent(in), value :: mode
      integer(c_int) :: descriptor
    end function c_creat

    function c_close(descriptor) result(status) bind(c, name='close')
      import :: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: descriptor
      integer(c_int) :: status
    end function c_close

    function c_posix_fallocate(descriptor, offset, bytes) result(code) bind(c, &
                                                                            name='posix_fallocate')
      import :: c_int, c_int64_t
      implicit none (type, external)
      integer(c_int), intent(in), value :: descriptor
      integer(c_int64_t), intent(in), value :: offset, bytes
      integer(c_int) :: code
    end function c_posix_fallocate

    function c_ftruncate(descriptor, bytes) result(status) bind(c, name='ftruncate')
      import :: c_int, c_int64_t
      implicit none (type, external)
      integer(c_int), intent(in), value :: descriptor
      integer(c_int64_t), intent(in), value :: bytes
      integer(c_int) :: status
    end function c_ftruncate

    function c_realpath(path, buffer) result(resolved) bind(c, name='realpath')
      import :: c_ptr
      implicit none (type, external)
      type(c_ptr), intent(in), value :: path
      type(c_ptr), intent(in), value :: buffer
      type(c_ptr) :: resolved
    end function c_realpath

    subroutine c_free(address) bind(c, name='free')
      import :: c_ptr
      implicit none (type, external)
      type(c_ptr), intent(in), value :: address
    end subroutine c_free

    function c_strerror(code) result(text) bind(c, name='strerror')
      import :: c_int, c_ptr
      implicit none (type, external)
      integer(c_int), intent(in), value :: code
      type(c_ptr) :: text
    end function c_strerror

    function c_signal(number, handler) result(old) bind(c, name='signal')
      import :: c_int, c_intptr_t
      implicit none (type, external)
      integer(c_int), intent(in), value :: number
      integer(c_intptr_t), intent(in), value :: handler
      integer(c_intptr_t) :: old
    end function c_signal
  end interface

contains

  !> Find out what is at a path; links are followed.
  subroutine look_at_path(path, kind_of_path, reason)
    !> Any path
    character(len=*), intent(in) :: path
    !> One of the `path_...` constants
    integer, intent(out) :: kind_of_path
    !> Why nothing can be seen there, where that is so
    character(len=:), allocatable, intent(out) :: reason
    integer, parameter :: no_entry = 2, no_folder_on_the_way = 20
    integer, parameter :: kind_bits = int(o'170000'), folder_bits = int(o'040000'), &
                          file_bits = int(o'100000')
    integer :: facts(13), status
    intrinsic :: stat

    reason = ''
    call stat(path, facts, status)
    if (status /= 0) then
      reason = from_c(c_strerror(int(status, c_int)))
      kind_of_path = path_unreachable
      if (status == no_entry .or. status == no_folder_on_the_way) kind_of_path = path_missing
      return
    end if
    if (iand(facts(3), kind_bits) == folder_bits) then
      kind_of_path = path_folder
    else if (iand(facts(3), kind_bits) == file_bits) then
      kind_of_path = path_file
    else
      kind_of_path = path_other
    end if
  end subroutine look_at_path

  !> The folder that a path lies in: 'a' for 'a/b', '.' for 'b', '/' for '/b'.
  pure function parent_folder(path) result(folder)
    !> Any path
    character(len=*), intent(in) :: path
    character(len=:), allocatable :: folder
    integer :: slash

    slash = index(path, '/', back=.true.)
    select case (slash)
    case (0)
      folder = '.'
    case (1)
      folder = '/'
    case default
      folder = path(:slash - 1)
    end select
  end function parent_folder

  !> The path with every link on the way followed; the path itself if nothing is there yet.
  function resolved_path(path) result(resolved)
    !> Any path
    character(len=*), intent(in) :: path
    character(len=:), allocatable :: resolved
    character(len=:), allocatable, target :: given
    type(c_ptr) :: address

    given = to_c(path)
    address = c_realpath(c_loc(given), c_null_ptr)
    if (c_associated(address)) then
      resolved = from_c(address)
      call c_free(address)
    else
      resolved = trim(path)
    end if
  end function resolved_path

  !> Why a path may not be read, or ''.
  function read_obstacle(path) result(reason)
    !> Any path
    character(len=*), intent(in) :: path
    character(len=:), allocatable :: reason

    reason = access_obstacle(path, 4_c_int)
  end function read_obstacle

  !> Why a file may not be written, or a folder not be written into, or ''.
  function write_obstacle(path) result(reason)
    !> Any path
    character(len=*), intent(in) :: path
    character(len=:), allocatable :: reason

    reason = access_obstacle(path, 2_c_int)
  end function write_obstacle

  function access_obstacle(path, mode) result(reason)
    character(len=*), intent(in) :: path
    integer(c_int), intent(in) :: mode
    character(len=:), allocatable :: reason
    character(len=:), allocatable, target :: given

    given = to_c(path)
    reason = reason_of(c_access(c_loc(given), mode))
  end function access_obstacle

  !> Give a file another name in the same file system; a file of that name is replaced at once.
  subroutine rename_file(old, new, reason)
    !> The file
    character(len=*), intent(in) :: old
    !> Its new name
    character(len=*), intent(in) :: new
    !> Why that failed, or ''
    character(len=:), allocatable, intent(out) :: reason
    character(len=:), allocatable, target :: from, to

    from = to_c(old)
    to = to_c(new)
    reason = reason_of(c_rename(c_loc(from), c_loc(to)))
  end subroutine rename_file

  !> Give a file a second name in the same file system; nothing must be there of that name.
  subroutine link_file(old, new, reason)
    !> The file
    character(len=*), intent(in) :: old
    !> Its second name
    character(len=*), intent(in) :: new
    !> Why that failed, or ''
    character(len=:), allocatable, intent(out) :: reason
    character(len=:), allocatable, target :: from, to

    from = to_c(old)
    to = to_c(new)
    reason = reason_of(c_link(c_loc(from), c_loc(to)))
  end subroutine link_file

  !> Wait until all that was written to an open file is on the disk. A file system that knows no
  !> such thing is no reason to fail.
  subroutine synchronise(unit, reason)
    !> Fortran's number of the file, flushed
    integer, intent(in) :: unit
    !> Why the file is not whole, or ''
    character(len=:), allocatable, intent(out) :: reason
    integer, parameter :: input_output = 5, no_space = 28, over_quota = 122
    intrinsic :: fnum, ierrno

    reason = ''
    if (c_fsync(int(fnum(unit), c_int)) == 0) return
    if (any(ierrno() == [input_output, no_space, over_quota])) reason = reason_of(-1_c_int)
  end subroutine synchronise

  !> Remove a file.
  subroutine remove_file(path, reason)
    !> The file
    character(len=*), intent(in) :: path
    !> Why that failed, or ''
    character(len=:), allocatable, intent(out) :: reason
    character(len=:), allocatable, target :: given

    given = to_c(path)
    reason = reason_of(c_unlink(c_loc(given)))
  end subroutine remove_file

  !> Make a new, empty folder for temporary files, in the one that TMPDIR names or in /tmp.
  subroutine make_scratch_folder(folder, reason)
    !> The new folder; where that failed, the one it should have been in
    character(len=:), allocatable, intent(out) :: folder
    !> Why that failed, or ''
    character(len=:), allocatable, intent(out) :: reason
    character(len=:), allocatable, target :: name
    integer :: length

    call get_environment_variable('TMPDIR', length=length)
    allocate (character(len=length) :: folder)
    if (length > 0) call get_environment_variable('TMPDIR', folder)
    if (folder == '') folder = '/tmp'
    name = to_c(folder//'/calor-XXXXXX')
    reason = ''
    if (c_associated(c_mkdtemp(c_loc(name)))) then
      folder = name(:len(name) - 1)
    else
      reason = reason_of(-1_c_int)
    end if
  end subroutine make_scratch_folder

  !> Remove an empty folder.
  subroutine remove_folder(path, reason)
    !> The folder
    character(len=*), intent(in) :: path
    !> Why that failed, or ''
    character(len=:), allocatable, intent(out) :: reason
    character(len=:), allocatable, target :: given

    given = to_c(path)
    reason = reason_of(c_rmdir(c_loc(given)))
  end subroutine remove_folder

  !> Make a new, empty file and find out whether it can grow to some size.
  subroutine try_writing(path, bytes, reason)
    !> The file; one of that name is replaced
    character(len=*), intent(in) :: path
    !> The size
    integer(i8), intent(in) :: bytes
    !> Why that cannot be, or ''
    character(len=:), allocatable, intent(out) :: reason
    character(len=:), allocatable, target :: given
    integer(c_int), parameter :: all_may_read_and_write = int(o'666', c_int)
    integer(c_int) :: descriptor, status

    given = to_c(path)
    descriptor = c_creat(c_loc(given), all_may_read_and_write)
    if (descriptor < 0) then
      reason = reason_of(descriptor)
      return
    end if
    call reserve_space(descriptor, 0_i8, bytes, reason)
    call cut_file(descriptor, 0_i8)
    status = c_close(descriptor)
    if (status /= 0 .and. reason == '') reason = reason_of(status)
  end subroutine try_writing

  !> Reserve room on the disk behind the end of an open file, so that writing there will not fail.
  !>
  !> A file system that cannot reserve is no reason to fail: only a lack of room is.
  subroutine reserve_space(descriptor, offset, bytes, reason)
    !> The system's number of the open file
    integer, intent(in) :: descriptor
    !> Where the room begins
    integer(i8), intent(in) :: offset
    !> How much is needed
    integer(i8), intent(in) :: bytes
    !> Why there is not enough, or ''
    character(len=:), allocatable, intent(out) :: reason
    integer, parameter :: file_too_large = 27, no_space = 28, over_quota = 122
    integer :: code

    reason = ''
    code = c_posix_fallocate(descriptor, offset, bytes)
    select case (code)
    case (file_too_large, no_space, over_quota)
      reason = from_c(c_strerror(int(code, c_int)))
    case default
      return
    end select
  end subroutine reserve_space

  !> Give back the room that was reserved behind the end of an open file.
  subroutine cut_file(descriptor, bytes)
    !> The system's number of the open file
    integer, intent(in) :: descriptor
    !> The size that the file shall have
    integer(i8), intent(in) :: bytes
    integer :: status

    ! If this fails, some room stays reserved, which does no harm.
    status = c_ftruncate(descriptor, bytes)
  end subroutine cut_file

  !> Let writing beyond the system's limit on file sizes fail like any other write.
  !>
  !> Without this the system ends the program by a signal. It concerns the whole process, so a main
  !> program calls it once, and no library procedure does.
  subroutine ignore_file_size_signal()
    integer(c_int), parameter :: file_size_signal = 25_c_int
    integer(c_intptr_t), parameter :: ignore = 1_c_intptr_t
    integer(c_intptr_t) :: old

    old = c_signal(file_size_signal, ignore)
  end subroutine ignore_file_size_signal

  !> The system's text for the error of the call that has just returned `status`, or ''.
  function reason_of(status) result(reason)
    integer(c_int), intent(in) :: status
    character(len=:), allocatable :: reason
    intrinsic :: ierrno

    reason = ''
    if (status /= 0) reason = from_c(c_strerror(int(ierrno(), c_int)))
  end function reason_of

end module calor_file_system
