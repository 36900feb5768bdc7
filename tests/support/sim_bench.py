"""A ground station for a fleet in virtual time that exchanges MAVLink frames as bytes."""

from __future__ import annotations

import copy
import copyreg
import gzip
import json
import math
import struct
from itertools import chain
from pathlib import Path
from typing import Any, Self

from pymavlink.dialects.v20 import common

from gcs.sim.fleet import Fleet
from gcs.sim.protocol.streams import RECORDED_HZ
from gcs.sim.settings import Settings
from gcs.testing.virtual_show import FLEET_STEP_S

PX4_DATA = Path(__file__).parents[1] / "data" / "px4"
STATION = (245, 190)
VELOCITY_AND_YAW, VELOCITY_ONLY, POSITION_ONLY = 0x9C7, 0xDC7, 0xDF8
HOLD, LAND, RETURN, OFFBOARD, POSITION = (4, 3), (4, 6), (4, 5), (6, 0), (3, 0)
TAKEOFF = (4, 2)
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
START_S = 1000.0
UNREAD = (
    common.MAVLINK_MSG_ID_ALTITUDE,
    common.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    common.MAVLINK_MSG_ID_ATTITUDE_TARGET,
    common.MAVLINK_MSG_ID_DISTANCE_SENSOR,
    common.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
    common.MAVLINK_MSG_ID_VFR_HUD,
)
SELDOM_HZ = {
    message_id: min(rate_hz, 1.0 if message_id in UNREAD else 10.0)
    for message_id, rate_hz in RECORDED_HZ.items()
}
"""Streams for tests that are not about streams: most of the computing is in them."""


