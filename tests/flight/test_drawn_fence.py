"""The fence of a drawing is flown: vehicles stay within its areas, or the check refuses the show."""

from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from gcs.safety.fenced_areas import beyond_m
from gcs.shows import LoadedShow, load
from gcs.shows.formats import parse_drawing
from gcs.shows.importing import show_text
from gcs.simulation.rehearsal import Rehearsal, rehearse
from gcs.simulation.verdict import judge
from tests.support.drawing_files import flight, skyc, zipped
from tests.support.drawn_shows import ORIGIN

ELL = [[-6.0, -6.0], [26.0, -6.0], [26.0, 26.0], [14.0, 26.0], [14.0, 6.0], [-6.0, 6.0]]


def written(folder: Path, corners: list[list[float]], *way: tuple[int, list[int]]) -> LoadedShow:
    settings = {"geofence": {"version": 1, "polygons": [{"isInclusion": True, "points": corners}]}}
    data = zipped(skyc(flight(*([at_s, place] for at_s, place in way)), settings=settings))
    (folder / "a.skyc").write_bytes(data)
    drawing = parse_drawing(data, "a.skyc")
    (folder / "a.yaml").write_text(show_text(drawing, "a.skyc", sha256(data).hexdigest(), origin=ORIGIN))
    return load(folder / "a.yaml")


def most_beyond_m(flown: Rehearsal) -> float:
    return float(np.max([beyond_m(flown.timeline.areas, one[:, :2]).max() for one in flown.record.path_m]))


def test_a_show_that_goes_out_and_back_within_its_fence_is_good(tmp_path: Path) -> None:
    """Round the corner of an L and back, 3 m from its edges."""
    there = [(0, [0, 0, 0]), (8, [0, 0, 12]), (18, [20, 0, 12]), (28, [20, 20, 12])]
    back = [(40, [20, 0, 12]), (52, [0, 0, 12]), (70, [0, 0, 0])]
    flown = rehearse(written(tmp_path, ELL, *there, *back))
    verdict = judge(flown)
    assert verdict.good, verdict.problems
    assert most_beyond_m(flown) < 0.0


def test_a_return_is_led_round_a_corner_of_the_fence(tmp_path: Path) -> None:
    """The straight way home leaves the L: the vehicle slides along the edge, and comes home."""
    there = [(0, [0, 0, 0]), (8, [0, 0, 12]), (18, [20, 0, 12]), (28, [20, 20, 12]), (30, [20, 20, 12])]
    flown = rehearse(written(tmp_path, ELL, *there))
    assert judge(flown).good
    assert most_beyond_m(flown) < 0.0


@pytest.mark.soak
def test_a_show_that_cannot_return_within_its_fence_is_refused(tmp_path: Path) -> None:
    """It ends in the other leg of a U, with its home straight across the gap."""
    corners = [
        [-6.0, -6.0],
        [26.0, -6.0],
        [26.0, 46.0],
        [14.0, 46.0],
        [14.0, 6.0],
        [6.0, 6.0],
        [6.0, 46.0],
        [-6.0, 46.0],
    ]
    first = [(0, [0, 40, 0]), (8, [0, 40, 12]), (22, [0, 0, 12])]
    then = [(32, [20, 0, 12]), (46, [20, 40, 12]), (48, [20, 40, 12])]
    flown = rehearse(written(tmp_path, corners, *first, *then))
    verdict = judge(flown)
    assert "not all vehicles have come home" in {problem.text for problem in verdict.problems}
    assert most_beyond_m(flown) < 0.0
