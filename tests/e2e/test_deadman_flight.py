"""The control loop stops while vehicles fly: setpoints cease, and the vehicles' own failsafe takes over."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from ground import flying_config, free_ports, last_truth, until, vehicles

from gcs.cli.serve import make_link
from gcs.lifecycle import Phase, ShowPhase
from gcs.links.mavsdk_link import MavsdkLink
from gcs.orchestrator import Orchestrator
from gcs.service import ShowAction

pytestmark = pytest.mark.xdist_group("e2e")

DEADMAN_S = 0.2
IDS = ("d1", "d2")

Stop = Callable[[asyncio.Task[None]], Awaitable[None]]


async def block_the_loop(control: asyncio.Task[None]) -> None:
    """Nothing runs on the loop for three seconds."""
    time.sleep(3.0)  # noqa: ASYNC251  (that is the point)


async def end_the_tick(control: asyncio.Task[None]) -> None:
    """The tick's own task ends; links and loop go on."""
    (tick,) = (task for task in asyncio.all_tasks() if task.get_name() == "control")
    tick.cancel()
    await asyncio.sleep(3.0)


async def fly_and_stop(
    folder: Path, stop: Stop
) -> tuple[MavsdkLink, float, list[dict[str, object]], list[Phase]]:
    """Fly two vehicles, stop control, and look: link, time of the last tick, truths, phases after."""
    base = free_ports(2)
    config = flying_config(2, base)
    with vehicles(2, base, folder):
        link = make_link(config.links[0], config)
        assert isinstance(link, MavsdkLink)
        orchestrator = Orchestrator(config, [link])
        control = asyncio.create_task(orchestrator.run())
        await until("ready", 30, lambda: all(v.ready for v in orchestrator.view.value.vehicles))
        orchestrator.command_show(ShowAction.START)
        flying = {ShowPhase.ASSEMBLING, ShowPhase.RUNNING}
        await until("flying", 60, lambda: orchestrator.view.value.show in flying)
        await asyncio.sleep(2.0)
        last_tick_s = orchestrator.view.value.time_s
        await stop(control)
        truths = [last_truth(folder / f"{i}.jsonl") for i in range(2)]
        await asyncio.sleep(0.5)  # a tick that still runs now has seen the failsafe
        phases = [vehicle.phase for vehicle in orchestrator.view.value.vehicles]
        control.cancel()
        await asyncio.wait([control])
    return link, last_tick_s, truths, phases


@pytest.mark.parametrize("stop", [block_the_loop, end_the_tick])
def test_when_control_stops_setpoints_cease_and_the_failsafe_begins(tmp_path: Path, stop: Stop) -> None:
    link, last_tick_s, truths, phases = asyncio.run(fly_and_stop(tmp_path, stop))
    for vehicle_id in IDS:
        times_s = link.setpoint_times_s(vehicle_id)
        assert times_s, "setpoints flowed before"
        assert last_tick_s - times_s[-1] < 0.1, "they flowed until the last tick"
        assert times_s[-1] - last_tick_s <= DEADMAN_S
    assert link.counters.setpoints_dropped > 0, "MAVSDK went on repeating"
    for truth in truths:
        assert truth["mode"] == "POSITION", "PX4's default for offboard loss (COM_OBL_RC_ACT 0)"
        assert float(str(truth["velocity_down_m_s"])) > 0.5, "it sinks"
    if stop is block_the_loop:
        assert phases == [Phase.PILOT, Phase.PILOT], "the failsafe's mode is nobody's order: hands off"
