!> From rows for ∇² to rows for div(K ∇), in a body that is not one constant isotropic material.
!>
!> Where the conductivity of one material varies smoothly, the row of any scheme serves: from
!> div(κ∇u) = [∇²(κu) + κ∇²u - u∇²κ]/2 follows Σ a_ij (κ_i + κ_j)/2 (u_j - u_i) + Σ b κ ∂u/∂n, as
!> exact as the row, and with positive weights where the row's are. Rows that reach into another
!> material are made anew by calor_flow_rows. So are rows where the conductivity is a tensor, unless
!> the paper's scheme serves there (calor_tensor_rows).
module calor_scene_materials
  use calor_cloud, only: cloud_t
  use calor_effect, only: effect_slot_t
  use calor_effect_melting, only: melting_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_expression, only: expression_t
  use calor_flow_rows, only: assemble_flow_rows, flow_rows_t
  use calor_heat_content, only: heat_content_t
  use calor_heat_law, only: heat_law_t
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, ip, i8
  use calor_laplacian_scheme, only: row_rule_t
  use calor_local_conductivity, only: local_conductivity_t
  use calor_material_flow, only: crossing_t, material_flow_t
  use calor_materials, only: materials_t, material_t, read_materials
  use calor_medium, only: medium_t
  use calor_potential_jumps, only: potential_jumps_t, contact_t
  use calor_row_quality, only: row_quality_t
  use calor_row_report, only: row_report_t
  use calor_scene_file, only: scene_file_t, group_t
  use calor_scene_getters, only: get_varying, raise_at
  use calor_sparse_operator, only: sparse_operator_t
  use calor_stable_rows, only: no_stencil
  use calor_tensor_rows, only: assemble_tensor_rows
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
    !> The largest radius, m, within which neighbours of a row made anew were looked for
    real(wp) :: widest = 0.0_wp
    !> Where interfaces are
    type(material_flow_t), private :: flow
    !> Between which materials that touch the potential jumps; not allocated: there are none such
    logical, allocatable, private :: jumps(:, :)
  contains
    !> Read the materials and look at them on a cloud
    procedure :: prepare
    !> Tell a medium what it consists of
    procedure :: describe
    !> Make rows for ∇² into rows for div(K ∇)
    procedure :: convert
    !> What the heat content is, where that is not the temperature
    procedure :: find_content
    !> What rows lack where potentials jump, and conductivities that are no products
    procedure :: find_jumps
    procedure :: find_local
    procedure, private :: has_local
    !> By how much a field's heat flux jumps across interfaces
    procedure :: flux_jump
    !> Whether a row has neighbours in another material
    procedure :: reaches_across
    !> Interfaces between constant materials as particles see them
    procedure :: see_interfaces
    procedure, private :: take_melting
    procedure, private :: compare_factors
    !> Whether rows depend on the material of the particles only, and on no place or direction
    procedure :: goes_with_particles
  end type scene_materials_t

