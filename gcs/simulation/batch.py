"""Runs many flights on all cores, judges each by its scenario's limits, and formats them as a table."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from statistics import median
from typing import Final

from gcs.model.errors import InvalidError, quoted
from gcs.simulation.cores import on_all_cores
from gcs.simulation.decide import Divide
from gcs.simulation.flight import SEED_MAX, fly, measured, prepared, whole_number
from gcs.simulation.result import FlightResult
from gcs.simulation.scenario import FigureGate, Scenario

MISSES_ALLOWED = 0.05
"""Share of a scenario's runs of one fleet that may be outside the gates in `mostly`."""

FLIGHTS_MAX: Final = 1_000_000
"""Flights of one batch: the seeds are kept."""

WORKERS_MAX: Final = 1024

SHAPE_FACTOR, SHAPE_SPARE_S = 2.0, 5.0
"""`formation.in_time` of `must`: settled within twice the straight-line time plus five seconds."""


@dataclass(frozen=True, slots=True)
class Run:
    """One flight to simulate."""

    scenario: Scenario
    vehicles: int | None
    seed: int
    divide: Divide | None = None  # makes the flights of a scenario with several


def run_once(run: Run, on_progress: Callable[[float], None] | None = None) -> dict[str, object]:
    """Fly and measure; the texts in `failed` and `missed` say which gates were missed.

    `on_progress` is called with the share of the longest duration that is flown.
    """
    flight = prepared(run.scenario, run.vehicles, run.seed, run.divide)
    flight.fly(on_progress)
    figures, judged = measured(run.scenario, flight).figures(), run.scenario.judged
    failed = [*_law_failed(figures), *broken(figures, judged.must)]
    left = unjudged(figures, judged.must | judged.mostly)
    missed: dict[str, object] = {"failed": failed, "missed": broken(figures, judged.mostly)}
    return figures | missed | ({"not_judged": left} if left else {})


def _law_failed(figures: dict[str, object]) -> list[str]:
    why = figures.get("law_failed")
    return [f"law failed after {why['time_s']} s: {why['why']}"] if isinstance(why, dict) else []


def flown(run: Run) -> FlightResult:
    return fly(run.scenario, run.vehicles, run.seed, divide=run.divide)


def judged_runs(scenario: Scenario, divide: Divide | None = None) -> list[Run]:
    judged = scenario.judged
    return [
        Run(scenario, vehicles, judged.first_seed + offset, divide)
        for vehicles in judged.vehicles
        for offset in range(judged.seeds)
    ]


def fly_many(
    scenario: Scenario,
    vehicles: int | None = None,
    seeds: Iterable[int] = range(1, 11),
    *,
    workers: int | None = None,
    progress: bool = True,
    divide: Divide | None = None,
) -> Iterator[FlightResult]:
    """Fly a scenario once for each seed, in processes of their own.

    A script that calls this needs `if __name__ == "__main__":`, because each process imports it.

    Args:
        scenario: as of `fly`, and `vehicles`, `divide` likewise.
        vehicles: their number.
        seeds: of the flights, at most `FLIGHTS_MAX`.
        workers: processes; None: as many as there are cores. 1: none, this one flies.
        progress: shown on a terminal or in a notebook.
        divide: of several stations.

    Returns: an iterator over the flights, in the order of the seeds; those that were taken are not kept. The
    processes end with it, by Ctrl-C as well.

    Raises: InvalidError, ConfigError as of `fly`: at once for the arguments and the first flight, else when a
        flight is taken. RefusedError when a process ended.
    """
    if workers is not None:
        workers = whole_number("workers", workers, 1, WORKERS_MAX)
    runs = [Run(scenario, vehicles, seed, divide) for seed in _checked(seeds)]
    for run in runs[:1]:
        prepared(run.scenario, run.vehicles, run.seed, run.divide)
    return on_all_cores(flown, runs, workers, progress=progress)


def _checked(seeds: Iterable[int]) -> list[int]:
    if isinstance(seeds, str | bytes) or not isinstance(seeds, Iterable):
        raise InvalidError("seeds", quoted(seeds), "several whole numbers, such as range(10)")
    several = list(islice(seeds, FLIGHTS_MAX + 1))
    if len(several) > FLIGHTS_MAX:
        raise InvalidError("seeds", f"more than {FLIGHTS_MAX}", f"at most {FLIGHTS_MAX} of them")
    return [whole_number(f"seeds[{index}]", seed, 0, SEED_MAX) for index, seed in enumerate(several)]


