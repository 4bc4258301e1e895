!> Tests of bodies of all shapes, of the particles that fill them and of what these stand for.
module test_shapes
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use calor_arrangements, only: arrangement_choices
  use calor_body, only: body_t
  use calor_body_cloud, only: fill_body
  use calor_cloud, only: cloud_t
  use calor_cloud_check, only: check_cloud
  use calor_constants, only: pi
  use calor_disc_body, only: make_disc_body, make_annulus_body
  use calor_error, only: error_t, status_bad_input
  use calor_kernel, only: kernel_t
  use calor_kernels, only: make_kernel
  use calor_kinds, only: wp, ip
  use calor_laplacian_scheme, only: laplacian_scheme_t
  use calor_laplacian_schemes, only: make_laplacian_scheme
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_polygon_body, only: make_polygon_body
  use calor_rectangle_body, only: make_rectangle_body
  use calor_rectangle_cloud, only: make_rectangle
  use calor_row_report, only: row_report_t
  use calor_scene, only: scene_t
  use calor_scene_reader, only: interpret_scene, read_scene
  use calor_simulation, only: simulation_t
  use calor_space_filling_curve, only: hilbert_order
  use calor_sparse_operator, only: sparse_operator_t
  use calor_stable_rows, only: assemble_stable_rows, row_repairs_t, positive_stencil
  use calor_text, only: to_text
  use omp_lib, only: omp_get_max_threads, omp_set_num_threads
  use testdrive, only: new_unittest, unittest_type, error_type, check, test_failed
  implicit none (type, external)
  private

  public :: collect_shapes

  !> The bodies that most tests are done with
  character(len=*), parameter :: bodies(*) = [character(len=9) :: 'rectangle', 'disc', 'annulus', &
                                                                 'L', 'holed']
  real(wp), parameter :: centre(2) = [0.3_wp, -0.2_wp], radius = 0.7_wp, inner_radius = 0.3_wp
  !> Edges of the L do not fit a lattice over its extent
  real(wp), parameter :: notch(2) = [0.53_wp, 0.46_wp]
  real(wp), parameter :: corners_of_l(*) = [0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, notch(2), &
                                            notch(1), notch(2), notch(1), 1.0_wp, 0.0_wp, 1.0_wp]
  real(wp), parameter :: unit_square(*) = [0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, 1.0_wp, &
                                           0.0_wp, 1.0_wp]
  !> One hole counter-clockwise, one clockwise; the second is not closed
  real(wp), parameter :: two_holes(*) = [0.2_wp, 0.3_wp, 0.4_wp, 0.3_wp, 0.4_wp, 0.7_wp, &
                                         0.2_wp, 0.7_wp, 0.2_wp, 0.3_wp, &
                                         0.6_wp, 0.5_wp, 0.6_wp, 0.8_wp, 0.8_wp, 0.8_wp, &
                                         0.8_wp, 0.5_wp]

