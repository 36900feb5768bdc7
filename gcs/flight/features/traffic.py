"""Other traffic: what sources report, what vehicles keep clear of, and what operators are to know."""

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from math import hypot, inf, isfinite, nan
from typing import Final

import numpy as np

from gcs.control.traffic import Approaches, Sphere, announced, approaches, tracks_near
from gcs.estimation.targets.source_clock import AGREES_S, AHEAD_S
from gcs.estimation.traffic import FARTHEST_M, FASTEST_M_S, TrackReport, TracksNow, TrackTable
from gcs.flight.state.feature import Feature, Instant
from gcs.flight.state.newest import Newest
from gcs.links.features import TrafficSettings
from gcs.links.intake import Intake
from gcs.links.tak.settings import OwnTracks
from gcs.links.targets.receive import intake_of, keep_receiving_tracks
from gcs.model.frames import ShowFrame
from gcs.model.lifecycle import ON_THE_GROUND
from gcs.model.preflight_report import Check, State
from gcs.model.state import Mask
from gcs.model.target_fix import TargetFix
from gcs.model.traffic import KIND_IN_WORDS, distance_in_words
from gcs.service.alarms import AlarmCause, AlarmSeverity, Condition
from gcs.service.features import TrackView, TrafficView

SHOWN_MAX: Final = 64
"""Tracks that displays are sent, the nearest."""

NAMED_S: Final = 3.0
"""What is wrong with a source of MAVLink is named again every second while it lasts."""

CROWDED_S: Final = 10.0
"""So long after a track was left out operators know of it."""

DEVIATION_M: Final = 15.0
"""Standard deviation of a report along each axis, where its source does not say; up and down as well."""

DEVIATION_M_S: Final = 1.0

PRESSURE_M: Final = 1000.0
"""A height by pressure may be wrong by hundreds of metres; so far above all a track does not count."""

ALARMS_MAX: Final = 8
"""Tracks with an alarm of their own, manned aircraft first, then the soonest."""

ALARMED_S: Final = 10.0
"""An alarm gives way to that of a sooner track of its kind after so long: a flood has none flicker."""

URGENT_S: Final = 15.0
"""What arrives within this time has an alarm before all that arrive later."""

RECEDES_M_S: Final = 5.0
"""A track that is farther away by so much every second, straight on, has passed."""

PASSED_S, PASSED_SHARE = 10.0, 0.5
"""A manned aircraft that has passed for so long is no longer near, beyond this share of the radius."""

WAIT: Final = "Start when it has passed."

RECEIVED_S: Final = 10.0
"""Of a track that was not reported for so long operators know since when."""


@dataclass(eq=False)
class _Source:
    """One source: what bounds it, and what is wrong with it."""

    intake: Intake
    repeats: bool  # what is wrong is named again while it lasts
    problem: str = ""
    named_s: float = -inf


@dataclass(frozen=True, slots=True, eq=False)
class _Around:
    """All traffic at one tick."""

    traffic: TracksNow
    sphere: Sphere
    near: Approaches
    announced: tuple[int, ...] = ()  # rows of those that come near
    manned: tuple[int, ...] = ()  # rows of manned aircraft in the space where they are an emergency
    evaded: frozenset[str] = field(default_factory=frozenset)  # that vehicles keep clear of
    left_out: int = 0  # of these, for their number


