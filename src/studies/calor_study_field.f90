!> A field with all its derivatives, for measuring schemes.
!>
!> Either one of the study's own, exp(ξ) sin(2η) and, in shorter waves, sin(12ξ) sin(16η) with ξ and
!> η the coordinates in widths of the domain, of which all derivatives are known; or one that a
!> scene gives, whose derivatives up to the fourth are found by central differences of nine points
!> each way.
module calor_study_field
  use calor_constants, only: pi
  use calor_error, only: error_t
  use calor_expression, only: expression_t, compile_expression
  use calor_kinds, only: wp
  use calor_scene, only: scene_t
  use calor_scene_values, only: check_values
  use calor_text, only: text_t, text_list
  implicit none (type, external)
  private

  public :: study_field_t, derivative_index, derivative_count

  !> Points on each side of a central difference
  integer, parameter :: side_points = 4
  !> The degree up to which central differences are good for nine digits
  integer, parameter :: highest_difference = 4
  !> Relative error of those differences for fields that vary over the width of the domain
  real(wp), parameter :: difference_error = 1.0e-9_wp

  !> A field
  type :: study_field_t
    !> As the user wrote it; '': the study's own
    character(len=:), allocatable :: text
    !> Where the scene has it
    character(len=:), allocatable :: place
    !> ∂u/∂x, ∂u/∂y and ∇²u, as expressions, or ''
    type(text_t) :: exact(3)
    !> Corner and width of the domain, m
    real(wp) :: corner(2) = 0.0_wp, width = 1.0_wp
    !> Which of the study's own fields it is
    logical :: short_waves = .false.
    !> Distance between the points of a central difference, m
    real(wp) :: step = 0.0_wp
  contains
    !> Take the scene's field, or the study's own
    procedure :: take
    !> The field in words
    procedure :: source
    !> The highest degree of its derivatives
    procedure :: highest_degree
    !> Relative error of the derivatives
    procedure :: uncertainty
    !> Values at particles
    procedure :: values
    !> All derivatives up to a degree
    procedure :: derivatives
    !> ∂u/∂x and ∂u/∂y, or ∇²u
    procedure :: exact_derivative
  end type study_field_t

