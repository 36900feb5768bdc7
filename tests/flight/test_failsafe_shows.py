"""What the whole show suffers: it stands still, or comes home, and says why."""

from pathlib import Path

import numpy as np
import pytest

from gcs.failsafe.policy import Cause
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Target
from gcs.service import Outcome, ShowAction
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, fly, show_config
from tests.support import written_show
from tests.support.failsafe_flights import by_itself, carried_out, failsafe, off_pad_m, off_sphere_m, reacts
from tests.support.show_phases import running

pytestmark = pytest.mark.soak

FOUR = show_config(4, operation=HOLDS_WHEN_LOST)
STORM_M_S = 12.0
"""More than the fake vehicles can fly against: they lean as far as they may, and drift with 2 m/s."""


def storm(show: VirtualShow, north_m_s: float) -> None:
    """Everywhere."""
    for name in show.config.ids:
        show.befall(name, "wind", north_m_s=north_m_s)


async def home(show: VirtualShow) -> None:
    """Every vehicle is on its own pad, and none was below the floor."""
    await show.reach(ShowPhase.LANDED, 150.0)
    assert max(off_pad_m(show, name) for name in show.config.ids) < 1.5
    assert show.floor_violations() == 0


@pytest.mark.soak
def test_strong_wind_pauses_the_show_until_an_operator_resumes() -> None:
    async def story(show: VirtualShow) -> None:
        storm(show, STORM_M_S)
        reported = await reacts(show, Cause.WIND)
        assert reported.action == "pause"
        assert show.view.show is ShowPhase.PAUSED
        assert "too much wind" in show.view.reason
        storm(show, 0.0)
        await show.until(lambda: failsafe(show, Cause.WIND) is None)
        await show.wait(10.0)
        assert show.view.show is ShowPhase.PAUSED, "no vehicle flies on by itself"
        assert [command.action for command in by_itself(show)[1:]] == ["pause"]
        show.service.commands.command_show(ShowAction.RESUME)
        await show.reach(ShowPhase.RUNNING)
        await show.wait(2.0)
        assert off_sphere_m(show, *show.config.ids) < 1.5
        assert show.floor_violations() == 0

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_too_much_wind_for_a_pause_brings_the_show_home() -> None:
    async def story(show: VirtualShow) -> None:
        storm(show, STORM_M_S)
        paused_s = await show.reach(ShowPhase.PAUSED)
        assert paused_s > 5.0, "a gust is none"
        returning_s = await show.reach(ShowPhase.RETURNING)
        assert 9.0 < returning_s < 12.0
        assert "did not help" in show.view.reason
        reported = await reacts(show, Cause.WIND)
        assert reported.action == "return"
        storm(show, 4.0)
        command = await carried_out(show, reported)
        assert (command.action, command.by, command.outcome) == ("stop", "service", Outcome.DONE)
        await home(show)

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_flyable_wind_triggers_nothing() -> None:
    async def story(show: VirtualShow) -> None:
        storm(show, 6.0)
        await show.start()
        await show.wait(30.0)
        assert show.view.failsafes == ()
        assert show.view.show is ShowPhase.RUNNING
        assert show.floor_violations() == 0

    fly(story, show_config(4, orbit={"radius_m": 12.0, "speed_m_s": 2.0}))


@pytest.mark.soak
def test_too_many_vehicles_lost_brings_the_show_home() -> None:
    async def story(show: VirtualShow) -> None:
        await show.start()
        show.ports.silence("d2")
        await show.phase("d2", Phase.LOST)
        await show.wait(3.0)
        assert show.view.show is ShowPhase.RUNNING, "one of six is not too many"
        show.ports.silence("d5")
        await show.reach(ShowPhase.RETURNING)
        reported = await reacts(show, Cause.VEHICLES_LOST)
        assert (reported.action, reported.vehicles) == ("return", ("d2", "d5"))
        assert "2 of 6" in reported.reason
        command = await carried_out(show, reported)
        assert (command.action, command.by) == ("stop", "service")
        assert {command.outcomes[name].outcome for name in ("d2", "d5")} == {Outcome.NOT_INCLUDED}
        assert {command.outcomes[name].outcome for name in ("d1", "d3", "d4", "d6")} == {Outcome.DONE}
        hang_m = show.true_m[[1, 4]]
        for row in (0, 2, 3, 5):
            pad_m = show.track.samples[0].true_m[row]
            below = np.linalg.norm((hang_m - pad_m)[:, :2], axis=1).min() < 4.0
            assert off_pad_m(show, f"d{row + 1}") < (6.0 if below else 1.5), "a lost one hangs there"
            assert np.linalg.norm((hang_m - show.true_m[row])[:, :2], axis=1).min() > 2.0
        assert show.floor_violations() == 0

    fly(story, show_config(6, operation=HOLDS_WHEN_LOST, formation={"radius_m": 7.0}))


