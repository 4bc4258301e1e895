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
      choice_t('auto', 'the cheapest of rkl2, tr_bdf2 and exponential, as foreseen', &
               'that of the method chosen', &
               'that of the method chosen', &
               'docs/schemes.md'), &
      choice_t('forward_euler', 'first order, one evaluation a step', &
               'u ← u + τ F(u)', &
               'one evaluation a step; steps at most 2/ρ, ρ the spectral radius', &
               'L. Euler, Institutionum calculi integralis I, 1768'), &
      choice_t('runge_kutta_4', 'fourth order, four evaluations a step', &
               'u ← u + τ/6 (k₁ + 2 k₂ + 2 k₃ + k₄)', &
               'four evaluations a step; steps at most 2.785/ρ', &
               'W. Kutta, Z. Math. Phys. 46 (1901) 435–453'), &
      choice_t('rkl2', 'second order, stabilised for diffusion: long steps, adaptive', &
               's stages of Legendre polynomials, stable up to τ = (s² + s − 2)/(2ρ)', &
               's evaluations a step, but steps longer by s²/4: the cheapest for diffusion', &
               'C.D. Meyer, D.S. Balsara, T.D. Aslam, J. Comput. Phys. 257 (2014) 594–626'), &
      choice_t('tr_bdf2', 'second order, implicit: steps of any length, adaptive', &
               'trapezoidal rule to t + γτ, then BDF2 to t + τ; γ = 2 − √2', &
               'two solutions with one sparse matrix a step, factorised where the step changes', &
               'M.E. Hosea, L.F. Shampine, Appl. Numer. Math. 20 (1996) 21–37'), &
      choice_t('exponential', 'exact in time, for linear problems that do not change with time', &
               'exp(τ A) u by Faber polynomials of A on an ellipse about the spectrum', &
               'about √(ρ τ ln(1/tolerance)) products for a step of any length', &
               'docs/schemes.md') &
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
