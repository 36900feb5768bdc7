"""Where a vehicle would hit the ground if its motors stopped now: it falls through air that moves. Pure.

    v' = g - k |v - w| (v - w),   k = rho Cd A / (2 m)                  w: the wind, constant and level

In a frame that moves with the wind there is none. So one table of falls, over height, speed through the air
and vertical speed, holds for every constant wind: what a fall covers over the ground is its way through the
air, and the way of the wind meanwhile. The table that flies is made of it for winds that may come from every
side: the disc that holds all places of impact.

Source: second-order drag as in JARUS SORA Annex F (A. la Cour-Harbo, Ground impact probability distribution
for small unmanned aircraft in ballistic descent, ICUAS 2020), which has no wind; Runge-Kutta of fourth order.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Final, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from gcs.model.jit import kernel
from gcs.model.settings import NotNegative, Settings
from gcs.model.state import TINY, Array

GRAVITY_M_S2: Final = 9.80665
AIR_KG_M3: Final = 1.225
"""At sea level, 15 degrees; a vehicle falls slower, and is carried farther by wind, in denser air."""

TERMINAL_M_S: Final = (4.0, 120.0)
"""Speeds of fall that are believed of a vehicle; others are a typing error in mass or drag."""

DRAG_SHARE: Final = 0.04
"""So much farther through the air than computed a vehicle may come: its drag is not known better."""


class Airframe(Settings):
    """What of a vehicle decides how it falls: all of it, or nothing."""

    mass_kg: Annotated[float, Field(ge=0.05, le=100.0)]
    """Of the vehicle as it flies, in kg."""
    drag_area_m2: Annotated[float, Field(ge=0.0005, le=5.0)]
    """Drag coefficient times frontal area of a vehicle that tumbles, in m^2."""
    dimension_m: Annotated[float, Field(ge=0.05, le=8.0)]
    """Greatest extent from tip to tip, in m; half of it counts from where its centre falls."""

    @property
    def drag_per_m(self) -> float:
        """K of the equation above, in 1/m."""
        return 0.5 * AIR_KG_M3 * self.drag_area_m2 / self.mass_kg

    @property
    def terminal_m_s(self) -> float:
        """The speed of its fall in the end."""
        return float(np.sqrt(GRAVITY_M_S2 / self.drag_per_m))

    @model_validator(mode="after")
    def _falls_as_vehicles_do(self) -> "Airframe":
        least_m_s, most_m_s = TERMINAL_M_S
        if not least_m_s <= self.terminal_m_s <= most_m_s:
            raise ValueError(
                f"mass_kg = {self.mass_kg:g} and drag_area_m2 = {self.drag_area_m2:g} fall at"
                f" {self.terminal_m_s:.1f} m/s in the end: {least_m_s:g} to {most_m_s:g} m/s"
            )
        return self


SIMULATED: Final = Airframe(mass_kg=1.5, drag_area_m2=0.04, dimension_m=0.55)
"""The quadrotor of PX4's simulator. It stands for vehicles that were not weighed; preflight refuses these."""


class ImpactSettings(Settings):
    """Where vehicles may fall: what is known of them and of the wind, and the lines inside the edge."""

    airframe: Airframe | None = None
    """How the vehicles of this fleet fall; weigh and measure the one that comes farthest. Without it falls
    are those of PX4's simulator (1.5 kg, 0.04 m^2, 0.55 m): no start over controlled ground passes preflight.
    """
    wind_max_m_s: Annotated[float, Field(ge=0.0, le=25.0)] = 8.0
    """Greatest wind with gusts in which the fleet flies, in m/s; it counts from every direction."""
    reaction_s: Annotated[float, Field(ge=0.0, le=10.0)] = 1.0
    """So long a vehicle flies on before its motors stop, in s."""
    ground_m: Annotated[float, Field(ge=-500.0, le=500.0)] = 0.0
    """Lowest ground of the controlled area above the origin, in m; negative where it falls away."""
    soft_m: NotNegative = 2.0
    """The safety filter keeps impacts so far inside the edge of the controlled ground, in m."""
    hard_m: NotNegative = 1.0
    """An impact nearer to the edge is an alarm, and counted, in m; at the edge it is an emergency."""

    @property
    def falling(self) -> Airframe:
        """The vehicle whose falls are computed."""
        return self.airframe or SIMULATED

    @model_validator(mode="after")
    def _are_in_order(self) -> "ImpactSettings":
        if self.hard_m > self.soft_m:
            raise ValueError(f"hard_m = {self.hard_m:g}: at most soft_m = {self.soft_m:g}")
        return self


