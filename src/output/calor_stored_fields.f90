!> Reading back what calor wrote: the particles, fields and heat budget in a VTKHDF file.
!>
!>     call stored%open('plate.vtkhdf', error)
!>     call stored%read_places(step, x, y, error)
!>     call stored%read_field('temperature', step, values, error)
!>     call stored%close()
!>
!> A step is one of `time`, counted from 1. The format is that of `calor_field_file`.
module calor_stored_fields
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
  use, intrinsic :: iso_c_binding, only: c_ptr, c_loc, c_null_ptr
  use calor_c_text, only: from_c
  use calor_constants, only: greatest_size
  use calor_error, only: error_t, raise, status_bad_input, status_bad_file
  use calor_hdf5, only: start_hdf5, open_hdf5_file, hdf5_has, hdf5_reason, hdf5_silence_t
  use calor_kinds, only: wp, ip, i8
  use calor_text, only: text_t, append, join, suggestion
  use calor_trial, only: start_trial, end_trial
  use hdf5, only: hid_t, hsize_t, size_t, h5_real_kind, h5kind_to_type, h5s_select_set_f, &
                  h5t_integer_f, h5t_string_f, &
                  h5aclose_f, h5aexists_by_name_f, h5aget_type_f, h5aopen_by_name_f, h5aread_f, &
                  h5dclose_f, h5dget_space_f, h5dget_storage_size_f, h5dget_type_f, h5dopen_f, &
                  h5dread_f, h5fclose_f, &
                  h5gget_obj_info_idx_f, h5gn_members_f, &
                  h5sclose_f, h5screate_simple_f, h5sget_simple_extent_dims_f, &
                  h5sget_simple_extent_ndims_f, h5sselect_hyperslab_f, h5tclose_f, &
                  h5tget_class_f, h5tis_variable_str_f
  implicit none (type, external)
  private

  public :: stored_fields_t

  character(len=*), parameter :: point_data = '/VTKHDF/PointData/', origin = '/calor'
  !> Lists of a heat budget that are no accounts
  character(len=*), parameter :: budget_lists(*) = [character(len=11) :: 'time', 'stored', &
      'stored_rate', 'imbalance']
  character(len=*), parameter :: remedy = ' calor run and calor operators write such files.'

  !> A file open for reading
  type :: stored_fields_t
    !> Its name
    character(len=:), allocatable :: path
    !> What the scene is called; '' where it has no title
    character(len=:), allocatable :: title
    !> Times of the steps, s
    real(wp), allocatable :: time(:)
    !> Number of particles, and about the distance between them, m
    integer :: particles = 0
    real(wp) :: spacing = 0.0_wp
    !> Names of the fields
    type(text_t), allocatable :: field(:)
    integer(hid_t), private :: file_id = -1
  contains
    !> Open a file and learn what is in it
    procedure :: open => open_stored
    !> Places of the particles at a step
    procedure :: read_places
    !> A field at a step
    procedure :: read_field
    !> Whether a field holds whole numbers
    procedure :: is_integer
    !> Names of the accounts of the heat budget
    procedure :: accounts
    !> A list of numbers beside the fields
    procedure :: series
    !> Whether the file has a field
    procedure :: has
    !> A number noted beside the fields
    procedure :: number
    !> A text noted there, '' where there is none
    procedure :: note
    !> Let go of the file
    procedure :: close => close_stored
    procedure, private :: learn, read_rows, fail
  end type stored_fields_t

