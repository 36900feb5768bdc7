"""Which obstacles turn: their motion is not straight, and no way that counts on it is to be believed."""

from dataclasses import dataclass
from math import hypot
from typing import Final

from gcs.formation.obstacles import Outlines

TURNS_FROM_M_S: Final = 0.2
"""An obstacle that is faster has a course."""

TURNED: Final = 0.5
"""It has turned when the cosine of the angle to that course is less: by 60 degrees, or back."""


@dataclass(frozen=True, slots=True)
class Courses:
    """The courses of obstacles since each last turned, and when one last did."""

    velocity_m_s: tuple[tuple[str, tuple[float, float]], ...] = ()  # by obstacle id, of those that move
    turned_s: float = -float("inf")

    def seen(self, outlines: Outlines, now_s: float) -> "Courses":
        """The courses after these obstacles were seen with their velocities of now."""
        velocities_m_s, turned_s = dict(self.velocity_m_s), self.turned_s
        for name, (x_m_s, y_m_s) in zip(outlines.names, outlines.velocity_m_s.tolist(), strict=True):
            if hypot(x_m_s, y_m_s) < TURNS_FROM_M_S:
                continue
            course = velocities_m_s.setdefault(name, (x_m_s, y_m_s))
            if course[0] * x_m_s + course[1] * y_m_s < TURNED * hypot(*course) * hypot(x_m_s, y_m_s):
                velocities_m_s[name], turned_s = (x_m_s, y_m_s), now_s
        return Courses(
            tuple((name, velocities_m_s[name]) for name in outlines.names if name in velocities_m_s), turned_s
        )
