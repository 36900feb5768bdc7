"""A start needs two tokens, one hash and its time, whatever is called in whatever order."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from gcs.model.errors import RefusedError
from gcs.preflight.go import GoByTwo, go_hash

WITHIN_S = 60.0
TOKENS = st.sampled_from(["alice", "bob", "carol"])
NAMES = st.sampled_from(["show", "site", "parameters", "weather", "checklists", "vehicles"])
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("propose"), TOKENS),
        st.tuples(st.just("confirm"), TOKENS, st.booleans()),
        st.tuples(st.just("change"), NAMES, st.sampled_from(["", "1", "2"])),
        st.tuples(st.just("wait"), st.floats(0.0, 90.0)),
        st.tuples(st.just("look")),
        st.tuples(st.just("stop")),
    ),
    max_size=30,
)


@given(STEPS)
def test_no_start_without_two_tokens_one_hash_and_in_time(steps: list[tuple[Any, ...]]) -> None:
    """An account of its own: what was proposed when, and every value that a part had since then."""
    two, parts, now_s = GoByTwo(WITHIN_S), {"show": "1"}, 0.0
    proposed: dict[str, str] = {}
    by, since_s, unchanged = "", -1e9, False
    for kind, *given_ in steps:
        if kind == "wait":
            now_s += given_[0]
        elif kind == "change":
            parts[given_[0]] = given_[1]
            unchanged = unchanged and go_hash(parts) == go_hash(proposed)
        elif kind == "stop":
            two.end("called off")
            unchanged = False
        elif kind == "look":
            two.look(parts, now_s)
        elif kind == "propose":
            try:
                two.propose(given_[0], parts, now_s)
            except RefusedError:
                continue
            by, proposed, since_s, unchanged = given_[0], dict(parts), now_s, True
        else:
            token, knows = given_
            shown = go_hash(parts) if knows else "0" * 12
            try:
                accepted = two.check(token, shown, parts, now_s)
            except RefusedError:
                assert not (knows and unchanged and token != by and now_s <= since_s + WITHIN_S)
                continue
            two.take()
            assert token != accepted.by == by
            assert shown == accepted.hash == go_hash(proposed) == go_hash(parts)
            assert 0.0 <= now_s - since_s <= WITHIN_S
            unchanged = False