WIND_STEP_M_S: Final = 4.0
WIND_MAX_M_S: Final = 25.0
"""Tables are made for the greatest wind of the settings, and for stronger ones in these steps up to this."""


def winds_of(settings: ImpactSettings) -> tuple[float, ...]:
    """The winds for which there are tables, the weakest first."""
    stronger = np.arange(settings.wind_max_m_s + WIND_STEP_M_S, WIND_MAX_M_S, WIND_STEP_M_S)
    return tuple(dict.fromkeys((settings.wind_max_m_s, *stronger.tolist(), WIND_MAX_M_S)))


def in_wind(settings: ImpactSettings, wind_m_s: float) -> ImpactSettings:
    """These settings; for a wind that reaches more than theirs, those of the next stronger table."""
    if not wind_m_s > settings.wind_max_m_s:
        return settings
    winds = winds_of(settings)
    return _of_wind(settings, next((each for each in winds if each >= wind_m_s), winds[-1]))


@lru_cache(maxsize=32)
def _of_wind(settings: ImpactSettings, wind_m_s: float) -> ImpactSettings:
    return settings.model_copy(update={"wind_max_m_s": wind_m_s})


HEIGHT_MAX_M: Final = 500.0
"""Greatest height of the tables."""

HEIGHT_STEP: Final = 0.4
"""Between heights, in the square root of a metre: a fall takes the root of its height."""

SPEED_STEP_M_S: Final = 1.0
"""Between speeds, level and up or down."""

AIR_SPEED_MAX_M_S, SPEED_MAX_M_S, CLIMB_MAX_M_S = 50.0, 24.0, 8.0
"""Greatest speeds of the tables: through the air, over the ground, and up or down. Beyond them they go on
straight, which is too far: drag grows faster than the speed. One that sinks faster falls no farther.
"""

BELIEVED_M_S: Final = 100.0
"""A greater measured speed, and one without end, is taken for this: rows and alarms of the ground stay."""

HEIGHTS: Final = np.arange(0.0, np.sqrt(HEIGHT_MAX_M) + HEIGHT_STEP, HEIGHT_STEP) ** 2
AIR_SPEEDS: Final = np.arange(0.0, AIR_SPEED_MAX_M_S + SPEED_STEP_M_S, SPEED_STEP_M_S)
SPEEDS: Final = np.arange(0.0, SPEED_MAX_M_S + SPEED_STEP_M_S, SPEED_STEP_M_S)
CLIMBS: Final = np.arange(-CLIMB_MAX_M_S, CLIMB_MAX_M_S + SPEED_STEP_M_S, SPEED_STEP_M_S)
"""Downwards positive."""

STEP_SHARE: Final = 0.02
"""A step of the integration, as a share of the time in which free fall reaches the final speed."""

ANGLES: Final = 32
"""Directions of the wind that are tried; between two of them a disc bulges by half a per cent."""

GROWTH_MAX: Final = 2.0
"""Steepest growth that counts; on the ground itself the disc begins to grow at once."""

SPARE: Final = 1.5
"""Factor on the errors between the nodes of a table, as the table itself shows them."""


class Falls(NamedTuple):
    """Falls through still air, by height, speed and vertical speed: (HEIGHTS, AIR_SPEEDS, CLIMBS)."""

    way_m: Array
    fall_s: Array
    level_m_s: Array  # at the impact
    down_m_s: Array


AHEAD, SPREAD, GROWTH, FALL, SPEED = range(5)
"""Layers of `Reach`: how far ahead the disc of impacts has its middle, its radius, by how much that grows for
each metre of height, the longest fall in s, and the fastest impact in m/s.
"""

