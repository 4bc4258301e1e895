!> What cannot be done is said once, by name, with the status that calor has for it.
module test_refusals
  use calor_text, only: to_text
  use test_runs, only: run_and_signal, run_ranks, run_serial, said, write_scene
  use testdrive, only: check, error_type, new_unittest, test_failed, unittest_type
  implicit none (type, external)
  private

  public :: collect_refusals

  integer, parameter :: wide = 100

contains

  subroutine collect_refusals(tests)
    type(unittest_type), allocatable, intent(out) :: tests(:)

    tests = [new_unittest('an expression without a value on one rank', test_no_number), &
             new_unittest('a scene that is wrong', test_wrong), &
             new_unittest('a wrong line far down in a cloud''s file', test_wrong_line), &
             new_unittest('a check runs nothing', test_check), &
             new_unittest('a run without a step loses no file', test_kept), &
             new_unittest('PETSc''s failure ends the run', test_solver)]
  end subroutine collect_refusals

  !> A scene with further lines is refused, with some words, once.
  subroutine refuse(name, line, words, error)
    character(len=*), intent(in) :: name, line, words
    type(error_type), allocatable, intent(out) :: error
    integer :: status

    call write_scene(name, [character(len=wide) :: &
                            '&domain shape=''rectangle'' x_range=0,1 y_range=0,1 spacing=0.1 /', &
                            '&boundary on=''all'' kind=''temperature'' value=0 /', line])
    call run_ranks(name, 3, status)
    if (status /= 2) then
      call test_failed(error, name//': status '//to_text(status)//', not 2')
    else if (said(name, words) /= 1) then
      call test_failed(error, name//': '''//words//''' was said '//to_text(said(name, words))// &
                       ' times')
    end if
  end subroutine refuse

  subroutine test_no_number(error)
    type(error_type), allocatable, intent(out) :: error

    call refuse('nonumber', '&initial temperature_expression=''sqrt(0.95-x)'' / &time end=1 /', &
                'gives no number', error)
  end subroutine test_no_number

  subroutine test_wrong(error)
    type(error_type), allocatable, intent(out) :: error

    call refuse('wrong', '&initial temperatur=1 /', 'Did you mean', error)
  end subroutine test_wrong

  !> A rank that reads the end of a file counts its lines as if it had read all.
  subroutine test_wrong_line(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: status, unit, k

    open (newunit=unit, file='wrong.csv', action='write', status='replace')
    write (unit, '(a)') 'x,y,volume,wall'
    do k = 1, 100
      if (k == 90) then
        write (unit, '(a)') '1,2,-1,0'
      else
        write (unit, '(i0,a)') k, ',0,1,0'
      end if
    end do
    close (unit)
    call write_scene('wrongline', [character(len=wide) :: &
                                   '&domain shape=''cloud'' file=''wrong.csv'' /', &
                                   '&boundary on=''all'' kind=''temperature'' value=0 /', &
                                   '&time end=1 /'])
    call run_ranks('wrongline', 3, status)
    call check(error, status, 2)
    if (allocated(error)) return
    call check(error, said('wrongline', 'line 91: column ''volume'': ''-1'' cannot be'), 1)
  end subroutine test_wrong_line

  subroutine test_check(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: status
    logical :: there

    call write_scene('checked', [character(len=wide) :: &
                                 '&domain shape=''rectangle'' x_range=0,1 y_range=0,1', &
                                 '  spacing=0.05 /', &
                                 '&boundary on=''all'' kind=''temperature'' value=0 /', &
                                 '&output file=''checked.vtkhdf'' / &time end=1 /'])
    call run_ranks('checked', 2, status, command='check')
    call check(error, status, 0)
    if (allocated(error)) return
    call check(error, said('checked', 'Ranks        2, each with'), 1)
    if (allocated(error)) return
    inquire (file='checked.vtkhdf', exist=there)
    call check(error,.not. there)
  end subroutine test_check

  !> The file of before is there after a run that fails in its first step, and after one that is
  !> killed before its second state; calor does the same.
  subroutine test_kept(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: status

    call write_scene('kept', [character(len=wide) :: &
                              '&domain shape=''rectangle'' x_range=0,1 y_range=0,1', &
                              '  spacing=0.05 /', &
                              '&initial temperature=1 /', &
                              '&boundary on=''all'' kind=''temperature''', &
                              '  value_expression=''1+sqrt(-t)'' /', &
                              '&output file=''kept.vtkhdf'' every=0.1 / &time end=1 /'])
    call execute_command_line('echo precious >kept.vtkhdf')
    call run_serial('kept', status)
    call check(error, status, 3, 'calor')
    if (allocated(error)) return
    call execute_command_line('test "$(cat kept.vtkhdf)" = precious', exitstat=status)
    call check(error, status, 0, 'calor has lost the file')
    if (allocated(error)) return
    call run_ranks('kept', 3, status)
    call check(error, status, 3)
    if (allocated(error)) return
    call check(error, said('kept', 'are no numbers any more'), 1)
    if (allocated(error)) return
    call execute_command_line('test "$(cat kept.vtkhdf)" = precious -a "$(ls kept.vtkhdf*)" = '// &
                              'kept.vtkhdf', exitstat=status)
    call check(error, status, 0, 'the file is lost')
    if (allocated(error)) return
    call write_scene('kept', [character(len=wide) :: &
                              '&domain shape=''rectangle'' x_range=0,1 y_range=0,1', &
                              '  spacing=0.02 /', &
                              '&boundary on=''all'' kind=''temperature'' value=0 /', &
                              '&output file=''kept.vtkhdf'' /', &
                              '&time end=1000 step=1e-5 method=''forward_euler'' /'])
    call run_and_signal('kept', 2, 'KILL', 'kept.vtkhdf.partial', status)
    call check(error, status, 137)
    if (allocated(error)) return
    call execute_command_line('test "$(cat kept.vtkhdf)" = precious', exitstat=status)
    call check(error, status, 0, 'the file is lost by the kill')
  end subroutine test_kept

  !> What PETSc cannot do is said once.
  subroutine test_solver(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: status

    call write_scene('solver', [character(len=wide) :: &
                                '&domain shape=''rectangle'' x_range=0,1 y_range=0,1', &
                                '  spacing=0.05 /', &
                                '&boundary on=''all'' kind=''temperature'' value=0 /', &
                                '&time steady=.true. /'])
    call run_ranks('solver', 2, status, options='-ksp_type nonsense')
    call check(error, status, 3)
    if (allocated(error)) return
    call check(error, said('solver', 'calor-mpi: PETSc could not go on in KSPSetType: '// &
                           'Unable to find requested KSP type nonsense'), 1)
  end subroutine test_solver

end module test_refusals
