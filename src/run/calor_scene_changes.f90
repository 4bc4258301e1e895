!> What two versions of a scene differ in, as far as it matters to a run that is under way.
module calor_scene_changes
  use calor_scene_file, only: scene_file_t, group_t, entry_t, kind_text
  use calor_text, only: text_t, append, to_text
  implicit none (type, external)
  private

  public :: scene_changes

  !> What may change while a run is laid aside: keys, or all of a group
  character(len=*), parameter :: harmless(*) = [character(len=12) :: 'scene title', 'time end', &
      'output', 'checkpoint', 'operators', 'cost']
  !> A longer list of values is not quoted
  integer, parameter :: longest_quotation = 60

contains

  !> The changes that matter, one text for each: '&kernel support: 2.1, now 2.5'.
  function scene_changes(before, now) result(changes)
    !> The scene as it was, and as it is
    type(scene_file_t), intent(in) :: before, now
    type(text_t), allocatable :: changes(:)
    type(text_t), allocatable :: names(:)
    type(group_t) :: old, new
    integer :: k, number

    allocate (changes(0), names(0))
    call note_names(before)
    call note_names(now)
    do k = 1, size(names)
      if (is_harmless(names(k)%value)) cycle
      do number = 1, max(before%count(names(k)%value), now%count(names(k)%value))
        call before%group(names(k)%value, old, number)
        call now%group(names(k)%value, new, number)
        call compare_groups(old, new, &
                            max(before%count(names(k)%value), now%count(names(k)%value)) > 1, &
                            number, changes)
      end do
    end do

  contains

    subroutine note_names(file)
      type(scene_file_t), intent(in) :: file
      integer :: i, j

      do i = 1, size(file%groups)
        if (any([(names(j)%value == file%groups(i)%name, j=1, size(names))])) cycle
        call append(names, file%groups(i)%name)
      end do
    end subroutine note_names

  end function scene_changes

  pure function is_harmless(name) result(answer)
    !> A group, or a group and a key
    character(len=*), intent(in) :: name
    logical :: answer

    answer = any(harmless == name)
  end function is_harmless

  subroutine compare_groups(old, new, several, number, changes)
    !> The group in both versions
    type(group_t), intent(in) :: old, new
    !> Whether there are several of its name, and which one this is
    logical, intent(in) :: several
    integer, intent(in) :: number
    type(text_t), allocatable, intent(inout) :: changes(:)
    character(len=:), allocatable :: title, before, now
    integer :: k

    title = '&'
    if (old%line > 0) title = title//old%name
    if (old%line == 0) title = title//new%name
    if (several) title = title//' number '//to_text(number)
    if (old%line == 0) then
      if (matters(new)) call append(changes, title//': it was not there')
      return
    else if (new%line == 0) then
      if (matters(old)) call append(changes, title//': it is not there any more')
      return
    end if
    do k = 1, size(old%entries)
      if (is_harmless(old%name//' '//old%entries(k)%key)) cycle
      before = values_of(old%entries(k))
      now = 'not given'
      if (new%has(old%entries(k)%key)) now = values_of(new%entries(new%find(old%entries(k)%key)))
      if (now == before) cycle
      call append(changes, title//' '//old%entries(k)%key//': '//quoted(before)//', now '// &
                  quoted(now))
    end do
    do k = 1, size(new%entries)
      if (is_harmless(new%name//' '//new%entries(k)%key)) cycle
      if (old%has(new%entries(k)%key)) cycle
      call append(changes, title//' '//new%entries(k)%key//': not given, now '// &
                  quoted(values_of(new%entries(k))))
    end do
  end subroutine compare_groups

  !> Whether a group says anything that is not harmless.
  pure function matters(group) result(answer)
    type(group_t), intent(in) :: group
    logical :: answer
    integer :: k

    answer = size(group%entries) == 0
    do k = 1, size(group%entries)
      answer = answer .or. .not. is_harmless(group%name//' '//group%entries(k)%key)
    end do
  end function matters

  !> All values of a key, as the scene has them
  pure function values_of(entry) result(text)
    type(entry_t), intent(in) :: entry
    character(len=:), allocatable :: text
    integer :: k

    text = ''
    do k = 1, size(entry%values)
      if (k > 1) text = text//', '
      if (entry%values(k)%kind == kind_text) then
        text = text//''''//entry%values(k)%text//''''
      else
        text = text//entry%values(k)%text
      end if
    end do
  end function values_of

  pure function quoted(values) result(text)
    character(len=*), intent(in) :: values
    character(len=:), allocatable :: text

    text = values
    if (len(values) > longest_quotation) text = values(:longest_quotation)//' ...'
  end function quoted

end module calor_scene_changes
