"""A recorded session, played to the fake: it says what the real PX4 said."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import common

from gcs.sim.fleet import STEP_S
from gcs.sim.protocol.streams import RECORDED_HZ
from gcs.sim.vehicle.dynamics import GRAVITY_M_S2
from tests.support.sim_bench import Bench, digest, offboard

# What the recorded PX4 sends and the fake does not: see sim/protocol/reports.py.
LEFT_OUT = {
    "ESTIMATOR_STATUS",
    "OPEN_DRONE_ID_LOCATION",
    "OPEN_DRONE_ID_SYSTEM",
    "POSITION_TARGET_GLOBAL_INT",
    "SCALED_PRESSURE",
    "SERVO_OUTPUT_RAW",
    "VIBRATION",
}
ON_OCCASION = {"COMMAND_ACK", "COMMAND_LONG", "PARAM_VALUE", "STATUSTEXT"}
HEARTBEAT_S = 1.0
QUIET = set(RECORDED_HZ) - {common.MAVLINK_MSG_ID_HEARTBEAT, common.MAVLINK_MSG_ID_EXTENDED_SYS_STATE}


def build(kind: list[Any]) -> Any:
    message_id, fields = kind
    form = common.mavlink_map[message_id]
    values = [fields[name] for name in form.fieldnames]
    return form(*[value.encode() if isinstance(value, str) else value for value in values])


def play(name: str) -> tuple[Bench, float, dict[str, Any]]:
    """Feed the recorded station's messages at their times; the bench, and when the recording began."""
    recording = digest(name)
    bench = Bench()
    bench.heartbeats = False
    bench.ready()
    for message_id in QUIET:  # their frames are not compared here, and cost time
        assert bench.command(common.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, -1) == [0]
    first_s = next(time_s for time_s, kind, _ in recording["replies"] if kind == "HEARTBEAT")
    beats = bench.count("HEARTBEAT")
    bench.until(lambda: bench.count("HEARTBEAT") > beats, 2.0)
    bench.run(HEARTBEAT_S - first_s)  # from now on the heartbeats come when the recorded ones did
    begin_s = bench.now_s
    messages = [build(kind) for kind in recording["order_kinds"]]
    for time_s, index in recording["orders"]:
        if begin_s + time_s > bench.now_s:
            bench.run(begin_s + time_s - bench.now_s)
        bench.send(messages[index])
    bench.run(max(recording["replies"][-1][0] + begin_s - bench.now_s, 0.0) + 0.1)
    return bench, begin_s, recording


def spoken(bench: Bench, begin_s: float, kind: str) -> list[tuple[float, list[Any]]]:
    """What the fake said, in the digest's form."""
    stated: list[tuple[float, list[Any]]] = []
    for time_s, message in bench.received:
        if message.get_type() != kind or time_s < begin_s:
            continue
        values = {
            "HEARTBEAT": lambda m: [m.base_mode, m.custom_mode, m.system_status],
            "EXTENDED_SYS_STATE": lambda m: [m.landed_state],
            "COMMAND_ACK": lambda m: [m.command, m.result],
            "STATUSTEXT": lambda m: [m.severity, m.text, m.chunk_seq],
        }[kind](message)
        is_state = kind in {"HEARTBEAT", "EXTENDED_SYS_STATE"}
        if not (is_state and stated and stated[-1][1] == values):
            stated.append((time_s - begin_s, values))
    return stated


def recorded(recording: dict[str, Any], kind: str) -> list[tuple[float, list[Any]]]:
    return [(time_s, values) for time_s, name, values in recording["replies"] if name == kind]


