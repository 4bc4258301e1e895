!> An effect of one's own, written outside the library: a body in a wind that cools all of it, as
!> fins do, in proportion to its temperature.
module wind
  use calor, only: effect_t, error_t, group_t, medium_t, wp
  implicit none (type, external)
  private
  public :: wind_t

  type, extends(effect_t) :: wind_t
    real(wp) :: strength = 0.0_wp !! W/(m³ K)
  contains
    procedure :: read => read_nothing
    procedure :: prepare
    procedure :: add_power
  end type wind_t

contains

  subroutine read_nothing(this, group, number, error)
    class(wind_t), intent(inout) :: this
    type(group_t), intent(in) :: group
    integer, intent(in) :: number
    type(error_t), allocatable, intent(out) :: error
  end subroutine read_nothing

  subroutine prepare(this, medium, temperature, error)
    class(wind_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    real(wp), intent(in) :: temperature(:)
    type(error_t), allocatable, intent(out) :: error
  end subroutine prepare

  subroutine add_power(this, medium, time, temperature, power)
    class(wind_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    real(wp), intent(in) :: time, temperature(:)
    real(wp), intent(inout) :: power(:)
    power = power - this%strength*temperature
  end subroutine add_power
end module wind

program own_effect
  use calor, only: effect_slot_t, enter, error_t, interpret_scene, scene_t, simulation_t, wp
  use wind, only: wind_t
  implicit none (type, external)
  type(effect_slot_t), allocatable :: further(:)
  type(error_t), allocatable :: error
  type(scene_t) :: scene
  type(simulation_t) :: simulation

  call interpret_scene('&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.1 / &time end = 1 /'// &
                       '&initial temperature = 1 / &boundary kind = ''insulated'' /', scene, error)
  call enter(further, wind_t('wind', 'cooling by a wind', reason='a program', strength=2.0_wp))
  if (.not. allocated(error)) call simulation%prepare(scene, error, further)
  if (.not. allocated(error)) call simulation%run(error)
  if (allocated(error)) error stop error%message
  print '(a,es10.4)', 'temperature / exp(-2) = ', maxval(simulation%temperature)/exp(-2.0_wp)
end program own_effect
