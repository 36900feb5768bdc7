"""Traffic of a scenario: tracks that cross the formation, as they are and as they are reported."""

from dataclasses import dataclass, field
from math import cos, nan, pi, sin

import numpy as np

from gcs.control.memory import Memory
from gcs.control.traffic import Sphere, announced, tracks_near
from gcs.estimation.traffic import TrackReport, TrackTable
from gcs.model.state import Array, Mask
from gcs.safety.filter import Limits
from gcs.safety.near_traffic import NearTraffic
from gcs.simulation.scenario import CrossingTraffic

GONE_M, PAUSE_S, FORGOTTEN_S = 60.0, 10.0, 5.0
"""A track ends so far beyond the formation; the next one begins so long after; when one is forgotten."""


@dataclass(slots=True, eq=False)
class Passage:
    """One track: its truth, and what became of it."""

    begins_s: float
    start_m: Array  # (3,)
    velocity_m_s: Array  # (3,)
    announced_s: float = nan
    closest_m: float = np.inf  # of any vehicle to the cylinder, over the tick's positions
    entered: set[int] = field(default_factory=set)  # rows
    avoidable: Mask | None = None  # (n,) which vehicles could leave in time, from the first report on

    def place_m(self, time_s: float) -> Array:
        return self.start_m + (time_s - self.begins_s) * self.velocity_m_s


class Crossing:
    """Tracks one after the other; the table, and what is made of it, are those of the flight."""

    def __init__(self, settings: CrossingTraffic, seed: int, limits: Limits, extent_m: float) -> None:
        self.passages: list[Passage] = []
        self._settings, self._limits, self._extent_m = settings, limits, extent_m
        self._random = np.random.default_rng([seed, 2])
        self._table = TrackTable(FORGOTTEN_S)
        self._next_s = PAUSE_S
        self._sent = 0
        self.is_over = False

    def near(self, now_s: float, position_m: Array, memory: Memory) -> NearTraffic | None:
        """What vehicles at (n, 3) keep clear of in this tick."""
        center = memory.center
        if center is None or self.is_over:
            return None
        sphere = Sphere(center.position_m, center.velocity_m_s, max(memory.radius_m, self._extent_m))
        if now_s >= self._next_s:
            self._begin(now_s, sphere)
        if self.passages:
            self._pass(self.passages[-1], now_s, position_m, sphere)
        self._table.forget(now_s)
        traffic = self._table.at(now_s)
        if self.passages and announced(traffic, self._settings, sphere):
            self.passages[-1].announced_s = np.fmin(self.passages[-1].announced_s, now_s)
        return tracks_near(traffic, self._settings, sphere, now_s)[0]

    def _begin(self, now_s: float, sphere: Sphere) -> None:
        settings, random = self._settings, self._random
        if len(self.passages) == settings.count:
            self.is_over = True
            return
        angle = random.uniform(-pi, pi)
        along, aside = np.array([cos(angle), sin(angle), 0.0]), np.array([-sin(angle), cos(angle), 0.0])
        aim_m = sphere.center_m + random.uniform(-1.0, 1.0) * settings.aside_m * aside
        aim_m[2] += random.uniform(-1.0, 1.0) * settings.above_m
        speed_m_s = random.uniform(settings.speed_min_m_s, settings.speed_max_m_s)
        self.passages.append(Passage(now_s, aim_m - settings.from_m * along, speed_m_s * along))
        self._sent, self._next_s = 0, np.inf

    def _pass(self, passage: Passage, now_s: float, position_m: Array, sphere: Sphere) -> None:
        settings, flown_s = self._settings, now_s - passage.begins_s
        while self._sent / settings.rate_hz + settings.delay_s <= flown_s + 1e-9:
            self._report(passage, passage.begins_s + self._sent / settings.rate_hz, now_s)
            self._sent += 1
        if passage.avoidable is None and self._sent:
            passage.avoidable = self._could_leave(passage, now_s, position_m)
        off_m = position_m - passage.place_m(now_s)
        outside_m = np.maximum(
            np.hypot(off_m[:, 0], off_m[:, 1]) - settings.radius_m,
            np.abs(off_m[:, 2]) - settings.half_height_m,
        )
        passage.closest_m = min(passage.closest_m, float(outside_m.min()))
        passage.entered |= set(np.flatnonzero(outside_m < 0.0).tolist())
        beyond_m = float((passage.place_m(now_s) - sphere.center_m) @ passage.velocity_m_s)
        if beyond_m > GONE_M * np.linalg.norm(passage.velocity_m_s) and self._next_s == np.inf:
            self._next_s = now_s + PAUSE_S

    def _report(self, passage: Passage, was_s: float, now_s: float) -> None:
        settings, random = self._settings, self._random
        place_m = passage.place_m(was_s) + random.normal(0.0, settings.noise_m, 3)
        moves_m_s = passage.velocity_m_s + random.normal(0.0, settings.noise_m_s, 3)
        if not settings.velocity:
            moves_m_s[:] = nan
        self._table.take(
            TrackReport(
                f"track {len(self.passages)}",
                "manned",
                now_s,
                was_s,
                tuple(place_m.tolist()),
                tuple(moves_m_s.tolist()),
                settings.noise_m,
                settings.noise_m,
                settings.noise_m_s,
            )
        )

    def _could_leave(self, passage: Passage, now_s: float, position_m: Array) -> Mask:
        """(n,) which vehicles, at their fastest from now on, are out of the way when the cylinder arrives."""
        settings, speed_m_s = self._settings, float(np.hypot(*passage.velocity_m_s[:2]))
        along = passage.velocity_m_s[:2] / speed_m_s
        off_m = position_m - passage.place_m(now_s)
        ahead_m, beside_m = off_m[:, :2] @ along, np.abs(off_m[:, 1] * along[0] - off_m[:, 0] * along[1])
        front_m = np.sqrt(np.maximum(settings.radius_m**2 - beside_m**2, 0.0))
        arrives_s = np.maximum((ahead_m - front_m) / speed_m_s, 0.0)
        sideways_s = (settings.radius_m - beside_m) / self._limits.horizontal_m_s
        level_m = -off_m[:, 2]
        up_s = (settings.half_height_m - level_m) / self._limits.up_m_s
        down_s = (settings.half_height_m + level_m) / self._limits.down_m_s
        soonest_s: Array = np.minimum(sideways_s, np.minimum(up_s, down_s))
        return np.asarray(soonest_s <= arrives_s)


def figures(passages: list[Passage]) -> dict[str, object]:
    """Tracks, those announced, entries of a cylinder, and those of them that could have been avoided."""
    entries = [(passage, row) for passage in passages for row in passage.entered]
    avoidable = [row for passage, row in entries if passage.avoidable is None or passage.avoidable[row]]
    closest_m = min((passage.closest_m for passage in passages), default=np.inf)
    return {
        "crossings": len(passages),
        "announced": int(np.isfinite([passage.announced_s for passage in passages]).sum()),
        "entries": len(entries),
        "avoidable": len(avoidable),
        "closest_m": round(closest_m, 3) if np.isfinite(closest_m) else None,
    }
