"""Two hosts on one radio network: the owner is killed or stopped in flight, and its standby flies on.

`SITE_VEHICLES` and `SITE_KILLS` in the environment change the number of vehicles and of flights.
"""

import os
import random
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from gcs.model.errors import RefusedError
from tests.support.machine import Pauses
from tests.support.processes import SOON_S, wait_until
from tests.support.radio_network import Sent
from tests.support.site_processes import Verdict
from tests.support.standby_hosts import OWNER, STANDBY, StandbyHosts, running_standby

VEHICLES: Final = int(os.environ.get("SITE_VEHICLES", "16"))
FLIGHTS: Final = int(os.environ.get("SITE_KILLS", "20"))
OWNED_S: Final = 1.5
APART_S: Final = 0.5
"""Between the last setpoint of one station and the first of the other, for each vehicle."""


@dataclass(frozen=True, slots=True)
class Flight:
    """What the radio network and the true states have of one flight."""

    owned_s: float  # from the loss of the owner until the last of its vehicles was commanded to hold
    apart_s: float  # the least time between setpoints of the two stations, of all vehicles
    awoken: int  # setpoints of the owner after it was continued
    formed_s: float  # from the loss of the owner until all flew in formation again
    verdict: Verdict


def setpoints_s(frames: list[Sent]) -> dict[int, list[float]]:
    """Times of the setpoints to each vehicle."""
    found: dict[int, list[float]] = {}
    for one in frames:
        if one.message_id == common.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED:
            found.setdefault(one.system_id, []).append(one.time_s)
    return found


def held_s(frames: list[Sent]) -> dict[int, float]:
    """Time of the first change of mode that was commanded to each vehicle."""
    found: dict[int, float] = {}
    for one in frames:
        if one.command == common.MAV_CMD_DO_SET_MODE:
            found.setdefault(one.system_id, one.time_s)
    return found


def take_over(site: StandbyHosts) -> None:
    """One command, as soon as all hold and it is accepted."""
    wait_until("hold", SOON_S, lambda: set(site.own_phases(STANDBY)) == {"hold"})

    def accepted() -> bool:
        try:
            site.at(STANDBY, lambda client: client.take_over_station(OWNER))
        except RefusedError:  # the owner may still send setpoints
            return False
        return True

    wait_until("taken over", SOON_S, accepted)


def flown(folder: Path, vehicles: int, seed: int) -> Flight:
    """Fly until the standby has everything in formation again, and bring it home."""
    samples = random.Random(seed)
    stops, rejoins = seed % 2 == 1, seed % 4 >= 2
    with running_standby(folder, vehicles, rejoins=rejoins) as site, Pauses() as machine:
        site.start_show()
        site.at(OWNER, lambda client: client.change_orbit(radius_m=6.0, speed_m_s=2.0))
        time.sleep(samples.uniform(0.0, 8.0))
        lost_s = time.monotonic()
        os.kill(site.processes[OWNER].pid, signal.SIGSTOP if stops else signal.SIGKILL)
        wait_until("owned", SOON_S, site.owned_by_standby)
        if not rejoins:
            take_over(site)
        wait_until("running", SOON_S, lambda: site.show(STANDBY) == "running")
        wait_until("in formation", SOON_S, lambda: site.all_form(STANDBY))
        formed_s = time.monotonic() - lost_s
        woke_s = time.monotonic()
        if stops:
            os.kill(site.processes[OWNER].pid, signal.SIGCONT)
        time.sleep(3.0)
        assert site.all_form(STANDBY)
        assert site.show(STANDBY) == "running"
        site.come_home(STANDBY)
        stalled_s = machine.stalled_s(lost_s, lost_s + OWNED_S)
    north, south = site.sent(OWNER), site.sent(STANDBY)
    theirs, ours, held = setpoints_s(north), setpoints_s(south), held_s(south)
    assert set(theirs) == set(ours) == set(held) == set(range(1, vehicles + 1))
    apart_s = min(
        np.abs(np.array(theirs[one])[:, None] - np.array(ours[one])[None, :]).min() for one in theirs
    )
    return Flight(
        owned_s=max(held.values()) - lost_s - stalled_s,
        apart_s=float(apart_s),
        awoken=sum(time_s > woke_s for times_s in theirs.values() for time_s in times_s),
        formed_s=formed_s,
        verdict=site.verdict(),
    )


@pytest.mark.netns
@pytest.mark.soak
@pytest.mark.parametrize("seed", range(FLIGHTS))
def test_standby_flies_on_when_the_owner_is_lost(tmp_path: Path, seed: int) -> None:
    flight = flown(tmp_path, VEHICLES, seed)
    assert flight.owned_s <= OWNED_S
    assert flight.apart_s >= APART_S
    assert flight.awoken == 0
    assert flight.verdict.violations == 0, flight.verdict.nearest_m
    assert len(flight.verdict.landed) == VEHICLES
