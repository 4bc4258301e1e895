!> Tests of `calor_field_file`.
module test_field_file
  use calor_error, only: error_t
  use calor_field_file, only: field_file_t
  use calor_kinds, only: wp
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private
  public :: collect_field_file
contains
  subroutine collect_field_file(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)
    testsuite = [new_unittest('x', test_x)]
  end subroutine
  subroutine test_x(error)
    type(error_type), allocatable, intent(out) :: error
    type(field_file_t) :: file
    type(error_t), allocatable :: trouble
    real(wp) :: x(5), y(5), t(5)
    integer :: k
    x = [(0.1_wp*k, k=1,5)]
    y = x**2
    call file%create('build/test/a.vtkhdf', x, y, trouble)
    if (allocated(trouble)) print *, trouble%message
    call file%add_static('volume', x*0+0.25_wp, trouble)
    if (allocated(trouble)) print *, trouble%message
    call file%set_attribute('scene', repeat('abc ',30000), trouble)
    do k = 1, 4
      t = k*10 + x
      call file%begin_step(0.5_wp*k, trouble)
      if (allocated(trouble)) print *, trouble%message
      call file%write_field('temperature', t, trouble)
      if (k>2) call file%write_field('late', t, trouble)
      call file%write_field('gradient', t, -t, trouble)
      call file%write_field('steps', [k,k,k,k,k], trouble)
      if (allocated(trouble)) print *, trouble%message
      if (k==2) call file%publish(trouble)
      if (k==2) call file%add_static('wall', [1,0,0,0,1], trouble)
      if (allocated(trouble)) print *, trouble%message
      call file%flush(trouble)
    end do
    call file%close(trouble)
      if (allocated(trouble)) print *, trouble%message
  end subroutine
end module
