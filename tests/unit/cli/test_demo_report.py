"""The flight report's figures, on flights made up so that the right answer is known."""

import json
from pathlib import Path

import numpy as np
import pytest

from gcs.cli.demo.demo_report import (
    Commanded,
    GroundTruth,
    ground_truth,
    orbit_error_m,
    penetrations,
    separation,
    shape,
    summary,
)
from gcs.model.errors import GcsError
from gcs.model.frames import ShowFrame
from gcs.model.plan import Obstacle
from gcs.model.state import Array
from gcs.safety.floor import Floor
from gcs.simulation.reference_shapes import best

FLOOR = Floor(horizontal_m=2.0, vertical_m=3.0, margin_m=1.0, uncertainty_m=0.0, pad_height_m=2.0)
TIME_S = np.arange(0.0, 10.0, 0.02)
BOX = Obstacle("b", 0.0, 0.0, 3.0, 3.0, 20.0)


def truth(position_m: Array, *, airborne: bool = True) -> GroundTruth:
    k, n, _ = position_m.shape
    return GroundTruth(TIME_S[:k], position_m, np.full((k, n), airborne), np.zeros(n, dtype=bool))


def flight(*trajectories: Array) -> Array:
    """(k, n, 3) from one (k, 3) or (3,) for each drone."""
    return np.stack([np.broadcast_to(track, (len(TIME_S), 3)) for track in trajectories], axis=1)


def commanded(center_m: Array, radius_m: float, target_m: Array) -> Commanded:
    return Commanded(
        TIME_S,
        np.broadcast_to(center_m, (len(TIME_S), 3)).copy(),
        np.full(len(TIME_S), radius_m),
        np.broadcast_to(target_m, (len(TIME_S), 2)).copy(),
    )


def through(y_m: float, height_m: float) -> Array:
    """From x = -10 to x = +10 in ten seconds."""
    x = np.linspace(-10.0, 10.0, len(TIME_S))
    return np.stack([x, np.full_like(x, y_m), np.full_like(x, -height_m)], axis=1)


def test_smallest_distance_and_each_violation_are_counted() -> None:
    # the second swings from 5 m to 1.5 m beside the first, twice
    beside = np.zeros((len(TIME_S), 3))
    beside[:, 1] = 3.25 + 1.75 * np.cos(2 * np.pi * TIME_S / 5.0)
    smallest_m, violations = separation(truth(flight(np.zeros(3), beside) - (0.0, 0.0, 10.0)), FLOOR)
    assert smallest_m == pytest.approx(1.5, abs=1e-3)
    assert violations == 2


@pytest.mark.soak
def test_floor_is_taller_for_stacked_vehicles() -> None:
    lower, upper = np.array([0.0, 0.0, -10.0]), np.array([0.0, 0.0, -12.5])
    assert separation(truth(flight(lower, upper)), FLOOR) == (2.5, 1)
    assert separation(truth(flight(lower, upper - (0.0, 0.0, 1.0))), FLOOR) == (3.5, 0)


def test_pairs_low_over_pads_and_on_the_ground_are_exempt() -> None:
    low = flight(np.array([0.0, 0.0, -1.9]), np.array([0.0, 1.0, -0.5]))
    assert separation(truth(low), FLOOR) == (np.inf, 0)
    high = flight(np.array([0.0, 0.0, -9.0]), np.array([0.0, 1.0, -9.0]))
    assert separation(truth(high, airborne=False), FLOOR) == (np.inf, 0)


def test_each_pass_through_the_obstacle_is_one_penetration() -> None:
    inside = truth(flight(through(0.0, 10.0), through(3.9, 10.0), through(4.1, 10.0), through(0.0, 21.1)))
    assert penetrations(inside, BOX) == 2
    assert penetrations(truth(flight(through(0.0, 20.9))), BOX) == 1


def test_initial_violation_counts_and_lasting_counts_once() -> None:
    assert penetrations(truth(flight(np.array([0.0, 0.0, -5.0]))), BOX) == 1


def test_shape_is_of_mean_positions_without_noise() -> None:
    center = np.array([3.0, -2.0, -30.0])
    places = center + 10.0 * best(8)
    shaken = flight(*places) + np.random.default_rng(1).normal(scale=0.3, size=(len(TIME_S), 8, 3))
    figures = shape(truth(shaken), commanded(center, 10.0, np.zeros(2)))
    assert figures["energy_ratio"] == pytest.approx(1.0, abs=1e-3)
    assert figures["nearest_ratio"] > 0.99
    assert 0.1 < figures["radius_error_m"] < 0.4


