!> How the errors of all derivative schemes fall, or do not, when a cloud is refined:
!> `calor convergence`.
!>
!> Three ways of refining make a triangle in the plane of spacing Δ and support radius h. From a
!> coarse start (Δ₀, h₀), `fixed_ratio` goes to (Δ₀/f, h₀/f) and `growing_ratio`, with h ~ √Δ, to
!> (Δ₀/f, h₀/√f); `fixed_spacing` goes from the end of the second to that of the first. Errors are
!> measured at the same places of the domain throughout: farther than 2 h₀ from the walls, so that
!> every support is whole. The analysis is that of R. Fatehi, M.T. Manzari, Comput. Math. Appl. 61
!> (2011) 482–498.
module calor_convergence_study
  use calor_cloud, only: cloud_t
  use calor_constants, only: pi
  use calor_convergence_schemes, only: study_scheme_t, study_schemes, gradient_family
  use calor_convergence_theory, only: fixed_ratio, growing_ratio, fixed_spacing, irregular_cloud, &
                                      is_order, kernel_smoothness, no_order, predicted_order, &
                                      regular_cloud, term_order
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kernel, only: kernel_t
  use calor_kernels, only: make_kernel
  use calor_kinds, only: wp, ip
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_scene, only: scene_t
  use calor_scene_cloud, only: make_scene_cloud, require_neighbours
  use calor_scene_reader, only: interpret_scene
  use calor_sparse_operator, only: sparse_operator_t
  use calor_study_field, only: study_field_t, derivative_count, derivative_index
  use calor_text, only: text_t, to_text
  use calor_truncation_budget, only: row_magnitudes, truncation_terms, wanted_moments
  implicit none (type, external)
  private

  public :: convergence_study_t, convergence_watcher_t, convergence_curve_t, measurement_t, &
            usual_scene

  !> What is studied without a scene
  character(len=*), parameter :: usual_scene = &
      '&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.0714285714285714 '// &
      'arrangement = ''jittered'' jitter = 0.2 / &kernel name = ''wendland_c2'' support = 2.1 /'
  !> Displacement on irregular clouds where the scene's own has none, in spacings
  real(wp), parameter :: usual_jitter = 0.2_wp
  !> Clouds from the coarsest to the finest, each of half the spacing
  integer, parameter :: usual_levels = 5, most_levels = 7
  !> The fit takes the finest measurements, which are nearest to the limit
  integer, parameter :: fitted_levels = 3
  !> So many supports stay between walls and the places where errors are measured: the reach of
  !> the farthest scheme
  real(wp), parameter :: clearance = 2.0_wp
  !> On a cloud, errors are measured at up to so many particles …
  integer, parameter :: most_rows = 4000
  !> … but fewer where supports are wide, at so many neighbours in all, and p times fewer for
  !> consistent schemes of order p, whose rows are dear and err alike …
  real(wp), parameter :: enough_neighbours = 2.0e5_wp
  !> … and on as many different irregular clouds as give some rows, but no more than a few
  integer, parameter :: enough_rows = 1000, most_clouds = 16
  !> The fewest rows to speak of a mean
  integer, parameter :: fewest_rows = 9
  !> An error within so many rounding errors of 0 says nothing of the scheme
  real(wp), parameter :: rounding_margin = 30.0_wp

  !> What was measured of a scheme at one spacing and support radius; errors and terms are root mean
  !> squares over the rows, divided by that of the true derivative
  type :: measurement_t
    !> m
    real(wp) :: spacing = 0.0_wp, radius = 0.0_wp
    !> Particles within the support, on average
    real(wp) :: neighbours = 0.0_wp
    !> Number of rows, over all clouds
    integer :: rows = 0
    !> Error; its terms by degree, from 0 on; their sum; and what the sum leaves of the error
    real(wp) :: error = 0.0_wp, total = 0.0_wp, remainder = 0.0_wp
    real(wp), allocatable :: term(:)
    !> Whether the error is no more than rounding
    logical :: rounded = .false.
    !> Order of the error since the measurement before, or `no_order`
    real(wp) :: order = no_order
  end type measurement_t

  !> One scheme on one kind of cloud, refined one way
  type :: convergence_curve_t
    !> From the coarsest to the finest
    type(measurement_t), allocatable :: level(:)
    !> Order by least squares over the last measurements, or `no_order`
    real(wp) :: fitted = no_order
    !> Order by theory in the limit; and where it was measured: the mean over the terms, by the
    !> part that each has in the error
    real(wp) :: predicted = no_order, expected = no_order
  end type convergence_curve_t

  !> What wants to know how far a study has come extends this
  type, abstract :: convergence_watcher_t
  contains
    procedure(advanced_interface), deferred :: advanced
  end type convergence_watcher_t

  abstract interface
    !> Some more has been measured.
    subroutine advanced_interface(this, part)
      import :: convergence_watcher_t, wp
      implicit none (type, external)
      class(convergence_watcher_t), intent(inout) :: this
      !> How much of the whole, 0 to 1
      real(wp), intent(in) :: part
    end subroutine advanced_interface
  end interface

  !> The study
  type :: convergence_study_t
    !> Where domain, kernel, coarsest spacing and field are from
    type(scene_t) :: scene
    !> All pairs of scheme and order
    type(study_scheme_t), allocatable :: schemes(:)
    !> By way, cloud and scheme
    type(convergence_curve_t), allocatable :: curve(:, :, :)
    !> What the regular and the irregular cloud are
    character(len=40) :: cloud_name(2) = ''
    !> The field, as an expression, of each scheme
    type(text_t), allocatable :: field(:)
  contains
    !> Measure all of it
    procedure :: evaluate
    !> The field, or both, as expressions
    procedure :: field_in_words
  end type convergence_study_t

  !> One cloud with the rows to be measured on it
  type :: sample_t
    type(cloud_t) :: cloud
    !> Positions of particles far enough from walls
    integer(ip), allocatable :: core(:)
    !> The field at all particles
    real(wp), allocatable :: u(:)
  end type sample_t

  !> Sums of squares over rows, of which measurements become
  type :: tally_t
    integer :: rows = 0
    real(wp) :: neighbours = 0, error = 0, total = 0, remainder = 0, exact = 0, second = 0
    real(wp) :: rounding = 0, field = 0
    real(wp), allocatable :: term(:)
  end type tally_t

