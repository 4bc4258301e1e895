!> Values of a scene's groups as Fortran values, checked.
!>
!> Every message names the file, the line, the group, the key and what stands there, and says what
!> was expected. A group that the file lacks is an empty one (see `calor_scene_file`), so defaults
!> come from it as from any other.
module calor_scene_getters
  use calor_choice, only: choice_t, choice_names
  use calor_constants, only: greatest_size, least_size
  use calor_error, only: error_t, raise, status_bad_input
  use calor_expression, only: expression_t, compile_expression
  use calor_kinds, only: wp
  use calor_scene_file, only: group_t, entry_t, value_t, kind_text, kind_logical, kind_whole, &
      kind_real
  use calor_text, only: text_t, to_text, lower_case, join, suggestion
  implicit none (type, external)
  private

  public :: get, get_choice, get_choices, get_expression, get_varying
  public :: place_of, place_without_value, raise_at

  !> Get the value of a key. If the group lacks the key, the default is handed out; without a
  !> default that is an error. The value's type decides what is expected.
  interface get
    module procedure get_real
    module procedure get_reals
    module procedure get_integer
    module procedure get_logical
    module procedure get_text
    module procedure get_texts
  end interface get

  !> What `decimal_exponent` says of 0
  integer, parameter :: exponent_of_zero = -huge(1)

