"""Abort, and stop in awkward moments: every controlled vehicle comes down, at places apart."""

import itertools
from typing import NamedTuple

import numpy as np
import pytest

from gcs.links import Verb
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Obstacle
from gcs.model.state import Array
from gcs.service import CommandRecord, Outcome, ShowAction, VehicleAction
from gcs.testing.virtual_show import FlownTrack, VirtualShow, fly, show_config
from tests.support.show_phases import running

NARROW = {"radius_m": 3.5, "height_m": 12.0}  # narrower than the spacing on the ground, with RTK


class Descent(NamedTuple):
    track: FlownTrack  # of everything
    coming_down: FlownTrack  # from the order on
    record: CommandRecord
    started: CommandRecord
    floor_violations: int
    arm_commands: dict[str, int]


async def ordered(show: VirtualShow, action: ShowAction, started: CommandRecord) -> Descent:
    """Order, and wait until the show has landed."""
    began_s = show.now_s
    record = await show.show(action)
    await show.reach(ShowPhase.LANDED)
    await show.wait(4.0)  # longer than between two take-offs
    arm_commands = {
        name: sum(command.verb is Verb.ARM for command in commands)
        for name, commands in show.ports.commands.items()
    }
    return Descent(
        show.track,
        show.track.between(began_s),
        record,
        show.service.command_log.get(started.id),
        show.floor_violations(),
        arm_commands,
    )


def places_m(descent: Descent) -> Array:
    """(n, 2) true place of rest of every vehicle."""
    return descent.coming_down.true_m[-1, :, :2]


def nearest_m(places: Array) -> float:
    """The smallest distance between two of them."""
    return min(float(np.hypot(*(one - other))) for one, other in itertools.combinations(places, 2))


async def abort_from_formation(show: VirtualShow) -> Descent:
    started = await show.start()
    await show.wait(6.0)
    return await ordered(show, ShowAction.ABORT, started)


@pytest.fixture(scope="module")
def aborted() -> Descent:
    return fly(abort_from_formation, show_config(5, formation=NARROW), ideal=True)


def test_abort_lands_and_disarms_every_vehicle(aborted: Descent) -> None:
    last = aborted.coming_down.samples[-1]
    assert last.armed == (False,) * 5
    assert -last.true_m[:, 2] == pytest.approx(np.zeros(5), abs=0.05)
    assert {part.outcome for part in aborted.record.outcomes.values()} == {Outcome.DONE}
    assert len(aborted.record.outcomes) == 5


def test_abort_lands_vehicles_apart(aborted: Descent) -> None:
    assert nearest_m(aborted.coming_down.true_m[0, :, :2]) < 4.0  # it would not be so by itself
    assert nearest_m(places_m(aborted)) > 4.0 - 1.0  # as believed 4 m; the error of two estimates in truth


def test_abort_keeps_vehicles_separated(aborted: Descent) -> None:
    assert aborted.floor_violations == 0


def test_abort_brings_the_lowest_down_first(aborted: Descent) -> None:
    true_m = aborted.coming_down.true_m
    lowest = int(np.argmax(true_m[0, :, 2]))  # z is down
    landed_at = np.argmax(-true_m[:, :, 2] < 0.3, axis=0)
    assert landed_at[lowest] == landed_at.min()


async def abort_over_a_crate(show: VirtualShow) -> Descent:
    """Under the lowest lies something, so that it has to go a long way sideways."""
    started = await show.start()
    await show.wait(12.0)
    x_m, y_m, _ = show.true_m[int(np.argmax(show.true_m[:, 2]))].tolist()
    show.service.plan.add_obstacle(Obstacle("crate", x_m, y_m, 1.0, 1.0, 1.0))
    return await ordered(show, ShowAction.ABORT, started)


AWAY = {"x_m": 25.0, "y_m": 0.0}  # clear of all pads


@pytest.mark.soak
def test_abort_descends_in_clear_columns_away_from_obstacles() -> None:
    """No vehicle descends before those below are in their columns, nor onto an obstacle."""
    descent = fly(abort_over_a_crate, show_config(4, target=AWAY), ideal=True)
    start_m, goals_m = descent.coming_down.true_m[0], places_m(descent)
    lowest = int(np.argmax(start_m[:, 2]))
    far = [
        sample.true_m
        for sample in descent.coming_down.samples
        if np.hypot(*(sample.true_m[lowest, :2] - goals_m[lowest])) > 1.5
    ]
    assert len(far) > 20
    above = start_m[:, 2] < start_m[lowest, 2] - 3.0
    assert above.sum() == 2
    sunk_m = np.array(far)[:, above, 2] - start_m[above, 2]
    assert sunk_m.max() < 0.1
    crate_m = start_m[lowest, :2]
    assert np.hypot(*(goals_m - crate_m).T).min() > 3.0
    assert descent.floor_violations == 0


