"""The service of a station of a site: that of its own flight, and every role for the vehicles of all."""

import asyncio
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

from gcs.bus import keep_bus_open
from gcs.control import Tick
from gcs.flight.orchestrator import Orchestrator
from gcs.flight.state.elsewhere import TickHooks
from gcs.model.errors import GcsError
from gcs.model.plan import Formation
from gcs.recording.sample import RecordedElsewhere
from gcs.service import CommandRecord, FleetView, ShowAction
from gcs.service.alarms import AlarmCause, Condition
from gcs.site.arrivals import ShowArrivals
from gcs.site.begin import FollowedBegin
from gcs.site.commander import SiteCommands, SiteGo, SitePreflight, SiteRecovery, SiteStations
from gcs.site.display import SiteDisplay
from gcs.site.executor import RequestExecutor
from gcs.site.holds import SiteHolds
from gcs.site.member import Membership, SiteMember
from gcs.site.plan import SitePlanEditor
from gcs.site.player import SitePlayer
from gcs.site.routing import SiteRouting
from gcs.site.shows import SiteShows
from gcs.site.standby import Standby
from gcs.stations import publishing


@dataclass(eq=False)
class SiteHooks(TickHooks):
    """What a tick of this station does with the others."""

    member: SiteMember
    display: SiteDisplay
    standby: Standby
    commands: SiteCommands
    executor: RequestExecutor
    plan: SitePlanEditor

    def before(self, now_s: float) -> None:
        self.member.receive(now_s)
        self.standby.release()  # before the setpoints of this tick

    @property
    def may_send(self) -> bool:
        """Whether every standby has answered, so that none may have taken the vehicles over."""
        return self.member.may_send

    def sent(self, result: Tick, *, all_up: bool) -> None:
        self.member.sender.publish(result, all_up=all_up, leads=self.member.leads_now)

    def after(self) -> None:
        self.executor.advance()

    def spread(self, record: CommandRecord, action: ShowAction, reason: str) -> CommandRecord:
        return self.commands.spread(record, action, reason)

    def lower(self, formation: Formation) -> str:
        if self.member.site.lead.leads:
            return ""
        try:
            self.plan.set_formation(formation, ("height_m",))
        except GcsError as error:
            return str(error)
        return ""

    def conditions(self) -> Iterable[Condition]:
        for name, why in self.member.lost.items():
            yield Condition(AlarmCause.STATION_LOST, why, about=name)

    def whole(self, own: Callable[[], FleetView], result: Tick) -> FleetView:
        return self.display.whole(own(), result)

    def recorded(self) -> RecordedElsewhere:
        return self.display.recorded()


class SiteService:
    """Flies one station's vehicles with those of the others. Implements `gcs.service.Service`."""

    def __init__(self, local: Orchestrator, membership: Membership, reading: Executor) -> None:
        """Sends nothing before `run`; must be created on the running event loop.

        Args:
            local: flies the vehicles of this station, and those that it stands by for; not running yet.
            membership: of the site.
            reading: executor that reads shows of other stations.
        """
        publishing.warm_up()
        self.local = local
        flight, commander, bus = local.flight, local.commands, membership.site.bus
        self._member = member = SiteMember(flight, membership)
        display, routing = SiteDisplay(member, membership.site), SiteRouting(member, flight.book)
        newest, vehicles, show = flight.newest, flight.vehicles, flight.show
        standby = Standby(
            newest,
            vehicles,
            show,
            flight.book,
            local.refusals,
            local.maneuvers,
            member,
            bus.lease_s,
            flight.config.setpoint_timeout_s,
            bus.standby_rejoins,
        )
        pause = partial(commander.execute_own_failsafe, ShowAction.PAUSE)
        holds = SiteHolds(
            newest, vehicles, show, member, pause, partial(commander.command_show, ShowAction.RESUME)
        )
        begin = FollowedBegin(newest, show, flight.outside_clock, flight.unix_s, member, local.player.begin)
        arrivals = ShowArrivals(local.shows, reading)
        member.shows = shows = SiteShows(
            newest, show, flight.in_force, vehicles, begin, local.player, member, arrivals
        )

        self.plan = SitePlanEditor(local.plan, member)
        self.player = SitePlayer(
            newest, show, flight.outside_clock, flight.unix_s, local.player, member, shows
        )
        self.commands = SiteCommands(commander, member, shows, routing, holds)
        self.stations = SiteStations(member, display, standby, routing)
        self.go = SiteGo(local.go, member)
        self.preflight = SitePreflight(local.preflight, member, routing)
        self.recovery = SiteRecovery(local.recovery, member, routing)
        executor = RequestExecutor(
            commander, local.preflight, member, routing, holds, standby, self.plan, self.player, shows
        )
        member.hooks = SiteHooks(member, display, standby, self.commands, executor, self.plan)
        local.join(member)

        self.view, self.frame, self.replaying = local.view, local.frame, None
        self.audit, self.events, self.alarms = local.audit, local.events, local.alarms
        self.shows, self.command_log = local.shows, local.command_log
        self.site = local.site

    async def run(self) -> None:
        """Fly until cancelled; an error of the bus ends the flight's control as one of its own does."""
        async with asyncio.TaskGroup() as group:
            group.create_task(keep_bus_open(self._member.bus), name="bus")
            await self.local.run()
