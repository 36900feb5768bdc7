"""`make flight-quality`: the tables and plots of docs/flight-quality.md, from flights of every scenario.

Reads the figures that `gcs simulate --all --json` wrote, one JSON object a line; replaces what stands
between a document's `<!-- figures: NAME NAME ... -->` and `<!-- end -->` by the table of those scenarios (a
`*` at the end stands for any ending), and draws the flights named in `<!-- plot: NAME VEHICLES SEED -->`.
"""

import json
import re
import sys
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path

from gcs.simulation.batch import Figures, rows
from gcs.simulation.flight import prepared
from gcs.simulation.plot import draw, draw_show
from gcs.simulation.rehearsal import Rehearsal
from gcs.simulation.scenario import Scenario

TABLE = re.compile(r"(<!-- figures: (?P<names>[^>]*?) -->\n).*?(<!-- end -->)", re.DOTALL)
PLOT = re.compile(r"<!-- plot: (?P<name>\S+) (?P<vehicles>\d+) (?P<seed>\d+) -->")


def markdown(reports: Sequence[Figures]) -> str:
    """The table of `gcs simulate` as Markdown."""
    header, *body = rows(reports)
    ruler = ["---", *("---:" for _ in header[1:])]
    return "\n".join(f"| {' | '.join(row)} |" for row in (header, ruler, *body))


def with_tables(text: str, reports: Sequence[Figures]) -> str:
    """The document with its tables made anew."""

    def table(found: re.Match[str]) -> str:
        patterns = found["names"].split()
        chosen = [run for run in reports if any(fnmatch(str(run["scenario"]), name) for name in patterns)]
        return f"{found[1]}\n{markdown(chosen)}\n\n{found[3]}" if chosen else found[0]

    return TABLE.sub(table, text)


def main(figures: Path, document: Path) -> None:
    """Bring `document` up to date; plots go into a folder of its name beside it."""
    reports = [json.loads(line) for line in figures.read_text(encoding="utf-8").splitlines()]
    text = document.read_text(encoding="utf-8")
    document.write_text(with_tables(text, reports), encoding="utf-8")
    folder = document.with_suffix("")
    folder.mkdir(exist_ok=True)
    for plot in PLOT.finditer(text):
        flight = prepared(Scenario.load(plot["name"]), int(plot["vehicles"]), int(plot["seed"]))
        file = folder / f"{plot['name']}-{plot['vehicles']}.png"
        record = flight.fly()
        if isinstance(flight, Rehearsal):
            draw_show(flight, file)
        else:
            draw(record, file)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
