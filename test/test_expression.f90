!> Tests of `calor_expression`.
module test_expression
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_is_finite
  use, intrinsic :: iso_fortran_env, only: int64
  use calor_constants, only: pi
  use calor_error, only: error_t, status_bad_input
  use calor_expression, only: expression_t, compile_expression, longest_expression
  use calor_kinds, only: wp
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_expression

  !> A type that holds an expression, as the program's own types do
  type :: holder_t
    type(expression_t) :: expression
  end type holder_t

  !> Types that hold allocatable expressions: compilers are weak at copying these
  type :: deep_holder_t
    type(expression_t), allocatable :: one
    type(expression_t), allocatable :: many(:)
  end type deep_holder_t

contains

  subroutine collect_expression(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('values at points', test_values), &
                new_unittest('strided arrays', test_strided), &
                new_unittest('temperature and time differ', test_temperature), &
                new_unittest('constants and conditions', test_constants), &
                new_unittest('values that are no numbers', test_not_finite), &
                new_unittest('Bessel and error functions', test_functions), &
                new_unittest('variables in use', test_uses), &
                new_unittest('error messages', test_messages), &
                new_unittest('nothing wrong is accepted', test_refused), &
                new_unittest('a failed compilation leaves nothing', test_failed_compilation), &
                new_unittest('copies outlive the original', test_copies), &
                new_unittest('copies inside other types', test_deep_copies), &
                new_unittest('operators and functions are counted', test_operations), &
                new_unittest('a million points are fast', test_speed) &
                ]
  end subroutine collect_expression

  subroutine compile(text, expression, error)
    character(len=*), intent(in) :: text
    type(expression_t), intent(inout) :: expression
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure

    call compile_expression(text, expression, failure)
    if (allocated(failure)) call test_failed(error, failure%message)
  end subroutine compile

  subroutine test_values(error)
    type(error_type), allocatable, intent(out) :: error
    type(expression_t) :: expression
    real(wp), allocatable :: x(:), y(:), values(:)
    real(wp) :: value
    integer :: k

    call compile('sin(pi*x)*cos(y) + exp(-2*pi^2*t)', expression, error)
    if (allocated(error)) return
    x = [(0.001_wp*k, k=1, 10000)]
    y = 1.0_wp - x**2
    allocate (values(size(x)))
    call expression%evaluate(x, y, 0.1_wp, values)
    call check(error, maxval(abs(values - sin(pi*x)*cos(y) - exp(-0.2_wp*pi**2))) < 1.0e-14_wp)
    if (allocated(error)) return

    call expression%evaluate(0.5_wp, 0.0_wp, 0.0_wp, value)
    call check(error, value, 2.0_wp, thr=1.0e-15_wp)
    if (allocated(error)) return

    call expression%evaluate(x(:0), y(:0), 0.0_wp, values(:0))
    call check(error, expression%source(), 'sin(pi*x)*cos(y) + exp(-2*pi^2*t)')
  end subroutine test_values

  !> A function counts as ten operators, the call as four.
  subroutine test_operations(error)
    type(error_type), allocatable, intent(out) :: error
    type(expression_t) :: expression
    character(len=*), parameter :: texts(5) = [character(len=40) :: 'x', '10*(1 + sin(20*t))', &
                                               'exp(-((x-0.5)^2 + (y-0.5)^2)/0.02)', &
                                               'x > 0.5 ? T : 2*(y)', 'min(x,(y+t))']
    integer, parameter :: expected(5) = [4, 17, 21, 7, 15]
    integer :: k

    do k = 1, size(texts)
      call compile(trim(texts(k)), expression, error)
      if (allocated(error)) return
      call check(error, expression%operations(), expected(k), more=trim(texts(k)))
      if (allocated(error)) return
    end do
  end subroutine test_operations

  subroutine test_strided(error)
    type(error_type), allocatable, intent(out) :: error
    type(expression_t) :: expression
    real(wp) :: points(2, 50), results(3, 50)
    integer :: k

    call compile('x - 10*y', expression, error)
    if (allocated(error)) return
    points(1, :) = [(real(k, wp), k=1, 50)]
    points(2, :) = [(real(k**2, wp), k=1, 50)]
    results = -1.0_wp
    call expression%evaluate(points(1, 50:1:-1), points(2, 50:1:-1), 0.0_wp, results(2, :))
    call check(error, all(abs(results(2, 50:1:-1) - points(1, :) + 10*points(2, :)) < 1.0e-12_wp))
    if (allocated(error)) return
    call check(error, all(results([1, 3], :) < 0.0_wp), 'the neighbours were touched')
  end subroutine test_strided

  subroutine test_temperature(error)
    type(error_type), allocatable, intent(out) :: error
    type(expression_t) :: expression
    real(wp) :: values(2), value

    call compile('100*T + t', expression, error)
    if (allocated(error)) return
    call expression%evaluate([0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], 7.0_wp, values, &
                             temperature=[3.0_wp, 4.0_wp])
    call check(error, values(1), 307.0_wp)
    if (allocated(error)) return
    call check(error, values(2), 407.0_wp)
    if (allocated(error)) return
    call expression%evaluate(0.0_wp, 0.0_wp, 7.0_wp, value, temperature=1.0_wp)
    call check(error, value, 107.0_wp)
    if (allocated(error)) return
    ! A forgotten temperature shows; it is not the one of the last call
    call expression%evaluate(0.0_wp, 0.0_wp, 7.0_wp, value)
    call check(error, ieee_is_nan(value))
  end subroutine test_temperature

  subroutine test_constants(error)
    type(error_type), allocatable, intent(out) :: error
    type(expression_t) :: expression
    real(wp) :: values(2)

    call compile('x < 0.5 ? 1 : x >= 0.75 && x != 2 ? 4 : 0', expression, error)
    if (allocated(error)) return
    call expression%evaluate([0.25_wp, 0.8_wp], [0.0_wp, 0.0_wp], 0.0_wp, values)
    call check(error, all(nint(values) == [1, 4]))
    if (allocated(error)) return
    call compile('pi - _pi + log(_e) + min(3, 1e3, max(2, y)) + (x == 1)', expression, error)
    if (allocated(error)) return
    call expression%evaluate([0.0_wp, 1.0_wp], [0.0_wp, 0.0_wp], 0.0_wp, values)
    call check(error, values(1), 3.0_wp, thr=1.0e-14_wp)
    if (allocated(error)) return
    call check(error, values(2), 4.0_wp, thr=1.0e-14_wp)
    if (allocated(error)) return
    ! A single number and a single variable take shortcuts in muParser
    call compile(' 42 ', expression, error)
    if (allocated(error)) return
    call expression%evaluate([0.0_wp, 1.0_wp], [0.0_wp, 0.0_wp], 0.0_wp, values)
    call check(error, all(nint(values) == 42))
  end subroutine test_constants

  subroutine test_not_finite(error)
    type(error_type), allocatable, intent(out) :: error
    type(expression_t) :: expression
    real(wp) :: values(3)

    call compile('sqrt(x)', expression, error)
    if (allocated(error)) return
    call expression%evaluate([4.0_wp, -1.0_wp, 9.0_wp], [0.0_wp, 0.0_wp, 0.0_wp], 0.0_wp, values)
    call check(error, ieee_is_nan(values(2)))
    if (allocated(error)) return
    call check(error, values(3), 3.0_wp)
    if (allocated(error)) return
    call compile('1/(x - 0.5)', expression, error)
    if (allocated(error)) return
    call expression%evaluate([0.5_wp, 1.0_wp, 1.0_wp], [0.0_wp, 0.0_wp, 0.0_wp], 0.0_wp, values)
    call check(error, .not. ieee_is_finite(values(1)))
    if (allocated(error)) return
    call check(error, values(2), 2.0_wp)
  end subroutine test_not_finite

  !> Values from tables (Abramowitz and Stegun 9.1 and 7.1), and on all threads at once.
  subroutine test_functions(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: expressions(*) = [character(len=12) :: &
        'j0(2*x)', 'j1(-2*x)', 'erf(x/2)', 'erfc(x*5)', 'j0(2) + 0*x', 'erfc(30*x)*t']
    real(wp), parameter :: expected(*) = [0.223890779141236_wp, -0.576724807756873_wp, &
        0.520499877813047_wp, 1.53745979442803e-12_wp, 0.223890779141236_wp, 0.0_wp]
    type(expression_t) :: expression, mine
    type(error_t), allocatable :: failure
    real(wp) :: value
    real(wp) :: x(1000), values(1000)
    integer :: k, wrong

    do k = 1, size(expressions)
      call compile(trim(expressions(k)), expression, error)
      if (allocated(error)) return
      call expression%evaluate(1.0_wp, 0.0_wp, 0.0_wp, value)
      call check(error, abs(value - expected(k)) <= 1.0e-14_wp*abs(expected(k)) + 1.0e-300_wp, &
                 trim(expressions(k)))
      if (allocated(error)) return
    end do
    call compile('j0(x) + y*erf(x)', expression, error)
    if (allocated(error)) return
    x = [(0.01_wp*k, k=1, size(x))]
    wrong = 0
    !$omp parallel default(shared) private(mine, values) reduction(+: wrong) num_threads(4)
    !$omp critical
    mine = expression
    !$omp end critical
    call mine%evaluate(x, 2 + 0*x, 0.0_wp, values)
    wrong = count(abs(values - bessel_j0(x) - 2*erf(x)) > 1.0e-15_wp)
    !$omp end parallel
    call check(error, wrong, 0)
    if (allocated(error)) return
    call compile_expression('j0(x, y)', expression, failure)
    call check(error, allocated(failure), 'two arguments of one are accepted')
    if (allocated(error)) return
    call compile_expression('erf + 1', expression, failure)
    call check(error, index(failure%message, 'the function ''erf'' needs its arguments in') > 0)
  end subroutine test_functions

  subroutine test_uses(error)
    type(error_type), allocatable, intent(out) :: error
    type(expression_t) :: expression, other

    call check(error,.not. expression%is_compiled())
    if (allocated(error)) return
    call compile('exp(-t)*tan(x)', expression, error)
    if (allocated(error)) return
    call check(error, expression%is_compiled())
    if (allocated(error)) return
    call check(error, expression%uses('t') .and. expression%uses('x'))
    if (allocated(error)) return
    call check(error,.not. (expression%uses('T') .or. expression%uses('y')))
    if (allocated(error)) return
    other = expression
    call check(error, other%uses('t') .and. .not. other%uses('T'))
    if (allocated(error)) return
    call compile('T', expression, error)
    if (allocated(error)) return
    call check(error, expression%uses('T') .and. .not. expression%uses('t'))
  end subroutine test_uses

  subroutine test_messages(error)
    type(error_type), allocatable, intent(out) :: error

    call check_message('sin(pi*z)', 'the expression ''sin(pi*z)'' is wrong at position 8: '// &
                       '''z'' is not known (known: x, y, t, T, pi and muParser''s functions).', &
                       error)
    if (allocated(error)) return
    call check_message('sqr(x)', 'at position 1: ''sqr'' is not known', error)
    if (allocated(error)) return
    call check_message('sqr(x)', 'Did you mean ''sqrt''?', error)
    if (allocated(error)) return
    call check_message('x**2', 'at position 3: the operator ''*'' is out of place '// &
                       '(a power is written ''^'')', error)
    if (allocated(error)) return
    call check_message('1d-3*x', 'at position 2: ''d'' is not known', error)
    if (allocated(error)) return
    call check_message('2x', 'at position 2: an operator is missing before ''x''', error)
    if (allocated(error)) return
    call check_message('3*(x + y', 'at position 9: a closing parenthesis', error)
    if (allocated(error)) return
    call check_message('x)', 'at position 2: the parenthesis '')'' is out of place', error)
    if (allocated(error)) return
    call check_message('x +', 'at position 4: it ends too early', error)
    if (allocated(error)) return
    call check_message('2*-', 'at position 4: a value is missing', error)
    if (allocated(error)) return
    call check_message('1 + sin(x, y)', 'at position 5: the function ''sin'' has too many', error)
    if (allocated(error)) return
    call check_message('1 + sin x', 'at position 5: the function ''sin'' needs', error)
    if (allocated(error)) return
    call check_message('min(1, 2), y', 'at position 10: it has 2 values where one', error)
    if (allocated(error)) return
    call check_message('x = 1 ? 2 : 3', 'at position 3: ''='' would assign', error)
    if (allocated(error)) return
    call check_message('x < 1 ? 2', 'at position 7: ''?'' has no '':''', error)
    if (allocated(error)) return
    call check_message('1e999', 'at position 1: the number ''1e999'' is out of range', error)
    if (allocated(error)) return
    ! Positions count characters, not bytes
    call check_message('x + "ä" + ß', 'at position 5: a text in quotes', error)
    if (allocated(error)) return
    call check_message('x + ä*ß', 'at position 5: ''ä'' is not known', error)
    if (allocated(error)) return
    call check_message('', 'it is empty', error)
    if (allocated(error)) return
    call check_message('x + '//repeat('0', longest_expression), 'is longer than 1000', error)
  end subroutine test_messages

  subroutine check_message(text, expected, error)
    character(len=*), intent(in) :: text, expected
    type(error_type), allocatable, intent(out) :: error
    type(expression_t) :: expression
    type(error_t), allocatable :: failure

    call compile_expression(text, expression, failure)
    call check(error, allocated(failure), 'no error for: '//text)
    if (allocated(error)) return
    call check(error, failure%status, status_bad_input)
    if (allocated(error)) return
    call check(error, index(failure%message, expected) > 0, failure%message//' / '//expected)
  end subroutine check_message

  subroutine test_refused(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: wrong(*) = [character(len=20) :: &
        '   ', 'x, y', ',x', 'x,', 'x y', '3 4', '()', 'sin', 'sin()', 'min()', 'min(x,)', &
        'pi(2)', 'x(2)', 'x:1', 'x<1?2:', '!x', 'x&&', 'x=3', 'x===3', 'x<==3', 'x=', '=x', &
        'x $ y', '"a"', &
        'sin("a")', '0x1F', 'sum(0?1,2,3:6)', '&', '((((', 'x'//achar(0)//'y', 'x'//achar(10), &
        'e', 'Pi', 'X', 'SIN(x)', 'nan', 'inf', '1e', '.', '-', '- -']
    type(expression_t) :: expression
    type(error_t), allocatable :: failure
    integer :: k

    do k = 1, size(wrong)
      call compile_expression(wrong(k), expression, failure)
      call check(error, allocated(failure), 'no error for: '//wrong(k))
      if (allocated(error)) return
    end do
  end subroutine test_refused

  subroutine test_failed_compilation(error)
    type(error_type), allocatable, intent(out) :: error
    type(expression_t) :: expression
    type(error_t), allocatable :: failure
    real(wp) :: value

    call compile('x', expression, error)
    if (allocated(error)) return
    call compile_expression('x +', expression, failure)
    call check(error, allocated(failure) .and. .not. expression%is_compiled())
    if (allocated(error)) return
    call expression%evaluate(1.0_wp, 1.0_wp, 1.0_wp, value)
    call check(error, ieee_is_nan(value))
    if (allocated(error)) return
    call check(error, expression%source(), '')
    if (allocated(error)) return
    call compile('2*x', expression, error)
    if (allocated(error)) return
    call expression%evaluate(1.0_wp, 1.0_wp, 1.0_wp, value)
    call check(error, value, 2.0_wp)
  end subroutine test_failed_compilation

  subroutine test_copies(error)
    type(error_type), allocatable, intent(out) :: error
    type(expression_t), allocatable :: original
    type(expression_t) :: duplicate, empty
    real(wp) :: value

    allocate (original)
    call compile('x + 2*y', original, error)
    if (allocated(error)) return
    duplicate = original
    call compile('7', original, error)
    if (allocated(error)) return
    deallocate (original)
    call duplicate%evaluate(1.0_wp, 3.0_wp, 0.0_wp, value)
    call check(error, value, 7.0_wp)
    if (allocated(error)) return
    duplicate = duplicate
    call duplicate%evaluate(1.0_wp, 4.0_wp, 0.0_wp, value)
    call check(error, value, 9.0_wp)
    if (allocated(error)) return
    duplicate = empty
    call check(error,.not. duplicate%is_compiled())
  end subroutine test_copies

  subroutine test_deep_copies(error)
    type(error_type), allocatable, intent(out) :: error
    type(holder_t) :: first, second
    type(holder_t), allocatable :: list(:), list_copy(:), moved(:)
    type(deep_holder_t), allocatable :: deep
    type(deep_holder_t) :: deep_copy
    real(wp) :: value

    call compile('x*y', first%expression, error)
    if (allocated(error)) return
    second = first
    call compile('0', first%expression, error)
    if (allocated(error)) return
    call expect_product(second%expression, error)
    if (allocated(error)) return

    allocate (list(2))
    list(1) = second
    list(2) = second
    list_copy = list
    deallocate (list)
    call move_alloc(list_copy, moved)
    call expect_product(moved(2)%expression, error)
    if (allocated(error)) return

    allocate (deep)
    allocate (deep%one, deep%many(3))
    deep%one = second%expression
    deep%many(3) = second%expression
    deep_copy = deep
    call expect_product(deep%many(3), error)
    if (allocated(error)) return
    deallocate (deep)
    call expect_product(deep_copy%one, error)
    if (allocated(error)) return
    call expect_product(deep_copy%many(3), error)
    if (allocated(error)) return
    call deep_copy%many(1)%evaluate(1.0_wp, 1.0_wp, 0.0_wp, value)
    call check(error, ieee_is_nan(value))
  end subroutine test_deep_copies

  subroutine expect_product(expression, error)
    type(expression_t), intent(in) :: expression
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: values(3)

    call expression%evaluate([1.0_wp, 2.0_wp, 3.0_wp], [4.0_wp, 5.0_wp, 6.0_wp], 0.0_wp, values)
    call check(error, all(nint(values) == [4, 10, 18]))
  end subroutine expect_product

  !> Generous, for machines under load: it takes 0.06 s on one that is idle
  subroutine test_speed(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: count = 1000000
    type(expression_t) :: expression
    real(wp), allocatable :: x(:), values(:)
    integer(int64) :: start, finish, rate
    integer :: k

    call compile('sin(pi*x)*sin(pi*y)*exp(-2*pi^2*t)', expression, error)
    if (allocated(error)) return
    allocate (x(count), values(count))
    do k = 1, count
      x(k) = real(k, wp)/count
    end do
    call system_clock(start, rate)
    call expression%evaluate(x, x, 0.0_wp, values)
    call system_clock(finish)
    call check(error, real(finish - start, wp)/real(rate, wp) < 1.0_wp)
    if (allocated(error)) return
    call check(error, sum(values)/count, 0.5_wp, thr=1.0e-9_wp)
  end subroutine test_speed

end module test_expression
