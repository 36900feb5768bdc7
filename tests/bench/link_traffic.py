"""Light vehicles for measuring: a whole fleet's telemetry, made in batches, in a process of its own.

They are in OFFBOARD from the beginning, do what setpoints say with a little lag, and answer commands with
"accepted". `python -m gcs.sim` is the fake fleet that behaves like PX4; this one only costs little.

Ended by SIGTERM it says in one line of JSON what it saw of its ground station; SIGUSR1 lets what it measures
begin anew.
"""

import argparse
import json
import signal
import time

import numpy as np
from pymavlink.dialects.v20 import development as dialect

from gcs.links.endpoints.ports import Datagrams, source_of
from gcs.links.endpoints.udp import UdpPorts
from gcs.links.settings import Listen
from gcs.mavlink import codec
from gcs.mavlink.framing import (
    BATTERY_STATUS,
    COMMAND_ACK,
    COMMAND_LONG,
    EXTENDED_SYS_STATE,
    GLOBAL_POSITION_INT,
    HEARTBEAT,
    PREARM_CHECK,
    SET_POSITION_TARGET_LOCAL_NED,
    SYS_STATUS,
)
from gcs.mavlink.kernels import DATAGRAM, MESSAGE, Bytes, Whole
from gcs.model.frames import ShowFrame
from gcs.model.state import Array

STEP_S = 0.0097
LAG_S = 0.3
OFFBOARD = 6 << 16
NOISE_BYTES, MAGIC = 280, 0xFD
"""Of who jams: a full datagram in every step, with what looks like the beginnings of frames."""
STAMPS = 3000
"""Every position carries in its `relative_alt` the step in which it left; a ground station that has nothing
better to say returns it as yaw, in thousandths of a radian. It comes again after half a minute."""

HOST = "127.0.0.1"
FRAME = ShowFrame(47.397742, 8.545594, 488.0)

STREAMS_HZ = {
    GLOBAL_POSITION_INT: 10.0,
    HEARTBEAT: 1.0,
    SYS_STATUS: 1.0,
    EXTENDED_SYS_STATE: 2.0,
    BATTERY_STATUS: 0.5,
}


def sphere_m(count: int, radius_m: float, height_m: float) -> Array:
    """(n, 3) places spread over a sphere, show frame."""
    index = np.arange(count) + 0.5
    z, angle = 1.0 - 2.0 * index / count, np.pi * (3.0 - 5.0**0.5) * index
    ring = np.sqrt(1.0 - z * z)
    place_m: Array = radius_m * np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
    return place_m - (0.0, 0.0, height_m)


