"""Drawn shows in CSV: samples of Skybrush, polynomials of Crazyswarm."""

import re

import numpy as np
import pytest

from gcs.model.errors import DrawingError
from gcs.shows.formats import parse_drawing
from tests.support.drawing_files import zipped

SAMPLES = "Time_msec,X,Y,Z,R,G,B\n0,1,2,0,255,0,0\n500,1,2,1,255,0,0\n1000,2,2,2,0,0,255\n"


def test_samples_are_positions_and_colours_at_their_times() -> None:
    show = parse_drawing(zipped({"drone_1.csv": SAMPLES, "drone_2.csv": SAMPLES}), "a.zip")
    assert show.vehicles == ("drone_1", "drone_2")
    assert show.trajectories.at(0.5).position_m.tolist() == [[1.0, -2.0, -1.0]] * 2
    assert show.lights.colours_at(0.75)[0].tolist() == [128, 0, 128]
    assert show.home_m[0].tolist() == [1.0, -2.0, 0.0]


def test_rows_without_colours_are_white_and_need_no_names() -> None:
    show = parse_drawing(zipped({"one.csv": "0,0,0,0\r\n1000,0,0,5\r\n"}), "a.zip")
    assert show.lights.colours_at(0.5)[0].tolist() == [255, 255, 255]
    assert show.trajectories.at(0.5).position_m[0].tolist() == [0.0, 0.0, -2.5]


@pytest.mark.parametrize(
    ("names", "text"),
    [
        ("Time_msec,R,G,B,X,Y,Z", "column 2 is called 'R': x is needed there"),
        ("t,y,x,z", "column 2 is called 'y': x is needed there"),
        ("Time_msec,X_ft,Y_ft,Z_ft,R,G,B", "column 2 is called 'X_ft': metres are needed"),
        (
            "Time [s],x [m],y [m],z [m],red,green,blue",
            "column 1 is called 'Time [s]': milliseconds are needed",
        ),
    ],
)
def test_names_that_contradict_the_columns_are_refused(names: str, text: str) -> None:
    rows = "\n".join(",".join([str(500 * at), *["1"] * names.count(",")]) for at in range(3))
    with pytest.raises(DrawingError, match=re.escape(text)):
        parse_drawing(zipped({"one.csv": f"{names}\n{rows}\n"}), "a.zip")


@pytest.mark.parametrize("names", ["time [ms],x [m],y [m],z [m],Red,Green,Blue", "t,px,py,pz,c1,c2,c3"])
def test_other_names_of_the_columns_are_taken(names: str) -> None:
    rows = SAMPLES.partition("\n")[2]
    assert len(parse_drawing(zipped({"one.csv": f"{names}\n{rows}"}), "a.zip")) == 1


def test_samples_of_one_drone_belong_into_a_zip() -> None:
    with pytest.raises(DrawingError, match=r"put the CSV files of all drones into a \.zip"):
        parse_drawing(SAMPLES.encode(), "one.csv")


def test_a_sampled_circle_is_smooth() -> None:
    """At 4 Hz, as the exporter writes it: within 1 cm, and without jumps of velocity."""
    times_s = np.arange(0.0, 20.25, 0.25)
    rows = [f"{round(1e3 * t)},{8 * np.cos(t / 4)},{8 * np.sin(t / 4)},10" for t in times_s.tolist()]
    show = parse_drawing(zipped({"one.csv": "\n".join(rows)}), "a.zip")
    between_s = np.arange(1.0, 19.0, 0.0625)
    place_m = show.trajectories.positions_m(between_s)[:, 0]
    exact_m = np.stack(
        [8 * np.cos(between_s / 4), -8 * np.sin(between_s / 4), np.full(len(between_s), -10.0)], axis=1
    )
    assert np.linalg.norm(place_m - exact_m, axis=1).max() < 0.01
    speeds_m_s = [np.linalg.norm(show.trajectories.at(t).velocity_m_s) for t in between_s.tolist()]
    assert speeds_m_s == pytest.approx([2.0] * len(speeds_m_s), abs=0.05)


def test_a_sampled_rest_has_no_overshoot() -> None:
    rows = [f"{1000 * t},0,0,{max(t - 5, 0)}" for t in range(11)]
    show = parse_drawing(zipped({"one.csv": "\n".join(rows)}), "a.zip")
    heights_m = -show.trajectories.positions_m(np.arange(0.0, 5.0, 0.05))[:, 0, 2]
    assert heights_m == pytest.approx(np.zeros(100), abs=1e-9)


def _polynomial(duration_s: float, x: list[float], yaw: list[float]) -> str:
    axes = (x, [1.0, 2.0], [3.0], yaw)
    padded = [number for axis in axes for number in (*axis, *[0.0] * (8 - len(axis)))]
    return ",".join(map(str, [duration_s, *padded]))


NAMES = "duration," + ",".join(f"{axis}^{power}" for axis in ("x", "y", "z", "yaw") for power in range(8))


def test_polynomials_are_in_seconds_with_y_to_the_left() -> None:
    text = f"{NAMES}\n{_polynomial(2.0, [0.0, 0.0, 0.5], [0.0, 0.25])}\n"
    show = parse_drawing(text.encode(), "one.csv")
    motion = show.trajectories.at(1.0)
    assert motion.position_m[0] == pytest.approx([0.5, -3.0, -3.0])
    assert motion.velocity_m_s[0] == pytest.approx([1.0, -2.0, 0.0])
    assert motion.acceleration_m_s2[0] == pytest.approx([1.0, 0.0, 0.0])
    assert show.yaw.at(1.0) == pytest.approx([-0.25], abs=1e-3)


def test_polynomials_of_a_fleet_come_in_a_zip() -> None:
    rows = f"{_polynomial(1.0, [0.0, 1.0], [])}\n"
    show = parse_drawing(zipped({"cf1.csv": rows, "cf2.csv": rows}), "fleet.zip")
    assert show.vehicles == ("cf1", "cf2")


def test_pieces_that_do_not_meet_are_refused_with_their_row() -> None:
    text = f"{_polynomial(1.0, [0.0, 1.0], [])}\n{_polynomial(1.0, [5.0], [])}\n"
    with pytest.raises(DrawingError, match=r"one\.csv: row 2: begins 4\.47 m from where"):
        parse_drawing(text.encode(), "one.csv")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("0,0,0,0,1,2,3\n0,0,0,1,1,2,3\n", "row 2: 0, 0, 0, 1, 1, 2, 3: times"),
        ("0,0,0,0,1,2,300\n", "row 1: .*colours from 0 to 255"),
        ("0,0,0,nan,1,2,3\n", "row 1: .*positions within"),
        ("0,0,0,0,1,2\n", "6 columns"),
        ("0,0,0,0\n1,1\n", "rows of numbers"),
        ("Time_msec,X,Y,Z\n", "rows of numbers .* are needed, it has none"),
        ("Time_msec,X,Y,Z\n0,0,0,zero\n", ".*line 2: 'zero' is not a number"),
    ],
)
def test_a_bad_row_is_named(text: str, problem: str) -> None:
    with pytest.raises(DrawingError, match=f"a.zip: one.csv: {problem}"):
        parse_drawing(zipped({"one.csv": text}), "a.zip")
