"""Formats many runs as a table: one row per scenario and fleet, with medians and worst cases."""

from collections.abc import Callable, Sequence
from statistics import median

from gcs.simulation.batch import figure

Figures = dict[str, object]
LESS_IS_BETTER: Callable[[list[float]], float] = max
MORE_IS_BETTER: Callable[[list[float]], float] = min

SHOWN_NOTES = 20

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
    """Format the table for a terminal, followed by the missed limits."""
    cells = rows(reports)
    widths = [max(len(row[column]) for row in cells) for column in range(len(cells[0]))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in cells]
    notes = sorted(
        {
            f"{run['scenario']} seed {run['seed']}: {'; '.join(words)}"
            for run in reports
            if (words := _words(run))
        }
    )
    left_off = [f"... and {len(notes) - SHOWN_NOTES} more"] if len(notes) > SHOWN_NOTES else []
    return "\n".join([*lines, *notes[:SHOWN_NOTES], *left_off])


def markdown(reports: Sequence[Figures]) -> str:
    """Format the same table as Markdown."""
    header, *body = rows(reports)
    ruler = ["---", *("---:" for _ in header[1:])]
    return "\n".join(f"| {' | '.join(row)} |" for row in (header, ruler, *body))


def rows(reports: Sequence[Figures]) -> list[list[str]]:
    """Titles, then one row per scenario and fleet: median / worst of every figure over the seeds.

    Columns without any figure are left out.
    """
    groups: dict[tuple[str, int], list[Figures]] = {}
    for figures in reports:
        groups.setdefault((str(figures["scenario"]), int(str(figures["vehicles"]))), []).append(figures)
    shown = [column for column in COLUMNS if any(_numbers(runs, column[0]) for runs in groups.values())]
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
