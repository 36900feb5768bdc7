"""What a kind of fix, a reported accuracy and a jump say about the error of a position."""

from functools import lru_cache
from itertools import combinations
from typing import Final, TypeAlias

import numpy as np
from pydantic import model_validator

from gcs.model.jit import kernel
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import Array

FIX_3D, RTK_FIXED = 3, 6

LEAST_M: Final = {"rtk_fixed_m": 0.05, "rtk_float_m": 0.2, "dgps_m": 0.5, "fix_3d_m": 1.0}
"""Least standard deviation of each kind of fix, sideways, the best first, where nothing is configured."""

SHARE_3D: Final = 0.7
"""Of the accuracy that receivers without corrections report, each one's own part (decision 0054)."""


class Positioning(Settings):
    """How uncertain the positions of neighbours are towards each other (decisions 0036 and 0054).

    A vehicle's standard deviation is its own share of what its receiver reports, but no less than its kind of
    fix can mean: sideways as here, up as the floor has it. A kind that is not configured counts as no more
    than a worse kind that is, and as no less than a better one.
    """

    rtk_fixed_m: Positive | None = None
    """Least standard deviation of a position with an RTK fix, in m; null: 0.05."""
    rtk_float_m: Positive | None = None
    """Least standard deviation of a position with RTK float, in m; null: 0.2."""
    dgps_m: Positive | None = None
    """Least standard deviation of a position with differential corrections, in m; null: 0.5."""
    fix_3d_m: Positive | None = None
    """Least standard deviation of a position with a 3D fix alone, in m; null: 1."""
    share: Positive | None = None
    """Share of the reported accuracy that is each one's own; null: 0.7 where none has corrections, else 1."""
    poor_m: Positive = 1.0
    """The part of a reported accuracy beyond this counts twice, in m."""
    uncertainty_max_m: Positive = 3.0
    """No position counts as more than this, in m: beyond it vehicles could only flee."""
    reset_uncertainty_m: NotNegative = 0.2
    """Added to the deviation after a position jumped, or more after a wide jump, in m."""
    reset_margin_s: NotNegative = 30.0
    """So long after a jump a position counts as less certain, in s."""
    freeze_s: NotNegative = 3.0
    """After a jump of its position a vehicle first stands still for this time, in s."""

    @model_validator(mode="after")
    def _consistent(self) -> "Positioning":
        for (better, better_m), (worse, worse_m) in combinations(self._configured.items(), 2):
            if better_m > worse_m:
                text = f"{better} is {better_m:g} and {worse} {worse_m:g}: a better fix is no less accurate"
                raise ValueError(f"{text}; lower {better} or raise {worse}")
        for key, least_m in self._configured.items():
            if least_m > (most_m := self.uncertainty_max_m):
                text = (
                    f"{key} is {least_m:g}, and no position counts as more than uncertainty_max_m, {most_m:g}"
                )
                raise ValueError(f"{text}; lower {key} or raise uncertainty_max_m")
        return self

    @property
    def _configured(self) -> dict[str, float]:
        values = {key: getattr(self, key) for key in LEAST_M}
        return {key: value for key, value in values.items() if value is not None}

    @property
    def least_by_type_m(self) -> Array:
        """(9,) least standard deviation of each GPS_FIX_TYPE, sideways: inf without a height.

        Types above RTK fixed (a base station, precise point positioning) count as RTK float.
        """
        return _least_by_type_m(self.rtk_fixed_m, self.rtk_float_m, self.dgps_m, self.fix_3d_m)

    def own_share(self, fix_type: Array) -> float:
        """Share of the reported accuracies that counts between neighbours.

        Without corrections all receivers of a field have most of their error in common. What corrections
        leave is each receiver's own, and a receiver with them has nothing in common with one without.

        Args:
            fix_type: (n,) GPS_FIX_TYPE of the fleet's receivers; NaN unknown.
        """
        if self.share is not None:
            return self.share
        reported = fix_type[np.isfinite(fix_type)]
        return SHARE_3D if len(reported) and not (reported > FIX_3D).any() else 1.0

    def after_jumps_m(self, usual_m: Array, since_s: Array, jumped_m: Array, deviations: float) -> Array:
        """(n,) standard deviations sideways after jumps: a vehicle may be where it was before.

        So wide that its pair with any vehicle that did not jump keeps farther apart by the whole jump.

        Args:
            usual_m: (n,) without the jumps.
            since_s: (n,) since its position jumped, inf where it never did.
            jumped_m: (n,) how far.
            deviations: `Floor.deviations`.
        """
        lately = since_s < self.reset_margin_s
        if not np.count_nonzero(lately):
            return usual_m
        grown_m, pair_m = jumped_m / deviations, np.hypot(usual_m, usual_m.max(initial=0.0))
        wide_m = np.sqrt(usual_m**2 + 2.0 * grown_m * pair_m + grown_m**2)
        wide_m = np.maximum(wide_m, usual_m + self.reset_uncertainty_m)
        most_m = np.maximum(usual_m, self.uncertainty_max_m)
        return np.where(lately, np.minimum(wide_m, most_m), usual_m)

    def accepted_m(self, fix_type: Array) -> float:
        """Accuracy that a receiver may report before take-off: it counts as `uncertainty_max_m`.

        Args:
            fix_type: (n,) as of `own_share`.
        """
        most_m = self.uncertainty_max_m
        return min(most_m, 0.5 * (most_m + self.poor_m)) / self.own_share(fix_type)