contains

  subroutine collect_shapes(testsuite)
    type(unittest_type), allocatable, intent(out) :: testsuite(:)

    testsuite = [ &
                new_unittest('areas, perimeters and extents', test_measures), &
                new_unittest('inside, outside and the way to the wall', test_find_wall), &
                new_unittest('polygon: names of edges and loops', test_names), &
                new_unittest('polygon: a traced curve', test_traced_curve), &
                new_unittest('polygon: what bounds no region is refused', test_polygon_refused), &
                new_unittest('discs and annuli that are none are refused', test_disc_refused), &
                new_unittest('spacings that do not fit are refused', test_spacing_refused), &
                new_unittest('wall particles: even, with normals and lengths', test_walls), &
                new_unittest('rectangle: normals, lengths and areas of walls', test_rectangle), &
                new_unittest('every arrangement fills every body evenly', test_evenness), &
                new_unittest('every arrangement admits exact rows in every body', test_rows), &
                new_unittest('areas sum to that of the body', test_area_sums), &
                new_unittest('sums of values times areas are integrals', test_quadrature), &
                new_unittest('relaxed: even, and along walls', test_relaxed), &
                new_unittest('relaxed depends on the seed, not on threads', test_seed), &
                new_unittest('jitter stays away from walls', test_jitter), &
                new_unittest('reordering takes all along', test_reorder), &
                new_unittest('disc: a Bessel mode fades with second order', test_disc_scene), &
                new_unittest('annulus: a logarithm in the end', test_annulus_scene), &
                new_unittest('L with a hole: a mode of the square', test_l_scene), &
                new_unittest('boundaries are held by edge and by loop', test_held) &
                ]
  end subroutine collect_shapes

  !> One of `bodies`.
  subroutine make_body(error, name, body)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: name
    type(body_t), intent(out) :: body
    type(error_t), allocatable :: failure
    real(wp), parameter :: no_hole(0) = 0

    select case (name)
    case ('rectangle')
      call make_rectangle_body([0.0_wp, 1.0_wp], [-0.3_wp, 0.6_wp], body, failure)
    case ('disc')
      call make_disc_body(centre, radius, body, failure)
    case ('annulus')
      call make_annulus_body(centre, radius, inner_radius, body, failure)
    case ('L')
      call make_polygon_body(corners_of_l, no_hole, body, failure)
    case default
      call make_polygon_body(unit_square, two_holes, body, failure)
    end select
    if (allocated(failure)) call test_failed(error, name//': '//failure%message)
  end subroutine make_body

  !> One of `bodies`, filled. Rectangles are filled as scenes have them filled.
  subroutine fill(error, name, spacing, arrangement, cloud, body, jitter, seed)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: name
    real(wp), intent(in) :: spacing
    character(len=*), intent(in) :: arrangement
    type(cloud_t), intent(out) :: cloud
    type(body_t), intent(out) :: body
    real(wp), intent(in), optional :: jitter
    integer, intent(in), optional :: seed
    type(error_t), allocatable :: failure
    real(wp) :: jitter_used
    integer :: seed_used

    jitter_used = 0.2_wp
    if (present(jitter)) jitter_used = jitter
    seed_used = 1
    if (present(seed)) seed_used = seed
    call make_body(error, name, body)
    if (allocated(error)) return
    if (name == 'rectangle') then
      call make_rectangle([0.0_wp, 1.0_wp], [-0.3_wp, 0.6_wp], spacing, arrangement, jitter_used, &
                          seed_used, cloud, failure)
    else
      call fill_body(body, spacing, arrangement, jitter_used, seed_used, cloud, failure)
    end if
    if (allocated(failure)) call test_failed(error, name//', '//arrangement//': '//failure%message)
  end subroutine fill

  subroutine test_measures(error)
    type(error_type), allocatable, intent(out) :: error

    call expect_measures(error, 'rectangle', 0.9_wp, 3.8_wp, [0.0_wp, 1.0_wp], [-0.3_wp, 0.6_wp])
    if (allocated(error)) return
    call expect_measures(error, 'disc', pi*0.49_wp, 2*pi*0.7_wp, [-0.4_wp, 1.0_wp], &
                         [-0.9_wp, 0.5_wp])
    if (allocated(error)) return
    call expect_measures(error, 'annulus', pi*0.4_wp, 2*pi, [-0.4_wp, 1.0_wp], [-0.9_wp, 0.5_wp])
    if (allocated(error)) return
    call expect_measures(error, 'L', 1 - 0.47_wp*0.54_wp, 4.0_wp, [0.0_wp, 1.0_wp], &
                         [0.0_wp, 1.0_wp])
    if (allocated(error)) return
    call expect_measures(error, 'holed', 1 - 0.08_wp - 0.06_wp, 4 + 1.2_wp + 1.0_wp, &
                         [0.0_wp, 1.0_wp], [0.0_wp, 1.0_wp])
  end subroutine test_measures

  subroutine expect_measures(error, name, area, perimeter, x_range, y_range)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: name
    real(wp), intent(in) :: area, perimeter, x_range(2), y_range(2)
    type(body_t) :: body
    real(wp) :: found_x(2), found_y(2)

    call make_body(error, name, body)
    if (allocated(error)) return
    call check(error, body%area(), area, thr=1.0e-14_wp, more=name)
    if (allocated(error)) return
    call check(error, body%perimeter(), perimeter, thr=1.0e-14_wp, more=name)
    if (allocated(error)) return
    call body%find_extent(found_x, found_y)
    call check(error, maxval(abs([found_x - x_range, found_y - y_range])) < 1.0e-15_wp, name)
  end subroutine expect_measures

  subroutine test_find_wall(error)
    type(error_type), allocatable, intent(out) :: error
    type(body_t) :: body

    call make_body(error, 'annulus', body)
    if (allocated(error)) return
    call expect_wall(error, body, centre + [0.4_wp, 0.0_wp], 0.1_wp, [1.0_wp, 0.0_wp])
    if (allocated(error)) return
    call expect_wall(error, body, centre + [0.0_wp, -0.6_wp], 0.1_wp, [0.0_wp, 1.0_wp])
    if (allocated(error)) return
    call expect_wall(error, body, centre + [0.06_wp, 0.08_wp], -0.2_wp, [0.6_wp, 0.8_wp])
    if (allocated(error)) return
    call expect_wall(error, body, centre + [3.0_wp, 4.0_wp], -4.3_wp, [-0.6_wp, -0.8_wp])
    if (allocated(error)) return
    ! On the wall, the way is that of the normal
    call expect_wall(error, body, centre + [0.0_wp, radius], 0.0_wp, [0.0_wp, -1.0_wp])
    if (allocated(error)) return
    call make_body(error, 'L', body)
    if (allocated(error)) return
    call expect_wall(error, body, [0.1_wp, 0.7_wp], 0.1_wp, [1.0_wp, 0.0_wp])
    if (allocated(error)) return
    ! About the reentrant corner
    call expect_wall(error, body, notch - [0.03_wp, 0.04_wp], 0.05_wp, [-0.6_wp, -0.8_wp])
    if (allocated(error)) return
    call expect_wall(error, body, notch + [0.2_wp, 0.1_wp], -0.1_wp, [0.0_wp, -1.0_wp])
    if (allocated(error)) return
    call make_body(error, 'holed', body)
    if (allocated(error)) return
    call expect_wall(error, body, [0.3_wp, 0.4_wp], -0.1_wp, [0.0_wp, 0.0_wp])
    if (allocated(error)) return
    call expect_wall(error, body, [0.45_wp, 0.5_wp], 0.05_wp, [1.0_wp, 0.0_wp])
    if (allocated(error)) return
    call expect_wall(error, body, [0.7_wp, 0.45_wp], 0.05_wp, [0.0_wp, -1.0_wp])
  end subroutine test_find_wall

  subroutine expect_wall(error, body, point, distance, inward)
    type(error_type), allocatable, intent(out) :: error
    type(body_t), intent(in) :: body
    real(wp), intent(in) :: point(2), distance
    !> 0: any direction, as several walls are equally near
    real(wp), intent(in) :: inward(2)
    real(wp) :: found, direction(2)

    call body%find_wall(point, found, direction)
    call check(error, found, distance, thr=1.0e-14_wp, more=body%shape)
    if (allocated(error)) return
    call check(error, norm2(direction), 1.0_wp, thr=1.0e-14_wp, more=body%shape)
    if (allocated(error) .or. .not. norm2(inward) > 0) return
    call check(error, maxval(abs(direction - inward)) < 1.0e-13_wp, body%shape//', direction')
  end subroutine expect_wall

  subroutine test_names(error)
    type(error_type), allocatable, intent(out) :: error
    type(body_t) :: body
    type(cloud_t) :: cloud

    call fill(error, 'holed', 0.05_wp, 'lattice', cloud, body)
    if (allocated(error)) return
    call check(error, size(cloud%boundary), 12 + 3)
    if (allocated(error)) return
    call check(error, cloud%boundary(1)%value//cloud%boundary(12)%value// &
               cloud%boundary(13)%value//cloud%boundary(14)%value//cloud%boundary(15)%value, &
               'edge 1edge 12outerhole 1hole 2')
    if (allocated(error)) return
    ! The edge from (0.4, 0.3) to (0.4, 0.7), the second of the first hole
    call check(error, all(btest(cloud%side, 5) .eqv. abs(cloud%x - 0.4_wp) < 1.0e-14_wp .and. &
                          abs(cloud%y - 0.5_wp) < 0.2_wp + 1.0e-14_wp .and. cloud%side /= 0))
    if (allocated(error)) return
    call check(error, count(btest(cloud%side, 5)), 9)
    if (allocated(error)) return
    call check(error, count(btest(cloud%side, 12)), 80)
    if (allocated(error)) return
    call check(error, count(btest(cloud%side, 13)), 24)
    if (allocated(error)) return
    call check(error, count(btest(cloud%side, 14)), 20)
    if (allocated(error)) return
    call check(error, all(btest(cloud%side, 14) .eqv. &
                          (cloud%x > 0.59_wp .and. cloud%x < 0.81_wp .and. &
                           cloud%y > 0.49_wp .and. cloud%y < 0.81_wp)), 'in or about hole 2')
    if (allocated(error)) return
    call check(error, all(popcnt(cloud%side) <= 3) .and. count(popcnt(cloud%side) == 3) == 12)
  end subroutine test_names

  !> A circle of 300 vertices: more than can be told apart, and nearer than the spacing.
  subroutine test_traced_curve(error)
    type(error_type), allocatable, intent(out) :: error
    integer, parameter :: n = 300
    type(body_t) :: body
    type(cloud_t) :: cloud
    type(error_t), allocatable :: failure
    real(wp) :: vertices(2, n)
    integer :: k

    do k = 1, n
      vertices(:, k) = [cos(2*pi*k/n), sin(2*pi*k/n)]
    end do
    call make_polygon_body([vertices], [real(wp) ::], body, failure)
    call check(error, .not. allocated(failure), 'refused')
    if (allocated(error)) return
    call fill_body(body, 0.1_wp, 'lattice', 0.0_wp, 1, cloud, failure)
    call check(error, .not. allocated(failure), 'not filled')
    if (allocated(error)) return
    call check(error, size(cloud%boundary), 1)
    if (allocated(error)) return
    call check(error, cloud%boundary(1)%value, 'outer')
    if (allocated(error)) return
    call check(error, count(cloud%side /= 0), 63)
    if (allocated(error)) return
    associate (x => pack(cloud%x, cloud%side /= 0), y => pack(cloud%y, cloud%side /= 0))
      call check(error, maxval(abs(hypot(x - cshift(x, 1), y - cshift(y, 1)) - 0.0997_wp)) < &
                 1.0e-4_wp, 'not even')
    end associate
    if (allocated(error)) return
    ! Vertices as far apart as particles are corners, whatever the angle
    call make_polygon_body([vertices(:, ::6)], [real(wp) ::], body, failure)
    call fill_body(body, 0.1_wp, 'lattice', 0.0_wp, 1, cloud, failure)
    call check(error, count(cloud%side /= 0), 50)
    if (allocated(error)) return
    associate (x => pack(cloud%x, cloud%side /= 0), y => pack(cloud%y, cloud%side /= 0))
      call check(error, maxval(abs(hypot(x, y) - 1)) < 1.0e-14_wp, 'not at the vertices')
    end associate
  end subroutine test_traced_curve

  subroutine test_polygon_refused(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: small(*) = [0.4_wp, 0.4_wp, 0.6_wp, 0.4_wp, 0.5_wp, 0.6_wp]

    call refuse(error, [0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 1.0_wp], 'found 5 numbers')
    if (allocated(error)) return
    call refuse(error, [0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp], 'at least 3 vertices, found 2')
    if (allocated(error)) return
    call refuse(error, [0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, 1.0_wp, 1.0_wp, 1.0_wp], &
                'edge 3 has no length: both its ends are (1, 1)')
    if (allocated(error)) return
    call refuse(error, [0.0_wp, 0.0_wp, 1.0_wp, 1.0_wp, 1.0_wp, 0.0_wp], 'clockwise')
    if (allocated(error)) return
    call refuse(error, [0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 1.0_wp, 1.0_wp], &
                'edge 2 from (1, 0) to (0, 1) and edge 4 from (1, 1) to (0, 0) cross or touch')
    if (allocated(error)) return
    ! A vertex on another edge
    call refuse(error, [0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, 1.0_wp, 0.5_wp, 0.0_wp, &
                        0.0_wp, 1.0_wp], 'edge 1 from (0, 0) to (1, 0) and edge 3')
    if (allocated(error)) return
    ! All in one line
    call refuse(error, [0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 2.0_wp, 0.0_wp], 'sharper than 15 degrees')
    if (allocated(error)) return
    call refuse(error, [0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, 0.2_wp], &
                'the corner at (0, 0) is sharper than 15 degrees')
    if (allocated(error)) return
    call refuse(error, [0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, &
                        ieee_value(1.0_wp, ieee_quiet_nan)], 'ordinary numbers')
    if (allocated(error)) return

    call refuse(error, unit_square, 'found 3 numbers', holes=small(:3))
    if (allocated(error)) return
    call refuse(error, unit_square, 'hole 1 at (2.4, 2.4) lies outside the polygon', &
                holes=small + 2)
    if (allocated(error)) return
    call refuse(error, unit_square, 'edge 2 from (1, 0) to (1, 1) and edge 5', &
                holes=small + 0.5_wp)
    if (allocated(error)) return
    call refuse(error, unit_square, 'hole 2 at (0.48, 0.46) lies in hole 1', &
                holes=[small, small(:2), 0.48_wp, 0.46_wp, 0.52_wp, 0.46_wp, 0.5_wp, 0.5_wp])
    if (allocated(error)) return
    call refuse(error, unit_square, 'hole 1 at (0.48, 0.46) lies in hole 2', &
                holes=[0.48_wp, 0.46_wp, 0.52_wp, 0.46_wp, 0.5_wp, 0.5_wp, 0.48_wp, 0.46_wp, small])
    if (allocated(error)) return
    call refuse(error, unit_square, 'hole 2 has 1.', holes=[small, small(:2), 0.2_wp, 0.2_wp])
    if (allocated(error)) return
    call refuse(error, unit_square, 'edge 6 has no length', &
                holes=[small(:4), small(3:4), small(5:6)])
  end subroutine test_polygon_refused

  subroutine refuse(error, vertices, words, holes)
    type(error_type), allocatable, intent(out) :: error
    real(wp), intent(in) :: vertices(:)
    character(len=*), intent(in) :: words
    real(wp), intent(in), optional :: holes(:)
    type(body_t) :: body
    type(error_t), allocatable :: failure
    logical :: in_hole

    if (present(holes)) then
      call make_polygon_body(vertices, holes, body, failure, in_hole)
    else
      call make_polygon_body(vertices, [real(wp) ::], body, failure, in_hole)
    end if
    call expect(error, failure, words)
    if (allocated(error)) return
    call check(error, in_hole .eqv. present(holes), 'the wrong key is blamed: '//words)
  end subroutine refuse

  !> Check that something failed for what the user gave, with a message that contains some words.
  subroutine expect(error, failure, words)
    type(error_type), allocatable, intent(out) :: error
    type(error_t), allocatable, intent(in) :: failure
    character(len=*), intent(in) :: words

    call check(error, allocated(failure), 'not refused: '//words)
    if (allocated(error)) return
    call check(error, failure%status, status_bad_input)
    if (allocated(error)) return
    call check(error, index(failure%message, words) > 0, &
               'expected "'//words//'" in: '//failure%message)
  end subroutine expect

  subroutine test_disc_refused(error)
    type(error_type), allocatable, intent(out) :: error
    type(body_t) :: body
    type(error_t), allocatable :: failure

    call make_disc_body(centre, 0.0_wp, body, failure)
    call expect(error, failure, 'radius = 0 must be positive')
    if (allocated(error)) return
    call make_disc_body([ieee_value(1.0_wp, ieee_quiet_nan), 0.0_wp], 1.0_wp, body, failure)
    call expect(error, failure, 'ordinary numbers')
    if (allocated(error)) return
    call make_annulus_body(centre, 1.0_wp, 0.0_wp, body, failure)
    call expect(error, failure, 'inner_radius = 0 must be positive')
    if (allocated(error)) return
    call make_annulus_body(centre, 1.0_wp, 1.0_wp, body, failure)
    call expect(error, failure, 'inner_radius = 1 must be less than radius = 1')
    if (allocated(error)) return
    call make_annulus_body(centre, -1.0_wp, -2.0_wp, body, failure)
    call expect(error, failure, 'radius = -1 must be positive')
  end subroutine test_disc_refused

  subroutine test_spacing_refused(error)
    type(error_type), allocatable, intent(out) :: error
    type(body_t) :: body
    type(cloud_t) :: cloud
    type(error_t), allocatable :: failure

    call make_body(error, 'disc', body)
    if (allocated(error)) return
    call fill_body(body, 0.0_wp, 'lattice', 0.0_wp, 1, cloud, failure)
    call expect(error, failure, 'spacing = 0 is not positive')
    if (allocated(error)) return
    call fill_body(body, 1.5_wp, 'lattice', 0.0_wp, 1, cloud, failure)
    call expect(error, failure, 'larger than the disc, which is 1.4 by 1.4')
    if (allocated(error)) return
    call fill_body(body, 1.01_wp, 'lattice', 0.0_wp, 1, cloud, failure)
    call expect(error, failure, 'radius of 0.7 m: take at most 1.')
    if (allocated(error)) return
    call fill_body(body, 1.0_wp, 'lattice', 0.0_wp, 1, cloud, failure)
    call check(error, .not. allocated(failure), 'what should fit is refused')
    if (allocated(error)) return
    call fill_body(body, 1.0e-5_wp, 'lattice', 0.0_wp, 1, cloud, failure)
    call expect(error, failure, 'particles that can be numbered')
    if (allocated(error)) return
    call fill_body(body, 0.1_wp, 'jittered', 0.5_wp, 1, cloud, failure)
    call expect(error, failure, 'jitter = 0.5')
    if (allocated(error)) return
    call fill_body(body, 0.1_wp, 'relax', 0.5_wp, 1, cloud, failure)
    call expect(error, failure, 'Did you mean ''relaxed''?')
    if (allocated(error)) return
    call make_body(error, 'L', body)
    if (allocated(error)) return
    call fill_body(body, 0.7_wp, 'lattice', 0.0_wp, 1, cloud, failure)
    call expect(error, failure, 'polygon, whose edge 2 is 0.46 m long: take at most 0.66.')
    if (allocated(error)) return
    ! Two circles with hardly anything in between
    call make_annulus_body(centre, 1.0_wp, 0.98_wp, body, failure)
    call fill_body(body, 0.2_wp, 'lattice', 0.0_wp, 1, cloud, failure)
    call expect(error, failure, 'two walls are only 0.02 m apart')
    if (allocated(error)) return
    call check(error, index(failure%message, 'annulus: at (1.3, -0.2)') > 0, failure%message)
  end subroutine test_spacing_refused

  subroutine test_walls(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(body_t) :: body
    real(wp), parameter :: spacings(*) = [0.11_wp, 0.043_wp]
    character(len=:), allocatable :: name
    real(wp) :: distance, inward(2)
    integer :: b, k, s

    do b = 1, size(bodies)
      do s = 1, size(spacings)
        name = trim(bodies(b))
        call fill(error, name, spacings(s), 'relaxed', cloud, body)
        if (allocated(error)) return
        call check(error, sum(cloud%wall_length), body%perimeter(), thr=1.0e-13_wp, more=name)
        if (allocated(error)) return
        do k = 1, cloud%particles()
          associate (place => [cloud%x(k), cloud%y(k)], &
                     normal => [cloud%normal_x(k), cloud%normal_y(k)], step => 0.01_wp*spacings(s))
            call body%find_wall(place, distance, inward)
            if (cloud%side(k) == 0) then
              call check(error, distance > 0.39_wp*spacings(s), name//': inside, but too near')
              if (allocated(error)) return
              call check(error, norm2(normal) + cloud%wall_length(k), 0.0_wp, thr=0.0_wp)
            else
              call check(error, abs(distance) < 1.0e-15_wp, name//': not on the wall')
              if (allocated(error)) return
              call check(error, norm2(normal), 1.0_wp, thr=1.0e-14_wp)
              if (allocated(error)) return
              call check(error, body%contains_point(place - step*normal) .and. &
                         .not. body%contains_point(place + step*normal), name//': not outward')
              if (allocated(error)) return
              call check(error, abs(cloud%wall_length(k)/spacings(s) - 1) < 0.2_wp, &
                         name//': uneven '//to_text(cloud%wall_length(k)/spacings(s)))
            end if
          end associate
          if (allocated(error)) return
        end do
      end do
    end do
    ! Arcs, circle by circle, and both directions of their normals
    call fill(error, 'annulus', 0.05_wp, 'lattice', cloud, body)
    if (allocated(error)) return
    associate (outer => btest(cloud%side, 0), inner => btest(cloud%side, 1))
      call check(error, sum(cloud%wall_length, outer), 1.4_wp*pi, thr=1.0e-13_wp)
      if (allocated(error)) return
      call check(error, sum(cloud%wall_length, inner), 0.6_wp*pi, thr=1.0e-13_wp)
      if (allocated(error)) return
      call check(error, count(outer), 88)
      if (allocated(error)) return
      call check(error, count(inner), 38)
      if (allocated(error)) return
      call check(error, all(abs(cloud%normal_x*radius - (cloud%x - centre(1))) < 1.0e-14_wp .or. &
                            .not. outer), 'outer normals')
      if (allocated(error)) return
      call check(error, all(abs(cloud%normal_y*inner_radius + cloud%y - centre(2)) < 1.0e-14_wp &
                            .or. .not. inner), 'inner normals')
    end associate
    if (allocated(error)) return
    ! Corners are particles, convex and reentrant
    call fill(error, 'L', 0.1_wp, 'lattice', cloud, body)
    if (allocated(error)) return
    call check(error, count(popcnt(cloud%side) == 3), 6)
    if (allocated(error)) return
    k = minloc(hypot(cloud%x - notch(1), cloud%y - notch(2)), dim=1)
    call check(error, hypot(cloud%x(k) - notch(1), cloud%y(k) - notch(2)) <= 0, 'no particle')
    if (allocated(error)) return
    call check(error, hypot(cloud%normal_x(k) - sqrt(0.5_wp), cloud%normal_y(k) - sqrt(0.5_wp)) < &
               1.0e-15_wp, 'reentrant normal')
    if (allocated(error)) return
    ! 0.47 in 5 parts and 0.54 in 5
    call check(error, cloud%wall_length(k), 0.5_wp*(0.47_wp + 0.54_wp)/5, thr=1.0e-15_wp)
  end subroutine test_walls

  subroutine test_rectangle(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(body_t) :: body
    integer :: a, k

    do a = 1, size(arrangement_choices)
      call fill(error, 'rectangle', 0.1_wp, trim(arrangement_choices(a)%name), cloud, body)
      if (allocated(error)) return
      call check(error, sum(cloud%wall_length), 3.8_wp, thr=1.0e-14_wp)
      if (allocated(error)) return
      call check(error, all(hypot(cloud%normal_x, cloud%normal_y) > 0.999999_wp .eqv. &
                            cloud%side /= 0), 'normals on walls only')
      if (allocated(error)) return
      do k = 1, cloud%particles()
        if (popcnt(cloud%side(k)) /= 1) cycle
        call check(error, nint(cloud%normal_x(k)), merge(1, 0, btest(cloud%side(k), 1)) - &
                   merge(1, 0, btest(cloud%side(k), 0)))
        if (allocated(error)) return
        call check(error, nint(cloud%normal_y(k)), merge(1, 0, btest(cloud%side(k), 3)) - &
                   merge(1, 0, btest(cloud%side(k), 2)))
        if (allocated(error)) return
      end do
    end do
    call fill(error, 'rectangle', 0.1_wp, 'lattice', cloud, body)
    if (allocated(error)) return
    ! Whole, half and quarter cells
    call check(error, maxval(abs(cloud%area - 0.01_wp/2**popcnt(cloud%side))) < 1.0e-16_wp)
    if (allocated(error)) return
    call check(error, all(abs(cloud%wall_length - merge(0.1_wp, 0.0_wp, cloud%side /= 0)) < &
                          1.0e-15_wp), 'lengths')
    if (allocated(error)) return
    ! The first particle is that in the corner
    call check(error, hypot(cloud%normal_x(1) + sqrt(0.5_wp), cloud%normal_y(1) + sqrt(0.5_wp)) < &
               1.0e-15_wp)
  end subroutine test_rectangle

  subroutine test_evenness(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: spacings(*) = [0.1_wp, 0.061_wp, 0.037_wp]
    !> Smallest distance of particles, and largest distance of a place from a particle, in spacings;
    !> for lattice, hexagonal, jittered by 0.2 and relaxed
    real(wp), parameter :: nearest(*) = [0.49_wp, 0.37_wp, 0.42_wp, 0.85_wp], &
        widest(*) = [0.84_wp, 0.81_wp, 0.95_wp, 0.77_wp]
    character(len=:), allocatable :: what
    type(cloud_t) :: cloud
    type(body_t) :: body
    type(error_t), allocatable :: failure
    real(wp) :: distance
    integer :: a, b, s

    do b = 1, size(bodies)
      do s = 1, size(spacings)
        do a = 1, size(arrangement_choices)
          what = trim(bodies(b))//', '//trim(arrangement_choices(a)%name)//', '// &
                 to_text(spacings(s))//': '
          call fill(error, trim(bodies(b)), spacings(s), trim(arrangement_choices(a)%name), cloud, &
                    body)
          if (allocated(error)) return
          call check_cloud(cloud, failure)
          call check(error, .not. allocated(failure), what//'a bad cloud')
          if (allocated(error)) return
          distance = minval(neighbour_distances(cloud))/spacings(s)
          call check(error, distance > nearest(a), what//'nearest '//to_text(distance))
          if (allocated(error)) return
          distance = widest_gap(cloud, body)/spacings(s)
          call check(error, distance < widest(a), what//'gap '//to_text(distance))
          if (allocated(error)) return
        end do
      end do
    end do
  end subroutine test_evenness

  !> For each particle the distance to the nearest other one.
  function neighbour_distances(cloud) result(distance)
    type(cloud_t), intent(in) :: cloud
    real(wp), allocatable :: distance(:)
    type(neighbour_list_t) :: list
    integer :: i, k

    call build_neighbour_list(cloud%x, cloud%y, 2*cloud%spacing, list)
    allocate (distance(cloud%particles()), source=2*cloud%spacing)
    do i = 1, list%rows()
      do k = int(list%first(i)), int(list%first(i + 1)) - 1
        associate (j => list%index(k))
          distance(i) = min(distance(i), hypot(cloud%x(i) - cloud%x(j), cloud%y(i) - cloud%y(j)))
        end associate
      end do
    end do
  end function neighbour_distances

  !> The largest distance of a place of the body from the nearest particle, on a grid of places.
  function widest_gap(cloud, body) result(widest)
    type(cloud_t), intent(in) :: cloud
    type(body_t), intent(in) :: body
    real(wp) :: widest
    real(wp) :: place(2), step, x_range(2), y_range(2)
    integer :: column, row

    call body%find_extent(x_range, y_range)
    step = 0.23_wp*cloud%spacing
    widest = 0
    do column = 0, int((x_range(2) - x_range(1))/step)
      do row = 0, int((y_range(2) - y_range(1))/step)
        place = [x_range(1) + column*step, y_range(1) + row*step]
        if (.not. body%contains_point(place)) cycle
        widest = max(widest, minval((cloud%x - place(1))**2 + (cloud%y - place(2))**2))
      end do
    end do
    widest = sqrt(widest)
  end function widest_gap

  subroutine test_rows(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: spacings(*) = [0.12_wp, 0.083_wp, 0.05_wp, 0.031_wp], support = 2.1_wp
    class(kernel_t), allocatable :: kernel
    class(laplacian_scheme_t), allocatable :: scheme
    type(error_t), allocatable :: failure
    type(cloud_t) :: cloud
    type(body_t) :: body
    type(sparse_operator_t) :: laplacian
    type(row_report_t) :: report
    type(row_repairs_t) :: repairs
    real(wp), allocatable :: support_radius(:)
    integer(ip), allocatable :: free(:)
    integer :: a, b, k, s

    call make_kernel('wendland_c2', kernel, failure)
    call make_laplacian_scheme('fatehi_manzari', scheme, failure)
    do b = 1, size(bodies)
      do s = 1, size(spacings)
        do a = 1, size(arrangement_choices)
          call fill(error, trim(bodies(b)), spacings(s), trim(arrangement_choices(a)%name), cloud, &
                    body, jitter=0.3_wp)
          if (allocated(error)) return
          free = pack([(int(k, ip), k=1, cloud%particles())], cloud%side == 0)
          if (allocated(support_radius)) deallocate (support_radius)
          allocate (support_radius(cloud%particles()), source=support*cloud%spacing)
          call assemble_stable_rows(scheme, kernel, cloud%x, cloud%y, cloud%volume, &
                                    support_radius, free, laplacian, report, repairs)
          call check(error, all(repairs%repair < positive_stencil), trim(bodies(b))//', '// &
                     trim(arrangement_choices(a)%name)//', '//to_text(spacings(s)))
          if (allocated(error)) return
          call check(error, all(repairs%quality%residual < 1.0e-7_wp) .and. &
                     all(repairs%quality%ratio <= 1.2_wp), 'not exact for quadratic fields')
          if (allocated(error)) return
          ! Relaxed particles need no repair at all
          if (arrangement_choices(a)%name /= 'relaxed') cycle
          call check(error, all(repairs%repair == 0), trim(bodies(b))//': repaired')
          if (allocated(error)) return
        end do
      end do
    end do
  end subroutine test_rows

  subroutine test_area_sums(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: spacings(*) = [0.2_wp, 0.07_wp, 0.031_wp]
    type(cloud_t) :: cloud
    type(body_t) :: body
    integer :: a, b, s

    do b = 1, size(bodies)
      do s = 1, size(spacings)
        do a = 1, size(arrangement_choices)
          call fill(error, trim(bodies(b)), spacings(s), trim(arrangement_choices(a)%name), cloud, &
                    body, jitter=0.45_wp)
          if (allocated(error)) return
          call check(error, sum(cloud%area), body%area(), thr=1.0e-12_wp, more=trim(bodies(b))// &
                     ', '//trim(arrangement_choices(a)%name)//', '//to_text(spacings(s)))
          if (allocated(error)) return
          call check(error, all(cloud%area > 0), 'an area is not positive')
          if (allocated(error)) return
        end do
      end do
    end do
    ! Far away, and small
    call far_away(error, 1.0e6_wp, 1.0_wp)
    if (.not. allocated(error)) call far_away(error, 0.0_wp, 1.0e-9_wp)
  end subroutine test_area_sums

  subroutine far_away(error, offset, size_of_it)
    type(error_type), allocatable, intent(out) :: error
    real(wp), intent(in) :: offset, size_of_it
    type(error_t), allocatable :: failure
    type(cloud_t) :: cloud
    type(body_t) :: body

    call make_annulus_body([offset, offset], size_of_it, 0.5_wp*size_of_it, body, failure)
    call fill_body(body, 0.05_wp*size_of_it, 'relaxed', 0.0_wp, 1, cloud, failure)
    call check(error, .not. allocated(failure), 'not filled')
    if (allocated(error)) return
    call check(error, sum(cloud%area)/size_of_it**2, 0.75_wp*pi, thr=1.0e-9_wp)
  end subroutine far_away

  !> The integral of cos(2x + y), whose mean over a circle is that in the centre times J₀(√5 r).
  subroutine test_quadrature(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp), parameter :: spacing = 0.08_wp
    type(cloud_t) :: cloud
    type(body_t) :: body
    character(len=:), allocatable :: what
    real(wp) :: deviation(3), exact
    integer :: a, b, level

    do b = 1, size(bodies)
      select case (bodies(b))
      case ('rectangle')
        exact = over_rectangle(0.0_wp, 1.0_wp, -0.3_wp, 0.6_wp)
      case ('disc')
        exact = over_disc(radius)
      case ('annulus')
        exact = over_disc(radius) - over_disc(inner_radius)
      case ('L')
        exact = over_rectangle(0.0_wp, 1.0_wp, 0.0_wp, 1.0_wp) - &
                over_rectangle(notch(1), 1.0_wp, notch(2), 1.0_wp)
      case default
        exact = over_rectangle(0.0_wp, 1.0_wp, 0.0_wp, 1.0_wp) - &
                over_rectangle(0.2_wp, 0.4_wp, 0.3_wp, 0.7_wp) - &
                over_rectangle(0.6_wp, 0.8_wp, 0.5_wp, 0.8_wp)
      end select
      do a = 1, size(arrangement_choices)
        what = trim(bodies(b))//', '//trim(arrangement_choices(a)%name)
        do level = 1, 3
          call fill(error, trim(bodies(b)), spacing/2**(level - 1), &
                    trim(arrangement_choices(a)%name), cloud, body)
          if (allocated(error)) return
          deviation(level) = sum(cloud%area*cos(2*cloud%x + cloud%y)) - exact
        end do
        ! Second order: sixteen times less at a quarter of the spacing
        call check(error, abs(deviation(1)) < 0.5_wp*spacing**2, what//to_text(deviation(1)))
        if (allocated(error)) return
        associate (ratio => deviation(1)/deviation(3))
          call check(error, ratio > 12 .and. ratio < 25, what//to_text(ratio))
        end associate
        if (allocated(error)) return
      end do
    end do
  end subroutine test_quadrature

  !> ∫ cos(2x + y) over a disc, and over a rectangle
  pure function over_disc(radius) result(integral)
    real(wp), intent(in) :: radius
    real(wp) :: integral
    real(wp), parameter :: k = sqrt(5.0_wp)

    integral = 2*pi*radius*bessel_j1(k*radius)/k*cos(2*centre(1) + centre(2))
  end function over_disc

  pure function over_rectangle(left, right, bottom, top) result(integral)
    real(wp), intent(in) :: left, right, bottom, top
    real(wp) :: integral

    integral = 0.5_wp*(cos(2*left + top) + cos(2*right + bottom) - cos(2*right + top) - &
                       cos(2*left + bottom))
  end function over_rectangle

  subroutine test_relaxed(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud
    type(body_t) :: body
    real(wp), allocatable :: distance(:), wall(:)
    real(wp) :: inward(2)
    integer :: b, k

    do b = 1, size(bodies)
      call fill(error, trim(bodies(b)), 0.025_wp, 'relaxed', cloud, body, seed=5)
      if (allocated(error)) return
      distance = neighbour_distances(cloud)/cloud%spacing
      call check(error, minval(distance) > 0.85_wp, trim(bodies(b))//to_text(minval(distance)))
      if (allocated(error)) return
      associate (mean => sum(distance)/size(distance))
        call check(error, mean > 0.97_wp .and. mean < 1.02_wp, trim(bodies(b))//to_text(mean))
      end associate
      if (allocated(error)) return
      ! As many particles inside as there is room for, to within the chance of the start
      associate (room => (body%area() - 0.5_wp*cloud%spacing*body%perimeter())/cloud%spacing**2)
        call check(error, abs(count(cloud%side == 0)/room - 1) < 0.01_wp, 'number')
      end associate
      if (allocated(error)) return
      ! Every particle inside stands for nearly the same area
      call check(error, maxval(cloud%area, cloud%side == 0) < 1.25_wp*cloud%spacing**2 .and. &
                 minval(cloud%area, cloud%side == 0) > 0.8_wp*cloud%spacing**2, 'areas')
      if (allocated(error)) return
      ! A layer along the walls, and nothing between it and them
      allocate (wall(cloud%particles()))
      do k = 1, size(wall)
        call body%find_wall([cloud%x(k), cloud%y(k)], wall(k), inward)
      end do
      wall = wall/cloud%spacing
      call check(error, .not. any(cloud%side == 0 .and. wall < 0.6_wp), 'between wall and layer')
      if (allocated(error)) return
      associate (layer => count(cloud%side == 0 .and. wall < 1.2_wp)/ &
                 real(count(cloud%side /= 0), wp))
        call check(error, layer > 0.85_wp .and. layer < 1.1_wp, 'layer '//to_text(layer))
      end associate
      if (allocated(error)) return
      deallocate (wall)
    end do
  end subroutine test_relaxed

  subroutine test_seed(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: first, other, again
    type(body_t) :: body
    integer :: threads

    threads = omp_get_max_threads()
    call omp_set_num_threads(1)
    call fill(error, 'annulus', 0.03_wp, 'relaxed', first, body, seed=11)
    call omp_set_num_threads(3)
    if (.not. allocated(error)) then
      call fill(error, 'annulus', 0.03_wp, 'relaxed', again, body, seed=11)
    end if
    call omp_set_num_threads(threads)
    if (allocated(error)) return
    call check(error, first%particles(), again%particles())
    if (allocated(error)) return
    call check(error, all(abs(first%x - again%x) + abs(first%y - again%y) <= 0))
    if (allocated(error)) return
    call check(error, all(abs(first%area - again%area) <= 0))
    if (allocated(error)) return
    call fill(error, 'annulus', 0.03_wp, 'relaxed', other, body, seed=12)
    if (allocated(error)) return
    associate (n => min(first%particles(), other%particles()))
      call check(error, count(first%side(:n) == 0 .and. abs(first%x(:n) - other%x(:n)) <= 0), 0)
    end associate
  end subroutine test_seed

  !> Even the strongest jitter leaves half a spacing to the walls, and is there where there is room.
  subroutine test_jitter(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud, lattice
    type(body_t) :: body
    real(wp), allocatable :: way(:), wall(:)
    real(wp) :: inward(2)
    integer :: b, k

    do b = 2, size(bodies)
      call fill(error, trim(bodies(b)), 0.04_wp, 'lattice', lattice, body)
      if (allocated(error)) return
      call fill(error, trim(bodies(b)), 0.04_wp, 'jittered', cloud, body, jitter=0.49_wp)
      if (allocated(error)) return
      call check(error, cloud%particles(), lattice%particles())
      if (allocated(error)) return
      wall = 0*cloud%x
      do k = 1, size(wall)
        call body%find_wall([cloud%x(k), cloud%y(k)], wall(k), inward)
      end do
      call check(error, all(wall > 0.4999_wp*cloud%spacing .or. cloud%side /= 0), 'near a wall')
      if (allocated(error)) return
      way = max(abs(cloud%x - lattice%x), abs(cloud%y - lattice%y))/cloud%spacing
      call check(error, maxval(way) > 0.47_wp .and. maxval(way) < 0.5_wp, to_text(maxval(way)))
      if (allocated(error)) return
      call check(error, all(way <= 0 .or. cloud%side == 0), 'a wall moves')
      if (allocated(error)) return
      ! 0.33 on average without walls
      call check(error, sum(way)/count(cloud%side == 0) > 0.28_wp, 'most stay')
      if (allocated(error)) return
    end do
  end subroutine test_jitter

  !> Prepare a scene of data/ without its output.
  subroutine prepare(error, file, spacing, arrangement, simulation)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: file
    real(wp), intent(in) :: spacing
    character(len=*), intent(in) :: arrangement
    type(simulation_t), intent(out) :: simulation
    type(error_t), allocatable :: failure
    type(scene_t) :: scene

    call read_scene('data/'//file, scene, failure)
    if (.not. allocated(failure)) then
      scene%output%file = ''
      scene%domain%spacing = spacing
      scene%domain%arrangement = arrangement
      scene%domain%jitter = 0.2_wp
      scene%time%tolerance = 1.0e-7_wp
      call simulation%prepare(scene, failure)
    end if
    if (allocated(failure)) call test_failed(error, failure%message)
  end subroutine prepare

  !> The error of a scene of data/ at its end.
  subroutine run_scene(error, file, spacing, arrangement, deviation)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), intent(in) :: file
    real(wp), intent(in) :: spacing
    character(len=*), intent(in) :: arrangement
    real(wp), intent(out) :: deviation
    type(simulation_t) :: simulation
    type(error_t), allocatable :: failure

    deviation = 0
    call prepare(error, file, spacing, arrangement, simulation)
    if (allocated(error)) return
    call simulation%run(failure)
    if (allocated(failure)) then
      call test_failed(error, failure%message)
    else
      deviation = simulation%relative_l2_error()
    end if
  end subroutine run_scene

  subroutine test_disc_scene(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: deviation(3)
    character(len=:), allocatable :: name
    integer :: a, level

    do a = 1, size(arrangement_choices)
      name = trim(arrangement_choices(a)%name)
      do level = 1, 3
        call run_scene(error, 'disc.nml', 0.1_wp/2**(level - 1), name, deviation(level))
        if (allocated(error)) return
      end do
      call check(error, deviation(1) < 3.0e-3_wp, name//to_text(deviation(1)))
      if (allocated(error)) return
      call check(error, all(deviation(:2)/deviation(2:) > 3.6_wp), name//' is not of second order')
      if (allocated(error)) return
    end do
  end subroutine test_disc_scene

  subroutine test_annulus_scene(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: deviation
    character(len=:), allocatable :: name
    integer :: a

    do a = 1, size(arrangement_choices)
      name = trim(arrangement_choices(a)%name)
      call run_scene(error, 'annulus.nml', 0.006_wp, name, deviation)
      if (allocated(error)) return
      call check(error, deviation < 3.0e-4_wp, name//to_text(deviation))
      if (allocated(error)) return
    end do
  end subroutine test_annulus_scene

  subroutine test_l_scene(error)
    type(error_type), allocatable, intent(out) :: error
    real(wp) :: deviation(2)
    character(len=:), allocatable :: name
    integer :: a, level

    do a = 1, size(arrangement_choices)
      name = trim(arrangement_choices(a)%name)
      do level = 1, 2
        call run_scene(error, 'l_shape.nml', 0.13_wp/2**(level - 1), name, deviation(level))
        if (allocated(error)) return
      end do
      call check(error, deviation(1) < 3.0e-2_wp .and. deviation(1)/deviation(2) > 3.6_wp, name)
      if (allocated(error)) return
    end do
  end subroutine test_l_scene

  !> What is said later counts, for an edge as for a loop; a name that no particle has is refused.
  subroutine test_held(error)
    type(error_type), allocatable, intent(out) :: error
    character(len=*), parameter :: domain = '&domain shape = ''polygon'' spacing = 0.1 '// &
        'vertices = 0,0, 1,0, 1,1, 0,1 hole_vertices = 0.4,0.4, 0.6,0.4, 0.6,0.6, 0.4,0.6 / '// &
        '&time end = 1e-9 / ', outer = '&boundary on = ''outer'' value = 1 / '
    type(simulation_t) :: simulation
    type(scene_t) :: scene
    type(error_t), allocatable :: failure

    call interpret_scene(domain//outer//'&boundary on = ''hole 1'' value = 2 / '// &
                         '&boundary on = ''edge 8'' value = 3 /', scene, failure)
    if (.not. allocated(failure)) call simulation%prepare(scene, failure)
    call check(error, .not. allocated(failure), 'a good scene is refused')
    if (allocated(error)) return
    associate (cloud => simulation%cloud, temperature => simulation%temperature)
      call check(error, count(abs(temperature - 1) <= 0 .and. cloud%side /= 0), 40)
      if (allocated(error)) return
      call check(error, all(abs(temperature - 3) <= 0 .eqv. abs(cloud%x - 0.4_wp) < 1.0e-12_wp &
                            .and. abs(cloud%y - 0.5_wp) < 0.1001_wp .and. cloud%side /= 0))
      if (allocated(error)) return
      call check(error, count(abs(temperature - 2) <= 0), 5)
      if (allocated(error)) return
    end associate
    call interpret_scene(domain//outer//'&boundary on = ''edge 9'' value = 2 /', scene, failure)
    call simulation%prepare(scene, failure)
    call expect(error, failure, 'no boundary called ''edge 9''')
    if (allocated(error)) return
    call interpret_scene(domain//outer, scene, failure)
    call simulation%prepare(scene, failure)
    call expect(error, failure, 'nothing is said about the boundaries ''edge 5'', ')
    if (allocated(error)) return
    call check(error, index(failure%message, '''hole 1''') > 0, failure%message)
    if (allocated(error)) return
    ! A short edge that makes no corner lies between two particles
    call interpret_scene('&domain shape = ''polygon'' spacing = 0.2 vertices = 0,0, 0.5,0, '// &
                         '0.52,0, 1,0, 1,1, 0,1 / &time end = 1 / '//outer// &
                         '&boundary on = ''edge 2'' value = 0 /', scene, failure)
    call simulation%prepare(scene, failure)
    call expect(error, failure, 'no particle lies on ''edge 2'': lower')
  end subroutine test_held

  subroutine test_reorder(error)
    type(error_type), allocatable, intent(out) :: error
    type(cloud_t) :: cloud, original
    type(body_t) :: body
    integer(ip), allocatable :: order(:)

    call fill(error, 'disc', 0.1_wp, 'relaxed', original, body)
    if (allocated(error)) return
    cloud = original
    call hilbert_order(cloud%x, cloud%y, order)
    call cloud%reorder(order)
    associate (place => cloud%user_index)
      call check(error, any(place(2:) < place(:size(place) - 1)), 'nothing was reordered')
      if (allocated(error)) return
      call check(error, all(abs(cloud%area - original%area(place)) <= 0), 'area')
      if (allocated(error)) return
      call check(error, all(abs(cloud%wall_length - original%wall_length(place)) <= 0), 'length')
      if (allocated(error)) return
      call check(error, all(abs(cloud%normal_x - original%normal_x(place)) <= 0), 'normal_x')
      if (allocated(error)) return
      call check(error, all(abs(cloud%normal_y - original%normal_y(place)) <= 0), 'normal_y')
    end associate
  end subroutine test_reorder

end module test_shapes
