"""What autopilots measure: estimates and their errors, geodetic positions, batteries; columns of a fleet.

The errors of the position estimates are seeded and correlated in time. Measured while holding for 60 s
(FACTS, section 3): estimate minus truth has sd 0.09, 0.19, 0.41 m (north, east, down), correlated over 3 to
6 s. The errors of two vehicles are independent.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.parameters import Columns
from gcs.sim.vehicle.state import Charge, Numbers, Rows, State

MANY = 8


@dataclass(frozen=True, eq=False)
class Sensors:
    """A fleet's estimates. Local NED is each vehicle's own: its origin is its first position fix."""

    position_m: Array  # (n, 3), local NED; NaN before the first fix
    velocity_m_s: Array  # (n, 3), NED
    acceleration_m_s2: Array  # (n, 3), NED, of thrust and tilt
    height_m: Array  # (n,), over ground, as a rangefinder measures it
    contact: Mask  # (n,), on the ground
    estimate_m: Array  # (n, 3), the position in the fleet's common NED
    received_m: Array  # (n, 3), the same by the satellite receiver alone
    locate: Callable[[Array], Array]  # any rows of it to latitude, longitude (deg), altitude AMSL (m)

    def place(self, rows: Rows) -> Array:
        """(len(rows), 3): estimated latitude and longitude in degrees, altitude AMSL in metres."""
        if MANY * len(rows) < len(self.height_m):
            return self.locate(self.estimate_m[rows])
        return self._places[rows]

    @cached_property
    def _places(self) -> Array:
        """Positions of all vehicles, once for all messages of a small fleet."""
        return self.locate(self.estimate_m)

    @cached_property
    def ground_speed_m_s(self) -> Array:
        """(n,), horizontal."""
        speed_m_s: Array = np.hypot(self.velocity_m_s[:, 0], self.velocity_m_s[:, 1])
        return speed_m_s


POSITION_SD_M = np.array((0.09, 0.19, 0.41))
VELOCITY_SD_M_S = np.array((0.04, 0.04, 0.03))
# The position error is a wandering target followed with a lag: an estimator's error moves smoothly.
# The two times add up to the correlation time.
WANDER_S, FOLLOW_S = 3.5, 1.0
VELOCITY_CORRELATION_S = 0.4
TARGET_SD_M = POSITION_SD_M * math.sqrt((WANDER_S + FOLLOW_S) / WANDER_S)


@dataclass(frozen=True, slots=True, eq=False)
class EstimateError:
    """Estimate minus truth, (n, 3) each, NED, and the position error's target."""

    position_m: Array
    velocity_m_s: Array
    target_m: Array


@dataclass(frozen=True, slots=True)
class Receiver:
    """What a receiver reports of itself, and how large the errors of the estimates are despite that."""

    fix_type: int  # GPS_FIX_TYPE
    horizontal_m: float  # accuracy, one sigma
    vertical_m: float
    errors: float  # relative to POSITION_SD_M


SIH_RECEIVER = Receiver(3, 0.9, 1.78, 1.0)
"""Recorded of PX4's simulator: 3D, though its estimates are off by POSITION_SD_M."""

ARDUPILOT_RECEIVER = Receiver(6, 0.2, 0.2, 0.25)
"""Recorded of ArduPilot's simulator: RTK fixed, at rest within 0.05 m."""

IDEAL_RECEIVER = Receiver(6, 0.01, 0.01, 0.0)  # accuracies of 0 would be unknown


def draw_errors(count: int, scale: float, random: np.random.Generator) -> EstimateError:
    """Errors of vehicles that have been running for long; scale 1 is as measured, 0 is none."""
    position_m = scale * random.normal(0.0, POSITION_SD_M, (count, 3))
    ahead_m = math.sqrt(FOLLOW_S / WANDER_S) * scale * random.normal(0.0, POSITION_SD_M, (count, 3))
    velocity_m_s = scale * random.normal(0.0, VELOCITY_SD_M_S, (count, 3))
    return EstimateError(position_m, velocity_m_s, position_m + ahead_m)


def step_errors(
    error: EstimateError, dt_s: float, scale: float, random: np.random.Generator
) -> EstimateError:
    """Advance the errors by dt_s (well below a second); scale as in draw_errors."""
    fresh = scale * random.standard_normal((2, *error.position_m.shape))
    follow = -math.expm1(-dt_s / FOLLOW_S)
    return EstimateError(
        error.position_m + follow * (error.target_m - error.position_m),
        _wander(error.velocity_m_s, dt_s / VELOCITY_CORRELATION_S, fresh[0] * VELOCITY_SD_M_S),
        _wander(error.target_m, dt_s / WANDER_S, fresh[1] * TARGET_SD_M),
    )


