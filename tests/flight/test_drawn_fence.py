"""The fence of a drawing is flown: vehicles stay within its areas, or the check refuses the show."""

import re
from hashlib import sha256
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gcs.flight.state.running_show import ShowRun
from gcs.model.errors import RefusedError
from gcs.planning.landing_sites import distinct_sites_m
from gcs.planning.return_paths.within_areas import cross_edges, keep_off, way_within
from gcs.safety.fenced_areas import CORNERS_MAX, FencedArea, beyond_m
from gcs.shows import LoadedShow, load
from gcs.shows.area_checks import area_flaws
from gcs.shows.formats import parse_drawing
from gcs.shows.importing import show_text
from gcs.shows.service_rules import ServiceRules
from gcs.simulation.drawn_traffic import ORIGIN
from gcs.simulation.rehearsal import Rehearsal, rehearse
from gcs.simulation.verdict import judge, table
from gcs.testing.virtual_show import VirtualShow, fly, show_config
from tests.support.drawing_files import flight, skyc, zipped

U = [
    [-6.0, -6.0],
    [26.0, -6.0],
    [26.0, 46.0],
    [14.0, 46.0],
    [14.0, 6.0],
    [6.0, 6.0],
    [6.0, 46.0],
    [-6.0, 46.0],
]
MANY = "the service's fence and the drawing's have 326 corners in all: at most 320"
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


@pytest.mark.soak
def test_a_show_that_goes_out_and_back_within_its_fence_is_good(tmp_path: Path) -> None:
    """Round the corner of an L and back, 3 m from its edges."""
    there = [(0, [0, 0, 0]), (8, [0, 0, 12]), (18, [20, 0, 12]), (28, [20, 20, 12])]
    back = [(40, [20, 0, 12]), (52, [0, 0, 12]), (70, [0, 0, 0])]
    flown = rehearse(written(tmp_path, ELL, *there, *back))
    verdict = judge(flown)
    assert verdict.good, verdict.problems
    assert most_beyond_m(flown) < 0.0


@pytest.mark.soak
def test_a_return_is_led_round_a_corner_of_the_fence(tmp_path: Path) -> None:
    """The straight way home leaves the L: the vehicle slides along the edge, and comes home."""
    there = [(0, [0, 0, 0]), (8, [0, 0, 12]), (18, [20, 0, 12]), (28, [20, 20, 12]), (30, [20, 20, 12])]
    flown = rehearse(written(tmp_path, ELL, *there))
    assert judge(flown).good
    assert most_beyond_m(flown) < 0.0


@pytest.mark.soak
def test_a_return_is_planned_round_the_gap_of_a_u(tmp_path: Path) -> None:
    """It ends in the other leg of the U, with its home straight across the gap."""
    first = [(0, [0, 40, 0]), (8, [0, 40, 12]), (22, [0, 0, 12])]
    then = [(32, [20, 0, 12]), (46, [20, 40, 12]), (48, [20, 40, 12])]
    flown = rehearse(written(tmp_path, U, *first, *then))
    verdict = judge(flown)
    assert verdict.good, verdict.problems
    assert most_beyond_m(flown) < 0.0
    mid_air, way_home = verdict.warnings
    assert mid_air.startswith(
        "the drawing ends in mid-air for drone 1 at 12.0 m (48.0 s): they stay there until"
    )
    assert "leads out of the drawing's fence for vehicle 1 at 24 s of the show, the first of 1" in way_home
    assert f"  warning: {way_home}" in table(verdict)


@pytest.mark.soak
def test_landing_sites_and_ways_keep_within_areas() -> None:
    area = FencedArea(corners_m=tuple((x_m, y_m) for x_m, y_m in U))
    crowd_m = np.array([[-5.5, 30.0 + 0.2 * row] for row in range(4)])
    sites_m = distinct_sites_m(crowd_m, np.zeros((0, 2)), 5.0, {}, [area])
    assert beyond_m([area], sites_m).max() <= -1.0
    apart_m = np.linalg.norm(sites_m[:, None] - sites_m, axis=2) + 99.0 * np.eye(4)
    assert apart_m.min() >= 5.0
    way_m = way_within([area], np.array([20.0, 40.0]), np.array([0.0, 40.0]), 1.5)
    legs_m = np.vstack([[20.0, 40.0], way_m, [0.0, 40.0]])
    dense_m = np.concatenate([np.linspace(*leg, 50) for leg in pairwise(legs_m)])
    assert beyond_m([area], dense_m).max() <= -1.4
    assert len(way_within([area], np.array([20.0, 40.0]), np.array([20.0, 0.0]), 1.5)) == 0
    level_m = np.column_stack([dense_m, np.zeros(len(dense_m))])
    assert keep_off([area], level_m, 1.0).all()
    assert not keep_off([area], np.array([[5.8, 20.0, 0.0], [10.0, 6.1, 0.0]]), 0.5).any()
    ends_m = np.array([[0.0, 40.0, 0.0], [20.0, 0.0, -9.0]])
    assert cross_edges([area], np.array([[20.0, 40.0, -5.0]] * 2), ends_m).tolist() == [True, False]


@pytest.mark.soak
def test_a_way_that_no_vehicle_reaches_in_time_is_refused(tmp_path: Path) -> None:
    """Its home is 300 m from where the drawing begins."""
    settings = {"geofence": {"version": 1, "polygons": []}}
    drone = {**flight([0, [0, 0, 6]], [9, [0, 0, 8]]), "home": [300, 0, 0]}
    (tmp_path / "a.skyc").write_bytes(data := zipped(skyc(drone, settings=settings)))
    drawing = parse_drawing(data, "a.skyc")
    (tmp_path / "a.yaml").write_text(show_text(drawing, "a.skyc", sha256(data).hexdigest(), origin=ORIGIN))
    (problem,) = judge(rehearse(load(tmp_path / "a.yaml"))).problems
    assert re.fullmatch(
        r"trajectories: vehicle 1 is \d+\.\d m from where it begins, after 60 s on the way", problem.text
    )


def test_more_corners_than_a_fence_can_have_are_refused(tmp_path: Path) -> None:
    """With those of the service's site: in words, and the show and the fence before stay in force."""
    loaded = written(tmp_path, ELL, (0, [0, 0, 0]), (8, [0, 0, 12]), (40, [0, 0, 0]))
    turn_rad = 2.0 * np.pi * np.arange(CORNERS_MAX) / CORNERS_MAX
    ring = tuple((float(x), float(y)) for x, y in 90.0 * np.stack([np.cos(turn_rad), np.sin(turn_rad)], 1))
    areas = (FencedArea(corners_m=ring),) * 5
    rules = ServiceRules(areas=areas)
    assert [flaw.text for flaw in area_flaws(loaded.timeline, rules)] == [MANY]

    async def story(show: VirtualShow) -> None:
        player = show.service.player
        before = player.in_force.control
        with pytest.raises(RefusedError, match=MANY):
            player.adopt(ShowRun("a", loaded.timeline))
        assert player.show.run is None
        assert player.in_force.control is before
        with pytest.raises(RefusedError, match=f"does not fit this service: .*{MANY}"):
            player.fitting("a", loaded.timeline)

    fly(story, show_config(2, control={"safety": {"fence": {"areas": areas}}}))
