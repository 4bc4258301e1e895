!> The table of smoothing kernels.
module calor_kernels
  use calor_choice, only: choice_t, choice_names
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kernel, only: kernel_t
  use calor_kernel_cubic_spline, only: cubic_spline_t
  use calor_kernel_quintic_spline, only: quintic_spline_t
  use calor_kernel_wendland_c2, only: wendland_c2_t
  use calor_kernel_wendland_c4, only: wendland_c4_t
  use calor_kernel_wendland_c6, only: wendland_c6_t
  use calor_text, only: suggestion
  implicit none (type, external)
  private

  public :: kernel_choices, make_kernel

  !> Every kernel that a scene may name
  type(choice_t), parameter :: kernel_choices(*) = [ &
      choice_t('cubic_spline', 'Cubic spline M4: the classic; second derivative with kinks', &
               'W h² = 80/(7π) [(1−q)₊³ − 4 (1/2−q)₊³], q = r/h', &
               'evaluated once for each pair', &
               'J.J. Monaghan, J.C. Lattanzio, Astron. Astrophys. 149 (1985) 135–143'), &
      choice_t('quintic_spline', 'Quintic spline M6: smoother, wants a wider support', &
               'W h² = 63/(478π) [(3−s)₊⁵ − 6 (2−s)₊⁵ + 15 (1−s)₊⁵], s = 3 r/h', &
               'evaluated once for each pair', &
               'J.J. Monaghan, J.C. Lattanzio, Astron. Astrophys. 149 (1985) 135–143'), &
      choice_t('wendland_c2', 'Wendland C2: no pairing of particles, the usual choice', &
               'W h² = 7/π (1−q)⁴ (4q + 1), q = r/h', &
               'evaluated once for each pair', &
               'H. Wendland, Adv. Comput. Math. 4 (1995) 389–396'), &
      choice_t('wendland_c4', 'Wendland C4: smoother, for some 20 neighbours and more', &
               'W h² = 9/π (1−q)⁶ (35/3 q² + 6q + 1), q = r/h', &
               'evaluated once for each pair', &
               'H. Wendland, Adv. Comput. Math. 4 (1995) 389–396'), &
      choice_t('wendland_c6', 'Wendland C6: smoothest, for some 30 neighbours and more', &
               'W h² = 78/(7π) (1−q)⁸ (32q³ + 25q² + 8q + 1), q = r/h', &
               'evaluated once for each pair', &
               'H. Wendland, Adv. Comput. Math. 4 (1995) 389–396') &
      ]

contains

  !> Make the kernel of that name.
  subroutine make_kernel(name, kernel, error)
    !> One of the names in `kernel_choices`
    character(len=*), intent(in) :: name
    !> The kernel
    class(kernel_t), allocatable, intent(out) :: kernel
    !> No kernel has that name
    type(error_t), allocatable, intent(out) :: error

    select case (name)
    case ('cubic_spline')
      allocate (cubic_spline_t :: kernel)
    case ('quintic_spline')
      allocate (quintic_spline_t :: kernel)
    case ('wendland_c2')
      allocate (wendland_c2_t :: kernel)
    case ('wendland_c4')
      allocate (wendland_c4_t :: kernel)
    case ('wendland_c6')
      allocate (wendland_c6_t :: kernel)
    case default
      call raise(error, status_bad_input, 'No kernel is called '''//name//'''.'// &
                 suggestion(name, choice_names(kernel_choices)))
    end select
  end subroutine make_kernel

end module calor_kernels
