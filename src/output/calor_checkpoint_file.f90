!> Checkpoint files: a saved state as HDF5, one data set for each item, with checksums.
!>
!> Behind the HDF5 file, where its readers do not look, stands a table of lines: one says what this
!> is and the format's version, one for each data set gives its name, place, bytes and checksum, and
!> the last one gives the place of the table and the checksum of all bytes before. So every changed
!> bit is found before HDF5 gets to see the file, and where it is.
!>
!> A file is made in memory, written beside its target and renamed into place when it is on the
!> disk: the target is always whole, be it the old one or the new one.
!>
!> Every failure is an error of status `status_bad_file` with one sentence for the user.
module calor_checkpoint_file
  use, intrinsic :: iso_c_binding, only: c_ptr, c_loc, c_null_ptr
  use, intrinsic :: iso_fortran_env, only: int8, int32
  use calor_checksum, only: checksum_t, checksum_text
  use calor_error, only: error_t, raise, status_bad_file
  use calor_file_system, only: look_at_path, path_missing, path_unreachable, path_file, &
                               read_obstacle, rename_file, remove_file, link_file, synchronise, &
                               resolved_path
  use calor_hdf5, only: start_hdf5, open_hdf5_file, hdf5_silence_t, hdf5_reason
  use calor_kinds, only: wp, i8
  use calor_saved_state, only: saved_state_t, saved_item_t
  use calor_text, only: to_text
  use hdf5, only: hid_t, hsize_t, size_t, h5kind_to_type, h5_integer_kind, h5_real_kind, &
                  h5f_acc_trunc_f, h5f_scope_global_f, h5p_dataset_create_f, h5p_file_access_f, &
                  h5p_file_create_f, h5p_link_create_f, h5s_scalar_f, h5t_fortran_s1, &
                  h5t_ieee_f64le, h5t_std_i32le, h5t_float_f, h5t_integer_f, &
                  h5dclose_f, h5dcreate_f, h5dget_offset_f, h5dget_space_f, h5dget_type_f, &
                  h5dopen_f, h5dread_f, h5dwrite_f, h5fclose_f, h5fcreate_f, h5fflush_f, &
                  h5fget_file_image_f, h5pclose_f, h5pcreate_f, h5pset_create_inter_group_f, &
                  h5pset_fapl_core_f, h5pset_obj_track_times_f, h5sclose_f, h5screate_f, &
                  h5screate_simple_f, h5sget_simple_extent_npoints_f, h5tclose_f, h5tcopy_f, &
                  h5tget_class_f, h5tget_size_f, h5tset_size_f
  implicit none (type, external)
  private

  public :: write_checkpoint_file, read_checkpoint_file, older_checkpoint

  !> The version of the format. A file of another version is refused.
  character(len=*), parameter :: title = 'calor checkpoint 1'
  character(len=*), parameter :: title_of_any = 'calor checkpoint '
  character(len=1), parameter :: line_feed = achar(10)
  !> What to do where a checkpoint cannot be used
  character(len=*), parameter :: remedy = 'Name another by --checkpoint, or run without --resume.'

  !> HDF5 has no texts without letters: what stands for them
  character(len=1), parameter :: no_text = achar(0)

  !> The last line: where the table begins, and the checksum of what comes before the number
  character(len=*), parameter :: last_mark = 'table at ', sum_mark = ' checksum '
  integer, parameter :: place_digits = 16, sum_digits = 16
  integer, parameter :: last_length = len(last_mark) + place_digits + len(sum_mark) + sum_digits + 1

  !> HDF5 enlarges its image in memory in steps of so many bytes
  integer(size_t), parameter :: increment = 1048576_size_t