class OtherTraffic(Feature):
    """All traffic of one station. Used on the event loop only."""

    name = "traffic"

    def __init__(
        self,
        settings: TrafficSettings | None,
        frame: ShowFrame,
        newest: Newest,
        flown: Callable[[], Mask],
        highest_m: float,
        own_systems: frozenset[int],
        own: OwnTracks,
        unix_minus_loop_s: Callable[[], float],
    ) -> None:
        """Know of none yet.

        Args:
            settings: None: there are no sources.
            frame: of the show.
            newest: time, vehicles and centre; what they keep clear of is set there.
            flown: (n,) the vehicles that keep clear of traffic.
            highest_m: greatest height of any vehicle.
            own_systems: system ids of the vehicles.
            own: tracks of them that this show sends.
            unix_minus_loop_s: this computer's clock minus the loop's; NaN: it is not to be trusted.
        """
        self._settings, self._frame, self._newest = settings, frame, newest
        self._flown, self._highest_amsl_m = flown, frame.altitude_amsl_m + highest_m
        self._own_systems, self._unix_minus_loop_s = own_systems, unix_minus_loop_s
        sources = () if settings is None else settings.sources
        self._own_tracks = own
        self._own = frozenset(() if settings is None else (name.upper() for name in settings.own))
        self._sources = [_Source(intake_of("traffic", each, own), each.kind == "mavlink") for each in sources]
        self._table = TrackTable(1.0 if settings is None else settings.forgotten_s)
        self._seen: _Around | None = None
        self._alarmed: dict[str, float] = {}  # tracks with an alarm, and since when
        self._recedes_since_s: dict[str, float] = {}  # tracks that have passed
        self.intakes = [source.intake for source in self._sources]

    async def receive(self) -> None:
        if self._settings is None:
            return
        async with asyncio.TaskGroup() as group:
            for number, source in enumerate(self._settings.sources):
                take, failed = partial(self.take, number), partial(self.failed, number)
                intake = self._sources[number].intake
                group.create_task(
                    keep_receiving_tracks(source, self._own_systems, self._own_tracks, take, failed, intake),
                    name=f"traffic/{number}",
                )

    def take(self, source: int, fix: TargetFix) -> None:
        """Take a report of one of the sources, by its index."""
        self._sources[source].problem = ""
        if fix.track.upper() in self._own or self._settings is None:
            return
        if not (abs(fix.latitude_deg) <= 90.0 and abs(fix.longitude_deg) <= 180.0):
            self._table.outliers += 1
            return
        if fix.pressure_altitude_m > self._highest_amsl_m + PRESSURE_M:
            return
        has_height = abs(fix.altitude_amsl_m) <= FARTHEST_M
        altitude_m = fix.altitude_amsl_m if has_height else self._frame.altitude_amsl_m
        degrees = (np.array([fix.latitude_deg]), np.array([fix.longitude_deg]))
        x_m, y_m, z_m = self._frame.position_m(*degrees, np.array([altitude_m]))[0].tolist()
        moves = hypot(fix.north_m_s, fix.east_m_s) <= FASTEST_M_S
        sideways_m_s = np.array([fix.north_m_s, fix.east_m_s, 0.0] if moves else [nan] * 3)
        x_m_s, y_m_s, _ = self._frame.from_ned(sideways_m_s).tolist()
        self._table.take(
            TrackReport(
                fix.track,
                fix.kind or "manned",
                fix.arrived_s,
                self._was_s(fix, self._settings.sources[source].kind == "cot"),
                (x_m, y_m, z_m if has_height else nan),
                (x_m_s, y_m_s, fix.down_m_s),
                _first(fix.deviation_m, DEVIATION_M),
                _first(fix.height_deviation_m, DEVIATION_M),
                _first(fix.velocity_deviation_m_s, DEVIATION_M_S),
            )
        )

    def _was_s(self, fix: TargetFix, is_utc: bool) -> float:
        """When a report was true, loop clock: by its source if that has a clock, else by its arrival."""
        delay_s = 0.0 if self._settings is None else self._settings.delay_s
        if not is_utc:
            return min(_first(fix.source_s, fix.arrived_s), fix.arrived_s) - delay_s
        later_s = fix.arrived_s + self._unix_minus_loop_s() - fix.source_s
        if isfinite(later_s) and -AHEAD_S <= later_s <= AGREES_S:
            return fix.arrived_s - max(later_s, 0.0)
        return fix.arrived_s - delay_s

    def failed(self, source: int, why: str) -> None:
        """Note why nothing is known from one of the sources; empty: it is."""
        self._sources[source].problem, self._sources[source].named_s = why, self._newest.state.time_s

    def lead(self, at: Instant) -> None:
        """Have vehicles keep clear of what is near them."""
        if self._settings is None:
            return
        sphere = self._sphere() if len(self._table) else None
        self._table.forget(at.time_s, None if sphere is None else sphere.center_m[:2])
        if sphere is None or not len(self._table):
            self._seen, self._newest.near_traffic, self._newest.manned = None, None, ""
            return
        traffic = self._table.at(at.time_s)
        near_traffic, left_out = tracks_near(traffic, self._settings, sphere, at.time_s)
        boxes = (
            () if near_traffic is None else (box.id.removeprefix("traffic ") for box in near_traffic.boxes)
        )
        names = () if near_traffic is None else near_traffic.names
        self._newest.near_traffic = near_traffic
        near, comes = approaches(traffic, self._settings, sphere), announced(traffic, self._settings, sphere)
        self._recedes_since_s = {
            traffic.ids[row]: self._recedes_since_s.get(traffic.ids[row], at.time_s)
            for row in _receding(traffic, near, sphere)
            if row not in comes
        }
        self._seen = _Around(
            traffic,
            sphere,
            near,
            tuple(comes),
            self._manned(traffic, sphere, self._settings, at.time_s),
            frozenset((*names, *boxes)),
            left_out,
        )
        names_near = [f"{self._name(self._seen, row)} is near" for row in self._seen.manned[:1]]
        self._newest.manned = "".join(names_near)

    def _sphere(self) -> Sphere:
        """All vehicles that count as one; the show's origin while the place of none of them is known."""
        position_m = self._newest.state.position_m[self._flown()]
        known_m = position_m[np.isfinite(position_m).all(axis=1)]
        if not len(known_m):
            return Sphere(np.zeros(3), np.zeros(3), 0.0)
        center_m, center = known_m.mean(axis=0), self._newest.memory.center
        moves_m_s = np.zeros(3) if center is None else center.velocity_m_s
        return Sphere(center_m, moves_m_s, float(np.linalg.norm(known_m - center_m, axis=1).max()))

    def _manned(
        self, traffic: TracksNow, sphere: Sphere, settings: TrafficSettings, now_s: float
    ) -> tuple[int, ...]:
        """Rows of manned aircraft that are too near, but for those that have passed for a while."""
        off_m = traffic.position_m - sphere.center_m
        away_m = np.hypot(off_m[:, 0], off_m[:, 1]) - sphere.radius_m
        beyond = np.abs(off_m[:, 2]) - sphere.radius_m > settings.manned.height_m  # False: not known
        gone_s = np.array([now_s - self._recedes_since_s.get(name, inf) for name in traffic.ids])
        past = (gone_s >= PASSED_S) & (away_m > PASSED_SHARE * settings.manned.radius_m)
        near = np.flatnonzero((away_m <= settings.manned.radius_m) & ~beyond & ~past).tolist()
        return tuple(
            sorted((row for row in near if traffic.kinds[row] == "manned"), key=lambda row: away_m[row])
        )

    def _words(self, row: int) -> str:
        """Where a track is, and when it passes how near."""
        seen, settings = self._seen, self._settings
        if seen is None or settings is None:
            return ""
        height_m, age_s = -float(seen.traffic.position_m[row, 2]), seen.traffic.age_s[row]
        where = distance_in_words(*self._distances(seen, row, settings))
        passed = "has passed, " if seen.traffic.ids[row] in self._recedes_since_s else ""
        height = f"{height_m:.0f} m high" if isfinite(height_m) else "height not known"
        age = f", last reported {age_s:.0f} s ago" if age_s >= RECEIVED_S else ""
        return f"{passed}{where}, {height}{age}"

    @staticmethod
    def _distances(seen: _Around, row: int, settings: TrafficSettings) -> tuple[float, float, float]:
        """Of a track from the side of the formation, now and when it is nearest, and when that is."""
        now_m, then_m = (
            max(float(gap_m[row]) + settings.radius_m, 0.0) for gap_m in (seen.near.now_m, seen.near.apart_m)
        )
        return now_m, then_m, float(seen.near.after_s[row])

    @staticmethod
    def _name(seen: _Around, row: int) -> str:
        return f"{KIND_IN_WORDS[seen.traffic.kinds[row]]} {seen.traffic.ids[row]}"

    def checks(self, at: Instant) -> Iterator[Check]:
        """Whether traffic is known, and none of it is in the way."""
        if self._settings is None:
            return
        seen, rows = self._seen, self._rows_near()[:3]
        comes = [] if seen is None else [f"{self._name(seen, row)}, {self._words(row)}" for row in rows]
        unknown, near = "; ".join(self._problems(at.time_s)), "; ".join(comes)
        yield _check("traffic-known", unknown and f"traffic is not known: {unknown}", "check its source")
        yield _check("traffic-clear", near and f"traffic comes near: {near}", "wait until it has passed")

    def _rows_near(self) -> tuple[int, ...]:
        if self._seen is None:
            return ()
        return tuple(dict.fromkeys((*self._seen.manned, *self._seen.announced)))

    def _problems(self, now_s: float) -> list[str]:
        return [
            source.problem
            for source in self._sources
            if source.problem and (not source.repeats or now_s - source.named_s <= NAMED_S)
        ]

    def conditions(self, at: Instant) -> Iterator[Condition]:
        for problem in self._problems(at.time_s):
            yield Condition(AlarmCause.TRAFFIC_UNKNOWN, problem)
        if self._seen is None:
            return
        rows, on_the_ground = self._rows_near(), at.show in ON_THE_GROUND
        if crowded := "; ".join(self._crowded(at.time_s, self._seen, len(rows))):
            yield Condition(AlarmCause.TRAFFIC_CROWDED, crowded)
        for row in self._with_alarms(rows, at.time_s, self._seen):
            manned = row in self._seen.manned
            yield Condition(
                AlarmCause.TRAFFIC_MANNED if manned else AlarmCause.TRAFFIC_NEAR,
                self._words(row),
                about=self._seen.traffic.ids[row],
                advice=WAIT if on_the_ground else "",
                severity=AlarmSeverity.INFORMATION if on_the_ground else None,
                replaces=(AlarmCause.TRAFFIC_NEAR,) if manned else (),
            )

    def _with_alarms(self, rows: tuple[int, ...], now_s: float, seen: _Around) -> list[int]:
        """Rows of the tracks with an alarm, of all that come near."""
        ids = seen.traffic.ids

        def gives_way(row: int) -> tuple[bool, bool, bool]:
            is_late = seen.near.after_s[row] > URGENT_S
            return row not in seen.manned, is_late, now_s - self._alarmed.get(ids[row], -inf) > ALARMED_S

        chosen = sorted(rows, key=gives_way)[:ALARMS_MAX]
        self._alarmed = {ids[row]: self._alarmed.get(ids[row], now_s) for row in chosen}
        return chosen

    def _crowded(self, now_s: float, seen: _Around, near: int) -> Iterator[str]:
        """What there is more of than counts, in words."""
        if now_s - self._table.crowded_s < CROWDED_S:
            yield "the farthest are left out"
        elif seen.left_out:
            yield f"{seen.left_out} near ones are not evaded"
        if near > ALARMS_MAX:
            yield f"{near - ALARMS_MAX} more come near"

    def view(self, at: Instant) -> TrafficView | None:
        if self._settings is None:
            return None
        table, nearest = self._table, tuple(self._tracks()) if self._seen is not None else ()
        return TrafficView(
            known=float(len(table)),
            near=float(len(self._rows_near())),
            manned=float(0 if self._seen is None else len(self._seen.manned)),
            problem="; ".join(self._problems(at.time_s)),
            reports=table.accepted,
            refused=table.outliers + table.late + table.repeated,
            radius_m=self._settings.radius_m,
            half_height_m=self._settings.half_height_m,
            nearest=nearest,
        )

    def _tracks(self) -> Iterator[TrackView]:
        seen, settings = self._seen, self._settings
        if seen is None or settings is None:
            return
        traffic = seen.traffic
        for row in np.argsort(seen.near.now_m)[:SHOWN_MAX].tolist():
            x_m, y_m, z_m = traffic.position_m[row].tolist()
            x_m_s, y_m_s, z_m_s = traffic.velocity_m_s[row].tolist()
            away_m, nearest_m, nearest_s = self._distances(seen, row, settings)
            yield TrackView(
                id=traffic.ids[row],
                kind=traffic.kinds[row],
                x_m=x_m,
                y_m=y_m,
                height_m=-z_m,
                velocity_x_m_s=x_m_s,
                velocity_y_m_s=y_m_s,
                climb_m_s=-z_m_s if isfinite(z_m) else nan,
                deviation_m=float(np.sqrt(traffic.spread[row, 0, 0])),
                age_s=float(traffic.age_s[row]),
                away_m=away_m,
                nearest_m=nearest_m,
                nearest_s=nearest_s,
                evaded=traffic.ids[row] in seen.evaded,
                near=row in seen.announced or row in seen.manned,
            )


def _check(name: str, problem: str, to_do: str) -> Check:
    """Passes without a problem."""
    return Check(name, State.FAIL if problem else State.PASS, problem=problem, to_do=to_do if problem else "")


def _receding(traffic: TracksNow, near: Approaches, sphere: Sphere) -> list[int]:
    """Rows of tracks that go away straight on, as far as their newest reports say."""
    off_m = traffic.position_m[:, :2] - sphere.center_m[:2]
    moves_m_s = traffic.velocity_m_s[:, :2] - sphere.velocity_m_s[:2]
    opens_m_s = (off_m * moves_m_s).sum(axis=1) / np.maximum(np.hypot(*off_m.T), 1.0)
    straight = (traffic.turn_rad_s == 0.0) & (traffic.age_s < RECEIVED_S)
    return np.flatnonzero((near.after_s == 0.0) & (opens_m_s > RECEDES_M_S) & straight).tolist()


def _first(number: float, otherwise: float) -> float:
    return number if isfinite(number) else otherwise
