!> The exponential propagator for linear problems that do not change with time: exact in time, but
!> for what a series of Chebyshev polynomials leaves over.
!>
!> Where F(u) = A u + b, the solution is
!>
!>     u(t + Δt) = u + Δt φ(Δt A) F(u),   φ(z) = (exp z - 1)/z,
!>
!> for a step of any length. φ is expanded in Chebyshev polynomials on the interval from -λ to 0
!> that holds the spectrum of A; they are found by products with A alone. About √(2 λ Δt ln(1/ε)) of
!> them leave an error of ε: as the terms in turn fall faster than any power, that error is known
!> from the coefficients left out and the size of the last polynomial. Off the real axis polynomials
!> grow, and so would rounding errors: where terms become larger than the tolerance allows, the step
!> is made shorter.
!>
!> Sources: H. Tal-Ezer, R. Kosloff, J. Chem. Phys. 81 (1984) 3967–3971; M. Hochbruck,
!> A. Ostermann, Exponential integrators, Acta Numerica 19 (2010) 209–286, section 4.
module calor_exponential
  use calor_constants, only: pi, worth_threads
  use calor_evolution, only: evolution_t
  use calor_integrator, only: integrator_t
  use calor_kinds, only: wp
  use calor_sums, only: root_mean_square
  implicit none (type, external)
  private

  public :: exponential_t, exponential_terms

  !> The series ends when what it leaves over should be this part of the tolerance …
  real(wp), parameter :: part_left = 0.1_wp
  !> … or, without a tolerance, this part of the state
  real(wp), parameter :: least_part = 1.0e-13_wp
  !> The polynomials are measured after so many terms
  integer, parameter :: terms_between = 4
  !> Longer series would not be cheaper than two steps
  integer, parameter :: most_terms = 4000
  !> ln of the growth of polynomials off the real axis that a shortened step allows
  real(wp), parameter :: allowed_growth = 8.0_wp

  type, extends(integrator_t) :: exponential_t
    private
    !> F at the start, three polynomials times it in turn, and the sum of the series
    real(wp), allocatable :: rate_start(:), polynomial(:, :), total(:), product(:)
    !> Coefficients for the step and the spectral radius in `made_for`, and the sum of the
    !> magnitudes of those after each
    real(wp), allocatable :: coefficient(:), left(:)
    real(wp) :: made_for(2) = 0
    !> The last term left an error of this times the polynomial number `last`
    real(wp) :: error_factor = 0
    integer :: last = 1
    !> No longer step has worked, s
    real(wp) :: longest = huge(1.0_wp)
  contains
    procedure :: longest_stable_step
    procedure :: shorten_step
    procedure :: estimates_error
    procedure :: order
    procedure :: next_step
    procedure :: wants_trial
    procedure :: advance
    procedure :: add_step_error
    procedure, private :: find_coefficients
  end type exponential_t

