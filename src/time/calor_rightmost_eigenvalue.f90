!> The eigenvalue of an evolution's Jacobian with the largest real part: the stability certificate.
!>
!> An eigenvalue to the right of the imaginary axis makes the heat equation blow up, whatever the
!> step. Small systems are solved densely by LAPACK. For large ones plain Arnoldi would find the far
!> left end of the spectrum; so ARPACK is given a Chebyshev polynomial of the Jacobian that is small
!> on the interval of fast decay, or on an ellipse about it, and grows towards and beyond zero,
!> where the slow and unstable modes are. At every unstable eigenvalue it is larger than at zero:
!> when the search for its largest values has come down to that, no unstable eigenvalue is left.
!>
!> Source: Y. Saad, Chebyshev acceleration techniques for solving nonsymmetric eigenvalue problems,
!> Math. Comput. 42 (1984) 567–588.
module calor_rightmost_eigenvalue
  use calor_constants, only: worth_threads
  use calor_arpack, only: dgeev
  use calor_evolution, only: evolution_t
  use calor_kinds, only: wp, i8
  use calor_random, only: random_uniform
  use calor_sums, only: dot
  implicit none (type, external)
  private

  public :: rightmost_t, find_rightmost, jacobian_spectrum

  !> What is known of the rightmost eigenvalue
  type :: rightmost_t
    !> Its real and imaginary part, 1/s
    real(wp) :: growth_rate = 0.0_wp, frequency = 0.0_wp
    !> The slowest decay that is not 0 but for rounding, 1/s; 0: not known
    real(wp) :: slowest_decay = 0.0_wp
    !> Whether the search converged; if not, the true real part may be larger
    logical :: converged = .false.
    !> How it was found, in a few words
    character(len=48) :: method = ''
    !> Entry of the eigenvector that is largest in magnitude: where it would blow up; 0: not known
    integer :: place = 0
  end type rightmost_t

  !> Systems up to this size are solved densely, and larger ones up to the other if the iteration
  !> fails, as it may where a lattice has many equal eigenvalues
  integer, parameter :: always_dense = 50, largest_dense = 400
  !> Degree of the polynomial: the higher, the better it tells slow modes apart. Where no mode is as
  !> slow as that, it is halved, as often as it takes
  integer, parameter :: highest_degree = 31, lowest_degree = 7
  !> Where the interval of fast decay begins, as a part of the spectral radius, times the square of
  !> the degree: the polynomial is cosh(2 √5) = 44 times larger at zero
  real(wp), parameter :: slow_factor = 5.0_wp
  !> Eigenvalues to the left of the interval would mislead: it is wider than the spectrum should be
  real(wp), parameter :: margin = 1.1_wp
  !> How often the ellipse may be widened
  integer, parameter :: most_ellipses = 5
  !> Eigenvalues wanted: one may be 0, of an insulated body. ARPACK takes one more where a pair
  !> would be torn apart
  integer, parameter :: most_wanted = 2
  !> Decay slower than that part of the spectral radius is none
  real(wp), parameter :: no_decay = 1.0e-11_wp
  !> Vectors of the Krylov space
  integer, parameter :: krylov_size = 12
  !> Accuracy of the polynomial's eigenvalues; an eigenvalue 0 of the Jacobian has to be found as 0
  real(wp), parameter :: accuracy = 1.0e-8_wp
  !> Products with the Jacobian are limited to this many, times a thousand unknowns over the size
  real(wp), parameter :: most_products = 1.0e6_wp, fewest_products = 1.0e3_wp
  !> Restarts of ARPACK that nearly always do
  integer, parameter :: first_restarts = 20

