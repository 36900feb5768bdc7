"""Reads the audit after a restart or without a service: last known state, exclusions, interrupted flight."""

import json
from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from sqlite3 import DatabaseError, Row
from typing import Any, Final

from gcs.model.errors import GcsError
from gcs.model.interrupted_flight import INTERRUPTION, Before, Interruption, Triple, Written, triple
from gcs.model.lifecycle import AIRBORNE, ON_THE_GROUND, Phase, ShowPhase
from gcs.model.preflight_report import Exclusion
from gcs.model.state import VehicleId
from gcs.recording.audit_database import open_to_read

AUDIT: Final = "audit.sqlite"
"""Name of the audit file in the folder configured under `record`."""

EXCLUDED, INCLUDED, PAD, PHASE = "excluded", "included", "pad", "vehicle_phase"  # events
FOUND, OVER = "interrupted", "interruption_over"
BEGINS: Final = "show_begins_at"
BEGINS_NO_MORE: Final = ("show_began", "show_begin_cancelled", "show_begin_forgotten")

IN_THE_AIR: Final = AIRBORNE | {Phase.LOST}
ABOUT_TO_FLY: Final = frozenset({ShowPhase.PREFLIGHT, ShowPhase.ARMING})


@dataclass(frozen=True, slots=True)
class Session:
    """One run of the service."""

    id: str
    began_unix_s: float
    ended_unix_s: float | None  # None: it runs, or was killed
    folder: Path  # its flight data
    config: Mapping[str, Any]  # as `gcs.config.schema.Config.model_validate` takes it


@dataclass(frozen=True, slots=True)
class KnownVehicle:
    """The last known state of one vehicle. None: never known."""

    id: VehicleId
    session: str  # the newest that recorded it
    unix_s: float
    system_id: int
    link: str
    host: str | None  # an address and a port, or a serial port and 0
    port: int | None
    phase: str | None
    reason: str | None
    mode: str | None
    armed: bool | None
    home_m: tuple[float, float, float] | None  # show frame of its session's configuration


@dataclass(frozen=True, slots=True)
class LostBegin:
    """A show that still waited for its clock time when its session ended."""

    show: str
    at: str  # date and time, UTC


@dataclass(frozen=True, slots=True)
class KnownShow:
    """The last known state of the show."""

    session: str
    unix_s: float
    phase: str
    reason: str
    plan: Mapping[str, Any]  # formation, orbit, target ...; `time_s` is of a clock that has ended


@dataclass(frozen=True, slots=True)
class LastKnown:
    """All that is needed to find the vehicles and to continue their show."""

    session: Session | None  # the newest
    show: KnownShow | None
    vehicles: Mapping[VehicleId, KnownVehicle]


def audit_file(path: Path) -> Path:
    """Return the audit's file: the path itself, or the one in a folder."""
    return path / AUDIT if path.is_dir() else path


def last_known(path: Path) -> LastKnown:
    """Read the last known state, also while the service runs or after it was killed.

    Args:
        path: the audit, or its folder.

    Raises: GcsError when there is none, or the file is damaged or of another program.
    """
    session = show = None
    for row in rows(path, "SELECT * FROM sessions ORDER BY began_unix_s DESC, id DESC LIMIT 1"):
        times, folder = (row["began_unix_s"], row["ended_unix_s"]), Path(row["folder"])
        session = Session(row["id"], *times, folder, _object(path, "configuration", row["config"]))
    for row in rows(path, "SELECT session, unix_s, phase, reason, plan FROM show"):
        show = KnownShow(**{**dict(row), "plan": _object(path, "plan", row["plan"])})
    vehicles = rows(path, "SELECT * FROM vehicles ORDER BY id")
    return LastKnown(session, show, {row["id"]: _vehicle(row) for row in vehicles})


def _object(path: Path, what: str, text: str) -> dict[str, Any]:
    """Return a JSON object of the audit. Raises: GcsError when it is none."""
    try:
        decoded = json.loads(text)
    except (TypeError, ValueError, RecursionError) as error:
        raise GcsError(f"{audit_file(path)}: damaged: the {what} is no JSON: {error}") from None
    if not isinstance(decoded, dict):
        raise GcsError(f"{audit_file(path)}: damaged: the {what} is no JSON object")
    return decoded


def rows(path: Path, sql: str, *values: str) -> list[Row]:
    """Return the rows of a query. Raises: GcsError."""
    file = audit_file(path)
    with closing(open_to_read(file)) as connection:
        try:
            return connection.execute(sql, values).fetchall()
        except DatabaseError as error:
            raise GcsError(f"{file}: cannot be read: {error}") from None


def _vehicle(row: Row) -> KnownVehicle:
    values = dict(row)
    home_m = tuple(values.pop(name) for name in ("home_x_m", "home_y_m", "home_z_m"))
    armed = values.pop("armed")
    pad_m = None if None in home_m else home_m
    return KnownVehicle(**values, armed=None if armed is None else bool(armed), home_m=pad_m)


def exclusions(root: Path) -> dict[VehicleId, Exclusion]:
    """Excluded vehicles, by which operator, why and since when. To be called before a new session begins.

    Raises: GcsError when there is a record, and it cannot be read.
    """
    if not audit_file(root).is_file():
        return {}
    sql = f"SELECT * FROM events WHERE event IN ('{EXCLUDED}', '{INCLUDED}') ORDER BY rowid"  # noqa: S608
    out: dict[VehicleId, Exclusion] = {}
    for row in rows(root, sql):
        out.pop(row["vehicle"], None)
        if row["event"] == EXCLUDED:
            try:
                detail = json.loads(row["detail"])
                out[row["vehicle"]] = Exclusion(detail["by"], detail["reason"], float(row["unix_s"]))
            except (KeyError, TypeError, ValueError, RecursionError) as error:
                reason = f"the exclusion of {row['vehicle']} cannot be read: {error!r}"
                raise GcsError(f"{root}: {reason}") from None
    return out


