!> Runs the scenes of data/verification on lattices and on irregular clouds, and prints what is
!> known and what was found as a Markdown table.
!> The status is 1 where anything is beyond its tolerance.
program verification_table
  use calor, only: error_t, run_case, verification_cases, wp
  implicit none (type, external)
  type(error_t), allocatable :: error
  real(wp) :: found(2)
  logical :: passed
  integer :: k, cloud

  passed = .true.
  print '(a)', '| scene | quantity | expected | tolerance | lattice | irregular |'
  print '(a)', '|---|---|---|---|---|---|'
  do k = 1, size(verification_cases)
    associate (this => verification_cases(k))
      do cloud = 1, 2
        call run_case(this, cloud == 2, found(cloud), error)
        if (allocated(error)) then
          print '(a)', error%message
          error stop 1
        end if
        if (.not. abs(found(cloud) - this%expected) <= this%tolerance) passed = .false.
      end do
      print '(5a,4(g0.5,a))', '| ', trim(this%file), ' | ', trim(this%meaning), ' | ', &
        this%expected, ' | ', this%tolerance, ' | ', found(1), ' | ', found(2), ' |'
    end associate
  end do
  if (.not. passed) error stop 1
end program verification_table
