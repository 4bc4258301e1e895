!> From a scene to its cloud.
module calor_scene_cloud
  use calor_body, only: body_t
  use calor_body_cloud, only: fill_body
  use calor_cloud, only: cloud_t
  use calor_cloud_check, only: check_cloud
  use calor_cloud_file, only: read_cloud_file
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, ip
  use calor_memory_need, only: check_memory
  use calor_neighbour_list, only: neighbour_list_t
  use calor_rectangle_cloud, only: make_rectangle
  use calor_scene, only: scene_t
  use calor_scene_body, only: make_scene_body
  use calor_slice, only: slice_t
  use calor_space_filling_curve, only: hilbert_order
  use calor_text, only: to_text
  use calor_volume, only: volumes_from_kernel
  implicit none (type, external)
  private

  public :: make_scene_cloud, make_scene_slice, require_neighbours, beside_scene

contains

  !> Make or read the cloud that a scene speaks of, checked, with its particles in an order in which
  !> neighbours in space are neighbours in memory.
  subroutine make_scene_cloud(scene, kernel, cloud, error)
    !> The scene
    type(scene_t), intent(in) :: scene
    !> The smoothing kernel, for volumes that a user's cloud leaves out
    class(kernel_t), intent(in) :: kernel
    !> The cloud
    type(cloud_t), intent(out) :: cloud
    !> The scene's domain or the user's cloud is wrong, or its file cannot be read
    type(error_t), allocatable, intent(out) :: error
    type(body_t) :: body
    integer(ip), allocatable :: order(:)
    logical :: has_volume, has_wall

    associate (domain => scene%domain)
      select case (domain%shape)
      case ('cloud')
        call read_cloud_file(beside_scene(scene%path, domain%file), cloud, has_volume, has_wall, &
                             error)
        if (allocated(error)) return
        call set_spacing(domain%spacing, has_volume, cloud, error)
        if (allocated(error)) return
        call check_memory(real(cloud%particles(), wp), scene, error)
        if (allocated(error)) return
        if (.not. has_volume) then
          call volumes_from_kernel(cloud, kernel, scene%support*cloud%spacing)
        end if
        cloud%area = cloud%volume
      case default
        call make_scene_body(domain, body, error)
        if (allocated(error)) return
        call check_memory(body%particles_about(domain%spacing), scene, error)
        if (allocated(error)) return
        if (domain%shape == 'rectangle') then
          call make_rectangle(domain%x_range, domain%y_range, domain%spacing, &
                              domain%arrangement, domain%jitter, domain%seed, cloud, error)
        else
          call fill_body(body, domain%spacing, domain%arrangement, domain%jitter, domain%seed, &
                         cloud, error)
        end if
      end select
      if (.not. allocated(error)) call check_cloud(cloud, error)
      if (allocated(error)) then
        error%message = domain%place//': '//error%message
        return
      end if
    end associate
    allocate (order(cloud%particles()))
    call hilbert_order(cloud%x, cloud%y, order)
    call cloud%reorder(order)
  end subroutine make_scene_cloud

  !> Make or read a slice of a cloud, as one of several processes does: in the user's order, without
  !> areas and unchecked. The particles inside a disc, annulus or polygon, and those from a file,
  !> are numbered as if those of no other slice came before them. The spacing of a user's cloud is
  !> that of the scene, 0 if it gives none.
  subroutine make_scene_slice(scene, slice, cloud, has_volume, error)
    !> The scene, its particles not 'relaxed'
    type(scene_t), intent(in) :: scene
    !> Which part of how many
    type(slice_t), intent(in) :: slice
    !> The particles
    type(cloud_t), intent(out) :: cloud
    !> Whether their volumes are known
    logical, intent(out) :: has_volume
    !> The scene's domain is wrong
    type(error_t), allocatable, intent(out) :: error
    type(body_t) :: body
    logical :: has_wall

    has_volume = .true.
    associate (domain => scene%domain)
      if (domain%shape == 'cloud') then
        call read_cloud_file(beside_scene(scene%path, domain%file), cloud, has_volume, has_wall, &
                             error, slice=slice)
        cloud%spacing = domain%spacing
        return
      end if
      call make_scene_body(domain, body, error)
      if (allocated(error)) return
      call check_memory(body%particles_about(domain%spacing)/slice%parts, scene, error)
      if (allocated(error)) return
      if (domain%shape == 'rectangle') then
        call make_rectangle(domain%x_range, domain%y_range, domain%spacing, domain%arrangement, &
                            domain%jitter, domain%seed, cloud, error, slice)
      else
        call fill_body(body, domain%spacing, domain%arrangement, domain%jitter, domain%seed, &
                       cloud, error, slice)
      end if
      if (allocated(error)) error%message = domain%place//': '//error%message
    end associate
  end subroutine make_scene_slice

  !> Every row of a neighbour list must have at least one neighbour.
  subroutine require_neighbours(scene, cloud, list, error)
    !> The scene
    type(scene_t), intent(in) :: scene
    !> Its cloud
    type(cloud_t), intent(in) :: cloud
    !> Neighbours within the support radius
    type(neighbour_list_t), intent(in) :: list
    !> A particle has none
    type(error_t), allocatable, intent(out) :: error
    integer :: row

    do row = 1, list%rows()
      if (list%first(row + 1) > list%first(row)) cycle
      associate (particle => list%target(row))
        call raise(error, status_bad_input, scene%support_place//': particle '// &
                   to_text(cloud%user_index(particle))//' at ('// &
                   to_text(cloud%x(particle), digits=6)//', '// &
                   to_text(cloud%y(particle), digits=6)//') has no neighbour within the '// &
                   'support radius of '//to_text(scene%support*cloud%spacing, digits=4)//' m: '// &
                   'raise &kernel support, which is '//to_text(scene%support)//'.')
      end associate
      return
    end do
  end subroutine require_neighbours

  !> A user's cloud: the spacing given, or the root of the mean particle volume.
  subroutine set_spacing(given, has_volume, cloud, error)
    real(wp), intent(in) :: given
    logical, intent(in) :: has_volume
    type(cloud_t), intent(inout) :: cloud
    type(error_t), allocatable, intent(out) :: error

    if (given > 0) then
      cloud%spacing = given
    else if (has_volume) then
      cloud%spacing = sqrt(sum(cloud%volume)/cloud%particles())
    else
      call raise(error, status_bad_input, &
                 'The cloud''s file has no column ''volume'', so &domain '// &
                 'needs spacing: the distance between neighbouring particles in metres.')
    end if
  end subroutine set_spacing

  !> A path as the scene means it: relative to the folder of the scene file.
  pure function beside_scene(scene_path, path) result(found)
    character(len=*), intent(in) :: scene_path, path
    character(len=:), allocatable :: found

    found = path
    if (index(path, '/') == 1) return
    found = scene_path(1:index(scene_path, '/', back=.true.))//path
  end function beside_scene

end module calor_scene_cloud
