!> Checkpoints of several ranks, for any number of them.
!>
!> A checkpoint is two files. The one that the scene names is a checkpoint file of the library with
!> all that is the same on every rank. It names the other one, beside it, which has the numbers of
!> the particles: 'plate.h5.particles.0' for 'plate.h5'. A new one of these takes a number that no
!> checkpoint in force refers to, and the file that names it takes its place last and at once, so
!> that at every moment there is a checkpoint, the old one or the new one.
module calor_shared_checkpoint
  use calor_checkpoint, only: read_resume_point, save_scene
  use calor_checkpoint_file, only: older_checkpoint, read_checkpoint_file, write_checkpoint_file
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t, raise, status_bad_file
  use calor_file_system, only: remove_file, resolved_path
  use calor_kinds, only: wp, i8
  use calor_particle_columns, only: particle_columns_t
  use calor_ranks, only: ranks_t
  use calor_saved_state, only: saved_state_t
  use calor_scene, only: scene_t
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: write_shared_checkpoint, read_shared_checkpoint, read_particles

  !> What has a number for each particle
  character(len=*), parameter :: of_particles(*) = [character(len=28) :: &
      'temperature', 'content', 'stepper/rate_start', 'stepper/last', 'stepper/before', &
      'conduction/slope', 'conduction/temperature_slope', 'conduction/potential_slope']

