!> The paths of particles that a velocity field carries, over one step of the motion.
!>
!> dX/dt = v(X, t) is integrated by the classical Runge–Kutta method of fourth order, in as many
!> equal parts as it takes to have the difference to half as many parts, over 15, below a tolerance.
module calor_particle_path
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_error, only: error_t, raise, status_bad_numbers
  use calor_kinds, only: wp
  use calor_places, only: places_t
  use calor_text, only: to_text
  use calor_velocity, only: velocity_t
  implicit none (type, external)
  private

  public :: particle_path_t

  !> A velocity that needs more parts of a quarter of a step is beyond all use
  integer, parameter :: most_parts = 4096

  !> Where particles are at the beginning, in the middle and at the end of a step
  type :: particle_path_t
    !> Beginning, s, and length, s, of the step
    real(wp) :: time = 0.0_wp, step = 0.0_wp
    !> m
    real(wp), allocatable :: x_start(:), y_start(:), x_middle(:), y_middle(:), x_end(:), y_end(:)
    !> After a quarter and three quarters of it, m
    real(wp), allocatable, private :: x_early(:), y_early(:), x_late(:), y_late(:)
    !> Parts of a quarter of the step
    integer :: parts = 1
  contains
    !> Find the paths
    procedure :: follow
    !> Polynomials of degree 4 through five places of each particle
    procedure :: interpolate
    procedure, private :: carry
  end type particle_path_t

