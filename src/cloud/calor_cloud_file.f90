!> Reading a user's particles from a file: CSV text, or a VTKHDF file such as calor writes.
module calor_cloud_file
  use, intrinsic :: iso_c_binding, only: c_ptr, c_loc
  use, intrinsic :: iso_fortran_env, only: iostat_end
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use, intrinsic :: ieee_exceptions, only: ieee_status_type, ieee_get_status, ieee_set_status, &
                                           ieee_set_halting_mode, ieee_all
  use calor_cloud, only: cloud_t
  use calor_constants, only: greatest_size, least_size
  use calor_error, only: error_t, raise, status_bad_input, status_bad_file
  use calor_file_system, only: look_at_path, path_missing, path_file, path_folder, &
                               path_unreachable, read_obstacle
  use calor_hdf5, only: start_hdf5, open_hdf5_file, hdf5_has, hdf5_silence_t, hdf5_reason
  use calor_kinds, only: wp, ip, i8
  use calor_machine_memory, only: available_memory
  use calor_slice, only: slice_t
  use calor_text, only: text_t, to_text, lower_case, join
  use calor_trial, only: start_trial, end_trial
  use hdf5, only: hid_t, hsize_t, h5kind_to_type, &
                  h5_real_kind, h5s_select_set_f, h5t_float_f, h5t_integer_f, &
                  h5dclose_f, h5dget_space_f, h5dget_storage_size_f, h5dget_type_f, &
                  h5dopen_f, h5dread_f, &
                  h5fclose_f, h5sclose_f, h5screate_simple_f, &
                  h5sget_simple_extent_dims_f, h5sget_simple_extent_ndims_f, &
                  h5sselect_hyperslab_f, h5tclose_f, h5tget_class_f
  implicit none (type, external)
  private

  public :: read_cloud_file

  !> What the columns of a CSV file may mean; any other column is passed over
  character(len=*), parameter :: meanings(*) = [character(len=11) :: 'x', 'y', 'volume', 'wall', &
                                                   'normal_x', 'normal_y', 'wall_length']
  integer, parameter :: column_x = 1, column_y = 2, column_volume = 3, column_wall = 4, &
      column_normal_x = 5, column_normal_y = 6, column_length = 7

  !> What becomes of a text that should be a number
  integer, parameter :: is_number = 0, is_not_number = 1, is_not_finite = 2, is_too_large = 3

  !> How a cloud may be given, for messages
  character(len=*), parameter :: remedy = 'A cloud is a CSV file whose first line names '// &
                                 'its columns, as in x,y,volume,wall, or a VTKHDF file that '// &
                                 'calor wrote.'

  character(len=*), parameter :: line_feed = achar(10), carriage_return = achar(13), &
                                 tabulator = achar(9)

