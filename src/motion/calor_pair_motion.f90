!> How neighbouring particles move relative to each other: what decides when rows are made anew.
!>
!> Rows for isotropic operators depend on the distances between neighbours only, so that a motion
!> that keeps these, a rotation too, leaves them as they are.
module calor_pair_motion
  use calor_constants, only: worth_threads
  use calor_kinds, only: wp, i8
  use calor_neighbour_list, only: neighbour_list_t
  implicit none (type, external)
  private

  public :: strain_rate, largest_strain, find_closest

contains

  !> The largest |d'|/d of all pairs of neighbours, 1/s, d being their distance.
  function strain_rate(list, x, y, velocity_x, velocity_y) result(rate)
    !> The pairs
    type(neighbour_list_t), intent(in) :: list
    !> Places, m, and velocities, m/s
    real(wp), intent(in) :: x(:), y(:), velocity_x(:), velocity_y(:)
    real(wp) :: rate
    real(wp) :: dx, dy, squared
    integer(i8) :: k
    integer :: i

    rate = 0
    !$omp parallel do if (size(x) > worth_threads) schedule(static) default(shared) &
    !$omp private(i, k, dx, dy, squared) reduction(max:rate)
    do i = 1, size(x)
      do k = list%first(i), list%first(i + 1) - 1
        associate (j => list%index(k))
          dx = x(j) - x(i)
          dy = y(j) - y(i)
          squared = dx*dx + dy*dy
          rate = max(rate, abs(dx*(velocity_x(j) - velocity_x(i)) + &
                               dy*(velocity_y(j) - velocity_y(i)))/max(squared, tiny(squared)))
        end associate
      end do
    end do
    !$omp end parallel do
  end function strain_rate

  !> The largest |d - d₀|/d₀ of all pairs of neighbours, to first order.
  function largest_strain(list, from_x, from_y, x, y) result(strain)
    !> The pairs
    type(neighbour_list_t), intent(in) :: list
    !> Places before and now, m
    real(wp), intent(in) :: from_x(:), from_y(:), x(:), y(:)
    real(wp) :: strain
    real(wp) :: before
    integer(i8) :: k
    integer :: i

    strain = 0
    !$omp parallel do if (size(x) > worth_threads) schedule(static) default(shared) &
    !$omp private(i, k, before) reduction(max:strain)
    do i = 1, size(x)
      do k = list%first(i), list%first(i + 1) - 1
        associate (j => list%index(k))
          before = (from_x(j) - from_x(i))**2 + (from_y(j) - from_y(i))**2
          strain = max(strain, 0.5_wp*abs(((x(j) - x(i))**2 + (y(j) - y(i))**2) - before)/ &
                       max(before, tiny(before)))
        end associate
      end do
    end do
    !$omp end parallel do
  end function largest_strain

  !> The two neighbours nearest to each other.
  subroutine find_closest(list, x, y, first, second, distance)
    !> The pairs
    type(neighbour_list_t), intent(in) :: list
    !> Places, m
    real(wp), intent(in) :: x(:), y(:)
    !> The particles; 0 where there are no pairs
    integer, intent(out) :: first, second
    !> m
    real(wp), intent(out) :: distance
    real(wp) :: squared
    integer(i8) :: k
    integer :: i

    first = 0
    second = 0
    distance = huge(distance)
    do i = 1, size(x)
      do k = list%first(i), list%first(i + 1) - 1
        associate (j => list%index(k))
          squared = (x(j) - x(i))**2 + (y(j) - y(i))**2
          if (squared >= distance) cycle
          distance = squared
          first = i
          second = j
        end associate
      end do
    end do
    distance = sqrt(distance)
  end subroutine find_closest

end module calor_pair_motion
