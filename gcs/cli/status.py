"""`gcs status`, `gcs stations` and `gcs preflight`: tables of the fleet, its stations, and the checks.

A vehicle has one line at any width. Phase and mode are never cut; on a narrow terminal whole columns are left
out, and reasons are below the table, one line for all vehicles with the same reason.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from math import hypot, inf
from operator import attrgetter
from typing import TYPE_CHECKING, Final, NamedTuple

from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from gcs.cli.alarms import PERIOD_S, alarm_lines, show_state
from gcs.cli.output import REFUSED, kinds, print_json
from gcs.cli.remote import add_connection, connected, document
from gcs.model.lifecycle import ON_THE_GROUND, Phase

if TYPE_CHECKING:
    from gcs.api.schemas import fleet as schemas
    from gcs.model.preflight_report import Check, PreflightAction, PreflightCause, PreflightReport
    from gcs.service import BeginView, StationView


OLD_S: Final = 1.0
POOR_LINK: Final = 0.8
LOW_BATTERY: Final = 0.25

BAD: Final = "bold red"
URGENT: Final = "bold white on red"
WEIGHT: Final = {"": "", "bad": BAD, "urgent": URGENT}

STYLE: Final = {
    Phase.FORMATION: "green",
    Phase.LOST: BAD,
    Phase.KILLED: BAD,
    Phase.PILOT: "magenta",
    Phase.OFFLINE: "dim",
}

ORDINARY: Final = frozenset({Phase.FORMATION, Phase.TAKEOFF, Phase.RETURN, Phase.LANDING})
"""Phases whose reason adds nothing unless the safety filter holds the vehicle back."""

GAP: Final = 2


class TableColumn(NamedTuple):
    """One column: its head, and the cell for a vehicle.

    `key` sorts vehicles by it, those that need attention first: unknown values, low battery or link, old
    position.
    """

    head: str
    cell: Callable[[schemas.Vehicle], Text]
    key: Callable[[schemas.Vehicle], float | str] = attrgetter("id")
    is_number: bool = True


def _speed_m_s(each: schemas.Vehicle) -> float | None:
    if each.vx_m_s is None or each.vy_m_s is None or each.vup_m_s is None:
        return None
    return hypot(each.vx_m_s, each.vy_m_s, each.vup_m_s)


def _why(each: schemas.Vehicle) -> str:
    """The reason for an unusual state; empty when the phase says all."""
    if each.limited_by:
        return each.limited_by
    ordinary = each.phase in ORDINARY or (each.phase is Phase.STANDBY and each.ready)
    return "" if ordinary else each.reason


def _or(value: float | None, unknown: float) -> float:
    return unknown if value is None else value


COLUMNS: Final = {
    "vehicle": TableColumn("vehicle", lambda each: Text(each.id), is_number=False),
    "station": TableColumn(
        "station",
        lambda each: Text(each.station or "?"),
        lambda each: each.station or "",
        is_number=False,
    ),
    "phase": TableColumn(
        "phase",
        lambda each: Text(each.phase, STYLE.get(each.phase, "")),
        lambda each: each.phase,
        is_number=False,
    ),
    "autopilot": TableColumn(
        "autopilot", lambda each: Text(each.autopilot), lambda each: each.autopilot, is_number=False
    ),
    "mode": TableColumn("mode", lambda each: Text(each.mode.name.lower()), is_number=False),
    "height": TableColumn(
        "height m", lambda each: Text(number(each.height_m)), lambda each: _or(each.height_m, -inf)
    ),
    "speed": TableColumn(
        "speed m/s", lambda each: Text(number(_speed_m_s(each))), lambda each: -(_speed_m_s(each) or inf)
    ),
    "battery": TableColumn(
        "battery",
        lambda each: _warned(percent(each.battery), _or(each.battery, inf) < LOW_BATTERY),
        lambda each: _or(each.battery, -inf),
    ),
    "link": TableColumn(
        "link",
        lambda each: _warned(percent(each.link_quality), _or(each.link_quality, 0.0) < POOR_LINK),
        lambda each: _or(each.link_quality, -inf),
    ),
    "age": TableColumn(
        "age s",
        lambda each: _warned(number(each.position_age_s), _or(each.position_age_s, inf) > OLD_S),
        lambda each: -_or(each.position_age_s, inf),
    ),
    "why": TableColumn("why", lambda each: Text(_why(each)), is_number=False),
}

WHOLE: Final = frozenset({"station", "phase", "autopilot", "mode"})
"""Columns that are never cut."""

DROPPED: Final = ("why", "age", "speed", "link", "autopilot", "height")
"""Columns that are left out on a narrow terminal, in this order."""

SORTED: Final = ("vehicle", "station", "phase", "autopilot", "battery", "link", "age", "height", "speed")


def board(
    fleet: schemas.Fleet,
    width: int,
    *,
    columns: Sequence[str] | None = None,
    sort: str | None = None,
) -> RenderableType:
    """Format alarms, fleet and vehicles, `width` characters wide; without `columns` as many as fit."""
    vehicles = fleet.vehicles if sort is None else sorted(fleet.vehicles, key=COLUMNS[sort].key)
    shown = COLUMNS | {"station": _station_column(fleet.stations)}
    chosen = _fitting(vehicles, width, shown) if columns is None else tuple(columns)
    alarms = alarm_lines(fleet.severity, fleet.alarms)
    reasons = [] if "why" in chosen else _reasons(vehicles)
    table = _table(vehicles, {name: shown[name] for name in chosen}, width)
    ready = readiness(fleet)
    top = [*_not_received(fleet.stations), alarms, *([] if ready is None else [ready])]
    return Group(*top, _head(fleet), Text(), table, *reasons)


def readiness(fleet: schemas.Fleet) -> Text | None:
    """Whether a start would be accepted, else what to mend first, as the service has it; in the air None."""
    if fleet.show.phase not in ON_THE_GROUND or fleet.counts.airborne:
        return None
    if not fleet.show.start_refused:
        return Text("ready to start", "green")
    return Text(f"not ready: {fleet.show.start_refused}; see gcs preflight", BAD)


def _station_column(stations: Sequence[StationView]) -> TableColumn:
    """The column that marks vehicles of stations that are not received."""
    missing = {station.name for station in stations if not station.received}

    def cell(each: schemas.Vehicle) -> Text:
        return Text(f"{each.station} !", BAD) if each.station in missing else Text(each.station or "?")

    return COLUMNS["station"]._replace(cell=cell)


def _needed(vehicles: Sequence[schemas.Vehicle], column: TableColumn) -> int:
    return max([len(column.head), *(column.cell(each).cell_len for each in vehicles)])


def _fitting(
    vehicles: Sequence[schemas.Vehicle], width: int, columns: Mapping[str, TableColumn]
) -> tuple[str, ...]:
    """Choose the columns that fit, each as wide as its widest cell."""
    needed = {name: _needed(vehicles, column) for name, column in columns.items()}
    chosen = dict.fromkeys(columns)
    if not any(each.station for each in vehicles):
        del chosen["station"]
    if len({each.autopilot for each in vehicles}) < 2:
        del chosen["autopilot"]  # it is in the head
    for name in DROPPED:
        if sum(needed[each] + GAP for each in chosen) - GAP <= width:
            break
        chosen.pop(name, None)
    return tuple(chosen)


def _table(
    vehicles: Sequence[schemas.Vehicle], columns: Mapping[str, TableColumn], width: int
) -> RenderableType:
    table = Table(box=None, padding=(0, GAP, 0, 0), pad_edge=False, width=width if "why" in columns else None)
    for name, column in columns.items():
        least = _needed(vehicles, column) if name in WHOLE else None
        table.add_column(
            column.head,
            justify="right" if column.is_number else "left",
            no_wrap=True,
            overflow="ellipsis",
            min_width=least,
            ratio=1 if name == "why" else None,
        )
    for each in vehicles:
        table.add_row(*(column.cell(each) for column in columns.values()))
    return table


def _reasons(vehicles: Sequence[schemas.Vehicle]) -> list[RenderableType]:
    found: dict[str, list[str]] = {}
    for each in vehicles:
        if why := _why(each):
            found.setdefault(why, []).append(each.id)
    lines = [Text(f"{', '.join(names)}: {why}", style="dim") for why, names in found.items()]
    return [Text(), *lines] if lines else []


def _head(fleet: schemas.Fleet) -> RenderableType:
    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True)
    table.add_column()
    tick, formation = fleet.tick, fleet.formation
    for row, line in enumerate(_show_lines(fleet.show)):
        table.add_row("" if row else "show", line)
    for row, station in enumerate(fleet.stations):
        table.add_row("" if row else "stations", _station_line(station))
    alive = ("alive", "green") if fleet.control_alive else (f"DEAD: {fleet.control_reason}", BAD)
    times = (
        f"  tick {number(tick.duration_p50_ms)} ms, p99 {number(tick.duration_p99_ms)} ms,"
        f" late p99 {number(tick.lateness_p99_ms)} ms, {tick.missed} missed"
    )
    table.add_row("control", Text.assemble(alive, times))
    table.add_row("", Text(tick.scheduling.text))
    shape = (
        f"radius {number(formation.radius_now_m)} of {number(formation.radius_m)} m,"
        f" height {number(formation.height_now_m)} of {number(formation.height_m)} m,"
        f" nearest two {number(fleet.minimum_separation_m)} m"
    )
    table.add_row("formation", Text(shape))
    table.add_row("vehicles", _summary(fleet))
    for name, feature in fleet.features.reporting.items():
        if parts := [(text, WEIGHT[weight]) for text, weight in feature.line(fleet.unix_time_s)]:
            table.add_row(name, Text.assemble(*parts))
    if energy := _energy(fleet.estimates):
        table.add_row("energy", Text(energy))
    table.add_row("possible", _possible(fleet.show))
    table.add_row("access", Text(fleet.access))
    return table


def _possible(show: schemas.Show) -> Text:
    """What is accepted now; on the ground also that a start is not. Why stands above everything."""
    text = Text(", ".join(show.possible) or "-")
    return text.append("; no start: not ready", BAD) if _is_refused(show) else text


def _is_refused(show: schemas.Show) -> bool:
    return bool(show.start_refused) and show.phase in ON_THE_GROUND


def _show_lines(show: schemas.Show) -> Iterator[Text]:
    yield Text.assemble((show.phase, "bold"), f"  {show.reason}" if show.reason else "")
    if show.selected is not None:
        selected = show.selected
        at = f"{number(selected.clock_s)} of {number(selected.duration_s)} s"
        yield Text(f"{selected.name}: {selected.cue}  {at}")
        if (begin := selected.begin) is not None:
            yield Text(_begins(begin))
    if show.countdown_s is not None:
        yield Text(f"countdown {number(show.countdown_s)} s")


def _begins(begin: BeginView) -> str:
    """How a show waits for its clock time, which is printed as this machine's."""
    if begin.at_unix_time_s is None or begin.in_s is None:
        return f"{begin.state}: no time to begin is given"
    at = datetime.fromtimestamp(begin.at_unix_time_s).astimezone().strftime("%H:%M:%S %Z")
    return f"{begin.state}: begins at {at}, in {number(begin.in_s)} s"


