!> Particles that lie at the same place.
module calor_coincident
  use calor_cell_list, only: cell_list_t, build_cell_list
  use calor_constants, only: worth_threads
  use calor_kinds, only: wp, ip, i8
  implicit none (type, external)
  private

  public :: find_coincident

contains

  !> Find the first particle that has another one at its place, and the first such other one.
  !>
  !> Takes O(N) time and memory. Coordinates have to be finite.
  subroutine find_coincident(x, y, first, second, tolerance)
    !> Coordinates, m
    real(wp), intent(in) :: x(:), y(:)
    !> The lower and the higher number of the pair; 0 if there is none
    integer(ip), intent(out) :: first, second
    !> Distance up to which two places count as the same, m; without it they have to be equal
    real(wp), intent(in), optional :: tolerance
    type(cell_list_t) :: cells
    real(wp) :: reach
    integer(ip) :: lowest, particle, partner

    first = 0
    second = 0
    reach = 0
    if (present(tolerance)) reach = tolerance
    call build_cells(x, y, reach, cells)
    lowest = size(x, kind=ip)
    !$omp parallel do if (size(x) > worth_threads) schedule(static) default(shared) &
    !$omp private(particle, partner) reduction(min: lowest)
    do particle = 1, size(x, kind=ip) - 1
      if (particle > lowest) cycle
      call find_partner(cells, particle, x(particle), y(particle), reach, partner)
      if (partner > 0) lowest = min(lowest, particle)
    end do
    !$omp end parallel do
    if (lowest == size(x)) return
    first = lowest
    call find_partner(cells, first, x(first), y(first), reach, second)
  end subroutine find_coincident

  !> Sort particles into cells so small that none holds many particles at different places.
  subroutine build_cells(x, y, reach, cells)
    real(wp), intent(in) :: x(:), y(:), reach
    type(cell_list_t), intent(out) :: cells
    integer(ip), parameter :: many = 64
    real(wp) :: height, width

    if (size(x) == 0) then
      call build_cell_list(x, y, reach, cells)
      return
    end if
    ! About one particle per cell does for most clouds, and keeps near particles near in memory
    width = maxval(x) - minval(x)
    height = maxval(y) - minval(y)
    call build_cell_list(x, y, max(reach, max(width, height)/size(x), &
                                   sqrt(width/size(x))*sqrt(height)), cells)
    if (maxval(cells%first(2:) - cells%first(:cells%buckets)) <= many) return
    call build_cell_list(x, y, reach, cells)
  end subroutine build_cells

  !> The lowest number above `particle` within a distance, or 0.
  pure subroutine find_partner(cells, particle, x, y, reach, partner)
    type(cell_list_t), intent(in) :: cells
    integer(ip), intent(in) :: particle
    real(wp), intent(in) :: x, y, reach
    integer(ip), intent(out) :: partner
    integer(ip) :: from(2), place, to(2)
    integer(i8) :: row
    integer :: range, ranges

    partner = 0
    do row = cells%row(y - reach), cells%row(y + reach)
      call cells%bucket_ranges(cells%column(x - reach), cells%column(x + reach), row, &
                               from, to, ranges)
      do range = 1, ranges
        do place = cells%first(from(range)), cells%first(to(range) + 1) - 1
          if (cells%particle(place) <= particle) cycle
          if (partner > 0 .and. cells%particle(place) >= partner) cycle
          if (abs(cells%x(place) - x) > reach .or. abs(cells%y(place) - y) > reach) cycle
          if (hypot(cells%x(place) - x, cells%y(place) - y) > reach) cycle
          partner = cells%particle(place)
        end do
      end do
    end do
  end subroutine find_partner

end module calor_coincident
