import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.failsafe.autopilot_failsafe import ADVICE_TO_MANY
from gcs.flight.monitors.space_alarms import ClosePairs
from gcs.model.errors import UnknownError
from gcs.safety.floor import Floor
from gcs.service.alarm_book import KEPT_UNTIL_ACKNOWLEDGED, AlarmBook, ChangeKind
from gcs.service.alarms import (
    CAUSES,
    Alarm,
    AlarmAction,
    AlarmCause,
    AlarmSeverity,
    Condition,
    Limit,
    OverallSeverity,
    beyond,
    for_number,
    in_the_past,
    overall,
)

UNIX_S = 1.7e9
OPERATIONS = Path(__file__).parents[3] / "docs" / "operations" / "in-flight.md"


def lost(*vehicles: str, seconds: float = 2.0) -> Condition:
    because = f"no telemetry for {seconds:.1f} s"
    return Condition(AlarmCause.VEHICLE_LOST, because, vehicles, "Formation closes the gap.")


def killed(*vehicles: str) -> Condition:
    return Condition(AlarmCause.KILLED, "motors stopped on command by anna", vehicles)


def low(*vehicles: str, share: float = 0.15) -> Condition:
    return Condition(AlarmCause.LOW_BATTERY, f"battery at {share:.0%}, below 20%", vehicles)


NOTE = Condition(AlarmCause.SERVICE_NOTE, "no map")


class Story:
    """A book, and a clock that looks every 0.2 s."""

    def __init__(self) -> None:
        self.book = AlarmBook()
        self.now_s = 100.0
        self.reported: list[tuple[ChangeKind, AlarmCause]] = []

    def holds(self, *conditions: Condition, for_s: float = 0.2) -> tuple[Alarm, ...]:
        """These for so long. Returns: the alarms then."""
        for _ in range(max(1, round(for_s / 0.2))):
            changes = self.book.look(conditions, self.now_s, UNIX_S + self.now_s)
            self.reported += [(change.kind, change.alarm.cause) for change in changes]
            self.now_s += 0.2
        return self.book.alarms

    def count(self, kind: ChangeKind) -> int:
        return sum(each is kind for each, _ in self.reported)


@pytest.fixture
def story() -> Story:
    return Story()


def causes(alarms: Iterable[Alarm]) -> list[str]:
    return [alarm.cause.value for alarm in alarms]


def test_alarm_text_names_cause_then_consequence(story: Story) -> None:
    (alarm,) = story.holds(lost("d3"))
    assert alarm.text == "Vehicle d3 lost: no telemetry for 2.0 s. Formation closes the gap."
    assert alarm.vehicles == ("d3",)
    assert "confirm-down" in alarm.advice


def test_vehicles_with_one_cause_are_one_alarm(story: Story) -> None:
    (alarm,) = story.holds(lost("d3"), lost("d7"), lost("d1", seconds=3.5))
    assert alarm.vehicles == ("d3", "d7", "d1")
    assert alarm.text == (
        "Vehicles d3, d7, d1 lost: d3, d7: no telemetry for 2.0 s; d1: no telemetry for 3.5 s."
        " Formation closes the gap."
    )


def test_alarm_of_many_has_a_count_in_text_and_all_names(story: Story) -> None:
    names = tuple(f"d{number}" for number in range(1, 301))
    (alarm,) = story.holds(lost(*names))
    assert alarm.text.startswith("300 vehicles lost: no telemetry")
    assert alarm.vehicles == names


def test_the_most_severe_come_first_and_of_these_the_newest(story: Story) -> None:
    story.holds(low("d1"))
    story.holds(low("d1"), NOTE)
    story.holds(low("d1"), NOTE, lost("d2"))
    alarms = story.holds(low("d1"), NOTE, lost("d2"), killed("d3"))
    assert causes(alarms) == ["killed", "vehicle-lost", "low-battery", "service-note"]


def test_the_state_of_the_whole_is_the_worst_that_lasts(story: Story) -> None:
    assert overall(story.holds()) is OverallSeverity.NORMAL
    assert overall(story.holds(NOTE, killed("d3"))) is OverallSeverity.EMERGENCY
    after = story.holds(NOTE)
    assert causes(after) == ["service-note", "killed"]  # ended, not acknowledged
    assert overall(after) is OverallSeverity.INFORMATION


