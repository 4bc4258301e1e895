!> Whatever the number of ranks, the field is that of one process.
!>
!> Rows are the same bit for bit, and so are the random vectors of the searches; only sums over all
!> particles are taken in another order. So steps agree to rounding, and 1e-10 leaves it a factor of
!> ten thousand.
module test_agreement
  use calor_kinds, only: wp
  use test_runs, only: agree, allowed, run_ranks, write_scene
  use calor_text, only: to_text
  use testdrive, only: error_type, new_unittest, test_failed, unittest_type
  implicit none (type, external)
  private

  public :: collect_agreement

  integer, parameter :: wide = 100

contains

  subroutine collect_agreement(tests)
    type(unittest_type), allocatable, intent(out) :: tests(:)

    tests = [new_unittest('plate on a lattice', test_lattice), &
             new_unittest('plate with jitter', test_jitter), &
             new_unittest('plate of order 4', test_order_4), &
             new_unittest('plate, the program choosing', test_auto), &
             new_unittest('disc with convection', test_disc), &
             new_unittest('two materials', test_slab), &
             new_unittest('cloud from a text file', test_csv), &
             new_unittest('cloud from an output file', test_vtkhdf), &
             new_unittest('polygon with radiation and flux', test_polygon), &
             new_unittest('melting', test_melting), &
             new_unittest('steady', test_steady), &
             new_unittest('no output', test_no_output), &
             new_unittest('unlike laws in contact', test_unlike), &
             new_unittest('a conductivity that is no product', test_no_product), &
             new_unittest('VTK''s reader opens the file', test_vtk), &
             new_unittest('implicit steps', test_implicit), &
             new_unittest('implicit steps of a given length', test_given_steps)]
  end subroutine collect_agreement

  subroutine test_lattice(error)
    type(error_type), allocatable, intent(out) :: error

    call agree('lattice', [character(len=wide) :: &
                           '&domain shape=''rectangle'' x_range=0,1 y_range=0,1 spacing=0.04 /', &
                           '&initial temperature_expression=''sin(pi*x)*sin(pi*y)'' /', &
                           '&boundary on=''all'' kind=''temperature'' value=0 /', &
                           '&time end=0.02 method=''rkl2'' /', &
                           '&output file=''lattice.vtkhdf'' every=0.01 /'], [1, 2, 3, 4, 8], error)
  end subroutine test_lattice

  subroutine test_jitter(error)
    type(error_type), allocatable, intent(out) :: error

    call agree('jitter', [character(len=wide) :: &
                          '&domain shape=''rectangle'' x_range=0,1 y_range=0,1.3 spacing=0.04', &
                          '  arrangement=''jittered'' jitter=0.2 seed=5 /', &
                          '&initial temperature_expression=''sin(pi*x)*sin(pi*y)'' /', &
                          '&boundary on=''all'' kind=''temperature'' value_expression=''x+t'' /', &
                          '&time end=0.02 method=''rkl2'' /', &
                          '&output file=''jitter.vtkhdf'' every=0.01 /'], [1, 2, 3, 4, 8], error)
  end subroutine test_jitter

  subroutine test_order_4(error)
    type(error_type), allocatable, intent(out) :: error

    call agree('order4', [character(len=wide) :: &
                          '&scene exact_expression=''sin(pi*x)*sin(pi*y)*exp(-2*pi^2*t)'' /', &
                          '&domain shape=''rectangle'' x_range=0,1 y_range=0,1 spacing=0.04', &
                          '  arrangement=''jittered'' jitter=0.2 /', &
                          '&scheme laplacian=''consistent'' order=4 /', &
                          '&kernel support=3.1 /', &
                          '&initial temperature_expression=''sin(pi*x)*sin(pi*y)'' /', &
                          '&boundary on=''all'' kind=''temperature'' value=0 /', &
                          '&time end=0.01 method=''rkl2'' /', &
                          '&output file=''order4.vtkhdf'' fields=''temperature'',''error'' /'], &
               [1, 2, 3, 4, 8], error, field='error')
  end subroutine test_order_4

  subroutine test_auto(error)
    type(error_type), allocatable, intent(out) :: error

    call agree('auto', [character(len=wide) :: &
                        '&domain shape=''rectangle'' x_range=0,1 y_range=0,1 spacing=0.04 ', &
                        '  arrangement=''hexagonal'' /', &
                        '&initial temperature_expression=''sin(pi*x)*sin(pi*y)'' /', &
                        '&boundary on=''all'' kind=''temperature'' value=0 /', &
                        '&time end=0.02 /', &
                        '&output file=''auto.vtkhdf'' /'], [1, 3], error)
  end subroutine test_auto

  subroutine test_disc(error)
    type(error_type), allocatable, intent(out) :: error

    call agree('disc', [character(len=wide) :: &
                        '&domain shape=''disc'' radius=1.0 spacing=0.06', &
                        '  arrangement=''jittered'' jitter=0.2 /', &
                        '&initial temperature=1.0 /', &
                        '&boundary on=''all'' kind=''convection'' coefficient=2.0', &
                        '  ambient_expression=''sin(t)+x'' /', &
                        '&source power_expression=''exp(-x^2)'' where_expression=''x>0.5'' /', &
                        '&time end=0.1 method=''rkl2'' /', &
                        '&output file=''disc.vtkhdf'' every=0.05 /'], [1, 2, 3, 4, 8], error)
  end subroutine test_disc

  subroutine test_slab(error)
    type(error_type), allocatable, intent(out) :: error

    call agree('slab', [character(len=wide) :: &
                        '&domain shape=''rectangle'' x_range=0,1 y_range=0,0.6 spacing=0.03', &
                        '  arrangement=''jittered'' jitter=0.2 seed=3 /', &
                        '&material conductivity=1 /', &
                        '&material conductivity=10 density=2 where_expression=''x>0.503'' /', &
                        '&initial temperature_expression=''x'' /', &
                        '&boundary on=''all'' kind=''insulated'' /', &
                        '&boundary on=''left'' kind=''temperature'' value=0 /', &
                        '&boundary on=''right'' kind=''temperature'' value=1 /', &
                        '&time end=0.01 method=''rkl2'' /', &
                        '&output file=''slab.vtkhdf'' /'], [1, 2, 3, 4, 8], error)
  end subroutine test_slab

  !> A cloud without volumes, its particles in no order: volumes are sums over the same neighbours
  !> in another order.
  subroutine test_csv(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: n = 24
    integer :: unit, k, place, row, column
    real(wp) :: x, y
    logical :: on_wall

    open (newunit=unit, file='particles.csv', action='write', status='replace')
    write (unit, '(a)') '# a cloud', 'wall,y,x'
    do k = 0, n*n - 1
      place = mod(k*217 + 11, n*n)
      column = place/n
      row = mod(place, n)
      on_wall = any([column, row] == 0) .or. any([column, row] == n - 1)
      x = real(column, wp)/(n - 1)
      y = real(row, wp)/(n - 1)
      if (.not. on_wall) then
        x = x + 0.2_wp*sin(37.0_wp*place)/(n - 1)
        y = y + 0.2_wp*cos(91.0_wp*place)/(n - 1)
      end if
      write (unit, '(i0,2('','',es24.17))') merge(1, 0, on_wall), y, x
    end do
    close (unit)
    call agree('csv', [character(len=wide) :: &
                       '&domain shape=''cloud'' file=''particles.csv'' spacing=0.0435 /', &
                       '&initial temperature_expression=''x*y'' /', &
                       '&boundary on=''all'' kind=''temperature'' value=0 /', &
                       '&time end=0.01 method=''rkl2'' /', &
                       '&output file=''csv.vtkhdf'' /'], [1, 2, 3, 4, 8], error, &
               volume_error=100*epsilon(1.0_wp)*0.0435_wp**2)
  end subroutine test_csv

  subroutine test_vtkhdf(error)
    type(error_type), allocatable, intent(out) :: error

    call test_csv(error)
    if (allocated(error)) return
    call agree('again', [character(len=wide) :: &
                         '&domain shape=''cloud'' file=''csv_serial.vtkhdf'' /', &
                         '&initial temperature_expression=''x*y'' /', &
                         '&boundary on=''all'' kind=''temperature'' value=0 /', &
                         '&time end=0.01 method=''rkl2'' /', &
                         '&output file=''again.vtkhdf'' /'], [3], error)
  end subroutine test_vtkhdf

  subroutine test_polygon(error)
    type(error_type), allocatable, intent(out) :: error

    call agree('polygon', [character(len=wide) :: &
                           '&domain shape=''polygon'' vertices=0,0, 2,0, 2,1, 1,1, 1,2, 0,2', &
                           '  spacing=0.08 /', &
                           '&material conductivity=20 density=1 heat_capacity=10 /', &
                           '&initial temperature=500 /', &
                           '&boundary on=''all'' kind=''radiation'' emissivity=0.8 ambient=300 /', &
                           '&boundary on=''edge 1'' kind=''flux'' flux=1000 /', &
                           '&boundary on=''edge 3'' kind=''insulated'' /', &
                           '&time end=0.05 method=''rkl2'' /', &
                           '&output file=''polygon.vtkhdf'' /'], [2, 5], error)
  end subroutine test_polygon

  subroutine test_melting(error)
    type(error_type), allocatable, intent(out) :: error

    call agree('melting', [character(len=wide) :: &
                           '&domain shape=''rectangle'' x_range=0,1 y_range=0,0.5 spacing=0.05 /', &
                           '&material latent_heat=5 solidus=0.4 liquidus=0.6', &
                           '  conductivity_expression=''1+T/4'' /', &
                           '&initial temperature=0 /', &
                           '&boundary on=''all'' kind=''insulated'' /', &
                           '&boundary on=''left'' kind=''temperature'' value=1 /', &
                           '&time end=0.1 method=''rkl2'' /', &
                           '&output file=''melting.vtkhdf''', &
                           '  fields=''temperature'',''liquid_fraction'' /'], [1, 3], error, &
               field='liquid_fraction')
  end subroutine test_melting

  !> Steps, their lengths and equations are those of calor, whose solutions are exact but for
  !> rounding where those of ranks are iterated.
  subroutine test_implicit(error)
    type(error_type), allocatable, intent(out) :: error

    call agree('implicit', [character(len=wide) :: &
                            '&domain shape=''disc'' radius=1.0 spacing=0.08 /', &
                            '&initial temperature_expression=''1+x'' /', &
                            '&boundary on=''all'' kind=''convection'' coefficient=2.0', &
                            '  ambient_expression=''sin(t)+x'' /', &
                            '&time end=0.1 method=''tr_bdf2'' tolerance=1e-7 /', &
                            '&output file=''implicit.vtkhdf'' every=0.05 /'], [1, 2, 3, 4], error)
  end subroutine test_implicit

  !> Held walls that change with time, and radiation: the program iterates to 1e-11 of 500 K.
  subroutine test_given_steps(error)
    type(error_type), allocatable, intent(out) :: error

    call agree('given', [character(len=wide) :: &
                         '&domain shape=''rectangle'' x_range=0,1 y_range=0,1 spacing=0.05', &
                         '  arrangement=''jittered'' jitter=0.2 /', &
                         '&material conductivity=20 density=1 heat_capacity=10 /', &
                         '&initial temperature=500 /', &
                         '&boundary on=''all'' kind=''radiation'' emissivity=0.8 ambient=300 /', &
                         '&boundary on=''left'' value_expression=''500+t'' /', &
                         '&time end=0.1 step=0.01 method=''tr_bdf2'' /', &
                         '&output file=''given.vtkhdf'' every=0.05 /'], [1, 3], error, &
               within=500*allowed)
  end subroutine test_given_steps

  !> Budgets close but for rounding: both programs find the weights for that.
  subroutine test_steady(error)
    type(error_type), allocatable, intent(out) :: error

    call agree('steady', [character(len=wide) :: &
                          '&domain shape=''annulus'' radius=1.0 inner_radius=0.4 spacing=0.06 /', &
                          '&initial temperature=1.0 /', &
                          '&boundary on=''outer'' kind=''convection'' coefficient=2.0', &
                          '  ambient_expression=''x'' /', &
                          '&boundary on=''inner'' kind=''temperature'' value=3 /', &
                          '&source power_expression=''exp(-T)'' /', &
                          '&time steady=.true. /', &
                          '&output file=''steady.vtkhdf'' /'], [1, 2, 4], error)
    if (allocated(error)) return
    call agree('steadyslab', [character(len=wide) :: &
                              '&domain shape=''rectangle'' x_range=0,1 y_range=0,0.6', &
                              '  spacing=0.03 arrangement=''jittered'' jitter=0.2 seed=3 /', &
                              '&material conductivity=1 /', &
                              '&material conductivity=10 where_expression=''x>0.503'' /', &
                              '&boundary on=''all'' value_expression=''x*y'' /', &
                              '&boundary on=''top'' kind=''flux'' flux=2 /', &
                              '&time steady=.true. /', &
                              '&output file=''steadyslab.vtkhdf'' /'], [1, 3], error)
  end subroutine test_steady

  !> A scene that asks for no file runs all the same.
  subroutine test_no_output(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: status

    call write_scene('silent', [character(len=wide) :: &
                                '&domain shape=''rectangle'' x_range=0,1 y_range=0,1', &
                                '  spacing=0.05 /', &
                                '&initial temperature_expression=''sin(pi*x)*sin(pi*y)'' /', &
                                '&boundary on=''all'' kind=''temperature'' value=0 /', &
                                '&time end=0.01 /'])
    call run_ranks('silent', 2, status)
    if (status /= 0) call test_failed(error, 'it ended with status '//to_text(status))
  end subroutine test_no_output

  !> Jumps of potentials at an interface, in time and steady
  subroutine test_unlike(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=wide), parameter :: start(*) = [character(len=wide) :: &
        '&domain shape=''rectangle'' x_range=0,1 y_range=0,0.6 spacing=0.04', &
        '  arrangement=''jittered'' jitter=0.2 seed=3 /', &
        '&material conductivity_expression=''1+T'' /', &
        '&material conductivity_expression=''10/(1+T)'' density=2 where_expression=''x>0.503'' /', &
        '&initial temperature_expression=''x'' /', &
        '&boundary on=''all'' kind=''insulated'' /', &
        '&boundary on=''left'' kind=''temperature'' value_expression=''y'' /', &
        '&boundary on=''right'' kind=''temperature'' value=1 /']

    call agree('unlike', [start, [character(len=wide) :: '&time end=0.01 method=''rkl2'' /', &
                                  '&output file=''unlike.vtkhdf'' /']], [1, 3], error)
    if (allocated(error)) return
    call agree('unlikesteady', [start, [character(len=wide) :: '&time steady=.true. /', &
                                        '&output file=''unlikesteady.vtkhdf'' /']], [1, 2], error)
  end subroutine test_unlike

  subroutine test_no_product(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=wide), parameter :: start(*) = [character(len=wide) :: &
        '&domain shape=''rectangle'' x_range=0,1 y_range=0,0.6 spacing=0.04', &
        '  arrangement=''jittered'' jitter=0.2 seed=3 /', &
        '&material conductivity_expression=''1+x*T'' /', &
        '&initial temperature_expression=''x'' /', &
        '&boundary on=''all'' kind=''insulated'' /', &
        '&boundary on=''left'' kind=''temperature'' value_expression=''y'' /', &
        '&boundary on=''right'' kind=''temperature'' value=1 /']

    call agree('noproduct', [start, [character(len=wide) :: '&time end=0.01 method=''rkl2'' /', &
                                     '&output file=''noproduct.vtkhdf'' /']], [1, 3], error)
    if (allocated(error)) return
    call agree('noproductsteady', [start, [character(len=wide) :: '&time steady=.true. /', &
                                           '&output file=''noproductsteady.vtkhdf'' /']], &
               [1, 2], error)
  end subroutine test_no_product

  !> Where VTK's reader is installed (`tools/set_up.sh vtk`)
  subroutine test_vtk(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: python = '../../.venv-vtk/bin/python'
    logical :: there
    integer :: status

    inquire (file=python, exist=there)
    if (.not. there) return
    call write_scene('vtk', [character(len=wide) :: &
                             '&domain shape=''rectangle'' x_range=0,1 y_range=0,1 spacing=0.05 /', &
                             '&initial temperature=1 /', &
                             '&boundary on=''all'' kind=''insulated'' /', &
                             '&time end=0.02 method=''rkl2'' /', &
                             '&output file=''vtk.vtkhdf'' every=0.01 /'])
    call run_ranks('vtk', 3, status)
    if (status == 0) then
      call execute_command_line(python//' ../../tools/check_vtk.py vtk.vtkhdf --steps 3 '// &
                                '--points 441 --times 0,0.01,0.02 --minimum 1 --maximum 1 '// &
                                '>vtk.out 2>&1', exitstat=status)
    end if
    if (status /= 0) call test_failed(error, 'status '//to_text(status)//': vtk.out')
  end subroutine test_vtk

end module test_agreement
