!> Tests of `calor_scene_contract`.
module test_scene_contract
  use calor_error, only: error_t, status_bad_input
  use calor_scene_contract, only: check_against_contract, contract_help, contract_default
  use calor_scene_file, only: scene_file_t, parse_scene_text
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_scene_contract

  character(len=1), parameter :: lf = achar(10)

  !> A scene with everything that is available
  character(len=*), parameter :: full_scene = &
      '&scene title = ''Plate'' exact_expression = ''sin(pi*x)*exp(-t)'' /'//lf// &
      '&domain shape = ''rectangle'' x_range = 0.0, 1.0 y_range = 0.0, 1.0'//lf// &
      '  spacing = 0.025 arrangement = ''jittered'' jitter = 0.2 seed = 1'//lf// &
      '  file = ''c.csv'' /'//lf// &
      '&kernel name = ''wendland_c2'' support = 2.1 /'//lf// &
      '&scheme laplacian = ''fatehi_manzari'' gradient = ''renormalized'''//lf// &
      '  support_growth = F /'//lf// &
      '&material conductivity = 1.0 density = 1 heat_capacity = 1.0 /'//lf// &
      '&initial temperature_expression = ''sin(pi*x)'' /'//lf// &
      '&boundary on = ''left'' kind = ''temperature'' value = 0 /'//lf// &
      '&boundary on = ''all'' value_expression = ''sin(t)'' /'//lf// &
      '&time end = 0.05 step = 1e-3 method = ''auto'' tolerance = 1.0e-6 steady = .FALSE. /'//lf// &
      '&output file = ''p.vtkhdf'' every = 0.01 fields = ''temperature'' /'//lf// &
      '&operators field_expression = ''exp(x)'' gradients = ''all'''//lf// &
      '  laplacians = ''a'', ''b'''//lf// &
      '  exact_gradient_x_expression = ''x'' exact_gradient_y_expression = ''0'''//lf// &
      '  exact_laplacian_expression = ''x'' file = ''o.vtkhdf'' /'//lf// &
      '&cost spacings = 0.1, 0.05 laplacians = ''all'' supports = 2.1'//lf// &
      '  orders = 4 repetitions = 3 seconds = 60 target = 1e-4 file = ''c.csv'' /'

