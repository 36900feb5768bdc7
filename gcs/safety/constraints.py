"""Constraints on velocities, as half-spaces: ``normal . (v_i - v_j) >= bound``."""

from dataclasses import dataclass

import numpy as np

from gcs.model.errors import ShapeError
from gcs.model.jit import kernel
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import Array

NO_ROW = -1
"""In place of j: the constraint concerns vehicle i alone."""


@dataclass(frozen=True, slots=True, eq=False)
class Constraints:
    """k half-spaces over the velocities of n vehicles. Owns its arrays."""

    first: np.ndarray[tuple[int], np.dtype[np.intp]]  # (k,) row i
    second: np.ndarray[tuple[int], np.dtype[np.intp]]  # (k,) row j, or NO_ROW
    normal: Array  # (k, 3)
    bound_m_s: Array  # (k,)
    reason: tuple[str, ...]  # (k,) in words, for the operator

    def __post_init__(self) -> None:
        k = len(self.reason)
        shapes = (self.first.shape, self.second.shape, self.normal.shape, self.bound_m_s.shape)
        if shapes != ((k,), (k,), (k, 3), (k,)):
            raise ShapeError(f"constraints: {shapes} for {k} of them")

    def __len__(self) -> int:
        return len(self.reason)

    def slack_m_s(self, velocity_m_s: Array) -> Array:
        """(k,) distance of each constraint from being broken by velocities (n, 3); negative: broken."""
        relative = velocity_m_s[self.first] - np.where(
            (self.second == NO_ROW)[:, None], 0.0, velocity_m_s[self.second]
        )
        slack: Array = (self.normal * relative).sum(axis=1) - self.bound_m_s
        return slack

    @staticmethod
    def none() -> "Constraints":
        no_rows = np.zeros(0, dtype=np.intp)
        return Constraints(no_rows, no_rows, np.zeros((0, 3)), np.zeros(0), ())

    @staticmethod
    def joined(*parts: "Constraints") -> "Constraints":
        parts = tuple(part for part in parts if len(part) > 0)
        if len(parts) < 2:
            return parts[0] if parts else Constraints.none()
        return Constraints(
            np.concatenate([part.first for part in parts]),
            np.concatenate([part.second for part in parts]),
            np.concatenate([part.normal for part in parts]),
            np.concatenate([part.bound_m_s for part in parts]),
            tuple(reason for part in parts for reason in part.reason),
        )


class Braking(Settings):
    """A vehicle's ability to stop, from the recorded response (docs/decisions/0004)."""

    reaction_s: Positive = 0.8  # delay and build-up of the response, as if nothing happened meanwhile
    lead_s: NotNegative = 0.6  # between vehicles: the measured closing speed continues for this time
    deceleration_m_s2: Positive = 2.0  # after that, on the average of the stop
    escape_rate_per_s: Positive = 1.5  # speed away from something already too close, per metre

    def over_link(self, delay_s: float) -> "Braking":
        """The same when telemetry and setpoints each take `delay_s`: the reaction begins a round trip later.

        Escaping is also a loop through the link; its time constant grows by two round trips, so that it does
        not oscillate.
        """
        if delay_s == 0.0:
            return self
        return Braking(
            reaction_s=self.reaction_s + 2.0 * delay_s,
            lead_s=self.lead_s + 2.0 * delay_s,
            deceleration_m_s2=self.deceleration_m_s2,
            escape_rate_per_s=1.0 / (1.0 / self.escape_rate_per_s + 4.0 * delay_s),
        )

    def speed_m_s(self, gap_m: Array) -> Array:
        """Fastest approach from which a vehicle stops within `gap_m` (any shape).

        Solves ``v t + v^2 / (2 a) = gap``. Negative for a negative gap: moving away is then required.
        """
        a, t = self.deceleration_m_s2, self.reaction_s
        stop: Array = a * (np.sqrt(t * t + 2.0 * np.maximum(gap_m, 0.0) / a) - t)
        return np.where(gap_m < 0.0, self.escape_rate_per_s * gap_m, stop)


@kernel
def allowed_speed_m_s(
    gap_m: float, reaction_s: float, deceleration_m_s2: float, escape_rate_per_s: float
) -> float:
    """As `Braking.speed_m_s`, for one gap."""
    if gap_m < 0.0:
        return escape_rate_per_s * gap_m
    stop_s: float = np.sqrt(reaction_s * reaction_s + 2.0 * gap_m / deceleration_m_s2)
    return deceleration_m_s2 * (stop_s - reaction_s)
