!> Walls that exchange heat with surroundings of a given temperature, at a rate that a factor tells.
module calor_ambient_exchange
  use calor_error, only: error_t
  use calor_kinds, only: wp
  use calor_medium, only: medium_t
  use calor_places, only: places_t
  use calor_scene_file, only: group_t
  use calor_varying_value, only: varying_value_t
  use calor_wall_exchange, only: wall_exchange_t, refuse_other_keys
  implicit none (type, external)
  private

  public :: ambient_exchange_t

  type, abstract, extends(wall_exchange_t) :: ambient_exchange_t
    !> Heat transfer coefficient, emissivity or the like
    type(varying_value_t) :: factor
    !> Temperature of the surroundings, and the lowest and highest of it so far
    type(varying_value_t) :: ambient
    real(wp), private :: lowest = huge(1.0_wp), highest = -huge(1.0_wp)
  contains
    !> Read both
    procedure :: read_values
    !> Find them at the start
    procedure :: place_values
    !> Find them at a time
    procedure :: update_values
    procedure :: follow_kind
    procedure :: has_slope
    procedure :: depends_on_time
    procedure :: kept_range
  end type ambient_exchange_t

contains

  subroutine read_values(this, group, factor, error)
    class(ambient_exchange_t), intent(inout) :: this
    type(group_t), intent(in) :: group
    !> The factor's key
    character(len=*), intent(in) :: factor
    !> A key is missing or wrong, or there is another one
    type(error_t), allocatable, intent(out) :: error
    character(len=11) :: keys(2)

    ! Not a constructor: that of gfortran 12 takes the length of `factor` for all elements.
    keys(1) = factor
    keys(2) = 'ambient'
    call refuse_other_keys(group, keys, error)
    if (allocated(error)) return
    call this%factor%read(group, factor, error)
    if (allocated(error)) return
    call this%ambient%read(group, 'ambient', error)
  end subroutine read_values

  subroutine place_values(this, medium, error, highest_factor, coldest, hottest)
    class(ambient_exchange_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    !> A value is no number or out of bounds
    type(error_t), allocatable, intent(out) :: error
    !> Bounds, if there are any; no factor is negative
    real(wp), intent(in), optional :: highest_factor, coldest, hottest

    call this%factor%place_at(this%x, this%y, 0.0_wp, error, this%temperature, lowest=0.0_wp, &
                              highest=highest_factor, in_motion=medium%in_motion)
    if (allocated(error)) return
    call this%ambient%place_at(this%x, this%y, 0.0_wp, error, this%temperature, lowest=coldest, &
                               highest=hottest, in_motion=medium%in_motion)
    if (allocated(error)) return
    this%lowest = minval(this%ambient%value)
    this%highest = maxval(this%ambient%value)
    this%bytes = this%bytes + this%factor%bytes() + this%ambient%bytes()
  end subroutine place_values

  subroutine update_values(this, time)
    class(ambient_exchange_t), intent(inout) :: this
    !> Time, s
    real(wp), intent(in) :: time

    call this%factor%update(time, this%temperature)
    call this%ambient%update(time, this%temperature)
    if (.not. this%ambient%moves) return
    this%lowest = min(this%lowest, minval(this%ambient%value))
    this%highest = max(this%highest, maxval(this%ambient%value))
  end subroutine update_values

  subroutine follow_kind(this, places)
    class(ambient_exchange_t), intent(inout) :: this
    type(places_t), intent(in) :: places

    call this%factor%follow(places)
    call this%ambient%follow(places)
  end subroutine follow_kind

  pure function has_slope(this) result(answer)
    class(ambient_exchange_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .true.
  end function has_slope

  pure function depends_on_time(this) result(answer)
    class(ambient_exchange_t), intent(in) :: this
    logical :: answer

    answer = this%factor%moves .or. this%ambient%moves
  end function depends_on_time

  subroutine kept_range(this, kept, lowest, highest)
    class(ambient_exchange_t), intent(in) :: this
    logical, intent(out) :: kept
    real(wp), intent(out) :: lowest, highest

    kept = .not. (this%factor%reacts .or. this%ambient%reacts)
    lowest = this%lowest
    highest = this%highest
  end subroutine kept_range

end module calor_ambient_exchange
