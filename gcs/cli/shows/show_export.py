"""`gcs show export`: shows and recorded flights to the files of other programs."""

import argparse
from pathlib import Path

from gcs.cli.output import answer, output_file
from gcs.cli.progress import share_of
from gcs.cli.shows.export_record import flown
from gcs.shows import find, load
from gcs.shows.drawn import DrawnShow
from gcs.shows.formats import write_drawing
from gcs.shows.formats.files import EXPORTED
from gcs.simulation.drawn_flight import drawn
from gcs.simulation.rehearsal import rehearse


def export_show(arguments: argparse.Namespace) -> int:
    """Write the drawing of a show, what a show of the law flies in virtual time, or a recorded flight.

    Returns: 0. Raises: ConfigError for a bad show or a file of another kind; GcsError for a bad record.
    """
    target = output_file(arguments.output, tuple(EXPORTED))
    show = _exported(arguments)
    write_drawing(show, target)
    document = {"file": str(target), "vehicles": len(show), "duration_s": round(show.duration_s, 3)}
    answer(arguments, document, f"{target}: {len(show)} vehicles, {show.duration_s:.1f} s")
    return 0


def _exported(arguments: argparse.Namespace) -> DrawnShow:
    given = Path(arguments.file)
    if given.is_dir() or given.suffix == ".mcap":
        return flown(given)
    loaded = load(find(arguments.file))
    if loaded.drawing is not None:
        return loaded.drawing
    with share_of("flying it in virtual time", shown=not arguments.json) as report:
        return drawn(rehearse(loaded, arguments.seed, report))
