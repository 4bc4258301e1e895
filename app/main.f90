!> The command line of calor: finds out what is asked, has the library do it, prints what comes
!> back, and sets the exit status: 0 done, 2 wrong input, 3 the numbers went wrong, 4 a file could
!> not be read or written.
program main
  use, intrinsic :: iso_fortran_env, only: error_unit
  use calor, only: error_t, raise, status_done, status_bad_input, status_bad_file, text_t, &
                   to_text, version, scene_t, &
                   read_scene, simulation_t, cost_study_t, describe_costs, &
                   watch_for_interrupt, plot_request_t, plot_file, &
                   operator_study_t, target_search_t, describe_plan, describe_result, &
                   describe_derivatives, describe_schemes, describe_effects, &
                   write_new_scene, describe_starting_scenes, &
                   skip_hdf5_cleanup, ignore_file_size_signal, &
                   convergence_study_t, describe_convergence, check_convergence_files, &
                   write_convergence, draw_convergence, convergence_table_file, &
                   convergence_pictures
  use brief_waiting, only: wait_briefly
  use command_call, only: call_t, read_call
  use completion, only: completion_script
  use convergence_progress, only: convergence_progress_t
  use cost_progress, only: cost_progress_t
  use help, only: overview, command_help
  use manual, only: manual_page
  use run_progress, only: run_progress_t
  use search_progress, only: search_progress_t
  use terminal, only: say, say_in_place, everything_said
  implicit none (type, external)

  interface
    !> Ends the program with a status and without a further word
    subroutine c_exit(status) bind(c, name='exit')
      use, intrinsic :: iso_c_binding, only: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: status
    end subroutine c_exit
  end interface

  type(error_t), allocatable :: error
  integer :: status
  logical :: said

  call wait_briefly()
  ! A full disk shall end in a message of ours, neither in HDF5's own nor in a signal.
  call skip_hdf5_cleanup()
  call ignore_file_size_signal()
  call dispatch(error)
  status = status_done
  said = .true.
  if (allocated(error)) then
    said = everything_said()
    write (error_unit, '(a)') 'calor: '//error%message
    status = error%status
  end if
  if (.not. everything_said()) said = .false.
  if (.not. said .and. status == status_done) then
    write (error_unit, '(a)') 'calor: standard output could not be written to: is the disk full?'
    status = status_bad_file
  end if
  call c_exit(int(status))

