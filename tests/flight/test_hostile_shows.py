"""A law that does what none may, in a whole show of twenty: from the ground, over that moment, home."""

from pathlib import Path

import numpy as np
import pytest

from gcs.formation.laws import registry
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array
from gcs.service import ShowAction
from gcs.service.alarms import AlarmCause
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import VirtualShow, fly, show_config
from tests.support.hostile_laws import IN_WHOLE_SHOWS, REASONS

pytestmark = pytest.mark.soak

SUPPORT = Path(__file__).parents[1] / "support"
COUNT, TICK_S, HOLDS_WITHIN_S, STOPS_S, STANDS_M_S, HELD_M = 20, 0.05, 0.5, 1.5, 0.4, 0.5
WELL_S = 15.0
"""All have joined by then, and are still on their way."""


@pytest.fixture(autouse=True)
def _beside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_beside", [])
    registry.allow_code(SUPPORT)


def speeds_m_s(show: VirtualShow, from_s: float, to_s: float) -> Array:
    """(k, n) true speeds, tick by tick."""
    track = show.track.between(from_s, to_s)
    speed_m_s: Array = np.linalg.norm(np.diff(track.true_m, axis=0), axis=2) / np.diff(track.time_s)[:, None]
    return speed_m_s


@pytest.mark.keeps("SleepsASecond", "HundredToOnePoint")
@pytest.mark.parametrize("law", IN_WHOLE_SHOWS)
def test_a_show_of_twenty_holds_and_comes_home(law: str) -> None:
    name = f"hostile_laws:{law}"

    async def story(show: VirtualShow) -> None:
        await show.standby()
        show.service.commands.command_show(ShowAction.START)
        await show.until(lambda: any(seen.phase is Phase.FORMATION for seen in vehicles_of(show.view)))
        hostile_s = show.now_s + WELL_S
        await show.until(lambda: show.view.show is ShowPhase.PAUSED, WELL_S + 5.0)
        assert -2.0 * TICK_S <= show.now_s - hostile_s <= HOLDS_WITHIN_S
        before = {
            seen.phase for seen in vehicles_of(show.track.between(0.0, hostile_s - 0.5).samples[-1].view)
        }
        assert before == {Phase.FORMATION}, "all are in formation when the law turns hostile"
        await show.wait(HOLDS_WITHIN_S)
        alarm = next(each for each in show.view.alarms if each.cause is AlarmCause.LAW_FAILED)
        assert alarm.text.startswith(f"Law {name} failed: {REASONS[law]}")
        assert alarm.advice.startswith("Let all return home")
        await show.wait(STOPS_S)
        held_m, held_s = show.true_m, show.now_s
        await show.wait(20.0)
        assert speeds_m_s(show, held_s, show.now_s).max() < STANDS_M_S
        assert np.linalg.norm(show.true_m - held_m, axis=1).max() < HELD_M
        show.service.commands.command_show(ShowAction.RESUME)
        await show.wait(1.0)
        assert show.view.show is ShowPhase.PAUSED
        stopped = await show.show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED, 120.0)
        assert stopped.outcome.value == "done"
        assert show.floor_violations() == 0

    config = show_config(
        COUNT,
        formation={"law": name, "radius_m": 14.0, "height_m": 20.0},
        operation={"takeoff_stagger_s": 0.2},
        control={"law": {"laws": {name: {"well_ticks": round(WELL_S / TICK_S)}}}},
    )
    fly(story, config, ideal=True, grid_columns=5)
