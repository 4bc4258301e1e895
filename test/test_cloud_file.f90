!> Tests of `calor_cloud_file`.
module test_cloud_file
  use, intrinsic :: iso_c_binding, only: c_loc
  use, intrinsic :: iso_fortran_env, only: int8
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use calor_cloud, only: cloud_t
  use calor_cloud_file, only: read_cloud_file
  use calor_error, only: error_t, status_bad_input
  use calor_field_file, only: field_file_t
  use calor_kinds, only: wp, i8
  use calor_text, only: text_t, to_text
  use calor_trial, only: start_trial, end_trial
  use hdf5, only: hid_t, hsize_t, h5dclose_f, h5dcreate_f, h5dopen_f, h5dwrite_f, h5fclose_f, &
                  h5fopen_f, h5f_acc_rdwr_f, h5ldelete_f, h5sclose_f, h5screate_simple_f, &
                  h5t_native_double, h5t_native_integer
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_cloud_file

  character(len=*), parameter :: folder = 'build/test/'
  character(len=*), parameter :: csv = folder//'cloud.csv'
  character(len=*), parameter :: vtkhdf = folder//'cloud.vtkhdf'
  character(len=*), parameter :: lf = achar(10), cr = achar(13), tab = achar(9)

contains

  subroutine collect_cloud_file(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('plain csv', test_plain), &
                new_unittest('normals and lengths of walls', test_wall_geometry), &
                new_unittest('csv as people write it', test_tolerance), &
                new_unittest('csv without volume and wall', test_coordinates_only), &
                new_unittest('numbers are read exactly', test_numbers), &
                new_unittest('many long lines', test_many_lines), &
                new_unittest('wrong headers', test_wrong_headers), &
                new_unittest('wrong lines', test_wrong_lines), &
                new_unittest('wrong files', test_wrong_files), &
                new_unittest('vtkhdf', test_vtkhdf), &
                new_unittest('vtkhdf without steps', test_vtkhdf_without_steps), &
                new_unittest('wrong vtkhdf', test_wrong_vtkhdf), &
                new_unittest('damaged hdf5', test_damaged_hdf5), &
                new_unittest('hdf5 that HDF5 does not bear', test_unbearable), &
                new_unittest('trials in a process of their own', test_trial) &
                ]
  end subroutine collect_cloud_file

  subroutine test_plain(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    logical :: has_volume, has_wall
    type(error_t), allocatable :: trouble

    call write_file(csv, 'x,y,volume,wall'//lf//'0,0.5,0.25,1'//lf//'1e-1,-2.5E+1,3,0'//lf)
    call read_cloud_file(csv, cloud, has_volume, has_wall, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call check(error, cloud%particles(), 2)
    if (allocated(error)) return
    call check(error, has_volume .and. has_wall)
    if (allocated(error)) return
    call check(error, all(same(cloud%x, [0.0_wp, 0.1_wp])) .and. &
               all(same(cloud%y, [0.5_wp, -25.0_wp])) .and. &
               all(same(cloud%volume, [0.25_wp, 3.0_wp])), 'values')
    if (allocated(error)) return
    call check(error, all(cloud%side == [1, 0]) .and. all(cloud%user_index == [1, 2]), 'sides')
    if (allocated(error)) return
    call check(error, size(cloud%boundary), 1)
    if (allocated(error)) return
    call check(error, cloud%boundary(1)%value, 'wall')
  end subroutine test_plain

  !> Normals and lengths of walls, from both kinds of file.
  subroutine test_wall_geometry(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    logical :: has_volume, has_wall
    type(error_t), allocatable :: trouble
    type(field_file_t) :: file
    character(len=*), parameter :: header = 'wall_length,x,Normal_Y,y,normal_x'//lf, &
        vtkhdf = 'build/test/wall_geometry.vtkhdf'
    integer :: k

    call write_file(csv, header//'0.5,0,4,0,-3'//lf//'0,1,0,1,0'//lf)
    call file%create(vtkhdf, [0.0_wp, 1.0_wp], [0.0_wp, 1.0_wp], trouble)
    if (.not. allocated(trouble)) call file%add_static('normal_x', [-3.0_wp, 0.0_wp], trouble)
    if (.not. allocated(trouble)) call file%add_static('normal_y', [4.0_wp, 0.0_wp], trouble)
    if (.not. allocated(trouble)) call file%add_static('wall_length', [0.5_wp, 0.0_wp], trouble)
    if (.not. allocated(trouble)) call file%close(trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    do k = 1, 2
      call read_cloud_file(trim(merge(csv//repeat(' ', len(vtkhdf)), &
                                      vtkhdf//repeat(' ', len(csv)), k == 1)), cloud, &
                           has_volume, has_wall, trouble)
      call check_no_trouble(error, trouble)
      if (allocated(error)) return
      call check(error, all(same(cloud%normal_x, [-0.6_wp, 0.0_wp])) .and. &
                 all(same(cloud%normal_y, [0.8_wp, 0.0_wp])) .and. &
                 all(same(cloud%wall_length, [0.5_wp, 0.0_wp])), 'values')
      if (allocated(error)) return
    end do
    call write_file(csv, header//'-0.5,0,4,0,-3'//lf)
    call read_cloud_file(csv, cloud, has_volume, has_wall, trouble)
    call check(error, allocated(trouble), 'a negative length is accepted')
    if (allocated(error)) return
    call check(error, index(trouble%message, 'column ''wall_length'': ''-0.5'' cannot be: give a') &
               > 0, trouble%message)
    if (allocated(error)) return
    call write_file(csv, 'x,y,normal_x'//lf//'0,0,1'//lf)
    call read_cloud_file(csv, cloud, has_volume, has_wall, trouble)
    call check(error, allocated(trouble), 'half a normal is accepted')
    if (allocated(error)) return
    call check(error, index(trouble%message, 'only one of normal_x and normal_y') > 0)
    if (allocated(error)) return
    call write_file(csv, 'x,y'//lf//'0,0'//lf)
    call read_cloud_file(csv, cloud, has_volume, has_wall, trouble)
    call check(error, .not. allocated(cloud%normal_x) .and. .not. allocated(cloud%wall_length))
  end subroutine test_wall_geometry

  !> Any order of columns, further columns, comments, blanks, quotation marks, Windows' line ends.
  subroutine test_tolerance(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(text_t), allocatable :: ignored(:)
    logical :: has_volume, has_wall
    type(error_t), allocatable :: trouble

    call write_file(csv, char(239)//char(187)//char(191)//'# a comment'//cr//lf// &
                    ' "Wall" ,note,"Y", X'//tab//',"a, b" '//cr//lf//cr//lf// &
                    '1,"here, there", 2.0 ,'//tab//' 1.0,'//cr//lf// &
                    '   '//cr//lf// &
                    '# between, the, lines'//cr//lf// &
                    '0.0,,"4",+3d0,?')
    call read_cloud_file(csv, cloud, has_volume, has_wall, trouble, ignored)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call check(error, cloud%particles(), 2)
    if (allocated(error)) return
    call check(error, has_wall .and. .not. has_volume)
    if (allocated(error)) return
    call check(error, all(same(cloud%x, [1.0_wp, 3.0_wp])) .and. &
               all(same(cloud%y, [2.0_wp, 4.0_wp])), 'values')
    if (allocated(error)) return
    call check(error, all(cloud%side == [1, 0]), 'sides')
    if (allocated(error)) return
    call check(error, size(ignored), 2)
    if (allocated(error)) return
    call check(error, ignored(1)%value//'|'//ignored(2)%value, 'note|a, b')
  end subroutine test_tolerance

  subroutine test_coordinates_only(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    logical :: has_volume, has_wall
    type(error_t), allocatable :: trouble

    call write_file(csv, 'y,x'//lf//'1,2')
    call read_cloud_file(csv, cloud, has_volume, has_wall, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call check(error, .not. (has_volume .or. has_wall))
    if (allocated(error)) return
    call check(error, size(cloud%boundary) == 0 .and. all(cloud%side == 0), 'no boundary')
    if (allocated(error)) return
    call check(error, all(same(cloud%volume, [0.0_wp])) .and. same(cloud%spacing, 0.0_wp), 'zeros')
    if (allocated(error)) return
    call check(error, same(cloud%x(1), 2.0_wp) .and. same(cloud%y(1), 1.0_wp), 'values')
  end subroutine test_coordinates_only

  !> Each number must be the one that Fortran's own reading gives, to the last bit.
  subroutine test_numbers(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: texts(*) = [character(len=32) :: &
                                               '0', '-0.0', '.5', '5.', '+.5e1', '1D3', &
                                               '1e22', '1e-22', &
                                               '123456789012345', '1234567890123456', &
                                               '9007199254740993', '0.1', '0.30000000000000004', &
                                               '2.2250738585072014e-308', '4.9e-324', '1e-400', &
                                               '1.7976931348623157e29', '8.5e-21', &
                                               '0.000000000000000000000001234', &
                                               '000000000000000000012.5', &
                                               '3.14159265358979323846264338', &
                                               '1e0000000000000000000002']
    type(cloud_t) :: cloud
    logical :: has_volume, has_wall
    type(error_t), allocatable :: trouble
    character(len=:), allocatable :: content
    character(len=len(texts)) :: text
    real(wp) :: expected
    integer :: k

    content = 'x,y'//lf
    do k = 1, size(texts)
      content = content//trim(texts(k))//',0'//lf
    end do
    call write_file(csv, content)
    call read_cloud_file(csv, cloud, has_volume, has_wall, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    do k = 1, size(texts)
      text = texts(k)
      read (text, *) expected
      call check(error, transfer(cloud%x(k), 0_i8) == transfer(expected, 0_i8), trim(texts(k)))
      if (allocated(error)) return
    end do
  end subroutine test_numbers

  subroutine test_many_lines(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: lines = 20000
    type(cloud_t) :: cloud
    logical :: has_volume, has_wall
    type(error_t), allocatable :: trouble
    real(wp), allocatable :: x(:), y(:)
    integer :: unit, k

    allocate (x(lines), y(lines))
    call random_number(x)
    call random_number(y)
    open (newunit=unit, file=csv, status='replace', action='write')
    write (unit, '(a)') 'text,x,y'
    do k = 1, lines
      write (unit, '(a,2(",",es25.17e3))') repeat('long ', 60), x(k), y(k)
    end do
    close (unit)
    call read_cloud_file(csv, cloud, has_volume, has_wall, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call check(error, cloud%particles(), lines)
    if (allocated(error)) return
    call check(error, all(same(cloud%x, x)) .and. all(same(cloud%y, y)), 'values')
  end subroutine test_many_lines

  subroutine test_wrong_headers(error)
    type(error_type), allocatable, intent(out) :: error

    call check_csv_trouble(error, 'x,z'//lf//'1,2', [character(40) :: 'line 1', 'no column ''y''', &
                                                     'x, z'])
    if (allocated(error)) return
    call check_csv_trouble(error, '# c'//lf//'u,y'//lf//'1,2', &
                           [character(40) :: 'line 2', 'no column ''x''', 'u, y'])
    if (allocated(error)) return
    call check_csv_trouble(error, '0.1,0.2'//lf//'1,2', &
                           [character(40) :: 'line 1', 'numbers where the names'])
    if (allocated(error)) return
    call check_csv_trouble(error, 'x;y'//lf//'1;2', [character(40) :: 'line 1', 'parted by commas'])
    if (allocated(error)) return
    call check_csv_trouble(error, 'x,y,X'//lf//'1,2,3', &
                           [character(40) :: 'line 1', 'two columns are named ''x'''])
    if (allocated(error)) return
    call check_csv_trouble(error, '', [character(40) :: 'is empty', 'x,y,volume,wall'])
    if (allocated(error)) return
    call check_csv_trouble(error, lf//'  '//lf//'# x,y'//lf, [character(40) :: 'is empty'])
    if (allocated(error)) return
    call check_csv_trouble(error, 'x,y'//lf//'# 1,2', [character(40) :: 'no particles'])
    if (allocated(error)) return
    call check_csv_trouble(error, 'GIF89a'//achar(0)//achar(1)//lf, &
                           [character(40) :: 'neither text nor HDF5'])
  end subroutine test_wrong_headers

  subroutine test_wrong_lines(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: header = 'x,y,volume,wall'//lf

    call check_csv_trouble(error, header//'1,2,3,0'//lf//lf//'1,2,3', &
                           [character(40) :: 'line 4', '3 values for 4 columns'])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'1,2,3,0,5', &
                           [character(40) :: 'line 2', '5 values for 4 columns'])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'7', [character(40) :: 'line 2', '1 value for 4 columns'])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'1,2o,3,0', &
                           [character(40) :: 'line 2', 'column ''y''', '''2o'' is not a number'])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'1,,3,0', &
                           [character(40) :: 'line 2', 'column ''y''', 'no value'])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'1,2,3,0'//lf//'NaN,2,3,0', &
                           [character(40) :: 'line 3', 'column ''x''', &
                            '''NaN'' is not a finite number'])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'1,-inf,3,0', &
                           [character(40) :: 'line 2', 'column ''y''', 'not a finite number'])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'1,1e999,3,0', &
                           [character(40) :: 'line 2', 'column ''y''', 'not a finite number'])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'1e308,2,3,0', &
                           [character(40) :: 'line 2', 'column ''x''', '''1e308'' is larger than', &
                            '1e30', 'in metres'])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'1,2,1e-90,0', &
                           [character(40) :: 'line 2', 'column ''volume''', '''1e-90'''])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'1,2,0,0', &
                           [character(40) :: 'line 2', 'column ''volume''', 'greater than 0'])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'1,2,-1,0', &
                           [character(40) :: 'line 2', 'column ''volume''', '''-1'''])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'1,2,1,2', &
                           [character(40) :: 'line 2', 'column ''wall''', '1 for a particle on'])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'1,2,1,0.5', [character(40) :: 'column ''wall'''])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'1e,2,1,0', [character(40) :: '''1e'' is not a number'])
    if (allocated(error)) return
    call check_csv_trouble(error, header//'1/2,2,1,0', [character(40) :: '''1/2'' is not a number'])
    if (allocated(error)) return
    call check_csv_trouble(error, header//repeat('z', 1000)//',2,1,0', &
                           [character(40) :: 'line 2', 'z...'' is not a number'])
  end subroutine test_wrong_lines

  subroutine test_wrong_files(error)
    type(error_type), allocatable, intent(out) :: error

    call check_trouble(error, folder//'no such cloud.csv', &
                       [character(40) :: 'no such cloud.csv', 'does not exist'])
    if (allocated(error)) return
    call check_trouble(error, folder, [character(40) :: 'is a folder'])
    if (allocated(error)) return
    call check_trouble(error, '/dev/null', [character(40) :: 'not a regular file'])
    if (allocated(error)) return
    call check_trouble(error, ' ', [character(40) :: 'has no name'])
    if (allocated(error)) return
    call write_file(csv, 'x,y')
    call check_trouble(error, csv//'/cloud.csv', [character(40) :: 'does not exist'])
  end subroutine test_wrong_files

  subroutine test_vtkhdf(error)
    type(error_type), allocatable, intent(out) :: error
    type(field_file_t) :: file
    type(cloud_t) :: cloud
    logical :: has_volume, has_wall
    type(error_t), allocatable :: trouble
    real(wp), parameter :: x(3) = [1.0_wp, 2.0_wp, 1.0_wp/3.0_wp], y(3) = [0.0_wp, -1.0_wp, 5.0_wp]
    real(wp), parameter :: volume(3) = [0.5_wp, 0.25_wp, 1.0_wp]
    integer :: step

    call file%create(vtkhdf, x, y, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call file%add_static('volume', volume, trouble)
    call file%add_static('wall', [0, 1, 0], trouble)
    do step = 1, 3
      call file%begin_step(real(step, wp), trouble)
      call file%write_field('temperature', x, trouble)
    end do
    call file%close(trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return

    call read_cloud_file(vtkhdf, cloud, has_volume, has_wall, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call check(error, has_volume .and. has_wall .and. cloud%particles() == 3, 'content')
    if (allocated(error)) return
    call check(error, all(same(cloud%x, x)) .and. all(same(cloud%y, y)) .and. &
               all(same(cloud%volume, volume)), 'values')
    if (allocated(error)) return
    call check(error, all(cloud%side == [0, 1, 0]) .and. all(cloud%user_index == [1, 2, 3]) .and. &
               cloud%boundary(1)%value == 'wall', 'sides')
  end subroutine test_vtkhdf

  subroutine test_vtkhdf_without_steps(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    logical :: has_volume, has_wall
    type(error_t), allocatable :: trouble

    call write_vtkhdf([1.0_wp, 2.0_wp])
    call read_cloud_file(vtkhdf, cloud, has_volume, has_wall, trouble)
    call check_no_trouble(error, trouble)
    if (allocated(error)) return
    call check(error, cloud%particles() == 2 .and. .not. (has_volume .or. has_wall), 'content')
    if (allocated(error)) return
    call check(error, size(cloud%boundary) == 0 .and. size(cloud%volume) == 2, 'nothing more')
  end subroutine test_vtkhdf_without_steps

  subroutine test_wrong_vtkhdf(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: none(0) = 0.0_wp

    call write_vtkhdf([1.0_wp, 2.0_wp], volume=[1.0_wp, -0.5_wp])
    call check_trouble(error, vtkhdf, [character(40) :: 'PointData/volume', 'particle 2', &
                                       '''-0.5'''])
    if (allocated(error)) return
    call write_vtkhdf([1.0_wp, 2.0_wp], wall=[3, 0])
    call check_trouble(error, vtkhdf, [character(40) :: 'PointData/wall', 'particle 1', '''3'''])
    if (allocated(error)) return
    call write_vtkhdf([1.0_wp, ieee_value(1.0_wp, ieee_quiet_nan)])
    call check_trouble(error, vtkhdf, [character(40) :: 'Points', 'particle 2', &
                                       'not a finite number'])
    if (allocated(error)) return
    call write_vtkhdf([1.0_wp, -1.0e31_wp])
    call check_trouble(error, vtkhdf, [character(40) :: 'Points', 'particle 2', '1e31', '1e30'])
    if (allocated(error)) return
    call write_vtkhdf([1.0_wp, 2.0_wp], wall=[1, 0], claimed=2000000000)
    call check_trouble(error, vtkhdf, [character(40) :: 'Points', '2000000000 rows', &
                                       'not complete'])
    if (allocated(error)) return
    call write_vtkhdf([1.0_wp, 2.0_wp], wall=[1, 0], claimed=-1)
    call check_trouble(error, vtkhdf, [character(40) :: 'NumberOfPoints', 'no number of'])
    if (allocated(error)) return
    call write_vtkhdf(none)
    call check_trouble(error, vtkhdf, [character(40) :: 'no particles'])
    if (allocated(error)) return
    call write_vtkhdf([1.0_wp, 2.0_wp], vector_volume=.true.)
    call check_trouble(error, vtkhdf, [character(40) :: 'PointData/volume', 'one number'])
  end subroutine test_wrong_vtkhdf

  !> A file cut off anywhere, or scribbled over, gives an error and neither a crash nor a print.
  subroutine test_damaged_hdf5(error)
    type(error_type), allocatable, intent(out) :: error
    integer(int8), allocatable :: bytes(:)
    integer :: size_of_file, unit, cut, k
    type(cloud_t) :: cloud
    logical :: has_volume, has_wall
    type(error_t), allocatable :: trouble

    call write_vtkhdf([1.0_wp, 2.0_wp], volume=[1.0_wp, 0.5_wp], wall=[1, 0])
    open (newunit=unit, file=vtkhdf, access='stream', form='unformatted', action='read')
    inquire (unit=unit, size=size_of_file)
    allocate (bytes(size_of_file))
    read (unit) bytes
    close (unit)
    do cut = 8, size_of_file - 1, 97
      open (newunit=unit, file=vtkhdf, access='stream', form='unformatted', status='replace', &
            action='write')
      write (unit) bytes(:cut)
      close (unit)
      call check_trouble(error, vtkhdf, [character(40) :: 'damaged or incomplete'])
      if (allocated(error)) return
    end do
    do cut = 200, size_of_file - 300, 301
      open (newunit=unit, file=vtkhdf, access='stream', form='unformatted', status='replace', &
            action='write')
      write (unit) bytes(:cut), [(77_int8, k=1, 200)], bytes(cut + 201:)
      close (unit)
      ! What was overwritten need not matter, so there may be a cloud.
      call read_cloud_file(vtkhdf, cloud, has_volume, has_wall, trouble)
      if (.not. allocated(trouble)) cycle
      call check(error, index(trouble%message, vtkhdf) > 0, trouble%message)
      if (allocated(error)) return
    end do
  end subroutine test_damaged_hdf5

  !> One flipped bit in a list of names has HDF5 1.10 copy -1 bytes.
  subroutine test_unbearable(error)
    type(error_type), allocatable, intent(out) :: error

    call check_trouble(error, 'data/damaged/cloud.vtkhdf', [character(40) :: 'damaged'])
  end subroutine test_unbearable

  subroutine test_trial(error)
    type(error_type), allocatable, intent(out) :: error
    logical :: inside, survived

    call start_trial(inside, survived)
    if (inside) error stop 'never seen'
    call check(error, .not. survived)
    if (allocated(error)) return
    call start_trial(inside, survived)
    if (inside) call end_trial()
    call check(error, survived)
  end subroutine test_trial

  ! ---------------------------------------------------------------------------------------------

  !> Write a VTKHDF file of particles on a line, with some point data.
  subroutine write_vtkhdf(x, volume, wall, vector_volume, claimed)
    real(wp), intent(in) :: x(:)
    real(wp), intent(in), optional, contiguous :: volume(:)
    integer, intent(in), optional, contiguous :: wall(:)
    logical, intent(in), optional :: vector_volume
    !> The number of particles that the file says it has, where that is not the truth
    integer, intent(in), optional :: claimed
    type(field_file_t) :: file
    type(error_t), allocatable :: trouble

    call file%create(vtkhdf, x, 0.0_wp*[x], trouble)
    if (present(volume)) call file%add_static('volume', volume, trouble)
    if (present(wall)) call file%add_static('wall', wall, trouble)
    if (present(vector_volume)) then
      call file%begin_step(0.0_wp, trouble)
      call file%write_field('volume', x, x, trouble)
    end if
    call file%close(trouble)
    if (present(claimed)) call claim(claimed)
  end subroutine write_vtkhdf

  !> Have the file say that it has more particles than were written.
  subroutine claim(particles)
    integer, intent(in) :: particles
    integer(hid_t) :: file_id, dataset, space
    integer, target :: number(1)
    integer :: status

    number = particles
    call h5fopen_f(vtkhdf, h5f_acc_rdwr_f, file_id, status)
    call h5dopen_f(file_id, '/VTKHDF/NumberOfPoints', dataset, status)
    call h5dwrite_f(dataset, h5t_native_integer, c_loc(number), status)
    call h5dclose_f(dataset, status)
    call h5ldelete_f(file_id, '/VTKHDF/Points', status)
    call h5screate_simple_f(2, int([3, max(2, particles)], hsize_t), space, status)
    call h5dcreate_f(file_id, '/VTKHDF/Points', h5t_native_double, space, dataset, status)
    call h5dclose_f(dataset, status)
    call h5sclose_f(space, status)
    call h5fclose_f(file_id, status)
  end subroutine claim

  subroutine write_file(path, content)
    character(len=*), intent(in) :: path, content
    integer :: unit

    open (newunit=unit, file=path, access='stream', form='unformatted', status='replace', &
          action='write')
    write (unit) content
    close (unit)
  end subroutine write_file

  !> Equal to the last bit, zeros of both signs alike.
  elemental function same(a, b)
    real(wp), intent(in) :: a, b
    logical :: same

    same = .not. abs(a - b) > 0.0_wp
  end function same

  subroutine check_no_trouble(error, trouble)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable, intent(in) :: trouble

    if (allocated(trouble)) call test_failed(error, trouble%message)
  end subroutine check_no_trouble

  subroutine check_csv_trouble(error, content, words)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: content
    character(len=*), intent(in) :: words(:)

    call write_file(csv, content)
    call check_trouble(error, csv, [character(40) :: csv, words])
  end subroutine check_csv_trouble

  !> Reading the file must fail as wrong input with a message that has all these words.
  subroutine check_trouble(error, path, words)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: path
    character(len=*), intent(in) :: words(:)
    type(cloud_t) :: cloud
    logical :: has_volume, has_wall
    type(error_t), allocatable :: trouble
    integer :: k

    call read_cloud_file(path, cloud, has_volume, has_wall, trouble)
    if (.not. allocated(trouble)) then
      call test_failed(error, 'no error: '//trim(words(1))//' '//trim(words(size(words))))
      return
    end if
    call check(error, trouble%status, status_bad_input, trouble%message)
    if (allocated(error)) return
    do k = 1, size(words)
      call check(error, index(trouble%message, trim(words(k))) > 0, &
                 ''''//trim(words(k))//''' is missing in: '//trouble%message)
      if (allocated(error)) return
    end do
    if (len(trouble%message) > 400) call test_failed(error, 'a very long message')
  end subroutine check_trouble

end module test_cloud_file