contains

  !> Find the rightmost eigenvalue.
  subroutine find_rightmost(evolution, spectral_radius, rightmost)
    !> Whose Jacobian
    class(evolution_t), intent(inout) :: evolution
    !> Its spectral radius, 1/s, on the safe side
    real(wp), intent(in) :: spectral_radius
    !> The eigenvalue
    type(rightmost_t), intent(out) :: rightmost
    real(wp), allocatable :: free(:), real_parts(:), imaginary_parts(:)
    integer :: k, n

    allocate (free(evolution%unknowns()), source=1.0_wp)
    call evolution%clear_prescribed(free)
    n = nint(evolution%dot(free, free))
    if (n > always_dense .or. evolution%is_shared()) then
      call arnoldi(evolution, n, spectral_radius, rightmost)
    end if
    if (n <= largest_dense .and. .not. (rightmost%converged .or. evolution%is_shared())) then
      rightmost = rightmost_t()
      call jacobian_spectrum(evolution, real_parts, imaginary_parts)
      if (size(real_parts) == 0) return
      k = maxloc(real_parts, dim=1)
      rightmost%growth_rate = real_parts(k)
      rightmost%frequency = abs(imaginary_parts(k))
      rightmost%slowest_decay = slowest_of(-real_parts, spectral_radius)
      rightmost%converged = .true.
      rightmost%method = 'all eigenvalues by LAPACK'
      if (rightmost%growth_rate > 0) call find_place(evolution, free, rightmost)
    end if
  end subroutine find_rightmost

  !> Of some decays the slowest that is one; 0: none is
  pure function slowest_of(decays, spectral_radius) result(slowest)
    !> 1/s
    real(wp), intent(in) :: decays(:)
    real(wp), intent(in) :: spectral_radius
    real(wp) :: slowest

    slowest = 0
    if (any(decays > no_decay*spectral_radius)) then
      slowest = minval(decays, decays > no_decay*spectral_radius)
    end if
  end function slowest_of

  !> All eigenvalues of the Jacobian at the entries that are not prescribed: for small systems.
  subroutine jacobian_spectrum(evolution, real_parts, imaginary_parts)
    !> Whose Jacobian
    class(evolution_t), intent(inout) :: evolution
    !> Eigenvalues, 1/s
    real(wp), allocatable, intent(out) :: real_parts(:), imaginary_parts(:)
    real(wp), allocatable :: free(:), matrix(:, :), column(:), unit(:), work(:)
    real(wp) :: none(1, 1)
    integer, allocatable :: place(:)
    integer :: n, k, info

    allocate (free(evolution%unknowns()), source=1.0_wp)
    allocate (unit(size(free)), column(size(free)))
    call evolution%clear_prescribed(free)
    place = pack([(k, k=1, size(free))], free > 0.5_wp)
    n = size(place)
    allocate (real_parts(n), imaginary_parts(n))
    if (n == 0) return
    allocate (matrix(n, n), work(34*n))
    unit = 0
    do k = 1, n
      unit(place(k)) = 1
      call evolution%jacobian_product(unit, column)
      unit(place(k)) = 0
      matrix(:, k) = column(place)
    end do
    call dgeev('N', 'N', n, matrix, n, real_parts, imaginary_parts, none, 1, none, 1, work, &
               size(work), info)
    ! Without convergence nothing may be claimed.
    if (info /= 0) real_parts = huge(1.0_wp)
  end subroutine jacobian_spectrum

  !> Where an unstable mode is strongest: (J + shift)ᵏ of any vector becomes that mode, as with the
  !> shift it is the largest of all.
  subroutine find_place(evolution, free, rightmost)
    class(evolution_t), intent(inout) :: evolution
    !> 1 at entries that are not prescribed, else 0
    real(wp), intent(in), contiguous :: free(:)
    type(rightmost_t), intent(inout) :: rightmost
    integer, parameter :: most_products = 3000
    real(wp) :: vector(size(free)), product(size(free)), shift, rate
    integer :: k

    do k = 1, size(free)
      vector(k) = free(k)*(random_uniform(4, int(k, i8)) - 0.5_wp)
    end do
    shift = 0
    do k = 1, most_products
      vector = vector/maxval(abs(vector))
      call evolution%jacobian_product(vector, product)
      rate = dot(vector, product)/dot(vector, vector)
      ! Where the left end of the spectrum takes over, the shift was too small.
      if (rate < 0) shift = max(shift, -rate)
      vector = product + shift*vector
      if (.not. maxval(abs(vector)) > 0) return
    end do
    rightmost%place = maxloc(abs(vector), dim=1)
  end subroutine find_place

  !> ARPACK on the polynomial, with a wider ellipse as long as eigenvalues off the axis hide those
  !> that are looked for.
  subroutine arnoldi(evolution, unknowns, spectral_radius, rightmost)
    class(evolution_t), intent(inout) :: evolution
    !> How many entries are not prescribed
    integer, intent(in) :: unknowns
    real(wp), intent(in) :: spectral_radius
    type(rightmost_t), intent(inout) :: rightmost
    integer :: restarts

    ! Where many eigenvalues lie off the axis, polynomials of high degree do not tell slow modes
    ! apart: rather than patience a lower degree helps.
    restarts = max(2, int(max(fewest_products, most_products*1.0e3_wp/ &
                              evolution%all_unknowns())/(krylov_size*highest_degree)))
    if (restarts > first_restarts) then
      call try_degrees(first_restarts)
      if (rightmost%converged .or. rightmost%growth_rate > 0) return
    end if
    call try_degrees(restarts)

  contains

    subroutine try_degrees(restarts)
      !> At most so many of each iteration, of those of the highest degree
      integer, intent(in) :: restarts
      integer :: degree
      logical :: all_fast

      ! In the plane the slowest of n modes is some 2.5/n of the spectral radius: three times that.
      degree = max(lowest_degree, min(highest_degree, int(sqrt(2.0_wp*unknowns/3))))
      do
        call try_ellipses(evolution, spectral_radius, degree, (restarts*highest_degree)/degree, &
                          rightmost, all_fast)
        if (rightmost%growth_rate > 0 .or. degree == lowest_degree) return
        if (.not. all_fast .and. (rightmost%converged .or. restarts > first_restarts)) return
        degree = max(lowest_degree, degree/2)
      end do
    end subroutine try_degrees
  end subroutine arnoldi

  !> ARPACK on polynomials of one degree.
  subroutine try_ellipses(evolution, spectral_radius, degree, restarts, rightmost, all_fast)
    class(evolution_t), intent(inout) :: evolution
    real(wp), intent(in) :: spectral_radius
    !> That degree, and how often ARPACK may restart
    integer, intent(in) :: degree, restarts
    type(rightmost_t), intent(inout) :: rightmost
    !> Whether what was found lies in the interval of fast decay, where it means nothing
    logical, intent(out) :: all_fast
    real(wp) :: centre, half_width, half_height, focus, at_zero, least, highest, slow_part
    integer :: attempt

    all_fast = .false.
    slow_part = slow_factor/degree**2
    centre = -0.5_wp*margin*spectral_radius*(1 + slow_part)
    half_width = 0.5_wp*margin*spectral_radius*(1 - slow_part)
    half_height = 0
    do attempt = 1, most_ellipses
      focus = sqrt(half_width**2 - half_height**2)
      call search(evolution, spectral_radius, degree, restarts, centre, focus, rightmost, least, &
                  highest)
      if (rightmost%growth_rate > 0) return
      at_zero = cosh(degree*acosh(-centre/focus))
      all_fast = rightmost%growth_rate <= -slow_part*margin*spectral_radius
      if (all_fast .and. attempt == 1) exit
      if (.not. rightmost%converged) exit
      ! What lies in the interval of fast decay is not what was looked for.
      if (least < at_zero .and. .not. all_fast) return
      half_height = min(max(1.25_wp*highest, 1.5_wp*half_height, 0.05_wp*half_width), &
                        0.9_wp*half_width)
    end do
    rightmost%converged = .false.
  end subroutine try_ellipses

  !> ARPACK on one polynomial.
  subroutine search(evolution, spectral_radius, degree, restarts, centre, focus, rightmost, &
                    least, highest)
    class(evolution_t), intent(inout) :: evolution
    !> 1/s
    real(wp), intent(in) :: spectral_radius
    !> Degree of the polynomial, and how often ARPACK may restart
    integer, intent(in) :: degree, restarts
    !> Centre of the ellipse, and half the distance between its foci, 1/s
    real(wp), intent(in) :: centre, focus
    type(rightmost_t), intent(inout) :: rightmost
    !> The least magnitude of the polynomial at the eigenvalues found, and the largest imaginary
    !> part of these, 1/s
    real(wp), intent(out) :: least, highest
    integer, parameter :: lworkl = 3*krylov_size**2 + 6*krylov_size
    real(wp), allocatable :: residual(:), basis(:, :), workd(:), vectors(:, :)
    real(wp) :: workl(lworkl), tolerance
    real(wp) :: dr(most_wanted + 2), di(most_wanted + 2)
    integer :: iparam(11), ipntr(14), ido, info, wanted, n

    n = evolution%unknowns()
    allocate (residual(n), basis(n, krylov_size), workd(3*n))
    call evolution%scatter(2, residual)

    wanted = most_wanted
    tolerance = accuracy
    dr = 0
    di = 0
    ido = 0
    info = 1
    iparam = 0
    iparam(1) = 1
    iparam(3) = restarts
    iparam(7) = 1
    do
      call evolution%iterate_arnoldi(ido, wanted, tolerance, residual, basis, iparam, ipntr, &
                                     workd, workl, info)
      if (abs(ido) /= 1) exit
      call apply_polynomial(evolution, degree, centre, focus, workd(ipntr(1):ipntr(1) + n - 1), &
                            workd(ipntr(2):ipntr(2) + n - 1))
    end do
    rightmost%method = 'Arnoldi iteration'
    rightmost%converged = info == 0
    allocate (vectors(n, most_wanted + 2))
    if (rightmost%converged) then
      call evolution%finish_arnoldi(dr, di, vectors, wanted, tolerance, residual, basis, iparam, &
                                    ipntr, workd, workl, info)
      rightmost%converged = info == 0
    end if
    deallocate (residual, basis, workd)
    if (.not. rightmost%converged) then
      ! The best single vector there is: what many polynomials leave over
      call settle(evolution, degree, centre, focus, vectors(:, 1))
      dr(1) = 1
    end if
    least = sqrt(minval(dr**2 + di**2, dr**2 + di**2 > 0))
    call judge(evolution, spectral_radius, dr, di, vectors, rightmost, highest)
  end subroutine search

  !> The Chebyshev polynomial of the Jacobian times a vector.
  subroutine apply_polynomial(evolution, degree, centre, focus, v, product)
    class(evolution_t), intent(inout) :: evolution
    integer, intent(in) :: degree
    real(wp), intent(in) :: centre, focus
    real(wp), intent(in), contiguous :: v(:)
    real(wp), intent(out), contiguous :: product(:)
    real(wp), allocatable :: term(:, :), work(:)
    real(wp) :: factor
    integer :: j, k, earlier, later

    allocate (term(size(v), 2))
    !$omp parallel do if (size(v) > worth_threads) schedule(static) default(shared) private(k)
    do k = 1, size(v)
      term(k, 1) = 0
      term(k, 2) = v(k)
    end do
    !$omp end parallel do
    earlier = 1
    do j = 1, degree
      factor = merge(1.0_wp, 2.0_wp, j == 1)/focus
      later = 3 - earlier
      ! factor (J - centre) newer - older
      call evolution%recur_with_jacobian([-factor*centre - 1, 1.0_wp, factor], term(:, later), &
                                         term(:, earlier), work)
      earlier = later
    end do
    product = term(:, 3 - earlier)
    call evolution%clear_prescribed(product)
  end subroutine apply_polynomial

  !> Leave of a vector what grows most or decays least.
  subroutine settle(evolution, degree, centre, focus, vector)
    class(evolution_t), intent(inout) :: evolution
    integer, intent(in) :: degree
    real(wp), intent(in) :: centre, focus
    real(wp), intent(out), contiguous :: vector(:)
    real(wp), allocatable :: product(:)
    integer :: k

    call evolution%scatter(3, vector)
    allocate (product(size(vector)))
    do k = 1, 10
      call apply_polynomial(evolution, degree, centre, focus, vector, product)
      vector = product/evolution%root_mean_square(product)
    end do
  end subroutine settle

  !> Of some eigenvectors the one whose Rayleigh quotient with the Jacobian has the largest real
  !> part.
  subroutine judge(evolution, spectral_radius, dr, di, vectors, rightmost, highest)
    class(evolution_t), intent(inout) :: evolution
    !> 1/s
    real(wp), intent(in) :: spectral_radius
    !> The polynomial's eigenvalues, those of a pair one after another; 0 where there is none
    real(wp), intent(in), contiguous :: dr(:), di(:)
    !> Its eigenvectors: of a pair first the real and then the imaginary part
    real(wp), intent(in) :: vectors(:, :)
    type(rightmost_t), intent(inout) :: rightmost
    !> The largest imaginary part of any of them
    real(wp), intent(out) :: highest
    real(wp), allocatable :: a(:), b(:), ja(:), jb(:)
    real(wp) :: norm, growth_rate, frequency, decays(size(dr))
    integer :: k

    rightmost%growth_rate = -huge(1.0_wp)
    highest = 0
    decays = 0
    allocate (a(size(vectors, 1)), b(size(vectors, 1)), ja(size(vectors, 1)), jb(size(vectors, 1)))
    do k = 1, size(dr)
      if (.not. dr(k)**2 + di(k)**2 > 0) cycle
      a = vectors(:, k)
      b = 0
      if (k < size(dr) .and. di(k) > 0) b = vectors(:, k + 1)
      ! The second of a pair repeats the first.
      if (di(k) < 0) cycle
      call evolution%jacobian_product(a, ja)
      call evolution%jacobian_product(b, jb)
      norm = evolution%dot(a, a) + evolution%dot(b, b)
      growth_rate = (evolution%dot(a, ja) + evolution%dot(b, jb))/norm
      frequency = abs(evolution%dot(a, jb) - evolution%dot(b, ja))/norm
      highest = max(highest, frequency)
      decays(k) = -growth_rate
      if (growth_rate <= rightmost%growth_rate) cycle
      rightmost%growth_rate = growth_rate
      rightmost%frequency = frequency
      rightmost%place = maxloc(a**2 + b**2, dim=1)
    end do
    rightmost%slowest_decay = slowest_of(decays, spectral_radius)
  end subroutine judge

end module calor_rightmost_eigenvalue