contains

  !> Find the paths of particles over a step.
  subroutine follow(this, velocity, x, y, time, step, tolerance, error)
    class(particle_path_t), intent(inout) :: this
    !> The velocity
    type(velocity_t), intent(inout) :: velocity
    !> Where the particles are, m
    real(wp), intent(in) :: x(:), y(:)
    !> s
    real(wp), intent(in) :: time, step
    !> How far a place may be wrong, m
    real(wp), intent(in) :: tolerance
    !> The velocity is no number somewhere, or changes too fast to be followed
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: coarse_x(:), coarse_y(:)
    real(wp) :: wrong

    this%time = time
    this%step = step
    this%x_start = x
    this%y_start = y
    allocate (coarse_x(size(x)), coarse_y(size(y)))
    this%parts = max(1, this%parts/2)
    call this%carry(velocity, 2*this%parts, coarse_x, coarse_y, error)
    do
      if (allocated(error)) return
      this%x_end = x
      this%y_end = y
      call this%carry(velocity, 4*this%parts, this%x_end, this%y_end, error)
      if (allocated(error)) return
      wrong = largest_distance(this%x_end, this%y_end, coarse_x, coarse_y)/15
      if (wrong <= tolerance) return
      if (this%parts >= most_parts) then
        call raise(error, status_bad_numbers, velocity%place//': beyond t = '// &
                   to_text(time, digits=6)//' s the velocity changes too fast to be followed.')
        return
      end if
      coarse_x = this%x_end
      coarse_y = this%y_end
      this%parts = 2*this%parts
    end do
  end subroutine follow

  !> From the start to the end of the step in a number of equal parts. Places on the way that are an
  !> end of a part are kept.
  subroutine carry(this, velocity, parts, x, y, error)
    class(particle_path_t), intent(inout) :: this
    type(velocity_t), intent(inout) :: velocity
    integer, intent(in) :: parts
    real(wp), intent(out) :: x(:), y(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: u(:), v(:), sum_u(:), sum_v(:)
    real(wp), parameter :: forward(4) = [0.5_wp, 0.5_wp, 1.0_wp, 0.0_wp], &
                           share(4) = [1.0_wp, 2.0_wp, 2.0_wp, 1.0_wp]
    real(wp) :: begin, length
    integer :: part, stage, wrong

    allocate (u(size(x)), v(size(x)), sum_u(size(x)), sum_v(size(x)))
    x = this%x_start
    y = this%y_start
    length = this%step/parts
    do part = 1, parts
      begin = this%time + this%step*(part - 1)/parts
      call velocity%at(x, y, begin, u, v)
      sum_u = u
      sum_v = v
      do stage = 2, 4
        call velocity%at(x + forward(stage - 1)*length*u, y + forward(stage - 1)*length*v, &
                         begin + forward(stage - 1)*length, u, v)
        sum_u = sum_u + share(stage)*u
        sum_v = sum_v + share(stage)*v
      end do
      if (.not. (all(ieee_is_finite(sum_u)) .and. all(ieee_is_finite(sum_v)))) then
        wrong = findloc(ieee_is_finite(sum_u) .and. ieee_is_finite(sum_v), .false., dim=1)
        call raise(error, status_bad_numbers, velocity%place//': about t = '// &
                   to_text(begin, digits=6)//' s the velocity gives no number near ('// &
                   to_text(x(wrong), digits=6)//', '//to_text(y(wrong), digits=6)//').')
        return
      end if
      x = x + (length/6)*sum_u
      y = y + (length/6)*sum_v
      if (4*part == parts) then
        this%x_early = x
        this%y_early = y
      else if (2*part == parts) then
        this%x_middle = x
        this%y_middle = y
      else if (4*part == 3*parts) then
        this%x_late = x
        this%y_late = y
      end if
    end do
  end subroutine carry

  pure function largest_distance(x, y, other_x, other_y) result(distance)
    real(wp), intent(in) :: x(:), y(:), other_x(:), other_y(:)
    real(wp) :: distance
    integer :: k

    distance = 0
    do k = 1, size(x)
      distance = max(distance, hypot(x(k) - other_x(k), y(k) - other_y(k)))
    end do
  end function largest_distance

  !> The interpolation's error is about X⁽⁵⁾ H⁵/5! times 0.0035, the largest product of the
  !> distances to five nodes; its derivative is wrong by X⁽⁵⁾ H⁴/5! times 3/32 at the end, where
  !> that is measured.
  subroutine interpolate(this, velocity, places, wrong)
    class(particle_path_t), intent(in) :: this
    !> The velocity
    type(velocity_t), intent(inout) :: velocity
    !> The polynomials, about the middle of the step
    type(places_t), intent(inout) :: places
    !> About how far they are from the paths, m
    real(wp), intent(out) :: wrong
    real(wp), parameter :: ratio = 0.0035_wp*32/3
    real(wp), allocatable :: u(:), v(:)
    integer :: k

    places%time = this%time + 0.5_wp*this%step
    places%step = this%step
    places%x = this%x_middle
    places%y = this%y_middle
    places%x_way = ways(this%x_start, this%x_early, this%x_middle, this%x_late, this%x_end)
    places%y_way = ways(this%y_start, this%y_early, this%y_middle, this%y_late, this%y_end)
    allocate (u(size(this%x_end)), v(size(this%x_end)))
    call velocity%at(this%x_end, this%y_end, this%time + this%step, u, v)
    wrong = 0
    do k = 1, size(u)
      wrong = max(wrong, hypot(slope(places%x_way(:, k)) - this%step*u(k), &
                               slope(places%y_way(:, k)) - this%step*v(k)))
    end do
    wrong = ratio*wrong

  contains

    !> Derivative at s = 1/2
    pure function slope(way)
      real(wp), intent(in) :: way(4)
      real(wp) :: slope

      slope = way(1) + way(2) + 0.75_wp*way(3) + 0.5_wp*way(4)
    end function slope

  end subroutine interpolate

  !> Coefficients of the polynomials through places at s = -1/2, -1/4, 0, 1/4, 1/2.
  pure function ways(start, early, middle, late, end) result(way)
    real(wp), intent(in) :: start(:), early(:), middle(:), late(:), end(:)
    real(wp) :: way(4, size(middle))

    associate (odd => 0.5_wp*(late - early), wide_odd => 0.5_wp*(end - start), &
               even => 0.5_wp*(late + early) - middle, wide_even => 0.5_wp*(end + start) - middle)
      way(1, :) = (16*odd - 2*wide_odd)/3
      way(3, :) = (32*wide_odd - 64*odd)/3
      way(2, :) = (64*even - 4*wide_even)/3
      way(4, :) = (64*wide_even - 256*even)/3
    end associate
  end function ways

end module calor_particle_path
