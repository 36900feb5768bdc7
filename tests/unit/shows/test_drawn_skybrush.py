"""Compiled shows of Skybrush, built by hand as its documents and other writers have them."""

from base64 import b64encode
from typing import Any

import numpy as np
import pytest

from gcs.model.errors import DrawingError
from gcs.shows.drawn import DrawnShow
from gcs.shows.formats import parse_drawing
from tests.support.drawing_files import HOVER, flight, light, skyc, zipped


def _read(*drones: Any, **show: Any) -> DrawnShow:
    return parse_drawing(zipped(skyc(*drones, **show)), "a.skyc")


def test_a_known_show_lies_where_skybrush_puts_it() -> None:
    """X ahead points east here (orientation 90); then y, to its left, points north, and z up.

    With y to the right the drone would fly 5 m south instead.
    """
    location = {"origin": [470000000, 85000000, 400000], "orientation": 90}
    show = _read(flight([0, [10, 5, 3], []]), environment={"type": "outdoor", "location": location})
    assert show.origin is not None
    latitude_deg, longitude_deg, altitude_m = show.origin.geodetic(show.trajectories.at(0.0).position_m)
    metres_north = (latitude_deg[0] - 47.0) * 111_170.0
    metres_east = (longitude_deg[0] - 8.5) * 76_060.0
    assert (metres_north, metres_east) == pytest.approx((5.0, 10.0), abs=0.02)
    assert altitude_m[0] == pytest.approx(403.0, abs=1e-3)


def test_yaw_of_a_drawing_turns_clockwise() -> None:
    """Yaw counts clockwise from the show's x axis, as set points of Skybrush do."""
    yaw = {"version": 1, "setpoints": [[0, 0], [10, 90]]}
    show = _read({**HOVER, "yawControl": yaw})
    assert show.yaw.at(5.0) == pytest.approx([np.pi / 4])


@pytest.mark.parametrize(
    ("controls", "middle"),
    [
        ([], [2.0, 0.0, 0.0]),
        ([[0, 2, 0]], [1.0, -1.0, 0.0]),
        ([[0, 4, 0], [4, 4, 0]], [2.0, -3.0, 0.0]),
        ([[0, 0, 8]] * 6, [2.0 / 64, 0.0, -8 * 126 / 128]),
    ],
)
def test_points_are_joined_by_bezier_curves(controls: list[list[float]], middle: list[float]) -> None:
    """Degree 1, 2, 3 and 7, half way from (0, 0, 0) to (4, 0, 0)."""
    show = _read(flight([0, [0, 0, 0], []], [10, [4, 0, 0], controls]))
    assert show.trajectories.at(5.0).position_m[0] == pytest.approx(middle)


def test_times_of_a_trajectory_count_from_its_take_off() -> None:
    points = [0, [0, 0, 0], []], [10, [0, 0, 5], []]
    show = _read(flight(*points, takeoffTime=7, landingTime=17), HOVER)
    assert show.takeoff_s.tolist() == [7.0, 0.0]
    assert show.landing_s.tolist() == [17.0, 10.0]
    assert show.trajectories.at(12.0).position_m[:, 2] == pytest.approx([-2.5, -5.0])
    assert show.duration_s == 17.0


@pytest.mark.parametrize("version", [0, 2])
def test_samples_of_older_and_binary_versions_are_passed_through(version: int) -> None:
    rows = [[0.0, 0, 0, 0], [1.0, 1, 0, 1], [2.0, 2, 1, 2], [3.0, 2, 2, 2]]
    points: Any = rows if version == 0 else b64encode(np.array(rows, "<f4").tobytes()).decode()
    show = _read({"trajectory": {"version": version, "points": points}})
    for time_s, x_m, y_m, z_m in rows:
        assert show.trajectories.at(time_s).position_m[0] == pytest.approx([x_m, -y_m, -z_m], abs=1e-6)


def test_a_fourth_coordinate_is_left_out() -> None:
    """Trajectories of skyc_utils carry the yaw in each point."""
    show = _read(flight([0, [0, 0, 1, 90], []], [10, [4, 0, 1, 90], [[0, 4, 1, 0], [4, 4, 1, 0]]]))
    assert show.trajectories.at(5.0).position_m[0] == pytest.approx([2.0, -3.0, -1.0])


