"""Shows of a site: any station selects one, the lead plays it, every station has it.

The lead alone decides the plan. The other stations have the show for its limits, its fence, its hash, its
lights and, where it is drawn, for their own vehicles' goals. Its clock and the vehicles' parts come from the
lead: a station that takes the lead goes on with it.
"""

import logging
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from gcs.flight.led_show import LedShow, keep_clock
from gcs.flight.running_show import ShowFleet, ShowRun
from gcs.flight.show_player import ShowPlayer
from gcs.flight.site_arrivals import ShowArrivals, parts_of
from gcs.flight.site_begin import SiteShowBegin
from gcs.flight.site_member import SiteMember
from gcs.flight.site_requests import PARTS_MAX, REQUEST, Refusal, ShowChange, ShowMissing, ShowPart
from gcs.model.errors import GcsError, LinkError, RefusedError
from gcs.model.lifecycle import AIRBORNE, ON_THE_GROUND, Phase, ShowPhase
from gcs.model.state import VehicleId
from gcs.service import CALLER, BeginState, BeginView, SelectedShow
from gcs.shows import Flaw, Show
from gcs.shows.following import DrawnPace

log = logging.getLogger(__name__)

AGAIN_S: Final = 1.0
"""Interval between two requests for a show that has not arrived."""

SELECTED_WITHIN_S: Final = 60.0
"""A show that another station selects is refused when it has not been read by then, with its drawing."""


