"""All reported traffic in a table of bounded size, each track by a filter of constant velocity. Pure.

A report corrects one row, and all rows are foreseen at once: a hundred tracks cost a tick little. Along x and
y a track is known equally well, so that it has two covariances: sideways and up. Show frame, z down.
"""

from dataclasses import dataclass, field, replace
from math import atan2, cos, hypot, inf, isfinite, nan, pi, sin
from typing import Final, NamedTuple

import numpy as np

from gcs.model.state import Array, Mask
from gcs.model.traffic import VESSEL_S

TRACKS_KEPT: Final = 128
"""The nearest to the show's origin are kept."""

FARTHEST_M: Final = 100_000.0
"""Farther sideways a report is not believed; farther up or down it has no height."""

FASTEST_M_S: Final = 1000.0
"""Along an axis; a report of more has no velocity."""

DEVIATIONS: Final = (1e-3, 1e5)
"""Least and greatest standard deviation of a report: of less the square is 0, of more there is none."""

AGILITY: Final = (2.0, 0.5)
"""Power of the random acceleration, sideways and up, in m^2/s^3: turns of 3 degrees a second at 30 m/s."""

CALM: Final = (0.1, 0.05)
"""The same of a track that flies as is expected of it."""

SUDDEN: Final = (AGILITY[0] - CALM[0], AGILITY[1] - CALM[1])
"""What the first is more than the second."""

COMES_S: Final = 60.0
PASSED_M: Final = 300.0
"""A silent track that comes to the show is kept so long, or until it is expected so far beyond."""

ANSWERED_S: Final = 2.0
"""What a track does next is reported, and vehicles have answered, after this time: so far it may turn."""

SURPRISES: Final = (0.4, 3.0)
"""Weight of a report in the mean of how far reports are off, as a share of what is expected; from which on
a track is not calm."""

TURNS: Final = (0.04, 0.003)
"""Variance of a rate of turn that begins, in rad^2/s^2, and power of its random change, in rad^2/s^3."""

TURNS_RAD_S: Final = (0.03, 1.0)
"""A slower turn is none; a faster one none that lasts."""

TURNED_S: Final = 15.0
"""Reports farther apart do not say how fast a track turns."""

UNKNOWN_M_S: Final = (20.0, 5.0)
"""Standard deviation of a velocity that was not reported yet, along each axis sideways, and up."""

GATE: Final = 5.0
GATE_LEAST_M: Final = 30.0
"""A report farther than so many deviations, and this, from where its track is expected is not believed."""

AGAIN: Final = 3
"""A track begins anew at the place of so many reports in a row that were not believed."""

STANDS_M_S: Final = 0.5
"""A place that is repeated to the digit, of a track that is faster, is old."""

ON_THE_SURFACE: Final = frozenset({"vessel", "ground"})
SURFACE_M: Final = 5.0
"""Without a reported height these are as high as they were, at first as the show's origin, so exactly."""

REPEATED_S: Final = 1.5
"""A place that is repeated to the digit, and is no more than this newer, is old: ages are whole seconds."""

SLOW_M_S: Final = (1.5, 2.5)
"""Slower than the first a track is flown round, faster than the second it is evaded; else as before."""

_X, _Y, _Z, _VX, _VY, _VZ, _SIDE, _UP, _TURN, _SURPRISE, _WIDTH = 0, 1, 2, 3, 4, 5, 6, 9, 12, 14, 15


@dataclass(frozen=True, slots=True)
class TrackReport:
    """A report of one track, show frame, z down. NaN where its source does not say."""

    id: str
    kind: str
    arrived_s: float
    was_s: float  # when it was there, loop clock
    position_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float] = (nan, nan, nan)
    deviation_m: float = 10.0
    height_deviation_m: float = 10.0
    velocity_deviation_m_s: float = 0.5


