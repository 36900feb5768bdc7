"""A vehicle that comes down is stuck once it gets neither lower nor nearer; one that waits is not."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.flight.monitors.in_place import NOT_LOWER_S
from gcs.flight.state.flight import Flight
from gcs.flight.state.headway import ROUND_S, Headway
from gcs.model.lifecycle import Phase
from gcs.model.state import Array, FleetState
from tests.unit.flight.test_assembled import flight

UP_M = np.array([[0.0, 0.0, -14.0], [9.0, 0.0, -20.0]])
STILL = np.zeros((2, 3))


def landing() -> Flight:
    """Two vehicles above their places."""
    subject = flight(2)
    for vehicle, place_m in zip(subject.vehicles.values(), UP_M, strict=True):
        vehicle.phase, vehicle.goal_m = Phase.LANDING, place_m * (1.0, 1.0, 0.0)
    return at(subject, 0.0, UP_M)


def at(
    subject: Flight, time_s: float, place_m: Array, flown_m_s: Array = STILL, asked_m_s: Array = STILL
) -> Flight:
    ids, zero = subject.newest.state.ids, np.zeros(2)
    subject.newest.state = FleetState(time_s, ids, place_m, flown_m_s, zero, zero)
    subject.newest.memory = replace(subject.newest.memory, asked_m_s=asked_m_s)
    return subject


class Watched:
    """A flight of two vehicles, looked at once a second."""

    def __init__(self, subject: Flight) -> None:
        self.subject = subject
        self.maneuvers = {"d0": object(), "d1": object()}
        self.ends_m = dict[str, Array]()
        self.headway = Headway(
            subject.newest,
            subject.vehicles,
            lambda vehicle: vehicle.phase is Phase.LANDING and not subject.may_descend(vehicle),
            lambda vehicle: self.maneuvers[vehicle.id],
            lambda vehicle: self.ends_m.get(vehicle.id, vehicle.goal_m),
        )

    def look(self, time_s: float, place_m: Array = UP_M, **motion: Array) -> list[str]:
        """Returns: the vehicles that are stuck."""
        at(self.subject, time_s, place_m, **motion)
        self.headway.look()
        return [
            name
            for name, row in zip(self.subject.vehicles, self.headway.stands_s, strict=True)
            if row >= NOT_LOWER_S
        ]


SECONDS = range(int(NOT_LOWER_S) + 1)


def test_only_what_gets_no_lower_is_stuck() -> None:
    watched = Watched(landing())
    for second in SECONDS:
        sways_m = np.array([[0.0, 0.0, 0.2 * (second % 2)], [0.0, 0.0, 0.4 * second]])
        stuck = watched.look(float(second), UP_M + sways_m)
    assert stuck == ["d0"]
    assert watched.look(20.5, UP_M + np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 9.0]])) == []


@pytest.mark.parametrize("handed_over", [False, True])
def test_a_way_to_a_place_counts_while_it_is_led(*, handed_over: bool) -> None:
    """Nearer to its place it gets on; what its own LAND does sideways does not bring it down."""
    subject = landing()
    subject.vehicles["d0"].goal_m = np.array([60.0, 0.0, -14.0])
    subject.vehicles["d0"].set_flags(handed_over=handed_over)
    watched = Watched(subject)
    for second in SECONDS:
        stuck = watched.look(
            float(second), UP_M + np.array([[2.0 * second, 0.0, 0.0], [0.0, 0.0, 0.4 * second]])
        )
    assert stuck == (["d0"] if handed_over else [])


def test_a_vehicle_that_waits_for_lower_ones_is_not_stuck() -> None:
    """The lower one, which is not above its place yet, is; and one that does not stay where it waits."""
    subject = landing()
    subject.vehicles["d0"].goal_m = np.array([30.0, 0.0, -14.0])
    watched = Watched(subject)
    for second in SECONDS:
        stuck = watched.look(float(second))
    assert stuck == ["d0"]
    for second in range(20, 60):
        stuck = watched.look(
            float(second), UP_M + np.array([[0.0, 0.0, 0.0], [2.0 * (second - 20), 0.0, 0.0]])
        )
    assert stuck == ["d0", "d1"]


def test_a_way_round_something_counts_for_a_time() -> None:
    """It leads away from the place, and the vehicle flies it as it is led: not for ever."""
    round_s = int(ROUND_S[Phase.LANDING])
    watched, led_m_s = Watched(landing()), np.array([[0.0, 4.0, 0.0], [0.0, 0.0, 0.0]])
    for second in range(round_s):
        away_m = UP_M + np.array([[0.0, 4.0 * second, 0.0], [0.0, 0.0, 0.1 * second]])
        assert watched.look(float(second), away_m, flown_m_s=led_m_s, asked_m_s=led_m_s) == []
    for second in range(round_s, round_s + int(NOT_LOWER_S) + 1):
        away_m = UP_M + np.array([[0.0, 4.0 * second, 0.0], [0.0, 0.0, 0.1 * second]])
        stuck = watched.look(float(second), away_m, flown_m_s=led_m_s, asked_m_s=led_m_s)
    assert stuck == ["d0"]


def test_a_vehicle_that_wind_carries_off_is_stuck() -> None:
    """It moves fast, and against what it is asked."""
    watched = Watched(landing())
    asked_m_s, flown_m_s = (
        np.array([[-8.0, 0.0, 0.0], [0.0, 0.0, 0.4]]),
        np.array([[5.0, 0.0, 0.0], [0.0, 0.0, 0.4]]),
    )
    for second in SECONDS:
        stuck = watched.look(
            float(second), UP_M + second * flown_m_s, flown_m_s=flown_m_s, asked_m_s=asked_m_s
        )
    assert stuck == ["d0"]


def test_slowly_home_behind_a_goal_that_goes_ahead_is_headway() -> None:
    """A planned return against wind: the vehicle gets nearer to its pad, and farther from its goal."""
    subject, slowly_m_s = landing(), np.array([[-0.8, 0.0, 0.0], [0.0, 0.0, 0.4]])
    vehicle = subject.vehicles["d0"]
    vehicle.phase = Phase.RETURN
    watched = Watched(subject)
    watched.ends_m["d0"] = np.array([-200.0, 0.0, -14.0])
    for second in range(2 * int(NOT_LOWER_S)):
        vehicle.goal_m = np.array([-4.0 * second, 0.0, -14.0])
        asked_m_s = np.array([[-4.0, 0.0, 0.0], [0.0, 0.0, 0.4]])
        here_m = UP_M + second * slowly_m_s
        assert watched.look(float(second), here_m, flown_m_s=slowly_m_s, asked_m_s=asked_m_s) == []


def test_a_way_to_another_place_counts_from_where_it_begins() -> None:
    """The place below was closed when the vehicle was low: the next is farther than what was left."""
    watched = Watched(landing())
    slowly_m, away_m_s = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.4]]), np.array([0.8, 0.0, 0.0])
    vehicle = watched.subject.vehicles["d0"]
    for second in range(10):
        assert watched.look(float(second), UP_M + slowly_m * second) == []
    vehicle.goal_m = np.array([60.0, 0.0, -14.0])
    for second in range(10, 50):
        here_m = UP_M + slowly_m * second
        here_m[0] += (second - 10) * away_m_s
        assert watched.look(float(second), here_m) == []


def test_a_goal_that_is_put_where_the_vehicle_is_is_no_headway() -> None:
    """Wind has it while no place to land is open: it sways, and its goal is set anew every 2 s."""
    watched = Watched(landing())
    vehicle = watched.subject.vehicles["d0"]
    for second in SECONDS:
        sways_m = np.array([[3.0 * second, 0.0, 0.6 * (second % 2)], [0.0, 0.0, 0.4 * second]])
        if second % 2 == 0:
            vehicle.goal_m = (UP_M + sways_m)[0]
        stuck = watched.look(float(second), UP_M + sways_m)
    assert stuck == ["d0"]


def test_the_time_counts_from_each_command_on() -> None:
    subject = landing()
    watched = Watched(subject)
    for second in range(15):
        assert watched.look(float(second)) == []
    watched.maneuvers["d0"] = object()
    for second in range(15, 25):
        stuck = watched.look(float(second))
    assert stuck == ["d1"]
    subject.vehicles["d1"].phase = Phase.HOLD
    assert watched.look(25.0) == []
    subject.vehicles["d1"].phase = Phase.LANDING
    for second in range(26, 36):
        stuck = watched.look(float(second))
    assert stuck == ["d0"]


def test_a_vehicle_without_a_position_is_stuck_as_well() -> None:
    watched, unknown_m = Watched(landing()), UP_M.copy()
    unknown_m[0] = np.nan
    for second in SECONDS:
        stuck = watched.look(float(second), unknown_m + np.array([[0.0] * 3, [0.0, 0.0, 0.4 * second]]))
    assert stuck == ["d0"]


def test_time_without_a_tick_does_not_count() -> None:
    watched = Watched(landing())
    for second in (0.0, 0.5, 1.0, 40.0, 40.5):
        assert watched.look(second) == []
