"""The wind over a fleet, from how its vehicles tilt to keep their velocities. Pure.

An autopilot integrates away what wind takes of a velocity, so velocities do not show it; the tilt does. With
thrust along the body's axis, level:

    a = T - d (v - w),   T = (g - a_down) (tangent of the tilt)      d: drag of the rotors, w: the wind

All of it is filtered alike, over `SHORT_S`, so that the acceleration needs no difference of velocities: of a
first-order filter it is (v - filtered v) / SHORT_S. With y = T - a, both filtered, y = d (v - w).

Drag: what y and v change within `LONG_S` has the slope d, summed up with forgetting; a vehicle that hovers
changes neither, and keeps its last slope. Only changes across y count in wind. Their slope is |y| / |v - w|
for every drag that acts against the motion through the air, whereas along y that of a drag with the square
of the speed is twice as steep, which would make the wind seem half as strong.

Wind: v - y / d of each vehicle; of the fleet the median, then filtered over `WIND_S`.

Source of the model: P. Martin and E. Salaun, The true role of accelerometer feedback in quadrotor control,
ICRA 2010 (rotor drag is linear); of the filter: the identity of state variable filters.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from gcs.model.jit import kernel, kernel_within
from gcs.model.state import TINY, Array, Mask

GRAVITY_M_S2: Final = 9.80665

EVERY_S: Final = 0.2
"""Between two looks; as often as attitudes arrive, or somewhat oftener."""

SHORT_S, LONG_S, WIND_S, GUST_S = 1.0, 12.0, 4.0, 20.0
"""Time constants: of the filter of each vehicle; of what is taken for constant while its drag is measured; of
the wind; and of the square of the gusts.
"""

ONE_CHANGE_S: Final = 4.0
"""Errors of y are alike for so long."""

SETTLES_S: Final = 3.0
"""A vehicle counts so long after it took off, or after its velocity jumped."""

GAP_S: Final = 1.0
"""After a longer time between two looks, as of a station that stood still, all begin anew."""

ATTITUDE_OLD_S: Final = 1.0
JUMP_M_S: Final = 6.0
"""A velocity that changes more between two looks was not flown."""

TILT_MAX_RAD, SPEED_MAX_M_S = 1.1, 40.0
"""Beyond these an attitude or a velocity is not believed."""

LEVEL_M_S2: Final = 0.12
"""Standard deviation of T for an attitude that is off, and a frame that is not level: 0.7 degrees."""

NOISE_M_S2: Final = 0.15
"""Least standard deviation of y about its line."""

OUTLYING: Final = 3.0
"""Changes farther off the line than so many deviations count in proportion less, as of a gust (Huber)."""

ACROSS_M_S2: Final = 0.5
"""With a mean y of so much, changes along it count half."""

KEPT_M2_S: Final = 400.0
"""Greatest sum of squared changes of velocity that is kept: half a minute of an orbit at 5 m/s."""

ALIKE: Final = 0.25
"""Vehicles of a fleet differ in drag by this share, one deviation."""

INFORMED: Final = 0.2
"""A vehicle's own drag counts for the fleet if it is known better than this share of it."""

FEW: Final = 3
"""With the drag of so many vehicles measured, that of the fleet is their median."""

SPREAD, MEDIAN = 0.85, 1.57
"""Standard deviation along one axis by the median distance in the plane; and the variance of a median by that
of a mean.
"""

DRAG_MIN_PER_S, DRAG_MAX_PER_S = 0.05, 3.0

KNOWN_M_S: Final = 1.0
KNOWN_SHARE: Final = 0.16
"""A wind is known if its standard deviation is at most this, or this share of it."""

KNOWN_AFTER_S: Final = 4.0
"""Of measuring."""

UNKNOWN_AFTER_S: Final = 5.0
"""Without a vehicle that counts, the wind is not known any more."""

MARGIN: Final = 2.0
"""Deviations above the estimate that gusts may reach, and that an estimate may be off."""


PRIOR_PER_S, PRIOR_SHARE, GIVEN_SHARE = 0.35, 1.0, 0.15
"""The drag before any is measured, and its deviation as a share of it: of none, and of one that is given."""


