"""The command line of the fake fleet: `python -m gcs.sim`, and the same arguments for `gcs sim`."""

import argparse
import contextlib
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from time import time
from typing import BinaryIO, NamedTuple, get_args
from urllib.parse import urlsplit

from gcs.sim.endpoint import MAX_PORT, Port, PortError, noted_stops, own_ports, serve, shared_ports
from gcs.sim.ground_truth import FIRST_PORT, HOST, GroundTruthFile, TargetTruthFile
from gcs.sim.mixed import KINDS
from gcs.sim.protocol.streams import RECORDED_HZ, lean_hz
from gcs.sim.settings import MAX_SYSTEM_ID, PAD_SPACING_M, Autopilot, Origin, Settings
from gcs.sim.targets import formats, motions
from gcs.sim.targets.reports import Errors, reports
from gcs.sim.targets.sending import GpsdServer, UdpOutlet, send
from gcs.sim.vehicle import versions
from gcs.sim.vehicle.parameters import ParameterError, ParameterList, Table, Value
from gcs.sim.vehicle.px4 import QuirkError, Quirks, quirk_names


def whole(low: int, high: int) -> Callable[[str], int]:

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {low} to {high}")
        return value

    return parse


def number(low: float, high: float) -> Callable[[str], float]:

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


def numbers(form: str, words: str) -> Callable[[str], tuple[float, ...]]:
    """A parser of as many finite numbers as `form` has, with commas between them."""

    def parse(text: str) -> tuple[float, ...]:
        values = tuple(_float(part) for part in text.split(","))
        if len(values) != len(form.split(",")) or not all(map(math.isfinite, values)):
            raise argparse.ArgumentTypeError(f"{text!r} is not {form}: {words} between them")
        return values

    return parse


triple = partial(numbers, words="three numbers with commas")
pair = partial(numbers, words="two numbers with a comma")


def origin(text: str) -> Origin:
    latitude_deg, longitude_deg, altitude_amsl_m = triple("LAT,LON,ALT")(text)
    if not (abs(latitude_deg) <= 90 and abs(longitude_deg) <= 180):
        raise argparse.ArgumentTypeError(
            f"{text!r}: latitude goes from -90 to 90, longitude from -180 to 180 degrees"
        )
    return Origin(latitude_deg, longitude_deg, altitude_amsl_m)


def parameter(text: str) -> tuple[str, Value | Sequence[Value]]:
    name, separator, values_text = text.partition("=")
    values = [_float(part) for part in values_text.split(",")]
    if not separator or not all(map(math.isfinite, values)):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE, as in COM_OBL_RC_ACT=5")
    return name, values if len(values) > 1 else values[0]


def parameter_options(parameters: Mapping[str, Value | Sequence[Value]]) -> list[str]:
    texts = {
        name: ",".join(f"{each:g}" for each in (value if isinstance(value, Sequence) else [value]))
        for name, value in parameters.items()
    }
    return [word for name, text in texts.items() for word in ("--param", f"{name}={text}")]


def quirk(text: str) -> tuple[str, bool]:
    name, _, switch = text.partition("=")
    if switch not in {"on", "off"}:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=on or NAME=off, as in double-ack=off")
    try:
        Quirks().changed([(name, True)])
    except QuirkError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return name, switch == "on"


