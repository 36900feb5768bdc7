"""Reads flight data from an MCAP file: tick by tick, and which parts are lost.

Flight data are stored in chunks, each with a checksum. An invalid record, or a chunk with a wrong checksum,
is skipped up to the next chunk, which is found by its byte pattern, and reported by its bytes.
"""

import json
import struct
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from io import BytesIO
from math import inf, isfinite
from mmap import ACCESS_READ, mmap
from operator import itemgetter
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Footer, McapRecord, Message, Metadata
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from numpy.typing import NDArray
from pydantic import ValidationError

from gcs.links.autopilots import DEFAULT
from gcs.model.errors import GcsError, quoted
from gcs.model.frames import ShowFrame
from gcs.model.lifecycle import Phase
from gcs.model.state import Mode, VehicleId
from gcs.recording import mcap_layout as layout
from gcs.recording.mcap_writer import CHUNK_S, STATUS_S
from gcs.safety.surroundings import SafetySettings
from gcs.service.features import Features

MAGIC: Final = b"\x89MCAP0\r\n"
ELSEWHERE: Final = "/fleet/elsewhere"
FEATURES: Final = "/fleet/features"
RECORD_MAX_BYTES: Final = 16 << 20
CHUNK_MAX_BYTES: Final = 4 << 20
"""Of a chunk without compression; ours end at 1 MB."""

CHUNK_RECORDS_MAX: Final = 20_000
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
class FoundRecord:
    """A record, and its bytes."""

    at: int
    end: int
    record: McapRecord


@contextmanager
def opened(path: Path) -> Iterator[mmap]:
    """Map the bytes of a file. Raises: OSError; ValueError for an empty one."""
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
        yield data


def records(data: mmap, offset: int = 0) -> Iterator[FoundRecord | Damage]:
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
        yield FoundRecord(at, end, record)
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
    if chunk.uncompressed_size > CHUNK_MAX_BYTES:
        raise McapError(f"a chunk of {chunk.uncompressed_size} bytes")
    if chunk.compression != "zstd":
        raise McapError(f"a chunk with compression {quoted(chunk.compression)}")
    size = zstandard.get_frame_parameters(chunk.data).content_size
    if size != chunk.uncompressed_size:
        raise McapError(f"a chunk of {size} bytes, not {chunk.uncompressed_size}")
    data = zstandard.decompress(chunk.data, size)
    if _count(data) > CHUNK_RECORDS_MAX:
        raise McapError(f"a chunk of more than {CHUNK_RECORDS_MAX} records")
    try:
        return breakup_chunk(replace(chunk, compression="", data=data), validate_crc=True)
    except CRCValidationError:
        raise McapError("the checksum does not match") from None


def _count(data: bytes) -> int:
    """Records in the data of a chunk, up to the first that is too many."""
    count = at = 0
    while at + _FRAME.size <= len(data) and count <= CHUNK_RECORDS_MAX:
        at += _FRAME.size + _FRAME.unpack_from(data, at)[1]
        count += 1
    return count


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
    at_form = data.find(_CHUNK_FORM, at + _FORM_AT)
    while at_form >= 0:
        begins = at_form - _FORM_AT
        if begins + _CHUNK.size <= len(data):
            kind, length, *_, size = _CHUNK.unpack_from(data, begins)
            whole = _CHUNK.size - _FRAME.size + size
            if kind == Opcode.CHUNK and length == whole and begins + _FRAME.size + length <= len(data):
                return begins
        at_form = data.find(_CHUNK_FORM, at_form + 1)
    return None


