!> The output file of a run on several ranks, in the layout of calor's files.
!>
!> One rank keeps the file's structure and tells where in the file the values of particles belong;
!> all write their own there, beside each other.
module calor_shared_file
  use, intrinsic :: iso_fortran_env, only: int8, int32, int64
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t, raise, status_bad_file
  use calor_expression, only: expression_t
  use calor_field_file, only: field_file_t, stretches_t
  use calor_heat_budget, only: budget_entry_t, heat_budget_t
  use calor_kinds, only: wp, i8
  use calor_ranks, only: ranks_t
  use calor_row_fields, only: is_row_field
  use calor_scene, only: scene_t
  use calor_scene_changes, only: scene_changes
  use calor_scene_file, only: scene_file_t, parse_scene_text
  use calor_simulation_file, only: write_origin_notes
  use calor_stopwatch, only: phase_t
  use calor_stored_fields, only: stored_fields_t
  use calor_text, only: text_t, to_text
  use calor_user_order, only: user_order_t
  use mpi_f08, only: mpi_bcast, mpi_byte, mpi_character, mpi_file, mpi_file_close, mpi_file_open, &
                     mpi_file_write_at, mpi_info_null, mpi_integer, mpi_integer8, mpi_mode_wronly, &
                     mpi_offset_kind, mpi_status_ignore, mpi_success, mpi_barrier
  implicit none (type, external)
  private

  public :: shared_file_t

  !> Bytes that one call writes at most
  integer, parameter :: most_bytes = 2**30
  !> VTK's number for a cell that is a single point
  integer(int8), parameter :: vertex_cell = 1_int8

  !> The file; where the scene names none, every procedure does nothing
  type :: shared_file_t
    logical :: in_use = .false.
    type(ranks_t), private :: ranks
    type(user_order_t), private :: order
    !> Open on the rank that speaks
    type(field_file_t), private :: file
    type(text_t), allocatable, private :: fields(:)
    character(len=:), allocatable, private :: path
    integer, private :: states = 0
    !> Whether states of an earlier file are on their way: it stays until all are here
    logical, private :: taking_over = .false.
  contains
    !> Create the file with its particles
    procedure :: open => open_file
    !> Write a field that does not change
    procedure :: write_static
    !> Append a state
    procedure :: write_state
    !> Put the file in its place, that of an older one perhaps
    procedure :: publish
    !> Take over the first states of the file that is in its place
    procedure :: take_over
    !> Note a figure or words about the run
    procedure :: note
    procedure :: say
    !> Write the heat budget of all states
    procedure :: write_budget
    !> Note wall times and close
    procedure :: close => close_file
    !> Let go of it after an error
    procedure :: abandon
    procedure, private :: put
    procedure, private :: put_field
    procedure, private :: put_stretch
  end type shared_file_t

