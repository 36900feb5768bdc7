"""Linear timecode: frames of 80 bits in biphase mark, out of samples of sound. Pure.

Source: SMPTE ST 12-1. Each bit begins with a change of sign, a one has another in its middle.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.shows.timecode.smpte import PULL_WITHIN, Label, Rate, Reading

BITS: Final = 80
SYNC: Final = 0b1011111111111100
"""The last 16 bits of a frame, the last of them highest."""

_LEAST_LEVEL: Final = 0.01
"""Of full scale: what is quieter is silence."""

_HYSTERESIS: Final = 0.2
"""Of the level: a change of sign must go so far beyond zero."""

_FORGETS: Final = 0.05
"""Share by which the level follows quieter sound, per call."""

_RECENT: Final = 64
"""Changes of sign among which at least one bit is a zero, whose length is that of a bit."""

_SLOWEST_PER_S, _FASTEST_PER_S = 0.8 * 24 * BITS, 1.25 * 30 * BITS
"""Bits per second."""

_CHANGES_SPARE: Final = 16
"""A one has two changes of sign, at the fastest rate; a click may add some."""

_RATES: Final = (Rate.FPS_24, Rate.FPS_25, Rate.FPS_30)

_MEASURED: Final = 25
"""Frames over which the rate is measured: at 29.97 one is 1.6 samples of 48 kHz longer than at 30."""


@dataclass(slots=True)
class LinearTimecode:
    """Reads timecode out of sound; forwards only.

    Attributes:
        sample_rate_hz: of the sound.
        garbage: frames that make no sense.
    """

    sample_rate_hz: float
    garbage: int = 0
    _level: float = 0.0
    _high: bool = False
    _sample: int = 0  # number of the next
    _edge: float = 0.0  # sample of the newest change of sign, between two
    _before: float = 0.0  # the newest sample
    _recent: deque[float] = field(default_factory=lambda: deque(maxlen=_RECENT))  # between changes, samples
    _half: bool = False  # the newest change was in the middle of a one
    _bits: int = 0  # the newest 80, the newest highest
    _count: int = 0  # of bits without an error
    _lengths: deque[float] = field(default_factory=lambda: deque(maxlen=BITS))  # of these bits, in samples
    _frames: deque[float] = field(default_factory=lambda: deque(maxlen=_MEASURED))  # lengths, in samples

    def take(self, samples: NDArray[np.float64]) -> list[Reading]:
        """The readings that (k,) samples from -1 to 1 complete. What is not finite is silence."""
        sound = np.nan_to_num(np.clip(samples, -1.0, 1.0), nan=0.0)
        if len(sound) == 0:
            return []
        peak = float(np.abs(sound).max())
        self._level = peak if peak > self._level else self._level + _FORGETS * (peak - self._level)
        readings: list[tuple[float, Reading]] = []
        if self._level > _LEAST_LEVEL:
            self._changes(sound, readings)
        self._sample += len(sound)
        self._before = float(sound[-1])
        return [
            Reading(reading.time_s, reading.rate, age_s=(self._sample - at) / self.sample_rate_hz)
            for at, reading in readings
        ]

    def _changes(self, sound: NDArray[np.float64], readings: list[tuple[float, Reading]]) -> None:
        """Take the changes of sign: of more than timecode can have, none."""
        far = np.flatnonzero(np.abs(sound) > _HYSTERESIS * self._level)
        high = sound[far] > 0.0
        changed = high != np.concatenate([[self._high], high[:-1]])
        if len(high):
            self._high = bool(high[-1])
        at = far[changed]
        if len(at) > _CHANGES_SPARE + 2.0 * _FASTEST_PER_S * len(sound) / self.sample_rate_hz:
            self._lose()
            self._recent.clear()
            self.garbage += 1
            return
        # the zero before the sample that is far enough beyond it
        whole = np.concatenate([[self._before], sound])
        for end, up in zip(at.tolist(), high[changed].tolist(), strict=True):
            place = end + 1
            while place > 1 and (whole[place - 1] > 0.0) is bool(up):
                place -= 1
            before, after = float(whole[place - 1]), float(whole[place])
            share = before / (before - after) if before != after else 0.0
            self._change(self._sample + place - 2 + min(max(share, 0.0), 1.0), readings)

    def _change(self, edge: float, readings: list[tuple[float, Reading]]) -> None:
        """Take one change of sign."""
        length, self._edge = edge - self._edge, edge
        fastest, slowest = self.sample_rate_hz / _FASTEST_PER_S, self.sample_rate_hz / _SLOWEST_PER_S
        if not 0.35 * fastest < length < 1.5 * slowest:
            self._lose()
            self._recent.clear()
            return
        self._recent.append(length)
        if length < 0.75 * max(self._recent):
            self._half = not self._half
            if self._half:
                self._lengths.append(length)
                return
            self._lengths[-1] += length
            self._bit(1, edge, readings)
        elif self._half:  # a half without its other half: the bits were cut wrongly
            self._lose()
        else:
            self._lengths.append(length)
            self._bit(0, edge, readings)

    def _lose(self) -> None:
        self._half, self._count = False, 0
        self._lengths.clear()
        self._frames.clear()

    def _bit(self, bit: int, edge: float, readings: list[tuple[float, Reading]]) -> None:
        self._bits = self._bits >> 1 | bit << BITS - 1
        self._count += 1
        if self._count >= BITS and self._bits >> BITS - 16 == SYNC:
            reading = self._frame(sum(self._lengths))
            if reading is None:
                self.garbage += 1
            else:
                readings.append((edge, reading))

    def _frame(self, samples: float) -> Reading | None:
        """The frame of the newest 80 bits, which took so many samples; None: there is none of this name."""

        def field_of(first: int, bits: int) -> int:
            return self._bits >> first & (1 << bits) - 1

        units = [field_of(first, 4) for first in (48, 32, 16, 0)]
        tens = [field_of(first, bits) for first, bits in ((56, 2), (40, 3), (24, 3), (8, 2))]
        if max(units) > 9:
            return None
        label = Label(*(10 * ten + unit for ten, unit in zip(tens, units, strict=True)))
        rate = Rate.FPS_29_97_DROP if field_of(10, 1) else self._rate(samples)
        if not label.exists(rate):
            return None
        return Reading(label.time_s(rate) + 1.0 / rate.per_s, rate)  # the frame is over now

    def _rate(self, samples: float) -> Rate:
        """The rate of a frame of so many samples: exactly, once enough frames were measured."""
        self._frames.append(samples)
        per_s = self.sample_rate_hz / samples
        rate = min(_RATES, key=lambda nominal: abs(nominal.per_s - per_s))
        if len(self._frames) < _MEASURED:
            return rate
        per_s, slower = self.sample_rate_hz * len(self._frames) / sum(self._frames), rate.pulled_down
        return slower if abs(per_s / slower.per_s - 1.0) <= PULL_WITHIN else rate