@dataclass(frozen=True, slots=True)
class About:
    """Metadata of a file."""

    session: str
    config: Mapping[str, Any]  # as `gcs.config.schema.Config.model_validate` takes it
    ids: tuple[VehicleId, ...]  # in the order of the rows
    system_ids: tuple[int, ...]
    links: tuple[str, ...]
    autopilots: tuple[str, ...]  # names, as configured
    phases: tuple[Phase, ...]  # by their numbers in the rows
    modes: tuple[Mode, ...]
    elsewhere: int = 0  # so many of the vehicles, the last ones, are recorded less often
    site_hash: str = ""  # of the areas that were flown in; empty: there were none

    @classmethod
    def read(cls, metadata: Mapping[str, str]) -> Self:
        """Parse the metadata. Raises: KeyError or ValueError for another version or invalid data."""
        if metadata["version"] not in layout.READABLE:
            readable = f"this program knows versions {' and '.join(layout.READABLE)}"
            raise ValueError(f"they are of version {metadata['version']}; {readable}")
        if metadata.get(layout.CHECKSUM) != layout.checksum(metadata):
            raise ValueError("what it says of itself (configuration, vehicles) is damaged")
        vehicles = json.loads(metadata["vehicles"])
        usual = (DEFAULT.name,) * len(vehicles)  # older records name none: there was one autopilot
        return cls(
            metadata["session"],
            json.loads(metadata["config"]),
            tuple(name for name, _, _ in vehicles),
            tuple(system_id for _, system_id, _ in vehicles),
            tuple(link for _, _, link in vehicles),
            tuple(json.loads(metadata["autopilots"])) if "autopilots" in metadata else usual,
            tuple(Phase(name) for name in json.loads(metadata["phases"])),
            tuple(Mode(name) for name in json.loads(metadata["modes"])),
            int(metadata["elsewhere"]),
            metadata.get("site_hash", ""),
        )


@dataclass(frozen=True, slots=True, eq=False)
class RecordedSample:
    """One recorded tick."""

    unix_s: float
    vehicles: NDArray[np.void]  # (n,) of `layout.VEHICLE`
    tick: layout.TickMessage
    status: layout.StatusMessage  # the newest
    features: Features  # the newest, one object for each message; without reports in older records


@dataclass(frozen=True, slots=True)
class ReadSample:
    """One recorded tick, undecoded."""

    unix_s: float
    vehicles: bytes
    tick: bytes
    status: bytes
    features: bytes  # empty: none were recorded
    elsewhere: bytes  # vehicles of other stations, then
    elsewhere_s: float  # Unix time


@dataclass(frozen=True, slots=True)
class Loss:
    """A part that could not be read, and its time."""

    damage: Damage
    from_s: float | None  # Unix time of the last tick before; None: there is none
    to_s: float | None  # of the first tick after; None: none follows

    def describe(self, began_s: float) -> str:
        if self.damage.in_index:
            return f"{self.damage}; nothing that was recorded is lost"
        begin = "the beginning" if self.from_s is None else f"{self.from_s - began_s:.2f} s"
        end = "the end" if self.to_s is None else f"{self.to_s - began_s:.2f} s"
        return f"{self.damage}; lost: from {begin} to {end}"


