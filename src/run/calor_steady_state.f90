!> The steady temperature by Newton's method with a sparse direct solution of each step.
module calor_steady_state
  use calor_conduction, only: conduction_t
  use calor_error, only: error_t, raise, status_bad_input, status_bad_numbers
  use calor_kinds, only: wp
  use calor_sums, only: root_mean_square
  use calor_text, only: to_text
  use calor_umfpack, only: factorisation_t
  implicit none (type, external)
  private

  public :: find_steady_state

  !> Newton steps; radiation from far away takes some ten
  integer, parameter :: most_steps = 50
  !> A step may be halved so often where it makes things worse
  integer, parameter :: most_halvings = 12

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
    type(factorisation_t) :: factors
    integer, allocatable :: first(:), index(:)
    real(wp), allocatable :: value(:), rate(:), change(:), guess(:)
    real(wp) :: before, part, largest
    integer :: halvings
    logical :: done, is_nonlinear

    is_nonlinear = allocated(conduction%slope)
    if (allocated(conduction%content)) then
      is_nonlinear = is_nonlinear .or. conduction%content%conducts()
    end if
    call conduction%linearise(0.0_wp, temperature)
    call require_hold(conduction, place, error)
    if (allocated(error)) return
    allocate (rate(size(temperature)), change(size(temperature)))
    call conduction%rate(0.0_wp, temperature, rate)
    do steps = 1, most_steps
      call conduction%linearise(0.0_wp, temperature)
      call jacobian(conduction, first, index, value)
      call factors%factorise(first, index, value, done)
      if (done) call factors%solve(-rate, change, .false., done)
      if (.not. done) then
        call raise(error, status_bad_numbers, place// &
                   ': the equations of the steady temperature could not be '// &
                   'solved: they are singular, or there is too little memory.')
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
    call factors%release()
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

  !> The Jacobian by rows. Held particles have a row of their own, which keeps them as they are.
  subroutine jacobian(conduction, first, index, value)
    type(conduction_t), intent(in) :: conduction
    integer, allocatable, intent(out) :: first(:), index(:)
    real(wp), allocatable, intent(out) :: value(:)
    integer, allocatable :: owner(:)
    !> dθ/dT
    real(wp), allocatable :: growth(:)
    integer :: n, k, row, used, from, to

    n = conduction%unknowns()
    allocate (growth(n), source=1.0_wp)
    if (allocated(conduction%potential_slope)) growth = conduction%potential_slope
    associate (laplacian => conduction%laplacian)
      allocate (owner(n), source=0)
      owner(laplacian%target) = [(k, k=1, laplacian%rows())]
      allocate (first(n + 1), index(size(laplacian%index) + n), value(size(laplacian%index) + n))
      used = 0
      do row = 1, n
        first(row) = used + 1
        used = used + 1
        index(used) = row
        value(used) = -1
        if (owner(row) == 0) cycle
        value(used) = conduction%diffusivity*laplacian%diagonal(owner(row))*growth(row)
        if (allocated(conduction%slope)) value(used) = value(used) + conduction%slope(row)
        from = int(laplacian%first(owner(row)))
        to = int(laplacian%first(owner(row) + 1)) - 1
        index(used + 1:used + to - from + 1) = laplacian%index(from:to)
        value(used + 1:used + to - from + 1) = conduction%diffusivity*laplacian%weight(from:to)* &
                                               growth(laplacian%index(from:to))
        used = used + to - from + 1
      end do
      first(n + 1) = used + 1
    end associate
    index = index(:used)
    value = value(:used)
  end subroutine jacobian

end module calor_steady_state
