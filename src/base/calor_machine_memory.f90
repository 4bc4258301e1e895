!> How much memory the machine has to spare.
module calor_machine_memory
  use, intrinsic :: iso_c_binding, only: c_int, c_int64_t
  use calor_kinds, only: i8
  implicit none (type, external)
  private

  public :: available_memory, peak_memory

  !> Linux's number of the limit on a process's address space, and the size of a page, bytes
  integer(c_int), parameter :: address_space = 9_c_int
  integer(i8), parameter :: page = 4096_i8

  interface
    !> The limit in force and the highest that may be set; negative numbers mean that there is none
    function c_getrlimit(resource, limits) result(status) bind(c, name='getrlimit')
      import :: c_int, c_int64_t
      implicit none (type, external)
      integer(c_int), intent(in), value :: resource
      integer(c_int64_t), intent(out) :: limits(2)
      integer(c_int) :: status
    end function c_getrlimit
  end interface

contains

  !> Bytes that can be had without swapping, as far as the system says so; huge where it does not.
  function available_memory() result(bytes)
    integer(i8) :: bytes
    integer(i8) :: limit, used

    bytes = from_meminfo()
    ! A container may have less than its machine.
    limit = number_in('/sys/fs/cgroup/memory.max')
    used = number_in('/sys/fs/cgroup/memory.current')
    if (limit >= 0 .and. used >= 0) bytes = min(bytes, max(0_i8, limit - used))
    bytes = min(bytes, below_own_limit())
  end function available_memory

  !> What the process may still have, where it is limited, as by the shell's `ulimit -v`
  function below_own_limit() result(bytes)
    integer(i8) :: bytes
    integer(c_int64_t) :: limits(2)
    integer(i8) :: pages

    bytes = huge(bytes)
    if (c_getrlimit(address_space, limits) /= 0) return
    if (limits(1) < 0) return
    ! The first number there: all of the process's pages
    pages = number_in('/proc/self/statm')
    bytes = max(0_i8, limits(1) - page*max(0_i8, pages))
  end function below_own_limit

  !> The line 'MemAvailable:  1234 kB' of Linux
  function from_meminfo() result(bytes)
    integer(i8) :: bytes

    bytes = line_of('/proc/meminfo', 'MemAvailable:')
    if (bytes < 0) bytes = huge(bytes)
  end function from_meminfo

  !> The most memory that this process has had so far, bytes; -1 where the system does not tell
  function peak_memory() result(bytes)
    integer(i8) :: bytes

    bytes = line_of('/proc/self/status', 'VmHWM:')
  end function peak_memory

  !> Bytes in a line as 'VmHWM:  1234 kB' of Linux; -1 where there is none
  function line_of(path, mark) result(bytes)
    !> The file, and how the line begins
    character(len=*), intent(in) :: path, mark
    integer(i8) :: bytes
    character(len=120) :: line
    integer(i8) :: kilobytes
    integer :: unit, status

    bytes = -1
    open (newunit=unit, file=path, status='old', action='read', iostat=status)
    if (status /= 0) return
    do
      read (unit, '(a)', iostat=status) line
      if (status /= 0) exit
      if (index(line, mark) /= 1) cycle
      read (line(len(mark) + 1:), *, iostat=status) kilobytes
      if (status == 0) bytes = 1024*kilobytes
      exit
    end do
    close (unit)
  end function line_of

  !> The whole number that a file consists of; -1 if it does not
  function number_in(path) result(number)
    character(len=*), intent(in) :: path
    integer(i8) :: number
    integer :: unit, status

    number = -1
    open (newunit=unit, file=path, status='old', action='read', iostat=status)
    if (status /= 0) return
    read (unit, *, iostat=status) number
    if (status /= 0) number = -1
    close (unit)
  end function number_in

end module calor_machine_memory
