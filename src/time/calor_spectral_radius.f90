!> The spectral radius of an evolution's Jacobian, which limits explicit steps.
module calor_spectral_radius
  use calor_evolution, only: evolution_t
  use calor_kinds, only: wp, i8
  use calor_random, only: random_uniform
  use calor_sums, only: root_mean_square
  implicit none (type, external)
  private

  public :: estimate_spectral_radius

  !> The power iteration approaches the radius from below: its result is enlarged by this factor.
  real(wp), parameter :: safety = 1.05_wp
  !> It ends when the estimate has grown by less than this fraction in ten iterations …
  real(wp), parameter :: tolerance = 1.0e-3_wp
  !> … or after this many iterations
  integer, parameter :: most_iterations = 500

contains

  !> An estimate of the largest |λ|, on the safe side: by power iteration from a fixed irregular
  !> vector, enlarged by 5 %, and never more than a given bound.
  function estimate_spectral_radius(evolution, upper_bound) result(radius)
    !> Whose Jacobian
    class(evolution_t), intent(inout) :: evolution
    !> An upper bound of the radius, 1/s
    real(wp), intent(in) :: upper_bound
    !> Spectral radius, 1/s
    real(wp) :: radius
    real(wp), allocatable :: v(:), product(:)
    real(wp) :: norm, estimate, earlier
    integer :: k, iteration

    allocate (v(evolution%unknowns()), product(evolution%unknowns()))
    do k = 1, size(v)
      v(k) = random_uniform(1, int(k, i8)) - 0.5_wp
    end do
    call evolution%clear_prescribed(v)
    radius = 0
    estimate = 0
    earlier = 0
    norm = root_mean_square(v)
    if (.not. norm > 0) return
    v = v/norm
    do iteration = 1, most_iterations
      call evolution%jacobian_product(v, product)
      estimate = root_mean_square(product)
      if (.not. (estimate > 0 .and. estimate <= huge(estimate))) exit
      v = product/estimate
      if (mod(iteration, 10) == 0) then
        if (abs(estimate - earlier) <= tolerance*estimate) exit
        earlier = estimate
      end if
    end do
    radius = min(safety*estimate, upper_bound)
  end function estimate_spectral_radius

end module calor_spectral_radius
