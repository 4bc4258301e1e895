!> Rows of the paper's new scheme for div(K ∇u), K a tensor.
!>
!> With -K in the place of -I on the right-hand side of the equation for B̂ the sum
!>
!>     Σ 2 w_j (B̂_i : e_ij ∇W_ij) [(u_i - u_j)/r_ij - e_ij·⟨∇u⟩_i]
!>
!> is K:∇∇u for every quadratic u: for u = r·H r/2 about the particle the sum is, by B̂'s equation,
!> -H : (-K), and 0 for linear ones. B̂, and so the weights a_ij(K), are linear in K. Where that
!> varies,
!>
!>     div(K∇u) = [∂a ∂b (K_ab u) + K_ab ∂a ∂b u - u ∂a ∂b K_ab]/2
!>
!> makes the weights a_ij((K_i + K_j)/2), as (κ_i + κ_j)/2 does in an isotropic material.
!>
!> Rows are judged, and their supports grow, by the rule of the scheme. With a tensor there is more
!> to ask: neighbours have to lie along its axis as well.
!>
!> Source: R. Fatehi, M.T. Manzari, Comput. Math. Appl. 61 (2011) 482–498.
module calor_tensor_rows
  use calor_constants, only: pi
  use calor_flow_rows, only: flow_rows_t
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, ip
  use calor_laplacian_scheme, only: row_rule_t
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_renormalization, only: gradient_tensor, derivative_tensors
  use calor_stable_rows, only: as_written, support_grown, no_stencil
  use calor_stencil, only: stencil_t
  implicit none (type, external)
  private

  public :: assemble_tensor_rows

  !> What a row may miss of a moment in units of the conductivity
  real(wp), parameter :: largest_residual = 1.0e-9_wp
  !> Supports grow so often at most
  integer, parameter :: most_times = 12

