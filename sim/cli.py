"""The command line of the fake fleet: `python -m gcs.sim`, and the same arguments for `gcs sim`."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from typing import TYPE_CHECKING

from gcs.sim.endpoint import PortError
from gcs.sim.fleet import Settings
from gcs.sim.ground_truth import GroundTruthFile
from gcs.sim.options import MAX_COUNT, add_arguments
from gcs.sim.ports import HOST, MAX_PORT, Port, own_ports, shared_ports
from gcs.sim.protocol.streams import RECORDED_HZ, lean_hz
from gcs.sim.server import serve
from gcs.sim.vehicle.quirks import Quirks

if TYPE_CHECKING:
    from collections.abc import Sequence


class FleetError(Exception):
    """The fleet cannot be flown with these arguments.

    Attributes:
        code: the exit code: 1 for a taken port or file, 2 for bad arguments.
    """

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code


def build_parser() -> argparse.ArgumentParser:
    """The parser of `python -m gcs.sim`."""
    parser = argparse.ArgumentParser(
        prog="sim", description="A fleet of fake PX4 vehicles that speak MAVLink 2."
    )
    add_arguments(parser)
    return parser


def run(given: argparse.Namespace) -> int:
    """Fly until interrupted. Returns the exit code: 0, 1 for a taken port or file, 2 for bad arguments."""
    try:
        fly(given, greeting(given))
    except FleetError as error:
        print(f"sim: {error}", file=sys.stderr)  # noqa: T201 - the command's output
        return error.code
    return 0


def fly(given: argparse.Namespace, greeting: str) -> None:
    """Fly until SIGINT or SIGTERM; print the greeting when the fleet can be reached.

    Raises:
        FleetError: a port or file is taken, or the arguments exceed the possible vehicles or ports.
    """
    ports = _checked_ports(given)
    with contextlib.ExitStack() as stack:
        try:
            file = None if given.truth is None else stack.enter_context(open(given.truth, "w"))  # noqa: PTH123
        except OSError as error:
            raise FleetError(1, f"--truth {given.truth}: {error.strerror}") from error
        truth = None if file is None else GroundTruthFile(file)
        try:
            serve(
                _settings(given),
                ports,
                truth,
                greeting,
                control_port=given.control,
                control_input=given.faults_from is not None,
                simulator_port=given.simulator_link,
            )
        except PortError as error:
            advice = "Stop it, or choose other ports with --first or --port-base"
            raise FleetError(1, f"{error}; is another sim or PX4 running? {advice}") from error


def main(argv: Sequence[str] | None = None) -> int:
    """Parse and run."""
    return run(build_parser().parse_args(argv))


def _settings(given: argparse.Namespace) -> Settings:
    columns = given.grid_columns or math.ceil(math.sqrt(given.count))
    return Settings(
        count=given.count,
        first=given.first,
        namespace_size=given.namespace_size,
        seed=given.seed,
        noise_scale=given.noise,
        drag_per_s=given.drag,
        wind_m_s=given.wind,
        origin=given.origin,
        spacing_m=given.spacing,
        grid_columns=columns,
        grid_at_m=given.grid_at,
        grid_heading_deg=given.grid_heading,
        heading_deg=given.heading,
        endurance_s=60.0 * given.battery,
        parameters=dict(given.param),
        quirks=Quirks().changed(given.quirk),
        rates_hz=RECORDED_HZ if given.telemetry_hz is None else lean_hz(given.telemetry_hz),
    )


def _checked_ports(given: argparse.Namespace) -> list[Port]:
    """Raises: FleetError where vehicles or ports exceed the possible ones."""
    last = given.first + given.count
    if last > MAX_COUNT:
        fit = f"at most {MAX_COUNT - given.first} fit"
        raise FleetError(2, f"--first {given.first} --count {given.count}: {fit}")
    ports = _ports(given)
    if max(max(port.destination, port.bind) for port in ports) > MAX_PORT:
        text = f"--port-base {given.port_base} leads beyond port {MAX_PORT}; choose a lower one"
        raise FleetError(2, text)
    if given.simulator_link is not None and given.simulator_link + last > MAX_PORT:
        raise FleetError(2, f"--simulator-link {given.simulator_link} leads beyond port {MAX_PORT}")
    return ports


def _ports(given: argparse.Namespace) -> list[Port]:
    make = shared_ports if given.shared_port else own_ports
    return make(given.first, given.count, given.namespace_size, given.port_base)


def destinations(given: argparse.Namespace) -> list[int]:
    """The UDP ports that the vehicles send to. Raises: FleetError."""
    return [port.destination for port in _checked_ports(given)]


def greeting(given: argparse.Namespace) -> str:
    """Number of vehicles, their ids and ports, in words. Raises: FleetError."""
    vehicles = f"{given.count} vehicle" + ("s" if given.count > 1 else "")
    return f"sim: {vehicles}, {_ids(given)}, udp {HOST}:{_span(destinations(given))}"


def _ids(given: argparse.Namespace) -> str:
    """The system ids, by namespace where there are several."""
    size, first, last = given.namespace_size, given.first, given.first + given.count - 1
    if first // size == last // size:
        ids = _span([first % size + 1, last % size + 1])
        return f"system id{'' if first == last else 's'} {ids}"
    return f"system ids {first % size + 1}-{size} and on in namespaces {_span([first // size, last // size])}"


def _span(numbers: Sequence[int]) -> str:
    low, high = min(numbers), max(numbers)
    return str(low) if low == high else f"{low}-{high}"
