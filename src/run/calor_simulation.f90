!> The heat driver: a scene becomes a cloud, the cloud an operator, the operator is stepped in time.
module calor_simulation
  use calor_body, only: body_t
  use calor_checkpoint, only: checkpoint_clock_t, read_resume_point, save_scene
  use calor_checkpoint_file, only: write_checkpoint_file
  use calor_cloud, only: cloud_t
  use calor_conduction, only: conduction_t
  use calor_error_transport, only: error_transport_t
  use calor_freed_memory, only: give_back_freed_memory
  use calor_effect, only: effect_slot_t
  use calor_error, only: error_t, raise, status_bad_file, status_bad_input, status_bad_numbers
  use calor_evolution, only: evolution_t
  use calor_expression, only: expression_t, compile_expression
  use calor_heat_content, only: heat_content_t
  use calor_heat_budget, only: heat_budget_t, budget_entry_t
  use calor_initial_fluxes, only: find_flux_errors
  use calor_initial_jumps, only: find_jump_errors
  use calor_integrators, only: make_integrator
  use calor_interrupt, only: interrupted, interrupt_status
  use calor_kernel, only: kernel_t
  use calor_kernels, only: make_kernel
  use calor_kinds, only: wp, ip
  use calor_laplacian_schemes, only: usual_support
  use calor_local_polynomial, only: interpolate_field
  use calor_materials, only: materials_t, read_materials
  use calor_method_choice, only: method_choice_t
  use calor_passing_deviation, only: passing_deviation_t
  use calor_rightmost_eigenvalue, only: rightmost_t, find_rightmost
  use calor_row_fields, only: find_row_field, is_row_field
  use calor_row_report, only: row_report_t
  use calor_rows_in_motion, only: rows_in_motion_t
  use calor_saved_state, only: saved_state_t
  use calor_scene, only: scene_t
  use calor_scene_body, only: make_scene_body
  use calor_scene_changes, only: scene_changes
  use calor_scene_cloud, only: make_scene_cloud
  use calor_scene_evolution, only: make_scene_evolution, method_t, row_maker_t, scene_method, &
                                   scene_rows_t
  use calor_scene_file, only: scene_file_t, group_t, parse_scene_text
  use calor_scene_getters, only: get
  use calor_scene_motion, only: motion_t
  use calor_scene_values, only: field_values
  use calor_simulation_file, only: simulation_file_t, check_target
  use calor_stable_rows, only: row_repairs_t, inexact_stencil
  use calor_steady_state, only: find_steady_state
  use calor_step_listener, only: step_listener_t
  use calor_step_choice, only: default_tolerance, find_step_limits, make_usual_integrator, &
                               safe_part, states_after_start, step_choice_t
  use calor_stepper, only: stepper_t
  use calor_stopwatch, only: stopwatch_t
  use calor_stored_fields, only: stored_fields_t
  use calor_taylor_weights, only: monomials
  use calor_text, only: text_t, append, to_text
  implicit none (type, external)
  private

  public :: simulation_t, observer_t

  !> The error is estimated with a consistent scheme of this order at least
  integer, parameter :: lowest_reference_order = 3
  !> … and stencils of an order have room where there are so many particles to each monomial
  integer, parameter :: roomy = 6
  !> Where the error is the difference to the solution of that scheme, steps of the latter may make
  !> this part of the error of the former
  real(wp), parameter :: truth_part = 0.01_wp
  !> An eigenvalue as small as this, as a part of the spectral radius, is 0
  real(wp), parameter :: rounding = 1.0e-11_wp

  !> So often, and when states are written, a run is compared with the coarser one
  integer, parameter :: comparisons = 128
  character(len=*), parameter :: coarser_run = 'In the run with particles twice as far apart, '// &
                                               'from which the error is estimated: '

  !> A scene at work
  type :: simulation_t
    !> The scene
    type(scene_t) :: scene
    !> Its particles
    type(cloud_t) :: cloud
    !> Support radius, m
    real(wp) :: support_radius = 0.0_wp
    !> Fewest, mean and most neighbours of a particle that is not held
    integer :: fewest_neighbours = 0, most_neighbours = 0
    real(wp) :: mean_neighbours = 0.0_wp
    !> Condition of the renormalization tensors
    type(row_report_t) :: report
    !> Quality of the rows, and what was repaired
    type(row_repairs_t) :: repairs
    !> Support radius of each particle, m
    real(wp), allocatable :: radius(:)
    !> The rightmost eigenvalue of the heat equation on this cloud
    type(rightmost_t) :: rightmost
    !> The heat equation on the cloud
    type(conduction_t) :: conduction
    !> The time integrator and its steps
    type(stepper_t) :: stepper
    !> The time integrator; where the scene leaves the choice to the program, why it is that one
    character(len=:), allocatable :: method
    type(method_choice_t), allocatable :: choice
    !> The longest step for which the chosen method is stable, s
    real(wp) :: stability_limit = 0.0_wp
    !> Newton steps that the steady temperature took
    integer :: newton_steps = 0
    !> About how many steps a run will take; 0: not predicted
    real(wp) :: predicted_steps = 0.0_wp
    !> The longest step after which no temperature can lie outside the range of those before, s; 0:
    !> scheme and method give no such promise
    real(wp) :: monotone_limit = 0.0_wp
    !> Time, s, and temperatures, in the cloud's order
    real(wp) :: time = 0.0_wp
    real(wp), allocatable :: temperature(:)
    !> The error of the temperatures, where the scene asks for it
    type(error_transport_t), allocatable :: estimate
    !> By which part of it the initial heat flux through interfaces jumps there, where an estimate
    !> is asked for: what comes of that in the first moments is told only roughly for high orders
    real(wp) :: flux_jump = 0.0_wp
    !> Where something melts: the same scene with particles twice as far apart, which tells the
    !> error; a simulation_t (gfortran 12 fails on types that hold their own kind)
    class(*), allocatable :: coarser
    !> What it differs from this one
    type(passing_deviation_t), private :: deviation
    !> How particles move; not allocated where nothing moves
    type(motion_t), allocatable :: motion
    !> The rows of the estimate's reference on their way with the particles, where both are in force
    type(motion_t), allocatable, private :: reference_motion
    type(scene_t), allocatable, private :: reference_scene
    !> How these rows change
    type(rows_in_motion_t), private :: reference_change
    !> The unknowns, where they are not the temperatures: heat contents, K
    real(wp), allocatable :: content(:)
    !> Wall time by phase
    type(stopwatch_t) :: stopwatch
    !> The true temperature, where the scene gives it
    type(expression_t) :: exact
    !> How the heat budget is made up, and that of each state written
    type(heat_budget_t) :: budget
    type(budget_entry_t), allocatable :: entries(:)
    !> What the output file says of the method
    character(len=:), allocatable, private :: method_note
    !> The number of the last state written, 0 at the start; -1: none is
    integer, private :: written = -1
    !> The output file of a run that is resumed, and the text of the scene then
    character(len=:), allocatable, private :: earlier_file, earlier_scene
  contains
    !> Make everything ready for the first step
    procedure :: prepare
    !> Make everything ready to go on from a checkpoint: in place of `prepare`
    procedure :: resume
    !> Step to the end and write what the scene asks for
    procedure :: run
    procedure, private :: free_what_steps_spare
    !> Lay the state aside, and take it up again
    procedure :: save => save_simulation
    procedure :: restore => restore_simulation
    !> Find the steady temperature
    procedure :: settle
    !> Step to a time
    procedure :: advance_to
    !> Find out about how many steps a run will take, from its first ones
    procedure :: predict_steps
    !> About how long a step of the motion will be
    procedure :: motion_step
    !> Whether the rows and their spectrum allow a run
    procedure :: certify
    !> Search for unstable modes what was prepared without that
    procedure :: search_growth
    !> Whether the scene gives the true temperature
    procedure :: knows_exact
    !> ‖u - u_exact‖ / ‖u_exact‖ in the L2 norm over the body, by the particles' areas
    procedure :: relative_l2_error
    !> Whether the scene asks for an estimate of the error
    procedure :: estimates_error
    !> Estimate of that error, from the error carried along
    procedure :: estimated_error
    !> Estimate of the largest error of a temperature, K
    procedure :: estimated_maximum_error
    !> Estimate of the error of each temperature, K
    procedure :: error_estimate
    procedure, private :: temperature_slope
    procedure, private :: prepare_estimate
    procedure, private :: prepare_coarser
    procedure, private :: advance_coarser
    procedure, private :: advance_alone
    !> How much of each particle is liquid, from 0 to 1
    procedure :: liquid_fraction
    procedure, private :: state
    procedure, private :: start_temperature
    procedure, private :: note_budget
    !> What is in force, and why
    procedure :: effects_in_force
    procedure, private :: count_neighbours
    procedure, private :: choose_steps
    procedure, private :: next_output
    procedure, private :: open_file
    procedure, private :: write_present_state
    procedure, private :: write_checkpoint
    procedure, private :: settle_state
    procedure, private :: advance_resting
    procedure, private :: advance_moving
    procedure, private :: take_reference_along
    procedure, private :: shift_particles
    procedure, private :: settle_rows
    procedure, private :: adopt_rows
    procedure, private :: check_rows
    procedure, private :: adapt_steps
    procedure, private :: find_growth
    procedure, private :: write_row_fields
    procedure :: name_particle
    procedure, private :: where_unstable
  end type simulation_t

  !> Is told what a run has reached; a program extends it to show progress
  type, abstract, extends(step_listener_t) :: observer_t
  contains
    !> A state has been reached, and written if the scene says so
    procedure(reached_interface), deferred :: reached
  end type observer_t

  abstract interface
    subroutine reached_interface(this, simulation)
      import :: observer_t, simulation_t
      implicit none (type, external)
      class(observer_t), intent(inout) :: this
      !> The simulation at its present time
      type(simulation_t), intent(in) :: simulation
    end subroutine reached_interface
  end interface

