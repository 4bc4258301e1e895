!> The Laplacian of order p on any cloud: norm-minimal weights that reproduce all polynomials up to
!> degree p + 1.
!>
!> A row that is exact up to degree d misses terms of degree d + 1, which its second derivative
!> turns into h^(d-1): so degree p + 1 is what order p asks for where a cloud has no symmetry. (On a
!> lattice the terms of odd degree cancel, and degree p would do.) Order 1 needs no more
!> neighbours than the paper's scheme and is of its class.
!>
!> Source: see calor_taylor_weights.
module calor_laplacian_consistent
  use calor_kinds, only: wp
  use calor_laplacian_scheme, only: row_laplacian_t, row_rule_t
  use calor_row_batch, only: row_batch_t
  use calor_stencil, only: stencil_t
  use calor_taylor_batch, only: batch_taylor_weights
  use calor_taylor_weights, only: taylor_weights, monomials, monomial_position, default_order
  implicit none (type, external)
  private

  public :: consistent_t, natural_support

  type, extends(row_laplacian_t) :: consistent_t
    !> The order p, 1 … highest_order
    integer :: order = default_order
  contains
    procedure :: weights
    procedure :: exact_degree
    procedure :: rule
    procedure :: solves_batches
    procedure :: batch_weights
  end type consistent_t

contains

  !> The support radius, in spacings, from which rows of an order usually find the neighbours that
  !> they need; where they do not, it grows
  pure function natural_support(order) result(support)
    integer, intent(in) :: order
    real(wp) :: support

    support = 1 + 0.45_wp*order
  end function natural_support

  pure function exact_degree(this) result(degree)
    class(consistent_t), intent(in) :: this
    integer :: degree

    degree = this%order + 1
  end function exact_degree

  !> High orders need negative weights, the more so the nearer a wall is; the eigenvalues of whole
  !> operators show that these bounds keep them stable.
  pure function rule(this)
    class(consistent_t), intent(in) :: this
    type(row_rule_t) :: rule

    rule%largest_ratio = max(1.2_wp, 0.5_wp*this%order, this%order**2/8.0_wp)
    rule%largest_stiffness = 12.0_wp
    rule%growth = 1.1_wp
    rule%most_neighbours = 20*monomials(this%exact_degree())
  end function rule

  subroutine weights(this, stencil, weight, diagonal)
    class(consistent_t), intent(in) :: this
    type(stencil_t), intent(inout) :: stencil
    real(wp), intent(out) :: weight(:)
    real(wp), intent(out) :: diagonal
    real(wp) :: wanted(monomials(this%order + 1), 1), found(stencil%n, 1)

    wanted = 0
    wanted(monomial_position(2, 0), 1) = 2
    wanted(monomial_position(0, 2), 1) = 2
    call taylor_weights(stencil, this%order + 1, wanted, found, &
                        stencil%condition_laplacian)
    weight = found(:, 1)
    diagonal = -sum(weight)
  end subroutine weights

  pure function solves_batches(this) result(answer)
    class(consistent_t), intent(in) :: this
    logical :: answer

    associate (unused => this)
    end associate
    answer = .true.
  end function solves_batches

  subroutine batch_weights(this, batch)
    class(consistent_t), intent(in) :: this
    type(row_batch_t), intent(inout) :: batch
    real(wp) :: wanted(monomials(this%order + 1))

    wanted = 0
    wanted(monomial_position(2, 0)) = 2
    wanted(monomial_position(0, 2)) = 2
    call batch_taylor_weights(batch, this%exact_degree(), wanted)
  end subroutine batch_weights

end module calor_laplacian_consistent
