!> Checks that a cloud can be worked with.
module calor_cloud_check
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_cloud, only: cloud_t
  use calor_coincident, only: find_coincident
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: wp, ip
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: check_cloud

  !> Nearer than so many spacings, two particles count as being at the same place
  real(wp), parameter :: nearest_in_spacings = 1.0e-9_wp

contains

  !> Check that there are particles, with finite coordinates and positive volumes, no two of them at
  !> the same place.
  !>
  !> The message names particles by their numbers in the user's order. Takes O(N) time.
  subroutine check_cloud(cloud, error)
    !> The cloud
    type(cloud_t), intent(in) :: cloud
    !> What is wrong with it
    type(error_t), allocatable, intent(out) :: error
    integer(ip) :: first, second
    integer :: k

    if (cloud%particles() == 0) then
      call raise(error, status_bad_input, 'The cloud has no particles.')
      return
    end if
    do k = 1, cloud%particles()
      if (.not. (ieee_is_finite(cloud%x(k)) .and. ieee_is_finite(cloud%y(k)))) then
        call raise(error, status_bad_input, 'Particle '//to_text(cloud%user_index(k))// &
                   ' has a coordinate that is not a finite number.')
        return
      end if
      if (ieee_is_finite(cloud%volume(k))) then
        if (cloud%volume(k) > 0) cycle
      end if
      call raise(error, status_bad_input, 'Particle '//to_text(cloud%user_index(k))//' at '// &
                 place_of(cloud, k)//' has a volume that is not a positive number.')
      return
    end do

    call find_coincident(cloud%x, cloud%y, first, second, &
                         tolerance=nearest_in_spacings*cloud%spacing)
    if (first == 0) return
    associate (one => cloud%user_index(first), other => cloud%user_index(second))
      call raise(error, status_bad_input, 'Particles '//to_text(min(one, other))//' and '// &
                 to_text(max(one, other))//' are at the same place, '// &
                 place_of(cloud, int(first))//'. Remove one of them.')
    end associate
  end subroutine check_cloud

  !> Where a particle is, in words.
  pure function place_of(cloud, particle) result(text)
    type(cloud_t), intent(in) :: cloud
    integer, intent(in) :: particle
    character(len=:), allocatable :: text

    text = 'x = '//to_text(cloud%x(particle))//', y = '//to_text(cloud%y(particle))
  end function place_of

end module calor_cloud_check
