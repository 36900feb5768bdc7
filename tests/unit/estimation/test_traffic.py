"""The table of all traffic: each track is estimated, and whatever arrives, it stays small."""

from math import isnan, nan

import numpy as np
import pytest

from gcs.estimation.traffic import AGAIN, SURFACE_M, TRACKS_KEPT, TrackReport, TrackTable, turned
from gcs.model.traffic import VESSEL_S

NORTH_M_S = 20.0


def report(
    at_s: float, name: str = "A", *, x_m: float | None = None, z_m: float = -50.0, velocity: bool = True
) -> TrackReport:
    """A track that flies north."""
    moves_m_s = (NORTH_M_S, 0.0, 0.0) if velocity else (nan, nan, nan)
    place_m = (NORTH_M_S * at_s if x_m is None else x_m, 5.0, z_m)
    return TrackReport(name, "manned", at_s, at_s, place_m, moves_m_s, 3.0, 3.0, 0.5)


def flown(until_s: int = 10, *, velocity: bool = True) -> TrackTable:
    table = TrackTable(15.0)
    for second in range(until_s + 1):
        table.take(report(float(second), velocity=velocity))
    return table


@pytest.mark.parametrize("velocity", [True, False])
def test_track_moves_on_as_it_did(velocity: bool) -> None:
    traffic = flown(velocity=velocity).at(12.0)
    assert traffic.ids == ("A",)
    assert traffic.kinds == ("manned",)
    assert traffic.position_m[0] == pytest.approx([240.0, 5.0, -50.0], abs=0.5)
    assert traffic.velocity_m_s[0] == pytest.approx([NORTH_M_S, 0.0, 0.0], abs=0.3)
    assert traffic.age_s[0] == 2.0


def test_velocity_that_is_not_reported_is_less_certain() -> None:
    reported, not_reported = (flown(velocity=velocity).at(12.0).spread[0, 0] for velocity in (True, False))
    assert (reported < not_reported).all()


def test_height_is_not_known_until_it_is_reported() -> None:
    table = TrackTable(15.0)
    table.take(report(0.0, z_m=nan))
    assert isnan(table.at(0.0).position_m[0, 2])
    table.take(report(1.0, z_m=-80.0))
    assert table.at(1.0).position_m[0, 2] == -80.0


def test_height_after_many_reports_without_one() -> None:
    table = TrackTable(15.0)
    for second in range(9):
        table.take(report(float(second), z_m=nan))
    table.take(report(9.0, z_m=-80.0))
    assert table.at(9.0).spread[0, 1, 0] == pytest.approx(9.0, abs=0.1), "that of the report"


@pytest.mark.parametrize(("kind", "height_m"), [("ground", 0.0), ("vessel", 0.0), ("unmanned", nan)])
def test_what_is_on_the_surface_is_as_high_as_it_was(kind: str, height_m: float) -> None:
    table = TrackTable(15.0)
    for second in range(20):
        table.take(TrackReport("A", kind, 0.0, float(second), (0.1 * second, 0.0, nan)))
    assert table.at(19.0).position_m[0, 2] == pytest.approx(-height_m, nan_ok=True)
    table.take(TrackReport("A", kind, 0.0, 20.0, (2.0, 0.0, -40.0), height_deviation_m=1.0))
    for second in range(21, 25):
        table.take(TrackReport("A", kind, 0.0, float(second), (0.1 * second, 0.0, nan)))
    traffic = table.at(24.0)
    assert traffic.position_m[0, 2] == pytest.approx(-40.0, abs=5.0)
    assert kind == "unmanned" or np.sqrt(traffic.spread[0, 1, 0]) < SURFACE_M


def test_report_cannot_be_certain_to_the_digit() -> None:
    table, exact = TrackTable(15.0), 1e-170
    for second in range(3):
        place_m = (float(second), 0.0, -50.0)
        table.take(TrackReport("A", "manned", 0.0, float(second), place_m, (1.0, 0.0, 0.0), *[exact] * 3))
    assert table.accepted == 3
    assert (table.at(2.0).spread[0, :, 0] > 0.0).all()


