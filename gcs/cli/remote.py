"""Every call of the REST API as a command: a table of `gcs.client.Client`'s methods.

Their signatures are the arguments. Exit codes: 0 done; 1 refused, or failed with a vehicle; 2 a value that
can never be right; 3 nobody answers, or control is not alive; 4 the token may not.
"""

import argparse
import inspect
import json
import os
import sys
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel

from api import wire
from gcs.client import URL, Client
from gcs.client_preflight import Preflight
from gcs.client_replay import Playback
from gcs.client_shows import Shows
from gcs.errors import AccessError, ConfigError, GcsError, InvalidError, LinkError, OrderError, UnknownError
from gcs.service import Outcome, VehicleAction

EXIT_CODES: Final[dict[type[GcsError], int]] = {
    AccessError: 4,
    ConfigError: 2,
    InvalidError: 2,
    OrderError: 1,
    LinkError: 3,
}
REFUSED: Final = 1


@dataclass(frozen=True, slots=True)
class Call:
    """One command. Parameters that the method knows by keyword alone are options, but for those `asked`."""

    name: str
    method: Callable[..., Any]
    asked: tuple[str, ...] = ()
    text: str = ""  # absent: the method's own
    alone: bool = False  # what is asked for, and no option
    of: Callable[[Client], Any] = lambda client: client  # whose method it is

    @property
    def help(self) -> str:
        """For people."""
        return self.text or (inspect.getdoc(self.method) or "").partition("\n")[0].rstrip(".")


BOX: Final = ("x_m", "y_m", "half_length_x_m", "half_length_y_m", "height_m")

CALLS: Final = (
    Call("start", Client.start),
    Call("stop", Client.stop),
    Call("pause", Client.pause),
    Call("resume", Client.resume),
    Call("abort", Client.abort),
    Call("interrupted", Client.interrupted),
    Call("take-over", Client.take_over),
    Call("bring-home", Client.bring_home),
    Call("formation", Client.formation),
    Call("radius", Client.change_formation, ("radius_m",), "Change the formation's radius", alone=True),
    Call(
        "height",
        Client.change_formation,
        ("height_m",),
        "Change the height of the formation's centre",
        alone=True,
    ),
    Call("target show", Client.target),
    Call("target set", Client.set_target),
    Call("target set-geodetic", Client.set_target_geodetic),
    Call("orbit show", Client.orbit),
    Call("orbit set", Client.change_orbit),
    Call("yaw show", Client.yaw),
    Call("yaw set", Client.change_yaw),
    Call("obstacle list", Client.obstacles),
    Call("obstacle show", Client.obstacle),
    Call("obstacle add", Client.add_obstacle, BOX),
    Call("obstacle change", Client.change_obstacle, BOX),
    Call("obstacle remove", Client.remove_obstacle),
    Call("shows list", Shows.stored, of=attrgetter("shows")),
    Call("shows text", Shows.text, of=attrgetter("shows")),
    Call("shows upload", Shows.upload, of=attrgetter("shows")),
    Call("shows remove", Shows.remove, of=attrgetter("shows")),
    Call("shows check", Shows.check, of=attrgetter("shows")),
    Call("shows checked", Shows.checked, of=attrgetter("shows")),
    Call("shows select", Shows.select, of=attrgetter("shows")),
    Call("shows deselect", Shows.deselect, of=attrgetter("shows")),
    Call("shows seek", Shows.seek, of=attrgetter("shows")),
    Call("exclude", Preflight.exclude, of=attrgetter("preflight")),
    Call("include", Preflight.include, of=attrgetter("preflight")),
    Call("playback show", Playback.now, of=attrgetter("playback")),
    Call("playback set", Playback.change, of=attrgetter("playback")),
    Call("playback certificate", Playback.certificate, of=attrgetter("playback")),
    Call("order list", Client.orders),
    Call("order show", Client.order),
    Call("state", Client.fleet),
    Call("phase", Client.show),
    Call("facts", Client.status),
    Call("whoami", Client.access),
    Call("vehicle list", Client.vehicles),
    Call("vehicle show", Client.vehicle),
    Call("health", Client.health, text="Whether control is alive; exit code 3 when it is not"),
    Call("ready", Client.readiness, text="Whether anybody can be ordered anything; else exit code 3"),
    Call("metrics", Client.metrics),
)

