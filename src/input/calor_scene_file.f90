!> A scene file as groups, keys and values, each with its place in the file.
!>
!> The file is a Fortran namelist: `&group key = value, value ... /`. It is read here and not by the
!> runtime's NAMELIST statement, because that cannot tell where in the file something is wrong.
!> Stricter than Fortran in four things that hide mistakes: a text ends on its own line, a value may
!> not be left out between commas, a key may stand only once in a group, and outside of groups there
!> may be nothing but comments.
module calor_scene_file
  use calor_error, only: error_t, raise, status_bad_input
  use calor_text, only: lower_case, to_text
  use calor_text_file, only: read_text_file
  implicit none (type, external)
  private

  public :: scene_file_t, group_t, entry_t, value_t
  public :: read_scene_file, parse_scene_text
  public :: kind_text, kind_word, kind_logical, kind_whole, kind_real

  !> Kinds of values. A text in quotes
  integer, parameter :: kind_text = 1
  !> Something without quotes that is neither logical nor a number
  integer, parameter :: kind_word = 2
  !> `.true.`, `.false.`, `T`, `F` and the like
  integer, parameter :: kind_logical = 3
  !> A whole number
  integer, parameter :: kind_whole = 4
  !> A number with a decimal point or an exponent
  integer, parameter :: kind_real = 5

  !> One value
  type :: value_t
    !> One of the `kind_...` constants
    integer :: kind = kind_word
    !> The value as written; for a text what stands between the quotes, doubled quotes made single
    character(len=:), allocatable :: text
    !> Its line, counted from 1
    integer :: line = 0
    !> Its column, counted in characters from 1
    integer :: column = 0
  end type value_t

  !> One key with its values
  type :: entry_t
    !> The key in lower case
    character(len=:), allocatable :: key
    !> The line of the key, counted from 1
    integer :: line = 0
    !> The column of the key, counted in characters from 1
    integer :: column = 0
    !> The values, at least one; repeat counts are written out
    type(value_t), allocatable :: values(:)
  end type entry_t

  !> One group. A group that the file does not have is one with line 0 and no entries.
  type :: group_t
    !> The file, as it shall be called in messages
    character(len=:), allocatable :: path
    !> The name in lower case, without '&'
    character(len=:), allocatable :: name
    !> The line where it begins, counted from 1
    integer :: line = 0
    !> Its entries in the order of the file
    type(entry_t), allocatable :: entries(:)
  contains
    !> The position of a key in `entries`, 0 if the group lacks it
    procedure :: find => find_entry
    !> Whether the key is given
    procedure :: has => has_entry
  end type group_t

  !> A scene file
  type :: scene_file_t
    !> The file, as it shall be called in messages
    character(len=:), allocatable :: path
    !> The whole text of the file, unchanged
    character(len=:), allocatable :: text
    !> Its groups in the order of the file
    type(group_t), allocatable :: groups(:)
  contains
    !> How many groups of a name there are
    procedure :: count => count_groups
    !> A group by name, or an empty group with line 0
    procedure :: group => find_group
  end type scene_file_t

  !> Where reading has got to
  type :: cursor_t
    integer :: at = 1
    integer :: line = 1
    integer :: column = 1
  end type cursor_t

  character(len=1), parameter :: tab = achar(9), line_feed = achar(10), carriage_return = achar(13)
  character(len=*), parameter :: letters = &
      'abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_', digits = '0123456789'
  character(len=3), parameter :: byte_order_mark = char(239)//char(187)//char(191)

  !> More keys than this in a group cannot be meant
  integer, parameter :: most_entries = 1000
  !> More repetitions than this cannot be meant either
  integer, parameter :: most_repeats = 100000

