!> Numbers of particles in a file, one column after the other, each in the user's order.
!>
!> A rank writes and reads a stretch of each column, so that none holds the whole. The file consists
!> of 8 bytes a number and nothing else; what it is said to be, and the checksum of what each of the
!> ranks wrote, is kept by its owner.
module calor_particle_columns
  use, intrinsic :: iso_fortran_env, only: int8
  use calor_checksum, only: checksum_t
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t, raise, status_bad_file
  use calor_kinds, only: wp, i8
  use calor_ranks, only: ranks_t
  use calor_user_order, only: user_order_t
  use mpi_f08, only: mpi_allgather, mpi_byte, mpi_file, mpi_file_close, mpi_file_get_size, &
                     mpi_file_open, mpi_file_read_at, mpi_file_set_size, mpi_file_sync, &
                     mpi_file_write_at, mpi_info_null, mpi_integer, mpi_integer8, &
                     mpi_mode_create, mpi_mode_rdonly, mpi_mode_wronly, mpi_offset_kind, &
                     mpi_status_ignore, mpi_success
  implicit none (type, external)
  private

  public :: particle_columns_t

  integer, parameter :: bytes = 8
  !> Numbers that one call reads or writes at most
  integer, parameter :: most_numbers = 2**20

  type :: particle_columns_t
    type(ranks_t), private :: ranks
    type(user_order_t), private :: order
    type(mpi_file), private :: file
    character(len=:), allocatable, private :: path
    logical, private :: is_open = .false.
    !> Numbers of a column, and columns so far
    integer(i8), private :: particles = 0
    integer, private :: columns = 0
    type(checksum_t), private :: checksum
    !> Numbers in the stretch of each rank that wrote the file, and their checksums, all columns'
    integer, allocatable :: written(:)
    integer(i8), allocatable :: sum(:)
  contains
    !> Begin a file
    procedure :: create
    !> Write a column
    procedure :: add
    !> Wait until all is on the disk, and learn the checksums
    procedure :: finish
    !> Open one whose ranks' numbers and checksums are known, and make sure that it is whole
    procedure :: open => open_columns
    !> Read a column
    procedure :: read => read_column
    !> Let go of it
    procedure :: close => close_columns
    procedure, private :: open_file
    procedure, private :: fail
    procedure, private :: check_stretches
  end type particle_columns_t

