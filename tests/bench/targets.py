"""How well targets are estimated, and what that costs: `python -m tests.bench.targets`.

The first table is the error of the estimate at the present time, median and 95th percentile in m, of the
flight's interacting models and of single Kalman filters of constant velocity, by the power of their random
acceleration in m^2/s^3. Reports 5 times a second, 0.3 s old, errors of 1 m, with and without a velocity of
0.15 m/s. Then the processor time of one tick with 100 targets that report 5 times a second.
"""

import csv
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from gcs.estimation.targets.motion import TargetBelief, begun, corrected, foreseen, warm_up
from gcs.estimation.targets.source_clock import SourceClock
from gcs.estimation.targets.target import TargetEstimate, motions
from gcs.estimation.targets.tracker import TargetReport, Tracker
from gcs.model.frames import ShowFrame
from gcs.model.state import Array
from gcs.sim.targets.motions import motion

RECORDED: Final = Path(__file__).parents[1] / "data" / "targets" / "px4-session.csv"
HZ, DELAY_S, NOISE_M, NOISE_M_S, SETTLED_S, SEEDS = 5.0, 0.3, 1.0, 0.15, 20.0, 5
SINGLE: Final = (0.05, 0.3, 1.0, 4.0)

Moves = Callable[[float], tuple[Array, Array]]
"""(2,) position and (2,) velocity at a time."""


class Estimator(Protocol):
    def take(self, was_s: float, reported: Array, variance: Array) -> None: ...
    def position_m(self, time_s: float) -> Array: ...


class Interacting:
    """That of the flight."""

    def __init__(self) -> None:
        self._belief: TargetBelief | None = None

    def take(self, was_s: float, reported: Array, variance: Array) -> None:
        before = self._belief
        believed = begun if before is None else partial(corrected, before)
        self._belief = believed(was_s, reported, variance)

    def position_m(self, time_s: float) -> Array:
        assert self._belief is not None
        return foreseen(self._belief, time_s).position_m


class ConstantVelocity:
    """One Kalman filter."""

    def __init__(self, power: float) -> None:
        self._power, self._time_s = power, np.nan
        self._mean, self._covariance = np.zeros(4), np.diag([1e6, 1e6, 25.0, 25.0])

    def take(self, was_s: float, reported: Array, variance: Array) -> None:
        if np.isfinite(self._time_s):
            self._mean, self._covariance = self._moved(was_s - self._time_s)
        many, self._time_s = len(reported), was_s
        gain = self._covariance[:, :many] @ np.linalg.inv(self._covariance[:many, :many] + np.diag(variance))
        self._mean = self._mean + gain @ (reported - self._mean[:many])
        self._covariance = self._covariance - gain @ self._covariance[:many]

    def position_m(self, time_s: float) -> Array:
        position_m: Array = self._moved(max(time_s - self._time_s, 0.0))[0][:2]
        return position_m

    def _moved(self, dt_s: float) -> tuple[Array, Array]:
        step = np.eye(4)
        step[0, 2] = step[1, 3] = dt_s
        grown = np.kron(np.array([[dt_s**3 / 3.0, dt_s**2 / 2.0], [dt_s**2 / 2.0, dt_s]]), np.eye(2))
        return step @ self._mean, step @ self._covariance @ step.T + self._power * grown


def recorded() -> tuple[Moves, float]:
    """The motion of a PX4 in SITL, and how long it lasts."""
    rows = [row for row in csv.reader(RECORDED.read_text().splitlines()) if not row[0].startswith("#")]
    time_s, latitude_deg, longitude_deg = np.array([row[:3] for row in rows[1:]], dtype=float).T
    frame = ShowFrame(latitude_deg[0], longitude_deg[0], 0.0)
    place_m = frame.position_m(latitude_deg, longitude_deg, np.zeros(len(time_s)))[:, :2]
    moves_m_s = np.gradient(place_m, time_s, axis=0)

    def at(now_s: float) -> tuple[Array, Array]:
        columns = (place_m, moves_m_s)
        return tuple(np.array([np.interp(now_s, time_s, each[:, k]) for k in (0, 1)]) for each in columns)  # type: ignore[return-value]

    return at, float(time_s[-1])


