"""How far each vehicle's height is from that of its own satellite receiver, compared with the others'. Pure.

An autopilot estimates its height mostly by one sensor. One that follows its barometer is off by its scale and
drift; its receiver's altitude is not. The estimated minus the received altitude has an offset of its own from
the first fix, so that only its change since the vehicle stood counts. What all vehicles have in common
(satellites, weather, one scale) endangers no pair, and is taken away. Decision 0057: what this can show.
"""

from dataclasses import dataclass
from math import ceil, floor
from typing import Final

import numpy as np

from gcs.model.settings import Positive, Settings
from gcs.model.state import Array, Mask, Telemetry

PERIOD_S: Final = 1.0
"""Interval between two samples."""

WINDOW: Final = 60
"""Samples of the exponential mean, and at most as many of the reference on the ground."""

RECENT: Final = 4.0
"""Samples of the mean for landings: a drift of the last minute counts as well."""

REFERENCE_MIN, NOW_MIN = 3, 5
"""Least samples of the reference, and of the mean that is compared with it."""

CORRELATION: Final = 10.0
"""Samples between independent ones. Recorded of PX4: 0.5 m in a sample, 0.3 m in means of 20."""

OWN_SHARE: Final = 0.1
"""Of the reported vertical accuracy, what wanders slowly and is not common to receivers on one field."""

LEVEL_M_S: Final = 0.3
"""A vehicle that climbs or descends faster gives no sample: its receiver's altitude is up to a second old."""

NOISE_MIN_M: Final = 0.05

KEEPS: Final = 0.7
"""A named vehicle stays named down to this share of the limits."""

WIDEST_M: Final = 5.0
"""A greater difference counts as this: a vehicle far off is landed, and does not scatter the fleet."""

QUARTILE_ERROR: Final = 1.36
"""Standard error of a quartile of n normal differences, in that of one, times sqrt(n); of few, that of one.

sqrt(p (1 - p)) / f(q) with p = 0.25, where f is the normal density at that quartile.
"""

SCALED_ABOVE_M: Final = 5.0
"""Mean height from which the difference is given as a share of the height as well."""


class HeightSettings(Settings):
    """The difference of heights above which a vehicle is named, and kept farther from others."""

    bias_max_m: Positive = 1.0
    """Difference of the reported height from the receiver's, less the others', that is named, in m."""
    scale_max: Positive = 0.03
    """The difference that is named as a share of the height, where it is half of `bias_max_m` or more."""
    deviations: Positive = 4.0
    """A difference is named only beyond so many of its standard errors."""


@dataclass(frozen=True, slots=True, eq=False)
class HeightBias:
    """Of n vehicles. NaN: not known. Owns its arrays.

    Attributes:
        bias_m: (n,) by how much it reports more height than it has, compared with the others.
        error_m: (n,) standard error of that.
        scale: (n,) the same as a share of the height; NaN near the ground.
        named: (n,) whether it is above the limits.
    """

    bias_m: Array
    error_m: Array
    scale: Array
    named: Mask

    @staticmethod
    def unknown(n: int) -> "HeightBias":
        """Nothing is known."""
        unknown = np.full(n, np.nan)
        return HeightBias(unknown, unknown, unknown, np.zeros(n, np.bool_))

    def in_words(self, row: int) -> str:
        """How far that vehicle is from the height that it reports."""
        off_m, scale = float(self.bias_m[row]), float(self.scale[row])
        side = "below" if off_m > 0.0 else "above"
        share = "" if np.isnan(scale) else f" ({abs(scale):.1%} of its height)"
        return f"{abs(off_m):.1f} m{share} {side} what it reports, by its receiver and the others"

    def widening_m(self, deviations: float, up_share: float) -> Array:
        """(n,) what to add to standard deviations sideways: a pair's reserve up grows by both differences.

        That takes sqrt(2) b / (deviations up_share), because the reserve adds squares, of a pair with equal
        deviations.

        Args:
            deviations: `Floor.deviations`.
            up_share: `Floor.vertical_uncertainty`.
        """
        wide_m = np.minimum(np.abs(np.nan_to_num(self.bias_m)), WIDEST_M)
        return np.where(self.named, np.sqrt(2.0) * wide_m / (deviations * up_share), 0.0)


@dataclass(slots=True, eq=False)
class _Moments:
    """Of n vehicles: samples, and means of the difference, the height, their squares and their product."""

    count: Array  # (n,)
    means: Array  # (5, n)

    @staticmethod
    def none(n: int) -> "_Moments":
        return _Moments(np.zeros(n), np.zeros((5, n)))

    def add(self, rows: Mask, sample: Array) -> None:
        """Take the (5, n) sample of these rows (n,)."""
        self.count[rows] = np.minimum(self.count[rows] + 1.0, WINDOW)
        self.means[:, rows] += (sample - self.means)[:, rows] / self.count[rows]

    def forget(self, rows: Mask) -> None:
        self.count[rows] = 0.0

    @property
    def noise_m2(self) -> Array:
        """(n,) variance of the difference, without what a line over the height explains."""
        off_m, height_m, off_m2, height_m2, product = self.means
        spread_m2, along = height_m2 - height_m**2, product - off_m * height_m
        explained_m2 = np.where(spread_m2 > 1.0, along**2 / np.maximum(spread_m2, 1.0), 0.0)
        return np.asarray(off_m2 - off_m**2 - explained_m2)


