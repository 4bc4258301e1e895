!> What several test modules need: clouds ready for operators, and reference tables.
module test_support
  use calor_rectangle_cloud, only: make_rectangle
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t
  use calor_gradient_scheme, only: gradient_scheme_t
  use calor_gradient_schemes, only: make_gradient_scheme
  use calor_kernel, only: kernel_t
  use calor_kernels, only: make_kernel
  use calor_kinds, only: wp, ip
  use calor_laplacian_scheme, only: laplacian_scheme_t
  use calor_laplacian_schemes, only: make_laplacian_scheme
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_row_report, only: row_report_t
  use calor_sparse_operator, only: sparse_operator_t
  implicit none (type, external)
  private

  public :: discretisation_t, unit_square

  !> A cloud with kernel, support radii and neighbours
  type :: discretisation_t
    real(wp), allocatable :: x(:), y(:), volume(:), radius(:)
    logical, allocatable :: inside(:)
    class(kernel_t), allocatable :: kernel
    type(neighbour_list_t) :: list
  contains
    !> Find the neighbours within a support radius
    procedure :: connect
    !> Rows of a gradient scheme
    procedure :: gradient
    !> Rows of a Laplacian scheme
    procedure :: laplacian
    !> Particles without a wall particle among their neighbours
    procedure :: whole_support
  end type discretisation_t

contains

  !> The unit square at spacing 1/n.
  function unit_square(n, arrangement, jitter, seed, kernel, support) result(this)
    integer, intent(in) :: n
    character(len=*), intent(in) :: arrangement
    real(wp), intent(in) :: jitter
    integer, intent(in) :: seed
    character(len=*), intent(in) :: kernel
    !> Support radius in units of the spacing
    real(wp), intent(in) :: support
    type(discretisation_t) :: this
    type(cloud_t) :: cloud
    type(error_t), allocatable :: failure

    call make_rectangle([0.0_wp, 1.0_wp], [0.0_wp, 1.0_wp], 1.0_wp/n, arrangement, jitter, seed, &
                        cloud, failure)
    this%x = cloud%x
    this%y = cloud%y
    this%volume = cloud%volume
    this%inside = cloud%side == 0
    call this%connect(kernel, support/n)
  end function unit_square

  subroutine connect(this, kernel, radius)
    class(discretisation_t), intent(inout) :: this
    character(len=*), intent(in) :: kernel
    real(wp), intent(in) :: radius
    type(error_t), allocatable :: failure

    call make_kernel(kernel, this%kernel, failure)
    allocate (this%radius(size(this%x)), source=radius)
    call build_neighbour_list(this%x, this%y, this%radius, this%list)
  end subroutine connect

  subroutine gradient(this, name, gradient_x, gradient_y)
    class(discretisation_t), intent(in) :: this
    character(len=*), intent(in) :: name
    type(sparse_operator_t), intent(out) :: gradient_x, gradient_y
    class(gradient_scheme_t), allocatable :: scheme
    type(error_t), allocatable :: failure

    call make_gradient_scheme(name, scheme, failure)
    call scheme%assemble(this%kernel, this%x, this%y, this%volume, this%radius, this%list, &
                         gradient_x, gradient_y)
  end subroutine gradient

  subroutine laplacian(this, name, operator, report, targets)
    class(discretisation_t), intent(in) :: this
    character(len=*), intent(in) :: name
    type(sparse_operator_t), intent(out) :: operator
    type(row_report_t), intent(out), optional :: report
    !> Only rows of these particles
    integer(ip), intent(in), optional :: targets(:)
    class(laplacian_scheme_t), allocatable :: scheme
    type(neighbour_list_t) :: list
    type(error_t), allocatable :: failure

    call make_laplacian_scheme(name, scheme, failure)
    list = this%list
    if (present(targets)) then
      call build_neighbour_list(this%x, this%y, this%radius(targets), list, targets)
    end if
    call scheme%assemble(this%kernel, this%x, this%y, this%volume, this%radius, list, operator, &
                         report)
  end subroutine laplacian

  function whole_support(this) result(whole)
    class(discretisation_t), intent(in) :: this
    logical, allocatable :: whole(:)
    integer :: k

    whole = this%inside
    do k = 1, size(whole)
      whole(k) = whole(k) .and. &
                 all(this%inside(this%list%index(this%list%first(k):this%list%first(k + 1) - 1)))
    end do
  end function whole_support

end module test_support
