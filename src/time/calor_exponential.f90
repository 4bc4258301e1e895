!> The exponential propagator for linear problems that do not change with time: exact in time, but
!> for what a series of Chebyshev polynomials leaves over.
!>
!> Where F(u) = A u + b, the solution is
!>
!>     u(t + Δt) = u + Δt φ(Δt A) F(u),   φ(z) = (exp z - 1)/z,
!>
!> for a step of any length. φ is expanded in Chebyshev polynomials on an ellipse that holds the
!> spectrum of A and ends at 0, scaled so that they stay bounded there, its Faber polynomials; they
!> are found by products with A alone. On the interval from -λ to 0, an ellipse without height,
!> about √(λ Δt ln(1/ε)) of them leave an error of ε: as the terms in turn fall faster than any
!> power, that error is known from the coefficients left out and the size of the last polynomial.
!>
!> How high the ellipse has to be shows in the polynomials: where they grow, eigenvalues lie
!> outside, and the growth tells how far. The series then begins anew on a higher one.
!>
!> Sources: H. Tal-Ezer, R. Kosloff, J. Chem. Phys. 81 (1984) 3967–3971; M. Hochbruck,
!> A. Ostermann, Exponential integrators, Acta Numerica 19 (2010) 209–286, section 4; I. Moret,
!> P. Novati, An interpolatory approximation of the matrix exponential based on Faber polynomials,
!> J. Comput. Appl. Math. 131 (2001) 361–380.
module calor_exponential
  use calor_constants, only: worth_threads
  use calor_evolution, only: evolution_t
  use calor_integrator, only: integrator_t
  use calor_kinds, only: wp, i8
  use calor_saved_state, only: saved_state_t
  implicit none (type, external)
  private

  public :: exponential_t, exponential_terms, find_roundness, left_of_rate, longest_series, &
            part_left, part_off_axis, trial_terms, useful_roundness, widening

  !> The series ends when what it leaves over should be this part of the tolerance …
  real(wp), parameter :: part_left = 0.1_wp
  !> … or, without a tolerance, this part of the state
  real(wp), parameter :: least_part = 1.0e-13_wp
  !> The polynomials are measured after so many terms
  integer, parameter :: terms_between = 4
  !> Longer series would not be cheaper than two steps
  integer, parameter :: most_terms = 4000
  !> Spectral radius times step of a series of that length
  real(wp), parameter :: longest_series = 0.9_wp*real(most_terms, wp)**2/36
  !> Terms of the trial that finds out how round the ellipse has to be, at least and as a part of
  !> the series; it is made where a series is longer than twice that
  integer, parameter :: fewest_trial_terms = 48
  real(wp), parameter :: trial_part = 0.15_wp
  !> A mode off the real axis lives on so many particles
  real(wp), parameter :: few_particles = 8.0_wp
  !> The growth is that between the largest of so many polynomials in turn
  integer, parameter :: swing = 8
  !> Where rounding errors of a term reach this part of what is allowed, polynomials have grown too
  !> much; the next ellipse is wider than they tell by the second factor
  real(wp), parameter :: rounding_part = 0.3_wp, widening = 1.2_wp, least_widening = 0.02_wp
  !> The roundest ellipse: as good as a circle
  real(wp), parameter :: roundest = 4.0_wp

  type, extends(integrator_t) :: exponential_t
    private
    !> F at the start, three polynomials times it in turn, and the sum of the series
    real(wp), allocatable :: rate_start(:), polynomial(:, :), total(:), product(:)
    !> Half the axes of the ellipse are in the proportion of 1 to tanh g; this is g
    real(wp) :: roundness = 0
    !> That of an ellipse on which polynomials do not grow at all
    real(wp) :: widest = 0
    !> What part of F may lie off the real axis
    real(wp) :: rough_part = 1
    !> Coefficients for the step, spectral radius and roundness in `made_for`, and the sum of the
    !> magnitudes of those after each
    real(wp), allocatable :: coefficient(:), left(:)
    real(wp) :: made_for(3) = -1
    !> The last term left an error of this times the polynomial number `last`
    real(wp) :: error_factor = 0
    integer :: last = 1
    !> No longer step has worked, s
    real(wp) :: longest = huge(1.0_wp)
    logical :: tried = .false.
  contains
    procedure :: longest_stable_step
    procedure :: shorten_step
    procedure :: estimates_error
    procedure :: order
    procedure :: next_step
    procedure :: wants_trial
    procedure :: advance
    procedure :: add_step_error
    procedure :: save => save_exponential
    procedure :: restore => restore_exponential
    procedure, private :: find_coefficients
    procedure, private :: sum_series
  end type exponential_t

