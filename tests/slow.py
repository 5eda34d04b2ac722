"""The tests that take longest, for their order (conftest.py) and for `make quick`, which leaves them out."""

from pathlib import PurePosixPath

SLOW: dict[str, float] = {
    "tests/companion/view/test_live.py::test_the_page_moves_the_vehicle_draws_the_scan_and_obeys_the_slider": 22,
    "tests/companion/avoidance/test_rrt.py::test_ways_are_the_same_in_any_order_and_process": 3,
    "tests/companion/logs/test_ahead.py": 3,
    "tests/companion/logs/test_ahead.py::test_in_a_copy_of_the_process": 12,
    "tests/companion/logs/test_ahead.py::test_the_log_says_what_was_asked": 27,
    "tests/companion/logs/test_convert.py::test_what_can_not_be_converted_is_one_line": 2,
    "tests/companion/logs/test_index.py::test_the_command": 4,
    "tests/companion/logs/test_info.py::test_the_digest_is_of_any_log_s_traffic": 5,
    "tests/companion/logs/test_info.py::test_what_is_damaged_is_digested_as_far_as_it_goes": 3,
    "tests/companion/logs/test_info.py::test_what_is_no_log_is_one_line": 4,
    "tests/companion/logs/test_play.py::test_a_ground_station_sees_the_flight": 4,
    "tests/companion/logs/test_play.py::test_an_address_or_a_speed_that_can_not_be_used": 8,
    "tests/companion/logs/test_repair.py::test_a_cut_flight_is_kept_to_just_before_the_cut": 2,
    "tests/companion/logs/test_repair.py::test_a_flipped_bit_anywhere_is_found_and_costs_its_chunk": 4,
    "tests/companion/logs/test_repair.py::test_a_log_cut_anywhere_becomes_whole": 3,
    "tests/companion/logs/test_repair.py::test_never_in_place": 4,
    "tests/companion/logs/test_replay.py": 3,
    "tests/companion/logs/test_replay.py::test_a_picture_that_can_not_be_is_refused_before_the_flight": 15,
    "tests/companion/logs/test_replay.py::test_every_byte_is_the_same": 11,
    "tests/companion/logs/test_replay.py::test_real_time_and_a_request_to_land": 16,
    "tests/companion/logs/test_replay.py::test_the_whole_trace_comes_back": 6,
    "tests/companion/logs/test_replay.py::test_what_if": 6,
    "tests/companion/mission/test_mission_flights.py": 2,
    "tests/companion/runtime/test_planning.py": 2,
    "tests/companion/runtime/test_rehearsal.py": 2,
    "tests/companion/runtime/test_rehearsal.py::test_nothing_is_compiled_or_imported_in_flight": 10,
    "tests/companion/runtime/test_runner.py": 2,
    "tests/companion/view/test_flight_report.py::test_a_report_of_another_system_draws": 8,
    "tests/companion/view/test_flight_report.py::test_the_report_opens_draws_every_chart_and_follows_a_look": 10,
    "tests/companion/view/test_foxglove_reader.py": 2,
    "tests/companion/view/test_live_control.py": 28,
    "tests/flights": 2,
    "tests/flights/test_bad_input.py::test_log_folder_that_is_a_file": 4,
    "tests/flights/test_bad_input.py::test_log_folder_that_is_read_only": 4,
    "tests/flights/test_bad_input.py::test_no_vehicle": 5,
    "tests/flights/test_joined.py::test_a_goal_without_progress_is_given_up_and_the_way_back_flown": 8,
    "tests/flights/test_joined.py::test_no_progress_ends_in_a_landing": 12,
    "tests/flights/test_joined.py::test_only_sound_setpoints_leave": 6,
    "tests/flights/test_joined.py::test_ring_back_in_time_goes_on": 5,
    "tests/flights/test_joined.py::test_seen_clearance_agrees_with_the_truth": 4,
    "tests/flights/test_joined.py::test_the_courier_delivers": 6,
    "tests/flights/test_joined.py::test_the_guard_stops_what_no_method_would": 4,
    "tests/flights/test_joined.py::test_the_same_seed_gives_the_same_bytes_and_another_one_does_not": 6,
    "tests/flights/test_joined.py::test_the_vehicle_survives_its_companion": 3,
    "tests/flights/test_joined.py::test_who_was_held_up_in_mid_leg_and_given_control_back_delivers": 6,
    "tests/flights/test_joined.py::test_without_return_a_goal_that_is_given_up_ends_in_a_landing_there": 5,
    "tests/flights/test_fence.py": 3,
    "tests/flights/test_limits.py": 4,
    "tests/flights/test_limits.py::test_a_courier_whose_battery_does_not_suffice_comes_home_with_the_parcel": 15,
    "tests/flights/test_other_heights.py": 4,
    "tests/flights/test_overrides.py::test_a_vehicle_other_than_the_companion_thinks": 10,
    "tests/flights/test_overrides.py::test_what_the_simulator_refuses_is_said_and_nothing_is_flown": 6,
    "tests/flights/test_processes.py::test_companion_killed_at_random_moments": 90,
    "tests/flights/test_processes.py::test_demo_in_lockstep_delivers_and_repeats_to_the_byte": 34,
    "tests/flights/test_processes.py::test_demo_in_real_time": 26,
    "tests/flights/test_processes.py::test_garbage_does_not_disturb": 32,
    "tests/flights/test_processes.py::test_planner_killed": 31,
    "tests/flights/test_processes.py::test_recorder_killed": 30,
    "tests/flights/test_processes.py::test_simulator_killed": 24,
    "tests/flights/test_processes.py::test_step_of_one_metre_over_udp_is_table_3": 13,
    "tests/flights/test_processes.py::test_the_log_is_the_flight": 20,
    "tests/flights/test_sectors.py::test_a_pole_is_flown_around": 16,
    "tests/golden": 3,
    "tests/protocol/flightlog/test_damaged_files.py::test_flipped_bits_are_found": 6,
    "tests/protocol/flightlog/test_damaged_files.py::test_no_content_of_a_chunk_raises_anything": 5,
    "tests/protocol/test_jit.py": 3,
    "tests/protocol/test_jit.py::test_the_cache_is_used_and_never_stale": 10,
    "tests/studies/test_campaign.py::test_a_contact_is_kept_and_flies_again_to_the_bit": 6,
    "tests/studies/test_campaign.py::test_a_flight_that_arrives": 5,
    "tests/studies/test_campaign.py::test_joined_is_the_same_flight_as_two_processes_over_udp": 15,
    "tests/studies/test_position_loop.py::test_the_papers_weight_diverges_in_flight_and_ten_does_not": 4,
    "tests/studies/test_tracking.py::test_the_flown_circle_is_the_ideal_one_within_a_tenth": 4,
    "tests/studies/test_waypoints.py": 3,
    "tests/vehicle_sim/test_vehicle_cli.py::test_overrides_and_truth_of_a_whole_process": 2,
    "tests/vehicle_sim/test_vehicle_cli.py::test_a_signal_ends_it_with_its_summary": 2,
    "tests/test_rules.py::test_an_import_against_a_contract_breaks_it": 1,
}
"""Seconds that a test takes on an idle machine, by its id or the beginning of it (a folder, a file, a test without its
parameters); the longest that fits counts. Of tests that look at the same flight, one is longer: it comes first."""
FLOWN = {"fly", "flown"}
"""Fixtures for which two processes fly. What uses them is slow, too, but not by itself."""


def seconds(nodeid: str) -> float:
    """What is known of a test; 0 for those that are not slow."""
    names = [nodeid, nodeid.partition("[")[0]]
    file, _, _ = nodeid.partition("::")
    names += [file, *(str(folder) for folder in PurePosixPath(file).parents)]
    return next((SLOW[name] for name in names if name in SLOW), 0.0)
