!> The table of time integrators.
module calor_integrators
  use calor_choice, only: choice_t, choice_names
  use calor_error, only: error_t, raise, status_bad_input
  use calor_exponential, only: exponential_t
  use calor_forward_euler, only: forward_euler_t
  use calor_integrator, only: integrator_t
  use calor_rkl2, only: rkl2_t
  use calor_runge_kutta_4, only: runge_kutta_4_t
  use calor_text, only: suggestion
  use calor_tr_bdf2, only: tr_bdf2_t
  implicit none (type, external)
  private

  public :: integrator_choices, make_integrator

  !> Every integrator that a scene may name
  type(choice_t), parameter :: integrator_choices(*) = [ &
      choice_t('auto', 'the cheapest of rkl2, tr_bdf2 and exponential, as foreseen'), &
      choice_t('forward_euler', 'first order, one evaluation a step'), &
      choice_t('runge_kutta_4', 'fourth order, four evaluations a step'), &
      choice_t('rkl2', 'second order, stabilised for diffusion: long steps, adaptive'), &
      choice_t('tr_bdf2', 'second order, implicit: steps of any length, adaptive'), &
      choice_t('exponential', 'exact in time, for linear problems that do not change with time') &
      ]

contains

  !> Make the integrator of that name.
  subroutine make_integrator(name, integrator, error)
    !> One of the names in `integrator_choices`
    character(len=*), intent(in) :: name
    !> The integrator
    class(integrator_t), allocatable, intent(out) :: integrator
    !> No integrator has that name
    type(error_t), allocatable, intent(out) :: error

    select case (name)
    case ('auto', 'rkl2')
      allocate (rkl2_t :: integrator)
    case ('tr_bdf2')
      allocate (tr_bdf2_t :: integrator)
    case ('exponential')
      allocate (exponential_t :: integrator)
    case ('forward_euler')
      allocate (forward_euler_t :: integrator)
    case ('runge_kutta_4')
      allocate (runge_kutta_4_t :: integrator)
    case default
      call raise(error, status_bad_input, 'No time integrator is called '''//name//'''.'// &
                 suggestion(name, choice_names(integrator_choices)))
    end select
  end subroutine make_integrator

end module calor_integrators
