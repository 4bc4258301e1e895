!> What every reader and writer of HDF5 files here needs beside HDF5's own interface.
module calor_hdf5
  use, intrinsic :: iso_c_binding, only: c_ptr, c_funptr, c_int, c_int64_t, c_null_ptr, &
                                         c_null_funptr, c_loc, c_funloc, c_f_pointer
  use calor_c_text, only: from_c
  use hdf5, only: hid_t, h5dont_atexit_f, h5open_f, h5iis_valid_f, &
                  h5f_acc_rdonly_f, h5f_close_strong_f, h5fopen_f, h5lexists_f, &
                  h5p_default_f, h5p_file_access_f, h5pclose_f, h5pcreate_f, &
                  h5pset_fclose_degree_f, h5pset_file_locking_f, h5t_native_integer
  implicit none (type, external)
  private

  public :: start_hdf5, open_hdf5_file, hdf5_has, skip_hdf5_cleanup, hdf5_silence_t, hdf5_reason, &
            hdf5_descriptor

  !> HDF5's number for the error stack of the running thread
  integer(c_int64_t), parameter :: default_stack = 0_c_int64_t

  !> Keeps HDF5 from printing its errors between `begin` and `finish`.
  !>
  !> A host program that uses HDF5 itself has its own way of printing back afterwards.
  type :: hdf5_silence_t
    private
    logical :: active = .false.
    type(c_funptr) :: printer = c_null_funptr
    type(c_ptr) :: client = c_null_ptr
  contains
    !> Print nothing from here on
    procedure :: begin => begin_silence
    !> Print again as before
    procedure :: finish => finish_silence
  end type hdf5_silence_t

  !> One entry of the error stack, as HDF5 lays it out
  type, bind(c) :: stack_entry_t
    integer(c_int64_t) :: class_id
    integer(c_int64_t) :: major
    integer(c_int64_t) :: minor
    integer(c_int) :: line
    type(c_ptr) :: procedure_name
    type(c_ptr) :: file_name
    type(c_ptr) :: description
  end type stack_entry_t

  !> What is gathered on the way through the error stack
  type :: account_t
    character(len=:), allocatable :: deepest
    character(len=:), allocatable :: system_reason
  end type account_t

  interface
    function h5eget_auto2(stack, printer, client) result(status) bind(c, name='H5Eget_auto2')
      import :: c_int64_t, c_funptr, c_ptr, c_int
      implicit none (type, external)
      integer(c_int64_t), intent(in), value :: stack
      type(c_funptr), intent(out) :: printer
      type(c_ptr), intent(out) :: client
      integer(c_int) :: status
    end function h5eget_auto2

    function h5eset_auto2(stack, printer, client) result(status) bind(c, name='H5Eset_auto2')
      import :: c_int64_t, c_funptr, c_ptr, c_int
      implicit none (type, external)
      integer(c_int64_t), intent(in), value :: stack
      type(c_funptr), intent(in), value :: printer
      type(c_ptr), intent(in), value :: client
      integer(c_int) :: status
    end function h5eset_auto2

    function h5fget_vfd_handle(file, access, handle) result(status) bind(c, &
                                                                          name='H5Fget_vfd_handle')
      import :: c_int64_t, c_ptr, c_int
      implicit none (type, external)
      integer(c_int64_t), intent(in), value :: file, access
      type(c_ptr), intent(out) :: handle
      integer(c_int) :: status
    end function h5fget_vfd_handle

    function h5ewalk2(stack, direction, visitor, client) result(status) bind(c, name='H5Ewalk2')
      import :: c_int64_t, c_funptr, c_ptr, c_int
      implicit none (type, external)
      integer(c_int64_t), intent(in), value :: stack
      integer(c_int), intent(in), value :: direction
      type(c_funptr), intent(in), value :: visitor
      type(c_ptr), intent(in), value :: client
      integer(c_int) :: status
    end function h5ewalk2
  end interface

