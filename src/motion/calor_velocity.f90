!> A given velocity field.
module calor_velocity
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
  use calor_constants, only: worth_threads
  use calor_error, only: error_t
  use calor_expression, only: expression_t
  use calor_kinds, only: wp, i8
  use calor_scene_file, only: group_t
  use calor_scene_getters, only: get_varying, place_of, raise_at
  use omp_lib, only: omp_get_max_threads
  implicit none (type, external)
  private

  public :: velocity_t

  !> A velocity in terms of x, y and t
  type :: velocity_t
    type(expression_t), private :: x, y
    !> Where the scene gives it
    character(len=:), allocatable :: place
  contains
    !> Read it from a group &motion
    procedure :: read => read_velocity
    !> Both components at some places
    procedure :: at
    !> Its divergence there, from differences
    procedure :: find_divergence
    !> Whether it changes with time
    procedure :: is_unsteady
  end type velocity_t

contains

  subroutine read_velocity(this, group, error)
    class(velocity_t), intent(inout) :: this
    !> The group
    type(group_t), intent(in) :: group
    !> It gives no velocity, or one that depends on the temperature
    type(error_t), allocatable, intent(out) :: error
    character(len=*), parameter :: keys(4) = [character(len=21) :: 'velocity_x', &
        'velocity_x_expression', 'velocity_y', 'velocity_y_expression']
    integer :: k

    this%place = ''
    do k = size(keys), 1, -1
      if (group%has(trim(keys(k)))) this%place = place_of(group, trim(keys(k)))
    end do
    if (this%place == '') then
      call raise_at(error, group, '', 'the velocity is missing: give velocity_x_expression and '// &
                    'velocity_y_expression in terms of x, y and t, or velocity_x and '// &
                    'velocity_y as numbers.')
      return
    end if
    call get_varying(group, 'velocity_x', this%x, error, default=0.0_wp)
    if (allocated(error)) return
    call get_varying(group, 'velocity_y', this%y, error, default=0.0_wp)
    if (allocated(error)) return
    if (this%x%uses('T')) then
      call raise_at(error, group, 'velocity_x_expression', 'it may depend on x, y and t only.')
    else if (this%y%uses('T')) then
      call raise_at(error, group, 'velocity_y_expression', 'it may depend on x, y and t only.')
    end if
  end subroutine read_velocity

  subroutine at(this, x, y, time, velocity_x, velocity_y)
    class(velocity_t), intent(inout) :: this
    !> Places, m, and time, s
    real(wp), intent(in) :: x(:), y(:), time
    !> m/s; NaN where there is no number
    real(wp), intent(out) :: velocity_x(:), velocity_y(:)

    call evaluate(this%x, x, y, time, velocity_x)
    call evaluate(this%y, x, y, time, velocity_y)
    ! A difference of infinite values would raise an exception; NaN stays NaN.
    where (.not. ieee_is_finite(velocity_x)) velocity_x = ieee_value(0.0_wp, ieee_quiet_nan)
    where (.not. ieee_is_finite(velocity_y)) velocity_y = ieee_value(0.0_wp, ieee_quiet_nan)
  end subroutine at

  subroutine find_divergence(this, x, y, time, distance, divergence, derivative)
    class(velocity_t), intent(inout) :: this
    !> Places, m, and time, s
    real(wp), intent(in) :: x(:), y(:), time
    !> Differences are taken over this distance on both sides, m
    real(wp), intent(in) :: distance
    !> d/dx velocity_x + d/dy velocity_y, 1/s; no number where one beside a place is none
    real(wp), intent(out) :: divergence(:)
    !> The first of the two terms, 1/s
    real(wp), intent(out) :: derivative(:)
    real(wp), allocatable :: ahead(:), behind(:)

    allocate (ahead(size(x)), behind(size(x)))
    call evaluate(this%x, x + distance, y, time, ahead)
    call evaluate(this%x, x - distance, y, time, behind)
    derivative = (ahead - behind)/(2*distance)
    call evaluate(this%y, x, y + distance, time, ahead)
    call evaluate(this%y, x, y - distance, time, behind)
    divergence = derivative + (ahead - behind)/(2*distance)
  end subroutine find_divergence

  !> Of many places each thread takes a part.
  subroutine evaluate(expression, x, y, time, values)
    type(expression_t), intent(inout) :: expression
    real(wp), intent(in) :: x(:), y(:), time
    real(wp), intent(out) :: values(:)
    integer :: block, blocks, from, to

    blocks = omp_get_max_threads()
    if (size(x) <= worth_threads .or. blocks == 1) then
      call expression%evaluate(x, y, time, values=values)
      return
    end if
    !$omp parallel do schedule(static) default(shared) private(block, from, to)
    do block = 1, blocks
      from = int(size(x, kind=i8)*(block - 1)/blocks) + 1
      to = int(size(x, kind=i8)*block/blocks)
      call evaluate_copy(expression, x(from:to), y(from:to), time, values(from:to))
    end do
    !$omp end parallel do
  end subroutine evaluate

  !> Each thread needs an expression of its own.
  subroutine evaluate_copy(expression, x, y, time, values)
    type(expression_t), intent(in) :: expression
    real(wp), intent(in) :: x(:), y(:), time
    real(wp), intent(out) :: values(:)
    type(expression_t) :: own

    own = expression
    call own%evaluate(x, y, time, values=values)
  end subroutine evaluate_copy

  pure function is_unsteady(this) result(answer)
    class(velocity_t), intent(in) :: this
    logical :: answer

    answer = this%x%uses('t') .or. this%y%uses('t')
  end function is_unsteady

end module calor_velocity
