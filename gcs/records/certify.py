"""What a flight kept and what it broke: separation, fence, limits; from recorded positions alone."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from gcs.errors import GcsError
from gcs.frames import ShowFrame
from gcs.records.pairs import Pairs, nearest_approaches
from gcs.records.tracks import Single, Tracks
from gcs.safety.filter import SafetySettings
from gcs.state import Array, Mask

EXIT_CODES: Final[dict[str, int]] = {"kept": 0, "broken": 1, "incomplete": 3}
"""Of `gcs certify`, by verdict; 2: there is nothing to judge, or not by what."""

NEAREST: Final = 20
"""Pairs that the report names."""

SMOOTHED_S: Final = 0.5
"""Speeds and accelerations are means over this time: noise of an estimate is no motion."""

TOLERATED: Final = 0.1
TOLERATED_M_S, TOLERATED_M_S2 = 0.3, 0.5
"""A limit holds for what is commanded; a vehicle's own answer may pass it by that share and that much."""

TOLERATED_SETPOINT: Final = 1e-4
"""Setpoints have no answer of their own: only what single precision loses."""


LEEWAY_TOLD: Final = 1.01
"""Less is single precision's."""


@dataclass(frozen=True, slots=True)
class Standard:
    """What a flight is judged by."""

    frame: ShowFrame
    safety: SafetySettings
    acceleration_max_m_s2: float

    @classmethod
    def of(cls, config: Mapping[str, Any], source: str) -> "Standard":
        """From a recorded configuration. Raises: GcsError naming `source` and what is wrong."""
        try:
            control = config["control"]
            return cls(
                ShowFrame(**config["show_frame"]),
                SafetySettings.model_validate(control["safety"]),
                float(control["acceleration_max_m_s2"]),
            )
        except (KeyError, TypeError, ValueError, ValidationError, GcsError) as error:
            raise GcsError(f"{source}: its configuration does not say what holds: {error}") from None


@dataclass(frozen=True, slots=True)
class Check:
    """One limit: kept or not, and the worst that was."""

    name: str
    limit: float
    tolerated: float  # kept up to here: see `TOLERATED`
    worst: float | None  # None: there was nothing to judge
    unit: str
    vehicle: str
    at_s: float | None  # since the beginning
    kept: bool

    @property
    def leeway(self) -> str:
        """What is tolerated beyond the limit, in words; empty where nothing to speak of is."""
        return f" (kept up to {self.tolerated:g})" if self.tolerated > self.limit * LEEWAY_TOLD else ""


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """The judgement, and what plots are drawn from."""

    tracks: Tracks
    standard: Standard
    pairs: Pairs
    least_m: Single  # (k,) least distance of all pairs
    checks: tuple[Check, ...]

    @property
    def kept(self) -> bool:
        """Whether nothing was broken."""
        return all(check.kept for check in self.checks)

    @property
    def duration_s(self) -> float:
        """From the first sample to the last."""
        return float(self.tracks.time_s[-1] - self.tracks.time_s[0])

    def report(self) -> dict[str, Any]:
        """Everything a program wants to know; JSON."""
        tracks, pairs = self.tracks, self.pairs
        return {
            "verdict": "kept" if self.kept else "broken",
            "based_on": tracks.based_on,
            "uncertainty": tracks.uncertainty,
            "remarks": list(tracks.remarks),
            "vehicles": len(tracks.ids),
            "flew": int(tracks.airborne.any(axis=0).sum()),
            "duration_s": round(self.duration_s, 2),
            "checks": [asdict(check) for check in self.checks],
            "nearest_pairs": [
                {
                    "vehicles": [tracks.ids[i], tracks.ids[j]],
                    "distance_m": round(float(pairs.distance_m[i, j]), 3),
                    "floor_ratio": round(float(pairs.ratio[i, j]), 3),
                    "floor_ratio_if_off": round(float(pairs.sure_ratio[i, j]), 3),
                    "at_s": round(float(tracks.time_s[pairs.sample[i, j]] - tracks.time_s[0]), 2),
                }
                for i, j in pairs.nearest(NEAREST)
            ],
        }


def certify(tracks: Tracks, standard: Standard) -> Certificate:
    """Judge a flight. Pure."""
    pairs, least_m = nearest_approaches(tracks, standard.safety.floor)
    checks = (
        _separation(tracks, pairs),
        *_fence(tracks, standard.safety),
        *_speeds(tracks, standard),
        *_setpoints(tracks, standard.safety),
    )
    return Certificate(tracks, standard, pairs, least_m, checks)


def _separation(tracks: Tracks, pairs: Pairs) -> Check:
    nearest = pairs.nearest(1)
    name, unit = "separation, as a share of the floor", "of the floor"
    if not nearest:
        return Check(name, 1.0, 1.0, None, unit, "", None, kept=True)
    i, j = nearest[0]
    at_s = float(tracks.time_s[pairs.sample[i, j]] - tracks.time_s[0])
    ratio = float(pairs.ratio[i, j])
    both = f"{tracks.ids[i]} and {tracks.ids[j]}"
    return Check(name, 1.0, 1.0, round(ratio, 3), unit, both, round(at_s, 2), kept=ratio >= 1.0)


