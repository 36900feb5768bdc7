"""A simulated world with vehicles that send MAVLink, read and judged by the code of the flight.

Each vehicle sends its position, and answers the station's requests for its clock, over one link with one
delay. The bytes pass `gcs.links.telemetry` and `gcs.estimation.fleet_state`, as in flight.
"""

from collections import deque
from typing import Final

import numpy as np

from gcs.config.sections import OperationSettings
from gcs.estimation.fleet_state import Table
from gcs.links.autopilots import AUTOPILOTS
from gcs.links.round_trips import RoundTrips
from gcs.links.telemetry import FleetTelemetry
from gcs.mavlink import codec, framing
from gcs.mavlink.kernels import DATAGRAM
from gcs.model.frames import ShowFrame
from gcs.model.state import Array, FleetState, Mask, Setpoints
from gcs.simulation.lies import FROZEN, JUMP, JUMPS, LATE, LATER, WRONG_SIGN, Liars, Lies
from gcs.simulation.scenario import World
from gcs.simulation.world import TrueWorld

FRAME: Final = ShowFrame(47.397742, 8.545594, 488.0)

BOOTED_S: Final = 30.0
"""Before the flight begins: an autopilot's clock counts from then on."""

ARMED: Final = 0x81
"""MAV_MODE_FLAG_SAFETY_ARMED, MAV_MODE_FLAG_CUSTOM_MODE_ENABLED."""


class Channel:
    """Messages of n vehicles under way to the station: each vehicle's arrive in their order."""

    def __init__(self, count: int) -> None:
        self._under_way: deque[tuple[Array, Mask, codec.Frames]] = (
            deque()
        )  # arrival, which are to come, frames
        self._number = np.zeros(count, np.uint8)

    def send(self, message_id: int, messages: codec.Records, rows: Mask, arrives_s: Array) -> None:
        """Send one message of each vehicle in `rows` (n,), to arrive at (n,) times; `messages` (n,)."""
        frames = codec.encode(message_id, messages, self._number, component_id=codec.AUTOPILOT_COMPONENT)
        self._number = self._number + rows.astype(np.uint8)
        self._under_way.append((arrives_s, rows.copy(), frames))

    def arrived(self, now_s: float, into: FleetTelemetry) -> None:
        """Have the station read what has arrived by now."""
        for arrives_s, rows, sent in self._under_way:
            due = np.flatnonzero(rows & (arrives_s <= now_s + 1e-9))
            if not len(due):
                continue
            rows[due] = False
            flat = sent.data.reshape(-1)
            frames = codec.find(flat, due * sent.data.shape[1], sent.length[due]).frames
            of = due[frames[:, DATAGRAM]]
            into.take(flat, frames, of, arrives_s[of])
        while self._under_way and not self._under_way[0][1].any():
            self._under_way.popleft()


