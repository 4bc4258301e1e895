!> The public face of the library: `use calor` gives an application all it needs.
module calor
  use calor_accuracy_target, only: target_search_t, search_watcher_t, attempt_t
  use calor_arrangements, only: arrangement_choices
  use calor_body, only: body_t
  use calor_body_cloud, only: fill_body
  use calor_catalogue, only: describe_schemes, describe_effects, scheme_names, effect_names
  use calor_choice, only: choice_t, choice_names
  use calor_cloud, only: cloud_t
  use calor_cloud_check, only: check_cloud
  use calor_cloud_file, only: read_cloud_file
  use calor_constants, only: pi
  use calor_convergence_description, only: describe_convergence, convergence_document
  use calor_convergence_files, only: write_convergence, draw_convergence, &
                                     check_convergence_files, convergence_table_file, &
                                     convergence_pictures
  use calor_convergence_study, only: convergence_study_t, convergence_watcher_t
  use calor_cost_entry, only: cost_entry_t
  use calor_cost_study, only: cost_study_t, cost_observer_t
  use calor_cost_table, only: describe_costs
  use calor_description, only: describe_plan, describe_result
  use calor_disc_body, only: make_disc_body, make_annulus_body
  use calor_effect, only: effect_t, effect_slot_t
  use calor_effects, only: known_effects, enter, effect_usage
  use calor_error, only: error_t, raise, status_done, status_bad_input, status_bad_numbers, &
                         status_bad_file
  use calor_evolution, only: evolution_t
  use calor_expression, only: expression_t, compile_expression
  use calor_field_file, only: field_file_t
  use calor_file_system, only: ignore_file_size_signal
  use calor_gnuplot, only: draw_picture, run_gnuplot
  use calor_gradient_scheme, only: gradient_scheme_t
  use calor_gradient_schemes, only: gradient_choices, make_gradient_scheme
  use calor_hdf5, only: skip_hdf5_cleanup
  use calor_integrator, only: integrator_t
  use calor_integrators, only: integrator_choices, make_integrator
  use calor_interrupt, only: watch_for_interrupt, interrupted
  use calor_kernel, only: kernel_t
  use calor_kernels, only: kernel_choices, make_kernel
  use calor_kinds, only: wp, ip, i8
  use calor_laplacian_scheme, only: laplacian_scheme_t, row_laplacian_t
  use calor_laplacian_schemes, only: laplacian_choices, make_laplacian_scheme
  use calor_medium, only: medium_t
  use calor_neighbour_list, only: neighbour_list_t, build_neighbour_list
  use calor_new_scene, only: write_new_scene, describe_starting_scenes
  use calor_operator_description, only: describe_derivatives
  use calor_operator_study, only: operator_study_t, derivative_t
  use calor_plot, only: plot_request_t, plot_file
  use calor_polygon_body, only: make_polygon_body
  use calor_progress_line, only: progress_line, bar, duration_text
  use calor_rectangle_body, only: make_rectangle_body
  use calor_rectangle_cloud, only: make_rectangle
  use calor_renormalization, only: gradient_tensor, laplacian_tensor
  use calor_row_report, only: row_report_t
  use calor_scene, only: scene_t
  use calor_scene_contract, only: contract_help, contract_groups
  use calor_scene_evolution, only: make_scene_evolution, method_t, scene_method, scene_rows_t
  use calor_scene_file, only: group_t
  use calor_scene_reader, only: read_scene, interpret_scene
  use calor_shapes, only: shape_choices
  use calor_simulation, only: simulation_t, observer_t
  use calor_space_filling_curve, only: hilbert_order
  use calor_sparse_operator, only: sparse_operator_t
  use calor_spectral_radius, only: estimate_spectral_radius
  use calor_sufficient_rows, only: assemble_sufficient_gradient, assemble_sufficient_laplacian
  use calor_starting_scenes, only: starting_scenes
  use calor_stable_rows, only: assemble_stable_rows, row_repairs_t, as_written, support_grown, &
                               positive_stencil, inexact_stencil, no_stencil
  use calor_stencil, only: stencil_t
  use calor_stepper, only: stepper_t
  use calor_text, only: text_t, text_list, to_text, suggestion, append, join
  use calor_verification, only: verification_case_t, verification_cases, run_case
  use calor_version, only: version
  use calor_volume, only: volumes_from_kernel
  use calor_whole_file, only: write_whole_file
  implicit none (type, external)
  public
end module calor
