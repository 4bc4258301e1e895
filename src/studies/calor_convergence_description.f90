!> What a study of convergence found: tables, and what follows from them.
module calor_convergence_description
  use calor_convergence_schemes, only: study_scheme_t, gradient_family, laplacian_family
  use calor_convergence_study, only: convergence_study_t, convergence_curve_t, measurement_t
  use calor_convergence_theory, only: fixed_ratio, growing_ratio, fixed_spacing, regular_cloud, &
                                      irregular_cloud, is_order
  use calor_gradient_schemes, only: gradient_choices
  use calor_kinds, only: wp
  use calor_laplacian_schemes, only: laplacian_choices
  use calor_text, only: text_t, text_list, to_text, join
  implicit none (type, external)
  private

  public :: describe_convergence, convergence_document, conclusion

  !> Orders within this of 0 are none
  real(wp), parameter :: indifferent = 0.5_wp
  !> How many terms of the budget a table has
  integer, parameter :: shown_terms = 5
  !> Width of the terminal
  integer, parameter :: columns = 100
  integer, parameter :: cell_length = 40

contains

  !> What was measured and what it shows, for a terminal of 100 columns.
  function describe_convergence(study) result(lines)
    !> A study after `evaluate`
    type(convergence_study_t), intent(in) :: study
    type(text_t), allocatable :: lines(:)
    integer :: family, k

    lines = introduction(study)
    do k = 1, size(study%schemes)
      lines = [lines, text_list(['']), text_list([heading(study%schemes(k))]), &
               plain_table(scheme_cells(study, k))]
    end do
    do family = gradient_family, laplacian_family
      if (.not. any(study%schemes%family == family)) cycle
      lines = [lines, text_list(['']), wrapped(conclusion(study, family))]
    end do
  end function describe_convergence

  !> The tables and conclusions in Markdown.
  function convergence_document(study) result(lines)
    !> A study after `evaluate`
    type(convergence_study_t), intent(in) :: study
    type(text_t), allocatable :: lines(:)
    integer :: family, k

    allocate (lines(0))
    do family = gradient_family, laplacian_family
      if (.not. any(study%schemes%family == family)) cycle
      lines = [lines, text_list([conclusion(study, family)]), text_list([''])]
    end do
    do k = 1, size(study%schemes)
      if (k > 1) lines = [lines, text_list([''])]
      lines = [lines, text_list(['### '//heading(study%schemes(k))]), text_list(['']), &
               markdown_table(scheme_cells(study, k))]
    end do
  end function convergence_document

  ! ---------------------------------------------------------------------------------------------
  ! Conclusions
  ! ---------------------------------------------------------------------------------------------

  !> Which schemes of a family converge on irregular clouds at fixed h/spacing, and which with a
  !> growing ratio: from the measured orders, first of the paper's schemes and then of the others.
  !> '' if none of the family was measured.
  function conclusion(study, family) result(text)
    !> A study after `evaluate`
    type(convergence_study_t), intent(in) :: study
    !> `gradient_family` or `laplacian_family`
    integer, intent(in) :: family
    character(len=:), allocatable :: text
    logical, dimension(size(study%schemes)) :: of_paper, others

    of_paper = study%schemes%family == family .and. study%schemes%of_paper
    others = study%schemes%family == family .and. .not. study%schemes%of_paper
    text = ''
    if (.not. any(of_paper .or. others)) return
    text = trim(merge('Gradient ', 'Laplacian', family == gradient_family))//' schemes on the '// &
           'irregular cloud ('//trim(study%cloud_name(irregular_cloud))//'), measured orders '// &
           'in brackets.'
    if (any(of_paper)) text = text//' Of those that R. Fatehi and M.T. Manzari analyse, with '// &
                              verdicts(study, of_paper)
    if (any(others)) text = text//trim(merge(' Of the others, with', ' With               ', &
                                             any(of_paper)))//' '//verdicts(study, others)
  end function conclusion

  !> For both ways
  function verdicts(study, members) result(text)
    type(convergence_study_t), intent(in) :: study
    !> Which schemes they are about
    logical, intent(in) :: members(:)
    character(len=:), allocatable :: text

    text = 'h/spacing fixed, '//verdict(study, members, fixed_ratio)// &
           '. With h/spacing growing, '//verdict(study, members, growing_ratio)//'.'
  end function verdicts

  function verdict(study, members, way) result(text)
    type(convergence_study_t), intent(in) :: study
    logical, intent(in) :: members(:)
    integer, intent(in) :: way
    character(len=:), allocatable :: text
    type(text_t), allocatable :: falling(:), standing(:), growing(:), exact(:)
    type(text_t) :: name
    integer :: k

    allocate (falling(0), standing(0), growing(0), exact(0))
    do k = 1, size(study%schemes)
      if (.not. members(k)) cycle
      name%value = study%schemes(k)%label()
      associate (order => study%curve(way, irregular_cloud, k)%fitted)
        if (.not. is_order(order)) then
          exact = [exact, name]
          cycle
        end if
        name%value = name%value//' ('//fixed(order, 1)//')'
        if (order > indifferent) then
          falling = [falling, name]
        else if (order < -indifferent) then
          growing = [growing, name]
        else
          standing = [standing, name]
        end if
      end associate
    end do
    if (size(falling) == 0) then
      text = 'none converges'
    else if (size(falling) < count(members)) then
      text = 'only '//listed(falling)//trim(merge(' converges', ' converge ', size(falling) == 1))
    else if (size(falling) == 1) then
      text = listed(falling)//' converges'
    else
      text = 'all converge: '//listed(falling)
    end if
    if (size(standing) > 0) text = text//'; the error stands still for '//listed(standing)
    if (size(growing) > 0) text = text//'; the error grows for '//listed(growing)
    if (size(exact) > 0) text = text//'; there is no error but rounding for '//listed(exact)
  end function verdict

  !> 'a, b and c'
  function listed(names) result(text)
    type(text_t), intent(in) :: names(:)
    character(len=:), allocatable :: text

    text = names(size(names))%value
    if (size(names) > 1) text = join(names(:size(names) - 1), ', ')//' and '//text
  end function listed

  ! ---------------------------------------------------------------------------------------------
  ! Tables
  ! ---------------------------------------------------------------------------------------------

  function introduction(study) result(lines)
    type(convergence_study_t), intent(in) :: study
    type(text_t), allocatable :: lines(:)

    associate (a => study%curve(fixed_ratio, 1, 1)%level, &
               b => study%curve(growing_ratio, 1, 1)%level, &
               c => study%curve(fixed_spacing, 1, 1)%level)
      lines = [wrapped('How derivative schemes converge, measured on u = '// &
                       study%field_in_words()//', with the kernel '//study%scene%kernel// &
                       ', h being its support radius. Three ways of refining:'), &
               text_list(['  a  spacing -> 0 with h/spacing fixed at '//ratio(a(1))// &
                          ': spacing '//range_text(a%spacing)//' m']), &
               text_list(['  b  h -> 0 with h/spacing growing from '//ratio(b(1))//' to '// &
                          ratio(b(size(b)))//': h '//range_text(b%radius)//' m']), &
               text_list(['  c  h -> 0 at a fixed spacing of '//to_text(c(1)%spacing, digits=3)// &
                          ' m: h '//range_text(c%radius)//' m'])]
    end associate
    lines = [lines, wider_supports(study), &
             text_list(['Clouds are regular ('//trim(study%cloud_name(regular_cloud))// &
                        ') and irregular ('//trim(study%cloud_name(irregular_cloud))// &
                        ').']), &
             text_list([character(len=columns) :: &
                        'Order n, the error falling as spacing^n in a and as h^n in b and c:', &
                        '  limit  by theory, in the limit', &
                        '  here   by theory, with the size that each term of the error has at '// &
                        'the finest three', &
                        '  fit    measured over the finest three; steps: from each refinement '// &
                        'to the next (~0: rounding)', &
                        'first, finest: the error, root mean square relative to that of the '// &
                        'true derivative, where all', &
                        '  supports are whole. T0, T1, ...: terms of that degree of the '// &
                        'truncation error, at the finest,', &
                        '  in % of the error; sum: all terms added with their signs, over the '// &
                        'error.'])]
  end function introduction

  !> How schemes that need wider supports than the first one are refined; nothing if none does
  function wider_supports(study) result(lines)
    type(convergence_study_t), intent(in) :: study
    type(text_t), allocatable :: lines(:)
    type(text_t), allocatable :: starts(:)
    real(wp) :: widest
    integer :: k, short

    allocate (starts(0), lines(0))
    widest = study%schemes(1)%least_support
    do k = 1, size(study%schemes)
      if (study%schemes(k)%least_support <= widest) cycle
      widest = study%schemes(k)%least_support
      starts = [starts, text_list([ratio(study%curve(fixed_ratio, regular_cloud, k)%level(1))// &
                                   ' for '//study%schemes(k)%label()])]
    end do
    if (size(starts) == 0) return
    lines = wrapped('Where rows need more neighbours, h/spacing is wider at the start: '// &
                    listed(starts)//'.')
    short = findloc(study%schemes%short_waves, .true., 1)
    if (short == 0 .or. all(study%schemes%short_waves)) return
    associate (levels => study%curve(fixed_ratio, regular_cloud, short)%level)
      lines = [lines, text_list(['Orders above 2 are refined to 1/'// &
                                 to_text(nint(levels(1)%spacing/levels(size(levels))%spacing))// &
                                 ' of the coarsest spacing, others to 1/'// &
                                 to_text(2**(size(levels) - 1))//'.'])]
    end associate
  end function wider_supports

  pure function ratio(measurement) result(text)
    type(measurement_t), intent(in) :: measurement
    character(len=:), allocatable :: text

    text = to_text(measurement%radius/measurement%spacing, digits=3)
  end function ratio

  pure function range_text(lengths) result(text)
    real(wp), intent(in) :: lengths(:)
    character(len=:), allocatable :: text

    text = to_text(lengths(1), digits=3)//' to '//to_text(lengths(size(lengths)), digits=3)
  end function range_text

  function heading(scheme) result(text)
    type(study_scheme_t), intent(in) :: scheme
    character(len=:), allocatable :: text

    text = trim(merge('gradient ', 'Laplacian', scheme%family == gradient_family))//' '// &
           scheme%label()//': '//summary_of(scheme)
  end function heading

  pure function summary_of(scheme) result(summary)
    type(study_scheme_t), intent(in) :: scheme
    character(len=:), allocatable :: summary
    integer :: k

    summary = ''
    if (scheme%family == gradient_family) then
      do k = 1, size(gradient_choices)
        if (gradient_choices(k)%name == scheme%name) summary = trim(gradient_choices(k)%summary)
      end do
    else
      do k = 1, size(laplacian_choices)
        if (laplacian_choices(k)%name == scheme%name) summary = trim(laplacian_choices(k)%summary)
      end do
    end if
  end function summary_of

  !> The table of a scheme: names of the columns, and a line for each cloud and way.
  function scheme_cells(study, number) result(cells)
    type(convergence_study_t), intent(in) :: study
    integer, intent(in) :: number
    character(len=cell_length), allocatable :: cells(:, :)
    integer :: before, cloud, k, line, way

    associate (curves => study%curve(:, :, number))
      allocate (cells(8 + shown_terms, 0:size(curves)))
      before = last_hidden_term(study%schemes(number), curves(1, 1))
      cells(:7, 0) = [character(len=cell_length) :: 'cloud, way', 'limit', 'here', 'fit', 'steps', &
                      'first', 'finest']
      do k = 1, shown_terms
        cells(7 + k, 0) = 'T'//to_text(before + k)
      end do
      cells(8 + shown_terms, 0) = 'sum'
      line = 0
      do cloud = regular_cloud, irregular_cloud
        do way = fixed_ratio, fixed_spacing
          line = line + 1
          cells(1, line) = trim(merge('regular  ', 'irregular', cloud == regular_cloud))//' '// &
                           achar(iachar('a') + way - fixed_ratio)
          cells(2:, line) = line_cells(curves(way, cloud), before)
        end do
      end do
    end associate
  end function scheme_cells

  !> The terms shown are the last ones, or else begin with the last that vanishes.
  function last_hidden_term(scheme, curve) result(degree)
    type(study_scheme_t), intent(in) :: scheme
    type(convergence_curve_t), intent(in) :: curve
    integer :: degree

    degree = ubound(curve%level(1)%term, 1) - shown_terms
    degree = max(-1, min(degree, scheme%exact_degree - 1))
  end function last_hidden_term

  function line_cells(curve, before) result(cells)
    type(convergence_curve_t), intent(in) :: curve
    !> The terms shown are those after this one
    integer, intent(in) :: before
    character(len=cell_length) :: cells(7 + shown_terms)
    character(len=:), allocatable :: steps
    integer :: k, level

    cells(1) = order_text(curve%predicted)
    cells(2) = order_text(curve%expected)
    cells(3) = order_text(curve%fitted)
    steps = ''
    do level = 2, size(curve%level)
      if (curve%level(level)%rounded) then
        steps = steps//right('~0', 5)
      else
        steps = steps//right(order_text(curve%level(level)%order), 5)
      end if
    end do
    cells(4) = steps
    associate (first => curve%level(1), finest => curve%level(size(curve%level)))
      cells(5) = scientific(first%error)
      cells(6) = scientific(finest%error)
      do k = 1, shown_terms
        cells(6 + k) = part_text(finest%term(before + k), finest)
      end do
      cells(7 + shown_terms) = '-'
      if (.not. finest%rounded) cells(7 + shown_terms) = fixed(finest%total/finest%error, 2)
    end associate
  end function line_cells

  function plain_table(cells) result(lines)
    character(len=*), intent(in) :: cells(:, 0:)
    type(text_t), allocatable :: lines(:)
    integer :: k, line, width

    allocate (lines(0:ubound(cells, 2)))
    do line = 0, ubound(cells, 2)
      lines(line)%value = left(trim(cells(1, line)), 12)
      do k = 2, size(cells, 1)
        select case (k)
        case (5)
          width = maxval(len_trim(cells(5, :))) + 1
        case (6, 7)
          width = 8
        case (8:)
          width = merge(6, 5, k == size(cells, 1))
        case default
          width = 6
        end select
        lines(line)%value = lines(line)%value//right(trim(cells(k, line)), width)
      end do
    end do
  end function plain_table

  function markdown_table(cells) result(lines)
    character(len=*), intent(in) :: cells(:, 0:)
    type(text_t), allocatable :: lines(:)
    integer :: k, line

    allocate (lines(2 + ubound(cells, 2)))
    do line = 0, ubound(cells, 2)
      associate (text => lines(merge(1, line + 2, line == 0)))
        text%value = '|'
        do k = 1, size(cells, 1)
          text%value = text%value//' '//single_spaced(cells(k, line))//' |'
        end do
      end associate
    end do
    lines(2)%value = '|'//repeat('---|', size(cells, 1))
  end function markdown_table

  !> Words with a single blank between them
  pure function single_spaced(words) result(text)
    character(len=*), intent(in) :: words
    character(len=:), allocatable :: text
    integer :: k

    text = ''
    do k = 1, len_trim(words)
      if (words(k:k) == ' ' .and. text == '') cycle
      if (words(k:k) == ' ') then
        if (text(len(text):) == ' ') cycle
      end if
      text = text//words(k:k)
    end do
  end function single_spaced

  !> A text in lines no longer than the terminal is wide
  function wrapped(text) result(lines)
    character(len=*), intent(in) :: text
    type(text_t), allocatable :: lines(:)
    integer :: start, stop

    allocate (lines(0))
    start = 1
    do while (start <= len(text))
      stop = len(text)
      if (stop - start >= columns) stop = start + index(text(start:start + columns), ' ', &
                                                        back=.true.) - 2
      lines = [lines, text_list([text(start:stop)])]
      start = stop + 2
    end do
  end function wrapped

  pure function part_text(term, measurement) result(text)
    real(wp), intent(in) :: term
    type(measurement_t), intent(in) :: measurement
    character(len=:), allocatable :: text

    text = '-'
    if (.not. measurement%rounded) text = to_text(nint(100*term/measurement%error))
  end function part_text

  pure function order_text(order) result(text)
    real(wp), intent(in) :: order
    character(len=:), allocatable :: text

    text = '-'
    if (is_order(order)) text = fixed(order, merge(1, 0, abs(order) < 9.95_wp))
  end function order_text

  !> As in 2.3e-2
  pure function scientific(number) result(text)
    real(wp), intent(in) :: number
    character(len=:), allocatable :: text
    character(len=16) :: buffer
    integer :: exponent, mark

    write (buffer, '(es12.1e3)') number
    mark = index(buffer, 'E')
    read (buffer(mark + 1:), *) exponent
    text = trim(adjustl(buffer(:mark - 1)))//'e'//to_text(exponent)
  end function scientific

  !> A number with some decimals; none is minus zero.
  pure function fixed(number, decimals) result(text)
    real(wp), intent(in) :: number
    integer, intent(in) :: decimals
    character(len=:), allocatable :: text
    character(len=24) :: buffer
    character(len=12) :: form

    write (form, '(a,i0,a)') '(f24.', decimals, ')'
    write (buffer, form) number
    text = trim(adjustl(buffer))
    if (decimals == 0) text = text(:len(text) - 1)
    if (text(1:1) == '-' .and. verify(text, '-0.') == 0) text = text(2:)
  end function fixed

  pure function left(text, width) result(padded)
    character(len=*), intent(in) :: text
    integer, intent(in) :: width
    character(len=width) :: padded

    padded = text
  end function left

  pure function right(text, width) result(padded)
    character(len=*), intent(in) :: text
    integer, intent(in) :: width
    character(len=:), allocatable :: padded

    padded = repeat(' ', max(0, width - len(text)))//text
  end function right

end module calor_convergence_description
