!> Derivatives of a given field by any scheme on any cloud: `calor operators`.
module calor_operator_study
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_field_file, only: field_file_t
  use calor_gradient_scheme, only: gradient_scheme_t
  use calor_gradient_schemes, only: make_gradient_scheme
  use calor_kernel, only: kernel_t
  use calor_kernels, only: make_kernel
  use calor_kinds, only: wp, ip
  use calor_laplacian_consistent, only: natural_support
  use calor_laplacian_scheme, only: laplacian_scheme_t
  use calor_laplacian_schemes, only: make_laplacian_scheme
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_row_report, only: row_report_t
  use calor_scene, only: scene_t
  use calor_scene_cloud, only: make_scene_cloud, require_neighbours
  use calor_scene_values, only: field_values
  use calor_simulation_file, only: write_origin, check_target
  use calor_sparse_operator, only: sparse_operator_t
  use calor_sufficient_rows, only: assemble_sufficient_gradient, assemble_sufficient_laplacian
  implicit none (type, external)
  private

  public :: operator_study_t, derivative_t

  !> A derivative of the field by one scheme
  type :: derivative_t
    !> 'gradient_' or 'laplacian_' and the scheme's name: its name in the file
    character(len=:), allocatable :: name
    !> Values at all particles in the cloud's order: two columns for a gradient, one for a Laplacian
    real(wp), allocatable :: values(:, :)
    !> Relative L2 error over the particles inside, and over those without a wall in their support;
    !> negative where the true derivative is not given
    real(wp) :: error_inside = -1.0_wp, error_whole = -1.0_wp
  end type derivative_t

  !> Derivatives of a field on a cloud
  type :: operator_study_t
    type(scene_t) :: scene
    type(cloud_t) :: cloud
    !> The field at the particles
    real(wp), allocatable :: field(:)
    !> Its derivatives: gradients first, in the order of the scene
    type(derivative_t), allocatable :: derivatives(:)
    !> Number of particles inside, and of those without a wall in their support
    integer :: inside = 0, whole = 0
  contains
    !> Evaluate all derivatives that the scene asks for
    procedure :: evaluate
    !> Write them to the file that the scene names
    procedure :: write => write_study
  end type operator_study_t

  !> Schemes that are exact for more than the paper's are given the support that they need; the
  !> others are taken as they are written
  integer, parameter :: paper_gradient_degree = 1, paper_laplacian_degree = 2

