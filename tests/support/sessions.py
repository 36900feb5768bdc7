"""Services that follow one another over the same vehicles, each of them cut off in flight."""

import asyncio
import atexit
import shutil
import tempfile
import time
from collections.abc import Sequence
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any

from gcs.config.schema import Config
from gcs.flight.orchestrator import Orchestrator
from gcs.model.lifecycle import Phase
from gcs.model.plan import Formation, Obstacle
from gcs.model.state import VehicleId
from gcs.preflight.parameters import settings_of
from gcs.recording.audit_reader import exclusions, interruption, lost_begin
from gcs.recording.session import Record
from gcs.sim.fleet import Fleet
from gcs.sim.settings import Settings
from gcs.testing.copies import in_a_copy
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_link import STREAMS_HZ, VirtualLink
from gcs.testing.virtual_show import (
    HOLDS_WHEN_LOST,
    READY_AT_ONCE,
    SOON_DISARMED,
    Story,
    T,
    VirtualShow,
    begin_of,
    load_machine_code,
    show_config,
)
from gcs.testing.virtual_time import AtOnce, UnixClock, VirtualLoop
from tests.support.written_show import on_pads

ALL = ("d1", "d2", "d3", "d4")
BOX = Obstacle("box", 60.0, -60.0, 1.0, 1.0, 5.0)


def four(**sections: Any) -> Config:
    return show_config(4, operation=HOLDS_WHEN_LOST, **sections)


async def fly_for_a_while(show: VirtualShow) -> None:
    show.service.plan.set_formation(Formation(radius_m=7.0, height_m=15.0))
    show.service.plan.add_obstacle(BOX)
    await show.start()
    await show.wait(3.0)


async def found(show: VirtualShow) -> None:
    """Every vehicle has reported again."""
    await show.until(lambda: {seen.phase for seen in vehicles_of(show.view)} == {Phase.PILOT})


class Vehicles:
    """A fake fleet, and the services that control it one after the other."""

    def __init__(self, config: Config) -> None:
        self._loop, self._unix = VirtualLoop(), UnixClock()
        self._fleet = self._loop.play(self._fleet_of(config))

    def close(self) -> None:
        self._loop.close()

    def session(self, config: Config, root: Path, story: Story[T], late: Sequence[VehicleId] = ()) -> T:
        """A service is cut off when the story ends; 2 s pass until the next.

        Of vehicles that are `late` nothing arrives before the story restores them.
        """
        return self._loop.play(self._session(config, root, story, late))

    async def _fleet_of(self, config: Config) -> Fleet:
        self._unix.ahead_s = time.time() - asyncio.get_running_loop().time()
        settings = Settings(
            count=len(config.ids),
            grid_columns=2,
            parameters={**SOON_DISARMED, **settings_of(config)},
            quirks=READY_AT_ONCE,
            rates_hz=STREAMS_HZ,
            **on_pads(),
        )
        now_s = asyncio.get_running_loop().time()
        return Fleet(settings, **begin_of(now_s, self._unix()))

    async def _session(self, config: Config, root: Path, story: Story[T], late: Sequence[VehicleId]) -> T:
        vehicles = {name: (row + 1, "loop") for row, name in enumerate(config.ids)}
        link = VirtualLink(config, self._fleet)
        link.ports.silence(*late)
        record = Record(
            root,
            config.model_dump_json(),
            vehicles,
            flight=False,
            interruption=interruption(root),
            excluded=exclusions(root),
            lost_begin=lost_begin(root),
        )
        with record:
            planning = AtOnce()
            service = Orchestrator(config, [link], record, unix_s=self._unix, planning=planning)
            show = VirtualShow(config, self._fleet, link, service, self._unix, planning)
            tasks = {asyncio.create_task(service.run()), asyncio.create_task(show.record(record))}
            await show.wait(0.0)
            reported = asyncio.ensure_future(story(show))
            try:
                await asyncio.wait({*tasks, reported}, return_when=asyncio.FIRST_COMPLETED)
                result = await reported
            finally:
                for task in {*tasks, reported}:
                    task.cancel()
                await asyncio.gather(*tasks, reported, return_exceptions=True)
        await asyncio.sleep(2.0)
        return result


@cache
def _interrupted() -> tuple[Vehicles, Path]:
    """Vehicles that `fly_for_a_while` left in the air, and the record of it."""
    load_machine_code()
    folder = tempfile.TemporaryDirectory()
    vehicles = Vehicles(four())
    atexit.register(folder.cleanup)
    atexit.register(vehicles.close)
    root = Path(folder.name)
    vehicles.session(four(), root, fly_for_a_while)
    return vehicles, root


def sessions(root: Path, *parts: tuple[Config, Story[T]], late: Sequence[VehicleId] = ()) -> list[T]:
    """One service after the other over the same vehicles, of which some are `late` in the last session."""
    with closing(Vehicles(parts[0][0])) as vehicles:
        return [
            vehicles.session(config, root, story, late if story is parts[-1][1] else ())
            for config, story in parts
        ]


def after_interruption(
    root: Path, *parts: tuple[Config, Story[None]], late: Sequence[VehicleId] = ()
) -> None:
    """As `sessions` after `fly_for_a_while`, which is flown once; the rest in a copy of the process."""
    vehicles, recorded = _interrupted()
    shutil.copytree(recorded, root, dirs_exist_ok=True)

    def go_on() -> None:
        for config, story in parts:
            vehicles.session(config, root, story, late if story is parts[-1][1] else ())

    in_a_copy(go_on)
