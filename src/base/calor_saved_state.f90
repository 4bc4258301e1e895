!> The state of something that can be laid aside and taken up again: named numbers and texts.
!>
!> Whatever has a state of its own saves it by `put` and restores it by `get`, under names of its
!> own in the group that its owner has entered:
!>
!>     call state%enter('stepper')
!>     call state%put('steps', this%steps)
!>     call state%leave()
!>
!> What cannot be had by `get` stays as it is, and the first such failure is kept in `problem`, so
!> that only whoever restores the whole has to look.
module calor_saved_state
  use calor_kinds, only: wp
  implicit none (type, external)
  private

  public :: saved_state_t, saved_item_t

  !> A named list of numbers, or a text: one of the three is allocated
  type :: saved_item_t
    !> Groups and name, parted by '/'
    character(len=:), allocatable :: name
    real(wp), allocatable :: reals(:)
    integer, allocatable :: integers(:)
    character(len=:), allocatable :: text
  end type saved_item_t

  type :: saved_state_t
    !> The items; those beyond `items` are empty
    type(saved_item_t), allocatable :: item(:)
    integer :: items = 0
    !> Why the first item could not be had; not allocated: all could
    character(len=:), allocatable :: problem
    !> The groups entered, each followed by '/'
    character(len=:), allocatable, private :: group
  contains
    !> Names that follow are those of a group
    procedure :: enter
    !> Back to the group around
    procedure :: leave
    !> Save a number, an array, a truth value or a text
    generic :: put => put_real, put_reals, put_integer, put_integers, put_logical, put_text
    !> Take it back; arrays get the length that was saved
    generic :: get => get_real, get_reals, get_integer, get_integers, get_logical, get_text
    !> Whether there is something of a name
    procedure :: has
    procedure, private :: put_real, put_reals, put_integer, put_integers, put_logical, put_text
    procedure, private :: get_real, get_reals, get_integer, get_integers, get_logical, get_text
    procedure, private :: add_item, find, complain
  end type saved_state_t

contains

  pure subroutine enter(this, name)
    class(saved_state_t), intent(inout) :: this
    !> Name of the group
    character(len=*), intent(in) :: name

    if (.not. allocated(this%group)) this%group = ''
    this%group = this%group//name//'/'
  end subroutine enter

  pure subroutine leave(this)
    class(saved_state_t), intent(inout) :: this

    this%group = this%group(:index(this%group(:len(this%group) - 1), '/', back=.true.))
  end subroutine leave

  !> A new item at the end of the list.
  subroutine add_item(this, name)
    class(saved_state_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    type(saved_item_t), allocatable :: longer(:)
    integer :: k

    if (.not. allocated(this%item)) allocate (this%item(64))
    if (this%items == size(this%item)) then
      allocate (longer(2*this%items))
      do k = 1, this%items
        call move_alloc(this%item(k)%name, longer(k)%name)
        call move_alloc(this%item(k)%reals, longer(k)%reals)
        call move_alloc(this%item(k)%integers, longer(k)%integers)
        call move_alloc(this%item(k)%text, longer(k)%text)
      end do
      call move_alloc(longer, this%item)
    end if
    this%items = this%items + 1
    if (allocated(this%group)) then
      this%item(this%items)%name = this%group//name
    else
      this%item(this%items)%name = name
    end if
  end subroutine add_item

  subroutine put_real(this, name, value)
    class(saved_state_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    real(wp), intent(in) :: value

    call this%put_reals(name, [value])
  end subroutine put_real

  subroutine put_reals(this, name, values)
    class(saved_state_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    real(wp), intent(in) :: values(:)

    call this%add_item(name)
    allocate (this%item(this%items)%reals(size(values)))
    this%item(this%items)%reals(:) = values
  end subroutine put_reals

  subroutine put_integer(this, name, value)
    class(saved_state_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    integer, intent(in) :: value

    call this%put_integers(name, [value])
  end subroutine put_integer

  subroutine put_integers(this, name, values)
    class(saved_state_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    integer, intent(in) :: values(:)

    call this%add_item(name)
    allocate (this%item(this%items)%integers(size(values)))
    this%item(this%items)%integers(:) = values
  end subroutine put_integers

  subroutine put_logical(this, name, value)
    class(saved_state_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    logical, intent(in) :: value

    call this%put_integers(name, [merge(1, 0, value)])
  end subroutine put_logical

  subroutine put_text(this, name, value)
    class(saved_state_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    character(len=*), intent(in) :: value

    call this%add_item(name)
    this%item(this%items)%text = value
  end subroutine put_text

  subroutine get_real(this, name, value)
    class(saved_state_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    real(wp), intent(inout) :: value
    real(wp), allocatable :: values(:)

    call this%get_reals(name, values)
    if (.not. allocated(values)) return
    if (size(values) == 1) then
      value = values(1)
    else
      call this%complain(name)
    end if
  end subroutine get_real

  subroutine get_reals(this, name, values)
    class(saved_state_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    real(wp), allocatable, intent(inout) :: values(:)
    integer :: place

    place = this%find(name)
    if (place > 0) then
      if (allocated(this%item(place)%reals)) then
        values = this%item(place)%reals
        return
      end if
    end if
    call this%complain(name)
  end subroutine get_reals

  subroutine get_integer(this, name, value)
    class(saved_state_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    integer, intent(inout) :: value
    integer, allocatable :: values(:)

    call this%get_integers(name, values)
    if (.not. allocated(values)) return
    if (size(values) == 1) then
      value = values(1)
    else
      call this%complain(name)
    end if
  end subroutine get_integer

  subroutine get_integers(this, name, values)
    class(saved_state_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    integer, allocatable, intent(inout) :: values(:)
    integer :: place

    place = this%find(name)
    if (place > 0) then
      if (allocated(this%item(place)%integers)) then
        values = this%item(place)%integers
        return
      end if
    end if
    call this%complain(name)
  end subroutine get_integers

  subroutine get_logical(this, name, value)
    class(saved_state_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    logical, intent(inout) :: value
    integer :: number

    number = merge(1, 0, value)
    call this%get_integer(name, number)
    value = number /= 0
  end subroutine get_logical

  subroutine get_text(this, name, value)
    class(saved_state_t), intent(inout) :: this
    character(len=*), intent(in) :: name
    character(len=:), allocatable, intent(inout) :: value
    integer :: place

    place = this%find(name)
    if (place > 0) then
      if (allocated(this%item(place)%text)) then
        value = this%item(place)%text
        return
      end if
    end if
    call this%complain(name)
  end subroutine get_text

  pure function has(this, name)
    class(saved_state_t), intent(in) :: this
    character(len=*), intent(in) :: name
    logical :: has

    has = this%find(name) > 0
  end function has

  !> The place of an item, 0 if there is none.
  pure function find(this, name) result(place)
    class(saved_state_t), intent(in) :: this
    character(len=*), intent(in) :: name
    integer :: place
    character(len=:), allocatable :: whole

    whole = name
    if (allocated(this%group)) whole = this%group//name
    do place = this%items, 1, -1
      if (this%item(place)%name == whole) return
    end do
  end function find

  subroutine complain(this, name)
    class(saved_state_t), intent(inout) :: this
    character(len=*), intent(in) :: name

    if (allocated(this%problem)) return
    this%problem = name
    if (allocated(this%group)) this%problem = this%group//name
  end subroutine complain

end module calor_saved_state
