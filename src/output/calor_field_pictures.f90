!> The pictures of a file that calor wrote: maps of its fields, and its heat budget over time.
module calor_field_pictures
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_budget_picture, only: budget_picture, budget_width, budget_height
  use calor_error, only: error_t, raise, status_bad_input
  use calor_field_map, only: field_map_t, make_field_map
  use calor_gnuplot, only: draw_picture, draw_animation, in_script
  use calor_kinds, only: wp
  use calor_map_picture, only: map_view_t, map_layout_t, lay_out, map_script, wrapped
  use calor_stored_fields, only: stored_fields_t
  use calor_text, only: text_t, append, join, to_text
  implicit none (type, external)
  private

  public :: draw_stored_fields, endings_t

  !> Points along the longer side of a map, its length in pixels, and letters in points: for a
  !> single picture, for each frame of a moving one, and for each of several maps in a picture
  integer, parameter :: single(*) = [420, 760, 16], frame(*) = [220, 500, 12], &
                        several(*) = [240, 400, 16]
  !> Frames of a moving picture, and how long each stays, s
  integer, parameter :: most_frames = 60
  real(wp), parameter :: frame_seconds = 0.15_wp
  !> The part of all values, at each end, that may lie beyond the colours where schemes fail at
  !> walls
  real(wp), parameter :: beyond = 0.02_wp

  !> The files to be written
  type :: endings_t
    !> Name without ending
    character(len=:), allocatable :: stem
    !> '.png' and '.svg', or one of them
    type(text_t), allocatable :: ending(:)
  end type endings_t

  character(len=*), parameter :: end = new_line('a')

