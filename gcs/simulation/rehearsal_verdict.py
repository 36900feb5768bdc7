"""Verdict of a rehearsal: figures for each cue, and problems with line and cue."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, hypot

import numpy as np
from numpy.typing import NDArray

from gcs.model.errors import Problem
from gcs.model.plan import Plan
from gcs.planning.landing_sites import column_m, overlapping
from gcs.service.snapshots import CueFigures, ShowFigures, VerticalOverlap
from gcs.shows import Flaw, Played
from gcs.simulation.metrics import rounded
from gcs.simulation.record import Record
from gcs.simulation.rehearsal import Rehearsal

TAKEOFF_M_S = 1.5
"""MPC_TKO_SPEED."""

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


def judge(flight: Rehearsal, record: Record) -> Verdict:
    return _Judge(flight, record).verdict()


class _Judge:
    """Evaluates the record of one flight, cue by cue."""

    def __init__(self, flight: Rehearsal, record: Record) -> None:
        self._flight, self._record, self._loaded = flight, record, flight.loaded
        self._time_s = np.array(record.time_s)
        self._position_m = record.path_m
        rate_hz = record.scenario.world.tick_rate_hz
        self._velocity_m_s = np.gradient(self._position_m, 1.0 / rate_hz, axis=0)
        self._closest_m = np.array(record.closest_m)
        self._began_s = flight.began_s if flight.began_s is not None else float(self._time_s[-1])
        self._ended_s = flight.ended_s if flight.ended_s is not None else float(self._time_s[-1])
        self._found = list(flight.flaws)

    def verdict(self) -> Verdict:
        show, timeline = self._loaded.show, self._loaded.timeline
        up_m_s = -self._velocity_m_s[:, :, 2]
        away_m, margin_m = self._fence()
        cues = tuple(self._cue(*each) for each in self._passages())
        home_s = self._home_s()
        need = self._battery()
        columns = self._columns()
        self._reached()
        self._apart()
        problems = tuple(sorted(self._problems(), key=lambda problem: problem.line))
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
            separation_min_at=self._where(int(self._closest_m.argmin())),
            pairs_below_floor=len(self._record.violating),
            speed_max_m_s=_short(float(np.hypot(*self._velocity_m_s[:, :, :2].transpose(2, 0, 1)).max())),
            climb_max_m_s=_short(float(up_m_s.max())),
            sink_max_m_s=_short(float(-up_m_s.min())),
            fence_distance_margin_m=_short(away_m),
            fence_height_margin_m=_short(margin_m),
            battery_need=_short(need),
            vertical_overlaps=len(columns),
            columns=tuple(columns[:COLUMNS_REPORTED]),
            cues=cues,
        )

    def _problems(self) -> list[Problem]:
        seen: dict[tuple[object, ...], Problem] = {}
        for flaw in self._found:
            seen.setdefault((*flaw.loc, flaw.text), self._loaded.problem(flaw))
        return list(seen.values())

    def _passages(self) -> list[tuple[Played, float, float]]:
        """Every cue as it was played, with start and end in show time."""
        played, end_s = self._loaded.timeline.played, self._loaded.timeline.duration_s
        nexts = [one.at_s for one in played[1:]] + [end_s]
        return [(one, one.at_s, to_s) for one, to_s in zip(played, nexts, strict=True)]

    def _ticks(self, from_s: float, to_s: float) -> NDArray[np.intp]:
        show_s = self._time_s - self._began_s
        return np.flatnonzero((show_s >= from_s - 1e-6) & (show_s < to_s - 1e-6))

    def _cue(self, one: Played, from_s: float, to_s: float) -> CueFigures:
        ticks = self._ticks(from_s, to_s)
        plan = self._loaded.timeline.plan_at(to_s - 1e-3)
        speed_m_s = np.hypot(*self._velocity_m_s[ticks][:, :, :2].transpose(2, 0, 1))
        return CueFigures(
            cue=one.cue.cue if one.passage == 1 else f"{one.cue.cue} ({one.passage})",
            line=self._loaded.source.line("timeline", one.index),
            at_s=_short(one.at_s),
            radius_m=_short(plan.formation.radius_m),
            height_m=_short(plan.formation.height_m),
            separation_m=_short(float(self._closest_m[ticks].min())),
            speed_m_s=_short(float(speed_m_s.max())),
            radius_error_m=_short(float(np.median([self._radius_error_m(tick) for tick in ticks[::5]]))),
            center_off_m=_short(self._off_m(int(ticks[-1]), plan)),
            held_back=int(np.array(self._record.limited)[ticks].max()),
        )

    def _radius_error_m(self, tick: int) -> float:
        offset_m = self._position_m[tick] - self._record.center_m[tick]
        return float(np.abs(np.linalg.norm(offset_m, axis=1) - self._record.radius_m[tick]).max())

    def _off_m(self, tick: int, plan: Plan) -> float:
        """Distance of the centre from its orbit, or from its place above the target."""
        away_m = self._record.center_m[tick][:2] - self._record.target_m[tick]
        return abs(hypot(*away_m.tolist()) - plan.orbit.radius_m)

    def _fence(self) -> tuple[float, float]:
        """Least margins to the fence: horizontal during the whole flight, vertical while the show runs."""
        fence = self._loaded.show.fence
        inside = (self._time_s >= self._began_s) & (self._time_s < self._ended_s)
        margin_m = fence.distance_max_m - np.hypot(*self._position_m[:, :, :2].transpose(2, 0, 1)).max(axis=1)
        height_m = -self._position_m[:, :, 2]
        up_m = np.minimum(fence.height_max_m - height_m, height_m - fence.height_min_m).min(axis=1)
        for what, least_m in (("distance", margin_m), ("height", np.where(inside, up_m, np.inf))):
            worst = int(least_m.argmin())
            if least_m[worst] < 0.0:
                words = (
                    f"a vehicle is {-least_m[worst]:.2f} m beyond the fence ({what}) at {self._when(worst)}"
                )
                self._found.append(Flaw(self._loc(worst), words))
        return float(margin_m.min()), float(up_m[inside].min())

    def _home_s(self) -> float | None:
        in_air = np.array([rows.any() for rows in self._record.in_air])
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
            self._found.append(
                Flaw(
                    ("fleet", "endurance_s"),
                    f"endurance_s = {fleet.endurance_s:g}: {air_s:.0f} s in the air and a reserve of"
                    f" {fleet.reserve:.0%} need {least_s} s",
                )
            )
        return need

    def _columns(self) -> list[VerticalOverlap]:
        """Pairs of vehicles above each other while the show runs, the nearest first."""
        width_m = column_m(self._flight.settings.safety.floor)
        nearest: dict[tuple[int, int], tuple[float, int]] = {}
        for tick in self._ticks(0.0, self._loaded.timeline.duration_s)[::LOOKED_AT].tolist():
            pairs, apart_m = overlapping(self._position_m[tick], width_m)
            for (upper, lower), sideways_m in zip(pairs.tolist(), apart_m.tolist(), strict=True):
                if sideways_m < nearest.get((upper, lower), (width_m, 0))[0]:
                    nearest[upper, lower] = sideways_m, tick
        return [
            VerticalOverlap(upper + 1, lower + 1, _short(sideways_m), self._where(tick))
            for (upper, lower), (sideways_m, tick) in sorted(nearest.items(), key=lambda found: found[1])
        ]

    def _reached(self) -> None:
        """Check that every orbit and every resting target is reached before the next one begins."""
        requested = [
            (one, at)
            for one, at, _ in self._passages()
            if one.cue.orbit is not None or one.cue.target is not None
        ]
        ends = [at for _, at in requested[1:]] + [self._loaded.timeline.duration_s]
        for (one, at_s), to_s in zip(requested, ends, strict=True):
            off_m = [
                self._off_m(tick, self._loaded.timeline.plan_at(float(self._time_s[tick]) - self._began_s))
                for tick in self._ticks(at_s, to_s).tolist()
            ]
            if off_m and min(off_m) > REACHED_M:
                words = (
                    f"the formation never reaches its orbit or target: {off_m[-1]:.1f} m are left at"
                    f" {to_s:g} s of the show, when the next begins"
                )
                self._found.append(Flaw(("timeline", one.index), words))

    def _apart(self) -> None:
        worst = int(self._closest_m.argmin())
        if self._record.violating:
            pairs = len(self._record.violating)
            words = (
                f"{pairs} pair{'s' if pairs > 1 else ''} closer than the floor of {self._record.floor_m:g} m:"
                f" {self._closest_m[worst]:.2f} m at {self._when(worst)}"
            )
            self._found.append(Flaw(self._loc(worst), words))

    def _loc(self, tick: int) -> tuple[str | int, ...]:
        show_s = float(self._time_s[tick]) - self._began_s
        if show_s < 0.0 or self._time_s[tick] >= self._ended_s:
            return ("timeline", 0) if show_s < 0.0 else ("duration_s",)
        return "timeline", self._loaded.timeline.cue_at(show_s).index

    def _when(self, tick: int) -> str:
        return f"{self._time_s[tick] - self._began_s:.1f} s of the show ({self._where(tick)})"

    def _where(self, tick: int) -> str:
        time_s = float(self._time_s[tick])
        if time_s < self._began_s:
            return "before the show"
        if time_s >= self._ended_s:
            return "on the way home"
        return self._loaded.timeline.cue_at(time_s - self._began_s).cue.cue


def _short(value: float) -> float:
    return round(float(value), 2)


def _named(columns: Sequence[VerticalOverlap]) -> str:
    words = [f"{pair.upper} above {pair.lower} at '{pair.cue}'" for pair in columns[:COLUMNS_NAMED]]
    return f": {', '.join(words)}{', ...' if len(columns) > COLUMNS_NAMED else ''}" if words else ""


def table(verdict: Verdict) -> str:
    home = "never" if verdict.home_s is None else f"{verdict.home_s:.0f} s"
    lines = [
        (
            f"{verdict.show}: {verdict.vehicles} vehicles, {verdict.show_s:g} s"
            f" (assembles in {verdict.assembled_s:.0f} s, home in {home})"
        ),
        f"  hash {verdict.hash}",
        (
            f"  closest {verdict.separation_min_m:.2f} m ({verdict.separation_min_at}), floor"
            f" {verdict.floor_m:g} m, {verdict.pairs_below_floor} pairs below it"
        ),
        (
            f"  speeds {verdict.speed_max_m_s:.1f} m/s sideways, {verdict.climb_max_m_s:.1f} up,"
            f" {verdict.sink_max_m_s:.1f} down"
        ),
        (
            f"  fence {verdict.fence_distance_margin_m:.1f} m left sideways,"
            f" {verdict.fence_height_margin_m:.1f} m in height"
        ),
        f"  battery {verdict.battery_need:.0%} needed, reserve included",
        f"  columns of {verdict.vertical_overlaps} pairs overlap{_named(verdict.columns)}",
        "",
    ]
    cells = [("cue", "line", "at s", "radius", "height", "closest", "speed", "shape", "centre", "held")]
    cells += [
        (
            one.cue,
            str(one.line),
            f"{one.at_s:g}",
            f"{one.radius_m:g}",
            f"{one.height_m:g}",
            f"{one.separation_m:.2f}",
            f"{one.speed_m_s:.1f}",
            f"{one.radius_error_m:.2f}",
            f"{one.center_off_m:.2f}",
            str(one.held_back),
        )
        for one in verdict.cues
    ]
    widths = [max(len(row[column]) for row in cells) for column in range(len(cells[0]))]
    for row in cells:
        name, *numbers = (
            cell.ljust(width) if not at else cell.rjust(width)
            for at, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        lines.append("  " + "  ".join([name, *numbers]))
    lines.append("")
    lines += [f"{verdict.file}: {problem}" for problem in verdict.problems] or ["good to fly"]
    return "\n".join(lines)