async def abort_on_the_way_up(show: VirtualShow) -> Descent:
    await show.standby()
    started = show.service.commands.command_show(ShowAction.START)
    await show.phase("d2", Phase.TAKEOFF)
    await show.wait(2.2)
    return await ordered(show, ShowAction.ABORT, started)


async def stop_on_the_way_up(show: VirtualShow) -> Descent:
    await show.standby()
    started = show.service.commands.command_show(ShowAction.START)
    await show.phase("d1", Phase.HOLD)
    return await ordered(show, ShowAction.STOP, started)


SLOW = show_config(4, operation={"takeoff_stagger_s": 3.0, "takeoff_height_m": 5.0})


@pytest.fixture(scope="module")
def aborted_early() -> Descent:
    return fly(abort_on_the_way_up, SLOW)


@pytest.fixture(scope="module")
def stopped_early() -> Descent:
    return fly(stop_on_the_way_up, SLOW)


@pytest.mark.keeps("stopped_early")
@pytest.mark.parametrize("how", ["aborted_early", "stopped_early"])
def test_stop_during_the_climb_lands_each_at_its_start(how: str, request: pytest.FixtureRequest) -> None:
    descent: Descent = request.getfixturevalue(how)
    off_m = np.hypot(*(places_m(descent) - descent.track.true_m[0, :, :2]).T)
    assert (-descent.track.true_m[:, 0, 2]).max() > 2.0  # one was up
    assert off_m.max() < 1.5
    assert descent.coming_down.samples[-1].armed == (False,) * 4
    assert descent.floor_violations == 0


@pytest.mark.keeps("stopped_early")
@pytest.mark.parametrize("how", ["aborted_early", "stopped_early"])
def test_waiting_vehicles_never_take_off_after_stop_or_abort(
    how: str, request: pytest.FixtureRequest
) -> None:
    descent: Descent = request.getfixturevalue(how)
    assert descent.arm_commands["d4"] == 0
    assert (-descent.track.true_m[:, 3, 2]).max() < 0.1
    assert descent.coming_down.phases("d4") == [Phase.STANDBY]


@pytest.mark.keeps("stopped_early")
@pytest.mark.parametrize("how", ["aborted_early", "stopped_early"])
def test_stop_or_abort_during_the_climb_reaches_all(how: str, request: pytest.FixtureRequest) -> None:
    descent: Descent = request.getfixturevalue(how)
    assert {part.outcome for part in descent.record.outcomes.values()} == {Outcome.DONE}
    assert set(descent.record.outcomes) == {"d1", "d2", "d3", "d4"}
    assert descent.started.outcomes["d4"].outcome is Outcome.FAILED
    assert "another command" in descent.started.outcomes["d4"].reason


async def abort_at_once(show: VirtualShow) -> Descent:
    await show.standby()
    started = show.service.commands.command_show(ShowAction.START)
    return await ordered(show, ShowAction.ABORT, started)  # before any errand has made its first step


@pytest.mark.soak
def test_abort_at_the_start_leaves_nothing_pending_or_armed() -> None:
    descent = fly(abort_at_once)
    assert descent.started.outcome is Outcome.FAILED
    assert descent.record.outcome is Outcome.DONE
    assert not any(any(sample.armed) for sample in descent.track.samples)


class Mixed(NamedTuple):
    track: FlownTrack
    stopped: CommandRecord
    landing_at_m: Array  # (2,)
    refusal: str


async def stop_while_some_come_down_already(show: VirtualShow) -> Mixed:
    """One touches down by its autopilot, one is half-way home by an order of its own; then all shall stop."""
    show.service.commands.command_vehicle("d1", VehicleAction.LAND)
    landing = show.service.commands.command_vehicle("d1", VehicleAction.LAND)
    await show.until(lambda: show.autopilot("d1").commander.mode.name == "LAND")
    await show.wait(1.2)
    landing_at_m = show.true_m[0, :2].copy()
    show.service.commands.command_vehicle("d2", VehicleAction.RETURN)
    await show.phase("d2", Phase.RETURN)
    await show.wait(1.0)
    with pytest.raises(Exception, match="touches it down") as refusal:
        show.service.commands.command_vehicle("d1", VehicleAction.RETURN)
    stopped = await show.show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED)
    assert show.service.command_log.get(landing.id).outcome is not Outcome.PENDING
    return Mixed(show.track, stopped, landing_at_m, str(refusal.value))


@pytest.mark.soak
def test_stop_returns_vehicles_and_lets_landing_ones_land() -> None:
    mixed = fly(stop_while_some_come_down_already, show_config(3), after=running)
    first, last = mixed.track.samples[0], mixed.track.samples[-1]
    assert {part.outcome for part in mixed.stopped.outcomes.values()} == {Outcome.DONE}
    assert last.armed == (False,) * 3
    assert np.hypot(*(last.true_m[0, :2] - mixed.landing_at_m)) < 1.5
    assert np.hypot(*(last.true_m - first.true_m)[1:, :2].T).max() < 1.5
