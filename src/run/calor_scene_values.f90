!> Values that a scene's expressions give on its cloud.
module calor_scene_values
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_expression, only: expression_t, compile_expression
  use calor_kinds, only: wp
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: field_values, check_values

contains

  !> The values of an expression at all particles of a cloud, at time 0.
  subroutine field_values(text, place, cloud, values, error)
    !> The expression, and where the scene has it
    character(len=*), intent(in) :: text, place
    !> The cloud
    type(cloud_t), intent(in) :: cloud
    !> The values in the cloud's order
    real(wp), allocatable, intent(out) :: values(:)
    !> The expression is wrong, or gives no number somewhere
    type(error_t), allocatable, intent(out) :: error
    type(expression_t) :: expression

    call compile_expression(text, expression, error)
    if (allocated(error)) return
    allocate (values(cloud%particles()))
    call expression%evaluate(cloud%x, cloud%y, 0.0_wp, values=values)
    call check_values(text, place, values, cloud%x, cloud%y, error)
  end subroutine field_values

  !> An expression must give a number everywhere.
  subroutine check_values(expression, place, values, x, y, error)
    !> The expression, and where the scene has it
    character(len=*), intent(in) :: expression, place
    !> Its values, and the places they belong to, m
    real(wp), intent(in) :: values(:), x(:), y(:)
    !> A value is no number or infinite
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    do k = 1, size(values)
      if (ieee_is_finite(values(k))) cycle
      call raise(error, status_bad_input, place//': the expression '''//expression// &
                 ''' gives no number at ('//to_text(x(k), digits=6)//', '// &
                 to_text(y(k), digits=6)//'): give one that does wherever there are particles.')
      return
    end do
  end subroutine check_values

end module calor_scene_values
