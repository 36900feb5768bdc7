"""Finds an interrupted flight in the record: of the newest session, or one that it had found itself."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from gcs.model.errors import GcsError
from gcs.model.interrupted_flight import Before, Interruption, Triple, Written, triple
from gcs.model.lifecycle import AIRBORNE, ON_THE_GROUND, Phase, ShowPhase
from gcs.model.state import VehicleId
from gcs.recording.last_known import KnownShow, LastKnown, audit_file, last_known, rows

FOUND: Final = "interrupted"
OVER: Final = "interruption_over"
PAD: Final = "pad"
PHASE: Final = "vehicle_phase"

IN_THE_AIR: Final = AIRBORNE | {Phase.LOST}
ABOUT_TO_FLY: Final = frozenset({ShowPhase.PREFLIGHT, ShowPhase.ARMING})


def interruption(root: Path) -> Interruption | None:
    """Return the interrupted flight, None if there is none. To be called before a new session begins.

    Raises: GcsError when there is a record, and it cannot be read.
    """
    if not audit_file(root).is_file():
        return None
    try:
        return _newest(root)
    except (KeyError, TypeError, ValueError) as error:
        raise GcsError(f"{root}: what the record says of its last session is none: {error!r}") from None


def _newest(root: Path) -> Interruption | None:
    known = last_known(root)
    session = known.session
    if session is None:
        return None
    names = ", ".join(f"'{name}'" for name in (PHASE, PAD, FOUND, OVER))
    sql = f"SELECT event, vehicle, detail FROM events WHERE session = ? AND event IN ({names}) ORDER BY rowid"  # noqa: S608
    reported = [
        (row["event"], row["vehicle"], json.loads(row["detail"])) for row in rows(root, sql, session.id)
    ]
    found = _unsettled((event, detail) for event, _, detail in reported)
    phases = {vehicle: detail for event, vehicle, detail in reported if event == PHASE}
    pads = {vehicle: triple(detail["pad_m"]) for event, vehicle, detail in reported if event == PAD}
    own = known.show if known.show is not None and known.show.session == session.id else None
    if session.ended_unix_s is not None:
        own, phases = None, {}
    show = ShowPhase.IDLE if own is None else ShowPhase(own.phase)
    if found is not None and dict(found.frame) != dict(session.config["show_frame"]):
        found = _without_pads(found)  # its positions have no meaning in this frame
    vehicles = _in_the_air(known, phases, pads, found, show)
    if show in ON_THE_GROUND and show is not ShowPhase.COUNTDOWN and not vehicles:
        return None
    if show is ShowPhase.UNCONTROLLED and found is not None:
        show = found.show  # what was flown before control was lost
    if own is None or (show in ON_THE_GROUND and found is not None):
        if found is None:
            return None
        return replace(found, vehicles=vehicles)
    sql = "SELECT max(unix_s) AS unix_s FROM events WHERE session = ?"
    newest_s = rows(root, sql, session.id)[0]["unix_s"]
    return Interruption(
        session=session.id,
        unix_s=max(own.unix_s, newest_s or 0.0),
        show=show,
        reason=own.reason,
        frame=session.config["show_frame"],
        vehicles=vehicles,
        written=_written(own),
        plan=own.plan,
    )


def _unsettled(reported: Iterable[tuple[str, Mapping[str, Any]]]) -> Interruption | None:
    """Return the newest interruption that was not settled: a stall may follow a restart."""
    found = None
    for event, detail in reported:
        if event == FOUND:
            found = Interruption.from_json(detail)
        elif event == OVER:
            found = None
    return found


def _without_pads(found: Interruption) -> Interruption:
    return replace(found, vehicles={name: replace(one, pad_m=None) for name, one in found.vehicles.items()})


def _in_the_air(
    known: LastKnown,
    phases: Mapping[VehicleId, Mapping[str, Any]],
    pads: Mapping[VehicleId, Triple | None],
    found: Interruption | None,
    show: ShowPhase,
) -> dict[VehicleId, Before]:
    """Vehicles in the air, or about to take off, by the newest session, else by the one before it."""
    vehicles: dict[VehicleId, Before] = {}
    earlier = {} if found is None else found.vehicles
    for name, vehicle in known.vehicles.items():
        reported = phases.get(name, {"phase": Phase.OFFLINE, "reason": ""})
        phase, before = Phase(reported["phase"]), earlier.get(name)
        if phase in IN_THE_AIR or (phase is Phase.STANDBY and show in ABOUT_TO_FLY and name in pads):
            pad_m = pads.get(name, None if before is None else before.pad_m)
            vehicles[name] = Before(vehicle.system_id, phase, str(reported["reason"]), pad_m)
        elif before is not None and phase in {Phase.OFFLINE, Phase.PILOT}:
            vehicles[name] = before
    return vehicles


def _written(show: KnownShow) -> Written | None:
    raw: Mapping[str, Any] | None = show.plan.get("written")
    if raw is None:
        return None
    return Written(raw["name"], raw["hash"], raw["cue"], float(raw["clock_s"]), dict(raw["parts"]))
