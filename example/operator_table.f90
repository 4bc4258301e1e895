!> How well schemes find the Laplacian of sin πx sin πy, on lattices and irregular clouds:
!> modules called one by one, as by a program with particles of its own. Prints a Markdown table of
!> errors: root mean square over the particles without a wall in their support, relative to that of
!> the true Laplacian over all particles.
program operator_table
  use calor, only: build_neighbour_list, cloud_t, error_t, kernel_t, laplacian_scheme_t, &
                   make_kernel, make_laplacian_scheme, make_rectangle, neighbour_list_t, pi, &
                   sparse_operator_t, wp
  implicit none (type, external)
  character(len=15), parameter :: schemes(3) = &
      [character(len=15) :: 'brookshaw', 'double_gradient', 'fatehi_manzari']
  real(wp), parameter :: jitters(4) = [0.0_wp, 0.0_wp, 0.1_wp, 0.3_wp]
  real(wp), parameter :: supports(4) = [1.2_wp, 2.1_wp, 2.1_wp, 2.1_wp]
  character(len=3), parameter :: mark(3) = [' | ', ' / ', ' / ']
  integer :: k, level, scheme

  print '(a)', '| jitter | h/Δ | brookshaw, 1/Δ = 20 / 40 / 80 | double_gradient | fatehi_manzari |'
  print '(a)', '|---|---|---|---|---|'
  do k = 1, 4
    print '(2(a,f3.1),3(a,es6.1e1,2(a,es6.1e1)),a)', '| ', jitters(k), ' | ', supports(k), &
      ((mark(level), laplacian_error(10*2**level, jitters(k), supports(k), trim(schemes(scheme))), &
        level=1, 3), scheme=1, 3), ' |'
  end do

contains

  function laplacian_error(n, jitter, support, name) result(deviation)
    integer, intent(in) :: n
    real(wp), intent(in) :: jitter, support
    character(len=*), intent(in) :: name
    real(wp) :: deviation
    type(cloud_t) :: cloud
    class(kernel_t), allocatable :: kernel
    class(laplacian_scheme_t), allocatable :: scheme
    type(neighbour_list_t) :: list
    type(sparse_operator_t) :: laplacian
    type(error_t), allocatable :: error
    real(wp), allocatable :: radius(:), u(:), found(:)
    logical, allocatable :: whole(:)
    integer :: i

    call make_rectangle([0.0_wp, 1.0_wp], [0.0_wp, 1.0_wp], 1.0_wp/n, 'jittered', jitter, 1, &
                        cloud, error)
    call make_kernel('wendland_c2', kernel, error)
    call make_laplacian_scheme(name, scheme, error)
    allocate (radius(cloud%particles()), source=support/n)
    call build_neighbour_list(cloud%x, cloud%y, radius, list)
    call scheme%assemble(kernel, cloud%x, cloud%y, cloud%volume, radius, list, laplacian)
    u = sin(pi*cloud%x)*sin(pi*cloud%y)
    allocate (found(size(u)))
    call laplacian%apply(u, found)
    whole = [(cloud%side(i) == 0 .and. &
              all(cloud%side(list%index(list%first(i):list%first(i + 1) - 1)) == 0), i=1, size(u))]
    deviation = sqrt(sum((found + 2*pi**2*u)**2, whole)/count(whole))/ &
                sqrt(sum((2*pi**2*u)**2)/size(u))
  end function laplacian_error

end program operator_table
