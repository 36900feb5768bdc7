"""Commands for the vehicles of all stations: each station commands its own, and reports to the others."""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

from gcs.flight.commands.commander import Commander
from gcs.flight.commands.recovery import FlightRecovery
from gcs.flight.preflight.go import CrewGo
from gcs.flight.preflight.preflight_gate import REASON_MAX, STATIONS, TO_DO, PreflightGate
from gcs.model.errors import InvalidError, RefusedError, UnknownError
from gcs.model.interrupted_flight import Offer
from gcs.model.lifecycle import AIRBORNE, ON_THE_GROUND, Phase
from gcs.model.preflight_report import Check, PreflightCause, PreflightReport, State
from gcs.model.state import VehicleId
from gcs.service import CALLER, CommandRecord, ShowAction, StationView, VehicleAction
from gcs.service.commands import CommandLog
from gcs.service.go import GoView, WeatherEntry
from gcs.site.display import SiteDisplay
from gcs.site.holds import SiteHolds
from gcs.site.member import SiteMember
from gcs.site.requests import (
    ExcludeRequest,
    KillRequest,
    SettleRequest,
    ShowRequest,
    StandbyRequest,
    VehiclesRequest,
)
from gcs.site.routing import SiteRouting
from gcs.site.shows import SiteShows
from gcs.site.standby import TAKE_OVER, Standby

log = logging.getLogger(__name__)

NO_STATION: Final = "of no station"
"""Stands for the station of a vehicle that none flies."""


@dataclass(eq=False)
class SiteCommands:
    """Commands to the show and to vehicles of all stations. Implements `gcs.service.Commands`."""

    local: Commander
    member: SiteMember
    shows: SiteShows
    routing: SiteRouting
    holds: SiteHolds
    _proposed: tuple[ShowRequest, Sequence[VehicleId] | None] | None = None  # the start that waits

    @property
    def _book(self) -> CommandLog:
        return self.local.flight.book

    def command_show(
        self,
        action: ShowAction,
        vehicles: Sequence[VehicleId] | None = None,
        *,
        show_hash: str | None = None,
        at_unix_time_s: float | None = None,
    ) -> CommandRecord:
        if action is ShowAction.START:
            return self._start(vehicles, show_hash, at_unix_time_s)
        here, _ = split(self.member, vehicles)
        own_here = None if vehicles is None else here
        local = partial(
            self.local.command_show, action, own_here, show_hash=show_hash, at_unix_time_s=at_unix_time_s
        )
        self.holds.end()
        record = execute_own(self.member, action.value, local, others=self._others_fly(action))
        request = ShowRequest(record.id, CALLER.get(), action, None, at_unix_time_s, show_hash)
        return self._ask(record, request, vehicles)

    def _start(
        self, vehicles: Sequence[VehicleId] | None, show_hash: str | None, at_unix_time_s: float | None
    ) -> CommandRecord:
        """Start at every station; where a start needs two tokens, propose it at this one, which leads."""
        by_two = self.local.starting.go.two is not None
        if by_two:
            need_lead(self.member, "propose a start")
            if at_unix_time_s is not None:
                raise RefusedError(
                    "with several stations a start that needs two tokens is made at once: give the show"
                    " a time to begin instead"
                )
        here = self._prepared(vehicles)
        own_here = None if vehicles is None else here
        action = ShowAction.START
        local = partial(
            self.local.command_show, action, own_here, show_hash=show_hash, at_unix_time_s=at_unix_time_s
        )
        others = bool(self.member.present()) and vehicles is not None and not by_two
        record = execute_own(self.member, action.value, local, others=others)
        named = self._named(vehicles)
        request = ShowRequest(record.id, CALLER.get(), action, None, at_unix_time_s, show_hash, named=named)
        if by_two:
            self._proposed = request, vehicles
            return record
        return self._ask(record, request, vehicles)

    def confirm_start(self, go_hash: str) -> CommandRecord:
        """Make the start that another token proposed here, at every station."""
        need_lead(self.member, "confirm a start")
        waiting = self.local.starting.waiting
        if self._proposed is None or waiting is None or self._proposed[0].ref != waiting.record.id:
            return self.local.confirm_start(go_hash)  # which says why that is refused
        request, vehicles = self._proposed
        self._prepared(vehicles)
        record = self.local.confirm_start(go_hash)
        self._proposed = None
        approved = replace(request, proposed_by=record.by, confirmed_by=CALLER.get())
        return self._ask(record, approved, vehicles)

    def _prepared(self, vehicles: Sequence[VehicleId] | None) -> list[VehicleId]:
        """Check the other stations before a start. Returns: the own of these. Raises: RefusedError."""
        here, away = split(self.member, vehicles)
        if why := self.member.why_not_start():
            raise RefusedError(f"a start needs every station: {why}")
        lead = self.member.site.lead
        if vehicles is not None:
            self.shows.check_named(vehicles, here if lead.leads else away.get(lead.name, ()))
        named = self._named(vehicles)
        self.shows.named = None if named is None else frozenset(named)
        self.holds.end()
        return here

    def _named(self, vehicles: Sequence[VehicleId] | None) -> tuple[VehicleId, ...] | None:
        """The vehicles of all stations that a start of a show names; None: all but those left out."""
        return None if vehicles is None or self.local.flight.show.run is None else (*vehicles,)

    def _ask(
        self, record: CommandRecord, request: ShowRequest, vehicles: Sequence[VehicleId] | None
    ) -> CommandRecord:
        """Have the other stations execute a command with their vehicles, or those of `vehicles`."""
        _, away = split(self.member, vehicles)
        starts = request.action is ShowAction.START
        reached = (Phase.STANDBY,) if starts else (*AIRBORNE,)
        for name in self.member.site.stations:
            expected = self.member.ids_of(name, *reached)
            of_station = None if vehicles is None else tuple(away.get(name, ()))
            if of_station is not None:
                expected = [vehicle_id for vehicle_id in of_station if vehicle_id in expected]
            if expected or not starts:
                asked = replace(request, vehicles=of_station)
                asked = self.member.as_agreed(name, asked) if starts else asked
                record = self.routing.ask(record, name, asked, expected)
        return record

    def spread(self, record: CommandRecord, action: ShowAction, reason: str) -> CommandRecord:
        """Have the other stations execute a failsafe of this one as well."""
        for name in self.member.present():
            expected = self.member.ids_of(name, *AIRBORNE)
            request = ShowRequest(record.id, "service", action, reason=reason)
            record = self.routing.ask(record, name, request, expected)
        return record

    def command_vehicle(self, vehicle_id: VehicleId, action: VehicleAction) -> CommandRecord:
        here, away = split(self.member, [vehicle_id])
        if here:
            return self.local.command_vehicle(vehicle_id, action)
        record = self._book.open(action, [], {})
        for name, ids in away.items():
            record = self.routing.ask(
                record, name, VehiclesRequest(record.id, CALLER.get(), action, (*ids,)), ids
            )
        return record

    def command_vehicles(
        self, action: VehicleAction, vehicles: Sequence[VehicleId] | None = None
    ) -> CommandRecord:
        here, away = split(self.member, vehicles)
        if vehicles is None:
            away = {name: self.member.ids_of(name, *AIRBORNE) for name in self.member.present()}
            away = {name: ids for name, ids in away.items() if ids}
        local = partial(self.local.command_vehicles, action, None if vehicles is None else here)
        if vehicles is not None and not here:
            record = self._book.open(action, [], {})
        else:
            record = execute_own(self.member, action.value, local, others=bool(away))
        for name, ids in away.items():
            expected = None if vehicles is None else (*ids,)
            record = self.routing.ask(
                record, name, VehiclesRequest(record.id, CALLER.get(), action, expected), ids
            )
        return record

    def kill(self, vehicle_ids: Sequence[VehicleId]) -> CommandRecord:
        here, away = split(self.member, vehicle_ids)
        record = self.local.kill(here) if here or not away else self._book.open("kill", [], {})
        for name, ids in away.items():
            record = self.routing.ask(record, name, KillRequest(record.id, CALLER.get(), (*ids,)), ids)
        return record

    def _others_fly(self, action: ShowAction) -> bool:
        """Whether another station may accept a command that this one refuses."""
        member = self.member
        calls_off = action in {ShowAction.STOP, ShowAction.ABORT} and self.local.starting.go.two is not None
        if calls_off and member.present():
            return True  # one may wait at the lead for its confirmation
        return any(member.show_of(name) not in ON_THE_GROUND for name in member.present())


