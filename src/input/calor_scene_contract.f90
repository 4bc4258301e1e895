!> What a scene may say: every group and every key of the scene format.
!>
!> The tables below are the format. They serve the check of a scene and the help texts. Groups and
!> keys of the format that this version cannot act upon yet are in the tables too, marked `later`:
!> a scene that has them is refused by their name, so that nothing in a scene is silently ignored.
module calor_scene_contract
  use calor_error, only: error_t, raise, status_bad_input
  use calor_expression, only: expression_t
  use calor_kinds, only: wp
  use calor_scene_file, only: scene_file_t, group_t
  use calor_scene_getters, only: get, get_expression, raise_at
  use calor_text, only: text_t, to_text, lower_case, join, suggestion
  implicit none (type, external)
  private

  public :: check_against_contract, contract_help, contract_default, contract_groups

  !> Types of keys
  integer, parameter :: number = 1, numbers = 2, whole = 3, yes_no = 4, text = 5, texts = 6, &
      expression = 7

  !> The types in words, in the order of the constants
  character(len=12), parameter :: type_words(*) = [character(len=12) :: 'number', 'numbers', &
      'whole number', 'true/false', 'text', 'texts', 'expression']

  logical, parameter :: now = .true., later = .false., many = .true., one = .false.

  !> A group of the format
  type :: group_rule_t
    !> Its name
    character(len=12) :: name
    !> Whether it may stand several times
    logical :: repeatable
    !> Whether this version can act upon it
    logical :: available
    !> What it is for; of a group that is not available, what this version cannot do
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
    !> Whether this version can act upon it
    logical :: available
    !> What holds without it, as a scene would say it; '' if nothing does
    character(len=16) :: default
    !> What it means, with the unit
    character(len=80) :: meaning
  end type key_rule_t

  !> A key of which this version can act upon some values only
  type :: value_rule_t
    !> The group
    character(len=12) :: group
    !> The key
    character(len=16) :: key
    !> The values that this version can act upon; '' leaves them to whoever reads the key
    character(len=40) :: available
    !> The other values of the format
    character(len=40) :: later
  end type value_rule_t

  type(group_rule_t), parameter :: group_rules(*) = [ &
      group_rule_t('scene', one, now, 'what the scene is called, and its solution if known'), &
      group_rule_t('domain', one, now, 'the body and the particles that it consists of'), &
      group_rule_t('kernel', one, now, 'the smoothing kernel'), &
      group_rule_t('scheme', one, now, 'how derivatives are approximated'), &
      group_rule_t('material', many, now, 'what the body is made of'), &
      group_rule_t('initial', one, now, 'the temperature at the beginning'), &
      group_rule_t('boundary', many, now, 'what happens at a part of the boundary'), &
      group_rule_t('source', many, now, 'heat set free within the body'), &
      group_rule_t('motion', one, now, 'a velocity that carries the body and its particles'), &
      group_rule_t('time', one, now, 'how long and in which steps'), &
      group_rule_t('output', one, now, 'what is written, where and how often'), &
      group_rule_t('accuracy', one, now, 'how far the run knows and bounds its own error'), &
      group_rule_t('checkpoint', one, now, &
                   'lay the state aside for calor run --resume'), &
      group_rule_t('operators', one, now, 'a field whose derivatives are evaluated'), &
      group_rule_t('cost', one, now, 'schemes and spacings whose accuracy and cost are compared')]

  type(key_rule_t), parameter :: key_rules(*) = [ &
      key_rule_t('scene', 'title', text, now, '', 'a name for people'), &
      key_rule_t('scene', 'exact_expression', expression, now, '', 'the true temperature, K'), &
      key_rule_t('domain', 'shape', text, now, '''rectangle''', 'the shape of the body'), &
      key_rule_t('domain', 'x_range', numbers, now, '', 'left and right end of a rectangle, m'), &
      key_rule_t('domain', 'y_range', numbers, now, '', 'lower and upper end of a rectangle, m'), &
      key_rule_t('domain', 'centre', numbers, now, '0, 0', 'centre of a disc or annulus, m'), &
      key_rule_t('domain', 'radius', number, now, '', 'radius of a disc or annulus, m'), &
      key_rule_t('domain', 'inner_radius', number, now, '', 'inner radius of an annulus, m'), &
      key_rule_t('domain', 'vertices', numbers, now, '', 'corners of a polygon, x and y, '// &
                 'counter-clockwise, m'), &
      key_rule_t('domain', 'hole_vertices', numbers, now, '', 'corners of its holes, each '// &
                 'closed by its first one, m'), &
      key_rule_t('domain', 'file', text, now, '', 'the file of a cloud of one''s own'), &
      key_rule_t('domain', 'spacing', number, now, '', 'distance between particles, m'), &
      key_rule_t('domain', 'arrangement', text, now, '''lattice''', 'how particles are placed'), &
      key_rule_t('domain', 'jitter', number, now, '0.2', 'displacement in units of spacing'), &
      key_rule_t('domain', 'seed', whole, now, '1', 'seed of jittered or relaxed particles'), &
      key_rule_t('kernel', 'name', text, now, '''wendland_c2''', 'the kernel'), &
      key_rule_t('kernel', 'support', number, now, '2.1', 'support radius in units of spacing'// &
                 ' (consistent: 1 + 0.45 order)'), &
      key_rule_t('scheme', 'laplacian', text, now, '''fatehi_manzari''', 'second derivatives'), &
      key_rule_t('scheme', 'gradient', text, now, '''renormalized''', 'first derivatives'), &
      key_rule_t('scheme', 'order', whole, now, '4', 'order of the consistent schemes, 1 to 8'), &
      key_rule_t('scheme', 'support_growth', yes_no, now, '.true.', 'repair poor rows'), &
      key_rule_t('scheme', 'allow_inexact_rows', yes_no, now, '.false.', 'run with stable rows'// &
                 ' that are not exact'), &
      key_rule_t('scheme', 'allow_unstable', yes_no, now, '.false.', 'run an unstable scheme'), &
      key_rule_t('scheme', 'single_weights', yes_no, now, '.false.', &
                 'steps with 32-bit weights: large clouds faster, errors below 1e-7 lost'), &
      key_rule_t('material', 'conductivity', number, now, '1', 'conductivity, W/(m K)'), &
      key_rule_t('material', 'conductivity_expression', expression, now, '', 'the same'), &
      key_rule_t('material', 'conductivity_xx', number, now, '', 'where it is a tensor'), &
      key_rule_t('material', 'conductivity_xx_expression', expression, now, '', 'the same'), &
      key_rule_t('material', 'conductivity_yy', number, now, '', 'where it is a tensor'), &
      key_rule_t('material', 'conductivity_yy_expression', expression, now, '', 'the same'), &
      key_rule_t('material', 'conductivity_xy', number, now, '0', 'where it is a tensor'), &
      key_rule_t('material', 'conductivity_xy_expression', expression, now, '', 'the same'), &
      key_rule_t('material', 'density', number, now, '1', 'density, kg/m3'), &
      key_rule_t('material', 'density_expression', expression, now, '', 'the same'), &
      key_rule_t('material', 'heat_capacity', number, now, '1', 'heat capacity, J/(kg K)'), &
      key_rule_t('material', 'heat_capacity_expression', expression, now, '', 'the same'), &
      key_rule_t('material', 'latent_heat', number, now, '', 'heat that melting takes, J/kg'), &
      key_rule_t('material', 'solidus', number, now, '', 'temperature at which melting begins'), &
      key_rule_t('material', 'liquidus', number, now, '', 'temperature at which all is liquid'), &
      key_rule_t('material', 'where_expression', expression, now, '', 'where it is not 0'), &
      key_rule_t('initial', 'temperature', number, now, '0', 'temperature, K'), &
      key_rule_t('initial', 'temperature_expression', expression, now, '', 'the same'), &
      key_rule_t('boundary', 'on', text, now, '''all''', 'which part of the boundary'), &
      key_rule_t('boundary', 'kind', text, now, '''temperature''', 'what is given there'), &
      key_rule_t('boundary', 'value', number, now, '', 'temperature, K'), &
      key_rule_t('boundary', 'value_expression', expression, now, '', 'the same'), &
      key_rule_t('boundary', 'where_expression', expression, now, '', 'where it is not 0'), &
      key_rule_t('boundary', 'flux', number, now, '', 'heat flux into the body, W/m2'), &
      key_rule_t('boundary', 'flux_expression', expression, now, '', 'the same'), &
      key_rule_t('boundary', 'coefficient', number, now, '', 'heat transfer, W/(m2 K)'), &
      key_rule_t('boundary', 'coefficient_expression', expression, now, '', 'the same'), &
      key_rule_t('boundary', 'emissivity', number, now, '', 'emissivity, from 0 to 1'), &
      key_rule_t('boundary', 'emissivity_expression', expression, now, '', 'the same'), &
      key_rule_t('boundary', 'ambient', number, now, '', 'temperature around the body, K'), &
      key_rule_t('boundary', 'ambient_expression', expression, now, '', 'the same'), &
      key_rule_t('source', 'power', number, now, '', 'heat set free, W/m3'), &
      key_rule_t('source', 'power_expression', expression, now, '', 'the same'), &
      key_rule_t('source', 'where_expression', expression, now, '', 'where it is not 0'), &
      key_rule_t('motion', 'velocity_x', number, now, '', 'velocity, m/s'), &
      key_rule_t('motion', 'velocity_x_expression', expression, now, '', 'the same'), &
      key_rule_t('motion', 'velocity_y', number, now, '', 'velocity, m/s'), &
      key_rule_t('motion', 'velocity_y_expression', expression, now, '', 'the same'), &
      key_rule_t('motion', 'step', number, now, '', 'longest time with one set of rows, s'), &
      key_rule_t('motion', 'skin', number, now, '0.5', 'skin of neighbour lists in spacings'), &
      key_rule_t('motion', 'shifting', yes_no, now, '.false.', 'keep particles evenly spread'), &
      key_rule_t('time', 'end', number, now, '', 'the time to simulate, s'), &
      key_rule_t('time', 'step', number, now, '', 'length of a step, s; without it automatic'), &
      key_rule_t('time', 'method', text, now, '''auto''', 'how steps are made'), &
      key_rule_t('time', 'tolerance', number, now, '1e-6', 'error allowed in each step'), &
      key_rule_t('time', 'steady', yes_no, now, '.false.', 'only the steady temperature'), &
      key_rule_t('output', 'file', text, now, '', 'the file to write (VTKHDF)'), &
      key_rule_t('output', 'every', number, now, '', 'time between outputs, s'), &
      key_rule_t('output', 'fields', texts, now, '''temperature''', 'what to write'), &
      key_rule_t('accuracy', 'estimate', yes_no, now, '.false.', 'estimate the error'), &
      key_rule_t('accuracy', 'target', number, now, '', 'relative L2 error to reach'), &
      key_rule_t('checkpoint', 'file', text, now, '', 'the file to write (HDF5); without it '// &
                 'OUTPUT.checkpoint.h5'), &
      key_rule_t('checkpoint', 'every_seconds', number, now, '60', 'wall time between two, s; '// &
                 '0: only by every'), &
      key_rule_t('checkpoint', 'every', number, now, '', 'simulated time between two, s'), &
      key_rule_t('checkpoint', 'keep', whole, now, '1', 'how many to keep: older ones are '// &
                 'called FILE.1, FILE.2'), &
      key_rule_t('operators', 'field_expression', expression, now, '', 'the field'), &
      key_rule_t('operators', 'gradients', texts, now, '''all''', 'gradient schemes'), &
      key_rule_t('operators', 'laplacians', texts, now, '''all''', 'Laplacian schemes'), &
      key_rule_t('operators', 'exact_gradient_x_expression', expression, now, '', 'its d/dx'), &
      key_rule_t('operators', 'exact_gradient_y_expression', expression, now, '', 'its d/dy'), &
      key_rule_t('operators', 'exact_laplacian_expression', expression, now, '', 'its Laplacian'), &
      key_rule_t('operators', 'file', text, now, '', 'the file to write (VTKHDF)'), &
      key_rule_t('cost', 'spacings', numbers, now, '', 'distances between particles, m'), &
      key_rule_t('cost', 'laplacians', texts, now, '''all''', 'Laplacian schemes'), &
      key_rule_t('cost', 'supports', numbers, now, '', 'support radii in spacings'), &
      key_rule_t('cost', 'orders', numbers, now, '2, 4, 6, 8', 'orders of the scheme consistent'), &
      key_rule_t('cost', 'repetitions', whole, now, '5', 'how often each entry is timed'), &
      key_rule_t('cost', 'seconds', number, now, '600', 'time that all may take, s'), &
      key_rule_t('cost', 'target', number, now, '', 'the error to reach at least cost'), &
      key_rule_t('cost', 'file', text, now, '', 'the table to write (CSV)')]

  type(value_rule_t), parameter :: value_rules(*) = [value_rule_t ::]

  character(len=*), parameter :: companion = '_expression'

