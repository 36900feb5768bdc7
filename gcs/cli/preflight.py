"""`gcs preflight`: the checks before a start, as tables. Exit code 1 when a check fails."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Final

from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from gcs.cli.output import REFUSED, print_json
from gcs.cli.remote import add_connection, connected
from gcs.model.preflight_report import State

if TYPE_CHECKING:
    from gcs.api.schemas import reports

STYLE: Final = {State.PASS: "green", State.FAIL: "bold red", State.UNKNOWN: "bold yellow"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "vehicles",
        nargs="*",
        metavar="VEHICLE",
        help="vehicles that shall fly (default: all that are online)",
    )
    parser.add_argument("--all", action="store_true", help="list the checks that pass, too")
    add_connection(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the report. Returns: the exit code. Raises: GcsError."""
    with connected(arguments) as client:
        report = client.preflight.report(arguments.vehicles or None)
    if arguments.json:
        print_json(report.model_dump(mode="json"))
    else:
        Console().print(board(report, everything=arguments.all))
    return 0 if report.passes else REFUSED


def board(report: reports.Preflight, *, everything: bool) -> RenderableType:
    """Format the report: failed checks first, what was not checked, and every vehicle that does not fly."""
    table = Table(expand=True)
    for name in ("whose", "check", "state", "measured", "limit", "what is wrong, and what to do"):
        table.add_column(name)
    whose = [("fleet", check) for check in report.fleet]
    whose += [(one.id, check) for one in report.vehicles if one.flies for check in one.checks]
    for name, check in whose:
        if everything or check.state is not State.PASS:
            table.add_row(
                escape(name),
                escape(check.name),
                Text(check.state, style=STYLE[check.state]),
                "" if check.value is None else escape(f"{check.value:.2f} {check.unit}".strip()),
                escape(check.limit),
                escape(". ".join(text for text in (check.problem, check.to_do) if text)),
            )
    passed = sum(check.state is State.PASS for _, check in whose)
    of = "no show is selected" if report.show is None else f"show {report.show}"
    verdict = "[green]ready to start[/]" if report.passes else "[bold red]not ready to start[/]"
    head = f"{verdict}: {passed} of {len(whose)} checks pass; {escape(of)}"
    left = [f"not flying: {name}: {reason}" for name, reason in report.not_flying.items()]
    unlooked = [f"not looked at: {text}" for text in report.not_checked]
    lines = (Text(f"! {text}", style="yellow") for text in (*left, *unlooked))
    return Group(head, *([table] if table.row_count else []), *lines)
