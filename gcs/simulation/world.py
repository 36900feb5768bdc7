"""The simulated world: true states, autopilots without a station, wind, links, also of neighbours. Seeded."""

from collections import deque
from math import exp, sqrt

import numpy as np
from numpy.typing import NDArray

from gcs.config.sections import OperationSettings
from gcs.estimation.fleet_state import BRAKES_S, FLIES_ON_S, brought_forward
from gcs.formation.neighbours import Belief, NeighbourMessages, NeighboursSettings, Sight, agree, range_m
from gcs.formation.orbit import Center
from gcs.model.state import Array, FleetState, Mask, Setpoints, VehicleId
from gcs.planning.lost_space import return_heights_m
from gcs.safety.walls import Fence
from gcs.sim.vehicle.guidance import Guidance
from gcs.sim.vehicle.parameters import Columns
from gcs.sim.vehicle.px4 import Mode, Parameters, Quirks
from gcs.sim.vehicle.sensors import Sensors, draw_errors, step_errors
from gcs.sim.vehicle.state import State
from gcs.simulation.autopilots import bodies_of
from gcs.simulation.scenario import Radio, World

LONGEST_STEP_S = 1.0 / 60.0
"""Longest step of the integration; `sim.vehicle.dynamics` allows 0.02 s."""

TOUCHDOWN_M_S = 0.7
"""Descent in PX4's LAND (MPC_LAND_SPEED)."""

LIFTED_M = 0.5
"""From this height on, a vehicle that took off has landed where it touches the ground."""

ALONE_IN = {"descend": Mode.POSITION, "hold": Mode.HOLD, "land": Mode.LAND, "return": Mode.RETURN}
"""PX4's mode for each action of `operation.setpoint_loss_action`; without a pilot POSITION descends."""


def _return_heights_m(home_m: Array) -> Array:
    """(n,) RTL_RETURN_ALT of a fleet that is listed from the inner to the outer pads (n, 3)."""
    operation, fence = OperationSettings(), Fence()
    heights_m = return_heights_m(
        len(home_m), operation.return_height_m, operation.return_layer_m, fence.height_max_m
    )
    outwards = np.argsort(np.hypot(*(home_m - home_m.mean(axis=0))[:, :2].T), kind="stable")
    of_each_m = np.empty_like(heights_m)
    of_each_m[outwards] = heights_m
    return of_each_m


class Autopilots:
    """PX4's own modes of vehicles without a station, as the fake fleet flies them."""

    def __init__(self, home_m: Array, return_height_m: Array) -> None:
        """`home_m` (n, 3), show frame: where they return to, at least `return_height_m` (n,) above it."""
        n = len(home_m)
        parameters = Columns(
            [Parameters({"RTL_RETURN_ALT": height_m, "RTL_CONE_ANG": 0}) for height_m in return_height_m]
        )
        self.alone: Mask = np.zeros(n, dtype=bool)
        self._state = State(n, 0.0)
        self._state.armed[:], self._state.landed[:] = True, False
        self._state.home_m[:] = home_m
        self._guidance = Guidance(self._state, (), parameters, Quirks())

    def begin(self, rows: Mask, mode: Mode) -> None:
        """Let the vehicles in `rows` (n,) fly by themselves from now on."""
        self.alone = self.alone | rows
        self._state.mode[rows] = mode.number

    def end(self, rows: Mask) -> None:
        """Let the station lead the vehicles in `rows` (n,) again."""
        self.alone = self.alone & ~rows

    def velocity(self, position_m: Array, velocity_m_s: Array, now_s: float, dt_s: float) -> Array:
        """(n, 3) what the modes demand of the velocity loops, from (n, 3) estimates; called every step."""
        self._state.now_s = now_s
        on_ground = np.zeros(len(position_m), dtype=bool)
        height_m = -position_m[:, 2]
        places = position_m, position_m  # estimated and received
        sensors = Sensors(position_m, velocity_m_s, velocity_m_s, height_m, on_ground, *places, np.array)
        return self._guidance.velocity(sensors, self.alone, dt_s)


