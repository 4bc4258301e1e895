!> Heat set free within the body: sources constant, moving, or depending on the temperature.
module calor_effect_source
  use calor_effect, only: effect_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_expression, only: expression_t
  use calor_kinds, only: wp, ip
  use calor_medium, only: medium_t
  use calor_places, only: places_t
  use calor_scene_file, only: group_t
  use calor_scene_getters, only: get_expression, place_of, raise_at
  use calor_varying_value, only: varying_value_t
  implicit none (type, external)
  private

  public :: source_t

  type, extends(effect_t) :: source_t
    !> The particles within it
    integer(ip), allocatable :: particle(:)
    !> Its power there, W/m³
    type(varying_value_t) :: density
    !> Where it is, in terms of x and y; not compiled: everywhere
    type(expression_t), private :: region
    !> Where the scene says so
    character(len=:), allocatable, private :: place
    !> 1 within the region, 0 outside; allocated only where particles move into it and out of it,
    !> and then all particles are those of the source
    real(wp), allocatable, private :: inside(:)
    type(places_t), private :: places
    !> Temperatures of its particles, where the power depends on them
    real(wp), allocatable, private :: temperature(:)
  contains
    procedure :: read => read_source
    procedure :: prepare
    procedure :: follow
    procedure :: add_power
    procedure :: has_slope
    procedure :: add_slope
    procedure :: is_linear
    procedure :: depends_on_time
    procedure :: expected_rise
    procedure :: operations
  end type source_t

contains

  subroutine read_source(this, group, number, error)
    class(source_t), intent(inout) :: this
    type(group_t), intent(in) :: group
    integer, intent(in) :: number
    type(error_t), allocatable, intent(out) :: error

    associate (unused => number)
    end associate
    call this%density%read(group, 'power', error)
    if (allocated(error)) return
    this%place = place_of(group, '')
    this%reason = place_of(group, 'power')
    if (group%has('power_expression')) this%reason = place_of(group, 'power_expression')
    if (.not. group%has('where_expression')) return
    call get_expression(group, 'where_expression', this%region, error)
    if (allocated(error)) return
    if (this%region%uses('t') .or. this%region%uses('T')) then
      call raise_at(error, group, 'where_expression', 'where a source is may depend on x and y '// &
                    'only; let power_expression be 0 where and while there is none.')
    end if
  end subroutine read_source

  subroutine prepare(this, medium, temperature, error)
    class(source_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    real(wp), intent(in) :: temperature(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: inside(:)
    integer :: k

    allocate (inside(medium%particles()), source=1.0_wp)
    if (this%region%is_compiled()) then
      call this%region%evaluate(medium%x, medium%y, 0.0_wp, values=inside)
    end if
    this%particle = pack([(int(k, ip), k=1, size(inside))], abs(inside) > 0)
    if (medium%in_motion .and. this%region%is_compiled()) then
      this%particle = [(int(k, ip), k=1, size(inside))]
      this%inside = inside
      this%places%x = medium%x
      this%places%y = medium%y
    end if
    if (size(this%particle) == 0 .and. .not. medium%is_part) then
      call raise(error, status_bad_input, this%place//': no particle lies where '// &
                 'where_expression says; widen it, or lower &domain spacing.')
      return
    end if
    call this%density%place_at(medium%x(this%particle), medium%y(this%particle), 0.0_wp, error, &
                               temperature(this%particle), in_motion=medium%in_motion)
    if (allocated(error)) return
    if (this%density%reacts) this%temperature = temperature(this%particle)
    this%bytes = this%density%bytes() + storage_size(this%particle)/8*size(this%particle)
    if (this%density%reacts) then
      this%bytes = this%bytes + storage_size(this%temperature)/8*size(this%temperature)
    end if
  end subroutine prepare

  subroutine add_power(this, medium, time, temperature, power)
    class(source_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    real(wp), intent(in) :: time
    real(wp), intent(in) :: temperature(:)
    real(wp), intent(inout) :: power(:)
    integer :: k

    associate (unused => medium)
    end associate
    this%calls = this%calls + 1
    if (this%density%reacts) then
      this%temperature = temperature(this%particle)
      call this%density%update(time, this%temperature)
    else
      call this%density%update(time, temperature)
    end if
    if (allocated(this%inside)) then
      call this%places%evaluate(this%region, time, this%inside)
      where (abs(this%inside) > 0) this%inside = 1
      do k = 1, size(this%particle)
        power(k) = power(k) + this%inside(k)*this%density%value(k)
      end do
      return
    end if
    do k = 1, size(this%particle)
      power(this%particle(k)) = power(this%particle(k)) + this%density%value(k)
    end do
  end subroutine add_power

  subroutine follow(this, medium, places)
    class(source_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    type(places_t), intent(in) :: places

    associate (unused => medium)
    end associate
    if (allocated(this%inside)) this%places = places
    call this%density%follow(places%some(this%particle))
  end subroutine follow

  pure function has_slope(this) result(answer)
    class(source_t), intent(in) :: this
    logical :: answer

    answer = this%density%reacts
  end function has_slope

  subroutine add_slope(this, medium, time, temperature, slope)
    class(source_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    real(wp), intent(in) :: time
    real(wp), intent(in) :: temperature(:)
    real(wp), intent(inout) :: slope(:)
    real(wp), allocatable :: found(:)

    associate (unused => medium)
    end associate
    this%calls = this%calls + 1
    allocate (found(size(this%particle)))
    call this%density%derivative(time, temperature(this%particle), found)
    if (allocated(this%inside)) then
      call this%places%evaluate(this%region, time, this%inside)
      where (.not. abs(this%inside) > 0) found = 0
    end if
    slope(this%particle) = slope(this%particle) + found
  end subroutine add_slope

  !> What the source would heat in the time, or hold against conduction across the body
  function expected_rise(this, medium) result(rise)
    class(source_t), intent(in) :: this
    type(medium_t), intent(in) :: medium
    real(wp) :: rise

    rise = 0
    if (size(this%density%value) == 0) return
    rise = maxval(abs(this%density%value))*medium%reach()**2/medium%conductivity
  end function expected_rise

  pure function operations(this) result(number)
    class(source_t), intent(in) :: this
    real(wp) :: number

    number = this%density%operations()
  end function operations

  pure function is_linear(this) result(answer)
    class(source_t), intent(in) :: this
    logical :: answer

    answer = .not. this%density%reacts
  end function is_linear

  pure function depends_on_time(this) result(answer)
    class(source_t), intent(in) :: this
    logical :: answer

    answer = this%density%moves
  end function depends_on_time

end module calor_effect_source