@dataclass(frozen=True)
class WindEstimate:
    """The wind that a fleet measures. NaN: not known at all."""

    time_s: float = np.nan
    north_m_s: float = np.nan  # of the air over ground, as the next
    east_m_s: float = np.nan
    deviation_m_s: float = np.nan  # standard deviation of the estimate
    drag_error_m_s: float = np.nan  # the part of it that is for the drag
    gust_m_s: float = np.nan  # standard deviation of the wind itself, and of what is measured of it
    drag_per_s: float = np.nan  # mean of the vehicles
    vehicles: int = 0  # that counted
    is_known: bool = False  # well enough to be believed

    @cached_property
    def speed_m_s(self) -> float:
        return float(np.hypot(self.north_m_s, self.east_m_s))

    @cached_property
    def from_deg(self) -> float:
        """Where it comes from, clockwise from north."""
        return float(np.degrees(np.arctan2(-self.east_m_s, -self.north_m_s)) % 360.0)

    @cached_property
    def with_gusts_m_s(self) -> float:
        """What its gusts reach, with what the estimate may be off; NaN while it is not known."""
        if not self.is_known:
            return np.nan
        return self.speed_m_s + MARGIN * float(np.hypot(self.deviation_m_s, self.gust_m_s))

    @cached_property
    def at_least_m_s(self) -> float:
        """What it surely has, also where it is not known well; 0: perhaps none."""
        least_m_s = self.speed_m_s - MARGIN * self.deviation_m_s
        return max(least_m_s, 0.0) if np.isfinite(least_m_s) else 0.0


class _Vehicles(NamedTuple):
    """What is kept of n vehicles, written in place."""

    settled_s: Array  # (n,) for how long it is measured without a break; negative: it is not
    velocity_m_s: Array  # (n, 3) the newest
    short_m_s: Array  # (n, 3) filtered velocity
    thrust_m_s2: Array  # (n, 2) filtered T
    long_m_s: Array  # (n, 2) the velocity, filtered again
    long_m_s2: Array  # (n, 2) y, likewise
    squares: Array  # (n,) sum of squared changes of velocity
    products: Array  # (n,) sum of changes of velocity times changes of y
    noise_m2_s4: Array  # (n,) mean square of what is off the line, of one axis

    @staticmethod
    def unknown(n: int) -> "_Vehicles":
        return _Vehicles(
            settled_s=np.full(n, -1.0),
            velocity_m_s=np.zeros((n, 3)),
            short_m_s=np.zeros((n, 3)),
            thrust_m_s2=np.zeros((n, 2)),
            long_m_s=np.zeros((n, 2)),
            long_m_s2=np.zeros((n, 2)),
            squares=np.zeros(n),
            products=np.zeros(n),
            noise_m2_s4=np.full(n, 0.3**2),
        )


