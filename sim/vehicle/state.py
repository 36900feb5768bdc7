"""State of the autopilots of a fleet, as columns: row i of every array is vehicle i.

One vehicle's transitions, the fleet's conditions (sim.vehicle.transitions) and sim.vehicle.guidance share it:
one vehicle and a thousand behave alike.
"""

import math
from enum import Enum, IntEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.px4 import Mode

Rows: TypeAlias = NDArray[np.intp]
Numbers: TypeAlias = NDArray[np.int64]

NO_MODE = -1
# Columns that a reboot does not reset: the vehicle's number and battery, its receiver, the pilot.
LASTING = frozenset(
    {
        *("system_id", "remaining", "offset_m", "frozen_m", "hdop", "vdop", "height_scale"),
        *("repeated_m", "repeated_m_s", "velocity_times"),
        "barometer_m",
        *("horizontal_accuracy_m", "vertical_accuracy_m", "piloted", "stick_m_s"),
        *("fix_type", "unhealthy_sensors", "unix_ahead_s"),
    }
)
FIX_3D = 3  # GPS_FIX_TYPE


class Charge(IntEnum):
    """MAV_BATTERY_CHARGE_STATE."""

    OK = 1
    LOW = 2
    CRITICAL = 3
    EMERGENCY = 4


class Stuck(Enum):
    """Answer of a vehicle with a stuck mode to a request for another one."""

    NO = "no"
    SAYS_YES = "accepted"
    SAYS_NO = "rejected"


