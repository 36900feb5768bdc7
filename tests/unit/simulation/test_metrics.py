"""Figures of flights whose figures are known beforehand."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
import scipy

from gcs.model.plan import Obstacle
from gcs.model.state import Array
from gcs.safety.surroundings import Limits
from gcs.simulation import metrics as measure
from gcs.simulation.arrivals import arrival
from gcs.simulation.record import FlightRecord, closest_m
from gcs.simulation.reference_shapes import best, best_figures, energy_and_gradient, energy_and_nearest
from gcs.simulation.scenario import Scenario

CENTER = np.array([3.0, -2.0, -30.0])
TABLE = {4: 3.674235, 8: 19.675288, 20: 150.881568, 50: 1055.182315, 100: 4448.350634, 200: 18438.84}
TETRAHEDRON = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]) / sqrt(3.0)


def scenario(**flight: object) -> Scenario:
    return Scenario.model_validate(
        {
            "name": "trial",
            "about": "x",
            "duration_s": 20,
            "flight": {"kind": "formation", **flight},
            "judged": {"vehicles": [4]},
        }
    )


def record_of(paths: list[Array], trial: Scenario | None = None, *, radius_m: float = 10.0) -> FlightRecord:
    """A formation that was at `paths`, tick by tick, 20 of them a second."""
    n = len(paths[0])
    record = FlightRecord(trial or scenario(), 1, paths[0], np.full((n, 3), np.nan), 2.0)
    for index, position_m in enumerate(paths):
        record.time_s.append(index / 20.0)
        record.position_m.append(position_m)
        record.formed.append(np.ones(n, dtype=bool))
        record.in_air.append(np.ones(n, dtype=bool))
        record.center_m.append(CENTER)
        record.radius_m.append(radius_m)
        record.target_m.append(np.zeros(2))
        record.boxes.append(())
        record.closest_m.append(5.0)
        record.tick_s.append(0.001)
    return record


def turned(angle_rad: float) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(("count", "energy"), TABLE.items())
def test_reference_shapes_have_the_best_known_energies(count: int, energy: float) -> None:
    assert best_figures(count)[0] == pytest.approx(energy, rel=3e-6)
    assert np.linalg.norm(best(count), axis=1) == pytest.approx(1.0)


def test_tetrahedron_energy_and_gradient_by_hand() -> None:
    energy, nearest = energy_and_nearest(TETRAHEDRON, np.ones(4))
    assert energy == pytest.approx(6.0 / sqrt(8.0 / 3.0))
    assert nearest == pytest.approx(sqrt(8.0 / 3.0))
    again, gradient = energy_and_gradient(2.0 * TETRAHEDRON.ravel(), np.ones(4))
    assert again == pytest.approx(energy)
    assert gradient == pytest.approx(np.zeros(12), abs=1e-12)


def test_the_gradient_is_that_of_the_energy() -> None:
    flat, charge = np.random.default_rng(1).normal(size=15), np.ones(5)
    _, gradient = energy_and_gradient(flat, charge)
    around = [(flat + h, flat - h) for h in 1e-6 * np.eye(15)]
    slopes = [
        (energy_and_gradient(above, charge)[0] - energy_and_gradient(below, charge)[0]) / 2e-6
        for above, below in around
    ]
    assert gradient == pytest.approx(np.array(slopes), abs=1e-6)


def test_distances_use_the_floor_metric_without_exempt_pairs() -> None:
    everyone = np.ones(3, dtype=bool)
    place = np.array([(0.0, 0.0, -10.0), (0.0, 0.0, -13.0), (50.0, 0.0, -1.0)])
    distance, inside = closest_m(place, everyone, everyone, 2.0 / 3.0, 2.0, 2.0 + 1e-9)
    assert distance == pytest.approx(2.0)
    assert inside == 1
    here = np.array([True, False, True])
    assert closest_m(place, everyone, here, 2.0 / 3.0, 2.0, 2.0)[0] == pytest.approx(np.hypot(50.0, 6.0))
    pads = np.array([(0.0, 0.0, -1.0), (1.0, 0.0, -1.9), (0.0, 0.0, -40.0)])
    assert closest_m(pads, everyone, everyone, 2.0 / 3.0, 2.0, 2.0)[1] == 0
    standing = np.zeros(3, dtype=bool)
    assert closest_m(place, standing, everyone, 2.0 / 3.0, 2.0, 2.0)[0] == pytest.approx(1e9)


def test_perfect_shape_is_settled_at_once_in_any_rotation() -> None:
    record = record_of([CENTER + 10.0 * TETRAHEDRON @ turned(0.01 * k).T for k in range(120)])
    shape = measure.shape_over_time(record)
    assert shape.settled.all()
    assert measure.settle_time_s(record, shape) == 0.0
    figures = measure.formation(record, shape)
    assert figures.energy_ratio == pytest.approx(1.0, abs=1e-5)
    assert figures.nearest_ratio == pytest.approx(1.0, abs=1e-4)
    assert figures.shape_error_m == pytest.approx(0.0, abs=1e-3)
    assert figures.radius_error_m == pytest.approx(0.0, abs=1e-3)


def test_settling_counts_from_the_last_change_for_good() -> None:
    good, bad = CENTER + 10.0 * TETRAHEDRON, CENTER + 10.5 * TETRAHEDRON
    record = record_of([bad] * 20 + [good] * 20 + [bad] * 20 + [good] * 60)
    assert measure.settle_time_s(record, measure.shape_over_time(record)) == pytest.approx(3.0)
    record.changed_s = 1.5
    assert measure.settle_time_s(record, measure.shape_over_time(record)) == pytest.approx(1.5)


def test_vehicle_leaving_the_sphere_at_the_end_never_settled() -> None:
    record = record_of([CENTER + 10.0 * TETRAHEDRON] * 50 + [CENTER + 10.3 * TETRAHEDRON])
    assert measure.settle_time_s(record, measure.shape_over_time(record)) is None
    assert measure.formation(record, measure.shape_over_time(record)).settled is False


def test_shape_error_counts_shift_and_mirror_image() -> None:
    shifted = record_of([CENTER + 10.0 * TETRAHEDRON + (0.3, 0.0, 0.4)] * 120)
    error_m = measure.shape_error_m(shifted, measure.steady_ticks(shifted))
    assert error_m == pytest.approx(0.5, abs=0.02)


def test_shape_error_is_that_of_the_best_rotation() -> None:
    random, shape = np.random.default_rng(0), best((1.0,) * 20)
    for turn in scipy.spatial.transform.Rotation.random(60, random_state=0).as_matrix():
        places_m = 10.0 * random.permutation(shape) @ turn.T + random.normal(scale=0.3, size=(20, 3))
        record = record_of([CENTER + places_m] * 120)
        error_m = measure.shape_error_m(record, measure.steady_ticks(record))
        assert error_m < 0.3 * 1.4 * sqrt(3.0), "of 0.52 m, which is the noise"


def test_straight_line_time_is_the_bottleneck_assignment() -> None:
    limits = Limits(horizontal_m_s=5.0, up_m_s=2.0, down_m_s=1.0)
    start = np.array([(0.0, 0.0, 0.0), (10.0, 0.0, 0.0)])
    final = np.array([(10.0, 0.0, -4.0), (0.0, 5.0, 3.0)])
    # each to the place above or beside it: 4 m up at 2 m/s, and 5 m aside with 3 m down at 1 m/s
    assert measure.straight_line_time_s(start, final, 5.0, limits) == pytest.approx(3.0)
    assert measure.straight_line_time_s(start, start[::-1], 5.0, limits) == 0.0


def test_penetration_is_inside_the_box_grown_by_a_metre() -> None:
    def penetrations(x_m: float, height_m: float) -> object:
        place = np.array([(x_m, 0.0, -height_m), (30.0, 30.0, -10.0)])
        record = record_of([place] * 3)
        record.boxes = [(Obstacle("b", 0.0, 0.0, 4.0, 4.0, 10.0),)] * 3
        return measure.obstacles(record, measure.shape_over_time(record)).penetrations

    assert [penetrations(4.9, 10.9), penetrations(5.1, 10.9), penetrations(4.9, 11.1)] == [1, 0, 0]


def test_arrival_and_its_delay_against_straight_flight() -> None:
    flight = {"kind": "goals", "layout": "cube", "extent_m": 60.0}
    raw = scenario().model_dump() | {"flight": flight, "control": {"law": {"speed_m_s": 2.0}}}
    trial = Scenario.model_validate(raw)
    paths = [np.array([(0.05 * k, 0.0, -10.0), (0.0, 9.0, -10.0)]) for k in range(401)]
    record = record_of(paths, trial)
    record.goal_m = np.array([(20.0, 0.0, -10.0), (0.0, 29.0, -10.0)])
    figures = arrival(record)
    assert figures.arrived == 1
    assert figures.worst_ratio is None
    record.goal_m = np.array([(20.0, 0.0, -10.0), (0.0, 9.5, -10.0)])
    assert arrival(record).worst_ratio == pytest.approx(19.05 / 10.0, abs=0.01)


def test_centroid_is_judged_at_the_true_target_once_on_orbit() -> None:
    trial = scenario(orbit={"radius_m": 30.0, "speed_m_s": 3.0})
    angle = 0.005 * np.arange(300)
    centers = 30.4 * np.stack([np.cos(angle), np.sin(angle), np.full(300, -1.0)], axis=1)
    record = record_of([center + 10.0 * TETRAHEDRON for center in centers], trial)
    record.center_m = [center * (30.0 / 30.4, 30.0 / 30.4, 1.0) for center in centers]
    figures = measure.tracking(record, measure.shape_over_time(record))
    assert figures.orbit_radius_error_m == pytest.approx(0.4, abs=0.01)
    assert figures.center_speed_m_s == pytest.approx(30.4 * 0.005 * 20.0, rel=0.01)


def test_a_report_names_every_section_of_every_kind_of_flight() -> None:
    figures = measure.report(replace(record_of([CENTER + 10.0 * TETRAHEDRON] * 40), busy_s=0.5))
    assert list(figures) == [
        "scenario",
        "vehicles",
        "seed",
        "duration_s",
        "realtime_factor",
        "separation",
        "formation",
        "tracking",
        "obstacles",
        "arrival",
        "article",
        "tick",
    ]
    assert figures["duration_s"] == 2.0
    assert figures["realtime_factor"] == 4.0


def test_all_vehicles_count_as_there_only_at_one_moment() -> None:
    record = record_of([10.0 * TETRAHEDRON + CENTER] * 400)
    for tick in range(400):
        off_m = np.array([0.5, 0.5, np.nan, 0.5])  # the third is lost
        off_m[0] += 5.0 * (tick % 2)
        off_m[1] += 5.0 * ((tick + 1) % 2)
        record.off_slot_m.append(off_m)
    figures = arrival(record)
    assert (figures.arrived, figures.expected) == (2, 3)
    record.off_slot_m[-1] = np.array([0.5, 0.5, np.nan, 0.5])
    assert arrival(record).arrived == 3


def test_assembly_is_judged_by_the_ways_to_the_last_slots() -> None:
    slots_m = 10.0 * TETRAHEDRON + CENTER
    below_m = np.maximum(0.0, 13.0 - 0.05 * np.arange(400))  # up at 1 m/s
    paths = [slots_m + np.array([0.0, 0.0, way_m]) for way_m in below_m]
    record = record_of(paths)
    record.slot_m, record.off_slot_m = slots_m, [np.linalg.norm(path - slots_m, axis=1) for path in paths]
    figures = arrival(record)
    assert (figures.arrived, figures.expected) == (4, 4)
    up_m_s = record.scenario.control.safety.limits.up_m_s
    assert figures.median_ratio == pytest.approx(11.05 / (13.0 / up_m_s), abs=0.001)
    record.off_slot_m[-100:] = [np.array([0.0, 0.0, 0.0, 2.5])] * 100
    assert arrival(record).arrived == 3


def test_landings_count_after_a_return_past_lost_ones() -> None:
    """They were not counted: with lost vehicles only slots were."""
    pads_m = 10.0 * TETRAHEDRON * (1.0, 1.0, 0.0)
    record = record_of([10.0 * TETRAHEDRON + CENTER] * 40 + [pads_m] * 40, scenario(ending="return"))
    record.off_slot_m = [np.zeros(4)] * 40
    assert (arrival(record).arrived, arrival(record).late_s) == (4, None)
    record.goal_m, record.expected = pads_m, np.array([True, True, False, True])  # the third is lost
    record.in_air[40:] = [np.zeros(4, dtype=bool)] * 40
    figures = arrival(record)
    assert (figures.arrived, figures.expected, figures.total_s) == (3, 3, 2.0)
    record.position_m[40:] = [pads_m + np.array([[5.0, 0.0, 0.0], *np.zeros((3, 3))])] * 40
    assert arrival(record).arrived == 2  # the first lies beside its pad


@pytest.mark.parametrize("has_goals", [False, True])
def test_a_flight_that_all_left_has_figures(has_goals: bool) -> None:
    """`gcs simulate wind-failsafes --judged` ended with a traceback: the wind had sent all of 20 down."""
    record = record_of([10.0 * TETRAHEDRON + CENTER] * 40, scenario(ending="return"))
    record.off_slot_m = [np.full(4, np.nan)] * 40
    if has_goals:
        record.goal_m, record.expected = np.zeros((4, 3)), np.zeros(4, dtype=bool)
    figures = arrival(record)
    assert (figures.arrived, figures.expected, figures.total_s) == (0, 0, None)


def test_two_lost_vehicles_that_meet_are_counted_apart() -> None:
    record = record_of([10.0 * TETRAHEDRON + CENTER] * 4)
    record.violating, record.lost_rows = {(0, 1), (1, 2)}, frozenset({1, 2})
    figures = measure.separation(record)
    assert (figures.violations, figures.lost_pairs) == (1, 1)
    record.lost_rows = frozenset()
    figures = measure.separation(record)
    assert (figures.violations, figures.lost_pairs) == (2, 0)