class Bench:
    """A fleet, the messages that it sent, and the setpoint that is repeated to it."""

    def __init__(self, step_s: float = FLEET_STEP_S, **settings: Any) -> None:
        """`STEP_S`, as `gcs sim` has it, is for tests that look at milliseconds."""
        settings = {"noise_scale": 0.0, "rates_hz": SELDOM_HZ, **settings}
        self.fleet = Fleet(Settings(**settings), start_s=START_S, unix_at_start_s=1.8e9, step_s=step_s)
        self._circle = self.fleet.receiver.circle(range(len(self.fleet.autopilots)))
        self.received: list[tuple[float, Any]] = []
        self.repeated: Any = None  # a setpoint, 20 times a second
        self.heartbeats = True
        self._mav = common.MAVLink(None, *STATION)
        self._receivers = common.MAVLink(None)
        self._heartbeat_s = self._setpoint_s = self.fleet.time_s  # when the next is due

    @property
    def now_s(self) -> float:
        return self.fleet.time_s - START_S

    @property
    def truth(self) -> list[float]:
        """Position of the first vehicle, common NED."""
        row: list[float] = self.fleet.bodies.position_m[0].tolist()
        return row

    @property
    def velocity(self) -> list[float]:
        row: list[float] = self.fleet.bodies.velocity_m_s[0].tolist()
        return row

    def frame(self, message: Any) -> bytes:
        frame = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return frame

    def send(self, message: Any) -> None:
        self.send_bytes(self.frame(message))

    def send_bytes(self, datagram: bytes) -> None:
        self.fleet.receiver.receive([(self._circle, datagram)])
        self._receive(self.fleet.take_frames(streams=False))

    def run(self, duration_s: float) -> Self:
        fleet = self.fleet
        for _ in range(round(duration_s / fleet.step_s)):
            soon_s = fleet.time_s + 0.5 * fleet.step_s
            if soon_s > self._heartbeat_s:
                self._heartbeat_s += 1.0
                if self.heartbeats:
                    self.send(common.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
            if soon_s > self._setpoint_s:
                self._setpoint_s += 0.05
                if self.repeated is not None:
                    self.send(self.repeated)
            fleet.step()
            self._receive(self.fleet.take_frames())
        return self

    def until(self, condition: Any, limit_s: float) -> float:
        """Run until the condition holds. Returns: the duration in s."""
        begin_s = self.now_s
        while not condition():
            if self.now_s - begin_s > limit_s:
                raise TimeoutError(f"not within {limit_s} s")
            self.run(0.05)
        return self.now_s - begin_s

    def command(self, number: int, *values: float, wait_s: float = 0.05, target: int = 1) -> list[int]:
        """Send a COMMAND_LONG. Returns: the acknowledged results in order."""
        before = len(self.received)
        padded = [*values, *[0.0] * (7 - len(values))]
        self.send(common.MAVLink_command_long_message(target, 1, number, 0, *padded))
        self.run(wait_s)
        acks = [m for _, m in self.received[before:] if m.get_type() == "COMMAND_ACK" and m.command == number]
        return [ack.result for ack in acks]

    def set_mode(self, mode: tuple[int, int]) -> list[int]:
        return self.command(176, 1, *mode)

    def arm(self) -> list[int]:
        return self.command(400, 1)

    def set_parameter(self, name: str, value: float) -> None:
        for autopilot in self.fleet.autopilots:
            autopilot.parameters.set(name, value)

    def stream(self, north: float, east: float, down: float, mask: int = VELOCITY_ONLY, **more: Any) -> None:
        """Repeat a setpoint: a velocity, or with POSITION_ONLY a position."""
        self.repeated = setpoint(north, east, down, mask, **more)

    def take_off(self, height_m: float = 10.0) -> Self:
        """Take off to that height and hold."""
        self.ready()
        altitude_m = self.last("HOME_POSITION").altitude * 1e-3 + height_m
        assert self.command(22, 0, 0, 0, math.nan, math.nan, math.nan, altitude_m) == [ACCEPTED]
        assert self.arm() == [ACCEPTED]
        self.run(1.1)  # until the next HEARTBEAT the last one reports HOLD
        self.until(lambda: self.mode == HOLD, 30.0)
        return self.run(4.0)

    def fly_offboard(self, height_m: float = 10.0) -> Self:
        """Take off to that height and follow setpoints of zero velocity."""
        self.take_off(height_m)
        self.stream(0, 0, 0)
        self.run(0.2)
        assert self.set_mode(OFFBOARD) == [ACCEPTED, ACCEPTED]
        return self.run(2.0)

    def ready(self) -> Self:
        self.until(lambda: self.prearm_ok and self.count("HOME_POSITION") > 0, 10.0)
        return self

    def all(self, kind: str, since_s: float = 0.0) -> list[Any]:
        return [
            message for time_s, message in self.received if time_s >= since_s and message.get_type() == kind
        ]

    def count(self, kind: str) -> int:
        return len(self.all(kind))

    def last(self, kind: str) -> Any:
        return next(message for _, message in reversed(self.received) if message.get_type() == kind)

    @property
    def mode(self) -> tuple[int, int]:
        custom = self.last("HEARTBEAT").custom_mode
        return custom >> 16 & 255, custom >> 24

    @property
    def armed(self) -> bool:
        return bool(self.last("HEARTBEAT").base_mode & 128)

    @property
    def prearm_ok(self) -> bool:
        seen = self.all("SYS_STATUS")
        return bool(seen) and bool(seen[-1].onboard_control_sensors_health & 0x10000000)

    @property
    def texts(self) -> list[str]:
        """Whole texts, chunks joined."""
        texts: dict[int, str] = {}
        for message in self.all("STATUSTEXT"):
            texts[message.id] = texts.get(message.id, "") + message.text
        return [text.strip() for text in texts.values()]

    def _receive(self, stated: dict[int, list[bytes]]) -> None:
        for frame in chain.from_iterable(stated.values()):
            assert frame[0] == 0xFD
            self.received.append((self.now_s, self._receivers.decode(bytearray(frame))))


copyreg.pickle(struct.Struct, lambda each: (struct.Struct, (each.format,)))  # so that a bench can be copied


_led: dict[str, Bench] = {}
"""Benches that stand still where they were led to, by what led them."""


def _copied(maneuver: str, settings: dict[str, Any], **how: float) -> Bench:
    """A bench of these settings after the maneuver, which is flown once for all tests."""
    made_of = f"{maneuver} {how} {settings}"
    if made_of not in _led:
        _led[made_of] = getattr(Bench(**settings), maneuver)(**how)
    original = _led[made_of]
    return copy.deepcopy(original, {id(message): message for _, message in original.received})


def ready(**settings: Any) -> Bench:
    """`Bench(**settings).ready()`, flown once for all tests."""
    return _copied("ready", settings)


def holding(height_m: float = 10.0, **settings: Any) -> Bench:
    """`Bench(**settings).take_off(height_m)`, flown once for all tests."""
    return _copied("take_off", settings, height_m=height_m)


def offboard(height_m: float = 10.0, **settings: Any) -> Bench:
    """`Bench(**settings).fly_offboard(height_m)`, flown once for all tests."""
    return _copied("fly_offboard", settings, height_m=height_m)


def setpoint(north: float, east: float, down: float, mask: int, **more: Any) -> Any:
    fields = {"frame": 1, "yaw": 0.0, "yaw_rate": 0.0, "target": 1, **more}
    vector = (north, east, down)
    return common.MAVLink_set_position_target_local_ned_message(
        0,
        fields["target"],
        1,
        fields["frame"],
        mask,
        *vector,
        *vector,
        0.0,
        0.0,
        0.0,
        fields["yaw"],
        fields["yaw_rate"],
    )


def digest(name: str) -> dict[str, Any]:
    """A recorded session, see tests/data/px4/README.md."""
    return dict(json.loads(gzip.decompress((PX4_DATA / f"digest_{name}.json.gz").read_bytes())))
