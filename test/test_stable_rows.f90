!> Tests of row quality, repairs and the stability certificate.
module test_stable_rows
  use calor_constants, only: pi
  use calor_error, only: error_t
  use calor_evolution, only: evolution_t
  use calor_kinds, only: wp, ip, i8
  use calor_laplacian_positive, only: positive_t
  use calor_laplacian_scheme, only: laplacian_scheme_t
  use calor_laplacian_schemes, only: make_laplacian_scheme
  use calor_linear_programme, only: minimise
  use calor_random, only: random_uniform
  use calor_rightmost_eigenvalue, only: rightmost_t, find_rightmost, jacobian_spectrum
  use calor_row_quality, only: row_quality_t, measure_rows
  use calor_row_report, only: row_report_t
  use calor_sparse_operator, only: sparse_operator_t
  use calor_stable_rows, only: assemble_stable_rows, row_repairs_t, as_written, support_grown, &
                               inexact_stencil, no_stencil
  use test_support, only: discretisation_t, unit_square
  use testdrive, only: new_unittest, unittest_type, error_type, check
  implicit none (type, external)
  private

  public :: collect_stable_rows

  !> u_t = A u for pairs of unknowns that turn and decay, (a b; -b a), and single ones
  type, extends(evolution_t) :: modes_t
    !> Real part a and imaginary part b of each pair
    real(wp), allocatable :: a(:), b(:)
  contains
    procedure :: unknowns
    procedure :: rate
    procedure :: jacobian_product
    procedure :: impose
    procedure :: clear_prescribed
    procedure :: inspect
  end type modes_t

