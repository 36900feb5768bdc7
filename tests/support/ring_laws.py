"""Laws for several stations: one that each computes alike, one that the lead must compute for all."""

import numpy as np

from gcs.formation.article import no_faster
from gcs.formation.laws.protocol import FormationLaw, GoalShape, LawAnswer, LawInputs
from gcs.model.settings import Settings
from gcs.model.state import Array

RATE_PER_S = 0.5


class RingSettings(Settings):
    """Where the first place is."""

    ahead_rad: float = 0.0


class RingById(FormationLaw):
    """Each vehicle to its place on a level ring, by its place among the names of all."""

    settings = RingSettings
    goal_shape = GoalShape.RING

    def velocity(self, inputs: LawInputs) -> LawAnswer:
        return to_ring(inputs, np.argsort(np.argsort(inputs.ids)))


class RingByRow(FormationLaw):
    """Likewise by its row: rows differ from station to station."""

    settings = RingSettings
    goal_shape = GoalShape.RING
    stations = "led"

    def velocity(self, inputs: LawInputs) -> LawAnswer:
        return to_ring(inputs, np.arange(len(inputs.ids)))


def to_ring(inputs: LawInputs, place: np.ndarray) -> LawAnswer:
    """The answer that leads each vehicle to `place` (n,) of n places."""
    ahead_rad = RingSettings.model_validate(inputs.settings).ahead_rad
    angle_rad = ahead_rad + 2.0 * np.pi * place / len(place)
    there_m = inputs.radius_m * np.column_stack(
        [np.cos(angle_rad), np.sin(angle_rad), np.zeros_like(angle_rad)]
    )
    asked_m_s: Array = RATE_PER_S * inputs.rate_share * (there_m - inputs.position_m + inputs.center_m)
    return LawAnswer(no_faster(asked_m_s, inputs.own_speed_max_m_s))