class State:
    """Columns of n vehicles that have just booted, on the ground, disarmed, in HOLD.

    Times are the fleet's clock.
    """

    def __init__(self, count: int, yaw_rad: float) -> None:
        self.count = count
        self.now_s = 0.0
        self.system_id = np.zeros(count, dtype=np.uint8)
        self.sequence = np.zeros(count, dtype=np.uint8)  # of the next MAVLink frame

        self._boot(count)
        self._land(count)
        self._stand(count, yaw_rad)
        self._receive(count)

    def _boot(self, count: int) -> None:
        self.boot_s = np.zeros(count)
        self.clock_rate = np.ones(count)
        self.clock_offset_s = np.zeros(count)  # added to the boot clock by jumps
        self.ready_at_s = np.full(count, np.inf)
        self.fix_at_s = np.full(count, np.inf)

    def _land(self, count: int) -> None:
        self.mode: Numbers = np.full(count, Mode.HOLD.number)  # the one flown
        self.intended: Numbers = np.full(count, Mode.HOLD.number)  # the one requested
        self.after_disarming: Numbers = np.full(count, Mode.HOLD.number)
        self.armed = _no(count)
        self.landed = ~_no(count)
        self.flown = _no(count)  # since it was armed
        self.failsafe = _no(count)  # setpoints were lost
        self.intervenes = _no(count)  # another failsafe of its own flies it
        self.action: Numbers = np.full(count, NO_MODE)  # of that failsafe, after its HOLD
        self.acts_at_s = np.full(count, np.inf)
        self.position_lost = _no(count)  # no GPS for too long
        self.blind = _no(count)  # and it descends without a position
        self.fence_breached = _no(count)  # and GF_ACTION is not 0
        self.transponder_ok = _no(count)  # that of Remote ID reports that it is ready
        self.transponder_lost = _no(count)  # its failsafe has acted since then
        self.terminated = _no(count)  # the motors stand still until the next boot
        self.piloted = _no(count)  # a pilot has the sticks
        self.setpoint_seen = _no(count)
        self.setpoint_s = np.full(count, -np.inf)
        self.station_s = np.full(count, -np.inf)  # arrival of a ground station's newest heartbeat
        self.station_lost = _no(count)  # and the failsafe has acted
        self.armed_s = np.full(count, -np.inf)
        self.airborne_since_s = np.full(count, -np.inf)
        self.climb_since_s = np.full(count, np.inf)
        self.down_since_s = np.full(count, np.inf)
        self.landed_s = np.full(count, -np.inf)
        self.takeoff_altitude_amsl_m = np.full(count, np.nan)  # NaN: MIS_TAKEOFF_ALT above home
        self.charge: Numbers = np.full(count, Charge.OK)  # the worst that the failsafe acted on
        self.remaining = np.ones(count)  # of the battery

    def _stand(self, count: int, yaw_rad: float) -> None:
        self.guided_mode: Numbers = np.full(count, NO_MODE)  # mode of the kept target
        self.target_m = np.zeros((count, 3))  # local NED
        self.last_m_s = np.zeros((count, 3))  # velocity that the mode last requested
        self.demanded_m_s = np.full((count, 3), np.nan)  # for POSITION_TARGET_LOCAL_NED
        self.stick_m_s = np.zeros((count, 3))  # requested by the pilot
        self.returning = _no(count)
        self.wander_m = np.zeros(count)  # offset of its own TAKEOFF and HOLD from the target: recorded 1 m
        self.descend_from_s = np.full(count, np.inf)
        self.yaw_rad = np.full(count, yaw_rad)

        self.home_set = _no(count)
        self.home_m = np.zeros((count, 3))  # local NED
        self.home_place = np.zeros((count, 3))  # latitude and longitude in degrees, altitude AMSL in m
        self.home_yaw_rad = np.zeros(count)
        self.home_boot_ms: Numbers = np.zeros(count, dtype=np.int64)

    def _receive(self, count: int) -> None:
        """Create the columns of the last setpoints, and of the receiver's faults."""
        self.setpoint_position_m = np.full((count, 3), np.nan)  # the last setpoint; NaN: not given
        self.setpoint_velocity_m_s = np.full((count, 3), np.nan)
        self.setpoint_flyable = _no(count)
        self.setpoint_yaw_rad = np.full(count, np.nan)
        self.setpoint_yaw_rate_rad_s = np.full(count, np.nan)

        self.offset_m = np.zeros((count, 3))  # added to the estimated position by a fault
        self.barometer_m = np.zeros(count)  # by so much the estimated height is too great, by a fault
        self.height_scale = np.ones(count)  # of estimated over true height
        self.frozen_m = np.full((count, 3), np.nan)  # the estimate that a frozen receiver repeats
        self.repeated_m = np.full((count, 3), np.nan)  # the estimate that its messages repeat, by a fault
        self.repeated_m_s = np.zeros((count, 3))  # and the velocity with it
        self.velocity_times = np.ones(count)  # what its messages report of the estimated velocity
        self.reset_counter = np.zeros(count, dtype=np.uint8)
        self.heading_aligned = _no(count)  # in this flight
        self.heading_turn_rad = np.zeros(count)  # by that alignment
        self.gps_lost_s = np.full(count, np.inf)  # since when there is no fix
        self.drift_m_s2 = np.zeros((count, 3))  # growth of the error without GPS
        self.drift_m_s = np.zeros((count, 3))
        self.drift_m = np.zeros((count, 3))
        self.horizontal_accuracy_m = np.full(count, 0.9)  # as PX4's simulator reports
        self.vertical_accuracy_m = np.full(count, 1.78)
        self.hdop = np.full(count, 0.7)
        self.vdop = np.full(count, 1.1)
        self.fix_type: Numbers = np.full(count, FIX_3D)
        self.unhealthy_sensors: Numbers = np.zeros(count, dtype=np.int64)  # bits of MAV_SYS_STATUS_SENSOR
        self.unix_ahead_s = np.zeros(count)  # error of its receiver's time
        self.pings: Numbers = np.zeros(count, dtype=np.int64)

    def forget(self, row: int) -> None:
        """Boot one vehicle: reset all columns but LASTING."""
        fresh = vars(type(self)(1, float(self.yaw_rad[row])))
        for name, column in vars(self).items():
            if isinstance(column, np.ndarray) and name not in LASTING:
                column[row] = fresh[name][0]

    @property
    def powered(self) -> Mask:
        """(n,): whether the motors carry the vehicle."""
        return self.armed & ~self.landed & ~self.terminated

    def boot_clock_s(self) -> Array:
        """(n,): the vehicles' boot clocks; slower than the wall clock (item 12)."""
        return (self.now_s - self.boot_s) * self.clock_rate + self.clock_offset_s

    def boot_ms(self, row: int) -> int:
        return max(math.floor(float(self.boot_clock_s()[row]) * 1e3), 0)


def _no(count: int) -> Mask:
    return np.zeros(count, dtype=np.bool_)
