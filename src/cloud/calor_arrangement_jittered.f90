!> Particles displaced at random from the nodes of a lattice.
module calor_arrangement_jittered
  use calor_constants, only: worth_threads
  use calor_arrangement_lattice, only: arrange_lattice, lattice_intervals
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t
  use calor_kinds, only: wp, i8
  use calor_random, only: random_uniform
  use calor_slice, only: slice_t
  implicit none (type, external)
  private

  public :: arrange_jittered

contains

  !> Fill a rectangle with a lattice whose inner particles are displaced in both directions.
  !>
  !> Each displacement is evenly distributed and depends on the seed and the particle's number only;
  !> particles on walls stay where they are.
  subroutine arrange_jittered(x_range, y_range, spacing, jitter, seed, cloud, error, slice)
    !> Left and right, bottom and top edge, m
    real(wp), intent(in) :: x_range(2), y_range(2)
    !> Wanted distance of neighbours on the lattice, m
    real(wp), intent(in) :: spacing
    !> Largest displacement over the distance of neighbours, below 1/2
    real(wp), intent(in) :: jitter
    !> Which of all such clouds
    integer, intent(in) :: seed
    !> The particles; its boundaries are left to the caller
    type(cloud_t), intent(out) :: cloud
    !> There is not enough memory
    type(error_t), allocatable, intent(out) :: error
    !> Only a slice of it, by columns: its own particles, and on either side one column of others
    type(slice_t), intent(in), optional :: slice
    real(wp) :: reach_x, reach_y
    integer :: particle

    call arrange_lattice(x_range, y_range, spacing, cloud, error, slice)
    if (allocated(error)) return
    reach_x = jitter*(x_range(2) - x_range(1))/lattice_intervals(x_range, spacing)
    reach_y = jitter*(y_range(2) - y_range(1))/lattice_intervals(y_range, spacing)
    !$omp parallel do if (size(cloud%x) > worth_threads) default(none) &
    !$omp shared(cloud, reach_x, reach_y, seed) schedule(static)
    do particle = 1, size(cloud%x)
      if (cloud%side(particle) /= 0) cycle
      associate (counter => 2_i8*cloud%user_index(particle))
        cloud%x(particle) = cloud%x(particle) + reach_x*(2*random_uniform(seed, counter) - 1)
        cloud%y(particle) = cloud%y(particle) + reach_y*(2*random_uniform(seed, counter + 1) - 1)
      end associate
    end do
    !$omp end parallel do
  end subroutine arrange_jittered

end module calor_arrangement_jittered
