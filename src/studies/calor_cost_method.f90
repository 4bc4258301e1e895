!> A way to discretise the Laplacian, as `calor cost` compares it: scheme, order, support.
module calor_cost_method
  use calor_kinds, only: wp
  use calor_laplacian_schemes, only: laplacian_choices, usual_support
  use calor_scene, only: scene_t
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: cost_method_t, cost_methods

  type :: cost_method_t
    !> Name of the scheme
    character(len=:), allocatable :: laplacian
    !> Its order; 0: it has but one
    integer :: order = 0
    !> Support radius in spacings; 0: the scheme chooses it
    real(wp) :: support = 0.0_wp
  contains
    !> Put it into a scene
    procedure :: apply
    !> In words for those who know the schemes: 'fatehi_manzari (h = 2.1 Δ)'
    procedure :: name => method_name
    !> In words for those who do not: 'the paper's new scheme: fatehi_manzari (h = 2.1 Δ)'
    procedure :: title
    !> Without what does not tell it from others
    procedure :: told_apart
  end type cost_method_t

contains

  !> The methods that a scene asks to compare, in its order. A scheme of several orders comes once
  !> for each, with the support that suits the order; other schemes come once for each support.
  function cost_methods(scene) result(methods)
    !> The scene
    type(scene_t), intent(in) :: scene
    type(cost_method_t), allocatable :: methods(:)
    integer :: k, j, number

    associate (asked => scene%cost)
      allocate (methods(size(asked%laplacians)*max(size(asked%orders), size(asked%supports), 1)))
      number = 0
      do k = 1, size(asked%laplacians)
        associate (name => asked%laplacians(k)%value)
          if (name == 'consistent') then
            do j = 1, size(asked%orders)
              call add(name, asked%orders(j), usual_support(name, asked%orders(j)))
            end do
          else if (size(asked%supports) > 0) then
            do j = 1, size(asked%supports)
              call add(name, 0, asked%supports(j))
            end do
          else if (scene%laplacian == 'consistent') then
            ! The scene's own support suits an order that these schemes do not have.
            call add(name, 0, usual_support(name, 0))
          else
            call add(name, 0, scene%support)
          end if
        end associate
      end do
    end associate
    methods = methods(:number)

  contains

    subroutine add(laplacian, order, support)
      character(len=*), intent(in) :: laplacian
      integer, intent(in) :: order
      real(wp), intent(in) :: support

      number = number + 1
      methods(number)%laplacian = laplacian
      methods(number)%order = order
      methods(number)%support = support
    end subroutine add

  end function cost_methods

  pure subroutine apply(this, scene)
    class(cost_method_t), intent(in) :: this
    !> The scene that shall use it
    type(scene_t), intent(inout) :: scene

    scene%laplacian = this%laplacian
    if (this%order > 0) scene%order = this%order
    if (this%support > 0) scene%support = this%support
  end subroutine apply

  pure function method_name(this) result(text)
    class(cost_method_t), intent(in) :: this
    character(len=:), allocatable :: text

    text = this%laplacian
    if (this%order > 0) text = text//' of order '//to_text(this%order)
    if (this%support > 0) text = text//' (h = '//to_text(this%support, digits=3)//' Δ)'
  end function method_name

  pure function title(this) result(text)
    class(cost_method_t), intent(in) :: this
    character(len=:), allocatable :: text
    integer :: k

    text = this%name()
    if (this%order > 0) return
    do k = 1, size(laplacian_choices)
      if (laplacian_choices(k)%name /= this%laplacian) cycle
      ! What a summary says before the first semicolon is what the scheme is.
      text = laplacian_choices(k)%summary(:index(laplacian_choices(k)%summary, ';') - 1)// &
             ': '//text
    end do
  end function title

  !> The method without its support where all methods of this scheme and order have the same.
  pure function told_apart(this, others) result(short)
    class(cost_method_t), intent(in) :: this
    !> All methods that are spoken of
    type(cost_method_t), intent(in) :: others(:)
    type(cost_method_t) :: short
    integer :: k

    short = this
    do k = 1, size(others)
      if (others(k)%laplacian /= this%laplacian .or. others(k)%order /= this%order) cycle
      if (abs(others(k)%support - this%support) > 0) return
    end do
    short%support = 0
  end function told_apart

end module calor_cost_method
