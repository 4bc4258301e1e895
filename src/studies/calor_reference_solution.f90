!> The temperature at the end of a scene that results are compared with: the scene's exact
!> solution, or a computed one that is much more accurate than they are.
!>
!> The computed one is that of the highest order on a cloud finer than the finest to be compared.
!> How far to trust it is told by a less accurate one, on the next coarser cloud, or by the next
!> lower order where the cloud is given: the two differ by more than the better one errs. It is
!> handed to other places by polynomials of high degree.
module calor_reference_solution
  use calor_cloud, only: cloud_t
  use calor_cost_method, only: cost_method_t
  use calor_error, only: error_t
  use calor_expression, only: expression_t, compile_expression
  use calor_kinds, only: wp
  use calor_laplacian_schemes, only: usual_support
  use calor_local_polynomial, only: interpolate_field
  use calor_scene, only: scene_t
  use calor_simulation, only: simulation_t
  use calor_text, only: to_text
  use calor_time_choice, only: time_choice_t, choose_time_steps, pilot_scene, relative_difference
  implicit none (type, external)
  private

  public :: reference_solution_t

  !> A solution to compare with
  type :: reference_solution_t
    !> Relative L2 norm of the difference from the next coarser one; 0: the solution is exact
    real(wp) :: uncertainty = 0.0_wp
    !> What was computed, for people; '' where the solution is exact
    character(len=:), allocatable :: origin
    real(wp), private :: time = 0.0_wp
    type(expression_t), private :: exact
    type(cloud_t), private :: cloud
    real(wp), allocatable, private :: temperature(:)
  contains
    !> Take or make the solution
    procedure :: find
    !> The temperature at the end at any places of the body
    procedure :: values_at
  end type reference_solution_t

  !> Orders of the solution and, where the cloud is given, of the one that it is judged by
  integer, parameter :: highest_order = 8, next_order = 6
  !> How much finer its cloud is than the finest that is compared
  real(wp), parameter :: refinement = sqrt(2.0_wp)
  !> Degree of the polynomials that carry the solution to other places
  integer, parameter :: transfer_degree = 6
  !> Errors of time steps: the first that is tried, the least, and what part they may be of the
  !> uncertainty
  real(wp), parameter :: first_time_error = 1.0e-5_wp, least_time_error = 1.0e-11_wp, &
                         time_share = 0.1_wp

contains

  subroutine find(this, scene, finest, error)
    class(reference_solution_t), intent(out) :: this
    !> The scene
    type(scene_t), intent(in) :: scene
    !> The smallest distance between particles that is to be compared, m; 0: the cloud is given
    real(wp), intent(in) :: finest
    !> The solution can be neither taken nor made
    type(error_t), allocatable, intent(out) :: error
    type(reference_solution_t) :: coarser
    type(cost_method_t) :: method, lesser
    real(wp), allocatable :: carried(:)
    real(wp) :: allowed

    this%time = scene%time%end
    this%origin = ''
    if (scene%exact_expression /= '') then
      call compile_expression(scene%exact_expression, this%exact, error)
      return
    end if
    method%laplacian = 'consistent'
    method%order = highest_order
    method%support = usual_support(method%laplacian, method%order)
    lesser = method
    if (.not. finest > 0) then
      lesser%order = next_order
      lesser%support = usual_support(lesser%laplacian, lesser%order)
    end if
    allowed = first_time_error
    do
      call compute(coarser, scene, lesser, finest, allowed, error)
      if (allocated(error)) return
      call compute(this, scene, method, finest/refinement, allowed, error)
      if (allocated(error)) return
      allocate (carried(coarser%cloud%particles()))
      call this%values_at(coarser%cloud%x, coarser%cloud%y, carried)
      this%uncertainty = relative_difference(coarser%temperature, carried, coarser%cloud%volume)
      if (allowed <= time_share*this%uncertainty .or. allowed <= least_time_error) exit
      allowed = max(least_time_error, 0.5_wp*time_share*this%uncertainty)
      deallocate (carried)
    end do
    method%support = 0
    this%origin = method%name()//' with particles '//to_text(this%cloud%spacing, digits=3)// &
                  ' m apart'
  end subroutine find

  !> Run the scene with one method.
  subroutine compute(solution, scene, method, spacing, allowed, error)
    class(reference_solution_t), intent(inout) :: solution
    type(scene_t), intent(in) :: scene
    type(cost_method_t), intent(in) :: method
    !> Distance between particles, m; 0: the cloud is given
    real(wp), intent(in) :: spacing
    !> The error that time steps may make, relative L2
    real(wp), intent(in) :: allowed
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: finer
    type(simulation_t) :: simulation
    type(time_choice_t) :: choice

    finer = pilot_scene(scene)
    if (spacing > 0) finer%domain%spacing = spacing
    finer%output%file = ''
    call method%apply(finer)
    call simulation%prepare(finer, error)
    if (.not. allocated(error)) call simulation%certify(error)
    if (.not. allocated(error)) call choose_time_steps(simulation, allowed, choice, error)
    if (allocated(error)) return
    solution%cloud = simulation%cloud
    call move_alloc(choice%temperature, solution%temperature)
  end subroutine compute

  subroutine values_at(this, x, y, values)
    class(reference_solution_t), intent(in) :: this
    !> Coordinates, m
    real(wp), intent(in) :: x(:), y(:)
    !> The temperature there at the end of the scene
    real(wp), intent(out) :: values(:)

    if (allocated(this%temperature)) then
      call interpolate_field(this%cloud%x, this%cloud%y, this%temperature, this%cloud%spacing, &
                             transfer_degree, x, y, values)
    else
      call this%exact%evaluate(x, y, this%time, values=values)
    end if
  end subroutine values_at

end module calor_reference_solution