def test_track_is_forgotten() -> None:
    table = flown()
    table.forget(24.0)
    assert len(table) == 1
    table.forget(26.0)
    assert len(table) == 0


def test_vessel_is_known_between_its_reports() -> None:
    table = TrackTable(15.0)
    table.take(TrackReport("A", "vessel", 0.0, 0.0, (0.0, 50.0, nan), (4.0, 0.0, nan)))
    sure, unsure = (table.at(after_s).spread[0, 0, 0] for after_s in (0.0, 170.0))
    assert unsure > 100.0 * sure
    table.forget(170.0)
    assert table.at(170.0).position_m[0, :2] == pytest.approx([680.0, 50.0], abs=1.0)
    table.forget(195.0)  # the next report of one at anchor, which comes every 180 s, may be a little late
    assert len(table) == 1
    table.forget(VESSEL_S + 1.0)
    assert len(table) == 0


def test_repeated_reports_of_a_vessel_at_anchor_are_one() -> None:
    """A receiver repeats the last one each second, with its age in whole seconds."""
    table = TrackTable(15.0)
    for second in range(180):
        table.take(TrackReport("A", "vessel", float(second), 0.99 * (second % 2), (0.0, 50.0, nan)))
    assert table.accepted == 1
    assert np.sqrt(table.at(179.0).spread[0, 0, 0]) > 500.0, "it is not known better for that"
    table.take(TrackReport("A", "vessel", 183.0, 180.0, (0.0, 50.0, nan)))
    assert table.accepted == 2


def test_late_and_repeated_reports_change_nothing() -> None:
    table = flown()
    before = table.at(11.0)
    table.take(report(4.0))
    table.take(report(10.0))
    table.take(TrackReport("A", "manned", 10.5, 10.5, (200.0, 5.0, -50.0), (NORTH_M_S, 0.0, 0.0)))
    assert (table.late, table.repeated) == (1, 2)
    np.testing.assert_array_equal(table.at(11.0).position_m, before.position_m)


def test_jump_is_not_believed_until_it_lasts() -> None:
    table = flown()
    for second in range(AGAIN - 1):
        table.take(report(11.0 + second, x_m=-900.0 - second))
    assert table.outliers == AGAIN - 1
    assert table.at(12.0).position_m[0, 0] > 200.0
    table.take(report(14.0, x_m=-905.0))
    assert table.at(14.0).position_m[0, 0] == pytest.approx(-905.0)


def test_nearest_tracks_are_kept() -> None:
    table = TrackTable(15.0)
    for number in range(3 * TRACKS_KEPT):
        away_m = 50.0 + 10.0 * ((number * 7) % (3 * TRACKS_KEPT))
        table.take(report(0.0, f"T{number}", x_m=away_m))
    assert len(table) == TRACKS_KEPT
    assert table.crowded_s == 0.0
    assert table.at(0.0).position_m[:, 0].max() < 50.0 + 10.0 * TRACKS_KEPT


def test_slow_tracks_stay_slow_until_they_are_fast() -> None:
    table, seen = TrackTable(15.0), []
    for second, speed_m_s in enumerate([1.0] * 5 + [2.0] * 5 + [4.0] * 8 + [2.0] * 5):
        place_m = (2.0 * second, 0.0, 0.0)
        exact = 0.1
        table.take(
            TrackReport(
                "boat",
                "vessel",
                float(second),
                float(second),
                place_m,
                (speed_m_s, 0.0, 0.0),
                50.0,
                50.0,
                exact,
            )
        )
        seen.append(bool(table.at(float(second)).slow[0]))
    assert [seen[second] for second in (4, 9, 17, 22)] == [True, True, False, False]


def circling(until_s: int, turn_rad_s: float = 0.25, speed_m_s: float = NORTH_M_S) -> TrackTable:
    """One that flies north for 5 s, and turns to the right then."""
    table, radius_m = TrackTable(15.0), speed_m_s / turn_rad_s
    for second in range(until_s + 1):
        angle = turn_rad_s * max(second - 5, 0)
        straight_m = speed_m_s * min(second, 5)
        place_m = (straight_m + radius_m * np.sin(angle), radius_m * (1.0 - np.cos(angle)), -50.0)
        moves_m_s = (speed_m_s * np.cos(angle), speed_m_s * np.sin(angle), 0.0)
        table.take(TrackReport("A", "manned", second, second, place_m, moves_m_s, 3.0, 3.0, 0.5))
    return table


