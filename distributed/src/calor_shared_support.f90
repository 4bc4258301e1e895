!> What of a scene cannot be run by several ranks, refused by name before any work is done.
module calor_shared_support
  use calor_error, only: error_t, raise, status_bad_input
  use calor_scene, only: scene_t
  implicit none (type, external)
  private

  public :: refuse_unsupported

contains

  subroutine refuse_unsupported(scene, error)
    !> The scene
    type(scene_t), intent(in) :: scene
    !> The first thing in it that calor-mpi does not do
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    if (.not. (scene%time%end > 0 .or. scene%time%steady)) then
      call raise(error, status_bad_input, &
                 scene%path//' has no group &time: add &time end = ... '// &
                 '/, in seconds.')
    else if (scene%motion%in_force) then
      call refuse(scene%motion%place, 'particles that move')
    else if (scene%accuracy%estimate) then
      call refuse(scene%accuracy%place, 'estimates of the error')
    else if (scene%accuracy%target > 0) then
      call refuse(scene%accuracy%place, 'a target of accuracy')
    else if (scene%domain%arrangement == 'relaxed') then
      call refuse(scene%domain%place, 'arrangement = ''relaxed''')
    else if (scene%laplacian == 'double_gradient') then
      call refuse(scene%path//': &scheme', 'laplacian = ''double_gradient''')
    else if (scene%single_weights) then
      call refuse(scene%path//': &scheme', 'weights in single precision')
    end if
    if (allocated(error) .or. scene%output%file == '') return
    do k = 1, size(scene%output%fields)
      select case (scene%output%fields(k)%value)
      case ('temperature', 'exact', 'error', 'liquid_fraction')
        continue
      case default
        call refuse(scene%output%place, 'the field '''//scene%output%fields(k)%value//'''')
        return
      end select
    end do

  contains

    subroutine refuse(place, what)
      character(len=*), intent(in) :: place, what

      call raise(error, status_bad_input, place//': calor-mpi does not support '//what// &
                 '; run the scene by calor, or take that out.')
    end subroutine refuse

  end subroutine refuse_unsupported

end module calor_shared_support
