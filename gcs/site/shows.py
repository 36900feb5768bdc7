"""The selected show of a site: the lead plays it, every other station keeps with the lead.

The lead alone decides the plan. The other stations have the show for its limits, its fence, its hash, its
lights and, where it is drawn, for their own vehicles' goals. Its clock and the vehicles' parts come from the
lead: a station that takes the lead goes on with it.
"""

import logging
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gcs.flight.shows.show_player import ShowPlayer
from gcs.flight.state.elsewhere import LedBegin, ShowsElsewhere
from gcs.flight.state.newest import InForce, Newest
from gcs.flight.state.running_show import ShowFleet, ShowRun
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles
from gcs.model.errors import LinkError, RefusedError
from gcs.model.lifecycle import AIRBORNE, Phase, ShowPhase
from gcs.model.state import VehicleId
from gcs.shows import Flaw, Show
from gcs.shows.following import DrawnPace
from gcs.site.arrivals import ShowArrivals, parts_of
from gcs.site.begin import FollowedBegin
from gcs.site.led_show import LedShow, keep_clock
from gcs.site.member import SiteMember
from gcs.site.requests import PARTS_MAX, REQUEST, ShowMissing, ShowPart

log = logging.getLogger(__name__)

AGAIN_S: Final = 1.0
"""Interval between two requests for a show that has not arrived."""


