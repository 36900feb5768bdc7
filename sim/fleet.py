"""The vehicles of one process: bodies, estimates and autopilots under one clock. Sans-I/O."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gcs.sim.protocol import frames, reports
from gcs.sim.protocol.autopilot import Autopilot, Shared
from gcs.sim.protocol.frames import Codec
from gcs.sim.protocol.receiver import Receiver
from gcs.sim.protocol.reports import Snapshot
from gcs.sim.protocol.streams import RECORDED_HZ, Outbox, Schedule
from gcs.sim.vehicle import sensors as measured
from gcs.sim.vehicle.commander import Transitions
from gcs.sim.vehicle.dynamics import Array, PointMasses, Response
from gcs.sim.vehicle.guidance import Guidance
from gcs.sim.vehicle.px4 import Columns, Parameters, Quirks, Value
from gcs.sim.vehicle.sensors import Batteries, Sensors, Tangent
from gcs.sim.vehicle.state import Rows, State

STEP_S = 0.01
MAX_SYSTEM_ID = 250
READY_AFTER_S = (4.0, 6.0)  # item 2
READY_AT_ONCE_S = 0.1
FIX_BEFORE_READY_S = 1.0
CLOCK_LOSS = (0.01, 0.02)  # item 12: the boot clock is slower than the wall clock


@dataclass(frozen=True, slots=True)
class Origin:
    """Where the common NED frame starts: degrees, and metres above mean sea level."""

    latitude_deg: float = 47.397742
    longitude_deg: float = 8.545594
    altitude_amsl_m: float = 488.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings of a fleet. Vehicle i stands at row i // columns, column i % columns of a grid.

    Vehicle 0 stands at `grid_at_m` (north, east); rows lead towards `grid_heading_deg`, columns to its right.
    Its namespace is i // namespace_size, its system id there i % namespace_size + 1. Where a parameter
    has several values, vehicle i has the i-th.
    """

    count: int = 1
    first: int = 0
    namespace_size: int = MAX_SYSTEM_ID
    seed: int = 0
    noise_scale: float = 0.25
    drag_per_s: float = 1.0
    wind_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    origin: Origin = Origin()
    spacing_m: float = 4.0
    grid_columns: int = 1
    grid_at_m: tuple[float, float] = (0.0, 0.0)
    grid_heading_deg: float = 0.0
    heading_deg: float = 0.0
    endurance_s: float = 1200.0
    parameters: Mapping[str, Value | Sequence[Value]] = field(default_factory=dict)
    quirks: Quirks = Quirks()
    rates_hz: Mapping[int, float] = field(default_factory=lambda: RECORDED_HZ)

    def parameters_of(self, index: int) -> dict[str, Value]:
        own = {
            name: value[index] if isinstance(value, Sequence) else value
            for name, value in self.parameters.items()
        }
        return own | {"MAV_SYS_ID": index % self.namespace_size + 1}


