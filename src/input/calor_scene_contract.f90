!> What a scene may say: every group and every key of the scene format.
!>
!> The tables below are the format. They serve the check of a scene and the help texts. A scene that
!> has anything else is refused by its name, so that nothing in a scene is silently ignored.
module calor_scene_contract
  use calor_error, only: error_t
  use calor_expression, only: expression_t
  use calor_kinds, only: wp
  use calor_scene_file, only: scene_file_t, group_t
  use calor_scene_getters, only: get, get_expression, raise_at
  use calor_text, only: text_t, append, to_text, lower_case, join, suggestion
  implicit none (type, external)
  private

  public :: check_against_contract, contract_help, contract_default, contract_groups

  !> Types of keys
  integer, parameter :: number = 1, numbers = 2, whole = 3, yes_no = 4, text = 5, texts = 6, &
      expression = 7

  !> The types in words, in the order of the constants
  character(len=12), parameter :: type_words(*) = [character(len=12) :: 'number', 'numbers', &
      'whole number', 'true/false', 'text', 'texts', 'expression']

  logical, parameter :: many = .true., one = .false.

  !> A group of the format
  type :: group_rule_t
    !> Its name
    character(len=12) :: name
    !> Whether it may stand several times
    logical :: repeatable
    !> What it is for
    character(len=60) :: purpose
  end type group_rule_t

  !> A key of the format
  type :: key_rule_t
    !> The group that it belongs to
    character(len=12) :: group
    !> Its name
    character(len=32) :: name
    !> One of the types above
    integer :: type
    !> What holds without it, as a scene would say it; '' if nothing does
    character(len=16) :: default
    !> What it means, with the unit
    character(len=80) :: meaning
  end type key_rule_t

  type(group_rule_t), parameter :: group_rules(*) = [ &
      group_rule_t('scene', one, 'what the scene is called, and its solution if known'), &
      group_rule_t('domain', one, 'the body and the particles that it consists of'), &
      group_rule_t('kernel', one, 'the smoothing kernel'), &
      group_rule_t('scheme', one, 'how derivatives are approximated'), &
      group_rule_t('material', many, 'what the body is made of'), &
      group_rule_t('initial', one, 'the temperature at the beginning'), &
      group_rule_t('boundary', many, 'what happens at a part of the boundary'), &
      group_rule_t('source', many, 'heat set free within the body'), &
      group_rule_t('motion', one, 'a velocity that carries the body and its particles'), &
      group_rule_t('time', one, 'how long and in which steps'), &
      group_rule_t('output', one, 'what is written, where and how often'), &
      group_rule_t('accuracy', one, 'how far the run knows and bounds its own error'), &
      group_rule_t('checkpoint', one, &
                   'lay the state aside for calor run --resume'), &
      group_rule_t('operators', one, 'a field whose derivatives are evaluated'), &
      group_rule_t('cost', one, 'schemes and spacings whose accuracy and cost are compared')]

  type(key_rule_t), parameter :: key_rules(*) = [ &
      key_rule_t('scene', 'title', text, '', 'a name for people'), &
      key_rule_t('scene', 'exact_expression', expression, '', 'the true temperature, K'), &
      key_rule_t('domain', 'shape', text, '''rectangle''', 'the shape of the body'), &
      key_rule_t('domain', 'x_range', numbers, '', 'left and right end of a rectangle, m'), &
      key_rule_t('domain', 'y_range', numbers, '', 'lower and upper end of a rectangle, m'), &
      key_rule_t('domain', 'centre', numbers, '0, 0', 'centre of a disc or annulus, m'), &
      key_rule_t('domain', 'radius', number, '', 'radius of a disc or annulus, m'), &
      key_rule_t('domain', 'inner_radius', number, '', 'inner radius of an annulus, m'), &
      key_rule_t('domain', 'vertices', numbers, '', 'corners of a polygon, x and y, '// &
                 'counter-clockwise, m'), &
      key_rule_t('domain', 'hole_vertices', numbers, '', 'corners of its holes, each '// &
                 'closed by its first one, m'), &
      key_rule_t('domain', 'file', text, '', 'the file of a cloud of one''s own'), &
      key_rule_t('domain', 'spacing', number, '', 'distance between particles, m'), &
      key_rule_t('domain', 'arrangement', text, '''lattice''', 'how particles are placed'), &
      key_rule_t('domain', 'jitter', number, '0.2', 'displacement in units of spacing'), &
      key_rule_t('domain', 'seed', whole, '1', 'seed of jittered or relaxed particles'), &
      key_rule_t('kernel', 'name', text, '''wendland_c2''', 'the kernel'), &
      key_rule_t('kernel', 'support', number, '2.1', 'support radius in units of spacing'// &
                 ' (consistent: 1 + 0.45 order)'), &
      key_rule_t('scheme', 'laplacian', text, '''fatehi_manzari''', 'second derivatives'), &
      key_rule_t('scheme', 'gradient', text, '''renormalized''', 'first derivatives'), &
      key_rule_t('scheme', 'order', whole, '4', 'order of the consistent schemes, 1 to 8'), &
      key_rule_t('scheme', 'support_growth', yes_no, '.true.', 'repair poor rows'), &
      key_rule_t('scheme', 'allow_inexact_rows', yes_no, '.false.', 'run with stable rows'// &
                 ' that are not exact'), &
      key_rule_t('scheme', 'allow_unstable', yes_no, '.false.', 'run an unstable scheme'), &
      key_rule_t('scheme', 'single_weights', yes_no, '.false.', &
                 'steps with 32-bit weights: large clouds faster, errors below 1e-7 lost'), &
      key_rule_t('material', 'conductivity', number, '1', 'conductivity, W/(m K)'), &
      key_rule_t('material', 'conductivity_expression', expression, '', 'the same'), &
      key_rule_t('material', 'conductivity_xx', number, '', 'where it is a tensor'), &
      key_rule_t('material', 'conductivity_xx_expression', expression, '', 'the same'), &
      key_rule_t('material', 'conductivity_yy', number, '', 'where it is a tensor'), &
      key_rule_t('material', 'conductivity_yy_expression', expression, '', 'the same'), &
      key_rule_t('material', 'conductivity_xy', number, '0', 'where it is a tensor'), &
      key_rule_t('material', 'conductivity_xy_expression', expression, '', 'the same'), &
      key_rule_t('material', 'density', number, '1', 'density, kg/m3'), &
      key_rule_t('material', 'density_expression', expression, '', 'the same'), &
      key_rule_t('material', 'heat_capacity', number, '1', 'heat capacity, J/(kg K)'), &
      key_rule_t('material', 'heat_capacity_expression', expression, '', 'the same'), &
      key_rule_t('material', 'latent_heat', number, '', 'heat that melting takes, J/kg'), &
      key_rule_t('material', 'solidus', number, '', 'temperature at which melting begins'), &
      key_rule_t('material', 'liquidus', number, '', 'temperature at which all is liquid'), &
      key_rule_t('material', 'where_expression', expression, '', 'where it is not 0'), &
      key_rule_t('initial', 'temperature', number, '0', 'temperature, K'), &
      key_rule_t('initial', 'temperature_expression', expression, '', 'the same'), &
      key_rule_t('boundary', 'on', text, '''all''', 'which part of the boundary'), &
      key_rule_t('boundary', 'kind', text, '''temperature''', 'what is given there'), &
      key_rule_t('boundary', 'value', number, '', 'temperature, K'), &
      key_rule_t('boundary', 'value_expression', expression, '', 'the same'), &
      key_rule_t('boundary', 'where_expression', expression, '', 'where it is not 0'), &
      key_rule_t('boundary', 'flux', number, '', 'heat flux into the body, W/m2'), &
      key_rule_t('boundary', 'flux_expression', expression, '', 'the same'), &
      key_rule_t('boundary', 'coefficient', number, '', 'heat transfer, W/(m2 K)'), &
      key_rule_t('boundary', 'coefficient_expression', expression, '', 'the same'), &
      key_rule_t('boundary', 'emissivity', number, '', 'emissivity, from 0 to 1'), &
      key_rule_t('boundary', 'emissivity_expression', expression, '', 'the same'), &
      key_rule_t('boundary', 'ambient', number, '', 'temperature around the body, K'), &
      key_rule_t('boundary', 'ambient_expression', expression, '', 'the same'), &
      key_rule_t('source', 'power', number, '', 'heat set free, W/m3'), &
      key_rule_t('source', 'power_expression', expression, '', 'the same'), &
      key_rule_t('source', 'where_expression', expression, '', 'where it is not 0'), &
      key_rule_t('motion', 'velocity_x', number, '', 'velocity, m/s'), &
      key_rule_t('motion', 'velocity_x_expression', expression, '', 'the same'), &
      key_rule_t('motion', 'velocity_y', number, '', 'velocity, m/s'), &
      key_rule_t('motion', 'velocity_y_expression', expression, '', 'the same'), &
      key_rule_t('motion', 'step', number, '', 'longest time with one set of rows, s'), &
      key_rule_t('motion', 'skin', number, '0.5', 'skin of neighbour lists in spacings'), &
      key_rule_t('motion', 'shifting', yes_no, '.false.', 'keep particles evenly spread'), &
      key_rule_t('time', 'end', number, '', 'the time to simulate, s'), &
      key_rule_t('time', 'step', number, '', 'length of a step, s; without it automatic'), &
      key_rule_t('time', 'method', text, '''auto''', 'how steps are made'), &
      key_rule_t('time', 'tolerance', number, '1e-6', 'error allowed in each step'), &
      key_rule_t('time', 'steady', yes_no, '.false.', 'only the steady temperature'), &
      key_rule_t('output', 'file', text, '', 'the file to write (VTKHDF)'), &
      key_rule_t('output', 'every', number, '', 'time between outputs, s'), &
      key_rule_t('output', 'fields', texts, '''temperature''', 'what to write'), &
      key_rule_t('accuracy', 'estimate', yes_no, '.false.', 'estimate the error'), &
      key_rule_t('accuracy', 'target', number, '', 'relative L2 error to reach'), &
      key_rule_t('checkpoint', 'file', text, '', 'the file to write (HDF5); without it '// &
                 'OUTPUT.checkpoint.h5'), &
      key_rule_t('checkpoint', 'every_seconds', number, '60', 'wall time between two, s; '// &
                 '0: only by every'), &
      key_rule_t('checkpoint', 'every', number, '', 'simulated time between two, s'), &
      key_rule_t('checkpoint', 'keep', whole, '1', 'how many to keep: older ones have '// &
                 'a number before .h5'), &
      key_rule_t('operators', 'field_expression', expression, '', 'the field'), &
      key_rule_t('operators', 'gradients', texts, '''all''', 'gradient schemes'), &
      key_rule_t('operators', 'laplacians', texts, '''all''', 'Laplacian schemes'), &
      key_rule_t('operators', 'exact_gradient_x_expression', expression, '', 'its d/dx'), &
      key_rule_t('operators', 'exact_gradient_y_expression', expression, '', 'its d/dy'), &
      key_rule_t('operators', 'exact_laplacian_expression', expression, '', 'its Laplacian'), &
      key_rule_t('operators', 'file', text, '', 'the file to write (VTKHDF)'), &
      key_rule_t('cost', 'spacings', numbers, '', 'distances between particles, m'), &
      key_rule_t('cost', 'laplacians', texts, '''all''', 'Laplacian schemes'), &
      key_rule_t('cost', 'supports', numbers, '', 'support radii in spacings'), &
      key_rule_t('cost', 'orders', numbers, '2, 4, 6, 8', 'orders of the scheme consistent'), &
      key_rule_t('cost', 'repetitions', whole, '5', 'how often each entry is timed'), &
      key_rule_t('cost', 'seconds', number, '600', 'time that all may take, s'), &
      key_rule_t('cost', 'target', number, '', 'the error to reach at least cost'), &
      key_rule_t('cost', 'file', text, '', 'the table to write (CSV)')]

  character(len=*), parameter :: companion = '_expression'

