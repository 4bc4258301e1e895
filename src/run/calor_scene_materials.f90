!> From rows for ∇² to rows for div(K ∇), in a body that is not one constant isotropic material.
!>
!> Where the conductivity of one material varies smoothly, the row of any scheme serves: from
!> div(κ∇u) = [∇²(κu) + κ∇²u - u∇²κ]/2 follows Σ a_ij (κ_i + κ_j)/2 (u_j - u_i) + Σ b κ ∂u/∂n, as
!> exact as the row, and with positive weights where the row's are. Rows that reach into another
!> material, and rows in a body that conducts differently in different directions, are made anew by
!> calor_flow_rows.
module calor_scene_materials
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t
  use calor_flow_rows, only: assemble_flow_rows, flow_rows_t
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, ip, i8
  use calor_laplacian_scheme, only: row_rule_t
  use calor_material_flow, only: material_flow_t
  use calor_materials, only: materials_t, read_materials
  use calor_medium, only: medium_t
  use calor_row_quality, only: row_quality_t
  use calor_row_report, only: row_report_t
  use calor_scene_file, only: scene_file_t
  use calor_sparse_operator, only: sparse_operator_t
  implicit none (type, external)
  private

  public :: scene_materials_t

  !> Rows of a body that conducts differently in different directions may have weights so negative
  real(wp), parameter :: largest_ratio = 2.0_wp

  !> The support radius of rows that reach beyond an interface, in spacings
  real(wp), parameter :: short_support = 2.1_wp

  !> The materials of a scene on its cloud
  type :: scene_materials_t
    !> Whether there is more than one constant isotropic material; all that follows is set then only
    logical :: in_force = .false.
    type(materials_t) :: materials
    !> κxx, κyy, κxy, W/(m K), a column for each particle
    real(wp), allocatable :: conductivity(:, :)
    !> Density times heat capacity, J/(m³ K)
    real(wp), allocatable :: capacity(:)
    !> Where interfaces are
    type(material_flow_t), private :: flow
  contains
    !> Read the materials and look at them on a cloud
    procedure :: prepare
    !> Tell a medium what it consists of
    procedure :: describe
    !> Make rows for ∇² into rows for div(K ∇)
    procedure :: convert
    !> Whether rows depend on the material of the particles only, and on no place or direction
    procedure :: goes_with_particles
    procedure, private :: needs_own_rows
  end type scene_materials_t

