!> Tests of the random numbers.
module test_random
  use calor_kinds, only: wp, i8
  use calor_random, only: random_uniform, random_words
  use calor_text, only: to_text
  use testdrive, only: new_unittest, unittest_type, error_type, check
  implicit none (type, external)
  private

  public :: collect_random

contains

  subroutine collect_random(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('published values of Philox2x32-10', test_published), &
                new_unittest('first numbers never change', test_first_numbers), &
                new_unittest('moments', test_moments), &
                new_unittest('even over the unit interval', test_even), &
                new_unittest('neighbouring counters and seeds are unrelated', test_unrelated), &
                new_unittest('the order of drawing does not matter', test_order) &
                ]
  end subroutine collect_random

  !> The known answers that the generator's authors publish with it.
  subroutine test_published(error)
    type(error_type), allocatable, intent(out) :: error
    integer(i8) :: first, second

    call random_words(0, 0_i8, first, second)
    call check(error, first == int(z'ff1dae59', i8) .and. second == int(z'6cd10df2', i8))
    if (allocated(error)) return
    call random_words(-1, -1_i8, first, second)
    call check(error, first == int(z'2c3f628b', i8) .and. second == int(z'ab4fd7ad', i8))
    if (allocated(error)) return
    call random_words(int(z'13198a2e'), int(z'85a308d3243f6a88', i8), first, second)
    call check(error, first == int(z'dd7ce038', i8) .and. second == int(z'f62a4c12', i8))
  end subroutine test_published

  subroutine test_first_numbers(error)
    type(error_type), allocatable, intent(out) :: error

    call check(error, random_uniform(1, 0_i8), 0.57591741982984379_wp, thr=1.0e-16_wp)
    if (allocated(error)) return
    call check(error, random_uniform(1, 1_i8), 0.87315667070395597_wp, thr=1.0e-16_wp)
    if (allocated(error)) return
    call check(error, random_uniform(2, 0_i8), 0.10381040869200442_wp, thr=1.0e-16_wp)
  end subroutine test_first_numbers

  subroutine test_moments(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: draws = 200000
    real(wp), allocatable :: number(:)
    integer :: k, power

    number = random_uniform(42, [(int(k, i8), k=1, draws)])
    call check(error, all(number >= 0) .and. all(number < 1), 'outside of [0, 1)')
    if (allocated(error)) return
    ! Four standard deviations of the mean are below 0.003
    do power = 1, 5
      call check(error, sum(number**power)/draws, 1/(power + 1.0_wp), thr=0.003_wp, &
                 more='moment '//to_text(power))
      if (allocated(error)) return
    end do
  end subroutine test_moments

  subroutine test_even(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: draws = 100000, bins = 100
    integer :: bin, counts(bins), k
    real(wp) :: chi_squared

    counts = 0
    do k = 1, draws
      bin = 1 + int(bins*random_uniform(7, int(k, i8)))
      counts(bin) = counts(bin) + 1
    end do
    chi_squared = sum((counts - draws/bins)**2/real(draws/bins, wp))
    ! 99 degrees of freedom: outside of these bounds once in some 10⁵ generators
    call check(error, chi_squared > 50 .and. chi_squared < 165, to_text(chi_squared))
  end subroutine test_even

  subroutine test_unrelated(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: draws = 100000
    real(wp), allocatable :: number(:), other(:)
    integer :: k

    number = random_uniform(3, [(int(k, i8), k=1, draws)]) - 0.5_wp
    other = random_uniform(3, [(int(k + 1, i8), k=1, draws)]) - 0.5_wp
    call check(error, abs(12*sum(number*other)/draws) < 0.015_wp, 'counters correlate')
    if (allocated(error)) return
    other = random_uniform(4, [(int(k, i8), k=1, draws)]) - 0.5_wp
    call check(error, abs(12*sum(number*other)/draws) < 0.015_wp, 'seeds correlate')
    if (allocated(error)) return
    other = random_uniform(3, [(k*2_i8**32, k=1, draws)]) - 0.5_wp
    call check(error, abs(12*sum(number*other)/draws) < 0.015_wp, 'high counters correlate')
  end subroutine test_unrelated

  subroutine test_order(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: backward(100), forward(100)
    integer :: k

    do k = 1, 100
      forward(k) = random_uniform(5, int(k, i8))
    end do
    do k = 100, 1, -1
      backward(k) = random_uniform(5, int(k, i8))
    end do
    call check(error, all(abs(forward - backward) <= 0))
  end subroutine test_order

end module test_random
