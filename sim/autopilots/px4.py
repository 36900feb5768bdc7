"""PX4 as the firmware of a fleet: its modules are in sim.vehicle and sim.protocol."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common

from gcs.sim.autopilots.firmware import Disturbance, Sent, Services
from gcs.sim.protocol import fences, reports
from gcs.sim.protocol.autopilot import Autopilot, Shared
from gcs.sim.protocol.frames import Fields
from gcs.sim.protocol.reports import Snapshot
from gcs.sim.protocol.setpoints import store_setpoints
from gcs.sim.protocol.streams import Schedule
from gcs.sim.settings import Settings
from gcs.sim.vehicle import versions
from gcs.sim.vehicle.dynamics import Array, Mask, PointMasses, Response
from gcs.sim.vehicle.estimator import Estimator
from gcs.sim.vehicle.geofence import Geofence
from gcs.sim.vehicle.guidance import Guidance
from gcs.sim.vehicle.parameters import Columns
from gcs.sim.vehicle.px4 import Parameters
from gcs.sim.vehicle.sensors import SIH_RECEIVER, Batteries, Sensors
from gcs.sim.vehicle.state import Numbers, Rows, State
from gcs.sim.vehicle.transitions import Transitions

READY_AFTER_S = (4.0, 6.0)  # item 2
READY_AT_ONCE_S = 0.1
FIX_BEFORE_READY_S = 1.0
MISSION_CURRENT = common.MAVLINK_MSG_ID_MISSION_CURRENT
CLOCK_LOSS = (0.01, 0.02)  # item 12: the boot clock is slower than the wall clock


class Px4:
    """See `Firmware`."""

    forms: Mapping[int, Any] = common.mavlink_map
    any_component = False
    receiver = SIH_RECEIVER

    def __init__(self, settings: Settings, position_m: Array, step_s: float, services: Services) -> None:
        """See `Firmware`. Raises: ParameterError, VersionError."""
        self._quirks = settings.quirks
        version = versions.find("px4", settings.version, as_delivered=settings.as_delivered)
        drag_per_s = Response().drag_per_s if settings.drag_per_s is None else settings.drag_per_s
        self.bodies = PointMasses(position_m, step_s, Response(drag_per_s=drag_per_s))
        self.state = State(settings.count, math.remainder(math.radians(settings.heading_deg), math.tau))
        self.schedule = Schedule(settings.count, settings.rates_hz, together=settings.together)
        shared = Shared(
            self.state,
            self.schedule,
            services.outbox,
            settings.quirks,
            version,
            services.set_home,
            services.reboot,
            self._place,
        )
        self._transfers = shared.transfers
        self._sensors: Sensors | None = None  # of the newest step
        self.autopilots = [
            Autopilot(
                shared,
                row,
                Parameters(
                    {**settings.parameters_of(index), "MAV_SYS_ID": settings.system_id(index)},
                    version.parameters,
                ),
            )
            for row, index in enumerate(settings.indices)
        ]
        parameters = Columns([autopilot.parameters for autopilot in self.autopilots])
        commanders = [autopilot.commander for autopilot in self.autopilots]
        self._batteries = Batteries(self.state, parameters, settings.endurance_s)
        self._transitions = Transitions(self.state, commanders, parameters, settings.quirks)
        self._guidance = Guidance(self.state, commanders, parameters, settings.quirks)
        self._estimator = Estimator(self.state, resets=settings.quirks.estimator_resets)
        areas = [each.fences for each in self.autopilots]
        self._geofence = Geofence(self.state, commanders, parameters, areas)
        if version.release >= fences.SINCE_ALL:
            self.forms = {**self.forms, MISSION_CURRENT: reports.MissionCurrent}

    def boot(self, row: int, now_s: float, random: np.random.Generator) -> None:
        """Ready after some seconds, by the vehicle's own random numbers; the clock is slow."""
        state, quirks = self.state, self._quirks
        loss = random.uniform(*CLOCK_LOSS)
        state.clock_rate[row] = 1.0 - (loss if quirks.slow_clock else 0.0)
        ready_s = random.uniform(*READY_AFTER_S)
        state.ready_at_s[row] = now_s + (ready_s if quirks.late_ready else READY_AT_ONCE_S)
        state.fix_at_s[row] = state.ready_at_s[row] - (FIX_BEFORE_READY_S if quirks.late_ready else 0.0)
        self.start_streams(row, now_s, random)
        self._estimator.boot(row, random)

    def start_streams(self, row: int, now_s: float, random: np.random.Generator) -> None:
        """All of PX4's streams, each at a random phase."""
        self.schedule.start(row, now_s, random)

    def step(self, sensors: Sensors, awake: Mask, disturbance: Disturbance, step_s: float) -> None:
        """See `Firmware`."""
        state, self._sensors = self.state, sensors
        for each in list(self._transfers):
            each.pass_time(state.now_s)
        self._geofence.update(sensors, awake)
        state.position_lost = self._estimator.update(sensors.height_m, step_s)
        demand_m_s = self._guidance.velocity(sensors, awake, step_s)
        self._transitions.update(awake, sensors.contact, -demand_m_s[:, 2], self._batteries)
        powered = state.powered
        self._guidance.turn(powered, step_s)
        self._batteries.drain(powered, step_s)
        state.demanded_m_s = demand_m_s
        self.bodies.step(
            demand_m_s,
            wind_m_s=disturbance.wind_m_s,
            velocity_error_m_s=disturbance.velocity_error_m_s,
            powered=powered,
        )

    def _fence_ids(self, rows: Rows) -> Numbers:
        return np.array([self.autopilots[row].fences.identity for row in rows.tolist()], dtype=np.int64)

    def _place(self, row: int) -> tuple[float, float]:
        if self._sensors is None:
            return math.nan, math.nan
        latitude_deg, longitude_deg, _ = self._sensors.place(np.array([row]))[0].tolist()
        return latitude_deg, longitude_deg

    def report(self, message_id: int, rows: Rows, unix_s: float, sensors: Sensors) -> Fields:
        """See `Firmware`."""
        parts = self._transitions, self._batteries, self._fence_ids
        snapshot = Snapshot(rows, unix_s, self.state, sensors, *parts)
        return reports.ALL[message_id](snapshot)

    def sending(self, message_id: int, rows: Rows) -> Rows:
        """Messages about the position are sent once there is one."""
        return rows if message_id in reports.ALWAYS else rows[self.state.home_set[rows]]

    def store_setpoints(self, rows: Rows, messages: NDArray[np.void], _senders: NDArray[np.uint8]) -> None:
        """Take them from any sender, and report those that command nothing."""
        for invalid in store_setpoints(self.state, rows, messages):
            self.autopilots[invalid].report_invalid()

    def framed(self, sent: Sent) -> Sent:
        """MAVLink 2 from the first frame on."""
        return sent
