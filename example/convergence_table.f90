!> How the errors of all derivative schemes fall when a cloud is refined, as Markdown; with the
!> name of a file (.svg or .png) also a picture of it, and with a number after that so many levels
!> of refinement. `calor convergence` says the same on the terminal.
program convergence_table
  use calor, only: convergence_document, convergence_study_t, draw_convergence, error_t, text_t
  implicit none (type, external)
  type(convergence_study_t) :: study
  type(text_t), allocatable :: lines(:)
  type(error_t), allocatable :: error
  character(len=200) :: picture, number
  integer :: k, levels

  call get_command_argument(1, picture)
  call get_command_argument(2, number)
  levels = 5
  if (number /= '') read (number, *) levels
  call study%evaluate(error, levels=levels)
  if (allocated(error)) error stop error%message
  lines = convergence_document(study)
  do k = 1, size(lines)
    print '(a)', lines(k)%value
  end do
  if (picture == '') stop
  call draw_convergence(study, trim(picture), error)
  if (allocated(error)) error stop error%message
end program convergence_table
