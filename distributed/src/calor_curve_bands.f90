!> How a cloud is shared out: each rank gets a band of the particles along the Hilbert curve, which
!> is a compact region, and all bands hold equally many.
!>
!> The bands one after another are the very order in which one process would keep the particles, so
!> that the number of a particle does not depend on how many ranks there are.
module calor_curve_bands
  use calor_cloud, only: cloud_t
  use calor_kinds, only: wp, ip, i8
  use calor_particle_exchange, only: exchange_particles
  use calor_ranks, only: ranks_t
  use calor_space_filling_curve, only: curve_square_t, hilbert_keys, levels, sort_by_keys
  use mpi_f08, only: mpi_allgather, mpi_allreduce, mpi_integer8, mpi_sum
  implicit none (type, external)
  private

  public :: bands_t, first_not_below

  !> What a rank knows of all bands, and the places of its own particles on the curve
  type :: bands_t
    type(curve_square_t) :: square
    !> The least key of each band, and one past all: rank r, from 0, has those from first_key(r)
    integer(i8), allocatable :: first_key(:)
    !> Particles in all, and how many are in the bands before each
    integer(i8) :: particles = 0
    integer(i8), allocatable :: before(:)
    !> Keys of the own particles, ascending
    integer(i8), allocatable :: key(:)
  contains
    !> Share out
    procedure :: share_out
    !> The rank that has a key
    procedure :: owner
  end type bands_t

contains

  !> From slices to bands.
  subroutine share_out(this, ranks, cloud)
    class(bands_t), intent(out) :: this
    type(ranks_t), intent(in) :: ranks
    !> Particles of a slice; those of a band afterwards, along the curve
    type(cloud_t), intent(inout) :: cloud
    type(cloud_t) :: arrived
    integer(i8), allocatable :: number(:), unused(:)
    integer(ip), allocatable :: order(:)
    integer :: sent(ranks%ranks), rank
    real(wp) :: lowest(2), highest(2)

    lowest = huge(1.0_wp)
    highest = -huge(1.0_wp)
    if (cloud%particles() > 0) then
      lowest = [minval(cloud%x), minval(cloud%y)]
      highest = [maxval(cloud%x), maxval(cloud%y)]
    end if
    call this%square%enclose([ranks%least(lowest(1)), ranks%most(highest(1))], &
                             [ranks%least(lowest(2)), ranks%most(highest(2))])
    allocate (this%key(cloud%particles()))
    call hilbert_keys(this%square, cloud%x, cloud%y, this%key)
    call sort_by_keys(this%key, order)
    this%particles = ranks%total(int(cloud%particles(), i8))
    call find_first_keys(ranks, this%key, this%particles, this%first_key)
    do rank = 0, ranks%ranks - 1
      sent(rank + 1) = first_not_below(this%key, this%first_key(rank + 1)) - &
                       first_not_below(this%key, this%first_key(rank))
    end do
    allocate (number(cloud%particles()), source=0_i8)
    call exchange_particles(ranks, cloud, int(order), sent, number, arrived, unused)
    deallocate (this%key)
    allocate (this%key(arrived%particles()))
    call hilbert_keys(this%square, arrived%x, arrived%y, this%key)
    call sort_by_keys(this%key, order)
    call arrived%reorder(order)
    cloud = arrived
    allocate (this%before(0:ranks%ranks))
    call mpi_allgather(int(cloud%particles(), i8), 1, mpi_integer8, this%before(1:), 1, &
                       mpi_integer8, ranks%comm)
    this%before(0) = 0
    do rank = 1, ranks%ranks
      this%before(rank) = this%before(rank - 1) + this%before(rank)
    end do
  end subroutine share_out

  !> Where to cut: by bisection of the keys, counting what is below on all ranks.
  subroutine find_first_keys(ranks, key, particles, first_key)
    type(ranks_t), intent(in) :: ranks
    !> Own keys, ascending, and particles in all
    integer(i8), intent(in) :: key(:), particles
    integer(i8), allocatable, intent(out) :: first_key(:)
    integer(i8) :: low(ranks%ranks - 1), high(ranks%ranks - 1), below(ranks%ranks - 1), &
                   wanted(ranks%ranks - 1), counted(ranks%ranks - 1)
    integer :: k, pass

    do k = 1, size(low)
      wanted(k) = particles*k/ranks%ranks
    end do
    low = 0
    high = 2_i8**(2*levels)
    do pass = 0, 2*levels
      do k = 1, size(low)
        below(k) = first_not_below(key, (low(k) + high(k))/2) - 1
      end do
      call mpi_allreduce(below, counted, size(below), mpi_integer8, mpi_sum, ranks%comm)
      where (counted < wanted)
        low = (low + high)/2 + 1
      else where
        high = (low + high)/2
      end where
      where (low > high) low = high
    end do
    allocate (first_key(0:ranks%ranks))
    first_key(0) = 0
    first_key(1:ranks%ranks - 1) = high
    first_key(ranks%ranks) = 2_i8**(2*levels)
  end subroutine find_first_keys

  !> Where the first key not below a bound is; one past the end if there is none.
  pure function first_not_below(key, bound) result(place)
    !> Ascending
    integer(i8), intent(in) :: key(:)
    integer(i8), intent(in) :: bound
    integer :: place
    integer :: low, high, middle

    low = 1
    high = size(key) + 1
    do while (low < high)
      middle = low + (high - low)/2
      if (key(middle) < bound) then
        low = middle + 1
      else
        high = middle
      end if
    end do
    place = low
  end function first_not_below

  pure function owner(this, key) result(rank)
    class(bands_t), intent(in) :: this
    integer(i8), intent(in) :: key
    integer :: rank

    ! The last rank whose first key is not above
    rank = first_not_below(this%first_key, key + 1) - 2
  end function owner

end module calor_curve_bands
