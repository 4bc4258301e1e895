!> What a comparison of costs comes down to, in one sentence.
module calor_cost_verdict
  use calor_cost_entry, only: cost_entry_t, phase_total
  use calor_cost_method, only: cost_method_t
  use calor_kinds, only: wp
  use calor_text, only: text_t, to_text, join, append
  implicit none (type, external)
  private

  public :: cost_verdict, default_target

contains

  !> Which entry reaches an error at least cost, and which methods never do. Only what was measured
  !> counts; nothing is interpolated.
  function cost_verdict(entries, target) result(sentence)
    !> The entries
    type(cost_entry_t), intent(in) :: entries(:)
    !> The relative L2 error to reach
    real(wp), intent(in) :: target
    character(len=:), allocatable :: sentence
    type(text_t), allocatable :: short(:)
    real(wp) :: least
    integer :: best, k

    best = 0
    least = huge(least)
    do k = 1, size(entries)
      if (.not. entries(k)%measured()) cycle
      if (entries(k)%error > target .or. entries(k)%median_seconds(phase_total) >= least) cycle
      best = k
      least = entries(k)%median_seconds(phase_total)
    end do
    if (best == 0) then
      sentence = 'Nothing that was measured reaches an error of '//to_text(target, digits=2)//'.'
      return
    end if
    sentence = 'For an error of '//to_text(target, digits=2)//' the cheapest measured is '// &
               name_of(entries, best)//' with particles '// &
               to_text(entries(best)%spacing, digits=3)//' m apart: '// &
               to_text(least, digits=2)//' s, error '//to_text(entries(best)%error, digits=2)
    call methods_short_of(entries, target, short)
    if (size(short) == 1) then
      sentence = sentence//'; '//short(1)%value//' does not reach it at any spacing tried'
    else if (size(short) > 1) then
      sentence = sentence//'; at no spacing tried is it reached by '// &
                 join(short(:size(short) - 1), ', ')//' or '//short(size(short))%value
    end if
    sentence = sentence//'.'
  end function cost_verdict

  !> A round error that tells methods apart: the smallest power of ten that two methods reach, or
  !> one if there is but one.
  pure function default_target(entries) result(target)
    !> The entries, at least one of them measured
    type(cost_entry_t), intent(in) :: entries(:)
    real(wp) :: target
    real(wp) :: least(size(entries)), second
    logical :: counted(size(entries))
    integer :: k, j

    ! The least error of each method, noted at the method's first entry
    counted = .false.
    least = huge(1.0_wp)
    do k = 1, size(entries)
      if (.not. entries(k)%measured()) cycle
      do j = 1, k
        if (same_method(entries(j)%method, entries(k)%method)) exit
      end do
      counted(j) = .true.
      least(j) = min(least(j), entries(k)%error)
    end do
    k = minloc(least, dim=1)
    second = least(k)
    counted(k) = .false.
    if (any(counted)) second = minval(least, mask=counted)
    target = 10.0_wp**ceiling(log10(max(second, 1.0e-14_wp)))
  end function default_target

  !> Names of the methods that were measured and never reached the error.
  subroutine methods_short_of(entries, target, names)
    type(cost_entry_t), intent(in) :: entries(:)
    real(wp), intent(in) :: target
    type(text_t), allocatable, intent(out) :: names(:)
    logical :: tried, reached
    integer :: k, j

    allocate (names(0))
    do k = 1, size(entries)
      ! Each method once, at its first entry
      do j = 1, k - 1
        if (same_method(entries(j)%method, entries(k)%method)) exit
      end do
      if (j < k) cycle
      tried = .false.
      reached = .false.
      do j = k, size(entries)
        if (.not. same_method(entries(j)%method, entries(k)%method)) cycle
        if (.not. entries(j)%measured()) cycle
        tried = .true.
        reached = reached .or. entries(j)%error <= target
      end do
      if (tried .and. .not. reached) call append(names, name_of(entries, k))
    end do
  end subroutine methods_short_of

  !> What an entry's method is called among those of all entries
  pure function name_of(entries, k) result(name)
    type(cost_entry_t), intent(in) :: entries(:)
    integer, intent(in) :: k
    character(len=:), allocatable :: name
    type(cost_method_t) :: short

    short = entries(k)%method%told_apart(entries%method)
    name = short%name()
  end function name_of

  pure function same_method(a, b) result(same)
    type(cost_method_t), intent(in) :: a, b
    logical :: same

    same = a%name() == b%name()
  end function same_method

end module calor_cost_verdict
