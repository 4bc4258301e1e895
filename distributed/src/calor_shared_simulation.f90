!> The heat driver on several ranks: a scene becomes a cloud that they share, the cloud a
!> distributed operator, and the library's integrators step that in time.
module calor_shared_simulation
  use calor_error, only: error_t, raise, status_bad_file, status_bad_input, status_bad_numbers
  use calor_expression, only: expression_t, compile_expression
  use calor_heat_budget, only: budget_entry_t, heat_budget_t
  use calor_kinds, only: wp, i8
  use calor_ranks, only: ranks_t
  use calor_rightmost_eigenvalue, only: rightmost_t, find_rightmost
  use calor_saved_state, only: saved_state_t
  use calor_scene, only: scene_t
  use calor_scene_evolution, only: make_scene_evolution, scene_method, scene_rows_t
  use calor_scene_values, only: field_values
  use calor_shared_checkpoint, only: read_particles, read_shared_checkpoint, &
                                     write_shared_checkpoint
  use calor_shared_cloud, only: shared_cloud_t
  use calor_shared_conduction, only: shared_conduction_t
  use calor_shared_steady_state, only: find_shared_steady_state
  use calor_shared_support, only: refuse_unsupported
  use calor_shared_tr_bdf2, only: make_shared_integrator, shared_tr_bdf2_t
  use calor_shared_weights, only: find_closing_weights
  use calor_simulation_file, only: check_target
  use calor_stable_rows, only: inexact_stencil
  use calor_step_choice, only: default_tolerance, find_step_limits, states_after_start, &
                               step_choice_t
  use calor_stepper, only: stepper_t
  use calor_stopwatch, only: stopwatch_t
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: shared_simulation_t

  !> As in the driver of one process
  real(wp), parameter :: rounding = 1.0e-11_wp

  !> A scene at work on several ranks
  type :: shared_simulation_t
    type(ranks_t) :: ranks
    type(scene_t) :: scene
    type(shared_cloud_t) :: particles
    type(shared_conduction_t) :: conduction
    !> What is known of the rows; their weights are in the conduction's matrix
    type(scene_rows_t) :: rows
    !> Neighbours of the rows of all ranks together, and the fewest and most of any
    integer(i8) :: all_rows = 0, all_entries = 0
    integer :: fewest_neighbours = 0, most_neighbours = 0
    type(rightmost_t) :: rightmost
    type(stepper_t) :: stepper
    !> The method, and why
    type(step_choice_t) :: steps
    !> Newton steps that the steady temperature took
    integer :: newton_steps = 0
    !> Time, s, and temperatures of the particles here; those of other ranks mean nothing
    real(wp) :: time = 0.0_wp
    real(wp), allocatable :: temperature(:)
    !> The unknowns, where they are not the temperatures
    real(wp), allocatable :: content(:)
    type(expression_t) :: exact
    type(stopwatch_t) :: stopwatch
    !> States written after the first; -1: not even that
    integer :: written = -1
    !> Where heat comes from and goes to, and that of all states written
    type(heat_budget_t) :: budget
    type(budget_entry_t), allocatable :: entries(:)
    !> The output file of a run that is resumed, and the text of the scene then
    character(len=:), allocatable :: earlier_file, earlier_scene
  contains
    !> Make everything ready for the first step
    procedure :: prepare
    !> Make everything ready to go on from a checkpoint: in place of `prepare`
    procedure :: resume
    !> Lay the state aside
    procedure :: write_checkpoint
    !> A state has been written
    procedure :: note_state
    !> The time of the next state that is written
    procedure :: next_output
    !> Whether the rows and their spectrum allow a run
    procedure :: certify
    !> Step to a time
    procedure :: advance_to
    !> Find the steady temperature
    procedure :: settle
    !> How much of each particle is liquid; empty where nothing melts
    procedure :: liquid_fraction
    !> ‖u - u_exact‖ / ‖u_exact‖ over the body
    procedure :: relative_l2_error
    !> Lowest and highest temperature
    procedure :: temperature_range
    !> Give back what PETSc keeps
    procedure :: finish
    procedure, private :: make_evolution
    procedure, private :: start_temperature
    procedure, private :: find_limits
    procedure, private :: find_growth
    procedure, private :: state
    procedure, private :: save => save_simulation
    procedure, private :: restore
  end type shared_simulation_t

