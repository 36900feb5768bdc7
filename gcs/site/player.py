"""Shows of a site: any station selects one, and the lead plays it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from gcs.flight.shows.show_player import ShowPlayer
from gcs.flight.state.external_clock import ExternalClock
from gcs.flight.state.newest import Newest
from gcs.flight.state.running_show import ShowRun
from gcs.flight.state.show_state import ShowState
from gcs.model.errors import GcsError, RefusedError
from gcs.model.lifecycle import ON_THE_GROUND
from gcs.service import CALLER, BeginState, BeginView, SelectedShow
from gcs.site.member import SiteMember
from gcs.site.requests import REQUEST, Refusal, ShowChange
from gcs.site.shows import SiteShows

SELECTED_WITHIN_S: Final = 60.0
"""A show that another station selects is refused when it has not been read by then, with its drawing."""


@dataclass(eq=False)
class SitePlayer:
    """Commands to the show, executed at the lead or asked of it. Implements `gcs.service.Player`."""

    newest: Newest
    show: ShowState
    outside_clock: ExternalClock
    unix_s: Callable[[], float]
    local: ShowPlayer
    member: SiteMember
    shows: SiteShows

    def __post_init__(self) -> None:
        self._selecting: tuple[str, ShowChange, float] | None = None  # by which station, and until when

    def select(self, name: str, show_hash: str) -> SelectedShow:
        if self.shows.leads:
            return self.local.select(name, show_hash)
        self._need_lead("select a show")
        timeline = self.local.fitting(name, self.local.show_library.cleared(name, show_hash))
        show_run = ShowRun(name, timeline, figures=self.local.show_library.checked(name).figures)
        self.shows.post(self.member.site.lead.name, show_run)
        self._ask("select", show_hash)
        return show_run.view(self.newest.state.time_s)

    def deselect(self) -> None:
        if self.shows.leads:
            self.local.deselect()
            return
        self._need_lead("deselect the show")
        self._ask("deselect", "")

    def seek(self, cue: str) -> SelectedShow:
        if self.shows.leads:
            return self.local.seek(cue)
        show_run, now_s = self.show.run, self.newest.state.time_s
        if show_run is None:
            raise RefusedError("no show is selected: seek is for one that is")
        self._need_lead("seek a cue")
        clock = show_run.clock.seek(show_run.timeline, cue, grounded=True)
        self._ask("seek", cue)
        return replace(show_run, clock=clock).view(now_s)

    def begin_at(self, at_unix_time_s: float) -> SelectedShow:
        if self.shows.leads:
            return self.local.begin_at(at_unix_time_s)
        self._need_lead_here()
        self.local.begin.check(at_unix_time_s)
        self._ask("begin", repr(at_unix_time_s))
        in_s = at_unix_time_s - self.unix_s()
        return replace(self.local.selected(), begin=BeginView(BeginState.ARMED, at_unix_time_s, in_s))

    def cancel_begin(self) -> SelectedShow:
        if self.shows.leads:
            return self.local.cancel_begin()
        self._need_lead_here()
        self.local.begin.check_cancel()
        self._ask("cancel-begin", "")
        grounded = self.show.phase in ON_THE_GROUND
        begin = None if grounded else BeginView(BeginState.HELD, None, None)
        return replace(self.local.selected(), begin=begin)

    def follow_external_clock(self, follow: bool) -> None:
        if self.shows.leads:
            self.local.follow_external_clock(follow)
            return
        self._need_lead_here()
        led = self.member.show_traffic.led
        if led is None or led.outside is None:
            station = self.member.site.lead.name
            raise RefusedError(
                f"no {self.outside_clock.name} is configured at station {station}, which leads"
            )
        self._ask("follow-external-clock", "yes" if follow else "no")

    def _need_lead(self, what: str) -> None:
        self.show.need_no_countdown()
        self.local.need_ground(what)
        self._need_lead_here()

    def _need_lead_here(self) -> None:
        if not self.member.lead_is_here:
            name = self.member.site.lead.name
            raise RefusedError(f"the leading station {name} is not received: gcs lead take")

    def _ask(self, action: Any, value: str) -> None:
        request = ShowChange(CALLER.get(), action, value)
        self.member.post(self.member.site.lead.name, REQUEST.dump_python(request, mode="json"))

    def change_for(self, station: str, request: ShowChange) -> None:
        """Execute what another station asks of the lead; a refusal is logged here and there."""
        try:
            if not self.shows.leads:
                raise RefusedError(f"station {self.member.site.own} does not lead")
            if request.action == "select":
                self._selecting = station, request, self.newest.state.time_s + SELECTED_WITHIN_S
                self.advance()
            else:
                self._change(request)
        except (GcsError, ValueError) as refused:
            self.member.refuse(station, Refusal(f"to {request.action}", request.by, str(refused)[:500]))

    def _change(self, request: ShowChange) -> None:
        """Raises: GcsError; ValueError for a time that is no number."""
        match request.action:
            case "deselect":
                self.local.deselect()
            case "seek":
                self.local.seek(request.value)
            case "begin":
                self.local.begin_at(float(request.value))
            case "cancel-begin":
                self.local.cancel_begin()
            case "follow-external-clock":
                self.local.follow_external_clock(request.value == "yes")

    def advance(self) -> None:
        """Select the show that another station asked for, once its drawing is read; once a tick."""
        if self._selecting is None or not self.shows.leads:
            return
        (station, request, until_s), now_s = self._selecting, self.newest.state.time_s
        try:
            show_run = self.shows.arrivals.find(request.value, now_s)
            if show_run is None and self.shows.arrivals.has(request.value) and now_s < until_s:
                return
            self._selecting = None
            if show_run is None:
                raise RefusedError("the show has not arrived")
            self.show.need_no_countdown()
            self.local.need_ground("select a show")
            self.local.fitting(show_run.name, show_run.timeline)
            self.local.take(replace(show_run))
        except GcsError as refused:
            self._selecting = None
            self.member.refuse(station, Refusal("to select", request.by, str(refused)[:500]))
