"""What people say before a start: the second token, signed checklists, the weather that was entered."""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import inf, nan
from types import MappingProxyType
from typing import Final

from gcs.flight.state.feature import Feature, Instant
from gcs.flight.state.flight import Flight
from gcs.links import ParameterValue
from gcs.links.features import GoSettings
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import ON_THE_GROUND
from gcs.model.preflight_report import Check
from gcs.model.state import VehicleId
from gcs.preflight.checklists import SignedFor, read_checklists
from gcs.preflight.go import GoByTwo, digest
from gcs.preflight.weather import check_entry, weather_checks
from gcs.service import CALLER
from gcs.service.go import Checklist, GoView, ProposedStart, StartMade, WeatherEntry

log = logging.getLogger(__name__)

AGAIN_S: Final = 1.0
"""Interval between two looks at what signatures and proposals are given for, on the ground."""

NOT_ASKED: Final = "this service asks for {what}: {key} is not set in its configuration"


@dataclass(frozen=True, slots=True)
class _Entered:
    """A weather entry, and when it was made by the loop's clock, which is never set."""

    entry: WeatherEntry
    time_s: float


def _signed(lists: Sequence[Checklist]) -> str:
    """Digest of what is asked and what is signed, without the signers and times; empty: there are no lists.

    A signature or an entry made anew calls no start off: how old it may be is for the checks to say.
    """
    listed = [(each.role, [item.text for item in each.items], each.open) for each in lists]
    return digest(listed) if lists else ""


