"""The bus of a site in trouble: a station that hangs, and a stranger that floods it."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from gcs.bus.keys import make_site_keys
from tests.support.machine import Pauses
from tests.support.processes import SOON_S, wait_until
from tests.support.site_processes import NAMES, SiteProcesses, Timing, running_site
from tests.support.started import DEVNULL, Started

STOPPED_S = 2.0
WATCHED_S = 10.0
JUNK = 5000

LATE_SHARE = 0.01
"""Of the ticks: the 99th percentile of their lateness is below 10 ms."""


def watched(site: SiteProcesses, names: Sequence[str], seconds: float) -> Timing:
    """The ticks of these stations within some seconds from now, together."""
    before = [site.timing(name) for name in names]
    time.sleep(seconds)
    none = Timing(0, 0.0, 0)
    return sum((site.timing(name).since(one) for name, one in zip(names, before, strict=True)), none)


def keep_time(usual: Timing, during: Timing, rate_hz: float, paused_s: float) -> None:
    """Assert that no more ticks were late than may be, and twice as many as the busy machine had late before.

    Ticks that were dropped are late ones as well.
    """
    usual_late, late = (one.late + one.missed_s * rate_hz for one in (usual, during))
    may_be = LATE_SHARE * during.ticks + 2.0 * usual_late * during.ticks / usual.ticks + paused_s * rate_hz
    assert late <= may_be, (usual, during, paused_s)


def goes_on(usual: Timing, during: Timing) -> None:
    """Assert that ticks came: one that waits for another station counts none of them as late."""
    assert during.ticks > usual.ticks * STOPPED_S / WATCHED_S / 2.0, (usual, during)


@pytest.mark.soak
def test_a_hanging_station_delays_no_other(tmp_path: Path) -> None:
    """Compared with a time before it hangs: a station that waits for it has no tick meanwhile."""
    with running_site(tmp_path) as site, Pauses() as machine:
        site.start_show()
        rest = [name for name in NAMES if name != "south"]
        usual = watched(site, rest, WATCHED_S)
        began_s = time.monotonic()
        os.kill(site.processes["south"].pid, signal.SIGSTOP)
        during = watched(site, rest, STOPPED_S)
        paused_s = len(rest) * machine.stalled_s(began_s, time.monotonic())
        os.kill(site.processes["south"].pid, signal.SIGCONT)
        goes_on(usual, during)
        keep_time(usual, during, site.config.tick_rate_hz, paused_s)
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
@pytest.mark.parametrize("shares_memory", [False, True])
def test_a_flood_of_junk_is_refused_and_the_show_goes_on(tmp_path: Path, shares_memory: bool) -> None:
    """Where stations share memory none subscribes, and the junk reaches none."""

    def refused(more: int) -> bool:
        """Whether north has refused more than so many messages since the flood began."""
        return shares_memory or site.metric("north", "gcs_bus_messages_refused_total") > before + more

    with running_site(tmp_path, shares_memory=shares_memory) as site, Pauses() as machine:
        site.start_show()
        before = site.metric("north", "gcs_bus_messages_refused_total")  # until a station's first batch
        usual = watched(site, NAMES, WATCHED_S)
        with flood(site, "north"):
            wait_until("flooded", SOON_S, lambda: refused(0))
            began_s = time.monotonic()
            during = watched(site, NAMES, WATCHED_S)
            paused_s = len(NAMES) * machine.stalled_s(began_s, time.monotonic())
            keep_time(usual, during, site.config.tick_rate_hz, paused_s)
            wait_until("refused", SOON_S, lambda: refused(JUNK))
            assert site.all_show("running")
            assert all(one.received for one in site.stations("north").values())
            assert "holds_for_station" not in site.log("north")
            site.at("south", lambda client: client.change_orbit(radius_m=6.0, speed_m_s=2.0))
            wait_until("orbit", SOON_S, lambda: site.at("north", lambda one: one.orbit().radius_m == 6.0))
            site.come_home("east")
    found = site.verdict()
    assert found.violations == 0, found.nearest_m
    assert found.landed == set(site.config.ids)


@contextmanager
def bad_handshakes(site: SiteProcesses, name: str, kind: str) -> Iterator[None]:
    """Have a host without a key connect to one station 1,000 times a second, until the block ends."""
    endpoint = next(station.endpoint for station in site.config.stations if station.name == name)
    words = (kind, "127.0.0.9", endpoint.host, str(endpoint.port), "1000", "3600")
    command = ["nice", "-n", "19", sys.executable, "-m", "tests.support.bad_handshakes", *words]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as stranger:
        try:
            yield
        finally:
            stranger.kill()


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["junk", "hello"])
def test_bad_handshakes_delay_no_tick_and_no_station(tmp_path: Path, kind: str) -> None:
    """South is under fire, which the others but west connect to. One of them is killed, and returns."""
    make_site_keys(tmp_path / "keys", {name: ["127.0.0.1"] for name in NAMES})
    with running_site(tmp_path, shares_memory=False, keys=tmp_path / "keys") as site, Pauses() as machine:
        site.start_show()
        usual = watched(site, NAMES, WATCHED_S)
        with bad_handshakes(site, "south", kind):
            began_s = time.monotonic()
            wait_until("named", SOON_S, lambda: names_the_stranger(site, "south"))
            during = watched(site, NAMES, WATCHED_S)
            paused_s = len(NAMES) * machine.stalled_s(began_s, time.monotonic())
            keep_time(usual, during, site.config.tick_rate_hz, paused_s)
            assert site.all_show("running")
            assert all(one.received for one in site.stations("south").values())
            site.processes["north"].kill()
            site.processes["north"].wait()
            site.start_station("north")
            wait_until("received again", SOON_S, lambda: site.receives("south", "north"))


def names_the_stranger(site: SiteProcesses, name: str) -> bool:
    """Whether a station has the alarm that its bus is flooded."""
    alarms = site.at(name, lambda client: client.alarms().alarms)
    return any("failed handshakes a second from 127.0.0.9" in one.text for one in alarms)
