!> What is lost where an initial temperature jumps.
!>
!> Particles take a field at their places. Where it is smooth that says all; where it jumps between
!> two particles by J, nothing says where between them, and the heat of the body may be wrong by a
!> part of J times the spacing: an error of first order, larger than all others. A scheme of higher
!> order, which could tell the error, does not know either, and moreover it needs a field that is
!> smooth over a few spacings. So near jumps the solution with which the error is compared starts
!> from the field's local mean: the polynomial of degree 3 that fits it best around each particle,
!> within the body. That has the right heat and the right first three moments, so that what it
!> changes is felt later on to fourth order only.
module calor_initial_jumps
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_body, only: body_t
  use calor_cloud, only: cloud_t
  use calor_expression, only: expression_t
  use calor_kinds, only: wp, ip
  use calor_lapack, only: dpstrf, dpotrs
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  implicit none (type, external)
  private

  public :: find_jump_errors

  !> Between particles as near as this, in spacings, jumps are looked for
  real(wp), parameter :: near = 1.6_wp
  !> What is smaller, as a part of the range of temperatures, is not looked at
  real(wp), parameter :: smallest_jump = 0.02_wp
  !> A difference that is halved so often with the distance and keeps this part of itself is a jump
  integer, parameter :: halvings = 20
  real(wp), parameter :: kept_part = 0.3_wp
  !> Means are taken over discs of this radius, in spacings: a higher order needs them smooth
  real(wp), parameter :: radius = 3.5_wp
  !> … on a grid with so many nodes to a spacing, each the mean over its cell, for which it is
  !> sampled in so many columns and rows where it jumps
  integer, parameter :: fineness = 4, samples = 16
  !> Monomials up to degree 3
  integer, parameter :: monomials = 10

  !> A field on a grid about all places where it jumps
  type :: grid_t
    !> The first node and the distance of nodes, m
    real(wp) :: x = 0.0_wp, y = 0.0_wp, spacing = 0.0_wp
    !> Mean over the cell of each node
    real(wp), allocatable :: mean(:, :)
    !> Whether the node lies in the body and has a value
    logical, allocatable :: counts(:, :)
  contains
    procedure :: sample
    procedure :: mean_around
  end type grid_t