def wander(value: Array, share: float, deviation: float, random: np.random.Generator) -> None:
    """Advance a first-order Gauss-Markov process in place by `share` of its correlation time."""
    keep = exp(-share)
    value *= keep
    value += deviation * sqrt(1.0 - keep * keep) * random.standard_normal(value.shape)


class TrueWorld:
    """True states of n vehicles, and their links to the ground station. All vehicles hover at first."""

    def __init__(self, start_m: Array, world: World, seed: int) -> None:
        """`start_m` (n, 3), show frame: all vehicles hover there, and their telemetry is new."""
        n = len(start_m)
        self._random = np.random.default_rng(seed)
        self._world = world
        self.tick_s = 1.0 / world.tick_rate_hz
        self._steps = int(np.ceil(self.tick_s / LONGEST_STEP_S - 1e-9))
        self.step_s = self.tick_s / self._steps
        self.ids: tuple[VehicleId, ...] = tuple(f"d{i + 1}" for i in range(n))
        self.row_of = {name: row for row, name in enumerate(self.ids)}
        self.time_s = 0.0
        self.bodies = bodies_of(start_m, world, self.step_s, self._random)
        self._gust_m_s = world.wind.gust_m_s * self._random.standard_normal((n, 3))  # once the wind has risen
        self._error = draw_errors(n, world.noise, self._random)
        self.reset_m = np.zeros((n, 3))  # by which estimators were reset, to where the vehicles are not
        self._slow = np.random.default_rng([seed, 2])  # of the bias: all else is as without it
        self._bias_m = world.bias_m * self._slow.standard_normal((n, 3))
        slow = np.random.default_rng([seed, 3]).permutation(n) < round(world.slow_share * n)
        self._speed_max_m_s = np.where(slow, world.slow_m_s, np.inf)
        self.in_air: Mask = np.ones(n, dtype=bool)
        self.ground_m = np.zeros(n)  # z of the ground below each
        self.home_m = start_m * (1.0, 1.0, 0.0)
        self.return_height_m = _return_heights_m(self.home_m)
        self.autopilots = Autopilots(self.home_m, self.return_height_m)
        self._gone: Mask = np.zeros(n, dtype=bool)
        self._silent: Mask = np.zeros(n, dtype=bool)
        self._cut = False  # whether a link was
        self._rest_m = np.full((n, 3), np.nan)  # positions of landed vehicles
        self._held_m = np.full((n, 3), np.nan)  # positions of vehicles that something holds
        self._some_rest = False  # whether one of these has been set
        self._lifts: Mask = np.zeros(n, dtype=bool)  # take off, and may touch the ground still
        self._command_m_s = np.zeros((n, 3))
        self.received_m, self.received_m_s = self.estimate()  # (n, 3) as last received
        self._received_s = np.zeros(n)
        self._telemetry: deque[tuple[float, Mask, Array, Array]] = deque()
        self._setpoints: deque[tuple[float, Array]] = deque()

    @property
    def position_m(self) -> Array:
        """(n, 3) true values, show frame."""
        return self.bodies.position_m

    @property
    def velocity_m_s(self) -> Array:
        """(n, 3) true values, show frame."""
        return self.bodies.velocity_m_s

    def estimate(self) -> tuple[Array, Array]:
        """(n, 3) positions and (n, 3) velocities, as estimated by the vehicles."""
        error = self._error
        position_m = self.bodies.position_m + error.position_m + self._bias_m + self.reset_m
        return position_m, self.bodies.velocity_m_s + error.velocity_m_s

    @property
    def seldom(self) -> bool:
        """Whether vehicles send less often than once a tick."""
        return self._world.telemetry_hz < self._world.tick_rate_hz

    def kept(self) -> Mask:
        """(n,) vehicles with telemetry of this tick that is sent and not lost; called once a tick."""
        n, world, kept = len(self.ids), self._world, ~self._silent
        if world.loss:
            kept &= self._random.random(n) >= world.loss
        if self.seldom:
            now = self.time_s * world.telemetry_hz + np.arange(n) / n
            kept &= np.floor(now + 1e-9) > np.floor(now - world.telemetry_hz * self.tick_s + 1e-9)
        return kept

    def receive(self, asked_m_s: Array | None = None) -> FleetState:  # noqa: ARG002  (all report truly)
        """Receive telemetry. Returns: the state, extrapolated from arrival with the reported velocity.

        `asked_m_s` (n, 3): what the station sent last; NaN: no setpoint.
        """
        position_m, velocity_m_s = self.estimate()
        n, world, kept, seldom = len(self.ids), self._world, self.kept(), self.seldom
        self._telemetry.append((self.time_s + world.telemetry_delay_s, kept, position_m, velocity_m_s))
        while self._telemetry and self._telemetry[0][0] <= self.time_s + 1e-9:
            _, arrived, position_m, velocity_m_s = self._telemetry.popleft()
            if not (world.loss or seldom or self._cut):
                self.received_m, self.received_m_s = position_m, velocity_m_s
                self._received_s = np.full(n, self.time_s)
                continue
            rows = arrived[:, None]
            self.received_m = np.where(rows, position_m, self.received_m)
            self.received_m_s = np.where(rows, velocity_m_s, self.received_m_s)
            self._received_s = np.where(arrived, self.time_s, self._received_s)
        received, there = (self.received_m, self._received_s, self.received_m_s), ~self._gone
        forward_m, forward_m_s, age_s = brought_forward(self.time_s, *received, there, FLIES_ON_S, BRAKES_S)
        forward_m[self._gone] = np.nan
        return FleetState(self.time_s, self.ids, forward_m, forward_m_s, np.zeros(n), age_s)

    def sample_age_s(self, now_s: float) -> Array:
        """(n,) since each newest position arrived."""
        return np.asarray(now_s - self._received_s)

    def of_all(self, setpoints: Setpoints) -> Array:
        """(n, 3) velocities, NaN of vehicles that get no setpoint; a copy."""
        if setpoints.ids == self.ids:
            return np.array(setpoints.velocity_m_s)
        all_m_s = np.full((len(self.ids), 3), np.nan)
        all_m_s[[self.row_of[name] for name in setpoints.ids]] = setpoints.velocity_m_s
        return all_m_s

    def send(self, setpoints: Setpoints) -> None:
        """Send setpoints; the world delays all and loses some."""
        world, sent_m_s = self._world, self.of_all(setpoints)
        if world.loss:
            sent_m_s[self._random.random(len(sent_m_s)) < world.loss] = np.nan
        sent_m_s[self._silent] = np.nan
        self._setpoints.append((self.time_s + world.setpoint_delay_s, sent_m_s))

    def leave_to_themselves(self, rows: Mask, sinking_m_s: float) -> None:
        """Stop commanding the vehicles in `rows` (n,): they touch down at that speed where they are."""
        self._command_m_s[rows] = 0.0
        self._command_m_s[rows, 2] = sinking_m_s
        for _, sent_m_s in self._setpoints:
            sent_m_s[rows] = np.nan

    def stand(self, rows: Mask) -> None:
        """Have the vehicles in `rows` (n,) stand where they are, with their motors off."""
        self.in_air = self.in_air & ~rows
        self._rest_m[rows] = self.bodies.position_m[rows]
        self.ground_m[rows] = self.bodies.position_m[rows, 2]
        self._some_rest = True

    def take_off(self, rows: Mask, climb_m_s: float) -> None:
        """Let vehicles that stand climb straight up at that speed, until they are commanded."""
        self.in_air, self._lifts = self.in_air | rows, self._lifts | rows
        self._rest_m[rows] = np.nan
        self.leave_to_themselves(rows, -climb_m_s)

    def cut_links(self, rows: Mask) -> None:
        """End telemetry and setpoints of the vehicles in `rows` (n,); they keep their last setpoint."""
        self._silent, self._cut = self._silent | rows, True
        for _, sent_m_s in self._setpoints:
            sent_m_s[rows] = np.nan

    def fly_alone(self, rows: Mask, action: str) -> None:
        """Let the autopilots of the vehicles in `rows` (n,) execute an action of `ALONE_IN` from now on."""
        self.autopilots.begin(rows, ALONE_IN[action])
        for _, sent_m_s in self._setpoints:
            sent_m_s[rows] = np.nan

    def remove(self, rows: Mask) -> None:
        """Remove vehicles: they are no longer airborne, and send no more telemetry."""
        self._gone = self._gone | rows
        self.in_air = self.in_air & ~rows

    def hold(self, row: int, place_m: Array | None) -> None:
        """Hold that vehicle at a place (3,), whatever it is commanded; None: let it go."""
        self._held_m[row] = np.nan if place_m is None else place_m
        self._some_rest = True

    def advance(self) -> list[Array]:
        """Advance by one tick. Returns: the true positions (n, 3) after every integration step."""
        if self._world.noise:
            self._error = step_errors(self._error, self.tick_s, self._world.noise, self._random)
        if self._world.bias_m:
            wander(self._bias_m, self.tick_s / self._world.bias_time_s, self._world.bias_m, self._slow)
        wind_m_s = self._wind_m_s()
        alone = self.autopilots.alone & self.in_air
        some_alone, seen = np.count_nonzero(alone) > 0, []
        for index in range(self._steps):
            self._obey(self.time_s + index * self.step_s)
            if some_alone:
                self._fly_alone(alone, self.time_s + index * self.step_s)
            seen.append(self.bodies.step(self._flown_m_s(), wind_m_s, self._error.velocity_m_s))
        self.time_s += self.tick_s
        self._touch_ground()
        return seen

    def _wind_m_s(self) -> Array:
        """(n, 3) velocity over the ground: the mean, and independent gusts (first-order Gauss-Markov)."""
        wind = self._world.wind
        if wind.gust_m_s:
            wander(self._gust_m_s, self.tick_s / wind.gust_time_s, wind.gust_m_s, self._random)
        risen = min(1.0, (self.time_s + self.tick_s) / wind.rise_s) if wind.rise_s else 1.0
        mean_m_s = np.array([wind.mean_x_m_s, wind.mean_y_m_s, 0.0])
        return np.asarray(risen * (self._gust_m_s + mean_m_s))

    def _obey(self, now_s: float) -> None:
        while self._setpoints and self._setpoints[0][0] <= now_s + 1e-9:
            sent_m_s = self._setpoints.popleft()[1]
            self._command_m_s = np.where(np.isfinite(sent_m_s), sent_m_s, self._command_m_s)

    def _fly_alone(self, alone: Mask, now_s: float) -> None:
        """Command what the autopilots demand of the vehicles (n,) that fly by themselves."""
        demand_m_s = self.autopilots.velocity(*self.estimate(), now_s, self.step_s)
        self._command_m_s[alone] = demand_m_s[alone]

    def _flown_m_s(self) -> Array:
        """(n, 3) setpoints within each vehicle's own limit, which the ground station does not know."""
        if not self._world.slow_share or self.time_s >= self._world.slow_until_s:
            return self._command_m_s
        level_m_s = np.hypot(self._command_m_s[:, 0], self._command_m_s[:, 1])
        flown_m_s = self._command_m_s.copy()
        flown_m_s[:, :2] *= np.minimum(1.0, self._speed_max_m_s / np.maximum(level_m_s, 1e-9))[:, None]
        return flown_m_s

    def _touch_ground(self) -> None:
        self._lifts = self._lifts & (self.bodies.position_m[:, 2] > self.ground_m - LIFTED_M)
        touching = (self.bodies.position_m[:, 2] >= self.ground_m) & self.in_air & ~self._lifts
        if np.count_nonzero(touching):
            self._rest_m[touching, :2] = self.bodies.position_m[touching, :2]
            self._rest_m[touching, 2] = self.ground_m[touching]
            self.in_air, self._some_rest = self.in_air & ~touching, True
        if not self._some_rest:
            return
        for place_m in (self._rest_m, self._held_m):
            resting = np.isfinite(place_m[:, 0])
            if resting.any():
                self.bodies.rest(resting, place_m)