@dataclass(eq=False)
class SiteGo:
    """Checklists and weather, kept at the station that leads. Implements `gcs.service.interface.Go`."""

    local: CrewGo
    member: SiteMember

    def sign(self, role: str, items: Sequence[int]) -> GoView:
        need_lead(self.member, "sign a checklist")
        return self.local.sign(role, items)

    def reopen(self, role: str, items: Sequence[int]) -> GoView:
        need_lead(self.member, "open a checklist's items")
        return self.local.reopen(role, items)

    def enter_weather(self, entry: WeatherEntry) -> GoView:
        need_lead(self.member, "enter the weather")
        return self.local.enter_weather(entry)


@dataclass(eq=False)
class SiteStations:
    """Lead and standby. Implements `gcs.service.Stations`."""

    member: SiteMember
    display: SiteDisplay
    standby: Standby
    routing: SiteRouting

    def take_lead(self) -> tuple[StationView, ...]:
        """Lead the site from now on. Returns: all stations."""
        lead = self.member.site.lead
        if not lead.leads:
            before = lead.name
            term = lead.take()
            log.warning("lead_taken", extra={"term": term, "of": before, "by": CALLER.get()})
        return self.display.stations()

    def take_over(self, station: str) -> CommandRecord:
        """Fly on with the vehicles of a lost station, at its standby. Raises: RefusedError, UnknownError."""
        member = self.member
        if station in member.roles.stands_by_for:
            return self.standby.go_on(station)
        if station not in member.site.names:
            raise UnknownError(f"there is no station {station}; there are {', '.join(member.site.names)}")
        standbys = member.roles.standbys_of[station]
        if not standbys:
            raise RefusedError(f"no station stands by for {station}")
        record = self.member.flight.book.open(TAKE_OVER, [], {})
        for name in standbys:
            flown = [
                vehicle_id
                for vehicle_id in member.ids_of(name, Phase.HOLD)
                if vehicle_id in member.roles.configured[station]
            ]
            request = StandbyRequest(record.id, CALLER.get(), station)
            record = self.routing.ask(record, name, request, flown or member.roles.configured[station])
        return record


