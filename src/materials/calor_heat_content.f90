!> The heat content of particles as the unknown of the heat equation, in place of the temperature:
!> where heat capacity or conductivity depend on the temperature, or where something melts.
!>
!> See calor_heat_law for what is meant by heat content and potential.
module calor_heat_content
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_constants, only: worth_threads
  use calor_heat_law, only: heat_law_t
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: heat_content_t

  type :: heat_content_t
    !> The laws, and which of them holds at each particle; not allocated where there is one law
    type(heat_law_t), allocatable :: law(:)
    integer, allocatable :: law_of(:)
    !> Latent heat over heat capacity at each particle, K, where that depends on the place; not
    !> allocated: it is that of the law
    real(wp), allocatable :: rise(:)
    !> Whether the unknown is the temperature all the same, as in a steady state
    logical :: steady = .false.
  contains
    !> Tabulate the laws
    procedure :: prepare
    !> Temperatures and potentials of states
    procedure :: evaluate
    !> Their derivatives
    procedure :: slopes
    !> The largest of these at temperatures of a range
    procedure :: largest_slopes
    !> States of temperatures at some particles
    procedure :: find_state
    !> How much is liquid
    procedure :: find_liquid_fraction
    !> Whether any conductivity depends on the temperature
    procedure :: conducts
    procedure, private :: number_of
    procedure, private :: by_law
    procedure, private :: reach
  end type heat_content_t

contains

  subroutine prepare(this, lowest, highest)
    class(heat_content_t), intent(inout) :: this
    !> Range of given temperatures
    real(wp), intent(in) :: lowest, highest
    integer :: k

    do k = 1, size(this%law)
      call this%law(k)%prepare(lowest, highest)
    end do
  end subroutine prepare

  pure function number_of(this, particle) result(number)
    class(heat_content_t), intent(in) :: this
    integer, intent(in) :: particle
    integer :: number

    number = 1
    if (allocated(this%law_of)) number = this%law_of(particle)
  end function number_of

  !> The state of a particle were latent heat over heat capacity that of the law
  pure function by_law(this, particle, state) result(content)
    class(heat_content_t), intent(in) :: this
    integer, intent(in) :: particle
    real(wp), intent(in) :: state
    real(wp) :: content

    content = state
    if (.not. allocated(this%rise)) return
    associate (law => this%law(this%number_of(particle)))
      content = law%rescaled(state, this%rise(particle), law%rise)
    end associate
  end function by_law

  pure function conducts(this) result(answer)
    class(heat_content_t), intent(in) :: this
    logical :: answer

    answer = any(this%law%conducts)
  end function conducts

  subroutine evaluate(this, state, temperature, potential)
    class(heat_content_t), intent(inout) :: this
    !> State of each particle, K
    real(wp), intent(in) :: state(:)
    !> Its temperature and Kirchhoff potential
    real(wp), intent(out) :: temperature(:), potential(:)
    integer :: k

    call this%reach(state)
    !$omp parallel do if (size(state) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(state)
      if (this%steady) then
        temperature(k) = state(k)
        potential(k) = this%law(this%number_of(k))%potential(state(k))
      else
        call this%law(this%number_of(k))%evaluate(this%by_law(k, state(k)), temperature(k), &
                                                  potential(k))
      end if
    end do
    !$omp end parallel do
  end subroutine evaluate

  !> Make the tables reach all states.
  subroutine reach(this, state)
    class(heat_content_t), intent(inout) :: this
    real(wp), intent(in) :: state(:)
    real(wp) :: lowest(size(this%law)), highest(size(this%law)), content
    integer :: k, n

    if (.not. any(this%law%stores .or. this%law%conducts)) return
    lowest = huge(1.0_wp)
    highest = -huge(1.0_wp)
    do k = 1, size(state)
      if (.not. ieee_is_finite(state(k))) cycle
      n = this%number_of(k)
      content = state(k)
      if (.not. this%steady) content = this%by_law(k, content)
      lowest(n) = min(lowest(n), content)
      highest(n) = max(highest(n), content)
    end do
    do n = 1, size(this%law)
      if (.not. lowest(n) <= highest(n)) cycle
      if (this%steady) then
        lowest(n) = this%law(n)%content(lowest(n))
        highest(n) = this%law(n)%content(highest(n))
      end if
      call this%law(n)%reach(lowest(n), highest(n))
    end do
  end subroutine reach

  subroutine slopes(this, state, temperature_slope, potential_slope)
    class(heat_content_t), intent(inout) :: this
    !> State of each particle, K
    real(wp), intent(in) :: state(:)
    !> Derivatives of temperature and potential with respect to it
    real(wp), intent(out) :: temperature_slope(:), potential_slope(:)
    integer :: k

    call this%reach(state)
    do k = 1, size(state)
      associate (law => this%law(this%number_of(k)))
        if (this%steady) then
          ! dθ/dT = (dθ/ds)/(dT/ds), latent heat left out
          temperature_slope(k) = 1
          potential_slope(k) = law%conductivity_factor(state(k))
        else
          call law%slopes(this%by_law(k, state(k)), temperature_slope(k), potential_slope(k))
          if (.not. allocated(this%rise)) cycle
          associate (slope => law%rescaled_slope(state(k), this%rise(k), law%rise))
            temperature_slope(k) = slope*temperature_slope(k)
            potential_slope(k) = slope*potential_slope(k)
          end associate
        end if
      end associate
    end do
  end subroutine slopes

  subroutine largest_slopes(this, lowest, highest, temperature_slope, potential_slope)
    class(heat_content_t), intent(in) :: this
    !> Range of temperatures
    real(wp), intent(in) :: lowest, highest
    !> The largest derivatives at each particle
    real(wp), intent(out) :: temperature_slope(:), potential_slope(:)
    real(wp) :: of_law(2, size(this%law))
    integer :: k

    do k = 1, size(this%law)
      call this%law(k)%largest_slopes(lowest, highest, of_law(1, k), of_law(2, k))
    end do
    do k = 1, size(temperature_slope)
      temperature_slope(k) = of_law(1, this%number_of(k))
      potential_slope(k) = of_law(2, this%number_of(k))
    end do
  end subroutine largest_slopes

  pure subroutine find_state(this, particle, temperature, state)
    class(heat_content_t), intent(in) :: this
    !> The particles
    integer, intent(in) :: particle(:)
    !> Their temperatures
    real(wp), intent(in) :: temperature(:)
    !> Their states, K
    real(wp), intent(out) :: state(:)
    integer :: k

    state = temperature
    if (this%steady) return
    do k = 1, size(particle)
      associate (law => this%law(this%number_of(particle(k))))
        state(k) = law%content(temperature(k))
        if (.not. allocated(this%rise)) cycle
        state(k) = law%rescaled(state(k), law%rise, this%rise(particle(k)))
      end associate
    end do
  end subroutine find_state

  pure subroutine find_liquid_fraction(this, state, fraction)
    class(heat_content_t), intent(in) :: this
    !> State of each particle, K
    real(wp), intent(in) :: state(:)
    !> From 0, solid, to 1, liquid
    real(wp), intent(out) :: fraction(:)
    integer :: k

    do k = 1, size(state)
      fraction(k) = this%law(this%number_of(k))%liquid_fraction(this%by_law(k, state(k)))
    end do
  end subroutine find_liquid_fraction

end module calor_heat_content
