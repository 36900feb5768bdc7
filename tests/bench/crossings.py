"""What a tick costs where all vehicles cross: `python -m tests.bench.crossings`.

Vehicles change places through the middle of a sphere, and inputs of ticks are kept. Then each of these ticks
is computed again, a few times, in processor time. Other work on the machine disturbs the shortest of each
least: the percentiles are those of the shortest, but for the last one. The alternative is computed at the
same places.
"""

import gc
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.control import ControlSettings, Memory, Tasks, tick, warm_up
from gcs.formation.article import ArticleParameters
from gcs.model.plan import Plan
from gcs.model.state import Array, FleetState, Traits
from gcs.simulation.decide import Decided
from gcs.simulation.flight import GoalRun
from gcs.simulation.scenario import GoalFlight, Scenario
from tests.bench.run import broadcast_force

SEED: Final = 6000
REPEATS: Final = 5
ROWS: Final = (("swap-212", 212, 5, "0.7"), ("swap-212-delayed", 212, 10, ""), ("swap-812", 1000, 10, "6"))
"""Scenario, vehicles, from how many ticks one is kept, and what the p99 must be, ms."""

ALTERNATIVE: Final = "the article's law as printed, numpy, no safety"


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """The inputs of one tick."""

    fleet: FleetState
    tasks: Tasks
    plan: Plan
    traits: Traits
    memory: Memory
    settings: ControlSettings

    def compute(self) -> Memory:
        """The tick, with what the next needs of it."""
        return tick(self.fleet, self.tasks, self.plan, self.traits, self.memory, self.settings).memory


class KeptRun(GoalRun):
    """A flight of which every so many ticks' inputs are kept."""

    def __init__(self, scenario: Scenario, flight: GoalFlight, count: int, every: int) -> None:
        super().__init__(scenario, flight, count, SEED)
        self.kept: list[Kept] = []
        self._every = every

    def _decide(self, fleet: FleetState, tasks: Tasks) -> Decided:
        if self.memory.number % self._every == 0:
            self.kept.append(Kept(fleet, tasks, self.plan, self.traits, self.memory, self.settings))
        return super()._decide(fleet, tasks)


def kept_ticks(name: str, count: int, every: int) -> list[Kept]:
    """Some of the ticks of a flight of that scenario. Raises: TypeError when its vehicles have no goals."""
    scenario = Scenario.load(name).in_world_of(SEED)
    if not isinstance(scenario.flight, GoalFlight):
        raise TypeError(f"{name}: a flight to goals is needed")
    run = KeptRun(scenario, scenario.flight, count, every)
    run.fly()
    return run.kept


def times_ms(calls: list[Callable[[], object]], repeats: int) -> Array:
    """(k, repeats) processor time of each of k calls, one after the other: other work comes in bursts."""
    taken_ms = np.empty((len(calls), repeats))
    for again in range(repeats):
        for at, call in enumerate(calls):
            began_s = time.process_time()
            call()
            taken_ms[at, again] = 1e3 * (time.process_time() - began_s)
    return taken_ms


def printed_law(kept: Kept) -> Callable[[], object]:
    """The article's law as printed, in numpy, at the places of that tick."""
    place_m, printed = np.array(kept.fleet.position_m), ArticleParameters(radius_m=100.0)
    every, middle_m = np.arange(len(place_m)), place_m.mean(axis=0)
    return lambda: broadcast_force(place_m, every, middle_m, printed)


def main(desired: list[str]) -> None:
    """Print the table; with words as arguments only of scenarios whose names contain one of them."""
    warm_up()
    head = f"{'tick of':<18}{'N':>6}{'ticks':>7}{'must':>6}{'p50':>8}{'p99':>8}{'p99 of all':>12}"
    print(f"{head}   {'alternative':<48}{'p50':>8}{'ratio':>7}   (ms)")
    for name, count, every, must in ROWS:
        if desired and not any(word in name for word in desired):
            continue
        kept = kept_ticks(name, count, every)
        gc.collect()
        gc.freeze()
        ours_ms = times_ms([each.compute for each in kept], REPEATS)
        other_ms = times_ms([printed_law(each) for each in kept[:: max(len(kept) // 20, 1)]], 3)
        p50_ms, p99_ms = np.percentile(ours_ms.min(axis=1), (50, 99))
        usual_ms = float(np.median(other_ms.min(axis=1)))
        figures = f"{p50_ms:>8.3f}{p99_ms:>8.3f}{np.percentile(ours_ms, 99):>12.3f}"
        print(f"{name:<18}{count:>6}{len(kept):>7}{must:>6}{figures}   {ALTERNATIVE:<48}", end="")
        print(f"{usual_ms:>8.3f}{p50_ms / usual_ms:>7.2f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