contains

  !> Where a table of derivatives has ∂^(m+n)u/∂x^m∂y^n; degree after degree, from 0 on.
  pure function derivative_index(m, n) result(place)
    !> How often along x and y
    integer, intent(in) :: m, n
    integer :: place

    place = (m + n)*(m + n + 1)/2 + n
  end function derivative_index

  !> How many derivatives there are up to a degree, the field included.
  pure function derivative_count(degree) result(number)
    !> The degree
    integer, intent(in) :: degree
    integer :: number

    number = (degree + 1)*(degree + 2)/2
  end function derivative_count

  subroutine take(this, scene, corner, width, clearance)
    class(study_field_t), intent(out) :: this
    !> A scene, with a group &operators or without
    type(scene_t), intent(in) :: scene
    !> Lower left corner and width of the domain, m
    real(wp), intent(in) :: corner(2), width
    !> The field can be evaluated this far from where derivatives are wanted, m
    real(wp), intent(in) :: clearance

    this%corner = corner
    this%width = width
    this%text = scene%operators%field_expression
    this%place = scene%path//': &operators'
    this%step = clearance/(3*side_points)
    this%exact = text_list(['', '', ''])
    if (this%text == '') return
    associate (asked => scene%operators)
      this%exact(1)%value = asked%exact_gradient_x
      this%exact(2)%value = asked%exact_gradient_y
      this%exact(3)%value = asked%exact_laplacian
    end associate
  end subroutine take

  pure function source(this) result(text)
    class(study_field_t), intent(in) :: this
    character(len=:), allocatable :: text

    text = this%text
    if (text /= '') return
    text = 'exp(x)*sin(2*y)'
    if (this%short_waves) text = 'sin(12*x)*sin(16*y)'
    if (any(abs(this%corner) > 0) .or. abs(this%width - 1) > 0) then
      text = text//', x and y in widths of the domain'
    end if
  end function source

  pure function highest_degree(this) result(degree)
    class(study_field_t), intent(in) :: this
    integer :: degree

    degree = huge(degree)
    if (this%text /= '') degree = highest_difference
  end function highest_degree

  pure function uncertainty(this) result(deviation)
    class(study_field_t), intent(in) :: this
    real(wp) :: deviation

    deviation = 0
    if (this%text /= '') deviation = difference_error
  end function uncertainty

  subroutine values(this, x, y, u, error)
    class(study_field_t), intent(in) :: this
    !> Places, m
    real(wp), intent(in) :: x(:), y(:)
    !> The field there
    real(wp), intent(out) :: u(:)
    !> The expression gives no number somewhere
    type(error_t), allocatable, intent(out) :: error

    if (this%text == '') then
      u = own_derivative(this, x, y, 0, 0)
    else
      call evaluate(this%text, this%place, x, y, u, error)
    end if
  end subroutine values

  subroutine evaluate(text, place, x, y, u, error)
    character(len=*), intent(in) :: text, place
    real(wp), intent(in) :: x(:), y(:)
    real(wp), intent(out) :: u(:)
    type(error_t), allocatable, intent(out) :: error
    type(expression_t) :: expression

    call compile_expression(text, expression, error)
    if (allocated(error)) return
    call expression%evaluate(x, y, 0.0_wp, values=u)
    call check_values(text, place, u, x, y, error)
  end subroutine evaluate

  subroutine derivatives(this, x, y, degree, table, error)
    class(study_field_t), intent(in) :: this
    !> Places, m
    real(wp), intent(in) :: x(:), y(:)
    !> At most `highest_degree`
    integer, intent(in) :: degree
    !> Of the size (0:derivative_count(degree) - 1, size(x))
    real(wp), intent(out) :: table(0:, :)
    !> The expression gives no number somewhere
    type(error_t), allocatable, intent(out) :: error
    integer :: m, n

    if (this%text == '') then
      do m = 0, degree
        do n = 0, degree - m
          table(derivative_index(m, n), :) = own_derivative(this, x, y, m, n)
        end do
      end do
    else
      call difference_derivatives(this, x, y, degree, table, error)
    end if
  end subroutine derivatives

  !> ∂^(m+n)u/∂x^m∂y^n of the study's own field
  elemental function own_derivative(field, x, y, m, n) result(value)
    type(study_field_t), intent(in) :: field
    real(wp), intent(in) :: x, y
    integer, intent(in) :: m, n
    real(wp) :: value

    associate (xi => (x - field%corner(1))/field%width, eta => (y - field%corner(2))/field%width)
      if (field%short_waves) then
        value = 12.0_wp**m*sin(12*xi + m*pi/2)*16.0_wp**n*sin(16*eta + n*pi/2)
      else
        value = exp(xi)*2.0_wp**n*sin(2*eta + n*pi/2)
      end if
    end associate
    value = value/field%width**(m + n)
  end function own_derivative

  subroutine difference_derivatives(field, x, y, degree, table, error)
    type(study_field_t), intent(in) :: field
    real(wp), intent(in) :: x(:), y(:)
    integer, intent(in) :: degree
    real(wp), intent(out) :: table(0:, :)
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: weight(-side_points:side_points, 0:highest_difference), u(size(x))
    integer :: i, j, m, n

    call central_differences(weight)
    table = 0
    do i = -side_points, side_points
      do j = -side_points, side_points
        call field%values(x + i*field%step, y + j*field%step, u, error)
        if (allocated(error)) return
        do m = 0, degree
          do n = 0, degree - m
            associate (derivative => table(derivative_index(m, n), :), &
                       factor => weight(i, m)*weight(j, n)/field%step**(m + n))
              if (abs(factor) > 0) derivative = derivative + factor*u
            end associate
          end do
        end do
      end do
    end do
  end subroutine difference_derivatives

  !> Weights of derivatives at 0 from values at whole numbers.
  !>
  !> Source: B. Fornberg, Math. Comput. 51 (1988) 699–706.
  pure subroutine central_differences(weight)
    !> Point and order of the derivative
    real(wp), intent(out) :: weight(-side_points:, 0:)
    real(wp) :: point(-side_points:side_points), c1, c2, c3, before
    integer :: i, j, k

    point = [(real(i, wp), i=-side_points, side_points)]
    weight = 0
    weight(-side_points, 0) = 1
    c1 = 1
    do i = 1 - side_points, side_points
      c2 = 1
      do j = -side_points, i - 1
        c3 = point(i) - point(j)
        c2 = c2*c3
        if (j == i - 1) then
          do k = ubound(weight, 2), 0, -1
            before = 0
            if (k > 0) before = k*weight(i - 1, k - 1)
            weight(i, k) = c1*(before - point(i - 1)*weight(i - 1, k))/c2
          end do
        end if
        do k = ubound(weight, 2), 0, -1
          before = 0
          if (k > 0) before = k*weight(j, k - 1)
          weight(j, k) = (point(i)*weight(j, k) - before)/c3
        end do
      end do
      c1 = c2
    end do
  end subroutine central_differences

  subroutine exact_derivative(this, x, y, table, family, exact, error)
    class(study_field_t), intent(in) :: this
    !> Places, m
    real(wp), intent(in) :: x(:), y(:)
    !> What `derivatives` gave there, up to the second degree at least
    real(wp), intent(in) :: table(0:, :)
    !> 1: ∂u/∂x and ∂u/∂y; 2: ∇²u
    integer, intent(in) :: family
    !> A column for each component
    real(wp), intent(out) :: exact(:, :)
    !> A given derivative gives no number somewhere
    type(error_t), allocatable, intent(out) :: error
    integer :: k, given

    do k = 1, size(exact, 2)
      given = merge(3, k, family == 2)
      if (this%exact(given)%value /= '') then
        call evaluate(this%exact(given)%value, this%place, x, y, exact(:, k), error)
        if (allocated(error)) return
      else if (family == 2) then
        exact(:, k) = table(derivative_index(2, 0), :) + table(derivative_index(0, 2), :)
      else
        exact(:, k) = table(derivative_index(2 - k, k - 1), :)
      end if
    end do
  end subroutine exact_derivative

end module calor_study_field
