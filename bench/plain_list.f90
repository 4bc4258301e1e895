!> A neighbour list as the shortest program makes it, to measure others by.
module plain_list
  use calor_huge_pages, only: prefer_huge_pages
  use calor_kinds, only: wp, ip, i8
  use calor_neighbour_list, only: neighbour_list_t
  implicit none (type, external)
  private

  public :: build_plain_list

contains

  !> The cell list of a textbook, for points in the unit square: sorted by cells as large as the
  !> radius, neighbours counted, then written down as they come.
  subroutine build_plain_list(x, y, radius, list)
    real(wp), intent(in) :: x(:), y(:), radius
    type(neighbour_list_t), intent(out) :: list
    integer(ip), allocatable :: cell(:), first(:), point(:), begin(:)
    real(wp), allocatable :: sorted_x(:), sorted_y(:)
    integer :: across, i, k, n, pass

    n = size(x)
    across = int(1/radius)
    allocate (cell(n), first(0:across**2), point(n), sorted_x(n), sorted_y(n))
    first = 0
    do i = 1, n
      cell(i) = min(int(x(i)*across), across - 1) + across*min(int(y(i)*across), across - 1) + 1
      first(cell(i)) = first(cell(i)) + 1
    end do
    do k = 1, across**2
      first(k) = first(k) + first(k - 1)
    end do
    begin = first(:across**2 - 1)
    do i = 1, n
      begin(cell(i)) = begin(cell(i)) + 1
      point(begin(cell(i))) = i
    end do
    sorted_x = x(point)
    sorted_y = y(point)
    allocate (list%first(n + 1))
    do pass = 1, 2
      !$omp parallel do schedule(dynamic, 64) default(shared)
      do k = 1, across**2
        call search_cell(k, pass == 2)
      end do
      !$omp end parallel do
      if (pass == 2) exit
      list%first(1) = 1
      do i = 1, n
        list%first(i + 1) = list%first(i) + list%first(i + 1)
      end do
      allocate (list%index(list%first(n + 1) - 1))
      call prefer_huge_pages(list%index)
    end do

  contains

    subroutine search_cell(k, fill)
      integer, intent(in) :: k
      logical, intent(in) :: fill
      integer(i8) :: place
      integer :: column, from, own, other, row, row_of_cells, to

      column = mod(k - 1, across)
      row_of_cells = (k - 1)/across
      do own = first(k - 1) + 1, first(k)
        place = 0
        if (fill) place = list%first(point(own)) - 1
        do row = max(row_of_cells - 1, 0), min(row_of_cells + 1, across - 1)
          from = first(row*across + max(column - 1, 0)) + 1
          to = first(row*across + min(column + 1, across - 1) + 1)
          do other = from, to
            if ((sorted_x(other) - sorted_x(own))**2 + (sorted_y(other) - sorted_y(own))**2 >= &
                radius**2 .or. other == own) cycle
            place = place + 1
            if (fill) list%index(place) = point(other)
          end do
        end do
        if (.not. fill) list%first(point(own) + 1) = place
      end do
    end subroutine search_cell

  end subroutine build_plain_list

end module plain_list
