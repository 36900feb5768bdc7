"""What a replay shows is what was flown: the show's lights, and the limits that held."""

import asyncio
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.config import schema as configuration
from gcs.recording import mcap_layout as layout
from gcs.recording import mcap_writer as flightfile
from gcs.recording.mcap_reader import FlightData
from gcs.recording.mcap_writer import _OpenFile
from gcs.recording.replay.service import Replay
from gcs.recording.sample import Sample
from gcs.safety.walls import Fence
from gcs.service import FleetView
from gcs.shows import find, load
from tests.support.record_samples import ids_of, sample

CONFIG = configuration.load(configuration.find("demo"))
SHOW = load(find("breathing-sphere"))
SHOWN = SHOW.show.control
COUNT = 3
PARTS = {"d1": 0, "d3": 1}
"""d2 flies beside, and has no part."""


def lit(show_s: float) -> dict[str, Any]:
    """Columns of the lights at a time of the show."""
    rows = [PARTS.get(name, -1) for name in ids_of(COUNT)]
    return {"colour": SHOW.timeline.colours_at(show_s)[rows], "lit": np.array(rows) >= 0}


def samples() -> list[Sample]:
    """A second on the ground under the service's limits, then a show's, its lights changing."""
    made = []
    for tick in range(200):
        plays = tick >= 20
        show_s = (tick - 20) / 180 * SHOW.timeline.duration_s
        at = sample(
            COUNT,
            time_s=100.0 + tick / 20,
            control=SHOWN if plays else CONFIG.control,
            **(lit(show_s) if plays else {}),
        )
        made.append(replace(at, number=tick + 1))
    return made


def position_s(replay: Replay) -> float:
    playback = replay.view.value.playback
    assert playback is not None
    return playback.position_s


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(flightfile, "CHUNK_S", 0.0)
    about = layout.about("s1", CONFIG.model_dump_json(), dict.fromkeys(ids_of(COUNT), (1, "a")))
    made = _OpenFile(tmp_path / "flight.mcap", about)
    for each in samples():
        made.add(each)
        made.flush()
    made.finish()
    return made.path


def shown(file: Path, *places_s: float) -> list[FleetView]:
    """What the replay shows there."""

    async def seek() -> list[FleetView]:
        replay = Replay(FlightData(file), 1.0)
        views = []
        running = asyncio.create_task(replay.run())
        try:
            for place_s in places_s:
                replay.change(paused=True, position_s=place_s)
                async with asyncio.timeout(20):
                    while abs(position_s(replay) - place_s) > 0.03:  # noqa: ASYNC110
                        await asyncio.sleep(0.01)
                views.append(replay.view.value)
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
        return views

    return asyncio.run(seek())


def test_lights_are_replayed_as_the_show_gave_them(file: Path) -> None:
    before, early, late = shown(file, 0.5, 2.0, 8.0)
    assert before.rows.colours() == [None] * COUNT
    desired = {}
    for name, tick, view in (("early", 40, early), ("late", 160, late)):
        desired[name] = samples()[tick].view.rows.colours()
        assert [colour is not None for colour in desired[name]] == [True, False, True]
        assert view.rows.colours() == desired[name]
    assert desired["early"] != desired["late"]


def test_fence_in_force_is_drawn(file: Path) -> None:
    before, during = shown(file, 0.5, 4.0)
    service, show = CONFIG.control.safety.fence, SHOWN.safety.fence
    assert service != show
    for view, fence in ((before, service), (during, show)):
        assert (
            Fence(
                height_min_m=view.flight_envelope.height_min_m,
                height_max_m=view.flight_envelope.height_max_m,
                distance_max_m=view.flight_envelope.distance_max_m,
            )
            == fence
        )


def test_vehicles_are_shown_with_the_station_of_their_link(tmp_path: Path) -> None:
    assert CONFIG.stations == ()
    stations = [{"name": "north", "links": ["a"]}, {"name": "south", "links": ["b", "c"]}]
    config = json.loads(CONFIG.model_dump_json()) | {"stations": stations}
    links = {"d1": (1, "a"), "d2": (2, "c"), "d3": (3, "elsewhere")}
    made = _OpenFile(tmp_path / "flight.mcap", layout.about("s1", json.dumps(config), links))
    made.add(samples()[0])
    made.finish()

    async def stations_shown() -> list[str]:
        return list(Replay(FlightData(made.path), 1.0).view.value.rows.stations)

    assert asyncio.run(stations_shown()) == ["north", "south", ""]
