!> The linear systems of implicit steps, (1 - s J) x = b, J being an evolution's Jacobian.
!>
!> They are solved by UMFPACK's factors, which serve as long as s is the same, as long as these fit
!> into half of the memory that is to spare; otherwise by BiCGSTAB with incomplete factors.
module calor_implicit_system
  use calor_bicgstab, only: solve_by_bicgstab
  use calor_incomplete_factors, only: incomplete_factors_t
  use calor_kinds, only: wp
  use calor_machine_memory, only: available_memory
  use calor_sparse_matrix, only: sparse_matrix_t
  use calor_umfpack, only: factorisation_t
  implicit none (type, external)
  private

  public :: implicit_system_t

  !> Iterations of BiCGSTAB before it is given up: with the preconditioner some ten are usual, and
  !> some hundred where steps are so long that nearly the steady temperature is sought
  integer, parameter :: most_iterations = 1000
  !> s counts as the same if it differs by no more than rounding in a step's length
  real(wp), parameter :: rounding = 1.0e-11_wp

  type :: implicit_system_t
    !> Whether the iteration is to be used even where factors would fit
    logical :: iterative = .false.
    !> Factors may take so many bytes, and never more than half of the memory that is to spare
    real(wp) :: most_bytes = huge(1.0_wp)
    !> How often factors were found, and iterations of BiCGSTAB so far
    integer :: factorisations = 0, iterations = 0
    !> J, and 1 - s J
    type(sparse_matrix_t), private :: jacobian, matrix
    type(factorisation_t), private :: direct
    type(incomplete_factors_t), private :: incomplete
    !> s of the factors; negative: there are none
    real(wp), private :: shift = -1.0_wp
    logical, private :: analysed = .false.
  contains
    !> Take a Jacobian
    procedure :: load
    !> Whether there is one
    procedure :: is_loaded
    !> Make ready for a value of s
    procedure :: set_shift
    !> The value it is ready for; negative: for none
    procedure :: present_shift
    !> Make ready for -J alone
    procedure :: set_steady
    !> Solve
    procedure :: solve
    procedure, private :: find_factors
    procedure, private :: analyse
  end type implicit_system_t

contains

  subroutine load(this, first, index, value)
    class(implicit_system_t), intent(inout) :: this
    !> J by rows; rows of prescribed entries are empty
    integer, intent(in) :: first(:), index(:)
    real(wp), intent(in), contiguous :: value(:)

    type(sparse_matrix_t) :: jacobian

    call jacobian%assemble(first, index, value)
    if (.not. jacobian%has_pattern_of(this%jacobian)) then
      this%matrix = sparse_matrix_t()
      this%analysed = .false.
    end if
    this%jacobian = jacobian
    this%shift = -1
  end subroutine load

  pure function is_loaded(this) result(answer)
    class(implicit_system_t), intent(in) :: this
    logical :: answer

    answer = this%jacobian%rows() > 0
  end function is_loaded

  pure function present_shift(this) result(shift)
    class(implicit_system_t), intent(in) :: this
    real(wp) :: shift

    shift = this%shift
  end function present_shift

  subroutine set_shift(this, shift, done)
    class(implicit_system_t), intent(inout) :: this
    !> s
    real(wp), intent(in) :: shift
    !> Whether the matrix is regular
    logical, intent(out) :: done

    done = .true.
    if (abs(shift - this%shift) <= rounding*shift) return
    call this%matrix%become_shifted(this%jacobian, shift)
    call this%find_factors(.true., done)
    this%shift = merge(shift, -1.0_wp, done)
  end subroutine set_shift

  !> Make ready for -J x = b; where J has an empty row, x = b.
  subroutine set_steady(this, done)
    class(implicit_system_t), intent(inout) :: this
    !> Whether the matrix is regular
    logical, intent(out) :: done
    integer :: row

    call this%matrix%become_shifted(this%jacobian, 1.0_wp)
    associate (matrix => this%matrix)
      do row = 1, matrix%rows()
        if (matrix%first(row + 1) - matrix%first(row) == 1) cycle
        matrix%value(matrix%diagonal(row)) = matrix%value(matrix%diagonal(row)) - 1
      end do
    end associate
    call this%find_factors(.false., done)
    this%shift = -1
  end subroutine set_steady

  subroutine find_factors(this, dominant, done)
    class(implicit_system_t), intent(inout) :: this
    !> Whether the diagonal dominates
    logical, intent(in) :: dominant
    logical, intent(out) :: done

    done = .true.
    this%factorisations = this%factorisations + 1
    if (.not. this%analysed .and. .not. this%iterative) call this%analyse(dominant)
    if (.not. this%iterative) then
      call this%direct%refactorise(this%matrix%value, done)
      if (.not. done) then
        ! A copy has no factors of its own, or memory has run out after all.
        call this%analyse(dominant)
        if (.not. this%iterative) call this%direct%refactorise(this%matrix%value, done)
        if (.not. done) this%iterative = .true.
      end if
    end if
    if (this%iterative) call this%incomplete%factorise(this%matrix, done)
  end subroutine find_factors

  !> Decide between factors and iteration.
  subroutine analyse(this, dominant)
    class(implicit_system_t), intent(inout) :: this
    logical, intent(in) :: dominant
    logical :: done

    call this%direct%analyse(this%matrix, dominant, done)
    this%analysed = .true.
    this%iterative = .not. done .or. this%direct%bytes > &
                     min(this%most_bytes, 0.5_wp*real(available_memory(), wp))
    if (this%iterative) call this%direct%release()
  end subroutine analyse

  !> Solve for the present s.
  subroutine solve(this, b, tolerance, x, done)
    class(implicit_system_t), intent(inout) :: this
    real(wp), intent(in), contiguous :: b(:)
    !> Largest residual, root mean square, where the solution is by iteration
    real(wp), intent(in) :: tolerance
    real(wp), intent(out), contiguous :: x(:)
    !> Whether it was found
    logical, intent(out) :: done
    integer :: iterations

    if (this%iterative) then
      call this%incomplete%solve(b, x)
      call solve_by_bicgstab(this%matrix, this%incomplete, b, tolerance*sqrt(real(size(b), wp)), &
                             most_iterations, x, iterations, done)
      this%iterations = this%iterations + iterations
    else
      call this%direct%solve(b, x, .false., done)
      if (done) return
      ! A copy has no factors of its own.
      this%shift = -1
    end if
  end subroutine solve

end module calor_implicit_system
