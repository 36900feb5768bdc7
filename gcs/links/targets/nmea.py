"""Reads fixes out of NMEA 0183, of any talker: GGA, GNS, RMC, VTG and GST. Pure.

Sentences of one time are one fix. It is complete with the kinds of sentences that the time before had, or
when the next time begins, so a fix seldom waits for the next second. VTG has no time of its own.
"""

import re
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import date
from functools import reduce
from math import isfinite, nan
from operator import xor
from typing import Final, NamedTuple

from gcs.links.targets.numbers import (
    ALTITUDE_M,
    SPEED_MAX_M_S,
    deviation,
    first_known,
    velocity,
    why_nowhere,
    wider,
    within,
)
from gcs.model.errors import cut
from gcs.model.target_fix import TargetFix

LONGEST_BYTES: Final = 130
"""A sentence has 82 characters by the standard; receivers with many digits send longer ones."""

LATE_S: Final = 5.0
"""A sentence of a time that is earlier by up to this is late; an earlier one is of a clock that was set."""

_SENTENCE: Final = re.compile(
    rb"\$[A-Z]{2}(GGA|GNS|RMC|VTG|GST),([\x20-\x23\x25-\x29\x2b-\x7e]{8,120}+)\*([0-9A-Fa-f]{2})"
)
_TIME: Final = re.compile(r"([01]\d|2[0-3])([0-5]\d)([0-5]\d|60)(\.\d{1,9})?", re.ASCII)
_DATE: Final = re.compile(r"(\d\d)(\d\d)(\d\d)", re.ASCII)
_ANGLE: Final = re.compile(r"(\d{1,3})(\d\d(?:\.\d{1,12})?)", re.ASCII)
_KNOT_M_S: Final = 1852.0 / 3600.0
_DAY_S: Final = 86_400.0
_BEGIN: Final = date(1970, 1, 1).toordinal()


class _Quality(NamedTuple):
    name: str
    range_error_m: float = nan
    """Of one satellite; HDOP times this is the deviation. NaN: such a fix does not count."""


_NO_FIX, _MANUAL, _SIMULATED = _Quality("no fix"), _Quality("typed in"), _Quality("simulated")
_ALONE, _CORRECTED = _Quality("autonomous", 3.0), _Quality("differential", 1.0)
_FIXED, _FLOAT = _Quality("RTK fixed", 0.05), _Quality("RTK float", 0.3)
_ESTIMATED: Final = _Quality("dead reckoning", 10.0)

_OF_GGA: Final = dict(
    zip(
        "012345678",
        (_NO_FIX, _ALONE, _CORRECTED, _ALONE, _FIXED, _FLOAT, _ESTIMATED, _MANUAL, _SIMULATED),
        strict=True,
    )
)
_OF_MODE: Final = dict(
    zip(
        "SMEAPDFRN",
        (_SIMULATED, _MANUAL, _ESTIMATED, _ALONE, _ALONE, _CORRECTED, _FLOAT, _FIXED, _NO_FIX),
        strict=True,
    )
)
"""By the mode of GNS and RMC. GNS has one of each constellation: the worst counts, of those that are used."""


@dataclass(slots=True)
class _Epoch:
    """What sentences of one time report."""

    time_s: float  # of the day
    arrived_s: float
    day: int  # since 1970, as far as is known
    kinds: set[str] = field(default_factory=set)
    latitude_deg: float = nan
    longitude_deg: float = nan
    altitude_m: float = nan
    velocity_m_s: tuple[float, float] = (nan, nan)
    by_dilution_m: float = nan
    by_noise_m: float = nan  # of GST
    height_deviation_m: float = nan
    refused: str = ""  # why this is no fix
    ended: bool = False  # given, or refused

    def take(self, kind: str, fields: list[str]) -> None:
        self.kinds.add(kind)
        fields += [""] * 12
        match kind:
            case "GGA":
                self._take_quality(
                    f"GGA quality {cut(fields[5])}", _OF_GGA.get(fields[5], _NO_FIX), fields[7]
                )
                self._take_place(kind, fields[1:5], fields[8] if fields[9] == "M" else "")
            case "GNS":
                if fields[5] or fields[1]:  # neither: it is of a further constellation
                    worst = next((_OF_MODE[mode] for mode in _OF_MODE if mode in fields[5]), _NO_FIX)
                    self._take_quality(f"GNS mode {cut(fields[5])}", worst, fields[7])
                    self._take_place(kind, fields[1:5], fields[8])
            case "RMC":
                self._take_rmc(fields)
            case "VTG":
                self._take_velocity(fields[4] if fields[5] == "N" else "", fields[0])
            case _:
                self.by_noise_m = wider(deviation(fields[5]), deviation(fields[6]))
                self.height_deviation_m = deviation(fields[7])

    def _take_rmc(self, fields: list[str]) -> None:
        if fields[1] != "A":
            self.refused = self.refused or f"no fix: RMC status {cut(fields[1])}"
        if fields[11]:
            self._take_quality(f"RMC mode {cut(fields[11])}", _OF_MODE.get(fields[11], _NO_FIX), "")
        self._take_place("RMC", fields[2:6], "")
        self._take_velocity(fields[6], fields[7])
        if (written := _DATE.fullmatch(fields[8])) is not None:
            day, month, year = (int(part) for part in written.groups())
            with suppress(ValueError):  # a day that does not exist
                self.day = date(2000 + year, month, day).toordinal() - _BEGIN

    def _take_quality(self, name: str, quality: _Quality, dilution: str) -> None:
        if not isfinite(quality.range_error_m):
            self.refused = self.refused or f"no fix: {name} ({quality.name})".replace("  ", " ")
        self.by_dilution_m = first_known(deviation(dilution, quality.range_error_m), self.by_dilution_m)

    def _take_place(self, kind: str, fields: list[str], altitude: str) -> None:
        if self.refused or not any(fields) or (isfinite(self.latitude_deg) and kind == "RMC"):
            return  # the place of RMC is that of GGA, and has no height
        latitude, north, longitude, east = fields
        latitude_deg = _angle_deg(latitude, {"N": 1.0, "S": -1.0}.get(north, nan))
        longitude_deg = _angle_deg(longitude, {"E": 1.0, "W": -1.0}.get(east, nan))
        if why := why_nowhere(latitude_deg, longitude_deg):
            self.refused = f"{kind} {cut(','.join(fields))}: {why}"
        self.latitude_deg, self.longitude_deg = latitude_deg, longitude_deg
        self.altitude_m = within(altitude, *ALTITUDE_M)

    def _take_velocity(self, speed_knots: str, course: str) -> None:
        speed_m_s = _KNOT_M_S * within(speed_knots, 0.0, SPEED_MAX_M_S / _KNOT_M_S)
        if not isfinite(self.velocity_m_s[0]):
            self.velocity_m_s = velocity(speed_m_s, course)

    def fix(self) -> TargetFix | None:
        """None: it is none, and `refused` says why."""
        self.ended = True
        if not self.refused and not isfinite(self.latitude_deg):
            self.refused = f"no position in {', '.join(sorted(self.kinds))}"
        if self.refused:
            return None
        north_m_s, east_m_s = self.velocity_m_s
        return TargetFix(
            self.arrived_s,
            self.latitude_deg,
            self.longitude_deg,
            self.altitude_m,
            north_m_s,
            east_m_s,
            deviation_m=first_known(self.by_noise_m, self.by_dilution_m),
            height_deviation_m=self.height_deviation_m,
            source_s=self.day * _DAY_S + self.time_s,
        )


