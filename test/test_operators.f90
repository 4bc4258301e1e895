!> Tests of the derivative schemes: reference values, exactness, orders of convergence.
module test_operators
  use calor_constants, only: pi
  use calor_kinds, only: wp, ip
  use calor_laplacian_schemes, only: laplacian_choices
  use calor_renormalization, only: gradient_tensor, laplacian_tensor
  use calor_row_report, only: row_report_t
  use calor_small_system, only: solve_small_system
  use calor_sparse_operator, only: sparse_operator_t
  use calor_stencil, only: stencil_t
  use calor_sums, only: root_mean_square
  use test_support, only: discretisation_t, unit_square
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_operators

  !> Columns of a reference table
  integer, parameter :: columns = 29

contains

  subroutine collect_operators(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('small systems, regular and singular', test_small_system), &
                new_unittest('reference: cubic spline on a lattice', test_reference_lattice), &
                new_unittest('reference: four neighbours', test_reference_four), &
                new_unittest('reference: jittered cloud', test_reference_jittered), &
                new_unittest('renormalized gradient is exact for linear fields', test_linear), &
                new_unittest('fatehi_manzari is exact for quadratic fields', test_quadratic), &
                new_unittest('every scheme but standard and sum is exact for constants', &
                             test_constants), &
                new_unittest('rows of some particles are those of all', test_subset), &
                new_unittest('operators do not depend on scale', test_scale), &
                new_unittest('error table: lattices', test_table_lattice), &
                new_unittest('error table: irregular clouds', test_table_jittered), &
                new_unittest('four neighbours: second order', test_four_neighbours), &
                new_unittest('orders on lattices and irregular clouds', test_orders) &
                ]
  end subroutine collect_operators

  subroutine test_small_system(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: a(3, 3), b(3, 1), x(3, 1), condition

    a = reshape([4.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, 3.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, 2.0_wp], [3, 3])
    b(:, 1) = matmul(a, [1.0_wp, -2.0_wp, 3.0_wp])
    call solve_small_system(a, b, x, condition)
    call check(error, maxval(abs(x(:, 1) - [1.0_wp, -2.0_wp, 3.0_wp])) < 1.0e-14_wp)
    if (allocated(error)) return
    ! ‖A‖₁ = 5; A⁻¹ = 1/18 (5 -2 1; -2 8 -4; 1 -4 11), so ‖A⁻¹‖₁ = 16/18
    call check(error, condition, 5*16.0_wp/18, thr=1.0e-13_wp)
    if (allocated(error)) return
    ! Rank 2: the undetermined second unknown gets nothing.
    a = 0
    a(1, 1) = 2
    a(3, 3) = 4
    b(:, 1) = [2.0_wp, 0.0_wp, 4.0_wp]
    call solve_small_system(a, b, x, condition)
    call check(error, maxval(abs(x(:, 1) - [1.0_wp, 0.0_wp, 1.0_wp])) < 1.0e-14_wp)
    if (allocated(error)) return
    call check(error, condition > 1.0e12_wp)
    if (allocated(error)) return
    ! x + y = 2 twice: of all solutions (1, 1) is the shortest.
    a(1:2, 1:2) = 1
    b(1:2, 1) = 2
    call solve_small_system(a(1:2, 1:2), b(1:2, :), x(1:2, :), condition)
    call check(error, maxval(abs(x(1:2, 1) - 1)) < 1.0e-14_wp)
    if (allocated(error)) return
    ! Nothing is determined.
    a = 0
    call solve_small_system(a(1:2, 1:2), b(1:2, :), x(1:2, :), condition)
    call check(error, maxval(abs(x(1:2, 1))), 0.0_wp)
  end subroutine test_small_system

  subroutine test_reference_lattice(error)
    type(error_type), allocatable, intent(out) :: error

    call compare_with_table('data/reference/operators_cubic_spline_lattice.csv', 'cubic_spline', &
                            0.21666666666666667_wp, error)
  end subroutine test_reference_lattice

  subroutine test_reference_four(error)
    type(error_type), allocatable, intent(out) :: error

    call compare_with_table('data/reference/operators_four_neighbours.csv', 'wendland_c2', &
                            0.09999999999999999_wp, error)
  end subroutine test_reference_four

  subroutine test_reference_jittered(error)
    type(error_type), allocatable, intent(out) :: error

    call compare_with_table('data/reference/operators_wendland_c2_jittered.csv', 'wendland_c2', &
                            0.175_wp, error)
  end subroutine test_reference_jittered

  !> Every column of a table at its interior particles to 1e-9 of the column's largest magnitude; a
  !> tensor's components share the magnitude of the largest, since some are zero but for rounding.
  subroutine compare_with_table(path, kernel, radius, error)
    character(len=*), intent(in) :: path, kernel
    real(wp), intent(in) :: radius
    type(error_type), allocatable, intent(out) :: error
    real(wp), allocatable :: table(:, :), found(:, :)
    character(len=24), allocatable :: names(:)
    type(discretisation_t) :: cloud
    type(sparse_operator_t) :: operator_x, operator_y
    real(wp) :: magnitude
    integer :: k

    call read_table(path, names, table)
    call check(error, size(table, 1) > 100, 'the table is short')
    if (allocated(error)) return
    cloud%x = table(:, 1)
    cloud%y = table(:, 2)
    cloud%volume = table(:, 3)
    cloud%inside = table(:, 4) < 0.5_wp
    call cloud%connect(kernel, radius)

    found = table
    found(:, 9) = real(cloud%list%first(2:) - cloud%list%first(:cloud%list%rows()), wp)
    do k = 10, 16, 2
      ! The column's name is that of the scheme and '_dx'.
      call cloud%gradient(names(k)(:index(names(k), '_dx') - 1), operator_x, operator_y)
      call operator_x%apply(table(:, 5), found(:, k))
      call operator_y%apply(table(:, 5), found(:, k + 1))
    end do
    do k = 18, 22
      call cloud%laplacian(trim(names(k)), operator_x)
      call operator_x%apply(table(:, 5), found(:, k))
    end do
    call find_tensors(cloud, found(:, 23:29))

    do k = 9, columns
      select case (k)
      case (23:26)
        magnitude = maxval(abs(table(:, 23:26)), spread(cloud%inside, 2, 4))
      case (27:29)
        magnitude = maxval(abs(table(:, 27:29)), spread(cloud%inside, 2, 3))
      case default
        magnitude = maxval(abs(table(:, k)), cloud%inside)
      end select
      call check(error, &
                 maxval(abs(found(:, k) - table(:, k)), cloud%inside) <= 1.0e-9_wp*magnitude, &
                 trim(names(k))//' differs')
      if (allocated(error)) return
    end do
  end subroutine compare_with_table

  !> B_xx, B_xy, B_yx, B_yy, B̂_xx, B̂_xy, B̂_yy of all particles.
  subroutine find_tensors(cloud, tensors)
    type(discretisation_t), intent(in) :: cloud
    real(wp), intent(out) :: tensors(:, :)
    type(stencil_t) :: stencil
    real(wp) :: b(2, 2), b_hat(3)
    integer :: k

    call stencil%reserve(cloud%list%longest_row())
    do k = 1, size(cloud%x)
      call stencil%gather(cloud%kernel, cloud%x, cloud%y, cloud%volume, int(k, ip), &
                          cloud%list%index(cloud%list%first(k):cloud%list%first(k + 1) - 1), &
                          cloud%radius(k))
      call gradient_tensor(stencil, b)
      call laplacian_tensor(stencil, b, b_hat)
      tensors(k, :) = [b(1, 1), b(1, 2), b(2, 1), b(2, 2), b_hat]
    end do
  end subroutine find_tensors

  subroutine read_table(path, names, table)
    character(len=*), intent(in) :: path
    character(len=24), allocatable, intent(out) :: names(:)
    real(wp), allocatable, intent(out) :: table(:, :)
    character(len=1000) :: line
    integer :: unit, rows, status, pass, k

    allocate (names(columns))
    do pass = 1, 2
      open (newunit=unit, file=path, status='old', action='read')
      read (unit, '(a)') line
      read (unit, '(a)') line
      read (line, *) names
      rows = 0
      do
        read (unit, '(a)', iostat=status) line
        if (status /= 0) exit
        rows = rows + 1
        if (pass == 2) read (line, *) (table(rows, k), k=1, columns)
      end do
      close (unit)
      if (pass == 1) allocate (table(rows, columns))
    end do
  end subroutine read_table

  !> ∇(a + b x + c y) = (b, c) at every particle, walls and corners included, on all kinds of cloud.
  subroutine test_linear(error)
    type(error_type), allocatable, intent(out) :: error
    type(discretisation_t) :: cloud
    type(sparse_operator_t) :: gradient_x, gradient_y
    real(wp), allocatable :: field(:), slope(:)
    integer :: k

    do k = 1, 6
      cloud = test_cloud(k)
      call cloud%gradient('renormalized', gradient_x, gradient_y)
      field = 3 - 2*cloud%x + 5*cloud%y
      slope = field
      call gradient_x%apply(field, slope)
      call check(error, maxval(abs(slope + 2)) < 1.0e-10_wp)
      if (allocated(error)) return
      call gradient_y%apply(field, slope)
      call check(error, maxval(abs(slope - 5)) < 1.0e-10_wp)
      if (allocated(error)) return
    end do
  end subroutine test_linear

  !> ∇² of x², y², xy and their sums with linear fields at every particle, walls and corners
  !> included.
  subroutine test_quadratic(error)
    type(error_type), allocatable, intent(out) :: error
    type(discretisation_t) :: cloud
    type(sparse_operator_t) :: operator
    type(row_report_t) :: report
    real(wp), allocatable :: field(:), found(:)
    real(wp), parameter :: coefficients(3, 4) = reshape( &
                           [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
                            1.0_wp, 0.7_wp, -1.3_wp, 2.1_wp], [3, 4])
    integer :: k, m

    do k = 1, 6
      cloud = test_cloud(k)
      call cloud%laplacian('fatehi_manzari', operator, report)
      call check(error, report%singular_rows(), 0)
      if (allocated(error)) return
      allocate (found(size(cloud%x)))
      do m = 1, 4
        associate (c => coefficients(:, m))
          field = 1 + cloud%x - 2*cloud%y + c(1)*cloud%x**2 + c(2)*cloud%y**2 + c(3)*cloud%x*cloud%y
          call operator%apply(field, found)
          call check(error, maxval(abs(found - 2*(c(1) + c(2)))) < 1.0e-10_wp)
          if (allocated(error)) return
        end associate
      end do
      deallocate (found)
    end do
  end subroutine test_quadratic

  !> Lattice, jittered and hexagonal clouds with walls and different kernels
  function test_cloud(number) result(cloud)
    integer, intent(in) :: number
    type(discretisation_t) :: cloud

    select case (number)
    case (1)
      cloud = unit_square(8, 'lattice', 0.0_wp, 1, 'wendland_c2', 2.6_wp)
    case (2)
      cloud = unit_square(8, 'jittered', 0.2_wp, 1, 'wendland_c2', 2.6_wp)
    case (3)
      cloud = unit_square(8, 'jittered', 0.45_wp, 2, 'wendland_c4', 3.1_wp)
    case (4)
      cloud = unit_square(8, 'hexagonal', 0.0_wp, 1, 'quintic_spline', 3.1_wp)
    case (5)
      cloud = unit_square(8, 'jittered', 0.3_wp, 3, 'cubic_spline', 3.1_wp)
    case default
      cloud = unit_square(8, 'hexagonal', 0.0_wp, 1, 'wendland_c6', 3.6_wp)
    end select
  end function test_cloud

  subroutine test_constants(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=12), parameter :: gradients(2) = &
                                    [character(len=12) :: 'difference', 'renormalized']
    type(discretisation_t) :: cloud
    type(sparse_operator_t) :: operator_x, operator_y
    real(wp), allocatable :: field(:), found(:)
    integer :: k

    cloud = unit_square(8, 'jittered', 0.3_wp, 5, 'wendland_c2', 2.6_wp)
    allocate (field(size(cloud%x)), source=7.0_wp)
    allocate (found(size(cloud%x)))
    do k = 1, size(gradients)
      call cloud%gradient(trim(gradients(k)), operator_x, operator_y)
      call operator_x%apply(field, found)
      call check(error, maxval(abs(found)) < 1.0e-11_wp)
      if (allocated(error)) return
      call operator_y%apply(field, found)
      call check(error, maxval(abs(found)) < 1.0e-11_wp)
      if (allocated(error)) return
    end do
    do k = 1, size(laplacian_choices)
      call cloud%laplacian(trim(laplacian_choices(k)%name), operator_x)
      call operator_x%apply(field, found)
      call check(error, maxval(abs(found)) < 1.0e-10_wp, trim(laplacian_choices(k)%name))
      if (allocated(error)) return
    end do
  end subroutine test_constants

  subroutine test_subset(error)
    type(error_type), allocatable, intent(out) :: error
    type(discretisation_t) :: cloud
    type(sparse_operator_t) :: all_rows, some_rows
    integer(ip), parameter :: some(4) = [3_ip, 40_ip, 17_ip, 60_ip]
    real(wp), allocatable :: field(:), found(:)
    real(wp) :: part(size(some))
    integer :: k

    cloud = unit_square(8, 'jittered', 0.3_wp, 5, 'wendland_c2', 2.6_wp)
    field = exp(cloud%x)*sin(2*cloud%y)
    allocate (found(size(field)))
    do k = 1, size(laplacian_choices)
      call cloud%laplacian(trim(laplacian_choices(k)%name), all_rows)
      call cloud%laplacian(trim(laplacian_choices(k)%name), some_rows, targets=some)
      call check(error, some_rows%rows(), size(some))
      if (allocated(error)) return
      call all_rows%apply(field, found)
      call some_rows%apply(field, part)
      call check(error, maxval(abs(part - found(some))) <= 1.0e-12_wp*maxval(abs(found)), &
                 trim(laplacian_choices(k)%name))
      if (allocated(error)) return
      ! Laid down at the targets, and nowhere else
      found = -1
      call some_rows%apply_at_targets(2.0_wp, field, found)
      call check(error, maxval(abs(found(some) - 2*part)) <= 1.0e-12_wp*maxval(abs(part)))
      if (allocated(error)) return
      call check(error, count(abs(found + 1) > 0), size(some))
      if (allocated(error)) return
    end do
  end subroutine test_subset

  !> On a domain of 10⁻⁹ m or 10⁹ m the weights are those of the unit square over the square of
  !> that.
  subroutine test_scale(error)
    type(error_type), allocatable, intent(out) :: error
    type(discretisation_t) :: cloud, scaled
    type(sparse_operator_t) :: operator, scaled_operator
    real(wp), parameter :: scales(2) = [1.0e-9_wp, 1.0e9_wp]
    integer :: k

    cloud = unit_square(8, 'jittered', 0.2_wp, 5, 'wendland_c2', 2.6_wp)
    call cloud%laplacian('fatehi_manzari', operator)
    do k = 1, size(scales)
      scaled = discretisation_t(scales(k)*cloud%x, scales(k)*cloud%y, scales(k)**2*cloud%volume, &
                                inside=cloud%inside)
      call scaled%connect('wendland_c2', scales(k)*cloud%radius(1))
      call scaled%laplacian('fatehi_manzari', scaled_operator)
      call check(error, maxval(abs(scaled_operator%weight*scales(k)**2 - operator%weight)) < &
                 1.0e-10_wp*maxval(abs(operator%weight)))
      if (allocated(error)) return
    end do
  end subroutine test_scale

  !> Error of ∇² sin πx sin πy on the unit square as in the published table: root mean square over
  !> the particles of whole support, relative to that of the exact Laplacian over all particles.
  function laplacian_error(n, jitter, support, scheme, seed) result(deviation)
    integer, intent(in) :: n
    real(wp), intent(in) :: jitter, support
    character(len=*), intent(in) :: scheme
    integer, intent(in) :: seed
    real(wp) :: deviation
    type(discretisation_t) :: cloud
    type(sparse_operator_t) :: operator
    real(wp), allocatable :: field(:), found(:)
    logical, allocatable :: whole(:)

    cloud = unit_square(n, 'jittered', jitter, seed, 'wendland_c2', support)
    call cloud%laplacian(scheme, operator)
    field = sin(pi*cloud%x)*sin(pi*cloud%y)
    allocate (found(size(field)))
    call operator%apply(field, found)
    whole = cloud%whole_support()
    deviation = root_mean_square(pack(found + 2*pi**2*field, whole))/ &
                root_mean_square(2*pi**2*field)
  end function laplacian_error

  !> The same for the schemes and resolutions of the published table
  subroutine compare_errors(jitter, support, expected, lowest, highest, error)
    real(wp), intent(in) :: jitter, support
    !> n = 20, 40, 80 down; brookshaw, double_gradient, fatehi_manzari across
    real(wp), intent(in) :: expected(3, 3)
    !> Ratio of what is found to what is expected
    real(wp), intent(in) :: lowest, highest
    type(error_type), allocatable, intent(out) :: error
    character(len=15), parameter :: schemes(3) = &
                                    [character(len=15) :: 'brookshaw', 'double_gradient', &
                                     'fatehi_manzari']
    integer :: level, k
    real(wp) :: ratio
    character(len=80) :: message

    do k = 1, 3
      do level = 1, 3
        ratio = laplacian_error(10*2**level, jitter, support, trim(schemes(k)), 1)
        ratio = ratio/expected(level, k)
        write (message, '(a,i4,f5.2,f5.2,a,f7.3)') trim(schemes(k)), 10*2**level, jitter, support, &
          ': found over expected ', ratio
        call check(error, ratio > lowest .and. ratio < highest, trim(message))
        if (allocated(error)) return
      end do
    end do
  end subroutine compare_errors

  subroutine test_table_lattice(error)
    type(error_type), allocatable, intent(out) :: error

    call compare_errors(0.0_wp, 1.2_wp, reshape([9.9e-1_wp, 8.9e-1_wp, 8.4e-1_wp, &
                                                 1.0e-2_wp, 2.3e-3_wp, 5.4e-4_wp, &
                                                 2.5e-3_wp, 5.7e-4_wp, 1.4e-4_wp], [3, 3]), &
                        0.9_wp, 1.1_wp, error)
    if (allocated(error)) return
    call compare_errors(0.0_wp, 2.1_wp, reshape([3.3e-2_wp, 2.5e-2_wp, 2.2e-2_wp, &
                                                 2.2e-2_wp, 4.8e-3_wp, 1.1e-3_wp, &
                                                 5.6e-3_wp, 1.2e-3_wp, 2.8e-4_wp], [3, 3]), &
                        0.9_wp, 1.1_wp, error)
  end subroutine test_table_lattice

  subroutine test_table_jittered(error)
    type(error_type), allocatable, intent(out) :: error

    call compare_errors(0.1_wp, 2.1_wp, reshape([0.9_wp, 1.7_wp, 3.4_wp, &
                                                 3.1e-2_wp, 1.7e-2_wp, 1.5e-2_wp, &
                                                 8.5e-3_wp, 3.5e-3_wp, 1.7e-3_wp], [3, 3]), &
                        1/1.5_wp, 1.5_wp, error)
    if (allocated(error)) return
    call compare_errors(0.3_wp, 2.1_wp, reshape([2.5_wp, 4.6_wp, 9.2_wp, &
                                                 9.1e-2_wp, 7.2e-2_wp, 6.6e-2_wp, &
                                                 2.0e-2_wp, 1.0e-2_wp, 4.8e-3_wp], [3, 3]), &
                        1/1.5_wp, 1.5_wp, error)
  end subroutine test_table_jittered

  !> B̂ is singular there; the minimum-norm tensor gives the five-point Laplacian.
  subroutine test_four_neighbours(error)
    type(error_type), allocatable, intent(out) :: error
    type(discretisation_t) :: cloud
    type(sparse_operator_t) :: operator
    type(row_report_t) :: report
    real(wp) :: coarse, fine
    integer :: row

    cloud = unit_square(10, 'lattice', 0.0_wp, 1, 'wendland_c2', 1.2_wp)
    call cloud%laplacian('fatehi_manzari', operator, report)
    call check(error, all(pack(report%condition_laplacian, cloud%inside) > 1.0e12_wp))
    if (allocated(error)) return
    do row = 1, operator%rows()
      if (.not. cloud%inside(row)) cycle
      call check(error, &
                 maxval(abs(operator%weight(operator%first(row):operator%first(row + 1) - 1) - &
                                   100.0_wp)) < 1.0e-9_wp)
      if (allocated(error)) return
    end do
    coarse = laplacian_error(40, 0.0_wp, 1.2_wp, 'fatehi_manzari', 1)
    fine = laplacian_error(80, 0.0_wp, 1.2_wp, 'fatehi_manzari', 1)
    call check(error, log(coarse/fine)/log(2.0_wp), 2.0_wp, thr=0.1_wp)
  end subroutine test_four_neighbours

  !> Second order on lattices, first order on irregular clouds, where Brookshaw diverges as 1/Δ.
  subroutine test_orders(error)
    type(error_type), allocatable, intent(out) :: error

    call check_order('fatehi_manzari', 0.0_wp, 2.0_wp, 0.15_wp, error)
    if (allocated(error)) return
    call check_order('double_gradient', 0.0_wp, 2.0_wp, 0.15_wp, error)
    if (allocated(error)) return
    call check_order('fatehi_manzari', 0.2_wp, 1.0_wp, 0.2_wp, error)
    if (allocated(error)) return
    call check_order('brookshaw', 0.2_wp, -1.0_wp, 0.2_wp, error)
    if (allocated(error)) return
    call check_order('kernel_second_derivative', 0.2_wp, -1.0_wp, 0.2_wp, error)
  end subroutine test_orders

  subroutine check_order(scheme, jitter, order, tolerance, error)
    character(len=*), intent(in) :: scheme
    real(wp), intent(in) :: jitter, order, tolerance
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: coarse, fine

    coarse = laplacian_error(40, jitter, 2.1_wp, scheme, 1)
    fine = laplacian_error(160, jitter, 2.1_wp, scheme, 2)
    call check(error, log(coarse/fine)/log(4.0_wp), order, thr=tolerance, message=scheme)
  end subroutine check_order

end module test_operators