class FlightData:
    """A recorded flight. Reads only the beginning before `ticks`."""

    def __init__(self, path: Path) -> None:
        """Raises: GcsError naming the file, when it cannot be read or has another format."""
        self.path = path
        self.losses: list[Loss] = []  # after `ticks` or `samples`: of the part that was read
        self._began_s: float | None = None
        self._status: tuple[bytes, layout.StatusMessage] | None = None  # the newest that was decoded
        self._features: tuple[bytes, Features] = (b"", Features())  # likewise
        try:
            metadata = self._metadata()
            if metadata is None:
                raise GcsError(f"{path}: an MCAP file, but not flight data of this program")
            self.about = About.read(metadata)
        except OSError as error:
            raise GcsError(f"{path}: cannot be read: {error.strerror or error}") from None
        except DAMAGED as error:
            raise GcsError(f"{path}: not flight data of this program: {plain(error)}") from None

    @property
    def cut(self) -> str:
        """After `ticks`: what is damaged or missing, in words; empty when the file is whole."""
        return "; ".join(self.damages)

    @property
    def damages(self) -> tuple[str, ...]:
        return tuple(loss.describe(self._began_s or loss.from_s or 0.0) for loss in self.losses)

    def _metadata(self) -> Mapping[str, str] | None:
        """Metadata at the beginning of the file; None for a file of another program."""
        with opened(self.path) as data:
            for record in records(data):
                if isinstance(record, Damage):
                    raise McapError(str(record))
                if isinstance(record.record, Metadata) and record.record.name == layout.PROFILE:
                    return record.record.metadata
                if isinstance(record.record, Chunk | Footer):
                    break
        return None

    def ticks(self) -> Iterator[RecordedSample]:
        """Yield every recorded tick, in order, except damaged ones: `losses` then names them."""
        for sample in self.samples():
            yield self.decoded(sample)

    def samples(self, from_s: float = -inf) -> Iterator[ReadSample]:
        """Yield every recorded tick from a time on, undecoded, which is fast if few are decoded."""
        self.losses = []
        waiting: Damage | None = None  # until the next tick is known
        last_s: float | None = None
        try:
            for piece in self._pieces(self.offset(from_s) if isfinite(from_s) else 0):
                if isinstance(piece, Damage):
                    first = waiting or piece  # no tick could be read between the two
                    in_index = first.in_index and piece.in_index
                    waiting = replace(piece, first_byte=first.first_byte, why=first.why, in_index=in_index)
                    continue
                if waiting is not None:
                    self.losses.append(Loss(waiting, last_s, piece.unix_s))
                    waiting = None
                last_s = piece.unix_s
                if self._began_s is None and not isfinite(from_s):
                    self._began_s = last_s
                if last_s >= from_s:
                    yield piece
        except OSError as error:
            waiting = Damage(0, 0, f"it could not be read on: {error.strerror or error}", is_cut=True)
        if waiting is not None:
            self.losses.append(Loss(waiting, last_s, None))

    def _pieces(self, offset: int) -> Iterator[ReadSample | Damage]:
        """Yield ticks and damages. After a damage a tick needs a new status: the old one may be outdated."""
        topics, newest = dict(layout.TOPICS), dict[str, Message]()  # newest message of each topic
        needed = {"/fleet/vehicles", "/fleet/status"} | ({ELSEWHERE} if self.about.elsewhere else set())
        with opened(self.path) as data:
            for record in records(data, offset):
                if isinstance(record, Damage):
                    newest.clear()
                    yield record
                elif isinstance(record.record, Chunk):
                    try:
                        inside = messages(record.record)
                    except DAMAGED as error:
                        newest.clear()
                        yield Damage(record.at, record.end, plain(error))
                    else:
                        yield from _ticks(inside, topics, newest, needed)

    def decoded(self, sample: ReadSample) -> RecordedSample:
        """Decode a tick. Raises: GcsError naming the file, where it has another format."""
        try:
            if self._status is None or self._status[0] is not sample.status:
                self._status = sample.status, layout.STATUS.validate_json(sample.status)
            if self._features[0] is not sample.features:
                decoded = layout.FEATURES.validate_json(sample.features) if sample.features else Features()
                self._features = sample.features, decoded
            vehicles, tick = self._vehicles(sample), layout.TICK.validate_json(sample.tick)
        except (KeyError, TypeError, ValueError, GcsError) as error:
            raise GcsError(f"{self.path}: a recorded message cannot be read: {error}") from None
        return RecordedSample(sample.unix_s, vehicles, tick, self._status[1], self._features[1])

    @cached_property
    def chunks(self) -> list[tuple[float, int]]:
        """Start (Unix time) and byte of each chunk, in order; reads the file once without decompressing."""
        chunks: list[tuple[float, int]] = []
        with suppress(*DAMAGED, OSError), opened(self.path) as data:
            for record in records(data):
                if isinstance(record, Damage) or not isinstance(record.record, Chunk):
                    continue
                start, end = record.record.message_start_time, record.record.message_end_time
                in_order = not chunks or start * 1e-9 >= chunks[-1][0]
                if start <= end and in_order:  # otherwise its times are damaged: they have no checksum
                    chunks.append((start * 1e-9, record.at))
        return chunks

    def offset(self, from_s: float) -> int:
        """Byte from which to read ticks from a time on; it includes the status before them."""
        at = bisect_right(self.chunks, from_s - STATUS_S - CHUNK_S, key=itemgetter(0)) - 1
        return self.chunks[max(at, 0)][1] if self.chunks else 0

    def last_s(self) -> float | None:
        """Time of the last readable tick; None if there is none."""
        for start_s, _ in reversed(self.chunks):
            last_s = None
            for sample in self.samples(start_s):
                last_s = sample.unix_s
            if last_s is not None:
                return last_s
        return None

    def _vehicles(self, sample: ReadSample) -> NDArray[np.void]:
        """Decode the rows of all vehicles at the tick. Raises: ValueError when their number does not fit."""
        table = layout.rows_of(sample.vehicles)
        if sample.elsewhere:
            elsewhere = layout.rows_of(sample.elsewhere)
            table = np.concatenate([table, _later(elsewhere, sample.unix_s - sample.elsewhere_s)])
        if len(table) != len(self.about.ids):
            raise ValueError(f"{len(table)} vehicles where the file names {len(self.about.ids)}")
        return table


