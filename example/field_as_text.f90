!> Runs a scene and prints where its particles are and how warm they end up: x y T, one a line,
!> followed by the liquid fraction where something melts.
!>
!>     field_as_text [SCENE]        SCENE is data/plate.nml unless given
!>
!> Lines that begin with # are for people; gnuplot and numpy.loadtxt pass over them.
program field_as_text
  use calor, only: error_t, read_scene, scene_t, simulation_t, wp
  implicit none (type, external)
  type(error_t), allocatable :: error
  type(scene_t) :: scene
  type(simulation_t) :: simulation
  character(len=1000) :: path
  real(wp), allocatable :: liquid(:)
  integer :: k

  path = 'data/plate.nml'
  if (command_argument_count() > 0) call get_command_argument(1, path)
  call read_scene(trim(path), scene, error)
  call stop_on(error)
  ! Nothing but the text is wanted.
  scene%output%file = ''
  call simulation%prepare(scene, error)
  call stop_on(error)
  call simulation%run(error)
  call stop_on(error)

  print '(a,f6.4,a)', '# t = ', simulation%time, ' s; x (m), y (m), temperature (K)'// &
    trim(merge(', liquid fraction', '                 ', simulation%scene%melts))
  liquid = simulation%liquid_fraction()
  do k = 1, simulation%cloud%particles()
    print '(4es17.9)', simulation%cloud%x(k), simulation%cloud%y(k), simulation%temperature(k), &
      liquid(k:min(k, size(liquid)))
  end do

contains

  subroutine stop_on(error)
    type(error_t), allocatable, intent(in) :: error

    if (.not. allocated(error)) return
    print '(a)', error%message
    error stop 1
  end subroutine stop_on

end program field_as_text
