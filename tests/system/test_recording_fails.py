"""The disk fills while vehicles fly: they fly on, the operator is told, and what was recorded stays."""

import resource
from contextlib import closing
from pathlib import Path

import pytest
from pymavlink import mavutil

from gcs.client import Client
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, flying_config, proper, service, vehicles, wait_until
from tests.support.started import Started

IDS = ("d1", "d2")


def limit_files(process: Started, size_bytes: int) -> None:
    """No file of this process grows beyond that any more, as if the disk were full."""
    _, hard = resource.prlimit(process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (size_bytes, hard))


def setpoints(path: Path) -> set[int]:
    """Whom a recording holds setpoints for. Fails where a frame in it is not whole."""
    targets = set()
    with closing(mavutil.mavlink_connection(str(path))) as log:
        while (message := log.recv_match()) is not None:
            assert message.get_type() != "BAD_DATA"
            if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                targets.add(message.target_system)
    return targets


def fly_on_a_full_disk(client: Client, process: Started, folder: Path) -> None:
    wait_until("ready", SOON_S, lambda: all(vehicle.ready for vehicle in client.vehicles()))
    assert client.alarms().alarms == []
    (path,) = folder.glob("*/*.tlog")
    limit_files(process, path.stat().st_size)

    def describe() -> bool:
        """Whatever else of the record fails: the frames are named, with the cause."""
        cause_text = f": frames are not recorded: {path.parent}: [Errno 27] File too large"
        return any(cause_text in alarm.text for alarm in client.alarms().alarms)

    wait_until("reported", SOON_S, describe)
    full_bytes = path.stat().st_size

    client.start()
    wait_until("flying", SOON_S, lambda: {vehicle.phase for vehicle in client.vehicles()} == {"formation"})
    assert describe()
    assert path.stat().st_size <= full_bytes
    assert setpoints(path) == set(), "what lies there was recorded before, and can be read"

    limit_files(process, resource.RLIM_INFINITY)
    wait_until("it goes on", SOON_S, lambda: not describe())  # that ticks were lost may be said for good
    wait_until("setpoints are recorded", SOON_S, lambda: setpoints(path) == {1, 2})


@pytest.mark.soak
def test_disk_full_in_flight_is_reported_and_changes_nothing(tmp_path: Path) -> None:
    base = free_ports(len(IDS))
    config = flying_config(len(IDS), base, silence_s=20.0)
    folder = tmp_path / "service"
    with vehicles(len(IDS), base, tmp_path, *proper(config)), service(config, folder) as (client, process):
        fly_on_a_full_disk(client, process, folder)
    (path,) = folder.glob("*/*.tlog")
    assert setpoints(path) == {1, 2}, "it can be read when the service is gone, too"
