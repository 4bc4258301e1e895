!> Wall time by phase.
module calor_stopwatch
  use calor_kinds, only: wp, i8
  implicit none (type, external)
  private

  public :: stopwatch_t, phase_t

  !> A named share of the wall time
  type :: phase_t
    character(len=16) :: name = ''
    !> s
    real(wp) :: seconds = 0.0_wp
  end type phase_t

  !> Adds up the wall time of named phases, one of which runs at a time
  type :: stopwatch_t
    !> The phases in the order of their first start
    type(phase_t), allocatable :: phases(:)
    integer(i8), private :: since = 0
    integer, private :: running = 0
  contains
    !> End the phase that runs, if any, and start or go on with another
    procedure :: start
    !> End the phase that runs
    procedure :: stop => stop_phase
    !> Wall time of all phases, s
    procedure :: total
    !> Wall time of a phase so far, s
    procedure :: seconds_of
    !> Take over the phases of another stopwatch that ran inside one of this one's
    procedure :: take_over
    !> Add the times of another stopwatch, as of a run's second part
    procedure :: add => add_phases
  end type stopwatch_t

contains

  subroutine start(this, name)
    class(stopwatch_t), intent(inout) :: this
    !> The phase
    character(len=*), intent(in) :: name
    integer :: k

    call this%stop()
    if (.not. allocated(this%phases)) allocate (this%phases(0))
    do k = 1, size(this%phases)
      if (this%phases(k)%name == name) exit
    end do
    if (k > size(this%phases)) this%phases = [this%phases, phase_t(name)]
    this%running = k
    call system_clock(this%since)
  end subroutine start

  subroutine stop_phase(this)
    class(stopwatch_t), intent(inout) :: this
    integer(i8) :: now, rate

    if (this%running == 0) return
    call system_clock(now, rate)
    associate (phase => this%phases(this%running))
      phase%seconds = phase%seconds + real(now - this%since, wp)/rate
    end associate
    this%running = 0
  end subroutine stop_phase

  subroutine take_over(this, inner, outer_phase)
    class(stopwatch_t), intent(inout) :: this
    !> The other; it starts from zero again
    type(stopwatch_t), intent(inout) :: inner
    !> The phase of this one that held the time so far
    character(len=*), intent(in) :: outer_phase
    real(wp) :: seconds
    integer :: k

    seconds = inner%total()
    if (.not. allocated(inner%phases)) return
    do k = 1, size(inner%phases)
      call this%start(trim(inner%phases(k)%name))
      call this%stop()
      where (this%phases%name == inner%phases(k)%name)
        this%phases%seconds = this%phases%seconds + inner%phases(k)%seconds
      end where
    end do
    where (this%phases%name == outer_phase) this%phases%seconds = this%phases%seconds - seconds
    deallocate (inner%phases)
  end subroutine take_over

  subroutine add_phases(this, other)
    class(stopwatch_t), intent(inout) :: this
    !> The other, at rest
    type(stopwatch_t), intent(in) :: other
    integer :: k

    if (.not. allocated(other%phases)) return
    do k = 1, size(other%phases)
      call this%start(trim(other%phases(k)%name))
      call this%stop()
      where (this%phases%name == other%phases(k)%name)
        this%phases%seconds = this%phases%seconds + other%phases(k)%seconds
      end where
    end do
  end subroutine add_phases

  pure function seconds_of(this, name) result(seconds)
    class(stopwatch_t), intent(in) :: this
    !> The phase
    character(len=*), intent(in) :: name
    real(wp) :: seconds
    integer :: k

    seconds = 0
    if (.not. allocated(this%phases)) return
    do k = 1, size(this%phases)
      if (this%phases(k)%name == name) seconds = this%phases(k)%seconds
    end do
  end function seconds_of

  pure function total(this) result(seconds)
    class(stopwatch_t), intent(in) :: this
    real(wp) :: seconds

    seconds = 0
    if (allocated(this%phases)) seconds = sum(this%phases%seconds)
  end function total

end module calor_stopwatch