def _fence(tracks: Tracks, safety: SafetySettings) -> list[Check]:
    fence, place_m = safety.fence, tracks.position_m
    out_m = np.hypot(place_m[..., 0], place_m[..., 1])
    return [
        _most("greatest distance", fence.distance_max_m, out_m, tracks.airborne, tracks, "m"),
        _most("greatest height", fence.height_max_m, -place_m[..., 2], tracks.airborne, tracks, "m"),
        _least(
            "least height in the formation", fence.height_min_m, -place_m[..., 2], tracks.formed, tracks, "m"
        ),
    ]


def _speeds(tracks: Tracks, standard: Standard) -> list[Check]:
    limits = standard.safety.limits
    period_s = float(np.median(np.diff(tracks.time_s))) if len(tracks.time_s) > 1 else SMOOTHED_S
    width = max(1, round(SMOOTHED_S / period_s))
    velocity_m_s = _smoothed(np.asarray(tracks.velocity_m_s, np.float64), width)
    flown = _throughout(tracks.flown, width)
    change = np.full_like(velocity_m_s, np.nan)
    if len(velocity_m_s) > width:
        change[width:] = (velocity_m_s[width:] - velocity_m_s[:-width]) / (width * period_s)
    acceleration_m_s2 = np.linalg.norm(change, axis=-1)
    flat_m_s = np.hypot(velocity_m_s[..., 0], velocity_m_s[..., 1])
    up_m_s = -velocity_m_s[..., 2]

    def judged(name: str, limit: float, value: Array) -> Check:
        return _most(name, limit, value, flown, tracks, "m/s", 1.0 + TOLERATED, TOLERATED_M_S)

    return [
        judged("speed sideways", limits.horizontal_m_s, flat_m_s),
        judged("speed up", limits.up_m_s, up_m_s),
        judged("speed down", limits.down_m_s, -up_m_s),
        _most(
            "acceleration",
            standard.acceleration_max_m_s2,
            acceleration_m_s2,
            _throughout(flown, width),
            tracks,
            "m/s^2",
            1.0 + TOLERATED,
            TOLERATED_M_S2,
        ),
    ]


def _setpoints(tracks: Tracks, safety: SafetySettings) -> list[Check]:
    """What was commanded, tick by tick; where it is known."""
    wanted_m_s, limits = tracks.setpoint_m_s, safety.limits
    if wanted_m_s is None:
        return []
    given: Mask = np.asarray(np.isfinite(wanted_m_s).all(axis=-1))
    flat_m_s, up_m_s = np.hypot(wanted_m_s[..., 0], wanted_m_s[..., 1]), -wanted_m_s[..., 2]

    def judged(name: str, limit: float, value: Single) -> Check:
        return _most(name, limit, value, given, tracks, "m/s", 1.0 + TOLERATED_SETPOINT, 0.0, timed=False)

    return [
        judged("setpoint sideways", limits.horizontal_m_s, flat_m_s),
        judged("setpoint up", limits.up_m_s, up_m_s),
        judged("setpoint down", limits.down_m_s, -up_m_s),
    ]


def _most(
    name: str,
    limit: float,
    value: Array | Single,
    counts: Mask,
    tracks: Tracks,
    unit: str,
    factor: float = 1.0,
    beyond: float = 0.0,
    *,
    timed: bool = True,
) -> Check:
    """The greatest of (k, n) values, where they count."""
    seen = np.where(counts & np.isfinite(value), value, -np.inf)
    at, row = np.unravel_index(int(np.argmax(seen)), seen.shape)
    worst, tolerated = float(seen[at, row]), limit * factor + beyond
    if not np.isfinite(worst):
        return Check(name, limit, tolerated, None, unit, "", None, kept=True)
    at_s = round(float(tracks.time_s[at] - tracks.time_s[0]), 2) if timed else None
    kept = worst <= tolerated
    return Check(name, limit, round(tolerated, 3), round(worst, 3), unit, tracks.ids[row], at_s, kept=kept)


def _least(name: str, limit: float, value: Single, counts: Mask, tracks: Tracks, unit: str) -> Check:
    """The least of (k, n) values, where they count."""
    found = _most(name, -limit, -value, counts, tracks, unit)
    worst = None if found.worst is None else -found.worst
    return Check(name, limit, limit, worst, unit, found.vehicle, found.at_s, kept=found.kept)


def _smoothed(value: Array, width: int) -> Array:
    """(k, n, 3) means over the last `width` samples; NaN until there are as many."""
    total = np.cumsum(np.nan_to_num(value), axis=0)
    smooth = np.full_like(value, np.nan)
    smooth[width - 1 :] = total[width - 1 :]
    smooth[width:] -= total[:-width]
    return smooth / width


def _throughout(mask: Mask, width: int) -> Mask:
    """(k, n) where it was true for the last `width` samples."""
    total = np.cumsum(mask, axis=0)
    held = np.zeros_like(mask)
    held[width - 1 :] = total[width - 1 :] == width
    held[width:] = total[width:] - total[:-width] == width
    return held
