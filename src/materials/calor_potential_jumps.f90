!> What rows across an interface lack where the conductivities on both sides follow the temperature
!> by different laws.
!>
!> In each material rows act on its own Kirchhoff potential θ (see calor_heat_law). At an interface
!> of materials A and B the flux κ₀ ∂θ/∂n is continuous as the rows take it to be, but where the
!> temperature is T the potential jumps by J(T) = θ_B(T) - θ_A(T). A row of A that reaches into B
!> holds for θ_B less the jump where the neighbour's foot on the interface is. To first order in the
!> distances along the interface, Σ_B a_ij J_j is S J(T) + N ∂J/∂t with S = Σ_B a_ij, T being the
!> temperature of a place t̄ on the interface, the mean of the neighbours' feet with the weights
!> |a_ij|, N = Σ_B a_ij (t_j - t̄), and ∂J/∂t = (f_B/f_A - 1) ∂θ_A/∂t.
!>
!> The flux κ₀ ∂θ/∂n that passes between particle and interface, d apart, and between interface and
!> the mean of the neighbours beyond, e away, is the same: with W = d κ₀B/(d κ₀B + e κ₀A),
!>
!>     (1 - W) θ_A(T) + W θ_B(T) = (1 - W) (θ_i + t̄ ∂θ_A/∂t) + W Σ_B |a_ij| θ_j/Σ_B |a_ij|,
!>
!> whose left side grows with T: one solution. ∂θ_A/∂t is by least squares from neighbours in A. All
!> of this is exact where θ is linear in each material, whatever the laws, and two particles on
!> either side exchange what the harmonic mean of κ(T) lets pass. Where θ is curved, what is
!> missed is of the order of what the jump of second derivatives contributes to a row: rows at the
!> interface are of order 0 and the temperature is of first order.
module calor_potential_jumps
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_constants, only: worth_threads
  use calor_heat_law, only: heat_law_t
  use calor_kinds, only: wp
  use calor_sparse_operator, only: sparse_operator_t
  implicit none (type, external)
  private

  public :: potential_jumps_t, contact_t

  !> Newton steps to the temperature of an interface; from a mean of temperatures it takes some four
  integer, parameter :: most_steps = 40
  !> A gradient is not to be had from places whose second moments have a determinant below this part
  !> of the square of their trace
  real(wp), parameter :: flattest = 1.0e-6_wp
  !> Temperatures of a range that are looked at for the largest derivatives
  integer, parameter :: temperatures = 17

  !> An interface as a row sees it
  type :: contact_t
    !> Its materials, of the row's particle and beyond
    integer :: own = 0, other = 0
    !> Distance of the particle from it, m, and normal towards the other side
    real(wp) :: depth = 0.0_wp, normal(2) = 0.0_wp
    !> κ₀ of both there, W/(m K)
    real(wp) :: conductivity(2) = 1.0_wp
  end type contact_t

  !> Jumps of the rows of an operator
  type :: potential_jumps_t
    !> Where the result of each row is to go, and its materials
    integer, allocatable, private :: place(:), own(:), other(:)
    !> S, W and N of each
    real(wp), allocatable, private :: strength(:), share(:), rest(:)
    !> Where its particles begin in the arrays below, one more at the end
    integer, allocatable, private :: first(:)
    integer, allocatable, private :: index(:)
    !> Weights of their potentials in what the temperature follows from, and in ∂θ_A/∂t
    real(wp), allocatable, private :: mean(:), along(:)
    !> The laws of conductivities, with the temperature for heat content
    type(heat_law_t), allocatable, private :: law(:)
    !> (f_B - f_A) dT/d(right side), and f_B/f_A - 1, of the last `linearise`
    real(wp), allocatable, private :: bend(:), tilt(:)
  contains
    !> Take up the laws
    procedure :: prepare
    !> Take up a row that reaches across
    procedure :: add_row
    !> Whether there is any such row
    procedure :: is_empty
    !> Correct what rows made of potentials
    procedure :: correct
    !> Take the derivatives at a state for those of `correct_product`, or the largest of a range
    procedure :: linearise
    procedure :: assume_largest
    !> Correct what rows made of changes of potentials
    procedure :: correct_product
    !> Correct the weights of rows
    procedure :: correct_weights
    !> Hand out what a row adds to weights
    procedure :: rows
    procedure :: added_weights
    !> The largest sum of magnitudes by which the weights of a row are corrected
    procedure :: largest_sum
    procedure, private :: find_contact
    procedure, private :: reach
  end type potential_jumps_t

