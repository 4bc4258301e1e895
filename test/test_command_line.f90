!> Runs the program itself: what it prints, the files that it leaves, its exit status.
module test_command_line
  use calor_hdf5, only: start_hdf5
  use calor_kinds, only: wp
  use calor_scene_contract, only: contract_groups
  use calor_text, only: to_text, text_t
  use hdf5, only: hid_t, hsize_t, h5aclose_f, h5aget_num_attrs_f, h5aopen_by_idx_f, h5awrite_f, &
                  h5dclose_f, h5dget_space_f, h5dopen_f, h5dread_f, h5f_acc_rdonly_f, &
                  h5f_acc_rdwr_f, h5fclose_f, h5fopen_f, h5gclose_f, h5gopen_f, h5_index_name_f, &
                  h5_iter_inc_f, h5sclose_f, h5sget_simple_extent_npoints_f, h5t_native_double
  use test_process, only: outcome_t, run_command, environment_or, contents_of, write_text, &
                          number_after, line_count
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_command_line, zero_wall_times

  character(len=*), parameter :: folder = 'build/test/command_line/'

  !> The groups of a small plate, each in the line of its number
  character(len=72), parameter :: plate(*) = [character(len=72) :: &
      '&scene exact_expression = ''sin(pi*x)*sin(pi*y)*exp(-2*pi^2*t)'' /', &
      '&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.1 /', &
      '&kernel name = ''wendland_c2'' support = 2.1 /', &
      '&scheme laplacian = ''fatehi_manzari'' support_growth = .false. /', &
      '&material conductivity = 1 density = 1 heat_capacity = 1 /', &
      '&initial temperature_expression = ''sin(pi*x)*sin(pi*y)'' /', &
      '&boundary on = ''all'' kind = ''temperature'' value = 0 /', &
      '&time end = 0.02 /', &
      '&output file = ''out.vtkhdf'' every = 0.01 /', &
      '&operators field_expression = ''x^2'' file = ''out.vtkhdf'' /']

  !> Rectangles, open for more keys
  character(len=*), parameter :: square = '&domain x_range = 0, 1 y_range = 0, 1 ', &
      lattice = square//'spacing = 0.1 ', jittered = lattice//'arrangement = ''jittered'' '

  !> A cloud of one's own instead of the rectangle
  character(len=*), parameter :: cloud = '&domain shape = ''cloud'' spacing = 0.5 file = '

  !> A call that must fail
  type :: case_t
    !> A group to put into the plate, in the place of the one of that name if there is one
    character(len=110) :: group
    !> The exit status
    integer :: status
    !> Words of the message, parted by |
    character(len=110) :: words
  end type case_t

