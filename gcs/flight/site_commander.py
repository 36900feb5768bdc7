"""Executes commands for the vehicles of all stations: each commands its own, and reports to the others."""

import logging
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextvars import copy_context
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from typing import Any, Final

from gcs.flight.commander import Commander
from gcs.flight.fleet import Fleet
from gcs.flight.maneuvers import Maneuvers
from gcs.flight.preflight_gate import PreflightGate
from gcs.flight.show_player import ShowPlayer
from gcs.flight.site_member import SiteMember
from gcs.flight.site_plan import SitePlanEditor
from gcs.flight.site_requests import (
    REQUEST,
    KillRequest,
    Outcomes,
    PlanRequest,
    Refusal,
    Request,
    SettleRequest,
    ShowRequest,
    VehiclesRequest,
)
from gcs.flight.standby import Standby
from gcs.model.errors import GcsError, LinkError, RefusedError, UnknownError
from gcs.model.interrupted_flight import Interruption
from gcs.model.lifecycle import AIRBORNE, ON_THE_GROUND, Phase, ShowEvent, ShowPhase
from gcs.model.state import VehicleId
from gcs.service import CALLER, CommandRecord, Outcome, ShowAction, StationView, VehicleAction, VehicleOutcome

log = logging.getLogger(__name__)

ANSWERED_WITHIN_S: Final = 6.0
"""A station that has not answered a request by then is taken for one that has not received it."""

NO_STATION: Final = "of no station"
"""Stands for the station of a vehicle that none flies."""

BRIEF: Final = 12
"""Characters of each reason, where all reasons do not fit into one message."""

REPORTED_EVERY_S: Final = 0.1

FORMED: Final = frozenset({ShowPhase.ASSEMBLING, ShowPhase.RUNNING})

GONE_HOLD_S: Final = 6.0
"""When a station with vehicles in the air is lost, all hold for this time; then they close the gap."""

HOLDS_LEAST_S: Final = 1.0
"""Time in which the lead notices as well what a follower holds for."""

SETTLED_S: Final = 0.5
"""A phase of the lead counts once it has lasted so long: an operator's command may be under way to it."""

READY_EVERY_S, READY_LEAST_S = 2.0, 0.25
"""Time between two checks of readiness, and the least time when a vehicle became ready between them."""


@dataclass(slots=True)
class _Requested:
    """A command of this station that other stations execute as well."""

    record_id: str
    asked_s: float
    open: set[str] = field(default_factory=set)  # stations that have not finished it
    answered: set[str] = field(default_factory=set)  # of these, stations that have begun it


@dataclass(slots=True)
class _Executed:
    """A command that another station asked for."""

    record: CommandRecord
    station: str
    ref: str
    reported: dict[VehicleId, VehicleOutcome] = field(default_factory=dict)


