!> The memory that a scene takes, and whether the machine has it.
module calor_memory_need
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: wp
  use calor_machine_memory, only: available_memory
  use calor_scene, only: scene_t
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: memory_need, further_need, check_memory, size_text

  !> Measured at the highest, in the search for unstable modes, with up to a million particles.
  !> A neighbour has two weights then, as assembled and as laid out for steps; a particle has
  !> place, volume, area, normal, order, quality of its row and state, and some 25 entries of
  !> vectors.
  real(wp), parameter :: bytes_per_neighbour = 24, bytes_per_particle = 460

contains

  !> Bytes that a simulation takes.
  pure function memory_need(particles, neighbours) result(bytes)
    !> Number of particles; a real number, as it may be one that no integer can hold
    real(wp), intent(in) :: particles
    !> Neighbours of a particle on average
    real(wp), intent(in) :: neighbours
    real(wp) :: bytes

    bytes = particles*(bytes_per_particle + bytes_per_neighbour*neighbours)
  end function memory_need

  !> What a scene takes beyond that for what it asks for, measured for 40,401 particles.
  !>
  !> A sparse factorisation grows by nested dissection, as log₂ of the number of particles times
  !> that number (A. George, SIAM J. Numer. Anal. 10 (1973) 345).
  pure function further_need(scene, particles) result(bytes)
    !> The scene
    type(scene_t), intent(in) :: scene
    !> Number of particles
    real(wp), intent(in) :: particles
    real(wp) :: bytes
    real(wp), parameter :: factor = 240, reference_rows = 1200, own_rows = 900
    logical :: solves

    bytes = 0
    solves = scene%time%steady
    if (allocated(scene%time%method)) solves = solves .or. scene%time%method == 'tr_bdf2'
    if (solves) bytes = bytes + factor*log(max(2.0_wp, particles))/log(2.0_wp)
    if (scene%accuracy%estimate) bytes = bytes + reference_rows
    if (scene%operators%field_expression /= '') bytes = bytes + own_rows
    if (scene%laplacian == 'consistent' .or. scene%laplacian == 'double_gradient') then
      bytes = bytes + own_rows
    end if
    bytes = bytes*particles
  end function further_need

  !> Refuse what the machine has no memory for: the system would end the program in the middle.
  subroutine check_memory(particles, scene, error)
    !> Number of particles, exact or nearly so
    real(wp), intent(in) :: particles
    !> The scene that asks for so many
    type(scene_t), intent(in) :: scene
    !> There is not enough
    type(error_t), allocatable, intent(out) :: error
    !> What does not grow with the particles: buffers of the libraries, for files above all
    real(wp), parameter :: once = 4.0e6_wp
    real(wp), parameter :: pi = acos(-1.0_wp)
    real(wp) :: neighbours, need, available

    neighbours = particles
    if (scene%support < sqrt(particles)) neighbours = min(particles, pi*scene%support**2)
    need = once + memory_need(particles, neighbours) + further_need(scene, particles)
    available = real(available_memory(), wp)
    if (need < available) return
    call raise(error, status_bad_input, scene%domain%place//': this makes about '// &
               to_text(particles, digits=3)//' particles with about '// &
               to_text(neighbours, digits=3)//' neighbours each, which take '//size_text(need)// &
               ' of memory, but there are only '//size_text(available)// &
               ' to spare. Raise &domain spacing or lower &kernel support.')
  end subroutine check_memory

  !> An amount of memory for people, as in '1.5 GB'.
  pure function size_text(bytes) result(text)
    !> The amount
    real(wp), intent(in) :: bytes
    character(len=:), allocatable :: text

    if (bytes < 1.0e6_wp) then
      text = to_text(max(1.0_wp, bytes/1.0e3_wp), digits=2)//' kB'
    else if (bytes < 1.0e9_wp) then
      text = to_text(bytes/1.0e6_wp, digits=3)//' MB'
    else
      text = to_text(bytes/1.0e9_wp, digits=3)//' GB'
    end if
  end function size_text

end module calor_memory_need
