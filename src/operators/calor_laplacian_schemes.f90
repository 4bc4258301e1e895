!> The table of schemes for the Laplacian.
module calor_laplacian_schemes
  use calor_choice, only: choice_t, choice_names
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: wp
  use calor_laplacian_brookshaw, only: brookshaw_t
  use calor_laplacian_brookshaw_renormalized, only: brookshaw_renormalized_t
  use calor_laplacian_consistent, only: consistent_t, natural_support
  use calor_laplacian_double_gradient, only: double_gradient_t
  use calor_laplacian_fatehi_manzari, only: fatehi_manzari_t
  use calor_laplacian_kernel_second_derivative, only: kernel_second_derivative_t
  use calor_laplacian_positive, only: positive_t
  use calor_laplacian_scheme, only: laplacian_scheme_t
  use calor_taylor_weights, only: highest_order, default_order
  use calor_text, only: suggestion, to_text
  implicit none (type, external)
  private

  public :: laplacian_choices, make_laplacian_scheme, usual_support

  !> Every Laplacian scheme that a scene may name
  type(choice_t), parameter :: laplacian_choices(*) = [ &
      choice_t('kernel_second_derivative', 'the kernel''s own; exact for constants', &
               '⟨∇²u⟩_i = Σ w_j (u_j − u_i) (W″ + W′/r)', &
               'a step: the neighbours, once', &
               'R. Fatehi, M.T. Manzari, Comput. Math. Appl. 61 (2011) 482–498'), &
      choice_t('double_gradient', 'renormalized gradient twice; exact for linear fields', &
               'the renormalized gradient applied twice', &
               'a step: neighbours of neighbours, some 4 times as many; often unstable', &
               'R. Fatehi, M.T. Manzari, Comput. Math. Appl. 61 (2011) 482–498'), &
      choice_t('brookshaw', 'the usual SPH Laplacian; exact for constants', &
               '⟨∇²u⟩_i = Σ 2 w_j (u_i − u_j)/r e_ij·∇W_ij', &
               'a step: the neighbours, once', &
               'L. Brookshaw, Proc. Astron. Soc. Aust. 6 (1985) 207–210'), &
      choice_t('brookshaw_renormalized', 'brookshaw with the tensor B; exact for constants', &
               '⟨∇²u⟩_i = Σ 2 w_j (u_i − u_j)/r e_ij·(B_i·∇W_ij)', &
               'a step: the neighbours, once; set-up: a 2 × 2 system each', &
               'R. Fatehi, M.T. Manzari, Comput. Math. Appl. 61 (2011) 482–498'), &
      choice_t('fatehi_manzari', 'the paper''s new scheme; exact for quadratic fields', &
               '⟨∇²u⟩_i = Σ 2 w_j (B̂_i : e_ij ∇W_ij) [(u_i − u_j)/r − e_ij·⟨∇u⟩_i]', &
               'a step: as brookshaw; set-up: 2 × 2 and 3 × 3 systems each', &
               'R. Fatehi, M.T. Manzari, Comput. Math. Appl. 61 (2011) 482–498'), &
      choice_t('positive', 'non-negative weights; exact for quadratic fields, maximum principle', &
               'weights a_ij ≥ 0, exact for quadratic fields, of least Σ a_ij r_ij⁴', &
               'a step: at most 5 neighbours; set-up: a linear programme each', &
               'B. Seibold, Comput. Methods Appl. Mech. Eng. 198 (2008) 592–601'), &
      choice_t('consistent', 'order 2, 4, 6 or 8 (&scheme order); exact one degree beyond it', &
               'weights of least norm, exact for polynomials up to degree p + 1', &
               'a step: some 11 (p = 2) to 66 (p = 8) neighbours; set-up: a system each', &
               'docs/schemes.md; class of J.R.C. King et al., J. Comput. Phys. 415 (2020) 109549') &
      ]

contains

  !> The support radius, in spacings, that a scheme of that name and order is usually given.
  pure function usual_support(name, order) result(support)
    character(len=*), intent(in) :: name
    integer, intent(in) :: order
    real(wp) :: support

    support = 2.1_wp
    if (name == 'consistent') support = natural_support(order)
  end function usual_support

  !> Make the Laplacian scheme of that name.
  subroutine make_laplacian_scheme(name, scheme, error, order)
    !> One of the names in `laplacian_choices`
    character(len=*), intent(in) :: name
    !> The scheme
    class(laplacian_scheme_t), allocatable, intent(out) :: scheme
    !> No scheme has that name
    type(error_t), allocatable, intent(out) :: error
    !> The order of a scheme that has several, 1 … highest_order; `default_order` without it
    integer, intent(in), optional :: order
    integer :: chosen

    select case (name)
    case ('kernel_second_derivative')
      allocate (kernel_second_derivative_t :: scheme)
    case ('double_gradient')
      allocate (double_gradient_t :: scheme)
    case ('brookshaw')
      allocate (brookshaw_t :: scheme)
    case ('brookshaw_renormalized')
      allocate (brookshaw_renormalized_t :: scheme)
    case ('fatehi_manzari')
      allocate (fatehi_manzari_t :: scheme)
    case ('positive')
      allocate (positive_t :: scheme)
    case ('consistent')
      chosen = default_order
      if (present(order)) chosen = order
      if (chosen < 1 .or. chosen > highest_order) then
        call raise(error, status_bad_input, 'The scheme ''consistent'' has no order '// &
                   to_text(chosen)//'; it has 1 to '//to_text(highest_order)//'.')
        return
      end if
      allocate (scheme, source=consistent_t(chosen))
    case default
      call raise(error, status_bad_input, 'No Laplacian scheme is called '''//name//'''.'// &
                 suggestion(name, choice_names(laplacian_choices)))
    end select
  end subroutine make_laplacian_scheme

end module calor_laplacian_schemes
