!> Commented scenes to start from, each of which runs in seconds.
module calor_starting_scenes
  use calor_choice, only: choice_t
  use calor_kinds, only: wp, i8
  use calor_random, only: random_uniform
  use calor_text, only: text_t, text_list, to_text
  implicit none (type, external)
  private

  public :: starting_scenes, starting_scene, own_particles

  !> What there is
  type(choice_t), parameter :: starting_scenes(*) = [ &
      choice_t('plate', 'walls held at zero; the true temperature is known'), &
      choice_t('slab', 'one side is suddenly hot, the others are insulated'), &
      choice_t('disc', 'a warm disc cools by radiation'), &
      choice_t('fin', 'a cooling fin: hot foot, convection all around, steady'), &
      choice_t('two_materials', 'insulation on a metal plate'), &
      choice_t('hot_spot', 'a source on a chip with a cooled back'), &
      choice_t('rotating_disc', 'a brake disc turns past its pad'), &
      choice_t('melting', 'a block of ice melts from one side'), &
      choice_t('cloud', 'particles of your own, in a CSV file that is written too') &
      ]

  !> Every line of a scene; @ stands for its name
  integer, parameter :: width = 92

  character(len=width), parameter :: plate(*) = [character(len=width) :: &
      '! A scene for calor: calor check says what it simulates, calor run does it.', &
      '! Groups may come in any order. SI units.', &
      '', &
      '&scene     title = ''@''', &
      '           ! The true temperature, if you know it: the run then reports its error', &
      '           exact_expression = ''sin(pi*x)*sin(pi*y)*exp(-2*pi^2*t)'' /', &
      '', &
      '&domain    shape = ''rectangle''      ! or disc, annulus, polygon, cloud', &
      '           x_range = 0.0, 1.0       ! m', &
      '           y_range = 0.0, 1.0', &
      '           spacing = 0.025          ! between neighbouring particles, m', &
      '           arrangement = ''jittered'' ! or lattice, hexagonal, relaxed', &
      '           jitter = 0.2             ! displacement in units of the spacing', &
      '           seed = 1 /', &
      '', &
      '&kernel    name = ''wendland_c2''     ! or cubic_spline, quintic_spline, wendland_c4, _c6', &
      '           support = 2.1 /          ! support radius in units of the spacing', &
      '', &
      '&scheme    laplacian = ''fatehi_manzari'' / ! calor schemes lists them', &
      '', &
      '&material  conductivity = 1.0       ! W/(m K)', &
      '           density = 1.0            ! kg/m3', &
      '           heat_capacity = 1.0 /    ! J/(kg K)', &
      '', &
      '&initial   temperature_expression = ''sin(pi*x)*sin(pi*y)'' /', &
      '', &
      '&boundary  on = ''all''               ! or left, right, bottom, top; may be repeated', &
      '           kind = ''temperature''     ! held at a value or value_expression of x, y, t', &
      '           value = 0.0 /', &
      '', &
      '&time      end = 0.05               ! s', &
      '           method = ''auto''          ! or rkl2, runge_kutta_4, forward_euler', &
      '           tolerance = 1.0e-6 /     ! error of a step over the temperature range', &
      '', &
      '&output    file = ''@.vtkhdf''      ! opens in ParaView', &
      '           every = 0.01             ! s', &
      '           fields = ''temperature'', ''error'' / ! and exact, where the truth is known' &
      ]

  character(len=width), parameter :: slab(*) = [character(len=width) :: &
      '! A brick wall, 20 cm thick: its left side is suddenly at 60 degrees.', &
      '', &
      '&scene     title = ''@'' /', &
      '', &
      '&domain    x_range = 0.0, 0.2  y_range = 0.0, 0.05   ! m', &
      '           spacing = 0.005 /', &
      '', &
      '&material  conductivity = 0.8  density = 1800.0  heat_capacity = 900.0 /', &
      '', &
      '&initial   temperature = 293.15 /                    ! K', &
      '', &
      '! Later boundaries count where several speak of one wall.', &
      '&boundary  on = ''all''   kind = ''insulated'' /', &
      '&boundary  on = ''left''  kind = ''temperature''  value = 333.15 /', &
      '', &
      '&time      end = 14400.0  tolerance = 1.0e-5 /       ! 4 hours', &
      '', &
      '&output    file = ''@.vtkhdf''  every = 1800.0 /' &
      ]

  character(len=width), parameter :: disc(*) = [character(len=width) :: &
      '! A glowing disc of steel, 10 cm across, radiates into a room. All temperatures in K.', &
      '', &
      '&scene     title = ''@'' /', &
      '', &
      '&domain    shape = ''disc''  centre = 0.0, 0.0  radius = 0.05', &
      '           spacing = 0.0025  arrangement = ''relaxed''  seed = 1 /', &
      '', &
      '&material  conductivity = 30.0  density = 7800.0  heat_capacity = 600.0 /', &
      '', &
      '&initial   temperature = 1200.0 /', &
      '', &
      '&boundary  on = ''outer''  kind = ''radiation''  emissivity = 0.8  ambient = 293.15 /', &
      '', &
      '&time      end = 600.0  tolerance = 1.0e-5 /', &
      '', &
      '&output    file = ''@.vtkhdf''  every = 60.0 /' &
      ]

  character(len=width), parameter :: fin(*) = [character(len=width) :: &
      '! A cooling fin of aluminium, 4 cm long and 4 mm thick, on a foot at 80 degrees. The', &
      '! coefficient is that of a fan. Steady: there is no time, and one state is written.', &
      '', &
      '&scene     title = ''@'' /', &
      '', &
      '&domain    x_range = 0.0, 0.04  y_range = 0.0, 0.004', &
      '           spacing = 0.0004 /', &
      '', &
      '&material  conductivity = 200.0 /', &
      '', &
      '&boundary  on = ''all''   kind = ''convection''  coefficient = 100.0  ambient = 293.15 /', &
      '&boundary  on = ''left''  kind = ''temperature''  value = 353.15 /', &
      '', &
      '&time      steady = .true. /', &
      '', &
      '&output    file = ''@.vtkhdf'' /' &
      ]

  character(len=width), parameter :: two_materials(*) = [character(len=width) :: &
      '! Mineral wool on an aluminium plate: a warm room on the left, a cold one on the right.', &
      '! Between the materials temperature and heat flux are continuous.', &
      '', &
      '&scene     title = ''@'' /', &
      '', &
      '&domain    x_range = 0.0, 0.06  y_range = 0.0, 0.03', &
      '           spacing = 0.0015 /', &
      '', &
      '! The later material holds where both say they do: here with a web through the wool.', &
      '&material  conductivity = 0.04  density = 100.0  heat_capacity = 800.0 /', &
      '&material  conductivity = 200.0  density = 2700.0  heat_capacity = 900.0', &
      '           where_expression = ''x > 0.045 || abs(y - 0.015) < 0.002'' /', &
      '', &
      '&initial   temperature = 278.15 /', &
      '', &
      '&boundary  on = ''all''    kind = ''insulated'' /', &
      '&boundary  on = ''left''   kind = ''convection''  coefficient = 8.0  ambient = 293.15 /', &
      '&boundary  on = ''right''  kind = ''convection''  coefficient = 25.0  ambient = 273.15 /', &
      '', &
      '&time      end = 600.0  tolerance = 1.0e-4 /', &
      '', &
      '&output    file = ''@.vtkhdf''  every = 100.0 /' &
      ]

  character(len=width), parameter :: hot_spot(*) = [character(len=width) :: &
      '! A chip of silicon, 10 mm by 0.5 mm in section: a small part of its top works for 20 ms,', &
      '! and its back is cooled.', &
      '', &
      '&scene     title = ''@'' /', &
      '', &
      '&domain    x_range = 0.0, 0.01  y_range = 0.0, 0.0005', &
      '           spacing = 0.00005 /', &
      '', &
      '&material  conductivity = 130.0  density = 2330.0  heat_capacity = 700.0 /', &
      '', &
      '&initial   temperature = 293.15 /', &
      '', &
      '! 3 mm to 4 mm from the left, the upper 0.1 mm; W/m3, switched off at 20 ms', &
      '&source    power_expression = ''t < 0.02 ? 1e10 : 0''', &
      '           where_expression = ''abs(x - 0.0035) < 0.0005 && y > 0.0004'' /', &
      '', &
      '&boundary  on = ''all''     kind = ''insulated'' /', &
      '&boundary  on = ''bottom''  kind = ''convection''  coefficient = 2e4  ambient = 293.15 /', &
      '', &
      '&time      end = 0.04  tolerance = 1.0e-4 /', &
      '', &
      '&output    file = ''@.vtkhdf''  every = 0.002 /' &
      ]

  character(len=width), parameter :: rotating_disc(*) = [character(len=width) :: &
      '! A brake disc of steel, 20 cm across, turns once in a second past the pad that heats it.', &
      '! The particles turn with the disc; the pad stays where it is.', &
      '', &
      '&scene     title = ''@'' /', &
      '', &
      '&domain    shape = ''annulus''  centre = 0.0, 0.0  radius = 0.1  inner_radius = 0.04', &
      '           spacing = 0.004 /', &
      '', &
      '&material  conductivity = 45.0  density = 7800.0  heat_capacity = 470.0 /', &
      '', &
      '&initial   temperature = 293.15 /', &
      '', &
      '! 2 pi radians in a second, anticlockwise', &
      '&motion    velocity_x_expression = ''-2*pi*y''', &
      '           velocity_y_expression = ''2*pi*x'' /', &
      '', &
      '! The pad, 2 cm wide, brakes for 2 s; W/m3', &
      '&source    power_expression = ''t < 2 ? 4e9 : 0''', &
      '           where_expression = ''(x-0.08)^2 + y^2 < 0.01^2'' /', &
      '', &
      '&boundary  on = ''all''  kind = ''convection''  coefficient = 50.0  ambient = 293.15 /', &
      '', &
      '&time      end = 3.0  tolerance = 1.0e-4 /', &
      '', &
      '&output    file = ''@.vtkhdf''  every = 0.25 /' &
      ]

  character(len=width), parameter :: melting(*) = [character(len=width) :: &
      '! A block of ice at -10 degrees melts from its left side, held at 30 degrees.', &
      '', &
      '&scene     title = ''@'' /', &
      '', &
      '&domain    x_range = 0.0, 0.04  y_range = 0.0, 0.02', &
      '           spacing = 0.001 /', &
      '', &
      '! Water has the properties of ice here; solidus and liquidus may differ, as for alloys.', &
      '&material  conductivity = 2.2  density = 917.0  heat_capacity = 2100.0', &
      '           latent_heat = 334.0e3  solidus = 273.15  liquidus = 273.15 /', &
      '', &
      '&initial   temperature = 263.15 /', &
      '', &
      '&boundary  on = ''all''   kind = ''insulated'' /', &
      '&boundary  on = ''left''  kind = ''temperature''  value = 303.15 /', &
      '', &
      '&time      end = 600.0  tolerance = 1.0e-4 /', &
      '', &
      '&output    file = ''@.vtkhdf''  every = 60.0', &
      '           fields = ''temperature'', ''liquid_fraction'' /' &
      ]

  character(len=width), parameter :: cloud(*) = [character(len=width) :: &
      '! Particles of your own: @.csv lies beside this scene. Its first line names its columns:', &
      '! x and y in m; volume, the area that a particle stands for, in m2 (or &domain spacing);', &
      '! wall, 1 on the boundary and 0 inside.', &
      '', &
      '&scene     title = ''@'' /', &
      '', &
      '&domain    shape = ''cloud''  file = ''@.csv'' /', &
      '', &
      '&kernel    support = 2.1 /', &
      '', &
      '&material  conductivity = 1.0  density = 1.0  heat_capacity = 1.0 /', &
      '', &
      '&initial   temperature_expression = ''exp(-20*((x-0.3)^2+(y-0.4)^2))'' /', &
      '', &
      '! All walls of a cloud are one boundary, called wall.', &
      '&boundary  on = ''all''  kind = ''temperature''  value = 0.0 /', &
      '', &
      '&time      end = 0.02 /', &
      '', &
      '&output    file = ''@.vtkhdf''  every = 0.005 /' &
      ]