contains

  !> Write a state into a file, in place of one of that name.
  subroutine write_checkpoint_file(path, state, keep, error)
    !> The file
    character(len=*), intent(in) :: path
    !> The state
    type(saved_state_t), intent(in) :: state
    !> How many of this name stay: the older ones get the names of `older_checkpoint`
    integer, intent(in) :: keep
    !> The file could not be written; one that was there before is as it was
    type(error_t), allocatable, intent(out) :: error
    integer(int8), allocatable :: image(:)
    character(len=:), allocatable :: reason, target_path, beside
    integer :: k

    call make_image(state, image, reason)
    target_path = resolved_path(path)
    beside = target_path//'.partial'
    if (reason == '') call write_whole(beside, image, reason)
    if (reason == '' .and. keep > 1) then
      do k = keep - 1, 2, -1
        call rename_file(older_checkpoint(target_path, k - 1), older_checkpoint(target_path, k), &
                         reason)
      end do
      call remove_file(older_checkpoint(target_path, 1), reason)
      ! Under a second name: at no time is there none under the first. Where that cannot be done, or
      ! there is none yet, no older one is kept.
      call link_file(target_path, older_checkpoint(target_path, 1), reason)
      reason = ''
    end if
    if (reason == '') call rename_file(beside, target_path, reason)
    if (reason == '') return
    call raise(error, status_bad_file, 'The checkpoint '''//path//''' could not be written: '// &
               reason//'.')
    call remove_file(beside, reason)
  end subroutine write_checkpoint_file

  !> What the checkpoint before is called, and the one before that: 'a.1.h5', 'a.2.h5' for 'a.h5'.
  pure function older_checkpoint(path, age) result(older)
    character(len=*), intent(in) :: path
    !> 1: the one before the last
    integer, intent(in) :: age
    character(len=:), allocatable :: older
    integer :: dot

    dot = index(path, '.', back=.true.)
    if (dot <= index(path, '/', back=.true.) + 1) dot = len(path) + 1
    older = path(:dot - 1)//'.'//to_text(age)//path(dot:)
  end function older_checkpoint

  !> Write bytes into a file and wait until they are on the disk.
  subroutine write_whole(path, bytes, reason)
    character(len=*), intent(in) :: path
    integer(int8), intent(in) :: bytes(:)
    !> Why that failed, or ''
    character(len=:), allocatable, intent(out) :: reason
    character(len=200) :: message
    integer(i8) :: written
    integer :: unit, status

    reason = ''
    message = ''
    open (newunit=unit, file=path, access='stream', form='unformatted', status='replace', &
          action='write', iostat=status, iomsg=message)
    if (status /= 0) then
      reason = short(message)
      return
    end if
    write (unit, iostat=status, iomsg=message) bytes
    if (status == 0) flush (unit, iostat=status, iomsg=message)
    if (status == 0) then
      call synchronise(unit, reason)
    else
      reason = short(message)
    end if
    close (unit, iostat=status, iomsg=message)
    if (status /= 0 .and. reason == '') reason = short(message)
    ! The compiler's library does not tell of every write that failed.
    inquire (file=path, size=written)
    if (reason == '' .and. written /= size(bytes, kind=i8)) then
      reason = 'no room is left on the disk, or files may not grow so large'
    end if
  end subroutine write_whole

  !> The system's words at the end of the compiler's
  pure function short(message) result(reason)
    character(len=*), intent(in) :: message
    character(len=:), allocatable :: reason

    reason = trim(message(index(message, ': ', back=.true.) + 1:))
    reason = adjustl(reason)
    reason = trim(reason)
  end function short

  ! ---------------------------------------------------------------------------------------------
  ! Making a file. From here on `status` is negative if an HDF5 call failed.
  ! ---------------------------------------------------------------------------------------------

  !> The bytes of a file.
  subroutine make_image(state, image, reason)
    type(saved_state_t), intent(in) :: state
    integer(int8), allocatable, intent(out), target :: image(:)
    !> Why there are none, or ''
    character(len=:), allocatable, intent(out) :: reason
    type(hdf5_silence_t) :: silence
    character(len=:), allocatable :: table, last
    character(len=place_digits) :: place
    integer(size_t) :: bytes
    type(c_ptr) :: address
    integer(hid_t) :: file_id
    integer(i8) :: from(state%items), length(state%items)
    integer :: status, k
    type(checksum_t) :: checksum

    reason = ''
    call silence%begin()
    call start_hdf5(status)
    if (status >= 0) call create_in_memory(file_id, status)
    do k = 1, state%items
      if (status < 0) exit
      call put_item(file_id, state%item(k), from(k), length(k), status)
    end do
    if (status >= 0) call h5fflush_f(file_id, h5f_scope_global_f, status)
    bytes = 0
    address = c_null_ptr
    if (status >= 0) call h5fget_file_image_f(file_id, address, 0_size_t, status, bytes)
    if (status >= 0) then
      allocate (image(bytes))
      address = c_loc(image)
      call h5fget_file_image_f(file_id, address, bytes, status)
    end if
    if (status < 0) reason = hdf5_reason()
    call h5fclose_f(file_id, status)
    call silence%finish()
    if (reason /= '') return

    table = line_feed//title//line_feed
    do k = 1, state%items
      table = table//state%item(k)%name//' '//to_text(from(k))//' '//to_text(length(k))//' '// &
              checksum_text(image(from(k) + 1:from(k) + length(k)))//line_feed
    end do
    write (place, '(i0.16)') bytes
    last = last_mark//place//sum_mark
    image = [image, bytes_of(table//last)]
    call checksum%add(image)
    image = [image, bytes_of(digits_of(checksum)//line_feed)]
  end subroutine make_image

  pure function digits_of(checksum) result(text)
    type(checksum_t), intent(in) :: checksum
    character(len=sum_digits) :: text

    write (text, '(z16.16)') checksum%value()
  end function digits_of

  pure function bytes_of(text) result(bytes)
    character(len=*), intent(in) :: text
    integer(int8) :: bytes(len(text))

    bytes = transfer(text, bytes)
  end function bytes_of

  subroutine create_in_memory(file_id, status)
    integer(hid_t), intent(out) :: file_id
    integer, intent(out) :: status
    integer(hid_t) :: access, creation

    file_id = -1
    call h5pcreate_f(h5p_file_access_f, access, status)
    if (status < 0) return
    call h5pset_fapl_core_f(access, increment, .false., status)
    if (status < 0) return
    call h5pcreate_f(h5p_file_create_f, creation, status)
    if (status < 0) return
    call h5pset_obj_track_times_f(creation, .false., status)
    if (status < 0) return
    call h5fcreate_f('calor checkpoint', h5f_acc_trunc_f, file_id, status, creation, access)
    if (status < 0) return
    call h5pclose_f(creation, status)
    call h5pclose_f(access, status)
  end subroutine create_in_memory

  !> Write an item, and tell where it is in the file.
  subroutine put_item(file_id, item, from, length, status)
    integer(hid_t), intent(in) :: file_id
    type(saved_item_t), intent(in), target :: item
    integer(i8), intent(out) :: from, length
    integer, intent(out) :: status
    integer(hid_t) :: dataset, space, file_type, memory, links, creation
    integer(hsize_t) :: offset
    integer(size_t) :: letters
    character(len=:), allocatable, target :: text
    type(c_ptr) :: address

    from = 0
    length = 0
    if (allocated(item%text)) then
      text = item%text
      if (len(text) == 0) text = no_text
      letters = len(text)
      call h5tcopy_f(h5t_fortran_s1, file_type, status)
      if (status >= 0) call h5tset_size_f(file_type, letters, status)
      if (status >= 0) call h5screate_f(h5s_scalar_f, space, status)
      memory = file_type
      length = letters
    else if (allocated(item%reals)) then
      file_type = h5t_ieee_f64le
      memory = h5kind_to_type(wp, h5_real_kind)
      call h5screate_simple_f(1, [size(item%reals, kind=hsize_t)], space, status)
      length = 8*size(item%reals, kind=i8)
    else
      file_type = h5t_std_i32le
      memory = h5kind_to_type(int32, h5_integer_kind)
      call h5screate_simple_f(1, [size(item%integers, kind=hsize_t)], space, status)
      length = 4*size(item%integers, kind=i8)
    end if
    if (status < 0) return
    call h5pcreate_f(h5p_link_create_f, links, status)
    if (status >= 0) call h5pset_create_inter_group_f(links, 1, status)
    if (status >= 0) call h5pcreate_f(h5p_dataset_create_f, creation, status)
    if (status >= 0) call h5pset_obj_track_times_f(creation, .false., status)
    if (status < 0) return
    call h5dcreate_f(file_id, item%name, file_type, space, dataset, status, creation, links)
    if (status < 0) return
    if (length > 0) then
      if (allocated(item%text)) then
        address = c_loc(text)
      else if (allocated(item%reals)) then
        address = c_loc(item%reals)
      else
        address = c_loc(item%integers)
      end if
      call h5dwrite_f(dataset, memory, address, status)
      if (status < 0) return
      call h5dget_offset_f(dataset, offset, status)
      if (status < 0) return
      from = offset
    end if
    call h5dclose_f(dataset, status)
    call h5sclose_f(space, status)
    call h5pclose_f(links, status)
    call h5pclose_f(creation, status)
    if (allocated(item%text)) call h5tclose_f(file_type, status)
  end subroutine put_item

  ! ---------------------------------------------------------------------------------------------
  ! Reading
  ! ---------------------------------------------------------------------------------------------

  !> Read a state back, if every bit of the file is as it was written.
  subroutine read_checkpoint_file(path, state, error)
    !> The file
    character(len=*), intent(in) :: path
    !> The state
    type(saved_state_t), intent(out) :: state
    !> There is no such file, or it is damaged
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: reason
    type(hdf5_silence_t) :: silence
    character(len=:), allocatable :: table
    integer(hid_t) :: file_id
    integer :: status, from, to

    call check_file(path, table, error)
    if (allocated(error)) return
    reason = ''
    call silence%begin()
    call start_hdf5(status)
    if (status >= 0) call open_hdf5_file(path, file_id, status)
    if (status >= 0) then
      from = 1
      do while (from <= len(table) .and. status >= 0)
        to = from + index(table(from:), line_feed) - 1
        call get_item(file_id, table(from:from + index(table(from:), ' ') - 2), state, status)
        from = to + 1
      end do
      if (status < 0) reason = hdf5_reason()
      call h5fclose_f(file_id, status)
    else
      reason = hdf5_reason()
    end if
    call silence%finish()
    if (reason /= '') call raise(error, status_bad_file, 'The checkpoint '''//path// &
                                 ''' could not be read: '//reason//'.')
  end subroutine read_checkpoint_file

  !> Make sure that a file is a checkpoint with every bit as it was written.
  subroutine check_file(path, table, error)
    character(len=*), intent(in) :: path
    !> The lines of its data sets
    character(len=:), allocatable, intent(out) :: table
    type(error_t), allocatable, intent(out) :: error
    integer(int8), allocatable :: bytes(:)
    character(len=:), allocatable :: last, text, head
    character(len=200) :: message
    type(checksum_t) :: checksum
    integer(i8) :: length, place
    integer :: unit, status, what

    call look_at_path(path, what, text)
    if (what == path_missing) then
      call raise(error, status_bad_file, 'There is no checkpoint '''//path// &
                 ''' to resume from: name another by --checkpoint, or run without --resume.')
    else if (what /= path_file .or. read_obstacle(path) /= '') then
      if (what == path_file) text = read_obstacle(path)
      if (text == '') text = 'it is no file'
      call raise(error, status_bad_file, 'The checkpoint '''//path//''' could not be read: '// &
                 text//'.')
    end if
    if (allocated(error)) return
    open (newunit=unit, file=path, access='stream', form='unformatted', status='old', &
          action='read', iostat=status, iomsg=message)
    length = 0
    if (status == 0) then
      inquire (unit=unit, size=length)
      allocate (bytes(max(0_i8, length)), stat=status)
      if (status == 0) read (unit, iostat=status, iomsg=message) bytes
      close (unit)
    end if
    if (status /= 0) then
      call raise(error, status_bad_file, 'The checkpoint '''//path//''' could not be read: '// &
                 short(message)//'.')
      return
    end if

    ! A table stands at the end, if anything is right about the file.
    place = -1
    last = ''
    if (length > last_length) last = text_of(bytes(length - last_length + 1:))
    if (last /= '') then
      if (last(:len(last_mark)) == last_mark) then
        text = last(len(last_mark) + 1:len(last_mark) + place_digits)
        read (text, '(i16)', iostat=status) place
        if (status /= 0) place = -1
      end if
    end if
    if (place < 0 .or. place > length - last_length) then
      call raise(error, status_bad_file, 'The checkpoint '''//path//''' is damaged at its end, '// &
                 'cut off or no checkpoint of calor''s: it is not used. '//remedy)
      return
    end if
    head = text_of(bytes(place + 1:length - last_length))
    call checksum%add(bytes(:length - sum_digits - 1))
    if (last(last_length - sum_digits:) /= digits_of(checksum)//line_feed) then
      call raise(error, status_bad_file, 'The checkpoint '''//path//''' is damaged '// &
                 damaged_part(bytes, head)//': it is not used. '//remedy)
      return
    end if
    if (index(head, line_feed//title//line_feed) /= 1) then
      text = head(2:)
      call raise(error, status_bad_file, 'The checkpoint '''//path//''' has the format '''// &
                 text(:index(text//line_feed, line_feed) - 1)//''', and this version of calor '// &
                 'reads '''//title//''': go on with the version that wrote it.')
      return
    end if
    table = head(len(title) + 3:)
  end subroutine check_file

  pure function text_of(bytes) result(text)
    integer(int8), intent(in) :: bytes(:)
    character(len=size(bytes)) :: text

    text = transfer(bytes, text)
  end function text_of

  !> Which data set is not what it was, in words; HDF5 does not get to see such a file.
  function damaged_part(bytes, head) result(words)
    integer(int8), intent(in) :: bytes(:)
    !> The table with its title
    character(len=*), intent(in) :: head
    character(len=:), allocatable :: words
    character(len=:), allocatable :: line
    character(len=sum_digits) :: expected
    integer(i8) :: place, length
    integer :: from, to, gap, status

    words = 'outside its data sets, in what holds them together'
    if (index(head, line_feed//title_of_any) /= 1) return
    from = 2 + index(head(2:), line_feed)
    do while (from <= len(head))
      to = index(head(from:), line_feed)
      if (to == 0) return
      line = head(from:from + to - 2)
      from = from + to
      gap = index(line, ' ')
      if (gap < 2) return
      read (line(gap:), *, iostat=status) place, length, expected
      if (status /= 0) return
      if (place < 0 .or. length < 0 .or. place > size(bytes, kind=i8)) return
      if (length > size(bytes, kind=i8) - place) return
      if (checksum_text(bytes(place + 1:place + length)) == expected) cycle
      words = 'in its data set '''//line(:gap - 1)//''''
      return
    end do
  end function damaged_part

  subroutine get_item(file_id, name, state, status)
    integer(hid_t), intent(in) :: file_id
    character(len=*), intent(in) :: name
    type(saved_state_t), intent(inout) :: state
    integer, intent(out) :: status
    integer(hid_t) :: dataset, data_type, space
    integer(hsize_t) :: entries
    integer(size_t) :: letters
    type(c_ptr) :: address
    integer :: kind_of_data, ignored

    call h5dopen_f(file_id, name, dataset, status)
    if (status < 0) return
    call h5dget_type_f(dataset, data_type, status)
    if (status >= 0) call h5tget_class_f(data_type, kind_of_data, status)
    if (status >= 0) call h5dget_space_f(dataset, space, status)
    if (status < 0) return
    ! Of a list without entries this says that it failed.
    entries = 0
    call h5sget_simple_extent_npoints_f(space, entries, ignored)
    if (ignored < 0) entries = 0
    if (kind_of_data == h5t_float_f) then
      call read_reals()
    else if (kind_of_data == h5t_integer_f) then
      call read_integers()
    else
      call h5tget_size_f(data_type, letters, status)
      if (status >= 0) call read_letters(int(letters))
    end if
    call h5sclose_f(space, ignored)
    call h5tclose_f(data_type, ignored)
    call h5dclose_f(dataset, ignored)

  contains

    subroutine read_reals()
      real(wp), allocatable, target :: values(:)

      allocate (values(entries))
      if (entries > 0) then
        address = c_loc(values)
        call h5dread_f(dataset, h5kind_to_type(wp, h5_real_kind), address, status)
      end if
      if (status >= 0) call state%put(name, values)
    end subroutine read_reals

    subroutine read_integers()
      integer, allocatable, target :: values(:)

      allocate (values(entries))
      if (entries > 0) then
        address = c_loc(values)
        call h5dread_f(dataset, h5kind_to_type(int32, h5_integer_kind), address, status)
      end if
      if (status >= 0) call state%put(name, values)
    end subroutine read_integers

    subroutine read_letters(count)
      integer, intent(in) :: count
      character(len=count), target :: text

      address = c_loc(text)
      call h5dread_f(dataset, data_type, address, status)
      if (status < 0) return
      if (text == no_text) then
        call state%put(name, '')
      else
        call state%put(name, text)
      end if
    end subroutine read_letters

  end subroutine get_item

end module calor_checkpoint_file