@pytest.mark.keeps("session")
@pytest.mark.parametrize("name", ["session", "failsafe"])
def test_a_recorded_session_gets_the_recorded_answers(name: str) -> None:
    bench, begin_s, recording = play(name)
    for kind, tolerance_s in [("COMMAND_ACK", 0.03), ("STATUSTEXT", 8.0), ("EXTENDED_SYS_STATE", 8.0)]:
        ours, theirs = spoken(bench, begin_s, kind), recorded(recording, kind)
        assert [values for _, values in ours] == [values for _, values in theirs], kind
        # Flights to the ground differ by seconds (the recorded descents are not steady); answers do not.
        assert [t for t, _ in ours] == pytest.approx([t for t, _ in theirs], abs=tolerance_s), kind
    states = [values for _, values in spoken(bench, begin_s, "HEARTBEAT")]
    assert states == [values for _, values in recorded(recording, "HEARTBEAT")]


def test_the_message_set_and_its_rates_are_the_recorded_ones() -> None:
    streams = digest("session")["streams"]
    bench = Bench(STEP_S, rates_hz=RECORDED_HZ).ready()
    begin_s = bench.now_s
    bench.run(20.0)
    counts: dict[str, int] = {}
    for time_s, message in bench.received:
        if time_s > begin_s:
            counts[message.get_type()] = counts.get(message.get_type(), 0) + 1
    assert set(counts) - ON_OCCASION == set(streams) - LEFT_OUT - ON_OCCASION
    for name, count in counts.items():
        if name not in ON_OCCASION:
            assert count / 20.0 == pytest.approx(streams[name]["rate_hz"], rel=0.03, abs=0.06), name


def test_local_positions_come_irregularly() -> None:
    bench = Bench(STEP_S, rates_hz=RECORDED_HZ).ready()
    bench.run(3.0)
    times = [m.time_boot_ms for m in bench.all("LOCAL_POSITION_NED")]
    gaps = {later - earlier for earlier, later in pairwise(times)}
    assert len(gaps) > 1
    assert max(gaps) <= 45


def same_kind(ours: Any, theirs: Any) -> bool:
    """Numbers that are known where they were known, and alike in shape."""
    if isinstance(theirs, list):
        return len(ours) == len(theirs) and all(map(same_kind, ours, theirs))
    if isinstance(theirs, float):
        return math.isnan(ours) == math.isnan(theirs)
    return type(ours) is type(theirs)


def test_fields_hold_what_the_recorded_ones_hold() -> None:
    streams = digest("session")["streams"]
    bench = offboard()
    # Constants of the recording that are not the vehicle's nature: times, the simulated sensors' own figures.
    free = {
        ("ODOMETRY", "pose_covariance"),
        ("ODOMETRY", "velocity_covariance"),
        ("ODOMETRY", "reset_counter"),
    }
    for name, stream in streams.items():
        if name in LEFT_OUT | ON_OCCASION:
            continue
        ours = bench.last(name).to_dict()
        for field, theirs in stream["example"].items():
            if name in {"POSITION_TARGET_LOCAL_NED", "HIGHRES_IMU"} and field not in stream["constant"]:
                continue
            assert same_kind(ours[field], theirs), (name, field)
            if field in stream["constant"] and (name, field) not in free:
                assert ours[field] == pytest.approx(theirs, nan_ok=True), (name, field)


def test_the_imu_feels_gravity() -> None:
    bench = offboard()
    assert bench.last("HIGHRES_IMU").zacc == pytest.approx(-GRAVITY_M_S2, abs=0.3)


def test_the_global_position_agrees_with_the_local_one() -> None:
    bench = offboard()
    bench.stream(3.0, 4.0, 0.0)
    bench.run(3.0)
    here, home, local = (
        bench.last("GLOBAL_POSITION_INT"),
        bench.last("HOME_POSITION"),
        bench.last("LOCAL_POSITION_NED"),
    )
    north_m = (here.lat - home.latitude) * 1e-7 * 111_170.0
    east_m = (here.lon - home.longitude) * 1e-7 * 75_460.0
    assert (north_m, east_m) == pytest.approx((local.x - home.x, local.y - home.y), abs=0.2)
    assert here.relative_alt * 1e-3 == pytest.approx(home.z - local.z, abs=0.1)
    assert here.vx == pytest.approx(100 * local.vx, abs=2)
