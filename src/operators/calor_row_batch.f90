!> The stencils of several particles side by side, so that one instruction works on all of them.
!>
!> What a row takes, a few sums over neighbours and a small dense system, is too short to fill the
!> vector units by itself. Here the rows of a batch lie in the lanes of a vector: neighbour k of all
!> rows stands together. Rows with fewer neighbours than the longest are filled up with neighbours
!> on the edge of the support, where every kernel is zero, and of no volume.
module calor_row_batch
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, i8
  use calor_neighbour_list, only: neighbour_list_t
  implicit none (type, external)
  private

  public :: row_batch_t, lanes

  !> Rows of a batch
  integer, parameter :: lanes = 8

  !> Up to `lanes` rows. Neighbour k of the row in lane l stands at l + lanes*(k - 1); the arrays
  !> are a workspace and may be longer. Units are those of `stencil_t`.
  type :: row_batch_t
    !> The largest number of neighbours
    integer :: n = 0
    !> Number of neighbours of each row
    integer :: length(lanes) = 0
    !> Distances |r_ij|/h
    real(wp), allocatable :: q(:)
    !> Unit vectors e_ij = r_ij/|r_ij|; of what fills up, 0
    real(wp), allocatable :: ex(:), ey(:)
    !> Volumes w_j/h²; of what fills up, 0
    real(wp), allocatable :: volume(:)
    !> Kernel profile and derivatives f(q), f'(q), f''(q)
    real(wp), allocatable :: f(:), df(:), ddf(:)
    !> The weights found, for each neighbour and for the particle itself, in units of 1/h²
    real(wp), allocatable :: weight(:)
    real(wp) :: diagonal(lanes) = 0.0_wp
    !> Conditions and residuals as in `stencil_t`
    real(wp) :: condition_gradient(lanes) = 0.0_wp, condition_laplacian(lanes) = 0.0_wp
    real(wp) :: residual(lanes) = 0.0_wp
    !> Whether a row was found; the others have to be found one by one
    logical :: solved(lanes) = .false.
    !> Whether it is certain that no row meets all conditions
    logical :: unmet(lanes) = .false.
  contains
    !> Provide room for a number of neighbours
    procedure :: reserve
    !> Fill in the neighbours of some rows
    procedure :: gather
  end type row_batch_t

contains

  subroutine reserve(this, most)
    class(row_batch_t), intent(inout) :: this
    !> The largest number of neighbours to come
    integer, intent(in) :: most

    allocate (this%q(lanes*most), this%ex(lanes*most), this%ey(lanes*most))
    allocate (this%volume(lanes*most), this%weight(lanes*most))
    allocate (this%f(lanes*most), this%df(lanes*most), this%ddf(lanes*most))
  end subroutine reserve

  pure subroutine gather(this, kernel, x, y, volume, radius, list, first_row, last_row)
    class(row_batch_t), intent(inout) :: this
    !> The smoothing kernel
    class(kernel_t), intent(in) :: kernel
    !> Coordinates, m, volumes, m², and support radii, m, of all particles
    real(wp), intent(in) :: x(:), y(:), volume(:), radius(:)
    !> The neighbours, none of them at the place of its row's particle
    type(neighbour_list_t), intent(in) :: list
    !> The rows, at most `lanes` of them
    integer, intent(in) :: first_row, last_row
    real(wp) :: dx, dy, r, scale
    integer(i8) :: from
    integer :: i, j, k, lane, place

    this%length = 0
    do lane = 1, last_row - first_row + 1
      this%length(lane) = int(list%first(first_row + lane) - list%first(first_row + lane - 1))
    end do
    this%n = maxval(this%length)
    this%condition_gradient = 0
    this%condition_laplacian = 0
    this%residual = 0
    this%solved = .false.
    this%unmet = .false.
    do lane = 1, lanes
      if (this%length(lane) > 0) then
        i = list%target(first_row + lane - 1)
        from = list%first(first_row + lane - 1) - 1
        scale = 1/radius(i)
        do k = 1, this%length(lane)
          j = list%index(from + k)
          place = lane + lanes*(k - 1)
          this%ex(place) = (x(i) - x(j))*scale
          this%ey(place) = (y(i) - y(j))*scale
          this%volume(place) = (volume(j)*scale)*scale
        end do
      end if
      do k = this%length(lane) + 1, this%n
        place = lane + lanes*(k - 1)
        this%ex(place) = 1
        this%ey(place) = 0
        this%volume(place) = 0
      end do
    end do
    do place = 1, lanes*this%n
      dx = this%ex(place)
      dy = this%ey(place)
      r = sqrt(dx**2 + dy**2)
      this%q(place) = r
      this%ex(place) = dx/r
      this%ey(place) = dy/r
    end do
    associate (all => lanes*this%n)
      call kernel%profile(this%q(1:all), this%f(1:all), this%df(1:all), this%ddf(1:all))
    end associate
  end subroutine gather

end module calor_row_batch
