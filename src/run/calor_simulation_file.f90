!> The output file of a run: which fields and notes go into it, in the user's order of particles.
module calor_simulation_file
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_expression, only: expression_t
  use calor_field_file, only: field_file_t, check_place
  use calor_file_system, only: resolved_path
  use calor_heat_budget, only: heat_budget_t, budget_entry_t
  use calor_kinds, only: wp
  use calor_row_fields, only: is_row_field
  use calor_scene, only: scene_t
  use calor_scene_cloud, only: beside_scene
  use calor_stopwatch, only: phase_t
  use calor_stored_fields, only: stored_fields_t
  use calor_text, only: text_t
  use calor_twin_file, only: twin_file_t, field_state_t
  use calor_version, only: version
  implicit none (type, external)
  private

  public :: simulation_file_t, write_origin, write_origin_notes, check_target

  !> The output of one run; where the scene names no file, every procedure does nothing
  type :: simulation_file_t
    !> Whether the scene names a file
    logical :: in_use = .false.
    type(twin_file_t), private :: file
    !> The state that is being put together
    type(field_state_t), private :: state
    type(text_t), allocatable, private :: fields(:)
    !> Coordinates in the user's order, kept where states need them, and where each particle of that
    !> order is in the cloud's
    real(wp), allocatable, private :: x(:), y(:)
    integer, allocatable, private :: place(:)
    !> States written
    integer :: states = 0
    !> Whether particles move
    logical, private :: in_motion = .false.
    !> Whether states of an earlier file are on their way: it stays until all are here
    logical, private :: taking_over = .false.
    !> The first error of a note, reported on closing
    type(error_t), allocatable, private :: pending
  contains
    !> Create the file with all that does not change
    procedure :: open => open_file
    !> Write a field that does not change
    procedure :: write_static
    !> Take the places of particles that move, for the next state
    procedure :: move_points
    !> Begin a state with the fields that change with time
    procedure :: begin_state
    !> Add a further field to it
    procedure :: add_field
    !> Write it
    procedure :: write_state
    !> Put the file in its place, that of an older one perhaps
    procedure :: publish
    !> Take over the first states of an earlier file
    procedure :: take_over
    !> States are over
    procedure :: begin_closing
    !> Note a figure about the run
    procedure :: note
    !> The same in words
    procedure :: say
    !> Write the heat budget of all states
    procedure :: write_budget
    !> Note the wall times and close
    procedure :: close => close_file
    !> Close after an error of the file itself
    procedure :: abandon
  end type simulation_file_t

