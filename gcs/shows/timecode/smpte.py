"""SMPTE timecode: labels of frames, and the time that they mean. Pure."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from math import floor
from typing import Final

from gcs.model.errors import InvalidError

_LABEL: Final = re.compile(r"^(\d{1,2}):(\d{2}):(\d{2})(?:[:;](\d{2}))?$")
_DAY_H: Final = 24


class Rate(Enum):
    """Frames per second; the values up to 3 are those of MIDI timecode's two bits.

    23.976 and 29.97 (non-drop) have the labels of 24 and 30, and run slower by 1001/1000: no label says which
    of both it is, only a clock does.
    """

    FPS_24 = 0
    FPS_25 = 1
    FPS_29_97_DROP = 2
    FPS_30 = 3
    FPS_23_976 = 4
    FPS_29_97 = 5

    @property
    def midi(self) -> int:
        """The two bits by which MIDI timecode names it."""
        return _NOMINAL.get(self, self).value

    @property
    def pulled_down(self) -> "Rate":
        """The slower rate of the same labels; the rate itself where there is none."""
        return _PULLED_DOWN.get(self, self)

    @property
    def nominal(self) -> "Rate":
        """The faster rate of the same labels, or the rate itself."""
        return _NOMINAL.get(self, self)

    @property
    def day_s(self) -> float:
        """Time from 00:00:00:00 to the next one."""
        dropped = 2 * _DAY_H * 54 if self is Rate.FPS_29_97_DROP else 0
        return (_DAY_H * 3600 * self.frames - dropped) / self.per_s

    @property
    def frames(self) -> int:
        """Frames that a second's labels count."""
        return _RATES[self][0]

    @property
    def per_s(self) -> float:
        return _RATES[self][1]

    @property
    def text(self) -> str:
        return _RATES[self][2]


_NOMINAL: Final = {Rate.FPS_23_976: Rate.FPS_24, Rate.FPS_29_97: Rate.FPS_30}
_PULLED_DOWN: Final = {nominal: slower for slower, nominal in _NOMINAL.items()}
_RATES: Final[Mapping[Rate, tuple[int, float, str]]] = {
    Rate.FPS_24: (24, 24.0, "24"),
    Rate.FPS_25: (25, 25.0, "25"),
    Rate.FPS_29_97_DROP: (30, 30_000 / 1001, "29.97 drop"),
    Rate.FPS_30: (30, 30.0, "30"),
    Rate.FPS_23_976: (24, 24_000 / 1001, "23.976"),
    Rate.FPS_29_97: (30, 30_000 / 1001, "29.97"),
}
"""Frames of a second's labels, true frames per second, and words."""

PULL: Final = 1001 / 1000
"""How much longer frames of 23.976 and 29.97 last than those of 24 and 30."""

PULL_WITHIN: Final = 2.5e-4
"""A pace so near to either is it: clocks differ by less. Any other is followed as labelled."""


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
    """Return the frame at a time from 00:00:00:00; past a day, and before it, the days repeat."""
    number = floor(time_s * rate.per_s + 1e-6) % round(rate.day_s * rate.per_s)
    if rate is Rate.FPS_29_97_DROP:
        tens, rest = divmod(number, 17_982)  # frames of ten minutes
        number += 18 * tens + 2 * max(0, (rest - 2) // 1798)
    seconds, frames = divmod(number, rate.frames)
    return Label(seconds // 3600 % _DAY_H, seconds // 60 % 60, seconds % 60, frames)


def within_a_day(time_s: float, rate: Rate) -> float:
    """Return a difference of two timecodes as the shorter way round the day, from -12 h to 12 h."""
    half_s = rate.day_s / 2.0
    return (time_s + half_s) % rate.day_s - half_s


def parse_label(text: str) -> Label:
    """Read HH:MM:SS or HH:MM:SS:FF. Raises: InvalidError."""
    matched = _LABEL.match(text)
    label = None if matched is None else Label(*(int(part or 0) for part in matched.groups()))
    if label is None or not label.exists(Rate.FPS_30):
        raise InvalidError("timecode", text, "HH:MM:SS:FF")
    return label
