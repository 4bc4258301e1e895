!> Every group and key of the scene format: what it says is run as calor runs it, or refused by
!> name before anything is written.
module test_contract
  use calor_kinds, only: wp
  use calor_scene_contract, only: contract_groups, contract_help
  use calor_text, only: text_t, to_text
  use test_runs, only: agree, run_ranks, said, write_scene
  use testdrive, only: error_type, new_unittest, test_failed, unittest_type
  implicit none (type, external)
  private

  public :: collect_contract

  integer, parameter :: wide = 100
  !> Lines of a scene at most
  integer, parameter :: most_lines = 24

  !> A scene, and what is said about it
  type :: case_t
    character(len=12) :: name = ''
    !> '': it is run, and agrees with calor; or the words of the refusal
    character(len=80) :: refusal = ''
    !> Where the refusal says that it is: the line, and the group and key
    integer :: line = 0
    character(len=24) :: place = ''
    character(len=wide) :: lines(most_lines) = ''
  end type case_t

contains

  subroutine collect_contract(tests)
    type(unittest_type), allocatable, intent(out) :: tests(:)

    tests = [new_unittest('every key is run or refused', test_keys), &
             new_unittest('the cases have every key', test_coverage), &
             new_unittest('every Laplacian, kernel and method', test_choices)]
  end subroutine collect_contract

  function cases() result(list)
    type(case_t) :: list(12)

    list(1)%name = 'rectangle'
    list(1)%lines(:18) = [character(len=wide) :: &
        '&scene title=''A plate'' exact_expression=''x+y'' /', &
        '&domain shape=''rectangle'' x_range=0,1 y_range=0,1 spacing=0.08', &
        '  arrangement=''jittered'' jitter=0.1 seed=4 /', &
        '&kernel name=''wendland_c4'' support=2.4 /', &
        '&scheme laplacian=''fatehi_manzari'' gradient=''renormalized'' support_growth=.true.', &
        '  allow_inexact_rows=.false. allow_unstable=.true. /', &
        '&material conductivity=2 density=3 heat_capacity=4 /', &
        '&initial temperature=1 /', &
        '&boundary on=''all'' kind=''temperature'' value=2 /', &
        '&boundary on=''left'' kind=''convection'' coefficient=2.0 ambient=3.0 /', &
        '&source power=2.0 where_expression=''x>0.4'' /', &
        '&operators field_expression=''x'' /', &
        '&cost spacings=0.1 /', &
        '&time end=0.1 step=0.001 method=''forward_euler'' /', &
        '&output file=''rectangle.vtkhdf'' every=0.05', &
        '  fields=''temperature'',''exact'',''error'',''row_quality'',''row_repair'',', &
        '  ''neighbours'',''support_radius'',', &
        '  ''condition_gradient'',''condition_laplacian'' /']
    list(2)%name = 'disc'
    list(2)%lines(:14) = [character(len=wide) :: &
        '&domain shape=''disc'' centre=0.1,0.2 radius=1 spacing=0.12 /', &
        '&scheme laplacian=''consistent'' order=2 /', &
        '&material conductivity_expression=''1+x/4'' density_expression=''1+y^2''', &
        '  heat_capacity_expression=''1+x^2'' /', &
        '&material conductivity=3 where_expression=''x>0.33'' /', &
        '&initial temperature_expression=''x'' /', &
        '&boundary on=''all'' kind=''insulated'' /', &
        '&boundary on=''all'' value_expression=''t'' where_expression=''x<0'' /', &
        '&source power_expression=''exp(-T)'' /', &
        '&time end=0.1 tolerance=1e-7 method=''rkl2'' /', &
        '&checkpoint file=''disc.h5'' every_seconds=0 every=0.05 keep=2 /', &
        '&output file=''disc.vtkhdf'' /', '', '']
    list(3)%name = 'annulus'
    list(3)%lines(:8) = [character(len=wide) :: &
        '&domain shape=''annulus'' radius=1 inner_radius=0.4 spacing=0.1', &
        '  arrangement=''hexagonal'' /', &
        '&material conductivity_xx=1 conductivity_yy=2 conductivity_xy=0.5 /', &
        '&boundary on=''outer'' kind=''flux'' flux=2 /', &
        '&boundary on=''inner'' kind=''convection'' coefficient_expression=''2+x''', &
        '  ambient_expression=''y'' /', &
        '&time steady=.true. /', &
        '&output file=''annulus.vtkhdf'' /']
    list(4)%name = 'polygon'
    list(4)%lines(:12) = [character(len=wide) :: &
        '&domain shape=''polygon'' vertices=0,0, 2,0, 2,1, 1,2, 0,2', &
        '  hole_vertices=0.5,0.5, 1,0.5, 1,1, 0.5,1, 0.5,0.5 spacing=0.12 /', &
        '&material conductivity_xx_expression=''1+x/4'' conductivity_yy_expression=''2+y/4''', &
        '  conductivity_xy_expression=''x*y/8'' density=200 /', &
        '&initial temperature=3 /', &
        '&boundary on=''all'' kind=''flux'' flux_expression=''x'' /', &
        '&boundary on=''edge 1'' kind=''radiation'' emissivity=0.5 ambient=2 /', &
        '&boundary on=''edge 2'' kind=''radiation'' emissivity_expression=''0.5+y/4''', &
        '  ambient_expression=''4'' /', &
        '&time end=1 method=''runge_kutta_4'' /', &
        '&output file=''polygon.vtkhdf'' /', '']
    list(5)%name = 'cloud'
    list(5)%lines(:7) = [character(len=wide) :: &
        '&domain shape=''cloud'' file=''rectangle_serial.vtkhdf'' /', &
        '&material latent_heat=5 solidus=0.4 liquidus=0.6 /', &
        '&initial temperature=0 /', &
        '&boundary on=''all'' kind=''temperature'' value=1 /', &
        '&time end=0.01 method=''auto'' /', &
        '&output file=''cloud.vtkhdf'' /', '']
    list(6) = refused('motion', 3, '&motion', 'does not support particles that move', &
                      '&motion velocity_x=1 velocity_y=1 step=0.1 skin=0.3 shifting=.true. /')
    list(7) = refused('motions', 3, '&motion', 'does not support particles that move', &
                      '&motion velocity_x_expression=''y'' velocity_y_expression=''-x'' /')
    list(8) = refused('estimate', 3, '&accuracy estimate', 'does not support estimates', &
                      '&accuracy estimate=.true. /')
    list(9) = refused('target', 3, '&accuracy target', 'does not support a target', &
                      '&accuracy target=0.01 /')
    list(10) = refused('relaxed', 1, '&domain arrangement', 'does not support ''relaxed''', '')
    list(10)%lines(1) = '&domain spacing=0.1 x_range=0,1 y_range=0,1 arrangement=''relaxed'' /'
    list(11) = refused('double', 3, '&scheme laplacian', 'does not support ''double_gradient''', &
                       '&scheme laplacian=''double_gradient'' /')
    list(12) = refused('single', 3, '&scheme single_weights', 'weights in single precision', &
                       '&scheme single_weights=.true. /')
  end function cases

  function refused(name, line, place, words, asked) result(one)
    character(len=*), intent(in) :: name, place, words, asked
    integer, intent(in) :: line
    type(case_t) :: one

    one%name = name
    one%refusal = words
    one%line = line
    one%place = place
    one%lines(1) = '&domain spacing=0.1 x_range=0,1 y_range=0,1 /'
    one%lines(2) = '&boundary on=''all'' kind=''temperature'' value=0 /'
    one%lines(3) = asked
    one%lines(4) = '&output file='''//name//'.vtkhdf'' /'
    one%lines(5) = '&time end=1 /'
  end function refused

  subroutine test_keys(error)
    type(error_type), allocatable, intent(out) :: error
    type(case_t), allocatable :: list(:)
    character(len=:), allocatable :: name
    integer :: k, status
    logical :: there

    list = cases()
    do k = 1, size(list)
      name = trim(list(k)%name)
      call execute_command_line('rm -f '//name//'.vtkhdf* '//name//'*.h5*')
      if (list(k)%refusal == '') then
        call agree(name, list(k)%lines, [2], error)
        if (allocated(error)) return
        cycle
      end if
      call write_scene(name, list(k)%lines)
      call run_ranks(name, 2, status)
      if (status /= 2) then
        call test_failed(error, name//': status '//to_text(status)//', not 2')
      else if (said(name, trim(list(k)%refusal)) /= 1) then
        call test_failed(error, name//': '''//trim(list(k)%refusal)//''' was said '// &
                         to_text(said(name, trim(list(k)%refusal)))//' times')
      else if (said(name, 'calor-mpi: '//name//'.nml, line '//to_text(list(k)%line)//': '// &
                    trim(list(k)%place)) /= 1) then
        call test_failed(error, name//': the place is not said')
      else if (said(name, '.') > 1 + said(name, 'mpirun') + said(name, 'Primary')) then
        ! Open MPI tells that there was a status
        call test_failed(error, name//': more was said than the refusal')
      end if
      if (allocated(error)) return
      call execute_command_line('test -z "$(ls '//name//'.vtkhdf* '//name//'*.h5* '// &
                                '2>/dev/null)"', exitstat=status)
      there = status /= 0
      if (there) call test_failed(error, name//': a file was written')
      if (allocated(error)) return
    end do
    call compare_rows()

  contains

    !> Fields about rows, which do not change with time
    subroutine compare_rows()
      character(len=19), parameter :: names(*) = [character(len=19) :: 'row_quality', &
          'row_repair', 'neighbours', 'support_radius', 'condition_gradient', &
          'condition_laplacian']
      integer :: n

      do n = 1, size(names)
        call agree('rectangle', list(1)%lines, [3], error, field=trim(names(n)), within=0.0_wp)
        if (allocated(error)) return
      end do
    end subroutine compare_rows

  end subroutine test_keys

  !> Keys as the help of the format lists them, but those of groups for other commands.
  subroutine test_coverage(error)
    type(error_type), allocatable, intent(out) :: error
    type(case_t), allocatable :: list(:)
    type(text_t), allocatable :: groups(:)
    character(len=:), allocatable :: help, key
    integer :: g, from, to

    list = cases()
    groups = contract_groups()
    do g = 1, size(groups)
      if (.not. is_there(list, groups(g)%value, '')) then
        call test_failed(error, 'no case has &'//groups(g)%value)
        return
      end if
      if (any(groups(g)%value == [character(len=9) :: 'operators', 'cost'])) cycle
      help = contract_help(groups(g)%value)//new_line('a')
      from = index(help, new_line('a')) + 1
      do while (from < len(help))
        to = from + index(help(from:), new_line('a')) - 2
        key = help(from + 2:to)
        key = key(:index(key, ' ') - 1)
        if (.not. is_there(list, groups(g)%value, key)) then
          call test_failed(error, 'no case has &'//groups(g)%value//' '//key)
          return
        end if
        from = to + 2
      end do
    end do
  end subroutine test_coverage

  !> Whether a group with a key, or a group where that is '', is in any case.
  pure function is_there(list, group, key) result(answer)
    type(case_t), intent(in) :: list(:)
    character(len=*), intent(in) :: group, key
    logical :: answer
    logical :: inside
    integer :: k, n

    answer = .false.
    do k = 1, size(list)
      inside = .false.
      do n = 1, most_lines
        associate (line => list(k)%lines(n))
          if (line(1:1) == '&') inside = index(line, '&'//group//' ') == 1
          if (key == '') then
            answer = answer .or. inside
          else
            answer = answer .or. (inside .and. index(line, ' '//key//'=') > 0)
          end if
        end associate
      end do
    end do
  end function is_there

  subroutine test_choices(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: number = 6
    character(len=24), parameter :: laplacians(number) = [character(len=24) :: &
        'kernel_second_derivative', 'brookshaw', 'brookshaw_renormalized', 'fatehi_manzari', &
        'positive', 'consistent']
    character(len=15), parameter :: kernels(number) = [character(len=15) :: 'cubic_spline', &
        'quintic_spline', 'wendland_c2', 'wendland_c4', 'wendland_c6', 'wendland_c2']
    character(len=13), parameter :: methods(number) = [character(len=13) :: 'rkl2', &
        'exponential', 'runge_kutta_4', 'forward_euler', 'tr_bdf2', 'auto']
    integer :: k

    do k = 1, number
      call agree('choice', [character(len=wide) :: &
                            '&domain x_range=0,1 y_range=0,1 spacing=0.08', &
                            '  arrangement=''jittered'' jitter=0.1 /', &
                            '&kernel name='''//trim(kernels(k))//''' support=2.8 /', &
                            '&scheme laplacian='''//trim(laplacians(k))//'''', &
                            '  allow_unstable=.true. /', &
                            '&initial temperature_expression=''sin(pi*x)*y'' /', &
                            '&boundary on=''all'' kind=''temperature'' value=0 /', &
                            '&time end=0.01 method='''//trim(methods(k))//''' /', &
                            '&output file=''choice.vtkhdf'' /'], [3], error)
      if (allocated(error)) then
        error%message = trim(laplacians(k))//': '//error%message
        return
      end if
    end do
  end subroutine test_choices

end module test_contract
