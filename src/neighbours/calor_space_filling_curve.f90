!> An order of particles in which neighbours in the plane are near each other in memory.
module calor_space_filling_curve
  use calor_constants, only: worth_threads
  use calor_kinds, only: wp, ip, i8
  implicit none (type, external)
  private

  public :: hilbert_order, hilbert_keys, hilbert_key, sort_by_keys, curve_square_t, levels

  !> Levels of the curve: the finest squares have 2⁻³⁰ of the extent
  integer, parameter :: levels = 30
  !> Bits of a key that one pass of the sort looks at, and how many passes there are
  integer, parameter :: digit_bits = 12
  integer, parameter :: passes = 2*levels/digit_bits
  integer, parameter :: last_digit = 2**digit_bits - 1
  !> The sort is shared out in so many blocks at most, none of them shorter than that
  integer, parameter :: most_blocks = 16, least_block = 16384

  !> The square that a curve fills
  type :: curve_square_t
    !> Its lower left corner, m, and how many of the finest squares are in a metre
    real(wp) :: x = 0.0_wp, y = 0.0_wp, per_length = 0.0_wp
  contains
    !> Make it fit
    procedure :: enclose
  end type curve_square_t

contains

  pure subroutine enclose(this, x_range, y_range)
    class(curve_square_t), intent(inout) :: this
    !> Lowest and highest coordinates of particles, m
    real(wp), intent(in) :: x_range(2), y_range(2)

    this%x = x_range(1)
    this%y = y_range(1)
    ! Squares so small that even the highest coordinates lie below 2³⁰ of them
    this%per_length = (2.0_wp**levels - 1)/ &
                      max(x_range(2) - x_range(1), y_range(2) - y_range(1), 1.0e-290_wp)
  end subroutine enclose

  !> Where particles lie on the curve.
  subroutine hilbert_keys(square, x, y, key)
    !> The square that it fills
    type(curve_square_t), intent(in) :: square
    !> Coordinates, m
    real(wp), intent(in) :: x(:), y(:)
    !> From 0 to below 2^(2 levels)
    integer(i8), intent(out) :: key(:)
    integer :: i

    !$omp parallel do if (size(x) > worth_threads) default(none) schedule(static) &
    !$omp shared(x, y, key, square)
    do i = 1, size(x)
      key(i) = hilbert_key(int((x(i) - square%x)*square%per_length, i8), &
                           int((y(i) - square%y)*square%per_length, i8))
    end do
    !$omp end parallel do
  end subroutine hilbert_keys

  !> The order of particles along a Hilbert curve through the square around them.
  !>
  !> Takes O(N) time and memory. Particles in the same finest square keep their order. The result
  !> does not depend on the number of threads. Coordinates have to be finite.
  !>
  !> Source: D. Hilbert, Über die stetige Abbildung einer Linie auf ein Flächenstück,
  !> Math. Ann. 38 (1891) 459–460.
  subroutine hilbert_order(x, y, order)
    !> Coordinates, m
    real(wp), intent(in) :: x(:), y(:)
    !> Permutation: the k-th particle along the curve is particle `order(k)`
    integer(ip), allocatable, intent(out) :: order(:)
    integer(i8), allocatable :: key(:)
    type(curve_square_t) :: square
    integer :: i

    allocate (order(size(x)), key(size(x)))
    do i = 1, size(x)
      order(i) = i
    end do
    if (size(x) < 2) return
    call square%enclose([minval(x), maxval(x)], [minval(y), maxval(y)])
    call hilbert_keys(square, x, y, key)
    call radix_sort(key, order)
  end subroutine hilbert_order

  !> Sort keys, and find where each was.
  subroutine sort_by_keys(key, order)
    !> Keys; sorted afterwards, equal ones in the order in which they were
    integer(i8), allocatable, intent(inout) :: key(:)
    !> The k-th key in order was the `order(k)`-th
    integer(ip), allocatable, intent(out) :: order(:)
    integer :: i

    order = [(int(i, ip), i=1, size(key))]
    if (size(key) > 1) call radix_sort(key, order)
  end subroutine sort_by_keys

  !> Where a square lies on the curve.
  pure function hilbert_key(column, row) result(key)
    !> The square, counted from 0, both below 2^levels
    integer(i8), intent(in) :: column, row
    integer(i8) :: key
    ! The curve through a square of 2×2 smaller ones has four orientations. For each, and each
    ! quadrant 2·(right half) + (upper half), counted from 0: when the quadrant is passed, and the
    ! orientation of the curve inside it.
    !   0: up, right, down   1: right, up, left   2: left, down, right   3: down, left, up
    integer(i8), parameter :: passed(0:3, 0:3) = &
                              reshape([integer(i8) :: 0, 1, 3, 2, &
                                       0, 3, 1, 2, &
                                       2, 1, 3, 0, &
                                       2, 3, 1, 0], [4, 4])
    integer, parameter :: inside(0:3, 0:3) = &
                          reshape([1, 0, 2, 0, &
                                   0, 3, 1, 1, &
                                   2, 2, 0, 3, &
                                   3, 1, 3, 2], [4, 4])
    integer :: level, orientation, quadrant

    key = 0
    orientation = 0
    do level = levels - 1, 0, -1
      quadrant = int(ior(ishft(iand(ishft(column, -level), 1_i8), 1), &
                         iand(ishft(row, -level), 1_i8)))
      key = ior(ishft(key, 2), passed(quadrant, orientation))
      orientation = inside(quadrant, orientation)
    end do
  end function hilbert_key

  !> Sort by keys below 2^(2 levels), keeping the order of equal ones.
  subroutine radix_sort(key, order)
    !> Keys; sorted afterwards
    integer(i8), allocatable, intent(inout) :: key(:)
    !> What is sorted along
    integer(ip), allocatable, intent(inout) :: order(:)
    integer(i8), allocatable :: key_sorted(:)
    integer(ip), allocatable :: order_sorted(:)
    integer(ip), allocatable :: next(:, :)
    integer(ip) :: before, count, digit, i, from, to, items
    integer :: block, blocks, pass

    ! Blocks one after another keep the order of equal keys, however many threads share them.
    items = size(key, kind=ip)
    blocks = min(most_blocks, 1 + items/least_block)
    allocate (key_sorted(items), order_sorted(items), next(0:last_digit, blocks))
    do pass = 0, passes - 1
      !$omp parallel do if (blocks > 1) schedule(static) default(shared) &
      !$omp private(block, from, to, i, digit)
      do block = 1, blocks
        call bounds_of(block, blocks, items, from, to)
        next(:, block) = 0
        do i = from, to
          digit = digit_of(key(i), pass)
          next(digit, block) = next(digit, block) + 1
        end do
      end do
      !$omp end parallel do
      if (any(sum(next, dim=2) == items)) cycle
      before = 1
      do digit = 0, last_digit
        do block = 1, blocks
          count = next(digit, block)
          next(digit, block) = before
          before = before + count
        end do
      end do
      !$omp parallel do if (blocks > 1) schedule(static) default(shared) &
      !$omp private(block, from, to, i, digit)
      do block = 1, blocks
        call bounds_of(block, blocks, items, from, to)
        do i = from, to
          digit = digit_of(key(i), pass)
          key_sorted(next(digit, block)) = key(i)
          order_sorted(next(digit, block)) = order(i)
          next(digit, block) = next(digit, block) + 1
        end do
      end do
      !$omp end parallel do
      call exchange(key, key_sorted, order, order_sorted)
    end do
  end subroutine radix_sort

  !> The first and last item of a block.
  pure subroutine bounds_of(block, blocks, items, from, to)
    integer, intent(in) :: block, blocks
    integer(ip), intent(in) :: items
    integer(ip), intent(out) :: from, to

    from = int(1 + (block - 1)*int(items, i8)/blocks, ip)
    to = int(block*int(items, i8)/blocks, ip)
  end subroutine bounds_of

  !> One digit of a key.
  elemental function digit_of(key, pass) result(digit)
    integer(i8), intent(in) :: key
    !> Which digit, counted from 0 at the low end
    integer, intent(in) :: pass
    integer(ip) :: digit

    digit = int(iand(ishft(key, -digit_bits*pass), int(last_digit, i8)), ip)
  end function digit_of

  !> Exchange two pairs of arrays without copying them.
  pure subroutine exchange(key, other_key, order, other_order)
    integer(i8), allocatable, intent(inout) :: key(:), other_key(:)
    integer(ip), allocatable, intent(inout) :: order(:), other_order(:)
    integer(i8), allocatable :: key_kept(:)
    integer(ip), allocatable :: order_kept(:)

    call move_alloc(key, key_kept)
    call move_alloc(other_key, key)
    call move_alloc(key_kept, other_key)
    call move_alloc(order, order_kept)
    call move_alloc(other_order, order)
    call move_alloc(order_kept, other_order)
  end subroutine exchange

end module calor_space_filling_curve
