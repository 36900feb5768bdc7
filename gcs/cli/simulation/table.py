"""Many runs as a table for people: one row for each scenario and fleet, medians and worst cases."""

from collections.abc import Callable, Sequence
from statistics import median

from gcs.cli.simulation.batch import figure

Figures = dict[str, object]
LESS_IS_BETTER: Callable[[list[float]], float] = max
MORE_IS_BETTER: Callable[[list[float]], float] = min

COLUMNS: tuple[tuple[str, str, Callable[[list[float]], float], str], ...] = (
    ("separation.minimum_m", "closest", MORE_IS_BETTER, ".2f"),
    ("separation.violations", "viol.", LESS_IS_BETTER, ".0f"),
    ("formation.settle_time_s", "settle", LESS_IS_BETTER, ".1f"),
    ("formation.straight_line_time_s", "straight", LESS_IS_BETTER, ".1f"),
    ("formation.energy_ratio", "energy", LESS_IS_BETTER, ".4f"),
    ("formation.nearest_ratio", "nearest", MORE_IS_BETTER, ".3f"),
    ("formation.radius_error_m", "radius", LESS_IS_BETTER, ".2f"),
    ("formation.shape_error_m", "shape", LESS_IS_BETTER, ".2f"),
    ("tracking.orbit_radius_error_m", "orbit", LESS_IS_BETTER, ".2f"),
    ("obstacles.penetrations", "penetr.", LESS_IS_BETTER, ".0f"),
    ("obstacles.reformed_time_s", "reform", LESS_IS_BETTER, ".1f"),
    ("arrival.missing", "missing", LESS_IS_BETTER, ".0f"),
    ("arrival.median_ratio", "ratio", LESS_IS_BETTER, ".2f"),
    ("arrival.worst_ratio", "worst", LESS_IS_BETTER, ".2f"),
    ("tick.p99_ms", "p99 ms", LESS_IS_BETTER, ".2f"),
    ("realtime_factor", "x real", MORE_IS_BETTER, ".0f"),
)


def summary(reports: Sequence[Figures]) -> str:
    """Median / worst of every figure over the seeds; columns in which nobody has a figure are left out."""
    groups: dict[tuple[str, int], list[Figures]] = {}
    for figures in reports:
        groups.setdefault((str(figures["scenario"]), int(str(figures["vehicles"]))), []).append(figures)
    shown = [column for column in COLUMNS if any(_numbers(runs, column[0]) for runs in groups.values())]
    rows = [["scenario", "N", "runs", *(title for _, title, _, _ in shown), "failed"]]
    for (name, vehicles), runs in groups.items():
        cells = [_cell(_numbers(runs, key), len(runs), worst, form) for key, _, worst, form in shown]
        failed = sum(bool(run["failed"] or run["missed"]) for run in runs)
        rows.append([name, str(vehicles), str(len(runs)), *cells, str(failed) if failed else "-"])
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    notes = sorted(
        {
            f"{run['scenario']} seed {run['seed']}: {'; '.join(_words(run))}"
            for run in reports
            if run["failed"] or run["missed"]
        }
    )
    return "\n".join([*lines, *notes[:20], *([f"... and {len(notes) - 20} more"] if len(notes) > 20 else [])])


def _words(run: Figures) -> list[str]:
    lists = (run["failed"], run["missed"])
    return [str(word) for words in lists if isinstance(words, list) for word in words]


def _numbers(runs: Sequence[Figures], key: str) -> list[float]:
    values = [figure(run, key) for run in runs]
    return [float(value) for value in values if isinstance(value, int | float)]


def _cell(values: list[float], count: int, worst: Callable[[list[float]], float], form: str) -> str:
    """`median / worst`, one number when they print alike; a run without the figure shows as never."""
    if not values:
        return ""
    middle, extreme = format(median(values), form), format(worst(values), form)
    extreme = extreme if len(values) == count else "never"
    return middle if middle == extreme else f"{middle}/{extreme}"
