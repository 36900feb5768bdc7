"""Reads fixes out of what gpsd sends: lines of JSON, of which TPV are reports of a receiver. Pure.

Source: gpsd_json(5). It guesses that the error estimates of a TPV are of 95 % confidence, and warns that
receivers differ. GST, of receivers that report it, has standard deviations, and counts instead.
"""

import json
import re
from math import inf, nan
from typing import Any, Final, NamedTuple

from gcs.links.targets.numbers import (
    ALTITUDE_M,
    SPEED_MAX_M_S,
    Names,
    deviation,
    first_known,
    utc_s,
    velocity,
    why_nowhere,
    wider,
    within,
)
from gcs.model.errors import cut
from gcs.model.target_fix import TargetFix

WATCH: Final = b'?WATCH={"enable":true,"json":true}\n'
"""What gpsd is asked."""

LONGEST_BYTES: Final = 16_384
"""gpsd cuts its own lines after 10,240 characters."""

GST_AGE_MAX_S: Final = 5.0
CLIMB_DEVIATION_MAX_M_S: Final = 5.0
"""A less certain climb is a difference of two heights, by gpsd itself."""

_OF_95: Final = 1.0 / 1.96
_OF_95_AROUND: Final = 1.0 / 2.448
"""Along each of two axes, where the circle has 95 %."""

_FLAT: Final = re.compile(
    rb'^\{(?=[^\n]*"(?:TPV|GST|ERROR|VERSION)")[^\n{}\[\]]{14,%d}+\}\r?$' % LONGEST_BYTES, re.MULTILINE
)
"""A line with an object that has no part of its own, of a class that counts: it cannot be nested deeply."""


class _Noise(NamedTuple):
    """Standard deviations."""

    sideways_m: float = nan
    height_m: float = nan


class GpsdStream:
    """Fixes of one connection to gpsd; with `device` of that receiver alone.

    Attributes:
        messages: objects of gpsd so far.
        why: why the newest bytes brought no fix; empty: they did.
    """

    def __init__(self, device: str = "") -> None:
        self.messages = 0
        self.why = ""
        self._device, self._others = device, Names()
        self._waiting = b""
        self._too_long = False
        self._newest: dict[str, Any] = {}
        self._noise, self._noise_s = _Noise(), -inf  # of GST, and when it arrived

    def take(self, data: bytes, now_s: float) -> list[TargetFix]:
        """The fixes that `data` completes. Never raises."""
        self.why = ""
        lines, ended, rest = (self._waiting + data).rpartition(b"\n")
        if self._too_long and ended:
            lines, self._too_long = lines.partition(b"\n")[2], False
        self.messages += lines.count(b'"class":')
        if b'"devices":[]' in lines:
            self.why = "gpsd has no receiver"
        fixes = [fix for line in _FLAT.finditer(lines) for fix in self._take(line[0], now_s)]
        self._too_long = self._too_long or len(rest) > LONGEST_BYTES
        if self._too_long:
            self.why = f"a line of more than {LONGEST_BYTES} bytes"
        self._waiting = b"" if self._too_long else rest
        return fixes

    def _take(self, line: bytes, now_s: float) -> list[TargetFix]:
        try:
            report = json.loads(line)
        except ValueError:
            return []
        match report.get("class"):
            case "ERROR":
                self.why = f"gpsd answers: {cut(str(report.get('message')))}"
            case "VERSION" if report.get("proto_major") != 3:
                self.why = f"protocol {cut(str(report.get('proto_major')))} of gpsd is not known, 3 is"
            case "GST" if self._device in {"", report.get("device")}:
                sideways = wider(deviation(report.get("lat")), deviation(report.get("lon")))
                self._noise, self._noise_s = _Noise(sideways, deviation(report.get("alt"))), now_s
            case "TPV":
                return self._take_report(report, now_s)
        return []

    def _take_report(self, report: dict[str, Any], now_s: float) -> list[TargetFix]:
        device, mode = str(report.get("device", "")), report.get("mode")
        if self._device not in {"", device}:
            self._others.add(device)
            self.why = f"unknown device {self._device}, seen: {self._others}"
            return []
        if mode not in {2, 3}:
            self.why = f"no fix: mode {cut(str(mode))} of {cut(device)}"
            return []
        self.why = why_nowhere(report.get("lat"), report.get("lon"))
        noise = self._noise if now_s - self._noise_s <= GST_AGE_MAX_S else _Noise()
        return [] if self.why or self._repeats(report) else [_fix(report, noise, now_s)]

    def _repeats(self, report: dict[str, Any]) -> bool:
        """Whether an earlier report of this time and device has as much: gpsd sends some in parts."""
        newest, self._newest = self._newest, report
        same = all(report.get(key) == newest.get(key) is not None for key in ("time", "device"))
        return same and report.keys() <= newest.keys()


def _fix(report: dict[str, Any], noise: _Noise, now_s: float) -> TargetFix:
    solid = report["mode"] == 3
    north_m_s, east_m_s = velocity(report.get("speed"), report.get("track"))
    climb_m_s = within(report.get("climb"), -SPEED_MAX_M_S, SPEED_MAX_M_S)
    certain = not deviation(report.get("epc"), _OF_95) > CLIMB_DEVIATION_MAX_M_S
    return TargetFix(
        now_s,
        within(report["lat"], -90.0, 90.0),
        within(report["lon"], -180.0, 180.0),
        within(report.get("altMSL"), *ALTITUDE_M) if solid else nan,
        north_m_s,
        east_m_s,
        -climb_m_s if solid and certain else nan,
        first_known(
            noise.sideways_m,
            wider(deviation(report.get("epx"), _OF_95), deviation(report.get("epy"), _OF_95)),
            deviation(report.get("eph"), _OF_95_AROUND),
        ),
        first_known(noise.height_m, deviation(report.get("epv"), _OF_95)) if solid else nan,
        deviation(report.get("eps"), _OF_95),
        utc_s(report.get("time")),
    )
