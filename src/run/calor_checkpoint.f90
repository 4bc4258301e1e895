!> When the state of a run is laid aside, and from what a run may be resumed.
module calor_checkpoint
  use, intrinsic :: iso_fortran_env, only: int8
  use calor_checkpoint_file, only: read_checkpoint_file, older_checkpoint
  use calor_checksum, only: checksum_t
  use calor_error, only: error_t, raise, status_bad_input, status_bad_file
  use calor_kinds, only: wp, i8
  use calor_saved_state, only: saved_state_t
  use calor_scene, only: scene_t, checkpoint_settings_t
  use calor_scene_changes, only: scene_changes
  use calor_scene_cloud, only: beside_scene
  use calor_scene_file, only: scene_file_t, parse_scene_text
  use calor_step_listener, only: step_listener_t
  use calor_text, only: text_t, to_text
  use calor_version, only: version
  implicit none (type, external)
  private

  public :: checkpoint_clock_t, save_scene, read_resume_point, check_scene

  !> Of more changes only so many are told
  integer, parameter :: most_told = 4

  !> Says when the next checkpoint is due; between a stepper and whoever else listens to it
  type, extends(step_listener_t) :: checkpoint_clock_t
    !> Who else hears of each step
    class(step_listener_t), pointer :: next => null()
    type(checkpoint_settings_t), private :: settings
    !> When the last checkpoint was written: the system's clock, and the simulated time, s
    integer(i8), private :: last_tick = 0
    real(wp), private :: next_time = huge(1.0_wp)
    logical, private :: in_use = .false.
  contains
    !> Begin to count
    procedure :: start
    !> Whether a checkpoint is due
    procedure :: is_due
    !> One has been written
    procedure :: reset
    procedure :: at_step
  end type checkpoint_clock_t