contains

  !> Read particles from a CSV file or from the first step of a VTKHDF file; the content decides.
  !>
  !> A CSV file has a header with the names of its columns in any order: x and y, and if so wished
  !> volume and wall (1 on the boundary, 0 inside), normal_x and normal_y (outward on the boundary,
  !> of any length) and wall_length (what a wall particle stands for, m). Blank lines and lines that
  !> begin with # are passed over, as are further columns. A VTKHDF file has them as `Points` and
  !> point data.
  !>
  !> The cloud is in the file's order. `volume` is 0 and `side` is 0 where the file does not give
  !> them; a wall is the boundary named 'wall'. `spacing` stays 0 and `area` unallocated.
  !> Whether particles coincide is not checked here.
  !>
  !> Fails with status 2 if there is no such file or its content is wrong, and with status 4 if the
  !> file cannot be read.
  subroutine read_cloud_file(path, cloud, has_volume, has_wall, error, ignored_columns, slice)
    !> The file
    character(len=*), intent(in) :: path
    !> The particles
    type(cloud_t), intent(out) :: cloud
    !> Whether the file gives volumes
    logical, intent(out) :: has_volume
    !> Whether the file says which particles lie on the boundary
    logical, intent(out) :: has_wall
    !> What is wrong, where, and what to do about it
    type(error_t), allocatable, intent(out) :: error
    !> Names of the CSV columns that were passed over
    type(text_t), allocatable, intent(out), optional :: ignored_columns(:)
    !> Only a slice of the particles, in the file's order, numbered from 1; perhaps none
    type(slice_t), intent(in), optional :: slice
    character(len=*), parameter :: hdf5_signature = char(137)//'HDF'//carriage_return// &
                                   line_feed//achar(26)//line_feed
    character(len=:), allocatable :: content, name
    type(text_t), allocatable :: ignored(:)
    type(ieee_status_type) :: floating_point
    integer, allocatable :: wall(:)
    integer(i8) :: start
    integer :: k

    has_volume = .false.
    has_wall = .false.
    name = trim(path)
    allocate (ignored(0))
    call check_file(name, error)
    if (allocated(error)) return
    call read_bytes(name, len(hdf5_signature, i8), content, error)
    if (allocated(error)) return
    ! Numbers that overflow are for our message, not for the traps of a caller that has set them.
    call ieee_get_status(floating_point)
    call ieee_set_halting_mode(ieee_all, .false.)
    if (content == hdf5_signature) then
      call read_vtkhdf(name, cloud, wall, has_volume, has_wall, error, slice)
    else if (present(slice)) then
      call read_lines(name, slice, content, start, error)
      if (.not. allocated(error)) then
        call read_csv(name, content, cloud, wall, has_volume, has_wall, ignored, error, 0)
        ! Only a message tells lines by number: then those before are worth counting.
        if (allocated(error)) then
          deallocate (error)
          call read_csv(name, content, cloud, wall, has_volume, has_wall, ignored, error, &
                        lines_before(name, start) - lines_in_header(content))
        end if
      end if
    else
      call read_bytes(name, huge(1_i8), content, error)
      if (.not. allocated(error)) then
        call read_csv(name, content, cloud, wall, has_volume, has_wall, ignored, error)
      end if
    end if
    call ieee_set_status(floating_point)
    if (allocated(error)) return

    if (.not. allocated(cloud%volume)) then
      allocate (cloud%volume(cloud%particles()))
      cloud%volume = 0.0_wp
    end if
    allocate (cloud%side(cloud%particles()))
    cloud%side = 0
    if (has_wall) then
      allocate (cloud%boundary(1))
      cloud%boundary(1)%value = 'wall'
      where (wall == 1) cloud%side = ibset(0_ip, 0)
    else
      allocate (cloud%boundary(0))
    end if
    cloud%user_index = [(int(k, ip), k=1, cloud%particles())]
    call settle_normals(name, cloud, error)
    if (allocated(error)) return
    if (present(ignored_columns)) call move_alloc(ignored, ignored_columns)
  end subroutine read_cloud_file

  !> Normals have two components, and the length 1.
  subroutine settle_normals(path, cloud, error)
    character(len=*), intent(in) :: path
    type(cloud_t), intent(inout) :: cloud
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: norm
    integer :: k

    if (allocated(cloud%normal_x) .neqv. allocated(cloud%normal_y)) then
      call raise(error, status_bad_input, 'The cloud''s file '''//path//''' gives only one of '// &
                 'normal_x and normal_y: give both or none.')
    end if
    if (allocated(error) .or. .not. allocated(cloud%normal_x)) return
    do k = 1, cloud%particles()
      norm = hypot(cloud%normal_x(k), cloud%normal_y(k))
      if (.not. norm > 0) cycle
      cloud%normal_x(k) = cloud%normal_x(k)/norm
      cloud%normal_y(k) = cloud%normal_y(k)/norm
    end do
  end subroutine settle_normals

  subroutine check_file(path, error)
    character(len=*), intent(in) :: path
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: reason
    integer :: what

    if (path == '') then
      call raise(error, status_bad_input, &
                 'The cloud''s file has no name: give one in &domain file.')
      return
    end if
    call look_at_path(path, what, reason)
    select case (what)
    case (path_file)
      reason = read_obstacle(path)
      if (reason /= '') then
        call raise(error, status_bad_file, 'The cloud''s file '''//path//''' cannot be read: '// &
                   reason//'.')
      end if
    case (path_missing)
      call raise(error, status_bad_input, 'The cloud''s file '''//path// &
                 ''' does not exist: check &domain file.')
    case (path_folder)
      call raise(error, status_bad_input, 'The cloud''s file '''//path// &
                 ''' is a folder: name the file in it in &domain file.')
    case (path_unreachable)
      call raise(error, status_bad_file, 'The cloud''s file '''//path//''' cannot be reached: '// &
                 reason//'.')
    case default
      call raise(error, status_bad_input, 'The cloud''s file '''//path// &
                 ''' is not a regular file: check &domain file.')
    end select
  end subroutine check_file

  !> The line of a CSV file that names the columns, with what stands before it, and of the lines
  !> after that the share of a slice: those that begin in its share of the bytes.
  subroutine read_lines(path, slice, content, start, error)
    character(len=*), intent(in) :: path
    type(slice_t), intent(in) :: slice
    character(len=:), allocatable, intent(out) :: content
    !> Bytes before the slice's lines
    integer(i8), intent(out) :: start
    type(error_t), allocatable, intent(out) :: error
    integer(i8), parameter :: block_length = 65536
    character(len=:), allocatable :: head, block
    character(len=200) :: message
    integer(i8) :: bytes, next, first, last, finish, most
    integer :: unit, status, line

    most = block_length
    do
      call read_bytes(path, most, head, error)
      if (allocated(error)) return
      next = 1
      line = 0
      call next_line(head, next, line, first, last)
      if ((last >= first .and. next <= len(head, i8)) .or. len(head, i8) < most) exit
      most = 2*most
    end do
    message = ''
    open (newunit=unit, file=path, access='stream', form='unformatted', status='old', &
          action='read', iostat=status, iomsg=message)
    if (status == 0) then
      inquire (unit=unit, size=bytes)
      next = min(next - 1, bytes)
      start = begin_of_line(next + (bytes - next)/slice%parts*slice%part)
      finish = bytes
      if (slice%part < slice%parts - 1) then
        finish = begin_of_line(next + (bytes - next)/slice%parts*(slice%part + 1))
      end if
      allocate (character(len=max(0_i8, finish - start)) :: block)
      if (finish > start) read (unit, pos=start + 1, iostat=status, iomsg=message) block
      close (unit)
      content = head(:next)//block
    end if
    if (status == 0) return
    call raise(error, status_bad_file, 'The cloud''s file '''//path//''' cannot be read: '// &
               trim(message)//'.')

  contains

    !> The bytes before the first line that begins after so many bytes, or right there
    integer(i8) function begin_of_line(bytes_before)
      integer(i8), intent(in) :: bytes_before
      character(len=1) :: letter

      begin_of_line = bytes_before
      if (bytes_before == next) return
      do while (begin_of_line < bytes)
        read (unit, pos=begin_of_line, iostat=status, iomsg=message) letter
        if (status /= 0 .or. letter == line_feed) return
        begin_of_line = begin_of_line + 1
      end do
    end function begin_of_line

  end subroutine read_lines

  !> How many lines end within the first bytes of a file.
  function lines_before(path, bytes) result(lines)
    character(len=*), intent(in) :: path
    integer(i8), intent(in) :: bytes
    integer :: lines
    character(len=65536) :: block
    integer(i8) :: done, k
    integer :: unit, status

    lines = 0
    done = 0
    open (newunit=unit, file=path, access='stream', form='unformatted', status='old', &
          action='read', iostat=status)
    if (status /= 0) return
    do while (done < bytes)
      associate (part => min(len(block, i8), bytes - done))
        read (unit, pos=done + 1, iostat=status) block(:part)
        if (status /= 0) exit
        do k = 1, part
          if (block(k:k) == line_feed) lines = lines + 1
        end do
        done = done + part
      end associate
    end do
    close (unit)
  end function lines_before

  !> How many lines there are up to the one that names the columns.
  pure function lines_in_header(content) result(line)
    character(len=*), intent(in) :: content
    integer :: line
    integer(i8) :: next, first, last

    next = 1
    line = 0
    call next_line(content, next, line, first, last)
  end function lines_in_header

  !> The file's bytes, but no more than `most` of them.
  subroutine read_bytes(path, most, content, error)
    character(len=*), intent(in) :: path
    integer(i8), intent(in) :: most
    character(len=:), allocatable, intent(out) :: content
    type(error_t), allocatable, intent(out) :: error
    character(len=200) :: message
    integer(i8) :: bytes
    integer :: unit, status

    message = ''
    open (newunit=unit, file=path, access='stream', form='unformatted', status='old', &
          action='read', iostat=status, iomsg=message)
    if (status == 0) then
      inquire (unit=unit, size=bytes)
      allocate (character(len=max(0_i8, min(bytes, most))) :: content, stat=status)
      if (status /= 0) then
        close (unit)
        call raise_too_large(path, 'it has '//to_text(bytes)//' bytes', error)
        return
      end if
      read (unit, iostat=status, iomsg=message) content
      close (unit)
    end if
    if (status == 0 .or. status == iostat_end) return
    call raise(error, status_bad_file, 'The cloud''s file '''//path//''' cannot be read: '// &
               trim(message)//'.')
  end subroutine read_bytes

  ! ---------------------------------------------------------------------------------------------
  ! CSV
  ! ---------------------------------------------------------------------------------------------

  subroutine read_csv(path, content, cloud, wall, has_volume, has_wall, ignored, error, skipped)
    character(len=*), intent(in) :: path
    character(len=*), intent(in) :: content
    type(cloud_t), intent(inout) :: cloud
    integer, allocatable, intent(out) :: wall(:)
    logical, intent(out) :: has_volume, has_wall
    type(text_t), allocatable, intent(out) :: ignored(:)
    type(error_t), allocatable, intent(out) :: error
    !> Of a slice: lines that were left out after the one that names the columns
    integer, intent(in), optional :: skipped
    !> What each column means; 0 for a column that is passed over
    integer, allocatable :: meaning(:)
    !> The names of the columns
    type(text_t), allocatable :: names(:)
    real(wp), allocatable :: values(:, :)
    real(wp) :: row(size(meanings))
    integer(i8) :: next, first, last
    integer :: line, rows, number

    has_volume = .false.
    has_wall = .false.
    next = 1
    if (index(content(:min(3, len(content))), char(239)//char(187)//char(191)) == 1) next = 4
    line = 0
    call next_line(content, next, line, first, last)
    if (last < first) then
      call raise(error, status_bad_input, 'The cloud''s file '''//path//''' is empty. '//remedy)
      return
    end if
    call read_header(path, line, content(first:last), names, meaning, error)
    if (allocated(error)) return
    has_volume = any(meaning == column_volume)
    has_wall = any(meaning == column_wall)
    ignored = pack_texts(names, meaning == 0)

    if (present(skipped)) line = line + skipped
    rows = lines_from(content, next)
    allocate (values(rows, size(meanings)))
    number = 0
    row = 0.0_wp
    do
      call next_line(content, next, line, first, last)
      if (last < first) exit
      call read_row(path, line, content(first:last), names, meaning, row, error)
      if (allocated(error)) return
      number = number + 1
      values(number, :) = row
    end do
    if (number == 0 .and. .not. present(skipped)) then
      call raise(error, status_bad_input, 'The cloud''s file '''//path// &
                 ''' has a header but no particles: give one line for each.')
      return
    end if
    cloud%x = values(:number, column_x)
    cloud%y = values(:number, column_y)
    if (has_volume) cloud%volume = values(:number, column_volume)
    if (any(meaning == column_normal_x)) cloud%normal_x = values(:number, column_normal_x)
    if (any(meaning == column_normal_y)) cloud%normal_y = values(:number, column_normal_y)
    if (any(meaning == column_length)) cloud%wall_length = values(:number, column_length)
    wall = nint(values(:number, column_wall))
  end subroutine read_csv

  !> Find the next line that says something, without the blanks around it. At the end of the
  !> content `last` is less than `first`.
  pure subroutine next_line(content, next, line, first, last)
    character(len=*), intent(in) :: content
    !> Where the next line begins
    integer(i8), intent(inout) :: next
    !> The number of the line in the file
    integer, intent(inout) :: line
    !> Where it begins and ends
    integer(i8), intent(out) :: first, last
    integer(i8) :: k

    do while (next <= len(content, i8))
      first = next
      do k = first, len(content, i8)
        if (content(k:k) == line_feed) exit
      end do
      next = k + 1
      last = k - 1
      line = line + 1
      call trim_blanks(content, first, last)
      if (last < first) cycle
      if (content(first:first) /= '#') return
    end do
    first = 1
    last = 0
  end subroutine next_line

  !> Narrow a stretch of text to what is not blank.
  pure subroutine trim_blanks(text, first, last)
    character(len=*), intent(in) :: text
    integer(i8), intent(inout) :: first, last

    do while (first <= last)
      if (.not. is_blank(text(first:first))) exit
      first = first + 1
    end do
    do while (last >= first)
      if (.not. is_blank(text(last:last))) exit
      last = last - 1
    end do
  end subroutine trim_blanks

  pure function is_blank(letter)
    character(len=1), intent(in) :: letter
    logical :: is_blank

    is_blank = letter == ' ' .or. letter == tabulator .or. letter == carriage_return
  end function is_blank

  pure function lines_from(content, start) result(lines)
    character(len=*), intent(in) :: content
    integer(i8), intent(in) :: start
    integer :: lines
    integer(i8) :: k

    lines = 1
    do k = start, len(content, i8)
      if (content(k:k) == line_feed) lines = lines + 1
    end do
  end function lines_from

  !> Find the next value of a line, without blanks and quotation marks around it.
  pure subroutine next_value(text, next, first, last)
    character(len=*), intent(in) :: text
    !> Where the value begins; after the last one, beyond the text's end by more than one
    integer(i8), intent(inout) :: next
    !> Where what counts of it begins and ends
    integer(i8), intent(out) :: first, last
    logical :: quoted
    integer(i8) :: k

    quoted = .false.
    do k = next, len(text, i8)
      if (text(k:k) == '"') quoted = .not. quoted
      if (text(k:k) == ',' .and. .not. quoted) exit
    end do
    first = next
    last = k - 1
    next = k + 1
    call trim_blanks(text, first, last)
    if (last <= first) return
    if (scan(text(first:first), '"''') == 1 .and. text(first:first) == text(last:last)) then
      first = first + 1
      last = last - 1
      call trim_blanks(text, first, last)
    end if
  end subroutine next_value

  subroutine read_header(path, line, text, names, meaning, error)
    character(len=*), intent(in) :: path
    integer, intent(in) :: line
    character(len=*), intent(in) :: text
    type(text_t), allocatable, intent(out) :: names(:)
    integer, allocatable, intent(out) :: meaning(:)
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: place
    real(wp) :: number
    integer(i8) :: next, first, last
    integer :: columns, k, column, what

    place = place_of(path, line)
    if (scan(text, achar(0)) > 0) then
      call raise(error, status_bad_input, 'The cloud''s file '''//path// &
                 ''' is neither text nor HDF5. '//remedy)
      return
    end if
    columns = 0
    next = 1
    do while (next <= len(text, i8) + 1)
      call next_value(text, next, first, last)
      columns = columns + 1
    end do
    allocate (names(columns), meaning(columns))
    meaning = 0
    next = 1
    do k = 1, columns
      call next_value(text, next, first, last)
      names(k)%value = clipped(text(first:last))
      do column = 1, size(meanings)
        if (lower_case(text(first:last)) /= meanings(column)) cycle
        if (any(meaning == column)) then
          call raise(error, status_bad_input, place//'two columns are named '''// &
                     trim(meanings(column))//''': keep one.')
          return
        end if
        meaning(k) = column
      end do
    end do

    if (any(meaning == column_x) .and. any(meaning == column_y)) return
    call to_number(names(1)%value, number, what)
    if (what == is_number) then
      call raise(error, status_bad_input, place//'numbers where the names of the columns '// &
                 'should be: put a line such as x,y or x,y,volume,wall before them.')
    else if (columns == 1 .and. scan(text, '; '//tabulator) > 0) then
      call raise(error, status_bad_input, place//'the names of the columns must be parted by '// &
                 'commas, as in x,y,volume,wall, and so must the numbers.')
    else if (any(meaning == column_x)) then
      call raise(error, status_bad_input, place//'there is no column ''y'', only '// &
                 listed(names)//': name the columns as in x,y,volume,wall.')
    else
      call raise(error, status_bad_input, place//'there is no column ''x'', only '// &
                 listed(names)//': name the columns as in x,y,volume,wall.')
    end if
  end subroutine read_header

  subroutine read_row(path, line, text, names, meaning, row, error)
    character(len=*), intent(in) :: path
    integer, intent(in) :: line
    character(len=*), intent(in) :: text
    type(text_t), intent(in) :: names(:)
    integer, intent(in) :: meaning(:)
    !> Values by meaning; those that the file does not give are left as they are
    real(wp), intent(inout) :: row(:)
    type(error_t), allocatable, intent(out) :: error
    integer(i8) :: next, first, last
    integer :: column, what
    real(wp) :: number

    next = 1
    column = 0
    do while (next <= len(text, i8) + 1)
      call next_value(text, next, first, last)
      column = column + 1
      if (column > size(meaning)) cycle
      if (meaning(column) == 0) cycle
      call to_number(text(first:last), number, what)
      if (what /= is_number .or. .not. fits(number, meaning(column))) then
        ! A line that is too short or too long is the likelier cause of a value in a wrong place.
        if (count_values(text) == size(meaning)) then
          call raise(error, status_bad_input, place_of(path, line)//'column '''// &
                     names(column)%value//''': '// &
                     complaint(text(first:last), what, meaning(column)))
          return
        end if
      end if
      row(meaning(column)) = number
    end do
    if (column == size(meaning)) return
    call raise(error, status_bad_input, place_of(path, line)//to_text(column)// &
               trim(merge(' value ', ' values', column == 1))//' for '//to_text(size(meaning))// &
               ' columns ('//listed(names)//'): give one for each, parted by commas.')
  end subroutine read_row

  pure function count_values(text) result(values)
    character(len=*), intent(in) :: text
    integer :: values
    integer(i8) :: next, first, last

    values = 0
    next = 1
    do while (next <= len(text, i8) + 1)
      call next_value(text, next, first, last)
      values = values + 1
    end do
  end function count_values

  !> Whether a number can be what the column says.
  pure function fits(number, meaning)
    real(wp), intent(in) :: number
    integer, intent(in) :: meaning
    logical :: fits

    select case (meaning)
    case (column_volume)
      fits = number >= least_size**2
    case (column_length)
      fits = number >= 0.0_wp
    case (column_wall)
      fits = .not. (abs(number) > 0.0_wp .and. abs(number - 1.0_wp) > 0.0_wp)
    case default
      fits = .true.
    end select
  end function fits

  !> What is wrong with a value, and what it should be.
  pure function complaint(text, what, meaning) result(sentence)
    character(len=*), intent(in) :: text
    integer, intent(in) :: what, meaning
    character(len=:), allocatable :: sentence

    if (text == '') then
      sentence = 'there is no value'
    else
      select case (what)
      case (is_not_number)
        sentence = ''''//clipped(text)//''' is not a number'
      case (is_not_finite)
        sentence = ''''//clipped(text)//''' is not a finite number'
      case (is_too_large)
        sentence = ''''//clipped(text)//''' is larger than '//to_text(greatest_size)// &
                   ', the greatest number that a cloud may have'
      case default
        sentence = ''''//clipped(text)//''' cannot be'
      end select
    end if
    select case (meaning)
    case (column_volume)
      sentence = sentence//': a volume is a number greater than 0.'
    case (column_wall)
      sentence = sentence//': it is 1 for a particle on the boundary and 0 for one inside.'
    case (column_normal_x, column_normal_y)
      sentence = sentence//': give a component of the outward normal, 0 inside.'
    case (column_length)
      sentence = sentence//': give a length in metres, 0 inside.'
    case default
      sentence = sentence//': give a coordinate in metres.'
    end select
  end function complaint

  !> Read a number. Fortran's own reading is exact but slow; most numbers have so few digits that
  !> one multiplication or division of two numbers that are exact gives the same (Clinger 1990).
  pure subroutine to_number(text, number, what)
    character(len=*), intent(in) :: text
    real(wp), intent(out) :: number
    !> `is_number`, or what is wrong
    integer, intent(out) :: what
    integer, parameter :: most_digits = 15, most_powers = 22
    integer :: j
    real(wp), parameter :: powers(0:most_powers) = [(10.0_wp**j, j=0, most_powers)]
    integer(i8) :: mantissa
    integer :: k, digits, significant, scale, exponent, sign, digit, status
    logical :: point

    number = 0.0_wp
    what = is_not_number
    mantissa = 0
    digits = 0
    significant = 0
    scale = 0
    point = .false.
    k = 1
    if (k <= len(text)) then
      if (text(k:k) == '+' .or. text(k:k) == '-') k = k + 1
    end if
    do while (k <= len(text))
      if (text(k:k) == '.') then
        if (point) return
        point = .true.
      else
        digit = iachar(text(k:k)) - iachar('0')
        if (digit < 0 .or. digit > 9) exit
        digits = digits + 1
        if (significant > 0 .or. digit > 0) significant = significant + 1
        if (significant <= most_digits) mantissa = 10*mantissa + digit
        if (point) scale = scale - 1
      end if
      k = k + 1
    end do
    if (digits == 0) then
      select case (lower_case(text(min(k, len(text) + 1):)))
      case ('nan', 'inf', 'infinity')
        what = is_not_finite
      case default
        what = is_not_number
      end select
      return
    end if

    exponent = 0
    if (k <= len(text)) then
      if (scan(text(k:k), 'eEdD') == 0) return
      k = k + 1
      sign = 1
      if (k <= len(text)) then
        if (text(k:k) == '-') sign = -1
        if (text(k:k) == '+' .or. text(k:k) == '-') k = k + 1
      end if
      if (k > len(text)) return
      if (verify(text(k:), '0123456789') /= 0) return
      do while (k <= len(text))
        exponent = min(99999, 10*exponent + iachar(text(k:k)) - iachar('0'))
        k = k + 1
      end do
      exponent = sign*exponent
    end if

    what = is_number
    scale = scale + exponent
    if (significant <= most_digits .and. abs(scale) <= most_powers) then
      if (scale < 0) then
        number = real(mantissa, wp)/powers(-scale)
      else
        number = real(mantissa, wp)*powers(scale)
      end if
      if (text(1:1) == '-') number = -number
    else
      read (text, *, iostat=status) number
      if (status /= 0 .or. .not. ieee_is_finite(number)) what = is_not_finite
    end if
    if (what == is_number .and. abs(number) > greatest_size) what = is_too_large
  end subroutine to_number

  pure function place_of(path, line) result(place)
    character(len=*), intent(in) :: path
    integer, intent(in) :: line
    character(len=:), allocatable :: place

    place = 'The cloud''s file '''//path//''', line '//to_text(line)//': '
  end function place_of

  !> Text for a message: its beginning, if it is long.
  pure function clipped(text) result(shown)
    character(len=*), intent(in) :: text
    character(len=:), allocatable :: shown
    integer, parameter :: most = 40

    if (len(text) <= most) then
      shown = text
    else
      shown = text(:most)//'...'
    end if
  end function clipped

  !> The first names of a list, parted by commas.
  pure function listed(names) result(list)
    type(text_t), intent(in) :: names(:)
    character(len=:), allocatable :: list
    integer, parameter :: most = 8

    list = join(names(:min(most, size(names))), ', ')
    if (size(names) > most) list = list//', ...'
  end function listed

  pure function pack_texts(texts, chosen) result(packed)
    type(text_t), intent(in) :: texts(:)
    logical, intent(in) :: chosen(:)
    type(text_t), allocatable :: packed(:)
    integer :: k, place

    allocate (packed(count(chosen)))
    place = 0
    do k = 1, size(texts)
      if (.not. chosen(k)) cycle
      place = place + 1
      packed(place)%value = texts(k)%value
    end do
  end function pack_texts

  ! ---------------------------------------------------------------------------------------------
  ! VTKHDF
  ! ---------------------------------------------------------------------------------------------

  subroutine read_vtkhdf(path, cloud, wall, has_volume, has_wall, error, slice)
    character(len=*), intent(in) :: path
    type(cloud_t), intent(inout) :: cloud
    integer, allocatable, intent(out) :: wall(:)
    logical, intent(out) :: has_volume, has_wall
    type(error_t), allocatable, intent(out) :: error
    type(slice_t), intent(in), optional :: slice
    type(hdf5_silence_t) :: silence
    integer(hid_t) :: file_id
    integer :: status
    logical :: inside, survived

    has_volume = .false.
    has_wall = .false.
    ! Who reads a slice is one of many processes that exchange messages, which cannot be copied.
    inside = .false.
    survived = .true.
    if (.not. present(slice)) call start_trial(inside, survived)
    if (.not. survived) then
      call raise(error, status_bad_input, 'The cloud''s file '''//path// &
                 ''' is a damaged HDF5 file, which HDF5 cannot read: write or copy it again.')
      return
    end if
    call silence%begin()
    call start_hdf5(status)
    if (status >= 0) call open_hdf5_file(path, file_id, status)
    if (status < 0) then
      call raise_damaged(path, error)
    else
      call read_particles(path, file_id, cloud, wall, has_volume, has_wall, error, slice)
      call h5fclose_f(file_id, status)
    end if
    call silence%finish()
    if (inside) call end_trial()
  end subroutine read_vtkhdf

  subroutine read_particles(path, file_id, cloud, wall, has_volume, has_wall, error, slice)
    character(len=*), intent(in) :: path
    integer(hid_t), intent(in) :: file_id
    type(cloud_t), intent(inout) :: cloud
    integer, allocatable, intent(out) :: wall(:)
    logical, intent(out) :: has_volume, has_wall
    type(error_t), allocatable, intent(out) :: error
    type(slice_t), intent(in), optional :: slice
    real(wp), allocatable :: points(:, :), column(:)
    integer(i8) :: rows, all_rows, before
    integer :: first, k, last

    has_volume = .false.
    has_wall = .false.
    if (.not. hdf5_has(file_id, '/VTKHDF/Points')) then
      call raise(error, status_bad_input, 'The cloud''s file '''//path// &
                 ''' is HDF5 but has no /VTKHDF/Points. '//remedy)
      return
    end if
    call count_points(path, file_id, rows, error)
    if (allocated(error)) return
    before = 0
    if (present(slice)) then
      if (rows < 0) call count_rows(path, file_id, '/VTKHDF/Points', rows, error)
      if (allocated(error)) return
      call slice%share(int(rows), first, last)
    end if
    all_rows = rows
    if (present(slice)) then
      before = first
      rows = last - first + 1
    end if
    call read_rows(path, file_id, '/VTKHDF/Points', 3, rows, points, error, before)
    if (allocated(error)) return
    if (rows == 0 .and. all_rows <= 0) then
      call raise(error, status_bad_input, 'The cloud''s file '''//path//''' has no particles.')
      return
    end if
    do k = 1, int(rows)
      if (.not. all(ieee_is_finite(points(:, k)))) then
        call raise(error, status_bad_input, particle_of(path, '/VTKHDF/Points', k + int(before))// &
                   'a coordinate is not a finite number.')
      else if (abs(points(3, k)) > 0.0_wp) then
        call raise(error, status_bad_input, particle_of(path, '/VTKHDF/Points', k + int(before))// &
                   'z is '//to_text(points(3, k))//', but a cloud lies in the plane z = 0.')
      else if (maxval(abs(points(:, k))) > greatest_size) then
        call raise(error, status_bad_input, particle_of(path, '/VTKHDF/Points', k + int(before))// &
                   complaint(to_text(maxval(abs(points(:, k)))), is_too_large, column_x))
      end if
      if (allocated(error)) return
    end do
    cloud%x = points(1, :)
    cloud%y = points(2, :)

    call read_point_data(path, file_id, column_volume, rows, cloud%volume, error, before)
    if (allocated(error)) return
    has_volume = allocated(cloud%volume)
    call read_point_data(path, file_id, column_normal_x, rows, cloud%normal_x, error, before)
    if (allocated(error)) return
    call read_point_data(path, file_id, column_normal_y, rows, cloud%normal_y, error, before)
    if (allocated(error)) return
    call read_point_data(path, file_id, column_length, rows, cloud%wall_length, error, &
                         before)
    if (allocated(error)) return
    call read_point_data(path, file_id, column_wall, rows, column, error, before)
    if (allocated(error)) return
    has_wall = allocated(column)
    if (has_wall) wall = nint(column)
  end subroutine read_particles

  !> Read one of the point data; not allocated where the file has none of the name.
  subroutine read_point_data(path, file_id, meaning, rows, values, error, before)
    character(len=*), intent(in) :: path
    integer(hid_t), intent(in) :: file_id
    !> One of the columns
    integer, intent(in) :: meaning
    integer(i8), intent(inout) :: rows
    real(wp), allocatable, intent(out) :: values(:)
    type(error_t), allocatable, intent(out) :: error
    !> Rows that are left out before
    integer(i8), intent(in) :: before
    character(len=:), allocatable :: name
    real(wp), allocatable :: column(:, :)
    integer :: k, what

    name = '/VTKHDF/PointData/'//trim(meanings(meaning))
    if (.not. hdf5_has(file_id, name)) return
    call read_rows(path, file_id, name, 1, rows, column, error, before)
    if (allocated(error)) return
    do k = 1, int(rows)
      what = is_number
      if (.not. ieee_is_finite(column(1, k))) then
        what = is_not_finite
      else if (abs(column(1, k)) > greatest_size) then
        what = is_too_large
      else if (fits(column(1, k), meaning)) then
        cycle
      end if
      call raise(error, status_bad_input, particle_of(path, name, k + int(before))// &
                 complaint(to_text(column(1, k)), what, meaning))
      return
    end do
    values = column(1, :)
  end subroutine read_point_data

  !> The number of particles in the first step.
  subroutine count_points(path, file_id, rows, error)
    character(len=*), intent(in) :: path
    integer(hid_t), intent(in) :: file_id
    integer(i8), intent(out) :: rows
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: points(:, :), parts(:, :)
    integer(i8) :: number

    ! Without these tables -1 asks for all the points that there are.
    rows = -1
    if (.not. hdf5_has(file_id, '/VTKHDF/NumberOfPoints')) return
    number = -1
    if (hdf5_has(file_id, '/VTKHDF/Steps/NumberOfParts')) then
      number = 1
      call read_rows(path, file_id, '/VTKHDF/Steps/NumberOfParts', 1, number, parts, error)
      if (allocated(error)) return
      if (.not. (parts(1, 1) >= 0 .and. parts(1, 1) <= real(huge(1_ip), wp))) then
        call raise(error, status_bad_input, 'The cloud''s file '''//path// &
                   ''': /VTKHDF/Steps/NumberOfParts is no number of parts. '//remedy)
        return
      end if
      number = nint(parts(1, 1), i8)
    end if
    call read_rows(path, file_id, '/VTKHDF/NumberOfPoints', 1, number, points, error)
    if (allocated(error)) return
    if (.not. all(points >= 0 .and. points <= real(huge(1_ip), wp))) then
      call raise(error, status_bad_input, 'The cloud''s file '''//path// &
                 ''': /VTKHDF/NumberOfPoints is no number of particles. '//remedy)
      return
    end if
    rows = nint(sum(points), i8)
  end subroutine count_points

  !> Read the first rows of a dataset of numbers.
  subroutine read_rows(path, file_id, name, components, rows, values, error, before)
    character(len=*), intent(in) :: path
    integer(hid_t), intent(in) :: file_id
    character(len=*), intent(in) :: name
    !> How many numbers a row has; 1 means that the dataset has a single dimension
    integer, intent(in) :: components
    !> How many rows are wanted; if negative, all, and then their number is returned
    integer(i8), intent(inout) :: rows
    real(wp), allocatable, target, intent(out) :: values(:, :)
    type(error_t), allocatable, intent(out) :: error
    !> Rows that are left out before; 0 without it
    integer(i8), intent(in), optional :: before
    integer(hid_t) :: dataset, file_space, memory_space, data_type
    integer(hsize_t) :: extent(2), limit(2), block(2), offset(2), stored
    !> Numbers in a byte, at most: deflate, the best that is common, makes 1032 bytes into one
    real(wp), parameter :: strongest_compression = 1032.0_wp
    type(c_ptr) :: address
    integer :: status, kind_of_data, rank, first

    call h5dopen_f(file_id, name, dataset, status)
    if (status >= 0) call h5dget_type_f(dataset, data_type, status)
    if (status >= 0) call h5tget_class_f(data_type, kind_of_data, status)
    if (status >= 0) call h5dget_space_f(dataset, file_space, status)
    if (status >= 0) call h5sget_simple_extent_ndims_f(file_space, rank, status)
    if (status < 0) then
      call raise_damaged(path, error)
      return
    end if
    if (kind_of_data /= h5t_float_f .and. kind_of_data /= h5t_integer_f) then
      call raise(error, status_bad_input, 'The cloud''s file '''//path//''': '//name// &
                 ' does not hold numbers. '//remedy)
      return
    end if
    first = merge(2, 1, components == 1)
    extent = components
    if (rank == 3 - first) then
      call h5sget_simple_extent_dims_f(file_space, extent(first:), limit(first:), status)
    end if
    if (rank /= 3 - first .or. extent(1) /= components) then
      call raise(error, status_bad_input, 'The cloud''s file '''//path//''': '//name// &
                 ' should have '//trim(merge('one number   ', 'three numbers', components == 1))// &
                 ' for each particle. '//remedy)
      return
    end if
    if (rows < 0) rows = extent(2)
    offset = 0
    if (present(before)) offset(2) = before
    if (rows + offset(2) > extent(2)) then
      call raise(error, status_bad_input, 'The cloud''s file '''//path//''': '//name//' has '// &
                 to_text(int(extent(2), i8))//' rows where '//to_text(rows)//' are needed: the '// &
                 'file is not complete.')
      return
    end if

    ! What was never written takes no room in the file, whatever its extent.
    call h5dget_storage_size_f(dataset, stored, status)
    ! HDF5 takes 0 bytes for a failure.
    if (status < 0) stored = 0
    if (real(rows, wp)*components > strongest_compression*real(stored, wp)) then
      call raise(error, status_bad_input, 'The cloud''s file '''//path//''': '//name//' has '// &
                 to_text(rows)//' rows, but not so many were written: the file is not complete.')
      return
    end if
    if (real(rows, wp)*components*storage_size(1.0_wp)/8 > real(available_memory(), wp)) then
      status = 1
    else
      allocate (values(components, rows), stat=status)
    end if
    if (status /= 0) then
      call raise_too_large(path, name//' has '//to_text(rows)//' rows', error)
      return
    end if
    if (rows > 0) then
      block = [int(components, hsize_t), int(rows, hsize_t)]
      call h5sselect_hyperslab_f(file_space, h5s_select_set_f, offset(first:), &
                                 block(first:), status)
      if (status >= 0) call h5screate_simple_f(3 - first, block(first:), memory_space, status)
      address = c_loc(values)
      if (status >= 0) then
        call h5dread_f(dataset, h5kind_to_type(wp, h5_real_kind), address, status, memory_space, &
                       file_space)
      end if
      if (status < 0) then
        call raise_damaged(path, error)
        return
      end if
      call h5sclose_f(memory_space, status)
    end if
    call h5sclose_f(file_space, status)
    call h5tclose_f(data_type, status)
    call h5dclose_f(dataset, status)
  end subroutine read_rows

  !> How many rows a dataset of points has.
  subroutine count_rows(path, file_id, name, rows, error)
    character(len=*), intent(in) :: path
    integer(hid_t), intent(in) :: file_id
    character(len=*), intent(in) :: name
    integer(i8), intent(out) :: rows
    type(error_t), allocatable, intent(out) :: error
    integer(hid_t) :: dataset, space
    integer(hsize_t) :: extent(2), limit(2)
    integer :: rank, status

    rows = 0
    extent = 0
    call h5dopen_f(file_id, name, dataset, status)
    if (status >= 0) call h5dget_space_f(dataset, space, status)
    if (status >= 0) call h5sget_simple_extent_ndims_f(space, rank, status)
    if (status >= 0 .and. rank == 2) call h5sget_simple_extent_dims_f(space, extent, limit, status)
    if (status < 0) then
      call raise_damaged(path, error)
      return
    end if
    rows = extent(2)
    call h5sclose_f(space, status)
    call h5dclose_f(dataset, status)
  end subroutine count_rows

  subroutine raise_too_large(path, what, error)
    character(len=*), intent(in) :: path, what
    type(error_t), allocatable, intent(out) :: error

    call raise(error, status_bad_input, 'The cloud''s file '''//path//''': '//what// &
               ', more than this machine has memory for. Check that the file is what it should '// &
               'be, or take fewer particles.')
  end subroutine raise_too_large

  !> Make an error of the HDF5 call that has just failed.
  subroutine raise_damaged(path, error)
    character(len=*), intent(in) :: path
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: reason
    logical :: of_the_system

    reason = hdf5_reason(of_the_system)
    if (of_the_system) then
      call raise(error, status_bad_file, 'The cloud''s file '''//path//''' cannot be read: '// &
                 reason//'.')
    else
      call raise(error, status_bad_input, 'The cloud''s file '''//path// &
                 ''' is a damaged or incomplete HDF5 file: write or copy it again ('//reason//').')
    end if
  end subroutine raise_damaged

  pure function particle_of(path, name, particle) result(place)
    character(len=*), intent(in) :: path, name
    integer, intent(in) :: particle
    character(len=:), allocatable :: place

    place = 'The cloud''s file '''//path//''', '//name//', particle '//to_text(particle)//': '
  end function particle_of

end module calor_cloud_file
