!> Small linear programmes in standard form.
module calor_linear_programme
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: minimise

  !> What counts as zero in a tableau whose entries are of order one
  real(wp), parameter :: tolerance = 1.0e-11_wp

contains

  !> Minimise c·a subject to A a = b and a ≥ 0 by the two-phase simplex method on a dense tableau,
  !> made for a handful of constraints. A solution is a vertex: it has no more non-zero entries than
  !> there are constraints. Ties are broken by Bland's rule, so that no cycle can occur.
  pure subroutine minimise(cost, constraints, bounds, solution, tableau, basis, feasible)
    !> c, one entry a variable
    real(wp), intent(in) :: cost(:)
    !> A: a row for each constraint, a column for each variable, entries of order one
    real(wp), intent(in) :: constraints(:, :)
    !> b, not negative
    real(wp), intent(in) :: bounds(:)
    !> The vertex with the least cost; zero where there is none
    real(wp), intent(out) :: solution(:)
    !> Workspace: a row more than constraints, at least a column more than variables and constraints
    real(wp), intent(inout) :: tableau(0:, 0:)
    !> Workspace: an entry for each constraint
    integer, intent(inout) :: basis(:)
    !> Whether any a fulfils the constraints
    logical, intent(out) :: feasible
    integer :: m, n, row, column

    m = size(constraints, 1)
    n = size(constraints, 2)
    solution = 0
    ! Column 0 holds the right-hand side, columns n + 1 … n + m artificial variables, row 0 the
    ! reduced costs. First phase: drive the sum of the artificial variables to zero.
    tableau(0:m, 0:n + m) = 0
    tableau(1:m, 0) = bounds
    tableau(1:m, 1:n) = constraints
    do row = 1, m
      tableau(row, n + row) = 1
      basis(row) = n + row
      tableau(0, 0:n) = tableau(0, 0:n) - tableau(row, 0:n)
    end do
    call improve(tableau, basis, m, n, n + m)
    feasible = -tableau(0, 0) <= tolerance*(1 + sum(bounds))
    if (.not. feasible) return
    ! Artificial variables that are left at zero leave the basis where another can take their place.
    do row = 1, m
      if (basis(row) <= n) cycle
      column = maxloc(abs(tableau(row, 1:n)), dim=1)
      if (abs(tableau(row, column)) > 1.0e-7_wp) call pivot(tableau, basis, m, n + m, row, column)
    end do
    tableau(0, :) = 0
    tableau(0, 1:n) = cost
    do row = 1, m
      if (basis(row) > n) cycle
      tableau(0, 0:n) = tableau(0, 0:n) - cost(basis(row))*tableau(row, 0:n)
    end do
    call improve(tableau, basis, m, n, n)
    do row = 1, m
      if (basis(row) <= n) solution(basis(row)) = max(0.0_wp, tableau(row, 0))
    end do
  end subroutine minimise

  !> Exchange basic variables until no reduced cost is negative.
  pure subroutine improve(tableau, basis, m, n, last)
    real(wp), intent(inout) :: tableau(0:, 0:)
    integer, intent(inout) :: basis(:)
    !> Constraints and variables, and the last column to carry along
    integer, intent(in) :: m, n, last
    integer :: row, leaving, entering, exchange, k
    real(wp) :: ratio, least

    do exchange = 1, 50*(m + n)
      entering = 0
      ! The steepest column at first; the first one later on, which cannot cycle
      if (exchange <= 10*m) then
        k = minloc(tableau(0, 1:n), dim=1)
        if (tableau(0, k) < -tolerance) entering = k
      else
        do k = 1, n
          if (tableau(0, k) < -tolerance) then
            entering = k
            exit
          end if
        end do
      end if
      if (entering == 0) return
      leaving = 0
      least = huge(1.0_wp)
      do row = 1, m
        if (tableau(row, entering) <= 1.0e-9_wp) cycle
        ratio = tableau(row, 0)/tableau(row, entering)
        if (leaving > 0) then
          if (ratio > least) cycle
          if (ratio >= least .and. basis(row) > basis(leaving)) cycle
        end if
        leaving = row
        least = ratio
      end do
      ! Costs are not negative, so a direction without bound is rounding only.
      if (leaving == 0) return
      call pivot(tableau, basis, m, last, leaving, entering)
    end do
  end subroutine improve

  !> Make a variable basic in a row.
  pure subroutine pivot(tableau, basis, m, last, row, column)
    real(wp), intent(inout) :: tableau(0:, 0:)
    integer, intent(inout) :: basis(:)
    integer, intent(in) :: m, last, row, column
    integer :: other

    tableau(row, 0:last) = tableau(row, 0:last)/tableau(row, column)
    do other = 0, m
      if (other == row) cycle
      tableau(other, 0:last) = tableau(other, 0:last) - tableau(other, column)*tableau(row, 0:last)
      tableau(other, column) = 0
    end do
    tableau(row, column) = 1
    basis(row) = column
  end subroutine pivot

end module calor_linear_programme