GROUPS: Final = {
    "target": "where the target is",
    "orbit": "how the formation circles it",
    "yaw": "where the vehicles look",
    "obstacle": "what the fleet keeps clear of",
    "shows": "show files that the service keeps, and the one that is flown next",
    "playback": "how gcs replay plays its record, and what the flight kept",
    "order": "what was ordered, and what became of it",
    "vehicle": "what is known of each vehicle",
}

CONFIRM_DOWN: Final = VehicleAction.CONFIRM_DOWN

VEHICLE_HELP: Final = {
    VehicleAction.HOLD: "Vehicles leave the formation and hold position",
    VehicleAction.JOIN: "Vehicles that hold come back into the formation",
    VehicleAction.RETURN: "Vehicles come home and land",
    VehicleAction.LAND: "Vehicles land where they are; without names everybody does, as abort",
    VehicleAction.TAKE_CONTROL: "Take control of vehicles in the air; they hold",
    VehicleAction.CONFIRM_DOWN: "Say that lost vehicles were seen on the ground",
}


def words() -> frozenset[str]:
    """What those commands begin with."""
    return frozenset({call.name.split()[0] for call in CALLS} | {action.value for action in VEHICLE_HELP})


def add_commands(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """A command for every call."""
    groups = {"": commands}
    for call in CALLS:
        group, _, name = call.name.rpartition(" ")
        if group not in groups:
            parent = commands.add_parser(group, help=GROUPS[group])
            groups[group] = parent.add_subparsers(dest=f"{group}_command", required=True)
        parser = groups[group].add_parser(name, help=call.help, description=call.help)
        names = _add_parameters(parser, call)
        returns = typing.get_type_hints(call.method).get("return")
        _add_common(parser, is_order=returns is wire.Order)
        parser.set_defaults(run=partial(_run, call, names))
    for action, text in VEHICLE_HELP.items():
        parser = commands.add_parser(action.value, help=text, description=text)
        parser.add_argument("vehicles", metavar="VEHICLE", nargs="*")
        if action is not CONFIRM_DOWN:
            parser.add_argument("--all", action="store_true", help="every vehicle that it can apply to")
        _add_common(parser, is_order=True)
        parser.set_defaults(run=partial(_command, parser, action))


def add_connection(parser: argparse.ArgumentParser) -> None:
    """Where the service is, and how to be let in."""
    environment = os.environ
    url, token = environment.get("GCS_URL", URL), environment.get("GCS_TOKEN")
    lane, ca_file = environment.get("GCS_EMERGENCY_URL"), environment.get("GCS_CA_FILE")
    parser.add_argument("--url", default=url, help=f"of the service ({URL}; GCS_URL)")
    parser.add_argument("--token", default=token, help="from gcs token create (GCS_TOKEN)")
    parser.add_argument("--emergency-url", default=lane, help="of its emergency listener (GCS_EMERGENCY_URL)")
    parser.add_argument("--ca-file", default=ca_file, help="PEM that signed its certificate (GCS_CA_FILE)")


def connected(arguments: argparse.Namespace, timeout_s: float = 5.0) -> Client:
    """The client that the arguments describe. Raises: ConfigError."""
    ca_file = None if arguments.ca_file is None else Path(arguments.ca_file)
    return Client(
        arguments.url,
        token=arguments.token,
        emergency_url=arguments.emergency_url,
        ca_file=ca_file,
        timeout_s=timeout_s,
    )


def failed(error: GcsError) -> int:
    """Say what is wrong. Returns: the exit code."""
    print(f"gcs: {error}", file=sys.stderr)
    for note in getattr(error, "__notes__", ()):
        print(f"gcs: {note}", file=sys.stderr)
    return next((code for kind, code in EXIT_CODES.items() if isinstance(error, kind)), REFUSED)


def _add_common(parser: argparse.ArgumentParser, *, is_order: bool) -> None:
    if is_order:
        parser.add_argument("--wait", type=float, metavar="SECONDS", help="until it is done, at most so long")
        parser.add_argument("--json", action="store_true", help="print all of the order")
    add_connection(parser)


def _add_parameters(parser: argparse.ArgumentParser, call: Call) -> tuple[str, ...]:
    """Arguments and options for the parameters of a method. Returns: their names."""
    hints = typing.get_type_hints(call.method)
    parameters = [each for name, each in inspect.signature(call.method).parameters.items() if name != "self"]
    if call.alone:
        parameters = [each for each in parameters if each.name in call.asked]
    for parameter in parameters:
        kind, is_list = _kind(hints[parameter.name])
        options: dict[str, Any] = {"type": kind}
        if is_list:
            parser.add_argument(parameter.name, nargs="*", metavar=parameter.name.upper(), **options)
        elif parameter.kind is inspect.Parameter.KEYWORD_ONLY and parameter.name not in call.asked:
            parser.add_argument(f"--{parameter.name.replace('_', '-')}", **options)
        else:
            parser.add_argument(parameter.name, metavar=parameter.name.upper(), **options)
    return tuple(parameter.name for parameter in parameters)


def _kind(hint: Any) -> tuple[Callable[[str], Any], bool]:
    """What an argument is read as, of several kinds the first, and whether there may be several arguments."""
    is_union = typing.get_origin(hint) in {typing.Union, types.UnionType}  # with None: it may be left out
    only = next(each for each in typing.get_args(hint) if each is not types.NoneType) if is_union else hint
    if typing.get_origin(only) is list:
        return typing.get_args(only)[0], True
    return (_truth if only is bool else only), False


def _truth(text: str) -> bool:
    """Raises: ArgumentTypeError for neither."""
    try:
        return {"yes": True, "true": True, "no": False, "false": False}[text.lower()]
    except KeyError:
        raise argparse.ArgumentTypeError(f"{text!r} is neither yes nor no") from None


def _run(call: Call, names: Sequence[str], arguments: argparse.Namespace) -> int:
    given: Mapping[str, Any] = {
        name: value for name in names if (value := getattr(arguments, name)) not in (None, [])
    }
    try:
        with connected(arguments) as client:
            answer = call.method(call.of(client), **given)
            return _told(client, [answer], arguments) if isinstance(answer, wire.Order) else _printed(answer)
    except GcsError as error:
        return failed(error)


def _command(parser: argparse.ArgumentParser, action: VehicleAction, arguments: argparse.Namespace) -> int:
    """Command one vehicle, several or all: one that is refused does not keep the others from it."""
    names, everything = arguments.vehicles, getattr(arguments, "all", False)
    if names and everything:
        parser.error("either names of vehicles or --all, not both")
    if not names and not everything and action is not VehicleAction.LAND:
        parser.error("name at least one vehicle" + ("" if action is CONFIRM_DOWN else ", or give --all"))
    try:
        with connected(arguments) as client:
            return _commanded(client, action, arguments)
    except GcsError as error:
        return failed(error)


def _commanded(client: Client, action: VehicleAction, arguments: argparse.Namespace) -> int:
    """Raises: GcsError when nothing was accepted. Returns: the exit code."""
    names = arguments.vehicles
    if action is CONFIRM_DOWN or len(names) == 1:
        return _one_by_one(client, action, arguments)
    if not names and not arguments.all:
        return _told(client, [client.abort()], arguments)
    try:
        order = client.command_vehicles(action.value, names or None)
    except UnknownError:  # a name that is misspelt does not keep the others from the command
        return _one_by_one(client, action, arguments)
    missed = any(order.vehicles[name].outcome == Outcome.NOT_INCLUDED for name in names)
    return _told(client, [order], arguments) or (REFUSED if missed else 0)


def _one_by_one(client: Client, action: VehicleAction, arguments: argparse.Namespace) -> int:
    orders: list[wire.Order] = []
    code = 0
    for name in arguments.vehicles:
        try:
            orders.append(client.command(name, action.value))
        except GcsError as error:
            code = failed(error)
    return _told(client, orders, arguments) or code


def _told(client: Client, orders: Sequence[wire.Order], arguments: argparse.Namespace) -> int:
    """Print orders, waited for if that was asked. Returns: the exit code."""
    if arguments.wait is not None:
        orders = [client.wait_for(order.id, arguments.wait) for order in orders]
    for order in orders:
        if arguments.json:
            print(order.model_dump_json(indent=2))
            continue
        print(f"{order.id} {order.action}: {order.outcome}")
        for vehicle_id, part in order.vehicles.items():
            print(f"  {vehicle_id}: {part.outcome}{f', {part.reason}' if part.reason else ''}")
    return REFUSED if any(order.outcome == Outcome.FAILED for order in orders) else 0


def _printed(answer: BaseModel | Sequence[BaseModel] | str | None) -> int:
    if isinstance(answer, str):
        print(answer, end="")
    elif isinstance(answer, BaseModel):
        print(answer.model_dump_json(indent=2))
    elif answer is not None:
        print(json.dumps([each.model_dump(mode="json") for each in answer], indent=2))
    return 0
