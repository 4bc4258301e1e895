!> Heat radiated to large surroundings and received from them: q = ε σ (T_ambient⁴ - T⁴), in kelvin.
module calor_effect_radiation
  use calor_ambient_exchange, only: ambient_exchange_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: wp
  use calor_medium, only: medium_t
  use calor_scene_file, only: group_t
  use calor_scene_getters, only: place_of
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: radiation_t, stefan_boltzmann

  !> σ, W/(m² K⁴), exact in the International System of Units of 2019
  real(wp), parameter :: stefan_boltzmann = 5.670374419e-8_wp

  !> No surroundings are hotter, K: fourth powers must remain numbers
  real(wp), parameter :: hottest = 1.0e12_wp

  !> The factor is the emissivity ε, from 0 to 1; the temperature of the surroundings is in K
  type, extends(ambient_exchange_t) :: radiation_t
    !> Where the scene says so
    character(len=:), allocatable, private :: place
  contains
    procedure :: read_kind
    procedure :: prepare_kind
    procedure :: find_flux
    procedure :: find_flux_slope
  end type radiation_t

contains

  subroutine read_kind(this, group, error)
    class(radiation_t), intent(inout) :: this
    type(group_t), intent(in) :: group
    type(error_t), allocatable, intent(out) :: error

    call this%read_values(group, 'emissivity', error)
    this%place = place_of(group, 'kind')
  end subroutine read_kind

  subroutine prepare_kind(this, medium, error)
    class(radiation_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    call this%place_values(medium, error, highest_factor=1.0_wp, coldest=0.0_wp, hottest=hottest)
    if (allocated(error)) return
    do k = 1, size(this%temperature)
      if (this%temperature(k) >= 0 .and. this%temperature(k) <= hottest) cycle
      call raise(error, status_bad_input, this%place// &
                 ': radiation takes temperatures in kelvin, from 0 to '//to_text(hottest)//', '// &
                 'but at the start it is '//to_text(this%temperature(k), digits=4)//' at ('// &
                 to_text(this%x(k), digits=6)//', '//to_text(this%y(k), digits=6)// &
                 '): give all temperatures of the scene in kelvin.')
      return
    end do
  end subroutine prepare_kind

  !> Below absolute zero, where only the error of a step can lead, nothing is radiated.
  subroutine find_flux(this, time)
    class(radiation_t), intent(inout) :: this
    real(wp), intent(in) :: time

    call this%update_values(time)
    this%flux = this%factor%value*stefan_boltzmann* &
                (this%ambient%value**4 - max(this%temperature, 0.0_wp)**4)
  end subroutine find_flux

  subroutine find_flux_slope(this, time, slope)
    class(radiation_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(out) :: slope(:)
    real(wp), allocatable :: change(:)

    call this%find_flux(time)
    allocate (change(size(slope)))
    call this%factor%derivative(time, this%temperature, slope)
    call this%ambient%derivative(time, this%temperature, change)
    associate (u => max(this%temperature, 0.0_wp), ambient => this%ambient%value)
      slope = stefan_boltzmann*(slope*(ambient**4 - u**4) + &
                                4*this%factor%value*(ambient**3*change - u**3))
    end associate
  end subroutine find_flux_slope

end module calor_effect_radiation
