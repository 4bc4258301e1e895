!> `calor plot`: the natural picture of any file that calor writes.
module calor_plot
  use calor_convergence_files, only: draw_convergence
  use calor_convergence_schemes, only: study_scheme_t, gradient_family, laplacian_family, &
                                       family_names
  use calor_convergence_study, only: convergence_study_t, measurement_t
  use calor_convergence_theory, only: fixed_ratio, fixed_spacing, regular_cloud, &
                                      irregular_cloud, way_names
  use calor_cost_entry, only: cost_entry_t, cost_phases
  use calor_cost_picture, only: cost_picture, picture_width, picture_height
  use calor_csv_table, only: csv_table_t
  use calor_error, only: error_t, raise, status_bad_input, status_bad_file
  use calor_field_file, only: check_place
  use calor_field_pictures, only: draw_stored_fields, endings_t
  use calor_file_system, only: look_at_path, path_missing, path_file, path_folder, &
                               path_unreachable, read_obstacle, resolved_path
  use calor_gnuplot, only: draw_picture
  use calor_kinds, only: wp
  use calor_text, only: text_t, text_list, append
  implicit none (type, external)
  private

  public :: plot_request_t, plot_file

  !> What is asked for
  type :: plot_request_t
    !> The file
    character(len=:), allocatable :: path
    !> A field, or '' for the natural one
    character(len=:), allocatable :: field
    !> A time, s; negative for the last
    real(wp) :: time = -1.0_wp
    !> Whether all times are drawn into a GIF
    logical :: animate = .false.
    !> The name of the picture, with ending or without; '' for one derived from the file's
    character(len=:), allocatable :: output
  end type plot_request_t

  character(len=*), parameter :: what_can_be_drawn = 'calor plot draws the .vtkhdf files of '// &
                                 'calor run and calor operators, and the tables (.csv) of '// &
                                 'calor cost and calor convergence.'