contains

  !> Check that a scene says nothing but what the format has and this version can act upon.
  !> What a key's value must be beside its type is left to whoever reads it.
  subroutine check_against_contract(scene, error)
    !> The scene
    type(scene_file_t), intent(in) :: scene
    !> The first thing that is wrong: an unknown group or key (with the nearest known one), a group
    !> that may not stand twice, a value of the wrong type, a number and an expression for the same
    !> thing, or something that this version cannot act upon yet
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
    if (.not. rule%available) purpose = purpose//' (not yet)'
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
    if (.not. rule%available) line = line//' (not yet)'
  end function key_line

  !> Check that a group exists, that this version has it, and that it may stand here.
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
      if (.not. group_rules(rule)%available) then
        call raise_at(error, group, '', 'this group is part of the scene format, but this '// &
                      'version of calor cannot '//trim(group_rules(rule)%purpose)// &
                      ' yet; remove the group.')
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
                        suggestion(key, key_names(group%name))//new_line('a')// &
                        'It has: '//join(key_names(group%name), ', ')//'.')
          return
        end if
        if (.not. key_rules(rule)%available) then
          call raise_at(error, group, key, 'this key is part of the scene format, but this '// &
                        'version of calor cannot act upon it yet; remove it.')
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
        call check_value(group, key, error)
        if (allocated(error)) return
      end associate
    end do
  end subroutine check_keys

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

  !> Refuse values that this version cannot act upon yet. Values that the format does not have are
  !> refused here as well, because the nearest valid one may be one for later.
  subroutine check_value(group, key, error)
    type(group_t), intent(in) :: group
    character(len=*), intent(in) :: key
    type(error_t), allocatable, intent(out) :: error
    type(error_t), allocatable :: not_logical
    character(len=:), allocatable :: value
    type(text_t), allocatable :: available(:), all_values(:)
    logical :: truth
    integer :: k

    do k = 1, size(value_rules)
      if (value_rules(k)%group /= group%name .or. value_rules(k)%key /= key) cycle
      if (value_rules(k)%available == '') then
        call refuse_later(group, key, value_rules(k)%later, error)
        return
      end if
      call get(group, key, truth, not_logical)
      if (allocated(not_logical)) then
        value = group%entries(group%find(key))%values(1)%text
      else
        value = trim(merge('.true. ', '.false.', truth))
      end if
      call split(value_rules(k)%available, available)
      if (is_among(value, available)) return
      call split(trim(value_rules(k)%available)//' '//value_rules(k)%later, all_values)
      if (is_among(value, all_values)) then
        call raise_at(error, group, key, 'this value is part of the scene format, but this '// &
                      'version of calor has only '//join(available, ', ')//' so far.')
      else
        call raise_at(error, group, key, 'there is no '''//value//''' to choose.'// &
                      suggestion(value, all_values)//new_line('a')// &
                      'There are: '//join(available, ', ')//' (later: '// &
                      join(all_values(size(available) + 1:), ', ')//').')
      end if
      return
    end do
  end subroutine check_value

  !> Refuse values of the format that this version cannot act upon yet, and no others.
  subroutine refuse_later(group, key, later, error)
    type(group_t), intent(in) :: group
    character(len=*), intent(in) :: key
    !> Those values
    character(len=*), intent(in) :: later
    type(error_t), allocatable, intent(out) :: error
    type(text_t), allocatable :: values(:)
    integer :: k

    call split(later, values)
    associate (given => group%entries(group%find(key))%values)
      do k = 1, size(given)
        if (.not. is_among(lower_case(given(k)%text), values)) cycle
        call raise_at(error, group, key, ''''//given(k)%text//''' is part of the scene format, '// &
                      'but this version of calor does not have it yet; take another.')
        return
      end do
    end associate
  end subroutine refuse_later

  !> The words of a line.
  pure subroutine split(line, words)
    character(len=*), intent(in) :: line
    type(text_t), allocatable, intent(out) :: words(:)
    integer :: count, first, k, number_of_words

    number_of_words = 0
    do k = 1, len(line)
      if (starts_word(line, k)) number_of_words = number_of_words + 1
    end do
    allocate (words(number_of_words))
    count = 0
    do k = 1, len(line)
      if (.not. starts_word(line, k)) cycle
      count = count + 1
      first = k
      words(count)%value = line(first:first + index(line(first:)//' ', ' ') - 2)
    end do
  end subroutine split

  pure function starts_word(line, position)
    character(len=*), intent(in) :: line
    integer, intent(in) :: position
    logical :: starts_word

    starts_word = line(position:position) /= ' '
    if (position > 1) starts_word = starts_word .and. line(position - 1:position - 1) == ' '
  end function starts_word

  pure function is_among(word, words)
    character(len=*), intent(in) :: word
    type(text_t), intent(in) :: words(:)
    logical :: is_among
    integer :: k

    is_among = .false.
    do k = 1, size(words)
      if (words(k)%value == word) is_among = .true.
    end do
  end function is_among

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

  !> The groups that this version can act upon.
  pure function contract_groups() result(names)
    type(text_t), allocatable :: names(:)
    integer :: k, count

    allocate (names(size(pack(group_rules%available, group_rules%available))))
    count = 0
    do k = 1, size(group_rules)
      if (.not. group_rules(k)%available) cycle
      count = count + 1
      names(count)%value = trim(group_rules(k)%name)
    end do
  end function contract_groups

  !> The keys of a group that this version can act upon.
  pure function key_names(group) result(names)
    character(len=*), intent(in) :: group
    type(text_t), allocatable :: names(:)
    integer :: k, count

    count = 0
    do k = 1, size(key_rules)
      if (key_rules(k)%available .and. key_rules(k)%group == group) count = count + 1
    end do
    allocate (names(count))
    count = 0
    do k = 1, size(key_rules)
      if (.not. (key_rules(k)%available .and. key_rules(k)%group == group)) cycle
      count = count + 1
      names(count)%value = trim(key_rules(k)%name)
    end do
  end function key_names

end module calor_scene_contract
