"""SMPTE timecode: labels of frames, and the time that they mean. Pure."""

import re
from dataclasses import dataclass
from enum import Enum
from typing import Final

from gcs.model.errors import InvalidError

_LABEL: Final = re.compile(r"^(\d{1,2}):(\d{2}):(\d{2})(?:[:;](\d{2}))?$")
_DAY_H: Final = 24


class Rate(Enum):
    """Frames per second; the values are those of MIDI timecode's two bits."""

    FPS_24 = 0
    FPS_25 = 1
    FPS_29_97_DROP = 2
    FPS_30 = 3

    @property
    def frames(self) -> int:
        """Frames that a second's labels count."""
        return _FRAMES[self]

    @property
    def per_s(self) -> float:
        return _PER_S[self]

    @property
    def text(self) -> str:
        return _TEXT[self]


_FRAMES: Final = {Rate.FPS_24: 24, Rate.FPS_25: 25, Rate.FPS_29_97_DROP: 30, Rate.FPS_30: 30}
_PER_S: Final = {Rate.FPS_24: 24.0, Rate.FPS_25: 25.0, Rate.FPS_29_97_DROP: 30_000 / 1001, Rate.FPS_30: 30.0}
_TEXT: Final = {Rate.FPS_24: "24", Rate.FPS_25: "25", Rate.FPS_29_97_DROP: "29.97 drop", Rate.FPS_30: "30"}


@dataclass(frozen=True, slots=True)
class Label:
    """Name of a frame."""

    hours: int
    minutes: int
    seconds: int
    frames: int

    def __str__(self) -> str:
        return f"{self.hours:02d}:{self.minutes:02d}:{self.seconds:02d}:{self.frames:02d}"

    def exists(self, rate: Rate) -> bool:
        """Whether this frame exists: drop-frame leaves two out in each minute but every tenth."""
        fits = self.hours < _DAY_H and self.minutes < 60 and self.seconds < 60 and self.frames < rate.frames
        dropped = self.seconds == 0 and self.frames < 2 and self.minutes % 10 != 0
        return fits and not (rate is Rate.FPS_29_97_DROP and dropped)

    def time_s(self, rate: Rate) -> float:
        """Time in s from 00:00:00:00 to where the frame begins, at the rate's true speed."""
        minutes = 60 * self.hours + self.minutes
        number = (60 * minutes + self.seconds) * rate.frames + self.frames
        if rate is Rate.FPS_29_97_DROP:
            number -= 2 * (minutes - minutes // 10)
        return number / rate.per_s


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading of a source.

    Attributes:
        time_s: the timecode's, from 00:00:00:00.
        age_s: how long before its arrival this was so, as far as the source knows.
        runs: False: the source says where it stands, and does not run.
    """

    time_s: float
    rate: Rate
    age_s: float = 0.0
    runs: bool = True


def label_at(time_s: float, rate: Rate) -> Label:
    """Return the frame at a time from 00:00:00:00; past a day it begins again."""
    number = int(time_s * rate.per_s + 1e-6) % round(_DAY_H * 3600 * rate.per_s)
    if rate is Rate.FPS_29_97_DROP:
        tens, rest = divmod(number, 17_982)  # frames of ten minutes
        number += 18 * tens + 2 * max(0, (rest - 2) // 1798)
    seconds, frames = divmod(number, rate.frames)
    return Label(seconds // 3600 % _DAY_H, seconds // 60 % 60, seconds % 60, frames)


def parse_label(text: str) -> Label:
    """Read HH:MM:SS or HH:MM:SS:FF. Raises: InvalidError."""
    matched = _LABEL.match(text)
    label = None if matched is None else Label(*(int(part or 0) for part in matched.groups()))
    if label is None or not label.exists(Rate.FPS_30):
        raise InvalidError("timecode", text, "HH:MM:SS:FF")
    return label
