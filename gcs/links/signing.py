"""Signing on a link: the key's file, the newest signing time beside it, and the filter for frames."""

import logging
import os
from collections import Counter
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import InitVar, dataclass
from pathlib import Path
from threading import Event, Thread
from time import time as wall_time_s
from typing import Final

import numpy as np

from gcs.links.link import Address, Counters
from gcs.links.signing_key import load_key, reserve, stored, time_file
from gcs.mavlink.codec import Frames, frame, joined
from gcs.mavlink.framing import RADIO, RADIO_STATUS, Frame, Judgement, Signer
from gcs.mavlink.kernels import BEGIN, DATAGRAM, MAGIC_2, MESSAGE, SIGNED, SYSTEM, Bytes, Whole
from gcs.mavlink.signing_time import KEY_BYTES, UNITS_PER_S, signing_time
from gcs.model.errors import ConfigError, LinkError
from gcs.model.state import Mask

log = logging.getLogger(__name__)

_AHEAD_UNITS: Final = 60 * UNITS_PER_S
"""The file holds a time in the future, so that no signing time is used again after a crash."""

_LOOK_S: Final = 1.0

WRONG_MAX: Final = 64
"""Refused frames of one sender in a read, from which on its frames are refused unread."""


def create_key(path: Path) -> None:
    """Write a new key, in hex, readable for its owner only. Raises: ConfigError; it overwrites nothing."""
    try:
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be made: {error.strerror}") from None
    with os.fdopen(file, "w", encoding="ascii") as opened:
        opened.write(os.urandom(KEY_BYTES).hex() + "\n")


class Signing:
    """A signer whose time outlasts the process.

    `open` and `close` wait for a disk: one after the other, on any thread but the loop's.
    """

    def __init__(
        self, key_file: Path, link_id: int, *, wall_clock: Callable[[], float] = wall_time_s
    ) -> None:
        """Read the key. Raises: ConfigError."""
        self._link_id = link_id
        self._wall_clock = wall_clock
        self._file = time_file(key_file, link_id)
        self.signer = Signer(load_key(key_file), link_id, start=0, clock=self._now)
        self._reserved = 0
        self._failed = False
        self._closed = Event()
        self._keeper: Thread | None = None

    def open(self) -> None:
        """Continue where the last process ended. Raises: LinkError when the file cannot be used."""
        start = max(self.signer.time, stored(self._file), self._now())
        try:
            self._reserve(start + _AHEAD_UNITS)
        except OSError as error:
            raise LinkError(f"{self._file}: the time of signatures cannot be kept: {error}") from error
        self.signer.begin(start)
        self._closed.clear()
        self._keeper = Thread(target=self._keep, name=f"signing/{self._link_id}", daemon=True)
        self._keeper.start()

    def close(self) -> None:
        """End signing; the next process may continue from this time."""
        if self._keeper is not None:
            self._closed.set()
            self._keeper.join()
            self._keeper = None
            with suppress(OSError):  # the file then holds a later time, which is also correct
                self._reserve(self.signer.time)

    def _now(self) -> int:
        return signing_time(self._wall_clock())

    def _keep(self) -> None:
        while not self._closed.wait(_LOOK_S):
            if self.signer.time > self._reserved - _AHEAD_UNITS // 2:
                try:
                    self._reserve(self.signer.time + _AHEAD_UNITS)
                except OSError as error:
                    if not self._failed:  # the flight continues, and so does the time in this process
                        log.error("signing_time_not_kept", extra={"cause": str(error)})
                    self._failed = True
                else:
                    self._failed = False

    def _reserve(self, time: int) -> None:
        self._reserved = reserve(self._file, time)


@dataclass(eq=False)
class SignatureFilter:
    """Judges received frames, and signs sent ones. Only links with a key have one."""

    name: str
    signing: Signing
    system_ids: InitVar[Collection[int]]
    address_of: Callable[[int], Address]
    counters: Counters

    def __post_init__(self, system_ids: Collection[int]) -> None:
        self._is_ours: Mask = np.zeros(256, np.bool_)
        self._is_ours[list(system_ids)] = True
        self._refused: set[tuple[int, Judgement]] = set()

    def are_signed(self, data: Bytes, frames: Whole, source: Whole) -> Mask:
        """(k,) which of the frames found in `data` have a signature, or need none: they are not ours.

        `source` (m,) of each datagram. To be called before `accepted`, which costs more.
        """
        begin = frames[:, BEGIN]
        has_signature = (data[begin] == MAGIC_2) & (data[begin + 2] & SIGNED != 0)
        refused = self._is_ours[frames[:, SYSTEM]] & ~has_signature
        if refused.any():
            counted = np.flatnonzero(
                refused & ~np.isin(frames[:, MESSAGE], (RADIO_STATUS, RADIO))
            )  # radios have no key
            self.counters.unsigned += len(counted)
            systems, firsts = np.unique(frames[counted, SYSTEM], return_index=True)
            for system_id, at in zip(systems.tolist(), counted[firsts].tolist(), strict=True):
                self._log(system_id, Judgement.UNSIGNED, int(source[frames[at, DATAGRAM]]))
        signed: Mask = ~refused
        return signed

    def accepted(self, data: Bytes, frames: Whole, source: Whole) -> Mask:
        """(k,) which of the frames of `are_signed` are accepted.

        What a sender sends behind its `WRONG_MAX` refused ones of a read is refused unread, as wrong.
        """
        accepted: Mask = np.ones(len(frames), np.bool_)
        wrong: Counter[int] = Counter()
        for at in np.flatnonzero(self._is_ours[frames[:, SYSTEM]]).tolist():
            sender = int(source[frames[at, DATAGRAM]])
            if wrong[sender] >= WRONG_MAX:
                self.counters.wrongly_signed += 1
                accepted[at] = False
                continue
            accepted[at] = self._is_accepted(frame(data, frames[at].tolist()), sender)
            wrong[sender] += not accepted[at]
        return accepted

    def is_signed(self, received: Frame) -> bool:
        """Whether a frame of another station comes from a holder of the key."""
        return self.signing.signer.judge(received) is Judgement.GOOD

    def signed(self, frames: Frames) -> Frames:
        """The frames with signatures; length 0 where the CRC extra byte of the message is unknown."""
        raws = [
            self.signing.signer.sign(data[:length].tobytes()) or b""
            for data, length in zip(frames.data, frames.length.tolist(), strict=True)
        ]
        return joined(raws)

    def _is_accepted(self, received: Frame, source: int) -> bool:
        judgement = self.signing.signer.judge(received)
        if judgement is Judgement.GOOD:
            return True
        self.counters.wrongly_signed += judgement is Judgement.WRONG
        self.counters.replayed += judgement is Judgement.REPLAYED
        self._log(received.system_id, judgement, source)
        return False

    def _log(self, system_id: int, judgement: Judgement, source: int) -> None:
        if (system_id, judgement) not in self._refused:
            self._refused.add((system_id, judgement))
            about = {"link": self.name, "system_id": system_id}
            about |= {"address": str(self.address_of(source)), "cause": judgement.name.lower()}
            log.error("signature_refused", extra=about)
