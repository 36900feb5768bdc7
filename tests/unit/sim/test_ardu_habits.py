"""Each measured habit of ArduCopter has a test of the fake one, by name.

Comments in `sim/autopilots/ardupilot` give the same numbers.
"""

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[2]
FOLDERS = ("flight/sim", "unit/sim", "integration")

BY_MAVSDK = "mavsdk_flies_a_fake_arducopter_as_the_real_one"

HABITS = {
    1: "the_heartbeat_names_ardupilot_and_copter system_status_is_active_while_booting_then_standby",
    2: "mavlink_1_is_spoken_until_mavlink_2_is_received",
    3: "unasked_it_sends_heartbeats_timesync_and_little_else",
    4: "a_stream_comes_at_exactly_the_rate_asked an_unknown_message_is_refused_with_a_text",
    5: "interval_minus_one_stops_and_zero_is_the_default_off streams_are_gone_after_a_reboot",
    6: "request_data_stream_changes_the_parameters_sr0",
    7: "the_version_is_4_1_0_dev_with_real_parameters a_request_may_be_accepted_and_bring_nothing",
    8: "the_list_is_there_within_a_second_and_has_no_hash all_parameters_are_listed_as_real_numbers",
    9: "timesync_is_answered_and_ping_is_not a_mission_has_no_items",
    10: "three_on_one_port_fly_alike_to_a_centimetre any_component_obeys_and_another_system_is_silent",
    11: "the_mode_is_the_plain_number",
    12: "a_mode_change_has_one_ack_and_a_heartbeat_at_once a_repeated_order_is_acked_each_time"
    " a_refused_mode_is_result_3_with_a_text_and_flies_on set_mode_is_acknowledged_as_command_11",
    13: "disarmed_any_mode_is_accepted_without_a_position guided_is_refused_armed_without_a_position",
    14: "each_mode_goes_on_so_far_and_takes_no_setpoints modes_by_hand_sink_without_a_transmitter"
    " brake_stops_in_the_recorded_distance modes_that_hold_keep_place_and_height",
    15: "a_pause_is_not_known_and_it_flies_on navigation_commands_are_modes unknown_commands_are_unsupported",
    16: "arming_and_modes_by_command_int_are_unsupported do_reposition_flies_to_a_place_by_command_int",
    17: "do_change_speed_is_accepted_and_setpoints_go_on condition_yaw_is_kept_under_setpoints_without_a_yaw",
    18: "a_reboot_takes_1_25_s_and_has_a_stray_second_answer a_reboot_is_refused_while_armed",
    19: "the_start_takes_40_s_in_the_recorded_stages ekf_flags_go_from_165_to_831_with_the_position",
    20: "the_prearm_bit_depends_on_the_mode",
    21: "reasons_are_sent_at_arming_and_every_30_s",
    22: "each_reason_refuses_arming_with_its_text modes_that_do_not_arm_leave_the_prearm_bit"
    " force_2989_arms_with_a_low_battery_but_not_starting",
    23: "stabilize_can_be_armed_without_a_position",
    24: "the_ack_comes_first_and_the_heartbeat_in_its_turn",
    25: "upward_setpoints_do_nothing_on_the_ground it_disarms_disarm_delay_after_arming",
    26: "takeoff_reaches_its_height_in_the_recorded_time a_takeoff_is_refused",
    27: "a_velocity_setpoint_cancels_the_takeoff_on_the_ground a_velocity_setpoint_cancels_the_climb",
    28: "landed_state_is_3_at_once_and_2_five_seconds_later land_from_ten_metres_takes_20_s_and_disarms"
    " rtl_climbs_to_rtl_alt_flies_home_waits_and_lands",
    29: "pushed_into_the_ground_it_lands_and_disarms_later",
    30: "after_landing_guided_must_be_ordered_before_arming",
    31: "yaw_is_aligned_3_5_s_after_the_takeoff_command",
    32: "home_moves_with_every_arming_and_the_origin_stays"
    " do_set_home_in_the_air_makes_the_local_position_jump",
    33: "position_setpoints_count_from_the_origin_not_from_home"
    " home_by_coordinates_is_float32_and_rtl_goes_there",
    34: "home_is_at_its_own_zero_and_level an_origin_from_outside_is_ignored_silently",
    35: "each_vehicle_has_a_home_and_an_origin_of_its_own",
    36: "masks_that_are_flown masks_that_are_not_followed_let_the_last_one_run_out",
    37: "frames_and_what_they_turn",
    38: "a_setpoint_is_never_acknowledged setpoints_prove_that_they_arrive_by_message_85",
    39: "one_setpoint_in_2_5_s_is_enough",
    40: "speeds_are_not_clipped",
    41: "nan_in_the_air_ends_the_process",
    42: "a_position_never_times_out_and_turns_the_nose",
    43: "setpoint_loss_flies_on_3_s_then_hovers_for_ever the_next_setpoint_is_obeyed_after_a_loss",
    44: "any_system_may_command_unless_sysid_enforce a_kill_of_any_station_counts_unless_sysid_enforce"
    " setpoints_of_any_station_are_followed_the_last_one",
    45: "each_recorded_step_within_0_25_m_s_rms a_reversal_crosses_zero_as_recorded",
    46: "a_stop_swings_beyond_and_back_as_recorded each_stop_keeps_the_bound_that_held",
    47: "each_recorded_step_within_0_25_m_s_rms",
    48: "north_and_east_share_the_acceleration",
    49: "yaw_turns_90_degrees_in_the_recorded_time a_turn_swings_beyond_and_back_as_recorded"
    " a_yaw_rate_settles_and_0_or_ignored_holds",
    50: "at_rest_it_stays_within_5_cm",
    51: "heartbeat_loss_of_sysid_mygcs_acts_despite_setpoints"
    " returned_heartbeats_clear_it_and_keep_the_mode"
    " a_station_never_seen_is_never_lost",
    52: "a_low_battery_returns_once_and_guided_is_kept"
    " a_critical_battery_lands_and_blocks_arming_until_reboot",
    53: "the_fence_bends_the_velocity_without_a_text a_breach_acts_without_a_text_where_nothing_avoids"
    " guided_outside_the_fence_has_ten_seconds",
    54: "a_lost_transmitter_returns_after_half_a_second fs_thr_enable_0_during_the_failsafe_latches_it",
    55: "lost_gps_holds_8_2_s_on_inertia_then_lands it_drifts_while_it_lands_without_a_position",
    56: "kill_stops_the_motors_and_landed_state_lies disarming_in_the_air_is_refused_and_it_flies_on"
    " after_a_kill_it_can_be_armed_again",
    57: "a_flight_without_failsafes_has_no_texts_of_its_own",
    58: "all_parameters_are_listed_as_real_numbers the_1131_recorded_parameters_are_there_with_their_types",
    59: "the_type_of_param_set_does_not_matter the_answer_has_what_was_kept_not_what_was_sent"
    " unknown_names_and_nan_have_no_answer",
    60: "a_change_of_wpnav_accel_counts_from_the_next_entry",
    61: BY_MAVSDK,
    62: BY_MAVSDK,
    63: BY_MAVSDK,
}
"""Tests without `test_`, by the number of the habit."""


def test_every_habit_is_listed() -> None:
    assert sorted(HABITS) == list(range(1, 64))


@pytest.fixture(scope="module")
def known() -> set[str]:
    files = [path for folder in FOLDERS for path in (TESTS / folder).glob("test_*ardu*.py")]
    return {
        node.name
        for path in files
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
    }


@pytest.mark.parametrize("habit", HABITS)
def test_habit_has_a_test_by_name(habit: int, known: set[str]) -> None:
    assert {f"test_{name}" for name in HABITS[habit].split()} <= known