class NmeaStream:
    """Fixes of one stream.

    Attributes:
        messages: correct sentences so far.
        why: why the newest bytes brought no fix; empty: they did.
    """

    def __init__(self) -> None:
        self.messages = 0
        self.why = ""
        self._waiting = b""
        self._expected: set[str] = set()
        self._epoch = _Epoch(nan, nan, 0, ended=True)

    def take(self, data: bytes, now_s: float) -> list[TargetFix]:
        """The fixes that `data` completes. Never raises."""
        self.why = ""
        waiting, at, fixes = self._waiting + data, 0, []
        for sentence in _SENTENCE.finditer(waiting):
            at = sentence.end()
            fixes += self._take(sentence, now_s)
        begin = waiting.rfind(b"$", max(at, len(waiting) - LONGEST_BYTES))
        self._waiting = waiting[begin:] if begin >= 0 else b""
        return fixes

    def _take(self, sentence: re.Match[bytes], now_s: float) -> list[TargetFix]:
        kind, *fields = sentence[0][3:-3].decode("ascii").split(",")
        if reduce(xor, sentence[0][1:-3]) != int(sentence[3], 16):
            self.why = f"the checksum of {kind} is wrong"
            return []
        self.messages += 1
        if kind == "VTG":
            return [] if self._epoch.ended and not self._epoch.kinds else self._add(kind, fields)
        time_s = _time_s(fields[0])
        if not isfinite(time_s):
            timeless = _Epoch(nan, now_s, 0)
            timeless.take(kind, fields)
            self.why = timeless.refused or f"{kind} without a time"
            return []
        if time_s == self._epoch.time_s:
            return self._add(kind, fields)
        step_s = (time_s - self._epoch.time_s + _DAY_S / 2) % _DAY_S - _DAY_S / 2
        if -LATE_S <= step_s < 0.0:
            return []
        closed = self._give() if not self._epoch.ended else []
        self._expected = self._epoch.kinds
        midnight = step_s > 0.0 and time_s < self._epoch.time_s
        self._epoch = _Epoch(time_s, now_s, self._epoch.day + midnight)
        return closed + self._add(kind, fields)

    def _add(self, kind: str, fields: list[str]) -> list[TargetFix]:
        self._epoch.take(kind, fields)
        complete = self._expected and self._epoch.kinds >= self._expected
        return self._give() if complete and not self._epoch.ended else []

    def _give(self) -> list[TargetFix]:
        fix = self._epoch.fix()
        self.why = self._epoch.refused
        return [fix] if fix is not None else []


def _time_s(text: str) -> float:
    """Seconds of the day of hhmmss.sss; NaN: it is no time."""
    if (time := _TIME.fullmatch(text)) is None:
        return nan
    return 3600.0 * int(time[1]) + 60.0 * int(time[2]) + float(f"{time[3]}{time[4] or ''}")


def _angle_deg(text: str, sign: float) -> float:
    """Degrees of dddmm.mmmm; NaN: it is no angle."""
    angle = _ANGLE.fullmatch(text)
    return nan if angle is None else sign * (int(angle[1]) + within(angle[2], 0.0, 59.999999999999) / 60.0)
