!> Heat conduction in a body of constant material: u_t = κ/(ρc) ∇²u, held temperatures on walls.
module calor_conduction
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_error, only: error_t, raise, status_bad_numbers
  use calor_evolution, only: evolution_t
  use calor_kinds, only: wp
  use calor_prescribed, only: prescribed_t
  use calor_sparse_operator, only: sparse_operator_t
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: conduction_t

  !> How far, in units of the range of all given temperatures, a state may leave that range before
  !> it counts as unstable. Conduction alone never leaves it; a scheme may by a little.
  real(wp), parameter :: largest_excursion = 10.0_wp

  type, extends(evolution_t) :: conduction_t
    !> ∇² at the particles that are not held
    type(sparse_operator_t) :: laplacian
    !> κ/(ρc), m²/s
    real(wp) :: diffusivity = 1.0_wp
    !> The held particles
    type(prescribed_t), allocatable :: prescribed(:)
    !> Coordinates, m, and user's number of each particle, for messages
    real(wp), allocatable :: x(:), y(:)
    integer, allocatable :: user_index(:)
    !> Lowest and highest of all temperatures given so far
    real(wp) :: lowest = huge(1.0_wp), highest = -huge(1.0_wp)
  contains
    procedure :: unknowns
    procedure :: rate
    procedure :: jacobian_product
    procedure :: impose
    procedure :: clear_prescribed
    procedure :: inspect
    !> An upper bound of the spectral radius, 1/s
    procedure :: spectral_bound
    !> Widen the range of given temperatures
    procedure :: note_range
  end type conduction_t

contains

  pure function unknowns(this) result(number)
    class(conduction_t), intent(in) :: this
    integer :: number

    number = size(this%x)
  end function unknowns

  subroutine rate(this, time, u, du)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in) :: u(:)
    real(wp), intent(out) :: du(:)

    associate (unused => time)
    end associate
    call this%laplacian%apply_at_targets(this%diffusivity, u, du)
    call this%clear_prescribed(du)
  end subroutine rate

  subroutine jacobian_product(this, v, product)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in) :: v(:)
    real(wp), intent(out) :: product(:)

    call this%rate(0.0_wp, v, product)
  end subroutine jacobian_product

  subroutine impose(this, time, u)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(inout) :: u(:)
    integer :: k

    do k = 1, size(this%prescribed)
      call this%prescribed(k)%impose(time, u)
      call this%note_range(this%prescribed(k)%temperature)
    end do
  end subroutine impose

  subroutine clear_prescribed(this, v)
    class(conduction_t), intent(in) :: this
    real(wp), intent(inout) :: v(:)
    integer :: k

    do k = 1, size(this%prescribed)
      v(this%prescribed(k)%particle) = 0
    end do
  end subroutine clear_prescribed

  subroutine inspect(this, time, u, error)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in) :: u(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: low, high, worst, leave
    integer :: k, particle

    low = this%lowest
    high = this%highest
    ! Where all temperatures are equal, rounding must not count
    leave = largest_excursion*(high - low) + 1.0e-6_wp*max(abs(low), abs(high))
    worst = 0
    !$omp parallel do schedule(static) default(shared) private(k) reduction(max:worst)
    do k = 1, size(u)
      ! Written so that a NaN counts as outside
      if (.not. (u(k) >= low - leave .and. u(k) <= high + leave)) worst = 1
    end do
    !$omp end parallel do
    if (.not. worst > 0) return
    do particle = 1, size(u) - 1
      if (.not. (u(particle) >= low - leave .and. u(particle) <= high + leave)) exit
    end do
    call raise(error, status_bad_numbers, 'At t = '//to_text(time, digits=6)// &
               ' s the temperature of particle '//to_text(this%user_index(particle))//' at ('// &
               to_text(this%x(particle), digits=6)//', '//to_text(this%y(particle), digits=6)// &
               ') left the range of the given temperatures, '//to_text(low, digits=4)//' to '// &
               to_text(high, digits=4)//', by more than ten times that range:'//new_line('a')// &
               'the scheme is unstable on this cloud. Take a larger &kernel support, '// &
               'a less irregular arrangement, or another &scheme laplacian.')
  end subroutine inspect

  pure function spectral_bound(this) result(bound)
    class(conduction_t), intent(in) :: this
    real(wp) :: bound

    bound = this%diffusivity*this%laplacian%gershgorin_bound()
  end function spectral_bound

  subroutine note_range(this, temperature)
    class(conduction_t), intent(inout) :: this
    !> Temperatures that are given, not computed
    real(wp), intent(in) :: temperature(:)

    if (size(temperature) == 0) return
    ! An expression without a value: the stepper notices what comes of it
    if (.not. all(ieee_is_finite(temperature))) return
    this%lowest = min(this%lowest, minval(temperature))
    this%highest = max(this%highest, maxval(temperature))
  end subroutine note_range

end module calor_conduction
