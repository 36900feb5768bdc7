"""Random commands and events: what is shown stays true, and one stop brings all vehicles down."""

import random
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from gcs.flight.state.refusals import A_PERSON_FLIES
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import Outcome, ShowAction, VehicleAction
from gcs.sim.vehicle.px4 import Mode as PilotMode
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, fly, show_config
from tests.flight.test_refusals_in_the_air import commands, refusal_of
from tests.support.sessions import sessions
from tests.support.show_phases import running
from tests.support.stalls import stall

COUNT, STEPS = 3, 7
FLIES_M = 0.6
UNKNOWN = frozenset({Phase.LOST, Phase.OFFLINE, Phase.KILLED})
STARTABLE = frozenset({ShowPhase.IDLE, ShowPhase.COUNTDOWN, ShowPhase.PREFLIGHT, ShowPhase.LANDED})
KNOWN_WITHIN_S = 1.2
"""A heartbeat a second, and a tick."""

in_soak = partial(pytest.param, marks=pytest.mark.soak)

Step = tuple[str, Callable[[VirtualShow], object]]


def events(show: VirtualShow, chance: random.Random) -> Iterator[Step]:
    """What may befall the flight, beside commands."""
    name = chance.choice(show.config.ids)
    yield (
        "stall",
        lambda show: stall(show, chance.choice([0.8, 1.5, 3.0]), kept_share=chance.choice([1.0, 0.5])),
    )
    yield f"a pilot takes {name}", lambda show: show.befall(name, "pilot")
    yield f"a pilot holds {name}", lambda show: show.pilot(name, PilotMode.HOLD)
    yield f"a pilot lands {name}", lambda show: show.pilot(name, PilotMode.LAND)
    yield f"{name} is silent", lambda show: show.ports.silence(name)
    yield "all are received", lambda show: show.ports.restore(*show.config.ids)


def assert_true(show: VirtualShow, story: list[str]) -> None:
    """Nothing that flies is shown on the ground, and no start is offered below it."""
    heights_m = -show.true_m[:, 2]
    for seen, height_m in zip(vehicles_of(show.view), heights_m, strict=True):
        if height_m > FLIES_M and seen.phase not in UNKNOWN and not show.ports.is_silent(seen.id):
            assert seen.phase is not Phase.STANDBY, (seen.id, story)
            assert show.view.show not in STARTABLE, (show.view.show, show.view.reason, story)
    assert sum(vars_of(show)) == COUNT, story


def vars_of(show: VirtualShow) -> tuple[int, ...]:
    counts = show.view.counts
    return counts.controlled, counts.uncontrolled, counts.unknown, counts.on_ground, counts.offline


async def play(show: VirtualShow, chance: random.Random, story: list[str]) -> None:
    """Random commands and events; a command that is refused in the air names one that is accepted."""
    issued: list[Step] = [
        *commands(),
        *((action.value, partial(_command, action)) for action in (ShowAction.PAUSE, ShowAction.STOP)),
    ]
    for _ in range(STEPS):
        step = chance.choice([*events(show, chance)]) if chance.random() < 0.5 else chance.choice(issued)
        text, act = step
        story.append(f"{show.now_s:.1f} s {show.view.show}: {text}")
        if step in issued:
            in_the_air = show.view.counts.airborne > 0
            refused = refusal_of(show, text, act)  # which sends what the refusal names
            if refused and in_the_air:
                assert refused.endswith("refused properly"), (refused, story)
        else:
            act(show)
        await show.wait(chance.uniform(0.05, 1.0))
        await show.wait(KNOWN_WITHIN_S)
        assert_true(show, story)


def _command(action: ShowAction, show: VirtualShow) -> object:
    return show.service.commands.command_show(action)


async def all_come_down(show: VirtualShow, story: list[str]) -> None:
    """Pilots agree, links are mended: a command that names the pilots' vehicles, and one stop."""
    show.ports.restore(*show.config.ids)
    await show.wait(8.0)
    taken = [seen.id for seen in vehicles_of(show.view) if seen.phase is Phase.PILOT]
    for name in taken:
        if show.vehicle(name).mode in A_PERSON_FLIES:
            show.befall(name, "none")
    if taken:
        show.service.commands.command_vehicles(VehicleAction.TAKE_CONTROL, taken)
    if show.view.counts.airborne:
        record = await show.settled(show.service.commands.command_show(ShowAction.STOP), 200.0)
        reported = {name: (part.outcome, part.reason) for name, part in record.outcomes.items()}
        assert {outcome for outcome, _ in reported.values()} <= {Outcome.DONE}, (reported, story)
    await show.until(lambda: show.view.show in {ShowPhase.LANDED, ShowPhase.IDLE}, 60.0)
    assert (-show.true_m[:, 2]).max() < FLIES_M, story
    assert show.floor_violations() == 0, story


@pytest.mark.parametrize("seed", [0, *map(in_soak, (1, 2, 3, 4, 5))])
def test_random_commands_keep_state_true_and_stop_lands_all(seed: int) -> None:
    async def flight(show: VirtualShow) -> None:
        story: list[str] = []
        await play(show, random.Random(seed), story)
        await all_come_down(show, story)

    fly(flight, show_config(COUNT, operation=HOLDS_WHEN_LOST), after=running)


@pytest.mark.soak
@pytest.mark.parametrize("seed", [0, in_soak(1)])
def test_random_commands_after_a_restart(tmp_path: Path, seed: int) -> None:
    chance, story = random.Random(100 + seed), list[str]()

    async def first(show: VirtualShow) -> None:
        await running(show)
        await play(show, chance, story)
        story.append("restart")

    async def second(show: VirtualShow) -> None:
        await show.wait(2.5)
        await play(show, chance, story)
        await all_come_down(show, story)

    plan = show_config(COUNT, operation=HOLDS_WHEN_LOST)
    sessions(tmp_path, (plan, first), (plan, second))
