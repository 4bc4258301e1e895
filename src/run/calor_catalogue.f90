!> What there is to choose from, each with what it is for, what it costs, its formula and its
!> source: `calor schemes` and `calor effects`. All of it comes from the tables of the things.
module calor_catalogue
  use calor_choice, only: choice_t, choice_names
  use calor_effect, only: effect_t, effect_slot_t
  use calor_effects, only: known_effects
  use calor_error, only: error_t, raise, status_bad_input
  use calor_gradient_schemes, only: gradient_choices
  use calor_integrators, only: integrator_choices
  use calor_kernels, only: kernel_choices
  use calor_laplacian_schemes, only: laplacian_choices
  use calor_text, only: text_t, append, suggestion
  implicit none (type, external)
  private

  public :: describe_schemes, describe_effects, scheme_names, effect_names

contains

  !> All schemes, or all about those of one name.
  subroutine describe_schemes(name, lines, error)
    !> The name, '' for a list
    character(len=*), intent(in) :: name
    !> What there is to say
    type(text_t), allocatable, intent(out) :: lines(:)
    !> There is none of that name
    type(error_t), allocatable, intent(out) :: error

    call add_table(lines, 'Laplacian (&scheme laplacian)', laplacian_choices, name)
    call add_table(lines, 'Gradient (&scheme gradient)', gradient_choices, name)
    call add_table(lines, 'Kernel (&kernel name)', kernel_choices, name)
    call add_table(lines, 'Time integrator (&time method)', integrator_choices, name)
    if (.not. allocated(lines)) then
      call raise(error, status_bad_input, 'There is no scheme '''//name//'''.'// &
                 suggestion(name, scheme_names())//' calor schemes lists them.')
    else if (name == '') then
      call append(lines, 'More about one of them: calor schemes NAME')
    end if
  end subroutine describe_schemes

  !> All effects, or all about one.
  subroutine describe_effects(name, lines, error)
    !> The name, '' for a list
    character(len=*), intent(in) :: name
    !> What there is to say
    type(text_t), allocatable, intent(out) :: lines(:)
    !> There is none of that name
    type(error_t), allocatable, intent(out) :: error
    type(effect_slot_t), allocatable :: table(:)
    character(len=:), allocatable :: call_text
    integer :: k

    call known_effects(table)
    do k = 1, size(table)
      associate (effect => table(k)%effect)
        if (name /= '' .and. name /= effect%name) cycle
        call_text = '&'//trim(effect%group)
        if (effect%key /= '') call_text = call_text//' '//trim(effect%key)
        if (effect%value /= '') call_text = call_text//' = '''//trim(effect%value)//''''
        if (name == '') then
          call append(lines, '  '//effect%name//trim(effect%summary)//' ('//call_text//')')
        else
          call append(lines, trim(effect%name)//': '//trim(effect%summary))
          call append(lines, '  in a scene  '//call_text)
          call add_details(lines, effect%formula, effect%cost, effect%reference)
        end if
      end associate
    end do
    if (.not. allocated(lines)) then
      call raise(error, status_bad_input, 'There is no effect '''//name//'''.'// &
                 suggestion(name, effect_names())//' calor effects lists them.')
    else if (name == '') then
      call append(lines, '')
      call append(lines, 'What a scene does not call for costs nothing. More about one of '// &
                  'them: calor effects NAME')
    end if
  end subroutine describe_effects

  !> The names of all schemes, those of several tables once.
  function scheme_names() result(names)
    type(text_t), allocatable :: names(:)

    call add_names(choice_names(laplacian_choices))
    call add_names(choice_names(gradient_choices))
    call add_names(choice_names(kernel_choices))
    call add_names(choice_names(integrator_choices))

  contains

    subroutine add_names(more)
      type(text_t), intent(in) :: more(:)
      integer :: k, j

      do k = 1, size(more)
        if (allocated(names)) then
          do j = 1, size(names)
            if (names(j)%value == more(k)%value) exit
          end do
          if (j <= size(names)) cycle
        end if
        call append(names, more(k)%value)
      end do
    end subroutine add_names

  end function scheme_names

  !> The names of all effects.
  function effect_names() result(names)
    type(text_t), allocatable :: names(:)
    type(effect_slot_t), allocatable :: table(:)
    integer :: k

    call known_effects(table)
    do k = 1, size(table)
      call append(names, trim(table(k)%effect%name))
    end do
  end function effect_names

  subroutine add_table(lines, heading, table, name)
    type(text_t), allocatable, intent(inout) :: lines(:)
    character(len=*), intent(in) :: heading
    type(choice_t), intent(in) :: table(:)
    character(len=*), intent(in) :: name
    integer :: k

    if (name == '') call append(lines, heading)
    do k = 1, size(table)
      if (name == '') then
        call append(lines, '  '//table(k)%name(1:26)//trim(table(k)%summary))
      else if (table(k)%name == name) then
        call append(lines, heading//': '//trim(table(k)%name))
        call append(lines, '  '//trim(table(k)%summary))
        call add_details(lines, table(k)%formula, table(k)%cost, table(k)%reference)
      end if
    end do
    if (name == '') call append(lines, '')
  end subroutine add_table

  subroutine add_details(lines, formula, cost, reference)
    type(text_t), allocatable, intent(inout) :: lines(:)
    character(len=*), intent(in) :: formula, cost, reference

    call append(lines, '  formula     '//trim(formula))
    call append(lines, '  cost        '//trim(cost))
    call append(lines, '  source      '//trim(reference))
  end subroutine add_details

end module calor_catalogue
