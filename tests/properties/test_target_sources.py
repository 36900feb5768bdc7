"""Whatever arrives or lies in a file, a source of targets raises nothing but what it names."""

import asyncio
import struct
from itertools import pairwise
from math import isfinite, isnan
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.links.targets import path
from gcs.links.targets.mavlink import TargetReports
from gcs.links.targets.path import points
from gcs.mavlink.framing import MESSAGES
from gcs.model.errors import LinkError
from gcs.model.target_fix import TargetFix
from tests.support.target_fakes import packed, source

READ = (24, 33, 144, 246, 301)
NUMBERS = (0, 1, 127, 128, 255, 32_767, 65_535, 2**31 - 1, 473_977_420)


@st.composite
def messages(draw: st.DrawFn) -> Any:
    """Any of the messages that are read, with any bytes as its payload."""
    kind = MESSAGES[draw(st.sampled_from(READ))]
    size = struct.calcsize(kind.unpacker.format)
    payload = draw(st.binary(min_size=size, max_size=size))
    fields = list(kind.unpacker.unpack(payload))
    ordered, at = {}, 0
    for name, length in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True):
        count = length if length and not isinstance(fields[at], bytes) else 1
        ordered[name] = fields[at : at + count] if count > 1 else fields[at]
        at += count
    return kind(*(ordered[name] for name in kind.fieldnames))


def is_sound(fix: TargetFix) -> bool:
    """Whether the position is one, and the rest finite or unknown."""
    rest = (fix.altitude_amsl_m, fix.north_m_s, fix.east_m_s, fix.down_m_s, fix.deviation_m, fix.source_s)
    position = abs(fix.latitude_deg) <= 90.0 and abs(fix.longitude_deg) <= 180.0
    return position and all(isfinite(value) or isnan(value) for value in rest)


def are_sound(datagrams: list[bytes], track: str) -> bool:
    """Whether all that is read of them is."""
    reports, now_s, sound = TargetReports(source(track=track), 0.0), 0.0, True
    for datagram in datagrams:
        now_s += 0.5
        sound &= all(map(is_sound, reports.take(datagram, now_s)))
        reports.why_silent(now_s)
    return sound


TRACKS = st.sampled_from(["", "4CA1B2", "211234560"])


@given(st.lists(st.binary(max_size=400), max_size=10), TRACKS)
def test_any_bytes_are_read_without_an_error(datagrams: list[bytes], track: str) -> None:
    assert are_sound(datagrams, track)


@given(st.lists(messages(), max_size=20), TRACKS)
def test_any_content_of_a_message_is_sound_or_refused(received: list[Any], track: str) -> None:
    assert are_sound([packed(message) for message in received], track)


LINES = st.lists(
    st.one_of(
        st.text(max_size=30),
        st.tuples(st.floats(), st.floats(), st.floats()).map(lambda row: ",".join(map(str, row))),
    ),
    max_size=20,
)
TAGS = st.lists(
    st.sampled_from(
        [
            *("<gpx>", "</gpx>", "<trkpt lat='47' lon='8'>", "</trkpt>", "<time>", "</time>", "<ele>"),
            *("</ele>", "2026-05-01T10:00:00Z", "1", "-0001-01-01", "nan"),
            *("&amp;", "&#0;", "<!DOCTYPE a>", "<![CDATA[x]]>"),
        ]
    ),
    max_size=30,
)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("recorded")


def is_read_or_refused(file: Path, content: bytes) -> bool:
    """Whether only LinkError is raised, with the file's name, or what is read is in order and sound."""
    file.write_bytes(content)
    track: tuple[Any, ...] = ()
    refusal = ""
    try:
        track = tuple(asyncio.run(path._read(points(file), file)))
    except LinkError as error:
        refusal = str(error)
    either = bool(track) != (file.name in refusal)
    sound = all(is_sound(TargetFix(0.0, *point[1:])) for point in track)
    return either and sound and all(after.time_s > before.time_s for before, after in pairwise(track))


@given(content=st.binary(max_size=2000), suffix=st.sampled_from([".csv", ".gpx", ".tlog"]))
def test_any_file_is_read_or_refused(folder: Path, content: bytes, suffix: str) -> None:
    assert is_read_or_refused(folder / f"any{suffix}", content)


@given(lines=LINES)
def test_any_lines_below_a_header_are_read_or_refused(folder: Path, lines: list[str]) -> None:
    text = "\n".join(["time_s,latitude_deg,longitude_deg", *lines])
    assert is_read_or_refused(folder / "lines.csv", text.encode("utf-8", "replace"))


@given(tags=TAGS)
def test_any_tags_are_read_or_refused(folder: Path, tags: list[str]) -> None:
    assert is_read_or_refused(folder / "tags.gpx", "".join(["<gpx>", *tags]).encode())


@given(messages=st.lists(st.tuples(st.integers(0, 2**64 - 1), messages()), max_size=20))
def test_any_log_is_read_or_refused(folder: Path, messages: list[tuple[int, Any]]) -> None:
    content = b"".join(struct.pack(">Q", stamp) + packed(message) for stamp, message in messages)
    assert is_read_or_refused(folder / "log.tlog", content)