@pytest.mark.soak
def test_losses_of_an_earlier_show_do_not_count() -> None:
    async def story(show: VirtualShow) -> None:
        await show.start()
        show.ports.silence("d2")
        await show.reach(ShowPhase.RETURNING)
        assert show.view.reason.startswith("too many vehicles lost")
        await show.reach(ShowPhase.LANDED, 120.0)
        await show.wait(7.0)
        assert show.view.failsafes == (), "it is over; an alarm names the lost vehicles"
        show.service.commands.command_show(ShowAction.START, ("d1", "d3"))
        await show.reach(ShowPhase.RUNNING)
        await show.wait(5.0)
        assert show.view.show is ShowPhase.RUNNING
        assert show.view.failsafes == ()
        show.ports.silence("d3")
        await show.reach(ShowPhase.RETURNING)

    failsafes = {"vehicles_lost": {"count": 1, "share": 0.3}}
    fly(story, show_config(3, operation=HOLDS_WHEN_LOST, failsafes=failsafes))


@pytest.mark.soak
def test_stale_target_is_held_until_reported_again(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        show_hash = written_show.select(show)
        show.service.player.seek("guest")
        await show.standby()
        show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.reach(ShowPhase.RUNNING)
        show.service.plan.set_target(Target(11.0, 1.0, 0.5, 0.0))
        reported_s = show.now_s
        reported = await reacts(show, Cause.TARGET_STALE, 8.0)
        assert (reported.action, reported.vehicles) == ("hold-target", ())
        assert 4.9 < show.now_s - reported_s < 5.5
        await show.wait(0.1)
        command = await carried_out(show, reported)
        assert (command.action, command.by) == ("hold-target", "service")
        assert show.view.plan.target.speed_m_s == 0.0
        stands_m = show.view.target_m
        assert np.allclose(stands_m, (13.5, 1.0), atol=0.2)
        await show.wait(2.0)
        assert show.view.target_m == stands_m
        show.service.plan.set_target(Target(*stands_m, -0.5, 0.0))
        await show.until(lambda: failsafe(show, Cause.TARGET_STALE) is None, 8.0)
        assert show.view.target_m[0] < stands_m[0]
        assert show.track.between(reported_s).hardest_change_m_s() < 1.5, "without a jump"
        assert show.floor_violations() == 0

    written_show.fly(story, written_show.config(tmp_path, failsafes={"clear_s": 1.0}))


@pytest.mark.soak
def test_target_reported_once_without_a_show_goes_on() -> None:
    async def story(show: VirtualShow) -> None:
        show.service.plan.set_target(Target(3.0, 1.0, 0.3, 0.0))
        await show.wait(10.0)  # in a written show a target counts as stale after 5 s
        assert show.view.failsafes == ()
        assert show.view.plan.target.speed_m_s == 0.3

    fly(story, FOUR, after=running)


def test_service_late_pauses_the_show_then_brings_it_home() -> None:
    async def story(show: VirtualShow) -> None:
        show.link.takes_s = 0.12
        paused_s = await show.reach(ShowPhase.PAUSED)
        assert 3.0 < paused_s < 6.0
        reported = await reacts(show, Cause.SERVICE_LATE)
        assert reported.action == "pause"
        assert "service late" in show.view.reason
        await show.reach(ShowPhase.RETURNING, 12.0)
        reported = await reacts(show, Cause.SERVICE_LATE)
        assert reported.action == "return"
        command = await carried_out(show, reported)
        assert (command.action, command.by, command.outcome) == ("stop", "service", Outcome.DONE)
        await home(show)

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_service_late_once_changes_nothing() -> None:
    async def story(show: VirtualShow) -> None:
        show.link.takes_s = 2.0
        await show.wait(0.1)
        show.link.takes_s = 0.0
        await show.wait(8.0)
        assert Cause.SERVICE_LATE.value not in {each.cause for each in show.view.failsafes}
        assert ShowPhase.PAUSED not in show.track.show_phases()

    fly(story, FOUR, after=running)
