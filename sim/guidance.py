"""Which velocity each mode asks of the velocity loop. Pure but for the target that a mode keeps."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sim.modes import NEEDS_PILOT, Mode
from sim.setpoints import Setpoint

if TYPE_CHECKING:
    from sim.commander import Commander
    from sim.params import Parameters
    from sim.sensed import Sensed, Triple

REST: Triple = (0.0, 0.0, 0.0)
BLIND_DESCENT_M_S = 0.9  # recorded after setpoint loss with nobody at the sticks (item 5)
TAKEOFF_START_M_S = -0.7  # PX4 ramps the climb from below zero up, so that lifting off is gentle
ARRIVED_M = 1.0
STOPPED_M_S = 0.4


class Guidance:
    """One vehicle's targets: where it holds, how high it takes off, how far its return has come."""

    def __init__(self, parameters: Parameters, yaw_rad: float) -> None:
        """Start without a target, looking along yaw_rad."""
        self._parameters = parameters
        self._mode: Mode | None = None
        self._target_m: Triple = REST
        self._last_m_s: Triple = REST
        self._descend_from_s = math.inf
        self._returning = False
        self.yaw_rad = yaw_rad
        self.home_m: Triple = REST
        self.setpoint = Setpoint()

    def reset(self) -> None:
        """Forget the target: the mode was asked for anew."""
        self._mode = None

    def velocity(self, commander: Commander, sensed: Sensed, now_s: float, dt_s: float) -> Triple:
        """The velocity that the mode demands, local NED, bounded per axis as PX4 bounds it (m/s)."""
        mode = commander.mode
        if commander.landed and mode not in {Mode.TAKEOFF, Mode.OFFBOARD}:
            self._mode = None
            return REST  # only these two lift off
        if mode is not self._mode or not commander.armed:
            self._enter(mode, commander, sensed)
        if mode is Mode.OFFBOARD:
            wanted_m_s = self._offboard(sensed)
        elif mode in NEEDS_PILOT:
            wanted_m_s = (0.0, 0.0, BLIND_DESCENT_M_S)
        else:
            wanted_m_s = self._slew(self._auto(mode, commander, sensed, now_s), dt_s)
        self._last_m_s = wanted_m_s
        return self._bounded(wanted_m_s, now_s - commander.airborne_since_s)

    def turn(self, commander: Commander, dt_s: float) -> None:
        """Turn the yaw towards what the setpoint commands, no faster than MPC_YAWRAUTO_MAX."""
        if commander.mode is not Mode.OFFBOARD or not commander.powered:
            return
        rate_max_rad_s = math.radians(self._parameters["MPC_YAWRAUTO_MAX"])
        if not math.isnan(self.setpoint.yaw_rad):
            turn_rad = math.remainder(self.setpoint.yaw_rad - self.yaw_rad, math.tau)
        elif not math.isnan(self.setpoint.yaw_rate_rad_s):
            turn_rad = self.setpoint.yaw_rate_rad_s * dt_s
        else:
            return
        turn_rad = _clip(turn_rad, rate_max_rad_s * dt_s)
        self.yaw_rad = math.remainder(self.yaw_rad + turn_rad, math.tau)

    def _enter(self, mode: Mode, commander: Commander, sensed: Sensed) -> None:
        """Take the target of a mode that begins: where the vehicle will have stopped, for most."""
        self._mode, self._last_m_s = mode, sensed.velocity_m_s
        self._returning, self._descend_from_s = False, math.inf
        north_m, east_m, down_m = sensed.position_m
        if mode is Mode.TAKEOFF:
            self._target_m = (north_m, east_m, self._takeoff_down_m(commander, sensed))
            return
        stop_s = sensed.ground_speed_m_s / (2.0 * self._parameters["MPC_ACC_HOR"])
        north_m_s, east_m_s, down_m_s = sensed.velocity_m_s
        stop_down_s = abs(down_m_s) / (2.0 * self._parameters["MPC_ACC_DOWN_MAX"])
        self._target_m = (
            north_m + north_m_s * stop_s,
            east_m + east_m_s * stop_s,
            down_m + down_m_s * stop_down_s,
        )
        if mode is Mode.RETURN:
            self._target_m = (*self._target_m[:2], self._return_down_m(sensed))

    def _takeoff_down_m(self, commander: Commander, sensed: Sensed) -> float:
        """The takeoff altitude in local NED; never below the vehicle."""
        down_m = sensed.position_m[2]
        if commander.takeoff_altitude_amsl_m is None:
            default_m = self._parameters["MIS_TAKEOFF_ALT"]
            return min(down_m, self.home_m[2] - default_m)
        return min(down_m, down_m - (commander.takeoff_altitude_amsl_m - sensed.altitude_amsl_m))

    def _return_down_m(self, sensed: Sensed) -> float:
        """How high to fly home: RTL_RETURN_ALT, lower inside the cone around home, never lower than now."""
        distance_m = math.dist(sensed.position_m[:2], self.home_m[:2])
        lowest_m, highest_m = self._parameters["RTL_DESCEND_ALT"], self._parameters["RTL_RETURN_ALT"]
        height_m = highest_m
        cone_deg = self._parameters["RTL_CONE_ANG"]
        if distance_m <= self._parameters["RTL_MIN_DIST"]:
            height_m = lowest_m
        elif 0 < cone_deg < 90:
            height_m = min(max(distance_m / math.tan(math.radians(cone_deg)), lowest_m), highest_m)
        return min(sensed.position_m[2], self.home_m[2] - height_m)

    def _auto(self, mode: Mode, commander: Commander, sensed: Sensed, now_s: float) -> Triple:
        if mode is Mode.LAND:
            return self._land(sensed)
        if mode is Mode.RETURN:
            return self._return(sensed, now_s)
        if mode is not Mode.TAKEOFF:
            return self._towards(sensed)
        near_m = self._parameters["NAV_MC_ALT_RAD"]
        if commander.powered and abs(self._target_m[2] - sensed.position_m[2]) < near_m:
            commander.took_off()
            self._mode = commander.mode  # hold at the takeoff's target, not where it is now
        return self._towards(sensed, climb_max_m_s=self._parameters["MPC_TKO_SPEED"])

    def _towards(self, sensed: Sensed, climb_max_m_s: float | None = None) -> Triple:
        """Fly to the target and stay."""
        p = self._parameters
        climb_m_s = p["MPC_Z_V_AUTO_UP"] if climb_max_m_s is None else climb_max_m_s
        north_m_s, east_m_s = self._across(sensed)
        down_m_s = p["MPC_Z_P"] * (self._target_m[2] - sensed.position_m[2])
        return north_m_s, east_m_s, min(max(down_m_s, -climb_m_s), p["MPC_Z_V_AUTO_DN"])

    def _across(self, sensed: Sensed) -> tuple[float, float]:
        """Horizontal velocity towards the target, at most MPC_XY_CRUISE."""
        gain_per_s, fastest_m_s = self._parameters["MPC_XY_P"], self._parameters["MPC_XY_CRUISE"]
        north_m_s = gain_per_s * (self._target_m[0] - sensed.position_m[0])
        east_m_s = gain_per_s * (self._target_m[1] - sensed.position_m[1])
        scale = fastest_m_s / max(math.hypot(north_m_s, east_m_s), fastest_m_s, 1e-9)
        return scale * north_m_s, scale * east_m_s

    def _land(self, sensed: Sensed) -> Triple:
        """Sink over the target, slower from MPC_LAND_ALT1 to MPC_LAND_ALT2, slowest below MPC_LAND_ALT3."""
        p = self._parameters
        fast_m_s, slow_m_s = p["MPC_Z_V_AUTO_DN"], p["MPC_LAND_SPEED"]
        upper_m, lower_m = p["MPC_LAND_ALT1"], p["MPC_LAND_ALT2"]
        share = min(max((sensed.height_m - lower_m) / max(upper_m - lower_m, 1e-9), 0.0), 1.0)
        sink_m_s = slow_m_s + share * (fast_m_s - slow_m_s)
        if sensed.height_m < p["MPC_LAND_ALT3"]:
            sink_m_s = min(sink_m_s, p["MPC_LAND_CRWL"])
        return (*self._across(sensed), sink_m_s)

    def _return(self, sensed: Sensed, now_s: float) -> Triple:
        """Climb, fly home, descend to RTL_DESCEND_ALT, wait RTL_LAND_DELAY (negative: for ever), land."""
        target_m, home_m = self._target_m, self.home_m
        if not self._returning:
            if sensed.position_m[2] < target_m[2] + ARRIVED_M:
                self._returning = True
                self._target_m = (home_m[0], home_m[1], target_m[2])
            return self._towards(sensed)
        home_is_near = math.dist(sensed.position_m[:2], home_m[:2]) < ARRIVED_M
        if self._descend_from_s == math.inf and home_is_near and sensed.ground_speed_m_s < STOPPED_M_S:
            wait_at_m = home_m[2] - self._parameters["RTL_DESCEND_ALT"]
            self._target_m = (home_m[0], home_m[1], max(target_m[2], wait_at_m))
            if sensed.position_m[2] > self._target_m[2] - ARRIVED_M:
                self._descend_from_s = now_s
        delay_s = self._parameters["RTL_LAND_DELAY"]
        if delay_s >= 0.0 and now_s >= self._descend_from_s + delay_s:
            return self._land(sensed)
        return self._towards(sensed)

    def _offboard(self, sensed: Sensed) -> Triple:
        """Follow the setpoint; one that cannot be flown is not followed at all (item 10)."""
        if not self.setpoint.can_be_flown:
            return REST
        p = self._parameters
        gains_per_s = (p["MPC_XY_P"], p["MPC_XY_P"], p["MPC_Z_P"])
        north_m_s, east_m_s, down_m_s = (
            _or_zero(velocity) + gain * _or_zero(position - here)
            for velocity, position, here, gain in zip(
                self.setpoint.velocity_m_s,
                self.setpoint.position_m,
                sensed.position_m,
                gains_per_s,
                strict=True,
            )
        )
        return north_m_s, east_m_s, down_m_s

    def _slew(self, wanted_m_s: Triple, dt_s: float) -> Triple:
        """The automatic modes accelerate gently."""
        p = self._parameters
        bounds_m_s2 = (p["MPC_ACC_HOR"], p["MPC_ACC_HOR"], p["MPC_ACC_UP_MAX"])
        north_m_s, east_m_s, down_m_s = (
            last + _clip(wanted - last, bound * dt_s)
            for wanted, last, bound in zip(wanted_m_s, self._last_m_s, bounds_m_s2, strict=True)
        )
        return north_m_s, east_m_s, down_m_s

    def _bounded(self, wanted_m_s: Triple, airborne_s: float) -> Triple:
        """Clip each axis on its own, as recorded, which bends the direction."""
        p = self._parameters
        across_m_s, climb_m_s = p["MPC_XY_VEL_MAX"], p["MPC_Z_VEL_MAX_UP"]
        ramp = min(airborne_s / max(p["MPC_TKO_RAMP_T"], 1e-9), 1.0) if airborne_s >= 0.0 else 0.0
        if ramp < 1.0 and airborne_s != math.inf:
            climb_m_s = max(TAKEOFF_START_M_S + ramp * (climb_m_s - TAKEOFF_START_M_S), 0.0)
        north_m_s, east_m_s, down_m_s = wanted_m_s
        return (
            _clip(north_m_s, across_m_s),
            _clip(east_m_s, across_m_s),
            min(max(down_m_s, -climb_m_s), p["MPC_Z_VEL_MAX_DN"]),
        )


def _clip(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)


def _or_zero(value: float) -> float:
    """What is not given adds nothing."""
    return 0.0 if math.isnan(value) else value
