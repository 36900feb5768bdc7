"""ArduPilot's link: identity, MAVLink 1 and 2, streams, requests, reboot (habits 1 to 10 and 18)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from gcs.sim.autopilots.ardupilot.modes import Mode
from gcs.sim.fleet import STEP_S
from tests.support.ardu_bench import ArduBench, command, cruising, grounded, hovering
from tests.support.sim_bench import ACCEPTED, FAILED, VELOCITY_ONLY, setpoint

SET_INTERVAL, GET_INTERVAL, REQUEST, REBOOT = 511, 510, 512, 246
LOCAL, GLOBAL_POSITION, HOME, TARGET, FENCE, WIND = 32, 33, 242, 85, 162, 168
UNKNOWN = [141, 230, 331, 410, 411, 376, 234, 109, 12901, 12918, 340, 253]


def rate_hz(bench: ArduBench, kind: str, over_s: float = 4.0) -> float:
    before = bench.count(kind)
    return (bench.run(over_s).count(kind) - before) / over_s


def test_the_heartbeat_names_ardupilot_and_copter() -> None:
    beat = ArduBench().run(3.0).last("HEARTBEAT")
    assert (beat.autopilot, beat.type, beat.get_srcComponent()) == (3, 2, 1)
    assert (beat.base_mode, beat.custom_mode) == (0x51, Mode.STABILIZE)


def test_the_first_heartbeat_comes_after_1_05_s_then_at_1_hz() -> None:
    bench = ArduBench(STEP_S, asked=False).run(10.5)
    times_s = [time_s for time_s, message in bench.received if message.get_type() == "HEARTBEAT"]
    assert times_s == pytest.approx([1.05 + beat for beat in range(10)], abs=0.02)


def test_system_status_is_active_while_booting_then_standby() -> None:
    bench = ArduBench(late=True).run(4.2)
    assert [beat.system_status for beat in bench.all("HEARTBEAT")[:4]] == [4, 4, 3, 3]


def test_system_status_on_the_ground_is_standby_even_armed() -> None:
    bench = grounded()
    bench.arm()
    assert bench.run(1.1).last("HEARTBEAT").system_status == 3
    assert bench.armed
    assert hovering().last("HEARTBEAT").system_status == 4


class Eavesdropper(ArduBench):
    """Keeps the bytes as well."""

    def __init__(self, **settings: Any) -> None:
        self.frames: list[bytes] = []
        super().__init__(asked=False, **settings)
        self.heartbeats = False

    def _receive(self, stated: dict[int, list[bytes]]) -> None:
        self.frames += [frame for frames in stated.values() for frame in frames]
        super()._receive(stated)


def test_mavlink_1_is_spoken_until_mavlink_2_is_received() -> None:
    bench = Eavesdropper()
    bench.run(5.0)
    assert {frame[0] for frame in bench.frames} - set(b"\n") == {0xFE}, "its console text has lines"
    bench.frames.clear()
    bench.heartbeats = True
    bench.run(5.0)
    assert {frame[0] for frame in bench.frames} == {0xFD}


def test_mavlink_1_frames_hold_no_extensions_and_no_cut_zeros() -> None:
    bench = Eavesdropper()
    bench.run(0.1)
    home = next(frame for frame in bench.frames if frame[5] == HOME)
    assert len(home) == 6 + 52 + 2
    assert bench.last("HOME_POSITION").latitude == pytest.approx(473977420, abs=20)


@pytest.mark.soak
def test_unasked_it_sends_heartbeats_timesync_and_little_else() -> None:
    bench = ArduBench(asked=False, late=True).run(45.0)
    kinds = {message.get_type() for _, message in bench.received}
    assert kinds == {"HEARTBEAT", "TIMESYNC", "STATUSTEXT", "HOME_POSITION", "GPS_GLOBAL_ORIGIN"}
    assert (bench.count("HOME_POSITION"), bench.count("GPS_GLOBAL_ORIGIN")) == (1, 1)
    assert bench.count("TIMESYNC") in {4, 5}


@pytest.mark.soak
def test_a_stream_comes_at_exactly_the_rate_asked() -> None:
    bench = hovering(step_s=STEP_S, asked=False)
    for message_id, hz in [(LOCAL, 20.0), (GLOBAL_POSITION, 10.0), (193, 2.0), (245, 5.0)]:
        assert bench.command(SET_INTERVAL, message_id, 1e6 / hz) == [ACCEPTED]
    bench.run(0.5)
    assert rate_hz(bench, "LOCAL_POSITION_NED") == pytest.approx(20.0, abs=0.3)
    assert rate_hz(bench, "GLOBAL_POSITION_INT") == pytest.approx(10.0, abs=0.3)
    assert rate_hz(bench, "EKF_STATUS_REPORT") == pytest.approx(2.0, abs=0.3)


@pytest.mark.soak
@pytest.mark.parametrize("message_id", UNKNOWN)
def test_an_unknown_message_is_refused_with_a_text(message_id: int) -> None:
    bench = grounded()
    assert bench.command(SET_INTERVAL, message_id, 1e6) == [FAILED]
    assert bench.texts[-1] == f"No ap_message for mavlink id ({message_id})"


def test_fence_status_and_wind_are_accepted_and_never_seen() -> None:
    bench = grounded()
    for message_id in (FENCE, WIND):
        assert bench.command(SET_INTERVAL, message_id, 1e5) == [ACCEPTED]
    bench.run(3.0)
    assert (bench.count("FENCE_STATUS"), bench.count("WIND")) == (0, 0)


@pytest.mark.parametrize("message_id", [27, 42, 125, 163])
def test_known_messages_of_absent_parts_are_accepted(message_id: int) -> None:
    bench = grounded()
    assert bench.command(SET_INTERVAL, message_id, 1e5) == [ACCEPTED]
    assert bench.command(REQUEST, message_id) == [ACCEPTED]


def test_the_target_is_reported_in_guided_only() -> None:
    bench = hovering()
    bench.order(Mode.BRAKE)
    before = bench.count("POSITION_TARGET_LOCAL_NED")
    assert before > 0
    assert bench.run(2.0).count("POSITION_TARGET_LOCAL_NED") == before


@pytest.mark.soak
def test_interval_minus_one_stops_and_zero_is_the_default_off() -> None:
    bench = hovering()
    for off in (-1, 0):
        bench.command(SET_INTERVAL, LOCAL, 100_000)
        assert rate_hz(bench, "LOCAL_POSITION_NED") > 5.0
        assert bench.command(SET_INTERVAL, LOCAL, off) == [ACCEPTED]
        assert rate_hz(bench, "LOCAL_POSITION_NED") == 0.0


def test_an_interval_is_reported_and_an_unknown_one_fails() -> None:
    bench = grounded()
    assert bench.command(GET_INTERVAL, GLOBAL_POSITION) == [ACCEPTED]
    assert bench.last("MESSAGE_INTERVAL").interval_us == 100_000
    assert bench.command(GET_INTERVAL, 410) == [FAILED]
    answer = bench.last("MESSAGE_INTERVAL")
    assert (answer.message_id, answer.interval_us) == (410, 0)


def test_streams_are_gone_after_a_reboot() -> None:
    bench = grounded()
    assert bench.command(REBOOT, 1) == [ACCEPTED]
    bench.run(0.5)
    before = bench.count("GLOBAL_POSITION_INT")
    assert bench.run(3.0).count("GLOBAL_POSITION_INT") == before
    assert bench.custom_mode == Mode.STABILIZE


def test_a_reboot_takes_1_25_s_and_has_a_stray_second_answer() -> None:
    bench = grounded()
    beats = bench.count("HEARTBEAT")
    assert bench.command(REBOOT, 1, wait_s=0.5) == [ACCEPTED, FAILED]
    assert bench.count("HEARTBEAT") == beats
    assert bench.run(1.0).count("HEARTBEAT") == beats + 1
    assert bench.last("HEARTBEAT").custom_mode == Mode.STABILIZE


def test_a_reboot_is_refused_while_armed() -> None:
    bench = grounded()
    bench.arm()
    assert bench.command(REBOOT, 1) == [FAILED]


def test_request_data_stream_changes_the_parameters_sr0() -> None:
    bench = grounded(asked=False)
    bench.send(common.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))
    assert rate_hz(bench, "ATTITUDE") == pytest.approx(4.0, abs=0.3)
    assert bench.fleet.autopilots[0].parameters["SR0_POSITION"] == 4
    bench.send(common.MAVLink_request_data_stream_message(1, 1, 0, 4, 0))
    assert rate_hz(bench, "ATTITUDE") == 0.0


def test_set_message_interval_leaves_sr0_as_it_is() -> None:
    assert grounded().fleet.autopilots[0].parameters["SR0_POSITION"] == 0


@pytest.mark.parametrize("request_it", [(REQUEST, 148), (520, 1)])
def test_the_version_is_4_1_0_dev_with_real_parameters(request_it: tuple[int, int]) -> None:
    bench = grounded(asked=False)
    assert bench.command(*request_it) == [ACCEPTED]
    version = bench.last("AUTOPILOT_VERSION")
    assert (version.capabilities, version.flight_sw_version, version.uid) == (64495, 0x04010000, 0)
    assert bytes(version.flight_custom_version) == b"01bdf537"
    assert not version.capabilities & common.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE


def test_a_request_may_be_accepted_and_bring_nothing() -> None:
    bench = ArduBench(late=True, asked=False).run(10.0)
    assert bench.command(REQUEST, LOCAL) == [ACCEPTED]
    assert bench.command(REQUEST, 999) == [FAILED]


def test_timesync_is_answered_and_ping_is_not() -> None:
    bench = grounded()
    bench.send(common.MAVLink_timesync_message(0, 456))
    assert bench.last("TIMESYNC").ts1 == 456
    assert bench.last("TIMESYNC").tc1 > 0
    bench.send(common.MAVLink_ping_message(123, 7, 0, 0))
    assert bench.run(1.0).count("PING") == 0


def test_a_mission_has_no_items() -> None:
    bench = grounded()
    bench.send(common.MAVLink_mission_request_list_message(1, 1))
    assert bench.last("MISSION_COUNT").count == 0


@pytest.mark.parametrize(("system", "component", "obeyed"), [(0, 0, True), (1, 190, True), (9, 1, False)])
def test_any_component_obeys_and_another_system_is_silent(system: int, component: int, obeyed: bool) -> None:
    bench = grounded()
    bench.send(command(400, 1, target=system, component=component))
    assert bench.run(1.1).armed == obeyed
    bench = hovering()
    bench.stream(3.0, 0.0, 0.0, target=system)
    assert (bench.run(3.0).velocity[0] > 1.0) == obeyed


@pytest.mark.soak
def test_three_vehicles_obey_their_own_commands_only() -> None:
    bench = hovering(count=3, grid_columns=3)
    assert sorted({beat.get_srcSystem() for beat in bench.all("HEARTBEAT")}) == [1, 2, 3]
    for target in (2, 3):
        for message in (command(176, 1, Mode.GUIDED, target=target), command(400, 1, target=target)):
            bench.send(message)
    bench.run(1.0)
    assert all(vehicle.commander.armed for vehicle in bench.fleet.autopilots)


@pytest.mark.soak
def test_three_on_one_port_fly_alike_to_a_centimetre() -> None:
    """Habit 10: each is addressed by its own system id."""
    bench = hovering(count=3, grid_columns=3)
    for target in (2, 3):
        for message in (
            command(176, 1, Mode.GUIDED, target=target),
            command(400, 1, target=target),
            command(22, 0, 0, 0, 0, 0, 0, 10.0, target=target),
        ):
            bench.send(message)
    bench.run(12.0)
    before_m = bench.fleet.bodies.position_m.copy()
    for _ in range(120):
        for target in (1, 2, 3):
            bench.send(setpoint(4.0, 0.0, 0.0, VELOCITY_ONLY, target=target))
        bench.run(0.05)
    flown_m = bench.fleet.bodies.position_m - before_m
    assert (flown_m[:, 0] > 10.0).all()
    assert np.ptp(flown_m, axis=0).max() < 0.01


@pytest.mark.alternates(0)
@pytest.mark.parametrize("number", [11, 16, 17, 20, 21, 22, 115, 176, 179, 185, 400, 510, 511, 512, 520])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf"), 3e38])
def test_commands_full_of_nonsense_change_nothing_bad(number: int, value: float) -> None:
    bench = ArduBench()
    bench.run(0.1)
    assert len(bench.command(number, *[value] * 7)) == 1
    assert not bench.run(0.1).fleet.state.armed[0]


@pytest.mark.soak
def test_setpoints_prove_that_they_arrive_by_message_85() -> None:
    bench = cruising(4.0)
    target = bench.last("POSITION_TARGET_LOCAL_NED")
    assert (target.type_mask, target.coordinate_frame) == (0xFC7, 1)
    assert (target.vx, target.vy, target.vz) == pytest.approx((4.0, 0.0, 0.0), abs=0.01)
