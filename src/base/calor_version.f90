!> The version of the library and program.
module calor_version
  implicit none (type, external)
  private

  public :: version

  !> As in fpm.toml; a test compares the two
  character(len=*), parameter :: version = '0.1.0'
end module calor_version