contains

  subroutine open_file(this, ranks, scene, cloud, particles, effects, error)
    class(shared_file_t), intent(inout) :: this
    type(ranks_t), intent(in) :: ranks
    type(scene_t), intent(in) :: scene
    !> The particles here, the own ones marked, and how many all ranks have
    type(cloud_t), intent(in) :: cloud
    integer(i8), intent(in) :: particles
    !> What is in force, and why
    type(text_t), intent(in) :: effects(:)
    type(error_t), allocatable, intent(out) :: error
    type(stretches_t) :: points, connectivity, offsets, types, volume, wall
    real(wp), allocatable :: x(:), y(:), values(:)
    integer(i8) :: k
    integer :: more

    this%in_use = scene%output%file /= ''
    if (.not. this%in_use) return
    this%ranks = ranks
    this%fields = scene%output%fields
    this%path = scene%output%file
    call this%order%prepare(ranks, cloud, particles)
    if (ranks%speaks()) call begin_file()
    call ranks%agree(error)
    if (allocated(error)) return
    associate (order => this%order)
      call order%arrange(ranks, cloud%x, x)
      call order%arrange(ranks, cloud%y, y)
      call this%put(points, order%first, 24, &
                    transfer(reshape([x, y, 0*x], [3, size(x)], order=[2, 1]), [0_int8]), error)
      if (allocated(error)) return
      more = merge(1, 0, order%first + order%rows == particles)
      call this%put(connectivity, order%first, 8, &
                    transfer([(k, k=order%first, order%first + order%rows - 1)], [0_int8]), error)
      if (allocated(error)) return
      call this%put(offsets, order%first, 8, &
                    transfer([(k, k=order%first, order%first + order%rows - 1 + more)], [0_int8]), &
                    error)
      if (allocated(error)) return
      call this%put(types, order%first, 1, [(vertex_cell, k=1, order%rows)], error)
      if (allocated(error)) return
      call order%arrange(ranks, cloud%volume, values)
      call this%put(volume, order%first, 8, transfer(values, [0_int8]), error)
      if (allocated(error)) return
      call order%arrange(ranks, merge(1.0_wp, 0.0_wp, cloud%side /= 0), values)
      call this%put(wall, order%first, 4, transfer(nint(values, int32), [0_int8]), error)
    end associate

  contains

    subroutine begin_file()
      call this%file%create_for_others(scene%output%file, int(particles), points, connectivity, &
                                       offsets, types, error)
      if (.not. allocated(error)) call this%file%place_static('volume', .false., volume, error)
      if (.not. allocated(error)) call this%file%place_static('wall', .true., wall, error)
      if (.not. allocated(error)) call write_origin_notes(this%file, scene, cloud%spacing, error)
      if (.not. allocated(error)) call this%file%set_attribute('effects', effects, error)
      if (.not. allocated(error)) call this%file%flush(error)
    end subroutine begin_file

  end subroutine open_file

  subroutine write_static(this, name, values, error)
    class(shared_file_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    !> One for each particle here
    real(wp), intent(in) :: values(:)
    type(error_t), allocatable, intent(out) :: error
    type(stretches_t) :: stretches
    real(wp), allocatable :: arranged(:)

    if (.not. this%in_use) return
    if (this%ranks%speaks()) call this%file%place_static(name, .false., stretches, error)
    call this%ranks%agree(error)
    if (allocated(error)) return
    call this%order%arrange(this%ranks, values, arranged)
    call this%put(stretches, this%order%first, 8, transfer(arranged, [0_int8]), error)
  end subroutine write_static

  !> Write rows, each rank its own, where the rank that speaks says.
  subroutine put(this, stretches, first, bytes, values, error)
    class(shared_file_t), intent(inout) :: this
    !> Where they belong; known to the rank that speaks
    type(stretches_t), intent(inout) :: stretches
    !> Rows before this rank's
    integer(i8), intent(in) :: first
    !> Bytes of a row, and those of all of this rank's
    integer, intent(in) :: bytes
    integer(int8), intent(in), contiguous :: values(:)
    type(error_t), allocatable, intent(out) :: error
    type(mpi_file) :: handle
    character(len=:), allocatable :: path
    integer(i8) :: row, last, ahead
    integer :: sizes(2), k, failed, rows

    if (this%ranks%speaks()) then
      path = this%file%present_path()
      sizes = [size(stretches%address), len(path)]
    end if
    call mpi_bcast(sizes, 2, mpi_integer, 0, this%ranks%comm)
    if (.not. this%ranks%speaks()) then
      allocate (stretches%start(sizes(1) + 1), stretches%address(sizes(1)))
      allocate (character(len=sizes(2)) :: path)
    end if
    call mpi_bcast(stretches%start, sizes(1) + 1, mpi_integer8, 0, this%ranks%comm)
    call mpi_bcast(stretches%address, sizes(1), mpi_integer8, 0, this%ranks%comm)
    call mpi_bcast(path, sizes(2), mpi_character, 0, this%ranks%comm)
    call mpi_file_open(this%ranks%comm, path, mpi_mode_wronly, mpi_info_null, handle, failed)
    if (failed == mpi_success) then
      row = first
      last = first + size(values)/bytes
      do k = 1, sizes(1)
        do while (row >= stretches%start(k) .and. row < min(last, stretches%start(k + 1)))
          rows = int(min(min(last, stretches%start(k + 1)) - row, int(most_bytes/bytes, i8)))
          ahead = (row - first)*bytes
          call mpi_file_write_at(handle, int(stretches%address(k) + &
                                             bytes*(row - stretches%start(k)), mpi_offset_kind), &
                                 values(ahead + 1:ahead + int(rows, i8)*bytes), rows*bytes, &
                                 mpi_byte, mpi_status_ignore, failed)
          if (failed /= mpi_success) exit
          row = row + rows
        end do
        if (failed /= mpi_success) exit
      end do
      call mpi_file_close(handle)
    end if
    if (failed /= mpi_success) then
      call raise(error, status_bad_file, 'The output file '''//path//''' could not be written.')
    end if
    call this%ranks%agree(error)
    deallocate (stretches%start, stretches%address)
  end subroutine put

  subroutine write_state(this, cloud, time, temperature, exact, error, liquid_fraction)
    class(shared_file_t), intent(inout) :: this
    type(cloud_t), intent(in) :: cloud
    !> Time, s, temperatures, and how much of each particle is liquid (empty: nothing melts)
    real(wp), intent(in) :: time, temperature(:)
    !> The true temperature; used only for fields that need it
    type(expression_t), intent(in) :: exact
    type(error_t), allocatable, intent(out) :: error
    real(wp), intent(in) :: liquid_fraction(:)
    real(wp), allocatable :: truth(:)
    integer :: k

    if (.not. this%in_use) return
    if (this%ranks%speaks()) call this%file%begin_step(time, error)
    call this%ranks%agree(error)
    if (allocated(error)) return
    do k = 1, size(this%fields)
      select case (this%fields(k)%value)
      case ('temperature')
        call this%put_field('temperature', temperature, error)
      case ('liquid_fraction')
        if (size(liquid_fraction) > 0) then
          call this%put_field('liquid_fraction', liquid_fraction, error)
        end if
      case ('exact', 'error')
        if (.not. allocated(truth)) then
          allocate (truth(size(temperature)))
          call exact%evaluate(cloud%x, cloud%y, time, values=truth)
        end if
        if (this%fields(k)%value == 'exact') then
          call this%put_field('exact', truth, error)
        else
          call this%put_field('error', temperature - truth, error)
        end if
      case default
        continue
      end select
      if (allocated(error)) return
    end do
    call complete_state(this, error)
  end subroutine write_state

  subroutine complete_state(this, error)
    class(shared_file_t), intent(inout) :: this
    type(error_t), allocatable, intent(out) :: error

    this%states = this%states + 1
    if (this%ranks%speaks()) call this%file%flush(error)
    call this%ranks%agree(error)
    ! A second state: the run works, so the file takes its place, that of an older one perhaps.
    if (allocated(error) .or. this%states /= 2 .or. this%taking_over) return
    call this%publish(error)
  end subroutine complete_state

  subroutine publish(this, error)
    class(shared_file_t), intent(inout) :: this
    !> It cannot be put in its place; on all ranks the same
    type(error_t), allocatable, intent(out) :: error

    if (.not. this%in_use .or. this%states == 0) return
    if (this%ranks%speaks()) call this%file%publish(error)
    call this%ranks%agree(error)
  end subroutine publish

  !> A rank reads and writes its stretch of particles, a field at a time.
  subroutine take_over(this, scene_text, time, error)
    class(shared_file_t), intent(inout) :: this
    !> The scene of the earlier run, and the times of its states that belong here, s
    character(len=*), intent(in) :: scene_text
    real(wp), intent(in) :: time(:)
    !> They are not there, or cannot be written; on all ranks the same
    type(error_t), allocatable, intent(out) :: error
    type(stored_fields_t) :: earlier
    real(wp), allocatable :: values(:)
    integer :: state, k

    if (.not. this%in_use) return
    call open_earlier()
    this%taking_over = .true.
    do state = 1, size(time)
      if (allocated(error)) exit
      if (this%ranks%speaks()) call this%file%begin_step(time(state), error)
      call this%ranks%agree(error)
      do k = 1, size(this%fields)
        if (allocated(error)) exit
        if (is_row_field(this%fields(k)%value)) cycle
        if (.not. earlier%has(this%fields(k)%value)) cycle
        call earlier%read_field(this%fields(k)%value, state, values, error, &
                                skip=this%order%first, rows=this%order%rows)
        call this%ranks%agree(error)
        if (.not. allocated(error)) call this%put_stretch(this%fields(k)%value, values, error)
      end do
      if (.not. allocated(error)) call complete_state(this, error)
    end do
    call earlier%close()
    this%taking_over = .false.
    if (.not. allocated(error) .and. size(time) > 1) call this%publish(error)

  contains

    subroutine open_earlier()
      type(scene_file_t) :: before, last
      type(error_t), allocatable :: unreadable
      logical :: fits

      inquire (file=this%path, exist=fits)
      if (fits) call earlier%open(this%path, unreadable)
      fits = fits .and. .not. allocated(unreadable)
      if (fits) fits = size(earlier%time) >= size(time)
      if (fits) fits = .not. any(abs(earlier%time(:size(time)) - time) > 0)
      if (fits) then
        call parse_scene_text(scene_text, 'scene', before, unreadable)
        if (.not. allocated(unreadable)) then
          call parse_scene_text(earlier%note('scene'), 'scene', last, unreadable)
        end if
        fits = .not. allocated(unreadable)
      end if
      if (fits) fits = size(scene_changes(before, last)) == 0
      if (.not. fits) then
        call raise(error, status_bad_file, 'The output file '''//this%path// &
                   ''' does not hold the '//to_text(size(time))//' states that belong to the '// &
                   'checkpoint: put it back, or name another &output file for the states from '// &
                   'here on.')
      end if
      call this%ranks%agree(error)
    end subroutine open_earlier

  end subroutine take_over

  subroutine put_field(this, name, values, error)
    class(shared_file_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    real(wp), intent(in) :: values(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: arranged(:)

    call this%order%arrange(this%ranks, values, arranged)
    call this%put_stretch(name, arranged, error)
  end subroutine put_field

  !> A field of this rank's stretch.
  subroutine put_stretch(this, name, values, error)
    class(shared_file_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    real(wp), intent(in) :: values(:)
    type(error_t), allocatable, intent(out) :: error
    type(stretches_t) :: stretches

    if (this%ranks%speaks()) call this%file%place_field(name, stretches, error)
    call this%ranks%agree(error)
    if (allocated(error)) return
    call this%put(stretches, this%order%first, 8, transfer(values, [0_int8]), error)
  end subroutine put_stretch

  subroutine note(this, name, value)
    class(shared_file_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    real(wp), intent(in) :: value
    type(error_t), allocatable :: error

    ! What fails here fails again on closing.
    if (this%in_use .and. this%ranks%speaks()) call this%file%set_attribute(name, value, error)
  end subroutine note

  subroutine say(this, name, value)
    class(shared_file_t), intent(inout) :: this
    character(len=*), intent(in) :: name, value
    type(error_t), allocatable :: error

    if (this%in_use .and. this%ranks%speaks()) call this%file%set_attribute(name, value, error)
  end subroutine say

  !> One data set for each account, of one number for each state.
  subroutine write_budget(this, budget, entries)
    class(shared_file_t), intent(inout) :: this
    !> How the budget is made up, and those of the states
    type(heat_budget_t), intent(in) :: budget
    type(budget_entry_t), intent(in) :: entries(:)
    type(error_t), allocatable :: error
    integer :: j, k

    if (.not. (this%in_use .and. this%ranks%speaks())) return
    ! What fails here fails again on closing.
    call this%file%write_series('budget_time', entries%time, error)
    call this%file%write_series('budget_stored', entries%stored, error)
    if (.not. budget%available) return
    call this%file%write_series('budget_stored_rate', entries%stored_rate, error)
    do k = 1, size(budget%account)
      call this%file%write_series('budget_'//budget%account(k)%value, &
                                  [(entries(j)%power(k), j=1, size(entries))], error)
    end do
    call this%file%write_series('budget_imbalance', entries%imbalance, error)
  end subroutine write_budget

  subroutine close_file(this, phases, error)
    class(shared_file_t), intent(inout) :: this
    !> Wall time by phase
    type(phase_t), intent(in) :: phases(:)
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    if (.not. this%in_use) return
    if (this%ranks%speaks()) then
      do k = 1, size(phases)
        if (allocated(error)) exit
        call this%file%set_wall_time(trim(phases(k)%name), phases(k)%seconds, error)
      end do
      if (.not. allocated(error)) call this%file%close(error)
    end if
    call this%ranks%agree(error)
  end subroutine close_file

  subroutine abandon(this)
    class(shared_file_t), intent(inout) :: this

    if (this%in_use .and. this%ranks%speaks()) call this%file%discard()
  end subroutine abandon

end module calor_shared_file
