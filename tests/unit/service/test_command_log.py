"""Accepted commands, and their outcomes."""

import time

import pytest

from gcs.model.errors import UnknownError
from gcs.service import CALLER, CommandRecord, Outcome, VehicleOutcome
from gcs.service.commands import KEPT, CommandLog


def test_command_begins_pending_and_names_excluded_vehicles() -> None:
    began_s = time.time()
    record = CommandLog().open("start", ["d1", "d2"], {"d3": "offline: not received yet"})
    assert record.action == "start"
    assert record.outcomes == {
        "d1": VehicleOutcome(Outcome.PENDING),
        "d2": VehicleOutcome(Outcome.PENDING),
        "d3": VehicleOutcome(Outcome.NOT_INCLUDED, "offline: not received yet"),
    }
    assert began_s <= record.accepted_unix_time_s <= time.time()


def test_command_keeps_its_operator_to_the_end() -> None:
    book = CommandLog()
    by_itself = book.open("stop", ["d1"], {})
    who = CALLER.set("anna")
    try:
        record = book.open("hold", ["d1"], {})
    finally:
        CALLER.reset(who)
    book.close(record.id, "d1", Outcome.DONE)
    assert (by_itself.by, book.get(record.id).by) == ("service", "anna")
    assert [each.id for each in book.newest()] == [record.id, by_itself.id]


def test_command_ids_are_unique() -> None:
    book = CommandLog()
    assert len({book.open("hold", ["d1"], {}).id for _ in range(100)}) == 100


def test_record_is_a_snapshot_and_the_log_has_the_newest() -> None:
    book = CommandLog()
    before = book.open("hold", ["d1"], {})
    book.close(before.id, "d1", Outcome.DONE)
    assert before.outcomes["d1"].outcome is Outcome.PENDING
    assert book.get(before.id).outcomes["d1"].outcome is Outcome.DONE
    assert book.get(before.id).accepted_unix_time_s == before.accepted_unix_time_s


def test_outcome_is_recorded_once() -> None:
    book = CommandLog()
    record = book.open("land", ["d1"], {"d2": "not chosen"})
    book.close(record.id, "d1", Outcome.FAILED, "replaced by another command")
    book.close(record.id, "d1", Outcome.DONE)
    book.close(record.id, "d2", Outcome.DONE)
    assert book.get(record.id).outcomes == {
        "d1": VehicleOutcome(Outcome.FAILED, "replaced by another command"),
        "d2": VehicleOutcome(Outcome.NOT_INCLUDED, "not chosen"),
    }


@pytest.mark.parametrize(
    ("parts", "whole"),
    [
        ([Outcome.DONE, Outcome.PENDING, Outcome.FAILED], Outcome.PENDING),
        ([Outcome.DONE, Outcome.FAILED, Outcome.NOT_INCLUDED], Outcome.FAILED),
        ([Outcome.DONE, Outcome.NOT_INCLUDED], Outcome.DONE),
        ([Outcome.NOT_INCLUDED], Outcome.DONE),
        ([], Outcome.DONE),
    ],
)
def test_command_is_pending_then_failed_if_any_failed_else_done(parts: list[Outcome], whole: Outcome) -> None:
    outcomes = {f"d{place}": VehicleOutcome(part) for place, part in enumerate(parts)}
    assert CommandRecord("o1", "start", 0.0, outcomes, "crew").outcome is whole


def test_only_the_latest_commands_are_kept() -> None:
    book = CommandLog()
    records = [book.open("hold", ["d1"], {}) for _ in range(KEPT + 3)]
    for forgotten in records[:3]:
        with pytest.raises(UnknownError, match=f"there is no command {forgotten.id}$"):
            book.get(forgotten.id)
    assert book.get(records[3].id) == records[3]
    assert book.get(records[-1].id) == records[-1]


def test_outcome_of_a_forgotten_command_is_dropped() -> None:
    book = CommandLog()
    first = book.open("hold", ["d1"], {})
    for _ in range(KEPT):
        book.open("hold", ["d1"], {})
    book.close(first.id, "d1", Outcome.DONE)
    with pytest.raises(UnknownError):
        book.get(first.id)


def test_command_never_given_is_unknown() -> None:
    with pytest.raises(UnknownError, match="there is no command o1"):
        CommandLog().get("o1")
