"""Several stations of a demonstration flight: the first in this process, each other in one of its own."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from socket import AF_INET, SOCK_STREAM, socket
from typing import Any, Final

from gcs.client import Client
from gcs.config.schema import Config
from gcs.model.errors import GcsError

NAMES: Final = ("north", "south", "west", "east")
STATIONS_MAX: Final = 20
ENDS_S: Final = 20.0


def add_stations(raw: dict[str, Any], count: int) -> None:
    """Give each of the configuration's links to a station; there are as many links as stations."""
    endpoints, apis = _free_ports(count), _free_ports(2 * count)
    raw["stations"] = [
        {
            "name": station_name(at),
            "links": [link["name"]],
            "endpoint": {"host": "127.0.0.1", "port": endpoints[at]},
            "api": raw["api"] if at == 0 else {"port": apis[2 * at], "emergency_port": apis[2 * at + 1]},
        }
        for at, link in enumerate(raw["links"])
    ]


def station_name(at: int) -> str:
    """Name of a station by its place."""
    return NAMES[at] if at < len(NAMES) else f"station{at + 1}"


@contextmanager
def other_stations(site: Config, folder: Path) -> Iterator[dict[str, str]]:
    """Run all stations but the first until the block ends. Yields their APIs' URLs by name."""
    file = folder / "site.yaml"
    file.write_text(site.model_dump_json())
    children: list[subprocess.Popen[bytes]] = []
    command = [sys.executable, "-m", "gcs", "serve", "--config", str(file), "--quiet", "--station"]
    try:
        for station in site.stations[1:]:
            # a session of its own: Ctrl-C must bring the fleet home, not end a station in flight
            child = subprocess.Popen(  # noqa: S603 (this program)
                [*command, station.name], stdout=subprocess.DEVNULL, start_new_session=True
            )
            children.append(child)
        yield {
            station.name: f"http://{station.api.host}:{station.api.port}"
            for station in site.stations[1:]
            if station.api is not None
        }
    finally:
        for child in children:
            child.terminate()
        for child in children:
            try:
                child.wait(ENDS_S)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()


def tick_figures(urls: dict[str, str]) -> dict[str, float | None]:
    """99th percentile of each station's tick, in ms; None: it does not answer."""
    found: dict[str, float | None] = {}
    for name, url in urls.items():
        try:
            with Client(url) as client:
                found[name] = client.fleet().tick.duration_p99_ms
        except GcsError:
            found[name] = None
    return found


def _free_ports(count: int) -> list[int]:
    """TCP ports of this machine that are free now."""
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket(AF_INET, SOCK_STREAM)) for _ in range(count)]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]
