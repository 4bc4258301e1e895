!> How good the rows of an operator for the Laplacian are.
!>
!> The measure is q_i = Σ_{j≠i} |a_ij| / |a_ii| with a_ii < 0: 1 means that no weight is negative,
!> so that the row obeys the maximum principle; rows far above 1 make the heat equation unstable. It
!> speaks only for rows that are consistent, so their moments are measured beside it.
module calor_row_quality
  use calor_constants, only: pi, worth_threads
  use calor_kinds, only: wp, i8
  use calor_sparse_operator, only: sparse_operator_t
  implicit none (type, external)
  private

  public :: row_quality_t, measure_rows

  !> One entry a row
  type :: row_quality_t
    !> q_i; huge(1.0) where a_ii ≥ 0
    real(wp), allocatable :: ratio(:)
    !> The largest error among the derivatives of x, y, x², xy and y², about the particle and in
    !> units of the support radius, that the row ought to have exactly
    real(wp), allocatable :: residual(:)
    !> |a_ii| times the square of the mean distance between the neighbours: some 4 to 10 for a usual
    !> row; a large one costs short time steps
    real(wp), allocatable :: stiffness(:)
    !> Number of neighbours with a weight
    integer, allocatable :: neighbours(:)
  contains
    !> Add the entries of other rows after its own
    procedure :: append
  end type row_quality_t

contains

  subroutine append(this, other)
    class(row_quality_t), intent(inout) :: this
    !> The other rows
    type(row_quality_t), intent(in) :: other

    this%ratio = [this%ratio, other%ratio]
    this%residual = [this%residual, other%residual]
    this%stiffness = [this%stiffness, other%stiffness]
    this%neighbours = [this%neighbours, other%neighbours]
  end subroutine append

  !> Measure every row.
  subroutine measure_rows(laplacian, x, y, radius, degree, quality)
    !> Rows of weights for ∇²
    type(sparse_operator_t), intent(in) :: laplacian
    !> Coordinates and support radii of all particles, m
    real(wp), intent(in) :: x(:), y(:), radius(:)
    !> The degree of the polynomials that the scheme should be exact for: 0, 1 or 2
    integer, intent(in) :: degree
    !> What was found
    type(row_quality_t), intent(out) :: quality
    real(wp) :: moment(5), total, weight, dx, dy, h
    integer(i8) :: k
    integer :: row, i, j

    allocate (quality%ratio(laplacian%rows()), quality%residual(laplacian%rows()))
    allocate (quality%neighbours(laplacian%rows()), quality%stiffness(laplacian%rows()))
    !$omp parallel do if (laplacian%rows() > worth_threads) schedule(static) default(shared) &
    !$omp private(row, k, i, j, h, moment, total, weight, dx, dy)
    do row = 1, laplacian%rows()
      i = laplacian%target(row)
      h = radius(i)
      moment = 0
      total = 0
      quality%neighbours(row) = 0
      do k = laplacian%first(row), laplacian%first(row + 1) - 1
        j = laplacian%index(k)
        weight = laplacian%weight(k)
        total = total + abs(weight)
        if (abs(weight) > 0) quality%neighbours(row) = quality%neighbours(row) + 1
        dx = x(j) - x(i)
        dy = y(j) - y(i)
        moment = moment + weight*[dx*h, dy*h, dx*dx, dx*dy, dy*dy]
      end do
      quality%ratio(row) = huge(1.0_wp)
      if (laplacian%diagonal(row) < 0 .and. total <= huge(1.0_wp)*1.0e-3_wp) then
        if (total < -1.0e3_wp*laplacian%diagonal(row)) then
          quality%ratio(row) = -total/laplacian%diagonal(row)
        end if
      end if
      ! A disc of the support radius is shared by the particle and its neighbours.
      quality%stiffness(row) = abs(laplacian%diagonal(row))*h**2* &
                               pi/(1 + laplacian%first(row + 1) - laplacian%first(row))
      quality%residual(row) = 0
      if (degree >= 1) quality%residual(row) = maxval(abs(moment(1:2)))
      if (degree >= 2) then
        moment(3) = moment(3) - 2
        moment(5) = moment(5) - 2
        quality%residual(row) = max(quality%residual(row), maxval(abs(moment(3:5))))
      end if
    end do
    !$omp end parallel do
  end subroutine measure_rows

end module calor_row_quality
