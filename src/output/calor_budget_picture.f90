!> A heat budget over time as a picture: where heat comes from, and how much is stored.
module calor_budget_picture
  use calor_gnuplot, only: in_script
  use calor_kinds, only: wp
  use calor_text, only: text_t, to_text
  implicit none (type, external)
  private

  public :: budget_picture, budget_width, budget_height

  !> Size in pixels
  integer, parameter :: budget_width = 1000, budget_height = 860

  !> Colours that people with colour blindness tell apart (B. Wong, Nature Methods 8 (2011) 441)
  character(len=7), parameter :: colours(*) = [character(len=7) :: '#d55e00', '#0072b2', &
      '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#8c6d31']
  character(len=*), parameter :: end = new_line('a')
  character(len=*), parameter :: style_of_stored = &
      ' with lines linewidth 2 dashtype 2 linecolor "#000000"'

contains

  !> The script, in gnuplot's language, with all numbers in it.
  function budget_picture(title, account, time, power, stored_rate, stored) result(script)
    !> What the scene is called
    character(len=*), intent(in) :: title
    !> Names of the accounts
    type(text_t), intent(in) :: account(:)
    !> Times, s
    real(wp), intent(in) :: time(:)
    !> Heat into the body by time and account, and the rate at which it is stored, W per metre depth
    real(wp), intent(in) :: power(:, :), stored_rate(:)
    !> Heat stored, J per metre depth
    real(wp), intent(in) :: stored(:)
    character(len=:), allocatable :: script
    character(len=*), parameter :: time_range = 'set xrange ['
    integer :: k, power_scale, stored_scale

    power_scale = thousands(max(maxval(abs(power(2:, :))), maxval(abs(stored_rate(2:)))))
    stored_scale = thousands(maxval(abs(stored)))
    script = '$budget << end_of_data'//end
    do k = 1, size(time)
      script = script//to_text(time(k), digits=12)//' '//&
               scaled(stored(k), stored_scale)//' '//scaled(stored_rate(k), power_scale)// &
               numbers(power(k, :), power_scale)//end
    end do
    script = script//'end_of_data'//end//'set multiplot'//end//'set tics out nomirror'//end// &
             'set border 3 linewidth 0.7'//end//'set lmargin at screen 0.19'//end// &
             'set rmargin at screen 0.78'//end//'unset key'//end// &
             'set grid linecolor "#dddddd" linetype 1 '// &
             'linewidth 0.5'//end//time_range//to_text(time(1), digits=9)//':'// &
             to_text(time(size(time)), digits=9)//']'//end// &
             'set tmargin at screen 0.90'//end//'set bmargin at screen 0.52'//end// &
             'set title "'//in_script(title)//'" noenhanced font ",19"'//end// &
             'set ylabel "heat into the body\n'//factor(power_scale)//'W per m depth" '// &
             'offset -1.5,0'//end// &
             'set format x ""'//end// &
             usual_range(power*10.0_wp**(-power_scale), stored_rate*10.0_wp**(-power_scale))// &
             'set ytics autofreq'//end//'plot '
    do k = 1, size(account)
      script = script//'$budget using 1:'//to_text(k + 3)//style_of(k)//', '
    end do
    script = script//'$budget using 1:3'//style_of_stored//end//'unset title'//end// &
             'set tmargin at screen 0.46'//end// &
             'set bmargin at screen 0.11'//end//'set format x "%g"'//end// &
             'set autoscale y'//end//'set xlabel "t, s"'//end// &
             'set ylabel "heat stored\n'//factor(stored_scale)//'J per m depth" '// &
             'offset -1.5,0'//end// &
             'plot $budget using 1:2 with linespoints linewidth 2 pointtype 7 pointsize 0.6 '// &
             'linecolor "#000000"'//end//legend(account)//'unset multiplot'//end
  end function budget_picture

  !> Which line is which, along the height of the picture: that of one plot has room for few names.
  function legend(account) result(script)
    type(text_t), intent(in) :: account(:)
    character(len=:), allocatable :: script
    !> So many have room
    integer, parameter :: most = 18
    integer :: k

    script = 'set tmargin at screen 0.90'//end//'unset border'//end//'unset tics'//end// &
             'unset grid'//end//'unset xlabel'//end//'unset ylabel'//end// &
             'set yrange [0:1]'//end//'set key at screen 0.80,0.9 '// &
             'left top Left reverse noenhanced samplen 3 spacing '
    script = script//trim(merge('1.3            ', '1.0 font ",11" ', size(account) < most))// &
             end//'plot '
    do k = 1, size(account)
      script = script//'NaN'//style_of(k)//' title "'//in_script(spoken(account(k)%value))//'", '
    end do
    script = script//'NaN'//style_of_stored//' title "stored"'//end
  end function legend

  !> How the line of an account looks: colours begin anew with other dashes.
  pure function style_of(account) result(text)
    !> Its number
    integer, intent(in) :: account
    character(len=:), allocatable :: text
    integer :: dashes

    dashes = 1 + (account - 1)/size(colours)
    ! Dashes 2 are those of the heat stored.
    if (dashes > 1) dashes = dashes + 1
    text = ' with linespoints linewidth 2 dashtype '//to_text(dashes)//' pointtype 7 '// &
           'pointsize 0.6 linecolor "'//colours(1 + mod(account - 1, size(colours)))//'"'
  end function style_of

  !> The power of ten, a multiple of 3, that brings numbers up to the largest below 1000.
  pure function thousands(largest) result(power)
    real(wp), intent(in) :: largest
    integer :: power

    power = 0
    if (largest >= 1.0e4_wp .or. (largest > 0 .and. largest < 1.0e-2_wp)) then
      power = 3*floor(log10(largest)/3)
    end if
  end function thousands

  !> How a power of ten is written before a unit
  pure function factor(power) result(text)
    integer, intent(in) :: power
    character(len=:), allocatable :: text

    text = ''
    if (power /= 0) text = '10^{'//to_text(power)//'} '
  end function factor

  pure function scaled(value, power) result(text)
    real(wp), intent(in) :: value
    integer, intent(in) :: power
    character(len=:), allocatable :: text

    text = to_text(value*10.0_wp**(-power), digits=9)
  end function scaled

  pure function numbers(values, power) result(text)
    real(wp), intent(in) :: values(:)
    integer, intent(in) :: power
    character(len=:), allocatable :: text
    integer :: k

    text = ''
    do k = 1, size(values)
      text = text//' '//scaled(values(k), power)
    end do
  end function numbers

  !> Underscores are for programs.
  pure function spoken(name) result(words)
    character(len=*), intent(in) :: name
    character(len=:), allocatable :: words
    integer :: k

    words = name
    do k = 1, len(words)
      if (words(k:k) == '_') words(k:k) = ' '
    end do
  end function spoken

  !> All but the first time tell the range: where a wall does not fit the initial temperature, heat
  !> passes there at the start without limit.
  pure function usual_range(power, stored_rate) result(script)
    real(wp), intent(in) :: power(:, :), stored_rate(:)
    character(len=:), allocatable :: script
    real(wp) :: low, high, margin

    low = min(0.0_wp, minval(power(2:, :)), minval(stored_rate(2:)))
    high = max(0.0_wp, maxval(power(2:, :)), maxval(stored_rate(2:)))
    margin = 0.08_wp*max(high - low, tiny(1.0_wp)*1.0e9_wp)
    if (.not. high > low) margin = 1
    script = 'set yrange ['//to_text(low - margin, digits=5)//':'// &
             to_text(high + margin, digits=5)//']'//end
  end function usual_range

end module calor_budget_picture
