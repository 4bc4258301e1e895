!> Melting and freezing: heat that changes the phase and not the temperature.
!>
!> It sets no heat free: it is a part of what the heat content of its material is, see
!> calor_heat_law.
module calor_effect_melting
  use calor_effect, only: effect_t
  use calor_error, only: error_t
  use calor_kinds, only: wp
  use calor_medium, only: medium_t
  use calor_scene_file, only: group_t
  use calor_scene_getters, only: get, place_of, raise_at
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: melting_t

  type, extends(effect_t) :: melting_t
    !> Its number among the groups &material
    integer :: material = 0
    !> Where melting begins and where it is complete; equal for a pure substance
    real(wp) :: solidus = 0.0_wp, liquidus = 0.0_wp
    !> J/kg
    real(wp) :: latent_heat = 0.0_wp
    !> Latent heat over heat capacity, K
    real(wp) :: rise = 0.0_wp
  contains
    procedure :: read => read_melting
    procedure :: prepare
    procedure :: add_power
    procedure :: expected_rise
    procedure :: kept_range
    procedure :: account
    procedure :: brings_nothing
  end type melting_t

contains

  subroutine read_melting(this, group, number, error)
    class(melting_t), intent(inout) :: this
    type(group_t), intent(in) :: group
    integer, intent(in) :: number
    type(error_t), allocatable, intent(out) :: error

    this%material = number
    call get(group, 'latent_heat', this%latent_heat, error, non_negative=.true.)
    if (allocated(error)) return
    call get(group, 'solidus', this%solidus, error)
    if (allocated(error)) return
    call get(group, 'liquidus', this%liquidus, error)
    if (allocated(error)) return
    if (this%solidus > this%liquidus) then
      call raise_at(error, group, 'solidus', 'melting begins at the solidus, '// &
                    to_text(this%solidus)//', and is complete at the liquidus, '// &
                    to_text(this%liquidus)//': lower solidus or raise liquidus; they may be equal.')
      return
    end if
    this%reason = this%reason//', solidus '//to_text(this%solidus)//', liquidus '// &
                  to_text(this%liquidus)
  end subroutine read_melting

  !> What melting takes are the temperatures beside the heat contents, which are the unknowns.
  subroutine prepare(this, medium, temperature, error)
    class(melting_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    real(wp), intent(in) :: temperature(:)
    type(error_t), allocatable, intent(out) :: error

    associate (unused => error, also => temperature)
    end associate
    this%bytes = 2*(storage_size(this%rise)/8)*medium%particles()
  end subroutine prepare

  !> None: heat is stored, not set free.
  subroutine add_power(this, medium, time, temperature, power)
    class(melting_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    real(wp), intent(in) :: time
    real(wp), intent(in) :: temperature(:)
    real(wp), intent(inout) :: power(:)

    associate (unused => medium, also => time, and => temperature, too => power)
    end associate
    this%calls = this%calls + 1
  end subroutine add_power

  pure function brings_nothing(this) result(answer)
    class(melting_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .true.
  end function brings_nothing

  !> Heat contents differ by it where temperatures do not.
  function expected_rise(this, medium) result(rise)
    class(melting_t), intent(in) :: this
    type(medium_t), intent(in) :: medium
    real(wp) :: rise

    associate (unused => medium)
    end associate
    rise = this%rise
  end function expected_rise

  subroutine kept_range(this, kept, lowest, highest)
    class(melting_t), intent(in) :: this
    logical, intent(out) :: kept
    real(wp), intent(out) :: lowest, highest

    associate (unused => this)
    end associate
    kept = .true.
    lowest = huge(1.0_wp)
    highest = -huge(1.0_wp)
  end subroutine kept_range

  !> It has no entry of its own in the heat budget: it is in what is stored.
  pure function account(this) result(name)
    class(melting_t), intent(in) :: this
    character(len=:), allocatable :: name

    associate (unused => this)
    end associate
    name = ''
  end function account

end module calor_effect_melting