contains

  subroutine prepare(this, file, cloud, temperature, error)
    class(scene_materials_t), intent(out) :: this
    !> The scene's groups
    type(scene_file_t), intent(in) :: file
    !> The cloud
    type(cloud_t), intent(in) :: cloud
    !> Temperatures at the start, on held walls too
    real(wp), intent(in) :: temperature(:)
    !> A material is wrong, or missing somewhere
    type(error_t), allocatable, intent(out) :: error
    integer, allocatable :: own(:), moved(:)
    real(wp), allocatable :: conductivity(:, :), capacity(:)
    integer :: k, i

    call read_materials(file, this%materials, error)
    if (allocated(error)) return
    this%in_force = allocated(this%materials%list)
    if (.not. this%in_force) return
    this%materials%reference = 0.5_wp*(minval(temperature) + maxval(temperature))
    call this%materials%fill(cloud%x, cloud%y, file%path, this%flow%material, this%conductivity, &
                             this%capacity, error)
    if (allocated(error)) return
    own = this%flow%material
    call this%flow%find_interfaces(this%materials, cloud%x, cloud%y, cloud%spacing)
    ! A particle on an interface may have changed sides.
    do k = 1, size(this%materials%list)
      moved = pack([(i, i=1, size(own))], this%flow%material == k .and. own /= k)
      if (size(moved) == 0) cycle
      allocate (conductivity(3, size(moved)), capacity(size(moved)))
      call this%materials%conductivity_at(k, cloud%x(moved), cloud%y(moved), conductivity)
      call this%materials%capacity_at(k, cloud%x(moved), cloud%y(moved), capacity)
      this%conductivity(:, moved) = conductivity
      this%capacity(moved) = capacity
      deallocate (conductivity, capacity)
    end do
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

  subroutine convert(this, cloud, kernel, degree, degree_across, rule, radius, first, normal, &
                     flux_is_given, operator, slope_weight, repair, quality, report, by_tensor)
    class(scene_materials_t), intent(inout) :: this
    !> The cloud and the kernel
    type(cloud_t), intent(in) :: cloud
    class(kernel_t), intent(in) :: kernel
    !> The degree of polynomials, that where rows reach into another material, and what is asked of
    !> a row
    integer, intent(in) :: degree, degree_across
    type(row_rule_t), intent(in) :: rule
    !> Support radii of all particles, m; those of rows made anew may grow
    real(wp), intent(inout) :: radius(:)
    !> Where the walls of each row begin in `normal`, one more at the end, and their outward normals
    integer, intent(in) :: first(:)
    real(wp), intent(in) :: normal(:, :)
    !> Whether the flux through these walls is given
    logical, intent(in) :: flux_is_given
    !> The rows
    type(sparse_operator_t), intent(inout) :: operator
    !> Their weights of fluxes on walls, 1/m
    real(wp), intent(inout) :: slope_weight(:)
    !> What is known of the rows
    integer, intent(inout) :: repair(:)
    type(row_quality_t), intent(inout) :: quality
    type(row_report_t), intent(inout) :: report
    !> Whether rows where the conductivity is a tensor are those of the paper's scheme if possible
    logical, intent(in) :: by_tensor
    logical, allocatable :: across(:), own(:)
    type(row_rule_t) :: rule_across
    integer :: k

    across = [(this%reaches_across(operator, k), k=1, operator%rows())]
    own = across
    do k = 1, operator%rows()
      associate (material => this%flow%material(operator%target(k)))
        if (.not. this%materials%list(material)%isotropic) own(k) = .true.
      end associate
    end do
    call scale_rows(operator, this%conductivity(1, :), own)
    if (any(across)) then
      radius(pack(operator%target, across)) = short_support*cloud%spacing
      if (degree_across > 2) rule_across%largest_ratio = rule%largest_ratio
      call make_anew(across, merge(degree_across, 2, all(this%materials%list%is_constant())), &
                     rule_across)
    end if
    own = own .and. .not. across
    if (any(own) .and. by_tensor) call take_tensor_rows(own)
    if (any(own)) call make_anew(own, degree, rule)

  contains

    !> Put rows of the paper's scheme into the place of some rows, which are not `chosen` any more.
    subroutine take_tensor_rows(chosen)
      logical, intent(inout) :: chosen(:)
      type(flow_rows_t) :: rows
      type(row_rule_t) :: own_rule
      integer, allocatable :: place(:)
      integer :: k

      own_rule = rule
      own_rule%largest_ratio = max(largest_ratio, rule%largest_ratio)
      place = pack([(k, k=1, size(chosen))], chosen)
      call assemble_tensor_rows(this%conductivity, own_rule, kernel, cloud%x, cloud%y, &
                                cloud%volume, radius, operator%target(place), rows)
      call put_in_place(place, rows)
      do k = 1, size(place)
        ! A support that has grown into another material is no good.
        chosen(place(k)) = rows%repair(k) == no_stencil .or. &
                           this%reaches_across(operator, place(k))
      end do
    end subroutine take_tensor_rows

    subroutine put_in_place(place, rows)
      integer, intent(in) :: place(:)
      type(flow_rows_t), intent(in) :: rows

      call replace_rows(operator, place, rows%operator)
      repair(place) = rows%repair
      quality%ratio(place) = rows%quality%ratio
      quality%residual(place) = rows%quality%residual
      quality%stiffness(place) = rows%quality%stiffness
      quality%neighbours(place) = rows%quality%neighbours
      report%condition_gradient(place) = rows%report%condition_gradient
      report%condition_laplacian(place) = rows%report%condition_laplacian
      report%residual(place) = rows%report%residual
    end subroutine put_in_place

    !> Put flow rows into the place of some rows.
    subroutine make_anew(chosen, own_degree, scheme_rule)
      logical, intent(in) :: chosen(:)
      integer, intent(in) :: own_degree
      type(row_rule_t), intent(in) :: scheme_rule
      type(flow_rows_t) :: rows
      type(row_rule_t) :: own_rule
      integer, allocatable :: place(:), own_first(:), wall(:)
      integer :: k, j

      own_rule = scheme_rule
      if (.not. all(this%materials%list%isotropic)) then
        own_rule%largest_ratio = max(largest_ratio, scheme_rule%largest_ratio)
      end if
      place = pack([(k, k=1, size(chosen))], chosen)
      allocate (own_first(size(place) + 1), wall(0))
      do k = 1, size(place)
        own_first(k) = size(wall) + 1
        wall = [wall, [(j, j=first(place(k)), first(place(k) + 1) - 1)]]
      end do
      own_first(size(place) + 1) = size(wall) + 1
      call this%flow%focus(this%materials, cloud%x, cloud%y, cloud%spacing, operator%target(place))
      call assemble_flow_rows(this%flow, own_degree, own_rule, kernel, cloud%x, cloud%y, &
                              cloud%volume, radius, operator%target(place), own_first, &
                              normal(:, wall), flux_is_given, rows)
      this%widest = max(this%widest, rows%widest)
      call put_in_place(place, rows)
      slope_weight(wall) = rows%slope_weight
    end subroutine make_anew

  end subroutine convert

  subroutine see_interfaces(this, cloud, particle, crossing, owner)
    class(scene_materials_t), intent(inout) :: this
    !> The cloud, and some of its particles
    type(cloud_t), intent(in) :: cloud
    integer(ip), intent(in) :: particle(:)
    !> The interfaces, none where a material is not constant
    type(crossing_t), allocatable, intent(out) :: crossing(:)
    !> Which of the particles sees each
    integer, allocatable, intent(out) :: owner(:)

    if (all(this%materials%list%is_constant())) then
      call this%flow%focus(this%materials, cloud%x, cloud%y, cloud%spacing, particle)
      call this%flow%crossings(crossing, owner)
    else
      allocate (crossing(0), owner(0))
    end if
  end subroutine see_interfaces

  !> The laws of heat contents; not allocated where those are the temperatures.
  subroutine find_content(this, file, cloud, effects, lowest, highest, content, error)
    class(scene_materials_t), intent(inout) :: this
    !> The scene's groups, and the cloud
    type(scene_file_t), intent(in) :: file
    type(cloud_t), intent(in) :: cloud
    !> The effects in force; those that melt get to know their rise
    type(effect_slot_t), allocatable, intent(inout) :: effects(:)
    !> Range of temperatures that may occur
    real(wp), intent(in) :: lowest, highest
    !> The laws
    type(heat_content_t), allocatable, intent(out) :: content
    !> They cannot be had
    type(error_t), allocatable, intent(out) :: error
    type(heat_content_t) :: found
    integer :: k

    allocate (found%law(max(1, file%count('material'))))
    if (this%in_force) then
      call this%materials%check_range(cloud%x, cloud%y, this%flow%material, lowest, highest, error)
      if (allocated(error)) return
      do k = 1, size(found%law)
        call take_material(this%materials%list(k), this%materials%reference, found%law(k))
        associate (one => findloc(this%flow%material, k, dim=1))
          if (one == 0) cycle
          found%law(k)%x = cloud%x(one)
          found%law(k)%y = cloud%y(one)
        end associate
      end do
      if (size(found%law) > 1) found%law_of = this%flow%material
    end if
    if (allocated(effects)) then
      do k = 1, size(effects)
        select type (effect => effects(k)%effect)
        type is (melting_t)
          call this%take_melting(file, cloud, effect, found, error)
          if (allocated(error)) return
        class default
          cycle
        end select
      end do
    end if
    if (.not. (any(found%law%melts .or. found%law%stores .or. found%law%conducts) .or. &
               this%has_local())) return
    call found%prepare(lowest, highest)
    if (this%in_force) call this%compare_factors(found, lowest, highest, error)
    if (.not. allocated(error)) content = found
  end subroutine find_content

  !> Whether any conductivity is no product.
  pure function has_local(this) result(answer)
    class(scene_materials_t), intent(in) :: this
    logical :: answer

    answer = .false.
    if (this%in_force) answer = any(.not. this%materials%list%is_product)
  end function has_local

  subroutine find_jumps(this, content, cloud, operator, by_particle, lowest, highest, jumps)
    class(scene_materials_t), intent(in) :: this
    !> The laws
    type(heat_content_t), intent(in) :: content
    !> The cloud, and rows on it
    type(cloud_t), intent(in) :: cloud
    type(sparse_operator_t), intent(in) :: operator
    !> Whether results stand at the particles' places, not at the rows'
    logical, intent(in) :: by_particle
    !> Range of temperatures that may occur
    real(wp), intent(in) :: lowest, highest
    !> What the rows lack; not allocated: nothing
    type(potential_jumps_t), allocatable, intent(out) :: jumps
    type(contact_t) :: contact
    integer :: row, other

    if (.not. allocated(this%jumps)) return
    allocate (jumps)
    call jumps%prepare(content%law, lowest, highest)
    do row = 1, operator%rows()
      if (.not. this%reaches_across(operator, row)) cycle
      associate (i => operator%target(row), from => operator%first(row), &
                 to => operator%first(row + 1) - 1)
        do other = 1, size(this%jumps, 2)
          if (.not. this%jumps(this%flow%material(i), other)) cycle
          if (all(this%flow%material(operator%index(from:to)) /= other)) cycle
          call this%flow%contact_at(this%materials, cloud%x, cloud%y, cloud%spacing, i, other, &
                                    contact)
          call jumps%add_row(operator, row, merge(int(i), row, by_particle), contact, &
                             this%flow%material, cloud%x, cloud%y)
        end do
      end associate
    end do
    if (jumps%is_empty()) deallocate (jumps)
  end subroutine find_jumps

  subroutine find_local(this, cloud, lowest, highest, local)
    class(scene_materials_t), intent(in) :: this
    !> The cloud
    type(cloud_t), intent(in) :: cloud
    !> Range of temperatures that may occur
    real(wp), intent(in) :: lowest, highest
    !> Conductivities that are no products; not allocated: there are none
    type(local_conductivity_t), allocatable, intent(out) :: local
    integer, allocatable :: member(:)
    integer :: k, i

    if (.not. this%has_local()) return
    allocate (local)
    call local%prepare(cloud%particles(), this%materials%reference, lowest, highest)
    do k = 1, size(this%materials%list)
      if (this%materials%list(k)%is_product) cycle
      member = pack([(i, i=1, cloud%particles())], this%flow%material == k)
      call local%add_material(this%materials%list(k)%conductivity(1), member, cloud%x(member), &
                              cloud%y(member))
    end do
  end subroutine find_local

  !> What of a material depends on the temperature
  pure subroutine take_material(material, reference, law)
    type(material_t), intent(in) :: material
    real(wp), intent(in) :: reference
    type(heat_law_t), intent(inout) :: law

    law%conducts = material%conducts_by_temperature .and. material%is_product
    law%stores = material%stores_by_temperature
    law%conductivity = material%conductivity(1)
    law%density = material%density
    law%heat_capacity = material%heat_capacity
    law%reference = reference
  end subroutine take_material

  !> What melting makes of it: latent heat over the heat capacity at the reference temperature
  subroutine take_melting(this, file, cloud, melting, content, error)
    class(scene_materials_t), intent(in) :: this
    type(scene_file_t), intent(in) :: file
    type(cloud_t), intent(in) :: cloud
    type(melting_t), intent(inout) :: melting
    type(heat_content_t), intent(inout) :: content
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group
    type(expression_t) :: expression
    real(wp), allocatable :: heat_capacity(:)
    logical, allocatable :: member(:)

    call file%group('material', group, melting%material)
    call get_varying(group, 'heat_capacity', expression, error, 1.0_wp)
    if (allocated(error)) return
    associate (law => content%law(melting%material))
      law%melts = .true.
      law%solidus = melting%solidus
      law%liquidus = melting%liquidus
      allocate (heat_capacity(cloud%particles()))
      call expression%evaluate(cloud%x, cloud%y, 0.0_wp, heat_capacity, &
                               spread(this%materials%reference, 1, cloud%particles()))
      allocate (member(cloud%particles()), source=.true.)
      if (allocated(content%law_of)) member = content%law_of == melting%material
      ! A material that is nowhere melts nowhere.
      if (.not. any(member)) return
      melting%rise = melting%latent_heat/minval(heat_capacity, member)
      law%rise = melting%rise
      if (expression%uses('x') .or. expression%uses('y')) then
        if (.not. allocated(content%rise)) then
          allocate (content%rise(cloud%particles()), source=0.0_wp)
          if (allocated(content%law_of)) content%rise = content%law(content%law_of)%rise
        end if
      end if
      if (.not. allocated(content%rise)) return
      where (member) content%rise = melting%latent_heat/heat_capacity
    end associate
  end subroutine take_melting

  !> Potentials are continuous at an interface only if the factors are the same on both sides.
  subroutine compare_factors(this, content, lowest, highest, error)
    class(scene_materials_t), intent(inout) :: this
    type(heat_content_t), intent(in) :: content
    real(wp), intent(in) :: lowest, highest
    type(error_t), allocatable, intent(out) :: error
    integer, parameter :: temperatures = 17
    real(wp), parameter :: rounding = 1.0e-9_wp
    real(wp) :: f, other, unused
    logical :: same
    integer :: k, j, step

    do k = 2, size(content%law)
      do j = 1, k - 1
        if (.not. this%flow%touch(j, k)) cycle
        associate (one => this%materials%list(k), two => this%materials%list(j))
          if (.not. (one%is_product .and. two%is_product)) then
            call raise(error, status_bad_input, one%place//', '//two%place//': where materials '// &
                       'touch, how a conductivity depends on T must be the same everywhere in '// &
                       'each: write it as a function of x and y times a function of T.')
            return
          end if
          same = .true.
          do step = 0, temperatures - 1
            associate (t => lowest + (highest - lowest)*step/(temperatures - 1))
              call content%law(k)%factors(t, f, unused)
              call content%law(j)%factors(t, other, unused)
            end associate
            same = same .and. abs(f - other) <= rounding*f
          end do
          if (same) cycle
          if (.not. (one%isotropic .and. two%isotropic)) then
            call raise(error, status_bad_input, one%place//', '//two%place//': materials that '// &
                       'touch must depend on T by the same factor, as 1+T/100 and 20*(1+T/100) '// &
                       'do, where one of them conducts differently in different directions; '// &
                       'give both that factor, or leave T out of both.')
            return
          end if
        end associate
        if (.not. allocated(this%jumps)) then
          allocate (this%jumps(size(content%law), size(content%law)), source=.false.)
        end if
        this%jumps(j, k) = .true.
        this%jumps(k, j) = .true.
      end do
    end do
  end subroutine compare_factors

  pure function reaches_across(this, operator, row) result(answer)
    class(scene_materials_t), intent(in) :: this
    type(sparse_operator_t), intent(in) :: operator
    integer, intent(in) :: row
    logical :: answer

    answer = any(this%flow%material(operator%index(operator%first(row):operator%first(row + 1) - &
                                                   1)) /= this%flow%material(operator%target(row)))
  end function reaches_across

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

  !> The largest jump of a temperature's heat flux, as a part of the largest flux through
  !> interfaces. 0 where conductivities follow the temperature, as what conducts there is another
  !> matter.
  function flux_jump(this, field, cloud) result(part)
    class(scene_materials_t), intent(in) :: this
    !> The temperature, K
    type(expression_t), intent(in) :: field
    !> The cloud
    type(cloud_t), intent(in) :: cloud
    real(wp) :: part

    part = 0
    if (.not. this%in_force) return
    if (.not. all(this%materials%list%is_constant())) return
    part = this%flow%flux_jump(this%materials, field, cloud%x, cloud%y, cloud%spacing)
  end function flux_jump

end module calor_scene_materials
