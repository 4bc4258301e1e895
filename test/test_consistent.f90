!> The consistent schemes: exactness, order of operator and solution, stability, on any cloud.
module test_consistent
  use calor_cloud, only: cloud_t
  use calor_constants, only: pi
  use calor_error, only: error_t
  use calor_gradient_consistent, only: consistent_gradient_t
  use calor_kernel, only: kernel_t
  use calor_kernels, only: make_kernel
  use calor_kinds, only: wp, ip
  use calor_laplacian_consistent, only: consistent_t, natural_support
  use calor_laplacian_scheme, only: row_rule_t
  use calor_rectangle_cloud, only: make_rectangle
  use calor_row_report, only: row_report_t
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene
  use calor_simulation, only: simulation_t
  use calor_sparse_operator, only: sparse_operator_t
  use calor_stable_rows, only: assemble_stable_rows, row_repairs_t, support_grown
  use calor_sufficient_rows, only: assemble_sufficient_gradient, assemble_sufficient_laplacian
  use calor_text, only: to_text
  use testdrive, only: new_unittest, unittest_type, test_error => error_type, check
  implicit none (type, external)
  private

  public :: collect_consistent

  !> Clouds that every property is tested on
  character(len=9), parameter :: arrangements(*) = [character(len=9) :: 'lattice', 'jittered', &
                                                    'hexagonal']
  integer, parameter :: orders(*) = [2, 4, 6, 8]

