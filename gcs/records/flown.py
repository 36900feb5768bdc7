"""Flight data read back: tick by tick, as far as the file is whole."""

import json
import struct
from base64 import b64decode
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Footer, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray
from zstandard import ZstdError

from gcs.errors import GcsError
from gcs.lifecycle import Phase
from gcs.records import layout
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

    def _records(self) -> Iterator[McapRecord]:
        with self.path.open("rb") as file:
            yield from StreamReader(file, validate_crcs=True, record_size_limit=RECORD_MAX_BYTES).records

    def ticks(self) -> Iterator[Flown]:
        """Every recorded tick, in order; ends where the file does, which `cut` then tells."""
        self.cut = ""
        topics: dict[int, str] = {}
        vehicles: NDArray[np.void] | None = None
        status: Mapping[str, Any] | None = None
        last_s = None
        try:
            for record in self._records():
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                if not isinstance(record, Message):
                    continue
                topic = topics[record.channel_id]
                if topic == "/fleet/vehicles":
                    vehicles = self._vehicles(record.data)
                elif topic == "/fleet/status":
                    status = json.loads(record.data)
                elif topic == "/fleet/tick" and vehicles is not None and status is not None:
                    last_s = record.log_time * 1e-9
                    yield Flown(last_s, vehicles, json.loads(record.data), status)
        except _DAMAGED as error:
            after = "before the first tick" if last_s is None else f"after {last_s:.1f} (Unix time)"
            self.cut = f"the file is cut off or damaged {after}: {_plain(error)}"
        except OSError as error:
            self.cut = f"the file could not be read on: {error.strerror or error}"

    def _vehicles(self, data: bytes) -> NDArray[np.void]:
        """Raises: ValueError when it does not fit."""
        table = np.frombuffer(b64decode(json.loads(data)["data"]), layout.VEHICLE)
        if len(table) != len(self.about.ids):
            raise ValueError(f"{len(table)} vehicles where the file names {len(self.about.ids)}")
        return table


def _plain(error: Exception) -> str:
    return f"{error}" or type(error).__name__
