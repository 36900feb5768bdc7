"""When the first setpoints of motion of a fleet leave, over real UDP, for a show that begins at a clock time.

`python -m tests.bench.show_begin [VEHICLES] [TIMES]`: its formation circles from the first moment on.
Times are those of the frames that the link recorded, as they left, against the time that was given.
"""

import asyncio
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import common

from gcs.cli.service import wall_clock
from gcs.cli.service.serve import make_link
from gcs.config.schema import Config
from gcs.flight.orchestrator import Orchestrator
from gcs.model.lifecycle import ShowPhase
from gcs.service import ShowAction
from gcs.shows import parse
from gcs.simulation.rehearsal import rehearse
from gcs.simulation.verdict import judge
from gcs.testing.views import vehicles_of
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, flying_config, proper, until, vehicles

AHEAD_S = 45.0
MOVES_M_S = 0.3
SHOW = """
about: A formation that circles from its first moment on.
origin: {{latitude_deg: 47.397742, longitude_deg: 8.545594, altitude_amsl_m: 488.0, heading_deg: 0.0}}
fleet:
  vehicles: {count}
  pads: {{columns: 3, spacing_m: 5.0, x_m: {middle_m}, y_m: 5.0}}
  endurance_s: 900.0
  takeoff_height_m: 3.0
  takeoff_stagger_s: 0.2
fence: {{height_min_m: 3.0, height_max_m: 60.0, distance_max_m: 100.0}}
duration_s: 60.0
timeline:
  - {{cue: circle, at_s: 0, radius_m: 8, height_m: 15, orbit: {{radius_m: 4, speed_m_s: 1}}}}
"""


def setpoints(folder: Path) -> Iterator[tuple[float, int, tuple[float, float, float]]]:
    """Unix time, system id and velocity of each setpoint that left."""
    reader = common.MAVLink(None)
    for path in sorted(folder.glob("**/*.tlog")):
        data, at = path.read_bytes(), 0
        while at + 10 < len(data):
            time_s = int.from_bytes(data[at : at + 8], "big") / 1e6
            length = data[at + 9] + (12 if data[at + 8] == 0xFD else 8)
            length += 13 if data[at + 8] == 0xFD and data[at + 10] & 1 else 0
            frame = data[at + 8 : at + 8 + length]
            at += 8 + length
            if int.from_bytes(frame[7:10], "little") == common.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED:
                (message,) = reader.parse_buffer(bytearray(frame))
                yield time_s, message.target_system, (message.vx, message.vy, message.vz)


async def flown(config: Config, folder: Path, text: str) -> float:
    """Fly until the show has begun, and bring the fleet home. Returns: the time given, in s since 1970."""
    links = [make_link(link, config, folder) for link in config.links]
    orchestrator = Orchestrator(config, links, clock_problem=wall_clock.problem)
    task = asyncio.create_task(orchestrator.run())
    view = orchestrator.view
    try:
        loaded = parse(text, "circle")
        verdict = await asyncio.to_thread(lambda: judge(rehearse(loaded)))
        if not verdict.good:
            raise SystemExit(f"the show is not good to fly: {verdict.problems}")
        answer = asdict(verdict) | {"problems": [], "model": loaded.show.model_dump(mode="json")}
        show_hash = orchestrator.shows.found("circle", text.encode(), answer).hash or ""
        orchestrator.player.select("circle", show_hash)
        await until("ready", SOON_S, lambda: all(each.ready for each in vehicles_of(view.value)))
        at_s = time.time() + AHEAD_S
        orchestrator.player.begin_at(at_s)
        orchestrator.commands.command_show(ShowAction.START, show_hash=show_hash)
        await until("running", SOON_S, lambda: view.value.show is ShowPhase.RUNNING)
        await asyncio.sleep(2.0)
        print(f"tick late p99 {view.value.tick.lateness_p99_ms} ms, clock: {wall_clock.problem() or 'good'}")
        orchestrator.commands.command_show(ShowAction.STOP)
        await until("landed", SOON_S, lambda: view.value.show is ShowPhase.LANDED)
        return at_s
    finally:
        task.cancel()
        await asyncio.wait((task,))


def main() -> None:
    count, times = (int(word) for word in (*sys.argv[1:], "10", "1")[:2])
    for _ in range(times):
        with tempfile.TemporaryDirectory() as name:
            folder, base = Path(name), free_ports(count)
            config = flying_config(count, base, silence_s=5.0)
            raw = config.model_dump() | {"shows": {"folder": folder}}
            config = Config.model_validate(raw)
            text = SHOW.format(count=count, middle_m=2.5 * ((count - 1) // 3))
            (folder / "circle.yaml").write_text(text)
            with vehicles(count, base, folder, *proper(config)):
                at_s = asyncio.run(flown(config, folder, text))
            sent = [one for one in setpoints(folder) if at_s - 2.0 < one[0] < at_s + 2.0]
            first_ms = []
            for system_id in sorted({one[1] for one in sent}):
                own = [(time_s - at_s, np.array(v)) for time_s, target, v in sent if target == system_id]
                still = np.mean([v for after_s, v in own if after_s < -0.1], axis=0)
                first_ms.append(
                    1e3 * next(after_s for after_s, v in own if np.linalg.norm(v - still) > MOVES_M_S)
                )
            print(
                f"{count} vehicles: first motion {min(first_ms):.2f} to {max(first_ms):.2f} ms after it,"
                f" spread {np.ptp(first_ms):.2f} ms"
            )


if __name__ == "__main__":
    main()
