!> Melting and freezing: heat that changes the phase and not the temperature.
!>
!> The unknown is the enthalpy H, J/m³, in units of ρc: the heat content v = H/(ρc), K, which is the
!> temperature of a solid and L/c beyond it of a liquid. Between solidus and liquidus the liquid
!> fraction f grows in proportion to the heat: v = T + f L/c. From v_t = κ/(ρc) ∇²T(v), summed over
!> the particles, no heat is lost, however long the steps. T(v) is piecewise linear with slopes from
!> 0 to 1, so that no step which is stable for conduction alone is unstable with it.
!>
!> Source: V. Alexiades, A.D. Solomon, Mathematical Modeling of Melting and Freezing Processes,
!> Hemisphere 1993, chapter 4.
module calor_effect_melting
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_constants, only: worth_threads
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
    !> Where melting begins and where it is complete; equal for a pure substance
    real(wp) :: solidus = 0.0_wp, liquidus = 0.0_wp
    !> Latent heat over heat capacity, K
    real(wp) :: rise = 0.0_wp
  contains
    procedure :: read => read_melting
    procedure :: prepare
    procedure :: add_power
    procedure :: expected_rise
    procedure :: kept_range
    procedure :: account
    procedure :: maps_state
    procedure :: find_temperature
    procedure :: find_state
    procedure :: find_liquid_fraction
  end type melting_t

contains

  subroutine read_melting(this, group, number, error)
    class(melting_t), intent(inout) :: this
    type(group_t), intent(in) :: group
    integer, intent(in) :: number
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: latent_heat, heat_capacity

    associate (unused => number)
    end associate
    this%reason = place_of(group, 'latent_heat')
    call get(group, 'latent_heat', latent_heat, error, non_negative=.true.)
    if (allocated(error)) return
    call get(group, 'heat_capacity', heat_capacity, error, default=1.0_wp, positive=.true.)
    if (allocated(error)) return
    this%rise = latent_heat/heat_capacity
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

    associate (unused => this, also => medium, and => time, too => temperature, or => power)
    end associate
  end subroutine add_power

  pure function maps_state(this) result(answer)
    class(melting_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .true.
  end function maps_state

  subroutine find_temperature(this, state, temperature)
    class(melting_t), intent(inout) :: this
    real(wp), intent(in) :: state(:)
    real(wp), intent(out) :: temperature(:)
    real(wp) :: complete, slope
    integer :: k

    this%calls = this%calls + 1
    complete = this%liquidus + this%rise
    slope = 1
    if (complete > this%solidus) slope = (this%liquidus - this%solidus)/(complete - this%solidus)
    !$omp parallel do if (size(state) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(state)
      ! What is no number stays none; to compare it would be a floating-point exception.
      if (.not. ieee_is_finite(state(k))) then
        temperature(k) = state(k)
      else if (state(k) <= this%solidus) then
        temperature(k) = state(k)
      else if (state(k) >= complete) then
        temperature(k) = state(k) - this%rise
      else
        temperature(k) = this%solidus + slope*(state(k) - this%solidus)
      end if
    end do
    !$omp end parallel do
  end subroutine find_temperature

  !> Where solidus and liquidus are equal, what has just that temperature is taken for solid.
  pure subroutine find_state(this, temperature, state)
    class(melting_t), intent(in) :: this
    real(wp), intent(in) :: temperature(:)
    real(wp), intent(out) :: state(:)
    integer :: k

    do k = 1, size(temperature)
      if (temperature(k) <= this%solidus) then
        state(k) = temperature(k)
      else if (temperature(k) >= this%liquidus) then
        state(k) = temperature(k) + this%rise
      else
        state(k) = temperature(k) + this%rise*(temperature(k) - this%solidus)/ &
                   (this%liquidus - this%solidus)
      end if
    end do
  end subroutine find_state

  pure subroutine find_liquid_fraction(this, state, fraction)
    class(melting_t), intent(in) :: this
    real(wp), intent(in) :: state(:)
    real(wp), intent(out) :: fraction(:)
    integer :: k

    do k = 1, size(state)
      if (.not. ieee_is_finite(state(k))) then
        fraction(k) = 0
      else if (state(k) <= this%solidus) then
        fraction(k) = 0
      else if (state(k) >= this%liquidus + this%rise) then
        fraction(k) = 1
      else
        fraction(k) = (state(k) - this%solidus)/(this%liquidus + this%rise - this%solidus)
      end if
    end do
  end subroutine find_liquid_fraction

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
