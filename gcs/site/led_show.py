"""The lead's show at the other stations of a site: its clock, and which vehicle flies which part.

The lead sends its clock with every tick while the show flies, as an age: the receiver adds the time since the
message was made. Written shows and drawn ones, clock, pace and tempo go the same way.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Any, Final

from pydantic_core import from_json

from gcs.flight.state.external_clock import ExternalClock
from gcs.flight.state.running_show import ShowRun
from gcs.flight.state.show_state import ShowState
from gcs.model.errors import LinkError
from gcs.model.lifecycle import ON_THE_GROUND
from gcs.model.state import VehicleId
from gcs.service import BeginState, BeginView
from gcs.shows import ShowClock
from gcs.shows.following import DrawnPace
from gcs.shows.tempo import Tempo
from gcs.stations.site import Site

SHOW, PARTS = "show", "parts"
"""Topics."""

SLOWLY_S: Final = 0.5
"""Interval between two messages on the ground, and between two of the parts."""

JUMPS_S: Final = 0.2
"""A clock that is off by more is set; one that is off by less gets there slowly."""

SHARE: Final = 0.1
"""Of the clock's error that is made up for at each tick: arrival times jitter by a tick."""

BEGUN_S: Final = 0.06
"""A message that the lead made less than this after a show began here may be of the tick before."""

RATE_MAX: Final = 2.0


@dataclass(frozen=True, slots=True)
class LedClock:
    """The external clock that a lead has configured."""

    runs: bool
    followed: bool


@dataclass(frozen=True, slots=True)
class LedShow:
    """The lead's show as of one message. Times are those of the own loop."""

    made_s: float  # when
    hash: str = ""  # empty: none is selected
    clock_s: float = 0.0  # the show's time then
    runs: bool = False
    started: bool = False
    pace: DrawnPace = DrawnPace()
    tempo: Tempo = Tempo()
    begun: bool = False
    begin: BeginView | None = None  # how it waited then; None: it begins as soon as it can
    begins_s: float | None = None  # when it will begin; None: not known
    outside: LedClock | None = None  # None: the lead has none

    @property
    def rate(self) -> float:
        """How fast its clock runs, while it runs."""
        return self.tempo.rate * self.pace.rate

    def show_s(self, now_s: float) -> float:
        """The show's time now."""
        return self.clock_s + (self.rate * max(now_s - self.made_s, 0.0) if self.runs else 0.0)


class ShowTraffic:
    """What of the show crosses the bus: the lead sends it, the others take it."""

    def __init__(
        self, show: ShowState, outside_clock: ExternalClock, site: Site, ids: tuple[VehicleId, ...]
    ) -> None:
        """`ids`: all vehicles of the site, in the order of its file."""
        self._show, self._outside_clock, self._site, self._ids = show, outside_clock, site, ids
        self._row_of = {name: row for row, name in enumerate(ids)}
        self.led: LedShow | None = None  # None: not known
        self._parts: tuple[str, dict[VehicleId, int]] = ("", {})  # of the show with this hash
        self._sent_parts: Mapping[VehicleId, int] | None = None
        self._due_s = self._parts_due_s = -inf
        self._led_by_a_clock = False  # a show or an external clock, when the newest message was sent
        self.begins_s: Callable[[float], float | None] = lambda _: None  # when the lead's show begins

    def parts_of(self, show_hash: str, count: int) -> dict[VehicleId, int]:
        """Which vehicle flies which of the `count` parts of this show; empty: not known yet."""
        of_hash, parts = self._parts
        return parts if of_hash == show_hash and max(parts.values(), default=0) < count else {}

    def take(self, sender: str, topic: str, payload: bytes, arrived_s: float) -> None:
        """Note a message of the lead; those of other stations are ignored. Raises: LinkError."""
        lead, number = self._site.lead, self._site.names.index(sender)
        try:
            read = from_json(payload)
            if lead.leads or not lead.obeys(int(read["term"]), number):
                return
            if topic == PARTS:
                self._take_parts(read)
            else:
                led = _led_show(read["show"], arrived_s - self._site.delays.one_way_s(number))
                self.led = replace(led, outside=_clock(read["outside"]))
        except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError):
            raise LinkError("a show that cannot be read") from None
        if self.led is not None and not self.led.started:
            self._parts = "", {}

    def _take_parts(self, read: Mapping[str, Any]) -> None:
        rows, parts = [int(row) for row in read["rows"]], [int(part) for part in read["parts"]]
        if min(rows, default=0) < 0 or min(parts, default=0) < 0:
            raise ValueError("a row or a part below 0")
        part_of = {self._ids[row]: part for row, part in zip(rows, parts, strict=True)}
        self._parts = str(read["hash"])[:64], part_of

    def messages(self, now_s: float) -> Iterator[tuple[str, bytes]]:
        """Topics and payloads that the lead sends after its tick."""
        show_run, term = self._show.run, self._site.lead.term
        outside = self._outside_clock
        flies = self._show.phase not in ON_THE_GROUND
        led_by_a_clock = show_run is not None or outside.configured
        if now_s >= self._due_s or (flies and (led_by_a_clock or self._led_by_a_clock)):
            self._due_s, self._led_by_a_clock = now_s + SLOWLY_S, led_by_a_clock
            about = None if show_run is None else _shown(show_run, now_s, self.begins_s(now_s))
            led = [outside.runs(now_s), outside.followed] if outside.configured else None
            yield SHOW, json.dumps({"term": term, "show": about, "outside": led}).encode()
        if show_run is None or not show_run.started:
            self._sent_parts = None
        elif now_s >= self._parts_due_s or show_run.parts is not self._sent_parts:
            self._sent_parts, self._parts_due_s = show_run.parts, now_s + SLOWLY_S
            rows = [self._row_of[name] for name in show_run.parts]
            parts = {"rows": rows, "parts": list(show_run.parts.values())}
            yield PARTS, json.dumps({"term": term, "hash": show_run.hash, **parts}).encode()


