"""The options of the fake fleet, group by group as `--help` shows them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.sim import arguments
from gcs.sim.fleet import MAX_SYSTEM_ID, Origin
from gcs.sim.ports import MAX_PORT
from gcs.sim.simulator_link import FIRST_PORT
from gcs.sim.vehicle import quirks

if TYPE_CHECKING:
    import argparse

MAX_COUNT = 10_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the fleet's options to any parser."""
    _add_vehicles(parser.add_argument_group("vehicles"))
    _add_ports(parser.add_argument_group("ports and telemetry"))
    _add_place(parser.add_argument_group("place and start grid"))
    _add_behaviour(parser.add_argument_group("how they fly"))
    _add_truth(parser.add_argument_group("true states"))
    _add_faults(parser.add_argument_group("faults"))


def _add_vehicles(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--count", type=arguments.whole(1, MAX_COUNT), default=1, metavar="N", help="vehicles in this process"
    )
    group.add_argument(
        "--first",
        type=arguments.whole(0, MAX_COUNT - 1),
        default=0,
        metavar="I",
        help="index of the first; its number is I+1, and so is its id, up to the namespace's size",
    )
    group.add_argument(
        "--namespace-size",
        type=arguments.whole(1, MAX_SYSTEM_ID),
        default=MAX_SYSTEM_ID,
        metavar="S",
        help="system ids per namespace: vehicle i has id i %% S + 1 in namespace i // S, "
        "which has ports of its own",
    )
    group.add_argument(
        "--seed", type=arguments.whole(0, 2**63 - 1), default=0, metavar="N", help="of everything random"
    )


def _add_ports(group: argparse._ArgumentGroup) -> None:
    ports = group.add_mutually_exclusive_group()
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
    group.add_argument(
        "--shared-port",
        action="store_true",
        help="one socket per namespace, as behind a radio: it binds 14580+k and talks to 14540+k, "
        "or with --port-base to P+k",
    )
    group.add_argument(
        "--telemetry-hz",
        type=arguments.number(0.1, 250.0),
        metavar="HZ",
        help="only what a large fleet needs: GLOBAL_POSITION_INT at HZ, the state once or twice a second "
        "(otherwise all of PX4's streams at its rates: 520 messages a second and vehicle)",
    )


def _add_place(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--origin",
        type=arguments.origin,
        default=Origin(),
        metavar="LAT,LON,ALT",
        help="degrees, metres AMSL: the ground",
    )
    group.add_argument(
        "--spacing", type=arguments.number(0.0, 1e5), default=4.0, metavar="M", help="of the start grid"
    )
    group.add_argument(
        "--grid-columns",
        type=arguments.whole(1, 10**6),
        metavar="C",
        help="vehicle i starts at row i // C (north), column i %% C (east)",
    )
    group.add_argument(
        "--grid-at",
        type=arguments.pair("N,E"),
        default=(0.0, 0.0),
        metavar="N,E",
        help="where vehicle 0 of the grid stands, m north and east of the origin",
    )
    group.add_argument(
        "--grid-heading",
        type=arguments.number(-360.0, 360.0),
        default=0.0,
        metavar="DEG",
        help="where the grid's rows lead, clockwise from north; columns are to the right",
    )
    group.add_argument(
        "--heading", type=arguments.number(-360.0, 360.0), default=0.0, metavar="DEG", help="initial yaw"
    )


def _add_behaviour(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--noise",
        type=arguments.number(0.0, 100.0),
        default=1.0,
        metavar="SCALE",
        help="estimate error; 1 as measured, 0 none",
    )
    group.add_argument(
        "--drag",
        type=arguments.number(0.0, 10.0),
        default=1.0,
        metavar="PER_S",
        help="1.0 is PX4's simulator; real 0.1 to 0.3",
    )
    group.add_argument(
        "--wind",
        type=arguments.triple("N,E,D"),
        default=(0.0, 0.0, 0.0),
        metavar="N,E,D",
        help="of the air, m/s",
    )
    group.add_argument(
        "--battery",
        type=arguments.number(0.1, 1e5),
        default=20.0,
        metavar="MIN",
        help="flight time of a full battery",
    )
    group.add_argument(
        "--param",
        type=arguments.parameter,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="PX4 parameter of every vehicle, for instance COM_OBL_RC_ACT=5 (repeatable)",
    )
    group.add_argument(
        "--quirk",
        type=arguments.quirk,
        action="append",
        default=[],
        metavar="NAME=off",
        help=f"make PX4 behave as one would wish (repeatable): {', '.join(quirks.names())}",
    )


def _add_truth(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--truth", metavar="FILE", help="write the true states to FILE as JSON Lines, 20 a second"
    )
    group.add_argument(
        "--simulator-link",
        type=arguments.whole(1, MAX_PORT),
        nargs="?",
        const=FIRST_PORT,
        metavar="P",
        help="vehicle i sends its true state as HIL_STATE_QUATERNION to port P+i, as PX4's SIH does; "
        f"{FIRST_PORT} without P",
    )


def _add_faults(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--control",
        type=arguments.whole(1, MAX_PORT),
        metavar="PORT",
        help='receive faults as JSON on that UDP port, as in {"vehicle": 3, "fault": "loss", "share": 0.3}',
    )
    group.add_argument("--faults-from", choices=["-"], help="the same, line by line, from standard input")
