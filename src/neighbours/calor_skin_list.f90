!> Neighbour lists of particles that move: a list that reaches farther than is asked for, by a skin,
!> serves until a pair that it lacks may have come within reach.
!>
!> That cannot be as long as no particle has moved by more than half the skin s, beside a rigid
!> motion of all, which leaves distances as they are. Particles that flow move by much more,
!> together with those around them. What counts then is by how much distances shrink: if every
!> distance of listed pairs has kept at least the part R/(R + s), then, the motion being continuous,
!> no pair farther apart than R + s has come nearer than R, with matter between them. What lies
!> outside the reach R of the list is found anew.
module calor_skin_list
  use calor_constants, only: worth_threads
  use calor_kinds, only: wp, ip, i8
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_saved_state, only: saved_state_t
  implicit none (type, external)
  private

  public :: skin_list_t, find_neighbours

  !> Distances are known in the directions of neighbours only, some 30 degrees apart: between them
  !> they may have shrunk by 7 % more
  real(wp), parameter :: usable_part = 0.9_wp

  !> All pairs of particles nearer than the reach of the first, and the skin
  type :: skin_list_t
    !> A row for each particle, in their order; places as they were when it was built
    type(neighbour_list_t) :: list
    !> Up to where no neighbour is missing as long as the list is not outdated, m
    real(wp), allocatable :: reach(:)
    !> Width of the skin, m
    real(wp) :: skin = 0.0_wp
    !> How often the list was built
    integer :: builds = 0
    !> Places when it was built, m
    real(wp), allocatable, private :: x(:), y(:)
  contains
    !> Build the list
    procedure :: build
    !> Whether pairs may be missing
    procedure :: is_outdated
    !> Choose rows and neighbours within given radii
    procedure :: select => select_neighbours
    !> Memory that it takes, bytes
    procedure :: bytes
    !> Lay aside what it was built for, and build it again
    procedure :: save => save_skin_list
    procedure :: restore => restore_skin_list
  end type skin_list_t

