"""Requests, parameters, texts, clocks, and bytes that are no message."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v10 import common as v1
from pymavlink.dialects.v20 import common

from gcs.sim.fleet import STEP_S
from gcs.sim.protocol.autopilot import Autopilot
from gcs.sim.protocol.streams import RECORDED_HZ
from gcs.sim.vehicle.px4 import defaults
from tests.support.sim_bench import ACCEPTED, DENIED, FAILED, HOLD, Bench, offboard, ready

SET_INTERVAL, GET_INTERVAL, REQUEST = 511, 510, 512
VERSION_ID, ATTITUDE_ID = 148, 30
INT32, REAL32 = 6, 9


def rate_hz(bench: Bench, kind: str, over_s: float = 4.0) -> float:
    before = bench.count(kind)
    return (bench.run(over_s).count(kind) - before) / over_s


@pytest.mark.soak
def test_set_message_interval_changes_stops_and_restores() -> None:
    bench = Bench(STEP_S, rates_hz=RECORDED_HZ).ready()
    assert bench.command(SET_INTERVAL, ATTITUDE_ID, 100_000) == [ACCEPTED]
    assert rate_hz(bench, "ATTITUDE") == pytest.approx(10.0, abs=0.5)
    assert bench.command(GET_INTERVAL, ATTITUDE_ID) == [ACCEPTED]
    assert bench.last("MESSAGE_INTERVAL").interval_us == 100_000
    assert bench.command(SET_INTERVAL, ATTITUDE_ID, -1) == [ACCEPTED]
    assert rate_hz(bench, "ATTITUDE") == 0.0
    assert bench.command(SET_INTERVAL, ATTITUDE_ID, 0) == [ACCEPTED]
    assert rate_hz(bench, "ATTITUDE") == pytest.approx(98.9, abs=1.5)


@pytest.mark.parametrize("values", [(99999.0, 1000.0), (math.nan, 1.0), (30.0, math.nan), (1e30, 1.0)])
def test_an_interval_for_no_message_fails(values: tuple[float, float]) -> None:
    assert ready().command(SET_INTERVAL, *values) == [FAILED]


def test_a_message_can_be_requested_once() -> None:
    bench = ready()
    bench.command(SET_INTERVAL, 242, -1)
    before = bench.count("HOME_POSITION")
    assert bench.command(REQUEST, 242) == [ACCEPTED]
    assert bench.run(2.0).count("HOME_POSITION") == before + 1
    assert bench.command(REQUEST, 12345) == [DENIED]


def test_the_version_is_px4_1_16_1() -> None:
    bench = ready(first=4)
    assert bench.command(REQUEST, VERSION_ID, target=5) == [ACCEPTED]
    version = bench.last("AUTOPILOT_VERSION")
    assert version.flight_sw_version == 1 << 24 | 16 << 16 | 1 << 8 | 255
    assert version.uid == 5
    assert version.capabilities & common.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE


@pytest.mark.soak
def test_home_is_where_it_was_armed() -> None:
    bench = offboard()
    bench.stream(4.0, 0.0, 0.0)
    bench.run(4.0)
    bench.command(21)
    bench.until(lambda: not bench.armed, 60.0)
    assert bench.last("HOME_POSITION").x == pytest.approx(0.0, abs=0.1)
    bench.set_mode(HOLD)
    bench.arm()
    assert bench.run(2.2).last("HOME_POSITION").x == pytest.approx(bench.truth[0], abs=0.1)


def test_all_parameters_are_listed_bytewise() -> None:
    bench = ready(step_s=STEP_S)
    bench.send(common.MAVLink_param_request_list_message(1, 1))
    bench.run(3.0)
    values = bench.all("PARAM_VALUE")
    assert [v.param_id for v in values] == list(defaults())
    assert {v.param_count for v in values} == {len(defaults())}
    assert [v.param_index for v in values] == list(range(len(defaults())))
    action = next(v for v in values if v.param_id == "MAV_TYPE")
    assert (action.param_type, struct.unpack("<i", struct.pack("<f", action.param_value))[0]) == (INT32, 2)


def set_parameter(bench: Bench, name: str, value: float, kind: int) -> list[Any]:
    before = bench.count("PARAM_VALUE")
    schemas = struct.unpack("<f", struct.pack("<i", int(value)))[0] if kind == INT32 else value
    bench.send(common.MAVLink_param_set_message(1, 1, name.encode(), schemas, kind))
    return bench.run(0.1).all("PARAM_VALUE")[before:]


def test_a_parameter_is_set_answered_and_announced() -> None:
    bench = ready()
    answers = set_parameter(bench, "COM_OBL_RC_ACT", 5, INT32)
    assert [(a.param_id, struct.unpack("<i", struct.pack("<f", a.param_value))[0]) for a in answers] == [
        ("COM_OBL_RC_ACT", 5)
    ] * 2
    assert bench.fleet.autopilots[0].parameters["COM_OBL_RC_ACT"] == 5


@pytest.mark.parametrize(
    ("name", "value", "kind"),
    [
        ("MPC_XY_VEL_MAX", math.nan, REAL32),
        ("MPC_XY_VEL_MAX", math.inf, REAL32),
        ("MPC_XY_VEL_MAX", 3, INT32),
    ],
)
def test_a_bad_value_is_answered_with_the_old_one(name: str, value: float, kind: int) -> None:
    bench = ready()
    answers = set_parameter(bench, name, value, kind)
    assert [a.param_value for a in answers] == [12.0]


def test_parameters_read_by_name_and_index_unknown_unanswered() -> None:
    bench = ready()
    for name, place in [
        (b"MPC_XY_VEL_MAX", -1),
        (b"", list(defaults()).index("COM_OF_LOSS_T")),
        (b"NO_SUCH", -1),
        (b"", 9999),
    ]:
        bench.send(common.MAVLink_param_request_read_message(1, 1, name, place))
    bench.run(0.1)
    assert [v.param_id for v in bench.all("PARAM_VALUE")] == ["MPC_XY_VEL_MAX", "COM_OF_LOSS_T"]
    assert set_parameter(bench, "NO_SUCH", 1.0, REAL32) == []


def test_texts_are_sent_only_while_a_ground_station_is_received() -> None:
    bench = Bench()
    bench.heartbeats = False
    bench.ready()
    bench.arm()
    assert bench.texts == []
    bench.command(400, 0)
    bench.heartbeats = True
    bench.run(1.1)
    bench.arm()
    assert bench.texts[:2] == ["GCS connection regained", "Armed by external command"]


def test_long_texts_come_in_chunks_of_fifty() -> None:
    bench = Bench().run(1.0)
    bench.arm()
    chunks = [m for m in bench.all("STATUSTEXT") if m.text.startswith("Arming") or m.chunk_seq]
    assert [(m.chunk_seq, len(m.text)) for m in chunks] == [(0, 50), (1, 2)]
    assert chunks[0].id == chunks[1].id


def test_the_boot_clock_loses_one_to_two_percent() -> None:
    bench = Bench().run(10.0)
    lost_s = bench.now_s - bench.last("SYSTEM_TIME").time_boot_ms * 1e-3
    assert 0.0 < lost_s < 1.3
    first, last = bench.all("ATTITUDE")[0], bench.all("ATTITUDE")[-1]
    times = [t for t, m in bench.received if m.get_type() == "ATTITUDE"]
    rate = (last.time_boot_ms - first.time_boot_ms) * 1e-3 / (times[-1] - times[0])
    assert 0.979 < rate < 0.991


def test_pings_and_timesyncs_are_answered() -> None:
    bench = ready()
    bench.send(common.MAVLink_ping_message(123, 7, 0, 0))
    echo = bench.last("PING")
    assert (echo.time_usec, echo.seq, echo.target_system, echo.target_component) == (123, 7, 245, 190)
    bench.send(common.MAVLink_timesync_message(0, 456))
    assert bench.last("TIMESYNC").ts1 == 456
    assert bench.last("TIMESYNC").tc1 > 0


def test_command_int_is_understood_too() -> None:
    bench = ready()
    bench.send(common.MAVLink_command_int_message(1, 1, 0, 400, 0, 0, 1.0, 0.0, 0.0, 0.0, 0, 0, 0.0))
    assert bench.run(1.1).armed


def state_of(bench: Bench) -> tuple[Any, ...]:
    autopilot = bench.fleet.autopilots[0]
    assert isinstance(autopilot, Autopilot)
    commander = autopilot.commander
    return (
        commander.mode,
        commander.armed,
        commander.landed,
        bool(bench.fleet.state.setpoint_seen[0]),
        dict(autopilot.parameters._changed),
        bench.fleet._schedule._interval_s.tolist(),
    )


def commands() -> list[Any]:
    """Messages that would do something to vehicle 1."""
    return [
        common.MAVLink_command_long_message(1, 1, 400, 0, 1, 21196, 0, 0, 0, 0, 0),
        common.MAVLink_command_long_message(1, 1, 176, 0, 1, 6, 0, 0, 0, 0, 0),
        common.MAVLink_param_set_message(1, 1, b"MPC_XY_VEL_MAX", 3.0, REAL32),
        common.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0x9C7, 0, 0, 0, 1, 1, 1, 0, 0, 0, 0, 0
        ),
    ]


@pytest.fixture(scope="module")
def quiet() -> Bench:
    return ready()


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=300))
def test_garbage_changes_nothing(quiet: Bench, garbage: bytes) -> None:
    before = state_of(quiet)
    quiet.send_bytes(garbage)
    quiet.send_bytes(b"\xfd" + garbage)
    assert state_of(quiet) == before


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 3), st.data())
def test_truncated_or_altered_frames_change_nothing(quiet: Bench, which: int, data: st.DataObject) -> None:
    before = state_of(quiet)
    frame = quiet.frame(commands()[which])
    quiet.send_bytes(frame[: data.draw(st.integers(0, len(frame) - 1))])
    place, flip = data.draw(st.integers(1, len(frame) - 1)), data.draw(st.integers(1, 255))
    quiet.send_bytes(frame[:place] + bytes([frame[place] ^ flip]) + frame[place + 1 :])
    assert state_of(quiet) == before


@pytest.mark.parametrize("which", range(4))
def test_commands_to_others_or_from_itself_change_nothing(which: int) -> None:
    bench = ready()
    before = state_of(bench)
    for system, component in [(2, 1), (1, 100)]:
        command = commands()[which]
        command.target_system, command.target_component = system, component
        bench.send(command)
    bench.send_bytes(bytes(commands()[which].pack(common.MAVLink(None, 1, 1))))
    assert state_of(bench) == before
    bench.send(commands()[which])
    assert state_of(bench) != before


def test_mavlink_1_frames_and_unknown_messages_change_nothing() -> None:
    bench = ready()
    before = state_of(bench)
    old = v1.MAVLink(None, 245, 190)
    bench.send_bytes(bytes(v1.MAVLink_command_long_message(1, 1, 400, 0, 1, 21196, 0, 0, 0, 0, 0).pack(old)))
    bench.send_bytes(bytes.fromhex("fd0100001af5be7c0100ff1234"))
    bench.send(common.MAVLink_manual_control_message(1, 0, 0, 0, 0, 0))
    assert state_of(bench) == before


def test_valid_frames_after_garbage_and_in_one_datagram() -> None:
    bench = ready()
    both = [bench.frame(commands()[which]) for which in (0, 2)]
    bench.send_bytes(b"\xfd\x00garbage" + b"".join(both))
    assert bench.run(1.1).armed
    assert bench.fleet.autopilots[0].parameters["MPC_XY_VEL_MAX"] == 3.0


@pytest.mark.alternates(0)
@pytest.mark.parametrize("number", [20, 21, 22, 176, 185, 400, 510, 511, 512, 520, 31999])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 3e38])
def test_commands_full_of_nonsense_are_answered(number: int, value: float) -> None:
    assert Bench().run(0.1).command(number, *[value] * 7)
