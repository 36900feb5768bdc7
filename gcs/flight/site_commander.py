"""Executes commands for the vehicles of all stations: each commands its own, and reports to the others."""

import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextvars import copy_context
from functools import partial
from typing import Any, Final

from gcs.flight.commander import Commander
from gcs.flight.fleet import Fleet
from gcs.flight.maneuvers import Maneuvers
from gcs.flight.preflight_gate import REASON_MAX, PreflightGate
from gcs.flight.site_display import SiteDisplay
from gcs.flight.site_holds import FORMED, SiteHolds
from gcs.flight.site_member import SiteMember
from gcs.flight.site_plan import SitePlanEditor
from gcs.flight.site_requests import (
    REQUEST,
    CommandRequest,
    ExcludeRequest,
    KillRequest,
    Outcomes,
    PlanRequest,
    Refusal,
    Request,
    SettleRequest,
    ShowChange,
    ShowMissing,
    ShowPart,
    ShowRequest,
    StandbyRequest,
    VehiclesRequest,
)
from gcs.flight.site_routing import SiteRouting
from gcs.flight.site_shows import SiteShowPlayer
from gcs.flight.standby import TAKE_OVER, Standby
from gcs.model.errors import GcsError, InvalidError, RefusedError, UnknownError
from gcs.model.interrupted_flight import Interruption, Offer
from gcs.model.lifecycle import AIRBORNE, ON_THE_GROUND, Phase
from gcs.model.preflight_report import PreflightReport
from gcs.model.state import VehicleId
from gcs.service import CALLER, CommandRecord, ShowAction, StationView, VehicleAction

log = logging.getLogger(__name__)

NO_STATION: Final = "of no station"
"""Stands for the station of a vehicle that none flies."""

READY_EVERY_S, READY_LEAST_S = 2.0, 0.25
"""Time between two checks of readiness, and the least time when a vehicle became ready between them."""


