"""The accident of 2024, replayed: each link of its chain is broken by itself, in words of its own.

A launch file was not sent while the ground station was green, the show was turned by 7 degrees, the countdown
ran on, and the pause could not be used (docs/how-to/go.md). Each point is tried without the others' help.
"""

import re
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from gcs.api.auth.authorization import needed
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import BeginState, Outcome, ShowAction
from gcs.service.access import RIGHTS, Right, Role
from gcs.service.alarms import AlarmCause, AlarmSeverity
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, refused
from tests.support.tokens_flown import by_two, token
from tests.support.written_show import TEXT, check, config, fly, keep, on_pads, select

TURNED_DEG: Final = 7.0
AT_REST_M_S: Final = 0.3
STANDS_WITHIN_S: Final = 6.0


def armed(show: VirtualShow) -> list[bool]:
    return [show.fleet.autopilots[row].commander.armed for row in range(len(show.config.ids))]


async def refusal(show: VirtualShow, show_hash: str | None) -> str:
    """The words of a refused start, after which no motor runs."""
    call = await refused(
        show, lambda: show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
    )
    assert call.kind is RefusedError
    assert armed(show) == [False] * 4
    return call.text


@pytest.mark.soak
def test_point_1_without_the_file_of_the_show_nothing_starts(tmp_path: Path) -> None:
    """Not there; another one than was agreed; changed since; and a vehicle without the parameters sent."""

    async def story(show: VirtualShow) -> None:
        await show.standby()
        agreed = check(show)
        assert "no show is selected: select one" in await refusal(show, agreed)
        show.service.player.select("small", agreed)
        other = "f" * 64
        assert f"is selected with the hash {agreed}, not '{other}'" in await refusal(show, other)
        assert "start with its hash" in await refusal(show, None)
        keep(show, TEXT + "\n# a word\n")
        assert "has changed" in await refusal(show, agreed)
        keep(show)
        select(show)
        await show.link.set_parameter("d2", "COM_OF_LOSS_T", 5.0)
        await show.wait(1.0)
        assert "d2: COM_OF_LOSS_T is 5, 0.5 to 1 s is needed" in await refusal(show, agreed)

    fly(story, config(tmp_path, operation=HOLDS_WHEN_LOST))