class CrewGo(Feature):
    """Keeps what people have said, on the event loop only. Implements `gcs.service.interface.Go`."""

    name = "go"

    def __init__(
        self,
        settings: GoSettings | None,
        flight: Flight,
        followed: Callable[[], str],
        now_s: Callable[[], float],
        further: Mapping[str, Callable[[], str]] = MappingProxyType({}),
    ) -> None:
        """Reads the checklists. Raises: ConfigError.

        Args:
            settings: None: nothing is asked for.
            flight: what a start is confirmed for.
            followed: name of the target that the plan follows; empty: it follows none.
            now_s: the loop's clock.
            further: hash of what else a start is confirmed for, by name; empty: there is none of it.
        """
        self._settings = settings
        self._flight = flight
        self._followed = followed
        self._now_s = now_s
        self._further = dict(further)
        given = settings or GoSettings()
        self._checklists = read_checklists(given.checklists)
        self._entered: _Entered | None = None
        self._read: dict[VehicleId, tuple[Mapping[str, ParameterValue], str]] = {}
        self._flew = False
        self._due_s = 0.0
        self._common: dict[str, str] = {}  # of the newest look
        self._view: GoView | None = None
        self._start: StartMade | None = None  # the newest
        self.two: GoByTwo | None = GoByTwo(given.within_s) if given.confirmed_by_another else None
        self.proposed: ProposedStart | None = None  # for displays, while `two` has a proposal

    # what a start is confirmed for

    def hashes(self) -> dict[str, str]:
        """Digest of each thing that a start is confirmed for, by name; what there is none of is absent."""
        entry = None if self._entered is None else replace(self._entered.entry, by="", unix_time_s=0.0)
        parts = {
            "show": self._show(),
            "parameters": digest(self._parameters()) if self._flight.parameters else "",
            "weather": "" if entry is None else digest(asdict(entry)),
            "checklists": _signed(self._checklists.view()),
            **{name: value() for name, value in self._further.items()},
        }
        return {name: value for name, value in parts.items() if value}

    def _show(self) -> str:
        """Of the selected show with its place to begin and operators' obstacles, else of the plan."""
        plan, show_run = self._flight.in_force.plan, self._flight.show.run
        if show_run is not None:
            own = [asdict(box) for box in plan.obstacles if box.id not in show_run.obstacle_ids]
            return digest([show_run.hash, show_run.cue(self._flight.newest.state.time_s), own])
        target = self._followed() or asdict(plan.target)
        return digest(asdict(plan) | {"target": target})

    def _parameters(self) -> dict[VehicleId, str]:
        """Digest of the parameters of each vehicle, as read."""
        for name, values in self._flight.parameters.items():
            before = self._read.get(name)
            if before is None or before[0] is not values:
                self._read[name] = values, digest(dict(values))
        return {name: self._read[name][1] for name in self._flight.parameters}

    # commands

    def sign(self, role: str, items: Sequence[int]) -> GoView:
        self._need_checklists()
        by, unix_s = CALLER.get(), self._flight.unix_s()
        self._look()  # what has changed opens items first
        self._checklists.sign(role, items, by, unix_s)
        log.info("checklist_signed", extra={"role": role, "items": [*items], "by": by})
        return self._noted("sign")

    def reopen(self, role: str, items: Sequence[int]) -> GoView:
        self._need_checklists()
        self._checklists.reopen(role, items)
        log.info("checklist_reopened", extra={"role": role, "items": [*items], "by": CALLER.get()})
        return self._noted("reopen")

    def enter_weather(self, entry: WeatherEntry) -> GoView:
        if self._settings is None:
            raise RefusedError(NOT_ASKED.format(what="no weather", key="go"))
        check_entry(entry)
        entry = replace(entry, by=CALLER.get(), unix_time_s=self._flight.unix_s())
        self._entered = _Entered(entry, self._now_s())
        given = {name: value for name, value in asdict(entry).items() if value is not None}
        log.info("weather_entered", extra={"weather": given, "by": entry.by})
        return self._noted("weather")

    def _need_checklists(self) -> None:
        if self._settings is None or self._settings.checklists is None:
            raise RefusedError(NOT_ASKED.format(what="no checklists", key="go.checklists"))

    def _noted(self, action: str) -> GoView:
        self._flight.book.open(action, [], {})
        self._look()
        return self._view or GoView.none()

    # as a feature

    def lead(self, at: Instant) -> None:
        """Note landings, and once a second what has changed on the ground."""
        if self._settings is None:
            return
        on_ground = at.show in ON_THE_GROUND
        if self._flew and on_ground and (count := self._checklists.note_landing()):
            log.info("checklists_open", extra={"count": count, "reason": "the flight is over"})
        self._flew = not on_ground
        if on_ground and self._now_s() >= self._due_s:
            self._look()

    def _look(self) -> None:
        """Open items that are not true any more, and compose the view."""
        self._due_s = self._now_s() + AGAIN_S
        self._note_seen()
        self._common = self.hashes()
        self._view = self._composed()

    def _note_seen(self) -> None:
        show_run = self._flight.show.run
        seen = SignedFor("" if show_run is None else show_run.hash, self._parameters())
        if count := self._checklists.note(seen):
            log.info("checklists_open", extra={"count": count, "reason": "show or parameters changed"})

    def note_start(self, command_id: str, proposed_by: str, confirmed_by: str, go_hash: str) -> None:
        """Keep the names of a start that is made, with what was signed and entered where it leads."""
        if self._settings is None:
            return
        leads, entered = self._flight.elsewhere.shows.leads, self._entered
        self._start = StartMade(
            command_id,
            self._flight.unix_s(),
            proposed_by,
            confirmed_by,
            go_hash,
            self.checklists if leads else (),
            None if entered is None or not leads else entered.entry,
        )
        self.refresh()

    def refresh(self) -> None:
        """Compose the view anew: the proposal has changed."""
        if self._settings is not None:
            self._view = self._composed()

    def _composed(self) -> GoView:
        two, settings = self.two, self._settings or GoSettings()
        waits, decides = None if two is None else two.proposal, self._flight.elsewhere.shows.leads
        checks = self._checks() if decides else ()
        return GoView(
            confirmed_by_another=settings.confirmed_by_another,
            within_s=settings.within_s,
            proposal=None if waits is None else self.proposed,
            ended="" if two is None else two.ended,
            hashes=self._common if waits is None else dict(waits.parts),
            checklists=self.checklists,
            weather=None if self._entered is None else self._entered.entry,
            missing=tuple(check.problem for check in checks if not check.passes),
            start=self._start,
            decides=decides,
        )

    @property
    def missing(self) -> tuple[str, ...]:
        """What a start needs of people and has not, as of the newest look."""
        return () if self._view is None else self._view.missing

    @property
    def wind_limits(self) -> tuple[float, float]:
        """Most wind and most gusts in which vehicles may start, in m/s; inf: not asked for."""
        limits = (self._settings or GoSettings()).weather
        return limits.wind_max_m_s or inf, limits.gust_max_m_s or inf

    @property
    def wind(self) -> tuple[float, str]:
        """The wind of the newest entry, in m/s, and the token that made it; NaN: none was entered."""
        entry = None if self._entered is None else self._entered.entry
        return (nan, "") if entry is None or entry.wind_m_s is None else (entry.wind_m_s, entry.by)

    @property
    def checklists(self) -> tuple[Checklist, ...]:
        return self._checklists.view()

    def checks(self, at: Instant) -> Iterator[Check]:
        """Open items and the weather, where this station decides on a start."""
        if self._settings is not None and at.show in ON_THE_GROUND and self._flight.elsewhere.shows.leads:
            self._note_seen()  # a start may come before the next look
            yield from self._checks()

    def _checks(self) -> Iterator[Check]:
        if self._settings is None:
            return
        entered, now_s = self._entered, self._now_s()
        yield from self._checklists.checks()
        entry, age_s = (None, 0.0) if entered is None else (entered.entry, now_s - entered.time_s)
        yield from weather_checks(self._settings.weather, entry, age_s)

    def view(self, at: Instant) -> GoView | None:  # noqa: ARG002
        return self._view
