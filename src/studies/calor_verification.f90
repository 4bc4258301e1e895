!> Scenes with known answers: what each should give, and what it gives.
module calor_verification
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: wp
  use calor_rosenthal, only: rosenthal_temperature
  use calor_scene, only: scene_t
  use calor_scene_reader, only: read_scene
  use calor_simulation, only: simulation_t
  implicit none (type, external)
  private

  public :: verification_case_t, verification_cases, run_case

  !> What is compared: the relative L2 error against the scene's exact_expression, the temperature
  !> of the particle nearest to a place, the relative imbalance of the heat budget, how much of the
  !> body's length is liquid, or the relative L2 error against Rosenthal's moving source or against
  !> a table of x and the temperature beside the scene
  integer, parameter :: error_of_field = 1, temperature_at = 2, imbalance = 3, melted_length = 4, &
                        error_of_source = 5, error_of_table = 6

  !> The moving source of rosenthal.nml: where it starts, m, its power, W/m, and its speed, m/s
  real(wp), parameter :: source_start = 0.2_wp, source_power = 1.0_wp, source_speed = 40.0_wp
  !> How far from the source it counts as a line, and how far its surroundings are settled, m
  real(wp), parameter :: nearest_distance = 0.05_wp, farthest_distance = 0.25_wp

  !> A scene of data/verification with its answer
  type :: verification_case_t
    !> Its file, without folder and ending
    character(len=24) :: file = ''
    !> What is known, and where from
    character(len=72) :: meaning = ''
    !> One of the constants above
    integer :: quantity = error_of_field
    !> The answer, and by how much what is found may differ from it
    real(wp) :: expected = 0.0_wp, tolerance = 0.0_wp
    !> The place, m
    real(wp) :: x = 0.0_wp, y = 0.0_wp
  end type verification_case_t

  type(verification_case_t), parameter :: verification_cases(*) = [ &
      verification_case_t('nafems_t4', 'NAFEMS T4, K at (0.6, 0.2); published 18.3', &
                          temperature_at, 18.25_wp, 0.05_wp, 0.6_wp, 0.2_wp), &
      verification_case_t('slab_step', 'step, Fourier series, relative L2 error', &
                          error_of_field, 0.0_wp, 1.0e-2_wp), &
      verification_case_t('convective_slab_0_1', 'Biot number 0.1, series, relative L2 error', &
                          error_of_field, 0.0_wp, 1.0e-4_wp), &
      verification_case_t('convective_slab_1', 'Biot number 1, series, relative L2 error', &
                          error_of_field, 0.0_wp, 2.0e-4_wp), &
      verification_case_t('convective_slab_10', 'Biot number 10, series, relative L2 error', &
                          error_of_field, 0.0_wp, 2.0e-4_wp), &
      verification_case_t('disc_mode', 'Bessel mode, relative L2 error', &
                          error_of_field, 0.0_wp, 5.0e-3_wp), &
      verification_case_t('half_space', 'flux, error function, relative L2 error', &
                          error_of_field, 0.0_wp, 5.0e-3_wp), &
      verification_case_t('radiating_body', 'lumped body, K after 20 s, by the ODE', &
                          temperature_at, 753.36_wp, 0.05_wp, 0.005_wp, 0.005_wp), &
      verification_case_t('two_slabs_steady_10', 'two slabs 1:10, steady, relative L2 error', &
                          error_of_field, 0.0_wp, 1.0e-10_wp), &
      verification_case_t('two_slabs_10', 'two half-spaces 1:10, relative L2 error', &
                          error_of_field, 0.0_wp, 1.0e-3_wp), &
      verification_case_t('anisotropic_10', 'anisotropic 1:10 at 30 degrees, relative L2 error', &
                          error_of_field, 0.0_wp, 1.0e-3_wp), &
      verification_case_t('two_slabs_steady_1000', 'two slabs 1:1000, steady, relative L2 error', &
                          error_of_field, 0.0_wp, 1.0e-10_wp), &
      verification_case_t('two_slabs_1000', 'two half-spaces 1:1000, relative L2 error', &
                          error_of_field, 0.0_wp, 2.0e-3_wp), &
      verification_case_t('anisotropic_1000', 'anisotropic 1:1000 at 30 deg, relative L2 error', &
                          error_of_field, 0.0_wp, 1.0e-3_wp), &
      verification_case_t('two_slabs_transient_10', 'two slabs 1:10, fine 1D, relative error', &
                          error_of_table, 0.0_wp, 1.0e-3_wp), &
      verification_case_t('two_slabs_transient_1000', 'two slabs 1:1000, fine 1D, relative error', &
                          error_of_table, 0.0_wp, 1.0e-3_wp), &
      verification_case_t('kirchhoff_slab', 'conductivity 1 + T, slab, relative L2 error', &
                          error_of_field, 0.0_wp, 1.0e-10_wp), &
      verification_case_t('kirchhoff_plate', 'conductivity 1 + T, plate, relative L2 error', &
                          error_of_field, 0.0_wp, 1.0e-4_wp), &
      verification_case_t('kirchhoff_decay', 'capacity too, in time, relative L2 error', &
                          error_of_field, 0.0_wp, 5.0e-3_wp), &
      verification_case_t('two_laws', 'two slabs of different laws 1:1000, relative L2 error', &
                          error_of_field, 0.0_wp, 1.0e-10_wp), &
      verification_case_t('no_product', 'conductivity 1 + x T^2/4, relative L2 error', &
                          error_of_field, 0.0_wp, 1.0e-4_wp), &
      verification_case_t('l_shape', 'L, steady, relative imbalance of the heat budget', &
                          imbalance, 0.0_wp, 1.0e-6_wp), &
      verification_case_t('l_shape', 'L, steady, K at (2, 1), by spacings down to 0.005 m', &
                          temperature_at, 22.9864_wp, 0.005_wp, 2.0_wp, 1.0_wp), &
      verification_case_t('stefan_0_1', 'Stefan number 0.1, similarity solution, front, m', &
                          melted_length, 0.6_wp, 0.02_wp), &
      verification_case_t('stefan_1', 'Stefan number 1, similarity solution, front, m', &
                          melted_length, 0.6_wp, 0.02_wp), &
      verification_case_t('stefan_5', 'Stefan number 5, similarity solution, front, m', &
                          melted_length, 0.6_wp, 0.02_wp), &
      verification_case_t('rotating_gaussian', 'Gaussian, one full turn, relative L2 error', &
                          error_of_field, 0.0_wp, 4.0e-3_wp), &
      verification_case_t('rosenthal', 'moving source, Rosenthal, relative L2 error', &
                          error_of_source, 0.0_wp, 3.0e-2_wp)]

