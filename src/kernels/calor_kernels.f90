!> The table of smoothing kernels.
module calor_kernels
  use calor_choice, only: choice_t, choice_names
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kernel, only: kernel_t
  use calor_kernel_wendland_c2, only: wendland_c2_t
  use calor_text, only: suggestion
  implicit none (type, external)
  private

  public :: kernel_choices, make_kernel

  !> Every kernel that a scene may name
  type(choice_t), parameter :: kernel_choices(*) = [ &
      choice_t('wendland_c2', 'Wendland C2: no pairing of particles, the usual choice') &
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
    case ('wendland_c2')
      allocate (wendland_c2_t :: kernel)
    case default
      call raise(error, status_bad_input, 'No kernel is called '''//name//'''.'// &
                 suggestion(name, choice_names(kernel_choices)))
    end select
  end subroutine make_kernel

end module calor_kernels
