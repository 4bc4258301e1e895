!> The files of a study of convergence: all its numbers as CSV, and a picture.
module calor_convergence_files
  use calor_convergence_schemes, only: family_names, gradient_family, laplacian_family
  use calor_convergence_study, only: convergence_study_t, measurement_t
  use calor_convergence_theory, only: fixed_ratio, growing_ratio, fixed_spacing, way_names, &
                                      regular_cloud, irregular_cloud, is_order
  use calor_error, only: error_t
  use calor_field_file, only: check_place
  use calor_gnuplot, only: draw_picture
  use calor_kinds, only: wp
  use calor_text, only: to_text
  use calor_whole_file, only: write_whole_file
  implicit none (type, external)
  private

  public :: write_convergence, draw_convergence, check_convergence_files
  public :: convergence_table_file, convergence_pictures

  !> The names of the files of `calor convergence`
  character(len=*), parameter :: convergence_table_file = 'convergence.csv'
  character(len=*), parameter :: convergence_pictures(*) = ['convergence.svg', 'convergence.png']

  character(len=*), parameter :: end = new_line('a')
  character(len=9), parameter :: cloud_names(*) = [character(len=9) :: 'regular', 'irregular']

  !> Colours that those who see few colours can tell apart (M. Okabe, K. Ito), and open symbols of
  !> different sizes, so that curves that coincide are seen to do so
  character(len=7), parameter :: colours(*) = [character(len=7) :: '#0072b2', '#d55e00', &
      '#009e73', '#cc79a7', '#000000', '#e69f00', '#56b4e9', '#7a5195', '#8c6d31', '#637939']
  integer, parameter :: symbols(*) = [6, 4, 8, 12, 10, 14, 1, 2, 3, 6]
  real(wp), parameter :: symbol_sizes(*) = [1.5_wp, 1.2_wp, 1.0_wp, 1.3_wp, 0.9_wp, 1.0_wp, &
      1.0_wp, 1.0_wp, 1.0_wp, 0.7_wp]