MAX_COUNT = 10_000
KINDS_IN_WORDS = {"px4": "", "ardupilot": " with ArduPilot", "mixed": " with PX4 and ArduPilot in turn"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the fleet's options to any parser, group by group as `--help` shows them."""
    add = parser.add_argument_group("vehicles").add_argument
    add("--count", type=whole(1, MAX_COUNT), default=1, metavar="N", help="vehicles in this process")
    text = "which autopilot they have; mixed: PX4 and ArduPilot alternate, vehicle 0 has PX4"
    add("--autopilot", choices=get_args(Autopilot), default="px4", help=text)
    text = "as 1.18 or 4.7, mixed 1.16,4.5; without: as recorded, PX4 1.16 and ArduCopter 4.1-dev. There are "
    text += "; ".join(f"{kind} {', '.join(versions.names(kind))}" for kind in KINDS)
    add("--autopilot-version", default="", metavar="VERSION", help=text)
    text = "parameters begin as in the autopilot's simulator, or as delivered in its firmware"
    add("--defaults", choices=["simulator", "firmware"], default="simulator", help=text)
    text = "index of the first; its number is I+1, and so is its id, up to the namespace's size"
    add("--first", type=whole(0, MAX_COUNT - 1), default=0, metavar="I", help=text)
    text = "system ids per namespace: vehicle i has id i %% S + 1 in namespace i // S, with own ports"
    add("--namespace-size", type=whole(1, MAX_SYSTEM_ID), default=MAX_SYSTEM_ID, metavar="S", help=text)
    add("--seed", type=whole(0, 2**63 - 1), default=0, metavar="N", help="of everything random")

    ports = parser.add_argument_group("ports and telemetry")
    text = "PX4: GLOBAL_POSITION_INT at HZ, the state once or twice a second; else 520 messages a second"
    ports.add_argument("--telemetry-hz", type=number(0.1, 250.0), metavar="HZ", help=text)
    add = ports.add_mutually_exclusive_group().add_argument
    text = "as PX4: vehicle i binds 14580+i and talks to 14540+i (14549 from i = 10 on)"
    add("--ports", choices=["px4"], help=text)
    text = "vehicle i talks to P+i, from a port of its own"
    add("--port-base", type=whole(1, MAX_PORT), metavar="P", help=text)
    text = (
        "one socket per namespace, as behind a radio: it binds 14580+k and talks to 14540+k, "
        "or with --port-base to P+k"
    )
    ports.add_argument("--shared-port", action="store_true", help=text)

    add = parser.add_argument_group("place and start grid").add_argument
    text = "degrees, metres AMSL: the ground"
    add("--origin", type=origin, default=Origin(), metavar="LAT,LON,ALT", help=text)
    add("--spacing", type=number(0.0, 1e5), default=PAD_SPACING_M, metavar="M", help="of the start grid")
    text = "vehicle i starts at row i // C (north), column i %% C (east)"
    add("--grid-columns", type=whole(1, 10**6), metavar="C", help=text)
    text = "where vehicle 0 of the grid stands, or a target begins, m north and east of the origin"
    add("--grid-at", type=pair("N,E"), default=(0.0, 0.0), metavar="N,E", help=text)
    text = "where the grid's rows lead, clockwise from north; columns are to the right"
    add("--grid-heading", type=number(-360.0, 360.0), default=0.0, metavar="DEG", help=text)
    add(
        "--heading",
        type=number(-360.0, 360.0),
        default=0.0,
        metavar="DEG",
        help="initial yaw, or course of a target",
    )

    _add_flight(parser)

    add = parser.add_argument_group("true states").add_argument
    add("--truth", metavar="FILE", help="write the true states to FILE as JSON Lines, 20 a second")
    text = (
        "vehicle i sends its true state as HIL_STATE_QUATERNION to port P+i, as PX4's SIH does; "
        f"{FIRST_PORT} without P"
    )
    add("--simulator-link", type=whole(1, MAX_PORT), nargs="?", const=FIRST_PORT, metavar="P", help=text)

    add = parser.add_argument_group("faults").add_argument
    text = 'receive faults as JSON on that UDP port: {"vehicle": 3, "fault": "loss", "share": 0.3}'
    add("--control", type=whole(1, MAX_PORT), metavar="PORT", help=text)
    add("--faults-from", choices=["-"], help="the same, line by line, from standard input")
    _add_target(parser)


class Format(NamedTuple):
    """What a target sends, and where to if nothing else is named."""

    to: str
    encoder: Callable[[argparse.Namespace, float], formats.Encoder]


AIRCRAFT, VESSEL = 0x3C6444, 211_234_560
"""ICAO address and MMSI of what a receiver of ADS-B or AIS reports."""

FORMATS = {
    "nmea": Format("udp://127.0.0.1:10110", lambda _, unix_s: formats.nmea(unix_s)),
    "gpsd": Format("tcp://127.0.0.1:2947", lambda _, unix_s: formats.tpv(unix_s)),
    "cot": Format("udp://127.0.0.1:6969", lambda given, unix_s: formats.cot(unix_s, given.name)),
    "mavlink": Format("udp://127.0.0.1:14560", lambda given, _: formats.Mavlink(given.system_id)),
    "follow-target": Format(
        "udp://127.0.0.1:14560", lambda given, _: formats.Mavlink(given.system_id, follow_target=True)
    ),
    "adsb": Format("udp://127.0.0.1:14560", lambda given, _: formats.Transponder(given.system_id, AIRCRAFT)),
    "ais": Format(
        "udp://127.0.0.1:14560", lambda given, _: formats.Transponder(given.system_id, VESSEL, vessel=True)
    ),
}

FOR_BOTH = {"noise", "seed", "origin", "heading", "grid_at", "truth"}
"""Options of vehicles that a target has as well."""


def _add_target(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument_group("a target instead of vehicles").add_argument
    share, s_pair = number(0.0, 1.0), partial(numbers, words="two numbers with a comma")
    text = f"how it moves: {', '.join(motions.KINDS)}, or a track, FILE.csv ({','.join(motions.COLUMNS)})"
    add("--target", metavar="MOTION", help=text)
    text = "what it sends; mavlink: GLOBAL_POSITION_INT, HEARTBEAT, GPS_RAW_INT"
    add("--send", choices=list(FORMATS), help=text)
    text = "where to, udp://HOST:PORT; of gpsd where it listens, tcp://HOST:PORT. Without: "
    text += ", ".join(f"{name} {form.to}" for name, form in FORMATS.items())
    add("--to", default="", metavar="URL", help=text)
    usual = ", ".join(f"{name} {kind.speed_m_s:g}" for name, kind in motions.KINDS.items())
    add("--speed", type=number(0.1, 300.0), metavar="M_S", help=f"without: {usual}")
    add("--rate", type=number(0.01, 200.0), default=5.0, metavar="HZ", help="reports a second")
    add("--height", type=number(-100.0, 1e4), default=0.0, metavar="M", help="above the origin")
    add("--name", default="target", metavar="NAME", help="of cot: uid and callsign")
    add("--system-id", type=whole(1, 255), default=42, metavar="N", help="of all but nmea, gpsd and cot")
    text = "how long an error of the position stays alike; 0: each is another"
    add("--correlated", type=number(0.0, 1e4), default=0.0, metavar="S", help=text)
    add("--delay", type=number(0.0, 60.0), default=0.0, metavar="S", help="from measuring to sending")
    text = "probability that a drop-out begins with a report, and its length in s"
    add("--drop-out", type=s_pair("SHARE,S"), default=(0.0, 0.0), metavar="SHARE,S", help=text)
    text = "how far its clock is ahead in s, and how much too fast it is, in millionths"
    add("--clock", type=s_pair("S,PPM"), default=(0.0, 0.0), metavar="S,PPM", help=text)
    text = "its clock is set forward by so many s, AT s after the beginning"
    add("--clock-step", type=s_pair("S,AT"), default=(0.0, math.inf), metavar="S,AT", help=text)
    text = "once every S seconds one report is off by so many metres"
    add("--jump", type=s_pair("M,S"), default=(0.0, math.inf), metavar="M,S", help=text)
    text = "from AT s after the beginning it reports the same position for S seconds"
    add("--freeze", type=s_pair("AT,S"), default=(math.inf, 0.0), metavar="AT,S", help=text)
    add("--double", type=share, default=0.0, metavar="SHARE", help="of its reports that are sent twice")
    add("--nan", type=share, default=0.0, metavar="SHARE", help="of its reports without a position")
    add("--swap", action="store_true", help="latitude and longitude are exchanged")


def _add_flight(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument_group("how they fly").add_argument
    text = "error of the position estimates, 1 as recorded; receivers report what was recorded. "
    text += "Of a target: one sigma in m"
    add("--noise", type=number(0.0, 100.0), default=1.0, metavar="SCALE", help=text)
    add("--ideal", action="store_true", help="positions without error or resets, RTK fixed")
    text = "as the autopilots' simulators without it: PX4 1.0, ArduPilot 0.65; real 0.1 to 0.3"
    add("--drag", type=number(0.0, 10.0), metavar="PER_S", help=text)
    add("--wind", type=triple("N,E,D"), default=(0.0, 0.0, 0.0), metavar="N,E,D", help="of the air, m/s")
    text = "of ArduPilot's clocks over the wall clock, as of a slow simulator: 0.984"
    add("--clock-rate", type=number(0.5, 1.5), default=1.0, metavar="RATE", help=text)
    text = "each has a transponder for Remote ID behind its autopilot"
    add("--transponders", action="store_true", help=text)
    text = "flight time of a full battery"
    add("--battery", type=number(0.1, 1e5), default=20.0, metavar="MIN", help=text)
    text = "parameter: COM_OBL_RC_ACT=5, WPNAV_ACCEL=250; or of vehicle 0, 1 and on: RTL_RETURN_ALT=30,34"
    add("--param", type=parameter, action="append", default=[], metavar="NAME=VALUE", help=text)
    text = "make an autopilot behave as one would wish"
    text += f" (repeatable): {', '.join(quirk_names())}"
    add("--quirk", type=quirk, action="append", default=[], metavar="NAME=off", help=text)


class FleetError(Exception):
    """The fleet cannot be flown with these arguments.

    Attributes:
        code: the exit code: 1 for a taken port or file, 2 for bad arguments.
    """

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code


def main(argv: Sequence[str] | None = None) -> int:
    """Fly until interrupted. Returns: exit code 0, 1 for a taken port or file, 2 for bad arguments."""
    text = "A fleet of fake vehicles with PX4 or ArduPilot that speak MAVLink."
    parser = argparse.ArgumentParser(prog="sim", description=text)
    add_arguments(parser)
    given = parser.parse_args(argv)
    try:
        fly(given, greeting(given))
    except FleetError as error:
        print(f"sim: {error}", file=sys.stderr)  # noqa: T201 - the command's output
        return error.code
    return 0


def fly(given: argparse.Namespace, greeting: str) -> None:
    """Fly, or move a target, until SIGINT, SIGTERM or SIGHUP; print the greeting when all can be reached.

    Raises: FleetError when a port or file is taken, or the arguments exceed the possible ones.
    """
    if given.target is not None:
        _send_target(given, greeting)
        return
    ports = _checked_ports(given)
    with contextlib.ExitStack() as stack:
        truth = None if given.truth is None else GroundTruthFile(_truth_file(given, stack))
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


def _settings(given: argparse.Namespace) -> Settings:
    columns = given.grid_columns or math.ceil(math.sqrt(given.count))
    return Settings(
        autopilot=given.autopilot,
        version=given.autopilot_version,
        as_delivered=given.defaults == "firmware",
        count=given.count,
        first=given.first,
        namespace_size=given.namespace_size,
        seed=given.seed,
        clock_rate=given.clock_rate,
        noise_scale=given.noise,
        ideal=given.ideal,
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
        transponders=given.transponders,
        rates_hz=RECORDED_HZ if given.telemetry_hz is None else lean_hz(given.telemetry_hz),
    )


def _checked_ports(given: argparse.Namespace) -> list[Port]:
    """Raises: FleetError where vehicles or ports exceed the possible ones."""
    last = given.first + given.count
    if last > MAX_COUNT:
        fit = f"at most {MAX_COUNT - given.first} fit"
        raise FleetError(2, f"--first {given.first} --count {given.count}: {fit}")
    lists = _parameter_lists(given)
    for name, value in given.param:
        _check_parameter(name, value, lists)
        if isinstance(value, Sequence) and len(value) < last:
            raise FleetError(2, f"--param {name}: {len(value)} values for vehicles up to index {last - 1}")
    make = shared_ports if given.shared_port else own_ports
    ports = make(given.first, given.count, given.namespace_size, given.port_base)
    if max(max(port.destination, port.bind) for port in ports) > MAX_PORT:
        text = f"--port-base {given.port_base} leads beyond port {MAX_PORT}; choose a lower one"
        raise FleetError(2, text)
    if given.simulator_link is not None and given.simulator_link + last > MAX_PORT:
        raise FleetError(2, f"--simulator-link {given.simulator_link} leads beyond port {MAX_PORT}")
    return ports


def _parameter_lists(given: argparse.Namespace) -> list[ParameterList]:
    """Those of each kind of autopilot in the fleet. Raises: FleetError for an unknown version."""
    text, kind = given.autopilot_version, given.autopilot
    try:
        if kind != "mixed":
            return [versions.find(kind, text).parameters]
        return [versions.find(kind, versions.part_for(kind, text)).parameters for kind in KINDS]
    except versions.VersionError as error:
        raise FleetError(2, f"--autopilot-version: {error}") from None


def _check_parameter(name: str, value: Value | Sequence[Value], lists: Sequence[ParameterList]) -> None:
    """Raises: FleetError where no vehicle has that parameter, or it cannot have that value."""
    listed = next((each for each in lists if each.knows(name)), None)
    if listed is None:
        titles, has = " and ".join(each.title for each in lists), "has" if len(lists) == 1 else "have"
        family = name.split("_", maxsplit=1)[0] + "_"
        near = sorted({other for each in lists for other in each.names if other.startswith(family)})
        hint = f"; there are {', '.join(near[:5])} ..." if near else ""
        advice = f"see --autopilot and --autopilot-version{hint}"
        raise FleetError(2, f"--param {name}: {titles} {has} no such parameter; {advice}")
    try:
        for each in value if isinstance(value, Sequence) else [value]:
            Table(listed, {name: each})
    except ParameterError as error:
        raise FleetError(2, f"--param {error}") from None


def _truth_file(given: argparse.Namespace, stack: contextlib.ExitStack) -> BinaryIO:
    """Raises: FleetError when it cannot be written."""
    try:
        return stack.enter_context(open(given.truth, "wb"))  # noqa: PTH123
    except OSError as error:
        raise FleetError(1, f"--truth {given.truth}: {error.strerror}") from error


def _send_target(given: argparse.Namespace, greeting: str) -> None:
    host, port = _target_address(given)
    origin, motion = _motion(given)
    errors = Errors(
        rate_hz=given.rate,
        noise_m=given.noise,
        correlated_s=given.correlated,
        delay_s=given.delay,
        drop_out=given.drop_out,
        clock=given.clock,
        clock_step=given.clock_step,
        jump=given.jump,
        freeze=given.freeze,
        doubled=given.double,
        unknown=given.nan,
        swapped=given.swap,
    )
    try:
        outlet = (GpsdServer if given.send == "gpsd" else UdpOutlet)(host, port)
    except OSError as error:
        raise FleetError(1, f"--to {_to(given)}: {error.strerror}") from error
    except UnicodeError:
        raise FleetError(2, f"--to {_to(given)}: {host!r} is no host name") from None
    with contextlib.ExitStack() as stack:
        stops = noted_stops(stack)
        print(greeting, flush=True)  # noqa: T201 - the command's output
        encode = FORMATS[given.send].encoder(given, time())
        note = None if given.truth is None else TargetTruthFile(_truth_file(given, stack), motion).note
        send(reports(motion, origin, errors, given.seed), encode, outlet, stops, note)


def _motion(given: argparse.Namespace) -> tuple[Origin, motions.Motion]:
    """Raises: FleetError where there is no such motion or track."""
    if given.target in motions.KINDS:
        options = {"seed": given.seed, "course_deg": given.heading, "speed_m_s": given.speed}
        north_m, east_m = given.grid_at
        moved = motions.moved(motions.motion(given.target, **options), north_m, east_m, -given.height)
        return given.origin, moved
    if not given.target.lower().endswith(".csv"):
        kinds = ", ".join(motions.KINDS)
        raise FleetError(2, f"--target {given.target}: there are {kinds}, and tracks, FILE.csv")
    try:
        return motions.played(motions.read_track(Path(given.target)))
    except OSError as error:
        raise FleetError(1, f"--target {given.target}: {error.strerror}") from error
    except (UnicodeError, motions.TrackError) as error:
        raise FleetError(2, f"--target {error}") from error


def _to(given: argparse.Namespace) -> str:
    return str(given.to or FORMATS[given.send].to)


def _target_address(given: argparse.Namespace) -> tuple[str, int]:
    """Raises: FleetError where options do not fit together, or the address is none."""
    if given.send is None:
        raise FleetError(2, f"--target {given.target} needs --send: {', '.join(FORMATS)}")
    if options := _changed(given, of_target=False):
        text = f"{', '.join(options)}: of vehicles, and --target moves a target alone"
        raise FleetError(2, f"{text}; start the vehicles in a process of their own")
    scheme = "tcp" if given.send == "gpsd" else "udp"
    url = urlsplit(_to(given))
    try:
        host, port = url.hostname, url.port
    except ValueError:
        host, port = None, None
    if url.scheme != scheme or not host or not port or url.path:
        raise FleetError(2, f"--to {given.to}: --send {given.send} needs {scheme}://HOST:PORT")
    return host, port


def _changed(given: argparse.Namespace, *, of_target: bool) -> list[str]:
    """Options that are not as without them, of targets or of vehicles alone."""
    whole_parser, target_parser = argparse.ArgumentParser(), argparse.ArgumentParser()
    add_arguments(whole_parser)
    _add_target(target_parser)
    of_targets = vars(target_parser.parse_args([]))
    usual = vars(whole_parser.parse_args([]))
    names = [name for name in usual if (name in of_targets) == of_target and name not in FOR_BOTH]
    return [f"--{name.replace('_', '-')}" for name in names if getattr(given, name) != usual[name]]


def destinations(given: argparse.Namespace) -> list[int]:
    """The ports that the vehicles or the target send to. Raises: FleetError."""
    if given.target is not None:
        return [_target_address(given)[1]]
    if options := _changed(given, of_target=True):
        raise FleetError(2, f"{', '.join(options)}: of a target; name its motion with --target")
    return [port.destination for port in _checked_ports(given)]


def greeting(given: argparse.Namespace) -> str:
    """Number of vehicles, their ids and ports, or the target's motion, in words. Raises: FleetError."""
    if given.target is not None:
        _target_address(given)
        _motion(given)
        return f"sim: target {given.target}, {given.send}, {given.rate:g} a second, {_to(given)}"
    vehicles = f"{given.count} vehicle" + ("s" if given.count > 1 else "") + KINDS_IN_WORDS[given.autopilot]
    return f"sim: {vehicles}, {_ids(given)}, udp {HOST}:{_span(destinations(given))}"


def _ids(given: argparse.Namespace) -> str:
    size, first, last = given.namespace_size, given.first, given.first + given.count - 1
    if first // size == last // size:
        ids = _span([first % size + 1, last % size + 1])
        return f"system id{'' if first == last else 's'} {ids}"
    return f"system ids {first % size + 1}-{size} and on in namespaces {_span([first // size, last // size])}"


def _span(numbers: Sequence[int]) -> str:
    low, high = min(numbers), max(numbers)
    return str(low) if low == high else f"{low}-{high}"
