!> Rectangles with sides along the axes.
module calor_rectangle_body
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_body, only: body_t, edge_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: wp, ip
  use calor_text, only: text_list, to_text
  implicit none (type, external)
  private

  public :: make_rectangle_body

contains

  !> A rectangle, whose boundaries are 'left', 'right', 'bottom' and 'top'.
  pure subroutine make_rectangle_body(x_range, y_range, body, error)
    !> Left and right, bottom and top edge, m
    real(wp), intent(in) :: x_range(2), y_range(2)
    !> The rectangle
    type(body_t), intent(out) :: body
    !> A range is none
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: corner(2, 4)

    call check_range('x_range', x_range, error)
    if (.not. allocated(error)) call check_range('y_range', y_range, error)
    if (allocated(error)) return
    corner = reshape([x_range(1), y_range(1), x_range(2), y_range(1), x_range(2), y_range(2), &
                      x_range(1), y_range(2)], [2, 4])
    body%edge = [edge_t(start=corner(:, 1), finish=corner(:, 2), side=ibset(0_ip, 2)), &
                 edge_t(start=corner(:, 2), finish=corner(:, 3), side=ibset(0_ip, 1)), &
                 edge_t(start=corner(:, 3), finish=corner(:, 4), side=ibset(0_ip, 3)), &
                 edge_t(start=corner(:, 4), finish=corner(:, 1), side=ibset(0_ip, 0))]
    body%first = [1, 5]
    body%boundary = text_list([character(len=6) :: 'left', 'right', 'bottom', 'top'])
    body%shape = 'rectangle'
  end subroutine make_rectangle_body

  pure subroutine check_range(name, range, error)
    character(len=*), intent(in) :: name
    real(wp), intent(in) :: range(2)
    type(error_t), allocatable, intent(out) :: error

    ! One after another: a comparison with NaN is itself a floating-point exception
    if (all(ieee_is_finite(range))) then
      if (range(1) < range(2)) return
      call raise(error, status_bad_input, name//' = '//to_text(range(1))//', '// &
                 to_text(range(2))//' is not a range: the first number must be the smaller one.')
    else
      call raise(error, status_bad_input, name//' must be two ordinary numbers.')
    end if
  end subroutine check_range

end module calor_rectangle_body
