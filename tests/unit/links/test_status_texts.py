"""Status texts in chunks: in any order, twice, two at a time, and without one of them."""

import pytest

from gcs.links.status_texts import CHUNKS_MAX, REPEATED_S, TEXTS_KEPT, StatusTexts
from gcs.mavlink.framing import TextChunk

A = b"Preflight Fail: compass 1 inconsistent with 2 and "
B = b"also barometer not stable, wait until it settles d"
C = b"own"
LONG = (A + B + C).decode()

Chunk = tuple[bytes, int, int]
FIRST, SECOND, LAST = (A, 7, 0), (B, 7, 1), (C, 7, 2)


def texts(*chunks: Chunk, apart_s: float = 0.1) -> list[str]:
    taken = StatusTexts()
    for at, (text, text_id, chunk) in enumerate(chunks):
        taken.take(TextChunk(6, text, text_id, chunk, last=len(text) < 50), apart_s * at)
    return [text.text for text in taken.texts]


@pytest.mark.parametrize(
    "chunks",
    [
        (FIRST, SECOND, LAST),
        (FIRST, FIRST, SECOND, LAST, LAST, SECOND),
        (SECOND, FIRST, LAST),
        (LAST, SECOND, FIRST),
    ],
)
def test_chunks_in_any_order_and_repeated_are_one_text(chunks: tuple[Chunk, ...]) -> None:
    assert texts(*chunks) == [LONG]


def test_texts_in_turn_are_each_put_together() -> None:
    other, end = (b"x" * 50, 8, 0), (b"y", 8, 1)
    assert texts(FIRST, other, SECOND, end, LAST) == [LONG, "x" * 50 + "y"]
    assert texts(FIRST, (b"Battery low", 0, 0), SECOND, LAST) == [LONG, "Battery low"]


def test_a_missing_chunk_is_left_out() -> None:
    assert texts(FIRST, LAST) == [(A + C).decode()]
    assert texts(FIRST, (b"new", 8, 0)) == [A.decode().strip(), "new"]


def test_a_restarted_vehicle_counts_its_texts_anew() -> None:
    assert texts(FIRST, SECOND, (b"another text", 7, 0)) == [(A + B).decode(), "another text"]
    assert texts(FIRST, (b"own", 8, 0), FIRST, apart_s=REPEATED_S + 1.0) == ["own", A.decode().strip()]


def test_a_repeated_text_is_shown_once_as_the_newest() -> None:
    reasons = [(f"PreArm: reason {number}".encode(), 0, 0) for number in range(10)]
    assert texts(*reasons, *reasons, (b"Land", 0, 0)) == [*(text.decode() for text, *_ in reasons), "Land"]
    taken = StatusTexts()
    for text, text_id, chunk in (*reasons, (b"Land", 0, 0)):
        taken.take(TextChunk(6, text, text_id, chunk, last=True), 0.0)
    taken.forget("PreArm: ")
    assert [text.text for text in taken.texts] == ["Land"]


def test_a_text_is_as_new_as_its_newest_chunk() -> None:
    taken = StatusTexts()
    taken.take(TextChunk(4, B, 7, 1, last=False), 1.0)
    taken.take(TextChunk(4, A, 7, 0, last=False), 2.0)
    assert (taken.text, taken.text_time_s) == ((A + B).decode(), 2.0)
    taken.take(TextChunk(4, B, 7, 1, last=False), 3.0)
    assert taken.text_time_s == 2.0, "a repeated chunk is nothing new"


def test_what_is_kept_is_bounded() -> None:
    taken = StatusTexts()
    for text_id in range(1, 1000):
        for chunk in range(256):
            taken.take(TextChunk(4, A, text_id, chunk, last=False), 0.0)
    assert len(taken.texts) == len(taken._in_chunks) == TEXTS_KEPT
    assert {len(text.text.encode()) for text in taken.texts} == {CHUNKS_MAX * len(A) - 1}
