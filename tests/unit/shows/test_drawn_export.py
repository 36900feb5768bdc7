"""Exports of a drawn show are the same show when they are read again: within 1 cm and 1/255 of a colour."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from gcs.model.errors import ConfigError
from gcs.shows.drawn import DrawnShow
from gcs.shows.formats import parse_drawing, read_drawing, write_drawing
from gcs.simulation.drawn_traffic import spacing_m
from tests.support.drawn_shows import drawn_show

TIMES_S = np.arange(0.0, 61.0, 0.05)


@pytest.fixture(scope="module")
def made() -> DrawnShow:
    return drawn_show(20, 60.0, 3.0, ("rings", "cube"))


def _apart_m(one: DrawnShow, other: DrawnShow) -> float:
    apart_m = one.trajectories.positions_m(TIMES_S) - other.trajectories.positions_m(TIMES_S)
    return float(np.linalg.norm(apart_m, axis=2).max())


def _colours(show: DrawnShow) -> np.ndarray:
    return np.stack([show.lights.at(time_s) for time_s in TIMES_S.tolist()])


@pytest.mark.parametrize("suffix", [".skyc", ".zip"])
def test_an_import_of_an_export_is_the_same_show(made: DrawnShow, suffix: str, tmp_path: Path) -> None:
    first, second = tmp_path / f"first{suffix}", tmp_path / f"second{suffix}"
    write_drawing(made, first)
    once, _ = read_drawing(first)
    assert _apart_m(made, once) < 0.01
    assert np.abs(_colours(made) - _colours(once)).max() <= 1.0
    write_drawing(once, second)
    twice, _ = read_drawing(second)
    assert _apart_m(once, twice) < 0.01
    assert np.abs(_colours(once) - _colours(twice)).max() <= 1.0


def test_skyc_keeps_all_that_the_show_has(made: DrawnShow, tmp_path: Path) -> None:
    write_drawing(made, tmp_path / "a.skyc")
    read, _ = read_drawing(tmp_path / "a.skyc")
    assert (read.title, read.vehicles, read.claims, read.show_s) == (
        made.title,
        made.vehicles,
        made.claims,
        made.show_s,
    )
    assert read.origin == made.origin
    assert read.cues == made.cues
    assert read.home_m == pytest.approx(made.home_m, abs=1e-3)
    assert read.takeoff_s.tolist() == made.takeoff_s.tolist()
    assert read.landing_s == pytest.approx(made.landing_s)
    assert read.fence[0].points_m == pytest.approx(made.fence[0].points_m, abs=1e-3)
    for time_s in (0.0, 17.0, 44.0):
        assert read.yaw.at(time_s) == pytest.approx(made.yaw.at(time_s), abs=1e-3)
    assert read.notes == ()


def test_the_same_show_has_the_same_bytes(made: DrawnShow, tmp_path: Path) -> None:
    write_drawing(made, tmp_path / "a.skyc")
    write_drawing(made, tmp_path / "b.skyc")
    assert (tmp_path / "a.skyc").read_bytes() == (tmp_path / "b.skyc").read_bytes()


@pytest.mark.soak
def test_vviz_says_where_each_drone_is_and_its_colour(made: DrawnShow, tmp_path: Path) -> None:
    """Read as its specification says: sums of differences, x right, y up, z ahead; frames since the last."""
    write_drawing(made, tmp_path / "a.vviz")
    document = json.loads((tmp_path / "a.vviz").read_text())
    colours, colour_s = _colours(made), 1.0 / document["defaultColorRate"]
    for row, performance in enumerate(document["performances"]):
        agent = performance["agentDescription"]
        steps_m = [[step["dx"], step["dy"], step["dz"]] for step in agent["agentTraversal"]]
        places_m = np.array([agent[key] for key in ("homeX", "homeY", "homeZ")]) + np.cumsum(steps_m, axis=0)
        times_s = np.arange(len(places_m)) / document["defaultPositionRate"]
        drawn_m = np.stack([np.interp(TIMES_S, times_s, places_m[:, axis]) for axis in range(3)], axis=1)
        flown_m = made.trajectories.positions_m(TIMES_S)[:, row]
        shown_m = np.stack([drawn_m[:, 2], drawn_m[:, 0], -drawn_m[:, 1]], axis=1)
        assert np.linalg.norm(shown_m - flown_m, axis=1).max() < 0.01
        actions = performance["payloadDescription"][0]["payloadActions"]
        at_s = colour_s * np.cumsum([action.get("frames", 0) for action in actions])
        for channel, key in enumerate("rgb"):
            shown = np.interp(TIMES_S, at_s, [action[key] for action in actions])
            assert np.abs(shown - colours[:, row, channel]).max() <= 1.0


def test_curves_of_a_high_degree_are_split_for_other_players(made: DrawnShow, tmp_path: Path) -> None:
    write_drawing(made, tmp_path / "a.skyc")
    with zipfile.ZipFile(tmp_path / "a.skyc") as archive:
        points = json.loads(archive.read("drones/0001/trajectory.json"))["points"]
    assert max(len(controls) for _, _, controls in points) == 2


def test_made_shows_keep_their_spacing_and_limits() -> None:
    for vehicles, spacing in ((40, 1.5), (30, 3.0)):
        show = drawn_show(vehicles, 60.0, spacing, ("wall", "rings"))
        motions = [show.trajectories.at(time_s) for time_s in np.arange(0.0, show.duration_s, 0.1).tolist()]
        assert min(spacing_m(motion.position_m) for motion in motions) >= spacing
        assert max(np.linalg.norm(motion.velocity_m_s, axis=1).max() for motion in motions) <= 4.5
        assert max(np.linalg.norm(motion.acceleration_m_s2, axis=1).max() for motion in motions) <= 2.0


def test_other_suffixes_are_named(made: DrawnShow, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"\.skyc, \.vviz, \.zip"):
        write_drawing(made, tmp_path / "a.txt")
    with pytest.raises(ConfigError, match=r"\.skyc, \.zip, \.csv"):
        parse_drawing(b"", "a.vviz")
