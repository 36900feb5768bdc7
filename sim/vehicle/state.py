"""What changes in the autopilots of a fleet, as columns: row i of every array is vehicle i.

One vehicle's transitions (sim.commander) and the fleet's conditions (sim.watch, sim.guidance) share it, so
that one vehicle and a thousand behave alike.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.sim.vehicle.modes import Mode

if TYPE_CHECKING:
    from gcs.sim.vehicle.dynamics import Array, Mask

Rows: TypeAlias = NDArray[np.intp]
Numbers: TypeAlias = NDArray[np.int64]

NO_MODE = -1
# What is not the autopilot's memory: the vehicle's number and battery, its receiver, the pilot.
LASTING = frozenset(
    {
        *("system_id", "remaining", "offset_m", "frozen_m", "hdop", "vdop"),
        *("horizontal_accuracy_m", "vertical_accuracy_m", "piloted", "stick_m_s"),
        *("fix_type", "unhealthy_sensors", "unix_ahead_s"),
    }
)
OK = 1  # MAV_BATTERY_CHARGE_STATE
FIX_3D = 3  # GPS_FIX_TYPE


class State:
    """Columns of n vehicles that have just booted, on the ground, disarmed, in HOLD.

    Times are the fleet's clock.
    """

    def __init__(self, count: int, yaw_rad: float) -> None:
        """Boot count vehicles that look along yaw_rad."""
        self.count = count
        self.now_s = 0.0
        self.system_id = np.zeros(count, dtype=np.uint8)
        self.sequence = np.zeros(count, dtype=np.uint8)  # of the next MAVLink frame

        self._boot(count)
        self._land(count)
        self._stand(count, yaw_rad)
        self._receive(count)

    def _boot(self, count: int) -> None:
        """Clocks."""
        self.boot_s = np.zeros(count)
        self.clock_rate = np.ones(count)
        self.clock_offset_s = np.zeros(count)  # what a jump of the boot clock adds to it
        self.ready_at_s = np.full(count, np.inf)
        self.fix_at_s = np.full(count, np.inf)

    def _land(self, count: int) -> None:
        """What the commander keeps."""
        self.mode: Numbers = np.full(count, Mode.HOLD.number)  # the one flown
        self.intended: Numbers = np.full(count, Mode.HOLD.number)  # the one asked for
        self.after_disarming: Numbers = np.full(count, Mode.HOLD.number)
        self.armed = _no(count)
        self.landed = ~_no(count)
        self.flown = _no(count)  # since it was armed
        self.failsafe = _no(count)  # for want of setpoints
        self.intervenes = _no(count)  # any other failsafe of its own flies it
        self.piloted = _no(count)  # somebody has the sticks
        self.setpoint_seen = _no(count)
        self.setpoint_s = np.full(count, -np.inf)
        self.station_s = np.full(count, -np.inf)  # when a ground station's heartbeat came last
        self.station_lost = _no(count)  # which has been acted on
        self.armed_s = np.full(count, -np.inf)
        self.airborne_since_s = np.full(count, -np.inf)
        self.climb_since_s = np.full(count, np.inf)
        self.down_since_s = np.full(count, np.inf)
        self.landed_s = np.full(count, -np.inf)
        self.takeoff_altitude_amsl_m = np.full(count, np.nan)  # NaN: MIS_TAKEOFF_ALT above home
        self.charge: Numbers = np.full(count, OK)  # the worst that was acted on
        self.remaining = np.ones(count)  # of the battery

    def _stand(self, count: int, yaw_rad: float) -> None:
        """What guidance keeps, and home."""
        self.guided_mode: Numbers = np.full(count, NO_MODE)  # whose target is kept
        self.target_m = np.zeros((count, 3))  # local NED
        self.last_m_s = np.zeros((count, 3))  # what the mode wanted last
        self.demanded_m_s = np.full((count, 3), np.nan)  # what POSITION_TARGET_LOCAL_NED tells
        self.stick_m_s = np.zeros((count, 3))  # what the pilot asks for
        self.returning = _no(count)
        self.wander_m = np.zeros(count)  # that its own TAKEOFF and HOLD let it be off its place: recorded 1 m
        self.descend_from_s = np.full(count, np.inf)
        self.yaw_rad = np.full(count, yaw_rad)

        self.home_set = _no(count)
        self.home_m = np.zeros((count, 3))  # local NED
        self.home_place = np.zeros((count, 3))  # latitude and longitude in degrees, altitude AMSL in m
        self.home_yaw_rad = np.zeros(count)
        self.home_boot_ms: Numbers = np.zeros(count, dtype=np.int64)

    def _receive(self, count: int) -> None:
        """The last orders, and what the receiver is made to believe."""
        self.setpoint_position_m = np.full((count, 3), np.nan)  # the last setpoint; NaN: not given
        self.setpoint_velocity_m_s = np.full((count, 3), np.nan)
        self.setpoint_flyable = _no(count)
        self.setpoint_yaw_rad = np.full(count, np.nan)
        self.setpoint_yaw_rate_rad_s = np.full(count, np.nan)

        self.offset_m = np.zeros((count, 3))  # what a fault adds to the estimated position
        self.frozen_m = np.full((count, 3), np.nan)  # the estimate that a frozen receiver repeats
        self.reset_counter = np.zeros(count, dtype=np.uint8)
        self.horizontal_accuracy_m = np.full(count, 0.9)  # as recorded
        self.vertical_accuracy_m = np.full(count, 1.78)
        self.hdop = np.full(count, 0.7)
        self.vdop = np.full(count, 1.1)
        self.fix_type: Numbers = np.full(count, FIX_3D)
        self.unhealthy_sensors: Numbers = np.zeros(count, dtype=np.int64)  # bits of MAV_SYS_STATUS_SENSOR
        self.unix_ahead_s = np.zeros(count)  # what its receiver's time is wrong by
        self.pings: Numbers = np.zeros(count, dtype=np.int64)

    def forget(self, row: int) -> None:
        """Let one vehicle boot: everything that memory does not outlast is as at the start."""
        fresh = vars(State(1, float(self.yaw_rad[row])))
        for name, column in vars(self).items():
            if isinstance(column, np.ndarray) and name not in LASTING:
                column[row] = fresh[name][0]

    @property
    def powered(self) -> Mask:
        """(n,): whether the motors carry the vehicle."""
        return self.armed & ~self.landed

    def boot_clock_s(self) -> Array:
        """(n,): what the vehicles' clocks show; slower than the wall's (item 12)."""
        return (self.now_s - self.boot_s) * self.clock_rate + self.clock_offset_s

    def boot_ms(self, row: int) -> int:
        """One vehicle's clock in milliseconds."""
        return max(math.floor(float(self.boot_clock_s()[row]) * 1e3), 0)


def _no(count: int) -> Mask:
    return np.zeros(count, dtype=np.bool_)