@dataclass(eq=False)
class SitePreflight:
    """Checks of the own vehicles, exclusions of all. Implements `gcs.service.Preflight`."""

    local: PreflightGate
    member: SiteMember
    routing: SiteRouting

    def report(self, vehicles: Sequence[VehicleId] | None = None) -> PreflightReport:
        """As `PreflightGate.report`, of the own vehicles, and whether the other stations could start."""
        report = self.local.report(vehicles)
        if report.in_flight:
            return report
        why = self.member.why_no_start()
        state, to_do = (State.FAIL, TO_DO[STATIONS]) if why else (State.PASS, "")
        check = Check(STATIONS, state, limit="all could start", problem=why, to_do=to_do)
        cause = PreflightCause(STATIONS, state, why, to_do, (), ())
        causes = (*report.causes, cause) if why else report.causes
        return replace(report, fleet=(*report.fleet, check), causes=causes)

    def exclude(self, vehicle_id: VehicleId, reason: str) -> CommandRecord:
        """Take a vehicle out of the show, at the station that flies it."""
        if len(reason) > REASON_MAX:
            raise InvalidError("reason", reason[:20], f"at most {REASON_MAX} characters")
        here, away = split(self.member, [vehicle_id])
        if here:
            return self.local.exclude(vehicle_id, reason)
        return self._ask_exclusion("exclude", away, reason)

    def include(self, vehicle_id: VehicleId) -> CommandRecord:
        """Include an excluded vehicle again, at the station that flies it."""
        here, away = split(self.member, [vehicle_id])
        return self.local.include(vehicle_id) if here else self._ask_exclusion("include", away, None)

    def _ask_exclusion(
        self, action: str, away: Mapping[str, Sequence[VehicleId]], reason: str | None
    ) -> CommandRecord:
        record = self.member.flight.book.open(action, [], {})
        for name, ids in away.items():
            request = ExcludeRequest(record.id, CALLER.get(), ids[0], reason)
            record = self.routing.ask(record, name, request, ids)
        return record


@dataclass(eq=False)
class SiteRecovery:
    """Interrupted flights of all stations. Implements `gcs.service.Recovery`."""

    local: FlightRecovery
    member: SiteMember
    routing: SiteRouting

    def settle(self, offer: Offer) -> CommandRecord:
        """Settle the interrupted flights of all stations that offer this, as one command."""
        offering = self.member.offering(offer)
        view = self.local.view()
        local = partial(self.local.settle, offer)
        if not offering or (view is not None and offer in view.offers):
            record = execute_own(self.member, offer.value, local, others=bool(offering))
        else:
            record = self.member.flight.book.open(offer.value, [], {})
        for name in offering:
            request = SettleRequest(record.id, CALLER.get(), offer)
            record = self.routing.ask(record, name, request, self.member.ids_of(name, Phase.PILOT))
        return record


def need_lead(member: SiteMember, what: str) -> None:
    """Raises: RefusedError unless this station leads."""
    lead = member.site.lead
    if not lead.leads:
        raise RefusedError(
            f"cannot {what} here: station {lead.name} leads, and decides on a start; do it there"
        )


def split(
    member: SiteMember, vehicles: Sequence[VehicleId] | None
) -> tuple[list[VehicleId], dict[str, list[VehicleId]]]:
    """The own of these, and the others by station. Raises: UnknownError."""
    here: list[VehicleId] = []
    away: dict[str, list[VehicleId]] = {}
    site, flight = member.site, member.flight
    owner = dict(zip(site.ids, site.owners, strict=True))
    for name in dict.fromkeys(vehicles or ()):
        own = flight.vehicles.get(name)
        if own is not None and member.owned[own.row]:
            here.append(name)
        elif name in owner or name in flight.vehicles:
            away.setdefault(owner.get(name) or NO_STATION, []).append(name)
        else:
            names = ", ".join((*flight.vehicles, *site.ids))
            raise UnknownError(f"there is no vehicle {name}; there are {names}")
    return here, away


def execute_own(
    member: SiteMember, action: str, execute: Callable[[], CommandRecord], *, others: bool
) -> CommandRecord:
    """Execute the own part. Raises: RefusedError when it is refused, and no other station has a part."""
    try:
        return execute()
    except RefusedError as refused:
        if not others:
            raise
        log.info("own_part_refused", extra={"command": action, "reason": str(refused)})
        return member.flight.book.open(action, [], {})
