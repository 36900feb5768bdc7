"""What people have said before a start, for displays and records: proposal, checklists, weather."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Annotated

from pydantic import Field

from gcs.model.settings import PUBLISHED
from gcs.service.feature_view import Described, FeatureView, Line


@dataclass(frozen=True, slots=True)
class ProposedStart:
    """A start that waits for the confirmation of another token."""

    __pydantic_config__ = PUBLISHED

    command_id: Annotated[str, Field(description="Of the start, pending until it is confirmed.")]
    by: Annotated[str, Field(description="Name of the token that proposed it.")]
    hash: Annotated[str, Field(description="Of everything in `hashes`; the confirmation names it.")]
    until_unix_time_s: Annotated[float, Field(description="A later confirmation is refused.")]
    vehicles: Annotated[int, Field(description="That take off.")]
    at_unix_time_s: Annotated[float | None, Field(description="When they do; null: once it is confirmed.")]


@dataclass(frozen=True, slots=True)
class ChecklistItem:
    """One line of a checklist."""

    __pydantic_config__ = PUBLISHED

    text: str
    by: Annotated[str, Field(description="Name of the token that signed it; empty: it is open.")] = ""
    unix_time_s: Annotated[float | None, Field(description="When; null: it is open.")] = None


@dataclass(frozen=True, slots=True)
class Checklist:
    """The checklist of one role; an item's number is its place, from 1."""

    __pydantic_config__ = PUBLISHED

    role: Annotated[str, Field(examples=["pads"])]
    items: tuple[ChecklistItem, ...]

    @property
    def open(self) -> tuple[int, ...]:
        """Numbers of the items that are not signed."""
        return tuple(number for number, item in enumerate(self.items, 1) if not item.by)


@dataclass(frozen=True, slots=True)
class WeatherEntry:
    """The weather as somebody entered it; null: not known."""

    __pydantic_config__ = PUBLISHED

    wind_m_s: float | None = None
    gust_m_s: float | None = None
    visibility_m: float | None = None
    kp: Annotated[float | None, Field(description="Planetary index of geomagnetic activity, 0 to 9.")] = None
    by: Annotated[str, Field(description="Name of the token that entered it.")] = ""
    unix_time_s: float = 0.0

    @property
    def in_words(self) -> str:
        """What is known, with units."""
        values = {
            "wind": (self.wind_m_s, " m/s"),
            "gusts": (self.gust_m_s, " m/s"),
            "visibility": (self.visibility_m, " m"),
            "Kp": (self.kp, ""),
        }
        return ", ".join(
            f"{name} {value:g}{unit}" for name, (value, unit) in values.items() if value is not None
        )


def _at(unix_time_s: float | None) -> str:
    return "?" if unix_time_s is None else f"{datetime.fromtimestamp(unix_time_s, UTC):%Y-%m-%d %H:%M:%S} UTC"


@dataclass(frozen=True, slots=True)
class StartMade:
    """A start that was made: by whom, and what was signed and entered then."""

    __pydantic_config__ = PUBLISHED

    command_id: str
    unix_time_s: Annotated[float, Field(description="When the first vehicle was to take off.")]
    proposed_by: Annotated[str, Field(description="Name of the token that proposed it, or started alone.")]
    confirmed_by: Annotated[str, Field(description="Of the other token; empty: one person starts.")]
    hash: Annotated[str, Field(description="As it was confirmed; empty: it was not, or at another station.")]
    checklists: Annotated[
        tuple[Checklist, ...], Field(description="As signed; empty: none, or kept at another station.")
    ] = ()
    weather: WeatherEntry | None = None

    @property
    def lines(self) -> Iterator[str]:
        """All of it, in words."""
        when = f"start {self.command_id} at {_at(self.unix_time_s)}"
        if self.confirmed_by:
            named = f"proposed by {self.proposed_by}, confirmed by {self.confirmed_by}"
            yield f"{when}: {named}{f', hash {self.hash}' if self.hash else ''}"
        else:
            yield f"{when}: by {self.proposed_by} alone, no second token was needed"
        for each in self.checklists:
            for item in each.items:
                signed = f"signed by {item.by} at {_at(item.unix_time_s)}" if item.by else "OPEN"
                yield f"checklist {each.role}: {item.text}: {signed}"
        if (entry := self.weather) is not None:
            yield f"weather: {entry.in_words}, entered by {entry.by} at {_at(entry.unix_time_s)}"


@dataclass(frozen=True, slots=True)
class GoView(FeatureView):
    """What a start needs of people, and what it has."""

    __pydantic_config__ = PUBLISHED

    confirmed_by_another: Annotated[
        bool, Described("Whether a start is proposed by one token and confirmed by another.", moves=False)
    ]
    within_s: Annotated[float, Described("How long a proposal waits.", moves=False)]
    proposal: Annotated[ProposedStart | None, Described("null: no start is proposed.", moves=False)]
    ended: Annotated[
        str,
        Described("Why the newest proposal is over; empty: none was, or it was confirmed.", moves=False),
        Field(examples=["weather has changed since alice proposed it"]),
    ]
    hashes: Annotated[
        dict[str, str], Described("What a start would be confirmed for now, by name.", moves=False)
    ]
    checklists: Annotated[tuple[Checklist, ...], Described("By role, in the order of the file.", moves=False)]
    weather: Annotated[WeatherEntry | None, Described("The newest entry; null: there is none.", moves=False)]
    missing: Annotated[
        tuple[str, ...],
        Described("What keeps the vehicles on the ground: open items, weather.", moves=False),
        Field(examples=[("checklist pads: 2 of 3 items are open",)]),
    ]
    start: Annotated[
        StartMade | None,
        Described("The newest that was made; null: none since the service began.", moves=False),
    ] = None
    decides: Annotated[
        bool,
        Described("Whether this service decides; false: what another was given counts.", moves=False),
    ] = True

    @staticmethod
    def none() -> "GoView":
        """Of a service whose configuration asks for nothing."""
        return GoView(False, 0.0, None, "", {}, (), None, ())

    def line(self, unix_time_s: float) -> Line:
        if self.proposal is not None:
            left_s = max(0.0, self.proposal.until_unix_time_s - unix_time_s)
            yield f"proposed by {self.proposal.by}, {left_s:.0f} s left: gcs confirm {self.proposal.hash}", ""
        elif self.confirmed_by_another:
            yield "a start needs two tokens", ""
        if self.missing:
            yield f"{', ' if self.confirmed_by_another else ''}NO GO: {'; '.join(self.missing)}", "bad"

    def table(self) -> Iterator[Sequence[str]]:
        yield ("a start needs two tokens" if self.confirmed_by_another else "one person starts",)
        if not self.decides:
            yield ("checklists and weather count where the show is led, not here",)
        if self.proposal is not None:
            start = f"{self.proposal.vehicles} vehicles"
            yield (f"proposed by {self.proposal.by}: {start}, hash {self.proposal.hash}",)
        elif self.ended:
            yield (f"not confirmed: {self.ended}",)
        if self.start is not None:
            yield (next(self.start.lines),)
        for text in self.missing:
            yield (f"NO GO: {text}",)
        if (entry := self.weather) is not None:
            yield (f"weather as {entry.by} entered it: {entry.in_words}",)
        yield "role", "item", "signed by", "text"
        for each in self.checklists:
            for number, item in enumerate(each.items, 1):
                yield each.role, str(number), item.by or "OPEN", item.text
