"""Columns that ArduCopter has beside those of `sim.vehicle.state`; row i of every array is vehicle i."""

import numpy as np

from gcs.sim.autopilots.ardupilot.modes import Mode, Phase, Submode
from gcs.sim.vehicle.dynamics import Mask
from gcs.sim.vehicle.state import Numbers, State


class ArduState(State):
    """Columns of n vehicles that have just booted, on the ground, disarmed, in STABILIZE.

    `mode` holds custom_mode. Positions are local NED, from the vehicle's own EKF origin.
    """

    def __init__(self, count: int, yaw_rad: float) -> None:
        super().__init__(count, yaw_rad)
        self.hdop[:], self.vdop[:] = 1.21, 2.0  # recorded
        self.mode[:] = self.intended[:] = self.after_disarming[:] = Mode.STABILIZE
        self._fly(count)
        self._watch(count)

    def _fly(self, count: int) -> None:
        self.submode: Numbers = np.full(count, int(Submode.HOVER))
        self.flown_as: Numbers = np.full(count, -1)  # mode and submode of the last step; -1: not in flight
        self.goal_m = np.zeros((count, 3))  # of POSITION, TAKEOFF and a return
        self.limit_m_s2 = np.ones((count, 2))  # acceleration, horizontal and vertical, of the present mode
        self.jerk_m_s3 = np.full(count, np.inf)  # vertical, of the present mode
        self.phase: Numbers = np.full(count, int(Phase.CLIMB))
        self.phase_s = np.full(count, -np.inf)  # when it began
        self.sink_after_s = np.full(count, -np.inf)  # LAND of a failsafe waits before it descends
        self.lift_at_s = np.full(count, np.inf)  # the motors have spooled up for a take-off
        self.aligned_at_s = np.full(count, np.inf)  # when the yaw is aligned in flight
        self.goal_yaw_rad = np.full(count, np.nan)  # of CONDITION_YAW
        self.desired_yaw_rad = self.yaw_rad.copy()  # of GUIDED, on the way to a goal
        self.yaw_rate_rad_s = np.zeros(count)

    def _watch(self, count: int) -> None:
        self.odid_reasons = [""] * count  # why the transponder of Remote ID forbids arming
        self.dead = _no(count)  # the process has ended
        self.old_frames = ~_no(count)  # it speaks MAVLink 1 until it has received MAVLink 2
        self.boot_stage: Numbers = np.zeros(count, dtype=np.int64)  # texts of the start that were sent
        self.prearm_ok = _no(count)
        self.check_at_s = np.full(count, -np.inf)  # next check before arming
        self.reasons_at_s = np.full(count, np.inf)  # next texts about it
        self.position_ok = _no(count)
        self.gps_ok = ~_no(count)
        self.gps_since_s = np.full(count, -np.inf)  # when gps_ok changed
        self.radio_lost_s = np.full(count, np.inf)
        self.station_failsafe = _no(count)
        self.radio_failsafe = _no(count)
        self.battery_failsafe = _no(count)  # until reboot
        self.ekf_failsafe = _no(count)
        self.weak_since_s = np.full((count, 2), np.inf)  # voltage below BATT_LOW_VOLT, BATT_CRT_VOLT
        self.acted_on: Numbers = np.zeros(count, dtype=np.int64)  # levels of the battery
        self.breach: Numbers = np.zeros(count, dtype=np.int64)  # bits of FENCE_TYPE
        self.breach_count: Numbers = np.zeros(count, dtype=np.int64)
        self.breach_s = np.full(count, -np.inf)
        self.commanded_s = np.full(count, -np.inf)  # the last mode by command

    @property
    def any_failsafe(self) -> Mask:
        """(n,): MAV_STATE_CRITICAL (habit 1)."""
        either: Mask = self.station_failsafe | self.radio_failsafe
        return either | self.battery_failsafe | self.ekf_failsafe


def _no(count: int) -> Mask:
    return np.zeros(count, dtype=np.bool_)
