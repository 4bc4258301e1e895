!> Text: numbers as short text, lists, case, and the nearest known word.
module calor_text
  use calor_kinds, only: wp, i8
  implicit none (type, external)
  private

  public :: text_t, to_text, lower_case, join, nearest_word, suggestion, text_list, append

  !> A text of any length, for arrays of texts
  type :: text_t
    character(len=:), allocatable :: value
  end type text_t

  !> A number as the shortest customary text: `to_text(0.1_wp)` is '0.1', `to_text(12)` is '12'.
  !> With `digits`, that many significant digits.
  interface to_text
    module procedure integer_to_text
    module procedure long_to_text
    module procedure real_to_text
  end interface to_text

contains

  pure function integer_to_text(number) result(text)
    !> The number
    integer, intent(in) :: number
    character(len=:), allocatable :: text

    text = long_to_text(int(number, i8))
  end function integer_to_text

  pure function long_to_text(number) result(text)
    !> The number
    integer(i8), intent(in) :: number
    character(len=:), allocatable :: text
    character(len=24) :: buffer

    write (buffer, '(i0)') number
    text = trim(buffer)
  end function long_to_text

  pure function real_to_text(number, digits) result(text)
    !> The number
    real(wp), intent(in) :: number
    !> Significant digits; without it as many as the number needs to be read back unchanged
    integer, intent(in), optional :: digits
    character(len=:), allocatable :: text
    character(len=40) :: buffer
    character(len=12) :: form
    real(wp) :: back
    integer :: count, last, status

    if (present(digits)) then
      last = max(1, min(digits, 17))
      write (form, '(a,i0,a)') '(es40.', last - 1, 'e3)'
      write (buffer, form) number
    else
      do count = 1, 17
        write (form, '(a,i0,a)') '(es40.', count - 1, 'e3)'
        write (buffer, form) number
        read (buffer, *, iostat=status) back
        if (status == 0 .and. .not. abs(back - number) > 0.0_wp) exit
      end do
    end if
    text = plain_number(trim(adjustl(buffer)))
  end function real_to_text

  !> Rewrite 'd.ddE+eee' without an exponent where that is no longer than it needs to be.
  pure function plain_number(scientific) result(text)
    character(len=*), intent(in) :: scientific
    character(len=:), allocatable :: text
    character(len=:), allocatable :: digits, sign
    integer :: exponent, mark, status, start
    character(len=8) :: buffer

    mark = scan(scientific, 'E')
    if (mark == 0) then
      text = scientific
      return
    end if
    read (scientific(mark + 1:), *, iostat=status) exponent
    if (status /= 0) then
      text = scientific
      return
    end if
    sign = ''
    start = 1
    if (scientific(1:1) == '-') then
      sign = '-'
      start = 2
    end if
    digits = scientific(start:start)//scientific(start + 2:mark - 1)
    digits = without_trailing_zeros(digits)
    if (verify(digits, '0') == 0) then
      text = '0'
    else if (exponent >= 0 .and. exponent < 7) then
      if (len(digits) <= exponent + 1) then
        text = sign//digits//repeat('0', exponent + 1 - len(digits))
      else
        text = sign//digits(1:exponent + 1)//'.'//digits(exponent + 2:)
      end if
    else if (exponent < 0 .and. exponent >= -4) then
      text = sign//'0.'//repeat('0', -exponent - 1)//digits
    else
      text = sign//digits(1:1)
      if (len(digits) > 1) text = text//'.'//digits(2:)
      write (buffer, '(i0)') exponent
      text = text//'e'//trim(buffer)
    end if
  end function plain_number

  pure function without_trailing_zeros(digits) result(text)
    character(len=*), intent(in) :: digits
    character(len=:), allocatable :: text
    integer :: last

    last = len(digits)
    do while (last > 1)
      if (digits(last:last) /= '0') exit
      last = last - 1
    end do
    text = digits(1:last)
  end function without_trailing_zeros

  !> The text with the capitals A to Z made small.
  pure function lower_case(text) result(lowered)
    !> Any text
    character(len=*), intent(in) :: text
    character(len=len(text)) :: lowered
    integer :: k

    lowered = text
    do k = 1, len(text)
      if (text(k:k) >= 'A' .and. text(k:k) <= 'Z') lowered(k:k) = achar(iachar(text(k:k)) + 32)
    end do
  end function lower_case

  !> Build a list of texts from an array of blank-padded words.
  pure function text_list(words) result(list)
    !> Words, padded with blanks at the end
    character(len=*), intent(in) :: words(:)
    type(text_t) :: list(size(words))
    integer :: k

    do k = 1, size(words)
      list(k)%value = trim(words(k))
    end do
  end function text_list

  !> Put one more text at the end of a list.
  pure subroutine append(list, text)
    !> The list; not allocated, it becomes one of one text
    type(text_t), allocatable, intent(inout) :: list(:)
    !> The text
    character(len=*), intent(in) :: text
    type(text_t), allocatable :: longer(:)
    integer :: k, n

    n = 0
    if (allocated(list)) n = size(list)
    allocate (longer(n + 1))
    do k = 1, n
      call move_alloc(list(k)%value, longer(k)%value)
    end do
    longer(n + 1)%value = text
    call move_alloc(longer, list)
  end subroutine append

  !> The texts one after another with a separator between them.
  pure function join(texts, separator) result(joined)
    !> What is joined
    type(text_t), intent(in) :: texts(:)
    !> What goes between two of them
    character(len=*), intent(in) :: separator
    character(len=:), allocatable :: joined
    integer :: k

    joined = ''
    do k = 1, size(texts)
      if (k > 1) joined = joined//separator
      joined = joined//texts(k)%value
    end do
  end function join

  !> The known word with the fewest letters to change (Levenshtein distance), or '' if none is near.
  pure function nearest_word(word, known) result(nearest)
    !> What was written
    character(len=*), intent(in) :: word
    !> The words that could have been meant
    type(text_t), intent(in) :: known(:)
    character(len=:), allocatable :: nearest
    integer :: k, distance, least

    nearest = ''
    ! The beginning of a word is near to it, however much is missing.
    do k = 1, size(known)
      if (len(word) < 3 .or. nearest /= '') exit
      if (index(known(k)%value, lower_case(word)) == 1) nearest = known(k)%value
    end do
    if (nearest /= '') return
    least = max(2, len(word)/2) + 1
    do k = 1, size(known)
      distance = edit_distance(lower_case(word), known(k)%value)
      if (distance < least) then
        least = distance
        nearest = known(k)%value
      end if
    end do
  end function nearest_word

  !> ` Did you mean 'x'?` for the nearest known word, or '' if none is near.
  pure function suggestion(word, known) result(sentence)
    !> What was written
    character(len=*), intent(in) :: word
    !> The words that could have been meant
    type(text_t), intent(in) :: known(:)
    character(len=:), allocatable :: sentence

    sentence = nearest_word(word, known)
    if (sentence /= '') sentence = ' Did you mean '''//sentence//'''?'
  end function suggestion

  pure function edit_distance(a, b) result(distance)
    character(len=*), intent(in) :: a, b
    integer :: distance
    integer :: row(0:len(b)), previous(0:len(b))
    integer :: i, j

    previous = [(j, j=0, len(b))]
    do i = 1, len(a)
      row(0) = i
      do j = 1, len(b)
        row(j) = min(previous(j) + 1, row(j - 1) + 1, &
                     previous(j - 1) + merge(0, 1, a(i:i) == b(j:j)))
      end do
      previous = row
    end do
    distance = previous(len(b))
  end function edit_distance

end module calor_text
