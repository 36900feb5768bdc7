"""Commands that follow one another closely: the newest one counts for every vehicle that it means."""

from collections.abc import Callable
from pathlib import Path

import pytest

from gcs.model.interrupted_flight import Offer
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Formation, Obstacle
from gcs.service import CommandRecord, Outcome, ShowAction, VehicleAction
from gcs.sim.vehicle.px4 import Mode as PilotMode
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, fly, refused, show_config
from tests.flight.test_show_interrupted import COMMANDS
from tests.support.sessions import ALL, BOX, after_interruption, found, four
from tests.support.show_phases import running
from tests.support.stalls import stall

pytestmark = pytest.mark.soak

NEW = Obstacle("new", 70.0, 60.0, 1.0, 1.0, 5.0)


@pytest.mark.keeps("0.0-stop")
@pytest.mark.parametrize(
    ("after_s", "action"),
    [
        (0.0, ShowAction.STOP),
        pytest.param(0.3, ShowAction.STOP, marks=pytest.mark.soak),
        (0.1, ShowAction.ABORT),
    ],
)
def test_stop_after_take_control_brings_that_vehicle_down(after_s: float, action: ShowAction) -> None:
    async def story(show: VirtualShow) -> None:
        show.pilot("d1", PilotMode.LAND)
        await show.phase("d1", Phase.PILOT)
        show.service.commands.command_vehicle("d1", VehicleAction.TAKE_CONTROL)
        if after_s:
            await show.wait(after_s)
        record = await show.settled(show.service.commands.command_show(action), 150.0)
        assert {part.outcome for part in record.outcomes.values()} == {Outcome.DONE}, record.outcomes
        assert {seen.phase for seen in vehicles_of(show.view)} == {Phase.STANDBY}
        await show.reach(ShowPhase.LANDED)

    fly(story, show_config(3, operation=HOLDS_WHEN_LOST), after=running)


@pytest.mark.soak
@pytest.mark.parametrize("after_s", [0.0, 0.2, 1.0])
def test_pause_during_recovery_ends_paused_with_all_vehicles(after_s: float) -> None:
    async def story(show: VirtualShow) -> None:
        await show.wait(1.0)
        stall(show, 4.0)
        await show.wait(1.0)
        take_over = show.service.recovery.settle(Offer.TAKE_OVER)
        if after_s:
            await show.wait(after_s)
        pause = await show.settled(show.service.commands.command_show(ShowAction.PAUSE))
        take_over = await show.settled(take_over)
        assert {part.outcome for part in take_over.outcomes.values()} == {Outcome.DONE}
        assert Outcome.FAILED not in {part.outcome for part in pause.outcomes.values()}
        assert show.view.show is ShowPhase.PAUSED
        assert {seen.phase for seen in vehicles_of(show.view)} == {Phase.FORMATION}

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST), after=running)


@pytest.mark.soak
def test_a_show_is_resumed_only_with_a_vehicle_in_formation() -> None:
    async def story(show: VirtualShow) -> None:
        stall(show, 4.0)
        await show.wait(1.0)
        await show.settled(show.service.commands.command_show(ShowAction.PAUSE))
        assert {seen.phase for seen in vehicles_of(show.view)} == {Phase.HOLD}
        turned_down = await refused(show, lambda: show.service.commands.command_show(ShowAction.RESUME))
        assert "no vehicle is in formation: use take-over" in turned_down.text
        assert turned_down.text.endswith("accepted instead: stop")
        await show.settled(show.service.recovery.settle(Offer.TAKE_OVER))
        await show.show(ShowAction.RESUME)
        await show.reach(ShowPhase.RUNNING)

    fly(story, show_config(3, operation=HOLDS_WHEN_LOST), after=running)


@pytest.mark.soak
def test_plan_set_before_recovery_stands_beside_the_recorded(
    tmp_path: Path,
) -> None:
    changed = Formation(radius_m=8.0, height_m=16.0)

    async def go_on(show: VirtualShow) -> None:
        await found(show)
        show.service.plan.add_obstacle(NEW)
        show.service.plan.set_formation(changed)
        await show.settled(show.service.recovery.settle(Offer.TAKE_OVER))
        assert {box.id for box in show.view.plan.obstacles} == {"box", "new"}
        assert show.view.plan.formation == changed

    async def move(show: VirtualShow) -> None:
        await found(show)
        show.service.plan.add_obstacle(Obstacle("box", 80.0, 60.0, 1.0, 1.0, 5.0))
        await show.settled(show.service.recovery.settle(Offer.TAKE_OVER))
        ((box, at_m),) = [(one.id, (one.x_m, one.y_m)) for one in show.view.plan.obstacles]
        assert (box, at_m) == ("box", (80.0, 60.0)), "the newest command counts"

    after_interruption(tmp_path / "added", (four(), go_on))
    after_interruption(tmp_path / "moved", (four(), move))


@pytest.mark.soak
@pytest.mark.parametrize("command", ["bring-home", "stop", "abort"])
def test_recorded_obstacles_stand_on_the_way_down(tmp_path: Path, command: str) -> None:
    async def go_on(show: VirtualShow) -> None:
        await found(show)
        show.service.plan.add_obstacle(NEW)
        commanded: Callable[[VirtualShow], CommandRecord] = COMMANDS[command]
        record = commanded(show)
        assert set(record.outcomes) == set(ALL)
        await show.wait(0.2)
        assert {box.id for box in show.view.plan.obstacles} == {BOX.id, NEW.id}

    after_interruption(tmp_path, (four(), go_on))
