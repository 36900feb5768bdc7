"""An environment for reinforcement learning with the interface of Gymnasium, which it does not need.

The action is the desired velocity of every vehicle, and the safety filter of real flights has the last word.
As a program it flies a simple policy onto the sphere. Argument: seconds of the flight.
"""

import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.simulation import Scenario, Stepper, StepState

SPEED_M_S = 3.0


@dataclass(frozen=True)
class Box:
    """A space of arrays: what a learner asks of `gymnasium.spaces.Box`."""

    low: float
    high: float
    shape: tuple[int, ...]
    dtype: type[np.float32] = np.float32


class FormationEnv:
    """Observations (n, 6): place relative to the centre, in radii, and velocity, in `SPEED_M_S`."""

    def __init__(self, vehicles: int = 6, seconds: float = 20.0) -> None:
        self.action_space = Box(-1.0, 1.0, (vehicles, 3))
        self.observation_space = Box(-np.inf, np.inf, (vehicles, 6))
        self._sim = Stepper(Scenario.load("assembly").with_(duration_s=seconds), vehicles)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin a flight. There are no options."""
        if options:
            raise ValueError(f"there are no options, such as {next(iter(options))}")
        self._sim.reset(seed)
        state, _ = self._sim.step()  # by the law: the centre is where the first tick puts it
        return self._observed(state), {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Fly one tick. Returns: observation, reward, terminated, truncated, info."""
        state, over = self._sim.step(SPEED_M_S * np.clip(action, -1.0, 1.0))
        seen = self._observed(state)
        off = np.abs(np.linalg.norm(seen[:, :3], axis=1) - 1.0).mean()
        limited = np.mean([text != "" for text in state.limited_by])
        info = {"time_s": state.time_s, "off": float(off), "limited_by": state.limited_by}
        return seen, float(-off - 0.1 * limited), False, over, info

    @staticmethod
    def _observed(state: StepState) -> NDArray[np.float32]:
        place = (state.position_m - state.centre_m) / state.radius_m
        return np.hstack([place, state.velocity_m_s / SPEED_M_S]).astype(np.float32)


def onto_the_sphere(seen: NDArray[np.float32]) -> NDArray[np.float32]:
    """A policy to compare with: straight onto the sphere, and slower near it."""
    away = np.linalg.norm(seen[:, :3], axis=1, keepdims=True)
    return np.asarray(3.0 * (1.0 - away) * seen[:, :3] / np.maximum(away, 1e-6), np.float32)


if __name__ == "__main__":
    env = FormationEnv(seconds=float(sys.argv[1]) if len(sys.argv) > 1 else 20.0)
    seen, _ = env.reset(seed=1)
    total, over = 0.0, False
    while not over:
        seen, reward, terminated, over, info = env.step(onto_the_sphere(seen))
        total += reward
    print(f"return {total:.1f}, off the sphere by {100 * info['off']:.1f} % of its radius")
