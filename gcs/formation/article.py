"""The article's law as flown: its forces on positions, corrected and damped.

The functions named after forces are the article's own; `flown_velocity` flies them with vehicles that take
velocity setpoints and respond late. Decision 0040 derives its gains. What only section 5 needs is in
`gcs.simulation.article_forces`.
"""

import numpy as np

from gcs.formation.repulsion import STIFFEST_MODE
from gcs.model.jit import kernel
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import TINY, Array


class ArticleParameters(Settings):
    """Section 5 of the article: M, k, k_s, k_r, r_d."""

    mass_kg: Positive = 10.0
    damping_n_s_m: Positive = 1.0
    sphere_gain: Positive = 5.0
    repulsion_gain: Positive = 0.2
    radius_m: Positive = 2.0


def repulsion_force(position_m: Array, charge: Array, *, gain: float) -> Array:
    """Push the vehicles apart like charges, exactly as the article writes it.

    Args:
        position_m: (n, 3).
        charge: (n,) q_n.
        gain: k_r.

    Returns: (n, 3) forces ``k_r q_n sum_i q_i r_ni / |r_ni|^3``; equal and opposite for each pair. Vehicles
        in the same place do not push each other: there is no direction to push in.

    Source: article, section 2.2.
    """
    return gain * charge[:, None] * _pushes(np.array(position_m, dtype=np.float64), charge)


@kernel
def _pushes(position_m: Array, charge: Array) -> Array:
    """(n, 3) sums of ``q_i r_ni / |r_ni|^3`` over the others; double precision, at any distance."""
    n = len(position_m)
    push = np.zeros((n, 3))
    for i in range(n):
        for j in range(n):
            dx = position_m[i, 0] - position_m[j, 0]
            dy = position_m[i, 1] - position_m[j, 1]
            dz = position_m[i, 2] - position_m[j, 2]
            square = dx * dx + dy * dy + dz * dz
            if square > TINY * TINY:
                strength = charge[j] / (square * np.sqrt(square))
                push[i, 0] += strength * dx
                push[i, 1] += strength * dy
                push[i, 2] += strength * dz
    return push


def sphere_force(position_m: Array, center_m: Array, *, radius_m: float, gain: float) -> Array:
    """Draw every vehicle onto the sphere, exactly as the article writes it.

    Args:
        position_m: (n, 3), in the frame of `center_m`.
        center_m: (3,).
        radius_m: r_d.
        gain: k_s, in N/m^3 for a mass in kg.

    Returns: (n, 3) virtual forces ``-k_s (p - p_c) (|p - p_c|^2 - r_d^2)``; zero at the centre itself.

    Source: article, section 2.1.
    """
    offset_m = position_m - center_m
    excess_m2 = (offset_m**2).sum(axis=1, keepdims=True) - radius_m**2
    force: Array = -gain * offset_m * excess_m2
    return force


class ForceSettings(Settings):
    """Rates of a law of forces as flown; docs/decisions/law.md says how they were found."""

    sphere_rate_per_s: Positive = 0.8
    """Rate at which a small distance from the sphere decays, in 1/s."""
    spreading_rate_per_s: Positive = 0.8
    """Rate at which the stiffest mode of the repulsion decays, in 1/s."""
    momentum_s: Positive = 16.0
    """Virtual mass over damping, in s."""
    ahead_s: Positive = 4.0
    """Time by which the virtual velocity is predicted, in s: this damps the motion."""
    momentum_max_m_s: NotNegative = 0.5
    """Most of the virtual velocity, in m/s."""
    symmetry_speed_m_s: NotNegative = 0.3
    """Offset that breaks symmetries when a vehicle joins, in m/s."""
    symmetry_decay_s: Positive = 4.0
    """Time after which a third of it is left, in s."""


def scheduled(count: int, charge: Array, radius_m: float, settings: ForceSettings) -> ArticleParameters:
    """The article's gains with which vehicles (n,) of that charge respond at the settings' rates, with k = 1.

    Both forces are linearised at the finished formation. The stiffest mode of the repulsion grows with
    N^1.5 / R^3, and the sphere's stiffness is 2 k_s R^2: constant gains are right for one N and R only.
    """
    stiffest = STIFFEST_MODE * max(count, 2) ** 1.5 * float(charge.mean() * charge.max()) / radius_m**3
    mass_kg, per_s = settings.momentum_s, settings.momentum_s / settings.ahead_s
    return ArticleParameters(
        mass_kg=mass_kg,
        damping_n_s_m=1.0,
        sphere_gain=per_s * settings.sphere_rate_per_s / (2.0 * radius_m**2),
        repulsion_gain=per_s * settings.spreading_rate_per_s / stiffest,
        radius_m=radius_m,
    )


