!> Sums over long vectors that do not depend on the number of threads.
module calor_sums
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: dot, root_mean_square

  !> Elements summed up one after another before partial sums are added. A fixed length keeps the
  !> order of all additions, and so every bit of the result, the same for any number of threads.
  integer, parameter :: block_length = 4096

contains

  !> Σ a_i b_i, to the last bit the same for any number of threads.
  function dot(a, b) result(total)
    !> Vectors of equal size
    real(wp), intent(in) :: a(:), b(:)
    real(wp) :: total
    real(wp), allocatable :: partial(:)
    integer :: block, blocks, from, to

    blocks = (size(a) + block_length - 1)/block_length
    allocate (partial(blocks))
    !$omp parallel do if (blocks > 1) schedule(static) default(shared) private(block, from, to)
    do block = 1, blocks
      from = (block - 1)*block_length + 1
      to = min(block*block_length, size(a))
      partial(block) = dot_product(a(from:to), b(from:to))
    end do
    !$omp end parallel do
    total = sum(partial)
  end function dot

  !> √(Σ a_i² / n); 0 for an empty vector.
  function root_mean_square(a) result(value)
    !> A vector
    real(wp), intent(in) :: a(:)
    real(wp) :: value

    value = sqrt(dot(a, a)/max(1, size(a)))
  end function root_mean_square

end module calor_sums
