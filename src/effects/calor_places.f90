!> Places of particles, which may move: polynomials of degree 5 in time.
module calor_places
  use calor_expression, only: expression_t
  use calor_kinds, only: wp, ip, i8
  implicit none (type, external)
  private

  public :: places_t

  !> x(t) = x + Σ way(k) s^k with s = (t - time)/step; particles at rest have no way
  type :: places_t
    !> Coordinates at `time`, m
    real(wp), allocatable :: x(:), y(:)
    !> Coefficients of s … s⁵, m, a column for each particle; allocated only where particles move
    real(wp), allocatable :: x_way(:, :), y_way(:, :)
    !> s
    real(wp) :: time = 0.0_wp, step = 1.0_wp
  contains
    !> Coordinates at a time
    procedure :: find
    !> The values of an expression there at that time
    procedure :: evaluate
    !> Some of the particles
    procedure :: some
    !> What its arrays take, bytes
    procedure :: bytes
  end type places_t

contains

  pure subroutine find(this, time, x, y)
    class(places_t), intent(in) :: this
    !> s
    real(wp), intent(in) :: time
    !> m
    real(wp), intent(out) :: x(:), y(:)

    real(wp) :: s
    integer :: k

    x = this%x
    y = this%y
    if (.not. allocated(this%x_way)) return
    s = (time - this%time)/this%step
    do k = 1, size(x)
      x(k) = x(k) + along(this%x_way(:, k))
      y(k) = y(k) + along(this%y_way(:, k))
    end do

  contains

    pure function along(way) result(distance)
      real(wp), intent(in) :: way(5)
      real(wp) :: distance

      distance = s*(way(1) + s*(way(2) + s*(way(3) + s*(way(4) + s*way(5)))))
    end function along

  end subroutine find

  subroutine evaluate(this, expression, time, values, temperature)
    class(places_t), intent(in) :: this
    !> In terms of x, y, t and T
    type(expression_t), intent(inout) :: expression
    !> s
    real(wp), intent(in) :: time
    !> One for each particle
    real(wp), intent(out) :: values(:)
    !> Temperatures of the particles
    real(wp), intent(in), optional :: temperature(:)
    real(wp), allocatable :: x(:), y(:)

    if (.not. allocated(this%x_way)) then
      call expression%evaluate(this%x, this%y, time, values=values, temperature=temperature)
      return
    end if
    allocate (x(size(this%x)), y(size(this%y)))
    call this%find(time, x, y)
    call expression%evaluate(x, y, time, values=values, temperature=temperature)
  end subroutine evaluate

  pure function some(this, particle) result(chosen)
    class(places_t), intent(in) :: this
    !> Which
    integer(ip), intent(in) :: particle(:)
    type(places_t) :: chosen

    chosen%time = this%time
    chosen%x = this%x(particle)
    chosen%y = this%y(particle)
    chosen%step = this%step
    if (.not. allocated(this%x_way)) return
    chosen%x_way = this%x_way(:, particle)
    chosen%y_way = this%y_way(:, particle)
  end function some

  pure function bytes(this) result(number)
    class(places_t), intent(in) :: this
    integer(i8) :: number

    number = 0
    if (allocated(this%x)) number = 2*storage_size(this%x, i8)/8*size(this%x)
    if (allocated(this%x_way)) number = 6*number
  end function bytes

end module calor_places
