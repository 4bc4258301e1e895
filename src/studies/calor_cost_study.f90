!> What accuracy costs in time: `calor cost`.
!>
!> A scene is run with several methods on clouds of several spacings. Wall times are those of all
!> that a run needs for its answer, from making the cloud to the last step, but for writing output.
!> Every entry gets time steps whose error is below a tenth of the error in space, and not much
!> smaller ones, found by pilot runs that are not timed and serve as its warm-up. Repetitions go
!> round all entries, so that what else the machine does meets all of them alike.
module calor_cost_study
  use calor_cost_entry, only: cost_entry_t, phase_total
  use calor_cost_file, only: cost_csv
  use calor_cost_method, only: cost_method_t, cost_methods
  use calor_cost_picture, only: cost_picture, picture_width, picture_height
  use calor_error, only: error_t, raise, status_bad_input, status_bad_numbers
  use calor_file_system, only: look_at_path, path_file, remove_file
  use calor_gnuplot, only: draw_picture
  use calor_interrupt, only: interrupted, interrupt_status
  use calor_kinds, only: wp, i8
  use calor_reference_solution, only: reference_solution_t
  use calor_scene, only: scene_t
  use calor_simulation_file, only: check_target
  use calor_text, only: text_t, to_text, append
  use calor_whole_file, only: write_whole_file
  use omp_lib, only: omp_get_max_threads
  implicit none (type, external)
  private

  public :: cost_study_t, cost_observer_t

  !> Where a scene gives no spacings, these multiples of its own
  real(wp), parameter :: usual_spacings(*) = [4.0_wp, 2.0_wp, 1.0_wp, 0.5_wp]
  !> More entries are a slip of the pen
  integer, parameter :: most_entries = 200
  !> Pilot runs take about as long as so many runs
  real(wp), parameter :: pilot_share = 5.0_wp

  !> A comparison of costs
  type :: cost_study_t
    type(scene_t) :: scene
    !> Its lines: the coarsest clouds first
    type(cost_entry_t), allocatable :: entries(:)
    !> What results are compared with
    type(reference_solution_t) :: reference
    !> Number of threads
    integer :: threads = 1
    !> Whether it was interrupted
    logical :: interrupted = .false.
    !> Files that were written, and why a picture was not drawn, or ''
    type(text_t), allocatable :: written(:)
    character(len=:), allocatable :: picture_problem
    !> When the measurements began, in counts of the system's clock
    integer(i8), private :: began = 0
    !> Work done so far and the time that it took, s; the work is a model, good for a forecast only
    real(wp), private :: work_done = 0.0_wp, work_seconds = 0.0_wp
    integer, private :: round = 1, position = 0
  contains
    !> List the entries and check what the scene asks for
    procedure :: prepare
    !> Measure all entries, and write what there is
    procedure :: measure
    !> Wall time since the measurements began, s
    procedure :: elapsed
    !> About how long it will still take, s; negative: not known yet
    procedure :: remaining
    !> How many measurements are done, and how many there are
    procedure :: measurements
    !> Whether anything was measured
    procedure :: any_measured
    procedure, private :: measure_entry
    procedure, private :: write_files
  end type cost_study_t

  !> Is told how far a study is; a program extends it to show progress
  type, abstract :: cost_observer_t
  contains
    !> An entry has been measured, or has failed
    procedure(progressed_interface), deferred :: progressed
  end type cost_observer_t

  abstract interface
    subroutine progressed_interface(this, study, entry)
      import :: cost_observer_t, cost_study_t
      implicit none (type, external)
      class(cost_observer_t), intent(inout) :: this
      !> The study so far
      type(cost_study_t), intent(in) :: study
      !> The entry that comes next; 0: the solution to compare with, or nothing
      integer, intent(in) :: entry
    end subroutine progressed_interface
  end interface

