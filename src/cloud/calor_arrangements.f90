!> The table of arrangements of particles.
module calor_arrangements
  use calor_choice, only: choice_t
  implicit none (type, external)
  private

  public :: arrangement_choices

  !> Every arrangement that a scene may name
  type(choice_t), parameter :: arrangement_choices(*) = [ &
      choice_t('lattice', 'Squares: the most accurate where the shape allows it'), &
      choice_t('hexagonal', 'Triangles: the closest packing, columns shifted by half a spacing'), &
      choice_t('jittered', 'A lattice whose inner particles are displaced at random'), &
      choice_t('relaxed', 'Evenly spread: particles repel each other and fit the walls') &
      ]
end module calor_arrangements