contains

  !> The local mean of a field less the field, at particles near which it jumps; 0 at all others.
  subroutine find_jump_errors(field, cloud, body, deviation)
    !> The field
    type(expression_t), intent(in) :: field
    !> The cloud
    type(cloud_t), intent(in) :: cloud
    !> The body that it fills
    type(body_t), intent(in) :: body
    !> Mean less value, in units of the field
    real(wp), intent(out) :: deviation(:)
    type(neighbour_list_t) :: list
    type(grid_t) :: grid
    real(wp), allocatable :: value(:)
    logical, allocatable :: jumps(:), averaged(:)
    integer(ip), allocatable :: particle(:)
    real(wp) :: threshold
    integer :: i, k

    deviation = 0
    allocate (value(size(cloud%x)))
    call field%evaluate(cloud%x, cloud%y, 0.0_wp, values=value)
    threshold = smallest_jump*(maxval(value) - minval(value))
    if (.not. threshold > 0) return
    call find_jumps(field, cloud, value, threshold, jumps)
    if (.not. any(jumps)) return
    averaged = jumps
    particle = pack([(int(i, ip), i=1, size(value))], jumps)
    call build_neighbour_list(cloud%x, cloud%y, [(radius*cloud%spacing, i=1, size(particle))], &
                              list, particle)
    averaged(list%index) = .true.
    particle = pack([(int(i, ip), i=1, size(value))], averaged)
    call grid%sample(field, body, cloud%x(particle), cloud%y(particle), cloud%spacing, threshold)
    !$omp parallel do schedule(dynamic, 16) default(shared) private(k)
    do k = 1, size(particle)
      associate (p => particle(k))
        deviation(p) = grid%mean_around([cloud%x(p), cloud%y(p)], radius*cloud%spacing, &
                                        value(p)) - value(p)
      end associate
    end do
    !$omp end parallel do
  end subroutine find_jump_errors

  !> At which particles a field jumps on the way to a neighbour.
  subroutine find_jumps(field, cloud, value, threshold, jumps)
    type(expression_t), intent(in) :: field
    type(cloud_t), intent(in) :: cloud
    !> The field at the particles, and the smallest jump that counts
    real(wp), intent(in) :: value(:), threshold
    logical, allocatable, intent(out) :: jumps(:)
    type(neighbour_list_t) :: list
    integer :: i, k

    allocate (jumps(size(value)), source=.false.)
    call build_neighbour_list(cloud%x, cloud%y, near*cloud%spacing, list)
    do i = 1, size(value)
      do k = int(list%first(i)), int(list%first(i + 1)) - 1
        associate (j => list%index(k))
          if (j < i .or. abs(value(j) - value(i)) < threshold .or. jumps(i) .and. jumps(j)) cycle
          if (.not. jumps_between(field, [cloud%x(i), cloud%y(i)], [cloud%x(j), cloud%y(j)], &
                                  value(i), value(j))) cycle
          jumps(i) = .true.
          jumps(j) = .true.
        end associate
      end do
    end do
  end subroutine find_jumps

  !> Whether a field jumps on the way from one place to another: bisection towards the larger
  !> difference ends at the jump, or shows that there is none.
  function jumps_between(field, a, b, value_a, value_b) result(jumps)
    type(expression_t), intent(in) :: field
    real(wp), intent(in) :: a(2), b(2), value_a, value_b
    logical :: jumps
    real(wp) :: from(2), to(2), middle(2), value_from, value_to, value
    integer :: k

    from = a
    to = b
    value_from = value_a
    value_to = value_b
    do k = 1, halvings
      middle = 0.5_wp*(from + to)
      call field%evaluate(middle(1), middle(2), 0.0_wp, value=value)
      jumps = ieee_is_finite(value)
      if (.not. jumps) return
      if (abs(value - value_from) > abs(value_to - value)) then
        to = middle
        value_to = value
      else
        from = middle
        value_from = value
      end if
      jumps = abs(value_to - value_from) > kept_part*abs(value_b - value_a)
      if (.not. jumps) return
    end do
  end function jumps_between

  !> Sample a field on a grid about given places.
  subroutine sample(this, field, body, x, y, spacing, threshold)
    class(grid_t), intent(out) :: this
    type(expression_t), intent(in) :: field
    !> What lies outside of it does not count
    type(body_t), intent(in) :: body
    !> Places within whose discs the field is needed, and the distance of particles, m
    real(wp), intent(in) :: x(:), y(:), spacing
    !> Cells across which it changes by more are looked at closely
    real(wp), intent(in) :: threshold
    real(wp), allocatable :: value(:, :), column_x(:), column_y(:)
    real(wp) :: cell_x(samples**2), cell_y(samples**2), cell_value(samples**2)
    real(wp) :: change
    integer :: columns, rows, i, j, k

    this%spacing = spacing/fineness
    this%x = minval(x) - radius*spacing
    this%y = minval(y) - radius*spacing
    columns = 1 + ceiling((maxval(x) + radius*spacing - this%x)/this%spacing)
    rows = 1 + ceiling((maxval(y) + radius*spacing - this%y)/this%spacing)
    allocate (value(rows, columns), this%counts(rows, columns), column_x(rows), column_y(rows))
    column_y = this%y + [(j - 1, j=1, rows)]*this%spacing
    do i = 1, columns
      column_x = this%x + (i - 1)*this%spacing
      call field%evaluate(column_x, column_y, 0.0_wp, values=value(:, i))
      do j = 1, rows
        this%counts(j, i) = ieee_is_finite(value(j, i))
        if (.not. this%counts(j, i)) value(j, i) = 0
        if (this%counts(j, i)) this%counts(j, i) = body%contains_point([column_x(j), column_y(j)])
      end do
    end do
    this%mean = value
    do i = 2, columns - 1
      do j = 2, rows - 1
        change = max(maxval(abs(value(j - 1:j + 1, i) - value(j, i))), &
                     maxval(abs(value(j, i - 1:i + 1) - value(j, i))))
        if (.not. this%counts(j, i) .or. change < threshold) cycle
        do k = 1, size(cell_x)
          cell_x(k) = this%x + (i - 1.5_wp + (mod(k - 1, samples) + 0.5_wp)/samples)*this%spacing
          cell_y(k) = this%y + (j - 1.5_wp + ((k - 1)/samples + 0.5_wp)/samples)*this%spacing
        end do
        call field%evaluate(cell_x, cell_y, 0.0_wp, values=cell_value)
        if (all(ieee_is_finite(cell_value))) this%mean(j, i) = sum(cell_value)/size(cell_value)
      end do
    end do
  end subroutine sample

  !> The value at the middle of a disc of the cubic polynomial that fits a field best in it.
  function mean_around(this, middle, extent, own_value) result(mean)
    class(grid_t), intent(in) :: this
    !> Middle and radius of the disc, m
    real(wp), intent(in) :: middle(2), extent
    !> The field in the middle
    real(wp), intent(in) :: own_value
    real(wp) :: mean
    real(wp) :: matrix(monomials, monomials), moment(monomials), work(2*monomials), p(monomials)
    real(wp) :: x, y, weight
    integer :: i, j, k, info, rank, pivot(monomials)

    matrix = 0
    moment = 0
    do i = 1 + ceiling((middle(1) - extent - this%x)/this%spacing), &
        1 + floor((middle(1) + extent - this%x)/this%spacing)
      x = (this%x + (i - 1)*this%spacing - middle(1))/extent
      do j = 1 + ceiling((middle(2) - extent - this%y)/this%spacing), &
          1 + floor((middle(2) + extent - this%y)/this%spacing)
        y = (this%y + (j - 1)*this%spacing - middle(2))/extent
        if (x**2 + y**2 >= 1 .or. .not. this%counts(j, i)) cycle
        weight = (1 - x**2 - y**2)**2
        p = [1.0_wp, x, y, x**2, x*y, y**2, x**3, x**2*y, x*y**2, y**3]
        do k = 1, monomials
          matrix(k:, k) = matrix(k:, k) + weight*p(k)*p(k:)
        end do
        moment = moment + weight*(this%mean(j, i) - own_value)*p
      end do
    end do
    mean = own_value
    call dpstrf('L', monomials, matrix, monomials, pivot, rank, 1.0e-9_wp*matrix(1, 1), work, info)
    if (rank < monomials) return
    work(:monomials) = moment(pivot)
    call dpotrs('L', monomials, 1, matrix, monomials, work, monomials, info)
    mean = own_value + work(findloc(pivot, 1, dim=1))
  end function mean_around

end module calor_initial_jumps
