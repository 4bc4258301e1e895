!> What a scheme makes of a cloud: the spectrum of the heat equation, the error, the repairs.
module calor_hard_cases
  use calor_cloud, only: cloud_t
  use calor_conduction, only: conduction_t
  use calor_constants, only: pi
  use calor_error, only: error_t
  use calor_kernel, only: kernel_t
  use calor_kernels, only: make_kernel
  use calor_kinds, only: wp, ip
  use calor_laplacian_scheme, only: laplacian_scheme_t
  use calor_laplacian_schemes, only: make_laplacian_scheme
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_rightmost_eigenvalue, only: jacobian_spectrum
  use calor_row_report, only: row_report_t
  use calor_stable_rows, only: assemble_stable_rows, row_repairs_t, as_written, no_stencil
  implicit none (type, external)
  private

  public :: hard_case_t, examine_cloud, assemble_conduction

  !> What was found on one cloud; lengths in spacings Δ, eigenvalues λ as λ Δ²
  type :: hard_case_t
    !> Real and imaginary parts of all eigenvalues of the Laplacian at the particles that are not
    !> held, times Δ²
    real(wp), allocatable :: real_part(:), imaginary_part(:)
    !> Relative L2 error of ∇² sin πx sin πy over those particles
    real(wp) :: error = 0.0_wp
    !> How many rows were left as written, have a grown support, and so on: see calor_stable_rows
    integer :: repairs(as_written:no_stencil) = 0
    !> The largest support radius
    real(wp) :: largest_support = 0.0_wp
  contains
    !> The largest real part of an eigenvalue, times Δ²
    procedure :: growth
    !> The smallest one
    procedure :: decay
    !> Number of rows that were repaired
    procedure :: repaired
  end type hard_case_t

contains

  pure function growth(this) result(rate)
    class(hard_case_t), intent(in) :: this
    real(wp) :: rate

    rate = maxval(this%real_part)
  end function growth

  pure function decay(this) result(rate)
    class(hard_case_t), intent(in) :: this
    real(wp) :: rate

    rate = minval(this%real_part)
  end function decay

  pure function repaired(this) result(number)
    class(hard_case_t), intent(in) :: this
    integer :: number

    number = sum(this%repairs(as_written + 1:))
  end function repaired

  !> Assemble a scheme on a cloud of the unit square and find its spectrum, densely: for a thousand
  !> particles or fewer.
  subroutine examine_cloud(cloud, scheme, support, support_growth, found, error)
    !> The cloud; temperatures are held at all particles on a side
    type(cloud_t), intent(in) :: cloud
    !> Name of the scheme
    character(len=*), intent(in) :: scheme
    !> Support radius in spacings
    real(wp), intent(in) :: support
    !> Whether poor rows are repaired
    logical, intent(in) :: support_growth
    !> What was found
    type(hard_case_t), intent(out) :: found
    !> There is no such scheme
    type(error_t), allocatable, intent(out) :: error
    type(conduction_t) :: conduction
    type(row_repairs_t) :: repairs
    real(wp), allocatable :: radius(:), field(:), laplacian(:)
    integer :: kind

    call assemble_conduction(cloud, scheme, support, support_growth, conduction, radius, repairs, &
                             error)
    if (allocated(error)) return
    call jacobian_spectrum(conduction, found%real_part, found%imaginary_part)
    found%real_part = found%real_part*cloud%spacing**2
    found%imaginary_part = found%imaginary_part*cloud%spacing**2
    do kind = as_written, no_stencil
      found%repairs(kind) = count(repairs%repair == kind)
    end do
    found%largest_support = maxval(radius)/cloud%spacing

    field = sin(pi*cloud%x)*sin(pi*cloud%y)
    allocate (laplacian(conduction%laplacian%rows()))
    call conduction%laplacian%apply(field, laplacian)
    associate (exact => -2*pi**2*field(conduction%laplacian%target))
      found%error = sqrt(sum((laplacian - exact)**2)/sum(exact**2))
    end associate
  end subroutine examine_cloud

  !> Heat conduction of diffusivity 1 m²/s on a cloud whose sides are held at 0.
  subroutine assemble_conduction(cloud, scheme, support, support_growth, conduction, radius, &
                                 repairs, error)
    !> The cloud
    type(cloud_t), intent(in) :: cloud
    !> Name of the scheme
    character(len=*), intent(in) :: scheme
    !> Support radius in spacings
    real(wp), intent(in) :: support
    !> Whether poor rows are repaired
    logical, intent(in) :: support_growth
    !> The heat equation
    type(conduction_t), intent(out) :: conduction
    !> Support radii in the end, m
    real(wp), allocatable, intent(out) :: radius(:)
    !> What was repaired; without support growth only `repair` is set
    type(row_repairs_t), intent(out) :: repairs
    !> There is no such scheme
    type(error_t), allocatable, intent(out) :: error
    class(kernel_t), allocatable :: kernel
    class(laplacian_scheme_t), allocatable :: operator
    type(neighbour_list_t) :: list
    type(row_report_t) :: report
    integer(ip), allocatable :: free(:)
    integer :: k

    call make_kernel('wendland_c2', kernel, error)
    if (allocated(error)) return
    call make_laplacian_scheme(scheme, operator, error)
    if (allocated(error)) return
    allocate (radius(cloud%particles()), source=support*cloud%spacing)
    free = pack([(int(k, ip), k=1, cloud%particles())], cloud%side == 0)
    if (support_growth) then
      call assemble_stable_rows(operator, kernel, cloud%x, cloud%y, cloud%volume, radius, free, &
                                conduction%laplacian, report, repairs)
    else
      call build_neighbour_list(cloud%x, cloud%y, radius(free), list, free)
      call operator%assemble(kernel, cloud%x, cloud%y, cloud%volume, radius, list, &
                             conduction%laplacian)
      allocate (repairs%repair(size(free)), source=as_written)
    end if
    conduction%diffusivity = 1
    allocate (conduction%medium%x, source=cloud%x)
    allocate (conduction%medium%y, source=cloud%y)
    allocate (conduction%user_index, source=cloud%user_index)
    allocate (conduction%prescribed(1))
    conduction%prescribed(1)%particle = pack([(int(k, ip), k=1, cloud%particles())], &
                                             cloud%side /= 0)
    allocate (conduction%prescribed(1)%temperature(size(conduction%prescribed(1)%particle)), &
              source=0.0_wp)
    call conduction%note_range([0.0_wp])
  end subroutine assemble_conduction

end module calor_hard_cases
