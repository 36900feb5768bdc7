"""Executes what other stations ask of this one, and reports how it goes on."""

import logging
from collections.abc import Callable
from contextvars import copy_context
from dataclasses import dataclass
from functools import partial
from typing import Any

from gcs.flight.commands.commander import Commander
from gcs.flight.commands.start import Approval
from gcs.flight.preflight.preflight_gate import PreflightGate
from gcs.model.errors import GcsError, RefusedError
from gcs.model.lifecycle import ON_THE_GROUND, Phase
from gcs.service import CALLER, CommandRecord, ShowAction, VehicleAction
from gcs.site.holds import FORMED, SiteHolds
from gcs.site.member import SiteMember
from gcs.site.plan import SitePlanEditor
from gcs.site.player import SitePlayer
from gcs.site.requests import (
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
from gcs.site.routing import SiteRouting
from gcs.site.shows import SiteShows
from gcs.site.standby import Standby

log = logging.getLogger(__name__)

READY_EVERY_S, READY_LEAST_S = 2.0, 0.25
"""Time between two checks of readiness, and the least time when a vehicle became ready between them."""


@dataclass(eq=False)
class RequestExecutor:
    """Used once a tick, with the roles of this station alone: nothing that it executes is asked on."""

    local: Commander
    preflight: PreflightGate
    member: SiteMember
    routing: SiteRouting
    holds: SiteHolds
    standby: Standby
    plan: SitePlanEditor
    player: SitePlayer
    shows: SiteShows

    def advance(self) -> None:
        """Execute what other stations ask, report to them, and follow the lead."""
        now_s = self.local.flight.newest.state.time_s
        for sender, body in self.member.received:
            try:
                request = REQUEST.validate_python(body)
            except ValueError:
                log.warning("request_unreadable", extra={"other": sender})
                continue
            self._take(sender, request)
        self.routing.advance(now_s)
        if self.member.sender.is_check_due(READY_EVERY_S, READY_LEAST_S):
            self.member.sender.note_checked(self._why_not_ready())
            interrupted = self.local.recovery.view()
            self.member.sender.offers = () if interrupted is None else interrupted.offers
        if self.standby.look(now_s):
            self.holds.end()
            self.local.command_show(ShowAction.RESUME)
        self.holds.advance(now_s)
        self.player.advance()

    def _take(self, sender: str, request: Request) -> None:
        match request:
            case Outcomes():
                self.routing.take(sender, request)
            case PlanRequest():
                self._execute_as(request.by, partial(self.plan.change_for, sender, request))
            case ShowChange():
                self._execute_as(request.by, partial(self.player.change_for, sender, request))
            case ShowPart():
                self.shows.take_part(request)
            case ShowMissing():
                self.shows.send_to(sender, request)
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
        if isinstance(request, ShowRequest):
            execute = self._show_part(sender, request)
        else:
            execute = self._part(request)
        try:
            record = self._execute_as(request.by, execute)
        except GcsError as refused:
            self.routing.answer(sender, Outcomes(request.ref, refused=str(refused)[:500]))
            return
        self.routing.note_executed(record, sender, request.ref)

    def _show_part(self, sender: str, request: ShowRequest) -> Callable[[], CommandRecord]:
        """What executes a fleet-wide command with the own vehicles."""
        if request.action is ShowAction.RESUME and self.local.flight.show.phase in FORMED:
            formed = [vehicle.id for vehicle in self.local.flight.vehicles.in_phase(Phase.FORMATION)]
            return partial(self.local.flight.book.done, request.action, formed, {}, "flies already")
        if request.reason:
            return partial(self.local.execute_own_failsafe, request.action, request.reason)
        self.holds.end()
        if request.action is ShowAction.START:
            self.shows.named = None if request.named is None else frozenset(request.named)
            return partial(self._start, sender, request)
        return partial(
            self.local.command_show,
            request.action,
            request.vehicles,
            show_hash=request.show_hash,
            at_unix_time_s=request.at_unix_time_s,
        )

    def _start(self, sender: str, request: ShowRequest) -> CommandRecord:
        """Raises: RefusedError from a station with other rules, and without the two tokens it needs."""
        if why := self.member.why_other_request(sender, request):
            raise RefusedError(why)
        starting, approval = self.local.starting, Approval(request.proposed_by, request.confirmed_by)
        if starting.go.two is not None and not approval.holds:
            raise RefusedError("a start needs two tokens: propose and confirm it at the station that leads")
        return starting.begin(request.vehicles, request.show_hash, request.at_unix_time_s, approval)

    def _part(
        self, request: VehiclesRequest | KillRequest | ExcludeRequest | StandbyRequest | SettleRequest
    ) -> Callable[[], CommandRecord]:
        """What executes a command with the own vehicles."""
        match request:
            case VehiclesRequest(action=VehicleAction.CONFIRM_DOWN | VehicleAction.FIND, vehicles=(one,)):
                return partial(self.local.command_vehicle, one, request.action)
            case VehiclesRequest():
                return partial(self.local.command_vehicles, request.action, request.vehicles)
            case KillRequest():
                return partial(self.local.kill, request.vehicles)
            case ExcludeRequest(reason=None):
                return partial(self.preflight.include, request.vehicle)
            case ExcludeRequest():
                return partial(self.preflight.exclude, request.vehicle, request.reason or "")
            case StandbyRequest():
                return partial(self.standby.go_on, request.station)
            case SettleRequest():
                return partial(self.local.recovery.settle, request.offer)

    def _why_not_ready(self) -> str:
        """Why this station's vehicles could not start now, as preflight has it."""
        flight, show_run = self.local.flight, self.local.flight.show.run
        if flight.show.phase not in ON_THE_GROUND or flight.vehicles.airborne or not self.member.owned.any():
            return ""
        if why := self.shows.why_not_here:
            return why
        names = [name for name in flight.vehicles if name not in flight.excluded]
        meant = [name for name in names if flight.vehicles[name].phase is not Phase.OFFLINE]
        try:  # how many fly a show is for the start to say, which may name them
            self.preflight.need(*((None, None) if show_run is None else (show_run.hash, meant)))
        except GcsError as refused:
            return str(refused)
        return ""
