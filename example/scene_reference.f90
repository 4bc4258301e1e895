!> What a scene file may say, as the program itself knows it:
!>
!>     scene_reference            the groups
!>     scene_reference GROUP      the keys of a group
!>     scene_reference LIST       what there is to choose from: shapes, arrangements, kernels,
!>                                laplacians, gradients or methods
program scene_reference
  use calor, only: arrangement_choices, choice_t, contract_help, gradient_choices, &
                   integrator_choices, kernel_choices, laplacian_choices, shape_choices
  implicit none (type, external)
  character(len=32) :: topic

  topic = ''
  if (command_argument_count() > 0) call get_command_argument(1, topic)
  select case (topic)
  case ('kernels')
    call print_choices(kernel_choices)
  case ('shapes')
    call print_choices(shape_choices)
  case ('arrangements')
    call print_choices(arrangement_choices)
  case ('laplacians')
    call print_choices(laplacian_choices)
  case ('gradients')
    call print_choices(gradient_choices)
  case ('methods')
    call print_choices(integrator_choices)
  case default
    print '(a)', contract_help(trim(topic))
  end select

contains

  subroutine print_choices(choices)
    type(choice_t), intent(in) :: choices(:)
    integer :: k

    do k = 1, size(choices)
      print '(3a)', choices(k)%name(:26), trim(choices(k)%summary)
    end do
  end subroutine print_choices

end program scene_reference