@dataclass(eq=False)
class SiteShowPlayer(ShowPlayer):
    """Plays the show at the lead, and keeps with the lead elsewhere. Implements `gcs.service.Player`."""

    member: SiteMember
    reading: Executor  # of drawings, and of other stations' shows

    def __post_init__(self) -> None:
        super().__post_init__()
        self.begin = self._keeping = SiteShowBegin(self.flight, member=self.member)
        self.member.shows.begins_s = self.begin.due_s
        self._arrivals = ShowArrivals(self.show_library, self.reading)
        self._packed: tuple[str, list[str]] = ("", [])  # the newest that was sent, by its hash
        self._selecting: tuple[str, ShowChange, float] | None = None  # by which station, and until when
        self._ask_due_s = 0.0
        self._followed = False  # at the last tick
        self._why_not_here = ""  # why the lead's show, which has arrived, cannot be flown here
        self.named: frozenset[VehicleId] | None = None  # those of all stations that start; None: all

    @property
    def leads(self) -> bool:
        return self.member.site.lead.leads

    # commands

    def select(self, name: str, show_hash: str) -> SelectedShow:
        if self.leads:
            return super().select(name, show_hash)
        self._need_lead("select a show")
        timeline = self._fitting(name, self.show_library.cleared(name, show_hash))
        show_run = ShowRun(name, timeline, figures=self.show_library.checked(name).figures)
        self._post_show(self.member.site.lead.name, show_run)
        self._ask("select", show_hash)
        return show_run.view(self.flight.fleet.time_s)

    def deselect(self) -> None:
        if self.leads:
            super().deselect()
            return
        self._need_lead("deselect the show")
        self._ask("deselect", "")

    def seek(self, cue: str) -> SelectedShow:
        if self.leads:
            return super().seek(cue)
        show_run, now_s = self.flight.show_run, self.flight.fleet.time_s
        if show_run is None:
            raise RefusedError("no show is selected: seek is for one that is")
        self._need_lead("seek a cue")
        clock = show_run.clock.seek(show_run.timeline, cue, grounded=True)
        self._ask("seek", cue)
        return replace(show_run, clock=clock).view(now_s)

    def begin_at(self, at_unix_time_s: float) -> SelectedShow:
        if self.leads:
            return super().begin_at(at_unix_time_s)
        self._need_lead_here()
        self.begin.check(at_unix_time_s)
        self._ask("begin", repr(at_unix_time_s))
        in_s = at_unix_time_s - self.flight.unix_s()
        return replace(self._selected(), begin=BeginView(BeginState.ARMED, at_unix_time_s, in_s))

    def cancel_begin(self) -> SelectedShow:
        if self.leads:
            return super().cancel_begin()
        self._need_lead_here()
        self.begin.check_cancel()
        self._ask("cancel-begin", "")
        grounded = self.flight.show in ON_THE_GROUND
        begin = None if grounded else BeginView(BeginState.HELD, None, None)
        return replace(self._selected(), begin=begin)

    def follow_timecode(self, follow: bool) -> None:
        if self.leads:
            super().follow_timecode(follow)
            return
        self._need_lead_here()
        led = self.member.shows.led
        if led is None or led.timecode is None:
            raise RefusedError(
                f"no timecode is configured at station {self.member.site.lead.name}, which leads"
            )
        self._ask("follow-timecode", "yes" if follow else "no")

    def _need_lead(self, what: str) -> None:
        self.flight.need_no_countdown()
        self.need_ground(what)
        self._need_lead_here()

    def _need_lead_here(self) -> None:
        if not self.member.lead_is_here:
            name = self.member.site.lead.name
            raise RefusedError(f"the leading station {name} is not received: gcs lead take")

    def need_ground(self, what: str) -> None:
        super().need_ground(what)
        if self.member.shows_of_others_fly:
            raise RefusedError(f"cannot {what} while vehicles of other stations fly")

    def _ask(self, action: Any, value: str) -> None:
        request = ShowChange(CALLER.get(), action, value)
        self.member.post(self.member.site.lead.name, REQUEST.dump_python(request, mode="json"))

    def change_for(self, station: str, request: ShowChange) -> None:
        """Execute what another station asks of the lead; a refusal is logged here and there."""
        try:
            if not self.leads:
                raise RefusedError(f"station {self.member.site.own} does not lead")
            if request.action == "select":
                self._selecting = station, request, self.flight.fleet.time_s + SELECTED_WITHIN_S
                self._select_arrived()
            else:
                self._change(request)
        except (GcsError, ValueError) as refused:
            self.member.refuse(station, Refusal(f"to {request.action}", request.by, str(refused)[:500]))

    def _change(self, request: ShowChange) -> None:
        """Raises: GcsError; ValueError for a time that is no number."""
        match request.action:
            case "deselect":
                super().deselect()
            case "seek":
                super().seek(request.value)
            case "begin":
                super().begin_at(float(request.value))
            case "cancel-begin":
                super().cancel_begin()
            case "follow-timecode":
                super().follow_timecode(request.value == "yes")

    def _select_arrived(self) -> None:
        """Select the show that another station asks for, once its drawing is read."""
        if self._selecting is None:
            return
        (station, request, until_s), now_s = self._selecting, self.flight.fleet.time_s
        try:
            show_run = self._arrivals.find(request.value, now_s)
            if show_run is None and self._arrivals.has(request.value) and now_s < until_s:
                return
            self._selecting = None
            if show_run is None:
                raise RefusedError("the show has not arrived")
            self.flight.need_no_countdown()
            self.need_ground("select a show")
            self._fitting(show_run.name, show_run.timeline)
            self._take(replace(show_run))
        except GcsError as refused:
            self._selecting = None
            self.member.refuse(station, Refusal("to select", request.by, str(refused)[:500]))

    def _own_misfits(self, show: Show) -> list[Flaw]:
        found = super()._own_misfits(show)
        if show.drawing is not None and show.drawing.spares is not None:
            text = "drawing.spares: spare vehicles fly with one station alone: take them out of the show file"
            found.insert(0, Flaw(("drawing", "spares"), text))
        return found

    # between stations

    def take_part(self, part: ShowPart) -> None:
        """Note a part of a show; an unreadable show is logged."""
        self._arrivals.take(part)

    def send_to(self, station: str, request: ShowMissing) -> None:
        """Send the selected show to a station that has not got it; it asks again if it does not arrive."""
        show_run = self.flight.show_run
        if show_run is None or show_run.hash != request.hash:
            return
        try:
            self._post_show(station, show_run)
        except (RefusedError, LinkError) as error:
            log.warning("show_not_sent", extra={"other": station, "reason": str(error)})

    def _post_show(self, station: str, show_run: ShowRun) -> None:
        if self._packed[0] != show_run.hash:
            self._packed = show_run.hash, parts_of(show_run)
        texts = self._packed[1]
        if len(texts) > PARTS_MAX:
            raise RefusedError(f"show {show_run.name!r} is too large for the bus: {len(texts)} parts")
        for number, text in enumerate(texts):
            part = ShowPart(show_run.hash, number, len(texts), text)
            self.member.post(station, REQUEST.dump_python(part, mode="json"))

    # once a tick

    def lead(self) -> None:
        flight, show_run = self.flight, self.flight.show_run
        if not self.leads:
            self._followed = True
            self._keep_with_lead()
            return
        now_s = flight.fleet.time_s
        if self._followed and show_run is not None:
            if show_run.is_live(now_s) and show_run.live is None:
                show_run.live = flight.plan.target
            show_run.follow(flight.show, now_s)
        self._followed, self._why_not_here = False, ""
        self._select_arrived()
        super().lead()

    def _keep_with_lead(self) -> None:
        member, flight, now_s = self.member, self.flight, self.flight.fleet.time_s
        led = member.shows.led
        if led is not None and now_s - led.made_s > member.lead_silent_s:
            led = member.shows.led = None  # a lead that comes back may not fly the show yet
        if led is not None:
            self._adopt(led)
        show_run = flight.show_run
        if show_run is None:
            return
        goes_on = member.lead_is_here or flight.show is ShowPhase.RUNNING
        if led is not None and led.hash == show_run.hash and goes_on:
            keep_clock(show_run, led, now_s, self._keeping.began_s)
            count = show_run.timeline.show.fleet.vehicles
            show_run.parts = member.shows.parts_of(led.hash, count) or show_run.parts
        else:
            show_run.clock, show_run.pace = show_run.clock.stop(now_s), DrawnPace()
        self._keeping.follow()
        assembling = flight.show is ShowPhase.ASSEMBLING
        show_run.follow_drawing(self._seen(), now_s, assembling=assembling, leads=False)

    def _adopt(self, led: LedShow) -> None:
        """Have the show that the lead has, or none."""
        flight, show_run, now_s = self.flight, self.flight.show_run, self.flight.fleet.time_s
        if not led.hash or (show_run is not None and show_run.hash == led.hash):
            self._why_not_here = ""
            if show_run is not None and not led.hash:
                flight.show_run, flight.control = None, flight.config.control
            return
        try:
            arrived = self._arrivals.find(led.hash, now_s)
            self._why_not_here = "" if arrived is None else self._why_not_here
        except RefusedError as refused:
            if self._why_not_here != str(refused):
                log.warning("show_not_here", extra={"reason": str(refused)})
            arrived, self._why_not_here = None, str(refused)
        if arrived is not None:
            if show_run is None:
                self._reported = flight.plan
            self._control(replace(arrived))
        elif not self._arrivals.has(led.hash) and now_s >= self._ask_due_s:
            self._ask_due_s = now_s + AGAIN_S
            missing = REQUEST.dump_python(ShowMissing(led.hash), mode="json")
            with suppress(LinkError):  # as many wait as may: the lead is hardly received
                self.member.post(self.member.site.lead.name, missing)

    @property
    def why_not_here(self) -> str:
        """Why this station cannot start the lead's show; empty when it can, or there is none."""
        led, show_run = self.member.shows.led, self.flight.show_run
        here = "" if show_run is None else show_run.hash
        if self.leads or led is None or led.hash == here:
            return ""
        return self._why_not_here or "the selected show has not arrived from the lead"

    # vehicles of all stations

    @property
    def _count(self) -> int:
        return len(self.member.site.shown)

    def _seen(self) -> ShowFleet:
        own, their, here = super()._seen(), self.member.others, self.member.flown_by_others(Phase.FORMATION)
        formed = np.zeros(len(their.ids), np.bool_)
        formed[here] = True
        return ShowFleet(
            (*own.ids, *their.ids),
            np.concatenate([own.position_m, their.position_m]),
            np.concatenate([own.formed, formed]),
            own.own,
        )

    def _others_start(self, *, named: bool) -> int:
        return 0 if named else sum(len(self._starting(name)) for name in self.member.present())

    def _starting(self, station: str) -> list[VehicleId]:
        """Vehicles of another station on the ground that its operators have not taken out of the show."""
        out = self.member.excluded(station)
        return [one for one in self.member.ids_of(station, Phase.STANDBY) if one not in out]

    def check_named(self, vehicles: Sequence[VehicleId], led: Sequence[VehicleId]) -> None:
        """Check whether the selected show starts with these vehicles of all stations.

        Args:
            vehicles: all that are named.
            led: of these, the leading station's. Raises: RefusedError.
        """
        show_run = self.flight.show_run
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
            theirs = {*self._starting(name), *member.ids_of(name, *AIRBORNE)}
            flying |= theirs if self.named is None else theirs & self.named
        return [name for name in member.all_ids if name in flying]

    def give_parts(self, chosen: Sequence[VehicleId]) -> Sequence[VehicleId]:
        """Start the selected show, if there is one: the lead assigns the parts of all stations' vehicles."""
        show_run = self.flight.show_run
        if show_run is None:
            return chosen
        show_run.started, show_run.parts = True, {}
        if not self.leads:
            return chosen
        seen = self._seen()
        known = np.asarray(np.isfinite(seen.position_m).all(axis=1))
        at_m = {name: seen.position_m[row] for row, name in enumerate(seen.ids) if known[row]}
        ordered = [name for name in self.starting(chosen) if name in at_m]
        ordered = ordered[: show_run.timeline.show.fleet.vehicles]
        show_run.assign(ordered, np.array([at_m[name] for name in ordered]).reshape(-1, 3))
        return chosen

    def pads(self) -> dict[VehicleId, int]:
        show_run = self.flight.show_run
        if show_run is None:
            return {}
        show, rows = show_run.timeline.show, {name: row for row, name in enumerate(self.member.all_ids)}
        in_order = {name: rows[name] for name in self.flight.vehicles if rows[name] < len(show.pads_m)}
        return self._stood_on(show) or in_order

    @property
    def target_age_s(self) -> float:
        return super().target_age_s if self.leads else float("nan")