contains

  !> Draw a file: its content decides how.
  subroutine plot_file(request, written, error)
    !> What is asked for
    type(plot_request_t), intent(in) :: request
    !> The files written, each with what it shows
    type(text_t), allocatable, intent(out) :: written(:)
    !> There is no such file, or it is none of calor's; no such field or time; no gnuplot; a picture
    !> cannot be written
    type(error_t), allocatable, intent(out) :: error
    character(len=*), parameter :: hdf5_signature = char(137)//'HDF'//achar(13)//achar(10)// &
                                   achar(26)//achar(10)
    character(len=len(hdf5_signature)) :: start
    type(endings_t) :: files
    type(csv_table_t) :: table
    integer :: unit, status

    allocate (written(0))
    call check_file(request%path, error)
    if (.not. allocated(error)) call name_pictures(request, files, error)
    if (allocated(error)) return
    start = ''
    open (newunit=unit, file=request%path, access='stream', form='unformatted', status='old', &
          action='read', iostat=status)
    if (status == 0) then
      read (unit, iostat=status) start
      close (unit)
    end if
    if (status == 0 .and. start == hdf5_signature) then
      call draw_stored_fields(request%path, request%field, request%time, request%animate, files, &
                              written, error)
      return
    end if
    if (request%path(max(1, len(request%path) - 3):) /= '.csv') then
      call raise(error, status_bad_input, 'The file '''//request%path// &
                 ''' is none of calor''s. '//what_can_be_drawn)
      return
    end if
    if (request%field /= '' .or. request%time >= 0 .or. request%animate) then
      call raise(error, status_bad_input, 'The table '''//request%path//''' has neither fields '// &
                 'nor times: leave out --field, --time and --animate.')
      return
    end if
    call table%read(request%path, error)
    if (allocated(error)) return
    if (table%has([character(len=17) :: 'laplacian', 'order', 'support', 'spacing', &
                  'relative_l2_error', 'threads', 'total_seconds'])) then
      call draw_costs(table, files, written, error)
    else if (table%has([character(len=14) :: 'scheme', 'scheme_order', 'derivative', 'cloud', &
                       'refinement', 'spacing', 'support_radius', 'error', 'rounding', &
                       'field'])) then
      call draw_orders(table, files, written, error)
    else
      call raise(error, status_bad_input, 'The table '''//request%path// &
                 ''' is none of calor''s. '//what_can_be_drawn)
    end if
  end subroutine plot_file

  subroutine check_file(path, error)
    character(len=*), intent(in) :: path
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: reason
    integer :: what

    call look_at_path(path, what, reason)
    select case (what)
    case (path_file)
      reason = read_obstacle(path)
      if (reason /= '') then
        call raise(error, status_bad_file, 'The file '''//path//''' cannot be read: '//reason//'.')
      end if
    case (path_missing)
      call raise(error, status_bad_input, 'There is no file '''//path//''': calor run SCENE '// &
                 'writes the one that its &output names.')
    case (path_folder)
      call raise(error, status_bad_input, ''''//path//''' is a folder: name a file in it.')
    case (path_unreachable)
      call raise(error, status_bad_file, 'The file '''//path//''' cannot be reached: '//reason// &
                 '.')
    case default
      call raise(error, status_bad_input, ''''//path//''' is not a regular file.')
    end select
  end subroutine check_file

  !> The names of the pictures: that which is asked for, or the file's with another ending.
  subroutine name_pictures(request, files, error)
    type(plot_request_t), intent(in) :: request
    type(endings_t), intent(out) :: files
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: ending
    integer :: dot, k

    files%ending = text_list(['.png', '.svg'])
    if (request%animate) files%ending = text_list(['.gif'])
    if (request%output == '') then
      files%stem = request%path
      dot = index(files%stem, '.', back=.true.)
      if (dot > index(files%stem, '/', back=.true.) + 1) files%stem = files%stem(:dot - 1)
      if (request%field /= '' .and. request%field /= 'temperature') then
        files%stem = files%stem//'_'//request%field
      end if
    else
      files%stem = request%output
      ending = ''
      dot = index(files%stem, '.', back=.true.)
      if (dot > index(files%stem, '/', back=.true.) + 1) ending = files%stem(dot:)
      select case (ending)
      case ('.png', '.svg', '.gif')
        if ((ending == '.gif') .neqv. request%animate) then
          call raise(error, status_bad_input, '--output '//request%output//': moving pictures '// &
                     '(--animate) are .gif, others .png or .svg.')
          return
        end if
        files%ending = text_list([ending])
        files%stem = files%stem(:dot - 1)
      case default
        continue
      end select
    end if
    do k = 1, size(files%ending)
      if (resolved_path(files%stem//files%ending(k)%value) == resolved_path(request%path)) then
        call raise(error, status_bad_input, 'The picture would be written over the file '''// &
                   request%path//''' itself: name another one by --output.')
        return
      end if
      call check_place(files%stem//files%ending(k)%value, error)
      if (allocated(error)) return
    end do
  end subroutine name_pictures

  !> The picture of calor cost
  subroutine draw_costs(table, files, written, error)
    type(csv_table_t), intent(in) :: table
    type(endings_t), intent(in) :: files
    type(text_t), allocatable, intent(inout) :: written(:)
    type(error_t), allocatable, intent(out) :: error
    type(cost_entry_t), allocatable :: entries(:)
    real(wp) :: value
    integer :: k, phase, threads

    allocate (entries(table%lines()))
    threads = 1
    do k = 1, table%lines()
      entries(k)%method%laplacian = table%text('laplacian', k)
      call table%number('order', k, value, error)
      entries(k)%method%order = nint(value)
      call table%number('support', k, entries(k)%method%support, error)
      call table%number('spacing', k, entries(k)%spacing, error)
      entries(k)%failure = ''
      if (table%text('total_seconds', k) == '') then
        entries(k)%failure = 'not measured'
        cycle
      end if
      call table%number('relative_l2_error', k, entries(k)%error, error)
      call table%number('threads', k, value, error)
      threads = max(1, nint(value))
      allocate (entries(k)%seconds(size(cost_phases), 1), source=0.0_wp)
      do phase = 1, size(cost_phases)
        if (.not. table%has([trim(cost_phases(phase))//'_seconds'])) cycle
        call table%number(trim(cost_phases(phase))//'_seconds', k, entries(k)%seconds(phase, 1), &
                          error)
      end do
    end do
    if (allocated(error)) return
    if (.not. any([(entries(k)%measured(), k=1, size(entries))])) then
      call raise(error, status_bad_input, 'The table '''//table%path// &
                 ''' holds no measurement: there is nothing to draw.')
      return
    end if
    do k = 1, size(files%ending)
      call draw_picture(files%stem//files%ending(k)%value, picture_width, &
                        picture_height(entries), &
                        cost_picture(entries, table%path, threads=threads), error)
      if (allocated(error)) return
      call append(written, files%stem//files%ending(k)%value//': error against wall time')
    end do
  end subroutine draw_costs

  !> The picture of calor convergence
  subroutine draw_orders(table, files, written, error)
    type(csv_table_t), intent(in) :: table
    type(endings_t), intent(in) :: files
    type(text_t), allocatable, intent(inout) :: written(:)
    type(error_t), allocatable, intent(out) :: error
    type(convergence_study_t) :: study
    integer :: k

    call restore_study(table, study, error)
    if (allocated(error)) return
    do k = 1, size(files%ending)
      call draw_convergence(study, files%stem//files%ending(k)%value, error)
      if (allocated(error)) return
      call append(written, files%stem//files%ending(k)%value//': error against spacing and support')
    end do
  end subroutine draw_orders

  !> A study as far as its picture needs it, from its table
  subroutine restore_study(table, study, error)
    type(csv_table_t), intent(in) :: table
    type(convergence_study_t), intent(out) :: study
    type(error_t), allocatable, intent(out) :: error
    type(study_scheme_t) :: scheme
    type(measurement_t) :: found
    integer :: number(table%lines())
    real(wp) :: value
    integer :: k, m, way, cloud

    allocate (study%schemes(0))
    do k = 1, table%lines()
      scheme%name = table%text('scheme', k)
      call table%number('scheme_order', k, value, error)
      if (allocated(error)) return
      scheme%order = nint(value)
      scheme%family = merge(gradient_family, laplacian_family, &
                            table%text('derivative', k) == family_names(gradient_family))
      do m = 1, size(study%schemes)
        if (study%schemes(m)%name == scheme%name .and. study%schemes(m)%order == scheme%order &
            .and. study%schemes(m)%family == scheme%family) exit
      end do
      number(k) = m
      if (m <= size(study%schemes)) cycle
      study%schemes = [study%schemes, scheme]
      call append(study%field, table%text('field', k))
    end do
    if (size(study%schemes) == 0) then
      call raise(error, status_bad_input, 'The table '''//table%path// &
                 ''' holds no measurement: there is nothing to draw.')
      return
    end if
    study%cloud_name = [character(len=40) :: 'regular cloud', 'irregular cloud']
    allocate (study%curve(fixed_ratio:fixed_spacing, regular_cloud:irregular_cloud, &
                          size(study%schemes)))
    do m = 1, size(study%schemes)
      study%schemes(m)%short_waves = study%field(m)%value /= study%field(1)%value
      do cloud = regular_cloud, irregular_cloud
        do way = fixed_ratio, fixed_spacing
          allocate (study%curve(way, cloud, m)%level(0))
        end do
      end do
    end do
    do k = 1, table%lines()
      cloud = merge(regular_cloud, irregular_cloud, table%text('cloud', k) == 'regular')
      do way = fixed_ratio, fixed_spacing
        if (way_names(way) == table%text('refinement', k)) exit
      end do
      if (way > fixed_spacing) cycle
      call table%number('spacing', k, found%spacing, error)
      call table%number('support_radius', k, found%radius, error)
      call table%number('error', k, found%error, error)
      if (allocated(error)) return
      found%rounded = table%text('rounding', k) == '1'
      associate (curve => study%curve(way, cloud, number(k)))
        curve%level = [curve%level, found]
      end associate
    end do
  end subroutine restore_study

end module calor_plot
