!> Runs that are laid aside and resumed: what is stored, whether it is whole, and whether the result
!> is that of a run without a break.
module test_checkpoint
  use, intrinsic :: iso_fortran_env, only: int8
  use calor_checkpoint_file, only: write_checkpoint_file, read_checkpoint_file, older_checkpoint
  use calor_checksum, only: checksum_t, checksum_text
  use calor_error, only: error_t, status_bad_file, status_bad_input
  use calor_interrupt, only: watch_for_interrupt, stop_watching
  use calor_kinds, only: wp, i8
  use calor_random, only: random_uniform
  use calor_saved_state, only: saved_state_t
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene
  use calor_simulation, only: simulation_t, observer_t
  use calor_text, only: to_text
  use test_command_line, only: zero_wall_times
  use test_process, only: contents_of, outcome_t, program_path, run_command, write_text
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_checkpoint

  character(len=*), parameter :: folder = 'build/test/checkpoint/'
  character(len=1), parameter :: lf = new_line('a')

  !> Lays the state aside after some steps, as an interrupt does
  type, extends(observer_t) :: interrupter_t
    !> The step that is interrupted, and whether it has been
    integer :: at = 0
    logical :: done = .false.
  contains
    procedure :: reached
    procedure :: at_step
  end type interrupter_t

  interface
    function c_raise(number) result(status) bind(c, name='raise')
      use, intrinsic :: iso_c_binding, only: c_int
      implicit none (type, external)
      integer(c_int), intent(in), value :: number
      integer(c_int) :: status
    end function c_raise
  end interface

  character(len=*), parameter :: &
      square = '&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.1 '// &
      'arrangement = ''jittered'' /'//lf, &
      disc = '&domain shape = ''disc'' radius = 1 spacing = 0.2 /'//lf, &
      warm = '&initial temperature_expression = ''sin(pi*x)*sin(pi*y)'' /'//lf, &
      spot = '&initial temperature_expression = ''exp(-10*((x-0.3)^2+y^2))'' /'//lf, &
      held = '&boundary value = 0 /'//lf, &
      exchange = '&boundary kind = ''convection'' coefficient = 1 ambient_expression = '// &
      '''0.1*sin(3*t)*x'' /'//lf, &
      swirl = '&motion velocity_x_expression = ''-3*y*(1+0.5*(x^2+y^2))'' '// &
      'velocity_y_expression = ''3*x*(1+0.5*(x^2+y^2))'' shifting = ', &
      estimated = '&accuracy estimate = .true. /'//lf

contains

  subroutine collect_checkpoint(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('checksums', test_checksum), &
                new_unittest('what is saved comes back', test_round_trip), &
                new_unittest('500 flipped bits', test_flipped_bits), &
                new_unittest('files that are cut off or none', test_cut_off), &
                new_unittest('older ones are kept', test_keep), &
                new_unittest('rkl2', test_rkl2), &
                new_unittest('steps of equal length', test_equal_steps), &
                new_unittest('tr_bdf2, linear', test_tr_bdf2_linear), &
                new_unittest('tr_bdf2, not linear', test_tr_bdf2), &
                new_unittest('exponential', test_exponential), &
                new_unittest('melting', test_melting), &
                new_unittest('materials with laws of their own', test_jumps), &
                new_unittest('a conductivity by place and temperature', test_local), &
                new_unittest('temperatures far beyond the given ones', test_beyond), &
                new_unittest('error estimate', test_estimate), &
                new_unittest('a body that turns', test_turning), &
                new_unittest('particles that flow', test_flow), &
                new_unittest('particles that are shifted', test_shifting), &
                new_unittest('error estimate of particles that flow', test_flow_estimate), &
                new_unittest('checkpoints on the way change nothing', test_regular), &
                new_unittest('changed scenes', test_changes), &
                new_unittest('a later end', test_later_end), &
                new_unittest('an output file that is gone', test_no_output), &
                new_unittest('the command, interrupted and resumed', test_command), &
                new_unittest('no room, no folder', test_no_room) &
                ]
  end subroutine collect_checkpoint

  subroutine reached(this, simulation)
    class(interrupter_t), intent(inout) :: this
    type(simulation_t), intent(in) :: simulation

    associate (unused => this, also => simulation)
    end associate
  end subroutine reached

  subroutine at_step(this, time, steps, accumulated_error, rest)
    use, intrinsic :: iso_c_binding, only: c_int
    class(interrupter_t), intent(inout) :: this
    real(wp), intent(in) :: time
    integer, intent(in) :: steps
    real(wp), intent(in) :: accumulated_error
    logical, intent(inout) :: rest
    integer(c_int) :: status

    associate (unused => [time, accumulated_error], also => rest)
    end associate
    if (steps < this%at .or. this%done) return
    this%done = .true.
    status = c_raise(2_c_int)
  end subroutine at_step

  ! ---------------------------------------------------------------------------------------------
  ! Files
  ! ---------------------------------------------------------------------------------------------

  !> The check value that every description of this checksum gives, and that parts make a whole.
  subroutine test_checksum(error)
    type(error_type), allocatable, intent(out) :: error
    type(checksum_t) :: checksum
    integer(int8) :: bytes(1000)
    character(len=16) :: text
    integer :: k

    call check(error, checksum_text(transfer('123456789', bytes(:9))), '995DC9BBDF1939FA')
    if (allocated(error)) return
    bytes = [(int(modulo(37*k, 251) - 125, int8), k=1, 1000)]
    call checksum%add(bytes(:13))
    call checksum%add(bytes(14:21))
    call checksum%add(bytes(22:))
    write (text, '(z16.16)') checksum%value()
    call check(error, text, checksum_text(bytes))
  end subroutine test_checksum

  !> A state with a bit of everything
  subroutine fill(state)
    type(saved_state_t), intent(out) :: state
    integer :: k

    call state%put('scene', '&domain /'//lf)
    call state%put('nothing', '')
    call state%enter('stepper')
    call state%put('step', 0.1_wp)
    call state%put('rates', [(sin(real(k, wp)), k=1, 300)])
    call state%put('none', [real(wp) ::])
    call state%leave()
    call state%put('count', 12)
    call state%put('counts', [1, -2, 3])
    call state%put('done', .true.)
  end subroutine fill

  subroutine test_round_trip(error)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure
    type(saved_state_t) :: state, read_back
    character(len=:), allocatable :: text
    real(wp), allocatable :: reals(:)
    integer, allocatable :: integers(:)
    real(wp) :: number
    integer :: whole, k
    logical :: flag

    call start_over()
    call fill(state)
    call write_checkpoint_file(folder//'a.h5', state, 1, failure)
    call expect_none(error, failure)
    if (allocated(error)) return
    call read_checkpoint_file(folder//'a.h5', read_back, failure)
    call expect_none(error, failure)
    if (allocated(error)) return
    text = 'x'
    call read_back%get('scene', text)
    call check(error, text, '&domain /'//lf)
    if (allocated(error)) return
    call read_back%get('nothing', text)
    call check(error, len(text), 0)
    if (allocated(error)) return
    call read_back%get('done', flag)
    call read_back%get('count', whole)
    call read_back%get('counts', integers)
    call check(error, flag .and. whole == 12 .and. all(integers == [1, -2, 3]))
    if (allocated(error)) return
    call read_back%enter('stepper')
    call read_back%get('step', number)
    call read_back%get('rates', reals)
    call check(error, .not. (abs(number - 0.1_wp) > 0 .or. &
                             any(abs(reals - [(sin(real(k, wp)), k=1, 300)]) > 0)))
    if (allocated(error)) return
    call read_back%get('none', reals)
    call check(error, size(reals), 0)
    if (allocated(error)) return
    call check(error, .not. allocated(read_back%problem), 'something was missing')
    if (allocated(error)) return
    call read_back%get('more', number)
    call check(error, read_back%problem, 'stepper/more')
  end subroutine test_round_trip

  !> Whatever bit is another one, the file is refused, and where it lies in a data set, that is
  !> named.
  subroutine test_flipped_bits(error)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure
    type(saved_state_t) :: state
    character(len=:), allocatable :: whole, damaged
    integer :: k, byte, bit, named

    call start_over()
    call fill(state)
    call write_checkpoint_file(folder//'a.h5', state, 1, failure)
    call expect_none(error, failure)
    if (allocated(error)) return
    whole = contents_of(folder//'a.h5')
    named = 0
    do k = 1, 500
      byte = 1 + int(random_uniform(1, int(k, i8))*len(whole))
      bit = int(8*random_uniform(2, int(k, i8)))
      damaged = whole
      damaged(byte:byte) = achar(ieor(iachar(whole(byte:byte)), ishft(1, bit)))
      call write_text(folder//'b.h5', damaged)
      call read_checkpoint_file(folder//'b.h5', state, failure)
      if (.not. allocated(failure)) then
        call test_failed(error, 'bit '//to_text(bit)//' of byte '//to_text(byte)//' passes')
        return
      end if
      call check(error, failure%status == status_bad_file .and. &
                 index(failure%message, 'damaged') > 0, failure%message)
      if (allocated(error)) return
      if (index(failure%message, 'stepper/rates') > 0) named = named + 1
    end do
    call check(error, named > 0, 'no damage was found in the largest data set')
  end subroutine test_flipped_bits

  subroutine test_cut_off(error)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure
    type(saved_state_t) :: state
    character(len=:), allocatable :: whole
    integer :: k

    call start_over()
    call fill(state)
    call write_checkpoint_file(folder//'a.h5', state, 1, failure)
    whole = contents_of(folder//'a.h5')
    do k = 0, 9
      call write_text(folder//'b.h5', whole(:k*len(whole)/10))
      call read_checkpoint_file(folder//'b.h5', state, failure)
      call expect(error, failure, status_bad_file, 'damaged')
      if (allocated(error)) return
    end do
    call write_text(folder//'b.h5', whole//'x')
    call read_checkpoint_file(folder//'b.h5', state, failure)
    call expect(error, failure, status_bad_file, 'damaged')
    if (allocated(error)) return
    call read_checkpoint_file(folder//'c.h5', state, failure)
    call expect(error, failure, status_bad_file, 'There is no checkpoint')
    if (allocated(error)) return
    call read_checkpoint_file(folder, state, failure)
    call expect(error, failure, status_bad_file, 'no file')
  end subroutine test_cut_off

  subroutine test_keep(error)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure
    type(saved_state_t) :: state
    integer :: k, number
    logical :: there

    call check(error, older_checkpoint('a.b/c', 1)//' '//older_checkpoint('a.b/c.h5', 2), &
               'a.b/c.1 a.b/c.2.h5')
    if (allocated(error)) return
    call start_over()
    do k = 1, 4
      state = saved_state_t()
      call state%put('number', k)
      call write_checkpoint_file(folder//'a.h5', state, 3, failure)
      call expect_none(error, failure)
      if (allocated(error)) return
    end do
    do k = 1, 3
      if (k == 1) call read_checkpoint_file(folder//'a.h5', state, failure)
      if (k > 1) call read_checkpoint_file(older_checkpoint(folder//'a.h5', k - 1), state, failure)
      call expect_none(error, failure)
      if (allocated(error)) return
      call state%get('number', number)
      call check(error, number, 5 - k)
      if (allocated(error)) return
    end do
    inquire (file=older_checkpoint(folder//'a.h5', 3), exist=there)
    call check(error, .not. there, 'more are kept than were asked for')
  end subroutine test_keep

  ! ---------------------------------------------------------------------------------------------
  ! Runs
  ! ---------------------------------------------------------------------------------------------

  subroutine test_rkl2(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_same(error, square//warm//held//'&time end = 0.05 method = ''rkl2'' /'//lf, &
                     'every = 0.02', [1, 5, 11])
  end subroutine test_rkl2

  subroutine test_equal_steps(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_same(error, &
                     square//warm//held//'&time end = 0.02 method = ''runge_kutta_4'' /'//lf, &
                     'every = 0.008', [1, 2, 5])
    if (allocated(error)) return
    call expect_same(error, &
                     square//warm//held//'&time end = 0.02 method = ''forward_euler'' /'//lf &
                     //estimated, 'every = 0.008', [3, 7])
  end subroutine test_equal_steps

  subroutine test_tr_bdf2_linear(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_same(error, square//warm//'&boundary value_expression = ''t*x'' /'//lf// &
                     '&time end = 0.05 method = ''tr_bdf2'' /'//lf, 'every = 0.02', [2, 6])
  end subroutine test_tr_bdf2_linear

  subroutine test_tr_bdf2(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_same(error, square//'&initial temperature = 300 /'//lf// &
                     '&material conductivity = 20 density = 100 heat_capacity = 10 /'//lf// &
                     '&boundary on = ''all'' kind = ''radiation'' emissivity = 0.9 '// &
                     'ambient_expression = ''900+100*sin(t)'' /'//lf// &
                     '&source power_expression = ''1e4*(1+x)*exp(-0.001*(T-300))'' /'//lf// &
                     '&time end = 5 method = ''tr_bdf2'' /'//lf, 'every = 2', [2, 7, 12])
  end subroutine test_tr_bdf2

  subroutine test_exponential(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_same(error, square//warm//held//'&time end = 0.05 method = ''exponential'' /'//lf, &
                     'every = 0.011', [1, 3])
  end subroutine test_exponential

  subroutine test_melting(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: scene = square//'&initial temperature = -5 /'//lf// &
        '&material latent_heat = 10 solidus = -0.5 liquidus = 0.5 /'//lf// &
        '&boundary on = ''left'' value = 10 /'//lf// &
        '&boundary on = ''right'' kind = ''insulated'' /'//lf// &
        '&boundary on = ''top'' kind = ''insulated'' /'//lf// &
        '&boundary on = ''bottom'' kind = ''convection'' coefficient = 1 ambient = 0 /'//lf// &
        '&time end = 0.05 tolerance = 1e-5 /'//lf

    call expect_same(error, scene, 'every = 0.02', [3, 20])
    if (allocated(error)) return
    call expect_same(error, scene//estimated, 'every = 0.02', [3, 20])
  end subroutine test_melting

  !> Two materials that conduct by different laws of the temperature: their potentials jump where
  !> they touch.
  subroutine test_jumps(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: two = &
        '&material conductivity_expression = ''1+0.5*T'' /'//lf// &
        '&material conductivity_expression = ''2*exp(0.3*T)'' '// &
        'heat_capacity_expression = ''1+0.2*T'' where_expression = ''x>'

    call expect_same_with_estimate(error, square//warm//held//two//'0.5'' /'//lf, 0.02_wp)
    if (allocated(error)) return
    call expect_same(error, disc//spot//held//two//'0'' /'//lf// &
                     '&motion velocity_x_expression = ''-3*y'' '// &
                     'velocity_y_expression = ''3*x'' /'//lf//'&time end = 0.05 /'//lf, &
                     'every = 0.02', [1, 6, 13])
  end subroutine test_jumps

  subroutine test_local(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), &
        parameter :: one = '&material conductivity_expression = ''1+0.5*x*T+T^2*y^2'' /'

    call expect_same_with_estimate(error, square//warm//held//one//lf, 0.02_wp)
    if (allocated(error)) return
    call expect_same(error, disc//spot//held//one//lf//swirl//'.false. /'//lf// &
                     '&time end = 0.05 /'//lf, 'every = 0.02', [1, 6, 13])
  end subroutine test_local

  !> A sink cools the body far below what is given, so that tables of properties grow downwards.
  subroutine test_beyond(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_same_with_estimate(error, &
                                   square//warm//held//'&material conductivity_expression = '// &
                            '''1+0.3*exp(T)'' heat_capacity_expression = ''1+0.1*exp(0.5*T)'' /'// &
                            lf//'&source power_expression = ''-70*(1+x)'' /'//lf, 0.1_wp)
  end subroutine test_beyond

  !> By rkl2, which is what such materials take, and with the error estimate beside
  subroutine expect_same_with_estimate(error, scene, time)
    type(error_type), allocatable, intent(out) :: error
    !> The scene without its time and output
    character(len=*), intent(in) :: scene
    !> When it ends, s
    real(wp), intent(in) :: time
    character(len=:), allocatable :: times

    times = '&time end = '//to_text(time)//' method = ''rkl2'' /'//lf
    call expect_same(error, scene//times, 'every = '//to_text(0.4_wp*time), [2, 5])
    if (allocated(error)) return
    call expect_same(error, scene//times//estimated, 'every = '//to_text(0.4_wp*time), [2, 5])
  end subroutine expect_same_with_estimate

  subroutine test_estimate(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_same(error, square//warm//'&boundary value_expression = ''0.1*sin(40*t)'' /'//lf// &
                     '&time end = 0.05 method = ''rkl2'' /'//lf//estimated, 'every = 0.02', [1, &
                         4, 9])
  end subroutine test_estimate

  subroutine test_turning(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_same(error, disc//spot//'&boundary value_expression = ''0.1*sin(3*t)*x'' /'//lf// &
                     '&motion velocity_x_expression = ''-3*y'' '// &
                     'velocity_y_expression = ''3*x'' /'//lf//'&time end = 0.3 /'//lf, &
                     'every = 0.12', [1, 6, 13])
  end subroutine test_turning

  subroutine test_flow(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_same(error, disc//spot//exchange//swirl//'.false. /'//lf//'&time end = 0.1 /'//lf, &
                     'every = 0.04', [1, 6, 20])
  end subroutine test_flow

  subroutine test_shifting(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_same(error, disc//spot//exchange//swirl//'.true. /'//lf//'&time end = 0.1 /'//lf, &
                     'every = 0.04 fields = ''temperature'', ''row_quality''', [1, 6, 20])
  end subroutine test_shifting

  subroutine test_flow_estimate(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_same(error, &
                     disc//spot//exchange//swirl//'.false. /'//lf//'&time end = 0.06 /'//lf// &
                     estimated, 'every = 0.04', [1, 7])
    if (allocated(error)) return
    call expect_same(error, &
                     disc//spot//exchange//swirl//'.true. /'//lf//'&time end = 0.06 /'//lf// &
                     estimated, 'every = 0.04', [1, 7])
  end subroutine test_flow_estimate

  !> A run that writes a checkpoint after every step is the run that writes none.
  subroutine test_regular(error)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable :: failure
    type(simulation_t) :: simulation, other
    character(len=*), parameter :: scene = disc//spot//exchange//swirl//'.true. /'//lf// &
        '&time end = 0.06 /'//lf//estimated

    call start_over()
    call run_whole(scene, 'every = 0.04', failure, simulation)
    call expect_none(error, failure)
    if (allocated(error)) return
    call run_whole(scene//'&checkpoint every_seconds = 1e-9 file = '''//folder//'c.h5'' /'//lf, &
                   'every = 0.04', failure, other)
    call expect_none(error, failure)
    if (allocated(error)) return
    call check(error, .not. (any(abs(simulation%temperature - other%temperature) > 0) .or. &
                             any(abs(simulation%estimate%error - other%estimate%error) > 0) .or. &
                             any(abs(simulation%cloud%x - other%cloud%x) > 0)))
  end subroutine test_regular

  !> Changes that matter are told and refused; others are not.
  subroutine test_changes(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: time = '&time end = 0.05 method = ''rkl2'' /'//lf, &
        rest = square//warm//held, output = '&output file = '''//folder//'o.vtkhdf'' every = '
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    type(scene_t) :: scene

    call start_over()
    call run_until(rest//time//output//'0.02 /'//lf, 4, simulation, failure)
    call expect(error, failure, 130, 'calor run --resume')
    if (allocated(error)) return
    call try(rest//'&kernel support = 2.5 /'//lf//time//output//'0.02 /'//lf)
    call expect(error, failure, status_bad_input, '&kernel: it was not there')
    if (allocated(error)) return
    call try(rest//'&time end = 0.05 method = ''rkl2'' tolerance = 1e-5 /'//lf//output// &
             '0.02 /'//lf)
    call expect(error, failure, status_bad_input, '&time tolerance: not given, now 1e-5')
    if (allocated(error)) return
    call try(square//warm//'&boundary value = 1 /'//lf//time//output//'0.02 /'//lf)
    call expect(error, failure, status_bad_input, '&boundary value: 0, now 1')
    if (allocated(error)) return
    call try('! a remark'//lf//held//warm//square//time//'&scene title = ''a'' /'//lf// &
             output//'0.01 fields = ''temperature'', ''neighbours'' /'//lf)
    call expect_none(error, failure)

  contains

    subroutine try(text)
      character(len=*), intent(in) :: text

      call interpret_scene(text, scene, failure)
      if (.not. allocated(failure)) call simulation%resume(scene, '', failure)
    end subroutine try

  end subroutine test_changes

  !> A run that has ended goes on to a later end, as well as one that was to go there at once.
  subroutine test_later_end(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: begin = square//warm//held, &
        output = '&output file = '''//folder//'o.vtkhdf'' every = 0.01 /'//lf, &
        checkpoint = '&checkpoint keep = 2 /'//lf
    type(simulation_t) :: simulation, whole
    type(error_t), allocatable :: failure
    type(scene_t) :: scene

    call start_over()
    call interpret_scene(begin//output//checkpoint//'&time end = 0.02 method = ''rkl2'' /', scene, &
                         failure)
    call simulation%prepare(scene, failure)
    if (.not. allocated(failure)) call simulation%run(failure)
    call expect_none(error, failure)
    if (allocated(error)) return
    call interpret_scene(begin//output//checkpoint//'&time end = 0.04 method = ''rkl2'' /', scene, &
                         failure)
    call simulation%resume(scene, '', failure)
    if (.not. allocated(failure)) call simulation%run(failure)
    call expect_none(error, failure)
    if (allocated(error)) return
    call whole%prepare(scene, failure)
    call whole%advance_to(0.04_wp, failure)
    call expect_none(error, failure)
    if (allocated(error)) return
    call check(error, size(simulation%entries), 5)
    if (allocated(error)) return
    ! Both differ from the truth by steps within the tolerance, 1e-6 each of some 20.
    call check(error, maxval(abs(simulation%temperature - whole%temperature)) < 2.0e-5_wp)
    if (allocated(error)) return
    ! The output, which holds the later end by now, still goes with the checkpoint of before.
    call simulation%resume(scene, folder//'o.checkpoint.1.h5', failure)
    if (.not. allocated(failure)) call simulation%run(failure)
    call expect_none(error, failure)
    if (allocated(error)) return
    call check(error, maxval(abs(simulation%temperature - whole%temperature)) < 2.0e-5_wp)
  end subroutine test_later_end

  subroutine test_no_output(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: text = square//warm//held// &
        '&time end = 0.05 method = ''rkl2'' /'//lf//'&output file = '''//folder// &
        'o.vtkhdf'' every = 0.02 /'//lf
    type(simulation_t) :: simulation, other
    type(error_t), allocatable :: failure
    type(scene_t) :: scene

    call start_over()
    call run_until(text, 4, simulation, failure)
    call execute_command_line('rm '//folder//'o.vtkhdf')
    call interpret_scene(text, scene, failure)
    call simulation%resume(scene, '', failure)
    call expect_none(error, failure)
    if (allocated(error)) return
    call simulation%run(failure)
    call expect(error, failure, status_bad_file, 'put it back, or name another')
    if (allocated(error)) return
    ! A file of the same particles and times, but of another scene, is none either.
    call execute_command_line('mv '//folder//'o.checkpoint.h5 '//folder//'kept.h5')
    call interpret_scene(text//'&material density = 2 /', scene, failure)
    call other%prepare(scene, failure)
    if (.not. allocated(failure)) call other%run(failure)
    call expect_none(error, failure)
    if (allocated(error)) return
    call interpret_scene(text, scene, failure)
    call simulation%resume(scene, folder//'kept.h5', failure)
    call expect_none(error, failure)
    if (allocated(error)) return
    call simulation%run(failure)
    call expect(error, failure, status_bad_file, 'put it back, or name another')
  end subroutine test_no_output

  ! ---------------------------------------------------------------------------------------------
  ! The program
  ! ---------------------------------------------------------------------------------------------

  subroutine test_command(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call start_over()
    call write_text(folder//'s.nml', square//warm//held// &
                    '&time end = 1e6 method = ''forward_euler'' /'//lf// &
                    '&output file = ''o.vtkhdf'' /'//lf)
    ! By the time that it takes a signal, the file has been begun.
    call run_command('cd '//folder//'; '//program_path()//' run --quiet s.nml & '// &
                     'p=$!; for k in $(seq 600); do ls o.vtkhdf.partial >/dev/null 2>&1 && '// &
                     'break; sleep 0.05; done; sleep 0.5; kill -TERM $p; wait $p', &
                     folder//'../t', outcome)
    call check(error, outcome%status, 143, outcome%errors)
    if (allocated(error)) return
    call check(error, index(outcome%errors, 'calor run --resume s.nml') > 0, outcome%errors)
    if (allocated(error)) return
    call write_text(folder//'s.nml', square//warm//held// &
                    '&time end = 1e-3 method = ''forward_euler'' /'//lf// &
                    '&output file = ''o.vtkhdf'' /'//lf)
    call run_command('cd '//folder//' && '//program_path()//' run --resume s.nml', folder//'../t', &
                     outcome)
    call check(error, outcome%status == 0 .and. index(outcome%output, 'Resumed at t =') > 0, &
               outcome%output//outcome%errors)
    if (allocated(error)) return
    call run_command('cd '//folder//' && '//program_path()//' run --checkpoint x s.nml', &
                     folder//'../t', outcome)
    call check(error, outcome%status, 2, outcome%errors)
  end subroutine test_command

  !> A run that cannot write its checkpoint any more ends with status 4; what was written before is
  !> whole.
  subroutine test_no_room(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: text = square//warm//held//'&time end = 0.05 /'//lf
    type(outcome_t) :: outcome
    type(saved_state_t) :: state
    type(error_t), allocatable :: failure

    call start_over()
    call write_text(folder//'s.nml', text//'&checkpoint file = ''c.h5'' every_seconds = 1e-9 /'//lf)
    call run_command('cd '//folder//' && '//program_path()//' run --quiet s.nml', folder//'../t', &
                     outcome)
    call check(error, outcome%status, 0, outcome%errors)
    if (allocated(error)) return
    call run_command('cd '//folder//' && ulimit -f 4 && '//program_path()//' run --quiet s.nml', &
                     folder//'../t', outcome)
    call check(error, &
               outcome%status == 4 .and. index(outcome%errors, '''c.h5'' could not be') > 0, &
               outcome%errors)
    if (allocated(error)) return
    call read_checkpoint_file(folder//'c.h5', state, failure)
    call expect_none(error, failure)
    if (allocated(error)) return
    call write_text(folder//'s.nml', text//'&checkpoint file = ''gone/c.h5'' /'//lf)
    call run_command('cd '//folder//' && '//program_path()//' run --quiet s.nml', folder//'../t', &
                     outcome)
    call check(error, &
               outcome%status == 4 .and. index(outcome%errors, 'gone'' does not exist') > 0, &
               outcome%errors)
  end subroutine test_no_room

  ! ---------------------------------------------------------------------------------------------
  ! Tools
  ! ---------------------------------------------------------------------------------------------

  subroutine start_over()
    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder)
  end subroutine start_over

  subroutine run_whole(text, output, failure, simulation)
    character(len=*), intent(in) :: text, output
    type(error_t), allocatable, intent(out) :: failure
    type(simulation_t), intent(out) :: simulation
    type(scene_t) :: scene

    call interpret_scene(text//'&output file = '''//folder//'o.vtkhdf'' '//output//' /'//lf, &
                         scene, &
                         failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    if (.not. allocated(failure)) call simulation%run(failure)
  end subroutine run_whole

  !> Run until a step is interrupted.
  subroutine run_until(text, step, simulation, failure, resumed)
    character(len=*), intent(in) :: text
    integer, intent(in) :: step
    type(simulation_t), intent(out) :: simulation
    type(error_t), allocatable, intent(out) :: failure
    !> Whether the run goes on from a checkpoint
    logical, intent(in), optional :: resumed
    type(interrupter_t) :: interrupter
    type(scene_t) :: scene
    logical :: go_on

    go_on = .false.
    if (present(resumed)) go_on = resumed
    call interpret_scene(text, scene, failure)
    if (allocated(failure)) return
    if (go_on) then
      call simulation%resume(scene, '', failure)
    else
      call simulation%prepare(scene, failure)
    end if
    if (allocated(failure)) return
    interrupter%at = step
    call watch_for_interrupt()
    call simulation%run(failure, interrupter)
    call stop_watching()
  end subroutine run_until

  !> A run that is interrupted at some steps and resumed each time writes the same bytes as one that
  !> is not, but for the wall times.
  subroutine expect_same(error, scene, output, steps)
    type(error_type), allocatable, intent(out) :: error
    !> The scene without its output
    character(len=*), intent(in) :: scene
    !> Further keys of &output
    character(len=*), intent(in) :: output
    !> The steps that are interrupted, in rising order
    integer, intent(in) :: steps(:)
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure
    integer :: k

    call start_over()
    call run_whole(scene, output, failure, simulation)
    call expect_none(error, failure)
    if (allocated(error)) return
    call execute_command_line('cd '//folder//' && mv o.vtkhdf whole.vtkhdf')
    do k = 1, size(steps) + 1
      call run_until(scene//'&output file = '''//folder//'o.vtkhdf'' '//output//' /'//lf, &
                     limit(k), simulation, failure, resumed=k > 1)
      if (k <= size(steps)) then
        call expect(error, failure, 130, 'Interrupted')
      else
        call expect_none(error, failure)
      end if
      if (allocated(error)) return
    end do
    call expect_equal_files(error, scene)

  contains

    pure function limit(k) result(step)
      integer, intent(in) :: k
      integer :: step

      step = huge(step)
      if (k <= size(steps)) step = steps(k)
    end function limit

  end subroutine expect_same

  !> Every byte is the same but for the wall times.
  subroutine expect_equal_files(error, scene)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: scene

    call zero_wall_times(folder//'whole.vtkhdf')
    call zero_wall_times(folder//'o.vtkhdf')
    call check(error, contents_of(folder//'whole.vtkhdf') == contents_of(folder//'o.vtkhdf'), &
               'the files differ: '//scene)
  end subroutine expect_equal_files

  subroutine expect_none(error, failure)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable, intent(in) :: failure

    if (allocated(failure)) call test_failed(error, failure%message)
  end subroutine expect_none

  subroutine expect(error, failure, status, words)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable, intent(in) :: failure
    integer, intent(in) :: status
    character(len=*), intent(in) :: words

    if (.not. allocated(failure)) then
      call test_failed(error, 'no error; expected: '//words)
    else
      call check(error, failure%status == status .and. index(failure%message, words) > 0, &
                 failure%message)
    end if
  end subroutine expect

end module test_checkpoint