@lru_cache(maxsize=64)  # asked for each tick
def _least_by_type_m(*configured_m: float | None) -> Array:
    """See `Positioning.least_by_type_m`; `configured_m` are the values of `LEAST_M`'s keys, or None."""
    least_m = []
    for at, (given_m, usual_m) in enumerate(zip(configured_m, LEAST_M.values(), strict=True)):
        better_m = max((each for each in configured_m[:at] if each is not None), default=0.0)
        worse_m = min((each for each in configured_m[at:] if each is not None), default=np.inf)
        least_m.append(min(max(usual_m, better_m), worse_m) if given_m is None else given_m)
    fixed_m, float_m, dgps_m, fix_3d_m = least_m
    return np.array([np.inf, np.inf, np.inf, fix_3d_m, dgps_m, float_m, fixed_m, float_m, float_m])


def uncertainty_m(
    configured_m: float,
    up_share: float,
    horizontal_m: Array,
    vertical_m: Array,
    fix_type: Array,
    positioning: Positioning,
) -> Array:
    """Standard deviation of each position, sideways.

    Args:
        configured_m: where neither accuracy nor fix type is reported.
        up_share: standard deviation up for one metre sideways (`Floor.vertical_uncertainty`).
        horizontal_m: (n,) accuracy as reported, one sigma; NaN unknown, inf without a fix.
        vertical_m: (n,) the same up and down.
        fix_type: (n,) GPS_FIX_TYPE; NaN unknown.
        positioning: settings.

    Returns: (n,) at most `uncertainty_max_m` (or the configured one, where that is more).
    """
    numbers = (
        *(configured_m, up_share, positioning.own_share(fix_type), positioning.poor_m),
        max(configured_m, positioning.uncertainty_max_m),
    )
    return _uncertainty_m(horizontal_m, vertical_m, fix_type, positioning.least_by_type_m, numbers)


Numbers: TypeAlias = tuple[float, float, float, float, float]


@kernel
def _uncertainty_m(
    horizontal_m: Array,
    vertical_m: Array,
    fix_type: Array,
    by_type_m: Array,
    numbers: Numbers,
) -> Array:
    """As `uncertainty_m`. `numbers`: the first two of its arguments, settings, and the greatest result."""
    configured_m, up_share, share, poor_m, most_m = numbers
    uncertain_m = np.empty(len(horizontal_m))
    for i in range(len(horizontal_m)):
        reported_m = share * np.fmax(horizontal_m[i], vertical_m[i] / up_share)
        reported_m += np.fmax(reported_m - poor_m, 0.0)
        least_m = np.nan
        if np.isfinite(fix_type[i]):
            least_m = by_type_m[int(min(max(fix_type[i], 0.0), len(by_type_m) - 1.0))]
        wide_m = np.fmax(reported_m, least_m)
        if np.isnan(wide_m):
            wide_m = configured_m
        uncertain_m[i] = min(wide_m, most_m)
    return uncertain_m


def warm_up() -> None:
    """Compile or load the kernel, with the types that telemetry has."""
    unknown = np.full(1, np.nan)
    unknown.setflags(write=False)
    uncertainty_m(1.0, 1.0, unknown, unknown, unknown, Positioning())
