!> What a scene may call for beside plain conduction.
!>
!> An effect is a type that extends `effect_t`, in a module of its own, and one line in the table of
!> calor_effects. It is made only if a scene calls for it, one object for each group that does. It
!> adds its power, W/m³, to what conduction brings each particle, after the operator has been
!> applied, one call for all particles; with no effect in force there is neither array nor call.
module calor_effect
  use calor_error, only: error_t
  use calor_kinds, only: wp, i8
  use calor_medium, only: medium_t
  use calor_places, only: places_t
  use calor_scene_file, only: group_t
  implicit none (type, external)
  private

  public :: effect_t, effect_slot_t

  !> An effect. The first five components identify it in the table
  type, abstract :: effect_t
    !> Its name, and what it is, for people
    character(len=12) :: name = ''
    character(len=60) :: summary = ''
    !> The group of a scene that calls for it; if `key` is not blank, only where that says `value`,
    !> or anything at all if `value` is blank
    character(len=12) :: group = '', key = '', value = ''
    !> What it brings, what it costs, and where that is from
    character(len=80) :: formula = '', cost = '', reference = ''
    !> Why it is in force, in the scene's words
    character(len=:), allocatable :: reason
    !> How often it was asked for its power, or its derivative, and what its arrays take, bytes
    integer(i8) :: calls = 0, bytes = 0
  contains
    !> Read the group that calls for it
    procedure(read_interface), deferred :: read
    !> Make ready for the particles of a body
    procedure(prepare_interface), deferred :: prepare
    !> Add its power at each particle
    procedure(add_power_interface), deferred :: add_power
    !> Take note of new rows of wall particles, and of the paths of particles that move
    procedure :: follow
    !> Whether its power depends on the temperature
    procedure :: has_slope
    !> Add the derivative of its power with respect to the temperature, at each particle
    procedure :: add_slope
    !> Whether its power is A T + b, A being constant, and whether it depends on the time
    procedure :: is_linear
    procedure :: depends_on_time
    !> By about how much it might change the temperature, K: the measure of errors where no range
    !> of temperatures is given
    procedure :: expected_rise
    !> The range in which it keeps the temperature of a body that lies within it
    procedure :: kept_range
    !> The entry of the heat budget that its power counts to; '' where it counts to walls
    procedure :: account
    !> Lay down what flux it brings at each contact with the world
    procedure :: put_flux
    !> What it takes to find its power, in operators of expressions
    procedure :: operations
    !> Whether it adds no power at all, as what only stores heat
    procedure :: brings_nothing
  end type effect_t

  !> A place for any effect
  type :: effect_slot_t
    class(effect_t), allocatable :: effect
  end type effect_slot_t

  abstract interface
    subroutine read_interface(this, group, number, error)
      import :: effect_t, group_t, error_t
      implicit none (type, external)
      class(effect_t), intent(inout) :: this
      !> The group, checked against the contract
      type(group_t), intent(in) :: group
      !> Its number among the groups of its name
      integer, intent(in) :: number
      !> A key is missing or its value is wrong
      type(error_t), allocatable, intent(out) :: error
    end subroutine read_interface

    subroutine prepare_interface(this, medium, temperature, error)
      import :: effect_t, medium_t, error_t, wp
      implicit none (type, external)
      class(effect_t), intent(inout) :: this
      !> The particles
      type(medium_t), intent(in) :: medium
      !> Their temperatures at the start
      real(wp), intent(in) :: temperature(:)
      !> What the scene asks for cannot be had, or an expression gives no number
      type(error_t), allocatable, intent(out) :: error
    end subroutine prepare_interface

    subroutine add_power_interface(this, medium, time, temperature, power)
      import :: effect_t, medium_t, wp
      implicit none (type, external)
      class(effect_t), intent(inout) :: this
      !> The particles
      type(medium_t), intent(in) :: medium
      !> Time, s
      real(wp), intent(in) :: time
      !> Temperature of each particle
      real(wp), intent(in) :: temperature(:)
      !> Power that each particle is given, W/m³
      real(wp), intent(inout) :: power(:)
    end subroutine add_power_interface
  end interface

contains

  subroutine follow(this, medium, places)
    class(effect_t), intent(inout) :: this
    !> The particles; those of the same number as before are the same
    type(medium_t), intent(in) :: medium
    !> Where they will be
    type(places_t), intent(in) :: places

    ! Most that happens within a body happens to its matter, wherever that is.
    associate (unused => this, also => medium, and => places)
    end associate
  end subroutine follow

  pure function has_slope(this) result(answer)
    class(effect_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .false.
  end function has_slope

  subroutine add_slope(this, medium, time, temperature, slope)
    class(effect_t), intent(inout) :: this
    !> The particles
    type(medium_t), intent(in) :: medium
    !> Time, s
    real(wp), intent(in) :: time
    !> Temperature of each particle
    real(wp), intent(in) :: temperature(:)
    !> Derivative of the power with respect to the temperature, W/(m³ K)
    real(wp), intent(inout) :: slope(:)

    associate (unused => this, also => medium, and => time, too => temperature, or => slope)
    end associate
  end subroutine add_slope

  pure function is_linear(this) result(answer)
    class(effect_t), intent(in) :: this
    logical :: answer

    ! An effect that says nothing of it may be anything.
    associate (unused => this)
    end associate
    answer = .false.
  end function is_linear

  pure function depends_on_time(this) result(answer)
    class(effect_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .true.
  end function depends_on_time

  function expected_rise(this, medium) result(rise)
    class(effect_t), intent(in) :: this
    !> The particles
    type(medium_t), intent(in) :: medium
    real(wp) :: rise

    associate (unused => this, also => medium)
    end associate
    rise = 0
  end function expected_rise

  subroutine kept_range(this, kept, lowest, highest)
    class(effect_t), intent(in) :: this
    !> Whether it keeps the temperature within any range at all
    logical, intent(out) :: kept
    !> That range; an empty one, huge to -huge, stands for any
    real(wp), intent(out) :: lowest, highest

    associate (unused => this)
    end associate
    kept = .false.
    lowest = huge(1.0_wp)
    highest = -huge(1.0_wp)
  end subroutine kept_range

  subroutine put_flux(this, flux)
    class(effect_t), intent(in) :: this
    !> Heat flux into the body at all contacts, W/m²
    real(wp), intent(inout) :: flux(:)

    associate (unused => this, also => flux)
    end associate
  end subroutine put_flux

  pure function brings_nothing(this) result(answer)
    class(effect_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .false.
  end function brings_nothing

  pure function operations(this) result(number)
    class(effect_t), intent(in) :: this
    real(wp) :: number

    ! Most is little beside the rows of the Laplacian, as what happens at walls.
    associate (unused => this)
    end associate
    number = 0
  end function operations

  pure function account(this) result(name)
    class(effect_t), intent(in) :: this
    character(len=:), allocatable :: name

    name = trim(this%name)
  end function account

end module calor_effect