@dataclass(eq=False)
class SiteShows(ShowsElsewhere):
    """The other stations' part in the show, and the lead's where this station follows."""

    why_begin_lost = "the station was restarted; only another that leads now keeps the time"

    newest: Newest
    show: ShowState
    in_force: InForce
    vehicles: FlightVehicles
    followed_begin: FollowedBegin
    local: ShowPlayer
    member: SiteMember
    arrivals: ShowArrivals

    def __post_init__(self) -> None:
        self.member.show_traffic.begins_s = self.local.begin.due_s
        self._packed: tuple[str, list[str]] = ("", [])  # the newest that was sent, by its hash
        self._ask_due_s = 0.0
        self._followed = False  # at the last tick
        self._why_not_here = ""  # why the lead's show, which has arrived, cannot be flown here
        self.named: frozenset[VehicleId] | None = None  # those of all stations that start; None: all

    @property
    def leads(self) -> bool:
        return self.member.site.lead.leads

    @property
    def why_busy(self) -> str:
        return "while vehicles of other stations fly" if self.member.shows_of_others_fly else ""

    @property
    def begin(self) -> LedBegin | None:
        return None if self.leads else self.followed_begin

    def misfits(self, show: Show) -> list[Flaw]:
        if show.drawing is None or show.drawing.spares is None:
            return []
        text = "drawing.spares: spare vehicles fly with one station alone: take them out of the show file"
        return [Flaw(("drawing", "spares"), text)]

    # between stations

    def take_part(self, part: ShowPart) -> None:
        """Note a part of a show; an unreadable show is logged."""
        self.arrivals.take(part)

    def send_to(self, station: str, request: ShowMissing) -> None:
        """Send the selected show to a station that has not got it; it asks again if it does not arrive."""
        show_run = self.show.run
        if show_run is None or show_run.hash != request.hash:
            return
        try:
            self.post(station, show_run)
        except (RefusedError, LinkError) as error:
            log.warning("show_not_sent", extra={"other": station, "reason": str(error)})

    def post(self, station: str, show_run: ShowRun) -> None:
        """Send a show, without its drawing. Raises: RefusedError, LinkError."""
        if self._packed[0] != show_run.hash:
            self._packed = show_run.hash, parts_of(show_run)
        texts = self._packed[1]
        if len(texts) > PARTS_MAX:
            raise RefusedError(f"show {show_run.name!r} is too large for the bus: {len(texts)} parts")
        for number, text in enumerate(texts):
            part = ShowPart(show_run.hash, number, len(texts), text)
            self.member.post(station, REQUEST.dump_python(part, mode="json"))

    # once a tick

    def follow(self) -> bool:
        show_run = self.show.run
        if not self.leads:
            self._followed = True
            self._keep_with_lead()
            return True
        now_s = self.newest.state.time_s
        if self._followed and show_run is not None:
            if show_run.is_live(now_s) and show_run.live is None:
                show_run.live = self.in_force.plan.target
            show_run.follow(self.show.phase, now_s)
        self._followed, self._why_not_here = False, ""
        return False

    def _keep_with_lead(self) -> None:
        member, now_s = self.member, self.newest.state.time_s
        led = member.show_traffic.led
        if led is not None and now_s - led.made_s > member.lead_silent_s:
            led = member.show_traffic.led = None  # a lead that comes back may not fly the show yet
        if led is not None:
            self._adopt(led)
        show_run = self.show.run
        if show_run is None:
            return
        goes_on = member.lead_is_here or self.show.phase is ShowPhase.RUNNING
        if led is not None and led.hash == show_run.hash and goes_on:
            keep_clock(show_run, led, now_s, self.followed_begin.began_s)
            count = show_run.timeline.show.fleet.vehicles
            show_run.parts = member.show_traffic.parts_of(led.hash, count) or show_run.parts
        else:
            show_run.clock, show_run.pace = show_run.clock.stop(now_s), DrawnPace()
        self.followed_begin.follow()
        assembling = self.show.phase is ShowPhase.ASSEMBLING
        show_run.follow_drawing(self.local.seen(), now_s, assembling=assembling, leads=False)

    def _adopt(self, led: LedShow) -> None:
        """Have the show that the lead has, or none."""
        show_run, now_s = self.show.run, self.newest.state.time_s
        if not led.hash or (show_run is not None and show_run.hash == led.hash):
            self._why_not_here = ""
            if show_run is not None and not led.hash:
                self.local.adopt(None)
            return
        try:
            arrived = self.arrivals.find(led.hash, now_s)
            if arrived is not None:
                self.local.adopt(replace(arrived))
            self._why_not_here = ""
        except RefusedError as refused:
            if self._why_not_here != str(refused):
                log.warning("show_not_here", extra={"reason": str(refused)})
            arrived, self._why_not_here = None, str(refused)
        if arrived is None and not self.arrivals.has(led.hash) and now_s >= self._ask_due_s:
            self._ask_due_s = now_s + AGAIN_S
            missing = REQUEST.dump_python(ShowMissing(led.hash), mode="json")
            with suppress(LinkError):  # as many wait as may: the lead is hardly received
                self.member.post(self.member.site.lead.name, missing)

    @property
    def why_not_here(self) -> str:
        """Why this station cannot start the lead's show; empty when it can, or there is none."""
        led, show_run = self.member.show_traffic.led, self.show.run
        here = "" if show_run is None else show_run.hash
        if self.leads or led is None or led.hash == here:
            return ""
        return self._why_not_here or "the selected show has not arrived from the lead"

    # vehicles of all stations

    @property
    def count(self) -> int:
        return len(self.member.site.shown) - len(self.vehicles)

    def joined(self, own: ShowFleet) -> ShowFleet:
        their, here = self.member.others, self.member.flown_by_others(Phase.FORMATION)
        formed = np.zeros(len(their.ids), np.bool_)
        formed[here] = True
        return ShowFleet(
            (*own.ids, *their.ids),
            np.concatenate([own.position_m, their.position_m]),
            np.concatenate([own.formed, formed]),
            own.own,
        )

    def start_too(self, *, named: bool) -> int:
        return 0 if named else sum(len(self._starting(name)) for name in self.member.present())

    def _starting(self, station: str) -> list[VehicleId]:
        """Vehicles of another station on the ground that its operators have not taken out of the show."""
        out = self.member.excluded(station)
        return [name for name in self.member.ids_of(station, Phase.STANDBY) if name not in out]

    def check_named(self, vehicles: Sequence[VehicleId], led: Sequence[VehicleId]) -> None:
        """Check whether the selected show starts with these vehicles of all stations.

        Args:
            vehicles: all that are named.
            led: of these, the leading station's. Raises: RefusedError.
        """
        show_run = self.show.run
        if show_run is None:
            return
        needed, count = show_run.timeline.show.fleet.vehicles, len(set(vehicles))
        if count > needed:
            raise RefusedError(f"show {show_run.name!r} is for {needed} vehicles, {count} would start")
        if not led:
            lead = self.member.site.lead.name
            raise RefusedError(f"a show starts with a vehicle of the leading station {lead}, which plays it")

    def starting(self, chosen: Sequence[VehicleId]) -> Sequence[VehicleId]:
        member, flying = self.member, set(chosen)
        for name in member.present():
            of_station = {*self._starting(name), *member.ids_of(name, *AIRBORNE)}
            flying |= of_station if self.named is None else of_station & self.named
        return [name for name in member.all_ids if name in flying]

    def rows(self, vehicle_ids: Sequence[VehicleId]) -> Mapping[VehicleId, int]:
        rows = {name: row for row, name in enumerate(self.member.all_ids)}
        return {name: rows[name] for name in vehicle_ids}
