"""Arguments of commands with slow imports, so that their parsers need no such import."""

import argparse
from math import isfinite, nan
from typing import Any, Final

from gcs.cli.service import supervisor
from gcs.simulation import ROWS

TRANSPORTS: Final = ("native", "mavsdk")
RECEIVED_S: Final = 8.0
"""Default time to wait for the vehicles' first messages."""


def add_demo_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--vehicles", type=int, default=8, metavar="N", help="2 to 50, native: to 1000; 8")
    parser.add_argument(
        "--transport",
        choices=TRANSPORTS,
        default="mavsdk",
        help="native: without MAVSDK, up to 250 vehicles a port; as much of the story as fits; mavsdk",
    )
    text = "of the fake fleet: px4, ardupilot, or mixed, each in turn; px4"
    parser.add_argument("--autopilot", metavar="NAME", help=text)
    parser.add_argument(
        "--stations", type=int, default=1, metavar="N", help="processes that share the fleet, native; 1"
    )
    parser.add_argument(
        "--seconds", type=float, metavar="S", help="of the whole flight; 240, or as many as the story takes"
    )
    parser.add_argument("--law", metavar="NAME", help="of the formation, as gcs law list has them; slots")
    parser.add_argument("--show", metavar="NAME", help="fly this show file instead of the story")
    text = "follow a boat that sends nmea, gpsd, cot or mavlink, instead of the story"
    parser.add_argument("--target", choices=("nmea", "gpsd", "cot", "mavlink"), help=text)
    text = "send the vehicles as tracks to where people have TAK: udp://, tcp:// or tls://HOST:PORT"
    parser.add_argument("--tak", metavar="URL", help=text)
    text = "the fake fleet has exact positions and RTK, which shows drawn closer than 4.3 m need"
    parser.add_argument("--ideal", action="store_true", help=text)
    parser.add_argument("--seed", type=int, default=0, help="of the fake fleet")
    parser.add_argument("--api-port", type=int, metavar="P", help="8000; 0: any that is free")
    parser.add_argument("--port-base", type=int, default=14540, metavar="P", help="UDP port of the first")
    parser.add_argument("--truth", metavar="DIR", help="keep the vehicles' true states there")
    parser.add_argument("--record", metavar="DIR", help="keep the record of the flight there; gcs report DIR")
    parser.add_argument("--verbose", action="store_true", help="log every change of state, on stderr")


def add_serve_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--config", required=True, metavar="FILE", help="a YAML file, or the name of one that is shipped"
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        supervisor.STATION, metavar="NAME", help="of a configuration with stations: this one of them"
    )
    which.add_argument(
        supervisor.ALL,
        action="store_true",
        help="every station, each in a process of its own, on this machine",
    )
    parser.add_argument("--host", help="where the API listens; default 127.0.0.1")
    parser.add_argument("--port", type=int, help="of the API; default 8000")
    text = "let formation.law name code beside the configuration: module:Class"
    parser.add_argument("--allow-law-code", action="store_true", help=text)
    parser.add_argument("--quiet", action="store_true", help="log warnings only")
    parser.add_argument(
        supervisor.OPTION, action="store_true", help="by a parent that starts it again when it ends or hangs"
    )


def _numbers(names: str, *, fewer: bool = False) -> dict[str, Any]:
    """Return what makes an option of finite numbers with commas between them; `fewer`: NaN where none is."""
    count = names.count(",") + 1

    def parse(text: str) -> tuple[float, ...]:
        parts = text.split(",")
        try:
            numbers = tuple(nan if fewer and not part.strip() else float(part) for part in parts)
        except ValueError:
            numbers = ()
        given = [number for part, number in zip(parts, numbers, strict=False) if part.strip()]
        if len(numbers) != count or not all(map(isfinite, given)):
            needed = f"{count} numbers with commas between them are needed: {names}"
            raise argparse.ArgumentTypeError(f"{text}: {needed}")
        return numbers

    return {"type": parse, "metavar": names}


PLACE: Final = _numbers("LAT,LON,ALT,HEADING")


