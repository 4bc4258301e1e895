!> A comparison of costs as a picture: error against wall time, a line for each method.
module calor_cost_picture
  use calor_cost_entry, only: cost_entry_t, phase_total
  use calor_cost_file, only: cost_front
  use calor_cost_method, only: cost_method_t
  use calor_gnuplot, only: in_script
  use calor_kinds, only: wp
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: cost_picture, picture_width, picture_height

  !> Colours that people with colour blindness tell apart (B. Wong, Nature Methods 8 (2011) 441),
  !> one for each scheme; its orders and supports differ in marks and dashes
  character(len=7), parameter :: colours(*) = ['#d55e00', '#e69f00', '#0072b2', '#009e73', &
                                               '#000000', '#cc79a7', '#56b4e9']
  integer, parameter :: marks(*) = [7, 5, 9, 11, 13], dashes(*) = [1, 2, 4, 3, 5]

  character(len=*), parameter :: end = new_line('a')
  !> A logarithmic axis has no 0
  real(wp), parameter :: least = 1.0e-16_wp

  !> Size in pixels: the width, the height of the axes with title and labels, of a line of the key
  integer, parameter :: picture_width = 1200, axes_height = 680, key_line = 23

contains

  !> The script, in gnuplot's language, with all numbers in it.
  function cost_picture(entries, headline, threads, time) result(script)
    !> The entries; only those that were measured are drawn
    type(cost_entry_t), intent(in) :: entries(:)
    !> What the scene is called
    character(len=*), intent(in) :: headline
    !> Number of threads
    integer, intent(in) :: threads
    !> The time at which errors were measured, s, if it is known
    real(wp), intent(in), optional :: time
    character(len=:), allocatable :: script, plots, number, moment
    logical :: front(size(entries))
    integer :: k, j, methods, scheme, variant

    front = cost_front(entries)
    moment = ''
    if (present(time)) moment = ' at t = '//to_text(time, digits=6)//' s'
    script = 'set logscale xy'//end// &
             'set format y "10^{%T}"'//end// &
             'set format x "%g"'//end// &
             'set grid xtics ytics linecolor "#dddddd" linetype 1 linewidth 0.5'//end// &
             'set border 3'//end//'set tics nomirror out'//end// &
             ranges(entries)// &
             'set key below vertical Left reverse samplen 4 maxcols 1 noenhanced font ",14"'// &
             end//'set bmargin at screen '// &
             to_text(1 - (axes_height - 90.0_wp)/picture_height(entries), digits=4)//end// &
             'set title "'//in_script(headline)//'" noenhanced font ",20"'//end// &
             'set xlabel "wall time, s (set-up and steps, '//threads_text(threads)//')"'//end// &
             'set ylabel "relative L_2 error'//moment//'"'//end// &
             '$front << end_of_data'//end
    do k = 1, size(entries)
      if (front(k)) script = script//point(entries(k))
    end do
    script = script//'end_of_data'//end//labels(entries, front)
    plots = '$front using 1:2 smooth unique with lines linewidth 9 linecolor "#d8d8d8" '// &
            'title "cheapest for its accuracy (Pareto front)"'
    methods = 0
    do k = 1, size(entries)
      call find_style(entries, k, scheme, variant)
      if (variant == 0) cycle
      methods = methods + 1
      number = to_text(methods)
      script = script//'$method_'//number//' << end_of_data'//end
      do j = k, size(entries)
        if (entries(j)%method%name() /= entries(k)%method%name()) cycle
        if (entries(j)%measured()) script = script//point(entries(j))
      end do
      script = script//'end_of_data'//end
      plots = plots//', $method_'//number//' using 1:2 with linespoints linewidth 2 '// &
              'pointsize 1.2 pointtype '// &
              to_text(marks(1 + mod(scheme + variant - 2, size(marks))))// &
              ' dashtype '//to_text(dashes(1 + mod(variant - 1, size(dashes))))// &
              ' linecolor "'//colours(1 + mod(scheme - 1, size(colours)))//'" title "'// &
              in_script(title_of(entries, k))//'"'
    end do
    script = script//'plot '//plots//end
  end function cost_picture

  !> The height that leaves room for the key, in pixels.
  pure function picture_height(entries) result(height)
    !> The entries
    type(cost_entry_t), intent(in) :: entries(:)
    integer :: height
    integer :: k, scheme, variant

    height = axes_height + key_line
    do k = 1, size(entries)
      call find_style(entries, k, scheme, variant)
      if (variant > 0) height = height + key_line
    end do
  end function picture_height

  !> Where an entry is the first of its method that was measured: the number of its scheme and that
  !> of the method among those of the scheme, each counted from 1; elsewhere 0.
  pure subroutine find_style(entries, k, scheme, variant)
    type(cost_entry_t), intent(in) :: entries(:)
    integer, intent(in) :: k
    integer, intent(out) :: scheme, variant
    integer :: j

    scheme = 0
    variant = 0
    if (.not. is_first(entries, k, by_scheme=.false.)) return
    do j = 1, k
      if (is_first(entries, j, by_scheme=.true.)) then
        ! Schemes are counted up to this one.
        if (variant == 0) scheme = scheme + 1
      end if
      if (entries(j)%method%laplacian /= entries(k)%method%laplacian) cycle
      if (is_first(entries, j, by_scheme=.false.)) variant = variant + 1
    end do
  end subroutine find_style

  !> Whether no measured entry before it has the same method, or the same scheme.
  pure function is_first(entries, k, by_scheme) result(first)
    type(cost_entry_t), intent(in) :: entries(:)
    integer, intent(in) :: k
    logical, intent(in) :: by_scheme
    logical :: first
    integer :: j

    first = entries(k)%measured()
    do j = 1, k - 1
      if (.not. first) return
      if (.not. entries(j)%measured()) cycle
      if (by_scheme) then
        first = entries(j)%method%laplacian /= entries(k)%method%laplacian
      else
        first = entries(j)%method%name() /= entries(k)%method%name()
      end if
    end do
  end function is_first

  !> How fine the clouds on the front are, written beside it where there is room.
  function labels(entries, front) result(script)
    type(cost_entry_t), intent(in) :: entries(:)
    logical, intent(in) :: front(:)
    character(len=:), allocatable :: script
    !> Labels keep apart by such factors of time and of error
    real(wp), parameter :: apart(2) = [1.5_wp, 3.0_wp]
    real(wp) :: place(2), taken(2, size(entries))
    integer :: k, j, count

    script = ''
    count = 0
    do k = 1, size(entries)
      if (.not. front(k)) cycle
      place = place_of(entries(k))
      do j = 1, count
        if (all(abs(log(taken(:, j)/place)) < log(apart))) exit
      end do
      if (j <= count) cycle
      count = count + 1
      taken(:, count) = place
      script = script//'set label "Δ = '//to_text(entries(k)%spacing, digits=3)//'" at '// &
               to_text(place(1), digits=5)//','//to_text(place(2), digits=5)// &
               ' right offset -0.9,-0.6 font ",12" textcolor "#555555"'//end
    end do
  end function labels

  !> Wall time and error as they are drawn
  pure function place_of(entry) result(place)
    type(cost_entry_t), intent(in) :: entry
    real(wp) :: place(2)

    place = [max(1.0e-9_wp, entry%median_seconds(phase_total)), max(least, entry%error)]
  end function place_of

  pure function title_of(entries, k) result(title)
    type(cost_entry_t), intent(in) :: entries(:)
    integer, intent(in) :: k
    character(len=:), allocatable :: title
    type(cost_method_t) :: short

    short = entries(k)%method%told_apart(entries%method)
    title = short%title()
  end function title_of

  !> Axes somewhat longer than the data
  function ranges(entries) result(script)
    type(cost_entry_t), intent(in) :: entries(:)
    character(len=:), allocatable :: script
    real(wp) :: low(2), high(2), place(2)
    integer :: k

    low = huge(1.0_wp)
    high = 0
    do k = 1, size(entries)
      if (.not. entries(k)%measured()) cycle
      place = place_of(entries(k))
      low = min(low, place)
      high = max(high, place)
    end do
    ! Labels stand at the left below points.
    low = low/[2, 6]
    high = high*1.5_wp
    ! On a short axis no power of ten might be marked.
    where (high < 100*low)
      low = 10.0_wp**floor(log10(low))
      high = 10.0_wp**ceiling(log10(high))
    end where
    script = 'set xrange ['//to_text(low(1), digits=3)//':'//to_text(high(1), digits=3)//']'// &
             end//'set yrange ['//to_text(low(2), digits=3)//':'//to_text(high(2), digits=3)// &
             ']'//end
  end function ranges

  function point(entry) result(line)
    type(cost_entry_t), intent(in) :: entry
    character(len=:), allocatable :: line
    real(wp) :: place(2)

    place = place_of(entry)
    line = to_text(place(1), digits=6)//' '//to_text(place(2), digits=6)//end
  end function point

  pure function threads_text(threads) result(text)
    integer, intent(in) :: threads
    character(len=:), allocatable :: text

    text = to_text(threads)//' threads'
    if (threads == 1) text = '1 thread'
  end function threads_text

end module calor_cost_picture
