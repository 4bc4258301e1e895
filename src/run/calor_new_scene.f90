!> A commented scene to start from, written into a file.
module calor_new_scene
  use calor_choice, only: choice_names
  use calor_error, only: error_t, raise, status_bad_input
  use calor_file_system, only: look_at_path, path_missing
  use calor_starting_scenes, only: starting_scenes, starting_scene, own_particles
  use calor_text, only: text_t, append, suggestion
  use calor_whole_file, only: write_whole_file
  implicit none (type, external)
  private

  public :: write_new_scene, describe_starting_scenes

  character(len=*), parameter :: end = new_line('a')

contains

  !> What there is.
  function describe_starting_scenes() result(lines)
    type(text_t), allocatable :: lines(:)
    integer :: k

    call append(lines, 'Scenes to start from:')
    do k = 1, size(starting_scenes)
      call append(lines, '  '//starting_scenes(k)%name(1:16)//trim(starting_scenes(k)%summary))
    end do
    call append(lines, '')
    call append(lines, 'calor new KIND writes one as KIND.nml, calor new KIND NAME as NAME.nml.')
  end function describe_starting_scenes

  !> Write a commented scene into a new file.
  subroutine write_new_scene(kind, name, written, error)
    !> One of the table of starting scenes
    character(len=*), intent(in) :: kind
    !> Name of the scene, with or without the ending .nml
    character(len=*), intent(in) :: name
    !> The files written, the scene first
    type(text_t), allocatable, intent(out) :: written(:)
    !> There is no such kind, the name is empty, there is such a file already, or it cannot be
    !> written
    type(error_t), allocatable, intent(out) :: error
    type(text_t), allocatable :: lines(:)
    character(len=:), allocatable :: stem, title, text
    integer :: k

    allocate (written(0))
    if (.not. any(starting_scenes%name == kind)) then
      call raise(error, status_bad_input, 'There is no scene '''//kind//''' to start from.'// &
                 suggestion(kind, choice_names(starting_scenes))//' calor new lists what there '// &
                 'is; calor new plate NAME writes a plate as NAME.nml.')
      return
    end if
    stem = name
    if (len(name) > 4) then
      if (name(len(name) - 3:) == '.nml') stem = name(:len(name) - 4)
    end if
    title = stem(index(stem, '/', back=.true.) + 1:)
    if (title == '') then
      call raise(error, status_bad_input, 'A scene needs a name, as in ''calor new plate a'', '// &
                 'but '''//name//''' has none.')
      return
    end if
    call check_free(stem//'.nml', error)
    if (.not. allocated(error) .and. kind == 'cloud') call check_free(stem//'.csv', error)
    if (allocated(error)) return
    lines = starting_scene(kind)
    text = ''
    do k = 1, size(lines)
      text = text//filled(lines(k)%value, in_quotes(title))//end
    end do
    ! What the scene reads is there before the scene is.
    if (kind == 'cloud') call write_whole_file(stem//'.csv', own_particles(), error)
    if (.not. allocated(error)) call write_whole_file(stem//'.nml', text, error)
    if (allocated(error)) return
    call append(written, stem//'.nml')
    if (kind == 'cloud') call append(written, stem//'.csv')
  end subroutine write_new_scene

  subroutine check_free(path, error)
    character(len=*), intent(in) :: path
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: reason
    integer :: what

    call look_at_path(path, what, reason)
    if (what == path_missing) return
    call raise(error, status_bad_input, 'The file '//path// &
               ' is there already: choose another name, or move it away.')
  end subroutine check_free

  !> A word as it stands between quotes: each quote in it twice.
  pure function in_quotes(word) result(text)
    character(len=*), intent(in) :: word
    character(len=:), allocatable :: text
    integer :: k

    text = ''
    do k = 1, len(word)
      text = text//word(k:k)
      if (word(k:k) == '''') text = text//''''
    end do
  end function in_quotes

  !> A line with @ replaced by a word.
  pure function filled(line, word) result(text)
    character(len=*), intent(in) :: line, word
    character(len=:), allocatable :: text
    integer :: mark

    text = trim(line)
    mark = index(text, '@')
    if (mark > 0) text = text(:mark - 1)//word//text(mark + 1:)
  end function filled

end module calor_new_scene
