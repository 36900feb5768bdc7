"""A start by two tokens: who may confirm what, and until when, in the rules alone."""

from collections.abc import Mapping

import pytest

from gcs.model.errors import RefusedError
from gcs.preflight.go import GoByTwo, changes, go_hash

PARTS: Mapping[str, str] = {"show": "a1", "site": "b2", "parameters": "c3", "weather": "d4"}
WITHIN_S = 60.0


def proposed() -> GoByTwo:
    two = GoByTwo(WITHIN_S)
    two.propose("alice", PARTS, 100.0)
    return two


def test_another_token_confirms_the_same_hash_in_time() -> None:
    two = proposed()
    assert two.check("bob", go_hash(PARTS), PARTS, 160.0).by == "alice"
    two.take()
    with pytest.raises(RefusedError, match="no start is proposed; gcs start proposes one"):
        two.check("bob", go_hash(PARTS), PARTS, 101.0)


REFUSED = {
    "own": ("alice", go_hash(PARTS), PARTS, 101.0, "alice proposed this start: another token confirms it"),
    "hash": ("bob", "0" * 12, PARTS, 101.0, f"has the hash {go_hash(PARTS)}, not '000000000000'"),
    "late": ("bob", go_hash(PARTS), PARTS, 160.1, "no other token confirmed it within 60 s"),
    "time": ("bob", go_hash(PARTS), PARTS, float("nan"), "no other token confirmed it within 60 s"),
    "changed": (
        "bob",
        go_hash(PARTS),
        {**PARTS, "weather": "e5", "show": ""},
        101.0,
        "show and weather changed since alice proposed it",
    ),
}


@pytest.mark.parametrize("why", REFUSED)
def test_any_other_confirmation_is_refused_in_words(why: str) -> None:
    by, given, parts, now_s, says = REFUSED[why]
    two = proposed()
    with pytest.raises(RefusedError, match=says):
        two.check(by, given, parts, now_s)
    ends = why in {"late", "time", "changed"}
    assert (two.proposal is None) == ends
    if ends:
        with pytest.raises(RefusedError, match=f"no start is proposed: .*{says}"):
            two.check("bob", go_hash(PARTS), PARTS, 102.0)


def test_what_changed_and_changed_back_is_not_confirmed() -> None:
    two = proposed()
    assert two.look({**PARTS, "parameters": "x"}, 110.0) == "parameters changed since alice proposed it"
    with pytest.raises(RefusedError, match="parameters changed since alice"):
        two.check("bob", go_hash(PARTS), PARTS, 111.0)


def test_a_second_proposal_replaces_the_own_one_only() -> None:
    two = proposed()
    with pytest.raises(RefusedError, match="alice has proposed a start, 50 s are left: gcs confirm "):
        two.propose("bob", PARTS, 110.0)
    assert two.propose("alice", {**PARTS, "show": "n"}, 110.0).until_s == 170.0
    assert two.propose("bob", PARTS, 171.0).by == "bob"


def test_another_start_does_not_displace_one_that_waits() -> None:
    """What is proposed instead may be of other vehicles or another time: what waits is unchanged."""
    two, other = proposed(), {**PARTS, "vehicles": "f6", "time": "a7"}
    with pytest.raises(RefusedError, match="alice has proposed a start, 50 s are left"):
        two.propose("bob", other, 110.0, PARTS)
    assert two.check("bob", go_hash(PARTS), PARTS, 111.0).by == "alice"
    assert two.propose("bob", other, 112.0, {**PARTS, "show": "n"}).by == "bob"


def test_a_part_that_is_absent_is_as_an_empty_one() -> None:
    without = {name: value for name, value in PARTS.items() if name != "site"}
    assert go_hash(without) == go_hash({**without, "site": ""}) != go_hash(PARTS)
    assert changes(without, {**without, "site": ""}) == ""
    assert changes(without, PARTS) == "site"
