!> What is lost where the flux of an initial temperature jumps at an interface of two materials.
!>
!> The interface is then a source of heat, q = n·K∇u beyond less n·K∇u here, which flows off at
!> once: after a while t the kink is as wide as √(α t). Rows across interfaces know of temperatures
!> with continuous fluxes only. What they make of the kink is wrong by some q Δ in some spacings'
!> width, which is felt later on to second order, and rows of any degree are wrong so.
!>
!> So there the solution with which the error is compared starts from another field, without the
!> kink, that is the same later on. What is added to the initial temperature, at the distance s from
!> the interface, is q R/K δ(s/R), with δ = 0 beyond the reach R and
!>
!>     [δ] = 0,  [K δ'] = -K,  [L δ] = 0,  [K (L δ)'] = 0,   L = K/(ρc) d²/ds²,
!>     ∫ ρc p δ ds = 0  for all cubic p that are continuous so: 1, s/K, s² ρc/K and s³ ρc/K²:
!>
!> solutions that vary slowly go like these p about the interface, and as the operator is symmetric
!> in the scalar product with ρc, a field orthogonal to such has no part in them. On either side δ
!> is (1 - r²)⁴ times a cubic polynomial: eight coefficients for eight conditions.
module calor_initial_fluxes
  use calor_cloud, only: cloud_t
  use calor_expression, only: expression_t
  use calor_kinds, only: wp, ip
  use calor_lapack, only: dgesv
  use calor_material_flow, only: crossing_t
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_scene_materials, only: scene_materials_t
  use calor_sparse_operator, only: sparse_operator_t
  implicit none (type, external)
  private

  public :: find_flux_errors, smooth_kink, kink_value

  !> R in spacings: a higher order needs the field smooth
  real(wp), parameter :: reach = 3.5_wp
  !> The power of 1 - r²
  integer, parameter :: power = 4
  !> Slopes at an interface come from so small a part of a spacing
  real(wp), parameter :: close_by = 1.0e-3_wp
  !> Coefficients on one side
  integer, parameter :: terms = 4

