!> Where heat comes from and where it stays: stored energy, heat through each wall, sources.
!>
!> Every particle, a held one too, has a row ρc ∂T/∂t = κ Σ a_ij (T_j - T_i) + Σ b q + s. At a held
!> particle it tells the flux q that holding it takes. Summed with weights w for the particles'
!> areas, d/dt Σ w ρc T = Σ w b q + Σ w s + κ Σ w (a T); the last term is what is missing. With
!> the areas of particles it is of the order of the scheme; with weights for which Σ w_i a_ij = 0,
!> the left null vector of the operator of a body insulated all around, there is none: then the
!> budget closes but for rounding, however coarse the cloud.
module calor_heat_budget
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_cloud, only: cloud_t
  use calor_conduction, only: conduction_t
  use calor_kinds, only: wp
  use calor_medium, only: medium_t
  use calor_saved_state, only: saved_state_t
  use calor_sparse_operator, only: sparse_operator_t
  use calor_text, only: text_t, append, to_text
  use calor_umfpack, only: factorisation_t
  implicit none (type, external)
  private

  public :: heat_budget_t, budget_entry_t

  !> The heat budget of one state
  type :: budget_entry_t
    !> Time, s
    real(wp) :: time = 0.0_wp
    !> Σ ρ c T, J per metre depth, and its rate, W per metre depth; latent heat included
    real(wp) :: stored = 0.0_wp, stored_rate = 0.0_wp
    !> Heat into the body by each account, W per metre depth
    real(wp), allocatable :: power(:)
    !> What the rate exceeds the sum of all powers by, as a part of all that flows: in and out, or
    !> between the particles
    real(wp) :: imbalance = 0.0_wp
  end type budget_entry_t

  !> How the budget of a scene is made up
  type :: heat_budget_t
    !> Whether walls have normals, so that what passes them is known
    logical :: available = .false.
    !> Whether the weights are those that make it close
    logical :: conservative = .false.
    !> Names of accounts: walls first, then effects within the body
    type(text_t), allocatable :: account(:)
    !> The particles' weights, m²; not allocated: their areas
    real(wp), allocatable, private :: weight(:)
    !> The account of each of the cloud's boundaries; 0 for one that consists of others
    integer, allocatable, private :: wall_account(:)
  contains
    !> Prepare the budget of a scene
    procedure :: prepare
    !> Take the particles' areas for weights, as they are now
    procedure :: weigh_by_area
    !> Find the weights that make it close
    procedure :: close_exactly
    !> Take such weights, found elsewhere
    procedure :: take_weights
    !> The budget of a state
    procedure :: evaluate
    !> The same in words
    procedure :: words
    !> Lay budgets aside, and take them up again
    procedure :: save_entries
    procedure :: restore_entries
  end type heat_budget_t

