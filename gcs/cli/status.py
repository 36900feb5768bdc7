"""`gcs status`: the fleet as a table in the terminal, for as long as somebody looks."""

import argparse
import time
from typing import Final

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from api import wire
from gcs.cli.remote import add_connection, connected, failed
from gcs.client import Client
from gcs.errors import ConfigError, GcsError
from gcs.lifecycle import Phase

PERIOD_S: Final = 0.5

OLD_S: Final = 1.0
POOR_LINK: Final = 0.8
LOW_BATTERY: Final = 0.25

STYLE: Final = {
    Phase.FORMATION: "green",
    Phase.LOST: "bold red",
    Phase.KILLED: "bold red",
    Phase.PILOT: "magenta",
    Phase.OFFLINE: "dim",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """`gcs status`."""
    parser.add_argument("--once", action="store_true", help="print it once, and end")
    add_connection(parser)


def run(arguments: argparse.Namespace) -> int:
    """Until Ctrl-C. Returns: the exit code."""
    console = Console()
    try:
        client = connected(arguments)
    except ConfigError as error:
        return failed(error)
    with client:
        if arguments.once:
            try:
                console.print(board(client.fleet()))
            except GcsError as error:
                return failed(error)
            return 0
        try:
            with Live(console=console, screen=True, auto_refresh=False) as live:
                while True:
                    live.update(newest(client), refresh=True)
                    time.sleep(PERIOD_S)
        except KeyboardInterrupt:
            return 0


def newest(client: Client) -> RenderableType:
    """The fleet, or why it cannot be seen: whoever watches must not take an old state for now."""
    try:
        return board(client.fleet())
    except GcsError as error:
        return Text(f"NO STATE: {error}", style="bold white on red")


def board(fleet: wire.Fleet) -> RenderableType:
    """Everything that an operator looks at."""
    return Group(
        _head(fleet), _vehicles(fleet), *(Text(f"! {text}", style="yellow") for text in fleet.notices)
    )


def _head(fleet: wire.Fleet) -> RenderableType:
    table = Table.grid(padding=(0, 2))
    alive = "[green]alive[/]" if fleet.control_alive else f"[bold red]DEAD: {escape(fleet.control_reason)}[/]"
    tick = fleet.tick
    table.add_row("show", f"[bold]{fleet.show.phase}[/]", escape(fleet.show.reason))
    if fleet.show.selected is not None:
        selected = fleet.show.selected
        at = f"{_number(selected.clock_s)} of {_number(selected.duration_s)} s"
        table.add_row("", escape(f"{selected.name}: {selected.cue}"), at)
    if fleet.show.countdown_s is not None:
        table.add_row("", "countdown", f"{_number(fleet.show.countdown_s)} s")
    table.add_row(
        "control",
        alive,
        f"tick {_number(tick.duration_p50_ms)} ms, p99 {_number(tick.duration_p99_ms)} ms,"
        f" late p99 {_number(tick.lateness_p99_ms)} ms, {tick.missed} missed",
    )
    formation = fleet.formation
    table.add_row(
        "formation",
        f"radius {_number(formation.radius_now_m)} of {_number(formation.radius_m)} m",
        f"height {_number(formation.height_now_m)} of {_number(formation.height_m)} m,"
        f" nearest two {_number(fleet.minimum_separation_m)} m",
    )
    for each in fleet.reactions:
        whom = f" {', '.join(each.vehicles)}" if each.vehicles else ""
        table.add_row(
            "reaction", Text(f"{each.action}{whom}", style="bold red"), escape(f"{each.cause}: {each.reason}")
        )
    if (energy := _energy(fleet.estimates)) != "":
        table.add_row("energy", energy, "")
    table.add_row("possible", ", ".join(fleet.show.possible) or "-", f"access {escape(fleet.access)}")
    return table


def _energy(found: wire.Estimates | None) -> str:
    """Batteries and times in one line; what is not known is left out."""
    if found is None:
        return ""
    told = []
    if found.battery_least is not None:
        told.append(f"battery least {found.battery_least:.0%} ({found.battery_least_vehicle})")
    if found.battery_median is not None:
        told.append(f"median {found.battery_median:.0%}")
    if found.low_s is not None:
        told.append(f"low in {_minutes(found.low_s)} ({found.low_vehicle})")
    if found.assembled_s is not None:
        told.append(f"assembled in ~{found.assembled_s:.0f} s")
    if found.home_s is not None:
        told.append(f"home in ~{found.home_s:.0f} s")
    return escape(", ".join(told))


def _minutes(left_s: float) -> str:
    return f"~{left_s:.0f} s" if left_s < 90.0 else f"~{left_s / 60.0:.0f} min"


def _vehicles(fleet: wire.Fleet) -> RenderableType:
    table = Table(expand=True)
    for name in ("vehicle", "phase", "mode", "height m", "speed m/s", "battery", "link", "age s", "why"):
        table.add_column(name, justify="left" if name in {"vehicle", "phase", "mode", "why"} else "right")
    for each in fleet.vehicles:
        velocity = each.velocity
        known = None if velocity is None else (velocity.x_m_s, velocity.y_m_s, velocity.up_m_s)
        speed_m_s = None
        if known is not None and None not in known:
            speed_m_s = sum((part or 0.0) ** 2 for part in known) ** 0.5
        battery = each.battery_remaining
        age_s = each.position_age_s
        table.add_row(
            escape(each.id),
            Text(each.phase, style=STYLE.get(each.phase, "")),
            each.mode.name.lower(),
            _number(each.position.height_m),
            _number(speed_m_s),
            _warned(_percent(battery), bad=battery is not None and battery < LOW_BATTERY),
            _warned(_percent(each.link_quality), bad=(each.link_quality or 0.0) < POOR_LINK),
            _warned(_number(age_s), bad=age_s is None or age_s > OLD_S),
            escape(each.restrained_by or each.reason),
        )
    return table


def _warned(text: str, *, bad: bool) -> Text:
    return Text(text, style="bold red" if bad else "")


def _number(value: float | None) -> str:
    return "?" if value is None else f"{value:.1f}"


def _percent(share: float | None) -> str:
    return "?" if share is None else f"{share:.0%}"