contains

  subroutine prepare(this, law, lowest, highest)
    class(potential_jumps_t), intent(out) :: this
    !> The law of each material
    type(heat_law_t), intent(in) :: law(:)
    !> Range of given temperatures
    real(wp), intent(in) :: lowest, highest
    type(heat_law_t) :: conducting
    integer :: k

    allocate (this%law(size(law)))
    do k = 1, size(law)
      conducting = heat_law_t(conducts=law(k)%conducts, conductivity=law(k)%conductivity, &
                              x=law(k)%x, y=law(k)%y, reference=law(k)%reference)
      call conducting%prepare(lowest, highest)
      this%law(k) = conducting
    end do
    allocate (this%place(0), this%own(0), this%other(0), this%index(0))
    allocate (this%strength(0), this%share(0), this%rest(0), this%mean(0), this%along(0))
    allocate (this%bend(0), this%tilt(0))
    this%first = [1]
  end subroutine prepare

  subroutine add_row(this, operator, row, place, contact, material, x, y)
    class(potential_jumps_t), intent(inout) :: this
    !> The operator and the row
    type(sparse_operator_t), intent(in) :: operator
    integer, intent(in) :: row
    !> Where its result is to go
    integer, intent(in) :: place
    !> The interface
    type(contact_t), intent(in) :: contact
    !> The material of each particle, and coordinates, m
    integer, intent(in) :: material(:)
    real(wp), intent(in) :: x(:), y(:)
    real(wp), allocatable :: across(:), along(:), size_of(:), gradient(:), mean(:)
    logical, allocatable :: beyond(:)
    real(wp) :: strength, total, share, depth, distance, offset, rest

    associate (i => operator%target(row), from => operator%first(row), &
               to => operator%first(row + 1) - 1)
      associate (j => operator%index(from:to), weight => operator%weight(from:to), &
                 n => contact%normal)
        beyond = material(j) == contact%other
        size_of = merge(abs(weight), 0.0_wp, beyond)
        total = sum(size_of)
        if (.not. total > 0) return
        size_of = size_of/total
        strength = sum(weight, beyond)
        depth = max(0.0_wp, contact%depth)
        across = (x(j) - x(i))*n(1) + (y(j) - y(i))*n(2)
        along = -(x(j) - x(i))*n(2) + (y(j) - y(i))*n(1)
        distance = sum(size_of*max(0.0_wp, across - depth))
        offset = sum(size_of*along)
        rest = sum(weight*along, beyond) - strength*offset
        share = 0.5_wp
        associate (here => distance*contact%conductivity(1), there => depth*contact%conductivity(2))
          if (here + there > 0) share = there/(here + there)
        end associate
        gradient = slope_weights(x(j) - x(i), y(j) - y(i), material(j) == contact%own, &
                                 [-n(2), n(1)])
        mean = share*size_of + (1 - share)*offset*gradient
        this%place = [this%place, place]
        this%own = [this%own, contact%own]
        this%other = [this%other, contact%other]
        this%strength = [this%strength, strength]
        this%share = [this%share, share]
        this%rest = [this%rest, rest]
        this%index = [this%index, i, j]
        this%mean = [this%mean, 1 - sum(mean), mean]
        this%along = [this%along, -sum(gradient), gradient]
      end associate
    end associate
    this%first = [this%first, size(this%index) + 1]
    this%bend = [this%bend, 0.0_wp]
    this%tilt = [this%tilt, 0.0_wp]
  end subroutine add_row

  !> The weights of differences from a particle in a derivative there, exact for linear functions; 0
  !> where the places of neighbours do not tell it
  pure function slope_weights(dx, dy, chosen, direction) result(weight)
    real(wp), intent(in) :: dx(:), dy(:)
    logical, intent(in) :: chosen(:)
    real(wp), intent(in) :: direction(2)
    real(wp) :: weight(size(dx))
    real(wp) :: xx, xy, yy, determinant

    weight = 0
    where (chosen .and. dx**2 + dy**2 > 0) weight = 1/(dx**2 + dy**2)
    xx = sum(weight*dx**2)
    xy = sum(weight*dx*dy)
    yy = sum(weight*dy**2)
    determinant = xx*yy - xy**2
    if (.not. determinant > flattest*(xx + yy)**2) then
      weight = 0
      return
    end if
    weight = weight*(dx*(yy*direction(1) - xy*direction(2)) + &
                     dy*(xx*direction(2) - xy*direction(1)))/determinant
  end function slope_weights

  pure function is_empty(this) result(answer)
    class(potential_jumps_t), intent(in) :: this
    logical :: answer

    answer = size(this%place) == 0
  end function is_empty

  subroutine correct(this, temperature, potential, rate)
    class(potential_jumps_t), intent(inout) :: this
    !> Temperatures and potentials of all particles
    real(wp), intent(in) :: temperature(:), potential(:)
    !> What the rows made of these
    real(wp), intent(inout) :: rate(:)
    real(wp) :: jump(size(this%place))
    integer :: k

    call this%reach(temperature)
    !$omp parallel do if (size(jump) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(jump)
      block
        real(wp) :: contact, slope, own, other
        call this%find_contact(k, temperature, potential, contact, own, other)
        associate (from => this%first(k), to => this%first(k + 1) - 1)
          slope = dot_product(this%along(from:to), potential(this%index(from:to)))
        end associate
        jump(k) = this%strength(k)*(this%law(this%other(k))%potential(contact) - &
                                    this%law(this%own(k))%potential(contact)) + &
                  this%rest(k)*(other/own - 1)*slope
      end block
    end do
    !$omp end parallel do
    do k = 1, size(jump)
      rate(this%place(k)) = rate(this%place(k)) - jump(k)
    end do
  end subroutine correct

  !> The temperature of an interface, and f there on both sides
  pure subroutine find_contact(this, k, temperature, potential, contact, own, other)
    class(potential_jumps_t), intent(in) :: this
    integer, intent(in) :: k
    real(wp), intent(in) :: temperature(:), potential(:)
    real(wp), intent(out) :: contact, own, other
    real(wp) :: wanted, step
    integer :: n

    associate (from => this%first(k), to => this%first(k + 1) - 1, share => this%share(k), &
               here => this%law(this%own(k)), there => this%law(this%other(k)))
      wanted = dot_product(this%mean(from:to), potential(this%index(from:to)))
      contact = dot_product(this%mean(from:to), temperature(this%index(from:to)))
      do n = 1, most_steps
        own = here%conductivity_factor(contact)
        other = there%conductivity_factor(contact)
        if (.not. (ieee_is_finite(wanted) .and. ieee_is_finite(contact))) exit
        step = ((1 - share)*here%potential(contact) + share*there%potential(contact) - wanted)/ &
               ((1 - share)*own + share*other)
        contact = contact - step
        if (abs(step) <= 4*epsilon(step)*abs(contact)) exit
      end do
    end associate
  end subroutine find_contact

  !> Make the tables reach temperatures.
  subroutine reach(this, temperature)
    class(potential_jumps_t), intent(inout) :: this
    real(wp), intent(in) :: temperature(:)
    real(wp) :: lowest, highest
    integer :: k

    lowest = huge(1.0_wp)
    highest = -huge(1.0_wp)
    do k = 1, size(this%index)
      associate (t => temperature(this%index(k)))
        if (.not. ieee_is_finite(t)) cycle
        lowest = min(lowest, t)
        highest = max(highest, t)
      end associate
    end do
    if (.not. lowest <= highest) return
    do k = 1, size(this%law)
      call this%law(k)%reach(lowest, highest)
    end do
  end subroutine reach

  subroutine linearise(this, temperature, potential)
    class(potential_jumps_t), intent(inout) :: this
    !> Temperatures and potentials of all particles
    real(wp), intent(in) :: temperature(:), potential(:)
    real(wp) :: contact, own, other
    integer :: k

    call this%reach(temperature)
    do k = 1, size(this%place)
      call this%find_contact(k, temperature, potential, contact, own, other)
      this%bend(k) = (other - own)/((1 - this%share(k))*own + this%share(k)*other)
      this%tilt(k) = other/own - 1
    end do
  end subroutine linearise

  !> Those with which a row decays fastest: both grow with f_B/f_A.
  subroutine assume_largest(this, lowest, highest)
    class(potential_jumps_t), intent(inout) :: this
    !> Range of temperatures
    real(wp), intent(in) :: lowest, highest
    real(wp) :: factor(size(this%law))
    integer :: k, step

    this%bend = -huge(1.0_wp)
    this%tilt = -huge(1.0_wp)
    do step = 0, temperatures - 1
      factor = [(this%law(k)%conductivity_factor(lowest + (highest - lowest)*step/ &
                                                 (temperatures - 1)), k=1, size(factor))]
      do k = 1, size(this%place)
        associate (own => factor(this%own(k)), other => factor(this%other(k)))
          this%bend(k) = max(this%bend(k), (other - own)/((1 - this%share(k))*own + &
                                                          this%share(k)*other))
          this%tilt(k) = max(this%tilt(k), other/own - 1)
        end associate
      end do
    end do
  end subroutine assume_largest

  pure subroutine correct_product(this, change, product)
    class(potential_jumps_t), intent(in) :: this
    !> Changes of the potentials of all particles
    real(wp), intent(in) :: change(:)
    !> What the rows made of these
    real(wp), intent(inout) :: product(:)
    integer :: k, n

    do k = 1, size(this%place)
      do n = this%first(k), this%first(k + 1) - 1
        product(this%place(k)) = product(this%place(k)) + weight_of(this, k, &
                                                                    n)*change(this%index(n))
      end do
    end do
  end subroutine correct_product

  !> What entry n of a row adds to a weight
  pure function weight_of(this, k, n) result(weight)
    class(potential_jumps_t), intent(in) :: this
    integer, intent(in) :: k, n
    real(wp) :: weight

    weight = -(this%strength(k)*this%bend(k)*this%mean(n) + &
               this%rest(k)*this%tilt(k)*this%along(n))
  end function weight_of

  !> Only rows whose results go to the places of their particles can be corrected like this.
  pure subroutine correct_weights(this, growth, first, index, value)
    class(potential_jumps_t), intent(in) :: this
    !> Derivatives of potentials with respect to states
    real(wp), intent(in) :: growth(:)
    !> Rows, a row for each particle, with its particle first and its neighbours after that
    integer, intent(in) :: first(:), index(:)
    real(wp), intent(inout) :: value(:)
    integer :: k, n

    do k = 1, size(this%place)
      associate (row => this%place(k))
        ! A held particle has an empty row.
        if (first(row + 1) == first(row)) cycle
        do n = this%first(k), this%first(k + 1) - 1
          associate (at => first(row) + n - this%first(k))
            value(at) = value(at) + weight_of(this, k, n)*growth(index(at))
          end associate
        end do
      end associate
    end do
  end subroutine correct_weights

  pure function rows(this) result(number)
    class(potential_jumps_t), intent(in) :: this
    integer :: number

    number = size(this%place)
  end function rows

  !> Several rows may belong to one particle, one for each of its interfaces.
  pure subroutine added_weights(this, row, place, index, weight)
    class(potential_jumps_t), intent(in) :: this
    integer, intent(in) :: row
    !> Where its result is to go
    integer, intent(out) :: place
    !> Particles, and what is added to their weights
    integer, allocatable, intent(out) :: index(:)
    real(wp), allocatable, intent(out) :: weight(:)
    integer :: n

    place = this%place(row)
    index = this%index(this%first(row):this%first(row + 1) - 1)
    weight = [(weight_of(this, row, n), n=this%first(row), this%first(row + 1) - 1)]
  end subroutine added_weights

  pure function largest_sum(this) result(largest)
    class(potential_jumps_t), intent(in) :: this
    real(wp) :: largest
    real(wp) :: total
    integer :: k, n

    largest = 0
    total = 0
    do k = 1, size(this%place)
      ! The interfaces of a row stand together.
      if (k > 1) then
        if (this%place(k) /= this%place(k - 1)) total = 0
      end if
      do n = this%first(k), this%first(k + 1) - 1
        total = total + abs(weight_of(this, k, n))
      end do
      largest = max(largest, total)
    end do
  end function largest_sum

end module calor_potential_jumps
