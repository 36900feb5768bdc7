"""A station of four is killed in flight: the others re-form, and take every command throughout."""

import random
import time
from functools import partial
from pathlib import Path

import pytest

from gcs.client import Client
from tests.support.machine import Pauses
from tests.support.processes import SOON_S, wait_until
from tests.support.site_processes import NAMES, Operators, SiteProcesses, running_site

FORMED_S = 15.0
"""From the kill until the others fly in formation again; judged by `make soak`, beside which nothing runs."""

MOMENT_S = 12.0
"""The kill comes so long after the formation stands, at most."""

KILLS = 20
TARGET_M = 8.0, 7.0


def leads_or_follows(seed: int) -> str:
    """The first station leads; each third kill is of it."""
    return NAMES[0] if seed % 3 == 0 else random.Random(seed).choice(NAMES[1:])


def has_target(site: SiteProcesses, name: str) -> bool:
    """Whether a station knows the new target."""
    return site.at(name, Client.target).x_m == TARGET_M[0]


@pytest.mark.soak
@pytest.mark.parametrize(
    ("victim", "seed"),
    [
        (NAMES[0], 0),
        *((leads_or_follows(seed), seed) for seed in range(1, KILLS)),
    ],
)
def test_a_killed_station_ends_no_show(tmp_path: Path, victim: str, seed: int) -> None:
    samples = random.Random(seed)
    with running_site(tmp_path) as site, Pauses() as machine:
        site.start_show()
        rest = [name for name in NAMES if name != victim]
        site.at(samples.choice(NAMES), lambda client: client.change_orbit(radius_m=6.0, speed_m_s=2.0))
        with Operators(site, rest) as before:
            time.sleep(samples.uniform(0.0, MOMENT_S))
            killed_s = time.monotonic()
            site.processes[victim].kill()
            wait_until("hold", SOON_S, lambda: site.all_show("paused", *rest))
        successor = samples.choice(rest)
        if victim == NAMES[0]:
            assert all("gcs lead take" in reason for _, reason in before.refused)
            site.take_lead(successor)
        else:
            assert before.refused == []
        with Operators(site, rest) as operators:
            wait_until("formed again", SOON_S, lambda: site.all_show("running", *rest))
            took_s = machine.awake_s(killed_s, time.monotonic())
        assert operators.refused == []
        assert operators.accepted.keys() == set(rest)
        x_m, y_m = TARGET_M
        site.at(successor, lambda client: client.set_target(x_m=x_m, y_m=y_m))
        for name in rest:
            wait_until("target", SOON_S, partial(has_target, site, name))
        site.come_home(samples.choice(rest))
    found = site.verdict()
    assert found.violations == 0, found.nearest_m
    assert found.landed >= site.vehicles_of(*rest)
    if seed:
        assert took_s <= FORMED_S
