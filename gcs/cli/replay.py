"""`gcs replay`: the API over a recorded flight."""

import argparse
import asyncio
import logging
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gcs.api.app import create_app
from gcs.api.map_tiles import GroundMap, open_map
from gcs.api.server import serve as serve_api
from gcs.cli.flight_report import TRUTH, session_folder
from gcs.cli.output import lines, note
from gcs.cli.service.process import set_up_log
from gcs.config.setting_errors import explained
from gcs.model.errors import ConfigError
from gcs.recording.mcap_reader import FlightData
from gcs.recording.replay.service import SPEED_MAX, Replay
from gcs.service.map_settings import MapSettings


def run_replay(arguments: argparse.Namespace) -> int:
    """Serve until Ctrl-C. Returns: 0; 2 for an invalid file or argument."""
    set_up_log(logging.WARNING)
    if not 0.0 < arguments.speed <= SPEED_MAX:
        raise ConfigError(f"--speed {arguments.speed:g}: above 0, at most {SPEED_MAX:g}")
    path = Path(arguments.file)
    # of a folder the first file, of a record that in its newest session's folder
    file = session_folder(path) / "flight.mcap" if path.is_dir() else path
    asyncio.run(_replay(FlightData(file), truths(path, file), arguments))
    return 0


def truths(path: Path, file: Path) -> list[Path]:
    """Return the files of true positions, beside the flight data or in the given folder."""
    folders = {file.parent, path} if path.is_dir() else {file.parent}
    return sorted(found for folder in folders for found in folder.glob(TRUTH))


def recorded_map(config: Mapping[str, Any], *, as_json: bool = False) -> GroundMap | None:
    """Open the map of the recorded configuration; None, with a note, when its file is missing."""
    reported = config.get("map")
    try:
        return open_map(None if reported is None else MapSettings.model_validate(reported))
    except ValidationError as error:
        problem = str(explained(error, "map", MapSettings, None))
    except ConfigError as error:
        problem = str(error)
    note(f"without its map: {problem}", as_json=as_json)
    return None


async def _replay(data: FlightData, truths: list[Path], arguments: argparse.Namespace) -> None:
    loop = asyncio.get_running_loop()
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    service = Replay(data, arguments.speed, truths)
    listening: asyncio.Future[int] = loop.create_future()
    app = create_app(
        service,
        host_names=("localhost", arguments.host),
        ground=recorded_map(data.about.config, as_json=arguments.json),
    )
    tasks = [
        asyncio.create_task(serve_api(app, arguments.host, arguments.port, listening=listening), name="api"),
        asyncio.create_task(service.run(), name="replay"),
        asyncio.create_task(stop.wait(), name="stop"),
    ]
    listening.add_done_callback(lambda port: _say(data, arguments, port))
    try:
        ended, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in ended:
            task.result()  # raises the error that ended it
    finally:
        listening.cancel()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def _say(data: FlightData, arguments: argparse.Namespace, port: asyncio.Future[int]) -> None:
    if not port.cancelled():
        url = f"http://{arguments.host}:{port.result()}"
        count = len(data.about.ids)
        text = f"replay of {data.path}, {count} vehicles; look at it at {url}/ ; API at {url}/docs"
        lines(arguments)("replaying", text, url=url, file=str(data.path), vehicles=count)