def add_show_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", required=True)
    check = actions.add_parser("check", help="fly it in virtual time; say what is wrong, by line and cue")
    plot = actions.add_parser("plot", help="draw it: paths, and what happens when")
    digest = actions.add_parser("hash", help="what a start must name: the hash of all that is flown")
    for action in (check, plot, digest):
        action.add_argument("file", metavar="FILE", help="a show file, or the name of one that is shipped")
    for action in (check, plot):
        action.add_argument("--seed", type=int, default=1, metavar="S", help="of the vehicles' errors; 1")
    _add_adversity(check)
    plot.add_argument("picture", metavar="OUT.png", help="a .png, .svg or .pdf file")
    brought = actions.add_parser("import", help="make a show of a file that another program wrote")
    brought.add_argument("file", metavar="FILE", help="a .skyc, a .zip of CSV files, or a polynomial's .csv")
    brought.add_argument("-o", "--output", required=True, metavar="NAME.yaml", help="the show file to write")
    brought.add_argument("--origin", **PLACE, help="of the show; as the file has it")
    brought.add_argument("--origin-else", **PLACE, help="of the show where the file names no place")
    brought.add_argument(
        "--endurance", type=float, default=900.0, metavar="S", help="of a vehicle in the air; 900"
    )
    sampled = actions.add_parser("sample", help="print positions and colours of a drawn show, as JSON")
    sampled.add_argument("file", metavar="FILE", help="the show file of a drawn show")
    sampled.add_argument(
        "--from", dest="from_s", type=float, default=0.0, metavar="S", help="show's clock; 0"
    )
    sampled.add_argument("--to", dest="to_s", type=float, metavar="S", help="show's clock; its end")
    sampled.add_argument("--rate", type=float, default=4.0, metavar="HZ", help="lowered for many vehicles; 4")
    placed = actions.add_parser("place", help="move, turn or fit a drawn show with its pads")
    placed.add_argument("file", metavar="FILE", help="the show file of a drawn show")
    placed.add_argument(
        "--at", **_numbers("X,Y,TURN", fewer=True), help="metres, and degrees clockwise; as the file has it"
    )
    placed.add_argument("--fit", action="store_true", help="fit the pads to where the vehicles stand")
    placed.add_argument("--vehicles", metavar="FILE.json", help='their places: {"d1": [x, y], "d2": null}')
    placed.add_argument("--frame", **PLACE, help="origin of these; as the file has it")
    placed.add_argument("-o", "--output", metavar="NAME.yaml", help="write the show file with this placement")
    service = "of the service that is to fly it: "
    for action, text in (
        (brought, f"{service}the show file gets its take-off, limits and fence"),
        (placed, f"{service}the show file gets its take-off, limits and fence"),
        (check, f"{service}the show must fit its frame, its limits and the areas of its site"),
    ):
        action.add_argument("--config", metavar="FILE", help=text)
        action.add_argument("--rules", help=argparse.SUPPRESS)  # of the service that calls, as JSON
    taken = actions.add_parser(
        "export", help="write a show for other programs: as drawn, as it flies, or as it flew"
    )
    taken.add_argument(
        "file", metavar="FILE", help="a show file, the name of one that is shipped, or the record of a flight"
    )
    taken.add_argument(
        "-o", "--output", required=True, metavar="OUT", help="a .skyc, a .vviz, or a .zip of CSV files"
    )
    taken.add_argument("--seed", type=int, default=1, metavar="S", help="of the vehicles' errors; 1")
    check.add_argument(
        "--model",
        action="store_true",
        help="with --json: and everything that is flown, as a service takes it",
    )


def add_site_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", required=True)
    check = actions.add_parser("check", help="say what is in it, or all that is wrong with it")
    convert = actions.add_parser("convert", help="write it as GeoJSON, KML or QGroundControl's .plan")
    for action in (check, convert):
        text = "a .geojson, .kml or .plan, or a configuration that names one"
        action.add_argument("site", metavar="FILE", help=text)
        text = "of areas that have none in the file, above the origin; as the file has them"
        action.add_argument("--heights", **_numbers("MIN,MAX"), help=text)
    convert.add_argument(
        "-o", "--output", required=True, metavar="FILE", help="to write; its name says as what"
    )
    volumes = actions.add_parser("volumes", help="how large its volumes must be, by two computations")
    report = actions.add_parser("report", help="write what an authority asks for: HTML that prints, and KML")
    for action in (volumes, report):
        action.add_argument("config", metavar="CONFIG", help="as for gcs serve; it names a site")
        text = "as the vehicles have them: the output of gcs params check --config CONFIG --json"
        action.add_argument("--parameters", metavar="FILE.json", help=text)
    text = "write the site with volumes as wide as the wider computation demands"
    volumes.add_argument("--derive", metavar="FILE", help=text)
    report.add_argument("show", nargs="?", metavar="SHOW", help="a show file, or the name of a shipped one")
    report.add_argument("-o", "--output", required=True, metavar="OUT.html", help="and OUT.kml beside it")


