"""Recorded sessions of ArduPilot, played to the fake: it sends what the real one sent."""

from __future__ import annotations

import math
import re
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.sim.autopilots.ardupilot import reports
from gcs.sim.autopilots.ardupilot.modes import Mode
from tests.support.ardu_bench import ArduBench, cruising, digest

ON_OCCASION = {"COMMAND_ACK", "PARAM_VALUE", "STATUSTEXT", "MESSAGE_INTERVAL", "MISSION_COUNT"}
OF_SIMULATOR = "SIM Hit ground"
FIRST_HEARTBEAT_S = 1.05
ENDURANCE_S = 580.0  # 3300 mAh with the recorded 20.5 A


def build(kind: list[Any]) -> Any:
    message_id, fields = kind
    form = dialect.mavlink_map[message_id]
    values = [fields[name] for name in form.fieldnames]
    return form(*[value.encode() if isinstance(value, str) else value for value in values])


def play(recording: dict[str, Any]) -> ArduBench:
    """Feed the recorded station's messages at their times, from the vehicle's start on."""
    bench = ArduBench(late=True, asked=False, endurance_s=ENDURANCE_S)
    bench.heartbeats = False
    messages = [build(kind) for kind in recording["order_kinds"]]
    for time_s, index in recording["orders"]:
        if time_s + FIRST_HEARTBEAT_S > bench.now_s:
            bench.run(time_s + FIRST_HEARTBEAT_S - bench.now_s)
        bench.send(messages[index])
    bench.run(max(recording["replies"][-1][0] + FIRST_HEARTBEAT_S - bench.now_s, 0.0) + 0.1)
    return bench


def spoken(bench: ArduBench, kind: str) -> list[tuple[float, list[Any]]]:
    """What the fake sent, in the digest's form."""
    stated: list[tuple[float, list[Any]]] = []
    for time_s, message in bench.received:
        if message.get_type() != kind:
            continue
        values = {
            "HEARTBEAT": lambda m: [m.base_mode, m.custom_mode, m.system_status],
            "EXTENDED_SYS_STATE": lambda m: [m.landed_state],
            "COMMAND_ACK": lambda m: [m.command, m.result],
            "STATUSTEXT": lambda m: [m.severity, without_charge(m.text), m.chunk_seq],
        }[kind](message)
        is_state = kind in {"HEARTBEAT", "EXTENDED_SYS_STATE"}
        if not (is_state and stated and stated[-1][1] == values):
            stated.append((time_s - FIRST_HEARTBEAT_S, values))
    return [each for each in stated if not is_passing(each[1])]


def without_charge(text: str) -> str:
    """A text without the voltage and the charge used, which differ by some percent."""
    return re.sub(r"[\d.]+V used \d+", "", text)


def is_passing(values: list[Any]) -> bool:
    """The 0.15 s between landed and disarmed, which one heartbeat a second meets or not."""
    return values in ([0xD1, Mode.LAND, 3], [0xD9, Mode.RTL, 3])


def recorded(recording: dict[str, Any], kind: str) -> list[tuple[float, list[Any]]]:
    return [
        (time_s, [without_charge(each) if isinstance(each, str) else each for each in values])
        for time_s, name, values in recording["replies"]
        if name == kind and not is_passing(values)
        if not (kind == "STATUSTEXT" and values[1].startswith(OF_SIMULATOR))
    ]


@pytest.mark.keeps("session")
@pytest.mark.parametrize("name", ["session", "frame_takeoff", "failsafe"])
def test_a_recorded_session_gets_the_recorded_answers(name: str) -> None:
    recording = digest(name)
    bench = play(recording)
    for kind, tolerance_s in [
        ("COMMAND_ACK", 0.05),
        ("STATUSTEXT", 3.5),
        ("EXTENDED_SYS_STATE", 3.5),
        ("HEARTBEAT", 3.5),
    ]:
        ours, theirs = spoken(bench, kind), recorded(recording, kind)
        assert [values for _, values in ours] == [values for _, values in theirs], kind
        assert [t for t, _ in ours] == pytest.approx([t for t, _ in theirs], abs=tolerance_s), kind


def test_it_sends_each_message_that_the_recorded_one_sent() -> None:
    known = {form.msgname for message_id, form in reports.FORMS.items() if message_id in reports.ALL}
    assert known - {"FENCE_STATUS", "WIND"} == set(digest("session")["streams"]) - ON_OCCASION


def test_asked_streams_come_at_the_recorded_rates() -> None:
    streams = digest("session")["streams"]
    bench = cruising(3.0, asked=False, step_s=0.01)
    rates_hz = {"GLOBAL_POSITION_INT": 10.0, "ATTITUDE": 20.0, "SYS_STATUS": 2.0, "BATTERY_STATUS": 1.0}
    ids = {form.msgname: message_id for message_id, form in reports.FORMS.items()}
    bench.ask({ids[name]: rate_hz for name, rate_hz in rates_hz.items()})
    before = {name: bench.count(name) for name in rates_hz}
    bench.run(10.0)
    for name in rates_hz:
        assert (bench.count(name) - before[name]) / 10.0 == pytest.approx(
            streams[name]["rate_hz"], rel=0.03, abs=0.1
        ), name


# What depends on the flight, or is not the nature of the vehicle.
VARIES = {
    "HOME_POSITION": {"latitude", "longitude", "altitude"},
    "GPS_GLOBAL_ORIGIN": {"latitude", "longitude", "altitude"},
}


def same_kind(ours: Any, theirs: Any) -> bool:
    """Numbers that are known where they were known, and alike in shape."""
    if isinstance(theirs, list):
        return len(ours) == len(theirs) and all(map(same_kind, ours, theirs))
    if isinstance(theirs, float):
        return math.isnan(ours) == math.isnan(theirs)
    return type(ours) is type(theirs)


def test_fields_hold_what_the_recorded_ones_hold() -> None:
    streams = digest("session")["streams"]
    bench = cruising(3.0)
    bench.ask(dict.fromkeys(reports.ALL, 2.0))
    bench.run(1.1)
    for message_id in reports.ALL:
        name = reports.FORMS[message_id].msgname
        if name not in streams or name in ON_OCCASION | {"TIMESYNC"}:
            continue
        ours, theirs = bench.last(name).to_dict(), streams[name]["example"]
        for field, value in theirs.items():
            assert same_kind(ours[field], value), f"{name}.{field}: {ours[field]} for {value}"
            if field in streams[name]["constant"] and field not in VARIES.get(name, ()):
                assert ours[field] == value, f"{name}.{field}"
