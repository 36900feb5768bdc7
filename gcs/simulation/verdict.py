"""Judges a rehearsed show, cue by cue: what `gcs show check` reports."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, hypot
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.model.errors import Problem
from gcs.model.plan import Plan
from gcs.model.state import Array
from gcs.planning.landing_sites import column_m, overlapping
from gcs.planning.return_paths.within_areas import cross_edges
from gcs.safety.fenced_areas import FencedArea, beyond_m
from gcs.service.snapshots import CueFigures, ShowFigures, VerticalOverlap
from gcs.shows import Flaw, Played
from gcs.shows.drawn_checks import DrawnFigures, drawn_within, examine
from gcs.simulation.control_loss import ControlLoss, control_loss, described, sampled
from gcs.simulation.metrics import Lag, goal_of, off_shape_m
from gcs.simulation.record import penetrations_and_clearance_m, rounded
from gcs.simulation.rehearsal import TAKEOFF_M_S, Rehearsal, Replacement

REACHED_M = 1.0
"""Distance from its orbit, or from its place above the target, within which the centre has arrived."""

LOOKED_AT = 5
"""Every how many ticks overlaps are checked: no vehicle passes above another within a quarter of a second."""

COLUMNS_REPORTED, COLUMNS_NAMED = 50, 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict(ShowFigures):
    """Everything that `gcs show check` reports."""

    show: str
    file: str
    hash: str
    good: bool
    problems: tuple[Problem, ...]
    drawn: DrawnFigures | None = None  # as drawn; None: no drawing
    track_rms_m: float | None = None  # true distances from the trajectories, over time and vehicles
    track_max_m: float | None = None
    lags: tuple[Lag, ...] = ()  # of every vehicle, the largest first
    lost: tuple[int, ...] = ()  # vehicles of the show, from 1, that the rehearsal lost
    control_loss: tuple[ControlLoss, ...] = ()  # of drawn parts, for each action; a prediction
    replaced: tuple["Replaced", ...] = ()  # by spares
    not_replaced: tuple[int, ...] = ()  # lost, in a show that has spares
    penetrations: int | None = None  # vehicles inside an obstacle grown by 1 m; None: there was none


@dataclass(frozen=True, slots=True)
class Replaced:
    """A spare that took the place of a lost vehicle. Vehicles count from 1, the spares after the show's."""

    lost: int
    spare: int
    at_s: float  # time of the show when it took off
    there_s: float | None  # when it was at its trajectory; None: never
    separation_min_m: (
        float | None
    )  # from all others in the air until then, in the floor's metric; None: alone


LAG_REPORTED_M, LAGS_NAMED = 0.5, 5


def lags(flight: Rehearsal) -> tuple[Lag, ...]:
    """Return how far each vehicle was off its trajectory, the farthest first; empty without a drawing."""
    timeline, errors, drawing = flight.timeline, flight.errors, flight.loaded.drawing
    if drawing is None:
        return ()
    off_m, lags_s = np.nan_to_num(np.stack(flight.off_m), nan=0.0), []
    flown = flight.trajectory_of >= 0
    for row in [row for row in np.argsort(-errors.max_m, kind="stable").tolist() if flown[row]]:
        at_s = flight.show_s[int(off_m[:, row].argmax())]
        name = drawing.vehicles[int(flight.trajectory_of[row])]
        sizes = _short(errors.rms_m[row]), _short(errors.max_m[row])
        lags_s.append(Lag(row + 1, name, *sizes, _short(at_s), timeline.cue_at(at_s).cue.cue))
    return tuple(lags_s)


def judge(flight: Rehearsal) -> Verdict:
    return _Judge(flight).verdict()


