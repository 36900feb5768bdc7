"""When a site's show begins to move: the lead decides, and the other stations begin at the same moment.

The lead sends how long it is until then. A station whose own clock agrees uses that, which is exact: how late
a message arrives is known to half a tick only.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, nan
from typing import Final

from gcs.flight.shows.show_begin import ALIGNS_S, EARLY_S, ShowBegin
from gcs.flight.state.elsewhere import LedBegin
from gcs.flight.state.external_clock import ExternalClock
from gcs.flight.state.newest import Newest
from gcs.flight.state.running_show import ShowRun
from gcs.flight.state.show_state import ShowState
from gcs.model.lifecycle import ShowPhase
from gcs.site.led_show import LedShow
from gcs.site.member import SiteMember

AGREES_S: Final = 0.03
"""Difference between the own clock and the lead's message up to which the own clock counts."""

CENTRE_AFTER_S: Final = 0.015
"""By then the lead's first message of motion has arrived, which a follower of the law moves with."""


@dataclass(eq=False)
class FollowedBegin(LedBegin):
    """When the show begins at a station that does not lead: with the lead."""

    newest: Newest
    show: ShowState
    outside_clock: ExternalClock
    unix_s: Callable[[], float]
    member: SiteMember
    local: ShowBegin
    began_s: float = -inf  # when a show began here, by the loop's clock

    def _led(self, show_run: ShowRun | None) -> LedShow | None:
        """How the lead has this show; None: it is not received, or has another."""
        led = self.member.show_traffic.led
        return None if led is None or show_run is None or led.hash != show_run.hash else led

    @property
    def follows_clock(self) -> bool:
        led = self.member.show_traffic.led
        return led is not None and led.outside is not None and led.outside.followed

    @property
    def waits(self) -> bool:
        show_run = self.show.run
        led = self._led(show_run)
        return show_run is not None and (led is None or not led.runs)

    def due_s(self, now_s: float) -> float | None:
        show_run = self.show.run
        begins_s = self._with_lead_s(show_run, now_s)
        if show_run is None or begins_s is None or self.show.phase is not ShowPhase.ASSEMBLING:
            return None
        due_s = begins_s if show_run.goals is not None else begins_s + CENTRE_AFTER_S
        return due_s if 0.0 < due_s - now_s < ALIGNS_S else None

    def _with_lead_s(self, show_run: ShowRun | None, now_s: float) -> float | None:
        """When the lead begins, by the loop's clock; None: not known."""
        led = self._led(show_run)
        if led is None or led.begins_s is None:
            return None
        at_unix_s = None if led.begin is None else led.begin.at_unix_time_s
        if at_unix_s is not None:
            own_s = now_s + at_unix_s - self.unix_s()
            if abs(own_s - led.begins_s) <= AGREES_S:
                return own_s
        return led.begins_s

    def follow(self) -> None:
        """Begin with the lead, and show how it waits. Call once a tick at a station that does not lead."""
        show_run = self.show.run
        led, now_s = self._led(show_run), self.newest.state.time_s
        self._watch_clock(show_run, now_s)
        if led is None or show_run is None:
            return
        show_run.begun, begin = led.begun, led.begin
        self.local.keep(show_run, begin)
        if begin is not None and begin.in_s is not None:
            begin = replace(begin, in_s=begin.in_s - (now_s - led.made_s))
        show_run.begin = begin
        begins_s = self._with_lead_s(show_run, now_s)
        if self.show.phase is ShowPhase.ASSEMBLING and begins_s is not None and now_s >= begins_s - EARLY_S:
            self.began_s = now_s
            self.local.begin_now(show_run, begins_s)

    def _watch_clock(self, show_run: ShowRun | None, now_s: float) -> None:
        """Say that the own external clock is not followed, because another station leads."""
        outside, led = self.outside_clock, self.member.show_traffic.led
        if not outside.configured:
            return
        clock_s = nan if show_run is None or not show_run.begun else show_run.clock.show_s(now_s)
        outside.note_show(clock_s)
        outside.note_frozen(False, self.unix_s())
        of_lead = None if led is None else led.outside
        if of_lead is not None:
            outside.followed = of_lead.followed  # kept where this station leads next
        only_here = outside.runs(now_s) and not (of_lead is not None and of_lead.runs)
        name = self.member.site.lead.name
        outside.expected = not only_here
        outside.problem = f"not followed: station {name} leads"
        if only_here:
            outside.problem += f", and no {outside.name} arrives there"
