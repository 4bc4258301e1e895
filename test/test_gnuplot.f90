!> Pictures by gnuplot, and files that are there whole or not at all.
module test_gnuplot
  use calor_error, only: error_t, status_bad_file, status_bad_input
  use calor_gnuplot, only: draw_picture, run_gnuplot, in_script
  use calor_whole_file, only: write_whole_file
  use test_process, only: contents_of, outcome_t, run_command, write_text
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_gnuplot

  character(len=*), parameter :: folder = 'build/test/gnuplot/', end = new_line('a')
  character(len=*), parameter :: parabola = &
      '$data << end'//end//'1 1'//end//'2 4'//end//'end'//end//'plot $data with lines'

contains

  subroutine collect_gnuplot(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('a script writes what it is told to', test_script), &
                new_unittest('no word is a command', test_words), &
                new_unittest('pictures', test_pictures), &
                new_unittest('a wrong script', test_wrong_script), &
                new_unittest('an old picture survives a failure', test_old_picture), &
                new_unittest('a folder that is not there', test_no_folder), &
                new_unittest('whole files', test_whole_files) &
                ]
  end subroutine collect_gnuplot

  subroutine test_script(error)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure
    type(outcome_t) :: outcome

    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder)
    call run_gnuplot('set print '''//folder//'said'''//end//'print 6*7'//end, failure)
    if (.not. no_failure(error, failure)) return
    call check(error, contents_of(folder//'said'), '42'//end)
    if (allocated(error)) return
    call run_command('ls -d "${TMPDIR:-/tmp}"/calor-*/script', folder//'list', outcome)
    call check(error, index(outcome%output, '/script'), 0, 'scratch is left: '//outcome%output)
  end subroutine test_script

  !> What stands in a scene is drawn and never run, neither by gnuplot nor by a shell.
  subroutine test_words(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: words = '`touch '//folder//'ran` "x" \ $(id) 100 %'
    type(error_t), allocatable :: failure
    logical :: ran

    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder)
    call run_gnuplot('set print '''//folder//'said'''//end//'print "'//in_script(words)//'"'//end, &
                     failure)
    if (.not. no_failure(error, failure)) return
    call check(error, contents_of(folder//'said'), words//end)
    if (allocated(error)) return
    inquire (file=folder//'ran', exist=ran)
    call check(error,.not. ran, 'a title was run as a command')
    if (allocated(error)) return
    ! Names of pictures, too
    call draw_picture(folder//'`touch '//folder(:len(folder) - 1)//'ran`.svg', 300, 200, parabola, &
                      failure)
    inquire (file=folder(:len(folder) - 1)//'ran', exist=ran)
    call check(error,.not. ran, 'a name was run as a command')
  end subroutine test_words

  subroutine test_pictures(error)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure
    character(len=:), allocatable :: bytes

    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder)
    call draw_picture(folder//'it''s.svg', 300, 200, parabola, failure)
    if (.not. no_failure(error, failure)) return
    call check(error, index(contents_of(folder//'it''s.svg'), '</svg>') > 0)
    if (allocated(error)) return
    call draw_picture(folder//'a.png', 300, 200, parabola, failure)
    if (.not. no_failure(error, failure)) return
    bytes = contents_of(folder//'a.png')
    call check(error, bytes(2:4), 'PNG')
    if (allocated(error)) return
    ! The last chunk of a whole picture
    call check(error, index(bytes, 'IEND') > 0)
    if (allocated(error)) return
    call draw_picture(folder//'a.gif', 300, 200, parabola, failure)
    if (.not. expected_failure(error, failure, status_bad_input, '.svg or .png')) return
  end subroutine test_pictures

  subroutine test_wrong_script(error)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure

    call run_gnuplot('plott 1', failure)
    if (.not. expected_failure(error, failure, status_bad_file, 'invalid command')) return
  end subroutine test_wrong_script

  subroutine test_old_picture(error)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure
    type(outcome_t) :: outcome

    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder)
    call write_text(folder//'a.svg', 'old')
    call draw_picture(folder//'a.svg', 300, 200, parabola//end//'plott 1', failure)
    if (.not. expected_failure(error, failure, status_bad_file, 'gnuplot failed')) return
    call check(error, contents_of(folder//'a.svg'), 'old')
    if (allocated(error)) return
    call run_command('ls '//folder//'a.*', folder//'list', outcome)
    call check(error, outcome%output, folder//'a.svg'//end, 'something unfinished is left')
  end subroutine test_old_picture

  subroutine test_no_folder(error)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure

    call draw_picture(folder//'nowhere/a.svg', 300, 200, parabola, failure)
    if (.not. expected_failure(error, failure, status_bad_file, 'nowhere/a.svg')) return
    call write_whole_file(folder//'nowhere/a.csv', 'x', failure)
    if (.not. expected_failure(error, failure, status_bad_file, 'nowhere/a.csv')) return
  end subroutine test_no_folder

  subroutine test_whole_files(error)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure
    type(outcome_t) :: outcome

    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder)
    call write_whole_file(folder//'a.csv', 'first, and longer'//end, failure)
    if (.not. no_failure(error, failure)) return
    call write_whole_file(folder//'a.csv', 'second'//end, failure)
    if (.not. no_failure(error, failure)) return
    call check(error, contents_of(folder//'a.csv'), 'second'//end)
    if (allocated(error)) return
    ! A folder is in the way of the new name: the unfinished file must go.
    call execute_command_line('mkdir '//folder//'b.csv')
    call write_whole_file(folder//'b.csv', 'x', failure)
    if (.not. expected_failure(error, failure, status_bad_file, 'b.csv')) return
    call run_command('ls -d '//folder//'*', folder//'../list', outcome)
    call check(error, outcome%output, folder//'a.csv'//end//folder//'b.csv'//end)
  end subroutine test_whole_files

  logical function no_failure(error, failure)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable, intent(in) :: failure

    no_failure = .not. allocated(failure)
    if (allocated(failure)) call test_failed(error, failure%message)
  end function no_failure

  logical function expected_failure(error, failure, status, words)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable, intent(in) :: failure
    integer, intent(in) :: status
    character(len=*), intent(in) :: words

    call check(error, allocated(failure), 'there should have been an error: '//words)
    if (.not. allocated(error)) call check(error, failure%status, status, failure%message)
    if (.not. allocated(error)) call check(error, index(failure%message, words) > 0, &
                                           failure%message)
    expected_failure = .not. allocated(error)
  end function expected_failure

end module test_gnuplot