def test_acknowledged_alarm_ends_with_its_cause(story: Story) -> None:
    (alarm,) = story.holds(lost("d3"))
    story.book.acknowledge(alarm.id, "anna", UNIX_S)
    (alarm,) = story.holds(lost("d3"), for_s=60.0)
    assert alarm.acknowledged_by == "anna"
    assert story.holds() == ()
    assert story.count(ChangeKind.ENDED) == 1


def test_first_acknowledging_operator_stays_named(story: Story) -> None:
    (alarm,) = story.holds(lost("d3"))
    story.book.acknowledge(alarm.id, "anna", UNIX_S)
    assert story.book.acknowledge(alarm.id, "ben", UNIX_S + 9.0).acknowledged_by == "anna"
    assert [each.acknowledged_by for each in story.book.alarms] == ["anna"]


@pytest.mark.parametrize(
    ("condition", "stays"),
    [(killed("d3"), True), (lost("d3"), True), (NOTE, False)],
    ids=["emergency", "warning", "information"],
)
def test_severe_alarm_that_ended_unseen_stays_listed(story: Story, condition: Condition, stays: bool) -> None:
    story.holds(condition)
    after = story.holds(for_s=3.0)
    assert len(after) == stays
    if stays:
        assert after[0].ended_unix_time_s is not None
        story.book.acknowledge(after[0].id, "anna", UNIX_S)
        assert story.book.alarms == ()


def test_a_further_vehicle_raises_an_acknowledged_alarm_again(story: Story) -> None:
    (first,) = story.holds(lost("d3"))
    story.book.acknowledge(first.id, "anna", UNIX_S)
    (alarm,) = story.holds(lost("d3"), lost("d4"))
    assert alarm.id == first.id
    assert alarm.acknowledged_by is None
    assert alarm.since_unix_time_s == first.since_unix_time_s < alarm.raised_unix_time_s
    assert story.count(ChangeKind.GROWN) == 1


def test_a_cause_that_grows_more_severe_raises_its_alarm_again(story: Story) -> None:
    excluded = Condition(AlarmCause.NOT_FLYING, "excluded by anna", ("d2",))
    left = Condition(AlarmCause.NOT_FLYING, "battery", ("d2",), severity=AlarmSeverity.CAUTION)
    (first,) = story.holds(excluded)
    story.book.acknowledge(first.id, "anna", UNIX_S)
    (alarm,) = story.holds(left)
    assert (alarm.id, alarm.severity, alarm.acknowledged_by) == (first.id, AlarmSeverity.CAUTION, None)


def test_a_cause_that_comes_back_at_once_is_the_same_alarm(story: Story) -> None:
    (first,) = story.holds(low("d1"))
    story.holds(for_s=0.6)
    (alarm,) = story.holds(low("d1"))
    assert alarm.id == first.id
    assert story.count(ChangeKind.BEGUN) == 1
    story.holds(for_s=3.0)
    assert story.holds(low("d1"))[0].id != first.id


def test_changed_numbers_update_the_text_at_intervals(story: Story) -> None:
    texts = {story.holds(low("d1", share=0.19 - step * 0.001))[0].text for step in range(50)}  # 10 s
    assert len(texts) == 2
    assert story.reported == [(ChangeKind.BEGUN, AlarmCause.LOW_BATTERY)]


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("1000 messages a second from 192.0.2.9:4711", "1000 messages a second from 192.0.2.9:4712"),
        ("from 192.0.2.9:4711", "from 192.0.2.8:4711"),
        ("3.1 m from d2 of west", "3.1 m from d7 of west"),
    ],
)
def test_another_address_or_name_is_no_changed_number(story: Story, before: str, after: str) -> None:
    story.holds(Condition(AlarmCause.INPUT_FLOODED, before, about="rtk"))
    (alarm,) = story.holds(Condition(AlarmCause.INPUT_FLOODED, after, about="rtk"))
    assert after in alarm.text


