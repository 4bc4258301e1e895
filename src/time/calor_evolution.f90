!> A system of ordinary differential equations u_t = F(t, u), some of whose unknowns are prescribed.
!>
!> It is all that an integrator knows of what it integrates. Several processes may share one system,
!> each holding some unknowns: what has to be known of all of them goes by procedures of this type.
module calor_evolution
  use calor_arpack, only: dnaupd, dneupd
  use calor_constants, only: worth_threads
  use calor_error, only: error_t
  use calor_kinds, only: wp, i8
  use calor_random, only: random_uniform
  use calor_sums, only: dot
  implicit none (type, external)
  private

  public :: evolution_t
  public :: combine_in_parts, recur_with_rate_in_parts, recur_with_jacobian_in_parts

  type, abstract :: evolution_t
  contains
    !> Number of entries of u, prescribed ones included
    procedure(unknowns_interface), deferred :: unknowns
    !> F(t, u); 0 for prescribed entries
    procedure(rate_interface), deferred :: rate
    !> (∂F/∂u) v; v is 0 at prescribed entries
    procedure(jacobian_interface), deferred :: jacobian_product
    !> A rate added to multiples of other vectors: a stage of an integrator. Or a rate, or a product
    !> with the Jacobian, as the next term of a recurrence of three, as polynomials have. An
    !> evolution that can do it in one sweep overrides them
    procedure :: combine_with_rate => combine_in_parts
    procedure :: recur_with_rate => recur_with_rate_in_parts
    procedure :: recur_with_jacobian => recur_with_jacobian_in_parts
    !> Take ∂F/∂u at a state for it from now on; without this it is on the safe side
    procedure :: linearise
    !> Put the prescribed values of a time into u
    procedure(impose_interface), deferred :: impose
    !> Put 0 into the prescribed entries of a vector
    procedure(clear_interface), deferred :: clear_prescribed
    !> Judge a new state; an error ends the integration
    procedure(inspect_interface), deferred :: inspect
    !> Hand out the Jacobian by rows
    procedure :: jacobian_rows
    !> Whether F(t, u) = A u + b(t), A being constant
    procedure :: is_linear
    !> Whether F or a prescribed value depends on the time
    procedure :: depends_on_time
    !> Whether several processes share the unknowns
    procedure :: is_shared
    !> How many unknowns there are in all
    procedure :: all_unknowns
    !> Σ a_i b_i, √(Σ v_i²/n), and random numbers, over all unknowns
    procedure :: dot => dot_of_all
    procedure :: root_mean_square => root_mean_square_of_all
    procedure :: scatter
    !> One step of the Arnoldi iteration by reverse communication, and what comes of it
    procedure :: iterate_arnoldi
    procedure :: finish_arnoldi
  end type evolution_t

  abstract interface
    pure function unknowns_interface(this) result(number)
      import :: evolution_t
      implicit none (type, external)
      class(evolution_t), intent(in) :: this
      integer :: number
    end function unknowns_interface

    subroutine rate_interface(this, time, u, du)
      import :: evolution_t, wp
      implicit none (type, external)
      class(evolution_t), intent(inout) :: this
      !> Time, s
      real(wp), intent(in) :: time
      !> State
      real(wp), intent(in), contiguous :: u(:)
      !> Its rate of change, 1/s
      real(wp), intent(out), contiguous :: du(:)
    end subroutine rate_interface

    subroutine jacobian_interface(this, v, product)
      import :: evolution_t, wp
      implicit none (type, external)
      class(evolution_t), intent(inout) :: this
      !> A change of the state
      real(wp), intent(in), contiguous :: v(:)
      !> The change of the rate that it causes
      real(wp), intent(out), contiguous :: product(:)
    end subroutine jacobian_interface

    subroutine impose_interface(this, time, u)
      import :: evolution_t, wp
      implicit none (type, external)
      class(evolution_t), intent(inout) :: this
      !> Time, s
      real(wp), intent(in) :: time
      !> State
      real(wp), intent(inout), contiguous :: u(:)
    end subroutine impose_interface

    subroutine clear_interface(this, v)
      import :: evolution_t, wp
      implicit none (type, external)
      class(evolution_t), intent(in) :: this
      !> Any vector of the size of u
      real(wp), intent(inout), contiguous :: v(:)
    end subroutine clear_interface

    subroutine inspect_interface(this, time, u, error)
      import :: evolution_t, wp, error_t
      implicit none (type, external)
      class(evolution_t), intent(inout) :: this
      !> Time, s
      real(wp), intent(in) :: time
      !> State
      real(wp), intent(in), contiguous :: u(:)
      !> What is wrong with it
      type(error_t), allocatable, intent(out) :: error
    end subroutine inspect_interface
  end interface

