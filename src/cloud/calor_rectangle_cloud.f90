!> Rectangles filled with particles.
module calor_rectangle_cloud
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_arrangement_hexagonal, only: arrange_hexagonal
  use calor_arrangement_jittered, only: arrange_jittered
  use calor_arrangement_lattice, only: arrange_lattice
  use calor_arrangements, only: arrangement_choices
  use calor_choice, only: choice_names
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: wp, ip
  use calor_text, only: suggestion, text_list, to_text
  implicit none (type, external)
  private

  public :: make_rectangle

contains

  !> Fill a rectangle with particles, the outermost of which lie on its walls.
  !>
  !> The boundaries are 'left', 'right', 'bottom' and 'top'; a corner belongs to two of them.
  !> Fails with status_bad_input where the ranges, the spacing, the arrangement or the jitter make
  !> no sense, or give more particles than can be numbered or held in memory.
  subroutine make_rectangle(x_range, y_range, spacing, arrangement, jitter, seed, cloud, error)
    !> Left and right, bottom and top edge, m
    real(wp), intent(in) :: x_range(2), y_range(2)
    !> Wanted distance of neighbours, m; fitted to the edges
    real(wp), intent(in) :: spacing
    !> One of the names in `arrangement_choices`
    character(len=*), intent(in) :: arrangement
    !> Largest displacement in units of the spacing, below 0.5; for 'jittered' only
    real(wp), intent(in) :: jitter
    !> Which of all such clouds; for 'jittered' only
    integer, intent(in) :: seed
    !> The particles
    type(cloud_t), intent(out) :: cloud
    !> What is wrong with the request
    type(error_t), allocatable, intent(out) :: error

    call check_range('x_range', x_range, error)
    if (.not. allocated(error)) call check_range('y_range', y_range, error)
    if (.not. allocated(error)) call check_spacing(x_range, y_range, spacing, error)
    if (allocated(error)) return

    select case (arrangement)
    case ('lattice')
      call arrange_lattice(x_range, y_range, spacing, cloud, error)
    case ('hexagonal')
      call arrange_hexagonal(x_range, y_range, spacing, cloud, error)
    case ('jittered')
      call check_jitter(jitter, error)
      if (.not. allocated(error)) then
        call arrange_jittered(x_range, y_range, spacing, jitter, seed, cloud, error)
      end if
    case ('relaxed')
      call raise(error, status_bad_input, 'The arrangement ''relaxed'' is not available yet. '// &
                 'There are ''lattice'', ''hexagonal'' and ''jittered''.')
    case default
      call raise(error, status_bad_input, 'No arrangement is called '''//arrangement//'''.'// &
                 suggestion(arrangement, choice_names(arrangement_choices)))
    end select
    if (allocated(error)) return
    cloud%boundary = text_list([character(len=6) :: 'left', 'right', 'bottom', 'top'])
    cloud%spacing = spacing
  end subroutine make_rectangle

  pure subroutine check_range(name, range, error)
    character(len=*), intent(in) :: name
    real(wp), intent(in) :: range(2)
    type(error_t), allocatable, intent(out) :: error

    ! One after another: a comparison with NaN is itself a floating-point exception
    if (all(ieee_is_finite(range))) then
      if (range(1) < range(2)) return
      call raise(error, status_bad_input, name//' = '//to_text(range(1))//', '// &
                 to_text(range(2))//' is not a range: the first number must be the smaller one.')
    else
      call raise(error, status_bad_input, name//' must be two ordinary numbers.')
    end if
  end subroutine check_range

  pure subroutine check_spacing(x_range, y_range, spacing, error)
    real(wp), intent(in) :: x_range(2), y_range(2), spacing
    type(error_t), allocatable, intent(out) :: error
    ! What an edge may fall short of one spacing by rounding
    real(wp), parameter :: tolerance = 1.0e-9_wp
    ! More along one edge are more than can be numbered
    real(wp), parameter :: most_particles = real(huge(1_ip), wp)
    real(wp) :: width, height

    width = x_range(2) - x_range(1)
    height = y_range(2) - y_range(1)
    if (.not. ieee_is_finite(spacing)) then
      call raise(error, status_bad_input, 'spacing must be an ordinary number.')
    else if (spacing <= 0) then
      call raise(error, status_bad_input, 'spacing = '//to_text(spacing)// &
                 ' is not positive; it is the distance between neighbouring particles.')
    else if (spacing > (1 + tolerance)*min(width, height)) then
      call raise(error, status_bad_input, 'spacing = '//to_text(spacing)// &
                 ' is larger than the rectangle, which is '//to_text(width, digits=6)//' by '// &
                 to_text(height, digits=6)//'.')
    else if (too_many()) then
      call raise(error, status_bad_input, 'spacing = '//to_text(spacing)// &
                 ' gives more than the '//to_text(huge(1_ip))//' particles that can be numbered.')
    end if

  contains

    !> Whether the densest arrangement may have more particles than can be numbered.
    pure function too_many()
      logical :: too_many

      too_many = spacing*most_particles < max(width, height)
      if (too_many) return
      ! 2/√3 more than on a lattice
      too_many = 1.16_wp*(width/spacing + 3)*(height/spacing + 3) > most_particles
    end function too_many

  end subroutine check_spacing

  pure subroutine check_jitter(jitter, error)
    real(wp), intent(in) :: jitter
    type(error_t), allocatable, intent(out) :: error

    if (.not. ieee_is_finite(jitter)) then
      call raise(error, status_bad_input, 'jitter must be an ordinary number.')
    else if (jitter < 0 .or. jitter >= 0.5_wp) then
      call raise(error, status_bad_input, 'jitter = '//to_text(jitter)//' must be at least 0 '// &
                 'and less than 0.5: two neighbours that are both displaced by half a spacing '// &
                 'could meet.')
    end if
  end subroutine check_jitter

end module calor_rectangle_cloud
