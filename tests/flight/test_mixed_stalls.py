"""The station of a fleet with two autopilots stalls at random moments of every phase: the floor holds.

Without setpoints PX4 repeats its last one until COM_OF_LOSS_T and then holds; ArduCopter flies on with its
last one and then stops in GUIDED. Vehicles have PX4's noise, and report as much. True positions are judged.
"""

import random
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from gcs.config.schema import Config
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Formation, Orbit, Target
from gcs.service import Outcome, ShowAction
from gcs.testing.virtual_show import HEIGHT_M, TARGET_M, VirtualShow, fly, show_config
from tests.support.show_phases import aborting, arming, assembling, on_the_pads, paused, returning, running
from tests.support.stalls import floor_violations, stall

Into = Callable[[VirtualShow], Awaitable[None]]

COUNT = 6
RADIUS_M = 6.0
"""The smallest that the accuracy of these positions allows is 5.5 m."""

SPEED_M_S = 3.0
LOSS_S = 3.0
"""The recorded ArduCopter has no GUID_TIMEOUT: it flies on for so long, and so do the others."""

FLEET: dict[str, Any] = {"noise_scale": 1.0, "spacing_m": 5.5}
STALLS_S = (1.0, 2.0, 4.0, 10.0)
NEAR_PADS_M = 3.0


def config(height_m: float = HEIGHT_M) -> Config:
    """PX4 and ArduCopter in turn; all hold when they are lost."""
    operation = {
        "setpoint_loss_s": LOSS_S,
        "setpoint_loss_action": "hold",
        "require_safe_setpoint_loss": True,
    }
    raw = show_config(
        COUNT, operation=operation, formation={"radius_m": RADIUS_M, "height_m": height_m}
    ).model_dump()
    raw["links"][0]["transport"] = "native"
    vehicles = [each.model_dump() for each in show_config(COUNT).fleet]
    kinds = ("px4", "ardupilot")
    raw["links"][0]["vehicles"] = [one | {"autopilot": kinds[row % 2]} for row, one in enumerate(vehicles)]
    return Config.model_validate(raw)


async def following(show: VirtualShow) -> None:
    """The target moves at 3 m/s, straight on."""
    await running(show)
    show.service.plan.set_target(Target(*TARGET_M, SPEED_M_S, 0.0))


async def turning(show: VirtualShow) -> None:
    """The target reverses."""
    await following(show)
    await show.wait(4.0)
    show.service.plan.set_target(Target(*TARGET_M, -SPEED_M_S, 0.0))


async def orbiting(show: VirtualShow) -> None:
    await running(show)
    show.service.plan.set_orbit(Orbit(radius_m=9.0, speed_m_s=SPEED_M_S))


async def spinning(show: VirtualShow) -> None:
    """Each vehicle flies at a velocity of its own."""
    await running(show)
    show.service.plan.set_formation(Formation(RADIUS_M, HEIGHT_M, spin_rad_s=0.4))


async def stopped(show: VirtualShow) -> None:
    """On the way home, out of the orbit."""
    await orbiting(show)
    await show.wait(6.0)
    await returning(show)


PHASES: tuple[Into, ...] = (
    following,
    orbiting,
    assembling,
    stopped,
    turning,
    spinning,
    arming,
    paused,
    aborting,
)


def begins(into: Into) -> Into:
    """What phases have in common, which is flown once for all of them."""
    return on_the_pads if into in {arming, assembling} else running


MOMENTS = 60
CASES = [
    pytest.param(
        turn,
        PHASES[turn % len(PHASES)],
        STALLS_S[turn % len(STALLS_S)],
        id=f"{turn}-{PHASES[turn % len(PHASES)].__name__}-{STALLS_S[turn % len(STALLS_S)]:g}s",
    )
    for turn in range(MOMENTS)
]
"""Each phase with each length."""


@pytest.mark.soak
@pytest.mark.parametrize(("turn", "into", "stalled_s"), CASES)
def test_stall_of_a_mixed_fleet_keeps_the_floor(turn: int, into: Into, stalled_s: float) -> None:
    """During the stall, and until one command has brought all home."""

    async def story(show: VirtualShow) -> tuple[int, int, Outcome | None, dict[str, str], int]:
        await into(show)
        chance = random.Random(turn)
        await show.wait(chance.uniform(0.2, 8.0))
        meanwhile_m = stall(show, stalled_s, kept_share=chance.choice([1.0, 0.5]))
        await show.wait(3.0)
        outcome, reasons = None, dict[str, str]()
        if show.view.counts.airborne:
            record = await show.settled(show.service.commands.command_show(ShowAction.STOP), 150.0)
            outcome = record.outcome
            reasons = {name: part.reason for name, part in record.outcomes.items()}
        await show.until(lambda: show.view.show in {ShowPhase.LANDED, ShowPhase.IDLE}, 120.0)
        still = show.view.counts.airborne
        return floor_violations(show, meanwhile_m), show.floor_violations(), outcome, reasons, still

    meanwhile, throughout, outcome, reasons, airborne = fly(story, config(), after=begins(into), **FLEET)
    assert meanwhile == 0
    assert throughout == 0
    assert outcome in {None, Outcome.DONE}, reasons
    assert airborne == 0
