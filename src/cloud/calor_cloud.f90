!> The particle cloud: places, volumes and the walls.
module calor_cloud
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: wp, ip
  use calor_text, only: text_t, to_text
  implicit none (type, external)
  private

  public :: cloud_t, allocate_cloud

  !> Particles in two dimensions
  type :: cloud_t
    !> Coordinates, m
    real(wp), allocatable :: x(:), y(:)
    !> Particle volumes (areas in two dimensions), m²
    real(wp), allocatable :: volume(:)
    !> Which boundaries a particle lies on: bit k-1 set means `boundary(k)`; 0 means inside
    integer(ip), allocatable :: side(:)
    !> The place of each particle in the user's order
    integer(ip), allocatable :: user_index(:)
    !> Names of the boundaries, such as 'left'
    type(text_t), allocatable :: boundary(:)
    !> Nominal distance between neighbours, m
    real(wp) :: spacing = 0.0_wp
  contains
    !> Number of particles
    procedure :: particles
    !> Put the particles into another order; `user_index` keeps the way back
    procedure :: reorder
  end type cloud_t

contains

  !> Make room for a number of particles, all of them inside and in the user's order.
  !>
  !> Coordinates and volumes are left undefined.
  subroutine allocate_cloud(cloud, particles, error)
    !> The cloud
    type(cloud_t), intent(out) :: cloud
    !> How many particles
    integer, intent(in) :: particles
    !> There is not enough memory
    type(error_t), allocatable, intent(out) :: error
    integer :: failed, k

    allocate (cloud%x(particles), stat=failed)
    if (failed == 0) allocate (cloud%y(particles), stat=failed)
    if (failed == 0) allocate (cloud%volume(particles), stat=failed)
    if (failed == 0) allocate (cloud%side(particles), stat=failed)
    if (failed == 0) allocate (cloud%user_index(particles), stat=failed)
    if (failed /= 0) then
      call raise(error, status_bad_input, 'There is not enough memory for '//to_text(particles)// &
                 ' particles. A larger spacing gives fewer.')
      return
    end if
    allocate (cloud%boundary(0))
    cloud%side = 0
    do k = 1, particles
      cloud%user_index(k) = k
    end do
  end subroutine allocate_cloud

  pure function particles(this) result(number)
    class(cloud_t), intent(in) :: this
    integer :: number

    number = size(this%x)
  end function particles

  pure subroutine reorder(this, order)
    class(cloud_t), intent(inout) :: this
    !> Permutation: the new k-th particle is the old `order(k)`-th
    integer(ip), intent(in) :: order(:)

    this%x = this%x(order)
    this%y = this%y(order)
    this%volume = this%volume(order)
    this%side = this%side(order)
    this%user_index = this%user_index(order)
  end subroutine reorder

end module calor_cloud
