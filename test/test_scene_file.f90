!> Tests of `calor_scene_file` and `calor_scene_getters`.
module test_scene_file
  use calor_choice, only: choice_t
  use calor_error, only: error_t, status_bad_input
  use calor_expression, only: expression_t
  use calor_kinds, only: wp
  use calor_scene_file, only: scene_file_t, group_t, read_scene_file, parse_scene_text, &
      kind_text, kind_word, kind_logical, kind_whole, kind_real
  use calor_scene_getters, only: get, get_choice, get_choices, get_expression, get_varying, &
      place_of
  use calor_text, only: text_t, join
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_scene_file

  character(len=1), parameter :: lf = achar(10), cr = achar(13), tab = achar(9)

  type(choice_t), parameter :: choices(*) = [choice_t('brookshaw', ''), &
      choice_t('fatehi_manzari', ''), choice_t('double_gradient', '')]

contains

  subroutine collect_scene_file(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('groups, keys and values', test_groups), &
                new_unittest('places', test_places), &
                new_unittest('kinds of values', test_kinds), &
                new_unittest('texts and quotes', test_texts), &
                new_unittest('comments and separators', test_separators), &
                new_unittest('line ends and byte order mark', test_line_ends), &
                new_unittest('repeat counts', test_repeats), &
                new_unittest('every syntax error has its message', test_syntax_errors), &
                new_unittest('a text without quotes', test_unquoted), &
                new_unittest('no plain text', test_binary), &
                new_unittest('large files', test_large), &
                new_unittest('files', test_files), &
                new_unittest('numbers', test_numbers), &
                new_unittest('bounds', test_bounds), &
                new_unittest('lists of numbers', test_lists), &
                new_unittest('whole numbers', test_whole_numbers), &
                new_unittest('logical values', test_logicals), &
                new_unittest('texts from groups', test_get_texts), &
                new_unittest('choices', test_choices), &
                new_unittest('expressions', test_expressions), &
                new_unittest('missing keys and groups', test_missing) &
                ]
  end subroutine collect_scene_file

  !> Parse what must be right
  subroutine parse(text, scene, error)
    character(len=*), intent(in) :: text
    type(scene_file_t), intent(out) :: scene
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure

    call parse_scene_text(text, 'a.nml', scene, failure)
    if (allocated(failure)) call test_failed(error, failure%message)
  end subroutine parse

  !> The only group of a text that must be right
  subroutine parse_group(text, group, error)
    character(len=*), intent(in) :: text
    type(group_t), intent(out) :: group
    type(error_type), allocatable, intent(out) :: error
    type(scene_file_t) :: scene

    call parse(text, scene, error)
    if (allocated(error)) return
    group = scene%groups(1)
  end subroutine parse_group

  !> Expect an error whose message begins, or contains, so
  subroutine expect(failure, message, error)
    type(error_t), allocatable, intent(in) :: failure
    character(len=*), intent(in) :: message
    type(error_type), allocatable, intent(out) :: error

    call check(error, allocated(failure), 'no error where this was expected: '//message)
    if (allocated(error)) return
    call check(error, failure%status, status_bad_input)
    if (allocated(error)) return
    call check(error, index(failure%message, message) > 0, failure%message//' / '//message)
  end subroutine expect

  subroutine test_groups(error)
    type(error_type), allocatable, intent(out) :: error
    type(scene_file_t) :: scene
    type(group_t) :: group
    character(len=*), parameter :: text = &
        '&Domain Shape = ''Rectangle'' X_RANGE = 0.0, 1.0 y_range=0 1/'//lf// &
        '&boundary on = ''left'' value = 1 / &boundary on = ''right'', value = 2, /'//lf//'&time/'

    call parse(text, scene, error)
    if (allocated(error)) return
    call check(error, scene%text == text .and. scene%path == 'a.nml')
    if (allocated(error)) return
    call check(error, size(scene%groups), 4)
    if (allocated(error)) return
    call check(error, scene%count('boundary'), 2)
    if (allocated(error)) return
    call check(error, scene%groups(1)%name, 'domain')
    if (allocated(error)) return
    call check(error, scene%groups(1)%entries(1)%key, 'shape')
    if (allocated(error)) return
    call check(error, scene%groups(1)%entries(1)%values(1)%text, 'Rectangle')
    if (allocated(error)) return
    call check(error, size(scene%groups(1)%entries(3)%values), 2)
    if (allocated(error)) return
    call scene%group('boundary', group, number=2)
    call check(error, group%entries(2)%values(1)%text, '2')
    if (allocated(error)) return
    call check(error, group%has('on') .and. .not. group%has('kind'))
    if (allocated(error)) return
    call scene%group('boundary', group, number=3)
    call check(error, group%line == 0 .and. size(group%entries) == 0)
    if (allocated(error)) return
    call scene%group('time', group)
    call check(error, group%line, 3)
    if (allocated(error)) return
    call parse('', scene, error)
    if (allocated(error)) return
    call check(error, size(scene%groups), 0)
  end subroutine test_groups

  subroutine test_places(error)
    type(error_type), allocatable, intent(out) :: error
    type(scene_file_t) :: scene

    call parse('! a comment'//lf//lf//'  &a k = ''ä'' 2'//lf//tab//'long_key'//lf//'= 3,'//lf// &
               '     4 /'//lf//'&b/', scene, error)
    if (allocated(error)) return
    call check(error, scene%groups(1)%line, 3)
    if (allocated(error)) return
    associate (entry => scene%groups(1)%entries(1))
      call check(error, all([entry%line, entry%column] == [3, 6]))
      if (allocated(error)) return
      call check(error, all([entry%values%line, entry%values%column] == [3, 3, 10, 14]))
      if (allocated(error)) return
    end associate
    associate (entry => scene%groups(1)%entries(2))
      call check(error, all([entry%line, entry%column] == [4, 2]))
      if (allocated(error)) return
      call check(error, all([entry%values%line, entry%values%column] == [5, 6, 3, 6]))
      if (allocated(error)) return
    end associate
    call check(error, scene%groups(2)%line, 7)
  end subroutine test_places

  subroutine test_kinds(error)
    type(error_type), allocatable, intent(out) :: error
    type(group_t) :: group
    integer :: k

    call parse_group('&a whole = 1 -2 +3 007'//lf// &
                     'real = 1. .5 -1.5 +1e5 1.d-3 1.E+5 2D2 0.0'//lf// &
                     'logical = .true. .FALSE. T f .T. .f. true False'//lf// &
                     'word = abc 1e 1.e+ . - + .e5 1d-3x nan inf 1.2.3 --1 .yes. 0x1f'//lf// &
                     'text = ''1'' ".true." ''''/', group, error)
    if (allocated(error)) return
    do k = 1, size(group%entries)
      associate (entry => group%entries(k))
        select case (entry%key)
        case ('whole')
          call check(error, all(entry%values%kind == kind_whole))
        case ('real')
          call check(error, all(entry%values%kind == kind_real))
        case ('logical')
          call check(error, all(entry%values%kind == kind_logical))
        case ('word')
          call check(error, all(entry%values%kind == kind_word))
        case default
          call check(error, all(entry%values%kind == kind_text))
        end select
        if (allocated(error)) return
      end associate
    end do
    call check(error, k == 6)
  end subroutine test_kinds

  subroutine test_texts(error)
    type(error_type), allocatable, intent(out) :: error
    type(group_t) :: group
    type(text_t), allocatable :: texts(:)
    type(error_t), allocatable :: failure

    call parse_group('&a k = ''it''''s'', "a ""b"" c", ''a ! & / = "b"'' '''' """" ''  x '''// &
                     ' ''Ä''/', group, error)
    if (allocated(error)) return
    call get(group, 'k', texts, failure)
    call check(error, join(texts, '|'), 'it''s|a "b" c|a ! & / = "b"||"|  x |Ä')
  end subroutine test_texts

  subroutine test_separators(error)
    type(error_type), allocatable, intent(out) :: error
    type(scene_file_t) :: scene
    type(group_t) :: group
    real(wp), allocatable :: values(:)
    type(error_t), allocatable :: failure

    call parse('! &no = 1 /'//lf//'&a!'//lf//'k=1,2 ! , 3 / '''//lf//',3'//tab//'4 ! m = 2'//lf// &
               '! l = 3'//lf//'5'//lf//'t = 1, 6 t2 !'//lf//' = 7, u=8/! end'//lf// &
               '  ! & nothing', scene, error)
    if (allocated(error)) return
    group = scene%groups(1)
    call get(group, 'k', values, failure)
    call check(error, all(nint(values) == [1, 2, 3, 4, 5]))
    if (allocated(error)) return
    call get(group, 't', values, failure)
    call check(error, all(nint(values) == [1, 6]))
    if (allocated(error)) return
    call check(error, group%has('t2') .and. group%has('u') .and. size(group%entries) == 4)
  end subroutine test_separators

  subroutine test_line_ends(error)
    type(error_type), allocatable, intent(out) :: error
    type(scene_file_t) :: scene

    call parse(char(239)//char(187)//char(191)//'&a k = 1'//cr//lf//'! x'//cr//lf// &
               'l = 2'//cr//lf//'/'//cr//lf//'&b /'//cr//lf, scene, error)
    if (allocated(error)) return
    call check(error, scene%groups(1)%entries(1)%column, 4)
    if (allocated(error)) return
    call check(error, scene%groups(1)%entries(2)%line, 3)
    if (allocated(error)) return
    call check(error, scene%groups(2)%line, 5)
    if (allocated(error)) return
    call parse('&a k = 1'//cr//'l = 2'//cr//'/ &b /', scene, error)
    if (allocated(error)) return
    call check(error, scene%groups(2)%line, 3)
  end subroutine test_line_ends

  subroutine test_repeats(error)
    type(error_type), allocatable, intent(out) :: error
    type(group_t) :: group
    type(text_t), allocatable :: texts(:)
    real(wp), allocatable :: values(:)
    type(error_t), allocatable :: failure

    call parse_group('&a k = 2*1.5, 3*-2 1*0, t = 2*''x''/', group, error)
    if (allocated(error)) return
    call get(group, 'k', values, failure)
    call check(error, all(nint(2*values) == [3, 3, -4, -4, -4, 0]))
    if (allocated(error)) return
    call get(group, 't', texts, failure)
    call check(error, join(texts, '|'), 'x|x')
    if (allocated(error)) return
    call expect_syntax_error('&a k = 0*1 /', 'the repeat count 0 is not between', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = 999999999999*1 /', 'is not between 1 and 100000', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = 3* /', 'a value was expected', error)
  end subroutine test_repeats

  subroutine test_syntax_errors(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_syntax_error('&a k = 1'//lf//'&b /', 'a.nml, line 1: &a begins here, but there '// &
                             'is no ''/'' to end it before ''&b /'' in line 2.', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = 1'//lf, 'before the end of the file in line 2.', error)
    if (allocated(error)) return
    call expect_syntax_error('&a', 'line 1: &a begins here', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k =', 'a.nml, line 1: &a k has no value.', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = 1 &end', 'before ''&end'' in line 1', error)
    if (allocated(error)) return
    call expect_syntax_error(lf//' domain', 'a.nml, line 2, column 2: this stands outside of '// &
                             'any group: ''domain''.', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = 1 /'//lf//'l = 2', 'the last one, &a, ended before', error)
    if (allocated(error)) return
    call expect_syntax_error('& a /', 'line 1, column 1: a group begins with', error)
    if (allocated(error)) return
    call expect_syntax_error('&a=3 /', 'line 1, column 1: a group begins with', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = 1'//lf//'  k2 = 1'//lf//' K = 2 /', &
                             'a.nml, line 3: &a k is given twice, in line 1 and in line 3; '// &
                             'remove one.', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = /', 'a.nml, line 1: &a k has no value.', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = , 1 /', 'column 8: &a k: a value is missing before', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = 1,, 2 /', 'column 10: &a k: a value is missing before', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = ''abc'//lf//''' /', 'column 8: &a k: the text that begins '// &
                             'with ''''abc'' has no closing quote in its line.', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = ''abc''''', 'has no closing quote', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k 3 /', 'column 6: in &a a ''='' was expected after ''k''', error)
    if (allocated(error)) return
    call expect_syntax_error('&a 3k = 3 /', 'a key or ''/'' was expected', error)
    if (allocated(error)) return
    call expect_syntax_error('&a = 3 /', 'column 4: in &a a key or ''/'' was expected', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k(2) = 3 /', '&a k: elements of a list cannot be set', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k == 3 /', 'column 7: &a k: a value was expected', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = 1;2 /', 'column 8: &a k: a comma or a blank is missing', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = ''a''"b" /', 'a comma or a blank is missing', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = $ /', 'a value was expected, found ''$ /''', error)
  end subroutine test_syntax_errors

  subroutine expect_syntax_error(text, message, error)
    character(len=*), intent(in) :: text, message
    type(error_type), allocatable, intent(out) :: error
    type(scene_file_t) :: scene
    type(error_t), allocatable :: failure

    call parse_scene_text(text, 'a.nml', scene, failure)
    call expect(failure, message, error)
    if (allocated(error)) return
    call check(error, scene%text == text .and. allocated(scene%groups))
  end subroutine expect_syntax_error

  subroutine test_unquoted(error)
    type(error_type), allocatable, intent(out) :: error
    type(group_t) :: group
    type(error_t), allocatable :: failure
    character(len=:), allocatable :: text

    call parse_group('&kernel name = wendland_c2 /', group, error)
    if (allocated(error)) return
    call get(group, 'name', text, failure)
    call expect(failure, 'a.nml, line 1: &kernel name = wendland_c2: expected a text in '// &
                'quotes, as in name = ''wendland_c2''.', error)
    if (allocated(error)) return
    call expect_syntax_error('&a k = sin(pi*x) /', 'column 8: &a k: texts and expressions '// &
                             'stand in quotes; found ''sin(pi*x) /''.', error)
    if (allocated(error)) return
    call expect_syntax_error('&a file = data/cloud.csv /', 'a text with ''/'' in it needs', error)
  end subroutine test_unquoted

  subroutine test_binary(error)
    type(error_type), allocatable, intent(out) :: error
    integer :: k

    call expect_syntax_error('&a'//lf//' k = '''//achar(0)//''' /', 'a.nml, line 2, column 7: '// &
                             'the file is not plain text: it has a byte 0 here.', error)
    if (allocated(error)) return
    call expect_syntax_error(achar(137)//'HDF'//cr//lf//achar(26), 'a byte 26 here', error)
    if (allocated(error)) return
    call expect_syntax_error('! '//achar(27)//'[31m', 'a byte 27 here', error)
    if (allocated(error)) return
    call expect_syntax_error(repeat(achar(255), 5), 'outside of any group', error)
    if (allocated(error)) return
    ! No byte at any place upsets the parser
    do k = 128, 255
      call expect_syntax_error('&a k = '//char(k)//' /', 'a value was expected', error)
      if (allocated(error)) return
    end do
  end subroutine test_binary

  subroutine test_large(error)
    type(error_type), allocatable, intent(out) :: error
    type(scene_file_t) :: scene
    type(group_t) :: group
    real(wp), allocatable :: values(:)
    type(error_t), allocatable :: failure

    call parse('&a k = '//repeat('1.5, ', 100000)//'/', scene, error)
    if (allocated(error)) return
    call scene%group('a', group)
    call get(group, 'k', values, failure)
    call check(error, size(values) == 100000 .and. abs(sum(values) - 150000.0_wp) < 1.0e-9_wp)
    if (allocated(error)) return
    call parse(repeat('! '//repeat('x', 1000)//lf, 3000)//repeat('&a k = 1 / ', 20000), scene, &
               error)
    if (allocated(error)) return
    call check(error, scene%count('a'), 20000)
    if (allocated(error)) return
    call check(error, scene%groups(20000)%line, 3001)
  end subroutine test_large

  subroutine test_files(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: path = 'build/test_scene_file.nml'
    type(scene_file_t) :: scene
    type(error_t), allocatable :: failure
    integer :: unit

    open (newunit=unit, file=path, access='stream', form='unformatted', status='replace')
    write (unit) '&a k = 1'//cr//lf//'/'
    close (unit)
    call read_scene_file(path, scene, failure)
    call check(error,.not. allocated(failure))
    if (allocated(error)) return
    call check(error, scene%text == '&a k = 1'//cr//lf//'/' .and. scene%path == path)
    if (allocated(error)) return

    call read_scene_file('build/test_scene_file', scene, failure)
    call expect(failure, 'there is no file build/test_scene_file. Did you mean '''//path//'''?', &
                error)
    if (allocated(error)) return
    open (newunit=unit, file=path)
    close (unit, status='delete')
    call read_scene_file(path, scene, failure)
    call expect(failure, 'there is no file '//path//'.', error)
    if (allocated(error)) return
    call read_scene_file('build', scene, failure)
    call expect(failure, 'build is a folder', error)
    if (allocated(error)) return
    call read_scene_file('', scene, failure)
    call expect(failure, 'its name is empty', error)
  end subroutine test_files

  subroutine test_numbers(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_number('1', 1.0_wp, error)
    if (allocated(error)) return
    call expect_number('-1.5e-3', -1.5e-3_wp, error)
    if (allocated(error)) return
    call expect_number('1d-3', 1.0e-3_wp, error)
    if (allocated(error)) return
    call expect_number('1.e5', 1.0e5_wp, error)
    if (allocated(error)) return
    call expect_number('+.5', 0.5_wp, error)
    if (allocated(error)) return
    call expect_number('0e99999999999', 0.0_wp, error)
    if (allocated(error)) return
    call expect_no_number('1e-99999999999', 'is too small', error)
    if (allocated(error)) return
    call expect_number(repeat('0', 400)//'1', 1.0_wp, error)
    if (allocated(error)) return
    call expect_number('1'//repeat('0', 400)//'e-400', 1.0_wp, error)
    if (allocated(error)) return
    call expect_number('0.'//repeat('0', 399)//'1e400', 1.0_wp, error)
    if (allocated(error)) return
    call expect_no_number('1e999', 'the number 1e999 is too large', error)
    if (allocated(error)) return
    call expect_no_number('-1e99999999999', 'is too large', error)
    if (allocated(error)) return
    call expect_no_number('1'//repeat('0', 400), 'is too large', error)
    if (allocated(error)) return
    call expect_no_number('NaN', '&a k = NaN: expected a finite number.', error)
    if (allocated(error)) return
    call expect_no_number('-Infinity', 'expected a finite number.', error)
    if (allocated(error)) return
    call expect_no_number('''abc''', 'a.nml, line 1: &a k = ''abc'': expected a number.', error)
    if (allocated(error)) return
    call expect_no_number('T', 'expected a number.', error)
    if (allocated(error)) return
    call expect_no_number('1, 2', '&a k = 1, 2: expected one number, found 2 values.', error)
  end subroutine test_numbers

  subroutine expect_number(text, expected, error)
    character(len=*), intent(in) :: text
    real(wp), intent(in) :: expected
    type(error_type), allocatable, intent(out) :: error
    type(group_t) :: group
    type(error_t), allocatable :: failure
    real(wp) :: value

    call parse_group('&a k = '//text//'/', group, error)
    if (allocated(error)) return
    call get(group, 'k', value, failure)
    if (allocated(failure)) then
      call test_failed(error, failure%message)
      return
    end if
    if (abs(expected) > 0.0_wp) then
      call check(error, value, expected, thr=1.0e-15_wp, rel=.true.)
    else
      call check(error, value, expected)
    end if
  end subroutine expect_number

  subroutine expect_no_number(text, message, error)
    character(len=*), intent(in) :: text, message
    type(error_type), allocatable, intent(out) :: error
    type(group_t) :: group
    type(error_t), allocatable :: failure
    real(wp) :: value

    call parse_group('&a k = '//text//'/', group, error)
    if (allocated(error)) return
    call get(group, 'k', value, failure)
    call expect(failure, message, error)
  end subroutine expect_no_number

  subroutine test_bounds(error)
    type(error_type), allocatable, intent(out) :: error
    type(group_t) :: group
    type(error_t), allocatable :: failure
    real(wp) :: value

    call parse_group('&a zero = 0'//lf//'minus = -1.5 half = 0.5 /', group, error)
    if (allocated(error)) return
    call get(group, 'zero', value, failure, positive=.true.)
    call expect(failure, 'a.nml, line 1: &a zero = 0: expected a number greater than 0.', error)
    if (allocated(error)) return
    call get(group, 'minus', value, failure, non_negative=.true.)
    call expect(failure, 'a.nml, line 2: &a minus = -1.5: expected a number that is not', error)
    if (allocated(error)) return
    call get(group, 'half', value, failure, minimum=1.2_wp)
    call expect(failure, 'expected at least 1.2.', error)
    if (allocated(error)) return
    call get(group, 'half', value, failure, maximum=0.4_wp)
    call expect(failure, 'expected at most 0.4.', error)
    if (allocated(error)) return
    call get(group, 'zero', value, failure, non_negative=.true., minimum=0.0_wp, maximum=0.0_wp)
    call check(error,.not. allocated(failure))
    if (allocated(error)) return
    call get(group, 'half', value, failure, positive=.true., minimum=0.5_wp, maximum=0.5_wp)
    call check(error, value, 0.5_wp)
  end subroutine test_bounds

  subroutine test_lists(error)
    type(error_type), allocatable, intent(out) :: error
    type(group_t) :: group
    type(error_t), allocatable :: failure
    real(wp), allocatable :: values(:)

    call parse_group('&a up = 0, 1.5 down = 3 2 bad = 1, ''x'' /', group, error)
    if (allocated(error)) return
    call get(group, 'up', values, failure, count=2, increasing=.true.)
    call check(error, all(nint(2*values) == [0, 3]))
    if (allocated(error)) return
    call get(group, 'up', values, failure, count=3)
    call expect(failure, '&a up = 0, 1.5: expected 3 numbers, found 2.', error)
    if (allocated(error)) return
    call get(group, 'down', values, failure, increasing=.true.)
    call expect(failure, '2 is not greater than 3.', error)
    if (allocated(error)) return
    call get(group, 'up', values, failure, positive=.true.)
    call expect(failure, 'greater than 0.', error)
    if (allocated(error)) return
    call get(group, 'bad', values, failure)
    call expect(failure, 'expected a number, found ''x'' in column 36.', error)
    if (allocated(error)) return
    call get(group, 'none', values, failure, default=[7.0_wp])
    call check(error, size(values) == 1 .and. nint(values(1)) == 7)
    if (allocated(error)) return
    call get(group, 'none', values, failure, count=2)
    call expect(failure, 'a.nml, line 1: &a lacks ''none'', which needs 2 numbers.', error)
  end subroutine test_lists

  subroutine test_whole_numbers(error)
    type(error_type), allocatable, intent(out) :: error
    type(group_t) :: group
    type(error_t), allocatable :: failure
    integer :: value

    call parse_group('&a k = -42 real = 4.0 large = 3000000000 two = 1 2 /', group, error)
    if (allocated(error)) return
    call get(group, 'k', value, failure)
    call check(error, value, -42)
    if (allocated(error)) return
    call get(group, 'k', value, failure, minimum=1)
    call expect(failure, '&a k = -42: expected at least 1.', error)
    if (allocated(error)) return
    call get(group, 'k', value, failure, maximum=-100)
    call expect(failure, 'expected at most -100.', error)
    if (allocated(error)) return
    call get(group, 'real', value, failure)
    call expect(failure, '&a real = 4.0: expected a whole number, as in real = 1.', error)
    if (allocated(error)) return
    call get(group, 'large', value, failure)
    call expect(failure, 'the number is too large; the greatest is 2147483647.', error)
    if (allocated(error)) return
    call get(group, 'two', value, failure)
    call expect(failure, 'expected one whole number, found 2 values.', error)
    if (allocated(error)) return
    call get(group, 'none', value, failure, default=3)
    call check(error, value, 3)
  end subroutine test_whole_numbers

  subroutine test_logicals(error)
    type(error_type), allocatable, intent(out) :: error
    type(group_t) :: group
    type(error_t), allocatable :: failure
    logical :: value
    integer :: k

    call parse_group('&a a = T b = .true. c = .T. d = True e = f g = .FALSE. h = .f. i = FALSE /', &
                     group, error)
    if (allocated(error)) return
    do k = 1, 8
      call get(group, group%entries(k)%key, value, failure)
      call check(error,.not. allocated(failure) .and. (value .eqv. k <= 4))
      if (allocated(error)) return
    end do
    call parse_group('&a yes = yes one = 1 text = ''.true.'' /', group, error)
    if (allocated(error)) return
    do k = 1, 3
      call get(group, group%entries(k)%key, value, failure)
      call expect(failure, 'expected .true. or .false.', error)
      if (allocated(error)) return
    end do
    call get(group, 'none', value, failure, default=.true.)
    call check(error, value)
  end subroutine test_logicals

  subroutine test_get_texts(error)
    type(error_type), allocatable, intent(out) :: error
    type(group_t) :: group
    type(error_t), allocatable :: failure
    character(len=:), allocatable :: text
    type(text_t), allocatable :: texts(:)
    type(text_t) :: defaults(1)

    call parse_group('&a k = ''a b'' blank = '' '' many = ''x'', ''y'' mixed = ''x'' 3'//lf// &
                     'long = '''//repeat('ä', 100)//''' /', group, error)
    if (allocated(error)) return
    call get(group, 'k', text, failure)
    call check(error, text, 'a b')
    if (allocated(error)) return
    call get(group, 'blank', text, failure, not_blank=.true.)
    call expect(failure, 'the text must not be blank', error)
    if (allocated(error)) return
    call get(group, 'many', text, failure)
    call expect(failure, '&a many = ''x'', ''y'': expected one text in quotes, found 2 ', error)
    if (allocated(error)) return
    call get(group, 'mixed', texts, failure)
    call expect(failure, 'expected a text in quotes, as in mixed = ''3''.', error)
    if (allocated(error)) return
    defaults(1)%value = 'z'
    call get(group, 'none', texts, failure, default=defaults)
    call check(error, join(texts, '|'), 'z')
    if (allocated(error)) return
    ! A quotation is cut between characters
    call check(error, place_of(group, 'long'), 'a.nml, line 2: &a long = '''// &
               repeat('ä', 28)//'...')
  end subroutine test_get_texts

  subroutine test_choices(error)
    type(error_type), allocatable, intent(out) :: error
    type(group_t) :: group
    type(error_t), allocatable :: failure
    character(len=:), allocatable :: name
    type(text_t), allocatable :: names(:)

    call parse_group('&a good = ''brookshaw'' bad = ''brokshaw'' case = ''Brookshaw'''// &
                     lf//' all = ''all'' two = ''double_gradient'', ''brookshaw'''// &
                     ' twice = 2*''brookshaw'' /', &
                     group, error)
    if (allocated(error)) return
    call get_choice(group, 'good', choices, name, failure)
    call check(error, name, 'brookshaw')
    if (allocated(error)) return
    call get_choice(group, 'bad', choices, name, failure)
    call expect(failure, 'a.nml, line 1: &a bad = ''brokshaw'': there is no ''brokshaw'' to '// &
                'choose. Did you mean ''brookshaw''?'//lf//'There are: brookshaw, '// &
                'fatehi_manzari, double_gradient.', error)
    if (allocated(error)) return
    call get_choice(group, 'case', choices, name, failure)
    call expect(failure, 'Did you mean ''brookshaw''?', error)
    if (allocated(error)) return
    call get_choice(group, 'none', choices, name, failure, default='brookshaw')
    call check(error, name, 'brookshaw')
    if (allocated(error)) return
    call get_choices(group, 'all', choices, names, failure)
    call check(error, join(names, ' '), 'brookshaw fatehi_manzari double_gradient')
    if (allocated(error)) return
    call get_choices(group, 'two', choices, names, failure)
    call check(error, join(names, ' '), 'double_gradient brookshaw')
    if (allocated(error)) return
    call get_choices(group, 'twice', choices, names, failure)
    call expect(failure, '''brookshaw'' is there twice', error)
    if (allocated(error)) return
    call get_choices(group, 'bad', choices, names, failure)
    call expect(failure, 'Did you mean ''brookshaw''?', error)
  end subroutine test_choices

  subroutine test_expressions(error)
    type(error_type), allocatable, intent(out) :: error
    type(group_t) :: group
    type(error_t), allocatable :: failure
    type(expression_t) :: expression
    real(wp) :: value

    call parse_group('&a k_expression = ''2*x'' n = -1.5e-7 bad_expression = ''x*'''//lf// &
                     'b = 1 b_expression = ''1'' /', group, error)
    if (allocated(error)) return
    call get_expression(group, 'k_expression', expression, failure)
    call check(error, expression%source(), '2*x')
    if (allocated(error)) return
    call get_expression(group, 'bad_expression', expression, failure)
    call expect(failure, 'a.nml, line 1: &a bad_expression: the expression ''x*'' is wrong at '// &
                'position 3: it ends too early.', error)
    if (allocated(error)) return
    call get_varying(group, 'k', expression, failure)
    call check(error, expression%source(), '2*x')
    if (allocated(error)) return
    call get_varying(group, 'n', expression, failure)
    call expression%evaluate(1.0_wp, 1.0_wp, 1.0_wp, value)
    call check(error, value, -1.5e-7_wp)
    if (allocated(error)) return
    call get_varying(group, 'b', expression, failure)
    call expect(failure, 'a.nml, line 2: &a b_expression = ''1'': give either this or b, not', &
                error)
    if (allocated(error)) return
    call get_varying(group, 'none', expression, failure, default=3.0_wp)
    call check(error, expression%source(), '3')
    if (allocated(error)) return
    call get_varying(group, 'none', expression, failure)
    call expect(failure, 'lacks ''none'', which needs a number (or none_expression).', error)
  end subroutine test_expressions

  subroutine test_missing(error)
    type(error_type), allocatable, intent(out) :: error
    type(scene_file_t) :: scene
    type(group_t) :: group
    type(error_t), allocatable :: failure
    real(wp) :: value

    call parse(lf//'&domain /', scene, error)
    if (allocated(error)) return
    call scene%group('domain', group)
    call get(group, 'spacing', value, failure)
    call expect(failure, 'a.nml, line 2: &domain lacks ''spacing'', which needs a number.', error)
    if (allocated(error)) return
    call scene%group('time', group)
    call get(group, 'end', value, failure)
    call expect(failure, 'a.nml: there is no group &time; it is needed, with ''end''.', error)
    if (allocated(error)) return
    call get(group, 'end', value, failure, default=2.0_wp)
    call check(error, value, 2.0_wp)
  end subroutine test_missing

end module test_scene_file
