"""Holds while a station of the site is missing, and keeps the own show with the lead's."""

import logging
from collections.abc import Callable
from typing import Final

from gcs.flight.state.newest import Newest
from gcs.flight.state.show_state import ShowState, reached
from gcs.flight.state.vehicle import FlightVehicles
from gcs.model.lifecycle import AIRBORNE, Phase, ShowEvent, ShowPhase
from gcs.site.member import SiteMember

log = logging.getLogger(__name__)

FORMED: Final = frozenset({ShowPhase.ASSEMBLING, ShowPhase.RUNNING})

GONE_HOLD_S: Final = 6.0
"""When a station with vehicles in the air is lost, all hold for this time; then they close the gap.

If its process has ended no bus heals: they hold for HOLDS_LEAST_S only.
"""

HOLDS_LEAST_S: Final = 1.0
"""Time in which the lead notices as well what a follower holds for."""

SETTLED_S: Final = 0.5
"""A phase of the lead counts once it has lasted so long: an operator's command may be under way to it."""


class SiteHolds:
    """What a station does by itself with its show when others are missing, or the lead does it."""

    def __init__(
        self,
        newest: Newest,
        vehicles: FlightVehicles,
        show: ShowState,
        member: SiteMember,
        pause: Callable[[str], object],
        resume: Callable[[], object],
    ) -> None:
        """`pause`, with a reason, and `resume` command the own vehicles only."""
        self._newest, self._vehicles, self._show, self._member = newest, vehicles, show, member
        self._pause, self._resume = pause, resume
        self._waits_for = ""  # the station for which this one holds
        self._waits_since_s = 0.0
        self._gone: dict[str, float] = {}  # lost, with vehicles in the air: until when all hold
        self._lead_show: tuple[ShowPhase, float] = (ShowPhase.IDLE, 0.0)

    def end(self) -> None:
        """An operator commands: this station does not resume by itself."""
        self._waits_for = ""

    def advance(self, now_s: float) -> None:
        """Once a tick."""
        member = self._member
        lead = member.site.lead
        newly_gone = self._note_gone(now_s)
        if self._show.phase in FORMED and newly_gone:
            name = min(newly_gone)
            self._wait_for(name, f"station {name} is not received: all hold")
        elif self._show.phase in FORMED and not lead.leads and self._lead_silent(now_s):
            self._wait_for(lead.name, f"the leading station {lead.name} is silent: all hold")
        elif not lead.leads and lead.name in member.present():
            self._keep_with_lead(now_s)
        if self._waits_for and self._show.phase is ShowPhase.PAUSED and self._may_go_on(now_s):
            self._waits_for = ""
            self._resume()

    def _lead_silent(self, now_s: float) -> bool:
        station = self._member.site.stations[self._member.site.lead.name]
        return now_s - station.arrived_s > self._member.lead_silent_s

    def _note_gone(self, now_s: float) -> list[str]:
        """Note stations that are lost with vehicles in the air. Returns: those that were not until now."""
        member, before = self._member, self._gone
        lost = [name for name in member.site.lost(now_s) if member.ids_of(name, *AIRBORNE)]
        hold_s = {name: HOLDS_LEAST_S if member.ended(name) else GONE_HOLD_S for name in lost}
        self._gone = {name: before.get(name, now_s + hold_s[name]) for name in lost}
        return [name for name in lost if name not in before]

    def _wait_for(self, station: str, reason: str) -> None:
        log.warning("holds_for_station", extra={"other": station, "reason": reason})
        self._pause(reason)
        self._waits_for, self._waits_since_s = station, self._newest.state.time_s

    def _may_go_on(self, now_s: float) -> bool:
        """Whether what this station waited for is over."""
        lead, member = self._member.site.lead, self._member
        if not self._vehicles.in_phase(Phase.FORMATION) or now_s - self._waits_since_s < HOLDS_LEAST_S:
            return False
        if not lead.leads:
            return lead.name in member.present() and member.show_of(lead.name) in FORMED
        return all(now_s >= until_s for until_s in self._gone.values())

    def _keep_with_lead(self, now_s: float) -> None:
        lead = self._member.site.lead
        show = self._member.show_of(lead.name)
        if show is not self._lead_show[0]:
            self._lead_show = show, now_s
        if now_s - self._lead_show[1] < SETTLED_S:
            return
        if show is ShowPhase.PAUSED and self._show.phase in FORMED and not self._waits_for:
            self._wait_for(lead.name, f"the leading station {lead.name} holds")
        elif show is ShowPhase.RUNNING and self._show.phase is ShowPhase.ASSEMBLING:
            self._show.move(ShowEvent.ASSEMBLED, reached(self._show, self._vehicles))
