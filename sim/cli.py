"""The command line of the fake fleet: `python -m gcs.sim`, and the same arguments for `gcs sim`."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from typing import TYPE_CHECKING

from gcs.sim import arguments, quirks
from gcs.sim.endpoint import PortError
from gcs.sim.fleet import MAX_SYSTEM_ID, Origin, Settings
from gcs.sim.ports import HOST, MAX_PORT, Port, own_ports, shared_ports
from gcs.sim.quirks import Quirks
from gcs.sim.server import serve
from gcs.sim.simulator_link import FIRST_PORT
from gcs.sim.streams import RECORDED_HZ, lean_hz
from gcs.sim.truth import TruthFile

if TYPE_CHECKING:
    from collections.abc import Sequence

MAX_COUNT = 10_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the fleet's options to any parser."""
    add = parser.add_argument
    add(
        "--count", type=arguments.whole(1, MAX_COUNT), default=1, metavar="N", help="vehicles in this process"
    )
    add(
        "--first",
        type=arguments.whole(0, MAX_COUNT - 1),
        default=0,
        metavar="I",
        help="index of the first; its number is I+1, and so is its id, up to the namespace's size",
    )
    add(
        "--namespace-size",
        type=arguments.whole(1, MAX_SYSTEM_ID),
        default=MAX_SYSTEM_ID,
        metavar="S",
        help="system ids per namespace: vehicle i has id i %% S + 1 in namespace i // S, "
        "which has ports of its own",
    )
    ports = parser.add_mutually_exclusive_group()
    ports.add_argument(
        "--ports",
        choices=["px4"],
        help="as PX4: vehicle i binds 14580+i and talks to 14540+i (14549 from i = 10 on)",
    )
    ports.add_argument(
        "--port-base",
        type=arguments.whole(1, MAX_PORT),
        metavar="P",
        help="vehicle i talks to P+i, from a port of its own",
    )
    add(
        "--shared-port",
        action="store_true",
        help="one socket per namespace, as behind a radio: it binds 14580+k and talks to 14540+k, "
        "or with --port-base to P+k",
    )
    add(
        "--telemetry-hz",
        type=arguments.number(0.1, 250.0),
        metavar="HZ",
        help="only what a large fleet needs: GLOBAL_POSITION_INT at HZ, the state once or twice a second "
        "(otherwise all of PX4's streams at its rates: 520 messages a second and vehicle)",
    )
    add("--truth", metavar="FILE", help="write the true states to FILE as JSON Lines, 20 a second")
    add(
        "--simulator-link",
        type=arguments.whole(1, MAX_PORT),
        nargs="?",
        const=FIRST_PORT,
        metavar="P",
        help="vehicle i sends its true state as HIL_STATE_QUATERNION to port P+i, as PX4's SIH does; "
        f"{FIRST_PORT} without P",
    )
    add("--seed", type=arguments.whole(0, 2**63 - 1), default=0, help="of everything random")
    add(
        "--noise",
        type=arguments.number(0.0, 100.0),
        default=1.0,
        metavar="SCALE",
        help="estimate error; 1 as measured, 0 none",
    )
    add(
        "--drag",
        type=arguments.number(0.0, 10.0),
        default=1.0,
        metavar="PER_S",
        help="1.0 is PX4's simulator; real 0.1 to 0.3",
    )
    add(
        "--wind",
        type=arguments.triple("N,E,D"),
        default=(0.0, 0.0, 0.0),
        metavar="N,E,D",
        help="of the air, m/s",
    )
    add(
        "--origin",
        type=arguments.origin,
        default=Origin(),
        metavar="LAT,LON,ALT",
        help="degrees, metres AMSL: the ground",
    )
    add("--spacing", type=arguments.number(0.0, 1e5), default=4.0, metavar="M", help="of the start grid")
    add(
        "--grid-columns",
        type=arguments.whole(1, 10**6),
        metavar="C",
        help="vehicle i starts at row i // C (north), column i %% C (east)",
    )
    add(
        "--grid-at",
        type=arguments.pair("N,E"),
        default=(0.0, 0.0),
        metavar="N,E",
        help="where vehicle 0 of the grid stands, m north and east of the origin",
    )
    add(
        "--grid-heading",
        type=arguments.number(-360.0, 360.0),
        default=0.0,
        metavar="DEG",
        help="where the grid's rows lead, clockwise from north; columns are to the right",
    )
    add("--heading", type=arguments.number(-360.0, 360.0), default=0.0, metavar="DEG", help="initial yaw")
    add(
        "--battery",
        type=arguments.number(0.1, 1e5),
        default=20.0,
        metavar="MIN",
        help="flight time of a full battery",
    )
    add(
        "--param",
        type=arguments.parameter,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="PX4 parameter of every vehicle, for instance COM_OBL_RC_ACT=5 (repeatable)",
    )
    add(
        "--quirk",
        type=arguments.quirk,
        action="append",
        default=[],
        metavar="NAME=off",
        help=f"make PX4 behave as one would wish (repeatable): {', '.join(quirks.names())}",
    )
    add(
        "--control",
        type=arguments.whole(1, MAX_PORT),
        metavar="PORT",
        help='hear faults as JSON on that UDP port, as in {"vehicle": 3, "fault": "loss", "share": 0.3}',
    )
    add("--faults-from", choices=["-"], help="the same, line by line, from standard input")


def build_parser() -> argparse.ArgumentParser:
    """The parser of `python -m gcs.sim`."""
    parser = argparse.ArgumentParser(
        prog="sim", description="A fleet of fake PX4 vehicles that speak MAVLink 2."
    )
    add_arguments(parser)
    return parser


def run(given: argparse.Namespace) -> int:
    """Fly until interrupted. Returns the exit code: 0, 1 for a taken port or file, 2 for bad arguments."""
    last = given.first + given.count
    if last > MAX_COUNT:
        return _fail(2, f"--first {given.first} --count {given.count}: at most {MAX_COUNT - given.first} fit")
    ports = _ports(given)
    if max(max(port.destination, port.bind) for port in ports) > MAX_PORT:
        return _fail(2, f"--port-base {given.port_base} leads beyond port {MAX_PORT}; choose a lower one")
    if given.simulator_link is not None and given.simulator_link + last > MAX_PORT:
        return _fail(2, f"--simulator-link {given.simulator_link} leads beyond port {MAX_PORT}")
    with contextlib.ExitStack() as stack:
        try:
            file = None if given.truth is None else stack.enter_context(open(given.truth, "w"))  # noqa: PTH123
        except OSError as error:
            return _fail(1, f"--truth {given.truth}: {error.strerror}")
        truth = None if file is None else TruthFile(file)
        try:
            serve(
                _settings(given),
                ports,
                truth,
                _greeting(given, ports),
                control_port=given.control,
                control_input=given.faults_from is not None,
                simulator_port=given.simulator_link,
            )
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


def _ports(given: argparse.Namespace) -> list[Port]:
    make = shared_ports if given.shared_port else own_ports
    return make(given.first, given.count, given.namespace_size, given.port_base)


def _greeting(given: argparse.Namespace, ports: Sequence[Port]) -> str:
    vehicles = f"{given.count} vehicle" + ("s" if given.count > 1 else "")
    return f"sim: {vehicles}, {_ids(given)}, udp {HOST}:{_span([port.destination for port in ports])}"


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


def _fail(code: int, message: str) -> int:
    print(f"sim: {message}", file=sys.stderr)  # noqa: T201 - the command's output
    return code
