!> The steady temperature by Newton's method with a sparse direct solution of each step.
module calor_steady_state
  use calor_conduction, only: conduction_t
  use calor_error, only: error_t, raise, status_bad_input, status_bad_numbers
  use calor_implicit_system, only: implicit_system_t
  use calor_kinds, only: wp
  use calor_sums, only: root_mean_square
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: find_steady_state

  !> Newton steps; radiation from far away takes some ten
  integer, parameter :: most_steps = 50
  !> A step may be halved so often where it makes things worse
  integer, parameter :: most_halvings = 12
  !> Where factors do not fit into memory, each Newton step is iterated to this part of what is left
  real(wp), parameter :: iteration_part = 1.0e-8_wp

contains

  !> Find the temperature at which nothing changes any more, all expressions taken at time 0.
  subroutine find_steady_state(conduction, place, tolerance, temperature, steps, error)
    !> The heat equation
    type(conduction_t), intent(inout) :: conduction
    !> Where the scene asks for it
    character(len=*), intent(in) :: place
    !> The change of any temperature at which the iteration ends, K
    real(wp), intent(in) :: tolerance
    !> A first guess; the steady temperature
    real(wp), intent(inout) :: temperature(:)
    !> Newton steps made
    integer, intent(out) :: steps
    !> There is no steady temperature, or more than one, or it was not found
    type(error_t), allocatable, intent(out) :: error
    type(implicit_system_t) :: system
    integer, allocatable :: first(:), index(:)
    real(wp), allocatable :: value(:), rate(:), change(:), guess(:)
    real(wp) :: before, part, largest
    integer :: halvings
    logical :: done, known, is_nonlinear

    is_nonlinear = allocated(conduction%slope)
    if (allocated(conduction%content)) then
      is_nonlinear = is_nonlinear .or. conduction%content%conducts() .or. &
                     allocated(conduction%local)
    end if
    call conduction%linearise(0.0_wp, temperature)
    call require_hold(conduction, place, error)
    if (allocated(error)) return
    allocate (rate(size(temperature)), change(size(temperature)))
    call conduction%rate(0.0_wp, temperature, rate)
    do steps = 1, most_steps
      call conduction%linearise(0.0_wp, temperature)
      call conduction%jacobian_rows(first, index, value, known)
      call system%load(first, index, value)
      call system%set_steady(done)
      if (done) call system%solve(rate, iteration_part*root_mean_square(rate), change, done)
      if (.not. done) then
        call raise(error, status_bad_numbers, place// &
                   ': the equations of the steady temperature could not be '// &
                   'solved: they are singular, or there is too little memory for their '// &
                   'factors and the iteration did not converge.')
        exit
      end if
      before = root_mean_square(rate)
      part = 1
      do halvings = 0, most_halvings
        guess = temperature + part*change
        call conduction%rate(0.0_wp, guess, rate)
        ! A linear problem is solved by one whole step, whatever rounding leaves.
        if (root_mean_square(rate) <= before .or. .not. is_nonlinear) exit
        part = 0.5_wp*part
      end do
      temperature = guess
      ! The whole correction: where only rounding is left, halving it has no meaning.
      largest = maxval(abs(change))
      if (.not. largest <= huge(largest)) exit
      if (largest <= tolerance) exit
    end do
    if (allocated(error)) return
    if (.not. largest <= tolerance) then
      call raise(error, status_bad_numbers, place//': the steady temperature was not found in '// &
                 to_text(most_steps)//' Newton steps; the last one changed it by '// &
                 to_text(largest, digits=3)//' K. Start from a better &initial temperature, or '// &
                 'let the scene run in time.')
    end if
  end subroutine find_steady_state

  !> Something must tie the temperature down: insulated, or heated at a given rate only, a body has
  !> no steady temperature, or as many as one likes.
  subroutine require_hold(conduction, place, error)
    type(conduction_t), intent(in) :: conduction
    character(len=*), intent(in) :: place
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    do k = 1, size(conduction%prescribed)
      if (size(conduction%prescribed(k)%particle) > 0) return
    end do
    if (allocated(conduction%slope)) then
      if (any(abs(conduction%slope) > 0)) return
    end if
    call raise(error, status_bad_input, place//': nothing ties the steady temperature down: '// &
               'hold it, or let it exchange heat by convection or radiation, on a part of the '// &
               'boundary at least.')
  end subroutine require_hold

end module calor_steady_state
