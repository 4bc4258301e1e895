!> What a body consists of, where that is not one constant isotropic material: the groups &material
!> of a scene, each with its region and its properties as expressions of x, y and T.
!>
!> Where regions overlap, the later group wins. A conductivity is a tensor [κxx κxy; κxy κyy]. What
!> depends on the place and on the temperature is a product of a function of either: properties at
!> places are those at a reference temperature, and how they change with it is a calor_heat_law. An
!> isotropic conductivity need not be such a product: see calor_local_conductivity.
module calor_materials
  use calor_error, only: error_t, raise, status_bad_input
  use calor_expression, only: expression_t, compile_expression
  use calor_kinds, only: wp
  use calor_scene_file, only: scene_file_t, group_t
  use calor_scene_getters, only: get_expression, get_varying, place_of, raise_at
  use calor_text, only: text_t, to_text, append
  implicit none (type, external)
  private

  public :: materials_t, material_t, read_materials, conductivity_names

  !> The components of a conductivity, in the order of the arrays below
  character(len=*), parameter :: conductivity_names(3) = &
      [character(len=15) :: 'conductivity_xx', 'conductivity_yy', 'conductivity_xy']

  !> One material. Its expressions are texts: arrays of compiled ones are more than gfortran 12 can
  !> finalise, and to compile one costs nothing beside its values at all particles.
  type :: material_t
    !> κxx, κyy and κxy, W/(m K); all three the same but for κxy = 0 where it is isotropic
    type(text_t) :: conductivity(3)
    !> kg/m³, and J/(kg K)
    type(text_t) :: density, heat_capacity
    !> Where it is, unless everywhere
    type(text_t) :: region
    logical :: everywhere = .true.
    !> Whether heat flows along the gradient
    logical :: isotropic = .true.
    !> Whether the conductivity depends on x or y
    logical :: graded = .false.
    !> Whether the conductivity, and whether density or heat capacity depend on the temperature
    logical :: conducts_by_temperature = .false., stores_by_temperature = .false.
    !> Whether density or heat capacity depend on x or y
    logical :: stores_by_place = .false.
    !> Whether the conductivity is a product of a function of the place and one of the temperature
    logical :: is_product = .true.
    !> Where the scene has the conductivity, the density and the heat capacity
    character(len=:), allocatable :: place, density_place, capacity_place
    !> Where it says where it is; empty where it is everywhere
    character(len=:), allocatable :: region_place
  contains
    !> Whether its properties are the same everywhere and at all temperatures
    procedure :: is_constant => has_constant_properties
  end type material_t

  !> All materials of a scene
  type :: materials_t
    type(material_t), allocatable :: list(:)
    !> The reference temperature
    real(wp) :: reference = 0.0_wp
  contains
    !> The material at each of some places; 0 where there is none
    procedure :: which
    !> Properties of one material at some places
    procedure :: conductivity_at
    procedure :: capacity_at
    !> Derivatives of its conductivity
    procedure :: conductivity_gradient
    !> All properties at a cloud's particles, checked
    procedure :: fill
    !> Check that they are positive, and products, at all temperatures of a range
    procedure :: check_range
    !> What of them is more than one constant isotropic material, and where the scene says so
    procedure :: in_force
    procedure, private :: evaluate
  end type materials_t

