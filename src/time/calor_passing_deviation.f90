!> The error where a front passes particles, from a second run with particles twice as far apart.
!>
!> While a front moves from one particle to the next, temperatures about it lag behind and catch up:
!> an error like a sawtooth, the slope of the temperature times the distance of the front from the
!> particle, Δ/2 at most, that enters the field as far as heat spreads in the time of a passage, a
!> length like √Δ. Its L2 norm over the field grows like Δ^(5/4). In the two runs the teeth are at
!> different places and signs, so that squares add up: the mean square of their difference is
!> 1 + 2^(5/2) times that of the error, a mean over the time in which a front passes a particle of
!> the coarser run. At any one time the error is anything between nearly nothing and about twice
!> that. Where errors are smooth and of second order, the difference is three times the error
!> instead of 2.58 times.
module calor_passing_deviation
  use calor_kinds, only: wp
  use calor_saved_state, only: saved_state_t
  implicit none (type, external)
  private

  public :: passing_deviation_t

  !> Mean squares are over so many differences at least, which is to say that these are half as old
  !> on average
  real(wp), parameter :: fewest = 8.0_wp

  !> Mean squares of differences that fade while a front passes a particle
  type :: passing_deviation_t
    private
    !> Differences so far
    integer :: samples = 0
    !> The liquid area at the last one, m²
    real(wp) :: liquid = 0.0_wp
    !> The area that melts while fronts pass a particle of the coarser run, m²
    real(wp) :: passage = 0.0_wp
    !> Mean squares for each particle; not allocated before the first difference
    real(wp), allocatable :: square(:)
  contains
    procedure :: note
    procedure :: error => error_from_differences
    procedure :: save => save_deviation
    procedure :: restore => restore_deviation
  end type passing_deviation_t

contains

  subroutine note(this, difference, fraction, area)
    class(passing_deviation_t), intent(inout) :: this
    !> The temperature less that of the coarser run, the liquid fraction and the area of each
    !> particle, m²
    real(wp), intent(in) :: difference(:), fraction(:), area(:)
    real(wp) :: liquid, part, width

    liquid = sum(fraction*area)
    ! Fronts are as long as the particles that melt are many and wide, and twice as wide is a
    ! particle of the coarser run.
    width = 2*sum(area, fraction > 0 .and. fraction < 1)
    if (width > 0) this%passage = width
    this%samples = this%samples + 1
    part = 0
    if (this%passage > 0) part = min(2/fewest, 2*abs(liquid - this%liquid)/this%passage)
    part = max(part, 2.0_wp/(this%samples + 1))
    this%liquid = liquid
    if (.not. allocated(this%square)) allocate (this%square(size(difference)), source=0.0_wp)
    this%square = this%square + part*(difference**2 - this%square)
  end subroutine note

  !> The root of the mean square of the error of each particle; 0 before the first difference
  pure function error_from_differences(this, particles) result(error)
    class(passing_deviation_t), intent(in) :: this
    !> How many there are
    integer, intent(in) :: particles
    real(wp) :: error(particles)

    error = 0
    if (allocated(this%square)) error = sqrt(this%square/(1 + 2**2.5_wp))
  end function error_from_differences

  subroutine save_deviation(this, state)
    class(passing_deviation_t), intent(in) :: this
    type(saved_state_t), intent(inout) :: state

    call state%enter('deviation')
    call state%put('samples', this%samples)
    call state%put('liquid', this%liquid)
    call state%put('passage', this%passage)
    if (allocated(this%square)) call state%put('square', this%square)
    call state%leave()
  end subroutine save_deviation

  subroutine restore_deviation(this, state)
    class(passing_deviation_t), intent(inout) :: this
    type(saved_state_t), intent(inout) :: state

    call state%enter('deviation')
    call state%get('samples', this%samples)
    call state%get('liquid', this%liquid)
    call state%get('passage', this%passage)
    if (state%has('square')) call state%get('square', this%square)
    call state%leave()
  end subroutine restore_deviation

end module calor_passing_deviation
