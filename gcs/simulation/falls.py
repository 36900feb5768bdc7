"""Falls of vehicles, integrated without the code that flies: drag on the velocity through air that moves."""

import numpy as np

from gcs.model.state import Array
from gcs.safety.impact import Airframe

STEP_S = 0.01
GRAVITY_M_S2, AIR_KG_M3 = 9.80665, 1.225


def fallen(
    position_m: Array,
    velocity_m_s: Array,
    wind_m_s: Array,
    airframe: Airframe,
    *,
    ground_m: float = 0.0,
    reaction_s: Array | float = 0.0,
) -> tuple[Array, Array, Array]:
    """(n, 2) Where vehicles hit the ground, (n,) after which time, and (n,) how fast.

    Args:
        position_m: (n, 3) show frame, above the ground.
        velocity_m_s: (n, 3).
        wind_m_s: (n, 3) constant during the fall.
        airframe: of all.
        ground_m: height of the ground above the origin.
        reaction_s: so long they fly on before their motors stop.
    """
    late_s = np.broadcast_to(np.asarray(reaction_s, np.float64), len(position_m))
    place, pace = position_m + late_s[:, None] * velocity_m_s, velocity_m_s.astype(np.float64).copy()
    per_m = 0.5 * AIR_KG_M3 * airframe.drag_area_m2 / airframe.mass_kg

    def pull(pace_m_s: Array) -> Array:
        through = pace_m_s - wind_m_s
        drag: Array = per_m * np.linalg.norm(through, axis=1)[:, None] * through
        return np.array((0.0, 0.0, GRAVITY_M_S2)) - drag

    hit_m, took_s, hit_m_s = np.full((len(place), 2), np.nan), late_s.copy(), np.full(len(place), np.nan)
    falls = -place[:, 2] > ground_m
    hit_m[~falls], hit_m_s[~falls] = place[~falls, :2], np.linalg.norm(pace[~falls], axis=1)
    while falls.any():
        k1 = pull(pace)
        k2 = pull(pace + 0.5 * STEP_S * k1)
        k3 = pull(pace + 0.5 * STEP_S * k2)
        k4 = pull(pace + STEP_S * k3)
        after = place + STEP_S * pace + STEP_S**2 / 6.0 * (k1 + k2 + k3)
        then = pace + STEP_S / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        down = falls & (-after[:, 2] <= ground_m)
        share = np.clip(
            (-place[down, 2] - ground_m) / np.maximum(after[down, 2] - place[down, 2], 1e-12), 0, 1
        )
        hit_m[down] = place[down, :2] + share[:, None] * (after[down, :2] - place[down, :2])
        hit_m_s[down] = np.linalg.norm(then[down], axis=1)
        took_s[falls] += STEP_S
        falls &= ~down
        place, pace = np.where(falls[:, None], after, place), np.where(falls[:, None], then, pace)
    return hit_m, took_s, hit_m_s
