"""Writes the audit: sessions, calls, commands, events, and the last known state of every vehicle."""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final, Self

from gcs.links.link import Address
from gcs.model.interrupted_flight import Interruption
from gcs.model.lifecycle import AIRBORNE, Phase, ShowPhase
from gcs.model.plan import plan_json
from gcs.model.state import Array, Mode, VehicleId
from gcs.recording.audit_database import AuditRow, Journal, Value
from gcs.recording.audit_reader import FOUND, PAD, LastKnown, audit_file
from gcs.recording.sample import Reported, Sample
from gcs.service import Call, CommandRecord, Outcome, VehicleOutcome
from gcs.service.vehicle_table import VehicleTable

BODY_MAX: Final = 4096

KILLED_OFFLINE: Final = "motors stopped by gcs kill, without the service"

CLOCK_S: Final = 1.0
"""Interval at which the time of a written show is recorded, and the motion of a target that is followed."""

_VEHICLE: Final = """
INSERT INTO vehicles (id, session, unix_s, system_id, link, host, port, phase, reason, mode, armed,
  home_x_m, home_y_m, home_z_m) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)
ON CONFLICT (id) DO UPDATE SET
  session = excluded.session, unix_s = excluded.unix_s,
  system_id = excluded.system_id, link = excluded.link,
  host = coalesce(excluded.host, host), port = coalesce(excluded.port, port),
  phase = coalesce(excluded.phase, phase), reason = coalesce(excluded.reason, reason),
  mode = coalesce(excluded.mode, mode), armed = coalesce(excluded.armed, armed),
  home_x_m = coalesce(excluded.home_x_m, home_x_m),
  home_y_m = coalesce(excluded.home_y_m, home_y_m),
  home_z_m = coalesce(excluded.home_z_m, home_z_m)
"""
_SHOW: Final = "INSERT OR REPLACE INTO show VALUES (1, ?, ?, ?, ?, ?)"
_EVENT: Final = "INSERT INTO events VALUES (?, ?, ?, ?, ?, ?)"
_OUTCOME: Final = "INSERT INTO outcomes VALUES (?, ?, ?, ?, ?, ?)"


class AuditTrail:
    """Rows of one session. Implements `gcs.service.Audit`, which documents it."""

    def __init__(self, journal: Journal, session: str, vehicles: Mapping[VehicleId, tuple[int, str]]) -> None:
        """Writes nothing before `begin`. `vehicles`: system id and link of each."""
        self._journal, self.kept = journal, journal.kept
        self._session = session
        self._vehicles = dict(vehicles)
        count = len(vehicles)
        # the state of a vehicle before its first message is not recorded: the previous session knew more
        self._phases: Sequence[Phase] = (Phase.OFFLINE,) * count
        self._modes: Sequence[Mode] = (Mode.UNKNOWN,) * count
        self._armed: Sequence[bool] = (False,) * count
        self._homes: Sequence[Array | None] = (None,) * count
        self._addresses: dict[VehicleId, Address] = {}
        self._show: ShowPhase = ShowPhase.IDLE
        self._reported: Reported | None = None
        self._cue: dict[str, str] | None = None
        self._clock_due_s = 0.0

    def begin(self, folder: Path, config_json: str, interruption: Interruption | None = None) -> None:
        """Record the start of the session and the interruption it found, in one transaction."""
        now_s = time.time()
        sql = "INSERT INTO sessions (id, began_unix_s, folder, config) VALUES (?, ?, ?, ?)"
        rows = [AuditRow(sql, (self._session, now_s, str(folder), config_json))]
        if interruption is not None:
            reported = json.dumps(asdict(interruption), separators=(",", ":"))
            rows.append(AuditRow(_EVENT, (self._session, now_s, "warning", FOUND, None, reported)))
        self._journal.put(rows)

    def end(self) -> None:
        """Record a regular end; with a vehicle under control in the air it was not regular."""
        if AIRBORNE.intersection(self._phases):
            return
        self._put("UPDATE sessions SET ended_unix_s = ? WHERE id = ?", time.time(), self._session)

    def call(self, call: Call) -> None:
        body = call.body if len(call.body) <= BODY_MAX else f"{call.body[:BODY_MAX]}…"
        values = (self._session, time.time(), call.caller, call.method, call.path, body, call.status)
        self._put("INSERT INTO calls VALUES (?, ?, ?, ?, ?, ?, ?)", *values)

    def opened(self, record: CommandRecord, caller: str) -> None:
        """Record an accepted command, and its first outcome for every vehicle."""
        at_s = record.accepted_unix_time_s
        values = (self._session, record.id, at_s, caller, record.action)
        command = AuditRow("INSERT INTO commands VALUES (?, ?, ?, ?, ?)", values)
        parts = [
            AuditRow(_OUTCOME, (self._session, record.id, name, at_s, part.outcome.value, part.reason))
            for name, part in record.outcomes.items()
        ]
        self._journal.put([command, *parts])

    def closed(self, command_id: str, vehicle_id: VehicleId, outcome: Outcome, reason: str) -> None:
        self._put(_OUTCOME, self._session, command_id, vehicle_id, time.time(), outcome.value, reason)

    def event(
        self, unix_s: float, level: str, event: str, vehicle: str | None, detail: Mapping[str, object]
    ) -> None:
        reported = json.dumps(detail, default=str, separators=(",", ":"))
        self._put(_EVENT, self._session, unix_s, level, event, vehicle, reported)

    def watch(self, sample: Sample) -> None:
        at_s, rows = sample.view.unix_time_s, sample.view.rows
        changed = set() if rows.phases == self._phases else _differing(rows.phases, self._phases)
        if rows.modes != self._modes or rows.armed != self._armed:
            for row in _differing(rows.modes, self._modes) | _differing(rows.armed, self._armed):
                detail = {"mode": rows.modes[row].value, "armed": rows.armed[row]}
                self.event(at_s, "info", "vehicle_mode", rows.ids[row], detail)
                changed.add(row)
        homes = zip(rows.homes_m, self._homes, strict=True)
        moved = {row for row, (new, old) in enumerate(homes) if new is not old}
        for row in sorted(moved):
            pad_m = rows.homes_m[row]
            if pad_m is not None:
                self.event(at_s, "info", PAD, rows.ids[row], {"pad_m": pad_m.tolist()})
        changed |= moved
        self._phases, self._modes = rows.phases, rows.modes
        self._armed, self._homes = rows.armed, rows.homes_m
        if changed:
            self._journal.put([self._vehicle(at_s, rows, row) for row in sorted(changed)])
        self._watch_show(sample)

    def _vehicle(self, unix_s: float, rows: VehicleTable, row: int) -> AuditRow:
        name, home_m = rows.ids[row], rows.homes_m[row]
        home: Sequence[Value] = (None,) * 3 if home_m is None else [float(value) for value in home_m]
        columns = (name, self._session, unix_s, *self._vehicles[name], None, None)
        state = rows.phases[row].value, rows.reasons[row], rows.modes[row].value, int(rows.armed[row])
        return AuditRow(_VEHICLE, (*columns, *state, *home))

    def _watch_show(self, sample: Sample) -> None:
        view, at_s = sample.view, sample.view.unix_time_s
        before, self._reported = self._reported, sample.reported
        is_changed = before is not None and self._reported != before
        if is_changed:
            self.event(at_s, "info", "plan", None, asdict(view.plan))
        selected = view.selected
        cue = None
        if selected is not None:
            cue = {"name": selected.name, "hash": selected.hash, "cue": selected.cue}
            if cue != self._cue:
                self.event(at_s, "info", "cue", None, cue)
        self._cue = cue
        moves = (selected is not None and selected.runs) or sample.followed != ""
        if is_changed or view.show is not self._show or (moves and at_s >= self._clock_due_s):
            self._clock_due_s = at_s + CLOCK_S
            more: dict[str, object] = {"time_s": view.time_s, "followed": sample.followed}
            if selected is not None and cue is not None:
                more["written"] = {**cue, "clock_s": selected.clock_s, "parts": dict(sample.parts)}
            values = (view.show.value, view.reason, plan_json(view.plan, **more))
            self._put(_SHOW, self._session, at_s, *values)
        self._show = view.show

    def whereabouts(self, addresses: Mapping[VehicleId, Address]) -> None:
        changed = [(name, at) for name, at in addresses.items() if self._addresses.get(name) != at]
        nothing = (None,) * 7
        for name, at in changed:
            row = (*self._vehicles[name], at.host, at.port)
            self._put(_VEHICLE, name, self._session, time.time(), *row, *nothing)
        self._addresses.update(changed)

    def _put(self, sql: str, *values: Value) -> None:
        self._journal.put([AuditRow(sql, values)])


