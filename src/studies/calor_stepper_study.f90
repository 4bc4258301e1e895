!> What time integrators cost against what was foreseen.
!>
!> Each scene is run by every method that takes it, three times, and the fastest run counts: what
!> else the machine does can only add to it. Counted is the processor's time, which on one thread
!> is that of the steps alone, even where other programs run.
module calor_stepper_study
  use calor_error, only: error_t
  use calor_kinds, only: wp
  use calor_method_choice, only: method_choice_t, seconds_text
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene
  use calor_simulation, only: simulation_t
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: write_stepper_table, stepper_scene, stepper_scene_name, stepper_scenes

  !> Number of scenes; the first is small enough for a test
  integer, parameter :: stepper_scenes = 14

  character(len=*), parameter :: &
    plate = '&domain x_range = 0, 1 y_range = 0, 1 arrangement = "jittered" jitter = 0.2 ', &
    bump = '&initial temperature_expression = "sin(pi*x)*sin(pi*y)" / ', &
    jump = '&initial temperature_expression = "x > 0.5" / ', &
    cold = '&boundary on = "all" kind = "temperature" value = 0 / ', &
    closed = '&boundary on = "all" kind = "insulated" / ', &
    hot_right = '&initial temperature = 300 / '//closed// &
    '&boundary on = "left" kind = "temperature" value = 300 / '// &
    '&boundary on = "right" kind = "radiation" emissivity = 1 ambient = 800 / '

