"""What a site costs in the tick: ticks with it and without it by turns. `python -m tests.bench.site_rows`.

64 corners in all: an area that vehicles stay inside of, closed space with heights, and the controlled ground,
in whose rows a part of the sphere is. The last row is of the filter alone: 50 vehicles outside at once, past
320 corners.
"""

import gc
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Final, TypeAlias

import numpy as np

from gcs.control import ControlSettings, prepare, warm_up
from gcs.model.plan import Formation, Plan
from gcs.model.state import Array
from gcs.safety.controlled_ground import kept_in_m
from gcs.safety.fenced_areas import CORNERS_IN_ALL, FencedArea, beyond_m
from gcs.safety.filter import filter_velocities
from gcs.safety.impact import ImpactSettings
from gcs.safety.surroundings import SafetySettings
from gcs.safety.walls import Fence
from tests.bench.run import flying_on
from tests.support.safety_fleets import around

COUNTS: Final = (100, 1_000)
REPEATS: Final = 600
OUTSIDE: Final = 50
Both: TypeAlias = tuple[Callable[[], object], Callable[[], object]]
"""What is measured within a site, and the same without one."""


def star(
    corners: int, inner_m: float, outer_m: float, about_m: tuple[float, float] = (0.0, 0.0)
) -> tuple[tuple[float, float], ...]:
    """A concave ring."""
    turn_rad = 2.0 * np.pi * np.arange(corners) / corners
    away_m = np.where(np.arange(corners) % 2, inner_m, outer_m)
    ring: Array = about_m + away_m[:, None] * np.column_stack([np.cos(turn_rad), np.sin(turn_rad)])
    return tuple((x_m, y_m) for x_m, y_m in ring.tolist())


def sited(count: int) -> Both:
    """The whole tick within a site, and without one."""
    radius_m = max(10.0, 1.4 * count**0.5)
    plan = Plan(Formation(radius_m, radius_m + 10.0))
    falls_m = float(kept_in_m(np.array([radius_m + 10.0]), ImpactSettings())[0])
    beside = star(6, 3.0, 5.0)
    fence = Fence(
        height_max_m=4.0 * radius_m + 100.0,
        distance_max_m=4.0 * radius_m,
        areas=(
            FencedArea(corners_m=star(26, radius_m + 8.0, 1.6 * radius_m)),
            FencedArea(
                corners_m=tuple((x_m + radius_m, y_m) for x_m, y_m in beside),
                inside=False,
                height_min_m=0.0,
                height_max_m=8.0,
            ),
        ),
        controlled_ground=FencedArea(corners_m=star(32, radius_m + falls_m + 4.0, 1.6 * radius_m + falls_m)),
    )
    assert sum(len(area.corners_m) for area in fence.areas) + 32 == 64
    settings = ControlSettings(safety=SafetySettings(fence=fence))
    prepare(settings.safety)
    return flying_on(count, radius_m, plan, settings=settings), flying_on(count, radius_m, plan)


def outside() -> Both:
    """The filter for vehicles around an area and within closed spaces, all led out; and without areas."""
    closed_m = ((30.0, 0.0), (-30.0, 0.0), (0.0, 100.0), (0.0, -100.0))
    areas = (
        FencedArea(corners_m=star(64, 60.0, 90.0)),
        *(FencedArea(corners_m=star(64, 10.0, 16.0, middle_m), inside=False) for middle_m in closed_m),
    )
    assert sum(len(area.corners_m) for area in areas) == CORNERS_IN_ALL
    random = np.random.default_rng(1)
    turn_rad, away_m = random.uniform(0.0, 2.0 * np.pi, OUTSIDE), random.uniform(92.0, 140.0, OUTSIDE)
    place_m = np.column_stack([np.cos(turn_rad), np.sin(turn_rad), -random.uniform(10.0, 40.0, OUTSIDE)])
    place_m[:, :2] *= away_m[:, None]
    place_m[: OUTSIDE // 4, :2] = closed_m[0] + random.uniform(-9.0, 9.0, (OUTSIDE // 4, 2))
    here, desired_m_s = around(place_m), random.normal(0.0, 2.0, (OUTSIDE, 3))
    both = SafetySettings(fence=Fence(areas=areas)), SafetySettings()
    assert (beyond_m(areas, place_m) > 0.0).all()
    prepare(both[0])
    led, free = (partial(filter_velocities, desired_m_s, here, settings) for settings in both)
    return led, free


def main(counts: list[int]) -> None:
    """Print both, and what the site adds; of each pair of ticks the one, then the other."""
    warm_up()
    print(f"{'N':>10}", end="")
    print(f"{'with p50':>10}{'p99 ms':>9}{'without p50':>13}{'p99 ms':>9}{'added p50':>11}{'p99 ms':>9}")
    for count in counts or COUNTS:
        _compare(f"{count}", sited(count))
    _compare(f"{OUTSIDE} out", outside())


def _compare(name: str, both: Both) -> None:
    for once in both * 20:
        once()
    gc.collect()
    gc.freeze()
    times_ms = np.empty((REPEATS, 2))
    for at in range(REPEATS):
        for which in (0, 1) if at % 2 else (1, 0):
            began_s = time.process_time()
            both[which]()
            times_ms[at, which] = 1e3 * (time.process_time() - began_s)
    (p50, q50), (p99, q99) = np.percentile(times_ms, (50, 99), axis=0)
    print(
        f"{name:>10}{p50:>10.3f}{p99:>9.3f}{q50:>13.3f}{q99:>9.3f}{p50 - q50:>11.3f}{p99 - q99:>9.3f}",
        flush=True,
    )


if __name__ == "__main__":
    main([int(each) for each in sys.argv[1:]])
