!> Conductivities κ(x, y, T) that are no product of a function of the place and one of the
!> temperature.
!>
!> With κ₀(x) the conductivity at a reference temperature and c = κ/κ₀ it follows from
!> div(cκ₀∇u) = [div(κ₀∇(cu)) + c div(κ₀∇u) - u div(κ₀∇c)]/2 that rows Σ a_ij (u_j - u_i) + Σ b q
!> for div(κ₀∇u) give the rows Σ a_ij (c_i + c_j)/2 (u_j - u_i) + Σ b q, of the same order and with
!> the same signs, whatever the scheme. The c are those of the present temperatures.
module calor_local_conductivity
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_error, only: error_t
  use calor_expression, only: expression_t, compile_expression
  use calor_kinds, only: wp
  use calor_text, only: text_t
  implicit none (type, external)
  private

  public :: local_conductivity_t, half_of_products

  !> Temperatures of a range that are looked at for extreme values
  integer, parameter :: temperatures = 17
  !> Half the step of differences with respect to the temperature, as a part of the range
  real(wp), parameter :: part = 1.0e-5_wp

  type :: local_conductivity_t
    !> T₀
    real(wp) :: reference = 0.0_wp
    !> At the state of the last `mark`, of all particles: c, ∂c/∂T, the potential u less the
    !> reference temperature, and what the rows make of u and of c
    real(wp), allocatable :: factor(:), factor_slope(:), level(:), flow(:), factor_flow(:)
    !> The conductivity of each such material, and which particles consist of it
    type(text_t), allocatable, private :: conductivity(:)
    integer, allocatable, private :: first(:), member(:)
    !> Where these were at the start, m, and their κ₀
    real(wp), allocatable, private :: x(:), y(:), cold(:)
    !> The range of temperatures that may occur, and the least c in it
    real(wp), private :: lowest = 0.0_wp, highest = 0.0_wp, least = 1.0_wp
  contains
    !> Take up how many particles there are, and what temperatures may occur
    procedure :: prepare
    !> Take up a material
    procedure :: add_material
    !> c at temperatures
    procedure :: find_factor
    !> Take c and ∂c/∂T at a state
    procedure :: mark
    !> Take the largest c of a range for it, and 0 for the rest
    procedure :: assume_largest
    procedure, private :: evaluate
  end type local_conductivity_t

contains

  !> Half the sum R(cu) + c R(u) - u R(c) of what rows make of fields.
  elemental function half_of_products(factor, level, of_product, of_level, of_factor) result(half)
    !> c and u
    real(wp), intent(in) :: factor, level
    !> What the rows make of cu, u and c
    real(wp), intent(in) :: of_product, of_level, of_factor
    real(wp) :: half

    half = 0.5_wp*(of_product + factor*of_level - level*of_factor)
  end function half_of_products

  subroutine prepare(this, particles, reference, lowest, highest)
    class(local_conductivity_t), intent(out) :: this
    !> Number of particles
    integer, intent(in) :: particles
    !> T₀, and the range of temperatures
    real(wp), intent(in) :: reference, lowest, highest

    this%reference = reference
    this%lowest = lowest
    this%highest = highest
    allocate (this%conductivity(0), this%member(0), this%x(0), this%y(0), this%cold(0))
    this%first = [1]
    allocate (this%factor(particles), source=1.0_wp)
    allocate (this%factor_slope(particles), this%level(particles), this%flow(particles), &
              this%factor_flow(particles), source=0.0_wp)
  end subroutine prepare

  subroutine add_material(this, conductivity, member, x, y)
    class(local_conductivity_t), intent(inout) :: this
    !> Its conductivity, which is positive at all places and temperatures
    type(text_t), intent(in) :: conductivity
    !> The particles that consist of it, and where these are, m
    integer, intent(in) :: member(:)
    real(wp), intent(in) :: x(:), y(:)
    real(wp), allocatable :: factor(:), same(:)
    integer :: step

    this%conductivity = [this%conductivity, conductivity]
    this%member = [this%member, member]
    this%x = [this%x, x]
    this%y = [this%y, y]
    this%cold = [this%cold, spread(1.0_wp, 1, size(member))]
    this%first = [this%first, size(this%member) + 1]
    allocate (factor(size(this%factor)), same(size(this%factor)))
    same = this%reference
    call this%evaluate(same, factor)
    associate (from => this%first(size(this%conductivity)))
      this%cold(from:) = factor(this%member(from:))
    end associate
    do step = 0, temperatures - 1
      same = this%lowest + (this%highest - this%lowest)*step/(temperatures - 1)
      call this%evaluate(same, factor)
      this%least = min(this%least, minval(factor(member)))
    end do
  end subroutine add_material

  !> κ/`cold`
  subroutine evaluate(this, temperature, factor)
    class(local_conductivity_t), intent(in) :: this
    real(wp), intent(in) :: temperature(:)
    real(wp), intent(out) :: factor(:)
    type(expression_t) :: expression
    type(error_t), allocatable :: error
    real(wp), allocatable :: value(:)
    integer :: k

    factor = 1
    do k = 1, size(this%conductivity)
      call compile_expression(this%conductivity(k)%value, expression, error)
      associate (from => this%first(k), to => this%first(k + 1) - 1)
        allocate (value(to - from + 1))
        call expression%evaluate(this%x(from:to), this%y(from:to), 0.0_wp, value, &
                                 temperature(this%member(from:to)))
        factor(this%member(from:to)) = value/this%cold(from:to)
        deallocate (value)
      end associate
    end do
  end subroutine evaluate

  !> Where κ has no positive value, as a state that leaves its range may bring about, the least
  !> known one holds.
  subroutine find_factor(this, temperature, factor)
    class(local_conductivity_t), intent(in) :: this
    !> Temperatures of all particles
    real(wp), intent(in) :: temperature(:)
    !> c
    real(wp), intent(out) :: factor(:)
    integer :: k

    call this%evaluate(temperature, factor)
    do k = 1, size(factor)
      if (ieee_is_finite(factor(k))) then
        factor(k) = max(factor(k), 0.1_wp*this%least)
      else
        factor(k) = this%least
      end if
    end do
  end subroutine find_factor

  !> The derivative is by central differences: an expression has no other one.
  subroutine mark(this, temperature)
    class(local_conductivity_t), intent(inout) :: this
    !> Temperatures of all particles
    real(wp), intent(in) :: temperature(:)
    real(wp), allocatable :: above(:), below(:)
    real(wp) :: step

    step = part*(this%highest - this%lowest)
    if (.not. step > 0) step = part*max(1.0_wp, abs(this%reference))
    allocate (above(size(temperature)), below(size(temperature)))
    call this%find_factor(temperature + step, above)
    call this%find_factor(temperature - step, below)
    this%factor_slope = (above - below)/(2*step)
    call this%find_factor(temperature, this%factor)
  end subroutine mark

  subroutine assume_largest(this, lowest, highest)
    class(local_conductivity_t), intent(inout) :: this
    !> Range of temperatures
    real(wp), intent(in) :: lowest, highest
    real(wp), allocatable :: same(:), factor(:)
    integer :: step

    allocate (same(size(this%factor)), factor(size(this%factor)))
    this%factor = 0
    do step = 0, temperatures - 1
      same = lowest + (highest - lowest)*step/(temperatures - 1)
      call this%find_factor(same, factor)
      this%factor = max(this%factor, factor)
    end do
    this%factor_slope = 0
    this%level = 0
    this%flow = 0
    this%factor_flow = 0
  end subroutine assume_largest

end module calor_local_conductivity