contains

  subroutine dispatch(error)
    type(error_t), allocatable, intent(out) :: error
    type(call_t) :: asked

    call read_call(asked, error)
    if (allocated(error)) return
    if (asked%wants_help) then
      if (asked%command == '') then
        call say_lines(overview())
      else
        call say_lines(command_help(asked%command))
      end if
      return
    end if
    select case (asked%command)
    case ('version')
      call say('calor '//version)
    case ('run')
      call run(asked, error)
    case ('check')
      call check(asked%word(1), error)
    case ('plot')
      call plot(asked, error)
    case ('operators')
      call operators(asked%word(1), error)
    case ('convergence')
      call convergence(asked%word(1), error)
    case ('cost')
      call cost(asked%word(1), error)
    case ('new')
      call new(asked, error)
    case ('schemes')
      call say_about(describe_schemes, asked%word(1), error)
    case ('effects')
      call say_about(describe_effects, asked%word(1), error)
    case ('completion')
      call say_lines(completion_script())
    case default
      call say_lines(manual_page())
    end select
  end subroutine dispatch

  subroutine run(asked, error)
    type(call_t), intent(in) :: asked
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(run_progress_t) :: progress
    logical :: quiet

    quiet = asked%has('--quiet')
    if (quiet .and. asked%has('--verbose')) then
      call raise(error, status_bad_input, 'A run is either --quiet or --verbose, not both.')
      return
    end if
    if (asked%has('--checkpoint') .and. .not. asked%has('--resume')) then
      call raise(error, status_bad_input, '--checkpoint says what to resume from: give '// &
                 '--resume too. Where checkpoints are written is said by &checkpoint file.')
      return
    end if
    call read_scene(asked%word(1), scene, error)
    if (allocated(error)) return
    if (scene%accuracy%target > 0 .and. .not. asked%has('--resume')) then
      call run_to_target(scene, quiet, error)
      return
    end if
    if (asked%has('--resume')) then
      call simulation%resume(scene, asked%option_value('--checkpoint'), error)
    else
      call simulation%prepare(scene, error)
    end if
    if (allocated(error)) return
    if (.not. quiet) call say_lines(describe_plan(simulation))
    if (.not. quiet) call say('')
    if (asked%has('--resume') .and. .not. quiet) then
      call say('Resumed at t = '//to_text(simulation%time, digits=6)//' s, after '// &
               to_text(simulation%stepper%steps)//' steps')
      call say('')
    end if
    ! From here on Ctrl-C ends the run after its step, and nothing is lost.
    if (.not. scene%time%steady) call watch_for_interrupt()
    said = everything_said()
    call progress%begin(scene%time%end, quiet, asked%has('--verbose'))
    call simulation%run(error, progress, lean=.true.)
    call progress%finish()
    if (allocated(error) .or. quiet) return
    call say_lines(describe_result(simulation))
  end subroutine run

  !> The program chooses scheme, order, spacing and steps.
  subroutine run_to_target(scene, quiet, error)
    type(scene_t), intent(in) :: scene
    logical, intent(in) :: quiet
    type(error_t), allocatable, intent(out) :: error
    type(target_search_t) :: search
    type(search_progress_t) :: progress

    if (quiet) then
      call search%reach(scene, error)
      return
    end if
    call say('Looking for the cheapest way to a relative error of '// &
             to_text(scene%accuracy%target, digits=3)//':')
    call search%reach(scene, error, progress)
    if (allocated(error)) return
    call say('')
    call say_lines(describe_plan(search%simulation))
    call say('')
    call say_lines(describe_result(search%simulation))
  end subroutine run_to_target

  subroutine check(path, error)
    character(len=*), intent(in) :: path
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(simulation_t) :: simulation

    call read_scene(path, scene, error)
    if (allocated(error)) return
    call simulation%prepare(scene, error)
    if (allocated(error)) return
    call simulation%predict_steps()
    call say_lines(describe_plan(simulation))
    call simulation%certify(error)
  end subroutine check

  subroutine plot(asked, error)
    type(call_t), intent(in) :: asked
    type(error_t), allocatable, intent(out) :: error
    type(plot_request_t) :: request
    type(text_t), allocatable :: written(:)
    integer :: status

    request%path = asked%word(1)
    request%field = asked%option_value('--field')
    request%output = asked%option_value('--output')
    request%animate = asked%has('--animate')
    if (asked%has('--time')) then
      read (asked%value(position_of(asked, '--time'))%value, *, iostat=status) request%time
      if (status /= 0 .or. .not. request%time >= 0) then
        call raise(error, status_bad_input, '--time '//asked%option_value('--time')// &
                   ' is no time: give a number of seconds, 0 or more.')
        return
      end if
      if (request%animate) then
        call raise(error, status_bad_input, 'A picture is either of one --time or, by '// &
                   '--animate, of all.')
        return
      end if
    end if
    call plot_file(request, written, error)
    if (allocated(written)) call say_lines(written)
  end subroutine plot

  pure function position_of(asked, name) result(position)
    type(call_t), intent(in) :: asked
    character(len=*), intent(in) :: name
    integer :: position

    do position = size(asked%option), 1, -1
      if (asked%option(position)%value == name) return
    end do
  end function position_of

  subroutine operators(path, error)
    character(len=*), intent(in) :: path
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(operator_study_t) :: study

    call read_scene(path, scene, error)
    if (allocated(error)) return
    call study%evaluate(scene, error)
    if (allocated(error)) return
    call study%write(error)
    if (allocated(error)) return
    call say_lines(describe_derivatives(study))
  end subroutine operators

  subroutine cost(path, error)
    character(len=*), intent(in) :: path
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(cost_study_t) :: study
    type(cost_progress_t) :: progress

    call read_scene(path, scene, error)
    if (allocated(error)) return
    call study%prepare(scene, error)
    if (allocated(error)) return
    ! From here on Ctrl-C ends the study, and what was measured is kept.
    call watch_for_interrupt()
    call study%measure(error, progress)
    if (study%any_measured()) call say_lines(describe_costs(study))
  end subroutine cost

  subroutine convergence(path, error)
    !> '' for the study of the program's own
    character(len=*), intent(in) :: path
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(convergence_study_t) :: study
    type(convergence_progress_t) :: progress
    integer :: k

    call check_convergence_files(error)
    if (allocated(error)) return
    if (path /= '') then
      call read_scene(path, scene, error)
      if (.not. allocated(error)) call study%evaluate(error, scene, watcher=progress)
    else
      call study%evaluate(error, watcher=progress)
    end if
    call say_in_place('')
    if (allocated(error)) return
    call say_lines(describe_convergence(study))
    call say('')
    call write_convergence(study, convergence_table_file, error)
    if (allocated(error)) return
    call say('All numbers are in '//convergence_table_file//'.')
    do k = 1, size(convergence_pictures)
      call draw_convergence(study, convergence_pictures(k), error)
      if (allocated(error)) return
      call say('A picture is in '//convergence_pictures(k)//'.')
    end do
  end subroutine convergence

  subroutine new(asked, error)
    type(call_t), intent(in) :: asked
    type(error_t), allocatable, intent(out) :: error
    type(text_t), allocatable :: written(:)
    integer :: k

    if (size(asked%argument) == 0) then
      call say_lines(describe_starting_scenes())
      return
    end if
    if (size(asked%argument) == 2) then
      call write_new_scene(asked%word(1), asked%word(2), written, error)
    else
      call write_new_scene(asked%word(1), asked%word(1), written, error)
    end if
    if (allocated(error)) return
    do k = 2, size(written)
      call say(written(k)%value//' is ready too: the scene reads it.')
    end do
    call say(written(1)%value//' is ready. Run it by: calor run '//written(1)%value)
  end subroutine new

  !> Say what there is, or all about one thing.
  subroutine say_about(describe, name, error)
    interface
      subroutine describe(name, lines, error)
        use calor, only: error_t, text_t
        implicit none (type, external)
        character(len=*), intent(in) :: name
        type(text_t), allocatable, intent(out) :: lines(:)
        type(error_t), allocatable, intent(out) :: error
      end subroutine describe
    end interface
    character(len=*), intent(in) :: name
    type(error_t), allocatable, intent(out) :: error
    type(text_t), allocatable :: lines(:)

    call describe(name, lines, error)
    if (.not. allocated(error)) call say_lines(lines)
  end subroutine say_about

  subroutine say_lines(lines)
    type(text_t), intent(in) :: lines(:)
    integer :: k

    do k = 1, size(lines)
      call say(lines(k)%value)
    end do
  end subroutine say_lines

end program main
