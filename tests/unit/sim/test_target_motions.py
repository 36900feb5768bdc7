"""Motions of targets: bounded, continuous, the same for the same seed."""

from math import atan2, degrees, hypot, pi
from pathlib import Path

import numpy as np
import pytest

from gcs.sim.targets.motions import (
    ASIDE_M_S2,
    CORNER_S,
    DRIFT_M_S,
    KINDS,
    LOITER_M,
    ROUNDABOUT_M,
    TrackError,
    motion,
    moved,
    played,
    read_track,
)
from gcs.sim.vehicle.sensors import Tangent

RECORDED = Path(__file__).parents[2] / "data" / "targets" / "px4-session.csv"
STEP_S = 0.05
TIMES_S = np.arange(0.0, 300.0, STEP_S).tolist()
CHANGE_MAX_M_S2 = {"walker": 3.2, "hairpin": 3.2, "corners": ASIDE_M_S2 + 0.1, "random": 2.1}
"""Greatest acceleration; else 2 m/s2."""

DRAWN = [name for name, kind in KINDS.items() if kind.legs is not None]


def speed_max_m_s(name: str) -> float:
    return KINDS[name].speed_m_s + (DRIFT_M_S if name == "boat" else 0.0)


@pytest.mark.alternates(0)
@pytest.mark.parametrize("name", DRAWN)
@pytest.mark.parametrize("seed", [0, 7])
def test_speed_is_bounded_and_motion_continuous(name: str, seed: int) -> None:
    """The velocity is the change of the position, and jumps nowhere."""
    at = motion(name, seed=seed, course_deg=30.0)
    states = np.array([at(time_s) for time_s in TIMES_S])
    place_m, velocity_m_s = states[:, :3], states[:, 3:]
    assert at(0.0)[:3] == (0.0, 0.0, 0.0)
    assert np.linalg.norm(velocity_m_s, axis=1).max() <= speed_max_m_s(name) + 1e-9
    middle_m_s = (velocity_m_s[:-1] + velocity_m_s[1:]) / 2
    np.testing.assert_allclose(np.diff(place_m, axis=0), middle_m_s * STEP_S, atol=5e-3)
    change_m_s2 = np.linalg.norm(np.diff(velocity_m_s, axis=0), axis=1) / STEP_S
    assert change_m_s2.max() <= CHANGE_MAX_M_S2.get(name, 2.0)


@pytest.mark.parametrize("name", list(KINDS))
def test_motion_is_a_function_of_time_and_seed(name: str) -> None:
    """In whatever order it is asked."""
    once, again = motion(name, seed=3), motion(name, seed=3)
    backwards = [again(time_s) for time_s in reversed(TIMES_S)]
    assert [once(time_s) for time_s in TIMES_S] == backwards[::-1]
    differs = motion(name, seed=4)(200.0) != once(200.0)
    assert differs == (name in {"walker", "walk", "boat", "random"}), "the others have no choice"


@pytest.mark.parametrize("course_deg", [0.0, 210.0])
def test_recorded_walk_is_that_of_a_person(course_deg: float) -> None:
    """It goes on from any place of the track, without a jump, with stops, and as fast as people walk."""
    at = motion("walk", seed=3, course_deg=course_deg)
    places_m = np.array([at(time_s)[:2] for time_s in TIMES_S if time_s < 150.0])
    speeds_m_s = np.hypot(*np.diff(places_m, axis=0).T) / STEP_S
    assert at(0.0)[:3] == (0.0, 0.0, 0.0)
    assert speeds_m_s.max() < 1.5
    assert speeds_m_s.min() < 0.7
    assert 0.7 < np.median(speeds_m_s) < 1.4


def test_walker_stops_and_goes_on() -> None:
    at = motion("walker")
    speeds_m_s = np.array([hypot(*at(time_s)[3:]) for time_s in TIMES_S])
    assert speeds_m_s.max() == pytest.approx(1.5)
    stands = speeds_m_s < 0.01
    assert 0.1 < stands.mean() < 0.6
    assert np.count_nonzero(np.diff(stands.astype(int)) == 1) >= 5


