"""Faults of a flying fleet, of its links and of the service that each raise an alarm."""

import resource
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from pymavlink.dialects.v20 import common as dialect

from gcs.client import Client
from tests.support.console_bench import Station, fault
from tests.support.processes import ORIGIN
from tests.support.started import DEVNULL, Started


@contextmanager
def second_with_the_same_id(port: int) -> Iterator[None]:
    """Another vehicle with the system id of d9, on its port."""
    words = ("--first", "8", "--count", "1", "--port-base", str(port), "--origin", ORIGIN)
    other = Started("gcs.sim", *words, stdout=DEVNULL)
    try:
        yield
    finally:
        other.terminate()
        other.wait()


def kill(client: Client, name: str) -> None:
    client.confirm_kill(client.arm_kill([name]).code)


def ports_of(process: Started) -> list[int]:
    """UDP ports that a process has open."""
    links = [str(each.readlink()) for each in Path(f"/proc/{process.pid}/fd").iterdir()]
    inodes = {link[len("socket:[") : -1] for link in links if link.startswith("socket:[")}
    rows = [line.split() for line in Path("/proc/net/udp").read_text(encoding="ascii").splitlines()[1:]]
    return [int(row[1].partition(":")[2], 16) for row in rows if row[9] in inodes]


def another_station_sets(fleet: Started, system_id: int, name: str, value: float) -> None:
    """A parameter of one vehicle. Which port is its own is not known: it is the one addressed."""
    message = dialect.MAVLink_param_set_message(
        system_id, 1, name.encode(), value, dialect.MAV_PARAM_TYPE_REAL32
    )
    frame = message.pack(dialect.MAVLink(None, srcSystem=250, srcComponent=190))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
        for port in ports_of(fleet):
            outlet.sendto(frame, ("127.0.0.1", port))


def fill_the_disk(process: Started) -> None:
    """No file of the service grows any more."""
    _, hard = resource.prlimit(process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (4096, hard))


def injections(ground: Station, control: int, stack: ExitStack) -> dict[str, Callable[[], object]]:
    """Twelve causes, and how each comes about."""
    wind = {"north_m_s": 13.0, "east_m_s": 0.0, "down_m_s": 0.0}
    inject = partial(fault, control)
    first_port = int(ground.config.links[0].listen[0].rpartition(":")[2])
    return {
        "vehicle-lost": lambda: inject(vehicle=1, fault="silence"),
        "outside-control": lambda: inject(vehicle=2, fault="pilot", mode="POSITION"),
        "killed": lambda: kill(ground.client, "d3"),
        "low-battery": lambda: inject(vehicle=4, fault="battery", remaining=0.18),
        "critical-battery": lambda: inject(vehicle=5, fault="battery", remaining=0.09),
        "bad-position": lambda: inject(vehicle=6, fault="accuracy", eph_m=20.0),
        "vehicles-lost": lambda: inject(vehicles=[7, 10], fault="silence"),
        "poor-link": lambda: inject(vehicle=8, fault="loss", share=0.4),
        "duplicate-system-id": lambda: stack.enter_context(second_with_the_same_id(first_port)),
        "parameter-changed": lambda: another_station_sets(ground.fleet, 11, "COM_OF_LOSS_T", 60.0),
        "record-fails": lambda: fill_the_disk(ground.process),
        "wind": lambda: inject(vehicles="all", fault="wind", **wind),
    }