class WindEstimator:
    """Measures the wind over one fleet. Used on the event loop only; it never raises for what is reported."""

    def __init__(self, count: int, drag_per_s: float | None = None) -> None:
        """Know nothing of `count` vehicles, but their drag by mass where it is given, in 1/s."""
        self._prior_per_s = PRIOR_PER_S if drag_per_s is None else drag_per_s
        self._prior_share = PRIOR_SHARE if drag_per_s is None else GIVEN_SHARE
        self._vehicles = _Vehicles.unknown(count)
        self._numbers, self._now_m_s = np.empty((4, count)), np.zeros((2, 2))  # written by `_of_fleet`
        self._time_s = self._counted_s = -np.inf
        self._measured_s = 0.0  # for how long
        self._wind_m_s, self._gust_m2_s2, self._drag_per_s = np.zeros(2), 0.0, np.nan
        self.newest = WindEstimate()

    def take(
        self, now_s: float, attitude_rad: Array, attitude_age_s: Array, velocity_ned_m_s: Array, flies: Mask
    ) -> None:
        """Take what n vehicles report now; called about every `EVERY_S`.

        Args:
            now_s: the loop's clock.
            attitude_rad: (n, 3) roll, pitch and yaw as in ATTITUDE; NaN: not reported.
            attitude_age_s: (n,) since it arrived.
            velocity_ned_m_s: (n, 3) over ground.
            flies: (n,) airborne, with motors that carry it.
        """
        dt_s, self._time_s = now_s - self._time_s, now_s
        if not 0.0 <= dt_s <= GAP_S:
            self._vehicles.settled_s[:] = -1.0
            dt_s = 0.0
        _measure(dt_s, attitude_rad, attitude_age_s, velocity_ned_m_s, flies, self._vehicles)

    def look(self, now_s: float) -> WindEstimate:
        """Return the wind by what was taken last; once after each `take`, at the latest in the next tick."""
        count, for_drag_m_s, else_m_s, drag_per_s = _of_fleet(
            self._vehicles, self._prior_per_s, self._prior_share, self._numbers, self._now_m_s
        )
        if not count:
            if now_s - self._counted_s > UNKNOWN_AFTER_S:
                self._measured_s, self.newest = 0.0, WindEstimate(now_s)
            return self.newest
        self._follow(now_s - self._counted_s, self._now_m_s[0].copy(), self._now_m_s[1], drag_per_s)
        self._counted_s = now_s
        speed_m_s, deviation_m_s = float(np.hypot(*self._wind_m_s)), float(np.hypot(for_drag_m_s, else_m_s))
        well = deviation_m_s <= max(KNOWN_M_S, KNOWN_SHARE * speed_m_s)
        self.newest = WindEstimate(
            now_s,
            float(self._wind_m_s[0]),
            float(self._wind_m_s[1]),
            deviation_m_s,
            for_drag_m_s,
            float(np.sqrt(self._gust_m2_s2)),
            drag_per_s,
            count,
            bool(well and self._measured_s >= KNOWN_AFTER_S),
        )
        return self.newest

    def _follow(self, dt_s: float, now_m_s: Array, moves_m_s: Array, drag_per_s: float) -> None:
        """Filter the wind, at first as a mean of all. A drag that is known better is no gust.

        Args:
            dt_s: since the last time.
            now_m_s: (2,) what is measured now.
            moves_m_s: (2,) mean velocity of the vehicles.
            drag_per_s: their mean.
        """
        anew = 1.0 if np.isnan(self._drag_per_s) else self._drag_per_s / drag_per_s
        self._wind_m_s, self._drag_per_s = moves_m_s + anew * (self._wind_m_s - moves_m_s), drag_per_s
        if self._measured_s == 0.0:
            self._wind_m_s, self._gust_m2_s2, dt_s = now_m_s, 0.0, EVERY_S
        self._measured_s += dt_s
        share = max(-np.expm1(-dt_s / WIND_S), min(dt_s / self._measured_s, 1.0))
        self._wind_m_s = self._wind_m_s + share * (now_m_s - self._wind_m_s)
        off_m2_s2 = 0.5 * float(((now_m_s - self._wind_m_s) ** 2).sum())
        self._gust_m2_s2 -= np.expm1(-dt_s / GUST_S) * (off_m2_s2 - self._gust_m2_s2)


@kernel_within
def _tangent(roll: float, pitch: float, yaw: float) -> tuple[float, float, float]:
    """Thrust to the north and to the east by thrust upwards, and the cosine of the tilt."""
    sine_roll, cosine_roll = np.sin(roll), np.cos(roll)
    sine_pitch, cosine_pitch = np.sin(pitch), np.cos(pitch)
    sine_yaw, cosine_yaw = np.sin(yaw), np.cos(yaw)
    up, ahead = cosine_roll * cosine_pitch, -sine_pitch * cosine_roll
    north = (cosine_yaw * ahead - sine_yaw * sine_roll) / up
    east = (sine_yaw * ahead + cosine_yaw * sine_roll) / up
    return north, east, up


