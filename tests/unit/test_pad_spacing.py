"""Programs, configurations, documents and shows agree on how far apart simulated vehicles stand."""

import argparse
import re
from pathlib import Path
from typing import Final

from gcs.config.yaml_files import shipped_folder
from gcs.shows import load
from gcs.sim.cli import add_arguments
from gcs.sim.settings import PAD_SPACING_M, Settings
from tests.sitl.fly import PADS_M

ROOT: Final = Path(__file__).parents[2]
DOCUMENTS: Final = (
    ROOT / "README.md",
    *sorted(shipped_folder().glob("*.yaml")),
    *sorted(
        path
        for folder in ("docs", "docs/how-to", "docs/operations", "docs/tutorial")
        for path in (ROOT / folder).glob("*.md")
        if not path.stem.isupper() and path.stem != "gallery"  # measured once; as scenarios have it
    ),
)
NAMED: Final = re.compile(r"(?:the\s+vehicles|pads|own,|HOME_LON`\),)\s+([\d.]+) m apart|\"(\d+) m\" grid")
IN_GUSTS: Final = ("before-the-show.md", "pads 12 m apart")
DRAWN: Final = {"drawn-30"}
"""Shows whose pads are those of their drawing, and need RTK."""


def test_programs_place_simulated_vehicles_alike() -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    assert parser.parse_args([]).spacing == Settings().spacing_m == PAD_SPACING_M
    assert PADS_M == PAD_SPACING_M


def test_documents_name_the_same_distance_of_pads() -> None:
    found_in = [(path.name, found) for path in DOCUMENTS for found in NAMED.finditer(path.read_text())]
    named = {(name, found[0]): float(found[1] or found[2]) for name, found in found_in}
    assert named.pop(IN_GUSTS) == 12.0
    assert {name for name, _ in named} == {
        "README.md",
        "simulate.md",
        "sitl.md",
        "px4-sitl.yaml",
        "large.yaml",
    }
    assert set(named.values()) == {PAD_SPACING_M}, named


def test_shipped_shows_have_these_pads() -> None:
    shows = {path.stem: load(path).show for path in (shipped_folder() / "shows").glob("*.yaml")}
    apart_m = {name: show.fleet.pads.spacing_m for name, show in shows.items() if name not in DRAWN}
    assert set(apart_m.values()) == {PAD_SPACING_M}, apart_m
