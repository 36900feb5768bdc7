"""`gcs serve --all`: each station is a process, one signal ends them all, and a failed one is reported."""

import json
import os
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml

from gcs.client import Client
from gcs.config.schema import find
from gcs.model.errors import GcsError
from tests.support.machine import free_ports
from tests.support.processes import AT_ONCE, ORIGIN, SOON_S, wait_until
from tests.support.started import DEVNULL, Started

STATIONS = ("north", "south")


class Site:
    """Two stations with two fake vehicles each; what they print is in `folder`."""

    def __init__(self, folder: Path, *options: str) -> None:
        """Start `gcs serve --all`."""
        raw = yaml.safe_load(find("stations").read_text(encoding="utf-8"))
        self.first = free_ports(8)
        for section in ("links", "stations"):
            raw[section] = [each for each in raw[section] if each["name"].startswith(STATIONS)]
        for k, (station, link) in enumerate(zip(raw["stations"], raw["links"], strict=True)):
            link |= {"listen": f"udpin://127.0.0.1:{self.first + k}"}
            link["vehicles"] |= {"count": 2}
            station |= {"endpoint": {"host": "127.0.0.1", "port": self.first + 2 + k}}
            station |= {"api": {"port": self.first + 4 + 2 * k}}
        raw["record"] = {"folder": str(folder / "runs"), "frames": False}
        self.folder = folder
        file = folder / "site.yaml"
        file.write_text(yaml.safe_dump(raw), encoding="utf-8")
        with (folder / "out").open("w") as out, (folder / "err").open("w") as err:
            words = ("serve", "--config", str(file), "--all", "--quiet", "--json", *options)
            self.parent = Started("gcs", *words, stdout=out, stderr=err)

    def printed(self, file: str, event: str) -> list[dict[str, object]]:
        """Every complete line with that event; `file` is out or err."""
        lines = (self.folder / file).read_text(encoding="utf-8").splitlines()
        found = [json.loads(line) for line in lines if line.startswith("{") and line.endswith("}")]
        return [line for line in found if line.get("event") == event]

    def serving(self) -> set[object]:
        return {line["station"] for line in self.printed("out", "serving")}

    def vehicles(self, station: int) -> set[str]:
        """Vehicles that a station flies and receives."""
        try:
            with Client(f"http://127.0.0.1:{self.first + 4 + 2 * station}", timeout_s=2.0) as client:
                seen = client.fleet().vehicles
                return {one.id for one in seen if one.phase != "offline" and one.station == STATIONS[station]}
        except GcsError:
            return set()

    def is_closed(self) -> bool:
        """Whether no station listens any more."""
        for port in (self.first + 4, self.first + 6):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    return False
        return True


@contextmanager
def running(folder: Path, *options: str) -> Iterator[Site]:
    """Run the site and its fake vehicles until the block ends."""
    site = Site(folder, *options)
    fleet = ("--count", "4", "--namespace-size", "2", "--shared-port", "--port-base", str(site.first))
    vehicles = Started("gcs", "sim", *fleet, "--origin", ORIGIN, *AT_ONCE, stdout=DEVNULL)
    try:
        yield site
    finally:
        for _ in range(2):  # the second stops at once
            site.parent.terminate()
        site.parent.wait(SOON_S)
        vehicles.end()


@pytest.mark.soak
def test_one_signal_ends_every_station(tmp_path: Path) -> None:
    with running(tmp_path) as site:
        wait_until("serving", SOON_S, lambda: site.serving() == set(STATIONS))
        wait_until("north's", SOON_S, lambda: site.vehicles(0) == {"n1", "n2"})
        wait_until("south's", SOON_S, lambda: site.vehicles(1) == {"s1", "s2"})
        assert sorted(path.name for path in (tmp_path / "runs").iterdir()) == ["north", "south"]
        site.parent.terminate()
        assert site.parent.wait(SOON_S) == 0
        assert site.is_closed()


@pytest.mark.soak
def test_a_supervised_station_is_restarted_alone(tmp_path: Path) -> None:
    with running(tmp_path, "--supervised") as site:
        wait_until("ready", SOON_S, lambda: len(site.printed("err", "service_ready")) == 2)
        started = {line["station"]: line["pid"] for line in site.printed("err", "service_started")}
        os.kill(int(str(started["south"])), signal.SIGKILL)
        wait_until("ready again", SOON_S, lambda: len(site.printed("err", "service_ready")) == 3)
        assert [line["station"] for line in site.printed("err", "service_started")].count("north") == 1
        site.parent.send_signal(signal.SIGINT)
        assert site.parent.wait(SOON_S) == 0
        assert site.is_closed()


@pytest.mark.soak
def test_a_station_that_fails_is_named_and_others_go_on(tmp_path: Path) -> None:
    with running(tmp_path) as site, socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        taken.bind(("127.0.0.1", site.first + 6))  # south's API, before south is loaded
        taken.listen()
        ended = "south ended with exit code 1; 1 of 2 stations go on"
        wait_until("ended", SOON_S, lambda: ended in (tmp_path / "err").read_text(encoding="utf-8"))
        wait_until("north's", SOON_S, lambda: site.vehicles(0) == {"n1", "n2"})
        assert site.serving() == {"north"}
        site.parent.terminate()
        assert site.parent.wait(SOON_S) == 1
