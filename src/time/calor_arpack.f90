!> Interfaces of the ARPACK and LAPACK routines for eigenvalues in use.
module calor_arpack
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: dnaupd, dneupd, dgeev

  interface
    !> One step of the implicitly restarted Arnoldi iteration, by reverse communication
    subroutine dnaupd(ido, bmat, n, which, nev, tol, resid, ncv, v, ldv, iparam, ipntr, workd, &
                      workl, lworkl, info)
      import :: wp
      implicit none (type, external)
      integer, intent(inout) :: ido, nev, info
      character(len=1), intent(in) :: bmat
      character(len=2), intent(in) :: which
      integer, intent(in) :: n, ncv, ldv, lworkl
      real(wp), intent(inout) :: tol
      real(wp), intent(inout) :: resid(n), v(ldv, ncv), workd(3*n), workl(lworkl)
      integer, intent(inout) :: iparam(11), ipntr(14)
    end subroutine dnaupd

    !> Eigenvalues and eigenvectors after `dnaupd` has converged
    subroutine dneupd(rvec, howmny, select, dr, di, z, ldz, sigmar, sigmai, workev, bmat, n, &
                      which, &
                      nev, tol, resid, ncv, v, ldv, iparam, ipntr, workd, workl, lworkl, info)
      import :: wp
      implicit none (type, external)
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
    end subroutine dneupd

    !> All eigenvalues of a dense matrix
    subroutine dgeev(jobvl, jobvr, n, a, lda, wr, wi, vl, ldvl, vr, ldvr, work, lwork, info)
      import :: wp
      implicit none (type, external)
      character(len=1), intent(in) :: jobvl, jobvr
      integer, intent(in) :: n, lda, ldvl, ldvr, lwork
      real(wp), intent(inout) :: a(lda, n)
      real(wp), intent(out) :: wr(n), wi(n), vl(ldvl, 1), vr(ldvr, 1), work(lwork)
      integer, intent(out) :: info
    end subroutine dgeev
  end interface

end module calor_arpack