contains

  subroutine create(this, path, ranks, cloud, particles, error)
    class(particle_columns_t), intent(inout) :: this
    !> The file; one that was there is lost
    character(len=*), intent(in) :: path
    type(ranks_t), intent(in) :: ranks
    !> The particles here, the own ones marked, and how many all ranks have
    type(cloud_t), intent(in) :: cloud
    integer(i8), intent(in) :: particles
    !> It cannot be written; on all ranks the same
    type(error_t), allocatable, intent(out) :: error
    integer :: failed

    call this%open_file(path, ranks, cloud, particles, failed, writing=.true.)
    if (failed == mpi_success) call mpi_file_set_size(this%file, 0_mpi_offset_kind, failed)
    call this%fail(failed, 'written', error)
  end subroutine create

  subroutine open_file(this, path, ranks, cloud, particles, failed, writing)
    class(particle_columns_t), intent(inout) :: this
    character(len=*), intent(in) :: path
    type(ranks_t), intent(in) :: ranks
    type(cloud_t), intent(in) :: cloud
    integer(i8), intent(in) :: particles
    integer, intent(out) :: failed
    logical, intent(in) :: writing
    integer :: mode

    this%ranks = ranks
    this%path = path
    this%particles = particles
    call this%order%prepare(ranks, cloud, particles)
    mode = mpi_mode_rdonly
    if (writing) mode = ior(mpi_mode_wronly, mpi_mode_create)
    call mpi_file_open(ranks%comm, path, mode, mpi_info_null, this%file, failed)
    this%is_open = failed == mpi_success
  end subroutine open_file

  subroutine add(this, values, error)
    class(particle_columns_t), intent(inout) :: this
    !> One number for each particle here
    real(wp), intent(in) :: values(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: arranged(:)
    integer(int8), allocatable :: piece(:)
    integer :: done, count, failed

    call this%order%arrange(this%ranks, values, arranged)
    failed = mpi_success
    done = 0
    do while (done < size(arranged) .and. failed == mpi_success)
      count = min(size(arranged) - done, most_numbers)
      piece = transfer(arranged(done + 1:done + count), [0_int8])
      call this%checksum%add(piece)
      call mpi_file_write_at(this%file, place_of(this, this%columns, this%order%first + done), &
                             piece, size(piece), mpi_byte, mpi_status_ignore, failed)
      done = done + count
    end do
    this%columns = this%columns + 1
    call this%fail(failed, 'written', error)
  end subroutine add

  !> Where in the file a number is
  pure function place_of(this, column, row) result(place)
    type(particle_columns_t), intent(in) :: this
    !> Both counted from 0
    integer, intent(in) :: column
    integer(i8), intent(in) :: row
    integer(mpi_offset_kind) :: place

    place = int(bytes*(column*this%particles + row), mpi_offset_kind)
  end function place_of

  subroutine finish(this, error)
    class(particle_columns_t), intent(inout) :: this
    type(error_t), allocatable, intent(out) :: error
    integer :: failed

    call mpi_file_sync(this%file, failed)
    call this%close()
    call this%fail(failed, 'written', error)
    allocate (this%written(this%ranks%ranks), this%sum(this%ranks%ranks))
    call mpi_allgather(this%order%rows, 1, mpi_integer, this%written, 1, mpi_integer, &
                       this%ranks%comm)
    call mpi_allgather(this%checksum%value(), 1, mpi_integer8, this%sum, 1, mpi_integer8, &
                       this%ranks%comm)
  end subroutine finish

  subroutine open_columns(this, path, columns, ranks, cloud, particles, error)
    class(particle_columns_t), intent(inout) :: this
    !> The file, and how many columns it has
    character(len=*), intent(in) :: path
    integer, intent(in) :: columns
    type(ranks_t), intent(in) :: ranks
    !> The particles here, the own ones marked, and how many all ranks have
    type(cloud_t), intent(in) :: cloud
    integer(i8), intent(in) :: particles
    !> It cannot be read, or is damaged; on all ranks the same
    type(error_t), allocatable, intent(out) :: error
    integer(mpi_offset_kind) :: length
    integer :: failed
    logical :: whole

    call this%open_file(path, ranks, cloud, particles, failed, writing=.false.)
    this%columns = columns
    call this%fail(failed, 'read', error)
    if (allocated(error)) return
    call mpi_file_get_size(this%file, length, failed)
    whole = length == bytes*columns*particles .and. &
            sum(int(this%written, i8)) == particles .and. size(this%written) == size(this%sum)
    if (whole) call this%check_stretches(whole)
    if (.not. whole) then
      call raise(error, status_bad_file, 'The file '''//path//''', which belongs to the '// &
                 'checkpoint, is damaged: what is in it is not what was written.')
    end if
    call ranks%agree(error)
    if (allocated(error)) call this%close()
  end subroutine open_columns

  !> What other ranks wrote is looked through by turns.
  subroutine check_stretches(this, whole)
    class(particle_columns_t), intent(inout) :: this
    !> Whether those that fall to this rank are as they were
    logical, intent(out) :: whole
    type(checksum_t) :: checksum
    type(checksum_t), parameter :: empty = checksum_t()
    integer(int8), allocatable :: piece(:)
    integer(i8) :: first
    integer :: writer, column, done, count, failed

    whole = .true.
    first = 0
    do writer = 1, size(this%written)
      if (mod(writer - 1, this%ranks%ranks) == this%ranks%rank) then
        checksum = empty
        do column = 0, this%columns - 1
          done = 0
          do while (done < this%written(writer))
            count = min(this%written(writer) - done, most_numbers)
            allocate (piece(bytes*count))
            call mpi_file_read_at(this%file, place_of(this, column, first + done), piece, &
                                  size(piece), mpi_byte, mpi_status_ignore, failed)
            whole = whole .and. failed == mpi_success
            call checksum%add(piece)
            deallocate (piece)
            done = done + count
          end do
        end do
        whole = whole .and. checksum%value() == this%sum(writer)
      end if
      first = first + this%written(writer)
    end do
  end subroutine check_stretches

  subroutine read_column(this, column, values, error)
    class(particle_columns_t), intent(inout) :: this
    !> Which one, from 1
    integer, intent(in) :: column
    !> One number for each particle here; only those of own ones are set
    real(wp), intent(inout) :: values(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: arranged(:)
    integer :: done, count, failed

    allocate (arranged(this%order%rows))
    failed = mpi_success
    done = 0
    do while (done < size(arranged) .and. failed == mpi_success)
      count = min(size(arranged) - done, most_numbers)
      call mpi_file_read_at(this%file, place_of(this, column - 1, this%order%first + done), &
                            arranged(done + 1:done + count), bytes*count, mpi_byte, &
                            mpi_status_ignore, failed)
      done = done + count
    end do
    call this%fail(failed, 'read', error)
    if (.not. allocated(error)) call this%order%distribute(this%ranks, arranged, values)
  end subroutine read_column

  subroutine close_columns(this)
    class(particle_columns_t), intent(inout) :: this

    if (this%is_open) call mpi_file_close(this%file)
    this%is_open = .false.
  end subroutine close_columns

  !> What failed on one rank has failed.
  subroutine fail(this, failed, what, error)
    class(particle_columns_t), intent(inout) :: this
    integer, intent(in) :: failed
    character(len=*), intent(in) :: what
    type(error_t), allocatable, intent(out) :: error

    if (failed /= mpi_success) then
      call raise(error, status_bad_file, 'The file '''//this%path//''', which belongs to the '// &
                 'checkpoint, could not be '//what//'.')
    end if
    call this%ranks%agree(error)
    if (allocated(error)) call this%close()
  end subroutine fail

end module calor_particle_columns