contains

  subroutine start(this, settings, time)
    class(checkpoint_clock_t), intent(inout) :: this
    !> What the scene asks for
    type(checkpoint_settings_t), intent(in) :: settings
    !> Simulated time, s
    real(wp), intent(in) :: time

    this%settings = settings
    this%in_use = settings%asked
    call this%reset(time)
  end subroutine start

  subroutine reset(this, time)
    class(checkpoint_clock_t), intent(inout) :: this
    !> Simulated time, s
    real(wp), intent(in) :: time

    call system_clock(this%last_tick)
    associate (every => this%settings%every)
      if (every > 0) this%next_time = (aint(time/every*(1 + 1.0e-12_wp)) + 1)*every
    end associate
  end subroutine reset

  function is_due(this, time) result(answer)
    class(checkpoint_clock_t), intent(in) :: this
    !> Simulated time, s
    real(wp), intent(in) :: time
    logical :: answer
    integer(i8) :: now, rate

    answer = .false.
    if (.not. this%in_use) return
    answer = this%settings%every > 0 .and. time >= this%next_time*(1 - 1.0e-12_wp)
    if (answer .or. .not. this%settings%every_seconds > 0) return
    call system_clock(now, rate)
    answer = real(now - this%last_tick, wp)/rate >= this%settings%every_seconds
  end function is_due

  subroutine at_step(this, time, steps, accumulated_error, rest)
    class(checkpoint_clock_t), intent(inout) :: this
    real(wp), intent(in) :: time
    integer, intent(in) :: steps
    real(wp), intent(in) :: accumulated_error
    logical, intent(inout) :: rest

    if (associated(this%next)) call this%next%at_step(time, steps, accumulated_error, rest)
    rest = rest .or. this%is_due(time)
  end subroutine at_step

  ! ---------------------------------------------------------------------------------------------
  ! What belongs to a checkpoint
  ! ---------------------------------------------------------------------------------------------

  !> What a run was started from.
  subroutine save_scene(scene, state)
    !> The scene
    type(scene_t), intent(in) :: scene
    type(saved_state_t), intent(inout) :: state

    call state%put('version', version)
    call state%put('scene', scene%text)
    call state%put('cloud_file', cloud_checksum(scene))
  end subroutine save_scene

  !> The checksum of the file of a user's cloud, '' where there is none
  function cloud_checksum(scene) result(text)
    type(scene_t), intent(in) :: scene
    character(len=:), allocatable :: text
    character(len=:), allocatable :: path

    text = ''
    if (scene%domain%shape /= 'cloud') return
    path = beside_scene(scene%path, scene%domain%file)
    text = file_checksum(path)
  end function cloud_checksum

  !> A piece at a time: the file may be larger than the memory.
  function file_checksum(path) result(text)
    character(len=*), intent(in) :: path
    character(len=:), allocatable :: text
    integer(i8), parameter :: most_bytes = 2_i8**22
    type(checksum_t) :: checksum
    integer(int8), allocatable :: bytes(:)
    integer(i8) :: length, done
    integer :: unit, status

    text = ''
    open (newunit=unit, file=path, access='stream', form='unformatted', status='old', &
          action='read', iostat=status)
    if (status /= 0) return
    inquire (unit=unit, size=length)
    done = 0
    do while (done < length .and. status == 0)
      allocate (bytes(min(most_bytes, length - done)))
      read (unit, iostat=status) bytes
      if (status == 0) call checksum%add(bytes)
      done = done + size(bytes)
      deallocate (bytes)
    end do
    close (unit)
    if (status == 0) text = checksum%text()
  end function file_checksum

  !> Read the checkpoint of a scene, and make sure that it belongs to it.
  subroutine read_resume_point(scene, path, state, error)
    !> The scene as it is now
    type(scene_t), intent(in) :: scene
    !> The checkpoint; '': the one that the scene names
    character(len=*), intent(in) :: path
    !> What was laid aside
    type(saved_state_t), intent(out) :: state
    !> There is no checkpoint, it is damaged, or the scene has changed
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: file, older
    logical :: there

    file = path
    if (file == '') file = scene%checkpoint%file
    if (scene%time%steady) then
      call raise(error, status_bad_input, &
                 scene%path//': a steady state is found without steps, '// &
                 'so that there is nothing to resume: run it without --resume.')
      return
    else if (scene%accuracy%target > 0) then
      call raise(error, status_bad_input, scene%path//': a search for an accuracy consists of '// &
                 'many runs, which cannot be resumed: run it without --resume.')
      return
    end if
    call read_checkpoint_file(file, state, error)
    if (allocated(error)) then
      older = older_checkpoint(file, 1)
      inquire (file=older, exist=there)
      if (there) then
        error%message = error%message//' An older one is '''//older// &
                        ''': calor run --resume --checkpoint '//older//' '//scene%path
      end if
      return
    end if
    call check_scene(scene, file, state, error)
  end subroutine read_resume_point

  !> Make sure that a scene is the one that a state belongs to, but for what does no harm.
  subroutine check_scene(scene, file, state, error)
    !> The scene as it is now
    type(scene_t), intent(in) :: scene
    !> The checkpoint
    character(len=*), intent(in) :: file
    !> What was laid aside
    type(saved_state_t), intent(inout) :: state
    !> What has changed
    type(error_t), allocatable, intent(out) :: error
    type(scene_file_t) :: before
    type(text_t), allocatable :: changes(:)
    character(len=:), allocatable :: text, cloud, list
    integer :: k

    text = ''
    cloud = ''
    call state%get('scene', text)
    call state%get('cloud_file', cloud)
    call parse_scene_text(text, scene%path, before, error)
    if (allocated(error)) then
      call raise(error, status_bad_file, 'The checkpoint '''//file//''' holds no scene.')
      return
    end if
    changes = scene_changes(before, scene%file)
    if (size(changes) == 0 .and. cloud /= cloud_checksum(scene)) then
      changes = [text_t('the content of '//scene%domain%file)]
    end if
    if (size(changes) == 0) return
    list = ''
    do k = 1, min(size(changes), most_told)
      list = list//new_line('a')//'  '//changes(k)%value
    end do
    if (size(changes) > most_told) then
      list = list//new_line('a')//'  and '//to_text(size(changes) - most_told)//' more'
    end if
    call raise(error, status_bad_input, scene%path//' has changed since the checkpoint '''//file// &
               ''' was written; take the changes back, or run it anew without --resume:'//list)
  end subroutine check_scene

end module calor_checkpoint
