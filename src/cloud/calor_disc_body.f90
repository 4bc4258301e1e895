!> Discs and annuli.
module calor_disc_body
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_body, only: body_t, edge_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: wp, ip
  use calor_text, only: text_list, to_text
  implicit none (type, external)
  private

  public :: make_disc_body, make_annulus_body

  !> What is larger than this could overflow when it is squared
  real(wp), parameter :: largest = 1.0e100_wp

contains

  !> A disc, whose boundary is called 'outer'.
  pure subroutine make_disc_body(centre, radius, body, error)
    !> m
    real(wp), intent(in) :: centre(2), radius
    !> The disc
    type(body_t), intent(out) :: body
    !> Numbers that are not finite, or a radius that is not positive
    type(error_t), allocatable, intent(out) :: error

    if (.not. all(ieee_is_finite([centre, radius]))) then
      call raise(error, status_bad_input, 'centre and radius must be ordinary numbers.')
    else if (any(abs([centre, radius]) > largest)) then
      call raise(error, status_bad_input, 'centre and radius must not exceed 1e100.')
    else if (radius <= 0) then
      call raise(error, status_bad_input, 'radius = '//to_text(radius)//' must be positive.')
    end if
    if (allocated(error)) return
    body%edge = [edge_t(centre=centre, radius=radius, side=ibset(0_ip, 0))]
    body%first = [1, 2]
    body%boundary = text_list(['outer'])
    body%shape = 'disc'
  end subroutine make_disc_body

  !> What lies between two circles about one centre; its boundaries are 'outer' and 'inner'.
  pure subroutine make_annulus_body(centre, radius, inner_radius, body, error)
    !> m
    real(wp), intent(in) :: centre(2), radius, inner_radius
    !> The annulus
    type(body_t), intent(out) :: body
    !> Numbers that are not finite, or radii that are not 0 < inner_radius < radius
    type(error_t), allocatable, intent(out) :: error

    call make_disc_body(centre, radius, body, error)
    if (allocated(error)) return
    if (.not. ieee_is_finite(inner_radius)) then
      call raise(error, status_bad_input, 'inner_radius must be an ordinary number.')
    else if (inner_radius <= 0) then
      call raise(error, status_bad_input, 'inner_radius = '//to_text(inner_radius)// &
                 ' must be positive; without a hole the shape is a disc.')
    else if (inner_radius >= radius) then
      call raise(error, status_bad_input, 'inner_radius = '//to_text(inner_radius)// &
                 ' must be less than radius = '//to_text(radius)//'.')
    end if
    if (allocated(error)) return
    body%edge = [body%edge, edge_t(centre=centre, radius=inner_radius, sense=-1.0_wp, &
                                   side=ibset(0_ip, 1))]
    body%first = [1, 2, 3]
    body%boundary = text_list(['outer', 'inner'])
    body%shape = 'annulus'
  end subroutine make_annulus_body

end module calor_disc_body
