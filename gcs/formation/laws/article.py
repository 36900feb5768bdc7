"""The law `article`: the article's forces on the vehicles' positions."""

import numpy as np

from gcs.formation.article import ForceSettings, flown_velocity
from gcs.formation.law import directions_from, symmetry_offsets, turned
from gcs.formation.laws.protocol import FormationLaw, GoalShape, LawAnswer, LawInputs
from gcs.model.state import TINY, Array


class Article(FormationLaw):
    """Forces on positions, computed for all vehicles at once."""

    settings = ForceSettings
    goal_shape = GoalShape.SPHERE
    turns_alike = True

    def velocity(self, inputs: LawInputs) -> LawAnswer:
        settings = ForceSettings.model_validate(inputs.settings)
        own_m_s, momentum_m_s = flown_velocity(
            inputs.position_m,
            inputs.center_m,
            inputs.charge,
            momentum(inputs, inputs.state),
            radius_m=inputs.radius_m,
            dt_s=inputs.dt_s,
            speed_max_m_s=inputs.own_speed_max_m_s,
            settings=settings,
        )
        own_m_s = stoppable(inputs, own_m_s + off_symmetry(inputs, settings), settings)
        return LawAnswer(own_m_s, inputs.for_fleet(momentum_m_s, 0.0))


def momentum(inputs: LawInputs, before_m_s: object) -> Array:
    """(n, 3) virtual velocities of the previous tick, (all, 3), turned with the formation."""
    if not isinstance(before_m_s, np.ndarray):
        before_m_s = np.zeros((len(inputs.fleet_ids) or len(inputs.ids), 3))
    return turned(inputs.of_fleet(before_m_s), inputs.spin_rad_s * inputs.dt_s)


def off_symmetry(inputs: LawInputs, settings: ForceSettings) -> Array:
    """(n, 3) velocities that break the symmetry of vehicles that joined lately; NaN for other stations'."""
    direction, _ = directions_from(inputs.position_m, inputs.center_m)
    speed_m_s = settings.symmetry_speed_m_s * np.exp(-inputs.engaged_s / settings.symmetry_decay_s)
    offset_m_s: Array = speed_m_s[:, None] * symmetry_offsets(
        direction, inputs.ids, np.arange(len(direction))
    )
    return offset_m_s


def stoppable(inputs: LawInputs, own_m_s: Array, settings: ForceSettings) -> Array:
    """(n, 3) velocities of a law of forces, none faster than its vehicle can stop from where it leads.

    The forces are proportional near the place where they vanish: `own_m_s` (n, 3) says how far away that is.
    """
    rate_per_s = max(settings.sphere_rate_per_s, settings.spreading_rate_per_s)
    speed_m_s = np.linalg.norm(own_m_s, axis=1)
    fastest_m_s = inputs.stopping_speed_m_s(speed_m_s / rate_per_s)
    slower: Array = own_m_s * np.minimum(1.0, fastest_m_s / np.maximum(speed_m_s, TINY))[:, None]
    return slower
