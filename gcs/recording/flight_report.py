"""Judges a flight by its recorded positions: separation, fence, limits."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.model.errors import GcsError
from gcs.model.jit import kernel
from gcs.model.state import Array, Mask
from gcs.recording.ground_kept import beyond_areas_m, ground_kept
from gcs.recording.mcap_reader import Standard
from gcs.recording.trajectories import FlownTrajectories, OnProgress, Single
from gcs.safety.floor import Floor
from gcs.service.snapshots import GroundKept, NearestPair, ReportBody, ReportCheck

EXIT_CODES: Final[dict[str, int]] = {"kept": 0, "broken": 1, "incomplete": 3}
"""Exit codes of `gcs report`, by verdict; 2: no flight, or no limits to judge by."""

NEAREST: Final = 20
"""Number of pairs that the report names."""

SMOOTHED_S: Final = 0.5
"""Speeds and accelerations are means over this time: noise of an estimate is no motion."""

TOLERATED: Final = 0.1
TOLERATED_M_S, TOLERATED_M_S2 = 0.3, 0.5
"""Tolerated share and offset: limits apply to commands, and a vehicle's response may exceed them by this."""

TOLERATED_SETPOINT: Final = 1e-4
"""Setpoints have no response: only rounding to single precision is tolerated."""

FAR: Final = 8.0
"""Pairs farther apart than this multiple of the minimum separation are not examined between samples."""

PAIRS_AT_ONCE: Final = 20_000_000
"""Number of pairs times samples between two progress reports, about 0.1 s."""

Limit: TypeAlias = Callable[[Standard], float]


@dataclass(frozen=True, slots=True, eq=False)
class PairDistances:
    """Least values of every pair (i < j), (n, n) each; inf and -1 if the pair never counted."""

    distance_m: Single  # between centres
    ratio: Single  # of the distance to the minimum, in the ellipsoid's metric: below 1 is inside
    sure_ratio: Single  # the same if they were nearer by all that the margin for their uncertainty covers
    sample: NDArray[np.int32]  # of the least ratio

    def nearest(self, count: int) -> list[tuple[int, int]]:
        first, second = np.triu_indices(len(self.ratio), 1)
        ratio = self.ratio[first, second]
        order = np.argsort(ratio, kind="stable")[:count]
        return [(int(first[at]), int(second[at])) for at in order.tolist() if np.isfinite(ratio[at])]

    def with_nearer(self, later: "PairDistances") -> "PairDistances":
        """Return the smaller of both values, pair by pair."""
        nearer = later.ratio < self.ratio
        return PairDistances(
            np.minimum(self.distance_m, later.distance_m),
            np.where(nearer, later.ratio, self.ratio),
            np.minimum(self.sure_ratio, later.sure_ratio),
            np.where(nearer, later.sample, self.sample),
        )


