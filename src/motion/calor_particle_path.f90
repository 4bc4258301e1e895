!> The paths of particles that a velocity field carries, over one step of the motion.
!>
!> dX/dt = v(X, t) is integrated by the classical Runge–Kutta method of fourth order, in two halves
!> and once more as a whole: the difference, over 15, is what the halves are wrong by. Between the
!> three places the path is the polynomial of degree 5 that has their velocities too.
module calor_particle_path
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_constants, only: worth_threads
  use calor_error, only: error_t, raise, status_bad_numbers
  use calor_kinds, only: wp, i8
  use calor_places, only: places_t
  use calor_text, only: to_text
  use calor_velocity, only: velocity_t
  implicit none (type, external)
  private

  public :: particle_path_t

  !> Where particles are at the beginning, in the middle and at the end of a step
  type :: particle_path_t
    !> Beginning, s, and length, s, of the step
    real(wp) :: time = 0.0_wp, step = 0.0_wp
    !> m
    real(wp), allocatable :: x_start(:), y_start(:), x_middle(:), y_middle(:), x_end(:), y_end(:)
    !> Their velocities there, m/s
    real(wp), allocatable, private :: u_start(:), v_start(:), u_middle(:), v_middle(:), u_end(:), &
                                      v_end(:)
  contains
    !> Find the paths
    procedure :: follow
    !> The polynomials
    procedure :: interpolate
    !> Memory that it takes, bytes
    procedure :: bytes
  end type particle_path_t