contains

  subroutine open_stored(this, path, error)
    class(stored_fields_t), intent(out) :: this
    !> The file, known to be there
    character(len=*), intent(in) :: path
    !> It is damaged, or not of calor
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_silence_t) :: silence
    integer :: status
    logical :: inside, survived

    this%path = path
    this%title = ''
    allocate (this%field(0), this%time(0))
    call start_trial(inside, survived)
    if (.not. survived) then
      call this%fail(error)
      return
    end if
    call silence%begin()
    call start_hdf5(status)
    if (status >= 0) call open_hdf5_file(path, this%file_id, status)
    if (status < 0) then
      this%file_id = -1
      call this%fail(error)
    else
      call this%learn(error)
    end if
    call silence%finish()
    if (inside) then
      if (.not. allocated(error)) call read_last_step(this)
      call end_trial()
    end if
    if (allocated(error)) call this%close()
  end subroutine open_stored

  !> Read what a caller may, to see whether HDF5 bears it.
  subroutine read_last_step(this)
    type(stored_fields_t), intent(in) :: this
    type(error_t), allocatable :: ignored
    type(text_t), allocatable :: names(:)
    character(len=:), allocatable :: scene
    real(wp), allocatable :: x(:), y(:)
    logical :: answer
    integer :: k

    call this%read_places(size(this%time), x, y, ignored)
    do k = 1, size(this%field)
      answer = this%is_integer(this%field(k)%value)
      call this%read_field(this%field(k)%value, size(this%time), x, ignored)
    end do
    names = this%accounts()
    do k = 1, size(budget_lists)
      call append(names, trim(budget_lists(k)))
    end do
    do k = 1, size(names)
      x = this%series('budget_'//names(k)%value)
    end do
    scene = this%note('scene')
  end subroutine read_last_step

  subroutine learn(this, error)
    class(stored_fields_t), intent(inout) :: this
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: numbers(:, :)
    character(len=200) :: name
    integer(hsize_t) :: none
    integer :: members, kind_of_member, k, status

    if (.not. (hdf5_has(this%file_id, '/VTKHDF/Points') .and. &
               hdf5_has(this%file_id, '/VTKHDF/PointData') .and. &
               hdf5_has(this%file_id, '/VTKHDF/Steps/Values') .and. &
               hdf5_has(this%file_id, '/VTKHDF/NumberOfPoints') .and. &
               hdf5_has(this%file_id, origin))) then
      call raise(error, status_bad_input, 'The file '''//this%path// &
                 ''' is HDF5 but not one of calor''s.'//remedy)
      return
    end if
    none = 0
    call this%read_rows('/VTKHDF/NumberOfPoints', none, 1_hsize_t, numbers, error)
    if (allocated(error)) return
    if (.not. is_count(numbers(1, 1))) then
      call this%fail(error)
      return
    end if
    this%particles = nint(numbers(1, 1))
    call this%read_rows('/VTKHDF/Steps/Values', none, -1_hsize_t, numbers, error)
    if (allocated(error)) return
    if (.not. all(is_usable(numbers))) then
      call this%fail(error)
      return
    end if
    this%time = numbers(1, :)
    call h5gn_members_f(this%file_id, '/VTKHDF/PointData', members, status)
    do k = 0, members - 1
      call h5gget_obj_info_idx_f(this%file_id, '/VTKHDF/PointData', k, name, kind_of_member, status)
      if (status >= 0) call append(this%field, trim(name))
    end do
    if (this%particles == 0 .or. size(this%time) == 0 .or. size(this%field) == 0) then
      call raise(error, status_bad_input, 'The file '''//this%path//''' holds no state yet: '// &
                 'run its scene to the end.')
      return
    end if
    this%title = text_of(this%file_id, 'title')
    this%spacing = this%number('spacing')
  end subroutine learn

  subroutine read_places(this, step, x, y, error)
    class(stored_fields_t), intent(in) :: this
    !> One of the steps
    integer, intent(in) :: step
    !> Coordinates, m
    real(wp), allocatable, intent(out) :: x(:), y(:)
    !> The file is damaged
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_silence_t) :: silence
    real(wp), allocatable :: points(:, :)

    call silence%begin()
    call this%read_rows('/VTKHDF/Points', &
                        start_of(this, '/VTKHDF/Steps/PointOffsets', step), &
                        int(this%particles, hsize_t), points, error)
    call silence%finish()
    if (allocated(error)) return
    if (size(points, 1) /= 3 .or. .not. all(is_usable(points))) then
      call this%fail(error)
      return
    end if
    x = points(1, :)
    y = points(2, :)
  end subroutine read_places

  !> Whether a number can be what a run of calor wrote.
  elemental function is_usable(number) result(answer)
    real(wp), intent(in) :: number
    logical :: answer

    answer = ieee_is_finite(number)
    if (answer) answer = abs(number) <= greatest_size
  end function is_usable

  !> Whether a number can say how many, or which.
  pure function is_count(number) result(answer)
    real(wp), intent(in) :: number
    logical :: answer

    answer = is_usable(number)
    if (answer) answer = number >= 0 .and. number <= real(huge(1_ip), wp)
  end function is_count

  !> A scalar as it is; of a vector its length; NaN for what no run wrote.
  subroutine read_field(this, name, step, values, error, is_vector, skip, rows)
    class(stored_fields_t), intent(in) :: this
    !> The field
    character(len=*), intent(in) :: name
    !> One of the steps
    integer, intent(in) :: step
    !> Its values, in the file's order
    real(wp), allocatable, intent(out) :: values(:)
    !> There is no such field, or the file is damaged
    type(error_t), allocatable, intent(out) :: error
    !> Whether it is a vector
    logical, intent(out), optional :: is_vector
    !> Only so many particles, after as many others
    integer(i8), intent(in), optional :: skip
    integer, intent(in), optional :: rows
    type(hdf5_silence_t) :: silence
    real(wp), allocatable :: found(:, :)
    integer(hsize_t) :: start, count
    integer :: k

    if (present(is_vector)) is_vector = .false.
    if (.not. this%has(name)) then
      call raise(error, status_bad_input, 'The file '''//this%path//''' has no field '''//name// &
                 '''.'//suggestion(name, this%field)//' It has '//join(this%field, ', ')//'.')
      return
    end if
    call silence%begin()
    start = start_of(this, '/VTKHDF/Steps/PointDataOffsets/'//name, step)
    if (present(skip) .and. start >= 0) start = start + skip
    count = this%particles
    if (present(rows)) count = rows
    call this%read_rows(point_data//name, start, count, found, error)
    call silence%finish()
    if (allocated(error)) return
    allocate (values(size(found, 2)), source=ieee_value(0.0_wp, ieee_quiet_nan))
    do k = 1, size(values)
      if (all(is_usable(found(:, k)))) values(k) = merge(found(1, k), norm2(found(:, k)), &
                                                        size(found, 1) == 1)
    end do
    if (present(is_vector)) is_vector = size(found, 1) > 1
  end subroutine read_field

  pure function has(this, name)
    class(stored_fields_t), intent(in) :: this
    character(len=*), intent(in) :: name
    logical :: has
    integer :: k

    has = .false.
    do k = 1, size(this%field)
      has = has .or. this%field(k)%value == name
    end do
  end function has

  function is_integer(this, name) result(answer)
    class(stored_fields_t), intent(in) :: this
    !> A field
    character(len=*), intent(in) :: name
    logical :: answer
    integer(hid_t) :: dataset, data_type
    integer :: status, kind_of_data

    answer = .false.
    call h5dopen_f(this%file_id, point_data//name, dataset, status)
    if (status < 0) return
    call h5dget_type_f(dataset, data_type, status)
    call h5tget_class_f(data_type, kind_of_data, status)
    answer = status >= 0 .and. kind_of_data == h5t_integer_f
    call h5tclose_f(data_type, status)
    call h5dclose_f(dataset, status)
  end function is_integer

  function accounts(this) result(names)
    class(stored_fields_t), intent(in) :: this
    type(text_t), allocatable :: names(:)
    character(len=*), parameter :: mark = 'budget_'
    character(len=200) :: name
    integer :: members, kind_of_member, k, status

    allocate (names(0))
    call h5gn_members_f(this%file_id, origin, members, status)
    if (status < 0) return
    do k = 0, members - 1
      call h5gget_obj_info_idx_f(this%file_id, origin, k, name, kind_of_member, status)
      if (status < 0 .or. index(name, mark) /= 1) cycle
      if (all(budget_lists /= name(len(mark) + 1:))) call append(names, trim(name(len(mark) + 1:)))
    end do
  end function accounts

  function note(this, name) result(text)
    class(stored_fields_t), intent(in) :: this
    !> Its name, as in 'scene'
    character(len=*), intent(in) :: name
    character(len=:), allocatable :: text

    text = text_of(this%file_id, name)
  end function note

  !> Empty where there is none of that name that a run can have written.
  function series(this, name) result(numbers)
    class(stored_fields_t), intent(in) :: this
    !> Its name, as in 'budget_time'
    character(len=*), intent(in) :: name
    real(wp), allocatable :: numbers(:)
    type(error_t), allocatable :: error
    type(hdf5_silence_t) :: silence
    real(wp), allocatable :: rows(:, :)
    integer(hsize_t) :: none

    allocate (numbers(0))
    if (.not. hdf5_has(this%file_id, origin//'/'//name)) return
    none = 0
    call silence%begin()
    call this%read_rows(origin//'/'//name, none, -1_hsize_t, rows, error)
    call silence%finish()
    if (allocated(error)) return
    if (all(is_usable(rows))) numbers = rows(1, :)
  end function series

  !> 0 where there is none of that name that a run can have written.
  function number(this, name) result(value)
    class(stored_fields_t), intent(in) :: this
    !> Its name, as in 'spacing'
    character(len=*), intent(in) :: name
    real(wp) :: value
    real(wp), target :: found
    integer(hid_t) :: attribute
    integer :: status
    logical :: there
    type(c_ptr) :: address

    value = 0
    call h5aexists_by_name_f(this%file_id, origin, name, there, status)
    if (status < 0 .or. .not. there) return
    call h5aopen_by_name_f(this%file_id, origin, name, attribute, status)
    if (status < 0) return
    address = c_loc(found)
    call h5aread_f(attribute, h5kind_to_type(wp, h5_real_kind), address, status)
    if (status >= 0) then
      if (is_usable(found)) value = found
    end if
    call h5aclose_f(attribute, status)
  end function number

  subroutine close_stored(this)
    class(stored_fields_t), intent(inout) :: this
    integer :: status

    if (this%file_id >= 0) call h5fclose_f(this%file_id, status)
    this%file_id = -1
  end subroutine close_stored

  !> Where the rows of a step begin
  function start_of(this, table, step) result(start)
    type(stored_fields_t), intent(in) :: this
    character(len=*), intent(in) :: table
    integer, intent(in) :: step
    integer(hsize_t) :: start
    type(error_t), allocatable :: error
    real(wp), allocatable :: rows(:, :)

    start = 0
    if (.not. hdf5_has(this%file_id, table)) return
    call this%read_rows(table, int(step - 1, hsize_t), 1_hsize_t, rows, error)
    if (allocated(error)) return
    start = -1
    if (is_usable(rows(1, 1))) start = nint(max(-1.0_wp, min(1.0e18_wp, rows(1, 1))), i8)
  end function start_of

  !> Read rows of a dataset of numbers: `values(component, row)`.
  subroutine read_rows(this, name, start, count, values, error)
    class(stored_fields_t), intent(in) :: this
    character(len=*), intent(in) :: name
    !> How many rows come before the first
    integer(hsize_t), intent(in) :: start
    !> How many are wanted; if negative, all
    integer(hsize_t), intent(in) :: count
    real(wp), allocatable, target, intent(out) :: values(:, :)
    type(error_t), allocatable, intent(out) :: error
    integer(hid_t) :: dataset, file_space, memory_space
    integer(hsize_t) :: extent(2), limit(2), from(2), block(2), stored
    !> Numbers in a byte, at most: deflate, the best that is common, makes 1032 bytes into one
    real(wp), parameter :: strongest_compression = 1032.0_wp
    type(c_ptr) :: address
    integer :: status, rank, first

    call h5dopen_f(this%file_id, name, dataset, status)
    if (status >= 0) call h5dget_space_f(dataset, file_space, status)
    if (status >= 0) call h5sget_simple_extent_ndims_f(file_space, rank, status)
    if (status >= 0 .and. (rank < 1 .or. rank > 2)) status = -1
    extent = 1
    if (status >= 0) then
      first = 3 - rank
      call h5sget_simple_extent_dims_f(file_space, extent(first:), limit(first:), status)
    end if
    if (status >= 0) then
      from = [0_hsize_t, start]
      block = extent
      block(2) = extent(2) - start
      if (count >= 0) block(2) = count
      if (start < 0 .or. block(2) < 0 .or. block(2) > extent(2) - start) status = -1
    end if
    if (status >= 0) then
      ! What was never written takes no room in the file, whatever its extent.
      call h5dget_storage_size_f(dataset, stored, status)
      if (status < 0) stored = 0
      status = 0
      if (real(block(1), wp)*real(block(2), wp) > strongest_compression*real(stored, &
                                                                             wp)) status = -1
    end if
    if (status >= 0) allocate (values(block(1), block(2)), stat=status)
    if (status > 0) status = -1
    if (status < 0) then
      call this%fail(error)
      return
    end if
    if (size(values) > 0) then
      call h5sselect_hyperslab_f(file_space, h5s_select_set_f, from(first:), block(first:), status)
      if (status >= 0) call h5screate_simple_f(rank, block(first:), memory_space, status)
      address = c_loc(values)
      if (status >= 0) then
        call h5dread_f(dataset, h5kind_to_type(wp, h5_real_kind), address, status, memory_space, &
                       file_space)
      end if
      if (status < 0) then
        call this%fail(error)
        return
      end if
      call h5sclose_f(memory_space, status)
    end if
    call h5sclose_f(file_space, status)
    call h5dclose_f(dataset, status)
  end subroutine read_rows

  !> Make an error of what has just failed.
  subroutine fail(this, error)
    class(stored_fields_t), intent(in) :: this
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: reason
    logical :: of_the_system

    reason = hdf5_reason(of_the_system)
    if (of_the_system) then
      call raise(error, status_bad_file, 'The file '''//this%path//''' cannot be read: '// &
                 reason//'.')
    else
      call raise(error, status_bad_input, 'The file '''//this%path// &
                 ''' is damaged or incomplete: run its scene again.')
    end if
  end subroutine fail

  !> An attribute that is a text of any length; '' where there is none
  function text_of(file_id, name) result(text)
    integer(hid_t), intent(in) :: file_id
    character(len=*), intent(in) :: name
    character(len=:), allocatable :: text
    integer(hid_t) :: attribute, text_type
    type(c_ptr), target :: letters
    type(c_ptr) :: address
    integer :: status, kind_of_data
    logical :: there

    text = ''
    call h5aexists_by_name_f(file_id, origin, name, there, status)
    if (status < 0 .or. .not. there) return
    call h5aopen_by_name_f(file_id, origin, name, attribute, status)
    if (status < 0) return
    letters = c_null_ptr
    address = c_loc(letters)
    call h5aget_type_f(attribute, text_type, status)
    call h5tget_class_f(text_type, kind_of_data, status)
    there = .false.
    if (kind_of_data == h5t_string_f) call h5tis_variable_str_f(text_type, there, status)
    if (there) then
      call h5aread_f(attribute, text_type, address, status)
      if (status >= 0) text = from_c(letters)
    end if
    call h5tclose_f(text_type, status)
    call h5aclose_f(attribute, status)
  end function text_of

end module calor_stored_fields
