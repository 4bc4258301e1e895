!> A table in comma-separated values, as calor's studies write them.
module calor_csv_table
  use calor_error, only: error_t, raise, status_bad_input, status_bad_file
  use calor_kinds, only: wp
  use calor_text, only: text_t, to_text, append
  implicit none (type, external)
  private

  public :: csv_table_t

  !> Lines of cells under a line of names
  type :: csv_table_t
    !> The file
    character(len=:), allocatable :: path
    !> Names of the columns
    type(text_t), allocatable :: name(:)
    !> By column and line
    type(text_t), allocatable :: cell(:, :)
  contains
    !> Read a file
    procedure :: read => read_table
    !> Whether all of some columns are there
    procedure :: has
    !> A cell by its column's name
    procedure :: text
    !> A cell as a number
    procedure :: number
    !> How many lines there are
    procedure :: lines
  end type csv_table_t

contains

  subroutine read_table(this, path, error)
    class(csv_table_t), intent(out) :: this
    !> The file
    character(len=*), intent(in) :: path
    !> It cannot be read, is empty, or a line has more or fewer cells than the first
    type(error_t), allocatable, intent(out) :: error
    character(len=*), parameter :: line_feed = achar(10)
    character(len=:), allocatable :: content
    type(text_t), allocatable :: line(:), cells(:)
    character(len=200) :: message
    integer :: unit, status, bytes, start, finish, k

    this%path = path
    message = ''
    bytes = 0
    open (newunit=unit, file=path, access='stream', form='unformatted', status='old', &
          action='read', iostat=status, iomsg=message)
    if (status == 0) then
      inquire (unit=unit, size=bytes)
      allocate (character(len=max(0, bytes)) :: content)
      if (bytes > 0) read (unit, iostat=status, iomsg=message) content
      close (unit)
    end if
    if (status /= 0) then
      call raise(error, status_bad_file, 'The file '''//path//''' cannot be read: '// &
                 trim(message)//'.')
      return
    end if
    allocate (line(0))
    start = 1
    do while (start <= len(content))
      finish = index(content(start:), line_feed)
      if (finish == 0) finish = len(content) - start + 2
      if (content(start:start + finish - 2) /= '') call append(line, content(start:start + finish &
                                                                                - 2))
      start = start + finish
    end do
    if (size(line) == 0) then
      call raise(error, status_bad_input, 'The file '''//path//''' is empty.')
      return
    end if
    call split(line(1)%value, this%name)
    allocate (this%cell(size(this%name), size(line) - 1))
    do k = 2, size(line)
      call split(line(k)%value, cells)
      if (size(cells) /= size(this%name)) then
        call raise(error, status_bad_input, 'The file '''//path//''', line '//to_text(k)// &
                   ', has '//to_text(size(cells))//' values, but the first line names '// &
                   to_text(size(this%name))//' columns.')
        return
      end if
      this%cell(:, k - 1) = cells
    end do
  end subroutine read_table

  !> The cells of a line, without the quotes around them
  pure subroutine split(line, cells)
    character(len=*), intent(in) :: line
    type(text_t), allocatable, intent(out) :: cells(:)
    character(len=:), allocatable :: cell
    logical :: quoted
    integer :: k

    quoted = .false.
    cell = ''
    do k = 1, len(line)
      if (line(k:k) == '"') then
        quoted = .not. quoted
      else if (line(k:k) == ',' .and. .not. quoted) then
        call append(cells, trim(cell))
        cell = ''
      else if (line(k:k) /= achar(13)) then
        cell = cell//line(k:k)
      end if
    end do
    call append(cells, trim(cell))
  end subroutine split

  pure function has(this, names) result(answer)
    class(csv_table_t), intent(in) :: this
    !> Names of columns, padded with blanks
    character(len=*), intent(in) :: names(:)
    logical :: answer
    integer :: k

    answer = .true.
    do k = 1, size(names)
      answer = answer .and. place(this, trim(names(k))) > 0
    end do
  end function has

  pure function text(this, name, line) result(cell)
    class(csv_table_t), intent(in) :: this
    !> A column that is there
    character(len=*), intent(in) :: name
    !> A line, counted from 1 below that of the names
    integer, intent(in) :: line
    character(len=:), allocatable :: cell

    cell = this%cell(place(this, name), line)%value
  end function text

  !> 0 for an empty cell.
  subroutine number(this, name, line, value, error)
    class(csv_table_t), intent(in) :: this
    !> A column that is there
    character(len=*), intent(in) :: name
    !> A line, counted from 1 below that of the names
    integer, intent(in) :: line
    !> The number
    real(wp), intent(out) :: value
    !> The cell holds none; an error that is there already stays
    type(error_t), allocatable, intent(inout) :: error
    integer :: status

    value = 0
    if (allocated(error) .or. this%text(name, line) == '') return
    read (this%cell(place(this, name), line)%value, *, iostat=status) value
    if (status == 0) return
    call raise(error, status_bad_input, 'The file '''//this%path//''', line '// &
               to_text(line + 1)//': '//name//' = '''//this%text(name, line)//''' is no number.')
  end subroutine number

  pure function lines(this) result(count)
    class(csv_table_t), intent(in) :: this
    integer :: count

    count = size(this%cell, 2)
  end function lines

  pure function place(this, name)
    type(csv_table_t), intent(in) :: this
    character(len=*), intent(in) :: name
    integer :: place

    do place = size(this%name), 1, -1
      if (this%name(place)%value == name) return
    end do
  end function place

end module calor_csv_table