def _summary(fleet: schemas.Fleet) -> Text:
    """How many vehicles are where, and of which autopilots."""
    counts = fleet.counts
    summary = Text(f"{counts.airborne} airborne, {counts.on_ground} on the ground, {counts.offline} offline")
    if counts.uncontrolled:
        summary.append(f", {counts.uncontrolled} not under control", "magenta")
    if counts.unknown:
        summary.append(f", {counts.unknown} unknown", BAD)
    if fleet.vehicles:
        summary.append(f"; {kinds(Counter(each.autopilot for each in fleet.vehicles))}")
    return summary


def _not_received(stations: Sequence[StationView]) -> list[RenderableType]:
    """One line for each station that is not received, above everything else."""
    return [
        Text(
            f" NOT RECEIVED: station {station.name}, {_silence(station)}."
            f" Its vehicles ({station.vehicles}) are shown as last received."
            f"{' It leads; gcs lead take has the station that is asked lead.' if station.leads else ''} ",
            style=URGENT,
        )
        for station in stations
        if not station.received
    ]


def _silence(station: StationView) -> str:
    return "never" if station.silent_s is None else f"silent for {number(station.silent_s)} s"


def _station_line(station: StationView) -> Text:
    if not station.received:
        return Text(f"{station.name}: NOT RECEIVED, {_silence(station)}", BAD)
    line = Text(f"{station.name}: {station.show}, {station.vehicles} vehicles")
    if not station.own:
        line.append(f", delay {milliseconds(station.delay_s)}")
    marks = [*(["leads"] if station.leads else []), *(["asked"] if station.own else [])]
    return line.append(f" ({', '.join(marks)})", "bold") if marks else line


