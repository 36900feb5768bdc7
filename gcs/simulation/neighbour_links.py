"""Messages between neighbouring vehicles, with limited range, delay and loss."""

from collections import deque
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from gcs.formation.consensus import Belief, NeighbourMessages, agree
from gcs.formation.neighbours import Sight
from gcs.formation.orbit import Center
from gcs.model.state import Array, Mask
from gcs.simulation.scenario import Radio

PLACE, PACE, CENTER, CENTER_PACE = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
DEGREE, SENT = 12, 13
WORDS = 14
"""Numbers in a message: position, velocity, estimated centre and its velocity, number of neighbours, time."""


def range_m(neighbours: int, count: int, radius_m: float) -> float:
    """Range that includes about `neighbours` of `count` vehicles, spread evenly over the sphere.

    The cap of the sphere within a chord d has the share (d / 2R)^2 of its area.
    """
    return 2.0 * radius_m * min(1.0, sqrt(neighbours / max(count - 1, 1)))


class Neighbourhood:
    """Received messages of every vehicle, and its estimate of the centre."""

    def __init__(self, radio: Radio, charge: Array, radius_m: float, tick_s: float, seed: int) -> None:
        """`charge` (n,); no message has been sent yet."""
        n = len(charge)
        self._radio, self._charge, self._tick_s = radio, charge, tick_s
        self._range_m = range_m(radio.neighbours, n, radius_m)
        self._random = np.random.default_rng([seed, 2])
        self._newest = np.full((n, n, WORDS), np.nan)  # received by row from column
        self._newest[:, :, SENT] = -np.inf
        self._under_way: deque[tuple[float, Mask, Array]] = deque()  # arrival, receivers, messages
        self._belief = Belief.nothing(n)
        sees = self._random.permutation(n) < max(1, round(radio.sighting_share * n))
        error_m = radio.sighting_error_m * self._random.standard_normal((n, 3))
        self._sighting_error_m = np.where(sees[:, None], error_m, np.nan)

    def exchange(
        self, now_s: float, position_m: Array, velocity_m_s: Array, present: Mask, center: Center | None
    ) -> Sight:
        """Deliver messages, update every vehicle's estimate, and send its next message.

        Args:
            now_s: virtual time.
            position_m: (n, 3) each vehicle's own estimate.
            velocity_m_s: (n, 3) likewise.
            present: (n,) vehicles that send and receive.
            center: the commanded centre, for vehicles that observe it; None before there is one.

        Returns: what each vehicle's law knows now.
        """
        self._deliver(now_s)
        mail, columns = self._mail(now_s)
        age_s = now_s - mail[:, :, SENT, None]
        degree = np.isfinite(mail[:, :, 0]).sum(axis=1).astype(np.float64)
        belief = None
        if self._radio.center == "agreed":
            forward_m = mail[:, :, CENTER] + age_s * mail[:, :, CENTER_PACE]
            received = NeighbourMessages(forward_m, mail[:, :, CENTER_PACE], mail[:, :, DEGREE])
            self._belief = agree(
                self._belief, received, self._sighted(center), self._tick_s, self._radio.consensus
            )
            belief = self._belief
        self._speak(now_s, position_m, velocity_m_s, degree, present)
        inbox_m = mail[:, :, PLACE] + age_s * mail[:, :, PACE]
        return Sight(inbox_m, self._charge[columns], self._range_m, belief)

    def _deliver(self, now_s: float) -> None:
        while self._under_way and self._under_way[0][0] <= now_s + 1e-9:
            _, gets, stated = self._under_way.popleft()
            self._newest = np.where(gets[:, :, None], stated[None], self._newest)

    def _mail(self, now_s: float) -> tuple[Array, NDArray[np.intp]]:
        """(n, k, WORDS) newest recent message of each sender, padded with NaN, and (n, k) sender columns."""
        lately = now_s - self._newest[:, :, SENT] <= self._radio.silence_max_s
        most = max(1, int(lately.sum(axis=1).max(initial=0)))
        columns = np.argsort(~lately, axis=1, kind="stable")[:, :most]
        mail: Array = np.take_along_axis(self._newest, columns[:, :, None], axis=1)
        mail[~np.take_along_axis(lately, columns, axis=1)] = np.nan
        return mail, columns

    def _sighted(self, center: Center | None) -> Belief:
        if center is None:
            return Belief.nothing(len(self._charge))
        unseen = 0.0 * self._sighting_error_m  # NaN for vehicles that do not observe the centre
        return Belief(center.position_m + self._sighting_error_m, center.velocity_m_s + unseen)

    def _speak(
        self, now_s: float, position_m: Array, velocity_m_s: Array, degree: Array, present: Mask
    ) -> None:
        stated = np.column_stack(
            [
                position_m,
                velocity_m_s,
                self._belief.center_m,
                self._belief.velocity_m_s,
                degree,
                np.full(len(degree), now_s),
            ]
        )
        apart_m = np.linalg.norm(position_m[:, None] - position_m[None], axis=2)
        gets = (apart_m < self._range_m) & present[:, None] & present[None, :]
        np.fill_diagonal(gets, val=False)
        if self._radio.loss:
            gets &= self._random.random(gets.shape) >= self._radio.loss
        self._under_way.append((now_s + self._radio.delay_s, gets, stated))