def _wander(value: Array, share: float, fresh: Array) -> Array:
    """First-order Gauss-Markov, exact for any step; fresh has the stationary spread."""
    keep = math.exp(-share)
    moved: Array = keep * value + math.sqrt(1.0 - keep * keep) * fresh
    return moved


MAJOR_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
MINOR_M = MAJOR_M * (1.0 - FLATTENING)
SQUARED = FLATTENING * (2.0 - FLATTENING)  # first eccentricity
SECOND_SQUARED = SQUARED / (1.0 - SQUARED)


class Tangent:
    """The plane that touches the earth at an origin."""

    def __init__(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> None:
        sin, cos = math.sin(math.radians(latitude_deg)), math.cos(math.radians(latitude_deg))
        east, ahead = math.sin(math.radians(longitude_deg)), math.cos(math.radians(longitude_deg))
        normal_m = MAJOR_M / math.sqrt(1.0 - SQUARED * sin * sin)
        out_m = (normal_m + altitude_m) * cos
        self._center_m = np.array(
            [out_m * ahead, out_m * east, (normal_m * (1.0 - SQUARED) + altitude_m) * sin]
        )
        self._turn = np.array(
            [
                [-sin * ahead, -sin * east, cos],
                [-east, ahead, 0.0],
                [-cos * ahead, -cos * east, -sin],
            ]
        )

    def geodetic(self, position_m: Array) -> Array:
        """(n, 3) NED to (n, 3): latitude and longitude in degrees, altitude in metres.

        Source: B. R. Bowring, Transformation from spatial to geographical coordinates, Survey Review 23
        (1976); better than a micrometre below 10 km.
        """
        x_m, y_m, z_m = (self._center_m + position_m @ self._turn).T
        out_m = np.hypot(x_m, y_m)
        reduced = np.arctan2(z_m * MAJOR_M, out_m * MINOR_M)
        latitude = np.arctan2(
            z_m + SECOND_SQUARED * MINOR_M * np.sin(reduced) ** 3,
            out_m - SQUARED * MAJOR_M * np.cos(reduced) ** 3,
        )
        sin = np.sin(latitude)
        curve_m = MAJOR_M * np.sqrt(1.0 - SQUARED * sin * sin)
        altitude_m = out_m * np.cos(latitude) + z_m * sin - curve_m
        return np.stack([np.degrees(latitude), np.degrees(np.arctan2(y_m, x_m)), altitude_m], axis=1)


@dataclass(eq=False)
class Batteries:
    """Full at first; endurance_s in the air empties one. Voltage is linear between PX4's two thresholds."""

    state: State
    parameters: Columns
    endurance_s: float

    def __post_init__(self) -> None:
        if not self.endurance_s > 0.0:
            raise ValueError(f"self.endurance_s must be > 0, not {self.endurance_s}")

    def drain(self, powered: Mask, dt_s: float) -> None:
        """Discharge the batteries of powered vehicles, (n,), for dt_s."""
        used = powered * (dt_s / self.endurance_s)
        np.maximum(self.state.remaining - used, 0.0, out=self.state.remaining)

    def remaining_percent(self) -> Numbers:
        """(n,), rounded up, as PX4 does: 0 only when there is nothing left."""
        return np.ceil(100.0 * self.state.remaining).astype(np.int64)

    def voltage_mv(self) -> Array:
        """(n,), at the pack: recorded 16200 when full, 15300 at half."""
        p = self.parameters
        cell_v = p["BAT1_V_EMPTY"] + self.state.remaining * (p["BAT1_V_CHARGED"] - p["BAT1_V_EMPTY"])
        return np.rint(1000.0 * p["BAT1_N_CELLS"] * cell_v)

    def charge_state(self) -> Numbers:
        """(n,), by the three thresholds BAT_LOW_THR, BAT_CRIT_THR, BAT_EMERGEN_THR."""
        remaining, p = self.state.remaining, self.parameters
        charge: Numbers = np.full(len(remaining), int(Charge.OK))
        charge[remaining < p["BAT_LOW_THR"]] = Charge.LOW
        charge[remaining < p["BAT_CRIT_THR"]] = Charge.CRITICAL
        charge[remaining < p["BAT_EMERGEN_THR"]] = Charge.EMERGENCY
        return charge