contains

  subroutine prepare(this, scene, error)
    class(cost_study_t), intent(out) :: this
    !> The scene
    type(scene_t), intent(in) :: scene
    !> It asks for something that cannot be compared
    type(error_t), allocatable, intent(out) :: error
    type(cost_method_t), allocatable :: methods(:)
    real(wp), allocatable :: spacings(:)
    integer :: k, j

    this%scene = scene
    this%threads = omp_get_max_threads()
    this%picture_problem = ''
    allocate (this%written(0))
    call check_target(scene%cost%file, scene%cost%place, scene, error)
    if (allocated(error)) return
    if (scene%motion%in_force) then
      call raise(error, status_bad_input, scene%motion%place//': calor cost compares runs of '// &
                 'bodies at rest; remove the group.')
      return
    end if
    methods = cost_methods(scene)
    spacings = scene%cost%spacings
    if (size(spacings) == 0) spacings = usual_spacings*scene%domain%spacing
    if (scene%domain%shape == 'cloud') spacings = [0.0_wp]
    if (size(methods)*size(spacings) > most_entries) then
      call raise(error, status_bad_input, scene%cost%spacings_place//': '// &
                 to_text(size(methods)*size(spacings))//' combinations of methods and spacings '// &
                 'are more than '//to_text(most_entries)//': shorten the lists of &cost.')
      return
    end if
    call sort_down(spacings)
    allocate (this%entries(size(methods)*size(spacings)))
    do j = 1, size(spacings)
      do k = 1, size(methods)
        associate (entry => this%entries((j - 1)*size(methods) + k))
          entry%method = methods(k)
          entry%spacing = spacings(j)
          entry%failure = ''
        end associate
      end do
    end do
  end subroutine prepare

  !> The largest first
  pure subroutine sort_down(values)
    real(wp), intent(inout) :: values(:)
    integer :: k, place

    do k = 1, size(values) - 1
      place = k - 1 + maxloc(values(k:), dim=1)
      values([k, place]) = values([place, k])
    end do
  end subroutine sort_down

  subroutine measure(this, error, observer)
    class(cost_study_t), intent(inout) :: this
    !> Nothing could be measured, or a file not be written; where the study was interrupted, that,
    !> after all that was measured has been written
    type(error_t), allocatable, intent(out) :: error
    !> Who is told about the progress
    class(cost_observer_t), intent(inout), optional :: observer

    call system_clock(this%began)
    if (present(observer)) call observer%progressed(this, 0)
    call this%reference%find(this%scene, minval(this%entries%spacing), error)
    if (allocated(error)) return
    call system_clock(this%began)
    rounds: do while (this%round <= this%scene%cost%repetitions)
      this%position = 0
      do while (this%position < size(this%entries))
        if (present(observer)) call observer%progressed(this, this%position + 1)
        call this%measure_entry(this%entries(this%position + 1))
        if (interrupted()) exit rounds
        this%position = this%position + 1
        call write_whole_file(unfinished(this%scene%cost%file), &
                              cost_csv(this%entries, this%threads), error)
        if (allocated(error)) return
      end do
      this%round = this%round + 1
    end do rounds
    this%interrupted = interrupted()
    if (present(observer)) call observer%progressed(this, 0)
    if (this%any_measured()) then
      call this%write_files(error)
      if (allocated(error)) return
    else if (.not. this%interrupted) then
      call raise_failure(this, error)
      return
    end if
    if (this%interrupted) call raise(error, interrupt_status(), 'Interrupted after '// &
                                     to_text(this%elapsed(), digits=3)//' s.')
  end subroutine measure

  !> One more run of an entry, after its pilot runs if it is the first.
  subroutine measure_entry(this, entry)
    class(cost_study_t), intent(inout) :: this
    type(cost_entry_t), intent(inout) :: entry
    type(error_t), allocatable :: error
    real(wp) :: start, runs

    if (entry%failure /= '') return
    runs = 1
    if (this%round == 1) runs = 1 + pilot_share
    if (this%elapsed() + runs*work(entry)*seconds_per_work(this) > this%scene%cost%seconds) then
      if (this%round == 1) then
        entry%failure = 'not measured: the '//to_text(this%scene%cost%seconds, digits=3)// &
                        ' s of &cost seconds would not suffice'
      end if
      return
    end if
    start = this%elapsed()
    if (this%round == 1) call entry%explore(this%scene, this%reference, error)
    if (.not. allocated(error)) call entry%measure(this%scene, this%reference, error)
    if (allocated(error)) then
      if (.not. interrupted()) entry%failure = first_sentence(error%message)
      return
    end if
    this%work_done = this%work_done + runs*work(entry)
    this%work_seconds = this%work_seconds + this%elapsed() - start
  end subroutine measure_entry

  !> What a run takes, in some unit: the measured time, or particles, neighbours and stages.
  pure function work(entry)
    type(cost_entry_t), intent(in) :: entry
    real(wp) :: work

    work = max(entry%method%support, 2.0_wp)**2
    if (entry%spacing > 0) work = work/entry%spacing**3
  end function work

  pure function seconds_per_work(this) result(seconds)
    class(cost_study_t), intent(in) :: this
    real(wp) :: seconds

    seconds = 0
    if (this%work_done > 0) seconds = this%work_seconds/this%work_done
  end function seconds_per_work

  !> The first line of a message without the place that all entries share
  pure function first_sentence(message) result(sentence)
    character(len=*), intent(in) :: message
    character(len=:), allocatable :: sentence

    sentence = message(:index(message//new_line('a'), new_line('a')) - 1)
  end function first_sentence

  pure function any_measured(this) result(answer)
    class(cost_study_t), intent(in) :: this
    logical :: answer
    integer :: k

    answer = .false.
    if (.not. allocated(this%entries)) return
    do k = 1, size(this%entries)
      answer = answer .or. this%entries(k)%measured()
    end do
  end function any_measured

  !> Nothing could be measured: say why the last one, which is the finest, could not.
  subroutine raise_failure(this, error)
    class(cost_study_t), intent(in) :: this
    type(error_t), allocatable, intent(out) :: error
    type(cost_entry_t) :: entry

    entry = this%entries(size(this%entries))
    call entry%explore(this%scene, this%reference, error)
    if (allocated(error)) return
    call raise(error, status_bad_numbers, 'Nothing could be measured: '//entry%failure//'.')
  end subroutine raise_failure

  !> The table and its pictures. A study that was interrupted does not replace those of a whole one.
  subroutine write_files(this, error)
    class(cost_study_t), intent(inout) :: this
    type(error_t), allocatable, intent(out) :: error
    type(error_t), allocatable :: problem
    character(len=:), allocatable :: path, stem, reason
    character(len=4), parameter :: endings(*) = ['.svg', '.png']
    integer :: kind_of_path, k

    path = this%scene%cost%file
    call look_at_path(path, kind_of_path, reason)
    if (this%interrupted .and. kind_of_path == path_file) path = unfinished(path)
    call write_whole_file(path, cost_csv(this%entries, this%threads), error)
    if (allocated(error)) return
    if (path == this%scene%cost%file) call remove_file(unfinished(path), reason)
    call append(this%written, path)
    stem = path(:len(path) - 4)
    do k = 1, size(endings)
      call draw_picture(stem//endings(k), picture_width, picture_height(this%entries), &
                        cost_picture(this%entries, headline(this%scene), this%threads, &
                                     this%scene%time%end), problem)
      if (allocated(problem)) then
        this%picture_problem = problem%message
        exit
      end if
      call append(this%written, stem//endings(k))
    end do
  end subroutine write_files

  pure function headline(scene) result(text)
    type(scene_t), intent(in) :: scene
    character(len=:), allocatable :: text

    text = scene%path
    if (scene%title /= '') text = scene%title
  end function headline

  !> Where the table of a study stands that is not over
  pure function unfinished(path) result(other)
    character(len=*), intent(in) :: path
    character(len=:), allocatable :: other

    other = path(:len(path) - 4)//'.unfinished.csv'
  end function unfinished

  function elapsed(this) result(seconds)
    class(cost_study_t), intent(in) :: this
    real(wp) :: seconds
    integer(i8) :: now, rate

    call system_clock(now, rate)
    seconds = real(now - this%began, wp)/rate
  end function elapsed

  function remaining(this) result(seconds)
    class(cost_study_t), intent(in) :: this
    real(wp) :: seconds
    integer :: k, runs

    seconds = -1
    if (.not. this%work_done > 0) return
    seconds = 0
    do k = 1, size(this%entries)
      associate (entry => this%entries(k))
        if (entry%failure /= '') cycle
        runs = this%scene%cost%repetitions - this%round
        if (k > this%position) runs = runs + 1
        if (entry%measured()) then
          seconds = seconds + runs*entry%median_seconds(phase_total)
        else
          seconds = seconds + (runs + pilot_share)*work(entry)*seconds_per_work(this)
        end if
      end associate
    end do
    seconds = max(0.0_wp, min(seconds, this%scene%cost%seconds - this%elapsed()))
  end function remaining

  pure subroutine measurements(this, done, all)
    class(cost_study_t), intent(in) :: this
    !> So many are over
    integer, intent(out) :: done
    !> … of so many
    integer, intent(out) :: all

    done = (this%round - 1)*size(this%entries) + this%position
    all = this%scene%cost%repetitions*size(this%entries)
    done = min(done, all)
  end subroutine measurements

end module calor_cost_study
