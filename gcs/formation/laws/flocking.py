"""The law `flocking`: vehicles keep one distance from their neighbours, and come within the radius.

Source: Olfati-Saber 2006, "Flocking for multi-agent dynamic systems: algorithms and theory", equations 10 to
15 and 23 as velocities: the gradient of the collective potential, and feedback towards the centre.
"""

from math import sqrt

import numpy as np

from gcs.formation.article import no_faster, outward_of
from gcs.formation.laws.protocol import FormationLaw, LawAnswer, LawInputs
from gcs.formation.repulsion import NEAREST_FACTOR
from gcs.model.jit import kernel
from gcs.model.settings import Positive, Settings
from gcs.model.state import Array


class FlockSettings(Settings):
    """Rates of the law `flocking`."""

    spreading_rate_per_s: Positive = 0.15
    """Rate at which two vehicles come to their distance, in 1/s."""
    sphere_rate_per_s: Positive = 0.3
    """Rate at which a vehicle comes within the radius, in 1/s."""
    center_rate_per_s: Positive = 0.02
    """Rate at which a vehicle inside the radius goes on to the centre, in 1/s."""
    range_share: Positive = 1.5
    """Vehicles farther away than this share of the distance do not count."""


class Flocking(FormationLaw):
    """Its distance between neighbours is that of the same vehicles on a sphere of the radius."""

    settings = FlockSettings
    turns_alike = True

    def velocity(self, inputs: LawInputs) -> LawAnswer:
        settings = FlockSettings.model_validate(inputs.settings)
        apart_m = NEAREST_FACTOR * inputs.radius_m / sqrt(max(len(inputs.ids), 4))
        offset_m = inputs.position_m - inputs.center_m
        outward, distance_m = outward_of(offset_m)
        outside_m = np.maximum(distance_m - inputs.radius_m, 0.0)
        own_m_s = settings.spreading_rate_per_s * apart_m * gradient(offset_m / apart_m, settings.range_share)
        own_m_s -= settings.center_rate_per_s * offset_m + settings.sphere_rate_per_s * outside_m * outward
        return LawAnswer(no_faster(inputs.rate_share * own_m_s, inputs.own_speed_max_m_s))


EPSILON, FLAT = 0.1, 0.2
"""Of the paper's sigma-norm, and the share of the range in which a neighbour counts fully (its h)."""


@kernel
def gradient(place: Array, reach: float) -> Array:
    """(n, 3) sums of the actions of neighbours within `reach`, at (n, 3); none acts at a distance of 1."""
    pushed = np.zeros_like(place)
    rest = (np.sqrt(1.0 + EPSILON) - 1.0) / EPSILON
    farthest = (np.sqrt(1.0 + EPSILON * reach * reach) - 1.0) / EPSILON
    for i in range(len(place)):
        for j in range(len(place)):
            dx, dy, dz = place[j, 0] - place[i, 0], place[j, 1] - place[i, 1], place[j, 2] - place[i, 2]
            square = dx * dx + dy * dy + dz * dz
            if i != j and square < reach * reach:
                root = np.sqrt(1.0 + EPSILON * square)
                along = (root - 1.0) / EPSILON
                share = along / farthest
                bump = 1.0 if share < FLAT else 0.5 + 0.5 * np.cos(np.pi * (share - FLAT) / (1.0 - FLAT))
                action = bump * (along - rest) / np.sqrt(1.0 + (along - rest) ** 2) / root
                pushed[i, 0] += action * dx
                pushed[i, 1] += action * dy
                pushed[i, 2] += action * dz
    return pushed
