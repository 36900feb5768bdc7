"""kill -9 in flight, twenty times: it is back each time, nothing acknowledged is missing, all come home."""

import os
import random
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from gcs.client import Client
from gcs.config.schema import Config
from gcs.model.errors import GcsError
from gcs.model.interrupted_flight import Offer
from gcs.recording.audit_reader import last_known
from tests.support.audit_rows import commands
from tests.support.machine import Pauses, free_ports
from tests.support.processes import (
    SOON_S,
    Supervised,
    flying_config,
    last_truths,
    proper,
    supervised,
    vehicles,
    wait_until,
)

KILLS = (3, 20)
"""The more of them are for `make soak`, and so is the bound of the time: nothing runs beside that."""
BACK_S = 5.0
"""Half of the times are shorter, and none is twice as long."""
WITHIN_S = 0.8
"""Of its answering it is killed again."""

IDS = ("d1", "d2")
AT_HOME_M = 1.0


class Given(NamedTuple):
    """An order as it was answered."""

    id: str
    action: str
    accepted_unix_s: float


class Crew:
    """Orders whatever may be possible now, one after the other, and notes what was accepted."""

    def __init__(self, url: str) -> None:
        self.accepted: set[Given] = set()
        self._url = url
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._work, name="crew")

    @contextmanager
    def at_work(self) -> Iterator[None]:
        """Until the block ends."""
        self._thread.start()
        try:
            yield
        finally:
            self._ended.set()
            self._thread.join()

    def _work(self) -> None:
        with Client(self._url, timeout_s=1.0) as client:
            asks = (
                client.take_over,
                client.pause,
                client.resume,
                lambda: client.command("d1", "hold"),
                lambda: client.command("d2", "take-control"),
                lambda: client.command("d1", "join"),
            )
            while not self._ended.is_set():
                for ask in asks:
                    with suppress(GcsError):  # refused, or killed meanwhile
                        command = ask()
                        self.accepted.add(Given(command.id, command.action, command.accepted_unix_time_s))
                self._ended.wait(0.02)


def config_of(port_base: int) -> Config:
    return flying_config(len(IDS), port_base, silence_s=20.0)


def places_m(folder: Path) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    truths = last_truths(folder / "truth.jsonl")
    axes = ("north_m", "east_m", "down_m")
    return np.array([[float(str(truth[name])) for name in axes] for truth in truths])


def kill_again_and_again(station: Supervised, machine: Pauses, kills: int) -> list[float]:
    """Returns: how long it took each time until it answered, while the machine ran."""
    samples, took_s = random.Random(5), []
    for _ in range(kills):
        time.sleep(samples.uniform(0.0, WITHIN_S))
        killed_s = time.monotonic()
        os.kill(station.pid, signal.SIGKILL)
        wait_until("back", SOON_S, station.answers)
        took_s.append(machine.awake_s(killed_s, time.monotonic()))
    return took_s


FLIES = {"assembling", "running", "paused"}


def home(client: Client) -> bool:
    """Order what an operator would, from whatever was left. Returns: whether every vehicle is down."""
    shown = client.fleet()
    found = shown.interrupted
    with suppress(GcsError):  # not yet
        if any(vehicle.phase in {"offline", "takeoff"} for vehicle in shown.vehicles):
            return False
        if found is not None and Offer.BRING_HOME in found.offers and shown.show.phase != "returning":
            client.bring_home()
        elif shown.show.phase in FLIES and not any(vehicle.phase == "pilot" for vehicle in shown.vehicles):
            client.stop()
    return all(vehicle.phase == "standby" for vehicle in shown.vehicles)


@pytest.mark.soak
@pytest.mark.parametrize("kills", [KILLS[0], pytest.param(KILLS[1], marks=pytest.mark.soak)])
def test_repeated_kills_in_flight_recover_and_return_all(tmp_path: Path, kills: int) -> None:
    base = free_ports(len(IDS))
    config = config_of(base)
    with (
        vehicles(len(IDS), base, tmp_path, *proper(config), "--noise", "0"),
        supervised(config, tmp_path / "station") as station,
        Client(station.url, timeout_s=30.0) as client,
        Pauses() as machine,
    ):
        wait_until("ready", SOON_S, lambda: all(vehicle.ready for vehicle in client.vehicles()))
        pads_m = places_m(tmp_path)
        client.start()
        wait_until("running", SOON_S, lambda: client.show().phase == "running")
        crew = Crew(station.url)
        with crew.at_work():
            took_s = kill_again_and_again(station, machine, kills)
        in_the_air = places_m(tmp_path)
        wait_until("home", SOON_S, lambda: home(client))
        wait_until("disarmed", SOON_S, lambda: not any(vehicle.armed for vehicle in client.vehicles()))
        time.sleep(0.5)
        at_home_m = places_m(tmp_path)
    if kills == KILLS[1]:
        assert np.median(took_s) < BACK_S, took_s
        assert max(took_s) < 2 * BACK_S, took_s
    assert (in_the_air[:, 2] < pads_m[:, 2] - 1.0).all(), "they flew all the while"
    assert np.abs(at_home_m - pads_m).max() < AT_HOME_M
    kept = {
        Given(command.id, command.action, command.accepted_unix_s) for command in commands(station.folder)
    }
    assert len(crew.accepted) > kills
    assert not crew.accepted - kept
    assert len(station.logged("service_started")) == kills + 1
    known = last_known(station.folder).vehicles
    assert {name: known[name].home_m is not None for name in IDS} == dict.fromkeys(IDS, True)
