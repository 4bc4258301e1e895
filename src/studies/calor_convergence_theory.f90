!> The orders of convergence that follow from the Taylor expansion of a scheme's truncation error.
!>
!> The term of degree k of the expansion of a derivative of order s is a moment Σ a_ij r^k times a
!> derivative of the field. It is of the size h^(k-s) (Δ/h)^q: q is 0 where the integral that the
!> moment approximates does not vanish, and says otherwise how well sums over particles stand for
!> integrals. The derivation is in docs/convergence.md.
!>
!> Source: R. Fatehi, M.T. Manzari, Comput. Math. Appl. 61 (2011) 482–498, carried on to sums over
!> jittered lattices.
module calor_convergence_theory
  use calor_convergence_schemes, only: study_scheme_t
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: predicted_order, term_order, kernel_smoothness
  public :: fixed_ratio, growing_ratio, fixed_spacing, way_names
  public :: regular_cloud, irregular_cloud, no_order, is_order

  !> The ways of refining: Δ → 0 at fixed h/Δ; h → 0 with Δ ~ h²; h → 0 at fixed Δ
  integer, parameter :: fixed_ratio = 1, growing_ratio = 2, fixed_spacing = 3
  character(len=13), parameter :: way_names(*) = [character(len=13) :: &
                                                  'fixed_ratio', 'growing_ratio', 'fixed_spacing']
  !> The clouds: a lattice or a hexagonal one, and one displaced at random
  integer, parameter :: regular_cloud = 1, irregular_cloud = 2
  !> Stands for an order that is not known, or of a term that vanishes
  real(wp), parameter :: no_order = huge(1.0_wp)

contains

  !> Whether an order is a number.
  elemental function is_order(order) result(answer)
    !> An order, or `no_order`
    real(wp), intent(in) :: order
    logical :: answer

    answer = order < no_order
  end function is_order

  !> How many times a kernel falls off at its edge as (1 - q) does: f ~ (1 - q)^m.
  function kernel_smoothness(kernel) result(m)
    !> The kernel
    class(kernel_t), intent(in) :: kernel
    integer :: m
    real(wp), parameter :: near = 1.0e-3_wp
    real(wp) :: f(2), df(2), ddf(2)

    call kernel%profile([1 - 2*near, 1 - near], f, df, ddf)
    m = nint(log(f(1)/f(2))/log(2.0_wp))
  end function kernel_smoothness

  !> The order in the limit: the least of those of the terms. `no_order` where the scheme is not
  !> understood.
  pure function predicted_order(scheme, smoothness, cloud, way) result(order)
    !> The scheme
    type(study_scheme_t), intent(in) :: scheme
    !> `kernel_smoothness` of the kernel
    integer, intent(in) :: smoothness
    !> `regular_cloud` or `irregular_cloud`
    integer, intent(in) :: cloud
    !> One of the ways of refining
    integer, intent(in) :: way
    real(wp) :: order
    integer :: k

    order = no_order
    if (.not. scheme%understood) return
    do k = 0, scheme%last_term()
      order = min(order, term_order(scheme, k, smoothness, cloud, way))
      ! As h > Δ, no term of higher degree overtakes one that does not vanish with Δ/h.
      if (is_order(order) .and. stands_for_integral(scheme, k)) exit
    end do
  end function predicted_order

  !> The order of one term, in Δ for `fixed_ratio` and in h otherwise; `no_order` where it vanishes.
  pure function term_order(scheme, degree, smoothness, cloud, way) result(order)
    !> The scheme
    type(study_scheme_t), intent(in) :: scheme
    !> Degree of the term
    integer, intent(in) :: degree
    !> `kernel_smoothness` of the kernel
    integer, intent(in) :: smoothness
    !> `regular_cloud` or `irregular_cloud`
    integer, intent(in) :: cloud
    !> One of the ways of refining
    integer, intent(in) :: way
    real(wp) :: order
    real(wp) :: of_length, of_sums

    order = no_order
    if (degree <= scheme%exact_degree) return
    if (cloud == regular_cloud .and. degree <= scheme%lattice_degree) return
    if (cloud == regular_cloud .and. is_odd(scheme, degree)) return
    of_length = degree - scheme%family
    of_sums = 0
    if (.not. stands_for_integral(scheme, degree)) then
      if (cloud == irregular_cloud) then
        of_sums = 2
      else
        of_sums = smoothness + 1.5_wp - scheme%kernel_derivatives
      end if
    end if
    ! A compact row has the size of the spacing, and its sums are no better for more neighbours.
    if (scheme%compact) then
      select case (way)
      case (fixed_ratio)
        order = of_length
      case (growing_ratio)
        order = 2*of_length
      case default
        order = 0
      end select
      return
    end if
    select case (way)
    case (fixed_ratio)
      order = of_length
    case (growing_ratio)
      order = of_length + of_sums
    case default
      order = of_length - of_sums
    end select
  end function term_order

  !> Terms whose parts on opposite sides of the particle cancel: on regular clouds nothing is left.
  pure function is_odd(scheme, degree)
    type(study_scheme_t), intent(in) :: scheme
    integer, intent(in) :: degree
    logical :: is_odd

    is_odd = mod(degree + scheme%family, 2) /= 0
  end function is_odd

  !> Whether the moment of a term that does not vanish approximates an integral other than 0, so
  !> that it stays however many neighbours there are.
  pure function stands_for_integral(scheme, degree)
    type(study_scheme_t), intent(in) :: scheme
    integer, intent(in) :: degree
    logical :: stands_for_integral

    stands_for_integral = degree > scheme%family .and. .not. is_odd(scheme, degree)
  end function stands_for_integral

end module calor_convergence_theory
