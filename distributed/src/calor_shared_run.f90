!> A run on several ranks: states one after another into the file.
module calor_shared_run
  use calor_error, only: error_t
  use calor_kinds, only: wp
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
    !> A simulation after `prepare`
    type(shared_simulation_t), intent(inout), target :: simulation
    !> The numbers went wrong, or a file could not be written; on all ranks the same
    type(error_t), allocatable, intent(out) :: error
    !> Who is told of each step
    class(step_listener_t), intent(in), target, optional :: listener
    type(shared_file_t) :: file
    type(error_t), allocatable :: file_error
    real(wp) :: deviation
    integer :: written

    call simulation%certify(error)
    if (allocated(error)) return
    associate (scene => simulation%scene, cloud => simulation%particles%cloud)
      call simulation%stopwatch%start('output')
      call file%open(simulation%ranks, scene, cloud, simulation%particles%bands%particles, &
                     effects_in_force(simulation), error)
      call simulation%stopwatch%stop()
      if (allocated(error)) return
      if (allocated(simulation%method)) call file%say('time_method', simulation%method)
      if (present(listener)) simulation%stepper%listener => listener
      do written = 0, simulation%states_after_start()
        if (written > 0) then
          call simulation%advance_to(simulation%time_of(written), error)
        else if (scene%time%steady) then
          call simulation%settle(error)
          if (allocated(error)) exit
        end if
        ! After a failure the state is the last good one: it is written too.
        call simulation%stopwatch%start('output')
        call file%write_state(cloud, simulation%time, simulation%temperature, simulation%exact, &
                              file_error, simulation%liquid_fraction())
        call simulation%stopwatch%stop()
        if (allocated(error) .or. allocated(file_error)) exit
      end do
      nullify (simulation%stepper%listener)
      if (allocated(file_error) .or. (scene%time%steady .and. allocated(error))) then
        call file%abandon()
        if (.not. allocated(error)) call move_alloc(file_error, error)
        return
      end if
      if (scene%exact_expression /= '') then
        deviation = simulation%relative_l2_error()
        call file%note('relative_l2_error', deviation)
      end if
      call file%close(simulation%stopwatch%phases, file_error)
      if (allocated(error)) then
        if (file%in_use .and. .not. allocated(file_error)) then
          error%message = error%message//new_line('a')//'The last good state, at t = '// &
                          to_text(simulation%time, digits=6)//' s, is in '//scene%output%file//'.'
        end if
      else if (allocated(file_error)) then
        call move_alloc(file_error, error)
      end if
    end associate
  end subroutine run_shared

end module calor_shared_run
