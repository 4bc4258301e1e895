!> A way to discretise the Laplacian, as `calor cost` compares it: scheme, order, support.
module calor_cost_method
  use calor_kinds, only: wp
  use calor_laplacian_schemes, only: laplacian_choices
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

  !> The methods that a scene asks to compare, in its order.
  pure function cost_methods(scene) result(methods)
    !> The scene
    type(scene_t), intent(in) :: scene
    type(cost_method_t), allocatable :: methods(:)
    real(wp), allocatable :: supports(:)
    integer :: k, j

    supports = scene%cost%supports
    if (size(supports) == 0) supports = [scene%support]
    associate (laplacians => scene%cost%laplacians)
      allocate (methods(size(laplacians)*size(supports)))
      do k = 1, size(laplacians)
        do j = 1, size(supports)
          associate (method => methods((k - 1)*size(supports) + j))
            method%laplacian = laplacians(k)%value
            method%support = supports(j)
          end associate
        end do
      end do
    end associate
  end function cost_methods

  pure subroutine apply(this, scene)
    class(cost_method_t), intent(in) :: this
    !> The scene that shall use it
    type(scene_t), intent(inout) :: scene

    scene%laplacian = this%laplacian
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
