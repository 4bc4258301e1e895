!> The motion of a scene's body: its particles are carried by a given velocity, and rows follow
!> them.
!>
!> In the frame of the particles the heat equation has no convection: ρc dT/dt = div(κ∇T) + q along
!> the paths. One step of the motion, of length H, takes the rows of the cloud in the middle of its
!> path for the whole of it: dT/dt = A(t + H/2) T. That is the exponential midpoint rule, of second
!> order in H for parabolic problems too (C. González, A. Ostermann, M. Thalhammer, J. Comput. Appl.
!> Math. 189 (2006) 142–156). Within the step, time is integrated as where nothing moves.
!>
!> H is so short that no two neighbours change their distance by more than a given part. Where all
!> distances stay as they are, in translation and rotation, the rows stay too, and H is free.
module calor_scene_motion
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_body, only: body_t
  use calor_cell_area, only: find_cell_areas
  use calor_cloud, only: cloud_t
  use calor_conduction, only: conduction_t
  use calor_error, only: error_t, raise, status_bad_input, status_bad_numbers
  use calor_kinds, only: wp, ip, i8
  use calor_laplacian_consistent, only: natural_support
  use calor_moving_walls, only: moving_walls_t
  use calor_pair_motion, only: strain_rate, largest_strain, find_closest
  use calor_particle_path, only: particle_path_t
  use calor_places, only: places_t
  use calor_saved_state, only: saved_state_t
  use calor_scene, only: scene_t
  use calor_scene_evolution, only: row_maker_t, scene_rows_t
  use calor_scene_file, only: group_t
  use calor_shifting, only: find_even_places, carry_field
  use calor_skin_list, only: skin_list_t
  use calor_stopwatch, only: stopwatch_t
  use calor_text, only: to_text
  use calor_velocity, only: velocity_t
  implicit none (type, external)
  private

  public :: motion_t

  !> In a step of the motion no two neighbours change their distance by more than this part
  real(wp), parameter :: most_strain = 0.05_wp
  !> Rows serve as long as no two neighbours have changed their distance by more than this part
  real(wp), parameter :: least_strain = 1.0e-6_wp
  !> How far places may be wrong after a step, in spacings
  real(wp), parameter :: path_tolerance = 1.0e-6_wp
  !> A step of the motion is no longer than so many of the one before
  real(wp), parameter :: growth = 2.0_wp
  !> What the divergence of a velocity may be, as a part of its derivatives
  real(wp), parameter :: largest_divergence = 1.0e-6_wp
  !> Two particles that come nearer to each other than this, in spacings, meet
  real(wp), parameter :: nearest = 0.01_wp

  !> A motion under way
  type :: motion_t
    type(velocity_t) :: velocity
    !> Paths of the present step, and polynomials for them
    type(particle_path_t) :: path
    type(places_t) :: places
    !> The walls, which go with their particles
    type(moving_walls_t) :: walls
    !> Neighbours with a skin
    type(skin_list_t) :: near
    !> What makes rows
    type(row_maker_t) :: maker
    !> The scene's settings: longest step, s, and skin, m
    real(wp) :: longest_step = 0.0_wp, skin = 0.0_wp
    !> Whether a step is under way, with rows for its middle, and when it ends, s
    logical :: under_way = .false.
    real(wp) :: until = 0.0_wp
    !> Steps of the motion, those that were taken back because neighbours moved too much, and how
    !> often rows were made
    integer :: steps = 0, rejected = 0, assemblies = 0
    !> The time whose places the rows belong to, s
    real(wp) :: rows_time = 0.0_wp
    !> Places for which the rows were made, m
    real(wp), allocatable, private :: rows_x(:), rows_y(:)
    !> Support radii of the last rows, m: so far the next list of neighbours reaches
    real(wp), allocatable, private :: reach(:)
    !> Distance below which two particles meet, m
    real(wp), private :: least_distance = 0.0_wp
    !> The step before, s; 0: there was none
    real(wp), private :: last_step = 0.0_wp
  contains
    !> Make ready
    procedure :: prepare
    !> Choose the next step and find the paths
    procedure :: plan
    !> Go to the middle of the step
    procedure :: enter_middle
    !> Go to where particles are at a time of the step
    procedure :: go_to
    !> Find places where particles are spread evenly, take fields and particles there
    procedure :: find_shift
    procedure :: carry
    procedure :: move_to
    !> Go the way of another motion
    procedure :: accompany
    !> What part of the body each particle stands for after shifting
    procedure :: share_area
    !> Rows for where the particles are
    procedure :: renew_rows
    !> About how long the first step will be, s
    procedure :: first_step
    !> Memory that it takes, bytes
    procedure :: bytes
    !> Lay aside where particles are, and take it up again with the rows that belong to it
    procedure :: save => save_motion
    procedure :: restore => restore_motion
    procedure, private :: check_velocity
    procedure, private :: step_limit
  end type motion_t