class SiteCommander(Commander):
    """Commands for the whole site. Implements `gcs.service.Commands` and `gcs.service.Stations`."""

    def __init__(
        self,
        flight: Fleet,
        maneuvers: Maneuvers,
        show_player: ShowPlayer,
        preflight_gate: PreflightGate,
        planning: Executor,
        found: Interruption | None,
        member: SiteMember,
        standby: Standby,
        plan: SitePlanEditor,
    ) -> None:
        super().__init__(flight, maneuvers, show_player, preflight_gate, planning, found)
        self._member, self._standby, self._plan = member, standby, plan
        self._gate = preflight_gate
        self._asked: dict[str, _Requested] = {}  # by record id
        self._executed: list[_Executed] = []
        self._report_due_s = 0.0
        self._waits_for = ""  # the station for which this one holds, by itself
        self._waits_until_s = self._waits_since_s = 0.0
        self._gone: frozenset[str] = frozenset()
        self._lead_show: tuple[ShowPhase, float] = (ShowPhase.IDLE, 0.0)

    # commands

    def command_show(
        self,
        action: ShowAction,
        vehicles: Sequence[VehicleId] | None = None,
        *,
        show_hash: str | None = None,
        at_unix_time_s: float | None = None,
    ) -> CommandRecord:
        here, away = self._split(vehicles)
        if action is ShowAction.START and (why := self._member.why_not_start()):
            raise RefusedError(f"a start needs every station: {why}")
        own_here = None if vehicles is None else here
        local = partial(
            super().command_show, action, own_here, show_hash=show_hash, at_unix_time_s=at_unix_time_s
        )
        self._waits_for = ""
        may_skip = action is not ShowAction.START or vehicles is not None
        record = self._local(action.value, local, others=self._others_fly(action) and may_skip)
        reached = (*AIRBORNE,) if action is not ShowAction.START else (Phase.STANDBY,)
        for name in self._member.site.stations:
            expected = self._member.ids_of(name, *reached)
            if vehicles is not None:
                expected = [one for one in away.get(name, ()) if one in expected]
            request = ShowRequest(
                record.id,
                CALLER.get(),
                action,
                None if vehicles is None else tuple(away.get(name, ())),
                at_unix_time_s,
            )
            if expected or action is not ShowAction.START:
                record = self._ask(record, name, request, expected)
        return record

    def execute_show_failsafe(self, action: ShowAction, reason: str) -> CommandRecord:
        record = super().execute_show_failsafe(action, reason)
        for name in self._member.present():
            expected = self._member.ids_of(name, *AIRBORNE)
            record = self._ask(
                record, name, ShowRequest(record.id, "service", action, reason=reason), expected
            )
        return record

    def command_vehicle(self, vehicle_id: VehicleId, action: VehicleAction) -> CommandRecord:
        here, away = self._split([vehicle_id])
        if here:
            return super().command_vehicle(vehicle_id, action)
        record = self.flight.book.open(action, [], {})
        for name, ids in away.items():
            record = self._ask(record, name, VehiclesRequest(record.id, CALLER.get(), action, (*ids,)), ids)
        return record

    def command_vehicles(
        self, action: VehicleAction, vehicles: Sequence[VehicleId] | None = None
    ) -> CommandRecord:
        here, away = self._split(vehicles)
        if vehicles is None:
            away = {name: self._member.ids_of(name, *AIRBORNE) for name in self._member.present()}
            away = {name: ids for name, ids in away.items() if ids}
        local = partial(super().command_vehicles, action, None if vehicles is None else here)
        if vehicles is not None and not here:
            record = self.flight.book.open(action, [], {})
        else:
            record = self._local(action.value, local, others=bool(away))
        for name, ids in away.items():
            expected = None if vehicles is None else (*ids,)
            record = self._ask(record, name, VehiclesRequest(record.id, CALLER.get(), action, expected), ids)
        return record

    def kill(self, vehicle_ids: Sequence[VehicleId]) -> CommandRecord:
        here, away = self._split(vehicle_ids)
        record = super().kill(here) if here or not away else self.flight.book.open("kill", [], {})
        for name, ids in away.items():
            record = self._ask(record, name, KillRequest(record.id, CALLER.get(), (*ids,)), ids)
        return record

    def take_lead(self) -> tuple[StationView, ...]:
        """Lead the site from now on. Returns: all stations."""
        lead = self._member.site.lead
        if not lead.leads:
            before = lead.name
            term = lead.take()
            log.warning("lead_taken", extra={"term": term, "of": before, "by": CALLER.get()})
        return self._member.views()

    def take_over(self, station: str) -> CommandRecord:
        """Fly on with the vehicles of a lost station that this one stands by for. Raises: RefusedError."""
        return self._standby.go_on(station)

    def _split(
        self, vehicles: Sequence[VehicleId] | None
    ) -> tuple[list[VehicleId], dict[str, list[VehicleId]]]:
        """The own of these, and the others by station. Raises: UnknownError."""
        here: list[VehicleId] = []
        away: dict[str, list[VehicleId]] = {}
        site = self._member.site
        owner = dict(zip(site.ids, site.owners, strict=True))
        for name in dict.fromkeys(vehicles or ()):
            own = self.flight.vehicles.get(name)
            if own is not None and self._member.owned[own.row]:
                here.append(name)
            elif name in owner or name in self.flight.vehicles:
                away.setdefault(owner.get(name) or NO_STATION, []).append(name)
            else:
                known = ", ".join((*self.flight.vehicles, *site.ids))
                raise UnknownError(f"there is no vehicle {name}; there are {known}")
        return here, away

    def _others_fly(self, action: ShowAction) -> bool:
        """Whether another station may accept a command that this one refuses."""
        member = self._member
        if action is ShowAction.START:
            return bool(member.present())
        return any(member.show_of(name) not in ON_THE_GROUND for name in member.present())

    def _local(self, action: str, execute: Callable[[], CommandRecord], *, others: bool) -> CommandRecord:
        """Execute the own part. Raises: RefusedError when it is refused, and no other station has a part."""
        try:
            return execute()
        except RefusedError as refused:
            if not others:
                raise
            log.info("own_part_refused", extra={"command": action, "reason": str(refused)})
            return self.flight.book.open(action, [], {})

    def _ask(
        self, record: CommandRecord, station: str, request: Request, ids: Sequence[VehicleId]
    ) -> CommandRecord:
        """Have a station execute its part; its vehicles are pending until it answers."""
        book = self.flight.book
        missing = f"station {station} is not received"
        if station in self._member.present():
            try:
                self._member.post(station, REQUEST.dump_python(request, mode="json"))
                missing = ""
            except LinkError as error:  # the own part and the other stations' are executed all the same
                missing = f"station {station}: {error}"
        if missing:
            return book.include(record.id, {one: VehicleOutcome(Outcome.FAILED, missing) for one in ids})
        asked = self._asked.setdefault(record.id, _Requested(record.id, self.flight.fleet.time_s))
        asked.open.add(station)
        return book.include(record.id, {one: VehicleOutcome(Outcome.PENDING) for one in ids})

    # once a tick

    def advance_site(self) -> None:
        """Execute what other stations ask, report to them, and follow the lead."""
        now_s = self.flight.fleet.time_s
        for sender, body in self._member.received:
            try:
                request = REQUEST.validate_python(body)
            except ValueError:
                log.warning("request_unreadable", extra={"other": sender})
                continue
            if isinstance(request, Outcomes):
                self._take_outcomes(sender, request)
            elif isinstance(request, PlanRequest):
                self._execute_as(request.by, partial(self._plan.change_for, sender, request))
            elif isinstance(request, Refusal):
                about = {"other": sender, "change": request.change, "by": request.by}
                log.warning("refused_by_lead", extra={**about, "reason": request.reason})
            else:
                self._execute(sender, request)
        if now_s >= self._report_due_s:
            self._report_due_s = now_s + REPORTED_EVERY_S
            self._report()
            self._expire(now_s)
        if self._member.is_check_due(READY_EVERY_S, READY_LEAST_S):
            self._member.note_checked(self._why_not_ready())
        if self._standby.look(now_s):
            self._waits_for = ""
            super().command_show(ShowAction.RESUME)
        self._follow(now_s)

    def _execute_as(self, by: str, execute: Callable[[], Any]) -> Any:
        context = copy_context()
        context.run(CALLER.set, by)
        return context.run(execute)

    def _execute(self, sender: str, request: Request) -> None:
        match request:
            case ShowRequest(action=ShowAction.RESUME) if self.flight.show in FORMED:
                formed = [one.id for one in self.flight.in_phase(Phase.FORMATION)]
                execute = partial(self.flight.book.done, request.action, formed, {}, "flies already")
            case ShowRequest(reason=""):
                self._waits_for = ""
                execute = partial(
                    super().command_show,
                    request.action,
                    request.vehicles,
                    at_unix_time_s=request.at_unix_time_s,
                )
            case ShowRequest():
                execute = partial(super().execute_show_failsafe, request.action, request.reason)
            case VehiclesRequest(action=VehicleAction.CONFIRM_DOWN, vehicles=(one,)):
                execute = partial(super().command_vehicle, one, request.action)
            case VehiclesRequest():
                execute = partial(super().command_vehicles, request.action, request.vehicles)
            case KillRequest():
                execute = partial(super().kill, request.vehicles)
            case SettleRequest():
                execute = partial(self.recovery.settle, request.offer)
            case _:
                return
        try:
            record = self._execute_as(request.by, execute)
        except GcsError as refused:
            self._answer(sender, Outcomes(request.ref, refused=str(refused)[:500]))
            return
        self._executed.append(_Executed(record, sender, request.ref))

    def _answer(self, station: str, outcomes: Outcomes) -> None:
        try:
            self._member.post(station, REQUEST.dump_python(outcomes, mode="json"))
        except LinkError:  # too long, with all reasons
            brief = {name: (outcome, why[:BRIEF]) for name, (outcome, why) in outcomes.outcomes.items()}
            try:
                self._member.post(
                    station, REQUEST.dump_python(replace(outcomes, outcomes=brief), mode="json")
                )
            except LinkError as error:
                log.warning("not_answered", extra={"other": station, "reason": str(error)})

    def _report(self) -> None:
        """Send the outcomes that have changed."""
        going_on = []
        for one in self._executed:
            try:
                record = self.flight.book.get(one.record.id)
            except UnknownError:
                continue
            if record.outcomes != one.reported or not record.outcomes:
                one.reported = dict(record.outcomes)
                found = {name: (each.outcome, each.reason[:200]) for name, each in record.outcomes.items()}
                self._answer(one.station, Outcomes(one.ref, found))
            if record.outcome is Outcome.PENDING:
                going_on.append(one)
        self._executed = going_on

    def _take_outcomes(self, sender: str, reported: Outcomes) -> None:
        asked = self._asked.get(reported.ref)
        if asked is None or sender not in asked.open:
            return
        asked.answered.add(sender)
        book, ids = self.flight.book, set(self._member.site.ids)
        found = {
            name: VehicleOutcome(outcome, reason)
            for name, (outcome, reason) in reported.outcomes.items()
            if name in ids
        }
        over = bool(reported.refused) or all(one.outcome is not Outcome.PENDING for one in found.values())
        if over:
            asked.open.discard(sender)
            why = reported.refused or "it did not apply to it"
            outcome = Outcome.FAILED if reported.refused else Outcome.NOT_INCLUDED
            left = VehicleOutcome(outcome, f"station {sender}: {why}")
            pending = book.get(reported.ref).outcomes
            of_sender = set(self._member.ids_of(sender))
            for name, one in pending.items():
                if name in of_sender and name not in found and one.outcome is Outcome.PENDING:
                    found[name] = left
        book.include(reported.ref, found)
        if not asked.open:
            del self._asked[reported.ref]

    def _expire(self, now_s: float) -> None:
        """Close the parts of stations that do not answer, or are not received any more."""
        here = set(self._member.present())
        for asked in list(self._asked.values()):
            late = now_s - asked.asked_s > ANSWERED_WITHIN_S
            silent = asked.open - asked.answered
            for name in [one for one in asked.open if late and (one not in here or one in silent)]:
                asked.open.discard(name)
                try:
                    outcomes = self.flight.book.get(asked.record_id).outcomes
                except UnknownError:
                    continue
                why = "does not answer" if name in here else "is not received"
                lost = VehicleOutcome(Outcome.FAILED, f"station {name} {why}")
                of_station = set(self._member.ids_of(name))
                pending = [one for one in of_station if one in outcomes]
                open_ids = [one for one in pending if outcomes[one].outcome is Outcome.PENDING]
                self.flight.book.include(asked.record_id, dict.fromkeys(open_ids, lost))
            if not asked.open:
                self._asked.pop(asked.record_id, None)

    def _why_not_ready(self) -> str:
        """Why this station's vehicles could not start now, as preflight has it."""
        if self.flight.show not in ON_THE_GROUND or self.flight.airborne or not self._member.owned.any():
            return ""
        try:
            self._gate.need(None, None)
        except GcsError as refused:
            return str(refused)
        return ""

    # the show

    def _follow(self, now_s: float) -> None:
        """Keep this station's show with the lead's, and hold while a station is missing."""
        flight, member = self.flight, self._member
        lead = member.site.lead
        gone = frozenset(name for name in member.site.lost(now_s) if member.ids_of(name, *AIRBORNE))
        newly_gone, self._gone = gone - self._gone, gone
        if flight.show in FORMED and newly_gone:
            name = min(newly_gone)
            self._wait_for(name, now_s + GONE_HOLD_S, f"station {name} is not received: all hold")
        elif flight.show in FORMED and not lead.leads and self._lead_silent(now_s):
            self._wait_for(lead.name, inf, f"the leading station {lead.name} is silent: all hold")
        elif not lead.leads and lead.name in member.present():
            self._keep_with_lead(now_s)
        if self._waits_for and flight.show is ShowPhase.PAUSED and self._may_go_on(now_s):
            self._waits_for = ""
            super().command_show(ShowAction.RESUME)

    def _lead_silent(self, now_s: float) -> bool:
        station = self._member.site.stations[self._member.site.lead.name]
        return now_s - station.arrived_s > self._member.lead_silent_s

    def _wait_for(self, station: str, until_s: float, reason: str) -> None:
        log.warning("holds_for_station", extra={"other": station, "reason": reason})
        super().execute_show_failsafe(ShowAction.PAUSE, reason)
        self._waits_for, self._waits_until_s = station, until_s
        self._waits_since_s = self.flight.fleet.time_s

    def _may_go_on(self, now_s: float) -> bool:
        """Whether what this station waited for is over."""
        lead, member = self._member.site.lead, self._member
        if not self.flight.in_phase(Phase.FORMATION) or now_s - self._waits_since_s < HOLDS_LEAST_S:
            return False
        if not lead.leads:
            return lead.name in member.present() and member.show_of(lead.name) in FORMED
        return not self._gone or now_s >= self._waits_until_s

    def _keep_with_lead(self, now_s: float) -> None:
        flight, lead = self.flight, self._member.site.lead
        show = self._member.show_of(lead.name)
        if show is not self._lead_show[0]:
            self._lead_show = show, now_s
        if now_s - self._lead_show[1] < SETTLED_S:
            return
        if show is ShowPhase.PAUSED and flight.show in FORMED and not self._waits_for:
            self._wait_for(lead.name, inf, f"the leading station {lead.name} holds")
        elif show is ShowPhase.RUNNING and flight.show is ShowPhase.ASSEMBLING:
            flight.move_show(ShowEvent.ASSEMBLED, "formation reached")
