!> The study of convergence: budgets that add up, orders as theory has them, files, bad input.
module test_convergence_study
  use calor_convergence_description, only: conclusion, describe_convergence
  use calor_convergence_files, only: convergence_pictures, draw_convergence, write_convergence
  use calor_convergence_schemes, only: gradient_family, laplacian_family, study_scheme_t, &
                                       study_schemes
  use calor_convergence_study, only: convergence_study_t, convergence_watcher_t, usual_scene
  use calor_convergence_theory, only: fixed_ratio, fixed_spacing, growing_ratio, irregular_cloud, &
                                      is_order, kernel_smoothness, predicted_order, &
                                      regular_cloud, term_order
  use calor_error, only: error_t
  use calor_gradient_schemes, only: gradient_choices
  use calor_kernel, only: kernel_t
  use calor_kernels, only: make_kernel
  use calor_kinds, only: wp
  use calor_laplacian_schemes, only: laplacian_choices
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene
  use calor_study_field, only: derivative_count, derivative_index, study_field_t
  use calor_text, only: text_t
  use test_process, only: contents_of, environment_or, line_count, outcome_t, run_command, &
                          write_text
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_convergence_study

  character(len=*), parameter :: folder = 'build/test/convergence/', end = new_line('a')

  type, extends(convergence_watcher_t) :: noting_watcher_t
    real(wp) :: last = 0.0_wp
    logical :: falls = .false.
  contains
    procedure :: advanced
  end type noting_watcher_t

