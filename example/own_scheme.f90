!> A Laplacian of one's own: the mean of 4 (u_j - u_i)/r², r in support radii as in all stencils.
module mean_difference
  use calor, only: row_laplacian_t, stencil_t, wp
  implicit none (type, external)
  public

  type, extends(row_laplacian_t) :: mean_difference_t
  contains
    procedure :: weights
  end type mean_difference_t

contains

  subroutine weights(this, stencil, weight, diagonal)
    class(mean_difference_t), intent(in) :: this
    type(stencil_t), intent(inout) :: stencil
    real(wp), intent(out) :: weight(:), diagonal

    weight = 4/(stencil%n*stencil%q(:stencil%n)**2)
    diagonal = -sum(weight)
  end subroutine weights

end module mean_difference

!> A good Laplacian on a lattice, and none off it: its error for sin(πx) sin(πy).
program own_scheme
  use calor
  use mean_difference, only: mean_difference_t
  implicit none (type, external)

  print '(a,f9.4)', 'on a lattice:', error_on('lattice')
  print '(a,f9.4)', 'off it:      ', error_on('jittered')

contains

  function error_on(arrangement) result(deviation)
    character(len=*), intent(in) :: arrangement
    real(wp) :: deviation
    type(mean_difference_t) :: scheme
    class(kernel_t), allocatable :: kernel
    type(cloud_t) :: cloud
    type(neighbour_list_t) :: neighbours
    type(sparse_operator_t) :: laplacian
    type(error_t), allocatable :: error
    real(wp), allocatable :: support(:), field(:), found(:)

    call make_rectangle([0.0_wp, 1.0_wp], [0.0_wp, 1.0_wp], 0.02_wp, arrangement, jitter=0.1_wp, &
                        seed=1, cloud=cloud, error=error)
    if (.not. allocated(error)) call make_kernel('wendland_c2', kernel, error)
    if (allocated(error)) error stop error%message
    allocate (support(cloud%particles()), found(cloud%particles()), source=1.5_wp*cloud%spacing)
    call build_neighbour_list(cloud%x, cloud%y, support, neighbours)
    call scheme%assemble(kernel, cloud%x, cloud%y, cloud%volume, support, neighbours, laplacian)
    field = sin(pi*cloud%x)*sin(pi*cloud%y)
    call laplacian%apply(field, found)
    deviation = norm2(pack(found/(-2*pi**2) - field, cloud%side == 0))/norm2(field)
  end function error_on

end program own_scheme