contains

  !> Read the groups &material of a scene. Where they say that the body is of one constant isotropic
  !> material, `materials%list` is not allocated.
  subroutine read_materials(file, materials, error)
    !> The groups of the scene
    type(scene_file_t), intent(in) :: file
    !> The materials
    type(materials_t), intent(out) :: materials
    !> Something in them is wrong
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group
    integer :: k

    if (file%count('material') == 0) return
    if (file%count('material') == 1) then
      call file%group('material', group)
      if (is_constant(group)) return
    end if
    allocate (materials%list(file%count('material')))
    do k = 1, size(materials%list)
      call file%group('material', group, k)
      call read_one(group, materials%list(k), error)
      if (allocated(error)) return
    end do
  end subroutine read_materials

  !> Whether a group says nothing but numbers for an isotropic material everywhere
  function is_constant(group) result(answer)
    type(group_t), intent(in) :: group
    logical :: answer
    !> What melting takes does not make a material vary
    character(len=*), parameter :: plain_keys(*) = [character(len=13) :: 'conductivity', &
        'density', 'heat_capacity', 'latent_heat', 'solidus', 'liquidus']
    integer :: k

    answer = .true.
    do k = 1, size(group%entries)
      associate (key => group%entries(k)%key)
        if (all(key /= plain_keys)) answer = .false.
      end associate
    end do
  end function is_constant

  subroutine read_one(group, material, error)
    type(group_t), intent(in) :: group
    type(material_t), intent(inout) :: material
    type(error_t), allocatable, intent(out) :: error
    type(expression_t) :: region
    character(len=:), allocatable :: key
    integer :: k

    do k = 1, size(conductivity_names)
      key = trim(conductivity_names(k))
      if (group%has(key) .or. group%has(key//'_expression')) material%isotropic = .false.
    end do
    if (material%isotropic) then
      call read_value(group, 'conductivity', material%conductivity(1), material%place, error, &
                      1.0_wp, material)
      if (allocated(error)) return
      material%conductivity(2) = material%conductivity(1)
    else
      if (group%has('conductivity') .or. group%has('conductivity_expression')) then
        call raise_at(error, group, '', 'give either conductivity, or conductivity_xx and '// &
                      'conductivity_yy and perhaps conductivity_xy.')
        return
      end if
      do k = 3, 1, -1
        ! κxy is 0 unless given, the others have no value of their own.
        if (k == 3) then
          call read_value(group, trim(conductivity_names(k)), material%conductivity(k), &
                          material%place, error, 0.0_wp, &
                          material)
        else
          call read_value(group, trim(conductivity_names(k)), material%conductivity(k), &
                          material%place, error, material=material)
        end if
        if (allocated(error)) return
      end do
    end if
    call read_value(group, 'density', material%density, material%density_place, error, 1.0_wp, &
                    warms=material%stores_by_temperature, varies=material%stores_by_place)
    if (allocated(error)) return
    call read_value(group, 'heat_capacity', material%heat_capacity, material%capacity_place, &
                    error, 1.0_wp, warms=material%stores_by_temperature, &
                    varies=material%stores_by_place)
    if (allocated(error)) return
    material%everywhere = .not. group%has('where_expression')
    material%region_place = ''
    if (material%everywhere) return
    call get_expression(group, 'where_expression', region, error)
    if (allocated(error)) return
    material%region%value = region%source()
    material%region_place = place_of(group, 'where_expression')
    if (.not. (region%uses('t') .or. region%uses('T'))) return
    call raise_at(error, group, 'where_expression', 'it may depend on x and y only.')
  end subroutine read_one

  !> Read a property; of a conductivity, note what it depends on.
  subroutine read_value(group, key, text, place, error, default, material, warms, &
                        varies)
    type(group_t), intent(in) :: group
    !> The key without `_expression`
    character(len=*), intent(in) :: key
    !> The expression
    type(text_t), intent(inout) :: text
    !> Where the scene has it
    character(len=:), allocatable, intent(inout) :: place
    type(error_t), allocatable, intent(out) :: error
    real(wp), intent(in), optional :: default
    !> Whose conductivity it is
    type(material_t), intent(inout), optional :: material
    !> Becomes true where it depends on the temperature
    logical, intent(inout), optional :: warms
    !> Becomes true where it depends on the place
    logical, intent(inout), optional :: varies
    type(expression_t) :: expression

    call get_varying(group, key, expression, error, default)
    if (allocated(error)) return
    text%value = expression%source()
    place = place_of(group, key)
    if (group%has(key//'_expression')) place = place_of(group, key//'_expression')
    if (expression%uses('t')) then
      call raise_at(error, group, &
                    key//'_expression', 'it may depend on x, y and T only, not on '// &
                    'the time.')
      return
    end if
    if (present(warms)) warms = warms .or. expression%uses('T')
    if (present(varies)) varies = varies .or. expression%uses('x') .or. expression%uses('y')
    if (.not. present(material)) return
    if (expression%uses('x') .or. expression%uses('y')) material%graded = .true.
    if (expression%uses('T')) material%conducts_by_temperature = .true.
  end subroutine read_value

  function in_force(this) result(texts)
    class(materials_t), intent(in) :: this
    !> A text for each such thing
    type(text_t), allocatable :: texts(:)
    integer :: k

    allocate (texts(0))
    if (.not. allocated(this%list)) return
    do k = 1, size(this%list)
      associate (one => this%list(k))
        if (.not. one%everywhere) then
          call append(texts, 'material in a region ('//one%region_place//')')
        end if
        if (.not. one%isotropic) call append(texts, 'anisotropic conductivity ('//one%place//')')
        if (one%graded) call append(texts, 'conductivity of the place ('//one%place//')')
        if (one%conducts_by_temperature) then
          call append(texts, 'conductivity of the temperature ('//one%place//')')
        end if
        if (one%stores_by_place) then
          call append(texts, 'heat capacity of the place ('//varying_place(one)//')')
        end if
        if (one%stores_by_temperature) then
          call append(texts, 'heat capacity of the temperature ('//varying_place(one)//')')
        end if
      end associate
    end do
  end function in_force

  !> Where the scene has the density or the heat capacity that is an expression, or both
  pure function varying_place(material) result(place)
    type(material_t), intent(in) :: material
    character(len=:), allocatable :: place

    associate (one => material%density_place, two => material%capacity_place)
      place = one
      if (index(two, '_expression') == 0) return
      place = two
      if (index(one, '_expression') > 0) place = one//', '//two
    end associate
  end function varying_place

  subroutine which(this, x, y, material)
    class(materials_t), intent(in) :: this
    !> Places, m
    real(wp), intent(in) :: x(:), y(:)
    !> Position in `list`, 0 where no material is
    integer, intent(out) :: material(:)
    real(wp), allocatable :: inside(:)
    integer :: k

    material = 0
    allocate (inside(size(x)))
    do k = 1, size(this%list)
      if (this%list(k)%everywhere) then
        material = k
      else
        call this%evaluate(this%list(k)%region, x, y, inside)
        ! As everywhere in a scene, 0 is no and any number else is yes; NaN is no.
        where (abs(inside) > 0) material = k
      end if
    end do
  end subroutine which

  subroutine conductivity_at(this, material, x, y, conductivity)
    class(materials_t), intent(in) :: this
    !> Position in `list`
    integer, intent(in) :: material
    !> Places, m
    real(wp), intent(in) :: x(:), y(:)
    !> κxx, κyy, κxy, W/(m K): a column for each place
    real(wp), intent(out) :: conductivity(:, :)
    real(wp), allocatable :: value(:)
    integer :: k

    allocate (value(size(x)))
    associate (chosen => this%list(material))
      conductivity(3, :) = 0
      do k = 1, 3
        if (k > 1 .and. chosen%isotropic) exit
        call this%evaluate(chosen%conductivity(k), x, y, value)
        conductivity(k, :) = value
      end do
      if (chosen%isotropic) conductivity(2, :) = conductivity(1, :)
    end associate
  end subroutine conductivity_at

  subroutine capacity_at(this, material, x, y, capacity)
    class(materials_t), intent(in) :: this
    !> Position in `list`
    integer, intent(in) :: material
    !> Places, m
    real(wp), intent(in) :: x(:), y(:)
    !> Density times heat capacity, J/(m³ K)
    real(wp), intent(out) :: capacity(:)
    real(wp), allocatable :: density(:)

    allocate (density(size(x)))
    call this%evaluate(this%list(material)%density, x, y, density)
    call this%evaluate(this%list(material)%heat_capacity, x, y, capacity)
    capacity = density*capacity
  end subroutine capacity_at

  elemental function has_constant_properties(this) result(answer)
    class(material_t), intent(in) :: this
    logical :: answer

    answer = .not. (this%graded .or. this%stores_by_place .or. this%conducts_by_temperature .or. &
                    this%stores_by_temperature)
  end function has_constant_properties

  !> The values of an expression that has been read before
  subroutine evaluate(this, text, x, y, values)
    class(materials_t), intent(in) :: this
    type(text_t), intent(in) :: text
    real(wp), intent(in) :: x(:), y(:)
    real(wp), intent(out) :: values(:)
    type(expression_t) :: expression
    type(error_t), allocatable :: error

    call compile_expression(text%value, expression, error)
    call expression%evaluate(x, y, 0.0_wp, values, spread(this%reference, 1, size(x)))
  end subroutine evaluate

  !> By central differences of fourth order: an expression has no other derivative.
  subroutine conductivity_gradient(this, material, x, y, step, along_x, along_y)
    class(materials_t), intent(in) :: this
    !> Position in `list`
    integer, intent(in) :: material
    !> Places, m
    real(wp), intent(in) :: x(:), y(:)
    !> Step of the differences, m
    real(wp), intent(in) :: step
    !> ∂/∂x and ∂/∂y of κxx, κyy, κxy, a column for each place
    real(wp), intent(out) :: along_x(:, :), along_y(:, :)
    real(wp), allocatable :: value(:, :)
    real(wp), parameter :: place(4) = [-2.0_wp, -1.0_wp, 1.0_wp, 2.0_wp], &
        factor(4) = [1.0_wp, -8.0_wp, 8.0_wp, -1.0_wp]/12
    integer :: k

    along_x = 0
    along_y = 0
    if (.not. this%list(material)%graded) return
    allocate (value(3, size(x)))
    do k = 1, size(place)
      call this%conductivity_at(material, x + place(k)*step, y, value)
      along_x = along_x + factor(k)/step*value
      call this%conductivity_at(material, x, y + place(k)*step, value)
      along_y = along_y + factor(k)/step*value
    end do
  end subroutine conductivity_gradient

  !> Every particle needs a material, a positive capacity and a positive definite conductivity.
  subroutine fill(this, x, y, path, material, conductivity, capacity, error)
    class(materials_t), intent(in) :: this
    !> Coordinates of the particles, m
    real(wp), intent(in) :: x(:), y(:)
    !> The scene, for messages
    character(len=*), intent(in) :: path
    !> The material of each particle
    integer, allocatable, intent(out) :: material(:)
    !> κxx, κyy, κxy, W/(m K), a column for each particle
    real(wp), allocatable, intent(out) :: conductivity(:, :)
    !> Density times heat capacity, J/(m³ K)
    real(wp), allocatable, intent(out) :: capacity(:)
    !> What is wrong, and where
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: value(:, :), product(:)
    integer, allocatable :: member(:)
    integer :: k, j, i
    character(len=:), allocatable :: what

    allocate (material(size(x)), conductivity(3, size(x)), capacity(size(x)))
    call this%which(x, y, material)
    k = findloc(material, 0, dim=1)
    if (k > 0) then
      call raise(error, status_bad_input, path//': no &material is at ('// &
                 to_text(x(k), digits=6)//', '//to_text(y(k), digits=6)//'); let the first '// &
                 '&material be without where_expression: it is wherever no other one is.')
      return
    end if
    do k = 1, size(this%list)
      member = pack([(i, i=1, size(x))], material == k)
      allocate (value(3, size(member)), product(size(member)))
      call this%conductivity_at(k, x(member), y(member), value)
      call this%capacity_at(k, x(member), y(member), product)
      conductivity(:, member) = value
      capacity(member) = product
      do j = 1, size(member)
        what = ''
        associate (kappa => value(:, j))
          if (.not. (kappa(1) > 0 .and. kappa(1) <= huge(1.0_wp) .and. kappa(2) > 0 .and. &
                     kappa(2) <= huge(1.0_wp))) then
            what = this%list(k)%place//': the conductivity must be greater than 0, not '// &
                   to_text(merge(kappa(2), kappa(1), kappa(1) > 0), digits=6)//' as'
          else if (.not. kappa(1)*kappa(2) - kappa(3)**2 > 0) then
            what = this%list(k)%place//': conductivity_xx conductivity_yy must be greater than '// &
                   'conductivity_xy squared, or heat would flow from cold to hot as'
          else if (.not. (product(j) > 0 .and. product(j) <= huge(1.0_wp))) then
            what = this%list(k)%density_place//', '//this%list(k)%capacity_place// &
                   ': density and heat capacity must be greater than 0; their product is '// &
                   to_text(product(j), digits=6)
          end if
        end associate
        if (what == '') cycle
        call raise(error, status_bad_input, what//' at ('//to_text(x(member(j)), digits=6)// &
                   ', '//to_text(y(member(j)), digits=6)//').')
        return
      end do
      deallocate (value, product)
    end do
  end subroutine fill

  !> Where a property depends on the temperature, it has to be positive at all that may occur, and
  !> the product of a function of the place and one of the temperature, unless it is the
  !> conductivity of an isotropic material.
  subroutine check_range(this, x, y, material, lowest, highest, error)
    class(materials_t), intent(inout) :: this
    !> Coordinates of the particles, m, and the material of each
    real(wp), intent(in) :: x(:), y(:)
    integer, intent(in) :: material(:)
    !> The range
    real(wp), intent(in) :: lowest, highest
    !> What is wrong, and where
    type(error_t), allocatable, intent(out) :: error
    integer, parameter :: temperatures = 17
    integer, allocatable :: member(:)
    integer :: k, i

    do k = 1, size(this%list)
      member = pack([(i, i=1, size(x))], material == k)
      if (size(member) == 0) cycle
      associate (one => this%list(k))
        if (one%conducts_by_temperature) then
          if (one%isotropic) then
            call check_product([one%conductivity(1)], one%place, one%is_product)
          else
            call check_product(one%conductivity, one%place)
          end if
          if (allocated(error)) return
        end if
        if (one%stores_by_temperature) then
          call check_product([one%density], one%density_place)
          if (allocated(error)) return
          call check_product([one%heat_capacity], one%capacity_place)
          if (allocated(error)) return
        end if
      end associate
    end do

  contains

    !> Whether all expressions are f(T) times what they are at the reference temperature, f > 0.
    !> Where the answer is not asked for it must be yes.
    subroutine check_product(texts, place, is_product)
      type(text_t), intent(in) :: texts(:)
      character(len=*), intent(in) :: place
      logical, intent(inout), optional :: is_product
      type(materials_t) :: warm
      real(wp) :: cold_value(size(member)), value(size(member)), factor
      real(wp), parameter :: rounding = 1.0e-9_wp
      integer :: component, step, worst

      do step = 0, temperatures - 1
        warm%reference = lowest + (highest - lowest)*step/(temperatures - 1)
        do component = 1, size(texts)
          call this%evaluate(texts(component), x(member), y(member), cold_value)
          call warm%evaluate(texts(component), x(member), y(member), value)
          if (component == 1) then
            factor = value(1)/cold_value(1)
            worst = findloc(value*cold_value > 0 .and. value/cold_value <= huge(factor), .false., &
                            dim=1)
            if (worst > 0) then
              call raise(error, status_bad_input, place//': it must be greater than 0 wherever '// &
                         'the temperature may come, not '//to_text(value(worst), digits=6)// &
                         ' as at T = '//to_text(warm%reference, digits=6)//'.')
              return
            end if
          end if
          if (all(abs(value - factor*cold_value) <= rounding*abs(factor*cold_value))) cycle
          if (present(is_product)) then
            is_product = .false.
            cycle
          end if
          call raise(error, status_bad_input, place//': how it depends on T must be the same '// &
                     'everywhere in the material, and for all components of a tensor: write it '// &
                     'as a function of x and y times a function of T, or give several groups '// &
                     '&material with where_expression.')
          return
        end do
      end do
    end subroutine check_product

  end subroutine check_range

end module calor_materials