contains

  !> The accounts, and areas for weights.
  subroutine prepare(this, cloud, conduction)
    class(heat_budget_t), intent(out) :: this
    !> The cloud
    type(cloud_t), intent(in) :: cloud
    !> The heat equation on it
    class(conduction_t), intent(in) :: conduction
    character(len=:), allocatable :: name
    real(wp), allocatable :: there(:)
    integer :: k

    this%available = allocated(conduction%medium%contacts%normal)
    there = [(real(count(conduction%medium%contacts%side == k - 1), wp), k=1, size(cloud%boundary))]
    call conduction%add_up(there)
    do k = 1, size(cloud%boundary)
      if (.not. there(k) > 0) cycle
      call append(this%account, cloud%boundary(k)%value)
    end do
    this%wall_account = [(place_of(this%account, cloud%boundary(k)%value), k=1, &
                          size(cloud%boundary))]
    if (.not. allocated(conduction%effects)) return
    do k = 1, size(conduction%effects)
      name = conduction%effects(k)%effect%account()
      if (name == '' .or. place_of(this%account, name) > 0) cycle
      call append(this%account, name)
    end do
  end subroutine prepare

  pure subroutine weigh_by_area(this)
    class(heat_budget_t), intent(inout) :: this

    if (allocated(this%weight)) deallocate (this%weight)
    this%conservative = .false.
  end subroutine weigh_by_area

  pure subroutine take_weights(this, weight)
    class(heat_budget_t), intent(inout) :: this
    !> One for each particle, m²: with those of the whole body Σ w_i a_ij = 0
    real(wp), intent(in) :: weight(:)

    this%weight = weight
    this%conservative = .true.
  end subroutine take_weights

  !> The place of a name in a list, 0 where it is not in it
  pure function place_of(list, name) result(place)
    type(text_t), intent(in) :: list(:)
    character(len=*), intent(in) :: name
    integer :: place

    do place = size(list), 1, -1
      if (list(place)%value == name) return
    end do
  end function place_of

  !> Take for weights the left null vector of the operator with all walls insulated, scaled to the
  !> area of the body. Where the matrix cannot be factorised, areas stay the weights.
  !>
  !> The matrix is bordered: [L 1; aᵀ 0]ᵀ [w; μ] = [0; Σ a] has Lᵀ w = 0, for L 1 = 0 makes μ = 0.
  subroutine close_exactly(this, conduction)
    class(heat_budget_t), intent(inout) :: this
    !> The heat equation
    type(conduction_t), intent(in) :: conduction
    type(factorisation_t) :: factors
    integer, allocatable :: first(:), index(:)
    real(wp), allocatable :: value(:), right_side(:), solution(:)
    real(wp) :: area, scale
    integer, allocatable :: owner(:)
    integer :: n, k, row, used
    logical :: done

    if (.not. this%available) return
    n = size(conduction%medium%area)
    area = sum(conduction%medium%area)
    scale = area/n
    associate (inner => conduction%laplacian, held => conduction%held_rows)
      ! Where each particle's row is: negative in the rows of held ones
      allocate (owner(n), source=0)
      owner(inner%target) = [(k, k=1, inner%rows())]
      owner(held%target) = [(-k, k=1, held%rows())]
      if (any(owner == 0)) return
      allocate (first(n + 2))
      allocate (index(size(inner%index) + size(held%index) + 3*n), mold=0)
      allocate (value(size(index)))
    end associate
    used = 0
    do row = 1, n
      first(row) = used + 1
      if (owner(row) > 0) then
        call add_row(conduction%laplacian, owner(row), conduction%medium%local_capacity)
      else
        call add_row(conduction%held_rows, -owner(row))
      end if
      used = used + 1
      index(used) = n + 1
      value(used) = 1
    end do
    first(n + 1) = used + 1
    index(used + 1:used + n) = [(k, k=1, n)]
    value(used + 1:used + n) = conduction%medium%area/scale
    first(n + 2) = used + n + 1
    call factors%factorise(first, index(:used + n), value(:used + n), done)
    if (.not. done) return
    allocate (right_side(n + 1), solution(n + 1))
    right_side = 0
    right_side(n + 1) = area
    call factors%solve(right_side, solution, .true., done)
    call factors%release()
    if (.not. done) return
    call this%take_weights(solution(:n))

  contains

    !> A row times the capacity of its particle, where it is one for a rate and those are different
    subroutine add_row(operator, which, capacity)
      type(sparse_operator_t), intent(in) :: operator
      integer, intent(in) :: which
      real(wp), allocatable, intent(in), optional :: capacity(:)
      real(wp) :: factor
      integer :: from, to

      factor = scale
      if (present(capacity)) then
        if (allocated(capacity)) factor = scale*capacity(operator%target(which))
      end if

      from = int(operator%first(which))
      to = int(operator%first(which + 1)) - 1
      index(used + 1:used + to - from + 1) = operator%index(from:to)
      value(used + 1:used + to - from + 1) = factor*operator%weight(from:to)
      used = used + to - from + 2
      index(used) = operator%target(which)
      value(used) = factor*operator%diagonal(which)
    end subroutine add_row

  end subroutine close_exactly

  !> The budget of a state. Where several processes share the particles, each adds up its own.
  subroutine evaluate(this, conduction, time, state, entry)
    class(heat_budget_t), intent(in) :: this
    !> The heat equation
    class(conduction_t), intent(inout) :: conduction
    !> Time, s, and state
    real(wp), intent(in) :: time
    real(wp), intent(in) :: state(:)
    !> The budget
    type(budget_entry_t), intent(out) :: entry

    if (allocated(this%weight)) then
      call add_up(this, conduction, time, state, this%weight, entry)
    else
      call add_up(this, conduction, time, state, conduction%medium%area, entry)
    end if
  end subroutine evaluate

  subroutine add_up(this, conduction, time, state, weight, entry)
    class(heat_budget_t), intent(in) :: this
    class(conduction_t), intent(inout) :: conduction
    real(wp), intent(in) :: time
    real(wp), intent(in) :: state(:)
    !> The particles' weights, m²
    real(wp), intent(in) :: weight(:)
    type(budget_entry_t), intent(out) :: entry
    real(wp), allocatable :: rate(:), power(:), flux(:), share(:), missing(:), held(:), capacity(:)
    real(wp), allocatable :: temperature(:)
    real(wp) :: conductivity
    character(len=:), allocatable :: name
    !> Stored energy, its rate, all that flows, and the powers
    real(wp), allocatable :: sums(:)
    integer :: k, account, a, b

    call conduction%own_particles(a, b)
    associate (medium => conduction%medium, contacts => conduction%medium%contacts)
      entry%time = time
      capacity = [(medium%capacity_of(k), k=1, size(state))]
      ! Rows of a body of varying material contain its conductivity.
      conductivity = medium%conductivity
      if (allocated(medium%local_capacity)) conductivity = 1
      allocate (entry%power(size(this%account)), source=0.0_wp)
      sums = [sum(capacity(a:b)*weight(a:b)*state(a:b))]
      if (.not. this%available) then
        call conduction%add_up(sums)
        entry%stored = sums(1)
        return
      end if

      allocate (rate(size(state)), power(size(state)), temperature(size(state)))
      call conduction%find_temperature(state, temperature)
      allocate (flux(size(contacts%particle)), source=0.0_wp)
      call conduction%rate(time, state, rate)
      call conduction%add_held_rates(time, rate)
      sums = [sums, sum(capacity(a:b)*weight(a:b)*rate(a:b)), &
              sum(abs(capacity(a:b)*weight(a:b)*rate(a:b)))]

      ! What effects bring: within the body their power, through walls a flux at each contact
      allocate (missing(size(temperature)), source=0.0_wp)
      if (allocated(conduction%effects)) then
        missing = conduction%power
        do k = 1, size(conduction%effects)
          associate (effect => conduction%effects(k)%effect)
            call effect%put_flux(flux)
            name = effect%account()
            account = place_of(this%account, name)
            if (account == 0) cycle
            power = 0
            call effect%add_power(medium, time, temperature, power)
            entry%power(account) = entry%power(account) + &
                                   sum(weight(a:b)*power(a:b))
          end associate
        end do
      end if
      ! What holding takes: the flux that the row of a held particle lacks
      missing = capacity*rate - missing
      allocate (held(conduction%held_rows%rows()))
      call conduction%apply_held_rows(state, held)
      allocate (share(size(temperature)), source=0.0_wp)
      do k = 1, size(contacts%particle)
        if (contacts%holding(k)) share(contacts%particle(k)) = share(contacts%particle(k)) + &
                                                            contacts%weight(k)
      end do
      do k = 1, size(held)
        associate (i => conduction%held_rows%target(k))
          missing(i) = missing(i) - conductivity*held(k)
          if (share(i) > 0) missing(i) = missing(i)/share(i)
        end associate
      end do
      do k = 1, size(contacts%particle)
        associate (i => contacts%particle(k), account => this%wall_account(contacts%side(k) + 1))
          if (i < a .or. i > b) cycle
          if (contacts%holding(k)) flux(k) = missing(i)
          if (this%conservative) then
            entry%power(account) = entry%power(account) + weight(i)*contacts%weight(k)*flux(k)
          else
            entry%power(account) = entry%power(account) + contacts%length(k)*flux(k)
          end if
        end associate
      end do
      sums = [sums, entry%power]
      call conduction%add_up(sums)
      entry%stored = sums(1)
      entry%stored_rate = sums(2)
      entry%power = sums(4:)
      entry%imbalance = entry%stored_rate - sum(entry%power)
      ! An expression may have no value beyond the last good state: its rate there is no number.
      if (.not. ieee_is_finite(entry%imbalance)) return
      associate (all => max(sums(3), sum(abs(entry%power))))
        if (all > 0) entry%imbalance = entry%imbalance/all
      end associate
    end associate
  end subroutine add_up

  !> Energy, what comes by each account, and what is missing.
  pure function words(this, entry) result(text)
    class(heat_budget_t), intent(in) :: this
    !> The budget of a state
    type(budget_entry_t), intent(in) :: entry
    character(len=:), allocatable :: text
    integer :: k

    text = 'stored '//to_text(entry%stored, digits=6)//' J/m'
    if (.not. this%available) return
    do k = 1, size(this%account)
      text = text//', '//this%account(k)%value//' '//to_text(entry%power(k), digits=6)
    end do
    text = text//' W/m; storing '//to_text(entry%stored_rate, digits=6)//' W/m; imbalance '// &
           to_text(entry%imbalance, digits=2)
  end function words

  subroutine save_entries(this, entries, state)
    class(heat_budget_t), intent(in) :: this
    !> Budgets, one a state
    type(budget_entry_t), intent(in) :: entries(:)
    type(saved_state_t), intent(inout) :: state
    real(wp), allocatable :: power(:, :)
    integer :: k

    call state%enter('budget')
    call state%put('time', entries%time)
    call state%put('stored', entries%stored)
    call state%put('stored_rate', entries%stored_rate)
    call state%put('imbalance', entries%imbalance)
    if (this%available) then
      allocate (power(size(this%account), size(entries)))
      do k = 1, size(entries)
        power(:, k) = entries(k)%power
      end do
      call state%put('power', reshape(power, [size(power)]))
    end if
    call state%leave()
  end subroutine save_entries

  !> What is missing is told by the state.
  subroutine restore_entries(this, entries, state)
    class(heat_budget_t), intent(in) :: this
    type(budget_entry_t), allocatable, intent(inout) :: entries(:)
    type(saved_state_t), intent(inout) :: state
    real(wp), allocatable :: time(:), stored(:), stored_rate(:), imbalance(:), power(:)
    integer :: k, accounts

    call state%enter('budget')
    call state%get('time', time)
    call state%get('stored', stored)
    call state%get('stored_rate', stored_rate)
    call state%get('imbalance', imbalance)
    if (this%available) call state%get('power', power)
    call state%leave()
    if (allocated(state%problem)) return
    if (allocated(entries)) deallocate (entries)
    allocate (entries(size(time)))
    entries%time = time
    entries%stored = stored
    entries%stored_rate = stored_rate
    entries%imbalance = imbalance
    if (.not. this%available) return
    accounts = size(this%account)
    do k = 1, size(time)
      entries(k)%power = power((k - 1)*accounts + 1:k*accounts)
    end do
  end subroutine restore_entries

end module calor_heat_budget
