!> From a scene to the particles that one rank keeps: its own, and those of others within reach.
module calor_shared_cloud
  use calor_body, only: body_t
  use calor_cell_area, only: find_cell_areas
  use calor_cloud, only: cloud_t
  use calor_cloud_check, only: check_cloud
  use calor_curve_bands, only: bands_t
  use calor_error, only: error_t, raise, status_bad_input
  use calor_halo, only: add_halo
  use calor_kernel, only: kernel_t
  use calor_kernels, only: make_kernel
  use calor_kinds, only: wp, i8
  use calor_ranks, only: ranks_t
  use calor_scene, only: scene_t
  use calor_scene_body, only: make_scene_body
  use calor_scene_cloud, only: make_scene_slice
  use calor_slice, only: slice_t
  use calor_text, only: to_text
  use calor_volume, only: volumes_from_kernel
  use mpi_f08, only: mpi_allreduce, mpi_bor, mpi_in_place, mpi_integer, mpi_logical, mpi_lor
  implicit none (type, external)
  private

  public :: shared_cloud_t

  !> Rows end to grow at so many neighbours; a rank has more particles than that, if there are as
  !> many
  integer, parameter :: most_neighbours = 400
  !> The reach at first, in support radii: most rows find what they need within that
  real(wp), parameter :: first_reach = 1.5_wp
  !> Areas need particles within so many spacings, and interfaces of materials so many more than
  !> rows
  real(wp), parameter :: area_reach = 3.0_wp, interface_reach = 6.0_wp

  type :: shared_cloud_t
    type(bands_t) :: bands
    !> The rank's own particles
    type(cloud_t) :: own
    !> Those and the ones within reach, and the number of each in the whole, from 1
    type(cloud_t) :: cloud
    integer(i8), allocatable :: number(:)
    !> Which boundaries consist of others
    logical, allocatable :: covers(:, :)
    !> How far it reaches, m
    real(wp) :: reach = 0.0_wp
    !> Particles on walls, of all ranks
    integer(i8) :: on_walls = 0
  contains
    !> Make a scene's
    procedure :: make
    !> Reach farther, where rows looked farther than that on any rank
    procedure :: extend
    procedure, private :: reach_out
  end type shared_cloud_t

