!> A comparison of costs as a picture: error against wall time, a line for each method.
module calor_cost_picture
  use calor_cost_entry, only: cost_entry_t, phase_total
  use calor_cost_file, only: cost_front
  use calor_cost_method, only: cost_method_t
  use calor_kinds, only: wp
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: cost_picture

  !> Colours that people with colour blindness tell apart (B. Wong, Nature Methods 8 (2011) 441)
  !> and marks that differ where colours repeat
  character(len=7), parameter :: colours(*) = ['#0072b2', '#d55e00', '#009e73', '#cc79a7', &
                                               '#e69f00', '#56b4e9', '#000000']
  integer, parameter :: marks(*) = [7, 5, 9, 11, 13]

  character(len=*), parameter :: end = new_line('a')
  !> A logarithmic axis has no 0
  real(wp), parameter :: least = 1.0e-16_wp

contains

  !> The script, in gnuplot's language, with all numbers in it.
  function cost_picture(entries, headline, time, threads) result(script)
    !> The entries; only those that were measured are drawn
    type(cost_entry_t), intent(in) :: entries(:)
    !> What the scene is called
    character(len=*), intent(in) :: headline
    !> The time at which errors were measured, s
    real(wp), intent(in) :: time
    !> Number of threads
    integer, intent(in) :: threads
    character(len=:), allocatable :: script, plots, number
    logical :: front(size(entries)), drawn(size(entries))
    integer :: k, j, methods

    front = cost_front(entries)
    script = 'set logscale xy'//end// &
             'set format y "10^{%T}"'//end// &
             'set format x "%g"'//end// &
             'set grid xtics ytics linecolor "#dddddd" linetype 1 linewidth 0.5'//end// &
             'set border 3'//end//'set tics nomirror out'//end// &
             ranges(entries)// &
             'set key below horizontal Left reverse samplen 2.5 width 1 maxcols 2 noenhanced '// &
             'font ",14"'//end// &
             'set title "'//escaped(headline)//'" noenhanced font ",20"'//end// &
             'set xlabel "wall time, s (set-up and steps, '//threads_text(threads)//')"'//end// &
             'set ylabel "relative L_2 error at t = '//to_text(time, digits=6)//' s"'//end
    script = script//'$front << end_of_data'//end
    do k = 1, size(entries)
      if (front(k)) script = script//point(entries(k))
    end do
    script = script//'end_of_data'//end
    plots = '$front using 1:2 smooth unique with lines linewidth 9 linecolor "#d8d8d8" '// &
            'title "cheapest for its accuracy (Pareto front)"'
    drawn = .false.
    methods = 0
    do k = 1, size(entries)
      if (drawn(k) .or. .not. entries(k)%measured()) cycle
      methods = methods + 1
      number = to_text(methods)
      script = script//'$method_'//number//' << end_of_data'//end
      do j = k, size(entries)
        if (entries(j)%method%name() /= entries(k)%method%name()) cycle
        drawn(j) = .true.
        if (entries(j)%measured()) script = script//point(entries(j))
      end do
      script = script//'end_of_data'//end
      plots = plots//', $method_'//number//' using 1:2 with linespoints linewidth 2 '// &
              'pointsize 1.2 pointtype '//to_text(marks(1 + mod(methods - 1, size(marks))))// &
              ' linecolor "'//colours(1 + mod(methods - 1, size(colours)))//'" title "'// &
              escaped(title_of(entries, k))//'"'
    end do
    ! Room for the axis and, below it, the key in two columns
    script = script//'set bmargin '//to_text(5 + (methods + 2)/2)//end
    ! How fine the clouds on the front are
    plots = plots//', $front using 1:2:(sprintf("Δ = %g", $3)) with labels left offset '// &
            '0.8,0.7 font ",12" textcolor "#555555" notitle'
    script = script//'plot '//plots//end
  end function cost_picture

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
      place = [entries(k)%median_seconds(phase_total), max(least, entries(k)%error)]
      low = min(low, place)
      high = max(high, place)
    end do
    low = low/1.5_wp
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
    line = to_text(entry%median_seconds(phase_total), digits=6)//' '// &
           to_text(max(least, entry%error), digits=6)//' '// &
           to_text(entry%spacing, digits=6)//end
  end function point

  pure function threads_text(threads) result(text)
    integer, intent(in) :: threads
    character(len=:), allocatable :: text

    text = to_text(threads)//' threads'
    if (threads == 1) text = '1 thread'
  end function threads_text

  !> A text as it stands between double quotes of gnuplot
  pure function escaped(text)
    character(len=*), intent(in) :: text
    character(len=:), allocatable :: escaped
    integer :: k

    escaped = ''
    do k = 1, len(text)
      if (text(k:k) == '"' .or. text(k:k) == '\') escaped = escaped//'\'
      escaped = escaped//text(k:k)
    end do
  end function escaped

end module calor_cost_picture
