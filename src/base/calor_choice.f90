!> Tables of what a user may choose from: kernels, schemes, arrangements, integrators.
!>
!> One table per kind of thing serves the check of the input, the help texts and the documentation.
module calor_choice
  use calor_text, only: text_t
  implicit none (type, external)
  private

  public :: choice_t, choice_names

  !> One thing a user may choose by name
  type :: choice_t
    !> The name in a scene file
    character(len=32) :: name = ''
    !> What it is and what it is good for, in one line
    character(len=160) :: summary = ''
    !> What it computes, what it costs, and where that is from; for `calor schemes`
    character(len=160) :: formula = '', cost = '', reference = ''
  end type choice_t

contains

  !> The names in a table of choices.
  pure function choice_names(choices) result(names)
    !> The table
    type(choice_t), intent(in) :: choices(:)
    type(text_t) :: names(size(choices))
    integer :: k

    do k = 1, size(choices)
      names(k)%value = trim(choices(k)%name)
    end do
  end function choice_names

end module calor_choice
