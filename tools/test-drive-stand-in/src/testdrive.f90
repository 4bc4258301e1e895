!> The interface of test-drive, taken from its twin in mctc-lib.
module testdrive
  use mctc_env_testing
  implicit none (type, external)
  public
end module testdrive
