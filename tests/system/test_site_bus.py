"""The bus of a site in trouble: a station that hangs, and a stranger that floods it."""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.machine import Pauses
from tests.support.processes import SOON_S, wait_until
from tests.support.site_processes import NAMES, SiteProcesses, Timing, running_site
from tests.support.started import DEVNULL, Started

STOPPED_S = 2.0
PERIOD_S = 0.05
JUNK = 5000


def timings(site: SiteProcesses, names: list[str]) -> dict[str, Timing]:
    return {name: site.timing(name) for name in names}


@pytest.mark.soak
def test_a_hanging_station_delays_no_other(tmp_path: Path) -> None:
    """Compared with as long a time before it hangs: a station that waits for it has no tick meanwhile."""
    with running_site(tmp_path) as site, Pauses() as machine:
        site.start_show()
        rest = [name for name in NAMES if name != "south"]
        before = timings(site, rest)
        time.sleep(STOPPED_S)
        began_s = time.monotonic()
        begun = timings(site, rest)
        os.kill(site.processes["south"].pid, signal.SIGSTOP)
        time.sleep(STOPPED_S)
        ended = timings(site, rest)
        paused_s = machine.stalled_s(began_s, time.monotonic())
        os.kill(site.processes["south"].pid, signal.SIGCONT)
        for name in rest:
            usual, during = begun[name].since(before[name]), ended[name].since(begun[name])
            assert during.ticks > 0
            assert during.missed_s < usual.missed_s + paused_s + STOPPED_S / 2.0
            assert during.late_s / during.ticks < usual.late_s / usual.ticks + PERIOD_S + paused_s
        wait_until("running again", SOON_S, lambda: site.all_show("running"))
        wait_until("in formation", SOON_S, site.all_form)
        site.come_home("east")
    found = site.verdict()
    assert found.violations == 0, found.nearest_m
    assert found.landed == set(site.config.ids)


@contextmanager
def flood(site: SiteProcesses, name: str) -> Iterator[None]:
    """Flood the bus by a stranger that is connected to one station, until the block ends."""
    endpoint = next(station.endpoint for station in site.config.stations if station.name == name)
    others = [each for each in NAMES if each != name]
    words = (endpoint.host, str(endpoint.port), *others)
    stranger = Started("tests.support.junk_peer", *words, stdout=DEVNULL)
    try:
        yield
    finally:
        stranger.end()


@pytest.mark.soak
def test_a_flood_of_junk_is_refused_and_the_show_goes_on(tmp_path: Path) -> None:
    with running_site(tmp_path) as site:
        site.start_show()
        assert site.metric("north", "gcs_bus_messages_refused_total") == 0
        with flood(site, "north"):
            wait_until(
                "refused", SOON_S, lambda: site.metric("north", "gcs_bus_messages_refused_total") > JUNK
            )
            assert site.all_show("running")
            assert all(one.received for one in site.stations("north").values())
            assert "holds_for_station" not in site.log("north")
            site.at("south", lambda client: client.change_orbit(radius_m=6.0, speed_m_s=2.0))
            wait_until("orbit", SOON_S, lambda: site.at("north", lambda one: one.orbit().radius_m == 6.0))
            site.come_home("east")
    found = site.verdict()
    assert found.violations == 0, found.nearest_m
    assert found.landed == set(site.config.ids)
