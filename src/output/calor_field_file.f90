!> The output file: particles and their fields over time as VTKHDF, which ParaView and VTK open.
!>
!> Cells (one vertex per particle) are stored once, and so are places unless particles move; each
!> step appends the fields, and the places, that it writes, and tables in group `Steps` say where
!> its values begin.
!> The format is https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format (version 2.0).
!> Beside it, group `/calor` holds metadata as attributes, and `/calor/wall_time` the time that
!> each phase of the run took; all else in the files of two equal runs is the same byte for byte.
!>
!> A file of the same name is not lost when a run fails early: writing goes to a temporary file in
!> the same folder, which takes the name of the target by `publish` (or at last by `close`).
!>
!>     call file%create('plate.vtkhdf', x, y, error)
!>     call file%add_static('volume', volume, error)
!>     call file%begin_step(0.0_wp, error)
!>     call file%write_field('temperature', temperature, error)
!>     call file%publish(error)
!>     ...
!>     call file%close(error)
!>
!> HDF5 does not recover from a write that fails. So room on the disk is reserved before anything is
!> written: where there is none left, a published file keeps all the steps that are complete.
!>
!> Every failure is an error of status `status_bad_file` with one sentence for the user.
module calor_field_file
  use, intrinsic :: iso_c_binding, only: c_ptr, c_loc, c_int, c_int64_t
  use, intrinsic :: iso_fortran_env, only: int8, int32
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use calor_c_text, only: to_c
  use calor_error, only: error_t, raise, status_bad_file
  use calor_file_system, only: look_at_path, path_missing, path_file, path_folder, &
                               path_unreachable, parent_folder, resolved_path, write_obstacle, &
                               rename_file, remove_file, link_file, try_writing, reserve_space, &
                               cut_file
  use calor_hdf5, only: start_hdf5, hdf5_silence_t, hdf5_reason, hdf5_descriptor
  use calor_kinds, only: wp, i8
  use calor_text, only: text_t, to_text
  use hdf5, only: hid_t, hsize_t, size_t, h5kind_to_type, h5d_alloc_time_early_f, &
                  h5d_fill_time_never_f, h5dget_offset_f, h5pset_alloc_time_f, h5pset_fill_time_f, &
                  h5_integer_kind, h5_real_kind, h5f_acc_trunc_f, h5f_close_strong_f, &
                  h5f_scope_local_f, h5p_dataset_create_f, h5p_file_access_f, &
                  h5p_file_create_f, h5p_group_create_f, h5s_scalar_f, h5s_select_set_f, &
                  h5s_unlimited_f, h5t_cset_utf8_f, h5t_fortran_s1, h5t_ieee_f64le, h5t_std_i32le, &
                  h5t_std_i64le, h5t_std_u8le, h5t_str_nullpad_f, h5t_string, &
                  h5aclose_f, h5acreate_f, h5adelete_f, h5aexists_f, h5awrite_f, &
                  h5dclose_f, h5dcreate_f, h5dget_space_f, h5dset_extent_f, h5dwrite_f, &
                  h5fclose_f, h5fcreate_f, h5fflush_f, h5fget_filesize_f, h5gclose_f, h5gcreate_f, &
                  h5pclose_f, h5pcreate_f, h5pset_chunk_f, h5pset_fapl_sec2_f, &
                  h5pset_fclose_degree_f, h5pset_file_locking_f, h5pset_obj_track_times_f, &
                  h5sclose_f, h5screate_f, h5screate_simple_f, h5sselect_hyperslab_f, &
                  h5tclose_f, h5tcopy_f, h5tset_cset_f, h5tset_size_f, h5tset_strpad_f
  implicit none (type, external)
  private

  public :: field_file_t, check_place, stretches_t

  !> The tables of group `Steps` with one whole number a step, all zero but `NumberOfParts`
  character(len=*), parameter :: step_tables(*) = [character(len=21) :: &
                                                   'PartOffsets', 'NumberOfParts', 'PointOffsets', &
                                                   'CellOffsets', 'ConnectivityIdOffsets']
  integer(i8), parameter :: step_entries(*) = [0_i8, 1_i8, 0_i8, 0_i8, 0_i8]
  !> Which of them says where places begin
  integer, parameter :: place_table = 3

  !> Room for HDF5's own records (indices, headers, heaps): in all, beside what is written in one
  !> call and in one table of the steps, and beside a text; bytes
  integer(i8), parameter :: room_for_records = 65536_i8, room_for_table = 8192_i8, &
                            room_per_text = 64_i8

  !> VTK's number for a cell that is a single point
  integer(int8), parameter :: vertex_cell = 1_int8

  !> Rows of a chunk in the tables of the steps
  integer, parameter :: table_chunk = 128

  !> What a point data set holds
  integer, parameter :: holds_reals = 1, holds_integers = 2

  !> One point data set of the file
  type :: point_data_t
    character(len=:), allocatable :: name
    !> `holds_reals` or `holds_integers`
    integer :: content = holds_reals
    !> 1 for a scalar, 3 for a vector
    integer :: components = 1
    !> Whether it is stored once, for all steps
    logical :: static = .false.
    !> The step that wrote it last
    integer :: last_step = 0
    !> Rows stored so far
    integer(i8) :: rows = 0
    integer(hid_t) :: dataset = -1
    !> The table of the row at which each step begins
    integer(hid_t) :: offsets = -1
  end type point_data_t

  !> Where rows lie in the file, for several processes that write them beside each other: those from
  !> start(k) on, up to before start(k + 1), are one after another from address(k) on
  type :: stretches_t
    !> Rows from 0, one more than there are stretches, and bytes from 0
    integer(i8), allocatable :: start(:), address(:)
  end type stretches_t

  interface
    function h5dget_chunk_info_by_coord(dataset, offset, filters, address, size) result(status) &
        bind(c, name='H5Dget_chunk_info_by_coord')
      import :: c_int64_t, c_int
      implicit none (type, external)
      integer(c_int64_t), intent(in), value :: dataset
      integer(c_int64_t), intent(in) :: offset(1)
      integer(c_int), intent(out) :: filters
      integer(c_int64_t), intent(out) :: address, size
      integer(c_int) :: status
    end function h5dget_chunk_info_by_coord
  end interface

  !> An output file, from `create` to `close` or `discard`
  type :: field_file_t
    private
    !> The name as the user gave it
    character(len=:), allocatable :: path
    !> Where the file goes in the end
    character(len=:), allocatable :: target_path
    !> Where it is written until it is published
    character(len=:), allocatable :: temporary_path
    logical :: is_open = .false.
    logical :: is_published = .false.
    !> What went wrong, if a write failed: such a file is never published
    character(len=:), allocatable :: failure
    integer :: particles = 0
    !> Whether others write what belongs to particles, into the stretches that are handed out
    logical :: written_by_others = .false.
    !> Steps begun
    integer :: steps = 0
    !> Steps that are whole and counted in the file
    integer :: whole_steps = 0
    type(point_data_t), allocatable :: point_data(:)
    !> The places of particles that move, and how many steps have written theirs
    integer(hid_t) :: points = -1
    integer(i8) :: sets_of_places = 0
    !> The step that wrote places last
    integer :: last_places = 0
    !> Room reserved since the last flush, bytes
    integer(i8) :: unflushed = 0
    !> The system's number of the file
    integer :: descriptor = -1
    integer(hid_t) :: file_id = -1
    integer(hid_t) :: vtk_group = -1
    integer(hid_t) :: point_data_group = -1
    integer(hid_t) :: steps_group = -1
    integer(hid_t) :: offsets_group = -1
    integer(hid_t) :: calor_group = -1
    integer(hid_t) :: wall_time_group = -1
    integer(hid_t) :: times = -1
    integer(hid_t) :: tables(size(step_tables)) = -1
  contains
    !> Begin a file with its particles
    procedure :: create
    !> Begin a file whose particles and fields others write
    procedure :: create_for_others
    !> Add point data of a step, or of all, that others write
    procedure :: place_field
    procedure :: place_static
    !> The name under which the file is to be found now
    procedure :: present_path
    !> Add point data that are the same in every step
    generic :: add_static => add_static_reals, add_static_integers
    !> Begin the next step
    procedure :: begin_step
    !> Write the places of the step, where particles move
    procedure :: write_places
    !> Write point data of the step: reals, integers, or the x and y components of a vector
    generic :: write_field => write_reals, write_vectors, write_integers
    !> Set an attribute of group `/calor`: a text of any length, texts, a number or reals
    generic :: set_attribute => set_text, set_texts, set_real, set_reals, set_integer
    !> Set an attribute of group `/calor/wall_time`
    procedure :: set_wall_time
    !> Write a list of numbers into the group /calor
    procedure :: write_series
    !> Complete the step and bring all that was written to the disk
    procedure :: flush => flush_file
    !> Give the file its final name; writing goes on
    procedure :: publish
    !> Change names with another copy of the same file that has the final name
    procedure :: exchange_with
    !> Complete the file, publish it if that has not been done, and let go of it
    procedure :: close => close_file
    !> Let go of the file, and remove it unless it is published
    procedure :: discard
    procedure, private :: add_static_reals, add_static_integers
    procedure, private :: write_reals, write_vectors, write_integers
    procedure, private :: set_text, set_texts, set_real, set_reals, set_integer
    procedure, private :: fail, ready, reserve
  end type field_file_t

