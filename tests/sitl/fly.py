"""`make sitl`: fly a story with PX4 or ArduPilot SITL, judged on the simulator's true states.

    make sitl                                     # what is found on this machine, or what to get
    make sitl PX4=/path/to/PX4-Autopilot          # or its build folder, or bin/px4 itself
    make sitl PX4_IMAGE=px4io/px4-sitl:latest     # where docker or podman runs
    make sitl ARDUPILOT=/path/to/ardupilot        # or build/sitl/bin/arducopter
    make sitl FAKE=1 AUTOPILOT=mixed VERSION=1.16,4.7 SEED=3

The last line is one JSON object. Exit code 0: everything was kept; 1: something was not; 2: not flown.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from itertools import cycle
from pathlib import Path
from typing import Any, get_args

from gcs.cli.demo import demo_report as report
from gcs.cli.demo import demo_site
from gcs.cli.demo.demo import MIXED, MIXED_LOSS_S
from gcs.config import schema as configuration
from gcs.config.sections import LinkSettings
from gcs.links.autopilots import AUTOPILOTS, DEFAULT
from gcs.model.setpoint_loss import WithoutSetpoints
from gcs.preflight.parameters import settings_of
from gcs.sim.cli import parameter_options
from gcs.sim.settings import PAD_SPACING_M
from tests.sitl import sitl_chapters
from tests.sitl.sitl_fake import FakeFleet, FakeOptions
from tests.sitl.sitl_flight import QUICK, Pace, SitlFlight
from tests.sitl.sitl_judge import judge
from tests.sitl.sitl_programs import NotFoundError
from tests.sitl.sitl_service import Service, ServiceError
from tests.sitl.sitl_simulators import (
    SIMULATOR_PORT,
    STATION_PORT,
    ArduCopter,
    Pads,
    Px4Build,
    Px4Image,
    Simulators,
)
from tests.sitl.sitl_truth import FDM_PORT, GroundTruthRecorder

CONFIG = "px4-sitl"
PADS_M = PAD_SPACING_M
"""What the shipped configuration for PX4 SITL is made for."""

LONG_PADS_M = PAD_SPACING_M + 1.0
"""With a 3D fix vehicles land up to a metre beside their pads, and the long story starts them from there."""

VEHICLES_MAX = 10
"""From instance 10 on every PX4 sends to port 14549."""

SPEAKS_S = 180.0


def main(argv: list[str] | None = None) -> int:
    """Fly and judge. Returns the exit code."""
    given = _parser().parse_args(argv)
    if given.keep is not None:
        folder = Path(given.keep).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        return _run(given, folder)
    with tempfile.TemporaryDirectory(prefix="sitl-") as temporary:
        return _run(given, Path(temporary))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="make sitl", description=__doc__.splitlines()[0])
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--px4", metavar="PATH", help="PX4: its tree, a build folder, or bin/px4")
    which.add_argument("--image", metavar="NAME", help="container image that runs PX4's SIH")
    which.add_argument("--arducopter", metavar="PATH", help="ArduPilot: its tree, or arducopter")
    which.add_argument("--fake", action="store_true", help="the fake fleet")
    add = parser.add_argument
    add("--vehicles", type=int, default=4, metavar="N", help=f"2 to {VEHICLES_MAX}; 4")
    kinds = (*AUTOPILOTS, MIXED)
    add("--autopilot", choices=kinds, help="with --fake; or which one is looked for, if none is named")
    add("--version", default="", metavar="V", help="with --fake: 1.18, 4.7, or of a mixed fleet 1.16,4.5")
    add("--seed", type=int, default=0, metavar="N", help="with --fake")
    transports = get_args(LinkSettings.model_fields["transport"].annotation)
    add("--transport", choices=transports, default="mavsdk", help="of the service; mavsdk")
    add("--stations", type=int, choices=(1, 2), default=1, help="2: their own story")
    add("--story", choices=tuple(sitl_chapters.STORIES), default="whole", help="what is flown; whole")
    spacing = f"between pads; {PADS_M:g}, with --story long {LONG_PADS_M:g}"
    add("--spacing", type=float, metavar="M", help=spacing)
    add("--quick", action="store_true", help="shorter steady windows")
    add("--any-machine", action="store_true", help="failsafes against a slow machine are off, as with --fake")
    add("--port-base", type=int, default=STATION_PORT, metavar="P", help="PX4 itself sends to the default")
    add("--simulator-port", type=int, default=SIMULATOR_PORT, metavar="P", help="the same")
    add("--fdm-port", type=int, default=FDM_PORT, metavar="P", help="ArduCopter itself sends to the default")
    add("--keep", metavar="FOLDER", help="keep logs, record and configuration there")
    return parser


def _run(given: argparse.Namespace, folder: Path) -> int:
    if not 2 <= given.vehicles <= VEHICLES_MAX:
        return _not_flown(f"--vehicles {given.vehicles}: 2 to {VEHICLES_MAX} is possible")
    lost = given.vehicles - 1
    frame = configuration.load(configuration.find(CONFIG)).frame
    try:
        simulators = _simulators(given, Pads(frame, given.vehicles, _spacing_m(given)), folder, lost)
        config = make_config(given, simulators.kinds)
        if isinstance(simulators, FakeFleet):
            simulators.kept = parameter_options(settings_of(config, given.version))
        service = Service(config, folder)
        fdm_port = given.fdm_port if isinstance(simulators, ArduCopter) else None
        with (
            GroundTruthRecorder(given.simulator_port, given.vehicles, fdm_port=fdm_port) as truth,
            closing(simulators),
            closing(service),
        ):
            simulators.start()
            _wait_for_states(truth, simulators)
            service.apply_parameters()
            service.start()
            flight = SitlFlight(
                service,
                simulators,
                truth,
                lost=lost,
                pace=QUICK if given.quick else Pace(),
                say=_say_from(time.monotonic()),
            )
            with flight.followed():
                sitl_chapters.fly(flight, _story(given))
        figures = judge(truth, flight.account, config)
    except (OSError, ServiceError, ValueError, subprocess.SubprocessError) as error:
        return _not_flown(str(error))
    figures = {"autopilot": simulators.autopilot, "vehicles": given.vehicles} | figures
    print(report.summary(figures))
    print(json.dumps(figures))
    return 0 if figures["verdict"] == "kept" else 1


def _story(given: argparse.Namespace) -> sitl_chapters.Story:
    return sitl_chapters.STORIES[given.story] if given.stations == 1 else sitl_chapters.TWO_STATIONS


def _wait_for_states(truth: GroundTruthRecorder, simulators: Simulators) -> None:
    """Raises: ServiceError naming the simulators that have ended, or send nothing."""
    end_s = time.monotonic() + SPEAKS_S
    while silent := truth.silent:
        if ended := simulators.ended():
            raise ServiceError(f"{simulators.autopilot} does not run: {ended}")
        if time.monotonic() > end_s:
            raise ServiceError(f"no true state was received from instances {silent} within {SPEAKS_S:g} s")
        time.sleep(0.1)


def make_config(given: argparse.Namespace, kinds: Sequence[str]) -> configuration.Config:
    """The shipped configuration for PX4 SITL, for these vehicles, with an API port that is free.

    The vehicles have the autopilots `kinds` in turn. Where one of these flies on without setpoints for a
    time of its own, all do. Clocks are not compared: a simulation's is not the machine's. With the fake fleet
    the program is tested, not the machine: no failsafe against a slow machine acts.
    """
    raw = configuration.load(configuration.find(CONFIG)).model_dump()
    share = -(-given.vehicles // given.stations)
    vehicles = [
        {"id": f"d{number}", "system_id": number, "autopilot": kind}
        for number, kind in zip(range(1, given.vehicles + 1), cycle(kinds))
    ]
    raw["links"] = [
        raw["links"][0]
        | {
            "name": f"sitl{at // share + 1}",
            "transport": given.transport,
            "listen": f"udpin://127.0.0.1:{given.port_base + at}",
            "ports": len(vehicles[at : at + share]),
            "vehicles": vehicles[at : at + share],
        }
        for at in range(0, given.vehicles, share)
    ]
    if not all(_alone(kind, raw).changes_mode for kind in kinds):
        raw["operation"]["setpoint_loss_s"] = MIXED_LOSS_S
    raw["preflight"]["clock_max_s"] = None
    raw["api"]["port"] = 0
    if given.fake or given.any_machine:
        for cause in ("service_late", "links_late", "wind"):
            raw["failsafes"][cause]["action"] = "ignore"
    if given.stations > 1:
        demo_site.add_stations(raw, given.stations)
    return configuration.Config.model_validate(raw)


def _alone(kind: str, raw: dict[str, Any]) -> WithoutSetpoints:
    operation = raw["operation"]
    return AUTOPILOTS[kind].without_setpoints(
        operation["setpoint_loss_action"], operation["setpoint_loss_s"], {}
    )


def _spacing_m(given: argparse.Namespace) -> float:
    if given.spacing is not None:
        return float(given.spacing)
    return LONG_PADS_M if given.story == "long" else PADS_M


def _simulators(given: argparse.Namespace, pads: Pads, folder: Path, lost: int) -> Simulators:
    """Those that are named, or that are found. Raises: NotFoundError."""
    ports = {"port": given.port_base, "simulator_port": given.simulator_port}
    if given.fake:
        kind = given.autopilot or DEFAULT.name
        options = FakeOptions(
            **ports, autopilot=kind, version=given.version, seed=given.seed, at_once=given.quick
        )
        return FakeFleet(pads, folder, options, lost=lost)
    if given.image is not None:
        return Px4Image(given.image, pads, folder)
    makers: dict[str, Callable[[], Simulators]] = {
        "px4": lambda: Px4Build(given.px4, pads, folder),
        "ardupilot": lambda: ArduCopter(given.arducopter, pads, folder, **ports),
    }
    named = {"px4": given.px4, "ardupilot": given.arducopter}
    if any(named.values()):
        return next(makers[kind]() for kind, path in named.items() if path)
    missing = []
    for kind, make in makers.items():
        if given.autopilot in {None, kind}:
            try:
                return make()
            except NotFoundError as error:
                missing.append(str(error))
    if given.autopilot == MIXED:
        missing = ["AUTOPILOT=mixed flies with FAKE=1 only"]
    raise NotFoundError("\n".join([*missing, "Or without any of them: make sitl FAKE=1"]))


def _say_from(began_s: float) -> Callable[[str], None]:
    def say(text: str) -> None:
        print(f"[{time.monotonic() - began_s:6.1f} s] {text}", flush=True)

    return say


def _not_flown(why: str) -> int:
    print(f"make sitl: {why}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
