!> Fields about the rows of particles, for output files.
module calor_row_fields
  use calor_kinds, only: wp, ip
  use calor_row_report, only: row_report_t
  use calor_stable_rows, only: row_repairs_t
  implicit none (type, external)
  private

  public :: find_row_field, is_row_field

  character(len=*), parameter :: names(*) = [character(len=19) :: 'row_quality', 'row_repair', &
      'neighbours', 'support_radius', 'condition_gradient', 'condition_laplacian']
  !> The worst quality of a row that is written
  real(wp), parameter :: worst_quality = 1.0e6_wp

contains

  !> Whether a field is about rows; every other one changes with time.
  pure function is_row_field(name) result(answer)
    character(len=*), intent(in) :: name
    logical :: answer

    answer = any(names == name)
  end function is_row_field

  !> Held particles have no row: 0, but for the support radius.
  pure subroutine find_row_field(name, target, report, repairs, radius, field)
    !> Name of the field
    character(len=*), intent(in) :: name
    !> The particle of each row, and what is known of the rows
    integer(ip), intent(in) :: target(:)
    type(row_report_t), intent(in) :: report
    type(row_repairs_t), intent(in) :: repairs
    !> Support radius of each particle, m
    real(wp), intent(in) :: radius(:)
    !> One value for each particle
    real(wp), intent(out) :: field(:)

    field = 0
    select case (name)
    case ('row_quality')
      field(target) = min(repairs%quality%ratio, worst_quality)
    case ('row_repair')
      field(target) = repairs%repair
    case ('neighbours')
      field(target) = repairs%quality%neighbours
    case ('support_radius')
      field = radius
    case ('condition_gradient')
      field(target) = report%condition_gradient
    case ('condition_laplacian')
      field(target) = report%condition_laplacian
    case default
      continue
    end select
  end subroutine find_row_field

end module calor_row_fields
