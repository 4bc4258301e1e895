!> Where a body touches the world: its wall particles, each with the walls that it lies on.
module calor_wall_contacts
  use calor_kinds, only: wp, ip
  implicit none (type, external)
  private

  public :: wall_contacts_t

  !> A contact is a particle on one wall: at a corner a particle has two. Those of a particle stand
  !> together.
  type :: wall_contacts_t
    !> The particle, the wall (bit of `cloud_t%side`, from 0), and the boundary condition that
    !> holds there: a number among the scene's groups &boundary
    integer(ip), allocatable :: particle(:)
    integer, allocatable :: side(:), condition(:)
    !> Outward unit normal of the wall, one a column; not allocated where walls have none
    real(wp), allocatable :: normal(:, :)
    !> Length of wall that the contact stands for, m; not allocated where walls have none
    real(wp), allocatable :: length(:)
    !> Whether the condition there holds the temperature, and whether the particle is held: at a
    !> corner another condition may do that
    logical, allocatable :: holding(:), held(:)
    !> ∂(∇²u)/∂(∂u/∂n) in the particle's row, 1/m; 0 before the rows were assembled
    real(wp), allocatable :: weight(:)
  end type wall_contacts_t

end module calor_wall_contacts
