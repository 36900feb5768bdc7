"""Commands that stations execute for each other: requests, and the outcomes that come back to the caller."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from gcs.model.errors import LinkError, UnknownError
from gcs.model.state import VehicleId
from gcs.service import CommandRecord, Outcome, VehicleOutcome
from gcs.service.commands import CommandLog
from gcs.site.member import SiteMember
from gcs.site.requests import REQUEST, Outcomes, Request

log = logging.getLogger(__name__)

ANSWERED_WITHIN_S: Final = 5.0
"""A station that has not answered a request by then is taken for one that has not received it."""

BRIEF: Final = 12
"""Characters of each reason, where all reasons do not fit into one message."""

REPORTED_EVERY_S: Final = 0.1


@dataclass(slots=True)
class _Requested:
    """A command of this station that other stations execute as well."""

    record_id: str
    asked_s: float
    open: dict[str, set[VehicleId]] = field(default_factory=dict)  # by stations that have not finished it
    answered: set[str] = field(default_factory=set)  # of these, stations that have begun it


@dataclass(slots=True)
class _Executed:
    """A command that another station asked for."""

    record: CommandRecord
    station: str
    ref: str
    reported: dict[VehicleId, VehicleOutcome] = field(default_factory=dict)


class SiteRouting:
    """What this station asked of others, and what others asked of it. Used on the event loop only."""

    def __init__(self, member: SiteMember, book: CommandLog) -> None:
        self._member, self._book = member, book
        self._asked: dict[str, _Requested] = {}  # by record id
        self._executed: list[_Executed] = []
        self._report_due_s = 0.0

    def ask(
        self, record: CommandRecord, station: str, request: Request, ids: Sequence[VehicleId]
    ) -> CommandRecord:
        """Have a station execute its part; its vehicles are pending until it answers."""
        book = self._book
        missing = f"station {station} is not received"
        if station in self._member.present():
            try:
                self._member.post(station, REQUEST.dump_python(request, mode="json"))
                missing = ""
            except LinkError as error:  # the own part and the other stations' are executed all the same
                missing = f"station {station}: {error}"
        if missing:
            return book.include(record.id, {name: VehicleOutcome(Outcome.FAILED, missing) for name in ids})
        now_s = self._member.flight.newest.state.time_s
        asked = self._asked.setdefault(record.id, _Requested(record.id, now_s))
        asked.open[station] = set(ids)
        return book.include(record.id, {name: VehicleOutcome(Outcome.PENDING) for name in ids})

    def note_executed(self, record: CommandRecord, station: str, ref: str) -> None:
        """Report how this command goes on to the station that asked for it."""
        self._executed.append(_Executed(record, station, ref))

    def advance(self, now_s: float) -> None:
        """Report what has changed, and close what is not answered; called once a tick."""
        if now_s >= self._report_due_s:
            self._report_due_s = now_s + REPORTED_EVERY_S
            self._report()
            self._expire(now_s)

    def answer(self, station: str, outcomes: Outcomes) -> None:
        try:
            self._member.post(station, REQUEST.dump_python(outcomes, mode="json"))
        except LinkError:  # too long, with all reasons
            brief = {name: (outcome, why[:BRIEF]) for name, (outcome, why) in outcomes.outcomes.items()}
            try:
                self._member.post(
                    station, REQUEST.dump_python(replace(outcomes, outcomes=brief), mode="json")
                )
            except LinkError as error:
                log.warning("not_answered", extra={"other": station, "reason": str(error)})

    def _report(self) -> None:
        """Send the outcomes that have changed."""
        going_on = []
        for executed in self._executed:
            try:
                record = self._book.get(executed.record.id)
            except UnknownError:
                continue
            if record.outcomes != executed.reported or not record.outcomes:
                executed.reported = dict(record.outcomes)
                outcomes = {name: (each.outcome, each.reason[:200]) for name, each in record.outcomes.items()}
                self.answer(executed.station, Outcomes(executed.ref, outcomes))
            if record.outcome is Outcome.PENDING:
                going_on.append(executed)
        self._executed = going_on

    def take(self, sender: str, reported: Outcomes) -> None:
        asked = self._asked.get(reported.ref)
        if asked is None or sender not in asked.open:
            return
        asked.answered.add(sender)
        book, ids = self._book, set(self._member.site.ids)
        parts = {
            name: VehicleOutcome(outcome, reason)
            for name, (outcome, reason) in reported.outcomes.items()
            if name in ids
        }
        part = asked.open[sender]
        part |= parts.keys()
        over = bool(reported.refused) or all(each.outcome is not Outcome.PENDING for each in parts.values())
        if over:
            del asked.open[sender]
            why = reported.refused or "it did not apply to it"
            outcome = Outcome.FAILED if reported.refused else Outcome.NOT_INCLUDED
            left = VehicleOutcome(outcome, f"station {sender}: {why}")
            pending = book.get(reported.ref).outcomes
            parts |= {name: left for name in part - parts.keys() if pending[name].outcome is Outcome.PENDING}
        book.include(reported.ref, parts)
        if not asked.open:
            del self._asked[reported.ref]

    def _expire(self, now_s: float) -> None:
        """Close the parts of stations that do not answer, or are not received any more."""
        here = set(self._member.present())
        for asked in list(self._asked.values()):
            late = now_s - asked.asked_s > ANSWERED_WITHIN_S
            silent = asked.open.keys() - asked.answered
            for name in [name for name in asked.open if late and (name not in here or name in silent)]:
                part = asked.open.pop(name)
                try:
                    outcomes = self._book.get(asked.record_id).outcomes
                except UnknownError:
                    continue
                why = "does not answer" if name in here else "is not received"
                lost = VehicleOutcome(Outcome.FAILED, f"station {name} {why}")
                pending = [name for name in part if outcomes[name].outcome is Outcome.PENDING]
                self._book.include(asked.record_id, dict.fromkeys(pending, lost))
            if not asked.open:
                self._asked.pop(asked.record_id, None)