def station_board(stations: Sequence[StationView]) -> RenderableType:
    """Format the stations of a site, one in each line."""
    if not stations:
        return Text("one station flies all vehicles")
    table = Table(box=None, padding=(0, GAP, 0, 0), pad_edge=False)
    for name in ("station", "leads", "received", "show"):
        table.add_column(name, no_wrap=True)
    for name in ("vehicles", "delay"):
        table.add_column(name, no_wrap=True, justify="right")
    for station in stations:
        received = Text("yes", "green") if station.received else Text(f"NO, {_silence(station)}", BAD)
        table.add_row(
            Text(f"{station.name} (asked)" if station.own else station.name),
            Text("leads" if station.leads else "", "bold"),
            Text("-") if station.own else received,
            Text(station.show),
            Text(str(station.vehicles)),
            Text("-" if station.own else milliseconds(station.delay_s)),
        )
    return Group(*_not_received(stations), table)


def _energy(found: schemas.Estimates | None) -> str:
    """Format batteries and times in one line, without unknown values."""
    if found is None:
        return ""
    summary = []
    if found.battery_least is not None:
        summary.append(f"battery least {found.battery_least:.0%} ({found.battery_least_vehicle})")
    if found.battery_median is not None:
        summary.append(f"median {found.battery_median:.0%}")
    if found.low_s is not None:
        left = f"{found.low_s:.0f} s" if found.low_s < 90.0 else f"{found.low_s / 60.0:.0f} min"
        summary.append(f"low in ~{left} ({found.low_vehicle})")
    if found.assembled_s is not None:
        summary.append(f"assembled in ~{found.assembled_s:.0f} s")
    if found.home_s is not None:
        summary.append(f"home in ~{found.home_s:.0f} s")
    return ", ".join(summary)


