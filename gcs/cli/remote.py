"""Every call of the REST API as a command, as listed in `gcs.cli.commands`.

The signatures of the client's methods define the arguments. Exit codes: 0 done; 1 refused, or failed for a
vehicle; 2 an invalid value; 3 no answer, or control is not alive; 4 the token lacks the right.
`gcs.cli.main` prints errors.
"""

from __future__ import annotations

import argparse
import inspect
import os
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gcs.cli.commands import ACTIONS, CALLS, ApiCall
from gcs.cli.output import REFUSED, aligned, exit_code, fail, failed, print_json
from gcs.client import URL, Client, fleet_client
from gcs.client.http import Deferred, Exchange
from gcs.model.errors import GcsError, RefusedError, UnknownError, visible

if TYPE_CHECKING:
    import pydantic

    from gcs import service
else:
    pydantic = Deferred("pydantic")
    service = Deferred("gcs.service")

EACH: Final = frozenset({"confirm-down", "find"})
"""Commands to vehicles one by one, never to all."""
LAND: Final = "land"
FAILED: Final = "failed"
NOT_INCLUDED: Final = "not-included"
"""Values of enumerations in `gcs.service`, whose import would load numpy."""


def add_arguments(parser: argparse.ArgumentParser, name: str) -> None:
    """Add the arguments of one call or action of `gcs.cli.commands`, by its name."""
    call = next((each for each in CALLS if each.name == name), None)
    if call is not None:
        add_call(parser, call)
        return
    action = next(each for each in ACTIONS if each.name == name)
    parser.description = action.text
    parser.add_argument("vehicles", metavar="VEHICLE", nargs="*")
    if action.all_:
        parser.add_argument("--all", action="store_true", help="every vehicle that it can apply to")
    _add_common(parser, is_command=True)
    parser.set_defaults(run=partial(_command, parser, name))


def add_call(parser: argparse.ArgumentParser, call: ApiCall) -> None:
    """Add the arguments of one call, and set the function that makes it."""
    parser.description = call.text
    method = _method(call)
    parameters = _add_parameters(parser, call, method)
    is_command = method.__annotations__.get("return") == "service.CommandRecord"
    _add_common(parser, is_command=is_command)
    parser.set_defaults(run=partial(_run, call, parameters))


def _method(call: ApiCall) -> Callable[..., Any]:
    owner, _, name = call.method.rpartition(".")
    group = f"{owner.capitalize()}Calls" if owner else "Client"
    found: Callable[..., Any] = getattr(getattr(fleet_client, group), name)
    return found


ANSWER_S, SHOWS_S = 5.0, 30.0
"""The service answers at once, unless it first reads, places or fits a drawing."""


def add_connection(parser: argparse.ArgumentParser) -> None:
    environment = os.environ
    url, token = environment.get("GCS_URL", URL), environment.get("GCS_TOKEN")
    lane, ca_file = environment.get("GCS_EMERGENCY_URL"), environment.get("GCS_CA_FILE")
    parser.add_argument("--url", default=url, help=f"of the service ({URL}; GCS_URL)")
    parser.add_argument("--token", default=token, help="from gcs token create (GCS_TOKEN)")
    parser.add_argument("--emergency-url", default=lane, help="of its emergency listener (GCS_EMERGENCY_URL)")
    parser.add_argument("--ca-file", default=ca_file, help="PEM that signed its certificate (GCS_CA_FILE)")


def connected(arguments: argparse.Namespace, timeout_s: float = ANSWER_S) -> Client:
    """Make the client that the arguments describe. Raises: ConfigError."""
    ca_file = None if arguments.ca_file is None else Path(arguments.ca_file)
    return Client(
        arguments.url,
        token=arguments.token,
        emergency_url=arguments.emergency_url,
        ca_file=ca_file,
        timeout_s=timeout_s,
    )


def exchange(arguments: argparse.Namespace, timeout_s: float) -> Exchange:
    """As `connected`, for calls without the API's schemas. Raises: ConfigError."""
    ca_file = None if arguments.ca_file is None else Path(arguments.ca_file)
    return Exchange(arguments.url, arguments.token, arguments.emergency_url, ca_file, timeout_s)


def _add_common(parser: argparse.ArgumentParser, *, is_command: bool) -> None:
    if is_command:
        parser.add_argument("--wait", type=float, metavar="SECONDS", help="until it is done, at most so long")
    add_connection(parser)


def _add_parameters(
    parser: argparse.ArgumentParser, call: ApiCall, method: Callable[..., Any]
) -> tuple[str, ...]:
    """Add arguments and options for the parameters of a method. Returns: their names."""
    parameters = [each for name, each in inspect.signature(method).parameters.items() if name != "self"]
    if call.alone:
        parameters = [each for each in parameters if each.name in call.positional]
    for parameter in parameters:
        name = parameter.name
        # the first of a union; the annotation is text: evaluating it would load every schema of the API
        hint = str(parameter.annotation).partition(" | ")[0]
        kind = KINDS[hint.removeprefix("list[").removesuffix("]")]
        if hint.startswith("list["):
            needed = parameter.default is inspect.Parameter.empty
            parser.add_argument(name, nargs="+" if needed else "*", metavar=name.upper(), type=kind)
        elif parameter.kind is inspect.Parameter.KEYWORD_ONLY and name not in call.positional:
            parser.add_argument(f"--{name.replace('_', '-')}", type=kind)
        else:
            parser.add_argument(name, metavar=name.upper(), type=kind)
    return tuple(parameter.name for parameter in parameters)


