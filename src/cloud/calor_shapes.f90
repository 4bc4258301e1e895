!> The table of shapes of bodies.
module calor_shapes
  use calor_choice, only: choice_t
  implicit none (type, external)
  private

  public :: shape_choices

  !> Every shape that a scene may name
  type(choice_t), parameter :: shape_choices(*) = [ &
      choice_t('rectangle', 'x_range, y_range; boundaries left, right, bottom, top'), &
      choice_t('disc', 'centre, radius; boundary outer'), &
      choice_t('annulus', 'centre, radius, inner_radius; boundaries outer, inner'), &
      choice_t('polygon', 'vertices, hole_vertices; boundaries edge 1 ..., outer, hole 1 ...'), &
      choice_t('cloud', 'file: particles of one''s own; boundary wall') &
      ]
end module calor_shapes