class TracksNow(NamedTuple):
    """All tracks at one time, k rows."""

    ids: tuple[str, ...]
    kinds: tuple[str, ...]
    position_m: Array  # (k, 3) z NaN: its height is not known
    velocity_m_s: Array  # (k, 3)
    spread: Array  # (k, 2, 3) as of `gcs.safety.near_traffic`
    age_s: Array  # (k,) of the newest report that is believed
    slow: Mask  # (k,)
    turn_rad_s: Array  # (k,) clockwise seen from above; 0: it goes straight on


@dataclass(slots=True, eq=False)
class TrackTable:
    """What is believed of every track. Whatever arrives, its size and the cost of a report are bounded.

    Attributes:
        forgotten_s: a track without a believed report for so long is forgotten, a vessel after `VESSEL_S`.
        accepted, outliers, late, repeated: how many reports were each.
        crowded_s: when a track was left out last because nearer ones fill the table.
    """

    forgotten_s: float
    accepted: int = 0
    outliers: int = 0
    late: int = 0
    repeated: int = 0
    crowded_s: float = -inf
    _rows: dict[str, int] = field(default_factory=dict, init=False)
    _free: list[int] = field(default_factory=lambda: list(range(TRACKS_KEPT)), init=False)
    _kinds: list[str] = field(default_factory=lambda: [""] * TRACKS_KEPT, init=False)
    _places: list[tuple[float, float, float]] = field(
        default_factory=lambda: [(nan, nan, nan)] * TRACKS_KEPT, init=False
    )  # as reported last
    _refused: list[int] = field(default_factory=lambda: [0] * TRACKS_KEPT, init=False)  # reports in a row
    _state: Array = field(default_factory=lambda: np.zeros((TRACKS_KEPT, _WIDTH)), init=False)
    _time_s: Array = field(default_factory=lambda: np.full(TRACKS_KEPT, -inf), init=False)
    _away_m: Array = field(default_factory=lambda: np.full(TRACKS_KEPT, -inf), init=False)
    _slow: Mask = field(default_factory=lambda: np.zeros(TRACKS_KEPT, np.bool_), init=False)

    def __len__(self) -> int:
        return len(self._rows)

    def take(self, report: TrackReport) -> None:
        """Take one report, whatever it says."""
        x_m, y_m, _ = report.position_m
        away_m = hypot(x_m, y_m)
        old_s = report.arrived_s - report.was_s
        if not (away_m <= FARTHEST_M and abs(old_s) <= max(self.forgotten_s, VESSEL_S)):
            self.outliers += 1
            return
        report = _bounded(report)
        row = self._rows.get(report.id)
        if row is None:
            row = self._place_for(report, away_m)
            if row is not None:
                self._begin(row, report, away_m)
            return
        if report.was_s < self._time_s[row]:
            self.late += 1
            return
        state: list[float] = self._state[row].tolist()
        place, self._places[row] = self._places[row], report.position_m
        is_moving = hypot(state[_VX], state[_VY]) > STANDS_M_S
        if place[:2] == report.position_m[:2] and (
            is_moving or report.was_s - self._time_s[row] < REPEATED_S
        ):
            self.repeated += 1
            return
        dt_s = report.was_s - float(self._time_s[row])
        _move(state, dt_s)
        off_m = hypot(x_m - state[_X], y_m - state[_Y])
        turns_m2 = state[_SIDE] + SUDDEN[0] * dt_s**3 / 3.0
        _doubt(state, report, off_m, dt_s)
        if off_m > max(GATE * hypot(turns_m2**0.5, report.deviation_m), GATE_LEAST_M):
            self._refuse(row, report, away_m, dt_s, state[_SURPRISE])
            return
        x_m_s, y_m_s, moves = state[_VX], state[_VY], state[_SIDE + 2]
        _correct(state, report)
        _turn(state, x_m_s, y_m_s, moves, dt_s)
        self._keep(row, report, state, away_m)

    def forget(self, now_s: float, center_m: Array | None = None) -> None:
        """Forget what is silent for too long, but nothing that comes to (2,); None: to the origin."""
        vessels = np.array([kind == "vessel" for kind in self._kinds])
        after_s = np.where(vessels, max(self.forgotten_s, VESSEL_S), self.forgotten_s)
        age_s = now_s - self._time_s
        ended = (age_s > after_s) & (
            (age_s > COMES_S) | self._has_passed(age_s, np.zeros(2) if center_m is None else center_m)
        )
        silent = np.flatnonzero(ended & (self._away_m >= 0.0))
        if len(silent):
            gone = set(silent.tolist())
            for name in [name for name, row in self._rows.items() if row in gone]:
                self._drop(name)

    def _has_passed(self, age_s: Array, center_m: Array) -> Mask:
        """Which do not come there, or are beyond it: one that comes and falls silent is kept."""
        place_m, velocity_m_s = self._state[:, :_Z] - center_m, self._state[:, _VX:_VZ]
        speed_m_s = np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1])
        way_m = (place_m * velocity_m_s).sum(axis=1) / np.maximum(speed_m_s, STANDS_M_S)
        beyond_m = way_m + np.where(np.isfinite(age_s), age_s, 0.0) * speed_m_s
        passed: Mask = (speed_m_s < SLOW_M_S[0]) | (way_m > 0.0) | (beyond_m > PASSED_M)
        return passed

    def at(self, now_s: float) -> TracksNow:
        """All tracks as they are expected at `now_s`; earlier than a track's newest report counts as that."""
        rows = np.fromiter(self._rows.values(), np.intp, len(self._rows))
        state, age_s = self._state[rows], now_s - self._time_s[rows]
        later_s = np.maximum(age_s, 0.0)
        turn_rad_s = _believed(state[:, _TURN])
        position_m, velocity_m_s = turned(state[:, :_VX], state[:, _VX:_SIDE], turn_rad_s, later_s)
        spread = np.empty((len(rows), 2, 3))
        for axis, (first, power) in enumerate(zip((_SIDE, _UP), AGILITY, strict=True)):
            place, both, moves = state[:, first : first + 3].T
            spread[:, axis, 0] = place + later_s * (2.0 * both + later_s * (moves + power * later_s / 3.0))
            spread[:, axis, 1] = both + later_s * (moves + power * later_s / 2.0)
            spread[:, axis, 2] = moves + power * later_s
        spread[:, 0, 0] += AGILITY[0] / 3.0 * ((later_s + ANSWERED_S) ** 3 - later_s**3)
        speed_m_s = np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1])
        slow = np.where(self._slow[rows], speed_m_s < SLOW_M_S[1], speed_m_s < SLOW_M_S[0])
        self._slow[rows] = slow
        kinds = tuple(self._kinds[row] for row in self._rows.values())
        return TracksNow(tuple(self._rows), kinds, position_m, velocity_m_s, spread, age_s, slow, turn_rad_s)

    def _place_for(self, report: TrackReport, away_m: float) -> int | None:
        """A row for a new track: free, or that of the farthest if this is nearer; None: it is left out."""
        if not self._free:
            self.crowded_s = report.arrived_s
            farthest = int(self._away_m.argmax())
            if away_m >= self._away_m[farthest]:
                return None
            self._drop(next(name for name, row in self._rows.items() if row == farthest))
        self._rows[report.id] = row = self._free.pop()
        return row

    def _drop(self, name: str) -> None:
        row = self._rows.pop(name)
        self._away_m[row] = self._time_s[row] = -inf
        self._free.append(row)

    def _begin(self, row: int, report: TrackReport, away_m: float) -> None:
        state = [0.0] * _WIDTH
        state[_X], state[_Y], state[_Z] = report.position_m[0], report.position_m[1], nan
        state[_SIDE], state[_UP] = report.deviation_m**2, report.height_deviation_m**2
        state[_SIDE + 2], state[_UP + 2] = (deviation**2 for deviation in UNKNOWN_M_S)
        state[_SURPRISE] = 1.0
        self._slow[row] = False
        _correct(state, report, place=False)
        self._keep(row, report, state, away_m)

    def _refuse(self, row: int, report: TrackReport, away_m: float, dt_s: float, surprise: float) -> None:
        """Do not believe a report: its track is known less well for it, and begins anew after some."""
        self.outliers += 1
        self._refused[row] += 1
        if self._refused[row] >= AGAIN:
            self._begin(row, report, away_m)
            return
        state: list[float] = self._state[row].tolist()
        _grow(state, dt_s, SUDDEN)
        state[_SURPRISE] = surprise
        self._state[row] = state

    def _keep(self, row: int, report: TrackReport, state: list[float], away_m: float) -> None:
        self._state[row], self._time_s[row], self._away_m[row] = state, report.was_s, away_m
        self._places[row], self._kinds[row], self._refused[row] = report.position_m, report.kind, 0
        self.accepted += 1