contains

  !> Add what is to be added to an initial temperature at particles near interfaces, but for those
  !> that have a deviation already.
  subroutine find_flux_errors(field, cloud, materials, operator, deviation)
    !> The initial temperature
    type(expression_t), intent(in) :: field
    !> The cloud
    type(cloud_t), intent(in) :: cloud
    !> Its materials
    type(scene_materials_t), intent(inout) :: materials
    !> Rows on it
    type(sparse_operator_t), intent(in) :: operator
    !> In units of the field
    real(wp), intent(inout) :: deviation(:)
    type(neighbour_list_t) :: list
    type(crossing_t), allocatable :: crossing(:)
    integer(ip), allocatable :: particle(:)
    integer, allocatable :: owner(:)
    logical, allocatable :: near(:)
    real(wp) :: coefficient(terms, 2), jump, length
    integer :: k, i

    length = reach*cloud%spacing
    particle = pack(operator%target, &
                    [(materials%reaches_across(operator, k), k=1, operator%rows())])
    if (size(particle) == 0) return
    allocate (near(size(deviation)), source=.false.)
    near(particle) = .true.
    call build_neighbour_list(cloud%x, cloud%y, [(length, k=1, size(particle))], list, particle)
    near(list%index) = .true.
    particle = pack([(int(i, ip), i=1, size(near))], near .and. .not. abs(deviation) > 0)
    call materials%see_interfaces(cloud, particle, crossing, owner)
    do k = 1, size(crossing)
      associate (seen => crossing(k), p => particle(owner(k)), r => norm2(crossing(k)%foot)/length)
        if (r >= 1) cycle
        jump = flux(seen%there%n, seen%there%m, 1) - flux(seen%here%n, seen%here%m, -1)
        if (.not. abs(jump) > 0) cycle
        call smooth_kink(seen%there%n/seen%here%n, seen%capacity_ratio, coefficient)
        deviation(p) = deviation(p) + jump*length/seen%here%n*kink_value(coefficient(:, 1), r)
      end associate
    end do

  contains

    !> n·K∇u on one side of the foot of crossing k
    function flux(across, aside, side) result(value)
      !> n·K n and n·K t
      real(wp), intent(in) :: across, aside
      !> 1: beyond, -1: here
      integer, intent(in) :: side
      real(wp) :: value
      real(wp) :: x(5), y(5), u(5), step

      step = close_by*cloud%spacing*side
      associate (n => crossing(k)%normal, foot => crossing(k)%foot)
        associate (p => particle(owner(k)), s => step*[1, 2, 3, 1, 1], t => step*[0, 0, 0, 1, -1])
          x = cloud%x(p) + foot(1) + s*n(1) - t*n(2)
          y = cloud%y(p) + foot(2) + s*n(2) + t*n(1)
        end associate
      end associate
      call field%evaluate(x, y, 0.0_wp, values=u)
      value = across*(-5*u(1) + 8*u(2) - 3*u(3))/(2*step) + aside*(u(4) - u(5))/(2*step)
    end function flux

  end subroutine find_flux_errors

  !> The coefficients of δ here and beyond, for K = 1 and ρc = 1 here.
  subroutine smooth_kink(conductivity, capacity, coefficient)
    !> K and ρc beyond
    real(wp), intent(in) :: conductivity, capacity
    !> Of 1, r, r² and r³, r = |s|/R; a column for each side
    real(wp), intent(out) :: coefficient(terms, 2)
    real(wp) :: matrix(2*terms, 2*terms), right(2*terms, 1), k, c, sign, scale
    integer :: pivot(2*terms), info, side, j, m

    matrix = 0
    do side = 1, 2
      k = merge(1.0_wp, conductivity, side == 1)
      c = merge(1.0_wp, capacity, side == 1)
      ! Outwards, derivatives of odd order have the other sign here.
      sign = merge(-1.0_wp, 1.0_wp, side == 1)
      associate (first => terms*(side - 1))
        matrix(1, first + 1) = sign
        matrix(2, first + 2) = k
        matrix(3, first + 3) = sign*k/c
        matrix(3, first + 1) = -power*sign*k/c
        matrix(4, first + 4) = k*k/c
        matrix(4, first + 2) = -power*k*k/c
        do m = 0, 3
          ! c times 1, s/K, s² c/K and s³ c/K²
          do j = 0, terms - 1
            matrix(5 + m, first + 1 + j) = sign**m*c*k**(-mod(m, 2))*(c/k)**(m/2)*moment(j + m)
          end do
        end do
      end associate
    end do
    right = 0
    right(2, 1) = -1
    do j = 1, 2*terms
      scale = maxval(abs(matrix(j, :)))
      matrix(j, :) = matrix(j, :)/scale
      right(j, 1) = right(j, 1)/scale
    end do
    call dgesv(2*terms, 1, matrix, 2*terms, pivot, right, 2*terms, info)
    if (info /= 0) right = 0
    coefficient = reshape(right(:, 1), [terms, 2])
  end subroutine smooth_kink

  !> ∫ rʲ (1 - r²)⁴ dr from 0 to 1
  pure function moment(j) result(value)
    integer, intent(in) :: j
    real(wp) :: value

    value = 0.5_wp*gamma(0.5_wp*(j + 1))*gamma(power + 1.0_wp)/gamma(0.5_wp*(j + 1) + power + 1)
  end function moment

  !> δ on one side
  pure function kink_value(coefficient, r) result(value)
    !> Its coefficients, and |s|/R
    real(wp), intent(in) :: coefficient(terms), r
    real(wp) :: value

    value = 0
    if (r >= 1) return
    value = (1 - r**2)**power*(coefficient(1) + r*(coefficient(2) + r*(coefficient(3) + &
                                                                       r*coefficient(4))))
  end function kink_value

end module calor_initial_fluxes
