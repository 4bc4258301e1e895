!> From a scene's domain to its body.
module calor_scene_body
  use calor_body, only: body_t
  use calor_disc_body, only: make_disc_body, make_annulus_body
  use calor_error, only: error_t
  use calor_polygon_body, only: make_polygon_body
  use calor_rectangle_body, only: make_rectangle_body
  use calor_scene, only: domain_t
  implicit none (type, external)
  private

  public :: make_scene_body

contains

  !> Make the body of a domain of any shape but 'cloud'.
  subroutine make_scene_body(domain, body, error, key)
    !> The domain
    type(domain_t), intent(in) :: domain
    !> Its body
    type(body_t), intent(out) :: body
    !> Its numbers make no body
    type(error_t), allocatable, intent(out) :: error
    !> Which key of &domain is to blame
    character(len=:), allocatable, intent(out), optional :: key
    character(len=:), allocatable :: blamed
    logical :: in_hole

    select case (domain%shape)
    case ('disc')
      blamed = 'radius'
      call make_disc_body(domain%centre, domain%radius, body, error)
    case ('annulus')
      blamed = 'inner_radius'
      call make_annulus_body(domain%centre, domain%radius, domain%inner_radius, body, error)
    case ('polygon')
      call make_polygon_body(domain%vertices, domain%hole_vertices, body, error, in_hole)
      blamed = 'vertices'
      if (in_hole) blamed = 'hole_vertices'
    case default
      blamed = 'x_range'
      call make_rectangle_body(domain%x_range, domain%y_range, body, error)
    end select
    if (present(key)) key = blamed
  end subroutine make_scene_body

end module calor_scene_body
