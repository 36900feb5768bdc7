"""ArduCopter as the firmware of a fleet: 4.1-dev as recorded, or another version."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.sim.autopilots.ardupilot import reports
from gcs.sim.autopilots.ardupilot.failsafes import FIRST_CHECK_S, FIRST_REASONS_S, Transitions, descends
from gcs.sim.autopilots.ardupilot.fence import Fence
from gcs.sim.autopilots.ardupilot.guidance import GUIDED_BY_WPNAV, Guidance
from gcs.sim.autopilots.ardupilot.modes import Mode
from gcs.sim.autopilots.ardupilot.parameters import Parameters
from gcs.sim.autopilots.ardupilot.power import Batteries
from gcs.sim.autopilots.ardupilot.protocol import HEARTBEAT, HOME, ORIGIN, ArduPilot, Shared
from gcs.sim.autopilots.ardupilot.reports import Snapshot
from gcs.sim.autopilots.ardupilot.response import Copters, Response
from gcs.sim.autopilots.ardupilot.setpoints import store_setpoints
from gcs.sim.autopilots.ardupilot.state import ArduState
from gcs.sim.autopilots.ardupilot.texts import Console
from gcs.sim.autopilots.firmware import Disturbance, Sent, Services
from gcs.sim.protocol.frames import Fields, as_version_1
from gcs.sim.protocol.streams import Schedule
from gcs.sim.settings import Settings
from gcs.sim.vehicle import versions
from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.parameters import Columns
from gcs.sim.vehicle.sensors import ARDUPILOT_RECEIVER, Sensors
from gcs.sim.vehicle.state import Rows

FIRST_HEARTBEAT_S = 1.05  # habit 1
ORIGIN_AFTER_S, READY_AFTER_S = 19.0, 39.5  # habit 19
READY_AT_ONCE_S = 0.1
HEIGHT_SCALE = 1.05
"""Reported over true height: 25.1 m of 23.9 m, flown with 4.0.7, all six alike, and 4.5.5."""
UNASKED_HZ = {HEARTBEAT: 1.0, 111: 0.1}
"""Habit 3: HEARTBEAT and TIMESYNC; SR0_* are 0."""
PARAMETERS_PER_S = 1400  # habit 8: 1131 in 0.8 s
GPS_FOUND_S = 8.8
"""GLOBAL_POSITION_INT and GPS_RAW_INT have something to say from then on."""
OF_GPS, OF_ORIGIN, OF_POSITION = (24, 33), (HOME, ORIGIN), (32,)
OF_FENCE, OF_GUIDED, NEVER = (162,), (85, 87), (168,)
"""Messages that need something: the GPS, the origin, the position, a fence, GUIDED; WIND was never seen."""


class ArduCopter:
    """See `Firmware`."""

    forms: Mapping[int, Any] = reports.FORMS
    any_component = True  # habit 10
    receiver = ARDUPILOT_RECEIVER

    def __init__(self, settings: Settings, position_m: Array, step_s: float, services: Services) -> None:
        """See `Firmware`. Raises: ParameterError, VersionError."""
        count, quirks = settings.count, settings.quirks
        version = versions.find("ardupilot", settings.version, as_delivered=settings.as_delivered)
        self._late_ready, self._services, self._version = quirks.late_ready, services, version
        services.outbox.burst = round(PARAMETERS_PER_S * step_s)
        response = Response()
        if settings.drag_per_s is not None:
            response = replace(response, drag_per_s=settings.drag_per_s)
        self.bodies = Copters(position_m, step_s, response)
        self.state = ArduState(count, math.remainder(math.radians(settings.heading_deg), math.tau))
        self.schedule = Schedule(count, UNASKED_HZ, reports.ALL)
        tables = [
            Parameters(
                {**settings.parameters_of(index), "SYSID_THISMAV": settings.system_id(index)},
                version.parameters,
            )
            for index in settings.indices
        ]
        self._parameters = Columns(tables)
        self._batteries = Batteries(self.state, self._parameters, settings.endurance_s)
        shared = Shared(
            self.state,
            self.schedule,
            services.outbox,
            self._batteries,
            version,
            self._newest_sensors,
            services.set_home,
            services.reboot,
        )
        self.autopilots = [ArduPilot(shared, row, own) for row, own in enumerate(tables)]
        self._transfers = shared.transfers
        fence = Fence(self._parameters, [each.fences for each in self.autopilots], version.release)
        commanders = [autopilot.commander for autopilot in self.autopilots]
        self._transitions = Transitions(
            self.state, commanders, self._parameters, self._batteries, fence, version.release
        )
        self._guidance = Guidance(self.state, self.bodies, self._parameters, fence, version.release)
        self._console = Console(version.software) if quirks.console_text else None
        self._clock_rate = settings.clock_rate
        self.state.height_scale[:] = HEIGHT_SCALE if quirks.height_scale else 1.0
        self._announced: Mask = np.zeros(count, dtype=np.bool_)
        self._sensors: Sensors

    def boot(self, row: int, now_s: float, random: np.random.Generator) -> None:
        """The origin is set after 19 s and the position known after 39.5 s, or at once without late-ready."""
        state, late = self.state, self._late_ready
        state.ready_at_s[row] = now_s + (READY_AFTER_S if late else READY_AT_ONCE_S)
        state.fix_at_s[row] = now_s + (ORIGIN_AFTER_S if late else 0.0)
        state.check_at_s[row] = now_s + (FIRST_CHECK_S if self._late_ready else 0.0)
        state.reasons_at_s[row] = now_s + FIRST_REASONS_S
        state.clock_rate[row] = self._clock_rate
        if self._console is not None:
            self._console.boot(row, now_s)
        self.start_streams(row, now_s, random)

    def start_streams(self, row: int, now_s: float, random: np.random.Generator) -> None:
        """HEARTBEAT and TIMESYNC; everything else only when requested."""
        self.schedule.start(row, now_s, random)
        self.schedule.set_interval(row, HEARTBEAT, 1.0, now_s + FIRST_HEARTBEAT_S)
        self.state.old_frames[row] = True

    def step(self, sensors: Sensors, awake: Mask, disturbance: Disturbance, step_s: float) -> None:
        """See `Firmware`."""
        state, self._sensors = self.state, sensors
        for each in list(self._transfers):
            each.pass_time(state.now_s)
        self._announce_origins()
        demand_m_s = self._guidance.velocity(sensors, awake)
        down = descends(demand_m_s)
        self._transitions.update(sensors, awake, down)
        powered = state.powered & ~state.dead
        self._guidance.turn(step_s)
        self._batteries.step(step_s)
        self.bodies.step(
            demand_m_s,
            state.limit_m_s2,
            np.nan_to_num(sensors.position_m),
            sensors.velocity_m_s,
            wind_m_s=disturbance.wind_m_s,
            resting=~powered | (sensors.contact & down),
            jerk_m_s3=state.jerk_m_s3 if self._version.release >= GUIDED_BY_WPNAV else None,
        )

    def report(self, message_id: int, rows: Rows, unix_s: float, sensors: Sensors) -> Fields:
        """See `Firmware`."""
        parts = (self._transitions, self._batteries, self.bodies, self._version)
        snapshot = Snapshot(rows, unix_s, self.state, sensors, self._parameters, *parts)
        return reports.ALL[message_id](snapshot)

    def sending(self, message_id: int, rows: Rows) -> Rows:
        """A stream is silent while there is nothing to say (habits 4, 19)."""
        state, has = self.state, np.ones(len(rows), dtype=np.bool_)
        if message_id in OF_GPS:
            has = state.now_s - state.boot_s[rows] >= (GPS_FOUND_S if self._late_ready else 0.0)
        elif message_id in OF_ORIGIN:
            has = state.home_set[rows]
        elif message_id in OF_POSITION:
            has = state.position_ok[rows]
        elif message_id in OF_GUIDED:
            has = (state.mode[rows] == Mode.GUIDED) & state.armed[rows]
        elif message_id in OF_FENCE:
            has = self._parameters["FENCE_ENABLE"][rows] > 0
        elif message_id in NEVER:
            has[:] = False
        return rows[has]

    def store_setpoints(self, rows: Rows, messages: NDArray[np.void], senders: NDArray[np.uint8]) -> None:
        """Take those from senders that the vehicles accept."""
        enforced = self._parameters["SYSID_ENFORCE"][rows] > 0
        taken = ~enforced | (self._parameters["SYSID_MYGCS"][rows] == senders)
        taken &= ~self.state.dead[rows]
        self.state.old_frames[rows[taken]] = False
        store_setpoints(self.state, rows[taken], messages[taken], np.nan_to_num(self._sensors.position_m))

    def framed(self, sent: Sent) -> Sent:
        """MAVLink 1 until MAVLink 2 has been received (habit 2); nothing from a dead process."""
        for row in [row for row in sent if self.state.dead[row]]:
            del sent[row]
        for row in [row for row in sent if self.state.old_frames[row]]:
            sent[row] = [old for frame in sent[row] if (old := as_version_1(frame, reports.OLD_FORMS))]
        if self._console is not None:
            self._console.put(sent, self.state.now_s)
        return sent

    def _newest_sensors(self) -> Sensors:
        return self._sensors

    def _announce_origins(self) -> None:
        """HOME_POSITION and GPS_GLOBAL_ORIGIN are sent once unasked, when the origin is set (habit 3)."""
        fresh = self.state.home_set & ~self._announced
        for row in fresh.nonzero()[0].tolist():
            self.autopilots[row].reply(ORIGIN)
            self.autopilots[row].reply(HOME)
        self._announced = self.state.home_set.copy()
