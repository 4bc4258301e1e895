!> A body as effects see it: its particles, what they consist of and where they touch the world.
module calor_medium
  use calor_kinds, only: wp
  use calor_wall_contacts, only: wall_contacts_t
  implicit none (type, external)
  private

  public :: medium_t

  !> Particles of a body
  type :: medium_t
    !> Coordinates, m
    real(wp), allocatable :: x(:), y(:)
    !> What part of the body each particle stands for, m²
    real(wp), allocatable :: area(:)
    !> Density times heat capacity, J/(m³ K), and conductivity, W/(m K)
    real(wp) :: capacity = 1.0_wp, conductivity = 1.0_wp
    !> Density times heat capacity of each particle, where that is not the same everywhere; else not
    !> allocated, and the least conductivity and capacity stand above where they are
    real(wp), allocatable :: local_capacity(:)
    !> Whether particles move
    logical :: in_motion = .false.
    !> Whether these are a part of the particles of a body only
    logical :: is_part = .false.
    !> The body's extent, m, where the particles do not tell; 0: they do
    real(wp) :: extent = 0.0_wp
    !> The time to simulate, s
    real(wp) :: duration = 0.0_wp
    !> Where it touches the world
    type(wall_contacts_t) :: contacts
  contains
    !> Number of particles
    procedure :: particles
    !> How far heat comes within the time to simulate, or as far as the body reaches, m
    procedure :: reach
    !> Density times heat capacity of a particle, J/(m³ K)
    procedure :: capacity_of
  end type medium_t

contains

  pure function particles(this) result(number)
    class(medium_t), intent(in) :: this
    integer :: number

    number = size(this%x)
  end function particles

  pure function capacity_of(this, particle) result(capacity)
    class(medium_t), intent(in) :: this
    !> The particle
    integer, intent(in) :: particle
    real(wp) :: capacity

    capacity = this%capacity
    if (allocated(this%local_capacity)) capacity = this%local_capacity(particle)
  end function capacity_of

  pure function reach(this) result(length)
    class(medium_t), intent(in) :: this
    real(wp) :: length

    length = this%extent
    if (.not. length > 0) then
      length = max(maxval(this%x) - minval(this%x), maxval(this%y) - minval(this%y))
    end if
    if (this%duration > 0) then
      length = min(length, sqrt(this%conductivity/this%capacity*this%duration))
    end if
  end function reach

end module calor_medium
