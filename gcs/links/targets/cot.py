"""Reads the fixes of one track out of Cursor on Target: events in XML, as TAK sends them. Pure.

An event ends with `</event>`, in a stream as in a datagram. Expat reads it, without a tree: no document type,
no entity, a bounded size, depth and number of elements. Source: Event-PUBLIC.xsd, version 2.0 of the schema.
"""

import re
from dataclasses import dataclass, field
from math import inf, nan
from typing import Final
from xml.parsers import expat

from gcs.links.targets.numbers import (
    ALTITUDE_M,
    Names,
    deviation,
    utc_s,
    velocity,
    why_nowhere,
    within,
)
from gcs.model.errors import LinkError, cut
from gcs.model.target_fix import TargetFix
from gcs.model.traffic import TrackKind

LONGEST_BYTES: Final = 1 << 16
SHORTEST_BYTES: Final = 60
"""What an event needs for its place alone."""

ELEMENTS_MAX: Final = 1000
DEPTH_MAX: Final = 16
NAMED_S: Final = 60.0
"""A callsign belongs to one uid until that is silent for so long."""

UNKNOWN_M: Final = 999_999.0
"""Heights and errors from here on are not known: 9999999, and 999999 of older senders."""

_BEGIN, _END = b"<event", b"</event>"
_TAG: Final = re.compile(rb"<event(?=[ \t\r\n])|</event>")
_TAK_1: Final = b"\xbf\x01\xbf"
"""How a datagram of TAK's protocol version 1 begins."""


@dataclass(slots=True)
class _Event:
    """The attributes of an event that count, by element."""

    elements: int = 0
    path: list[str] = field(default_factory=list)
    attributes: dict[str, dict[str, str]] = field(default_factory=dict)

    def begin(self, name: str, attributes: dict[str, str]) -> None:
        self.elements += 1
        self.path.append(name)
        if self.elements > ELEMENTS_MAX or len(self.path) > DEPTH_MAX:
            raise LinkError(f"an event of more than {ELEMENTS_MAX} elements, or {DEPTH_MAX} levels")
        place = "/".join(self.path)
        if place in {"event", "event/point", "event/detail/contact", "event/detail/track"}:
            self.attributes.setdefault(place.rpartition("/")[2], attributes)

    def end(self, _: str) -> None:
        self.path.pop()

    def of(self, element: str, name: str) -> str:
        return self.attributes.get(element, {}).get(name, "")