contains

  !> Check that a scene says nothing but what the format has.
  !> What a key's value must be beside its type is left to whoever reads it.
  subroutine check_against_contract(scene, error)
    !> The scene
    type(scene_file_t), intent(in) :: scene
    !> The first thing that is wrong: an unknown group or key (with the nearest known one), a group
    !> that may not stand twice, a value of the wrong type, or a number and an expression for the
    !> same thing
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    do k = 1, size(scene%groups)
      call check_group(scene, k, error)
      if (allocated(error)) return
      call check_keys(scene%groups(k), error)
      if (allocated(error)) return
    end do
  end subroutine check_against_contract

  !> What holds if a key is not given, as a scene would say it; '' if nothing does.
  pure function contract_default(group, key) result(default)
    !> The group in lower case
    character(len=*), intent(in) :: group
    !> The key in lower case
    character(len=*), intent(in) :: key
    character(len=:), allocatable :: default
    integer :: rule

    default = ''
    rule = find_key_rule(group, key)
    if (rule > 0) default = trim(key_rules(rule)%default)
  end function contract_default

  !> Help for people: the keys of a group with type, default and meaning, one on a line; lines are
  !> parted by new_line. Without a group, or for an unknown one, the groups.
  pure function contract_help(group) result(help)
    !> The group, in any case
    character(len=*), intent(in), optional :: group
    character(len=:), allocatable :: help
    integer :: k, rule

    rule = 0
    if (present(group)) rule = find_group_rule(lower_case(group))
    help = ''
    if (rule == 0) then
      do k = 1, size(group_rules)
        if (k > 1) help = help//new_line('a')
        help = help//'&'//group_rules(k)%name//' '//group_purpose(group_rules(k))
      end do
      return
    end if
    help = '&'//trim(group_rules(rule)%name)//': '//group_purpose(group_rules(rule))
    do k = 1, size(key_rules)
      if (key_rules(k)%group /= group_rules(rule)%name) cycle
      help = help//new_line('a')//'  '//key_line(key_rules(k))
    end do
  end function contract_help

  pure function group_purpose(rule) result(purpose)
    type(group_rule_t), intent(in) :: rule
    character(len=:), allocatable :: purpose

    purpose = trim(rule%purpose)
    if (rule%repeatable) purpose = purpose//' (may stand several times)'
  end function group_purpose

  pure function key_line(rule) result(line)
    type(key_rule_t), intent(in) :: rule
    character(len=:), allocatable :: line
    integer, parameter :: key_width = 28
    character(len=key_width) :: key

    key = rule%name
    line = key//type_words(rule%type)//'  '//trim(rule%meaning)
    if (rule%default /= '') line = line//' (default '//trim(rule%default)//')'
  end function key_line

  !> Check that a group exists, and that it may stand here.
  subroutine check_group(scene, position, error)
    type(scene_file_t), intent(in) :: scene
    integer, intent(in) :: position
    type(error_t), allocatable, intent(out) :: error
    integer :: rule, earlier

    associate (group => scene%groups(position))
      rule = find_group_rule(group%name)
      if (rule == 0) then
        call raise_at(error, group, '', 'there is no such group.'// &
                      suggestion(group%name, contract_groups())//new_line('a')// &
                      'There are: '//join(contract_groups(), ', ')//'.')
        return
      end if
      if (group_rules(rule)%repeatable) return
      do earlier = 1, position - 1
        if (scene%groups(earlier)%name /= group%name) cycle
        call raise_at(error, group, '', 'the group is there already, in line '// &
                      to_text(scene%groups(earlier)%line)//'; it may stand only once.')
        return
      end do
    end associate
  end subroutine check_group

  !> Check the keys of a group and the types of their values.
  subroutine check_keys(group, error)
    type(group_t), intent(in) :: group
    type(error_t), allocatable, intent(out) :: error
    integer :: k, rule

    do k = 1, size(group%entries)
      associate (key => group%entries(k)%key)
        rule = find_key_rule(group%name, key)
        if (rule == 0) then
          call raise_at(error, group, key, '&'//group%name//' has no such key.'// &
                        remedy_for(key, group%name)//new_line('a')// &
                        'It has: '//join(key_names(group%name), ', ')//'.')
          return
        end if
        if (group%has(key//companion)) then
          call raise_at(error, group, key, 'there is '//key//companion//' too, in line '// &
                        to_text(group%entries(group%find(key//companion))%line)// &
                        '; give only one of the two.')
          return
        end if
        call check_type(group, key, key_rules(rule)%type, error)
        if (allocated(error)) return
      end associate
    end do
  end subroutine check_keys

  !> What to do about a key that a group does not have: what else was meant, or where it belongs.
  pure function remedy_for(key, group) result(sentence)
    !> The key, and the group that it stands in
    character(len=*), intent(in) :: key, group
    !> ' ' and the sentence; '' if nothing is like it
    character(len=:), allocatable :: sentence
    type(text_t), allocatable :: owners(:)
    integer :: k

    sentence = suggestion(key, key_names(group))
    if (len(sentence) > 0) return
    allocate (owners(0))
    do k = 1, size(key_rules)
      if (key_rules(k)%name /= key) cycle
      call append(owners, '&'//trim(key_rules(k)%group))
    end do
    if (size(owners) > 0) sentence = ' It belongs to '//join(owners, ' or ')//'.'
  end function remedy_for

  !> Check that a key's values have its type.
  subroutine check_type(group, key, type, error)
    type(group_t), intent(in) :: group
    character(len=*), intent(in) :: key
    !> One of the types of keys
    integer, intent(in) :: type
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: a_number
    real(wp), allocatable :: a_list(:)
    integer :: a_count
    logical :: a_choice
    character(len=:), allocatable :: a_text
    type(text_t), allocatable :: some_texts(:)
    type(expression_t) :: an_expression

    select case (type)
    case (number)
      call get(group, key, a_number, error)
    case (numbers)
      call get(group, key, a_list, error)
    case (whole)
      call get(group, key, a_count, error)
    case (yes_no)
      call get(group, key, a_choice, error)
    case (text)
      call get(group, key, a_text, error)
    case (texts)
      call get(group, key, some_texts, error)
    case default
      call get_expression(group, key, an_expression, error)
    end select
  end subroutine check_type

  !> The position of a group among the rules, 0 if there is no such group.
  pure function find_group_rule(name) result(rule)
    character(len=*), intent(in) :: name
    integer :: rule

    do rule = 1, size(group_rules)
      if (group_rules(rule)%name == name) return
    end do
    rule = 0
  end function find_group_rule

  !> The position of a key among the rules, 0 if there is no such key.
  pure function find_key_rule(group, key) result(rule)
    character(len=*), intent(in) :: group, key
    integer :: rule

    do rule = 1, size(key_rules)
      if (key_rules(rule)%group == group .and. key_rules(rule)%name == key) return
    end do
    rule = 0
  end function find_key_rule

  !> The groups of the format.
  pure function contract_groups() result(names)
    type(text_t), allocatable :: names(:)
    integer :: k

    allocate (names(size(group_rules)))
    do k = 1, size(group_rules)
      names(k)%value = trim(group_rules(k)%name)
    end do
  end function contract_groups

  !> The keys of a group.
  pure function key_names(group) result(names)
    character(len=*), intent(in) :: group
    type(text_t), allocatable :: names(:)
    integer :: k, found

    allocate (names(count(key_rules%group == group)))
    found = 0
    do k = 1, size(key_rules)
      if (key_rules(k)%group /= group) cycle
      found = found + 1
      names(found)%value = trim(key_rules(k)%name)
    end do
  end function key_names

end module calor_scene_contract
