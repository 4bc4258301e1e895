!> Whoever is told of each step that an integration takes.
module calor_step_watcher
  use calor_error, only: error_t
  use calor_evolution, only: evolution_t
  use calor_integrator, only: integrator_t
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: step_watcher_t

  type, abstract :: step_watcher_t
  contains
    !> A step has been accepted
    procedure(stepped_interface), deferred :: stepped
    !> The longest step that it can follow, s
    procedure :: longest_step
  end type step_watcher_t

  abstract interface
    subroutine stepped_interface(this, evolution, integrator, time, step, u, error)
      import :: step_watcher_t, evolution_t, integrator_t, wp, error_t
      implicit none (type, external)
      class(step_watcher_t), intent(inout), target :: this
      !> What is integrated
      class(evolution_t), intent(inout), target :: evolution
      !> The method, which knows the error of the step
      class(integrator_t), intent(inout) :: integrator
      !> The new time and how long ago the step began, s
      real(wp), intent(in) :: time, step
      !> The new state
      real(wp), intent(in), contiguous :: u(:)
      !> The integration shall end here
      type(error_t), allocatable, intent(out) :: error
    end subroutine stepped_interface
  end interface

contains

  pure function longest_step(this) result(step)
    class(step_watcher_t), intent(in) :: this
    real(wp) :: step

    associate (unused => this)
    end associate
    step = huge(step)
  end function longest_step

end module calor_step_watcher
