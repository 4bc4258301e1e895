!> What of a scene cannot be run by several ranks, refused by name before any work is done.
module calor_shared_support
  use calor_error, only: error_t, raise, status_bad_input
  use calor_scene, only: scene_t
  use calor_scene_file, only: group_t
  use calor_scene_getters, only: raise_at
  implicit none (type, external)
  private

  public :: refuse_unsupported

contains

  subroutine refuse_unsupported(scene, error)
    !> The scene
    type(scene_t), intent(in) :: scene
    !> The first thing in it that calor-mpi does not do, and what to do instead
    type(error_t), allocatable, intent(out) :: error

    if (.not. (scene%time%end > 0 .or. scene%time%steady)) then
      call raise(error, status_bad_input, &
                 scene%path//' has no group &time: add &time end = ... '// &
                 '/, in seconds.')
    else if (scene%motion%in_force) then
      call refuse('motion', '', 'particles that move: run the scene by calor, or take &motion out.')
    else if (scene%accuracy%target > 0) then
      call refuse('accuracy', 'target', 'a target of accuracy: run the scene by calor, or take '// &
                  '&accuracy out.')
    else if (scene%accuracy%estimate) then
      call refuse('accuracy', 'estimate', 'estimates of the error: run the scene by calor, or '// &
                  'take &accuracy out.')
    else if (scene%domain%arrangement == 'relaxed') then
      call refuse('domain', 'arrangement', '''relaxed'': take ''jittered'', or run the scene '// &
                  'by calor and give its output file to &domain shape = ''cloud''.')
    else if (scene%laplacian == 'double_gradient') then
      call refuse('scheme', 'laplacian', '''double_gradient'': take ''fatehi_manzari''.')
    else if (scene%single_weights) then
      call refuse('scheme', 'single_weights', 'weights in single precision: take '// &
                  'single_weights out.')
    end if

  contains

    subroutine refuse(name, key, sentence)
      !> Where the scene asks for it, what that is, and what to do instead
      character(len=*), intent(in) :: name, key, sentence
      type(group_t) :: group

      call scene%file%group(name, group)
      call raise_at(error, group, key, 'calor-mpi does not support '//sentence)
    end subroutine refuse

  end subroutine refuse_unsupported

end module calor_shared_support
