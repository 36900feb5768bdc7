"""The velocity that each of ArduCopter's modes demands, for a whole fleet at once. Local NED, m/s.

`rows` are the vehicles that a function is about; its result has one row for each of them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gcs.sim.autopilots.ardupilot.fence import Fence, approach_m_s
from gcs.sim.autopilots.ardupilot.modes import (
    BRAKE,
    CIRCLE,
    DRIFTS,
    GUIDED,
    HANDS_ON,
    LAND,
    POSITION,
    RETURNS,
    TAKEOFF,
    VELOCITY,
    Mode,
    Phase,
)
from gcs.sim.autopilots.ardupilot.response import Copters
from gcs.sim.autopilots.ardupilot.state import ArduState
from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.parameters import Columns
from gcs.sim.vehicle.sensors import Sensors
from gcs.sim.vehicle.state import Rows

THROTTLE_LOW_M_S = 2.4  # habit 14: descent while no transmitter holds the throttle up
SINKS_SHARE = 0.55  # of PILOT_ACCEL_Z: recorded 7.5 m in the first 4 s
STOPS_IN_S = 1.9  # habit 14: BRAKE and the modes by hand stop in a time, whatever WPNAV_ACCEL is
LAND_STOPS_IN_S = 1.05
WAYPOINT_SHARE = 0.8  # of WPNAV_ACCEL, in modes that fly to waypoints: recorded 7.5 m from 3.4 m/s
GENTLEST_M_S2 = 0.5
DRIFTS_M_S2 = 0.4  # modes without position control lose their speed by drag only
TAKES_OFF_SHARE = (
    0.7  # of WPNAV_ACCEL_Z: recorded 3.0 m and 2.0 m/s 3.4 s after the command, 10 m after 7.0 s
)
ARRIVED_M, ARRIVED_UP_M = 1.0, 0.3
YAW_PER_S, YAW_DAMPING = 3.2, 0.26  # habit 49: as recorded it swings round the desired yaw
BLIND_DRIFT_M_S = 0.3  # habit 55: without a position it drifted by 1.7 m and 11 m during its landing
TURNS_BEYOND_M = 2.0  # WP_YAW_BEHAVIOR: a nearer goal does not turn the nose
GUIDED_BY_WPNAV = (4, 1)
"""Release since which WPNAV_ACCEL_Z and PSC_JERK_Z bound the climb in GUIDED, not PILOT_ACCEL_Z."""
CM = 0.01


@dataclass(eq=False)
class Guidance:
    """Goals of vehicles: positions, take-off heights, the way of returns."""

    state: ArduState
    bodies: Copters
    parameters: Columns
    fence: Fence
    release: tuple[int, int]

    def velocity(self, sensors: Sensors, awake: Mask) -> Array:
        """(n, 3): the velocity that each mode demands; rest for vehicles that are not in the air."""
        state = self.state
        demand_m_s = np.zeros((state.count, 3))
        flying = awake & state.powered
        state.flown_as[~flying] = -1
        rows = flying.nonzero()[0]
        if not len(rows):
            return demand_m_s
        self._advance(rows, sensors)
        self._enter(flying, sensors)
        demand_m_s[rows] = self._desired(rows, sensors)
        return demand_m_s

    def turn(self, dt_s: float) -> None:
        """Turn the nose in GUIDED: to a setpoint's yaw or rate, or towards a position (habits 42, 49).

        The desired yaw turns by ATC_SLEW_YAW at most, and the vehicle follows it as a damped spring.
        """
        state = self.state
        turning = state.powered & (state.mode == GUIDED)
        state.desired_yaw_rad = np.where(turning, state.desired_yaw_rad, state.yaw_rad)
        state.yaw_rate_rad_s = np.where(turning, state.yaw_rate_rad_s, 0.0)
        rows = turning.nonzero()[0]
        if not len(rows):
            return
        yaw_rad, sub = state.desired_yaw_rad[rows], state.submode[rows]
        goal_rad = np.where(sub == VELOCITY, state.setpoint_yaw_rad[rows], np.nan)
        goal_rad = np.where(np.isnan(goal_rad), state.goal_yaw_rad[rows], goal_rad)
        way_m = (state.goal_m - self.bodies.target_m)[rows, :2]
        ahead = (sub == POSITION) & (np.hypot(*way_m.T) > TURNS_BEYOND_M)
        goal_rad = np.where(ahead, np.arctan2(way_m[:, 1], way_m[:, 0]), goal_rad)
        rate_rad_s = np.where(sub == VELOCITY, state.setpoint_yaw_rate_rad_s[rows], np.nan)
        off_rad = _wrapped(goal_rad - yaw_rad)
        turn_rad = np.nan_to_num(np.where(np.isnan(rate_rad_s), off_rad, rate_rad_s * dt_s))
        most_rad = np.radians(CM * self.parameters["ATC_SLEW_YAW"][rows]) * dt_s
        desired_rad = yaw_rad + np.minimum(np.maximum(turn_rad, -most_rad), most_rad)
        behind_rad, rate_rad_s = _wrapped(desired_rad - state.yaw_rad[rows]), state.yaw_rate_rad_s[rows]
        rate_rad_s += dt_s * YAW_PER_S * (YAW_PER_S * behind_rad - 2.0 * YAW_DAMPING * rate_rad_s)
        state.desired_yaw_rad[rows], state.yaw_rate_rad_s[rows] = _wrapped(desired_rad), rate_rad_s
        state.yaw_rad[rows] = _wrapped(state.yaw_rad[rows] + dt_s * rate_rad_s)

    def _advance(self, rows: Rows, sensors: Sensors) -> None:
        """End take-offs, and begin the next phase of returns."""
        state, here_m = self.state, sensors.position_m[rows]
        up_m = np.abs(state.goal_m[rows, 2] - here_m[:, 2])
        guided = (state.mode[rows] == GUIDED) & (state.submode[rows] == TAKEOFF)
        near_m = CM * self.parameters["WPNAV_RADIUS"][rows]
        state.submode[rows[guided & (up_m < near_m)]] = POSITION  # the climb goes on: habit 26
        homing = RETURNS[state.mode[rows]] & (state.flown_as[rows] >= 0)
        if not homing.any():
            return
        phase = state.phase[rows]
        across_m = np.hypot(*(state.home_m[rows] - here_m)[:, :2].T)
        waited_s = state.now_s - state.phase_s[rows]
        over = (phase == Phase.CLIMB) & (up_m < ARRIVED_UP_M)
        over |= (phase == Phase.RETURN) & (across_m < ARRIVED_M)
        over |= (phase == Phase.WAIT) & (waited_s >= 1e-3 * self.parameters["RTL_LOIT_TIME"][rows])
        ends = rows[homing & over]
        state.phase[ends] += 1
        state.phase_s[ends] = state.now_s
        state.goal_m[ends, :2] = state.home_m[ends, :2]

    def _enter(self, flying: Mask, sensors: Sensors) -> None:
        """Begin modes: the control loops start where the vehicle is, with the acceleration of the mode."""
        state = self.state
        key = 4 * state.mode + np.where(state.mode == GUIDED, state.submode, 0)
        entering = flying & (key != state.flown_as)
        if not entering.any():
            return
        went_on = (state.flown_as == 4 * GUIDED + TAKEOFF) & (key == 4 * GUIDED + POSITION)
        state.flown_as[entering] = key[entering]
        entering &= ~went_on
        self.bodies.start(entering, sensors.position_m, sensors.velocity_m_s)
        rows = entering.nonzero()[0]
        state.limit_m_s2[rows] = self._limits(rows, sensors.ground_speed_m_s[rows])
        if self.release >= GUIDED_BY_WPNAV:
            follows = (state.mode[rows] == GUIDED) & (state.submode[rows] == VELOCITY)
            state.jerk_m_s3[rows] = np.where(follows, self.parameters["PSC_JERK_Z"][rows], np.inf)
        self._start_returns(rows[RETURNS[state.mode[rows]]], sensors)

    def _limits(self, rows: Rows, speed_m_s: Array) -> Array:
        """(k, 2): accelerations of the modes that begin, horizontal and vertical, at these speeds (k,).

        WPNAV_ACCEL is taken here: a change of it counts from the next entry into a mode (habit 60).
        """
        p, mode = self.parameters, self.state.mode[rows]
        guided, by_hand = mode == GUIDED, HANDS_ON[mode]
        submode = self.state.submode[rows]
        set_m_s2 = np.maximum(CM * p["WPNAV_ACCEL"][rows], GENTLEST_M_S2)
        level_m_s2 = np.select(
            [
                DRIFTS[mode],
                (by_hand & (mode != CIRCLE)) | (mode == BRAKE),
                mode == LAND,
                guided,
            ],
            [
                np.full(len(rows), DRIFTS_M_S2),
                np.maximum(speed_m_s / STOPS_IN_S, GENTLEST_M_S2),
                np.maximum(speed_m_s / LAND_STOPS_IN_S, GENTLEST_M_S2),
                set_m_s2,
            ],
            WAYPOINT_SHARE * set_m_s2,
        )
        pilots_m_s2, own_m_s2 = CM * p["PILOT_ACCEL_Z"][rows], CM * p["WPNAV_ACCEL_Z"][rows]
        guided_m_s2 = pilots_m_s2 if self.release < GUIDED_BY_WPNAV else own_m_s2
        up_m_s2 = np.select(
            [
                by_hand,
                (guided & (submode <= VELOCITY)) | (mode == BRAKE),
                guided & (submode == TAKEOFF),
            ],
            [SINKS_SHARE * pilots_m_s2, guided_m_s2, TAKES_OFF_SHARE * own_m_s2],
            own_m_s2,
        )
        return np.column_stack([level_m_s2, up_m_s2])

    def _start_returns(self, rows: Rows, sensors: Sensors) -> None:
        """RTL climbs to RTL_ALT above home first, in a cone near home; SMART_RTL flies back as it is."""
        state, p = self.state, self.parameters
        if not len(rows):
            return
        here_m, home_m = sensors.position_m[rows], state.home_m[rows]
        across_m = np.hypot(*(here_m - home_m)[:, :2].T)
        slope = p["RTL_CONE_SLOPE"][rows]
        height_m = CM * p["RTL_ALT"][rows]
        in_cone_m = np.minimum(height_m, np.maximum(across_m * slope, CM * p["RTL_ALT_FINAL"][rows]))
        height_m = np.where(slope > 0.0, in_cone_m, height_m)
        down_m = np.minimum(here_m[:, 2], home_m[:, 2] - height_m)
        smart = state.mode[rows] == Mode.SMART_RTL
        state.goal_m[rows] = here_m
        state.goal_m[rows, 2] = np.where(smart, here_m[:, 2], down_m)
        state.phase[rows] = Phase.CLIMB
        state.phase_s[rows] = state.now_s

    def _desired(self, rows: Rows, sensors: Sensors) -> Array:
        state = self.state
        mode, sub = state.mode[rows], state.submode[rows]
        guided, homing = mode == GUIDED, RETURNS[mode]
        phase = state.phase[rows]
        places = (guided & (sub >= POSITION)) | (homing & (phase != Phase.LAND))
        parts: tuple[tuple[Mask, Callable[[Rows, Sensors], Array]], ...] = (
            (guided & (sub == VELOCITY), self._follow),
            (places, self._towards),
            ((mode == LAND) | (homing & (phase == Phase.LAND)), self._land),
            (HANDS_ON[mode], self._by_hand),
        )
        desired_m_s = np.zeros((len(rows), 3))
        for chosen, request in parts:
            if chosen.any():
                desired_m_s[chosen] = request(rows[chosen], sensors)
        return desired_m_s

    def _follow(self, rows: Rows, _sensors: Sensors) -> Array:
        """The last velocity for GUID_TIMEOUT; bent at the fence, not clipped (habits 40, 43, 53)."""
        state = self.state
        fed = state.now_s - state.setpoint_s[rows] < self.parameters["GUID_TIMEOUT"][rows]
        velocity_m_s = np.where(fed[:, np.newaxis], state.setpoint_velocity_m_s[rows], 0.0)
        from_home_m = self.bodies.target_m[rows] - state.home_m[rows]
        return self.fence.bent(rows, velocity_m_s, from_home_m, state.limit_m_s2[rows])

    def _towards(self, rows: Rows, _sensors: Sensors) -> Array:
        """Fly to the goal, at most at WPNAV_SPEED (a return RTL_SPEED), WPNAV_SPEED_UP and _DN."""
        p, limit_m_s2 = self.parameters, self.state.limit_m_s2[rows]
        way_m = self.state.goal_m[rows] - self.bodies.target_m[rows]
        way_m[(self.state.phase[rows] == Phase.CLIMB) & RETURNS[self.state.mode[rows]], :2] = 0.0
        across_m = np.hypot(way_m[:, 0], way_m[:, 1])
        homing = RETURNS[self.state.mode[rows]] & (p["RTL_SPEED"][rows] > 0.0)
        fastest_m_s = CM * np.where(homing, p["RTL_SPEED"][rows], p["WPNAV_SPEED"][rows])
        speed_m_s = np.minimum(approach_m_s(across_m, limit_m_s2[:, 0]), fastest_m_s)
        velocity_m_s = way_m * (speed_m_s / np.maximum(across_m, 1e-9))[:, np.newaxis]
        up_m_s, down_m_s = CM * p["WPNAV_SPEED_UP"][rows], CM * p["WPNAV_SPEED_DN"][rows]
        fastest_m_s = np.where(way_m[:, 2] < 0.0, up_m_s, down_m_s)
        vertical_m_s = np.minimum(approach_m_s(np.abs(way_m[:, 2]), limit_m_s2[:, 1]), fastest_m_s)
        velocity_m_s[:, 2] = np.sign(way_m[:, 2]) * vertical_m_s
        return velocity_m_s

    def _land(self, rows: Rows, sensors: Sensors) -> Array:
        """Descend fast above LAND_ALT_LOW over home, then at LAND_SPEED; a failsafe's LAND waits first."""
        state, p = self.state, self.parameters
        height_m = state.home_m[rows, 2] - sensors.position_m[rows, 2]
        set_m_s, slow_m_s = CM * p["LAND_SPEED_HIGH"][rows], CM * p["LAND_SPEED"][rows]
        fast_m_s = np.where(set_m_s > 0.0, set_m_s, CM * p["WPNAV_SPEED_DN"][rows])
        sink_m_s = np.where(height_m > CM * p["LAND_ALT_LOW"][rows], fast_m_s, slow_m_s)
        sink_m_s = np.where(state.now_s >= state.sink_after_s[rows], sink_m_s, 0.0)
        drift_m_s = np.where(state.position_ok[rows], 0.0, BLIND_DRIFT_M_S)
        return np.column_stack([drift_m_s, np.zeros(len(rows)), sink_m_s])

    def _by_hand(self, rows: Rows, _sensors: Sensors) -> Array:
        """Follow the sticks; without a pilot the throttle is low (habit 14)."""
        piloted = self.state.piloted[rows, np.newaxis]
        return np.where(piloted, self.state.stick_m_s[rows], (0.0, 0.0, THROTTLE_LOW_M_S))


def _wrapped(angle_rad: Array) -> Array:
    wrapped_rad: Array = np.remainder(angle_rad + np.pi, 2.0 * np.pi) - np.pi
    return wrapped_rad
