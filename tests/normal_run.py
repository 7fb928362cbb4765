"""Variants of costly tests that a normal run tries; ``--long``, as in CI, tries every variant.

By file and test, patterns of the names that pytest prints in brackets; a test without patterns belongs
to long runs. Tests that are not here run whole.
"""

from __future__ import annotations

from fnmatch import fnmatchcase

import pytest

COLLECTED = pytest.StashKey[set[tuple[str, str, str]]]()
"""File, test and variant of all tests that were read, whether they run or not."""

VARIANTS: dict[str, dict[str, tuple[str, ...]]] = {
    "test_answer.py": {
        "test_a_negative_viscous_friction_is_explained": ("viscous1*",),
    },
    "test_any_study.py": {
        "test_a_study_is_answered_alike_twice_or_refused": (),
        "test_a_torque_that_is_constant_in_some_records_is_found_by_name": (),
    },
    "test_app.py": {
        "test_another_motion_becomes_a_study_of_motions": (),
        "test_it_suits_three_joints": ("*Simulate*",),
        "test_wrong_inertias_and_torque_scale_are_corrected_by_a_known_payload": (),
    },
    "test_arm.py": {
        "test_energy_and_angular_momentum_are_kept": ("parallelogram",),
    },
    "test_arm_side.py": {
        "test_a_wrong_torque_constant_does_not_change_the_payload": (),
        "test_clear_tooth_errors_and_starts_and_stops_do_not_change_stiffness": (),
        "test_jitter_of_the_clock_is_resampled": (),
        "test_the_page_shows_stiffness_also_where_motor_data_give_none": (),
        "test_with_known_payload_and_a_quiet_gear_stiffness_is_within_one_per_cent": (),
        "test_without_gravity_a_few_moves_do_not_show_stiffness": (),
    },
    "test_aside.py": {
        "test_a_call_whose_process_is_killed_is_made_by_another": (),
    },
    "test_benchmarks.py": {
        "test_long_parts_are_reached": ("friction",),
        "test_simulation": (),
        "test_transfer_matrix": (),
    },
    "test_cli.py": {
        "test_ctrl_c_while_modules_load_ends_it_quietly": (),
        "test_cut_of_six_axes_bends_its_own_robot": (),
        "test_one_study_of_a_batch_is_counted_as_one": (),
        "test_simulated_gears_have_their_laws": (),
    },
    "test_closed_loop.py": {
        "test_default_settling_time_settles_friction": (),
        "test_friction_converges_with_the_square_of_the_step": (),
        "test_records_carry_the_transfer_matrix_of_the_model": ("*-0.00037",),
    },
    "test_common_unknown.py": {
        "test_a_wrong_payload_does_not_pass_for_another_gravity": (),
    },
    "test_compare.py": {
        "test_every_table_of_k_keeps_the_unit_of_the_answer": ("*Compare*", "*Error bars"),
        "test_the_headline_names_a_study_that_is_usable_with_care": (),
        "test_the_partner_is_first_sought_among_own_studies": (),
    },
    "test_corrections.py": {
        "test_a_fault_of_all_records_is_taken_out_again": ("joint 1*",),
    },
    "test_cut_page.py": {
        "test_a_path_that_cannot_be_is_refused_with_its_remedy": (),
        "test_every_nominal_controller_cuts_differently": (),
        "test_friction_and_its_compensation_count": (),
        "test_of_another_robot_custom_values_are_its_own": (),
        "test_of_other_than_two_joints_is_a_demonstration": ("three joints",),
        "test_studies_without_nominal_values_have_a_choice_of_their_own": (),
        "test_the_drive_may_be_another_and_that_is_said": (),
    },
    "test_elasticity.py": {
        "test_errors_are_as_stated": ("2-2-7-1.0",),
        "test_maximum_likelihood_is_unbiased_where_weighting_is_not": (),
    },
    "test_examples.py": {
        "test_runs": ("from_arrays", "six_axis_tool"),
    },
    "test_export.py": {
        "test_python_control_gets_the_same_model_and_the_measured_H": (),
    },
    "test_figures.py": {
        "test_an_estimate_that_is_no_spring_still_shows_the_measurement": (),
        "test_every_figure_names_its_axes_with_units_and_its_meanings_once": ("True-2", "True-1"),
    },
    "test_fleet.py": {
        "test_a_process_that_was_ended_while_idle_is_begun_anew": (),
        "test_an_address_that_is_none_is_one_message": (),
        "test_six_poisoned_studies_stop_nothing": (),
        "test_what_is_interrupted_goes_on_where_it_stopped": (),
    },
    "test_fleet_page.py": {
        "test_a_table_is_read_in_a_process_of_its_own": (),
    },
    "test_gears.py": {
        "test_a_servo_that_knows_the_curve_cuts_better": (),
        "test_gears_that_harden_far_beyond_their_stiffness_are_found_behind_heavy_rotors": (),
        "test_hardening_is_found_beside_a_gear_too_stiff_to_be_known": (),
        "test_hysteresis_is_found_beside_a_stiff_gear": (),
        "test_hysteresis_is_found_beside_much_hardening": (),
        "test_play_is_not_taken_for_slopes": (),
        "test_several_laws_are_reached_through_models_that_are_far_off": (),
        "test_simulated_records_obey_their_law": ("backlash",),
        "test_the_cut_agrees_with_an_independent_integration": ("parallelogram-hysteresis",),
    },
    "test_import_fuzz.py": {
        "test_every_sound_log_of_the_fuzzed_kinds_is_read": (),
    },
    "test_import_inertia.py": {
        "test_the_page_asks_how_well_inertias_and_torque_scale_are_known": ("chosen2*",),
        "test_toml_with_poses_is_pasted_and_a_log_has_its_pose": (),
    },
    "test_import_joined.py": {
        "test_the_page_joins_them_and_can_leave_it": (),
    },
    "test_import_kept.py": {
        "test_entries_of_another_kind_are_set_aside": ("x", "null"),
        "test_logs_and_entries_are_there_in_another_session": (),
        "test_opening_takes_it_out_of_the_store_and_the_mapping_is_known_from_then_on": (),
        "test_two_sessions_at_one_address_do_not_disturb_each_other": (),
        "test_what_is_damaged_is_said_and_the_rest_is_open": ("log",),
    },
    "test_import_multisine.py": {
        "test_elasticity_of_a_noisy_multisine": (),
        "test_harmonics_of_one_sine_are_no_lines": ("harmonics2",),
        "test_lines_over_a_decade_with_short_rests": ("lines0",),
        "test_two_patterns_back_to_back": (),
    },
    "test_import_page.py": {
        "test_closing_the_logs_clears_the_robot_but_not_the_mapping": (),
        "test_two_logs_make_one_study": (),
        "test_what_is_no_inertia_is_said_and_stays": ("0.001, 0.002*",),
        "test_what_is_no_log_is_said_and_the_others_open": ("",),
    },
    "test_import_readers.py": {
        "test_a_plant_adds_its_own_reader": ("False",),
        "test_a_zip_bomb_of_arrays_is_refused": (),
        "test_each_kind_of_log_gives_k_and_d": ("log73.mat",),
    },
    "test_import_roles.py": {
        "test_a_clock_inside_a_matrix_and_velocities_take_no_role": ("first-*",),
    },
    "test_import_segments.py": {
        "test_multisine_gives_one_record_per_line": ("0.001",),
    },
    "test_import_tables.py": {
        "test_workbook_bomb_is_refused": (),
    },
    "test_import_untaken.py": {
        "test_a_multisine_of_a_strong_and_a_weak_line_is_no_single_sine": (),
        "test_frequencies_that_change_without_a_pause_are_runs_of_their_own": ("0.04",),
        "test_no_piece_of_a_sweep_is_a_sine": ("4-*",),
        "test_noise_does_not_hide_a_sweep": ("1",),
        "test_notes_travel_with_the_segments": (),
        "test_sweep_gives_no_runs_and_is_told": ("logarithmic*",),
    },
    "test_independent_robot.py": {
        "test_energy_is_kept_without_damping": ("3000.0",),
        "test_lags_and_filters_turn_the_phasors": (),
        "test_the_ideal_robot_has_the_models_response": ("paper",),
    },
    "test_inertia_prior.py": {
        "test_linear_estimators_carry_the_prior_in_their_errors": (),
    },
    "test_likelihood.py": {
        "test_a_linear_estimate_that_heavy_friction_throws_off_is_no_end": ("(40, -1*",),
        "test_a_long_lag_alone_is_no_friction": (),
        "test_another_beginning_is_found_also_where_the_model_does_not_fit_well": (),
        "test_any_law_of_friction_leaves_the_answer": ("Stribeck*",),
        "test_friction_and_delay_together": (),
        "test_friction_turns_with_the_motor_not_with_its_filtered_position": (),
        "test_parts_that_are_demanded_are_fitted_also_where_there_are_none": (
            "False-*-maximum-likelihood", "True-True-True-auto",
        ),
        "test_the_gradient_is_that_of_the_cost": ("*-0.1",),
    },
    "test_long_records.py": {
        "test_a_long_study_is_analysed_like_another": (),
        "test_the_noise_of_parts_is_honest": (),
    },
    "test_motion.py": {
        "test_a_delay_turns_the_images_of_the_torque": ("changed1",),
        "test_a_law_of_the_gear_in_random_motion": (),
        "test_an_initial_state_does_not_change_the_answer": (),
        "test_bands_of_many_joints_have_the_misfit_of_noise": (),
        "test_errors_hold_rounding_that_repeats": (),
        "test_friction_is_chosen_by_itself": (),
        "test_friction_that_falls_with_speed_is_found_in_a_sweep": (),
        "test_hardening_is_found_under_heavy_friction": (),
        "test_inertias_need_not_be_known": (),
        "test_joints_that_move_in_turn_with_friction": (),
        "test_many_short_reversals_leave_equations": (),
        "test_motions_of_two_joints": ("None-moves", "inf-random"),
        "test_the_band_of_joints_that_stick_ends_with_their_motion": (),
        "test_unknown_friction_is_no_larger_than_coulomb_friction": (),
        "test_without_noise_k_and_d_are_exact": ("1000.0*",),
    },
    "test_motion_records.py": {
        "test_a_log_of_any_motion_becomes_a_motion_record_with_its_band": ("moves",),
        "test_a_planned_motion_keeps_its_limits_and_its_promise": (),
        "test_every_page_shows_the_sample_of_motions": (),
        "test_everything_is_made_of_a_study_with_motions": ("both",),
        "test_friction_acts_in_a_simulated_motion": (),
        "test_long_rests_separate_motions_and_noise_is_none": (),
        "test_sweeps_do_not_become_steady_sines": (),
        "test_torques_of_another_robot_are_no_usable_answer": (),
    },
    "test_motion_response.py": {
        "test_error_is_the_covariance": ("1-0.0001", "2-1e-06"),
    },
    "test_outcome.py": {
        "test_the_text_of_nonlinear_gears_has_both_servos": (),
    },
    "test_path_errors.py": {
        "test_and_with_every_option_of_the_servo": ("serial",),
        "test_mismatches_are_single_cuts": ("0.01-*",),
        "test_the_promise_grows_with_the_uncertainty_and_repeats": (),
    },
    "test_payload.py": {
        "test_a_known_payload_fixes_the_absolute_scale": ("0",),
    },
    "test_physics.py": {
        "test_elasticity_does_not_depend_on_the_controllers": ("maximum*",),
        "test_response_does_not_depend_on_the_controllers": ("2",),
    },
    "test_plan.py": {
        "test_prediction_against_campaigns": (),
        "test_suggested_records_do_what_was_promised": (),
        "test_uncertain_inertias_are_part_of_the_prediction": ("*-1", "inf-2"),
    },
    "test_record_scatter.py": {
        "test_records_that_disagree_widen_the_errors": ("0.0",),
        "test_right_errors_stay_as_they_are": ("0.0",),
    },
    "test_report.py": {
        "test_a_figure_gives_way_before_it_leaves_a_page_empty": ("0", "20"),
        "test_a_study_from_a_file_gives_the_same_bytes": (),
        "test_a_study_that_is_no_spring_is_reported_as_such": (),
        "test_another_process_gives_the_same_bytes": (),
        "test_every_name_of_a_study_stays_text_on_screen_and_on_paper": (),
        "test_no_page_but_the_last_is_mostly_empty": ("2",),
        "test_other_numbers_of_joints_have_no_cut": ("1",),
    },
    "test_report_page.py": {
        "test_the_report_is_made_on_demand_and_kept": ("2",),
    },
    "test_samples.py": {
        "test_a_record_twice_makes_the_answer_usable_with_care_until_one_is_left_out": (),
        "test_the_failed_study_names_its_cause_and_the_remedy_mends_it": (),
        "test_the_fleet_has_a_soft_joint_and_one_that_wears": (),
    },
    "test_sensor_steps.py": {
        "test_rounding_of_slow_and_sticking_motion_is_claimed": ("67.0-*",),
    },
    "test_setpoints.py": {
        "test_a_heavy_arm_on_small_rotors_is_played": (),
        "test_a_planned_motion_is_played_and_gives_k_and_d_back": (),
        "test_exact_following_needs_the_torque_of_the_model": ("2",),
        "test_friction_adds_to_the_torque": (),
        "test_no_file_of_a_random_plan_exceeds_a_limit": ("[0-4]",),
        "test_no_scale_helps_where_rest_exceeds_the_limit": (),
        "test_over_a_limit_nothing_is_written": ("velocity*",),
        "test_the_command_writes_a_planned_motion_of_a_study_of_motions": (),
        "test_the_played_motion_gives_k_and_d_back": (),
        "test_the_set_points_of_a_file_give_k_and_d_back": (),
    },
    "test_sine_fit.py": {
        "test_stated_covariance_is_the_scatter_of_the_phasors": ("one period",),
    },
    "test_six_axes.py": {
        "test_heavy_friction_does_not_hide_the_springs": ("7-*",),
        "test_motions_start_near_k_and_the_payload_with_friction": (),
    },
    "test_store.py": {
        "test_processes_that_write_one_workspace_lose_nothing": (),
    },
    "test_tool_stiffness.py": {
        "test_a_slow_tool_bends_by_gravity_alone": (),
    },
    "test_tracking.py": {
        "test_and_so_it_does_with_the_default_servo": (),
        "test_identified_parameters_cut_within_hundredths_of_a_millimetre": ("0.01*",),
        "test_pymunk_agrees_with_an_independent_integration": ("0.01-*",),
    },
    "test_transfer_matrix.py": {
        "test_covariance_is_the_scatter_of_the_elements": ("*-1",),
    },
    "test_trust_pages.py": {
        "test_every_page_about_several_poses": (),
        "test_planned_motions_can_be_saved_too": (),
        "test_the_bootstrap_agrees_with_the_stated_errors": (),
    },
    "test_uncertainty.py": {
        "test_bootstrap_agrees_with_the_stated_errors": (),
        "test_bootstrap_draws_the_given_inertias_as_well": ("weighted*",),
        "test_bootstrap_sees_the_bias_of_least_squares": (),
        "test_bootstrap_with_friction": (),
        "test_influence_predicts_what_other_given_inertias_do": ("*-2",),
        "test_jackknife_agrees_on_average": ("weighted",),
    },
    "test_validation.py": {
        "test_prediction_errs_as_stated": ("maximum-likelihood-1", "least-squares-2"),
        "test_prediction_with_friction": (),
    },
    "test_verdict.py": {
        "test_a_misfit_without_bound_is_a_problem_beside_any_cause": (),
        "test_angles_of_the_motors_are_not_called_the_arms": (),
        "test_exchanged_joints_and_units_that_inertias_absorb": ("sound*", "<lambda>-inertia4*"),
        "test_factor_of_one_record_is_named": (),
        "test_friction_does_not_hide_exchanged_or_reversed_axes": ("given[02]*0.05",),
        "test_gear_that_hardens_is_a_finding": ("0.0",),
        "test_inertias_of_another_drive_are_a_finding": (),
        "test_no_negative_inertia_is_suggested": (),
        "test_one_record_in_degrees_is_named_and_no_inertia_blamed": (),
        "test_torques_of_other_motions_are_named_without_a_long_search": ("other*",),
        "test_what_is_wrong_in_every_record_accuses_none": (),
        "test_wrong_inertias_do_not_hide_behind_friction": (),
        "test_wrong_scale_comes_first_and_hides_what_follows_from_it": ("*-weighted",),
    },
    "test_wheel.py": {
        "test_it_holds_the_package_the_app_and_the_samples_and_nothing_else": (),
        "test_the_sdist_makes_the_same_wheel": (),
        "test_what_is_installed_finds_its_own_app_and_samples": (),
    },
    "test_whole_error.py": {
        "test_an_insignificant_part_of_the_only_model_that_explains_the_data_is_left_out": (),
        "test_few_frequencies_show_links_as_well": (),
        "test_links_far_above_the_band_widen_the_errors": (),
        "test_play_and_hysteresis_are_found_together": (),
        "test_tables_have_their_columns": (),
        "test_wrong_inertias_cost_little": ("paper*",),
    },
    "test_workspace.py": {
        "test_a_simulated_study_is_kept": (),
        "test_another_session_at_the_address_continues": ("1",),
    },
}  # fmt: skip


def of_long_run(file: str, test: str, variant: str) -> bool:
    """Whether only a long run tries this variant of a test."""
    tried = VARIANTS.get(file, {}).get(test)
    return tried is not None and not any(fnmatchcase(variant, pattern) for pattern in tried)