class _Judge:
    """Evaluates the record of one flight, cue by cue."""

    def __init__(self, flight: Rehearsal) -> None:
        self._flight, self._loaded = flight, flight.loaded
        self._record = record = flight.record
        self._time_s = np.array(record.time_s)
        self._position_m = record.path_m
        rate_hz = record.scenario.world.tick_rate_hz
        self._velocity_m_s = np.gradient(self._position_m, 1.0 / rate_hz, axis=0)
        self._closest_m = np.array(record.closest_m)
        self._began_s = flight.began_s if flight.began_s is not None else float(self._time_s[-1])
        self._ended_s = flight.ended_s if flight.ended_s is not None else float(self._time_s[-1])
        self._found = list(flight.flaws)
        self._show_s = np.array(flight.show_s)
        self._lost = np.array(flight.losses.rows)  # (n,) which the station cannot command
        self._joined = np.logical_or.accumulate(np.array(record.formed), axis=0)  # (ticks, n), spares later

    def verdict(self) -> Verdict:
        show, timeline = self._loaded.show, self._loaded.timeline
        up_m_s = -self._velocity_m_s[:, :, 2]
        away_m, margin_m = self._fence()
        flown = [each for each in self._passages() if len(self._ticks(*each[1:]))]  # it may end early
        cues = tuple(self._cue(*each) for each in flown)
        home_s, need, columns = self._home_s(), self._battery(), self._columns()
        self._reached()
        self._apart()
        entered = self._entered()
        problem_of = {(*flaw.loc, flaw.text): self._loaded.problem(flaw) for flaw in self._found}
        problems = tuple(sorted(problem_of.values(), key=lambda problem: problem.line))
        return Verdict(
            show=self._loaded.name,
            file=self._loaded.file,
            hash=show.digest,
            good=not problems,
            problems=problems,
            vehicles=show.fleet.vehicles,
            show_s=_short(timeline.duration_s),
            assembled_s=_short(self._began_s),
            home_s=rounded(home_s, 2),
            floor_m=self._record.floor_m,
            separation_min_m=_short(float(self._closest_m.min())),
            separation_min_at=self._place(int(self._closest_m.argmin()))[1],
            pairs_below_floor=self._pairs_below(),
            speed_max_m_s=_short(float(np.hypot(*self._velocity_m_s[:, :, :2].transpose(2, 0, 1)).max())),
            climb_max_m_s=_short(float(up_m_s.max())),
            sink_max_m_s=_short(float(-up_m_s.min())),
            fence_distance_margin_m=_short(away_m),
            fence_height_margin_m=_short(margin_m),
            battery_need=_short(need),
            vertical_overlaps=len(columns),
            columns=tuple(columns[:COLUMNS_REPORTED]),
            cues=cues,
            lost=tuple(row + 1 for row in np.flatnonzero(self._lost).tolist()),
            replaced=tuple(map(self._replaced, self._flight.replaced)),
            not_replaced=self._not_replaced(),
            penetrations=entered,
            **self._drawn(),
        )

    def _drawn(self) -> dict[str, Any]:
        """Return the figures of drawn parts."""
        if self._loaded.drawing is None:
            return {}
        errors, drawn = self._flight.errors, examine(self._loaded.timeline)[0]
        return {
            "drawn": drawn,
            "warnings": tuple(filter(None, (drawn.mid_air, self._leaving_paths(), self._far_off()))),
            "track_rms_m": round(errors.fleet_rms_m, 3),
            "track_max_m": _short(errors.max_m.max()),
            "lags": lags(self._flight),
            "control_loss": control_loss(self._flight),
        }

    def _leaving_paths(self) -> str:
        """Name the first vehicle of which the straight way home leads out of the drawing's fence."""
        areas, flight, out = self._loaded.timeline.areas, self._flight, dict[int, float]()
        for tick in sampled(flight) if areas else ():
            leaves = cross_edges(areas, self._position_m[tick], flight.world.home_m)
            for row in np.flatnonzero(leaves & ~self._lost & self._joined[tick]).tolist():
                out.setdefault(row, flight.show_s[tick])
        if not out:
            return ""
        row, at_s = next(iter(out.items()))
        first = f"vehicle {row + 1} at {at_s:.0f} s of the show, the first of {len(out)}"
        return (
            f"the straight way home leads out of the drawing's fence for {first}: the station leads round,"
            " an autopilot that returns by itself does not know that fence"
        )

    def _replaced(self, replacement: Replacement) -> Replaced:
        """Return how a spare took the place of a lost vehicle, and how close it came to the others."""
        tracked = np.flatnonzero(np.isfinite(np.stack(self._flight.off_m)[:, replacement.spare]))
        there = int(tracked[0]) if len(tracked) else None
        floor, nearest_m = self._flight.floor, np.inf
        for tick in range(replacement.tick, len(self._time_s) if there is None else there + 1):
            others = np.array(self._record.in_air[tick])
            others[replacement.spare] = False
            away_m = (
                self._position_m[tick, others] - self._position_m[tick, replacement.spare]
            ) * floor.scale
            nearest_m = min(nearest_m, float(np.linalg.norm(away_m, axis=1).min(initial=np.inf)))
        return Replaced(
            replacement.lost + 1,
            replacement.spare + 1,
            _short(max(self._show_s[replacement.tick], 0.0)),
            None if there is None else _short(self._show_s[there]),
            _short(nearest_m) if np.isfinite(nearest_m) else None,
        )

    def _not_replaced(self) -> tuple[int, ...]:
        replaced = {replacement.lost for replacement in self._flight.replaced}
        rows = np.flatnonzero(self._lost).tolist() if self._flight.run.spares_most else []
        return tuple(row + 1 for row in rows if row not in replaced)

    def _entered(self) -> int | None:
        """Return how many vehicles came inside an obstacle; None: there was none."""
        if not any(self._record.boxes):
            return None
        entered = penetrations_and_clearance_m(self._record)[0]
        if entered:
            self._found.append(Flaw(("timeline", 0), f"{entered} vehicles come within 1 m of an obstacle"))
        return entered

    def _passages(self) -> list[tuple[Played, float, float]]:
        """Every cue as it was played, with start and end in show time."""
        played, end_s = self._loaded.timeline.played, self._loaded.timeline.duration_s
        nexts = [cue_played.at_s for cue_played in played[1:]] + [end_s]
        return [(cue_played, cue_played.at_s, to_s) for cue_played, to_s in zip(played, nexts, strict=True)]

    def _ticks(self, from_s: float, to_s: float) -> NDArray[np.intp]:
        flown = (self._time_s >= self._began_s) & (self._time_s < self._ended_s)
        return np.flatnonzero(flown & (self._show_s >= from_s - 1e-6) & (self._show_s < to_s - 1e-6))

    def _cue(self, played: Played, from_s: float, to_s: float) -> CueFigures:
        ticks = self._ticks(from_s, to_s)
        plan, drawn = self._loaded.timeline.plan_at(to_s - 1e-3), played.cue.trajectories is not None
        speed_m_s = np.hypot(*self._velocity_m_s[ticks][:, :, :2].transpose(2, 0, 1))
        return CueFigures(
            cue=played.cue.cue if played.passage == 1 else f"{played.cue.cue} ({played.passage})",
            line=self._loaded.source.line("timeline", played.index),
            at_s=_short(played.at_s),
            radius_m=0.0 if drawn else _short(plan.formation.radius_m),
            height_m=_short(-self._flown_m(ticks[-1])[:, 2].mean() if drawn else plan.formation.height_m),
            separation_m=_short(float(self._closest_m[ticks].min())),
            speed_m_s=_short(float(speed_m_s.max())),
            radius_error_m=None if drawn else self._median_shape_error_m(ticks),
            center_off_m=None if drawn else _short(self._off_m(int(ticks[-1]), plan)),
            held_back=int(np.array(self._record.limited)[ticks].max()),
        )

    def _median_shape_error_m(self, ticks: NDArray[np.intp]) -> float | None:
        """None for a law that ends in a shape of which no distance is defined."""
        off_m = float(np.median([self._shape_error_m(tick) for tick in ticks[::5].tolist()]))
        return _short(off_m) if np.isfinite(off_m) else None

    def _shape_error_m(self, tick: int) -> float:
        """Distance of the vehicle that is farthest from the law's shape; NaN as above."""
        offset_m = self._flown_m(tick) - self._record.center_m[tick]
        return float(off_shape_m(goal_of(self._record), offset_m, self._record.radius_m[tick]).max())

    def _flown_m(self, tick: int) -> Array:
        """(k, 3) True positions of the vehicles that fly with the show, or did."""
        return np.asarray(self._position_m[tick, self._joined[tick]])

    def _off_m(self, tick: int, plan: Plan) -> float:
        """Distance of the centre from its orbit, or from its place above the target."""
        away_m = self._record.center_m[tick][:2] - self._record.target_m[tick]
        return abs(hypot(*away_m.tolist()) - plan.orbit.radius_m)

    def _fence(self) -> tuple[float, float]:
        """Least margins to the fence: horizontal during the whole flight, vertical while the show runs."""
        fence, rows = self._loaded.show.fence, np.flatnonzero(~self._lost)
        inside = (self._time_s >= self._began_s) & (self._time_s < self._ended_s)
        ours_m = self._position_m[:, rows]
        height_m = -ours_m[:, :, 2]
        counts = inside[:, None] & self._joined[:, rows]
        away_m = fence.distance_max_m - np.hypot(ours_m[:, :, 0], ours_m[:, :, 1])
        above_m = np.where(counts, fence.height_max_m - height_m, np.inf)
        below_m = np.where(counts, height_m - fence.height_min_m, np.inf)
        self._areas(ours_m)
        for where, room_m in (("beyond", away_m), ("above", above_m), ("below", below_m)):
            tick, column = np.unravel_index(int(room_m.argmin()), room_m.shape)
            if room_m[tick, column] < 0.0:
                row = int(rows[column])
                words = f"vehicle {row + 1} is {-room_m[tick, column]:.2f} m {where} the fence"
                self._note(int(tick), words, self._held_off(row, int(tick)))
        return float(away_m.min()), float(min(above_m.min(), below_m.min()))

    def _held_off(self, row: int, tick: int) -> str:
        """Say how far a vehicle is from its trajectory, and which one is drawn closer than the filter keeps.

        Returns: "" where none is until then, or no drawn part runs.
        """
        flight, floor = self._flight, self._flight.floor
        mine = int(flight.trajectory_of[row])
        off_m = flight.off_m[tick][row] if tick < len(flight.off_m) else np.nan
        if mine < 0 or not np.isfinite(off_m):
            return ""
        wide_m, tall_m = floor.kept_m(floor.worst_reserve_m(np.array(flight.traits.uncertainty_m)))
        pair = drawn_within(self._loaded.timeline, mine, (wide_m, tall_m), float(self._show_s[tick]))
        kept = f"inside of the {wide_m:.1f} m and {tall_m:.1f} m that the filter keeps"
        return f"{off_m:.1f} m from its trajectory: {pair}, {kept}" if pair else ""

    def _far_off(self) -> str:
        """Name the vehicle that is farthest from its trajectory if it is late, and held off by another."""
        off_m, named = np.nan_to_num(np.stack(self._flight.off_m)), self._loaded.show.drawing
        tick, row = np.unravel_index(int(off_m.argmax()), off_m.shape)
        if named is None or off_m[tick, row] <= named.waits_from_m:
            return ""
        why = self._held_off(int(row), int(tick))
        return f"vehicle {row + 1} is at {self._show_s[tick]:.1f} s of the show {why}" if why else ""

    def _areas(self, ours_m: Array) -> None:
        """Check that no vehicle leaves the areas of the fence, on its way home either."""
        for areas, whose in (
            (self._loaded.timeline.areas, "of the drawing"),
            (self._flight.rules.areas, "of the service"),
        ):
            if areas:
                self._beyond(ours_m, areas, whose)

    def _beyond(self, ours_m: Array, areas: Sequence[FencedArea], whose: str) -> None:
        over_m = np.stack([beyond_m(areas, place_m) for place_m in ours_m])
        at, row = np.unravel_index(int(over_m.argmax()), over_m.shape)
        if over_m[at, row] > 0.0:
            vehicle = int(np.flatnonzero(~self._lost)[row]) + 1
            words = f"vehicle {vehicle} is {over_m[at, row]:.2f} m beyond the fence {whose}"
            self._note(int(at), words)

    def _home_s(self) -> float | None:
        in_air = np.array([(rows & ~self._lost).any() for rows in self._record.in_air])
        if in_air[-1] or self._flight.ended_s is None:
            self._found.append(Flaw(("duration_s",), "not all vehicles have come home"))
            return None
        return float(self._time_s[-1]) - self._ended_s

    def _battery(self) -> float:
        """Share of a full battery that the first vehicle to take off needs, with the reserve."""
        fleet = self._loaded.show.fleet
        up_s = fleet.takeoff_height_m / TAKEOFF_M_S + fleet.takeoff_stagger_s * (fleet.vehicles - 1)
        air_s = up_s + float(self._time_s[-1])
        need = air_s / fleet.endurance_s + fleet.reserve
        if need > 1.0:
            least_s = ceil(air_s / (1.0 - fleet.reserve))
            words = f"{air_s:.0f} s in the air and a reserve of {fleet.reserve:.0%} need {least_s} s"
            words = f"endurance_s = {fleet.endurance_s:g}: {words}"
            self._found.append(Flaw(("fleet", "endurance_s"), words))
        return need

    def _columns(self) -> list[VerticalOverlap]:
        """Pairs of vehicles above each other while the show runs, the nearest first."""
        width_m = column_m(self._flight.settings.safety.floor)
        nearest: dict[tuple[int, int], tuple[float, int]] = {}
        for tick in self._ticks(0.0, self._loaded.timeline.duration_s)[::LOOKED_AT].tolist():
            in_air = np.flatnonzero(self._record.in_air[tick])
            pairs, apart_m = overlapping(self._position_m[tick, in_air], width_m)
            for (upper, lower), sideways_m in zip(in_air[pairs].tolist(), apart_m.tolist(), strict=True):
                if sideways_m < nearest.get((upper, lower), (width_m, 0))[0]:
                    nearest[upper, lower] = sideways_m, tick
        return [
            VerticalOverlap(upper + 1, lower + 1, _short(sideways_m), self._place(tick)[1])
            for (upper, lower), (sideways_m, tick) in sorted(nearest.items(), key=lambda column: column[1])
        ]

    def _reached(self) -> None:
        """Check that every orbit and every resting target is reached before the next one begins."""
        requested = [
            (played, at)
            for played, at, _ in self._passages()
            if played.cue.orbit is not None or played.cue.target is not None
        ]
        ends = [at for _, at in requested[1:]] + [self._loaded.timeline.duration_s]
        for (played, at_s), to_s in zip(requested, ends[: len(requested)], strict=True):
            off_m = [
                self._off_m(tick, self._loaded.timeline.plan_at(float(self._show_s[tick])))
                for tick in self._ticks(at_s, to_s).tolist()
                if np.isfinite(self._record.center_m[tick]).all()
            ]
            if off_m and min(off_m) > REACHED_M:
                words = f"{off_m[-1]:.1f} m are left at {to_s:g} s of the show, when the next begins"
                words = f"the formation never reaches its orbit or target: {words}"
                self._found.append(Flaw(("timeline", played.index), words))

    def _pairs_below(self) -> int:
        """Return how many pairs came below the floor, without those of two lost vehicles."""
        lost = self._record.lost_rows
        return sum(not lost.issuperset(pair) for pair in self._record.violating)

    def _apart(self) -> None:
        worst, pairs = int(self._closest_m.argmin()), self._pairs_below()
        if pairs:
            closer = f"{pairs} pair{'s' if pairs > 1 else ''} closer than the floor of"
            self._note(worst, f"{closer} {self._record.floor_m:g} m: {self._closest_m[worst]:.2f} m")

    def _note(self, tick: int, words: str, more: str = "") -> None:
        """Add a flaw at that tick, to its cue."""
        loc, where = self._place(tick)
        when = f"{self._show_s[tick]:.1f} s of the show ({where})"
        self._found.append(Flaw(loc, ", ".join(filter(None, (f"{words} at {when}", more)))))

    def _place(self, tick: int) -> tuple[tuple[str | int, ...], str]:
        """Return the path of a tick's cue in the file, and its name."""
        time_s = float(self._time_s[tick])
        if time_s < self._began_s:
            return ("timeline", 0), "before the show"
        if time_s >= self._ended_s:
            return ("duration_s",), "on the way home"
        played = self._loaded.timeline.cue_at(float(self._show_s[tick]))
        return ("timeline", played.index), played.cue.cue