@pytest.mark.soak
def test_point_2_a_show_turned_by_7_degrees_is_refused(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        text = await refusal(show, select(show))
        says = re.search(r"start pattern is turned by (\S+) deg .*, at most (\S+) deg", text)
        assert says is not None, text
        turned_deg, most_deg = map(float, says.groups())
        assert turned_deg == pytest.approx(TURNED_DEG, abs=2.0)  # as the receivers report the places
        assert turned_deg > most_deg

    fly(story, config(tmp_path), **on_pads(turned_deg=TURNED_DEG))


def test_point_3_no_countdown_is_green_while_any_is_not_ready(tmp_path: Path) -> None:
    """To a clock time, confirmed by two: red within seconds, and at its time no motor starts."""

    async def story(show: VirtualShow) -> None:
        await show.standby()
        show_hash = select(show)
        with token("alice"):
            record = show.service.commands.command_show(
                ShowAction.START, show_hash=show_hash, at_unix_time_s=show.unix() + 30.0
            )
        await show.wait(0.1)
        view = show.view.features.go
        assert view is not None
        assert view.proposal is not None
        with token("bob"):
            show.service.commands.confirm_start(view.proposal.hash)
        await show.reach(ShowPhase.COUNTDOWN)
        await show.wait(5.0)
        assert [each for each in show.view.alarms if each.severity is not AlarmSeverity.INFORMATION] == []
        show.befall("d3", "battery", remaining=0.15)
        await show.wait(5.0)
        assert show.view.show is ShowPhase.COUNTDOWN
        low = "d3: battery at 15%, at least 33% is needed for this show"
        assert show.view.reason.startswith(f"NOT READY: {low}")
        (alarm,) = (each for each in show.view.alarms if each.cause is AlarmCause.START_NOT_READY)
        assert alarm.severity is AlarmSeverity.WARNING
        assert low in alarm.text
        await show.reach(ShowPhase.IDLE)
        assert show.view.reason.startswith(f"did not start: {low}")
        assert show.service.command_log.get(record.id).outcome is Outcome.FAILED
        await show.wait(5.0)
        assert armed(show) == [False] * 4
        assert not [
            each for each in show.view.alarms if each.cause is AlarmCause.START_NOT_READY and each.lasts
        ]

    fly(story, config(tmp_path, **by_two()))


@pytest.mark.soak
def test_point_3_mended_in_time_the_countdown_is_good_again(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        show_hash = select(show)
        show.service.commands.command_show(
            ShowAction.START, show_hash=show_hash, at_unix_time_s=show.unix() + 25.0
        )
        show.ports.silence("d3")
        await show.until(lambda: show.view.reason.startswith("NOT READY: d3: offline"), 8.0)
        show.ports.restore("d3")
        await show.until(lambda: show.view.reason.startswith("4 vehicles take off in "), 8.0)
        assert not [
            each for each in show.view.alarms if each.cause is AlarmCause.START_NOT_READY and each.lasts
        ]
        await show.reach(ShowPhase.ARMING)
        await show.until(lambda: all(armed(show)), 30.0)

    fly(story, config(tmp_path))


@pytest.mark.soak
def test_point_3_a_shows_time_passes_while_it_stands(tmp_path: Path) -> None:
    """The time of its first motion: on the ground, and not started, it is never ready, and nothing moves."""

    async def story(show: VirtualShow) -> None:
        await show.standby()
        select(show)
        show.service.player.begin_at(show.unix() + 10.0)
        states = []
        for _ in range(4):
            await show.wait(4.0)
            begin = show.view.selected.begin if show.view.selected else None
            states.append(None if begin is None else begin.state)
        assert states == [BeginState.ARMED, BeginState.ARMED, BeginState.LATE, BeginState.LATE]
        assert show.view.show is ShowPhase.IDLE
        assert armed(show) == [False] * 4

    fly(story, config(tmp_path))


async def stands(show: VirtualShow) -> None:
    """Pause by one command of any role that may stop, then watch all vehicles come to rest."""
    with token("guard"):
        record = show.service.commands.command_show(ShowAction.PAUSE)
    assert record.by == "guard"
    assert show.view.show is not ShowPhase.IDLE
    await show.until(
        lambda: (
            show.view.show is ShowPhase.PAUSED
            and all(
                seen.phase in {Phase.HOLD, Phase.FORMATION, Phase.STANDBY}
                and np.linalg.norm(seen.velocity_m_s or (9.0,)) < AT_REST_M_S
                for seen in vehicles_of(show.view)
            )
        ),
        STANDS_WITHIN_S + 12.0,  # one that takes off ends its climb first
    )
    begun_m = show.true_m.copy()
    await show.wait(5.0)
    assert np.linalg.norm(show.true_m - begun_m, axis=1).max() < 1.5
    assert show.view.show is ShowPhase.PAUSED


@pytest.mark.soak
def test_point_4_one_pause_stops_the_show_at_any_time(tmp_path: Path) -> None:
    """While it takes off, assembles, moves and comes home: one command, and all stand, and stay apart."""
    assert needed("POST", "/api/v1/show/pause") is Right.EMERGENCY
    assert all(Right.EMERGENCY in RIGHTS[role] for role in Role if role is not Role.WATCH)

    async def story(show: VirtualShow) -> None:
        await show.standby()
        show_hash = select(show)
        with token("alice"):
            show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.wait(0.1)
        view = show.view.features.go
        assert view is not None
        assert view.proposal is not None
        with token("bob"):
            show.service.commands.confirm_start(view.proposal.hash)
        await show.reach(ShowPhase.ASSEMBLING)
        await stands(show)
        show.service.commands.command_show(ShowAction.RESUME)
        await show.reach(ShowPhase.RUNNING)
        await show.until(lambda: show.view.selected is not None and show.view.selected.cue == "walk")
        await show.wait(3.0)
        await stands(show)
        assert show.view.selected is not None
        clock_s = show.view.selected.clock_s
        await show.wait(5.0)
        assert show.view.selected is not None
        assert show.view.selected.clock_s == clock_s
        with token("guard"):
            show.service.commands.command_show(ShowAction.STOP)
        await show.reach(ShowPhase.RETURNING)
        await show.wait(2.0)
        await stands(show)
        assert show.floor_violations() == 0

    fly(story, config(tmp_path, **by_two()))


@pytest.mark.soak
@pytest.mark.parametrize("action", [ShowAction.STOP, ShowAction.ABORT])
def test_point_4_a_pause_is_not_the_only_way_down(tmp_path: Path, action: ShowAction) -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        show.service.commands.command_show(ShowAction.START, show_hash=select(show))
        await show.until(lambda: any(seen.phase is Phase.FORMATION for seen in vehicles_of(show.view)))
        with token("guard"):
            show.service.commands.command_show(action)
        await show.reach(ShowPhase.RETURNING if action is ShowAction.STOP else ShowPhase.ABORTING)
        await show.reach(ShowPhase.LANDED)
        assert show.floor_violations() == 0

    fly(story, config(tmp_path))
