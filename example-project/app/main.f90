!> A project outside calor: a scene is run, and then its cloud and temperature go through calor's
!> building blocks one by one.
program main
  use calor, only: build_neighbour_list, error_t, kernel_t, laplacian_scheme_t, &
                   make_kernel, make_laplacian_scheme, neighbour_list_t, read_scene, scene_t, &
                   simulation_t, sparse_operator_t, wp
  implicit none (type, external)
  type(scene_t) :: scene
  type(simulation_t) :: simulation
  type(neighbour_list_t) :: neighbours
  type(sparse_operator_t) :: laplacian
  class(kernel_t), allocatable :: kernel
  class(laplacian_scheme_t), allocatable :: scheme
  type(error_t), allocatable :: error
  real(wp), allocatable :: radius(:), change(:)
  character(len=200) :: path
  integer :: k

  ! The whole of calor: a scene, prepared and run.
  call get_command_argument(1, path)
  call read_scene(trim(path), scene, error)
  if (.not. allocated(error)) call simulation%prepare(scene, error)
  if (.not. allocated(error)) call simulation%run(error)
  if (allocated(error)) error stop error%message
  print '(a,f8.4)', 'warmest particle            ', maxval(simulation%temperature)

  ! Its parts: the Laplacian of the temperature, from nothing but coordinates and volumes.
  call make_kernel('wendland_c2', kernel, error)
  if (.not. allocated(error)) call make_laplacian_scheme('fatehi_manzari', scheme, error)
  if (allocated(error)) error stop error%message
  associate (cloud => simulation%cloud)
    radius = [(2.1_wp*cloud%spacing, k=1, cloud%particles())]
    change = 0*radius
    call build_neighbour_list(cloud%x, cloud%y, radius, neighbours)
    call scheme%assemble(kernel, cloud%x, cloud%y, cloud%volume, radius, neighbours, laplacian)
    call laplacian%apply(simulation%temperature, change)
    ! The plate's temperature is sin(πx) sin(πy) times a number, so its Laplacian is -2π² times it.
    print '(a,f8.4)', 'Laplacian / temperature     ', &
      dot_product(pack(change, cloud%side == 0), pack(simulation%temperature, cloud%side == 0))/ &
      sum(simulation%temperature**2)
  end associate
end program main
