!> Scenes run by calor and by calor-mpi, and how far their files differ.
module test_runs
  use calor_error, only: error_t
  use calor_kinds, only: wp
  use calor_stored_fields, only: stored_fields_t
  use calor_text, only: text_t, to_text
  use testdrive, only: error_type, test_failed
  implicit none (type, external)
  private

  public :: agree, allowed, write_scene, run_and_signal, run_serial, run_ranks, &
            compare_files, said, environment

  !> How far fields of two programs may differ
  real(wp), parameter :: allowed = 1.0e-10_wp

contains

  !> Run a scene, whose file is named as it, by one process and by ranks.
  subroutine agree(name, lines, ranks, error, field, volume_error, within)
    character(len=*), intent(in) :: name
    character(len=*), intent(in) :: lines(:)
    integer, intent(in) :: ranks(:)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in), optional :: field
    !> How far volumes may differ; 0 without it
    real(wp), intent(in), optional :: volume_error
    !> How far fields may differ; `allowed` without it
    real(wp), intent(in), optional :: within
    character(len=:), allocatable :: what
    real(wp) :: near
    real(wp) :: rounding
    integer :: k, status

    near = allowed
    if (present(within)) near = within
    rounding = 0
    if (present(volume_error)) rounding = volume_error
    what = 'temperature'
    if (present(field)) what = field
    call write_scene(name, lines)
    call run_serial(name, status)
    if (status /= 0) then
      call test_failed(error, name//': calor ended with status '//to_text(status))
      return
    end if
    call execute_command_line('mv '//name//'.vtkhdf '//name//'_serial.vtkhdf')
    do k = 1, size(ranks)
      call run_ranks(name, ranks(k), status)
      if (status /= 0) then
        call test_failed(error, name//': '//to_text(ranks(k))//' ranks ended with status '// &
                         to_text(status))
        return
      end if
      call compare_files(name//'_serial.vtkhdf', name//'.vtkhdf', what, near, error)
      if (allocated(error)) return
      call compare_files(name//'_serial.vtkhdf', name//'.vtkhdf', 'volume', rounding, error)
      if (allocated(error)) return
      call compare_budgets(name//'_serial.vtkhdf', name//'.vtkhdf', allowed, error)
      if (allocated(error)) return
    end do
  end subroutine agree

  !> Write a scene, its parts one a line.
  subroutine write_scene(name, lines)
    character(len=*), intent(in) :: name, lines(:)
    integer :: unit, k

    open (newunit=unit, file=name//'.nml', action='write', status='replace')
    do k = 1, size(lines)
      write (unit, '(a)') trim(lines(k))
    end do
    close (unit)
  end subroutine write_scene

  function environment(name) result(value)
    character(len=*), intent(in) :: name
    character(len=:), allocatable :: value
    integer :: length

    call get_environment_variable(name, length=length)
    allocate (character(len=length) :: value)
    if (length > 0) call get_environment_variable(name, value)
  end function environment

  subroutine run_serial(name, status, options)
    character(len=*), intent(in) :: name
    integer, intent(out) :: status
    character(len=*), intent(in), optional :: options
    character(len=:), allocatable :: more

    more = ''
    if (present(options)) more = ' '//options
    call execute_command_line(environment('CALOR_PROGRAM')//' run '//name//'.nml'//more//' >'// &
                              name//'.out 2>&1', exitstat=status)
  end subroutine run_serial

  !> Run by some ranks; what was said is in `name`.out.
  subroutine run_ranks(name, ranks, status, options, command)
    character(len=*), intent(in) :: name
    integer, intent(in) :: ranks
    integer, intent(out) :: status
    character(len=*), intent(in), optional :: options
    !> Instead of 'run'
    character(len=*), intent(in), optional :: command
    character(len=:), allocatable :: more, what

    more = ''
    if (present(options)) more = ' '//options
    what = 'run'
    if (present(command)) what = command
    call execute_command_line(environment('CALOR_MPIRUN')//' -n '//to_text(ranks)//' '// &
                              environment('CALOR_MPI_PROGRAM')//' '//what//' '//name//'.nml'// &
                              more//' >'//name//'.out 2>&1', exitstat=status)
  end subroutine run_ranks

  !> Run by some ranks, and send a signal to the second of them when a file is there.
  subroutine run_and_signal(name, ranks, signal, file, status, patience)
    character(len=*), intent(in) :: name, signal, file
    integer, intent(in) :: ranks
    integer, intent(out) :: status
    !> Signal to Open MPI's mpirun itself, which gives ranks so many seconds before it kills them
    integer, intent(in), optional :: patience
    character(len=*), parameter :: quote = ''''
    character(len=:), allocatable :: options, receiver

    options = ''
    receiver = '$(cat '//name//'.pid1)'
    if (present(patience)) then
      options = ' --mca odls_base_sigkill_timeout '//to_text(patience)
      receiver = '$job'
    end if
    call execute_command_line('rm -f '//file//'; '// &
                              environment('CALOR_MPIRUN')//options//' -n '//to_text(ranks)// &
                              ' sh -c '// &
                              quote//'echo $$ >'//name//'.pid$OMPI_COMM_WORLD_RANK; exec '// &
                              environment('CALOR_MPI_PROGRAM')//' run '//name//'.nml'//quote// &
                              ' >'//name//'.out 2>&1 & job=$!; '// &
                              'for i in $(seq 3000); do [ -e '//file//' ] && break; '// &
                              'sleep 0.02; done; '// &
                              'kill -'//signal//' '//receiver//'; wait $job', &
                              exitstat=status)
  end subroutine run_and_signal

  !> How often a text was said.
  function said(name, text) result(times)
    character(len=*), intent(in) :: name, text
    integer :: times
    character(len=2000) :: line
    integer :: unit, status

    times = 0
    open (newunit=unit, file=name//'.out', action='read', status='old')
    do
      read (unit, '(a)', iostat=status) line
      if (status /= 0) exit
      if (index(line, text) > 0) times = times + 1
    end do
    close (unit)
  end function said

  !> The largest difference of any field at any step, which may be as large as allowed.
  subroutine compare_files(one, other, field, allowed, error)
    character(len=*), intent(in) :: one, other, field
    real(wp), intent(in) :: allowed
    type(error_type), allocatable, intent(out) :: error
    type(stored_fields_t) :: first, second
    type(error_t), allocatable :: failure
    real(wp), allocatable :: x(:), y(:), x_other(:), y_other(:), values(:), values_other(:)
    real(wp) :: worst
    integer :: step

    call first%open(one, failure)
    if (.not. allocated(failure)) call second%open(other, failure)
    if (allocated(failure)) then
      call test_failed(error, failure%message)
      return
    end if
    if (size(first%time) /= size(second%time) .or. first%particles /= second%particles) then
      call test_failed(error, other//': not as many particles or steps')
      return
    end if
    worst = maxval(abs(first%time - second%time))
    do step = 1, size(first%time)
      call first%read_places(step, x, y, failure)
      if (.not. allocated(failure)) call second%read_places(step, x_other, y_other, failure)
      if (.not. allocated(failure)) call first%read_field(field, step, values, failure)
      if (.not. allocated(failure)) call second%read_field(field, step, values_other, failure)
      if (allocated(failure)) then
        call test_failed(error, failure%message)
        return
      end if
      if (any(x /= x_other) .or. any(y /= y_other)) then
        call test_failed(error, other//': the particles are not the same')
        return
      end if
      if (.not. all(abs(values - values_other) <= huge(1.0_wp))) worst = huge(1.0_wp)
      worst = max(worst, maxval(abs(values - values_other)))
    end do
    call first%close()
    call second%close()
    if (.not. worst <= allowed) then
      call test_failed(error, other//': '//field//' differs by '//to_text(worst, digits=3))
    end if
  end subroutine compare_files

  !> The largest difference of any number of the heat budgets, as a part of the largest of all
  !> powers; energies as a part of the largest energy.
  subroutine compare_budgets(one, other, allowed, error)
    character(len=*), intent(in) :: one, other
    real(wp), intent(in) :: allowed
    type(error_type), allocatable, intent(out) :: error
    type(stored_fields_t) :: first, second
    type(error_t), allocatable :: failure
    type(text_t), allocatable :: accounts(:)
    real(wp), allocatable :: powers(:)
    real(wp) :: scale
    integer :: k

    call first%open(one, failure)
    if (.not. allocated(failure)) call second%open(other, failure)
    if (allocated(failure)) then
      call test_failed(error, failure%message)
      return
    end if
    accounts = first%accounts()
    powers = abs(first%series('budget_stored_rate'))
    do k = 1, size(accounts)
      powers = [powers, abs(first%series('budget_'//accounts(k)%value))]
    end do
    scale = maxval([powers, tiny(1.0_wp)])
    call compare('budget_time', 1.0_wp)
    call compare('budget_stored', max(tiny(1.0_wp), maxval(abs(first%series('budget_stored')))))
    do k = 1, size(accounts)
      call compare('budget_'//accounts(k)%value, scale)
    end do
    if (size(accounts) > 0) call compare('budget_stored_rate', scale)
    if (size(accounts) > 0) call compare('budget_imbalance', 1.0_wp)
    call first%close()
    call second%close()

  contains

    subroutine compare(name, unit)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: unit
      real(wp), allocatable :: a(:), b(:)

      if (allocated(error)) return
      a = first%series(name)
      b = second%series(name)
      if (size(a) == 0 .or. size(a) /= size(b)) then
        call test_failed(error, other//': '//name//' has '//to_text(size(b))//' numbers, not '// &
                         to_text(size(a)))
      else if (.not. maxval(abs(a - b)) <= allowed*unit) then
        call test_failed(error, other//': '//name//' differs by '// &
                         to_text(maxval(abs(a - b))/unit, digits=3))
      end if
    end subroutine compare

  end subroutine compare_budgets

end module test_runs
