"""The service stops while vehicles fly on for long without setpoints: no pair comes inside the floor."""

import random
from collections.abc import Callable
from functools import partial
from typing import Final, NamedTuple

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.model.lifecycle import Phase
from gcs.model.plan import Orbit, Target
from gcs.testing.copies import in_a_copy
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, TARGET_M, VirtualShow, fly, show_config
from tests.support.show_phases import running
from tests.support.stalls import stall

pytestmark = pytest.mark.soak

COUNT: Final = 8
RADIUS_M, HEIGHT_M = 4.2, 14.0
"""The least for eight vehicles with RTK is 4.0 m."""

STOPPED_S: Final = 3.5
"""And longer than they fly on: they have come to rest by then."""

MOMENTS, EVERY_S = 40, 0.75


def config(loss_s: float) -> Config:
    operation = {**HOLDS_WHEN_LOST, "setpoint_loss_s": loss_s}
    return show_config(COUNT, operation=operation, formation={"radius_m": RADIUS_M, "height_m": HEIGHT_M})


def orbit(show: VirtualShow, chance: random.Random) -> None:
    show.service.plan.set_orbit(
        Orbit(radius_m=chance.choice([9.0, 14.0]), speed_m_s=chance.choice([2.0, 3.0]))
    )


def follow(show: VirtualShow, chance: random.Random) -> None:
    """It passes the place where the pilot's vehicle stays."""
    show.service.plan.set_target(Target(*TARGET_M, -chance.choice([2.0, 3.0]), 0.0))


class Nearest(NamedTuple):
    """Shares of the floor."""

    to_pilot: float
    among_others: float


def nearest(show: VirtualShow, pilot: int, seconds: float) -> Nearest:
    """The true distances while the service stands still for so long."""
    floor, (first, second) = show.config.control.safety.floor, np.triu_indices(COUNT, 1)
    true_m = stall(show, seconds)
    share = np.linalg.norm((true_m[:, first] - true_m[:, second]) * floor.scale, axis=2) / floor.horizontal_m
    of_pilot = (first == pilot) | (second == pilot)
    return Nearest(float(share[:, of_pilot].min()), float(share[:, ~of_pilot].min()))


async def nearest_at_each_moment(
    show: VirtualShow, moves: Callable[[VirtualShow, random.Random], None], seed: int, loss_s: float
) -> Nearest:
    """A pilot stops one vehicle of a formation that moves on; at each moment the service might stop."""
    chance, worst = random.Random(seed), Nearest(np.inf, np.inf)
    moves(show, chance)
    await show.wait(chance.uniform(3.0, 10.0))
    row = chance.randrange(COUNT)
    show.befall(show.config.ids[row], "pilot", mode="POSITION")
    await show.phase(show.config.ids[row], Phase.PILOT)
    for _ in range(MOMENTS):
        await show.wait(EVERY_S)
        found = in_a_copy(partial(nearest, show, row, loss_s + STOPPED_S))
        worst = Nearest(*map(min, worst, found))
    return worst


FLIGHTS: Final = [
    pytest.param(moves, seed, loss_s, marks=() if keeps else pytest.mark.soak)
    for moves, seed, loss_s, keeps in (
        *((orbit, seed, 3.0, seed == 2) for seed in (0, 1, 2)),
        *((follow, seed, 3.0, False) for seed in (0, 1, 2)),
        *((moves, seed, 1.0, False) for moves in (orbit, follow) for seed in (0, 1, 2)),
    )
]


@pytest.mark.parametrize(("moves", "seed", "loss_s"), FLIGHTS)
def test_setpoints_may_end_at_any_moment_beside_a_pilot(
    moves: Callable[[VirtualShow, random.Random], None], seed: int, loss_s: float
) -> None:
    found = fly(
        partial(nearest_at_each_moment, moves=moves, seed=seed, loss_s=loss_s),
        config(loss_s),
        after=running,
        ideal=True,
    )
    assert min(found) > 1.0, found