def passed(reports: Sequence[dict[str, object]]) -> bool:
    """Whether no run failed, and few enough runs of each scenario and fleet missed."""
    groups: dict[tuple[object, object], list[bool]] = {}
    for figures in reports:
        groups.setdefault((figures["scenario"], figures["vehicles"]), []).append(bool(figures["missed"]))
    few = all(sum(missed) <= MISSES_ALLOWED * len(missed) for missed in groups.values())
    return few and not any(figures["failed"] for figures in reports)


def figure(figures: dict[str, object], name: str) -> object:
    group, _, key = name.partition(".")
    section = figures.get(group)
    if not isinstance(section, dict):
        return section
    if key == "in_time" and "goal_shape" in figures:
        return None
    if key == "in_time":
        settle_s, straight_s = section["settle_time_s"], section["straight_line_time_s"]
        return settle_s is not None and settle_s <= SHAPE_FACTOR * straight_s + SHAPE_SPARE_S
    if key == "missing":
        expected = int(str(section.get("expected") or figures["vehicles"]))
        return None if section["arrived"] is None else expected - section["arrived"]
    return section.get(key)


def broken(figures: dict[str, object], gates: Mapping[str, FigureGate]) -> list[str]:
    """The gates that were missed; not those that could not be judged."""
    left = unjudged(figures, gates)
    return [
        f"{name} {figure(figures, name)}: {_desired(gate)}"
        for name, gate in gates.items()
        if name not in left and not _within(figure(figures, name), gate)
    ]


def unjudged(figures: dict[str, object], gates: Mapping[str, FigureGate]) -> list[str]:
    """The gates on figures of a sphere that a law which ends in another shape does not have."""
    return [
        name
        for name in gates
        if "goal_shape" in figures and name.startswith("formation.") and figure(figures, name) is None
    ]


def _within(value: object, gate: FigureGate) -> bool:
    if isinstance(value, bool):
        value = float(value)
    if not isinstance(value, int | float):
        return False
    above = gate.least is None or value >= gate.least
    return above and (gate.most is None or value <= gate.most)


def _desired(gate: FigureGate) -> str:
    least = "" if gate.least is None else f"at least {gate.least:g}"
    most = "" if gate.most is None else f"at most {gate.most:g}"
    return " and ".join(part for part in (least, most) if part)


Figures = dict[str, object]

LESS_IS_BETTER: Callable[[list[float]], float] = max
MORE_IS_BETTER: Callable[[list[float]], float] = min

SHOWN_NOTES = 20

COLUMNS: tuple[tuple[str, str, Callable[[list[float]], float], str], ...] = (
    ("separation.minimum_m", "closest", MORE_IS_BETTER, ".2f"),
    ("separation.violations", "viol.", LESS_IS_BETTER, ".0f"),
    ("separation.lost_pairs", "lost p.", LESS_IS_BETTER, ".0f"),
    ("formation.settle_time_s", "settle", LESS_IS_BETTER, ".1f"),
    ("formation.straight_line_time_s", "straight", LESS_IS_BETTER, ".1f"),
    ("formation.energy_ratio", "energy", LESS_IS_BETTER, ".4f"),
    ("formation.nearest_ratio", "nearest", MORE_IS_BETTER, ".3f"),
    ("formation.radius_error_m", "radius", LESS_IS_BETTER, ".2f"),
    ("formation.shape_error_m", "shape", LESS_IS_BETTER, ".2f"),
    ("tracking.orbit_radius_error_m", "orbit", LESS_IS_BETTER, ".2f"),
    ("tracking.target_median_m", "median", LESS_IS_BETTER, ".2f"),
    ("tracking.target_p95_m", "p95", LESS_IS_BETTER, ".2f"),
    ("tracking.target_worst_m", "worst off", LESS_IS_BETTER, ".2f"),
    ("tracking.center_rms_m_s2", "turns", LESS_IS_BETTER, ".2f"),
    ("tracking.spin_radius_error_m", "spin", LESS_IS_BETTER, ".2f"),
    ("obstacles.penetrations", "penetr.", LESS_IS_BETTER, ".0f"),
    ("obstacles.reformed_time_s", "reform", LESS_IS_BETTER, ".1f"),
    ("obstacles.path_ratio", "path", LESS_IS_BETTER, ".2f"),
    ("obstacles.noticed_s", "noticed", LESS_IS_BETTER, ".1f"),
    ("traffic.crossings", "crossings", MORE_IS_BETTER, ".0f"),
    ("traffic.announced", "announced", MORE_IS_BETTER, ".0f"),
    ("traffic.entries", "entries", LESS_IS_BETTER, ".0f"),
    ("traffic.avoidable", "avoidable", LESS_IS_BETTER, ".0f"),
    ("traffic.closest_m", "clear", MORE_IS_BETTER, ".1f"),
    ("lies.liars", "liars", LESS_IS_BETTER, ".0f"),
    ("lies.violations", "true viol.", LESS_IS_BETTER, ".0f"),
    ("lies.named_s", "named", LESS_IS_BETTER, ".2f"),
    ("lies.flown_on_a_lie_m", "on a lie", LESS_IS_BETTER, ".2f"),
    ("lies.wrongly_named", "wrongly", LESS_IS_BETTER, ".0f"),
    ("site.outside", "outside", LESS_IS_BETTER, ".0f"),
    ("site.impacts", "impacts", MORE_IS_BETTER, ".0f"),
    ("site.impacts_outside", "fell out", LESS_IS_BETTER, ".0f"),
    ("site.contacts", "contacts", LESS_IS_BETTER, ".0f"),
    ("site.least_margin_m", "margin", MORE_IS_BETTER, ".2f"),
    ("arrival.missing", "missing", LESS_IS_BETTER, ".0f"),
    ("arrival.median_ratio", "ratio", LESS_IS_BETTER, ".2f"),
    ("arrival.worst_ratio", "worst", LESS_IS_BETTER, ".2f"),
    ("arrival.planning_s", "plan s", LESS_IS_BETTER, ".2f"),
    ("track.rms_m", "track", LESS_IS_BETTER, ".3f"),
    ("track.own_rms_m", "estimated", LESS_IS_BETTER, ".3f"),
    ("track.own_max_m", "est. far", LESS_IS_BETTER, ".2f"),
    ("track.max_m", "farthest", LESS_IS_BETTER, ".2f"),
    ("tick.p99_ms", "p99 ms", LESS_IS_BETTER, ".2f"),
    ("realtime_factor", "x real", MORE_IS_BETTER, ".0f"),
)

