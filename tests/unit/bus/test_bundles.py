"""The messages of one tick as one: nothing is lost or changed, and damaged bytes are refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.bus.bundles import BUNDLE_MAX, PARTS_MAX, TOPIC_MAX, bundles, parts_of
from gcs.bus.interface import PAYLOAD_MAX
from gcs.model.errors import LinkError

TOPICS = st.text(max_size=60)


@given(st.dictionaries(TOPICS, st.binary(max_size=200), max_size=3 * PARTS_MAX))
def test_what_is_bundled_comes_out_in_its_order(messages: dict[str, bytes]) -> None:
    made = list(bundles(messages))
    assert [part for one in made for part in parts_of(one)] == list(messages.items())
    assert len(made) == -(-len(messages) // PARTS_MAX)


def test_messages_that_are_large_together_leave_in_several() -> None:
    messages = {
        "a": bytes(PAYLOAD_MAX),
        "b": bytes(PAYLOAD_MAX // 2),
        "c": bytes(PAYLOAD_MAX // 2),
        "d": b"1",
    }
    made = list(bundles(messages))
    assert [[topic for topic, _ in parts_of(one)] for one in made] == [["a"], ["b", "c", "d"]]
    assert max(map(len, made)) <= BUNDLE_MAX


@pytest.mark.parametrize(
    ("topic", "payload"), [("states", bytes(PAYLOAD_MAX + 1)), ("x" * (TOPIC_MAX + 1), b"")]
)
def test_a_message_that_is_too_large_is_refused(topic: str, payload: bytes) -> None:
    with pytest.raises(LinkError, match=f"{topic}: {len(payload)} bytes where {PAYLOAD_MAX} are possible"):
        list(bundles({"plan": b"p", topic: payload}))


@given(st.binary(max_size=400))
def test_any_bytes_are_read_or_refused(junk: bytes) -> None:
    try:
        parts = parts_of(junk)
    except LinkError:
        return
    assert sum(len(topic.encode()) + len(payload) + 5 for topic, payload in parts) == len(junk)


@pytest.mark.parametrize("cut", [1, 3, 8, 12])
def test_a_bundle_that_ends_early_is_refused(cut: int) -> None:
    (whole,) = bundles({"states": b"12345"})
    with pytest.raises(LinkError, match="ends within a message"):
        parts_of(whole[:cut])


def test_a_bundle_of_too_many_messages_is_refused() -> None:
    many = b"".join(one for number in range(PARTS_MAX + 1) for one in bundles({f"{number}": b""}))
    with pytest.raises(LinkError, match="too large"):
        parts_of(many)
