!> Nodes of a grid that lie inside a body, well away from its walls.
module calor_inner_nodes
  use calor_body, only: body_t
  use calor_kinds, only: wp, i8
  use calor_random, only: random_uniform
  use calor_slice, only: slice_t
  implicit none (type, external)
  private

  public :: grid_t, nodes_inside

  !> Nodes in columns that cover a body; displaced at random if so wished
  type :: grid_t
    !> The first node, m
    real(wp) :: x = 0.0_wp, y = 0.0_wp
    !> Distances of columns and of nodes in a column, m
    real(wp) :: width = 0.0_wp, height = 0.0_wp
    !> How far every second column is shifted upwards, in heights
    real(wp) :: shift = 0.0_wp
    !> Numbers of the last column and of the last node of a column, counted from 0
    integer :: columns = 0, rows = 0
    !> Displacement of a node by up to so many widths and heights each way, and the seed
    real(wp) :: jitter = 0.0_wp
    integer :: seed = 1
    !> Whether a node counts by where it is displaced to. If not, it counts by where it was, and
    !> goes no further towards a wall than the clearance allows.
    logical :: free = .false.
  contains
    procedure, private :: node
    procedure, private :: displaced
    procedure, private :: kept
  end type grid_t

  !> Fewer columns are not worth starting threads for
  integer, parameter :: worth_sharing = 50

contains

  !> The nodes, displaced, of a grid that are inside a body and no nearer to its walls than the
  !> clearance; column by column, each from the bottom.
  !>
  !> A node's displacement depends on the seed and on its number in the grid, not on the threads.
  subroutine nodes_inside(grid, body, clearance, x, y, slice)
    !> The grid
    type(grid_t), intent(in) :: grid
    !> The body
    type(body_t), intent(in) :: body
    !> Least distance from a wall, m
    real(wp), intent(in) :: clearance
    !> Coordinates, m
    real(wp), allocatable, intent(out) :: x(:), y(:)
    !> Only those of a slice, by columns
    type(slice_t), intent(in), optional :: slice
    !> Where each column begins in x and y
    integer, allocatable :: first(:)
    real(wp) :: place(2)
    integer :: column, from, k, row, to
    logical :: inside

    ! Once to count the nodes of each column, and once more to put them
    from = 0
    to = grid%columns
    if (present(slice)) call slice%share(grid%columns + 1, from, to)
    allocate (first(from:to + 1), source=0)
    !$omp parallel do if (grid%columns > worth_sharing) schedule(dynamic) default(shared) &
    !$omp private(column, row, place, inside)
    do column = from, to
      do row = 0, grid%rows
        call grid%kept(body, clearance, column, row, place, inside)
        if (inside) first(column + 1) = first(column + 1) + 1
      end do
    end do
    !$omp end parallel do
    first(from) = 1
    do column = from, to
      first(column + 1) = first(column) + first(column + 1)
    end do
    allocate (x(first(to + 1) - 1), y(first(to + 1) - 1))
    !$omp parallel do if (grid%columns > worth_sharing) schedule(dynamic) default(shared) &
    !$omp private(column, row, place, inside, k)
    do column = from, to
      k = first(column)
      do row = 0, grid%rows
        call grid%kept(body, clearance, column, row, place, inside)
        if (.not. inside) cycle
        x(k) = place(1)
        y(k) = place(2)
        k = k + 1
      end do
    end do
    !$omp end parallel do
  end subroutine nodes_inside

  pure function node(this, column, row) result(place)
    class(grid_t), intent(in) :: this
    integer, intent(in) :: column, row
    real(wp) :: place(2)

    place = [this%x + column*this%width, &
             this%y + (row + this%shift*mod(column, 2))*this%height]
  end function node

  pure function displaced(this, column, row) result(way)
    class(grid_t), intent(in) :: this
    integer, intent(in) :: column, row
    real(wp) :: way(2)
    integer(i8) :: counter

    counter = 2*(int(column, i8)*(this%rows + 1_i8) + row)
    way = this%jitter*[this%width*(2*random_uniform(this%seed, counter) - 1), &
                       this%height*(2*random_uniform(this%seed, counter + 1) - 1)]
  end function displaced

  !> Where a node ends up, and whether it counts.
  pure subroutine kept(this, body, clearance, column, row, place, inside)
    class(grid_t), intent(in) :: this
    type(body_t), intent(in) :: body
    real(wp), intent(in) :: clearance
    integer, intent(in) :: column, row
    real(wp), intent(out) :: place(2)
    logical, intent(out) :: inside
    real(wp) :: distance, direction(2), new_distance, way(2)

    place = this%node(column, row)
    way = 0
    if (this%jitter > 0) way = this%displaced(column, row)
    if (this%free) place = place + way
    call body%find_wall(place, distance, direction)
    inside = distance >= clearance
    if (this%free .or. .not. inside .or. .not. this%jitter > 0) return
    call body%find_wall(place + way, new_distance, direction)
    ! The distance to a wall changes by no more than the way
    if (new_distance < clearance) way = way*((distance - clearance)/hypot(way(1), way(2)))
    place = place + way
  end subroutine kept

end module calor_inner_nodes
