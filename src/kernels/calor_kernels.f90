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
      choice_t('cubic_spline', 'Cubic spline M4: the classic; second derivative with kinks'), &
      choice_t('quintic_spline', 'Quintic spline M6: smoother, wants a wider support'), &
      choice_t('wendland_c2', 'Wendland C2: no pairing of particles, the usual choice'), &
      choice_t('wendland_c4', 'Wendland C4: smoother, for some 20 neighbours and more'), &
      choice_t('wendland_c6', 'Wendland C6: smoothest, for some 30 neighbours and more') &
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