def _warned(text: str, bad: bool) -> Text:
    return Text(text, style=BAD if bad else "")


def number(value: float | None) -> str:
    """Format with one decimal; a question mark when not known."""
    return "?" if value is None else f"{value:.1f}"


def milliseconds(seconds: float | None) -> str:
    """Format a short time; a question mark when not known."""
    return "?" if seconds is None else f"{1000.0 * seconds:.0f} ms"


def percent(share: float | None) -> str:
    """Format a share of 1 in per cent; a question mark when not known."""
    return "?" if share is None else f"{share:.0%}"


def add_status_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--watch",
        nargs="?",
        type=_seconds,
        const=PERIOD_S,
        metavar="SECONDS",
        help=f"go on until Ctrl-C, anew every so many seconds ({PERIOD_S:g})",
    )
    parser.add_argument("--once", action="store_true", help=argparse.SUPPRESS)  # the default
    parser.add_argument(
        "--columns", type=_columns, metavar="A,B", help=f"these and no others, of {', '.join(COLUMNS)}"
    )
    parser.add_argument(
        "--sort", choices=SORTED, help="what needs a look first: least battery, oldest position"
    )
    add_connection(parser)


def run_status(arguments: argparse.Namespace) -> int:
    """Print the table, or with `--json` the state as `gcs state` does. Returns: 0. Raises: GcsError."""
    width = Console().width
    with connected(arguments) as client:

        def render(fleet: schemas.Fleet) -> RenderableType:
            return board(fleet, width, columns=arguments.columns, sort=arguments.sort)

        return show_state(client.fleet, render, arguments.watch, arguments)


def add_stations_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--watch", action="store_true", help="go on until Ctrl-C")
    add_connection(parser)


def run_stations(arguments: argparse.Namespace) -> int:
    """Print the table of stations, or with `--json` the list. Returns: 0. Raises: GcsError."""
    with connected(arguments) as client:
        period_s = PERIOD_S if arguments.watch else None
        return show_state(client.stations, station_board, period_s, arguments)


def _columns(text: str) -> tuple[str, ...]:
    """Parse column names. Raises: ArgumentTypeError for an unknown column."""
    names = tuple(dict.fromkeys(text.split(",")))
    unknown = [name for name in names if name not in COLUMNS]
    if unknown:
        raise argparse.ArgumentTypeError(f"there is no column {unknown[0]!r}; there are {', '.join(COLUMNS)}")
    return names