contains

  subroutine prepare(this, scene, cloud, conduction, maker, radius, error)
    class(motion_t), intent(inout) :: this
    !> The scene
    type(scene_t), intent(in) :: scene
    !> Its cloud
    type(cloud_t), intent(in) :: cloud
    !> The heat equation with its rows
    type(conduction_t), intent(inout) :: conduction
    !> What made them
    type(row_maker_t), intent(in) :: maker
    !> Support radii of all particles in these rows, m
    real(wp), intent(in) :: radius(:)
    !> The velocity cannot be used, or walls not be followed
    type(error_t), allocatable, intent(out) :: error
    type(group_t) :: group
    real(wp), allocatable :: u(:), v(:)
    integer :: first, second

    call scene%file%group('motion', group)
    call this%velocity%read(group, error)
    if (allocated(error)) return
    this%maker = maker
    this%longest_step = huge(1.0_wp)
    if (scene%motion%step > 0) this%longest_step = scene%motion%step
    this%skin = scene%motion%skin*cloud%spacing
    call this%walls%prepare(cloud, conduction%medium%contacts, error)
    if (allocated(error)) return
    this%reach = radius
    call this%near%build(cloud%x, cloud%y, this%reach, this%skin)
    this%rows_x = cloud%x
    this%rows_y = cloud%y
    call find_closest(this%near%list, cloud%x, cloud%y, first, second, this%least_distance)
    this%least_distance = min(nearest*cloud%spacing, 0.5_wp*this%least_distance)
    allocate (u(cloud%particles()), v(cloud%particles()))
    call this%check_velocity(cloud, 0.0_wp, u, v, error)
    if (allocated(error)) then
      error%status = status_bad_input
      return
    end if
    this%places%x = cloud%x
    this%places%y = cloud%y
    allocate (this%places%x_way(5, cloud%particles()), this%places%y_way(5, cloud%particles()), &
              source=0.0_wp)
    this%places%x_way(1, :) = u
    this%places%y_way(1, :) = v
    call conduction%follow(cloud%x, cloud%y, this%places)
  end subroutine prepare

  !> Choose a step that begins at a time and is no longer than what remains, and find the paths.
  subroutine plan(this, cloud, time, remaining, error)
    class(motion_t), intent(inout) :: this
    !> The cloud at that time
    type(cloud_t), intent(in) :: cloud
    !> s
    real(wp), intent(in) :: time, remaining
    !> The velocity cannot be used
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: u(:), v(:)
    real(wp) :: step, limit, wrong

    allocate (u(cloud%particles()), v(cloud%particles()))
    call this%check_velocity(cloud, time, u, v, error)
    if (allocated(error)) return
    call this%step_limit(cloud, time, remaining, u, v, limit, error)
    if (allocated(error)) return
    limit = min(limit, this%longest_step)
    if (this%last_step > 0) limit = min(limit, growth*this%last_step)
    do
      ! Steps of equal length to the end, rather than a tiny last one
      step = remaining
      if (limit < remaining) step = remaining/aint(remaining/limit + 0.9999_wp)
      if (.not. time + step > time) then
        call raise(error, status_bad_numbers, this%velocity%place//': beyond t = '// &
                   to_text(time, &
                           digits=6)//' s neighbours move too fast relative to each other '// &
                   'for any step.')
        return
      end if
      call this%path%follow(this%velocity, cloud%x, cloud%y, u, v, time, step, wrong, error)
      if (allocated(error)) return
      ! A velocity that changes with time may strain more than it did at the beginning.
      associate (path => this%path)
        if (wrong > path_tolerance*cloud%spacing) then
          limit = step*max(0.1_wp, 0.9_wp*(path_tolerance*cloud%spacing/wrong)**0.2_wp)
          cycle
        else if (max(largest_strain(this%near%list, cloud%x, cloud%y, path%x_middle, &
                                    path%y_middle), &
                largest_strain(this%near%list, cloud%x, cloud%y, path%x_end, path%y_end)) <= &
            1.5_wp*most_strain) then
          exit
        end if
      end associate
      limit = 0.5_wp*step
      this%rejected = this%rejected + 1
    end do
    this%last_step = step
    if (step >= remaining) this%last_step = max(step, limit)
    this%steps = this%steps + 1
    call this%path%interpolate(this%places)
  end subroutine plan

  function first_step(this, cloud, longest) result(step)
    class(motion_t), intent(inout) :: this
    !> The cloud at time 0
    type(cloud_t), intent(in) :: cloud
    !> The longest step in question, s
    real(wp), intent(in) :: longest
    real(wp) :: step
    type(error_t), allocatable :: error
    real(wp), allocatable :: u(:), v(:)

    allocate (u(cloud%particles()), v(cloud%particles()))
    call this%velocity%at(cloud%x, cloud%y, 0.0_wp, u, v)
    call this%step_limit(cloud, 0.0_wp, min(longest, this%longest_step), u, v, step, error)
    if (allocated(error)) step = longest
  end function first_step

  !> How long a step may be for what the velocity is at its beginning, and halfway, and at its end.
  subroutine step_limit(this, cloud, time, remaining, u, v, limit, error)
    class(motion_t), intent(inout) :: this
    !> The cloud, and the time, s
    type(cloud_t), intent(in) :: cloud
    real(wp), intent(in) :: time
    !> The longest step in question, s
    real(wp), intent(in) :: remaining
    !> The velocities at that time, m/s
    real(wp), intent(in) :: u(:), v(:)
    !> s
    real(wp), intent(out) :: limit
    !> The velocity cannot be used
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: later_u(:), later_v(:)
    real(wp) :: rate
    integer :: k

    rate = strain_rate(this%near%list, cloud%x, cloud%y, u, v)
    if (rate*cloud%spacing > relative_speed(u, v)*(1 + 1.0e-9_wp) .and. &
        rate*remaining > least_strain) then
      call raise(error, status_bad_numbers, this%velocity%place//': at t = '// &
                 to_text(time, &
                         digits=6)//' s the velocity changes as much from one particle to '// &
                 'the next as over the whole body, so that they would run into each other or '// &
                 'apart: give a smooth velocity, or lower &domain spacing.')
      return
    end if
    limit = remaining
    if (rate*limit > most_strain) limit = most_strain/rate
    if (.not. this%velocity%is_unsteady()) return
    allocate (later_u(size(u)), later_v(size(v)))
    do k = 1, 2
      call this%velocity%at(cloud%x, cloud%y, time + 0.5_wp*k*limit, later_u, later_v)
      ! Where it is no number, whoever follows the paths will find out.
      if (.not. (all(ieee_is_finite(later_u)) .and. all(ieee_is_finite(later_v)))) return
      rate = max(rate, strain_rate(this%near%list, cloud%x, cloud%y, later_u, later_v))
    end do
    if (rate*limit > most_strain) limit = most_strain/rate
  end subroutine step_limit

  !> The largest speed relative to the mean velocity
  pure function relative_speed(u, v) result(speed)
    real(wp), intent(in) :: u(:), v(:)
    real(wp) :: speed

    speed = sqrt(maxval((u - sum(u)/size(u))**2 + (v - sum(v)/size(v))**2))
  end function relative_speed

  !> The velocity of all particles. It must be a number, and without divergence: what is compressed
  !> would change its density.
  subroutine check_velocity(this, cloud, time, u, v, error)
    class(motion_t), intent(inout) :: this
    type(cloud_t), intent(in) :: cloud
    real(wp), intent(in) :: time
    real(wp), intent(out) :: u(:), v(:)
    type(error_t), allocatable, intent(out) :: error
    !> Differences are taken over this part of the spacing
    real(wp), parameter :: part = 1.0e-3_wp
    real(wp), allocatable :: divergence(:), derivative(:)
    real(wp) :: distance, rounding
    integer :: worst, n

    call this%velocity%at(cloud%x, cloud%y, time, u, v)
    if (.not. (all(ieee_is_finite(u)) .and. all(ieee_is_finite(v)))) then
      worst = findloc(ieee_is_finite(u) .and. ieee_is_finite(v), .false., dim=1)
      call raise(error, status_bad_numbers, this%velocity%place//': at t = '// &
                 to_text(time, digits=6)//' s the velocity gives no number at ('// &
                 to_text(cloud%x(worst), digits=6)//', '//to_text(cloud%y(worst), digits=6)//').')
      return
    end if
    n = size(u)
    distance = part*cloud%spacing
    allocate (divergence(n), derivative(n))
    call this%velocity%find_divergence(cloud%x, cloud%y, time, distance, divergence, derivative)
    ! Beside a wall there may be no velocity beyond it.
    where (.not. (ieee_is_finite(divergence) .and. ieee_is_finite(derivative)))
      divergence = 0
      derivative = 0
    end where
    worst = maxloc(abs(divergence), dim=1)
    rounding = 1.0e-13_wp*max(maxval(abs(u)), maxval(abs(v)))/distance
    if (abs(divergence(worst)) <= largest_divergence*maxval(abs(derivative)) + rounding) return
    call raise(error, status_bad_numbers, this%velocity%place//': at t = '// &
               to_text(time, digits=6)//' s the velocity has the divergence '// &
               to_text(divergence(worst), digits=3)//' 1/s at ('// &
               to_text(cloud%x(worst), digits=6)//', '//to_text(cloud%y(worst), digits=6)// &
               '), so that the density would change, which is constant: give a velocity with '// &
               'd/dx velocity_x + d/dy velocity_y = 0.')
  end subroutine check_velocity

  !> Go to the middle of the step, with rows for it.
  subroutine enter_middle(this, scene, cloud, conduction, rows, renewed, error, stopwatch)
    class(motion_t), intent(inout) :: this
    !> The scene, its cloud and the heat equation
    type(scene_t), intent(in) :: scene
    type(cloud_t), intent(inout) :: cloud
    type(conduction_t), intent(inout) :: conduction
    !> What is known of new rows
    type(scene_rows_t), intent(inout) :: rows
    !> Whether there are new rows
    logical, intent(out) :: renewed
    !> There are no rows for these places
    type(error_t), allocatable, intent(out) :: error
    !> Is told which phase of the work runs
    type(stopwatch_t), intent(inout) :: stopwatch

    cloud%x = this%path%x_middle
    cloud%y = this%path%y_middle
    call this%renew_rows(scene, cloud, conduction, rows, renewed, error, stopwatch)
    if (allocated(error)) return
    this%rows_time = this%path%time + 0.5_wp*this%path%step
    call conduction%follow(cloud%x, cloud%y, this%places)
  end subroutine enter_middle

  !> Go to where the particles are at a time of the step; the rows stay what they are.
  subroutine go_to(this, time, cloud, conduction)
    class(motion_t), intent(inout) :: this
    !> s
    real(wp), intent(in) :: time
    type(cloud_t), intent(inout) :: cloud
    type(conduction_t), intent(inout) :: conduction

    associate (path => this%path, places => this%places)
      if (time >= path%time + path%step) then
        cloud%x = path%x_end
        cloud%y = path%y_end
      else if (time <= path%time) then
        cloud%x = path%x_start
        cloud%y = path%y_start
      else
        call places%find(time, cloud%x, cloud%y)
      end if
    end associate
    call conduction%follow(cloud%x, cloud%y, this%places)
  end subroutine go_to

  !> Walls and rows for where the particles are. The neighbours are looked up in a list with a skin,
  !> which is built anew when particles have moved by half the skin.
  subroutine renew_rows(this, scene, cloud, conduction, rows, renewed, error, stopwatch)
    class(motion_t), intent(inout) :: this
    type(scene_t), intent(in) :: scene
    type(cloud_t), intent(in) :: cloud
    type(conduction_t), intent(inout) :: conduction
    !> What is known of new rows
    type(scene_rows_t), intent(inout) :: rows
    !> Whether there are new rows
    logical, intent(out) :: renewed
    !> There are no rows for these places
    type(error_t), allocatable, intent(out) :: error
    type(stopwatch_t), intent(inout) :: stopwatch
    integer :: first, second
    real(wp) :: distance

    call this%walls%measure(cloud%x, cloud%y, conduction%medium%contacts)
    renewed = largest_strain(this%near%list, this%rows_x, this%rows_y, cloud%x, cloud%y) > &
              least_strain
    if (.not. renewed) return
    if (this%maker%materials%in_force) then
      if (.not. this%maker%materials%goes_with_particles()) then
        call raise(error, status_bad_numbers, this%velocity%place//': a body of several '// &
                   'materials, or one that conducts differently in different directions, can '// &
                   'move as a rigid body only: give a translation, a rotation or both.')
        return
      end if
    end if
    call find_closest(this%near%list, cloud%x, cloud%y, first, second, distance)
    if (distance < this%least_distance) then
      call raise(error, status_bad_numbers, 'At t = '//to_text(this%path%time, digits=6)// &
                 ' s the motion has piled up particles '//to_text(cloud%user_index(first))// &
                 ' and '//to_text(cloud%user_index(second))//' at ('// &
                 to_text(cloud%x(first), digits=6)//', '//to_text(cloud%y(first), digits=6)// &
                 '): set &motion shifting = .true., or give another velocity.')
      return
    end if
    call stopwatch%start('neighbour lists')
    if (this%near%is_outdated(cloud%x, cloud%y)) then
      call this%near%build(cloud%x, cloud%y, this%reach, this%skin)
    end if
    call stopwatch%start('reassembly')
    call this%maker%assemble(scene, cloud, conduction, rows, error, skin_list=this%near)
    call stopwatch%start('motion')
    if (allocated(error)) return
    ! Supports that have grown will probably grow as far again.
    this%reach = rows%radius
    this%assemblies = this%assemblies + 1
    this%rows_x = cloud%x
    this%rows_y = cloud%y
  end subroutine renew_rows

  !> Where particles would be spread more evenly.
  subroutine find_shift(this, cloud, x, y, origin)
    class(motion_t), intent(in) :: this
    type(cloud_t), intent(in) :: cloud
    !> The new places, m
    real(wp), allocatable, intent(out) :: x(:), y(:)
    !> The particle nearest to each
    integer(ip), allocatable, intent(out) :: origin(:)

    call find_even_places(cloud, this%walls, x, y, origin)
  end subroutine find_shift

  !> Take a field to new places, exactly for polynomials of the degree that the rows are exact for.
  subroutine carry(this, scene, cloud, origin, x, y, field)
    class(motion_t), intent(inout) :: this
    type(scene_t), intent(in) :: scene
    !> The cloud at the old places
    type(cloud_t), intent(in) :: cloud
    !> From find_shift
    integer(ip), intent(in) :: origin(:)
    !> The new places, m; where the field cannot be carried there, the old ones
    real(wp), intent(inout) :: x(:), y(:)
    !> The field at the old places, and at the new ones
    real(wp), intent(inout) :: field(:)
    integer :: degree

    degree = max(2, this%maker%scheme%exact_degree())
    if (this%near%is_outdated(cloud%x, cloud%y)) then
      call this%near%build(cloud%x, cloud%y, this%reach, this%skin)
    end if
    call carry_field(cloud, this%maker%kernel, degree, &
                     max(scene%support, natural_support(degree))*cloud%spacing, this%near, &
                     origin, x, y, field)
  end subroutine carry

  !> Put particles in new places.
  subroutine move_to(this, x, y, cloud, conduction)
    class(motion_t), intent(inout) :: this
    !> m
    real(wp), intent(in) :: x(:), y(:)
    type(cloud_t), intent(inout) :: cloud
    type(conduction_t), intent(inout) :: conduction

    this%places%x = this%places%x + (x - cloud%x)
    this%places%y = this%places%y + (y - cloud%y)
    cloud%x = x
    cloud%y = y
    call conduction%follow(x, y, this%places)
  end subroutine move_to

  !> Go the way of another motion, with rows of another kind.
  subroutine accompany(this, leader)
    class(motion_t), intent(inout) :: this
    !> Has planned its step
    type(motion_t), intent(in) :: leader

    this%path = leader%path
    this%places = leader%places
  end subroutine accompany

  !> The area of the body stays what it was, for the motion is without divergence.
  subroutine share_area(this, cloud)
    class(motion_t), intent(in) :: this
    type(cloud_t), intent(inout) :: cloud
    type(body_t) :: body
    real(wp), allocatable :: area(:)

    call this%walls%outline(cloud%x, cloud%y, body)
    if (size(body%edge) == 0) return
    call find_cell_areas(body, cloud%spacing, cloud%x, cloud%y, area)
    cloud%area = area*(sum(cloud%area)/sum(area))
  end subroutine share_area

  subroutine save_motion(this, cloud, state)
    class(motion_t), intent(in) :: this
    !> The cloud as it is now
    type(cloud_t), intent(in) :: cloud
    type(saved_state_t), intent(inout) :: state

    call state%put('steps', [this%steps, this%rejected, this%assemblies])
    call state%put('last_step', this%last_step)
    call state%put('reach', this%reach)
    call state%put('rows_x', this%rows_x)
    call state%put('rows_y', this%rows_y)
    call state%put('rows_time', this%rows_time)
    call state%put('area', cloud%area)
    call state%put('x', cloud%x)
    call state%put('y', cloud%y)
    call state%put('under_way', this%under_way)
    call this%near%save(state)
    if (.not. this%path%step > 0) return
    ! The paths follow from where they begin.
    call state%put('path', [this%path%time, this%path%step, this%until])
    call state%put('x_start', this%path%x_start)
    call state%put('y_start', this%path%y_start)
  end subroutine save_motion

  !> The rows are those of the places for which they were made; the heat equation is told where the
  !> particles are.
  subroutine restore_motion(this, scene, cloud, conduction, rows, renewed, accompanies, state, &
                            error)
    class(motion_t), intent(inout) :: this
    !> The scene, its cloud and the heat equation, as they are at the start
    type(scene_t), intent(in) :: scene
    type(cloud_t), intent(inout) :: cloud
    type(conduction_t), intent(inout) :: conduction
    !> What is known of new rows
    type(scene_rows_t), intent(inout) :: rows
    !> Whether there are new rows
    logical, intent(out) :: renewed
    !> Whether this motion accompanies another, so that it does not go to the end of a step
    logical, intent(in) :: accompanies
    type(saved_state_t), intent(inout) :: state
    !> There are no rows for these places
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: x(:), y(:), u(:), v(:), path(:), x_start(:), y_start(:)
    integer, allocatable :: steps(:)
    real(wp) :: wrong

    renewed = .false.
    call state%get('steps', steps)
    call state%get('last_step', this%last_step)
    call state%get('reach', this%reach)
    call state%get('rows_x', this%rows_x)
    call state%get('rows_y', this%rows_y)
    call state%get('rows_time', this%rows_time)
    call state%get('area', cloud%area)
    call state%get('x', x)
    call state%get('y', y)
    call state%get('under_way', this%under_way)
    call this%near%restore(state)
    if (allocated(state%problem)) return
    this%steps = steps(1)
    this%rejected = steps(2)
    this%assemblies = steps(3)
    conduction%medium%area = cloud%area
    if (this%assemblies > 0) then
      cloud%x = this%rows_x
      cloud%y = this%rows_y
      call this%walls%measure(cloud%x, cloud%y, conduction%medium%contacts)
      call this%maker%assemble(scene, cloud, conduction, rows, error, skin_list=this%near)
      if (allocated(error)) return
      renewed = .true.
    end if
    cloud%x = x
    cloud%y = y
    if (.not. state%has('path')) return
    call state%get('path', path)
    call state%get('x_start', x_start)
    call state%get('y_start', y_start)
    if (allocated(state%problem)) return
    allocate (u(size(x)), v(size(x)))
    call this%velocity%at(x_start, y_start, path(1), u, v)
    call this%path%follow(this%velocity, x_start, y_start, u, v, path(1), path(2), wrong, error)
    if (allocated(error)) return
    call this%path%interpolate(this%places)
    this%until = path(3)
    if (this%under_way .or. (accompanies .and. .not. scene%motion%shifting)) then
      cloud%x = this%path%x_middle
      cloud%y = this%path%y_middle
    else
      this%places%x = this%places%x + (x - this%path%x_end)
      this%places%y = this%places%y + (y - this%path%y_end)
    end if
    call this%walls%measure(cloud%x, cloud%y, conduction%medium%contacts)
    call conduction%follow(cloud%x, cloud%y, this%places)
  end subroutine restore_motion

  pure function bytes(this) result(number)
    class(motion_t), intent(in) :: this
    integer(i8) :: number

    number = this%near%bytes() + this%places%bytes() + this%path%bytes()
    if (allocated(this%rows_x)) then
      number = number + 2*size(this%rows_x, kind=i8)*storage_size(1.0_wp)/8
    end if
  end function bytes

end module calor_scene_motion
