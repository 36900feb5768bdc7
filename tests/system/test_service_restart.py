"""The service is killed while it flies, and started again: it finds its vehicles, and waits to be asked."""

import json
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import pytest
from pymavlink import mavutil

from gcs.client import Client
from gcs.config.schema import Config
from gcs.formation.repulsion import nearest_m
from gcs.model.errors import RefusedError
from gcs.recording.audit_reader import last_known
from gcs.recording.mcap_reader import FlightData
from tests.support.audit_rows import commands
from tests.support.machine import free_ports
from tests.support.processes import (
    PATIENT_S,
    SOON_S,
    flying_config,
    last_truths,
    proper,
    service,
    vehicles,
    wait_until,
)

IDS = ("d1", "d2", "d3")
AT_REST_M_S = 0.3
IN_PLACE_M = 0.5
FORMED_M = 7.0
"""Between the closest two of three on a sphere of 5 m, 8.7 m when formed.

Where they still pass each other, they meet as they fly on without a service; this station then parts them.
"""

LEFT_ALONE_S = PATIENT_S + 2.0
"""Long enough for the vehicles' own failsafe to hold them."""


def config_of(port_base: int) -> Config:
    return flying_config(len(IDS), port_base, silence_s=20.0)  # no vehicle is lost


def phases(client: Client) -> list[str]:
    return [vehicle.phase for vehicle in client.vehicles()]


def truths(folder: Path) -> list[dict[str, object]]:
    return last_truths(folder / "truth.jsonl")


def places_m(folder: Path) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    names = ("north_m", "east_m", "down_m")
    return np.array([[float(str(truth[name])) for name in names] for truth in truths(folder)])


def each(client: Client, action: str) -> None:
    """Order all of them, and wait until they have done so."""
    for given in [client.command(name, action) for name in IDS]:
        command = client.wait_for(given.id, SOON_S)
        assert command.outcome == "done", command


def first_setpoints_m_s(folder: Path) -> dict[int, float]:
    """By system id: how fast the first setpoint of this service would have it fly."""
    (path,) = folder.glob("*/*.tlog")
    found: dict[int, float] = {}
    with closing(mavutil.mavlink_connection(str(path))) as log:
        while (message := log.recv_match(type="SET_POSITION_TARGET_LOCAL_NED")) is not None:
            speed_m_s = float(np.linalg.norm([message.vx, message.vy, message.vz]))
            found.setdefault(message.target_system, speed_m_s)
    return found


def reached(client: Client, phase: str) -> Callable[[], bool]:
    return lambda: client.show().phase == phase


def test_airborne_vehicles_are_recovered_on_request_only(tmp_path: Path) -> None:
    base = free_ports(len(IDS))
    config = config_of(base)
    with vehicles(len(IDS), base, tmp_path, *proper(config), "--noise", "0"):
        with service(config, tmp_path / "first") as (client, process):
            wait_until("ready", SOON_S, lambda: all(vehicle.ready for vehicle in client.vehicles()))
            client.start()
            wait_until("running", SOON_S, reached(client, "running"))
            wait_until("recorded", SOON_S, lambda: is_recorded(tmp_path / "first"))
            wait_until("formed", SOON_S, lambda: nearest_m(places_m(tmp_path)) > FORMED_M)
            process.kill()
            process.wait()
        the_record_holds_every_vehicle(tmp_path / "first", base)
        with service(config, tmp_path / "second") as (client, process):
            found_and_left_alone(client, tmp_path)
            each(client, "take-control")
            wait_until("hold", SOON_S, lambda: phases(client) == ["hold"] * 3)
            wait_until("paused", SOON_S, reached(client, "paused"))
            at_rest_m = places_m(tmp_path)
            each(client, "join")
            wait_until("formation", SOON_S, lambda: phases(client) == ["formation"] * 3)
            sleep(3.0)
            assert np.abs(places_m(tmp_path) - at_rest_m).max() < IN_PLACE_M, (
                "they stand until the show goes on"
            )
            client.resume()
            wait_until("running again", SOON_S, reached(client, "running"))
            client.stop()
            wait_until("landed", SOON_S, reached(client, "landed"))
        for truth in truths(tmp_path):
            assert (truth["landed"], truth["armed"]) == (True, False)
    setpoints_m_s = first_setpoints_m_s(tmp_path / "second")
    assert sorted(setpoints_m_s) == [1, 2, 3]
    assert max(setpoints_m_s.values()) < AT_REST_M_S


def is_recorded(folder: Path) -> bool:
    """Whether the threads that write have come to what the service says."""
    known = last_known(folder)
    if known.session is None or known.show is None or known.show.phase != "running":
        return False
    if {vehicle.phase for vehicle in known.vehicles.values()} != {"formation"}:
        return False
    ticks = FlightData(known.session.folder / "flight.mcap").ticks()
    return any(tick.status.show in {"assembling", "running"} for tick in ticks)


def the_record_holds_every_vehicle(folder: Path, port_base: int) -> None:
    """What a restart, or a kill without the service, needs to know of a flight that was cut off."""
    known = last_known(folder)
    assert known.session is not None
    assert known.session.ended_unix_s is None
    assert known.show is not None
    assert known.show.phase == "running"
    assert {(name, vehicle.phase, vehicle.armed) for name, vehicle in known.vehicles.items()} == {
        (name, "formation", True) for name in IDS
    }
    assert {vehicle.host for vehicle in known.vehicles.values()} == {"127.0.0.1"}
    assert len({vehicle.port for vehicle in known.vehicles.values()} - {None, port_base}) == len(IDS)
    assert all(vehicle.home_m is not None for vehicle in known.vehicles.values())
    (start,) = commands(folder)
    assert (start.action, start.caller, set(start.outcomes)) == ("start", "local", set(IDS))
    data = FlightData(known.session.folder / "flight.mcap")
    ticks = list(data.ticks())
    assert ticks[-1].status.show in {"assembling", "running"}  # the last second is not there
    assert "cut off" in data.cut


def outside_control(client: Client) -> set[str]:
    """The vehicles that an alarm names as flown by no command of this station."""
    causes = {"outside-control", "own-failsafe"}
    return {name for each in client.alarms().alarms if each.cause in causes for name in each.vehicles}


def found_and_left_alone(client: Client, folder: Path) -> None:
    """The service says whom it has found, and sends them nothing; their own failsafe holds them."""
    wait_until("found", SOON_S, lambda: phases(client) == ["pilot"] * 3)
    wait_until("alarmed", SOON_S, lambda: outside_control(client) == set(IDS))
    reported = [json.loads(line) for line in (folder / "second" / "log").read_text().splitlines()]
    assert {line["vehicle"] for line in reported if line.get("phase") == "pilot"} == set(IDS)
    end_s = monotonic() + LEFT_ALONE_S
    while monotonic() < end_s:
        fleet = client.fleet()
        assert (fleet.show.phase, fleet.setpoints_sent) == ("uncontrolled", 0)
        assert [vehicle.phase for vehicle in fleet.vehicles] == ["pilot"] * 3
        sleep(0.5)
    wait_until("held", SOON_S, lambda: all(truth["mode"] == "HOLD" for truth in truths(folder)))
    assert not any("did not reach it" in vehicle.reason for vehicle in client.vehicles())
    with pytest.raises(RefusedError, match="3 vehicles airborne, not under this station's control"):
        client.start()
