"""What alarms may never do, whatever happens."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gcs.service.alarm_book import AlarmBook, ChangeKind
from gcs.service.alarms import (
    CAUSES,
    RANK,
    AlarmCause,
    Condition,
    Limit,
    beyond,
    overall,
)

LOOKS_S = 0.2

CONDITIONS = st.builds(
    Condition,
    st.sampled_from([*AlarmCause]),
    st.sampled_from(["a", "b 1", "b 2"]),
    st.lists(st.sampled_from(["d1", "d2", "d3"]), unique=True).map(tuple),
    about=st.sampled_from(["", "x"]),
)
LOOKS = st.lists(st.lists(CONDITIONS, max_size=6), min_size=1, max_size=30)


@given(
    limit=st.sampled_from([Limit(on=3.0, off=3.15), Limit(on=0.2, off=0.23), Limit(on=50.0, off=45.0)]),
    shares=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=100),
)
def test_oscillating_value_raises_at_most_one_alarm(limit: Limit, shares: list[float]) -> None:
    book, before = AlarmBook(), np.array([False])
    worst = limit.on + 0.5 * (limit.on - limit.off)
    begun = 0
    for look, share in enumerate(shares):
        value = worst + share * 0.999 * (limit.off - worst)  # never clearly back
        before = beyond(before, np.array([value]), limit)
        holds = [Condition(AlarmCause.TOO_CLOSE, f"{value:.1f} m apart", ("d1", "d2"))] if before[0] else []
        changes = book.look(holds, look * LOOKS_S, look * LOOKS_S)
        begun += sum(change.kind is ChangeKind.BEGUN for change in changes)
    assert begun == before[0]


@given(st.lists(st.booleans(), min_size=1, max_size=200))
def test_flicker_faster_than_the_delay_is_one_alarm(holds: list[bool]) -> None:
    book, begun, gone_s = AlarmBook(), 0, 0.0
    condition = Condition(AlarmCause.LOW_BATTERY, "battery at 20%", ("d1",))
    off_after_s = CAUSES[AlarmCause.LOW_BATTERY].off_after_s
    for look, does in enumerate(holds):
        gone_s = 0.0 if does else gone_s + LOOKS_S
        held = [condition] if does or gone_s < off_after_s - LOOKS_S else []
        now_s = look * LOOKS_S
        begun += sum(change.kind is ChangeKind.BEGUN for change in book.look(held, now_s, now_s))
        if gone_s >= off_after_s - LOOKS_S:
            break
    assert begun <= 1


@given(LOOKS)
def test_cause_without_delay_and_its_vehicles_are_never_missing(looks: list[list[Condition]]) -> None:
    book = AlarmBook()
    for look, conditions in enumerate(looks):
        book.look(conditions, look * LOOKS_S, look * LOOKS_S)
        for condition in conditions:
            if CAUSES[condition.cause].on_after_s:
                continue
            listed = [alarm for alarm in book.alarms if alarm.lasts and alarm.cause is condition.cause]
            assert any(set(condition.vehicles) <= set(alarm.vehicles) for alarm in listed)
            severity = condition.severity or CAUSES[condition.cause].severity
            assert min(RANK[alarm.severity] for alarm in listed) <= RANK[severity]


@given(LOOKS)
def test_lasting_most_severe_alarm_is_first_and_sets_the_state(
    looks: list[list[Condition]],
) -> None:
    book = AlarmBook()
    for look, conditions in enumerate(looks):
        book.look(conditions, look * LOOKS_S, look * LOOKS_S)
        order = [(not alarm.lasts, RANK[alarm.severity], -alarm.raised_unix_time_s) for alarm in book.alarms]
        assert order == sorted(order)
        lasting = [alarm for alarm in book.alarms if alarm.lasts]
        if lasting:
            assert overall(book.alarms).value == book.alarms[0].severity.value
        assert len({alarm.id for alarm in book.alarms}) == len(book.alarms)


@given(LOOKS)
def test_every_alarm_ends_once_when_its_cause_is_gone(looks: list[list[Condition]]) -> None:
    book, begun, ended = AlarmBook(), [], []
    for look, conditions in enumerate([*looks, *([[]] * 30)]):
        for change in book.look(conditions, look * LOOKS_S, look * LOOKS_S):
            if change.kind is ChangeKind.BEGUN:
                begun.append(change.alarm.id)
            elif change.kind is ChangeKind.ENDED:
                ended.append(change.alarm.id)
    assert sorted(begun) == sorted(ended)
    assert not any(alarm.lasts for alarm in book.alarms)
    for alarm in book.alarms:
        book.acknowledge(alarm.id, "anna", 0.0)
    assert book.alarms == ()