Reach = Array
"""(HEIGHTS, SPEEDS, CLIMBS, 5)."""


@lru_cache(maxsize=8)
def falls_of(airframe: Airframe) -> Falls:
    """The table of falls through still air."""
    terminal_m_s = airframe.terminal_m_s
    step_s = STEP_SHARE * terminal_m_s / GRAVITY_M_S2
    return Falls(*_fallen(airframe.drag_per_m, step_s, HEIGHTS, AIR_SPEEDS, CLIMBS))


@kernel
def _fallen(
    drag_per_m: float, step_s: float, height_m: Array, speed_m_s: Array, down_m_s: Array
) -> tuple[Array, Array, Array, Array]:
    """Way, time, and both speeds at the impact, (h, s, v) each; see `Falls`."""
    shape = (len(height_m), len(speed_m_s), len(down_m_s))
    way, took, level, down = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape)
    for s in range(len(speed_m_s)):
        for v in range(len(down_m_s)):
            x, z, u, w, now_s, at = 0.0, 0.0, speed_m_s[s], down_m_s[v], 0.0, 0
            if w >= 0.0:
                level[0, s, v], down[0, s, v], at = u, w, 1
            while at < len(height_m):
                u_next, w_next, x_next, z_next = _stepped(drag_per_m, step_s, x, z, u, w)
                while at < len(height_m) and w_next > 0.0 and z_next >= height_m[at]:
                    share = _crossing(z, z_next, w, w_next, step_s, height_m[at])
                    part_s = share * step_s
                    u_then, w_then, x_then, _ = _stepped(drag_per_m, part_s, x, z, u, w)
                    way[at, s, v], took[at, s, v] = x_then, now_s + part_s
                    level[at, s, v], down[at, s, v] = u_then, w_then
                    at += 1
                x, z, u, w, now_s = x_next, z_next, u_next, w_next, now_s + step_s
    return way, took, level, down


@kernel
def _pull(drag_per_m: float, u: float, w: float) -> tuple[float, float]:
    """Accelerations, level and down, of a vehicle with these speeds through the air."""
    drag = drag_per_m * np.sqrt(u * u + w * w)
    return -drag * u, GRAVITY_M_S2 - drag * w


@kernel
def _stepped(
    drag_per_m: float, dt_s: float, x: float, z: float, u: float, w: float
) -> tuple[float, float, float, float]:
    """Speeds, way and depth after a step of Runge and Kutta."""
    a1, b1 = _pull(drag_per_m, u, w)
    u2, w2 = u + 0.5 * dt_s * a1, w + 0.5 * dt_s * b1
    a2, b2 = _pull(drag_per_m, u2, w2)
    u3, w3 = u + 0.5 * dt_s * a2, w + 0.5 * dt_s * b2
    a3, b3 = _pull(drag_per_m, u3, w3)
    u4, w4 = u + dt_s * a3, w + dt_s * b3
    a4, b4 = _pull(drag_per_m, u4, w4)
    sixth = dt_s / 6.0
    return (
        u + sixth * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
        w + sixth * (b1 + 2.0 * b2 + 2.0 * b3 + b4),
        x + sixth * (u + 2.0 * u2 + 2.0 * u3 + u4),
        z + sixth * (w + 2.0 * w2 + 2.0 * w3 + w4),
    )


@kernel
def _crossing(z: float, z_next: float, w: float, w_next: float, step_s: float, height_m: float) -> float:
    """The share of a step after which a depth is passed, by the cubic through both ends."""
    low, high = 0.0, 1.0
    for _ in range(40):
        t = 0.5 * (low + high)
        depth = (2 * t**3 - 3 * t**2 + 1) * z + (t**3 - 2 * t**2 + t) * step_s * w
        depth += (3 * t**2 - 2 * t**3) * z_next + (t**3 - t**2) * step_s * w_next
        if depth < height_m:
            low = t
        else:
            high = t
    return high


