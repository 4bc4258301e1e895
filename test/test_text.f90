!> Tests of `calor_text`.
module test_text
  use calor_kinds, only: wp
  use calor_text, only: to_text, lower_case, nearest_word, text_list, join
  use testdrive, only: new_unittest, unittest_type, error_type, check
  implicit none (type, external)
  private

  public :: collect_text

contains

  subroutine collect_text(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('numbers as text', test_numbers), &
                new_unittest('nearest word', test_nearest_word) &
                ]
  end subroutine collect_text

  subroutine test_numbers(error)
    type(error_type), allocatable, intent(out) :: error

    call check(error, to_text(0.1_wp), '0.1')
    if (allocated(error)) return
    call check(error, to_text(-1234.5_wp), '-1234.5')
    if (allocated(error)) return
    call check(error, to_text(0.0_wp), '0')
    if (allocated(error)) return
    call check(error, to_text(2.0e-9_wp), '2e-9')
    if (allocated(error)) return
    call check(error, to_text(1.0_wp/3.0_wp, digits=3), '0.333')
    if (allocated(error)) return
    call check(error, to_text(100000.0_wp), '100000')
    if (allocated(error)) return
    call check(error, to_text(42), '42')
  end subroutine test_numbers

  subroutine test_nearest_word(error)
    type(error_type), allocatable, intent(out) :: error

    call check(error, nearest_word('Spacng', text_list([character(9) :: 'support', 'spacing'])), &
               'spacing')
    if (allocated(error)) return
    call check(error, nearest_word('zzzzzz', text_list([character(9) :: 'support', 'spacing'])), '')
    if (allocated(error)) return
    call check(error, nearest_word('fatehi', text_list([character(len=14) :: 'brookshaw', &
                                                        'fatehi_manzari'])), 'fatehi_manzari')
    if (allocated(error)) return
    call check(error, join(text_list(['a', 'b']), ', '), 'a, b')
    if (allocated(error)) return
    call check(error, lower_case('AbZ'), 'abz')
  end subroutine test_nearest_word

end module test_text