def _seconds(text: str) -> float:
    """Parse a period. Raises: ArgumentTypeError for an invalid one."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0.1 <= seconds <= 3600.0:
        raise argparse.ArgumentTypeError(f"{text!r}: seconds from 0.1 to 3600")
    return seconds


PASS: Final = "pass"  # noqa: S105 (no password)
CHECK_STYLE: Final = {"pass": "green", "fail": "bold red", "unknown": "bold yellow"}


def add_preflight_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "vehicles",
        nargs="*",
        metavar="VEHICLE",
        help="vehicles that shall fly (default: all that are not left out)",
    )
    parser.add_argument("--all", action="store_true", help="list the checks that pass, too")
    parser.add_argument(
        "--wait",
        type=_seconds,
        metavar="SECONDS",
        help="until a start would be accepted, at most so long, also for a service that does not answer yet",
    )
    add_connection(parser)


def run_preflight(arguments: argparse.Namespace) -> int:
    """Print the report. Returns: the exit code. Raises: GcsError."""
    with connected(arguments) as client:
        named = arguments.vehicles or None
        report = (
            client.preflight.report(named)
            if arguments.wait is None
            else client.preflight.wait_until_ready(arguments.wait, named)
        )
    if arguments.json:
        print_json(document(report))
    else:
        Console().print(preflight_board(report, everything=arguments.all))
    return 0 if report.passes else REFUSED


def preflight_board(report: PreflightReport, *, everything: bool) -> RenderableType:
    """Format the report: what to mend first, what was not checked, and every vehicle that does not fly."""
    checks = [("fleet", check) for check in report.fleet]
    checks += [(one.id, check) for one in report.vehicles if one.flies for check in one.checks]
    passed = sum(check.state == PASS for _, check in checks)
    flies = sum(one.flies for one in report.vehicles)
    of = "no show is selected" if report.show is None else f"show {report.show}"
    which = kinds(Counter(f"{one.autopilot} {one.version}".strip() for one in report.vehicles))
    counted = f"{flies} of {len(report.vehicles)} vehicles, {passed} of {len(checks)} checks pass"
    verdict = "[green]ready to start[/]" if report.passes else "[bold red]not ready to start[/]"
    if report.in_flight:
        verdict, counted = f"[bold]in flight[/]: {escape(report.in_flight)}", f"before take-off {counted}"
    head = f"{verdict}: {counted}; {escape('; '.join(filter(None, (of, which))))}"
    left = [f"not flying: {', '.join(names)}: {reason}" for reason, names in _by_reason(report).items()]
    unchecked = [f"not checked: {text}" for text in report.not_checked]
    lines = (Text(f"! {text}", style="yellow") for text in (*left, *unchecked))
    blocks = [] if report.in_flight else [_block(at, each) for at, each in enumerate(report.causes, 1)]
    return Group(head, *blocks, *([_every_check(checks)] if everything else []), *lines)


def _by_reason(report: PreflightReport) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for name, reason in report.not_flying.items():
        found.setdefault(reason, []).append(name)
    return found


def _block(number: int, cause: PreflightCause) -> Text:
    """One cause: what is wrong, what to do, the command that mends it, and what follows from it."""
    block = Text(f"{number}. ").append(cause.text, CHECK_STYLE[cause.state])
    if cause.to_do:
        block.append(f"\n  {cause.to_do}")
    if (action := cause.action) is not None:
        then = f": {action.then}" if action.then else ""
        block.append(f"\n  {action.label}{then}", "bold").append(f"  ({_command(action)})", "dim")
    for text in cause.follows:
        block.append(f"\n    follows: {text}", "dim")
    return block


def _command(action: PreflightAction) -> str:
    """The command line that does it."""
    match str(action.remedy):
        case "set-radius":
            return f"gcs radius {action.radius_m:g}"
        case "remove-obstacle":
            return f"gcs obstacle remove {action.obstacle}"
        case "confirm-down":
            return f"gcs confirm-down {' '.join(action.vehicles)}"
    if len(action.vehicles) == 1:
        return f"gcs exclude {action.vehicles[0]}"
    return f"for v in {' '.join(action.vehicles)}; do gcs exclude $v; done"


def _every_check(checks: Sequence[tuple[str, Check]]) -> Table:
    table = Table(expand=True)
    for name in ("vehicle", "check", "state", "measured", "limit", "what is wrong, and what to do"):
        table.add_column(name)
    for name, check in checks:
        table.add_row(
            escape(name),
            escape(check.name),
            Text(check.state, style=CHECK_STYLE[check.state]),
            "" if check.value is None else escape(f"{check.value:.2f} {check.unit}".strip()),
            escape(check.limit),
            escape(". ".join(text for text in (check.problem, check.to_do) if text)),
        )
    return table