contains

  !> So many terms leave an error of about that part of Δt F.
  pure function exponential_terms(decay, part) result(terms)
    !> Spectral radius times step
    real(wp), intent(in) :: decay
    !> The part
    real(wp), intent(in) :: part
    real(wp) :: terms
    real(wp) :: z, digits

    ! Coefficient k of exp(z (x - 1)) is 2 exp(-z) I_k(z): about exp(-k²/(2z)) up to k = z, and
    ! (e z/(2k))^k beyond.
    z = 0.5_wp*decay
    digits = log(1/max(part, epsilon(part)))
    terms = sqrt(2*z*digits) + 0.3_wp*digits + 4
  end function exponential_terms

  !> That of the longest series
  pure function longest_stable_step(this, spectral_radius) result(step)
    class(exponential_t), intent(in) :: this
    real(wp), intent(in) :: spectral_radius
    real(wp) :: step

    associate (unused => this)
    end associate
    step = real(most_terms, wp)**2/(-log(epsilon(step)))/spectral_radius*0.9_wp
  end function longest_stable_step

  subroutine shorten_step(this, evolution, spectral_radius, step)
    class(exponential_t), intent(inout) :: this
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: spectral_radius
    real(wp), intent(inout) :: step

    associate (unused => evolution, also => spectral_radius)
    end associate
    step = min(step, this%longest)
  end subroutine shorten_step

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
    real(wp), intent(in) :: u(:)
    real(wp), intent(out) :: u_next(:)
    real(wp), intent(out) :: local_error
    real(wp) :: accuracy, start_size, last_size, rounding, growth
    integer :: n, k, term, older, newer

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
    accuracy = part_left*this%tolerance
    if (.not. accuracy > 0) accuracy = least_part*root_mean_square(u)
    call this%find_coefficients(step, spectral_radius)
    call evolution%rate(time, u, this%rate_start)
    this%evaluations = this%evaluations + 1
    start_size = root_mean_square(this%rate_start)
    last_size = start_size
    rounding = 0

    older = 1
    newer = 2
    !$omp parallel do if (n > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, n
      this%polynomial(k, newer) = this%rate_start(k)
      this%polynomial(k, older) = 0
      this%total(k) = this%coefficient(0)*this%rate_start(k)
    end do
    !$omp end parallel do
    do term = 1, ubound(this%coefficient, 1)
      if (mod(term, terms_between) == 1) then
        last_size = root_mean_square(this%polynomial(:, newer))
        rounding = max(rounding, epsilon(step)*step*last_size*abs(this%coefficient(term - 1)))
        if (step*this%left(term - 1)*max(last_size, start_size) <= accuracy) exit
        if (.not. rounding <= max(accuracy, 1.0e2_wp*epsilon(step)*step*start_size)) exit
      end if
      call evolution%jacobian_product(this%polynomial(:, newer), this%product)
      this%evaluations = this%evaluations + 1
      call add_term(this%coefficient(term), merge(1.0_wp, 2.0_wp, term == 1), &
                    2/spectral_radius, this%product, this%polynomial(:, newer), &
                    this%polynomial(:, older), this%total)
      older = newer
      newer = 3 - older
    end do
    term = min(term, ubound(this%coefficient, 1)) - 1
    last_size = root_mean_square(this%polynomial(:, newer))
    this%error_factor = step*this%left(term)
    this%last = newer
    local_error = this%error_factor*max(last_size, start_size)
    if (.not. rounding <= max(accuracy, 1.0e2_wp*epsilon(step)*step*start_size)) then
      ! Polynomials grew as exp(growth k); terms are largest at k = growth λ Δt/2, where they are
      ! exp(growth² λ Δt/4).
      growth = log(max(2.0_wp, last_size/max(start_size, tiny(start_size))))/max(1, term)
      this%longest = min(0.5_wp*step, 4*allowed_growth/(growth**2*spectral_radius))
      local_error = huge(local_error)
      this%failure = 'the spectrum lies too far off the real axis for so long a step'
      return
    end if
    !$omp parallel do if (n > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, n
      u_next(k) = u(k) + step*this%total(k)
    end do
    !$omp end parallel do
  end subroutine advance

  !> The next polynomial, 2 x p - (the one before), x = 1 + 2 A/λ, which takes the place of the one
  !> before, and its term.
  subroutine add_term(coefficient, factor, scale, product, newer, older, total)
    !> Of the term
    real(wp), intent(in) :: coefficient
    !> 2, but 1 for the first
    real(wp), intent(in) :: factor
    !> 2/λ
    real(wp), intent(in) :: scale
    !> A times the last polynomial, that itself and the one before
    real(wp), intent(in), contiguous :: product(:), newer(:)
    real(wp), intent(inout), contiguous :: older(:)
    !> The series
    real(wp), intent(inout), contiguous :: total(:)
    integer :: k

    !$omp parallel do if (size(total) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(total)
      older(k) = factor*(newer(k) + scale*product(k)) - older(k)
      total(k) = total(k) + coefficient*older(k)
    end do
    !$omp end parallel do
  end subroutine add_term

  !> Coefficients of φ(λ Δt (x - 1)/2), by a discrete cosine transform.
  subroutine find_coefficients(this, step, spectral_radius)
    class(exponential_t), intent(inout) :: this
    real(wp), intent(in) :: step
    real(wp), intent(in) :: spectral_radius
    real(wp), allocatable :: x(:), value(:), newer(:), older(:), oldest(:)
    integer :: terms, nodes, k

    if (all(abs([step, spectral_radius] - this%made_for) <= 1.0e-11_wp*this%made_for)) return
    this%made_for = [step, spectral_radius]
    if (allocated(this%coefficient)) deallocate (this%coefficient, this%left)
    terms = ceiling(1.1_wp*exponential_terms(step*spectral_radius, epsilon(step))) + 10
    nodes = terms + terms/4 + 8
    x = cos([((k - 0.5_wp)*pi/nodes, k=1, nodes)])
    value = phi(0.5_wp*step*spectral_radius*(x - 1))*2/nodes
    allocate (this%coefficient(0:terms), this%left(0:terms))
    allocate (newer(nodes), oldest(nodes), source=1.0_wp)
    older = x
    this%coefficient(0) = 0.5_wp*sum(value)
    do k = 1, terms
      oldest = newer
      newer = older
      older = 2*x*newer - oldest
      this%coefficient(k) = sum(value*newer)
    end do
    this%left(terms) = abs(this%coefficient(terms))
    do k = terms - 1, 0, -1
      this%left(k) = this%left(k + 1) + abs(this%coefficient(k + 1))
    end do
  end subroutine find_coefficients

  !> (exp z - 1)/z; near 0 its Taylor series.
  elemental function phi(z)
    real(wp), intent(in) :: z
    real(wp) :: phi
    integer :: k

    if (abs(z) > 0.5_wp) then
      phi = (exp(z) - 1)/z
    else
      phi = 1
      do k = 14, 2, -1
        phi = 1 + phi*z/k
      end do
    end if
  end function phi

  !> The series' last polynomial times what is left of the coefficients
  subroutine add_step_error(this, step, total)
    class(exponential_t), intent(in) :: this
    real(wp), intent(in) :: step
    real(wp), intent(inout) :: total(:)
    integer :: k

    associate (unused => step)
    end associate
    !$omp parallel do if (size(total) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(total)
      total(k) = total(k) + this%error_factor*this%polynomial(k, this%last)
    end do
    !$omp end parallel do
  end subroutine add_step_error

end module calor_exponential
