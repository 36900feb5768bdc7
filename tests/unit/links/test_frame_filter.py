"""MAVSDK receives what its own vehicle's autopilot sends, and the answers to its own commands."""

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as dialect

from gcs.links.mavsdk.binding import COMPONENT_ID
from gcs.links.mavsdk.link import FrameFilter
from gcs.links.stream_requests import REQUESTING_COMPONENT
from gcs.mavlink.codec import find

STATION, OTHER_STATION = 245, 255

HOME = dialect.MAVLink_home_position_message(474000000, 85000000, 488000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
"""Without it MAVSDK counts no vehicle as ready."""


def shown(message: Any, component: int = 1) -> bool:
    raw = bytes(message.pack(dialect.MAVLink(None, srcSystem=3, srcComponent=component)))
    data = np.frombuffer(bytearray(raw), np.uint8)
    frames = find(data, np.zeros(1, np.int64), np.array([len(raw)])).frames
    (is_shown,) = FrameFilter(1, STATION).of(data, frames, np.zeros(1, np.int64), np.zeros(1))
    return bool(is_shown)


@pytest.mark.parametrize(("component", "expected"), [(1, True), (191, False), (154, False), (68, False)])
def test_other_components_give_no_mode_battery_or_state(component: int, expected: bool) -> None:
    for message in (
        dialect.MAVLink_heartbeat_message(2, 12, 0x81, 4 << 16 | 3 << 24, 4, 3),
        dialect.MAVLink_battery_status_message(0, 0, 0, 0, [4000] * 10, -1, -1, -1, 3),
        dialect.MAVLink_extended_sys_state_message(0, 1),
        dialect.MAVLink_global_position_int_message(0, 474000000, 85000000, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_command_ack_message(400, 0, 0, 0, STATION, COMPONENT_ID),
        HOME,
    ):
        assert shown(message, component) is expected


def test_fences_are_not_shown() -> None:
    assert not shown(dialect.MAVLink_mission_count_message(STATION, COMPONENT_ID, 4, 1))
    assert not shown(dialect.MAVLink_mission_current_message(0))


@pytest.mark.parametrize(
    ("system", "component", "expected"),
    [
        (STATION, COMPONENT_ID, True),
        (0, 0, True),
        (STATION, REQUESTING_COMPONENT, False),
        (OTHER_STATION, COMPONENT_ID, False),
    ],
)
def test_only_answers_to_its_own_commands_are_shown(system: int, component: int, expected: bool) -> None:
    assert shown(dialect.MAVLink_command_ack_message(400, 4, 0, 0, system, component)) is expected
