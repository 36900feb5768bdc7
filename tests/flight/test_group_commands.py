"""One command for a selection of vehicles, or for all that it can apply to."""

import pytest

from gcs.model.errors import InvalidError, RefusedError, UnknownError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import Outcome, VehicleAction
from gcs.sim.vehicle.px4 import Mode as PilotMode
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, fly, refused, show_config
from tests.support.show_phases import running

pytestmark = pytest.mark.soak


def test_group_command_names_vehicles_it_does_not_reach() -> None:
    async def story(show: VirtualShow) -> None:
        command = show.service.commands.command_vehicles
        await show.settled(command(VehicleAction.HOLD, ["d1", "d2"]))
        assert [show.vehicle(name).phase for name in show.config.ids] == [
            *(Phase.HOLD, Phase.HOLD),
            *(Phase.FORMATION, Phase.FORMATION),
        ]
        record = await show.settled(command(VehicleAction.JOIN, ["d1", "d2", "d3"]))
        assert [record.outcomes[name].outcome for name in ("d1", "d2", "d3")] == [
            *(Outcome.DONE, Outcome.DONE),
            Outcome.NOT_INCLUDED,
        ]
        assert "while formation" in record.outcomes["d3"].reason
        await show.settled(command(VehicleAction.RETURN, ["d1", "d2"]))
        assert (await refused(show, lambda: command(VehicleAction.JOIN, ["d1"]))).kind is RefusedError
        for names, kind in ((["d9"], UnknownError), (None, InvalidError)):
            with pytest.raises(kind):
                command(VehicleAction.CONFIRM_DOWN if names is None else VehicleAction.HOLD, names)
        await show.settled(command(VehicleAction.LAND))
        await show.reach(ShowPhase.LANDED)
        assert show.floor_violations() == 0

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST), after=running)


@pytest.mark.soak
def test_take_control_of_all_skips_pilots_unless_named() -> None:
    """Control of all vehicles leaves those under pilot control, unless they are named."""

    async def story(show: VirtualShow) -> None:
        show.befall("d1", "pilot")
        show.pilot("d2", PilotMode.HOLD)
        await show.phase("d1", Phase.PILOT)
        await show.phase("d2", Phase.PILOT)
        assert (show.view.counts.controlled, show.view.counts.uncontrolled) == (1, 2)
        assert show.view.show is ShowPhase.RUNNING, "it flies on with those under control"
        record = await show.settled(show.service.commands.command_vehicles(VehicleAction.TAKE_CONTROL))
        assert record.outcomes["d2"].outcome is Outcome.DONE
        assert "take-control d1 names it" in record.outcomes["d1"].reason
        assert [show.vehicle(name).phase for name in ("d1", "d2")] == [Phase.PILOT, Phase.HOLD]
        await show.settled(show.service.commands.command_vehicles(VehicleAction.TAKE_CONTROL, ["d1"]))
        assert show.vehicle("d1").phase is Phase.HOLD

    fly(story, show_config(3, operation=HOLDS_WHEN_LOST), after=running)
