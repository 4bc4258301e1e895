!> The output file of a run, in two copies, so that the one in its place is whole at every moment.
!>
!> HDF5 changes a file in many places for each step that is added: a program that is killed in the
!> middle of that leaves a file that may not open. So a step is added to the copy beside first; then
!> the two copies change names, which the system does at once; and the step is added to the other
!> one. What is read under the target's name is a whole file with all steps that were written, and
!> nothing is copied. It costs the writing and the room twice, until the end: then the copy beside
!> gets what is known only then, takes the place, and the other is gone.
!>
!> A file system that knows no second names of a file cannot do that: there one copy is written in
!> its place.
!>
!>     call file%create('plate.vtkhdf', x, y, moving, error)
!>     call file%add_static('volume', volume, error)
!>     call file%write_state(state, error)
!>     call file%publish(error)
!>     ...
!>     call file%begin_closing()
!>     call file%set_attribute('relative_l2_error', 1.0e-3_wp, error)
!>     call file%close(error)
module calor_twin_file
  use calor_error, only: error_t
  use calor_field_file, only: field_file_t
  use calor_kinds, only: wp
  use calor_text, only: text_t
  implicit none (type, external)
  private

  public :: twin_file_t, field_state_t

  !> One state: what a step of the file consists of
  type :: field_state_t
    !> s
    real(wp) :: time = 0.0_wp
    !> Places, m; allocated where particles move
    real(wp), allocatable :: x(:), y(:)
    !> Names of the fields and their values, a column each
    type(text_t), allocatable :: name(:)
    real(wp), allocatable :: value(:, :)
  contains
    !> Add a field
    procedure :: add
  end type field_state_t

  !> The two copies, from `create` to `close` or `discard`
  type :: twin_file_t
    !> For what is written before the first state
    type(field_file_t) :: copy(2)
    !> Which of them is in its place; 0: none is yet
    integer, private :: front = 0
    !> Whether there are two, and whether states are over
    logical, private :: paired = .true., closing = .false.
  contains
    !> Begin a file with its particles
    procedure :: create
    !> Add a field that is the same in every state
    procedure :: add_static
    !> Set an attribute: a text, texts or a number
    generic :: set_attribute => set_text, set_texts, set_real
    !> Add a state
    procedure :: write_state
    !> Put the file in its place; writing goes on
    procedure :: publish
    !> No state comes any more, only attributes and series
    procedure :: begin_closing
    !> Set the time that a phase of the run took
    procedure :: set_wall_time
    !> Write a list of numbers beside the fields
    procedure :: write_series
    !> Complete the file, put it in its place and let go of it
    procedure :: close => close_file
    !> Let go of it; what is in its place stays
    procedure :: discard
    procedure, private :: set_text, set_texts, set_real
    procedure, private :: first, last
  end type twin_file_t

  !> What the second copy is called until it takes the place, beside the first one's name
  character(len=*), parameter :: second_suffix = '.twin'

