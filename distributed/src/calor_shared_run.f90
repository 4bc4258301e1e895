!> A run on several ranks: states one after another into the file, checkpoints when they are due.
module calor_shared_run
  use calor_error, only: error_t, raise
  use calor_kinds, only: wp
  use calor_row_fields, only: find_row_field, is_row_field
  use calor_shared_clock, only: shared_clock_t
  use calor_shared_description, only: effects_in_force
  use calor_shared_file, only: shared_file_t
  use calor_shared_simulation, only: shared_simulation_t
  use calor_step_listener, only: step_listener_t
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: run_shared

contains

  subroutine run_shared(simulation, error, listener)
    !> A simulation after `prepare` or `resume`
    type(shared_simulation_t), intent(inout), target :: simulation
    !> The numbers went wrong, or a file could not be written; or the run was interrupted; on all
    !> ranks the same
    type(error_t), allocatable, intent(out) :: error
    !> Who is told of each step
    class(step_listener_t), intent(in), target, optional :: listener
    type(shared_clock_t), target :: clock
    type(shared_file_t) :: file
    type(error_t), allocatable :: file_error
    real(wp) :: next
    !> Whether the state lies between two that are written
    logical :: amid

    call simulation%certify(error)
    if (allocated(error)) return
    if (simulation%scene%time%steady) then
      call simulation%settle(error)
      if (allocated(error)) return
    end if
    call open_file()
    if (allocated(error)) return
    clock%ranks = simulation%ranks
    if (present(listener)) clock%next => listener
    call clock%clock%start(simulation%scene%checkpoint, simulation%time)
    simulation%stepper%listener => clock
    if (simulation%written < 0) call write_state()
    do while (simulation%time < simulation%scene%time%end .and. .not. simulation%scene%time%steady)
      if (allocated(file_error)) exit
      next = simulation%next_output()
      call simulation%advance_to(next, error)
      amid = simulation%time < next .and. .not. allocated(error)
      if (amid) then
        call write_checkpoint()
        if (allocated(file_error)) exit
        if (clock%status == 0) cycle
      else
        ! A run that makes no step leaves the file of before.
        if (allocated(error) .and. simulation%stepper%steps == 0) exit
        simulation%written = simulation%written + 1
      end if
      ! After a failure the state is the last good one: it is written too.
      call write_state()
      if (amid .or. allocated(error) .or. allocated(file_error)) exit
      if (clock%is_due(simulation%time) .or. &
          (simulation%scene%checkpoint%asked .and. &
           .not. simulation%time < simulation%scene%time%end)) call write_checkpoint()
      if (clock%status > 0) exit
    end do
    nullify (simulation%stepper%listener)
    call finish()

  contains

    subroutine open_file()
      call simulation%stopwatch%start('output')
      associate (cloud => simulation%particles%cloud)
        call file%open(simulation%ranks, simulation%scene, cloud, &
                       simulation%particles%bands%particles, effects_in_force(simulation), error)
        if (.not. allocated(error)) call write_row_fields()
        if (.not. allocated(error) .and. allocated(simulation%earlier_file)) then
          if (simulation%earlier_file == simulation%scene%output%file) then
            call file%take_over(simulation%earlier_scene, simulation%entries%time, error)
            if (allocated(error)) call file%abandon()
          end if
        end if
      end associate
      if (.not. allocated(error) .and. allocated(simulation%steps%method)) then
        call file%say('time_method', simulation%steps%method)
      end if
      call simulation%stopwatch%stop()
    end subroutine open_file

    subroutine write_row_fields()
      real(wp), allocatable :: values(:)
      integer :: k

      if (.not. allocated(simulation%scene%output%fields)) return
      allocate (values(simulation%particles%cloud%particles()))
      do k = 1, size(simulation%scene%output%fields)
        associate (name => simulation%scene%output%fields(k)%value, rows => simulation%rows)
          if (.not. is_row_field(name)) cycle
          call find_row_field(name, simulation%conduction%laplacian%target, rows%report, &
                              rows%repairs, rows%radius, values)
          call file%write_static(name, values, error)
        end associate
        if (.not. allocated(error)) cycle
        call file%abandon()
        return
      end do
    end subroutine write_row_fields

    subroutine write_state()
      call simulation%stopwatch%start('output')
      call file%write_state(simulation%particles%cloud, simulation%time, simulation%temperature, &
                            simulation%exact, file_error, simulation%liquid_fraction())
      call simulation%note_state()
      call simulation%stopwatch%stop()
    end subroutine write_state

    !> The output file takes its place before: it belongs to it.
    subroutine write_checkpoint()
      call simulation%stopwatch%start('output')
      call file%publish(file_error)
      if (.not. allocated(file_error)) call simulation%write_checkpoint(file_error)
      call clock%clock%reset(simulation%time)
      call simulation%stopwatch%stop()
    end subroutine write_checkpoint

    !> Complete the file, and say what became of the run.
    subroutine finish()
      logical :: fruitless

      fruitless = allocated(error) .and. simulation%stepper%steps == 0
      if (allocated(file_error) .or. fruitless) then
        call file%abandon()
      else
        if (simulation%scene%exact_expression /= '') then
          call file%note('relative_l2_error', simulation%relative_l2_error())
        end if
        call file%write_budget(simulation%budget, simulation%entries)
        call file%close(simulation%stopwatch%phases, file_error)
      end if
      if (allocated(file_error) .and. .not. allocated(error)) then
        call move_alloc(file_error, error)
      else if (clock%status > 0 .and. .not. allocated(error)) then
        call raise(error, clock%status, 'Interrupted at t = '// &
                   to_text(simulation%time, digits=6)//' s. The state is in '// &
                   simulation%scene%checkpoint%file//'; go on, by any number of ranks, by'// &
                   new_line('a')//'calor-mpi run --resume '//simulation%scene%path)
      else if (allocated(error) .and. file%in_use .and. .not. (allocated(file_error) .or. &
                                                               fruitless)) then
        error%message = error%message//new_line('a')//'The last good state, at t = '// &
                        to_text(simulation%time, digits=6)//' s, is in '// &
                        simulation%scene%output%file//'.'
      end if
    end subroutine finish

  end subroutine run_shared

end module calor_shared_run
