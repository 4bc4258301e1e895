!> Heat exchanged with a fluid: q = h (T_ambient - T).
module calor_effect_convection
  use calor_error, only: error_t
  use calor_kinds, only: wp
  use calor_medium, only: medium_t
  use calor_places, only: places_t
  use calor_scene_file, only: group_t
  use calor_varying_value, only: varying_value_t
  use calor_wall_exchange, only: wall_exchange_t, refuse_other_keys
  implicit none (type, external)
  private

  public :: convection_t

  type, extends(wall_exchange_t) :: convection_t
    !> Heat transfer coefficient h, W/(m² K)
    type(varying_value_t) :: coefficient
    !> Temperature of the fluid, and the lowest and highest of it so far
    type(varying_value_t) :: ambient
    real(wp), private :: lowest = huge(1.0_wp), highest = -huge(1.0_wp)
  contains
    procedure :: read_kind
    procedure :: prepare_kind
    procedure :: find_flux
    procedure :: follow_kind
    procedure :: has_slope
    procedure :: find_flux_slope
    procedure :: is_linear
    procedure :: depends_on_time
    procedure :: kept_range
  end type convection_t

contains

  subroutine read_kind(this, group, error)
    class(convection_t), intent(inout) :: this
    type(group_t), intent(in) :: group
    type(error_t), allocatable, intent(out) :: error

    call refuse_other_keys(group, [character(len=11) :: 'coefficient', 'ambient'], error)
    if (allocated(error)) return
    call this%coefficient%read(group, 'coefficient', error)
    if (allocated(error)) return
    call this%ambient%read(group, 'ambient', error)
  end subroutine read_kind

  subroutine prepare_kind(this, medium, error)
    class(convection_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    type(error_t), allocatable, intent(out) :: error

    call this%coefficient%place_at(this%x, this%y, 0.0_wp, error, this%temperature, &
                                   lowest=0.0_wp, in_motion=medium%in_motion)
    if (allocated(error)) return
    call this%ambient%place_at(this%x, this%y, 0.0_wp, error, this%temperature, &
                               in_motion=medium%in_motion)
    if (allocated(error)) return
    this%lowest = minval(this%ambient%value)
    this%highest = maxval(this%ambient%value)
    this%bytes = this%bytes + this%coefficient%bytes() + this%ambient%bytes()
  end subroutine prepare_kind

  subroutine follow_kind(this, places)
    class(convection_t), intent(inout) :: this
    type(places_t), intent(in) :: places

    call this%coefficient%follow(places)
    call this%ambient%follow(places)
  end subroutine follow_kind

  subroutine find_flux(this, time)
    class(convection_t), intent(inout) :: this
    real(wp), intent(in) :: time

    call this%coefficient%update(time, this%temperature)
    call this%ambient%update(time, this%temperature)
    if (this%ambient%moves) then
      this%lowest = min(this%lowest, minval(this%ambient%value))
      this%highest = max(this%highest, maxval(this%ambient%value))
    end if
    this%flux = this%coefficient%value*(this%ambient%value - this%temperature)
  end subroutine find_flux

  pure function has_slope(this) result(answer)
    class(convection_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .true.
  end function has_slope

  subroutine find_flux_slope(this, time, slope)
    class(convection_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(out) :: slope(:)
    real(wp), allocatable :: change(:)

    call this%find_flux(time)
    allocate (change(size(slope)))
    call this%coefficient%derivative(time, this%temperature, slope)
    call this%ambient%derivative(time, this%temperature, change)
    slope = slope*(this%ambient%value - this%temperature) + this%coefficient%value*(change - 1)
  end subroutine find_flux_slope

  subroutine kept_range(this, kept, lowest, highest)
    class(convection_t), intent(in) :: this
    logical, intent(out) :: kept
    real(wp), intent(out) :: lowest, highest

    kept = .not. (this%coefficient%reacts .or. this%ambient%reacts)
    lowest = this%lowest
    highest = this%highest
  end subroutine kept_range

  pure function is_linear(this) result(answer)
    class(convection_t), intent(in) :: this
    logical :: answer

    answer = .not. (this%coefficient%reacts .or. this%ambient%reacts .or. &
                   this%coefficient%moves)
  end function is_linear

  pure function depends_on_time(this) result(answer)
    class(convection_t), intent(in) :: this
    logical :: answer

    answer = this%coefficient%moves .or. this%ambient%moves
  end function depends_on_time

end module calor_effect_convection