def _truth(text: str) -> bool:
    """Parse yes or no. Raises: ArgumentTypeError for other text."""
    try:
        return {"yes": True, "true": True, "no": False, "false": False}[text.lower()]
    except KeyError:
        raise argparse.ArgumentTypeError(f"{text!r} is neither yes nor no") from None


KINDS: Final[Mapping[str, Callable[[str], Any]]] = {
    "str": str,
    "float": float,
    "int": int,
    "bool": _truth,
    "Path": Path,
}


BEFORE_CAUSE: Final = re.compile(r"; (?=\d+\. |follows: )")
"""Where the text of a refused start has its next cause; each is a line of its own."""


def _run(call: ApiCall, names: Sequence[str], arguments: argparse.Namespace) -> int:
    given: Mapping[str, Any] = {
        name: value for name in names if (value := getattr(arguments, name)) not in (None, [])
    }
    within_s = SHOWS_S if call.method.startswith("shows.") else ANSWER_S
    with connected(arguments, within_s) as client:
        try:
            answer = attrgetter(call.method)(client)(**given)
        except RefusedError as error:
            if not arguments.json:
                error.args = (BEFORE_CAUSE.sub("\n", str(error)),)
            raise
        if isinstance(answer, service.CommandRecord):
            if call.name == "start" and not arguments.json:
                _say_proposed(client, answer)
            return _reported(client, [answer], arguments)
    _print(answer, arguments)
    return 0


def _say_proposed(client: Client, start: service.CommandRecord) -> None:
    """Say what was proposed, where a start needs a second token."""
    proposal = client.go().proposal
    if proposal is not None and proposal.command_id == start.id:
        left_s = max(0.0, proposal.until_unix_time_s - start.accepted_unix_time_s)
        print(
            f"proposed, with the hash {proposal.hash}: another token confirms it within {left_s:.0f} s:"
            f" gcs confirm {proposal.hash}"
        )


def _command(parser: argparse.ArgumentParser, action: str, arguments: argparse.Namespace) -> int:
    """Command one, several or all vehicles; a refusal for one vehicle does not stop the others.

    Raises: GcsError when nothing was accepted. Returns: the exit code.
    """
    names, everything = arguments.vehicles, getattr(arguments, "all", False)
    if names and everything:
        parser.error("either names of vehicles or --all, not both")
    if not names and not everything and action != LAND:
        parser.error("name at least one vehicle" + ("" if action in EACH else ", or give --all"))
    with connected(arguments) as client:
        if action in EACH or len(names) == 1:
            return _one_by_one(client, action, arguments)
        if not names and not everything:
            return _reported(client, [client.abort()], arguments)
        try:
            command = client.command_vehicles(action, names or None)
        except UnknownError:  # a misspelt name must not stop the command for the others
            return _one_by_one(client, action, arguments)
        missed = any(command.outcomes[name].outcome == NOT_INCLUDED for name in names)
        return _reported(client, [command], arguments) or (REFUSED if missed else 0)


def _one_by_one(client: Client, action: str, arguments: argparse.Namespace) -> int:
    commands: list[service.CommandRecord] = []
    errors: list[GcsError] = []
    for name in arguments.vehicles:
        try:
            commands.append(client.command(name, action))
        except GcsError as error:
            errors.append(error)
    if not commands and len(errors) == 1:
        raise errors[0]
    code = exit_code(errors[-1]) if errors else 0
    if errors and arguments.json:  # one document for all refusals
        fail("; ".join(map(str, errors)), code, as_json=True)
    for each in () if arguments.json else errors:
        failed(each, arguments)
    return (_reported(client, commands, arguments) if commands else 0) or code


def _reported(
    client: Client, commands: Sequence[service.CommandRecord], arguments: argparse.Namespace
) -> int:
    """Print commands, with `--wait` after their end. Returns: the exit code."""
    if arguments.wait is not None:
        commands = [client.wait_for(command.id, arguments.wait) for command in commands]
    if arguments.json:  # one document for all commands
        _print(commands[0] if len(commands) == 1 else commands, arguments)
    for command in () if arguments.json else commands:
        print(f"{command.id} {command.action}: {command.outcome}")
        for vehicle_id, part in command.outcomes.items():
            print(f"  {vehicle_id}: {part.outcome}{f', {part.reason}' if part.reason else ''}")
    return REFUSED if any(command.outcome == FAILED for command in commands) else 0


def _print(answer: object, arguments: argparse.Namespace) -> None:
    if isinstance(answer, str) and not arguments.json:
        print(visible(answer), end="")
    elif hasattr(answer, "table") and not arguments.json:
        print(visible("\n".join(aligned(answer.table()))))
    elif answer is not None or arguments.json:
        print_json(document(answer))


def document(answer: object) -> Any:
    """Return an answer of the client as JSON values, as the API sent it."""
    if isinstance(answer, list):
        return [document(each) for each in answer]
    return pydantic.TypeAdapter(type(answer)).dump_python(answer, mode="json")
