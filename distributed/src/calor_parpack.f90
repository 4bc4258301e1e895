!> Interfaces of the PARPACK routines in use: ARPACK's, over MPI.
module calor_parpack
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: pdnaupd, pdneupd

  interface
    !> One step of the implicitly restarted Arnoldi iteration, by reverse communication
    subroutine pdnaupd(comm, ido, bmat, n, which, nev, tol, resid, ncv, v, ldv, iparam, ipntr, &
                       workd, workl, lworkl, info)
      import :: wp
      implicit none (type, external)
      integer, intent(in) :: comm
      integer, intent(inout) :: ido, nev, info
      character(len=1), intent(in) :: bmat
      character(len=2), intent(in) :: which
      integer, intent(in) :: n, ncv, ldv, lworkl
      real(wp), intent(inout) :: tol
      real(wp), intent(inout) :: resid(n), v(ldv, ncv), workd(3*n), workl(lworkl)
      integer, intent(inout) :: iparam(11), ipntr(14)
    end subroutine pdnaupd

    !> Eigenvalues and eigenvectors after `pdnaupd` has converged
    subroutine pdneupd(comm, rvec, howmny, select, dr, di, z, ldz, sigmar, sigmai, workev, bmat, &
                       n, which, nev, tol, resid, ncv, v, ldv, iparam, ipntr, workd, workl, &
                       lworkl, info)
      import :: wp
      implicit none (type, external)
      integer, intent(in) :: comm
      logical, intent(in) :: rvec
      character(len=1), intent(in) :: howmny, bmat
      character(len=2), intent(in) :: which
      integer, intent(in) :: ldz, n, ncv, ldv, lworkl
      integer, intent(inout) :: nev
      logical, intent(inout) :: select(ncv)
      real(wp), intent(inout) :: dr(nev + 2), di(nev + 2), z(ldz, nev + 2)
      real(wp), intent(inout) :: workev(3*ncv), tol
      real(wp), intent(in) :: sigmar, sigmai
      real(wp), intent(inout) :: resid(n), v(ldv, ncv), workd(3*n), workl(lworkl)
      integer, intent(inout) :: iparam(11), ipntr(14), info
    end subroutine pdneupd
  end interface

end module calor_parpack
