!> What will be simulated, and what has been, in plain words.
module calor_description
  use calor_choice, only: choice_t
  use calor_integrators, only: integrator_choices
  use calor_kinds, only: wp, i8
  use calor_laplacian_schemes, only: laplacian_choices
  use calor_memory_need, only: memory_need, further_need, size_text
  use calor_progress_line, only: bar
  use calor_scene, only: scene_t
  use calor_scene_file, only: group_t
  use calor_simulation, only: simulation_t
  use calor_stable_rows, only: as_written, support_grown, positive_stencil, inexact_stencil, &
                               no_stencil
  use calor_stopwatch, only: phase_t
  use calor_text, only: text_t, to_text, join, append
  implicit none (type, external)
  private

  public :: describe_plan, describe_result

  !> Width of the column of headings
  integer, parameter :: heading_width = 13
  !> A jump of the heat flux that is less than this part of it is no jump
  real(wp), parameter :: noticed_jump = 1.0e-3_wp

contains

  !> What a prepared simulation will do: particles, schemes, effects, steps, memory, file.
  function describe_plan(simulation) result(lines)
    !> A simulation after `prepare`
    type(simulation_t), intent(in) :: simulation
    type(text_t), allocatable :: lines(:)
    integer :: k

    allocate (lines(0))
    call add(lines, '', headline(simulation))
    if (simulation%scene%domain%shape /= 'cloud') call add(lines, 'Body', body(simulation))
    call add(lines, 'Particles', particles(simulation))
    call add(lines, 'Neighbours', neighbours(simulation))
    call add(lines, 'Laplacian', scheme(simulation%scene))
    if (any(simulation%report%condition_gradient > 0)) then
      call add(lines, 'Tensors', tensors(simulation))
    end if
    call add(lines, 'Rows', rows(simulation))
    if (any(simulation%repairs%repair /= as_written)) call add(lines, 'Repairs', &
                                                               repairs(simulation))
    if (.not. simulation%scene%time%steady) then
      call add(lines, 'Stability', stability(simulation))
    end if
    if (simulation%scene%uniform_material) then
      call add(lines, 'Diffusivity', to_text(simulation%conduction%diffusivity, digits=6)//' m2/s')
    else
      do k = 1, simulation%scene%file%count('material')
        call add(lines, 'Material', material(simulation%scene, k))
      end do
    end if
    call add(lines, 'Effects', effects(simulation))
    if (allocated(simulation%motion)) then
      call add(lines, 'Motion', 'rows follow the particles; a list of neighbours serves until '// &
               'one has moved by half of its skin of '//to_text(simulation%motion%skin, &
                                                                digits=3)//' m')
    end if
    if (simulation%scene%time%steady) then
      call add(lines, 'Time', 'steady state, by Newton''s method and a sparse direct solver')
    else
      call add(lines, 'Time', '0 to '//to_text(simulation%scene%time%end)//' s by '// &
             simulation%method//': '//summary(integrator_choices, simulation%method))
      if (allocated(simulation%choice)) then
        call add(lines, 'Why', simulation%choice%sentence())
      end if
      call add(lines, 'Steps', steps(simulation))
    end if
    call add(lines, 'Memory', 'about '//size_text(memory_need( &
             real(simulation%cloud%particles(), wp), simulation%mean_neighbours) + &
             further_need(simulation%scene, real(simulation%cloud%particles(), wp))))
    call add(lines, 'Output', output(simulation))
  end function describe_plan

  !> What the scene says of a material
  function material(scene, number) result(line)
    type(scene_t), intent(in) :: scene
    integer, intent(in) :: number
    character(len=:), allocatable :: line
    type(group_t) :: group
    integer :: k

    call scene%file%group('material', group, number)
    line = 'number '//to_text(number)
    do k = 1, size(group%entries)
      line = line//', '//group%entries(k)%key//' = '//group%entries(k)%values(1)%text
    end do
  end function material

  !> The scheme and what it is
  function scheme(scene) result(line)
    type(scene_t), intent(in) :: scene
    character(len=:), allocatable :: line

    if (scene%laplacian == 'consistent') then
      line = 'consistent of order '//to_text(scene%order)//': exact for polynomials up to '// &
             'degree '//to_text(scene%order + 1)
    else
      line = scene%laplacian//': '//summary(laplacian_choices, scene%laplacian)
    end if
  end function scheme

  !> Whether anything melts
  pure function melts(simulation) result(answer)
    type(simulation_t), intent(in) :: simulation
    logical :: answer

    answer = .false.
    if (.not. allocated(simulation%conduction%content)) return
    answer = any(simulation%conduction%content%law%melts)
  end function melts

  !> What a run did: steps, wall time by phase, the error if it is known, the file.
  function describe_result(simulation) result(lines)
    !> A simulation after `run`
    type(simulation_t), intent(in) :: simulation
    type(text_t), allocatable :: lines(:)
    integer :: k

    allocate (lines(0))
    call add(lines, 'Simulated', to_text(size(simulation%temperature))//' particles with '// &
             to_text(simulation%mean_neighbours, digits=3)//' neighbours on average, by '// &
             methods(simulation))
    if (simulation%scene%time%steady) then
      call add(lines, 'Steps', to_text(simulation%newton_steps)//' of Newton''s method')
    else
      associate (stepper => simulation%stepper)
        call add(lines, 'Steps', to_text(stepper%steps)//' steps to t = '// &
               to_text(simulation%time, digits=6)//' s, '// &
               to_text(stepper%integrator%evaluations)//' evaluations of the Laplacian')
      end associate
    end if
    call add(lines, 'Temperature', to_text(minval(simulation%temperature), digits=6)//' to '// &
             to_text(maxval(simulation%temperature), digits=6))
    if (melts(simulation)) then
      call add(lines, 'Liquid', to_text(100*sum(simulation%conduction%medium%area* &
             simulation%liquid_fraction())/sum(simulation%conduction%medium%area), digits=4)// &
             ' % of the body')
    end if
    if (size(simulation%entries) > 0) then
      call add(lines, 'Heat', &
               simulation%budget%words(simulation%entries(size(simulation%entries))))
    end if
    if (allocated(simulation%motion)) call add(lines, 'Motion', motion(simulation))
    if (simulation%estimates_error()) call add(lines, 'Estimate', estimate())
    if (simulation%knows_exact()) then
      call add(lines, 'Error', 'relative L2 error '// &
               to_text(simulation%relative_l2_error(), digits=3)//' at t = '// &
               to_text(simulation%time, digits=6)//' s')
    end if
    call add(lines, 'Wall time', to_text(simulation%stopwatch%total(), digits=3)//' s')
    do k = 1, size(simulation%stopwatch%phases)
      call append(lines, phase_line(simulation%stopwatch%phases(k), simulation%stopwatch%total()))
    end do
    associate (file => simulation%scene%output%file)
      if (file /= '') call add(lines, 'Written', file//' (open it in ParaView, or draw it: '// &
                               'calor plot '//file//')')
    end associate

  contains

    function estimate() result(text)
      character(len=:), allocatable :: text

      text = 'relative L2 error '//to_text(simulation%estimated_error(), digits=3)//', at most '// &
             to_text(simulation%estimated_maximum_error(), digits=3)//' K at a particle'
      if (simulation%scene%time%steady) return
      if (allocated(simulation%coarser)) then
        text = text//'; while fronts pass particles, root mean square, by a run with particles '// &
               'twice as far apart'
        return
      end if
      text = text//'; the estimates of the steps add up to '// &
             to_text(simulation%stepper%accumulated_error, digits=2)//' K'
      if (simulation%flux_jump > noticed_jump .and. simulation%scene%laplacian == 'consistent' &
          .and. simulation%scene%order > 2) then
        text = text//'; only roughly in it: how the heat flux, which jumps where materials '// &
               'touch at t = 0, becomes even'
      end if
    end function estimate

  end function describe_result

  !> The scheme in space and the method in time
  function methods(simulation) result(text)
    type(simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text

    text = simulation%scene%laplacian
    if (text == 'consistent') text = text//' of order '//to_text(simulation%scene%order)
    if (.not. simulation%scene%time%steady) text = text//' and '//simulation%method
  end function methods

  !> What part of the wall time a phase took, with a bar
  pure function phase_line(phase, total) result(line)
    type(phase_t), intent(in) :: phase
    real(wp), intent(in) :: total
    character(len=:), allocatable :: line
    integer, parameter :: number_width = 11, bar_width = 30
    real(wp) :: part

    part = 0
    if (total > 0) part = max(0.0_wp, min(1.0_wp, phase%seconds/total))
    line = to_text(phase%seconds, digits=2)//' s'
    line = '  '//phase%name//line//repeat(' ', max(1, number_width - len(line)))// &
           bar(part, bar_width, ' ')
    line = trim(line)
  end function phase_line

  subroutine add(lines, heading, content)
    type(text_t), allocatable, intent(inout) :: lines(:)
    character(len=*), intent(in) :: heading, content

    if (heading == '') then
      call append(lines, content)
    else
      call append(lines, heading//repeat(' ', heading_width - len(heading))//content)
    end if
  end subroutine add

  pure function summary(choices, name) result(text)
    type(choice_t), intent(in) :: choices(:)
    character(len=*), intent(in) :: name
    character(len=:), allocatable :: text
    integer :: k

    text = ''
    do k = 1, size(choices)
      if (choices(k)%name == name) text = trim(choices(k)%summary)
    end do
  end function summary

  function headline(simulation) result(text)
    type(simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text

    text = simulation%scene%path
    if (simulation%scene%title /= '') text = simulation%scene%title//' ('//text//')'
  end function headline

  function body(simulation) result(text)
    type(simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text

    associate (cloud => simulation%cloud)
      text = simulation%scene%domain%shape//', '//to_text(sum(cloud%area), digits=6)// &
             ' m2 in a boundary of '//to_text(sum(cloud%wall_length), digits=6)//' m'
    end associate
  end function body

  function particles(simulation) result(text)
    type(simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text

    associate (domain => simulation%scene%domain, cloud => simulation%cloud)
      text = to_text(cloud%particles())//', '//to_text(count(cloud%side /= 0))// &
             ' of them on walls, '//to_text(cloud%spacing, digits=6)//' m apart'
      if (domain%shape == 'cloud') then
        text = text//', from '//domain%file
      else
        text = text//', '//domain%arrangement
        if (domain%arrangement == 'jittered') text = text//' by '//to_text(domain%jitter)
        if (domain%arrangement == 'jittered' .or. domain%arrangement == 'relaxed') then
          text = text//' (seed '//to_text(domain%seed)//')'
        end if
      end if
    end associate
  end function particles

  function neighbours(simulation) result(text)
    type(simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text

    text = to_text(simulation%fewest_neighbours)//' to '//to_text(simulation%most_neighbours)// &
           ', '//to_text(simulation%mean_neighbours, digits=3)//' on average ('// &
           simulation%scene%kernel//', support radius '// &
           to_text(simulation%support_radius, digits=6)//' m)'
  end function neighbours

  function tensors(simulation) result(text)
    type(simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text

    associate (report => simulation%report)
      text = 'condition number '//spread_text(report%condition_gradient)
      if (any(report%condition_laplacian > 0)) then
        text = text//' (first derivative) and '//spread_text(report%condition_laplacian)// &
               ' (second)'
      end if
      text = text//'; singular at '//to_text(report%singular_rows())//' particles'
    end associate
  end function tensors

  function rows(simulation) result(text)
    type(simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text

    associate (quality => simulation%repairs%quality)
      text = 'quality '//spread_text(quality%ratio)//' (1: no negative weight); '// &
             spread_text(real(quality%neighbours, wp))//' neighbours with a weight'
      if (any(quality%ratio > 1.0e300_wp)) then
        text = text//'; '//to_text(count(quality%ratio > 1.0e300_wp))// &
               ' with a diagonal of the wrong sign'
      end if
    end associate
  end function rows

  !> 'least to largest, median middle'
  function spread_text(values) result(text)
    real(wp), intent(in) :: values(:)
    character(len=:), allocatable :: text

    text = figure(minval(values))//' to '//figure(maxval(values))//', median '// &
           figure(median(values))
    if (.not. maxval(values) > minval(values)) text = figure(values(1))//' everywhere'

  contains

    !> A condition number of a singular system, or the quality of a row of the wrong sign, is beyond
    !> all meaning.
    pure function figure(value) result(number)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: number

      number = 'infinite'
      if (value < 1.0e18_wp) number = to_text(value, digits=3)
    end function figure

  end function spread_text

  !> The median by bisection of the range of values: no sorting, for it is only told.
  pure function median(values) result(middle)
    real(wp), intent(in) :: values(:)
    real(wp) :: middle
    real(wp) :: low, high
    integer :: k

    low = minval(values)
    high = maxval(values)
    middle = low
    do k = 1, 60
      if (2*count(values <= middle) >= size(values)) exit
      middle = 0.5_wp*low + 0.5_wp*high
      if (2*count(values <= middle) >= size(values)) then
        high = middle
        middle = low
      else
        low = middle
      end if
    end do
    middle = minval(values, values >= middle)
  end function median

  function repairs(simulation) result(text)
    type(simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text

    associate (repair => simulation%repairs%repair)
      text = 'support grown at '//to_text(count(repair == support_grown))// &
             ' particles (up to '//to_text(maxval(simulation%radius), digits=3)// &
             ' m), positive stencils at '//to_text(count(repair == positive_stencil))// &
             ', inexact ones at '//to_text(count(repair == inexact_stencil))//', none at '// &
             to_text(count(repair == no_stencil))
    end associate
  end function repairs

  function stability(simulation) result(text)
    type(simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text

    associate (rightmost => simulation%rightmost)
      if (rightmost%method == 'no weight is negative') then
        text = 'certain: no weight is negative'
      else
        text = 'largest real part of an eigenvalue '//to_text(rightmost%growth_rate, digits=4)// &
               ' 1/s ('//trim(rightmost%method)//')'
        if (.not. rightmost%converged) text = text//', not converged: it may be larger'
        if (rightmost%growth_rate > 0) text = text//'. UNSTABLE'
      end if
    end associate
  end function stability

  function effects(simulation) result(text)
    type(simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text

    text = join(simulation%effects_in_force(), '; ')//'. Nothing else.'
  end function effects

  !> How often rows and lists of neighbours were made, and what of the time of stepping that took
  function motion(simulation) result(text)
    type(simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text
    !> Phases beside the steps themselves
    character(len=*), parameter :: parts(*) = [character(len=15) :: 'motion', 'neighbour lists', &
        'reassembly', 'shifting']
    real(wp) :: all
    integer :: k

    associate (motion => simulation%motion, stopwatch => simulation%stopwatch)
      text = to_text(motion%steps)//' steps of the motion, rows made '// &
             times(motion%assemblies)//', lists of neighbours '//times(motion%near%builds)
      all = stopwatch%seconds_of('steps')
      do k = 1, size(parts)
        all = all + stopwatch%seconds_of(trim(parts(k)))
      end do
      if (.not. all > 0) return
      text = text//'; of the time of stepping'
      do k = 1, size(parts)
        if (parts(k) == 'shifting' .and. .not. simulation%scene%motion%shifting) cycle
        text = text//', '//trim(parts(k))//' '// &
               to_text(100*stopwatch%seconds_of(trim(parts(k)))/all, digits=2)//' %'
      end do
    end associate
  end function motion

  function steps(simulation) result(text)
    type(simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text
    real(wp) :: step, radius

    associate (stepper => simulation%stepper)
      radius = stepper%spectral_radius
      if (stepper%tolerance > 0) then
        step = stepper%first_proposal()
        text = 'first step '//to_text(step, digits=2)// &
               ' s, then as long as the error of a step stays below '// &
               to_text(stepper%tolerance, digits=2)
        if (simulation%method == 'exponential') then
          text = 'as long as can be, with an error of a step below '// &
                 to_text(stepper%tolerance, digits=2)
        end if
        if (simulation%predicted_steps > 0) then
          text = text//': about '//count_text(simulation%predicted_steps)//' steps'
        end if
      else
        text = count_text(simulation%scene%time%end/stepper%longest_step)// &
               ' of at most '//to_text(stepper%longest_step, digits=3)//' s'
      end if
      if (simulation%method == 'tr_bdf2' .or. simulation%method == 'exponential') then
        text = text//'; stable for any step (forward Euler: up to '// &
               to_text(2/radius, digits=3)//' s)'
        return
      end if
      text = text//'; stable up to '//to_text(simulation%stability_limit, digits=3)// &
             ' s (forward Euler: '//to_text(2/radius, digits=3)//' s)'
      if (simulation%monotone_limit > 0) then
        text = text//'; up to '//to_text(simulation%monotone_limit, digits=3)// &
               ' s no temperature leaves the range of those before it'
      end if
    end associate
  end function steps

  !> A number of steps or states, which may be beyond all integers
  !> 'once', 'twice', '3 times': how often something was done
  pure function times(number) result(text)
    integer, intent(in) :: number
    character(len=:), allocatable :: text

    select case (number)
    case (1)
      text = 'once'
    case (2)
      text = 'twice'
    case default
      text = to_text(number)//' times'
    end select
  end function times

  pure function count_text(number) result(text)
    real(wp), intent(in) :: number
    character(len=:), allocatable :: text

    if (number < 1.0e15_wp) then
      text = to_text(ceiling(number, i8))
    else
      text = to_text(number, digits=2)
    end if
  end function count_text

  function output(simulation) result(text)
    type(simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text
    real(wp) :: states
    integer :: n

    associate (out => simulation%scene%output)
      if (out%file == '') then
        text = 'none: the scene has no &output'
        return
      end if
      n = simulation%cloud%particles()
      states = 2
      if (simulation%scene%time%steady) states = 1
      if (out%every > 0) states = 1 + max(1, ceiling(simulation%scene%time%end/out%every))
      ! A particle's place, cell and static fields take 57 bytes, a field of a state 8.
      text = out%file//': '//join(out%fields, ', ')//' at '//count_text(states)// &
             trim(merge(' time ', ' times', states < 1.5))//', about '// &
             size_text(57.0_wp*n + 8.0_wp*n*states*size(out%fields))
    end associate
  end function output

end module calor_description