@dataclass(frozen=True, slots=True, eq=False)
class FlightReport:
    """The results, and the data for plots."""

    trajectories: FlownTrajectories
    standards: tuple[Standard, ...]  # that applied, in order
    pairs: PairDistances
    least_m: Single  # (k,) least distance of all pairs
    checks: tuple[ReportCheck, ...]  # broken ones first
    ground: GroundKept | None = None  # None: no controlled ground

    @property
    def standard(self) -> Standard:
        """The last standard that applied: plots use it."""
        at = self.trajectories.held_at
        return self.standards[-1 if at is None else int(at[-1])]

    @property
    def missing(self) -> tuple[str, ...]:
        """Why it is not known that all limits were kept, in words; empty if it is known."""
        if not self.trajectories.airborne.any():
            return *self.trajectories.missing, "no vehicle was in the air: there was nothing to judge"
        if all(check.kept is None for check in self.checks):
            return *self.trajectories.missing, "nothing is known of those in the air"
        return self.trajectories.missing

    @property
    def verdict(self) -> Literal["kept", "broken", "incomplete"]:
        """A key of `EXIT_CODES`; "kept" requires a complete record without violations."""
        if any(check.kept is False for check in self.checks):
            return "broken"
        return "incomplete" if self.missing else "kept"

    @property
    def hashes(self) -> list[tuple[str, str]]:
        """Hashes of the site and of the shows that were flown, with what each is of."""
        trajectories = self.trajectories
        site = [("site", trajectories.site_hash)] if trajectories.site_hash else []
        return [*site, *(("show", digest) for digest in trajectories.show_hashes)]

    @property
    def wind(self) -> str:
        """The greatest wind that was measured, in words; empty: none was."""
        wind_m_s = self.trajectories.wind_m_s
        return "" if wind_m_s is None else f"up to {wind_m_s:g} m/s with gusts, as the vehicles measured it"

    @property
    def duration_s(self) -> float:
        return float(self.trajectories.time_s[-1] - self.trajectories.time_s[0])

    def report(self, source: str) -> ReportBody:
        """Return the report; `source` names the files that were judged."""
        trajectories, pairs = self.trajectories, self.pairs
        return ReportBody(
            source,
            self.verdict,
            self.missing,
            trajectories.based_on,
            trajectories.uncertainty,
            trajectories.remarks,
            len(trajectories.ids),
            dict(sorted(Counter(trajectories.autopilots).items())),
            int(trajectories.airborne.any(axis=0).sum()),
            round(self.duration_s, 2),
            self.checks,
            tuple(
                NearestPair(
                    (trajectories.ids[i], trajectories.ids[j]),
                    round(float(pairs.distance_m[i, j]), 3),
                    round(float(pairs.ratio[i, j]), 3),
                    round(float(pairs.sure_ratio[i, j]), 3),
                    trajectories.elapsed_s(pairs.sample[i, j]),
                )
                for i, j in pairs.nearest(NEAREST)
            ),
            trajectories.tracking,
            trajectories.traffic,
            self.ground,
            trajectories.site_hash or None,
            trajectories.show_hashes,
            trajectories.wind_m_s,
        )


def make_flight_report(
    trajectories: FlownTrajectories,
    standard: Standard,
    *,
    by_it_alone: bool = False,
    on_progress: OnProgress | None = None,
) -> FlightReport:
    """Judge a flight. Pure.

    Args:
        trajectories: of the flight.
        standard: applies where no limits were recorded.
        by_it_alone: use `standard` even where limits were recorded.
        on_progress: is called with the judged share, from 0 to 1.

    Raises: GcsError when the recorded limits are invalid.
    """
    if by_it_alone:
        count = 1 if trajectories.setpoint_m_s is None else len(trajectories.setpoint_m_s)
        trajectories = replace(
            trajectories,
            held=(None,),
            held_at=np.zeros(len(trajectories.time_s), np.intp),
            setpoint_held_at=np.zeros(count, np.intp),
        )
    standards = tuple(standard.under(limits) for limits in trajectories.held)
    pairs, least_m = _approaches(trajectories, standards, on_progress)
    ground = ground_kept(trajectories, standards)
    checks = (
        _separation(trajectories, pairs),
        *_fence(trajectories, standards),
        *_areas(trajectories, standards),
        *_ground(ground),
        *_speeds(trajectories, standards),
        *_setpoints(trajectories, standards),
    )
    broken_first = tuple(sorted(checks, key=lambda check: check.kept is not False))
    return FlightReport(trajectories, standards, pairs, least_m, broken_first, ground)


