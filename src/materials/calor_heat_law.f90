!> How the heat in a material and its conduction depend on the temperature.
!>
!> With ρc = C₀(x) g(T) and κ = κ₀(x) f(T), f and g being 1 at a reference temperature T₀,
!>
!>     s = T₀ + ∫ g dT,    θ = T₀ + ∫ f dT    (integrals from T₀ to T)
!>
!> are the sensible heat in units of C₀ and the Kirchhoff potential, both in K: ρc ∂T/∂t = C₀ ∂s/∂t
!> and κ∇T = κ₀∇θ, so that div(κ∇T) = div(κ₀∇θ) is linear in θ. The heat content is v = s + φ L/c,
!> with the liquid fraction φ growing in proportion to s from the solidus to the liquidus. It is the
!> unknown of the heat equation; temperature and potential are functions of it.
!>
!> T(s) and θ(s) are tabulated where f or g is not 1: dT/ds = 1/g and dθ/ds = f/g are integrated
!> by the classical Runge–Kutta method between equidistant nodes, with cubic Hermite polynomials in
!> between. Errors are those of fourth order in 1/2048 of the range of given temperatures, about
!> 10⁻¹³ of it where f and g vary over that range; at a jump of f or g they are of first order. A
!> table grows as temperatures leave it. Where f or g is not positive, it ends: they keep their last
!> values from there on.
!>
!> Sources: H.S. Carslaw, J.C. Jaeger, Conduction of Heat in Solids, 2nd edition, Oxford 1959,
!> section 1.6; V. Alexiades, A.D. Solomon, Mathematical Modeling of Melting and Freezing Processes,
!> Hemisphere 1993, chapter 4.
module calor_heat_law
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_error, only: error_t
  use calor_expression, only: expression_t, compile_expression
  use calor_kinds, only: wp
  use calor_text, only: text_t
  implicit none (type, external)
  private

  public :: heat_law_t

  !> Nodes over the range of given temperatures, and at most in all
  integer, parameter :: usual_nodes = 2048, most_nodes = 2**18

  !> The law of one material
  type :: heat_law_t
    !> Whether the heat capacity and whether the conductivity depend on the temperature
    logical :: stores = .false., conducts = .false.
    !> Whether it melts; where that begins and where it is complete, equal for a pure substance; and
    !> latent heat over heat capacity, K
    logical :: melts = .false.
    real(wp) :: solidus = 0.0_wp, liquidus = 0.0_wp, rise = 0.0_wp
    !> κ, and density and heat capacity, as expressions, at the place where f and g are taken from
    type(text_t) :: conductivity, density, heat_capacity
    real(wp) :: x = 0.0_wp, y = 0.0_wp
    !> T₀
    real(wp) :: reference = 0.0_wp
    !> Solidus and liquidus as sensible heats
    real(wp), private :: begins = 0.0_wp, ends = 0.0_wp
    !> First node of the table and the distance between nodes, K
    real(wp), private :: first = 0.0_wp, step = 1.0_wp
    !> T, dT/ds, θ, dθ/ds at the nodes, one a column, the derivatives times the distance of nodes
    real(wp), allocatable, private :: node(:, :)
    !> Whether f or g ends at either end of the table
    logical, private :: ended(2) = .false.
  contains
    !> Tabulate what is not constant
    procedure :: prepare
    !> Make the table reach some heat contents
    procedure :: reach
    !> Temperature and potential of a heat content, and their derivatives
    procedure :: evaluate
    procedure :: slopes
    !> Heat content of a temperature, and potential
    procedure :: content
    procedure :: potential
    !> dθ/dT
    procedure :: conductivity_factor
    !> How much is liquid
    procedure :: liquid_fraction
    !> Heat contents where latent heat over heat capacity is another one
    procedure :: rescaled
    procedure :: rescaled_slope
    !> The largest dT/dv and dθ/dv at temperatures of a range
    procedure :: largest_slopes
    !> f and g at a temperature
    procedure :: factors
    procedure, private :: extend
    procedure, private :: sensible
    procedure, private :: sensible_part
    procedure, private :: table_slopes
  end type heat_law_t