contains

  !> In a few words
  pure function stepper_scene_name(number) result(name)
    integer, intent(in) :: number
    character(len=:), allocatable :: name

    select case (number)
    case (1)
      name = 'plate, 441 particles, order 2'
    case (2)
      name = 'plate, 1,681, order 4'
    case (3)
      name = 'plate, 1,681, order 6, tolerance 1e-7'
    case (4)
      name = 'plate, 40,401, order 2, t = 0.01 s'
    case (5)
      name = 'lattice, 10,201, order 2'
    case (6)
      name = 'insulated slab with a jump, 1,681, t = 1 s'
    case (7)
      name = 'insulated slab with a jump, 10,201, t = 10 s'
    case (8)
      name = 'disc with convection, 3,000, t = 0.5 s'
    case (9)
      name = 'plate with radiation, 1,681, t = 1 s'
    case (10)
      name = 'plate with radiation, 1,681, order 4, t = 1 s'
    case (11)
      name = 'wall that swings as sin(20 t), 1,681, t = 2 s'
    case (12)
      name = 'the same around a wall with convection'
    case (13)
      name = 'source that swings as 1 + sin(20 t), 1,681, t = 2 s'
    case default
      name = 'two slabs, conductivities 1 and 1000, 1,681, t = 0.05 s'
    end select
  end function stepper_scene_name

  !> One of the scenes, as text, for a method.
  pure function stepper_scene(number, method) result(text)
    integer, intent(in) :: number
    character(len=*), intent(in) :: method
    character(len=:), allocatable :: text

    select case (number)
    case (1)
      text = plate//'spacing = 0.05 / &scheme laplacian = "consistent" order = 2 / '//bump//cold// &
             '&time end = 0.05 '
    case (2)
      text = plate//'spacing = 0.025 / &scheme laplacian = "consistent" order = 4 / '//bump// &
             cold//'&time end = 0.05 '
    case (3)
      text = plate//'spacing = 0.025 / &scheme laplacian = "consistent" order = 6 / '//bump// &
             cold//'&time end = 0.05 tolerance = 1e-7 '
    case (4)
      text = plate//'spacing = 0.005 / &scheme laplacian = "consistent" order = 2 / '//bump// &
             cold//'&time end = 0.01 '
    case (5)
      text = '&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.01 / &scheme laplacian = '// &
             '"fatehi_manzari" / '//bump//cold//'&time end = 0.05 '
    case (6)
      text = plate//'spacing = 0.025 / &scheme laplacian = "consistent" order = 2 / '//jump// &
             closed//'&time end = 1 '
    case (7)
      text = plate//'spacing = 0.01 / &scheme laplacian = "consistent" order = 2 / '//jump// &
             closed//'&time end = 10 '
    case (8)
      text = '&domain shape = "disc" centre = 0, 0 radius = 1 spacing = 0.0325 / '// &
             '&scheme laplacian = "fatehi_manzari" / &initial temperature = 1 / '// &
             '&boundary on = "all" kind = "convection" coefficient = 2 ambient = 0 / '// &
             '&time end = 0.5 '
    case (9)
      text = plate//'spacing = 0.025 / &scheme laplacian = "fatehi_manzari" / '//hot_right// &
             '&time end = 1 '
    case (10)
      text = plate//'spacing = 0.025 / &scheme laplacian = "consistent" order = 4 / '// &
             hot_right//'&time end = 1 '
    case (11)
      text = plate//'spacing = 0.025 / &scheme laplacian = "fatehi_manzari" / '// &
             '&initial temperature = 0 / '//closed//'&boundary on = "left" '// &
             'kind = "temperature" value_expression = "sin(20*t)" / &time end = 2 '
    case (12)
      text = plate//'spacing = 0.025 / &scheme laplacian = "fatehi_manzari" / '// &
             '&initial temperature = 0 / '//closed//'&boundary on = "left" '// &
             'kind = "convection" coefficient = 10 ambient_expression = "sin(20*t)" / '// &
             '&time end = 2 '
    case (13)
      text = plate//'spacing = 0.025 / &scheme laplacian = "fatehi_manzari" / '// &
             '&initial temperature = 0 / '//cold//'&source power_expression = '// &
             '"10*(1 + sin(20*t))*exp(-((x-0.5)^2 + (y-0.5)^2)/0.02)" / &time end = 2 '
    case default
      text = plate//'spacing = 0.025 / &scheme laplacian = "consistent" order = 2 / '// &
             '&initial temperature_expression = "1 - x" / &material conductivity = 1 / '// &
             '&material conductivity = 1000 where_expression = "x > 0.5" / '//closed// &
             '&boundary on = "left" kind = "temperature" value = 1 / '// &
             '&boundary on = "right" kind = "temperature" value = 0 / &time end = 0.05 '
    end select
    text = text//'method = "'//method//'" / '
  end function stepper_scene

  !> Write the table in Markdown.
  subroutine write_stepper_table(unit, all_scenes, error)
    !> Where to
    integer, intent(in) :: unit
    !> Whether all scenes are run, or the smallest alone
    logical, intent(in) :: all_scenes
    !> A scene could not be run
    type(error_t), allocatable, intent(out) :: error
    type(simulation_t), allocatable :: simulation
    type(method_choice_t) :: choice
    integer :: number, k, measured_steps
    real(wp) :: seconds

    write (unit, '(a)') '| scene | method | steps: foreseen | taken | seconds: foreseen | '// &
      'measured | ratio |', '|---|---|---|---|---|---|---|'
    do number = 1, merge(stepper_scenes, 1, all_scenes)
      allocate (simulation)
      call prepare(number, 'auto', simulation, error)
      if (allocated(error)) return
      choice = simulation%choice
      deallocate (simulation)
      do k = 1, size(choice%costs)
        associate (cost => choice%costs(k))
          call measure(number, trim(cost%name), measured_steps, seconds, error)
          if (allocated(error)) return
          write (unit, '(a)') '| '//trim(merge(stepper_scene_name(number)//'   ', &
                                               repeat(' ', len(stepper_scene_name(number)) + 3), &
                                               k == 1))//' | '//mark(k == 1, trim(cost%name))// &
            ' | '//trim(merge('≤ ', '    ', cost%at_most))//to_text(anint(cost%steps), digits=3)// &
            ' | '//to_text(measured_steps)//' | '//seconds_text(cost%seconds)//' | '// &
            seconds_text(seconds)//' | '//to_text(cost%seconds/seconds, digits=2)//' |'
        end associate
      end do
    end do
  end subroutine write_stepper_table

  !> The chosen method in bold type
  pure function mark(chosen, name) result(text)
    logical, intent(in) :: chosen
    character(len=*), intent(in) :: name
    character(len=:), allocatable :: text

    text = '`'//name//'`'
    if (chosen) text = '**'//text//'**'
  end function mark

  subroutine prepare(number, method, simulation, error)
    integer, intent(in) :: number
    character(len=*), intent(in) :: method
    type(simulation_t), intent(inout) :: simulation
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene

    call interpret_scene(stepper_scene(number, method), scene, error)
    if (.not. allocated(error)) call simulation%prepare(scene, error)
  end subroutine prepare

  !> The fastest of three runs
  subroutine measure(number, method, steps, seconds, error)
    integer, intent(in) :: number
    character(len=*), intent(in) :: method
    integer, intent(out) :: steps
    real(wp), intent(out) :: seconds
    type(error_t), allocatable, intent(out) :: error
    type(simulation_t), allocatable :: simulation
    real(wp) :: began, ended
    integer :: run

    seconds = huge(seconds)
    do run = 1, 3
      allocate (simulation)
      call prepare(number, method, simulation, error)
      if (allocated(error)) return
      call cpu_time(began)
      call simulation%advance_to(simulation%scene%time%end, error)
      call cpu_time(ended)
      if (allocated(error)) return
      steps = simulation%stepper%steps
      seconds = min(seconds, ended - began)
      deallocate (simulation)
    end do
  end subroutine measure

end module calor_stepper_study
