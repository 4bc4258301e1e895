!> Interfaces of the LAPACK routines in use.
module calor_lapack
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: dgesv, dgelss, dpotrf, dpotrs, dsyev

  interface
    !> Solve A X = B by LU factorisation with partial pivoting
    subroutine dgesv(n, nrhs, a, lda, ipiv, b, ldb, info)
      import :: wp
      implicit none (type, external)
      integer, intent(in) :: n, nrhs, lda, ldb
      real(wp), intent(inout) :: a(lda, n), b(ldb, nrhs)
      integer, intent(out) :: ipiv(n), info
    end subroutine dgesv

    !> Minimum-norm least-squares solution of A X = B by the singular value decomposition
    subroutine dgelss(m, n, nrhs, a, lda, b, ldb, s, rcond, rank, work, lwork, info)
      import :: wp
      implicit none (type, external)
      integer, intent(in) :: m, n, nrhs, lda, ldb, lwork
      real(wp), intent(inout) :: a(lda, n), b(ldb, nrhs)
      real(wp), intent(out) :: s(min(m, n))
      real(wp), intent(in) :: rcond
      integer, intent(out) :: rank, info
      real(wp), intent(out) :: work(lwork)
    end subroutine dgelss

    !> Cholesky factorisation of a symmetric positive definite matrix
    subroutine dpotrf(uplo, n, a, lda, info)
      import :: wp
      implicit none (type, external)
      character(len=1), intent(in) :: uplo
      integer, intent(in) :: n, lda
      real(wp), intent(inout) :: a(lda, n)
      integer, intent(out) :: info
    end subroutine dpotrf

    !> Solve A X = B with the factor of dpotrf
    subroutine dpotrs(uplo, n, nrhs, a, lda, b, ldb, info)
      import :: wp
      implicit none (type, external)
      character(len=1), intent(in) :: uplo
      integer, intent(in) :: n, nrhs, lda, ldb
      real(wp), intent(in) :: a(lda, n)
      real(wp), intent(inout) :: b(ldb, nrhs)
      integer, intent(out) :: info
    end subroutine dpotrs

    !> Eigenvalues, ascending, and eigenvectors of a symmetric matrix
    subroutine dsyev(jobz, uplo, n, a, lda, w, work, lwork, info)
      import :: wp
      implicit none (type, external)
      character(len=1), intent(in) :: jobz, uplo
      integer, intent(in) :: n, lda, lwork
      real(wp), intent(inout) :: a(lda, n)
      real(wp), intent(out) :: w(n), work(lwork)
      integer, intent(out) :: info
    end subroutine dsyev
  end interface

end module calor_lapack
