!> Walls that no heat passes: the rows there, made for a normal derivative of 0, are all it takes.
module calor_effect_insulated
  use calor_error, only: error_t
  use calor_kinds, only: wp
  use calor_medium, only: medium_t
  use calor_scene_file, only: group_t
  use calor_wall_exchange, only: wall_exchange_t, refuse_other_keys
  implicit none (type, external)
  private

  public :: insulated_t

  type, extends(wall_exchange_t) :: insulated_t
  contains
    procedure :: read_kind
    procedure :: prepare_kind
    procedure :: find_flux
    procedure :: is_linear
    procedure :: depends_on_time
    procedure :: kept_range
  end type insulated_t

contains

  subroutine read_kind(this, group, error)
    class(insulated_t), intent(inout) :: this
    type(group_t), intent(in) :: group
    type(error_t), allocatable, intent(out) :: error
    character(len=1), parameter :: none(0) = [character(len=1) ::]

    associate (unused => this)
    end associate
    call refuse_other_keys(group, none, error)
  end subroutine read_kind

  subroutine prepare_kind(this, medium, error)
    class(insulated_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    type(error_t), allocatable, intent(out) :: error

    associate (unused => this, also => medium)
    end associate
  end subroutine prepare_kind

  subroutine find_flux(this, time)
    class(insulated_t), intent(inout) :: this
    real(wp), intent(in) :: time

    associate (unused => time)
    end associate
    this%flux = 0
  end subroutine find_flux

  subroutine kept_range(this, kept, lowest, highest)
    class(insulated_t), intent(in) :: this
    logical, intent(out) :: kept
    real(wp), intent(out) :: lowest, highest

    associate (unused => this)
    end associate
    kept = .true.
    lowest = huge(1.0_wp)
    highest = -huge(1.0_wp)
  end subroutine kept_range

  pure function is_linear(this) result(answer)
    class(insulated_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .true.
  end function is_linear

  pure function depends_on_time(this) result(answer)
    class(insulated_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .false.
  end function depends_on_time

end module calor_effect_insulated
