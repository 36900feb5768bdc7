"""The law `neighbours`: each vehicle from what it knows within its range, with an agreed centre."""

import numpy as np

from gcs.formation.laws.article import momentum, off_symmetry, stoppable
from gcs.formation.laws.protocol import FormationLaw, GoalShape, LawAnswer, LawInputs
from gcs.formation.neighbours import Belief, NeighboursSettings, Sight, neighbours_velocity, range_m, sight_of


class Neighbours(FormationLaw):
    """Row i of what it returns depends on the vehicles within range of vehicle i only."""

    settings = NeighboursSettings
    goal_shape = GoalShape.SPHERE
    takes_sight = True
    turns_alike = True

    def velocity(self, inputs: LawInputs) -> LawAnswer:
        """Its state is the virtual velocities (all, 3), and each vehicle's belief of the centre."""
        settings = NeighboursSettings.model_validate(inputs.settings)
        before_m_s, before = inputs.state if isinstance(inputs.state, tuple) else (None, None)
        center = Belief.describe(inputs.center_m, inputs.center_velocity_m_s, len(inputs.ids))
        seen = _seen(inputs, before, center, settings)
        belief = seen.belief or center
        own_m_s, momentum_m_s = neighbours_velocity(
            inputs.position_m,
            momentum(inputs, before_m_s),
            seen,
            belief,
            radius_m=inputs.radius_m,
            dt_s=inputs.dt_s,
            speed_max_m_s=inputs.own_speed_max_m_s,
            settings=settings,
        )
        own_m_s = stoppable(inputs, own_m_s + off_symmetry(inputs, settings), settings)
        believed_m_s = np.where(np.isfinite(belief.velocity_m_s), belief.velocity_m_s, 0.0)
        own_m_s += believed_m_s - inputs.center_velocity_m_s
        kept = Belief(
            inputs.for_fleet(belief.center_m, np.nan), inputs.for_fleet(belief.velocity_m_s, np.nan)
        )
        knows_center = inputs.sight is None or inputs.sight.belief is None
        state = inputs.for_fleet(momentum_m_s, 0.0), kept
        return LawAnswer(own_m_s, state, knows_center=knows_center)


def _seen(inputs: LawInputs, before: Belief | None, center: Belief, settings: NeighboursSettings) -> Sight:
    """What each vehicle knows: what it received, or without a radio all that is in range."""
    count = len(inputs.fleet_ids) or len(inputs.ids)
    on_sphere = np.zeros(count, np.bool_)
    on_sphere[np.arange(count) if inputs.rows is None else inputs.rows] = True
    if inputs.sight is not None:
        return inputs.sight.only(on_sphere)
    return sight_of(
        inputs.position_m,
        inputs.charge,
        (before or Belief.nothing(count)).only(on_sphere),
        center,
        range_m=range_m(settings.neighbours, len(inputs.ids), inputs.radius_m),
        dt_s=inputs.dt_s,
        sighting_rate_per_s=settings.sighting_rate_per_s,
    )