contains

  subroutine build(this, x, y, reach, skin)
    class(skin_list_t), intent(inout) :: this
    !> Places, m
    real(wp), intent(in) :: x(:), y(:)
    !> Up to where neighbours will be asked for, for each particle, m
    real(wp), intent(in) :: reach(:)
    !> m
    real(wp), intent(in) :: skin

    call build_neighbour_list(x, y, reach + skin, this%list)
    this%reach = reach
    this%skin = skin
    this%x = x
    this%y = y
    this%builds = this%builds + 1
  end subroutine build

  subroutine save_skin_list(this, state)
    class(skin_list_t), intent(in) :: this
    type(saved_state_t), intent(inout) :: state

    call state%enter('skin_list')
    call state%put('x', this%x)
    call state%put('y', this%y)
    call state%put('reach', this%reach)
    call state%put('skin', this%skin)
    call state%put('builds', this%builds)
    call state%leave()
  end subroutine save_skin_list

  subroutine restore_skin_list(this, state)
    class(skin_list_t), intent(inout) :: this
    type(saved_state_t), intent(inout) :: state
    real(wp), allocatable :: x(:), y(:), reach(:)
    real(wp) :: skin

    skin = this%skin
    call state%enter('skin_list')
    call state%get('x', x)
    call state%get('y', y)
    call state%get('reach', reach)
    call state%get('skin', skin)
    if (.not. allocated(state%problem)) call this%build(x, y, reach, skin)
    call state%get('builds', this%builds)
    call state%leave()
  end subroutine restore_skin_list

  !> Both tests; the second one costs a pass over all pairs.
  function is_outdated(this, x, y) result(answer)
    class(skin_list_t), intent(in) :: this
    !> Places now, m
    real(wp), intent(in) :: x(:), y(:)
    logical :: answer

    answer = .true.
    if (.not. allocated(this%x)) return
    answer = beside_rigid_motion(this%x, this%y, x, y) > 0.5_wp*this%skin
    if (.not. answer) return
    answer = contraction(this%list, this%x, this%y, x, y)*(maxval(this%reach) + this%skin) > &
             usable_part*this%skin
  end function is_outdated

  !> The largest (d₀ - d)/d₀ of all listed pairs.
  function contraction(list, from_x, from_y, x, y) result(part)
    type(neighbour_list_t), intent(in) :: list
    real(wp), intent(in) :: from_x(:), from_y(:), x(:), y(:)
    real(wp) :: part
    real(wp) :: least, before
    integer(i8) :: k
    integer :: i

    least = 1
    !$omp parallel do if (size(x) > worth_threads) schedule(static) default(shared) &
    !$omp private(i, k, before) reduction(min:least)
    do i = 1, size(x)
      do k = list%first(i), list%first(i + 1) - 1
        associate (j => list%index(k))
          before = (from_x(j) - from_x(i))**2 + (from_y(j) - from_y(i))**2
          if (before > 0) least = min(least, ((x(j) - x(i))**2 + (y(j) - y(i))**2)/before)
        end associate
      end do
    end do
    !$omp end parallel do
    part = 1 - sqrt(least)
  end function contraction

  !> The largest distance between where particles are and where the nearest rigid motion, in the
  !> sense of least squares, would have taken them.
  function beside_rigid_motion(from_x, from_y, x, y) result(farthest)
    real(wp), intent(in) :: from_x(:), from_y(:), x(:), y(:)
    real(wp) :: farthest
    real(wp) :: centre(2), from_centre(2), cosine, sine, norm, a, b, c, d
    integer :: k

    from_centre = [sum(from_x), sum(from_y)]/size(x)
    centre = [sum(x), sum(y)]/size(x)
    cosine = 0
    sine = 0
    !$omp parallel do if (size(x) > worth_threads) schedule(static) default(shared) &
    !$omp private(k, a, b, c, d) reduction(+:cosine, sine)
    do k = 1, size(x)
      a = from_x(k) - from_centre(1)
      b = from_y(k) - from_centre(2)
      c = x(k) - centre(1)
      d = y(k) - centre(2)
      cosine = cosine + a*c + b*d
      sine = sine + a*d - b*c
    end do
    !$omp end parallel do
    norm = hypot(cosine, sine)
    if (norm > 0) then
      cosine = cosine/norm
      sine = sine/norm
    else
      cosine = 1
      sine = 0
    end if
    farthest = 0
    !$omp parallel do if (size(x) > worth_threads) schedule(static) default(shared) &
    !$omp private(k, a, b) reduction(max:farthest)
    do k = 1, size(x)
      a = from_x(k) - from_centre(1)
      b = from_y(k) - from_centre(2)
      farthest = max(farthest, (x(k) - centre(1) - cosine*a + sine*b)**2 + &
                     (y(k) - centre(2) - sine*a - cosine*b)**2)
    end do
    !$omp end parallel do
    farthest = sqrt(farthest)
  end function beside_rigid_motion

  !> The neighbours of some particles, as `build_neighbour_list` finds them; radii beyond the reach
  !> are not to be asked for.
  subroutine select_neighbours(this, x, y, radius, targets, list)
    class(skin_list_t), intent(in) :: this
    !> Places now, m
    real(wp), intent(in) :: x(:), y(:)
    !> Search radius of each target, m
    real(wp), intent(in) :: radius(:)
    !> The particles that get a row
    integer(ip), intent(in) :: targets(:)
    !> One row for each target
    type(neighbour_list_t), intent(out) :: list
    integer(ip) :: j
    integer(i8) :: k, place
    integer :: row

    allocate (list%target(size(targets)), list%first(size(targets) + 1))
    list%target(:) = targets
    list%first(1) = 1
    !$omp parallel do if (size(targets) > worth_threads) schedule(static) default(shared) &
    !$omp private(row, k, place)
    do row = 1, size(targets)
      place = 0
      associate (i => targets(row), squared => radius(row)*radius(row))
        do k = this%list%first(i), this%list%first(i + 1) - 1
          if (near(x, y, i, this%list%index(k), squared)) place = place + 1
        end do
      end associate
      list%first(row + 1) = place
    end do
    !$omp end parallel do
    do row = 1, size(targets)
      list%first(row + 1) = list%first(row + 1) + list%first(row)
    end do
    allocate (list%index(list%first(size(targets) + 1) - 1))
    !$omp parallel do if (size(targets) > worth_threads) schedule(static) default(shared) &
    !$omp private(row, k, j, place)
    do row = 1, size(targets)
      place = list%first(row)
      associate (i => targets(row), squared => radius(row)*radius(row))
        do k = this%list%first(i), this%list%first(i + 1) - 1
          j = this%list%index(k)
          if (.not. near(x, y, i, j, squared)) cycle
          list%index(place) = j
          place = place + 1
        end do
      end associate
    end do
    !$omp end parallel do
  end subroutine select_neighbours

  pure function near(x, y, i, j, squared) result(answer)
    real(wp), intent(in) :: x(:), y(:)
    integer(ip), intent(in) :: i, j
    real(wp), intent(in) :: squared
    logical :: answer

    answer = (x(j) - x(i))**2 + (y(j) - y(i))**2 < squared
  end function near

  pure function bytes(this) result(number)
    class(skin_list_t), intent(in) :: this
    integer(i8) :: number

    number = 0
    if (.not. allocated(this%x)) return
    number = (size(this%list%index, kind=i8)*storage_size(this%list%index) + &
              size(this%list%first, kind=i8)*storage_size(this%list%first) + &
              size(this%list%target, kind=i8)*storage_size(this%list%target) + &
              3*size(this%x, kind=i8)*storage_size(this%x))/8
  end function bytes

  !> Neighbours of some particles, from a list with a skin where there is one that reaches so far,
  !> and by a search where not.
  subroutine find_neighbours(x, y, radius, list, targets, skin_list)
    !> Places of all particles, m
    real(wp), intent(in) :: x(:), y(:)
    !> Search radius of each target, m
    real(wp), intent(in) :: radius(:)
    !> One row for each target
    type(neighbour_list_t), intent(out) :: list
    !> The particles that get a row
    integer(ip), intent(in) :: targets(:)
    !> A list that is not outdated
    type(skin_list_t), intent(in), optional :: skin_list
    type(neighbour_list_t) :: searched
    logical, allocatable :: served(:)
    integer, allocatable :: others(:)
    integer :: k

    if (.not. present(skin_list)) then
      call build_neighbour_list(x, y, radius, list, targets)
      return
    end if
    served = radius <= skin_list%reach(targets)
    call skin_list%select(x, y, merge(radius, 0.0_wp, served), targets, list)
    if (all(served)) return
    others = pack([(k, k=1, size(served))], .not. served)
    call build_neighbour_list(x, y, radius(others), searched, targets(others))
    call replace_rows(list, others, searched)
  end subroutine find_neighbours

  !> Put rows of another list into the place of some.
  pure subroutine replace_rows(list, place, rows)
    type(neighbour_list_t), intent(inout) :: list
    integer, intent(in) :: place(:)
    type(neighbour_list_t), intent(in) :: rows
    integer, allocatable :: source(:)
    integer(i8), allocatable :: first(:)
    integer(ip), allocatable :: index(:)
    integer :: k

    allocate (source(list%rows()), source=0)
    source(place) = [(k, k=1, size(place))]
    allocate (first(list%rows() + 1))
    first(1) = 1
    do k = 1, list%rows()
      if (source(k) > 0) then
        first(k + 1) = first(k) + rows%first(source(k) + 1) - rows%first(source(k))
      else
        first(k + 1) = first(k) + list%first(k + 1) - list%first(k)
      end if
    end do
    allocate (index(first(list%rows() + 1) - 1))
    do k = 1, list%rows()
      if (source(k) > 0) then
        index(first(k):first(k + 1) - 1) = &
          rows%index(rows%first(source(k)):rows%first(source(k) + 1) - 1)
      else
        index(first(k):first(k + 1) - 1) = list%index(list%first(k):list%first(k + 1) - 1)
      end if
    end do
    call move_alloc(first, list%first)
    call move_alloc(index, list%index)
  end subroutine replace_rows

end module calor_skin_list