class Namespace:
    """Vehicles 1 to n behind one address, talking to one port."""

    def __init__(
        self,
        port: int,
        position_m: Array,
        *,
        own_ports: bool,
        silent: int,
        garbage: int,
        position_hz: float = STREAMS_HZ[GLOBAL_POSITION_INT],
    ) -> None:
        """With `own_ports` vehicle i speaks to port + i - 1; the first are silent, the next send garbage."""
        n = len(position_m)
        self._garbage = np.arange(silent, silent + garbage)
        self._speaks = np.arange(n) >= silent + garbage
        self._random = np.random.default_rng(port)
        self.setpoints = 0
        self.first_beat_s: Array = np.full(n, np.nan)
        self.answered_s: list[Array] = []
        self._stamp, self._stamped_s = 0, np.full(STAMPS, np.nan)
        self._answered = np.full(n, -1)
        self._system_ids = np.arange(1, n + 1)
        self._position_m = position_m
        self._velocity_m_s, self._desired_m_s = np.zeros((n, 3)), np.zeros((n, 3))
        self._sequence: Bytes = np.zeros(n, np.uint8)
        self._packets = UdpPorts("traffic", Listen(HOST, 0), time.monotonic)
        self._packets.open()
        self._ground = source_of(int.from_bytes(b"\x7f\0\0\1", "big"), port, 0) + own_ports * np.arange(n)
        phase = np.random.default_rng(port).random(n)
        self._streams_hz = {**STREAMS_HZ, GLOBAL_POSITION_INT: position_hz}
        self._due_s = {message_id: phase / rate_hz for message_id, rate_hz in self._streams_hz.items()}

    def step(self, time_s: float) -> None:
        """Read what came, move, send what is due."""
        self.listen()
        self._stamp = round(time_s / STEP_S) % STAMPS
        self._stamped_s[self._stamp] = time.monotonic()
        self._velocity_m_s += (self._desired_m_s - self._velocity_m_s) * STEP_S / LAG_S
        self._position_m = self._position_m + self._velocity_m_s * STEP_S
        if len(self._garbage):
            noise = self._random.integers(0, 256, (len(self._garbage), NOISE_BYTES), np.uint8)
            noise[:, ::40] = MAGIC
            self._packets.send(noise, np.full(len(noise), NOISE_BYTES), self._ground[self._garbage])
        for message_id, due_s in self._due_s.items():
            rows = np.flatnonzero((due_s <= time_s) & self._speaks)
            if len(rows):
                due_s[rows] += 1.0 / self._streams_hz[message_id]
                self._send(message_id, self._messages(message_id, rows, time_s), rows)
                if message_id == HEARTBEAT:
                    new = rows[np.isnan(self.first_beat_s[rows])]
                    self.first_beat_s[new] = time.monotonic()

    def listen(self) -> None:
        """Read what came."""
        self._packets.receive(self._take)

    def _take(self, arrived: Datagrams) -> None:
        frames = codec.find(arrived.data, arrived.start, arrived.length).frames
        kind = SET_POSITION_TARGET_LOCAL_NED
        setpoints = codec.decode(kind, arrived.data, frames[frames[:, MESSAGE] == kind])
        rows = setpoints["target_system"].astype(int) - 1
        self._desired_m_s[rows] = np.stack([setpoints[axis] for axis in ("vx", "vy", "vz")], axis=1)
        self.setpoints += len(setpoints)
        arrived_s = arrived.time_s[frames[frames[:, MESSAGE] == SET_POSITION_TARGET_LOCAL_NED][:, DATAGRAM]]
        self._take_answers(rows, np.round(setpoints["yaw"] * 1e3).astype(int), arrived_s)
        commands = codec.decode(COMMAND_LONG, arrived.data, frames[frames[:, MESSAGE] == COMMAND_LONG])
        for command in commands:
            rows = np.array([int(command["target_system"]) - 1])
            answer = codec.records(COMMAND_ACK, 1)
            answer["command"] = command["command"]
            self._send(COMMAND_ACK, answer, rows)

    def _take_answers(self, rows: Whole, stamps: Whole, arrived_s: Array) -> None:
        """Note how long after each position the first setpoint came that returns its stamp."""
        stamps = np.where((stamps >= 0) & (stamps < STAMPS), stamps, -1)
        new = np.flatnonzero((stamps >= 0) & (stamps != self._answered[rows]))
        self.answered_s.append(arrived_s[new] - self._stamped_s[stamps[new]])
        self._answered[rows] = stamps

    def _messages(self, message_id: int, rows: Whole, time_s: float) -> codec.Records:
        stated = codec.records(message_id, len(rows))
        if message_id == GLOBAL_POSITION_INT:
            latitude_deg, longitude_deg, altitude_m = FRAME.geodetic(self._position_m[rows])
            stated["time_boot_ms"] = int(time_s * 1e3)
            stated["lat"], stated["lon"] = np.round(latitude_deg * 1e7), np.round(longitude_deg * 1e7)
            stated["alt"] = np.round(altitude_m * 1e3)
            stated["relative_alt"] = self._stamp
            for axis, name in enumerate(("vx", "vy", "vz")):
                stated[name] = np.round(self._velocity_m_s[rows, axis] * 100)
        elif message_id == HEARTBEAT:
            stated["type"], stated["autopilot"] = dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_PX4
            stated["base_mode"], stated["custom_mode"] = 0x81, OFFBOARD
        elif message_id == SYS_STATUS:
            stated["onboard_control_sensors_health"], stated["battery_remaining"] = PREARM_CHECK, 80
        elif message_id == EXTENDED_SYS_STATE:
            stated["landed_state"] = dialect.MAV_LANDED_STATE_IN_AIR
        else:
            stated["battery_remaining"] = 80
        return stated

    def _send(self, message_id: int, messages: codec.Records, rows: Whole) -> None:
        frames = codec.encode(
            message_id,
            messages,
            self._sequence[rows],
            system_id=self._system_ids[rows].astype(np.uint8),
            component_id=1,
        )
        self._sequence[rows] += np.uint8(1)
        self._packets.send(frames.data, frames.length, self._ground[rows])


def main() -> None:
    """Fly until ended, telemetry and all."""
    parser = argparse.ArgumentParser()
    for name in ("port", "namespaces", "each"):
        parser.add_argument(name, type=int)
    for name in ("radius", "height"):
        parser.add_argument(name, type=float)
    for name in ("silent", "garbage"):
        parser.add_argument(f"--{name}", type=int, default=0)
    parser.add_argument("--position-hz", type=float, default=STREAMS_HZ[GLOBAL_POSITION_INT])
    parser.add_argument("--own-ports", action="store_true")
    given = parser.parse_args()
    place_m = sphere_m(given.namespaces * given.each, given.radius, given.height)
    fleets = [
        Namespace(
            given.port + index,
            place_m[index * given.each : (index + 1) * given.each],
            own_ports=given.own_ports,
            silent=given.silent,
            garbage=given.garbage,
            position_hz=given.position_hz,
        )
        for index in range(given.namespaces)
    ]
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: ended.append(number))  # what is being read is counted
    signal.signal(signal.SIGUSR1, lambda *_: forget(fleets))
    start_s = time.monotonic()
    step = 0
    while not ended:
        for fleet in fleets:
            fleet.step(step * STEP_S)
        step += 1
        time.sleep(max(0.0, start_s + step * STEP_S - time.monotonic()))
    tell(fleets)


def forget(fleets: list[Namespace]) -> None:
    """What was measured before."""
    for fleet in fleets:
        fleet.answered_s.clear()


def tell(fleets: list[Namespace]) -> None:
    """Print what they saw, when the last of it has been read."""
    for fleet in fleets:
        fleet.listen()
    answered_s = np.concatenate([np.zeros(0), *(each for fleet in fleets for each in fleet.answered_s)])
    report = {
        "setpoints": sum(fleet.setpoints for fleet in fleets),
        "first_beat_s": [fleet.first_beat_s.tolist() for fleet in fleets],
        "answered_p99_ms": float(np.percentile(answered_s, 99)) * 1e3 if len(answered_s) else None,
    }
    print(json.dumps(report), flush=True)


if __name__ == "__main__":
    main()
