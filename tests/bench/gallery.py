"""`make gallery`: docs/gallery.md with a picture of one flight of every scenario, and one flight that moves.

`python -m tests.bench.gallery NAME ...` draws these alone, and keeps the others' pictures.
"""

import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Final

from PIL import Image

from gcs.simulation import ROWS
from gcs.simulation import scenario as scenarios
from gcs.simulation.animation import animate, still
from gcs.simulation.cores import on_all_cores
from gcs.simulation.flight import prepared
from gcs.simulation.scenario import Scenario, ShowFlight
from gcs.site.simulated import SimulatedStations

PAGE: Final = Path(__file__).parents[2] / "docs" / "gallery.md"
FOLDER: Final = PAGE.with_suffix("")
MOVING: Final = ("obstacle-on-orbit", 20, 1)
"""Scenario, vehicles and seed of the flight that moves, on the first screen of the README as well."""
COLOURS, ACROSS, MOST = 48, 3, 250
"""Of a picture; pictures side by side; vehicles of one, but for scenarios of more only."""
HEAD: Final = """# Gallery

Every scenario of `gcs simulate`, flown once and drawn from the side, with the whole paths (`make gallery`).
Distances over time: `gcs simulate NAME --plot NAME.png`; as it moves: `--plot NAME.gif`.

![20 vehicles round a moving target and past a box](gallery/{moving}.gif)
"""
TITLES: Final = {None: "Others"}


def drawn(path: Path) -> None:
    """Fly the scenario of that file, and draw it."""
    scenario = scenarios.load(path)
    fleets = scenario.judged.vehicles
    vehicles = max((count for count in fleets if count <= MOST), default=min(fleets))
    file = FOLDER / f"{scenario.name}.png"
    still(prepared(scenario, vehicles, scenario.judged.first_seed, SimulatedStations).fly(), file)
    with Image.open(file) as picture:
        picture.convert("P", palette=Image.Palette.ADAPTIVE, colors=COLOURS).save(file, optimize=True)


def page(shown: Sequence[Scenario]) -> Iterator[str]:
    """The lines of docs/gallery.md."""
    yield HEAD.format(moving=MOVING[0])
    order = {row: number for number, row in enumerate((*ROWS, None))}
    by_row = sorted(shown, key=lambda scenario: order[scenario.row])
    for row, members in groupby(by_row, lambda scenario: scenario.row):
        cells = [f"![{name}](gallery/{name}.png)<br>**{name}**<br>{about}" for name, about in _named(members)]
        yield f"\n## {TITLES.get(row, str(row).replace('-', ' ').capitalize())}\n"
        yield "| | | |\n| --- | --- | --- |"
        for first in range(0, len(cells), ACROSS):
            line = cells[first : first + ACROSS]
            yield f"| {' | '.join([*line, *[''] * (ACROSS - len(line))])} |"


def _named(members: Iterable[Scenario]) -> Iterator[tuple[str, str]]:
    return ((scenario.name, scenario.about) for scenario in members)


def _is_show(path: Path) -> bool:
    return isinstance(scenarios.load(path).flight, ShowFlight)


def main(names: Sequence[str]) -> None:
    FOLDER.mkdir(exist_ok=True)
    paths = [path for path in scenarios.shipped() if not _is_show(path)]
    PAGE.write_text("\n".join(page([scenarios.load(path) for path in paths])) + "\n", encoding="utf-8")
    desired = [path for path in paths if not names or path.stem in names]
    list(on_all_cores(drawn, desired, progress=True))
    if not names or MOVING[0] in names:
        name, vehicles, seed = MOVING
        animate(prepared(Scenario.load(name), vehicles, seed).fly(), FOLDER / f"{name}.gif")


if __name__ == "__main__":
    main(sys.argv[1:])
