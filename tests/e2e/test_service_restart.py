"""The service is killed while it flies, and started again: it finds its vehicles, and waits to be asked."""

import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import pytest
import yaml
from ground import PATIENT_S, SOON_S, flying_config, last_truths, proper, vehicles, wait_until
from machine import free_ports
from pymavlink import mavutil

from gcs.client import Client
from gcs.config import Config
from gcs.errors import RefusedError

pytestmark = pytest.mark.xdist_group("e2e")

IDS = ("d1", "d2", "d3")
AT_REST_M_S = 0.3
IN_PLACE_M = 0.5
LEFT_ALONE_S = PATIENT_S + 2.0
"""Long enough for the vehicles' own failsafe to hold them."""


def config_of(port_base: int) -> Config:
    raw = flying_config(len(IDS), port_base, silence_s=20.0).model_dump()  # nobody is lost
    raw["formation"] = {"radius_m": 6.0, "height_m": 12.0}
    return Config.model_validate(raw)


@contextmanager
def service(config: Config, folder: Path) -> Iterator[tuple[Client, subprocess.Popen[str]]]:
    """`gcs serve` in a process of its own; its recording and its log lie in `folder`."""
    folder.mkdir()
    raw = config.model_dump(mode="json") | {"record": {"folder": str(folder)}}
    (folder / "config.yaml").write_text(yaml.safe_dump(raw), encoding="utf-8")
    command = [sys.executable, "-m", "gcs", "serve", "--config", str(folder / "config.yaml"), "--quiet"]
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
    try:
        assert process.stdout is not None
        address = re.search(r"http://\S+:\d+", process.stdout.readline())
        assert address is not None, (folder / "log").read_text()
        with Client(address[0], timeout_s=30.0) as client:
            yield client, process
    finally:
        process.kill()
        process.communicate()


def phases(client: Client) -> list[str]:
    return [vehicle.phase for vehicle in client.vehicles()]


def truths(folder: Path) -> list[dict[str, object]]:
    return [last_truths(folder / f"{row}.jsonl")[0] for row in range(len(IDS))]


def places_m(folder: Path) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    names = ("north_m", "east_m", "down_m")
    return np.array([[float(str(truth[name])) for name in names] for truth in truths(folder)])


def in_turn(client: Client, action: str) -> None:
    """Order each, and wait until it has done so."""
    for name in IDS:
        order = client.wait_for(client.command(name, action).id, SOON_S)
        assert order.outcome == "done", order


def first_setpoints_m_s(folder: Path) -> dict[int, float]:
    """By system id: how fast the first setpoint of this service would have it fly."""
    (path,) = folder.glob("*.tlog")
    found: dict[int, float] = {}
    with closing(mavutil.mavlink_connection(str(path))) as log:
        while (message := log.recv_match(type="SET_POSITION_TARGET_LOCAL_NED")) is not None:
            speed_m_s = float(np.linalg.norm([message.vx, message.vy, message.vz]))
            found.setdefault(message.target_system, speed_m_s)
    return found


def reached(client: Client, phase: str) -> Callable[[], bool]:
    return lambda: client.show().phase == phase


def test_vehicles_found_in_the_air_are_taken_over_on_request_only_and_without_a_jump(tmp_path: Path) -> None:
    base = free_ports(len(IDS))
    config = config_of(base)
    with vehicles(len(IDS), base, tmp_path, *proper(config), "--noise", "0"):
        with service(config, tmp_path / "first") as (client, process):
            wait_until("ready", SOON_S, lambda: all(vehicle.ready for vehicle in client.vehicles()))
            client.start()
            wait_until("running", SOON_S, reached(client, "running"))
            process.kill()
            process.wait()
        with service(config, tmp_path / "second") as (client, process):
            found_and_left_alone(client, tmp_path)
            in_turn(client, "hand-back")
            assert phases(client) == ["hold"] * 3
            wait_until("paused", SOON_S, reached(client, "paused"))
            at_rest_m = places_m(tmp_path)
            in_turn(client, "join")
            assert phases(client) == ["formation"] * 3
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


def found_and_left_alone(client: Client, folder: Path) -> None:
    """The service says whom it has found, and sends them nothing; their own failsafe holds them."""
    wait_until("found", SOON_S, lambda: phases(client) == ["pilot"] * 3)
    assert {vehicle.reason for vehicle in client.vehicles()} == {"found in the air, and not by our order"}
    assert client.fleet().notices == [
        "d1, d2, d3: in the air, but not ours: hand-back takes over, in hold",
    ]
    told = [json.loads(line) for line in (folder / "second" / "log").read_text().splitlines()]
    assert {line["vehicle"] for line in told if line.get("phase") == "pilot"} == set(IDS)
    end_s = monotonic() + LEFT_ALONE_S
    while monotonic() < end_s:
        fleet = client.fleet()
        assert (fleet.show.phase, fleet.setpoints_sent) == ("idle", 0)
        assert [vehicle.phase for vehicle in fleet.vehicles] == ["pilot"] * 3
        sleep(0.5)
    wait_until("held", SOON_S, lambda: all(truth["mode"] == "HOLD" for truth in truths(folder)))
    with pytest.raises(RefusedError, match="d1 is pilot"):
        client.start()