def _bounded(report: TrackReport) -> TrackReport:
    """The same, without what no track does."""
    x_m, y_m, z_m = report.position_m
    fast = not all(abs(speed_m_s) <= FASTEST_M_S for speed_m_s in report.velocity_m_s if isfinite(speed_m_s))
    return replace(
        report,
        position_m=(x_m, y_m, z_m if abs(z_m) <= FARTHEST_M else nan),
        velocity_m_s=(nan, nan, nan) if fast else report.velocity_m_s,
        deviation_m=_certain(report.deviation_m),
        height_deviation_m=_certain(report.height_deviation_m),
        velocity_deviation_m_s=_certain(report.velocity_deviation_m_s),
    )


def _certain(deviation: float) -> float:
    least, greatest = DEVIATIONS
    return max(least, min(greatest, deviation))  # NaN: the greatest


def turned(place_m: Array, velocity_m_s: Array, turn_rad_s: Array, after_s: Array) -> tuple[Array, Array]:
    """Places and velocities (k, 3) of what turns on as it does, after so long (k,)."""
    half = 0.5 * turn_rad_s * after_s
    way_m = after_s[:, None] * velocity_m_s
    there_m = place_m + np.sinc(half / pi)[:, None] * _rotated(way_m, half)
    there_m[:, 2] = place_m[:, 2] + way_m[:, 2]
    return there_m, _rotated(velocity_m_s, 2.0 * half)


