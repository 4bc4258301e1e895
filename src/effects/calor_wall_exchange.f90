!> What passes through walls: the frame of all boundary conditions that give or compute a heat flux.
!>
!> A flux q into the body, W/m², at a contact whose row has the weight b of the normal derivative is
!> a power b q, W/m³, at the particle (see calor_wall_rows): no equation beside the heat equation.
module calor_wall_exchange
  use calor_effect, only: effect_t
  use calor_error, only: error_t
  use calor_kinds, only: wp, ip, i8
  use calor_medium, only: medium_t
  use calor_places, only: places_t
  use calor_scene_file, only: group_t
  use calor_scene_getters, only: raise_at
  implicit none (type, external)
  private

  public :: wall_exchange_t, refuse_other_keys

  type, abstract, extends(effect_t) :: wall_exchange_t
    !> Its number among the groups &boundary
    integer :: condition = 0
    !> The contacts that it holds at (see wall_contacts_t), and their particles
    integer, allocatable :: contact(:)
    integer(ip), allocatable :: particle(:)
    !> Coordinates of these, m
    real(wp), allocatable :: x(:), y(:)
    !> Weight of the normal derivative, 1/m
    real(wp), allocatable :: weight(:)
    !> Their temperatures, and the flux into the body at the last call, W/m²
    real(wp), allocatable :: temperature(:), flux(:)
  contains
    !> Read the keys of its own kind
    procedure(read_kind_interface), deferred :: read_kind
    !> Make ready, all arrays above being filled
    procedure(prepare_kind_interface), deferred :: prepare_kind
    !> Find `flux` at `temperature`
    procedure(find_flux_interface), deferred :: find_flux
    !> Find its derivative with respect to the temperature
    procedure :: find_flux_slope
    !> Take the paths of its particles
    procedure :: follow_kind
    procedure :: read => read_exchange
    procedure :: prepare
    procedure :: add_power
    procedure :: add_slope
    procedure :: account
    procedure :: put_flux
    procedure :: follow
  end type wall_exchange_t

  abstract interface
    subroutine read_kind_interface(this, group, error)
      import :: wall_exchange_t, group_t, error_t
      implicit none (type, external)
      class(wall_exchange_t), intent(inout) :: this
      !> The group
      type(group_t), intent(in) :: group
      !> A key is missing or wrong
      type(error_t), allocatable, intent(out) :: error
    end subroutine read_kind_interface

    subroutine prepare_kind_interface(this, medium, error)
      import :: wall_exchange_t, medium_t, error_t
      implicit none (type, external)
      class(wall_exchange_t), intent(inout) :: this
      !> The particles
      type(medium_t), intent(in) :: medium
      !> A value is no number or out of bounds
      type(error_t), allocatable, intent(out) :: error
    end subroutine prepare_kind_interface

    subroutine find_flux_interface(this, time)
      import :: wall_exchange_t, wp
      implicit none (type, external)
      class(wall_exchange_t), intent(inout) :: this
      !> Time, s
      real(wp), intent(in) :: time
    end subroutine find_flux_interface
  end interface