contains

  !> Tabulate over a range of temperatures in which f and g are positive.
  subroutine prepare(this, lowest, highest)
    class(heat_law_t), intent(inout) :: this
    !> The range of given temperatures
    real(wp), intent(in) :: lowest, highest
    real(wp) :: f, g, g_low, g_high

    if (this%stores .or. this%conducts) then
      call this%factors(lowest, f, g_low)
      call this%factors(highest, f, g_high)
      call this%factors(this%reference, f, g)
      ! As fine in terms of the heat content as in terms of the temperature
      this%step = (highest - lowest)/usual_nodes*min(1.0_wp, g_low, g_high)
      if (.not. this%step > 0) this%step = max(1.0_wp, abs(highest))/usual_nodes
      this%first = this%reference
      allocate (this%node(4, 1))
      this%node(:, 1) = [this%reference, this%step/g, this%reference, this%step*f/g]
      ! Stages of a step may lie a little outside.
      associate (margin => 0.1_wp*(highest - lowest) + 8*this%step)
        call this%extend(lowest - margin, .false.)
        call this%extend(highest + margin, .true.)
      end associate
      if (this%melts) then
        call this%extend(this%solidus, .false.)
        call this%extend(this%liquidus, .true.)
      end if
    end if
    this%begins = this%sensible(this%solidus)
    this%ends = this%sensible(this%liquidus)
  end subroutine prepare

  !> Add nodes at one end, up to a temperature.
  subroutine extend(this, temperature, upwards)
    class(heat_law_t), intent(inout) :: this
    real(wp), intent(in) :: temperature
    logical, intent(in) :: upwards
    type(expression_t) :: conductivity, density, heat_capacity
    real(wp), allocatable :: more(:, :), longer(:, :)
    real(wp) :: state(2), rates(2, 5), start(3), h
    integer :: used, last, k
    logical :: ok

    if (this%ended(merge(2, 1, upwards))) return
    call compile_properties()
    last = merge(size(this%node, 2), 1, upwards)
    h = merge(this%step, -this%step, upwards)
    state = this%node([1, 3], last)
    used = 0
    allocate (more(4, usual_nodes))
    do
      if (merge(state(1) >= temperature, state(1) <= temperature, upwards)) exit
      ok = size(this%node, 2) + used < most_nodes
      if (ok) call find_rates(state(1), rates(:, 1), ok)
      if (ok) call find_rates(state(1) + 0.5_wp*h*rates(1, 1), rates(:, 2), ok)
      if (ok) call find_rates(state(1) + 0.5_wp*h*rates(1, 2), rates(:, 3), ok)
      if (ok) call find_rates(state(1) + h*rates(1, 3), rates(:, 4), ok)
      if (ok) then
        state = state + h/6*(rates(:, 1) + 2*rates(:, 2) + 2*rates(:, 3) + rates(:, 4))
        call find_rates(state(1), rates(:, 5), ok)
      end if
      if (.not. ok) then
        this%ended(merge(2, 1, upwards)) = .true.
        exit
      end if
      if (used == size(more, 2)) then
        allocate (longer(4, 2*used))
        longer(:, :used) = more
        call move_alloc(longer, more)
      end if
      used = used + 1
      more(:, used) = [state(1), this%step*rates(1, 5), state(2), this%step*rates(2, 5)]
    end do
    if (used == 0) return
    allocate (longer(4, size(this%node, 2) + used))
    if (upwards) then
      longer(:, :last) = this%node
      longer(:, last + 1:) = more(:, :used)
    else
      do k = 1, used
        longer(:, k) = more(:, used + 1 - k)
      end do
      longer(:, used + 1:) = this%node
      this%first = this%first - used*this%step
    end if
    call move_alloc(longer, this%node)

  contains

    !> The properties, and what they are at the reference temperature
    subroutine compile_properties()
      type(error_t), allocatable :: error

      start = 1
      if (this%conducts) then
        call compile_expression(this%conductivity%value, conductivity, error)
        call conductivity%evaluate(this%x, this%y, 0.0_wp, start(1), this%reference)
      end if
      if (.not. this%stores) return
      call compile_expression(this%density%value, density, error)
      call density%evaluate(this%x, this%y, 0.0_wp, start(2), this%reference)
      call compile_expression(this%heat_capacity%value, heat_capacity, error)
      call heat_capacity%evaluate(this%x, this%y, 0.0_wp, start(3), this%reference)
    end subroutine compile_properties

    !> dT/ds and dθ/ds
    subroutine find_rates(at, rate, possible)
      real(wp), intent(in) :: at
      real(wp), intent(out) :: rate(2)
      logical, intent(out) :: possible
      real(wp) :: value(3)

      rate = 0
      value = 1
      if (this%conducts) call conductivity%evaluate(this%x, this%y, 0.0_wp, value(1), at)
      if (this%stores) then
        call density%evaluate(this%x, this%y, 0.0_wp, value(2), at)
        call heat_capacity%evaluate(this%x, this%y, 0.0_wp, value(3), at)
      end if
      possible = all(ieee_is_finite(value))
      if (.not. possible) return
      value = value/start
      possible = value(1) > 0 .and. value(2)*value(3) > 0
      if (possible) rate = [1.0_wp, value(1)]/(value(2)*value(3))
    end subroutine find_rates

  end subroutine extend

  subroutine factors(this, temperature, f, g)
    class(heat_law_t), intent(in) :: this
    !> Temperature
    real(wp), intent(in) :: temperature
    !> κ/κ₀ and ρc/C₀
    real(wp), intent(out) :: f, g

    f = 1
    g = 1
    if (this%conducts) f = ratio(this%conductivity)
    if (this%stores) g = ratio(this%density)*ratio(this%heat_capacity)

  contains

    function ratio(text)
      type(text_t), intent(in) :: text
      real(wp) :: ratio
      type(expression_t) :: expression
      type(error_t), allocatable :: error
      real(wp) :: values(2)

      call compile_expression(text%value, expression, error)
      call expression%evaluate([this%x, this%x], [this%y, this%y], 0.0_wp, values, &
                               [temperature, this%reference])
      ratio = values(1)/values(2)
    end function ratio

  end subroutine factors

  !> Make the table reach heat contents, unless it ends before.
  subroutine reach(this, lowest, highest)
    class(heat_law_t), intent(inout) :: this
    !> The heat contents, K
    real(wp), intent(in) :: lowest, highest
    real(wp) :: temperature, unused, s
    integer :: side

    if (.not. allocated(this%node)) return
    do side = 1, 2
      do while (.not. this%ended(side))
        s = this%sensible_part(merge(lowest, highest, side == 1))
        if (side == 1 .and. s >= this%first) exit
        if (side == 2 .and. s <= this%first + (size(this%node, 2) - 1)*this%step) exit
        call this%evaluate(merge(lowest, highest, side == 1), temperature, unused)
        ! By a tenth of the table more, lest it grow by little again and again
        associate (margin => 0.1_wp*(this%node(1, size(this%node, 2)) - this%node(1, 1)))
          call this%extend(temperature + merge(-margin, margin, side == 1), side == 2)
        end associate
      end do
    end do
  end subroutine reach

  !> The sensible heat in a heat content
  elemental function sensible_part(this, content) result(s)
    class(heat_law_t), intent(in) :: this
    real(wp), intent(in) :: content
    real(wp) :: s

    s = content
    if (.not. this%melts) return
    if (content <= this%begins) return
    if (content >= this%ends + this%rise) then
      s = content - this%rise
    else
      s = this%begins + (this%ends - this%begins)/(this%ends + this%rise - this%begins)* &
          (content - this%begins)
    end if
  end function sensible_part

  elemental subroutine evaluate(this, content, temperature, potential)
    class(heat_law_t), intent(in) :: this
    !> Heat content, K
    real(wp), intent(in) :: content
    !> Its temperature and Kirchhoff potential
    real(wp), intent(out) :: temperature, potential
    real(wp) :: s, z, t
    integer :: k, last

    temperature = content
    potential = content
    ! What is no number stays none; to compare it would be a floating-point exception.
    if (.not. ieee_is_finite(content)) return
    s = this%sensible_part(content)
    temperature = s
    potential = s
    if (.not. allocated(this%node)) return
    last = size(this%node, 2)
    z = (s - this%first)/this%step
    if (z >= 0 .and. z < last - 1) then
      k = int(z) + 1
      t = z - (k - 1)
      associate (a => this%node(:, k), b => this%node(:, k + 1))
        if (this%stores) temperature = cubic(t, a(1), a(2), b(1), b(2))
        potential = temperature
        if (this%conducts) potential = cubic(t, a(3), a(4), b(3), b(4))
      end associate
    else
      k = merge(1, last, z < 0)
      associate (a => this%node(:, k))
        if (this%stores) temperature = a(1) + (z - (k - 1))*a(2)
        potential = temperature
        if (this%conducts) potential = a(3) + (z - (k - 1))*a(4)
      end associate
    end if
  end subroutine evaluate

  !> The cubic polynomial of given values and derivatives at 0 and 1
  elemental function cubic(t, value_0, slope_0, value_1, slope_1) result(value)
    real(wp), intent(in) :: t, value_0, slope_0, value_1, slope_1
    real(wp) :: value

    associate (rise => value_1 - value_0)
      value = value_0 + t*(slope_0 + t*(3*rise - 2*slope_0 - slope_1 + &
                                        t*(slope_0 + slope_1 - 2*rise)))
    end associate
  end function cubic

  !> Its derivative
  elemental function cubic_slope(t, value_0, slope_0, value_1, slope_1) result(slope)
    real(wp), intent(in) :: t, value_0, slope_0, value_1, slope_1
    real(wp) :: slope

    associate (rise => value_1 - value_0)
      slope = slope_0 + t*(2*(3*rise - 2*slope_0 - slope_1) + &
                           3*t*(slope_0 + slope_1 - 2*rise))
    end associate
  end function cubic_slope

  elemental subroutine slopes(this, content, temperature_slope, potential_slope)
    class(heat_law_t), intent(in) :: this
    !> Heat content, K
    real(wp), intent(in) :: content
    !> dT/dv and dθ/dv
    real(wp), intent(out) :: temperature_slope, potential_slope
    real(wp) :: share

    temperature_slope = 1
    potential_slope = 1
    if (.not. ieee_is_finite(content)) return
    share = 1
    if (this%melts) then
      if (content > this%begins .and. content < this%ends + this%rise) then
        share = (this%ends - this%begins)/(this%ends + this%rise - this%begins)
      end if
    end if
    call this%table_slopes(this%sensible_part(content), temperature_slope, potential_slope)
    temperature_slope = share*temperature_slope
    potential_slope = share*potential_slope
  end subroutine slopes

  !> dT/ds and dθ/ds
  elemental subroutine table_slopes(this, s, temperature_slope, potential_slope)
    class(heat_law_t), intent(in) :: this
    real(wp), intent(in) :: s
    real(wp), intent(out) :: temperature_slope, potential_slope
    real(wp) :: z, t
    integer :: k

    temperature_slope = 1
    potential_slope = 1
    if (.not. allocated(this%node)) return
    z = (s - this%first)/this%step
    k = 1 + int(min(max(z, 0.0_wp), real(size(this%node, 2) - 2, wp)))
    t = min(max(z - (k - 1), 0.0_wp), 1.0_wp)
    associate (a => this%node(:, k), b => this%node(:, k + 1))
      if (this%stores) temperature_slope = cubic_slope(t, a(1), a(2), b(1), b(2))/this%step
      potential_slope = temperature_slope
      if (this%conducts) potential_slope = cubic_slope(t, a(3), a(4), b(3), b(4))/this%step
    end associate
  end subroutine table_slopes

  !> Where solidus and liquidus are equal, what has just that temperature is taken for solid.
  elemental function content(this, temperature)
    class(heat_law_t), intent(in) :: this
    !> Temperature
    real(wp), intent(in) :: temperature
    !> Its heat content, K
    real(wp) :: content

    content = this%sensible(temperature)
    if (.not. this%melts) return
    if (temperature <= this%solidus) return
    if (temperature >= this%liquidus) then
      content = content + this%rise
    else
      content = content + this%rise*(content - this%begins)/(this%ends - this%begins)
    end if
  end function content

  elemental function potential(this, temperature)
    class(heat_law_t), intent(in) :: this
    !> Temperature
    real(wp), intent(in) :: temperature
    !> Its Kirchhoff potential, K
    real(wp) :: potential
    real(wp) :: unused

    call this%evaluate(this%content(temperature), unused, potential)
  end function potential

  !> By the tables, whose θ it is to belong to
  elemental function conductivity_factor(this, temperature) result(f)
    class(heat_law_t), intent(in) :: this
    !> Temperature
    real(wp), intent(in) :: temperature
    !> κ/κ₀
    real(wp) :: f
    real(wp) :: slope

    f = 1
    if (.not. this%conducts) return
    call this%table_slopes(this%sensible(temperature), slope, f)
    f = f/slope
  end function conductivity_factor

  !> The sensible heat of a temperature: T(s) is monotone, and solved for s by Newton's method
  !> within the right interval of the table.
  elemental function sensible(this, temperature) result(s)
    class(heat_law_t), intent(in) :: this
    real(wp), intent(in) :: temperature
    real(wp) :: s
    real(wp) :: t, miss
    integer :: low, high, middle, k

    s = temperature
    if (.not. this%stores .or. .not. allocated(this%node)) return
    if (.not. ieee_is_finite(temperature)) return
    low = 1
    high = size(this%node, 2)
    if (temperature <= this%node(1, low)) then
      s = this%first + this%step*(temperature - this%node(1, low))/this%node(2, low)
    else if (temperature >= this%node(1, high)) then
      s = this%first + this%step*(high - 1 + (temperature - this%node(1, high))/this%node(2, high))
    else
      do while (high - low > 1)
        middle = (low + high)/2
        if (this%node(1, middle) <= temperature) then
          low = middle
        else
          high = middle
        end if
      end do
      associate (a => this%node(:, low), b => this%node(:, high))
        t = (temperature - a(1))/(b(1) - a(1))
        do k = 1, 6
          miss = cubic(t, a(1), a(2), b(1), b(2)) - temperature
          t = min(max(t - miss/cubic_slope(t, a(1), a(2), b(1), b(2)), 0.0_wp), 1.0_wp)
        end do
      end associate
      s = this%first + this%step*(low - 1 + t)
    end if
  end function sensible

  !> The heat content with as much sensible heat, and as much that is liquid, where latent heat is
  !> worth another rise
  elemental function rescaled(this, content, from, to)
    class(heat_law_t), intent(in) :: this
    !> A heat content, what latent heat over heat capacity is for it, and what for the result, K
    real(wp), intent(in) :: content, from, to
    real(wp) :: rescaled

    rescaled = content
    if (.not. this%melts .or. .not. ieee_is_finite(content)) return
    if (content <= this%begins) return
    if (content >= this%ends + from) then
      rescaled = content + (to - from)
    else
      rescaled = this%begins + this%rescaled_slope(content, from, to)*(content - this%begins)
    end if
  end function rescaled

  !> Its derivative
  elemental function rescaled_slope(this, content, from, to) result(slope)
    class(heat_law_t), intent(in) :: this
    real(wp), intent(in) :: content, from, to
    real(wp) :: slope

    slope = 1
    if (.not. this%melts .or. .not. ieee_is_finite(content)) return
    if (content <= this%begins .or. content >= this%ends + from) return
    slope = (this%ends + to - this%begins)/(this%ends + from - this%begins)
  end function rescaled_slope

  elemental function liquid_fraction(this, content) result(fraction)
    class(heat_law_t), intent(in) :: this
    !> Heat content, K
    real(wp), intent(in) :: content
    !> From 0, solid, to 1, liquid
    real(wp) :: fraction

    fraction = 0
    if (.not. this%melts .or. .not. ieee_is_finite(content)) return
    if (content <= this%begins) return
    fraction = 1
    if (content >= this%ends + this%rise) return
    fraction = (content - this%begins)/(this%ends + this%rise - this%begins)
  end function liquid_fraction

  pure subroutine largest_slopes(this, lowest, highest, temperature_slope, potential_slope)
    class(heat_law_t), intent(in) :: this
    !> Range of temperatures
    real(wp), intent(in) :: lowest, highest
    !> The largest dT/dv and dθ/dv
    real(wp), intent(out) :: temperature_slope, potential_slope
    integer :: from, to, last, n

    temperature_slope = 1
    potential_slope = 1
    if (.not. allocated(this%node)) return
    last = size(this%node, 2)
    from = 1
    to = last
    do n = 1, last
      if (this%node(1, n) <= lowest) from = n
      if (this%node(1, last + 1 - n) >= highest) to = last + 1 - n
    end do
    temperature_slope = maxval(this%node(2, from:to))/this%step
    potential_slope = temperature_slope
    if (this%conducts) potential_slope = maxval(this%node(4, from:to))/this%step
  end subroutine largest_slopes

end module calor_heat_law