def _rotated(vector: Array, angle: Array) -> Array:
    x, y, z = vector.T
    along, across = np.cos(angle), np.sin(angle)
    return np.stack([along * x - across * y, across * x + along * y, z], axis=1)


def _believed(turn_rad_s: Array) -> Array:
    """Rates of turn (k,) that count."""
    least, most = TURNS_RAD_S
    believed: Array = np.where(np.abs(turn_rad_s) < least, 0.0, np.clip(turn_rad_s, -most, most))
    return believed


def _move(state: list[float], dt_s: float) -> None:
    turn = state[_TURN] * dt_s if abs(state[_TURN]) >= TURNS_RAD_S[0] else 0.0
    along, across = cos(0.5 * turn), sin(0.5 * turn)
    x_m_s, y_m_s = state[_VX], state[_VY]
    half_x, half_y = along * x_m_s - across * y_m_s, across * x_m_s + along * y_m_s
    state[_X], state[_Y], state[_Z] = (
        state[_X] + dt_s * half_x,
        state[_Y] + dt_s * half_y,
        state[_Z] + dt_s * state[_VZ],
    )
    state[_VX], state[_VY] = along * half_x - across * half_y, across * half_x + along * half_y
    _grow(state, dt_s, CALM)


def _doubt(state: list[float], report: TrackReport, off_m: float, dt_s: float) -> None:
    """Expect more of a track that is off by more than was expected of it, or that turns."""
    off = 0.5 * off_m**2 / (state[_SIDE] + report.deviation_m**2)
    x_m_s, y_m_s, _ = report.velocity_m_s
    if isfinite(x_m_s) and isfinite(y_m_s):
        off_m_s = hypot(x_m_s - state[_VX], y_m_s - state[_VY])
        off = max(off, 0.5 * off_m_s**2 / (state[_SIDE + 2] + report.velocity_deviation_m_s**2))
    weight, most = SURPRISES
    state[_SURPRISE] += weight * (min(off, 10.0) - state[_SURPRISE])
    if state[_SURPRISE] > most or state[_TURN] != 0.0:
        _grow(state, dt_s, SUDDEN)