contains

  subroutine prepare(this, scene, error, further, uncertified, cloud)
    class(simulation_t), intent(out) :: this
    !> The scene
    type(scene_t), intent(in) :: scene
    !> The scene cannot be simulated
    type(error_t), allocatable, intent(out) :: error
    !> Effects beside those that the scene calls for
    type(effect_slot_t), intent(in), optional :: further(:)
    !> Leave out the search for unstable modes, as for a short run of which only figures are kept
    logical, intent(in), optional :: uncertified
    !> The scene's cloud, where it has been made before
    type(cloud_t), intent(in), optional :: cloud
    class(kernel_t), allocatable :: kernel
    type(scene_rows_t) :: rows
    logical :: certified
    type(row_maker_t) :: maker

    if (.not. (scene%time%end > 0 .or. scene%time%steady)) then
      call raise(error, status_bad_input, &
                 scene%path//' has no group &time: add &time end = ... /, '// &
                 'in seconds.')
      return
    end if
    this%scene = scene
    call check_target(scene%output%file, scene%output%place, scene, error)
    if (allocated(error)) return
    if (scene%checkpoint%asked) then
      call check_target(scene%checkpoint%file, scene%checkpoint%place, scene, error, 'checkpoint')
      if (allocated(error)) return
    end if
    if (scene%output%every*huge(1) < scene%time%end .and. scene%output%every > 0) then
      call raise(error, status_bad_input, scene%output%place//': every = '// &
                 to_text(scene%output%every)//' s asks for more states than can be counted: '// &
                 'raise it.')
      return
    end if
    call this%stopwatch%start('cloud')
    call make_kernel(scene%kernel, kernel, error)
    if (allocated(error)) return
    if (present(cloud)) then
      this%cloud = cloud
    else
      call make_scene_cloud(scene, kernel, this%cloud, error)
      if (allocated(error)) return
    end if
    this%support_radius = scene%support*this%cloud%spacing
    call this%start_temperature(error)
    if (allocated(error)) return
    if (scene%motion%in_force) then
      call make_scene_evolution(scene, this%cloud, scene_method(scene), this%temperature, &
                                this%conduction, rows, error, this%stopwatch, further, maker)
    else
      call make_scene_evolution(scene, this%cloud, scene_method(scene), this%temperature, &
                                this%conduction, rows, error, this%stopwatch, further)
    end if
    if (allocated(error)) return
    if (allocated(this%conduction%content)) then
      allocate (this%content(size(this%temperature)))
      call this%conduction%find_state(this%temperature, this%content)
    end if
    call this%adopt_rows(rows)
    if (scene%motion%in_force) then
      call this%stopwatch%start('motion')
      allocate (this%motion)
      call this%motion%prepare(scene, this%cloud, this%conduction, maker, this%radius, error)
      if (allocated(error)) return
    end if
    call this%budget%prepare(this%cloud, this%conduction)
    allocate (this%entries(0))
    if (.not. scene%time%steady) then
      call this%stopwatch%start('step control')
      call find_step_limits(scene, this%conduction%spectral_bound(), this%conduction, &
                            this%stepper%spectral_radius, error)
      if (allocated(error)) return
      certified = .true.
      if (present(uncertified)) certified = .not. uncertified
      if (certified) then
        call this%stopwatch%start('stability')
        call this%find_growth()
      end if
      call this%stopwatch%start('step control')
      call this%choose_steps(error)
      if (allocated(error)) return
    end if
    if (scene%accuracy%estimate) then
      call this%stopwatch%start('error estimate')
      if (scene%melts .and. .not. scene%time%steady) then
        call this%prepare_coarser(error, further)
      else
        call this%prepare_estimate(error, further)
      end if
      if (allocated(error)) return
    end if
    call this%stopwatch%stop()
  end subroutine prepare

  subroutine run(this, error, observer, lean)
    class(simulation_t), intent(inout) :: this
    !> The numbers went wrong, or a file could not be written; or the run was interrupted
    type(error_t), allocatable, intent(out) :: error
    !> Who is told about the progress
    class(observer_t), intent(inout), optional, target :: observer
    !> Keep no more of cloud and rows than steps and files need. Where particles are and which area
    !> they have is in `conduction%medium` then, if not in `cloud`
    logical, intent(in), optional :: lean
    type(checkpoint_clock_t), target :: clock
    type(simulation_file_t) :: file
    type(error_t), allocatable :: file_error
    real(wp) :: next
    !> Whether the run was interrupted, and whether the state lies between two that are written
    logical :: stopped, amid
    !> Whether memory that is not needed goes back to the system
    logical :: frugal

    call this%certify(error)
    if (allocated(error)) return
    if (this%scene%time%steady) then
      call this%settle(error)
      if (allocated(error)) return
    end if
    call this%open_file(file, error)
    if (allocated(error)) return
    frugal = .false.
    if (present(lean)) frugal = lean
    if (frugal) call this%free_what_steps_spare()
    if (present(observer)) clock%next => observer
    call clock%start(this%scene%checkpoint, this%time)
    this%stepper%listener => clock
    stopped = .false.
    if (this%written < 0) then
      if (allocated(this%motion)) call this%settle_rows(error)
      if (.not. allocated(error)) call this%write_present_state(file, file_error, observer)
    end if
    if (frugal) call give_back_freed_memory()
    do while (this%time < this%scene%time%end .and. .not. this%scene%time%steady)
      if (allocated(error) .or. allocated(file_error)) exit
      next = this%next_output()
      call this%advance_to(next, error)
      stopped = allocated(error) .and. interrupted()
      amid = this%time < next .and. (stopped .or. .not. allocated(error))
      if (amid) then
        call this%write_checkpoint(file, file_error)
        call clock%reset(this%time)
        if (allocated(file_error)) exit
        if (.not. stopped) cycle
        call this%settle_state(error)
      else if (stopped) then
        deallocate (error)
      end if
      if (allocated(this%motion) .and. .not. allocated(error)) call this%settle_rows(error)
      ! A run that makes no step leaves the file of before.
      if (allocated(error) .and. this%stepper%steps == 0) exit
      if (.not. amid) this%written = this%written + 1
      ! After a failure the state is the last good one: it is written too.
      call this%write_present_state(file, file_error, observer)
      if (frugal) call give_back_freed_memory()
      if (amid .or. allocated(error) .or. allocated(file_error)) exit
      if (stopped .or. clock%is_due(this%time) .or. &
          (this%scene%checkpoint%asked .and. .not. this%time < this%scene%time%end)) then
        call this%write_checkpoint(file, file_error)
        call clock%reset(this%time)
      end if
      if (stopped) exit
    end do
    nullify (this%stepper%listener)
    call finish()

  contains

    !> Complete the file, and say what became of the run.
    subroutine finish()
      logical :: fruitless

      fruitless = allocated(error) .and. this%stepper%steps == 0
      if (allocated(file_error) .or. fruitless) then
        call file%abandon()
      else
        call file%begin_closing()
        call file%write_budget(this%budget, this%entries)
        if (this%knows_exact()) call file%note('relative_l2_error', this%relative_l2_error())
        if (this%estimates_error()) then
          call file%note('estimated_error', this%estimated_error())
          call file%note('estimated_maximum_error', this%estimated_maximum_error())
        end if
        call file%close(this%stopwatch%phases, file_error)
      end if
      if (allocated(file_error) .and. (stopped .or. .not. allocated(error))) then
        if (allocated(error)) deallocate (error)
        call move_alloc(file_error, error)
      else if (stopped .and. .not. allocated(error)) then
        call raise(error, interrupt_status(), 'Interrupted at t = '// &
                   to_text(this%time, digits=6)//' s. The state is in '// &
                   this%scene%checkpoint%file//'; go on by'//new_line('a')// &
                   'calor run --resume '//this%scene%path)
      else if (allocated(error) .and. file%in_use .and. .not. (allocated(file_error) .or. &
                                                               fruitless)) then
        error%message = error%message//new_line('a')//'The last good state, at t = '// &
                        to_text(this%time, digits=6)//' s, is in '//this%scene%output%file//'.'
      end if
    end subroutine finish

  end subroutine run

  !> Begin the output file; where the run was resumed, with the states of before.
  subroutine open_file(this, file, error)
    class(simulation_t), intent(inout) :: this
    type(simulation_file_t), intent(inout) :: file
    !> It cannot be written, or the one of before is not what it was
    type(error_t), allocatable, intent(out) :: error
    type(stored_fields_t) :: earlier
    logical :: goes_on

    goes_on = .false.
    if (allocated(this%earlier_file)) then
      goes_on = this%earlier_file == this%scene%output%file .and. this%earlier_file /= ''
    end if
    if (goes_on) then
      call check_earlier_file()
      if (allocated(error)) return
      call file%open(this%scene, this%cloud, this%effects_in_force(), error, earlier)
    else
      call file%open(this%scene, this%cloud, this%effects_in_force(), error)
    end if
    if (.not. allocated(error)) then
      if (.not. allocated(this%method_note) .and. allocated(this%method)) then
        this%method_note = this%method
        if (allocated(this%choice)) then
          this%method_note = this%method//' ('//this%choice%sentence()//')'
        end if
      end if
      if (allocated(this%method_note)) call file%say('time_method', this%method_note)
      if (.not. allocated(this%motion)) call this%write_row_fields(file)
    end if
    if (.not. goes_on) return
    if (.not. allocated(error)) call file%take_over(earlier, size(this%entries), error)
    call earlier%close()

  contains

    !> The states of before must still be there.
    subroutine check_earlier_file()
      type(error_t), allocatable :: unreadable
      type(scene_file_t) :: before, last
      logical :: fits
      integer :: k

      inquire (file=this%earlier_file, exist=fits)
      if (fits) call earlier%open(this%earlier_file, unreadable)
      fits = fits .and. .not. allocated(unreadable)
      if (fits) then
        fits = earlier%particles == this%cloud%particles() .and. &
               size(earlier%time) >= size(this%entries)
      end if
      ! An older checkpoint may be taken up after a run from a later one to another end.
      if (fits) then
        call parse_scene_text(this%earlier_scene, 'scene', before, unreadable)
        if (.not. allocated(unreadable)) then
          call parse_scene_text(earlier%note('scene'), 'scene', last, unreadable)
        end if
        fits = .not. allocated(unreadable)
      end if
      if (fits) fits = size(scene_changes(before, last)) == 0
      do k = 1, size(this%entries)
        if (fits) fits = .not. abs(earlier%time(k) - this%entries(k)%time) > 0
      end do
      if (fits) return
      call earlier%close()
      call raise(error, status_bad_file, 'The output file '''//this%earlier_file// &
                 ''' does not hold the '//to_text(size(this%entries))//' states that belong to '// &
                 'the checkpoint: put it back, or name another &output file for the states '// &
                 'from here on.')
    end subroutine check_earlier_file

  end subroutine open_file

  !> The time of the next state that is written, s
  pure function next_output(this) result(time)
    class(simulation_t), intent(in) :: this
    real(wp) :: time

    time = this%scene%time%end
    if (this%written + 1 < states_after_start(this%scene)) then
      time = (this%written + 1)*this%scene%output%every
    end if
  end function next_output

  !> Write the present state with its heat budget.
  subroutine write_present_state(this, file, error, observer)
    class(simulation_t), intent(inout) :: this
    type(simulation_file_t), intent(inout) :: file
    !> The file cannot be written
    type(error_t), allocatable, intent(out) :: error
    class(observer_t), intent(inout), optional :: observer

    if (allocated(this%motion)) call file%move_points(this%cloud)
    call this%stopwatch%start('output')
    call this%note_budget()
    if (this%estimates_error()) then
      call file%begin_state(this%time, this%temperature, this%exact, this%liquid_fraction(), &
                            this%error_estimate())
    else
      call file%begin_state(this%time, this%temperature, this%exact, this%liquid_fraction())
    end if
    if (allocated(this%motion)) call this%write_row_fields(file)
    call file%write_state(error)
    call this%stopwatch%stop()
    this%written = max(this%written, 0)
    if (present(observer) .and. .not. allocated(error)) call observer%reached(this)
  end subroutine write_present_state

  !> Lay the state aside. The output file takes its place before: it belongs to it.
  subroutine write_checkpoint(this, file, error)
    class(simulation_t), intent(inout) :: this
    type(simulation_file_t), intent(inout) :: file
    !> One of the two cannot be written
    type(error_t), allocatable, intent(out) :: error
    type(saved_state_t) :: state

    call this%stopwatch%start('output')
    call file%publish(error)
    if (allocated(error)) return
    call this%save(state)
    call write_checkpoint_file(this%scene%checkpoint%file, state, this%scene%checkpoint%keep, error)
    call this%stopwatch%stop()
  end subroutine write_checkpoint

  !> Between two states that are written, after the checkpoint: bring all up to the present time.
  subroutine settle_state(this, error)
    class(simulation_t), intent(inout) :: this
    !> The error cannot be brought up
    type(error_t), allocatable, intent(out) :: error

    if (allocated(this%estimate)) then
      if (allocated(this%content)) then
        call this%estimate%catch_up(this%conduction, this%time, this%content, error)
      else
        call this%estimate%catch_up(this%conduction, this%time, this%temperature, error)
      end if
    end if
    if (allocated(this%coarser) .and. .not. allocated(error)) call this%advance_coarser(error)
    if (allocated(this%motion)) then
      if (this%motion%under_way) call this%motion%go_to(this%time, this%cloud, this%conduction)
    end if
  end subroutine settle_state

  subroutine resume(this, scene, path, error)
    class(simulation_t), intent(out) :: this
    !> The scene
    type(scene_t), intent(in) :: scene
    !> The checkpoint; '': the one that the scene names
    character(len=*), intent(in) :: path
    !> The checkpoint cannot be used
    type(error_t), allocatable, intent(out) :: error
    type(saved_state_t) :: state

    call read_resume_point(scene, path, state, error)
    if (allocated(error)) return
    if (state%has('particles_file')) then
      call raise(error, status_bad_file, 'The checkpoint was written by calor-mpi: resume '// &
                 scene%path//' by that.')
      return
    end if
    ! What certifies the operator is in the checkpoint.
    call this%prepare(scene, error, uncertified=.true.)
    if (allocated(error)) return
    call this%restore(state, error)
  end subroutine resume

  !> Lay aside all that the rest of the run depends on and `prepare` does not know.
  recursive subroutine save_simulation(this, state)
    class(simulation_t), intent(in) :: this
    type(saved_state_t), intent(inout) :: state
    integer :: k

    call save_scene(this%scene, state)
    call state%put('time', this%time)
    call state%put('written', this%written)
    call state%put('temperature', this%temperature)
    if (allocated(this%content)) call state%put('content', this%content)
    call state%put('method', this%method)
    if (allocated(this%method_note)) call state%put('method_note', this%method_note)
    call state%enter('rightmost_eigenvalue')
    call state%put('value', [this%rightmost%growth_rate, this%rightmost%frequency])
    call state%put('converged', this%rightmost%converged)
    call state%put('method', trim(this%rightmost%method))
    call state%put('place', this%rightmost%place)
    if (allocated(this%conduction%suspicion)) then
      call state%put('suspicion', this%conduction%suspicion)
    end if
    call state%leave()
    call this%stepper%save(state)
    call this%conduction%save(state)
    if (allocated(this%estimate)) then
      call this%estimate%save(state)
      select type (reference => this%estimate%reference)
      type is (conduction_t)
        call state%enter('reference')
        call reference%save(state)
        call state%leave()
      end select
    end if
    if (allocated(this%motion)) then
      call state%enter('motion')
      call this%motion%save(this%cloud, state)
      call state%leave()
    end if
    if (allocated(this%reference_motion)) then
      call state%enter('reference_motion')
      call this%reference_motion%save(this%cloud, state)
      call this%reference_change%save(state)
      call state%leave()
    end if
    if (allocated(this%coarser)) then
      select type (coarser => this%coarser)
      type is (simulation_t)
        call state%enter('coarser')
        call coarser%save(state)
        call state%leave()
      end select
      call this%deviation%save(state)
    end if
    call state%put('output_file', this%scene%output%file)
    call this%budget%save_entries(this%entries, state)
    call state%enter('wall_time')
    call state%put('seconds', this%stopwatch%phases%seconds)
    do k = 1, size(this%stopwatch%phases)
      call state%put('phase_'//to_text(k), trim(this%stopwatch%phases(k)%name))
    end do
    call state%leave()
  end subroutine save_simulation

  !> Take up what was laid aside, after `prepare`.
  recursive subroutine restore_simulation(this, state, error)
    class(simulation_t), intent(inout) :: this
    type(saved_state_t), intent(inout) :: state
    !> It does not fit
    type(error_t), allocatable, intent(out) :: error
    type(scene_rows_t) :: rows
    real(wp) :: radius, longest
    logical :: renewed

    call state%get('time', this%time)
    call state%get('written', this%written)
    call state%get('output_file', this%earlier_file)
    call state%get('scene', this%earlier_scene)
    call state%get('temperature', this%temperature)
    if (allocated(this%content)) call state%get('content', this%content)
    if (size(this%temperature) /= this%cloud%particles()) then
      call raise(error, status_bad_file, 'The checkpoint has '// &
                 to_text(size(this%temperature))//' particles, and the scene '// &
                 to_text(this%cloud%particles())//'.')
      return
    end if
    call state%get('method', this%method)
    if (state%has('method_note')) call state%get('method_note', this%method_note)
    if (allocated(this%reference_motion)) then
      select type (reference => this%estimate%reference)
      type is (conduction_t)
        call state%enter('reference_motion')
        call this%reference_motion%restore(this%reference_scene, this%cloud, reference, rows, &
                                           renewed, .true., state, error)
        call this%reference_change%restore(state)
        call state%leave()
        if (allocated(error)) return
        call state%enter('reference')
        call reference%restore(state)
        call state%leave()
      end select
    end if
    if (allocated(this%motion)) then
      call state%enter('motion')
      call this%motion%restore(this%scene, this%cloud, this%conduction, rows, renewed, .false., &
                               state, error)
      call state%leave()
      if (allocated(error)) return
      if (renewed) call this%adopt_rows(rows)
      if (this%scene%motion%shifting) call this%budget%weigh_by_area()
    end if
    call this%conduction%restore(state)
    if (allocated(this%estimate)) call this%estimate%restore(state)
    if (allocated(this%coarser)) then
      select type (coarser => this%coarser)
      type is (simulation_t)
        call state%enter('coarser')
        call coarser%restore(state, error)
        call state%leave()
        if (allocated(error)) return
      end select
      call this%deviation%restore(state)
    end if
    ! A new integrator: the one at hand may have steps of its own behind it.
    call make_integrator(this%method, this%stepper%integrator, error)
    if (allocated(error)) return
    radius = this%stepper%spectral_radius
    longest = this%stepper%longest_step
    call this%stepper%restore(state)
    call restore_certificate(this, state)
    call restore_records(this, state)
    if (allocated(state%problem)) then
      call raise(error, status_bad_file, 'The checkpoint lacks '''//state%problem//'''.')
      return
    end if
    call allow_for_changes()

  contains

    !> End time and times of output may be others now.
    subroutine allow_for_changes()
      type(scene_file_t) :: before
      type(error_t), allocatable :: ignored
      type(group_t) :: group
      real(wp) :: end_time, every

      every = 0
      end_time = this%scene%time%end
      call parse_scene_text(this%earlier_scene, 'scene', before, ignored)
      call before%group('time', group)
      if (group%has('end')) call get(group, 'end', end_time, ignored)
      call before%group('output', group)
      if (group%has('every')) call get(group, 'every', every, ignored)
      if (abs(end_time - this%scene%time%end) > 0) then
        ! What changes with time may become stiffer than was known.
        this%stepper%spectral_radius = max(radius, this%stepper%spectral_radius)
        this%stepper%longest_step = min(longest, this%stepper%longest_step)
      else if (.not. abs(every - this%scene%output%every) > 0) then
        return
      end if
      this%written = 0
      if (this%scene%output%every > 0) then
        this%written = int(this%time/this%scene%output%every*(1 + 1.0e-12_wp))
      end if
    end subroutine allow_for_changes

  end subroutine restore_simulation

  !> What is known of the stability of the operator
  subroutine restore_certificate(this, state)
    class(simulation_t), intent(inout) :: this
    type(saved_state_t), intent(inout) :: state
    real(wp), allocatable :: value(:)
    character(len=:), allocatable :: method

    call state%enter('rightmost_eigenvalue')
    call state%get('value', value)
    if (allocated(value)) then
      this%rightmost%growth_rate = value(1)
      this%rightmost%frequency = value(2)
    end if
    call state%get('converged', this%rightmost%converged)
    method = ''
    call state%get('method', method)
    this%rightmost%method = method
    call state%get('place', this%rightmost%place)
    if (state%has('suspicion')) call state%get('suspicion', this%conduction%suspicion)
    call state%leave()
  end subroutine restore_certificate

  !> The heat budgets of the states written, and the wall time so far
  subroutine restore_records(this, state)
    class(simulation_t), intent(inout) :: this
    type(saved_state_t), intent(inout) :: state
    type(stopwatch_t) :: earlier
    character(len=:), allocatable :: name
    real(wp), allocatable :: seconds(:)
    integer :: k

    call this%budget%restore_entries(this%entries, state)
    call state%enter('wall_time')
    call state%get('seconds', seconds)
    if (.not. allocated(state%problem)) then
      name = ''
      do k = 1, size(seconds)
        call state%get('phase_'//to_text(k), name)
        call earlier%start(name)
        call earlier%stop()
        earlier%phases(k)%seconds = seconds(k)
      end do
      call earlier%add(this%stopwatch)
      this%stopwatch = earlier
    end if
    call state%leave()
  end subroutine restore_records

  !> Free what set-up has left of cloud and rows and steps do not need. Implicit steps and the
  !> estimate of the error take the rows as they were assembled, moving particles new ones, and an
  !> estimate from a coarser run the places of the cloud.
  subroutine free_what_steps_spare(this)
    class(simulation_t), intent(inout) :: this
    type(cloud_t) :: bare

    if (allocated(this%motion) .or. allocated(this%estimate) .or. this%scene%time%steady) return
    if (this%method /= 'tr_bdf2') call this%conduction%keep_streamed_rows()
    this%report = row_report_t()
    this%repairs = row_repairs_t()
    if (allocated(this%radius)) deallocate (this%radius)
    if (allocated(this%coarser)) return
    bare%spacing = this%cloud%spacing
    call move_alloc(this%cloud%boundary, bare%boundary)
    this%cloud = bare
  end subroutine free_what_steps_spare

  !> Fields about the rows, which change only where particles move, if the scene asks for them.
  subroutine write_row_fields(this, file)
    class(simulation_t), intent(in) :: this
    type(simulation_file_t), intent(inout) :: file
    real(wp), allocatable :: values(:)
    integer :: k

    if (.not. file%in_use) return
    allocate (values(this%cloud%particles()))
    do k = 1, size(this%scene%output%fields)
      associate (name => this%scene%output%fields(k)%value)
        if (.not. is_row_field(name)) cycle
        call find_row_field(name, this%conduction%laplacian%target, this%report, this%repairs, &
                            this%radius, values)
        if (allocated(this%motion)) then
          call file%add_field(name, values)
        else
          call file%write_static(name, values)
        end if
      end associate
    end do
  end subroutine write_row_fields

  subroutine settle(this, error)
    class(simulation_t), intent(inout) :: this
    !> There is none, or it was not found
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: tolerance

    call this%stopwatch%start('steady state')
    ! Where nothing changes any more, heat contents do not matter.
    if (allocated(this%conduction%content)) this%conduction%content%steady = .true.
    tolerance = default_tolerance
    if (this%scene%time%tolerance > 0) tolerance = this%scene%time%tolerance
    call find_steady_state(this%conduction, this%scene%time%place, &
                           tolerance*this%conduction%temperature_scale(), this%temperature, &
                           this%newton_steps, error)
    if (allocated(this%conduction%content)) this%conduction%content%steady = .false.
    if (allocated(error)) return
    if (allocated(this%content)) call this%conduction%find_state(this%temperature, this%content)
    call this%budget%close_exactly(this%conduction)
    if (allocated(this%estimate)) then
      call this%stopwatch%start('error estimate')
      call settle_reference(this%estimate%reference)
    end if
    call this%stopwatch%stop()

  contains

    !> The error of a steady temperature is what leads from it to that of the higher order.
    subroutine settle_reference(reference)
      class(evolution_t), intent(inout) :: reference
      integer :: steps

      select type (reference)
      type is (conduction_t)
        if (allocated(reference%content)) reference%content%steady = .true.
        this%estimate%error = this%temperature
        call find_steady_state(reference, this%scene%time%place, &
                               tolerance*this%conduction%temperature_scale(), &
                               this%estimate%error, steps, error)
        this%estimate%error = this%estimate%error - this%temperature
      end select
    end subroutine settle_reference

  end subroutine settle

  !> The heat budget of the present state
  subroutine note_budget(this)
    class(simulation_t), intent(inout) :: this
    type(budget_entry_t), allocatable :: longer(:)
    integer :: k, n

    n = size(this%entries)
    allocate (longer(n + 1))
    do k = 1, n
      longer(k) = this%entries(k)
    end do
    if (allocated(this%content)) then
      call this%budget%evaluate(this%conduction, this%time, this%content, longer(n + 1))
    else
      call this%budget%evaluate(this%conduction, this%time, this%temperature, longer(n + 1))
    end if
    call move_alloc(longer, this%entries)
  end subroutine note_budget

  !> What is in force and why, one text for each: conduction, held walls and effects.
  function effects_in_force(this) result(texts)
    class(simulation_t), intent(in) :: this
    type(text_t), allocatable :: texts(:)
    type(materials_t) :: materials
    type(error_t), allocatable :: error
    integer :: k

    call append(texts, 'conduction')
    do k = 1, size(this%scene%boundaries)
      associate (boundary => this%scene%boundaries(k))
        if (boundary%kind /= 'temperature') cycle
        call append(texts, 'temperature held on '''//boundary%on//'''')
      end associate
    end do
    if (allocated(this%motion)) then
      call append(texts, 'motion ('//this%motion%velocity%place//')')
      if (this%scene%motion%shifting) then
        call append(texts, 'shifting ('//this%scene%motion%place//')')
      end if
    end if
    ! They have been read before.
    call read_materials(this%scene%file, materials, error)
    texts = [texts, materials%in_force()]
    if (.not. allocated(this%conduction%effects)) return
    do k = 1, size(this%conduction%effects)
      associate (effect => this%conduction%effects(k)%effect)
        call append(texts, trim(effect%name)//' ('//effect%reason//')')
      end associate
    end do
  end function effects_in_force

  recursive subroutine advance_to(this, time, error)
    class(simulation_t), intent(inout) :: this
    !> Time to reach, s
    real(wp), intent(in) :: time
    !> The numbers went wrong; time and temperature are those of the last good state
    type(error_t), allocatable, intent(out) :: error
    type(error_t), allocatable :: coarser_error
    real(wp) :: next, interval

    if (.not. allocated(this%coarser)) then
      call this%advance_alone(time, error)
      return
    end if
    ! Both runs are compared at even times, too, whatever states are written.
    interval = this%scene%time%end/comparisons
    do
      next = min(time, interval*(floor(this%time/interval*(1 + 1.0e-12_wp)) + 1))
      if (time - next < 1.0e-9_wp*interval) next = time
      call this%advance_alone(next, error)
      ! What pauses amid an interval leaves the coarser run behind.
      if (this%time < next) return
      if (allocated(error) .and. .not. interrupted()) return
      call this%advance_coarser(coarser_error)
      if (allocated(coarser_error)) call move_alloc(coarser_error, error)
      if (allocated(error) .or. .not. next < time) return
    end do
  end subroutine advance_to

  !> Step to a time, without the coarser run.
  subroutine advance_alone(this, time, error)
    class(simulation_t), intent(inout) :: this
    !> Time to reach, s
    real(wp), intent(in) :: time
    !> The numbers went wrong
    type(error_t), allocatable, intent(out) :: error

    if (allocated(this%motion)) then
      call this%advance_moving(time, error)
      call this%stopwatch%stop()
    else
      call this%advance_resting(time, error)
    end if
  end subroutine advance_alone

  !> Bring the coarser run to the present time, and compare.
  recursive subroutine advance_coarser(this, error)
    class(simulation_t), intent(inout) :: this
    !> The numbers went wrong
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: difference(:)

    call this%stopwatch%start('error estimate')
    allocate (difference(size(this%temperature)))
    select type (coarser => this%coarser)
    type is (simulation_t)
      call coarser%advance_to(this%time, error)
      call interpolate_field(coarser%cloud%x, coarser%cloud%y, coarser%temperature, &
                             coarser%cloud%spacing, 1, this%cloud%x, this%cloud%y, difference)
    end select
    if (.not. allocated(error)) then
      difference = this%temperature - difference
      call this%conduction%clear_prescribed(difference)
      call this%deviation%note(difference, this%liquid_fraction(), this%cloud%area)
    end if
    call this%stopwatch%stop()
    if (allocated(error)) error%message = coarser_run//error%message
  end subroutine advance_coarser

  !> Step to a time with the rows as they are.
  subroutine advance_resting(this, time, error)
    class(simulation_t), intent(inout) :: this
    !> Time to reach, s
    real(wp), intent(in) :: time
    !> The numbers went wrong
    type(error_t), allocatable, intent(out) :: error

    if (allocated(this%content)) then
      call advance(this%content)
      call this%conduction%find_temperature(this%content, this%temperature)
    else
      call advance(this%temperature)
    end if

  contains

    subroutine advance(state)
      real(wp), intent(inout), contiguous :: state(:)
      type(error_t), allocatable :: transport_error

      call this%stopwatch%start('steps')
      if (allocated(this%estimate)) then
        call this%stepper%advance_to(this%conduction, this%time, time, state, error, &
                                     watcher=this%estimate)
        if (.not. this%time < time .and. (interrupted() .or. .not. allocated(error))) then
          call this%estimate%catch_up(this%conduction, this%time, state, transport_error)
        end if
        if (allocated(transport_error) .and. .not. allocated(error)) then
          call move_alloc(transport_error, error)
        end if
        call this%stopwatch%stop()
        call this%stopwatch%take_over(this%estimate%stopwatch, 'steps')
      else
        call this%stepper%advance_to(this%conduction, this%time, time, state, error)
        call this%stopwatch%stop()
      end if
    end subroutine advance

  end subroutine advance_resting

  !> Step to a time while particles move: each step of the motion has rows of its own, for the cloud
  !> in its middle, and conduction takes as many steps in it as it needs.
  subroutine advance_moving(this, time, error)
    class(simulation_t), intent(inout) :: this
    !> Time to reach, s
    real(wp), intent(in) :: time
    !> The numbers went wrong, or the motion spoilt the cloud
    type(error_t), allocatable, intent(out) :: error
    type(scene_rows_t) :: rows
    type(error_t), allocatable :: ignored
    type(error_t), allocatable :: shift_error
    real(wp) :: until
    logical :: renewed

    do while (this%time < time)
      call this%stopwatch%start('motion')
      if (.not. this%motion%under_way) then
        call begin_step()
        if (allocated(error)) return
      end if
      call this%advance_resting(this%motion%until, error)
      call this%stopwatch%start('motion')
      ! A pause, or an interrupt: the step can be continued.
      if (this%time < this%motion%until .and. (interrupted() .or. .not. allocated(error))) return
      this%motion%under_way = .false.
      if (allocated(this%reference_motion)) this%reference_motion%under_way = .false.
      call this%motion%go_to(this%time, this%cloud, this%conduction)
      if (allocated(error) .and. .not. interrupted()) return
      if (this%scene%motion%shifting) then
        call this%stopwatch%start('shifting')
        call this%shift_particles(shift_error)
        if (allocated(shift_error) .and. .not. allocated(error)) call move_alloc(shift_error, error)
      end if
      if (allocated(error)) return
    end do

  contains

    !> Choose a step of the motion and go to its middle.
    subroutine begin_step()
      call this%motion%plan(this%cloud, this%time, time - this%time, error)
      if (allocated(error)) return
      until = this%time + this%motion%path%step
      if (until >= time - 4*spacing(time)) until = time
      call this%motion%enter_middle(this%scene, this%cloud, this%conduction, rows, renewed, &
                                    error, this%stopwatch)
      if (.not. allocated(error) .and. renewed) call this%adopt_rows(rows, error)
      if (.not. allocated(error) .and. allocated(this%estimate)) then
        call this%take_reference_along(renewed, error)
      end if
      if (allocated(error)) then
        ! Back to the last good state
        call this%motion%go_to(this%time, this%cloud, this%conduction)
        call this%settle_rows(ignored)
        return
      end if
      this%motion%until = until
      this%motion%under_way = .true.
      if (allocated(this%reference_motion)) then
        this%reference_motion%until = until
        this%reference_motion%under_way = .true.
      end if
      call this%stepper%integrator%restart()
    end subroutine begin_step

  end subroutine advance_moving

  !> Make the reference's rows for where the cloud is now: amid a step of the motion.
  subroutine take_reference_along(this, renewed, error)
    class(simulation_t), intent(inout) :: this
    !> Whether the scene's own rows are new
    logical, intent(in) :: renewed
    !> There are none
    type(error_t), allocatable, intent(out) :: error
    type(scene_rows_t) :: rows
    logical :: reference_renewed

    call this%stopwatch%start('error estimate')
    select type (reference => this%estimate%reference)
    type is (conduction_t)
      associate (motion => this%reference_motion, path => this%motion%path, &
                 change => this%reference_change)
        call change%note_before(reference, this%time, this%state(), motion%rows_time)
        call motion%accompany(this%motion)
        call motion%enter_middle(this%reference_scene, this%cloud, reference, rows, &
                                 reference_renewed, error, this%stopwatch)
        if (allocated(error)) return
        if (.not. (renewed .or. reference_renewed)) return
        call reference%linearise(this%time, this%state())
        call change%note_after(reference, this%time, this%state(), motion%rows_time, path%step)
        call this%estimate%add_source(change%mean, change%slope, path%time + 0.5_wp*path%step)
        call this%estimate%renew(this%conduction, this%time, this%state(), &
                                 reference%spectral_bound())
      end associate
    end select
  end subroutine take_reference_along

  !> Spread particles evenly, and take the temperatures and their error to the new places.
  subroutine shift_particles(this, error)
    class(simulation_t), intent(inout) :: this
    !> There are no rows for the new places
    type(error_t), allocatable, intent(out) :: error
    type(scene_rows_t) :: rows
    logical :: renewed
    real(wp), allocatable :: x(:), y(:), further_x(:), further_y(:), better(:)
    integer(ip), allocatable :: origin(:)

    call this%motion%find_shift(this%cloud, x, y, origin)
    if (allocated(this%estimate)) better = this%temperature
    call this%motion%carry(this%scene, this%cloud, origin, x, y, this%temperature)
    if (allocated(this%estimate)) then
      ! The reference carries the field to a higher order; the difference is an error.
      further_x = x
      further_y = y
      call this%reference_motion%carry(this%reference_scene, this%cloud, origin, further_x, &
                                       further_y, better)
      where (further_x /= x .or. further_y /= y) better = this%temperature
      better = better - this%temperature
      further_x = x
      further_y = y
      call this%reference_motion%carry(this%reference_scene, this%cloud, origin, further_x, &
                                       further_y, this%estimate%error)
      this%estimate%error = this%estimate%error + better
      call this%conduction%clear_prescribed(this%estimate%error)
    end if
    call this%motion%move_to(x, y, this%cloud, this%conduction)
    call this%conduction%impose(this%time, this%temperature)
    if (.not. allocated(this%estimate)) return
    ! How rows change with the motion is seen by those of the same particles.
    select type (reference => this%estimate%reference)
    type is (conduction_t)
      call this%stopwatch%start('error estimate')
      call this%reference_motion%accompany(this%motion)
      call this%reference_motion%renew_rows(this%reference_scene, this%cloud, reference, rows, &
                                            renewed, error, this%stopwatch)
      if (allocated(error)) return
      this%reference_motion%rows_time = this%time
      call reference%follow(this%cloud%x, this%cloud%y, this%motion%places)
    end select
  end subroutine shift_particles

  !> Rows for where the particles are, as what is told of a state needs them.
  subroutine settle_rows(this, error)
    class(simulation_t), intent(inout) :: this
    !> There are none
    type(error_t), allocatable, intent(out) :: error
    type(scene_rows_t) :: rows
    logical :: renewed

    call this%stopwatch%start('motion')
    call this%motion%renew_rows(this%scene, this%cloud, this%conduction, rows, renewed, error, &
                                this%stopwatch)
    if (allocated(error) .or. .not. renewed) return
    call this%adopt_rows(rows, error)
    call this%conduction%follow(this%cloud%x, this%cloud%y, this%motion%places)
    if (.not. this%scene%motion%shifting) return
    call this%motion%share_area(this%cloud)
    this%conduction%medium%area = this%cloud%area
    call this%budget%weigh_by_area()
  end subroutine settle_rows

  !> Note what is known of new rows; where particles move, see whether the run can go on with them.
  subroutine adopt_rows(this, rows, error)
    class(simulation_t), intent(inout) :: this
    !> Is moved
    type(scene_rows_t), intent(inout) :: rows
    !> It cannot
    type(error_t), allocatable, intent(out), optional :: error

    this%report = rows%report
    this%repairs = rows%repairs
    call move_alloc(rows%radius, this%radius)
    call this%count_neighbours()
    if (.not. present(error)) return
    call this%conduction%linearise(this%time, this%state())
    call this%check_rows(error)
    if (allocated(error)) then
      error%message = 'At t = '//to_text(this%time, digits=6)//' s the motion has spoilt the '// &
                      'cloud. '//error%message
      if (.not. this%scene%motion%shifting) then
        error%message = error%message//' &motion shifting = .true. keeps particles evenly spread.'
      end if
      return
    end if
    call this%adapt_steps(error)
  end subroutine adopt_rows

  !> The unknowns: heat contents where they are kept, temperatures elsewhere.
  pure function state(this)
    class(simulation_t), intent(in) :: this
    real(wp), allocatable :: state(:)

    if (allocated(this%content)) then
      state = this%content
    else
      state = this%temperature
    end if
  end function state

  !> An array of length 0 where nothing melts.
  pure function liquid_fraction(this) result(fraction)
    class(simulation_t), intent(in) :: this
    real(wp), allocatable :: fraction(:)

    if (allocated(this%content)) then
      allocate (fraction(size(this%content)))
      call this%conduction%find_liquid_fraction(this%content, fraction)
    else
      allocate (fraction(0))
    end if
  end function liquid_fraction

  function knows_exact(this) result(answer)
    class(simulation_t), intent(in) :: this
    logical :: answer

    answer = this%scene%exact_expression /= ''
  end function knows_exact

  function relative_l2_error(this) result(deviation)
    class(simulation_t), intent(in) :: this
    real(wp) :: deviation
    real(wp), allocatable :: exact(:)
    real(wp) :: norm

    associate (medium => this%conduction%medium)
      allocate (exact(medium%particles()))
      call this%exact%evaluate(medium%x, medium%y, this%time, values=exact)
      norm = sqrt(sum(medium%area*exact**2))
      deviation = sqrt(sum(medium%area*(this%temperature - exact)**2))
    end associate
    if (norm > 0) deviation = deviation/norm
  end function relative_l2_error

  function estimates_error(this) result(answer)
    class(simulation_t), intent(in) :: this
    logical :: answer

    answer = allocated(this%estimate) .or. allocated(this%coarser)
  end function estimates_error

  !> The error of each temperature: what is carried along is that of the unknown. Where something
  !> melts, the root of its mean square while a front passes a particle.
  function error_estimate(this) result(deviation)
    class(simulation_t), intent(in) :: this
    real(wp), allocatable :: deviation(:)

    if (allocated(this%coarser)) then
      deviation = this%deviation%error(size(this%temperature))
      return
    end if
    deviation = this%estimate%error
    ! A steady state is found in terms of the temperature.
    if (allocated(this%content) .and. .not. this%scene%time%steady) then
      deviation = this%temperature_slope()*deviation
    end if
  end function error_estimate

  !> dT/dv of the present heat contents
  function temperature_slope(this) result(slope)
    class(simulation_t), intent(in) :: this
    real(wp), allocatable :: slope(:)
    type(heat_content_t) :: laws
    real(wp), allocatable :: unused(:)

    allocate (slope(size(this%content)), unused(size(this%content)))
    laws = this%conduction%content
    call laws%slopes(this%content, slope, unused)
  end function temperature_slope

  function estimated_error(this) result(deviation)
    class(simulation_t), intent(in) :: this
    real(wp) :: deviation
    real(wp) :: norm

    associate (area => this%cloud%area, e => this%error_estimate())
      norm = sqrt(sum(area*(this%temperature + e)**2))
      deviation = sqrt(sum(area*e**2))
      if (norm > 0) deviation = deviation/norm
    end associate
  end function estimated_error

  function estimated_maximum_error(this) result(largest)
    class(simulation_t), intent(in) :: this
    real(wp) :: largest

    largest = maxval(abs(this%error_estimate()))
  end function estimated_maximum_error

  !> The same scene with particles twice as far apart.
  subroutine prepare_coarser(this, error, further)
    class(simulation_t), intent(inout) :: this
    type(error_t), allocatable, intent(out) :: error
    type(effect_slot_t), intent(in), optional :: further(:)
    type(scene_t) :: scene

    scene = this%scene
    scene%accuracy%estimate = .false.
    scene%domain%spacing = 2*this%cloud%spacing
    scene%output%file = ''
    allocate (simulation_t :: this%coarser)
    select type (coarser => this%coarser)
    type is (simulation_t)
      call coarser%prepare(scene, error, further, uncertified=.true.)
      if (.not. allocated(error)) call coarser%certify(error)
      ! A step of the run is not over before its estimate has come to the same time.
      coarser%stepper%interruptible = .false.
    end select
    if (allocated(error)) error%message = coarser_run//error%message
  end subroutine prepare_coarser

  !> The same problem by a scheme of higher order, with which the error is carried along.
  subroutine prepare_estimate(this, error, further)
    class(simulation_t), intent(inout) :: this
    type(error_t), allocatable, intent(out) :: error
    type(effect_slot_t), intent(in), optional :: further(:)
    type(scene_t) :: scene
    type(materials_t) :: materials
    type(conduction_t) :: reference
    type(method_t) :: method
    type(scene_rows_t) :: rows
    type(row_maker_t) :: maker
    type(expression_t) :: initial
    type(body_t) :: body
    real(wp), allocatable :: temperature(:)

    scene = this%scene
    scene%support_growth = .true.
    scene%order = lowest_reference_order
    if (scene%laplacian == 'consistent') then
      call read_materials(scene%file, materials, error)
      if (allocated(error)) return
      scene%order = reference_order(this%scene%order, this%cloud%particles(), &
                                    allocated(materials%list))
    end if
    scene%laplacian = 'consistent'
    scene%support = usual_support('consistent', scene%order)
    temperature = this%temperature
    method = scene_method(scene)
    method%judges = .true.
    call make_scene_evolution(scene, this%cloud, method, temperature, reference, rows, error, &
                              further=further, maker=maker)
    if (allocated(error)) return
    if (allocated(this%motion)) then
      allocate (this%reference_motion)
      call this%reference_motion%prepare(scene, this%cloud, reference, maker, rows%radius, error)
      if (allocated(error)) return
      this%reference_scene = scene
    end if
    allocate (this%estimate)
    if (this%method == 'exponential') then
      call this%estimate%begin(this%conduction, reference, this%time, this%state(), &
                               reference%spectral_bound(), truth_part*this%stepper%tolerance)
    else
      call this%estimate%begin(this%conduction, reference, this%time, this%state(), &
                               reference%spectral_bound())
    end if
    ! A user's cloud comes without the body that it fills: what its cells are is not known.
    if (scene%initial_expression == '' .or. scene%domain%shape == 'cloud') return
    if (scene%time%steady) return
    call compile_expression(scene%initial_expression, initial, error)
    if (.not. allocated(error)) call make_scene_body(scene%domain, body, error)
    if (allocated(error)) return
    this%flux_jump = maker%materials%flux_jump(initial, this%cloud)
    call find_jump_errors(initial, this%cloud, body, this%estimate%error)
    if (maker%materials%in_force) then
      call find_flux_errors(initial, this%cloud, maker%materials, reference%laplacian, &
                            this%estimate%error)
    end if
    call this%conduction%clear_prescribed(this%estimate%error)
    ! What is carried along is the error of the unknown.
    if (.not. allocated(this%content)) return
    this%estimate%error = this%estimate%error/this%temperature_slope()
  end subroutine prepare_estimate

  !> Of which order the scheme is that tells the error of one of a given order.
  !>
  !> On most clouds the solution of an odd order p has order p + 1, as that of p + 1 has: so it is
  !> p + 2. An even order p makes do with p + 1 where there are too few particles for the stencils
  !> of p + 2, and where these reach across interfaces between materials.
  pure function reference_order(order, particles, across) result(reference)
    !> That order, and the number of particles
    integer, intent(in) :: order, particles
    !> Whether there are interfaces
    logical, intent(in) :: across
    integer :: reference

    reference = lowest_reference_order
    if (order >= lowest_reference_order) reference = order + 2
    if (mod(reference, 2) > 0) return
    if (across .or. particles < roomy*monomials(reference + 1)) reference = reference - 1
  end function reference_order

  !> The temperature at the start, but for held walls, and the true temperature if it is known.
  subroutine start_temperature(this, error)
    class(simulation_t), intent(inout) :: this
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: exact(:)

    associate (scene => this%scene, cloud => this%cloud)
      allocate (this%temperature(cloud%particles()), source=scene%initial_temperature)
      if (scene%initial_expression /= '') then
        call field_values(scene%initial_expression, scene%initial_place, cloud, &
                          this%temperature, error)
        if (allocated(error)) return
      end if
      if (scene%exact_expression /= '') then
        call compile_expression(scene%exact_expression, this%exact, error)
        if (allocated(error)) return
        call field_values(scene%exact_expression, scene%exact_place, cloud, exact, error)
        if (allocated(error)) return
      end if
    end associate
  end subroutine start_temperature

  !> Note how many neighbours the rows have.
  subroutine count_neighbours(this)
    class(simulation_t), intent(inout) :: this
    integer, allocatable :: neighbours(:)

    associate (laplacian => this%conduction%laplacian)
      neighbours = int(laplacian%first(2:) - laplacian%first(:laplacian%rows()))
      this%fewest_neighbours = minval(neighbours)
      this%most_neighbours = maxval(neighbours)
      this%mean_neighbours = real(size(laplacian%index), wp)/laplacian%rows()
    end associate
  end subroutine count_neighbours

  !> 'particle 12 at (0.1, 0.2)', in the user's numbers
  pure function name_particle(this, particle) result(text)
    class(simulation_t), intent(in) :: this
    integer, intent(in) :: particle
    character(len=:), allocatable :: text

    text = 'particle '//to_text(this%conduction%user_index(particle))//' at ('// &
           to_text(this%conduction%medium%x(particle), digits=6)//', '// &
           to_text(this%conduction%medium%y(particle), digits=6)//')'
  end function name_particle

  !> Predict the number of steps: those of a pilot run, and the rest as long as its last one. Steps
  !> are short at the start, while the field adapts to the operator, so that the first tells little.
  subroutine predict_steps(this)
    class(simulation_t), intent(inout) :: this
    !> A pilot run of a larger cloud would take longer than its figure is worth
    integer, parameter :: pilot_steps = 15, most_particles = 100000
    type(stepper_t) :: pilot
    real(wp), allocatable :: state(:)
    type(error_t), allocatable :: error
    real(wp) :: time

    associate (end_time => this%scene%time%end)
      if (this%scene%time%steady) return
      this%predicted_steps = end_time/this%stepper%longest_step
      if (.not. this%stepper%tolerance > 0) return
      if (allocated(this%choice)) then
        if (size(this%choice%costs) > 0) then
          this%predicted_steps = this%choice%costs(1)%steps
          if (.not. this%choice%costs(1)%at_most) return
        end if
      end if
      this%predicted_steps = 0
      if (this%cloud%particles() > most_particles) return
      pilot = this%stepper
      state = this%state()
      time = this%time
      call pilot%advance_to(this%conduction, time, end_time, state, error, &
                            at_most=pilot_steps)
      this%predicted_steps = pilot%steps
      if (time < end_time .and. .not. allocated(error)) then
        this%predicted_steps = pilot%steps + (end_time - time)/pilot%next_proposal()
      end if
      ! Each step of the motion is a step at least.
      if (allocated(this%motion)) then
        this%predicted_steps = max(this%predicted_steps, end_time/this%motion_step())
      end if
    end associate
  end subroutine predict_steps

  !> About how long a step of the motion will be, s
  function motion_step(this) result(step)
    class(simulation_t), intent(inout) :: this
    real(wp) :: step
    real(wp) :: longest

    longest = this%scene%time%end
    if (this%scene%output%every > 0) longest = min(longest, this%scene%output%every)
    step = this%motion%first_step(this%cloud, longest)
  end function motion_step

  !> Whether a run would be stable: every row is exact or may be inexact, and no eigenvalue lies to
  !> the right of zero.
  subroutine certify(this, error)
    class(simulation_t), intent(in) :: this
    !> Why not, in figures, and what to do about it
    type(error_t), allocatable, intent(out) :: error

    call this%check_rows(error)
    if (allocated(error)) return
    if (this%rightmost%growth_rate > 0 .and. .not. this%scene%allow_unstable) then
      call raise(error, status_bad_numbers, 'The scheme '//this%scene%laplacian// &
                 ' is unstable on this cloud: an eigenvalue has the real part +'// &
                 to_text(this%rightmost%growth_rate, &
                         digits=3)//' 1/s, so errors grow by a factor '// &
                 'of e every '//to_text(1/this%rightmost%growth_rate, digits=3)//' s'// &
                 this%where_unstable()//'.'//new_line('a')// &
                 'Take &scheme laplacian = ''fatehi_manzari'' or ''positive'' with '// &
                 'support_growth = .true., or allow_unstable = .true. to run it all the same.')
    end if
  end subroutine certify

  !> Whether every row is exact, or may be inexact.
  subroutine check_rows(this, error)
    class(simulation_t), intent(in) :: this
    !> Which one is not
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: subject
    integer :: inexact, row

    inexact = count(this%repairs%repair >= inexact_stencil)
    if (inexact > 0 .and. .not. this%scene%allow_inexact_rows) then
      row = findloc(this%repairs%repair >= inexact_stencil, .true., dim=1)
      subject = this%name_particle(this%conduction%laplacian%target(row))
      if (inexact > 1) then
        subject = to_text(inexact)//' particles, the first of them '//subject//', have'
      else
        subject = 'P'//subject(2:)//' has'
      end if
      call raise(error, status_bad_numbers, &
                 subject//' neighbours that admit no stable row exact '// &
                 'for quadratic fields: they lie on one side, in line, or much nearer to it '// &
                 'than to each other.'//new_line('a')// &
                 'Move or add particles there, or set &scheme allow_inexact_rows = .true. to '// &
                 'use the best stable row. &output fields = ''row_repair'' shows where.')
    end if
  end subroutine check_rows

  subroutine search_growth(this, error)
    class(simulation_t), intent(inout) :: this
    !> Some were found
    type(error_t), allocatable, intent(out) :: error

    if (.not. this%scene%time%steady) then
      call this%stopwatch%start('stability')
      call this%find_growth()
      call this%stopwatch%stop()
    end if
    call this%certify(error)
  end subroutine search_growth

  !> Find the rightmost eigenvalue of conduction; where no weight is negative there is none beyond
  !> zero. What effects let grow, as a reaction does, grows in truth: it is left out.
  subroutine find_growth(this)
    class(simulation_t), intent(inout) :: this
    real(wp), allocatable :: slope(:)

    call move_alloc(this%conduction%slope, slope)
    if (allocated(this%conduction%jumps)) then
      ! What jumps add to weights may have any sign.
      call linearise_evenly()
      call find_rightmost(this%conduction, this%stepper%spectral_radius, this%rightmost)
      call this%conduction%assume_stiffest()
    else if (this%conduction%laplacian%gershgorin_right_end() > 0) then
      call find_rightmost(this%conduction, this%stepper%spectral_radius, this%rightmost)
    else
      this%rightmost%converged = .true.
      this%rightmost%method = 'no weight is negative'
    end if
    call move_alloc(slope, this%conduction%slope)
    ! Where no wall is held, a uniform temperature stays: an eigenvalue 0, found with rounding.
    associate (rate => this%rightmost%growth_rate)
      if (rate > 0 .and. rate <= rounding*this%stepper%spectral_radius) rate = 0
    end associate
    if (this%rightmost%growth_rate > 0) then
      this%conduction%suspicion = 'The scheme '//this%scene%laplacian// &
                                  ' is unstable on this cloud: before the run an eigenvalue '// &
                                  'of +'//to_text(this%rightmost%growth_rate, digits=3)// &
                                  ' 1/s was found'//this%where_unstable()//'. Remove '// &
                                  '&scheme allow_unstable and take support_growth = .true. '// &
                                  'or laplacian = ''positive''.'
    else if (this%rightmost%converged) then
      this%conduction%suspicion = 'The scheme has no unstable eigenvalue on this cloud, so the '// &
                                  'step is too long: take a smaller &time step or tolerance.'
    end if

  contains

    !> About one temperature everywhere, in the middle of those given: the largest derivatives, each
    !> taken at another temperature, do not belong together.
    subroutine linearise_evenly()
      real(wp), allocatable :: state(:)

      allocate (state(this%conduction%unknowns()))
      associate (conduction => this%conduction)
        call conduction%find_state(spread(0.5_wp*(conduction%lowest + conduction%highest), 1, &
                                          size(state)), state)
        call conduction%linearise(this%time, state)
      end associate
    end subroutine linearise_evenly

  end subroutine find_growth

  !> New rows have a spectrum of their own, of which Gershgorin's bound is known at no cost.
  subroutine adapt_steps(this, error)
    class(simulation_t), intent(inout) :: this
    !> The user's own step has become unstable
    type(error_t), allocatable, intent(out) :: error

    associate (time => this%scene%time, stepper => this%stepper)
      stepper%spectral_radius = max(this%conduction%spectral_bound(), 1.0e-6_wp/time%end)
      this%stability_limit = stepper%integrator%longest_stable_step(stepper%spectral_radius)
      if (time%step > 0) then
        if (time%step <= this%stability_limit) return
        call raise(error, status_bad_numbers, time%place//': at t = '// &
                   to_text(this%time, digits=6)//' s the motion has brought particles so near '// &
                   'to each other that step = '//to_text(time%step)//' s is beyond the '// &
                   'stability limit, '//to_text(this%stability_limit, digits=4)//' s: take a '// &
                   'smaller step, or leave step out and let the program choose.')
      else if (stepper%integrator%estimates_error()) then
        stepper%longest_step = this%stability_limit
      else
        stepper%longest_step = safe_part*this%stability_limit
        if (this%conduction%fastest_decay() > 0) then
          this%monotone_limit = &
            stepper%integrator%longest_monotone_step(this%conduction%fastest_decay())
          if (this%monotone_limit > 0) then
            stepper%longest_step = min(stepper%longest_step, this%monotone_limit)
          end if
        end if
      end if
    end associate
  end subroutine adapt_steps

  pure function where_unstable(this) result(text)
    class(simulation_t), intent(in) :: this
    character(len=:), allocatable :: text

    text = ''
    if (this%rightmost%place > 0) text = ', most near '//this%name_particle(this%rightmost%place)
  end function where_unstable

  !> Choose the integrator and its steps.
  subroutine choose_steps(this, error)
    class(simulation_t), intent(inout), target :: this
    type(error_t), allocatable, intent(out) :: error
    type(step_choice_t) :: steps

    steps%rows = this%conduction%laplacian%rows()
    steps%entries = size(this%conduction%laplacian%weight)
    steps%operations = this%conduction%operations()
    steps%fastest_decay = this%conduction%fastest_decay()
    steps%growth_rate = this%rightmost%growth_rate
    steps%slowest_decay = this%rightmost%slowest_decay
    call steps%choose(this%scene, this%conduction, this%temperature, this%state(), &
                      make_usual_integrator, this%stepper, error)
    this%method = steps%method
    if (allocated(steps%choice)) call move_alloc(steps%choice, this%choice)
    this%stability_limit = steps%stability_limit
    this%monotone_limit = steps%monotone_limit
  end subroutine choose_steps

end module calor_simulation