contains

  !> Find the paths of particles over a step.
  subroutine follow(this, velocity, x, y, u, v, time, step, wrong, error)
    class(particle_path_t), intent(inout) :: this
    !> The velocity
    type(velocity_t), intent(inout) :: velocity
    !> Where the particles are, m, and how fast, m/s
    real(wp), intent(in) :: x(:), y(:), u(:), v(:)
    !> s
    real(wp), intent(in) :: time, step
    !> About how far a place at the end is wrong, m
    real(wp), intent(out) :: wrong
    !> The velocity is no number somewhere
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: other_x(:), other_y(:)
    integer :: k

    this%time = time
    this%step = step
    this%x_start = x
    this%y_start = y
    this%u_start = u
    this%v_start = v
    call advance(velocity, time, step, x, y, u, v, other_x, other_y)
    call advance(velocity, time, 0.5_wp*step, x, y, u, v, this%x_middle, this%y_middle)
    if (.not. allocated(this%u_end)) then
      allocate (this%u_middle(size(x)), this%v_middle(size(x)))
      allocate (this%u_end(size(x)), this%v_end(size(x)))
    end if
    call velocity%at(this%x_middle, this%y_middle, time + 0.5_wp*step, this%u_middle, this%v_middle)
    call advance(velocity, time + 0.5_wp*step, 0.5_wp*step, this%x_middle, this%y_middle, &
                 this%u_middle, this%v_middle, this%x_end, this%y_end)
    call velocity%at(this%x_end, this%y_end, time + step, this%u_end, this%v_end)
    wrong = 0
    do k = 1, size(x)
      if (ieee_is_finite(this%x_end(k)) .and. ieee_is_finite(this%y_end(k)) .and. &
          ieee_is_finite(this%u_end(k)) .and. ieee_is_finite(this%v_end(k)) .and. &
          ieee_is_finite(other_x(k)) .and. ieee_is_finite(other_y(k))) then
        wrong = max(wrong, hypot(this%x_end(k) - other_x(k), this%y_end(k) - other_y(k))/15)
      else
        call raise(error, status_bad_numbers, velocity%place//': beyond t = '// &
                   to_text(time, digits=6)//' s the velocity gives no number near ('// &
                   to_text(x(k), digits=6)//', '//to_text(y(k), digits=6)//').')
        return
      end if
    end do
  end subroutine follow

  !> One step of the Runge–Kutta method.
  subroutine advance(velocity, time, step, x, y, u, v, new_x, new_y)
    type(velocity_t), intent(inout) :: velocity
    !> s
    real(wp), intent(in) :: time, step
    !> Places, m, and velocities there, m/s
    real(wp), intent(in) :: x(:), y(:), u(:), v(:)
    !> m
    real(wp), allocatable, intent(inout) :: new_x(:), new_y(:)
    real(wp), parameter :: forward(2:4) = [0.5_wp, 0.5_wp, 1.0_wp], &
                           share(2:4) = [2.0_wp, 2.0_wp, 1.0_wp]
    real(wp), allocatable :: stage_u(:), stage_v(:), sum_u(:), sum_v(:)
    integer :: stage

    stage_u = u
    stage_v = v
    sum_u = u
    sum_v = v
    do stage = 2, 4
      call velocity%at(x + forward(stage)*step*stage_u, y + forward(stage)*step*stage_v, &
                       time + forward(stage)*step, stage_u, stage_v)
      sum_u = sum_u + share(stage)*stage_u
      sum_v = sum_v + share(stage)*stage_v
    end do
    new_x = x + (step/6)*sum_u
    new_y = y + (step/6)*sum_v
  end subroutine advance

  subroutine interpolate(this, places)
    class(particle_path_t), intent(in) :: this
    !> The polynomials, about the middle of the step
    type(places_t), intent(inout) :: places

    places%time = this%time + 0.5_wp*this%step
    places%step = 0.5_wp*this%step
    places%x = this%x_middle
    places%y = this%y_middle
    if (.not. allocated(places%x_way)) then
      allocate (places%x_way(5, size(this%x_end)), places%y_way(5, size(this%x_end)))
    end if
    call find_ways(this%x_start, this%x_middle, this%x_end, places%step, this%u_start, &
                   this%u_middle, this%u_end, places%x_way)
    call find_ways(this%y_start, this%y_middle, this%y_end, places%step, this%v_start, &
                   this%v_middle, this%v_end, places%y_way)
  end subroutine interpolate

  !> Coefficients of s … s⁵ of the polynomials with given values and derivatives at s = -1, 0, 1.
  subroutine find_ways(start, middle, end, half, start_rate, middle_rate, end_rate, way)
    !> m
    real(wp), intent(in) :: start(:), middle(:), end(:)
    !> Half of the step, s, in units of which s is
    real(wp), intent(in) :: half
    !> m/s
    real(wp), intent(in) :: start_rate(:), middle_rate(:), end_rate(:)
    real(wp), intent(out) :: way(:, :)
    real(wp) :: odd, even, odd_slope, even_slope
    integer :: k

    !$omp parallel do if (size(middle) > worth_threads) schedule(static) default(shared) &
    !$omp private(k, odd, even, odd_slope, even_slope)
    do k = 1, size(middle)
      ! odd: a₁ + a₃ + a₅, its slope a₁ + 3 a₃ + 5 a₅; even: a₂ + a₄, its slope 2 a₂ + 4 a₄
      odd = 0.5_wp*(end(k) - start(k))
      even = 0.5_wp*(end(k) + start(k)) - middle(k)
      odd_slope = 0.5_wp*half*(end_rate(k) + start_rate(k))
      even_slope = 0.5_wp*half*(end_rate(k) - start_rate(k))
      way(1, k) = half*middle_rate(k)
      way(2, k) = 2*even - 0.5_wp*even_slope
      way(4, k) = 0.5_wp*even_slope - even
      way(5, k) = 0.5_wp*(odd_slope - 3*odd + 2*way(1, k))
      way(3, k) = odd - way(1, k) - way(5, k)
    end do
    !$omp end parallel do
  end subroutine find_ways

  pure function bytes(this) result(number)
    class(particle_path_t), intent(in) :: this
    integer(i8) :: number

    number = 0
    if (allocated(this%u_end)) number = 12*size(this%u_end, kind=i8)*storage_size(1.0_wp)/8
  end function bytes

end module calor_particle_path
