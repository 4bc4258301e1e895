!> The Laplacian of a field of one's own on irregular particles, by any scheme.
program laplacian_of_a_field
  use calor
  implicit none (type, external)
  type(cloud_t) :: cloud
  type(neighbour_list_t) :: neighbours
  type(sparse_operator_t) :: laplacian
  class(kernel_t), allocatable :: kernel
  class(laplacian_scheme_t), allocatable :: scheme
  type(error_t), allocatable :: error
  real(wp), allocatable :: support(:), field(:), found(:), exact(:)
  integer :: k

  ! Particles on the unit square, displaced by up to 0.2 spacings
  call make_rectangle(x_range=[0.0_wp, 1.0_wp], y_range=[0.0_wp, 1.0_wp], spacing=0.02_wp, &
                      arrangement='jittered', jitter=0.2_wp, seed=1, cloud=cloud, error=error)
  if (allocated(error)) error stop error%message

  ! Each with its neighbours within 2.1 spacings
  support = [(2.1_wp*cloud%spacing, k=1, cloud%particles())]
  call build_neighbour_list(cloud%x, cloud%y, support, neighbours)

  field = exp(cloud%x)*sin(2*cloud%y)
  exact = -3*field
  allocate (found(cloud%particles()))

  call make_kernel('wendland_c2', kernel, error)
  if (allocated(error)) error stop error%message
  do k = 1, size(laplacian_choices)
    call make_laplacian_scheme(laplacian_choices(k)%name, scheme, error)
    if (allocated(error)) error stop error%message
    call scheme%assemble(kernel, cloud%x, cloud%y, cloud%volume, support, neighbours, laplacian)
    call laplacian%apply(field, found)
    print '(a,t28,a,f9.4)', trim(laplacian_choices(k)%name), 'relative L2 error', error_inside()
  end do

contains

  !> Over the particles that are not on a wall
  function error_inside() result(deviation)
    real(wp) :: deviation

    deviation = norm2(pack(found - exact, cloud%side == 0))/norm2(pack(exact, cloud%side == 0))
  end function error_inside

end program laplacian_of_a_field
