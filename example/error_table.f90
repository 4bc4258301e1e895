!> The error of the heat problem data/plate.nml with the usual Laplacian and with the paper's, on
!> lattices and irregular clouds, for particles 1/20, 1/40 and 1/80 m apart.
!>
!> Prints relative L2 errors at t = 0.05 s as a Markdown table.
program error_table
  use calor, only: error_t, read_scene, scene_t, simulation_t, wp
  implicit none (type, external)
  real(wp), parameter :: jitters(5) = [0.0_wp, 0.0_wp, 0.1_wp, 0.2_wp, 0.3_wp]
  real(wp), parameter :: supports(5) = [1.5_wp, 2.1_wp, 2.1_wp, 2.1_wp, 2.1_wp]
  type(scene_t) :: scene
  type(error_t), allocatable :: error
  character(len=3), parameter :: mark(3) = [' | ', ' / ', ' / ']
  integer :: k, level

  call read_scene('data/plate.nml', scene, error)
  call stop_on(error)
  scene%output%file = ''
  ! The error in time shall not count beside the error in space.
  scene%time%tolerance = 1.0e-8_wp
  print '(a)', '| jitter | h/Δ | brookshaw, 1/Δ = 20 / 40 / 80 | fatehi_manzari, 20 / 40 / 80 |'
  print '(a)', '|---|---|---|---|'
  do k = 1, 5
    scene%domain%jitter = jitters(k)
    scene%support = supports(k)
    print '(2(a,f3.1),2(a,es6.1e1,2(a,es6.1e1)),a)', '| ', jitters(k), ' | ', supports(k), &
      (mark(level), plate_error('brookshaw', 10*2**level), level=1, 3), &
      (mark(level), plate_error('fatehi_manzari', 10*2**level), level=1, 3), ' |'
  end do

contains

  function plate_error(laplacian, n) result(deviation)
    character(len=*), intent(in) :: laplacian
    integer, intent(in) :: n
    real(wp) :: deviation
    type(simulation_t) :: simulation

    scene%laplacian = laplacian
    scene%domain%spacing = 1.0_wp/n
    call simulation%prepare(scene, error)
    call stop_on(error)
    call simulation%run(error)
    call stop_on(error)
    deviation = simulation%relative_l2_error()
  end function plate_error

  subroutine stop_on(error)
    type(error_t), allocatable, intent(in) :: error

    if (.not. allocated(error)) return
    print '(a)', error%message
    error stop 1
  end subroutine stop_on

end program error_table
