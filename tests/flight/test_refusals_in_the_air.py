"""While anything is airborne, a command that is refused names one that is accepted: checked by sending it."""

import re
from collections.abc import Awaitable, Callable, Iterator
from functools import partial
from typing import NamedTuple

import pytest

from gcs.model.errors import GcsError, RefusedError
from gcs.model.interrupted_flight import Offer
from gcs.model.lifecycle import Phase
from gcs.service import Outcome, ShowAction, VehicleAction, VehicleOutcome
from gcs.testing.copies import in_a_copy
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, fly, show_config
from tests.support.show_phases import aborting, arming, assembling, on_the_pads, paused, returning, running
from tests.support.stalls import stall

Command = Callable[[VirtualShow], object]

ALWAYS = (ShowAction.PAUSE, ShowAction.STOP, ShowAction.ABORT)
NAMED = re.compile(r"accepted instead: ([a-z-]+)(?: (d\d+))?$")
GROUP = sorted(set(VehicleAction) - {VehicleAction.CONFIRM_DOWN, VehicleAction.FIND})


def show_command(action: ShowAction) -> Command:
    return lambda show: show.service.commands.command_show(action)


def vehicle_command(name: str, action: VehicleAction) -> Command:
    return lambda show: show.service.commands.command_vehicle(name, action)


def commands() -> Iterator[tuple[str, Command]]:
    """Those that may be refused; none of PAUSE, STOP and ABORT, which are tried apart."""
    for led in (ShowAction.START, ShowAction.RESUME):
        yield led.value, show_command(led)
    yield (
        "start later",
        lambda show: show.service.commands.command_show(ShowAction.START, at_unix_time_s=show.unix() + 60.0),
    )
    for offer in Offer:
        yield offer.value, lambda show, offer=offer: show.service.recovery.settle(offer)  # type: ignore[misc]
    for name in ("d1", "d2", "d3"):
        for action in VehicleAction:
            yield f"{action} {name}", vehicle_command(name, action)
    for action in GROUP:
        yield (
            f"{action} --all",
            lambda show, action=action: show.service.commands.command_vehicles(action),  # type: ignore[misc]
        )
    yield "exclude d3", lambda show: show.service.preflight.exclude("d3", "a test")
    yield "include d3", lambda show: show.service.preflight.include("d3")
    yield "preflight", lambda show: show.service.preflight.report()
    yield "seek", lambda show: show.service.player.seek("a cue")


async def taking_off(show: VirtualShow) -> None:
    await arming(show)
    await show.until(lambda: show.view.counts.airborne > 0)


async def stalled(show: VirtualShow) -> None:
    await running(show)
    stall(show, 4.0)


async def piloted(show: VirtualShow) -> None:
    """All are pilots': nothing but a command that names them takes them back."""
    await running(show)
    for name in show.config.ids:
        show.befall(name, "pilot")
    await show.until(lambda: show.view.counts.controlled == 0)


async def one_on_its_pad(show: VirtualShow) -> None:
    """d1 alone flies; d2 has landed and d3 has fallen silent."""
    await running(show)
    await show.command("d2", VehicleAction.LAND)
    show.ports.silence("d3")
    await show.phase("d3", Phase.LOST)


PHASES: tuple[Callable[[VirtualShow], Awaitable[None]], ...] = (
    *(taking_off, assembling, running, paused, returning, aborting, stalled, piloted, one_on_its_pad),
)


def refusal_of(show: VirtualShow, text: str, command: Command) -> str:
    """Send a command, and what its refusal names. Returns: the refusal, empty where it was accepted."""
    try:
        command(show)
    except RefusedError as error:
        found = NAMED.search(str(error))
        if found is None:
            return f"{text}: names nothing that is accepted: {error}"
        action, name = found.groups()
        try:
            if name is None:
                show.service.commands.command_show(ShowAction(action))
            else:
                show.service.commands.command_vehicle(name, VehicleAction(action))
        except GcsError as worse:
            return f"{text}: {error}; but {worse!r}"
        return f"{text}: refused properly"
    except GcsError as error:
        return f"{text}: {error!r}"
    return ""


class Tried(NamedTuple):
    """What was answered in one phase of a show."""

    refused: list[str]  # see `refusal_of`
    unreached: dict[ShowAction, str]  # vehicles that the command neither reaches nor names with a reason


@pytest.fixture(scope="module", params=PHASES, ids=lambda into: into.__name__)
def tried(request: pytest.FixtureRequest) -> Tried:
    """One flight into each phase, in which every command is tried in a copy of the process."""

    async def story(show: VirtualShow) -> Tried:
        await request.param(show)
        await show.wait(0.5)
        assert show.view.counts.airborne > 0
        flying = {seen.id for seen in vehicles_of(show.view) if seen.phase is not Phase.STANDBY}

        def unreached(action: ShowAction) -> str:
            outcomes = show.service.commands.command_show(action).outcomes
            unexplained = [name for name, part in outcomes.items() if not explained(part)]
            return " ".join(sorted(flying - set(outcomes)) + unexplained)

        trials = (partial(refusal_of, show, text, command) for text, command in commands())
        refused = list(filter(None, map(in_a_copy, trials)))
        return Tried(refused, {action: in_a_copy(partial(unreached, action)) for action in ALWAYS})

    after = on_the_pads if request.param in {taking_off, assembling} else running
    return fly(story, show_config(3, operation=HOLDS_WHEN_LOST), after=after)


@pytest.mark.keeps("running")
def test_a_command_refused_in_the_air_names_one_that_is_accepted(tried: Tried) -> None:
    assert len(tried.refused) > 3
    assert [reported for reported in tried.refused if not reported.endswith("refused properly")] == []


@pytest.mark.keeps("running")
def test_pause_stop_and_abort_accepted_while_airborne(tried: Tried) -> None:
    assert tried.unreached == dict.fromkeys(ALWAYS, ""), "each that flies is reached, or named with a reason"


def explained(part: VehicleOutcome) -> bool:
    return part.outcome is not Outcome.NOT_INCLUDED or part.reason != ""