contains

  !> Make HDF5's Fortran interface ready for use.
  !>
  !> Opening it a second time would disturb a host program's count of its open objects, so it is
  !> opened only if it is not open; and it is never closed, since that would close the host's files.
  subroutine start_hdf5(status)
    !> Negative if HDF5 cannot be used
    integer, intent(out) :: status
    logical :: open

    call h5iis_valid_f(h5t_native_integer, open, status)
    if (status >= 0 .and. open) return
    call h5open_f(status)
  end subroutine start_hdf5

  !> Open a file for reading.
  subroutine open_hdf5_file(path, file_id, status)
    !> The file
    character(len=*), intent(in) :: path
    !> HDF5's number for it
    integer(hid_t), intent(out) :: file_id
    !> Negative if that fails
    integer, intent(out) :: status
    integer(hid_t) :: access

    call h5pcreate_f(h5p_file_access_f, access, status)
    if (status < 0) return
    ! What an error leaves open must not keep the file open.
    call h5pset_fclose_degree_f(access, h5f_close_strong_f, status)
    if (status < 0) return
    ! Reading needs no lock, and some file systems cannot lock.
    call h5pset_file_locking_f(access, .false., .true., status)
    if (status < 0) return
    call h5fopen_f(path, h5f_acc_rdonly_f, file_id, status, access)
    if (status < 0) return
    call h5pclose_f(access, status)
  end subroutine open_hdf5_file

  !> Whether there is something of that name; HDF5 wants to be asked at every step of the way.
  function hdf5_has(file_id, name)
    !> An open file
    integer(hid_t), intent(in) :: file_id
    !> Groups and name, parted by '/'
    character(len=*), intent(in) :: name
    logical :: hdf5_has
    integer :: slash, step, status

    hdf5_has = .true.
    slash = 1
    do
      step = index(name(slash + 1:), '/')
      if (step == 0) exit
      slash = slash + step
      call h5lexists_f(file_id, name(:slash - 1), hdf5_has, status)
      if (status < 0 .or. .not. hdf5_has) exit
    end do
    if (hdf5_has) call h5lexists_f(file_id, name, hdf5_has, status)
    if (status < 0) hdf5_has = .false.
  end function hdf5_has

  !> Keep HDF5 from cleaning up at the end of the program.
  !>
  !> After it has met a damaged file or a failed write, its clean-up may print or crash. A main
  !> program that closes its files itself calls this once, before HDF5 is used for the first time.
  !> No library procedure does, since a host program may rely on the clean-up.
  subroutine skip_hdf5_cleanup()
    integer :: status

    ! It fails if HDF5 is in use already; then all stays as it is.
    call h5dont_atexit_f(status)
  end subroutine skip_hdf5_cleanup

  subroutine begin_silence(this)
    class(hdf5_silence_t), intent(out) :: this

    if (h5eget_auto2(default_stack, this%printer, this%client) < 0) return
    this%active = h5eset_auto2(default_stack, c_null_funptr, c_null_ptr) >= 0
  end subroutine begin_silence

  subroutine finish_silence(this)
    class(hdf5_silence_t), intent(inout) :: this

    if (.not. this%active) return
    this%active = h5eset_auto2(default_stack, this%printer, this%client) < 0
  end subroutine finish_silence

  !> Why the HDF5 call that has just failed did so, in a few words.
  !>
  !> That is the system's reason where a read or write failed ('No space left on device'), and
  !> otherwise HDF5's innermost description. The next HDF5 call wipes the account that this reads.
  function hdf5_reason(of_the_system) result(reason)
    !> Whether the system failed to read or write
    logical, intent(out), optional :: of_the_system
    character(len=:), allocatable :: reason
    type(account_t), target :: account
    integer(c_int), parameter :: from_the_deepest = 0_c_int

    account%deepest = ''
    account%system_reason = ''
    if (h5ewalk2(default_stack, from_the_deepest, c_funloc(visit), c_loc(account)) < 0) then
      reason = 'HDF5 gives no reason'
    else if (account%system_reason /= '') then
      reason = account%system_reason
    else if (account%deepest /= '') then
      reason = 'HDF5 says: '//account%deepest
    else
      reason = 'HDF5 gives no reason'
    end if
    if (present(of_the_system)) of_the_system = account%system_reason /= ''
  end function hdf5_reason

  !> The system's number of an open HDF5 file that is written by HDF5's standard driver.
  subroutine hdf5_descriptor(file_id, descriptor, status)
    !> The file
    integer(hid_t), intent(in) :: file_id
    !> The system's number
    integer, intent(out) :: descriptor
    !> Negative if there is none
    integer, intent(out) :: status
    integer(c_int), pointer :: number
    type(c_ptr) :: handle

    descriptor = -1
    status = h5fget_vfd_handle(file_id, h5p_default_f, handle)
    if (status < 0) return
    call c_f_pointer(handle, number)
    descriptor = number
  end subroutine hdf5_descriptor

  function visit(depth, entry_address, client) result(status) bind(c)
    integer(c_int), intent(in), value :: depth
    type(c_ptr), intent(in), value :: entry_address
    type(c_ptr), intent(in), value :: client
    integer(c_int) :: status
    character(len=*), parameter :: mark = 'error message = '''
    type(stack_entry_t), pointer :: entry
    type(account_t), pointer :: account
    character(len=:), allocatable :: description
    integer :: start, finish

    status = 0
    call c_f_pointer(entry_address, entry)
    call c_f_pointer(client, account)
    description = from_c(entry%description)
    if (depth == 0) account%deepest = description
    start = index(description, mark)
    if (start == 0 .or. account%system_reason /= '') return
    start = start + len(mark)
    finish = index(description(start:), '''')
    if (finish > 1) account%system_reason = description(start:start + finish - 2)
  end function visit

end module calor_hdf5
