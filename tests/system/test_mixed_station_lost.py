"""The station of eight vehicles, PX4 and ArduPilot in turn, is killed, stalls, or its heartbeats end.

Each vehicle does what its own autopilot does: PX4 changes to HOLD, ArduCopter flies on for 3 s, stops and
hovers in GUIDED. Where only heartbeats end, each acts by its own failsafe for these, or neither has one. The
true positions say that no two come nearer than the minimum separation.
"""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from time import sleep

import pytest

from gcs.cli.demo import demo_report as report
from gcs.client import Client
from gcs.config.schema import Config
from tests.support.link_router import Router
from tests.support.machine import free_ports
from tests.support.processes import (
    SOON_S,
    flying_config,
    last_truths,
    proper,
    service,
    vehicles,
    wait_passes,
    wait_until,
)

pytestmark = pytest.mark.soak

COUNT = 8
LOSS_S = 3.0
"""ArduCopter 4.1 flies on for so long, whatever is configured: so do the others."""

STOPPED_S = 6.0
WITHOUT_BEATS_S = 15.0
"""ArduCopter's failsafe for them takes 5 s, PX4's 10 s (COM_DL_LOSS_T)."""

MIXED = ("--autopilot", "mixed", "--shared-port", "--telemetry-hz", "20", "--noise", "0")
PX4 = {f"d{number}" for number in range(1, COUNT + 1, 2)}
ARDUPILOT = {f"d{number}" for number in range(2, COUNT + 1, 2)}


def config_of(port: int, **operation: object) -> Config:
    flown = flying_config(COUNT, port, silence_s=20.0, **{"setpoint_loss_s": LOSS_S, **operation})
    raw = flown.model_dump(mode="json")
    kinds = cycle(("px4", "ardupilot"))
    raw["links"][0]["transport"] = "native"
    raw["links"][0]["ports"] = 1
    raw["links"][0]["vehicles"] = [
        {"id": f"d{number}", "system_id": number, "autopilot": next(kinds)} for number in range(1, COUNT + 1)
    ]
    return Config.model_validate(raw)


class Fleet:
    """The fake vehicles, seen from outside."""

    def __init__(self, folder: Path, config: Config) -> None:
        self._file, self._config = folder / "truth.jsonl", config

    def modes(self, names: set[str]) -> set[object]:
        """True modes of these vehicles."""
        truths = zip(self._config.ids, last_truths(self._file), strict=True)
        return {truth["mode"] for name, truth in truths if name in names}

    def hovers(self) -> bool:
        axes = ("velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s")
        return all(
            not truth["landed"] and all(abs(float(str(truth[axis]))) < 0.3 for axis in axes)
            for truth in last_truths(self._file)
        )

    def check_flight(self) -> None:
        """Every vehicle has landed, and kept its distance all the way."""
        truth = report.ground_truth(self._file, self._config.frame, COUNT)
        smallest_m, violations = report.separation(truth, self._config.control.safety.floor)
        assert violations == 0, smallest_m
        assert truth.landed_at_end.all()


@contextmanager
def flying(config: Config, folder: Path, port: int, *options: str) -> Iterator[Fleet]:
    with vehicles(COUNT, port, folder, *MIXED, *proper(config), *options):
        yield Fleet(folder, config)


def start(client: Client) -> None:
    """Start, and orbit, so that every vehicle is under way."""
    wait_passes(client)
    client.start()
    wait_until("running", SOON_S, lambda: client.show().phase == "running")
    client.change_orbit(radius_m=5.0, speed_m_s=2.0)
    sleep(5.0)


def bring_home(client: Client) -> None:
    client.stop()
    wait_until("landed", SOON_S, lambda: client.show().phase == "landed")
    wait_until("disarmed", SOON_S, lambda: not any(each.armed for each in client.vehicles()))


def phases(client: Client, names: set[str]) -> set[str]:
    return {each.phase for each in client.vehicles() if each.id in names}


