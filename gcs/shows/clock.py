"""The clock of a show: it runs, stops, and begins at a cue. Pure."""

from dataclasses import dataclass, replace

from gcs.model.errors import RefusedError, UnknownError
from gcs.shows.timeline import Timeline


@dataclass(frozen=True, slots=True)
class ShowClock:
    """The show's time. Every `clock_s` is the tick's own time; a change returns a new value."""

    begins_s: float = 0.0  # the show's time at which it begins, or last began to run
    since_s: float | None = None  # the tick's time then; None: the clock is stopped

    @property
    def runs(self) -> bool:
        return self.since_s is not None

    def show_s(self, clock_s: float) -> float:
        return self.begins_s if self.since_s is None else self.begins_s + (clock_s - self.since_s)

    def run(self, clock_s: float) -> "ShowClock":
        """Start the clock once the sphere is assembled, or assembled again. No effect while it runs.

        `clock_s` may lie before the tick: then the show has begun between two ticks.
        """
        return self if self.runs else replace(self, since_s=clock_s)

    def stop(self, clock_s: float) -> "ShowClock":
        """Stop the clock: the show continues at the same time after a pause of any length."""
        return ShowClock(self.show_s(clock_s))

    def later(self, wait_s: float) -> "ShowClock":
        """Let the clock lose this time: it waited, or ran slower; negative: it ran faster."""
        return replace(self, begins_s=self.begins_s - wait_s)

    def seek(self, timeline: Timeline, cue: str, *, grounded: bool) -> "ShowClock":
        """Start at the first time that a cue is played.

        Raises:
            UnknownError: the show has no such cue; the text names the cues it has.
            RefusedError: a vehicle is airborne; the formation would jump to another place of the show.
        """
        times_s = {played.cue.cue: played.at_s for played in reversed(timeline.played)}
        if cue not in times_s:
            names = ", ".join(played.cue for played in timeline.show.timeline)
            raise UnknownError(f"there is no cue {cue}; there are {names}")
        if not grounded:
            raise RefusedError("a show is set to a cue on the ground only: bring all vehicles home first")
        return ShowClock(times_s[cue])

    def ended(self, timeline: Timeline, clock_s: float) -> bool:
        return self.runs and self.show_s(clock_s) >= timeline.duration_s
