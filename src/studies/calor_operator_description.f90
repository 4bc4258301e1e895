!> What an operator study found, in plain words.
module calor_operator_description
  use calor_kinds, only: wp
  use calor_operator_study, only: operator_study_t, derivative_t
  use calor_text, only: text_t, to_text
  implicit none (type, external)
  private

  public :: describe_derivatives

contains

  !> A table of all derivatives: range of values, and errors where the true derivative is given.
  function describe_derivatives(study) result(lines)
    !> A study after `evaluate`
    type(operator_study_t), intent(in) :: study
    type(text_t), allocatable :: lines(:)
    integer :: k

    allocate (lines(4 + size(study%derivatives)))
    lines(1)%value = to_text(study%cloud%particles())//' particles, '//to_text(study%inside)// &
                     ' of them inside, '//to_text(study%whole)//' with no wall in their support'
    lines(2)%value = 'Relative L2 error over those:'
    lines(3)%value = column('scheme', 36)//column('inside', 12)//column('no wall', 12)// &
                     'values inside'
    do k = 1, size(study%derivatives)
      lines(3 + k)%value = describe(study, study%derivatives(k))
    end do
    associate (last => lines(size(lines)))
      last%value = 'Nothing was written: &operators has no file.'
      if (study%scene%operators%file /= '') then
        last%value = 'Written to '//study%scene%operators%file//'.'
      end if
    end associate
  end function describe_derivatives

  function describe(study, derivative) result(line)
    type(operator_study_t), intent(in) :: study
    type(derivative_t), intent(in) :: derivative
    character(len=:), allocatable :: line
    logical, allocatable :: inside(:, :)

    line = column(derivative%name, 36)//column(error_text(derivative%error_inside), 12)// &
           column(error_text(derivative%error_whole), 12)
    inside = spread(study%cloud%side == 0, 2, size(derivative%values, 2))
    if (any(inside)) then
      line = line//to_text(minval(derivative%values, inside), digits=4)//' to '// &
             to_text(maxval(derivative%values, inside), digits=4)
    end if
  end function describe

  pure function error_text(deviation) result(text)
    real(wp), intent(in) :: deviation
    character(len=:), allocatable :: text

    text = 'not known'
    if (deviation >= 0) text = to_text(deviation, digits=3)
  end function error_text

  pure function column(text, width) result(padded)
    character(len=*), intent(in) :: text
    integer, intent(in) :: width
    character(len=max(width, len(text) + 1)) :: padded

    padded = text
  end function column

end module calor_operator_description
