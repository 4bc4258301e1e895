!> From a scene and its cloud to the heat equation on it, for any scheme.
!>
!> The same scene may be made into evolutions of several schemes side by side.
module calor_scene_evolution
  use calor_cloud, only: cloud_t
  use calor_conduction, only: conduction_t
  use calor_effect, only: effect_slot_t
  use calor_effects, only: called_effects, enter
  use calor_error, only: error_t, raise, status_bad_input
  use calor_heat_content, only: heat_content_t
  use calor_interface_balance, only: balance_interfaces
  use calor_kernel, only: kernel_t
  use calor_kernels, only: make_kernel
  use calor_kinds, only: wp, ip
  use calor_laplacian_scheme, only: laplacian_scheme_t
  use calor_laplacian_schemes, only: make_laplacian_scheme
  use calor_medium, only: medium_t
  use calor_neighbour_list, only: neighbour_list_t
  use calor_row_quality, only: measure_rows
  use calor_row_report, only: row_report_t
  use calor_scene, only: scene_t
  use calor_scene_cloud, only: require_neighbours
  use calor_scene_materials, only: scene_materials_t
  use calor_scene_walls, only: find_contacts, hold_walls
  use calor_skin_list, only: skin_list_t, find_neighbours
  use calor_sparse_operator, only: sparse_operator_t
  use calor_stable_rows, only: assemble_stable_rows, row_repairs_t, as_written
  use calor_stopwatch, only: stopwatch_t
  use calor_wall_rows, only: assemble_wall_rows, wall_rows_t
  implicit none (type, external)
  private

  public :: make_scene_evolution, method_t, row_maker_t, scene_method, scene_rows_t

  !> How derivatives are approximated
  type :: method_t
    !> Name of the Laplacian scheme, and its order if it has several
    character(len=:), allocatable :: laplacian
    integer :: order = 0
    !> Whether its rows tell the error of others
    logical :: judges = .false.
    !> Support radius in spacings
    real(wp) :: support = 0.0_wp
  end type method_t

  !> What is known of an evolution's rows, in the order of the Laplacian's targets
  type :: scene_rows_t
    !> Condition of the renormalization tensors
    type(row_report_t) :: report
    !> Quality of the rows, and what was repaired
    type(row_repairs_t) :: repairs
    !> Support radius of each particle, m
    real(wp), allocatable :: radius(:)
    !> The largest radius, m, within which neighbours were looked for
    real(wp) :: widest = 0.0_wp
  end type scene_rows_t

  !> What it takes to assemble the rows of a scene, for the places where its particles are
  type :: row_maker_t
    type(method_t) :: method
    class(kernel_t), allocatable :: kernel
    class(laplacian_scheme_t), allocatable :: scheme
    type(scene_materials_t) :: materials
  contains
    !> The Laplacian's rows at all particles that are not held, and rows at held ones
    procedure :: assemble
  end type row_maker_t

