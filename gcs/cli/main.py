"""`gcs`: finds the given command, makes only its parser, and runs it.

A command's modules are imported when it runs; `gcs.cli.commands` has the texts of all commands.
"""

import argparse
import gc
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from importlib import import_module
from typing import Any, Final, NoReturn

from gcs.cli.commands import ACTIONS, CALLS, COMMANDS, DOCUMENT, GROUPS, names
from gcs.cli.output import JSON, WRONG, Parser, answer, fail, failed, is_json, print_json
from gcs.model.errors import GcsError

DESCRIPTION: Final = "Fly a self-organising formation of drones."
VERSION: Final = frozenset({"--version", "-V"})
SHELLS: Final = ("bash", "zsh", "fish")
HELP: Final = frozenset({"--help", "-h"})


def load(module: str, name: str) -> Callable[..., Any]:
    """Import a function of `gcs.cli`. The garbage collector skips the modules now and later."""
    gc.disable()
    try:
        found: Callable[..., Any] = getattr(import_module(f"gcs.cli.{module}"), name)
    finally:
        gc.freeze()
        gc.enable()
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line. Returns: the exit code; 2 for bad arguments or configuration.

    Raises: SystemExit for bad arguments and for help, as argparse does.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given and given[0] in VERSION:
        print_json({"version": version().removeprefix("gcs ")}) if is_json(given) else print(version())
        return 0
    if given and given[0] in HELP:
        print(overview())
        return 0
    if not given or given[0] == JSON:
        _end(f"{overview()}\n\ngcs: error: ", "a command is missing", as_json=bool(given))
    parser, rest = find_parser(given)
    parsed = parser.parse_args(rest)
    try:
        return int(parsed.run(parsed))
    except GcsError as error:
        return failed(error, parsed, getattr(parsed, "error_code", None))


def version() -> str:
    from importlib.metadata import version as installed  # noqa: PLC0415 (a fifth of a command's import time)

    return f"gcs {installed('formation-gcs')}"


def overview() -> str:
    usage = "usage: gcs COMMAND ...\n       gcs COMMAND --help\n       gcs --version"
    return "\n".join([usage, "", DESCRIPTION, "", *_listed(names())])


def find_parser(given: Sequence[str]) -> tuple[Parser, Sequence[str]]:
    """Return the parser of the given command and its arguments. Ends the process for an unknown command."""
    word, rest = given[0], given[1:]
    if word not in GROUPS:
        if word not in names():
            wrong = f"there is no command {word!r}{_meant(word, names())}"
            _end("usage: gcs COMMAND ...; gcs --help lists them\ngcs: error: ", wrong, as_json=is_json(given))
        return make_parser(word), rest
    inside = {call.name.partition(" ")[2]: call.text for call in CALLS if call.name.startswith(f"{word} ")}
    if rest and rest[0] in HELP:
        print("\n".join([f"usage: gcs {word} COMMAND ...", "", GROUPS[word], "", *_listed(inside)]))
        raise SystemExit(0)
    if not rest or rest[0] not in inside:
        missing = not rest or rest[0] == JSON
        wrong = (
            "a word is missing" if missing else f"there is no gcs {word} {rest[0]}{_meant(rest[0], inside)}"
        )
        usage = "\n".join([f"usage: gcs {word} COMMAND ...", *_listed(inside), f"gcs {word}: error: "])
        _end(usage, wrong, as_json=is_json(given))
    return make_parser(f"{word} {rest[0]}"), rest[1:]


def make_parser(name: str, **options: Any) -> Parser:
    """Make the parser of one command by its full name; `options` go to argparse."""
    parser = Parser(prog=f"gcs {name}", allow_abbrev=False, **options)
    fill(parser, name)
    return parser


def fill(parser: Parser, name: str) -> None:
    """Add the arguments of one command to a parser, `--json` included, and set the function that runs it."""
    command = COMMANDS.get(name)
    if command is None:
        load("remote", "add_arguments")(parser, name)
    else:
        parser.description = command.text
        parser.set_defaults(error_code=command.error_code)
        parser.set_defaults(run=lambda parsed: int(load(command.module, f"run_{name}")(parsed)))
        load(command.options or command.module, f"add_{name}_arguments")(parser)
    for leaf in parser.leaves():
        leaf.add_argument(JSON, action="store_true", help=DOCUMENT if command is None else command.json)


def whole_parser() -> Parser:
    """Make one parser with every command, for completion and tests. It imports every module."""
    parser = Parser(prog="gcs", description=DESCRIPTION)
    parser.add_argument("--version", action="version", version=version())
    commands = parser.add_subparsers(dest="command", required=True)
    groups: dict[str, Any] = {}
    for name, command in COMMANDS.items():
        fill(commands.add_parser(name, help=command.text), name)
    for name, text in ((each.name, each.text) for each in (*CALLS, *ACTIONS)):
        group, _, last = name.rpartition(" ")
        if group and group not in groups:
            inside = commands.add_parser(group, help=GROUPS[group])
            groups[group] = inside.add_subparsers(dest=f"{group}_command", required=True)
        fill((groups[group] if group else commands).add_parser(last, help=text), name)
    return parser


def _listed(texts: Mapping[str, str]) -> list[str]:
    wide = max(len(name) for name in texts) + 2
    return [f"  {name:<{wide}}{text}" for name, text in texts.items()]


def _meant(word: str, known: Iterable[str]) -> str:
    near = get_close_matches(word, list(known), n=1)
    return f"; did you mean {near[0]}?" if near else ""


def _end(usage: str, wrong: str, *, as_json: bool) -> NoReturn:
    if as_json:
        fail(wrong, WRONG, as_json=True)
    else:
        print(usage + wrong, file=sys.stderr)
    raise SystemExit(WRONG)


def add_completion_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=SHELLS)
    parser.epilog = (
        "bash: gcs completion bash > ~/.local/share/bash-completion/completions/gcs;"
        " zsh: gcs completion zsh > _gcs, in a folder of $fpath;"
        " fish: gcs completion fish > ~/.config/fish/completions/gcs.fish"
    )


def run_completion(arguments: argparse.Namespace) -> int:
    """Print the script; with `--json` a JSON object that contains it. Returns: 0."""
    import shtab  # noqa: PLC0415 (only this command needs it)

    script = shtab.complete(whole_parser(), shell=arguments.shell)
    answer(arguments, {"shell": arguments.shell, "script": script}, script)
    return 0


def add_sim_arguments(parser: argparse.ArgumentParser) -> None:
    from gcs.sim import cli as sim  # noqa: PLC0415 (only this command needs it)

    sim.add_arguments(parser)


def run_sim(arguments: argparse.Namespace) -> int:
    """Run fake vehicles or a target alone. Returns: 0, 1 for a port or file in use, 2 for bad arguments."""
    from gcs.sim import cli as sim  # noqa: PLC0415 (only this command needs it)

    try:
        text = sim.greeting(arguments)
        if arguments.json:
            ports = sorted(set(sim.destinations(arguments)))
            flies = arguments.target is None
            event, vehicles = ("flying", arguments.count) if flies else ("sending", 0)
            text = json.dumps({"event": event, "text": text, "vehicles": vehicles, "ports": ports})
        sim.fly(arguments, text)
    except sim.FleetError as error:
        fail(str(error), error.code, as_json=arguments.json)
        return error.code
    return 0
