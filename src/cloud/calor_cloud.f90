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
    !> Weights of particles in the sums over kernels, m²: what a particle in the midst of its equals
    !> fills, on walls too, where a kernel's support is cut off
    real(wp), allocatable :: volume(:)
    !> What part of the body a particle stands for in an integral, m². Of a body of a known shape
    !> these sum to its area: half a cell on a straight wall, a quarter in a right corner. Of a
    !> cloud from a file they are the volumes.
    real(wp), allocatable :: area(:)
    !> Which boundaries a particle lies on: bit k-1 set means `boundary(k)`; 0 means inside
    integer(ip), allocatable :: side(:)
    !> Outward unit normal on walls, 0 inside; in a corner the mean of both walls' normals. Not
    !> allocated where the walls of a cloud from a file have none.
    real(wp), allocatable :: normal_x(:), normal_y(:)
    !> The length of boundary that a wall particle stands for, m, 0 inside: half the way to its
    !> neighbours on both sides. Not allocated where a cloud from a file has none.
    real(wp), allocatable :: wall_length(:)
    !> The place of each particle in the user's order
    integer(ip), allocatable :: user_index(:)
    !> Names of the boundaries, such as 'left'
    type(text_t), allocatable :: boundary(:)
    !> Nominal distance between neighbours, m
    real(wp) :: spacing = 0.0_wp
    !> A cloud may be a part of a larger one: then its own particles are `own_first` to `own_last`,
    !> and the others are those of other parts that lie within reach of them
    logical :: is_part = .false.
    integer :: own_first = 1, own_last = huge(1)
    !> Whether a boundary, numbered from 0, consists of another one and more, of which the particles
    !> of a part do not tell; allocated there only
    logical, allocatable :: covers(:, :)
    !> The larger extent of the whole, m; 0: that of the particles
    real(wp) :: extent = 0.0_wp
  contains
    !> Whether a particle is its own
    procedure :: owns
    !> Number of particles
    procedure :: particles
    !> Put the particles into another order, or take some of them, even twice; `user_index` keeps
    !> the way back
    procedure :: reorder
  end type cloud_t

contains

  !> Make room for a number of particles, all of them inside and in the user's order.
  !>
  !> Coordinates, volumes and areas are left undefined; walls are not allocated.
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
    if (failed == 0) allocate (cloud%area(particles), stat=failed)
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

  elemental function owns(this, particle) result(answer)
    class(cloud_t), intent(in) :: this
    integer, intent(in) :: particle
    logical :: answer

    answer = particle >= this%own_first .and. particle <= this%own_last
  end function owns

  pure subroutine reorder(this, order)
    class(cloud_t), intent(inout) :: this
    !> The new k-th particle is the old `order(k)`-th
    integer(ip), intent(in) :: order(:)

    this%x = this%x(order)
    this%y = this%y(order)
    this%volume = this%volume(order)
    if (allocated(this%area)) this%area = this%area(order)
    this%side = this%side(order)
    if (allocated(this%normal_x)) this%normal_x = this%normal_x(order)
    if (allocated(this%normal_y)) this%normal_y = this%normal_y(order)
    if (allocated(this%wall_length)) this%wall_length = this%wall_length(order)
    this%user_index = this%user_index(order)
  end subroutine reorder

end module calor_cloud