contains

  subroutine evaluate(this, error, scene, levels, watcher, schemes)
    class(convergence_study_t), intent(out) :: this
    !> The scene cannot be refined, or something in it is wrong
    type(error_t), allocatable, intent(out) :: error
    !> Domain, kernel, support and field; its spacing is the coarsest. Without it `usual_scene`
    type(scene_t), intent(in), optional :: scene
    !> Number of spacings, 2 to 7; 5 without it
    integer, intent(in), optional :: levels
    !> Is told how far the study has come
    class(convergence_watcher_t), intent(inout), optional :: watcher
    !> What is measured; without it all of `study_schemes`, or of these what the scene names
    type(study_scheme_t), intent(in), optional :: schemes(:)
    class(kernel_t), allocatable :: kernel
    type(study_field_t) :: field
    type(tally_t), allocatable :: tally(:, :, :)
    integer :: count, cloud, level, scheme, way

    count = usual_levels
    if (present(levels)) count = max(2, min(levels, most_levels))
    call interpret_scene(usual_scene, this%scene, error)
    if (present(scene)) this%scene = scene
    if (.not. allocated(error)) call refuse_scene(this%scene, error)
    if (.not. allocated(error)) call make_kernel(this%scene%kernel, kernel, error)
    if (.not. allocated(error)) call take_field(this%scene, kernel, field, error)
    if (allocated(error)) return
    if (present(schemes)) then
      this%schemes = schemes
    else
      this%schemes = asked_schemes(this%scene)
    end if
    allocate (this%field(size(this%schemes)))
    allocate (this%curve(fixed_spacing, irregular_cloud, size(this%schemes)))
    allocate (tally(count, fixed_spacing, size(this%schemes)))
    do cloud = regular_cloud, irregular_cloud
      this%cloud_name(cloud) = cloud_name(this%scene, cloud)
      do scheme = 1, size(this%schemes)
        field%short_waves = this%schemes(scheme)%short_waves
        this%field(scheme)%value = field%source()
        do way = fixed_ratio, fixed_spacing
          allocate (this%curve(way, cloud, scheme)%level(count))
          this%curve(way, cloud, scheme)%predicted = &
              predicted_order(this%schemes(scheme), kernel_smoothness(kernel), cloud, way)
          do level = 1, count
            call place(this%scene, this%schemes(scheme), count, way, level, &
                       this%curve(way, cloud, scheme)%level(level)%spacing, &
                       this%curve(way, cloud, scheme)%level(level)%radius)
            tally(level, way, scheme) = tally_t()
            allocate (tally(level, way, scheme)%term(0:terms_of(this%schemes(scheme), field)), &
                      source=0.0_wp)
          end do
        end do
      end do
      call measure_cloud(this, kernel, field, cloud, tally, error, watcher)
      if (allocated(error)) return
      do scheme = 1, size(this%schemes)
        do way = fixed_ratio, fixed_spacing
          call conclude(tally(:, way, scheme), this%schemes(scheme)%family, field, way, &
                        this%curve(way, cloud, scheme), error)
          if (.not. allocated(error)) then
            this%curve(way, cloud, scheme)%expected = &
                expected_order(this%schemes(scheme), kernel_smoothness(kernel), cloud, way, &
                               this%curve(way, cloud, scheme)%level)
          end if
          if (allocated(error)) then
            error%message = this%scene%path//': '//error%message
            return
          end if
        end do
      end do
    end do
  end subroutine evaluate

  !> 'exp(x)*sin(2*y) (above order 2: …)'
  function field_in_words(this) result(text)
    !> A study after `evaluate`
    class(convergence_study_t), intent(in) :: this
    character(len=:), allocatable :: text
    integer :: short

    text = this%field(1)%value
    short = findloc(this%schemes%short_waves, .true., 1)
    if (short == 0) return
    associate (expression => this%field(short)%value)
      if (expression == text) return
      ! What may follow a comma is already said of the first field.
      text = text//' (above order 2: '//expression(:index(expression//',', ',') - 1)//')'
    end associate
  end function field_in_words

  !> All schemes; with a scene that gives the field, those that it names.
  function asked_schemes(scene) result(schemes)
    type(scene_t), intent(in) :: scene
    type(study_scheme_t), allocatable :: schemes(:)

    schemes = study_schemes()
    associate (asked => scene%operators)
      if (asked%field_expression == '') return
      schemes = pack(schemes, is_asked_for(schemes, asked%gradients, asked%laplacians))
    end associate
  end function asked_schemes

  !> Which schemes a scene names.
  pure function is_asked_for(schemes, gradients, laplacians) result(asked)
    type(study_scheme_t), intent(in) :: schemes(:)
    type(text_t), intent(in) :: gradients(:), laplacians(:)
    logical :: asked(size(schemes))
    integer :: k, m

    asked = .false.
    do k = 1, size(schemes)
      if (schemes(k)%family == gradient_family) then
        asked(k) = any([(gradients(m)%value == schemes(k)%name, m=1, size(gradients))])
      else
        asked(k) = any([(laplacians(m)%value == schemes(k)%name, m=1, size(laplacians))])
      end if
    end do
  end function is_asked_for

  !> Particles from a file cannot be made finer.
  subroutine refuse_scene(scene, error)
    type(scene_t), intent(in) :: scene
    type(error_t), allocatable, intent(out) :: error

    if (scene%domain%shape == 'cloud') then
      call raise(error, status_bad_input, scene%domain%place//': a study of convergence '// &
                 'refines the particles, which it cannot do with those of a file. Give a shape '// &
                 'and a spacing.')
    end if
  end subroutine refuse_scene

  !> The field on the domain that the scene's own cloud fills.
  subroutine take_field(scene, kernel, field, error)
    type(scene_t), intent(in) :: scene
    class(kernel_t), intent(in) :: kernel
    type(study_field_t), intent(out) :: field
    type(error_t), allocatable, intent(out) :: error
    type(cloud_t) :: cloud

    call make_scene_cloud(scene, kernel, cloud, error)
    if (allocated(error)) return
    associate (x => cloud%x, y => cloud%y)
      call field%take(scene, [minval(x), minval(y)], &
                      max(maxval(x) - minval(x), maxval(y) - minval(y)), &
                      clearance*scene%support*scene%domain%spacing)
    end associate
  end subroutine take_field

  !> The highest term of a scheme's budget that the field's derivatives allow.
  pure function terms_of(scheme, field) result(degree)
    type(study_scheme_t), intent(in) :: scheme
    type(study_field_t), intent(in) :: field
    integer :: degree

    degree = min(scheme%last_term(), field%highest_degree())
  end function terms_of

  !> Spacing and support radius of a measurement: the triangle at the head of this module. A scheme
  !> that needs a wider support starts at the same radius on a finer cloud.
  pure subroutine place(scene, scheme, levels, way, level, spacing, radius)
    type(scene_t), intent(in) :: scene
    type(study_scheme_t), intent(in) :: scheme
    integer, intent(in) :: levels, way, level
    real(wp), intent(out) :: spacing, radius

    radius = scene%support*scene%domain%spacing
    spacing = radius/max(scene%support, scheme%least_support)
    associate (factor => scheme%shrinking)
      select case (way)
      case (fixed_ratio)
        radius = radius/factor**(level - 1)
        spacing = spacing/factor**(level - 1)
      case (growing_ratio)
        radius = radius/sqrt(factor)**(level - 1)
        spacing = spacing/factor**(level - 1)
      case default
        radius = radius/sqrt(factor)**(levels - 1 + level - 1)
        spacing = spacing/factor**(levels - 1)
      end select
    end associate
  end subroutine place

  !> The scene of a regular or an irregular cloud.
  pure subroutine arrange(cloud, spacing, scene)
    integer, intent(in) :: cloud
    real(wp), intent(in) :: spacing
    type(scene_t), intent(inout) :: scene

    associate (domain => scene%domain)
      domain%spacing = spacing
      if (cloud == irregular_cloud) then
        if (domain%arrangement /= 'jittered' .or. .not. domain%jitter > 0) then
          domain%jitter = usual_jitter
        end if
        domain%arrangement = 'jittered'
      else
        if (domain%arrangement == 'jittered') domain%arrangement = 'lattice'
        domain%jitter = 0
      end if
    end associate
  end subroutine arrange

  !> 'lattice', or 'jittered by 0.2'
  pure function cloud_name(scene, cloud) result(name)
    type(scene_t), intent(in) :: scene
    integer, intent(in) :: cloud
    character(len=:), allocatable :: name
    type(scene_t) :: arranged

    arranged = scene
    call arrange(cloud, scene%domain%spacing, arranged)
    name = arranged%domain%arrangement
    if (cloud == irregular_cloud) name = trim(name)//' by '//to_text(arranged%domain%jitter)
  end function cloud_name

  !> Measure all schemes on regular or on irregular clouds. Each cloud is made once, for all
  !> measurements at its spacing.
  subroutine measure_cloud(study, kernel, field, cloud, tally, error, watcher)
    class(convergence_study_t), intent(inout) :: study
    class(kernel_t), intent(in) :: kernel
    type(study_field_t), intent(in) :: field
    integer, intent(in) :: cloud
    type(tally_t), intent(inout) :: tally(:, :, :)
    type(error_t), allocatable, intent(out) :: error
    class(convergence_watcher_t), intent(inout), optional :: watcher
    type(scene_t) :: scene
    type(study_field_t) :: field_here
    type(sample_t) :: sample
    logical :: finished(size(tally, 1), size(tally, 2), size(tally, 3))
    logical :: here(size(tally, 1), size(tally, 2), size(tally, 3))
    integer :: copy, first(3), k, copies

    finished = .false.
    do while (.not. all(finished))
      ! The next spacing, and all measurements at it of the same field
      first = findloc(finished, .false.)
      field_here = field
      field_here%short_waves = study%schemes(first(3))%short_waves
      associate (next => study%curve(first(2), cloud, first(3))%level(first(1)))
        do k = 1, size(here, 3)
          here(:, :, k) = same_spacing(study%curve(:, cloud, k), next%spacing, size(here, 1)) &
                          .and. (study%schemes(k)%short_waves .eqv. field_here%short_waves)
        end do
        scene = study%scene
        call arrange(cloud, next%spacing, scene)
      end associate
      copies = 1
      if (cloud == irregular_cloud) copies = most_clouds
      do copy = 1, copies
        scene%domain%seed = study%scene%domain%seed + copy - 1
        call take_sample(scene, kernel, field_here, &
                         clearance*study%scene%support*study%scene%domain%spacing, sample, error)
        if (allocated(error)) return
        call measure_sample(study, scene, kernel, field_here, sample, here, cloud, tally, error)
        if (allocated(error)) return
        if (copy*size(sample%core) >= enough_rows) exit
      end do
      finished = finished .or. here
      if (present(watcher)) then
        call watcher%advanced((cloud - 1)/2.0_wp + 0.5_wp*count(finished)/size(finished))
      end if
    end do
  end subroutine measure_cloud

  pure function same_spacing(curves, spacing, levels) result(same)
    type(convergence_curve_t), intent(in) :: curves(:)
    real(wp), intent(in) :: spacing
    integer, intent(in) :: levels
    logical :: same(levels, size(curves))
    integer :: way

    do way = 1, size(curves)
      same(:, way) = abs(curves(way)%level%spacing - spacing) <= 1.0e-9_wp*spacing
    end do
  end function same_spacing

  !> A cloud, its particles far from walls, and the field.
  subroutine take_sample(scene, kernel, field, distance, sample, error)
    type(scene_t), intent(in) :: scene
    class(kernel_t), intent(in) :: kernel
    type(study_field_t), intent(in) :: field
    !> How far from walls, m
    real(wp), intent(in) :: distance
    type(sample_t), intent(out) :: sample
    type(error_t), allocatable, intent(out) :: error

    call make_scene_cloud(scene, kernel, sample%cloud, error)
    if (allocated(error)) return
    associate (cloud => sample%cloud)
      sample%core = far_from_walls(cloud, distance)
      if (size(sample%core) < fewest_rows) then
        call raise(error, status_bad_input, scene%domain%place//': at a spacing of '// &
                   to_text(scene%domain%spacing, digits=3)//' m, '//to_text(size(sample%core))// &
                   ' particles are farther than '//to_text(distance, digits=3)// &
                   ' m from all walls, twice the widest support. A study of convergence needs '// &
                   'at least '//to_text(fewest_rows)//': lower &domain spacing.')
        return
      end if
      allocate (sample%u(cloud%particles()))
      call field%values(cloud%x, cloud%y, sample%u, error)
    end associate
  end subroutine take_sample

  !> Up to `most_rows` particles farther from walls than a distance, evenly picked: particles are
  !> in the order of a space-filling curve.
  function far_from_walls(cloud, distance) result(core)
    type(cloud_t), intent(in) :: cloud
    real(wp), intent(in) :: distance
    integer(ip), allocatable :: core(:)
    integer, parameter :: candidates_for_each = 10
    integer(ip), allocatable :: candidate(:), wall(:)
    logical, allocatable :: far(:)
    integer :: k, stride

    stride = max(1, cloud%particles()/(candidates_for_each*most_rows))
    candidate = [(int(k, ip), k=1, cloud%particles(), stride)]
    wall = pack([(int(k, ip), k=1, cloud%particles())], cloud%side /= 0)
    allocate (far(size(candidate)))
    !$omp parallel do schedule(static) default(shared) private(k)
    do k = 1, size(candidate)
      far(k) = all((cloud%x(wall) - cloud%x(candidate(k)))**2 + &
                   (cloud%y(wall) - cloud%y(candidate(k)))**2 > distance**2)
    end do
    !$omp end parallel do
    core = evenly_picked(pack(candidate, far), most_rows)
  end function far_from_walls

  pure function evenly_picked(all_of_them, most) result(some)
    integer(ip), intent(in) :: all_of_them(:)
    integer, intent(in) :: most
    integer(ip), allocatable :: some(:)
    integer :: k, n

    n = min(most, size(all_of_them))
    some = [(all_of_them(1 + int((k - 1)*(size(all_of_them)/real(n, wp)))), k=1, n)]
  end function evenly_picked

  !> Add a sample to the tallies of all measurements at its spacing.
  subroutine measure_sample(study, scene, kernel, field, sample, here, cloud, tally, error)
    class(convergence_study_t), intent(in) :: study
    type(scene_t), intent(in) :: scene
    class(kernel_t), intent(in) :: kernel
    type(study_field_t), intent(in) :: field
    type(sample_t), intent(in) :: sample
    logical, intent(in) :: here(:, :, :)
    integer, intent(in) :: cloud
    type(tally_t), intent(inout) :: tally(:, :, :)
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene_here
    type(neighbour_list_t) :: list
    integer(ip), allocatable :: targets(:)
    real(wp), allocatable :: radius(:), derivatives(:, :)
    logical :: open_here(size(here, 1), size(here, 2), size(here, 3)), taking_part(size(here, 3))
    logical :: same(size(here, 1), size(here, 2))
    real(wp) :: h
    integer :: start(3), first(2), level, way, k, degree, rows, work

    open_here = here
    taking_part = [(any(here(:, :, k)), k=1, size(here, 3))]
    degree = min(maxval(study%schemes%last_term(), mask=taking_part), field%highest_degree())
    work = max(1, maxval(study%schemes%order, mask=taking_part))
    scene_here = scene
    do while (any(open_here))
      start = findloc(open_here, .true.)
      h = study%curve(start(2), cloud, start(3))%level(start(1))%radius
      scene_here%support = h/sample%cloud%spacing
      rows = min(most_rows, int(enough_neighbours/(work*pi*scene_here%support**2)))
      targets = evenly_picked(sample%core, max(rows, fewest_rows))
      radius = spread(h, 1, sample%cloud%particles())
      call build_neighbour_list(sample%cloud%x, sample%cloud%y, radius(targets), list, targets)
      call require_neighbours(scene_here, sample%cloud, list, error)
      if (allocated(error)) return
      if (allocated(derivatives)) deallocate (derivatives)
      allocate (derivatives(0:derivative_count(degree) - 1, size(targets)))
      call field%derivatives(sample%cloud%x(targets), sample%cloud%y(targets), degree, &
                             derivatives, error)
      if (allocated(error)) return
      do k = 1, size(here, 3)
        same = open_here(:, :, k)
        do way = 1, size(here, 2)
          same(:, way) = same(:, way) .and. &
                         abs(study%curve(way, cloud, k)%level%radius - h) <= 1.0e-9_wp*h
        end do
        if (.not. any(same)) cycle
        open_here(:, :, k) = open_here(:, :, k) .and. .not. same
        ! The corners of the triangle belong to two ways: what is measured for one serves both.
        first = findloc(same, .true.)
        call measure_scheme(study%schemes(k), kernel, field, sample, radius, list, derivatives, &
                            tally(first(1), first(2), k), error)
        if (allocated(error)) return
        do way = 1, size(here, 2)
          do level = 1, size(here, 1)
            if (same(level, way)) tally(level, way, k) = tally(first(1), first(2), k)
          end do
        end do
      end do
    end do
  end subroutine measure_sample

  !> Add the rows of one scheme to a tally.
  subroutine measure_scheme(scheme, kernel, field, sample, radius, list, derivatives, tally, error)
    type(study_scheme_t), intent(in) :: scheme
    class(kernel_t), intent(in) :: kernel
    type(study_field_t), intent(in) :: field
    type(sample_t), intent(in) :: sample
    real(wp), intent(in) :: radius(:)
    type(neighbour_list_t), intent(in) :: list
    real(wp), intent(in) :: derivatives(0:, :)
    type(tally_t), intent(inout) :: tally
    type(error_t), allocatable, intent(out) :: error
    type(sparse_operator_t), allocatable :: rows(:)
    real(wp), allocatable :: exact(:, :), found(:), terms(:, :)
    integer :: component, degree, k

    associate (cloud => sample%cloud, target => list%target)
      call scheme%assemble(kernel, cloud, radius, list, rows, error)
      if (allocated(error)) return
      degree = ubound(tally%term, 1)
      allocate (exact(size(target), size(rows)), found(size(target)))
      allocate (terms(0:degree, size(target)))
      call field%exact_derivative(cloud%x(target), cloud%y(target), derivatives, scheme%family, &
                                  exact, error)
      if (allocated(error)) return
      do component = 1, size(rows)
        call rows(component)%apply(sample%u, found)
        call truncation_terms(rows(component), cloud%x, cloud%y, derivatives, &
                              wanted_moments(scheme%family, component, degree), degree, terms)
        found = found - exact(:, component)
        do k = 0, degree
          tally%term(k) = tally%term(k) + sum(terms(k, :)**2)
        end do
        tally%error = tally%error + sum(found**2)
        tally%total = tally%total + sum(sum(terms, 1)**2)
        tally%remainder = tally%remainder + sum((found - sum(terms, 1))**2)
        tally%exact = tally%exact + sum(exact(:, component)**2)
        tally%rounding = tally%rounding + &
                         sum((epsilon(1.0_wp)*row_magnitudes(rows(component), sample%u))**2)
      end do
      tally%second = tally%second + &
                     sum(derivatives(derivative_index(2, 0), :)**2 + &
                         2*derivatives(derivative_index(1, 1), :)**2 + &
                         derivatives(derivative_index(0, 2), :)**2)
      tally%field = tally%field + sum(sample%u(target)**2)
      tally%rows = tally%rows + size(target)
      tally%neighbours = tally%neighbours + size(list%index)
    end associate
  end subroutine measure_scheme

  !> Turn tallies into measurements, and find the orders.
  subroutine conclude(tallies, family, field, way, curve, error)
    type(tally_t), intent(in) :: tallies(:)
    integer, intent(in) :: family
    type(study_field_t), intent(in) :: field
    integer, intent(in) :: way
    type(convergence_curve_t), intent(inout) :: curve
    !> The field has no derivative to speak of
    type(error_t), allocatable, intent(out) :: error
    !> A Laplacian smaller than this part of the second derivatives is that of a harmonic field, and
    !> a derivative smaller than this part of the field over the domain's width is none
    real(wp), parameter :: negligible = 1.0e-6_wp
    real(wp) :: size_of_exact
    integer :: k, level

    do level = 1, size(tallies)
      associate (tally => tallies(level), found => curve%level(level))
        size_of_exact = sqrt(tally%exact)
        if (family == 2) then
          if (size_of_exact <= negligible*sqrt(tally%second)) size_of_exact = sqrt(tally%second)
        end if
        if (size_of_exact <= negligible*sqrt(tally%field)/field%width**family) then
          call raise(error, status_bad_input, trim(merge('first ', 'second', family == 1))// &
                     ' derivatives of the field '''//field%text//''' vanish, so there is '// &
                     'nothing to measure: give &operators another field_expression.')
          return
        end if
        found%rows = tally%rows
        found%neighbours = tally%neighbours/tally%rows
        found%error = sqrt(tally%error)/size_of_exact
        found%total = sqrt(tally%total)/size_of_exact
        found%remainder = sqrt(tally%remainder)/size_of_exact
        allocate (found%term(0:ubound(tally%term, 1)))
        do k = 0, ubound(tally%term, 1)
          found%term(k) = sqrt(tally%term(k))/size_of_exact
        end do
        found%rounded = .not. found%error > &
                        rounding_margin*(sqrt(tally%rounding)/size_of_exact + field%uncertainty())
      end associate
    end do
    do level = 2, size(tallies)
      curve%level(level)%order = order_of(curve%level(level - 1:level), way)
    end do
    curve%fitted = order_of(curve%level(max(1, size(tallies) - fitted_levels + 1):), way)
  end subroutine conclude

  !> The order that theory expects of the last measurements: where the terms are not correlated,
  !> the slope of log √(Σ term²), each term having the order that theory gives it.
  pure function expected_order(scheme, smoothness, cloud, way, measurements) result(order)
    type(study_scheme_t), intent(in) :: scheme
    integer, intent(in) :: smoothness, cloud, way
    type(measurement_t), intent(in) :: measurements(:)
    real(wp) :: order
    real(wp) :: order_of_term, part, sum_of_parts
    integer :: k, level

    order = no_order
    if (.not. scheme%understood) return
    part = 0
    sum_of_parts = 0
    do level = max(1, size(measurements) - fitted_levels + 1), size(measurements)
      if (measurements(level)%rounded) cycle
      do k = 0, ubound(measurements(level)%term, 1)
        order_of_term = term_order(scheme, k, smoothness, cloud, way)
        if (.not. is_order(order_of_term)) cycle
        associate (share => (measurements(level)%term(k)/measurements(level)%error)**2)
          part = part + share*order_of_term
          sum_of_parts = sum_of_parts + share
        end associate
      end do
    end do
    if (sum_of_parts > 0) order = part/sum_of_parts
  end function expected_order

  !> The slope of log error over log Δ, or over log h where the ratio of both is not fixed, by least
  !> squares; `no_order` with fewer than two errors beyond rounding.
  pure function order_of(measurements, way) result(order)
    type(measurement_t), intent(in) :: measurements(:)
    integer, intent(in) :: way
    real(wp) :: order
    real(wp), allocatable :: abscissa(:), ordinate(:)

    order = no_order
    if (count(.not. measurements%rounded) < 2) return
    if (way == fixed_ratio) then
      abscissa = log(pack(measurements%spacing, .not. measurements%rounded))
    else
      abscissa = log(pack(measurements%radius, .not. measurements%rounded))
    end if
    ordinate = log(pack(measurements%error, .not. measurements%rounded))
    abscissa = abscissa - sum(abscissa)/size(abscissa)
    order = sum(abscissa*ordinate)/sum(abscissa**2)
  end function order_of

end module calor_convergence_study