contains

  !> Write a state, in place of the checkpoint before.
  subroutine write_shared_checkpoint(ranks, scene, cloud, particles, state, error)
    type(ranks_t), intent(in) :: ranks
    type(scene_t), intent(in) :: scene
    !> The particles here, the own ones marked, and how many all ranks have
    type(cloud_t), intent(in) :: cloud
    integer(i8), intent(in) :: particles
    !> The state: what is of particles, of those here; all else the same on all ranks
    type(saved_state_t), intent(in) :: state
    !> It cannot be written; on all ranks the same
    type(error_t), allocatable, intent(out) :: error
    type(particle_columns_t) :: file
    type(saved_state_t) :: head
    character(len=:), allocatable :: path, reason
    integer :: k, columns, number

    path = resolved_path(scene%checkpoint%file)
    number = 0
    if (ranks%speaks()) number = findloc(in_force(), .false., 1) - 1
    number = int(ranks%total(int(number, i8)))
    call file%create(particles_path(path, number), ranks, cloud, particles, error)
    columns = 0
    if (ranks%speaks()) call save_scene(scene, head)
    do k = 1, state%items
      if (allocated(error)) return
      associate (item => state%item(k))
        if (any(of_particles == item%name)) then
          columns = columns + 1
          call file%add(item%reals, error)
          call head%put('column_'//to_text(columns), item%name)
        else if (allocated(item%reals)) then
          call head%put(item%name, item%reals)
        else if (allocated(item%integers)) then
          call head%put(item%name, item%integers)
        else
          call head%put(item%name, item%text)
        end if
      end associate
    end do
    call file%finish(error)
    if (allocated(error)) return
    call head%put('columns', columns)
    call head%put('particles_file', number)
    call head%put('written_by_ranks', file%written)
    call head%put('checksums', sums_text(file%sum))
    if (ranks%speaks()) then
      call write_checkpoint_file(scene%checkpoint%file, head, scene%checkpoint%keep, error)
      if (.not. allocated(error)) call remove_others()
    end if
    call ranks%agree(error)

  contains

    !> Which numbers, from 0, checkpoints refer to; there is one to which none does.
    function in_force() result(used)
      logical :: used(scene%checkpoint%keep + 1)
      type(saved_state_t) :: other
      type(error_t), allocatable :: unreadable
      character(len=:), allocatable :: name
      integer :: age, known

      used = .false.
      do age = 0, scene%checkpoint%keep - 1
        name = path
        if (age > 0) name = older_checkpoint(path, age)
        call read_checkpoint_file(name, other, unreadable)
        if (allocated(unreadable)) cycle
        if (.not. other%has('particles_file')) cycle
        call other%get('particles_file', known)
        if (known >= 0 .and. known < size(used)) used(known + 1) = .true.
      end do
    end function in_force

    subroutine remove_others()
      integer :: other
      logical :: used(scene%checkpoint%keep + 1)

      used = in_force()
      do other = 0, size(used) - 1
        if (.not. used(other + 1)) call remove_file(particles_path(path, other), reason)
      end do
    end subroutine remove_others

  end subroutine write_shared_checkpoint

  pure function particles_path(path, number) result(name)
    !> The checkpoint, and which of its files
    character(len=*), intent(in) :: path
    integer, intent(in) :: number
    character(len=:), allocatable :: name

    name = path//'.particles.'//to_text(number)
  end function particles_path

  pure function sums_text(sum) result(text)
    integer(i8), intent(in) :: sum(:)
    character(len=16*size(sum)) :: text
    integer :: k

    do k = 1, size(sum)
      write (text(16*k - 15:16*k), '(z16.16)') sum(k)
    end do
  end function sums_text

  !> Read what is the same on all ranks, and make sure that it belongs to the scene.
  subroutine read_shared_checkpoint(ranks, scene, path, state, error)
    type(ranks_t), intent(in) :: ranks
    !> The scene as it is now
    type(scene_t), intent(in) :: scene
    !> The checkpoint; '': the one that the scene names
    character(len=*), intent(in) :: path
    type(saved_state_t), intent(out) :: state
    !> There is none, it is damaged, or the scene has changed; on all ranks the same
    type(error_t), allocatable, intent(out) :: error

    ! One rank looks at the scene, and at a user's cloud, for all.
    if (ranks%speaks()) call read_resume_point(scene, path, state, error)
    call ranks%agree(error)
    if (allocated(error)) return
    if (.not. ranks%speaks()) call read_checkpoint_file(path_of(scene, path), state, error)
    if (.not. allocated(error) .and. .not. state%has('particles_file')) then
      call raise(error, status_bad_file, 'The checkpoint '''//path_of(scene, path)// &
                 ''' was written by calor, which keeps other things: resume the scene by calor.')
    end if
    call ranks%agree(error)
  end subroutine read_shared_checkpoint

  pure function path_of(scene, path) result(name)
    type(scene_t), intent(in) :: scene
    character(len=*), intent(in) :: path
    character(len=:), allocatable :: name

    name = path
    if (name == '') name = scene%checkpoint%file
  end function path_of

  !> Read what belongs to particles into the state.
  subroutine read_particles(ranks, scene, path, cloud, particles, state, error)
    type(ranks_t), intent(in) :: ranks
    type(scene_t), intent(in) :: scene
    !> The checkpoint; '': the one that the scene names
    character(len=*), intent(in) :: path
    !> The particles here, the own ones marked, and how many all ranks have
    type(cloud_t), intent(in) :: cloud
    integer(i8), intent(in) :: particles
    !> What `read_shared_checkpoint` has read
    type(saved_state_t), intent(inout) :: state
    !> It is damaged; on all ranks the same
    type(error_t), allocatable, intent(out) :: error
    type(particle_columns_t) :: file
    character(len=:), allocatable :: name, sums, base
    real(wp), allocatable :: values(:)
    integer :: k, columns, number, status, age

    columns = 0
    number = 0
    sums = ''
    call state%get('columns', columns)
    call state%get('particles_file', number)
    call state%get('written_by_ranks', file%written)
    call state%get('checksums', sums)
    allocate (file%sum(len(sums)/16), source=0_i8)
    do k = 1, size(file%sum)
      read (sums(16*k - 15:16*k), '(z16)', iostat=status) file%sum(k)
      ! What is no number is no checksum of anything that is there.
      if (status /= 0) file%sum(k) = 0
    end do
    ! An older one is beside the same files.
    base = resolved_path(path_of(scene, path))
    do age = 1, scene%checkpoint%keep - 1
      name = resolved_path(scene%checkpoint%file)
      if (base == older_checkpoint(name, age)) base = name
    end do
    call file%open(particles_path(base, number), columns, ranks, cloud, particles, error)
    do k = 1, columns
      if (allocated(error)) return
      name = ''
      call state%get('column_'//to_text(k), name)
      allocate (values(cloud%particles()), source=0.0_wp)
      call file%read(k, values, error)
      if (allocated(error)) return
      ! Those of others mean nothing, but must be possible; rates are 0 there.
      if (.not. name == 'stepper/rate_start') then
        values(:cloud%own_first - 1) = values(cloud%own_first)
        values(cloud%own_last + 1:) = values(cloud%own_first)
      end if
      call state%put(name, values)
      deallocate (values)
    end do
    call file%close()
  end subroutine read_particles

end module calor_shared_checkpoint
