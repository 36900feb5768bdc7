"""`gcs report`: the report on a recorded flight, as text, JSON or HTML."""

import argparse
import json
from collections import Counter
from dataclasses import asdict, replace
from pathlib import Path
from typing import Final

from gcs.cli.output import kinds, require_matplotlib
from gcs.cli.progress import Report, part_of, share_of
from gcs.config import schema as configuration
from gcs.model.errors import GcsError, visible
from gcs.recording.audit_reader import AUDIT, last_known
from gcs.recording.flight_report import EXIT_CODES, FlightReport, make_flight_report
from gcs.recording.mcap_reader import FlightData, Standard
from gcs.recording.trajectories import FlownTrajectories, estimated, true

MEANING: Final = {
    "kept": "all of the flight was judged, and no limit was broken",
    "broken": "at least one limit was broken",
    "incomplete": "nothing that could be judged broke a limit, but not all could be judged",
}

READ_SHARE: Final = 0.8
"""Share of a report's time that is spent reading files, estimated from a record of the shipped demo."""

FLIGHT = "flight*.mcap"
TRUTH = "truth*.jsonl"


def run_report(arguments: argparse.Namespace) -> int:
    """Make the report. Returns: 0 limits kept, 1 broken, 3 incomplete (not all judged), 2 invalid input."""
    if arguments.html:
        require_matplotlib("--html")
    with share_of("judging the flight", shown=not arguments.json) as report_share:
        flight_report, source = _judge(arguments, report_share)
    text = json.dumps(asdict(flight_report.report(source)), indent=2)
    if arguments.report:
        _write(Path(arguments.report), text + "\n")
    if arguments.html:
        from gcs.cli.flight_report_page import page  # noqa: PLC0415  (60 MB, only for HTML)

        _write(Path(arguments.html), page(flight_report, source))
    print(text if arguments.json else visible(summary(flight_report, source)))
    return EXIT_CODES[flight_report.verdict]


def _judge(arguments: argparse.Namespace, report: Report) -> tuple[FlightReport, str]:
    flights, truths = found_files([Path(name) for name in arguments.files])
    if len(flights) > 1:
        raise GcsError(f"{', '.join(map(str, flights))}: one flight at a time")
    data = FlightData(flights[0]) if flights else None
    if arguments.config:
        file = configuration.find(arguments.config)
        standard = Standard.of(configuration.load(file).model_dump(mode="json"), str(file))
    elif data is not None:
        standard = Standard.of(data.about.config, str(data.path))
    else:
        raise GcsError(f"{truths[0]}: it does not say what holds; give flight.mcap too, or --config FILE")
    flight_read = 0.0 if data is None else READ_SHARE / 2.0 if truths else READ_SHARE
    believed = estimated(data, part_of(report, 0.0, flight_read)) if data is not None else None
    desired = arguments.positions or ("true" if truths else "estimated")
    if desired == "true" and not truths:
        raise GcsError("--positions true: there is no truth file; gcs sim --truth writes one")
    trajectories: FlownTrajectories | None = believed
    if desired == "true":
        read = part_of(report, flight_read, READ_SHARE)
        trajectories = true(
            truths, standard.frame, believed, data.about.ids if data is not None else (), read
        )
    if trajectories is None:
        raise GcsError("--positions estimated: there is no flight.mcap")
    if believed is not None:
        trajectories = replace(trajectories, site_hash=believed.site_hash, show_hashes=believed.show_hashes)
    used = truths if desired == "true" else flights
    rest = part_of(report, READ_SHARE, 1.0)
    judged = make_flight_report(trajectories, standard, by_it_alone=bool(arguments.config), on_progress=rest)
    return judged, ", ".join(str(path) for path in used)


def found_files(paths: list[Path]) -> tuple[list[Path], list[Path]]:
    """Sort paths into flight data and truth files. Raises: GcsError for other files."""
    flights: list[Path] = []
    truths: list[Path] = []
    for path in paths:
        if path.is_dir():
            folder = session_folder(path)
            inside = sorted(folder.glob(FLIGHT)), sorted({*path.glob(TRUTH), *folder.glob(TRUTH)})
            if not any(inside):
                raise GcsError(f"{path}: there is no {FLIGHT} and no {TRUTH} in it")
            flights += inside[0]
            truths += inside[1]
        elif path.suffix == ".jsonl":
            truths.append(path)
        elif path.exists():
            flights.append(path)
        else:
            raise GcsError(f"{path}: there is no such file")
    return flights, truths


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise GcsError(f"{path}: cannot be written: {error.strerror or error}") from None


def summary(flight_report: FlightReport, source: str) -> str:
    trajectories = flight_report.trajectories
    known = kinds(Counter(trajectories.autopilots))
    flown = f"{len(trajectories.ids)} vehicles{f' ({known})' if known else ''}"
    lines = [f"{source}: {flown}, {flight_report.duration_s:.0f} s"]
    lines += [f"based on {trajectories.based_on}: {trajectories.uncertainty}"]
    lines += [f"{what} {digest}" for what, digest in flight_report.hashes]
    lines += [f"note: {remark}" for remark in trajectories.remarks]
    for check in flight_report.checks:
        worst = "nothing to judge" if check.worst is None else f"{check.worst:g}"
        where = f"{check.vehicle} at {check.at_s:g} s" if check.at_s is not None else check.vehicle
        mark = {True: "kept  ", False: "BROKEN", None: "-     "}[check.kept]
        limit = f"limit {check.limit:g} {check.unit}{check.leeway}"
        lines.append(f"  {mark}  {check.name:<36} {worst:>16}  {limit}  {where}".rstrip())
    lines += [f"target {each.text}" for each in trajectories.tracking]
    lines += [f"traffic {each.text}" for each in trajectories.traffic]
    lines += [] if flight_report.ground is None else [f"ground {flight_report.ground.text}"]
    lines += [f"wind {flight_report.wind}"] if flight_report.wind else []
    lines.append(f"verdict: {flight_report.verdict}: {MEANING[flight_report.verdict]}")
    lines += [f"  not judged: {text}" for text in flight_report.missing]
    return "\n".join(lines)


def session_folder(folder: Path) -> Path:
    """Return the folder of a record's newest session, else `folder`. Raises: GcsError for a bad audit."""
    if not (folder / AUDIT).is_file():
        return folder
    session = last_known(folder).session
    return folder if session is None else folder / session.id