contains

  subroutine evaluate(this, scene, error)
    class(operator_study_t), intent(out) :: this
    !> A scene with a group &operators
    type(scene_t), intent(in) :: scene
    !> The scene has no such group, or something in it is wrong
    type(error_t), allocatable, intent(out) :: error
    class(kernel_t), allocatable :: kernel
    type(neighbour_list_t) :: list
    real(wp), allocatable :: radius(:)
    logical, allocatable :: inside(:), whole(:)
    integer :: k, row, gradients

    if (scene%operators%field_expression == '') then
      call raise(error, status_bad_input, scene%path//' has no group &operators: add '// &
                 '&operators field_expression = ''exp(x)*sin(2*y)'' /.')
      return
    end if
    call check_target(scene%operators%file, scene%operators%place, scene, error)
    if (allocated(error)) return
    this%scene = scene
    call make_kernel(scene%kernel, kernel, error)
    if (allocated(error)) return
    call make_scene_cloud(scene, kernel, this%cloud, error)
    if (allocated(error)) return
    call field_values(scene%operators%field_expression, scene%path//': &operators', this%cloud, &
                      this%field, error)
    if (allocated(error)) return

    allocate (radius(this%cloud%particles()), source=scene%support*this%cloud%spacing)
    call build_neighbour_list(this%cloud%x, this%cloud%y, radius, list)
    call require_neighbours(scene, this%cloud, list, error)
    if (allocated(error)) return
    inside = this%cloud%side == 0
    whole = inside
    do row = 1, list%rows()
      whole(row) = whole(row) .and. all(inside(list%index(list%first(row):list%first(row + 1) - 1)))
    end do
    this%inside = count(inside)
    this%whole = count(whole)

    gradients = size(scene%operators%gradients)
    allocate (this%derivatives(gradients + size(scene%operators%laplacians)))
    do k = 1, gradients
      call evaluate_gradient(this, scene%operators%gradients(k)%value, kernel, radius, list, &
                             this%derivatives(k), error)
      if (allocated(error)) return
    end do
    do k = 1, size(scene%operators%laplacians)
      call evaluate_laplacian(this, scene%operators%laplacians(k)%value, kernel, radius, list, &
                              this%derivatives(gradients + k), error)
      if (allocated(error)) return
    end do
    call measure_errors(this, inside, whole, error)
  end subroutine evaluate

  subroutine evaluate_gradient(study, name, kernel, radius, list, derivative, error)
    class(operator_study_t), intent(in) :: study
    character(len=*), intent(in) :: name
    class(kernel_t), intent(in) :: kernel
    real(wp), intent(in) :: radius(:)
    type(neighbour_list_t), intent(in) :: list
    type(derivative_t), intent(inout) :: derivative
    type(error_t), allocatable, intent(out) :: error
    class(gradient_scheme_t), allocatable :: scheme
    type(sparse_operator_t) :: gradient_x, gradient_y
    type(row_report_t) :: report
    real(wp), allocatable :: grown(:)
    integer(ip), allocatable :: all_particles(:)
    integer :: k

    call make_gradient_scheme(name, scheme, error, study%scene%order)
    if (allocated(error)) return
    associate (cloud => study%cloud)
      if (scheme%exact_degree() > paper_gradient_degree) then
        grown = max(radius, natural_support(study%scene%order)*cloud%spacing)
        all_particles = [(int(k, ip), k=1, cloud%particles())]
        call assemble_sufficient_gradient(scheme, kernel, cloud%x, cloud%y, cloud%volume, grown, &
                                          all_particles, gradient_x, gradient_y, report)
      else
        call scheme%assemble(kernel, cloud%x, cloud%y, cloud%volume, radius, list, gradient_x, &
                             gradient_y)
      end if
      derivative%name = 'gradient_'//name
      allocate (derivative%values(cloud%particles(), 2))
    end associate
    call gradient_x%apply(study%field, derivative%values(:, 1))
    call gradient_y%apply(study%field, derivative%values(:, 2))
  end subroutine evaluate_gradient

  subroutine evaluate_laplacian(study, name, kernel, radius, list, derivative, error)
    class(operator_study_t), intent(in) :: study
    character(len=*), intent(in) :: name
    class(kernel_t), intent(in) :: kernel
    real(wp), intent(in) :: radius(:)
    type(neighbour_list_t), intent(in) :: list
    type(derivative_t), intent(inout) :: derivative
    type(error_t), allocatable, intent(out) :: error
    class(laplacian_scheme_t), allocatable :: scheme
    type(sparse_operator_t) :: laplacian
    type(row_report_t) :: report
    real(wp), allocatable :: grown(:)
    integer(ip), allocatable :: all_particles(:)
    integer :: k

    call make_laplacian_scheme(name, scheme, error, study%scene%order)
    if (allocated(error)) return
    associate (cloud => study%cloud)
      if (scheme%exact_degree() > paper_laplacian_degree) then
        grown = max(radius, natural_support(study%scene%order)*cloud%spacing)
        all_particles = [(int(k, ip), k=1, cloud%particles())]
        call assemble_sufficient_laplacian(scheme, kernel, cloud%x, cloud%y, cloud%volume, grown, &
                                           all_particles, laplacian, report)
      else
        call scheme%assemble(kernel, cloud%x, cloud%y, cloud%volume, radius, list, laplacian)
      end if
      derivative%name = 'laplacian_'//name
      allocate (derivative%values(cloud%particles(), 1))
    end associate
    call laplacian%apply(study%field, derivative%values(:, 1))
  end subroutine evaluate_laplacian

  !> Compare with the true derivatives, where the scene gives them.
  subroutine measure_errors(study, inside, whole, error)
    class(operator_study_t), intent(inout) :: study
    logical, intent(in) :: inside(:), whole(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: gradient(:, :), laplacian(:, :), column(:)
    character(len=:), allocatable :: place
    integer :: k, n

    n = study%cloud%particles()
    place = study%scene%path//': &operators'
    associate (asked => study%scene%operators)
      if (asked%exact_gradient_x /= '' .and. asked%exact_gradient_y /= '') then
        allocate (gradient(n, 2))
        call field_values(asked%exact_gradient_x, place, study%cloud, column, error)
        if (allocated(error)) return
        gradient(:, 1) = column
        call field_values(asked%exact_gradient_y, place, study%cloud, column, error)
        if (allocated(error)) return
        gradient(:, 2) = column
      end if
      if (asked%exact_laplacian /= '') then
        allocate (laplacian(n, 1))
        call field_values(asked%exact_laplacian, place, study%cloud, column, error)
        if (allocated(error)) return
        laplacian(:, 1) = column
      end if
    end associate
    do k = 1, size(study%derivatives)
      associate (derivative => study%derivatives(k))
        if (size(derivative%values, 2) == 2 .and. allocated(gradient)) then
          derivative%error_inside = relative_error(derivative%values, gradient, inside)
          derivative%error_whole = relative_error(derivative%values, gradient, whole)
        else if (size(derivative%values, 2) == 1 .and. allocated(laplacian)) then
          derivative%error_inside = relative_error(derivative%values, laplacian, inside)
          derivative%error_whole = relative_error(derivative%values, laplacian, whole)
        end if
      end associate
    end do
  end subroutine measure_errors

  !> ‖values - exact‖/‖exact‖ over some of the particles; absolute where the exact values vanish.
  pure function relative_error(values, exact, where_true) result(deviation)
    real(wp), intent(in) :: values(:, :), exact(:, :)
    logical, intent(in) :: where_true(:)
    real(wp) :: deviation
    logical :: mask(size(values, 1), size(values, 2))
    real(wp) :: norm

    mask = spread(where_true, 2, size(values, 2))
    deviation = sqrt(sum((values - exact)**2, mask))
    norm = sqrt(sum(exact**2, mask))
    if (norm > 0) deviation = deviation/norm
  end function relative_error

  subroutine write_study(this, error)
    class(operator_study_t), intent(in) :: this
    !> The file cannot be written
    type(error_t), allocatable, intent(out) :: error
    type(field_file_t) :: file
    integer, allocatable :: place(:)
    integer :: k

    if (this%scene%operators%file == '') return
    allocate (place(this%cloud%particles()))
    place(this%cloud%user_index) = [(k, k=1, this%cloud%particles())]
    call file%create(this%scene%operators%file, this%cloud%x(place), this%cloud%y(place), error)
    if (allocated(error)) return
    call write_fields(this, file, place, error)
    if (.not. allocated(error)) call file%close(error)
    if (allocated(error)) call file%discard()
  end subroutine write_study

  subroutine write_fields(study, file, place, error)
    class(operator_study_t), intent(in) :: study
    type(field_file_t), intent(inout) :: file
    !> Where each particle of the user's order is in the cloud's
    integer, intent(in) :: place(:)
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    call write_origin(file, study%scene, study%cloud, error)
    if (allocated(error)) return
    call file%begin_step(0.0_wp, error)
    if (allocated(error)) return
    call file%write_field('field', study%field(place), error)
    if (allocated(error)) return
    do k = 1, size(study%derivatives)
      associate (derivative => study%derivatives(k))
        if (size(derivative%values, 2) == 2) then
          call file%write_field(derivative%name, derivative%values(place, 1), &
                                derivative%values(place, 2), error)
        else
          call file%write_field(derivative%name, derivative%values(place, 1), error)
        end if
        if (allocated(error)) return
      end associate
    end do
  end subroutine write_fields

end module calor_operator_study