IF_ANY = frozenset({"separation.lost_pairs"})


def summary(reports: Sequence[Figures]) -> str:
    cells = rows(reports)
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ["  ".join(map(str.rjust, row, widths)) for row in cells]
    words_of = [(f"{run['scenario']} seed {run['seed']}", _words(run)) for run in reports]
    notes = sorted({f"{name}: {'; '.join(words)}" for name, words in words_of if words})
    notes += sorted({_not_judged(run) for run in reports if run.get("not_judged")})
    left_off = [f"... and {len(notes) - SHOWN_NOTES} more"] if len(notes) > SHOWN_NOTES else []
    return "\n".join([*lines, *notes[:SHOWN_NOTES], *left_off])


def _not_judged(run: Figures) -> str:
    names = run["not_judged"]
    listed = ", ".join(map(str, names)) if isinstance(names, list) else ""
    return f"{run['scenario']}: not judged, because the law's goal_shape is {run['goal_shape']}: {listed}"


def rows(reports: Sequence[Figures]) -> list[list[str]]:
    """Titles, then one row per scenario and fleet: median / worst of every figure over the seeds.

    Columns without any figure are left out, and those of `IF_ANY` that are 0 throughout.
    """
    groups: dict[tuple[str, int], list[Figures]] = {}
    for figures in reports:
        groups.setdefault((str(figures["scenario"]), int(str(figures["vehicles"]))), []).append(figures)
    numbers = {key: _numbers(reports, key) for key, *_ in COLUMNS}
    shown = [each for each in COLUMNS if (any(numbers[each[0]]) if each[0] in IF_ANY else numbers[each[0]])]
    table = [["scenario", "N", "runs", *(title for _, title, _, _ in shown), "failed"]]
    for (name, vehicles), runs in groups.items():
        cells = [_cell(_numbers(runs, key), len(runs), worst, form) for key, _, worst, form in shown]
        failed = sum(bool(_words(run)) for run in runs)
        table.append([name, str(vehicles), str(len(runs)), *cells, str(failed) if failed else "-"])
    return table


def _words(run: Figures) -> list[str]:
    lists = (run["failed"], run["missed"])
    return [str(word) for words in lists if isinstance(words, list) for word in words]


def _numbers(runs: Sequence[Figures], key: str) -> list[float]:
    values = [figure(run, key) for run in runs]
    return [float(value) for value in values if isinstance(value, int | float)]


def _cell(values: list[float], count: int, worst: Callable[[list[float]], float], form: str) -> str:
    """`median / worst`, or one number when both print the same; a run without the figure shows as never."""
    if not values:
        return ""
    middle, extreme = format(median(values), form), format(worst(values), form)
    extreme = extreme if len(values) == count else "never"
    return middle if middle == extreme else f"{middle}/{extreme}"