contains

  subroutine prepare(this, file, cloud, error)
    class(scene_materials_t), intent(out) :: this
    !> The scene's groups
    type(scene_file_t), intent(in) :: file
    !> The cloud
    type(cloud_t), intent(in) :: cloud
    !> A material is wrong, or missing somewhere
    type(error_t), allocatable, intent(out) :: error

    call read_materials(file, this%materials, error)
    if (allocated(error)) return
    this%in_force = allocated(this%materials%list)
    if (.not. this%in_force) return
    call this%materials%fill(cloud%x, cloud%y, file%path, this%flow%material, this%conductivity, &
                             this%capacity, error)
    if (allocated(error)) return
    call this%flow%find_interfaces(this%materials, cloud%x, cloud%y, cloud%spacing)
  end subroutine prepare

  !> Effects get to know the capacity at each particle, and for their estimates the least
  !> conductivity.
  subroutine describe(this, medium)
    class(scene_materials_t), intent(in) :: this
    !> The medium
    type(medium_t), intent(inout) :: medium

    medium%local_capacity = this%capacity
    medium%capacity = minval(this%capacity)
    medium%conductivity = minval(this%conductivity(1:2, :))
  end subroutine describe

  subroutine convert(this, cloud, kernel, degree, rule, radius, first, normal, operator, &
                     slope_weight, repair, quality, report)
    class(scene_materials_t), intent(inout) :: this
    !> The cloud and the kernel
    type(cloud_t), intent(in) :: cloud
    class(kernel_t), intent(in) :: kernel
    !> The degree of polynomials, and what is asked of a row
    integer, intent(in) :: degree
    type(row_rule_t), intent(in) :: rule
    !> Support radii of all particles, m; those of rows made anew may grow
    real(wp), intent(inout) :: radius(:)
    !> Where the walls of each row begin in `normal`, one more at the end, and their outward normals
    integer, intent(in) :: first(:)
    real(wp), intent(in) :: normal(:, :)
    !> The rows
    type(sparse_operator_t), intent(inout) :: operator
    !> Their weights of fluxes on walls, 1/m
    real(wp), intent(inout) :: slope_weight(:)
    !> What is known of the rows
    integer, intent(inout) :: repair(:)
    type(row_quality_t), intent(inout) :: quality
    type(row_report_t), intent(inout) :: report
    type(flow_rows_t) :: rows
    type(row_rule_t) :: own_rule
    logical, allocatable :: chosen(:)
    integer, allocatable :: place(:), own_first(:), wall(:)
    integer :: k, own_degree, j

    chosen = [(this%needs_own_rows(operator, k), k=1, operator%rows())]
    call scale_rows(operator, this%conductivity(1, :), chosen)
    if (.not. any(chosen)) return
    place = pack([(k, k=1, size(chosen))], chosen)
    allocate (own_first(size(place) + 1), wall(0))
    do k = 1, size(place)
      own_first(k) = size(wall) + 1
      wall = [wall, [(j, j=first(place(k)), first(place(k) + 1) - 1)]]
    end do
    own_first(size(place) + 1) = size(wall) + 1
    call this%flow%focus(this%materials, cloud%x, cloud%y, cloud%spacing, operator%target(place))
    own_rule = rule
    own_degree = degree
    if (size(this%materials%list) > 1) then
      ! Functions are continued beyond an interface up to degree 2, which needs a few neighbours.
      own_degree = 2
      own_rule = row_rule_t()
      radius(operator%target(place)) = short_support*cloud%spacing
    else
      own_rule%largest_ratio = max(largest_ratio, rule%largest_ratio)
    end if
    call assemble_flow_rows(this%flow, own_degree, own_rule, kernel, cloud%x, cloud%y, &
                            cloud%volume, radius, operator%target(place), own_first, &
                            normal(:, wall), rows)
    call replace_rows(operator, place, rows%operator)
    slope_weight(wall) = rows%slope_weight
    repair(place) = rows%repair
    quality%ratio(place) = rows%quality%ratio
    quality%residual(place) = rows%quality%residual
    quality%stiffness(place) = rows%quality%stiffness
    quality%neighbours(place) = rows%quality%neighbours
    report%condition_gradient(place) = 0
    report%condition_laplacian(place) = 0
    report%residual(place) = rows%report%residual
  end subroutine convert

  pure function needs_own_rows(this, operator, row) result(answer)
    class(scene_materials_t), intent(in) :: this
    type(sparse_operator_t), intent(in) :: operator
    integer, intent(in) :: row
    logical :: answer

    associate (own => this%flow%material(operator%target(row)))
      answer = .not. this%materials%list(own)%isotropic .or. &
               any(this%flow%material(operator%index(operator%first(row): &
                                                     operator%first(row + 1) - 1)) /= own)
    end associate
  end function needs_own_rows

  !> Interfaces have places, and a tensor has directions.
  pure function goes_with_particles(this) result(answer)
    class(scene_materials_t), intent(in) :: this
    logical :: answer

    answer = size(this%materials%list) == 1
    if (answer) answer = this%materials%list(1)%isotropic
  end function goes_with_particles

  !> a_ij ← a_ij (κ_i + κ_j)/2
  pure subroutine scale_rows(operator, conductivity, left_out)
    type(sparse_operator_t), intent(inout) :: operator
    real(wp), intent(in) :: conductivity(:)
    logical, intent(in) :: left_out(:)
    integer :: row

    do row = 1, operator%rows()
      if (left_out(row)) cycle
      associate (from => operator%first(row), to => operator%first(row + 1) - 1, &
                 own => conductivity(operator%target(row)))
        operator%weight(from:to) = operator%weight(from:to)* &
                                   (0.5_wp*(own + conductivity(operator%index(from:to))))
        operator%diagonal(row) = -sum(operator%weight(from:to))
      end associate
    end do
  end subroutine scale_rows

  !> Put rows into the place of others.
  subroutine replace_rows(operator, place, rows)
    type(sparse_operator_t), intent(inout) :: operator
    integer, intent(in) :: place(:)
    type(sparse_operator_t), intent(in) :: rows
    type(sparse_operator_t) :: merged
    integer, allocatable :: source(:)
    integer(i8) :: length, from, to
    integer :: k

    source = [(0, k=1, operator%rows())]
    source(place) = [(k, k=1, size(place))]
    merged%target = operator%target
    merged%diagonal = operator%diagonal
    merged%diagonal(place) = rows%diagonal
    allocate (merged%first(size(source) + 1))
    merged%first(1) = 1
    do k = 1, size(source)
      length = operator%first(k + 1) - operator%first(k)
      if (source(k) > 0) length = rows%first(source(k) + 1) - rows%first(source(k))
      merged%first(k + 1) = merged%first(k) + length
    end do
    allocate (merged%index(merged%first(size(source) + 1) - 1))
    allocate (merged%weight(size(merged%index)))
    do k = 1, size(source)
      from = merged%first(k)
      to = merged%first(k + 1) - 1
      if (source(k) > 0) then
        associate (a => rows%first(source(k)), b => rows%first(source(k) + 1) - 1)
          merged%index(from:to) = rows%index(a:b)
          merged%weight(from:to) = rows%weight(a:b)
        end associate
      else
        associate (a => operator%first(k), b => operator%first(k + 1) - 1)
          merged%index(from:to) = operator%index(a:b)
          merged%weight(from:to) = operator%weight(a:b)
        end associate
      end if
    end do
    operator = merged
  end subroutine replace_rows

end module calor_scene_materials