contains

  !> Read and parse a scene file.
  subroutine read_scene_file(path, scene, error)
    !> The file
    character(len=*), intent(in) :: path
    !> What it holds
    type(scene_file_t), intent(out) :: scene
    !> There is no such file, it cannot be read, or it is no scene (see `parse_scene_text`)
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: text

    call read_text_file(path, text, error)
    if (allocated(error)) return
    call parse_scene_text(text, path, scene, error)
  end subroutine read_scene_file

  !> Parse the text of a scene file.
  subroutine parse_scene_text(text, name, scene, error)
    !> The whole text, lines parted by LF, CR LF or CR
    character(len=*), intent(in) :: text
    !> What to call the text in messages
    character(len=*), intent(in) :: name
    !> What it holds
    type(scene_file_t), intent(out) :: scene
    !> The text is no namelist; the message tells the line and the column
    type(error_t), allocatable, intent(out) :: error
    type(group_t), allocatable :: groups(:)
    type(cursor_t) :: cursor
    character(len=:), allocatable :: last
    integer :: count

    scene%path = name
    scene%text = text
    allocate (scene%groups(0))
    call check_bytes(text, name, error)
    if (allocated(error)) return

    allocate (groups(8))
    count = 0
    if (len(text) >= 3) then
      if (text(:3) == byte_order_mark) cursor%at = 4
    end if
    do
      call skip_blank(text, cursor)
      if (cursor%at > len(text)) exit
      if (text(cursor%at:cursor%at) /= '&') then
        last = ''
        if (count > 0) last = '; the last one, &'//groups(count)%name//', ended before it'
        call complain(name, cursor, 'this stands outside of any group: '// &
                      quoted_line(text, cursor%at)//'. A group begins with ''&'' and ends with '// &
                      '''/'''//last//' (a text with ''/'' in it needs quotes).', error)
        return
      end if
      if (count == size(groups)) call resize_groups(groups, 2*count, count)
      count = count + 1
      call read_group(text, name, cursor, groups(count), error)
      if (allocated(error)) return
    end do
    call resize_groups(groups, count, count)
    call move_alloc(groups, scene%groups)
  end subroutine parse_scene_text

  !> How many groups of that name the file has.
  pure function count_groups(self, name) result(count)
    !> The scene file
    class(scene_file_t), intent(in) :: self
    !> The name in lower case
    character(len=*), intent(in) :: name
    integer :: count
    integer :: k

    count = 0
    do k = 1, size(self%groups)
      if (self%groups(k)%name == name) count = count + 1
    end do
  end function count_groups

  !> Hand out a group by its name. If the file has none, the group has line 0 and no entries, so
  !> that defaults can be taken from it as from any other.
  pure subroutine find_group(self, name, group, number)
    !> The scene file
    class(scene_file_t), intent(in) :: self
    !> The name in lower case
    character(len=*), intent(in) :: name
    !> The group
    type(group_t), intent(out) :: group
    !> Which of the groups of that name; the first if absent
    integer, intent(in), optional :: number
    integer :: k, wanted

    wanted = 1
    if (present(number)) wanted = number
    do k = 1, size(self%groups)
      if (self%groups(k)%name /= name) cycle
      wanted = wanted - 1
      if (wanted > 0) cycle
      group = self%groups(k)
      return
    end do
    group%path = self%path
    group%name = name
    allocate (group%entries(0))
  end subroutine find_group

  !> The position of a key among the entries, 0 if it is not given.
  pure function find_entry(self, key) result(position)
    !> The group
    class(group_t), intent(in) :: self
    !> The key in lower case
    character(len=*), intent(in) :: key
    integer :: position

    do position = 1, size(self%entries)
      if (self%entries(position)%key == key) return
    end do
    position = 0
  end function find_entry

  !> Whether the key is given.
  pure function has_entry(self, key)
    !> The group
    class(group_t), intent(in) :: self
    !> The key in lower case
    character(len=*), intent(in) :: key
    logical :: has_entry

    has_entry = self%find(key) > 0
  end function has_entry

  !> Read a group; the cursor stands on its '&'.
  subroutine read_group(text, path, cursor, group, error)
    character(len=*), intent(in) :: text, path
    type(cursor_t), intent(inout) :: cursor
    type(group_t), intent(out) :: group
    type(error_t), allocatable, intent(out) :: error
    type(entry_t), allocatable :: entries(:)
    type(cursor_t) :: start
    integer :: count, earlier

    start = cursor
    group%path = path
    group%line = cursor%line
    call advance(text, cursor)
    group%name = lower_case(read_name(text, cursor))
    if (group%name == '' .or. .not. at_separator(text, cursor)) then
      call complain(path, start, 'a group begins with ''&'' and its name, as in &domain; found '// &
                    quoted_line(text, start%at)//'.', error)
      return
    end if

    allocate (entries(8))
    count = 0
    do
      call skip_blank(text, cursor)
      if (next(text, cursor) == '/') exit
      if (cursor%at > len(text) .or. next(text, cursor) == '&') then
        call complain_unclosed(text, cursor, group, error)
        return
      end if
      if (count == most_entries) then
        call complain(path, cursor, '&'//group%name//' has more than '//to_text(most_entries)// &
                      ' keys.', error)
        return
      end if
      if (count == size(entries)) call resize_entries(entries, 2*count, count)
      count = count + 1
      call read_entry(text, group, cursor, entries(count), error)
      if (allocated(error)) return
      do earlier = 1, count - 1
        if (entries(earlier)%key /= entries(count)%key) cycle
        call raise(error, status_bad_input, path//', line '//to_text(entries(count)%line)// &
                   ': &'//group%name//' '//entries(count)%key//' is given twice, in line '// &
                   to_text(entries(earlier)%line)//' and in line '// &
                   to_text(entries(count)%line)//'; remove one.')
        return
      end do
    end do
    call advance(text, cursor)
    call resize_entries(entries, count, count)
    call move_alloc(entries, group%entries)
  end subroutine read_group

  !> Read a key and its values.
  subroutine read_entry(text, group, cursor, entry, error)
    character(len=*), intent(in) :: text
    type(group_t), intent(in) :: group
    type(cursor_t), intent(inout) :: cursor
    type(entry_t), intent(out) :: entry
    type(error_t), allocatable, intent(out) :: error

    entry%line = cursor%line
    entry%column = cursor%column
    entry%key = lower_case(read_name(text, cursor))
    if (entry%key == '' .or. scan(entry%key(:min(1, len(entry%key))), digits) > 0) then
      call complain(group%path, cursor, 'in &'//group%name// &
                    ' a key or ''/'' was expected, found '// &
                    quoted_line(text, cursor%at)//'.', error)
      return
    end if
    if (scan(next(text, cursor), '(%') > 0) then
      call complain(group%path, cursor, '&'//group%name//' '//entry%key//': elements of a list '// &
                    'cannot be set one by one; write '//entry%key//' = and all values.', error)
      return
    end if
    call skip_blank(text, cursor)
    if (next(text, cursor) /= '=') then
      call complain(group%path, cursor, 'in &'//group%name//' a ''='' was expected after '''// &
                    entry%key//''' (texts stand in quotes).', error)
      return
    end if
    call advance(text, cursor)
    call read_values(text, group, cursor, entry, error)
  end subroutine read_entry

  !> Read values up to the next key or the end of the group.
  subroutine read_values(text, group, cursor, entry, error)
    character(len=*), intent(in) :: text
    type(group_t), intent(in) :: group
    type(cursor_t), intent(inout) :: cursor
    type(entry_t), intent(inout) :: entry
    type(error_t), allocatable, intent(out) :: error
    type(value_t), allocatable :: values(:)
    type(value_t) :: value
    type(cursor_t) :: start
    character(len=:), allocatable :: reason
    logical :: wants_value
    integer :: count, repeats, k

    allocate (values(4))
    count = 0
    wants_value = .true.
    do
      call skip_blank(text, cursor)
      if (cursor%at > len(text)) exit
      if (scan(next(text, cursor), '/&') > 0) exit
      if (next(text, cursor) == ',') then
        if (wants_value) then
          call complain(group%path, cursor, '&'//group%name//' '//entry%key// &
                        ': a value is missing before the comma.', error)
          return
        end if
        wants_value = .true.
        call advance(text, cursor)
        cycle
      end if
      if (at_key(text, cursor)) exit
      start = cursor
      call read_value(text, cursor, value, repeats, reason)
      if (allocated(reason)) then
        call complain(group%path, start, '&'//group%name//' '//entry%key//': '//reason, error)
        return
      end if
      do k = 1, repeats
        if (count == size(values)) call resize_values(values, 2*count, count)
        count = count + 1
        values(count)%kind = value%kind
        values(count)%text = value%text
        values(count)%line = value%line
        values(count)%column = value%column
      end do
      wants_value = .false.
    end do
    if (count == 0) then
      call raise(error, status_bad_input, group%path//', line '//to_text(entry%line)//': &'// &
                 group%name//' '//entry%key//' has no value.')
      return
    end if
    call resize_values(values, count, count)
    call move_alloc(values, entry%values)
  end subroutine read_values

  !> Read one value, with a repeat count before it or not.
  subroutine read_value(text, cursor, value, repeats, reason)
    character(len=*), intent(in) :: text
    type(cursor_t), intent(inout) :: cursor
    type(value_t), intent(out) :: value
    integer, intent(out) :: repeats
    !> What is wrong, if something is
    character(len=:), allocatable, intent(out) :: reason
    character(len=:), allocatable :: word
    integer :: status

    repeats = 1
    value%line = cursor%line
    value%column = cursor%column
    word = read_word(text, cursor)
    if (next(text, cursor) == '*' .and. len(word) > 0 .and. verify(word, digits) == 0) then
      read (word, *, iostat=status) repeats
      if (status /= 0 .or. len(word) > 9) repeats = most_repeats + 1
      if (repeats < 1 .or. repeats > most_repeats) then
        reason = 'the repeat count '//shortened(word)//' is not between 1 and '// &
                 to_text(most_repeats)//'.'
        return
      end if
      call advance(text, cursor)
      word = read_word(text, cursor)
    end if
    if (len(word) > 0) then
      value%kind = kind_of(word)
      value%text = word
      if (scan(next(text, cursor), '(*%') > 0) then
        reason = 'texts and expressions stand in quotes; found '//quoted_line(text, cursor%at - &
                                                                              len(word))//'.'
        return
      end if
    else if (scan(next(text, cursor), '''"') > 0) then
      value%kind = kind_text
      call read_quoted(text, cursor, value%text, reason)
      if (allocated(reason)) return
    end if
    if (.not. allocated(value%text)) then
      reason = 'a value was expected, found '//quoted_line(text, cursor%at)//'.'
    else if (.not. at_separator(text, cursor)) then
      reason = 'a comma or a blank is missing between two values, before '// &
               quoted_line(text, cursor%at)//'.'
    end if
  end subroutine read_value

  !> Read a text in quotes; the cursor stands on the first quote.
  subroutine read_quoted(text, cursor, content, reason)
    character(len=*), intent(in) :: text
    type(cursor_t), intent(inout) :: cursor
    character(len=:), allocatable, intent(out) :: content
    character(len=:), allocatable, intent(out) :: reason
    character(len=1) :: quote
    integer :: first, last, length

    quote = next(text, cursor)
    first = cursor%at + 1
    ! Find the end first, so that the text is copied once
    last = first
    do
      if (last > len(text)) exit
      if (scan(text(last:last), line_feed//carriage_return) > 0) exit
      if (text(last:last) == quote) then
        if (last == len(text)) exit
        if (text(last + 1:last + 1) /= quote) exit
        last = last + 1
      end if
      last = last + 1
    end do
    if (last > len(text)) then
      reason = 'x'
    else if (text(last:last) /= quote) then
      reason = 'x'
    end if
    if (allocated(reason)) then
      reason = 'the text that begins with '//quoted_line(text, cursor%at)// &
               ' has no closing quote in its line.'
      return
    end if

    allocate (character(len=last - first) :: content)
    length = 0
    do
      call advance(text, cursor)
      if (cursor%at >= last) exit
      length = length + 1
      content(length:length) = text(cursor%at:cursor%at)
      if (text(cursor%at:cursor%at) == quote) call advance(text, cursor)
    end do
    call advance(text, cursor)
    content = content(:length)
  end subroutine read_quoted

  !> Whether a key and '=' come next.
  pure function at_key(text, cursor)
    character(len=*), intent(in) :: text
    type(cursor_t), intent(in) :: cursor
    logical :: at_key
    type(cursor_t) :: ahead
    character(len=1) :: first

    at_key = .false.
    first = next(text, cursor)
    if (scan(first, letters) == 0) return
    ahead = cursor
    call skip_name(text, ahead)
    call skip_blank(text, ahead)
    at_key = next(text, ahead) == '='
  end function at_key

  !> The kind of a value that is written without quotes.
  pure function kind_of(word) result(kind)
    character(len=*), intent(in) :: word
    integer :: kind
    integer :: at, whole_digits, fraction_digits, exponent_digits

    if (len(word) <= 7) then
      select case (lower_case(word))
      case ('.true.', '.false.', 'true', 'false', '.t.', '.f.', 't', 'f')
        kind = kind_logical
        return
      case default
        continue
      end select
    end if

    kind = kind_word
    at = 1
    if (scan(word(1:1), '+-') > 0) at = 2
    call skip_digits(word, at, whole_digits)
    if (at > len(word)) then
      if (whole_digits > 0) kind = kind_whole
      return
    end if
    fraction_digits = 0
    if (word(at:at) == '.') then
      at = at + 1
      call skip_digits(word, at, fraction_digits)
    end if
    if (whole_digits + fraction_digits == 0) return
    if (at > len(word)) then
      kind = kind_real
      return
    end if
    if (scan(word(at:at), 'eEdD') == 0) return
    at = at + 1
    if (at > len(word)) return
    if (scan(word(at:at), '+-') > 0) at = at + 1
    call skip_digits(word, at, exponent_digits)
    if (at > len(word) .and. exponent_digits > 0) kind = kind_real
  end function kind_of

  pure subroutine skip_digits(word, at, count)
    character(len=*), intent(in) :: word
    integer, intent(inout) :: at
    integer, intent(out) :: count

    count = 0
    do while (at <= len(word))
      if (scan(word(at:at), digits) == 0) exit
      at = at + 1
      count = count + 1
    end do
  end subroutine skip_digits

  !> Read letters, digits and underscores; '' if there are none.
  function read_name(text, cursor) result(name)
    character(len=*), intent(in) :: text
    type(cursor_t), intent(inout) :: cursor
    character(len=:), allocatable :: name
    integer :: first

    first = cursor%at
    call skip_name(text, cursor)
    name = text(first:cursor%at - 1)
  end function read_name

  pure subroutine skip_name(text, cursor)
    character(len=*), intent(in) :: text
    type(cursor_t), intent(inout) :: cursor

    do while (scan(next(text, cursor), letters//digits) > 0)
      call advance(text, cursor)
    end do
  end subroutine skip_name

  !> Read what a number, a logical value or a forgotten text may consist of; '' if there is none.
  function read_word(text, cursor) result(word)
    character(len=*), intent(in) :: text
    type(cursor_t), intent(inout) :: cursor
    character(len=:), allocatable :: word
    integer :: first

    first = cursor%at
    do while (scan(next(text, cursor), letters//digits//'+-.:') > 0)
      call advance(text, cursor)
    end do
    word = text(first:cursor%at - 1)
  end function read_word

  !> Pass over blanks, ends of lines and comments.
  pure subroutine skip_blank(text, cursor)
    character(len=*), intent(in) :: text
    type(cursor_t), intent(inout) :: cursor

    do while (cursor%at <= len(text))
      select case (text(cursor%at:cursor%at))
      case (' ', tab, line_feed, carriage_return)
        call advance(text, cursor)
      case ('!')
        do while (cursor%at <= len(text))
          if (scan(text(cursor%at:cursor%at), line_feed//carriage_return) > 0) exit
          call advance(text, cursor)
        end do
      case default
        return
      end select
    end do
  end subroutine skip_blank

  !> Go one byte on.
  pure subroutine advance(text, cursor)
    character(len=*), intent(in) :: text
    type(cursor_t), intent(inout) :: cursor
    character(len=1) :: byte

    byte = text(cursor%at:cursor%at)
    cursor%at = cursor%at + 1
    if (byte == line_feed .or. (byte == carriage_return .and. next(text, cursor) /= line_feed)) then
      cursor%line = cursor%line + 1
      cursor%column = 1
    else if (iand(ichar(next(text, cursor)), 192) /= 128) then
      ! The bytes of one character (UTF-8) share a column
      cursor%column = cursor%column + 1
    end if
  end subroutine advance

  !> The byte at the cursor, a line end behind the end of the text.
  pure function next(text, cursor) result(byte)
    character(len=*), intent(in) :: text
    type(cursor_t), intent(in) :: cursor
    character(len=1) :: byte

    byte = line_feed
    if (cursor%at <= len(text)) byte = text(cursor%at:cursor%at)
  end function next

  !> Whether something comes that ends a name or a value.
  pure function at_separator(text, cursor)
    character(len=*), intent(in) :: text
    type(cursor_t), intent(in) :: cursor
    logical :: at_separator

    at_separator = scan(next(text, cursor), ' ,/!&'//tab//line_feed//carriage_return) > 0
  end function at_separator

  !> What stands at a place, in quotes, up to the end of its line and not too much of it.
  pure function quoted_line(text, first) result(quoted)
    character(len=*), intent(in) :: text
    integer, intent(in) :: first
    character(len=:), allocatable :: quoted
    integer :: last

    if (first > len(text)) then
      quoted = 'the end of the file'
      return
    end if
    last = scan(text(first:), line_feed//carriage_return) - 1
    if (last < 0) last = len(text) - first + 1
    if (last == 0) then
      quoted = 'the end of the line'
    else
      quoted = ''''//shortened(trim(text(first:first + last - 1)))//''''
    end if
  end function quoted_line

  !> At most 40 bytes of a text, whole characters (UTF-8).
  pure function shortened(text) result(short)
    character(len=*), intent(in) :: text
    character(len=:), allocatable :: short
    integer, parameter :: longest = 40
    integer :: last

    if (len(text) <= longest) then
      short = text
      return
    end if
    last = longest - 3
    do while (last > 1 .and. iand(ichar(text(last + 1:last + 1)), 192) == 128)
      last = last - 1
    end do
    short = text(:last)//'...'
  end function shortened

  subroutine complain(path, cursor, message, error)
    character(len=*), intent(in) :: path
    type(cursor_t), intent(in) :: cursor
    character(len=*), intent(in) :: message
    type(error_t), allocatable, intent(out) :: error

    call raise(error, status_bad_input, path//', line '//to_text(cursor%line)//', column '// &
               to_text(cursor%column)//': '//message)
  end subroutine complain

  subroutine complain_unclosed(text, cursor, group, error)
    character(len=*), intent(in) :: text
    type(cursor_t), intent(in) :: cursor
    type(group_t), intent(in) :: group
    type(error_t), allocatable, intent(out) :: error

    call raise(error, status_bad_input, group%path//', line '//to_text(group%line)//': &'// &
               group%name//' begins here, but there is no ''/'' to end it before '// &
               quoted_line(text, cursor%at)//' in line '//to_text(cursor%line)//'.')
  end subroutine complain_unclosed

  !> Refuse what is no text file, before anything of it gets into a message.
  subroutine check_bytes(text, path, error)
    character(len=*), intent(in) :: text, path
    type(error_t), allocatable, intent(out) :: error
    type(cursor_t) :: cursor

    do while (cursor%at <= len(text))
      select case (ichar(text(cursor%at:cursor%at)))
      case (0:8, 11:12, 14:31, 127)
        call complain(path, cursor, 'the file is not plain text: it has a byte '// &
                      to_text(ichar(text(cursor%at:cursor%at)))// &
                      ' here. A scene is a text file in ASCII or UTF-8.', error)
        return
      case default
        call advance(text, cursor)
      end select
    end do
  end subroutine check_bytes

  !> Make room for `length` values, keeping the first `used`; their texts are moved, not copied.
  subroutine resize_values(values, length, used)
    type(value_t), allocatable, intent(inout) :: values(:)
    integer, intent(in) :: length, used
    type(value_t), allocatable :: resized(:)
    integer :: k

    allocate (resized(length))
    do k = 1, used
      resized(k)%kind = values(k)%kind
      resized(k)%line = values(k)%line
      resized(k)%column = values(k)%column
      call move_alloc(values(k)%text, resized(k)%text)
    end do
    call move_alloc(resized, values)
  end subroutine resize_values

  subroutine resize_entries(entries, length, used)
    type(entry_t), allocatable, intent(inout) :: entries(:)
    integer, intent(in) :: length, used
    type(entry_t), allocatable :: resized(:)
    integer :: k

    allocate (resized(length))
    do k = 1, used
      resized(k)%line = entries(k)%line
      resized(k)%column = entries(k)%column
      call move_alloc(entries(k)%key, resized(k)%key)
      call move_alloc(entries(k)%values, resized(k)%values)
    end do
    call move_alloc(resized, entries)
  end subroutine resize_entries

  subroutine resize_groups(groups, length, used)
    type(group_t), allocatable, intent(inout) :: groups(:)
    integer, intent(in) :: length, used
    type(group_t), allocatable :: resized(:)
    integer :: k

    allocate (resized(length))
    do k = 1, used
      resized(k)%line = groups(k)%line
      call move_alloc(groups(k)%path, resized(k)%path)
      call move_alloc(groups(k)%name, resized(k)%name)
      call move_alloc(groups(k)%entries, resized(k)%entries)
    end do
    call move_alloc(resized, groups)
  end subroutine resize_groups

end module calor_scene_file
