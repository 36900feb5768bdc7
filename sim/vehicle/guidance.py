"""The velocity that each mode demands of the velocity loop, for a whole fleet at once. Local NED, m/s.

`rows` are the vehicles that a function is about; its result has one row for each of them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs.sim.vehicle.commander import Commander
from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.parameters import Columns
from gcs.sim.vehicle.px4 import MODES, NEEDS_PILOT, Mode, Quirks
from gcs.sim.vehicle.sensors import Sensors
from gcs.sim.vehicle.state import NO_MODE, Rows, State

BLIND_DESCENT_M_S = 0.9  # recorded after setpoint loss without a pilot at the sticks (item 5)
TAKEOFF_START_M_S = -0.7  # PX4 ramps the climb up from below zero, so that lifting off is gentle
ARRIVED_M = 1.0
STOPPED_M_S = 0.4
WANDER_S = 12.0  # period of one turn
TINY = 1e-9

TAKEOFF, HOLD, RETURN = Mode.TAKEOFF.number, Mode.HOLD.number, Mode.RETURN.number
LAND, OFFBOARD = Mode.LAND.number, Mode.OFFBOARD.number
BY_HAND = Mode.POSITION.number
FLOWN_AS = np.array([BY_HAND if mode in NEEDS_PILOT else mode.number for mode in MODES])
FLOWN_BY_HAND = np.flatnonzero(FLOWN_AS == BY_HAND)
LIFTS = np.array([mode.number in {TAKEOFF, OFFBOARD} for mode in MODES])  # only these two lift off


@dataclass(eq=False)
class Guidance:
    """Targets of vehicles: hold positions, take-off heights, progress of returns."""

    state: State
    commanders: Sequence[Commander]
    parameters: Columns
    quirks: Quirks

    def __post_init__(self) -> None:
        self._velocities: Mapping[int, Callable[[Rows, Sensors], Array]] = {
            OFFBOARD: self._offboard,
            BY_HAND: self._by_hand,
            HOLD: self._towards,
            TAKEOFF: self._take_off,
            LAND: self._land,
            RETURN: self._return,
        }

    def velocity(self, sensors: Sensors, awake: Mask, dt_s: float) -> Array:
        """(n, 3): the velocity that each mode demands, bounded per axis as PX4 bounds it; rest for others."""
        state = self.state
        demand_m_s = np.zeros((state.count, 3))
        flying = awake & (~state.landed | LIFTS[state.mode]) & ~state.terminated
        state.guided_mode[awake & ~flying] = NO_MODE
        rows = flying.nonzero()[0]
        if not len(rows):
            return demand_m_s
        entering = rows[(state.mode[rows] != state.guided_mode[rows]) | ~state.armed[rows]]
        if len(entering):
            self._enter(entering, sensors)
        desired_m_s = self._desired(rows, sensors, dt_s)
        state.last_m_s[rows] = desired_m_s
        demand_m_s[rows] = self._bounded(rows, desired_m_s)
        return demand_m_s

    def _desired(self, rows: Rows, sensors: Sensors, dt_s: float) -> Array:
        """The velocity that each vehicle's mode requests; the automatic modes accelerate gently."""
        flown = FLOWN_AS[self.state.mode[rows]]  # before a take-off that ends in this step
        kinds = set(flown.tolist())
        desired_m_s = np.empty((len(rows), 3))
        for kind, request in self._velocities.items():
            if kind not in kinds:
                continue
            chosen = slice(None) if len(kinds) == 1 else flown == kind
            requested_m_s = request(rows[chosen], sensors)
            gentle = kind not in {OFFBOARD, BY_HAND}
            desired_m_s[chosen] = self._slew(rows[chosen], requested_m_s, dt_s) if gentle else requested_m_s
        return desired_m_s

    def turn(self, powered: Mask, dt_s: float) -> None:
        """Turn the yaw of (n,) powered vehicles towards the setpoint's, no faster than MPC_YAWRAUTO_MAX."""
        state = self.state
        rows = ((state.mode == OFFBOARD) & powered).nonzero()[0]
        if not len(rows):
            return
        yaw_rad, desired_rad = state.yaw_rad[rows], state.setpoint_yaw_rad[rows]
        by_rate_rad = state.setpoint_yaw_rate_rad_s[rows] * dt_s
        turn_rad = np.where(np.isnan(desired_rad), by_rate_rad, _wrapped(desired_rad - yaw_rad))
        turn_rad[np.isnan(turn_rad)] = 0.0
        most_rad = np.radians(self.parameters["MPC_YAWRAUTO_MAX"][rows]) * dt_s
        state.yaw_rad[rows] = _wrapped(yaw_rad + _clipped(turn_rad, -most_rad, most_rad))

    def _enter(self, rows: Rows, sensors: Sensors) -> None:
        """Set the target of a mode that begins: for most the point where the vehicle will have stopped."""
        state, p = self.state, self.parameters
        mode = state.mode[rows]
        state.guided_mode[rows], state.last_m_s[rows] = mode, sensors.velocity_m_s[rows]
        state.returning[rows], state.descend_from_s[rows] = False, np.inf
        velocity_m_s, position_m = sensors.velocity_m_s[rows], sensors.position_m[rows]
        across_s = np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1]) / (2.0 * p["MPC_ACC_HOR"][rows])
        down_s = np.abs(velocity_m_s[:, 2]) / (2.0 * p["MPC_ACC_DOWN_MAX"][rows])
        stop_m = position_m + velocity_m_s * np.stack([across_s, across_s, down_s], axis=1)
        stop_m[:, :2] -= self._wander_m(rows)  # it is already off its place
        climbing, homing = mode == TAKEOFF, mode == RETURN
        if climbing.any():
            stop_m[climbing, :2] = position_m[climbing, :2]
            stop_m[climbing, 2] = self._takeoff_down_m(rows[climbing], sensors)
        if homing.any():
            stop_m[homing, 2] = self._return_down_m(rows[homing], sensors)
        stop_m[np.isin(mode, FLOWN_BY_HAND), :2] = np.nan  # until it has stopped
        state.target_m[rows] = stop_m

    def _takeoff_down_m(self, rows: Rows, sensors: Sensors) -> Array:
        """The takeoff altitude in local NED; never below the vehicle."""
        state, down_m = self.state, sensors.position_m[rows, 2]
        commanded_m = state.takeoff_altitude_amsl_m[rows]
        target_m: Array = state.home_m[rows, 2] - self.parameters["MIS_TAKEOFF_ALT"][rows]
        if not np.isnan(commanded_m).all():
            above_m = commanded_m - sensors.place(rows)[:, 2]
            target_m = np.where(np.isnan(commanded_m), target_m, down_m - above_m)
        lowest_m: Array = np.minimum(down_m, target_m)
        return lowest_m

    def _return_down_m(self, rows: Rows, sensors: Sensors) -> Array:
        """Height of the return: RTL_RETURN_ALT, lower inside the cone around home, never lower than now.

        Without a cone it is RTL_RETURN_ALT near home as well.
        """
        p, home_m, here_m = self.parameters, self.state.home_m[rows], sensors.position_m[rows]
        distance_m = np.hypot(*(here_m - home_m)[:, :2].T)
        lowest_m, highest_m = p["RTL_DESCEND_ALT"][rows], p["RTL_RETURN_ALT"][rows]
        cone_deg = p["RTL_CONE_ANG"][rows]
        has_cone = (cone_deg > 0) & (cone_deg < 90)
        slope = np.tan(np.radians(np.where(has_cone, cone_deg, 45.0)))
        in_cone_m = np.minimum(np.maximum(distance_m / slope, lowest_m), highest_m)
        in_cone_m = np.where(distance_m <= p["RTL_MIN_DIST"][rows], lowest_m, in_cone_m)
        height_m = np.where(has_cone, in_cone_m, highest_m)
        down_m: Array = np.minimum(here_m[:, 2], home_m[:, 2] - height_m)
        return down_m

    def _take_off(self, rows: Rows, sensors: Sensors) -> Array:
        state = self.state
        gap_m = np.abs(state.target_m[rows, 2] - sensors.position_m[rows, 2])
        there = state.powered[rows] & (gap_m < self.parameters["NAV_MC_ALT_RAD"][rows])
        for row in rows[there].tolist():
            self.commanders[row].intend(Mode.HOLD)
            state.guided_mode[row] = HOLD  # hold at the take-off's target, not at the present position
        return self._towards(rows, sensors, climb_max_m_s=self.parameters["MPC_TKO_SPEED"][rows])

    def _towards(self, rows: Rows, sensors: Sensors, climb_max_m_s: Array | None = None) -> Array:
        p = self.parameters
        climb_m_s = p["MPC_Z_V_AUTO_UP"][rows] if climb_max_m_s is None else climb_max_m_s
        down_m_s = p["MPC_Z_P"][rows] * (self.state.target_m[rows, 2] - sensors.position_m[rows, 2])
        down_m_s = np.minimum(np.maximum(down_m_s, -climb_m_s), p["MPC_Z_V_AUTO_DN"][rows])
        return self._across(rows, sensors, down_m_s)

    def _across(self, rows: Rows, sensors: Sensors, down_m_s: Array) -> Array:
        """Horizontally towards the target, at most MPC_XY_CRUISE, and down_m_s."""
        p = self.parameters
        way_m = self.state.target_m[rows, :2] + self._wander_m(rows) - sensors.position_m[rows, :2]
        velocity_m_s = p["MPC_XY_P"][rows, np.newaxis] * way_m
        fastest_m_s = p["MPC_XY_CRUISE"][rows]
        speed_m_s = np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1])
        scale = fastest_m_s / np.maximum(np.maximum(speed_m_s, fastest_m_s), TINY)
        whole_m_s = np.empty((len(rows), 3))
        whole_m_s[:, :2] = scale[:, np.newaxis] * velocity_m_s
        whole_m_s[:, 2] = down_m_s
        return whole_m_s

    def _wander_m(self, rows: Rows) -> Array:
        """(k, 2) present offset of TAKEOFF and HOLD from their target, round it, each at its own pace."""
        wide_m = self.state.wander_m[rows]
        if not wide_m.any():
            return np.zeros((len(rows), 2))
        turn_rad = self.state.now_s * 2.0 * np.pi / (WANDER_S + 1.7 * (rows % 5)) + 2.4 * rows
        off_m: Array = wide_m[:, np.newaxis] * np.stack([np.cos(turn_rad), np.sin(turn_rad)], axis=1)
        return off_m

    def _land(self, rows: Rows, sensors: Sensors) -> Array:
        """Descend over the target, slower from MPC_LAND_ALT1 to _ALT2, slowest below _ALT3."""
        p, height_m = self.parameters, sensors.height_m[rows]
        fast_m_s, slow_m_s = p["MPC_Z_V_AUTO_DN"][rows], p["MPC_LAND_SPEED"][rows]
        upper_m, lower_m = p["MPC_LAND_ALT1"][rows], p["MPC_LAND_ALT2"][rows]
        share = np.minimum(np.maximum((height_m - lower_m) / np.maximum(upper_m - lower_m, TINY), 0.0), 1.0)
        sink_m_s = slow_m_s + share * (fast_m_s - slow_m_s)
        crawling = height_m < p["MPC_LAND_ALT3"][rows]
        sink_m_s = np.where(crawling, np.minimum(sink_m_s, p["MPC_LAND_CRWL"][rows]), sink_m_s)
        demand_m_s = self._across(rows, sensors, sink_m_s)
        demand_m_s[self.state.blind[rows], :2] = 0.0
        return demand_m_s

    def _return(self, rows: Rows, sensors: Sensors) -> Array:
        """Climb, fly home, descend to RTL_DESCEND_ALT, wait RTL_LAND_DELAY (negative: without end), land."""
        state, p, here_m = self.state, self.parameters, sensors.position_m[rows]
        home_m, was_returning = state.home_m[rows], state.returning[rows]
        high = ~was_returning & (here_m[:, 2] < state.target_m[rows, 2] + ARRIVED_M)
        state.returning[rows[high]] = True
        state.target_m[rows[high], :2] = home_m[high, :2]
        home_is_near = np.hypot(*(here_m - home_m)[:, :2].T) < ARRIVED_M
        slow = sensors.ground_speed_m_s[rows] < STOPPED_M_S
        over = was_returning & (state.descend_from_s[rows] == np.inf) & home_is_near & slow
        if over.any():
            wait_at_m = home_m[:, 2] - p["RTL_DESCEND_ALT"][rows]
            target_m = np.column_stack([home_m[:, :2], np.maximum(state.target_m[rows, 2], wait_at_m)])
            state.target_m[rows[over]] = target_m[over]
            low = over & (here_m[:, 2] > target_m[:, 2] - ARRIVED_M)
            state.descend_from_s[rows[low]] = state.now_s
        desired_m_s = self._towards(rows, sensors)
        delay_s = p["RTL_LAND_DELAY"][rows]
        landing = was_returning & (delay_s >= 0.0) & (state.now_s >= state.descend_from_s[rows] + delay_s)
        if landing.any():
            desired_m_s[landing] = self._land(rows[landing], sensors)
        return desired_m_s

    def _by_hand(self, rows: Rows, sensors: Sensors) -> Array:
        """Follow the sticks; without a pilot the vehicle descends. At rest it holds its place."""
        state, p = self.state, self.parameters
        piloted = state.piloted[rows, np.newaxis]
        demand_m_s: Array = np.where(piloted, state.stick_m_s[rows], (0.0, 0.0, BLIND_DESCENT_M_S))
        place_m, velocity_m_s = state.target_m[rows, :2], sensors.velocity_m_s[rows]
        stopped = np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1]) < p["MPC_HOLD_MAX_XY"][rows]
        place_m[(demand_m_s[:, :2] != 0.0).any(axis=1)] = np.nan
        begins = stopped & np.isnan(place_m[:, 0]) & (demand_m_s[:, :2] == 0.0).all(axis=1)
        place_m[begins] = sensors.position_m[rows[begins], :2]
        state.target_m[rows, :2] = place_m
        way_m_s = p["MPC_XY_P"][rows, np.newaxis] * (place_m - sensors.position_m[rows, :2])
        demand_m_s[:, :2] += np.nan_to_num(way_m_s)
        return demand_m_s

    def _offboard(self, rows: Rows, sensors: Sensors) -> Array:
        """Follow the setpoint; one that cannot be flown is not followed at all (item 10)."""
        state = self.state
        way_m: Array = state.setpoint_position_m[rows] - sensors.position_m[rows]
        velocity_m_s = state.setpoint_velocity_m_s[rows]
        way_m[np.isnan(way_m)] = velocity_m_s[np.isnan(velocity_m_s)] = 0.0
        desired_m_s: Array = velocity_m_s + self.parameters.axes("MPC_XY_P", "MPC_Z_P")[rows] * way_m
        if self.quirks.whole_velocity:
            desired_m_s[~state.setpoint_flyable[rows]] = 0.0
        return desired_m_s

    def _slew(self, rows: Rows, desired_m_s: Array, dt_s: float) -> Array:
        bound_m_s = self.parameters.axes("MPC_ACC_HOR", "MPC_ACC_UP_MAX")[rows] * dt_s
        last_m_s = self.state.last_m_s[rows]
        return last_m_s + _clipped(desired_m_s - last_m_s, -bound_m_s, bound_m_s)

    def _bounded(self, rows: Rows, desired_m_s: Array) -> Array:
        """Clip each axis on its own, as recorded, which changes the direction."""
        state, p = self.state, self.parameters
        low_m_s = -p.axes("MPC_XY_VEL_MAX", "MPC_Z_VEL_MAX_UP")[rows]
        high_m_s = p.axes("MPC_XY_VEL_MAX", "MPC_Z_VEL_MAX_DN")[rows]
        airborne_s = state.now_s - state.airborne_since_s[rows]
        ramp = airborne_s / np.maximum(p["MPC_TKO_RAMP_T"][rows], TINY)
        if np.count_nonzero(ramp < 1.0):
            climb_m_s = -low_m_s[:, 2]
            ramped_m_s = np.maximum(TAKEOFF_START_M_S + ramp * (climb_m_s - TAKEOFF_START_M_S), 0.0)
            low_m_s[:, 2] = -np.where(ramp < 1.0, ramped_m_s, climb_m_s)
        return _clipped(desired_m_s, low_m_s, high_m_s)


def _clipped(values: Array, low: Array, high: Array) -> Array:
    """As np.clip, which is slow for arrays as small as these."""
    clipped: Array = np.minimum(np.maximum(values, low), high)
    return clipped


def _wrapped(angle_rad: Array) -> Array:
    wrapped: Array = np.remainder(angle_rad + np.pi, 2.0 * np.pi) - np.pi
    return wrapped
