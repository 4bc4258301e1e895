!> From a scene file to a scene.
module calor_scene_reader
  use calor_arrangements, only: arrangement_choices
  use calor_body, only: body_t
  use calor_choice, only: choice_t
  use calor_effect, only: effect_slot_t
  use calor_effects, only: called_effects
  use calor_error, only: error_t, raise, status_bad_input
  use calor_expression, only: expression_t
  use calor_gradient_schemes, only: gradient_choices
  use calor_integrators, only: integrator_choices
  use calor_kernels, only: kernel_choices
  use calor_kinds, only: wp
  use calor_laplacian_schemes, only: laplacian_choices, usual_support
  use calor_materials, only: materials_t, read_materials
  use calor_scene, only: scene_t, domain_t, boundary_t, uniform_material_t
  use calor_scene_body, only: make_scene_body
  use calor_scene_contract, only: check_against_contract
  use calor_scene_file, only: scene_file_t, group_t, read_scene_file, parse_scene_text
  use calor_scene_getters, only: get, get_choice, get_choices, get_expression, place_of, &
                                 place_without_value, raise_at
  use calor_shapes, only: shape_choices
  use calor_taylor_weights, only: default_order
  use calor_text, only: text_t, text_list, to_text
  use calor_velocity, only: velocity_t
  implicit none (type, external)
  private

  public :: read_scene, interpret_scene

  !> Kinds of boundary condition
  type(choice_t), parameter :: boundary_choices(*) = [ &
      choice_t('temperature', 'held at a temperature'), &
      choice_t('flux', 'given a heat flux into the body'), &
      choice_t('insulated', 'no heat passes'), &
      choice_t('convection', 'heat flux in proportion to the temperature difference'), &
      choice_t('radiation', 'heat radiated to and from its surroundings') &
      ]

  !> Fields that a run can write
  type(choice_t), parameter :: field_choices(*) = [ &
      choice_t('temperature', 'the temperature'), &
      choice_t('liquid_fraction', 'how much is liquid, from 0 to 1, where something melts'), &
      choice_t('exact', 'the true temperature, where the scene gives it'), &
      choice_t('error', 'temperature less true temperature'), &
      choice_t('error_estimate', 'estimate of true temperature less temperature'), &
      choice_t('temperature_corrected', 'temperature plus that estimate'), &
      choice_t('row_quality', 'sum of |a_ij| over |a_ii| of each row: 1 is best'), &
      choice_t('row_repair', '0 as written, 1 support grown, 2 positive, 3 inexact, 4 none'), &
      choice_t('neighbours', 'neighbours with a weight'), &
      choice_t('support_radius', 'support radius of each particle, m'), &
      choice_t('condition_gradient', 'condition number of the system for B'), &
      choice_t('condition_laplacian', 'condition number of the system for B-hat') &
      ]

  !> Wall time between two checkpoints where the scene gives none, s
  real(wp), parameter :: usual_checkpoint_seconds = 60.0_wp

  !> Keys of &domain that say where the body is
  character(len=*), parameter :: geometry_keys(*) = [character(len=13) :: 'x_range', 'y_range', &
      'centre', 'radius', 'inner_radius', 'vertices', 'hole_vertices', 'file']

  !> Keys of &boundary that say what passes through a wall
  character(len=*), parameter :: exchange_keys(*) = [character(len=22) :: 'flux', &
      'flux_expression', 'coefficient', 'coefficient_expression', 'emissivity', &
      'emissivity_expression', 'ambient', 'ambient_expression']

  !> A kernel that smooths over more spacings is a slip of the pen
  real(wp), parameter :: widest_support = 100.0_wp
  !> Rounding alone is larger
  real(wp), parameter :: least_tolerance = 1.0e-15_wp
  !> Beyond it rounding takes over at spacings that anybody would use
  integer, parameter :: highest_scene_order = 8

