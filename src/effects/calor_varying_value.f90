!> A quantity that a scene gives as a number or as an expression, at some particles.
module calor_varying_value
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_error, only: error_t, raise, status_bad_input
  use calor_expression, only: expression_t
  use calor_kinds, only: wp, i8
  use calor_places, only: places_t
  use calor_scene_file, only: group_t
  use calor_scene_getters, only: get_varying, place_of
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: varying_value_t

  !> A quantity of x, y, t and T
  type :: varying_value_t
    !> Its values at the particles
    real(wp), allocatable :: value(:)
    !> Whether they change with time, be it because particles move, and with the temperature
    logical :: moves = .false., reacts = .false.
    !> The expression; after `place_at` allocated only where values change
    type(expression_t), allocatable, private :: expression
    !> Places of the particles; allocated only where values change
    type(places_t), allocatable, private :: places
    !> Where the scene says so, and the expression
    character(len=:), allocatable, private :: place, source
  contains
    !> Read `key` or `key_expression` of a group
    procedure :: read => read_value
    !> Evaluate it at particles for the first time
    procedure :: place_at
    !> Take the paths of particles that move, other ones perhaps than before
    procedure :: follow
    !> Bring the values to a time and to temperatures
    procedure :: update
    !> The derivative of the values with respect to the temperature
    procedure :: derivative
    !> What it takes to bring the values to another time, in operators of expressions
    procedure :: operations
    !> What its arrays take, bytes
    procedure :: bytes
  end type varying_value_t

contains

  subroutine read_value(this, group, key, error, default)
    class(varying_value_t), intent(inout) :: this
    !> The group
    type(group_t), intent(in) :: group
    !> The key, without `_expression`
    character(len=*), intent(in) :: key
    !> It is missing or wrong
    type(error_t), allocatable, intent(out) :: error
    !> The value if neither key is given
    real(wp), intent(in), optional :: default

    allocate (this%expression)
    call get_varying(group, key, this%expression, error, default)
    if (allocated(error)) return
    this%place = place_of(group, key)
    if (group%has(key//'_expression')) this%place = place_of(group, key//'_expression')
    this%source = this%expression%source()
    this%moves = this%expression%uses('t')
    this%reacts = this%expression%uses('T')
  end subroutine read_value

  subroutine place_at(this, x, y, time, error, temperature, lowest, highest, in_motion)
    class(varying_value_t), intent(inout) :: this
    !> Coordinates of the particles, m
    real(wp), intent(in) :: x(:), y(:)
    !> Time, s
    real(wp), intent(in) :: time
    !> A value is no number, or out of its bounds
    type(error_t), allocatable, intent(out) :: error
    !> Temperatures of the particles; 0 without them
    real(wp), intent(in), optional :: temperature(:)
    !> Bounds of the values
    real(wp), intent(in), optional :: lowest, highest
    !> Whether particles move, so that values that depend on the place change with time
    logical, intent(in), optional :: in_motion
    character(len=:), allocatable :: what
    integer :: k

    allocate (this%value(size(x)))
    call this%expression%evaluate(x, y, time, values=this%value, temperature=temperature)
    do k = 1, size(x)
      what = ''
      if (.not. ieee_is_finite(this%value(k))) then
        what = 'gives no number'
      else
        if (present(lowest)) then
          if (this%value(k) < lowest) what = 'gives '//to_text(this%value(k), digits=6)// &
                                             ', less than '//to_text(lowest)//','
        end if
        if (present(highest)) then
          if (this%value(k) > highest) what = 'gives '//to_text(this%value(k), digits=6)// &
                                              ', more than '//to_text(highest)//','
        end if
      end if
      if (what == '') cycle
      call raise(error, status_bad_input, this%place//': '''//this%source//''' '//what//' at ('// &
                 to_text(x(k), digits=6)//', '//to_text(y(k), digits=6)//').')
      return
    end do
    if (present(in_motion)) then
      if (in_motion) then
        this%moves = this%moves .or. this%expression%uses('x') .or. this%expression%uses('y')
      end if
    end if
    if (this%moves .or. this%reacts) then
      allocate (this%places)
      this%places%x = x
      this%places%y = y
    else
      deallocate (this%expression)
    end if
  end subroutine place_at

  subroutine follow(this, places)
    class(varying_value_t), intent(inout) :: this
    !> Where its particles will be
    type(places_t), intent(in) :: places

    if (allocated(this%places)) this%places = places
  end subroutine follow

  subroutine update(this, time, temperature)
    class(varying_value_t), intent(inout) :: this
    !> Time, s
    real(wp), intent(in) :: time
    !> Temperatures of the particles
    real(wp), intent(in) :: temperature(:)

    if (this%reacts) then
      call this%places%evaluate(this%expression, time, this%value, temperature)
    else if (this%moves) then
      call this%places%evaluate(this%expression, time, this%value)
    end if
  end subroutine update

  !> By a central difference: an expression has no other derivative.
  subroutine derivative(this, time, temperature, slope)
    class(varying_value_t), intent(inout) :: this
    !> Time, s
    real(wp), intent(in) :: time
    !> Temperatures of the particles
    real(wp), intent(in) :: temperature(:)
    !> The derivative
    real(wp), intent(out) :: slope(:)
    real(wp), allocatable :: change(:), below(:)

    slope = 0
    if (.not. this%reacts) return
    change = 1.0e-5_wp*max(1.0_wp, abs(temperature))
    allocate (below(size(temperature)))
    call this%places%evaluate(this%expression, time, slope, temperature + change)
    call this%places%evaluate(this%expression, time, below, temperature - change)
    slope = (slope - below)/(2*change)
  end subroutine derivative

  pure function operations(this) result(number)
    class(varying_value_t), intent(in) :: this
    real(wp) :: number

    number = 0
    if (.not. (this%moves .or. this%reacts)) return
    if (allocated(this%expression)) then
      number = real(size(this%value), wp)*this%expression%operations()
    end if
  end function operations

  pure function bytes(this) result(number)
    class(varying_value_t), intent(in) :: this
    integer(i8) :: number

    number = 0
    if (allocated(this%value)) number = number + storage_size(this%value)/8*size(this%value)
    if (allocated(this%places)) number = number + this%places%bytes()
  end function bytes

end module calor_varying_value