def _short(value: float) -> float:
    return round(float(value), 2)


def _named(columns: Sequence[VerticalOverlap]) -> str:
    words = [f"{pair.upper} above {pair.lower} at '{pair.cue}'" for pair in columns[:COLUMNS_NAMED]]
    return f": {', '.join(words)}{', ...' if len(columns) > COLUMNS_NAMED else ''}" if words else ""


def _adverse_lines(verdict: Verdict) -> list[str]:
    lines = []
    if verdict.lost:
        lines.append(f"  lost on purpose: {', '.join(map(str, verdict.lost))}")
    for replaced in verdict.replaced:
        there = "is never there" if replaced.there_s is None else f"is there at {replaced.there_s:.0f} s"
        off = f"takes off at {replaced.at_s:.0f} s, {there}"
        words = f"  {replaced.spare} takes the place of {replaced.lost}: {off}"
        near = replaced.separation_min_m
        lines.append(words if near is None else f"{words}, {near:.2f} m from the nearest on its way")
    if verdict.not_replaced:
        lines.append(f"  no spare takes the place of {', '.join(map(str, verdict.not_replaced))}")
    if verdict.penetrations is not None:
        lines.append(f"  {verdict.penetrations} vehicles came within 1 m of an obstacle")
    return lines


def _drawn_lines(verdict: Verdict) -> list[str]:
    drawn = verdict.drawn
    if drawn is None:
        return []
    lines = [f"  track error {verdict.track_rms_m} m rms, at most {verdict.track_max_m} m"]
    named = [
        f"{lag.vehicle} by {lag.max_m:g} m at {lag.at_s:.0f} s ('{lag.cue}')"
        for lag in verdict.lags[:LAGS_NAMED]
        if lag.max_m >= LAG_REPORTED_M
    ]
    if named:
        lines.append(f"  most behind: {', '.join(named)}")
    if drawn.closest is not None:
        pair = f"{drawn.closest[0]} and {drawn.closest[1]} at {drawn.separation_min_at_s:g} s of the drawing"
        lines.append(f"  drawn closest {drawn.separation_min_m:.2f} m ({pair})")
    for claim in drawn.claims:
        kept = "holds" if claim.holds else "does not hold"
        lines.append(f"  the file claims {claim.name} {claim.claimed:g}: {kept}, {claim.measured:g}")
    lines += [f"  warning: {warning}" for warning in verdict.warnings]
    return lines + described(verdict.control_loss)


