!> What each time integrator costs against what was foreseen, on one thread.
!>
!>     stepper_costs        one small plate
!>     stepper_costs all    the table of docs/steppers.md (a minute)
program stepper_costs
  use, intrinsic :: iso_fortran_env, only: output_unit
  use calor, only: error_t
  use calor_stepper_study, only: write_stepper_table
  implicit none (type, external)

  type(error_t), allocatable :: error
  character(len=8) :: word

  word = ''
  call get_command_argument(1, word)
  call write_stepper_table(output_unit, word == 'all', error)
  if (allocated(error)) error stop 1
end program stepper_costs
