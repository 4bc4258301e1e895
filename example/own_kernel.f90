!> A smoothing kernel of one's own: (1 - q²)³, which has no name in calor.
module bell_kernel
  use calor, only: kernel_t, wp, pi
  implicit none (type, external)
  private
  public :: bell_t

  type, extends(kernel_t) :: bell_t
  contains
    procedure :: profile
  end type bell_t

contains

  !> f, f' and f'' with 2π ∫ f q dq = 1
  pure subroutine profile(this, q, f, df, ddf)
    class(bell_t), intent(in) :: this
    real(wp), intent(in) :: q(:)
    real(wp), intent(out) :: f(:), df(:), ddf(:)
    real(wp) :: p(size(q))

    p = max(0.0_wp, 1 - q**2)
    f = 4/pi*p**3
    df = -24/pi*q*p**2
    ddf = -24/pi*p*(p - 4*q**2)
  end subroutine profile

end module bell_kernel

!> The paper's Laplacian with that kernel: still exact for quadratic fields.
program own_kernel
  use calor
  use bell_kernel, only: bell_t
  implicit none (type, external)
  type(cloud_t) :: cloud
  type(neighbour_list_t) :: neighbours
  type(sparse_operator_t) :: laplacian
  class(laplacian_scheme_t), allocatable :: scheme
  type(error_t), allocatable :: error
  real(wp), allocatable :: support(:), found(:)

  call make_rectangle(x_range=[0.0_wp, 1.0_wp], y_range=[0.0_wp, 1.0_wp], spacing=0.05_wp, &
                      arrangement='jittered', jitter=0.2_wp, seed=1, cloud=cloud, error=error)
  if (allocated(error)) error stop error%message
  allocate (support(cloud%particles()), source=2.1_wp*cloud%spacing)
  allocate (found(cloud%particles()))
  call build_neighbour_list(cloud%x, cloud%y, support, neighbours)

  call make_laplacian_scheme('fatehi_manzari', scheme, error)
  if (allocated(error)) error stop error%message
  call scheme%assemble(bell_t(), cloud%x, cloud%y, cloud%volume, support, neighbours, laplacian)
  call laplacian%apply(cloud%x**2 + 3*cloud%x*cloud%y - 2*cloud%y**2, found)
  print '(a,es9.2)', 'largest error for a quadratic field: ', maxval(abs(found - (-2.0_wp)))
end program own_kernel
