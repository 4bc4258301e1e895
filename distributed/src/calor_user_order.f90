!> From the order of the whole to the user's: each rank gets the values of a stretch of the user's
!> particles, which is what it writes.
module calor_user_order
  use calor_cloud, only: cloud_t
  use calor_kinds, only: wp, i8
  use calor_ranks, only: ranks_t
  use calor_slice, only: slice_t
  implicit none (type, external)
  private

  public :: user_order_t

  type :: user_order_t
    !> Rows before this rank's stretch, and how many it has
    integer(i8) :: first = 0
    integer :: rows = 0
    !> Own particles in the order in which they go, how many to each rank, and from each
    integer, allocatable, private :: chosen(:), sent(:), received(:)
    !> Where in the stretch each of those that come belongs
    integer, allocatable, private :: place(:)
  contains
    !> Find the ways
    procedure :: prepare
    !> Send values
    procedure :: arrange
    !> Get them back
    procedure :: distribute
  end type user_order_t

contains

  subroutine prepare(this, ranks, cloud, particles)
    class(user_order_t), intent(inout) :: this
    type(ranks_t), intent(in) :: ranks
    !> A cloud, its own particles marked
    type(cloud_t), intent(in) :: cloud
    !> Particles of all ranks
    integer(i8), intent(in) :: particles
    type(slice_t) :: slice
    integer(i8), allocatable :: given(:), taken(:)
    integer :: last(ranks%ranks), own_first, own_last, k, place(ranks%ranks), rank
    integer, allocatable :: to(:)

    do rank = 1, ranks%ranks
      slice = slice_t(rank - 1, ranks%ranks)
      call slice%share(int(particles), own_first, own_last)
      last(rank) = own_last + 1
      if (rank - 1 /= ranks%rank) cycle
      this%first = own_first
      this%rows = own_last - own_first + 1
    end do
    allocate (to(cloud%own_first:cloud%own_last))
    allocate (this%sent(ranks%ranks), source=0)
    do k = cloud%own_first, cloud%own_last
      ! Stretches are equally long but for one particle.
      rank = max(1, min(ranks%ranks, int((cloud%user_index(k) - 1_i8)*ranks%ranks/particles)))
      do while (rank > 1)
        if (last(rank - 1) < cloud%user_index(k)) exit
        rank = rank - 1
      end do
      do while (last(rank) < cloud%user_index(k))
        rank = rank + 1
      end do
      to(k) = rank
      this%sent(rank) = this%sent(rank) + 1
    end do
    place(1) = 1
    do rank = 2, ranks%ranks
      place(rank) = place(rank - 1) + this%sent(rank - 1)
    end do
    allocate (this%chosen(size(to)), given(size(to)))
    do k = cloud%own_first, cloud%own_last
      this%chosen(place(to(k))) = k
      given(place(to(k))) = cloud%user_index(k)
      place(to(k)) = place(to(k)) + 1
    end do
    allocate (this%received(ranks%ranks), taken(this%rows))
    call ranks%announce(this%sent, this%received)
    call ranks%exchange(this%sent, given, this%received, taken)
    this%place = int(taken - this%first)
  end subroutine prepare

  !> Values of the stretch from those of all particles here.
  subroutine arrange(this, ranks, values, arranged)
    class(user_order_t), intent(in) :: this
    type(ranks_t), intent(in) :: ranks
    real(wp), intent(in) :: values(:)
    real(wp), allocatable, intent(out) :: arranged(:)
    real(wp), allocatable :: taken(:)

    allocate (taken(this%rows), arranged(this%rows))
    call ranks%exchange(this%sent, values(this%chosen), this%received, taken)
    arranged(this%place) = taken
  end subroutine arrange

  !> Values of own particles from those of the stretches.
  subroutine distribute(this, ranks, arranged, values)
    class(user_order_t), intent(in) :: this
    type(ranks_t), intent(in) :: ranks
    real(wp), intent(in) :: arranged(:)
    !> One for each particle here; only those of own ones are set
    real(wp), intent(inout) :: values(:)
    real(wp), allocatable :: taken(:)

    allocate (taken(size(this%chosen)))
    call ranks%exchange(this%received, arranged(this%place), this%sent, taken)
    values(this%chosen) = taken
  end subroutine distribute

end module calor_user_order