contains

  subroutine make(this, ranks, scene, error)
    class(shared_cloud_t), intent(inout) :: this
    type(ranks_t), intent(in) :: ranks
    type(scene_t), intent(in) :: scene
    !> The scene's domain is wrong
    type(error_t), allocatable, intent(out) :: error
    type(slice_t) :: slice
    logical :: has_volume
    integer :: k

    slice = slice_t(ranks%rank, ranks%ranks)
    call make_scene_slice(scene, slice, this%own, has_volume, error)
    call ranks%agree(error)
    if (allocated(error)) return
    if (scene%domain%shape == 'cloud') then
      associate (before => ranks%before(int(this%own%particles(), i8)))
        this%own%user_index = this%own%user_index + int(before)
      end associate
      call find_spacing(ranks, scene, has_volume, this%own, error)
      if (allocated(error)) return
    else if (scene%domain%shape /= 'rectangle') then
      ! Those inside were numbered as if no others came before.
      associate (before => ranks%before(int(count(this%own%side == 0), i8)))
        do k = 1, this%own%particles()
          if (this%own%side(k) == 0) this%own%user_index(k) = int(this%own%user_index(k) + before)
        end do
      end associate
    end if
    call find_covers(ranks, this%own, this%covers)
    call this%bands%share_out(ranks, this%own)
    this%on_walls = ranks%total(int(count(this%own%side /= 0), i8))
    call check_sides(scene, this%bands%particles, this%on_walls, error)
    if (allocated(error)) return
    if (this%bands%particles < 2*ranks%ranks) then
      call raise(error, status_bad_input, scene%domain%place//': '// &
                 to_text(int(this%bands%particles))//' particles are too few for '// &
                 to_text(ranks%ranks)//' ranks: take fewer, or lower spacing.')
      return
    end if
    this%reach = max(first_reach*scene%support, area_reach)*this%own%spacing
    if (.not. scene%uniform_material) then
      this%reach = this%reach + interface_reach*this%own%spacing
    end if
    if (.not. has_volume) then
      call find_volumes(this, ranks, scene, error)
      if (allocated(error)) return
    end if
    if (scene%domain%shape == 'cloud') this%own%area = this%own%volume
    call this%reach_out(ranks, scene, error)
  end subroutine make

  !> A user's cloud: the spacing given, or the root of the mean particle volume.
  subroutine find_spacing(ranks, scene, has_volume, cloud, error)
    type(ranks_t), intent(in) :: ranks
    type(scene_t), intent(in) :: scene
    logical, intent(in) :: has_volume
    type(cloud_t), intent(inout) :: cloud
    type(error_t), allocatable, intent(out) :: error

    if (scene%domain%spacing > 0) return
    if (has_volume) then
      cloud%spacing = sqrt(ranks%total(sum(cloud%volume))/ranks%total(int(cloud%particles(), i8)))
    else
      call raise(error, status_bad_input, &
                 scene%domain%place//': The cloud''s file has no column '// &
                 '''volume'', so &domain needs spacing: the distance between neighbouring '// &
                 'particles in metres.')
    end if
  end subroutine find_spacing

  !> Volumes of the own particles from how densely they lie.
  subroutine find_volumes(this, ranks, scene, error)
    class(shared_cloud_t), intent(inout) :: this
    type(ranks_t), intent(in) :: ranks
    type(scene_t), intent(in) :: scene
    type(error_t), allocatable, intent(out) :: error
    class(kernel_t), allocatable :: kernel

    call make_kernel(scene%kernel, kernel, error)
    if (allocated(error)) return
    call add_halo(ranks, this%bands, this%own, this%reach, this%cloud, this%number)
    call volumes_from_kernel(this%cloud, kernel, scene%support*this%own%spacing)
    this%own%volume = this%cloud%volume(this%cloud%own_first:this%cloud%own_last)
  end subroutine find_volumes

  !> Get the particles within reach, and so many at least that no row wants more.
  subroutine reach_out(this, ranks, scene, error)
    class(shared_cloud_t), intent(inout) :: this
    type(ranks_t), intent(in) :: ranks
    type(scene_t), intent(in) :: scene
    type(error_t), allocatable, intent(out) :: error
    type(body_t) :: body
    logical :: few

    do
      call add_halo(ranks, this%bands, this%own, this%reach, this%cloud, this%number)
      few = this%cloud%particles() < min(int(most_neighbours, i8), this%bands%particles)
      if (few) this%reach = 1.5_wp*this%reach
      if (.not. ranks%any_of(few)) exit
    end do
    this%cloud%covers = this%covers
    associate (square => this%bands%square)
      this%cloud%extent = (2.0_wp**30 - 1)/square%per_length
    end associate
    if (scene%domain%shape /= 'cloud') then
      call make_scene_body(scene%domain, body, error)
      call find_cell_areas(body, this%cloud%spacing, this%cloud%x, this%cloud%y, this%cloud%area)
    end if
    if (.not. allocated(error)) call check_cloud(this%cloud, error)
    if (allocated(error)) error%message = scene%domain%place//': '//error%message
    call ranks%agree(error)
  end subroutine reach_out

  subroutine extend(this, ranks, scene, widest, done, error)
    class(shared_cloud_t), intent(inout) :: this
    type(ranks_t), intent(in) :: ranks
    type(scene_t), intent(in) :: scene
    !> The largest radius, m, in which this rank's rows looked for neighbours
    real(wp), intent(in) :: widest
    !> Whether no rank's rows lacked any
    logical, intent(out) :: done
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: needed

    needed = widest
    if (.not. scene%uniform_material) needed = needed + interface_reach*this%own%spacing
    done = .not. ranks%any_of(needed > this%reach)
    if (done) return
    if (needed > this%reach) this%reach = max(needed, 1.5_wp*this%reach)
    call this%reach_out(ranks, scene, error)
  end subroutine extend

  !> Which boundaries consist of others: a covers b if all of b are on a, and some of a not on b.
  subroutine find_covers(ranks, cloud, covers)
    type(ranks_t), intent(in) :: ranks
    type(cloud_t), intent(in) :: cloud
    logical, allocatable, intent(out) :: covers(:, :)
    logical, allocatable :: apart(:, :)
    integer :: a, b, boundaries, there

    boundaries = size(cloud%boundary)
    allocate (apart(0:boundaries - 1, 0:boundaries - 1))
    there = 0
    if (cloud%particles() > 0) there = iany(cloud%side)
    call mpi_allreduce(mpi_in_place, there, 1, mpi_integer, mpi_bor, ranks%comm)
    do b = 0, boundaries - 1
      do a = 0, boundaries - 1
        apart(a, b) = any(btest(cloud%side, b) .and. .not. btest(cloud%side, a))
      end do
    end do
    call mpi_allreduce(mpi_in_place, apart, size(apart), mpi_logical, mpi_lor, ranks%comm)
    allocate (covers(0:boundaries - 1, 0:boundaries - 1))
    do b = 0, boundaries - 1
      do a = 0, boundaries - 1
        covers(a, b) = btest(there, b) .and. .not. apart(a, b) .and. apart(b, a)
      end do
    end do
  end subroutine find_covers

  !> Some particle must lie on a wall, and some must not.
  subroutine check_sides(scene, particles, on_walls, error)
    type(scene_t), intent(in) :: scene
    integer(i8), intent(in) :: particles, on_walls
    type(error_t), allocatable, intent(out) :: error

    if (on_walls == particles) then
      call raise(error, status_bad_input, scene%path//': all '//to_text(int(particles))// &
                 ' particles lie on the boundary: lower &domain spacing.')
    else if (on_walls == 0) then
      call raise(error, status_bad_input, scene%path//': no particle of the cloud is marked as '// &
                 'a wall, so nothing can be said about its boundary: give its file a column '// &
                 '''wall'' with 1 for the particles on the boundary.')
    end if
  end subroutine check_sides

end module calor_shared_cloud
