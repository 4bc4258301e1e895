!> The memory that a scene takes, and whether the machine has it.
module calor_memory_need
  use calor_error, only: error_t, raise, status_bad_input
  use calor_kinds, only: wp
  use calor_machine_memory, only: available_memory
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: memory_need, check_memory, size_text

  !> Measured at the highest. A neighbour is listed with its weight, and listed once more while that
  !> happens; a particle has place, volume, area, normal, order, state and stages, 192 bytes, and
  !> 35 entries of vectors in the search for unstable modes.
  real(wp), parameter :: bytes_per_neighbour = 16, bytes_per_particle = 472

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

  !> Refuse what the machine has no memory for: the system would end the program in the middle.
  subroutine check_memory(particles, support, place, error)
    !> Number of particles, exact or nearly so
    real(wp), intent(in) :: particles
    !> Support radius in units of the spacing
    real(wp), intent(in) :: support
    !> Where the scene asks for so many
    character(len=*), intent(in) :: place
    !> There is not enough
    type(error_t), allocatable, intent(out) :: error
    real(wp), parameter :: pi = acos(-1.0_wp)
    real(wp) :: neighbours, need, available

    neighbours = particles
    if (support < sqrt(particles)) neighbours = min(particles, pi*support**2)
    need = memory_need(particles, neighbours)
    available = real(available_memory(), wp)
    if (need < available) return
    call raise(error, status_bad_input, place//': this makes about '// &
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
