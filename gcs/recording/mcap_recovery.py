"""Reads an MCAP file chunk by chunk: damaged parts are skipped, and reported by their bytes.

Flight data are stored in chunks, each with a checksum. An invalid record, or a chunk with a wrong checksum,
is skipped up to the next chunk, which is found by its byte pattern.
"""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Final

import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, DataEnd, Footer, McapRecord
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk

MAGIC: Final = b"\x89MCAP0\r\n"
RECORD_MAX_BYTES: Final = 64 << 20
DAMAGED: Final = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    KeyError,
    EOFError,
    OverflowError,
    MemoryError,
)
"""Exceptions that readers raise where a file is damaged."""

_FRAME: Final = struct.Struct("<BQ")  # of every record: its type, and how many bytes follow
_CHUNK: Final = struct.Struct("<BQQQQII4sQ")  # a chunk up to its data, compressed as in our files
_CHUNK_FORM: Final = b"\x04\x00\x00\x00zstd"
_FORM_AT: Final = _FRAME.size + 28
"""Offset of a chunk's byte pattern: behind its frame, times, size and checksum."""


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes that could not be read."""

    first_byte: int
    end_byte: int  # the first that could be read again, or the file's length
    why: str
    is_cut: bool = False  # nothing follows
    in_index: bool = False  # behind the data, none of which is lost

    def __str__(self) -> str:
        if self.in_index:
            return f"the file's index is cut off or damaged from byte {self.first_byte} on ({self.why})"
        if self.is_cut:
            return f"the file is cut off or damaged from byte {self.first_byte} on ({self.why})"
        return f"bytes {self.first_byte} to {self.end_byte} are damaged and were skipped ({self.why})"


@dataclass(frozen=True, slots=True)
class Found:
    """A record, and its bytes."""

    at: int
    end: int
    record: McapRecord


@contextmanager
def opened(path: Path) -> Iterator[mmap]:
    """Map the bytes of a file. Raises: OSError; ValueError for an empty one."""
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
        yield data


def records(data: mmap, offset: int = 0) -> Iterator[Found | Damage]:
    """Yield every record from a byte on where one begins, and every damage; messages are in their chunks.

    Raises: McapError when the file does not begin as an MCAP file.
    """
    at = offset
    if at == 0:
        if data[: len(MAGIC)] != MAGIC:
            raise McapError("not an MCAP file: it does not begin as one")
        at = len(MAGIC)
    has_ended = False
    while True:
        try:
            record, end = _record(data, at)
        except DAMAGED as error:
            following = _next_chunk(data, at + 1)
            if following is None:
                yield Damage(at, len(data), plain(error), is_cut=True, in_index=has_ended)
                return
            yield Damage(at, following, plain(error))
            at, has_ended = following, False
            continue
        yield Found(at, end, record)
        at = end
        has_ended = has_ended or isinstance(record, DataEnd)
        if isinstance(record, Footer):
            following = _next_chunk(data, at)
            if following is None:
                if data[at:] != MAGIC:
                    yield Damage(at, len(data), "its last mark is missing", is_cut=True, in_index=has_ended)
                return
            yield Damage(at, following, "its end stands before a chunk")
            at, has_ended = following, False


def plain(error: Exception) -> str:
    return f"{error}" or type(error).__name__


def messages(chunk: Chunk) -> list[McapRecord]:
    """Return the messages in a chunk. Raises: one of `DAMAGED` when its checksum is wrong."""
    if chunk.uncompressed_crc == 0:
        raise McapError("a chunk without a checksum")
    if chunk.uncompressed_size > RECORD_MAX_BYTES:
        raise McapError(f"a chunk of {chunk.uncompressed_size} bytes")
    if chunk.compression == "zstd":
        size = zstandard.get_frame_parameters(chunk.data).content_size
        if size != chunk.uncompressed_size and size > RECORD_MAX_BYTES:
            raise McapError(f"a chunk of {size} bytes")
    try:
        return breakup_chunk(chunk, validate_crc=True)
    except CRCValidationError:
        raise McapError("the checksum does not match") from None


def _record(data: mmap, at: int) -> tuple[McapRecord, int]:
    """Return a record, and where the next begins. Raises: one of `DAMAGED` when it is invalid."""
    if at + _FRAME.size > len(data):
        raise McapError("it ends without its footer")
    kind, length = _FRAME.unpack_from(data, at)
    end = at + _FRAME.size + length
    if length > RECORD_MAX_BYTES or end > len(data):
        raise McapError(f"a record of {length} bytes, {len(data) - at - _FRAME.size} are left")
    if Opcode(kind) is Opcode.MESSAGE:
        raise McapError("a message outside of a chunk")
    # a length of 0, because the reader skips what a record has beyond its fields
    body = BytesIO(_FRAME.pack(kind, 0) + data[at + _FRAME.size : end])
    record = next(StreamReader(body, skip_magic=True, emit_chunks=True).records)
    if body.tell() != _FRAME.size + length:
        raise McapError(f"a record of {length} bytes with fields of {body.tell() - _FRAME.size}")
    return record, end


def _next_chunk(data: mmap, at: int) -> int | None:
    """Return where the next chunk begins, by its byte pattern; None: there is none."""
    found = data.find(_CHUNK_FORM, at + _FORM_AT)
    while found >= 0:
        begins = found - _FORM_AT
        if begins + _CHUNK.size <= len(data):
            kind, length, *_, size = _CHUNK.unpack_from(data, begins)
            whole = _CHUNK.size - _FRAME.size + size
            if kind == Opcode.CHUNK and length == whole and begins + _FRAME.size + length <= len(data):
                return begins
        found = data.find(_CHUNK_FORM, found + 1)
    return None