contains

  subroutine collect_command_line(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('run', test_run), &
                new_unittest('check', test_check), &
                new_unittest('operators', test_operators), &
                new_unittest('standard output on a full disk', test_full_output), &
                new_unittest('new', test_new), &
                new_unittest('help and version', test_help), &
                new_unittest('wrong calls', test_wrong_calls), &
                new_unittest('scenes that are none', test_no_scenes), &
                new_unittest('wrong groups and keys', test_wrong_keys), &
                new_unittest('wrong values', test_wrong_values), &
                new_unittest('wrong expressions', test_wrong_expressions), &
                new_unittest('wrong clouds', test_wrong_clouds), &
                new_unittest('wrong places for the output', test_wrong_outputs), &
                new_unittest('wrong operators', test_wrong_operators), &
                new_unittest('an old file survives an early failure', test_old_file), &
                new_unittest('an unstable run keeps its last good state', test_unstable), &
                new_unittest('two runs write the same bytes', test_same_bytes), &
                new_unittest('one and two threads agree', test_threads), &
                new_unittest('a user''s cloud comes back in its order', test_user_order), &
                new_unittest('an interrupted run ends at once', test_interrupted) &
                ]
  end subroutine collect_command_line

  ! ---------------------------------------------------------------------------------------------
  ! What works
  ! ---------------------------------------------------------------------------------------------

  subroutine test_run(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call start_over()
    call write_scene('')
    call calor('run scene.nml', outcome)
    call expect_success(error, outcome, 't = 0.02 s|Written|out.vtkhdf|Wall time|steps')
    if (allocated(error)) return
    call check(error, number_after(outcome%output, 'relative L2 error') < 0.02_wp, outcome%output)
    if (allocated(error)) return
    call check(error, size(field('out.vtkhdf', '/VTKHDF/Steps/Values')), 3)
    if (allocated(error)) return
    call check(error, maxval(field('out.vtkhdf', '/VTKHDF/PointData/temperature')), 1.0_wp, &
               thr=1.0e-12_wp)
  end subroutine test_run

  subroutine test_check(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call start_over()
    call write_scene('')
    call calor('check scene.nml', outcome)
    call expect_success(error, outcome, '121|40 of them on walls|Neighbours   10 to 12|'// &
                        'fatehi_manzari|conduction; temperature held on ''all''|Nothing else|'// &
                        'steps|forward Euler|Memory|kB|out.vtkhdf: temperature at 3 times')
    if (allocated(error)) return
    call run_command('cd '//folder//' && ls', folder//'../list', outcome)
    call check(error, outcome%output, 'scene.nml'//new_line('a'), 'check must write nothing')
    if (allocated(error)) return
    call write_scene('&time end = 0.02 method = ''forward_euler'' step = 0.001 /')
    call calor('check scene.nml', outcome)
    call expect_success(error, outcome, '20 of at most 0.001 s')
  end subroutine test_check

  subroutine test_full_output(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call start_over()
    call run_command('("'//program_path()//'" --help > /dev/full)', folder//'../called', outcome)
    call expect_failure(error, outcome, 4, 'standard output|full')
  end subroutine test_full_output

  subroutine test_operators(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call start_over()
    call write_scene('&operators field_expression = ''x^2 - 3*y^2'' file = ''out.vtkhdf'' '// &
                     'exact_laplacian_expression = ''-4'' /')
    call calor('operators scene.nml', outcome)
    call expect_success(error, outcome, 'gradient_standard|gradient_renormalized|'// &
                        'laplacian_brookshaw|laplacian_double_gradient|Written to out.vtkhdf')
    if (allocated(error)) return
    call check(error, number_after(outcome%output, 'laplacian_fatehi_manzari') < 1.0e-10_wp, &
               outcome%output)
    if (allocated(error)) return
    call check(error, maxval(abs(field('out.vtkhdf', &
                                       '/VTKHDF/PointData/laplacian_fatehi_manzari') + 4)) < &
               1.0e-9_wp)
    if (allocated(error)) return
    call check(error, size(field('out.vtkhdf', '/VTKHDF/PointData/gradient_sum')), 3*121)
  end subroutine test_operators

  subroutine test_new(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    character(len=:), allocatable :: before

    call start_over()
    call calor('new plate "my plate''s"', outcome)
    call expect_success(error, outcome, 'calor run')
    if (allocated(error)) return
    call calor('run "my plate''s.nml"', outcome)
    call expect_success(error, outcome, 'my plate''s.vtkhdf|relative L2 error')
    if (allocated(error)) return
    before = contents_of(folder//'my plate''s.nml')
    call calor('new plate "my plate''s"', outcome)
    call expect_failure(error, outcome, 2, 'my plate''s.nml is there already')
    if (allocated(error)) return
    call check(error, contents_of(folder//'my plate''s.nml'), before)
    if (allocated(error)) return
    call calor('new plate nowhere/plate', outcome)
    call expect_failure(error, outcome, 4, 'nowhere/plate.nml cannot be written')
    if (allocated(error)) return
    call calor('new plate ""', outcome)
    call expect_failure(error, outcome, 2, 'needs a name')
  end subroutine test_new

  subroutine test_help(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    type(text_t), allocatable :: groups(:)
    character(len=:), allocatable :: manifest, version
    integer :: start, k

    call start_over()
    call calor('--help', outcome)
    call expect_success(error, outcome, &
                        'calor run|calor check|calor operators|calor new|calor plot|SCENE|NAME')
    if (allocated(error)) return
    call calor('run --help', outcome)
    call expect_success(error, outcome, 'calor run SCENE|x_range|spacing|jitter|support|'// &
                        'conductivity|temperature_expression|value_expression|tolerance|every|'// &
                        'hexagonal|wendland_c6|double_gradient|runge_kutta_4|(default ''lattice'')')
    if (allocated(error)) return
    groups = contract_groups()
    do k = 1, size(groups)
      call check(error, index(outcome%output, '&'//groups(k)%value//':') > 0, groups(k)%value)
      if (allocated(error)) return
    end do
    call calor('check -h', outcome)
    call expect_success(error, outcome, 'calor check SCENE|spacing')
    if (allocated(error)) return
    call calor('operators scene.nml --help', outcome)
    call expect_success(error, outcome, 'calor operators SCENE|field_expression|renormalized')
    if (allocated(error)) return
    call calor('help new', outcome)
    call expect_success(error, outcome, 'calor new [KIND [NAME]]|two_materials')
    if (allocated(error)) return

    manifest = contents_of('fpm.toml')
    start = index(manifest, 'version = "') + len('version = "')
    version = manifest(start:start + index(manifest(start:), '"') - 2)
    call calor('--version', outcome)
    call expect_success(error, outcome, '')
    if (allocated(error)) return
    call check(error, outcome%output, 'calor '//version//new_line('a'))
  end subroutine test_help

  ! ---------------------------------------------------------------------------------------------
  ! What is refused
  ! ---------------------------------------------------------------------------------------------

  subroutine test_wrong_calls(error)
    type(error_type), allocatable, intent(out) :: error

    call start_over()
    call write_scene('')
    call expect_call(error, 'rum scene.nml', 2, 'rum|Did you mean ''run''')
    if (allocated(error)) return
    call expect_call(error, 'opertors scene.nml', 2, 'opertors|Did you mean ''operators''')
    if (allocated(error)) return
    call expect_call(error, 'help chekc', 2, 'chekc|Did you mean ''check''')
    if (allocated(error)) return
    call expect_call(error, '--versoin', 2, 'option|--versoin|Did you mean ''--version''')
    if (allocated(error)) return
    call expect_call(error, 'run --fast scene.nml', 2, 'no option ''--fast''')
    if (allocated(error)) return
    call expect_call(error, 'run', 2, 'calor run needs SCENE.')
    if (allocated(error)) return
    call expect_call(error, 'new plate nowhere/plate', 4, &
                     'nowhere/plate.nml|No such file or directory.')
    if (allocated(error)) return
    call expect_call(error, 'run --resume scene.nml', 4, &
                     'no checkpoint|--checkpoint|without --resume')
    if (allocated(error)) return
    call expect_call(error, 'new plat', 2, 'no scene ''plat''|Did you mean ''plate''|calor new')
    if (allocated(error)) return
    call expect_call(error, 'new plate a b', 2, 'at most two arguments')
    if (allocated(error)) return
    call expect_call(error, 'run --quiet=1 scene.nml', 2, '--quiet takes no value')
    if (allocated(error)) return
    call expect_call(error, 'run --quiet --verbose scene.nml', 2, 'either --quiet or --verbose')
    if (allocated(error)) return
    call expect_call(error, 'run scene.nml scene.nml', 2, 'one argument')
  end subroutine test_wrong_calls

  subroutine test_no_scenes(error)
    type(error_type), allocatable, intent(out) :: error

    call start_over()
    call execute_command_line('mkdir '//folder//'a_folder')
    call write_text(folder//'empty.nml', '')
    call write_text(folder//'prose.nml', 'Please simulate a plate.')
    call write_text(folder//'open.nml', '&domain spacing = 0.1'//new_line('a'))
    call write_text(folder//'quote.nml', '&scene title = ''A plate /'//new_line('a'))
    call write_text(folder//'binary.nml', '&scene'//achar(0)//achar(7)//' /')
    call expect_call(error, 'run missing.nml', 2, 'missing.nml')
    if (allocated(error)) return
    call expect_call(error, 'run a_folder', 2, 'a_folder|folder')
    if (allocated(error)) return
    call expect_call(error, 'run a_folder/nowhere/scene.nml', 2, 'a_folder/nowhere/scene.nml')
    if (allocated(error)) return
    call expect_call(error, 'run ""', 2, 'name')
    if (allocated(error)) return
    call expect_call(error, 'run empty.nml', 2, 'empty.nml has no groups|&domain|calor new')
    if (allocated(error)) return
    call expect_call(error, 'run prose.nml', 2, 'prose.nml|line 1|outside of any group')
    if (allocated(error)) return
    call expect_call(error, 'run open.nml', 2, 'open.nml|line 1|&domain')
    if (allocated(error)) return
    call expect_call(error, 'run quote.nml', 2, 'quote.nml|line 1|title|quote')
    if (allocated(error)) return
    call expect_call(error, 'run binary.nml', 2, 'binary.nml|line 1|text')
    if (allocated(error)) return
    call expect_call(error, 'run /dev/zero', 2, '/dev/zero')
  end subroutine test_no_scenes

  subroutine test_wrong_keys(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_refusals(error, 'run', [ &
        case_t('&kernle support = 2.1 /', 2, &
               'scene.nml, line 11: &kernle|Did you mean ''kernel'''), &
        case_t('&time end = 1 conductivity = 2 /', 2, &
               'line 8: &time conductivity|no such key. It belongs to &material.'), &
        case_t('&kernel support = 2,1 /', 2, &
               'line 3: &kernel support|Decimals have a point: 2.1.'), &
        case_t('&initial temperature_expression = ''1/x'' /', 2, &
               'scene.nml, line 6: &initial temperature_expression|no number at (0, 0)'), &
        case_t('&boundary on = ''left'' value = 0 /', 2, &
               'nothing is said about the boundaries ''right'', ''bottom'', ''top'':'), &
        case_t('&kernel suport = 2.1 /', 2, 'scene.nml, line 3: &kernel suport|mean ''support'''), &
        case_t('&domain x_rang = 0, 1 /', 2, &
               'scene.nml, line 2: &domain x_rang|mean ''x_range'''), &
        case_t('&domain y_range = 0, 1 spacing = 0.1 /', 2, 'line 2: &domain|x_range'), &
        case_t('&boundary on = ''all'' /', 2, 'line 7: &boundary|value'), &
        case_t('&time method = ''auto'' /', 2, 'line 8: &time|end'), &
        case_t('&time end = 1 end = 2 /', 2, 'line 8: &time end|twice'), &
        case_t('&initial temperature = 1 temperature_expression = ''x'' /', 2, &
               'line 6: &initial temperature|temperature_expression|one of the two'), &
        case_t('&time end = 1 / &time end = 2 /', 2, '&time|only once'), &
        case_t('&time end = 1', 2, 'line 8: &time|''/''')])
  end subroutine test_wrong_keys

  subroutine test_wrong_values(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_refusals(error, 'run', [ &
        case_t(square//'spacing = ''fine'' /', 2, &
               'scene.nml, line 2: &domain spacing = ''fine''|expected a number'), &
        case_t('&domain x_range = 0, 1, 2 y_range = 0, 1 spacing = 0.1 /', 2, &
               'line 2: &domain x_range|2 numbers'), &
        case_t('&domain x_range = 1, 0 y_range = 0, 1 spacing = 0.1 /', 2, &
               'line 2: &domain x_range|greater'), &
        case_t('&domain x_range = 0, NaN y_range = 0, 1 spacing = 0.1 /', 2, &
               'line 2: &domain x_range|finite'), &
        case_t('&domain x_range = 0, 1e300 y_range = 0, 1 spacing = 0.1 /', 2, &
               'line 2: &domain x_range|1e300 is too large|greatest is 1e30'), &
        case_t('&domain x_range = 0, 1e29 y_range = 0, 1 spacing = 0.1 /', 2, &
               'line 2: &domain|memory|spacing'), &
        case_t(square//'spacing = 1e-9 /', 2, &
               'line 2: &domain|memory|spacing'), &
        case_t(square//'spacing = 7 /', 2, &
               'line 2: &domain|spacing = 7|larger than the rectangle'), &
        case_t(square//'spacing = 1 /', 2, 'all 4 particles|spacing'), &
        case_t(square//'spacing = -1 /', 2, &
               'line 2: &domain spacing|greater than 0'), &
        case_t(lattice//'arrangement = ''latice'' /', 2, &
               'line 2: &domain arrangement|Did you mean ''lattice'''), &
        case_t(lattice//'jitter = 0.3 /', 2, &
               'line 2: &domain jitter|arrangement = ''lattice'''), &
        case_t(jittered//'jitter=0.6 /', 2, &
               'line 2: &domain|jitter = 0.6|less than 0.5'), &
        case_t(jittered//'seed=1.5 /', 2, &
               'line 2: &domain seed|whole number'), &
        case_t('&domain shape = ''disk'' radius = 1 spacing = 0.1 /', 2, &
               'line 2: &domain shape|Did you mean ''disc'''), &
        case_t('&domain shape = ''disc'' spacing = 0.1 /', 2, 'line 2: &domain|radius'), &
        case_t('&domain shape = ''disc'' radius = -1 spacing = 0.1 /', 2, &
               'line 2: &domain radius|greater than 0'), &
        case_t('&domain shape = ''disc'' radius = 1 spacing = 1.5 /', 2, &
               'line 2: &domain|spacing = 1.5|radius of 1 m|at most 1.4'), &
        case_t('&domain shape = ''disc'' radius = 1 inner_radius = 0.5 spacing = 0.1 /', 2, &
               'line 2: &domain inner_radius|nothing with shape = ''disc'''), &
        case_t('&domain shape=''annulus'' radius=1 inner_radius=2 spacing=0.1 /', 2, &
               'line 2: &domain inner_radius = 2|less than radius = 1'), &
        case_t('&domain shape = ''disc'' radius = 1 spacing = 1e-9 /', 2, &
               'line 2: &domain|memory|spacing'), &
        case_t('&domain shape = ''disc'' radius = 1e200 spacing = 1 /', 2, &
               'line 2: &domain radius|1e30'), &
        case_t('&domain shape = ''polygon'' vertices = 0,0, 0,1, 1,1 spacing = 0.1 /', 2, &
               'line 2: &domain vertices|clockwise|opposite order'), &
        case_t('&domain shape = ''polygon'' vertices = 0,0, 1,0, 1 spacing = 0.1 /', 2, &
               'line 2: &domain vertices|found 5 numbers'), &
        case_t('&domain shape=''polygon'' vertices=0,0,1,0,0,1 hole_vertices=2,2,3,2,3,3 '// &
               'spacing=0.1 /', 2, 'line 2: &domain hole_vertices|hole 1|outside the polygon'), &
        case_t('&domain shape = ''polygon'' vertices = 0,0, 1,0, 0,1 spacing = 2 /', 2, &
               'line 2: &domain|spacing = 2|larger than the polygon'), &
        case_t('&domain shape = ''polygon'' vertices = 0,0, 1,0, 0,1 x_range = 0, 1 /', 2, &
               'line 2: &domain x_range|nothing with shape = ''polygon'''), &
        case_t(lattice//'seed = 3 /', 2, 'line 2: &domain seed|arrangement = ''lattice'''), &
        case_t(lattice//'arrangement = ''relaxed'' jitter = 0.1 /', 2, &
               'line 2: &domain jitter|arrangement = ''relaxed'''), &
        case_t('&kernel support = 0.9 /', 2, 'line 3: &kernel support|no neighbour|0.09 m'), &
        case_t('&kernel support = 1e20 /', 2, 'line 3: &kernel support|at most 100'), &
        case_t('&kernel name = ''wendlandc2'' /', 2, 'line 3: &kernel name|''wendland_c2'''), &
        case_t('&scheme laplacian = ''brokshaw'' /', 2, &
               'line 4: &scheme laplacian|''brookshaw'''), &
        case_t('&scheme laplacian = ''consistent'' order = 9 /', 2, &
               'line 4: &scheme order|1 to 8, not 9'), &
        case_t('&scheme support_growth = ''no'' /', 2, 'line 4: &scheme support_growth|.false.'), &
        case_t('&material conductivity = -1 /', 2, &
               'line 5: &material conductivity|greater than 0'), &
        case_t('&material conductivity_expression = ''x-2'' /', 2, &
               'line 5: &material conductivity_expression|greater than 0|at ('), &
        case_t('&material where_expression = ''x < 0.3'' /', 2, 'no &material is at ('), &
        case_t('&boundary on = ''lefft'' value = 0 /', 2, 'line 7: &boundary on|''left'''), &
        case_t('&boundary on = ''left'' value = 0 /', 2, 'nothing is said|''right''|''top'''), &
        case_t('&boundary kind = ''temprature'' value = 1 /', 2, &
               'line 7: &boundary kind|''temperature''|radiation'), &
        case_t('&boundary kind = ''T'' value = 1 /', 2, 'line 7: &boundary kind'), &
        case_t('&boundary value = 1 ambient = 1 /', 2, 'line 7: &boundary ambient|means nothing'), &
        case_t('&boundary kind = ''flux'' /', 2, 'line 7: &boundary|lacks ''flux'''), &
        case_t('&boundary kind = ''flux'' flux = 1 ambient = 2 /', 2, &
               'line 7: &boundary ambient|means nothing|''flux'''), &
        case_t('&boundary kind = ''insulated'' flux = 1 /', 2, &
               'line 7: &boundary flux|means nothing|''insulated'''), &
        case_t('&boundary kind = ''convection'' ambient = 1 /', 2, &
               'line 7: &boundary|lacks ''coefficient'''), &
        case_t('&boundary kind = ''convection'' coefficient = 1 /', 2, &
               'line 7: &boundary|lacks ''ambient'''), &
        case_t('&boundary kind = ''convection'' coefficient = -1 ambient = 1 /', 2, &
               'line 7: &boundary coefficient|less than 0'), &
        case_t('&boundary kind = ''radiation'' emissivity = 1.5 ambient = 1 /', 2, &
               'line 7: &boundary emissivity|more than 1'), &
        case_t('&boundary kind = ''radiation'' emissivity = 1 ambient = -1 /', 2, &
               'line 7: &boundary ambient|less than 0'), &
        case_t('&boundary value = 0 where_expression = ''t'' /', 2, &
               'line 7: &boundary where_expression|x and y only'), &
        case_t('&boundary value = 0 where_expression = ''x > 7'' /', 2, &
               'line 7: &boundary|no particle'), &
        case_t('&source power_expression = ''1/(x-0.5)'' /', 2, &
               'line 11: &source power_expression|no number'), &
        case_t('&source power = 1 where_expression = ''x > 7'' /', 2, &
               'line 11: &source|no particle'), &
        case_t('&time end = -1 /', 2, 'line 8: &time end|greater than 0'), &
        case_t('&material conductivity = 1e302 /', 2, &
               'line 5: &material conductivity = 1e302|too large|1e30'), &
        case_t('&material conductivity_xx = 1e302 conductivity_yy = 1e302 /', 2, &
               'line 5: &material conductivity_xx = 1e302|too large|1e30'), &
        case_t('&material density = 1e-41 /', 2, 'line 5: &material density|too small|1e-40'), &
        case_t('&material conductivity_expression = ''x > 0.5 ? 1e302 : 1'' /', 2, &
               'line 5: &material conductivity_expression|at ('), &
        case_t('&time end = 1 step = 1 method = ''forward_euler'' /', 2, &
               'line 8: &time|step = 1 s|stability limit|0.003'), &
        case_t('&time end = 1 step = 1e-12 /', 2, 'line 8: &time|more than can be counted'), &
        case_t('&time end = 1 step = 0.01 tolerance = 1e-3 /', 2, 'line 8: &time tolerance|step'), &
        case_t('&time end = 1 tolerance = 1e-28 /', 2, &
               'line 8: &time tolerance = 1e-28|at least 1e-15'), &
        case_t('&time end = 1 method = ''auot'' /', 2, 'line 8: &time method|''auto'''), &
        case_t('&output file = ''out.vtkhdf'' every = 0 /', 2, 'line 9: &output every'), &
        case_t('&output file = ''out.vtkhdf'' every = 1e-300 /', 2, 'line 9: &output|every'), &
        case_t('&output file = ''out.vtkhdf'' fields = ''heat'' /', 2, 'line 9: &output fields'), &
        case_t('&output file = '' '' /', 2, 'line 9: &output file|blank'), &
        case_t('&checkpoint every_seconds = -1 /', &
               2, 'line 11: &checkpoint every_seconds|not negative'), &
        case_t('&checkpoint keep = 0 /', 2, 'line 11: &checkpoint keep'), &
        case_t('&checkpoint file = ''out.vtkhdf'' /', 2, 'line 11: &checkpoint file|output'), &
        case_t('&checkpoint file = ''none/a.h5'' /', 4, 'line 11: &checkpoint|does not exist')])
  end subroutine test_wrong_values

  subroutine test_wrong_expressions(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_refusals(error, 'run', [ &
        case_t('&initial temperature_expression = ''sin(pi*x'' /', 2, &
               'line 6: &initial temperature_expression|''sin(pi*x''|position 9|parenthesis'), &
        case_t('&initial temperature_expression = ''x + foo'' /', 2, &
               'line 6: &initial temperature_expression|position 5|foo'), &
        case_t('&initial temperature_expression = '''' /', 2, 'line 6: &initial|empty'), &
        case_t('&initial temperature_expression = ''1/x'' /', 2, 'scene.nml|&initial|1/x|(0, '), &
        case_t('&boundary value_expression = ''2 +'' /', 2, &
               'line 7: &boundary value_exp|position'), &
        case_t('&boundary value_expression = ''log(-1-x)'' /', 2, 'line 7: &boundary|no number'), &
        case_t('&boundary value_expression = ''sqrt(0.01-t)'' /', 3, 't = 0.01 s|no numbers'), &
        case_t('&output file = ''o.vtkhdf'' fields = ''error_estimate'' /', 2, &
               'line 9: &output fields|error_estimate|&accuracy estimate'), &
        case_t('&scene exact_expression = ''x y'' /', 2, 'line 1: &scene exact_expression')])
  end subroutine test_wrong_expressions

  subroutine test_wrong_clouds(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: head = 'x,y,wall'//new_line('a'), end = new_line('a')

    call start_over()
    call write_text(folder//'empty.csv', '')
    call write_text(folder//'head.csv', head)
    call write_text(folder//'nan.csv', head//'0,0,1'//end//'0.5,NaN,0'//end)
    call write_text(folder//'text.csv', head//'0,0,1'//end//'0.5,here,0'//end)
    call write_text(folder//'short.csv', head//'0,0,1'//end//'0.5,0.5'//end)
    call write_text(folder//'twice.csv', head//'0,0,1'//end//'0.5,0,0'//end//'1,0,1'//end// &
                    '0.5,0,0'//end)
    call write_text(folder//'walls.csv', head//'0,0,1'//end//'1,0,1'//end)
    call write_text(folder//'none.csv', 'x,y'//end//'0,0'//end//'1,0'//end)
    call write_text(folder//'lonely.csv', head//'0,0,1'//end//'0.5,0,1'//end//'9,9,0'//end)
    call write_text(folder//'damaged.vtkhdf', achar(137)//'HDF'//achar(13)//achar(10)//achar(26)// &
                    achar(10)//repeat('x', 500))
    call expect_refusals(error, 'run', [ &
        case_t(cloud//'''missing.csv'' /', 2, 'missing.csv|does not exist'), &
        case_t(cloud//'''.'' /', 2, 'folder'), &
        case_t(cloud//'''empty.csv'' /', 2, 'empty.csv|empty'), &
        case_t(cloud//'''head.csv'' /', 2, 'head.csv|particle'), &
        case_t(cloud//'''nan.csv'' /', 2, 'nan.csv|line 3|''y''|NaN'), &
        case_t(cloud//'''text.csv'' /', 2, 'text.csv|line 3|''y''|here'), &
        case_t(cloud//'''short.csv'' /', 2, 'short.csv|line 3|2'), &
        case_t(cloud//'''twice.csv'' /', 2, 'line 2: &domain|Particles 2 and 4|same place'), &
        case_t(cloud//'''walls.csv'' /', 2, 'all 2 particles|boundary'), &
        case_t(cloud//'''none.csv'' /', 2, 'no particle|wall'), &
        case_t(cloud//'''lonely.csv'' /', 2, 'line 3: &kernel support|particle 3|no neighbour'), &
        case_t(cloud//'''damaged.vtkhdf'' /', 2, 'damaged.vtkhdf|damaged'), &
        case_t('&domain shape = ''cloud'' file = ''walls.csv'' /', 2, &
               'spacing|volume')], keep=.true.)
  end subroutine test_wrong_clouds

  subroutine test_wrong_outputs(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: commands(2) = [character(len=5) :: 'run', 'check']
    type(outcome_t) :: outcome
    integer :: k

    do k = 1, size(commands)
      call expect_refusals(error, trim(commands(k)), [ &
          case_t('&output file = ''nowhere/out.vtkhdf'' /', 4, &
                 'line 9: &output file|nowhere/out.vtkhdf|''nowhere'' does not exist'), &
          case_t('&output file = ''scene.nml/out.vtkhdf'' /', 4, '''scene.nml'' is not a folder'), &
          case_t('&output file = ''/dev/full'' /', 4, '/dev/full|not a regular file'), &
          case_t('&output file = ''.'' /', 4, 'folder'), &
          case_t('&output file = ''scene.nml'' /', 2, &
                 'line 9: &output file|over the scene itself')])
      if (allocated(error)) return
    end do

    ! The cloud of a scene is safe too.
    call start_over()
    call write_scene('')
    call calor('run scene.nml', outcome)
    call expect_success(error, outcome, '')
    if (allocated(error)) return
    call write_scene('&domain shape = ''cloud'' file = ''out.vtkhdf'' /')
    call expect_call(error, 'run scene.nml', 2, 'line 9: &output file|over the cloud')
  end subroutine test_wrong_outputs

  subroutine test_wrong_operators(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_refusals(error, 'operators', [ &
        case_t('&operators field_expression = ''sin('' /', 2, &
               'line 10: &operators field_expression'), &
        case_t('&operators field_expression = ''1/x'' /', 2, '1/x|no number'), &
        case_t('&operators field_expression = ''x'' gradients = ''summ'' /', 2, &
               'line 10: &operators gradients|Did you mean ''sum'''), &
        case_t('&operators field_expression = ''x'' laplacians = ''consistant'' /', 2, &
               'line 10: &operators laplacians|Did you mean ''consistent'''), &
        case_t('&operators field_expression = ''x'' file = ''nowhere/out.vtkhdf'' /', 4, &
               'line 10: &operators file|''nowhere'' does not exist'), &
        case_t('&operators gradients = ''sum'' /', 2, 'line 10: &operators|field_expression'), &
        case_t('&kernel support = 0.9 /', 2, 'line 3: &kernel support|no neighbour')])
  end subroutine test_wrong_operators

  ! ---------------------------------------------------------------------------------------------
  ! Files and states
  ! ---------------------------------------------------------------------------------------------

  subroutine test_old_file(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    character(len=:), allocatable :: before

    call start_over()
    call write_scene('')
    call calor('run scene.nml', outcome)
    call expect_success(error, outcome, '')
    if (allocated(error)) return
    before = contents_of(folder//'out.vtkhdf')
    call write_scene('&kernel support = 0.9 /')
    call expect_call(error, 'run scene.nml', 2, 'no neighbour')
    if (allocated(error)) return
    call check(error, contents_of(folder//'out.vtkhdf') == before, 'the old file was lost')
  end subroutine test_old_file

  subroutine test_unstable(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    real(wp), allocatable :: times(:), temperature(:)
    character(len=*), parameter :: unstable = square//'spacing = 0.05 '// &
        'arrangement = ''jittered'' jitter = 0.45 / &kernel support = 1.5 / '
    integer :: particles

    call start_over()
    call write_scene(unstable, without='&kernel')
    call calor('run scene.nml', outcome)
    call expect_failure(error, outcome, 3, 'unstable|eigenvalue|support_growth|allow_unstable')
    if (allocated(error)) return
    call write_scene(unstable//'&scheme support_growth = .false. allow_unstable = .true. /', &
                     without='&kernel &scheme')
    call calor('run scene.nml', outcome)
    call expect_failure(error, outcome, 3, 'unstable|last good state|out.vtkhdf')
    if (allocated(error)) return
    times = field('out.vtkhdf', '/VTKHDF/Steps/Values')
    temperature = field('out.vtkhdf', '/VTKHDF/PointData/temperature')
    particles = 21*21
    call check(error, size(times) >= 2 .and. size(temperature) == particles*size(times))
    if (allocated(error)) return
    call check(error, all(abs(temperature) < 20.0_wp), 'the last state is not a good one')
    if (allocated(error)) return
    call check(error, times(size(times)), &
               number_after(outcome%errors, 'The last good state, at t ='), &
               thr=1.0e-4_wp, rel=.true.)
  end subroutine test_unstable

  subroutine test_same_bytes(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    integer :: k

    call start_over()
    call write_scene(jittered//'seed=7 /')
    do k = 1, 2
      call calor('run scene.nml', outcome)
      call expect_success(error, outcome, '')
      if (allocated(error)) return
      ! So that a time of day in the file would differ
      call execute_command_line('sleep 1.1; cd '//folder//' && mv out.vtkhdf '// &
                                to_text(k)//'.vtkhdf')
      call zero_wall_times(folder//to_text(k)//'.vtkhdf')
    end do
    call run_command('cmp '//folder//'1.vtkhdf '//folder//'2.vtkhdf', folder//'../cmp', outcome)
    call check(error, outcome%status, 0, outcome%output)
  end subroutine test_same_bytes

  subroutine test_threads(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    real(wp), allocatable :: one(:), two(:)

    call start_over()
    call write_scene('&domain x_range=0, 1 y_range=0, 1 spacing=0.02 arrangement=''jittered'' /')
    call calor('run scene.nml', outcome, threads=1)
    call expect_success(error, outcome, '')
    if (allocated(error)) return
    one = field('out.vtkhdf', '/VTKHDF/PointData/temperature')
    call calor('run scene.nml', outcome, threads=2)
    call expect_success(error, outcome, '')
    if (allocated(error)) return
    two = field('out.vtkhdf', '/VTKHDF/PointData/temperature')
    call check(error, size(one), size(two))
    if (allocated(error)) return
    call check(error, maxval(abs(one - two)) <= 1.0e-12_wp)
  end subroutine test_threads

  !> The particles of a plate, in an order that no program would choose
  subroutine test_user_order(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: n = 11
    type(outcome_t) :: outcome
    character(len=:), allocatable :: table
    real(wp) :: x(n*n), y(n*n), wall(n*n)
    real(wp), allocatable :: points(:, :)
    integer :: k, place

    call start_over()
    table = 'x,y,wall,volume'//new_line('a')
    do k = 1, n*n
      place = modulo(37*k, n*n)
      x(k) = 0.1_wp*modulo(place, n)
      y(k) = 0.1_wp*(place/n)
      wall(k) = merge(1, 0, modulo(place, n) == 0 .or. modulo(place, n) == n - 1 .or. &
                      place/n == 0 .or. place/n == n - 1)
      table = table//to_text(x(k))//','//to_text(y(k))//','//to_text(nint(wall(k)))//',0.01'// &
              new_line('a')
    end do
    call write_text(folder//'cloud.csv', table)
    call write_scene('&domain shape = ''cloud'' file = ''cloud.csv'' /')
    call calor('run scene.nml', outcome)
    call expect_success(error, outcome, '121|from cloud.csv|relative L2 error')
    if (allocated(error)) return
    points = reshape(field('out.vtkhdf', '/VTKHDF/Points'), [3, n*n])
    call check(error, all(abs(points(1, :) - x) <= 0 .and. abs(points(2, :) - y) <= 0), &
               'the particles are in another order')
    if (allocated(error)) return
    call check(error, all(nint(field('out.vtkhdf', '/VTKHDF/PointData/wall')) == nint(wall)))
    if (allocated(error)) return
    associate (start => field('out.vtkhdf', '/VTKHDF/PointData/temperature'), pi => acos(-1.0_wp))
      call check(error, all(abs(start(:n*n) - (1 - wall)*sin(pi*x)*sin(pi*y)) < 1.0e-12_wp), &
                 'the temperatures are in another order')
    end associate
  end subroutine test_user_order

  subroutine test_interrupted(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call start_over()
    call write_scene('&time end = 1e6 method = ''forward_euler'' /')
    call run_command('cd '//folder//' && exec timeout -s INT 1 "'//program_path()//'" '// &
                     'run scene.nml', folder//'../interrupted', outcome)
    ! `timeout` says 124 when it had to act and the program obeyed.
    call check(error, outcome%status, 124, outcome%errors)
    if (allocated(error)) return
    call check_no_trace(error, outcome)
  end subroutine test_interrupted

  ! ---------------------------------------------------------------------------------------------
  ! Tools
  ! ---------------------------------------------------------------------------------------------

  !> An empty folder for a test
  subroutine start_over()
    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder)
  end subroutine start_over

  !> Write the plate into scene.nml, with other groups in the place of those of the same name.
  subroutine write_scene(group, without)
    !> What to put in
    character(len=*), intent(in) :: group
    !> Groups to leave out besides, such as '&kernel &scheme'
    character(len=*), intent(in), optional :: without
    character(len=:), allocatable :: scene, line
    logical :: placed
    integer :: k

    scene = ''
    placed = group == ''
    do k = 1, size(plate)
      line = trim(plate(k))
      if (.not. placed .and. first_word(line) == first_word(group)) then
        line = trim(group)
        placed = .true.
      else if (present(without)) then
        if (index(without, first_word(line)) > 0) line = ''
      end if
      scene = scene//line//new_line('a')
    end do
    if (.not. placed) scene = scene//trim(group)//new_line('a')
    call write_text(folder//'scene.nml', scene)
  end subroutine write_scene

  pure function first_word(text) result(word)
    character(len=*), intent(in) :: text
    character(len=:), allocatable :: word

    word = text(:index(text//' ', ' ') - 1)
  end function first_word

  function program_path() result(path)
    character(len=:), allocatable :: path
    type(outcome_t) :: here

    path = environment_or('CALOR_PROGRAM', 'bin/calor')
    if (path(1:1) == '/') return
    call run_command('pwd', folder//'../here', here)
    path = here%output(:len(here%output) - 1)//'/'//path
  end function program_path

  !> Run the program in the scratch folder.
  subroutine calor(arguments, outcome, threads)
    character(len=*), intent(in) :: arguments
    type(outcome_t), intent(out) :: outcome
    integer, intent(in), optional :: threads
    character(len=:), allocatable :: setting

    setting = ''
    if (present(threads)) setting = 'OMP_NUM_THREADS='//to_text(threads)//' '
    call run_command('cd '//folder//' && '//setting//'"'//program_path()//'" '//arguments, &
                     folder//'../called', outcome)
  end subroutine calor

  !> The program must have done what it was asked for, and have said so with some words.
  subroutine expect_success(error, outcome, words)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t), intent(in) :: outcome
    !> Parted by |
    character(len=*), intent(in) :: words

    call check(error, outcome%status, 0, outcome%errors)
    if (allocated(error)) return
    call check(error, outcome%errors, '')
    if (allocated(error)) return
    call check_words(error, outcome%output, words)
  end subroutine expect_success

  !> The program must have failed, with one clear message.
  subroutine expect_failure(error, outcome, status, words)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t), intent(in) :: outcome
    integer, intent(in) :: status
    !> Parted by |
    character(len=*), intent(in) :: words

    call check(error, outcome%status, status, outcome%output//outcome%errors)
    if (allocated(error)) return
    call check(error, index(outcome%errors, 'calor: '), 1, outcome%errors)
    if (allocated(error)) return
    call check(error, line_count(outcome%errors) <= 5, outcome%errors)
    if (allocated(error)) return
    call check_words(error, outcome%errors, words)
    if (allocated(error)) return
    call check_no_trace(error, outcome)
  end subroutine expect_failure

  subroutine check_words(error, text, words)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: text, words
    integer :: start, length

    start = 1
    do while (start <= len(words))
      length = index(words(start:)//'|', '|') - 1
      if (index(text, trim(words(start:start + length - 1))) == 0) then
        call test_failed(error, '"'//trim(words(start:start + length - 1))//'" is not in:'// &
                         new_line('a')//text)
        return
      end if
      start = start + length + 1
    end do
  end subroutine check_words

  !> A user must never see the inside of the program.
  subroutine check_no_trace(error, outcome)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t), intent(in) :: outcome
    character(len=*), parameter :: traces(*) = [character(len=16) :: 'Backtrace', 'backtrace', &
        'At line', 'Fortran runtime', 'SIG', 'HDF5-DIAG', 'IEEE', 'Sanitizer', 'runtime error']
    integer :: k

    do k = 1, size(traces)
      call check(error, index(outcome%output//outcome%errors, trim(traces(k))), 0, &
                 outcome%output//outcome%errors)
      if (allocated(error)) return
    end do
  end subroutine check_no_trace

  subroutine expect_call(error, arguments, status, words)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: arguments
    integer, intent(in) :: status
    character(len=*), intent(in) :: words
    type(outcome_t) :: outcome

    call calor(arguments, outcome)
    call expect_failure(error, outcome, status, words)
    if (allocated(error)) error%message = 'calor '//arguments//': '//error%message
  end subroutine expect_call

  !> The plate with each of some groups must be refused.
  subroutine expect_refusals(error, command, cases, keep)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: command
    type(case_t), intent(in) :: cases(:)
    !> Whether the test has put files into the folder
    logical, intent(in), optional :: keep
    integer :: k

    if (.not. present(keep)) call start_over()
    do k = 1, size(cases)
      call write_scene(cases(k)%group)
      call expect_call(error, command//' scene.nml', cases(k)%status, trim(cases(k)%words))
      if (allocated(error)) then
        error%message = trim(cases(k)%group)//': '//error%message
        return
      end if
    end do
  end subroutine expect_refusals

  !> All numbers of a dataset, one after another; none if it cannot be read.
  function field(name, dataset_name) result(values)
    character(len=*), intent(in) :: name, dataset_name
    real(wp), allocatable :: values(:)
    integer(hid_t) :: file, dataset, space
    integer(hsize_t) :: points
    integer :: status

    allocate (values(0))
    call start_hdf5(status)
    call h5fopen_f(folder//name, h5f_acc_rdonly_f, file, status)
    if (status < 0) return
    call h5dopen_f(file, dataset_name, dataset, status)
    if (status >= 0) then
      call h5dget_space_f(dataset, space, status)
      call h5sget_simple_extent_npoints_f(space, points, status)
      deallocate (values)
      allocate (values(points), source=huge(1.0_wp))
      call h5dread_f(dataset, h5t_native_double, values, [points], status)
      call h5sclose_f(space, status)
      call h5dclose_f(dataset, status)
    end if
    call h5fclose_f(file, status)
  end function field

  !> Wall times differ from run to run; all else must not.
  subroutine zero_wall_times(path)
    character(len=*), intent(in) :: path
    integer(hid_t) :: file, group, attribute
    integer :: status, number, k

    call start_hdf5(status)
    call h5fopen_f(path, h5f_acc_rdwr_f, file, status)
    if (status < 0) return
    call h5gopen_f(file, '/calor/wall_time', group, status)
    call h5aget_num_attrs_f(group, number, status)
    do k = 0, number - 1
      call h5aopen_by_idx_f(group, '.', h5_index_name_f, h5_iter_inc_f, int(k, hsize_t), &
                            attribute, status)
      call h5awrite_f(attribute, h5t_native_double, 0.0_wp, [1_hsize_t], status)
      call h5aclose_f(attribute, status)
    end do
    call h5gclose_f(group, status)
    call h5fclose_f(file, status)
  end subroutine zero_wall_times

end module test_command_line
