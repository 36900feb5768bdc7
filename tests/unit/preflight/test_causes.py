"""What follows from a cause is folded under it, whichever vehicles and checks it comes from."""

from collections.abc import Sequence

from gcs.model.preflight_report import READY, Check, PreflightCause, Remedy, State
from gcs.preflight.causes import Finding, causes_of


def check(
    name: str, problem: str = "wrong", *, of: tuple[str, ...] = (), unit: str = "", value: float = 1.0
) -> Check:
    return Check(name, State.FAIL, value, unit, "at least 2", problem, "mend it", of)


def near(one: str, other: str) -> Finding:
    """A pair that is too close."""
    return one, check("distance to the next", f"near {other}", of=(other, one))


class Fleet:
    """Failures of single vehicles, and of pairs that are gone without one of the two."""

    def __init__(self, own: dict[str, list[Check]], pairs: Sequence[Finding] = ()) -> None:
        self.own, self.pairs = own, pairs
        self.asked = 0

    def related(self, out: frozenset[str]) -> list[Finding]:
        self.asked += 1
        return [pair for pair in self.pairs if not out.intersection({pair[0], *pair[1].depends_on})]

    def causes(self, evaluations_max: int = 40) -> tuple[PreflightCause, ...]:
        return causes_of(self.own, self.related, lambda _name, _out: None, evaluations_max)


def six() -> dict[str, list[Check]]:
    return {f"d{number}": [] for number in range(1, 7)}


def test_pairs_follow_from_the_vehicle_they_depend_on() -> None:
    fleet = Fleet(six() | {"d3": [check("fix")]}, [near("d1", "d3"), near("d2", "d3"), near("d3", "d4")])
    (cause,) = fleet.causes()
    assert (cause.check, cause.vehicles) == ("fix", ("d3",))
    assert cause.follows == ("distance to the next: d1, d2, d3",)
    assert cause.action is not None
    assert (cause.action.label, cause.action.then) == ("Leave d3 out", READY)


def test_a_vehicle_without_a_failure_of_its_own_may_be_the_cause() -> None:
    (cause,) = Fleet(six(), [near("d1", "d3"), near("d2", "d3"), near("d5", "d3")]).causes()
    assert cause.action is not None
    assert (cause.action.vehicles, cause.action.then) == (("d3",), READY)


def test_checks_of_one_vehicle_follow_from_those_they_name() -> None:
    checks = [check("position", of=("fix",)), check("clock", of=("fix",)), check("battery"), check("fix")]
    found = {cause.check: cause.follows for cause in Fleet(six() | {"d3": checks}).causes()}
    assert found == {"fix": ("position: d3", "clock: d3"), "battery": ()}


def test_a_silent_vehicle_has_no_other_cause() -> None:
    (cause,) = Fleet(six() | {"d3": [check("received"), check("fix"), check("battery")]}).causes()
    assert (cause.check, cause.follows) == ("received", ("fix: d3", "battery: d3"))


def test_vehicles_with_one_cause_are_one_block_with_their_values() -> None:
    own = six() | {
        f"d{row}": [check("battery", f"at {row}", unit="of 1", value=row / 10)] for row in (1, 2, 4, 5)
    }
    (cause,) = Fleet(own).causes()
    assert cause.text == "4 vehicles: battery 10% to 50%, at least 2"
    assert cause.action is not None
    assert (cause.action.remedy, cause.action.label) == (Remedy.LEAVE_OUT, "Leave 4 vehicles out")


def test_what_helps_most_comes_first_and_promises_only_its_own() -> None:
    own = six() | {"d1": [check("battery")], "d3": [check("fix")]}
    first, second = Fleet(own, [near("d2", "d3"), near("d4", "d3")]).causes()
    assert (first.check, second.check) == ("fix", "battery")
    assert first.action is not None
    assert second.action is not None
    assert (first.action.then, second.action.then) == ("1 other cause remains", "1 other cause remains")


def test_no_vehicle_is_left_out_where_all_have_the_cause() -> None:
    (cause,) = Fleet({name: [check("clock", unit="s")] for name in six()}).causes()
    assert cause.action is None
    assert cause.to_do == "mend it"


def test_many_pairs_that_no_few_vehicles_explain_are_one_block() -> None:
    pairs = [near(f"a{row}", f"b{row}") for row in range(9)]
    own: dict[str, list[Check]] = {name: [] for row in range(9) for name in (f"a{row}", f"b{row}")}
    (cause,) = Fleet(own, pairs).causes()
    assert len(cause.vehicles) == 18  # neither of a pair is blamed alone


def test_a_vehicle_beside_others_is_named_and_not_they() -> None:
    """It stays where it is when it is left out, and they cannot take off beside it."""
    own = six()
    pairs = [near("d1", "d4"), near("d2", "d4")]

    def related(out: frozenset[str]) -> list[Finding]:
        return [pair for pair in pairs if pair[0] not in out]

    (cause,) = causes_of(own, related, lambda _name, _out: None, 40)
    assert (cause.vehicles, cause.text) == (("d4",), "d4: d1 near d4")
    assert cause.follows == ("distance to the next: d1, d2",)
    assert cause.action is not None
    assert cause.action.label == "Leave d4 out, with d1, d2 beside"
    assert (cause.action.vehicles, cause.action.then) == (("d1", "d2", "d4"), READY)


def test_of_a_pair_without_other_failures_both_are_named() -> None:
    (cause,) = Fleet(six(), [near("d1", "d3")]).causes()
    assert cause.vehicles == ("d1", "d3")
    assert cause.action is not None
    assert cause.action.label == "Leave d1, d3 out"


def test_a_large_fleet_is_evaluated_seldom_and_hides_nothing() -> None:
    own = six() | {"d1": [check("battery")], "d3": [check("fix")]}
    fleet = Fleet(own, [near("d2", "d3"), near("d5", "d6")])
    causes = fleet.causes(2)
    assert fleet.asked == 2
    shown = {cause.check for cause in causes} | {
        text.split(":")[0] for cause in causes for text in cause.follows
    }
    assert shown == {"battery", "fix", "distance to the next"}
