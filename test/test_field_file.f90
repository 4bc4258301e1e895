!> Tests of `calor_field_file`: files are written with it and read back with HDF5 itself.
module test_field_file
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
  use, intrinsic :: iso_c_binding, only: c_associated, c_funptr, c_int, c_int64_t, c_loc, &
                                         c_ptr
  use, intrinsic :: iso_fortran_env, only: int8
  use calor_c_text, only: from_c
  use calor_error, only: error_t, status_bad_file
  use calor_field_file, only: field_file_t
  use calor_file_system, only: ignore_file_size_signal, look_at_path, path_missing
  use calor_hdf5, only: start_hdf5
  use calor_kinds, only: wp, i8
  use calor_text, only: text_t, to_text
  use hdf5, only: hid_t, hsize_t, size_t, h5aclose_f, h5aget_space_f, h5aget_type_f, &
                  h5aopen_by_name_f, h5aread_f, h5dclose_f, h5dget_space_f, &
                  h5dget_type_f, h5dopen_f, h5dread_f, h5f_acc_rdonly_f, h5fclose_f, h5fopen_f, &
                  h5kind_to_type, h5lexists_f, h5_real_kind, h5sclose_f, &
                  h5sget_simple_extent_dims_f, &
                  h5sget_simple_extent_ndims_f, h5t_ieee_f64le, h5t_std_i32le, h5t_std_i64le, &
                  h5t_std_u8le, h5t_str_nullpad_f, h5tclose_f, h5tequal_f, h5tget_size_f, &
                  h5tget_strpad_f, h5tis_variable_str_f
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_field_file

  character(len=*), parameter :: folder = 'build/test/'
  character(len=*), parameter :: path = folder//'field.vtkhdf'
  real(wp), parameter :: x(4) = [0.0_wp, 1.0_wp, 0.25_wp, 1.0_wp/3.0_wp]
  real(wp), parameter :: y(4) = [2.0_wp, -1.0_wp, 0.5_wp, 0.0_wp]

  !> The system's limit of some resource
  type, bind(c) :: limit_t
    integer(c_int64_t) :: soft, hard
  end type limit_t

  interface
    function getrlimit(resource, limit) result(status) bind(c, name='getrlimit')
      import :: c_int, limit_t
      implicit none (type, external)
      integer(c_int), intent(in), value :: resource
      type(limit_t), intent(out) :: limit
      integer(c_int) :: status
    end function getrlimit

    function setrlimit(resource, limit) result(status) bind(c, name='setrlimit')
      import :: c_int, limit_t
      implicit none (type, external)
      integer(c_int), intent(in), value :: resource
      type(limit_t), intent(in) :: limit
      integer(c_int) :: status
    end function setrlimit

    function h5eget_auto2(stack, printer, client) result(status) bind(c, name='H5Eget_auto2')
      import :: c_funptr, c_ptr, c_int, c_int64_t
      implicit none (type, external)
      integer(c_int64_t), intent(in), value :: stack
      type(c_funptr), intent(out) :: printer
      type(c_ptr), intent(out) :: client
      integer(c_int) :: status
    end function h5eget_auto2
  end interface

