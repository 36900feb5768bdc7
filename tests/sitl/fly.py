"""`make sitl`: fly the whole story with PX4 or ArduPilot SITL, judged on the simulator's true states.

    make sitl PX4=/path/to/build/px4_sitl_default      # a PX4 that was built with `make px4_sitl_default`
    make sitl PX4_IMAGE=px4io/px4-sitl:latest          # where docker or podman runs
    make sitl ARDUPILOT=/path/to/build/sitl/bin/arducopter
    make sitl FAKE=1 AUTOPILOT=ardupilot               # the fake fleet: px4, ardupilot, mixed

The last line is one JSON object. Exit code 0: everything was kept; 1: something was not; 2: not flown.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from itertools import cycle
from pathlib import Path
from typing import Any

from gcs.cli import demo_report as report
from gcs.cli.demo import MIXED, MIXED_LOSS_S
from gcs.config import schema as configuration
from gcs.links.autopilots import AUTOPILOTS, DEFAULT
from gcs.model.errors import GcsError
from gcs.model.setpoint_loss import WithoutSetpoints
from gcs.sim.settings import PAD_SPACING_M
from tests.sitl.sitl_flight import QUICK, TRUE_WITHIN_S, Account, Pace, SitlFlight
from tests.sitl.sitl_service import Service, ServiceError
from tests.sitl.sitl_simulators import (
    PX4_PORT,
    PX4_SIMULATOR_PORT,
    ArduCopter,
    FakeFleet,
    Pads,
    Px4Build,
    Px4Image,
    Simulators,
)
from tests.sitl.sitl_truth import FDM_PORT, GroundTruthRecorder

CONFIG = "px4-sitl"
ENERGY_MAX, NEAREST_MIN = 1.003, 0.9
SLOWEST = 0.98
VEHICLES_MAX = 10
"""From instance 10 on every PX4 sends to port 14549."""


def main(argv: list[str] | None = None) -> int:
    """Fly and judge. Returns the exit code."""
    given = _parser().parse_args(argv)
    if given.keep is not None:
        folder = Path(given.keep)
        folder.mkdir(parents=True, exist_ok=True)
        return _run(given, folder)
    with tempfile.TemporaryDirectory(prefix="sitl-") as temporary:
        return _run(given, Path(temporary))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="make sitl", description=__doc__.splitlines()[0])
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--px4", metavar="FOLDER", help="build folder of PX4, .../build/px4_sitl_default")
    which.add_argument("--image", metavar="NAME", help="container image that runs PX4's SIH")
    which.add_argument("--arducopter", metavar="FILE", help="ArduCopter, .../build/sitl/bin/arducopter")
    which.add_argument("--fake", action="store_true", help="the fake fleet")
    parser.add_argument("--vehicles", type=int, default=4, metavar="N", help=f"2 to {VEHICLES_MAX}; 4")
    kinds = (*AUTOPILOTS, MIXED)
    parser.add_argument("--autopilot", choices=kinds, default=DEFAULT.name, help="with --fake")
    parser.add_argument("--quick", action="store_true", help="shorter steady windows")
    parser.add_argument("--port-base", type=int, default=PX4_PORT, metavar="P", help="with --fake")
    parser.add_argument(
        "--simulator-port", type=int, default=PX4_SIMULATOR_PORT, metavar="P", help="with --fake"
    )
    parser.add_argument("--keep", metavar="FOLDER", help="keep logs, record and configuration there")
    return parser


def _run(given: argparse.Namespace, folder: Path) -> int:
    if not 2 <= given.vehicles <= VEHICLES_MAX:
        return _not_flown(f"--vehicles {given.vehicles}: 2 to {VEHICLES_MAX} is possible")
    lost = given.vehicles - 1
    frame = configuration.load(configuration.find(CONFIG)).frame
    pads = Pads(frame, given.vehicles, configuration_spacing_m())
    try:
        simulators = _simulators(given, pads, folder, lost)
        config = make_config(given.vehicles, given.port_base, simulators.kinds, fake=given.fake)
        service = Service(config, folder)
        fdm_port = None if given.arducopter is None else FDM_PORT
        with (
            GroundTruthRecorder(given.simulator_port, given.vehicles, fdm_port=fdm_port) as truth,
            closing(simulators),
            closing(service),
        ):
            simulators.start()
            service.apply_parameters()
            service.start()
            flight = SitlFlight(
                service,
                simulators,
                lost=lost,
                pace=QUICK if given.quick else Pace(),
                say=_say_from(time.monotonic()),
            )
            failure = _fly(flight)
        figures = judge(truth, flight.account, config, failure)
    except (OSError, ServiceError, ValueError) as error:
        return _not_flown(str(error))
    figures = {"autopilot": simulators.autopilot, "vehicles": given.vehicles} | figures
    print(report.summary(figures))
    print(json.dumps(figures))
    return 0 if figures["verdict"] == "kept" else 1


def make_config(count: int, port: int, kinds: Sequence[str], *, fake: bool) -> configuration.Config:
    """The shipped configuration for PX4 SITL, for so many vehicles, with an API port that is free.

    The vehicles have the autopilots `kinds` in turn. Where one of these flies on without setpoints for a
    time of its own, all do. `fake`: the program is tested, not the machine. No failsafe against a slow
    machine acts.
    """
    raw = configuration.load(configuration.find(CONFIG)).model_dump()
    raw["links"][0].update(listen=f"udpin://127.0.0.1:{port}", ports=count)
    raw["links"][0]["vehicles"] = [
        {"id": f"d{number}", "system_id": number, "autopilot": kind}
        for number, kind in zip(range(1, count + 1), cycle(kinds))
    ]
    if not all(_alone(kind, raw).changes_mode for kind in kinds):
        raw["operation"]["setpoint_loss_s"] = MIXED_LOSS_S
    raw["api"]["port"] = 0
    if fake:
        for cause in ("service_late", "links_late", "wind"):
            raw["failsafes"][cause]["action"] = "ignore"
    return configuration.Config.model_validate(raw)


def _alone(kind: str, raw: dict[str, Any]) -> WithoutSetpoints:
    operation = raw["operation"]
    return AUTOPILOTS[kind].without_setpoints(
        operation["setpoint_loss_action"], operation["setpoint_loss_s"], {}
    )


def configuration_spacing_m() -> float:
    """Between pads: what the shipped configuration for PX4 SITL is made for."""
    return PAD_SPACING_M


def _simulators(given: argparse.Namespace, pads: Pads, folder: Path, lost: int) -> Simulators:
    if given.fake:
        ports = {"port": given.port_base, "simulator_port": given.simulator_port}
        return FakeFleet(pads, folder, **ports, lost=lost, autopilot=given.autopilot)
    if given.arducopter is not None:
        return ArduCopter(Path(given.arducopter), pads, folder)
    if given.image is not None:
        return Px4Image(given.image, pads, folder)
    return Px4Build(Path(given.px4), pads, folder)


def _fly(flight: SitlFlight) -> str:
    """Returns: why the flight ended early, empty when it did not."""
    try:
        flight.fly()
    except (GcsError, ServiceError) as error:
        return str(error)
    return ""


def judge(
    recorder: GroundTruthRecorder, account: Account, config: configuration.Config, failure: str
) -> dict[str, object]:
    """The figures of the flight, from the simulators' true states; `verdict` is kept or broken."""
    truth, commanded = recorder.truth(config.frame), account.commanded()
    smallest_m, violations = report.separation(truth, config.control.safety.floor)
    ids = config.ids
    landed = [
        name for name, down in zip(ids, truth.landed_at_end, strict=True) if down and name not in account.lost
    ]
    figures: dict[str, object] = {
        "lost": account.lost,
        "landed": len(landed),
        "min_separation_m": round(smallest_m, 3),
        "separation_violations": violations,
    }
    broken = [failure] if failure else []
    if len(landed) + len(account.lost) != len(ids):
        broken.append("not every vehicle landed")
    if violations:
        broken.append("a pair came inside the minimum separation")
    for name, window in account.steady.items():
        rows = [row for row, vehicle in enumerate(ids) if name != "after_loss" or vehicle not in account.lost]
        shape = report.shape(_of(truth.between(*window), rows), commanded)
        figures |= {f"{what}_{name}": round(value, 5) for what, value in shape.items()}
        if shape["energy_ratio"] > ENERGY_MAX or shape["nearest_ratio"] < NEAREST_MIN:
            broken.append(f"the shape was not reached: {name}")
    penetrations = 0
    if account.obstacle is not None:
        end_s = float(truth.time_s[-1])
        penetrations = report.penetrations(truth.between(account.obstacle_from_s, end_s), account.obstacle)
    if penetrations:
        broken.append("a vehicle came inside the obstacle")
    true_s = account.true_after_stall_s
    if not failure and (true_s is None or true_s > TRUE_WITHIN_S):
        broken.append(f"the phase was not true within {TRUE_WITHIN_S:g} s of the stall")
    per_wall = recorder.simulated_per_wall_s()
    return figures | {
        "obstacle_penetrations": penetrations,
        "phase_after_stall": account.phase_after_stall,
        "true_after_stall_s": _rounded(true_s),
        "recovered_after_stall_s": _rounded(account.recovered_after_stall_s),
        "recovered_after_restart_s": _rounded(account.recovered_after_restart_s),
        "commands_refused": account.refused,
        "simulated_per_wall_s": None if per_wall is None else round(per_wall, 3),
        "machine_fast_enough": None if per_wall is None else per_wall >= SLOWEST,
        "broken": broken,
        "verdict": "broken" if broken else "kept",
    }


def _of(truth: report.GroundTruth, rows: list[int]) -> report.GroundTruth:
    """Some of the vehicles."""
    return report.GroundTruth(
        truth.time_s, truth.position_m[:, rows], truth.airborne[:, rows], truth.landed_at_end[rows]
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 2)


def _say_from(began_s: float) -> Callable[[str], None]:
    def say(text: str) -> None:
        print(f"[{time.monotonic() - began_s:6.1f} s] {text}", flush=True)

    return say


def _not_flown(why: str) -> int:
    print(f"make sitl: {why}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
