!> Lines of equal value on a grid, by marching squares.
module calor_isolines
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: find_isolines, even_levels

contains

  !> Pieces of the line on which a field has a value, straight across each cell of the grid.
  !>
  !> Where the values at two opposite corners are above and the others below, the mean of the four
  !> tells which of them are joined. Cells with a corner outside are left out.
  !>
  !> Source: W.E. Lorensen, H.E. Cline, Computer Graphics 21 (4) (1987) 163–169, in two dimensions.
  subroutine find_isolines(values, inside, level, pieces)
    !> The field by column and row
    real(wp), intent(in) :: values(:, :)
    !> Where it is known
    logical, intent(in) :: inside(:, :)
    !> The value
    real(wp), intent(in) :: level
    !> For each piece column and row of its ends, counted from 1: (x1, y1, x2, y2)
    real(wp), allocatable, intent(out) :: pieces(:, :)
    real(wp), allocatable :: found(:, :)
    real(wp) :: ends(2, 4)
    integer :: i, j, count, crossed

    ! A cell has two pieces at most.
    allocate (found(4, 2*size(values)))
    count = 0
    do j = 1, size(values, 2) - 1
      do i = 1, size(values, 1) - 1
        if (.not. all(inside(i:i + 1, j:j + 1))) cycle
        call cross_cell(values(i:i + 1, j:j + 1), level, ends, crossed)
        if (crossed >= 2) call add(ends(:, 1), ends(:, 2))
        if (crossed == 4) call add(ends(:, 3), ends(:, 4))
      end do
    end do
    pieces = found(:, :count)

  contains

    subroutine add(from, to)
      real(wp), intent(in) :: from(2), to(2)

      count = count + 1
      found(:, count) = [from(1) + i, from(2) + j, to(1) + i, to(2) + j]
    end subroutine add

  end subroutine find_isolines

  !> Where the line crosses the edges of the unit square, in pairs that belong together.
  pure subroutine cross_cell(corner, level, ends, crossed)
    real(wp), intent(in) :: corner(2, 2), level
    real(wp), intent(out) :: ends(2, 4)
    integer, intent(out) :: crossed
    !> The corners in turn, and back to the first
    integer, parameter :: turn(2, 5) = reshape([0, 0, 1, 0, 1, 1, 0, 1, 0, 0], [2, 5])
    real(wp) :: value(5), part
    integer :: k

    ends = 0
    crossed = 0
    do k = 1, 5
      value(k) = corner(turn(1, k) + 1, turn(2, k) + 1) - level
    end do
    do k = 1, 4
      if ((value(k) >= 0) .eqv. (value(k + 1) >= 0)) cycle
      crossed = crossed + 1
      part = value(k)/(value(k) - value(k + 1))
      ends(:, crossed) = turn(:, k) + part*(turn(:, k + 1) - turn(:, k))
    end do
    ! A saddle: the edges 1 and 2 enclose the second corner. If the middle is on its side, the
    ! corners that are cut off are the first and the third.
    if (crossed == 4) then
      if ((sum(value(:4)) >= 0) .eqv. (value(2) >= 0)) ends = ends(:, [4, 1, 2, 3])
    end if
  end subroutine cross_cell

  !> Round numbers 1, 2 or 5 · 10ⁿ apart strictly between two others: from 5 to 12 of them.
  pure function even_levels(low, high) result(levels)
    !> The least and the largest value
    real(wp), intent(in) :: low, high
    real(wp), allocatable :: levels(:)
    real(wp), parameter :: steps(*) = [1.0_wp, 2.0_wp, 5.0_wp, 10.0_wp]
    integer, parameter :: most = 12
    real(wp) :: decade, step
    integer :: k, first, last

    allocate (levels(0))
    if (.not. high - low > 1.0e-9_wp*max(abs(low), abs(high))) return
    decade = 10.0_wp**floor(log10((high - low)/most))
    do k = 1, size(steps)
      step = steps(k)*decade
      if ((high - low)/step <= most) exit
    end do
    first = floor(low/step + 1.0e-6_wp) + 1
    last = ceiling(high/step - 1.0e-6_wp) - 1
    levels = [(k*step, k=first, last)]
  end function even_levels

end module calor_isolines