contains

  !> Draw what a file holds: one field as a map, or as a moving one; without a field's name the
  !> temperature and the heat budget, or all that `calor operators` wrote.
  subroutine draw_stored_fields(path, field, time, animate, files, written, error)
    !> The file, known to be there
    character(len=*), intent(in) :: path
    !> The field; '' for what is natural
    character(len=*), intent(in) :: field
    !> The time, s; negative for the last
    real(wp), intent(in) :: time
    !> Whether all times are drawn, into a GIF
    logical, intent(in) :: animate
    !> What to write
    type(endings_t), intent(in) :: files
    !> What was written, each with what it shows
    type(text_t), allocatable, intent(inout) :: written(:)
    !> The file is damaged or none of calor's, there is no such field or time, no gnuplot, or a
    !> picture cannot be written
    type(error_t), allocatable, intent(out) :: error
    type(stored_fields_t) :: stored
    integer :: step

    call stored%open(path, error)
    if (allocated(error)) return
    call find_step(stored, time, step, error)
    if (.not. allocated(error)) then
      if (field == '' .and. .not. stored%has('temperature')) then
        call draw_derivatives(stored, files, written, error)
      else if (animate) then
        call draw_frames(stored, default_field(field), files, written, error)
      else
        call draw_field(stored, default_field(field), step, files, written, error)
        if (.not. allocated(error) .and. field == '') then
          call draw_budget(stored, files, written, error)
        end if
      end if
    end if
    call stored%close()
  end subroutine draw_stored_fields

  pure function default_field(field) result(name)
    character(len=*), intent(in) :: field
    character(len=:), allocatable :: name

    name = field
    if (name == '') name = 'temperature'
  end function default_field

  !> The step nearest to a time.
  subroutine find_step(stored, time, step, error)
    type(stored_fields_t), intent(in) :: stored
    real(wp), intent(in) :: time
    integer, intent(out) :: step
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: slack

    step = size(stored%time)
    if (time < 0) return
    associate (first => stored%time(1), last => stored%time(size(stored%time)))
      slack = 1.0e-9_wp*max(abs(last), tiny(1.0_wp))
      if (time < first - slack .or. time > last + slack) then
        call raise(error, status_bad_input, 'The file '''//stored%path//''' has no time '// &
                   to_text(time)//' s: its times are '//to_text(first, digits=6)//' to '// &
                   to_text(last, digits=6)//' s.')
        return
      end if
    end associate
    step = minloc(abs(stored%time - time), 1)
  end subroutine find_step

  !> One field at one time
  subroutine draw_field(stored, field, step, files, written, error)
    type(stored_fields_t), intent(in) :: stored
    character(len=*), intent(in) :: field
    integer, intent(in) :: step
    type(endings_t), intent(in) :: files
    type(text_t), allocatable, intent(inout) :: written(:)
    type(error_t), allocatable, intent(out) :: error
    type(field_map_t) :: map
    type(map_layout_t) :: layout
    type(map_view_t) :: view
    real(wp), allocatable :: values(:)

    call read_view(stored, field, step, view, values, error)
    if (allocated(error)) return
    call prepare_map(stored, step, single(1), map, error)
    if (allocated(error)) return
    layout = lay_out(map, 1, single(2), single(3), 2)
    view%title = heading(stored, layout, moment(stored, step))
    layout = lay_out(map, 1, single(2), single(3), line_count(view%title))
    view%low = minval(values)
    view%high = maxval(values)
    call put_on_grid(stored, field, map, values, view)
    call write_pictures(files, '', layout%width, layout%height, &
                        map_script(map, view, layout, 1), field//moment(stored, step), written, &
                        error)
  end subroutine draw_field

  !> One field at all times, or at some of them evenly chosen
  subroutine draw_frames(stored, field, files, written, error)
    type(stored_fields_t), intent(in) :: stored
    character(len=*), intent(in) :: field
    type(endings_t), intent(in) :: files
    type(text_t), allocatable, intent(inout) :: written(:)
    type(error_t), allocatable, intent(out) :: error
    type(field_map_t) :: map
    type(map_layout_t) :: layout
    type(map_view_t), allocatable :: view(:)
    real(wp), allocatable :: values(:), x(:), y(:), old_x(:), old_y(:)
    character(len=:), allocatable :: script
    integer, allocatable :: steps(:)
    integer :: k, frames
    logical :: moved

    frames = min(most_frames, size(stored%time))
    steps = [(1 + ((k - 1)*(size(stored%time) - 1))/max(1, frames - 1), k=1, frames)]
    allocate (view(frames))
    do k = 1, frames
      call read_view(stored, field, steps(k), view(k), values, error)
      if (allocated(error)) return
      view(k)%low = minval(values)
      view(k)%high = maxval(values)
    end do
    view%low = minval(view%low)
    view%high = maxval(view%high)
    script = ''
    do k = 1, frames
      call stored%read_places(steps(k), x, y, error)
      if (allocated(error)) return
      moved = k == 1
      if (.not. moved) moved = any(abs(x - old_x) > 0) .or. any(abs(y - old_y) > 0)
      if (moved) call prepare_map(stored, steps(k), frame(1), map, error)
      if (allocated(error)) return
      old_x = x
      old_y = y
      if (k == 1) then
        layout = lay_out(map, 1, frame(2), frame(3), 2)
        layout = lay_out(map, 1, frame(2), frame(3), &
                         line_count(heading(stored, layout, moment(stored, 1))))
      end if
      view(k)%title = heading(stored, layout, moment(stored, steps(k)))
      call stored%read_field(field, steps(k), values, error)
      if (allocated(error)) return
      call put_on_grid(stored, field, map, values, view(k))
      script = script//map_script(map, view(k), layout, 1)
      deallocate (view(k)%values)
    end do
    call draw_animation(files%stem//'.gif', layout%width, layout%height, frame_seconds, script, &
                        error)
    if (.not. allocated(error)) then
      call append(written, files%stem//'.gif: '//field//' at '//to_text(frames)// &
                  trim(merge(' time ', ' times', frames == 1)))
    end if
  end subroutine draw_frames

  !> The field and all derivatives, side by side
  subroutine draw_derivatives(stored, files, written, error)
    type(stored_fields_t), intent(in) :: stored
    type(endings_t), intent(in) :: files
    type(text_t), allocatable, intent(inout) :: written(:)
    type(error_t), allocatable, intent(out) :: error
    type(text_t), allocatable :: names(:)
    type(field_map_t) :: map
    type(map_layout_t) :: layout
    type(map_view_t) :: view
    real(wp), allocatable :: values(:)
    character(len=:), allocatable :: script, subject
    integer :: k, step

    allocate (names(0))
    if (stored%has('field')) call append(names, 'field')
    do k = 1, size(stored%field)
      associate (name => stored%field(k)%value)
        if (name == 'volume' .or. name == 'field' .or. stored%is_integer(name)) cycle
        call append(names, name)
      end associate
    end do
    if (size(names) == 0) then
      call raise(error, &
                 status_bad_input, 'The file '''//stored%path//''' has no field that can '// &
                 'be drawn by itself. It has '//join(stored%field, ', ')//': choose one by '// &
                 '--field.')
      return
    end if
    step = size(stored%time)
    call prepare_map(stored, step, several(1), map, error)
    if (allocated(error)) return
    layout = lay_out(map, size(names), several(2), several(3), 1)
    script = 'set multiplot title "'//in_script(stored%title)//'" noenhanced font ",20"'//end
    do k = 1, size(names)
      call read_view(stored, names(k)%value, step, view, values, error)
      if (allocated(error)) return
      view%title = view%label
      view%label = ''
      call find_usual_range(values, view%low, view%high)
      values = max(view%low, min(view%high, values))
      call put_on_grid(stored, names(k)%value, map, values, view)
      script = script//map_script(map, view, layout, k)
    end do
    subject = 'all fields'
    if (stored%has('field')) subject = 'the field and its derivatives'
    call write_pictures(files, '', layout%width, layout%height, script//'unset multiplot'//end, &
                        subject, written, error)
  end subroutine draw_derivatives

  !> The range without the few values at its ends
  subroutine find_usual_range(values, low, high)
    real(wp), intent(in) :: values(:)
    real(wp), intent(out) :: low, high
    real(wp) :: from, to, middle, least, most
    integer :: k, round

    least = minval(values)
    most = maxval(values)
    ! Bisection for both quantiles
    do k = 1, 2
      from = least
      to = most
      do round = 1, 60
        middle = 0.5_wp*(from + to)
        if (count(values <= middle) > merge(beyond, 1 - beyond, k == 1)*size(values)) then
          to = middle
        else
          from = middle
        end if
      end do
      if (k == 1) low = to
      if (k == 2) high = to
    end do
    ! A range that is hardly narrower is kept whole.
    if (most - least < 1.5_wp*(high - low)) then
      low = least
      high = most
    end if
  end subroutine find_usual_range

  subroutine draw_budget(stored, files, written, error)
    type(stored_fields_t), intent(in) :: stored
    type(endings_t), intent(in) :: files
    type(text_t), allocatable, intent(inout) :: written(:)
    type(error_t), allocatable, intent(out) :: error
    type(text_t), allocatable :: account(:)
    real(wp), allocatable :: time(:), power(:, :), one(:), stored_rate(:), content(:)
    integer :: k

    time = stored%series('budget_time')
    account = stored%accounts()
    stored_rate = stored%series('budget_stored_rate')
    content = stored%series('budget_stored')
    ! A curve begins with three states.
    if (size(time) < 3 .or. size(account) == 0) return
    if (size(stored_rate) /= size(time) .or. size(content) /= size(time)) return
    allocate (power(size(time), size(account)))
    do k = 1, size(account)
      one = stored%series('budget_'//account(k)%value)
      if (size(one) /= size(time)) return
      power(:, k) = one
    end do
    call choose_accounts(account, power)
    call write_pictures(files, '_budget', budget_width, budget_height, &
                        budget_picture(stored%title, account, time, power, &
                                       stored_rate, content), &
                        'heat budget over time', written, error)
  end subroutine draw_budget

  !> Leave out what no heat passes through at any time, and count numbered ones as people do.
  subroutine choose_accounts(account, power)
    !> Names in the order of letters: 'edge 10' before 'edge 2'
    type(text_t), allocatable, intent(inout) :: account(:)
    !> Heat by time and account
    real(wp), allocatable, intent(inout) :: power(:, :)
    integer, allocatable :: order(:)
    integer :: k, place

    allocate (order(0))
    do k = 1, size(account)
      if (.not. any(abs(power(:, k)) > 0)) cycle
      place = size(order)
      do while (place > 0)
        if (.not. counts_before(account(k)%value, account(order(place))%value)) exit
        place = place - 1
      end do
      order = [order(:place), k, order(place + 1:)]
    end do
    if (size(order) == 0) return
    account = account(order)
    power = power(:, order)
  end subroutine choose_accounts

  !> Whether both names are one with a number, and this number is the smaller one.
  pure function counts_before(name, other) result(answer)
    character(len=*), intent(in) :: name, other
    logical :: answer
    integer :: blank

    answer = .false.
    blank = scan(name, ' _', back=.true.)
    if (blank < 2 .or. blank /= scan(other, ' _', back=.true.)) return
    answer = name(:blank) == other(:blank) .and. len(name) < len(other)
  end function counts_before

  !> A field, and how it is called
  subroutine read_view(stored, field, step, view, values, error)
    type(stored_fields_t), intent(in) :: stored
    character(len=*), intent(in) :: field
    integer, intent(in) :: step
    type(map_view_t), intent(out) :: view
    real(wp), allocatable, intent(out) :: values(:)
    type(error_t), allocatable, intent(out) :: error
    logical :: is_vector

    call stored%read_field(field, step, values, error, is_vector)
    if (allocated(error)) return
    if (.not. all(ieee_is_finite(values))) then
      call raise(error, status_bad_input, 'The field '''//field//''' of '''//stored%path// &
                 ''' has no value at some particles'//moment(stored, step)// &
                 ': choose another --time or --field.')
      return
    end if
    view%label = label_of(field)
    if (is_vector) view%label = '|'//view%label//'|'
    view%lines = .not. by_particle(stored, field)
    view%whole_numbers = stored%is_integer(field)
    view%signed = field == 'error' .or. field == 'error_estimate'
  end subroutine read_view

  !> Whether a field belongs to single particles and their rows: there is nothing between them.
  function by_particle(stored, field) result(answer)
    type(stored_fields_t), intent(in) :: stored
    character(len=*), intent(in) :: field
    logical :: answer

    select case (field)
    case ('volume', 'row_quality', 'support_radius', 'condition_gradient', 'condition_laplacian')
      answer = .true.
    case default
      answer = stored%is_integer(field)
    end select
  end function by_particle

  pure function label_of(field) result(label)
    character(len=*), intent(in) :: field
    character(len=:), allocatable :: label

    select case (field)
    case ('temperature')
      label = 'temperature, K'
    case ('exact')
      label = 'true temperature, K'
    case ('error')
      label = 'error of the temperature, K'
    case ('error_estimate')
      label = 'estimated error of the temperature, K'
    case ('temperature_corrected')
      label = 'corrected temperature, K'
    case ('liquid_fraction')
      label = 'liquid fraction'
    case ('volume')
      label = 'area of a particle, m²'
    case ('support_radius')
      label = 'support radius, m'
    case ('row_quality')
      label = 'row quality'
    case ('row_repair')
      label = 'repair of the row'
    case ('condition_gradient')
      label = 'condition number, first derivative'
    case ('condition_laplacian')
      label = 'condition number, second derivative'
    case default
      label = field
    end select
  end function label_of

  subroutine prepare_map(stored, step, points, map, error)
    type(stored_fields_t), intent(in) :: stored
    integer, intent(in) :: step, points
    type(field_map_t), intent(out) :: map
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: x(:), y(:)

    call stored%read_places(step, x, y, error)
    if (allocated(error)) return
    if (.not. spacing_of(stored, x, y) > 0) then
      call raise(error, status_bad_input, 'All particles of '''//stored%path// &
                 ''' are at one place: there is no map to draw.')
      return
    end if
    call make_field_map(x, y, spacing_of(stored, x, y), points, on_wall(stored), map)
  end subroutine prepare_map

  !> Which particles lie on walls; none where the file does not say
  function on_wall(stored) result(wall)
    type(stored_fields_t), intent(in) :: stored
    logical, allocatable :: wall(:)
    type(error_t), allocatable :: error
    real(wp), allocatable :: values(:)
    integer :: k

    allocate (wall(stored%particles), source=.false.)
    if (.not. stored%has('wall')) return
    call stored%read_field('wall', 1, values, error)
    if (allocated(error)) return
    do k = 1, size(wall)
      if (ieee_is_finite(values(k))) wall(k) = values(k) > 0.5_wp
    end do
  end function on_wall

  !> What the file says, or what would spread the particles evenly over their extent
  pure function spacing_of(stored, x, y) result(spacing)
    type(stored_fields_t), intent(in) :: stored
    real(wp), intent(in) :: x(:), y(:)
    real(wp) :: spacing
    real(wp) :: extent

    spacing = stored%spacing
    extent = max(maxval(x) - minval(x), maxval(y) - minval(y))
    if (spacing > 0 .and. spacing <= extent) return
    spacing = extent/sqrt(real(size(x), wp))
  end function spacing_of

  subroutine put_on_grid(stored, field, map, values, view)
    type(stored_fields_t), intent(in) :: stored
    character(len=*), intent(in) :: field
    type(field_map_t), intent(in) :: map
    real(wp), intent(in) :: values(:)
    type(map_view_t), intent(inout) :: view

    if (by_particle(stored, field)) then
      call map%nearest_values(values, view%values)
    else
      call map%values(values, view%values)
    end if
  end subroutine put_on_grid

  !> ' at t = 0.05 s'; nothing where there is but one time, of a steady state perhaps
  pure function moment(stored, step) result(text)
    type(stored_fields_t), intent(in) :: stored
    integer, intent(in) :: step
    character(len=:), allocatable :: text

    text = ''
    if (size(stored%time) > 1) text = ' at t = '//to_text(stored%time(step), digits=6)//' s'
  end function moment

  !> The scene's title in as many lines as it needs, and the time
  pure function heading(stored, layout, when) result(text)
    type(stored_fields_t), intent(in) :: stored
    type(map_layout_t), intent(in) :: layout
    character(len=*), intent(in) :: when
    character(len=:), allocatable :: text

    text = wrapped(stored%title, max(12, nint(1.5_wp*layout%width/layout%letters)))
    if (when == '') return
    if (text /= '') text = text//end
    text = text//when(5:)
  end function heading

  pure function line_count(text) result(lines)
    character(len=*), intent(in) :: text
    integer :: lines
    integer :: k

    lines = 1
    do k = 1, len(text)
      if (text(k:k) == end) lines = lines + 1
    end do
  end function line_count

  subroutine write_pictures(files, suffix, width, height, script, content, written, error)
    type(endings_t), intent(in) :: files
    character(len=*), intent(in) :: suffix, script, content
    integer, intent(in) :: width, height
    type(text_t), allocatable, intent(inout) :: written(:)
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: path
    integer :: k

    do k = 1, size(files%ending)
      path = files%stem//suffix//files%ending(k)%value
      call draw_picture(path, width, height, script, error)
      if (allocated(error)) return
      call append(written, path//': '//content)
    end do
  end subroutine write_pictures

end module calor_field_pictures
