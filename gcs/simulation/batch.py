"""Runs many flights in parallel on all cores, and judges each by its scenario's limits."""

import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from gcs.simulation import scenario as scenarios
from gcs.simulation.flight import fly
from gcs.simulation.metrics import report
from gcs.simulation.scenario import Gate, Scenario

MISSES_ALLOWED = 0.05
"""Share of a scenario's runs of one fleet that may be outside the gates in `mostly`."""

SHAPE_FACTOR, SHAPE_SPARE_S = 2.0, 5.0
"""`formation.in_time` of `must`: settled within twice the straight-line time plus five seconds."""


@dataclass(frozen=True, slots=True)
class Run:
    """One flight to simulate."""

    path: Path
    vehicles: int
    seed: int


def run_once(run: Run) -> dict[str, object]:
    """Fly and measure; the texts in `failed` and `missed` say which gates were missed."""
    scenario = scenarios.load(run.path)
    figures = report(fly(scenario, run.vehicles, run.seed))
    judged = scenario.judged
    return figures | {"failed": broken(figures, judged.must), "missed": broken(figures, judged.mostly)}


def judged_runs(path: Path, scenario: Scenario) -> list[Run]:
    """Return the runs by which a scenario is judged."""
    judged = scenario.judged
    return [
        Run(path, vehicles, judged.first_seed + offset)
        for vehicles in judged.vehicles
        for offset in range(judged.seeds)
    ]


def run_all(runs: Sequence[Run], workers: int | None = None) -> Iterator[dict[str, object]]:
    """Yield the figures in the order of the runs, which use all cores."""
    if len(runs) == 1 or workers == 1:
        yield from map(run_once, runs)
        return
    with ProcessPoolExecutor(workers or os.cpu_count(), mp_context=get_context("spawn")) as pool:
        yield from pool.map(run_once, runs)


def passed(reports: Sequence[dict[str, object]]) -> bool:
    """Whether no run failed, and few enough runs of each scenario and fleet missed."""
    groups: dict[tuple[object, object], list[bool]] = {}
    for figures in reports:
        groups.setdefault((figures["scenario"], figures["vehicles"]), []).append(bool(figures["missed"]))
    few = all(sum(missed) <= MISSES_ALLOWED * len(missed) for missed in groups.values())
    return few and not any(figures["failed"] for figures in reports)


def figure(figures: dict[str, object], name: str) -> object:
    """Return a figure by its dotted name, including derived figures."""
    group, _, key = name.partition(".")
    section = figures[group]
    if not isinstance(section, dict):
        return section
    if key == "in_time":
        settle_s, straight_s = section["settle_time_s"], section["straight_line_time_s"]
        return settle_s is not None and settle_s <= SHAPE_FACTOR * straight_s + SHAPE_SPARE_S
    if key == "missing":
        return None if section["arrived"] is None else int(str(figures["vehicles"])) - section["arrived"]
    return section[key]


def broken(figures: dict[str, object], gates: Mapping[str, Gate]) -> list[str]:
    """Describe the gates that this run's figures miss."""
    return [
        f"{name} {figure(figures, name)}: {_desired(gate)}"
        for name, gate in gates.items()
        if not _within(figure(figures, name), gate)
    ]


def _within(value: object, gate: Gate) -> bool:
    if isinstance(value, bool):
        value = float(value)
    if not isinstance(value, int | float):
        return False
    above = gate.least is None or value >= gate.least
    return above and (gate.most is None or value <= gate.most)


def _desired(gate: Gate) -> str:
    least = "" if gate.least is None else f"at least {gate.least:g}"
    most = "" if gate.most is None else f"at most {gate.most:g}"
    return " and ".join(part for part in (least, most) if part)