@pytest.mark.parametrize(("name", "radius_m"), [("roundabout", ROUNDABOUT_M), ("loiter", LOITER_M)])
def test_roundabout_is_a_circle_of_its_radius(name: str, radius_m: float) -> None:
    at = motion(name)
    places_m = np.array([at(time_s)[:2] for time_s in TIMES_S])
    assert np.linalg.norm(places_m - [0.0, radius_m], axis=1) == pytest.approx(radius_m)
    assert at(2 * pi * radius_m / hypot(*at(0.0)[3:]))[:2] == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("speed_m_s", [2.0, 8.0, 20.0])
def test_corners_turn_by_a_right_angle_every_ten_seconds(speed_m_s: float) -> None:
    at = motion("corners", speed_m_s=speed_m_s)
    for corner in range(8):
        state = at(corner * CORNER_S)
        course_deg = degrees(atan2(state.east_m_s, state.north_m_s))
        assert (course_deg - 90.0 * corner + 180.0) % 360.0 == pytest.approx(180.0)
        assert hypot(*state[3:]) == pytest.approx(speed_m_s)


def test_hairpin_turns_back() -> None:
    """Slowly, and twice in one round."""
    at = motion("hairpin")
    states = [at(time_s) for time_s in TIMES_S]
    speeds_m_s = [hypot(*state[3:]) for state in states]
    assert (min(speeds_m_s), max(speeds_m_s)) == pytest.approx((3.0, 8.0))
    assert min(state.north_m_s for state in states) == pytest.approx(-8.0)


def test_boat_drifts_where_its_bow_does_not_point() -> None:
    """Over whole periods of the curves what remains of the way aside is the drift."""
    still, drifting = motion("boat", seed=1, speed_m_s=0.1)(400.0), motion("boat", seed=1)(400.0)
    assert hypot(still.north_m, still.east_m) == pytest.approx(DRIFT_M_S * 400.0, abs=45.0)
    assert hypot(drifting.north_m, drifting.east_m) > 300.0


def test_motion_begins_elsewhere() -> None:
    at, there = motion("rover"), moved(motion("rover"), 30.0, -40.0)
    assert np.subtract(there(9.0), at(9.0)) == pytest.approx([30.0, -40.0, 0.0, 0.0, 0.0, 0.0])


def test_recorded_track_is_played_where_it_was() -> None:
    rows = read_track(RECORDED)
    origin, at = played(rows)
    located = Tangent(origin.latitude_deg, origin.longitude_deg, origin.altitude_amsl_m).geodetic
    states = [at(row[0]) for row in rows]
    places = located(np.array([state[:3] for state in states]))
    assert places[:, :2] == pytest.approx(np.array(rows)[:, 1:3], abs=1e-7)  # 1 cm
    assert places[:, 2] == pytest.approx(np.array(rows)[:, 3], abs=0.01)
    assert 9.0 < max(hypot(*state[3:5]) for state in states) < 12.0
    assert at(1e6) == (*states[-1][:3], 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "the header has no time_s, latitude_deg, longitude_deg; it names time_s,latitude_deg"),
        ("time_s,latitude_deg,longitude_deg\n", "has no line below its header"),
        ("time_s,latitude_deg,longitude_deg\n0,47,8\n1,47\n", "line 3: numbers are needed"),
        (
            "time_s,latitude_deg,longitude_deg\n0,47,8\n0,47,8\n",
            "line 3: numbers are needed, and a later time",
        ),
        ("time_s,latitude_deg,longitude_deg\n0,nan,8\n", "line 2: numbers are needed"),
    ],
)
def test_track_that_cannot_be_read_is_named(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "track.csv"
    file.write_text(text)
    with pytest.raises(TrackError) as error:
        read_track(file)
    assert says in str(error.value)