def test_killed_station_leaves_all_hovering_apart(tmp_path: Path) -> None:
    base = free_ports(1)
    config = config_of(base)
    with flying(config, tmp_path, base) as fleet:
        with service(config, tmp_path / "service") as (client, process):
            start(client)
            process.kill()
        wait_until("PX4's failsafe", SOON_S, lambda: fleet.modes(PX4) == {"HOLD"})
        wait_until("all hover", SOON_S, fleet.hovers)
        assert fleet.modes(ARDUPILOT) == {"GUIDED"}
        with service(config, tmp_path / "service") as (client, _):
            wait_until("found", SOON_S, lambda: client.interrupted() is not None)
            wait_until("received", SOON_S, lambda: "offline" not in phases(client, PX4 | ARDUPILOT))
            client.take_over()
            wait_until("controlled", SOON_S, lambda: phases(client, PX4 | ARDUPILOT) == {"formation"})
            bring_home(client)
    fleet.check_flight()


def test_stalled_station_finds_each_as_its_autopilot_left_it(tmp_path: Path) -> None:
    base = free_ports(1)
    config = config_of(base)
    with (
        flying(config, tmp_path, base) as fleet,
        service(config, tmp_path / "service") as (client, process),
    ):
        start(client)
        os.kill(process.pid, signal.SIGSTOP)
        sleep(STOPPED_S)
        wait_until("PX4's failsafe", SOON_S, lambda: fleet.modes(PX4) == {"HOLD"})
        wait_until("all hover", SOON_S, fleet.hovers)
        os.kill(process.pid, signal.SIGCONT)
        wait_until("named", SOON_S, lambda: phases(client, PX4) == {"pilot"})
        assert phases(client, ARDUPILOT) == {"formation"}
        assert fleet.modes(ARDUPILOT) == {"GUIDED"}
        bring_home(client)
    fleet.check_flight()


def test_setpoints_alone_keep_the_fleet_when_heartbeats_end(tmp_path: Path) -> None:
    """With `hold` neither autopilot has a failsafe for heartbeats that acts: preflight demands it so."""
    base = free_ports(1)
    config = config_of(base)
    with (
        Router(base) as router,
        flying(config, tmp_path, router.port) as fleet,
        service(config, tmp_path / "service") as (client, _),
    ):
        start(client)
        router.drops_heartbeats = True
        sleep(WITHOUT_BEATS_S)
        assert phases(client, PX4 | ARDUPILOT) == {"formation"}
        assert (fleet.modes(PX4), fleet.modes(ARDUPILOT)) == ({"OFFBOARD"}, {"GUIDED"})
        bring_home(client)
    fleet.check_flight()


@pytest.mark.parametrize(
    ("action", "px4_parameter", "modes"),
    [("land", "NAV_DLL_ACT=3", {"LAND"}), ("return", "NAV_DLL_ACT=2", {"RTL", "RETURN"})],
)
def test_each_acts_by_its_own_failsafe_when_heartbeats_end(
    tmp_path: Path, action: str, px4_parameter: str, modes: set[object]
) -> None:
    """ArduCopter acts 5 s after the last heartbeat of its station, PX4 10 s after the last one of any.

    Between, the station flies the PX4 vehicles past those that have left it.
    """
    base = free_ports(1)
    config = config_of(base, setpoint_loss_action=action, require_safe_setpoint_loss=False)
    with (
        Router(base) as router,
        flying(config, tmp_path, router.port, "--param", px4_parameter) as fleet,
        service(config, tmp_path / "service") as (client, _),
    ):
        start(client)
        router.drops_heartbeats = True
        wait_until("ArduPilot's failsafe", SOON_S, lambda: fleet.modes(ARDUPILOT) <= modes)
        assert fleet.modes(PX4) == {"OFFBOARD"}
        wait_until("named", SOON_S, lambda: phases(client, ARDUPILOT) == {"pilot"})
        assert all("failsafe" in each.reason for each in client.vehicles() if each.id in ARDUPILOT)
        wait_until("PX4's failsafe", SOON_S, lambda: fleet.modes(PX4) <= modes)
        wait_until("disarmed", SOON_S, lambda: not any(each.armed for each in client.vehicles()))
    fleet.check_flight()
