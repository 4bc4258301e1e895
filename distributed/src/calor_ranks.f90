!> The processes that share a run, and how they talk: sums, extremes, exchanges, and errors that all
!> of them come to know.
module calor_ranks
  use, intrinsic :: iso_fortran_env, only: int64
  use calor_error, only: error_t, raise
  use calor_kinds, only: wp, i8
  use mpi_f08, only: mpi_comm, mpi_comm_rank, mpi_comm_size, mpi_allreduce, mpi_alltoall, &
                     mpi_alltoallv, mpi_bcast, mpi_exscan, mpi_double_precision, mpi_integer, &
                     mpi_integer8, mpi_logical, mpi_character, mpi_sum, mpi_min, mpi_max, mpi_lor
  implicit none (type, external)
  private

  public :: ranks_t

  !> One process, a rank, among those of a communicator
  type :: ranks_t
    type(mpi_comm) :: comm
    !> Its number, from 0, and how many there are
    integer :: rank = 0, ranks = 1
  contains
    !> Enter a communicator
    procedure :: enter
    !> Whether this is the one that speaks for all
    procedure :: speaks
    !> The sum, the least and the largest of all ranks' values, and whether something holds on any
    generic :: total => total_real, total_count
    procedure :: least
    procedure :: most
    procedure :: any_of
    !> The sum of the values of the ranks before
    procedure :: before
    !> An error of one rank becomes one of all
    procedure :: agree
    !> Send each rank its part of an array, and get the parts meant for this one
    generic :: exchange => exchange_reals, exchange_counts
    !> How many items come from each rank if so many go to each
    procedure :: announce
    procedure, private :: total_real, total_count, exchange_reals, exchange_counts
  end type ranks_t

contains

  subroutine enter(this, comm)
    class(ranks_t), intent(inout) :: this
    type(mpi_comm), intent(in) :: comm

    this%comm = comm
    call mpi_comm_rank(comm, this%rank)
    call mpi_comm_size(comm, this%ranks)
  end subroutine enter

  pure function speaks(this) result(answer)
    class(ranks_t), intent(in) :: this
    logical :: answer

    answer = this%rank == 0
  end function speaks

  function total_real(this, value) result(total)
    class(ranks_t), intent(in) :: this
    real(wp), intent(in) :: value
    real(wp) :: total

    call mpi_allreduce(value, total, 1, mpi_double_precision, mpi_sum, this%comm)
  end function total_real

  function total_count(this, value) result(total)
    class(ranks_t), intent(in) :: this
    integer(i8), intent(in) :: value
    integer(i8) :: total

    call mpi_allreduce(value, total, 1, mpi_integer8, mpi_sum, this%comm)
  end function total_count

  function least(this, value) result(lowest)
    class(ranks_t), intent(in) :: this
    real(wp), intent(in) :: value
    real(wp) :: lowest

    call mpi_allreduce(value, lowest, 1, mpi_double_precision, mpi_min, this%comm)
  end function least

  function most(this, value) result(highest)
    class(ranks_t), intent(in) :: this
    real(wp), intent(in) :: value
    real(wp) :: highest

    call mpi_allreduce(value, highest, 1, mpi_double_precision, mpi_max, this%comm)
  end function most

  function any_of(this, value) result(answer)
    class(ranks_t), intent(in) :: this
    logical, intent(in) :: value
    logical :: answer

    call mpi_allreduce(value, answer, 1, mpi_logical, mpi_lor, this%comm)
  end function any_of

  function before(this, value) result(total)
    class(ranks_t), intent(in) :: this
    integer(i8), intent(in) :: value
    integer(i8) :: total

    total = 0
    call mpi_exscan(value, total, 1, mpi_integer8, mpi_sum, this%comm)
    if (this%rank == 0) total = 0
  end function before

  !> Of several ranks' errors all get that of the first.
  subroutine agree(this, error)
    class(ranks_t), intent(in) :: this
    !> An error or none
    type(error_t), allocatable, intent(inout) :: error
    character(len=:), allocatable :: message
    integer :: own, first, about(2)

    own = this%ranks
    if (allocated(error)) own = this%rank
    call mpi_allreduce(own, first, 1, mpi_integer, mpi_min, this%comm)
    if (first == this%ranks) return
    if (first == this%rank) then
      about = [error%status, len(error%message)]
      message = error%message
    end if
    call mpi_bcast(about, 2, mpi_integer, first, this%comm)
    if (first /= this%rank) allocate (character(len=about(2)) :: message)
    call mpi_bcast(message, about(2), mpi_character, first, this%comm)
    if (allocated(error)) deallocate (error)
    call raise(error, about(1), message)
  end subroutine agree

  subroutine announce(this, sent, received)
    class(ranks_t), intent(in) :: this
    !> Items for each rank, and from each
    integer, intent(in) :: sent(:)
    integer, intent(out) :: received(:)

    call mpi_alltoall(sent, 1, mpi_integer, received, 1, mpi_integer, this%comm)
  end subroutine announce

  subroutine exchange_reals(this, sent, given, received, taken)
    class(ranks_t), intent(in) :: this
    !> How many numbers go to each rank, and these, rank after rank
    integer, intent(in) :: sent(:)
    real(wp), intent(in), contiguous :: given(:)
    !> The same of what comes
    integer, intent(in) :: received(:)
    real(wp), intent(out), contiguous :: taken(:)

    call mpi_alltoallv(given, sent, places(sent), mpi_double_precision, taken, received, &
                       places(received), mpi_double_precision, this%comm)
  end subroutine exchange_reals

  subroutine exchange_counts(this, sent, given, received, taken)
    class(ranks_t), intent(in) :: this
    !> How many numbers go to each rank, and these, rank after rank
    integer, intent(in) :: sent(:)
    integer(int64), intent(in), contiguous :: given(:)
    !> The same of what comes
    integer, intent(in) :: received(:)
    integer(int64), intent(out), contiguous :: taken(:)

    call mpi_alltoallv(given, sent, places(sent), mpi_integer8, taken, received, &
                       places(received), mpi_integer8, this%comm)
  end subroutine exchange_counts

  !> Where the items of each rank begin, from 0
  pure function places(counts) result(place)
    integer, intent(in) :: counts(:)
    integer :: place(size(counts))
    integer :: k

    place(1) = 0
    do k = 2, size(counts)
      place(k) = place(k - 1) + counts(k - 1)
    end do
  end function places

end module calor_ranks
