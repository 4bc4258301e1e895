!> Which of several offers are worth taking where two things count, both the less the better.
module calor_pareto_front
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: on_pareto_front

contains

  !> Whether no other point is at least as good in both and better in one: O(n²). Of equal points
  !> all are on the front.
  pure function on_pareto_front(cost, deviation) result(front)
    !> What each point costs
    real(wp), intent(in) :: cost(:)
    !> Its error, in the same order
    real(wp), intent(in) :: deviation(:)
    logical :: front(size(cost))
    integer :: k

    do k = 1, size(cost)
      front(k) = .not. any(cost <= cost(k) .and. deviation <= deviation(k) .and. &
                           (cost < cost(k) .or. deviation < deviation(k)))
    end do
  end function on_pareto_front

end module calor_pareto_front