def _add_adversity(check: argparse.ArgumentParser) -> None:
    """Add what a show can be rehearsed with that it does not know of."""
    check.add_argument("--lost", type=float, metavar="SHARE", help="of the vehicles lose their links; 0")
    check.add_argument("--lost-at", type=float, default=30.0, metavar="S", help="of the flight; 30")
    check.add_argument(
        "--when-lost",
        choices=("hold", "descend", "land", "return"),
        default="hold",
        help="what their autopilots do; hold",
    )
    check.add_argument("--wind", **_numbers("X,Y"), help="m/s along the show's axes, with gusts; 0,0")
    check.add_argument(
        "--box",
        **_numbers("X,Y,HALF_X,HALF_Y,HEIGHT"),
        action="append",
        help="an obstacle that is not in the show, in m; may be repeated",
    )


def add_params_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", required=True)
    for name, text in (
        ("check", "say which parameters make it unsafe to lose this ground station"),
        ("apply", "set them, and read them back; never on a vehicle that is armed"),
    ):
        action = actions.add_parser(name, help=text)
        action.add_argument("--config", required=True, metavar="FILE", help="as for gcs serve")
        action.add_argument(
            supervisor.STATION, metavar="NAME", help="vehicles of this station; default: of all"
        )
        action.add_argument(
            "--vehicles", metavar="d1,d2", help="these vehicles only; default: all that are received"
        )
        action.add_argument("--wait", type=float, default=RECEIVED_S, metavar="S", help="for vehicles; 8")


def add_simulate_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "scenario", nargs="*", metavar="SCENARIO", help="a YAML file, or the name of a shipped one"
    )
    parser.add_argument("--all", action="store_true", help="every scenario that is shipped, as it is judged")
    parser.add_argument(
        "--row", choices=ROWS, help="the scenarios of one row of docs/flight-quality.md, as judged"
    )
    parser.add_argument("--judged", action="store_true", help="the runs on which the scenario is judged")
    parser.add_argument("--seed", type=int, metavar="S", help="default 1")
    parser.add_argument("--seeds", type=_seeds, metavar="A:B", help="from A up to, without, B")
    parser.add_argument("--vehicles", type=int, metavar="N", help="the first number it is judged with")
    parser.add_argument("--law", metavar="NAME", help="in place of the scenario's: gcs law list")
    parser.add_argument("--workers", type=int, metavar="W", help="runs at a time; as many as there are cores")
    parser.add_argument("--plot", metavar="FILE.png", help="draw one flight; as it moves: FILE.gif")


def add_replay_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", help="flight.mcap, or a folder that holds it")
    parser.add_argument("--speed", type=float, default=1.0, metavar="X", help="times as fast as flown; 1")
    parser.add_argument("--host", default="127.0.0.1", help="where the API listens; 127.0.0.1")
    parser.add_argument("--port", type=int, default=8000, help="of the API; 8000, 0: any that is free")


def add_report_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = "exit code: 0 kept, 1 broken, 3 incomplete (not all could be judged), 2 no record"
    parser.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="flight.mcap, files of gcs sim --truth, or folders that hold them; of a record's folder the"
        " newest session",
    )
    parser.add_argument(
        "--positions",
        choices=("true", "estimated"),
        help="what the judgement is based on; true where they are known",
    )
    parser.add_argument("--config", metavar="FILE", help="what holds, for truth files without flight data")
    parser.add_argument("--report", metavar="FILE", help="write the report as JSON")
    parser.add_argument("--html", metavar="FILE", help="write one page with plots")


def _seeds(text: str) -> range:
    first, colon, last = text.partition(":")
    if not (colon and first.isdecimal() and last.isdecimal() and int(first) < int(last)):
        raise argparse.ArgumentTypeError(f"{text}: two numbers A:B with A below B")
    return range(int(first), int(last))