contains

  !> Assemble rows. Where no support within reach is good, `repair` is `no_stencil`, the row 0.
  subroutine assemble_tensor_rows(conductivity, rule, kernel, x, y, volume, radius, particles, rows)
    !> κxx, κyy, κxy of all particles, one a column, W/(m K)
    real(wp), intent(in) :: conductivity(:, :)
    !> What is asked of a row
    type(row_rule_t), intent(in) :: rule
    !> The smoothing kernel
    class(kernel_t), intent(in) :: kernel
    !> Coordinates, m, and volumes, m², of all particles
    real(wp), intent(in) :: x(:), y(:), volume(:)
    !> Support radii of all particles, m; those of the particles may grow
    real(wp), intent(inout) :: radius(:)
    !> The particles
    integer(ip), intent(in) :: particles(:)
    !> The rows
    type(flow_rows_t), intent(out) :: rows
    type(flow_rows_t) :: trial
    real(wp), allocatable :: first_radius(:)
    integer, allocatable :: pending(:)
    logical, allocatable :: good(:)
    integer :: k, time

    allocate (rows%repair(size(particles)), source=no_stencil)
    first_radius = radius(particles)
    pending = [(k, k=1, size(particles))]
    do time = 0, most_times
      if (size(pending) == 0) exit
      call assemble(particles(pending), trial)
      good = trial%quality%ratio <= rule%largest_ratio .and. &
             trial%quality%stiffness <= rule%largest_stiffness .and. &
             trial%quality%residual <= largest_residual
      rows%repair(pack(pending, good)) = merge(as_written, support_grown, time == 0)
      pending = pack(pending, .not. good)
      if (time < most_times) radius(particles(pending)) = rule%growth*radius(particles(pending))
    end do
    radius(particles(pending)) = first_radius(pending)
    call assemble(particles, trial)
    call move_alloc(rows%repair, trial%repair)
    do k = 1, size(pending)
      associate (operator => trial%operator, row => pending(k))
        operator%weight(operator%first(row):operator%first(row + 1) - 1) = 0
        operator%diagonal(row) = 0
      end associate
    end do
    rows = trial

  contains

    !> Rows on the present supports, and how good they are
    subroutine assemble(targets, found)
      integer(ip), intent(in) :: targets(:)
      type(flow_rows_t), intent(out) :: found
      type(neighbour_list_t) :: list
      type(stencil_t) :: stencil
      integer :: row

      call build_neighbour_list(x, y, radius(targets), list, targets)
      call found%operator%shape_as(list)
      call found%report%reserve(size(targets))
      allocate (found%slope_weight(0))
      associate (quality => found%quality, n => size(targets))
        allocate (quality%ratio(n), quality%residual(n), quality%stiffness(n), &
                  quality%neighbours(n))
      end associate
      !$omp parallel default(shared) private(row) firstprivate(stencil)
      call stencil%reserve(list%longest_row())
      !$omp do schedule(dynamic, 8)
      do row = 1, size(targets)
        call one_row(list, row, stencil, found)
      end do
      !$omp end do
      !$omp end parallel
    end subroutine assemble

    subroutine one_row(list, row, stencil, found)
      type(neighbour_list_t), intent(in) :: list
      integer, intent(in) :: row
      type(stencil_t), intent(inout) :: stencil
      type(flow_rows_t), intent(inout) :: found
      real(wp), allocatable :: part(:, :)
      real(wp) :: own(3), moment(5), total, scale
      integer :: k

      associate (from => list%first(row), to => list%first(row + 1) - 1, i => list%target(row))
        associate (h => radius(i), neighbours => list%index(from:to))
          call stencil%gather(kernel, x, y, volume, i, neighbours, h)
          allocate (part(stencil%n, 3))
          call component_weights(stencil, part)
          ! In the order xx, xy, yy
          own = conductivity([1, 3, 2], i)
          moment = 0
          do k = 1, stencil%n
            associate (weight => dot_product(part(k, :), own), q => stencil%q(k), &
                       ex => stencil%ex(k), ey => stencil%ey(k))
              moment = moment + weight*q*[ex, ey, q*ex*ex, q*ex*ey, q*ey*ey]
            end associate
            found%operator%weight(from + k - 1) = &
              (dot_product(part(k, :), 0.5_wp*(own + conductivity([1, 3, 2], neighbours(k))))/h)/h
          end do
          scale = 0.5_wp*(own(1) + own(3))
          moment(3:5) = moment(3:5) - 2*own
          total = sum(abs(found%operator%weight(from:to)))
          associate (diagonal => found%operator%diagonal(row), quality => found%quality)
            diagonal = -sum(found%operator%weight(from:to))
            quality%residual(row) = maxval(abs(moment))/scale
            quality%ratio(row) = huge(1.0_wp)
            if (diagonal < 0 .and. total < -1.0e3_wp*diagonal) quality%ratio(row) = -total/diagonal
            quality%stiffness(row) = abs(diagonal)*h**2*pi/(1 + stencil%n)/scale
            quality%neighbours(row) = stencil%n
          end associate
          call found%report%note(row, stencil)
        end associate
      end associate
    end subroutine one_row

  end subroutine assemble_tensor_rows

  !> Weights of ∂²/∂x², 2 ∂²/∂x∂y and ∂²/∂y² in units of 1/h², a column for each
  subroutine component_weights(stencil, weight)
    type(stencil_t), intent(inout) :: stencil
    real(wp), intent(out) :: weight(:, :)
    real(wp) :: b(2, 2), b_hat(3, 3), slope(2), pull
    integer :: k, component

    call gradient_tensor(stencil, b)
    call derivative_tensors(stencil, b, b_hat)
    do component = 1, 3
      slope = 0
      do k = 1, stencil%n
        associate (ex => stencil%ex(k), ey => stencil%ey(k), c => b_hat(:, component))
          pull = 2*stencil%force(k)*(c(1)*ex*ex + 2*c(2)*ex*ey + c(3)*ey*ey)
          weight(k, component) = -pull/stencil%q(k)
          slope = slope + pull*[ex, ey]
        end associate
      end do
      ! -Σ pull e·⟨∇u⟩ with ⟨∇u⟩ = Σ F_j (u_j - u_i) B·e_j
      slope = matmul(slope, b)
      do k = 1, stencil%n
        weight(k, component) = weight(k, component) - stencil%force(k)* &
                               (slope(1)*stencil%ex(k) + slope(2)*stencil%ey(k))
      end do
    end do
  end subroutine component_weights

end module calor_tensor_rows
