!> Heat conduction in a body of constant material: u_t = κ/(ρc) ∇²u, held temperatures on walls.
module calor_conduction
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_constants, only: worth_threads
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
  !> Beyond this, in the same units, a state may not go farther step after step …
  real(wp), parameter :: large_excursion = 1.0_wp
  !> … for so many steps
  integer, parameter :: most_growing_steps = 5

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
    !> What to blame should the numbers go wrong, in a sentence; not allocated: the scheme
    character(len=:), allocatable :: suspicion
    !> How far the last state left the range, and for how many steps that has grown
    real(wp), private :: excursion = 0.0_wp
    integer, private :: growing_steps = 0
  contains
    procedure :: unknowns
    procedure :: rate
    procedure :: jacobian_product
    procedure :: impose
    procedure :: clear_prescribed
    procedure :: inspect
    !> The largest -a_ii of the Jacobian where none of its weights is negative, 1/s; else 0
    procedure :: fastest_decay
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
    real(wp) :: low, high, range, rounding, worst, outside
    integer :: k, particle
    logical :: finite

    low = this%lowest
    high = this%highest
    range = high - low
    ! Where all temperatures are equal, rounding must not count
    rounding = 1.0e-6_wp*max(abs(low), abs(high))
    worst = 0
    finite = .true.
    !$omp parallel do if (size(u) > worth_threads) schedule(static) default(shared) private(k) &
    !$omp reduction(max:worst) &
    !$omp reduction(.and.:finite)
    do k = 1, size(u)
      if (abs(u(k)) <= huge(1.0_wp)) then
        worst = max(worst, low - u(k), u(k) - high)
      else
        finite = .false.
      end if
    end do
    !$omp end parallel do
    if (finite) then
      this%growing_steps = this%growing_steps + 1
      if (.not. (worst > this%excursion .and. worst > large_excursion*range + rounding)) then
        this%growing_steps = 0
      end if
      this%excursion = worst
      if (this%growing_steps < most_growing_steps .and. &
          worst <= largest_excursion*range + rounding) return
    end if
    particle = 0
    outside = 0
    do k = 1, size(u)
      if (.not. abs(u(k)) <= huge(1.0_wp)) then
        particle = k
        exit
      end if
      if (max(low - u(k), u(k) - high) <= outside) cycle
      outside = max(low - u(k), u(k) - high)
      particle = k
    end do
    call report_excursion(this, time, particle, u(particle), error)
  end subroutine inspect

  !> Which particle is where it cannot be, when, and what may be the reason.
  subroutine report_excursion(this, time, particle, temperature, error)
    class(conduction_t), intent(in) :: this
    real(wp), intent(in) :: time
    integer, intent(in) :: particle
    real(wp), intent(in) :: temperature
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: what, suspicion

    if (abs(temperature) <= huge(1.0_wp)) then
      what = 'is '//to_text(temperature, digits=4)//' and moves on away from'
    else
      what = 'is no finite number any more; it left'
    end if
    suspicion = 'The scheme is unstable on this cloud: take &scheme support_growth = .true. or '// &
                'laplacian = ''positive'', or a less irregular arrangement.'
    if (allocated(this%suspicion)) suspicion = this%suspicion
    call raise(error, status_bad_numbers, 'At t = '//to_text(time, digits=6)// &
               ' s the temperature of particle '//to_text(this%user_index(particle))//' at ('// &
               to_text(this%x(particle), digits=6)//', '//to_text(this%y(particle), digits=6)// &
               ') '//what//' the range of the given temperatures, '// &
               to_text(this%lowest, digits=4)//' to '//to_text(this%highest, digits=4)//'.'// &
               new_line('a')//suspicion)
  end subroutine report_excursion

  pure function spectral_bound(this) result(bound)
    class(conduction_t), intent(in) :: this
    real(wp) :: bound

    bound = this%diffusivity*this%laplacian%gershgorin_bound()
  end function spectral_bound

  pure function fastest_decay(this) result(rate)
    class(conduction_t), intent(in) :: this
    real(wp) :: rate

    rate = 0
    if (any(this%laplacian%weight < 0)) return
    rate = this%diffusivity*maxval(-this%laplacian%diagonal)
  end function fastest_decay

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