contains

  ! ---------------------------------------------------------------------------------------------
  ! The life of a file
  ! ---------------------------------------------------------------------------------------------

  !> Begin a file with its particles. What is at `path`, if anything, stays there until `publish`.
  subroutine create(this, path, x, y, error, moving, suffix, for_others)
    class(field_file_t), intent(out) :: this
    !> The name of the file; its folder must exist
    character(len=*), intent(in) :: path
    !> Coordinates of the particles, m
    real(wp), intent(in) :: x(:), y(:)
    !> Why the file cannot be written, in words for the user
    type(error_t), allocatable, intent(out) :: error
    !> Whether steps may have places of their own; those given are those of the first step then
    logical, intent(in), optional :: moving
    !> What the file is called beside its target until it is published; without it '.partial'
    character(len=*), intent(in), optional :: suffix
    !> Only for `create_for_others`: how many particles there are, of which nothing is written
    integer, intent(in), optional :: for_others
    !> A place, a cell's type and its entries in two tables
    integer(i8), parameter :: bytes_per_particle = 3*8 + 1 + 2*8
    type(hdf5_silence_t) :: silence
    character(len=:), allocatable :: reason
    integer :: status
    logical :: growing

    growing = .false.
    if (present(moving)) growing = moving
    this%path = trim(path)
    this%particles = size(x)
    this%written_by_others = present(for_others)
    if (present(for_others)) this%particles = for_others
    allocate (this%point_data(0))
    call check_place(this%path, error)
    if (allocated(error)) return
    ! A link keeps pointing to where the user wants the data: the file behind it is replaced.
    this%target_path = resolved_path(this%path)
    this%temporary_path = this%target_path//'.partial'
    if (present(suffix)) this%temporary_path = this%target_path//suffix

    ! HDF5 needs some room even to begin a file and give it up again.
    call try_writing(this%temporary_path, room_for_records, reason)
    if (reason /= '') then
      call this%fail(reason, error)
      call remove_file(this%temporary_path, reason)
      return
    end if

    call silence%begin()
    call start_hdf5(status)
    if (status >= 0) call open_new_file(this%temporary_path, this%file_id, status)
    this%is_open = status >= 0
    if (status >= 0) call hdf5_descriptor(this%file_id, this%descriptor, status)
    if (status < 0) call this%fail(hdf5_reason(), error)
    if (.not. allocated(error)) call this%reserve(bytes_per_particle*this%particles, error)
    if (.not. allocated(error)) then
      call write_frame(this, status)
      if (status >= 0 .and. .not. this%written_by_others) then
        call write_particles(this, x, y, growing, status)
      end if
      if (status < 0) call this%fail(hdf5_reason(), error)
    end if
    call silence%finish()
    if (allocated(error)) call this%discard()
  end subroutine create

  !> The same, but that nothing is written of the particles. Each has three reals in `points`, a
  !> whole number of 8 bytes in `connectivity` and in `offsets`, which have one more, and a byte
  !> in `types`.
  subroutine create_for_others(this, path, particles, points, connectivity, offsets, types, error)
    class(field_file_t), intent(inout) :: this
    !> The name of the file; its folder must exist
    character(len=*), intent(in) :: path
    !> How many particles there are
    integer, intent(in) :: particles
    type(stretches_t), intent(out) :: points, connectivity, offsets, types
    !> Why the file cannot be written
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_silence_t) :: silence
    real(wp) :: nowhere(0)
    integer :: status

    call this%create(path, nowhere, nowhere, error, for_others=particles)
    if (allocated(error)) return
    call silence%begin()
    associate (n => int(particles, hsize_t), group => this%vtk_group)
      call put_counts(this, status)
      if (status >= 0) call place_dataset(group, 'Points', h5t_ieee_f64le, [3_hsize_t, n], points, &
                                          status)
      if (status >= 0) call place_dataset(group, 'Connectivity', h5t_std_i64le, [n], &
                                          connectivity, status)
      if (status >= 0) call place_dataset(group, 'Offsets', h5t_std_i64le, [n + 1], offsets, status)
      if (status >= 0) call place_dataset(group, 'Types', h5t_std_u8le, [n], types, status)
    end associate
    if (status < 0) call this%fail(hdf5_reason(), error)
    call silence%finish()
    if (allocated(error)) call this%discard()
  end subroutine create_for_others

  !> Add point data of one number for each particle, the same in every step.
  subroutine place_static(this, name, whole_numbers, stretches, error)
    class(field_file_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    !> Whether they are integers, of 4 bytes, or else reals
    logical, intent(in) :: whole_numbers
    type(stretches_t), intent(out) :: stretches
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_silence_t) :: silence
    integer(hsize_t) :: address
    integer :: position, status

    if (.not. this%ready(error)) return
    call silence%begin()
    call this%reserve(8_i8*this%particles, error)
    if (.not. allocated(error)) then
      call add_point_data(this, name, merge(holds_integers, holds_reals, whole_numbers), &
                          components=1, static=.true., position=position, status=status)
      if (status >= 0) call h5dget_offset_f(this%point_data(position)%dataset, address, status)
      stretches%start = [0_i8, int(this%particles, i8)]
      stretches%address = [int(address, i8)]
      if (status < 0) call this%fail(hdf5_reason(), error)
    end if
    call silence%finish()
  end subroutine place_static

  !> Add a real for each particle and this step. Every step has to have all of its fields.
  subroutine place_field(this, name, stretches, error)
    class(field_file_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    type(stretches_t), intent(out) :: stretches
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_silence_t) :: silence
    integer(i8), target :: start
    integer :: position, status

    if (.not. this%ready(error)) return
    position = place_of(this%point_data, name)
    call silence%begin()
    call this%reserve(8_i8*(this%particles + rows_per_chunk(this%particles)), error)
    if (.not. allocated(error)) then
      status = 0
      if (position == 0) call add_point_data(this, name, holds_reals, 1, static=.false., &
                                             position=position, status=status)
      associate (data => this%point_data(position))
        start = data%rows
        data%rows = start + this%particles
        data%last_step = this%steps
        if (status >= 0) call h5dset_extent_f(data%dataset, [int(data%rows, hsize_t)], status)
        if (status >= 0) call find_chunks(data%dataset, start, int(this%particles, i8), &
                                          rows_per_chunk(this%particles), stretches, status)
        if (status >= 0) call put_rows(data%offsets, h5kind_to_type(i8, h5_integer_kind), 1, &
                                       int(this%steps - 1, i8), 1_i8, c_loc(start), status)
      end associate
      if (status < 0) call this%fail(hdf5_reason(), error)
    end if
    call silence%finish()
  end subroutine place_field

  pure function present_path(this) result(path)
    class(field_file_t), intent(in) :: this
    character(len=:), allocatable :: path

    path = this%temporary_path
    if (this%is_published) path = this%target_path
  end function present_path

  !> Give the file its final name, in place of any file of that name; writing goes on.
  subroutine publish(this, error)
    class(field_file_t), intent(inout) :: this
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: reason

    call this%flush(error)
    if (allocated(error) .or. this%is_published) return
    call rename_file(this%temporary_path, this%target_path, reason)
    if (reason /= '') then
      call raise(error, status_bad_file, 'The output file '''//this%path// &
                 ''' could not be put in its place: '//reason//'.')
      return
    end if
    this%is_published = .true.
  end subroutine publish

  !> Change names with another copy of the same file that has the final name. At every moment one of
  !> them has it, and both have one.
  subroutine exchange_with(this, other, exchanged, error)
    class(field_file_t), intent(inout) :: this
    !> The other copy, published
    type(field_file_t), intent(inout) :: other
    !> Whether that could be done: not every file system knows second names of a file
    logical, intent(out) :: exchanged
    !> The names are not what they should be
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: spare, reason

    exchanged = .false.
    if (.not. this%ready(error)) return
    spare = this%target_path//'.spare'
    call remove_file(spare, reason)
    call link_file(this%target_path, spare, reason)
    if (reason /= '') then
      ! The folder may be gone, or not be written into any more.
      call look_at_target(reason)
      if (reason /= '') call this%fail(reason, error)
      return
    end if
    call rename_file(this%temporary_path, this%target_path, reason)
    if (reason == '') call rename_file(spare, this%temporary_path, reason)
    if (reason /= '') then
      call this%fail(reason, error)
      return
    end if
    exchanged = .true.
    this%is_published = .true.
    other%is_published = .false.
    other%temporary_path = this%temporary_path

  contains

    !> Why the target could not be given another name anyway, or ''
    subroutine look_at_target(reason)
      character(len=:), allocatable, intent(out) :: reason
      integer :: what

      call look_at_path(this%target_path, what, reason)
      if (what == path_file) reason = write_obstacle(parent_folder(this%target_path))
      if (what == path_missing) reason = 'it is not there any more'
    end subroutine look_at_target

  end subroutine exchange_with

  !> Complete the step that is under way and bring all that was written to the disk.
  subroutine flush_file(this, error)
    class(field_file_t), intent(inout) :: this
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_silence_t) :: silence
    integer :: status

    if (.not. this%ready(error)) return
    call silence%begin()
    call complete_step(this, status)
    if (status >= 0) call h5fflush_f(this%file_id, h5f_scope_local_f, status)
    if (status < 0) call this%fail(hdf5_reason(), error)
    this%unflushed = 0
    call silence%finish()
  end subroutine flush_file

  !> Complete the file, publish it if that has not been done, and let go of it.
  !>
  !> A file in which a write failed is not published but removed, and the error is given again.
  subroutine close_file(this, error)
    class(field_file_t), intent(inout) :: this
    !> Why the file is not complete
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_silence_t) :: silence
    integer :: status

    call this%publish(error)
    if (.not. allocated(error)) then
      call silence%begin()
      call close_hdf5_file(this, status)
      if (status < 0) call this%fail(hdf5_reason(), error)
      call silence%finish()
    end if
    call this%discard()
  end subroutine close_file

  !> Let go of the file, and remove it unless it is published. Harmless if there is no file.
  subroutine discard(this)
    class(field_file_t), intent(inout) :: this
    type(hdf5_silence_t) :: silence
    character(len=:), allocatable :: reason
    integer :: status

    if (this%is_open) then
      call silence%begin()
      call close_hdf5_file(this, status)
      call silence%finish()
      ! There is nothing more to be done about a temporary file that cannot be removed.
      if (.not. this%is_published) call remove_file(this%temporary_path, reason)
    end if
  end subroutine discard

  ! ---------------------------------------------------------------------------------------------
  ! Point data
  ! ---------------------------------------------------------------------------------------------

  !> Add reals that are the same in every step, stored once.
  subroutine add_static_reals(this, name, values, error)
    class(field_file_t), intent(inout) :: this
    !> The name of the point data, not used before
    character(len=*), intent(in) :: name
    !> One value for each particle
    real(wp), intent(in), contiguous, target :: values(:)
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error

    call add_static_values(this, name, holds_reals, size(values), c_loc(values), error)
  end subroutine add_static_reals

  !> Add integers that are the same in every step, stored once.
  subroutine add_static_integers(this, name, values, error)
    class(field_file_t), intent(inout) :: this
    !> The name of the point data, not used before
    character(len=*), intent(in) :: name
    !> One value for each particle
    integer(int32), intent(in), contiguous, target :: values(:)
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error

    call add_static_values(this, name, holds_integers, size(values), c_loc(values), error)
  end subroutine add_static_integers

  !> Begin the next step; the step before is completed as by `flush`, if that has not been done.
  !>
  !> Point data that a step does not write keep the values of the step before.
  subroutine begin_step(this, time, error)
    class(field_file_t), intent(inout) :: this
    !> The time of the step, s
    real(wp), intent(in) :: time
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_silence_t) :: silence
    integer :: status

    if (.not. this%ready(error)) return
    if (this%whole_steps < this%steps) then
      call this%flush(error)
      if (allocated(error)) return
    end if
    call silence%begin()
    call this%reserve(room_for_table*size(this%point_data), error)
    if (.not. allocated(error)) then
      status = 0
      if (this%steps == 0) call make_steps_group(this, status)
      if (status >= 0) call append_step(this, time, status)
      if (status < 0) call this%fail(hdf5_reason(), error)
    end if
    call silence%finish()
  end subroutine begin_step

  !> Write a scalar of the step.
  !>
  !> Where it first appears after the first step, the steps before hold NaN.
  subroutine write_reals(this, name, values, error)
    class(field_file_t), intent(inout) :: this
    !> The name of the point data
    character(len=*), intent(in) :: name
    !> One value for each particle
    real(wp), intent(in), contiguous, target :: values(:)
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error

    call write_values(this, name, holds_reals, 1, size(values), c_loc(values), error)
  end subroutine write_reals

  !> Write a vector of the step. VTK's vectors have three components; the third is zero.
  subroutine write_vectors(this, name, x_component, y_component, error)
    class(field_file_t), intent(inout) :: this
    !> The name of the point data
    character(len=*), intent(in) :: name
    !> One value for each particle
    real(wp), intent(in) :: x_component(:), y_component(:)
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable, target :: vectors(:, :)

    allocate (vectors(3, size(x_component)))
    vectors(1, :) = x_component
    vectors(2, :) = y_component
    vectors(3, :) = 0.0_wp
    call write_values(this, name, holds_reals, 3, size(x_component), c_loc(vectors), error)
  end subroutine write_vectors

  !> Write integers of the step.
  !>
  !> Where they first appear after the first step, the steps before hold 0.
  subroutine write_integers(this, name, values, error)
    class(field_file_t), intent(inout) :: this
    !> The name of the point data
    character(len=*), intent(in) :: name
    !> One value for each particle
    integer(int32), intent(in), contiguous, target :: values(:)
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error

    call write_values(this, name, holds_integers, 1, size(values), c_loc(values), error)
  end subroutine write_integers

  ! ---------------------------------------------------------------------------------------------
  ! Metadata
  ! ---------------------------------------------------------------------------------------------

  !> Set an attribute to a text. It has no limit of length, as HDF5 keeps such texts in a heap.
  subroutine set_text(this, name, value, error)
    class(field_file_t), intent(inout) :: this
    !> The name of the attribute; one of that name is replaced
    character(len=*), intent(in) :: name
    !> The text (UTF-8), trailing blanks left out
    character(len=*), intent(in) :: value
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable, target :: text
    type(c_ptr), target :: address

    text = to_c(value)
    address = c_loc(text)
    call set_texts_at(this, name, -1, len(text, i8), c_loc(address), error)
  end subroutine set_text

  !> Set an attribute to an array of texts.
  subroutine set_texts(this, name, values, error)
    class(field_file_t), intent(inout) :: this
    !> The name of the attribute; one of that name is replaced
    character(len=*), intent(in) :: name
    !> The texts (UTF-8)
    type(text_t), intent(in) :: values(:)
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    type(text_t), allocatable, target :: texts(:)
    type(c_ptr), allocatable, target :: addresses(:)
    integer(i8) :: bytes
    integer :: k

    allocate (texts(size(values)), addresses(size(values)))
    bytes = 0
    do k = 1, size(values)
      texts(k)%value = to_c(values(k)%value)
      addresses(k) = c_loc(texts(k)%value)
      bytes = bytes + len(texts(k)%value) + room_per_text
    end do
    call set_texts_at(this, name, size(values), bytes, c_loc(addresses), error)
  end subroutine set_texts

  !> Set an attribute to a real.
  subroutine set_real(this, name, value, error)
    class(field_file_t), intent(inout) :: this
    !> The name of the attribute; one of that name is replaced
    character(len=*), intent(in) :: name
    !> The number
    real(wp), intent(in), target :: value
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error

    if (.not. this%ready(error)) return
    call set_numbers(this, this%calor_group, name, holds_reals, -1, c_loc(value), error)
  end subroutine set_real

  !> Set an attribute to an array of reals.
  subroutine set_reals(this, name, values, error)
    class(field_file_t), intent(inout) :: this
    !> The name of the attribute; one of that name is replaced
    character(len=*), intent(in) :: name
    !> The numbers, at most 8000
    real(wp), intent(in), contiguous, target :: values(:)
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error

    if (.not. this%ready(error)) return
    call set_numbers(this, this%calor_group, name, holds_reals, size(values), c_loc(values), error)
  end subroutine set_reals

  !> Set an attribute to an integer.
  subroutine set_integer(this, name, value, error)
    class(field_file_t), intent(inout) :: this
    !> The name of the attribute; one of that name is replaced
    character(len=*), intent(in) :: name
    !> The number
    integer(int32), intent(in), target :: value
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error

    if (.not. this%ready(error)) return
    call set_numbers(this, this%calor_group, name, holds_integers, -1, c_loc(value), error)
  end subroutine set_integer

  !> Set the time that a phase of the run took.
  subroutine set_wall_time(this, phase, seconds, error)
    class(field_file_t), intent(inout) :: this
    !> The name of the phase, which becomes the attribute's
    character(len=*), intent(in) :: phase
    !> The time, s
    real(wp), intent(in), target :: seconds
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error

    if (.not. this%ready(error)) return
    call set_numbers(this, this%wall_time_group, phase, holds_reals, -1, c_loc(seconds), error)
  end subroutine set_wall_time

  !> Once for each name: a data set of as many numbers.
  subroutine write_series(this, name, values, error)
    class(field_file_t), intent(inout) :: this
    !> The name of the data set
    character(len=*), intent(in) :: name
    !> The numbers
    real(wp), intent(in), target, contiguous :: values(:)
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    integer :: status

    if (.not. this%ready(error)) return
    call put_dataset(this%calor_group, name, h5t_ieee_f64le, memory_type(holds_reals), &
                     [size(values, kind=hsize_t)], c_loc(values), status)
    if (status < 0) call this%fail(hdf5_reason(), error)
  end subroutine write_series

  ! ---------------------------------------------------------------------------------------------
  ! Errors
  ! ---------------------------------------------------------------------------------------------

  !> Make an error of a failure to write, and keep it: from now on the file takes nothing more.
  subroutine fail(this, reason, error)
    class(field_file_t), intent(inout) :: this
    character(len=*), intent(in) :: reason
    type(error_t), allocatable, intent(out) :: error

    this%failure = 'The output file '''//this%path//''' could not be written: '//reason//'.'
    call raise(error, status_bad_file, this%failure)
  end subroutine fail

  !> Reserve room on the disk for what is about to be written.
  subroutine reserve(this, bytes, error)
    class(field_file_t), intent(inout) :: this
    integer(i8), intent(in) :: bytes
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: reason
    integer(hsize_t) :: file_size
    integer :: status

    call h5fget_filesize_f(this%file_id, file_size, status)
    if (status < 0) then
      call this%fail(hdf5_reason(), error)
      return
    end if
    ! HDF5 may keep in memory what it was given, and enlarge the file only when it is flushed.
    this%unflushed = this%unflushed + bytes + room_for_table
    call reserve_space(this%descriptor, int(file_size, i8), this%unflushed + room_for_records, &
                       reason)
    if (reason /= '') call this%fail(reason, error)
  end subroutine reserve

  !> Whether the file can be written to; if not, the error says why.
  function ready(this, error)
    class(field_file_t), intent(in) :: this
    type(error_t), allocatable, intent(out) :: error
    logical :: ready

    ready = .false.
    if (allocated(this%failure)) then
      call raise(error, status_bad_file, this%failure)
    else if (.not. this%is_open) then
      call raise(error, status_bad_file, 'No output file is open.')
    else
      ready = .true.
    end if
  end function ready

  !> Check that a file can be made at `path`, before anything is touched.
  subroutine check_place(path, error, called)
    !> The name of the file
    character(len=*), intent(in) :: path
    !> Why no file can be written there
    type(error_t), allocatable, intent(out) :: error
    !> What it is called in messages; without it 'output file'
    character(len=*), intent(in), optional :: called
    character(len=:), allocatable :: folder, reason, what_file
    integer :: what

    if (path == '') then
      call raise(error, status_bad_file, 'The output file has no name: give one as &output file.')
      return
    end if
    what_file = 'The output file '''
    if (present(called)) what_file = 'The '//called//' '''
    folder = parent_folder(path)
    call look_at_path(folder, what, reason)
    select case (what)
    case (path_folder)
      reason = write_obstacle(folder)
      if (reason /= '') then
        call raise(error, status_bad_file, what_file//path// &
                   ''' cannot be written into the folder '''//folder//''' ('//reason// &
                   '): change the folder''s permissions or name another file.')
      end if
    case (path_missing)
      call raise(error, status_bad_file, what_file//path// &
                 ''' cannot be written: the folder '''//folder// &
                 ''' does not exist: create it or name another file.')
    case (path_unreachable)
      call raise(error, status_bad_file, what_file//path// &
                 ''' cannot be written: the folder '''//folder//''' cannot be reached ('// &
                 reason//'): name another file.')
    case default
      call raise(error, status_bad_file, what_file//path// &
                 ''' cannot be written: '''//folder// &
                 ''' is not a folder: name another file.')
    end select
    if (allocated(error)) return

    call look_at_path(path, what, reason)
    select case (what)
    case (path_missing)
      return
    case (path_file)
      reason = write_obstacle(path)
      if (reason /= '') then
        call raise(error, status_bad_file, what_file//path// &
                   ''' exists and may not be replaced ('//reason// &
                   '): change its permissions or name another file.')
      end if
    case (path_folder)
      call raise(error, status_bad_file, what_file//path// &
                 ''' cannot be written: there is a folder of that name: name another file.')
    case (path_unreachable)
      call raise(error, status_bad_file, what_file//path// &
                 ''' cannot be written ('//reason//'): name another file.')
    case default
      call raise(error, status_bad_file, what_file//path// &
                 ''' cannot be written: what is there is not a regular file: name another file.')
    end select
  end subroutine check_place

  ! ---------------------------------------------------------------------------------------------
  ! The parts of the file. From here on `status` is negative if an HDF5 call failed; what is open
  ! then stays so, since closing it would wipe HDF5's account of what went wrong.
  ! ---------------------------------------------------------------------------------------------

  subroutine open_new_file(path, file_id, status)
    character(len=*), intent(in) :: path
    integer(hid_t), intent(out) :: file_id
    integer, intent(out) :: status
    integer(hid_t) :: creation, access

    call h5pcreate_f(h5p_file_create_f, creation, status)
    if (status < 0) return
    call h5pset_obj_track_times_f(creation, .false., status)
    if (status < 0) return
    call h5pcreate_f(h5p_file_access_f, access, status)
    if (status < 0) return
    call h5pset_fapl_sec2_f(access, status)
    if (status < 0) return
    ! Whatever is still open after a failed write must not keep the file open.
    call h5pset_fclose_degree_f(access, h5f_close_strong_f, status)
    if (status < 0) return
    ! A lock would keep ParaView from looking at the file while the run goes on.
    call h5pset_file_locking_f(access, .false., .true., status)
    if (status < 0) return
    call h5fcreate_f(path, h5f_acc_trunc_f, file_id, status, creation, access)
    if (status < 0) return
    call h5pclose_f(access, status)
    if (status < 0) return
    call h5pclose_f(creation, status)
  end subroutine open_new_file

  !> Make the groups and say that this is VTKHDF.
  subroutine write_frame(this, status)
    class(field_file_t), intent(inout) :: this
    integer, intent(out) :: status
    character(len=*), parameter :: kind_of_data = 'UnstructuredGrid'
    integer(int32), target :: version(2)
    character(len=len(kind_of_data)), target :: text
    integer(hid_t) :: text_type

    call make_group(this%file_id, 'VTKHDF', this%vtk_group, status)
    if (status < 0) return
    call make_group(this%vtk_group, 'PointData', this%point_data_group, status)
    if (status < 0) return
    call make_group(this%file_id, 'calor', this%calor_group, status)
    if (status < 0) return
    call make_group(this%calor_group, 'wall_time', this%wall_time_group, status)
    if (status < 0) return

    version = [2_int32, 0_int32]
    call put_attribute(this%vtk_group, 'Version', h5t_std_i32le, memory_type(holds_integers), 2, &
                       c_loc(version), status)
    if (status < 0) return
    ! VTK wants a text of fixed length here.
    call h5tcopy_f(h5t_fortran_s1, text_type, status)
    if (status < 0) return
    call h5tset_size_f(text_type, int(len(text), size_t), status)
    if (status < 0) return
    call h5tset_strpad_f(text_type, h5t_str_nullpad_f, status)
    if (status < 0) return
    text = kind_of_data
    call put_attribute(this%vtk_group, 'Type', text_type, text_type, -1, c_loc(text), status)
    if (status < 0) return
    call h5tclose_f(text_type, status)
  end subroutine write_frame

  !> Write places and cells: particle k is the vertex cell k.
  subroutine write_particles(this, x, y, growing, status)
    class(field_file_t), intent(inout) :: this
    real(wp), intent(in) :: x(:), y(:)
    !> Whether other places will follow
    logical, intent(in) :: growing
    integer, intent(out) :: status
    real(wp), allocatable, target :: points(:, :)
    integer(i8), allocatable, target :: numbers(:)
    integer(int8), allocatable, target :: cells(:)
    integer(i8) :: k, n
    integer(hid_t) :: numbers_in_memory

    n = size(x, kind=i8)
    numbers_in_memory = h5kind_to_type(i8, h5_integer_kind)
    call put_counts(this, status)
    if (status < 0) return
    allocate (points(3, n))
    points(1, :) = x
    points(2, :) = y
    points(3, :) = 0.0_wp
    if (growing) then
      call make_growing_dataset(this%vtk_group, 'Points', h5t_ieee_f64le, 3, &
                                rows_per_chunk(this%particles), this%points, status)
      if (status < 0) return
      call put_rows(this%points, memory_type(holds_reals), 3, 0_i8, n, c_loc(points), status)
      this%sets_of_places = 1
    else
      call put_dataset(this%vtk_group, 'Points', h5t_ieee_f64le, memory_type(holds_reals), &
                       [3_hsize_t, int(n, hsize_t)], c_loc(points), status)
    end if
    if (status < 0) return
    deallocate (points)

    allocate (numbers(n + 1))
    do k = 0, n
      numbers(k + 1) = k
    end do
    call put_dataset(this%vtk_group, 'Connectivity', h5t_std_i64le, numbers_in_memory, &
                     [int(n, hsize_t)], c_loc(numbers), status)
    if (status < 0) return
    call put_dataset(this%vtk_group, 'Offsets', h5t_std_i64le, numbers_in_memory, &
                     [int(n + 1, hsize_t)], c_loc(numbers), status)
    if (status < 0) return

    allocate (cells(n))
    cells = vertex_cell
    call put_dataset(this%vtk_group, 'Types', h5t_std_u8le, &
                     h5kind_to_type(int8, h5_integer_kind), [int(n, hsize_t)], c_loc(cells), status)
  end subroutine write_particles

  !> Write how many particles there are: as many points, cells and connections.
  subroutine put_counts(this, status)
    class(field_file_t), intent(in) :: this
    integer, intent(out) :: status
    character(len=*), parameter :: counts(3) = [character(len=23) :: 'NumberOfPoints', &
                                                'NumberOfCells', 'NumberOfConnectivityIds']
    integer(i8), target :: count
    integer :: k

    count = this%particles
    do k = 1, size(counts)
      call put_dataset(this%vtk_group, trim(counts(k)), h5t_std_i64le, &
                       h5kind_to_type(i8, h5_integer_kind), [1_hsize_t], c_loc(count), status)
      if (status < 0) return
    end do
  end subroutine put_counts

  !> Without a call a step has the places of the step before.
  subroutine write_places(this, x, y, error)
    class(field_file_t), intent(inout) :: this
    !> Coordinates of the particles, m
    real(wp), intent(in) :: x(:), y(:)
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_silence_t) :: silence
    real(wp), allocatable, target :: points(:, :)
    integer(i8), target :: start
    integer :: status

    if (.not. this%ready(error)) return
    call check_length(this, 'Points', size(x), error)
    if (allocated(error)) return
    if (this%points < 0 .or. this%steps == 0) then
      call raise(error, &
                 status_bad_file, 'The output file '''//this%path//''' has no step under '// &
                 'way, or was made for particles that do not move.')
      return
    end if
    allocate (points(3, size(x)))
    points(1, :) = x
    points(2, :) = y
    points(3, :) = 0.0_wp
    call silence%begin()
    call this%reserve(24_i8*(size(x) + rows_per_chunk(this%particles)), error)
    if (.not. allocated(error)) then
      ! The first step has the places that the file was made with; a step may write its places
      ! twice.
      if (this%last_places < this%steps .and. this%steps > 1) then
        this%sets_of_places = this%sets_of_places + 1
      end if
      this%last_places = this%steps
      start = (this%sets_of_places - 1)*this%particles
      call put_rows(this%points, memory_type(holds_reals), 3, start, int(this%particles, i8), &
                    c_loc(points), status)
      if (status >= 0) then
        call put_rows(this%tables(place_table), h5kind_to_type(i8, h5_integer_kind), 1, &
                      int(this%steps - 1, i8), 1_i8, c_loc(start), status)
      end if
      if (status < 0) call this%fail(hdf5_reason(), error)
    end if
    call silence%finish()
  end subroutine write_places

  subroutine add_static_values(this, name, content, length, address, error)
    class(field_file_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    integer, intent(in) :: content, length
    type(c_ptr), intent(in) :: address
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_silence_t) :: silence
    integer :: position, status

    if (.not. this%ready(error)) return
    call check_length(this, name, length, error)
    if (allocated(error)) return
    if (place_of(this%point_data, name) > 0) then
      call raise(error, status_bad_file, 'The point data '''//name//''' of the output file '''// &
                 this%path//''' exist already.')
      return
    end if
    call silence%begin()
    call this%reserve(8_i8*length, error)
    if (.not. allocated(error)) then
      call add_point_data(this, name, content, components=1, static=.true., position=position, &
                          status=status)
      if (status >= 0) then
        call h5dwrite_f(this%point_data(position)%dataset, memory_type(content), address, status)
      end if
      if (status < 0) call this%fail(hdf5_reason(), error)
    end if
    call silence%finish()
  end subroutine add_static_values

  subroutine write_values(this, name, content, components, length, address, error)
    class(field_file_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    integer, intent(in) :: content, components, length
    type(c_ptr), intent(in) :: address
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_silence_t) :: silence
    integer :: position, blocks, status

    if (.not. this%ready(error)) return
    call check_length(this, name, length, error)
    if (allocated(error)) return
    position = place_of(this%point_data, name)
    if (this%steps == 0) then
      call raise(error, status_bad_file, 'The point data '''//name//''' of the output file '''// &
                 this%path//''' belong to a step, but none has begun.')
    else if (position > 0) then
      if (this%point_data(position)%static .or. this%point_data(position)%content /= content .or. &
          this%point_data(position)%components /= components) then
        call raise(error, status_bad_file, 'The point data '''//name//''' of the output file '''// &
                   this%path//''' were of another kind before.')
      end if
    end if
    if (allocated(error)) return

    call silence%begin()
    blocks = 1
    ! Point data that first appear now fill the steps before with one block.
    if (position == 0) blocks = 2
    ! Chunks are written whole, so the last one may go beyond the rows.
    call this%reserve(8_i8*components*(blocks*length + rows_per_chunk(this%particles)), error)
    if (.not. allocated(error)) then
      status = 0
      if (position == 0) then
        call add_point_data(this, name, content, components, static=.false., position=position, &
                            status=status)
        if (status >= 0) call fill_earlier_steps(this, position, status)
      end if
      if (status >= 0) call append_values(this, position, address, status)
      if (status < 0) call this%fail(hdf5_reason(), error)
    end if
    call silence%finish()
  end subroutine write_values

  !> Append the values of the step that is under way, or replace them if it wrote them before.
  subroutine append_values(this, position, address, status)
    class(field_file_t), intent(inout) :: this
    integer, intent(in) :: position
    type(c_ptr), intent(in) :: address
    integer, intent(out) :: status
    integer(i8), target :: start

    associate (data => this%point_data(position))
      if (data%last_step == this%steps) then
        start = data%rows - this%particles
      else
        start = data%rows
      end if
      call put_rows(data%dataset, memory_type(data%content), data%components, start, &
                    int(this%particles, i8), address, status)
      if (status < 0) return
      data%rows = start + this%particles
      data%last_step = this%steps
      call put_rows(data%offsets, h5kind_to_type(i8, h5_integer_kind), 1, int(this%steps - 1, i8), &
                    1_i8, c_loc(start), status)
    end associate
  end subroutine append_values

  !> Give point data that first appear now a value for the steps before.
  subroutine fill_earlier_steps(this, position, status)
    class(field_file_t), intent(inout) :: this
    integer, intent(in) :: position
    integer, intent(out) :: status
    real(wp), allocatable, target :: reals(:)
    integer(int32), allocatable, target :: integers(:)

    status = 0
    if (this%steps == 1) return
    associate (data => this%point_data(position))
      select case (data%content)
      case (holds_integers)
        allocate (integers(data%components*this%particles))
        integers = 0
        call put_rows(data%dataset, memory_type(data%content), data%components, 0_i8, &
                      int(this%particles, i8), c_loc(integers), status)
      case default
        allocate (reals(data%components*this%particles))
        reals = ieee_value(1.0_wp, ieee_quiet_nan)
        call put_rows(data%dataset, memory_type(data%content), data%components, 0_i8, &
                      int(this%particles, i8), c_loc(reals), status)
      end select
      data%rows = this%particles
    end associate
  end subroutine fill_earlier_steps

  !> Make a point data set and, if there are steps, its table of offsets, which are 0 so far.
  subroutine add_point_data(this, name, content, components, static, position, status)
    class(field_file_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    integer, intent(in) :: content, components
    logical, intent(in) :: static
    integer, intent(out) :: position
    integer, intent(out) :: status
    type(point_data_t), allocatable :: grown(:)
    integer(hid_t) :: file_type
    integer :: k

    position = size(this%point_data) + 1
    allocate (grown(position))
    do k = 1, position - 1
      grown(k) = this%point_data(k)
    end do
    call move_alloc(grown, this%point_data)

    associate (data => this%point_data(position))
      data%name = trim(name)
      data%content = content
      data%components = components
      data%static = static
      select case (content)
      case (holds_integers)
        file_type = h5t_std_i32le
      case default
        file_type = h5t_ieee_f64le
      end select
      if (static) then
        call make_dataset(this%point_data_group, data%name, file_type, &
                          [int(this%particles, hsize_t)], data%dataset, status, &
                          early=this%written_by_others)
      else
        call make_growing_dataset(this%point_data_group, data%name, file_type, components, &
                                  rows_per_chunk(this%particles), data%dataset, status, &
                                  early=this%written_by_others)
      end if
    end associate
    if (status >= 0 .and. this%steps > 0) call make_offsets(this, position, status)
  end subroutine add_point_data

  subroutine make_offsets(this, position, status)
    class(field_file_t), intent(inout) :: this
    integer, intent(in) :: position
    integer, intent(out) :: status
    integer(i8), allocatable, target :: zeros(:)

    associate (data => this%point_data(position))
      call make_growing_dataset(this%offsets_group, data%name, h5t_std_i64le, 1, table_chunk, &
                                data%offsets, status)
    end associate
    if (status < 0 .or. this%steps == 0) return
    allocate (zeros(this%steps))
    zeros = 0
    call put_rows(this%point_data(position)%offsets, h5kind_to_type(i8, h5_integer_kind), 1, 0_i8, &
                  int(this%steps, i8), c_loc(zeros), status)
  end subroutine make_offsets

  !> Make the group of the steps. A file without steps, such as of operator values, has none.
  subroutine make_steps_group(this, status)
    class(field_file_t), intent(inout) :: this
    integer, intent(out) :: status
    integer :: k

    call make_group(this%vtk_group, 'Steps', this%steps_group, status)
    if (status < 0) return
    call make_group(this%steps_group, 'PointDataOffsets', this%offsets_group, status)
    if (status < 0) return
    call make_growing_dataset(this%steps_group, 'Values', h5t_ieee_f64le, 1, table_chunk, &
                              this%times, status)
    if (status < 0) return
    do k = 1, size(step_tables)
      call make_growing_dataset(this%steps_group, trim(step_tables(k)), h5t_std_i64le, 1, &
                                table_chunk, this%tables(k), status)
      if (status < 0) return
    end do
    do k = 1, size(this%point_data)
      call make_offsets(this, k, status)
      if (status < 0) return
    end do
    call put_step_count(this, status)
  end subroutine make_steps_group

  !> Append one row for the next step to every table of the steps.
  subroutine append_step(this, time, status)
    class(field_file_t), intent(inout) :: this
    real(wp), intent(in), target :: time
    integer, intent(out) :: status
    integer(i8) :: row
    integer(i8), target :: entry
    integer(hid_t) :: numbers
    integer :: k

    row = this%steps
    numbers = h5kind_to_type(i8, h5_integer_kind)
    call put_rows(this%times, memory_type(holds_reals), 1, row, 1_i8, c_loc(time), status)
    if (status < 0) return
    do k = 1, size(step_tables)
      entry = step_entries(k)
      if (k == place_table) entry = max(0_i8, this%sets_of_places - 1)*this%particles
      call put_rows(this%tables(k), numbers, 1, row, 1_i8, c_loc(entry), status)
      if (status < 0) return
    end do
    do k = 1, size(this%point_data)
      entry = max(0_i8, this%point_data(k)%rows - this%particles)
      call put_rows(this%point_data(k)%offsets, numbers, 1, row, 1_i8, c_loc(entry), status)
      if (status < 0) return
    end do
    this%steps = this%steps + 1
  end subroutine append_step

  !> Count the step that is under way, so that readers see it only when it is whole.
  subroutine complete_step(this, status)
    class(field_file_t), intent(inout) :: this
    integer, intent(out) :: status

    status = 0
    if (this%whole_steps == this%steps) return
    this%whole_steps = this%steps
    call put_step_count(this, status)
  end subroutine complete_step

  subroutine put_step_count(this, status)
    class(field_file_t), intent(in) :: this
    integer, intent(out) :: status
    integer(i8), target :: count

    count = this%whole_steps
    call put_attribute(this%steps_group, 'NSteps', h5t_std_i64le, &
                       h5kind_to_type(i8, h5_integer_kind), -1, c_loc(count), status)
  end subroutine put_step_count

  subroutine set_texts_at(this, name, count, bytes, addresses, error)
    class(field_file_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    !> Number of texts; negative for a single value
    integer, intent(in) :: count
    !> Length of all texts together
    integer(i8), intent(in) :: bytes
    type(c_ptr), intent(in) :: addresses
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_silence_t) :: silence
    integer(hid_t) :: text_type
    integer :: status

    if (.not. this%ready(error)) return
    call silence%begin()
    call this%reserve(bytes, error)
    if (.not. allocated(error)) then
      ! This type's texts have any length and end with a null.
      call h5tcopy_f(h5t_string, text_type, status)
      if (status >= 0) call h5tset_cset_f(text_type, h5t_cset_utf8_f, status)
      if (status >= 0) then
        call put_attribute(this%calor_group, name, text_type, text_type, count, addresses, status)
      end if
      if (status >= 0) call h5tclose_f(text_type, status)
      if (status < 0) call this%fail(hdf5_reason(), error)
    end if
    call silence%finish()
  end subroutine set_texts_at

  subroutine set_numbers(this, group, name, content, count, address, error)
    class(field_file_t), intent(inout) :: this
    integer(hid_t), intent(in) :: group
    character(len=*), intent(in) :: name
    integer, intent(in) :: content, count
    type(c_ptr), intent(in) :: address
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_silence_t) :: silence
    integer(hid_t) :: file_type
    integer :: status

    file_type = h5t_ieee_f64le
    if (content == holds_integers) file_type = h5t_std_i32le
    call silence%begin()
    call this%reserve(8_i8*max(1, count), error)
    if (.not. allocated(error)) then
      call put_attribute(group, name, file_type, memory_type(content), count, address, status)
      if (status < 0) call this%fail(hdf5_reason(), error)
    end if
    call silence%finish()
  end subroutine set_numbers

  !> Close the file and all that is open in it, and give back the room that it did not need.
  subroutine close_hdf5_file(this, status)
    class(field_file_t), intent(inout) :: this
    integer, intent(out) :: status
    integer(hsize_t) :: file_size
    integer :: k, ignored

    ! Whether an object can be closed does not matter: closing the file closes the rest.
    do k = 1, size(this%point_data)
      call h5dclose_f(this%point_data(k)%dataset, ignored)
      call h5dclose_f(this%point_data(k)%offsets, ignored)
    end do
    do k = 1, size(this%tables)
      call h5dclose_f(this%tables(k), ignored)
    end do
    call h5dclose_f(this%times, ignored)
    if (this%points >= 0) call h5dclose_f(this%points, ignored)
    call h5gclose_f(this%offsets_group, ignored)
    call h5gclose_f(this%steps_group, ignored)
    call h5gclose_f(this%wall_time_group, ignored)
    call h5gclose_f(this%calor_group, ignored)
    call h5gclose_f(this%point_data_group, ignored)
    call h5gclose_f(this%vtk_group, ignored)
    this%is_open = .false.

    call h5fflush_f(this%file_id, h5f_scope_local_f, status)
    if (status >= 0) call h5fget_filesize_f(this%file_id, file_size, status)
    if (status >= 0) call cut_file(this%descriptor, int(file_size, i8))
    if (status >= 0) then
      call h5fclose_f(this%file_id, status)
    else
      call h5fclose_f(this%file_id, ignored)
    end if
  end subroutine close_hdf5_file

  subroutine check_length(this, name, length, error)
    class(field_file_t), intent(in) :: this
    character(len=*), intent(in) :: name
    integer, intent(in) :: length
    type(error_t), allocatable, intent(out) :: error

    if (length == this%particles) return
    call raise(error, status_bad_file, 'The point data '''//name//''' of the output file '''// &
               this%path//''' have '//to_text(length)//' values for '// &
               to_text(this%particles)//' particles.')
  end subroutine check_length

  !> Which of the point data have that name; 0 if none.
  pure function place_of(point_data, name) result(position)
    type(point_data_t), intent(in) :: point_data(:)
    character(len=*), intent(in) :: name
    integer :: position

    do position = size(point_data), 1, -1
      if (point_data(position)%name == name) return
    end do
  end function place_of

  ! ---------------------------------------------------------------------------------------------
  ! HDF5's pieces
  ! ---------------------------------------------------------------------------------------------

  function memory_type(content)
    integer, intent(in) :: content
    integer(hid_t) :: memory_type

    select case (content)
    case (holds_integers)
      memory_type = h5kind_to_type(int32, h5_integer_kind)
    case default
      memory_type = h5kind_to_type(wp, h5_real_kind)
    end select
  end function memory_type

  !> Rows of a chunk: a step as a whole or in equal parts of at most 1 MiB, HDF5's chunk cache, and
  !> several steps where there are few particles, since each chunk costs an entry in an index.
  pure function rows_per_chunk(particles) result(rows)
    integer, intent(in) :: particles
    integer :: rows
    integer, parameter :: least = 1024, most = 131072
    integer :: parts

    parts = max(1, (particles - 1)/most + 1)
    rows = max(least, (particles - 1)/parts + 1)
  end function rows_per_chunk

  !> Make a group without a time stamp, so that equal runs give equal files.
  subroutine make_group(parent, name, group, status)
    integer(hid_t), intent(in) :: parent
    character(len=*), intent(in) :: name
    integer(hid_t), intent(out) :: group
    integer, intent(out) :: status
    integer(hid_t) :: creation

    call h5pcreate_f(h5p_group_create_f, creation, status)
    if (status < 0) return
    call h5pset_obj_track_times_f(creation, .false., status)
    if (status < 0) return
    call h5gcreate_f(parent, name, group, status, gcpl_id=creation)
    if (status < 0) return
    call h5pclose_f(creation, status)
  end subroutine make_group

  !> Make a dataset of fixed size, without a time stamp.
  subroutine make_dataset(parent, name, file_type, extent, dataset, status, early)
    integer(hid_t), intent(in) :: parent
    character(len=*), intent(in) :: name
    integer(hid_t), intent(in) :: file_type
    !> Extent in Fortran's order of dimensions
    integer(hsize_t), intent(in) :: extent(:)
    integer(hid_t), intent(out) :: dataset
    integer, intent(out) :: status
    !> Whether it gets its place in the file at once
    logical, intent(in), optional :: early
    integer(hid_t) :: creation, space

    call h5pcreate_f(h5p_dataset_create_f, creation, status)
    if (status < 0) return
    call h5pset_obj_track_times_f(creation, .false., status)
    if (status >= 0 .and. present(early)) call place_early(creation, early, status)
    if (status < 0) return
    call h5screate_simple_f(size(extent), extent, space, status)
    if (status < 0) return
    call h5dcreate_f(parent, name, file_type, space, dataset, status, dcpl_id=creation)
    if (status < 0) return
    call h5sclose_f(space, status)
    if (status < 0) return
    call h5pclose_f(creation, status)
  end subroutine make_dataset

  !> Make a dataset that others write, in one stretch.
  subroutine place_dataset(parent, name, file_type, extent, stretches, status)
    integer(hid_t), intent(in) :: parent
    character(len=*), intent(in) :: name
    integer(hid_t), intent(in) :: file_type
    integer(hsize_t), intent(in) :: extent(:)
    type(stretches_t), intent(out) :: stretches
    integer, intent(out) :: status
    integer(hid_t) :: dataset
    integer(hsize_t) :: address

    call make_dataset(parent, name, file_type, extent, dataset, status, early=.true.)
    if (status < 0) return
    call h5dget_offset_f(dataset, address, status)
    if (status < 0) return
    stretches%start = [0_i8, int(extent(size(extent)), i8)]
    stretches%address = [int(address, i8)]
    call h5dclose_f(dataset, status)
  end subroutine place_dataset

  !> Where rows of a growing dataset are whose chunks have a place in the file.
  subroutine find_chunks(dataset, start, rows, chunk_rows, stretches, status)
    integer(hid_t), intent(in) :: dataset
    !> Rows before the first, and how many
    integer(i8), intent(in) :: start, rows
    integer, intent(in) :: chunk_rows
    type(stretches_t), intent(out) :: stretches
    integer, intent(out) :: status
    integer(i8) :: first, last, k
    integer(c_int64_t) :: address, size_of
    integer(c_int) :: filters

    first = start/chunk_rows
    last = (start + rows - 1)/chunk_rows
    allocate (stretches%start(last - first + 2), stretches%address(last - first + 1))
    do k = first, last
      status = h5dget_chunk_info_by_coord(int(dataset, c_int64_t), [k*chunk_rows], filters, &
                                          address, size_of)
      if (status < 0) return
      associate (from => max(start, k*chunk_rows))
        stretches%start(k - first + 1) = from - start
        stretches%address(k - first + 1) = address + 8*(from - k*chunk_rows)
      end associate
    end do
    stretches%start(last - first + 2) = rows
  end subroutine find_chunks

  !> Make a dataset and write it.
  subroutine put_dataset(parent, name, file_type, memory, extent, address, status)
    integer(hid_t), intent(in) :: parent
    character(len=*), intent(in) :: name
    integer(hid_t), intent(in) :: file_type, memory
    integer(hsize_t), intent(in) :: extent(:)
    type(c_ptr), intent(in) :: address
    integer, intent(out) :: status
    integer(hid_t) :: dataset

    call make_dataset(parent, name, file_type, extent, dataset, status)
    if (status < 0) return
    call h5dwrite_f(dataset, memory, address, status)
    if (status < 0) return
    call h5dclose_f(dataset, status)
  end subroutine put_dataset

  !> Make an empty dataset that can take any number of rows, without a time stamp.
  subroutine make_growing_dataset(parent, name, file_type, components, chunk_rows, dataset, &
                                  status, early)
    integer(hid_t), intent(in) :: parent
    character(len=*), intent(in) :: name
    integer(hid_t), intent(in) :: file_type
    integer, intent(in) :: components
    integer, intent(in) :: chunk_rows
    integer(hid_t), intent(out) :: dataset
    integer, intent(out) :: status
    !> Whether chunks get their place in the file at once
    logical, intent(in), optional :: early
    integer(hid_t) :: creation, space
    integer(hsize_t) :: extent(2), limit(2), chunk(2)
    integer :: first

    first = merge(2, 1, components == 1)
    extent = [int(components, hsize_t), 0_hsize_t]
    limit = [int(components, hsize_t), h5s_unlimited_f]
    chunk = [int(components, hsize_t), int(chunk_rows, hsize_t)]
    call h5pcreate_f(h5p_dataset_create_f, creation, status)
    if (status < 0) return
    call h5pset_obj_track_times_f(creation, .false., status)
    if (status < 0) return
    call h5pset_chunk_f(creation, 3 - first, chunk(first:), status)
    if (status >= 0 .and. present(early)) call place_early(creation, early, status)
    if (status < 0) return
    call h5screate_simple_f(3 - first, extent(first:), space, status, limit(first:))
    if (status < 0) return
    call h5dcreate_f(parent, name, file_type, space, dataset, status, dcpl_id=creation)
    if (status < 0) return
    call h5sclose_f(space, status)
    if (status < 0) return
    call h5pclose_f(creation, status)
  end subroutine make_growing_dataset

  !> Nothing is written there before others do.
  subroutine place_early(creation, early, status)
    integer(hid_t), intent(in) :: creation
    logical, intent(in) :: early
    integer, intent(out) :: status

    status = 0
    if (.not. early) return
    call h5pset_alloc_time_f(creation, h5d_alloc_time_early_f, status)
    if (status >= 0) call h5pset_fill_time_f(creation, h5d_fill_time_never_f, status)
  end subroutine place_early

  !> Write rows of a growing dataset; it ends with the last of them.
  subroutine put_rows(dataset, memory, components, start, rows, address, status)
    integer(hid_t), intent(in) :: dataset, memory
    integer, intent(in) :: components
    !> Rows before the first that is written
    integer(i8), intent(in) :: start
    integer(i8), intent(in) :: rows
    type(c_ptr), intent(in) :: address
    integer, intent(out) :: status
    integer(hid_t) :: file_space, memory_space
    integer(hsize_t) :: extent(2), offset(2), block(2)
    integer :: first

    first = merge(2, 1, components == 1)
    extent = [int(components, hsize_t), int(start + rows, hsize_t)]
    offset = [0_hsize_t, int(start, hsize_t)]
    block = [int(components, hsize_t), int(rows, hsize_t)]
    call h5dset_extent_f(dataset, extent(first:), status)
    if (status < 0) return
    call h5dget_space_f(dataset, file_space, status)
    if (status < 0) return
    call h5sselect_hyperslab_f(file_space, h5s_select_set_f, offset(first:), block(first:), status)
    if (status < 0) return
    call h5screate_simple_f(3 - first, block(first:), memory_space, status)
    if (status < 0) return
    call h5dwrite_f(dataset, memory, address, status, memory_space, file_space)
    if (status < 0) return
    call h5sclose_f(memory_space, status)
    if (status < 0) return
    call h5sclose_f(file_space, status)
  end subroutine put_rows

  !> Write an attribute, in place of one of that name.
  subroutine put_attribute(parent, name, file_type, memory, count, address, status)
    integer(hid_t), intent(in) :: parent
    character(len=*), intent(in) :: name
    integer(hid_t), intent(in) :: file_type, memory
    !> Length of the array; negative for a single value
    integer, intent(in) :: count
    type(c_ptr), intent(in) :: address
    integer, intent(out) :: status
    integer(hid_t) :: space, attribute
    logical :: exists

    call h5aexists_f(parent, name, exists, status)
    if (status < 0) return
    if (exists) call h5adelete_f(parent, name, status)
    if (status < 0) return
    if (count < 0) then
      call h5screate_f(h5s_scalar_f, space, status)
    else
      call h5screate_simple_f(1, [int(count, hsize_t)], space, status)
    end if
    if (status < 0) return
    call h5acreate_f(parent, name, file_type, space, attribute, status)
    if (status < 0) return
    call h5awrite_f(attribute, memory, address, status)
    if (status < 0) return
    call h5aclose_f(attribute, status)
    if (status < 0) return
    call h5sclose_f(space, status)
  end subroutine put_attribute

end module calor_field_file