def _approaches(
    trajectories: FlownTrajectories, standards: Sequence[Standard], on_progress: OnProgress | None
) -> tuple[PairDistances, Single]:
    """Nearest approaches, each judged by the minimum separation at its time; in pieces, for the progress."""
    at = np.zeros(len(trajectories.time_s), np.intp) if trajectories.held_at is None else trajectories.held_at
    samples = max(1, PAIRS_AT_ONCE // max(1, len(trajectories.ids)) ** 2)
    changes = (np.flatnonzero(np.diff(at)) + 1).tolist()
    borders = sorted({0, *changes, *range(0, len(at), samples), len(at)})
    nearest: PairDistances | None = None
    least_m = np.full(len(at), np.inf, np.float32)
    for first, end in pairwise(borders):
        reach = min(end + 1, len(at))  # up to the next sample: the path between two is straight
        part = replace(
            trajectories,
            time_s=trajectories.time_s[first:reach],
            position_m=trajectories.position_m[first:reach],
            uncertainty_m=trajectories.uncertainty_m[first:reach],
            airborne=trajectories.airborne[first:reach],
        )
        pairs, near_m = nearest_approaches(part, standards[int(at[first])].safety.floor)
        least_m[first:reach] = np.minimum(least_m[first:reach], near_m)
        later = replace(pairs, sample=np.where(pairs.sample < 0, -1, pairs.sample + first).astype(np.int32))
        nearest = later if nearest is None else nearest.with_nearer(later)
        if on_progress is not None:
            on_progress(end / len(at))
    if nearest is None:
        raise GcsError("there is no flight in it")
    return nearest, least_m


def _separation(trajectories: FlownTrajectories, pairs: PairDistances) -> ReportCheck:
    nearest = pairs.nearest(1)
    named, unit = ("separation, as a share of the floor", 1.0, 1.0), "of the floor"
    if not nearest:
        return ReportCheck(*named, None, unit, "", None, kept=None)
    i, j = nearest[0]
    ratio, at_s = float(pairs.ratio[i, j]), trajectories.elapsed_s(pairs.sample[i, j])
    both = f"{trajectories.ids[i]} and {trajectories.ids[j]}"
    return ReportCheck(*named, round(ratio, 3), unit, both, at_s, kept=ratio >= 1.0)


def _over_time(
    trajectories: FlownTrajectories, standards: Sequence[Standard], of: Limit, *, setpoints: bool = False
) -> Array:
    """(k,) The limit at each sample, or at each setpoint."""
    at = trajectories.setpoint_held_at if setpoints else trajectories.held_at
    each = np.array([of(standard) for standard in standards])
    times = trajectories.setpoint_m_s if setpoints else trajectories.time_s
    return np.full(0 if times is None else len(times), each[0]) if at is None else each[at]


def _fence(trajectories: FlownTrajectories, standards: Sequence[Standard]) -> list[ReportCheck]:
    limit = partial(_over_time, trajectories, standards)
    place_m, airborne = trajectories.position_m, trajectories.airborne
    out_m, height_m = np.hypot(place_m[..., 0], place_m[..., 1]), -place_m[..., 2]
    farthest_m = limit(lambda standard: standard.safety.fence.distance_max_m)
    highest_m = limit(lambda standard: standard.safety.fence.height_max_m)
    lowest_m = limit(lambda standard: standard.safety.fence.height_min_m)
    lowest = _most("", -lowest_m, -height_m, trajectories.formed, trajectories, "m")
    return [
        _most("greatest distance", farthest_m, out_m, airborne, trajectories, "m"),
        _most("greatest height", highest_m, height_m, airborne, trajectories, "m"),
        replace(
            lowest,
            name="least height in the formation",
            limit=-lowest.limit,
            tolerated=-lowest.limit,
            worst=None if lowest.worst is None else -lowest.worst,
        ),
    ]


def _areas(trajectories: FlownTrajectories, standards: Sequence[Standard]) -> list[ReportCheck]:
    """Check the areas of the fence, where there were any."""
    over_m = beyond_areas_m(trajectories, standards)
    if over_m is None:
        return []
    none_m = np.zeros(len(trajectories.time_s))
    return [_most("beyond an area of the fence", none_m, over_m, trajectories.airborne, trajectories, "m")]


def _ground(ground: GroundKept | None) -> list[ReportCheck]:
    """Check that no vehicle could have fallen beyond the controlled ground, where there was some."""
    if ground is None:
        return []
    named, worst_m = ("impact beyond controlled ground", 0.0, 0.0), -ground.margin_m
    return [ReportCheck(*named, worst_m, "m", ground.vehicle, ground.at_s, kept=worst_m <= 0.0)]


def _directions(
    velocity_m_s: NDArray[Any],
) -> Iterator[tuple[str, Callable[[Standard], float], NDArray[Any]]]:
    """Yield name, limit and (k, n) speeds in each direction that has a limit, from velocities (k, n, 3)."""
    flat_m_s = np.hypot(velocity_m_s[..., 0], velocity_m_s[..., 1])
    yield "sideways", lambda standard: standard.safety.limits.horizontal_m_s, flat_m_s
    yield "up", lambda standard: standard.safety.limits.up_m_s, -velocity_m_s[..., 2]
    yield "down", lambda standard: standard.safety.limits.down_m_s, velocity_m_s[..., 2]


def _speeds(trajectories: FlownTrajectories, standards: Sequence[Standard]) -> list[ReportCheck]:
    limit = partial(_over_time, trajectories, standards)
    period_s = float(np.median(np.diff(trajectories.time_s))) if len(trajectories.time_s) > 1 else SMOOTHED_S
    width = max(1, round(SMOOTHED_S / period_s))
    velocity_m_s = _smoothed(np.asarray(trajectories.velocity_m_s, np.float64), width)
    flown = _throughout(trajectories.flown, width)
    change = np.full_like(velocity_m_s, np.nan)
    if len(velocity_m_s) > width:
        change[width:] = (velocity_m_s[width:] - velocity_m_s[:-width]) / (width * period_s)
    most_m_s2 = limit(lambda standard: standard.acceleration_max_m_s2)
    tolerated = 1.0 + TOLERATED
    pushed = _throughout(_throughout(trajectories.flown & trajectories.recent, width), width)
    size_m_s2 = np.linalg.norm(change, axis=-1)
    return [
        *(
            _most(f"speed {name}", limit(of), speed, flown, trajectories, "m/s", tolerated, TOLERATED_M_S)
            for name, of, speed in _directions(velocity_m_s)
        ),
        _most("acceleration", most_m_s2, size_m_s2, pushed, trajectories, "m/s^2", tolerated, TOLERATED_M_S2),
    ]


def _setpoints(trajectories: FlownTrajectories, standards: Sequence[Standard]) -> list[ReportCheck]:
    """ReportCheck the commanded setpoints, tick by tick, where they are known."""
    desired_m_s = trajectories.setpoint_m_s
    if desired_m_s is None:
        return []
    given: Mask = np.asarray(np.isfinite(desired_m_s).all(axis=-1))
    limit = partial(_over_time, trajectories, standards, setpoints=True)
    tolerated = 1.0 + TOLERATED_SETPOINT
    return [
        _most(f"setpoint {name}", limit(of), speed, given, trajectories, "m/s", tolerated, timed=False)
        for name, of, speed in _directions(desired_m_s)
    ]


def _most(
    name: str,
    limit: Array,
    value: Array | Single,
    counts: Mask,
    trajectories: FlownTrajectories,
    unit: str,
    factor: float = 1.0,
    beyond: float = 0.0,
    *,
    timed: bool = True,
) -> ReportCheck:
    """Return the check of the value of (k, n) that exceeds its limit (k,) most, or is nearest to it."""
    tolerated = limit * factor + beyond
    over = np.where(counts & np.isfinite(value), value - tolerated[:, None], -np.inf)
    at, row = np.unravel_index(int(np.argmax(over)), over.shape)
    if not np.isfinite(over[at, row]):
        return ReportCheck(name, float(limit[-1]), float(tolerated[-1]), None, unit, "", None, kept=None)
    worst, most = float(value[at, row]), float(tolerated[at])
    at_s, vehicle = trajectories.elapsed_s(at) if timed else None, trajectories.ids[row]
    values = float(limit[at]), round(most, 3), round(worst, 3)
    return ReportCheck(name, *values, unit, vehicle, at_s, kept=worst <= most)


def _smoothed(value: Array, width: int) -> Array:
    """(k, n, 3) Means over the last `width` samples; NaN until there are as many."""
    total = np.cumsum(np.nan_to_num(value), axis=0)
    smooth = np.full_like(value, np.nan)
    smooth[width - 1 :] = total[width - 1 :]
    smooth[width:] -= total[:-width]
    return smooth / width


def _throughout(mask: Mask, width: int) -> Mask:
    """(k, n) Where the mask was true for the last `width` samples."""
    total = np.cumsum(mask, axis=0)
    held = np.zeros_like(mask)
    held[width - 1 :] = total[width - 1 :] == width
    held[width:] = total[width:] - total[:-width] == width
    return held


def nearest_approaches(trajectories: FlownTrajectories, floor: Floor) -> tuple[PairDistances, Single]:
    """Return each pair's least values where one at least flies and not both are low over their pads.

    Returns: the pairs, and (k,) the least distance of all in each sample.
    """
    distance_m, ratio, sure_ratio, sample, over_time_m = _nearest(
        np.ascontiguousarray(trajectories.position_m, np.float32),
        np.ascontiguousarray(trajectories.airborne),
        np.ascontiguousarray(trajectories.uncertainty_m, np.float32),
        (floor.horizontal_m, floor.vertical_m, floor.pad_height_m),
        (floor.vertical_uncertainty, floor.deviations),
    )
    return PairDistances(distance_m, ratio, sure_ratio, sample), over_time_m


@kernel
def _nearest(
    position_m: Single,
    airborne: NDArray[np.bool_],
    uncertainty_m: Single,
    floor_m: tuple[float, float, float],
    uncertain: tuple[float, float],
) -> tuple[Single, Single, Single, NDArray[np.int32], Single]:
    (horizontal_m, vertical_m, pad_m), (vertical_uncertainty, deviations) = floor_m, uncertain
    k, n = position_m.shape[0], position_m.shape[1]
    distance_m = np.full((n, n), np.inf, np.float32)
    ratio = np.full((n, n), np.inf, np.float32)
    sure_ratio = np.full((n, n), np.inf, np.float32)
    sample = np.full((n, n), -1, np.int32)
    over_time_m = np.full(k, np.inf, np.float32)
    for t in range(k):
        for i in range(n):
            if not np.isfinite(position_m[t, i].sum()):
                continue
            for j in range(i + 1, n):
                if not (airborne[t, i] or airborne[t, j]) or not np.isfinite(position_m[t, j].sum()):
                    continue
                if -position_m[t, i, 2] < pad_m and -position_m[t, j, 2] < pad_m:
                    continue
                x = position_m[t, i, 0] - position_m[t, j, 0]
                y = position_m[t, i, 1] - position_m[t, j, 1]
                z = position_m[t, i, 2] - position_m[t, j, 2]
                away_m = np.sqrt(x * x + y * y + z * z)
                scaled = np.sqrt((x * x + y * y) / horizontal_m**2 + z * z / vertical_m**2)
                if t + 1 < k and scaled < FAR:
                    # straight to the next sample, in relative motion of the two
                    dx = position_m[t + 1, i, 0] - position_m[t + 1, j, 0] - x
                    dy = position_m[t + 1, i, 1] - position_m[t + 1, j, 1] - y
                    dz = position_m[t + 1, i, 2] - position_m[t + 1, j, 2] - z
                    along = (x * dx + y * dy) / horizontal_m**2 + z * dz / vertical_m**2
                    length = (dx * dx + dy * dy) / horizontal_m**2 + dz * dz / vertical_m**2
                    if along < 0.0 and length > 0.0 and np.isfinite(length):
                        share = min(1.0, -along / length)
                        x, y, z = x + share * dx, y + share * dy, z + share * dz
                        away_m = min(away_m, np.sqrt(x * x + y * y + z * z))
                        scaled = np.sqrt((x * x + y * y) / horizontal_m**2 + z * z / vertical_m**2)
                off_m = deviations * np.sqrt(uncertainty_m[t, i] ** 2 + uncertainty_m[t, j] ** 2)
                off = off_m / min(horizontal_m, vertical_m / vertical_uncertainty)
                distance_m[i, j] = min(distance_m[i, j], away_m)
                over_time_m[t] = min(over_time_m[t], away_m)
                sure_ratio[i, j] = min(sure_ratio[i, j], scaled - off)
                if scaled < ratio[i, j]:
                    ratio[i, j] = scaled
                    sample[i, j] = t
    return distance_m, ratio, sure_ratio, sample, over_time_m