contains

  subroutine prepare(this, ranks, scene, error)
    class(shared_simulation_t), intent(inout), target :: this
    type(ranks_t), intent(in) :: ranks
    type(scene_t), intent(in) :: scene
    !> The scene cannot be simulated; on all ranks the same
    type(error_t), allocatable, intent(out) :: error

    this%ranks = ranks
    this%scene = scene
    allocate (this%entries(0))
    this%stepper%interruptible = .false.
    call refuse_unsupported(scene, error)
    if (.not. allocated(error)) call check_target(scene%output%file, scene%output%place, scene, &
                                                  error)
    if (.not. allocated(error) .and. scene%checkpoint%asked) then
      call check_target(scene%checkpoint%file, scene%checkpoint%place, scene, error, 'checkpoint')
    end if
    call ranks%agree(error)
    if (allocated(error)) return
    call this%stopwatch%start('cloud')
    call this%particles%make(ranks, scene, error)
    if (allocated(error)) return
    call this%make_evolution(error)
    if (allocated(error)) return
    if (scene%time%steady) then
      call this%conduction%load_rows()
    else
      call this%stopwatch%start('step control')
      call this%find_limits(error)
      if (allocated(error)) return
      call this%stopwatch%start('stability')
      call this%find_growth()
      call this%stopwatch%start('step control')
      this%steps%growth_rate = this%rightmost%growth_rate
      this%steps%slowest_decay = this%rightmost%slowest_decay
      call this%steps%choose(scene, this%conduction, this%temperature, this%state(), &
                             make_shared_integrator, this%stepper, error)
      if (allocated(error)) return
    end if
    call this%stopwatch%stop()
  end subroutine prepare

  !> Rows that had to look beyond what is here are made again with more.
  subroutine make_evolution(this, error)
    class(shared_simulation_t), intent(inout) :: this
    type(error_t), allocatable, intent(out) :: error
    type(shared_conduction_t), allocatable :: conduction
    integer, allocatable :: neighbours(:)
    logical :: done

    done = .false.
    do while (.not. done)
      if (allocated(conduction)) deallocate (conduction)
      allocate (conduction)
      associate (cloud => this%particles%cloud)
        call conduction%take_part(this%ranks, this%particles%bands%particles, &
                                  this%particles%number, cloud%own_first, cloud%own_last)
        call this%start_temperature(error)
        if (allocated(error)) return
        call make_scene_evolution(this%scene, cloud, scene_method(this%scene), &
                                  this%temperature, conduction, this%rows, error, this%stopwatch)
        if (allocated(error)) return
      end associate
      call this%particles%extend(this%ranks, this%scene, this%rows%widest, done, error)
      if (allocated(error)) return
    end do
    call conduction%share_parts()
    this%conduction = conduction
    associate (rows => this%conduction%laplacian)
      neighbours = int(rows%first(2:) - rows%first(:rows%rows()))
      this%all_rows = this%ranks%total(int(rows%rows(), i8))
      this%all_entries = this%ranks%total(size(rows%index, kind=i8))
      this%fewest_neighbours = int(this%ranks%least(1.0_wp*minval(neighbours)))
      this%most_neighbours = int(this%ranks%most(1.0_wp*max(0, maxval(neighbours))))
    end associate
    if (allocated(this%conduction%content)) then
      allocate (this%content(size(this%temperature)))
      call this%conduction%find_state(this%temperature, this%content)
    end if
    call this%budget%prepare(this%particles%cloud, this%conduction)
  end subroutine make_evolution

  subroutine start_temperature(this, error)
    class(shared_simulation_t), intent(inout) :: this
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: exact(:)

    associate (scene => this%scene, cloud => this%particles%cloud)
      if (allocated(this%temperature)) deallocate (this%temperature)
      allocate (this%temperature(cloud%particles()), source=scene%initial_temperature)
      if (scene%initial_expression /= '') then
        call field_values(scene%initial_expression, scene%initial_place, cloud, &
                          this%temperature, error)
      end if
      if (scene%exact_expression /= '' .and. .not. allocated(error)) then
        call compile_expression(scene%exact_expression, this%exact, error)
        if (.not. allocated(error)) then
          call field_values(scene%exact_expression, scene%exact_place, cloud, exact, error)
        end if
      end if
    end associate
    call this%ranks%agree(error)
  end subroutine start_temperature

  !> The spectral radius, which limits steps. The rows go into the matrix, and no place else.
  subroutine find_limits(this, error)
    class(shared_simulation_t), intent(inout) :: this
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: bound

    bound = this%conduction%spectral_bound()
    this%steps%fastest_decay = this%conduction%fastest_decay()
    this%steps%rows = real(this%all_rows, wp)
    this%steps%entries = real(this%all_entries, wp)
    this%steps%operations = this%ranks%total(this%conduction%operations())
    this%rightmost%growth_rate = this%ranks%most(this%conduction%laplacian%gershgorin_right_end())
    call this%conduction%load_rows()
    call find_step_limits(this%scene, bound, this%conduction, this%stepper%spectral_radius, error)
  end subroutine find_limits

  !> Whether conduction has a mode that grows; no search is needed where no weight is negative.
  subroutine find_growth(this)
    class(shared_simulation_t), intent(inout) :: this
    real(wp), allocatable :: slope(:)

    if (this%rightmost%growth_rate > 0) then
      call move_alloc(this%conduction%slope, slope)
      call find_rightmost(this%conduction, this%stepper%spectral_radius, this%rightmost)
      call move_alloc(slope, this%conduction%slope)
    else
      this%rightmost = rightmost_t(converged=.true., method='no weight is negative')
    end if
    associate (rate => this%rightmost%growth_rate)
      if (rate > 0 .and. rate <= rounding*this%stepper%spectral_radius) rate = 0
    end associate
    if (this%rightmost%converged .and. this%rightmost%growth_rate <= 0) then
      this%conduction%suspicion = 'The scheme has no unstable eigenvalue on this cloud, so the '// &
                                  'step is too long: take a smaller &time step or tolerance.'
    end if
  end subroutine find_growth

  subroutine certify(this, error)
    class(shared_simulation_t), intent(in) :: this
    !> Why a run would not be stable
    type(error_t), allocatable, intent(out) :: error
    integer(i8) :: inexact

    inexact = this%ranks%total(int(count(this%rows%repairs%repair >= inexact_stencil), i8))
    if (inexact > 0 .and. .not. this%scene%allow_inexact_rows) then
      call raise(error, status_bad_numbers, to_text(int(inexact))//' particles have neighbours '// &
                 'that admit no stable row exact for quadratic fields: they lie on one side, '// &
                 'in '// &
                 'line, or much nearer to it than to each other.'//new_line('a')// &
                 'Move or add particles there, or set &scheme allow_inexact_rows = .true. to '// &
                 'use the best stable row.')
    else if (this%rightmost%growth_rate > 0 .and. .not. this%scene%allow_unstable) then
      call raise(error, status_bad_numbers, 'The scheme '//this%scene%laplacian// &
                 ' is unstable on this cloud: an eigenvalue has the real part +'// &
                 to_text(this%rightmost%growth_rate, digits=3)//' 1/s, so errors grow by a '// &
                 'factor of e every '//to_text(1/this%rightmost%growth_rate, digits=3)//' s.'// &
                 new_line('a')//'Take &scheme laplacian = ''fatehi_manzari'' or ''positive'' '// &
                 'with support_growth = .true., or allow_unstable = .true. to run it all the same.')
    end if
  end subroutine certify

  subroutine advance_to(this, time, error)
    class(shared_simulation_t), intent(inout), target :: this
    !> Time to reach, s
    real(wp), intent(in) :: time
    !> The numbers went wrong; time and temperature are those of the last good state
    type(error_t), allocatable, intent(out) :: error

    call this%stopwatch%start('steps')
    if (allocated(this%content)) then
      call this%stepper%advance_to(this%conduction, this%time, time, this%content, error)
      call this%conduction%find_temperature(this%content, this%temperature)
    else
      call this%stepper%advance_to(this%conduction, this%time, time, this%temperature, error)
    end if
    call this%stopwatch%stop()
  end subroutine advance_to

  subroutine settle(this, error)
    class(shared_simulation_t), intent(inout) :: this
    !> There is none, or it was not found
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: weight(:)
    real(wp) :: tolerance
    logical :: found

    call this%stopwatch%start('steady state')
    if (allocated(this%conduction%content)) this%conduction%content%steady = .true.
    tolerance = default_tolerance
    if (this%scene%time%tolerance > 0) tolerance = this%scene%time%tolerance
    call find_shared_steady_state(this%conduction, this%scene%time%place, &
                                  tolerance*this%conduction%temperature_scale(), &
                                  this%temperature, this%newton_steps, error)
    if (allocated(this%conduction%content)) this%conduction%content%steady = .false.
    call this%stopwatch%stop()
    if (allocated(error)) return
    if (allocated(this%content)) call this%conduction%find_state(this%temperature, this%content)
    if (.not. this%budget%available) return
    call this%stopwatch%start('heat budget')
    call find_closing_weights(this%conduction, weight, found)
    if (found) call this%budget%take_weights(weight)
    call this%stopwatch%stop()
  end subroutine settle

  function liquid_fraction(this) result(fraction)
    class(shared_simulation_t), intent(in) :: this
    real(wp), allocatable :: fraction(:)

    if (allocated(this%content)) then
      allocate (fraction(size(this%content)))
      call this%conduction%find_liquid_fraction(this%content, fraction)
    else
      allocate (fraction(0))
    end if
  end function liquid_fraction

  !> s
  pure function next_output(this) result(time)
    class(shared_simulation_t), intent(in) :: this
    real(wp) :: time

    time = this%scene%time%end
    if (this%written + 1 < states_after_start(this%scene)) then
      time = (this%written + 1)*this%scene%output%every
    end if
  end function next_output

  !> All ranks take part.
  subroutine note_state(this)
    class(shared_simulation_t), intent(inout) :: this
    type(budget_entry_t), allocatable :: longer(:)
    integer :: k

    allocate (longer(size(this%entries) + 1))
    do k = 1, size(this%entries)
      longer(k) = this%entries(k)
    end do
    call this%budget%evaluate(this%conduction, this%time, this%state(), longer(size(longer)))
    call move_alloc(longer, this%entries)
    this%written = max(this%written, 0)
  end subroutine note_state

  subroutine resume(this, ranks, scene, path, error)
    class(shared_simulation_t), intent(inout), target :: this
    type(ranks_t), intent(in) :: ranks
    type(scene_t), intent(in) :: scene
    !> The checkpoint; '': the one that the scene names
    character(len=*), intent(in) :: path
    !> The checkpoint cannot be used; on all ranks the same
    type(error_t), allocatable, intent(out) :: error
    type(saved_state_t) :: state

    call read_shared_checkpoint(ranks, scene, path, state, error)
    if (allocated(error)) return
    call this%prepare(ranks, scene, error)
    if (allocated(error)) return
    call read_particles(ranks, scene, path, this%particles%cloud, this%particles%bands%particles, &
                        state, error)
    if (allocated(error)) return
    call this%restore(state, error)
    call ranks%agree(error)
  end subroutine resume

  subroutine write_checkpoint(this, error)
    class(shared_simulation_t), intent(in) :: this
    !> It cannot be written; on all ranks the same
    type(error_t), allocatable, intent(out) :: error
    type(saved_state_t) :: state

    call this%save(state)
    call write_shared_checkpoint(this%ranks, this%scene, this%particles%cloud, &
                                 this%particles%bands%particles, state, error)
  end subroutine write_checkpoint

  !> Lay aside all that the rest of the run depends on and `prepare` does not know.
  subroutine save_simulation(this, state)
    class(shared_simulation_t), intent(in) :: this
    type(saved_state_t), intent(inout) :: state

    call state%put('time', this%time)
    call state%put('end', this%scene%time%end)
    call state%put('temperature', this%temperature)
    if (allocated(this%content)) call state%put('content', this%content)
    call state%put('method', this%steps%method)
    call this%stepper%save(state)
    call this%conduction%save(state)
    call state%put('output_file', this%scene%output%file)
    call this%budget%save_entries(this%entries, state)
  end subroutine save_simulation

  !> Take up what was laid aside, after `prepare`.
  subroutine restore(this, state, error)
    class(shared_simulation_t), intent(inout), target :: this
    type(saved_state_t), intent(inout) :: state
    !> It does not fit
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: end_time, radius, longest

    call state%get('time', this%time)
    call state%get('end', end_time)
    call state%get('temperature', this%temperature)
    if (allocated(this%content)) call state%get('content', this%content)
    call state%get('method', this%steps%method)
    call state%get('output_file', this%earlier_file)
    call state%get('scene', this%earlier_scene)
    call this%budget%restore_entries(this%entries, state)
    call release(this%stepper)
    call make_shared_integrator(this%steps%method, this%conduction, this%stepper%integrator, error)
    if (allocated(error)) return
    radius = this%stepper%spectral_radius
    longest = this%stepper%longest_step
    call this%stepper%restore(state)
    call this%conduction%restore(state)
    if (allocated(state%problem)) then
      call raise(error, status_bad_file, 'The checkpoint lacks '''//state%problem//'''.')
      return
    end if
    if (abs(end_time - this%scene%time%end) > 0) then
      ! What changes with time may become stiffer than was known.
      this%stepper%spectral_radius = max(radius, this%stepper%spectral_radius)
      this%stepper%longest_step = min(longest, this%stepper%longest_step)
    end if
    this%written = 0
    if (this%scene%output%every > 0) then
      this%written = int(this%time/this%scene%output%every*(1 + 1.0e-12_wp))
    end if
  end subroutine restore

  !> The unknowns: heat contents where they are kept, temperatures elsewhere.
  pure function state(this)
    class(shared_simulation_t), intent(in) :: this
    real(wp), allocatable :: state(:)

    if (allocated(this%content)) then
      state = this%content
    else
      state = this%temperature
    end if
  end function state

  function relative_l2_error(this) result(deviation)
    class(shared_simulation_t), intent(in) :: this
    real(wp) :: deviation
    real(wp), allocatable :: exact(:)
    real(wp) :: norm

    associate (cloud => this%particles%cloud, a => this%particles%cloud%own_first, &
               b => this%particles%cloud%own_last)
      allocate (exact(cloud%particles()))
      call this%exact%evaluate(cloud%x, cloud%y, this%time, values=exact)
      norm = sqrt(this%ranks%total(sum(cloud%area(a:b)*exact(a:b)**2)))
      deviation = sqrt(this%ranks%total(sum(cloud%area(a:b)* &
                                            (this%temperature(a:b) - exact(a:b))**2)))
    end associate
    if (norm > 0) deviation = deviation/norm
  end function relative_l2_error

  function temperature_range(this) result(range)
    class(shared_simulation_t), intent(in) :: this
    real(wp) :: range(2)

    associate (own => this%temperature(this%conduction%own_first:this%conduction%own_last))
      range = [this%ranks%least(minval(own)), this%ranks%most(maxval(own))]
    end associate
  end function temperature_range

  subroutine finish(this)
    class(shared_simulation_t), intent(inout) :: this

    call release(this%stepper)
    call this%conduction%unload()
  end subroutine finish

  !> Give back what PETSc keeps of an integrator.
  subroutine release(stepper)
    type(stepper_t), intent(inout) :: stepper

    if (.not. allocated(stepper%integrator)) return
    select type (integrator => stepper%integrator)
    type is (shared_tr_bdf2_t)
      call integrator%finish()
    end select
  end subroutine release

end module calor_shared_simulation
