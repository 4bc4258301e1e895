!> How the error of the heat problem data/plate.nml falls with the spacing of the particles, for the
!> usual Laplacian and the paper's, on a lattice and on an irregular cloud.
!>
!> Prints relative L2 errors at t = 0.05 s as a Markdown table, which gnuplot reads as well.
program error_table
  use calor, only: error_t, read_scene, scene_t, simulation_t, wp
  implicit none (type, external)
  type(scene_t) :: plate
  type(error_t), allocatable :: error
  integer :: level

  call read_scene('data/plate.nml', plate, error)
  call stop_on(error)
  plate%output%file = ''
  ! The error in time shall not count beside the error in space.
  plate%time%tolerance = 1.0e-8_wp
  print '(a)', '| 1/Δ | brookshaw, lattice | fatehi_manzari, lattice '// &
    '| brookshaw, irregular | fatehi_manzari, irregular |'
  print '(a)', '|---|---|---|---|---|'
  do level = 0, 3
    associate (n => 10*2**level)
      print '(a,i0,4(a,es7.2e1),a)', '| ', n, &
        ' | ', plate_error(n, 0.0_wp, 'brookshaw'), &
        ' | ', plate_error(n, 0.0_wp, 'fatehi_manzari'), &
        ' | ', plate_error(n, 0.2_wp, 'brookshaw'), &
        ' | ', plate_error(n, 0.2_wp, 'fatehi_manzari'), ' |'
    end associate
  end do

contains

  function plate_error(n, jitter, laplacian) result(deviation)
    integer, intent(in) :: n
    real(wp), intent(in) :: jitter
    character(len=*), intent(in) :: laplacian
    real(wp) :: deviation
    type(scene_t) :: scene
    type(simulation_t) :: simulation

    scene = plate
    scene%domain%spacing = 1.0_wp/n
    scene%domain%jitter = jitter
    scene%laplacian = laplacian
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
