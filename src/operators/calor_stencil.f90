!> One particle's stencil: its neighbours as the schemes see them, in units of the support radius.
!>
!> Lengths are divided by the support radius h and volumes by h², so that every number a scheme
!> meets is of order one whatever the size of the domain. A first derivative found in these units
!> is multiplied by 1/h, a second one by 1/h².
module calor_stencil
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp, ip
  implicit none (type, external)
  private

  public :: stencil_t

  !> Neighbours j = 1 … n of a particle i. The arrays are a workspace and may be longer than n.
  type :: stencil_t
    !> Number of neighbours
    integer :: n = 0
    !> Distances |r_ij|/h
    real(wp), allocatable :: q(:)
    !> Unit vectors e_ij = r_ij/|r_ij|, r_ij = r_i - r_j
    real(wp), allocatable :: ex(:), ey(:)
    !> Volumes w_j/h²
    real(wp), allocatable :: volume(:)
    !> Kernel profile and derivatives f(q), f'(q), f''(q)
    real(wp), allocatable :: f(:), df(:), ddf(:)
    !> F_j = w_j/h² f'(q): w_j ∇W_ij = F_j e_ij/h
    real(wp), allocatable :: force(:)
    !> Condition numbers of the tensors that a scheme has solved for on this stencil; 0: none
    real(wp) :: condition_gradient = 0.0_wp, condition_laplacian = 0.0_wp
    !> How far a scheme that solves for its moments has missed one of them, in units of h
    real(wp) :: residual = 0.0_wp
  contains
    !> Provide room for a number of neighbours
    procedure :: reserve
    !> Fill in the neighbours of a particle
    procedure :: gather
  end type stencil_t

contains

  subroutine reserve(this, most)
    class(stencil_t), intent(inout) :: this
    !> The largest number of neighbours to come
    integer, intent(in) :: most

    allocate (this%q(most), this%ex(most), this%ey(most), this%volume(most))
    allocate (this%f(most), this%df(most), this%ddf(most), this%force(most))
  end subroutine reserve

  pure subroutine gather(this, kernel, x, y, volume, particle, neighbours, radius)
    class(stencil_t), intent(inout) :: this
    !> The smoothing kernel
    class(kernel_t), intent(in) :: kernel
    !> Coordinates, m, and volumes, m², of all particles
    real(wp), intent(in) :: x(:), y(:), volume(:)
    !> The particle
    integer(ip), intent(in) :: particle
    !> Its neighbours, none of them at its own place
    integer(ip), intent(in) :: neighbours(:)
    !> Its support radius, m
    real(wp), intent(in) :: radius
    real(wp) :: dx, dy, r, scale
    integer :: k, n

    n = size(neighbours)
    this%n = n
    this%condition_gradient = 0
    this%condition_laplacian = 0
    this%residual = 0
    scale = 1/radius
    do k = 1, n
      dx = (x(particle) - x(neighbours(k)))*scale
      dy = (y(particle) - y(neighbours(k)))*scale
      r = sqrt(dx**2 + dy**2)
      this%q(k) = r
      this%ex(k) = dx/r
      this%ey(k) = dy/r
      this%volume(k) = (volume(neighbours(k))*scale)*scale
    end do
    call kernel%profile(this%q(1:n), this%f(1:n), this%df(1:n), this%ddf(1:n))
    do k = 1, n
      this%force(k) = this%volume(k)*this%df(k)
    end do
  end subroutine gather

end module calor_stencil