contains

  !> The method that a scene asks for.
  pure function scene_method(scene) result(method)
    !> The scene
    type(scene_t), intent(in) :: scene
    type(method_t) :: method

    method%laplacian = scene%laplacian
    method%order = scene%order
    method%support = scene%support
  end function scene_method

  !> Make the heat equation of a scene: held walls, effects, and the rows of the Laplacian.
  subroutine make_scene_evolution(scene, cloud, method, temperature, conduction, rows, error, &
                                  stopwatch, further, maker)
    !> The scene
    type(scene_t), intent(in) :: scene
    !> Its cloud
    type(cloud_t), intent(in) :: cloud
    !> The Laplacian to use
    type(method_t), intent(in) :: method
    !> The temperatures at the start; those of held particles are set
    real(wp), intent(inout) :: temperature(:)
    !> The heat equation on the cloud, of which nothing is known yet
    class(conduction_t), intent(inout) :: conduction
    !> What is known of its rows
    type(scene_rows_t), intent(out) :: rows
    !> The scene cannot be simulated
    type(error_t), allocatable, intent(out) :: error
    !> Is told which phase of the work runs
    type(stopwatch_t), intent(inout), optional :: stopwatch
    !> Effects beside those that the scene calls for; copied
    type(effect_slot_t), intent(in), optional :: further(:)
    !> What makes its rows, should they be made again
    type(row_maker_t), intent(out), optional :: maker
    type(effect_slot_t), allocatable :: effects(:)
    type(row_maker_t) :: own
    type(heat_content_t), allocatable :: content
    real(wp) :: lowest, highest
    integer :: k

    call describe_medium(scene, cloud, conduction%medium)
    call find_contacts(scene, cloud, conduction%medium%contacts, error)
    if (.not. allocated(error)) then
      call hold_walls(scene, cloud, conduction%medium%contacts, conduction%prescribed, error)
    end if
    call conduction%agree(error)
    if (allocated(error)) return
    conduction%user_index = cloud%user_index
    conduction%single_weights = scene%single_weights
    call conduction%note_range(temperature)
    call conduction%impose(0.0_wp, temperature)
    lowest = minval(temperature)
    highest = maxval(temperature)
    call conduction%span(lowest, highest)
    call own%materials%prepare(scene%file, cloud, [lowest, highest], error)
    call conduction%agree(error)
    if (allocated(error)) return
    associate (material => scene%material)
      conduction%diffusivity = material%conductivity/(material%density*material%heat_capacity)
    end associate
    if (own%materials%in_force) then
      call own%materials%describe(conduction%medium)
      highest = 0
      call conduction%span(conduction%medium%capacity, highest)
      call conduction%span(conduction%medium%conductivity, highest)
      conduction%diffusivity = 1
    end if
    own%method = method
    call make_kernel(scene%kernel, own%kernel, error)
    if (allocated(error)) return
    call make_laplacian_scheme(method%laplacian, own%scheme, error, method%order)
    if (allocated(error)) return
    call own%assemble(scene, cloud, conduction, rows, error, stopwatch)
    call conduction%agree(error)
    if (allocated(error)) return
    if (present(maker)) maker = own

    call called_effects(scene%file, effects, error)
    if (allocated(error)) return
    if (present(further)) then
      do k = 1, size(further)
        call enter(effects, further(k)%effect)
      end do
    end if
    call conduction%put_in_force(effects, temperature, error)
    call conduction%agree(error)
    if (allocated(error)) return
    if (own%materials%in_force .or. allocated(conduction%effects)) then
      call conduction%expected_range(lowest, highest)
      call own%materials%find_content(scene%file, cloud, conduction%effects, lowest, highest, &
                                      content, error)
      call conduction%agree(error)
      if (allocated(error)) return
      if (allocated(content)) then
        call conduction%use_content(content, temperature)
        call own%materials%find_local(cloud, lowest, highest, conduction%local)
        call own%materials%find_jumps(content, cloud, conduction%laplacian, .true., lowest, &
                                      highest, conduction%jumps)
        call own%materials%find_jumps(content, cloud, conduction%held_rows, .false., lowest, &
                                      highest, conduction%held_jumps)
      end if
    end if
    call conduction%assume_stiffest()
  end subroutine make_scene_evolution

  !> What effects get to see.
  subroutine describe_medium(scene, cloud, medium)
    type(scene_t), intent(in) :: scene
    type(cloud_t), intent(in) :: cloud
    type(medium_t), intent(out) :: medium

    medium%x = cloud%x
    medium%y = cloud%y
    medium%area = cloud%area
    medium%capacity = scene%material%density*scene%material%heat_capacity
    medium%conductivity = scene%material%conductivity
    medium%duration = scene%time%end
    medium%in_motion = scene%motion%in_force
    medium%is_part = cloud%is_part
    medium%extent = cloud%extent
  end subroutine describe_medium

  subroutine assemble(this, scene, cloud, conduction, rows, error, stopwatch, skin_list)
    class(row_maker_t), intent(inout) :: this
    !> The scene
    type(scene_t), intent(in) :: scene
    !> Its cloud, as it is now
    type(cloud_t), intent(in) :: cloud
    !> The heat equation, which gets the rows; its contacts must be known
    class(conduction_t), intent(inout) :: conduction
    !> What is known of the rows
    type(scene_rows_t), intent(out) :: rows
    !> A particle has no neighbours, or walls have no normals where they are needed
    type(error_t), allocatable, intent(out) :: error
    !> Is told which phase of the work runs
    type(stopwatch_t), intent(inout), optional :: stopwatch
    !> Where neighbours are looked up first
    type(skin_list_t), intent(in), optional :: skin_list
    type(neighbour_list_t) :: list
    integer(ip), allocatable :: free(:)
    integer :: k

    free = pack([(int(k, ip), k=1, cloud%particles())], cloud%side == 0 .and. &
                cloud%owns([(k, k=1, cloud%particles())]))
    allocate (rows%radius(cloud%particles()), source=this%method%support*cloud%spacing)
    associate (laplacian => conduction%laplacian, scheme => this%scheme, kernel => this%kernel)
      if (scene%support_growth) then
        if (present(stopwatch)) call stopwatch%start('assembly')
        call assemble_stable_rows(scheme, kernel, cloud%x, cloud%y, cloud%volume, rows%radius, &
                                  free, laplacian, rows%report, rows%repairs, skin_list)
      else
        if (present(stopwatch)) call stopwatch%start('neighbours')
        call find_neighbours(cloud%x, cloud%y, rows%radius(free), list, free, skin_list)
        call require_neighbours(scene, cloud, list, error)
        if (allocated(error)) return
        if (present(stopwatch)) call stopwatch%start('assembly')
        call scheme%assemble(kernel, cloud%x, cloud%y, cloud%volume, rows%radius, list, laplacian, &
                             rows%report)
        call measure_rows(laplacian, cloud%x, cloud%y, rows%radius, scheme%exact_degree(), &
                          rows%repairs%quality)
        allocate (rows%repairs%repair(size(free)), source=as_written)
      end if
    end associate
    rows%widest = rows%repairs%widest
    if (this%materials%in_force) call convert_inner_rows(this%scheme)
    call add_wall_rows(this%scheme)
    if (allocated(error)) return
    if (this%materials%in_force) then
      call divide_by_capacity(this%materials%capacity, conduction%laplacian)
      if (across_degree(this%method) == 2) then
        call balance_interfaces(conduction, cloud%area, &
                                [(this%materials%reaches_across(conduction%laplacian, k), &
                                  k=1, conduction%laplacian%rows())])
      end if
    end if
    rows%widest = max(rows%widest, this%materials%widest)
    call conduction%stream_rows()

  contains

    !> From ∇² to div(K ∇) at particles inside
    subroutine convert_inner_rows(scheme)
      class(laplacian_scheme_t), intent(in) :: scheme
      real(wp) :: no_normal(2, 0), no_weight(0)

      call this%materials%convert(cloud, this%kernel, max(2, scheme%exact_degree()), &
                                  across_degree(this%method), scheme%rule(), rows%radius, &
                                  [(1, k=0, size(free))], no_normal, .true., &
                                  conduction%laplacian, no_weight, rows%repairs%repair, &
                                  rows%repairs%quality, rows%report, &
                                  by_tensor=this%method%laplacian == 'fatehi_manzari')
    end subroutine convert_inner_rows

    !> Rows at particles on walls: those that are not held come after those of particles inside;
    !> those that are held serve the heat budget only.
    subroutine add_wall_rows(scheme)
      class(laplacian_scheme_t), intent(in) :: scheme
      type(wall_rows_t) :: walls
      real(wp), allocatable :: open(:), aside(:)
      integer :: j

      associate (contacts => conduction%medium%contacts)
        allocate (open(cloud%particles()), source=1.0_wp)
        call conduction%clear_prescribed(open)
        contacts%held = open(contacts%particle) < 0.5_wp
        if (.not. allocated(contacts%normal)) then
          if (all(contacts%held)) return
          call raise(error, status_bad_input, scene%path//': the walls of a cloud from a file '// &
                     'have no normals, so only temperatures can be given there: take kind = '// &
                     '''temperature'' in every &boundary.')
          return
        end if
        aside = rows%radius
        ! Nobody asks for the budget of what only tells the error of another.
        call rows_at(pack([(j, j=1, size(contacts%held))], contacts%held .and. &
                          cloud%owns(contacts%particle) .and. .not. this%method%judges), &
                     scheme, aside, walls)
        conduction%held_rows = walls%laplacian
        call rows_at(pack([(j, j=1, size(contacts%held))], .not. contacts%held .and. &
                          cloud%owns(contacts%particle)), scheme, rows%radius, walls)
        rows%widest = max(rows%widest, walls%widest)
        if (walls%laplacian%rows() == 0) return
        call conduction%laplacian%append(walls%laplacian)
        rows%repairs%repair = [rows%repairs%repair, walls%repair]
        call rows%repairs%quality%append(walls%quality)
        call rows%report%append(walls%report)
      end associate
    end subroutine add_wall_rows

    !> Rows at the particles of some contacts, whose weights are set.
    subroutine rows_at(chosen, scheme, radius, walls)
      integer, intent(in) :: chosen(:)
      class(laplacian_scheme_t), intent(in) :: scheme
      real(wp), intent(inout) :: radius(:)
      type(wall_rows_t), intent(out) :: walls
      integer, allocatable :: first(:)
      integer(ip), allocatable :: particles(:)
      logical, allocatable :: begins(:)
      integer :: j

      associate (contacts => conduction%medium%contacts)
        ! The contacts of a particle stand together.
        allocate (begins(size(chosen)), source=.true.)
        do j = 2, size(chosen)
          begins(j) = contacts%particle(chosen(j)) /= contacts%particle(chosen(j - 1))
        end do
        first = pack([(j, j=1, size(chosen))], begins)
        particles = contacts%particle(chosen(first))
        first = [first, size(chosen) + 1]
        call assemble_wall_rows(wall_degree(scheme), scheme%rule(), this%kernel, cloud%x, cloud%y, &
                                cloud%volume, radius, particles, first, &
                                contacts%normal(:, chosen), walls, skin_list)
        if (this%materials%in_force) then
          call this%materials%convert(cloud, this%kernel, wall_degree(scheme), &
                                      across_degree(this%method), scheme%rule(), radius, first, &
                                      contacts%normal(:, chosen), &
                                      .not. any(contacts%held(chosen)), walls%laplacian, &
                                      walls%slope_weight, walls%repair, walls%quality, &
                                      walls%report, by_tensor=.false.)
        end if
        contacts%weight(chosen) = walls%slope_weight
      end associate
    end subroutine rows_at

  end subroutine assemble

  !> From div(K ∇) to the rate of the temperature
  pure subroutine divide_by_capacity(capacity, operator)
    real(wp), intent(in) :: capacity(:)
    type(sparse_operator_t), intent(inout) :: operator
    integer :: row

    do row = 1, operator%rows()
      associate (from => operator%first(row), to => operator%first(row + 1) - 1, &
                 own => capacity(operator%target(row)))
        operator%weight(from:to) = operator%weight(from:to)/own
        operator%diagonal(row) = operator%diagonal(row)/own
      end associate
    end do
  end subroutine divide_by_capacity

  !> The degree of polynomials that rows at walls reproduce. A row there counts for a wall only, not
  !> for an area, so that what it misses enters the solution with one power of the spacing more
  !> than what rows inside miss: degree p is enough for order p.
  pure function wall_degree(scheme) result(degree)
    class(laplacian_scheme_t), intent(in) :: scheme
    integer :: degree

    degree = max(2, scheme%exact_degree() - 1)
    if (scheme%exact_degree() <= 2) degree = 2
  end function wall_degree

  !> The degree of polynomials that rows across interfaces between constant materials reproduce: for
  !> order p degree p, as at walls, and one more in rows that tell the error of such. Those of
  !> degree 2 are scaled so that heat stays; factors would spoil what is exact beyond that.
  pure function across_degree(method) result(degree)
    type(method_t), intent(in) :: method
    integer :: degree

    degree = 2
    if (method%laplacian == 'consistent') degree = max(2, method%order)
    if (method%judges) degree = degree + 1
  end function across_degree

end module calor_scene_evolution
