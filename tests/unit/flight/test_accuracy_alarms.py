"""One vehicle's bad position is reported of that vehicle: it is no wind, and no small radius."""

from dataclasses import replace
from typing import Final

import numpy as np
import pytest

from gcs.control import Memory, Tick
from gcs.failsafe.autopilot_failsafe import FailsafeCause
from gcs.flight.monitors.accuracy_alarms import LASTS_S, NO_FIX
from gcs.flight.monitors.alarm_monitor import accuracy_alarms_of
from gcs.flight.state.flight import Flight
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array, FleetState, Landed, Setpoints
from gcs.safety.authority import Authority
from gcs.safety.floor import Floor
from gcs.service.alarms import AlarmCause, Condition
from tests.unit.flight.test_assembled import flight

COUNT, PERIOD_S = 6, 0.2
GOOD_M, BAD_M = 0.05, 2.0
BLOWN: Final = np.array([1.5, 0.0, 0.0])


def running(uncertain: dict[int, float], *, doubtful: tuple[int, ...] = ()) -> Flight:
    """All in formation; the uncertainty of some rows in m, and rows without a 3D fix."""
    subject = flight(COUNT)
    subject.show.phase = ShowPhase.RUNNING
    for vehicle in subject.vehicles.values():
        vehicle.phase = Phase.FORMATION
    uncertainty_m = np.full(COUNT, GOOD_M)
    uncertainty_m[list(uncertain)] = list(uncertain.values())
    subject.newest.traits = replace(subject.newest.traits, uncertainty_m=uncertainty_m)
    subject.newest.silent = np.zeros(COUNT, np.bool_)
    return at(subject, 100.0, doubtful)


def at(subject: Flight, time_s: float, doubtful: tuple[int, ...] = ()) -> Flight:
    nothing = np.zeros((COUNT, 3))
    rows = np.isin(np.arange(COUNT), doubtful)
    ids = subject.newest.state.ids
    subject.newest.state = FleetState(time_s, ids, nothing, nothing, np.zeros(COUNT), np.zeros(COUNT), rows)
    return subject


def of_the_radius(subject: Flight) -> list[tuple[AlarmCause, tuple[str, ...]]]:
    return [(each.cause, each.vehicles) for each in accuracy_alarms_of(subject).of_the_radius()]


def test_all_uncertain_is_a_small_radius() -> None:
    assert of_the_radius(running(dict.fromkeys(range(COUNT), BAD_M))) == [(AlarmCause.RADIUS_SMALL, ())]


def test_one_uncertain_vehicle_is_named_instead() -> None:
    assert of_the_radius(running({2: BAD_M})) == [(AlarmCause.UNCERTAIN_POSITION, ("d2",))]
    assert of_the_radius(running({})) == []


def test_vehicle_without_a_fix_makes_no_radius_small() -> None:
    blind = running({2: 3.0}, doubtful=(2,))
    assert of_the_radius(blind) == []
    (reported,) = accuracy_alarms_of(blind).of_positions(())
    assert (reported.cause, reported.because, reported.vehicles) == (AlarmCause.BAD_POSITION, NO_FIX, ("d2",))
    assert reported.advice == ""
    blind.vehicles["d2"].phase = Phase.PILOT
    (reported,) = accuracy_alarms_of(blind).of_positions(())
    assert "cannot be steered" in reported.advice
    blind.vehicles["d2"].cause = FailsafeCause.POSITION_LOSS
    assert list(accuracy_alarms_of(blind).of_positions(())) == [], "the alarm of its own failsafe says so"


def standing(up_m: float, seconds: float) -> list[Condition]:
    """Conditions after so long on the start, of one that reports a height that is off."""
    subject = running({})
    vehicle = subject.vehicles["d1"]
    vehicle.phase, vehicle.home_m = Phase.STANDBY, np.array([0.0, 0.0, up_m])
    landed = (Landed.ON_GROUND,) * COUNT
    subject.newest.telemetry = replace(subject.newest.telemetry, landed=landed)
    alarms, found = accuracy_alarms_of(subject), []
    for index in range(round(seconds / PERIOD_S) + 1):
        at(subject, 100.0 + index * PERIOD_S)
        found = list(alarms.of_heights())
    return found


def test_height_on_the_pad_is_judged_over_some_seconds() -> None:
    assert standing(2.2, seconds=3.0) == [], "an estimate settles after a touch-down"
    (reported,) = standing(3.0, seconds=4.0)
    assert (reported.cause, reported.vehicles) == (AlarmCause.HEIGHT_DIFFERS, ("d1",))
    assert standing(5.0, seconds=2.0)


def of_wind(
    subject: Flight,
    lacking: dict[int, Array],
    *,
    seconds: float,
    doubtful: tuple[int, ...] = (),
    gusts_m_s: float = 1.0,
) -> list[Condition]:
    """Conditions after so long of the same lack, with margins as wide as in gusts."""
    alarms, lack_m_s, found = accuracy_alarms_of(subject), np.zeros((COUNT, 3)), []
    for row, lack in lacking.items():
        lack_m_s[row] = lack
    full = Authority.full(COUNT)
    moves = np.zeros((COUNT, 3))
    square_m2_s2 = np.full(COUNT, gusts_m_s**2)
    authority = replace(full, least_m_s=moves, most_m_s=moves, lack_m_s=lack_m_s, square_m2_s2=square_m2_s2)
    memory = replace(Memory.fresh(COUNT, 0.0), authority=authority)
    nothing = Setpoints(0.0, (), np.zeros((0, 3)), np.zeros(0))
    tick = Tick(nothing, lambda: memory, ("",) * COUNT, moves, np.ones(COUNT, np.bool_), Floor())
    for index in range(round(seconds / PERIOD_S) + 1):
        at(subject, 100.0 + index * PERIOD_S, doubtful)
        found = [one for one in alarms.of_authority(tick) if one.cause is AlarmCause.LITTLE_AUTHORITY]
    return found


def test_several_that_lack_velocity_are_in_wind_at_once() -> None:
    (reported,) = of_wind(running({}), {0: BLOWN, 3: BLOWN}, seconds=0.0)
    assert reported.because == "up to 2.3 m/s off, by wind or gusts"


def test_all_that_lack_alike_are_not_told_of_gusts() -> None:
    """After a hard turn, too: what they lack is named, never the 0 m/s that they differ by."""
    alike = dict.fromkeys(range(COUNT), 2.0 * BLOWN)
    (reported,) = of_wind(running({}), alike, seconds=0.0, gusts_m_s=0.0)
    assert reported.because == "up to 3.0 m/s off, all alike: by wind, or a hard turn"


def test_one_alone_that_lacks_velocity_is_named_when_it_lasts() -> None:
    assert of_wind(running({}), {3: BLOWN}, seconds=LASTS_S / 2.0) == []
    (reported,) = of_wind(running({}), {3: BLOWN}, seconds=LASTS_S)
    assert reported.because == "d3 alone, 1.5 m/s off"


@pytest.mark.parametrize("lacking", [{}, {3: BLOWN}])
def test_a_position_in_doubt_is_no_wind(lacking: dict[int, Array]) -> None:
    assert of_wind(running({}), lacking, seconds=2.0 * LASTS_S, doubtful=(3,)) == []