contains

  subroutine add(this, name, values)
    class(field_state_t), intent(inout) :: this
    !> Its name
    character(len=*), intent(in) :: name
    !> One value for each particle
    real(wp), intent(in) :: values(:)
    real(wp), allocatable :: wider(:, :)
    integer :: k

    if (.not. allocated(this%name)) then
      allocate (this%name(0), this%value(size(values), 0))
    end if
    allocate (wider(size(values), size(this%name) + 1))
    do k = 1, size(this%name)
      wider(:, k) = this%value(:, k)
    end do
    wider(:, size(wider, 2)) = values
    call move_alloc(wider, this%value)
    this%name = [this%name, text_t(name)]
  end subroutine add

  subroutine create(this, path, x, y, moving, error)
    class(twin_file_t), intent(inout) :: this
    !> The name of the file; its folder must exist
    character(len=*), intent(in) :: path
    !> Coordinates of the particles, m
    real(wp), intent(in) :: x(:), y(:)
    !> Whether states have places of their own
    logical, intent(in) :: moving
    !> Why the file cannot be written
    type(error_t), allocatable, intent(out) :: error

    call this%copy(1)%create(path, x, y, error, moving=moving)
    if (allocated(error)) return
    call this%copy(2)%create(path, x, y, error, moving=moving, suffix=second_suffix)
    if (allocated(error)) call this%copy(1)%discard()
  end subroutine create

  !> The copies that attributes go into: both, or, when states are over, the one that will stay
  pure function first(this) result(number)
    class(twin_file_t), intent(in) :: this
    integer :: number

    number = 1
    if (.not. this%paired) number = this%front
    if (this%paired .and. this%closing .and. this%front == 1) number = 2
  end function first

  pure function last(this) result(number)
    class(twin_file_t), intent(in) :: this
    integer :: number

    number = this%first()
    if (this%paired .and. .not. this%closing) number = 2
  end function last

  subroutine add_static(this, name, values, error)
    class(twin_file_t), intent(inout) :: this
    !> Its name
    character(len=*), intent(in) :: name
    !> One value for each particle
    real(wp), intent(in), contiguous :: values(:)
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    do k = this%first(), this%last()
      call this%copy(k)%add_static(name, values, error)
      if (allocated(error)) return
    end do
  end subroutine add_static

  subroutine set_text(this, name, value, error)
    class(twin_file_t), intent(inout) :: this
    !> Name of the attribute, and its value
    character(len=*), intent(in) :: name, value
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    do k = this%first(), this%last()
      call this%copy(k)%set_attribute(name, value, error)
      if (allocated(error)) return
    end do
  end subroutine set_text

  subroutine set_texts(this, name, values, error)
    class(twin_file_t), intent(inout) :: this
    !> Name of the attribute, and its values
    character(len=*), intent(in) :: name
    type(text_t), intent(in) :: values(:)
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    do k = this%first(), this%last()
      call this%copy(k)%set_attribute(name, values, error)
      if (allocated(error)) return
    end do
  end subroutine set_texts

  subroutine set_real(this, name, value, error)
    class(twin_file_t), intent(inout) :: this
    !> Name of the attribute, and its value
    character(len=*), intent(in) :: name
    real(wp), intent(in) :: value
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    do k = this%first(), this%last()
      call this%copy(k)%set_attribute(name, value, error)
      if (allocated(error)) return
    end do
  end subroutine set_real

  !> Add a state. When this returns it is in the file under the target's name, if that is published.
  subroutine write_state(this, state, error)
    class(twin_file_t), intent(inout) :: this
    !> The state
    type(field_state_t), intent(in) :: state
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    logical :: exchanged

    if (this%front == 0) then
      call put_state(this%copy(1), state, error)
      if (.not. allocated(error)) call put_state(this%copy(2), state, error)
    else if (.not. this%paired) then
      call put_state(this%copy(this%front), state, error)
    else
      associate (front => this%copy(this%front), back => this%copy(3 - this%front))
        call put_state(back, state, error)
        if (allocated(error)) return
        call back%exchange_with(front, exchanged, error)
        if (allocated(error)) return
        if (.not. exchanged) then
          call back%discard()
          this%paired = .false.
        end if
        call put_state(front, state, error)
      end associate
      if (this%paired) this%front = 3 - this%front
    end if
  end subroutine write_state

  subroutine put_state(file, state, error)
    type(field_file_t), intent(inout) :: file
    type(field_state_t), intent(in) :: state
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    call file%begin_step(state%time, error)
    if (allocated(error)) return
    if (allocated(state%x)) call file%write_places(state%x, state%y, error)
    if (allocated(error)) return
    do k = 1, size(state%name)
      call file%write_field(state%name(k)%value, state%value(:, k), error)
      if (allocated(error)) return
    end do
    call file%flush(error)
  end subroutine put_state

  subroutine publish(this, error)
    class(twin_file_t), intent(inout) :: this
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error

    if (this%front /= 0) return
    call this%copy(1)%publish(error)
    if (.not. allocated(error)) this%front = 1
  end subroutine publish

  subroutine begin_closing(this)
    class(twin_file_t), intent(inout) :: this

    this%closing = .true.
  end subroutine begin_closing

  subroutine set_wall_time(this, phase, seconds, error)
    class(twin_file_t), intent(inout) :: this
    !> The name of the phase
    character(len=*), intent(in) :: phase
    !> The time, s
    real(wp), intent(in) :: seconds
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    do k = this%first(), this%last()
      call this%copy(k)%set_wall_time(phase, seconds, error)
      if (allocated(error)) return
    end do
  end subroutine set_wall_time

  subroutine write_series(this, name, values, error)
    class(twin_file_t), intent(inout) :: this
    !> The name of the data set
    character(len=*), intent(in) :: name
    !> The numbers
    real(wp), intent(in), contiguous :: values(:)
    !> Why that failed
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    do k = this%first(), this%last()
      call this%copy(k)%write_series(name, values, error)
      if (allocated(error)) return
    end do
  end subroutine write_series

  subroutine close_file(this, error)
    class(twin_file_t), intent(inout) :: this
    !> Why the file is not complete; one that is in its place stays
    type(error_t), allocatable, intent(out) :: error

    call this%begin_closing()
    call this%copy(this%first())%close(error)
    call this%discard()
  end subroutine close_file

  subroutine discard(this)
    class(twin_file_t), intent(inout) :: this
    integer :: k

    do k = 1, 2
      call this%copy(k)%discard()
    end do
  end subroutine discard

end module calor_twin_file