def test_assets_are_found_by_reference() -> None:
    entries = skyc(
        {"trajectory": {"$ref": "./drones/Drone%201/trajectory.json#"}},
        settings={"cues": {"$ref": "cues.json"}},
    )
    entries["drones/Drone 1/trajectory.json"] = HOVER["trajectory"]
    entries["cues.json"] = {"version": 1, "items": [{"time": 3.5, "name": "start"}]}
    show = parse_drawing(zipped(entries), "a.skyc")
    assert show.trajectories.at(10.0).position_m[0].tolist() == [0.0, 0.0, -5.0]
    assert [(cue.name, cue.at_s) for cue in show.cues] == [("start", 3.5)]


def test_claims_fence_home_and_segment_are_read() -> None:
    fence = {"version": 1, "polygons": [{"isInclusion": True, "points": [[9, 9], [9, -9], [-9, 0]]}]}
    claims = {
        "maxAltitude": 50,
        "maxVelocityXY": 8,
        "maxVelocityZ": 2,
        "maxVelocityZUp": 3,
        "minDistance": 1.5,
    }
    show = _read(
        {**HOVER, "home": [1, 2, 0], "name": "first"},
        settings={"validation": claims, "geofence": fence},
        meta={"title": "Test", "segments": {"show": [2, 8]}},
    )
    assert (show.title, show.vehicles, show.show_s) == ("Test", ("first",), (2.0, 8.0))
    assert show.home_m.tolist() == [[1.0, -2.0, 0.0]]
    assert show.fence[0].points_m.tolist() == [[9.0, -9.0], [9.0, 9.0], [-9.0, 0.0]]
    assert show.claims.separation_min_m == 1.5
    assert (show.claims.climb_max_m_s, show.claims.sink_max_m_s) == (3.0, 2.0)


def test_what_is_not_used_is_noted() -> None:
    show = _read(
        {**HOVER, "yawControl": {"version": 1, "autoYaw": True}, "pyro": {"version": 1}}, media={"audio": 1}
    )
    assert any("pyrotechnics" in note for note in show.notes)
    assert any("yaw along the motion" in note for note in show.notes)
    assert any("music" in note for note in show.notes)


@pytest.mark.parametrize(("lands_at", "notes"), [([0.5, 0, 0], 0), ([4, -3, 0], 1)])
def test_another_place_to_land_is_noted(lands_at: list[float], notes: int) -> None:
    show = _read({**HOVER, "home": [0, 0, 0], "landAt": lands_at})
    assert sum("landAt is not flown to" in note for note in show.notes) == notes


def test_a_broken_place_to_land_is_refused() -> None:
    with pytest.raises(DrawingError, match=r"settings\.landAt"):
        _read({**HOVER, "landAt": ["a", 0, 0]})


def test_light_code_of_every_command() -> None:
    """Red; fade to blue in 1 s; gray from 2 s on; twice black and white, 0.1 s each; fade to green."""
    code = [4, 255, 0, 0, 10, 8, 0, 0, 255, 50, 3, 100, 5, 40, 10, 12, 2, 6, 5, 7, 5, 13, 8, 0, 255, 0, 25, 0]
    show = _read({**flight([0, [0, 0, 0]], [60, [0, 0, 1]]), "lights": light(*code)})
    expected = {
        0.1: [255, 0, 0],
        0.7: [128, 0, 128],
        1.5: [0, 0, 255],
        2.1: [40, 40, 40],
        2.25: [0, 0, 0],
        2.35: [255, 255, 255],
        2.45: [0, 0, 0],
        2.55: [255, 255, 255],
        2.85: [128, 255, 128],
        9.0: [0, 255, 0],
    }
    for time_s, rgb in expected.items():
        assert show.lights.at(time_s)[0] == pytest.approx(rgb, abs=0.51), time_s


def test_an_endless_loop_of_lights_ends_with_the_show() -> None:
    show = _read({**HOVER, "lights": light(12, 0, 7, 25, 6, 25, 13)})
    assert [show.lights.colours_at(time_s)[0, 0] for time_s in (0.2, 0.7, 1.2, 9.7)] == [255, 0, 255, 0]


def test_long_durations_have_several_bytes() -> None:
    show = _read({**flight([0, [0, 0, 0]], [60, [0, 0, 1]]), "lights": light(7, 0xE8, 0x07, 6, 1, 0)})
    assert [show.lights.colours_at(time_s)[0, 0] for time_s in (19.9, 20.1)] == [255, 0]
