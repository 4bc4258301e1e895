!> A commented scene to start from.
module calor_new_scene
  use calor_error, only: error_t, raise, status_bad_input, status_bad_file
  implicit none (type, external)
  private

  public :: write_new_scene

  !> The scene, with @ for its name
  character(len=92), parameter :: template(*) = [character(len=92) :: &
      '! A scene for calor: calor check says what it simulates, calor run does it.', &
      '! Groups may come in any order. SI units.', &
      '', &
      '&scene     title = ''@''', &
      '           ! The true temperature, if you know it: the run then reports its error', &
      '           exact_expression = ''sin(pi*x)*sin(pi*y)*exp(-2*pi^2*t)'' /', &
      '', &
      '&domain    shape = ''rectangle''      ! or ''cloud'' with file = ''particles.csv''', &
      '           x_range = 0.0, 1.0       ! m', &
      '           y_range = 0.0, 1.0', &
      '           spacing = 0.025          ! between neighbouring particles, m', &
      '           arrangement = ''jittered'' ! or lattice, hexagonal', &
      '           jitter = 0.2             ! displacement in units of the spacing', &
      '           seed = 1 /', &
      '', &
      '&kernel    name = ''wendland_c2''     ! or cubic_spline, quintic_spline, wendland_c4, _c6', &
      '           support = 2.1 /          ! support radius in units of the spacing', &
      '', &
      '&scheme    laplacian = ''fatehi_manzari'' / ! or positive, brookshaw, ...', &
      '', &
      '&material  conductivity = 1.0       ! W/(m K)', &
      '           density = 1.0            ! kg/m3', &
      '           heat_capacity = 1.0 /    ! J/(kg K)', &
      '', &
      '&initial   temperature_expression = ''sin(pi*x)*sin(pi*y)'' /', &
      '', &
      '&boundary  on = ''all''               ! or left, right, bottom, top; may be repeated', &
      '           kind = ''temperature''     ! held at a value or value_expression of x, y, t', &
      '           value = 0.0 /', &
      '', &
      '&time      end = 0.05               ! s', &
      '           method = ''auto''          ! or rkl2, tr_bdf2, exponential, …', &
      '           tolerance = 1.0e-6 /     ! error of a step over the temperature range', &
      '', &
      '&output    file = ''@.vtkhdf''      ! opens in ParaView', &
      '           every = 0.01             ! s', &
      '           fields = ''temperature'' / ! and error, exact where the truth is known' &
      ]

contains

  !> Write a scene of a small plate, with every key explained, into a new file.
  subroutine write_new_scene(name, path, error)
    !> Name of the scene, with or without the ending .nml
    character(len=*), intent(in) :: name
    !> The file written
    character(len=:), allocatable, intent(out) :: path
    !> The name is empty, there is such a file already, or it cannot be written
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: stem
    character(len=200) :: reason
    integer :: unit, status, k
    logical :: exists

    stem = name
    if (len(name) > 4) then
      if (name(len(name) - 3:) == '.nml') stem = name(:len(name) - 4)
    end if
    path = stem//'.nml'
    stem = stem(index(stem, '/', back=.true.) + 1:)
    if (stem == '') then
      call raise(error, status_bad_input, 'A scene needs a name, as in ''calor new a'', but '''// &
                 name//''' has none.')
      return
    end if
    inquire (file=path, exist=exists)
    if (exists) then
      call raise(error, status_bad_input, 'The file '//path// &
                 ' is there already: choose another name, or move it away.')
      return
    end if
    reason = ''
    open (newunit=unit, file=path, status='new', action='write', iostat=status, iomsg=reason)
    do k = 1, size(template)
      if (status /= 0) exit
      write (unit, '(a)', iostat=status, iomsg=reason) filled(template(k), in_quotes(stem))
    end do
    if (status == 0) close (unit, iostat=status, iomsg=reason)
    if (status == 0) return
    call raise(error, status_bad_file, 'The file '//path//' cannot be written: '//trim(reason))
  end subroutine write_new_scene

  !> A word as it stands between quotes: each quote in it twice.
  pure function in_quotes(word) result(text)
    character(len=*), intent(in) :: word
    character(len=:), allocatable :: text
    integer :: k

    text = ''
    do k = 1, len(word)
      text = text//word(k:k)
      if (word(k:k) == '''') text = text//''''
    end do
  end function in_quotes

  !> A line with @ replaced by a word.
  pure function filled(line, word) result(text)
    character(len=*), intent(in) :: line, word
    character(len=:), allocatable :: text
    integer :: mark

    text = trim(line)
    mark = index(text, '@')
    if (mark > 0) text = text(:mark - 1)//word//text(mark + 1:)
  end function filled

end module calor_new_scene
