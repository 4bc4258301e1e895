!> A scene: everything that a scene file says, as values of the right types.
module calor_scene
  use calor_kinds, only: wp
  use calor_scene_file, only: scene_file_t
  use calor_taylor_weights, only: default_order
  use calor_text, only: text_t
  implicit none (type, external)
  private

  public :: scene_t, accuracy_t, domain_t, uniform_material_t, boundary_t, time_t, output_t, &
            checkpoint_settings_t, motion_settings_t, operators_t, cost_t

  !> What is asked of the error
  type :: accuracy_t
    !> Whether a run estimates its own error
    logical :: estimate = .false.
    !> The relative L2 error to reach; 0: none
    real(wp) :: target = 0.0_wp
    !> Where the scene says so
    character(len=:), allocatable :: place
  end type accuracy_t

  !> Where the body is and how particles fill it
  type :: domain_t
    !> One of the names in `shape_choices`
    character(len=:), allocatable :: shape
    !> Edges of a rectangle, m
    real(wp) :: x_range(2) = [0.0_wp, 1.0_wp], y_range(2) = [0.0_wp, 1.0_wp]
    !> Centre of a disc or annulus, its radius and its inner radius, m
    real(wp) :: centre(2) = 0.0_wp, radius = 1.0_wp, inner_radius = 0.5_wp
    !> Corners of a polygon and of its holes as `make_polygon_body` takes them, m
    real(wp), allocatable :: vertices(:), hole_vertices(:)
    !> File of a user's cloud
    character(len=:), allocatable :: file
    !> Distance between neighbouring particles, m; 0 if it was not given
    real(wp) :: spacing = 0.0_wp
    !> One of the names in `arrangement_choices`
    character(len=:), allocatable :: arrangement
    !> Displacement of particles in units of the spacing, and the seed of its random numbers
    real(wp) :: jitter = 0.0_wp
    integer :: seed = 1
    !> Where the scene file says so
    character(len=:), allocatable :: place
  end type domain_t

  !> What a body of one constant isotropic material consists of
  type :: uniform_material_t
    !> W/(m K), kg/m³, J/(kg K)
    real(wp) :: conductivity = 1.0_wp, density = 1.0_wp, heat_capacity = 1.0_wp
  end type uniform_material_t

  !> What holds on a part of the boundary
  type :: boundary_t
    !> Name of the boundary, or 'all'
    character(len=:), allocatable :: on
    !> 'temperature', or the name of an effect that a wall calls for
    character(len=:), allocatable :: kind
    !> The temperature as a number, or as an expression of x, y and t where that is not empty
    real(wp) :: value = 0.0_wp
    character(len=:), allocatable :: value_expression
    !> Where on the wall, as an expression of x and y; '': everywhere
    character(len=:), allocatable :: where_expression
    !> Where the scene file says so
    character(len=:), allocatable :: place
  end type boundary_t

  !> How the body and its particles move; the velocity is read by calor_scene_motion
  type :: motion_settings_t
    !> Whether they do
    logical :: in_force = .false.
    !> The longest time with one set of rows, s; 0: chosen by the program
    real(wp) :: step = 0.0_wp
    !> Skin of the neighbour lists in spacings
    real(wp) :: skin = 0.5_wp
    !> Whether particles are kept evenly spread
    logical :: shifting = .false.
    !> Where the scene file says so
    character(len=:), allocatable :: place
  end type motion_settings_t

  !> The time span and the method
  type :: time_t
    !> s
    real(wp) :: end = 0.0_wp
    !> Fixed step, s; 0: chosen by the program
    real(wp) :: step = 0.0_wp
    !> One of the names in `integrator_choices`
    character(len=:), allocatable :: method
    !> Whether 'auto' means RKL2, as for studies that vary the steps
    logical :: only_rkl2 = .false.
    !> Whether 'auto' means the exponential propagator where it can be used, and RKL2 where not, for
    !> runs so short that no trial would pay
    logical :: without_trial = .false.
    !> Error that one step may make, as a fraction of the range of given temperatures; 0: not given
    real(wp) :: tolerance = 0.0_wp
    !> Whether only the steady temperature is asked for
    logical :: steady = .false.
    !> Where the scene file says so
    character(len=:), allocatable :: place
  end type time_t

  !> What is written
  type :: output_t
    !> Path of the file; '': nothing is written
    character(len=:), allocatable :: file
    !> Time between written states, s; 0: only the first and the last
    real(wp) :: every = 0.0_wp
    !> Where the scene file says so
    character(len=:), allocatable :: place
    !> Names of the fields
    type(text_t), allocatable :: fields(:)
  end type output_t

  !> When the state of a run is laid aside, and where
  type :: checkpoint_settings_t
    !> Whether the scene asks for it
    logical :: asked = .false.
    !> Path of the file; where the scene names none, that of a run that is interrupted
    character(len=:), allocatable :: file
    !> Wall time and simulated time between two, s; 0: no matter
    real(wp) :: every_seconds = 0.0_wp, every = 0.0_wp
    !> How many are kept
    integer :: keep = 1
    !> Where the scene file says so
    character(len=:), allocatable :: place
  end type checkpoint_settings_t

  !> What `calor operators` evaluates
  type :: operators_t
    !> The field as an expression of x and y; '': the scene has no &operators
    character(len=:), allocatable :: field_expression
    !> Names of the schemes
    type(text_t), allocatable :: gradients(:), laplacians(:)
    !> The true derivatives, or ''
    character(len=:), allocatable :: exact_gradient_x, exact_gradient_y, exact_laplacian
    !> Path of the file; '': nothing is written
    character(len=:), allocatable :: file
    !> Where the scene file says so
    character(len=:), allocatable :: place
  end type operators_t

  !> What `calor cost` compares
  type :: cost_t
    !> Distances between particles, m, and support radii in spacings; none: chosen by the program
    real(wp), allocatable :: spacings(:), supports(:)
    !> Names of the schemes
    type(text_t), allocatable :: laplacians(:)
    !> Orders of the scheme `consistent`
    integer, allocatable :: orders(:)
    !> How often each entry is timed
    integer :: repetitions = 5
    !> No measurement is begun that would not be over after this time, s
    real(wp) :: seconds = 600.0_wp
    !> Relative L2 error that the sentence at the end speaks of; 0: chosen by the program
    real(wp) :: target = 0.0_wp
    !> Path of the table (CSV)
    character(len=:), allocatable :: file
    !> Where the scene file says so, and where it gives the spacings
    character(len=:), allocatable :: place, spacings_place
  end type cost_t

  !> A scene
  type :: scene_t
    !> Path and whole text of the scene file
    character(len=:), allocatable :: path, text
    character(len=:), allocatable :: title
    !> The true temperature as an expression of x, y and t, or ''
    character(len=:), allocatable :: exact_expression
    !> Where the scene file gives it, and the temperature at the start
    character(len=:), allocatable :: exact_place, initial_place
    type(domain_t) :: domain
    !> Name of the smoothing kernel, and its support radius in units of the spacing
    character(len=:), allocatable :: kernel
    real(wp) :: support = 2.1_wp
    !> Where the scene file gives the support
    character(len=:), allocatable :: support_place
    !> Names of the derivative schemes
    character(len=:), allocatable :: laplacian, gradient
    !> Order of the consistent schemes
    integer :: order = default_order
    !> Whether poor rows are repaired
    logical :: support_growth = .true.
    !> Whether steps take weights in single precision
    logical :: single_weights = .false.
    !> Whether rows that cannot be exact, and an unstable operator, are run nevertheless
    logical :: allow_inexact_rows = .false., allow_unstable = .false.
    !> Whether the body is of one constant isotropic material, and that; the groups of any other are
    !> read by calor_materials
    logical :: uniform_material = .true.
    type(uniform_material_t) :: material
    !> Whether it says what melting takes; the effect reads how much
    logical :: melts = .false.
    !> The temperature at the start as a number, or as an expression where that is not empty
    real(wp) :: initial_temperature = 0.0_wp
    character(len=:), allocatable :: initial_expression
    type(boundary_t), allocatable :: boundaries(:)
    type(motion_settings_t) :: motion
    type(time_t) :: time
    type(output_t) :: output
    type(checkpoint_settings_t) :: checkpoint
    type(accuracy_t) :: accuracy
    type(operators_t) :: operators
    type(cost_t) :: cost
    !> The groups as they stand in the scene: effects read theirs from here
    type(scene_file_t) :: file
  end type scene_t

end module calor_scene
