!> The smoothing kernel: what every kernel offers.
!>
!> A kernel is W(r, h) = f(q)/h² with q = r/h, where h is the radius of its compact support:
!> W > 0 for r < h and W = 0 beyond. A kernel of one's own extends `kernel_t` with the profile f.
module calor_kernel
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: kernel_t

  !> A smoothing kernel in two dimensions
  type, abstract :: kernel_t
  contains
    !> f(q), f'(q) and f''(q), normalised: 2π ∫₀¹ f(q) q dq = 1
    procedure(profile_interface), deferred :: profile
    !> W(r, h), in 1/m²
    procedure :: value => kernel_value
    !> ∂W/∂r, in 1/m³
    procedure :: derivative => kernel_derivative
    !> ∂²W/∂r², in 1/m⁴
    procedure :: second_derivative => kernel_second_derivative
  end type kernel_t

  abstract interface
    !> Profile of the kernel and its first two derivatives at many places; zero for q ≥ 1.
    pure subroutine profile_interface(this, q, f, df, ddf)
      import :: kernel_t, wp
      implicit none (type, external)
      class(kernel_t), intent(in) :: this
      !> Distances over support radius, not negative
      real(wp), intent(in) :: q(:)
      !> f, f' and f'', each of the size of q
      real(wp), intent(out) :: f(:), df(:), ddf(:)
    end subroutine profile_interface
  end interface

contains

  pure function kernel_value(this, r, h) result(w)
    class(kernel_t), intent(in) :: this
    !> Distance and support radius, m
    real(wp), intent(in) :: r, h
    real(wp) :: w
    real(wp) :: f(1), df(1), ddf(1)

    call this%profile([r/h], f, df, ddf)
    w = f(1)/h**2
  end function kernel_value

  pure function kernel_derivative(this, r, h) result(w)
    class(kernel_t), intent(in) :: this
    !> Distance and support radius, m
    real(wp), intent(in) :: r, h
    real(wp) :: w
    real(wp) :: f(1), df(1), ddf(1)

    call this%profile([r/h], f, df, ddf)
    w = df(1)/h**3
  end function kernel_derivative

  pure function kernel_second_derivative(this, r, h) result(w)
    class(kernel_t), intent(in) :: this
    !> Distance and support radius, m
    real(wp), intent(in) :: r, h
    real(wp) :: w
    real(wp) :: f(1), df(1), ddf(1)

    call this%profile([r/h], f, df, ddf)
    w = ddf(1)/h**4
  end function kernel_second_derivative

end module calor_kernel
