!> A comparison of costs for people: a table of at most 100 columns and a sentence.
module calor_cost_table
  use calor_cost_entry, only: cost_entry_t, phase_cloud, phase_assembly, phase_control, &
                              phase_stability, phase_steps, phase_total
  use calor_cost_file, only: cost_front
  use calor_cost_study, only: cost_study_t
  use calor_cost_verdict, only: cost_verdict, default_target
  use calor_kinds, only: wp
  use calor_memory_need, only: size_text
  use calor_text, only: text_t, to_text, append
  implicit none (type, external)
  private

  public :: describe_costs

  integer, parameter :: columns = 100

contains

  !> What a study found: head, table, explanation, sentence, files.
  function describe_costs(study) result(lines)
    !> A study after `measure`
    type(cost_study_t), intent(in) :: study
    type(text_t), allocatable :: lines(:)
    logical, allocatable :: front(:), said(:)
    real(wp) :: target
    integer :: k, j

    allocate (lines(0))
    allocate (said(size(study%entries)), source=.false.)
    front = cost_front(study%entries)
    call append(lines, ' '//right('spacing', 9)//right('particles', 10)//right('neigh-', 7)// &
             right('error', 8)//right('of that', 8)//repeat(' ', 13)//' wall time, s')
    call append(lines, ' '//right('m', 9)//right('', 10)//right('bours', 7)//right('', 8)// &
             right('by time', 8)//right('steps', 6)//right('evals', 7)//right('set-up', 7)// &
             right('control', 8)//right('stable', 7)//right('steps', 7)//right('total', 7)// &
             right('memory', 8))
    do k = 1, size(study%entries)
      if (said(k)) cycle
      call append(lines, study%entries(k)%method%name())
      do j = k, size(study%entries)
        if (study%entries(j)%method%name() /= study%entries(k)%method%name()) cycle
        said(j) = .true.
        call add_wrapped(lines, row(study%entries(j), front(j)), 15)
      end do
    end do
    call append(lines, '')
    call add_wrapped(lines, '* on the front: none is both cheaper and more accurate. Error: '// &
                     'relative L2 at t = '//to_text(study%scene%time%end, digits=6)// &
                     ' s against '//compared_with(study)//'. Wall times: medians, '// &
                     to_text(study%threads)//trim(merge(' thread ', ' threads', &
                     study%threads == 1))//'; set-up: cloud, neighbours, tensors and '// &
                     'rows; control: spectral radius and first step; stable: the search for '// &
                     'unstable modes. The total is all that calor run does but for output.', 0)
    call warn_of_noise(lines, study%entries)
    target = study%scene%cost%target
    if (.not. target > 0) target = default_target(study%entries)
    call append(lines, '')
    call add_wrapped(lines, cost_verdict(study%entries, target), 0)
    do k = 1, size(study%written)
      if (k == 1) call append(lines, '')
      call append(lines, 'Written: '//study%written(k)%value)
    end do
    if (study%picture_problem /= '') call append(lines, 'No picture: '//study%picture_problem)
  end function describe_costs

  !> Where repetitions of a run took very different times, the machine had other work to do.
  subroutine warn_of_noise(lines, entries)
    type(text_t), allocatable, intent(inout) :: lines(:)
    type(cost_entry_t), intent(in) :: entries(:)
    !> Medians differ from the least by so much even on a quiet machine
    real(wp), parameter :: usual = 1.5_wp
    real(wp) :: most
    integer :: k

    most = 1
    do k = 1, size(entries)
      if (.not. entries(k)%measured()) cycle
      most = max(most, entries(k)%median_seconds(phase_total)/ &
                 max(minval(entries(k)%seconds(phase_total, :)), 1.0e-6_wp))
    end do
    if (most <= usual) return
    call append(lines, '')
    call add_wrapped(lines, 'The machine was busy with other work: the median of a run was '// &
                     'up to '//to_text(most, digits=2)//' times its least time. Repeat the '// &
                     'study in a quiet hour for wall times to trust.', 0)
  end subroutine warn_of_noise

  !> What errors are measured against
  function compared_with(study) result(text)
    type(cost_study_t), intent(in) :: study
    character(len=:), allocatable :: text

    text = 'the exact solution'
    if (study%reference%origin /= '') then
      text = study%reference%origin//' (good to about '// &
             to_text(study%reference%uncertainty, digits=1)//', the least error stated)'
    end if
  end function compared_with

  function row(entry, front) result(text)
    type(cost_entry_t), intent(in) :: entry
    logical, intent(in) :: front
    character(len=:), allocatable :: text

    text = merge('*', ' ', front)//right(length_text(entry), 9)
    if (.not. entry%measured()) then
      text = text//'   '//entry%failure
      if (entry%failure == '') text = text//'not measured'
      return
    end if
    text = text//right(to_text(entry%particles), 10)//right(decimal(entry%neighbours, 1), 7)// &
           right(to_text(entry%error, digits=2), 8)// &
           right(to_text(entry%time%error, digits=1), 8)//right(to_text(entry%steps), 6)// &
           right(to_text(entry%evaluations), 7)// &
           right(seconds_text(entry%median_seconds(phase_cloud) + &
                              entry%median_seconds(phase_assembly)), 7)// &
           right(seconds_text(entry%median_seconds(phase_control)), 8)// &
           right(seconds_text(entry%median_seconds(phase_stability)), 7)// &
           right(seconds_text(entry%median_seconds(phase_steps)), 7)// &
           right(seconds_text(entry%median_seconds(phase_total)), 7)// &
           right(size_text(entry%memory), 8)
  end function row

  pure function length_text(entry) result(text)
    type(cost_entry_t), intent(in) :: entry
    character(len=:), allocatable :: text

    text = 'as given'
    if (entry%spacing > 0) text = to_text(entry%spacing, digits=4)
  end function length_text

  !> Seconds in at most six letters
  pure function seconds_text(seconds) result(text)
    real(wp), intent(in) :: seconds
    character(len=:), allocatable :: text

    if (seconds < 10) then
      text = decimal(seconds, 4)
    else if (seconds < 1000) then
      text = decimal(seconds, 2)
    else
      text = decimal(seconds, 0)
    end if
  end function seconds_text

  !> A number with so many digits behind the point
  pure function decimal(number, digits) result(text)
    real(wp), intent(in) :: number
    integer, intent(in) :: digits
    character(len=:), allocatable :: text
    character(len=40) :: buffer
    character(len=8) :: form

    write (form, '(a,i0,a)') '(f40.', digits, ')'
    write (buffer, form) number
    text = trim(adjustl(buffer))
    if (digits == 0) text = text(:len(text) - 1)
  end function decimal

  !> At the right end of a column; at least one blank stays before it.
  pure function right(text, width) result(padded)
    character(len=*), intent(in) :: text
    integer, intent(in) :: width
    character(len=max(width, len(text) + 1)) :: padded

    padded = repeat(' ', len(padded) - len(text))//text
  end function right

  !> A text broken between words, so that it fits; lines after the first are indented.
  pure subroutine add_wrapped(lines, text, indent)
    type(text_t), allocatable, intent(inout) :: lines(:)
    character(len=*), intent(in) :: text
    integer, intent(in) :: indent
    character(len=:), allocatable :: rest
    integer :: break

    rest = trim(text)
    do while (len(rest) > columns)
      break = index(rest(:columns + 1), ' ', back=.true.)
      ! A single long word stays whole.
      if (break <= indent + 1) exit
      call append(lines, trim(rest(:break)))
      rest = repeat(' ', indent)//rest(break + 1:)
    end do
    call append(lines, rest)
  end subroutine add_wrapped

end module calor_cost_table