class SiteCommander(Commander):
    """Commands for the whole site.

    Implements `gcs.service.Commands`, `gcs.service.Stations`, `gcs.service.Preflight` and
    `gcs.service.Recovery`.
    """

    def __init__(
        self,
        flight: Fleet,
        maneuvers: Maneuvers,
        show_player: SiteShowPlayer,
        preflight_gate: PreflightGate,
        planning: Executor,
        found: Interruption | None,
        member: SiteMember,
        display: SiteDisplay,
        standby: Standby,
        plan: SitePlanEditor,
    ) -> None:
        super().__init__(flight, maneuvers, show_player, preflight_gate, planning, found)
        self._member, self._standby, self._plan, self._display = member, standby, plan, display
        self._gate, self._shows = preflight_gate, show_player
        self._routing = SiteRouting(member, flight.book)
        self._holds = SiteHolds(
            flight,
            member,
            partial(super().execute_show_failsafe, ShowAction.PAUSE),
            partial(super().command_show, ShowAction.RESUME),
        )

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
        lead = self._member.site.lead
        if vehicles is not None and action is ShowAction.START:
            self._shows.check_named(vehicles, here if lead.leads else away.get(lead.name, ()))
        named = None if vehicles is None or self.flight.show_run is None else (*vehicles,)
        if action is ShowAction.START:
            self._shows.named = None if named is None else frozenset(named)
        own_here = None if vehicles is None else here
        local = partial(
            super().command_show, action, own_here, show_hash=show_hash, at_unix_time_s=at_unix_time_s
        )
        self._holds.end()
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
                show_hash,
                named=named,
            )
            if expected or action is not ShowAction.START:
                record = self._routing.ask(record, name, request, expected)
        return record

    def execute_show_failsafe(self, action: ShowAction, reason: str) -> CommandRecord:
        record = super().execute_show_failsafe(action, reason)
        for name in self._member.present():
            expected = self._member.ids_of(name, *AIRBORNE)
            record = self._routing.ask(
                record, name, ShowRequest(record.id, "service", action, reason=reason), expected
            )
        return record

    def end_show(self, reason: str) -> CommandRecord:
        """Bring the vehicles of all stations home: the lead's show is over."""
        return self.execute_show_failsafe(ShowAction.STOP, reason)

    def command_vehicle(self, vehicle_id: VehicleId, action: VehicleAction) -> CommandRecord:
        here, away = self._split([vehicle_id])
        if here:
            return super().command_vehicle(vehicle_id, action)
        record = self.flight.book.open(action, [], {})
        for name, ids in away.items():
            record = self._routing.ask(
                record, name, VehiclesRequest(record.id, CALLER.get(), action, (*ids,)), ids
            )
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
            record = self._routing.ask(
                record, name, VehiclesRequest(record.id, CALLER.get(), action, expected), ids
            )
        return record

    def kill(self, vehicle_ids: Sequence[VehicleId]) -> CommandRecord:
        here, away = self._split(vehicle_ids)
        record = super().kill(here) if here or not away else self.flight.book.open("kill", [], {})
        for name, ids in away.items():
            record = self._routing.ask(record, name, KillRequest(record.id, CALLER.get(), (*ids,)), ids)
        return record

    def take_lead(self) -> tuple[StationView, ...]:
        """Lead the site from now on. Returns: all stations."""
        lead = self._member.site.lead
        if not lead.leads:
            before = lead.name
            term = lead.take()
            log.warning("lead_taken", extra={"term": term, "of": before, "by": CALLER.get()})
        return self._display.stations()

    def take_over(self, station: str) -> CommandRecord:
        """Fly on with the vehicles of a lost station, at its standby. Raises: RefusedError, UnknownError."""
        member = self._member
        if station in member.roles.stands_by_for:
            return self._standby.go_on(station)
        if station not in member.site.names:
            raise UnknownError(f"there is no station {station}; there are {', '.join(member.site.names)}")
        standbys = member.roles.standbys_of[station]
        if not standbys:
            raise RefusedError(f"no station stands by for {station}")
        record = self.flight.book.open(TAKE_OVER, [], {})
        for name in standbys:
            flown = [
                one for one in member.ids_of(name, Phase.HOLD) if one in member.roles.configured[station]
            ]
            request = StandbyRequest(record.id, CALLER.get(), station)
            record = self._routing.ask(record, name, request, flown or member.roles.configured[station])
        return record

    # preflight

    def report(self, vehicles: Sequence[VehicleId] | None = None) -> PreflightReport:
        """As `PreflightGate.report`, of the own vehicles."""
        return self._gate.report(vehicles)

    def exclude(self, vehicle_id: VehicleId, reason: str) -> CommandRecord:
        """Take a vehicle out of the show, at the station that flies it."""
        if len(reason) > REASON_MAX:
            raise InvalidError("reason", reason[:20], f"at most {REASON_MAX} characters")
        here, away = self._split([vehicle_id])
        if here:
            return self._gate.exclude(vehicle_id, reason)
        return self._ask_exclusion("exclude", away, reason)

    def include(self, vehicle_id: VehicleId) -> CommandRecord:
        """Include an excluded vehicle again, at the station that flies it."""
        here, away = self._split([vehicle_id])
        return self._gate.include(vehicle_id) if here else self._ask_exclusion("include", away, None)

    def _ask_exclusion(
        self, action: str, away: Mapping[str, Sequence[VehicleId]], reason: str | None
    ) -> CommandRecord:
        record = self.flight.book.open(action, [], {})
        for name, ids in away.items():
            request = ExcludeRequest(record.id, CALLER.get(), ids[0], reason)
            record = self._routing.ask(record, name, request, ids)
        return record

    # recovery

    def settle(self, offer: Offer) -> CommandRecord:
        """Settle the interrupted flights of all stations that offer this, as one command."""
        offering = self._member.offering(offer)
        view = self.recovery.view()
        local = partial(self.recovery.settle, offer)
        if not offering or (view is not None and offer in view.offers):
            record = self._local(offer.value, local, others=bool(offering))
        else:
            record = self.flight.book.open(offer.value, [], {})
        for name in offering:
            request = SettleRequest(record.id, CALLER.get(), offer)
            record = self._routing.ask(record, name, request, self._member.ids_of(name, Phase.PILOT))
        return record

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

    # once a tick

    def release(self) -> None:
        """Stop what flies vehicles that another station owns now: before the setpoints of this tick."""
        self._standby.release()

    def advance_site(self) -> None:
        """Execute what other stations ask, report to them, and follow the lead."""
        now_s = self.flight.fleet.time_s
        for sender, body in self._member.received:
            try:
                request = REQUEST.validate_python(body)
            except ValueError:
                log.warning("request_unreadable", extra={"other": sender})
                continue
            self._take(sender, request)
        self._routing.advance(now_s)
        if self._member.sender.is_check_due(READY_EVERY_S, READY_LEAST_S):
            self._member.sender.note_checked(self._why_not_ready())
            interrupted = self.recovery.view()
            self._member.sender.offers = () if interrupted is None else interrupted.offers
        if self._standby.look(now_s):
            self._holds.end()
            super().command_show(ShowAction.RESUME)
        self._holds.advance(now_s)

    def _take(self, sender: str, request: Request) -> None:
        match request:
            case Outcomes():
                self._routing.take(sender, request)
            case PlanRequest():
                self._execute_as(request.by, partial(self._plan.change_for, sender, request))
            case ShowChange():
                self._execute_as(request.by, partial(self._shows.change_for, sender, request))
            case ShowPart():
                self._shows.take_part(request)
            case ShowMissing():
                self._shows.send_to(sender, request)
            case Refusal():
                about = {"other": sender, "change": request.change, "by": request.by}
                log.warning("refused_by_lead", extra={**about, "reason": request.reason})
            case _:
                self._execute(sender, request)

    def _execute_as(self, by: str, execute: Callable[[], Any]) -> Any:
        context = copy_context()
        context.run(CALLER.set, by)
        return context.run(execute)

    def _execute(self, sender: str, request: CommandRequest) -> None:
        execute = self._show_part(request) if isinstance(request, ShowRequest) else self._part(request)
        try:
            record = self._execute_as(request.by, execute)
        except GcsError as refused:
            self._routing.answer(sender, Outcomes(request.ref, refused=str(refused)[:500]))
            return
        self._routing.note_executed(record, sender, request.ref)

    def _show_part(self, request: ShowRequest) -> Callable[[], CommandRecord]:
        """What executes a fleet-wide command with the own vehicles."""
        if request.action is ShowAction.RESUME and self.flight.show in FORMED:
            formed = [one.id for one in self.flight.in_phase(Phase.FORMATION)]
            return partial(self.flight.book.done, request.action, formed, {}, "flies already")
        if request.reason:
            return partial(super().execute_show_failsafe, request.action, request.reason)
        self._holds.end()
        if request.action is ShowAction.START:
            self._shows.named = None if request.named is None else frozenset(request.named)
        return partial(
            super().command_show,
            request.action,
            request.vehicles,
            show_hash=request.show_hash,
            at_unix_time_s=request.at_unix_time_s,
        )

    def _part(
        self, request: VehiclesRequest | KillRequest | ExcludeRequest | StandbyRequest | SettleRequest
    ) -> Callable[[], CommandRecord]:
        """What executes a command with the own vehicles."""
        match request:
            case VehiclesRequest(action=VehicleAction.CONFIRM_DOWN | VehicleAction.FIND, vehicles=(one,)):
                return partial(super().command_vehicle, one, request.action)
            case VehiclesRequest():
                return partial(super().command_vehicles, request.action, request.vehicles)
            case KillRequest():
                return partial(super().kill, request.vehicles)
            case ExcludeRequest(reason=None):
                return partial(self._gate.include, request.vehicle)
            case ExcludeRequest():
                return partial(self._gate.exclude, request.vehicle, request.reason or "")
            case StandbyRequest():
                return partial(self._standby.go_on, request.station)
            case SettleRequest():
                return partial(self.recovery.settle, request.offer)

    def _why_not_ready(self) -> str:
        """Why this station's vehicles could not start now, as preflight has it."""
        if self.flight.show not in ON_THE_GROUND or self.flight.airborne or not self._member.owned.any():
            return ""
        if why := self._shows.why_not_here:
            return why
        flight, show_run = self.flight, self.flight.show_run
        names = [name for name in flight.vehicles if name not in flight.excluded]
        meant = [name for name in names if flight.vehicles[name].phase is not Phase.OFFLINE]
        try:  # how many fly a show is for the start to say, which may name them
            self._gate.need(*((None, None) if show_run is None else (show_run.hash, meant)))
        except GcsError as refused:
            return str(refused)
        return ""