def _shown(show_run: ShowRun, now_s: float, begins_s: float | None) -> dict[str, Any]:
    clock, pace, tempo, begin = show_run.clock, show_run.pace, show_run.tempo, show_run.begin
    drawn = show_run.goals is not None
    return {
        "hash": show_run.hash,
        "clock_s": clock.show_s(now_s),
        "runs": clock.runs,
        "started": show_run.started,
        "pace": [pace.approaches, pace.rate, pace.rate_per_s] if drawn else [False, 1.0, 0.0],
        "tempo": [tempo.rate, tempo.rate_per_s],
        "begun": show_run.begun,
        "begin": None if begin is None else [begin.state.value, begin.at_unix_time_s, begin.in_s],
        "begins_in_s": None if begins_s is None else begins_s - now_s,
    }


def _led_show(read: Mapping[str, Any] | None, made_s: float) -> LedShow:
    """Read the lead's show. Raises: KeyError, TypeError or ValueError."""
    if read is None:
        return LedShow(made_s)
    approaches, *pace = read["pace"]
    tempo = read["tempo"]
    (pace_rate, pace_change), (rate, change) = map(_rates, (pace, tempo))
    begins_in_s = _finite(read["begins_in_s"])
    return LedShow(
        made_s,
        str(read["hash"])[:64],
        float(_finite(read["clock_s"]) or 0.0),
        bool(read["runs"]),
        bool(read["started"]),
        DrawnPace(bool(approaches), pace_rate, pace_change),
        Tempo(rate, change),
        bool(read["begun"]),
        _begin(read["begin"]),
        None if begins_in_s is None else made_s + begins_in_s,
    )


def _clock(read: Any) -> LedClock | None:
    """Raises: ValueError, TypeError."""
    if read is None:
        return None
    runs, followed = read
    return LedClock(bool(runs), bool(followed))


def _begin(read: Any) -> BeginView | None:
    """How a show waits for its beginning. Raises: ValueError, TypeError."""
    if read is None:
        return None
    state, at_unix_s, in_s = read
    return BeginView(BeginState(state), _finite(at_unix_s), _finite(in_s))


def _finite(read: Any) -> float | None:
    """A number, or None. Raises: ValueError, TypeError."""
    if read is None:
        return None
    number = float(read)
    if not isfinite(number):
        raise ValueError("a number that is not finite")
    return number


def _rates(read: Any) -> tuple[float, float]:
    """A rate and its change per s. Raises: ValueError, TypeError."""
    rate, change_per_s = map(float, read)
    if not (0.0 <= rate <= RATE_MAX and abs(change_per_s) <= RATE_MAX):
        raise ValueError("a rate beyond its limits")
    return rate, change_per_s


def keep_clock(show_run: ShowRun, led: LedShow, now_s: float, began_s: float = -inf) -> None:
    """Have clock, pace and tempo of a station's show be those of the lead's; once a tick.

    `began_s`: when the show began here, if it did together with the lead.
    """
    show_run.started, show_run.pace, show_run.tempo = led.started, led.pace, led.tempo
    if not led.runs:
        if led.made_s > began_s + BEGUN_S:
            show_run.clock = ShowClock(led.clock_s)
        return
    since_s, led_s = show_run.clock.since_s, led.show_s(now_s)
    own_s = led_s
    if since_s is not None:
        own_s = show_run.clock.begins_s + led.rate * (now_s - since_s)
    off_s = led_s - own_s
    own_s += off_s if abs(off_s) > JUMPS_S else SHARE * off_s
    show_run.clock = ShowClock(own_s, now_s)
