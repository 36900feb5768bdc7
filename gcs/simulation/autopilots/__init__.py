"""The simulated vehicles of each autopilot: how they move, and what their profiles say of that.

A mixed fleet has the autopilots of `World.autopilots` by turns, from the first vehicle on.
"""

from dataclasses import asdict
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gcs.links.autopilots import AUTOPILOTS
from gcs.links.autopilots.ardupilot import ACCELERATION, UPRIGHT_ACCELERATION
from gcs.links.autopilots.px4 import Px4
from gcs.model.response import FleetResponse
from gcs.model.state import Array, Mask
from gcs.sim.autopilots.ardupilot.response import Copters, Response
from gcs.simulation.scenario import World
from gcs.simulation.vehicles import Vehicles

ALIKE = frozenset({"filter_hz", "tilt_max_m_s2"})
"""Settings of the response in which vehicles do not differ."""


class Bodies(Protocol):
    """True states of n vehicles."""

    @property
    def position_m(self) -> Array:
        """(n, 3)."""

    @property
    def velocity_m_s(self) -> Array:
        """(n, 3) over ground."""

    def step(self, command_m_s: Array, wind_m_s: Array, error_m_s: Array) -> Array:
        """See `Vehicles.step`."""

    def rest(self, rows: Mask, place_m: Array) -> None:
        """See `Vehicles.rest`."""


def bodies_of(start_m: Array, world: World, step_s: float, random: np.random.Generator) -> Bodies:
    """Vehicles that hover at `start_m` (n, 3): of one autopilot, or of several by turns."""
    names = [world.autopilot_of(row) for row in range(len(start_m))]
    fitted = np.array([name == Px4.name for name in names])
    if fitted.all():
        return Vehicles(start_m, world, step_s, random)
    if not fitted.any():
        return RampedVehicles(start_m, world, step_s, random)
    own, others = np.flatnonzero(fitted), np.flatnonzero(~fitted)
    ramped = RampedVehicles(start_m[others], world, step_s, random)
    return MixedVehicles(((own, Vehicles(start_m[own], world, step_s, random)), (others, ramped)))


def responses(world: World, count: int) -> FleetResponse:
    """What the profiles say of `count` vehicles of such a world, with their parameters as read."""
    read = {ACCELERATION: world.ramp_m_s2, UPRIGHT_ACCELERATION: world.upright_ramp_m_s2}
    return FleetResponse.of([AUTOPILOTS[world.autopilot_of(row)].response(read) for row in range(count)])


class RampedVehicles:
    """Vehicles that respond as `sim.autopilots.ardupilot.response`, each a little different."""

    def __init__(self, start_m: Array, world: World, step_s: float, random: np.random.Generator) -> None:
        """All hover at `start_m` (n, 3): their integrators compensate the mean wind."""
        n = len(start_m)
        spread = world.response_spread
        gains = {
            name: value if name in ALIKE else value * (1.0 + spread * random.uniform(-1.0, 1.0, n))
            for name, value in asdict(Response()).items()
        }
        self._copters = Copters(start_m, step_s, Response(**gains))
        self._copters.target_m = np.array(start_m)
        ramps_m_s2 = np.array([world.ramp_m_s2, world.upright_ramp_m_s2])
        self._limits_m_s2 = np.tile(world.ramp_share * ramps_m_s2, (n, 1))
        mean_m_s = np.array([world.wind.mean_x_m_s, world.wind.mean_y_m_s, 0.0])
        self._copters.hold_against(mean_m_s * (world.wind.rise_s == 0.0))  # else calm at first
        self._resting = np.zeros(n, dtype=np.bool_)

    @property
    def position_m(self) -> Array:
        """(n, 3)."""
        return self._copters.position_m

    @property
    def velocity_m_s(self) -> Array:
        """(n, 3) over ground."""
        return self._copters.velocity_m_s

    def step(self, command_m_s: Array, wind_m_s: Array, error_m_s: Array) -> Array:
        """See `Vehicles.step`. Their own positions are true: a slow error of theirs moves no setpoint."""
        copters = self._copters
        velocity_m_s = copters.velocity_m_s + error_m_s
        copters.step(
            command_m_s,
            self._limits_m_s2,
            copters.position_m,
            velocity_m_s,
            wind_m_s=wind_m_s,
            resting=self._resting,
        )
        return copters.position_m.copy()

    def rest(self, rows: Mask, place_m: Array) -> None:
        """See `Vehicles.rest`."""
        some, copters = rows[:, None], self._copters
        copters.position_m = np.where(some, place_m, copters.position_m)
        copters.velocity_m_s = np.where(some, 0.0, copters.velocity_m_s)
        copters.acceleration_m_s2 = np.where(some, 0.0, copters.acceleration_m_s2)
        copters.integral_m_s2 = np.where(some, 0.0, copters.integral_m_s2)
        copters.start(rows, copters.position_m, copters.velocity_m_s)


class MixedVehicles:
    """Several kinds of vehicles as one fleet."""

    def __init__(self, parts: tuple[tuple[NDArray[np.intp], Bodies], ...]) -> None:
        """`parts`: the rows (m,) of each kind, and its m vehicles."""
        self._parts = parts
        self._count = sum(len(rows) for rows, _ in parts)

    @property
    def position_m(self) -> Array:
        """(n, 3)."""
        return self._whole([bodies.position_m for _, bodies in self._parts])

    @property
    def velocity_m_s(self) -> Array:
        """(n, 3) over ground."""
        return self._whole([bodies.velocity_m_s for _, bodies in self._parts])

    def step(self, command_m_s: Array, wind_m_s: Array, error_m_s: Array) -> Array:
        """See `Vehicles.step`."""
        wind_m_s, error_m_s = (np.broadcast_to(values, command_m_s.shape) for values in (wind_m_s, error_m_s))
        return self._whole(
            [bodies.step(command_m_s[rows], wind_m_s[rows], error_m_s[rows]) for rows, bodies in self._parts]
        )

    def rest(self, rows: Mask, place_m: Array) -> None:
        """See `Vehicles.rest`."""
        for own, bodies in self._parts:
            bodies.rest(rows[own], place_m[own])

    def _whole(self, values: list[Array]) -> Array:
        whole = np.empty((self._count, 3))
        for (rows, _), part in zip(self._parts, values, strict=True):
            whole[rows] = part
        return whole
