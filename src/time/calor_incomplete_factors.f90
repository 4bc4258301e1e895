!> Incomplete factors of a sparse matrix, without fill: ILU(0), a preconditioner.
!>
!> Source: J.A. Meijerink, H.A. van der Vorst, An iterative solution method for linear systems of
!> which the coefficient matrix is a symmetric M-matrix, Math. Comput. 31 (1977) 148–162.
module calor_incomplete_factors
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_kinds, only: wp, i8
  use calor_sparse_matrix, only: sparse_matrix_t
  implicit none (type, external)
  private

  public :: incomplete_factors_t

  !> L and U with the matrix's own pattern: L below the diagonal, which is 1, and U from it on
  type :: incomplete_factors_t
    private
    type(sparse_matrix_t) :: factors
    real(wp), allocatable :: inverse(:)
  contains
    !> Factorise
    procedure :: factorise
    !> Solve L U x = b
    procedure :: solve
  end type incomplete_factors_t

contains

  subroutine factorise(this, matrix, done)
    class(incomplete_factors_t), intent(inout) :: this
    !> The matrix
    type(sparse_matrix_t), intent(in) :: matrix
    !> Whether no pivot was 0
    logical, intent(out) :: done
    integer(i8), allocatable :: place(:)
    integer(i8) :: k, j
    integer :: row, n

    n = matrix%rows()
    this%factors = matrix
    if (allocated(this%inverse)) deallocate (this%inverse)
    allocate (this%inverse(n), place(n))
    place = 0
    done = .false.
    associate (first => this%factors%first, index => this%factors%index, &
               value => this%factors%value, diagonal => this%factors%diagonal)
      do row = 1, n
        do k = first(row), first(row + 1) - 1
          place(index(k)) = k
        end do
        do k = first(row), diagonal(row) - 1
          value(k) = value(k)*this%inverse(index(k))
          do j = diagonal(index(k)) + 1, first(index(k) + 1) - 1
            if (place(index(j)) > 0) then
              value(place(index(j))) = value(place(index(j))) - value(k)*value(j)
            end if
          end do
        end do
        do k = first(row), first(row + 1) - 1
          place(index(k)) = 0
        end do
        if (.not. abs(value(diagonal(row))) > 0) return
        this%inverse(row) = 1/value(diagonal(row))
        if (.not. ieee_is_finite(this%inverse(row))) return
      end do
    end associate
    done = .true.
  end subroutine factorise

  pure subroutine solve(this, b, x)
    class(incomplete_factors_t), intent(in) :: this
    real(wp), intent(in), contiguous :: b(:)
    real(wp), intent(out), contiguous :: x(:)
    real(wp) :: total
    integer(i8) :: k
    integer :: row

    associate (first => this%factors%first, index => this%factors%index, &
               value => this%factors%value, diagonal => this%factors%diagonal)
      do row = 1, size(b)
        total = b(row)
        do k = first(row), diagonal(row) - 1
          total = total - value(k)*x(index(k))
        end do
        x(row) = total
      end do
      do row = size(b), 1, -1
        total = x(row)
        do k = diagonal(row) + 1, first(row + 1) - 1
          total = total - value(k)*x(index(k))
        end do
        x(row) = total*this%inverse(row)
      end do
    end associate
  end subroutine solve

end module calor_incomplete_factors