contains

  !> The lines of a scene of the table, with @ for its name.
  function starting_scene(kind) result(lines)
    !> Its name in the table
    character(len=*), intent(in) :: kind
    type(text_t), allocatable :: lines(:)

    select case (kind)
    case ('plate')
      lines = text_list(plate)
    case ('slab')
      lines = text_list(slab)
    case ('disc')
      lines = text_list(disc)
    case ('fin')
      lines = text_list(fin)
    case ('two_materials')
      lines = text_list(two_materials)
    case ('hot_spot')
      lines = text_list(hot_spot)
    case ('rotating_disc')
      lines = text_list(rotating_disc)
    case ('melting')
      lines = text_list(melting)
    case default
      lines = text_list(cloud)
    end select
  end function starting_scene

  !> The particles that the scene `cloud` reads, as CSV: a unit square whose inner particles are
  !> displaced.
  function own_particles() result(text)
    character(len=:), allocatable :: text
    integer, parameter :: parts = 20
    character(len=*), parameter :: end = new_line('a')
    real(wp), parameter :: spacing = 1.0_wp/parts, displacement = 0.2_wp
    real(wp) :: x, y
    integer :: i, j
    logical :: wall

    text = 'x,y,volume,wall'//end
    do j = 0, parts
      do i = 0, parts
        wall = i == 0 .or. i == parts .or. j == 0 .or. j == parts
        x = i*spacing
        y = j*spacing
        if (.not. wall) then
          x = x + displacement*spacing*(2*random_uniform(1, int(i + (parts + 1)*j, i8)) - 1)
          y = y + displacement*spacing*(2*random_uniform(2, int(i + (parts + 1)*j, i8)) - 1)
        end if
        text = text//to_text(x, digits=6)//','//to_text(y, digits=6)//','// &
               to_text(spacing**2, digits=6)//','//merge('1', '0', wall)//end
      end do
    end do
  end function own_particles

end module calor_starting_scenes
