!> Heat conduction, ρc u_t = div(κ ∇u), with held temperatures on walls and whatever effects a scene
!> calls for.
!>
!> The state u is the temperature, unless capacity or conductivity depend on it or something melts:
!> then it is the heat content and C₀ u_t = div(κ₀ ∇θ(u)), θ being Kirchhoff's potential, see
!> calor_heat_law.
module calor_conduction
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_constants, only: worth_threads
  use calor_effect, only: effect_slot_t
  use calor_error, only: error_t, raise, status_bad_numbers
  use calor_evolution, only: evolution_t, combine_in_parts, recur_with_rate_in_parts, &
                             recur_with_jacobian_in_parts
  use calor_expression, only: expression_t
  use calor_heat_content, only: heat_content_t
  use calor_kinds, only: wp
  use calor_local_conductivity, only: local_conductivity_t, half_of_products
  use calor_medium, only: medium_t
  use calor_places, only: places_t
  use calor_potential_jumps, only: potential_jumps_t
  use calor_prescribed, only: prescribed_t
  use calor_saved_state, only: saved_state_t
  use calor_sparse_operator, only: sparse_operator_t
  use calor_streamed_rows, only: streamed_rows_t
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
    !> ∇² at the particles that are not held; in a body that is not one constant isotropic material
    !> div(κ ∇)/(ρc)
    type(sparse_operator_t) :: laplacian
    !> κ/(ρc), m²/s; 1 where that is in the rows
    real(wp) :: diffusivity = 1.0_wp
    !> The held particles
    type(prescribed_t), allocatable :: prescribed(:)
    !> The user's number of each particle, for messages
    integer, allocatable :: user_index(:)
    !> The particles, what they consist of and where they touch the world
    type(medium_t) :: medium
    !> ∇², or div(κ ∇), without the parts of normal derivatives at held particles, which the heat
    !> budget needs
    type(sparse_operator_t) :: held_rows
    !> The effects in force beside conduction; not allocated where there are none
    type(effect_slot_t), allocatable :: effects(:)
    !> The power of all effects at each particle, W/m³; allocated where there are effects
    real(wp), allocatable :: power(:)
    !> The derivative of their power with respect to the temperature over ρc, 1/s, at the last
    !> `linearise`, or the largest; allocated where the power of any depends on the temperature
    real(wp), allocatable :: slope(:)
    !> What the heat content is; not allocated: the state is the temperature
    type(heat_content_t), allocatable :: content
    !> What rows lack at interfaces where potentials jump, and the same for `held_rows`; not
    !> allocated where there are none
    type(potential_jumps_t), allocatable :: jumps, held_jumps
    !> Conductivities that are no products; not allocated where there are none
    type(local_conductivity_t), allocatable :: local
    !> Temperatures and potentials of the last state; allocated where that is a heat content
    real(wp), allocatable :: temperature(:), potential(:)
    !> Derivatives of temperature and potential with respect to the state at the last `linearise`,
    !> or their largest; allocated where the state is a heat content
    real(wp), allocatable :: temperature_slope(:), potential_slope(:)
    !> Lowest and highest of all temperatures given so far
    real(wp) :: lowest = huge(1.0_wp), highest = -huge(1.0_wp)
    !> What to blame should the numbers go wrong, in a sentence; not allocated: the scheme
    character(len=:), allocatable :: suspicion
    !> Whether the rows laid out for speed have weights in single precision
    logical :: single_weights = .false.
    !> The Laplacian's rows, laid out for speed
    type(streamed_rows_t), private :: stream
    !> Whether that is all that is left of them
    logical, private :: only_streamed = .false.
    !> How far the last state left the range, and for how many steps that has grown
    real(wp) :: excursion = 0.0_wp
    integer :: growing_steps = 0
  contains
    procedure :: unknowns
    procedure :: rate
    procedure :: jacobian_product
    procedure :: combine_with_rate
    procedure :: recur_with_rate
    procedure :: recur_with_jacobian
    procedure :: impose
    procedure :: clear_prescribed
    procedure :: inspect
    procedure :: jacobian_rows
    procedure :: is_linear
    !> What the rate takes beside the product, in operators of expressions
    procedure :: operations
    procedure :: depends_on_time
    !> The largest -a_ii of the Jacobian where none of its weights is negative, 1/s; else 0
    procedure :: fastest_decay
    !> An upper bound of the spectral radius, 1/s
    procedure :: spectral_bound
    !> Widen the range of given temperatures
    procedure :: note_range
    procedure :: look_ahead
    !> Take up that the state is a heat content
    procedure :: use_content
    !> Put effects in force
    procedure :: put_in_force
    !> Take the derivatives at a state for those of the Jacobian
    procedure :: linearise
    !> Take the largest ones that may occur for them
    procedure :: assume_stiffest
    !> The measure of temperatures: the range of those given, or what effects may bring about, K
    procedure :: temperature_scale
    !> Take the paths of particles that move, and what new rows have at walls
    procedure :: follow
    !> Put the rates of held states into a rate
    procedure :: add_held_rates
    !> The temperatures of a state, the state of temperatures, and how much is liquid
    procedure :: find_temperature
    procedure :: find_state
    procedure :: find_liquid_fraction
    !> Lay out the Laplacian's rows for speed: to be called when they are complete, and again after
    !> any change
    procedure :: stream_rows
    !> Free the rows as they were assembled, where those laid out for speed do for all steps to come
    procedure :: keep_streamed_rows
    !> Whether the rows laid out for speed are those of the Laplacian
    procedure, private :: is_streamed
    !> Lay aside what the states so far have left, and take it up again
    procedure :: save => save_conduction
    procedure :: restore => restore_conduction
    !> What rows at held particles make of a state
    procedure :: apply_held_rows
    !> What conduction makes of temperatures
    procedure :: apply_rows
    procedure, private :: conduct
    procedure, private :: conduct_change
    procedure, private :: linearise_conduction
    procedure, private :: add_effects
    procedure, private :: find_slope
    !> Where several processes share the particles: the first and last of this one's own, and sums
    !> over all of them
    procedure :: own_particles
    !> The largest of the values of all processes
    procedure :: largest
    procedure :: add_up
    !> The range of temperatures given or kept, and the one that a state may leave by little only
    procedure :: find_scales
    procedure :: allowed_range
    !> The range where temperatures may come
    procedure :: expected_range
    !> Where several processes share the particles: widen a range to that of all of them, and let
    !> an error of one be an error of all
    procedure :: span
    procedure :: agree
    !> The same for lists, one process's after another's; and the numbers of particles in the whole
    !> Put true values in place of those of other processes' particles
    procedure :: complete
    procedure :: join_counts
    procedure :: join_reals
    procedure :: whole_number
  end type conduction_t

