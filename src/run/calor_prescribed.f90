!> Temperatures held on the walls.
module calor_prescribed
  use calor_expression, only: expression_t
  use calor_kinds, only: wp, ip
  use calor_places, only: places_t
  implicit none (type, external)
  private

  public :: prescribed_t

  !> Particles of one boundary condition and the temperature they are held at
  type :: prescribed_t
    !> The particles
    integer(ip), allocatable :: particle(:)
    !> Their temperatures, K or °C as the scene has it
    real(wp), allocatable :: temperature(:)
    !> Their places; set only where the temperature changes with time
    type(places_t) :: places
    !> Temperature in terms of x, y and t; allocated only where it changes with time
    type(expression_t), allocatable :: expression
  contains
    !> Put the temperatures of a time into a field
    procedure :: impose
  end type prescribed_t

contains

  subroutine impose(this, time, temperature)
    class(prescribed_t), intent(inout) :: this
    !> Time, s
    real(wp), intent(in) :: time
    !> Temperatures of all particles
    real(wp), intent(inout) :: temperature(:)

    if (allocated(this%expression)) then
      call this%places%evaluate(this%expression, time, this%temperature)
    end if
    temperature(this%particle) = this%temperature
  end subroutine impose

end module calor_prescribed
