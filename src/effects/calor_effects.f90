!> The table of effects, and those that a scene calls for.
module calor_effects
  use calor_effect, only: effect_t, effect_slot_t
  use calor_effect_convection, only: convection_t
  use calor_effect_flux, only: flux_t
  use calor_effect_insulated, only: insulated_t
  use calor_effect_melting, only: melting_t
  use calor_effect_radiation, only: radiation_t
  use calor_effect_source, only: source_t
  use calor_error, only: error_t
  use calor_kinds, only: i8
  use calor_scene_file, only: scene_file_t, group_t
  use calor_scene_getters, only: place_of
  use calor_text, only: lower_case
  implicit none (type, external)
  private

  public :: known_effects, called_effects, enter, effect_usage

contains

  !> Every effect that a scene may call for: name, what it is, and the group (with a key and its
  !> value, if it takes these) that calls for it.
  subroutine known_effects(table)
    !> The table; its effects are not prepared for anything
    type(effect_slot_t), allocatable, intent(out) :: table(:)

    allocate (table(0))
    call enter(table, source_t('source', 'heat set free within the body', 'source', '', '', &
        'ρ c ∂T/∂t = ∇·κ∇T + s, s in W/m³', &
        'one addition a particle; an expression is evaluated at each stage', &
        'H.S. Carslaw, J.C. Jaeger, Conduction of heat in solids, Oxford 1959'))
    call enter(table, flux_t('flux', 'a given heat flux', 'boundary', 'kind', 'flux', &
        'κ ∂T/∂n = q, n outward, q in W/m²', &
        'one addition a wall particle', &
        'H.S. Carslaw, J.C. Jaeger, Conduction of heat in solids, Oxford 1959'))
    call enter(table, insulated_t('insulated', 'no heat passes', 'boundary', 'kind', 'insulated', &
        'κ ∂T/∂n = 0', 'nothing: the rows of the wall say it', &
        'H.S. Carslaw, J.C. Jaeger, Conduction of heat in solids, Oxford 1959'))
    call enter(table, convection_t('convection', 'heat exchanged with a fluid', 'boundary', &
        'kind', 'convection', 'κ ∂T/∂n = α (T_ambient − T)', &
        'one product a wall particle', &
        'I. Newton, Phil. Trans. 22 (1701) 824–829'))
    call enter(table, radiation_t('radiation', 'heat radiated and received', 'boundary', &
        'kind', 'radiation', 'κ ∂T/∂n = ε σ (T_ambient⁴ − T⁴), temperatures in K', &
        'some products a wall particle; shorter steps where it is strong', &
        'J. Stefan, Sitzungsber. Akad. Wiss. Wien 79 (1879) 391–428'))
    call enter(table, melting_t('melting', 'latent heat between solidus and liquidus', &
        'material', 'latent_heat', '', 'ρ ∂H/∂t = ∇·κ∇T, H = c T + L f(T), f the liquid fraction', &
        'the temperature of each heat content at each stage', &
        'V. Alexiades, A.D. Solomon, Melting and Freezing Processes, 1993, chapter 4'))
  end subroutine known_effects

  !> Add an effect to a list.
  subroutine enter(list, effect)
    !> The list
    type(effect_slot_t), allocatable, intent(inout) :: list(:)
    !> The effect
    class(effect_t), intent(in) :: effect
    type(effect_slot_t), allocatable :: longer(:)
    integer :: k, n

    n = 0
    if (allocated(list)) n = size(list)
    allocate (longer(n + 1))
    do k = 1, n
      call move_alloc(list(k)%effect, longer(k)%effect)
    end do
    allocate (longer(n + 1)%effect, source=effect)
    call move_alloc(longer, list)
  end subroutine enter

  !> The effects that the groups of a scene call for, one for each such group, in the order of the
  !> table. Where there are none, no list is allocated.
  subroutine called_effects(file, effects, error)
    !> The scene's groups, checked against the contract
    type(scene_file_t), intent(in) :: file
    !> The effects, with what their groups say
    type(effect_slot_t), allocatable, intent(out) :: effects(:)
    !> A key is missing or its value is wrong
    type(error_t), allocatable, intent(out) :: error
    type(effect_slot_t), allocatable :: table(:)
    type(group_t) :: group
    integer :: k, number

    call known_effects(table)
    do k = 1, size(table)
      do number = 1, file%count(trim(table(k)%effect%group))
        call file%group(trim(table(k)%effect%group), group, number)
        if (.not. calls_for(group, table(k)%effect)) cycle
        call enter(effects, table(k)%effect)
        associate (effect => effects(size(effects))%effect)
          effect%reason = place_of(group, trim(effect%key))
          call effect%read(group, number, error)
          if (allocated(error)) return
        end associate
      end do
    end do
  end subroutine called_effects

  !> Whether a group calls for an effect.
  pure function calls_for(group, effect) result(answer)
    type(group_t), intent(in) :: group
    class(effect_t), intent(in) :: effect
    logical :: answer

    answer = .true.
    if (effect%key == '') return
    answer = group%has(trim(effect%key))
    if (effect%value == '') return
    if (answer) answer = lower_case(group%entries(group%find(trim(effect%key)))%values(1)%text) == &
                         effect%value
  end function calls_for

  !> How often effects of a name were called, and what their arrays take.
  pure subroutine effect_usage(effects, name, calls, bytes)
    !> The effects in force; not allocated where there are none
    type(effect_slot_t), allocatable, intent(in) :: effects(:)
    !> The name
    character(len=*), intent(in) :: name
    !> Calls, and bytes
    integer(i8), intent(out) :: calls, bytes
    integer :: k

    calls = 0
    bytes = 0
    if (.not. allocated(effects)) return
    do k = 1, size(effects)
      if (effects(k)%effect%name /= name) cycle
      calls = calls + effects(k)%effect%calls
      bytes = bytes + effects(k)%effect%bytes
    end do
  end subroutine effect_usage

end module calor_effects