contains

  !> Whether the files of `calor convergence` can be written into the current folder; better asked
  !> before a study than after it.
  subroutine check_convergence_files(error)
    !> One of them cannot
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    call check_place(convergence_table_file, error)
    do k = 1, size(convergence_pictures)
      if (.not. allocated(error)) call check_place(convergence_pictures(k), error)
    end do
  end subroutine check_convergence_files

  !> Write all numbers, a line for each scheme, cloud, way of refining and refinement.
  subroutine write_convergence(study, path, error)
    !> A study after `evaluate`
    type(convergence_study_t), intent(in) :: study
    !> The file; it is replaced only once the new one is complete
    character(len=*), intent(in) :: path
    !> It cannot be written
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: text
    integer :: cloud, k, last, level, way

    last = 0
    do k = 1, size(study%schemes)
      last = max(last, ubound(study%curve(1, 1, k)%level(1)%term, 1))
    end do
    text = 'scheme,scheme_order,derivative,cloud,refinement,spacing,support_radius,neighbours,'// &
           'rows,error'
    do k = 0, last
      text = text//',term'//to_text(k)
    end do
    text = text//',sum,remainder,rounding,observed_order,fitted_order,expected_order,'// &
           'predicted_order,field'//end
    do k = 1, size(study%schemes)
      do cloud = regular_cloud, irregular_cloud
        do way = fixed_ratio, fixed_spacing
          associate (scheme => study%schemes(k), curve => study%curve(way, cloud, k))
            do level = 1, size(curve%level)
              text = text//trim(scheme%name)//','//order_of_scheme(scheme%order)//','// &
                     trim(family_names(scheme%family))//','//trim(cloud_names(cloud))//','// &
                     trim(way_names(way))//','//numbers(curve%level(level), last)//','// &
                     order_text(curve%level(level)%order)//','//order_text(curve%fitted)//','// &
                     order_text(curve%expected)//','//order_text(curve%predicted)//',"'// &
                     study%field(k)%value//'"'//end
            end do
          end associate
        end do
      end do
    end do
    call write_whole_file(path, text, error)
  end subroutine write_convergence

  pure function order_of_scheme(order) result(text)
    integer, intent(in) :: order
    character(len=:), allocatable :: text

    text = ''
    if (order > 0) text = to_text(order)
  end function order_of_scheme

  pure function order_text(order) result(text)
    real(wp), intent(in) :: order
    character(len=:), allocatable :: text

    text = ''
    if (is_order(order)) text = to_text(order, digits=4)
  end function order_text

  !> From the spacing to whether the error is rounding
  pure function numbers(measurement, last) result(text)
    type(measurement_t), intent(in) :: measurement
    !> The last term of all schemes
    integer, intent(in) :: last
    character(len=:), allocatable :: text
    integer :: k

    text = to_text(measurement%spacing, digits=9)//','//to_text(measurement%radius, digits=9)// &
           ','//to_text(measurement%neighbours, digits=5)//','//to_text(measurement%rows)//','// &
           to_text(measurement%error, digits=7)
    do k = 0, last
      text = text//','
      if (k <= ubound(measurement%term, 1)) text = text//to_text(measurement%term(k), digits=7)
    end do
    text = text//','//to_text(measurement%total, digits=7)//','// &
           to_text(measurement%remainder, digits=7)//','//merge('1', '0', measurement%rounded)
  end function numbers

  !> Draw errors against spacing or support radius: a column of panels for each way of refining, a
  !> row for each family and cloud.
  subroutine draw_convergence(study, path, error)
    !> A study after `evaluate`
    type(convergence_study_t), intent(in) :: study
    !> The file, .svg or .png; it is replaced only once the new one is complete
    character(len=*), intent(in) :: path
    !> There is no gnuplot, or the file cannot be written
    type(error_t), allocatable, intent(out) :: error

    call draw_picture(path, 1500, 1800, convergence_script(study), error)
  end subroutine draw_convergence

  function convergence_script(study) result(script)
    type(convergence_study_t), intent(in) :: study
    character(len=:), allocatable :: script
    integer :: cloud, family, way

    script = ''
    do family = gradient_family, laplacian_family
      do cloud = regular_cloud, irregular_cloud
        do way = fixed_ratio, fixed_spacing
          script = script//data_blocks(study, family, cloud, way)
        end do
      end do
    end do
    script = script//'set encoding utf8'//end//'set multiplot'//end//'set logscale xy'//end// &
             'set border 3'//end//'set tics out nomirror'//end//'set ytics 100'//end// &
             'set mytics 1'//end// &
             'set grid linecolor "#dddddd" linetype 1 linewidth 0.5'//end
    do family = gradient_family, laplacian_family
      do cloud = regular_cloud, irregular_cloud
        do way = fixed_ratio, fixed_spacing
          script = script//panel(study, family, cloud, way)
        end do
      end do
    end do
    script = script//'unset multiplot'
  end function convergence_script

  pure function block_name(family, cloud, way, k) result(name)
    integer, intent(in) :: family, cloud, way, k
    character(len=:), allocatable :: name

    name = '$d'//to_text(family)//'_'//to_text(cloud)//'_'//to_text(way)//'_'//to_text(k)
  end function block_name

  !> Abscissa and error of all curves of a panel that have a point beyond rounding
  function data_blocks(study, family, cloud, way) result(script)
    type(convergence_study_t), intent(in) :: study
    integer, intent(in) :: family, cloud, way
    character(len=:), allocatable :: script
    integer :: k, level

    script = ''
    do k = 1, size(study%schemes)
      if (study%schemes(k)%family /= family) cycle
      script = script//block_name(family, cloud, way, k)//' << end_of_data'//end
      associate (curve => study%curve(way, cloud, k))
        do level = 1, size(curve%level)
          if (curve%level(level)%rounded) cycle
          script = script//to_text(abscissa(curve%level(level), way), digits=7)//' '// &
                   to_text(curve%level(level)%error, digits=7)//end
        end do
      end associate
      script = script//'end_of_data'//end
    end do
  end function data_blocks

  pure function abscissa(measurement, way) result(length)
    type(measurement_t), intent(in) :: measurement
    integer, intent(in) :: way
    real(wp) :: length

    length = merge(measurement%spacing, measurement%radius, way == fixed_ratio)
  end function abscissa

  function panel(study, family, cloud, way) result(script)
    type(convergence_study_t), intent(in) :: study
    integer, intent(in) :: family, cloud, way
    character(len=:), allocatable :: script
    real(wp), parameter :: left = 0.1_wp, step = 0.215_wp, wide = 0.195_wp
    real(wp), parameter :: tops(2, 2) = reshape([0.925_wp, 0.74_wp, 0.435_wp, 0.25_wp], [2, 2])
    real(wp), parameter :: high = 0.17_wp
    real(wp) :: x(2), y(2)
    integer :: k, number

    call ranges(study, family, way, x, y)
    script = 'unset label'//end//'unset object'//end//'unset arrow'//end//'unset title'//end// &
             'unset xlabel'//end//'unset ylabel'//end//'unset key'//end// &
             'set lmargin at screen '//to_text(left + (way - 1)*step)//end// &
             'set rmargin at screen '//to_text(left + (way - 1)*step + wide)//end// &
             'set tmargin at screen '//to_text(tops(cloud, family))//end// &
             'set bmargin at screen '//to_text(tops(cloud, family) - high)//end// &
             'set xrange ['//to_text(x(1), digits=6)//':'//to_text(x(2), digits=6)//']'//end// &
             'set yrange ['//to_text(y(1), digits=6)//':'//to_text(y(2), digits=6)//']'//end// &
             'set format y "'//trim(merge('10^{%T}', '       ', way == fixed_ratio))//'"'//end// &
             'set format x "'//trim(merge('%g', '  ', cloud == irregular_cloud))//'"'//end// &
             tics(study%curve(way, cloud, 1)%level, way, cloud == irregular_cloud)// &
             guides(way, x, y)
    if (cloud == regular_cloud) script = script//titles(study, family, way)
    if (cloud == irregular_cloud) then
      script = script//'set xlabel "'//trim(merge('distance between particles (m)', &
                                                  'support radius h (m)          ', &
                                                  way == fixed_ratio))//'"'//end
    end if
    if (way == fixed_ratio) then
      script = script//'set ylabel "relative error,\n'// &
               trim(study%cloud_name(cloud))//'"'//end
    end if
    if (way == fixed_spacing .and. cloud == regular_cloud) then
      script = script//'set key at screen 0.74,'//to_text(tops(cloud, family))// &
               ' left top Left reverse noenhanced samplen 2 spacing 1.2'//end// &
               'set label "grey lines:\norders of convergence" at screen 0.75,'// &
               to_text(tops(cloud, family) - high - 0.01_wp)// &
               ' left font ",14" textcolor "#555555"'//end
    end if
    script = script//'plot'
    number = 0
    do k = 1, size(study%schemes)
      if (study%schemes(k)%family /= family) cycle
      if (number > 0) script = script//','
      number = number + 1
      associate (style => 1 + mod(number - 1, size(colours)))
        script = script//' '//block_name(family, cloud, way, k)// &
                 ' using 1:2 with linespoints linecolor rgb "'//colours(style)// &
                 '" linewidth '//to_text(max(1.5_wp, 5.0_wp - 0.7_wp*number))// &
                 ' pointtype '//to_text(symbols(style))//' pointsize '// &
                 to_text(symbol_sizes(style))//' title "'//study%schemes(k)%label()//'"'
      end associate
    end do
    script = script//end
  end function panel

  !> Both axes are the same for both clouds, and the ordinate for all ways.
  subroutine ranges(study, family, way, x, y)
    type(convergence_study_t), intent(in) :: study
    integer, intent(in) :: family, way
    real(wp), intent(out) :: x(2), y(2)
    integer :: cloud, k, level, other

    x = [huge(1.0_wp), 0.0_wp]
    y = [huge(1.0_wp), 0.0_wp]
    do k = 1, size(study%schemes)
      if (study%schemes(k)%family /= family) cycle
      do cloud = regular_cloud, irregular_cloud
        do other = fixed_ratio, fixed_spacing
          do level = 1, size(study%curve(other, cloud, k)%level)
            associate (found => study%curve(other, cloud, k)%level(level))
              if (other == way) x = [min(x(1), abscissa(found, way)), &
                                     max(x(2), abscissa(found, way))]
              if (.not. found%rounded) y = [min(y(1), found%error), max(y(2), found%error)]
            end associate
          end do
        end do
      end do
    end do
    if (y(1) > y(2)) y = [1.0e-3_wp, 1.0_wp]
    x = x*[0.85_wp, 1.18_wp]
    y = 10.0_wp**[real(floor(log10(y(1)) - 0.05_wp), wp), real(ceiling(log10(y(2)) + 0.05_wp), wp)]
  end subroutine ranges

  !> A tic for every second measurement
  function tics(levels, way, labelled) result(script)
    type(measurement_t), intent(in) :: levels(:)
    integer, intent(in) :: way
    !> Whether they have numbers
    logical, intent(in) :: labelled
    character(len=:), allocatable :: script
    integer :: k

    script = 'set xtics ('
    do k = size(levels), 1, -2
      associate (length => abscissa(levels(k), way))
        script = script//'"'
        if (labelled) script = script//to_text(length, digits=2)
        script = script//'" '//to_text(length, digits=7)//','
      end associate
    end do
    script = script(:len(script) - 1)//')'//end
  end function tics

  !> What slopes look like: a fan of lines in the lower right corner, each with its order.
  function guides(way, x, y) result(script)
    integer, intent(in) :: way
    real(wp), intent(in) :: x(2), y(2)
    character(len=:), allocatable :: script
    integer, parameter :: orders(3, 3) = reshape([1, 4, 8, 1, 4, 8, -1, -3, -5], [3, 3])
    real(wp) :: from(2), to(2), lift, longest
    integer :: k

    script = ''
    ! What grows to the left is drawn in the upper corner, where no curve comes.
    lift = merge(0.94_wp, 0.06_wp, way == fixed_spacing)
    do k = 1, size(orders, 1)
      from = [x(1)*(x(2)/x(1))**0.50_wp, y(1)*(y(2)/y(1))**lift]
      longest = (y(2)/y(1))**(0.4_wp/abs(orders(k, way)))
      to(1) = from(1)*min((x(2)/x(1))**0.38_wp, longest)
      to(2) = from(2)*(to(1)/from(1))**orders(k, way)
      script = script//'set arrow from '//point(from)//' to '//point(to)// &
               ' nohead linewidth 1.2 linecolor "#777777"'//end// &
               'set label "'//to_text(orders(k, way))//'" at '//point(to)// &
               ' left offset 0.4,0 font ",14" textcolor "#555555"'//end
    end do
  end function guides

  pure function point(place) result(text)
    real(wp), intent(in) :: place(2)
    character(len=:), allocatable :: text

    text = to_text(place(1), digits=6)//','//to_text(place(2), digits=6)
  end function point

  function titles(study, family, way) result(script)
    type(convergence_study_t), intent(in) :: study
    integer, intent(in) :: family, way
    character(len=:), allocatable :: script
    character(len=:), allocatable :: what, how

    select case (way)
    case (fixed_ratio)
      what = 'a: finer, as many neighbours'
    case (growing_ratio)
      what = 'b: finer, more neighbours'
    case default
      what = 'c: as fine, fewer neighbours'
    end select
    how = 'h: '//ratios(study, family, way)//' particle distances'
    script = 'set title "'//what//'\n'//how//'" offset 0,-0.4 font ",15"'//end
    if (way == fixed_ratio) then
      script = script//'set label "'// &
               trim(merge('Gradient of ', 'Laplacian of', family == gradient_family))//' u = '// &
               study%field_in_words()//'" at screen 0.01,'// &
               merge('0.985', '0.495', family == gradient_family)// &
               ' left noenhanced font ",20"'//end
    end if
  end function titles

  !> The support radii of a column of panels in spacings: '2.1 to 7.5', or '2.1' where all are the
  !> same
  function ratios(study, family, way) result(text)
    type(convergence_study_t), intent(in) :: study
    integer, intent(in) :: family, way
    character(len=:), allocatable :: text
    real(wp) :: least, most
    integer :: k

    least = huge(least)
    most = 0
    do k = 1, size(study%schemes)
      if (study%schemes(k)%family /= family) cycle
      associate (levels => study%curve(way, regular_cloud, k)%level)
        least = min(least, minval(levels%radius/levels%spacing))
        most = max(most, maxval(levels%radius/levels%spacing))
      end associate
    end do
    text = to_text(least, digits=3)
    if (to_text(most, digits=3) /= text) text = text//' to '//to_text(most, digits=3)
  end function ratios

end module calor_convergence_files
