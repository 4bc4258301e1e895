!> The heat driver: a scene as text, run, and its error.
program heat_in_ten_lines
  use calor
  implicit none (type, external)
  type(scene_t) :: scene
  type(simulation_t) :: plate
  type(error_t), allocatable :: error

  call interpret_scene( &
    '&scene exact_expression = ''sin(pi*x)*sin(pi*y)*exp(-2*pi^2*t)'' /'// &
    '&domain x_range = 0, 1  y_range = 0, 1  spacing = 0.025  arrangement = ''jittered'' /'// &
    '&initial temperature_expression = ''sin(pi*x)*sin(pi*y)'' /'// &
    '&boundary on = ''all''  kind = ''temperature''  value = 0 /'// &
    '&time end = 0.05 /', scene, error)
  if (.not. allocated(error)) call plate%prepare(scene, error)
  if (.not. allocated(error)) call plate%run(error)
  if (allocated(error)) error stop error%message
  print '(a,f7.4,a,f6.3,a)', 'The warmest particle is at ', maxval(plate%temperature), &
    ' after ', plate%time, ' s.'
  print '(a,es9.2)', 'relative L2 error ', plate%relative_l2_error()
end program heat_in_ten_lines
