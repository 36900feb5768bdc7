"""`gcs serve --supervised`: what hangs is started again, what is asked to end ends, what is alone says so."""

import os
import signal
from pathlib import Path

import pytest

from gcs.client import Client
from gcs.config.schema import Config
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, Supervised, flying_config, supervised, wait_until


def config_of() -> Config:
    return flying_config(1, free_ports(1), silence_s=2.0)


def is_gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def started_again(station: Supervised) -> bool:
    return len(station.logged("service_ready")) == 2 and station.answers()


def test_hung_service_is_restarted_and_ends_on_request(tmp_path: Path) -> None:
    with supervised(config_of(), tmp_path / "station") as station:
        wait_until("ready", SOON_S, lambda: len(station.logged("service_ready")) == 1)
        hung = station.pid
        os.kill(hung, signal.SIGSTOP)
        wait_until("started again", SOON_S, lambda: started_again(station))
        assert [line["pid"] for line in station.logged("service_hangs")] == [hung]
        assert is_gone(hung)
        station.parent.send_signal(signal.SIGTERM)
        assert station.parent.wait(SOON_S) == 0
        wait_until("ended", SOON_S, lambda: is_gone(station.pid))
        assert [(line["code"], line["restarted"]) for line in station.logged("service_ended")] == [
            (-signal.SIGKILL, True),
            (0, False),
        ]


@pytest.mark.soak
def test_service_without_its_supervisor_goes_on_and_reports_it(tmp_path: Path) -> None:
    with supervised(config_of(), tmp_path / "station") as station, Client(station.url) as client:
        wait_until("ready", SOON_S, lambda: len(station.logged("service_ready")) == 1)
        assert client.alarms().alarms == []
        station.parent.kill()
        station.parent.wait()
        reported = ["Supervisor gone: nothing starts this service again."]
        wait_until("reported", SOON_S, lambda: [alarm.text for alarm in client.alarms().alarms] == reported)
        assert client.health().alive
        assert len(station.logged("supervisor_gone")) == 1


def test_service_that_cannot_start_is_not_restarted(tmp_path: Path) -> None:
    station = Supervised(config_of(), tmp_path / "station", "--port", "70000")
    try:
        assert station.parent.wait(SOON_S) == 2
        assert len(station.logged("service_started")) == 1
        assert "70000" in (station.folder / "log").read_text()
    finally:
        station.end()