contains

  subroutine collect_consistent(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('laplacian exact up to degree p + 1, at walls too', test_laplacian), &
                new_unittest('gradient exact up to degree p, at walls too', test_gradient), &
                new_unittest('stable rows are exact and good', test_stable), &
                new_unittest('order of the operators', test_operator_order), &
                new_unittest('order of the solution', test_solution_order), &
                new_unittest('order 4 on four neighbours a side', test_lattice_support), &
                new_unittest('too few particles are told', test_too_few), &
                new_unittest('scales', test_scales) &
                ]
  end subroutine collect_consistent

  !> A particle's own monomial ((x - x_i)/h)ᵃ ((y - y_i)/h)ᵇ under a derivative's row
  pure function applied(operator, row, x, y, h, a, b) result(value)
    type(sparse_operator_t), intent(in) :: operator
    integer, intent(in) :: row, a, b
    real(wp), intent(in) :: x(:), y(:), h
    real(wp) :: value

    associate (j => operator%index(operator%first(row):operator%first(row + 1) - 1), &
               weight => operator%weight(operator%first(row):operator%first(row + 1) - 1), &
               i => operator%target(row))
      value = sum(weight*((x(j) - x(i))/h)**a*((y(j) - y(i))/h)**b)
      if (a + b == 0) value = value + operator%diagonal(row)
    end associate
  end function applied

  !> The largest error of a Laplacian's rows on monomials, in units of Σ|a_ij|
  pure function laplacian_defect(laplacian, x, y, radius, degree) result(defect)
    type(sparse_operator_t), intent(in) :: laplacian
    real(wp), intent(in) :: x(:), y(:), radius(:)
    integer, intent(in) :: degree
    real(wp) :: defect, expected, h, scale
    integer :: row, a, b

    defect = 0
    do row = 1, laplacian%rows()
      h = radius(laplacian%target(row))
      scale = sum(abs(laplacian%weight(laplacian%first(row):laplacian%first(row + 1) - 1)))
      do a = 0, degree
        do b = 0, degree - a
          expected = 0
          if ((a == 2 .and. b == 0) .or. (a == 0 .and. b == 2)) expected = 2/h**2
          defect = max(defect, abs(applied(laplacian, row, x, y, h, a, b) - expected)/scale)
        end do
      end do
    end do
  end function laplacian_defect

  subroutine a_cloud(n, arrangement, order, cloud, radius, targets, kernel)
    integer, intent(in) :: n, order
    character(len=*), intent(in) :: arrangement
    type(cloud_t), intent(out) :: cloud
    real(wp), allocatable, intent(out) :: radius(:)
    !> All particles, walls included
    integer(ip), allocatable, intent(out) :: targets(:)
    class(kernel_t), allocatable, intent(out) :: kernel
    type(error_t), allocatable :: failure
    integer :: k

    call make_rectangle([0.0_wp, 1.0_wp], [0.0_wp, 1.0_wp], 1.0_wp/n, arrangement, 0.3_wp, 3, &
                        cloud, failure)
    call make_kernel('wendland_c2', kernel, failure)
    allocate (radius(cloud%particles()), source=natural_support(order)/n)
    targets = [(int(k, ip), k=1, cloud%particles())]
  end subroutine a_cloud

  subroutine test_laplacian(error)
    type(test_error), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(sparse_operator_t) :: laplacian
    type(row_report_t) :: report
    class(kernel_t), allocatable :: kernel
    real(wp), allocatable :: radius(:)
    integer(ip), allocatable :: targets(:)
    integer :: k, p

    do p = 1, 8
      do k = 1, size(arrangements)
        call a_cloud(16, trim(arrangements(k)), p, cloud, radius, targets, kernel)
        call assemble_sufficient_laplacian(consistent_t(p), kernel, cloud%x, cloud%y, &
                                           cloud%volume, radius, targets, laplacian, report)
        call check(error, laplacian_defect(laplacian, cloud%x, cloud%y, radius, p + 1), 0.0_wp, &
                   thr=1.0e-10_wp, more='order '//to_text(p)//', '//arrangements(k))
        if (allocated(error)) return
      end do
    end do
  end subroutine test_laplacian

  subroutine test_gradient(error)
    type(test_error), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(sparse_operator_t) :: gradient(2)
    type(row_report_t) :: report
    class(kernel_t), allocatable :: kernel
    real(wp), allocatable :: radius(:)
    integer(ip), allocatable :: targets(:)
    real(wp) :: defect, expected(2)
    integer :: k, p, row, a, b, axis

    do p = 1, 8
      do k = 1, size(arrangements)
        call a_cloud(16, trim(arrangements(k)), p, cloud, radius, targets, kernel)
        call assemble_sufficient_gradient(consistent_gradient_t(p), kernel, cloud%x, cloud%y, &
                                          cloud%volume, radius, targets, gradient(1), &
                                          gradient(2), report)
        defect = 0
        do row = 1, size(targets)
          do a = 0, p
            do b = 0, p - a
              expected = 0
              if (a == 1 .and. b == 0) expected(1) = 1
              if (a == 0 .and. b == 1) expected(2) = 1
              do axis = 1, 2
                ! In units of h the derivative of x/h is 1
                defect = max(defect, abs(applied(gradient(axis), row, cloud%x, cloud%y, &
                                                 radius(row), a, b)*radius(row) - expected(axis)))
              end do
            end do
          end do
        end do
        call check(error, defect, 0.0_wp, thr=1.0e-8_wp, more='order '//to_text(p)//', '// &
                   arrangements(k))
        if (allocated(error)) return
      end do
    end do
  end subroutine test_gradient

  subroutine test_stable(error)
    type(test_error), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(consistent_t) :: scheme
    type(sparse_operator_t) :: laplacian
    type(row_report_t) :: report
    type(row_repairs_t) :: repairs
    type(row_rule_t) :: rule
    class(kernel_t), allocatable :: kernel
    real(wp), allocatable :: radius(:)
    integer(ip), allocatable :: targets(:)
    integer :: k, p

    do p = 2, 8, 2
      do k = 1, size(arrangements)
        call a_cloud(24, trim(arrangements(k)), p, cloud, radius, targets, kernel)
        targets = pack(targets, cloud%side == 0)
        scheme = consistent_t(p)
        rule = scheme%rule()
        call assemble_stable_rows(scheme, kernel, cloud%x, cloud%y, cloud%volume, radius, &
                                  targets, laplacian, report, repairs)
        call check(error, all(repairs%repair <= support_grown), 'rows replaced, order '// &
                   to_text(p)//', '//arrangements(k))
        if (allocated(error)) return
        call check(error, maxval(repairs%quality%ratio) <= rule%largest_ratio)
        if (allocated(error)) return
        call check(error, laplacian_defect(laplacian, cloud%x, cloud%y, radius, p + 1), 0.0_wp, &
                   thr=1.0e-10_wp, more='order '//to_text(p)//', '//arrangements(k))
        if (allocated(error)) return
      end do
    end do
  end subroutine test_stable

  !> Relative L2 error of Laplacian (1) and gradient (2) of sin(πx + 1) sin(πy + 2) inside, walls'
  !> neighbours included
  function operator_errors(n, jitter, order) result(deviation)
    integer, intent(in) :: n, order
    real(wp), intent(in) :: jitter
    real(wp) :: deviation(2)
    type(cloud_t) :: cloud
    type(sparse_operator_t) :: laplacian, gradient(2)
    type(row_report_t) :: report
    type(row_repairs_t) :: repairs
    class(kernel_t), allocatable :: kernel
    real(wp), allocatable :: radius(:), u(:), values(:), exact(:), other(:)
    integer(ip), allocatable :: targets(:)
    type(error_t), allocatable :: failure
    integer :: k

    call make_rectangle([0.0_wp, 1.0_wp], [0.0_wp, 1.0_wp], 1.0_wp/n, 'jittered', jitter, 3, &
                        cloud, failure)
    call make_kernel('wendland_c2', kernel, failure)
    targets = pack([(int(k, ip), k=1, cloud%particles())], cloud%side == 0)
    u = sin(pi*cloud%x + 1)*sin(pi*cloud%y + 2)
    allocate (values(size(targets)), other(size(targets)))
    allocate (radius(cloud%particles()), source=natural_support(order)/n)
    call assemble_stable_rows(consistent_t(order), kernel, cloud%x, cloud%y, cloud%volume, &
                              radius, targets, laplacian, report, repairs)
    call laplacian%apply(u, values)
    exact = -2*pi**2*u(targets)
    deviation(1) = norm2(values - exact)/norm2(exact)
    radius = natural_support(order)/n
    call assemble_sufficient_gradient(consistent_gradient_t(order), kernel, cloud%x, cloud%y, &
                                      cloud%volume, radius, targets, gradient(1), gradient(2), &
                                      report)
    call gradient(1)%apply(u, values)
    call gradient(2)%apply(u, other)
    associate (x => cloud%x(targets), y => cloud%y(targets))
      exact = pi*cos(pi*x + 1)*sin(pi*y + 2)
      deviation(2) = norm2(values - exact)/norm2(exact)
      exact = pi*sin(pi*x + 1)*cos(pi*y + 2)
      deviation(2) = max(deviation(2), norm2(other - exact)/norm2(exact))
    end associate
  end function operator_errors

  !> Order p on any cloud. High orders are measured over a factor of 3: which rows need how large a
  !> support differs from cloud to cloud, which a factor of 2 would show.
  subroutine test_operator_order(error)
    type(test_error), allocatable, intent(out) :: error
    real(wp), parameter :: jitters(*) = [0.0_wp, 0.1_wp, 0.3_wp]
    integer, parameter :: coarse = 24, fine(*) = [48, 48, 72, 72]
    real(wp) :: observed(2)
    integer :: k, j

    do k = 1, size(orders)
      do j = 1, size(jitters)
        observed = log(operator_errors(coarse, jitters(j), orders(k))/ &
                       operator_errors(fine(k), jitters(j), orders(k)))/ &
                   log(real(fine(k), wp)/coarse)
        call check(error, observed(1) >= orders(k) - 0.3_wp, 'Laplacian of order '// &
                   to_text(orders(k))//', jitter '//to_text(jitters(j))//': '// &
                   to_text(observed(1), digits=3))
        if (allocated(error)) return
        call check(error, observed(2) >= orders(k) - 0.3_wp, 'gradient of order '// &
                   to_text(orders(k))//', jitter '//to_text(jitters(j))//': '// &
                   to_text(observed(2), digits=3))
        if (allocated(error)) return
      end do
    end do
  end subroutine test_operator_order

  !> The plate's relative L2 error at t = 0.05. Runge–Kutta 4 at its stability limit adds next to
  !> nothing: the step of the fastest mode is far too short for the slow ones.
  subroutine plate_error(n, jitter, order, deviation, error)
    integer, intent(in) :: n, order
    real(wp), intent(in) :: jitter
    real(wp), intent(out) :: deviation
    type(test_error), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure

    call interpret_scene('&scene exact_expression = "sin(pi*x)*sin(pi*y)*exp(-2*pi^2*t)" / '// &
                         '&domain x_range = 0, 1 y_range = 0, 1 arrangement = "jittered" '// &
                         'spacing = '//to_text(1.0_wp/n)//' jitter = '//to_text(jitter)//' / '// &
                         '&scheme laplacian = "consistent" order = '//to_text(order)//' / '// &
                         '&initial temperature_expression = "sin(pi*x)*sin(pi*y)" / '// &
                         '&boundary on = "all" kind = "temperature" value = 0 / '// &
                         '&time end = 0.05 method = "runge_kutta_4" /', scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    if (.not. allocated(failure)) call simulation%run(failure)
    if (allocated(failure)) then
      call check(error, .false., failure%message)
      return
    end if
    deviation = simulation%relative_l2_error()
  end subroutine plate_error

  subroutine test_solution_order(error)
    type(test_error), allocatable, intent(out) :: error
    real(wp), parameter :: jitters(*) = [0.0_wp, 0.3_wp]
    real(wp) :: coarse, fine, observed
    integer :: k, j

    do k = 1, size(orders)
      do j = 1, size(jitters)
        call plate_error(20, jitters(j), orders(k), coarse, error)
        if (allocated(error)) return
        call plate_error(40, jitters(j), orders(k), fine, error)
        if (allocated(error)) return
        observed = log(coarse/fine)/log(2.0_wp)
        call check(error, observed >= orders(k) - 0.3_wp, 'order '//to_text(orders(k))// &
                   ', jitter '//to_text(jitters(j))//': '//to_text(observed, digits=3))
        if (allocated(error)) return
      end do
    end do
  end subroutine test_solution_order

  !> On a lattice monomials such as x⁵ and x³ are dependent on few neighbours; the minimum-norm row
  !> is exact all the same, and needs no more than the twenty neighbours within 2.8 spacings.
  subroutine test_lattice_support(error)
    type(test_error), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(sparse_operator_t) :: laplacian
    type(row_report_t) :: report
    type(row_repairs_t) :: repairs
    class(kernel_t), allocatable :: kernel
    real(wp), allocatable :: radius(:)
    integer(ip), allocatable :: targets(:)

    call a_cloud(16, 'lattice', 4, cloud, radius, targets, kernel)
    targets = pack(targets, abs(cloud%x - 0.5_wp) < 0.1_wp .and. abs(cloud%y - 0.5_wp) < 0.1_wp)
    call assemble_stable_rows(consistent_t(4), kernel, cloud%x, cloud%y, cloud%volume, radius, &
                              targets, laplacian, report, repairs)
    call check(error, report%singular_rows(), size(targets))
    if (allocated(error)) return
    call check(error, all(laplacian%first(2:) - laplacian%first(:laplacian%rows()) == 20))
    if (allocated(error)) return
    call check(error, laplacian_defect(laplacian, cloud%x, cloud%y, radius, 5), 0.0_wp, &
               thr=1.0e-12_wp)
  end subroutine test_lattice_support

  !> Nine particles do not determine a row of order 4: the report says so.
  subroutine test_too_few(error)
    type(test_error), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(sparse_operator_t) :: laplacian
    type(row_report_t) :: report
    class(kernel_t), allocatable :: kernel
    real(wp), allocatable :: radius(:)
    integer(ip), allocatable :: targets(:)

    call a_cloud(2, 'jittered', 4, cloud, radius, targets, kernel)
    call assemble_sufficient_laplacian(consistent_t(4), kernel, cloud%x, cloud%y, cloud%volume, &
                                       radius, targets, laplacian, report)
    call check(error, all(report%residual > 1.0e-3_wp))
  end subroutine test_too_few

  !> The same cloud 10⁹ times larger has the same rows but for the unit.
  subroutine test_scales(error)
    type(test_error), allocatable, intent(out) :: error
    real(wp), parameter :: factor = 2.0_wp**30
    type(cloud_t) :: cloud
    type(sparse_operator_t) :: small, large
    type(row_report_t) :: report
    class(kernel_t), allocatable :: kernel
    real(wp), allocatable :: radius(:)
    integer(ip), allocatable :: targets(:)

    call a_cloud(12, 'jittered', 6, cloud, radius, targets, kernel)
    call assemble_sufficient_laplacian(consistent_t(6), kernel, cloud%x, cloud%y, cloud%volume, &
                                       radius, targets, small, report)
    call a_cloud(12, 'jittered', 6, cloud, radius, targets, kernel)
    radius = radius*factor
    call assemble_sufficient_laplacian(consistent_t(6), kernel, cloud%x*factor, cloud%y*factor, &
                                       cloud%volume*factor**2, radius, targets, large, report)
    call check(error, size(small%weight) == size(large%weight))
    if (allocated(error)) return
    call check(error, maxval(abs(large%weight*factor**2 - small%weight)) <= &
               1.0e-12_wp*maxval(abs(small%weight)))
  end subroutine test_scales

end module test_consistent