class CotStream:
    """Fixes of the track that has this uid or callsign.

    Attributes:
        messages: events so far.
        why: why the newest bytes brought no fix; empty: they did, or it has sent before.
    """

    def __init__(self, track: str, geoid_m: float | None = None, own_uid: str = "") -> None:
        """Events with a uid that begins with `own_uid` do not count; empty: all do."""
        self.messages = 0
        self.why = ""
        self._own = own_uid.encode()
        self._track, self._geoid_m = track, nan if geoid_m is None else geoid_m
        self._others = Names()
        self._uid, self._named_s = "", -inf  # the track's, and when it sent last
        self._waiting = bytearray()
        self._begin, self._searched = -1, 0  # the newest event's; up to where tags were looked for

    def take(self, data: bytes, now_s: float) -> list[TargetFix]:
        """The fixes that `data` completes. Never raises."""
        self.why = ""
        self._waiting += data
        waiting, fixes, at = bytes(self._waiting), [], 0
        for tag in _TAG.finditer(waiting, self._searched):
            if tag[0] == _BEGIN:  # one that was cut off spoils no other
                self._begin = tag.start()
                continue
            at = tag.end()
            if self._begin >= 0 and SHORTEST_BYTES <= at - self._begin <= LONGEST_BYTES:
                fixes += self._take(waiting[self._begin : at], now_s)
            self._begin = -1
        self._searched = max(at, len(waiting) - len(_END) + 1)
        self._forget()
        return fixes

    def _forget(self) -> None:
        """Drop what cannot become an event."""
        if len(self._waiting) - self._begin > LONGEST_BYTES and self._begin >= 0:
            self.why = f"an event of more than {LONGEST_BYTES} bytes"
            self._begin = -1
        if self._begin < 0 and _TAK_1 in self._waiting:
            self.why = "TAK protocol version 1 is not read: its sender has to send XML, version 0"
        done = self._begin if self._begin >= 0 else self._searched
        del self._waiting[:done]
        self._begin = min(self._begin, 0)
        self._searched -= done

    def _take(self, data: bytes, now_s: float) -> list[TargetFix]:
        if self._own and self._own in data[: data.find(b">")]:  # before the cost of reading it
            self.messages += 1
            self._see("this show's own tracks")
            return []
        try:
            event = _read(data)
        except LinkError as error:
            self.why = str(error)
            return []
        self.messages += 1
        if not event.of("event", "type").startswith("a-"):  # chat, pings, drawings
            return []
        return self._of_event(event, now_s)

    def _of_event(self, event: _Event, now_s: float) -> list[TargetFix]:
        uid, callsign = event.of("event", "uid"), event.of("contact", "callsign")
        if self._track not in {uid, callsign}:
            self._see(callsign or uid)
            return []
        if uid not in {self._uid, self._track} and now_s - self._named_s <= NAMED_S:
            self.why = f"{self._track} is the callsign of {cut(self._uid)} and {cut(uid)}: name a uid"
            return []
        self._uid, self._named_s = uid, now_s
        self.why = why_nowhere(event.of("point", "lat"), event.of("point", "lon"))
        return [] if self.why else [self._fix(event, callsign or uid, now_s)]

    def _see(self, name: str) -> None:
        """Note a track beside the selected one, which is named until that one is there."""
        self._others.add(name)
        if self._named_s == -inf:
            self.why = f"unknown track {self._track}, seen: {self._others}"

    def _fix(self, event: _Event, name: str, now_s: float) -> TargetFix:
        north_m_s, east_m_s = velocity(event.of("track", "speed"), event.of("track", "course"))
        return TargetFix(
            now_s,
            within(event.of("point", "lat"), -90.0, 90.0),
            within(event.of("point", "lon"), -180.0, 180.0),
            within(event.of("point", "hae"), *ALTITUDE_M) - self._geoid_m,
            north_m_s,
            east_m_s,
            deviation_m=_error_m(event, "ce"),
            height_deviation_m=_error_m(event, "le"),
            source_s=utc_s(event.of("event", "time")),
            track=cut(name),
            kind=_kind(event.of("event", "type")),
        )


class CotTraffic(CotStream):
    """Fixes of all tracks, each by its uid."""

    def __init__(self, geoid_m: float | None = None, own_uid: str = "") -> None:
        super().__init__("", geoid_m, own_uid)

    def _see(self, name: str) -> None:
        """Every track counts; the own ones are no sign of others, and none that there are none."""

    def _of_event(self, event: _Event, now_s: float) -> list[TargetFix]:
        uid = event.of("event", "uid")
        self.why = why_nowhere(event.of("point", "lat"), event.of("point", "lon"))
        return [self._fix(event, uid, now_s)] if uid and not self.why else []


def _kind(type_of_event: str) -> TrackKind:
    """By the battle dimension, as in `a-f-A-M-F-Q`; drones are aircraft with the function Q."""
    parts = type_of_event.split("-")
    dimension = parts[2] if len(parts) > 2 else ""
    if dimension == "A":
        return "unmanned" if "Q" in parts[3:] else "manned"
    return {"S": "vessel", "U": "vessel", "G": "ground"}.get(dimension, "manned")  # type: ignore[return-value]


def _error_m(event: _Event, name: str) -> float:
    """By the schema one sigma. TAK's own programs call it 90 %: less than what is used here."""
    return deviation(within(event.of("point", name), 0.0, UNKNOWN_M - 1.0))


def _read(data: bytes) -> _Event:
    """Raises: LinkError with why it is no event."""
    if b"<!" in data:
        raise LinkError("an event with a document type, an entity or a comment is not read")
    event, parser = _Event(), expat.ParserCreate("UTF-8")
    parser.StartElementHandler, parser.EndElementHandler = event.begin, event.end
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise LinkError(f"an event cannot be read: {error}") from None
    return event