@lru_cache(maxsize=32)
def reach_of(airframe: Airframe, wind_max_m_s: float) -> Reach:
    """The discs that hold all impacts in winds up to this from every direction; built once, in about 0.1 s.

    A vehicle flies along with each of SPEEDS over the ground. Half of its dimension is in the discs.
    """
    falls = falls_of(airframe)
    reach = np.zeros((len(HEIGHTS), len(SPEEDS), len(CLIMBS), 5))
    turn_rad = 2.0 * np.pi * np.arange(ANGLES) / ANGLES
    winds = np.concatenate([share * wind_max_m_s * np.exp(1j * turn_rad) for share in (0.0, 0.5, 1.0)])
    bulge = 1.0 / np.cos(np.pi / ANGLES) - 1.0
    for at, speed_m_s in enumerate(SPEEDS.tolist()):
        through = speed_m_s - winds
        air_m_s = np.abs(through)
        way_m, fall_s, level_m_s, down_m_s = (_between(each, air_m_s) for each in falls)
        course = through / np.maximum(air_m_s, TINY)
        place_m = winds[:, None, None] * fall_s + course[:, None, None] * way_m  # (winds, h, v)
        hit_m_s = np.abs(winds[:, None, None] + course[:, None, None] * level_m_s)
        along_m = place_m.real
        ahead_m = 0.5 * (along_m.max(axis=0) + along_m.min(axis=0))
        spread_m = np.abs(place_m - ahead_m).max(axis=0) * (1.0 + bulge) + DRAG_SHARE * way_m.max(axis=0)
        reach[:, at, :, AHEAD], reach[:, at, :, SPREAD] = ahead_m, spread_m
        reach[:, at, :, FALL] = fall_s.max(axis=0)
        reach[:, at, :, SPEED] = np.hypot(hit_m_s, down_m_s).max(axis=0)
    reach[..., SPREAD] += _unevenness(reach) + 0.5 * airframe.dimension_m
    growth = np.maximum(np.gradient(reach[..., SPREAD], HEIGHTS, axis=0), 0.0)
    reach[..., GROWTH] = np.minimum(growth, GROWTH_MAX)
    reach.setflags(write=False)
    return reach


def _between(table: Array, speed_m_s: Array) -> Array:
    """(k, h, v) the table (h, s, v) at speeds (k,) through the air."""
    at = np.minimum(np.floor(speed_m_s / SPEED_STEP_M_S).astype(np.intp), len(AIR_SPEEDS) - 2)
    share = (speed_m_s / SPEED_STEP_M_S - at)[:, None, None]
    by_speed = np.moveaxis(table, 1, 0)
    return np.asarray((1.0 - share) * by_speed[at] + share * by_speed[at + 1])


def _unevenness(reach: Reach) -> Array:
    """(h, s, v) by how much places near a node may be off: an eighth of the second differences."""
    off_m = np.zeros(reach.shape[:3])
    for layer in (AHEAD, SPREAD):
        table = reach[..., layer]
        for axis in range(3):
            along = np.moveaxis(table, axis, 0)
            bend_m = np.zeros_like(along)
            bend_m[1:-1] = np.abs(along[2:] - 2.0 * along[1:-1] + along[:-2]) / 8.0
            off_m += np.moveaxis(bend_m, 0, axis)
    for axis in range(3):
        along = np.moveaxis(off_m, axis, 0)
        beside_m = along.copy()
        beside_m[1:] = np.maximum(beside_m[1:], along[:-1])
        beside_m[:-1] = np.maximum(beside_m[:-1], along[1:])
        off_m = np.moveaxis(beside_m, 0, axis)
    return SPARE * off_m


@dataclass(frozen=True, slots=True, eq=False)
class Impacts:
    """Where n vehicles would hit the ground, show frame. NaN: not known."""

    place_m: Array  # (n, 2) middle of the disc
    spread_m: Array  # (n,) its radius: greatest wind, drag, half the vehicle
    fall_s: Array  # (n,) longest, after the reaction
    speed_m_s: Array  # (n,) fastest
    energy_j: Array  # (n,) greatest


