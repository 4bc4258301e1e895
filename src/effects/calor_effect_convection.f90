!> Heat exchanged with a fluid: q = h (T_ambient - T).
module calor_effect_convection
  use calor_ambient_exchange, only: ambient_exchange_t
  use calor_error, only: error_t
  use calor_kinds, only: wp
  use calor_medium, only: medium_t
  use calor_scene_file, only: group_t
  implicit none (type, external)
  private

  public :: convection_t

  !> The factor is the heat transfer coefficient h, W/(m² K)
  type, extends(ambient_exchange_t) :: convection_t
  contains
    procedure :: read_kind
    procedure :: prepare_kind
    procedure :: find_flux
    procedure :: find_flux_slope
    procedure :: is_linear
  end type convection_t

contains

  subroutine read_kind(this, group, error)
    class(convection_t), intent(inout) :: this
    type(group_t), intent(in) :: group
    type(error_t), allocatable, intent(out) :: error

    call this%read_values(group, 'coefficient', error)
  end subroutine read_kind

  subroutine prepare_kind(this, medium, error)
    class(convection_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    type(error_t), allocatable, intent(out) :: error

    call this%place_values(medium, error)
  end subroutine prepare_kind

  subroutine find_flux(this, time)
    class(convection_t), intent(inout) :: this
    real(wp), intent(in) :: time

    call this%update_values(time)
    this%flux = this%factor%value*(this%ambient%value - this%temperature)
  end subroutine find_flux

  subroutine find_flux_slope(this, time, slope)
    class(convection_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(out) :: slope(:)
    real(wp), allocatable :: change(:)

    call this%find_flux(time)
    allocate (change(size(slope)))
    call this%factor%derivative(time, this%temperature, slope)
    call this%ambient%derivative(time, this%temperature, change)
    slope = slope*(this%ambient%value - this%temperature) + this%factor%value*(change - 1)
  end subroutine find_flux_slope

  pure function is_linear(this) result(answer)
    class(convection_t), intent(in) :: this
    logical :: answer

    answer = .not. (this%factor%reacts .or. this%ambient%reacts .or. this%factor%moves)
  end function is_linear

end module calor_effect_convection
