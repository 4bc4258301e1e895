!> Heat conduction on a cloud that several ranks share.
!>
!> A rank keeps its own particles and those of others within reach, in the order of the whole. Its
!> rows are in PETSc's distributed matrix, and a product with that is all that makes its particles
!> know of the others: all else is the library's own, at the own particles. Entries of vectors at
!> other ranks' particles mean nothing; they are 0 in rates and in all that is summed up.
module calor_shared_conduction
  use calor_conduction, only: conduction_t
  use calor_error, only: error_t
  use calor_evolution, only: combine_in_parts, recur_with_rate_in_parts, &
                             recur_with_jacobian_in_parts
  use calor_kinds, only: wp, i8
  use calor_parpack, only: pdnaupd, pdneupd
  use calor_random, only: random_uniform
  use calor_ranks, only: ranks_t
  use calor_saved_state, only: saved_state_t
  use calor_sparse_operator, only: sparse_operator_t
  use calor_sums, only: dot
  use petscmat, only: tis, tmat, tvec, tvecscatter, vecgetarrayreadf90, vecrestorearrayreadf90, &
                      add_values, insert_values, mat_copy_values, mat_do_not_copy_values, &
                      mat_final_assembly, same_nonzero_pattern, &
                      petsc_comm_self, petsc_copy_values, petsc_null_is, petsc_null_scalar, &
                      petsc_null_vec, scatter_forward
  use mpi_f08, only: mpi_allreduce, mpi_double_precision, mpi_in_place, mpi_sum
  ! PETSc's procedures have no interfaces of their own.
  ! allow(C003)
  implicit none (type)
  private

  public :: shared_conduction_t

  type, extends(conduction_t) :: shared_conduction_t
    type(ranks_t) :: ranks
    !> The own particles among those here
    integer :: own_first = 1, own_last = 0
    !> Particles in all, and the number of each that is here
    integer(i8) :: particles = 0
    integer(i8), allocatable :: number(:)
    !> How many particles of other ranks a product needs: each is a number that is sent
    integer :: received = 0
    !> The rows, 1/s; prescribed and other ranks' particles have none here
    type(tmat) :: matrix
    !> What is multiplied, and the product; their arrays are those of the caller
    type(tvec) :: factor, product
    logical, private :: loaded = .false.
    !> The way of values to the particles here that are other ranks', and where they arrive
    type(tvecscatter), private :: way
    type(tvec), private :: taken
    logical, private :: completing = .false.
  contains
    !> Take the own part of a cloud
    procedure :: take_part
    !> Put the rows into the matrix
    procedure :: load_rows
    !> A distributed matrix of rows
    procedure :: make_matrix
    !> The Jacobian times a factor, plus a multiple of 1, as a matrix
    procedure :: make_jacobian
    !> What the rows of one rank need besides, all ranks take part in
    procedure :: share_parts
    !> Give back what PETSc keeps
    procedure :: unload
    procedure :: complete
    procedure :: apply_rows
    procedure :: stream_rows
    procedure :: combine_with_rate
    procedure :: recur_with_rate
    procedure :: recur_with_jacobian
    procedure :: clear_prescribed
    procedure :: inspect
    procedure :: is_shared
    procedure :: all_unknowns
    procedure :: dot => dot_of_own
    procedure :: scatter
    procedure :: iterate_arnoldi
    procedure :: finish_arnoldi
    procedure :: find_scales
    procedure :: allowed_range
    procedure :: span
    procedure :: agree
    procedure :: save => save_shared
    procedure :: own_particles
    procedure :: largest
    procedure :: add_up
    procedure :: apply_held_rows
    procedure :: join_counts
    procedure :: join_reals
    procedure :: whole_number
    procedure, private :: weigh_products
    procedure, private :: jump_matrix
  end type shared_conduction_t