@kernel
def _measure(
    dt_s: float, attitude_rad: Array, age_s: Array, velocity_m_s: Array, flies: Mask, kept: _Vehicles
) -> None:
    """Filter what each vehicle reports, and add its changes to the sums; see `WindEstimator.take`."""
    short, long = 1.0 - np.exp(-dt_s / SHORT_S), 1.0 - np.exp(-dt_s / LONG_S)
    late, up_min = 1.0 - np.exp(-dt_s / GUST_S), np.cos(TILT_MAX_RAD)
    settled_s, last_m_s, short_m_s, thrust_m_s2 = (
        kept.settled_s,
        kept.velocity_m_s,
        kept.short_m_s,
        kept.thrust_m_s2,
    )
    for i in range(len(flies)):
        tilt_north, tilt_east, up = _tangent(attitude_rad[i, 0], attitude_rad[i, 1], attitude_rad[i, 2])
        north, east, down = velocity_m_s[i, 0], velocity_m_s[i, 1], velocity_m_s[i, 2]
        square = north * north + east * east + down * down
        usable = flies[i] and age_s[i] <= ATTITUDE_OLD_S and up >= up_min and square <= SPEED_MAX_M_S**2
        if not (usable and np.isfinite(tilt_north + tilt_east)):
            settled_s[i] = -1.0
            continue
        jump = (north - last_m_s[i, 0]) ** 2 + (east - last_m_s[i, 1]) ** 2 + (down - last_m_s[i, 2]) ** 2
        last_m_s[i, 0], last_m_s[i, 1], last_m_s[i, 2] = north, east, down
        if settled_s[i] < 0.0 or jump > JUMP_M_S**2:
            settled_s[i] = 0.0
            short_m_s[i, 0], short_m_s[i, 1], short_m_s[i, 2] = north, east, down
            thrust_m_s2[i, 0], thrust_m_s2[i, 1] = GRAVITY_M_S2 * tilt_north, GRAVITY_M_S2 * tilt_east
            continue
        settled_s[i] += dt_s
        short_m_s[i, 0] += short * (north - short_m_s[i, 0])
        short_m_s[i, 1] += short * (east - short_m_s[i, 1])
        short_m_s[i, 2] += short * (down - short_m_s[i, 2])
        lift_m_s2 = GRAVITY_M_S2 - (down - short_m_s[i, 2]) / SHORT_S
        thrust_m_s2[i, 0] += short * (lift_m_s2 * tilt_north - thrust_m_s2[i, 0])
        thrust_m_s2[i, 1] += short * (lift_m_s2 * tilt_east - thrust_m_s2[i, 1])
        if settled_s[i] >= SETTLES_S:
            _add_changes(i, dt_s, long, late, kept)


@kernel_within
def _air_m_s2(i: int, axis: int, kept: _Vehicles) -> float:
    """The y of a vehicle along one axis."""
    turns_m_s2 = (kept.velocity_m_s[i, axis] - kept.short_m_s[i, axis]) / SHORT_S
    return float(kept.thrust_m_s2[i, axis] - turns_m_s2)


@kernel_within
def _add_changes(i: int, dt_s: float, long: float, late: float, kept: _Vehicles) -> None:
    """Add the changes of velocity and y of one vehicle to its sums."""
    v_north, v_east = kept.short_m_s[i, 0], kept.short_m_s[i, 1]
    y_north, y_east = _air_m_s2(i, 0, kept), _air_m_s2(i, 1, kept)
    if kept.settled_s[i] - dt_s < SETTLES_S:
        kept.long_m_s[i, 0], kept.long_m_s[i, 1] = v_north, v_east
        kept.long_m_s2[i, 0], kept.long_m_s2[i, 1] = y_north, y_east
    kept.long_m_s[i, 0] += long * (v_north - kept.long_m_s[i, 0])
    kept.long_m_s[i, 1] += long * (v_east - kept.long_m_s[i, 1])
    kept.long_m_s2[i, 0] += long * (y_north - kept.long_m_s2[i, 0])
    kept.long_m_s2[i, 1] += long * (y_east - kept.long_m_s2[i, 1])
    p_north, p_east = v_north - kept.long_m_s[i, 0], v_east - kept.long_m_s[i, 1]
    q_north, q_east = y_north - kept.long_m_s2[i, 0], y_east - kept.long_m_s2[i, 1]
    x, z = kept.long_m_s2[i, 0], kept.long_m_s2[i, 1]
    mean_m_s2 = np.sqrt(x * x + z * z)
    x, z = (x / mean_m_s2, z / mean_m_s2) if mean_m_s2 > 0.0 else (1.0, 0.0)
    along = 1.0 / (1.0 + (mean_m_s2 / ACROSS_M_S2) ** 2)
    p_along, p_across = x * p_north + z * p_east, x * p_east - z * p_north
    q_along, q_across = x * q_north + z * q_east, x * q_east - z * q_north
    squares, noise = kept.squares[i], kept.noise_m2_s4[i]
    drag = kept.products[i] / squares if squares > 0.0 else 0.0
    off_m_s2 = abs(q_across - drag * p_across)
    most_m_s2 = OUTLYING * np.sqrt(max(noise, NOISE_M_S2**2))
    weight = dt_s * min(1.0, most_m_s2 / max(off_m_s2, TINY))
    squares += weight * (p_across * p_across + along * p_along * p_along)
    products = kept.products[i] + weight * (p_across * q_across + along * p_along * q_along)
    kept.noise_m2_s4[i] = noise + late * (min(off_m_s2, most_m_s2) ** 2 - noise)
    scale = min(1.0, KEPT_M2_S / max(squares, TINY))
    kept.squares[i], kept.products[i] = scale * squares, scale * products