def test_alarm_with_changed_text_is_rewritten_at_once(story: Story) -> None:
    story.holds(Condition(AlarmCause.VEHICLE_LOST, "no telemetry for 2.0 s", ("d3",)))
    (alarm,) = story.holds(lost("d3"))
    assert alarm.text.endswith("Formation closes the gap.")
    assert story.count(ChangeKind.GROWN) == 0


def test_a_cause_with_a_delay_must_hold_for_so_long(story: Story) -> None:
    weak = Condition(AlarmCause.POOR_LINK, "40% of its positions arrive", ("d1",))
    delay_s = CAUSES[AlarmCause.POOR_LINK].on_after_s
    assert delay_s > 1.0
    assert story.holds(weak, for_s=delay_s - 0.4) == ()
    story.holds()
    assert story.holds(weak, for_s=delay_s - 0.4) == ()
    assert story.holds(weak, for_s=0.8) != ()


def test_an_unknown_alarm_is_refused_with_those_that_are_listed(story: Story) -> None:
    (alarm,) = story.holds(lost("d3"))
    with pytest.raises(UnknownError, match=alarm.id):
        story.book.acknowledge("lost-9", "anna", UNIX_S)


def test_a_value_between_the_thresholds_stays_what_it_was() -> None:
    limit = Limit(on=0.7, off=0.85)
    values = np.array([0.69, 0.84, 0.84, 0.86, np.nan])
    before = np.array([False, True, False, True, True])
    assert beyond(before, values, limit).tolist() == [True, True, False, False, False]


def test_pair_at_the_floor_is_one_pair_until_clearly_outside() -> None:
    floor, pairs = Floor(horizontal_m=3.0), ClosePairs()
    airborne = np.array([True, True])

    def rows(apart_m: float, height_m: float = 20.0) -> list[tuple[int, int]]:
        place_m = np.array([[0.0, 0.0, -height_m], [apart_m, 0.0, -height_m]])
        return [(one, other) for one, other, _ in pairs.look(place_m, airborne, floor)]

    seen = [rows(apart_m) for apart_m in (3.01, 2.99, 3.01, 2.99, 3.1, 3.2, 3.01)]
    assert seen == [[], [(0, 1)], [(0, 1)], [(0, 1)], [(0, 1)], [], []]
    assert rows(1.0, height_m=1.0) == []  # on their pads


def test_pair_with_unknown_distance_is_not_close() -> None:
    place_m = np.array([[0.0, 0.0, -20.0], [np.nan, np.nan, np.nan]])
    assert ClosePairs().look(place_m, np.array([True, True]), Floor()) == []


def test_every_cause_is_in_the_table_of_the_operations_manual() -> None:
    row = rf"^\| `([a-z-]+)` \| ({'|'.join(AlarmSeverity)}) \|"
    reported = re.findall(row, OPERATIONS.read_text(), re.MULTILINE)
    assert dict(reported) == {cause.value: row.severity.value for cause, row in CAUSES.items()}


def test_every_cause_has_advice_for_an_operator() -> None:
    assert set(CAUSES) == set(AlarmCause)
    assert all(row.advice.endswith(".") and not row.headline.endswith(".") for row in CAUSES.values())


def test_advice_about_several_vehicles_is_plural() -> None:
    of_one = re.compile(r"\b(it|its)\b", re.IGNORECASE)
    about = {
        cause: for_number(row.advice, many=True)
        for cause, row in CAUSES.items()
        if "{vehicles}" in row.headline
    }
    del about[AlarmCause.PARAMETER_CHANGED]  # there it is the parameter
    about[AlarmCause.POOR_LINK] = about[AlarmCause.POOR_LINK].removesuffix(" if it gets worse.")  # the link
    assert [text for text in about.values() if of_one.search(text)] == []
    assert [text for text in ADVICE_TO_MANY.values() if of_one.search(text)] == []


