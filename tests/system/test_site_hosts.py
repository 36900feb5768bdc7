"""Stations on hosts of their own, with TLS: the network between them is cut in halves, and heals."""

import time
from functools import partial
from pathlib import Path

import pytest

from tests.support.processes import SOON_S, wait_until
from tests.support.site_hosts import LEFT, RIGHT, running_hosts
from tests.support.site_processes import NAMES

CUT_S = 5.0


@pytest.mark.netns
@pytest.mark.soak
def test_a_cut_network_holds_both_halves_until_it_heals(tmp_path: Path) -> None:
    with running_hosts(tmp_path) as site:
        site.start_show()
        site.at("south", lambda client: client.change_orbit(radius_m=6.0, speed_m_s=2.0))
        wait_until("orbit", SOON_S, lambda: site.at("east", lambda one: one.orbit().radius_m) == 6.0)
        began_s = time.monotonic()
        site.hosts.cut()
        wait_until("both halves hold", SOON_S, lambda: site.all_show("paused"))
        for name in NAMES:
            here, there = (LEFT, RIGHT) if name in LEFT else (RIGHT, LEFT)
            found = site.stations(name)
            assert not any(found[other].received for other in there)
            wait_until("the same half", SOON_S, partial(site.receives, name, *here))
        time.sleep(max(0.0, began_s + CUT_S - time.monotonic()))
        site.hosts.heal()
        wait_until("healed", SOON_S, lambda: all(site.receives(name, *NAMES) for name in NAMES))
        wait_until("running again", SOON_S, lambda: site.all_show("running"))
        wait_until("in formation", SOON_S, site.all_form)
        site.come_home("west")
    verdict = site.verdict()
    assert verdict.violations == 0, verdict.nearest_m
    assert verdict.landed == set(site.config.ids)