contains

  subroutine take_part(this, ranks, particles, number, own_first, own_last)
    class(shared_conduction_t), intent(inout) :: this
    type(ranks_t), intent(in) :: ranks
    !> Particles in all, the numbers of those here, and which of these are the own ones
    integer(i8), intent(in) :: particles
    integer(i8), intent(in) :: number(:)
    integer, intent(in) :: own_first, own_last

    this%ranks = ranks
    this%particles = particles
    this%number = number
    this%own_first = own_first
    this%own_last = own_last
  end subroutine take_part

  !> The rows themselves are given up.
  subroutine load_rows(this)
    class(shared_conduction_t), intent(inout) :: this
    logical, allocatable :: needed(:)
    integer :: failed, own

    own = this%own_last - this%own_first + 1
    associate (rows => this%laplacian)
      allocate (needed(size(this%number)), source=.false.)
      needed(rows%index) = .true.
      needed(this%own_first:this%own_last) = .false.
      this%received = count(needed)
      call this%make_matrix(rows, this%diffusivity, this%matrix)
      deallocate (rows%index, rows%weight)
      allocate (rows%index(0), rows%weight(0))
    end associate
    call veccreatempiwitharray(this%ranks%comm%mpi_val, 1, own, int(this%particles), &
                               petsc_null_scalar, this%factor, failed)
    call veccreatempiwitharray(this%ranks%comm%mpi_val, 1, own, int(this%particles), &
                               petsc_null_scalar, this%product, failed)
    this%loaded = .true.
  end subroutine load_rows

  !> Where there is no row only the diagonal is there, 0.
  subroutine make_matrix(this, rows, factor, matrix)
    class(shared_conduction_t), intent(in) :: this
    !> Rows of own particles, and what they are multiplied by
    type(sparse_operator_t), intent(in) :: rows
    real(wp), intent(in) :: factor
    !> To be destroyed by the caller
    type(tmat), intent(out) :: matrix
    integer, allocatable :: near(:), far(:), column(:)
    real(wp), allocatable :: value(:)
    integer :: k, row, length, own, failed, first

    own = this%own_last - this%own_first + 1
    first = 0
    if (own > 0) first = int(this%number(this%own_first)) - 1
    allocate (near(own), source=1)
    allocate (far(own), source=0)
    do k = 1, rows%rows()
      associate (at => rows%target(k) - this%own_first + 1, &
                 index => rows%index(rows%first(k):rows%first(k + 1) - 1))
        far(at) = count(index < this%own_first .or. index > this%own_last)
        near(at) = size(index) - far(at) + 1
      end associate
    end do
    call matcreate(this%ranks%comm%mpi_val, matrix, failed)
    call matsetsizes(matrix, own, own, int(this%particles), int(this%particles), failed)
    call matsettype(matrix, 'mpiaij', failed)
    call matmpiaijsetpreallocation(matrix, 0, near, 0, far, failed)
    do k = 1, rows%rows()
      length = int(rows%first(k + 1) - rows%first(k))
      row = int(this%number(rows%target(k))) - 1
      associate (index => rows%index(rows%first(k):rows%first(k + 1) - 1), &
                 weight => rows%weight(rows%first(k):rows%first(k + 1) - 1))
        column = [row, int(this%number(index)) - 1]
        value = factor*[rows%diagonal(k), weight]
      end associate
      call matsetvalues(matrix, 1, [row], length + 1, column, value, insert_values, failed)
    end do
    ! Every row has its diagonal, for matrices made of this one.
    do k = 1, own
      if (near(k) > 1 .or. far(k) > 0) cycle
      call matsetvalues(matrix, 1, [first + k - 1], 1, [first + k - 1], [0.0_wp], insert_values, &
                        failed)
    end do
    call matassemblybegin(matrix, mat_final_assembly, failed)
    call matassemblyend(matrix, mat_final_assembly, failed)
  end subroutine make_matrix

  !> The derivatives are those of the last `linearise`. Rows of prescribed entries are those of 1.
  subroutine make_jacobian(this, factor, jacobian, shift)
    class(shared_conduction_t), intent(inout) :: this
    real(wp), intent(in) :: factor
    !> To be destroyed by the caller
    type(tmat), intent(out) :: jacobian
    !> What is added to the diagonal; 0 without it
    real(wp), intent(in), optional :: shift
    type(tvec) :: numbers
    type(tmat) :: added
    real(wp), allocatable :: own(:), free(:)
    integer, allocatable :: held(:)
    integer :: failed, k, first_row

    associate (first => this%own_first, last => this%own_last)
      allocate (own(last - first + 1), source=1.0_wp)
      call veccreatempiwitharray(this%ranks%comm%mpi_val, 1, size(own), int(this%particles), own, &
                                 numbers, failed)
      if (allocated(this%local)) then
        call this%weigh_products(jacobian)
      else
        call matduplicate(this%matrix, mat_copy_values, jacobian, failed)
        if (allocated(this%content)) then
          own = this%potential_slope(first:last)
          call matdiagonalscale(jacobian, petsc_null_vec, numbers, failed)
        end if
      end if
      if (allocated(this%jumps)) then
        call this%jump_matrix(added)
        own = this%potential_slope(first:last)
        call matdiagonalscale(added, petsc_null_vec, numbers, failed)
        call mataxpy(jacobian, 1.0_wp, added, same_nonzero_pattern, failed)
        call matdestroy(added, failed)
      end if
      if (allocated(this%slope)) then
        own = this%slope(first:last)
        if (allocated(this%content)) own = own*this%temperature_slope(first:last)
        call matdiagonalset(jacobian, numbers, add_values, failed)
      end if
      call matscale(jacobian, factor, failed)
      if (present(shift)) call matshift(jacobian, shift, failed)
      call vecdestroy(numbers, failed)
      allocate (free(this%unknowns()), source=1.0_wp)
      call this%clear_prescribed(free)
      first_row = 0
      if (last >= first) first_row = int(this%number(first)) - 1
      held = pack([(first_row + k - first, k=first, last)], free(first:last) < 0.5_wp)
      call matzerorows(jacobian, size(held), held, 1.0_wp, petsc_null_vec, petsc_null_vec, failed)
    end associate
  end subroutine make_jacobian

  !> Where conductivities are no products: with rows R, factors c and levels ℓ, and how these follow
  !> the state, c' and ℓ', that is ½ (R (c ℓ' + ℓ c') + c R ℓ' - ℓ R c') + ½ (c' R ℓ - ℓ' R c).
  subroutine weigh_products(this, jacobian)
    class(shared_conduction_t), intent(in) :: this
    !> To be destroyed by the caller
    type(tmat), intent(out) :: jacobian
    type(tmat) :: part
    type(tvec) :: from_left, from_right
    real(wp), allocatable :: left(:), right(:)
    integer :: failed, own

    own = this%own_last - this%own_first + 1
    allocate (left(own), right(own))
    call veccreatempiwitharray(this%ranks%comm%mpi_val, 1, own, int(this%particles), left, &
                               from_left, failed)
    call veccreatempiwitharray(this%ranks%comm%mpi_val, 1, own, int(this%particles), right, &
                               from_right, failed)
    associate (c => this%local%factor(this%own_first:this%own_last), &
               level => this%local%level(this%own_first:this%own_last), &
               flow => this%local%flow(this%own_first:this%own_last), &
               factor_flow => this%local%factor_flow(this%own_first:this%own_last), &
               growth => this%potential_slope(this%own_first:this%own_last), &
               warming => this%local%factor_slope(this%own_first:this%own_last)* &
                          this%temperature_slope(this%own_first:this%own_last))
      call matduplicate(this%matrix, mat_copy_values, jacobian, failed)
      right = 0.5_wp*(c*growth + level*warming)
      call matdiagonalscale(jacobian, petsc_null_vec, from_right, failed)
      call matduplicate(this%matrix, mat_copy_values, part, failed)
      left = 0.5_wp*c
      right = growth
      call matdiagonalscale(part, from_left, from_right, failed)
      call mataxpy(jacobian, 1.0_wp, part, same_nonzero_pattern, failed)
      call matcopy(this%matrix, part, same_nonzero_pattern, failed)
      left = -0.5_wp*level
      right = warming
      call matdiagonalscale(part, from_left, from_right, failed)
      call mataxpy(jacobian, 1.0_wp, part, same_nonzero_pattern, failed)
      left = 0.5_wp*(warming*flow - growth*factor_flow)
      call matdiagonalset(jacobian, from_left, add_values, failed)
    end associate
    call matdestroy(part, failed)
    call vecdestroy(from_left, failed)
    call vecdestroy(from_right, failed)
  end subroutine weigh_products

  !> What jumps of potentials at interfaces add to the rows.
  subroutine jump_matrix(this, added)
    class(shared_conduction_t), intent(in) :: this
    !> Of the same pattern as the rows; to be destroyed by the caller
    type(tmat), intent(out) :: added
    integer, allocatable :: index(:)
    real(wp), allocatable :: weight(:)
    integer :: failed, k, place

    call matduplicate(this%matrix, mat_do_not_copy_values, added, failed)
    do k = 1, this%jumps%rows()
      call this%jumps%added_weights(k, place, index, weight)
      call matsetvalues(added, 1, [int(this%number(place)) - 1], size(index), &
                        int(this%number(index)) - 1, weight, add_values, failed)
    end do
    call matassemblybegin(added, mat_final_assembly, failed)
    call matassemblyend(added, mat_final_assembly, failed)
  end subroutine jump_matrix

  subroutine unload(this)
    class(shared_conduction_t), intent(inout) :: this
    integer :: failed

    if (.not. this%loaded) return
    call vecdestroy(this%factor, failed)
    call vecdestroy(this%product, failed)
    call matdestroy(this%matrix, failed)
    if (this%completing) then
      call vecscatterdestroy(this%way, failed)
      call vecdestroy(this%taken, failed)
    end if
    this%loaded = .false.
    this%completing = .false.
  end subroutine unload

  subroutine apply_rows(this, temperature, rate)
    class(shared_conduction_t), intent(inout) :: this
    real(wp), intent(in), contiguous :: temperature(:)
    real(wp), intent(inout), contiguous :: rate(:)

    call multiply(this, temperature(this%own_first:this%own_last), &
                  rate(this%own_first:this%own_last))
    rate(:this%own_first - 1) = 0
    rate(this%own_last + 1:) = 0
  end subroutine apply_rows

  subroutine multiply(this, given, found)
    type(shared_conduction_t), intent(inout) :: this
    real(wp), intent(in), contiguous :: given(:)
    real(wp), intent(inout), contiguous :: found(:)
    integer :: failed

    call vecplacearray(this%factor, given, failed)
    call vecplacearray(this%product, found, failed)
    call matmult(this%matrix, this%factor, this%product, failed)
    call vecresetarray(this%factor, failed)
    call vecresetarray(this%product, failed)
  end subroutine multiply

  subroutine stream_rows(this)
    class(shared_conduction_t), intent(inout) :: this

    ! The matrix takes them.
    associate (unused => this)
    end associate
  end subroutine stream_rows

  subroutine combine_with_rate(this, time, c, newer, start, rate_start, older, work)
    class(shared_conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in) :: c(5)
    real(wp), intent(in), contiguous :: newer(:), start(:), rate_start(:)
    real(wp), intent(inout), contiguous :: older(:)
    real(wp), allocatable, intent(inout) :: work(:)

    call combine_in_parts(this, time, c, newer, start, rate_start, older, work)
  end subroutine combine_with_rate

  subroutine recur_with_rate(this, time, c, newer, older, work)
    class(shared_conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in) :: c(3)
    real(wp), intent(in), contiguous :: newer(:)
    real(wp), intent(inout), contiguous :: older(:)
    real(wp), allocatable, intent(inout) :: work(:)

    call recur_with_rate_in_parts(this, time, c, newer, older, work)
  end subroutine recur_with_rate

  subroutine recur_with_jacobian(this, c, newer, older, work)
    class(shared_conduction_t), intent(inout) :: this
    real(wp), intent(in) :: c(3)
    real(wp), intent(in), contiguous :: newer(:)
    real(wp), intent(inout), contiguous :: older(:)
    real(wp), allocatable, intent(inout) :: work(:)

    call recur_with_jacobian_in_parts(this, c, newer, older, work)
  end subroutine recur_with_jacobian

  subroutine clear_prescribed(this, v)
    class(shared_conduction_t), intent(in) :: this
    real(wp), intent(inout), contiguous :: v(:)

    call this%conduction_t%clear_prescribed(v)
    v(:this%own_first - 1) = 0
    v(this%own_last + 1:) = 0
  end subroutine clear_prescribed

  subroutine inspect(this, time, u, error)
    class(shared_conduction_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    type(error_t), allocatable, intent(out) :: error

    call this%conduction_t%inspect(time, u, error)
    call this%agree(error)
  end subroutine inspect

  pure function is_shared(this) result(answer)
    class(shared_conduction_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .true.
  end function is_shared

  function all_unknowns(this) result(number)
    class(shared_conduction_t), intent(in) :: this
    integer(i8) :: number

    number = this%particles
  end function all_unknowns

  function dot_of_own(this, a, b) result(total)
    class(shared_conduction_t), intent(in) :: this
    real(wp), intent(in) :: a(:), b(:)
    real(wp) :: total

    total = this%ranks%total(dot(a(this%own_first:this%own_last), b(this%own_first:this%own_last)))
  end function dot_of_own

  subroutine scatter(this, seed, v)
    class(shared_conduction_t), intent(in) :: this
    integer, intent(in) :: seed
    real(wp), intent(out), contiguous :: v(:)
    integer :: k

    v = 0
    do k = this%own_first, this%own_last
      v(k) = random_uniform(seed, this%number(k)) - 0.5_wp
    end do
    call this%clear_prescribed(v)
  end subroutine scatter

  subroutine iterate_arnoldi(this, ido, wanted, tolerance, residual, basis, iparam, ipntr, workd, &
                             workl, info)
    class(shared_conduction_t), intent(in) :: this
    integer, intent(inout) :: ido, wanted, iparam(11), ipntr(14), info
    real(wp), intent(inout) :: tolerance
    real(wp), intent(inout), contiguous :: residual(:), basis(:, :), workd(:), workl(:)

    call pdnaupd(this%ranks%comm%mpi_val, ido, 'I', size(residual), 'LM', wanted, tolerance, &
                 residual, size(basis, 2), basis, size(basis, 1), iparam, ipntr, workd, workl, &
                 size(workl), info)
  end subroutine iterate_arnoldi

  subroutine finish_arnoldi(this, dr, di, vectors, wanted, tolerance, residual, basis, iparam, &
                            ipntr, workd, workl, info)
    class(shared_conduction_t), intent(in) :: this
    real(wp), intent(inout), contiguous :: dr(:), di(:), vectors(:, :)
    integer, intent(inout) :: wanted, iparam(11), ipntr(14), info
    real(wp), intent(inout) :: tolerance
    real(wp), intent(inout), contiguous :: residual(:), basis(:, :), workd(:), workl(:)
    logical :: chosen(size(basis, 2))
    real(wp) :: workev(3*size(basis, 2))

    chosen = .false.
    call pdneupd(this%ranks%comm%mpi_val, .true., 'A', chosen, dr, di, vectors, size(vectors, 1), &
                 0.0_wp, 0.0_wp, workev, 'I', size(residual), 'LM', wanted, tolerance, residual, &
                 size(basis, 2), basis, size(basis, 1), iparam, ipntr, workd, workl, size(workl), &
                 info)
  end subroutine finish_arnoldi

  subroutine find_scales(this, low, high, rise)
    class(shared_conduction_t), intent(in) :: this
    real(wp), intent(out) :: low, high, rise

    call this%conduction_t%find_scales(low, high, rise)
    call this%span(low, high)
    rise = this%ranks%most(rise)
  end subroutine find_scales

  subroutine allowed_range(this, low, high)
    class(shared_conduction_t), intent(in) :: this
    real(wp), intent(out) :: low, high

    call this%conduction_t%allowed_range(low, high)
    call this%span(low, high)
  end subroutine allowed_range

  subroutine span(this, low, high)
    class(shared_conduction_t), intent(in) :: this
    real(wp), intent(inout) :: low, high

    low = this%ranks%least(low)
    high = this%ranks%most(high)
  end subroutine span

  subroutine agree(this, error)
    class(shared_conduction_t), intent(in) :: this
    type(error_t), allocatable, intent(inout) :: error

    call this%ranks%agree(error)
  end subroutine agree

  pure subroutine own_particles(this, first, last)
    class(shared_conduction_t), intent(in) :: this
    integer, intent(out) :: first, last

    first = this%own_first
    last = this%own_last
  end subroutine own_particles

  function largest(this, value) result(of_all)
    class(shared_conduction_t), intent(in) :: this
    real(wp), intent(in) :: value
    real(wp) :: of_all

    of_all = this%ranks%most(value)
  end function largest

  subroutine add_up(this, sums)
    class(shared_conduction_t), intent(in) :: this
    real(wp), intent(inout), contiguous :: sums(:)

    call mpi_allreduce(mpi_in_place, sums, size(sums), mpi_double_precision, mpi_sum, &
                       this%ranks%comm)
  end subroutine add_up

  !> These rows are in no matrix: the states of other ranks' particles are asked for.
  subroutine apply_held_rows(this, state, result)
    class(shared_conduction_t), intent(inout) :: this
    real(wp), intent(in) :: state(:)
    real(wp), intent(out) :: result(:)
    real(wp), allocatable :: here(:)

    here = state
    call this%complete(here)
    call this%conduction_t%apply_held_rows(here, result)
  end subroutine apply_held_rows

  subroutine complete(this, values)
    class(shared_conduction_t), intent(inout) :: this
    real(wp), intent(inout), contiguous :: values(:)
    type(tis) :: numbers
    real(wp), pointer :: arrived(:)
    real(wp), allocatable :: own(:)
    integer :: failed

    own = values(this%own_first:this%own_last)
    call vecplacearray(this%factor, own, failed)
    if (.not. this%completing) then
      call veccreateseq(petsc_comm_self, size(values), this%taken, failed)
      call iscreategeneral(petsc_comm_self, size(values), int(this%number) - 1, &
                           petsc_copy_values, numbers, failed)
      call vecscattercreate(this%factor, numbers, this%taken, petsc_null_is, this%way, failed)
      call isdestroy(numbers, failed)
      this%completing = .true.
    end if
    call vecscatterbegin(this%way, this%factor, this%taken, insert_values, scatter_forward, failed)
    call vecscatterend(this%way, this%factor, this%taken, insert_values, scatter_forward, failed)
    call vecresetarray(this%factor, failed)
    call vecgetarrayreadf90(this%taken, arrived, failed)
    values = arrived
    call vecrestorearrayreadf90(this%taken, arrived, failed)
  end subroutine complete

  !> Products with rows are made by all ranks together, those that an interface or a conductivity
  !> of only some ranks' particles needs as well.
  subroutine share_parts(this)
    class(shared_conduction_t), intent(inout) :: this
    real(wp) :: lowest, highest, reference
    logical :: jumps

    if (.not. allocated(this%content)) return
    call this%expected_range(lowest, highest)
    jumps = this%ranks%any_of(allocated(this%jumps))
    if (jumps .and. .not. allocated(this%jumps)) then
      allocate (this%jumps)
      call this%jumps%prepare(this%content%law, lowest, highest)
    end if
    if (.not. this%ranks%any_of(allocated(this%local))) return
    reference = -huge(1.0_wp)
    if (allocated(this%local)) reference = this%local%reference
    reference = this%ranks%most(reference)
    if (allocated(this%local)) return
    allocate (this%local)
    call this%local%prepare(this%unknowns(), reference, lowest, highest)
  end subroutine share_parts

  !> What ranks have found by themselves is put together: others may take it up.
  subroutine save_shared(this, state)
    class(shared_conduction_t), intent(in) :: this
    type(saved_state_t), intent(inout) :: state
    real(wp) :: low, high

    low = this%lowest
    high = this%highest
    call this%span(low, high)
    call state%enter('conduction')
    call state%put('range', [low, high])
    call state%put('excursion', this%ranks%most(this%excursion))
    call state%put('growing_steps', nint(this%ranks%most(real(this%growing_steps, wp))))
    if (allocated(this%slope)) call state%put('slope', this%slope)
    if (allocated(this%content)) then
      call state%put('temperature_slope', this%temperature_slope)
      call state%put('potential_slope', this%potential_slope)
    end if
    call state%leave()
  end subroutine save_shared

  subroutine join_counts(this, list)
    class(shared_conduction_t), intent(in) :: this
    integer, allocatable, intent(inout) :: list(:)
    integer :: received(this%ranks%ranks)
    integer(i8), allocatable :: taken(:)

    associate (sent => spread(size(list), 1, this%ranks%ranks))
      call this%ranks%announce(sent, received)
      allocate (taken(sum(received)))
      call this%ranks%exchange(sent, reshape(spread(int(list, i8), 2, this%ranks%ranks), &
                                             [size(list)*this%ranks%ranks]), received, taken)
    end associate
    list = int(taken)
  end subroutine join_counts

  subroutine join_reals(this, list)
    class(shared_conduction_t), intent(in) :: this
    real(wp), allocatable, intent(inout) :: list(:)
    integer :: received(this%ranks%ranks)
    real(wp), allocatable :: taken(:)

    associate (sent => spread(size(list), 1, this%ranks%ranks))
      call this%ranks%announce(sent, received)
      allocate (taken(sum(received)))
      call this%ranks%exchange(sent, reshape(spread(list, 2, this%ranks%ranks), &
                                             [size(list)*this%ranks%ranks]), received, taken)
    end associate
    list = taken
  end subroutine join_reals

  elemental function whole_number(this, particle) result(number)
    class(shared_conduction_t), intent(in) :: this
    integer, intent(in) :: particle
    integer :: number

    number = int(this%number(particle))
  end function whole_number

end module calor_shared_conduction
