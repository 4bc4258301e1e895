!> How a cloud is shared out: no rank has more than its share and a border around it.
module test_sharing
  use calor_kinds, only: wp
  use calor_text, only: to_text
  use test_runs, only: run_ranks, write_scene
  use testdrive, only: error_type, new_unittest, test_failed, unittest_type
  implicit none (type, external)
  private

  public :: collect_sharing

contains

  subroutine collect_sharing(tests)
    type(unittest_type), allocatable, intent(out) :: tests(:)

    tests = [new_unittest('particles here and bytes exchanged', test_borders), &
             new_unittest('memory of a rank', test_memory)]
  end subroutine collect_sharing

  !> On 51² particles with a support of h = 2.1 Δ. A band of n particles along the curve is within a
  !> few squares; its border is no longer than 8 √n Δ. Rows reach h beyond it: 8 √n h/Δ particles at
  !> most are sent for. The reach is 1.5 h = 3.15 Δ, and squares of half its length at most are
  !> asked for as a whole: within 1.5 reaches, 5 Δ, there are 8 √n 5 and the corners' 100.
  subroutine test_borders(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: particles = 51**2
    integer, parameter :: ranks(4) = [1, 2, 4, 8]
    real(wp) :: own, others, bytes
    integer :: k, status

    call write_scene('borders', [character(len=100) :: &
                                 '&domain shape=''rectangle'' x_range=0,1 y_range=0,1', &
                                 '  spacing=0.02 arrangement=''jittered'' jitter=0.2 /', &
                                 '&boundary on=''all'' kind=''temperature'' value=0 /', &
                                 '&kernel support=2.1 /', &
                                 '&time end=0.001 method=''rkl2'' /'])
    do k = 1, size(ranks)
      call run_ranks('borders', ranks(k), status, command='check')
      if (status /= 0) then
        call test_failed(error, to_text(ranks(k))//' ranks: status '//to_text(status))
        return
      end if
      own = number_in('borders', 'Ranks', 6)
      others = number_in('borders', 'Ranks', 11)
      bytes = number_in('borders', 'Exchange', 1)
      associate (share => real(particles, wp)/ranks(k))
        if (own > share + 1) then
          call test_failed(error, to_text(own)//' own particles, more than the share')
        else if (others > 40*sqrt(share) + 100) then
          call test_failed(error, to_text(others)//' particles of others')
        else if (bytes > 8*8*2.1_wp*sqrt(share)) then
          call test_failed(error, to_text(bytes)//' bytes are sent')
        end if
        if (allocated(error)) return
      end associate
    end do
  end subroutine test_borders

  !> What a larger cloud takes more than a small one, as counted by the system: 1000 bytes for each
  !> further particle of one's own or within reach on one rank, at the peak of assembly, were
  !> measured, and less on more ranks; all arrays together, so that none can hold the cloud.
  subroutine test_memory(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: ranks(4) = [1, 2, 4, 8]
    real(wp), parameter :: most_bytes = 1250.0_wp
    real(wp) :: small(2), large(2), further(size(ranks))
    integer :: k

    do k = 1, size(ranks)
      call measure('0.02', ranks(k), small, error)
      if (allocated(error)) return
      call measure('0.004', ranks(k), large, error)
      if (allocated(error)) return
      further(k) = large(1) - small(1)
      if (further(k) > most_bytes*(large(2) - small(2))) then
        call test_failed(error, to_text(ranks(k))//' ranks: '//to_text(further(k))//' bytes '// &
                         'for '//to_text(large(2) - small(2))//' particles')
        return
      end if
    end do
    if (any(further > 1.3_wp*further(1)/ranks)) then
      call test_failed(error, 'memory does not fall as 1/P: '//to_text(further(size(ranks))))
    end if
  end subroutine test_memory

  !> Peak of a rank, bytes, and particles that it has, its own and others'.
  subroutine measure(spacing, ranks, found, error)
    character(len=*), intent(in) :: spacing
    integer, intent(in) :: ranks
    real(wp), intent(out) :: found(2)
    type(error_type), allocatable, intent(out) :: error
    integer :: status

    call write_scene('memory', [character(len=100) :: &
                                '&domain shape=''rectangle'' x_range=0,1 y_range=0,1', &
                                '  spacing='//spacing//' arrangement=''jittered'' jitter=0.2 /', &
                                '&boundary on=''all'' kind=''temperature'' value=0 /', &
                                '&kernel support=2.1 /', &
                                '&time end=0.001 method=''rkl2'' /'])
    call run_ranks('memory', ranks, status, command='check')
    if (status /= 0) call test_failed(error, to_text(ranks)//' ranks: status '//to_text(status))
    found = [1024*number_in('memory', 'Taken', 1), &
             number_in('memory', 'Ranks', 6) + number_in('memory', 'Ranks', 11)]
  end subroutine measure

  !> A number in what was said: on the line with a heading, so many words after that.
  function number_in(name, heading, word) result(number)
    character(len=*), intent(in) :: name, heading
    integer, intent(in) :: word
    real(wp) :: number
    character(len=200) :: line, words(20)
    integer :: unit, status

    number = huge(1.0_wp)
    open (newunit=unit, file=name//'.out', action='read', status='old')
    do
      read (unit, '(a)', iostat=status) line
      if (status /= 0) exit
      if (index(line, heading) /= 1) cycle
      words = ''
      ! The line has fewer words than there is room for.
      read (line(len(heading) + 1:), *, iostat=status) words
      if (status == 0) cycle
      read (words(word), *, iostat=status) number
      if (status /= 0) number = huge(1.0_wp)
    end do
    close (unit)
  end function number_in

end module test_sharing
