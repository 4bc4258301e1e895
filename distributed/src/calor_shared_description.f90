!> What several ranks will simulate, and what they have, in plain words. All ranks take part, one
!> says it.
module calor_shared_description
  use calor_integrators, only: integrator_choices
  use calor_kinds, only: wp, i8
  use calor_machine_memory, only: peak_memory
  use calor_memory_need, only: memory_need, size_text
  use calor_shared_simulation, only: shared_simulation_t
  use calor_stable_rows, only: support_grown, positive_stencil, inexact_stencil, no_stencil
  use calor_text, only: text_t, to_text, append
  implicit none (type, external)
  private

  public :: describe_shared_plan, describe_shared_result, effects_in_force

  integer, parameter :: heading_width = 13

contains

  !> Particles and how they are shared, schemes, effects, steps, memory, file.
  subroutine describe_shared_plan(simulation, lines)
    !> A simulation after `prepare`
    type(shared_simulation_t), intent(in) :: simulation
    type(text_t), allocatable, intent(out) :: lines(:)
    type(text_t), allocatable :: effects(:)
    character(len=:), allocatable :: text
    integer :: k

    allocate (lines(0))
    associate (scene => simulation%scene, particles => simulation%particles)
      text = scene%path
      if (scene%title /= '') text = scene%title//' ('//text//')'
      call append(lines, text)
      call add(lines, 'Particles', to_text(int(particles%bands%particles))//', '// &
               to_text(int(particles%on_walls))//' of them on walls, '// &
               to_text(particles%own%spacing, digits=6)//' m apart')
      call add(lines, 'Ranks', ranks_text(simulation))
      call add(lines, 'Exchange', exchange_text(simulation))
      call add(lines, 'Neighbours', to_text(simulation%fewest_neighbours)//' to '// &
               to_text(simulation%most_neighbours)//', '// &
               to_text(simulation%all_entries/real(simulation%all_rows, wp), digits=3)// &
               ' on average')
      text = scene%laplacian
      if (text == 'consistent') text = text//' of order '//to_text(scene%order)
      call add(lines, 'Laplacian', text)
      text = repairs(simulation)
      if (text /= '') call add(lines, 'Repairs', text)
      if (.not. scene%time%steady) call add(lines, 'Stability', stability(simulation))
      effects = effects_in_force(simulation)
      text = effects(1)%value
      do k = 2, size(effects)
        text = text//', '//effects(k)%value
      end do
      call add(lines, 'Effects', text)
      if (scene%time%steady) then
        call add(lines, 'Time', 'steady state, by Newton''s method and PETSc''s Krylov solvers')
      else
        call add(lines, 'Time', '0 to '//to_text(scene%time%end)//' s by '// &
                 simulation%steps%method//': '//trim(summary(simulation%steps%method)))
        if (allocated(simulation%steps%choice)) then
          call add(lines, 'Why', simulation%steps%choice%sentence())
        end if
      end if
      call add(lines, 'Memory', 'about '//size_text(memory_need( &
               real(particles%bands%particles, wp)/simulation%ranks%ranks, &
               simulation%all_entries/real(simulation%all_rows, wp)))//' on each rank')
      call add(lines, 'Taken', peak_text(simulation))
      if (scene%output%file == '') then
        call add(lines, 'Output', 'none')
      else
        call add(lines, 'Output', scene%output%file)
      end if
    end associate
  end subroutine describe_shared_plan

  !> Steps, temperatures, the error if it is known, wall times, the file.
  subroutine describe_shared_result(simulation, lines)
    !> A simulation after a run
    type(shared_simulation_t), intent(in) :: simulation
    type(text_t), allocatable, intent(out) :: lines(:)
    real(wp) :: range(2), deviation
    integer :: k

    allocate (lines(0))
    if (simulation%scene%time%steady) then
      call add(lines, 'Steps', to_text(simulation%newton_steps)//' of Newton''s method')
    else
      call add(lines, 'Steps', to_text(simulation%stepper%steps)//' steps to t = '// &
               to_text(simulation%time, digits=6)//' s, '// &
               to_text(simulation%stepper%integrator%evaluations)//' evaluations of the Laplacian')
    end if
    range = simulation%temperature_range()
    call add(lines, 'Temperature', to_text(range(1), digits=6)//' to '//to_text(range(2), digits=6))
    if (simulation%scene%exact_expression /= '') then
      deviation = simulation%relative_l2_error()
      call add(lines, 'Error', 'relative L2 error '//to_text(deviation, digits=3)//' at t = '// &
               to_text(simulation%time, digits=6)//' s')
    end if
    if (size(simulation%entries) > 0) then
      call add(lines, 'Heat', &
               simulation%budget%words(simulation%entries(size(simulation%entries))))
    end if
    call add(lines, 'Taken', peak_text(simulation))
    call add(lines, 'Wall time', to_text(simulation%stopwatch%total(), digits=3)//' s')
    do k = 1, size(simulation%stopwatch%phases)
      associate (phase => simulation%stopwatch%phases(k))
        call append(lines, '  '//phase%name//to_text(phase%seconds, digits=2)//' s')
      end associate
    end do
    if (simulation%scene%output%file == '') return
    call add(lines, 'Written', &
             simulation%scene%output%file//' (open it in ParaView, or draw it: '// &
             'calor plot '//simulation%scene%output%file//')')
  end subroutine describe_shared_result

  subroutine add(lines, heading, content)
    type(text_t), allocatable, intent(inout) :: lines(:)
    character(len=*), intent(in) :: heading, content

    call append(lines, heading//repeat(' ', heading_width - len(heading))//content)
  end subroutine add

  function ranks_text(simulation) result(text)
    type(shared_simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text
    real(wp) :: own(2), others

    associate (cloud => simulation%particles%cloud, ranks => simulation%ranks)
      own = simulation%particles%own%particles()
      own = [ranks%least(own(1)), ranks%most(own(2))]
      others = ranks%most(1.0_wp*(cloud%particles() - simulation%particles%own%particles()))
      text = to_text(ranks%ranks)//', each with '//to_text(nint(own(1)))//' to '// &
             to_text(nint(own(2)))//' particles and at most '//to_text(nint(others))// &
             ' of others'' within reach'
    end associate
  end function ranks_text

  !> What a product with the Laplacian takes from other ranks
  function exchange_text(simulation) result(text)
    type(shared_simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text
    real(wp) :: most, all

    associate (ranks => simulation%ranks, received => 8.0_wp*simulation%conduction%received)
      most = ranks%most(received)
      all = ranks%total(received)
    end associate
    text = to_text(nint(most))//' bytes at most to a rank for each product with the Laplacian, '// &
           to_text(nint(all/simulation%ranks%ranks))//' on average'
  end function exchange_text

  !> What ranks have taken of the memory so far, programs and libraries included
  function peak_text(simulation) result(text)
    type(shared_simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text
    real(wp) :: bytes

    bytes = real(peak_memory(), wp)
    text = to_text(simulation%ranks%most(bytes)/1024, digits=12)//' kB at most by a rank so '// &
           'far, '//to_text(simulation%ranks%total(bytes)/1024, digits=12)//' kB in all'
  end function peak_text

  function repairs(simulation) result(text)
    type(shared_simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text
    integer(i8) :: counts(support_grown:no_stencil)
    integer :: k

    do k = support_grown, no_stencil
      counts(k) = simulation%ranks%total(int(count(simulation%rows%repairs%repair == k), i8))
    end do
    text = ''
    if (all(counts == 0)) return
    text = 'support grown at '//to_text(int(counts(support_grown)))// &
           ' particles, positive stencils at '//to_text(int(counts(positive_stencil)))// &
           ', inexact ones at '//to_text(int(counts(inexact_stencil)))//', none at '// &
           to_text(int(counts(no_stencil)))
  end function repairs

  function stability(simulation) result(text)
    type(shared_simulation_t), intent(in) :: simulation
    character(len=:), allocatable :: text

    associate (rightmost => simulation%rightmost)
      if (.not. rightmost%converged) then
        text = 'the search for unstable modes did not converge'
      else if (rightmost%method == 'no weight is negative') then
        text = 'no weight is negative, so no mode can grow'
      else
        text = 'largest real part of an eigenvalue '//to_text(rightmost%growth_rate, digits=4)// &
               ' 1/s'
      end if
    end associate
  end function stability

  pure function summary(method) result(text)
    character(len=*), intent(in) :: method
    character(len=:), allocatable :: text
    integer :: k

    text = ''
    do k = 1, size(integrator_choices)
      if (integrator_choices(k)%name == method) text = trim(integrator_choices(k)%summary)
    end do
  end function summary

  !> What is in force and why, as calor says it.
  function effects_in_force(simulation) result(texts)
    type(shared_simulation_t), intent(in) :: simulation
    type(text_t), allocatable :: texts(:)
    integer :: k

    call append(texts, 'conduction')
    do k = 1, size(simulation%scene%boundaries)
      associate (boundary => simulation%scene%boundaries(k))
        if (boundary%kind /= 'temperature') cycle
        call append(texts, 'temperature held on '''//boundary%on//'''')
      end associate
    end do
    if (.not. allocated(simulation%conduction%effects)) return
    do k = 1, size(simulation%conduction%effects)
      associate (effect => simulation%conduction%effects(k)%effect)
        call append(texts, trim(effect%name)//' ('//effect%reason//')')
      end associate
    end do
  end function effects_in_force

end module calor_shared_description