def _apart(verdict: Verdict, separation_m: float | None) -> str:
    return "-" if verdict.vehicles == 1 or separation_m is None else f"{separation_m:.2f}"


def table(verdict: Verdict) -> str:
    home = "never" if verdict.home_s is None else f"{verdict.home_s:.0f} s"
    times = f"assembles in {verdict.assembled_s:.0f} s, home in {home}"
    floor = f"floor {verdict.floor_m:g} m, {verdict.pairs_below_floor} pairs below it"
    vertical = f"{verdict.climb_max_m_s:.1f} up, {verdict.sink_max_m_s:.1f} down"
    height = f"{verdict.fence_height_margin_m:.1f} m in height"
    lines = [
        f"{verdict.show}: {verdict.vehicles} vehicles, {verdict.show_s:g} s ({times})",
        f"  hash {verdict.hash}",
        f"  closest {_apart(verdict, verdict.separation_min_m)} m ({verdict.separation_min_at}), {floor}",
        f"  speeds {verdict.speed_max_m_s:.1f} m/s sideways, {vertical}",
        f"  fence {verdict.fence_distance_margin_m:.1f} m left sideways, {height}",
        f"  battery {verdict.battery_need:.0%} needed, reserve included",
        f"  columns of {verdict.vertical_overlaps} pairs overlap{_named(verdict.columns)}",
        *_adverse_lines(verdict),
        *_drawn_lines(verdict),
        "",
    ]
    cells = [("cue", "line", "at s", "radius", "height", "closest", "speed", "shape", "centre", "held")]
    cells += [
        (
            cue.cue,
            str(cue.line),
            f"{cue.at_s:g}",
            f"{cue.radius_m:g}",
            f"{cue.height_m:g}",
            _apart(verdict, cue.separation_m),
            f"{cue.speed_m_s:.1f}",
            "-" if cue.radius_error_m is None else f"{cue.radius_error_m:.2f}",
            "-" if cue.center_off_m is None else f"{cue.center_off_m:.2f}",
            str(cue.held_back),
        )
        for cue in verdict.cues
    ]
    first, *others = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines += ["  " + "  ".join([row[0].ljust(first), *map(str.rjust, row[1:], others)]) for row in cells]
    problems = [f"{verdict.file}: {problem}" for problem in verdict.problems]
    return "\n".join([*lines, "", *(problems or ["good to fly"])])
