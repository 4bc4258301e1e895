!> The spectral radius of an evolution's Jacobian, which limits explicit steps.
!>
!> Small systems are solved densely by LAPACK, large ones by ARPACK. A power iteration would not do:
!> on irregular clouds many eigenvalues lie close to the largest one, and it falls short of that by
!> some percent for hundreds of iterations.
module calor_spectral_radius
  use calor_evolution, only: evolution_t
  use calor_kinds, only: wp
  use calor_rightmost_eigenvalue, only: jacobian_spectrum
  implicit none (type, external)
  private

  public :: estimate_spectral_radius

  !> What is found is enlarged by this factor
  real(wp), parameter :: safety = 1.01_wp
  !> Systems up to this size are solved densely
  integer, parameter :: largest_dense = 50
  !> The search ends when the eigenvalues are known to this fraction …
  real(wp), parameter :: accuracy = 5.0e-3_wp
  !> … or after this many restarts
  integer, parameter :: most_restarts = 30
  !> Vectors of the Krylov space
  integer, parameter :: krylov_size = 20

contains

  !> An estimate of the largest |λ|²/|Re λ|, on the safe side: it is what limits the step of the
  !> forward Euler method, and |λ| where eigenvalues are real. Enlarged by 1 %, and never more
  !> than a given bound.
  function estimate_spectral_radius(evolution, upper_bound) result(radius)
    !> Whose Jacobian
    class(evolution_t), intent(inout) :: evolution
    !> An upper bound of the radius, 1/s
    real(wp), intent(in) :: upper_bound
    !> Spectral radius, 1/s
    real(wp) :: radius
    real(wp), allocatable :: free(:), real_parts(:), imaginary_parts(:), uncertainty(:)

    radius = 0
    if (.not. upper_bound > 0) return
    allocate (free(evolution%unknowns()), source=1.0_wp)
    call evolution%clear_prescribed(free)
    if (.not. evolution%is_shared() .and. count(free > 0.5_wp) <= largest_dense) then
      call jacobian_spectrum(evolution, real_parts, imaginary_parts)
      allocate (uncertainty(size(real_parts)), source=0.0_wp)
    else
      call largest_eigenvalues(evolution, real_parts, imaginary_parts, uncertainty)
    end if
    if (size(real_parts) == 0) return
    ! LAPACK gives huge(1.0) where it has failed, and the bound takes its place.
    radius = upper_bound
    if (0.5_wp*maxval(abs(real_parts)) > upper_bound) return
    radius = min(safety*maxval(limiting(real_parts, imaginary_parts) + uncertainty), upper_bound)
  end function estimate_spectral_radius

  !> |λ|²/|Re λ|, but for eigenvalues near the imaginary axis at most 2 |λ|: no step suits them.
  elemental function limiting(real_part, imaginary_part) result(rate)
    real(wp), intent(in) :: real_part, imaginary_part
    real(wp) :: rate
    real(wp) :: magnitude

    magnitude = hypot(real_part, imaginary_part)
    rate = magnitude
    if (real_part < 0) rate = magnitude*min(2.0_wp, 1/max(0.5_wp, -real_part/magnitude))
  end function limiting

  !> The Ritz values of an Arnoldi iteration that looks for the largest eigenvalues.
  subroutine largest_eigenvalues(evolution, real_parts, imaginary_parts, uncertainty)
    class(evolution_t), intent(inout) :: evolution
    !> Ritz values, 1/s, and by how much they may be wrong
    real(wp), allocatable, intent(out) :: real_parts(:), imaginary_parts(:), uncertainty(:)
    integer, parameter :: lworkl = 3*krylov_size**2 + 6*krylov_size
    real(wp), allocatable :: residual(:), basis(:, :), workd(:), magnitude(:)
    logical, allocatable :: sought(:)
    real(wp) :: workl(lworkl), tolerance
    integer :: iparam(11), ipntr(14), ido, info, wanted, n

    n = evolution%unknowns()
    allocate (residual(n), basis(n, krylov_size), workd(3*n))
    call evolution%scatter(1, residual)
    wanted = 2
    tolerance = accuracy
    workl = 0
    ido = 0
    info = 1
    iparam = 0
    iparam(1) = 1
    iparam(3) = most_restarts
    iparam(7) = 1
    do
      call evolution%iterate_arnoldi(ido, wanted, tolerance, residual, basis, iparam, ipntr, &
                                     workd, workl, info)
      if (abs(ido) /= 1) exit
      call evolution%jacobian_product(workd(ipntr(1):ipntr(1) + n - 1), &
                                      workd(ipntr(2):ipntr(2) + n - 1))
    end do
    real_parts = workl(ipntr(6):ipntr(6) + krylov_size - 1)
    imaginary_parts = workl(ipntr(7):ipntr(7) + krylov_size - 1)
    uncertainty = workl(ipntr(8):ipntr(8) + krylov_size - 1)
    ! Only those that were looked for: the others' uncertainty means nothing.
    magnitude = hypot(real_parts, imaginary_parts)
    sought = magnitude >= (1 - 2*accuracy)*maxval(magnitude)
    real_parts = pack(real_parts, sought)
    imaginary_parts = pack(imaginary_parts, sought)
    uncertainty = pack(uncertainty, sought)
    if (info == 0) uncertainty = min(uncertainty, accuracy*maxval(abs(real_parts)))
    if (info < 0) real_parts = huge(1.0_wp)
  end subroutine largest_eigenvalues

end module calor_spectral_radius
