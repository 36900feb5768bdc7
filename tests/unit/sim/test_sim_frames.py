"""Frames made and read for many vehicles at once, against pymavlink."""

from __future__ import annotations

from typing import Any

import numpy as np
import pymap3d
import pytest
from pymavlink.dialects.v20 import common

from gcs.sim import endpoint as ports
from gcs.sim.fleet import Fleet
from gcs.sim.protocol import frames
from gcs.sim.protocol.streams import RECORDED_HZ
from gcs.sim.settings import Settings
from gcs.sim.vehicle.sensors import Tangent


def received(fleet: Fleet) -> list[tuple[int, bytes]]:
    fleet.step()
    return [(row, frame) for row, stated in fleet.take_frames().items() for frame in stated]


def test_every_stream_is_byte_equal_to_pymavlinks() -> None:
    fleet = Fleet(Settings(count=5, grid_columns=3, heading_deg=120.0, seed=4), start_s=0.0)
    seen = set()
    receiver = common.MAVLink(None)
    for _ in range(900):
        for row, frame in received(fleet):
            message: Any = receiver.decode(bytearray(frame))
            voice = common.MAVLink(None, srcSystem=row + 1, srcComponent=1)
            voice.seq = message.get_seq()
            assert bytes(message.pack(voice)) == frame
            seen.add(message.get_msgId())
    assert seen == set(RECORDED_HZ)


def setpoint_frame(target: int) -> bytes:
    message = common.MAVLink_set_position_target_local_ned_message(
        7, target, 1, 1, 0x9C7, 0, 0, 0, 1.5, -2.0, 0.25, 0, 0, 0, 0.5, 0
    )
    return bytes(message.pack(common.MAVLink(None, 245, 190)))


def test_setpoints_are_read_in_batches_and_damaged_reported() -> None:
    raw = bytearray(b"".join(setpoint_frame(k) for k in (1, 2, 3)))
    raw[70 + 10] ^= 0x10
    found = frames.setpoints(bytes(raw))
    assert found is not None
    messages, sender, good = found
    assert (messages["target_system"].tolist(), sender.tolist()) == ([1, 2, 3], [[245, 190]] * 3)
    assert good.tolist() == [True, False, True]
    assert messages["vx"].tolist() == [1.5] * 3


@pytest.mark.parametrize("raw", [b"", b"\xfd" * 65, setpoint_frame(1)[:-1], setpoint_frame(1) + b"x"])
def test_invalid_setpoint_rows_are_left_to_other_readers(raw: bytes) -> None:
    assert frames.setpoints(raw) is None


def test_positions_agree_with_pymap3d() -> None:
    position_m = np.random.default_rng(0).normal(0.0, 2000.0, (200, 3))
    for origin in ((47.4, 8.5, 488.0), (-33.0, 151.0, 10.0), (0.0, 0.0, 0.0)):
        theirs = np.stack(pymap3d.ned2geodetic(*position_m.T, *origin), axis=1)
        assert np.abs(Tangent(*origin).geodetic(position_m) - theirs).max() < 1e-7


@pytest.mark.soak
def test_the_same_seed_is_the_same_flight() -> None:
    runs = []
    for _ in range(2):
        fleet = Fleet(Settings(count=7, seed=9), start_s=5.0)
        runs.append([frame for _ in range(700) for frame in received(fleet)])
    assert runs[0] == runs[1]


def test_vehicles_beyond_a_namespace_reuse_ids_on_own_ports() -> None:
    fleet = Fleet(Settings(count=5, first=1, namespace_size=3), start_s=0.0)
    assert fleet.state.system_id.tolist() == [2, 3, 1, 2, 3]
    own = ports.own_ports(0, 300, 250, None)
    assert [own[i].destination for i in (0, 8, 9, 249, 250, 299)] == [
        14540,
        14548,
        14549,
        14549,
        14530,
        14539,
    ]
    assert len({port.bind for port in own}) == 300
    shared = ports.shared_ports(0, 300, 250, 20000)
    assert [(port.destination, len(port.rows)) for port in shared] == [(20000, 250), (20001, 50)]
    assert [port.bind for port in ports.shared_ports(0, 300, 250, None)] == [14580, 14581]


@pytest.mark.parametrize(("sender", "heeded"), [((245, 190), True), ((245, 1), False)])
def test_only_frames_from_the_autopilots_own_id_are_dropped(sender: tuple[int, int], heeded: bool) -> None:
    fleet = Fleet(Settings(count=2, first=243), start_s=0.0)
    circle = fleet.receiver.circle([0, 1])
    message = common.MAVLink_set_position_target_local_ned_message(
        0, 245, 1, 1, 0x9C7, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0
    )
    fleet.receiver.receive([(circle, bytes(message.pack(common.MAVLink(None, *sender))))])
    assert fleet.state.setpoint_seen.tolist() == [False, heeded]


def test_grid_has_its_origin_and_rows_along_its_heading() -> None:
    settings = Settings(
        count=3, first=1, grid_columns=2, spacing_m=4.0, grid_at_m=(10.0, -5.0), grid_heading_deg=90.0
    )
    # vehicle 1 is in column 1, to the right of east: south; 2 and 3 are a row on, east
    expected_m = [[6.0, -5.0, 0.0], [10.0, -1.0, 0.0], [6.0, -1.0, 0.0]]
    assert Fleet(settings, start_s=0.0).bodies.position_m == pytest.approx(np.array(expected_m))
