!> Particle volumes from how densely particles lie.
module calor_volume
  use calor_constants, only: worth_threads
  use calor_cloud, only: cloud_t
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, i8
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  implicit none (type, external)
  private

  public :: volumes_from_kernel

contains

  !> Give each particle the volume 1/ΣW, the sum taken over its neighbours and itself.
  !>
  !> In the midst of a lattice that is the volume of a cell; at walls it is more, as there are no
  !> neighbours beyond them.
  subroutine volumes_from_kernel(cloud, kernel, support_radius)
    !> The cloud, whose volumes are replaced
    type(cloud_t), intent(inout) :: cloud
    !> The kernel W
    class(kernel_t), intent(in) :: kernel
    !> The radius of its support, m
    real(wp), intent(in) :: support_radius
    type(neighbour_list_t) :: list
    real(wp), allocatable :: q(:), f(:), df(:), ddf(:)
    integer(i8) :: begin
    integer :: i, k, number, longest

    call build_neighbour_list(cloud%x, cloud%y, support_radius, list)
    if (.not. allocated(cloud%volume)) allocate (cloud%volume(cloud%particles()))
    longest = list%longest_row() + 1
    !$omp parallel if (list%rows() > worth_threads) default(none) &
    !$omp private(q, f, df, ddf, i, k, begin, number) &
    !$omp shared(cloud, kernel, support_radius, list, longest)
    allocate (q(longest), f(longest), df(longest), ddf(longest))
    !$omp do schedule(static)
    do i = 1, list%rows()
      begin = list%first(i)
      number = int(list%first(i + 1) - begin) + 1
      q(1) = 0
      do k = 2, number
        associate (j => list%index(begin + k - 2))
          q(k) = hypot(cloud%x(i) - cloud%x(j), cloud%y(i) - cloud%y(j))/support_radius
        end associate
      end do
      call kernel%profile(q(:number), f(:number), df(:number), ddf(:number))
      cloud%volume(i) = support_radius**2/sum(f(:number))
    end do
    !$omp end do
    deallocate (q, f, df, ddf)
    !$omp end parallel
  end subroutine volumes_from_kernel

end module calor_volume
