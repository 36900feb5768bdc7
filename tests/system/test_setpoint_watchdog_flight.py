"""The control loop stops while vehicles fly: setpoints cease, and the vehicles' own failsafe takes over."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from gcs.cli.service.serve import make_link
from gcs.flight.orchestrator import Orchestrator
from gcs.links.mavsdk.link import MavsdkLink
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import ShowAction
from gcs.testing.views import vehicles_of
from tests.support.machine import Pauses, free_ports
from tests.support.processes import SOON_S, flying_config, last_truths, proper, until, vehicles, wait_until

pytestmark = pytest.mark.soak

SETPOINT_TIMEOUT_S = 0.2
STOPPED_S = 3.0
BEAT_S = 1.5
"""Heartbeats come once a second."""

IDS = ("d1", "d2")

Fallen = Callable[[], bool]
Stop = Callable[[Fallen], Awaitable[None]]


async def block_the_loop(fallen: Fallen) -> None:
    """Nothing runs on the loop for three seconds, and on until every vehicle says that its failsafe runs."""
    time.sleep(STOPPED_S)  # noqa: ASYNC251  (that is the point)
    wait_until("failsafe", SOON_S, fallen)
    time.sleep(BEAT_S)  # noqa: ASYNC251


async def end_the_tick(fallen: Fallen) -> None:
    """The tick's own task ends; links and loop go on."""
    (tick,) = (task for task in asyncio.all_tasks() if task.get_name() == "control")
    tick.cancel()
    await asyncio.sleep(STOPPED_S)
    await until("failsafe", SOON_S, fallen)


def failsafe_has_begun(truth: dict[str, object]) -> bool:
    """PX4's default for offboard loss (COM_OBL_RC_ACT 0) is POSITION; without a pilot it sinks."""
    return truth["mode"] == "POSITION" and float(str(truth["velocity_down_m_s"])) > 0.5


async def fly_and_stop(folder: Path, stop: Stop) -> tuple[MavsdkLink, float, list[Phase]]:
    """Fly two vehicles, stop control, wait for the failsafe: link, time of the last tick, phases after."""
    base = free_ports(2)
    config = flying_config(
        2,
        base,
        silence_s=60.0,  # no vehicle is lost meanwhile
        setpoint_loss_action="descend",  # seen at once, from outside
        require_safe_setpoint_loss=False,
        setpoint_loss_s=3.0,  # so that it is the stop they notice and not a pause of the machine
    )
    with vehicles(2, base, folder, *proper(config)):
        link = make_link(config.links[0], config)
        assert isinstance(link, MavsdkLink)
        orchestrator = Orchestrator(config, [link])
        view = orchestrator.view
        control = asyncio.create_task(orchestrator.run())
        await until("ready", SOON_S, lambda: all(v.ready for v in vehicles_of(view.value)))
        orchestrator.commands.command_show(ShowAction.START)
        flying = {ShowPhase.ASSEMBLING, ShowPhase.RUNNING}
        await until("flying", SOON_S, lambda: view.value.show in flying)
        await asyncio.sleep(1.0)
        dropped = link.counters.setpoints_dropped

        def flows() -> bool:
            return all(view.value.time_s - link.setpoint_times_s(name)[-1] < 0.1 for name in IDS)

        await until("setpoints flow until the last tick", SOON_S, flows)
        last_tick_s = view.value.time_s
        await stop(lambda: [*map(failsafe_has_begun, last_truths(folder / "truth.jsonl"))] == [True, True])

        def repeated() -> bool:
            return link.counters.setpoints_dropped - dropped > 10

        await until("MAVSDK went on repeating", SOON_S, repeated)
        if stop is block_the_loop:
            pilot = [Phase.PILOT, Phase.PILOT]
            # a tick that runs again sees the failsafe
            await until("hands off", SOON_S, lambda: [v.phase for v in vehicles_of(view.value)] == pilot)
            await asyncio.sleep(0.5)
        phases = [vehicle.phase for vehicle in vehicles_of(view.value)]
        control.cancel()
        await asyncio.wait([control])
    return link, last_tick_s, phases


@pytest.mark.keeps("block_the_loop")
@pytest.mark.parametrize("stop", [block_the_loop, end_the_tick])
def test_setpoints_stop_with_control_and_the_failsafe_begins(tmp_path: Path, stop: Stop) -> None:
    with Pauses() as machine:
        link, last_tick_s, phases = asyncio.run(fly_and_stop(tmp_path, stop))
    for vehicle_id in IDS:
        times_s = link.setpoint_times_s(vehicle_id)
        assert times_s, "setpoints flowed before"
        assert last_tick_s - times_s[-1] < 0.1, "they flowed until the last tick"
        # the record says when the call that sends returned: a pause of the machine between may be in it
        assert machine.awake_s(last_tick_s, times_s[-1]) <= SETPOINT_TIMEOUT_S
    if stop is block_the_loop:
        assert phases == [Phase.PILOT, Phase.PILOT], "no operator commanded the failsafe's mode: hands off"
