!> Pictures of what calor writes: fields on a grid, lines of equal value, and `calor plot`.
module test_plot
  use, intrinsic :: iso_fortran_env, only: error_unit
  use calor_constants, only: pi
  use calor_error, only: error_t
  use calor_field_file, only: field_file_t
  use calor_field_map, only: field_map_t, make_field_map
  use calor_isolines, only: find_isolines, even_levels
  use calor_kinds, only: wp, i8
  use calor_random, only: random_uniform
  use test_process, only: outcome_t, run_command, environment_or, contents_of, write_text
  use testdrive, only: new_unittest, unittest_type, error_type, check
  implicit none (type, external)
  private

  public :: collect_plot

  character(len=*), parameter :: folder = 'build/test/plot/', end = new_line('a')

contains

  subroutine collect_plot(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('a map reproduces quadratic fields', test_quadratic), &
                new_unittest('a map ends at the body', test_clipping), &
                new_unittest('a map reaches into corners', test_corners), &
                new_unittest('a map does not ring at a jump', test_jump), &
                new_unittest('lines of equal value', test_isolines), &
                new_unittest('levels are round numbers', test_levels), &
                new_unittest('pictures of a run', test_run_pictures), &
                new_unittest('pictures of operators', test_operator_pictures), &
                new_unittest('pictures of tables', test_table_pictures), &
                new_unittest('what cannot be drawn', test_refusals), &
                new_unittest('damaged files', test_damaged), &
                new_unittest('without gnuplot', test_no_gnuplot) &
                ]
  end subroutine collect_plot

  !> Particles of a lattice with n spacings a side, the inner ones displaced by 0.2 spacings
  subroutine make_square(n, x, y, wall)
    integer, intent(in) :: n
    real(wp), allocatable, intent(out) :: x(:), y(:)
    logical, allocatable, intent(out) :: wall(:)
    integer :: i, j, k

    allocate (x((n + 1)**2), y((n + 1)**2), wall((n + 1)**2))
    k = 0
    do j = 0, n
      do i = 0, n
        k = k + 1
        wall(k) = i == 0 .or. i == n .or. j == 0 .or. j == n
        x(k) = i
        y(k) = j
        if (.not. wall(k)) then
          x(k) = x(k) + 0.4_wp*(random_uniform(1, int(k, i8)) - 0.5_wp)
          y(k) = y(k) + 0.4_wp*(random_uniform(2, int(k, i8)) - 0.5_wp)
        end if
      end do
    end do
    x = x/n
    y = y/n
  end subroutine make_square

  subroutine test_quadratic(error)
    type(error_type), allocatable, intent(out) :: error
    type(field_map_t) :: map
    real(wp), allocatable :: x(:), y(:), grid(:, :)
    logical, allocatable :: wall(:)
    real(wp) :: worst
    integer :: i, j

    call make_square(12, x, y, wall)
    call make_field_map(x, y, 1.0_wp/12, 50, wall, map)
    call check(error, count(map%inside), 50*50)
    if (allocated(error)) return
    call map%values(field(x, y), grid)
    worst = 0
    do j = 1, map%rows
      do i = 1, map%columns
        worst = max(worst, abs(grid(i, j) - field(map%x0 + (i - 1)*map%step, &
                                                  map%y0 + (j - 1)*map%step)))
      end do
    end do
    ! The ridge of 1e-9 in the least squares times the field's size and a condition of some tens
    call check(error, worst < 1.0e-7_wp, 'a quadratic field is off')

  contains

    !> Without an extremum in the square, at which values would be cut
    elemental function field(x, y)
      real(wp), intent(in) :: x, y
      real(wp) :: field

      field = 1 + 2*x - 3*y + 0.3_wp*x**2 - 0.2_wp*x*y + 0.1_wp*y**2
    end function field

  end subroutine test_quadratic

  !> An L with a hole: no point in the notch, none in the hole, all in the rest.
  subroutine test_clipping(error)
    type(error_type), allocatable, intent(out) :: error
    type(field_map_t) :: map
    real(wp), allocatable :: x(:), y(:)
    logical, allocatable :: wall(:), kept(:)
    real(wp) :: px, py
    integer :: i, j, wrong

    call make_square(20, x, y, wall)
    ! The notch is x, y > 0.5, the hole 0.2 < x, y < 0.4; both have walls on a lattice.
    x = nint(20*x)/20.0_wp
    y = nint(20*y)/20.0_wp
    kept = .not. (x > 0.51_wp .and. y > 0.51_wp) .and. &
           .not. (min(x, y) > 0.21_wp .and. max(x, y) < 0.39_wp)
    wall = wall .or. (abs(max(0.5_wp, x) - 0.5_wp) < 0.01_wp .and. y > 0.49_wp .and. &
                      x > 0.49_wp) .or. (abs(y - 0.5_wp) < 0.01_wp .and. x > 0.49_wp) .or. &
           (min(x, y) > 0.19_wp .and. max(x, y) < 0.41_wp)
    x = pack(x, kept)
    y = pack(y, kept)
    wall = pack(wall, kept)
    call make_field_map(x, y, 0.05_wp, 100, wall, map)
    wrong = 0
    do j = 1, map%rows
      do i = 1, map%columns
        px = map%x0 + (i - 1)*map%step
        py = map%y0 + (j - 1)*map%step
        if (map%inside(i, j) .neqv. .not. ((px > 0.5_wp .and. py > 0.5_wp) .or. &
            (min(px, py) > 0.2_wp .and. max(px, py) < 0.4_wp))) wrong = wrong + 1
      end do
    end do
    call check(error, wrong, 0)
  end subroutine test_clipping

  !> The particle within, on the diagonal, is far away, so that the two beside the corner are nearer
  !> to each other than a spacing allows that is taken from it.
  subroutine test_corners(error)
    type(error_type), allocatable, intent(out) :: error
    type(field_map_t) :: map
    real(wp), allocatable :: x(:), y(:)
    logical, allocatable :: wall(:)
    integer, parameter :: n = 10

    call make_square(n, x, y, wall)
    x(n + 3) = 1.2_wp/n
    y(n + 3) = 1.2_wp/n
    call make_field_map(x, y, 1.0_wp/n, 100, wall, map)
    call check(error, count(.not. map%inside), 0)
  end subroutine test_corners

  subroutine test_jump(error)
    type(error_type), allocatable, intent(out) :: error
    type(field_map_t) :: map
    real(wp), allocatable :: x(:), y(:), grid(:, :)
    logical, allocatable :: wall(:)

    call make_square(12, x, y, wall)
    call make_field_map(x, y, 1.0_wp/12, 40, wall, map)
    call map%values(merge(1.0_wp, 3.0_wp, x < 0.5_wp), grid)
    call check(error, minval(grid) >= 1 .and. maxval(grid) <= 3)
    if (allocated(error)) return
    call map%nearest_values(merge(1.0_wp, 3.0_wp, x < 0.5_wp), grid)
    call check(error, all(abs(grid - 1) < 1.0e-12_wp .or. abs(grid - 3) < 1.0e-12_wp))
  end subroutine test_jump

  !> Of a plane the line is exact; of a cone it is a circle, but for the chord of a cell. At a
  !> saddle lines do not cross.
  subroutine test_isolines(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: n = 41
    real(wp) :: plane(n, n), cone(n, n), saddle(2, 2)
    real(wp), allocatable :: pieces(:, :)
    logical :: inside(n, n)
    real(wp) :: length, radius
    integer :: i, j, k

    inside = .true.
    do j = 1, n
      do i = 1, n
        plane(i, j) = i + 2*j
        cone(i, j) = hypot(i - 21.0_wp, j - 21.0_wp)
      end do
    end do
    call find_isolines(plane, inside, 50.3_wp, pieces)
    call check(error, size(pieces, 2) > n/2 .and. all(abs(pieces(1, :) + 2*pieces(2, :) - &
                                                          50.3_wp) < 1.0e-12_wp))
    if (allocated(error)) return
    call find_isolines(cone, inside, 15.5_wp, pieces)
    length = 0
    do k = 1, size(pieces, 2)
      length = length + hypot(pieces(3, k) - pieces(1, k), pieces(4, k) - pieces(2, k))
      radius = hypot(pieces(1, k) - 21, pieces(2, k) - 21)
      call check(error, abs(radius - 15.5_wp) < 1/(8*15.5_wp - 4))
      if (allocated(error)) return
    end do
    call check(error, length, 2*pi*15.5_wp, thr=0.05_wp)
    if (allocated(error)) return
    inside(1:20, :) = .false.
    call find_isolines(cone, inside, 15.5_wp, pieces)
    call check(error, minval(pieces(1, :)) >= 21)
    if (allocated(error)) return
    saddle = reshape([1.0_wp, -1.0_wp, -1.0_wp, 1.5_wp], [2, 2])
    call find_isolines(saddle, inside(21:22, 1:2), 0.0_wp, pieces)
    call check(error, size(pieces, 2), 2)
    if (allocated(error)) return
    ! The middle is positive, so the two negative corners are cut off: (2, 1) and (1, 2).
    call check(error, all(pieces([1, 3], 1) > 1.39_wp .or. pieces([2, 4], 1) < 1.61_wp))
    if (allocated(error)) return
    call check(error, sum((pieces(1:2, 1) + pieces(3:4, 1))/2 - [1.75_wp, 1.25_wp]) < 0.2_wp)
  end subroutine test_isolines

  subroutine test_levels(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), allocatable :: levels(:)
    integer :: k

    levels = even_levels(0.0_wp, 1.0_wp)
    call check(error, size(levels), 9)
    if (allocated(error)) return
    call check(error, all(abs(levels - [(0.1_wp*k, k=1, 9)]) < 1.0e-12_wp))
    if (allocated(error)) return
    levels = even_levels(-293.0_wp, 700.0_wp)
    call check(error, all(abs(levels - [(100.0_wp*k, k=-2, 6)]) < 1.0e-9_wp))
    if (allocated(error)) return
    call check(error, size(even_levels(5.0_wp, 5.0_wp)), 0)
  end subroutine test_levels

  subroutine test_run_pictures(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    if (.not. has_gnuplot()) return
    call start_over()
    call write_scene()
    call calor('run --quiet scene.nml', outcome)
    call expect(error, outcome, 0, '')
    if (allocated(error)) return
    call calor('plot out.vtkhdf', outcome)
    call expect(error, outcome, 0, 'out.png: temperature at t = 0.02 s|out_budget.svg')
    if (allocated(error)) return
    call check_png(error, 'out.png')
    if (allocated(error)) return
    call check(error, index(contents_of(folder//'out.svg'), '</svg>') > 0, 'out.svg is not whole')
    if (allocated(error)) return
    call check(error, index(contents_of(folder//'out.svg'), 'temperature, K') > 0)
    if (allocated(error)) return
    call check(error, index(contents_of(folder//'out.svg'), 'A "small" plate') > 0)
    if (allocated(error)) return
    call check_png(error, 'out_budget.png')
    if (allocated(error)) return
    call calor('plot --field error --time 0.011 out.vtkhdf', outcome)
    call expect(error, outcome, 0, 'out_error.png: error at t = 0.01 s')
    if (allocated(error)) return
    call calor('plot out.vtkhdf --field=wall --output walls.png', outcome)
    call expect(error, outcome, 0, 'walls.png')
    if (allocated(error)) return
    call check_png(error, 'walls.png')
    if (allocated(error)) return
    call calor('plot out.vtkhdf --animate', outcome)
    call expect(error, outcome, 0, 'out.gif: temperature at 3 times')
    if (allocated(error)) return
    call check(error, index(contents_of(folder//'out.gif'), 'GIF89a'), 1)
  end subroutine test_run_pictures

  subroutine test_operator_pictures(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    if (.not. has_gnuplot()) return
    call start_over()
    call write_text(folder//'ops.nml', '&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.1 /'// &
                    end//'&operators field_expression = ''x^2'' file = ''ops.vtkhdf'' /'//end)
    call calor('operators ops.nml', outcome)
    call calor('plot ops.vtkhdf', outcome)
    call expect(error, outcome, 0, 'ops.png: the field and its derivatives')
    if (allocated(error)) return
    call check_png(error, 'ops.png')
    if (allocated(error)) return
    call check(error, index(contents_of(folder//'ops.svg'), 'laplacian_fatehi_manzari') > 0)
  end subroutine test_operator_pictures

  subroutine test_table_pictures(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    if (.not. has_gnuplot()) return
    call start_over()
    call write_text(folder//'cost.csv', 'laplacian,order,support,spacing,relative_l2_error,'// &
                    'cloud_seconds,total_seconds,threads,failure'//end// &
                    'brookshaw,,2.1,0.1,1e-2,0.01,0.1,1,'//end// &
                    'brookshaw,,2.1,0.05,5e-3,0.02,0.4,1,'//end// &
                    'positive,,2.1,0.05,,,,,"It did not run, really."'//end)
    call calor('plot cost.csv', outcome)
    call expect(error, outcome, 0, 'cost.png: error against wall time|cost.svg')
    if (allocated(error)) return
    call check_png(error, 'cost.png')
    if (allocated(error)) return
    call write_text(folder//'orders.csv', &
                    'scheme,scheme_order,derivative,cloud,refinement,spacing,support_radius,'// &
                    'error,rounding,field'//end// &
                    rows('difference', 'gradient')//rows('brookshaw', 'laplacian'))
    call calor('plot orders.csv', outcome)
    call expect(error, outcome, 0, 'orders.png: error against spacing')
    if (allocated(error)) return
    call check_png(error, 'orders.png')
    if (allocated(error)) return
    call check(error, index(contents_of(folder//'orders.svg'), 'brookshaw') > 0)

  contains

    function rows(scheme, derivative) result(text)
      character(len=*), intent(in) :: scheme, derivative
      character(len=:), allocatable :: text
      character(len=13), parameter :: ways(*) = [character(len=13) :: 'fixed_ratio', &
          'growing_ratio', 'fixed_spacing']
      integer :: k

      text = ''
      do k = 1, 3
        text = text//scheme//',,'//derivative//',regular,'//trim(ways(k))//',0.1,0.2,1e-1,0,"x"'// &
               end//scheme//',,'//derivative//',regular,'//trim(ways(k))//',0.05,0.1,2e-2,0,"x"'// &
               end//scheme//',,'//derivative//',irregular,'//trim(ways(k))// &
               ',0.1,0.2,1e-1,0,"x"'//end
      end do
    end function rows

  end subroutine test_table_pictures

  subroutine test_refusals(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=:), allocatable :: before

    call start_over()
    call write_scene()
    call execute_command_line('cd '//folder//' && "'//program_path()// &
                              '" run --quiet scene.nml && mkdir a_folder && '// &
                              'head -c 3000 out.vtkhdf >cut.vtkhdf')
    call write_text(folder//'other.csv', 'a,b'//end//'1,2'//end)
    call write_text(folder//'empty.csv', '')
    call write_text(folder//'ragged.csv', 'a,b'//end//'1'//end)
    call write_text(folder//'prose.txt', 'A plate is warm.')
    before = contents_of(folder//'out.vtkhdf')
    call refuse('plot', 2, 'FILE')
    call refuse('plot missing.vtkhdf', 2, 'There is no file ''missing.vtkhdf''|calor run')
    call refuse('plot a_folder', 2, 'a folder')
    call refuse('plot prose.txt', 2, 'none of calor''s|.vtkhdf')
    call refuse('plot cut.vtkhdf', 2, 'cut.vtkhdf|damaged or incomplete')
    call refuse('plot other.csv', 2, 'other.csv|none of calor''s')
    call refuse('plot empty.csv', 2, 'empty')
    call refuse('plot ragged.csv', 2, 'line 2|1 values')
    call refuse('plot other.csv --animate', 2, 'neither fields nor times')
    call refuse('plot out.vtkhdf --field temperatur', 2, 'no field ''temperatur''|Did you mean '// &
                '''temperature''|It has error, temperature')
    call refuse('plot out.vtkhdf --time 7', 2, 'no time 7 s|0 to 0.02 s')
    call refuse('plot out.vtkhdf --time soon', 2, '--time soon')
    call refuse('plot out.vtkhdf --time', 2, '--time needs a value')
    call refuse('plot out.vtkhdf --time 0 --animate', 2, '--animate')
    call refuse('plot out.vtkhdf --output a.gif', 2, '--animate')
    call refuse('plot out.vtkhdf --filed error', 2, 'no option ''--filed''|Did you mean ''--field')
    if (allocated(error)) return
    call execute_command_line('cp '//folder//'out.vtkhdf '//folder//'out.png')
    call refuse('plot out.png', 2, 'over the file|--output')
    if (allocated(error)) return
    call check(error, contents_of(folder//'out.png') == before, 'a file was written over')
    if (allocated(error)) return
    if (.not. has_gnuplot()) return
    call refuse('plot out.vtkhdf --output nowhere/a', 4, 'nowhere')

  contains

    subroutine refuse(arguments, status, words)
      character(len=*), intent(in) :: arguments, words
      integer, intent(in) :: status
      type(outcome_t) :: outcome

      if (allocated(error)) return
      call calor(arguments, outcome)
      call expect(error, outcome, status, words)
    end subroutine refuse

  end subroutine test_refusals

  !> Files that say what no run writes are refused before anything is drawn.
  subroutine test_damaged(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call start_over()
    call write_fields([0.0_wp, 1.0_wp, 1.0e31_wp], [0.0_wp, 1.0_wp, 2.0_wp])
    call calor('plot file.vtkhdf', outcome)
    call expect(error, outcome, 2, 'file.vtkhdf|damaged')
    if (allocated(error)) return
    call write_fields([0.0_wp, 1.0_wp, 2.0_wp], [0.0_wp, 1.0e300_wp, 2.0_wp])
    call calor('plot file.vtkhdf', outcome)
    call expect(error, outcome, 2, 'has no value at some particles|--field')
    if (allocated(error)) return
    call write_fields([1.0_wp, 1.0_wp, 1.0_wp], [0.0_wp, 1.0_wp, 2.0_wp])
    call calor('plot file.vtkhdf', outcome)
    call expect(error, outcome, 2, 'at one place')
    if (allocated(error)) return
    call write_fields([0.0_wp, 1.0_wp, 2.0_wp])
    call calor('plot file.vtkhdf', outcome)
    call expect(error, outcome, 2, 'no field that can be drawn by itself|volume|--field')
    if (allocated(error)) return
    ! Of this one HDF5 1.10 follows a pointer that is none.
    call execute_command_line('cp data/damaged/fields.vtkhdf '//folder//'file.vtkhdf')
    call calor('plot file.vtkhdf', outcome)
    call expect(error, outcome, 2, 'file.vtkhdf|damaged')

  contains

    !> A file of three particles, with a temperature or with volumes alone
    subroutine write_fields(x, temperature)
      real(wp), intent(in) :: x(3)
      real(wp), intent(in), optional :: temperature(3)
      type(field_file_t) :: file
      type(error_t), allocatable :: trouble

      call file%create(folder//'file.vtkhdf', x, 0.0_wp*[1.0_wp, 2.0_wp, 3.0_wp], trouble)
      call file%add_static('volume', [1.0_wp, 1.0_wp, 1.0_wp], trouble)
      call file%begin_step(0.0_wp, trouble)
      if (present(temperature)) call file%write_field('temperature', temperature, trouble)
      call file%set_attribute('title', 'three', trouble)
      call file%close(trouble)
    end subroutine write_fields

  end subroutine test_damaged

  subroutine test_no_gnuplot(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call start_over()
    call write_scene()
    call calor('run --quiet scene.nml', outcome)
    call run_command('cd '//folder//' && PATH=/nowhere "'//program_path()//'" plot out.vtkhdf', &
                     folder//'../plotted', outcome)
    call expect(error, outcome, 4, 'no gnuplot|apt install gnuplot')
  end subroutine test_no_gnuplot

  ! ---------------------------------------------------------------------------------------------
  ! Tools
  ! ---------------------------------------------------------------------------------------------

  subroutine start_over()
    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder)
  end subroutine start_over

  subroutine write_scene()
    call write_text(folder//'scene.nml', '&scene title = ''A "small" plate'''//end// &
                    ' exact_expression = ''sin(pi*x)*sin(pi*y)*exp(-2*pi^2*t)'' /'//end// &
                    '&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.1 /'//end// &
                    '&initial temperature_expression = ''sin(pi*x)*sin(pi*y)'' /'//end// &
                    '&boundary on = ''all'' kind = ''temperature'' value = 0 /'//end// &
                    '&time end = 0.02 /'//end// &
                    '&output file = ''out.vtkhdf'' every = 0.01 fields = ''temperature'', '// &
                    '''error'' /'//end)
  end subroutine write_scene

  subroutine calor(arguments, outcome)
    character(len=*), intent(in) :: arguments
    type(outcome_t), intent(out) :: outcome

    call run_command('cd '//folder//' && "'//program_path()//'" '//arguments, &
                     folder//'../plotted', outcome)
  end subroutine calor

  function program_path() result(path)
    character(len=:), allocatable :: path

    path = environment_or('CALOR_PROGRAM', 'bin/calor')
    if (path(1:1) /= '/') path = '../../../'//path
  end function program_path

  !> Status, and words in what was printed; a failure is one line on standard error.
  subroutine expect(error, outcome, status, words)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t), intent(in) :: outcome
    integer, intent(in) :: status
    !> Parted by |
    character(len=*), intent(in) :: words
    character(len=:), allocatable :: said, rest
    integer :: bar

    said = outcome%output
    if (status /= 0) said = outcome%errors
    call check(error, outcome%status, status, outcome%errors//outcome%output)
    if (allocated(error)) return
    rest = words
    do while (rest /= '')
      bar = index(rest//'|', '|')
      call check(error, index(said, rest(:bar - 1)) > 0, rest(:bar - 1)//' is not in: '//said)
      if (allocated(error)) return
      rest = rest(min(bar + 1, len(rest) + 1):)
    end do
    if (status /= 0) call check(error, index(said, end), len(said), 'more than a line: '//said)
  end subroutine expect

  !> A whole picture of a sensible size
  subroutine check_png(error, name)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: name
    character(len=:), allocatable :: bytes
    integer :: width, height

    bytes = contents_of(folder//name)
    call check(error, len(bytes) > 2000, name//' is missing or nearly empty')
    if (allocated(error)) return
    call check(error, bytes(2:4) == 'PNG' .and. index(bytes, 'IEND') > 0, name//' is not whole')
    if (allocated(error)) return
    ! The header tells width and height, high bytes first.
    width = 256*iachar(bytes(19:19)) + iachar(bytes(20:20))
    height = 256*iachar(bytes(23:23)) + iachar(bytes(24:24))
    call check(error, min(width, height) >= 300 .and. max(width, height) <= 3000, &
               name//' has a strange size')
  end subroutine check_png

  !> Whether there is gnuplot; if not, the test is left out.
  function has_gnuplot() result(there)
    logical :: there
    type(outcome_t) :: outcome

    call run_command('gnuplot --version', 'build/test/gnuplot_there', outcome)
    there = outcome%status == 0
    if (.not. there) write (error_unit, '(a)') '    left out: there is no gnuplot'
  end function has_gnuplot

end module test_plot