PLACE, PACE, CENTER, CENTER_PACE = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
DEGREE, SENT = 12, 13
WORDS = 14
"""Numbers in a message: position, velocity, estimated centre and its velocity, number of neighbours, time."""


class Neighbourhood:
    """Received messages of every vehicle, and its estimate of the centre."""

    def __init__(
        self,
        radio: Radio,
        settings: NeighboursSettings,
        charge: Array,
        radius_m: float,
        tick_s: float,
        seed: int,
    ) -> None:
        """`charge` (n,); no message has been sent yet."""
        n = len(charge)
        self._radio, self._charge, self._tick_s = radio, charge, tick_s
        self._range_m = range_m(settings.neighbours, n, radius_m)
        self._sighting_rate = settings.sighting_rate_per_s
        self._random = np.random.default_rng([seed, 2])
        self._newest = np.full((n, n, WORDS), np.nan)  # received by row from column
        self._newest[:, :, SENT] = -np.inf
        self._under_way: deque[tuple[float, Mask, Array]] = deque()  # arrival, receivers, messages
        self._belief = Belief.nothing(n)
        sees = self._random.permutation(n) < max(1, round(radio.sighting_share * n))
        error_m = radio.sighting_error_m * self._random.standard_normal((n, 3))
        self._sighting_error_m = np.where(sees[:, None], error_m, np.nan)

    def exchange(
        self, now_s: float, position_m: Array, velocity_m_s: Array, present: Mask, center: Center | None
    ) -> Sight:
        """Deliver messages, update every vehicle's estimate, and send its next message.

        Args:
            now_s: virtual time.
            position_m: (n, 3) each vehicle's own estimate.
            velocity_m_s: (n, 3) likewise.
            present: (n,) vehicles that send and receive.
            center: the commanded centre, for vehicles that observe it; None before there is one.

        Returns: what each vehicle's law knows now.
        """
        while self._under_way and self._under_way[0][0] <= now_s + 1e-9:
            _, gets, messages = self._under_way.popleft()
            self._newest = np.where(gets[:, :, None], messages[None], self._newest)
        mail, columns = self._mail(now_s)
        age_s = now_s - mail[:, :, SENT, None]
        degree = np.isfinite(mail[:, :, 0]).sum(axis=1).astype(np.float64)
        belief = None
        if self._radio.center == "agreed":
            forward_m = mail[:, :, CENTER] + age_s * mail[:, :, CENTER_PACE]
            received = NeighbourMessages(forward_m, mail[:, :, CENTER_PACE], mail[:, :, DEGREE])
            self._belief = agree(
                self._belief, received, self._sighted(center), self._tick_s, self._sighting_rate
            )
            belief = self._belief
        self._send(now_s, position_m, velocity_m_s, degree, present)
        inbox_m = mail[:, :, PLACE] + age_s * mail[:, :, PACE]
        return Sight(inbox_m, self._charge[columns], self._range_m, belief)

    def _mail(self, now_s: float) -> tuple[Array, NDArray[np.intp]]:
        """(n, k, WORDS) newest recent message of each sender, padded with NaN, and (n, k) sender columns."""
        lately = now_s - self._newest[:, :, SENT] <= self._radio.silence_max_s
        most = max(1, int(lately.sum(axis=1).max(initial=0)))
        columns = np.argsort(~lately, axis=1, kind="stable")[:, :most]
        mail: Array = np.take_along_axis(self._newest, columns[:, :, None], axis=1)
        mail[~np.take_along_axis(lately, columns, axis=1)] = np.nan
        return mail, columns

    def _sighted(self, center: Center | None) -> Belief:
        if center is None:
            return Belief.nothing(len(self._charge))
        unseen = 0.0 * self._sighting_error_m  # NaN for vehicles that do not observe the centre
        return Belief(center.position_m + self._sighting_error_m, center.velocity_m_s + unseen)

    def _send(
        self, now_s: float, position_m: Array, velocity_m_s: Array, degree: Array, present: Mask
    ) -> None:
        belief, sent_s = self._belief, np.full(len(degree), now_s)
        messages = np.column_stack(
            [position_m, velocity_m_s, belief.center_m, belief.velocity_m_s, degree, sent_s]
        )
        apart_m = np.linalg.norm(position_m[:, None] - position_m[None], axis=2)
        gets = (apart_m < self._range_m) & present[:, None] & present[None, :]
        np.fill_diagonal(gets, val=False)
        if self._radio.loss:
            gets &= self._random.random(gets.shape) >= self._radio.loss
        self._under_way.append((now_s + self._radio.delay_s, gets, messages))
