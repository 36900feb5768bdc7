"""The command line of the fake fleet: `python -m sim`, and the same arguments for `gcs sim`."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import math
import sys
from typing import TYPE_CHECKING

from sim.fleet import Origin, Settings
from sim.params import ParameterError, Parameters, Value, defaults
from sim.server import HOST, Port, PortError, serve
from sim.truth import TruthFile

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

MAX_SYSTEM_ID = 250
PX4_BIND, PX4_DESTINATION, PX4_SHARED_FROM = 14580, 14540, 9
MAX_PORT = 65535


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the fleet's options to any parser."""
    add = parser.add_argument
    add("--count", type=_whole(1, MAX_SYSTEM_ID), default=1, metavar="N", help="vehicles in this process")
    add(
        "--first",
        type=_whole(0, MAX_SYSTEM_ID - 1),
        default=0,
        metavar="I",
        help="index of the first; its id is I+1",
    )
    ports = parser.add_mutually_exclusive_group()
    ports.add_argument(
        "--ports",
        choices=["px4"],
        help="as PX4: vehicle i binds 14580+i and talks to 14540+i (14549 from i = 10 on)",
    )
    ports.add_argument(
        "--port-base",
        type=_whole(1, MAX_PORT),
        metavar="P",
        help="vehicle i talks to P+i, from a port of its own",
    )
    add("--truth", metavar="FILE", help="write the true states to FILE as JSON Lines, 20 a second")
    add("--seed", type=_whole(0, 2**63 - 1), default=0, help="of everything random")
    add(
        "--noise",
        type=_number(0.0, 100.0),
        default=1.0,
        metavar="SCALE",
        help="estimate error; 1 as measured, 0 none",
    )
    add(
        "--drag",
        type=_number(0.0, 10.0),
        default=1.0,
        metavar="PER_S",
        help="1.0 is PX4's simulator; real 0.1 to 0.3",
    )
    add("--wind", type=_triple("N,E,D"), default=(0.0, 0.0, 0.0), metavar="N,E,D", help="of the air, m/s")
    add(
        "--origin",
        type=_origin,
        default=Origin(),
        metavar="LAT,LON,ALT",
        help="degrees, metres AMSL: the ground",
    )
    add("--spacing", type=_number(0.0, 1e5), default=4.0, metavar="M", help="of the start grid")
    add(
        "--grid-columns",
        type=_whole(1, 10**6),
        metavar="C",
        help="vehicle i starts at row i // C (north), column i %% C (east)",
    )
    add("--heading", type=_number(-360.0, 360.0), default=0.0, metavar="DEG", help="initial yaw")
    add(
        "--battery", type=_number(0.1, 1e5), default=20.0, metavar="MIN", help="flight time of a full battery"
    )
    add(
        "--param",
        type=_parameter,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="PX4 parameter of every vehicle, for instance COM_OBL_RC_ACT=5 (repeatable)",
    )


def build_parser() -> argparse.ArgumentParser:
    """The parser of `python -m sim`."""
    parser = argparse.ArgumentParser(
        prog="sim", description="A fleet of fake PX4 vehicles that speak MAVLink 2."
    )
    add_arguments(parser)
    return parser