contains

  subroutine collect_field_file(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('particles', test_particles), &
                new_unittest('steps', test_steps), &
                new_unittest('fields of every kind', test_kinds), &
                new_unittest('a field that begins late', test_late), &
                new_unittest('many particles and steps', test_many), &
                new_unittest('a file without steps', test_without_steps), &
                new_unittest('metadata', test_metadata), &
                new_unittest('equal runs give equal files', test_equal_files), &
                new_unittest('the old file is kept', test_old_file), &
                new_unittest('readable while written', test_readable_while_written), &
                new_unittest('links', test_links), &
                new_unittest('wrong places', test_wrong_places), &
                new_unittest('wrong use', test_wrong_use), &
                new_unittest('a full disk', test_full_disk), &
                new_unittest('a host''s error printing', test_host_printing) &
                ]
  end subroutine collect_field_file

  subroutine test_particles(error)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: trouble
    integer(hid_t) :: file
    integer, allocatable :: version(:)

    call write_plate(path, 3, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    file = opened(path)
    call check_type(error, file, '/VTKHDF/Points', h5t_ieee_f64le, [3, 4])
    call check_reals(error, file, '/VTKHDF/Points', &
                     [x(1), y(1), 0.0_wp, x(2), y(2), 0.0_wp, x(3), y(3), 0.0_wp, &
                      x(4), y(4), 0.0_wp])
    call check_type(error, file, '/VTKHDF/Connectivity', h5t_std_i64le, [4])
    call check_reals(error, file, '/VTKHDF/Connectivity', [0.0_wp, 1.0_wp, 2.0_wp, 3.0_wp])
    call check_type(error, file, '/VTKHDF/Offsets', h5t_std_i64le, [5])
    call check_reals(error, file, '/VTKHDF/Offsets', [0.0_wp, 1.0_wp, 2.0_wp, 3.0_wp, 4.0_wp])
    call check_type(error, file, '/VTKHDF/Types', h5t_std_u8le, [4])
    call check_reals(error, file, '/VTKHDF/Types', [1.0_wp, 1.0_wp, 1.0_wp, 1.0_wp])
    call check_reals(error, file, '/VTKHDF/NumberOfPoints', [4.0_wp])
    call check_reals(error, file, '/VTKHDF/NumberOfCells', [4.0_wp])
    call check_reals(error, file, '/VTKHDF/NumberOfConnectivityIds', [4.0_wp])
    version = nint(real_attribute(file, '/VTKHDF', 'Version'))
    call expect(error, all(version == [2, 0]) .and. size(version) == 2, 'Version')
    call check_vtk_type(error, file)
    call close_file(file)
  end subroutine test_particles

  subroutine test_steps(error)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: trouble
    integer(hid_t) :: file
    real(wp), parameter :: zeros(3) = 0.0_wp
    integer :: k

    call write_plate(path, 3, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    file = opened(path)
    call check_reals_of(error, real_attribute(file, '/VTKHDF/Steps', 'NSteps'), [3.0_wp])
    call check_reals(error, file, '/VTKHDF/Steps/Values', [0.5_wp, 1.0_wp, 1.5_wp])
    call check_reals(error, file, '/VTKHDF/Steps/PartOffsets', zeros)
    call check_reals(error, file, '/VTKHDF/Steps/PointOffsets', zeros)
    call check_reals(error, file, '/VTKHDF/Steps/CellOffsets', zeros)
    call check_reals(error, file, '/VTKHDF/Steps/ConnectivityIdOffsets', zeros)
    call check_reals(error, file, '/VTKHDF/Steps/NumberOfParts', [1.0_wp, 1.0_wp, 1.0_wp])
    ! Static data are stored once and begin at the same row in each step.
    call check_type(error, file, '/VTKHDF/PointData/volume', h5t_ieee_f64le, [4])
    call check_reals(error, file, '/VTKHDF/PointData/volume', 2.0_wp + x)
    call check_type(error, file, '/VTKHDF/PointData/wall', h5t_std_i32le, [4])
    call check_reals(error, file, '/VTKHDF/PointData/wall', [1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp])
    call check_reals(error, file, '/VTKHDF/Steps/PointDataOffsets/volume', zeros)
    call check_reals(error, file, '/VTKHDF/Steps/PointDataOffsets/wall', zeros)
    ! Others are one step after another.
    call check_type(error, file, '/VTKHDF/PointData/temperature', h5t_ieee_f64le, [12])
    call check_reals(error, file, '/VTKHDF/PointData/temperature', &
                     [(x + real(k, wp), k=1, 3)])
    call check_type(error, file, '/VTKHDF/Steps/PointDataOffsets/temperature', h5t_std_i64le, [3])
    call check_reals(error, file, '/VTKHDF/Steps/PointDataOffsets/temperature', &
                     [0.0_wp, 4.0_wp, 8.0_wp])
    call close_file(file)
  end subroutine test_steps

  !> Vectors, integers, values written twice in a step, and values that a step leaves as they were.
  subroutine test_kinds(error)
    type(error_type), allocatable, intent(out) :: error
    type(field_file_t) :: output
    type(error_t), allocatable :: trouble
    integer(hid_t) :: file
    integer :: step, k

    call output%create(path, x, y, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    do step = 1, 3
      call output%begin_step(real(step, wp), trouble)
      call output%write_field('gradient', step*x, -step*y, trouble)
      call output%write_field('count', step*[1, 2, 3, 4], trouble)
      call output%write_field('twice', -x, trouble)
      call output%write_field('twice', step*x, trouble)
      if (step /= 2) call output%write_field('sometimes', step*y, trouble)
    end do
    ! A part of a larger array may be written as well.
    call write_part(output, trouble)
    call output%close(trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return

    file = opened(path)
    call check_type(error, file, '/VTKHDF/PointData/gradient', h5t_ieee_f64le, [3, 12])
    call check_reals(error, file, '/VTKHDF/PointData/gradient', &
                     [((step*x(k), -step*y(k), 0.0_wp, k=1, 4), step=1, 3)])
    call check_type(error, file, '/VTKHDF/PointData/count', h5t_std_i32le, [12])
    call check_reals(error, file, '/VTKHDF/PointData/count', &
                     [(step*[1.0_wp, 2.0_wp, 3.0_wp, 4.0_wp], step=1, 3)])
    call check_reals(error, file, '/VTKHDF/PointData/twice', [(step*x, step=1, 3)])
    call check_reals(error, file, '/VTKHDF/PointData/sometimes', [y, 3*y])
    call check_reals(error, file, '/VTKHDF/Steps/PointDataOffsets/sometimes', &
                     [0.0_wp, 0.0_wp, 4.0_wp])
    call check_reals(error, file, '/VTKHDF/PointData/part', [1.0_wp, 3.0_wp, 5.0_wp, 7.0_wp])
    call close_file(file)
  end subroutine test_kinds

  subroutine write_part(output, trouble)
    type(field_file_t), intent(inout) :: output
    type(error_t), allocatable, intent(out) :: trouble
    real(wp) :: numbers(8)
    integer :: k

    numbers = [(real(k, wp), k=1, 8)]
    call output%add_static('part', numbers(1::2), trouble)
  end subroutine write_part

  subroutine test_late(error)
    type(error_type), allocatable, intent(out) :: error
    type(field_file_t) :: output
    type(error_t), allocatable :: trouble
    integer(hid_t) :: file
    integer :: step
    real(wp), allocatable :: late(:)

    call output%create(path, x, y, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    do step = 1, 3
      call output%begin_step(real(step, wp), trouble)
      if (step == 3) call output%write_field('late', x, trouble)
      if (step == 3) call output%write_field('number', [1, 2, 3, 4], trouble)
    end do
    call output%close(trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    file = opened(path)
    late = reals(file, '/VTKHDF/PointData/late')
    call check(error, size(late) == 8 .and. all(ieee_is_nan(late(:4))) .and. &
               .not. any(abs(late(5:) - x) > 0.0_wp), 'NaN, then values')
    call check_reals(error, file, '/VTKHDF/Steps/PointDataOffsets/late', &
                     [0.0_wp, 0.0_wp, 4.0_wp])
    call check_reals(error, file, '/VTKHDF/PointData/number', &
                     [0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 2.0_wp, 3.0_wp, 4.0_wp])
    call close_file(file)
  end subroutine test_late

  !> More particles and more steps than fit into one chunk.
  subroutine test_many(error)
    type(error_type), allocatable, intent(out) :: error
    type(field_file_t) :: output
    type(error_t), allocatable :: trouble
    integer(hid_t) :: file
    integer, parameter :: particles = 150001, few = 3, steps = 300
    real(wp), allocatable :: large(:), back(:)
    integer :: k, step

    allocate (large(particles))
    large = [(real(k, wp), k=1, particles)]
    call output%create(path, large, large, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    do step = 1, 3
      call output%begin_step(real(step, wp), trouble)
      call output%write_field('large', step*large, trouble)
    end do
    call output%close(trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    file = opened(path)
    back = reals(file, '/VTKHDF/PointData/large')
    call check(error, size(back) == 3*particles .and. &
               .not. any(abs(back - [large, 2*large, 3*large]) > 0.0_wp), 'many particles')
    call close_file(file)
    if (allocated(error)) return

    call output%create(path, large(:few), large(:few), trouble)
    do step = 1, steps
      call output%begin_step(real(step, wp), trouble)
      call output%write_field('small', step + large(:few), trouble)
    end do
    call output%close(trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    file = opened(path)
    call check_reals(error, file, '/VTKHDF/Steps/Values', [(real(step, wp), step=1, steps)])
    call check_reals(error, file, '/VTKHDF/PointData/small', &
                     [(real(step, wp) + large(:few), step=1, steps)])
    call close_file(file)
  end subroutine test_many

  subroutine test_without_steps(error)
    type(error_type), allocatable, intent(out) :: error
    type(field_file_t) :: output
    type(error_t), allocatable :: trouble
    integer(hid_t) :: file
    logical :: exists
    integer :: status

    call output%create(path, x, y, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call output%add_static('laplacian_brookshaw', x, trouble)
    call output%close(trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    file = opened(path)
    call h5lexists_f(file, '/VTKHDF/Steps', exists, status)
    call check(error, .not. exists, 'no steps')
    call check_reals(error, file, '/VTKHDF/PointData/laplacian_brookshaw', x)
    call close_file(file)
  end subroutine test_without_steps

  subroutine test_metadata(error)
    type(error_type), allocatable, intent(out) :: error
    type(field_file_t) :: output
    type(error_t), allocatable :: trouble
    type(text_t) :: words(3)
    integer(hid_t) :: file
    character(len=:), allocatable :: scene
    integer :: k

    scene = ''
    do k = 1, 12000
      scene = scene//'line '//to_text(k)//achar(10)
    end do
    words(1)%value = 'conduction'
    words(2)%value = ''
    words(3)%value = 'W/m²'
    call output%create(path, x, y, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call output%set_attribute('scene', 'to be replaced', trouble)
    call output%set_attribute('scene', scene, trouble)
    call output%set_attribute('version', '0.1.0', trouble)
    call output%set_attribute('nothing', '', trouble)
    call output%set_attribute('effects', words, trouble)
    call output%set_attribute('none', words(:0), trouble)
    call output%set_attribute('relative_l2_error', 1.5e-3_wp, trouble)
    call output%set_attribute('range', [0.0_wp, 2.0_wp], trouble)
    call output%set_attribute('order', 4, trouble)
    call output%set_wall_time('neighbour search', 0.25_wp, trouble)
    call output%set_wall_time('time steps', 1.0_wp, trouble)
    call output%close(trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return

    file = opened(path)
    call expect(error, joined(file, 'scene') == scene//'|', 'a long text')
    call expect(error, joined(file, 'version') == '0.1.0|', 'a text')
    call expect(error, joined(file, 'nothing') == '|', 'an empty text')
    call expect(error, joined(file, 'effects') == 'conduction||W/m²|', 'texts')
    call expect(error, joined(file, 'none') == '', 'no texts')
    call check_reals_of(error, real_attribute(file, '/calor', 'relative_l2_error'), [1.5e-3_wp])
    call check_reals_of(error, real_attribute(file, '/calor', 'range'), [0.0_wp, 2.0_wp])
    call check_reals_of(error, real_attribute(file, '/calor', 'order'), [4.0_wp])
    call check_reals_of(error, real_attribute(file, '/calor/wall_time', 'neighbour search'), &
                        [0.25_wp])
    call close_file(file)
  end subroutine test_metadata

  subroutine test_equal_files(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: again = folder//'field again.vtkhdf'
    type(error_t), allocatable :: trouble
    integer(int8), allocatable :: first(:), second(:)

    call write_plate(path, 5, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    ! HDF5's time stamps count seconds.
    call execute_command_line('sleep 1.1')
    call write_plate(again, 5, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    first = bytes_of(path)
    second = bytes_of(again)
    call check(error, size(first), size(second))
    if (allocated(error)) return
    call check(error, all(first == second), 'the same bytes')
  end subroutine test_equal_files

  subroutine test_old_file(error)
    type(error_type), allocatable, intent(out) :: error
    type(field_file_t) :: output
    type(error_t), allocatable :: trouble
    integer(int8), allocatable :: old(:)

    call write_plate(path, 2, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    old = bytes_of(path)

    call output%create(path, x, y, trouble)
    call output%begin_step(0.0_wp, trouble)
    call output%write_field('temperature', x, trouble)
    call output%flush(trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call check(error, size(old) == size(bytes_of(path)) .and. exists(path//'.partial'), &
               'not replaced before it is published')
    if (allocated(error)) return
    call output%discard()
    call check(error, all(old == bytes_of(path)) .and. .not. exists(path//'.partial'), &
               'kept when the new file is discarded')
    if (allocated(error)) return
    ! Discarding twice, or what was never created, is harmless.
    call output%discard()

    call output%create(path, x, y, trouble)
    call output%publish(trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call check(error, size(old) /= size(bytes_of(path)) .and. .not. exists(path//'.partial'), &
               'replaced when it is published')
    if (allocated(error)) return
    call output%discard()
    call check(error, exists(path), 'a published file stays')
  end subroutine test_old_file

  !> What is on the disk after a flush is a whole file: a copy of its bytes can be read.
  subroutine test_readable_while_written(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: copy = folder//'field copy.vtkhdf'
    type(field_file_t) :: output
    type(error_t), allocatable :: trouble
    integer(hid_t) :: file
    integer :: step, unit, k

    call output%create(path, x, y, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    do step = 1, 4
      call output%begin_step(real(step, wp), trouble)
      call output%write_field('temperature', step*x, trouble)
      if (step == 1) call output%publish(trouble)
      call output%flush(trouble)
      call check_no_trouble(error, trouble)
      if (allocated(error)) return
      open (newunit=unit, file=copy, access='stream', form='unformatted', status='replace', &
            action='write')
      write (unit) bytes_of(path)
      close (unit)
      file = opened(copy)
      call check_reals_of(error, real_attribute(file, '/VTKHDF/Steps', 'NSteps'), [real(step, wp)])
      call check_reals(error, file, '/VTKHDF/PointData/temperature', [(k*x, k=1, step)])
      call close_file(file)
      if (allocated(error)) return
    end do
    call output%close(trouble)
    call check_no_trouble(error, trouble)
  end subroutine test_readable_while_written

  !> A link stays a link, and the file that it points to is replaced.
  subroutine test_links(error)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: trouble

    call execute_command_line('rm -rf '//folder//'elsewhere '//folder//'link && mkdir '// &
                              folder//'elsewhere && echo old > '//folder//'elsewhere/data && '// &
                              'ln -s elsewhere/data '//folder//'link')
    call write_plate(folder//'link', 1, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call check(error, size(bytes_of(folder//'elsewhere/data')) > 100, 'the file behind the link')
  end subroutine test_links

  subroutine test_wrong_places(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: unit

    open (newunit=unit, file=folder//'a file', status='replace', action='write')
    close (unit)
    call check_place(error, folder//'nowhere/field.vtkhdf', &
                     'the folder '''//folder//'nowhere'' does not exist: create it or '// &
                     'name another file')
    if (allocated(error)) return
    call check_place(error, folder//'a file/field.vtkhdf', ''''//folder//'a file'' is not a folder')
    if (allocated(error)) return
    call check_place(error, folder//'a file/further/field.vtkhdf', 'does not exist')
    if (allocated(error)) return
    call check_place(error, 'build/test', 'there is a folder of that name')
    if (allocated(error)) return
    call check_place(error, '/dev/null', 'not a regular file')
    if (allocated(error)) return
    call check_place(error, '', 'has no name')
    if (allocated(error)) return
    call check_place(error, folder//repeat('n', 300), 'File name too long')
  end subroutine test_wrong_places

  subroutine check_place(error, place, words)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: place, words
    type(field_file_t) :: output
    type(error_t), allocatable :: trouble

    call output%create(place, x, y, trouble)
    call check_trouble(error, trouble, words)
    if (allocated(error)) return
    call check(error, index(trouble%message, ''''//place//'''') > 0 .or. place == '', &
               'the path is named')
  end subroutine check_place

  subroutine test_wrong_use(error)
    type(error_type), allocatable, intent(out) :: error
    type(field_file_t) :: output
    type(error_t), allocatable :: trouble

    call output%begin_step(0.0_wp, trouble)
    call check_trouble(error, trouble, 'No output file is open')
    if (allocated(error)) return
    call output%create(path, x, y, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call output%write_field('t', x, trouble)
    call check_trouble(error, trouble, 'none has begun')
    if (allocated(error)) return
    call output%add_static('volume', x(:3), trouble)
    call check_trouble(error, trouble, '3 values for 4 particles')
    if (allocated(error)) return
    call output%add_static('volume', x, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call output%add_static('volume', x, trouble)
    call check_trouble(error, trouble, 'exist already')
    if (allocated(error)) return
    call output%begin_step(0.0_wp, trouble)
    call output%write_field('volume', x, trouble)
    call check_trouble(error, trouble, 'of another kind')
    if (allocated(error)) return
    call output%write_field('t', x, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call output%write_field('t', x, y, trouble)
    call check_trouble(error, trouble, 'of another kind')
    if (allocated(error)) return
    ! None of these spoils the file.
    call output%close(trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call output%flush(trouble)
    call check_trouble(error, trouble, 'No output file is open')
  end subroutine test_wrong_use

  !> The limit of file sizes stands in for a full disk: it fails in the same places.
  subroutine test_full_disk(error)
    type(error_type), allocatable, intent(out) :: error
    integer(i8), parameter :: limits(*) = [0_i8, 1000_i8, 70000_i8, 100000_i8, 200000_i8, 400000_i8]
    integer :: k, publish_at

    call ignore_file_size_signal()
    do k = 1, size(limits)
      do publish_at = 1, 1000, 999
        call fill_disk(limits(k), publish_at, error)
        if (allocated(error)) return
      end do
    end do
  end subroutine test_full_disk

  subroutine fill_disk(most, publish_at, error)
    !> How large a file may become
    integer(i8), intent(in) :: most
    !> The step that publishes
    integer, intent(in) :: publish_at
    type(error_type), allocatable, intent(out) :: error
    integer(c_int), parameter :: file_size = 1_c_int
    integer, parameter :: particles = 1000
    type(field_file_t) :: output
    type(error_t), allocatable :: trouble, last_trouble
    type(limit_t) :: limit, old_limit
    real(wp) :: values(particles)
    integer(hid_t) :: file
    integer :: step, whole_steps, k
    logical :: published

    values = [(real(k, wp), k=1, particles)]
    call write_plate(path, 1, trouble)
    if (getrlimit(file_size, old_limit) /= 0) return
    limit = limit_t(most, old_limit%hard)
    if (setrlimit(file_size, limit) /= 0) return

    whole_steps = 0
    published = .false.
    call output%create(path, values, values, trouble)
    do step = 1, 100
      if (allocated(trouble)) exit
      call output%begin_step(real(step, wp), trouble)
      if (.not. allocated(trouble)) call output%write_field('values', step*values, trouble)
      if (.not. allocated(trouble) .and. step == publish_at) then
        call output%publish(trouble)
        published = .not. allocated(trouble)
      end if
      if (.not. allocated(trouble)) call output%flush(trouble)
      if (.not. allocated(trouble)) whole_steps = step
    end do
    call output%close(last_trouble)

    if (setrlimit(file_size, old_limit) /= 0) return
    call check_trouble(error, trouble, 'could not be written: File too large')
    if (allocated(error)) return
    call check_trouble(error, last_trouble, path)
    if (allocated(error)) return
    call check(error, .not. exists(path//'.partial'), 'nothing is left behind')
    if (allocated(error)) return
    file = opened(path)
    call check(error, file > 0, 'the file can be read')
    if (allocated(error)) return
    if (published) then
      call check(error, all(nint(real_attribute(file, '/VTKHDF/Steps', 'NSteps')) == whole_steps), &
                 'all whole steps are in the file')
    else
      call check(error, all(nint(real_attribute(file, '/VTKHDF/Steps', 'NSteps')) == 1), &
                 'the old file is still there')
    end if
    call close_file(file)
  end subroutine fill_disk

  !> A host program's way of printing HDF5's errors is as it was after every call.
  subroutine test_host_printing(error)
    type(error_type), allocatable, intent(out) :: error
    integer(c_int64_t), parameter :: default_stack = 0
    type(c_funptr) :: before, after
    type(c_ptr) :: client
    type(field_file_t) :: output
    type(error_t), allocatable :: trouble

    call check(error, h5eget_auto2(default_stack, before, client) >= 0)
    if (allocated(error)) return
    call check(error, c_associated(before), 'HDF5 prints')
    if (allocated(error)) return
    call write_plate(path, 2, trouble)
    call output%create(folder//'nowhere/field.vtkhdf', x, y, trouble)
    call output%close(trouble)
    call check(error, h5eget_auto2(default_stack, after, client) >= 0)
    if (allocated(error)) return
    call check(error, c_associated(before, after), 'HDF5 prints as before')
  end subroutine test_host_printing

  ! ---------------------------------------------------------------------------------------------

  subroutine write_plate(place, steps, trouble)
    character(len=*), intent(in) :: place
    integer, intent(in) :: steps
    type(error_t), allocatable, intent(out) :: trouble
    type(field_file_t) :: output
    integer :: step

    call output%create(place, x, y, trouble)
    if (allocated(trouble)) return
    call output%set_attribute('scene', repeat('&scene / ', 9000), trouble)
    call output%add_static('volume', 2.0_wp + x, trouble)
    do step = 1, steps
      call output%begin_step(0.5_wp*step, trouble)
      call output%write_field('temperature', x + real(step, wp), trouble)
      if (step == 1) call output%add_static('wall', [1, 0, 0, 1], trouble)
      if (allocated(trouble)) return
    end do
    call output%set_wall_time('all', 1.0_wp, trouble)
    call output%close(trouble)
  end subroutine write_plate

  function exists(place)
    character(len=*), intent(in) :: place
    logical :: exists
    character(len=:), allocatable :: reason
    integer :: what

    call look_at_path(place, what, reason)
    exists = what /= path_missing
  end function exists

  function bytes_of(place) result(bytes)
    character(len=*), intent(in) :: place
    integer(int8), allocatable :: bytes(:)
    integer :: unit, length

    open (newunit=unit, file=place, access='stream', form='unformatted', status='old', &
          action='read')
    inquire (unit=unit, size=length)
    allocate (bytes(length))
    read (unit) bytes
    close (unit)
  end function bytes_of

  elemental function same(a, b)
    real(wp), intent(in) :: a, b
    logical :: same

    same = .not. abs(a - b) > 0.0_wp
  end function same

  function opened(place) result(file)
    character(len=*), intent(in) :: place
    integer(hid_t) :: file
    integer :: status

    call start_hdf5(status)
    call h5fopen_f(place, h5f_acc_rdonly_f, file, status)
    if (status < 0) file = -1
  end function opened

  subroutine close_file(file)
    integer(hid_t), intent(in) :: file
    integer :: status

    call h5fclose_f(file, status)
  end subroutine close_file

  !> The dataset has this type and these extents, in Fortran's order.
  subroutine check_type(error, file, name, file_type, extents)
    type(error_type), allocatable, intent(inout) :: error
    integer(hid_t), intent(in) :: file
    character(len=*), intent(in) :: name
    integer(hid_t), intent(in) :: file_type
    integer, intent(in) :: extents(:)
    integer(hid_t) :: dataset, data_type, space
    integer(hsize_t) :: found(2), limit(2)
    integer :: status, rank
    logical :: equal

    if (allocated(error)) return
    call h5dopen_f(file, name, dataset, status)
    call check(error, status, 0, name//' is missing')
    if (allocated(error)) return
    call h5dget_type_f(dataset, data_type, status)
    call h5tequal_f(data_type, file_type, equal, status)
    call h5dget_space_f(dataset, space, status)
    call h5sget_simple_extent_ndims_f(space, rank, status)
    call h5sget_simple_extent_dims_f(space, found(:rank), limit(:rank), status)
    call h5sclose_f(space, status)
    call h5tclose_f(data_type, status)
    call h5dclose_f(dataset, status)
    call check(error, equal, name//' is of another type')
    if (allocated(error)) return
    call check(error, rank, size(extents), name//' is of another rank')
    if (allocated(error)) return
    call check(error, all(found(:rank) == extents), name//' has another extent')
  end subroutine check_type

  !> All numbers of a dataset.
  function reals(file, name) result(values)
    integer(hid_t), intent(in) :: file
    character(len=*), intent(in) :: name
    real(wp), allocatable, target :: values(:)
    integer(hid_t) :: dataset, space
    integer(hsize_t) :: extent(2), limit(2)
    type(c_ptr) :: address
    integer :: status, rank

    call h5dopen_f(file, name, dataset, status)
    if (status < 0) then
      allocate (values(0))
      return
    end if
    call h5dget_space_f(dataset, space, status)
    call h5sget_simple_extent_ndims_f(space, rank, status)
    call h5sget_simple_extent_dims_f(space, extent(:rank), limit(:rank), status)
    allocate (values(product(extent(:rank))))
    address = c_loc(values)
    call h5dread_f(dataset, h5kind_to_type(wp, h5_real_kind), address, status)
    call h5sclose_f(space, status)
    call h5dclose_f(dataset, status)
  end function reals

  subroutine check_reals(error, file, name, expected)
    type(error_type), allocatable, intent(inout) :: error
    integer(hid_t), intent(in) :: file
    character(len=*), intent(in) :: name
    real(wp), intent(in) :: expected(:)
    real(wp), allocatable :: found(:)

    if (allocated(error)) return
    found = reals(file, name)
    call check(error, size(found), size(expected), name//' has another size')
    if (allocated(error)) return
    call check(error, all(same(found, expected)), name//' has other values')
  end subroutine check_reals

  subroutine check_reals_of(error, found, expected)
    type(error_type), allocatable, intent(inout) :: error
    real(wp), intent(in) :: found(:), expected(:)

    if (allocated(error)) return
    call check(error, size(found), size(expected), 'an attribute has another size')
    if (allocated(error)) return
    call check(error, all(same(found, expected)), 'an attribute has another value')
  end subroutine check_reals_of

  !> Check a condition unless something has failed before.
  subroutine expect(error, condition, what)
    type(error_type), allocatable, intent(inout) :: error
    logical, intent(in) :: condition
    character(len=*), intent(in) :: what

    if (allocated(error)) return
    call check(error, condition, what)
  end subroutine expect

  function real_attribute(file, group, name) result(values)
    integer(hid_t), intent(in) :: file
    character(len=*), intent(in) :: group, name
    real(wp), allocatable, target :: values(:)
    integer(hid_t) :: attribute
    type(c_ptr) :: address
    integer :: status

    call open_attribute(file, group, name, attribute, status)
    allocate (values(attribute_size(attribute)))
    address = c_loc(values)
    call h5aread_f(attribute, h5kind_to_type(wp, h5_real_kind), address, status)
    call h5aclose_f(attribute, status)
  end function real_attribute

  !> The texts of an attribute of `/calor`, each followed by a bar.
  function joined(file, name) result(text)
    integer(hid_t), intent(in) :: file
    character(len=*), intent(in) :: name
    character(len=:), allocatable :: text
    integer(hid_t) :: attribute, text_type
    type(c_ptr), allocatable, target :: addresses(:)
    type(c_ptr) :: address
    logical :: any_length
    integer :: k, status

    text = ''
    call open_attribute(file, '/calor', name, attribute, status)
    allocate (addresses(attribute_size(attribute)))
    call h5aget_type_f(attribute, text_type, status)
    call h5tis_variable_str_f(text_type, any_length, status)
    if (.not. any_length) return
    if (size(addresses) > 0) then
      address = c_loc(addresses)
      call h5aread_f(attribute, text_type, address, status)
    end if
    do k = 1, size(addresses)
      text = text//from_c(addresses(k))//'|'
    end do
    call h5tclose_f(text_type, status)
    call h5aclose_f(attribute, status)
  end function joined

  subroutine open_attribute(file, group, name, attribute, status)
    integer(hid_t), intent(in) :: file
    character(len=*), intent(in) :: group, name
    integer(hid_t), intent(out) :: attribute
    integer, intent(out) :: status

    call h5aopen_by_name_f(file, group, name, attribute, status)
  end subroutine open_attribute

  function attribute_size(attribute) result(number)
    integer(hid_t), intent(in) :: attribute
    integer :: number
    integer(hid_t) :: space
    integer(hsize_t) :: extent(1), limit(1)
    integer :: status, rank

    call h5aget_space_f(attribute, space, status)
    call h5sget_simple_extent_ndims_f(space, rank, status)
    number = 1
    if (rank == 1) then
      call h5sget_simple_extent_dims_f(space, extent, limit, status)
      number = int(extent(1))
    end if
    call h5sclose_f(space, status)
  end function attribute_size

  !> VTK wants its kind of data as a text of fixed length.
  subroutine check_vtk_type(error, file)
    type(error_type), allocatable, intent(inout) :: error
    integer(hid_t), intent(in) :: file
    integer(hid_t) :: attribute, text_type
    character(len=16), target :: text
    type(c_ptr) :: address
    integer(size_t) :: length
    integer :: padding, status

    if (allocated(error)) return
    call open_attribute(file, '/VTKHDF', 'Type', attribute, status)
    call h5aget_type_f(attribute, text_type, status)
    call h5tget_size_f(text_type, length, status)
    call h5tget_strpad_f(text_type, padding, status)
    text = ''
    address = c_loc(text)
    if (length == len(text)) call h5aread_f(attribute, text_type, address, status)
    call h5tclose_f(text_type, status)
    call h5aclose_f(attribute, status)
    call check(error, text, 'UnstructuredGrid')
    if (allocated(error)) return
    call check(error, padding, h5t_str_nullpad_f)
  end subroutine check_vtk_type

  subroutine check_no_trouble(error, trouble)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable, intent(in) :: trouble

    if (allocated(trouble)) call test_failed(error, trouble%message)
  end subroutine check_no_trouble

  !> There must be an error of a file, with these words.
  subroutine check_trouble(error, trouble, words)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable, intent(in) :: trouble
    character(len=*), intent(in) :: words

    if (.not. allocated(trouble)) then
      call test_failed(error, 'no error: '//words)
      return
    end if
    call check(error, trouble%status, status_bad_file, trouble%message)
    if (allocated(error)) return
    call check(error, index(trouble%message, words) > 0, &
               ''''//words//''' is missing in: '//trouble%message)
  end subroutine check_trouble

end module test_field_file
