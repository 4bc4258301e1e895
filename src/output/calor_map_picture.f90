!> Maps of fields as pictures: colours, a colour bar, lines of equal value, axes in metres.
!>
!> The colours are viridis (S. van der Walt, N. Smith, 2015): equal steps of a value look equally
!> large, in grey too and to those who see few colours. Signed fields, as errors are, have colours
!> that diverge from a pale one at 0: ColorBrewer's RdBu (C. Brewer, M. Harrower, 2003).
module calor_map_picture
  use calor_field_map, only: field_map_t
  use calor_gnuplot, only: in_script
  use calor_isolines, only: find_isolines, even_levels
  use calor_kinds, only: wp
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: map_view_t, map_layout_t, lay_out, map_script, wrapped

  character(len=*), parameter :: end = new_line('a')

  character(len=*), parameter :: viridis(*) = [character(len=7) :: &
      '#440154', '#482475', '#414487', '#355f8d', '#2a788e', '#21918c', '#22a884', '#44bf70', &
      '#7ad151', '#bddf26', '#fde725']

  !> From blue for negative values to red for positive ones
  character(len=7), parameter :: diverging(*) = [character(len=7) :: &
      '#053061', '#2166ac', '#4393c3', '#92c5de', '#d1e5f0', '#f7f7f7', '#fddbc7', '#f4a582', &
      '#d6604d', '#b2182b', '#67001f']

  !> A field to draw
  type :: map_view_t
    !> Above the map, and beside the colour bar
    character(len=:), allocatable :: title, label
    !> On the grid, by column and row
    real(wp), allocatable :: values(:, :)
    !> The values at the ends of the colour bar
    real(wp) :: low = 0.0_wp, high = 1.0_wp
    !> Whether lines of equal value are drawn
    logical :: lines = .true.
    !> Whether the values are whole numbers, so that the colour bar has marks at such only
    logical :: whole_numbers = .false.
    !> Whether the colours diverge from 0
    logical :: signed = .false.
  end type map_view_t

  !> Where maps stand in a picture; lengths in pixels
  type :: map_layout_t
    !> The picture
    integer :: width = 0, height = 0
    !> Maps beside and above each other
    integer :: across = 1, down = 1
    !> The axes of a map
    integer :: map_width = 0, map_height = 0
    !> Room about them
    integer :: left = 0, right = 0, top = 0, bottom = 0
    !> Room for a headline over all maps
    integer :: head = 0
    !> Whether the colour bar lies under the map
    logical :: bar_below = .false.
    !> Size of letters, points
    integer :: letters = 16
  end type map_layout_t

