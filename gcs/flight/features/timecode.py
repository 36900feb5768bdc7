"""The feature timecode of one station: what arrived, and how the selected show stands to it."""

from collections.abc import Iterator
from math import isnan, nan
from typing import Final

from gcs.flight.state.external_clock import ExternalClock
from gcs.flight.state.feature import Instant
from gcs.flight.state.running_show import ShowRun
from gcs.links.features import TimecodeSettings
from gcs.links.intake import Intake
from gcs.model.lifecycle import ShowPhase
from gcs.service.alarms import AlarmCause, AlarmSeverity, Condition
from gcs.service.features import TimecodeView
from gcs.shows.timecode import Chase, ChaseState, Rate, Reading
from gcs.shows.timecode.receiver import bound_of, keep_receiving
from gcs.shows.timecode.smpte import label_at, parse_label, within_a_day

WHY = {
    ChaseState.NONE: "no timecode has arrived",
    ChaseState.STOPPED: "the timecode has stopped",
    ChaseState.LOST: "no timecode arrives any more: its source has stopped, or is cut off",
    ChaseState.REFUSED: "the timecode has jumped by {jump_s:+.1f} s, more than {most_s:g} s",
}


SHOW_STANDS: Final = "The show stands still, and its vehicles hover."

APART_S: Final = 1.0
"""From here on a show that is not where its timecode is gives an alarm."""


class Timecode(ExternalClock):
    """Takes what arrives; without settings there is none."""

    name = "timecode"

    def __init__(self, settings: TimecodeSettings | None) -> None:
        self.settings = settings
        self.configured = settings is not None
        self.jump_max_s, self.catch_up = (settings.jump_max_s, settings.catch_up) if settings else (1.0, 0.0)
        super().__init__()
        self._chase = Chase(settings.freewheel_s if settings else 1.0, self.jump_max_s)
        self._failed = ""
        self._readings = self._garbage = 0
        source = settings.source if settings else "none"
        self.intakes = (Intake(f"timecode {source}", bound_of(settings)),)
        self._begins: tuple[Rate, float] | None = None  # the timecode of a show's beginning, at that rate

    async def receive(self) -> None:
        if self.settings is not None:
            await keep_receiving(self.settings, self, *self.intakes)

    def take(self, reading: Reading, now_s: float) -> None:
        """Take a reading that has just arrived."""
        self._failed = ""
        self._readings += 1
        self._chase.take(reading, now_s)

    def count(self, garbage: int) -> None:
        """Note how many messages made no sense."""
        self._garbage = garbage

    def failed(self, why: str) -> None:
        """Note why nothing can be received."""
        self._failed = why

    def runs(self, now_s: float) -> bool:
        return self._chase.runs(now_s)

    @property
    def slope(self) -> float:
        return self._chase.slope()

    def show_s(self, now_s: float) -> float:
        settings, rate = self.settings, self._chase.rate
        if settings is None or rate is None:
            return nan
        begins_s = self._begins_s(settings, rate) + settings.delay_s
        return within_a_day(self._chase.time_s(now_s) - begins_s, rate)

    def note_show(self, show_s: float) -> None:
        settings, rate = self.settings, self._chase.rate
        if settings is not None and rate is not None:
            self._chase.show_s = show_s + self._begins_s(settings, rate) + settings.delay_s

    def _begins_s(self, settings: TimecodeSettings, rate: Rate) -> float:
        if self._begins is None or self._begins[0] is not rate:
            self._begins = rate, parse_label(settings.starts_at).time_s(rate)
        return self._begins[1]

    def why_not(self, now_s: float) -> str:
        text = WHY.get(self._chase.state(now_s), "").format(
            jump_s=self._chase.jump_s, most_s=self._chase.jump_max_s
        )
        return f"{text} ({self._failed})" if text and self._failed else text

    def is_missing(self, now_s: float) -> bool:
        """Whether the show stands still, and no source has said that it shall."""
        silent = self._chase.state(now_s) in {ChaseState.NONE, ChaseState.LOST}
        return silent and self.frozen_since_unix_s is not None

    def why_apart(self, show_run: ShowRun, now_s: float) -> str:
        """Why the show is not where its timecode is, in words; empty where it is, or as it should be."""
        if not self.followed or self.expected:
            return ""
        behind_s = self.show_s(now_s) - show_run.clock.show_s(now_s)
        if self.problem or not show_run.clock.runs or not abs(behind_s) > APART_S:
            return self.problem
        return f"the show is {abs(behind_s):.1f} s {'behind' if behind_s > 0.0 else 'ahead'}"

    def conditions(self, at: Instant) -> Iterator[Condition]:
        now_s, show, show_run = at
        if show_run is None or show not in {ShowPhase.ASSEMBLING, ShowPhase.RUNNING}:
            return
        if why := self.why_apart(show_run, now_s):
            consequence = "" if self.frozen_since_unix_s is None else SHOW_STANDS
            severity = AlarmSeverity.WARNING if self.is_missing(now_s) else None
            yield Condition(AlarmCause.TIMECODE, why, consequence=consequence, severity=severity)

    def view(self, at: Instant) -> TimecodeView | None:
        settings, chase, now_s, show_run = self.settings, self._chase, at.time_s, at.show_run
        if settings is None:
            return None
        time_s, rate = chase.time_s(now_s), chase.rate
        follows = self.followed and show_run is not None and show_run.clock.runs
        return TimecodeView(
            source=settings.source,
            followed=self.followed,
            state=chase.state(now_s).value,
            label="" if rate is None or isnan(time_s) else str(label_at(time_s, rate)),
            frame_rate="" if rate is None else rate.text,
            age_s=chase.age_s(now_s),
            behind_s=self.show_s(now_s) - show_run.clock.show_s(now_s) if follows and show_run else nan,
            slope=chase.slope() if chase.runs(now_s) else nan,
            tempo=show_run.tempo.rate if follows and show_run else nan,
            problem=self.problem,
            frozen_since_unix_time_s=self.frozen_since_unix_s if follows else None,
            readings=self._readings,
            garbage=self._garbage,
            dropped=self.intakes[0].dropped,
        )
