!> The time integrator that should cost least, and what each should cost.
!>
!> Costs are foreseen from work that is counted, products with the Laplacian and factors of its
!> matrix, and from what a unit of work takes on a core of today, measured once and written down
!> below. No clock decides: the same scene is integrated by the same method whenever and wherever it
!> runs, on any number of threads.
!>
!> How many products the exponential propagator takes follows from the spectral radius, the
!> tolerance and a short trial (see calor_exponential). How many steps methods of second order take
!> is known from the first ones of a run with RKL2: their length grows with a power of the age of
!> what spreads, or in the end as the cube root of the slowest decay. That trial is left out where
!> the exponential propagator is cheaper than any such run.
module calor_method_choice
  use calor_error, only: error_t
  use calor_evolution, only: evolution_t
  use calor_exponential, only: exponential_terms, find_roundness, left_of_rate, longest_series, &
                               part_left, part_off_axis, trial_terms, useful_roundness, widening
  use calor_integrators, only: make_integrator
  use calor_kinds, only: wp
  use calor_stepper, only: stepper_t
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: method_choice_t, method_cost_t, problem_t, foresee_costs, seconds_text
  public :: rkl2_cost, tr_bdf2_cost, exponential_cost, pilot_t, run_pilot, steps_ahead

  !> Seconds of one core for: a row and an entry of a product, and what it takes anyway; a row in
  !> the vector updates of a stage; an entry of the factors in a solution; a floating-point
  !> operation of the factorisation, and an entry of the factors and of the matrix in it
  real(wp), parameter :: row_seconds = 2.0e-10_wp, entry_seconds = 3.5e-10_wp
  real(wp), parameter :: call_seconds = 1.0e-6_wp
  !> More entries than that do not fit into a core's own cache, or into the one that cores share,
  !> and all takes longer by that factor
  real(wp), parameter :: cached_entries(2) = [2.0e5_wp, 5.0e6_wp], slower(2) = [1.3_wp, 1.7_wp]
  real(wp), parameter :: stage_seconds = 4.0e-10_wp, solution_seconds = 8.0e-10_wp
  !> The same for solutions, by the entries of either factor
  real(wp), parameter :: slower_solution(2) = [2.6_wp, 3.4_wp]
  !> An operator of an expression at a particle
  real(wp), parameter :: operator_seconds = 2.5e-9_wp
  real(wp), parameter :: operation_seconds = 4.0e-10_wp, factor_seconds = 8.0e-9_wp, &
                         matrix_seconds = 1.0e-7_wp
  !> Entries of both factors of a matrix with m entries in each of n rows: this times m n log2 n.
  !> Operations to find them: this times (m n)^1.5. Both measured on clouds of the plane.
  real(wp), parameter :: fill = 0.5_wp, operations = 6.0_wp
  !> Steps of the trial, and the fewest steps that any run of second order takes
  integer, parameter :: pilot_steps = 12, fewest_steps = 4
  !> It goes on until it has taken that part of the products foreseen, by halves of these steps
  real(wp), parameter :: pilot_part = 0.05_wp
  integer, parameter :: most_chunks = 100
  !> Where something changes with time the trial goes on by half as many steps, so often at most,
  !> until they grow by less than that meanwhile
  integer, parameter :: most_settling = 8
  real(wp), parameter :: settled = 1.2_wp
  !> The power of time with which steps grow while a jump spreads: the root mean square of the third
  !> derivative is ∫ (k⁵ exp(-k² t))² dk to the power 1/2 then, which goes with t^(-11/4)
  real(wp), parameter :: spreading_power = 11.0_wp/12
  !> Steps of TR-BDF2 against those of RKL2: its errors are smaller, and its steps grow by leaps.
  !> Measured
  real(wp), parameter :: fewer = 0.9_wp
  !> A series that ends early leaves the rate that it was ended by, divided by the part of the
  !> coefficients that it left out: this at least
  real(wp), parameter :: least_left = 0.1_wp
  !> New factors that steps of growing length take
  integer, parameter :: usual_factorisations = 6

  !> What is known of a problem before it is integrated
  type :: problem_t
    !> Rows, entries beside the diagonal, and operators of expressions in a rate
    real(wp) :: rows = 0.0_wp, entries = 0.0_wp, operations = 0.0_wp
    !> Spectral radius, 1/s
    real(wp) :: spectral_radius = 0.0_wp
    !> The time to integrate, s, and in how many parts, each of which ends with an output
    real(wp) :: duration = 0.0_wp, parts = 1.0_wp
    !> Error that a step may make, and the rate at the start times the duration, both root mean
    !> square
    real(wp) :: tolerance = 0.0_wp, scale = 1.0_wp
    !> What part of the rate at the start may lie off the real axis
    real(wp) :: rough_part = 1.0_wp
    !> The slowest decay, 1/s; 0: not known
    real(wp) :: slowest = 0.0_wp
    !> How far temperatures can be from where they go; huge: not known, or they need not go anywhere
    real(wp) :: range = huge(1.0_wp)
    !> Whether the exponential propagator and TR-BDF2 can integrate it
    logical :: linear = .false., implicit = .true.
    !> Whether its rate is not linear in the state, so that implicit stages take Newton's method
    logical :: reacting = .false.
    !> Whether something changes with time, so that steps need not grow
    logical :: changing = .false.
  end type problem_t

  !> What a method should take
  type :: method_cost_t
    character(len=12) :: name = ''
    !> Steps; products with the Laplacian; seconds of one core
    real(wp) :: steps = 0.0_wp, products = 0.0_wp, seconds = 0.0_wp
    !> Whether that is a bound, as no trial was made
    logical :: at_most = .false.
  end type method_cost_t

  !> What the first steps of a run have shown
  type :: pilot_t
    !> Steps taken, and the time reached, s
    integer :: steps = 0
    real(wp) :: time = 0.0_wp
    !> The next step, s, and how old what spreads was at time 0, s: the step goes with a power of
    !> the age; huge: steps do not grow
    real(wp) :: step = 0.0_wp, age = huge(1.0_wp)
    !> The longest step that RKL2 has proven stable, s
    real(wp) :: longest = huge(1.0_wp)
  end type pilot_t

  !> The method, and why
  type :: method_choice_t
    character(len=:), allocatable :: method
    !> All that could be taken, the cheapest first
    type(method_cost_t), allocatable :: costs(:)
  contains
    !> In one sentence
    procedure :: sentence
  end type method_choice_t