contains

  pure function unknowns(this) result(number)
    class(conduction_t), intent(in) :: this
    integer :: number

    number = this%medium%particles()
  end function unknowns

  subroutine rate(this, time, u, du)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(out), contiguous :: du(:)

    if (allocated(this%content)) then
      call this%content%evaluate(u, this%temperature, this%potential)
      call this%conduct(du)
      if (allocated(this%effects)) call this%add_effects(time, this%temperature, du)
    else
      call this%apply_rows(u, du)
      if (allocated(this%effects)) call this%add_effects(time, u, du)
    end if
    call this%clear_prescribed(du)
  end subroutine rate

  !> The derivatives are those of the last `linearise`, or the largest that may occur: it is by
  !> these that steps have to be chosen, not by the spectrum at one state.
  subroutine jacobian_product(this, v, product)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in), contiguous :: v(:)
    real(wp), intent(out), contiguous :: product(:)

    if (allocated(this%content)) then
      call this%conduct_change(v, product)
      if (allocated(this%slope)) product = product + this%slope*this%temperature_slope*v
    else
      call this%apply_rows(v, product)
      if (allocated(this%slope)) product = product + this%slope*v
    end if
    call this%clear_prescribed(product)
  end subroutine jacobian_product

  subroutine stream_rows(this)
    class(conduction_t), intent(inout) :: this

    call this%stream%lay_out(this%laplacian, this%unknowns(), this%single_weights)
    this%only_streamed = .false.
  end subroutine stream_rows

  !> Afterwards `laplacian` is empty: there is no Jacobian to hand out, nor a bound of the spectrum,
  !> until rows are assembled anew. Nothing happens where rows could not be laid out.
  subroutine keep_streamed_rows(this)
    class(conduction_t), intent(inout) :: this

    if (this%only_streamed .or. .not. this%is_streamed()) return
    this%laplacian = sparse_operator_t()
    this%only_streamed = .true.
  end subroutine keep_streamed_rows

  pure function is_streamed(this) result(answer)
    class(conduction_t), intent(in) :: this
    logical :: answer

    answer = this%only_streamed
    if (.not. answer) answer = this%stream%stands_for(this%laplacian)
  end function is_streamed

  subroutine apply_rows(this, temperature, rate)
    class(conduction_t), intent(inout) :: this
    !> Temperatures, or potentials, of all particles
    real(wp), intent(in), contiguous :: temperature(:)
    !> Set at all particles that have a row
    real(wp), intent(inout), contiguous :: rate(:)

    if (this%is_streamed()) then
      call this%stream%apply(this%diffusivity, temperature, rate)
    else
      call this%laplacian%apply_at_targets(this%diffusivity, temperature, rate)
    end if
  end subroutine apply_rows

  !> What conduction makes of the present temperatures and potentials
  subroutine conduct(this, rate)
    class(conduction_t), intent(inout) :: this
    !> Set at all particles that have a row
    real(wp), intent(inout), contiguous :: rate(:)
    real(wp), allocatable :: factor(:), of_level(:), of_factor(:)

    if (allocated(this%local)) then
      allocate (factor(size(rate)))
      allocate (of_level(size(rate)), of_factor(size(rate)), source=0.0_wp)
      call this%local%find_factor(this%temperature, factor)
      associate (level => this%potential - this%local%reference)
        call this%apply_rows(level, of_level)
        call this%apply_rows(factor, of_factor)
        call this%apply_rows(factor*level, rate)
        rate = half_of_products(factor, level, rate, of_level, of_factor)
      end associate
    else
      call this%apply_rows(this%potential, rate)
    end if
    if (.not. allocated(this%jumps)) return
    call this%complete(this%temperature)
    call this%complete(this%potential)
    call this%jumps%correct(this%temperature, this%potential, rate)
  end subroutine conduct

  !> How what conduction makes of a state changes with it, by the last `linearise`
  subroutine conduct_change(this, change, product)
    class(conduction_t), intent(inout) :: this
    !> Of the states
    real(wp), intent(in), contiguous :: change(:)
    !> Set at all particles that have a row
    real(wp), intent(inout), contiguous :: product(:)
    real(wp), allocatable :: of_level(:), of_factor(:)

    ! No state is at work: its arrays serve.
    this%potential = this%potential_slope*change
    if (allocated(this%local)) then
      allocate (of_level(size(product)), of_factor(size(product)), source=0.0_wp)
      associate (local => this%local, level => this%potential, &
                 factor => this%local%factor_slope*this%temperature_slope*change)
        call this%apply_rows(level, of_level)
        call this%apply_rows(factor, of_factor)
        call this%apply_rows(local%factor*level + local%level*factor, product)
        product = half_of_products(local%factor, local%level, product, of_level, of_factor) + &
                  0.5_wp*(factor*local%flow - level*local%factor_flow)
      end associate
    else
      call this%apply_rows(this%potential, product)
    end if
    if (.not. allocated(this%jumps)) return
    call this%complete(this%potential)
    call this%jumps%correct_product(this%potential, product)
  end subroutine conduct_change

  subroutine linearise_conduction(this, u)
    class(conduction_t), intent(inout) :: this
    !> The state
    real(wp), intent(in), contiguous :: u(:)

    call this%content%slopes(u, this%temperature_slope, this%potential_slope)
    if (.not. (allocated(this%jumps) .or. allocated(this%local))) return
    call this%content%evaluate(u, this%temperature, this%potential)
    if (allocated(this%jumps)) then
      call this%complete(this%temperature)
      call this%complete(this%potential)
      call this%jumps%linearise(this%temperature, this%potential)
    end if
    if (.not. allocated(this%local)) return
    associate (local => this%local)
      call local%mark(this%temperature)
      local%level = this%potential - local%reference
      call this%apply_rows(local%level, local%flow)
      call this%apply_rows(local%factor, local%factor_flow)
    end associate
  end subroutine linearise_conduction

  subroutine apply_held_rows(this, state, result)
    class(conduction_t), intent(inout) :: this
    !> State of each particle
    real(wp), intent(in) :: state(:)
    !> What each of the rows makes of it
    real(wp), intent(out) :: result(:)
    real(wp), allocatable :: temperature(:), potential(:), factor(:), of_level(:), of_factor(:)

    allocate (temperature(size(state)), potential(size(state)))
    temperature = state
    potential = state
    if (allocated(this%content)) call this%content%evaluate(state, temperature, potential)
    call this%held_rows%apply(potential, result)
    if (allocated(this%local)) then
      allocate (factor(size(state)), of_level(size(result)), of_factor(size(result)))
      call this%local%find_factor(temperature, factor)
      associate (held => this%held_rows%target, level => potential - this%local%reference)
        call this%held_rows%apply(level, of_level)
        call this%held_rows%apply(factor, of_factor)
        call this%held_rows%apply(factor*level, result)
        result = half_of_products(factor(held), level(held), result, of_level, of_factor)
      end associate
    end if
    if (allocated(this%held_jumps)) call this%held_jumps%correct(temperature, potential, result)
  end subroutine apply_held_rows

  pure subroutine own_particles(this, first, last)
    class(conduction_t), intent(in) :: this
    integer, intent(out) :: first, last

    first = 1
    last = this%unknowns()
  end subroutine own_particles

  function largest(this, value) result(of_all)
    class(conduction_t), intent(in) :: this
    !> Of this process
    real(wp), intent(in) :: value
    real(wp) :: of_all

    associate (unused => this)
    end associate
    of_all = value
  end function largest

  !> One process has all.
  subroutine add_up(this, sums)
    class(conduction_t), intent(in) :: this
    real(wp), intent(inout), contiguous :: sums(:)

    associate (unused => this, also => sums)
    end associate
  end subroutine add_up

  !> In one sweep where there is nothing but conduction, as what follows. Prescribed entries have
  !> empty rows.
  subroutine combine_with_rate(this, time, c, newer, start, rate_start, older, work)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in) :: c(5)
    real(wp), intent(in), contiguous :: newer(:), start(:), rate_start(:)
    real(wp), intent(inout), contiguous :: older(:)
    real(wp), allocatable, intent(inout) :: work(:)

    if (allocated(this%effects) .or. allocated(this%content) .or. &
        .not. this%is_streamed()) then
      call combine_in_parts(this, time, c, newer, start, rate_start, older, work)
    else
      call this%stream%combine([c(1:4), c(5)*this%diffusivity], newer, older, start, rate_start)
    end if
  end subroutine combine_with_rate

  subroutine recur_with_rate(this, time, c, newer, older, work)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in) :: c(3)
    real(wp), intent(in), contiguous :: newer(:)
    real(wp), intent(inout), contiguous :: older(:)
    real(wp), allocatable, intent(inout) :: work(:)

    if (allocated(this%effects) .or. allocated(this%content) .or. &
        .not. this%is_streamed()) then
      call recur_with_rate_in_parts(this, time, c, newer, older, work)
    else
      call this%stream%recur([c(1:2), c(3)*this%diffusivity], newer, older)
    end if
  end subroutine recur_with_rate

  subroutine recur_with_jacobian(this, c, newer, older, work)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in) :: c(3)
    real(wp), intent(in), contiguous :: newer(:)
    real(wp), intent(inout), contiguous :: older(:)
    real(wp), allocatable, intent(inout) :: work(:)

    if (allocated(this%slope) .or. allocated(this%content) .or. &
        .not. this%is_streamed()) then
      call recur_with_jacobian_in_parts(this, c, newer, older, work)
    else
      call this%stream%recur([c(1:2), c(3)*this%diffusivity], newer, older)
    end if
  end subroutine recur_with_jacobian

  subroutine follow(this, x, y, places)
    class(conduction_t), intent(inout) :: this
    !> Where particles are, m
    real(wp), intent(in), contiguous :: x(:), y(:)
    !> Where they will be in the steps to come
    type(places_t), intent(in) :: places
    integer :: k

    this%medium%x = x
    this%medium%y = y
    do k = 1, size(this%prescribed)
      associate (held => this%prescribed(k))
        if (allocated(held%expression)) held%places = places%some(held%particle)
      end associate
    end do
    if (.not. allocated(this%effects)) return
    do k = 1, size(this%effects)
      call this%effects(k)%effect%follow(this%medium, places)
    end do
  end subroutine follow

  !> By a difference: expressions have no other derivative.
  subroutine add_held_rates(this, time, rate)
    class(conduction_t), intent(in) :: this
    !> Time, s
    real(wp), intent(in) :: time
    !> Rates of all particles, K/s; those of held ones are set
    real(wp), intent(inout), contiguous :: rate(:)
    type(expression_t) :: expression
    real(wp), allocatable :: before(:), after(:)
    real(wp) :: step
    integer :: k

    do k = 1, size(this%prescribed)
      associate (held => this%prescribed(k))
        rate(held%particle) = 0
        if (.not. allocated(held%expression)) cycle
        step = 1.0e-5_wp*this%medium%duration
        if (.not. step > 0) step = 1.0e-5_wp
        expression = held%expression
        allocate (before(size(held%particle)), after(size(held%particle)))
        call held%places%evaluate(expression, max(0.0_wp, time - step), before)
        call held%places%evaluate(expression, time + step, after)
        if (allocated(this%content)) then
          call this%content%find_state(held%particle, (before), before)
          call this%content%find_state(held%particle, (after), after)
        end if
        rate(held%particle) = (after - before)/(time + step - max(0.0_wp, time - step))
        deallocate (before, after)
      end associate
    end do
  end subroutine add_held_rates

  subroutine find_temperature(this, state, temperature)
    class(conduction_t), intent(inout) :: this
    !> State of each particle
    real(wp), intent(in), contiguous :: state(:)
    !> Its temperature
    real(wp), intent(out), contiguous :: temperature(:)

    real(wp), allocatable :: potential(:)

    if (allocated(this%content)) then
      allocate (potential(size(state)))
      call this%content%evaluate(state, temperature, potential)
    else
      temperature = state
    end if
  end subroutine find_temperature

  pure subroutine find_state(this, temperature, state)
    class(conduction_t), intent(in) :: this
    !> Temperature of each particle
    real(wp), intent(in), contiguous :: temperature(:)
    !> Its state
    real(wp), intent(out), contiguous :: state(:)
    integer :: k

    if (allocated(this%content)) then
      call this%content%find_state([(k, k=1, size(state))], temperature, state)
    else
      state = temperature
    end if
  end subroutine find_state

  pure subroutine find_liquid_fraction(this, state, fraction)
    class(conduction_t), intent(in) :: this
    !> State of each particle
    real(wp), intent(in), contiguous :: state(:)
    !> From 0, solid, to 1, liquid; 0 where nothing melts
    real(wp), intent(out), contiguous :: fraction(:)

    fraction = 0
    if (allocated(this%content)) call this%content%find_liquid_fraction(state, fraction)
  end subroutine find_liquid_fraction

  !> Add to rates what the effects bring.
  subroutine add_effects(this, time, u, du)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(inout), contiguous :: du(:)
    integer :: k

    !$omp parallel do if (size(du) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(du)
      this%power(k) = 0
    end do
    !$omp end parallel do
    do k = 1, size(this%effects)
      call this%effects(k)%effect%add_power(this%medium, time, u, this%power)
    end do
    if (allocated(this%medium%local_capacity)) then
      du = du + this%power/this%medium%local_capacity
      return
    end if
    !$omp parallel do if (size(du) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(du)
      du(k) = du(k) + this%power(k)/this%medium%capacity
    end do
    !$omp end parallel do
  end subroutine add_effects

  subroutine put_in_force(this, effects, temperature, error)
    class(conduction_t), intent(inout) :: this
    !> What the scene calls for; moved. Not allocated: nothing
    type(effect_slot_t), allocatable, intent(inout) :: effects(:)
    !> Their temperatures at the start
    real(wp), intent(in), contiguous :: temperature(:)
    !> What the scene asks for cannot be had
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    if (.not. allocated(effects)) return
    call move_alloc(effects, this%effects)
    allocate (this%power(size(temperature)), source=0.0_wp)
    do k = 1, size(this%effects)
      call this%effects(k)%effect%prepare(this%medium, temperature, error)
      if (allocated(error)) return
      if (this%effects(k)%effect%has_slope() .and. .not. allocated(this%slope)) then
        allocate (this%slope(size(temperature)))
      end if
    end do
  end subroutine put_in_force

  !> Take up that the state is a heat content.
  subroutine use_content(this, content, temperature)
    class(conduction_t), intent(inout) :: this
    !> The laws, tabulated
    type(heat_content_t), intent(in) :: content
    !> The temperatures at the start
    real(wp), intent(in), contiguous :: temperature(:)

    this%content = content
    allocate (this%temperature(size(temperature)), source=temperature)
    allocate (this%potential(size(temperature)), source=temperature)
    allocate (this%temperature_slope(size(temperature)), source=1.0_wp)
    allocate (this%potential_slope(size(temperature)), source=1.0_wp)
  end subroutine use_content

  subroutine linearise(this, time, u)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    real(wp), allocatable :: temperature(:)

    if (allocated(this%content)) call this%linearise_conduction(u)
    if (.not. allocated(this%slope)) return
    allocate (temperature(size(u)))
    call this%find_temperature(u, temperature)
    call this%find_slope(time, temperature, this%slope)
  end subroutine linearise

  !> The derivative of the effects' power with respect to the temperature over ρc
  subroutine find_slope(this, time, temperature, slope)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: temperature(:)
    real(wp), intent(out), contiguous :: slope(:)
    integer :: k

    slope = 0
    do k = 1, size(this%effects)
      if (.not. this%effects(k)%effect%has_slope()) cycle
      call this%effects(k)%effect%add_slope(this%medium, time, temperature, slope)
    end do
    if (allocated(this%medium%local_capacity)) then
      slope = slope/this%medium%local_capacity
    else
      slope = slope/this%medium%capacity
    end if
    call this%clear_prescribed(slope)
  end subroutine find_slope

  !> Derivatives with respect to the temperature are looked at throughout the range where that may
  !> come, and throughout the time: of some places in both, the largest counts.
  subroutine assume_stiffest(this)
    class(conduction_t), intent(inout) :: this
    integer, parameter :: temperatures = 5, times = 3
    real(wp), allocatable :: uniform(:), found(:)
    real(wp) :: low, high
    integer :: k, j

    if (.not. (allocated(this%content) .or. allocated(this%slope))) return
    call this%expected_range(low, high)
    if (allocated(this%content)) then
      call this%content%largest_slopes(low, high, this%temperature_slope, this%potential_slope)
      if (allocated(this%jumps)) call this%jumps%assume_largest(low, high)
      if (allocated(this%local)) call this%local%assume_largest(low, high)
    end if
    if (.not. allocated(this%slope)) return
    allocate (found(size(this%slope)))
    this%slope = 0
    do j = 0, times - 1
      do k = 0, temperatures - 1
        uniform = spread(low + (high - low)*k/(temperatures - 1), 1, size(found))
        call this%find_slope(this%medium%duration*j/(times - 1), uniform, found)
        where (.not. ieee_is_finite(found)) found = 0
        where (abs(found) > abs(this%slope)) this%slope = found
      end do
    end do
  end subroutine assume_stiffest

  !> The derivatives are those of the last `linearise`.
  subroutine jacobian_rows(this, first, index, value, known)
    class(conduction_t), intent(in) :: this
    integer, allocatable, intent(out) :: first(:)
    integer, allocatable, intent(out) :: index(:)
    real(wp), allocatable, intent(out) :: value(:)
    logical, intent(out) :: known
    integer, allocatable :: owner(:)
    !> dθ/du, dT/du
    real(wp), allocatable :: free(:), growth(:), bend(:)
    integer :: n, k, row, used, from, to, own

    known = .true.
    n = this%unknowns()
    allocate (growth(n), bend(n), source=1.0_wp)
    if (allocated(this%content)) then
      growth = this%potential_slope
      bend = this%temperature_slope
    end if
    associate (laplacian => this%laplacian)
      allocate (owner(n), source=0)
      allocate (free(n), source=1.0_wp)
      call this%clear_prescribed(free)
      owner(laplacian%target) = [(k, k=1, laplacian%rows())]
      allocate (first(n + 1), index(size(laplacian%index) + n), value(size(laplacian%index) + n))
      used = 0
      do row = 1, n
        first(row) = used + 1
        if (owner(row) == 0 .or. free(row) < 0.5_wp) cycle
        used = used + 1
        own = used
        index(used) = row
        value(used) = this%diffusivity*laplacian%diagonal(owner(row))*growth(row)
        from = int(laplacian%first(owner(row)))
        to = int(laplacian%first(owner(row) + 1)) - 1
        do k = from, to
          used = used + 1
          index(used) = laplacian%index(k)
          value(used) = this%diffusivity*laplacian%weight(k)*growth(laplacian%index(k))
        end do
        if (allocated(this%local)) then
          call weigh_products(row, laplacian%weight(from:to), index(own:used), value(own:used))
        end if
        if (allocated(this%slope)) value(own) = value(own) + this%slope(row)*bend(row)
      end do
      first(n + 1) = used + 1
    end associate
    if (allocated(this%jumps)) call this%jumps%correct_weights(growth, first, index, value)
    index = index(:used)
    value = value(:used)

  contains

    !> The row of a particle where conductivities are no products: of Σ a_ij (c_i + c_j)/2 (u_j -
    !> u_i)
    subroutine weigh_products(particle, weight, row_index, row_value)
      integer, intent(in) :: particle
      real(wp), intent(in) :: weight(:)
      !> The particle, then its neighbours
      integer, intent(in) :: row_index(:)
      real(wp), intent(out) :: row_value(:)

      associate (c => this%local%factor, u => this%local%level, i => particle, j => row_index(2:), &
                 warming => this%local%factor_slope*bend)
        row_value(2:) = this%diffusivity*weight*0.5_wp* &
                        ((c(i) + c(j))*growth(j) + warming(j)*(u(j) - u(i)))
        row_value(1) = this%diffusivity*0.5_wp* &
                       sum(weight*(warming(i)*(u(j) - u(i)) - (c(i) + c(j))*growth(i)))
      end associate
    end subroutine weigh_products

  end subroutine jacobian_rows

  pure function is_linear(this) result(answer)
    class(conduction_t), intent(in) :: this
    logical :: answer
    integer :: k

    answer = .not. allocated(this%content)
    if (.not. allocated(this%effects)) return
    do k = 1, size(this%effects)
      answer = answer .and. this%effects(k)%effect%is_linear()
    end do
  end function is_linear

  pure function operations(this) result(number)
    class(conduction_t), intent(in) :: this
    real(wp) :: number
    integer :: k

    number = 0
    if (.not. allocated(this%effects)) return
    do k = 1, size(this%effects)
      number = number + this%effects(k)%effect%operations()
    end do
  end function operations

  pure function depends_on_time(this) result(answer)
    class(conduction_t), intent(in) :: this
    logical :: answer
    integer :: k

    answer = .false.
    do k = 1, size(this%prescribed)
      answer = answer .or. allocated(this%prescribed(k)%expression)
    end do
    if (.not. allocated(this%effects)) return
    do k = 1, size(this%effects)
      answer = answer .or. this%effects(k)%effect%depends_on_time()
    end do
  end function depends_on_time

  subroutine impose(this, time, u)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(inout), contiguous :: u(:)
    integer :: k

    do k = 1, size(this%prescribed)
      associate (held => this%prescribed(k))
        call held%impose(time, u)
        if (allocated(this%content)) u(held%particle) = states_of(held%particle, held%temperature)
        call this%note_range(held%temperature)
      end associate
    end do

  contains

    pure function states_of(particle, temperature) result(state)
      integer, intent(in) :: particle(:)
      real(wp), intent(in), contiguous :: temperature(:)
      real(wp) :: state(size(temperature))

      call this%content%find_state(particle, temperature, state)
    end function states_of

  end subroutine impose

  subroutine clear_prescribed(this, v)
    class(conduction_t), intent(in) :: this
    real(wp), intent(inout), contiguous :: v(:)
    integer :: k

    do k = 1, size(this%prescribed)
      v(this%prescribed(k)%particle) = 0
    end do
  end subroutine clear_prescribed

  subroutine inspect(this, time, u, error)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: temperature(:)

    if (allocated(this%content)) then
      allocate (temperature(size(u)))
      call this%find_temperature(u, temperature)
      call inspect_temperature(this, time, temperature, error)
    else
      call inspect_temperature(this, time, u, error)
    end if
  end subroutine inspect

  !> Whether temperatures are numbers, and in the range where they belong.
  subroutine inspect_temperature(this, time, u, error)
    class(conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: low, high, range, rounding, worst, outside
    integer :: k, particle
    logical :: finite

    call this%allowed_range(low, high)
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
  end subroutine inspect_temperature

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
               to_text(this%medium%x(particle), digits=6)//', '// &
               to_text(this%medium%y(particle), digits=6)//') '//what//' the range of the '// &
               'given temperatures, '//to_text(this%lowest, digits=4)//' to '// &
               to_text(this%highest, digits=4)//'.'// &
               new_line('a')//suspicion)
  end subroutine report_excursion

  function spectral_bound(this) result(bound)
    class(conduction_t), intent(in) :: this
    real(wp) :: bound

    bound = this%diffusivity*this%largest(this%laplacian%gershgorin_bound())
    if (allocated(this%content)) then
      if (allocated(this%local)) bound = bound*this%largest(maxval(this%local%factor))
      if (allocated(this%jumps)) bound = bound + this%largest(this%jumps%largest_sum())
      bound = bound*this%largest(maxval(this%potential_slope))
      if (allocated(this%slope)) then
        bound = bound + this%largest(maxval(abs(this%slope*this%temperature_slope)))
      end if
    else
      if (allocated(this%slope)) bound = bound + this%largest(maxval(abs(this%slope)))
    end if
  end function spectral_bound

  function fastest_decay(this) result(rate)
    class(conduction_t), intent(in) :: this
    real(wp) :: rate
    integer :: k

    rate = 0
    ! What jumps add to weights may have any sign.
    if (allocated(this%jumps)) return
    if (this%largest(merge(1.0_wp, 0.0_wp, any(this%laplacian%weight < 0))) > 0) return
    if (allocated(this%effects)) then
      do k = 1, size(this%effects)
        if (.not. this%effects(k)%effect%brings_nothing()) return
      end do
    end if
    ! The potential grows with the state, so that a mean of potentials keeps the order of states.
    rate = this%diffusivity*this%largest(maxval(-this%laplacian%diagonal))
    if (allocated(this%content)) rate = rate*this%largest(maxval(this%potential_slope))
    if (allocated(this%local)) rate = rate*this%largest(maxval(this%local%factor))
  end function fastest_decay

  !> The range that a state may leave by a little only. Effects that heat or cool without end leave
  !> none: what is finite passes.
  subroutine allowed_range(this, low, high)
    class(conduction_t), intent(in) :: this
    !> The range
    real(wp), intent(out) :: low, high
    real(wp) :: lowest, highest
    logical :: kept
    integer :: k

    low = this%lowest
    high = this%highest
    if (.not. allocated(this%effects)) return
    do k = 1, size(this%effects)
      call this%effects(k)%effect%kept_range(kept, lowest, highest)
      if (.not. kept) then
        low = -0.01_wp*huge(1.0_wp)
        high = 0.01_wp*huge(1.0_wp)
        return
      end if
      low = min(low, lowest)
      high = max(high, highest)
    end do
  end subroutine allowed_range

  function temperature_scale(this) result(scale)
    class(conduction_t), intent(in) :: this
    real(wp) :: scale
    real(wp) :: low, high, rise

    call this%find_scales(low, high, rise)
    scale = max(high - low, rise)
    if (.not. scale > 0) scale = max(abs(high), 1.0_wp)
  end function temperature_scale

  !> The range of temperatures given or kept, and by how much effects may raise them
  subroutine find_scales(this, low, high, rise)
    class(conduction_t), intent(in) :: this
    !> The range, and by how much effects may take temperatures beyond it, K
    real(wp), intent(out) :: low, high, rise
    real(wp) :: kept_low, kept_high
    logical :: kept
    integer :: k

    low = this%lowest
    high = this%highest
    rise = 0
    if (.not. allocated(this%effects)) return
    do k = 1, size(this%effects)
      call this%effects(k)%effect%kept_range(kept, kept_low, kept_high)
      if (kept) then
        low = min(low, kept_low)
        high = max(high, kept_high)
      end if
      rise = max(rise, this%effects(k)%effect%expected_rise(this%medium))
    end do
  end subroutine find_scales

  !> The range where temperatures may come, as far as that is known before: where effects may raise
  !> or lower them without end, about as far as they will
  subroutine expected_range(this, low, high)
    class(conduction_t), intent(in) :: this
    real(wp), intent(out) :: low, high
    real(wp) :: rise, any_low, any_high

    call this%find_scales(low, high, rise)
    call this%span(low, high)
    call this%allowed_range(any_low, any_high)
    if (any_low >= low .and. any_high <= high) return
    low = low - rise
    high = high + rise
  end subroutine expected_range

  subroutine span(this, low, high)
    class(conduction_t), intent(in) :: this
    !> A range
    real(wp), intent(inout) :: low, high

    ! One process has all particles.
    associate (unused => this, also => low, and => high)
    end associate
  end subroutine span

  subroutine agree(this, error)
    class(conduction_t), intent(in) :: this
    !> An error or none
    type(error_t), allocatable, intent(inout) :: error

    associate (unused => this)
      if (allocated(error)) return
    end associate
  end subroutine agree

  subroutine join_counts(this, list)
    class(conduction_t), intent(in) :: this
    !> Numbers
    integer, allocatable, intent(inout) :: list(:)

    associate (unused => this, also => list)
    end associate
  end subroutine join_counts

  subroutine join_reals(this, list)
    class(conduction_t), intent(in) :: this
    !> Numbers
    real(wp), allocatable, intent(inout) :: list(:)

    associate (unused => this, also => list)
    end associate
  end subroutine join_reals

  !> One process knows them all.
  subroutine complete(this, values)
    class(conduction_t), intent(inout) :: this
    !> One for each particle here
    real(wp), intent(inout), contiguous :: values(:)

    associate (unused => this, also => values)
    end associate
  end subroutine complete

  elemental function whole_number(this, particle) result(number)
    class(conduction_t), intent(in) :: this
    !> A particle here
    integer, intent(in) :: particle
    integer :: number

    associate (unused => this)
    end associate
    number = particle
  end function whole_number

  !> Note the temperatures that walls are going to be held at.
  subroutine look_ahead(this)
    class(conduction_t), intent(inout) :: this
    integer, parameter :: times = 32
    real(wp), allocatable :: given(:)
    integer :: k, j

    do k = 1, size(this%prescribed)
      associate (held => this%prescribed(k))
        if (.not. allocated(held%expression)) cycle
        given = held%temperature
        do j = 0, times
          call held%places%evaluate(held%expression, this%medium%duration*j/times, given)
          call this%note_range(given)
        end do
      end associate
    end do
  end subroutine look_ahead

  subroutine note_range(this, temperature)
    class(conduction_t), intent(inout) :: this
    !> Temperatures that are given, not computed
    real(wp), intent(in), contiguous :: temperature(:)

    if (size(temperature) == 0) return
    ! An expression without a value: the stepper notices what comes of it
    if (.not. all(ieee_is_finite(temperature))) return
    this%lowest = min(this%lowest, minval(temperature))
    this%highest = max(this%highest, maxval(temperature))
  end subroutine note_range

  subroutine save_conduction(this, state)
    class(conduction_t), intent(in) :: this
    type(saved_state_t), intent(inout) :: state

    call state%enter('conduction')
    call state%put('range', [this%lowest, this%highest])
    call state%put('excursion', this%excursion)
    call state%put('growing_steps', this%growing_steps)
    if (allocated(this%slope)) call state%put('slope', this%slope)
    if (allocated(this%content)) then
      call state%put('temperature_slope', this%temperature_slope)
      call state%put('potential_slope', this%potential_slope)
    end if
    call state%leave()
  end subroutine save_conduction

  subroutine restore_conduction(this, state)
    class(conduction_t), intent(inout) :: this
    type(saved_state_t), intent(inout) :: state
    real(wp), allocatable :: range(:)

    call state%enter('conduction')
    call state%get('range', range)
    if (allocated(range)) then
      this%lowest = range(1)
      this%highest = range(2)
    end if
    call state%get('excursion', this%excursion)
    call state%get('growing_steps', this%growing_steps)
    if (allocated(this%slope)) call state%get('slope', this%slope)
    if (allocated(this%content)) then
      call state%get('temperature_slope', this%temperature_slope)
      call state%get('potential_slope', this%potential_slope)
    end if
    call state%leave()
  end subroutine restore_conduction

end module calor_conduction