contains

  !> So many terms leave an error of about that part of Δt F.
  pure function exponential_terms(decay, part, roundness, slowest, held) result(terms)
    !> Spectral radius times step
    real(wp), intent(in) :: decay
    !> The part
    real(wp), intent(in) :: part
    !> Of the ellipse; 0: an interval
    real(wp), intent(in) :: roundness
    !> The slowest decay in F times the step, and what modes of a decay may hold of F, divided by
    !> that times the step; both given: what decays faster lies within the ellipse, where
    !> polynomials fall
    real(wp), intent(in), optional :: slowest, held
    real(wp) :: terms
    real(wp) :: z, digits, low, high, middle, flat, slow, hold
    integer :: k

    slow = 0
    hold = huge(hold)
    if (present(slowest) .and. present(held)) then
      slow = slowest
      hold = held
    end if

    ! Coefficient k is 2 exp(k g - z) I_k(z / cosh g), and I_k(y) about
    ! exp(√(k² + y²) - k asinh(k/y)): largest, about 1, at k = z tanh g.
    z = 0.5_wp*max(decay, tiny(decay)**0.25_wp)
    flat = z/cosh(roundness)
    digits = log(1/min(max(part, epsilon(part)), 1.0_wp))
    low = 0
    high = z*tanh(roundness) + sqrt(2*z*digits) + digits + 4
    do k = 1, 40
      middle = 0.5_wp*(low + high)
      if (fallen_coefficients(middle) + fallen_polynomials(middle) < digits) then
        low = middle
      else
        high = middle
      end if
    end do
    ! … and those after which the series is seen to be good enough
    terms = high + 1 + 1.25_wp*terms_between

  contains

    !> -ln of the coefficients left after so many
    pure function fallen_coefficients(term) result(fallen)
      real(wp), intent(in) :: term
      real(wp) :: fallen

      fallen = 0
      if (term > z*tanh(roundness)) then
        fallen = z + term*asinh(term/flat) - hypot(term, flat) - term*roundness
      end if
    end function fallen_coefficients

    !> -ln of that polynomial times F, as a part of F. At -m it is exp(-k m/(z tanh g)), and modes
    !> of that decay hold m times their share; those off the axis do not reach the ellipse, as it
    !> is wider than they need.
    pure function fallen_polynomials(term) result(fallen)
      real(wp), intent(in) :: term
      real(wp) :: fallen
      real(wp) :: time

      fallen = 0
      if (.not. (roundness > 0 .and. hold < huge(hold))) return
      time = term/(z*tanh(roundness))
      fallen = max(slow*time, -log(hold) - log(left_of_rate(slow, time)))
      fallen = min(fallen, term*roundness*(1 - 1/widening))
    end function fallen_polynomials
  end function exponential_terms

  !> The largest m exp(-m t) for a decay m from the slowest on: what modes of like amplitude have at
  !> most for a rate after that time.
  pure function left_of_rate(slowest, time) result(rate)
    real(wp), intent(in) :: slowest
    real(wp), intent(in) :: time
    real(wp) :: rate

    if (slowest*time < 1) then
      rate = exp(-1.0_wp)/max(time, tiny(time)**0.25_wp)
    else
      rate = slowest*exp(-min(600.0_wp, slowest*time))
    end if
  end function left_of_rate

  !> That of the longest series
  pure function longest_stable_step(this, spectral_radius) result(step)
    class(exponential_t), intent(in) :: this
    real(wp), intent(in) :: spectral_radius
    real(wp) :: step

    associate (unused => this)
    end associate
    step = longest_series/spectral_radius
  end function longest_stable_step

  subroutine shorten_step(this, evolution, spectral_radius, step, work)
    class(exponential_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: spectral_radius
    real(wp), intent(inout) :: step
    real(wp), intent(inout), contiguous :: work(:)

    associate (unused => evolution, also => spectral_radius, and => work)
    end associate
    step = min(step, this%longest)
  end subroutine shorten_step

  !> How many terms a trial should have; 0: the series is so short that none is worth its products.
  pure function trial_terms(decay, part) result(terms)
    !> Spectral radius times step
    real(wp), intent(in) :: decay
    !> What the series may leave over, as a part of Δt F
    real(wp), intent(in) :: part
    integer :: terms
    real(wp) :: series

    series = exponential_terms(decay, part, 0.0_wp)
    terms = 0
    if (series > 2*fewest_trial_terms) terms = max(fewest_trial_terms, nint(trial_part*series))
    terms = terms + mod(terms, 2)
  end function trial_terms

  !> An interval will do where polynomials cannot grow to more than some ten times, or where what
  !> grows is so little at the start that rounding errors do not count in the end.
  pure function useful_roundness(roundness, rough_part, decay, part) result(useful)
    !> Of an ellipse on which they do not grow
    real(wp), intent(in) :: roundness
    !> What part of F may lie off the real axis
    real(wp), intent(in) :: rough_part
    !> Spectral radius times step
    real(wp), intent(in) :: decay
    !> What the series may leave over, as a part of Δt F
    real(wp), intent(in) :: part
    real(wp) :: useful

    ! Terms grow to exp(z (1 - 1/cosh g)), about exp(z g²/2), z = λ Δt/2, polynomials as exp(g k).
    useful = 0
    if (0.5_wp*decay*(1 - 1/cosh(roundness)) > 3 .and. &
        roundness*exponential_terms(decay, part, 0.0_wp) + log(rough_part) > &
        log(rounding_part*part/epsilon(part))) useful = roundness
  end function useful_roundness

  !> What part of F may lie in modes off the real axis: of what decays as fast as the spectral
  !> radius lets it, that on a few particles.
  function part_off_axis(evolution, spectral_radius, rate) result(part)
    !> Whose Jacobian
    class(evolution_t), intent(inout) :: evolution
    !> Its spectral radius, 1/s
    real(wp), intent(in) :: spectral_radius
    !> F, 0 where it is prescribed
    real(wp), intent(in), contiguous :: rate(:)
    real(wp) :: part
    real(wp), allocatable :: product(:)

    allocate (product(size(rate)))
    call evolution%jacobian_product(rate, product)
    part = evolution%root_mean_square(product)/ &
           max(spectral_radius*evolution%root_mean_square(rate), tiny(part)**0.25_wp)
    part = min(1.0_wp, part)*sqrt(few_particles/max(few_particles, &
                                                    real(evolution%all_unknowns(), wp)))
    part = max(epsilon(part), part)
  end function part_off_axis

  !> How round an ellipse has to be for polynomials to stay bounded on a vector of random numbers.
  !> Modes off the real axis live on a few particles: they stand out at these long before they do in
  !> a mean square.
  subroutine find_roundness(evolution, spectral_radius, terms, roundness)
    !> Whose Jacobian
    class(evolution_t), intent(inout) :: evolution
    !> Its spectral radius, 1/s
    real(wp), intent(in) :: spectral_radius
    !> Polynomials to make: an even number of products with the Jacobian
    integer, intent(in) :: terms
    !> g, half the axes of the ellipse being in the proportion of 1 to tanh g
    real(wp), intent(out) :: roundness
    real(wp), allocatable :: polynomial(:, :), product(:), unused(:)
    real(wp) :: half_way, at_end
    integer :: n, k, older, newer

    n = evolution%unknowns()
    allocate (polynomial(n, 2), product(n), unused(n), source=0.0_wp)
    call evolution%scatter(6, polynomial(:, 1))
    newer = 1
    older = 2
    half_way = 0
    at_end = 0
    do k = 1, terms
      call evolution%jacobian_product(polynomial(:, newer), product)
      call add_term(0.0_wp, merge(1.0_wp, 2.0_wp, k == 1), 2/spectral_radius, 1.0_wp, product, &
                    polynomial(:, newer), polynomial(:, older), unused)
      newer = older
      older = 3 - newer
      ! A mode swings as it grows.
      if (k <= terms/2 .and. k > terms/2 - swing) then
        half_way = max(half_way, peak_size(evolution, polynomial(:, newer)))
      else if (k > 2*(terms/2) - swing) then
        at_end = max(at_end, peak_size(evolution, polynomial(:, newer)))
      end if
    end do
    roundness = 0
    if (.not. half_way > 0) return
    roundness = log(at_end/half_way)/(terms/2)
    roundness = widening*max(0.0_wp, roundness)
  end subroutine find_roundness

  !> The sixteenth root of the mean of sixteenth powers: about the largest entry, whatever
  !> their number
  function peak_size(evolution, v) result(peak)
    class(evolution_t), intent(in) :: evolution
    real(wp), intent(in) :: v(:)
    real(wp) :: peak

    peak = evolution%root_mean_square(v)
    if (.not. (peak > 0 .and. peak <= huge(peak))) return
    peak = peak*evolution%root_mean_square((v/peak)**8)**0.125_wp
  end function peak_size

  pure function estimates_error(this) result(answer)
    class(exponential_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .true.
  end function estimates_error

  !> Of no order: the error does not follow from the step. What is asked for is a number large
  !> enough to say that shorter steps gain nothing.
  pure function order(this)
    class(exponential_t), intent(in) :: this
    integer :: order

    associate (unused => this)
    end associate
    order = 12
  end function order

  pure function next_step(this, step, local_error) result(proposed)
    class(exponential_t), intent(in) :: this
    real(wp), intent(in) :: step
    real(wp), intent(in) :: local_error
    real(wp) :: proposed

    proposed = this%longest
    if (local_error > this%tolerance) proposed = min(this%longest, 0.5_wp*step)
  end function next_step

  !> A step as long as can be is good enough.
  pure function wants_trial(this) result(answer)
    class(exponential_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .false.
  end function wants_trial

  subroutine advance(this, evolution, time, step, spectral_radius, u, u_next, local_error)
    class(exponential_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: time, step
    real(wp), intent(in) :: spectral_radius
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(out), contiguous :: u_next(:)
    real(wp), intent(out) :: local_error
    real(wp) :: accuracy, start_size
    integer :: n, k, trials
    logical :: done

    n = size(u)
    if (.not. allocated(this%total)) then
      allocate (this%rate_start(n), this%polynomial(n, 2), this%total(n), this%product(n))
    end if
    if (allocated(this%failure)) deallocate (this%failure)
    u_next = u
    local_error = huge(local_error)
    if (.not. evolution%is_linear() .or. evolution%depends_on_time()) then
      this%failure = 'the problem is not linear, or changes with time'
      return
    end if
    call evolution%rate(time, u, this%rate_start)
    this%evaluations = this%evaluations + 1
    start_size = max(evolution%root_mean_square(this%rate_start), tiny(start_size)**0.25_wp)
    accuracy = part_left*this%tolerance
    if (.not. accuracy > 0) accuracy = least_part*evolution%root_mean_square(u)
    ! Rounding errors of the series set a limit.
    accuracy = max(accuracy, 10*epsilon(step)*step*start_size)
    trials = 0
    if (.not. this%tried) trials = trial_terms(step*spectral_radius, accuracy/(step*start_size))
    if (trials > 0) then
      this%tried = .true.
      call find_roundness(evolution, spectral_radius, trials, this%widest)
      this%rough_part = part_off_axis(evolution, spectral_radius, this%rate_start)
      this%evaluations = this%evaluations + trials + 1
    end if
    this%roundness = useful_roundness(this%widest, this%rough_part, &
                                      step*spectral_radius, accuracy/(step*start_size))
    done = .false.
    do while (.not. done .and. this%roundness < roundest)
      call this%find_coefficients(step, spectral_radius)
      call this%sum_series(evolution, step, spectral_radius, start_size, accuracy, local_error, &
                           done)
    end do
    if (.not. done) then
      this%roundness = 0
      this%widest = 0
      this%longest = 0.5_wp*step
      local_error = huge(local_error)
      this%failure = 'the spectrum lies too far off the real axis'
      return
    end if
    !$omp parallel do if (n > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, n
      u_next(k) = u(k) + step*this%total(k)
    end do
    !$omp end parallel do
  end subroutine advance

  !> Sum the series up, unless its polynomials grow: then make the ellipse rounder.
  subroutine sum_series(this, evolution, step, spectral_radius, start_size, accuracy, local_error, &
                        done)
    class(exponential_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: step, spectral_radius
    !> Root mean square of F
    real(wp), intent(in) :: start_size
    !> What the series may leave over
    real(wp), intent(in) :: accuracy
    !> What it does
    real(wp), intent(out) :: local_error
    !> Whether the polynomials stayed bounded
    logical, intent(out) :: done
    real(wp) :: last_size, envelope, outward, sizes(0:ubound(this%coefficient, 1))
    integer :: n, k, term, older, newer, half

    n = size(this%total)
    outward = exp(-this%roundness)
    older = 1
    newer = 2
    !$omp parallel do if (n > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, n
      this%polynomial(k, newer) = this%rate_start(k)
      this%polynomial(k, older) = 0
      this%total(k) = this%coefficient(0)*this%rate_start(k)
    end do
    !$omp end parallel do
    last_size = start_size
    envelope = start_size
    done = .true.
    do term = 0, ubound(this%coefficient, 1)
      this%last = newer
      if (term > 0) then
        call evolution%jacobian_product(this%polynomial(:, newer), this%product)
        this%evaluations = this%evaluations + 1
        call add_term(this%coefficient(term), &
                      merge(1.0_wp, 2.0_wp, term == 1)*cosh(this%roundness)*outward, &
                      2/spectral_radius, outward**2, this%product, this%polynomial(:, newer), &
                      this%polynomial(:, older), this%total)
        this%last = older
        older = newer
        newer = this%last
      end if
      if (mod(term, terms_between) > 0) cycle
      last_size = evolution%root_mean_square(this%polynomial(:, newer))
      ! One may be small by chance; what lies on the real axis falls as exp(-g k) at least.
      if (term > 0) envelope = max(last_size, envelope*outward**terms_between)
      ! The terms since the last look are a measure of those to come, on the safe side.
      if (step*this%left(max(0, term - terms_between))*envelope <= accuracy) exit
      sizes(term) = last_size
      if (term < 2*terms_between) cycle
      if (.not. epsilon(step)*step*abs(this%coefficient(term))*last_size <= &
          rounding_part*accuracy .or. term + terms_between > ubound(this%coefficient, 1)) then
        ! In the end they grow as exp(growth k).
        half = (term/2/terms_between)*terms_between
        this%roundness = this%roundness + least_widening + &
                         widening*max(0.0_wp, log(sizes(term)/sizes(half)))/(term - half)
        this%widest = max(this%widest, this%roundness)
        done = .false.
        exit
      end if
    end do
    term = min(term, ubound(this%coefficient, 1))
    this%error_factor = step*this%left(term)
    local_error = max(this%error_factor*envelope, &
                      epsilon(step)*step*start_size)
    ! What rounding leaves no step can mend.
    if (this%tolerance > 0 .and. local_error <= accuracy) then
      local_error = min(local_error, this%tolerance)
    end if
  end subroutine sum_series

  !> The next polynomial, which takes the place of the one before the last, and its term.
  subroutine add_term(coefficient, factor, scale, damping, product, newer, older, total)
    !> Of the term
    real(wp), intent(in) :: coefficient
    !> The next polynomial is factor (1 + scale A) times the last less damping times the one before.
    real(wp), intent(in) :: factor, scale, damping
    !> A times the last polynomial, that itself and the one before
    real(wp), intent(in), contiguous :: product(:), newer(:)
    real(wp), intent(inout), contiguous :: older(:)
    !> The series
    real(wp), intent(inout), contiguous :: total(:)
    integer :: k

    !$omp parallel do if (size(total) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(total)
      older(k) = factor*(newer(k) + scale*product(k)) - damping*older(k)
      total(k) = total(k) + coefficient*older(k)
    end do
    !$omp end parallel do
  end subroutine add_term

  !> Coefficients of φ(z (x/cosh g - 1)), z = Δt λ/2, in Tₖ(x) exp(-k g).
  !>
  !> Those of the exponential function, eₖ = 2 exp(k g - z) Iₖ(z/cosh g), follow from the recurrence
  !> of the Bessel functions downwards (J.C.P. Miller), and their sum at x = cosh g, where the
  !> function is 1. As x φ(x) = exp x - 1, those of φ obey cₖ₋₁ - cₖ = exp(-2g) (cₖ - cₖ₊₁) +
  !> (1 + exp(-2g)) eₖ/z. No sum has terms of both signs: rounding errors stay small.
  subroutine find_coefficients(this, step, spectral_radius)
    class(exponential_t), intent(inout) :: this
    real(wp), intent(in) :: step
    real(wp), intent(in) :: spectral_radius
    real(wp), parameter :: large = 1.0e200_wp
    real(wp), allocatable :: of_exp(:)
    real(wp) :: z, inward, total, difference
    integer :: terms, k

    if (all(abs([step, spectral_radius, this%roundness] - this%made_for) <= &
            1.0e-11_wp*abs(this%made_for))) return
    this%made_for = [step, spectral_radius, this%roundness]
    if (allocated(this%coefficient)) deallocate (this%coefficient, this%left)
    z = 0.5_wp*step*spectral_radius
    terms = ceiling(1.1_wp*exponential_terms(2*z, epsilon(step), this%roundness)) + 10
    allocate (this%coefficient(0:terms), this%left(0:terms), of_exp(0:terms + 1))
    inward = exp(-this%roundness)
    of_exp(terms + 1) = 0
    of_exp(terms) = 1
    do k = terms, 1, -1
      of_exp(k - 1) = inward**2*of_exp(k + 1) + &
                      inward*cosh(this%roundness)*2*k/z*of_exp(k)
      if (of_exp(k - 1) > large) of_exp(k - 1:) = of_exp(k - 1:)/large
    end do
    total = 0.5_wp*of_exp(0)
    do k = 1, terms
      total = total + 0.5_wp*(1 + exp(-2*k*this%roundness))*of_exp(k)
    end do
    of_exp = of_exp/total

    this%coefficient(terms) = 0
    difference = 0
    do k = terms, 1, -1
      difference = inward**2*difference + (1 + inward**2)*of_exp(k)/z
      this%coefficient(k - 1) = this%coefficient(k) + difference
    end do
    this%coefficient(0) = 0.5_wp*this%coefficient(0)
    this%left(terms) = 0
    do k = terms - 1, 0, -1
      this%left(k) = this%left(k + 1) + this%coefficient(k + 1)
    end do
  end subroutine find_coefficients

  !> The series' last polynomial times what is left of the coefficients
  subroutine add_step_error(this, step, total)
    class(exponential_t), intent(in) :: this
    real(wp), intent(in) :: step
    real(wp), intent(inout), contiguous :: total(:)
    integer :: k

    associate (unused => step)
    end associate
    !$omp parallel do if (size(total) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(total)
      total(k) = total(k) + this%error_factor*this%polynomial(k, this%last)
    end do
    !$omp end parallel do
  end subroutine add_step_error

  subroutine save_exponential(this, state)
    class(exponential_t), intent(in) :: this
    type(saved_state_t), intent(inout) :: state

    call state%put('evaluations', this%evaluations)
    call state%put('roundness', this%roundness)
    call state%put('widest', this%widest)
    call state%put('rough_part', this%rough_part)
    call state%put('made_for', this%made_for)
    call state%put('longest', this%longest)
    call state%put('tried', this%tried)
    if (.not. allocated(this%coefficient)) return
    call state%put('coefficient', this%coefficient)
    call state%put('left', this%left)
  end subroutine save_exponential

  subroutine restore_exponential(this, state)
    class(exponential_t), intent(inout) :: this
    type(saved_state_t), intent(inout) :: state
    real(wp), allocatable :: numbers(:)

    call state%get('evaluations', this%evaluations)
    call state%get('roundness', this%roundness)
    call state%get('widest', this%widest)
    call state%get('rough_part', this%rough_part)
    call state%get('made_for', numbers)
    if (allocated(numbers)) this%made_for = numbers
    call state%get('longest', this%longest)
    call state%get('tried', this%tried)
    if (.not. state%has('coefficient')) return
    if (allocated(this%coefficient)) deallocate (this%coefficient, this%left)
    call state%get('coefficient', numbers)
    allocate (this%coefficient(0:size(numbers) - 1), this%left(0:size(numbers) - 1))
    this%coefficient(:) = numbers
    call state%get('left', numbers)
    if (size(numbers) == size(this%left)) this%left(:) = numbers
  end subroutine restore_exponential

end module calor_exponential
