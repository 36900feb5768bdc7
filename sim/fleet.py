"""The vehicles of one process: bodies, estimates and autopilots under one clock. Sans-I/O."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pymap3d

from sim import dynamics, noise
from sim.autopilot import Autopilot
from sim.params import Parameters
from sim.sensed import Sensed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim.dynamics import Array
    from sim.params import Value

STEP_S = 0.01


@dataclass(frozen=True, slots=True)
class Origin:
    """Where the common NED frame starts: degrees, and metres above mean sea level."""

    latitude_deg: float = 47.397742
    longitude_deg: float = 8.545594
    altitude_amsl_m: float = 488.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """What a fleet is like. Vehicle i stands at row i // columns, column i % columns of a grid."""

    count: int = 1
    first: int = 0
    seed: int = 0
    noise_scale: float = 1.0
    drag_per_s: float = 1.0
    wind_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    origin: Origin = Origin()
    spacing_m: float = 4.0
    grid_columns: int = 1
    heading_deg: float = 0.0
    endurance_s: float = 1200.0
    parameters: Mapping[str, Value] = field(default_factory=dict)


class Fleet:
    """Steps all vehicles together; the arrays' row i belongs to autopilots[i]."""

    def __init__(self, settings: Settings, *, start_s: float, unix_at_start_s: float = 0.0) -> None:
        """Place the vehicles on their grid and boot them at start_s.

        Every autopilot has a random stream of its own, by its index. The estimate errors are drawn together,
        by seed and first index, so that processes that share a seed differ.

        Raises:
            ParameterError: settings name a parameter or value that PX4 does not take.
        """
        self.settings = settings
        self.time_s = start_s
        self._start_s, self._steps = start_s, 0
        self._response = dynamics.Response(drag_per_s=settings.drag_per_s)
        self._wind_m_s = np.array(settings.wind_m_s)
        indices = range(settings.first, settings.first + settings.count)
        grid_m = [(*divmod(i, settings.grid_columns), 0.0) for i in indices]
        self.bodies = dynamics.PointMasses.at(settings.spacing_m * np.array(grid_m, dtype=np.float64))
        seeds = [np.random.SeedSequence(settings.seed, spawn_key=(i,)) for i in indices]
        self._random = np.random.default_rng(
            np.random.SeedSequence(settings.seed, spawn_key=(settings.first, 1))
        )
        self._error = noise.draw(settings.count, settings.noise_scale, self._random)
        self.autopilots = [
            Autopilot(
                i + 1,
                Parameters({**settings.parameters, "MAV_SYS_ID": i + 1}),
                now_s=start_s,
                random=np.random.default_rng(seed),
                unix_at_start_s=unix_at_start_s,
                yaw_rad=math.remainder(math.radians(settings.heading_deg), math.tau),
                endurance_s=settings.endurance_s,
            )
            for i, seed in zip(indices, seeds, strict=True)
        ]
        self._local_origin_m = np.full((settings.count, 3), np.nan)
        self._contact = np.ones(settings.count, dtype=np.bool_)

    def step(self) -> None:
        """Let STEP_S pass for everyone."""
        self._steps += 1
        self.time_s = self._start_s + self._steps * STEP_S
        self._error = noise.step(self._error, STEP_S, self.settings.noise_scale, self._random)
        demands = [
            autopilot.advance(self.time_s, STEP_S, sensed)
            for autopilot, sensed in zip(self.autopilots, self._sense(), strict=True)
        ]
        bodies = dynamics.step(
            self.bodies,
            np.array([demand.velocity_m_s for demand in demands]),
            STEP_S,
            self._response,
            wind_m_s=self._wind_m_s,
            velocity_error_m_s=self._error.velocity_m_s,
            powered=np.array([demand.powered for demand in demands]),
        )
        self.bodies, self._contact = dynamics.rest_on_ground(bodies)

    def _sense(self) -> list[Sensed | None]:
        """Every vehicle's estimate; its local origin is its first one."""
        estimate_m = self.bodies.position_m + self._error.position_m
        velocity_m_s = (
            np.where(self._contact[:, np.newaxis], 0.0, self.bodies.velocity_m_s) + self._error.velocity_m_s
        )
        fixed = np.array([self.time_s >= autopilot.fix_at_s for autopilot in self.autopilots])
        fresh = fixed & np.isnan(self._local_origin_m[:, 0])
        self._local_origin_m[fresh] = estimate_m[fresh]
        return [
            Sensed(
                position_m, velocity, acceleration, latitude_deg, longitude_deg, altitude_m, height_m, contact
            )
            if has_fix
            else None
            for (
                has_fix,
                position_m,
                velocity,
                acceleration,
                (latitude_deg, longitude_deg, altitude_m),
                height_m,
                contact,
            ) in zip(
                fixed.tolist(),
                map(tuple, (estimate_m - self._local_origin_m).tolist()),
                map(tuple, velocity_m_s.tolist()),
                map(tuple, self.bodies.acceleration_m_s2.tolist()),
                self.geodetic(estimate_m).tolist(),
                (-self.bodies.position_m[:, 2]).tolist(),
                self._contact.tolist(),
                strict=True,
            )
        ]

    def geodetic(self, position_m: Array) -> Array:
        """(n, 3) common NED to (n, 3): latitude and longitude in degrees, altitude AMSL in metres."""
        origin = self.settings.origin
        place = pymap3d.ned2geodetic(
            *position_m.T, origin.latitude_deg, origin.longitude_deg, origin.altitude_amsl_m
        )
        return np.stack(place, axis=1)