def drawn(name: str, speed_m_s: float) -> Moves:
    """One of those of `gcs sim --target`."""
    moves = motion(name, seed=1, speed_m_s=speed_m_s)

    def at(now_s: float) -> tuple[Array, Array]:
        state = moves(now_s)
        return np.array(state[:2]), np.array(state[3:5])

    return at


def errors_m(make: Callable[[], Estimator], moves: Moves, lasts_s: float, *, velocity: bool) -> Array:
    """Median and 95th percentile, on the average of the seeds."""
    figures = []
    for seed in range(SEEDS):
        random, estimator, off_m, sent = np.random.default_rng(seed), make(), [], 0
        for now_s in np.arange(0.0, lasts_s, 0.05):
            while sent / HZ + DELAY_S <= now_s:
                place_m, moves_m_s = moves(sent / HZ)
                reported, deviation = place_m + random.normal(0.0, NOISE_M, 2), np.full(2, NOISE_M)
                if velocity:
                    reported = np.concatenate([reported, moves_m_s + random.normal(0.0, NOISE_M_S, 2)])
                    deviation = np.array([NOISE_M, NOISE_M, NOISE_M_S, NOISE_M_S])
                estimator.take(sent / HZ, reported, deviation**2)
                sent += 1
            if now_s >= SETTLED_S:
                off_m.append(np.hypot(*(estimator.position_m(now_s) - moves(now_s)[0])))
        figures.append(np.percentile(off_m, [50.0, 95.0]))
    mean_m: Array = np.mean(figures, axis=0)
    return mean_m


def rows() -> Iterator[str]:
    moves, lasts_s = recorded()
    motions = {
        "recorded": (moves, lasts_s),
        "straight, 5 m/s": (drawn("straight", 5.0), 90.0),
        "roundabout of 15 m, 5 m/s": (drawn("roundabout", 5.0), 90.0),
        "hairpins, 5 m/s": (drawn("hairpin", 5.0), 90.0),
        "boat": (drawn("boat", 2.5), 90.0),
        "rover in zig-zag": (drawn("rover", 2.0), 90.0),
    }
    makes: list[Callable[[], Estimator]] = [
        Interacting,
        *(partial(ConstantVelocity, each) for each in SINGLE),
    ]
    yield (
        "| Motion | interacting, with velocity | interacting | "
        + " | ".join(f"one, {each:g}" for each in SINGLE)
        + " |"
    )
    yield "|---" * (3 + len(SINGLE)) + "|"
    for name, (moved, lasts) in motions.items():
        figures = [errors_m(Interacting, moved, lasts, velocity=True)]
        figures += [errors_m(make, moved, lasts, velocity=False) for make in makes]
        yield f"| {name} | " + " | ".join(f"{median:.2f}, {p95:.2f}" for median, p95 in figures) + " |"


def tick_ms(count: int = 100, ticks: int = 400) -> tuple[float, float]:
    """Processor time to take what arrives in a tick, and to ask all targets where they are; median, ms."""
    estimates = [TargetEstimate([Tracker(1.0, 5.0, SourceClock(0.0))]) for _ in range(count)]
    random, took_ms = np.random.default_rng(0), np.empty((ticks, 2))
    for tick in range(ticks):
        now_s = tick / 20.0
        arrived = [
            (each, TargetReport(now_s, (5.0 * now_s + random.normal(), random.normal()), source_s=now_s))
            for row, each in enumerate(estimates)
            if (tick + row) % 4 == 0
        ]
        began_s = time.process_time()
        for estimate, report in arrived:
            estimate.tracker.take(report, 0.0)
        taken_s = time.process_time()
        motions(estimates, now_s)
        took_ms[tick] = 1e3 * (taken_s - began_s), 1e3 * (time.process_time() - taken_s)
    taking_ms, asking_ms = np.median(took_ms[ticks // 4 :], axis=0).tolist()
    return taking_ms, asking_ms


if __name__ == "__main__":
    warm_up()
    for line in rows():
        print(line)
    print("100 targets, a tick: {:.2f} ms to take 25 reports, {:.2f} ms to foresee all".format(*tick_ms()))