def run(arguments: argparse.Namespace) -> int:
    """Fly until interrupted. Returns the exit code: 0, 1 for a taken port or file, 2 for bad arguments."""
    last = arguments.first + arguments.count
    if last > MAX_SYSTEM_ID:
        return _fail(
            2,
            f"--first {arguments.first} --count {arguments.count} needs system ids up to {last}; "
            f"at most {MAX_SYSTEM_ID} exist, so --count can be {MAX_SYSTEM_ID - arguments.first} at most",
        )
    ports = _ports(arguments)
    if max(port.destination for port in ports) > MAX_PORT:
        return _fail(2, f"--port-base {arguments.port_base} leads beyond port {MAX_PORT}; choose a lower one")
    with contextlib.ExitStack() as stack:
        try:
            file = None if arguments.truth is None else stack.enter_context(open(arguments.truth, "w"))  # noqa: PTH123
        except OSError as error:
            return _fail(1, f"--truth {arguments.truth}: {error.strerror}")
        truth = None if file is None else TruthFile(file)
        try:
            asyncio.run(serve(_settings(arguments), ports, truth, _greeting(arguments, ports)))
        except PortError as error:
            return _fail(
                1,
                f"{error}; is another sim or PX4 running? "
                "Stop it, or choose other ports with --first or --port-base",
            )
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Parse and run."""
    return run(build_parser().parse_args(argv))


def _settings(arguments: argparse.Namespace) -> Settings:
    columns = arguments.grid_columns or math.ceil(math.sqrt(arguments.count))
    return Settings(
        count=arguments.count,
        first=arguments.first,
        seed=arguments.seed,
        noise_scale=arguments.noise,
        drag_per_s=arguments.drag,
        wind_m_s=arguments.wind,
        origin=arguments.origin,
        spacing_m=arguments.spacing,
        grid_columns=columns,
        heading_deg=arguments.heading,
        endurance_s=60.0 * arguments.battery,
        parameters=dict(arguments.param),
    )


def _ports(arguments: argparse.Namespace) -> list[Port]:
    indices = range(arguments.first, arguments.first + arguments.count)
    if arguments.port_base is not None:
        return [Port(0, arguments.port_base + i) for i in indices]
    return [Port(PX4_BIND + i, PX4_DESTINATION + min(i, PX4_SHARED_FROM)) for i in indices]


def _greeting(arguments: argparse.Namespace, ports: Sequence[Port]) -> str:
    first, last = arguments.first + 1, arguments.first + arguments.count
    vehicles = f"{arguments.count} vehicle" + ("s" if arguments.count > 1 else "")
    ids = f"system id {first}" if first == last else f"system ids {first}-{last}"
    low, high = ports[0].destination, ports[-1].destination
    return f"sim: {vehicles}, {ids}, udp {HOST}:{low}" + ("" if low == high else f"-{high}")


def _fail(code: int, message: str) -> int:
    print(f"sim: {message}", file=sys.stderr)  # noqa: T201 - the command's output
    return code


def _whole(low: int, high: int) -> Callable[[str], int]:
    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {low} to {high}")
        return value

    return parse


def _number(low: float, high: float) -> Callable[[str], float]:
    def parse(text: str) -> float:
        value = _float(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number from {low:g} to {high:g}")
        return value

    return parse


def _float(text: str) -> float:
    """The number, or NaN, which is inside no range."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _triple(form: str) -> Callable[[str], tuple[float, float, float]]:
    def parse(text: str) -> tuple[float, float, float]:
        values = [_float(part) for part in text.split(",")]
        if len(values) != 3 or not all(map(math.isfinite, values)):
            raise argparse.ArgumentTypeError(
                f"{text!r} is not {form}: three numbers with commas between them"
            )
        return values[0], values[1], values[2]

    return parse


def _origin(text: str) -> Origin:
    latitude_deg, longitude_deg, altitude_amsl_m = _triple("LAT,LON,ALT")(text)
    if not (abs(latitude_deg) <= 90 and abs(longitude_deg) <= 180):
        raise argparse.ArgumentTypeError(
            f"{text!r}: latitude goes from -90 to 90, longitude from -180 to 180 degrees"
        )
    return Origin(latitude_deg, longitude_deg, altitude_amsl_m)


def _parameter(text: str) -> tuple[str, Value]:
    name, separator, number = text.partition("=")
    value = _float(number)
    if not separator or not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE, as in COM_OBL_RC_ACT=5")
    try:
        Parameters({name: value})
    except ParameterError as error:
        near = [known for known in defaults() if known.startswith(name.split("_")[0] + "_")][:5]
        hint = f"; there are {', '.join(near)} ..." if near and name not in defaults() else ""
        raise argparse.ArgumentTypeError(f"{error}{hint}") from None
    return name, value