class Fleet:
    """Steps all vehicles together; the arrays' row i belongs to autopilots[i]."""

    def __init__(
        self, settings: Settings, *, start_s: float, unix_at_start_s: float = 0.0, step_s: float = STEP_S
    ) -> None:
        """Place the vehicles on their grid and boot them at start_s; step_s as in `dynamics.step`.

        Every autopilot has a random stream of its own, by its index. The estimate errors are drawn together,
        by seed and first index, so that processes that share a seed differ.

        Raises: ParameterError for a parameter or value that PX4 does not accept.
        """
        self.settings = settings
        self.time_s = start_s
        self.step_s = step_s
        self._start_s, self._steps = start_s, 0
        self.unix_ahead_s = unix_at_start_s - start_s  # of time_s; grows where time is dropped
        self.wind_m_s = np.tile(np.array(settings.wind_m_s, dtype=np.float64), (settings.count, 1))
        origin = settings.origin
        self.geodetic = Tangent(origin.latitude_deg, origin.longitude_deg, origin.altitude_amsl_m).geodetic
        count, indices = settings.count, range(settings.first, settings.first + settings.count)
        self.bodies = PointMasses(_grid_m(settings), step_s, Response(drag_per_s=settings.drag_per_s))
        self._random = np.random.default_rng(
            np.random.SeedSequence(settings.seed, spawn_key=(settings.first, 1))
        )
        self._error = measured.draw_errors(count, settings.noise_scale, self._random)
        self._randoms = [
            np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=(i,))) for i in indices
        ]
        self.state = State(count, math.remainder(math.radians(settings.heading_deg), math.tau))
        self.state.now_s = start_s
        self.accuracy_m = measured.accuracy_m(settings.noise_scale)
        self.state.horizontal_accuracy_m[:], self.state.vertical_accuracy_m[:] = self.accuracy_m
        self.state.fix_type[:] = self.fix_type = measured.fix_type(settings.noise_scale)
        self.state.system_id[:] = [i % settings.namespace_size + 1 for i in indices]
        self._outbox, self._codec = Outbox(), Codec()
        self._schedule = Schedule(count, settings.rates_hz)
        shared = Shared(
            self.state, self._schedule, self._outbox, settings.quirks, self._set_home, self.reboot
        )
        self.autopilots = [
            Autopilot(shared, row, Parameters(settings.parameters_of(index)))
            for row, index in enumerate(indices)
        ]
        parameters = Columns([autopilot.parameters for autopilot in self.autopilots])
        commanders = [autopilot.commander for autopilot in self.autopilots]
        self._batteries = Batteries(self.state, parameters, settings.endurance_s)
        self._transitions = Transitions(self.state, commanders, parameters, settings.quirks)
        self._guidance = Guidance(self.state, commanders, parameters, settings.quirks)
        self.receiver = Receiver(self.state, self.autopilots)
        self._local_origin_m = np.full((count, 3), np.nan)
        self._lost = True  # at least one vehicle has no local origin yet
        self._contact = np.ones(count, dtype=np.bool_)
        for row in range(count):
            self._boot(row, start_s)
        self.sensors = self._sense()

    def step(self) -> None:
        step_s = self.step_s
        self._steps += 1
        self.time_s = self.state.now_s = self._start_s + self._steps * step_s
        if self.settings.noise_scale > 0.0:
            self._error = measured.step_errors(self._error, step_s, self.settings.noise_scale, self._random)
        state, sensors = self.state, self._sense()
        self.sensors = sensors
        awake = self.time_s >= state.fix_at_s
        for row in (awake & ~state.home_set).nonzero()[0].tolist():
            self._set_home(row)
        demand_m_s = self._guidance.velocity(sensors, awake, step_s)
        self._transitions.update(awake, sensors.contact, -demand_m_s[:, 2], self._batteries)
        powered = state.powered
        self._guidance.turn(powered, step_s)
        self._batteries.drain(powered, step_s)
        state.demanded_m_s = np.where(state.armed[:, np.newaxis], demand_m_s, np.nan)
        self.bodies.step(
            demand_m_s,
            wind_m_s=self.wind_m_s,
            velocity_error_m_s=self._error.velocity_m_s,
            powered=powered,
        )
        self._contact = self.bodies.rest_on_ground()

    def take_frames(self, *, streams: bool = True) -> dict[int, list[bytes]]:
        """Frames that each vehicle (by row) sends now: answers and texts, and with `streams` the streams."""
        sent: dict[int, list[bytes]] = {}
        for row, item in self._outbox.take(self.time_s):
            if isinstance(item, int):
                self._report(item, np.array([row]), sent)
            else:
                self._send_message(row, item, sent)
        if streams:
            for row, name in self._outbox.take_parameters():
                self._send_message(row, self.autopilots[row].parameter(name), sent)
            for message_id, rows in self._schedule.due(self.time_s):
                fixed = rows if message_id in reports.ALWAYS else rows[self.state.home_set[rows]]
                if len(fixed):
                    self._report(message_id, fixed, sent)
        return sent

    def reboot(self, row: int, *, off_s: float = 0.0) -> None:
        """Restart one vehicle's autopilot; it forgets everything but its parameters.

        The motors stand still from now on, as with PX4, which cannot resume a flight. The boot clock
        begins at 0 after off_s.
        """
        self.state.forget(row)
        self.state.landed[row] = self._contact[row]
        self._local_origin_m[row], self._lost = np.nan, True
        self.autopilots[row].forget()
        self._boot(row, self.time_s + off_s)

    def restart_link(self, row: int, *, off_s: float = 0.0) -> None:
        """Restart one vehicle's clock, streams and frame numbers while it flies on."""
        self.state.boot_s[row] = self.time_s + off_s
        self.state.clock_offset_s[row] = 0.0
        self.state.sequence[row] = 0
        self.autopilots[row].forget()
        self._schedule.start(row, self.time_s + off_s, self._randoms[row])

    def _boot(self, row: int, now_s: float) -> None:
        state, random, quirks = self.state, self._randoms[row], self.settings.quirks
        state.boot_s[row] = now_s
        loss = random.uniform(*CLOCK_LOSS)
        state.clock_rate[row] = 1.0 - (loss if quirks.slow_clock else 0.0)
        ready_s = random.uniform(*READY_AFTER_S)
        state.ready_at_s[row] = now_s + (ready_s if quirks.late_ready else READY_AT_ONCE_S)
        state.fix_at_s[row] = state.ready_at_s[row] - (FIX_BEFORE_READY_S if quirks.late_ready else 0.0)
        self._schedule.start(row, now_s, random)

    def _sense(self) -> Sensors:
        """Every vehicle's estimate; its local origin is its first one (item 1)."""
        state = self.state
        estimate_m = self.bodies.position_m + self._error.position_m + state.offset_m
        frozen_m = state.frozen_m
        estimate_m = np.where(np.isnan(frozen_m), estimate_m, frozen_m)
        if self._lost:
            unknown = np.isnan(self._local_origin_m[:, 0])
            fresh = (self.time_s >= state.fix_at_s) & unknown
            own = self.settings.quirks.own_origin
            self._local_origin_m[fresh] = estimate_m[fresh] if own else 0.0
            self._lost = bool((unknown & ~fresh).any())
        return Sensors(
            position_m=estimate_m - self._local_origin_m,
            velocity_m_s=self.bodies.velocity_m_s + self._error.velocity_m_s,
            acceleration_m_s2=self.bodies.acceleration_m_s2,
            height_m=-self.bodies.position_m[:, 2],
            contact=self._contact,
            estimate_m=estimate_m,
            locate=self.geodetic,
        )

    def _set_home(self, row: int) -> None:
        """Set home to the present position: called when armed, or at the first fix."""
        state = self.state
        if self.time_s < state.fix_at_s[row]:
            return
        state.home_set[row] = True
        state.home_m[row] = self.sensors.position_m[row]
        state.home_place[row] = self.sensors.place(np.array([row]))[0]
        state.home_yaw_rad[row] = state.yaw_rad[row]
        state.home_boot_ms[row] = state.boot_ms(row)

    def _send_message(self, row: int, message: object, sent: dict[int, list[bytes]]) -> None:
        sequence = int(self.state.sequence[row])
        self.state.sequence[row] = (sequence + 1) % 256
        frame = self._codec.encode(message, int(self.state.system_id[row]), sequence)
        sent.setdefault(row, []).append(frame)

    def _report(self, message_id: int, rows: Rows, sent: dict[int, list[bytes]]) -> None:
        unix_s = self.time_s + self.unix_ahead_s
        snapshot = Snapshot(rows, unix_s, self.state, self.sensors, self._transitions, self._batteries)
        fields = reports.ALL[message_id](snapshot)
        sequence = self.state.sequence[rows]
        self.state.sequence[rows] = sequence + np.uint8(1)
        packed = frames.pack(message_id, fields, self.state.system_id[rows], sequence)
        for row, frame in zip(rows.tolist(), packed, strict=True):
            if row in sent:
                sent[row].append(frame)
            else:
                sent[row] = [frame]


def _grid_m(settings: Settings) -> Array:
    """(n, 3) start positions, NED."""
    indices = range(settings.first, settings.first + settings.count)
    cells = np.array([(*divmod(i, settings.grid_columns), 0.0) for i in indices], dtype=np.float64)
    turn_rad = math.radians(settings.grid_heading_deg)
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    place_m: Array = settings.spacing_m * cells @ turn + np.array([*settings.grid_at_m, 0.0])
    return place_m
