!> From a scene to its cloud.
module calor_scene_cloud
  use calor_rectangle_cloud, only: make_rectangle
  use calor_cloud, only: cloud_t
  use calor_cloud_check, only: check_cloud
  use calor_cloud_file, only: read_cloud_file
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, ip
  use calor_scene, only: scene_t
  use calor_space_filling_curve, only: hilbert_order
  use calor_volume, only: volumes_from_kernel
  implicit none (type, external)
  private

  public :: make_scene_cloud

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
        if (.not. has_volume) then
          call volumes_from_kernel(cloud, kernel, scene%support*cloud%spacing)
        end if
      case default
        call make_rectangle(domain%x_range, domain%y_range, domain%spacing, domain%arrangement, &
                            domain%jitter, domain%seed, cloud, error)
        if (allocated(error)) return
      end select
    end associate
    call check_cloud(cloud, error)
    if (allocated(error)) return
    allocate (order(cloud%particles()))
    call hilbert_order(cloud%x, cloud%y, order)
    call cloud%reorder(order)
  end subroutine make_scene_cloud

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
