!> A given heat flux into the body through a wall.
module calor_effect_flux
  use calor_error, only: error_t
  use calor_kinds, only: wp
  use calor_medium, only: medium_t
  use calor_places, only: places_t
  use calor_scene_file, only: group_t
  use calor_varying_value, only: varying_value_t
  use calor_wall_exchange, only: wall_exchange_t, refuse_other_keys
  implicit none (type, external)
  private

  public :: flux_t

  type, extends(wall_exchange_t) :: flux_t
    !> W/m²
    type(varying_value_t) :: given
  contains
    procedure :: read_kind
    procedure :: prepare_kind
    procedure :: find_flux
    procedure :: follow_kind
    procedure :: has_slope
    procedure :: find_flux_slope
    procedure :: is_linear
    procedure :: depends_on_time
    procedure :: expected_rise
  end type flux_t

contains

  subroutine read_kind(this, group, error)
    class(flux_t), intent(inout) :: this
    type(group_t), intent(in) :: group
    type(error_t), allocatable, intent(out) :: error

    call refuse_other_keys(group, ['flux'], error)
    if (allocated(error)) return
    call this%given%read(group, 'flux', error)
  end subroutine read_kind

  subroutine prepare_kind(this, medium, error)
    class(flux_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    type(error_t), allocatable, intent(out) :: error

    call this%given%place_at(this%x, this%y, 0.0_wp, error, this%temperature, &
                             in_motion=medium%in_motion)
    this%bytes = this%bytes + this%given%bytes()
  end subroutine prepare_kind

  subroutine follow_kind(this, places)
    class(flux_t), intent(inout) :: this
    type(places_t), intent(in) :: places

    call this%given%follow(places)
  end subroutine follow_kind

  subroutine find_flux(this, time)
    class(flux_t), intent(inout) :: this
    real(wp), intent(in) :: time

    call this%given%update(time, this%temperature)
    this%flux = this%given%value
  end subroutine find_flux

  pure function has_slope(this) result(answer)
    class(flux_t), intent(in) :: this
    logical :: answer

    answer = this%given%reacts
  end function has_slope

  subroutine find_flux_slope(this, time, slope)
    class(flux_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(out) :: slope(:)

    call this%given%derivative(time, this%temperature, slope)
  end subroutine find_flux_slope

  !> The temperature gradient that carries the flux, over the way that heat comes
  function expected_rise(this, medium) result(rise)
    class(flux_t), intent(in) :: this
    type(medium_t), intent(in) :: medium
    real(wp) :: rise

    rise = 0
    if (size(this%given%value) == 0) return
    rise = maxval(abs(this%given%value))*medium%reach()/medium%conductivity
  end function expected_rise

  pure function is_linear(this) result(answer)
    class(flux_t), intent(in) :: this
    logical :: answer

    answer = .not. this%given%reacts
  end function is_linear

  pure function depends_on_time(this) result(answer)
    class(flux_t), intent(in) :: this
    logical :: answer

    answer = this%given%moves
  end function depends_on_time

end module calor_effect_flux