def lost_begin(root: Path) -> LostBegin | None:
    """The show that waited when the newest session ended. To be called before a new session begins.

    Raises: GcsError when there is a record, and it cannot be read.
    """
    if not audit_file(root).is_file():
        return None
    names = ", ".join(f"'{name}'" for name in (BEGINS, *BEGINS_NO_MORE))
    newest = "SELECT id FROM sessions ORDER BY began_unix_s DESC, id DESC LIMIT 1"
    where = f"session = ({newest}) AND event IN ({names})"
    events = rows(root, f"SELECT event, detail FROM events WHERE {where} ORDER BY rowid DESC")  # noqa: S608
    if not events or events[0]["event"] != BEGINS:
        return None
    try:
        detail = json.loads(events[0]["detail"])
        return LostBegin(detail["show"], detail["at"])
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise GcsError(f"{root}: a show's time to begin cannot be read: {error!r}") from None


def interruption(root: Path) -> Interruption | None:
    """Return the interrupted flight, None if there is none. To be called before a new session begins.

    Raises: GcsError when there is a record, and it cannot be read.
    """
    if not audit_file(root).is_file():
        return None
    try:
        return _newest(root)
    except (KeyError, TypeError, ValueError) as error:
        raise GcsError(f"{root}: the record of the last session is invalid: {error!r}") from None


def _newest(root: Path) -> Interruption | None:
    last = last_known(root)
    session = last.session
    if session is None:
        return None
    names = ", ".join(f"'{name}'" for name in (PHASE, PAD, FOUND, OVER))
    sql = f"SELECT event, vehicle, detail FROM events WHERE session = ? AND event IN ({names}) ORDER BY rowid"  # noqa: S608
    reported = [
        (row["event"], row["vehicle"], json.loads(row["detail"])) for row in rows(root, sql, session.id)
    ]
    interruption = _unsettled((event, detail) for event, _, detail in reported)
    phases = {vehicle: detail for event, vehicle, detail in reported if event == PHASE}
    pads = {vehicle: triple(detail["pad_m"]) for event, vehicle, detail in reported if event == PAD}
    own = last.show if last.show is not None and last.show.session == session.id else None
    if session.ended_unix_s is not None:
        own, phases = None, {}
    show = ShowPhase.IDLE if own is None else ShowPhase(own.phase)
    if interruption is not None and dict(interruption.frame) != dict(session.config["show_frame"]):
        pads_lost = {name: replace(before, pad_m=None) for name, before in interruption.vehicles.items()}
        interruption = replace(interruption, vehicles=pads_lost)  # positions mean nothing in this frame
    vehicles = _in_the_air(last, phases, pads, interruption, show)
    if show in ON_THE_GROUND and show is not ShowPhase.COUNTDOWN and not vehicles:
        return None
    if show is ShowPhase.UNCONTROLLED and interruption is not None:
        show = interruption.show  # what was flown before control was lost
    if own is None or (show in ON_THE_GROUND and interruption is not None):
        if interruption is None:
            return None
        return replace(interruption, vehicles=vehicles)
    raw = own.plan.get("written")
    written = None
    if raw is not None:
        place = raw["name"], raw["hash"], raw["cue"], float(raw["clock_s"])
        written = Written(*place, dict(raw["parts"]))
    sql = "SELECT max(unix_s) AS unix_s FROM events WHERE session = ?"
    newest_s = rows(root, sql, session.id)[0]["unix_s"]
    return Interruption(
        session=session.id,
        unix_s=max(own.unix_s, newest_s or 0.0),
        show=show,
        reason=own.reason,
        frame=session.config["show_frame"],
        vehicles=vehicles,
        written=written,
        plan=own.plan,
    )


def _unsettled(reported: Iterable[tuple[str, Mapping[str, Any]]]) -> Interruption | None:
    """Return the newest interruption that was not settled: a stall may follow a restart."""
    interruption = None
    for event, detail in reported:
        if event == FOUND:
            interruption = INTERRUPTION.validate_python(detail)
        elif event == OVER:
            interruption = None
    return interruption


def _in_the_air(
    last: LastKnown,
    phases: Mapping[VehicleId, Mapping[str, Any]],
    pads: Mapping[VehicleId, Triple | None],
    interruption: Interruption | None,
    show: ShowPhase,
) -> dict[VehicleId, Before]:
    """Vehicles in the air, or about to take off, by the newest session, else by the one before it."""
    vehicles: dict[VehicleId, Before] = {}
    earlier = {} if interruption is None else interruption.vehicles
    for name, vehicle in last.vehicles.items():
        reported = phases.get(name, {"phase": Phase.OFFLINE, "reason": ""})
        phase, before = Phase(reported["phase"]), earlier.get(name)
        if phase in IN_THE_AIR or (phase is Phase.STANDBY and show in ABOUT_TO_FLY and name in pads):
            pad_m = pads.get(name, None if before is None else before.pad_m)
            vehicles[name] = Before(vehicle.system_id, phase, str(reported["reason"]), pad_m)
        elif before is not None and phase in {Phase.OFFLINE, Phase.PILOT}:
            vehicles[name] = before
    return vehicles