contains

  subroutine collect_scene_contract(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('what is available', test_available), &
                new_unittest('unknown groups', test_unknown_groups), &
                new_unittest('unknown keys', test_unknown_keys), &
                new_unittest('wrong types', test_types), &
                new_unittest('repeated groups', test_repeated), &
                new_unittest('number and expression', test_companions), &
                new_unittest('keys of materials', test_material_keys), &
                new_unittest('help', test_help), &
                new_unittest('mutated scenes', test_mutations) &
                ]
  end subroutine collect_scene_contract

  subroutine check_text(text, failure)
    character(len=*), intent(in) :: text
    type(error_t), allocatable, intent(out) :: failure
    type(scene_file_t) :: scene

    call parse_scene_text(text, 'a.nml', scene, failure)
    if (allocated(failure)) return
    call check_against_contract(scene, failure)
  end subroutine check_text

  subroutine accept(text, error)
    character(len=*), intent(in) :: text
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure

    call check_text(text, failure)
    if (allocated(failure)) call test_failed(error, failure%message)
  end subroutine accept

  subroutine refuse(text, message, error)
    character(len=*), intent(in) :: text, message
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure

    call check_text(text, failure)
    call check(error, allocated(failure), 'accepted: '//text)
    if (allocated(error)) return
    call check(error, failure%status, status_bad_input)
    if (allocated(error)) return
    call check(error, index(failure%message, message) > 0, failure%message//' / '//message)
  end subroutine refuse

  subroutine test_available(error)
    type(error_type), allocatable, intent(out) :: error

    call accept(full_scene, error)
    if (allocated(error)) return
    call accept('', error)
    if (allocated(error)) return
    call accept('&INITIAL Temperature = 300 /', error)
  end subroutine test_available

  subroutine test_unknown_groups(error)
    type(error_type), allocatable, intent(out) :: error

    call refuse(lf//'&domian /', 'a.nml, line 2: &domian: there is no such group. Did you mean '// &
                '''domain''?'//lf//'There are: scene, domain, ', error)
    if (allocated(error)) return
    call refuse('&qqqqqqqqqqqqqqqq /', 'there is no such group.'//lf, error)
  end subroutine test_unknown_groups

  subroutine test_unknown_keys(error)
    type(error_type), allocatable, intent(out) :: error

    call refuse('&domain'//lf//'spacng = 0.1 /', 'a.nml, line 2: &domain spacng = 0.1: '// &
                '&domain has no such key. Did you mean ''spacing''?'//lf//'It has: shape, ', error)
    if (allocated(error)) return
    ! The key of another group
    call refuse('&kernel spacing = 0.1 /', '&kernel has no such key. It belongs to &domain.', error)
    if (allocated(error)) return
    call refuse('&scene step = 0.1 /', 'It belongs to &motion or &time.', error)
    if (allocated(error)) return
    call refuse('&kernel '//repeat('a', 100)//' = 1 /', '&kernel '//repeat('a', 57)//'... = 1: ', &
                error)
    if (allocated(error)) return
    ! No expressions where nothing may vary
    call refuse('&time end_expression = ''1'' /', '&time has no such key.', error)
  end subroutine test_unknown_keys

  subroutine test_types(error)
    type(error_type), allocatable, intent(out) :: error

    call refuse('&domain spacing = ''abc'' /', &
                'a.nml, line 1: &domain spacing = ''abc'': expected a number.', error)
    if (allocated(error)) return
    call refuse('&domain spacing = 1, 2 /', 'expected one number, found 2 values.', error)
    if (allocated(error)) return
    call refuse('&domain x_range = 0, ''a'' /', 'expected a number, found ''a''', error)
    if (allocated(error)) return
    call refuse('&domain seed = 1.5 /', 'expected a whole number', error)
    if (allocated(error)) return
    call refuse('&scheme support_growth = 0 /', 'expected .true. or .false.', error)
    if (allocated(error)) return
    call refuse('&kernel name = 3 /', 'expected a text in quotes', error)
    if (allocated(error)) return
    call refuse('&operators gradients = ''all'', T /', 'expected a text in quotes', error)
    if (allocated(error)) return
    call refuse('&initial temperature_expression = ''sin(z)'' /', 'a.nml, line 1: &initial '// &
                'temperature_expression: the expression ''sin(z)'' is wrong at position 5', error)
    if (allocated(error)) return
    call refuse('&initial temperature_expression = 300 /', 'expected a text in quotes', error)
  end subroutine test_types

  subroutine test_repeated(error)
    type(error_type), allocatable, intent(out) :: error

    call refuse('&time end = 1 /'//lf//'&material /'//lf//'&time end = 2 /', 'a.nml, line 3: '// &
                '&time: the group is there already, in line 1; it may stand only once.', error)
    if (allocated(error)) return
    call refuse('&initial /'//lf//'&initial /', 'it may stand only once', error)
    if (allocated(error)) return
    call accept('&material / &material /', error)
    if (allocated(error)) return
    call accept('&boundary on = ''left'' / &boundary on = ''right'' / &boundary /', error)
  end subroutine test_repeated

  subroutine test_companions(error)
    type(error_type), allocatable, intent(out) :: error

    call refuse('&boundary value = 1'//lf//'value_expression = ''t'' /', 'a.nml, line 1: '// &
                '&boundary value = 1: there is value_expression too, in line 2; give only', error)
    if (allocated(error)) return
    call refuse('&initial temperature_expression = ''x'''//lf//'temperature = 1 /', 'line 2: '// &
                '&initial temperature = 1: there is temperature_expression too, in line 1', error)
  end subroutine test_companions

  subroutine test_material_keys(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: keys(*) = [character(len=40) :: &
        'where_expression = ''x''', 'conductivity_expression = ''x''', &
        'conductivity_xx = 1', 'conductivity_yy_expression = ''x''', 'conductivity_xy = 1', &
        'density_expression = ''x''', 'heat_capacity_expression = ''x''']
    integer :: k

    do k = 1, size(keys)
      call accept('&material '//trim(keys(k))//' /', error)
      if (allocated(error)) return
    end do
  end subroutine test_material_keys

  subroutine test_help(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=:), allocatable :: help

    help = contract_help('Kernel')
    call check(error, index(help, '&kernel: the smoothing kernel'//lf//'  name ') == 1, help)
    if (allocated(error)) return
    call check(error, index(help, 'support radius in units of spacing '// &
               '(consistent: 1 + 0.45 order) (default 2.1)') > 0, help)
    if (allocated(error)) return
    call check(error, index(help, 'spacing = ') == 0 .and. index(help, 'seed') == 0, help)
    if (allocated(error)) return
    help = contract_help('checkpoint')
    call check(error, index(help, 'simulated time between two, s') > 0, help)
    if (allocated(error)) return
    help = contract_help()
    call check(error, index(help, '&boundary') > 0 .and. index(help, '&cost') > 0, help)
    if (allocated(error)) return
    call check(error, contract_default('kernel', 'support'), '2.1')
    if (allocated(error)) return
    call check(error, contract_default('kernel', 'spacing'), '')
  end subroutine test_help

  !> Whatever is done to a scene, it is accepted or refused with a message that names the file
  subroutine test_mutations(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: rounds = 3000
    character(len=*), parameter :: pieces = '&/=,''"!*()+-.0123456789eEdTtxy_ '//lf//achar(9)// &
        achar(13)
    type(error_t), allocatable :: failure
    character(len=:), allocatable :: text
    integer :: k, times, at, length, state

    state = 12345
    do k = 1, rounds
      text = full_scene
      do times = 1, 1 + random(4)
        at = 1 + random(len(text))
        select case (random(4))
        case (0)
          length = 1 + random(len(pieces))
          text(at:at) = pieces(length:length)
        case (1)
          text = text(:at - 1)//text(min(at + 1 + random(20), len(text)):)
        case (2)
          length = min(random(30), len(text) - at)
          text = text(:at)//text(at:at + length)//text(at + 1:)
        case default
          text(at:at) = char(random(256))
        end select
      end do
      call check_text(text, failure)
      if (.not. allocated(failure)) cycle
      call check(error, index(failure%message, 'a.nml') == 1, failure%message)
      if (allocated(error)) return
      call check(error, failure%status, status_bad_input)
      if (allocated(error)) return
    end do

  contains

    !> A number from 0 to limit - 1, the same ones in each run
    function random(limit) result(number)
      integer, intent(in) :: limit
      integer :: number

      state = modulo(1103*state + 12345, 1000003)
      number = modulo(state/7, limit)
    end function random

  end subroutine test_mutations

end module test_scene_contract