def impacts(position_m: Array, velocity_m_s: Array, settings: ImpactSettings) -> Impacts:
    """Where vehicles would fall if their motors stopped `settings.reaction_s` from now.

    Args:
        position_m: (n, 3) show frame, NaN where not known.
        velocity_m_s: (n, 3) likewise.
        settings: vehicle, wind, ground.
    """
    place_m, rest = _impacts(
        np.array(position_m),
        np.array(velocity_m_s),
        reach_of(settings.falling, settings.wind_max_m_s),
        settings.reaction_s,
        settings.ground_m,
    )
    energy_j = 0.5 * settings.falling.mass_kg * rest[SPEED] ** 2
    return Impacts(place_m, rest[SPREAD], rest[FALL], rest[SPEED], energy_j)


@kernel
def _impacts(
    position_m: Array, velocity_m_s: Array, reach: Reach, reaction_s: float, ground_m: float
) -> tuple[Array, Array]:
    """(n, 2) middles of the discs and (5, n) the layers of `reach`."""
    n = len(position_m)
    place_m, rest, own = np.full((n, 2), np.nan), np.full((5, n), np.nan), np.empty(5)
    for i in range(n):
        x_m_s, y_m_s = believed_m_s(velocity_m_s[i, 0]), believed_m_s(velocity_m_s[i, 1])
        down_m_s = believed_m_s(velocity_m_s[i, 2])
        if not np.isfinite(position_m[i].sum() + x_m_s + y_m_s + down_m_s):
            continue
        level_m_s = np.sqrt(x_m_s * x_m_s + y_m_s * y_m_s)
        height_m = -position_m[i, 2] - ground_m + max(-down_m_s, 0.0) * reaction_s
        looked_up(reach, height_m, level_m_s, down_m_s, 5, own)
        ahead_s = reaction_s + own[AHEAD] / max(level_m_s, TINY)
        place_m[i, 0] = position_m[i, 0] + ahead_s * x_m_s
        place_m[i, 1] = position_m[i, 1] + ahead_s * y_m_s
        own[SPEED] = max(own[SPEED], down_m_s)  # of one that sinks faster than the table knows
        rest[:, i] = own
    return place_m, rest


@kernel
def believed_m_s(velocity_m_s: float) -> float:
    """One component of a velocity, no greater than is believed; NaN stays."""
    if np.isnan(velocity_m_s):
        return velocity_m_s
    return min(max(velocity_m_s, -BELIEVED_M_S), BELIEVED_M_S)


@kernel
def looked_up(
    reach: Reach, height_m: float, level_m_s: float, down_m_s: float, layers: int, own: Array
) -> None:
    """Write the first layers (layers,) of `reach` at one height and velocity into `own`."""
    high = min(np.sqrt(max(height_m, 0.0)) / HEIGHT_STEP, 1e4)
    fast = min(level_m_s, BELIEVED_M_S) / SPEED_STEP_M_S
    sinks = (min(max(down_m_s, -BELIEVED_M_S), CLIMB_MAX_M_S) + CLIMB_MAX_M_S) / SPEED_STEP_M_S
    h = min(int(high), reach.shape[0] - 2)
    s = min(max(int(fast), 0), reach.shape[1] - 2)
    v = min(max(int(sinks), 0), reach.shape[2] - 2)
    a, b, c = high - h, fast - s, sinks - v
    for layer in range(layers):
        own[layer] = 0.0
    for i in range(2):
        for j in range(2):
            share = (a if i == 1 else 1.0 - a) * (b if j == 1 else 1.0 - b)
            for layer in range(layers):
                low, up = reach[h + i, s + j, v, layer], reach[h + i, s + j, v + 1, layer]
                own[layer] += share * (low + c * (up - low))


def hover_reach_m(height_m: Array, settings: ImpactSettings) -> Array:
    """(n,) how far from below itself a vehicle at rest may fall, from heights (n,) above the origin, in m."""
    still = np.zeros((len(height_m), 3))
    place_m = np.column_stack([still[:, :2], -height_m])
    return impacts(place_m, still, settings).spread_m
