"""The article's forces as printed, sections 1 to 4, for the flights of its section 5."""

from collections.abc import Mapping

from gcs.formation.article import ArticleParameters, repulsion_force, sphere_force
from gcs.formation.obstacles import AvoidanceSettings, Ellipse
from gcs.formation.steering import avoid_all
from gcs.model.state import Array

ANSWER_S = 0.2
"""Time constant with which an avoiding vehicle takes on the velocity along its tangent."""


def formation_force(
    position_m: Array, center_m: Array, charge: Array, parameters: ArticleParameters
) -> Array:
    """The combined law u^form: sphere convergence plus repulsion.

    Args:
        position_m: (n, 3).
        center_m: (3,), or (n, 3) if each vehicle has its own estimate of the centre.
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
    """Force that moves every vehicle with the centre: ``M a_c + k v_c``, (3,) in N.

    Without it the article's own orbit pulls the formation apart (FACTS, section 1, row 3).
    """
    force: Array = (
        parameters.mass_kg * center_acceleration_m_s2 + parameters.damping_n_s_m * center_velocity_m_s
    )
    return force


def acceleration(velocity_m_s: Array, force_n: Array, parameters: ArticleParameters) -> Array:
    """The virtual dynamics, ``(u - k p') / M``: (n, 3) in m/s^2, for (n, 3) velocities and forces in N.

    Source: article, section 1.
    """
    acceleration_m_s2: Array = (force_n - parameters.damping_n_s_m * velocity_m_s) / parameters.mass_kg
    return acceleration_m_s2


def avoiding_force(
    position_m: Array,
    velocity_m_s: Array,
    force_n: Array,
    ellipses: Mapping[str, Ellipse],
    sides: Mapping[str, float],
    sliding_m_s: Array,
    parameters: ArticleParameters,
    settings: AvoidanceSettings,
) -> Array:
    """Force that turns a vehicle along its tangent where the law's force leads into an ellipse.

    The article blends velocities, but its dynamics take forces. Therefore the velocity to which the force
    leads within `ANSWER_S` is turned, and the force is changed by the amount that the turn needs.

    Args:
        position_m: (n, 3), z down, as `velocity_m_s` and `force_n`.
        velocity_m_s: (n, 3).
        force_n: (n, 3) force of formation and feed-forward.
        ellipses: around the obstacles.
        sides: LEFT or RIGHT for each obstacle, chosen once for the whole formation.
        sliding_m_s: (n,) speed to keep along the tangent.
        parameters: mass and damping.
        settings: distances and rates of the avoidance.

    Returns: (n, 3) in N; exactly `force_n` where no ellipse is in the way.
    Source: article, section 4.3.
    """
    desired_m_s = velocity_m_s + ANSWER_S * acceleration(velocity_m_s, force_n, parameters)
    turned_m_s = avoid_all(position_m, desired_m_s, ellipses, sides, sliding_m_s, settings)
    force: Array = force_n + parameters.mass_kg / ANSWER_S * (turned_m_s - desired_m_s)
    return force