contains

  !> Run a scene on its lattice or on an irregular cloud.
  subroutine run_case(this, irregular, found, error)
    !> The case
    type(verification_case_t), intent(in) :: this
    !> Whether particles are jittered, or relaxed where the body is no rectangle
    logical, intent(in) :: irregular
    !> What is compared with `expected`
    real(wp), intent(out) :: found
    !> The scene could not be run
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    integer :: nearest

    found = 0
    call read_scene('data/verification/'//trim(this%file)//'.nml', scene, error)
    if (allocated(error)) return
    if (irregular) then
      scene%domain%arrangement = 'relaxed'
      if (scene%domain%shape == 'rectangle') scene%domain%arrangement = 'jittered'
      scene%domain%jitter = 0.2_wp
    end if
    call simulation%prepare(scene, error)
    if (.not. allocated(error)) call simulation%run(error)
    if (allocated(error)) return
    select case (this%quantity)
    case (temperature_at)
      associate (cloud => simulation%cloud)
        nearest = minloc((cloud%x - this%x)**2 + (cloud%y - this%y)**2, dim=1)
      end associate
      found = simulation%temperature(nearest)
    case (imbalance)
      found = simulation%entries(size(simulation%entries))%imbalance
    case (melted_length)
      associate (cloud => simulation%cloud)
        found = sum(cloud%area*simulation%liquid_fraction())/(maxval(cloud%y) - minval(cloud%y))
      end associate
    case (error_of_source)
      found = source_error(simulation)
    case (error_of_table)
      call find_table_error('data/verification/'//trim(this%file)//'.csv', simulation, found, error)
    case default
      found = simulation%relative_l2_error()
    end select
  end subroutine run_case

  !> Relative L2 error against a temperature that depends on x only, tabulated at equal distances.
  subroutine find_table_error(path, simulation, deviation, error)
    character(len=*), intent(in) :: path
    type(simulation_t), intent(in) :: simulation
    real(wp), intent(out) :: deviation
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: table(:, :), exact(:)
    real(wp) :: row(2)
    integer :: k, unit, status

    deviation = 0
    open (newunit=unit, file=path, action='read', status='old', iostat=status)
    if (status /= 0) then
      call raise(error, status_bad_input, 'there is no file '//path//' that can be read.')
      return
    end if
    allocate (table(2, 0))
    ! The first line is a heading.
    read (unit, *, iostat=status)
    do while (status == 0)
      read (unit, *, iostat=status) row
      if (status /= 0) exit
      table = reshape([table, row], [2, size(table, 2) + 1])
    end do
    close (unit)
    if (size(table, 2) < 2) then
      call raise(error, status_bad_input, path//' has no two lines of two numbers.')
      return
    end if
    associate (cloud => simulation%cloud, n => size(table, 2), step => table(1, 2) - table(1, 1))
      exact = cloud%x
      do k = 1, size(exact)
        associate (place => (cloud%x(k) - table(1, 1))/step)
          associate (node => min(n - 1, 1 + int(max(place, 0.0_wp))))
            exact(k) = table(2, node) + (place - (node - 1))*(table(2, node + 1) - table(2, node))
          end associate
        end associate
      end do
      deviation = sqrt(sum(cloud%area*(simulation%temperature - exact)**2)/ &
                       sum(cloud%area*exact**2))
    end associate
  end subroutine find_table_error

  !> Relative L2 error against Rosenthal's solution, around the source but not at it.
  pure function source_error(simulation) result(deviation)
    type(simulation_t), intent(in) :: simulation
    real(wp) :: deviation
    real(wp), allocatable :: ahead(:), exact(:)
    logical, allocatable :: counts(:)

    associate (cloud => simulation%cloud, material => simulation%scene%material)
      ahead = cloud%x - (source_start + source_speed*simulation%time)
      counts = hypot(ahead, cloud%y) > nearest_distance .and. &
               hypot(ahead, cloud%y) < farthest_distance
      allocate (exact(size(ahead)), source=0.0_wp)
      where (counts) exact = rosenthal_temperature(ahead, cloud%y, source_power, source_speed, &
                                                   material%conductivity, material%conductivity/ &
                                                   (material%density*material%heat_capacity))
      deviation = sqrt(sum(cloud%area*(simulation%temperature - exact)**2, counts)/ &
                       sum(cloud%area*exact**2, counts))
    end associate
  end function source_error

end module calor_verification