contains

  !> Find the cheapest method.
  subroutine foresee_costs(problem, evolution, stepper, state, choice)
    !> What is known
    type(problem_t), intent(in) :: problem
    !> What is integrated
    class(evolution_t), intent(inout) :: evolution
    !> RKL2, ready to step; it stays as it is
    type(stepper_t), intent(in) :: stepper
    !> The state at time 0
    real(wp), intent(in) :: state(:)
    type(method_choice_t), intent(out) :: choice
    type(pilot_t) :: pilot
    type(method_cost_t) :: exponential, bound
    type(problem_t) :: known
    real(wp) :: roundness, least
    real(wp), allocatable :: rate(:)
    integer :: trials

    allocate (choice%costs(0))
    least = huge(least)
    if (problem%implicit) then
      bound = tr_bdf2_cost(problem, max(real(fewest_steps, wp), problem%parts))
      least = bound%seconds
    end if
    if (problem%linear) then
      exponential = exponential_cost(problem, 0.0_wp)
      ! The integrator makes the same trial.
      trials = trials_of(problem)
      if (trials > 0) then
        call find_roundness(evolution, problem%spectral_radius, trials, roundness)
        known = problem
        allocate (rate(size(state)))
        call evolution%rate(0.0_wp, state, rate)
        call evolution%clear_prescribed(rate)
        known%rough_part = part_off_axis(evolution, problem%spectral_radius, rate)
        exponential = exponential_cost(known, roundness)
      end if
      choice%costs = [exponential]
      if (exponential%seconds <= least) then
        choice%method = 'exponential'
        return
      end if
    else
      ! Steps grow, as a rule: there will hardly be more than if all were as the first.
      bound = rkl2_cost(problem, problem%duration/stepper%first_proposal())
      if (bound%seconds <= least) then
        bound%at_most = .true.
        choice%costs = [bound]
        choice%method = 'rkl2'
        return
      end if
    end if
    call run_pilot(problem, evolution, stepper, state, pilot)
    choice%costs = [choice%costs, rkl2_cost(problem, steps_ahead(problem, pilot, pilot%longest))]
    if (problem%implicit) then
      choice%costs = [choice%costs, tr_bdf2_cost(problem, fewer*steps_ahead(problem, pilot))]
    end if
    call sort(choice%costs)
    choice%method = trim(choice%costs(1)%name)
  end subroutine foresee_costs

  pure subroutine sort(costs)
    type(method_cost_t), intent(inout) :: costs(:)
    type(method_cost_t) :: cheapest
    integer :: k, place

    do k = 1, size(costs) - 1
      place = k - 1 + minloc(costs(k:)%seconds, dim=1)
      cheapest = costs(place)
      costs(place) = costs(k)
      costs(k) = cheapest
    end do
  end subroutine sort

  !> Steps of RKL2 as long as the tolerance allows, on a copy of the state.
  subroutine run_pilot(problem, evolution, stepper, state, pilot)
    type(problem_t), intent(in) :: problem
    class(evolution_t), intent(inout) :: evolution
    type(stepper_t), intent(in) :: stepper
    real(wp), intent(in) :: state(:)
    type(pilot_t), intent(out) :: pilot
    type(stepper_t) :: trial
    type(error_t), allocatable :: error
    real(wp), allocatable :: u(:)
    type(method_cost_t) :: ahead
    real(wp) :: times(most_chunks), steps(most_chunks), ratio
    integer :: chunk

    trial = stepper
    u = state
    ! Steps are as long as they would be on the way to the end, not to the first output.
    chunk = 0
    do
      chunk = chunk + 1
      call trial%advance_to(evolution, pilot%time, problem%duration, u, error, &
                            at_most=pilot_steps/2)
      pilot%steps = trial%steps
      pilot%step = trial%next_proposal()
      times(chunk) = pilot%time
      steps(chunk) = pilot%step
      if (allocated(error) .or. .not. pilot%time < problem%duration) exit
      if (chunk == 1) cycle
      call find_age()
      if (chunk == most_chunks) exit
      ahead = rkl2_cost(problem, steps_ahead(problem, pilot))
      if (trial%integrator%evaluations > pilot_part*ahead%products) exit
    end do
    if (problem%changing) then
      call settle()
      pilot%steps = trial%steps
      pilot%step = trial%next_proposal()
    end if
    ! The longest step comes last; the state is not needed any more.
    pilot%longest = step_at(problem, pilot, problem%duration)
    call trial%integrator%shorten_step(evolution, problem%spectral_radius, pilot%longest, u)

  contains

    !> From the step now and at half that time, or as near to that as is known
    subroutine find_age()
      integer :: k

      k = max(1, count(times(:chunk) <= 0.5_wp*pilot%time))
      pilot%age = huge(pilot%age)
      if (.not. (pilot%time > times(k) .and. pilot%step > 1.001_wp*steps(k))) return
      ! Δt₁/Δt₂ = ((t₁ + age)/(t₂ + age))^power
      ratio = (pilot%step/steps(k))**(1/spreading_power)
      pilot%age = max(0.0_wp, (pilot%time - ratio*times(k))/(ratio - 1))
    end subroutine find_age

    !> Go on until steps are no longer those of the start, but those that the changes allow.
    subroutine settle()
      integer :: k
      real(wp) :: before

      do k = 1, most_settling
        if (allocated(error) .or. .not. pilot%time < problem%duration) return
        before = trial%next_proposal()
        call trial%advance_to(evolution, pilot%time, problem%duration, u, error, &
                              at_most=pilot_steps/2)
        if (trial%next_proposal() < settled*before) return
      end do
    end subroutine settle

  end subroutine run_pilot

  !> Steps of second order that the whole run takes, none longer than that length. Δt goes with the
  !> power 11/12 of the age of what spreads from a jump, and once that is slower as exp(t μ/3): the
  !> third derivative of the slowest mode decays as exp(-t μ).
  pure function steps_ahead(problem, pilot, longest) result(steps)
    type(problem_t), intent(in) :: problem
    type(pilot_t), intent(in) :: pilot
    !> s; none: any step is stable
    real(wp), intent(in), optional :: longest
    real(wp) :: steps
    real(wp) :: step, age, turn, growth, till, low, high
    integer :: k

    steps = pilot%steps
    if (.not. pilot%time < problem%duration .or. .not. pilot%step > 0) return
    till = problem%duration
    if (present(longest)) then
      if (longest < 0.999_wp*step_at(problem, pilot, problem%duration)) then
        ! Until steps are as long as that
        low = pilot%time
        high = problem%duration
        do k = 1, 40
          till = 0.5_wp*(low + high)
          if (step_at(problem, pilot, till) < longest) then
            low = till
          else
            high = till
          end if
        end do
        steps = steps + (problem%duration - till)/longest
      end if
    end if
    if (problem%changing .or. .not. pilot%age < 1.0e3_wp*problem%duration) then
      steps = steps + (till - pilot%time)/pilot%step
      return
    end if
    growth = problem%slowest/3
    turn = min(till, turn_to_decay(problem, pilot))
    ! ∫ dt/Δt, Δt = step ((t + age)/(time + age))^power
    age = max(pilot%time + pilot%age, tiny(age)**0.25_wp)
    step = pilot%step*((turn + pilot%age)/age)**spreading_power
    steps = steps + age/pilot%step*(((turn + pilot%age)/age)**(1 - spreading_power) - 1)/ &
            (1 - spreading_power)
    if (till > turn) then
      steps = steps + (1 - exp(-min(700.0_wp, growth*(till - turn))))/(growth*step)
    end if
  end function steps_ahead

  !> The step that the tolerance allows at that time, s
  pure function step_at(problem, pilot, time) result(step)
    type(problem_t), intent(in) :: problem
    type(pilot_t), intent(in) :: pilot
    !> Not before the end of the trial, s
    real(wp), intent(in) :: time
    real(wp) :: step
    real(wp) :: turn

    step = min(pilot%step, problem%duration)
    if (problem%changing .or. .not. pilot%age < 1.0e3_wp*problem%duration .or. &
        .not. pilot%time < problem%duration) return
    turn = min(time, turn_to_decay(problem, pilot))
    step = pilot%step*((turn + pilot%age)/(pilot%time + pilot%age))**spreading_power* &
           exp(min(100.0_wp, problem%slowest/3*(time - turn)))
    step = min(step, problem%duration/problem%parts)
  end function step_at

  !> From when on the slowest mode decides, s
  pure function turn_to_decay(problem, pilot) result(turn)
    type(problem_t), intent(in) :: problem
    type(pilot_t), intent(in) :: pilot
    real(wp) :: turn

    turn = problem%duration
    if (problem%slowest > 0) then
      turn = min(turn, max(pilot%time, 3*spreading_power/problem%slowest - pilot%age))
    end if
  end function turn_to_decay

  !> Steps of RKL2, each with as many stages as it needs.
  pure function rkl2_cost(problem, steps) result(cost)
    type(problem_t), intent(in) :: problem
    real(wp), intent(in) :: steps
    type(method_cost_t) :: cost
    real(wp) :: stages

    cost%name = 'rkl2'
    cost%steps = max(steps, problem%parts)
    ! s² + s - 2 = 2 λ Δt, rounded up to an odd number
    stages = max(3.0_wp, 1 + 0.5_wp*(sqrt(9 + 8*problem%spectral_radius*problem%duration/ &
                                          cost%steps) - 1))
    cost%products = cost%steps*stages
    cost%seconds = cost%products*(stage_cost(problem) + operator_seconds*problem%operations)
  end function rkl2_cost

  !> Steps of TR-BDF2 with factors: two products and three solutions each, and where stages are
  !> found by Newton's method one more of both for each stage.
  pure function tr_bdf2_cost(problem, steps) result(cost)
    type(problem_t), intent(in) :: problem
    real(wp), intent(in) :: steps
    type(method_cost_t) :: cost
    real(wp) :: in_matrix, in_factors
    integer :: corrections

    cost%name = 'tr_bdf2'
    cost%steps = max(steps, problem%parts)
    corrections = merge(4, 2, problem%reacting)
    cost%products = corrections*cost%steps
    in_matrix = problem%entries + problem%rows
    in_factors = fill*in_matrix*log(max(2.0_wp, problem%rows))/log(2.0_wp)
    cost%seconds = cost%products*(stage_cost(problem) + operator_seconds*problem%operations) + &
                   (corrections + 1)*cost%steps* &
                   (slowdown(0.5_wp*in_factors, slower_solution)*in_factors*solution_seconds + &
                    problem%rows*stage_seconds) + &
                   matrix_seconds*in_matrix + min(cost%steps, real(usual_factorisations, wp))* &
                   (factor_seconds*in_factors + operation_seconds*operations*in_matrix**1.5_wp)
  end function tr_bdf2_cost

  !> One series for each part, or several where it would be too long.
  pure function exponential_cost(problem, roundness) result(cost)
    type(problem_t), intent(in) :: problem
    real(wp), intent(in) :: roundness
    type(method_cost_t) :: cost
    real(wp) :: step, first, number, rate, products

    cost%name = 'exponential'
    cost%steps = series_needed(problem)
    step = problem%duration/cost%steps
    cost%products = trials_of(problem)
    rate = problem%scale/problem%duration
    ! Neighbouring series are much alike: of many in turn the first is foreseen.
    first = 0
    do while (first < cost%steps)
      number = min(cost%steps - first, 1 + aint(first/8))
      call foresee_series(problem, roundness, step, (first + 1)*step, rate, products)
      cost%products = cost%products + number*products
      first = first + number
    end do
    cost%seconds = cost%products*stage_cost(problem)
  end function exponential_cost

  !> The products of a series, and the rate that it leaves.
  pure subroutine foresee_series(problem, roundness, step, time, rate, products)
    type(problem_t), intent(in) :: problem
    real(wp), intent(in) :: roundness
    !> Its length and its end, s
    real(wp), intent(in) :: step, time
    !> The rate at its start and at its end, root mean square
    real(wp), intent(inout) :: rate
    real(wp), intent(out) :: products
    real(wp) :: decay, useful, part, held, coefficients_left

    decay = problem%spectral_radius*step
    part = part_left*problem%tolerance/(step*rate)
    held = huge(held)
    if (problem%range < huge(1.0_wp)) held = problem%range/(step*rate)
    ! On the real axis, and off it
    useful = useful_roundness(roundness, problem%rough_part, decay, part)
    products = 1 + exponential_terms(decay, part, useful, problem%slowest*step, held)
    coefficients_left = least_left
    if (useful > 0) then
      coefficients_left = max(least_left, 1 - products/(0.5_wp*decay*tanh(useful)))
    else if (0.5_wp*decay*(1 - 1/cosh(roundness)) > 3) then
      products = max(products, 1 + exponential_terms(decay, part/problem%rough_part, &
                                                     roundness/widening))
    end if
    if (.not. problem%range < huge(1.0_wp)) return
    ! What has not decayed, and what the series left over: c_k being about 1/(z tanh g) until there,
    ! A Δt times what is left of Σ c_k P_k F is about P_k F, which ended the series.
    rate = min(rate, max(problem%range*left_of_rate(problem%slowest, time), &
                         part_left*problem%tolerance/(step*coefficients_left)))
  end subroutine foresee_series

  pure function series_needed(problem) result(number)
    type(problem_t), intent(in) :: problem
    real(wp) :: number

    number = max(problem%parts, anint(0.5_wp + problem%spectral_radius*problem%duration/ &
                                      longest_series))
  end function series_needed

  pure function trials_of(problem) result(terms)
    type(problem_t), intent(in) :: problem
    integer :: terms

    terms = trial_terms(problem%spectral_radius*problem%duration/series_needed(problem), &
                        part_of(problem))
  end function trials_of

  !> What a series may leave over, as a part of Δt F
  pure function part_of(problem) result(part)
    type(problem_t), intent(in) :: problem
    real(wp) :: part

    part = part_left*problem%tolerance/(problem%scale/series_needed(problem))
  end function part_of

  !> Seconds of one core for a product and the vector updates that go with it
  pure function stage_cost(problem) result(seconds)
    type(problem_t), intent(in) :: problem
    real(wp) :: seconds

    seconds = call_seconds + problem%rows*(row_seconds + stage_seconds) + &
              problem%entries*entry_seconds
    seconds = slowdown(problem%entries, slower)*seconds
  end function stage_cost

  !> By how much what streams through so many entries takes longer than what stays in the cache
  pure function slowdown(entries, slower) result(factor)
    real(wp), intent(in) :: entries
    !> Beyond either cache
    real(wp), intent(in) :: slower(2)
    real(wp) :: factor

    factor = 1
    if (entries > cached_entries(1)) factor = slower(1)
    if (entries > cached_entries(2)) factor = slower(2)
  end function slowdown

  !> 'exponential: 1 step, 45 products, 0.2 ms; rkl2: …', of one core
  function sentence(this) result(text)
    class(method_choice_t), intent(in) :: this
    character(len=:), allocatable :: text
    integer :: k

    text = ''
    do k = 1, size(this%costs)
      associate (cost => this%costs(k))
        if (k > 1) text = text//'; '
        text = text//trim(cost%name)//merge(': at most ', ': about   ', cost%at_most)
        text = trim(text)//' '//to_text(anint(cost%steps), digits=3)// &
               trim(merge(' step, ', ' steps,', anint(cost%steps) < 1.5_wp))//' '// &
               to_text(anint(cost%products), digits=3)//' products, '//seconds_text(cost%seconds)
      end associate
    end do
    if (size(this%costs) == 0) then
      text = 'no other method takes what is in force'
    else
      text = text//' of one core'
      if (size(this%costs) == 1) text = text//'; nothing else could be cheaper'
    end if
  end function sentence

  !> A time for people, as in '1.5 ms'.
  pure function seconds_text(seconds) result(text)
    real(wp), intent(in) :: seconds
    character(len=:), allocatable :: text

    if (seconds < 1.0e-3_wp) then
      text = to_text(1.0e6_wp*seconds, digits=2)//' µs'
    else if (seconds < 1.0_wp) then
      text = to_text(1.0e3_wp*seconds, digits=2)//' ms'
    else
      text = to_text(seconds, digits=2)//' s'
    end if
  end function seconds_text

end module calor_method_choice
