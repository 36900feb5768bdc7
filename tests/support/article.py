"""What the article proves its laws with: potentials of the forces, and the rule of the side."""

from math import pi

from gcs.formation.steering import LEFT, RIGHT
from gcs.model.state import Array


def sphere_potential(position_m: Array, center_m: Array, *, radius_m: float) -> Array:
    """V_n of every vehicle: ``(|p - p_c|^2 - r_d^2)^2 / 4``, (n,) in m^4 for (n, 3) and (3,).

    Its negative gradient times k_s is `sphere_force`. Source: article, section 2.1.
    """
    potential: Array = (((position_m - center_m) ** 2).sum(axis=1) - radius_m**2) ** 2 / 4.0
    return potential


def orbit_potential(offset_m: Array, *, radius_m: float) -> float:
    """V_t of a centre at (2,) from its target: ``(rho^2 - r_orbit^2)^2`` in m^4; falls along its field.

    Source: article, section 3.
    """
    return float((float(offset_m @ offset_m) - radius_m**2) ** 2)


def side_of_table_2(bearing_rad: float, tangents_rad: tuple[float, float]) -> float:
    """The side on which Table 2 passes an obstacle: RIGHT where phi <= chi_1, else LEFT.

    The bearing to the centre lies between the tangents, so that the rule always takes chi_2: clockwise round
    the obstacle, the same for all vehicles without a message between them. As printed, with angles that wrap,
    the choice flips for vehicles on one side of the obstacle; here differences of angles count.

    Args:
        bearing_rad: phi, from the vehicle to the obstacle's centre, in the show frame: x towards y, and so
            clockwise, where the article's angles grow counter-clockwise.
        tangents_rad: chi of both tangents in any order, from the vehicle to the tangent points.

    Source: article, section 4.2, Table 2.
    """
    chi_1_rad = max((chi_rad - bearing_rad + pi) % (2.0 * pi) - pi for chi_rad in tangents_rad)
    return RIGHT if chi_1_rad <= 0.0 else LEFT