def test_turn_is_known_from_two_reports_of_it() -> None:
    assert circling(5).at(5.0).turn_rad_s[0] == 0.0
    traffic = circling(7).at(8.0)
    assert traffic.turn_rad_s[0] == pytest.approx(0.25, abs=0.05)
    angle = 0.25 * 6.0
    foreseen_m, _ = turned(traffic.position_m, traffic.velocity_m_s, traffic.turn_rad_s, np.array([3.0]))
    there_m = [100.0 + 80.0 * np.sin(angle), 80.0 * (1.0 - np.cos(angle)), -50.0]
    assert foreseen_m[0] == pytest.approx(there_m, abs=12.0)


def test_noise_is_no_turn() -> None:
    random, turns = np.random.default_rng(1), 0
    for _ in range(50):
        table = TrackTable(15.0)
        for second in range(20):
            place_m = np.array([NORTH_M_S * second, 5.0, -50.0]) + random.normal(0.0, 3.0, 3)
            moves_m_s = np.array([NORTH_M_S, 0.0, 0.0]) + random.normal(0.0, 0.5, 3)
            table.take(TrackReport("A", "manned", second, second, (*place_m,), (*moves_m_s,), 3.0, 3.0, 0.5))
        turns += bool(table.at(19.0).turn_rad_s[0])
    assert turns <= 2


@pytest.mark.parametrize(
    ("x_m", "north_m_s", "until_s"),
    [(-200.0, 10.0, 50.0), (-900.0, 10.0, 60.0), (-200.0, -10.0, 15.0), (-200.0, 1.0, 15.0)],
    ids=["comes", "is far away", "goes", "hardly moves"],
)
def test_track_that_comes_and_falls_silent_is_kept(x_m: float, north_m_s: float, until_s: float) -> None:
    table = TrackTable(15.0)
    moves_m_s = (north_m_s, 0.0, 0.0)
    table.take(TrackReport("A", "manned", 0.0, 0.0, (x_m, 5.0, -50.0), moves_m_s, 3.0, 3.0, 0.1))
    table.forget(until_s - 1.0)
    assert len(table) == 1
    table.forget(until_s + 2.0)
    assert len(table) == 0


def test_silent_track_that_comes_to_the_formation_is_kept() -> None:
    """The formation may be far from the origin, over which the track has passed."""
    for center_m, kept in ((np.array([900.0, 0.0]), 1), (np.zeros(2), 0)):
        table = TrackTable(15.0)
        table.take(TrackReport("A", "manned", 0.0, 0.0, (100.0, 0.0, -50.0), (30.0, 0.0, 0.0), 3.0, 3.0, 0.1))
        table.forget(17.0, center_m)
        assert len(table) == kept


def test_turn_between_sparse_reports_is_believed() -> None:
    """A vessel turns by a right angle between two reports, which come every 10 s."""
    table, places_m = TrackTable(15.0), []
    for number in range(16):
        before_s, after_s = 10.0 * min(number, 8), 10.0 * max(number - 9, 0)
        places_m.append(np.array([8.0 * before_s + 50.0 * (number > 8), 50.0 * (number > 8) + 8.0 * after_s]))
        moves_m_s = (8.0, 0.0, 0.0) if number <= 8 else (0.0, 8.0, 0.0)
        at_s = 10.0 * number
        table.take(TrackReport("A", "vessel", at_s, at_s, (*places_m[-1], nan), moves_m_s, 5.0, 5.0, 0.5))
        off_m = np.hypot(*(table.at(at_s).position_m[0, :2] - places_m[-1]))
        assert off_m < 15.0
    assert table.outliers == 0


def test_refused_report_widens_its_track() -> None:
    table, other = flown(), flown()
    table.take(report(11.0, x_m=-900.0))
    assert (table.at(12.0).spread[0, :, 0] > other.at(12.0).spread[0, :, 0]).all()