contains

  subroutine collect_stable_rows(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('linear programme: known vertices', test_linear_programme), &
                new_unittest('linear programme: against all vertices', test_all_vertices), &
                new_unittest('positive stencil of a lattice is the five-point one', &
                             test_five_point), &
                new_unittest('positive rows are exact and non-negative', test_positive_rows), &
                new_unittest('row quality', test_quality), &
                new_unittest('good rows are left as written', test_good_rows), &
                new_unittest('grown rows are good and exact', test_growth), &
                new_unittest('without neighbours on one side a row is inexact', test_one_sided), &
                new_unittest('rightmost eigenvalue of a small system', test_dense), &
                new_unittest('rightmost eigenvalue of a large system', test_arnoldi), &
                new_unittest('an unstable mode among many', test_unstable_mode) &
                ]
  end subroutine collect_stable_rows

  subroutine test_linear_programme(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: tableau(0:2, 0:5), solution(3)
    real(wp), parameter :: constraints(2, 3) = reshape([1.0_wp, 0.0_wp, 1.0_wp, 1.0_wp, 0.0_wp, &
                                                        1.0_wp], [2, 3])
    integer :: basis(2)
    logical :: feasible

    ! a₁ + a₂ = 1, a₂ + a₃ = 2: a₂ = t, a₁ = 1 - t, a₃ = 2 - t with 0 ≤ t ≤ 1
    call minimise([1.0_wp, 1.0_wp, 1.0_wp], constraints, [1.0_wp, 2.0_wp], solution, tableau, &
                  basis, &
                  feasible)
    call check(error, feasible .and. maxval(abs(solution - [0.0_wp, 1.0_wp, 1.0_wp])) < 1.0e-14_wp)
    if (allocated(error)) return
    call minimise([1.0_wp, 3.0_wp, 1.0_wp], constraints, [1.0_wp, 2.0_wp], solution, tableau, &
                  basis, &
                  feasible)
    call check(error, feasible .and. maxval(abs(solution - [1.0_wp, 0.0_wp, 2.0_wp])) < 1.0e-14_wp)
    if (allocated(error)) return
    ! a₁ + a₂ = 0 forces a₁ = a₂ = 0: a degenerate vertex
    call minimise([1.0_wp, 1.0_wp, 1.0_wp], constraints, [0.0_wp, 2.0_wp], solution, tableau, &
                  basis, &
                  feasible)
    call check(error, feasible .and. maxval(abs(solution - [0.0_wp, 0.0_wp, 2.0_wp])) < 1.0e-14_wp)
    if (allocated(error)) return
    ! Negative coefficients only: nothing positive can be reached.
    call minimise([1.0_wp, 1.0_wp, 1.0_wp], -constraints, [1.0_wp, 2.0_wp], solution, tableau, &
                  basis, feasible)
    call check(error,.not. feasible)
    if (allocated(error)) return
    call check(error, maxval(abs(solution)), 0.0_wp)
  end subroutine test_linear_programme

  !> Random programmes of two constraints: the least cost over all pairs of basic variables.
  subroutine test_all_vertices(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: n = 7
    real(wp) :: tableau(0:2, 0:n + 2), solution(n), constraints(2, n), cost(n), least, bound(2), &
        pair(2)
    real(wp) :: determinant
    integer :: basis(2), trial, i, j, k
    logical :: feasible, any_vertex

    do trial = 1, 300
      do k = 1, n
        cost(k) = random_uniform(trial, int(3*k, i8))
        constraints(1, k) = 2*random_uniform(trial, int(3*k + 1, i8)) - 1
        constraints(2, k) = 2*random_uniform(trial, int(3*k + 2, i8)) - 1
      end do
      bound = [1.0_wp, 0.0_wp]
      least = huge(1.0_wp)
      any_vertex = .false.
      do i = 1, n
        do j = i + 1, n
          determinant = constraints(1, i)*constraints(2, j) - constraints(1, j)*constraints(2, i)
          pair(1) = (bound(1)*constraints(2, j) - bound(2)*constraints(1, j))/determinant
          pair(2) = (bound(2)*constraints(1, i) - bound(1)*constraints(2, i))/determinant
          if (any(pair < 0)) cycle
          any_vertex = .true.
          least = min(least, cost(i)*pair(1) + cost(j)*pair(2))
        end do
      end do
      call minimise(cost, constraints, bound, solution, tableau, basis, feasible)
      call check(error, feasible .eqv. any_vertex)
      if (allocated(error)) return
      if (.not. feasible) cycle
      call check(error, all(solution >= 0) .and. &
                 maxval(abs(matmul(constraints, solution) - bound)) < 1.0e-9_wp)
      if (allocated(error)) return
      call check(error, dot_product(cost, solution), least, thr=1.0e-9_wp*(1 + least))
      if (allocated(error)) return
    end do
  end subroutine test_all_vertices

  subroutine test_five_point(error)
    type(error_type), allocatable, intent(out) :: error
    type(discretisation_t) :: cloud
    type(sparse_operator_t) :: operator
    integer(i8) :: from, to
    integer :: row

    cloud = unit_square(10, 'lattice', 0.0_wp, 1, 'wendland_c2', 2.6_wp)
    call cloud%laplacian('positive', operator)
    do row = 1, operator%rows()
      if (.not. cloud%inside(row)) cycle
      from = operator%first(row)
      to = operator%first(row + 1) - 1
      call check(error, count(operator%weight(from:to) > 1.0e-6_wp), 4)
      if (allocated(error)) return
      call check(error, maxval(operator%weight(from:to)), 100.0_wp, thr=1.0e-8_wp)
      if (allocated(error)) return
    end do
  end subroutine test_five_point

  subroutine test_positive_rows(error)
    type(error_type), allocatable, intent(out) :: error
    type(discretisation_t) :: cloud
    type(sparse_operator_t) :: operator
    type(row_quality_t) :: quality
    integer :: seed

    do seed = 1, 5
      cloud = unit_square(16, 'jittered', 0.3_wp, seed, 'wendland_c2', 2.6_wp)
      call cloud%laplacian('positive', operator)
      call measure_rows(operator, cloud%x, cloud%y, cloud%radius, 2, quality)
      call check(error, all(operator%weight >= 0.0_wp))
      if (allocated(error)) return
      call check(error, maxval(abs(quality%ratio - 1), cloud%inside) < 1.0e-12_wp)
      if (allocated(error)) return
      call check(error, maxval(quality%residual, cloud%inside) < 1.0e-10_wp)
      if (allocated(error)) return
      call check(error, maxval(quality%neighbours, cloud%inside) <= 5)
      if (allocated(error)) return
    end do
  end subroutine test_positive_rows

  !> A row known by heart: -4 u + 2 u_right + 2 u_left + 1 u_up - 1 u_down over Δ² with Δ = 0.5, h =
  !> 1
  subroutine test_quality(error)
    type(error_type), allocatable, intent(out) :: error
    type(sparse_operator_t) :: operator
    type(row_quality_t) :: quality
    real(wp), parameter :: x(5) = [0.0_wp, 0.5_wp, -0.5_wp, 0.0_wp, 0.0_wp]
    real(wp), parameter :: y(5) = [0.0_wp, 0.0_wp, 0.0_wp, 0.5_wp, -0.5_wp]
    real(wp), parameter :: radius(5) = 1.0_wp

    operator%target = [1_ip]
    operator%first = [1_i8, 5_i8]
    operator%index = [2_ip, 3_ip, 4_ip, 5_ip]
    operator%weight = [8.0_wp, 8.0_wp, 4.0_wp, -4.0_wp]
    operator%diagonal = [-16.0_wp]
    call measure_rows(operator, x, y, radius, 2, quality)
    call check(error, quality%ratio(1), 24.0_wp/16)
    if (allocated(error)) return
    ! Moments: x 0, y 4 (ought to be 0), x² 4 (2), xy 0, y² 0 (2)
    call check(error, quality%residual(1), 4.0_wp)
    if (allocated(error)) return
    call check(error, quality%neighbours(1), 4)
    if (allocated(error)) return
    call check(error, quality%stiffness(1), 16*pi/5, thr=1.0e-12_wp)
    if (allocated(error)) return
    call check(error, operator%gershgorin_right_end(), 8.0_wp)
    if (allocated(error)) return
    operator%diagonal = [16.0_wp]
    call measure_rows(operator, x, y, radius, 2, quality)
    call check(error, quality%ratio(1), huge(1.0_wp))
  end subroutine test_quality

  !> Assemble fatehi_manzari's stable rows inside of a cloud.
  subroutine repair(cloud, operator, repairs)
    type(discretisation_t), intent(inout) :: cloud
    type(sparse_operator_t), intent(out) :: operator
    type(row_repairs_t), intent(out) :: repairs
    class(laplacian_scheme_t), allocatable :: scheme
    type(row_report_t) :: report
    type(error_t), allocatable :: failure
    integer :: k

    call make_laplacian_scheme('fatehi_manzari', scheme, failure)
    call assemble_stable_rows(scheme, cloud%kernel, cloud%x, cloud%y, cloud%volume, cloud%radius, &
                              pack([(int(k, ip), k=1, size(cloud%x))], cloud%inside), operator, &
                              report, repairs)
  end subroutine repair

  subroutine test_good_rows(error)
    type(error_type), allocatable, intent(out) :: error
    type(discretisation_t) :: cloud
    type(sparse_operator_t) :: operator, plain
    type(row_repairs_t) :: repairs
    integer :: k

    ! Four neighbours on a lattice: B̂ is singular, but the rows are good.
    cloud = unit_square(12, 'lattice', 0.0_wp, 1, 'wendland_c2', 1.2_wp)
    call repair(cloud, operator, repairs)
    call check(error, all(repairs%repair == as_written))
    if (allocated(error)) return
    call cloud%laplacian('fatehi_manzari', plain, &
                         targets=pack([(int(k, ip), k=1, size(cloud%x))], cloud%inside))
    call check(error, maxval(abs(operator%weight - plain%weight)), 0.0_wp)
  end subroutine test_good_rows

  subroutine test_growth(error)
    type(error_type), allocatable, intent(out) :: error
    type(discretisation_t) :: cloud
    type(sparse_operator_t) :: operator
    type(row_repairs_t) :: repairs
    integer :: seed

    do seed = 1, 5
      cloud = unit_square(16, 'jittered', 0.45_wp, seed, 'wendland_c2', 1.5_wp)
      call repair(cloud, operator, repairs)
      call check(error, count(repairs%repair == support_grown) > 50)
      if (allocated(error)) return
      call check(error, all(repairs%repair < inexact_stencil))
      if (allocated(error)) return
      call check(error, maxval(repairs%quality%ratio) <= 1.2_wp)
      if (allocated(error)) return
      call check(error, maxval(repairs%quality%residual) <= 1.0e-7_wp)
      if (allocated(error)) return
      call check(error, maxval(cloud%radius) > 1.5_wp/16)
      if (allocated(error)) return
    end do
  end subroutine test_growth

  !> A particle at the edge, with no wall: no row that is exact for linear fields has weights of one
  !> sign there. One far inside is not concerned.
  subroutine test_one_sided(error)
    type(error_type), allocatable, intent(out) :: error
    type(discretisation_t) :: cloud
    type(sparse_operator_t) :: operator
    type(row_repairs_t) :: repairs
    integer :: k

    cloud = unit_square(8, 'jittered', 0.2_wp, 1, 'wendland_c2', 2.1_wp)
    ! The corner loses its wall.
    cloud%inside(1) = .true.
    call repair(cloud, operator, repairs)
    do k = 1, operator%rows()
      if (operator%target(k) == 1) then
        call check(error, repairs%repair(k), no_stencil)
      else
        call check(error, repairs%repair(k) < inexact_stencil)
      end if
      if (allocated(error)) return
    end do
  end subroutine test_one_sided

  subroutine test_dense(error)
    type(error_type), allocatable, intent(out) :: error
    type(modes_t) :: modes
    type(rightmost_t) :: rightmost
    real(wp), allocatable :: real_parts(:), imaginary_parts(:)

    modes%a = [-3.0_wp, -1.0_wp, -50.0_wp]
    modes%b = [0.0_wp, 7.0_wp, 2.0_wp]
    call find_rightmost(modes, 55.0_wp, rightmost)
    call check(error, rightmost%growth_rate, -1.0_wp, thr=1.0e-12_wp)
    if (allocated(error)) return
    call check(error, rightmost%frequency, 7.0_wp, thr=1.0e-12_wp)
    if (allocated(error)) return
    call jacobian_spectrum(modes, real_parts, imaginary_parts)
    call check(error, sum(real_parts), -108.0_wp, thr=1.0e-10_wp)
    if (allocated(error)) return
    call check(error, count(abs(imaginary_parts) > 1.0_wp), 4)
  end subroutine test_dense

  !> A crowded spectrum like a Laplacian's, k² from 1 to a million
  subroutine test_arnoldi(error)
    type(error_type), allocatable, intent(out) :: error
    type(modes_t) :: modes
    type(rightmost_t) :: rightmost
    integer :: k

    modes%a = [(-real(k, wp)**2, k=1, 1000)]
    modes%b = [(0.0_wp, k=1, 1000)]
    call find_rightmost(modes, 1.05e6_wp, rightmost)
    call check(error, rightmost%converged)
    if (allocated(error)) return
    ! The search bounds the largest real part to a small part of the spectrum's width.
    call check(error, rightmost%growth_rate, -1.0_wp, thr=1.0e6_wp*1.0e-4_wp)
    if (allocated(error)) return
    call check(error, rightmost%growth_rate < 0)
  end subroutine test_arnoldi

  subroutine test_unstable_mode(error)
    type(error_type), allocatable, intent(out) :: error
    type(modes_t) :: modes
    type(rightmost_t) :: rightmost
    integer :: k

    modes%a = [(-real(k, wp)**2, k=1, 1000)]
    modes%b = [(0.0_wp, k=1, 1000)]
    modes%a(500) = 30.0_wp
    modes%b(500) = 1000.0_wp
    call find_rightmost(modes, 1.05e6_wp, rightmost)
    call check(error, rightmost%growth_rate, 30.0_wp, thr=0.1_wp)
    if (allocated(error)) return
    call check(error, rightmost%frequency, 1000.0_wp, thr=1.0_wp)
    if (allocated(error)) return
    ! Unknowns come in pairs: the mode lives in 999 and 1000.
    call check(error, rightmost%place == 999 .or. rightmost%place == 1000)
  end subroutine test_unstable_mode

  pure function unknowns(this) result(number)
    class(modes_t), intent(in) :: this
    integer :: number

    number = 2*size(this%a)
  end function unknowns

  subroutine rate(this, time, u, du)
    class(modes_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    real(wp), intent(out), contiguous :: du(:)

    associate (unused => time)
    end associate
    call this%jacobian_product(u, du)
  end subroutine rate

  subroutine jacobian_product(this, v, product)
    class(modes_t), intent(inout) :: this
    real(wp), intent(in), contiguous :: v(:)
    real(wp), intent(out), contiguous :: product(:)

    product(1::2) = this%a*v(1::2) + this%b*v(2::2)
    product(2::2) = this%a*v(2::2) - this%b*v(1::2)
  end subroutine jacobian_product

  subroutine impose(this, time, u)
    class(modes_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(inout), contiguous :: u(:)

    associate (unused => this, unused_time => time, unused_state => u)
    end associate
  end subroutine impose

  subroutine clear_prescribed(this, v)
    class(modes_t), intent(in) :: this
    real(wp), intent(inout), contiguous :: v(:)

    associate (unused => this, unused_vector => v)
    end associate
  end subroutine clear_prescribed

  subroutine inspect(this, time, u, error)
    class(modes_t), intent(inout) :: this
    real(wp), intent(in) :: time
    real(wp), intent(in), contiguous :: u(:)
    type(error_t), allocatable, intent(out) :: error

    associate (unused => this, unused_time => time, unused_state => u)
    end associate
  end subroutine inspect

end module test_stable_rows