contains

  subroutine collect_convergence_study(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('all schemes of the tables take part', test_schemes), &
                new_unittest('predicted orders', test_predictions), &
                new_unittest('smoothness of kernels', test_smoothness), &
                new_unittest('differences are derivatives', test_differences), &
                new_unittest('budgets add up to the error', test_budget), &
                new_unittest('measured orders are those of theory', test_orders), &
                new_unittest('odd terms of consistent schemes', test_odd_terms), &
                new_unittest('the paper''s conclusion', test_conclusion), &
                new_unittest('a field of one''s own', test_own_field), &
                new_unittest('rounding is no order', test_rounding), &
                new_unittest('files', test_files), &
                new_unittest('the command', test_command), &
                new_unittest('what is refused', test_refusals) &
                ]
  end subroutine collect_convergence_study

  subroutine advanced(this, part)
    class(noting_watcher_t), intent(inout) :: this
    real(wp), intent(in) :: part

    if (part <= this%last) this%falls = .true.
    this%last = part
  end subroutine advanced

  !> The study on a scene, or the usual one.
  subroutine measure(study, levels, error, scene_text, schemes)
    type(convergence_study_t), intent(out) :: study
    integer, intent(in) :: levels
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in), optional :: scene_text
    type(study_scheme_t), intent(in), optional :: schemes(:)
    type(scene_t) :: scene
    type(error_t), allocatable :: failure

    call interpret_scene(usual_scene, scene, failure)
    if (present(scene_text)) call interpret_scene(scene_text, scene, failure)
    if (.not. allocated(failure)) call study%evaluate(failure, scene, levels, schemes=schemes)
    if (allocated(failure)) call test_failed(error, failure%message)
  end subroutine measure

  pure function number_of(study, family, name) result(k)
    type(convergence_study_t), intent(in) :: study
    integer, intent(in) :: family
    character(len=*), intent(in) :: name
    integer :: k

    do k = 1, size(study%schemes)
      if (study%schemes(k)%family == family .and. study%schemes(k)%name == name) return
    end do
  end function number_of

  subroutine test_schemes(error)
    type(error_type), allocatable, intent(out) :: error
    type(study_scheme_t), allocatable :: schemes(:)
    integer :: k

    schemes = study_schemes()
    do k = 1, size(gradient_choices)
      call check(error, any(schemes%family == gradient_family .and. &
                            schemes%name == gradient_choices(k)%name), gradient_choices(k)%name)
      if (allocated(error)) return
    end do
    do k = 1, size(laplacian_choices)
      call check(error, any(schemes%family == laplacian_family .and. &
                            schemes%name == laplacian_choices(k)%name), laplacian_choices(k)%name)
      if (allocated(error)) return
    end do
  end subroutine test_schemes

  !> The orders that docs/convergence.md derives, for a kernel that ends as (1 - q)⁴
  subroutine test_predictions(error)
    type(error_type), allocatable, intent(out) :: error
    ! A column for each scheme of the tables: regular a, b, c, irregular a, b, c
    character(len=24), parameter :: name(*) = [character(len=24) :: 'standard', 'difference', &
        'sum', 'renormalized', 'kernel_second_derivative', 'double_gradient', 'brookshaw', &
        'brookshaw_renormalized', 'fatehi_manzari', 'positive']
    real(wp), parameter :: expected(6, size(name)) = reshape([real(wp) :: &
        0.0, 2.0, -4.5, -1.0, 1.0, -3.0, &
        0.0, 2.0, -4.5, 0.0, 2.0, -2.0, &
        0.0, 2.0, -4.5, -1.0, 1.0, -3.0, &
        2.0, 2.0, 2.0, 1.0, 2.0, -1.0, &
        0.0, 2.0, -3.5, -1.0, 1.0, -3.0, &
        2.0, 2.0, 2.0, 0.0, 2.0, -2.0, &
        0.0, 2.0, -4.5, -1.0, 1.0, -3.0, &
        2.0, 2.0, 2.0, -1.0, 1.0, -3.0, &
        2.0, 2.0, 2.0, 1.0, 2.0, -1.0, &
        2.0, 4.0, 0.0, 1.0, 2.0, 0.0], [6, size(name)])
    type(study_scheme_t), allocatable :: schemes(:)
    integer :: cloud, k, m, way

    schemes = study_schemes()
    do k = 1, size(name)
      do m = 1, size(schemes)
        if (schemes(m)%name == name(k)) exit
      end do
      do cloud = regular_cloud, irregular_cloud
        do way = fixed_ratio, fixed_spacing
          call check(error, predicted_order(schemes(m), 4, cloud, way), &
                     expected(3*(cloud - 1) + way, k), name(k), thr=1.0e-12_wp)
          if (allocated(error)) return
        end do
      end do
    end do
    ! Order p everywhere: what comes after the first term never overtakes it, though its own order
    ! may be less.
    schemes = pack(schemes, schemes%name == 'consistent')
    call check(error, all(schemes%order == [2, 4, 6, 8, 2, 4, 6, 8]))
    if (allocated(error)) return
    do k = 1, size(schemes)
      associate (p => schemes(k)%order, second => schemes(k)%exact_degree + 2)
        do cloud = regular_cloud, irregular_cloud
          do way = fixed_ratio, fixed_spacing
            call check(error, predicted_order(schemes(k), 4, cloud, way), real(p, wp), &
                       schemes(k)%label(), thr=1.0e-12_wp)
            if (allocated(error)) return
          end do
        end do
        call check(error, .not. is_order(term_order(schemes(k), second, 4, regular_cloud, 1)))
        if (allocated(error)) return
        call check(error, all(nint([(term_order(schemes(k), second, 4, irregular_cloud, way), &
                                     way=fixed_ratio, fixed_spacing)]) == [p + 1, p + 3, p - 1]))
        if (allocated(error)) return
      end associate
    end do
    ! Exact for quartics: T5 is the first term, which cancels where neighbours do
    associate (quartic => study_scheme_t(family=2, name='quartic', understood=.true., &
                                         exact_degree=4, lattice_degree=4))
      call check(error, predicted_order(quartic, 4, regular_cloud, fixed_ratio), 4.0_wp)
      if (allocated(error)) return
      call check(error, predicted_order(quartic, 4, irregular_cloud, fixed_ratio), 3.0_wp)
      if (allocated(error)) return
      call check(error, predicted_order(quartic, 4, irregular_cloud, growing_ratio), 4.0_wp)
      if (allocated(error)) return
    end associate
    ! A scheme that nobody has analysed is measured, but nothing is predicted.
    call check(error, .not. is_order(predicted_order(study_scheme_t(family=2, name='mine'), 4, 1, &
                                                     1)))
  end subroutine test_predictions

  subroutine test_smoothness(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=14), parameter :: name(*) = [character(len=14) :: 'cubic_spline', &
        'quintic_spline', 'wendland_c2', 'wendland_c4', 'wendland_c6']
    integer, parameter :: expected(*) = [3, 5, 4, 6, 8]
    class(kernel_t), allocatable :: kernel
    type(error_t), allocatable :: failure
    integer :: k

    do k = 1, size(name)
      call make_kernel(trim(name(k)), kernel, failure)
      call check(error, kernel_smoothness(kernel), expected(k), name(k))
      if (allocated(error)) return
    end do
  end subroutine test_smoothness

  !> The same field, once by its own derivatives and once by differences
  subroutine test_differences(error)
    type(error_type), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(study_field_t) :: own, given
    type(error_t), allocatable :: failure
    real(wp), parameter :: x(2) = [0.3_wp, 0.7_wp], y(2) = [0.6_wp, 0.35_wp]
    real(wp) :: expected(0:14, 2), found(0:14, 2), gradient(2, 2), laplacian(2, 1), short(0:14, 2)

    call interpret_scene(usual_scene, scene, failure)
    call own%take(scene, [0.0_wp, 0.0_wp], 1.0_wp, 0.3_wp)
    call own%derivatives(x, y, 4, expected, failure)
    ! By hand: ∂⁴u/∂x∂y³ = -8 exp(x) cos(2y)
    call check(error, expected(derivative_index(1, 3), 1), -8*exp(x(1))*cos(2*y(1)), &
               thr=1.0e-12_wp)
    if (allocated(error)) return
    call interpret_scene(usual_scene//' &operators field_expression = ''exp(x)*sin(2*y)'' '// &
                         'exact_laplacian_expression = ''7'' /', scene, failure)
    call given%take(scene, [0.0_wp, 0.0_wp], 1.0_wp, 0.3_wp)
    call given%derivatives(x, y, 4, found, failure)
    call check(error, derivative_count(4), size(found, 1))
    if (allocated(error)) return
    call check(error, maxval(abs(found - expected)) < 1.0e-7_wp, 'differences')
    if (allocated(error)) return
    ! By hand: ∂³u/∂x²∂y = -12² 16 sin(12x) cos(16y)
    own%short_waves = .true.
    call own%derivatives(x, y, 4, short, failure)
    call check(error, short(derivative_index(2, 1), 1), -2304*sin(12*x(1))*cos(16*y(1)), &
               thr=1.0e-9_wp)
    if (allocated(error)) return
    call given%exact_derivative(x, y, found, 1, gradient, failure)
    call check(error, maxval(abs(gradient(:, 2) - 2*exp(x)*cos(2*y))) < 1.0e-11_wp, 'gradient')
    if (allocated(error)) return
    call given%exact_derivative(x, y, found, 2, laplacian, failure)
    call check(error, maxval(abs(laplacian - 7)) <= 0, 'the scene''s Laplacian was not taken')
  end subroutine test_differences

  !> At every measurement the sum of the terms is the error: particle by particle, for what is left
  !> is small; and the terms are those that theory allows.
  subroutine test_budget(error)
    type(error_type), allocatable, intent(out) :: error
    type(convergence_study_t) :: study
    type(study_scheme_t), allocatable :: schemes(:)
    integer :: cloud, k, level, way

    schemes = study_schemes()
    call measure(study, 3, error, schemes=pack(schemes, schemes%order <= 2 .or. &
                                                       schemes%order == 8))
    if (allocated(error)) return
    do k = 1, size(study%schemes)
      do cloud = regular_cloud, irregular_cloud
        do way = fixed_ratio, fixed_spacing
          do level = 1, 3
            associate (found => study%curve(way, cloud, k)%level(level))
              call check(error, found%total/found%error, 1.0_wp, study%schemes(k)%label(), &
                         thr=0.005_wp)
              if (allocated(error)) return
              call check(error, found%remainder < 0.01_wp*found%error, study%schemes(k)%label())
              if (allocated(error)) return
              if (study%schemes(k)%exact_degree >= 0) then
                call check(error, maxval(found%term(:study%schemes(k)%exact_degree)) < &
                           1.0e-8_wp, 'not exact: '//study%schemes(k)%label())
                if (allocated(error)) return
              end if
            end associate
          end do
        end do
      end do
    end do
  end subroutine test_budget

  !> Orders are as expected wherever sums over the particles do not oscillate with h/Δ, which they
  !> do on lattices.
  subroutine test_orders(error)
    type(error_type), allocatable, intent(out) :: error
    type(study_scheme_t), allocatable :: schemes(:)

    schemes = study_schemes()
    call expect_orders(error, pack(schemes, schemes%order <= 2), 4)
    if (allocated(error)) return
    call expect_orders(error, pack(schemes, schemes%order == 4 .or. schemes%order == 8), 3)
  end subroutine test_orders

  subroutine expect_orders(error, schemes, levels)
    type(error_type), allocatable, intent(out) :: error
    type(study_scheme_t), intent(in) :: schemes(:)
    integer, intent(in) :: levels
    type(convergence_study_t) :: study
    integer :: cloud, k, way

    call measure(study, levels, error, schemes=schemes)
    if (allocated(error)) return
    do k = 1, size(study%schemes)
      if (.not. study%schemes(k)%understood) cycle
      do cloud = regular_cloud, irregular_cloud
        do way = fixed_ratio, fixed_spacing
          associate (curve => study%curve(way, cloud, k))
            if (cloud == regular_cloud .and. way /= fixed_ratio .and. &
                study%schemes(k)%lattice_degree < study%schemes(k)%family) cycle
            call check(error, curve%fitted, curve%expected, study%schemes(k)%label(), &
                       thr=0.5_wp)
            if (allocated(error)) return
            if (way /= fixed_ratio) cycle
            call check(error, curve%fitted, curve%predicted, study%schemes(k)%label(), &
                       thr=0.2_wp)
            if (allocated(error)) return
          end associate
        end do
      end do
    end do
  end subroutine expect_orders

  !> The second term of a consistent scheme, there on irregular clouds only, has the order that
  !> sums over jittered lattices give it: in the error it is too small to be seen.
  subroutine test_odd_terms(error)
    type(error_type), allocatable, intent(out) :: error
    type(convergence_study_t) :: study
    type(study_scheme_t), allocatable :: schemes(:)
    real(wp) :: first, last, length
    integer :: k, second, way

    schemes = study_schemes()
    call measure(study, 4, error, schemes=pack(schemes, schemes%order == 4))
    if (allocated(error)) return
    do k = 1, size(study%schemes)
      second = study%schemes(k)%exact_degree + 2
      do way = fixed_ratio, fixed_spacing
        associate (level => study%curve(way, irregular_cloud, k)%level)
          first = level(1)%term(second)
          last = level(4)%term(second)
          length = level(4)%radius/level(1)%radius
          call check(error, log(last/first)/log(length), &
                     term_order(study%schemes(k), second, 4, irregular_cloud, way), thr=0.4_wp)
          if (allocated(error)) return
          call check(error, last < 0.05_wp*level(4)%error)
          if (allocated(error)) return
        end associate
      end do
    end do
  end subroutine test_odd_terms

  subroutine test_conclusion(error)
    type(error_type), allocatable, intent(out) :: error
    type(convergence_study_t) :: study
    type(study_scheme_t), allocatable :: schemes(:)
    type(text_t), allocatable :: lines(:)
    character(len=:), allocatable :: sentence
    integer :: k

    schemes = study_schemes()
    call measure(study, 3, error, schemes=pack(schemes, schemes%order <= 2))
    if (allocated(error)) return
    sentence = conclusion(study, gradient_family)
    call check(error, index(sentence, ', only renormalized (1.0) converges;') > 0, sentence)
    if (allocated(error)) return
    call check(error, index(sentence, 'grows for standard (-1.0) and sum (-1.0)') > 0, sentence)
    if (allocated(error)) return
    call check(error, index(sentence, 'growing, all converge: standard') > 0, sentence)
    if (allocated(error)) return
    call check(error, index(sentence, 'Of the others, with h/spacing fixed, consistent 2 '// &
                            '(2.0) converges.') > 0, sentence)
    if (allocated(error)) return
    sentence = conclusion(study, laplacian_family)
    call check(error, index(sentence, ', only fatehi_manzari (1.0) converges;') > 0, sentence)
    if (allocated(error)) return
    call check(error, index(sentence, 'Of the others, with h/spacing fixed, all converge: '// &
                            'positive (1.0) and consistent 2 (2.0).') > 0, sentence)
    if (allocated(error)) return
    call check(error, index(sentence, 'stands still for double_gradient (') > 0, sentence)
    if (allocated(error)) return
    ! The sentence is of the measurements, not of the names.
    k = number_of(study, laplacian_family, 'brookshaw')
    study%curve(fixed_ratio, irregular_cloud, k)%fitted = 1.7_wp
    sentence = conclusion(study, laplacian_family)
    call check(error, index(sentence, 'only brookshaw (1.7) and fatehi_manzari (') > 0, sentence)
    if (allocated(error)) return
    lines = describe_convergence(study)
    do k = 1, size(lines)
      call check(error, len(lines(k)%value) <= 100, lines(k)%value)
      if (allocated(error)) return
    end do
  end subroutine test_conclusion

  subroutine test_own_field(error)
    type(error_type), allocatable, intent(out) :: error
    type(convergence_study_t) :: study, own
    type(study_scheme_t), allocatable :: asked(:)
    character(len=*), parameter :: schemes = &
        ' gradients = ''renormalized'' laplacians = ''fatehi_manzari'' /'
    integer :: k

    asked = study_schemes()
    asked = pack(asked, asked%name == 'renormalized' .or. asked%name == 'fatehi_manzari')
    call measure(own, 3, error, schemes=asked)
    if (allocated(error)) return
    call measure(study, 3, error, &
                 usual_scene//' &operators field_expression = ''exp(x)*sin(2*y)'''//schemes)
    if (allocated(error)) return
    call check(error, size(study%schemes), 2)
    if (allocated(error)) return
    k = number_of(own, laplacian_family, 'fatehi_manzari')
    call check(error, study%curve(1, 2, 2)%level(3)%error, own%curve(1, 2, k)%level(3)%error, &
               thr=1.0e-6_wp, rel=.true.)
    if (allocated(error)) return
    call check(error, study%curve(1, 2, 2)%level(3)%total, own%curve(1, 2, k)%level(3)%total, &
               thr=1.0e-6_wp, rel=.true.)
    if (allocated(error)) return
    ! A domain elsewhere and of another size, hexagonal, with another kernel; the order is the same
    call measure(study, 3, error, '&domain x_range = 1e-6, 3e-6 y_range = 0, 1e-6 '// &
                 'spacing = 5e-8 arrangement = ''hexagonal'' / &kernel name = '// &
                 '''cubic_spline'' support = 2.5 / &operators field_expression = '// &
                 '''sin(pi*x/1e-6)*sin(pi*y/1e-6)'''//schemes)
    if (allocated(error)) return
    call check(error, study%cloud_name(regular_cloud), 'hexagonal')
    if (allocated(error)) return
    call check(error, study%curve(fixed_ratio, regular_cloud, 2)%fitted, 2.0_wp, thr=0.1_wp)
  end subroutine test_own_field

  !> A linear field: what is exact for it has no order; what is not keeps its own.
  subroutine test_rounding(error)
    type(error_type), allocatable, intent(out) :: error
    type(convergence_study_t) :: study

    call measure(study, 3, error, usual_scene//' &operators field_expression = '// &
                 '''1 + 2*x - y'' gradients = ''renormalized'', ''difference'' '// &
                 'laplacians = ''fatehi_manzari'' exact_gradient_x_expression = ''2'' '// &
                 'exact_gradient_y_expression = ''-1'' exact_laplacian_expression = ''1'' /')
    if (allocated(error)) return
    associate (difference => study%curve(fixed_ratio, irregular_cloud, &
                                         number_of(study, gradient_family, 'difference')), &
               exact => study%curve(fixed_ratio, irregular_cloud, &
                                    number_of(study, gradient_family, 'renormalized')))
      call check(error, all(exact%level%rounded) .and. .not. is_order(exact%fitted))
      if (allocated(error)) return
      call check(error, .not. any(difference%level%rounded))
      if (allocated(error)) return
      call check(error, difference%fitted, 0.0_wp, thr=0.2_wp)
      if (allocated(error)) return
    end associate
    call check(error, index(conclusion(study, gradient_family), &
                            'no error but rounding for renormalized') > 0)
    if (allocated(error)) return
    ! Of a family that was not measured there is nothing to say.
    study%schemes%family = gradient_family
    call check(error, conclusion(study, laplacian_family), '')
  end subroutine test_rounding

  subroutine test_files(error)
    type(error_type), allocatable, intent(out) :: error
    type(convergence_study_t) :: study
    type(error_t), allocatable :: failure
    type(scene_t) :: scene
    type(noting_watcher_t) :: watcher
    type(study_scheme_t), allocatable :: schemes(:)
    character(len=:), allocatable :: text
    integer :: k

    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder)
    call interpret_scene(usual_scene, scene, failure)
    schemes = study_schemes()
    call study%evaluate(failure, scene, 2, watcher, pack(schemes, schemes%order == 0 .or. &
                                                         schemes%order == 8))
    call check(error, .not. allocated(failure))
    if (allocated(error)) return
    call check(error, watcher%last >= 1 .and. .not. watcher%falls, 'the watcher was not told')
    if (allocated(error)) return
    call write_convergence(study, folder//'a.csv', failure)
    call check(error, .not. allocated(failure))
    if (allocated(error)) return
    text = contents_of(folder//'a.csv')
    call check(error, index(text, ',"exp(x)*sin(2*y)"'//end) > 0 .and. &
               index(text, ',"sin(12*x)*sin(16*y)"'//end) > 0, 'fields')
    if (allocated(error)) return
    call check(error, line_count(text), 1 + size(study%schemes)*3*2*2)
    if (allocated(error)) return
    call check(error, index(text, 'scheme,scheme_order,derivative,cloud,refinement,spacing'), 1)
    if (allocated(error)) return
    call check(error, index(text, end//'fatehi_manzari,,laplacian,irregular,growing_ratio,') > 0)
    if (allocated(error)) return
    do k = 1, size(convergence_pictures)
      call draw_convergence(study, folder//convergence_pictures(k), failure)
      if (allocated(failure)) call test_failed(error, failure%message)
      if (allocated(error)) return
    end do
    text = contents_of(folder//'convergence.svg')
    call check(error, index(text, '</svg>') > 0 .and. index(text, 'fatehi_manzari') > 0)
    if (allocated(error)) return
    call check(error, index(contents_of(folder//'convergence.png'), 'IEND') > 0)
    if (allocated(error)) return
    call draw_convergence(study, folder//'nowhere/a.svg', failure)
    call check(error, allocated(failure))
  end subroutine test_files

  !> The program itself: with a scene, without gnuplot, and with something in the way.
  subroutine test_command(error)
    type(error_type), allocatable, intent(out) :: error
    type(outcome_t) :: outcome

    call execute_command_line('rm -rf '//folder//' && mkdir -p '//folder//'bin')
    call write_text(folder//'scene.nml', usual_scene//' &operators field_expression = '// &
                    '''x^3 + y^4'' gradients = ''renormalized'' laplacians = ''positive'' /')
    call calor('scene.nml', outcome)
    call check(error, outcome%status, 0, outcome%errors)
    if (allocated(error)) return
    call check(error, index(outcome%output, 'x^3 + y^4') > 0 .and. &
               index(outcome%output, 'Laplacian positive') > 0 .and. &
               index(outcome%output, 'convergence.png') > 0, outcome%output)
    if (allocated(error)) return
    call check(error, index(outcome%output, 'Measuring'), 0, 'progress where nobody watches')
    if (allocated(error)) return
    call execute_command_line('cd '//folder//' && rm *.svg *.csv')
    call calor('scene.nml', outcome, 'PATH=/nowhere')
    call check(error, outcome%status, 4, outcome%errors)
    if (allocated(error)) return
    call check(error, index(outcome%errors, 'apt install gnuplot') > 0, outcome%errors)
    if (allocated(error)) return
    call check(error, line_count(outcome%errors), 1, outcome%errors)
    if (allocated(error)) return
    call check(error, index(contents_of(folder//'convergence.csv'), 'positive') > 0)
    if (allocated(error)) return
    call execute_command_line('mkdir '//folder//'convergence.svg')
    call calor('scene.nml', outcome)
    call check(error, outcome%status, 4, outcome%errors)
    if (allocated(error)) return
    call check(error, index(outcome%errors, 'convergence.svg') > 0 .and. &
               line_count(outcome%errors) == 1 .and. outcome%output == '', outcome%errors)
  end subroutine test_command

  subroutine calor(arguments, outcome, setting)
    character(len=*), intent(in) :: arguments
    type(outcome_t), intent(out) :: outcome
    character(len=*), intent(in), optional :: setting
    character(len=:), allocatable :: program

    program = environment_or('CALOR_PROGRAM', 'bin/calor')
    if (program(1:1) /= '/') program = '../../../'//program
    if (present(setting)) program = 'env '//setting//' '//program
    call run_command('cd '//folder//' && '//program//' convergence '//arguments, &
                     folder//'../convergence_called', outcome)
  end subroutine calor

  subroutine test_refusals(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_refusal(error, '&domain shape = ''cloud'' file = ''a.csv'' /', &
                        'refines|file')
    if (allocated(error)) return
    call expect_refusal(error, '&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.2 /', &
                        'lower &domain spacing')
    if (allocated(error)) return
    call expect_refusal(error, usual_scene//' &operators field_expression = ''3'' /', &
                        'first derivatives|vanish')
    if (allocated(error)) return
    call expect_refusal(error, usual_scene//' &operators field_expression = ''x - y'' /', &
                        'second derivatives|vanish')
    if (allocated(error)) return
    call expect_refusal(error, usual_scene//' &operators field_expression = ''1/(x-0.5)'' /', &
                        'gives no number')
    if (allocated(error)) return
    call expect_refusal(error, '&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.05 '// &
                        'arrangement = ''jittered'' / &kernel support = 0.9 /', 'no neighbour')
  end subroutine test_refusals

  subroutine expect_refusal(error, scene_text, words)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: scene_text
    !> Parted by |
    character(len=*), intent(in) :: words
    type(convergence_study_t) :: study
    type(scene_t) :: scene
    type(error_t), allocatable :: failure
    integer :: start, length

    call interpret_scene(scene_text, scene, failure)
    if (.not. allocated(failure)) call study%evaluate(failure, scene, 2)
    call check(error, allocated(failure), 'this should be refused: '//scene_text)
    start = 1
    do while (start <= len(words) .and. .not. allocated(error))
      length = index(words(start:)//'|', '|') - 1
      call check(error, index(failure%message, words(start:start + length - 1)) > 0, &
                 failure%message)
      start = start + length + 1
    end do
  end subroutine expect_refusal

end module test_convergence_study