def test_alarm_of_several_vehicles_is_plural(story: Story) -> None:
    one = Condition(AlarmCause.OUTSIDE_CONTROL, "in mode position", ("d1",), "[It is|They are] left alone.")
    (alarm,) = story.holds(one)
    assert alarm.text == "Vehicle d1 outside control: in mode position. It is left alone."
    assert alarm.advice == "Ask the pilot. take-control takes it over, in HOLD, when the pilot agrees."
    (alarm,) = story.holds(one, replace(one, vehicles=("d2",)))
    assert alarm.text == "Vehicles d1, d2 outside control: in mode position. They are left alone."
    assert alarm.advice == "Ask the pilots. take-control takes them over, in HOLD, when the pilots agree."


def test_vehicles_with_different_reasons_are_a_table(story: Story) -> None:
    poor = [
        Condition(AlarmCause.POOR_LINK, f"{60 + row}% of [its|their] positions arrive", (f"d{row}",))
        for row in range(16)
    ]
    (alarm,) = story.holds(*poor, for_s=9.0)
    assert alarm.text == "16 vehicles with a poor link."
    assert len(alarm.reasons) == 16
    assert (alarm.reasons[2].vehicle, alarm.reasons[2].because) == ("d2", "62% of its positions arrive")
    (alarm,) = story.holds(*poor[:2], for_s=9.0)
    assert alarm.reasons == ()
    (alarm,) = story.holds(replace(poor[0], vehicles=("d1", "d2")), for_s=9.0)
    assert alarm.text == "Vehicles d1, d2 with a poor link: 60% of their positions arrive."


def test_an_alarm_that_ended_is_told_in_the_past(story: Story) -> None:
    story.holds(lost("d3"))
    (alarm,) = story.holds()
    assert alarm.text == "Vehicle d3 was lost: no telemetry for 2.0 s. Ended after less than 1 s."
    assert (alarm.advice, alarm.action) == ("", None)


def test_an_alarm_that_ended_says_how_long_it_lasted() -> None:
    """And that a vehicle landed: what was wrong with it may still be."""
    standing: set[str] = set()
    story = Story()
    story.book = AlarmBook(standing.__contains__)
    story.holds(lost("d3"), low("d2"), for_s=12.0)
    standing.add("d2")
    texts = [alarm.text for alarm in story.holds(for_s=12.0)]
    assert texts == [
        "Vehicle d3 was lost: no telemetry for 2.0 s. Ended after 12 s.",
        "Vehicle d2 was low on battery: battery at 15%, below 20%. On the ground after 12 s.",
    ]
    story.holds(low("d2"))
    assert story.holds(for_s=3.0)[0].text.endswith("Ended after less than 1 s."), "it did not fly"


def test_an_alarm_that_became_another_one_is_not_over(story: Story) -> None:
    own = Condition(AlarmCause.OWN_FAILSAFE, "lands", ("d1",), replaces=(AlarmCause.LOW_BATTERY,))
    story.holds(low("d1"))
    assert causes(story.holds(own, for_s=3.0)) == ["own-failsafe"]
    story.holds(own, low("d2"))
    assert "low-battery" in causes(story.holds(own, for_s=3.0)), "that of another vehicle is"


def test_what_ended_keeps_the_reason_it_was_raised_with(story: Story) -> None:
    story.holds(Condition(AlarmCause.VEHICLES_LOST, "3 of 12 are lost"))
    story.holds(Condition(AlarmCause.VEHICLES_LOST, "0 of 12 are lost"), for_s=6.0)
    (alarm,) = story.holds(for_s=6.0)
    assert alarm.text == "Too many vehicles were lost: 3 of 12 are lost. Ended after 6 s."


@pytest.mark.parametrize(
    "cause", [cause for cause, row in CAUSES.items() if row.severity in KEPT_UNTIL_ACKNOWLEDGED]
)
def test_each_alarm_that_stays_when_it_ends_has_a_past(cause: AlarmCause) -> None:
    past = for_number(in_the_past(CAUSES[cause]), many=False)
    assert re.search(r"\b(was|were|had|have)\b", past), past


def test_an_alarm_names_the_command_that_its_advice_means(story: Story) -> None:
    (alarm,) = story.holds(low("d1"))
    assert alarm.action is AlarmAction.RETURN
    (alarm,) = story.holds(Condition(AlarmCause.LOW_BATTERY, "20%", ("d1",), advice="Look at it."))
    assert alarm.action is None, "the advice is another"
