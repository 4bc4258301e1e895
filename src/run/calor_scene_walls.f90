!> From a scene's boundary conditions to where they hold, and to the particles that are held.
module calor_scene_walls
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_expression, only: expression_t, compile_expression
  use calor_kinds, only: wp, ip
  use calor_prescribed, only: prescribed_t
  use calor_scene, only: scene_t, boundary_t
  use calor_scene_values, only: check_values
  use calor_text, only: to_text
  use calor_wall_contacts, only: wall_contacts_t
  implicit none (type, external)
  private

  public :: find_contacts, hold_walls

contains

  !> Find where the body touches the world and which boundary condition holds there. Where two
  !> conditions speak of one wall, the later one in the scene counts.
  subroutine find_contacts(scene, cloud, contacts, error)
    !> The scene
    type(scene_t), intent(in) :: scene
    !> Its cloud
    type(cloud_t), intent(in) :: cloud
    !> Particles on walls, one entry for each wall that they lie on
    type(wall_contacts_t), intent(out) :: contacts
    !> A boundary is unknown, or nothing is said about one
    type(error_t), allocatable, intent(out) :: error
    logical, allocatable :: covers(:, :)
    integer, allocatable :: bits(:)
    integer :: k, bit, particle, number

    if (cloud%is_part) then
      covers = cloud%covers
    else
      call check_sides(scene%path, cloud, error)
      if (allocated(error)) return
      call find_covers(cloud, covers)
    end if
    bits = pack([(bit, bit=0, size(cloud%boundary) - 1)], .not. any(covers, dim=2))
    number = 0
    do k = 1, size(bits)
      number = number + count(btest(cloud%side, bits(k)))
    end do
    allocate (contacts%particle(number), contacts%side(number))
    allocate (contacts%condition(number), source=0)
    allocate (contacts%weight(number), source=0.0_wp)
    number = 0
    do particle = 1, cloud%particles()
      if (cloud%side(particle) == 0) cycle
      do k = 1, size(bits)
        if (.not. btest(cloud%side(particle), bits(k))) cycle
        number = number + 1
        contacts%particle(number) = int(particle, ip)
        contacts%side(number) = bits(k)
      end do
    end do
    do k = 1, size(scene%boundaries)
      call mark_boundary(scene%boundaries(k), cloud, covers, k, contacts, error)
      if (allocated(error)) return
    end do
    call check_walls(scene%path, cloud, covers, contacts, error)
    if (allocated(error)) return
    contacts%holding = [(holds(scene%boundaries(contacts%condition(k))), k=1, number)]
    if (allocated(cloud%normal_x)) call orient(cloud, contacts)
  end subroutine find_contacts

  !> Which boundaries consist of others, as a polygon's 'outer' does of its edges.
  pure subroutine find_covers(cloud, covers)
    type(cloud_t), intent(in) :: cloud
    !> Whether the first boundary has all particles of the second one, and more; numbered from 0
    logical, allocatable, intent(out) :: covers(:, :)
    logical, allocatable :: first(:), second(:)
    integer :: a, b, boundaries

    boundaries = size(cloud%boundary)
    allocate (covers(0:boundaries - 1, 0:boundaries - 1), source=.false.)
    do b = 0, boundaries - 1
      second = btest(cloud%side, b)
      if (.not. any(second)) cycle
      do a = 0, boundaries - 1
        first = btest(cloud%side, a)
        covers(a, b) = all(first .or. .not. second) .and. any(first .and. .not. second)
      end do
    end do
  end subroutine find_covers

  !> Hold the wall particles at what the boundaries say. Where two held walls meet, as at a corner,
  !> the later condition in the scene counts; a corner of a held wall and another one is held.
  subroutine hold_walls(scene, cloud, contacts, prescribed, error)
    !> The scene
    type(scene_t), intent(in) :: scene
    !> Its cloud
    type(cloud_t), intent(in) :: cloud
    !> Where the body touches the world
    type(wall_contacts_t), intent(in) :: contacts
    !> What is held, one entry a condition that holds temperatures, at the values of time 0
    type(prescribed_t), allocatable, intent(out) :: prescribed(:)
    !> An expression gives no number
    type(error_t), allocatable, intent(out) :: error
    integer, allocatable :: holder(:), holding(:)
    integer :: k, particle, entry

    allocate (holder(cloud%particles()), source=0)
    do k = 1, size(contacts%particle)
      if (.not. holds(scene%boundaries(contacts%condition(k)))) cycle
      associate (held_by => holder(contacts%particle(k)))
        held_by = max(held_by, contacts%condition(k))
      end associate
    end do
    holding = pack([(k, k=1, size(scene%boundaries))], &
                   [(holds(scene%boundaries(k)), k=1, size(scene%boundaries))])
    allocate (prescribed(size(holding)))
    do entry = 1, size(holding)
      associate (boundary => scene%boundaries(holding(entry)), held => prescribed(entry))
        held%particle = pack([(int(particle, ip), particle=1, size(holder))], &
                             holder == holding(entry))
        allocate (held%temperature(size(held%particle)), source=boundary%value)
        if (boundary%value_expression == '') cycle
        allocate (held%expression)
        call compile_expression(boundary%value_expression, held%expression, error)
        if (allocated(error)) return
        held%places%x = cloud%x(held%particle)
        held%places%y = cloud%y(held%particle)
        call held%places%evaluate(held%expression, 0.0_wp, held%temperature)
        call check_values(boundary%value_expression, boundary%place, held%temperature, &
                          held%places%x, held%places%y, error)
        if (allocated(error)) return
        if (held%expression%uses('t')) cycle
        if (scene%motion%in_force .and. (held%expression%uses('x') .or. &
                                         held%expression%uses('y'))) cycle
        deallocate (held%expression)
      end associate
    end do
  end subroutine hold_walls

  pure function holds(boundary) result(answer)
    type(boundary_t), intent(in) :: boundary
    logical :: answer

    answer = boundary%kind == 'temperature'
  end function holds

  !> Note which condition holds at which contact.
  subroutine mark_boundary(boundary, cloud, covers, number, contacts, error)
    type(boundary_t), intent(in) :: boundary
    type(cloud_t), intent(in) :: cloud
    !> From `find_covers`
    logical, intent(in) :: covers(0:, 0:)
    integer, intent(in) :: number
    type(wall_contacts_t), intent(inout) :: contacts
    type(error_t), allocatable, intent(out) :: error
    type(expression_t) :: region
    character(len=:), allocatable :: names
    real(wp), allocatable :: inside(:)
    logical, allocatable :: meant(:)
    logical :: known
    integer :: bit, k

    names = '''all'''
    allocate (meant(size(contacts%particle)), source=boundary%on == 'all')
    known = boundary%on == 'all'
    do bit = 0, size(cloud%boundary) - 1
      names = names//', '''//cloud%boundary(bit + 1)%value//''''
      if (cloud%boundary(bit + 1)%value /= boundary%on) cycle
      known = .true.
      do k = 1, size(meant)
        meant(k) = contacts%side(k) == bit .or. covers(bit, contacts%side(k))
      end do
    end do
    if (.not. known) then
      call raise(error, status_bad_input, boundary%place// &
                 ': the domain has no boundary called '''//boundary%on//'''. There are: '// &
                 names//'.')
      return
    else if (.not. any(meant) .and. .not. cloud%is_part) then
      ! A short edge of a curve may lie between two particles
      call raise(error, status_bad_input, boundary%place//': no particle lies on '''// &
                 boundary%on//''': lower &domain spacing.')
      return
    end if
    if (boundary%where_expression /= '') then
      call compile_expression(boundary%where_expression, region, error)
      if (allocated(error)) return
      allocate (inside(size(meant)))
      call region%evaluate(cloud%x(contacts%particle), cloud%y(contacts%particle), 0.0_wp, &
                           values=inside)
      meant = meant .and. abs(inside) > 0
      if (.not. any(meant) .and. .not. cloud%is_part) then
        call raise(error, status_bad_input, boundary%place//': no particle of that boundary '// &
                   'lies where where_expression says; widen it, or lower &domain spacing.')
        return
      end if
    end if
    where (meant) contacts%condition = number
  end subroutine mark_boundary

  !> Normals and lengths of contacts. A corner particle's own normal is the mean of both walls':
  !> there each wall's is that of its nearest other particle, and its length half the way there.
  subroutine orient(cloud, contacts)
    type(cloud_t), intent(in) :: cloud
    type(wall_contacts_t), intent(inout) :: contacts
    integer, allocatable :: walls(:)
    integer :: k, j, nearest
    real(wp) :: distance, least

    allocate (walls(cloud%particles()), source=0)
    do k = 1, size(contacts%particle)
      walls(contacts%particle(k)) = walls(contacts%particle(k)) + 1
    end do
    associate (particle => contacts%particle)
      allocate (contacts%normal(2, size(particle)), contacts%length(size(particle)))
      do k = 1, size(particle)
        associate (i => particle(k))
          contacts%normal(:, k) = [cloud%normal_x(i), cloud%normal_y(i)]
          contacts%length(k) = cloud%wall_length(i)/walls(i)
          if (walls(i) == 1) cycle
          nearest = 0
          least = huge(1.0_wp)
          do j = 1, size(particle)
            if (contacts%side(j) /= contacts%side(k) .or. particle(j) == i) cycle
            distance = hypot(cloud%x(particle(j)) - cloud%x(i), cloud%y(particle(j)) - cloud%y(i))
            if (distance >= least) cycle
            least = distance
            nearest = particle(j)
          end do
          if (nearest == 0) cycle
          contacts%length(k) = 0.5_wp*least
          if (walls(nearest) /= 1) cycle
          contacts%normal(:, k) = [cloud%normal_x(nearest), cloud%normal_y(nearest)]
        end associate
      end do
    end associate
  end subroutine orient

  !> Some particle must lie on a wall, and some must not.
  subroutine check_sides(path, cloud, error)
    !> The scene
    character(len=*), intent(in) :: path
    type(cloud_t), intent(in) :: cloud
    type(error_t), allocatable, intent(out) :: error

    if (all(cloud%side == 0)) then
      call raise(error, status_bad_input, path//': no particle of the cloud is marked as '// &
                 'a wall, so nothing can be said about its boundary: give its file a column '// &
                 '''wall'' with 1 for the particles on the boundary.')
      return
    end if
    if (all(cloud%side /= 0)) then
      call raise(error, status_bad_input, path//': all '//to_text(cloud%particles())// &
                 ' particles lie on the boundary: lower &domain spacing.')
    end if
  end subroutine check_sides

  !> Something must be said about every wall.
  subroutine check_walls(path, cloud, covers, contacts, error)
    !> The scene
    character(len=*), intent(in) :: path
    type(cloud_t), intent(in) :: cloud
    !> From `find_covers`
    logical, intent(in) :: covers(0:, 0:)
    type(wall_contacts_t), intent(in) :: contacts
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: names
    integer :: bit

    names = ''
    do bit = 0, size(cloud%boundary) - 1
      if (any((contacts%side == bit .or. covers(bit, contacts%side)) .and. &
              contacts%condition == 0)) then
        if (names /= '') names = names//', '
        names = names//''''//cloud%boundary(bit + 1)%value//''''
      end if
    end do
    if (names /= '') then
      call raise(error, status_bad_input, path//': nothing is said about the '// &
                 trim(merge('boundaries', 'boundary  ', index(names, ', ') > 0))//' '//names// &
                 ': add a group &boundary with on, kind (''temperature'', ''flux'', '// &
                 '''insulated'', ''convection'' or ''radiation'') and what that needs.')
    end if
  end subroutine check_walls

end module calor_scene_walls