def _turn(state: list[float], x_m_s: float, y_m_s: float, moves: float, dt_s: float) -> None:
    """Correct the rate of turn by how a report turned the velocity that was expected.

    A track that is calm and flew straight on goes on so.
    """
    speed2 = x_m_s**2 + y_m_s**2
    straight = state[_TURN] == 0.0 and state[_SURPRISE] <= SURPRISES[1]
    if straight or speed2 < SLOW_M_S[1] ** 2 or not 0.0 < dt_s <= TURNED_S:
        state[_TURN], state[_TURN + 1] = 0.0, TURNS[0]
        return
    angle = atan2(x_m_s * state[_VY] - y_m_s * state[_VX], x_m_s * state[_VX] + y_m_s * state[_VY])
    variance = state[_TURN + 1] + TURNS[1] * dt_s
    of_angle = (moves - state[_SIDE + 2]) / (speed2 * dt_s**2)
    weight = variance / (variance + of_angle)
    least, most = TURNS_RAD_S
    turn = max(-most, min(most, state[_TURN] + weight * angle / dt_s))
    state[_TURN], state[_TURN + 1] = turn if abs(turn) >= least else 0.0, (1.0 - weight) * variance


def _grow(state: list[float], dt_s: float, powers: tuple[float, float]) -> None:
    for first, power in zip((_SIDE, _UP), powers, strict=True):
        place, both, moves = state[first : first + 3]
        state[first] = place + dt_s * (2.0 * both + dt_s * (moves + power * dt_s / 3.0))
        state[first + 1] = both + dt_s * (moves + power * dt_s / 2.0)
        state[first + 2] = moves + power * dt_s


def _correct(state: list[float], report: TrackReport, *, place: bool = True) -> None:
    """Correct a row by what a report says, of its place and of its velocity."""
    z_m, (x_m_s, y_m_s, z_m_s) = report.position_m[2], report.velocity_m_s
    begins = not isfinite(state[_Z])
    if report.kind in ON_THE_SURFACE and not isfinite(z_m):
        least = inf if begins else state[_UP]
        state[_Z], state[_UP], state[_UP + 1] = 0.0 if begins else state[_Z], min(least, SURFACE_M**2), 0.0
        z_m_s = z_m_s if isfinite(z_m_s) else 0.0
    elif begins and isfinite(z_m):
        state[_Z], state[_UP], state[_UP + 1] = z_m, report.height_deviation_m**2, 0.0
    if place:
        _pull(state, (_X, _Y), _SIDE, report.position_m, 0, report.deviation_m)
        if isfinite(z_m) and not begins:
            _pull(state, (_Z,), _UP, report.position_m, 0, report.height_deviation_m)
    if isfinite(x_m_s) and isfinite(y_m_s):
        _pull(state, (_X, _Y), _SIDE, (x_m_s, y_m_s, z_m_s), 1, report.velocity_deviation_m_s)
    if isfinite(z_m_s):
        _pull(state, (_Z,), _UP, (x_m_s, y_m_s, z_m_s), 1, report.velocity_deviation_m_s)


def _pull(
    state: list[float],
    axes: tuple[int, ...],
    first: int,
    reported: tuple[float, float, float],
    moves: int,
    deviation: float,
) -> None:
    """Pull `axes` towards what is reported: places, or with `moves` = 1 velocities."""
    place, both, speed = state[first : first + 3]
    seen = (speed if moves else place) + deviation**2
    of_place, of_speed = (both / seen, speed / seen) if moves else (place / seen, both / seen)
    for axis in axes:
        missed = reported[axis] - state[axis + (_VX if moves else 0)]
        state[axis] += of_place * missed
        state[axis + _VX] += of_speed * missed
    state[first] = place - of_place * (both if moves else place)
    state[first + 1] = both - of_place * (speed if moves else both)
    state[first + 2] = speed - of_speed * (speed if moves else both)
