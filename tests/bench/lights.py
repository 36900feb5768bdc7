"""A drawn show over real UDP, native transport, with lights at 4 Hz: what arrives, and how long ticks take.

`make bench` prints it; `python -m tests.bench.lights 12` flies another number of vehicles. Every vehicle's
colour changes all the time. Nothing is simulated but the vehicles: the show is checked, selected and started
by its hash, and the vehicles' truth file says which colours they received, and which of them landed.
"""

import asyncio
import os
import sys
import tempfile
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from math import nan
from pathlib import Path
from typing import Any, Final

import numpy as np

from gcs.cli.demo import demo_report, demo_show
from gcs.cli.service import scheduling
from gcs.cli.service.serve import make_link
from gcs.config.schema import Config
from gcs.flight.orchestrator import Orchestrator
from gcs.model.lifecycle import ShowPhase
from gcs.service import ShowAction, TickView
from gcs.shows import LoadedShow, load
from gcs.shows.drawn import LightPrograms
from gcs.shows.drawn.light_programs import LightProgram
from gcs.shows.formats import read_drawing, write_drawing
from gcs.shows.importing import show_text
from gcs.simulation.rehearsal import rehearse
from gcs.simulation.verdict import judge
from gcs.testing.views import vehicles_of
from tests.bench.figures import at_least, at_most
from tests.support.drawn_shows import drawn_show
from tests.support.machine import free_ports
from tests.support.processes import flying_config, last_truths, proper, until, vehicles

NAME: Final = "bench"
SECONDS, SPACING_M, RATE_HZ = 60.0, 3.0, 4.0
WITHIN_S: Final = 600.0
TICK_MAX_MS, RECEIVED_MIN = 25.0, 0.95


@dataclass(frozen=True, slots=True)
class Result:
    """One flight."""

    tick: TickView  # when the last vehicle was down
    lights_sent: int
    lights_received: int
    landed: int
    closest_m: float
    violations: int


def make_show(count: int, folder: Path) -> LoadedShow:
    """Write a show of so many vehicles that morph, with a new colour for each four times a second."""
    show, colours = drawn_show(count, SECONDS, SPACING_M), np.random.default_rng(1)
    times_s = np.arange(0.0, show.duration_s, 1.0 / RATE_HZ)
    shines = colours.integers(0, 256, (count, len(times_s) - 1, 3)).astype(np.uint8)
    lights = LightPrograms.joined([LightProgram(times_s, each, each) for each in shines])
    write_drawing(replace(show, lights=lights), folder / f"{NAME}.skyc")
    drawing, data = read_drawing(folder / f"{NAME}.skyc")
    text = show_text(drawing, f"{NAME}.skyc", sha256(data).hexdigest())
    text = text.replace("  endurance_s:", "  takeoff_stagger_s: 0.2\n  endurance_s:")
    (folder / f"{NAME}.yaml").write_text(text)
    return load(folder / f"{NAME}.yaml")


def config_for(loaded: LoadedShow, port: int) -> Config:
    """One native link with a port for each vehicle."""
    count = loaded.show.fleet.vehicles
    raw = flying_config(8, port, silence_s=5.0, setpoint_loss_action="hold").model_dump()
    raw["links"][0].update(transport="native", ports=count, vehicles={"count": count})
    raw["lights"] = {"driver": "led-control", "rate_hz": RATE_HZ}
    raw["operation"]["pads_within_m"] = 500.0
    demo_show.fit(raw, loaded)
    return Config.model_validate(raw)


async def fly(config: Config, loaded: LoadedShow, checked: dict[str, Any]) -> tuple[TickView, int]:
    """Fly a checked show. Returns: the control loop's timing, and the number of colours that left."""
    links = [make_link(link, config) for link in config.links]
    orchestrator = Orchestrator(config, links)
    text = await asyncio.to_thread(Path(loaded.file).read_bytes)
    scheduling.ask("real-time")  # as the service does; what computes and the vehicles have begun before
    control = asyncio.create_task(orchestrator.run())
    view = orchestrator.view
    try:
        show_hash = orchestrator.shows.found(NAME, text, checked).hash or ""
        orchestrator.player.select(NAME, show_hash)
        await until("ready", WITHIN_S, lambda: all(each.ready for each in vehicles_of(view.value)))
        orchestrator.commands.command_show(ShowAction.START, show_hash=show_hash)
        await until("landed", WITHIN_S, lambda: view.value.show is ShowPhase.LANDED)
        await asyncio.sleep(1.0)  # what left has arrived
        lights = view.value.features.lights
        return view.value.tick, 0 if lights is None else lights.sent
    finally:
        control.cancel()
        await asyncio.wait((control,))


def check(loaded: LoadedShow) -> dict[str, Any]:
    """Return what `gcs show check --json --model` prints."""
    verdict = judge(rehearse(loaded))
    if not verdict.good:
        raise SystemExit(f"the show is not good to fly: {verdict.problems}")
    return asdict(verdict) | {"problems": [], "model": loaded.show.model_dump(mode="json")}


def measure(count: int, folder: Path) -> Result:
    """Make a show, check it, and fly it."""
    loaded, port = make_show(count, folder), free_ports(count)
    config, checked = config_for(loaded, port), check(loaded)
    with vehicles(count, port, folder, "--ideal", *proper(config), *demo_show.grid_options(loaded)):
        tick, sent = asyncio.run(fly(config, loaded, checked))
    received = sum(int(str(each["lights_received"])) for each in last_truths(folder / "truth.jsonl"))
    truth = demo_report.ground_truth(folder / "truth.jsonl", config.frame, count)
    closest_m, violations = demo_report.separation(truth, config.control.safety.floor)
    return Result(tick, sent, received, int(truth.landed_at_end.sum()), closest_m, violations)


def main(words: list[str]) -> None:
    """Fly, and print."""
    count = int(words[0]) if words else 100
    with tempfile.TemporaryDirectory(prefix="gcs-lights-") as folder:
        flown = measure(count, Path(folder))
    share = flown.lights_received / max(flown.lights_sent, 1)
    load_average = os.getloadavg()[0]
    print(f"{count} vehicles, native transport, lights at {RATE_HZ:g} Hz, load average {load_average:.1f}:")
    print(f"  landed {at_least(flown.landed, count, '.0f')}, closest pair {flown.closest_m:.2f} m,", end=" ")
    print(f"{flown.violations} below the floor")
    tick = flown.tick
    print(f"  tick p99 {at_most(tick.duration_p99_ms or nan, TICK_MAX_MS)} ms,", end=" ")
    print(f"late p99 {tick.lateness_p99_ms or nan:.1f} ms, {tick.missed} of {tick.count} missed")
    print(f"  colours received {at_least(share, RECEIVED_MIN, '.2%')} of {flown.lights_sent}")


if __name__ == "__main__":
    main(sys.argv[1:])