contains

  !> Read a scene file.
  subroutine read_scene(path, scene, error)
    !> The file
    character(len=*), intent(in) :: path
    !> What it says
    type(scene_t), intent(out) :: scene
    !> The file is missing, or something in it is wrong
    type(error_t), allocatable, intent(out) :: error
    type(scene_file_t) :: file

    call read_scene_file(path, file, error)
    if (allocated(error)) return
    call interpret_file(file, scene, error)
  end subroutine read_scene

  !> Read a scene from a text, as a program does that makes scenes of its own.
  subroutine interpret_scene(text, scene, error)
    !> What would stand in a scene file
    character(len=*), intent(in) :: text
    !> What it says
    type(scene_t), intent(out) :: scene
    !> Something in it is wrong
    type(error_t), allocatable, intent(out) :: error
    type(scene_file_t) :: file

    call parse_scene_text(text, 'scene', file, error)
    if (allocated(error)) return
    call interpret_file(file, scene, error)
  end subroutine interpret_scene

  subroutine interpret_file(file, scene, error)
    type(scene_file_t), intent(in) :: file
    type(scene_t), intent(out) :: scene
    type(error_t), allocatable, intent(out) :: error
    type(effect_slot_t), allocatable :: effects(:)

    if (size(file%groups) == 0) then
      call raise(error, status_bad_input, file%path//' has no groups, as &domain ... /: it is '// &
                 'empty or all comments. calor new lists scenes to start from.')
      return
    end if
    call check_against_contract(file, error)
    if (allocated(error)) return
    scene%path = file%path
    scene%text = file%text
    scene%file = file
    call read_header(file, scene, error)
    if (allocated(error)) return
    call read_domain(file, scene, error)
    if (allocated(error)) return
    call read_method(file, scene, error)
    if (allocated(error)) return
    call read_body(file, scene, error)
    if (allocated(error)) return
    call read_boundaries(file, scene, error)
    if (allocated(error)) return
    call read_time(file, scene, error)
    if (allocated(error)) return
    call read_motion(file, scene, error)
    if (allocated(error)) return
    call read_accuracy(file, scene, error)
    if (allocated(error)) return
    call read_output(file, scene, error)
    if (allocated(error)) return
    call read_checkpoint(file, scene, error)
    if (allocated(error)) return
    call read_operators(file, scene, error)
    if (allocated(error)) return
    call read_cost(file, scene, error)
    if (allocated(error)) return
    ! Read here to find what is wrong with them; a simulation reads its own.
    call called_effects(file, effects, error)
  end subroutine interpret_file

  subroutine read_header(file, scene, error)
    type(scene_file_t), intent(in) :: file
    type(scene_t), intent(inout) :: scene
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group

    call file%group('scene', group)
    call get(group, 'title', scene%title, error, default='')
    if (allocated(error)) return
    call optional_expression(group, 'exact_expression', scene%exact_expression, error)
    scene%exact_place = place_without_value(group, 'exact_expression')
  end subroutine read_header

  subroutine read_domain(file, scene, error)
    type(scene_file_t), intent(in) :: file
    type(scene_t), intent(inout) :: scene
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group

    call file%group('domain', group)
    associate (domain => scene%domain)
      domain%place = place_of(group, '')
      call get_choice(group, 'shape', shape_choices, domain%shape, error, default='rectangle')
      if (allocated(error)) return
      call refuse_keys(group, pack(geometry_keys, .not. belongs(geometry_keys, domain%shape)), &
                       'shape = '''//domain%shape//'''', error)
      if (allocated(error)) return
      domain%arrangement = 'lattice'
      domain%file = ''
      if (domain%shape == 'cloud') then
        call refuse_keys(group, [character(len=11) :: 'arrangement', 'jitter', 'seed'], &
                         'shape = ''cloud''', error)
        if (allocated(error)) return
        call get(group, 'file', domain%file, error, not_blank=.true.)
        if (allocated(error)) return
        if (group%has('spacing')) call get(group, 'spacing', domain%spacing, error, positive=.true.)
        return
      end if
      call read_geometry(group, domain, error)
      if (allocated(error)) return
      call get(group, 'spacing', domain%spacing, error, positive=.true.)
      if (allocated(error)) return
      call get_choice(group, 'arrangement', arrangement_choices, domain%arrangement, error, &
                      default='lattice')
      if (allocated(error)) return
      if (domain%arrangement == 'jittered') then
        call get(group, 'jitter', domain%jitter, error, default=0.2_wp, non_negative=.true.)
      else
        call refuse_keys(group, ['jitter'], 'arrangement = '''//domain%arrangement//'''', error)
      end if
      if (allocated(error)) return
      if (domain%arrangement == 'lattice' .or. domain%arrangement == 'hexagonal') then
        call refuse_keys(group, ['seed'], 'arrangement = '''//domain%arrangement//'''', error)
        if (allocated(error)) return
      end if
      call get(group, 'seed', domain%seed, error, default=1)
    end associate
  end subroutine read_domain

  !> Whether a key of `geometry_keys` says something about a shape.
  elemental function belongs(key, shape)
    character(len=*), intent(in) :: key, shape
    logical :: belongs

    select case (key)
    case ('x_range', 'y_range')
      belongs = shape == 'rectangle'
    case ('centre', 'radius')
      belongs = shape == 'disc' .or. shape == 'annulus'
    case ('inner_radius')
      belongs = shape == 'annulus'
    case ('vertices', 'hole_vertices')
      belongs = shape == 'polygon'
    case default
      belongs = shape == 'cloud'
    end select
  end function belongs

  !> Where the body is, checked.
  subroutine read_geometry(group, domain, error)
    type(group_t), intent(in) :: group
    type(domain_t), intent(inout) :: domain
    type(error_t), allocatable, intent(out) :: error
    type(body_t) :: body
    type(error_t), allocatable :: failure
    character(len=:), allocatable :: key
    real(wp), allocatable :: pair(:)

    select case (domain%shape)
    case ('rectangle')
      call get(group, 'x_range', pair, error, count=2, increasing=.true.)
      if (allocated(error)) return
      domain%x_range = pair
      call get(group, 'y_range', pair, error, count=2, increasing=.true.)
      if (allocated(error)) return
      domain%y_range = pair
    case ('polygon')
      call get(group, 'vertices', domain%vertices, error)
      if (allocated(error)) return
      if (group%has('hole_vertices')) then
        call get(group, 'hole_vertices', domain%hole_vertices, error)
      else
        allocate (domain%hole_vertices(0))
      end if
    case default
      call get(group, 'centre', pair, error, count=2, default=[0.0_wp, 0.0_wp])
      if (allocated(error)) return
      domain%centre = pair
      call get(group, 'radius', domain%radius, error, positive=.true.)
      if (allocated(error)) return
      if (domain%shape == 'annulus') then
        call get(group, 'inner_radius', domain%inner_radius, error, positive=.true.)
      end if
    end select
    if (allocated(error)) return
    call make_scene_body(domain, body, failure, key)
    if (allocated(failure)) call raise_at(error, group, key, failure%message)
  end subroutine read_geometry

  !> Keys that would change nothing are refused, so that nobody believes they did.
  subroutine refuse_keys(group, keys, setting, error)
    type(group_t), intent(in) :: group
    character(len=*), intent(in) :: keys(:)
    !> What makes them useless
    character(len=*), intent(in) :: setting
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    do k = 1, size(keys)
      if (.not. group%has(trim(keys(k)))) cycle
      call raise_at(error, group, trim(keys(k)), 'it means nothing with '//setting// &
                    '; remove one of the two.')
      return
    end do
  end subroutine refuse_keys

  subroutine read_method(file, scene, error)
    type(scene_file_t), intent(in) :: file
    type(scene_t), intent(inout) :: scene
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group, kernel_group

    call file%group('kernel', group)
    call get_choice(group, 'name', kernel_choices, scene%kernel, error, default='wendland_c2')
    if (allocated(error)) return
    kernel_group = group
    call file%group('scheme', group)
    call get_choice(group, 'laplacian', laplacian_choices, scene%laplacian, error, &
                    default='fatehi_manzari')
    if (allocated(error)) return
    call get_choice(group, 'gradient', gradient_choices, scene%gradient, error, &
                    default='renormalized')
    if (allocated(error)) return
    call get(group, 'order', scene%order, error, default=default_order)
    if (allocated(error)) return
    if (scene%order < 1 .or. scene%order > highest_scene_order) then
      call raise_at(error, group, 'order', 'the consistent schemes have the orders 1 to '// &
                    to_text(highest_scene_order)//', not '//to_text(scene%order)//'.')
      return
    end if
    call get(kernel_group, 'support', scene%support, error, positive=.true., &
             default=usual_support(scene%laplacian, scene%order), maximum=widest_support)
    if (allocated(error)) return
    scene%support_place = place_of(kernel_group, 'support')
    call get(group, 'support_growth', scene%support_growth, error, default=.true.)
    if (allocated(error)) return
    call get(group, 'allow_inexact_rows', scene%allow_inexact_rows, error, default=.false.)
    if (allocated(error)) return
    call get(group, 'allow_unstable', scene%allow_unstable, error, default=.false.)
    if (allocated(error)) return
    call get(group, 'single_weights', scene%single_weights, error, default=.false.)
  end subroutine read_method

  !> What the body consists of and how warm it is at the start
  subroutine read_body(file, scene, error)
    type(scene_file_t), intent(in) :: file
    type(scene_t), intent(inout) :: scene
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group
    type(materials_t) :: materials
    integer :: k

    call read_materials(file, materials, error)
    if (allocated(error)) return
    scene%uniform_material = .not. allocated(materials%list)
    if (scene%uniform_material) then
      call read_uniform_material(file, scene%material, error)
      if (allocated(error)) return
    end if
    do k = 1, file%count('material')
      call file%group('material', group, k)
      call require_latent_heat(group, error)
      if (allocated(error)) return
      scene%melts = scene%melts .or. group%has('latent_heat')
    end do
    call file%group('initial', group)
    call get(group, 'temperature', scene%initial_temperature, error, default=0.0_wp)
    if (allocated(error)) return
    call optional_expression(group, 'temperature_expression', scene%initial_expression, error)
    scene%initial_place = place_without_value(group, 'temperature_expression')
  end subroutine read_body

  !> What is read with the effect `melting`, which is called for by the latent heat: solidus and
  !> liquidus say nothing without it.
  subroutine require_latent_heat(group, error)
    type(group_t), intent(in) :: group
    type(error_t), allocatable, intent(out) :: error
    character(len=*), parameter :: ends(2) = [character(len=8) :: 'solidus', 'liquidus']
    integer :: k

    if (group%has('latent_heat')) return
    do k = 1, size(ends)
      if (.not. group%has(trim(ends(k)))) cycle
      call raise_at(error, group, trim(ends(k)), 'it takes latent_heat to melt: give '// &
                    'latent_heat, solidus and liquidus, or none of them.')
      return
    end do
  end subroutine require_latent_heat

  !> One constant isotropic material
  subroutine read_uniform_material(file, material, error)
    type(scene_file_t), intent(in) :: file
    type(uniform_material_t), intent(inout) :: material
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group

    call file%group('material', group)
    call get(group, 'conductivity', material%conductivity, error, default=1.0_wp, positive=.true.)
    if (allocated(error)) return
    call get(group, 'density', material%density, error, default=1.0_wp, positive=.true.)
    if (allocated(error)) return
    call get(group, 'heat_capacity', material%heat_capacity, error, default=1.0_wp, &
             positive=.true.)
  end subroutine read_uniform_material

  subroutine read_boundaries(file, scene, error)
    type(scene_file_t), intent(in) :: file
    type(scene_t), intent(inout) :: scene
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group
    integer :: k

    allocate (scene%boundaries(file%count('boundary')))
    do k = 1, size(scene%boundaries)
      call file%group('boundary', group, k)
      associate (boundary => scene%boundaries(k))
        call get(group, 'on', boundary%on, error, default='all', not_blank=.true.)
        if (allocated(error)) return
        boundary%place = place_of(group, 'on')
        call get_choice(group, 'kind', boundary_choices, boundary%kind, error, &
                        default='temperature')
        if (allocated(error)) return
        call optional_expression(group, 'where_expression', boundary%where_expression, error, &
                                 in_space=.true.)
        if (allocated(error)) return
        boundary%value_expression = ''
        if (boundary%kind /= 'temperature') cycle
        call refuse_keys(group, exchange_keys, 'kind = ''temperature''', error)
        if (allocated(error)) return
        call optional_expression(group, 'value_expression', boundary%value_expression, error)
        if (allocated(error)) return
        if (boundary%value_expression == '') call get(group, 'value', boundary%value, error)
        if (allocated(error)) return
      end associate
    end do
  end subroutine read_boundaries

  subroutine read_time(file, scene, error)
    type(scene_file_t), intent(in) :: file
    type(scene_t), intent(inout) :: scene
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group

    call file%group('time', group)
    associate (time => scene%time)
      time%method = 'auto'
      time%place = place_of(group, '')
      ! A scene for `calor operators` needs no time; a run without it is refused later.
      if (file%count('time') == 0) return
      call get(group, 'steady', time%steady, error, default=.false.)
      if (allocated(error)) return
      if (time%steady) then
        time%place = place_of(group, 'steady')
        call refuse_keys(group, [character(len=6) :: 'end', 'step', 'method'], &
                         'steady = .true.', error)
        if (allocated(error)) return
        if (group%has('tolerance')) then
          call get(group, 'tolerance', time%tolerance, error, minimum=least_tolerance)
        end if
        return
      end if
      call get(group, 'end', time%end, error, positive=.true.)
      if (allocated(error)) return
      call get_choice(group, 'method', integrator_choices, time%method, error, default='auto')
      if (allocated(error)) return
      if (group%has('step')) call get(group, 'step', time%step, error, positive=.true.)
      if (allocated(error)) return
      if (group%has('tolerance')) then
        call get(group, 'tolerance', time%tolerance, error, minimum=least_tolerance)
      end if
      if (allocated(error)) return
      if (group%has('step') .and. group%has('tolerance')) then
        call raise_at(error, group, 'tolerance', 'with a fixed step there is no error control; '// &
                      'remove step or tolerance.')
      end if
    end associate
  end subroutine read_time

  !> How particles move, but for the velocity itself, which is compiled to find what is wrong with
  !> it
  subroutine read_motion(file, scene, error)
    type(scene_file_t), intent(in) :: file
    type(scene_t), intent(inout) :: scene
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group
    type(velocity_t) :: velocity

    scene%motion%in_force = file%count('motion') > 0
    if (.not. scene%motion%in_force) return
    call file%group('motion', group)
    scene%motion%place = place_of(group, '')
    call velocity%read(group, error)
    if (allocated(error)) return
    if (group%has('step')) call get(group, 'step', scene%motion%step, error, positive=.true.)
    if (allocated(error)) return
    call get(group, 'skin', scene%motion%skin, error, default=0.5_wp, non_negative=.true., &
             maximum=widest_support)
    if (allocated(error)) return
    call get(group, 'shifting', scene%motion%shifting, error, default=.false.)
    if (allocated(error)) return
    if (scene%time%steady) then
      call raise_at(error, &
                    group, '', 'a body that moves has no steady temperature here; remove '// &
                    '&motion, or &time steady.')
    else if (scene%motion%shifting .and. (scene%melts .or. .not. scene%uniform_material)) then
      call raise_at(error, group, 'shifting', 'a particle that is shifted leaves its material '// &
                    'behind: shifting takes one constant material that does not melt. Remove it.')
    end if
  end subroutine read_motion

  subroutine read_accuracy(file, scene, error)
    type(scene_file_t), intent(in) :: file
    type(scene_t), intent(inout) :: scene
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group

    call file%group('accuracy', group)
    call get(group, 'estimate', scene%accuracy%estimate, error, default=.false.)
    if (allocated(error)) return
    if (group%has('target')) then
      call get(group, 'target', scene%accuracy%target, error, positive=.true., maximum=1.0_wp)
      if (allocated(error)) return
      ! What is to be reached has to be known.
      scene%accuracy%estimate = .true.
    end if
    scene%accuracy%place = place_of(group, '')
    if (scene%melts .and. scene%accuracy%target > 0) then
      call raise_at(error, group, 'target', 'where something melts the error is estimated as '// &
                    'a mean over the passage of a front, which is too little to choose by. '// &
                    'Take estimate = .true.')
    else if (scene%accuracy%estimate .and. scene%melts .and. scene%domain%shape == 'cloud' .and. &
             .not. scene%time%steady) then
      call raise_at(error, group, '', 'where something melts the error is estimated from a run '// &
                    'with particles twice as far apart, which a cloud from a file does not '// &
                    'have. Remove &accuracy, or give &domain a shape.')
    end if
  end subroutine read_accuracy

  subroutine read_output(file, scene, error)
    type(scene_file_t), intent(in) :: file
    type(scene_t), intent(inout) :: scene
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group
    type(text_t), allocatable :: usual(:)
    integer :: k

    call file%group('output', group)
    usual = text_list(['temperature'])
    if (scene%melts) usual = text_list([character(len=15) :: 'temperature', 'liquid_fraction'])
    associate (output => scene%output)
      output%file = ''
      output%place = place_of(group, 'file')
      if (file%count('output') == 0) return
      call get(group, 'file', output%file, error, not_blank=.true.)
      if (allocated(error)) return
      if (scene%time%steady) then
        call refuse_keys(group, ['every'], '&time steady = .true.', error)
        if (allocated(error)) return
      end if
      if (group%has('every')) call get(group, 'every', output%every, error, positive=.true.)
      if (allocated(error)) return
      call get_choices(group, 'fields', field_choices, output%fields, error, &
                       default=usual)
      if (allocated(error)) return
      if (scene%accuracy%estimate) then
        if (all([(output%fields(k)%value /= 'error_estimate', k=1, size(output%fields))])) then
          output%fields = [output%fields, text_t('error_estimate')]
        end if
        do k = 1, size(output%fields)
          if (output%fields(k)%value /= 'temperature_corrected') cycle
          if (.not. scene%melts .or. scene%time%steady) cycle
          call raise_at(error, group, 'fields', 'where something melts the error is known '// &
                        'as a mean over the passage of a front, not at any one time, so that '// &
                        'there is no ''temperature_corrected''.')
          return
        end do
      else
        do k = 1, size(output%fields)
          if (all(output%fields(k)%value /= &
                  [character(len=21) :: 'error_estimate', 'temperature_corrected'])) cycle
          call raise_at(error, group, 'fields', 'the field '''//output%fields(k)%value// &
                        ''' needs the estimate: add &accuracy estimate = .true. /.')
          return
        end do
      end if
      do k = 1, size(output%fields)
        if (output%fields(k)%value /= 'liquid_fraction' .or. scene%melts) cycle
        call raise_at(error, group, 'fields', 'the field ''liquid_fraction'' needs something '// &
                      'that melts: give &material latent_heat, solidus and liquidus.')
        return
      end do
      if (scene%exact_expression /= '') return
      do k = 1, size(output%fields)
        if (all(output%fields(k)%value /= [character(len=5) :: 'exact', 'error'])) cycle
        call raise_at(error, group, 'fields', 'the field '''//output%fields(k)%value// &
                      ''' needs the true temperature: give &scene exact_expression.')
        return
      end do
    end associate
  end subroutine read_output

  !> Without the group a run writes a checkpoint only when it is interrupted.
  subroutine read_checkpoint(file, scene, error)
    type(scene_file_t), intent(in) :: file
    type(scene_t), intent(inout) :: scene
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group
    character(len=:), allocatable :: usual
    real(wp) :: usual_seconds
    integer, parameter :: most_kept = 100

    call file%group('checkpoint', group)
    ! The output's name tells runs apart.
    usual = stem(file%path)
    if (scene%output%file /= '') usual = without_ending(scene%output%file)
    usual = usual//'.checkpoint.h5'
    associate (checkpoint => scene%checkpoint)
      checkpoint%file = usual
      checkpoint%place = place_of(group, 'file')
      checkpoint%asked = file%count('checkpoint') > 0
      if (.not. checkpoint%asked) return
      if (scene%time%steady) then
        call raise_at(error, group, '', 'a steady state is found without steps between which a '// &
                      'checkpoint could be written; remove &checkpoint, or &time steady.')
        return
      else if (scene%accuracy%target > 0) then
        call raise_at(error, group, '', 'a search for an accuracy consists of many runs, which '// &
                      'cannot be resumed; remove &checkpoint, or &accuracy target.')
        return
      end if
      call get(group, 'file', checkpoint%file, error, default=usual)
      if (allocated(error)) return
      if (checkpoint%file == '') then
        call raise_at(error, group, 'file', 'the checkpoint needs a name; leave file out for '''// &
                      usual//'''.')
        return
      end if
      if (checkpoint%file == scene%output%file) then
        call raise_at(error, group, 'file', 'that is the name of the output file; name another.')
        return
      end if
      if (group%has('every')) call get(group, 'every', checkpoint%every, error, positive=.true.)
      if (allocated(error)) return
      usual_seconds = usual_checkpoint_seconds
      if (group%has('every')) usual_seconds = 0
      call get(group, 'every_seconds', checkpoint%every_seconds, error, default=usual_seconds, &
               non_negative=.true.)
      if (allocated(error)) return
      call get(group, 'keep', checkpoint%keep, error, default=1, minimum=1, maximum=most_kept)
    end associate
  end subroutine read_checkpoint

  subroutine read_operators(file, scene, error)
    type(scene_file_t), intent(in) :: file
    type(scene_t), intent(inout) :: scene
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group

    call file%group('operators', group)
    associate (asked => scene%operators)
      asked%field_expression = ''
      asked%file = ''
      asked%place = place_of(group, 'file')
      if (file%count('operators') == 0) return
      call required_expression(group, 'field_expression', asked%field_expression, error)
      if (allocated(error)) return
      call get_choices(group, 'gradients', gradient_choices, asked%gradients, error, &
                       default=text_list(['all']))
      if (allocated(error)) return
      call get_choices(group, 'laplacians', laplacian_choices, asked%laplacians, error, &
                       default=text_list(['all']))
      if (allocated(error)) return
      call optional_expression(group, 'exact_gradient_x_expression', asked%exact_gradient_x, error)
      if (allocated(error)) return
      call optional_expression(group, 'exact_gradient_y_expression', asked%exact_gradient_y, error)
      if (allocated(error)) return
      call optional_expression(group, 'exact_laplacian_expression', asked%exact_laplacian, error)
      if (allocated(error)) return
      call get(group, 'file', asked%file, error, default='')
    end associate
  end subroutine read_operators

  !> What `calor cost` compares; without the group, what the program chooses.
  subroutine read_cost(file, scene, error)
    type(scene_file_t), intent(in) :: file
    type(scene_t), intent(inout) :: scene
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group
    real(wp), parameter :: none(0) = [real(wp) ::]
    real(wp), allocatable :: orders(:)
    integer, parameter :: most_repetitions = 1000

    call file%group('cost', group)
    associate (cost => scene%cost)
      call get(group, 'orders', orders, error, default=[2.0_wp, 4.0_wp, 6.0_wp, 8.0_wp], &
               minimum=1.0_wp, maximum=real(highest_scene_order, wp))
      if (allocated(error)) return
      call refuse_twins(group, 'orders', orders, error)
      if (allocated(error)) return
      if (any(abs(orders - anint(orders)) > 0)) then
        call raise_at(error, group, 'orders', 'orders are whole numbers.')
        return
      end if
      cost%orders = nint(orders)
      cost%place = place_of(group, 'file')
      cost%spacings_place = place_of(group, 'spacings')
      if (scene%domain%shape == 'cloud') then
        call refuse_keys(group, ['spacings'], '&domain shape = ''cloud'', whose particles '// &
                         'are what they are', error)
        if (allocated(error)) return
      end if
      call get(group, 'spacings', cost%spacings, error, default=none, positive=.true.)
      if (allocated(error)) return
      call refuse_twins(group, 'spacings', cost%spacings, error)
      if (allocated(error)) return
      call get(group, 'supports', cost%supports, error, default=none, positive=.true., &
               maximum=widest_support)
      if (allocated(error)) return
      call refuse_twins(group, 'supports', cost%supports, error)
      if (allocated(error)) return
      call get_choices(group, 'laplacians', laplacian_choices, cost%laplacians, error, &
                       default=text_list(['all']))
      if (allocated(error)) return
      call get(group, 'repetitions', cost%repetitions, error, default=5, minimum=1, &
               maximum=most_repetitions)
      if (allocated(error)) return
      call get(group, 'seconds', cost%seconds, error, default=600.0_wp, positive=.true.)
      if (allocated(error)) return
      if (group%has('target')) call get(group, 'target', cost%target, error, positive=.true.)
      if (allocated(error)) return
      call get(group, 'file', cost%file, error, default=stem(file%path)//'_cost.csv')
      if (allocated(error)) return
      if (index(cost%file, '.csv', back=.true.) /= len(cost%file) - 3 .or. &
          len(cost%file) < 5) then
        call raise_at(error, group, 'file', 'the name must end in .csv, as in ''cost.csv''; '// &
                      'the pictures take it with .svg and .png.')
      end if
    end associate
  end subroutine read_cost

  !> A number that stands twice in a list is a slip of the pen.
  subroutine refuse_twins(group, key, values, error)
    type(group_t), intent(in) :: group
    character(len=*), intent(in) :: key
    real(wp), intent(in) :: values(:)
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    do k = 2, size(values)
      if (all(abs(values(:k - 1) - values(k)) > 0)) cycle
      call raise_at(error, group, key, to_text(values(k))//' is there twice; remove one.')
      return
    end do
  end subroutine refuse_twins

  !> The name of a file without folders and ending
  pure function stem(path)
    character(len=*), intent(in) :: path
    character(len=:), allocatable :: stem

    stem = path(index(path, '/', back=.true.) + 1:)
    if (index(stem, '.', back=.true.) > 1) stem = stem(:index(stem, '.', back=.true.) - 1)
  end function stem

  !> A path without the ending of the file's name
  pure function without_ending(path) result(root)
    character(len=*), intent(in) :: path
    character(len=:), allocatable :: root

    root = path(:index(path, '/', back=.true.))//stem(path)
  end function without_ending

  !> An expression, checked; '' if the group lacks it.
  subroutine optional_expression(group, key, text, error, in_space)
    type(group_t), intent(in) :: group
    character(len=*), intent(in) :: key
    character(len=:), allocatable, intent(out) :: text
    type(error_t), allocatable, intent(out) :: error
    !> Whether it may depend on x and y only
    logical, intent(in), optional :: in_space
    type(expression_t) :: expression

    text = ''
    if (.not. group%has(key)) return
    call required_expression(group, key, text, error)
    if (allocated(error) .or. .not. present(in_space)) return
    call get_expression(group, key, expression, error)
    if (allocated(error) .or. .not. in_space) return
    if (expression%uses('t') .or. expression%uses('T')) then
      call raise_at(error, group, key, 'it may depend on x and y only.')
    end if
  end subroutine optional_expression

  subroutine required_expression(group, key, text, error)
    type(group_t), intent(in) :: group
    character(len=*), intent(in) :: key
    character(len=:), allocatable, intent(out) :: text
    type(error_t), allocatable, intent(out) :: error
    type(expression_t) :: expression

    call get_expression(group, key, expression, error)
    if (allocated(error)) return
    call get(group, key, text, error)
  end subroutine required_expression

end module calor_scene_reader
