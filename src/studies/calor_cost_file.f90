!> A comparison of costs as a table for other programs (CSV).
module calor_cost_file
  use calor_cost_entry, only: cost_entry_t, cost_phases, phase_total
  use calor_kinds, only: wp
  use calor_pareto_front, only: on_pareto_front
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: cost_csv, cost_front

contains

  !> The table: one line for each entry, measured or not; empty fields where there is no figure.
  !> Times are medians, in seconds; lengths are in metres.
  function cost_csv(entries, threads) result(text)
    !> The entries
    type(cost_entry_t), intent(in) :: entries(:)
    !> Number of threads that they ran with
    integer, intent(in) :: threads
    character(len=:), allocatable :: text
    logical :: front(size(entries))
    integer :: k, phase

    text = 'laplacian,order,support,spacing,particles,neighbours,relative_l2_error,time_error,'// &
           'time_method,tolerance,step,steps,evaluations'
    do phase = 1, size(cost_phases)
      text = text//','//trim(cost_phases(phase))//'_seconds'
    end do
    text = text//',total_seconds_least,total_seconds_most,repetitions,threads,memory_bytes,'// &
           'on_front,failure'//new_line('a')
    front = cost_front(entries)
    do k = 1, size(entries)
      text = text//csv_line(entries(k), threads, front(k))//new_line('a')
    end do
  end function cost_csv

  !> Which measured entries no other beats in both error and total time.
  pure function cost_front(entries) result(front)
    !> The entries
    type(cost_entry_t), intent(in) :: entries(:)
    logical :: front(size(entries))
    real(wp) :: seconds(size(entries)), deviation(size(entries))
    integer :: k

    ! What was not measured is beaten by everything.
    seconds = huge(1.0_wp)
    deviation = huge(1.0_wp)
    do k = 1, size(entries)
      front(k) = entries(k)%measured()
      if (.not. front(k)) cycle
      seconds(k) = entries(k)%median_seconds(phase_total)
      deviation(k) = entries(k)%error
    end do
    front = front .and. on_pareto_front(seconds, deviation)
  end function cost_front

  function csv_line(entry, threads, front) result(line)
    type(cost_entry_t), intent(in) :: entry
    integer, intent(in) :: threads
    logical, intent(in) :: front
    character(len=:), allocatable :: line
    integer :: phase

    line = entry%method%laplacian//','//known(real(entry%method%order, wp))//','// &
           known(entry%method%support)//','//known(entry%spacing)
    if (entry%measured()) then
      line = line//','//to_text(entry%particles)//','//to_text(entry%neighbours, digits=6)//','// &
             to_text(entry%error, digits=6)//','//to_text(entry%time%error, digits=3)//','// &
             entry%time%method//','//known(entry%time%tolerance)//','//known(entry%time%step)// &
             ','//to_text(entry%steps)//','//to_text(entry%evaluations)
      do phase = 1, size(cost_phases)
        line = line//','//to_text(entry%median_seconds(phase), digits=4)
      end do
      line = line//','//to_text(minval(entry%seconds(phase_total, :)), digits=4)//','// &
             to_text(maxval(entry%seconds(phase_total, :)), digits=4)//','// &
             to_text(size(entry%seconds, 2))//','//to_text(threads)//','// &
             to_text(anint(entry%memory))//','//merge('1', '0', front)
    else
      line = line//repeat(',', 9 + size(cost_phases) + 6)
    end if
    line = line//','//quoted(entry%failure)
  end function csv_line

  !> A number, or nothing for 0, which stands for what is not given
  pure function known(number) result(text)
    real(wp), intent(in) :: number
    character(len=:), allocatable :: text

    text = ''
    if (number > 0) text = to_text(number)
  end function known

  !> A field of CSV: in quotes, and quotes in it twice
  pure function quoted(field) result(text)
    character(len=*), intent(in) :: field
    character(len=:), allocatable :: text
    integer :: k

    text = ''
    if (field == '') return
    do k = 1, len(field)
      text = text//field(k:k)
      if (field(k:k) == '"') text = text//'"'
    end do
    text = '"'//text//'"'
  end function quoted

end module calor_cost_file