contains

  !> older ← c₁ newer + c₂ older + c₃ start + c₄ rate_start + c₅ F(time, newer)
  subroutine combine_in_parts(this, time, c, newer, start, rate_start, older, work)
    class(evolution_t), intent(inout) :: this
    !> Time, s
    real(wp), intent(in) :: time
    !> The five factors
    real(wp), intent(in) :: c(5)
    !> Vectors of the size of u; none may share memory with another
    real(wp), intent(in), contiguous :: newer(:), start(:), rate_start(:)
    real(wp), intent(inout), contiguous :: older(:)
    !> Workspace, made where it is needed
    real(wp), allocatable, intent(inout) :: work(:)
    integer :: k

    call make_work(size(newer), work)
    call this%rate(time, newer, work)
    !$omp parallel do if (size(older) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(older)
      older(k) = c(1)*newer(k) + c(2)*older(k) + c(3)*start(k) + c(4)*rate_start(k) + c(5)*work(k)
    end do
    !$omp end parallel do
  end subroutine combine_in_parts

  !> older ← c₁ newer + c₂ (newer - older) + c₃ F(time, newer). Differences, so that what is steady
  !> stays so to the last bit where c₁ = 1.
  subroutine recur_with_rate_in_parts(this, time, c, newer, older, work)
    class(evolution_t), intent(inout) :: this
    !> Time, s
    real(wp), intent(in) :: time
    !> The three factors
    real(wp), intent(in) :: c(3)
    !> Vectors of the size of u that share no memory
    real(wp), intent(in), contiguous :: newer(:)
    real(wp), intent(inout), contiguous :: older(:)
    !> Workspace, made where it is needed
    real(wp), allocatable, intent(inout) :: work(:)

    call make_work(size(newer), work)
    call this%rate(time, newer, work)
    call add_up_terms(c, newer, work, older)
  end subroutine recur_with_rate_in_parts

  !> older ← c₁ newer + c₂ (newer - older) + c₃ (∂F/∂u) newer
  subroutine recur_with_jacobian_in_parts(this, c, newer, older, work)
    class(evolution_t), intent(inout) :: this
    !> The three factors
    real(wp), intent(in) :: c(3)
    !> Changes of the state that share no memory
    real(wp), intent(in), contiguous :: newer(:)
    real(wp), intent(inout), contiguous :: older(:)
    !> Workspace, made where it is needed
    real(wp), allocatable, intent(inout) :: work(:)

    call make_work(size(newer), work)
    call this%jacobian_product(newer, work)
    call add_up_terms(c, newer, work, older)
  end subroutine recur_with_jacobian_in_parts

  subroutine make_work(unknowns, work)
    integer, intent(in) :: unknowns
    real(wp), allocatable, intent(inout) :: work(:)

    if (.not. allocated(work)) allocate (work(unknowns), source=0.0_wp)
  end subroutine make_work

  subroutine add_up_terms(c, newer, product, older)
    real(wp), intent(in) :: c(3)
    real(wp), intent(in), contiguous :: newer(:), product(:)
    real(wp), intent(inout), contiguous :: older(:)
    integer :: k

    !$omp parallel do if (size(older) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(older)
      older(k) = c(1)*newer(k) + c(2)*(newer(k) - older(k)) + c(3)*product(k)
    end do
    !$omp end parallel do
  end subroutine add_up_terms

  !> Nothing to do where ∂F/∂u is the same at all states.
  subroutine linearise(this, time, u)
    class(evolution_t), intent(inout) :: this
    !> Time, s
    real(wp), intent(in) :: time
    !> State
    real(wp), intent(in), contiguous :: u(:)

    associate (unused => this, also => time, and => u)
    end associate
  end subroutine linearise

  subroutine jacobian_rows(this, first, index, value, known)
    class(evolution_t), intent(in) :: this
    !> Where each row begins in `index` and `value`; rows of prescribed entries are empty
    integer, allocatable, intent(out) :: first(:)
    !> Columns, from 1, in any order, and entries, 1/s
    integer, allocatable, intent(out) :: index(:)
    real(wp), allocatable, intent(out) :: value(:)
    !> Whether the evolution has its Jacobian in this form
    logical, intent(out) :: known

    known = .false.
    allocate (first(this%unknowns() + 1), source=1)
    allocate (index(0), value(0))
  end subroutine jacobian_rows

  pure function is_linear(this) result(answer)
    class(evolution_t), intent(in) :: this
    logical :: answer

    ! Nothing is promised without being known.
    associate (unused => this)
    end associate
    answer = .false.
  end function is_linear

  pure function depends_on_time(this) result(answer)
    class(evolution_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .true.
  end function depends_on_time

  pure function is_shared(this) result(answer)
    class(evolution_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .false.
  end function is_shared

  function all_unknowns(this) result(number)
    class(evolution_t), intent(in) :: this
    integer(i8) :: number

    number = this%unknowns()
  end function all_unknowns

  function dot_of_all(this, a, b) result(total)
    class(evolution_t), intent(in) :: this
    !> Vectors of the size of u
    real(wp), intent(in) :: a(:), b(:)
    real(wp) :: total

    associate (unused => this)
    end associate
    total = dot(a, b)
  end function dot_of_all

  !> 0 where there are no unknowns.
  function root_mean_square_of_all(this, v) result(value)
    class(evolution_t), intent(in) :: this
    !> A vector of the size of u
    real(wp), intent(in) :: v(:)
    real(wp) :: value

    value = sqrt(this%dot(v, v)/max(1_i8, this%all_unknowns()))
  end function root_mean_square_of_all

  !> Evenly distributed over [-1/2, 1/2), and 0 at prescribed entries. Each depends on the seed and
  !> on the unknown's number among all.
  subroutine scatter(this, seed, v)
    class(evolution_t), intent(in) :: this
    !> Vectors of different seeds have nothing to do with each other
    integer, intent(in) :: seed
    !> A vector of the size of u
    real(wp), intent(out), contiguous :: v(:)
    integer :: k

    do k = 1, size(v)
      v(k) = random_uniform(seed, int(k, i8)) - 0.5_wp
    end do
    call this%clear_prescribed(v)
  end subroutine scatter

  !> ARPACK's dnaupd for eigenvalues of largest magnitude; it explains the arguments.
  subroutine iterate_arnoldi(this, ido, wanted, tolerance, residual, basis, iparam, ipntr, workd, &
                             workl, info)
    class(evolution_t), intent(in) :: this
    integer, intent(inout) :: ido, wanted, iparam(11), ipntr(14), info
    real(wp), intent(inout) :: tolerance
    real(wp), intent(inout), contiguous :: residual(:), basis(:, :), workd(:), workl(:)

    associate (unused => this)
    end associate
    call dnaupd(ido, 'I', size(residual), 'LM', wanted, tolerance, residual, size(basis, 2), &
                basis, size(basis, 1), iparam, ipntr, workd, workl, size(workl), info)
  end subroutine iterate_arnoldi

  !> ARPACK's dneupd: eigenvalues dr + i di and their vectors.
  subroutine finish_arnoldi(this, dr, di, vectors, wanted, tolerance, residual, basis, iparam, &
                            ipntr, workd, workl, info)
    class(evolution_t), intent(in) :: this
    real(wp), intent(inout), contiguous :: dr(:), di(:), vectors(:, :)
    integer, intent(inout) :: wanted, iparam(11), ipntr(14), info
    real(wp), intent(inout) :: tolerance
    real(wp), intent(inout), contiguous :: residual(:), basis(:, :), workd(:), workl(:)
    logical :: chosen(size(basis, 2))
    real(wp) :: workev(3*size(basis, 2))

    associate (unused => this)
    end associate
    call dneupd(.true., 'A', chosen, dr, di, vectors, size(vectors, 1), 0.0_wp, 0.0_wp, workev, &
                'I', size(residual), 'LM', wanted, tolerance, residual, size(basis, 2), basis, &
                size(basis, 1), iparam, ipntr, workd, workl, size(workl), info)
  end subroutine finish_arnoldi

end module calor_evolution