class ReportingWorld(TrueWorld):
    """A world in which some vehicles lie.

    Attributes:
        table: what the flight believes, as `gcs.flight.state.flight` has it.
        liars: which vehicles lie.
        position_time_s: (n,) arrival of each newest position, believed or not.
    """

    def __init__(self, start_m: Array, world: World, seed: int, lies: Lies) -> None:
        super().__init__(start_m, world, seed)
        n = len(start_m)
        self._lies, self._jumps = lies, np.random.default_rng([seed, 12])
        self._telemetry_delay_s, self._setpoint_delay_s = world.telemetry_delay_s, world.setpoint_delay_s
        self.liars = Liars.drawn(lies, n, world.telemetry_delay_s, seed)
        autopilots = [AUTOPILOTS[world.autopilot_of(row)] for row in range(n)]
        self.table = Table(self.ids, FRAME)
        self._telemetry_of_all = FleetTelemetry(self.ids, autopilots)
        self._trips = RoundTrips(self._telemetry_of_all, self._answer)
        self._channel = Channel(n)
        self.position_time_s = np.full(n, -np.inf)
        self._operation = OperationSettings()
        self._setpoint_s = np.full(n, np.inf)  # when the newest arrives
        self._unled: Mask = np.zeros(n, np.bool_)  # alone, because no setpoint arrived
        self._repeated_m = np.full((n, 3), np.nan)
        self._jumped = np.zeros(n, np.int64)
        beats = codec.records(framing.HEARTBEAT, n)
        beats["base_mode"], beats["mavlink_version"] = ARMED, 3
        beats["autopilot"] = [each.number for each in autopilots]
        self._channel.send(framing.HEARTBEAT, beats, np.ones(n, np.bool_), np.zeros(n))
        self._send(-world.telemetry_delay_s, np.ones(n, np.bool_))

    def receive(self, asked_m_s: Array | None = None) -> FleetState:
        """Receive telemetry. Returns: the state as the flight believes it, by (n, 3) setpoints it sent."""
        now_s = self.time_s
        self._begin_lies(now_s)
        self._send(now_s, self.kept())
        self._channel.arrived(now_s, self._telemetry_of_all)
        telemetry = self._telemetry_of_all.telemetry()
        self.position_time_s = telemetry.position_time_s
        fleet = self.table.state([telemetry], now_s, asked_m_s)
        self._trips.watch(np.ones(len(self.ids), np.bool_), now_s)
        self.received_m, self.received_m_s = fleet.position_m, self.table.last_velocity_m_s
        return fleet

    def sample_age_s(self, now_s: float) -> Array:
        return self.table.sample_age_s(now_s)

    def send(self, setpoints: Setpoints) -> None:
        """Send setpoints. Without any for too long an autopilot does what it is configured to do."""
        super().send(setpoints)
        sent = np.isfinite(self.of_all(setpoints)[:, 0])
        self._setpoint_s[sent] = self.time_s + self._setpoint_delay_s
        self.autopilots.end(self._unled & sent)
        self._unled &= ~sent
        lacks = self.time_s - self._setpoint_s >= self._operation.setpoint_loss_s
        lacks &= self.in_air & ~self.autopilots.alone
        if lacks.any():
            self.fly_alone(lacks, self._operation.setpoint_loss_action)
            self._unled |= lacks

    def fly_alone(self, rows: Mask, action: str) -> None:
        super().fly_alone(rows, action)
        self._unled = self._unled & ~rows  # until it is commanded otherwise

    def _begin_lies(self, now_s: float) -> None:
        """Let the positions jump that are due."""
        lies, kind = self._lies, self.liars.kind
        most, length_m, every_s = lies.jumps
        passed_s = now_s - lies.from_s + 1e-9
        due = np.where(kind == JUMP, float(passed_s >= 0.0), 0.0)
        due = np.where(kind == JUMPS, np.clip(np.floor(passed_s / every_s) + 1.0, 0.0, most), due)
        rows = np.flatnonzero(due > self._jumped)
        if len(rows):
            way_m = self._jumps.normal(size=(len(rows), 3))
            way_m *= np.where(kind[rows] == JUMP, lies.jump_m, length_m)[:, None] / np.linalg.norm(
                way_m, axis=1, keepdims=True
            )
            self.reset_m[rows] += way_m
            self._jumped[rows] += 1

    def _late_s(self, now_s: float) -> Array:
        """(n,) by how much later than usual all arrives that a vehicle sends now."""
        lies, kind, passed_s = self._lies, self.liars.kind, now_s - self._lies.from_s
        if passed_s < -1e-9:
            return np.zeros(len(kind))
        grown_s = min(lies.later_by * passed_s, lies.late_s)
        return np.where(kind == LATE, lies.late_s, np.where(kind == LATER, grown_s, 0.0))

    def _send(self, now_s: float, rows: Mask) -> None:
        """Have the vehicles in `rows` (n,) send where they say they are."""
        position_m, velocity_m_s = self.estimate()
        if now_s >= self._lies.from_s - 1e-9:
            kind = self.liars.kind
            velocity_m_s = np.where((kind == WRONG_SIGN)[:, None], -velocity_m_s, velocity_m_s)
            first = (kind == FROZEN) & np.isnan(self._repeated_m[:, 0])
            self._repeated_m[first] = position_m[first]
            position_m = np.where((kind == FROZEN)[:, None], self._repeated_m, position_m)
        messages = codec.records(framing.GLOBAL_POSITION_INT, len(rows))
        latitude_deg, longitude_deg, altitude_m = FRAME.geodetic(position_m)
        messages["time_boot_ms"] = round(1e3 * (now_s + BOOTED_S))
        messages["lat"], messages["lon"] = np.rint(1e7 * latitude_deg), np.rint(1e7 * longitude_deg)
        messages["alt"] = np.rint(1e3 * altitude_m)
        for axis, name in enumerate(("vx", "vy", "vz")):
            messages[name] = np.rint(100.0 * velocity_m_s[:, axis])
        arrives_s = now_s + self._telemetry_delay_s + self._late_s(now_s)
        self._channel.send(framing.GLOBAL_POSITION_INT, messages, rows, arrives_s)

    def _answer(self, _message: int, requests: codec.Records, now_s: float) -> None:
        """Have all vehicles answer the station's request for their clocks."""
        n = len(self.ids)
        answers = codec.records(framing.TIMESYNC, n)
        answers["ts1"], answers["tc1"] = requests["ts1"][0], round(1e9 * (now_s + BOOTED_S))
        arrives_s = now_s + self._telemetry_delay_s + self._setpoint_delay_s + self._late_s(now_s)
        self._channel.send(framing.TIMESYNC, answers, self.kept(), arrives_s)
