!> The table of schemes for the first derivative.
module calor_gradient_schemes
  use calor_choice, only: choice_t, choice_names
  use calor_error, only: error_t, raise, status_bad_input
  use calor_gradient_consistent, only: consistent_gradient_t
  use calor_gradient_difference, only: difference_gradient_t
  use calor_gradient_renormalized, only: renormalized_gradient_t
  use calor_gradient_scheme, only: gradient_scheme_t
  use calor_gradient_standard, only: standard_gradient_t
  use calor_gradient_sum, only: sum_gradient_t
  use calor_taylor_weights, only: highest_order, default_order
  use calor_text, only: suggestion, to_text
  implicit none (type, external)
  private

  public :: gradient_choices, make_gradient_scheme

  !> Every gradient scheme that a scene may name
  type(choice_t), parameter :: gradient_choices(*) = [ &
      choice_t('standard', 'sum of u_j times the kernel gradient; exact for nothing', &
               '⟨∇u⟩_i = Σ w_j u_j ∇W_ij', &
               'one pass over the neighbours', &
               'J.J. Monaghan, Rep. Prog. Phys. 68 (2005) 1703–1759'), &
      choice_t('difference', 'sum of u_j - u_i; exact for constants', &
               '⟨∇u⟩_i = Σ w_j (u_j − u_i) ∇W_ij', &
               'one pass over the neighbours', &
               'J.J. Monaghan, Rep. Prog. Phys. 68 (2005) 1703–1759'), &
      choice_t('sum', 'sum of u_j + u_i; conserves in pairs, exact for nothing', &
               '⟨∇u⟩_i = Σ w_j (u_j + u_i) ∇W_ij', &
               'one pass over the neighbours', &
               'J.J. Monaghan, Rep. Prog. Phys. 68 (2005) 1703–1759'), &
      choice_t('renormalized', 'difference with the tensor B; exact for linear fields', &
               '⟨∇u⟩_i = Σ w_j (u_j − u_i) B_i·∇W_ij, B_i = −[Σ w_j r_ij ∇W_ij]⁻¹', &
               'a 2 × 2 system for each particle, once', &
               'R. Fatehi, M.T. Manzari, Comput. Math. Appl. 61 (2011) 482–498'), &
      choice_t('consistent', 'order 2, 4, 6 or 8 (&scheme order); exact for polynomials up to it', &
               'weights of least norm that differentiate polynomials up to degree p exactly', &
               'a small system for each particle, once; wider supports with p', &
               'docs/schemes.md; class of J.R.C. King et al., J. Comput. Phys. 415 (2020) 109549') &
      ]

contains

  !> Make the gradient scheme of that name.
  subroutine make_gradient_scheme(name, scheme, error, order)
    !> One of the names in `gradient_choices`
    character(len=*), intent(in) :: name
    !> The scheme
    class(gradient_scheme_t), allocatable, intent(out) :: scheme
    !> No scheme has that name
    type(error_t), allocatable, intent(out) :: error
    !> The order of a scheme that has several, 1 … highest_order; `default_order` without it
    integer, intent(in), optional :: order
    integer :: chosen

    select case (name)
    case ('standard')
      allocate (standard_gradient_t :: scheme)
    case ('difference')
      allocate (difference_gradient_t :: scheme)
    case ('sum')
      allocate (sum_gradient_t :: scheme)
    case ('renormalized')
      allocate (renormalized_gradient_t :: scheme)
    case ('consistent')
      chosen = default_order
      if (present(order)) chosen = order
      if (chosen < 1 .or. chosen > highest_order) then
        call raise(error, status_bad_input, 'The scheme ''consistent'' has no order '// &
                   to_text(chosen)//'; it has 1 to '//to_text(highest_order)//'.')
        return
      end if
      allocate (scheme, source=consistent_gradient_t(chosen))
    case default
      call raise(error, status_bad_input, 'No gradient scheme is called '''//name//'''.'// &
                 suggestion(name, choice_names(gradient_choices)))
    end select
  end subroutine make_gradient_scheme

end module calor_gradient_schemes