@pytest.mark.parametrize("count", [2, 3, 4, 6, 9])
def test_a_whole_formation_that_is_low_keeps_its_shape(count: int) -> None:
    """ArduCopter's barometer: every vehicle 4.7 % lower than reported."""
    center = np.array([3.0, -2.0, -25.0])
    low = center + 10.0 * best(count) + (0.0, 0.0, 1.2)
    figures = shape(truth(flight(*low)), commanded(center, 10.0, np.zeros(2)))
    assert figures["energy_ratio"] == pytest.approx(1.0, abs=1e-6)
    assert figures["nearest_ratio"] == pytest.approx(1.0, abs=1e-6)
    assert figures["center_error_m"] == pytest.approx(1.2, abs=1e-6)


def test_cube_and_wrong_radius_are_detected() -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / np.sqrt(3.0)
    figures = shape(
        truth(flight(*(11.0 * corners - (0.0, 0.0, 30.0)))),
        commanded(np.array([0.0, 0.0, -30.0]), 10.0, np.zeros(2)),
    )
    assert figures["energy_ratio"] == pytest.approx(1.0033, abs=1e-4)
    assert figures["nearest_ratio"] < 0.99
    assert figures["radius_error_m"] == pytest.approx(1.0)


def test_orbit_error_is_of_the_true_centroid_about_the_target() -> None:
    angle = TIME_S * 0.3
    circle = np.stack([5.0 + 16.0 * np.cos(angle), 16.0 * np.sin(angle), np.full_like(angle, -20.0)], axis=1)
    aside = np.array([0.0, 4.0, 0.0])
    pair = flight(circle + aside, circle - aside)
    desired = commanded(np.zeros(3), 4.0, np.array([5.0, 0.0]))
    assert orbit_error_m(truth(pair), desired, 15.0) == pytest.approx(1.0)


def test_a_window_holds_only_its_own_times() -> None:
    window = truth(flight(through(0.0, 10.0))).between(2.0, 4.0)
    assert (window.time_s.min(), window.time_s.max()) == pytest.approx((2.0, 4.0), abs=0.021)
    assert window.position_m.shape == (len(window.time_s), 1, 3)


FRAME = ShowFrame(47.0, 8.0, 400.0, heading_deg=90.0)


def write(path: Path, *, armed_at_end: bool) -> Path:
    """Two vehicles, the second 8 m ahead, which fly for most of a second."""
    lines = []
    latitude_deg, longitude_deg, _ = FRAME.geodetic(np.array([[0.0, 0.0, 0.0], [8.0, 0.0, 0.0]]))
    for index in range(21):
        flying = 2 <= index < 18
        state = {
            **dict.fromkeys(("velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s"), 0.0),
            "altitude_amsl_m": 400.0 + 5.0 * flying,
            "mode": "OFFBOARD",
            "landed": not flying,
        }
        vehicles = [
            {
                "vehicle": row + 1,
                "latitude_deg": latitude_deg[row],
                "longitude_deg": longitude_deg[row],
                **state,
                "armed": flying or (armed_at_end and row == 1),
            }
            for row in range(2)
        ]
        lines.append(json.dumps({"time_s": 100.0 + 0.05 * index, "vehicles": vehicles}))
    path.write_text("\n".join(lines) + '\n{"time_s": 10', encoding="utf-8")  # killed while writing
    return path


def test_truth_is_read_in_the_show_frame(tmp_path: Path) -> None:
    known = ground_truth(write(tmp_path / "truth.jsonl", armed_at_end=True), FRAME, 2)
    assert known.position_m.shape == (len(known.time_s), 2, 3)
    assert known.position_m[0] == pytest.approx(np.array([[0.0, 0.0, 0.0], [8.0, 0.0, 0.0]]), abs=1e-3)
    assert known.airborne[25].all()
    assert not known.airborne[0].any()
    assert known.landed_at_end.tolist() == [True, False]


def test_a_file_without_a_single_state_is_refused(tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.write_text("", encoding="utf-8")
    with pytest.raises(GcsError, match="no true states"):
        ground_truth(empty, FRAME, 2)


def test_the_summary_names_every_figure() -> None:
    text = summary({"violations": 0, "minimum_separation_m": 3.14159265, "landed": "8 of 8"})
    lines = [line.split(maxsplit=1) for line in text.splitlines()]
    assert [name for name, _ in lines] == ["violations", "minimum_separation_m", "landed"]
    assert float(lines[1][1]) == pytest.approx(3.1416, abs=2e-3)
    assert lines[2][1] == "8 of 8"


def test_a_formation_that_was_not_flown_all_the_time_is_named() -> None:
    here = flight(*(6.0 * best(4) + (0.0, 0.0, -20.0)))
    center = commanded(np.array([0.0, 0.0, -20.0]), 6.0, np.zeros(2))
    center.center_m[100:150] = np.nan  # control stood still
    with pytest.raises(GcsError, match="not flown for 10% of the time in which its shape counts"):
        shape(truth(here), center)
