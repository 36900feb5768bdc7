"""Which traffic counts for a formation, and where it will be."""

import numpy as np

from gcs.control.traffic import WAYS_MAX, Sphere, tracks_near
from gcs.estimation.traffic import TrackReport, TracksNow, TrackTable
from gcs.model.state import Array
from gcs.model.traffic import Cylinder
from gcs.safety.constraints import Braking, Constraints
from gcs.safety.near_traffic import Evading, track_constraints

HERE = Sphere(np.array([0.0, 0.0, -40.0]), np.zeros(3), 10.0)


def constraints(table: TrackTable, now_s: float, *place_m: tuple[float, float, float]) -> Constraints:
    near, _ = tracks_near(table.at(now_s), Cylinder(radius_m=20.0), HERE, now_s)
    n = len(place_m)
    evading = Evading(
        np.array(place_m),
        np.ones(n, np.bool_),
        np.zeros((n, 3)),
        np.zeros(n),
        np.full(n, 8.0),
        Braking().of_each(n),
        300.0,
    )
    return track_constraints(evading, near)


def reported(table: TrackTable, name: str, now_s: float, place_m: Array, velocity_m_s: Array) -> None:
    table.take(TrackReport(name, "manned", now_s, now_s, (*place_m,), (*velocity_m_s,), 1.0, 1.0, 0.2))


def test_vehicle_on_the_arc_evades_and_one_ahead_does_not() -> None:
    """It turns to the east about a centre 80 m east of it, at 20 m/s."""
    table, turn_rad_s, radius_m = TrackTable(15.0), 0.25, 80.0
    for second in range(6):
        angle = turn_rad_s * (second - 5)
        place_m = np.array([radius_m * np.sin(angle), radius_m * (1.0 - np.cos(angle)), -40.0])
        reported(table, "A", second, place_m, 20.0 * np.array([np.cos(angle), np.sin(angle), 0.0]))
    angle = turn_rad_s * 4.0
    on_the_arc_m = (radius_m * np.sin(angle), radius_m * (1.0 - np.cos(angle)), -40.0)
    rows = constraints(table, 5.0, on_the_arc_m, (140.0, 0.0, -40.0))
    asked = {int(row) for row, bound_m_s in zip(rows.first, rows.bound_m_s, strict=True) if bound_m_s > 0.0}
    assert asked == {0}


def test_one_velocity_leads_out_of_several_corridors() -> None:
    random = np.random.default_rng(5)
    headings = np.arange(0.0, 2.0 * np.pi, 0.02)
    ways_m_s = 8.0 * np.stack([np.cos(headings), np.sin(headings), np.zeros(len(headings))], axis=1)
    for _ in range(50):
        table = TrackTable(15.0)
        for number in range(int(random.integers(2, 6))):
            angle, speed_m_s = random.uniform(-np.pi, np.pi), random.uniform(8.0, 25.0)
            along = np.array([np.cos(angle), np.sin(angle), 0.0])
            place_m = -6.0 * speed_m_s * along + [0.0, *random.uniform(-10.0, 10.0, 1), -40.0]
            reported(table, f"T{number}", 0.0, place_m, speed_m_s * along)
        rows = constraints(table, 0.0, (0.0, 0.0, -40.0))
        kept_m_s = ways_m_s @ rows.normal.T - rows.bound_m_s
        assert kept_m_s.min(axis=1).max() > -0.5


def test_arcs_of_many_turning_tracks_are_bounded() -> None:
    """The soonest have arcs, each other one its tangent."""
    k = 16
    place_m = np.array([[-50.0 - 10.0 * number, 0.0, -40.0] for number in range(k)])
    traffic = TracksNow(
        tuple(f"T{number}" for number in range(k)),
        ("manned",) * k,
        place_m,
        np.tile([20.0, 0.0, 0.0], (k, 1)),
        np.zeros((k, 2, 3)),
        np.zeros(k),
        np.zeros(k, np.bool_),
        np.full(k, 0.1),
    )
    near, _ = tracks_near(traffic, Cylinder(radius_m=20.0), HERE, 0.0)
    assert near is not None
    assert len(near) <= WAYS_MAX
    assert [near.names.count(name) for name in ("T0", "T1", "T2", "T15")] == [5, 5, 1, 1]
