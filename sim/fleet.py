"""The vehicles of one process: bodies, estimates and autopilots under one clock. Sans-I/O."""

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from gcs.sim.autopilots.ardupilot.firmware import ArduCopter
from gcs.sim.autopilots.firmware import Bodies, Disturbance, Firmware, Sent, Services
from gcs.sim.autopilots.px4 import Px4
from gcs.sim.protocol import frames
from gcs.sim.protocol.frames import Codec
from gcs.sim.protocol.receiver import Receiver
from gcs.sim.protocol.streams import Outbox
from gcs.sim.settings import Autopilot, Settings
from gcs.sim.vehicle import sensors as measured
from gcs.sim.vehicle.dynamics import Array
from gcs.sim.vehicle.sensors import Sensors, Tangent
from gcs.sim.vehicle.state import Rows

STEP_S = 0.01

FIRMWARES: Mapping[Autopilot, type[Firmware]] = MappingProxyType({"px4": Px4, "ardupilot": ArduCopter})
"""By `Settings.autopilot`; a mixed fleet consists of one fleet of each (sim.mixed)."""


class Fleet:
    """Steps vehicles with the same kind of autopilot; the arrays' row i belongs to autopilots[i]."""

    def __init__(
        self, settings: Settings, *, start_s: float, unix_at_start_s: float = 0.0, step_s: float = STEP_S
    ) -> None:
        """Place the vehicles on their grid and boot them at start_s; step_s as in `dynamics.step`.

        Every autopilot has a random stream of its own, by its index. The estimate errors are drawn together,
        by seed and first index, so that processes that share a seed differ.

        Raises: ParameterError for a parameter or value that the autopilot does not accept.
        """
        if settings.ideal:
            exact = replace(settings.quirks, estimator_resets=False, height_scale=False)
            settings = replace(settings, quirks=exact)
        self.settings = settings
        self.time_s = start_s
        self.step_s = step_s
        self._start_s, self._steps = start_s, 0
        self.unix_ahead_s = unix_at_start_s - start_s  # of time_s; grows where time is dropped
        self.wind_m_s = np.tile(np.array(settings.wind_m_s, dtype=np.float64), (settings.count, 1))
        origin = settings.origin
        self.geodetic = Tangent(origin.latitude_deg, origin.longitude_deg, origin.altitude_amsl_m).geodetic
        count, indices = settings.count, settings.indices
        self._outbox, self._codec = Outbox(), Codec()
        services = Services(self._outbox, self._set_home, self.reboot)
        self._firmware = FIRMWARES[settings.autopilot](settings, _grid_m(settings), step_s, services)
        self._random = np.random.default_rng(
            np.random.SeedSequence(settings.seed, spawn_key=(settings.first, 1))
        )
        self.sensed_by = measured.IDEAL_RECEIVER if settings.ideal else self._firmware.receiver
        self._error_scale = settings.noise_scale * self.sensed_by.errors
        self._error = measured.draw_errors(count, self._error_scale, self._random)
        self._receiver_random = np.random.default_rng(
            np.random.SeedSequence(settings.seed, spawn_key=(settings.first, 2))
        )
        self._receiver_error = measured.draw_errors(count, self._error_scale, self._receiver_random)
        self._randoms = [
            np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=(i,))) for i in indices
        ]
        self.state = self._firmware.state
        self.state.now_s = start_s
        self.state.horizontal_accuracy_m[:] = self.sensed_by.horizontal_m
        self.state.vertical_accuracy_m[:] = self.sensed_by.vertical_m
        self.state.fix_type[:] = self.sensed_by.fix_type
        self._scale = np.column_stack([np.ones((count, 2)), self.state.height_scale])
        self.state.system_id[:] = [settings.system_id(i) for i in indices]
        self._schedule = self._firmware.schedule
        self.autopilots = self._firmware.autopilots
        for autopilot in self.autopilots if settings.transponders else ():
            autopilot.fit_transponder()
        self.receiver = Receiver(
            self.state,
            self.autopilots,
            self._firmware.store_setpoints,
            any_component=self._firmware.any_component,
        )
        self._local_origin_m = np.full((count, 3), np.nan)
        self._lost = True  # at least one vehicle has no local origin yet
        self._contact = np.ones(count, dtype=np.bool_)
        for row in range(count):
            self._boot(row, start_s)
        self.sensors = self._sense()
        self._reported_now: Sensors | None = None

    @property
    def bodies(self) -> Bodies:
        """True positions and velocities, in the fleet's common NED."""
        return self._firmware.bodies

    @property
    def position_m(self) -> Array:
        """(n, 3) true positions, in the fleet's common NED."""
        return self.bodies.position_m

    @property
    def velocity_m_s(self) -> Array:
        """(n, 3) true velocities."""
        return self.bodies.velocity_m_s

    def part_of(self, row: int) -> tuple["Fleet", int]:
        """The fleet of vehicles with one kind of autopilot that has this row, and its row there."""
        return self, row

    def skip(self, skipped_s: float) -> None:
        """Let the time of satellites pass, in which the vehicles were not stepped."""
        self.unix_ahead_s += skipped_s

    def step(self) -> None:
        step_s = self.step_s
        self._steps += 1
        self.time_s = self.state.now_s = self._start_s + self._steps * step_s
        if self._error_scale > 0.0:
            self._error = measured.step_errors(self._error, step_s, self._error_scale, self._random)
            self._receiver_error = measured.step_errors(
                self._receiver_error, step_s, self._error_scale, self._receiver_random
            )
        state, sensors = self.state, self._sense()
        self.sensors = sensors
        awake = self.time_s >= state.fix_at_s
        for row in (awake & ~state.home_set).nonzero()[0].tolist():
            self._set_home(row)
        disturbance = Disturbance(self.wind_m_s, self._error.velocity_m_s + state.drift_m_s)
        self._firmware.step(sensors, awake, disturbance, step_s)
        self._contact = self.bodies.rest_on_ground()
        if self.settings.transponders:
            self._run_transponders()

    def _run_transponders(self) -> None:
        """Have the transponders of autopilots that run send what is due."""
        for row in np.flatnonzero(self.time_s >= self.state.boot_s).tolist():
            self.autopilots[row].run_transponder()

    def take_frames(self, *, streams: bool = True) -> Sent:
        """Frames that each vehicle (by row) sends now: answers and texts, and with `streams` the streams."""
        sent: Sent = {}
        self._reported_now = None
        for row, item in self._outbox.take(self.time_s):
            if isinstance(item, int):
                self._report(item, np.array([row]), sent)
            else:
                self._send_message(row, item, sent)
        if streams:
            for row, name in self._outbox.take_parameters():
                self._send_message(row, self.autopilots[row].parameter(name), sent)
            for message_id, rows in self._schedule.due(self.time_s):
                sending = self._firmware.sending(message_id, rows)
                if len(sending):
                    self._report(message_id, sending, sent)
        return self._firmware.framed(sent)

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
        self._firmware.start_streams(row, self.time_s + off_s, self._randoms[row])

    def _boot(self, row: int, now_s: float) -> None:
        self.state.boot_s[row] = now_s
        self._firmware.boot(row, now_s, self._randoms[row])

    def _sense(self) -> Sensors:
        """Every vehicle's estimate; its local origin is its first one (item 1)."""
        state = self.state
        estimate_m = self._scale * self.bodies.position_m + self._error.position_m
        estimate_m += state.offset_m + state.drift_m
        estimate_m[:, 2] -= state.barometer_m
        received_m = self.bodies.position_m + self._receiver_error.position_m + state.offset_m
        frozen = ~np.isnan(state.frozen_m)
        if np.count_nonzero(frozen):
            estimate_m[frozen] = received_m[frozen] = state.frozen_m[frozen]
        if self._lost:
            unknown = np.isnan(self._local_origin_m[:, 0])
            fresh = (self.time_s >= state.fix_at_s) & unknown
            own = self.settings.quirks.own_origin
            self._local_origin_m[fresh] = estimate_m[fresh] if own else 0.0
            self._lost = bool((unknown & ~fresh).any())
        return Sensors(
            position_m=estimate_m - self._local_origin_m,
            velocity_m_s=self._scale * self.bodies.velocity_m_s + self._error.velocity_m_s + state.drift_m_s,
            acceleration_m_s2=self.bodies.acceleration_m_s2,
            height_m=-self.bodies.position_m[:, 2],
            contact=self._contact,
            estimate_m=estimate_m,
            received_m=received_m,
            locate=self.geodetic,
        )

    def _reported(self) -> Sensors:
        """What messages say of the estimates, once for all of one call of `take_frames`."""
        self._reported_now = self._reported_now or self._with_faults()
        return self._reported_now

    def _with_faults(self) -> Sensors:
        """The estimates, but for faults of the reports alone."""
        state, sensors = self.state, self.sensors
        repeats = ~np.isnan(state.repeated_m[:, 0])
        if not np.count_nonzero(repeats | (state.velocity_times != 1.0)):
            return sensors
        back_m = np.where(repeats[:, None], state.repeated_m - sensors.estimate_m, 0.0)
        velocity_m_s = np.where(repeats[:, None], state.repeated_m_s, sensors.velocity_m_s)
        return replace(
            sensors,
            position_m=sensors.position_m + back_m,
            velocity_m_s=state.velocity_times[:, None] * velocity_m_s,
            estimate_m=sensors.estimate_m + back_m,
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

    def _send_message(self, row: int, message: object, sent: Sent) -> None:
        sequence = int(self.state.sequence[row])
        self.state.sequence[row] = (sequence + 1) % 256
        frame = self._codec.encode(message, int(self.state.system_id[row]), sequence)
        sent.setdefault(row, []).append(frame)

    def _report(self, message_id: int, rows: Rows, sent: Sent) -> None:
        unix_s = self.time_s + self.unix_ahead_s
        fields = self._firmware.report(message_id, rows, unix_s, self._reported())
        sequence = self.state.sequence[rows]
        self.state.sequence[rows] = sequence + np.uint8(1)
        packed = frames.pack(self._firmware.forms[message_id], fields, self.state.system_id[rows], sequence)
        for row, frame in zip(rows.tolist(), packed, strict=True):
            if row in sent:
                sent[row].append(frame)
            else:
                sent[row] = [frame]


def _grid_m(settings: Settings) -> Array:
    """(n, 3) start positions, NED."""
    cells = np.array([(*divmod(i, settings.grid_columns), 0.0) for i in settings.indices], dtype=np.float64)
    turn_rad = math.radians(settings.grid_heading_deg)
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    place_m: Array = settings.spacing_m * cells @ turn + np.array([*settings.grid_at_m, 0.0])
    return place_m
