!> Neighbour lists in first/index form.
module calor_neighbour_list
  use calor_kinds, only: wp, ip, i8
  implicit none (type, external)
  private

  public :: neighbour_list_t, build_neighbour_list

  !> For each row, the particles within its target particle's search radius.
  !>
  !> The neighbours of particle `target(row)` are `index(first(row):first(row + 1) - 1)`: all other
  !> particles strictly nearer than the search radius, in ascending order.
  type :: neighbour_list_t
    !> The particle whose neighbours a row lists
    integer(ip), allocatable :: target(:)
    !> Where each row begins in `index`; one element more than rows
    integer(i8), allocatable :: first(:)
    !> Neighbouring particles, row after row
    integer(ip), allocatable :: index(:)
  contains
    !> Number of rows
    procedure :: rows
    !> The largest number of neighbours that a row has
    procedure :: longest_row
  end type neighbour_list_t

  !> Find the neighbours of all particles, or of some.
  !>
  !> `call build_neighbour_list(x, y, radius, list)` with one radius for all, or with one for each
  !> row; with `targets`, only those particles get a row (their neighbours may be any particles).
  !> Particle j is listed for target i where |r_i - r_j|² < radius², so one radius for all gives
  !> symmetric lists, and particles at the same place are neighbours. A radius of zero or less
  !> finds none. Time and memory are O(N + neighbours) for every arrangement of particles; where
  !> radii differ, one sort of all particles is added for each octave (factor of 2) of radii in use.
  !> The result does not depend on the number of threads. Coordinates have to be finite.
  interface build_neighbour_list
    module subroutine build_with_one_radius(x, y, radius, list, targets)
      implicit none (type, external)
      !> Coordinates of all particles, m
      real(wp), intent(in) :: x(:), y(:)
      !> Search radius of every target, m
      real(wp), intent(in) :: radius
      !> One row for each target
      type(neighbour_list_t), intent(out) :: list
      !> The particles that get a row, in the order of the rows; without it all
      integer(ip), intent(in), optional :: targets(:)
    end subroutine build_with_one_radius

    module subroutine build_with_radii(x, y, radius, list, targets)
      implicit none (type, external)
      !> Coordinates of all particles, m
      real(wp), intent(in) :: x(:), y(:)
      !> Search radius of each row's target, m; as many as there are rows
      real(wp), intent(in) :: radius(:)
      !> One row for each target
      type(neighbour_list_t), intent(out) :: list
      !> The particles that get a row, in the order of the rows; without it all
      integer(ip), intent(in), optional :: targets(:)
    end subroutine build_with_radii
  end interface build_neighbour_list

contains

  pure function rows(this) result(number)
    class(neighbour_list_t), intent(in) :: this
    integer :: number

    number = size(this%target)
  end function rows

  pure function longest_row(this) result(number)
    class(neighbour_list_t), intent(in) :: this
    integer :: number
    integer :: row

    number = 0
    do row = 1, this%rows()
      number = max(number, int(this%first(row + 1) - this%first(row)))
    end do
  end function longest_row

end module calor_neighbour_list