def flown_velocity(
    position_m: Array,
    center_m: Array,
    charge: Array,
    momentum_m_s: Array,
    *,
    radius_m: float,
    dt_s: float,
    speed_max_m_s: float,
    settings: ForceSettings,
) -> tuple[Array, Array]:
    """The article's law for vehicles that take velocity setpoints and respond late.

    Args:
        position_m: (n, 3).
        center_m: (3,), in the same frame.
        charge: (n,).
        momentum_m_s: (n, 3) virtual velocity of the previous tick.
        radius_m: of the sphere.
        dt_s: since the previous tick.
        speed_max_m_s: limit of the pull onto the sphere, and of the push along it.
        settings: rates.

    Returns: (n, 3) velocity relative to the centre, and (n, 3) the next virtual velocity. A vehicle at the
    centre itself is sent up.

    Source: article, sections 1 and 2.3. Only the part of the repulsion along the sphere counts: the radial
        part would move the equilibrium outside the sphere, the farther the larger N.
    """
    parameters = scheduled(len(position_m), charge, radius_m, settings)
    ahead_s_kg = settings.ahead_s / parameters.mass_kg
    outward, distance_m = outward_of(position_m - center_m)
    pull = sphere_force(position_m, center_m, radius_m=radius_m, gain=parameters.sphere_gain)
    pull_m_s = np.where(distance_m > TINY, ahead_s_kg * pull, speed_max_m_s * outward)
    push = along(repulsion_force(position_m, charge, gain=parameters.repulsion_gain), outward)
    push_m_s = no_faster(ahead_s_kg * push, speed_max_m_s)
    later_m_s = virtual_velocity(momentum_m_s, push_m_s, outward, dt_s, settings)
    return no_faster(pull_m_s, speed_max_m_s) + push_m_s + later_m_s, later_m_s


def virtual_velocity(
    momentum_m_s: Array, push_m_s: Array, outward: Array, dt_s: float, settings: ForceSettings
) -> Array:
    """The virtual velocity after `dt_s` of ``M p'' = u - k p'``, along the sphere; arrays (n, 3).

    Soft modes of the shape, hundreds of times slower than the stiffest, gather momentum. The sphere's pull
    gives none, because it would carry vehicles through the shell. A vehicle loses all momentum where the push
    is against it, so that none swings about its place.

    Args:
        momentum_m_s: before.
        push_m_s: of the repulsion, ``T u / M`` with T = `ahead_s`.
        outward: unit vectors from the centre.
        dt_s: since then.
        settings: M / k, T and the limit.

    Source: article, section 1.
    """
    gained_m_s2 = push_m_s / settings.ahead_s - momentum_m_s / settings.momentum_s
    later_m_s = along(momentum_m_s + dt_s * gained_m_s2, outward)
    against = (later_m_s * push_m_s).sum(axis=1, keepdims=True) < 0.0
    return no_faster(np.where(against, 0.0, later_m_s), settings.momentum_max_m_s)


def outward_of(offset_m: Array) -> tuple[Array, Array]:
    """(n, 3) unit vectors of offsets from the centre, and (n, 1) their lengths; up at the centre itself."""
    distance_m = np.linalg.norm(offset_m, axis=1, keepdims=True)
    outward = np.where(distance_m > TINY, offset_m / np.maximum(distance_m, TINY), (0.0, 0.0, -1.0))
    return outward, distance_m


def along(vectors: Array, outward: Array) -> Array:
    """(n, 3) vectors without their parts along the unit vectors `outward`, (n, 3)."""
    kept: Array = vectors - (vectors * outward).sum(axis=1, keepdims=True) * outward
    return kept


def no_faster(vectors: Array, limit: float) -> Array:
    """(n, 3) vectors, none longer than the limit; directions are kept."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    limited: Array = vectors * np.minimum(1.0, limit / np.maximum(length, TINY))
    return limited
