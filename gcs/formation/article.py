"""The article's own controller and virtual dynamics (sections 1 and 2.3), kept as a model.

It is nearly undamped with the article's parameters (zeta = 0.025) and is not what flies; `gcs.formation.law`
is. The scenarios of section 5 use it.
"""

from dataclasses import dataclass

from gcs.formation.repulsion import repulsion_force
from gcs.formation.sphere import sphere_force
from gcs.state import Array


@dataclass(frozen=True, slots=True)
class ArticleParameters:
    """Section 5 of the article: M, k, k_s, k_r, r_d."""

    mass_kg: float = 10.0
    damping_n_s_m: float = 1.0
    sphere_gain: float = 5.0
    repulsion_gain: float = 0.2
    radius_m: float = 2.0


def formation_force(
    position_m: Array, center_m: Array, charge: Array, parameters: ArticleParameters
) -> Array:
    """The combined law u^form: sphere convergence plus repulsion.

    Args:
        position_m: (n, 3).
        center_m: (3,), or (n, 3) where each drone believes in a centre of its own.
        charge: (n,).
        parameters: gains and radius.

    Returns: (n, 3) virtual forces in N.
    Source: article, section 2.3.
    """
    pull = sphere_force(position_m, center_m, radius_m=parameters.radius_m, gain=parameters.sphere_gain)
    return pull + repulsion_force(position_m, charge, gain=parameters.repulsion_gain)


def feed_forward_force(
    center_velocity_m_s: Array, center_acceleration_m_s2: Array, parameters: ArticleParameters
) -> Array:
    """What carries every drone along with a moving centre: ``M a_c + k v_c``, (3,) in N.

    Without it the article's own orbit pulls the formation apart (FACTS, section 1, row 3).
    """
    force: Array = (
        parameters.mass_kg * center_acceleration_m_s2 + parameters.damping_n_s_m * center_velocity_m_s
    )
    return force


def step_virtual(
    position_m: Array, velocity_m_s: Array, force_n: Array, dt_s: float, parameters: ArticleParameters
) -> tuple[Array, Array]:
    """One semi-implicit Euler step of ``M p'' = u - k p'``; all arrays (n, 3).

    Returns: position and velocity `dt_s` later.
    Source: article, section 1.
    """
    acceleration_m_s2 = (force_n - parameters.damping_n_s_m * velocity_m_s) / parameters.mass_kg
    later_m_s = velocity_m_s + dt_s * acceleration_m_s2
    return position_m + dt_s * later_m_s, later_m_s
