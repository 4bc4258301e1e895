!> Expressions in x, y, t and T, as a scene file holds them, evaluated by muParser.
!>
!> muParser (https://beltoforion.de/en/muparser) parses an expression into byte code once; after
!> that a value costs some tens of nanoseconds. Points are evaluated one after another and not by
!> muParser's own bulk mode, which parses anew at each call, starts threads for the smallest job,
!> changes the caller's number of threads, and is no faster for it. Beside muParser's own functions
!> there are those that solutions of the heat equation are made of: the Bessel functions j0 and j1
!> and the error functions erf and erfc.
module calor_expression
  use, intrinsic :: iso_c_binding, only: c_ptr, c_char, c_int, c_double, c_intptr_t, c_loc, &
      c_null_ptr, c_null_char, c_associated, c_f_pointer, c_funptr, c_funloc
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan, &
      ieee_positive_inf
  use, intrinsic :: ieee_exceptions, only: ieee_status_type, ieee_get_status, ieee_set_status, &
      ieee_set_halting_mode, ieee_all
  use calor_constants, only: greatest_size, pi
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: wp
  use calor_text, only: to_text, text_list, suggestion
  implicit none (type, external)
  private

  public :: expression_t, compile_expression, longest_expression

  !> The most characters that an expression may have. muParser reports errors through a buffer of
  !> 2048 characters that it does not guard.
  integer, parameter :: longest_expression = 1000

  !> The variables of an expression, in the order of `expression_t%variables`
  character(len=1), parameter :: variable_names(*) = ['x', 'y', 't', 'T']

  !> Every name that an expression may use
  character(len=5), parameter :: known_names(*) = [character(len=5) :: variable_names, &
      'pi', '_pi', '_e', 'sin', 'cos', 'tan', 'asin', 'acos', 'atan', 'atan2', 'sinh', 'cosh', &
      'tanh', 'asinh', 'acosh', 'atanh', 'log2', 'log10', 'log', 'ln', 'exp', 'sqrt', 'sign', &
      'rint', 'abs', 'min', 'max', 'sum', 'avg', 'j0', 'j1', 'erf', 'erfc']

  !> The names in `known_names` up to this one stand for numbers, the later ones are functions
  integer, parameter :: last_number_name = size(variable_names) + 3

  !> muParser's error codes that get a sentence of their own (muParserDef.h, EErrorCodes)
  integer(c_int), parameter :: unexpected_operator = 0, unknown_token = 1, unexpected_end = 2, &
      unexpected_comma = 3, unexpected_arguments = 4, unexpected_value = 5, &
      unexpected_variable = 6, unexpected_parenthesis = 7, unexpected_text = 8, &
      text_expected = 9, value_expected = 10, missing_parenthesis = 11, &
      unexpected_function = 12, open_text = 13, too_many_arguments = 14, too_few_arguments = 15, &
      type_conflict = 16, text_result = 17, unexpected_conditional = 32, missing_else = 33, &
      misplaced_colon = 34, sign_of_nothing = 39

  !> A compiled expression. It may be copied by assignment; each copy has a parser of its own.
  !> An expression must not be evaluated by two threads at once: give each thread a copy.
  !>
  !> A parser belongs to the object at the address in `owner`. Compilers (gfortran up to 12) copy
  !> types that contain an expression byte by byte and finalize the copies; such a copy is not the
  !> owner, so it neither uses nor releases the parser of the original. (They finalize memory that
  !> was never an expression, too: what is in there is looked at only where `owner` is right.) All
  !> copies share `alive`, which turns false with the parser's end and is itself never given back: a
  !> copy that comes to lie where the owner lay cannot take itself for it. These few bytes are lost
  !> for each expression compiled. For the same reason the text has a fixed length: there is
  !> nothing in here that a byte-wise copy could free twice.
  type :: expression_t
    private
    character(len=longest_expression) :: text = ''
    logical :: used(size(variable_names)) = .false.
    type(c_ptr) :: parser = c_null_ptr
    real(c_double), pointer :: variables(:) => null()
    integer(c_intptr_t) :: owner = 0
    logical, pointer :: alive => null()
  contains
    !> The values at points, or the value at one point
    generic :: evaluate => evaluate_points, evaluate_point
    !> Whether the value depends on 'x', 'y', 't' or 'T'
    procedure :: uses
    !> The expression as the user wrote it
    procedure :: source
    !> What it takes to evaluate it at a point
    procedure :: operations
    !> Whether there is anything to evaluate
    procedure :: is_compiled
    !> A copy works on when the original is gone
    generic :: assignment(=) => copy
    procedure, private :: evaluate_points
    procedure, private :: evaluate_point
    procedure, private :: copy
    final :: finish
  end type expression_t

  ! A C string can only be an array of assumed size
  interface
    function mup_create(base_type) bind(c, name='mupCreate') result(parser)
      import :: c_int, c_ptr
      implicit none (type, external)
      integer(c_int), value :: base_type
      type(c_ptr) :: parser
    end function mup_create

    subroutine mup_release(parser) bind(c, name='mupRelease')
      import :: c_ptr
      implicit none (type, external)
      type(c_ptr), value :: parser
    end subroutine mup_release

    subroutine mup_set_expression(parser, text) bind(c, name='mupSetExpr')
      import :: c_ptr, c_char
      implicit none (type, external)
      type(c_ptr), value :: parser
      ! allow(assumed-size)
      character(kind=c_char), intent(in) :: text(*)
    end subroutine mup_set_expression

    subroutine mup_define_variable(parser, name, address) bind(c, name='mupDefineVar')
      import :: c_ptr, c_char
      implicit none (type, external)
      type(c_ptr), value :: parser
      ! allow(assumed-size)
      character(kind=c_char), intent(in) :: name(*)
      type(c_ptr), value :: address
    end subroutine mup_define_variable

    subroutine mup_define_constant(parser, name, number) bind(c, name='mupDefineConst')
      import :: c_ptr, c_char, c_double
      implicit none (type, external)
      type(c_ptr), value :: parser
      ! allow(assumed-size)
      character(kind=c_char), intent(in) :: name(*)
      real(c_double), value :: number
    end subroutine mup_define_constant

    subroutine mup_define_function(parser, name, function, fold) bind(c, name='mupDefineFun1')
      import :: c_ptr, c_char, c_int, c_funptr
      implicit none (type, external)
      type(c_ptr), value :: parser
      ! allow(assumed-size)
      character(kind=c_char), intent(in) :: name(*)
      type(c_funptr), value :: function
      !> Whether the value of a constant may be computed once, when the expression is parsed
      integer(c_int), value :: fold
    end subroutine mup_define_function

    function mup_evaluate(parser) bind(c, name='mupEval') result(number)
      import :: c_ptr, c_double
      implicit none (type, external)
      type(c_ptr), value :: parser
      real(c_double) :: number
    end function mup_evaluate

    function mup_evaluate_all(parser, count) bind(c, name='mupEvalMulti') result(numbers)
      import :: c_ptr, c_int
      implicit none (type, external)
      type(c_ptr), value :: parser
      integer(c_int), intent(out) :: count
      type(c_ptr) :: numbers
    end function mup_evaluate_all

    function mup_count_used(parser) bind(c, name='mupGetExprVarNum') result(count)
      import :: c_ptr, c_int
      implicit none (type, external)
      type(c_ptr), value :: parser
      integer(c_int) :: count
    end function mup_count_used

    subroutine mup_get_used(parser, number, name, address) bind(c, name='mupGetExprVar')
      import :: c_ptr, c_int
      implicit none (type, external)
      type(c_ptr), value :: parser
      integer(c_int), value :: number
      type(c_ptr), intent(out) :: name
      type(c_ptr), intent(out) :: address
    end subroutine mup_get_used

    function mup_failed(parser) bind(c, name='mupError') result(failed)
      import :: c_ptr, c_int
      implicit none (type, external)
      type(c_ptr), value :: parser
      integer(c_int) :: failed
    end function mup_failed

    function mup_error_code(parser) bind(c, name='mupGetErrorCode') result(code)
      import :: c_ptr, c_int
      implicit none (type, external)
      type(c_ptr), value :: parser
      integer(c_int) :: code
    end function mup_error_code

    function mup_error_position(parser) bind(c, name='mupGetErrorPos') result(position)
      import :: c_ptr, c_int
      implicit none (type, external)
      type(c_ptr), value :: parser
      integer(c_int) :: position
    end function mup_error_position

    function mup_error_token(parser) bind(c, name='mupGetErrorToken') result(token)
      import :: c_ptr
      implicit none (type, external)
      type(c_ptr), value :: parser
      type(c_ptr) :: token
    end function mup_error_token
  end interface

contains

  !> Compile an expression in x, y, t (time), T (temperature) and pi, in muParser's syntax:
  !> `sin(pi*x)*exp(-t)`, `x < 0.5 ? 1 : 0`. Upper and lower case differ.
  subroutine compile_expression(text, expression, error)
    !> The expression
    character(len=*), intent(in) :: text
    !> The compiled expression; not compiled if there is an error
    type(expression_t), intent(inout), target :: expression
    !> The expression is wrong; the message quotes it and tells where and why
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: reason
    integer :: position

    call release(expression)
    expression%text = ''
    expression%used = .false.
    call check_characters(text, position, reason)
    if (.not. allocated(reason)) then
      expression%text = text
      call start_parser(expression)
      call try_parser(expression, position, reason)
    end if
    if (allocated(reason)) then
      call release(expression)
      expression%text = ''
      call raise(error, status_bad_input, complaint(text, position, reason))
    end if
  end subroutine compile_expression

  !> The values of the expression at many points. Values that are no numbers (0/0, the root of a
  !> negative number) or infinite are handed on as they are; the caller checks for them. What is
  !> larger than any number of a scene may be counts as infinite.
  recursive subroutine evaluate_points(self, x, y, time, values, temperature)
    !> The expression; never compiled, it gives NaN
    class(expression_t), intent(in), target :: self
    !> Places of the points, m
    real(wp), intent(in) :: x(:)
    !> Places of the points, m
    real(wp), intent(in) :: y(:)
    !> The time, s
    real(wp), intent(in) :: time
    !> The values, one for each point
    real(wp), intent(out) :: values(:)
    !> Temperatures of the points, K; without them T is NaN
    real(wp), intent(in), optional :: temperature(:)
    type(expression_t), target :: own
    type(ieee_status_type) :: status
    logical, pointer :: alive
    integer :: k

    if (.not. owns_parser(self%parser, self%owner, self%alive)) then
      if (self%text == '') then
        values = ieee_value(0.0_wp, ieee_quiet_nan)
        return
      end if
      ! The object was copied without our assignment; see expression_t
      own%text = self%text
      call start_parser(own)
      call evaluate_points(own, x, y, time, values, temperature)
      alive => own%alive
      call release(own)
      ! No copy of it was made.
      deallocate (alive)
      return
    end if

    ! A caller that traps invalid operations still gets NaN for an expression without a value.
    call ieee_get_status(status)
    call ieee_set_halting_mode(ieee_all, .false.)
    self%variables(3) = time
    self%variables(4) = ieee_value(0.0_wp, ieee_quiet_nan)
    do k = 1, size(values)
      self%variables(1) = x(k)
      self%variables(2) = y(k)
      if (present(temperature)) self%variables(4) = temperature(k)
      values(k) = mup_evaluate(self%parser)
      if (abs(values(k)) > greatest_size) then
        values(k) = sign(ieee_value(0.0_wp, ieee_positive_inf), values(k))
      end if
    end do
    if (mup_failed(self%parser) /= 0) values = ieee_value(0.0_wp, ieee_quiet_nan)
    call ieee_set_status(status)
  end subroutine evaluate_points

  !> The value of the expression at one point; see `evaluate_points`.
  subroutine evaluate_point(self, x, y, time, value, temperature)
    !> The expression; never compiled, it gives NaN
    class(expression_t), intent(in), target :: self
    !> Place of the point, m
    real(wp), intent(in) :: x
    !> Place of the point, m
    real(wp), intent(in) :: y
    !> The time, s
    real(wp), intent(in) :: time
    !> The value
    real(wp), intent(out) :: value
    !> Temperature of the point, K; without it T is NaN
    real(wp), intent(in), optional :: temperature
    real(wp) :: values(1)

    if (present(temperature)) then
      call self%evaluate_points([x], [y], time, values, [temperature])
    else
      call self%evaluate_points([x], [y], time, values)
    end if
    value = values(1)
  end subroutine evaluate_point

  !> Whether the expression contains the variable.
  pure function uses(self, name)
    !> The expression
    class(expression_t), intent(in) :: self
    !> 'x', 'y', 't' or 'T'
    character(len=*), intent(in) :: name
    logical :: uses

    uses = any(self%used .and. variable_names == name)
  end function uses

  !> The expression as the user wrote it; '' if it was never compiled.
  pure function source(self) result(text)
    !> The expression
    class(expression_t), intent(in) :: self
    character(len=:), allocatable :: text

    text = trim(self%text)
  end function source

  !> What an evaluation at a point takes, in operators: a function takes as long as ten of them, and
  !> the call of the parser as four, measured.
  pure function operations(self) result(number)
    !> The expression
    class(expression_t), intent(in) :: self
    integer :: number
    character(len=1) :: before
    integer :: k

    number = 4
    before = ' '
    do k = 1, len_trim(self%text)
      if (scan(self%text(k:k), '+-*/^<>=?') > 0) number = number + 1
      if (self%text(k:k) == '(' .and. scan(before, '+-*/^<>=?:&|(,') == 0 .and. before /= ' ') then
        number = number + 10
      end if
      if (self%text(k:k) /= ' ') before = self%text(k:k)
    end do
  end function operations

  !> Whether the expression has been compiled.
  pure function is_compiled(self)
    !> The expression
    class(expression_t), intent(in) :: self
    logical :: is_compiled

    is_compiled = self%text /= ''
  end function is_compiled

  !> Give the left-hand side a parser of its own for the text of the right-hand side.
  impure elemental subroutine copy(self, original)
    !> What becomes the copy
    class(expression_t), intent(inout), target :: self
    !> What is copied
    class(expression_t), intent(in) :: original
    character(len=longest_expression) :: text
    logical :: used(size(variable_names))

    ! Both sides may be the same object
    text = original%text
    used = original%used
    call release(self)
    self%text = text
    self%used = used
    if (text /= '') call start_parser(self)
  end subroutine copy

  impure elemental subroutine finish(self)
    type(expression_t), intent(inout), target :: self

    call release(self)
  end subroutine finish

  !> Give the parser back, if it is this object's own.
  subroutine release(self)
    class(expression_t), intent(inout), target :: self

    if (owns_parser(self%parser, self%owner, self%alive)) then
      call mup_release(self%parser)
      deallocate (self%variables)
      self%alive = .false.
    end if
    self%parser = c_null_ptr
    self%variables => null()
    self%owner = 0
    self%alive => null()
  end subroutine release

  !> Whether the object that holds these components is the one that the parser was made for.
  function owns_parser(parser, owner, alive)
    type(c_ptr), intent(in), target :: parser
    integer(c_intptr_t), intent(in) :: owner
    logical, pointer, intent(in) :: alive
    logical :: owns_parser

    owns_parser = owner /= 0 .and. owner == transfer(c_loc(parser), 0_c_intptr_t)
    if (owns_parser) owns_parser = alive
  end function owns_parser

  !> Make a parser for `self%text`; the text is not parsed before the first evaluation.
  subroutine start_parser(self)
    class(expression_t), intent(inout), target :: self
    integer :: k

    self%parser = mup_create(0_c_int)
    self%owner = transfer(c_loc(self%parser), 0_c_intptr_t)
    allocate (self%alive, source=.true.)
    ! The address of a variable must outlive every move of the object
    allocate (self%variables(size(variable_names)), source=0.5_c_double)
    do k = 1, size(variable_names)
      call mup_define_variable(self%parser, variable_names(k)//c_null_char, &
                               c_loc(self%variables(k)))
    end do
    call mup_define_constant(self%parser, 'pi'//c_null_char, real(pi, c_double))
    ! muParser's own has 13 digits
    call mup_define_constant(self%parser, '_pi'//c_null_char, real(pi, c_double))
    call mup_define_function(self%parser, 'j0'//c_null_char, c_funloc(bessel_0), 1_c_int)
    call mup_define_function(self%parser, 'j1'//c_null_char, c_funloc(bessel_1), 1_c_int)
    call mup_define_function(self%parser, 'erf'//c_null_char, c_funloc(error_function), 1_c_int)
    call mup_define_function(self%parser, 'erfc'//c_null_char, c_funloc(error_complement), 1_c_int)
    call mup_set_expression(self%parser, trim(self%text)//c_null_char)
  end subroutine start_parser

  ! What muParser calls; without state, and so safe on every thread

  !> J₀
  pure function bessel_0(x) bind(c, name='') result(value)
    real(c_double), value :: x
    real(c_double) :: value

    value = bessel_j0(x)
  end function bessel_0

  !> J₁
  pure function bessel_1(x) bind(c, name='') result(value)
    real(c_double), value :: x
    real(c_double) :: value

    value = bessel_j1(x)
  end function bessel_1

  !> 2/√π ∫ exp(-s²) from 0 to x
  pure function error_function(x) bind(c, name='') result(value)
    real(c_double), value :: x
    real(c_double) :: value

    value = erf(x)
  end function error_function

  !> 1 - erf(x), exact also where that is tiny
  pure function error_complement(x) bind(c, name='') result(value)
    real(c_double), value :: x
    real(c_double) :: value

    value = erfc(x)
  end function error_complement

  !> Let muParser parse the expression, which it does at the first evaluation.
  subroutine try_parser(self, position, reason)
    class(expression_t), intent(inout), target :: self
    !> Where the expression is wrong, counted in bytes from 1; 0 if nowhere in particular
    integer, intent(out) :: position
    !> What is wrong; not allocated if nothing is
    character(len=:), allocatable, intent(out) :: reason
    type(ieee_status_type) :: status
    type(c_ptr) :: numbers, name, address
    character(len=:), allocatable :: used_name
    integer(c_int) :: count, k

    position = 0
    ! 1/x may well be infinite at the point of trial: no matter, and no flag may stay behind
    call ieee_get_status(status)
    call ieee_set_halting_mode(ieee_all, .false.)
    numbers = mup_evaluate_all(self%parser, count)
    if (mup_failed(self%parser) /= 0) then
      call explain(self%parser, trim(self%text), position, reason)
    else if (count /= 1) then
      position = outer_comma(self%text)
      reason = 'it has '//to_text(int(count))//' values where one is expected'
    else
      do k = 0, mup_count_used(self%parser) - 1
        call mup_get_used(self%parser, k, name, address)
        used_name = from_c(name)
        self%used = self%used .or. variable_names == used_name
      end do
    end if
    call ieee_set_status(status)
  end subroutine try_parser

  !> What muParser would accept or read wrongly, but a scene should not hold.
  pure subroutine check_characters(text, position, reason)
    character(len=*), intent(in) :: text
    integer, intent(out) :: position
    character(len=:), allocatable, intent(out) :: reason
    integer :: k

    position = 0
    if (len_trim(text) > longest_expression) then
      reason = 'it is longer than '//to_text(longest_expression)//' characters'
      return
    end if
    do k = 1, len_trim(text)
      if (iachar(text(k:k)) < 32 .and. text(k:k) /= achar(9)) then
        position = k
        reason = 'there is a control character'
        return
      end if
      if (is_assignment(text, k)) then
        position = k
        reason = '''='' would assign; to compare, write ''=='''
        return
      end if
    end do
    if (verify(text, ' '//achar(9)) == 0) reason = 'it is empty'
  end subroutine check_characters

  !> Whether character k is a '=' that is no part of ==, !=, <= or >=.
  pure function is_assignment(text, k)
    character(len=*), intent(in) :: text
    integer, intent(in) :: k
    logical :: is_assignment
    integer :: equals

    is_assignment = .false.
    if (text(k:k) /= '=') return
    if (k < len(text)) then
      if (text(k + 1:k + 1) == '=') return
    end if
    equals = 0
    if (k > 1) equals = scan('=!<>', text(k - 1:k - 1))
    ! '===' is '==' and an assignment
    if (equals == 1 .and. k > 2) equals = 1 - scan('=!<>', text(k - 2:k - 2))
    is_assignment = equals <= 0
  end function is_assignment

  !> Put muParser's last error into words.
  subroutine explain(parser, text, position, reason)
    type(c_ptr), intent(in) :: parser
    character(len=*), intent(in) :: text
    integer, intent(out) :: position
    character(len=:), allocatable, intent(out) :: reason
    character(len=:), allocatable :: token
    integer(c_int) :: code

    code = mup_error_code(parser)
    token = trim(from_c(mup_error_token(parser)))
    position = min(mup_error_position(parser) + 1, len(text) + 1)
    select case (code)
    case (unknown_token)
      reason = about_unknown(token)
    case (unexpected_operator)
      reason = 'the operator '''//token//''' is out of place'
      if (token == '*') reason = reason//' (a power is written ''^'')'
    case (unexpected_end)
      reason = 'it ends too early'
    case (unexpected_comma)
      position = index(text(:min(position, len(text))), ',', back=.true.)
      reason = 'the comma is out of place'
    case (unexpected_arguments)
      reason = 'there are several values in parentheses, but no function before them'
    case (unexpected_value, unexpected_variable, unexpected_function)
      reason = 'an operator is missing before '''//token//''''
    case (unexpected_parenthesis)
      reason = 'the parenthesis '''//token//''' is out of place'
    case (missing_parenthesis)
      reason = 'a closing parenthesis '')'' is missing'
    case (too_many_arguments, too_few_arguments)
      position = index(text(:min(position, len(text))), token, back=.true.)
      reason = 'the function '''//token//''' has too '// &
               trim(merge('many', 'few ', code == too_many_arguments))//' arguments'
    case (unexpected_text, text_expected, value_expected, open_text, type_conflict, text_result)
      position = scan(text, '"')
      reason = 'a text in quotes has no place here'
    case (unexpected_conditional, misplaced_colon)
      position = index(text(:min(position, len(text))), merge(':', '?', code == misplaced_colon &
                                                              .or. token == ':'), back=.true.)
      reason = 'a condition is written ''x < 0.5 ? 1 : 0'''
    case (missing_else)
      position = scan(text, '?')
      reason = '''?'' has no '':'' after it'
    case (sign_of_nothing)
      reason = 'a value is missing'
    case default
      reason = 'muParser cannot read it (its error '//to_text(int(code))//')'
    end select
  end subroutine explain

  !> What to say of a token that muParser does not know.
  function about_unknown(token) result(reason)
    !> The token, or the rest of the expression if it does not begin with a letter or digit
    character(len=*), intent(in) :: token
    character(len=:), allocatable :: reason
    integer :: last

    if (token == '') then
      reason = 'there is something unknown'
    else if (any(token == known_names(last_number_name + 1:))) then
      reason = 'the function '''//token//''' needs its arguments in parentheses'
    else if (scan(token(1:1), '0123456789') == 1) then
      reason = 'the number '''//token//''' is out of range'
    else if (token == 'd' .or. token == 'D') then
      reason = '''d'' is not known (a power of ten is written with e, as in 1e-3)'
    else
      last = verify(token, 'abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_0123456789') - 1
      if (last < 0) last = len(token)
      if (last == 0) last = last_of_character(token, 1)
      reason = ''''//token(:last)//''' is not known (known: x, y, t, T, pi and muParser''s '// &
               'functions).'//suggestion(token(:last), text_list(known_names))
    end if
  end function about_unknown

  !> The error message.
  pure function complaint(text, position, reason) result(message)
    character(len=*), intent(in) :: text
    !> In bytes; 0 if there is none
    integer, intent(in) :: position
    character(len=*), intent(in) :: reason
    character(len=:), allocatable :: message
    integer, parameter :: longest_quote = 300

    if (len_trim(text) > longest_quote) then
      message = 'the expression '''//text(:longest_quote)//'...'' is wrong'
    else
      message = 'the expression '''//trim(text)//''' is wrong'
    end if
    if (position > 0) then
      message = message//' at position '//to_text(character_position(text, position))
    end if
    message = message//': '//reason
    if (scan(message(len(message):), '.?') == 0) message = message//'.'
  end function complaint

  !> Which character (UTF-8) the byte belongs to, counted from 1.
  pure function character_position(text, byte) result(position)
    character(len=*), intent(in) :: text
    integer, intent(in) :: byte
    integer :: position
    integer :: k

    position = max(0, byte - len(text))
    do k = 1, min(byte, len(text))
      if (.not. is_continuation(text(k:k))) position = position + 1
    end do
  end function character_position

  !> The last byte of the character (UTF-8) that begins at `first`.
  pure function last_of_character(text, first) result(last)
    character(len=*), intent(in) :: text
    integer, intent(in) :: first
    integer :: last

    last = first
    do while (last < len(text))
      if (.not. is_continuation(text(last + 1:last + 1))) exit
      last = last + 1
    end do
  end function last_of_character

  !> Whether a byte continues a character of several bytes in UTF-8.
  pure function is_continuation(byte)
    character(len=1), intent(in) :: byte
    logical :: is_continuation

    is_continuation = iand(ichar(byte), 192) == 128
  end function is_continuation

  !> The first comma outside all parentheses, 0 if there is none.
  pure function outer_comma(text) result(position)
    character(len=*), intent(in) :: text
    integer :: position
    integer :: k, depth

    position = 0
    depth = 0
    do k = 1, len(text)
      select case (text(k:k))
      case ('(')
        depth = depth + 1
      case (')')
        depth = depth - 1
      case (',')
        if (depth == 0) then
          position = k
          return
        end if
      case default
        continue
      end select
    end do
  end function outer_comma

  !> A C string as Fortran text, at most as long as muParser's buffer.
  function from_c(address) result(text)
    type(c_ptr), intent(in) :: address
    character(len=:), allocatable :: text
    integer, parameter :: longest = 2047
    character(kind=c_char), pointer :: characters(:)
    integer :: k

    text = ''
    if (.not. c_associated(address)) return
    call c_f_pointer(address, characters, [longest])
    do k = 1, longest
      if (characters(k) == c_null_char) exit
      text = text//characters(k)
    end do
  end function from_c

end module calor_expression
