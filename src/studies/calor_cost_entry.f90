!> One line of a comparison of costs: a method on a cloud, its error and what it takes.
module calor_cost_entry
  use calor_cost_method, only: cost_method_t
  use calor_error, only: error_t
  use calor_kinds, only: wp, i8
  use calor_reference_solution, only: reference_solution_t
  use calor_scene, only: scene_t
  use calor_simulation, only: simulation_t
  use calor_time_choice, only: time_choice_t, choose_time_steps, pilot_scene, relative_difference
  implicit none (type, external)
  private

  public :: cost_entry_t, cost_phases, phase_cloud, phase_assembly, phase_control, &
            phase_stability, phase_steps, phase_total

  !> What is timed, in this order; the assembly finds neighbours and tensors too
  character(len=13), parameter :: cost_phases(*) = [character(len=13) :: 'cloud', 'assembly', &
                                                    'step_control', 'stability', 'steps', 'total']
  integer, parameter :: phase_cloud = 1, phase_assembly = 2, phase_control = 3, &
      phase_stability = 4, phase_steps = 5, phase_total = 6

  !> The part of the error in space that time steps may add
  real(wp), parameter :: time_share = 0.1_wp

  !> Place, volume, support radius, state and stages: ten vectors, and two of whole numbers
  real(wp), parameter :: bytes_per_particle = 88.0_wp

  type :: cost_entry_t
    type(cost_method_t) :: method
    !> Distance between particles, m; 0: the cloud is given
    real(wp) :: spacing = 0.0_wp
    !> Why there are no figures, in one sentence; '' where nothing went wrong
    character(len=:), allocatable :: failure
    !> Number of particles, and of neighbours on average
    integer :: particles = 0
    real(wp) :: neighbours = 0.0_wp
    !> Relative L2 error at the end, or that of the solution compared with where that is larger
    real(wp) :: error = 0.0_wp
    !> The time steps and their error
    type(time_choice_t) :: time
    !> Steps, and evaluations of the Laplacian
    integer :: steps = 0, evaluations = 0
    !> Memory of the operator and of the vectors that a run keeps, bytes
    real(wp) :: memory = 0.0_wp
    !> Wall time, s: one row for each of `cost_phases`, one column for each repetition
    real(wp), allocatable :: seconds(:, :)
  contains
    !> Find the time steps by pilot runs
    procedure :: explore
    !> Run once and note error and wall time
    procedure :: measure
    !> Whether there are figures
    procedure :: measured
    !> The median wall time of a phase, s
    procedure :: median_seconds
    procedure, private :: scene_of
  end type cost_entry_t

contains

  !> The scene with this entry's method and cloud, and without output.
  function scene_of(this, scene) result(own)
    class(cost_entry_t), intent(in) :: this
    type(scene_t), intent(in) :: scene
    type(scene_t) :: own

    own = scene
    own%output%file = ''
    own%output%every = 0
    ! A run that estimates its own error takes longer.
    own%accuracy%estimate = .false.
    if (this%spacing > 0) own%domain%spacing = this%spacing
    call this%method%apply(own)
  end function scene_of

  subroutine explore(this, scene, reference, error)
    class(cost_entry_t), intent(inout) :: this
    !> The scene
    type(scene_t), intent(in) :: scene
    !> What to compare with
    type(reference_solution_t), intent(in) :: reference
    !> The scene cannot be run with this method on this cloud
    type(error_t), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    real(wp), allocatable :: truth(:)

    call simulation%prepare(pilot_scene(this%scene_of(scene)), error)
    if (.not. allocated(error)) call simulation%certify(error)
    if (allocated(error)) return
    allocate (truth(simulation%cloud%particles()))
    call reference%values_at(simulation%cloud%x, simulation%cloud%y, truth)
    call choose_time_steps(simulation, time_share, this%time, error, truth, &
                           reference%uncertainty)
    if (allocated(this%time%temperature)) deallocate (this%time%temperature)
  end subroutine explore

  subroutine measure(this, scene, reference, error)
    class(cost_entry_t), intent(inout) :: this
    !> The scene
    type(scene_t), intent(in) :: scene
    !> What to compare with
    type(reference_solution_t), intent(in) :: reference
    !> The run failed, or was interrupted
    type(error_t), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(scene_t) :: own
    real(wp), allocatable :: truth(:)
    real(wp) :: seconds(size(cost_phases))
    integer(i8) :: start, end, rate

    own = this%scene_of(scene)
    call this%time%apply(own)
    call system_clock(start, rate)
    call simulation%prepare(own, error)
    if (.not. allocated(error)) call simulation%certify(error)
    if (.not. allocated(error)) call simulation%advance_to(own%time%end, error)
    call system_clock(end)
    if (allocated(error)) return

    seconds(phase_cloud) = phase_seconds(simulation, 'cloud')
    seconds(phase_assembly) = phase_seconds(simulation, 'neighbours') + &
                              phase_seconds(simulation, 'assembly')
    seconds(phase_control) = phase_seconds(simulation, 'step control')
    seconds(phase_stability) = phase_seconds(simulation, 'stability')
    seconds(phase_steps) = phase_seconds(simulation, 'steps')
    ! What no phase claims, such as the tests whether the scene can be run, is in the total.
    seconds(phase_total) = real(end - start, wp)/rate
    if (.not. allocated(this%seconds)) allocate (this%seconds(size(cost_phases), 0))
    this%seconds = reshape([this%seconds, seconds], &
                           [size(cost_phases), size(this%seconds, 2) + 1])

    allocate (truth(simulation%cloud%particles()))
    call reference%values_at(simulation%cloud%x, simulation%cloud%y, truth)
    ! No error is claimed to be smaller than that of what it is measured by.
    this%error = max(reference%uncertainty, &
                     relative_difference(simulation%temperature, truth, simulation%cloud%volume))
    this%spacing = simulation%cloud%spacing
    this%particles = simulation%cloud%particles()
    this%neighbours = simulation%mean_neighbours
    this%steps = simulation%stepper%steps
    this%evaluations = simulation%stepper%integrator%evaluations
    this%memory = real(simulation%conduction%laplacian%bytes(), wp) + &
                  bytes_per_particle*this%particles
  end subroutine measure

  pure function phase_seconds(simulation, name) result(seconds)
    type(simulation_t), intent(in) :: simulation
    character(len=*), intent(in) :: name
    real(wp) :: seconds
    integer :: k

    seconds = 0
    do k = 1, size(simulation%stopwatch%phases)
      associate (phase => simulation%stopwatch%phases(k))
        if (phase%name == name) seconds = phase%seconds
      end associate
    end do
  end function phase_seconds

  pure function measured(this) result(answer)
    class(cost_entry_t), intent(in) :: this
    logical :: answer

    answer = allocated(this%seconds)
  end function measured

  pure function median_seconds(this, phase) result(seconds)
    class(cost_entry_t), intent(in) :: this
    !> One of the `phase_...` constants
    integer, intent(in) :: phase
    real(wp) :: seconds
    real(wp), allocatable :: sorted(:)
    real(wp) :: next
    integer :: k, j, n

    seconds = 0
    if (.not. this%measured()) return
    sorted = this%seconds(phase, :)
    n = size(sorted)
    do k = 2, n
      next = sorted(k)
      do j = k - 1, 1, -1
        if (sorted(j) <= next) exit
        sorted(j + 1) = sorted(j)
      end do
      sorted(j + 1) = next
    end do
    seconds = 0.5_wp*(sorted((n + 1)/2) + sorted(n/2 + 1))
  end function median_seconds

end module calor_cost_entry