@kernel_within
def _information(i: int, kept: _Vehicles) -> float:
    """One by the variance of a vehicle's own drag; changes within `ONE_CHANGE_S` are one."""
    return float(kept.squares[i] / (ONE_CHANGE_S * max(kept.noise_m2_s4[i], NOISE_M_S2**2)))


@kernel
def _middle(values: Array) -> float:
    """The median of (n,) finite values, n at least 1; the values change their order."""
    left, right, at = 0, len(values) - 1, len(values) // 2
    while left < right:
        pivot, i, j = values[(left + right) // 2], left, right
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if at <= j:
            right = j
        elif at >= i:
            left = i
        else:
            break
    if len(values) % 2:
        return float(values[at])
    return float(0.5 * (values[at] + values[:at].max()))


@kernel
def _of_fleet(
    kept: _Vehicles, prior_per_s: float, prior_share: float, numbers: Array, now_m_s: Array
) -> tuple[int, float, float, float]:
    """How many count, the standard deviations of their wind, for the drag and else, and their mean drag.

    `numbers` (4, n) is written, and `now_m_s` (2, 2): the median of the winds, the mean of the velocities.
    """
    n, count = len(kept.settled_s), 0
    for i in range(n):
        information = _information(i, kept)
        if information > 0.0:
            fit = kept.products[i] / kept.squares[i]
            if fit >= DRAG_MIN_PER_S and information * (INFORMED * fit) ** 2 >= 1.0:
                numbers[0, count] = fit
                count += 1
    expected, share = prior_per_s, prior_share
    if count >= FEW:
        expected, share = _middle(numbers[0, :count]), ALIKE
    expects = 1.0 / (share * expected) ** 2
    count, drags = 0, 0.0
    now_m_s[1] = 0.0
    for i in range(n):
        if kept.settled_s[i] < SETTLES_S:
            continue
        information = _information(i, kept)
        fit = kept.products[i] / kept.squares[i] if information > 0.0 else 0.0
        drag = (information * fit + expects * expected) / (information + expects)
        drag = min(max(drag, DRAG_MIN_PER_S), DRAG_MAX_PER_S)
        y_north, y_east = _air_m_s2(i, 0, kept), _air_m_s2(i, 1, kept)
        numbers[0, count] = kept.short_m_s[i, 0] - y_north / drag
        numbers[1, count] = kept.short_m_s[i, 1] - y_east / drag
        through_m_s = np.sqrt(y_north * y_north + y_east * y_east) / drag
        numbers[2, count] = through_m_s / (drag * np.sqrt(information + expects))
        drags += drag
        now_m_s[1, 0] += kept.short_m_s[i, 0]
        now_m_s[1, 1] += kept.short_m_s[i, 1]
        count += 1
    if count == 0:
        return 0, np.nan, np.nan, np.nan
    now_m_s[1] /= count
    numbers[3, :count] = numbers[0, :count]
    north = _middle(numbers[3, :count])
    numbers[3, :count] = numbers[1, :count]
    east = _middle(numbers[3, :count])
    for k in range(count):
        numbers[3, k] = (numbers[0, k] - north) ** 2 + (numbers[1, k] - east) ** 2
    spread_m2_s2, drag = SPREAD**2 * _middle(numbers[3, :count]), drags / count
    alone_m2_s2 = spread_m2_s2 + (LEVEL_M_S2 / drag) ** 2
    for_drag_m_s = _middle(numbers[2, :count])
    now_m_s[0, 0], now_m_s[0, 1] = north, east
    return count, for_drag_m_s, np.sqrt(MEDIAN * alone_m2_s2 / count), drag


def warm_up() -> None:
    """Compile or load the kernels."""
    estimator, reported = WindEstimator(1), np.zeros((1, 3))
    reported.setflags(write=False)  # as telemetry is: numba compiles frozen arrays as another type
    estimator.take(0.0, reported, np.zeros(1), reported, np.ones(1, np.bool_))
    estimator.look(0.0)