contains

  subroutine read_exchange(this, group, number, error)
    class(wall_exchange_t), intent(inout) :: this
    type(group_t), intent(in) :: group
    integer, intent(in) :: number
    type(error_t), allocatable, intent(out) :: error

    this%condition = number
    call this%read_kind(group, error)
  end subroutine read_exchange

  !> Keys that would change nothing are refused, so that nobody believes they did.
  subroutine refuse_other_keys(group, keys, error)
    !> A group &boundary
    type(group_t), intent(in) :: group
    !> What its kind has beside on, kind and where_expression, without `_expression`
    character(len=*), intent(in) :: keys(:)
    !> The group has another
    type(error_t), allocatable, intent(out) :: error
    character(len=:), allocatable :: key
    integer :: k

    do k = 1, size(group%entries)
      key = group%entries(k)%key
      if (key == 'on' .or. key == 'kind' .or. key == 'where_expression') cycle
      if (index(key, '_expression') > 0) key = key(:index(key, '_expression') - 1)
      if (any(keys == key)) cycle
      call raise_at(error, group, group%entries(k)%key, 'it means nothing with kind = '''// &
                    group%entries(group%find('kind'))%values(1)%text//'''; remove it.')
      return
    end do
  end subroutine refuse_other_keys

  subroutine prepare(this, medium, temperature, error)
    class(wall_exchange_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    real(wp), intent(in) :: temperature(:)
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    associate (contacts => medium%contacts)
      this%contact = pack([(k, k=1, size(contacts%particle))], &
                          contacts%condition == this%condition)
      this%particle = contacts%particle(this%contact)
      this%weight = contacts%weight(this%contact)
    end associate
    this%x = medium%x(this%particle)
    this%y = medium%y(this%particle)
    this%temperature = temperature(this%particle)
    allocate (this%flux(size(this%particle)), source=0.0_wp)
    this%bytes = storage_size(this%x, i8)/8*5*size(this%x) + 4*(2*size(this%x))
    call this%prepare_kind(medium, error)
  end subroutine prepare

  subroutine follow(this, medium, places)
    class(wall_exchange_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    type(places_t), intent(in) :: places

    this%weight = medium%contacts%weight(this%contact)
    this%x = medium%x(this%particle)
    this%y = medium%y(this%particle)
    call this%follow_kind(places%some(this%particle))
  end subroutine follow

  subroutine follow_kind(this, places)
    class(wall_exchange_t), intent(inout) :: this
    !> Where its particles will be
    type(places_t), intent(in) :: places

    associate (unused => this, also => places)
    end associate
  end subroutine follow_kind

  subroutine add_power(this, medium, time, temperature, power)
    class(wall_exchange_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    real(wp), intent(in) :: time
    real(wp), intent(in) :: temperature(:)
    real(wp), intent(inout) :: power(:)
    integer :: k

    associate (unused => medium)
    end associate
    this%calls = this%calls + 1
    do k = 1, size(this%particle)
      this%temperature(k) = temperature(this%particle(k))
    end do
    call this%find_flux(time)
    do k = 1, size(this%particle)
      power(this%particle(k)) = power(this%particle(k)) + this%weight(k)*this%flux(k)
    end do
  end subroutine add_power

  subroutine add_slope(this, medium, time, temperature, slope)
    class(wall_exchange_t), intent(inout) :: this
    type(medium_t), intent(in) :: medium
    real(wp), intent(in) :: time
    real(wp), intent(in) :: temperature(:)
    real(wp), intent(inout) :: slope(:)
    real(wp), allocatable :: found(:)
    integer :: k

    associate (unused => medium)
    end associate
    this%calls = this%calls + 1
    this%temperature = temperature(this%particle)
    allocate (found(size(this%particle)))
    call this%find_flux_slope(time, found)
    do k = 1, size(this%particle)
      slope(this%particle(k)) = slope(this%particle(k)) + this%weight(k)*found(k)
    end do
  end subroutine add_slope

  pure function account(this) result(name)
    class(wall_exchange_t), intent(in) :: this
    character(len=:), allocatable :: name

    associate (unused => this)
    end associate
    name = ''
  end function account

  subroutine put_flux(this, flux)
    class(wall_exchange_t), intent(in) :: this
    real(wp), intent(inout) :: flux(:)

    flux(this%contact) = this%flux
  end subroutine put_flux

  subroutine find_flux_slope(this, time, slope)
    class(wall_exchange_t), intent(inout) :: this
    !> Time, s
    real(wp), intent(in) :: time
    !> Derivative of the flux at each contact, W/(m² K)
    real(wp), intent(out) :: slope(:)

    associate (unused => this, also => time)
    end associate
    slope = 0
  end subroutine find_flux_slope

end module calor_wall_exchange
