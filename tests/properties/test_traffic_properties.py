"""Whatever reports of traffic say, the table stays bounded, and certainty comes of reports alone."""

from math import nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.control.traffic import Sphere, tracks_near
from gcs.estimation.traffic import TRACKS_KEPT, TrackReport, TrackTable
from gcs.model.state import Array
from gcs.model.traffic import TRACK_KINDS, Cylinder
from gcs.safety.constraints import Braking
from gcs.safety.near_traffic import SOONEST, Evading, track_constraints

numbers = st.floats(allow_nan=True, allow_infinity=True)
three = st.tuples(numbers, numbers, numbers)
names = st.integers(0, 400).map(str)
deviations = numbers | st.floats(1e-300, 100.0)


@st.composite
def reports(draw: st.DrawFn) -> TrackReport:
    at_s = draw(st.floats(0.0, 1e4))
    return TrackReport(
        draw(names), draw(st.sampled_from(TRACK_KINDS)), at_s, at_s - draw(st.floats(0.0, 60.0)),
        draw(three), draw(three), draw(deviations), draw(deviations), draw(deviations),
    )  # fmt: skip


@given(
    st.lists(
        st.tuples(st.floats(0.0, 8.0), st.just(nan) | st.floats(-500.0, 0.0), st.booleans(), deviations),
        min_size=1,
        max_size=30,
    )
)
def test_heights_come_and_go(of_one: list[tuple[float, float, bool, float]]) -> None:
    table, now_s = TrackTable(1e9), 0.0
    for after_s, z_m, moves, deviation in of_one:
        now_s += after_s
        place_m, velocity_m_s = (0.01 * now_s, 0.0, z_m), (0.01, 0.0, 0.0) if moves else (nan, nan, nan)
        table.take(TrackReport("A", "ground", now_s, now_s, place_m, velocity_m_s, 5.0, deviation, deviation))
        traffic = table.at(now_s + after_s)
        assert (traffic.spread[:, :, [0, 2]] >= 0.0).all()
        tracks_near(traffic, Cylinder(), Sphere(np.array([0.0, 0.0, -30.0]), np.zeros(3), 10.0), now_s)


@given(st.lists(reports(), max_size=60))
def test_any_reports_are_taken(of_all: list[TrackReport]) -> None:
    table = TrackTable(15.0)
    for each in of_all:
        table.take(each)
    traffic = table.at(2e4)
    assert (traffic.spread[:, :, [0, 2]] >= 0.0).all()
    tracks_near(traffic, Cylinder(), Sphere(np.zeros(3), np.zeros(3), 10.0), 2e4)
    assert len(table) == len(traffic.ids) <= TRACKS_KEPT
    assert np.isfinite(traffic.position_m[:, :2]).all()
    assert np.isfinite(traffic.velocity_m_s).all()
    table.forget(2e4)
    assert len(table) == 0


@pytest.mark.parametrize("ids", [20_000, pytest.param(1_000_000, marks=pytest.mark.soak)])
def test_any_number_of_ids_keeps_the_table_small(ids: int) -> None:
    table = TrackTable(15.0)
    for number in range(ids):
        table.take(TrackReport(f"{number}", "manned", 0.0, 0.0, (float(number % 997), 1.0, -50.0)))
    assert len(table) == TRACKS_KEPT
    assert len(table._rows) == len(table._kinds) == TRACKS_KEPT
    assert table._free == []


@given(st.lists(st.floats(0.1, 5.0), min_size=1, max_size=10), st.floats(0.0, 10.0), st.floats(0.0, 10.0))
@settings(max_examples=50)
def test_variance_never_shrinks_without_a_report(every_s: list[float], one_s: float, more_s: float) -> None:
    table, now_s = TrackTable(1e9), 0.0
    for each_s in every_s:
        now_s += each_s
        table.take(TrackReport("A", "manned", now_s, now_s, (20.0 * now_s, 0.0, -50.0)))
    first, later = (table.at(now_s + after_s).spread[0, :, [0, 2]] for after_s in (one_s, one_s + more_s))
    assert (later >= first - 1e-9).all()


@given(st.permutations(range(6)), st.data())
def test_reports_of_the_past_change_nothing(order: list[int], data: st.DataObject) -> None:
    """Neither what is late, nor what arrives twice."""

    def report(second: int) -> TrackReport:
        place_m = (20.0 * second, 0.0, -50.0)
        return TrackReport("A", "manned", 9.0, float(second), place_m, (20.0, 0.0, 0.0))

    def believed(seconds: list[int]) -> Array:
        table = TrackTable(15.0)
        for second in seconds:
            table.take(report(second))
        return table.at(9.0).position_m

    newest = [second for place, second in enumerate(order) if second >= max(order[: place + 1])]
    doubled = [second for second in order for _ in range(data.draw(st.integers(1, 3)))]
    np.testing.assert_array_equal(believed(list(order)), believed(newest))
    np.testing.assert_array_equal(believed(doubled), believed(newest))


@given(st.integers(0, 2**32 - 1))
def test_no_vehicle_is_asked_for_more_than_it_has(seed: int) -> None:
    """Whatever tracks come, and whatever vehicles desire."""
    random = np.random.default_rng(seed)
    k, n = int(random.integers(1, 8)), int(random.integers(1, 12))
    table = TrackTable(15.0)
    for number in range(k):
        place_m, velocity_m_s = random.uniform(-150.0, 150.0, 3), random.uniform(-30.0, 30.0, 3)
        for at_s in (0.0, 1.0, 2.0):
            there_m = place_m + at_s * velocity_m_s + random.normal(0.0, 5.0, 3)
            table.take(TrackReport(f"{number}", "manned", at_s, at_s, (*there_m,), (*velocity_m_s,)))
    near, _ = tracks_near(table.at(2.0), Cylinder(), Sphere(np.zeros(3), np.zeros(3), 20.0), 2.0)
    fastest_m_s = random.uniform(0.0, 10.0, n)
    evading = Evading(
        random.uniform(-30.0, 30.0, (n, 3)),
        random.uniform(size=n) < 0.8,
        random.uniform(-20.0, 20.0, (n, 3)),
        random.uniform(0.0, 10.0, n),
        fastest_m_s,
        Braking().of_each(n),
        float(random.uniform(1.0, 300.0)),
    )
    rows = track_constraints(evading, near)
    assert evading.commanded[rows.first].all()
    assert (rows.bound_m_s <= fastest_m_s[rows.first] + 1e-9).all()
    np.testing.assert_allclose(np.linalg.norm(rows.normal, axis=1)[np.abs(rows.bound_m_s) > 1e-6], 1.0)
    assert (np.bincount(rows.first, minlength=n) <= SOONEST).all()