def _later(table: NDArray[np.void], after_s: float) -> NDArray[np.void]:
    """The rows brought forward with their velocities."""
    moved = table.copy()
    for position, velocity in zip(layout.POSITION, layout.VELOCITY, strict=True):
        moved[position] += after_s * np.nan_to_num(table[velocity])
    moved["position_age_s"] += after_s
    moved["heartbeat_age_s"] += after_s
    return moved


def _ticks(
    inside: Sequence[McapRecord], topics: dict[int, str], newest: dict[str, Message], needed: set[str]
) -> Iterator[ReadSample]:
    """Yield the ticks of a chunk, with the newest messages of the other topics."""
    for record in inside:
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message):
            topic = topics.get(record.channel_id, "")
            newest[topic] = record
            if topic == "/fleet/tick" and needed <= newest.keys():
                vehicles, status = newest["/fleet/vehicles"].data, newest["/fleet/status"].data
                features = newest[FEATURES].data if FEATURES in newest else b""
                elsewhere = newest[ELSEWHERE] if ELSEWHERE in needed else None
                of_others = (b"", 0.0) if elsewhere is None else (elsewhere.data, elsewhere.log_time * 1e-9)
                yield ReadSample(record.log_time * 1e-9, vehicles, record.data, status, features, *of_others)


@dataclass(frozen=True, slots=True)
class Standard:
    """The limits that applied at one time."""

    frame: ShowFrame
    safety: SafetySettings
    acceleration_max_m_s2: float

    @classmethod
    def of(cls, config: Mapping[str, Any], source: str) -> "Standard":
        """Read a recorded configuration. Raises: GcsError naming `source` and what is wrong."""
        try:
            control = config["control"]
            return cls(
                ShowFrame(**config["show_frame"]),
                SafetySettings.model_validate(control["safety"]),
                float(control["acceleration_max_m_s2"]),
            )
        except (KeyError, TypeError, ValueError, ValidationError, GcsError) as error:
            raise GcsError(f"{source}: its configuration does not say what holds: {error}") from None

    def under(self, limits: layout.RecordedLimits | None) -> "Standard":
        """Return these under recorded limits, such as a written show's. Raises: GcsError if invalid."""
        if limits is None:
            return self
        try:
            return replace(
                self,
                safety=SafetySettings.model_validate(limits.safety),
                acceleration_max_m_s2=limits.acceleration_max_m_s2,
            )
        except ValidationError as error:
            raise GcsError(f"the limits that were recorded are none: {error}") from None