def _differing(new: Sequence[object], old: Sequence[object]) -> set[int]:
    return {row for row, (one, other) in enumerate(zip(new, old, strict=True)) if one != other}


class OfflineAudit:
    """Rows for the newest session. A disk error is reported by `problem`, and stops nothing."""

    def __init__(self, root: Path, last: LastKnown, caller: str) -> None:
        vehicles = {vehicle.id: (vehicle.system_id, vehicle.link) for vehicle in last.vehicles.values()}
        self._known = last
        self._caller = caller
        self._journal = Journal(audit_file(root))
        self._audit = AuditTrail(self._journal, "" if last.session is None else last.session.id, vehicles)
        self.problem = ""

    def __enter__(self) -> Self:
        self._journal.open()
        return self

    def __exit__(self, *_error: object) -> None:
        self._journal.close()
        self.problem = self._journal.problem

    def opened(self, action: str, vehicles: Sequence[VehicleId], unix_s: float) -> str:
        """Record a command given then. Returns: its id, distinct from those of every service."""
        parts = {name: VehicleOutcome(Outcome.PENDING) for name in vehicles}
        command = CommandRecord(f"outside-{unix_s:.3f}", action, unix_s, parts, self._caller)
        self._audit.opened(command, self._caller)
        return command.id

    def closed(self, command_id: str, vehicle_id: VehicleId, part: VehicleOutcome) -> None:
        """Record an outcome; done means that its motors are off, also for the next start of the service."""
        self._audit.closed(command_id, vehicle_id, part.outcome, part.reason)
        if part.outcome is not Outcome.DONE:
            return
        before = self._known.vehicles.get(vehicle_id)
        was = None if before is None else before.phase
        detail = {"was": was, "phase": Phase.KILLED.value, "reason": KILLED_OFFLINE}
        self._audit.event(time.time(), "warning", "vehicle_phase", vehicle_id, detail)
        sql = "UPDATE vehicles SET unix_s = ?, phase = ?, reason = ?, armed = 0 WHERE id = ?"
        self._journal.put([AuditRow(sql, (time.time(), Phase.KILLED.value, KILLED_OFFLINE, vehicle_id))])
