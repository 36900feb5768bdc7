"""What a receiver on a target reports of its motion, with errors. Sans-I/O."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from math import exp, inf, nan, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs.sim.settings import Origin
from gcs.sim.targets.motions import Motion
from gcs.sim.vehicle.sensors import Tangent

UP_SHARE = 1.5
"""Height errors of receivers, for one metre sideways."""

VELOCITY_SHARE_PER_S = 0.05
"""Velocity errors for one metre of position error: receivers measure velocity by itself, and well."""


class Velocity(NamedTuple):
    """As a receiver reports it."""

    north_m_s: float
    east_m_s: float
    down_m_s: float


class Report(NamedTuple):
    """One report. NaN: the receiver sends no number."""

    taken_s: float  # when the target was there, since the beginning
    sent_s: float
    clock_s: float  # the same as taken_s, by the receiver's clock
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    north_m_s: float
    east_m_s: float
    down_m_s: float
    deviation_m: float  # as the receiver states it


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """What is wrong with a receiver and its link; times since the beginning.

    Attributes:
        rate_hz: reports a second.
        noise_m: one sigma of positions along each axis.
        correlated_s: for how long an error stays alike; 0: each is another.
        delay_s: from measurement to sending.
        drop_out: probability that one begins with a report, and its length in s.
        clock: by how much the clock is ahead in s, and how fast it is, in millionths.
        clock_step: by how much the clock is set forward in s, and when.
        jump: length in m of a jump of one report, and every how many s there is one.
        freeze: since when the same position is reported, and for how long, in s.
        doubled: share of reports that are sent twice.
        unknown: share of reports without a number for the position.
        swapped: whether latitude and longitude are exchanged.
    """

    rate_hz: float = 5.0
    noise_m: float = 1.0
    correlated_s: float = 0.0
    delay_s: float = 0.0
    drop_out: tuple[float, float] = (0.0, 0.0)
    clock: tuple[float, float] = (0.0, 0.0)
    clock_step: tuple[float, float] = (0.0, inf)
    jump: tuple[float, float] = (0.0, inf)
    freeze: tuple[float, float] = (inf, 0.0)
    doubled: float = 0.0
    unknown: float = 0.0
    swapped: bool = False

    def clock_s(self, time_s: float) -> float:
        """The receiver's clock at a time."""
        ahead_s, millionths = self.clock
        step_s, from_s = self.clock_step
        return time_s * (1.0 + 1e-6 * millionths) + ahead_s + (step_s if time_s >= from_s else 0.0)


def reports(motion: Motion, origin: Origin, errors: Errors, seed: int = 0) -> Iterator[Report]:
    """Reports without end, in the order in which they are sent. The same for the same seed."""
    random = np.random.default_rng(seed)
    located = Tangent(origin.latitude_deg, origin.longitude_deg, origin.altitude_amsl_m).geodetic
    off_m, silent_until_s, jumps, frozen = np.zeros(3), -inf, 0, None
    keep = exp(-1.0 / (errors.rate_hz * errors.correlated_s)) if errors.correlated_s > 0.0 else 0.0
    for number in count():
        taken_s = number / errors.rate_hz
        off_m = _next_error(off_m, keep if number else 0.0, errors.noise_m, random)
        chances = random.random(3)
        if taken_s >= silent_until_s and chances[0] < errors.drop_out[0]:
            silent_until_s = taken_s + errors.drop_out[1]
        if taken_s < silent_until_s:
            continue
        state = np.array(motion(taken_s))
        seen_m, moves = state[:3] + off_m, state[3:] + _velocity_error(errors.noise_m, random)
        if taken_s >= (jumps + 1) * errors.jump[1]:
            jumps, angle = int(taken_s / errors.jump[1]), random.uniform(-np.pi, np.pi)
            seen_m[:2] += errors.jump[0] * np.array([np.cos(angle), np.sin(angle)])
        is_frozen = errors.freeze[0] <= taken_s < sum(errors.freeze)
        frozen = (seen_m, moves) if frozen is None or not is_frozen else frozen
        place = _place(
            located(frozen[0][None])[0], is_unknown=chances[1] < errors.unknown, swapped=errors.swapped
        )
        sent_s, deviation_m = taken_s + errors.delay_s, max(errors.noise_m, 0.01)
        velocity = Velocity(*map(float, frozen[1]))
        report = Report(taken_s, sent_s, errors.clock_s(taken_s), *place, *velocity, deviation_m)
        yield from (report,) * (2 if chances[2] < errors.doubled else 1)


def _next_error(
    off_m: NDArray[np.float64], keep: float, noise_m: float, random: np.random.Generator
) -> NDArray[np.float64]:
    """First-order Gauss-Markov with its stationary spread."""
    fresh_m = noise_m * np.array([1.0, 1.0, UP_SHARE]) * random.standard_normal(3)
    return keep * off_m + (fresh_m if keep == 0.0 else sqrt(1.0 - keep * keep) * fresh_m)


def _velocity_error(noise_m: float, random: np.random.Generator) -> NDArray[np.float64]:
    return VELOCITY_SHARE_PER_S * noise_m * random.standard_normal(3)


def _place(place: NDArray[np.float64], *, is_unknown: bool, swapped: bool) -> tuple[float, float, float]:
    if is_unknown:
        return nan, nan, nan
    latitude_deg, longitude_deg, altitude_m = map(float, place)
    return (longitude_deg, latitude_deg, altitude_m) if swapped else (latitude_deg, longitude_deg, altitude_m)
