!> From a scene's boundary conditions to the particles that are held.
module calor_scene_walls
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_expression, only: compile_expression
  use calor_kinds, only: wp, ip
  use calor_prescribed, only: prescribed_t
  use calor_scene, only: scene_t
  use calor_scene_values, only: check_values
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: hold_walls

contains

  !> Hold the wall particles at what the boundaries say; where two speak of one particle, as at a
  !> corner, the later one in the scene counts.
  subroutine hold_walls(scene, cloud, prescribed, error)
    !> The scene
    type(scene_t), intent(in) :: scene
    !> Its cloud
    type(cloud_t), intent(in) :: cloud
    !> What is held, one entry a boundary condition, at the values of time 0
    type(prescribed_t), allocatable, intent(out) :: prescribed(:)
    !> A boundary is unknown or has no particle, or nothing is said about one
    type(error_t), allocatable, intent(out) :: error
    integer, allocatable :: holder(:)
    integer :: k, particle

    allocate (holder(cloud%particles()), source=0)
    do k = 1, size(scene%boundaries)
      call mark_boundary(cloud, scene%boundaries(k)%on, scene%boundaries(k)%place, k, holder, &
                         error)
      if (allocated(error)) return
    end do
    call check_walls(scene%path, cloud, holder, error)
    if (allocated(error)) return
    allocate (prescribed(size(scene%boundaries)))
    do k = 1, size(scene%boundaries)
      associate (boundary => scene%boundaries(k), held => prescribed(k))
        held%particle = pack([(int(particle, ip), particle=1, size(holder))], holder == k)
        allocate (held%temperature(size(held%particle)), source=boundary%value)
        if (boundary%value_expression == '') cycle
        allocate (held%expression)
        call compile_expression(boundary%value_expression, held%expression, error)
        if (allocated(error)) return
        held%x = cloud%x(held%particle)
        held%y = cloud%y(held%particle)
        call held%expression%evaluate(held%x, held%y, 0.0_wp, values=held%temperature)
        call check_values(boundary%value_expression, boundary%place, held%temperature, held%x, &
                          held%y, error)
        if (allocated(error)) return
        if (held%expression%uses('t')) cycle
        deallocate (held%expression)
      end associate
    end do
  end subroutine hold_walls

  !> Note which boundary condition holds which particle.
  subroutine mark_boundary(cloud, name, place, number, holder, error)
    type(cloud_t), intent(in) :: cloud
    character(len=*), intent(in) :: name, place
    integer, intent(in) :: number
    integer, intent(inout) :: holder(:)
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: names
    integer :: bit

    if (name == 'all') then
      where (cloud%side /= 0) holder = number
      return
    end if
    names = '''all'''
    do bit = 0, size(cloud%boundary) - 1
      if (cloud%boundary(bit + 1)%value == name) then
        ! A short edge of a curve may lie between two particles
        if (any(cloud%side /= 0) .and. .not. any(btest(cloud%side, bit))) then
          call raise(error, status_bad_input, place//': no particle lies on '''//name// &
                     ''': lower &domain spacing.')
        end if
        where (btest(cloud%side, bit)) holder = number
        return
      end if
      names = names//', '''//cloud%boundary(bit + 1)%value//''''
    end do
    call raise(error, status_bad_input, place//': the domain has no boundary called '''//name// &
               '''. There are: '//names//'.')
  end subroutine mark_boundary

  !> Every wall particle must be held, and some particle must not be.
  subroutine check_walls(path, cloud, holder, error)
    !> The scene
    character(len=*), intent(in) :: path
    type(cloud_t), intent(in) :: cloud
    integer, intent(in) :: holder(:)
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: names
    integer :: bit

    if (all(cloud%side == 0)) then
      call raise(error, status_bad_input, path//': no particle of the cloud is marked as '// &
                 'a wall, so no temperature can be held: give its file a column ''wall'' with '// &
                 '1 for the particles on the boundary.')
      return
    end if
    if (all(cloud%side /= 0)) then
      call raise(error, status_bad_input, path//': all '//to_text(cloud%particles())// &
                 ' particles lie on the boundary: lower &domain spacing.')
      return
    end if
    names = ''
    do bit = 0, size(cloud%boundary) - 1
      if (any(btest(cloud%side, bit) .and. holder == 0)) then
        names = names//' '''//cloud%boundary(bit + 1)%value//''''
      end if
    end do
    if (names /= '') then
      call raise(error, status_bad_input, path//': nothing is said about the boundary'//names// &
                 ': add a group &boundary with on, kind = ''temperature'' and value.')
    end if
  end subroutine check_walls

end module calor_scene_walls
