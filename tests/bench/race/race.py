"""`make race`: the same scenarios with published methods and with ours; the table and plot of docs/race.md.

`python -m tests.bench.race.race swap-random` flies these scenarios alone, and prints the table.
"""

import argparse
import os
import platform
import re
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from gcs.simulation.cores import on_all_cores
from tests.bench.race.crazyflies import crazyflow_version
from tests.bench.race.heats import IDEAL, METHODS, OURS, RACE, Heat, flown

PAGE: Final = Path(__file__).parents[3] / "docs" / "race.md"
PLOT: Final = PAGE.with_suffix(".png")
TABLE: Final = re.compile(r"(<!-- race -->\n).*?(<!-- end -->)", re.DOTALL)
LONG: Final = (OURS, "ORCA", "CBF-QP", "buffered Voronoi")
"""Methods from the slowest on: with these the race begins, so that both cores work to its end."""

FOR_CRAZYFLOW: Final = {"SCIPY_ARRAY_API": "1", "TF_CPP_MIN_LOG_LEVEL": "3"}
"""Its processes need the first before they load scipy; the second keeps its compiler quiet."""

COLUMNS: Final = (
    *("scenario", "N", "vehicle", "method"),
    *("closest, m", "pairs", "in box", "arrived", "median", "worst", "way", "tick, ms"),
)
WORDS: Final = {"scenario", "vehicle", "method"}


def row(heat: Heat, of: Mapping[str, Any] | None) -> str:
    """A line of the table; without figures, of a flight that could not be flown."""
    if of is None:
        words = [heat.scenario, str(heat.vehicles), heat.model, heat.method, "not flown"]
        return f"| {' | '.join(words + [''] * (len(COLUMNS) - len(words)))} |"
    stopped_s, boxed = of["stopped_s"], of["penetrations"]
    never = "never" if stopped_s is None else "-"
    cells = [heat.scenario, str(heat.vehicles), heat.model, heat.method]
    cells += [f"{of['closest_m']:.2f}", str(of["violations"]), "" if boxed is None else str(boxed)]
    at = "" if stopped_s is None else f" at {stopped_s:.0f} s, stopped"
    cells += [f"{of['arrived']}/{of['expected']}{at}"]
    cells += [f"{of[key]:.2f}" if np.isfinite(of[key]) else never for key in ("median", "worst")]
    cells += [f"{of['way']:.2f}" if stopped_s is None else "-", f"{of['tick_ms']:.2f} / {of['p99_ms']:.2f}"]
    return f"| {' | '.join(cells)} |"


def table(results: Mapping[Heat, Mapping[str, Any] | None]) -> str:
    ruler = ["---" if name in WORDS else "---:" for name in COLUMNS]
    lines = [f"| {' | '.join(cells)} |" for cells in (COLUMNS, ruler)]
    return "\n".join([*lines, *(row(heat, of) for heat, of in results.items())])


LATEST, FARTHEST = 2.2, 2.0
"""What is later or farther apart is drawn at the edge."""


def plot(results: Mapping[Heat, Mapping[str, Any]], file: Path) -> None:
    """Draw the closest pair against the median time of arrival, of vehicles that are no ideal ones."""
    page = Figure(figsize=(9.0, 5.0), layout="constrained")
    axes = page.add_subplot()
    colours = dict(zip((OURS, *METHODS), mpl.colormaps["tab10"].colors, strict=False))  # type: ignore[attr-defined]
    for heat, of in results.items():
        if heat.model == IDEAL:
            continue
        place = min(of["median"], LATEST), min(of["closest_m"] / of["floor_m"], FARTHEST)
        marker = "o" if of["arrived"] == of["expected"] else "x"
        axes.scatter(*place, color=colours[heat.method], marker=marker, s=40, alpha=0.8)
    for method, colour in colours.items():
        axes.scatter([], [], color=colour, label=method)
    axes.axhline(1.0, color="0.3", linestyle="--", linewidth=0.8)
    axes.set(
        xlabel="median time of arrival over the straight way (at the edge: later; x: not all arrived)",
        ylabel="closest pair over the floor",
        title="Each point is one flight; below the line two came nearer than they may",
    )
    axes.legend(fontsize=8)
    page.savefig(file, dpi=110)


def slowest_first(heats: Sequence[Heat]) -> list[Heat]:
    rank = {method: number for number, method in enumerate(LONG)}
    return sorted(heats, key=lambda heat: (-heat.vehicles, rank.get(heat.method, len(LONG))))


def machine() -> str:
    """The processor, as the system names it."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{os.cpu_count()} cores, {names[0] if names else platform.machine()}"


def conditions(took_s: float, used_s: float, load: tuple[float, float]) -> str:
    """When, where and with what the race was flown."""
    versions = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "pyrvo"))
    versions += f", crazyflow {crazyflow_version() or 'not installed'}"
    times = f"in {took_s / 60.0:.0f} minutes, processor time {used_s / 60.0:.0f} minutes"
    loads = f"load {load[0]:.1f} before, {load[1]:.1f} at the end"
    day, python = f"{datetime.now(UTC):%Y-%m-%d}", f"Python {platform.python_version()}"
    return f"Flown on {day} {times}: {machine()}; {loads}; {python}, {versions}."


def main(names: Sequence[str], methods: Sequence[str]) -> None:
    heats = [heat for heat in RACE if heat.scenario in (names or [heat.scenario])]
    heats = [heat for heat in heats if heat.method in (methods or [heat.method])]
    order, results = slowest_first([heat for heat in heats if heat.can_be_flown()]), {}
    os.environ |= FOR_CRAZYFLOW
    began_s, before = time.perf_counter(), os.getloadavg()[0]
    for heat, of in zip(order, on_all_cores(flown, order), strict=True):
        results[heat] = of
        print(row(heat, of), f"{of['took_s']:.0f} s", flush=True)
    took_s, used_s = time.perf_counter() - began_s, sum(of["took_s"] for of in results.values())
    text = conditions(took_s, used_s, (before, os.getloadavg()[0]))
    print(text)
    if not names and not methods:
        filled = partial(_filled, f"{text}\n\n{table({heat: results.get(heat) for heat in RACE})}")
        PAGE.write_text(TABLE.sub(filled, PAGE.read_text(encoding="utf-8")), encoding="utf-8")
        plot(results, PLOT)


def _filled(text: str, found: re.Match[str]) -> str:
    return f"{found[1]}\n{text}\n\n{found[2]}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="*")
    parser.add_argument("--method", action="append", default=[], choices=(OURS, *METHODS))
    asked = parser.parse_args()
    main(asked.scenario, asked.method)
