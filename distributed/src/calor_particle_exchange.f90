!> Particles on their way from rank to rank.
module calor_particle_exchange
  use calor_cloud, only: cloud_t
  use calor_kinds, only: wp, ip, i8
  use calor_ranks, only: ranks_t
  implicit none (type, external)
  private

  public :: exchange_particles

  !> Reals and whole numbers that go with a particle
  integer, parameter :: reals = 7, wholes = 3

contains

  !> Send particles to ranks, and receive others.
  subroutine exchange_particles(ranks, cloud, chosen, sent, number, arrived, arrived_number)
    type(ranks_t), intent(in) :: ranks
    !> A cloud, and which of its particles go, rank after rank, and how many to each rank
    type(cloud_t), intent(in) :: cloud
    integer, intent(in) :: chosen(:)
    integer, intent(in) :: sent(:)
    !> A number that goes with each particle of the cloud
    integer(i8), intent(in) :: number(:)
    !> What arrives, rank after rank
    type(cloud_t), intent(out) :: arrived
    integer(i8), allocatable, intent(out) :: arrived_number(:)
    real(wp), allocatable :: given(:), taken(:)
    integer(i8), allocatable :: given_wholes(:), taken_wholes(:)
    integer, allocatable :: received(:)
    integer :: k, n

    allocate (given(reals*size(chosen)), given_wholes(wholes*size(chosen)))
    do k = 1, size(chosen)
      associate (i => chosen(k), at => reals*(k - 1), whole_at => wholes*(k - 1))
        given(at + 1:at + reals) = 0
        given(at + 1:at + 3) = [cloud%x(i), cloud%y(i), cloud%volume(i)]
        if (allocated(cloud%normal_x)) then
          given(at + 4:at + 6) = [cloud%normal_x(i), cloud%normal_y(i), cloud%wall_length(i)]
        end if
        if (allocated(cloud%area)) given(at + 7) = cloud%area(i)
        given_wholes(whole_at + 1:whole_at + wholes) = &
          [number(i), int(cloud%side(i), i8), int(cloud%user_index(i), i8)]
      end associate
    end do
    allocate (received(ranks%ranks))
    call ranks%announce(sent, received)
    n = sum(received)
    allocate (taken(reals*n), taken_wholes(wholes*n))
    call ranks%exchange(reals*sent, given, reals*received, taken)
    call ranks%exchange(wholes*sent, given_wholes, wholes*received, taken_wholes)

    arrived%x = taken(1::reals)
    arrived%y = taken(2::reals)
    arrived%volume = taken(3::reals)
    if (allocated(cloud%normal_x)) then
      arrived%normal_x = taken(4::reals)
      arrived%normal_y = taken(5::reals)
      arrived%wall_length = taken(6::reals)
    end if
    arrived%area = taken(7::reals)
    arrived_number = taken_wholes(1::wholes)
    arrived%side = int(taken_wholes(2::wholes), ip)
    arrived%user_index = int(taken_wholes(3::wholes), ip)
    arrived%boundary = cloud%boundary
    arrived%spacing = cloud%spacing
  end subroutine exchange_particles

end module calor_particle_exchange