contains

  subroutine open_file(this, scene, cloud, effects, error, earlier)
    class(simulation_file_t), intent(inout) :: this
    !> The scene
    type(scene_t), intent(in) :: scene
    !> Its particles
    type(cloud_t), intent(in) :: cloud
    !> What is in force, and why
    type(text_t), intent(in) :: effects(:)
    !> The file cannot be made
    type(error_t), allocatable, intent(out) :: error
    !> The file whose first states will be taken over
    type(stored_fields_t), intent(in), optional :: earlier
    real(wp), allocatable :: x(:), y(:)
    integer :: k

    this%in_use = scene%output%file /= ''
    if (.not. this%in_use) return
    this%fields = scene%output%fields
    allocate (this%place(cloud%particles()))
    this%place(cloud%user_index) = [(k, k=1, cloud%particles())]
    this%in_motion = scene%motion%in_force
    x = cloud%x(this%place)
    y = cloud%y(this%place)
    if (this%in_motion .or. &
        any([(needs_places(this%fields(k)%value), k=1, size(this%fields))])) then
      this%x = x
      this%y = y
    end if
    if (present(earlier)) call earlier%read_places(1, x, y, error)
    if (allocated(error)) return
    call this%file%create(scene%output%file, x, y, this%in_motion, error)
    if (allocated(error)) return
    do k = 1, size(this%file%copy)
      call write_origin(this%file%copy(k), scene, cloud, error)
      if (allocated(error)) then
        call this%file%discard()
        return
      end if
    end do
    call this%file%set_attribute('effects', effects, error)
    if (allocated(error)) call this%file%discard()
  end subroutine open_file

  !> Find out, before any work is done, whether a file can be written; '' stands for none.
  !> What the scene is read from is not to be written over.
  subroutine check_target(path, place, scene, error, called)
    !> The file
    character(len=*), intent(in) :: path
    !> Where the scene names it
    character(len=*), intent(in) :: place
    !> The scene
    type(scene_t), intent(in) :: scene
    !> It cannot be written, or must not
    type(error_t), allocatable, intent(out) :: error
    !> What the file is called in messages; without it 'output file'
    character(len=*), intent(in), optional :: called
    character(len=:), allocatable :: target

    if (path == '') return
    call check_place(path, error, called)
    if (allocated(error)) then
      error%message = place//': '//error%message
      return
    end if
    target = resolved_path(path)
    if (target == resolved_path(scene%path)) then
      call raise(error, status_bad_input, place//': that would be written over the scene '// &
                 'itself; name another file.')
    else if (scene%domain%shape == 'cloud') then
      if (target == resolved_path(beside_scene(scene%path, scene%domain%file))) then
        call raise(error, status_bad_input, place//': that would be written over the cloud '// &
                   'that the scene is made of; name another file.')
      end if
    end if
  end subroutine check_target

  !> What every file of calor's says about where it comes from, and what makes it usable as a cloud:
  !> volumes and walls.
  subroutine write_origin(file, scene, cloud, error)
    !> A file just created, its particles in the user's order
    type(field_file_t), intent(inout) :: file
    !> The scene
    type(scene_t), intent(in) :: scene
    !> Its particles
    type(cloud_t), intent(in) :: cloud
    !> The file cannot be written
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: volume(:)
    integer, allocatable :: wall(:)

    allocate (volume(cloud%particles()), wall(cloud%particles()))
    volume(cloud%user_index) = cloud%volume
    wall(cloud%user_index) = merge(1, 0, cloud%side /= 0)
    call file%add_static('volume', volume, error)
    if (allocated(error)) return
    call file%add_static('wall', wall, error)
    if (allocated(error)) return
    call write_origin_notes(file, scene, cloud%spacing, error)
  end subroutine write_origin

  !> The attributes among that.
  subroutine write_origin_notes(file, scene, spacing, error)
    !> A file just created
    type(field_file_t), intent(inout) :: file
    !> The scene
    type(scene_t), intent(in) :: scene
    !> Distance between neighbours, m
    real(wp), intent(in) :: spacing
    !> The file cannot be written
    type(error_t), allocatable, intent(out) :: error

    call file%set_attribute('version', version, error)
    if (allocated(error)) return
    call file%set_attribute('scene', scene%text, error)
    if (allocated(error)) return
    call file%set_attribute('title', scene%title, error)
    if (allocated(error)) return
    call file%set_attribute('kernel', scene%kernel, error)
    if (allocated(error)) return
    call file%set_attribute('laplacian', scene%laplacian, error)
    if (allocated(error)) return
    call file%set_attribute('gradient', scene%gradient, error)
    if (allocated(error)) return
    call file%set_attribute('spacing', spacing, error)
    if (allocated(error)) return
    call file%set_attribute('support_radius', scene%support*spacing, error)
  end subroutine write_origin_notes

  subroutine write_static(this, name, values)
    class(simulation_file_t), intent(inout) :: this
    !> Name of the field
    character(len=*), intent(in) :: name
    !> Its values in the cloud's order
    real(wp), intent(in) :: values(:)

    if (.not. this%in_use .or. allocated(this%pending)) return
    call this%file%add_static(name, values(this%place), this%pending)
  end subroutine write_static

  subroutine begin_state(this, time, temperature, exact, liquid_fraction, estimate)
    class(simulation_file_t), intent(inout) :: this
    !> Time, s
    real(wp), intent(in) :: time
    !> Temperatures in the cloud's order
    real(wp), intent(in) :: temperature(:)
    !> The true temperature; used only for fields that need it
    type(expression_t), intent(in) :: exact
    !> How much of each particle is liquid, in the cloud's order; used only if it is to be written
    real(wp), intent(in), optional :: liquid_fraction(:)
    !> Estimate of true temperature less temperature; needed only for fields made of it
    real(wp), intent(in), optional :: estimate(:)
    type(field_state_t) :: empty
    real(wp), allocatable :: ordered(:), truth(:)
    integer :: k

    if (.not. this%in_use) return
    ordered = temperature(this%place)
    this%state = empty
    this%state%time = time
    if (this%in_motion) then
      this%state%x = this%x
      this%state%y = this%y
    end if
    do k = 1, size(this%fields)
      select case (this%fields(k)%value)
      case ('temperature')
        call this%state%add('temperature', ordered)
      case ('error_estimate')
        if (present(estimate)) call this%state%add('error_estimate', estimate(this%place))
      case ('temperature_corrected')
        if (present(estimate)) then
          call this%state%add('temperature_corrected', ordered + estimate(this%place))
        end if
      case ('liquid_fraction')
        if (present(liquid_fraction)) then
          call this%state%add('liquid_fraction', liquid_fraction(this%place))
        end if
      case ('exact', 'error')
        if (.not. allocated(truth)) then
          allocate (truth(size(ordered)))
          call exact%evaluate(this%x, this%y, time, values=truth)
        end if
        if (this%fields(k)%value == 'exact') then
          call this%state%add('exact', truth)
        else
          call this%state%add('error', ordered - truth)
        end if
      case default
        continue
      end select
    end do
  end subroutine begin_state

  subroutine add_field(this, name, values)
    class(simulation_file_t), intent(inout) :: this
    !> Name of the field
    character(len=*), intent(in) :: name
    !> Its values in the cloud's order
    real(wp), intent(in) :: values(:)

    if (this%in_use) call this%state%add(name, values(this%place))
  end subroutine add_field

  subroutine write_state(this, error)
    class(simulation_file_t), intent(inout) :: this
    !> The file cannot be written
    type(error_t), allocatable, intent(out) :: error

    if (.not. this%in_use) return
    call this%file%write_state(this%state, error)
    if (allocated(error)) return
    this%states = this%states + 1
    ! A second state: the run works, so the file takes its place, that of an older one perhaps.
    if (this%states == 2 .and. .not. this%taking_over) call this%publish(error)
  end subroutine write_state

  subroutine publish(this, error)
    class(simulation_file_t), intent(inout) :: this
    !> The file cannot be put in its place
    type(error_t), allocatable, intent(out) :: error

    if (this%in_use .and. this%states > 0) call this%file%publish(error)
  end subroutine publish

  !> Take over the first states of an earlier file, in the same order of writing: what becomes of
  !> the file is what would have become of it had there been no break.
  subroutine take_over(this, earlier, states, error)
    class(simulation_file_t), intent(inout) :: this
    !> The earlier file
    type(stored_fields_t), intent(in) :: earlier
    !> How many states
    integer, intent(in) :: states
    !> It cannot be read, or this one not be written
    type(error_t), allocatable, intent(out) :: error
    type(field_state_t) :: empty
    real(wp), allocatable :: values(:)
    integer :: k

    if (.not. this%in_use) return
    this%taking_over = .true.
    do k = 1, states
      this%state = empty
      this%state%time = earlier%time(k)
      if (this%in_motion) then
        call earlier%read_places(k, this%state%x, this%state%y, error)
        if (allocated(error)) return
      end if
      allocate (this%state%name(0), this%state%value(earlier%particles, 0))
      ! Fields about the rows come last, and with each state only where particles move.
      call take_fields(.true.)
      if (.not. allocated(error) .and. this%in_motion) call take_fields(.false.)
      if (allocated(error)) return
      call this%write_state(error)
      if (allocated(error)) return
    end do
    this%taking_over = .false.
    if (states > 1) call this%publish(error)

  contains

    subroutine take_fields(changing)
      logical, intent(in) :: changing
      integer :: j

      do j = 1, size(this%fields)
        if (.not. earlier%has(this%fields(j)%value)) cycle
        if (is_row_field(this%fields(j)%value) .eqv. changing) cycle
        call earlier%read_field(this%fields(j)%value, k, values, error)
        if (allocated(error)) return
        call this%state%add(this%fields(j)%value, values)
      end do
    end subroutine take_fields

  end subroutine take_over

  !> Whether a field is made of where particles are
  pure function needs_places(field) result(answer)
    character(len=*), intent(in) :: field
    logical :: answer

    answer = field == 'exact' .or. field == 'error'
  end function needs_places

  subroutine begin_closing(this)
    class(simulation_file_t), intent(inout) :: this

    if (this%in_use) call this%file%begin_closing()
  end subroutine begin_closing

  subroutine move_points(this, cloud)
    class(simulation_file_t), intent(inout) :: this
    !> Where particles are now
    type(cloud_t), intent(in) :: cloud

    if (.not. this%in_use) return
    this%x = cloud%x(this%place)
    this%y = cloud%y(this%place)
  end subroutine move_points

  subroutine note(this, name, value)
    class(simulation_file_t), intent(inout) :: this
    !> Name of the attribute
    character(len=*), intent(in) :: name
    !> Its value
    real(wp), intent(in) :: value

    if (.not. this%in_use .or. allocated(this%pending)) return
    call this%file%set_attribute(name, value, this%pending)
  end subroutine note

  !> A word about the run.
  subroutine say(this, name, value)
    class(simulation_file_t), intent(inout) :: this
    !> Name of the attribute, and its value
    character(len=*), intent(in) :: name, value

    if (.not. this%in_use .or. allocated(this%pending)) return
    call this%file%set_attribute(name, value, this%pending)
  end subroutine say

  !> One data set for each account, of one number for each state.
  subroutine write_budget(this, budget, entries)
    class(simulation_file_t), intent(inout) :: this
    !> How the budget is made up
    type(heat_budget_t), intent(in) :: budget
    !> The budgets, one a state
    type(budget_entry_t), intent(in) :: entries(:)
    integer :: k, j

    call write_numbers('budget_time', entries%time)
    call write_numbers('budget_stored', entries%stored)
    if (.not. budget%available) return
    call write_numbers('budget_stored_rate', entries%stored_rate)
    do k = 1, size(budget%account)
      call write_numbers('budget_'//budget%account(k)%value, &
                         [(entries(j)%power(k), j=1, size(entries))])
    end do
    call write_numbers('budget_imbalance', entries%imbalance)

  contains

    subroutine write_numbers(name, numbers)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: numbers(:)

      if (.not. this%in_use .or. allocated(this%pending)) return
      call this%file%write_series(name, numbers, this%pending)
    end subroutine write_numbers

  end subroutine write_budget

  subroutine close_file(this, phases, error)
    class(simulation_file_t), intent(inout) :: this
    !> Wall time by phase
    type(phase_t), intent(in) :: phases(:)
    !> The file could not be written to its end
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    if (.not. this%in_use) return
    do k = 1, size(phases)
      if (allocated(this%pending)) exit
      call this%file%set_wall_time(trim(phases(k)%name), phases(k)%seconds, this%pending)
    end do
    if (allocated(this%pending)) then
      call move_alloc(this%pending, error)
      call this%abandon()
    else
      call this%file%close(error)
    end if
  end subroutine close_file

  subroutine abandon(this)
    class(simulation_file_t), intent(inout) :: this

    if (this%in_use) call this%file%discard()
  end subroutine abandon

end module calor_simulation_file