contains

  !> Find room for maps of a grid.
  pure function lay_out(map, maps, longest, letters, lines_of_title) result(layout)
    !> The grid
    type(field_map_t), intent(in) :: map
    !> How many maps of it are drawn
    integer, intent(in) :: maps
    !> The longer side of a map, pixels
    integer, intent(in) :: longest
    !> Size of letters, points
    integer, intent(in) :: letters
    !> Lines above a map
    integer, intent(in) :: lines_of_title
    type(map_layout_t) :: layout
    !> A map may be wider than high by this factor before the bar goes below
    real(wp), parameter :: flat = 2.2_wp
    !> Thin bodies keep so much room, in letters
    integer, parameter :: thinnest = 3, least_width = 30
    real(wp) :: aspect
    integer :: room, unit

    layout%letters = letters
    ! Points are larger than pixels.
    unit = (4*letters)/3
    aspect = real(map%columns, wp)/map%rows
    layout%map_width = nint(longest*min(1.0_wp, aspect))
    layout%map_height = nint(longest/max(1.0_wp, aspect))
    ! A square map is smaller than a long one.
    if (aspect > 0.6_wp .and. aspect < 1.6_wp) then
      layout%map_width = nint(0.85_wp*layout%map_width)
      layout%map_height = nint(0.85_wp*layout%map_height)
    end if
    layout%map_width = max(layout%map_width, thinnest*unit)
    layout%map_height = max(layout%map_height, thinnest*unit)
    layout%bar_below = aspect > flat
    layout%left = 8*unit
    layout%top = nint((1.2_wp + 1.7_wp*lines_of_title)*unit)
    layout%bottom = 4*unit
    layout%right = 9*unit
    if (layout%bar_below) then
      layout%right = 3*unit
      layout%bottom = nint(10.5_wp*unit)
    end if
    ! The title of a narrow map needs room too.
    room = least_width*unit - layout%left - layout%right - layout%map_width
    if (room > 0 .and. maps == 1) then
      layout%left = layout%left + room/2
      layout%right = layout%right + room - room/2
    end if
    layout%across = maps
    if (maps > 2) layout%across = merge(1, ceiling(sqrt(real(maps, wp))), layout%bar_below)
    layout%down = (maps + layout%across - 1)/layout%across
    if (maps > 1) layout%head = 3*unit
    layout%width = layout%across*(layout%left + layout%map_width + layout%right)
    layout%height = layout%head + layout%down*(layout%top + layout%map_height + layout%bottom)
  end function lay_out

  !> The script of one map, in gnuplot's language, with all numbers in it.
  function map_script(map, view, layout, place) result(script)
    !> The grid
    type(field_map_t), intent(in) :: map
    !> What is drawn on it
    type(map_view_t), intent(in) :: view
    !> Where maps stand
    type(map_layout_t), intent(in) :: layout
    !> The number of this one
    integer, intent(in) :: place
    character(len=:), allocatable :: script
    real(wp), allocatable :: levels(:)
    logical, allocatable :: on_dark(:)
    real(wp) :: low, high, margin

    levels = even_levels(view%low, view%high)
    low = view%low
    high = view%high
    if (size(levels) == 0) then
      ! A colour bar needs some width.
      margin = max(abs(low)*1.0e-3_wp, 1.0e-12_wp)
      low = low - margin
      high = high + margin
    end if
    script = '$map << end_of_data'//end//grid_text(map, view%values)//'end_of_data'//end// &
             '$dark << end_of_data'//end
    ! Lines are seen on their ground: light on dark colours, dark on light ones.
    on_dark = levels < 0.5_wp*(low + high)
    if (view%signed) on_dark = abs(levels) > 0.6_wp*max(abs(low), abs(high))
    if (view%lines) script = script//lines_text(map, view, pack(levels, on_dark))
    script = script//'end_of_data'//end//'$light << end_of_data'//end
    if (view%lines) script = script//lines_text(map, view, pack(levels, .not. on_dark))
    script = script//'end_of_data'//end//frame_script(map, view, layout, place, levels, low, high)
    script = script//'plot $map matrix using ('//number(map%x0)//'+$1*'//number(map%step)//'):('// &
             number(map%y0)//'+$2*'//number(map%step)//'):3 with image notitle'
    if (view%lines) script = script// &
        ', $dark using 1:2 with lines linewidth 0.8 linecolor "#f0f0f0" notitle'// &
        ', $light using 1:2 with lines linewidth 0.8 linecolor "#303030" notitle'
    script = script//end
  end function map_script

  !> Axes, colour bar and words about a map
  function frame_script(map, view, layout, place, levels, low, high) result(script)
    type(field_map_t), intent(in) :: map
    type(map_view_t), intent(in) :: view
    type(map_layout_t), intent(in) :: layout
    integer, intent(in) :: place
    real(wp), intent(in) :: levels(:), low, high
    character(len=:), allocatable :: script
    real(wp) :: x(2), y(2), edge(2), bar(4), unit
    integer :: column, row, k, power

    power = 0
    if (.not. view%whole_numbers) power = common_power(levels)
    column = mod(place - 1, layout%across)
    row = (place - 1)/layout%across
    ! A little more, so that rounding hides no mark at an end
    x = map%x0 + [-0.501_wp, map%columns - 0.499_wp]*map%step
    y = map%y0 + [-0.501_wp, map%rows - 0.499_wp]*map%step
    ! The lower left corner of the axes, from the lower left corner of the picture
    edge = [real(column*(layout%left + layout%map_width + layout%right) + layout%left, wp), &
            layout%height - layout%head - real(row*(layout%top + layout%map_height + &
                                              layout%bottom) + layout%top + layout%map_height, wp)]
    script = 'set lmargin at screen '//part(edge(1), layout%width)//end// &
             'set rmargin at screen '//part(edge(1) + layout%map_width, layout%width)//end// &
             'set bmargin at screen '//part(edge(2), layout%height)//end// &
             'set tmargin at screen '//part(edge(2) + layout%map_height, layout%height)//end// &
             'set xrange ['//number(x(1))//':'//number(x(2))//']'//end// &
             'set yrange ['//number(y(1))//':'//number(y(2))//']'//end// &
             'set cbrange ['//number(low)//':'//number(high)//']'//end// &
             palette(view%signed, low, high)
    unit = (4*layout%letters)/3
    if (layout%bar_below) then
      bar = [edge(1), edge(2) - 5.5_wp*unit, real(layout%map_width, wp), unit]
      script = script//'set colorbox horizontal'
    else
      bar = [edge(1) + layout%map_width + unit, edge(2), unit, real(layout%map_height, wp)]
      script = script//'set colorbox vertical'
    end if
    script = script//' user origin '//part(bar(1), layout%width)//','// &
             part(bar(2), layout%height)//' size '//part(bar(3), layout%width)//','// &
             part(bar(4), layout%height)//end// &
             'set title "'//in_script(view%title)//'" noenhanced'//end// &
             'set xlabel "x, m"'//end//'set ylabel "y, m"'//end// &
             bar_label()// &
             'set tics out nomirror'//end//'set border 3 linewidth 0.7'//end//'unset key'//end// &
             'set xtics '//tics(x(2) - x(1), layout%map_width/(6*layout%letters))//end// &
             'set ytics '//tics(y(2) - y(1), layout%map_height/(3*layout%letters))//end// &
             'set xlabel offset 0,0.3'//end//'set format cb "%g"'//end//'set cbtics autofreq'//end
    if (size(levels) == 0) then
      script = script//'set cbtics ("'//to_text(view%low, digits=6)//'" '//number(view%low)//')'// &
               end
    else if (.not. view%whole_numbers) then
      script = script//'set cbtics ('
      do k = 1, size(levels)
        if (k > 1) script = script//','
        script = script//'"'//to_text(levels(k)*10.0_wp**(-power), digits=6)//'" '// &
                 number(levels(k))
      end do
      script = script//')'//end
    end if

  contains

    !> What the bar shows. Beside it gnuplot would reckon with marks of some length of its own.
    function bar_label() result(text)
      character(len=:), allocatable :: text
      !> A letter's width in units, and from bar to marks and from these to the middle of the label
      real(wp), parameter :: letter = 0.59_wp, gaps = 2.1_wp
      integer :: letters, m

      text = in_script(in_powers(view%label, power))
      if (layout%bar_below) then
        text = 'unset label'//end//'set cblabel "'//text//'" noenhanced'//end
        return
      end if
      letters = 3
      if (.not. view%whole_numbers) then
        do m = 1, size(levels)
          letters = max(letters, len(to_text(levels(m)*10.0_wp**(-power), digits=6)))
        end do
      end if
      text = 'unset label'//end//'unset cblabel'//end//'set label "'//text//'" at screen '// &
             part(bar(1) + bar(3) + (gaps + letters*letter)*unit, layout%width)//','// &
             part(bar(2) + 0.5_wp*bar(4), layout%height)//' center rotate noenhanced'//end
    end function bar_label

  end function frame_script

  !> Colours by value, and the values at both ends. Those of a signed field reach equally far to
  !> both sides of 0, and the bar shows the part that there is.
  pure function palette(signed, low, high) result(script)
    logical, intent(in) :: signed
    real(wp), intent(in) :: low, high
    character(len=:), allocatable :: script
    character(len=len(viridis)) :: colour(size(viridis))
    real(wp) :: from, to, part, least, most
    integer :: first, last, k

    least = low
    most = high
    colour = viridis
    if (signed) then
      most = max(abs(low), abs(high))
      least = -most
      colour = diverging
    end if
    ! gnuplot spreads a palette over the bar: only the colours of the bar are handed over, with
    ! those at its ends mixed from their neighbours.
    from = (size(colour) - 1)*(low - least)/(most - least)
    to = (size(colour) - 1)*(high - least)/(most - least)
    first = floor(from) + 1
    last = ceiling(to) - 1
    script = 'set palette defined ('//number(from)//' '//mixed(colour, from)
    do k = first, last
      part = k
      script = script//','//number(part)//' "'//colour(k + 1)//'"'
    end do
    script = script//','//number(to)//' '//mixed(colour, to)//')'//end
  end function palette

  !> The colour at a place in a list that is counted from 0, between two of it perhaps
  pure function mixed(colour, place) result(text)
    character(len=*), intent(in) :: colour(:)
    real(wp), intent(in) :: place
    character(len=:), allocatable :: text
    character(len=*), parameter :: digits = '0123456789abcdef'
    integer :: before, k, one, other, light

    before = max(0, min(size(colour) - 2, floor(place)))
    text = '"#'
    do k = 2, 6, 2
      one = light_of(colour(before + 1)(k:k + 1))
      other = light_of(colour(before + 2)(k:k + 1))
      light = max(0, min(255, nint(one + (place - before)*(other - one))))
      text = text//digits(light/16 + 1:light/16 + 1)//digits(mod(light, 16) + 1:mod(light, 16) + 1)
    end do
    text = text//'"'

  contains

    pure integer function light_of(pair)
      character(len=2), intent(in) :: pair

      light_of = 16*(index(digits, pair(1:1)) - 1) + index(digits, pair(2:2)) - 1
    end function light_of

  end function mixed

  !> The power of ten, a multiple of 3, that numbers are told in where they are too long otherwise
  pure function common_power(numbers) result(power)
    real(wp), intent(in) :: numbers(:)
    integer :: power
    integer, parameter :: most_letters = 5
    integer :: k

    power = 0
    do k = 1, size(numbers)
      if (len(to_text(numbers(k), digits=6)) <= most_letters) cycle
      power = 3*floor(log10(maxval(abs(numbers)))/3)
      return
    end do
  end function common_power

  !> A quantity whose numbers are told in a power of ten: 'temperature, 10⁻³ K'
  pure function in_powers(label, power) result(text)
    !> The quantity, and its unit behind the last comma
    character(len=*), intent(in) :: label
    integer, intent(in) :: power
    character(len=:), allocatable :: text
    character(len=3), parameter :: raised(0:9) = ['⁰', '¹ ', '² ', '³ ', '⁴', '⁵', '⁶', &
        '⁷', '⁸', '⁹']
    character(len=:), allocatable :: digits, factor
    integer :: comma, k

    text = label
    if (power == 0 .or. label == '') return
    digits = to_text(abs(power))
    factor = '10'
    if (power < 0) factor = factor//'⁻'
    do k = 1, len(digits)
      factor = factor//trim(raised(index('0123456789', digits(k:k)) - 1))
    end do
    comma = index(label, ', ', back=.true.)
    if (comma == 0) then
      text = label//', '//factor
    else
      text = label(:comma + 1)//factor//' '//label(comma + 2:)
    end if
  end function in_powers

  !> A step between marks on an axis, 1, 2 or 5 times a power of ten
  pure function tics(extent, most) result(text)
    real(wp), intent(in) :: extent
    !> So many have room
    integer, intent(in) :: most
    character(len=:), allocatable :: text
    real(wp), parameter :: steps(*) = [1.0_wp, 2.0_wp, 5.0_wp, 10.0_wp]
    real(wp) :: decade
    integer :: k, parts

    parts = max(2, min(6, most))
    decade = 10.0_wp**floor(log10(extent/parts))
    do k = 1, size(steps) - 1
      if (extent/(steps(k)*decade) <= parts + 0.5_wp) exit
    end do
    text = number(steps(k)*decade)
  end function tics

  pure function part(length, whole) result(text)
    real(wp), intent(in) :: length
    integer, intent(in) :: whole
    character(len=:), allocatable :: text

    text = to_text(length/whole, digits=6)
  end function part

  pure function number(value) result(text)
    real(wp), intent(in) :: value
    character(len=:), allocatable :: text

    text = to_text(value, digits=12)
    ! gnuplot divides whole numbers as such, and takes 1e400 for none.
    if (verify(text, '-0123456789') == 0) text = text//'.0'
  end function number

  !> A matrix of numbers, NaN outside the body
  function grid_text(map, values) result(text)
    type(field_map_t), intent(in) :: map
    real(wp), intent(in) :: values(:, :)
    character(len=:), allocatable :: text
    integer, parameter :: width = 14
    integer :: i, j, at

    allocate (character(len=map%rows*(map%columns*width + 1)) :: text)
    at = 0
    do j = 1, map%rows
      do i = 1, map%columns
        if (map%inside(i, j)) then
          write (text(at + 1:at + width), '(es13.5e3,1x)') values(i, j)
        else
          text(at + 1:at + width) = 'NaN'
        end if
        at = at + width
      end do
      text(at + 1:at + 1) = end
      at = at + 1
    end do
  end function grid_text

  !> Pieces of lines, parted by blank lines
  function lines_text(map, view, levels) result(text)
    type(field_map_t), intent(in) :: map
    type(map_view_t), intent(in) :: view
    real(wp), intent(in) :: levels(:)
    character(len=:), allocatable :: text
    character(len=:), allocatable :: buffer
    integer, parameter :: width = 44
    real(wp), allocatable :: pieces(:, :)
    integer :: k, m, at

    text = ''
    do k = 1, size(levels)
      call find_isolines(view%values, map%inside, levels(k), pieces)
      if (allocated(buffer)) deallocate (buffer)
      allocate (character(len=(2*width + 3)*size(pieces, 2)) :: buffer)
      at = 0
      do m = 1, size(pieces, 2)
        call put(pieces(1:2, m))
        call put(pieces(3:4, m))
        buffer(at + 1:at + 1) = end
        at = at + 1
      end do
      text = text//buffer
    end do

  contains

    subroutine put(place)
      real(wp), intent(in) :: place(2)

      write (buffer(at + 1:at + width), '(2es22.13e3)') map%x0 + (place(1) - 1)*map%step, &
          map%y0 + (place(2) - 1)*map%step
      buffer(at + width + 1:at + width + 1) = end
      at = at + width + 1
    end subroutine put

  end function lines_text

  !> A text in lines of no more than so many letters, broken at blanks.
  pure function wrapped(text, most) result(lines)
    !> The text
    character(len=*), intent(in) :: text
    !> Letters in a line
    integer, intent(in) :: most
    character(len=:), allocatable :: lines
    character(len=:), allocatable :: rest
    integer :: at

    lines = ''
    rest = trim(text)
    do while (len(rest) > most)
      at = index(rest(:most + 1), ' ', back=.true.)
      if (at < 2) exit
      lines = lines//rest(:at - 1)//end
      rest = adjustl(rest(at + 1:))
    end do
    lines = lines//rest
  end function wrapped

end module calor_map_picture
