"""What vehicles with ArduCopter do by themselves, for a whole fleet: start, landing, and their failsafes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs.sim.autopilots.ardupilot.commander import CRITICAL, INFO, WARNING, Commander
from gcs.sim.autopilots.ardupilot.fence import Fence
from gcs.sim.autopilots.ardupilot.modes import (
    GUIDED,
    HOVER,
    LAND,
    NEEDS_POSITION,
    RETURNS,
    TAKEOFF,
    Mode,
    Phase,
)
from gcs.sim.autopilots.ardupilot.power import LEVELS, Batteries
from gcs.sim.autopilots.ardupilot.prearm import NOT_ARMABLE, RADIO_LOST_AFTER_S
from gcs.sim.autopilots.ardupilot.state import ArduState
from gcs.sim.autopilots.ardupilot.texts import breach_text
from gcs.sim.vehicle.commander import LandedState
from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.parameters import Columns
from gcs.sim.vehicle.sensors import Sensors
from gcs.sim.vehicle.state import FIX_3D, Numbers

INERTIA_S, BLIND_S = 7.9, 8.15  # habit 55: without GPS, until the position is given up, and until it lands
GPS_BACK_S, GPS_BACK_ON_GROUND_S = 10.0, 1.0
LANDED_AFTER_S = 1.9  # on the ground with a descent demanded
LAND_DISARMS_AFTER_S = 0.15  # habit 28: recorded 2.1 s after the touch
PILOT_HAS_S = 10.0  # habit 53: after a command outside the fence
CHECK_S, REASONS_S = 1.0, 30.0  # habit 21
FIRST_CHECK_S, FIRST_REASONS_S = 0.54, 17.5  # recorded

RTL, SMART_RTL = Mode.RTL, Mode.SMART_RTL
OF_STATION: Mapping[int, Mode] = {1: RTL, 2: RTL, 3: SMART_RTL, 4: SMART_RTL, 5: Mode.LAND}
"""By FS_GCS_ENABLE."""
OF_BATTERY: Mapping[int, Mode] = {1: Mode.LAND, 2: RTL, 3: SMART_RTL, 4: SMART_RTL}
"""By BATT_FS_LOW_ACT and BATT_FS_CRT_ACT."""
OF_RADIO: Mapping[int, Mode] = {1: RTL, 2: RTL, 3: Mode.LAND, 4: SMART_RTL, 5: SMART_RTL}
"""By FS_THR_ENABLE."""
OF_FENCE: Mapping[int, Mode] = {1: RTL, 2: Mode.LAND, 3: SMART_RTL, 4: Mode.BRAKE, 5: SMART_RTL}
"""By FENCE_ACTION; 0 reports only."""

NOTICE = 5  # MAV_SEVERITY
TELLS_MODE, TELLS_GLITCH = (4, 1), (4, 3)
"""Releases from which on these texts are sent."""
BOTH = ("IMU0", "IMU1")
START: Sequence[tuple[float, tuple[str, ...]]] = (
    (1.76, ("Barometer 1 calibration complete",)),
    (2.74, ()),
    (2.83, ("SaveWaypoint LOW",)),
    (4.04, tuple(f"EKF2 {unit} initial yaw alignment complete" for unit in BOTH)),
    (5.11, tuple(f"EKF2 {unit} tilt alignment complete" for unit in BOTH)),
    (8.84, ("GPS 1: detected as u-blox at 230400 baud",)),
)
"""Texts by the time after the start (habit 19)."""
INITIALISED = 1
"""The stage in which a mode that was commanded before is forgotten: recorded."""
ORIGIN_SET = tuple(f"EKF2 {unit} origin set" for unit in BOTH)
USES_GPS = tuple(f"EKF2 {unit} is using GPS" for unit in BOTH)
ALIGNED = tuple(f"EKF2 {unit} in-flight yaw alignment complete" for unit in BOTH)
POSITION_LOST = (
    (WARNING, "EKF2 IMU0 emergency yaw reset"),
    (CRITICAL, "NavEKF2: lane switch 1"),
    (WARNING, "EKF primary changed:1"),
    (CRITICAL, "EKF variance"),
)


@dataclass(eq=False)
class Transitions:
    """Advances the commanders of a fleet."""

    state: ArduState
    commanders: Sequence[Commander]
    parameters: Columns
    batteries: Batteries
    fence: Fence
    release: tuple[int, int]

    def update(self, sensors: Sensors, awake: Mask, descends: Mask) -> None:
        """Execute the transitions that are due at the state's time.

        Args:
            sensors: of this step.
            awake: (n,), vehicles with a position.
            descends: (n,), where the flown mode demands a descent.
        """
        self._start_up()
        self._watch_position()
        self._watch_radio()
        self._watch_station()
        self._watch_battery()
        if (self.parameters["FENCE_ENABLE"] > 0).any():
            self._watch_fence(sensors, awake)
        self._watch_ground(sensors.contact, descends)
        self._check_arming()

    def landed_state(self) -> Numbers:
        """(n,): MAV_LANDED_STATE. A vehicle that was killed in the air is ON_GROUND at once (habit 56)."""
        state = self.state
        landing = (state.mode == LAND) | (RETURNS[state.mode] & (state.phase == Phase.LAND))
        seen = np.where(landing, int(LandedState.LANDING), int(LandedState.IN_AIR))
        climbing = (state.mode == GUIDED) & (state.submode == TAKEOFF)
        grounded = (state.landed & ~climbing) | ~state.armed
        seen[climbing] = LandedState.TAKEOFF
        seen[grounded] = LandedState.ON_GROUND
        return seen

    def _rows(self, due: Mask) -> list[int]:
        rows: list[int] = (due & ~self.state.dead).nonzero()[0].tolist()
        return rows

    def _start_up(self) -> None:
        """Texts of the start: by the clock, then of the origin, then of the position."""
        state = self.state
        starting = state.boot_stage < len(START) + 2
        for row in self._rows(starting) if starting.any() else ():
            stage = int(state.boot_stage[row])
            due_s, texts = self._start_stage(row, stage)
            if state.now_s < due_s:
                continue
            state.boot_stage[row] += 1
            if stage == INITIALISED and state.now_s < state.ready_at_s[row]:
                self.commanders[row].fly(Mode.STABILIZE)
            for text in texts:
                self.commanders[row].send_text(INFO, text)
        aligned = state.now_s >= state.aligned_at_s
        if aligned.any():
            state.aligned_at_s[aligned] = np.inf
            for row in self._rows(aligned & state.powered):
                for text in ALIGNED:
                    self.commanders[row].send_text(INFO, text)

    def _start_stage(self, row: int, stage: int) -> tuple[float, Sequence[str]]:
        """When a stage of the start is over, and its texts."""
        if stage < len(START):
            due_s = float(self.state.boot_s[row]) + START[stage][0]
            return min(due_s, float(self.state.ready_at_s[row])), START[stage][1]
        if stage == len(START):
            return float(self.state.fix_at_s[row]), ORIGIN_SET
        return float(self.state.ready_at_s[row]), USES_GPS

    def _watch_position(self) -> None:
        """The position survives the loss of GPS for 8.2 s on inertia (habit 55)."""
        state = self.state
        gps_ok = (self.parameters["SIM_GPS_DISABLE"] == 0) & (state.fix_type >= FIX_3D)
        if self.release >= TELLS_GLITCH:
            for row in self._rows(state.gps_ok & ~gps_ok & state.powered):
                self.commanders[row].send_text(CRITICAL, "GPS Glitch or Compass error")
        state.gps_since_s = np.where(gps_ok == state.gps_ok, state.gps_since_s, state.now_s)
        state.gps_ok = gps_ok
        since_s, before = state.now_s - state.gps_since_s, state.position_ok
        back_s = np.where(state.landed, GPS_BACK_ON_GROUND_S, GPS_BACK_S)
        position_ok = np.where(gps_ok, before | (since_s >= back_s), before & (since_s < INERTIA_S))
        state.position_ok = position_ok & (state.now_s >= state.ready_at_s)
        state.ekf_failsafe = state.ekf_failsafe & ~gps_ok
        lost = ~gps_ok & (since_s >= BLIND_S) & ~state.ekf_failsafe
        lost &= state.powered & NEEDS_POSITION[state.mode] & (self.parameters["FS_EKF_ACTION"] > 0)
        for row in self._rows(lost):
            state.ekf_failsafe[row] = True
            for severity, text in POSITION_LOST:
                self.commanders[row].send_text(severity, text)
            self.commanders[row].fail_safe(Mode.LAND)
            if self.release >= TELLS_MODE:
                self.commanders[row].send_text(CRITICAL, "EKF Failsafe: changed to LAND Mode")

    def _watch_radio(self) -> None:
        """FS_THR_ENABLE 0 while the failsafe stands leaves it standing (habit 54)."""
        state, p = self.state, self.parameters
        low = p["FS_THR_VALUE"] > p["RC3_MIN"]  # the stick itself is below the threshold
        gone = (p["SIM_RC_FAIL"] > 0) | low
        state.radio_lost_s = np.where(gone, np.minimum(state.radio_lost_s, state.now_s), np.inf)
        enabled = p["FS_THR_ENABLE"] > 0
        late = state.now_s - state.radio_lost_s >= RADIO_LOST_AFTER_S
        for row in self._rows(enabled & late & ~state.radio_failsafe):
            state.radio_failsafe[row] = True
            commander = self.commanders[row]
            text = "Radio Failsafe - Disarming" if state.landed[row] else "Radio Failsafe"
            commander.send_text(WARNING, text)
            commander.fail_safe(OF_RADIO.get(int(p["FS_THR_ENABLE"][row])))
        for row in self._rows(enabled & ~gone & state.radio_failsafe):
            state.radio_failsafe[row] = False
            self.commanders[row].send_text(WARNING, "Radio Failsafe Cleared")

    def _watch_station(self) -> None:
        """Only heartbeats of SYSID_MYGCS count, and setpoints do not (habit 51)."""
        state, action = self.state, self.parameters["FS_GCS_ENABLE"]
        silent_s = state.now_s - state.station_s
        lost = (silent_s > self.parameters["FS_GCS_TIMEOUT"]) & (state.station_s > -np.inf)
        for row in self._rows((action > 0) & lost & state.armed & ~state.station_failsafe):
            state.station_failsafe[row] = True
            self.commanders[row].send_text(WARNING, "GCS Failsafe")
            self.commanders[row].fail_safe(OF_STATION.get(int(action[row])))
        for row in self._rows(state.station_failsafe & ((action == 0) | ~lost)):
            state.station_failsafe[row] = False
            self.commanders[row].send_text(WARNING, "GCS Failsafe Cleared")

    def _watch_battery(self) -> None:
        """Each level acts once, and only where its action is set (habit 52)."""
        state = self.state
        level = self.batteries.level(since_s=state.armed_s)
        for row in self._rows(state.armed & (level > state.acted_on)):
            state.acted_on[row] = level[row]
            action = int(self.parameters[LEVELS[int(level[row]) - 1][1]][row])
            if action not in OF_BATTERY:
                continue
            state.battery_failsafe[row] = True
            commander = self.commanders[row]
            commander.send_text(WARNING, self.batteries.sagging(row))
            commander.send_text(WARNING, "Battery Failsafe")
            commander.fail_safe(OF_BATTERY[action])

    def _watch_fence(self, sensors: Sensors, awake: Mask) -> None:
        """A breach acts once, and again where a command keeps it outside (habit 53)."""
        state = self.state
        self.fence.look(sensors, awake, state.now_s)
        from_home_m = np.where(awake[:, np.newaxis], sensors.position_m - state.home_m, 0.0)
        breach = np.where(awake & state.home_set, self.fence.breach(from_home_m), 0)
        fresh = (breach & ~state.breach) > 0
        commanded_s = state.now_s - state.commanded_s
        again = (breach > 0) & (commanded_s >= PILOT_HAS_S) & (state.commanded_s > state.breach_s)
        state.breach = breach
        for row in self._rows((fresh | again) & state.powered):
            state.breach_count[row] += 1
            state.breach_s[row] = state.now_s
            text = breach_text(self.release, int(breach[row]))
            if text is not None:
                self.commanders[row].send_text(NOTICE, text)
            mode = OF_FENCE.get(int(self.parameters["FENCE_ACTION"][row]))
            if mode is not None and commanded_s[row] >= (0.0 if fresh[row] else PILOT_HAS_S):
                self.commanders[row].fail_safe(mode)

    def _watch_ground(self, contact: Mask, descends: Mask) -> None:
        """Lift off, touch down, and disarm: at once in LAND and RTL, else after DISARM_DELAY."""
        state = self.state
        lifting = state.armed & state.landed & (state.now_s >= state.lift_at_s)
        for row in self._rows(lifting):
            state.landed[row], state.flown[row] = False, True
            state.lift_at_s[row] = np.inf
            state.airborne_since_s[row] = state.now_s
        down = contact & ~state.landed & (descends | ~state.armed) & ~lifting
        state.down_since_s = np.where(down, np.minimum(state.down_since_s, state.now_s), np.inf)
        wait_s = np.where(state.armed, LANDED_AFTER_S, 0.0)
        touching = down & (state.now_s - state.down_since_s >= wait_s)
        state.landed[touching], state.landed_s[touching] = True, state.now_s
        state.submode[touching] = HOVER
        landing = (state.mode == LAND) | RETURNS[state.mode]
        delay_s = self.parameters["DISARM_DELAY"]
        since_s = state.now_s - np.maximum(state.armed_s, state.landed_s)
        idle = state.armed & state.landed & (state.lift_at_s == np.inf)
        at_once = landing & state.flown & (since_s >= LAND_DISARMS_AFTER_S)
        for row in self._rows(idle & (at_once | ((delay_s > 0.0) & (since_s >= delay_s)))):
            state.flown[row] = False
            self.commanders[row].stop()

    def _check_arming(self) -> None:
        """Once a second; the reasons are sent only every 30 s (habit 21)."""
        state = self.state
        due = state.now_s >= state.check_at_s
        if not due.any():
            return
        state.check_at_s[due] += CHECK_S
        speaks = due & (state.now_s >= state.reasons_at_s)
        periods = np.floor((state.now_s - state.reasons_at_s[speaks]) / REASONS_S) + 1.0
        state.reasons_at_s[speaks] += REASONS_S * periods
        for row in self._rows(due):
            if state.armed[row]:
                state.prearm_ok[row] = True
                continue
            reasons = self.commanders[row].reasons()
            state.prearm_ok[row] = not set(reasons) - {NOT_ARMABLE}
            if speaks[row]:
                self.commanders[row].send_reasons([text for text in reasons if text != NOT_ARMABLE])


def descends(demand_m_s: Array) -> Mask:
    """(n,): where a demand (n, 3), NED, is a descent: hovering on the ground is not a landing."""
    down: Mask = demand_m_s[:, 2] > 0.0
    return down
