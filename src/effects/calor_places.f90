!> Places of particles, which may move: x(t) = x + (t - t₀) rate + (t - t₀)² bend.
module calor_places
  use calor_expression, only: expression_t
  use calor_kinds, only: wp, ip, i8
  implicit none (type, external)
  private

  public :: places_t

  !> Particles at rest have neither rate nor bend
  type :: places_t
    !> Coordinates at `time`, m
    real(wp), allocatable :: x(:), y(:)
    !> Coordinates' first derivatives, m/s, and halves of the second ones, m/s²; allocated only
    !> where particles move
    real(wp), allocatable :: x_rate(:), y_rate(:), x_bend(:), y_bend(:)
    !> s
    real(wp) :: time = 0.0_wp
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

    if (allocated(this%x_rate)) then
      associate (s => time - this%time)
        x = this%x + s*(this%x_rate + s*this%x_bend)
        y = this%y + s*(this%y_rate + s*this%y_bend)
      end associate
    else
      x = this%x
      y = this%y
    end if
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

    if (.not. allocated(this%x_rate)) then
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
    if (.not. allocated(this%x_rate)) return
    chosen%x_rate = this%x_rate(particle)
    chosen%y_rate = this%y_rate(particle)
    chosen%x_bend = this%x_bend(particle)
    chosen%y_bend = this%y_bend(particle)
  end function some

  pure function bytes(this) result(number)
    class(places_t), intent(in) :: this
    integer(i8) :: number

    number = 0
    if (allocated(this%x)) number = 2*storage_size(this%x, i8)/8*size(this%x)
    if (allocated(this%x_rate)) number = 3*number
  end function bytes

end module calor_places
