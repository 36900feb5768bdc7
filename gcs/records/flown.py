"""Flight data read back: tick by tick, as far as the file is whole."""

import json
import struct
from base64 import b64decode
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from math import inf, isfinite
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Metadata
from mcap.stream_reader import MAGIC_SIZE, StreamReader, breakup_chunk
from numpy.typing import NDArray
from zstandard import ZstdError

from gcs.errors import GcsError
from gcs.lifecycle import Phase
from gcs.records import layout
from gcs.records.flightfile import CHUNK_S, STATUS_S
from gcs.state import Mode, VehicleId

RECORD_MAX_BYTES: Final = 64 << 20
_DAMAGED: Final = (McapError, ZstdError, struct.error, ValueError, KeyError, EOFError)
"""What the reader raises where a file is cut off or damaged."""


@dataclass(frozen=True, slots=True)
class About:
    """What a file says of itself."""

    session: str
    config: Mapping[str, Any]  # as `gcs.config.Config.model_validate` takes it
    ids: tuple[VehicleId, ...]  # in the order of the rows
    system_ids: tuple[int, ...]
    links: tuple[str, ...]
    phases: tuple[Phase, ...]  # by their numbers in the rows
    modes: tuple[Mode, ...]

    @classmethod
    def read(cls, metadata: Mapping[str, str]) -> Self:
        """Raises: KeyError or ValueError for another version and for nonsense."""
        if metadata["version"] != str(layout.VERSION):
            known = f"this program knows {layout.VERSION}"
            raise ValueError(f"they are of version {metadata['version']}; {known}")
        vehicles = json.loads(metadata["vehicles"])
        return cls(
            metadata["session"],
            json.loads(metadata["config"]),
            tuple(name for name, _, _ in vehicles),
            tuple(system_id for _, system_id, _ in vehicles),
            tuple(link for _, _, link in vehicles),
            tuple(Phase(name) for name in json.loads(metadata["phases"])),
            tuple(Mode(name) for name in json.loads(metadata["modes"])),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """One tick, as it was recorded."""

    unix_s: float
    vehicles: NDArray[np.void]  # (n,) of `layout.VEHICLE`
    tick: Mapping[str, Any]  # of `/fleet/tick`
    status: Mapping[str, Any]  # the newest of `/fleet/status`


@dataclass(frozen=True, slots=True)
class Moment:
    """The same as it lies in the file."""

    unix_s: float
    vehicles: bytes
    tick: bytes
    status: bytes


@dataclass(frozen=True, slots=True)
class Index:
    """Where in a file what lies."""

    topics: Mapping[int, str]
    chunks: tuple[tuple[float, int], ...]  # when each begins (Unix time), and at which byte; in order

    def offset(self, from_s: float) -> int:
        """Where to begin to read, for ticks from a time on: the status before them is needed, too."""
        times_s = [start_s for start_s, _ in self.chunks]
        at = bisect_right(times_s, from_s - STATUS_S - CHUNK_S) - 1
        return self.chunks[max(at, 0)][1] if self.chunks else 0


class FlightData:
    """A recorded flight. Nothing but the beginning is read before `ticks`."""

    def __init__(self, path: Path) -> None:
        """Raises: GcsError naming the file, when it cannot be read or is not one of ours."""
        self.path = path
        self.cut = ""  # after `ticks`: where and why the file ends too early; empty when it is whole
        try:
            metadata = self._metadata()
            if metadata is None:
                raise GcsError(f"{path}: an MCAP file, but not flight data of this program")
            self.about = About.read(metadata)
        except OSError as error:
            raise GcsError(f"{path}: cannot be read: {error.strerror or error}") from None
        except _DAMAGED as error:
            raise GcsError(f"{path}: not flight data of this program: {_plain(error)}") from None

    def _metadata(self) -> Mapping[str, str] | None:
        """What our files begin with; None for a file of somebody else."""
        for record in self._records():
            if isinstance(record, Metadata) and record.name == layout.PROFILE:
                return record.metadata
            if isinstance(record, Channel | Footer):
                break
        return None

    def _records(self, offset: int = 0) -> Iterator[McapRecord]:
        """From a byte of the file on, where a record begins."""
        with self.path.open("rb") as file:
            file.seek(offset)
            begins = offset == 0
            reader = StreamReader(
                file, skip_magic=not begins, validate_crcs=True, record_size_limit=RECORD_MAX_BYTES
            )
            yield from reader.records

    def ticks(self) -> Iterator[Flown]:
        """Every recorded tick, in order; ends where the file does, which `cut` then tells."""
        for moment in self.moments():
            try:
                flown = self.decoded(moment)
            except _DAMAGED as error:
                self._cut_at(moment.unix_s, error)
                return
            yield flown

    def moments(self, from_s: float = -inf) -> Iterator[Moment]:
        """Every recorded tick from a time on, undecoded: who shows but few of them is quick."""
        self.cut = ""
        topics: dict[int, str] = dict(self.index.topics) if isfinite(from_s) else {}
        vehicles: bytes | None = None
        status: bytes | None = None
        last_s = None
        try:
            for record in self._records(self.index.offset(from_s) if isfinite(from_s) else 0):
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                if not isinstance(record, Message):
                    continue
                topic = topics[record.channel_id]
                if topic == "/fleet/vehicles":
                    vehicles = record.data
                elif topic == "/fleet/status":
                    status = record.data
                elif topic == "/fleet/tick" and vehicles is not None and status is not None:
                    last_s = record.log_time * 1e-9
                    if last_s >= from_s:
                        yield Moment(last_s, vehicles, record.data, status)
        except _DAMAGED as error:
            self._cut_at(last_s, error)
        except OSError as error:
            self.cut = f"the file could not be read on: {error.strerror or error}"

    def decoded(self, moment: Moment) -> Flown:
        """Raises: ValueError or KeyError where it is damaged."""
        return Flown(
            moment.unix_s,
            self._vehicles(moment.vehicles),
            json.loads(moment.tick),
            json.loads(moment.status),
        )

    def _cut_at(self, last_s: float | None, error: Exception) -> None:
        after = "before the first tick" if last_s is None else f"after {last_s:.1f} (Unix time)"
        self.cut = f"the file is cut off or damaged {after}: {_plain(error)}"

    @cached_property
    def index(self) -> Index:
        """Where in the file what lies; reads all of it once, without unpacking it."""
        topics: dict[int, str] = {}
        chunks: list[tuple[float, int]] = []
        with suppress(*_DAMAGED, OSError), self.path.open("rb") as file:
            records = StreamReader(file, emit_chunks=True, record_size_limit=RECORD_MAX_BYTES).records
            offset = MAGIC_SIZE
            for record in records:
                if isinstance(record, Chunk):
                    chunks.append((record.message_start_time * 1e-9, offset))
                inside = breakup_chunk(record) if isinstance(record, Chunk) and not topics else [record]
                topics.update({one.id: one.topic for one in inside if isinstance(one, Channel)})
                offset = file.tell()
        return Index(topics, tuple(chunks))

    def last_s(self) -> float | None:
        """When the last tick was that can be read; None where there is none."""
        for start_s, _ in reversed(self.index.chunks):
            last_s = None
            for moment in self.moments(start_s):
                last_s = moment.unix_s
            if last_s is not None:
                return last_s
        return None

    def _vehicles(self, data: bytes) -> NDArray[np.void]:
        """Raises: ValueError when it does not fit."""
        table = np.frombuffer(b64decode(json.loads(data)["data"]), layout.VEHICLE)
        if len(table) != len(self.about.ids):
            raise ValueError(f"{len(table)} vehicles where the file names {len(self.about.ids)}")
        return table


def _plain(error: Exception) -> str:
    return f"{error}" or type(error).__name__
