!> Clouds that are hard on a scheme for the Laplacian.
!>
!> All fill the unit square, whose walls carry particles n to a side. They are plain clouds: what
!> a user's file might hold.
module calor_hard_clouds
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t
  use calor_kinds, only: wp, ip, i8
  use calor_random, only: random_uniform
  use calor_rectangle_cloud, only: make_rectangle
  implicit none (type, external)
  private

  public :: jittered_square, random_square, doubled_square, holed_square, graded_square

  !> Of so many particles inside a doubled square one has a twin …
  integer, parameter :: one_of = 7
  !> … at this distance, in spacings
  real(wp), parameter :: twin_distance = 1.0e-3_wp
  !> Radius of the voids of a holed square, in spacings
  real(wp), parameter :: void_radius = 3.0_wp
  !> How much the widest spacing of a graded square is larger than the narrowest
  real(wp), parameter :: grading = 20.0_wp
  !> Displacement of the particles of the holed, doubled and graded squares, in spacings
  real(wp), parameter :: usual_jitter = 0.2_wp

contains

  !> A lattice whose inner particles are displaced by up to `jitter` spacings each way.
  function jittered_square(n, jitter, seed) result(cloud)
    !> Spacings along an edge
    integer, intent(in) :: n
    !> Displacement in spacings, below 0.5
    real(wp), intent(in) :: jitter
    !> Which of all such clouds
    integer, intent(in) :: seed
    type(cloud_t) :: cloud
    type(error_t), allocatable :: impossible

    call make_rectangle([0.0_wp, 1.0_wp], [0.0_wp, 1.0_wp], 1.0_wp/n, 'jittered', jitter, seed, &
                        cloud, impossible)
  end function jittered_square

  !> Inner particles anywhere, however near to each other or to a wall: a Poisson process of as many
  !> particles as a lattice has.
  function random_square(n, seed) result(cloud)
    !> Spacings along an edge
    integer, intent(in) :: n
    !> Which of all such clouds
    integer, intent(in) :: seed
    type(cloud_t) :: cloud
    integer :: k

    cloud = jittered_square(n, 0.0_wp, seed)
    do k = 1, cloud%particles()
      if (cloud%side(k) /= 0) cycle
      cloud%x(k) = random_uniform(seed, 2_i8*k)
      cloud%y(k) = random_uniform(seed, 2_i8*k + 1)
    end do
  end function random_square

  !> Jitter 0.2, and every seventh inner particle has a twin at a thousandth of a spacing.
  function doubled_square(n, seed) result(cloud)
    !> Spacings along an edge
    integer, intent(in) :: n
    !> Which of all such clouds
    integer, intent(in) :: seed
    type(cloud_t) :: cloud
    integer, allocatable :: twin(:)
    real(wp) :: angle
    integer :: k, m

    cloud = jittered_square(n, usual_jitter, seed)
    twin = pack([(k, k=1, cloud%particles())], cloud%side == 0)
    twin = twin(1::one_of)
    cloud%volume(twin) = 0.5_wp*cloud%volume(twin)
    cloud%area(twin) = 0.5_wp*cloud%area(twin)
    m = cloud%particles()
    call cloud%reorder([(int(k, ip), k=1, m), int(twin, ip)])
    do k = 1, size(twin)
      angle = 6.2831853_wp*random_uniform(seed, -int(k, i8))
      cloud%x(m + k) = cloud%x(m + k) + twin_distance/n*cos(angle)
      cloud%y(m + k) = cloud%y(m + k) + twin_distance/n*sin(angle)
    end do
    cloud%user_index = [(int(k, ip), k=1, cloud%particles())]
  end function doubled_square

  !> Jitter 0.2, and no particle within three spacings of two places inside.
  function holed_square(n, seed) result(cloud)
    !> Spacings along an edge
    integer, intent(in) :: n
    !> Which of all such clouds
    integer, intent(in) :: seed
    type(cloud_t) :: cloud
    integer, allocatable :: kept(:)
    integer :: k

    cloud = jittered_square(n, usual_jitter, seed)
    kept = pack([(k, k=1, cloud%particles())], cloud%side /= 0 .or. &
                (hypot(cloud%x - 0.31_wp, cloud%y - 0.37_wp) > void_radius/n .and. &
                 hypot(cloud%x - 0.68_wp, cloud%y - 0.66_wp) > void_radius/n))
    call cloud%reorder(int(kept, ip))
    cloud%user_index = [(int(k, ip), k=1, cloud%particles())]
  end function holed_square

  !> Columns and rows whose spacing grows twentyfold from the left and from the bottom, the inner
  !> particles displaced by up to 0.2 of the cell about them. In two corners cells are twenty times
  !> longer than wide. Volumes are those of the cells.
  function graded_square(n, seed) result(cloud)
    !> Spacings along an edge
    integer, intent(in) :: n
    !> Which of all such clouds
    integer, intent(in) :: seed
    type(cloud_t) :: cloud
    real(wp) :: ratio
    integer :: k

    cloud = jittered_square(n, usual_jitter, seed)
    ratio = grading**(1.0_wp/(n - 1))
    do k = 1, cloud%particles()
      cloud%volume(k) = cloud%volume(k)*slope(cloud%x(k))*slope(cloud%y(k))
      cloud%area(k) = cloud%area(k)*slope(cloud%x(k))*slope(cloud%y(k))
    end do
    deallocate (cloud%wall_length)
    cloud%x = stretched(cloud%x)
    cloud%y = stretched(cloud%y)

  contains

    !> Spacings n, nearly exactly in geometric progression; 0 and 1 stay where they are.
    elemental function stretched(place)
      real(wp), intent(in) :: place
      real(wp) :: stretched

      stretched = (ratio**(n*place) - 1)/(ratio**n - 1)
      ! Walls stay exactly where they are.
      if (place >= 1) stretched = 1
    end function stretched

    elemental function slope(place)
      real(wp), intent(in) :: place
      real(wp) :: slope

      slope = n*log(ratio)*ratio**(n*place)/(ratio**n - 1)
    end function slope

  end function graded_square

end module calor_hard_clouds