class HeightComparison:
    """Compares heights from sample to sample.

    Attributes:
        found: the newest result.
        departed_m: (n,) by how much each estimate is higher above its receiver's height than when the vehicle
            stood, in the last few samples, with what all have in common; NaN: not known.
    """

    def __init__(self, count: int, settings: HeightSettings) -> None:
        self._settings = settings
        self._due_s = -np.inf
        self._reboots: tuple[int, ...] = ()
        self._armed: Mask = np.zeros(count, np.bool_)
        self._level: Mask = np.zeros(count, np.bool_)
        self._over: Mask = np.zeros(count, np.bool_)  # the reference is not extended any more
        self._pad_m = np.full(count, np.nan)  # altitude when the reference began
        self._reference, self._now = _Moments.none(count), _Moments.none(count)
        self._common_scale = np.nan  # of the last time at which two were high enough to tell
        self.found = HeightBias.unknown(count)
        self.departed_m: Array = np.full(count, np.nan)

    def note(self, telemetry: Telemetry, fresh: Mask, now_s: float) -> None:
        """Take a sample of the (n,) `fresh` vehicles, if one is due.

        The reference is what a vehicle reports before its first take-off since its autopilot has started.
        """
        if now_s < self._due_s:
            return
        self._due_s = now_s + PERIOD_S
        self._forget_restarted(telemetry.reboot_count)
        armed = np.array(telemetry.armed, np.bool_)
        self._now.forget(armed != self._armed)
        self._armed = armed
        altitude_m = telemetry.altitude_amsl_m
        off_m = altitude_m - telemetry.gnss_altitude_amsl_m
        was_level, self._level = self._level, np.abs(telemetry.velocity_ned_m_s[:, 2]) < LEVEL_M_S
        measured = fresh & np.isfinite(off_m) & self._level & was_level
        begins = measured & (self._reference.count == 0.0)
        self._pad_m[begins] = altitude_m[begins]
        height_m = altitude_m - self._pad_m
        sample = np.stack([off_m, height_m, off_m**2, height_m**2, off_m * height_m])
        self._over |= armed | (self._reference.count == WINDOW)
        stands = measured & ~self._over
        self._reference.add(stands, sample)
        self._now.add(measured & ~stands & (self._reference.count >= REFERENCE_MIN), sample)
        self.found = self._compared(height_m, telemetry.vertical_accuracy_m)
        new_m = np.where(
            measured & (self._reference.count >= REFERENCE_MIN), off_m - self._reference.means[0], np.nan
        )
        before_m = np.where(np.isnan(self.departed_m), new_m, self.departed_m)
        self.departed_m = np.where(np.isnan(new_m), before_m, before_m + (new_m - before_m) / RECENT)

    def _forget_restarted(self, reboot_count: tuple[int, ...]) -> None:
        if reboot_count is self._reboots:
            return
        restarted = np.array(reboot_count) != np.array(self._reboots or reboot_count)
        self._reboots = reboot_count
        self._over &= ~restarted
        self._reference.forget(restarted)
        self._now.forget(restarted)
        self.departed_m = np.where(restarted, np.nan, self.departed_m)

    def _compared(self, height_m: Array, accuracy_m: Array) -> HeightBias:
        """The result for (n,) present heights above the pad, and accuracies up as reported."""
        before, now, settings = self._reference, self._now, self._settings
        compared = (before.count >= REFERENCE_MIN) & (now.count >= NOW_MIN) & np.isfinite(accuracy_m)
        if compared.sum() < 2:
            return HeightBias.unknown(len(compared))
        with np.errstate(divide="ignore", invalid="ignore"):
            noise_m2 = np.maximum(np.maximum(before.noise_m2, now.noise_m2), NOISE_MIN_M**2)
            error_m2 = noise_m2 * CORRELATION * (1.0 / before.count + 1.0 / now.count)
            error_m = np.sqrt(error_m2 + (OWN_SHARE * accuracy_m) ** 2)
            bias_m = now.means[0] - before.means[0]
            grows = np.where(now.means[1] > SCALED_ABOVE_M, height_m / now.means[1], 1.0)
        bias_m, error_m = (np.where(compared, each * grows, np.nan) for each in (bias_m, error_m))
        common_error = min(1.0, QUARTILE_ERROR / np.sqrt(compared.sum()))
        error_m = np.hypot(error_m, common_error * np.median(error_m[compared]))
        high = compared & (now.means[1] > SCALED_ABOVE_M)
        if high.sum() > 1:
            share = (now.means[0] - before.means[0])[high] / now.means[1][high]
            self._common_scale = _common(share)
        judged = compared & (
            ~high | np.isfinite(self._common_scale)
        )  # one alone may be as the others will be
        by_offset_m, by_scale_m = bias_m - _common(bias_m[compared]), bias_m - self._common_scale * height_m
        bias_m = np.where(np.abs(by_scale_m) < np.abs(by_offset_m), by_scale_m, by_offset_m)
        scale = np.where(high, bias_m / np.maximum(height_m, SCALED_ABOVE_M), np.nan)
        keeps, off_m = np.where(self.found.named, KEEPS, 1.0), np.abs(bias_m)
        wide = off_m > keeps * settings.bias_max_m
        wide |= (np.abs(scale) > keeps * settings.scale_max) & (off_m > keeps * 0.5 * settings.bias_max_m)
        named = judged & wide & (off_m > keeps * settings.deviations * error_m)
        return HeightBias(bias_m, error_m, scale, named)


def _common(off: Array) -> float:
    """What (n,) differences have in common: 0 where a quarter is near it on each side.

    Where estimates agree with their receivers, they are right.
    """
    in_order, last = np.sort(off), len(off) - 1
    least, most = in_order[floor(0.25 * last)], in_order[ceil(0.75 * last)]
    return float(min(max(0.0, least), most))