contains

  !> A number; a whole number will do.
  subroutine get_real(group, key, value, error, default, positive, non_negative, minimum, maximum)
    !> The group
    type(group_t), intent(in) :: group
    !> The key in lower case
    character(len=*), intent(in) :: key
    !> The value
    real(wp), intent(out) :: value
    !> It is missing, no single finite number, or out of bounds
    type(error_t), allocatable, intent(out) :: error
    !> The value if the key is not given
    real(wp), intent(in), optional :: default
    !> Whether it must be greater than zero
    logical, intent(in), optional :: positive
    !> Whether it must not be less than zero
    logical, intent(in), optional :: non_negative
    !> The least that is allowed
    real(wp), intent(in), optional :: minimum
    !> The greatest that is allowed
    real(wp), intent(in), optional :: maximum
    integer :: position

    value = 0.0_wp
    position = group%find(key)
    if (position == 0) then
      if (present(default)) then
        value = default
      else
        call raise_missing(group, key, 'a number', error)
      end if
      return
    end if
    call expect_one(group, group%entries(position), 'one number', error)
    if (allocated(error)) return
    call to_real(group, group%entries(position), 1, value, error)
    if (allocated(error)) return
    call check_bounds(group, key, value, error, positive, non_negative, minimum, maximum)
  end subroutine get_real

  !> A list of numbers.
  subroutine get_reals(group, key, values, error, default, count, positive, non_negative, &
                       minimum, maximum, increasing)
    !> The group
    type(group_t), intent(in) :: group
    !> The key in lower case
    character(len=*), intent(in) :: key
    !> The values
    real(wp), allocatable, intent(out) :: values(:)
    !> It is missing, not so many finite numbers, or out of bounds
    type(error_t), allocatable, intent(out) :: error
    !> The values if the key is not given
    real(wp), intent(in), optional :: default(:)
    !> How many there must be
    integer, intent(in), optional :: count
    !> Whether each must be greater than zero
    logical, intent(in), optional :: positive
    !> Whether none may be less than zero
    logical, intent(in), optional :: non_negative
    !> The least that is allowed
    real(wp), intent(in), optional :: minimum
    !> The greatest that is allowed
    real(wp), intent(in), optional :: maximum
    !> Whether each must be greater than the one before it
    logical, intent(in), optional :: increasing
    character(len=:), allocatable :: expected
    integer :: position, k, found

    position = group%find(key)
    expected = 'numbers'
    if (present(count)) expected = to_text(count)//' numbers'
    if (position == 0) then
      if (present(default)) then
        values = default
      else
        allocate (values(0))
        call raise_missing(group, key, expected, error)
      end if
      return
    end if
    associate (entry => group%entries(position))
      found = size(entry%values)
      allocate (values(found), source=0.0_wp)
      if (present(count)) then
        if (found /= count) then
          call raise_at(error, group, key, 'expected '//expected//', found '//to_text(found)//'.')
          return
        end if
      end if
      do k = 1, found
        call to_real(group, entry, k, values(k), error)
        if (allocated(error)) return
        call check_bounds(group, key, values(k), error, positive, non_negative, minimum, maximum)
        if (allocated(error)) return
      end do
    end associate
    if (.not. present(increasing)) return
    if (.not. increasing) return
    do k = 2, found
      if (values(k) > values(k - 1)) cycle
      call raise_at(error, group, key, 'expected each number to be greater than the one '// &
                    'before it; '//to_text(values(k))//' is not greater than '// &
                    to_text(values(k - 1))//'.')
      return
    end do
  end subroutine get_reals

  !> A whole number.
  subroutine get_integer(group, key, value, error, default, minimum, maximum)
    !> The group
    type(group_t), intent(in) :: group
    !> The key in lower case
    character(len=*), intent(in) :: key
    !> The value
    integer, intent(out) :: value
    !> It is missing, no single whole number, or out of bounds
    type(error_t), allocatable, intent(out) :: error
    !> The value if the key is not given
    integer, intent(in), optional :: default
    !> The least that is allowed
    integer, intent(in), optional :: minimum
    !> The greatest that is allowed
    integer, intent(in), optional :: maximum
    integer :: position, status

    value = 0
    position = group%find(key)
    if (position == 0) then
      if (present(default)) then
        value = default
      else
        call raise_missing(group, key, 'a whole number', error)
      end if
      return
    end if
    associate (entry => group%entries(position))
      call expect_one(group, entry, 'one whole number', error)
      if (allocated(error)) return
      if (entry%values(1)%kind /= kind_whole) then
        call raise_at(error, group, key, 'expected a whole number, as in '//key//' = 1.')
        return
      end if
      read (entry%values(1)%text, *, iostat=status) value
      if (status /= 0) then
        call raise_at(error, group, key, 'the number is too large; the greatest is '// &
                      to_text(huge(value))//'.')
        return
      end if
    end associate
    if (present(minimum)) then
      if (value < minimum) then
        call raise_at(error, group, key, 'expected at least '//to_text(minimum)//'.')
        return
      end if
    end if
    if (present(maximum)) then
      if (value > maximum) then
        call raise_at(error, group, key, 'expected at most '//to_text(maximum)//'.')
      end if
    end if
  end subroutine get_integer

  !> `.true.` or `.false.`
  subroutine get_logical(group, key, value, error, default)
    !> The group
    type(group_t), intent(in) :: group
    !> The key in lower case
    character(len=*), intent(in) :: key
    !> The value
    logical, intent(out) :: value
    !> It is missing, or neither true nor false
    type(error_t), allocatable, intent(out) :: error
    !> The value if the key is not given
    logical, intent(in), optional :: default
    integer :: position

    value = .false.
    position = group%find(key)
    if (position == 0) then
      if (present(default)) then
        value = default
      else
        call raise_missing(group, key, '.true. or .false.', error)
      end if
      return
    end if
    associate (entry => group%entries(position))
      call expect_one(group, entry, '.true. or .false.', error)
      if (allocated(error)) return
      if (entry%values(1)%kind /= kind_logical) then
        call raise_at(error, group, key, 'expected .true. or .false.')
        return
      end if
      ! No spelling of false has a t
      value = scan(entry%values(1)%text, 'tT') > 0
    end associate
  end subroutine get_logical

  !> A text in quotes.
  subroutine get_text(group, key, value, error, default, not_blank)
    !> The group
    type(group_t), intent(in) :: group
    !> The key in lower case
    character(len=*), intent(in) :: key
    !> The value
    character(len=:), allocatable, intent(out) :: value
    !> It is missing, no single text, or blank though it must not be
    type(error_t), allocatable, intent(out) :: error
    !> The value if the key is not given
    character(len=*), intent(in), optional :: default
    !> Whether it must not be blank
    logical, intent(in), optional :: not_blank
    integer :: position

    value = ''
    position = group%find(key)
    if (position == 0) then
      if (present(default)) then
        value = default
      else
        call raise_missing(group, key, 'a text in quotes', error)
      end if
      return
    end if
    call expect_one(group, group%entries(position), 'one text in quotes', error)
    if (allocated(error)) return
    call expect_text(group, group%entries(position), 1, error)
    if (allocated(error)) return
    value = group%entries(position)%values(1)%text
    if (.not. present(not_blank)) return
    if (not_blank .and. value == '') call raise_at(error, group, key, 'the text must not be blank.')
  end subroutine get_text

  !> A list of texts in quotes.
  subroutine get_texts(group, key, values, error, default)
    !> The group
    type(group_t), intent(in) :: group
    !> The key in lower case
    character(len=*), intent(in) :: key
    !> The values
    type(text_t), allocatable, intent(out) :: values(:)
    !> It is missing, or something in it is no text
    type(error_t), allocatable, intent(out) :: error
    !> The values if the key is not given
    type(text_t), intent(in), optional :: default(:)
    integer :: position, k

    position = group%find(key)
    if (position == 0) then
      if (present(default)) then
        allocate (values(size(default)))
        do k = 1, size(default)
          values(k)%value = default(k)%value
        end do
      else
        allocate (values(0))
        call raise_missing(group, key, 'texts in quotes', error)
      end if
      return
    end if
    associate (entry => group%entries(position))
      allocate (values(size(entry%values)))
      do k = 1, size(entry%values)
        values(k)%value = entry%values(k)%text
        call expect_text(group, entry, k, error)
        if (allocated(error)) return
      end do
    end associate
  end subroutine get_texts

  !> One name from a table of choices.
  subroutine get_choice(group, key, choices, value, error, default)
    !> The group
    type(group_t), intent(in) :: group
    !> The key in lower case
    character(len=*), intent(in) :: key
    !> What there is to choose from
    type(choice_t), intent(in) :: choices(:)
    !> The name that was chosen
    character(len=:), allocatable, intent(out) :: value
    !> It is missing, no text, or not in the table
    type(error_t), allocatable, intent(out) :: error
    !> The name if the key is not given
    character(len=*), intent(in), optional :: default

    call get_text(group, key, value, error, default)
    if (allocated(error)) return
    call expect_choice(group, key, choices, value, error)
  end subroutine get_choice

  !> Several names from a table of choices; 'all' stands for every one of them.
  subroutine get_choices(group, key, choices, values, error, default)
    !> The group
    type(group_t), intent(in) :: group
    !> The key in lower case
    character(len=*), intent(in) :: key
    !> What there is to choose from
    type(choice_t), intent(in) :: choices(:)
    !> The names that were chosen, each once, in the order of the file
    type(text_t), allocatable, intent(out) :: values(:)
    !> It is missing, no texts, or something is not in the table or there twice
    type(error_t), allocatable, intent(out) :: error
    !> The names if the key is not given
    type(text_t), intent(in), optional :: default(:)
    integer :: k, earlier

    call get_texts(group, key, values, error, default)
    if (allocated(error)) return
    if (size(values) == 1) then
      if (values(1)%value == 'all') then
        values = choice_names(choices)
        return
      end if
    end if
    do k = 1, size(values)
      call expect_choice(group, key, choices, values(k)%value, error)
      if (allocated(error)) return
      do earlier = 1, k - 1
        if (values(earlier)%value /= values(k)%value) cycle
        call raise_at(error, group, key, ''''//values(k)%value//''' is there twice; remove one.')
        return
      end do
    end do
  end subroutine get_choices

  !> An expression, compiled.
  subroutine get_expression(group, key, expression, error, default)
    !> The group
    type(group_t), intent(in) :: group
    !> The key in lower case
    character(len=*), intent(in) :: key
    !> The compiled expression
    type(expression_t), intent(inout) :: expression
    !> It is missing, no text, or muParser cannot read it
    type(error_t), allocatable, intent(out) :: error
    !> The expression if the key is not given
    character(len=*), intent(in), optional :: default
    type(error_t), allocatable :: failure
    character(len=:), allocatable :: text

    call get_text(group, key, text, error, default)
    if (allocated(error)) return
    call compile_expression(text, expression, failure)
    if (.not. allocated(failure)) return
    call raise(error, status_bad_input, place_without_value(group, key)//': '//failure%message)
  end subroutine get_expression

  !> What may vary: `key = number` or `key_expression = 'expression'`, as an expression.
  subroutine get_varying(group, key, expression, error, default)
    !> The group
    type(group_t), intent(in) :: group
    !> The key in lower case, without `_expression`
    character(len=*), intent(in) :: key
    !> The compiled expression; for a number it is a constant
    type(expression_t), intent(inout) :: expression
    !> Both are missing or given, or the one that is given is wrong
    type(error_t), allocatable, intent(out) :: error
    !> The value if neither is given
    real(wp), intent(in), optional :: default
    real(wp) :: value

    if (group%has(key) .and. group%has(key//'_expression')) then
      call raise_at(error, group, key//'_expression', 'give either this or '//key//', not both.')
    else if (group%has(key//'_expression')) then
      call get_expression(group, key//'_expression', expression, error)
    else if (group%has(key) .or. present(default)) then
      call get_real(group, key, value, error, default)
      if (.not. allocated(error)) call compile_expression(to_text(value), expression, error)
    else
      call raise_missing(group, key, 'a number (or '//key//'_expression)', error)
    end if
  end subroutine get_varying

  !> Where a key stands and what it says, as messages begin:
  !> `data/plate.nml, line 7: &domain spacing = 'abc'`.
  pure function place_of(group, key) result(place)
    !> The group
    type(group_t), intent(in) :: group
    !> The key in lower case; '' for the group as a whole
    character(len=*), intent(in) :: key
    character(len=:), allocatable :: place
    integer :: position

    place = place_without_value(group, key)
    position = group%find(key)
    if (position > 0) place = place//' = '//values_as_text(group%entries(position)%values)
  end function place_of

  !> Make an error about a key: its place and a message.
  pure subroutine raise_at(error, group, key, message)
    !> The error to be made
    type(error_t), allocatable, intent(out) :: error
    !> The group
    type(group_t), intent(in) :: group
    !> The key in lower case; '' for the group as a whole
    character(len=*), intent(in) :: key
    !> What is wrong and what was expected
    character(len=*), intent(in) :: message

    call raise(error, status_bad_input, place_of(group, key)//': '//message)
  end subroutine raise_at

  !> Where a key stands: `data/plate.nml, line 7: &domain spacing`.
  pure function place_without_value(group, key) result(place)
    !> The group
    type(group_t), intent(in) :: group
    !> The key in lower case; '' for the group as a whole
    character(len=*), intent(in) :: key
    character(len=:), allocatable :: place
    integer :: position, line

    position = group%find(key)
    line = group%line
    if (position > 0) line = group%entries(position)%line
    place = group%path
    if (line > 0) place = place//', line '//to_text(line)
    place = place//': &'//group%name
    if (position > 0) place = place//' '//in_short(key)
  end function place_without_value

  !> The beginning of a name that is too long for a message
  pure function in_short(name) result(text)
    character(len=*), intent(in) :: name
    character(len=:), allocatable :: text
    integer, parameter :: longest = 60

    text = name
    if (len(name) > longest) text = name(:longest - 3)//'...'
  end function in_short

  !> Values as they may stand in a scene, at most 60 characters of them.
  pure function values_as_text(values) result(text)
    type(value_t), intent(in) :: values(:)
    character(len=:), allocatable :: text
    integer, parameter :: longest = 60
    integer :: k, last

    text = ''
    do k = 1, size(values)
      if (k > 1) text = text//', '
      if (values(k)%kind == kind_text) then
        text = text//''''//values(k)%text//''''
      else
        text = text//values(k)%text
      end if
      if (len(text) > longest) exit
    end do
    if (len(text) <= longest) return
    last = longest - 3
    ! Not within a character (UTF-8)
    do while (last > 1 .and. iand(ichar(text(last + 1:last + 1)), 192) == 128)
      last = last - 1
    end do
    text = text(:last)//'...'
  end function values_as_text

  subroutine raise_missing(group, key, expected, error)
    type(group_t), intent(in) :: group
    character(len=*), intent(in) :: key, expected
    type(error_t), allocatable, intent(out) :: error

    if (group%line > 0) then
      call raise(error, status_bad_input, place_without_value(group, '')//' lacks '''//key// &
                 ''', which needs '//expected//'.')
    else
      call raise(error, status_bad_input, group%path//': there is no group &'//group%name// &
                 '; it is needed, with '''//key//'''.')
    end if
  end subroutine raise_missing

  subroutine expect_one(group, entry, expected, error)
    type(group_t), intent(in) :: group
    type(entry_t), intent(in) :: entry
    character(len=*), intent(in) :: expected
    type(error_t), allocatable, intent(out) :: error

    if (size(entry%values) == 1) return
    call raise_at(error, group, entry%key, 'expected '//expected//', found '// &
                  to_text(size(entry%values))//' values.'//decimal_point(entry))
  end subroutine expect_one

  !> A remedy where 0,025 may stand for 0.025.
  pure function decimal_point(entry) result(sentence)
    type(entry_t), intent(in) :: entry
    !> ' ' and the sentence, or ''
    character(len=:), allocatable :: sentence

    sentence = ''
    if (size(entry%values) /= 2) return
    if (any(entry%values%kind /= kind_whole)) return
    if (verify(entry%values(2)%text, '0123456789') /= 0) return
    sentence = ' Decimals have a point: '//entry%values(1)%text//'.'//entry%values(2)%text//'.'
  end function decimal_point

  subroutine expect_text(group, entry, number, error)
    type(group_t), intent(in) :: group
    type(entry_t), intent(in) :: entry
    integer, intent(in) :: number
    type(error_t), allocatable, intent(out) :: error

    associate (value => entry%values(number))
      if (value%kind == kind_text) return
      call raise_at(error, group, entry%key, 'expected a text in quotes, as in '//entry%key// &
                    ' = '''//value%text//'''.')
    end associate
  end subroutine expect_text

  subroutine expect_choice(group, key, choices, name, error)
    type(group_t), intent(in) :: group
    character(len=*), intent(in) :: key
    type(choice_t), intent(in) :: choices(:)
    character(len=*), intent(in) :: name
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    do k = 1, size(choices)
      if (choices(k)%name == name) return
    end do
    call raise_at(error, group, key, 'there is no '''//name//''' to choose.'// &
                  suggestion(name, choice_names(choices))//new_line('a')// &
                  'There are: '//join(choice_names(choices), ', ')//'.')
  end subroutine expect_choice

  !> One of the values of an entry as a finite number.
  subroutine to_real(group, entry, number, value, error)
    type(group_t), intent(in) :: group
    type(entry_t), intent(in) :: entry
    integer, intent(in) :: number
    real(wp), intent(out) :: value
    type(error_t), allocatable, intent(out) :: error
    integer :: exponent, status

    value = 0.0_wp
    associate (text => entry%values(number)%text)
      if (all(entry%values(number)%kind /= [kind_whole, kind_real])) then
        if (is_not_finite(text)) then
          call raise_at(error, group, entry%key, 'expected a finite number.')
        else
          call raise_at(error, group, entry%key, 'expected a number'//found_instead(entry, number))
        end if
        return
      end if
      exponent = decimal_exponent(text)
      ! The runtime would raise floating-point exceptions beyond these
      value = merge(2*greatest_size, 0.5_wp*least_size, exponent > 307)
      status = 0
      if (abs(exponent) <= 307) read (text, *, iostat=status) value
      if (exponent == exponent_of_zero) value = 0
      if (status /= 0) then
        call raise_at(error, group, entry%key, 'the number cannot be read.')
      else if (abs(value) > greatest_size) then
        call raise_at(error, group, entry%key, 'the number '//text(:min(len(text), 40))// &
                      ' is too large; the greatest is '//to_text(greatest_size)//'.')
      else if (abs(value) > 0 .and. abs(value) < least_size) then
        call raise_at(error, group, entry%key, 'the number '//text(:min(len(text), 40))// &
                      ' is too small; give 0 or at least '//to_text(least_size)//'.')
      end if
    end associate
  end subroutine to_real

  !> In a list, which of the values it is.
  pure function found_instead(entry, number) result(words)
    type(entry_t), intent(in) :: entry
    integer, intent(in) :: number
    character(len=:), allocatable :: words

    if (size(entry%values) == 1) then
      words = '.'
    else
      words = ', found '//values_as_text(entry%values(number:number))//' in column '// &
              to_text(entry%values(number)%column)//'.'
    end if
  end function found_instead

  !> Whether a word is one of Fortran's for NaN and infinity.
  pure function is_not_finite(word)
    character(len=*), intent(in) :: word
    logical :: is_not_finite
    character(len=:), allocatable :: bare

    bare = lower_case(word)
    if (len(bare) > 1) then
      if (scan(bare(1:1), '+-') > 0) bare = bare(2:)
    end if
    is_not_finite = bare == 'nan' .or. bare == 'inf' .or. bare == 'infinity'
  end function is_not_finite

  !> The power of ten of the first digit of a number that is not 0; for zero, a very small one.
  pure function decimal_exponent(number) result(exponent)
    character(len=*), intent(in) :: number
    integer :: exponent
    integer, parameter :: beyond_count = 1000000
    character(len=:), allocatable :: power
    integer :: mark, point, first, last, written, status

    mark = scan(number, 'eEdD')
    last = len(number)
    if (mark > 0) last = mark - 1
    first = scan(number(:last), '123456789')
    if (first == 0) then
      exponent = exponent_of_zero
      return
    end if
    point = scan(number(:last), '.')
    if (point == 0) point = last + 1
    exponent = point - first - 1
    if (point < first) exponent = point - first
    if (mark == 0) return

    power = number(mark + 1:)
    first = scan(power, '123456789')
    if (first == 0) return
    if (len(power) - first >= 7) then
      written = beyond_count
    else
      read (power(first:), *, iostat=status) written
      if (status /= 0) written = beyond_count
    end if
    if (power(1:1) == '-') written = -written
    exponent = exponent + written
  end function decimal_exponent

  subroutine check_bounds(group, key, value, error, positive, non_negative, minimum, maximum)
    type(group_t), intent(in) :: group
    character(len=*), intent(in) :: key
    real(wp), intent(in) :: value
    type(error_t), allocatable, intent(out) :: error
    logical, intent(in), optional :: positive, non_negative
    real(wp), intent(in), optional :: minimum, maximum

    if (present(positive)) then
      if (positive .and. value <= 0.0_wp) then
        call raise_at(error, group, key, 'expected a number greater than 0.')
        return
      end if
    end if
    if (present(non_negative)) then
      if (non_negative .and. value < 0.0_wp) then
        call raise_at(error, group, key, 'expected a number that is not negative.')
        return
      end if
    end if
    if (present(minimum)) then
      if (value < minimum) then
        call raise_at(error, group, key, 'expected at least '//to_text(minimum)//'.')
        return
      end if
    end if
    if (present(maximum)) then
      if (value > maximum) then
        call raise_at(error, group, key, 'expected at most '//to_text(maximum)//'.')
      end if
    end if
  end subroutine check_bounds

end module calor_scene_getters
